//! Effects that nobody can predict, fitted again to the verify run: a step, a drift or a period of the day must not hide
//! what a model does to the rest, nor count in its favour. So they are taken out for the judgement, and stated apart.

use super::data::Candidate;
use super::means::Means;
use super::model::Term;
use super::report::Refitted;
use hrg_core::bias::Scaling;
use hrg_core::effects::parameters::{Moment, Parameters};
use hrg_core::effects::{EffectId, Facts, Reach};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::ParameterRow;
use hrg_data::numeric::lsq;
use hrg_data::recording::steps::Run;
use std::collections::BTreeMap;

/// Effects that nobody can predict, as a run shows them.
pub struct Happened {
    /// For the report.
    pub refitted: Vec<Refitted>,
    /// Each effect with the axes that have it.
    pub effects: Vec<(Candidate, [bool; AXES])>,
    /// The residual without them.
    pub left: [Vec<f64>; AXES],
    /// Their sum on each step of the run.
    pub sum_dph: [Vec<f64>; AXES],
}

/// Refits those terms that are unpredictable to the residual of a run, on the axes that have them, and takes them out of it.
pub fn refit(terms: &[Term], run: &Run, scaling: &Scaling, residual: &[Vec<f64>; AXES]) -> Happened {
    let mut rest = residual.clone();
    let mut sum_dph = residual.each_ref().map(|r| vec![0.0; r.len()]);
    let (mut out, mut effects) = (Vec::new(), Vec::new());
    let mut done: Vec<&str> = Vec::new();
    // (A shock that recovered is over.)
    let happens_again = |c: &Candidate| c.facts.reach == Reach::Unpredictable && c.facts.effect != EffectId::Shock;
    for t in terms.iter().filter(|t| happens_again(t.lead())) {
        let c = t.lead();
        // A second step or period of the train runs says nothing of the verify run's.
        if done.contains(&c.facts.name) {
            continue;
        }
        done.push(c.facts.name);
        let Some((parameters, gains)) = best(t, run, scaling, &rest) else { continue };
        for (a, rest) in rest.iter_mut().enumerate() {
            let x = run.effect(c.facts.id, &parameters, 0.0, scaling, a);
            for ((r, sum), x) in rest.iter_mut().zip(&mut sum_dph[a]).zip(x) {
                let of_effect = gains[a].iter().zip(x).map(|(g, v)| g * f64::from(v)).sum::<f64>();
                *r -= of_effect;
                *sum += of_effect;
            }
        }
        effects.push((Candidate { parameters, run: None, ..*c }, [0, 1, 2].map(|a: usize| t.on(a))));
        out.push(Refitted {
            name: c.facts.name.to_string(),
            parameters: on_clock_of(run, c.facts, &parameters),
            gains_dph: (0..AXES)
                .filter(|a| t.on(*a))
                .map(|a| (AXIS_NAMES[a].to_string(), gains[a].first().copied().unwrap_or(0.0)))
                .collect(),
        });
    }
    Happened { refitted: out, effects, left: rest, sum_dph }
}

/// Name of a parameter that is a time since power-on.
const TIME: &str = "time_s";

/// The inner parameters of an effect by name; a time is that of the recording's own clock.
pub fn on_clock_of(run: &Run, facts: &Facts, parameters: &ParameterRow) -> BTreeMap<String, f64> {
    let one = |(name, v): (&&str, &f32)| {
        let since_s = if *name == TIME { run.steps.power_on_s } else { 0.0 };
        ((*name).to_string(), f64::from(*v) + since_s)
    };
    facts.parameters.iter().zip(parameters).map(one).collect()
}

type Gains = [Vec<f64>; AXES];

/// Parameters and gains that leave least. A step is looked for at every mean, anything else keeps its parameters.
fn best(t: &Term, run: &Run, scaling: &Scaling, rest: &[Vec<f64>; AXES]) -> Option<(ParameterRow, Gains)> {
    let c = t.lead();
    let tries: Vec<ParameterRow> = if c.facts.effect == EffectId::Step {
        let mean_s = run.steps.mean_s;
        let means = run.thermal.len() / mean_s;
        (2..means.saturating_sub(2)).map(|k| Moment { time_s: run.thermal[k * mean_s].time_s }.row()).collect()
    } else {
        vec![c.parameters]
    };
    let means: Vec<Means> = rest.iter().map(|r| Means::of(r, run.steps.mean_s)).collect();
    tries
        .into_iter()
        .filter_map(|p| {
            let fits: Vec<Option<(Vec<f64>, f64)>> = (0..AXES)
                .map(|a| t.on(a).then(|| gains_of(c, &p, run, scaling, a, means[a].series())).flatten())
                .collect();
            let left: f64 = fits.iter().flatten().map(|f| f.1).sum();
            let gains = std::array::from_fn(|a| fits[a].as_ref().map_or_else(Vec::new, |f| f.0.clone()));
            fits.iter().any(Option::is_some).then_some((left, p, gains))
        })
        .min_by(|x, y| x.0.total_cmp(&y.0))
        .map(|(_, p, gains)| (p, gains))
}

/// Gains of an effect on the means of one axis beside a constant, and the squares that are left, in units of those before.
fn gains_of(
    c: &Candidate,
    parameters: &ParameterRow,
    run: &Run,
    scaling: &Scaling,
    a: usize,
    y: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let mut columns = vec![vec![1.0; y.len()]];
    if c.facts.effect == EffectId::Step {
        let moment = Moment::of(parameters);
        let mean_s = run.steps.mean_s;
        let t = |k: usize| run.thermal[(k * mean_s + mean_s / 2).min(run.thermal.len() - 1)].time_s;
        columns.push((0..y.len()).map(|k| if t(k) < moment.time_s { 0.0 } else { 1.0 }).collect());
    } else {
        let x = run.effect(c.facts.id, parameters, 0.0, scaling, a);
        for j in 0..c.facts.outputs {
            let column: Vec<f64> = x.iter().map(|v| f64::from(v[j])).collect();
            columns.push(Means::of(&column, run.steps.mean_s).series().to_vec());
        }
    }
    let before = Means::of_means(y).deviation().powi(2).max(1e-300);
    let fit = lsq::fit(&columns, y, None, &[]).ok()?;
    Some((fit.coefficients[1..].to_vec(), fit.squares / before))
}
