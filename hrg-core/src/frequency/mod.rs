//! Capture time stamps to frequency: regression over every edge of a gate (the "omega" counter).
//!
//! A reciprocal counter that uses only the first and the last edge of a gate has an error set by the jitter
//! of those two. The least-squares slope of time against edge number uses them all and is better by about
//! `sqrt(edges / 6)`: for jitter `s` on each of `n` edges of period `P` its frequency error is
//! `f * sqrt(12) * s / (P * n^1.5)` (Rubiola 2005, "On the measurement of frequency and of its sample variance
//! with high-resolution counters"). 20 ns on 4900 edges in a 1 s gate: 4.9 uHz.
//!
//! # Design
//! - Time stamps are those of a free-running 32-bit timer. Differences wrap safely; gates lie on a grid of
//!   64-bit ticks, so which edge belongs to which gate depends on its time stamp alone, never on when the
//!   software got round to it.
//! - All sums are integers, so nothing is lost and gates combine exactly ([`Sums::join`]): ten gates of 0.1 s
//!   are the regression over 1 s, not an average of ten.
//! - Edges are numbered by the grid they must lie on. One that comes too early is a glitch: rejected and
//!   counted. Over missing edges the number moves on by as many: counted, and the slope stays right.
//! - The counter locks after four consistent periods, and unlocks after eight consecutive rejects or a gap
//!   of [`GAP_PERIODS`]. An edge is accepted within 1/64 period (3 us at 4.9 kHz) of its place.
//!
//! # Example
//! ```
//! use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
//!
//! // A resonator of 4898.626 Hz as a timer of 90 MHz stamps it.
//! let config = Config::REFERENCE;
//! let ticks_per_s = f64::from(config.timebase.ticks_per_s());
//! let mut bank = CounterBank::new(config, GATES_PER_STEP);
//! let mut steps = Vec::new();
//! for edge in 0..15_000u32 {
//!     let stamp = (f64::from(edge) * ticks_per_s / 4898.626) as u32;
//!     steps.extend(bank.poll(stamp));
//!     bank.push(0, [stamp]);
//! }
//! let last = steps.last().expect("three seconds make a step");
//! assert!((last.frequency_hz[0].expect("locked") - 4898.626).abs() < 1e-5);
//! assert_eq!(last.frequency_hz[1], None);
//! ```

mod bank;
mod counter;
mod sums;

pub use bank::{CounterBank, Joined, StepFrequencies, SETTLE_US};
pub use counter::{Counter, Gate, GAP_PERIODS};
pub use sums::Sums;

use crate::timebase::Timebase;

/// Length of a gate, ms.
pub const GATE_MS: u32 = 100;

/// Gates in one step of the bias model: ten make [`crate::MODEL_STEP_S`].
pub const GATES_PER_STEP: u32 = 10;

/// Facts that a counter needs of its timer and of its signal.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The timer.
    pub timebase: Timebase,
    /// Ticks of a gate of [`GATE_MS`]. Longer gates by [`Sums::join`].
    pub gate_ticks: u32,
    /// Lowest frequency that is a resonator, Hz.
    pub min_hz: u32,
    /// Highest frequency that is a resonator, Hz.
    pub max_hz: u32,
}

impl Config {
    /// The reference unit: TIM2 at 90 MHz, gates of 0.1 s, 3 to 12 kHz.
    pub const REFERENCE: Self = Self::at(Timebase::REFERENCE);

    /// A timer of another speed, the rest as in the reference unit.
    #[must_use]
    pub const fn at(timebase: Timebase) -> Self {
        Self { timebase, gate_ticks: timebase.ms(GATE_MS), min_hz: 3_000, max_hz: 12_000 }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const TICKS: f64 = 90e6;

    /// Runs a bank over edges of `hz` on axis 0 for `seconds`; `edit` may drop (None) or add stamps.
    fn run(
        hz: f64,
        seconds: f64,
        start: u64,
        mut edit: impl FnMut(u64, u64) -> [Option<u64>; 2],
    ) -> heapless::Vec<StepFrequencies, 16> {
        let mut bank = CounterBank::new(Config::REFERENCE, 10);
        // Begin late in the life of the timer by running empty gates.
        while bank.close_tick() < start {
            let now = bank.close_tick();
            let _ = bank.poll(now as u32);
        }
        let mut out = heapless::Vec::new();
        let n = (hz * seconds) as u64;
        for k in 0..n {
            let t = start + (k as f64 * TICKS / hz) as u64;
            while t > bank.close_tick() {
                let now = bank.close_tick();
                if let Some(s) = bank.poll(now as u32) {
                    let _ = out.push(s);
                }
            }
            for e in edit(k, t).into_iter().flatten() {
                bank.push(0, [e as u32]);
            }
        }
        out
    }

    #[test]
    fn clean_edges_across_the_wrap() {
        // 47 s in, the 32-bit timer wraps at 47.72 s.
        let steps = run(4898.626, 4.0, 47 * 90_000_000, |_, t| [Some(t), None]);
        let good: heapless::Vec<f64, 16> = steps.iter().filter_map(|s| s.frequency_hz[0]).collect();
        assert!(good.len() >= 3);
        for f in good {
            assert!((f - 4898.626).abs() < 3e-6, "{f}");
        }
        assert!(steps.iter().all(|s| s.frequency_hz[1].is_none()));
    }

    #[test]
    fn many_at_once_are_as_one_by_one() {
        // Edges with jitter, glitches, gaps and a longer one, cut into batches of any length.
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut draw = |n: u32| rng.random_range(0..n);
        let mut stamps = std::vec::Vec::new();
        let mut at = 5000u32;
        for k in 0..20_000u32 {
            at = at.wrapping_add(18_370 + draw(5));
            if k % 997 == 0 {
                stamps.push(at.wrapping_sub(9000));
            }
            if k % 1511 != 0 && !(8000..8100).contains(&k) {
                stamps.push(at);
            }
        }
        let (mut one, mut many) = (Counter::new(Config::REFERENCE), Counter::new(Config::REFERENCE));
        let mut rest = &stamps[..];
        while !rest.is_empty() {
            let n = (draw(70) as usize).clamp(1, rest.len());
            let (batch, others) = rest.split_at(n);
            batch.iter().for_each(|s| one.push(*s));
            many.push_all(batch.iter().copied());
            rest = others;
            let last = u64::from(batch[n - 1]);
            while last > one.gate_end() + u64::from(Timebase::REFERENCE.us(SETTLE_US)) {
                assert_eq!(one.close(), many.close());
            }
        }
    }

    #[test]
    fn glitches_and_gaps_are_counted_and_harmless() {
        let steps = run(4800.0, 4.2, 9_000_000, |k, t| match k % 1000 {
            500 => [None, None],
            700 => [Some(t), Some(t + 5000)],
            _ => [Some(t), None],
        });
        let mid = steps[2];
        assert_eq!((mid.rejected[0], mid.missing[0]), (5, 5));
        let f = mid.frequency_hz[0].expect("locked");
        assert!((f - 4800.0).abs() < 3e-6, "{f}");
    }

    #[test]
    fn stops_and_comes_back() {
        let steps = run(4800.0, 8.0, 9_000_000, |k, t| [(!(9600..19200).contains(&k)).then_some(t), None]);
        assert!(steps[3].frequency_hz[0].is_none());
        assert!(steps[6].frequency_hz[0].is_some_and(|f| (f - 4800.0).abs() < 3e-6));
    }

    #[test]
    fn noise_alone_is_no_frequency() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let steps = run(4800.0, 3.0, 0, |_, t| [Some(t + rng.random_range(0..16_384)), None]);
        assert!(steps.iter().all(|s| s.frequency_hz[0].is_none()));
    }

    #[test]
    fn stamps_out_of_order_overflow_nothing() {
        // Found by the fuzz target `unit`: an edge of the gate after this one, and then edges of this one again.
        let later = Sums { lock: 1, first_index: 0, edges: 5000, sum_i: 12_497_500, sum_t: 1 << 40, ..Sums::default() };
        let first = Sums { lock: 1, first_index: 7, edges: 5, sum_i: 10, ..Sums::default() };
        assert_eq!(first.join(&later), None);
        let far = Sums { origin_ticks: 1 << 50, first_index: 8, ..later };
        assert_eq!(first.join(&far), None);
    }
}
