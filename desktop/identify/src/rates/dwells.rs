//! The dwells of a run on a rate table: times at one rate, behind the settling, of whole revolutions; and those of a run in positions
//! ([`crate::forces`]): times at one specific force.

use crate::fit::correct;
use hrg_core::bias::Scaling;
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{scale_regressors, SCALE_TERMS};
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::{Run, Steps};
use hrg_data::recording::turns::{END_S, SETTLE_S};
use hrg_data::recording::Recording;

/// Shortest time at one rate behind the settling, s.
const SHORTEST_S: usize = 30;

/// Two rates that differ by less than this share are one rate.
const SAME: f64 = 1e-4;

/// A time at one rate, or at one specific force: values are in deg/h, or in m/s^2.
#[derive(Debug, Clone)]
pub struct Dwell {
    /// Number of the visit of an axis that it belongs to: dwells about (or along) one axis after each other, of whatever sign. The bias and the
    /// earth's rate along the table's axis are the same in it.
    pub visit: usize,
    /// The table's rate, or the position's specific force, along the axes of the case.
    pub table: [f64; AXES],
    /// Axis that lies along it; `None`: at rest, or askew.
    pub about: Option<usize>,
    /// Seconds of the recording that it takes, settling and end apart.
    pub at: std::ops::Range<usize>,
    /// Seconds in the means.
    pub seconds: usize,
    /// Mean temperature of each axis, C.
    pub temperature_c: [f64; AXES],
    /// Mean ramp, C per minute.
    pub ramp_c_per_min: [f64; AXES],
    /// Mean raw value less the bias of the calibration.
    pub unbiased: [f64; AXES],
    /// Mean value as the calibration corrects it.
    pub corrected: [f64; AXES],
    /// Means of the regressors of the scale factor.
    pub regressors: [[f64; SCALE_TERMS]; AXES],
    /// The same, each times the value less its bias.
    pub scaled: [[f64; SCALE_TERMS]; AXES],
    /// Means of the normalised temperature of the axis times the values less their biases.
    pub by_temperature: [[f64; AXES]; AXES],
}

impl Dwell {
    /// Value along its axis; 0 at rest.
    #[must_use]
    pub fn given(&self) -> f64 {
        self.about.map_or(0.0, |a| self.table[a])
    }
}

/// Values of rows, second by second; NaN where no row stands.
pub(crate) fn by_step(values: &[&[f64]; AXES], r: &Recording, steps: &Steps) -> [Vec<f64>; AXES] {
    let mut out = [0; AXES].map(|_| vec![f64::NAN; steps.len()]);
    for (k, t) in r.time_s.iter().enumerate() {
        let at = ((t - steps.start_s).round() as usize).min(steps.len() - 1);
        for (to, from) in out.iter_mut().zip(values) {
            // (Of several rows of a second the last.)
            to[at] = from[k];
        }
    }
    out
}

/// The table's rates, second by second; NaN where no row stands.
pub(super) fn table_by_step(r: &Recording, steps: &Steps) -> Result<[Vec<f64>; AXES], BadInput> {
    let table = r.table_rate_dph().ok_or_else(|| {
        BadInput::new(format!(
            "the recording of {} does not tell the table's rate; add columns table_rate_?_dph, or a line \"# table_rate_dph: x y z\" where it was the same all along",
            r.unit()
        ))
    })?;
    Ok(by_step(&table.each_ref().map(Vec::as_slice), r, steps))
}

/// The one axis that a rate is about.
fn axis_of(table: [f64; AXES]) -> Option<usize> {
    let size = table.iter().map(|t| t * t).sum::<f64>().sqrt();
    (0..AXES).find(|a| size > 0.0 && table[*a].abs() > 0.999 * size)
}

/// Last seconds of so many that are whole revolutions at a rate; all of them at rest, none where there is not one.
fn whole_revolutions(seconds: usize, rate_dph: f64) -> usize {
    if rate_dph == 0.0 {
        return seconds;
    }
    let period_s = 360.0 * 3600.0 / rate_dph.abs();
    ((seconds as f64 / period_s + 1e-6).floor() * period_s).round() as usize
}

/// One second of what is looked at: raw values less the bias that held in it, and corrected values; NaN where there were none.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Values {
    pub unbiased: [f64; AXES],
    pub corrected: [f64; AXES],
}

/// Kind of values that a table gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Given {
    /// Rates: their dwells are whole revolutions.
    Rates,
    /// Specific forces.
    Forces,
}

/// The dwells of a run, corrected by a calibration; visits count from `first_visit`.
///
/// # Errors
/// A recording without the table's rate, of corrected rates, or without any dwell.
pub fn dwells(r: &Recording, calibration: &Calibration, first_visit: usize) -> Result<Vec<Dwell>, BadInput> {
    if r.corrected() {
        return Err(BadInput::new("the rates are corrected already; take the raw recording"));
    }
    if r.absent.iter().any(|a| *a) {
        return Err(BadInput::new("a misalignment is one of three axes; give recordings of all three"));
    }
    let steps = Steps::new(r)?;
    let table = table_by_step(r, &steps)?;
    let seconds = correct::correct(calibration, &steps);
    of_seconds(&table, &seconds, calibration, steps, first_visit, r.unit())
}

/// The same with seconds that a unit has sent, one for each second of its recording from the first on.
///
/// # Errors
/// As [`dwells`].
pub fn dwells_of_unit(
    r: &Recording,
    calibration: &Calibration,
    seconds: &[correct::Second],
    first_visit: usize,
) -> Result<Vec<Dwell>, BadInput> {
    let steps = Steps::new(r)?;
    let table = table_by_step(r, &steps)?;
    of_seconds(&table, seconds, calibration, steps, first_visit, r.unit())
}

fn of_seconds(
    table: &[Vec<f64>; AXES],
    seconds: &[correct::Second],
    calibration: &Calibration,
    steps: Steps,
    first_visit: usize,
    unit: &str,
) -> Result<Vec<Dwell>, BadInput> {
    // The bias that a unit has is that of the second before.
    let before = |k: usize| k.checked_sub(1).map(|k| seconds[k].bias_dph);
    let values: Vec<Values> = (0..seconds.len())
        .map(|k| Values {
            unbiased: [0, 1, 2].map(|a: usize| {
                before(k).map_or(f64::NAN, |bias| f64::from(seconds[k].raw_dph[a]) - f64::from(bias[a]))
            }),
            corrected: seconds[k].corrected_dph.map(f64::from),
        })
        .collect();
    let run = Run::new(steps, calibration.axes.each_ref().map(|a| a.curve));
    of_values(Given::Rates, table, &values, &run, &calibration.scaling, first_visit).ok_or_else(|| {
        BadInput::new(format!(
            "the recording of {unit} has no time of {SHORTEST_S} s at one rate of the table, in whole revolutions, {SETTLE_S} s of settling apart"
        ))
    })
}

/// The dwells of values; `None`: there is none.
pub(crate) fn of_values(
    given: Given,
    table: &[Vec<f64>; AXES],
    values: &[Values],
    run: &Run,
    scaling: &Scaling,
    first_visit: usize,
) -> Option<Vec<Dwell>> {
    let at = |k: usize| [0, 1, 2].map(|a: usize| table[a][k]);
    let size = |v: [f64; AXES]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
    let same = |a: [f64; AXES], b: [f64; AXES]| {
        let tolerance = SAME * size(a) + if given == Given::Rates { 1e-3 } else { 0.0 };
        a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance)
    };
    let mut out: Vec<Dwell> = Vec::new();
    let mut visit = first_visit;
    let mut last_axis = None;
    let n = values.len().min(table[0].len());
    // (Seconds without a row belong to what is about them.)
    let there = |k: &usize| at(*k).iter().all(|v| v.is_finite());
    let mut next = (0..n).find(there);
    while let Some(from) = next {
        let rate = at(from);
        next = (from + 1..n).filter(there).find(|k| !same(rate, at(*k)));
        let to = next.unwrap_or(n);
        let about = axis_of(rate);
        let settled = (to - from).saturating_sub(SETTLE_S + END_S);
        let used = match given {
            Given::Rates => whole_revolutions(settled, size(rate)),
            Given::Forces => settled,
        };
        // (Times between two dwells, in which the table turns or changes its rate, end no visit.)
        if used >= SHORTEST_S {
            if about != last_axis {
                visit += 1;
                last_axis = about;
            }
            out.extend(one(run, scaling, values, to - END_S - used..to - END_S, table, about, visit));
        }
    }
    Some(out).filter(|o| !o.is_empty())
}

/// The means of a dwell; `None` where two in three of its seconds have no value or temperature.
fn one(
    run: &Run,
    scaling: &Scaling,
    values: &[Values],
    at: std::ops::Range<usize>,
    table: &[Vec<f64>; AXES],
    about: Option<usize>,
    visit: usize,
) -> Option<Dwell> {
    let mut d = Dwell {
        visit,
        table: [0.0; AXES],
        about,
        at: at.clone(),
        seconds: 0,
        temperature_c: [0.0; AXES],
        ramp_c_per_min: [0.0; AXES],
        unbiased: [0.0; AXES],
        corrected: [0.0; AXES],
        regressors: [[0.0; SCALE_TERMS]; AXES],
        scaled: [[0.0; SCALE_TERMS]; AXES],
        by_temperature: [[0.0; AXES]; AXES],
    };
    let wanted = at.len();
    for k in at {
        let Values { unbiased, corrected } = values[k];
        // The temperatures that the unit has are those of the second before, too.
        let before = k.checked_sub(1)?;
        let states = [0, 1, 2].map(|a: usize| run.state(before, a));
        let [Some(x), Some(y), Some(z)] = states else { continue };
        let states = [x, y, z];
        if unbiased.iter().chain(table.iter().map(|t| &t[k])).any(|v| !v.is_finite()) {
            continue;
        }
        d.seconds += 1;
        for a in 0..AXES {
            let (t, r) = states[a];
            d.temperature_c[a] += f64::from(t);
            d.ramp_c_per_min[a] += f64::from(r);
            d.table[a] += table[a][k];
            d.unbiased[a] += unbiased[a];
            d.corrected[a] += corrected[a];
            let u = f64::from(scaling.u(t));
            let regressors = scale_regressors(scaling, t, r).map(f64::from);
            d.regressors[a].iter_mut().zip(regressors).for_each(|(to, x)| *to += x);
            d.scaled[a].iter_mut().zip(regressors).for_each(|(to, x)| *to += x * unbiased[a]);
            d.by_temperature[a].iter_mut().zip(unbiased).for_each(|(to, f)| *to += u * f);
        }
    }
    if 3 * d.seconds < wanted {
        return None;
    }
    let share = 1.0 / d.seconds as f64;
    let rows = [&mut d.scaled, &mut d.regressors].into_iter().flat_map(|r| r.as_flattened_mut());
    let means = d
        .table
        .iter_mut()
        .chain(&mut d.temperature_c)
        .chain(&mut d.ramp_c_per_min)
        .chain(&mut d.unbiased)
        .chain(&mut d.corrected);
    means.chain(d.by_temperature.as_flattened_mut()).chain(rows).for_each(|v| *v *= share);
    Some(d)
}
