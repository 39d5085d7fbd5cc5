//! Unknown start states. A unit that is switched on warm, or a log that begins in a ramp, begins with lags in a state that the recording
//! does not tell. If the rates show a memory, the beginning of such a run is left out of fit and judgement, until a
//! twentieth of that state is left.

use super::data::{AxisRows, Candidate, Data};
use super::model::Fitted;
use super::noise::{Filters, UNKNOWN};
use super::odds::{LEVEL, THRESHOLD};
use super::regression::posterior;
use super::search::{Model, Search};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::{self, span, EffectId, Facts, Span};
use hrg_core::visited::TEMPERATURES;
use hrg_core::AXES;
use hrg_data::cards::{card, Class, ParameterRow};
use hrg_data::recording::steps::{Run, Steps};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Largest share of a run that is left out: a slow memory would leave nothing to learn it from.
const MOST: f64 = 0.25;

/// The memory that a model has, by its longest time constant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Memory {
    name: &'static str,
    /// The effect that has it.
    pub effect: EffectId,
    tau_s: f64,
}

impl Memory {
    /// The slowest of a model.
    pub(super) fn of<'c>(effects: impl Iterator<Item = &'c Candidate>) -> Option<Self> {
        let of = |c: &Candidate| {
            let tau_s = memory_s(c.facts, &c.parameters)?;
            Some(Self { name: c.facts.name, effect: c.facts.effect, tau_s })
        };
        effects.filter_map(of).max_by(|x, y| x.tau_s.total_cmp(&y.tau_s))
    }

    /// A decay from the first block of a run on, on the rows of an axis.
    fn decay_of_run(self, data: &Data<'_>, number: usize, a: usize) -> Vec<f64> {
        let rows = &data.axes[a];
        let of_run = rows.run(number);
        let first = rows.keep.get(of_run.start).copied().unwrap_or(0);
        let decay = |at: usize| (-(((rows.keep[at] - first) * data.block_s) as f64) / self.tau_s).exp();
        (0..rows.y.len()).map(|at| if of_run.contains(&at) { decay(at) } else { 0.0 }).collect()
    }

    /// Log evidence of a decay from the first block of a run on, in a residual of an axis: the mean over the noise models.
    fn decay(self, data: &Data<'_>, number: usize, left: &[f64], a: usize) -> f64 {
        let rows = &data.axes[a];
        let std::ops::Range { start: from, end: to } = rows.run(number);
        if to < from + 3 {
            return 0.0;
        }
        let forgotten: Vec<Vec<f64>> = rows.forgotten.iter().map(|c| c[from..to].to_vec()).collect();
        let of_run = AxisRows {
            keep: rows.keep[from..to].to_vec(),
            starts: vec![0],
            y: left[from..to].to_vec(),
            base: vec![],
            filters: Filters::new(&data.relative(a)[from..to], &[0]).beside(&forgotten),
            forgotten,
            happened: vec![],
        };
        let constant = vec![1.0; to - from];
        let column = self.decay_of_run(data, number, a)[from..to].to_vec();
        let with = posterior(&of_run, &[constant.clone(), column], &[None, Some(UNKNOWN)]);
        let without = posterior(&of_run, &[constant], &[None]);
        with.zip(without).map_or(0.0, |(w, o)| w.evidence - o.evidence)
    }

    /// Leaves out the beginning of a run; a sentence says so. `what` names the run. With `learnt`, the run is learnt from: it stays whole
    /// where nothing later passes the same temperatures in the same direction.
    pub(super) fn leave_out(self, run: &mut Run, what: &str, learnt: bool) -> String {
        let seconds = remembered_s(self.tau_s, run.steps.len());
        if learnt {
            if passed(run, 0) != passed(run, seconds) {
                return format!(
                    "{what} begins in a state of {} (time constant {:.0} s) that it does not tell; its beginning is kept, as nothing later passes those temperatures in that direction: record a run that begins with a soak",
                    self.name, self.tau_s
                );
            }
        }
        run.steps.rate_dph.iter_mut().for_each(|r| r[..seconds].fill(f64::NAN));
        run.steps.run_in = seconds;
        format!(
            "{what} begins in a state of {} (time constant {:.0} s) that it does not tell: its first {seconds} s are left out of fit and judgement",
            self.name, self.tau_s
        )
    }
}

/// Longest time constant of an effect, s; `None` where it has no memory.
fn memory_s(facts: &Facts, parameters: &ParameterRow) -> Option<f64> {
    match span(facts.id, parameters) {
        Span::Time(tau_s) if card(facts.effect).class == Class::Memory => Some(f64::from(tau_s)),
        _ => None,
    }
}

/// Seconds of so many for which a memory of a time constant keeps what a recording does not tell: more than a share of [`LEVEL`] of it.
fn remembered_s(tau_s: f64, of: usize) -> usize {
    (-LEVEL.ln() * tau_s).min(MOST * of as f64) as usize
}

/// A run that judges, without the rates behind its gaps for as long as a model remembers: its error there is not known.
pub(super) fn without_behind_gaps(run: &Run, memory: Option<Memory>) -> Cow<'_, Run> {
    let gaps = run.steps.present().any(|a| run.steps.lost(a).next().is_some());
    let Some(memory) = memory.filter(|_| gaps) else { return Cow::Borrowed(run) };
    let mut without = run.clone();
    without.steps.leave_out_behind_gaps(remembered_s(memory.tau_s, run.steps.len()));
    Cow::Owned(without)
}

/// Takes the rates out of a recording behind its gaps for as long as an image remembers: its error there is not known.
pub fn leave_out_behind_gaps(image: &Calibration, steps: &mut Steps) {
    let of = |t: &EffectTerm| memory_s(effects::by_id(t.id)?, &t.parameters);
    if let Some(tau_s) = image.effects.iter().filter_map(of).max_by(f64::total_cmp) {
        steps.leave_out_behind_gaps(remembered_s(tau_s, steps.len()));
    }
}

/// Eighths of the temperature range of a run that each axis passes from a step on, by the sign of the ramp: those of the image's
/// [map](hrg_core::visited).
fn passed(run: &Run, from: usize) -> BTreeSet<(usize, usize, bool)> {
    let of = |a: usize| {
        let (low_c, high_c) = run.temperature_range(a);
        let eighth = move |t: f32| ((t - low_c) / (high_c - low_c) * TEMPERATURES as f32) as usize;
        let states = (from..run.steps.len()).filter_map(move |k| run.state(k, a));
        states.map(move |s| (a, eighth(s.0).min(TEMPERATURES - 1), s.1 > 0.0))
    };
    run.steps.present().flat_map(of).collect()
}

/// Runs that begin in an unknown state.
pub(super) struct Unknown {
    /// Marks them: each train run, then the verify run.
    pub runs: Vec<bool>,
    /// Log evidence of their decays.
    pub evidence: f64,
}

/// The runs that begin in an unknown state. `None` if none does. Such a run shows a decay of the
/// memory's time constant: a train run beside all else that the model has, the verify run in what the model's prediction leaves of it.
pub(super) fn unknown(
    search: &mut Search<'_>,
    model: &Model,
    fitted: &Fitted,
    verify: &Run,
    memory: Memory,
) -> Option<Unknown> {
    let data = search.data();
    let runs = data.runs.len();
    let mut evidence = vec![0.0; runs + 1];
    for a in 0..AXES {
        let decays = (0..runs).map(|n| vec![memory.decay_of_run(data, n, a)]).collect();
        let more = search.evidence_of(model, a, decays);
        evidence.iter_mut().zip(more).for_each(|(e, more)| *e += more);
    }
    let known = |c: &Candidate| super::run_has(verify, data.runs, c, &data.scaling);
    let on_verify = data.unseen(verify);
    let left = fitted.left(&on_verify, &known);
    evidence[runs] = verify.steps.present().map(|a| memory.decay(&on_verify, 0, &left[a], a)).sum();
    let each = data.runs.iter().chain([verify]).zip(evidence);
    let each: Vec<(bool, f64)> = each.map(|(run, e)| (run.steps.run_in == 0 && e > THRESHOLD, e)).collect();
    let evidence = each.iter().filter(|(unknown, _)| *unknown).map(|(_, e)| e).sum();
    let runs: Vec<bool> = each.into_iter().map(|(unknown, _)| unknown).collect();
    runs.contains(&true).then_some(Unknown { runs, evidence })
}
