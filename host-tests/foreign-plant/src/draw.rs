//! Random streams. Every random quantity has a stream of its own, named by a path, so that adding one draw never changes another.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::ops::Range;

/// The stream of `path` under `seed`: the path is hashed by FNV-1a, so the stream does not depend on the platform.
#[must_use]
pub fn stream(seed: u64, path: &[&str]) -> ChaCha8Rng {
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let bytes = path.iter().flat_map(|part| part.bytes().chain([0xff]));
    for byte in bytes.chain(seed.to_le_bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    ChaCha8Rng::seed_from_u64(hash)
}

/// Random numbers of an effect: properties of the unit (the same in every run) and accidents of one run.
pub struct Draw {
    common: ChaCha8Rng,
    own: ChaCha8Rng,
    run: ChaCha8Rng,
    /// Properties of the unit drawn so far, by name: they go into the truth.
    pub values: BTreeMap<String, f64>,
}

impl Draw {
    /// The streams of effect number `effect` of `case` on `axis` (0 to 2) in run number `run`.
    #[must_use]
    pub fn new(seed: u64, case: &str, effect: usize, axis: usize, run: usize) -> Self {
        let (effect, axis, run) = (effect.to_string(), axis.to_string(), run.to_string());
        Self {
            common: stream(seed, &[case, "effect", &effect, "common"]),
            own: stream(seed, &[case, "effect", &effect, "own", &axis]),
            run: stream(seed, &[case, "effect", &effect, "run", &run]),
            values: BTreeMap::new(),
        }
    }

    /// A property of the unit that its three axes share.
    pub fn common(&mut self, name: &str, range: Range<f64>) -> f64 {
        let value = self.common.random_range(range);
        self.values.insert(name.to_owned(), value);
        value
    }

    /// A property of one axis of the unit.
    pub fn own(&mut self, name: &str, range: Range<f64>) -> f64 {
        let value = self.own.random_range(range);
        self.values.insert(name.to_owned(), value);
        value
    }

    /// A property of one axis that has too many numbers to be listed in the truth (knots, relays).
    pub fn quiet(&mut self, range: Range<f64>) -> f64 {
        self.own.random_range(range)
    }

    /// An accident of one run, the same on each axis of it.
    pub fn run(&mut self, range: Range<f64>) -> f64 {
        self.run.random_range(range)
    }
}
