//! The pair of positions for an alignment (chen2015, eq 3 and its section 1.2): drift that depends on the heading is the same function of it
//! each time, so two headings a turn apart are chosen whose drifts are nearly equal and repeat best.

use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{mean, std_dev};
use serde::Serialize;
use std::path::Path;

const HEADER: [&str; 2] = ["heading_deg", "drift_dph"];
/// Calibrations that are needed to tell how well a drift repeats.
const FEWEST: usize = 3;
/// Headings nearer than this are the same position, degrees: the turn's own accuracy (chen2015: 6').
pub const SAME_DEG: f64 = 0.1;

/// Drift over heading, one calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Heading (degrees) and drift (deg/h).
    pub points: Vec<(f64, f64)>,
}

/// A pair of positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pair {
    /// Heading of the first position, degrees.
    pub from_deg: f64,
    /// Heading of the second.
    pub to_deg: f64,
    /// Mean difference of the drifts, deg/h.
    pub difference_dph: f64,
    /// Repeatability of that difference: its standard deviation over the calibrations, deg/h.
    pub repeats_dph: f64,
    /// Both together, deg/h: what an alignment in this pair has to reckon with.
    pub both_dph: f64,
}

/// Reads a calibration: `heading_deg,drift_dph`.
///
/// # Errors
/// One sentence with path and line.
pub fn load(path: &Path) -> Result<Calibration, BadInput> {
    let bytes = hrg_data::files::read_file(path, hrg_data::files::MOST_RECORDING, true)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut places: Option<[usize; 2]> = None;
    let mut points = Vec::new();
    for (n, line) in text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty()) {
        let here = |what: String| BadInput::new(format!("{}: line {}{what}", path.display(), n + 1));
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let Some(at) = places else {
            let place = |name: &str| {
                cells
                    .iter()
                    .position(|c| *c == name)
                    .ok_or_else(|| here(format!(": the column {name} is missing; there are {}", cells.join(", "))))
            };
            places = Some([place(HEADER[0])?, place(HEADER[1])?]);
            continue;
        };
        let number = |k: usize| -> Result<f64, BadInput> {
            let cell = cells.get(at[k]).copied().unwrap_or("");
            cell.parse::<f64>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| here(format!(", column {} ({}): \"{cell}\" is not a number", at[k] + 1, HEADER[k])))
        };
        points.push((number(0)?, number(1)?));
    }
    if points.len() < 2 {
        return Err(BadInput::new(format!(
            "{}: {} headings; two are needed at the least",
            path.display(),
            points.len()
        )));
    }
    Ok(Calibration { points })
}

/// The smallest angle between two headings, degrees.
fn apart(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(360.0);
    d.min(360.0 - d)
}

/// The pairs that are a turn apart, the best first.
///
/// # Errors
/// Too few calibrations, or no pair.
pub fn pairs(all: &[Calibration], turn_deg: f64) -> Result<Vec<Pair>, BadInput> {
    if all.len() < FEWEST {
        return Err(BadInput::new(format!(
            "{} calibrations over the heading; {FEWEST} are needed to tell how well a drift repeats",
            all.len()
        )));
    }
    let at = |c: &Calibration, heading: f64| {
        c.points.iter().find(|(h, _)| apart(*h, heading) < SAME_DEG).map(|(_, drift)| *drift)
    };
    let mut out = Vec::new();
    for &(from_deg, _) in &all[0].points {
        let to_deg = (from_deg + turn_deg).rem_euclid(360.0);
        let differences: Vec<f64> = all.iter().filter_map(|c| Some(at(c, to_deg)? - at(c, from_deg)?)).collect();
        if differences.len() < FEWEST {
            continue;
        }
        let (difference_dph, repeats_dph) = (mean(&differences), std_dev(&differences));
        out.push(Pair { from_deg, to_deg, difference_dph, repeats_dph, both_dph: difference_dph.hypot(repeats_dph) });
    }
    if out.is_empty() {
        return Err(BadInput::new(format!(
            "no two headings {turn_deg} degrees apart are in {FEWEST} of the calibrations; measure the drift at headings that are"
        )));
    }
    out.sort_by(|a, b| a.both_dph.total_cmp(&b.both_dph));
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pair_that_is_equal_and_repeats_is_first() {
        // Equal drifts at 30 and 120 degrees that repeat; equal ones at 60 and 150 that do not; others apart.
        let drift = |h: f64, k: u32| {
            let h = h as u32;
            match h {
                30 | 120 => 0.20,
                60 => 0.10 + 0.05 * f64::from(k),
                150 => 0.10,
                _ => 0.01 * f64::from(h % 97),
            }
        };
        let one = |k: u32| Calibration {
            points: (0..12).map(|n| (f64::from(30 * n), drift(f64::from(30 * n), k))).collect(),
        };
        let all: Vec<Calibration> = (0..4).map(one).collect();
        let found = pairs(&all, 90.0).expect("pairs");
        assert_eq!((found[0].from_deg, found[0].to_deg), (30.0, 120.0));
        assert!(found[0].both_dph < 1e-12 && found.len() == 12);
        let unsteady = found.iter().find(|p| p.from_deg == 60.0).expect("there");
        // 0, 0.05, 0.10, 0.15: mean 0.075, standard deviation 0.0645.
        assert!((unsteady.difference_dph + 0.075).abs() < 1e-12 && (unsteady.repeats_dph - 0.064_55).abs() < 1e-4);
        assert!(pairs(&all[..2], 90.0).expect_err("refused").0.contains("are needed"));
        assert!(pairs(&all, 45.0).expect_err("refused").0.contains("45 degrees apart"));
    }
}
