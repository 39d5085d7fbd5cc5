//! Effects of a user's own: columns that the caller computes, judged by the same search as the effects of the library.
//!
//! The caller gives a function from the states of a run (temperatures, their rates of change, frequencies, time) to one column or several.
//! It is asked once for each run, axis and value of its parameter, before the search. Whatever holds for a candidate of the library
//! holds for it: evidence, price, the price of the values tried, surrogates, held-out parts, the verify run, the second witness. Only an image
//! cannot hold it, as the unit does not have its code.

use hrg_core::effects::{EffectId, Facts, Reach, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::{AXES, MODEL_STEP_S};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::Class;
use hrg_data::cards::{card, Card, Generator, Kind, Needs};
use hrg_data::error::BadInput;
use hrg_data::recording::own_columns::OwnColumns;
use hrg_data::recording::steps::Run;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Numbers from here on are no effects of the library: an image never holds them.
const FIRST_ID: u16 = 0x8000;

/// Most values of a parameter.
pub const MOST_VALUES: usize = 64;

/// Columns, each with a value a step; or why there are none.
pub type Computed = Result<Vec<Vec<f64>>, String>;

/// Data that a user's function may read: one axis of one run, a value a model step; NaN if it is not known.
#[derive(Debug)]
pub struct States<'r> {
    /// The run.
    pub run: &'r Run,
    /// The axis, 0 to 2.
    pub axis: usize,
    /// The value of the parameter; `None` where there is none.
    pub parameter: Option<f64>,
}

impl States<'_> {
    fn each(&self, of: impl Fn(usize) -> f64) -> Vec<f64> {
        (0..self.run.thermal.len()).map(of).collect()
    }

    /// Time since power-on at the end of each step, s.
    #[must_use]
    pub fn time_s(&self) -> Vec<f64> {
        self.each(|k| f64::from(self.run.thermal[k].time_s))
    }

    /// Temperature of an axis, C.
    #[must_use]
    pub fn temperature_c(&self, axis: usize) -> Vec<f64> {
        self.each(|k| self.run.thermal[k].state(axis).map_or(f64::NAN, |s| f64::from(s.temperature_c)))
    }

    /// Rate of change of the temperature of an axis as the unit has it, C per minute.
    #[must_use]
    pub fn ramp_c_per_min(&self, axis: usize) -> Vec<f64> {
        self.each(|k| self.run.thermal[k].state(axis).map_or(f64::NAN, |s| f64::from(s.ramp_c_per_min)))
    }

    /// Frequency of the axis, Hz (its temperature, C, where a sensor is the thermometer).
    #[must_use]
    pub fn frequency_hz(&self) -> Vec<f64> {
        self.each(|k| self.run.steps.frequencies(k)[self.axis].unwrap_or(f64::NAN))
    }

    /// Quantities that a recording may hold, by the names of their columns without the axis: `case_c`, `board_c`, `supply_v`, `drive_v`,
    /// `quad_v`.
    #[must_use]
    pub fn recorded(&self) -> [(&'static str, Vec<f64>); 5] {
        let all: Vec<_> = (0..self.run.thermal.len()).map(|k| self.run.steps.recorded(k)).collect();
        let of = |f: &dyn Fn(&hrg_core::inputs::Quantities) -> f32| all.iter().map(|r| f64::from(f(r))).collect();
        let a = self.axis;
        [
            ("case_c", of(&|r| r.case_c(a))),
            ("board_c", of(&|r| r.board_c())),
            ("supply_v", of(&|r| r.supply_v())),
            ("drive_v", of(&|r| r.drive_v(a))),
            ("quad_v", of(&|r| r.quad_v(a))),
        ]
    }

    /// Time between two steps, s.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        f64::from(MODEL_STEP_S)
    }
}

/// A user's effect.
#[derive(Clone)]
pub struct OwnEffect {
    name: String,
    /// Name of the parameter, and the values to try.
    parameter: Option<(String, Vec<f64>)>,
    compute: Arc<dyn Fn(&States<'_>) -> Computed + Send + Sync>,
}

impl fmt::Debug for OwnEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OwnEffect")
            .field("name", &self.name)
            .field("parameter", &self.parameter)
            .finish_non_exhaustive()
    }
}

impl OwnEffect {
    /// An effect of this name; `parameter`: its name, with unit, and the values to try.
    ///
    /// # Errors
    /// A name that is empty, or one of the library's; no value, more than [`MOST_VALUES`], or one that is not finite.
    pub fn new(
        name: &str,
        parameter: Option<(String, Vec<f64>)>,
        compute: impl Fn(&States<'_>) -> Computed + Send + Sync + 'static,
    ) -> Result<Self, BadInput> {
        let bad = |s: String| Err(BadInput(s));
        if name.trim().is_empty() {
            return bad("an effect of your own needs a name; give it one that says what it is".into());
        }
        if EffectId::by_name(name).is_some() {
            return bad(format!("own effect {name}: the library has an effect of this name; give yours another"));
        }
        if let Some((parameter, values)) = &parameter {
            if values.is_empty() || values.len() > MOST_VALUES || values.iter().any(|v| !v.is_finite()) {
                return bad(format!(
                    "own effect {name}, parameter {parameter}: {} values; give 1 to {MOST_VALUES} finite ones to try",
                    values.len()
                ));
            }
        }
        Ok(Self { name: name.to_string(), parameter, compute: Arc::new(compute) })
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    fn values(&self) -> Vec<Option<f64>> {
        self.parameter.as_ref().map_or(vec![None], |(_, values)| values.iter().map(|v| Some(*v)).collect())
    }

    /// The columns of one axis of a run, checked.
    fn columns(&self, states: &States<'_>) -> Result<Vec<Vec<f64>>, BadInput> {
        let at = match (&self.parameter, states.parameter) {
            (Some((name, _)), Some(v)) => format!(" with {name} = {v}"),
            _ => String::new(),
        };
        let here = format!("own effect {}, axis {}{at}", self.name, AXIS_NAMES[states.axis]);
        let columns = (self.compute)(states).map_err(|why| BadInput(format!("{here}: {why}")))?;
        if columns.is_empty() || columns.len() > MAX_OUTPUTS {
            return Err(BadInput(format!("{here}: {} columns; give 1 to {MAX_OUTPUTS}", columns.len())));
        }
        let rows = states.run.thermal.len();
        if let Some(c) = columns.iter().find(|c| c.len() != rows) {
            return Err(BadInput(format!(
                "{here}: a column has {} values, the run has {rows} steps; give a value for each step",
                c.len()
            )));
        }
        if !columns.iter().all(|c| c.iter().any(|v| v.is_finite())) {
            return Err(BadInput(format!(
                "{here}: a column has no finite value; give numbers, NaN where one is missing"
            )));
        }
        Ok(columns)
    }
}

/// `true` if a number is that of an effect of a user's own.
#[must_use]
pub const fn is_own(id: u16) -> bool {
    id >= FIRST_ID
}

/// Facts live as long as the program: models name their effects by a reference. The same facts are made once.
fn facts(name: &str, parameter: Option<&str>, id: u16, outputs: usize) -> &'static Facts {
    static MADE: Mutex<Vec<&'static Facts>> = Mutex::new(Vec::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let same = |f: &&&'static Facts| {
        f.name == name && f.parameters.first().copied() == parameter && (f.id, f.outputs) == (id, outputs)
    };
    if let Some(known) = made.iter().find(same) {
        return known;
    }
    let leak = |s: &str| -> &'static str { Box::leak(s.to_string().into_boxed_str()) };
    let parameters: Vec<&'static str> = parameter.map(leak).into_iter().collect();
    let new: &'static Facts = Box::leak(Box::new(Facts {
        // (This is the effect of the library that reads a quantity only a recording has. Questions about the kind go by the number:
        // [`card_of`].)
        effect: EffectId::RecordedQuantity,
        name: leak(name),
        id,
        parameters: Vec::leak(parameters),
        outputs,
        reach: Reach::NeedsChamber("own code, which the unit does not have"),
        common: false,
        remembers_path: false,
    }));
    made.push(new);
    new
}

/// Computes the columns of all effects on a run and keeps them there. `None` for an axis that the run does not have.
///
/// # Errors
/// A sentence that names the effect: its function failed, or gave what cannot be used.
pub fn attach(effects: &[OwnEffect], run: &mut Run) -> Result<(), BadInput> {
    let mut all = Vec::new();
    for (n, effect) in effects.iter().enumerate() {
        if let Some(other) = effects[..n].iter().find(|e| e.name == effect.name) {
            return Err(BadInput(format!("own effect {} is there twice; give each its own name", other.name)));
        }
        let mut outputs = None;
        for parameter in effect.values() {
            let mut axes: [Vec<[f32; MAX_OUTPUTS]>; AXES] = Default::default();
            for a in run.steps.present() {
                let columns = effect.columns(&States { run, axis: a, parameter })?;
                if *outputs.get_or_insert(columns.len()) != columns.len() {
                    return Err(BadInput(format!(
                        "own effect {}: {} columns here and {} there; give as many for every axis and parameter",
                        effect.name,
                        outputs.unwrap_or(0),
                        columns.len()
                    )));
                }
                axes[a] = (0..run.thermal.len()).map(|k| row(&columns, k)).collect();
            }
            let name = effect.parameter.as_ref().map(|p| p.0.as_str());
            let facts = facts(&effect.name, name, FIRST_ID + n as u16, outputs.unwrap_or(1));
            all.push(Arc::new(OwnColumns::new(facts, parameter.unwrap_or(0.0) as f32, axes)));
        }
    }
    run.own = all;
    Ok(())
}

/// One step of some columns; all NaN where one is missing.
fn row(columns: &[Vec<f64>], k: usize) -> [f32; MAX_OUTPUTS] {
    let mut out = [0.0; MAX_OUTPUTS];
    for (to, c) in out.iter_mut().zip(columns) {
        *to = c[k] as f32;
    }
    if out.iter().all(|v| v.is_finite()) {
        out
    } else {
        [f32::NAN; MAX_OUTPUTS]
    }
}

/// The card of an effect, be it of the library or of a user's own.
#[must_use]
pub fn card_of(facts: &Facts) -> Card {
    if !is_own(facts.id) {
        return card(facts.effect);
    }
    Card {
        class: Class::Own,
        kind: Kind::Simple,
        refine: &[],
        possible: |_, _| true,
        repeats: false,
        grid: |_| vec![],
        needs: Needs::Nothing,
        generator: Generator { usual: [0.0; MAX_PARAMETERS], range: None, secret: false, study: false },
        parted_by_profile: false,
        repair: None,
        meaning: "an effect of your own",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{trace_with, Options, Trace};
    use hrg_data::recording::Recording;
    use hrg_simulate::{Plan, Profile};

    fn plan(profile: &str, seed: u64) -> Recording {
        Plan::of(Profile::parse(profile).expect("named"), 61, seed).simulate().recording
    }

    /// A resonance of the mount with the resonator: a peak of some 3 C in its frequency.
    fn resonance(hz: f64, a: usize) -> f64 {
        1.0 / (1.0 + ((hz - [4906.0, 4898.0, 4709.6][a]) / 1.5).powi(2))
    }

    fn peak(s: &States<'_>) -> Computed {
        Ok(vec![s.frequency_hz().iter().map(|f| resonance(*f, s.axis)).collect()])
    }

    /// The recording with so much of it added to the rates, deg/h.
    fn with(mut r: Recording, size_dph: f64) -> Recording {
        for a in 0..AXES {
            for (rate, f) in r.rate_dph[a].iter_mut().zip(&r.frequency_hz[a]) {
                *rate += size_dph * resonance(*f, a);
            }
        }
        r
    }

    fn traced(train: Recording, verify: &Recording, own: Vec<OwnEffect>) -> Result<Trace, BadInput> {
        trace_with(&[train], verify, &Options { own, ..Options::default() })
    }

    #[test]
    fn an_effect_that_is_there_is_named_and_one_that_is_not_is_refused() {
        let own = || {
            // A sawtooth in time that belongs to nothing.
            let useless = |s: &States<'_>| Ok(vec![s.time_s().iter().map(|t| (t / 731.0).fract()).collect()]);
            vec![
                OwnEffect::new("mount-resonance", None, peak).expect("fine"),
                OwnEffect::new("moon", None, useless).expect("fine"),
            ]
        };
        let (train, verify) = (with(plan("cycle", 121), 2.0), with(plan("verify", 122), 2.0));
        let t = traced(train, &verify, own()).expect("traces");
        let names: Vec<&str> = t.report.effects.iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names, ["mount-resonance"], "{}", t.report.verdict);
        let found = &t.report.effects[0];
        assert_eq!((found.class, found.confirmed), (Class::Own, Some(true)));
        for (axis, g) in &found.axes {
            assert!((g.gain - 2.0).abs() < 4.0 * g.gain_std.max(0.02), "{axis}: {} +- {}", g.gain, g.gain_std);
        }
        // An image cannot hold it; what a unit has may do the same.
        assert!(t.image.effects.iter().all(|e| e.id < FIRST_ID), "{:?}", t.image.effects);
        assert!(t.report.verdict.contains("mount-resonance is your own"), "{}", t.report.verdict);
        // On clean units neither is warranted.
        let clean = traced(plan("cycle", 123), &plan("verify", 124), own()).expect("traces").report;
        assert!(clean.effects.is_empty(), "{}", clean.verdict);
    }

    #[test]
    fn of_several_values_the_right_one_is_named() {
        let wide = |s: &States<'_>| {
            let width = s.parameter.unwrap_or(1.0);
            let centre = [4906.0, 4898.0, 4709.6][s.axis];
            Ok(vec![s.frequency_hz().iter().map(|f| 1.0 / (1.0 + ((f - centre) / width).powi(2))).collect()])
        };
        let parameter = Some(("width_hz".to_string(), vec![0.5, 1.5, 4.5]));
        let own = vec![OwnEffect::new("resonance", parameter, wide).expect("fine")];
        let t = traced(with(plan("cycle", 129), 2.0), &with(plan("verify", 130), 2.0), own).expect("traces");
        let found = t.report.effects.iter().find(|e| e.name == "resonance").expect(&t.report.verdict);
        assert_eq!(found.parameters["width_hz"], 1.5);
    }

    #[test]
    fn a_useless_one_with_several_values_is_refused() {
        let lagged = |s: &States<'_>| {
            let tau = s.parameter.unwrap_or(1.0);
            let mut state = f64::NAN;
            let mut out = Vec::new();
            for r in s.ramp_c_per_min(s.axis) {
                state = if state.is_nan() { r } else { state + (r - state) * s.step_s() / tau };
                out.push(state * state);
            }
            Ok(vec![out])
        };
        let parameter = Some(("tau_s".to_string(), vec![300.0, 1200.0, 4800.0]));
        let own = vec![OwnEffect::new("lagged-squared-ramp", parameter, lagged).expect("fine")];
        let t = traced(plan("cycle", 125), &plan("verify", 126), own).expect("traces");
        // (Nothing of it is in the run.)
        assert!(t.report.effects.is_empty(), "{}", t.report.verdict);
    }

    #[test]
    fn what_cannot_be_used_is_a_sentence_with_the_name() {
        let of = |f: fn(&States<'_>) -> Computed| vec![OwnEffect::new("mine", None, f).expect("fine")];
        let (train, verify) = (plan("cycle", 127), plan("verify", 128));
        for (own, wanted) in [
            (of(|_| Err("ZeroDivisionError: division by zero".into())), "own effect mine, axis x: ZeroDivisionError"),
            (of(|_| Ok(vec![])), "0 columns; give 1 to 14"),
            (of(|_| Ok(vec![vec![0.0; 3]])), "a column has 3 values"),
            (of(|s| Ok(vec![vec![f64::NAN; s.run.thermal.len()]])), "no finite value"),
            ([of(peak), of(peak)].concat(), "own effect mine is there twice"),
        ] {
            let why = traced(train.clone(), &verify, own).map(|t| t.report.verdict).expect_err(wanted);
            assert!(why.0.contains(wanted), "{why}");
        }
        for (name, values) in [("", vec![1.0]), ("kink", vec![1.0]), ("mine", vec![]), ("mine", vec![f64::NAN])] {
            assert!(OwnEffect::new(name, Some(("p".into(), values)), peak).is_err(), "{name}");
        }
    }
}
