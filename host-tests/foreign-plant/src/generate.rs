//! From a case and a seed to recordings and truth.

use crate::acting::Acting;
use crate::case::Case;
use crate::defects;
use crate::draw::Seed;
use crate::making::Making;
use crate::output;
use crate::recording::Recording;
use crate::truth::Truth;
use std::collections::BTreeMap;

/// Recordings of one unit, with their truth.
#[derive(Clone, Debug)]
pub struct Generated {
    /// Train runs.
    pub train: Vec<Recording>,
    /// The verify run.
    pub verify: Recording,
    /// The run that judges.
    pub judge: Recording,
    /// Runs that nothing is sized by.
    pub more: Vec<Recording>,
    /// The truth: all that was put in.
    pub truth: Truth,
}

impl Case {
    /// Recordings and truth of this case. The same seed gives the same bytes.
    #[must_use]
    pub fn generate(&self, seed: impl Into<Seed>) -> Generated {
        let seed = seed.into();
        let mut making = Making::start(self, seed);
        let effects: Vec<Acting> = (0..self.effects.len()).map(|e| making.act(e)).collect();
        making.indicate(&effects);
        making.add_up(&effects);
        let mut train: Vec<Recording> = (0..making.worlds.len()).map(|k| output::record(&making, k)).collect();
        let found: Vec<BTreeMap<String, usize>> = self
            .runs()
            .zip(&mut train)
            .enumerate()
            .map(|(k, (spec, recording))| {
                spec.defects.map_or_else(BTreeMap::new, |d| defects::put_in(recording, d, seed.unit, &making.file(k)))
            })
            .collect();
        let truth = making.truth(&effects, found);
        let more = train.split_off(making.verify() + 2);
        let judge = train.remove(making.verify() + 1);
        let verify = train.remove(making.verify());
        Generated { train, verify, judge, more, truth }
    }
}
