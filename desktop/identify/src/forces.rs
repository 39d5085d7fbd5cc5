//! Bias, scale factor and misalignment of three accelerometers over temperature, from runs in positions in a chamber.
//!
//! # How
//! The unit is held in positions, each axis up and down in turn, whose specific force along the axes of the case is known (`table_force_?_mps2`): a
//! six-position test, or a tumble. A [`Dwell`] is a time in one position. The model is that of [`hrg_core::specific_force`], and linear in what is
//! sought:
//!
//! `table_i - raw_i + bias_i = 1e-6 (sum_k c_k x_k (raw_i - bias_i) + sum_j (m0_ij + m1_ij u) S_j (raw_j - bias_j))`, `bias_i = sum_k b_k x_k`
//!
//! Up less down of a visit is free of the bias: it gives the scale factor of its axis and the share in each other axis, as plus less minus rates do
//! ([`crate::rates`], whose curves these are). The middle of up and down is free of both: each visit, along whatever axis, gives a value of the bias of
//! each accelerometer, and a [`Curve`] goes through them. Where both are known better, each is found anew; after a few passes nothing changes.
//!
//! # Limits
//! The squares of the specific force (IEEE Std 1293's K2) are not told from the bias by positions of one g, and are part of it.

use crate::fit::correct;
use crate::fit::independence::{same_unit, Units};
use crate::rates::{
    by_step, coupled, fit_axes, of_values, plus_and_minus, rate_axis, terms_in_use, times_scale, visits, AxisFit,
    Curve, Dwell, Given, Point, Values,
};
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{scale_regressors, RateAxis, SCALE_TERMS, STATED_AT};
use hrg_core::specific_force::{Accelerometer, AccelerometerBias, SpecificForce};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::mean;
use hrg_data::recording::columns::{FORCE, TABLE_FORCE};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;

/// Millionths of one g in one m/s^2.
pub const UG_OF_MPS2: f64 = 1e6 / 9.806_65;

/// Passes of the fit: biases are some 1e-3 of the specific force, and scale factors change by 1e-3, so each pass leaves a thousandth.
const PASSES: usize = 4;

/// Cosine of the angle to the vertical within which an axis is taken for upright.
const UPRIGHT: f64 = 0.985;

/// Terms of the bias, in words.
const BIAS_TERMS: [&str; SCALE_TERMS] = ["constant", "T", "T^2", "T^3", "ramp", "T times the ramp"];

/// Chamber profile for the positions: that of the rate table.
pub use crate::rates::CHAMBER;

/// Result for a unit.
#[derive(Debug, Clone)]
pub struct Found {
    /// The calibration with its accelerometers over temperature.
    pub calibration: Calibration,
    /// Scale factor and misalignments of each.
    pub factors: [AxisFit; AXES],
    /// Bias of each, m/s^2.
    pub biases: [Curve; AXES],
    /// The dwells of all runs, corrected by the calibration that was found.
    pub dwells: Vec<Dwell>,
    /// Remarks for the reader.
    pub notes: Vec<String>,
}

impl Found {
    /// Bias of an accelerometer on a soak at a temperature, m/s^2, and its standard deviation: noise, and what the curve does not follow.
    #[must_use]
    pub fn bias_at(&self, a: usize, temperature_c: f64) -> (f64, f64) {
        bias_at(&self.biases[a], &self.calibration, temperature_c)
    }
}

fn bias_at(curve: &Curve, calibration: &Calibration, temperature_c: f64) -> (f64, f64) {
    let x = scale_regressors(&calibration.scaling, temperature_c as f32, 0.0);
    curve.along(&x.map(f64::from), (temperature_c, 0.0))
}

/// Specific force that the accelerometers gave, m/s^2, for one that the errors corrected.
fn undone(corrected: [f64; AXES], by: &SpecificForce) -> [f64; AXES] {
    let scale = by.factors.scale().map(f64::from);
    let coupling = by.factors.coupling().map(|c| c.map(f64::from));
    // M is one and some 1e-4 beside the diagonal: each turn of the iteration leaves a thousandth of the error.
    let mut scaled = corrected;
    for _ in 0..8 {
        let last = scaled;
        for (a, to) in scaled.iter_mut().enumerate() {
            let [j, k] = hrg_core::rate_factors::OTHERS[a];
            *to = corrected[a] - coupling[a][0] * last[j] - coupling[a][1] * last[k];
        }
    }
    [0, 1, 2].map(|a: usize| scaled[a] / scale[a] + f64::from(by.bias_mps2[a]))
}

/// Finds the positions of a recording that does not tell them: seconds in which an axis is within 10 degrees of the vertical are taken for that axis straight
/// up or down, at this gravity. What the unit was off level then is in the misalignments.
///
/// # Errors
/// A gravity of no place on Earth; a recording without specific forces.
pub fn recognise_positions(r: &mut Recording, gravity_mps2: f64) -> Result<(), BadInput> {
    if !(9.7..9.9).contains(&gravity_mps2) {
        return Err(BadInput::new(format!("gravity {gravity_mps2} is that of no place: give 9.76 to 9.84 m/s^2")));
    }
    let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(|a| r.column(FORCE.name(a))) else { return Err(lacking(r)) };
    let table: Vec<[f64; AXES]> = x
        .iter()
        .zip(y)
        .zip(z)
        .map(|((x, y), z)| {
            let force = [*x, *y, *z];
            let size = force.iter().map(|f| f * f).sum::<f64>().sqrt();
            let up = (0..AXES).find(|a| force[*a].abs() > UPRIGHT * size);
            up.map_or([f64::NAN; AXES], |up| {
                [0, 1, 2].map(|a| if a == up { gravity_mps2 * force[a].signum() } else { 0.0 })
            })
        })
        .collect();
    r.optional.retain(|(name, _)| !TABLE_FORCE.names.contains(name));
    r.optional.extend((0..AXES).map(|a| (TABLE_FORCE.name(a), table.iter().map(|t| t[a]).collect())));
    Ok(())
}

fn lacking(r: &Recording) -> BadInput {
    BadInput::new(format!(
        "the recording of {} lacks force_?_mps2 (hrg record writes them where the unit sends increments: hrg unit output --increments 50) or table_force_?_mps2 (the specific force of each position along the axes of the case, upwards, m/s^2; or give --gravity, and positions are recognised)",
        r.unit()
    ))
}

/// The dwells of a run: raw values less the biases of `calibration`, and corrected by it. `recorded_by`: the image that the unit had.
///
/// # Errors
/// A recording without specific forces and positions, made under another image, or without any dwell.
pub fn dwells(
    r: &Recording,
    recorded_by: &Calibration,
    calibration: &Calibration,
    first_visit: usize,
) -> Result<Vec<Dwell>, BadInput> {
    let [forces, table] = r.forces_mps2().ok_or_else(|| lacking(r))?;
    let corrected = match r.meta("calibration") {
        None => false,
        Some(sum) if sum == format!("{:08x}", recorded_by.checksum()) => recorded_by.specific_force.is_some(),
        Some(sum) => {
            return Err(BadInput::new(format!(
                "the specific forces of this recording are corrected by the image {sum}, and --calibration is {:08x}: give the image that the unit had",
                recorded_by.checksum()
            )))
        }
    };
    let steps = Steps::new(r)?;
    let (forces, table) = (by_step(&forces, r, &steps), by_step(&table, r, &steps));
    let had = corrected.then(|| correct::specific_forces(recorded_by, &steps));
    let errors = correct::specific_forces(calibration, &steps);
    let values: Vec<Values> = (0..steps.len())
        .map(|k| {
            let given = [0, 1, 2].map(|a: usize| forces[a][k]);
            let raw = had.as_ref().map_or(given, |had| undone(given, &had[k]));
            let bias = errors[k].bias_mps2;
            Values {
                unbiased: [0, 1, 2].map(|a: usize| raw[a] - f64::from(bias[a])),
                corrected: errors[k].factors.corrected_dph(raw.map(|f| f as f32), bias).map(f64::from),
            }
        })
        .collect();
    of_values(Given::Forces, &table, &values, calibration, steps, first_visit)?.ok_or_else(|| {
        BadInput::new(format!(
            "the recording of {} has no time of 30 s in one position, 20 s of settling apart",
            r.unit()
        ))
    })
}

/// The dwells of specific forces that a unit has sent, one for each second of its recording from the first on (NaN where none came), in its positions.
///
/// # Errors
/// As [`dwells`].
pub fn dwells_of_unit(
    r: &Recording,
    calibration: &Calibration,
    sent_mps2: &[[f64; AXES]],
    first_visit: usize,
) -> Result<Vec<Dwell>, BadInput> {
    let [_, table] = r.forces_mps2().ok_or_else(|| BadInput::new("the recording has no positions"))?;
    let steps = Steps::new(r)?;
    let table = by_step(&table, r, &steps);
    let values: Vec<Values> = sent_mps2.iter().map(|f| Values { unbiased: *f, corrected: *f }).collect();
    let found = of_values(Given::Forces, &table, &values, calibration, steps, first_visit)?;
    found.ok_or_else(|| BadInput::new("the unit has sent no specific force for 30 s in one position"))
}

/// The dwells of several recordings of one unit, under a calibration.
///
/// # Errors
/// As [`dwells`].
pub fn all_dwells(
    recordings: &[Recording],
    recorded_by: &Calibration,
    calibration: &Calibration,
) -> Result<Vec<Dwell>, BadInput> {
    let mut out: Vec<Dwell> = Vec::new();
    for r in recordings {
        let next = out.last().map_or(0, |d| d.visit);
        out.extend(dwells(r, recorded_by, calibration, next)?);
    }
    Ok(out)
}

/// Identifies the accelerometers. `calibration`: the unit's own, which turns frequencies into temperatures.
///
/// # Errors
/// Recordings of another unit, without specific forces and positions, or in which an axis was not held both up and down.
pub fn identify(recordings: &[Recording], calibration: &Calibration) -> Result<Found, BadInput> {
    let all: Vec<&Recording> = recordings.iter().collect();
    let mut notes: Vec<String> = same_unit(&all, Units::Same)?.into_iter().collect();
    for r in recordings {
        notes.extend(hrg_data::recording::facts::fits(calibration, r, false)?);
    }
    let mut found = Calibration { specific_force: Some([Accelerometer::default(); AXES]), ..calibration.clone() };
    let dwells_by = |found: &Calibration| all_dwells(recordings, calibration, found);
    let plain = Calibration { specific_force: None, ..calibration.clone() };
    let mut dwells = dwells_by(&plain)?;
    for a in 0..AXES {
        if [1.0, -1.0].iter().any(|s| !dwells.iter().any(|d| d.about == Some(a) && s * d.given() > 0.0)) {
            return Err(BadInput::new(format!(
                "axis {} was not held both up and down for 30 s at least (20 s of settling apart): bias and scale factor need both",
                AXIS_NAMES[a]
            )));
        }
    }
    let mut last: Option<([AxisFit; AXES], [Curve; AXES])> = None;
    let mut left_out = Vec::new();
    for _ in 0..PASSES {
        let mut factors = fit_axes(&dwells, last.as_ref().map(|l| &l.0))?;
        // (The factors hold each other's shares.)
        factors = fit_axes(&dwells, Some(&factors))?;
        left_out.clear();
        let [x, y, z] = [0, 1, 2].map(|a| {
            let (curve, lacking) = bias(&dwells, a, &factors, last.as_ref().map(|l| &l.1[a]))?;
            left_out.extend(lacking);
            Ok::<_, BadInput>(curve)
        });
        let biases = [x?, y?, z?];
        let scaled = found.clone();
        found.specific_force = Some([0, 1, 2].map(|a: usize| {
            let errors = rate_axis(&factors[a], &dwells, a, &scaled.scaling);
            Accelerometer { bias: stated(&biases[a], &errors, &scaled), errors }
        }));
        last = Some((factors, biases));
        dwells = dwells_by(&found)?;
    }
    let Some((factors, biases)) = last else { return Err(BadInput::new("no pass of the fit")) };
    left_out.extend(factors.iter().flat_map(|f| f.left_out.clone()));
    if !left_out.is_empty() {
        notes.push(format!("not told apart by these runs, and left out: {}", left_out.join(", ")));
    }
    found.check().map_err(hrg_data::image_file::FileError::Unusable)?;
    Ok(Found { calibration: found, factors, biases, dwells, notes })
}

/// The curve of a bias, and the terms that the runs do not tell apart. `last`: that of the pass before, which is off the dwells.
fn bias(
    dwells: &[Dwell],
    a: usize,
    factors: &[AxisFit; AXES],
    last: Option<&Curve>,
) -> Result<(Curve, Vec<String>), BadInput> {
    let points: Vec<Point> = visits(dwells)
        .filter_map(|visit| {
            // Of what the accelerometer lacks beside its factors; by its scale factor, as the bias is taken off the raw value.
            let (up, down, seconds) = plus_and_minus(visit, &|d| {
                let scaled = times_scale(d, a, Some(factors));
                let by = if d.unbiased[a] == 0.0 { 1.0 } else { scaled / d.unbiased[a] };
                let shares = coupled(d, a, 0, Some(factors)) + coupled(d, a, 1, Some(factors));
                let mut values = vec![(scaled + shares - d.table[a]) / by];
                values.extend(d.regressors[a]);
                values
            })?;
            let middle: Vec<f64> = up.iter().zip(&down).map(|(u, d)| 0.5 * (u + d)).collect();
            let (value, x) = middle.split_first()?;
            let before: f64 = last.map_or(0.0, |l| l.coefficients.iter().zip(x).map(|(c, x)| c * x).sum());
            let of = |f: &dyn Fn(&Dwell) -> f64| mean(&visit.iter().map(f).collect::<Vec<_>>());
            Some(Point {
                x: x.to_vec(),
                at: (of(&|d| d.temperature_c[a]), of(&|d| d.ramp_c_per_min[a])),
                value: value + before,
                // Half of the sum of two means.
                weight: 4.0 * seconds / 100.0,
            })
        })
        .collect();
    let columns: Vec<Vec<f64>> =
        (0..SCALE_TERMS).map(|t| points.iter().map(|p| p.x[t] * p.weight.sqrt()).collect()).collect();
    let in_use = terms_in_use(dwells, a, &columns);
    let curve = Curve::fit(&points, SCALE_TERMS, &in_use).ok_or_else(|| {
        BadInput::new(format!(
            "{} visits of up and down are too few for {} coefficients of the bias of accelerometer {}; go round the positions more often",
            points.len(),
            in_use.len(),
            AXIS_NAMES[a]
        ))
    })?;
    let lacking = (0..SCALE_TERMS).filter(|t| !in_use.contains(t));
    Ok((curve, lacking.map(|t| format!("bias of {} with {}", AXIS_NAMES[a], BIAS_TERMS[t])).collect()))
}

/// A bias as the image states it, over the range of the other errors.
fn stated(curve: &Curve, errors: &RateAxis, calibration: &Calibration) -> AccelerometerBias {
    let (low, high) = (f64::from(errors.rate_valid_from_c), f64::from(errors.rate_valid_to_c));
    let at = |k: usize| low + k as f64 / (STATED_AT - 1) as f64 * (high - low);
    AccelerometerBias {
        bias_mps2: std::array::from_fn(|t| curve.coefficients[t] as f32),
        bias_std_mps2: std::array::from_fn(|k| bias_at(curve, calibration, at(k)).1 as f32),
    }
}
