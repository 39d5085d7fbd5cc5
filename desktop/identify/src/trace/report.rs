//! Report of a trace: plain data, written as JSON (version 3 of the report).

use super::floor::Ratio;
use super::judge::Agreement;
use crate::family::member::Member;
use crate::family::Family;
use hrg_core::calibration::Calibration;
use hrg_core::effects::EffectId;
use hrg_core::inputs::{self, Input};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::{columns_of, Class};
use hrg_data::recording::{columns, Recording};
use serde::Serialize;
use std::collections::BTreeMap;

/// Version of the report.
pub const VERSION: u32 = 3;

/// A value for each axis, by name.
pub type ByAxis<T> = BTreeMap<String, T>;

/// Collects a value for each axis.
pub fn by_axis<T>(f: impl FnMut(usize) -> T) -> ByAxis<T> {
    AXIS_NAMES.iter().map(|n| (*n).to_string()).zip((0..AXIS_NAMES.len()).map(f)).collect()
}

/// Conclusion of a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum VerdictKind {
    /// The baseline is all that the data warrant.
    NothingLacks,
    /// Effects are named, and the verify run agrees.
    Confirmed,
    /// Effects are named on the train run, and the verify run does not get better by more than its uncertainty.
    NotConfirmed,
    /// Structure is left that nothing explains.
    Unexplained,
}

/// Image that a trace writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Image {
    /// Baseline and effects.
    Extended,
    /// The baseline alone.
    Baseline,
    /// None: not even the baseline beats the raw rates on the verify run, or no image holds its numbers.
    None,
}

/// RMS figures of one axis, deg/h: standard deviations of 100 s means of the compensated rate.
#[derive(Debug, Clone, Copy, Serialize, Default, PartialEq)]
pub struct Rms {
    /// On the train runs.
    pub train_rms_dph: f64,
    /// On the verify run.
    pub verify_rms_dph: f64,
    /// Means behind the figure of the train runs.
    pub train_means: usize,
    /// Means behind the figure of the verify run.
    pub verify_means: usize,
}

/// Gain of an effect on one axis.
#[derive(Debug, Clone, Serialize)]
pub struct Gain {
    /// Of the first regressor, deg/h per its unit.
    pub gain: f64,
    /// Its standard deviation.
    pub gain_std: f64,
    /// Of every regressor.
    pub gains: Vec<f64>,
    /// Their standard deviations.
    pub gains_std: Vec<f64>,
    /// Standard deviation of what the effect does to the means of the train runs, deg/h.
    pub size_dph: f64,
    /// Value of the recorded quantity at which its slope changes, in its unit; only of an effect that has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub break_value: Option<f64>,
}

/// Gains that are told one by one; of more, their number.
const GAINS_TOLD: usize = 3;

impl Gain {
    /// The gains in words.
    #[must_use]
    pub fn gains_text(&self) -> String {
        let each: Vec<String> =
            self.gains.iter().zip(&self.gains_std).map(|(g, std)| format!("{g:.4} +- {std:.4}")).collect();
        match each.len() {
            1 => format!("gain {}", each[0]),
            n if n <= GAINS_TOLD => format!("gains {}", each.join(", ")),
            n => format!("{n} gains"),
        }
    }
}

/// One entry of the ranking.
#[derive(Debug, Clone, Serialize)]
pub struct Ranked {
    /// Effect.
    pub name: String,
    /// Reduction of the cross-validated squared error, as a share.
    pub gain_in_cv: f64,
    /// Log prior odds and log evidence, were it the one in this place.
    pub score: super::search::Score,
}

/// The written image against the baseline on the run that judges, one axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Judged {
    /// Log score and fall of the error; zero where the axis holds the baseline.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// Root mean square of the means of the image's residual, its constant included, deg/h.
    pub rms_dph: f64,
    /// Their mean, deg/h: the constant of that day against the train runs.
    pub constant_dph: f64,
    /// Set where a constant alone, no correction or the least-squares baseline leaves less than that, by more than the uncertainty of the day's constant; on an axis that holds a
    /// constant, where the raw rates are far better.
    pub worse_than_a_constant: bool,
    /// Set where the image has effects and leaves too much of what the baseline leaves to say that it is better on another profile, too
    /// ([`super::judge::holds_elsewhere`]).
    pub uncertain_elsewhere: bool,
    /// Set on an axis that holds a constant where more than noise is left: the train runs and this one contradict each other.
    pub contradicted: bool,
}

/// Rows that chose what is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChosenOn {
    /// The train runs alone: the verify run judges rows that chose nothing.
    Train,
    /// The verify run has taken an axis back to the baseline, or to a constant.
    Verify,
}

/// A number with three significant digits, without an exponent: `0.04`, `12.5`, `9000`.
#[must_use]
pub fn three_digits(v: f64) -> String {
    with_digits(v, 3)
}

/// The same with so many.
fn with_digits(v: f64, digits: i32) -> String {
    if !v.is_finite() || v == 0.0 {
        return v.to_string();
    }
    let decimals = (digits - 1 - v.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{v:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').into()
    } else {
        text
    }
}

/// One effect found.
#[derive(Debug, Clone, Serialize)]
pub struct Found {
    /// Name.
    pub name: String,
    /// Class of physics.
    pub class: Class,
    /// Inner parameters, by name with unit; a time (`time_s`) is that of the recording's own clock.
    pub parameters: BTreeMap<String, f64>,
    /// Standard deviations of those that were refined.
    pub parameter_std: BTreeMap<String, f64>,
    /// Gains, by axis: only the axes that have it.
    pub axes: ByAxis<Gain>,
    /// Set if the verify run agrees on an axis and on none contradicts ([`super::judge::borne_out`], [`Agreement::loses`]). `None` for an
    /// unpredictable effect, or one whose input the verify run lacks.
    pub confirmed: Option<bool>,
    /// By axis: the share of the effect that the verify run shows.
    pub on_verify: ByAxis<Agreement>,
    /// The candidates for its place, best first.
    pub rank: Vec<Ranked>,
    /// Effects that this profile cannot tell from it.
    pub indistinguishable_from: Vec<String>,
    /// Log prior odds and log evidence.
    pub score: super::search::Score,
    /// Probability that it is not there, by its score; see [`super::odds::p_value`].
    pub p_value: f64,
    /// `unit`: goes into the image; `needs ...`: the unit does not measure it; `unpredictable`: to be repaired.
    pub reach: String,
}

/// An input that the written image needs.
#[derive(Debug, Clone, Serialize)]
pub struct InputNeeded {
    /// Name of its column.
    pub name: &'static str,
    /// Standard deviation of what its effects were in training, deg/h, on the axes that use it.
    pub without_dph: ByAxis<f64>,
}

impl InputNeeded {
    /// Those of an image.
    #[must_use]
    pub fn of(image: &Calibration) -> Vec<Self> {
        let one = |i: &Input| {
            let name = inputs::NAMES.get(usize::from(i.quantity))?;
            let on = (0..AXES).filter(|a| i.without_dph[*a] > 0.0);
            Some(Self { name, without_dph: on.map(|a| (AXIS_NAMES[a].to_string(), i.without_dph[a].into())).collect() })
        };
        image.inputs.iter().filter_map(one).collect()
    }
}

/// An effect that nobody can predict, fitted again to the verify run.
#[derive(Debug, Clone, Serialize)]
pub struct Refitted {
    /// Name.
    pub name: String,
    /// Inner parameters on the verify run; a time (`time_s`) is that of the recording's own clock.
    pub parameters: BTreeMap<String, f64>,
    /// Gains there, deg/h per unit of the first regressor.
    pub gains_dph: ByAxis<f64>,
}

impl Found {
    /// The column that it reads, of an effect that has a number for it among its parameters.
    #[must_use]
    pub fn column(&self) -> Option<&'static str> {
        let channel = || Some(*self.parameters.get("channel")? as usize);
        let number = match EffectId::by_name(&self.name)? {
            EffectId::OwnQuantity | EffectId::InputKink => return Some(columns_of(channel()?)),
            EffectId::RecordedQuantity => channel()?,
            EffectId::Board => usize::from(*self.parameters.get("source")? > 0.5),
            _ => return None,
        };
        inputs::NAMES.get(number).copied()
    }

    /// Its name, with the column that it reads where the name does not tell.
    #[must_use]
    pub fn label(&self) -> String {
        self.column().map_or_else(|| self.name.clone(), |column| format!("{} of {column}", self.name))
    }

    /// Size, gains and a change of slope on an axis in words.
    #[must_use]
    pub fn gain_text(&self, of: &Gain) -> String {
        let at = self.break_text(of).map_or(String::new(), |v| format!("its slope changes at {v}; "));
        format!("{:.3} deg/h on the train runs; {at}{}", of.size_dph, of.gains_text())
    }

    /// The value at which the slope changes, with its unit.
    #[must_use]
    pub fn break_text(&self, of: &Gain) -> Option<String> {
        // (Any axis' column has the unit of all.)
        let unit = self.column().and_then(|c| columns::find(&c.replace('?', "x"))).map_or("", |(c, _)| c.unit);
        // (It may be a thousandth of an offset that says where it is.)
        let value = |v| with_digits(v, 6);
        of.break_value.map(|v| if unit == columns::AS_IT_COMES { value(v) } else { format!("{} {unit}", value(v)) })
    }

    /// The inner parameters in words, with 95 % intervals where they were refined.
    #[must_use]
    pub fn parameters_text(&self) -> String {
        let told = self.column().is_some();
        let one = |(n, v): (&String, &f64)| match self.parameter_std.get(n) {
            Some(s) if s.is_infinite() => format!("{n} {} (these runs do not tell it)", three_digits(*v)),
            Some(s) => format!("{n} {} \u{b1} {}", three_digits(*v), three_digits(1.96 * s)),
            None => format!("{n} {}", three_digits(*v)),
        };
        let shown = self.parameters.iter().filter(|(n, _)| !told || !["channel", "source"].contains(&n.as_str()));
        shown.map(one).collect::<Vec<_>>().join(", ")
    }
}

/// Result of the written image on the verify run, one axis.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct OnVerify {
    /// Standard deviation of 100 s means, deg/h.
    pub verify_rms_dph: f64,
    /// Mean error against the train runs, deg/h.
    pub mean_dph: f64,
    /// Its standard deviation if both days have the same constant.
    pub mean_std_dph: f64,
    /// Means behind these figures.
    pub used_means: usize,
    /// Model of this axis.
    pub model: AxisModel,
}

/// Model of an axis of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AxisModel {
    /// Baseline and effects.
    Extended,
    /// The baseline alone.
    Baseline,
    /// A constant alone: the baseline is worse than that on the verify run.
    Constant,
}

/// The same search with train and verify exchanged.
#[derive(Debug, Clone, Serialize)]
pub struct Exchanged {
    /// Classes that it names.
    pub classes: Vec<Class>,
    /// Effects that it names.
    pub names: Vec<String>,
    /// Set if the classes are those of the report.
    pub same_classes: bool,
}

/// Counts of what was taken out: by file, by column, by kind.
pub type CleanedCounts = BTreeMap<String, BTreeMap<String, BTreeMap<String, usize>>>;

/// Counts of what was taken out of recordings.
#[must_use]
pub fn cleaned<'r>(recordings: impl IntoIterator<Item = (String, &'r Recording)>) -> CleanedCounts {
    let mut out = CleanedCounts::new();
    for (file, r) in recordings {
        let columns = out.entry(file).or_default();
        for c in &r.cleaned {
            *columns.entry(c.column.clone()).or_default().entry(c.defect.name().to_string()).or_default() += c.count;
        }
    }
    out
}

/// A unit under the family that was offered.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prior {
    /// Its name.
    pub family: String,
    /// Units that it was learnt from.
    pub units: usize,
    /// The unit belongs to it.
    pub belongs: bool,
    /// The image is that under the family.
    pub used: bool,
    /// By axis: log odds of the family against what the train runs say by themselves.
    pub log_odds: ByAxis<f64>,
    /// The same in a sentence.
    pub sentence: String,
}

impl Prior {
    pub(super) fn of(family: &Family, member: &Member) -> Self {
        Self {
            family: family.name.clone(),
            units: family.sources.len(),
            belongs: member.belongs(),
            used: member.is_better(),
            log_odds: by_axis(|a| member.evidence[a].map_or(f64::NAN, |e| e.family - e.own)),
            sentence: member.sentence(family),
        }
    }
}

/// The report of `hrg trace`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// [`VERSION`].
    pub version: u32,
    /// Unit.
    pub unit: String,
    /// Unit of all figures of rates: deg/h, or that of the quantity in the place of the rates (`rate_stands_for`).
    pub rate_unit: String,
    /// Seconds of a mean in all figures: 100, or 30 or 10 where a run is too short for that.
    pub mean_s: usize,
    /// Conclusion.
    pub verdict_kind: VerdictKind,
    /// Set if the image is to be burnt: it beats the baseline, and the image in use if one was given, on the verify run.
    pub burn: bool,
    /// Image that is written.
    pub image: Image,
    /// The verdict in some sentences.
    pub verdict: String,
    /// Baseline model alone.
    pub baseline: ByAxis<Rms>,
    /// Effects that the baseline lacks.
    pub effects: Vec<Found>,
    /// Inputs beside the frequencies that the written image needs.
    pub inputs: Vec<InputNeeded>,
    /// Baseline and effects, those that need a recorded input included; effects that nobody can predict are left in.
    pub r#final: ByAxis<Rms>,
    /// Effects that nobody can predict, fitted again to the verify run for the judgement.
    pub refitted_on_verify: Vec<Refitted>,
    /// The verify run with those taken out, too, deg/h.
    pub judged_rms_dph: ByAxis<f64>,
    /// The written image against the baseline on the run that judges, by axis.
    pub judge: ByAxis<Judged>,
    /// Rows that chose what is written.
    pub chosen_on: ChosenOn,
    /// The written image on the verify run; absent where none is written.
    pub block: Option<ByAxis<OnVerify>>,
    /// Standard deviation of 100 s means of the noise on the verify run, deg/h, from what neighbouring means differ by.
    pub noise_floor_dph: ByAxis<f64>,
    /// The judged residual of the verify run in noise floors, with its 95 % interval.
    pub floor_ratio: ByAxis<Ratio>,
    /// Set for an axis if structure is left.
    pub unexplained: ByAxis<bool>,
    /// Variables along which structure is left, in words.
    pub left_over: ByAxis<Vec<String>>,
    /// Seconds at the beginning of the verify run that are left out of fit and judgement, as it does not tell the state of an effect there.
    pub verify_left_out_s: usize,
    /// Share of the verify run outside the fitted temperatures and ramps (the worst axis).
    pub outside_fit: f64,
    /// Share of the verify run whose temperatures and ramps were visited together in training (the worst axis): elsewhere the unit flags
    /// `extrapolated`.
    pub visited: f64,
    /// Lowest and highest temperature at which the runs begin, C, where they begin within an eighth of the fitted range: none shows a power-on at
    /// another temperature. Else null.
    pub alike_starts_c: Option<[f64; 2]>,
    /// Run that judges the image: `verify`, or `judge` where a third one was given.
    pub judged_by: &'static str,
    /// True where the verify run has the temperatures of a train run: it cannot show what the image does elsewhere.
    pub verify_repeats_train: bool,
    /// The search with train and verify exchanged; absent where it was not asked for.
    pub exchanged: Option<Exchanged>,
    /// Advice on further steps.
    pub advice: Vec<String>,
    /// Notes on the data for the user.
    pub notes: Vec<String>,
    /// With several train runs, the constant of each against their mean, deg/h; else empty.
    pub turn_on: ByAxis<TurnOn>,
    /// The family that was offered; `null` where none was.
    pub prior: Option<Prior>,
    /// Deviation of the white noise at the highest temperature of the train runs over that at the lowest; 1: the same everywhere.
    pub noise_growth: ByAxis<f64>,
    /// Counts of values taken out of the files.
    pub cleaned: CleanedCounts,
}

/// Constants of the days of the train runs, one axis.
#[derive(Debug, Clone, Serialize)]
pub struct TurnOn {
    /// Constant of each train run against the mean of all, deg/h.
    pub constants_dph: Vec<f64>,
    /// Their standard deviation: the turn-on repeatability, as far as so few days tell, deg/h.
    pub std_dph: f64,
    /// Parts of the model (`temperature terms`, `ramp terms`, effects) whose sizes differ from day to day, with the deviation over the size.
    pub sizes: BTreeMap<&'static str, f64>,
}

impl Report {
    /// Names of the axes that it is about.
    #[must_use]
    pub fn axes(&self) -> Vec<&'static str> {
        AXIS_NAMES.into_iter().filter(|n| self.baseline.contains_key(*n)).collect()
    }

    /// Keeps the axes that the recordings have.
    pub(super) fn keep_axes(&mut self, there: impl Fn(&str) -> bool) {
        self.baseline.retain(|n, _| there(n));
        self.r#final.retain(|n, _| there(n));
        self.judged_rms_dph.retain(|n, _| there(n));
        self.noise_floor_dph.retain(|n, _| there(n));
        self.floor_ratio.retain(|n, _| there(n));
        self.unexplained.retain(|n, _| there(n));
        self.left_over.retain(|n, _| there(n));
        self.judge.retain(|n, _| there(n));
        self.turn_on.retain(|n, _| there(n));
        self.noise_growth.retain(|n, _| there(n));
        if let Some(block) = &mut self.block {
            block.retain(|n, _| there(n));
        }
        self.refitted_on_verify.iter_mut().for_each(|e| e.gains_dph.retain(|n, _| there(n)));
    }
}

/// The report as JSON.
#[must_use]
pub fn json(report: &Report) -> String {
    // A report is plain data: it always serialises.
    serde_json::to_string_pretty(report).unwrap_or_default()
}
