//! A sum of families without a name: what compensates where naming does not reach.

use super::{merged, odds, Model, Search, RAMP};
use hrg_core::calibration::MAX_EFFECTS;
use hrg_core::AXES;
use hrg_data::cards::Kind;

/// Log evidence that a further family must bring; it pays no price, as it is not named.
const LEAST: f64 = 1.0;

impl Search<'_> {
    /// A model with a sum of families on the axes that it explains better (by evidence, each axis of each effect counted as one); as far as
    /// an image can hold the effects of both.
    pub fn with_families(&mut self, model: &Model) -> Model {
        let families = self.sum_of_families(model);
        let score = |m: &Model, a: usize| {
            let axis = &m.state.axes[a];
            axis.evidence + odds::AXIS * axis.shares.iter().filter(|s| s.group != RAMP).count() as f64
        };
        let better: Vec<usize> = (0..AXES).filter(|a| score(&families, *a) > score(model, *a)).collect();
        let state = merged(&model.state, &families.state, &better);
        let parts = |g: &usize| self.candidates[*g].iter().filter(|c| c.on_unit()).count();
        if better.is_empty() || state.groups.iter().map(parts).sum::<usize>() > MAX_EFFECTS {
            return model.clone();
        }
        self.model(state)
    }

    /// Families side by side, each with the variance of highest evidence, beside what the model has that no unit can compute (so that it
    /// bends nothing): the one that brings most evidence first, as long as any does and an image can hold it.
    fn sum_of_families(&mut self, model: &Model) -> Model {
        let mut state = model.state.clone();
        while let Some(k) = (0..state.groups.len()).find(|k| self.lead(state.groups[*k]).on_unit()) {
            state = self.without(&state, k);
        }
        let others = state.groups.len();
        while state.groups.len() < others + MAX_EFFECTS {
            let ranked = self.extensions(&state);
            let family = |g: &usize| {
                self.candidates[*g].len() == 1 && self.lead(*g).on_unit() && self.card(*g).kind == Kind::Family
            };
            let gain = |e: &(f64, usize, _)| e.0 - self.log_prior(e.1, &state.groups);
            let best = ranked.iter().filter(|e| family(&e.1)).max_by(|x, y| gain(x).total_cmp(&gain(y)));
            let Some((group, on)) = best.filter(|e| gain(e) > LEAST).map(|e| (e.1, e.2)) else { break };
            let next = self.with(&state, group, &on);
            if next.evidence() <= state.evidence() {
                break;
            }
            state = next;
        }
        self.model(state)
    }
}
