//! Errors of the two horizontal accelerometers (chen2015, eq 2): bias, scale and cross-axis, found on a tilting table, where `A1 = g th2`
//! and `A2 = -g th1` of tilts that are known. [`hrg_core::accelerometers`] applies them.

use super::Recording;
use hrg_align::ARCMIN;
use hrg_core::accelerometers as core;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Model of the two accelerometers: readings for a given acceleration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Accelerometers {
    /// Readings at rest and level, m/s^2.
    pub bias_mps2: [f64; 2],
    /// Rows: what accelerometer 1 and 2 read for an acceleration along axis 1 and along axis 2.
    pub matrix: [[f64; 2]; 2],
}

/// Identified accelerometers, and their uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Identified {
    /// The accelerometers.
    #[serde(flatten)]
    pub accelerometers: Accelerometers,
    /// Standard deviations of each row: bias, and both elements of the matrix.
    pub std: [[f64; 3]; 2],
    /// Residual, RMS, m/s^2.
    pub residual_mps2: [f64; 2],
    /// Rows of the table.
    pub rows: usize,
}

const COLUMNS: [&str; 4] = ["a1_mps2", "a2_mps2", "tilt1_arcmin", "tilt2_arcmin"];
/// Rows that are needed: three unknowns an accelerometer, and something to judge them by.
const FEWEST: usize = 6;
/// Identifies the accelerometers from a table of tilts and readings.
///
/// # Errors
/// One sentence with line and column, or what the table lacks.
pub fn identify(text: &str, gravity_mps2: f64) -> Result<Identified, BadInput> {
    let mut places: Option<[usize; 4]> = None;
    let mut values: [Vec<f64>; 4] = Default::default();
    for (n, line) in text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let Some(at) = places else {
            let mut found = [0; 4];
            for (to, name) in found.iter_mut().zip(COLUMNS) {
                *to = cells.iter().position(|c| *c == name).ok_or_else(|| {
                    BadInput::new(format!(
                        "line {}: the column {name} is missing; a table of tilts has {}",
                        n + 1,
                        COLUMNS.join(",")
                    ))
                })?;
            }
            places = Some(found);
            continue;
        };
        for k in 0..4 {
            let cell = cells.get(at[k]).copied().unwrap_or("");
            let value = cell.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
                BadInput::new(format!(
                    "line {}, column {} ({}): \"{cell}\" is not a number",
                    n + 1,
                    at[k] + 1,
                    COLUMNS[k]
                ))
            })?;
            values[k].push(value);
        }
    }
    let rows = values[0].len();
    if rows < FEWEST {
        return Err(BadInput::new(format!(
            "{rows} tilts; {FEWEST} are needed at the least: level, and some degrees either way about each axis"
        )));
    }
    let [a1, a2, tilt1, tilt2] = values;
    let along = |tilt: &[f64], sign: f64| -> Vec<f64> {
        tilt.iter().map(|t| sign * gravity_mps2 * (t * ARCMIN).sin()).collect()
    };
    let columns = [vec![1.0; rows], along(&tilt2, 1.0), along(&tilt1, -1.0)];
    let mut out = Identified {
        accelerometers: Accelerometers { bias_mps2: [0.0; 2], matrix: [[0.0; 2]; 2] },
        std: [[0.0; 3]; 2],
        residual_mps2: [0.0; 2],
        rows,
    };
    for (k, readings) in [a1, a2].iter().enumerate() {
        let fit = lsq::fit(&columns, readings, None, &["bias", "tilt about axis 2", "tilt about axis 1"])?;
        out.accelerometers.bias_mps2[k] = fit.coefficients[0];
        out.accelerometers.matrix[k] = [fit.coefficients[1], fit.coefficients[2]];
        out.std[k] = [fit.std[0], fit.std[1], fit.std[2]];
        out.residual_mps2[k] = (fit.squares / rows as f64).sqrt();
    }
    out.accelerometers.check()?;
    Ok(out)
}

impl Accelerometers {
    fn check(&self) -> Result<(), BadInput> {
        if self.in_image().possible() {
            return Ok(());
        }
        let [[a, b], [c, d]] = self.matrix;
        Err(BadInput::new(format!(
            "the accelerometers read {a:.3} and {d:.3} of what there is along them, and {b:.3} and {c:.3} of what there is across; tilts are those about axes 1 and 2, in arc minutes, readings in m/s^2: check columns and signs (a1 = g tilt2, a2 = -g tilt1)"
        )))
    }

    /// As they stand in a calibration.
    #[must_use]
    pub fn in_image(&self) -> core::Accelerometers {
        let single = |row: [f64; 2]| row.map(|v| v as f32);
        core::Accelerometers { bias_mps2: single(self.bias_mps2), matrix: self.matrix.map(single) }
    }

    /// As a calibration has them.
    #[must_use]
    pub fn of_image(a: &core::Accelerometers) -> Self {
        Self { bias_mps2: a.bias_mps2.map(f64::from), matrix: a.matrix.map(|row| row.map(f64::from)) }
    }

    /// Reads a file of `hrg align accelerometers`, or the part of a calibration.
    ///
    /// # Errors
    /// One sentence with the path.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let bytes = hrg_data::files::read_file(path, hrg_data::files::MOST_CALIBRATION, true)?;
        if bytes.first() != Some(&b'{') {
            return Ok(Self::of_image(&hrg_data::image_file::load(path)?.accelerometers));
        }
        let here = |e: BadInput| BadInput::new(format!("{}: {e}", path.display()));
        Ok(Self::parse(&String::from_utf8_lossy(&bytes)).map_err(here)?)
    }

    /// Reads the text of such a file.
    ///
    /// # Errors
    /// One sentence.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let found: Self = serde_json::from_str(text).map_err(|e| {
            BadInput::new(format!("no file of hrg align accelerometers ({e}); make one with hrg align accelerometers"))
        })?;
        found.check()?;
        Ok(found)
    }

    /// Takes the errors out of the velocities of a recording: each position begins anew.
    pub fn correct(&self, recording: &mut Recording) {
        let accelerometers = self.in_image();
        let mut begun = [None; 2];
        for (t, position, v) in &mut recording.rows {
            let start = *begun[usize::from(*position == 2)].get_or_insert(*t);
            *v = accelerometers.correct(*v, *t - start);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::plant::Plant;
    use super::super::{align, FilterKind, Start};
    use super::*;
    use hrg_align::{wrap, DEGREE};

    const TRUE: Accelerometers = Accelerometers { bias_mps2: [2e-4, -3e-4], matrix: [[1.02, 0.003], [-0.002, 1.02]] };

    fn table(noise: f64) -> String {
        let mut text = String::from("a1_mps2,a2_mps2,tilt1_arcmin,tilt2_arcmin\n");
        for (k, (t1, t2)) in
            [(0, 0), (120, 0), (-120, 0), (0, 120), (0, -120), (90, 90), (-90, 60), (0, 0)].iter().enumerate()
        {
            let g = 9.8;
            let (a1, a2) = (g * (f64::from(*t2) * ARCMIN).sin(), -g * (f64::from(*t1) * ARCMIN).sin());
            let m = TRUE.matrix;
            let wobble = noise * if k % 2 == 0 { 1.0 } else { -1.0 };
            let r = [0, 1].map(|k: usize| TRUE.bias_mps2[k] + m[k][0] * a1 + m[k][1] * a2 + wobble);
            text += &format!("{:.9},{:.9},{t1},{t2}\n", r[0], r[1]);
        }
        text
    }

    #[test]
    fn tilts_tell_bias_scale_and_cross_axis_and_an_alignment_is_whole_again() {
        let found = identify(&table(1e-6), 9.8).expect("identified").accelerometers;
        for k in 0..2 {
            assert!((found.bias_mps2[k] - TRUE.bias_mps2[k]).abs() < 2e-6, "{found:?}");
            assert!((0..2).all(|j| (found.matrix[k][j] - TRUE.matrix[k][j]).abs() < 1e-5), "{found:?}");
        }
        // 2 % of scale on both: without the matrix the positions contradict each other, with it all is well.
        let mut good = 0;
        for seed in 1..=10 {
            let (mut recording, truth) = Plant::drawn(seed).play();
            let mut begun = [None; 2];
            for (t, position, v) in &mut recording.rows {
                let start = *begun[usize::from(*position == 2)].get_or_insert(*t);
                let m = TRUE.matrix;
                *v = [0, 1].map(|k: usize| TRUE.bias_mps2[k] * (*t - start) + m[k][0] * v[0] + m[k][1] * v[1]);
            }
            assert!(align(&recording, FilterKind::Linear, Start::default()).is_err(), "{seed}");
            found.correct(&mut recording);
            if let Ok(r) = align(&recording, FilterKind::Linear, Start::default()) {
                good += usize::from(wrap(r.azimuth_deg * DEGREE - truth.azimuth).abs() < 10.0 * ARCMIN);
            }
        }
        assert!(good >= 9, "{good} of 10");
    }

    #[test]
    fn wrong_tables_are_refused() {
        let swapped = table(0.0).replace("tilt1_arcmin,tilt2_arcmin", "tilt2_arcmin,tilt1_arcmin");
        assert!(identify(&swapped, 9.8).expect_err("refused").0.contains("check columns and signs"));
        let head = "a1_mps2,a2_mps2,tilt1_arcmin,tilt2_arcmin\n";
        assert!(identify(head, 9.8).expect_err("refused").0.contains("0 tilts"));
        assert!(identify(&format!("{head}0,x,0,0\n"), 9.8).expect_err("refused").0.contains("column 2 (a2_mps2)"));
        assert!(identify("a1_mps2\n", 9.8).expect_err("refused").0.contains("a2_mps2 is missing"));
    }
}
