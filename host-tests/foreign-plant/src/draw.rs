//! Random streams. Every random quantity has a stream of its own, named by a path, so that adding one draw never changes another.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::ops::Range;

/// The seed of a unit, and the design that it is of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seed {
    /// Of the unit and of its runs.
    pub unit: u64,
    /// Of the design; `None`: each unit has properties of its own.
    pub design: Option<Design>,
}

/// A design: its units have its properties, each a little off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design {
    /// Its seed.
    pub seed: u64,
    /// A property of a unit lies within this share of the range over which designs differ, centred on the design's.
    pub spread: f64,
}

impl From<u64> for Seed {
    fn from(unit: u64) -> Self {
        Self { unit, design: None }
    }
}

/// The stream of `path` under the seed of a unit: the path is hashed by FNV-1a, so the stream does not depend on the platform.
#[must_use]
pub fn stream(seed: impl Into<Seed>, path: &[&str]) -> ChaCha8Rng {
    hashed(seed.into().unit, path)
}

fn hashed(seed: u64, path: &[&str]) -> ChaCha8Rng {
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let bytes = path.iter().flat_map(|part| part.bytes().chain([0xff]));
    for byte in bytes.chain(seed.to_le_bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    ChaCha8Rng::seed_from_u64(hash)
}

/// Properties of a unit: drawn for it alone, or about those of its design.
pub struct Properties {
    own: ChaCha8Rng,
    design: Option<(ChaCha8Rng, f64)>,
}

impl Properties {
    /// The stream of `path`.
    #[must_use]
    pub fn new(seed: Seed, path: &[&str]) -> Self {
        let design = seed.design.map(|d| (hashed(d.seed, path), d.spread));
        Self { own: hashed(seed.unit, path), design }
    }

    /// A number within a range.
    pub fn random_range(&mut self, range: Range<f64>) -> f64 {
        let own = self.own.random_range(range.clone());
        let Some((design, spread)) = &mut self.design else { return own };
        let off = own - 0.5 * (range.start + range.end);
        (design.random_range(range.clone()) + *spread * off).clamp(range.start, range.end)
    }

    /// `true` with this probability: all units of a design alike.
    pub fn random_bool(&mut self, probability: f64) -> bool {
        let own = self.own.random_bool(probability);
        self.design.as_mut().map_or(own, |(design, _)| design.random_bool(probability))
    }

    /// A number that belongs to the unit alone.
    pub fn serial(&mut self, range: Range<u32>) -> u32 {
        self.own.random_range(range)
    }

    /// A number from 0 to 1.
    pub fn share(&mut self) -> f64 {
        let own = self.own.random::<f64>();
        let Some((design, spread)) = &mut self.design else { return own };
        (design.random::<f64>() + *spread * (own - 0.5)).clamp(0.0, 1.0)
    }
}

/// Random numbers of an effect: properties of the unit (the same in every run) and accidents of one run.
pub struct Draw {
    common: Properties,
    own: Properties,
    run: ChaCha8Rng,
    /// Properties of the unit drawn so far, by name: they go into the truth.
    pub values: BTreeMap<String, f64>,
}

impl Draw {
    /// The streams of effect number `effect` of `case` on `axis` (0 to 2) in run number `run`.
    #[must_use]
    pub fn new(seed: impl Into<Seed>, case: &str, effect: usize, axis: usize, run: usize) -> Self {
        let seed = seed.into();
        let (effect, axis, run) = (effect.to_string(), axis.to_string(), run.to_string());
        Self {
            common: Properties::new(seed, &[case, "effect", &effect, "common"]),
            own: Properties::new(seed, &[case, "effect", &effect, "own", &axis]),
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
