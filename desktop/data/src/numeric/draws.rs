//! Random numbers that are the same on every machine and in every version: for tests and benchmarks whose data other programs
//! make again. Knuth's linear congruential generator (MMIX); its low bits are poor and are not handed out.

/// A sequence of draws.
#[derive(Debug, Clone)]
pub struct Draws(u64);

impl Draws {
    /// The sequence of a seed.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits, of which the upper half is fit for use.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0
    }

    /// Evenly in 0..`n`.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() >> 33) as usize % n
    }

    /// Evenly in -0.5..0.5, with 31 bits.
    pub fn centred(&mut self) -> f64 {
        (self.bits() >> 33) as f64 / 2f64.powi(31) - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_is_the_published_one() {
        let mut d = Draws::new(0);
        assert_eq!([d.bits(), d.bits()], [1_442_695_040_888_963_407, 1_876_011_003_808_476_466]);
        let (mut sum, mut seen) = (0.0, [0; 7]);
        for _ in 0..70_000 {
            sum += d.centred();
            seen[d.below(7)] += 1;
        }
        assert!(f64::abs(sum) < 400.0 && seen.iter().all(|n| (9_500..10_500).contains(n)), "{sum} {seen:?}");
    }
}
