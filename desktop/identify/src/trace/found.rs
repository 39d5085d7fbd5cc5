//! The effects of a report: gains, rivals, and what the verify run says of each.

use super::data::Data;
use super::events::on_clock_of;
use super::judge::{borne_out, Agreement, Prediction};
use super::model::Fitted;
use super::odds;
use super::report::{ByAxis, Found, Gain, Ranked};
use super::search::{Rival, Search};
use super::stated::Stated;
use super::user_effects::card_of;
use super::{image, Candidate, Learnt};
use hrg_core::effects::parameters::{Bend, Parameters};
use hrg_core::effects::{EffectId, Reach};
use hrg_core::inputs::of_axis;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::Kind;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::std_dev;
use hrg_data::recording::names_of;
use hrg_data::recording::steps::{input_table, Run};
use std::collections::{BTreeMap, BTreeSet};

/// The run on which effects are confirmed.
pub(super) struct OnVerify<'v> {
    pub data: &'v Data<'v>,
    pub verify: &'v Data<'v>,
    pub run: &'v Run,
    pub known: &'v dyn Fn(&Candidate) -> bool,
}

impl OnVerify<'_> {
    /// Each effect. `whole`: the prediction of the model with all of them.
    pub fn found(
        &self,
        search: &Search<'_>,
        learnt: &Learnt,
        fitted: &Fitted,
        stated: &[Option<Stated>; AXES],
        whole: &Prediction,
    ) -> Result<Vec<Found>, BadInput> {
        let alike = search.alike(&learnt.model);
        let columns = [0, 1, 2].map(|a: usize| fitted.model.columns(self.data, a).values);
        let mut out = Vec::new();
        for (k, term) in fitted.terms().iter().enumerate() {
            let c = term.lead();
            let on_verify = if (self.known)(c) {
                let (fewer, fewer_known) = image::fitted(self.data, &fitted.model.without(k))?;
                let without = Prediction::new(self.verify, &fewer, &fewer_known, self.known);
                (0..AXES)
                    .filter(|&a| term.on(a))
                    .filter_map(|a| Some((AXIS_NAMES[a].to_string(), whole.against(&without, self.verify, a)?)))
                    .collect()
            } else {
                ByAxis::new()
            };
            let rank = &learnt.ranks[k];
            let own = rank
                .iter()
                .find(|r| r.candidate.facts.id == c.facts.id && r.candidate.parameters == c.parameters)
                .map_or(0.0, |r| r.score.log_evidence);
            // A family spans its simple members: they are no rivals.
            let family = |r: &Rival| card_of(r.candidate.facts).kind != Kind::Simple;
            let class = card_of(c.facts).class;
            let equal = rank
                .iter()
                .filter(|r| r.candidate.facts.id != c.facts.id && own - r.score.log_evidence < odds::THRESHOLD)
                .filter(|r| {
                    card_of(r.candidate.facts).class != class || !(family(r) || card_of(c.facts).kind != Kind::Simple)
                })
                .map(|r| r.candidate.facts.name)
                .chain(alike.iter().filter(|(_, e)| *e == k).map(|(n, _)| *n));
            let score = learnt.model.members[k].score;
            out.push(Found {
                name: c.facts.name.to_string(),
                class,
                parameters: on_clock_of(self.run_of(c), c.facts, &c.parameters),
                parameter_std: parameter_std(c, k, stated),
                axes: gains_by_axis(self.data, fitted, k, &columns),
                confirmed: (self.known)(c).then(|| {
                    let each: Vec<((), Agreement)> = on_verify.values().map(|a| ((), *a)).collect();
                    !borne_out(&each).is_empty() && !on_verify.values().any(Agreement::loses)
                }),
                on_verify,
                indistinguishable_from: equal.collect::<BTreeSet<_>>().into_iter().map(String::from).collect(),
                rank: rank
                    .iter()
                    .map(|r| Ranked {
                        name: r.candidate.facts.name.to_string(),
                        gain_in_cv: r.gain_in_cv,
                        score: r.score,
                    })
                    .collect(),
                p_value: odds::p_value(score.total()),
                score,
                reach: match c.facts.reach {
                    Reach::Unit => "unit".into(),
                    Reach::NeedsInput(_) if c.lacks.is_empty() => "unit".into(),
                    Reach::NeedsInput(_) => format!("needs {}", hrg_data::error::list(&names_of(c.lacks))),
                    Reach::NeedsChamber(what) => format!("needs {what}"),
                    Reach::Unpredictable => "unpredictable".into(),
                },
            });
        }
        Ok(out)
    }

    /// The run on whose clock the times of an effect are: the train run that it belongs to.
    fn run_of(&self, c: &Candidate) -> &Run {
        self.data.runs.get(c.run.unwrap_or(0)).unwrap_or(self.run)
    }
}

/// Standard deviations of the refined parameters of effect `k`, by name.
fn parameter_std(c: &Candidate, k: usize, stated: &[Option<Stated>; AXES]) -> BTreeMap<String, f64> {
    let Some(s) = stated.iter().flatten().next() else { return BTreeMap::new() };
    let each = c.facts.parameters.iter().zip(s.parameter_std[k]).zip(c.parameters);
    // (What the runs do not tell, as a threshold beyond all of their temperatures, has any deviation.)
    let told = |std: f64, value: f32| if std < 1000.0 * f64::from(value).abs().max(1.0) { std } else { f64::INFINITY };
    each.filter(|((_, std), _)| std.is_finite()).map(|((n, std), v)| ((*n).to_string(), told(std, v))).collect()
}

/// The gains of effect `k`. `columns`: those of the model on each axis.
fn gains_by_axis(data: &Data<'_>, fitted: &Fitted, k: usize, columns: &[Vec<Vec<f64>>; AXES]) -> ByAxis<Gain> {
    (0..AXES)
        .filter_map(|a| {
            let range = fitted.gains(k, a)?;
            let fit = &fitted.axes[a];
            let [gains, gains_std] = [&fit.coefficients, &fit.std].map(|v| v[range.clone()].to_vec());
            let columns = &columns[a][range];
            let does = |row| columns.iter().zip(&gains).map(|(x, g)| g * x[row]).sum();
            let size_dph = std_dev(&(0..data.axes[a].y.len()).map(does).collect::<Vec<f64>>());
            let break_value = break_value(data, fitted.terms()[k].lead(), a);
            let gain = Gain { gain: gains[0], gain_std: gains_std[0], gains, gains_std, size_dph, break_value };
            Some((AXIS_NAMES[a].to_string(), gain))
        })
        .collect()
}

/// The value of a recorded quantity at which its slope changes, in its unit.
fn break_value(data: &Data<'_>, c: &Candidate, a: usize) -> Option<f64> {
    let bend = (c.facts.effect == EffectId::InputKink).then(|| Bend::of(&c.parameters))?;
    let number = of_axis(bend.channel as u8, a);
    let input = input_table(data.runs).into_iter().find(|i| i.quantity == number)?;
    Some(f64::from(input.reference + input.scale * bend.break_at))
}
