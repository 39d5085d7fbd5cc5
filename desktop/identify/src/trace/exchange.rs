//! The search with train and verify exchanged: advice, as another greedy search may name the same thing otherwise.

use super::data::Candidate;
use super::growth;
use super::report::{Exchanged, Found};
use super::search::Search;
use super::user_effects::{self, card_of, OwnEffect};
use crate::fit;
use crate::fit::enough_data;
use hrg_data::cards::Class;
use hrg_data::recording::steps::Run;
use hrg_data::recording::Recording;
use std::collections::BTreeSet;

/// Means of the axis of a run that has fewest.
pub(super) fn shortest(run: &Run) -> usize {
    run.steps.present().map(|a| enough_data::means(run, a).0).min().unwrap_or(0)
}

/// The second witness: the search with the verify run as train run. `None` where it cannot be used so.
pub(super) fn second_search(verify: &Recording, effects: &[OwnEffect]) -> Option<Vec<Candidate>> {
    let mut prepared = fit::prepare(std::slice::from_ref(verify)).ok()?;
    prepared.runs.iter_mut().try_for_each(|run| user_effects::attach(effects, run)).ok()?;
    let data = growth::data(&prepared).ok()?;
    let mut search = Search::new(&data);
    Some(search.run().effects().copied().collect())
}

/// Result of the second witness, compared with the effects of the report.
pub(super) fn exchanged(found: &[Candidate], effects: &[Found]) -> Exchanged {
    let names: Vec<String> = found.iter().map(|c| c.facts.name.to_string()).collect();
    let classes: BTreeSet<Class> = found.iter().map(|c| card_of(c.facts).class).collect();
    let own: BTreeSet<Class> = effects.iter().map(|e| e.class).collect();
    Exchanged { same_classes: classes == own, classes: classes.into_iter().collect(), names }
}

/// Means of a verify run from which effects can be learnt: three hours.
pub(super) const LEAST_EXCHANGED: usize = 108;
