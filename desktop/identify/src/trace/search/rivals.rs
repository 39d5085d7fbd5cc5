//! Candidates for the place of an effect: by evidence, by the quantities that sensors record, and by the profile alone.

use super::{odds, AxisModel, Model, Score, Search, State, RAMP};
use crate::trace::beyond::Form;
use crate::trace::data::Candidate;
use crate::trace::noise::{Basis, NOISE_MODELS};
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::cards::{card, Class, Kind};
use hrg_data::numeric::stats::dot;

/// Candidate for the place of an effect.
#[derive(Debug, Clone, Copy)]
pub struct Rival {
    /// The effect.
    pub candidate: Candidate,
    /// Log prior odds, and the log evidence that it brings.
    pub score: Score,
    /// Reduction of the cross-validated squared error, as a share.
    pub gain_in_cv: f64,
}

/// See [`Search::overlaps`].
#[derive(Debug, Clone)]
pub struct Overlap {
    /// The effect.
    pub effect: EffectId,
    /// Share of its size that the baseline leaves.
    pub left: f64,
    /// Shares of what is left that other effects explain.
    pub shares: Vec<(EffectId, f64)>,
}

impl Search<'_> {
    /// Candidates for the place of one effect: the best of each name with the evidence it brings, best first. The effect itself is among
    /// them.
    pub fn instead_of(&mut self, model: &Model, which: usize) -> Vec<Rival> {
        let others = self.without(&model.state, which);
        let own = model.state.groups[which];
        let mut out = vec![self.rival(&others, &model.state, own)];
        for (score, group, on) in self.extensions(&others) {
            let c = self.lead(group);
            if out.len() >= 5 || score <= 0.0 || out.iter().any(|o| o.candidate.facts.id == c.facts.id) {
                continue;
            }
            let next = self.with_refined(&others, group, &on);
            let rival = self.rival(&others, &next, next.last());
            out.push(rival);
        }
        out.sort_by(|x, y| y.score.total().total_cmp(&x.score.total()));
        out
    }

    /// Models of what a unit can compute in which one family of lags, plays or decays stands in the place of all effects of its class: what a search of few
    /// runs takes for two effects, or for a simple one, may be neither in all units.
    pub fn with_families(&mut self, model: &Model) -> Vec<Model> {
        self.unit_only = true;
        let mut out = Vec::new();
        for class in [Class::Memory, Class::Hysteresis, Class::PowerOn] {
            let of_class = |s: &Self, state: &State| state.groups.iter().position(|g| s.card(*g).class == class);
            let mut others = model.state.clone();
            while let Some(k) = of_class(self, &others) {
                others = self.without(&others, k);
            }
            if others.groups.len() == model.state.groups.len() {
                continue;
            }
            let mut tried: Vec<u16> = Vec::new();
            for (_, group, on) in self.extensions(&others) {
                let (card, id) = (self.card(group), self.lead(group).facts.id);
                let one = self.candidates[group].len() == 1 && self.is_family_with_state(group) && card.class == class;
                if one && on.iter().any(Option::is_some) && self.has_room(&others, group) && !tried.contains(&id) {
                    tried.push(id);
                    let next = self.with_refined(&others, group, &on);
                    let next = self.prune(next);
                    out.push(self.model(next));
                }
            }
        }
        self.unit_only = false;
        out
    }

    /// Log odds of an effect against the best of the groups of a form in its place (by axis), on the axes that get something from it.
    pub fn odds_against(
        &mut self,
        model: &Model,
        which: usize,
        form: &Form,
        groups: &[Vec<Vec<Vec<f64>>>; AXES],
    ) -> f64 {
        let others = self.without(&model.state, which);
        let classes: Vec<Class> = others.groups.iter().map(|g| self.card(*g).class).collect();
        let mut gains: Vec<f64> = Vec::new();
        for a in (0..AXES).filter(|a| !self.data.axes[*a].y.is_empty()) {
            let own = groups[a].clone();
            let each = if form.of_ramp {
                self.evidence_of_ramps(&others.axes[a], a, own)
            } else {
                self.evidence_beside(&others.axes[a], a, own)
            };
            gains.resize(each.len(), 0.0);
            gains.iter_mut().zip(each).for_each(|(sum, gain)| *sum += (gain + odds::AXIS).max(0.0));
        }
        let best = gains.iter().copied().fold(0.0, f64::max);
        let log_prior = odds::log_prior(&card(form.like), gains.len() as f64, &classes);
        model.members[which].score.total() - (log_prior + best)
    }

    fn rival(&mut self, others: &State, with: &State, group: usize) -> Rival {
        let gain_in_cv = (0..AXES)
            .filter(|a| !self.data.axes[*a].y.is_empty())
            .map(|a| {
                let m = &with.axes[a];
                let n = self.data.axes[a].y.len() as f64;
                let without = AxisModel { noise_model: m.noise_model, ..others.axes[a].clone() };
                let more = self.axes[a].cross_validated(m) - self.axes[a].cross_validated(&without);
                1.0 - (-2.0 * more / n).exp()
            })
            .sum::<f64>()
            / self.data.axes_there() as f64;
        Rival {
            candidate: self.lead(group),
            score: Score {
                log_prior: self.log_prior(group, &others.groups) + odds::AXIS * with.width(group) as f64,
                log_evidence: with.evidence() - others.evidence(),
            },
            gain_in_cv,
        }
    }

    /// Orthonormal columns of some candidates on one axis under one noise model.
    fn basis(&self, groups: &[usize], a: usize, noise_model: usize) -> Basis {
        let mut basis = Basis::default();
        for c in groups.iter().flat_map(|g| self.axes[a].columns_of(*g).unwrap_or_default()) {
            basis.add(self.axes[a].column(noise_model, *c));
        }
        basis
    }

    /// Effects that rest on a recorded sensor, which no found effect reads, and whose regressors the found effects (with the baseline) span but
    /// for what a coarse sensor's own error may be: a tenth of their variance. Likelihood cannot be asked here: a
    /// regressor with noise of its own always loses against a clean one. Each with the found effect it is most
    /// alike.
    pub fn alike(&self, model: &Model) -> Vec<(&'static str, usize)> {
        let found = &model.state.groups;
        let axes = self.data.axes_there() as f64;
        let mut out: Vec<(&'static str, usize)> = Vec::new();
        for k in RAMP + 1..self.candidates.len() {
            let (lead, card) = (self.lead(k), self.card(k));
            let facts = lead.facts;
            let needs = facts.reach.needs().is_some() && card.kind == Kind::Simple && card.refine.is_empty();
            let same = |of: Candidate| of.facts.id == facts.id || of.reads().intersects(lead.reads());
            let there = found.iter().any(|g| same(self.lead(*g)));
            if !needs || there || out.iter().any(|(n, _)| *n == facts.name) {
                continue;
            }
            // Under white noise; shares of the candidate's variance.
            let mut together = 0.0;
            let mut alone = vec![0.0; found.len()];
            for a in 0..AXES {
                let own = self.basis(&[k], a, 0);
                let Some(c) = own.columns.first() else { continue };
                let share = |groups: &[usize]| {
                    let basis = self.basis(groups, a, 0);
                    basis.columns.iter().map(|q| dot(q, c).powi(2)).sum::<f64>() / axes
                };
                together += share(found);
                for (sum, g) in alone.iter_mut().zip(found) {
                    *sum += share(&[*g]);
                }
            }
            let most = (0..found.len()).max_by(|x, y| alone[*x].total_cmp(&alone[*y]));
            if let (true, Some(e)) = (together > 0.85, most) {
                out.push((facts.name, e));
            }
        }
        out
    }

    /// Share of each wanted effect that the others explain, at three values of its parameter (the worst of the three), under white and
    /// under correlated noise.
    pub fn overlaps(&self, wanted: &[EffectId]) -> Vec<Overlap> {
        let of = |effect: EffectId| -> Vec<usize> {
            (RAMP + 1..self.candidates.len())
                .filter(|k| self.lead(*k).facts.effect == effect && self.candidates[*k].len() == 1)
                .collect()
        };
        // Under white noise, and under noise with some noise_model.
        let share = |target: usize, other: usize, noise_model: usize| {
            (0..AXES)
                .map(|a| {
                    let own = self.basis(&[target], a, noise_model);
                    let Some(c) = own.columns.first() else { return 0.0 };
                    self.basis(&[other], a, noise_model).columns.iter().map(|q| dot(q, c).powi(2)).sum::<f64>()
                })
                .sum::<f64>()
                / self.data.axes_there() as f64
        };
        wanted
            .iter()
            .map(|&effect| {
                let own = of(effect);
                let some = [own.len() / 4, own.len() / 2, 3 * own.len() / 4];
                let mut shares: Vec<(EffectId, f64)> = Vec::new();
                let mut left = 0.0f64;
                for target in some.iter().filter_map(|k| own.get(*k)) {
                    left = left.max(self.left_by_baseline(&self.lead(*target)));
                    for other in wanted.iter().filter(|o| **o != effect) {
                        let most = of(*other)
                            .iter()
                            .map(|k| share(*target, *k, 0).max(share(*target, *k, NOISE_MODELS.len() / 2)))
                            .fold(0.0, f64::max);
                        match shares.iter_mut().find(|(n, _)| n == other) {
                            Some((_, s)) => *s = s.max(most),
                            None => shares.push((*other, most)),
                        }
                    }
                }
                Overlap { effect, left, shares }
            })
            .collect()
    }

    /// RMS of a candidate's first regressor after the baseline over that before it (about its mean): mean of the axes.
    fn left_by_baseline(&self, c: &Candidate) -> f64 {
        let mut sum = 0.0;
        for a in 0..AXES {
            let rows = &self.data.axes[a];
            let Some(column) =
                self.data.columns(c, a, false).and_then(|mut v| (!v.is_empty()).then(|| v.swap_remove(0)))
            else {
                return 0.0;
            };
            let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
            let about: Vec<f64> = column.iter().map(|v| v - mean).collect();
            let mut basis = Basis::default();
            for b in &rows.base {
                basis.add(b.clone());
            }
            let inside: f64 = basis.columns.iter().map(|q| dot(q, &column).powi(2)).sum();
            let after = (dot(&column, &column) - inside).max(0.0);
            sum += (after / dot(&about, &about).max(1e-300)).sqrt().min(1.0);
        }
        sum / AXES as f64
    }
}
