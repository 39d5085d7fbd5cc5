//! Does a unit pass? The largest error of its corrected rates over runs, against a limit, over a range of temperatures.
//!
//! The error is a mean of corrected rates (100 s by default), the constant of its day included: whatever a navigator would see at rest. It is
//! looked for at every mean whose temperature (of the resonator) lies in the range. Three answers are possible by axis: it fails where one
//! mean is beyond the limit; it is not covered where the runs have not been at some temperature of the range; else it passes.

use hrg_core::calibration::Calibration;
use hrg_core::status::AxisStatus;
use hrg_core::{AXES, MODEL_STEP_S};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{block_means, mean, quantile, std_dev};
use hrg_data::page;
use hrg_data::page::Tone;
use hrg_data::plot::{escape, Panel, Series};
use hrg_data::recording::metadata::in_unit;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::{plausible, Recording};
use hrg_identify::fit::{correct, data_crc32};
use hrg_simulate::profile::CHAMBERS_C;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Version of the report.
pub const VERSION: u32 = 1;
/// Temperatures nearer than that to the end of the range count as its end, C: a resonator follows its chamber no better.
const END_C: f64 = 1.0;
/// Width of a cell of temperature, C.
const CELL_C: f64 = 1.0;
/// Empty cells in a row that a ramp may leave, C: a gap that a fast ramp leaves between two seconds is none.
const GAP_C: f64 = 2.0;
/// Seconds of rates that tell what an image leaves of the unit now.
const SECONDS_NOW: usize = 30;
/// Ramps slower than that are a soak, C per minute.
const SOAK_C_PER_MIN: f64 = 0.05;

/// Limit and range.
#[derive(Debug, Clone, Copy)]
pub struct Limit {
    /// Largest error that passes, deg/h.
    pub limit_dph: f64,
    /// Lowest temperature, C.
    pub from_c: f64,
    /// Highest temperature, C.
    pub to_c: f64,
    /// Duration of a mean, s.
    pub means_s: usize,
}

impl Limit {
    /// Checks what a user gave.
    ///
    /// # Errors
    /// A limit that is not positive, a range without width, means of no time.
    pub fn check(&self) -> Result<(), BadInput> {
        if !(self.limit_dph > 0.0 && self.limit_dph.is_finite()) {
            return Err(BadInput::new(format!("--limit {} is no limit: give deg/h above 0", self.limit_dph)));
        }
        if !(self.from_c < self.to_c) {
            return Err(BadInput::new(format!(
                "--from {} --to {} is no range: give the lower temperature first",
                self.from_c, self.to_c
            )));
        }
        if !(CHAMBERS_C.contains(&self.from_c) && CHAMBERS_C.contains(&self.to_c)) {
            return Err(BadInput::new(format!(
                "--from {} --to {}: chambers reach {} to {} C",
                self.from_c,
                self.to_c,
                CHAMBERS_C.start(),
                CHAMBERS_C.end()
            )));
        }
        if self.means_s == 0 {
            return Err(BadInput::new("--means 0 is no duration: give seconds, as 100s"));
        }
        Ok(())
    }
}

/// Answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Verdict {
    /// Within the limit over the whole range.
    #[serde(rename = "PASS")]
    Pass,
    /// The runs have not been everywhere in the range.
    #[serde(rename = "NOT COVERED")]
    NotCovered,
    /// Beyond the limit.
    #[serde(rename = "FAIL")]
    Fail,
}

impl Verdict {
    /// Exit status of the program.
    #[must_use]
    pub fn exit_status(self) -> u8 {
        match self {
            Self::Pass => 0,
            Self::Fail => 3,
            Self::NotCovered => 4,
        }
    }

    /// The word.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Pass => "PASS",
            Self::Fail => "FAIL",
            Self::NotCovered => "NOT COVERED",
        }
    }
}

/// Direction of the temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// It rises.
    Heating,
    /// It falls.
    Cooling,
    /// It stands.
    Soak,
}

impl Direction {
    fn of(c_per_min: f64) -> Self {
        match c_per_min {
            r if r > SOAK_C_PER_MIN => Self::Heating,
            r if r < -SOAK_C_PER_MIN => Self::Cooling,
            _ => Self::Soak,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Self::Heating => "heating",
            Self::Cooling => "cooling",
            Self::Soak => "soak",
        }
    }
}

/// One axis.
#[derive(Debug, Clone, Serialize)]
pub struct Axis {
    /// Answer.
    pub verdict: Verdict,
    /// Largest error of the corrected rates in the range, its constant included, deg/h; `null` without a mean in the range.
    pub largest_dph: Option<f64>,
    /// Standard deviation of the noise of a mean, by what neighbours differ by, deg/h: the largest error is known no better.
    pub noise_dph: Option<f64>,
    /// Temperature at which it stands, C.
    pub at_c: Option<f64>,
    /// Time on the clock of its run, s.
    pub at_s: Option<f64>,
    /// Its run.
    pub at_run: Option<String>,
    /// Direction of the temperature there.
    pub direction: Option<Direction>,
    /// Mean error in the range, deg/h.
    pub constant_dph: Option<f64>,
    /// Largest error about that, deg/h.
    pub largest_about_constant_dph: Option<f64>,
    /// Root mean square of the errors, deg/h.
    pub rms_dph: Option<f64>,
    /// Largest raw rate in the range, deg/h.
    pub raw_largest_dph: Option<f64>,
    /// The same about its mean, deg/h.
    pub raw_largest_about_mean_dph: Option<f64>,
    /// Means in the range.
    pub means: usize,
    /// Longest stretch of the range that the runs have been in, C.
    pub covered_from_c: Option<f64>,
    /// Its upper end, C.
    pub covered_to_c: Option<f64>,
    /// Share of the range passed while heating.
    pub covered_heating: f64,
    /// Share of the range passed while cooling.
    pub covered_cooling: f64,
    /// Fastest heating in the range, C per minute.
    pub fastest_heating_c_per_min: f64,
    /// Fastest cooling in the range, C per minute.
    pub fastest_cooling_c_per_min: f64,
    /// Share of the means that the unit flags as beyond its calibration.
    pub extrapolated: f64,
}

/// Answer with its figures.
#[derive(Debug, Clone, Serialize)]
pub struct Judgement {
    /// [`VERSION`].
    pub version: u32,
    /// Name of the unit.
    pub unit: String,
    /// Unit of the figures of rates: deg/h, or that of the quantity in the place of the rates.
    pub rate_unit: String,
    /// Answer: the worst axis.
    pub verdict: Verdict,
    /// Limit, deg/h.
    pub limit_dph: f64,
    /// Lowest temperature asked for, C.
    pub from_c: f64,
    /// Highest temperature asked for, C.
    pub to_c: f64,
    /// Duration of a mean, s.
    pub means_s: usize,
    /// Files of the runs.
    pub runs: Vec<String>,
    /// Checksum of the calibration image, hexadecimal.
    pub calibration: String,
    /// By axis.
    pub axes: BTreeMap<String, Axis>,
    /// Remarks for the user.
    pub notes: Vec<String>,
    /// Means for the picture, by axis.
    #[serde(skip)]
    points: BTreeMap<String, Vec<Point>>,
}

/// One mean.
#[derive(Debug, Clone)]
struct Point {
    run: usize,
    at_s: f64,
    temperature_c: f64,
    c_per_min: f64,
    error_dph: f64,
    raw_dph: f64,
    flagged: bool,
}

/// Temperatures that an axis has been at, by cells of the range.
struct Cells {
    from_c: f64,
    any: Vec<bool>,
    heating: Vec<bool>,
    cooling: Vec<bool>,
    /// Fastest heating and cooling, C per minute.
    fastest: [f64; 2],
}

impl Cells {
    fn new(limit: &Limit) -> Self {
        let n = ((limit.to_c - limit.from_c) / CELL_C).ceil().max(1.0) as usize;
        Self {
            from_c: limit.from_c,
            any: vec![false; n],
            heating: vec![false; n],
            cooling: vec![false; n],
            fastest: [0.0; 2],
        }
    }

    fn visit(&mut self, temperature_c: f64, c_per_min: f64) {
        let at = ((temperature_c - self.from_c) / CELL_C).floor();
        if !(at >= 0.0 && (at as usize) < self.any.len()) {
            return;
        }
        let at = at as usize;
        self.any[at] = true;
        match Direction::of(c_per_min) {
            Direction::Heating => self.heating[at] = true,
            Direction::Cooling => self.cooling[at] = true,
            Direction::Soak => {}
        }
        self.fastest = [self.fastest[0].max(c_per_min), self.fastest[1].max(-c_per_min)];
    }

    fn share(cells: &[bool]) -> f64 {
        cells.iter().filter(|c| **c).count() as f64 / cells.len() as f64
    }

    /// The longest stretch of visited cells, first and last; gaps of [`GAP_C`] are bridged.
    fn stretch(&self) -> Option<(usize, usize)> {
        let most = (GAP_C / CELL_C) as usize;
        let mut best: Option<(usize, usize)> = None;
        let mut now: Option<(usize, usize)> = None;
        for k in (0..self.any.len()).filter(|k| self.any[*k]) {
            now = match now {
                Some((first, last)) if k - last <= most + 1 => Some((first, k)),
                _ => Some((k, k)),
            };
            if now.map(|n| n.1 - n.0) > best.map(|b| b.1 - b.0) || best.is_none() {
                best = now;
            }
        }
        best
    }
}

/// Notes on runs that are judged: learnt from, spikes, an axis that is not there.
fn about_runs(runs: &[Recording], calibration: &Calibration) -> Vec<String> {
    let mut notes = Vec::new();
    let learnt = |runs: &[Recording]| data_crc32(runs) == calibration.data_crc32;
    if runs.iter().any(|r| learnt(std::slice::from_ref(r))) || runs.len() > 1 && learnt(runs) {
        notes.push(
            "the calibration was learnt from a run that is judged here: that says nothing of another power-on; judge a run that it has not seen".to_string(),
        );
    }
    for r in runs {
        if let Some((a, at_s, _)) = r.rate_spikes.first() {
            notes.push(format!(
                "{}: {} spikes of the rates count here, as a unit sends them, the first on {} at {at_s:.0} s; if the logger made them, delete them from the file",
                r.source,
                r.rate_spikes.len(),
                AXIS_NAMES[*a]
            ));
        }
    }
    if let Some(a) = (0..AXES).find(|a| runs.iter().any(|r| r.absent[*a])) {
        notes.push(format!("axis {} is not judged: the runs have no rates of it", AXIS_NAMES[a]));
    }
    notes
}

/// A note on an input of the image that a run does not have, or has beyond the range that the image was learnt with.
fn about_inputs(
    r: &Recording,
    calibration: &Calibration,
    steps: &Steps,
    seconds: &[correct::Second],
) -> Option<String> {
    let lacks = correct::without_inputs(calibration, steps);
    let flagged = |a: usize| seconds.iter().filter(|s| s.status[a] & AxisStatus::INPUT.bits() != 0).count();
    let beyond = || {
        let (a, n) = steps.present().map(|a| (a, flagged(a))).max_by_key(|(_, n)| *n).filter(|(_, n)| *n > 0)?;
        Some(format!(
            "in {n} of {} seconds an input of the image is beyond the range that it was learnt with, and {} is flagged `input` (the calibration file names its inputs and their ranges); if it is on the whole run, check its unit",
            seconds.len(),
            AXIS_NAMES[a]
        ))
    };
    Some(format!("{}: {}", r.source, lacks.or_else(beyond)?))
}

/// A note on the answer that runs would have without the spikes of their rates; `None` where they have none.
///
/// # Errors
/// As [`judge`].
fn without_spikes(runs: &[Recording], calibration: &Calibration, limit: &Limit) -> Result<Option<String>, BadInput> {
    if runs.iter().all(|r| r.rate_spikes.is_empty()) {
        return Ok(None);
    }
    let clean: Vec<Recording> = runs.iter().map(|r| Recording { rate_spikes: Vec::new(), ..r.copied() }).collect();
    let judgement = judge(&clean, calibration, limit)?;
    let largest = judgement.axes.values().filter_map(|a| a.largest_dph).fold(0.0, f64::max);
    Ok(Some(format!("without the spikes: {}, the largest error is {largest:.3} deg/h", judgement.verdict.word())))
}

/// Tests, before a burn, that an image corrects the unit that a short recording is of: its rates now are within the limit, beside three deviations of what is
/// stated and of their noise.
///
/// # Errors
/// One sentence with the axis and what is left.
pub fn corrects(now: &Recording, calibration: &Calibration, limit: &Limit) -> Result<(), BadInput> {
    let seconds = correct::correct(calibration, &Steps::new(now)?);
    for (a, name) in AXIS_NAMES.iter().enumerate().filter(|(a, _)| !now.absent[*a]) {
        let settled =
            |s: &&correct::Second| s.corrected_dph[a].is_finite() && s.status[a] & AxisStatus::SETTLING.bits() == 0;
        let each: Vec<f64> = seconds.iter().filter(settled).map(|s| f64::from(s.corrected_dph[a])).collect();
        if each.len() < SECONDS_NOW {
            return Err(BadInput(format!("axis {name}: the unit on the port gives no rates with a temperature now")));
        }
        let stated: Vec<f64> = seconds.iter().filter(settled).map(|s| f64::from(s.bias_std_dph[a]).powi(2)).collect();
        let stated = mean(&stated.into_iter().filter(|v| v.is_finite()).collect::<Vec<_>>());
        let variance = std_dev(&each).powi(2) / each.len() as f64 + if stated.is_finite() { stated } else { 0.0 };
        let left = mean(&each);
        if left.abs() > limit.limit_dph + 3.0 * variance.sqrt() {
            return Err(BadInput(format!(
                "axis {name}: the image leaves {left:.2} deg/h of the unit that is on the port now, and {} are the limit: is it the unit that was recorded, and at rest?",
                limit.limit_dph
            )));
        }
    }
    Ok(())
}

/// A recording as it is judged: with its spikes, and without what lies behind a gap for as long as the image remembers.
fn steps_of(r: &Recording, calibration: &Calibration, limit: &Limit) -> Result<Steps, BadInput> {
    let mut steps = Steps::new(&r.with_spikes())?;
    hrg_identify::trace::leave_out_behind_gaps(calibration, &mut steps);
    if steps.len() < limit.means_s {
        return Err(BadInput::new(format!(
            "{}: {} s are too short for a mean of {} s",
            r.source,
            steps.len(),
            limit.means_s
        )));
    }
    Ok(steps)
}

/// Judges runs of a unit under a calibration.
///
/// # Errors
/// A run that holds corrected rates, or rates in turns; a limit that is none; no run.
pub fn judge(runs: &[Recording], calibration: &Calibration, limit: &Limit) -> Result<Judgement, BadInput> {
    limit.check()?;
    let first = runs.first().ok_or_else(|| BadInput::new("no run was given"))?;
    let mut points: [Vec<Point>; AXES] = Default::default();
    let mut cells = [0; AXES].map(|_| Cells::new(limit));
    let mut extremes = [(f64::INFINITY, f64::NEG_INFINITY); AXES];
    let mut notes = about_runs(runs, calibration);
    notes.extend(without_spikes(runs, calibration, limit)?);
    for (number, r) in runs.iter().enumerate() {
        if r.corrected() {
            return Err(BadInput::new(format!("{}: holds corrected rates; give the raw ones", r.source)));
        }
        let steps = steps_of(r, calibration, limit)?;
        let seconds = correct::correct(calibration, &steps);
        notes.extend(about_inputs(r, calibration, &steps, &seconds));
        for a in steps.present() {
            let of =
                |f: &dyn Fn(usize) -> f64| block_means(&(0..seconds.len()).map(f).collect::<Vec<_>>(), limit.means_s);
            // (The first second has no bias yet.)
            let error = of(&|k| if k == 0 { f64::NAN } else { f64::from(seconds[k].corrected_dph[a]) });
            let raw = of(&|k| f64::from(seconds[k].raw_dph[a]));
            let celsius: Vec<f64> = seconds.iter().map(|s| f64::from(s.temperature_c[a])).collect();
            let temperature = block_means(&celsius, limit.means_s);
            let beyond = (AxisStatus::TEMPERATURE_RANGE | AxisStatus::RAMP_RANGE | AxisStatus::EXTRAPOLATED).bits();
            let flagged = of(&|k| f64::from(u8::from(seconds[k].status[a] & beyond != 0)));
            let ramp = ramps(&celsius, limit.means_s);
            // (A temperature is covered where there was a rate, and where it was not held for want of a thermometer.)
            let lost = (AxisStatus::FREQUENCY_LOST | AxisStatus::TEMPERATURE_STALE).bits();
            for (k, (t, r)) in celsius.iter().zip(&ramp).enumerate() {
                if seconds[k].corrected_dph[a].is_finite() && seconds[k].status[a] & lost == 0 {
                    extremes[a] = (extremes[a].0.min(*t), extremes[a].1.max(*t));
                    cells[a].visit(*t, *r);
                }
            }
            for k in 0..error.len() {
                let middle = (k * limit.means_s + limit.means_s / 2).min(celsius.len() - 1);
                points[a].push(Point {
                    run: number,
                    at_s: steps.start_s + middle as f64 * f64::from(MODEL_STEP_S),
                    temperature_c: temperature[k],
                    c_per_min: ramp[middle],
                    error_dph: error[k],
                    raw_dph: raw[k],
                    flagged: flagged[k] > 0.5,
                });
            }
        }
        if !r.without_earth_rate() && r.stands_for().is_none() {
            let note = "latitude and axes are not known: the earth's rate is in raw and corrected rates, unless the calibration holds it; give --latitude and --axes as hrg fit had them";
            notes.push(note.to_string());
        }
    }
    notes.dedup();
    let names: Vec<String> = runs.iter().map(|r| r.source.clone()).collect();
    let there: Vec<usize> = first.present().collect();
    let axes: BTreeMap<String, Axis> = there
        .iter()
        .map(|&a| (AXIS_NAMES[a].to_string(), axis(&points[a], &cells[a], extremes[a], limit, &names)))
        .collect();
    let constants = [0, 1, 2].map(|a| axes.get(AXIS_NAMES[a]).and_then(|axis| axis.constant_dph));
    notes.extend(plausible::earth_rate_otherwise(&constants, first.earth_rate_dph.as_ref()));
    Ok(Judgement {
        version: VERSION,
        unit: first.unit().to_string(),
        rate_unit: first.rate_unit().to_string(),
        verdict: axes.values().map(|a| a.verdict).max().unwrap_or(Verdict::NotCovered),
        limit_dph: limit.limit_dph,
        from_c: limit.from_c,
        to_c: limit.to_c,
        means_s: limit.means_s,
        calibration: format!("{:08x}", calibration.checksum()),
        runs: names,
        axes,
        notes,
        points: there.iter().map(|&a| (AXIS_NAMES[a].to_string(), points[a].clone())).collect(),
    })
}

/// Rate of change of a temperature over a mean's duration about each second, C per minute.
fn ramps(celsius: &[f64], means_s: usize) -> Vec<f64> {
    let n = celsius.len();
    let half = (means_s / 2).max(1);
    (0..n)
        .map(|k| {
            let (from, to) = (k.saturating_sub(half), (k + half).min(n - 1));
            60.0 * (celsius[to] - celsius[from]) / ((to - from).max(1) as f64 * f64::from(MODEL_STEP_S))
        })
        .collect()
}

fn axis(points: &[Point], cells: &Cells, extremes: (f64, f64), limit: &Limit, names: &[String]) -> Axis {
    let inside: Vec<&Point> = points
        .iter()
        .filter(|p| (limit.from_c..=limit.to_c).contains(&p.temperature_c) && p.error_dph.is_finite())
        .collect();
    let errors: Vec<f64> = inside.iter().map(|p| p.error_dph).collect();
    let raw: Vec<f64> = inside.iter().map(|p| p.raw_dph).filter(|v| v.is_finite()).collect();
    let (constant, of_raw) = (mean(&errors), mean(&raw));
    let most = |values: &[f64], about: f64| values.iter().map(|v| (v - about).abs()).reduce(f64::max);
    let worst = inside.iter().max_by(|x, y| x.error_dph.abs().total_cmp(&y.error_dph.abs()));
    let steps: Vec<f64> = points
        .windows(2)
        .filter(|w| w[0].run == w[1].run)
        .map(|w| (w[1].error_dph - w[0].error_dph).abs())
        .filter(|d| d.is_finite())
        .collect();
    // (The median of a normal deviate's size is 0.6745 of its deviation; two means differ by root two as much.)
    let noise = (steps.len() > 3).then(|| quantile(&steps, 0.5) / 0.6745 / std::f64::consts::SQRT_2);
    let stretch = cells.stretch();
    let last = cells.any.len() - 1;
    let ends = stretch.map(|(first, to)| {
        let low = if first == 0 { limit.from_c } else { limit.from_c + first as f64 * CELL_C };
        let high = if to == last { limit.to_c } else { limit.from_c + (to + 1) as f64 * CELL_C };
        (low.max(extremes.0), high.min(extremes.1))
    });
    let covered = ends.is_some_and(|(low, high)| low <= limit.from_c + END_C && high >= limit.to_c - END_C);
    let largest = worst.map(|p| p.error_dph.abs());
    let verdict = match largest {
        Some(l) if l > limit.limit_dph => Verdict::Fail,
        Some(_) if covered => Verdict::Pass,
        _ => Verdict::NotCovered,
    };
    let some = |v: f64| (!errors.is_empty()).then_some(v);
    Axis {
        verdict,
        largest_dph: largest,
        noise_dph: noise,
        at_c: worst.map(|p| p.temperature_c),
        at_s: worst.map(|p| p.at_s),
        at_run: worst.and_then(|p| names.get(p.run).cloned()),
        direction: worst.map(|p| Direction::of(p.c_per_min)),
        constant_dph: some(constant),
        largest_about_constant_dph: most(&errors, constant),
        rms_dph: some((std_dev(&errors).powi(2) + constant * constant).sqrt()),
        raw_largest_dph: most(&raw, 0.0),
        raw_largest_about_mean_dph: most(&raw, of_raw),
        means: errors.len(),
        covered_from_c: ends.map(|e| e.0),
        covered_to_c: ends.map(|e| e.1),
        covered_heating: Cells::share(&cells.heating),
        covered_cooling: Cells::share(&cells.cooling),
        fastest_heating_c_per_min: cells.fastest[0],
        fastest_cooling_c_per_min: cells.fastest[1],
        extrapolated: inside.iter().filter(|p| p.flagged).count() as f64 / inside.len().max(1) as f64,
    }
}

impl Judgement {
    /// The answer in a line, with the worst axis.
    #[must_use]
    pub fn line(&self) -> String {
        in_unit(&self.line_in_dph(), &self.rate_unit)
    }

    fn line_in_dph(&self) -> String {
        let range = format!("{} deg/h from {} to {} C", self.limit_dph, self.from_c, self.to_c);
        let of = |verdict: Verdict| self.axes.iter().filter(move |(_, a)| a.verdict == verdict);
        match self.verdict {
            Verdict::Fail => {
                let each: Vec<String> = of(Verdict::Fail)
                    .map(|(n, a)| {
                        format!(
                            "{n} is {:.3} deg/h off at {:.1} C{}",
                            a.largest_dph.unwrap_or(f64::NAN),
                            a.at_c.unwrap_or(f64::NAN),
                            a.direction.map_or("", |d| match d {
                                Direction::Heating => " while heating",
                                Direction::Cooling => " while cooling",
                                Direction::Soak => " on a soak",
                            })
                        )
                    })
                    .collect();
                format!("FAIL: {}; the limit is {range}", hrg_data::error::list(&each))
            }
            Verdict::NotCovered => {
                // (Axes that were seen alike are named together.)
                let mut each: Vec<(String, Vec<&String>)> = Vec::new();
                for (n, a) in of(Verdict::NotCovered) {
                    let seen = match (a.covered_from_c, a.covered_to_c) {
                        _ if a.covered_from_c.is_some() && a.means == 0 => {
                            format!("no mean of {} s in that range", self.means_s)
                        }
                        (Some(low), Some(high)) => format!("data from {low:.1} to {high:.1} C only"),
                        _ => "no data in that range".to_string(),
                    };
                    match each.iter_mut().find(|(s, _)| *s == seen) {
                        Some((_, axes)) => axes.push(n),
                        None => each.push((seen, vec![n])),
                    }
                }
                let each: Vec<String> = each
                    .iter()
                    .map(|(seen, axes)| {
                        format!(
                            "{} {} {seen}",
                            hrg_data::error::list(axes),
                            if axes.len() == 1 { "has" } else { "have" }
                        )
                    })
                    .collect();
                format!(
                    "NOT COVERED: {}; the rest of {} to {} C is not tested",
                    each.join("; "),
                    self.from_c,
                    self.to_c
                )
            }
            Verdict::Pass => {
                let largest = self.axes.values().filter_map(|a| a.largest_dph).fold(0.0, f64::max);
                let one_way = |share: &dyn Fn(&Axis) -> f64| self.axes.values().any(|a| share(a) < 0.5);
                let only = match (one_way(&|a| a.covered_heating), one_way(&|a| a.covered_cooling)) {
                    (true, true) => "; hardly any of it on ramps",
                    (true, false) => "; hardly any of it while heating",
                    (false, true) => "; hardly any of it while cooling",
                    (false, false) => "",
                };
                format!(
                    "PASS: every mean of {} s stays within {range}, the largest is {largest:.3} deg/h{only}",
                    self.means_s
                )
            }
        }
    }

    /// The table under the line.
    #[must_use]
    pub fn table(&self) -> String {
        in_unit(&self.table_in_dph(), &self.rate_unit)
    }

    fn table_in_dph(&self) -> String {
        let show = |v: Option<f64>| v.map_or("-".to_string(), |v| format!("{v:.3}"));
        let mut s = format!(
            "{:<5} {:<12} {:>18} {:>18} {:>10} {:>10} {:>10} {:>10}   {}\n",
            "axis", "", "largest", "at", "constant", "moving", "RMS", "raw", "covered"
        );
        for (n, a) in &self.axes {
            let largest = match (a.largest_dph, a.noise_dph) {
                (Some(l), Some(noise)) => format!("{l:.3} +- {:.3}", 1.96 * noise),
                (l, _) => show(l),
            };
            let at = match (a.at_c, a.direction) {
                (Some(t), Some(d)) => format!("{t:.1} C, {}", d.word()),
                _ => "-".into(),
            };
            let covered = match (a.covered_from_c, a.covered_to_c) {
                (Some(low), Some(high)) => format!(
                    "{low:.1} to {high:.1} C; heating {:.0} % up to {:.1} C/min, cooling {:.0} % up to {:.1} C/min",
                    100.0 * a.covered_heating,
                    a.fastest_heating_c_per_min,
                    100.0 * a.covered_cooling,
                    a.fastest_cooling_c_per_min
                ),
                _ => "nothing of the range".into(),
            };
            let _ = writeln!(
                s,
                "{n:<5} {:<12} {largest:>18} {at:>18} {:>10} {:>10} {:>10} {:>10}   {covered}",
                a.verdict.word(),
                show(a.constant_dph),
                show(a.largest_about_constant_dph),
                show(a.rms_dph),
                show(a.raw_largest_dph)
            );
        }
        let _ = writeln!(
            s,
            "deg/h, means of {} s. largest: largest error, with the constant; +-: 95 % half-width of the noise of one mean; moving: largest error after the constant is subtracted; raw: largest raw rate. Temperatures: from the gyros' thermometers",
            self.means_s
        );
        s
    }

    /// The page.
    ///
    /// # Errors
    /// If a picture cannot be drawn.
    pub fn html(&self) -> anyhow::Result<String> {
        let panels: Vec<Panel> = self.points.iter().map(|(n, points)| self.panel(n, points)).collect();
        let tone = match self.verdict {
            Verdict::Pass => Tone::Good,
            Verdict::Fail => Tone::Bad,
            Verdict::NotCovered => Tone::Open,
        };
        let line = escape(&self.line()).replacen(self.verdict.word(), &format!("<b>{}</b>", self.verdict.word()), 1);
        let body = format!(
            "<h1>Does {} pass?</h1><p class=small>Calibration image {}; runs: {}</p>{}{}{}<pre>{}</pre>{}",
            escape(&self.unit),
            self.calibration,
            escape(&self.runs.join(", ")),
            page::pictures(&panels)?,
            page::legend(&[("heating", 2), ("cooling", 3), ("soak", 4), ("limit", 1)]),
            page::boxed(&line, tone),
            escape(&self.table()),
            page::list(&self.notes)
        );
        Ok(in_unit(&page::page(&format!("hrg judge: {}", escape(&self.unit)), &body), &self.rate_unit))
    }

    /// Errors of one axis over temperature, with the limit as lines.
    fn panel(&self, name: &str, points: &[Point]) -> Panel {
        let of = |wanted: Direction| -> Vec<(f64, f64)> {
            let these = points.iter().filter(|p| Direction::of(p.c_per_min) == wanted);
            these.map(|p| (p.temperature_c, p.error_dph)).collect()
        };
        let series = |points, colour, dots| Series { label: String::new(), points, colour, dots };
        let line = |y: f64| vec![(self.from_c, y), (self.to_c, y)];
        Panel {
            title: format!("{name}: corrected rates, means of {} s", self.means_s),
            x: "temperature [C]".into(),
            y: "error [deg/h]".into(),
            log: false,
            series: vec![
                series(of(Direction::Heating), 2, true),
                series(of(Direction::Cooling), 3, true),
                series(of(Direction::Soak), 4, true),
                series(line(self.limit_dph), 1, false),
                series(line(-self.limit_dph), 1, false),
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_bridge_small_gaps_alone() {
        let limit = Limit { limit_dph: 1.0, from_c: 0.0, to_c: 20.0, means_s: 100 };
        let mut cells = Cells::new(&limit);
        for t in [0.5, 1.5, 4.5, 9.5, 10.5, 11.5, 12.5, 13.5, 25.0, -3.0, f64::NAN] {
            cells.visit(t, 1.0);
        }
        assert_eq!(cells.stretch(), Some((0, 4)));
        cells.visit(7.5, -1.0);
        assert_eq!(cells.stretch(), Some((0, 13)));
        assert_eq!((Cells::share(&cells.cooling), cells.fastest), (0.05, [1.0, 1.0]));
    }

    #[test]
    fn an_image_of_another_unit_is_noticed_before_the_burn() {
        use hrg_simulate::{Plan, Profile};
        let run = |profile: &str, seed| Plan::of(Profile::parse(profile).expect("fine"), 5, seed).simulate().recording;
        let train = run("cycle", 1);
        let image =
            hrg_identify::trace::trace(std::slice::from_ref(&train), &run("verify", 2)).expect("traced").baseline;
        let limit = Limit { limit_dph: 1.0, from_c: -40.0, to_c: 60.0, means_s: 100 };
        let mut now = run("20,4m", 2);
        assert_eq!(corrects(&now, &image, &limit), Ok(()));
        now.rate_dph[1].iter_mut().for_each(|v| *v += 4.0);
        let e = corrects(&now, &image, &limit).expect_err("another").0;
        assert!(e.contains("axis y: the image leaves") && e.contains("is it the unit that was recorded"), "{e}");
        now.frequency_hz[1].iter_mut().for_each(|v| *v = f64::NAN);
        assert!(corrects(&now, &image, &limit).expect_err("none").0.contains("no rates"));
    }

    #[test]
    fn a_limit_that_is_none_is_refused() {
        let good = Limit { limit_dph: 1.0, from_c: -40.0, to_c: 60.0, means_s: 100 };
        assert!(good.check().is_ok());
        for bad in [
            Limit { limit_dph: 0.0, ..good },
            Limit { limit_dph: f64::NAN, ..good },
            Limit { from_c: 60.0, ..good },
            Limit { means_s: 0, ..good },
            Limit { to_c: 1e9, ..good },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
