//! Refinement: the inner parameters of an effect, and where it stands when each run begins.

use super::{Search, State, BRANCH, MOST_STARTS};
use crate::trace::data::{AxisByAxis, Candidate, Starts};
use hrg_core::AXES;
use hrg_data::cards::Refine;

impl Search<'_> {
    /// Refines effect `k`: its inner parameters, then where it stands when each run begins. Variances and noise models stay while it
    /// moves.
    pub(super) fn refine(&mut self, state: State, k: usize) -> State {
        let state = self.refine_parameters(state, k);
        self.refine_starts(state, k)
    }

    fn refine_parameters(&mut self, state: State, k: usize) -> State {
        let start = self.lead(state.groups[k]);
        let how = self.card(state.groups[k]).refine;
        if how == Refine::No || self.candidates[state.groups[k]].len() > 1 {
            return state;
        }
        let (low, high) = self.data.temperature_range();
        let span = high - low;
        let p = start.parameters;
        let mut steps = match how {
            Refine::No => [0.0; 2],
            Refine::Scale => [0.16; 2],
            Refine::Cycle => [(0.25 * p[0] / span).min(0.16); 2],
            Refine::Place(share) | Refine::Places(share) => [share * span; 2],
            Refine::Time => [self.data.block_s as f32; 2],
            Refine::TimeAndScale => [self.data.block_s as f32, 0.3],
            Refine::Period => [0.3 * p[0] * p[0] / self.data.longest_s(); 2],
        };
        let mut best = (self.trial(&state, k, &[start]), start);
        for _ in 0..6 {
            for place in 0..how.places() {
                for sign in [-1.0, 1.0] {
                    let mut c = best.1;
                    let q = c.parameters[place];
                    let step = sign * steps[place];
                    c.parameters[place] = if how.by_factor(place) { q * (1.0 + step) } else { q + step };
                    if matches!(how, Refine::Places(_)) && c.parameters[1] > c.parameters[0] {
                        continue;
                    }
                    let net_evidence = self.trial(&state, k, &[c]);
                    if net_evidence > best.0 {
                        best = (net_evidence, c);
                    }
                }
            }
            steps.iter_mut().for_each(|s| *s *= 0.55);
        }
        if best.1 == start {
            return state;
        }
        self.exchanged(state, k, vec![best.1])
    }

    fn refine_starts(&mut self, state: State, k: usize) -> State {
        let parts = self.candidates[state.groups[k]].clone();
        if !parts[0].facts.remembers_path {
            return state;
        }
        let mut best = (self.trial(&state, k, &parts) + BRANCH, parts.clone());
        for run in 0..self.data.runs.len().min(MOST_STARTS) {
            for branch in 0..Starts::BRANCHES.len() {
                let starts = best.1[0].starts.with(run, branch);
                if starts == best.1[0].starts {
                    continue;
                }
                let moved: Vec<Candidate> = best.1.iter().map(|c| c.starting(starts)).collect();
                let net_evidence = self.trial(&state, k, &moved);
                if net_evidence > best.0 {
                    best = (net_evidence, moved);
                }
            }
        }
        if best.1 == parts {
            return state;
        }
        self.exchanged(state, k, best.1)
    }

    /// The model with other parts in the place of effect `k`, if they are better.
    fn exchanged(&mut self, state: State, k: usize, parts: Vec<Candidate>) -> State {
        let group = self.push(parts, self.tries[state.groups[k]]);
        let moved = self.instead(&state, k, group);
        if moved.evidence() > state.evidence() {
            moved
        } else {
            state
        }
    }

    /// Evidence with other parts in the place of effect `k`, variances and noise models as they are.
    fn trial(&self, state: &State, k: usize, parts: &[Candidate]) -> f64 {
        hrg_data::numeric::progress::step();
        let group = state.groups[k];
        let mut columns: Vec<AxisByAxis<'_>> = parts.iter().map(AxisByAxis::new).collect();
        let mut sum = 0.0;
        for a in 0..AXES {
            let m = &state.axes[a];
            if !m.shares.iter().any(|s| s.group == group) {
                sum += m.evidence;
                continue;
            }
            let each: Option<Vec<_>> = columns.iter_mut().map(|c| c.on(self.data, a)).collect();
            sum += each.map_or(f64::NEG_INFINITY, |e| self.axes[a].evidence_with(m, group, e.concat()));
        }
        sum
    }
}
