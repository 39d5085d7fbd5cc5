//! Coefficients of the baseline model by least squares.

use crate::laws;
use crate::lsq;
use crate::recording::Recording;
use crate::run::{Run, Steps};
use crate::stats::{block_means, std_dev};
use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::{heating_weight, regressors, Coefficients, Scaling, TERMS};
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::AXES;

/// Seconds of a mean: the field's figure is three sigma of 100 s means.
pub const MEAN_S: usize = 100;

/// Names of the regressors of eq 7.
pub const NAMES: [&str; TERMS] = ["1", "T", "T^2", "dT/dt", "(dT/dt)^2", "T dT/dt"];

/// How to fit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Options {
    /// A cooling and a heating set.
    pub two_sets: bool,
    /// Weigh every degree of temperature alike, instead of every second.
    pub uniform_in_temperature: bool,
}

/// What a fit gives beside the calibration.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The calibration.
    pub calibration: Calibration,
    /// Condition number of the regressors, per axis.
    pub condition: [f64; AXES],
    /// Standard deviation of 100 s means of the raw rate, deg/h.
    pub raw_dph: [f64; AXES],
    /// Standard deviation of 100 s means of the corrected rate, deg/h.
    pub corrected_dph: [f64; AXES],
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Runs made ready for a fit.
#[derive(Debug)]
pub struct Prepared {
    /// The runs through the unit's thermometer.
    pub runs: Vec<Run>,
    /// Laws, scaling and ranges; no bias yet.
    pub calibration: Calibration,
    /// What the user should know.
    pub notes: Vec<String>,
    /// Time constant by which each resonator follows its sensor, s (0: not identified).
    pub lag_s: [f64; AXES],
}

/// Prepares runs for a fit: refuses corrected ones, brings them to steps, identifies the temperature laws.
///
/// # Errors
/// One sentence.
pub fn prepare(recordings: &[Recording]) -> Result<Prepared, BadInput> {
    let mut notes = Vec::new();
    let mut steps = Vec::new();
    for r in recordings {
        if r.corrected() {
            return Err(BadInput::new(format!(
                "the recording of {} holds corrected rates; a fit on them would be applied on top of another one: use the raw recording",
                r.unit()
            )));
        }
        steps.push(Steps::new(r)?);
    }
    let first = recordings.first().ok_or_else(|| BadInput::new("no recording was given"))?;
    if let Some(other) = recordings.iter().find(|r| r.unit() != first.unit()) {
        return Err(BadInput::new(format!(
            "the recordings are of different units, {} and {}",
            first.unit(),
            other.unit()
        )));
    }
    let laws::Identified { laws, reference, lag_s } = laws::from_steps(&steps)?;
    match reference {
        laws::Reference::Shell => notes.push(format!(
            "the resonators follow their shells with time constants of {:.0}, {:.0} and {:.0} s",
            lag_s[0], lag_s[1], lag_s[2]
        )),
        laws::Reference::Chamber => notes.push("no shell sensor: temperatures are referred to the chamber".into()),
        laws::Reference::Implausible => notes.push(
            "the temperature sensors do not follow the resonators as fused silica does (60 to 150 ppm per C): check them; temperatures here follow the frequency by the law of dong2023's Table 1, shifted to this run".into(),
        ),
        laws::Reference::Shape => {
            notes.push("no temperature sensor: temperatures follow the frequency by the law of dong2023's Table 1, shifted to this run".into());
        }
    }
    let mut calibration = Calibration::uncalibrated();
    calibration.set_unit_name(first.unit());
    calibration.calibrated = true;
    calibration.data_hash = data_hash(recordings);
    for (axis, law) in calibration.axes.iter_mut().zip(laws) {
        axis.law = law;
    }
    let (low, high) =
        laws.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), l| (a.min(l.min_c), b.max(l.max_c)));
    calibration.scaling = Scaling {
        t_ref_c: (0.5 * (low + high)).round(),
        t_scale_c: (0.5 * (high - low)).max(5.0).round(),
        // The polynomial is trusted a little beyond the data and continued straight from there.
        t_linear_c: [low - 5.0, high + 5.0],
        r_linear: 10.0,
        blend_band: 0.1,
    };
    let runs: Vec<Run> = steps.into_iter().map(|s| Run::new(s, laws)).collect();
    for (a, axis) in calibration.axes.iter_mut().enumerate() {
        let ranges: Vec<(f32, f32)> = runs.iter().map(|r| r.ramp_range(a)).collect();
        let cold = ranges.iter().map(|r| r.0).fold(0.0, f32::min);
        let hot = ranges.iter().map(|r| r.1).fold(0.0, f32::max);
        // A tenth beyond the ramps seen is still called inside.
        axis.rate_range_c_per_min = [cold * 1.1 - 0.02, hot * 1.1 + 0.02];
        if a == 0 {
            for (slowest, missing) in [(cold > -0.1, "cooling"), (hot < 0.1, "heating")] {
                if slowest {
                    notes.push(format!("there is no {missing} ramp in the data: what differs between heating and cooling cannot be seen"));
                }
            }
        }
    }
    let r_most = calibration.axes.iter().flat_map(|a| a.rate_range_c_per_min).fold(0.0f32, |m, r| m.max(r.abs()));
    calibration.scaling.r_linear = (1.2 * r_most).max(0.1);
    Ok(Prepared { runs, calibration, notes, lag_s })
}

/// CRC-32 of the data that made a calibration.
#[must_use]
pub fn data_hash(recordings: &[Recording]) -> u32 {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut d = crc.digest();
    for r in recordings {
        for column in r.frequency_hz.iter().chain(&r.rate_dph) {
            for v in column {
                d.update(&v.to_le_bytes());
            }
        }
    }
    d.finalize()
}

/// The regressor columns of a run for an axis, one per coefficient.
#[must_use]
pub fn baseline_columns(run: &Run, scaling: &Scaling, a: usize, two_sets: bool) -> Vec<Vec<f64>> {
    let count = if two_sets { 2 * TERMS } else { TERMS };
    let mut columns = vec![Vec::with_capacity(run.steps.len()); count];
    for k in 0..run.steps.len() {
        let row = run.state(k, a).map(|(t, r)| (regressors(scaling, t, r), heating_weight(scaling, r)));
        for (j, column) in columns.iter_mut().enumerate() {
            column.push(match (row, two_sets) {
                (None, _) => f64::NAN,
                (Some((x, _)), false) => f64::from(x[j]),
                (Some((x, w)), true) => f64::from(if j < TERMS { (1.0 - w) * x[j] } else { w * x[j - TERMS] }),
            });
        }
    }
    columns
}

/// Fits the baseline by least squares.
///
/// # Errors
/// One sentence that says what the data lack.
pub fn least_squares(recordings: &[Recording], options: &Options) -> Result<Outcome, BadInput> {
    let Prepared { runs, mut calibration, mut notes, .. } = prepare(recordings)?;
    let scaling = calibration.scaling;
    if options.two_sets && notes.iter().any(|n| n.contains("ramp in the data")) {
        return Err(BadInput::new(format!(
            "two sets were asked for, but {}; record a ramp in that direction",
            notes.iter().find(|n| n.contains("ramp in the data")).cloned().unwrap_or_default()
        )));
    }
    let mut condition = [0.0; AXES];
    for a in 0..AXES {
        let mut columns: Vec<Vec<f64>> = Vec::new();
        let mut y = Vec::new();
        for run in &runs {
            let c = baseline_columns(run, &scaling, a, options.two_sets);
            if columns.is_empty() {
                columns = c;
            } else {
                columns.iter_mut().zip(c).for_each(|(to, from)| to.extend(from));
            }
            y.extend_from_slice(&run.steps.rate_dph[a]);
        }
        let weights = options.uniform_in_temperature.then(|| uniform_weights(&runs, a));
        let names: Vec<&str> = NAMES.iter().cycle().take(columns.len()).copied().collect();
        let fit = lsq::fit(&columns, &y, weights.as_deref(), &names)
            .map_err(|e| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a])))?;
        condition[a] = fit.condition;
        let take = |from: &[f64], at: usize| -> [f32; TERMS] { std::array::from_fn(|j| from[at + j] as f32) };
        let axis = &mut calibration.axes[a];
        if options.two_sets {
            axis.coefficients =
                Coefficients::CoolingHeating(take(&fit.coefficients, 0), take(&fit.coefficients, TERMS));
            axis.coefficient_std = [take(&fit.std, 0), take(&fit.std, TERMS)];
        } else {
            axis.coefficients = Coefficients::One(take(&fit.coefficients, 0));
            axis.coefficient_std = [take(&fit.std, 0), [0.0; TERMS]];
        }
    }
    let raw: Vec<[Vec<f64>; AXES]> = runs.iter().map(|r| r.steps.rate_dph.clone()).collect();
    let corrected: Vec<[Vec<f64>; AXES]> = runs.iter().map(|r| correct(&calibration, &r.steps)).collect();
    let spread = |series: &[[Vec<f64>; AXES]], a: usize| {
        let means: Vec<f64> = series.iter().flat_map(|s| block_means(&s[a], MEAN_S)).collect();
        std_dev(&means)
    };
    let raw_dph = [0, 1, 2].map(|a| spread(&raw, a));
    let corrected_dph = [0, 1, 2].map(|a| spread(&corrected, a));
    for a in 0..AXES {
        calibration.axes[a].train_rms_dph = corrected_dph[a] as f32;
    }
    if options.uniform_in_temperature {
        notes.push("every degree weighs alike".into());
    }
    Ok(Outcome { calibration, condition, raw_dph, corrected_dph, notes })
}

fn uniform_weights(runs: &[Run], a: usize) -> Vec<f64> {
    let bins: Vec<Option<i64>> = runs
        .iter()
        .flat_map(|r| (0..r.steps.len()).map(move |k| r.state(k, a).map(|(t, _)| (t / 2.0).floor() as i64)))
        .collect();
    let mut count = std::collections::BTreeMap::<i64, f64>::new();
    for b in bins.iter().flatten() {
        *count.entry(*b).or_default() += 1.0;
    }
    bins.iter().map(|b| b.map_or(0.0, |b| 1.0 / count[&b])).collect()
}

/// Corrects a run with a calibration, by the unit's own code: corrected rate of each step.
///
/// Here the bias of a step is taken off the rate of the same step, as in the fit; the unit, which cannot wait,
/// takes it off the second that follows. At 5 C per minute and 0.1 deg/h per C that is 0.008 deg/h.
#[must_use]
pub fn correct(calibration: &Calibration, steps: &Steps) -> [Vec<f64>; AXES] {
    let offset = steps.start_s - steps.power_on_s - f64::from(hrg_core::MODEL_STEP_S);
    let mut compensator = Compensator::new(calibration.clone(), offset as f32);
    let mut out = [0, 1, 2].map(|_| Vec::with_capacity(steps.len()));
    for k in 0..steps.len() {
        let f = [0, 1, 2].map(|a: usize| Some(steps.frequency_hz[a][k]).filter(|f| f.is_finite()));
        let o = compensator.step(&f);
        for a in 0..AXES {
            out[a].push(steps.rate_dph[a][k] - f64::from(o.bias_dph[a]));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Noise, Plan, Profile};

    fn plan(profile: &str, seed: u64) -> Plan {
        Plan {
            profile: Profile::parse(profile).expect("named"),
            effects: vec![],
            unit_seed: 21,
            seed,
            noise: Noise::default(),
            sizing: None,
        }
    }

    #[test]
    fn on_an_unseen_run_the_error_is_the_noise_put_in() {
        let o = least_squares(&[plan("cycle", 1).simulate().recording], &Options::default()).expect("fits");
        let s = plan("verify", 2).simulate();
        let corrected = correct(&o.calibration, &Steps::new(&s.recording).expect("long enough"));
        for a in 0..AXES {
            let error = std_dev(&block_means(&corrected[a], MEAN_S));
            let floor = s.truth.floor_dph[a];
            assert!(error < 1.1 * floor, "axis {a}: {error} deg/h over a floor of {floor}");
        }
    }

    #[test]
    fn corrected_rates_are_not_fitted_again() {
        let mut r = plan("fast", 1).simulate().recording;
        r.meta.retain(|(k, _)| k != "rates");
        r.meta.push(("rates".into(), "corrected".into()));
        assert!(least_squares(&[r], &Options::default()).expect_err("refused").0.contains("on top of another"));
    }

    #[test]
    fn two_sets_need_both_directions() {
        let r = plan("up", 1).simulate().recording;
        let o = Options { two_sets: true, ..Options::default() };
        assert!(least_squares(std::slice::from_ref(&r), &o).expect_err("refused").0.contains("cooling"));
        let one = least_squares(&[r], &Options::default()).expect("one set fits");
        assert!(one.notes.iter().any(|n| n.contains("no cooling ramp")), "and it is said");
    }
}
