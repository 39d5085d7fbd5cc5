//! Static points: one row per soak. Frequency-temperature fits both ways, and the trace of what they leave.
//!
//! # How a p-value is computed
//! Ten points and a cubic leave six degrees of freedom, and residuals of a fit are correlated among themselves.
//! So p-values are not read off a table: independent Gaussian noise is put at the points of each gyro, fitted and
//! searched in the very same way, [`DRAWS`] times with a fixed seed, and the share of draws that do at least as
//! well is the p-value. For the chamber reference the three gyros share one chamber sensor and are *not*
//! independent; there the noise is drawn once for all three.

mod chamber_step;
mod common_shape;
mod fits;
mod left_over;
mod pairs;
mod residual;
mod table;

pub use fits::{AxisFits, PolyFit};
pub use left_over::{BeforeAfter, LeftOver};
pub use pairs::Pair;
pub use table::{Points, TableError};

use crate::thermometer::curve;
use hrg_core::effects::EffectId;
use hrg_core::temperature::TemperatureCurve;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use serde::Serialize;
use std::collections::BTreeMap;
use table::LEAST_SOAKS;

/// Draws of noise behind each p-value.
pub const DRAWS: usize = 100_000;

/// The report of `hrg fit points`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Version of the report.
    pub version: u32,
    /// By reference, then by axis.
    pub fits: BTreeMap<String, BTreeMap<String, AxisFits>>,
    /// Every two of the axes.
    pub each_other: Vec<Pair>,
    /// Effects left over.
    pub effects: Vec<LeftOver>,
    /// Advice on further steps.
    pub advice: Vec<String>,
}

/// Names of the references in reports: the sensors on the cases, and the chamber's.
const REFERENCES: [&str; 2] = ["shell", "chamber"];

/// The word for a reference in sentences: reports keep the former one of the cases.
#[must_use]
pub fn called(reference: &str) -> &'static str {
    if reference == REFERENCES[0] {
        "case"
    } else {
        "chamber"
    }
}

/// The curve of each axis as the unit evaluates it, and what it is referred to: the cases, or the chamber where an axis has no case
/// sensor. `None` for an axis that the table does not have.
///
/// # Errors
/// If a fit is not possible.
pub fn curves(p: &Points) -> Result<[Option<(TemperatureCurve, &'static str)>; AXES], BadInput> {
    let mut out = [None; AXES];
    for (a, out) in out.iter_mut().enumerate() {
        for reference in REFERENCES {
            let name = called(reference);
            let (f, t) = both(&p.frequency_hz[a], p.temperatures(reference, a));
            if f.len() >= LEAST_SOAKS {
                *out = Some((curve::fit_inverse(&f, &t, None, 3)?, name));
                break;
            }
        }
    }
    if out.iter().all(Option::is_none) {
        return Err(BadInput::new("no axis has six soaks with a frequency and a temperature"));
    }
    Ok(out)
}

/// The report of a table.
///
/// # Errors
/// If a fit is not possible.
pub fn report(p: &Points) -> Result<Report, BadInput> {
    let mut fits = BTreeMap::new();
    for reference in REFERENCES {
        let mut axes = BTreeMap::new();
        for (a, name) in AXIS_NAMES.iter().enumerate() {
            let (f, t) = both(&p.frequency_hz[a], p.temperatures(reference, a));
            if f.len() >= LEAST_SOAKS {
                axes.insert((*name).to_string(), fits::axis_fits(&t, &f)?);
            }
        }
        if !axes.is_empty() {
            fits.insert(reference.to_string(), axes);
        }
    }
    if fits.is_empty() {
        return Err(BadInput::new("no axis has six soaks with a frequency and a temperature"));
    }
    let mut effects = Vec::new();
    let mut advice = Vec::new();
    if let Some(p) = p.complete("chamber") {
        effects.extend(chamber_step::chamber_step(&p)?);
    }
    if let Some(p) = p.complete("shell") {
        effects.extend(common_shape::common_shape(&p));
    }
    let each_other = pairs::each_other(p);
    for e in &effects {
        if e.name == EffectId::Step.name() {
            advice.push(
                "Refer the gyros to the sensors on their cases, not to the chamber: the step is between chamber and cases, all three gyros and all three of their sensors see it. Check the chamber's sensor (range switch, calibration points) across the step.".into(),
            );
        }
        if e.name == EffectId::Timebase.name() {
            advice.push(
                "Log the counter's clock against a reference and one independent thermometer beside the gyros: only that parts a shared timebase from a shared thermal state.".into(),
            );
        }
    }
    Ok(Report { version: 1, fits, each_other, effects, advice })
}

/// The rows in which both have a value.
fn both(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    x.iter().zip(y).filter(|(x, y)| x.is_finite() && y.is_finite()).map(|(x, y)| (*x, *y)).unzip()
}

/// Tables for the tests of this room.
#[cfg(test)]
mod samples {
    use super::Points;
    use hrg_core::AXES;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Ten soaks of three gyros with a common shape, and noise of their own.
    pub(super) fn table(common_c: f64, own_c: [f64; AXES], step_c: f64) -> Points {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut p = Points { rows: 10, ..Points::default() };
        for k in 0..10 {
            let t = f64::from(k) * 10.0 - 40.0;
            let shared = common_c * [1.0, -1.0, 0.5, -0.5, 1.5, -1.5, 0.7, -0.7, 1.0, -1.0][k as usize];
            p.chamber_c.push(t + if t > 0.0 { step_c } else { 0.0 });
            for a in 0..AXES {
                p.frequency_hz[a].push(4900.0 + 0.47 * t);
                let noise: f64 = StandardNormal.sample(&mut rng);
                p.case_c[a].push(t + shared + own_c[a] * noise);
            }
        }
        p
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_and_columns_may_be_missing() {
        let text = |skip: &dyn Fn(usize) -> bool| -> String {
            let mut s = "chamber_c,fx_hz,fz_hz,shell_x_c\n".to_string();
            for k in 0..9 {
                let t = f64::from(k) * 5.0 + 20.0;
                // The error of the chamber's sensor is in both modes.
                let body = t + [0.3, -0.2, 0.1, -0.3, 0.2, -0.1, 0.3, -0.3, 0.1][k as usize];
                let case = if skip(k as usize) { String::new() } else { format!("{t}") };
                s += &format!("{t},{},{},{case}\n", 4900.0 + 0.47 * body, 9800.0 - 0.9 * body + 0.001 * body * body);
            }
            s
        };
        let r = report(&Points::parse(&text(&|k| k == 3)).expect("readable")).expect("fits");
        assert!(r.fits["shell"].len() == 1 && r.fits["shell"]["x"].inverse[2].residuals_c.len() == 8);
        assert_eq!(r.fits["chamber"].keys().collect::<Vec<_>>(), ["x", "z"]);
        let pair = &r.each_other[0];
        assert_eq!((pair.axes[1].as_str(), pair.soaks, r.each_other.len()), ("z", 9, 1));
        assert!(pair.correlation > 0.99 && pair.p_value < 1e-3, "{pair:?}");
        assert!(pair.by_the_other_rms_c[0] < 0.01 && pair.against_chamber_rms_c[0] > 0.05, "{pair:?}");
        let r = report(&Points::parse(&text(&|k| k > 4)).expect("readable")).expect("fits");
        assert!(!r.fits.contains_key("shell"), "five soaks are too few");
        let e = Points::parse("chamber_c,f_hz\n1,2\n").expect_err("no frequency").to_string();
        assert!(e.contains("fx_hz") && e.contains("there are chamber_c, f_hz"), "{e}");
    }
}
