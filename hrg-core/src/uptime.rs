//! Time since the start, of a counter with 32 bits that counts microseconds.
//!
//! # Design
//! The counter wraps every 71.6 minutes. A number of *halves* (2^31 us each) is counted beside it, by an interrupt at each wrap and one half-way: so while the
//! interrupt has not come yet, the counter's highest bit tells that the number is one behind. It is right as long as an interrupt is late by less than
//! half an hour; an erase of flash stops the processor for 2 s. 32 bits of halves are 292 000 years.
//!
//! # Example
//! ```
//! use hrg_core::uptime::{now_us, HALF_US};
//!
//! assert_eq!(now_us(0, 5), 5);
//! // The counter is in its second half, and the interrupt has not come yet.
//! assert_eq!(now_us(0, 0x8000_0000), HALF_US);
//! assert_eq!(now_us(1, 0x8000_0000), HALF_US);
//! // It has wrapped, and neither has that one.
//! assert_eq!(now_us(1, 3), 2 * HALF_US + 3);
//! ```

/// Microseconds of half a turn of the counter.
pub const HALF_US: u64 = 1 << 31;

/// Time since the start, us: `halves` was read before the `counter`.
#[inline]
#[must_use]
pub const fn now_us(halves: u32, counter: u32) -> u64 {
    // In an even half the counter's highest bit is 0, in an odd one 1. Where it is the other one, the next half has begun.
    ((halves as u64) << 31) + (counter ^ (halves & 1) << 31) as u64
}

/// The counter at which an alarm is due, if that is within the half after this one; a later one is looked at again there.
#[inline]
#[must_use]
pub const fn alarm(at_us: u64, now_us: u64) -> Option<u32> {
    if at_us < now_us + HALF_US {
        Some(at_us as u32)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Microseconds of a year.
    const YEAR_US: u64 = 366 * 86_400 * 1_000_000;
    /// The longest that the interrupt is late: two erases of 2 s, one after the other.
    const LATE_US: u64 = 4_000_000;

    #[test]
    fn a_year_passes_without_a_jump_at_any_wrap() {
        let mut wraps = 0;
        let mut half = 1u32;
        while u64::from(half) * HALF_US < YEAR_US {
            let wrap = u64::from(half) * HALF_US;
            // Before it, at it, and after it with the interrupt still to come, and with it.
            for (true_us, halves) in [
                (wrap - LATE_US, half - 1),
                (wrap - 1, half - 1),
                (wrap, half - 1),
                (wrap + 1, half - 1),
                (wrap + LATE_US, half - 1),
                (wrap, half),
                (wrap + LATE_US, half),
                (wrap + HALF_US - 1, half),
            ] {
                assert_eq!(now_us(halves, true_us as u32), true_us, "half {half}");
            }
            assert_eq!(alarm(wrap + 10, wrap - 10), Some((wrap + 10) as u32));
            assert_eq!(alarm(wrap + HALF_US, wrap), None);
            wraps += 1;
            half += 1;
        }
        assert!(wraps > 14_000, "{wraps}");
        assert_eq!(now_us(u32::MAX, 0xFFFF_FFFF), (u64::from(u32::MAX) << 31) + 0x7FFF_FFFF);
    }
}
