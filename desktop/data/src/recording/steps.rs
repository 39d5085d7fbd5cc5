//! A recording as the unit would have seen it: on the grid of model steps, through the unit's own code.

use crate::error::BadInput;
use crate::recording::columns;
use crate::recording::own_columns::OwnColumns;
use crate::recording::Recording;
use hrg_core::bias::{Scaling, State};
use hrg_core::effects::{Inputs, Running, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::inputs::{self, Input, Quantities, QuantitySet, LEAST_COUNTS_S, QUANTITIES};
use hrg_core::temperature::TemperatureCurve;
use hrg_core::thermal::{Thermal, Thermometer};
use hrg_core::{AXES, MODEL_STEP_S};
use std::sync::Arc;

/// A recording brought to one row per model step (one second).
///
/// Faster rows are averaged within their second. Slower rows: frequencies are interpolated between rows no
/// further than [`BRIDGE_S`] apart, so that the states of the model run on; a rate stands for the time about its row.
#[derive(Debug, Clone)]
pub struct Steps {
    /// Time of the first step on the recording's clock, s.
    pub start_s: f64,
    /// Time of power-on on the same clock, s.
    pub power_on_s: f64,
    /// Steps before the first that is judged.
    pub run_in: usize,
    /// Seconds of a mean in figures: the field's 100, or less where runs that are used together are short.
    pub mean_s: usize,
    /// Source of the temperatures.
    pub thermometer: crate::recording::thermometer::Thermometer,
    /// Set if the axes have rates in turns (recordings of the errors of a scale factor): each a quarter of the time at most.
    pub in_turns: bool,
    /// Axes that the recording does not have.
    pub absent: [bool; AXES],
    /// Readings of the thermometers: frequencies, Hz, or temperatures, C; NaN where missing.
    pub frequency_hz: [Vec<f64>; AXES],
    /// Rates, deg/h; NaN where missing.
    pub rate_dph: [Vec<f64>; AXES],
    /// Case sensors; empty where not recorded.
    pub case_c: [Vec<f32>; AXES],
    /// Chamber; empty where not recorded.
    pub chamber_c: Vec<f32>,
    /// Quantities beside the frequencies by number ([`hrg_core::inputs`]); empty where not recorded. Gaps are bridged, as a search wants it.
    pub quantities: [Vec<f32>; QUANTITIES],
    /// The same as they came: NaN in a second whose row does not hold them.
    pub given: [Vec<f32>; QUANTITIES],
    /// Those of them that the unit itself has, too.
    pub unit_inputs: QuantitySet,
}

/// Model steps below which a recording says nothing: three minutes.
pub const SHORTEST: usize = 180;
/// Seconds of a mean: the field's figure is three sigma of 100 s means.
pub const MEAN_S: usize = 100;

/// Longest gap that is bridged by a straight line, s. The unit kept running during a gap in its recording: its lags and
/// plays went on, and a straight line is nearer to what they saw than a temperature that stands still. (Rates are not
/// bridged.) Longer than that, the temperature is held, as the unit does when a frequency is lost.
pub const BRIDGE_S: f64 = 900.0;

impl Steps {
    /// Brings a cleaned recording to model steps.
    ///
    /// # Errors
    /// If it is too short for any statement (less than three minutes), or its rows are so far apart that nobody knows the temperature between them.
    pub fn new(r: &Recording) -> Result<Self, BadInput> {
        let name = r.source_or("the recording");
        if r.step_s() > BRIDGE_S {
            return Err(BadInput::new(format!(
                "{name}: the rows are {:.0} s apart by column time_s, and the temperature is followed over gaps of {BRIDGE_S} s at the most; if the times are not in seconds, state their unit in a map (hrg import --map)",
                r.step_s()
            )));
        }
        let mut steps = Self::on_grid(r)?.0;
        // Behind a gap that is not bridged the temperature leaps, and so does its rate of change: the unit saw no such thing.
        steps.leave_out_behind_gaps(BRIDGE_S as usize);
        if steps.len() < SHORTEST {
            return Err(BadInput::new(format!(
                "{name} lasts {} s; a fit needs three minutes at the least, and soaks and ramps of hours",
                steps.len() - 1
            )));
        }
        Ok(steps)
    }

    /// Brings a recording to model steps as the unit saw it: a row without a frequency is a second in which the unit had none.
    /// Only the seconds of no row are bridged, for the unit ran on in them. Gives which seconds have a row, too.
    ///
    /// # Errors
    /// If it has no rows, or spans years.
    pub fn as_seen(r: &Recording) -> Result<(Self, Vec<bool>), BadInput> {
        let (mut steps, index) = Self::on_grid(r)?;
        let mut there = vec![false; steps.len()];
        index.iter().for_each(|k| there[*k] = true);
        for (to, from) in steps.frequency_hz.iter_mut().zip(&r.frequency_hz) {
            let mut lost = there.clone();
            index.iter().zip(from).filter(|(_, f)| f.is_finite()).for_each(|(k, _)| lost[*k] = false);
            to.iter_mut().zip(lost).filter(|(_, lost)| *lost).for_each(|(f, _)| *f = f64::NAN);
        }
        Ok((steps, there))
    }

    /// The steps, and the step of each row.
    fn on_grid(r: &Recording) -> Result<(Self, Vec<usize>), BadInput> {
        let (first, last) = match (r.time_s.first(), r.time_s.last()) {
            (Some(a), Some(b)) => (*a, *b),
            _ => return Err(BadInput::new("the recording has no rows")),
        };
        let step = f64::from(MODEL_STEP_S);
        let n = ((last - first) / step).round() as usize + 1;
        if n > 40_000_000 {
            return Err(BadInput::new("the recording's times span more than a year; check column time_s"));
        }
        let index: Vec<usize> = r.time_s.iter().map(|t| (((t - first) / step).round() as usize).min(n - 1)).collect();
        let slow = r.step_s() > 1.5 * step;
        let bin = |values: &[f64]| -> Vec<f64> {
            let mut sum = vec![0.0; n];
            let mut count = vec![0u32; n];
            for (&k, v) in index.iter().zip(values) {
                if v.is_finite() {
                    sum[k] += v;
                    count[k] += 1;
                }
            }
            sum.iter().zip(&count).map(|(s, c)| if *c > 0 { s / f64::from(*c) } else { f64::NAN }).collect()
        };
        let bridged = |v: &[f64]| {
            let mut b = bin(v);
            bridge(&mut b);
            b
        };
        let held = |name: &str| -> Vec<f32> {
            r.column(name).map_or_else(Vec::new, |v| {
                let mut b = bridged(v);
                dequantise(&mut b);
                b.into_iter().map(|x| x as f32).collect()
            })
        };
        // (A unit takes them as they come; only the sensors on the cases are read by the desktop alone.)
        let mut quantities: [Vec<f32>; QUANTITIES] = std::array::from_fn(|number| {
            let as_single = |v: &[f64]| bridged(v).into_iter().map(|x| x as f32).collect();
            quantity(r, number as u8).map_or_else(Vec::new, as_single)
        });
        // Single seconds without a frequency (a spike taken out), and the seconds between slow rows, are bridged: the
        // states of the model run on.
        let mut frequency_hz = [0, 1, 2].map(|a| bin(&r.frequency_hz[a]));
        frequency_hz.iter_mut().for_each(|f| bridge(f));
        let mut rate_dph = [0, 1, 2].map(|a| bin(&r.rate_dph[a]));
        if slow {
            let half = (0.5 * r.step_s() / step).floor() as usize;
            rate_dph.iter_mut().for_each(|v| spread(v, half));
        }
        let mut given = quantities.clone();
        for (to, number) in given.iter_mut().zip(0..) {
            let Some(from) = quantity(r, number).filter(|_| !to.is_empty()) else { continue };
            // (A second of several rows has it where one of them does.)
            let mut missing = vec![false; n];
            index.iter().for_each(|k| missing[*k] = true);
            index.iter().zip(from).filter(|(_, v)| v.is_finite()).for_each(|(k, _)| missing[*k] = false);
            to.iter_mut().zip(missing).filter(|(_, missing)| *missing).for_each(|(v, _)| *v = f32::NAN);
        }
        let case_c = [0, 1, 2].map(|a| held(columns::CASE.name(a)));
        for (a, case) in case_c.iter().enumerate() {
            quantities[usize::from(inputs::case(a))].clone_from(case);
        }
        let steps = Self {
            start_s: first,
            power_on_s: r.power_on_s(),
            mean_s: MEAN_S,
            run_in: r.judged_from_s.map_or(0, |t| ((t - first) / step).round().clamp(0.0, n as f64) as usize),
            thermometer: r.thermometer,
            in_turns: r.meta("rates") == Some(crate::recording::metadata::LACKING),
            absent: r.absent,
            frequency_hz,
            rate_dph,
            case_c,
            chamber_c: held(columns::CHAMBER.name(0)),
            quantities,
            given,
            unit_inputs: r.unit_inputs()?,
        };
        Ok((steps, index))
    }

    /// Number of steps.
    #[must_use]
    pub fn len(&self) -> usize {
        self.frequency_hz[0].len()
    }

    /// `true` if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Axes that the recording has.
    pub fn present(&self) -> impl Iterator<Item = usize> + '_ {
        (0..AXES).filter(|&a| !self.absent[a])
    }

    /// Readings of the thermometers at a step; `None` where one is missing.
    #[must_use]
    pub fn frequencies(&self, k: usize) -> [Option<f64>; AXES] {
        [0, 1, 2].map(|a| Some(self.frequency_hz[a][k]).filter(|f| f.is_finite()))
    }

    /// The stretches in which the temperature of an axis is lost, between two readings that are too far apart to be bridged.
    pub fn lost(&self, a: usize) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let there = self.frequency_hz[a].iter().enumerate().filter(|(_, f)| f.is_finite()).map(|(k, _)| k);
        let far = |(before, after): &(usize, usize)| (after - before) as f64 * f64::from(MODEL_STEP_S) > BRIDGE_S;
        there.clone().zip(there.skip(1)).filter(far).map(|(before, after)| before + 1..after)
    }

    /// Takes out the rates of so many seconds behind each such stretch.
    pub fn leave_out_behind_gaps(&mut self, seconds: usize) {
        for a in 0..AXES {
            let ends: Vec<usize> = self.lost(a).map(|lost| lost.end).collect();
            for from in ends {
                let to = (from + seconds).min(self.len());
                self.rate_dph[a][from..to].fill(f64::NAN);
            }
        }
    }

    /// Quantities beside the frequencies at a step, gaps bridged.
    #[must_use]
    pub fn recorded(&self, k: usize) -> Quantities {
        Quantities::new(self.quantities.each_ref().map(|v| v.get(k).copied().unwrap_or(f32::NAN)))
    }

    /// Those that come in to the unit at a step.
    #[must_use]
    pub fn given(&self, k: usize) -> Quantities {
        Quantities::new(self.given.each_ref().map(|v| v.get(k).copied().unwrap_or(f32::NAN))).of(self.unit_inputs)
    }

    /// Quantities that are recorded in any second.
    #[must_use]
    pub fn has(&self) -> QuantitySet {
        let there = |n: &u8| self.given[usize::from(*n)].iter().any(|v| v.is_finite());
        QuantitySet::all().numbers().filter(there).map(QuantitySet::one).collect()
    }

    /// The values of a quantity, gaps bridged, where it has one.
    pub fn values(&self, number: u8) -> impl Iterator<Item = f32> + Clone + '_ {
        self.quantities[usize::from(number)].iter().copied().filter(|v| v.is_finite())
    }

    /// `true` if more than nine of ten steps that have a temperature have a quantity, too: enough to learn effects of it, and to judge them.
    #[must_use]
    pub fn has_enough(&self, number: u8) -> bool {
        let steps = (0..self.len()).filter(|k| self.frequencies(*k).iter().any(Option::is_some)).count();
        10 * self.values(number).count() > 9 * steps.max(1)
    }

    /// `true` if a quantity has two values that differ.
    #[must_use]
    pub fn moves(&self, number: u8) -> bool {
        let mut values = self.given[usize::from(number)].iter().filter(|v| v.is_finite());
        values.next().is_some_and(|first| values.any(|v| v.to_bits() != first.to_bits()))
    }

    /// Most values in a row that repeat the one before.
    fn most_equal(&self, number: u8) -> usize {
        let values: Vec<u32> =
            self.given[usize::from(number)].iter().filter(|v| v.is_finite()).map(|v| v.to_bits()).collect();
        let (mut most, mut now) = (0, 0);
        for pair in values.windows(2) {
            now = if pair[0] == pair[1] { now + 1 } else { 0 };
            most = most.max(now);
        }
        most
    }

    /// Median time between two values of a quantity, s; 1 where there are less than two.
    fn interval_s(&self, number: u8) -> usize {
        let at: Vec<usize> = (0..self.len())
            .filter(|k| self.given[usize::from(number)].get(*k).is_some_and(|v| v.is_finite()))
            .collect();
        let mut gaps: Vec<usize> = at.windows(2).map(|w| w[1] - w[0]).collect();
        gaps.sort_unstable();
        gaps.get(gaps.len() / 2).copied().unwrap_or(1)
    }
}

/// The column of a recording that holds the quantity with a number.
fn quantity(r: &Recording, number: u8) -> Option<&[f64]> {
    r.column(inputs::NAMES[usize::from(number)])
}

/// Quantities beside the frequencies that come in to the unit in each of these runs.
#[must_use]
pub fn unit_inputs(runs: &[Run]) -> QuantitySet {
    runs.iter().fold(QuantitySet::all(), |all, run| all.intersection(run.steps.unit_inputs))
}

/// The quantities that runs have, each with its reference and its range: those that nine of ten steps of each run have.
#[must_use]
pub fn input_table(runs: &[Run]) -> Vec<Input> {
    let of = |number: u8| {
        if runs.is_empty() || !runs.iter().all(|run| run.steps.has_enough(number)) {
            return None;
        }
        let all = || runs.iter().flat_map(|run| run.steps.values(number));
        let mean = all().map(f64::from).sum::<f64>() / all().count() as f64;
        let (low, high) = all().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        let reference = (mean as f32).clamp(low, high);
        let width = high - low;
        // A constant tells nothing.
        if !(width > 0.0) {
            return None;
        }
        let of_temperature = columns::find(inputs::NAMES[usize::from(number)]).is_some_and(|(c, _)| c.unit == "C");
        let usual = of_temperature || USUAL_WIDTHS.contains(&width);
        let interval = runs.iter().map(|run| run.steps.interval_s(number)).max().unwrap_or(1);
        Some(Input {
            quantity: number,
            most_equal: (2 * runs.iter().map(|run| run.steps.most_equal(number)).max().unwrap_or(0) + LEAST_EQUAL)
                .min(usize::from(u16::MAX)) as u16,
            counts_s: (usize::from(LEAST_COUNTS_S) * interval).min(usize::from(u8::MAX)) as u8,
            reference,
            scale: if usual { 1.0 } else { width },
            valid_from: low - BEYOND * width,
            valid_to: high + BEYOND * width,
            ..Input::default()
        })
    };
    (0..QUANTITIES as u8).filter_map(of).collect()
}

/// An input may repeat its value so often beyond twice of what the train runs show.
const LEAST_EQUAL: usize = 10;

/// Widths of an input over which gains are numbers that an image holds; others are scaled.
const USUAL_WIDTHS: std::ops::RangeInclusive<f32> = 1e-3..=1e4;

/// A unit uses an input so far beyond the range in which it was learnt, as a share of the range.
const BEYOND: f32 = 0.1;

/// Lets each value stand for `half` steps on either side of it, where nothing else stands.
fn spread(values: &mut [f64], half: usize) {
    let given: Vec<(usize, f64)> = values.iter().copied().enumerate().filter(|(_, v)| v.is_finite()).collect();
    let n = values.len();
    for (k, v) in given {
        for j in k.saturating_sub(half)..(k + half + 1).min(n) {
            if values[j].is_nan() {
                values[j] = v;
            }
        }
    }
}

/// Fills gaps of at most [`BRIDGE_S`] by straight lines.
fn bridge(values: &mut [f64]) {
    let mut last: Option<usize> = None;
    for k in 0..values.len() {
        if !values[k].is_finite() {
            continue;
        }
        if let Some(l) = last {
            if k - l > 1 && (k - l) as f64 * f64::from(MODEL_STEP_S) <= BRIDGE_S {
                let (a, b) = (values[l], values[k]);
                for j in l + 1..k {
                    values[j] = a + (b - a) * (j - l) as f64 / (k - l) as f64;
                }
            }
        }
        last = Some(k);
    }
}

/// Half the window of [`dequantise`], steps.
const SMOOTH: usize = 150;

/// Smooths a sensor that shows coarse steps (a DS18B20: 0.0625 C): a parabola fitted to five minutes about each
/// value. Gentle enough for a case with a time constant of minutes; a sensor with fine resolution is left alone.
fn dequantise(values: &mut [f64]) {
    let pairs = values.windows(2).filter(|w| w[0].is_finite() && w[1].is_finite()).count();
    let repeats = values.windows(2).filter(|w| w[0] == w[1]).count();
    let n = values.len();
    if 2 * repeats < pairs || n < 4 * SMOOTH || values.iter().any(|v| !v.is_finite()) {
        return;
    }
    // Prefix sums of v, k v and k^2 v about the middle of the data, for every window at once.
    let origin = values[n / 2];
    let mut sums = vec![[0.0f64; 3]; n + 1];
    for k in 0..n {
        let (x, v) = (k as f64, values[k] - origin);
        let last = sums[k];
        sums[k + 1] = [last[0] + v, last[1] + x * v, last[2] + x * x * v];
    }
    for k in 0..n {
        // Near the ends the window is shorter, and centred all the same: a straight mean of what is there.
        let half = SMOOTH.min(k).min(n - 1 - k);
        if half < 3 {
            continue;
        }
        let (a, b, c) = (k - half, k + half + 1, k as f64);
        let d = [0, 1, 2].map(|j: usize| sums[b][j] - sums[a][j]);
        let m = (2 * half + 1) as f64;
        // Second moment of the centred window, and the sums about its centre.
        let h = half as f64;
        let s2 = h * (h + 1.0) * (2.0 * h + 1.0) / 3.0;
        let s4 = s2 * (3.0 * h * h + 3.0 * h - 1.0) / 5.0;
        let y0 = d[0];
        let y2 = d[2] - 2.0 * c * d[1] + c * c * d[0];
        values[k] = origin + (s4 * y0 - s2 * y2) / (m * s4 - s2 * s2);
    }
}

/// A recording with its temperatures, as the unit computes them.
#[derive(Debug, Clone)]
pub struct Run {
    /// The recording on the grid.
    pub steps: Steps,
    /// The thermal state of every step.
    pub thermal: Vec<Thermal>,
    /// The curves by which the temperatures were made.
    pub curves: [TemperatureCurve; AXES],
    /// References and scales of the quantities beside the frequencies: how the effects count them.
    pub table: Vec<Input>,
    /// Columns of effects of a user's own.
    pub own: Vec<Arc<OwnColumns>>,
}

impl Run {
    /// Runs the unit's thermometer over the steps.
    #[must_use]
    pub fn new(steps: Steps, curves: [TemperatureCurve; AXES]) -> Self {
        // The thermometer's clock is ahead by one step: time at the end of a step.
        let offset = steps.start_s - steps.power_on_s - f64::from(MODEL_STEP_S);
        let mut thermometer = Thermometer::new(curves, offset as f32);
        let thermal = (0..steps.len()).map(|k| *thermometer.step(&steps.frequencies(k))).collect();
        Self { steps, thermal, curves, table: Vec::new(), own: Vec::new() }
    }

    /// Temperature and its rate of change at a step; `None` while the frequency is lost.
    #[must_use]
    pub fn state(&self, k: usize, a: usize) -> Option<(f32, f32)> {
        self.bias_state(k, a).map(|s| (s.temperature_c, s.ramp_c_per_min))
    }

    /// All that a bias model may look at, at a step; `None` while the frequency is lost.
    #[must_use]
    pub fn bias_state(&self, k: usize, a: usize) -> Option<&State> {
        let t = &self.thermal[k];
        t.state(a).filter(|_| t.axes[a].age == 0)
    }

    /// Inputs that an effect may read, with the quantities beside the frequencies; `None` if the axis has no temperature yet.
    #[must_use]
    pub fn inputs<'a>(
        &'a self,
        scaling: &'a Scaling,
        k: usize,
        a: usize,
        quantities: &'a Quantities,
    ) -> Option<Inputs<'a>> {
        let thermal = &self.thermal[k];
        thermal.state(a)?;
        Some(Inputs { scaling, thermal, axis: a, quantities })
    }

    /// Quantities beside the frequencies at a step, as effects count them.
    #[must_use]
    pub fn quantities(&self, k: usize) -> Quantities {
        self.steps.recorded(k).counted(&self.table)
    }

    /// The columns of an effect of a user's own, if it is one.
    #[must_use]
    pub fn own_columns(&self, id: u16, parameters: &[f32; MAX_PARAMETERS]) -> Option<&OwnColumns> {
        self.own.iter().find(|o| o.are_of(id, parameters)).map(AsRef::as_ref)
    }

    /// The regressors of an effect over the run for one axis; NaN where a needed quantity is missing.
    #[must_use]
    pub fn effect(
        &self,
        id: u16,
        parameters: &[f32; MAX_PARAMETERS],
        start: f32,
        scaling: &Scaling,
        a: usize,
    ) -> Vec<[f32; MAX_OUTPUTS]> {
        if let Some(own) = self.own_columns(id, parameters) {
            return own.on(a).to_vec();
        }
        let mut running = Running::new(id, parameters, MODEL_STEP_S);
        if let Some(r) = &mut running {
            r.start_on(start);
        }
        (0..self.thermal.len())
            .map(|k| match (self.inputs(scaling, k, a, &self.quantities(k)), &mut running) {
                (Some(i), Some(r)) => r.step(&i),
                _ => [f32::NAN; MAX_OUTPUTS],
            })
            .collect()
    }

    /// Lowest and highest temperature of an axis.
    #[must_use]
    pub fn temperature_range(&self, a: usize) -> (f32, f32) {
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        for k in 0..self.thermal.len() {
            if let Some((t, _)) = self.state(k, a) {
                range = (range.0.min(t), range.1.max(t));
            }
        }
        range
    }

    /// Lowest and highest rate of change of an axis.
    #[must_use]
    pub fn ramp_range(&self, a: usize) -> (f32, f32) {
        let mut range = (0.0f32, 0.0f32);
        for k in 0..self.thermal.len() {
            if let Some((_, r)) = self.state(k, a) {
                range = (range.0.min(r), range.1.max(r));
            }
        }
        range
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_steps_are_smoothed_and_fine_ones_left() {
        let truth: Vec<f64> = (0..6000).map(|k| 20.0 + 15.0 * (1.0 - (-(k as f64) / 900.0).exp())).collect();
        let mut coarse: Vec<f64> = truth.iter().map(|t| (t / 0.0625).round() * 0.0625).collect();
        let error = |v: &[f64]| {
            let e: Vec<f64> = v.iter().zip(&truth).skip(300).take(2500).map(|(a, b)| a - b).collect();
            (e.iter().map(|x| x * x).sum::<f64>() / e.len() as f64).sqrt()
        };
        let before = error(&coarse);
        dequantise(&mut coarse);
        assert!(error(&coarse) < 0.5 * before, "{} {before}", error(&coarse));
        let mut fine = truth.clone();
        dequantise(&mut fine);
        assert_eq!(fine, truth);
    }
}
