//! Refinement: the inner parameters of an effect, and where it stands when each run begins.

use super::{odds, Search, State, MOST_STARTS};
use crate::trace::data::{AxisByAxis, Candidate, Starts};
use hrg_core::AXES;
use hrg_data::cards::Move;

impl Search<'_> {
    /// Refines effect `k`: its inner parameters, then where it stands when each run begins. Variances and noise models stay while it
    /// moves.
    pub(super) fn refine(&mut self, state: State, k: usize) -> State {
        let state = self.refine_parameters(state, k);
        self.refine_starts(state, k)
    }

    fn refine_parameters(&mut self, state: State, k: usize) -> State {
        let start = self.lead(state.groups[k]);
        let card = self.card(state.groups[k]);
        if card.refine.is_empty() || self.candidates[state.groups[k]].len() > 1 {
            return state;
        }
        let span = |how: &Move| self.extent.width(*how, &start.parameters);
        let first_step = |(how, p): (&Move, f32)| match how {
            Move::Factor(share) => *share,
            Move::Cycle => (0.25 * p / span(how)).min(0.16),
            Move::Place(share) | Move::Level(share) => share * span(how),
            Move::Block => self.data.block_s as f32,
            Move::Period => 0.3 * p * p / self.data.longest_s(),
        };
        let mut steps: Vec<f32> = card.refine.iter().zip(start.parameters).map(first_step).collect();
        let mut best = (self.trial(&state, k, &[start]), start);
        for _ in 0..6 {
            for (place, (how, step)) in card.refine.iter().zip(&steps).enumerate() {
                for sign in [-1.0, 1.0] {
                    let mut c = best.1;
                    let q = c.parameters[place];
                    let step = sign * step;
                    c.parameters[place] = if how.by_factor() { q * (1.0 + step) } else { q + step };
                    if !(card.possible)(&c.parameters, &self.extent) {
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
        let mut best = (self.trial(&state, k, &parts) - odds::branch(), parts.clone());
        let (runs, alike) = (self.data.runs.len(), self.data.alike);
        for run in 0..if alike { 1 } else { runs.min(MOST_STARTS) } {
            for branch in 0..Starts::BRANCHES.len() {
                let starts = if alike { Starts::all(runs, branch) } else { best.1[0].starts.with(run, branch) };
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
        self.offered[group] = false;
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
