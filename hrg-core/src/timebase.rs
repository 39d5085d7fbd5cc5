//! The timer that stamps edges and samples: durations to ticks, in one place.
//!
//! All durations of the unit are constants in milliseconds or microseconds. Only this type turns them into ticks, so a board with
//! another timer has to state its rate and nothing else.
//!
//! # Example
//! ```
//! use hrg_core::timebase::Timebase;
//!
//! let timer = Timebase::at(16_000_000);
//! assert_eq!((timer.ms(100), timer.us(100)), (1_600_000, 1_600));
//! assert_eq!(timer.to_ms(48_000_000), 3000);
//! ```

/// A free-running timer of 32 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timebase {
    ticks_per_s: u32,
}

impl Timebase {
    /// The reference unit: TIM2 at 90 MHz.
    pub const REFERENCE: Self = Self::at(90_000_000);

    /// A timer of this rate, ticks per second. From 1 MHz (edges are stamped to a microsecond) to 500 MHz (the longest duration is
    /// then below 2^31 ticks).
    #[must_use]
    pub const fn at(ticks_per_s: u32) -> Self {
        Self { ticks_per_s }
    }

    /// Ticks per second.
    #[must_use]
    pub const fn ticks_per_s(self) -> u32 {
        self.ticks_per_s
    }

    /// Ticks of a duration in ms.
    #[must_use]
    pub const fn ms(self, duration_ms: u32) -> u32 {
        (self.ticks_per_s as u64 * duration_ms as u64 / 1000) as u32
    }

    /// Ticks of a duration in us.
    #[must_use]
    pub const fn us(self, duration_us: u32) -> u32 {
        (self.ticks_per_s as u64 * duration_us as u64 / 1_000_000) as u32
    }

    /// A time in ticks as whole milliseconds, modulo 2^32.
    #[must_use]
    pub const fn to_ms(self, ticks: u64) -> u32 {
        // A timer that stands still has no time; this must not divide by its zero.
        let rate = if self.ticks_per_s == 0 { 1 } else { self.ticks_per_s as u64 };
        // Seconds first: a thousand times all the ticks would pass 64 bits after six years.
        ((ticks / rate).wrapping_mul(1000) + ticks % rate * 1000 / rate) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_scale_with_the_rate() {
        assert_eq!(Timebase::REFERENCE.ms(50), 4_500_000);
        assert_eq!(Timebase::REFERENCE.us(100), 9_000);
        assert_eq!(Timebase::at(240_000_000).ms(2_500), 600_000_000);
        assert_eq!(Timebase::at(84_000_000).ms(2_500), 210_000_000);
    }

    #[test]
    fn milliseconds_are_a_quotient() {
        for rate in [1_000_000u32, 84_000_000, 90_000_000, 240_000_000] {
            for k in 0..64 {
                for off in [0, 1, 89_999, 12_345_678] {
                    let ticks = (1u64 << k).wrapping_add(off);
                    let exact = (u128::from(ticks) * 1000 / u128::from(rate)) as u32;
                    assert_eq!(Timebase::at(rate).to_ms(ticks), exact, "{ticks} at {rate}");
                }
            }
        }
    }
}
