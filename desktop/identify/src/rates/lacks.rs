//! Lacks of a scale factor, as a recording: so the search for the lacks of a bias ([`crate::trace`]) finds them by the same families.

use super::dwells::{dwells, table_by_step};
use super::quality::visits;
use crate::fit::correct;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::recording::columns::TABLE_RATE;
use hrg_data::recording::metadata::{self, LACKING};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;

/// The recording of a run on a rate table with, in the place of each rate, what the scale factor of the axis lacks, ppm: in the dwells of visits
/// about that axis `1e6 (table - corrected + middle) / table`, where the middle of plus and minus rates is the bias that is left;
/// elsewhere NaN. Times, thermometers and sensors are those of the run.
///
/// # Errors
/// As [`dwells`]; a run that did not turn both ways about each axis.
pub fn lacking(r: &Recording, calibration: &Calibration) -> Result<Recording, BadInput> {
    let dwells = dwells(r, calibration, 0)?;
    let steps = Steps::new(r)?;
    let table = table_by_step(r, &steps)?;
    let seconds = correct::correct(calibration, &steps);
    let mut out = [0; AXES].map(|_| vec![f64::NAN; steps.len()]);
    for visit in visits(&dwells) {
        let Some(a) = visit[0].about else { continue };
        let side = |sign: f64| {
            let own = visit.iter().filter(|d| sign * d.given() > 0.0);
            let (sum, n) = own.fold((0.0, 0.0), |(s, n), d| (s + d.corrected[a] - d.table[a], n + 1.0));
            sum / n
        };
        let middle = 0.5 * (side(1.0) + side(-1.0));
        if !middle.is_finite() {
            continue;
        }
        for k in visit.iter().flat_map(|d| d.at.clone()) {
            let off = f64::from(seconds[k].corrected_dph[a]) - table[a][k] - middle;
            out[a][k] = -1e6 * off / table[a][k];
        }
    }
    if let Some(a) = out.iter().position(|o| o.iter().all(|v| v.is_nan())) {
        return Err(BadInput::new(format!(
            "the recording of {} did not turn both ways about {}: give one of the eight steps (hrg profile --rates)",
            r.unit(),
            hrg_data::axes::AXIS_NAMES[a]
        )));
    }
    let mut lacking = r.clone();
    // (The earth's rate is in no share of a rate.)
    lacking.meta.retain(|(k, _)| ![metadata::TABLE_RATE, "latitude_deg", "axes", "rates"].contains(&k.as_str()));
    lacking.meta.push(("rates".into(), LACKING.into()));
    lacking.optional.retain(|(n, _)| (0..AXES).all(|a| TABLE_RATE.name(a) != *n));
    lacking.earth_rate_dph = None;
    for (rates, out) in lacking.rate_dph.iter_mut().zip(&out) {
        for (to, t) in rates.iter_mut().zip(&r.time_s) {
            *to = out[((t - steps.start_s).round() as usize).min(steps.len() - 1)];
        }
    }
    Ok(lacking)
}
