//! Begin and end of every fit: recordings made ready ([`prepare`]), and a run corrected by the unit's code ([`correct()`]). Between the two
//! are a method of identification and [`crate::trace`].

pub mod autopilot;
pub mod correct;
pub mod enough_data;
pub mod independence;

use crate::thermometer::curve;
use hrg_core::bias::{regressors, Scaling, TERMS};
use hrg_core::calibration::Calibration;
use hrg_core::calibration::EffectTerm;
use hrg_core::effects::{self, MAX_OUTPUTS};
use hrg_core::inputs::{self, Input, InputTable, QuantitySet, MAX_INPUTS};
use hrg_core::temperature::TemperatureCurve;
use hrg_core::visited::Visited;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{block_means, std_dev};
use hrg_data::recording::facts;
use hrg_data::recording::names;
use hrg_data::recording::resonators::named;
use hrg_data::recording::steps::{input_table, Run, Steps};
use hrg_data::recording::Recording;
use independence::Units;

pub use hrg_data::recording::steps::MEAN_S;

/// Temperatures that span less are called narrow, C.
const NARROW_C: f32 = 20.0;

/// Names of the regressors of eq 7.
pub const NAMES: [&str; TERMS] = ["1", "T", "T^2", "dT/dt", "(dT/dt)^2", "T dT/dt"];

/// Runs made ready for a fit.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The runs through the unit's thermometer.
    pub runs: Vec<Run>,
    /// Curves, scaling and ranges; no bias yet.
    pub calibration: Calibration,
    /// Quantities beside the frequencies that the runs have, with reference and range.
    pub inputs: Vec<Input>,
    /// Remarks for the user.
    pub notes: Vec<String>,
    /// Time constant by which each resonator follows its sensor, s (0: not identified).
    pub lag_s: [f64; AXES],
    /// Fastest cooling (negative) and heating of the first axis that is there, C per minute: 0 where there is none.
    pub fastest: [f32; 2],
    /// Third of the blocks that the rates are cut into, s, where the noise that is known of the unit's family counts blocks; else by the runs' length.
    pub coarse_s: Option<usize>,
}

impl Prepared {
    /// Mean of the time constants by which the resonators follow their sensors, s.
    #[must_use]
    pub fn mean_lag_s(&self) -> f64 {
        self.lag_s.iter().sum::<f64>() / AXES as f64
    }
}

/// Prepares runs for a fit: refuses corrected ones, brings them to steps, identifies the temperature curves.
///
/// # Errors
/// One sentence.
pub fn prepare(recordings: &[Recording]) -> Result<Prepared, BadInput> {
    prepare_for(recordings, Units::Same)
}

/// As [`prepare`], perhaps of different units.
///
/// # Errors
/// One sentence.
pub fn prepare_for(recordings: &[Recording], units: Units) -> Result<Prepared, BadInput> {
    prepare_with(recordings, units, None)
}

/// As [`prepare_for`], with curves of frequency over temperature that are known already, from soaks for instance. Recordings of sensors
/// have no use for them: there they go into an image with [`fly_by`].
///
/// # Errors
/// One sentence; also where a curve is not that of the resonator in the recording.
pub fn prepare_with(
    recordings: &[Recording],
    units: Units,
    known: Option<[TemperatureCurve; AXES]>,
) -> Result<Prepared, BadInput> {
    prepare_by(recordings, units, true, |steps, first| match known {
        Some(known) if !first.thermometer.is_sensor() => curve::given(steps, known),
        _ => curve::from_steps(steps),
    })
}

/// As [`prepare_for`], with curves of a design that the unit is of, as far as its sensors and they go together.
///
/// # Errors
/// One sentence.
pub fn prepare_of_design(
    recordings: &[Recording],
    units: Units,
    designs: &[Option<curve::DesignCurve>; AXES],
) -> Result<Prepared, BadInput> {
    prepare_by(recordings, units, false, |steps, _| match curve::of_design(steps, designs)? {
        Some(identified) => Ok(identified),
        None => curve::from_steps(steps),
    })
}

/// `alone`: nothing but these runs tells of the unit, so what they leave out is noted.
fn prepare_by(
    recordings: &[Recording],
    units: Units,
    alone: bool,
    curves: impl Fn(&[Steps], &Recording) -> Result<curve::Identified, BadInput>,
) -> Result<Prepared, BadInput> {
    let mut notes = Vec::new();
    let steps = recordings.iter().map(raw_steps).collect::<Result<Vec<_>, _>>()?;
    let first = recordings.first().ok_or_else(|| BadInput::new("no recording was given"))?;
    let all: Vec<&Recording> = recordings.iter().collect();
    notes.extend(independence::same_unit(&all, units)?);
    let agreed = facts::agree(&all)?;
    if let Some(r) = recordings.iter().find(|r| r.absent != first.absent) {
        return Err(BadInput::new(format!(
            "one recording has the axes {}, another {}; give recordings of the same axes",
            named(first.absent.map(|a| !a)),
            named(r.absent.map(|a| !a))
        )));
    }
    independence::require(&all.iter().map(|r| (*r, "train")).collect::<Vec<_>>())?;
    let curve::Identified { curves, reference, lag_s } = curves(&steps, first)?;
    notes.push(about_reference(reference, first, lag_s));
    let mut calibration = Calibration::uncalibrated();
    if first.unit() != names::NONE {
        let kept = names::kept(first.unit());
        if kept != first.unit() {
            notes.push(format!("the unit's name {} does not fit: the calibration calls it {kept}", first.unit()));
        }
        calibration.set_unit_name(&kept);
    }
    calibration.calibrated = true;
    calibration.data_crc32 = data_crc32(recordings);
    let present: Vec<usize> = first.present().collect();
    for ((axis, curve), scale) in calibration.axes.iter_mut().zip(curves).zip(agreed.scale_factor) {
        axis.curve = curve;
        axis.scale_factor_dph_per_code = scale;
    }
    notes.extend(agreed.notes);
    let (low, high) = present.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &a| {
        (l.min(curves[a].valid_from_c), h.max(curves[a].valid_to_c))
    });
    if alone && high - low < NARROW_C {
        notes.push(format!(
            "the temperatures span {:.1} C: what is fitted holds there and nowhere else, and its terms are hard to tell apart; a run over tens of degrees shows more",
            high - low
        ));
    }
    calibration.scaling = scaling((low, high), 10.0);
    let mut runs: Vec<Run> = steps.into_iter().map(|s| Run::new(s, curves)).collect();
    notes.extend(enough_data::agree_on_means(&mut runs.iter_mut().collect::<Vec<_>>()));
    for (run, r) in runs.iter().zip(recordings) {
        let name = r.source_or("the run");
        enough_data::require(run, name)?;
        notes.extend(enough_data::few(run, name));
    }
    let (fastest, missing) = ramps(&mut calibration, &runs, &present);
    notes.extend(missing.into_iter().filter(|_| alone));
    let r_most = calibration
        .axes
        .iter()
        .flat_map(|a| [a.valid_from_c_per_min, a.valid_to_c_per_min])
        .fold(0.0f32, |m, r| m.max(r.abs()));
    calibration.scaling = scaling((low, high), r_most);
    visit(&mut calibration, &runs);
    let inputs = input_table(&runs);
    runs.iter_mut().for_each(|run| run.table.clone_from(&inputs));
    Ok(Prepared { runs, calibration, inputs, notes, lag_s, fastest, coarse_s: None })
}

/// Centre and scale of a model over temperatures (C) and ramps up to the fastest (C per minute). The polynomial is trusted a little beyond them and
/// continued straight from there.
#[must_use]
pub fn scaling((low_c, high_c): (f32, f32), fastest_c_per_min: f32) -> Scaling {
    Scaling {
        t_ref_c: (0.5 * (low_c + high_c)).round(),
        t_scale_c: (0.5 * (high_c - low_c)).max(5.0).round(),
        linear_below_c: low_c - 5.0,
        linear_above_c: high_c + 5.0,
        linear_beyond_c_per_min: (1.2 * fastest_c_per_min).max(0.1),
        blend_band_c_per_min: 0.1,
    }
}

/// Gives an image the inputs that its effects read, from those there are; effects of more than an image holds are taken out, and named.
pub fn take_inputs(image: &mut Calibration, table: &[Input]) -> Vec<String> {
    let mut out = Vec::new();
    loop {
        let needed = inputs::needed(image);
        let wanted = table.iter().filter(|i| needed.contains(QuantitySet::one(i.quantity)));
        let taken: Option<InputTable> =
            wanted.clone().try_fold(InputTable::new(), |mut t, i| t.push(*i).is_ok().then_some(t));
        if let Some(taken) = taken {
            image.inputs = taken;
            return out;
        }
        let reads = |t: &EffectTerm| (0..AXES).any(|a| !effects::reads(t.id, &t.parameters, a).is_empty());
        let Some(last) = image.effects.iter().rposition(reads) else { return out };
        let dropped = image.effects.remove(last);
        let name = effects::by_id(dropped.id).map_or("an effect", |f| f.name);
        out.push(format!("an image holds {MAX_INPUTS} inputs; {name} did not fit"));
    }
}

/// Writes into each input of an image what temperature and ramp tell of its effects in the train runs,
/// and what they do not: bias and uncertainty where it is missing.
pub fn state_inputs(image: &mut Calibration, runs: &[Run]) {
    let Calibration { effects, inputs, scaling, .. } = image;
    for input in inputs {
        for a in 0..AXES {
            let reads = |t: &&EffectTerm| {
                effects::reads(t.id, &t.parameters, a).contains(QuantitySet::one(input.quantity))
                    && t.gains[a].iter().any(|g| *g != 0.0)
            };
            let (mut columns, mut done) = (vec![Vec::new(); TERMS], Vec::new());
            for run in runs {
                let mut sum = vec![0.0; run.steps.len()];
                for t in effects.iter().filter(reads) {
                    let x = run.effect(t.id, &t.parameters, t.start, scaling, a);
                    let of =
                        |x: &[f32; MAX_OUTPUTS]| x.iter().zip(&t.gains[a]).map(|(x, g)| f64::from(x * g)).sum::<f64>();
                    sum.iter_mut().zip(&x).for_each(|(s, x)| *s += of(x));
                }
                let base = baseline_columns(run, scaling, a);
                for k in (0..sum.len()).step_by(EVERY).filter(|k| sum[*k].is_finite() && base[0][*k].is_finite()) {
                    columns.iter_mut().zip(&base).for_each(|(to, from)| to.push(from[k]));
                    done.push(sum[k]);
                }
            }
            let Ok(told) = lsq::fit(&columns, &done, None, &NAMES) else { continue };
            let left: Vec<f64> = (0..done.len())
                .map(|k| done[k] - columns.iter().zip(&told.coefficients).map(|(c, b)| c[k] * b).sum::<f64>())
                .collect();
            input.expected[a] = std::array::from_fn(|j| told.coefficients[j] as f32);
            input.without_dph[a] = std_dev(&left) as f32;
        }
    }
}

/// Steps between the rows by which that is learnt: effects of inputs move slowly.
const EVERY: usize = 10;

/// Puts the curves of resonators into an image that was identified on temperatures (predicted ones, as zhao2022 has them, or those of
/// sensors): the unit then has its temperatures by frequency.
///
/// # Errors
/// If the method uses the reading itself (`direct`).
pub fn fly_by(calibration: &mut Calibration, curves: [TemperatureCurve; AXES]) -> Result<(), BadInput> {
    for (axis, curve) in calibration.axes.iter_mut().zip(curves) {
        if matches!(axis.coefficients, hrg_core::bias::Coefficients::Direct(_)) {
            return Err(BadInput::new("direct is a curve of the reading itself, which is a temperature in this recording and a frequency on the unit; use another method"));
        }
        axis.curve = curve;
    }
    Ok(())
}

/// A recording on the unit's grid; one that is corrected already is refused.
fn raw_steps(r: &Recording) -> Result<Steps, BadInput> {
    if r.corrected() {
        return Err(BadInput::new(format!(
            "the recording of {} holds corrected rates; a fit on them would be applied on top of another one: use the raw recording",
            r.unit()
        )));
    }
    if r.positioned() {
        return Err(BadInput::new(format!(
            "the recording of {} was made in several positions, each with another part of the earth's rate; hrg fit --accelerometers takes its accelerometers out of it",
            r.unit()
        )));
    }
    if r.turned() {
        return Err(BadInput::new(format!(
            "the recording of {} was made on a table that turned the unit; hrg fit --rates takes its scale factors out of it",
            r.unit()
        )));
    }
    Steps::new(r)
}

/// Reference of the temperatures, in words.
fn about_reference(reference: curve::Reference, first: &Recording, lag_s: [f64; AXES]) -> String {
    match reference {
        curve::Reference::Sensor if first.thermometer.parts_axes() => {
            "temperatures are those of the sensors temp_?_c".into()
        }
        curve::Reference::Sensor => {
            "one thermometer, temp_c, serves all axes: effects of gradients between the axes are not tested".into()
        }
        curve::Reference::Narrow => "too little temperature for a frequency-temperature curve: temperatures follow the frequency by the curve of dong2023's Table 1, shifted to this run".into(),
        curve::Reference::Case => format!(
            "the resonators follow their cases with time constants of {:.0}, {:.0} and {:.0} s",
            lag_s[0], lag_s[1], lag_s[2]
        ),
        curve::Reference::Given => "temperatures are those of the curves that were given".into(),
        curve::Reference::Chamber => "no case sensor: temperatures are referred to the chamber".into(),
        curve::Reference::Implausible => "the temperature sensors do not follow the resonators as fused silica does (60 to 150 ppm per C): check them; temperatures here follow the frequency by the curve of dong2023's Table 1, shifted to this run".into(),
        curve::Reference::Shape => "no temperature sensor: temperatures follow the frequency by the curve of dong2023's Table 1, shifted to this run".into(),
    }
}

/// Seconds between the states that are marked as visited.
const VISITED_EVERY_S: usize = 30;

/// Temperatures (C) and ramps (C per minute) that a run has visited together on an axis, where it has rates.
pub fn states_of(run: &Run, a: usize) -> impl Iterator<Item = (f32, f32)> + '_ {
    let seen = move |k: &usize| run.steps.rate_dph[a][*k].is_finite();
    (0..run.steps.len()).step_by(VISITED_EVERY_S).filter(seen).filter_map(move |k| run.state(k, a))
}

/// Marks the states that the runs have visited.
fn visit(calibration: &mut Calibration, runs: &[Run]) {
    for (a, axis) in calibration.axes.iter_mut().enumerate() {
        let ranges = axis.ranges();
        let mut map = Visited::none();
        runs.iter().flat_map(|run| states_of(run, a)).for_each(|(t, r)| map.visit(&ranges, t, r));
        if map != Visited::none() {
            axis.visited = map;
        }
    }
}

/// Writes the range of ramps into each axis; gives the fastest cooling and heating of the first, and a note where there is none.
fn ramps(calibration: &mut Calibration, runs: &[Run], present: &[usize]) -> ([f32; 2], Vec<String>) {
    let (mut fastest, mut notes) = ([0.0; 2], Vec::new());
    for &a in present {
        let ranges: Vec<(f32, f32)> = runs.iter().map(|r| r.ramp_range(a)).collect();
        let cold = ranges.iter().map(|r| r.0).fold(0.0, f32::min);
        let hot = ranges.iter().map(|r| r.1).fold(0.0, f32::max);
        // A tenth beyond the ramps seen is still called inside.
        let axis = &mut calibration.axes[a];
        (axis.valid_from_c_per_min, axis.valid_to_c_per_min) = (cold * 1.1 - 0.02, hot * 1.1 + 0.02);
        if a == present[0] {
            fastest = [cold, hot];
            for (slowest, missing) in [(cold > -0.1, "cooling"), (hot < 0.1, "heating")] {
                if slowest {
                    notes.push(format!("there is no {missing} ramp in the data: what differs between heating and cooling cannot be seen"));
                }
            }
        }
    }
    (fastest, notes)
}

/// CRC-32 of the data that made a calibration.
#[must_use]
pub fn data_crc32(recordings: &[Recording]) -> u32 {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let mut d = crc.digest();
    for r in recordings {
        for column in r.present().map(|a| &r.frequency_hz[a]).chain(r.present().map(|a| &r.rate_dph[a])) {
            for v in column {
                d.update(&v.to_le_bytes());
            }
        }
    }
    d.finalize()
}

/// The regressor columns of the baseline for an axis over a run, one per coefficient.
#[must_use]
pub fn baseline_columns(run: &Run, scaling: &Scaling, a: usize) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::new(); TERMS];
    for k in 0..run.steps.len() {
        let row = run.state(k, a).map(|(t, r)| regressors(scaling, t, r));
        for (j, column) in columns.iter_mut().enumerate() {
            column.push(row.map_or(f64::NAN, |x| f64::from(x[j])));
        }
    }
    columns
}

/// Corrects a run with a calibration as the unit does: corrected rate of each step, under the bias that held in it
/// ([`mod@crate::fit::correct`]). NaN in the first, which had none yet.
#[must_use]
pub fn correct(calibration: &Calibration, steps: &Steps) -> [Vec<f64>; AXES] {
    let seconds = correct::correct(calibration, steps);
    [0, 1, 2].map(|a: usize| {
        seconds.iter().enumerate().map(|(k, s)| if k == 0 { f64::NAN } else { f64::from(s.corrected_dph[a]) }).collect()
    })
}

/// Standard deviation of the means over `mean_s` seconds of several runs together, per axis, deg/h.
#[must_use]
pub fn spread<'a>(rates_dph: impl IntoIterator<Item = &'a [Vec<f64>; AXES]>, mean_s: usize) -> [f64; AXES] {
    let mut means: [Vec<f64>; AXES] = Default::default();
    for rates in rates_dph {
        means.iter_mut().zip(rates).for_each(|(m, r)| m.extend(block_means(r, mean_s)));
    }
    means.map(|m| std_dev(&m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_simulate::{Plan, Profile};

    fn run(profile: &str, seed: u64) -> Recording {
        Plan::of(Profile::parse(profile).expect("named"), 21, seed).simulate().recording
    }

    #[test]
    fn corrected_rates_are_not_fitted_again() {
        let mut r = run("fast", 1);
        r.meta.retain(|(k, _)| k != "rates");
        r.meta.push(("rates".into(), "corrected".into()));
        assert!(prepare(&[r]).expect_err("refused").0.contains("on top of another"));
    }

    #[test]
    fn a_missing_direction_is_reported() {
        let p = prepare(&[run("up", 1)]).expect("prepares");
        assert!(p.notes.iter().any(|n| n.contains("no cooling ramp")), "{:?}", p.notes);
    }
}
