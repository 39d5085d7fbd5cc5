//! Closes the loop: baseline fit, residual, the effects that the model lacks, refit, before and after.
//!
//! The method is written down in `docs/trace.md`. In short: models are compared by their likelihood under coloured
//! noise ([`gls`]), searched by beam ([`search`]), judged against surrogates, and only evaluated on the verify run.

pub mod data;
pub mod gls;
mod html;
mod leftover;
pub mod search;
pub mod separable;

pub use html::html;

use crate::fit::{self, prepare, Prepared, MEAN_S};
use crate::recording::Recording;
use crate::run::{Run, Steps};
use crate::stats::{block_means, std_dev};
use crate::{BadInput, AXIS_NAMES};
use data::{Candidate, Data};
use gls::COLOURS;
use hrg_core::bias::{Coefficients, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm, MAX_EFFECTS};
use hrg_core::effects::{Reach, MAX_OUTPUTS};
use hrg_core::AXES;
use search::Search;
use serde::Serialize;
use std::collections::BTreeMap;

/// Difference in log-likelihood below which two effects count as told apart by nothing: odds of 55 to 1.
const INDISTINGUISHABLE: f64 = 4.0;

/// RMS figures of one axis, deg/h.
#[derive(Debug, Clone, Copy, Serialize, Default, PartialEq)]
pub struct Rms {
    /// On the train runs.
    pub train_rms_dph: f64,
    /// On the verify run.
    pub verify_rms_dph: f64,
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
}

/// One entry of the ranking.
#[derive(Debug, Clone, Serialize)]
pub struct Ranked {
    /// Effect.
    pub name: String,
    /// Reduction of the cross-validated squared error, as a share.
    pub gain_in_cv: f64,
    /// Gain in log-likelihood less penalty.
    pub worth: f64,
}

/// One effect found.
#[derive(Debug, Clone, Serialize)]
pub struct Found {
    /// Name.
    pub name: String,
    /// Inner parameters, by name with unit.
    pub parameters: BTreeMap<String, f64>,
    /// Gains by axis.
    pub axes: BTreeMap<String, Gain>,
    /// The candidates for its place, best first.
    pub rank: Vec<Ranked>,
    /// Effects that this profile cannot tell from it.
    pub indistinguishable_from: Vec<String>,
    /// Chance that the library finds as much by luck.
    pub chance_by_luck: f64,
    /// `unit`: goes into the block; `needs ...`: the unit does not measure it; `unpredictable`: to be mended.
    pub reach: String,
}

/// The report of `hrg trace`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Version of the report.
    pub version: u32,
    /// Unit.
    pub unit: String,
    /// Baseline model alone.
    pub baseline: BTreeMap<String, Rms>,
    /// What it lacks.
    pub effects: Vec<Found>,
    /// Baseline and effects.
    pub r#final: BTreeMap<String, Rms>,
    /// What the unit alone reaches on the verify run: effects that it cannot compute left out.
    pub unit_alone: BTreeMap<String, Rms>,
    /// Standard deviation of 100 s means of the noise, as estimated.
    pub noise_floor_dph: BTreeMap<String, f64>,
    /// Whether structure is left.
    pub unexplained: BTreeMap<String, bool>,
    /// Where it is left, in words.
    pub left_over: BTreeMap<String, Vec<String>>,
    /// What to do.
    pub advice: Vec<String>,
    /// What the user should know of the data.
    pub notes: Vec<String>,
    /// The verdict in two sentences.
    pub verdict: String,
}

/// Everything that came of a trace.
#[derive(Debug)]
pub struct Trace {
    /// The report.
    pub report: Report,
    /// Baseline only.
    pub baseline: Calibration,
    /// Baseline and the effects that a unit can compute.
    pub extended: Calibration,
    /// The verify run, for pictures.
    pub verify: Run,
    /// Residuals of the train runs, before and after, one value a step.
    pub train_residuals: [Vec<[Vec<f64>; AXES]>; 2],
    /// Residuals of the verify run, before and after.
    pub verify_residuals: [[Vec<f64>; AXES]; 2],
    /// The train runs.
    pub train: Vec<Run>,
}

/// The report as JSON.
#[must_use]
pub fn json(report: &Report) -> String {
    // A report is plain data: it always serialises.
    serde_json::to_string_pretty(report).unwrap_or_default()
}

/// A fitted model of the bias.
#[derive(Debug, Clone)]
struct Fitted {
    effects: Vec<Candidate>,
    /// Per axis: baseline coefficients, then the gains of each effect in order.
    coefficients: [Vec<f64>; AXES],
    std: [Vec<f64>; AXES],
}

impl Fitted {
    /// Where the gains of effect `e` begin.
    fn offset(&self, e: usize) -> usize {
        TERMS + self.effects[..e].iter().map(|c| c.facts.outputs).sum::<usize>()
    }

    /// The bias of a run, of those effects that `which` lets through, on every step.
    fn bias(
        &self,
        run: &Run,
        scaling: &hrg_core::bias::Scaling,
        a: usize,
        which: &dyn Fn(&Candidate) -> bool,
    ) -> Vec<f64> {
        let mut out = vec![0.0; run.steps.len()];
        for (column, k) in fit::baseline_columns(run, scaling, a).iter().zip(&self.coefficients[a]) {
            for (o, x) in out.iter_mut().zip(column) {
                *o += k * x;
            }
        }
        for (e, c) in self.effects.iter().enumerate().filter(|(_, c)| which(c)) {
            let at = self.offset(e);
            for (o, x) in out.iter_mut().zip(run.effect(c.facts.id, &c.parameters, scaling, a)) {
                for (j, v) in x.iter().take(c.facts.outputs).enumerate() {
                    *o += self.coefficients[a][at + j] * f64::from(*v);
                }
            }
        }
        out
    }
}

/// Generalised least squares of a model on exact columns. A candidate confined to one run is zero elsewhere.
fn final_fit(data: &Data<'_>, effects: &[Candidate], colours: [usize; AXES]) -> Result<Fitted, BadInput> {
    let mut out = Fitted { effects: effects.to_vec(), coefficients: Default::default(), std: Default::default() };
    for a in 0..AXES {
        let rows = &data.axes[a];
        let mut columns = rows.base.clone();
        let mut names: Vec<&str> = fit::NAMES.to_vec();
        for c in effects {
            columns.extend(data.columns(c, a, true).unwrap_or_default());
            names.extend(std::iter::repeat_n(c.facts.name, c.facts.outputs));
        }
        let mut y = rows.y.clone();
        let colour = COLOURS[colours[a]];
        columns.iter_mut().for_each(|c| colour.whiten(c, &rows.starts));
        colour.whiten(&mut y, &rows.starts);
        let fit = crate::lsq::fit(&columns, &y, None, &names)
            .map_err(|e| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a])))?;
        out.coefficients[a] = fit.coefficients;
        out.std[a] = fit.std;
    }
    Ok(out)
}

fn into_block(base: &Calibration, fitted: &Fitted, notes: &mut Vec<String>) -> Calibration {
    let mut c = base.clone();
    c.effects.clear();
    for a in 0..AXES {
        c.axes[a].coefficients = Coefficients::One(std::array::from_fn(|j| fitted.coefficients[a][j] as f32));
        c.axes[a].coefficient_std = [std::array::from_fn(|j| fitted.std[a][j] as f32), [0.0; TERMS]];
    }
    for (e, candidate) in fitted.effects.iter().enumerate().filter(|(_, c)| search::on_unit(c)) {
        let at = fitted.offset(e);
        let mut term = EffectTerm {
            id: candidate.facts.id,
            parameters: candidate.parameters,
            gains: [[0.0; MAX_OUTPUTS]; AXES],
            gain_std: [[0.0; MAX_OUTPUTS]; AXES],
        };
        for a in 0..AXES {
            for j in 0..candidate.facts.outputs {
                term.gains[a][j] = fitted.coefficients[a][at + j] as f32;
                term.gain_std[a][j] = fitted.std[a][at + j] as f32;
            }
        }
        if c.effects.push(term).is_err() {
            notes.push(format!("a block holds {MAX_EFFECTS} effects; {} did not fit", candidate.facts.name));
        }
    }
    c
}

/// Residuals of a run.
fn residuals(
    run: &Run,
    scaling: &hrg_core::bias::Scaling,
    fitted: &Fitted,
    which: &dyn Fn(&Candidate) -> bool,
) -> [Vec<f64>; AXES] {
    [0, 1, 2].map(|a| {
        let bias = fitted.bias(run, scaling, a, which);
        run.steps.rate_dph[a].iter().zip(bias).map(|(r, b)| r - b).collect()
    })
}

/// Standard deviation of 100 s means over runs.
fn spread<'s>(series: impl IntoIterator<Item = &'s Vec<f64>>) -> f64 {
    let means: Vec<f64> = series.into_iter().flat_map(|s| block_means(s, MEAN_S)).collect();
    std_dev(&means)
}

/// Traces what the baseline lacks.
///
/// # Errors
/// One sentence: recordings that cannot be used, or a run that cannot hold the baseline down.
pub fn trace(train: &[Recording], verify: &Recording) -> Result<Trace, BadInput> {
    let Prepared { runs, mut calibration, mut notes, lag_s, .. } = prepare(train)?;
    if verify.corrected() {
        return Err(BadInput::new("the verify recording holds corrected rates; give the raw one"));
    }
    if let Some(first) = train.first() {
        if first.unit() != verify.unit() {
            notes.push(format!("the verify run is of unit {}, the train run of {}", verify.unit(), first.unit()));
        }
    }
    let laws = [0, 1, 2].map(|a: usize| calibration.axes[a].law);
    let verify_run = Run::new(Steps::new(verify)?, laws);
    let scaling = calibration.scaling;
    calibration.sequence = 1;

    let data = Data::new(&runs, scaling, lag_s.iter().sum::<f64>() / AXES as f64);
    if let Some(a) = (0..AXES).find(|&a| data.axes[a].y.len() < 40) {
        return Err(BadInput::new(format!(
            "axis {}: only {} usable means in the train runs; record some hours",
            AXIS_NAMES[a],
            data.axes[a].y.len()
        )));
    }
    let search = Search::new(&data, 20_231_106);
    let model = search.run();

    // Ranks before the final fit: an equal that is better gives its name.
    let ranks: Vec<Vec<(Candidate, f64)>> = (0..model.effects.len()).map(|k| search.instead_of(&model, k)).collect();
    let mut model = model;
    for (k, rank) in ranks.iter().enumerate() {
        if let Some((top, _)) = rank.first() {
            if top.facts.id != model.effects[k].facts.id {
                let mut other = model.effects.clone();
                other[k] = *top;
                let (worth, colours) = search.worth(&other);
                if worth > model.worth {
                    model.effects = other;
                    model.worth = worth;
                    model.colours = colours;
                }
            }
        }
    }

    let baseline_fit = final_fit(&data, &[], [0; AXES])?;
    let fitted = final_fit(&data, &model.effects, model.colours)?;

    let all = |_: &Candidate| true;
    let known = |c: &Candidate| c.facts.reach != Reach::Unpredictable;
    let unit = |c: &Candidate| search::on_unit(c);
    let before_train: Vec<_> = runs.iter().map(|r| residuals(r, &scaling, &baseline_fit, &all)).collect();
    let after_train: Vec<_> =
        runs.iter().enumerate().map(|(n, r)| residuals(r, &scaling, &confined(&fitted, n), &all)).collect();
    let before_verify = residuals(&verify_run, &scaling, &baseline_fit, &all);
    // A quantity that the verify run lacks cannot be taken off there.
    let has = |c: &Candidate| known(c) && run_has(&verify_run, c, &scaling);
    let after_verify = residuals(&verify_run, &scaling, &fitted, &has);
    let unit_verify = residuals(&verify_run, &scaling, &fitted, &unit);

    let rms = |train: &[[Vec<f64>; AXES]], verify: &[Vec<f64>; AXES], a: usize| Rms {
        train_rms_dph: spread(train.iter().map(|r| &r[a])),
        verify_rms_dph: spread([&verify[a]]),
    };
    let table = |train: &[[Vec<f64>; AXES]], verify: &[Vec<f64>; AXES]| -> BTreeMap<String, Rms> {
        (0..AXES).map(|a| (AXIS_NAMES[a].to_string(), rms(train, verify, a))).collect()
    };
    let baseline = table(&before_train, &before_verify);
    let last = table(&after_train, &after_verify);
    let unit_alone = table(&after_train, &unit_verify);

    let mut left = leftover::judge(&data, &model, &fitted, &after_train);
    if fitted.effects.iter().all(known) {
        for (a, left) in left.iter_mut().enumerate() {
            leftover::judge_verify(left, last[AXIS_NAMES[a]].verify_rms_dph);
        }
    }
    let unexplained: BTreeMap<String, bool> =
        (0..AXES).map(|a| (AXIS_NAMES[a].to_string(), !left[a].where_it_lives.is_empty())).collect();
    let noise_floor_dph = (0..AXES).map(|a| (AXIS_NAMES[a].to_string(), left[a].floor_dph)).collect();

    let alike = search.alike(&model.effects);
    let mut effects = Vec::new();
    for (k, c) in model.effects.iter().enumerate() {
        let others: Vec<Candidate> =
            model.effects.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, e)| *e).collect();
        // Told apart by the data, not by the penalty: likelihoods are compared.
        let likelihood = |(r, worth): &(Candidate, f64)| worth + search.cost(r);
        let own = ranks[k].iter().find(|(r, _)| r.facts.id == c.facts.id).map_or(0.0, likelihood);
        let at = fitted.offset(k);
        effects.push(Found {
            name: c.facts.name.to_string(),
            parameters: c
                .facts
                .parameters
                .iter()
                .zip(c.parameters)
                .map(|(n, v)| ((*n).to_string(), f64::from(v)))
                .collect(),
            axes: (0..AXES)
                .map(|a| {
                    let gains = fitted.coefficients[a][at..at + c.facts.outputs].to_vec();
                    let gain = Gain { gain: gains[0], gain_std: fitted.std[a][at], gains };
                    (AXIS_NAMES[a].to_string(), gain)
                })
                .collect(),
            rank: ranks[k]
                .iter()
                .map(|(r, worth)| Ranked {
                    name: r.facts.name.to_string(),
                    gain_in_cv: search.cross_validated_gain(&others, r, model.colours),
                    worth: *worth,
                })
                .collect(),
            indistinguishable_from: ranks[k]
                .iter()
                .filter(|r| r.0.facts.id != c.facts.id && r.1 > 0.0 && own - likelihood(r) < INDISTINGUISHABLE)
                .map(|(r, _)| r.facts.name)
                .chain(alike.iter().filter(|(_, e)| *e == k).map(|(n, _)| *n))
                .collect::<std::collections::BTreeSet<_>>()
                .into_iter()
                .map(String::from)
                .collect(),
            chance_by_luck: model.luck.get(k).copied().unwrap_or(f64::NAN),
            reach: match c.facts.reach {
                Reach::Unit => "unit".into(),
                Reach::NeedsInput(what) => format!("needs {what}"),
                Reach::Unpredictable => "unpredictable".into(),
            },
        });
    }

    let stamp = |c: &mut Calibration, rms: &BTreeMap<String, Rms>| {
        for (a, n) in AXIS_NAMES.iter().enumerate() {
            c.axes[a].train_rms_dph = rms[*n].train_rms_dph as f32;
            c.axes[a].verify_rms_dph = rms[*n].verify_rms_dph as f32;
        }
    };
    let mut base_block = into_block(&calibration, &baseline_fit, &mut notes);
    stamp(&mut base_block, &baseline);
    let mut extended = into_block(&calibration, &fitted, &mut notes);
    extended.sequence = 2;
    stamp(&mut extended, &unit_alone);

    let advice = advice(&effects, &left);
    let verdict = verdict(&effects, &baseline, &last, &unexplained);
    let report = Report {
        version: 1,
        unit: train.first().map_or("unnamed", Recording::unit).to_string(),
        baseline,
        effects,
        r#final: last,
        unit_alone,
        noise_floor_dph,
        unexplained,
        left_over: (0..AXES).map(|a| (AXIS_NAMES[a].to_string(), left[a].where_it_lives.clone())).collect(),
        advice,
        notes,
        verdict,
    };
    Ok(Trace {
        report,
        baseline: base_block,
        extended,
        verify: verify_run,
        train_residuals: [before_train, after_train],
        verify_residuals: [before_verify, after_verify],
        train: runs,
    })
}

/// The model as run number `n` sees it: effects confined to another run have no gain there.
fn confined(f: &Fitted, n: usize) -> Fitted {
    let mut out = f.clone();
    for (e, c) in f.effects.iter().enumerate() {
        if c.run.is_some_and(|r| r != n) {
            let at = f.offset(e);
            for a in 0..AXES {
                out.coefficients[a][at..at + c.facts.outputs].fill(0.0);
            }
        }
    }
    out
}

fn run_has(run: &Run, c: &Candidate, scaling: &hrg_core::bias::Scaling) -> bool {
    c.facts.reach == Reach::Unit
        || (0..AXES).all(|a| {
            let values = run.effect(c.facts.id, &c.parameters, scaling, a);
            values.iter().filter(|v| v[0].is_finite()).count() * 10 > values.len() * 9
        })
}

fn list(names: &[String]) -> String {
    match names {
        [] => "nothing".into(),
        [one] => one.clone(),
        [rest @ .., last] => format!("{} and {last}", rest.join(", ")),
    }
}

fn verdict(
    effects: &[Found],
    before: &BTreeMap<String, Rms>,
    after: &BTreeMap<String, Rms>,
    unexplained: &BTreeMap<String, bool>,
) -> String {
    let mean = |t: &BTreeMap<String, Rms>| t.values().map(|r| r.verify_rms_dph).sum::<f64>() / t.len() as f64;
    let (b, a) = (mean(before), mean(after));
    let left: Vec<String> = unexplained.iter().filter(|(_, u)| **u).map(|(n, _)| n.clone()).collect();
    let rest = if left.is_empty() {
        "what is left is noise".to_string()
    } else {
        format!("on {} structure is left that no effect of the library explains", list(&left))
    };
    if effects.is_empty() {
        return format!("The baseline model is all that these data warrant: {b:.3} deg/h on the run it never saw (100 s means, mean of the axes). Of the residual: {rest}.");
    }
    let names: Vec<String> = effects
        .iter()
        .map(|e| match e.parameters.iter().next().filter(|_| e.name != "temperature-shape") {
            Some((n, v)) => format!("{} ({n} {v:.0})", e.name),
            None => e.name.clone(),
        })
        .collect();
    let mend: Vec<String> = effects.iter().filter(|e| e.reach != "unit").map(|e| e.name.clone()).collect();
    let act = if mend.is_empty() {
        "burn the extended block".to_string()
    } else {
        format!("mend {} at its cause, the unit cannot compensate it", list(&mend))
    };
    format!(
        "The model lacks {}: with it the run it never saw goes from {b:.3} to {a:.3} deg/h (100 s means, mean of the axes), and {rest}. To do: {act}.",
        list(&names)
    )
}

fn advice(effects: &[Found], left: &[leftover::Left; AXES]) -> Vec<String> {
    let mut out = Vec::new();
    for e in effects {
        for twin in &e.indistinguishable_from {
            out.push(format!("{} and {twin} look alike on this profile: {}", e.name, parting(&e.name, twin)));
        }
        match e.name.as_str() {
            "step" => out.push(format!(
                "something changed at {:.0} s: look what was switched, bumped or came loose then; the step is taken out of the fit and not compensated",
                e.parameters.get("time_s").copied().unwrap_or(f64::NAN)
            )),
            "periodic" => out.push(format!(
                "look for a source with a period of {:.0} s: the chamber's compressor or heater, a beat between neighbours; it is taken out of the fit and not compensated",
                e.parameters.get("period_s").copied().unwrap_or(f64::NAN)
            )),
            "aging" => out.push("the rates drift with time: repeat the run after some days to see whether it goes on; it is taken out of the fit and not compensated".into()),
            "case-gradient" | "timebase" => out.push(format!("{} needs the shell sensors, which the unit does not read: wire them to the unit, or give the case time to settle", e.name)),
            "drive-amplitude" | "quadrature" | "board" => out.push(format!("{} needs a voltage that the unit does not read: bring it to a spare converter channel", e.name)),
            _ => {}
        }
    }
    for (a, l) in left.iter().enumerate() {
        if !l.where_it_lives.is_empty() {
            out.push(format!(
                "axis {}: structure is left {}; a repeat of the same run tells whether it belongs to the unit or to that day",
                AXIS_NAMES[a],
                list(&l.where_it_lives)
            ));
        }
    }
    out
}

/// Which profile parts two effects.
fn parting(a: &str, b: &str) -> String {
    let memory = |n: &str| {
        matches!(
            n,
            "thermal-lag"
                | "hysteresis"
                | "second-derivative"
                | "case-gradient"
                | "axis-gradient"
                | "timebase"
                | "board"
        )
    };
    let shape = |n: &str| matches!(n, "cubic" | "kink" | "temperature-shape");
    let clock = |n: &str| matches!(n, "warm-up" | "aging" | "step" | "periodic");
    if memory(a) && memory(b) {
        "a run with ramps of two speeds (0.5 and 3 C per minute) and long soaks between parts them: a lag scales with speed and dies out on a soak, a hysteresis does neither".into()
    } else if shape(a) && shape(b) {
        "a run that reaches further on both ends, with soaks each 10 C, parts them".into()
    } else if clock(a) || clock(b) {
        "a second run with the same profile, started after the unit has been on for hours, parts what belongs to the clock from what belongs to temperature".into()
    } else {
        "a run that passes the same temperatures in both directions and at two speeds parts them".into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{soil, EffectSpec, Plan, Profile};

    fn plan(profile: &str, effects: &[&str], unit: u64, seed: u64) -> Recording {
        let plan = Plan {
            effects: effects.iter().map(|e| EffectSpec::parse(e).expect("known")).collect(),
            ..Plan::of(Profile::parse(profile).expect("named"), unit, seed)
        };
        plan.simulate().recording
    }

    fn traced(effects: &[&str], unit: u64) -> Report {
        trace(&[plan("cycle", effects, unit, unit * 2 + 1)], &plan("verify", effects, unit, unit * 2 + 2))
            .expect("traces")
            .report
    }

    fn names(r: &Report) -> Vec<&str> {
        r.effects.iter().map(|e| e.name.as_str()).collect()
    }

    #[test]
    fn each_effect_that_is_put_in_comes_out() {
        for (k, name) in
            ["cubic", "kink", "thermal-lag", "hysteresis", "axis-gradient", "warm-up", "step", "periodic", "aging"]
                .into_iter()
                .enumerate()
        {
            let r = traced(&[&format!("{name}:size=3")], 40 + k as u64);
            assert_eq!(names(&r), [name], "{}", r.verdict);
            assert!(r.unexplained.values().all(|u| !u), "{name}: {:?}", r.left_over);
        }
    }

    #[test]
    fn two_effects_are_parted() {
        let r = traced(&["kink:size=3", "warm-up:size=3"], 70);
        let mut found = names(&r);
        found.sort_unstable();
        assert_eq!(found, ["kink", "warm-up"]);
    }

    #[test]
    fn on_clean_units_nothing_is_invented() {
        for unit in 80..90 {
            let r = traced(&[], unit);
            assert!(r.effects.is_empty() && r.unexplained.values().all(|u| !u), "unit {unit}: {}", r.verdict);
        }
    }

    #[test]
    fn what_the_library_lacks_is_called_so() {
        for (k, name) in ["outsider-product", "outsider-drift-burst", "outsider-ripple"].into_iter().enumerate() {
            let r = traced(&[&format!("{name}:size=4")], 95 + k as u64);
            let caught = r.unexplained.values().any(|u| *u) || names(&r).contains(&"temperature-shape");
            assert!(caught, "{name}: {}", r.verdict);
        }
    }

    #[test]
    fn dirt_changes_neither_name_nor_error() {
        let effects = ["thermal-lag:size=3"];
        let (train, verify) = (plan("cycle", &effects, 7, 15), plan("verify", &effects, 7, 16));
        let mut dirty = train.clone();
        soil(&mut dirty, 3);
        dirty.clean().expect("usable");
        assert!(dirty.notes.len() >= 10, "{:?}", dirty.notes);
        let clean = trace(&[train], &verify).expect("traces").report;
        let soiled = trace(&[dirty], &verify).expect("traces").report;
        assert_eq!(names(&clean), names(&soiled));
        for a in AXIS_NAMES {
            let ratio = soiled.r#final[a].verify_rms_dph / clean.r#final[a].verify_rms_dph;
            assert!((ratio - 1.0).abs() < 0.05, "{a}: {ratio}");
        }
    }

    #[test]
    fn the_block_computes_what_the_fit_did() {
        let effects = ["hysteresis:size=4", "kink:size=3"];
        let t = trace(&[plan("cycle", &effects, 9, 19)], &plan("verify", &effects, 9, 20)).expect("traces");
        let by_unit = crate::correct::correct(&t.extended, &t.verify.steps);
        for a in 0..AXES {
            let largest = by_unit
                .iter()
                .zip(&t.verify.steps.rate_dph[a])
                .map(|(s, rate)| rate - f64::from(s.bias_dph[a]))
                .zip(&t.verify_residuals[1][a])
                .map(|(u, f)| (u - f).abs())
                .filter(|d| d.is_finite())
                .fold(0.0, f64::max);
            // Coefficients of a few deg/h in single precision.
            assert!(largest < 1e-4, "axis {a}: {largest} deg/h");
        }
    }
}
