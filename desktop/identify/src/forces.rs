//! Bias, scale factor and misalignment of three accelerometers over temperature, from runs in positions in a chamber.
//!
//! # How
//! The unit is held in positions, each axis up and down in turn, whose specific force along the axes of the case is known (`table_force_?_mps2`): a
//! six-position test, or a tumble. A [`Dwell`] is a time in one position. The model is that of [`hrg_core::specific_force`], and linear in what is
//! sought:
//!
//! `table_i - raw_i + bias_i = 1e-6 (sum_k c_k x_k (raw_i - bias_i) + sum_j (m0_ij + m1_ij u) S_j (raw_j - bias_j))`, `bias_i = sum_k b_k x_k`
//!
//! Each dwell up has the next one down of its axis beside it, whatever lies between: a visit. Up less down of a visit
//! is free of the bias: it gives the scale factor of its axis and the share in each other axis, as plus less minus rates do
//! ([`crate::rates`], whose curves these are). The middle of up and down is free of both: each visit, along whatever axis, gives a value of the bias of
//! each accelerometer, and a [`Curve`] goes through them. Where both are known better, each is found anew; after a few passes nothing changes.
//!
//! # Limits
//! The unit has no term for the square of the specific force (IEEE Std 1293's K2): a third of it is in the bias, the mean over positions along all axes.

use crate::fit::correct;
use crate::fit::independence::{same_unit, Units};
use crate::rates::{
    by_step, coupled, fit_axes, of_values, plus_and_minus, rate_axis, terms_in_use, times_scale, visits, AxisFit,
    Curve, Dwell, Given, Point, Values,
};
use hrg_core::accelerometers::STANDARD_GRAVITY_MPS2;
use hrg_core::bias::Scaling;
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{scale_regressors, RateAxis, SCALE_TERMS, STATED_AT};
use hrg_core::specific_force::{Accelerometer, AccelerometerBias, SpecificForce};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{mean, median};
use hrg_data::recording::metadata::{CALIBRATION, FORCES};
use hrg_data::recording::steps::{Run, Steps};
use hrg_data::recording::Recording;

/// Millionths of one g in one m/s^2.
pub const UG_OF_MPS2: f64 = 1e6 / STANDARD_GRAVITY_MPS2;

/// The fit goes on until a pass changes no corrected specific force by so much, m/s^2: far below the noise of a position.
const SETTLED_MPS2: f64 = 1e-7;

/// Passes at most: each leaves a share of the size of the errors, some hundredths at the most.
const PASSES: usize = 30;

/// Image of a unit that has none.
const NO_IMAGE: &str = "00000000";

/// Seconds that are so many times further from the middle of their position than usual are knocks. (A ramp within the position is in what is usual.)
const KNOCK: f64 = 12.0;

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
        bias_at(&self.biases[a], &self.calibration.scaling, temperature_c)
    }
}

fn bias_at(curve: &Curve, scaling: &Scaling, temperature_c: f64) -> (f64, f64) {
    let x = scale_regressors(scaling, temperature_c as f32, 0.0);
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

/// A recording that cannot be used.
fn lacking(r: &Recording) -> BadInput {
    BadInput::new(format!(
        "the recording of {} lacks force_?_mps2 (hrg record writes them where the unit sends increments: hrg unit output --increments 50) or table_force_?_mps2 (the specific force of each position along the axes of the case, upwards, m/s^2)",
        r.unit()
    ))
}

/// A run in positions, read: the same under every calibration that a fit tries.
struct Positions {
    unit: String,
    run: Run,
    table: [Vec<f64>; AXES],
    /// Specific forces as the accelerometers gave them, m/s^2, second by second.
    raw: Vec<[f64; AXES]>,
}

impl Positions {
    /// `recorded_by`: the image that the unit had.
    fn read(r: &Recording, recorded_by: &Calibration) -> Result<Self, BadInput> {
        let [forces, table] = r.forces_mps2().ok_or_else(|| lacking(r))?;
        let corrected = match r.meta(CALIBRATION) {
            None | Some(NO_IMAGE) => false,
            Some(_) if r.meta(FORCES) == Some("raw") => false,
            Some(sum) if sum == format!("{:08x}", recorded_by.checksum()) => recorded_by.specific_force.is_some(),
            Some(sum) => {
                return Err(BadInput::new(format!(
                    "the unit had the image {sum}, which may have corrected these specific forces, and --calibration is {:08x}: give that image; or, where it has no accelerometers, put the line \"# forces: raw\" into the recording",
                    recorded_by.checksum()
                )))
            }
        };
        let steps = Steps::new(r)?;
        let (mut forces, table) = (by_step(&forces, r, &steps), by_step(&table, r, &steps));
        without_knocks(&mut forces, &table);
        let had = corrected.then(|| correct::specific_forces(recorded_by, &steps));
        let given = |k: usize| [0, 1, 2].map(|a: usize| forces[a][k]);
        let raw = (0..steps.len()).map(|k| had.as_ref().map_or(given(k), |had| undone(given(k), &had[k]))).collect();
        Ok(Self { unit: r.unit().into(), run: run_of(steps, recorded_by), table, raw })
    }

    /// Its dwells: raw values less the biases of a calibration, and corrected by it.
    fn dwells(&self, calibration: &Calibration, first_visit: usize) -> Result<Vec<Dwell>, BadInput> {
        let errors = correct::specific_forces(calibration, &self.run.steps);
        let value = |(raw, by): (&[f64; AXES], &SpecificForce)| Values {
            unbiased: [0, 1, 2].map(|a: usize| raw[a] - f64::from(by.bias_mps2[a])),
            corrected: by.factors.corrected_dph(raw.map(|f| f as f32), by.bias_mps2).map(f64::from),
        };
        let values: Vec<Values> = self.raw.iter().zip(&errors).map(value).collect();
        let found = of_values(Given::Forces, &self.table, &values, &self.run, &calibration.scaling, first_visit);
        let found = found.ok_or_else(|| {
            BadInput::new(format!(
                "the recording of {} has no time of 30 s in one position, 20 s of settling apart",
                self.unit
            ))
        })?;
        Ok(paired(found, first_visit))
    }

    /// The dwells of several.
    fn all_dwells(all: &[Self], calibration: &Calibration) -> Result<Vec<Dwell>, BadInput> {
        let mut out: Vec<Dwell> = Vec::new();
        for one in all {
            let next = out.last().map_or(0, |d| d.visit);
            out.extend(one.dwells(calibration, next)?);
        }
        Ok(out)
    }
}

/// The temperatures of a run by the curves of a calibration.
fn run_of(steps: Steps, calibration: &Calibration) -> Run {
    Run::new(steps, calibration.axes.each_ref().map(|a| a.curve))
}

/// The dwells of several recordings of one unit, corrected by a calibration. `recorded_by`: the image that the unit had, with the same thermometers.
///
/// # Errors
/// A recording without specific forces and positions, made under another image, or without any dwell.
pub fn all_dwells(
    recordings: &[Recording],
    recorded_by: &Calibration,
    calibration: &Calibration,
) -> Result<Vec<Dwell>, BadInput> {
    Positions::all_dwells(&read(recordings, recorded_by)?, calibration)
}

fn read(recordings: &[Recording], recorded_by: &Calibration) -> Result<Vec<Positions>, BadInput> {
    recordings.iter().map(|r| Positions::read(r, recorded_by)).collect()
}

/// Takes out seconds that are far from the others of their position: knocks.
fn without_knocks(forces: &mut [Vec<f64>; AXES], table: &[Vec<f64>; AXES]) {
    let n = table[0].len();
    let at = |k: usize| [0, 1, 2].map(|a: usize| table[a][k]);
    let mut from = 0;
    while from < n {
        let to = (from + 1..n).find(|k| at(*k) != at(from)).unwrap_or(n);
        for values in forces.iter_mut().map(|f| &mut f[from..to]) {
            let Some(middle) = median(&mut values.iter().copied().filter(|v| v.is_finite()).collect::<Vec<_>>()) else {
                continue;
            };
            let mut off: Vec<f64> = values.iter().map(|v| (v - middle).abs()).filter(|v| v.is_finite()).collect();
            let usual = median(&mut off).unwrap_or(0.0);
            values.iter_mut().filter(|v| (**v - middle).abs() > KNOCK * usual).for_each(|v| *v = f64::NAN);
        }
        from = to;
    }
}

/// Dwells by visits: of each axis one up and the next down, or the other way round.
fn paired(dwells: Vec<Dwell>, first_visit: usize) -> Vec<Dwell> {
    let mut waiting: [Option<Dwell>; AXES] = [const { None }; AXES];
    let mut out: Vec<Dwell> = Vec::new();
    let mut visit = first_visit;
    for d in dwells {
        let Some(axis) = d.about else { continue };
        match waiting[axis].take() {
            Some(before) if before.given() * d.given() < 0.0 => {
                visit += 1;
                out.extend([before, d].map(|d| Dwell { visit, ..d }));
            }
            // (The same again: the newer is nearer to what comes.)
            _ => waiting[axis] = Some(d),
        }
    }
    out
}

/// The dwells of specific forces that a unit has sent, one for each second of its recording from the first on (NaN where none came), in its positions.
///
/// # Errors
/// As [`all_dwells`].
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
    let run = run_of(steps, calibration);
    let found = of_values(Given::Forces, &table, &values, &run, &calibration.scaling, first_visit);
    let found = found.ok_or_else(|| BadInput::new("the unit has sent no specific force for 30 s in one position"))?;
    Ok(paired(found, first_visit))
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
    let mut found = calibration.clone();
    let runs = read(recordings, calibration)?;
    let plain = Calibration { specific_force: None, ..calibration.clone() };
    let mut dwells = Positions::all_dwells(&runs, &plain)?;
    (0..AXES).try_for_each(|a| sound(&dwells, a))?;
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
        found.specific_force = Some([0, 1, 2].map(|a: usize| {
            let errors = rate_axis(&factors[a], &dwells, a, &calibration.scaling);
            Accelerometer { bias: stated(&biases[a], &errors, &calibration.scaling), errors }
        }));
        last = Some((factors, biases));
        let before = std::mem::replace(&mut dwells, Positions::all_dwells(&runs, &found)?);
        let change = |(d, b): (&Dwell, &Dwell)| {
            d.corrected.iter().zip(b.corrected).map(|(d, b)| (d - b).abs()).fold(0.0, f64::max)
        };
        if dwells.iter().zip(&before).map(change).fold(0.0, f64::max) < SETTLED_MPS2 {
            break;
        }
    }
    let Some((factors, biases)) = last else { return Err(BadInput::new("no pass of the fit")) };
    left_out.extend(factors.iter().flat_map(|f| f.left_out.clone()));
    if !left_out.is_empty() {
        notes.push(format!("not told apart by these runs, and left out: {}", left_out.join(", ")));
    }
    found.check().map_err(hrg_data::image_file::FileError::Unusable)?;
    Ok(Found { calibration: found, factors, biases, dwells, notes })
}

/// Tests that an axis was held up and down, and gives about what the positions say.
fn sound(dwells: &[Dwell], a: usize) -> Result<(), BadInput> {
    let own = visits(dwells).filter(|v| v[0].about == Some(a));
    let shares: Vec<f64> = own
        .filter_map(|v| plus_and_minus(v, &|d| vec![d.unbiased[a], d.table[a]]))
        .map(|(up, down, _)| (up[0] - down[0]) / (up[1] - down[1]))
        .collect();
    let axis = AXIS_NAMES[a];
    if shares.is_empty() {
        return Err(BadInput::new(format!(
            "axis {axis} was not held both up and down for 30 s at least (20 s of settling apart): bias and scale factor need both"
        )));
    }
    let share = mean(&shares);
    if (0.9..1.1).contains(&share) {
        return Ok(());
    }
    Err(BadInput::new(format!(
        "accelerometer {axis} gives {share:.3} of the specific force of its positions: at rest the axis that points up reads +9.81 m/s^2 in force_{axis}_mps2 and table_force_{axis}_mps2; look at the sign, the order of the axes and the unit"
    )))
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
fn stated(curve: &Curve, errors: &RateAxis, scaling: &Scaling) -> AccelerometerBias {
    let (low, high) = (f64::from(errors.rate_valid_from_c), f64::from(errors.rate_valid_to_c));
    let at = |k: usize| low + k as f64 / (STATED_AT - 1) as f64 * (high - low);
    AccelerometerBias {
        bias_mps2: std::array::from_fn(|t| curve.coefficients[t] as f32),
        bias_std_mps2: std::array::from_fn(|k| bias_at(curve, scaling, at(k)).1 as f32),
    }
}
