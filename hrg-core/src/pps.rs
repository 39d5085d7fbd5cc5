//! One pulse per second: how far the unit's own clock is off, and frequencies set right by it.
//!
//! # Why
//! A frequency that is counted with a clock which is off by 1 ppm is off by 1 ppm: at about 100 ppm per C of a resonator that is 0.01 C. The crystal
//! of a board is off by tens of ppm and changes with its temperature. If a pulse each second comes in (of a GNSS receiver, or the
//! laboratory's standard), its ticks are the true seconds.
//!
//! # Design
//! Pulses are counted and what they deviate from the timer's own seconds is summed up; each ten seconds that sum is kept. The clock's error is its change
//! over the longest time kept, up to 100 s. With stamps good to 30 ns that is 0.0005 ppm.
//!
//! The correction follows the measured error slowly ([`SLEW_PER_S`]): a step of it would be a step of temperature, and for the model a ramp.
//! Only while the model settles after a start is it taken over at once. Without pulses the last correction is held.
//!
//! A run in the chamber that was recorded without pulses holds the clock's own error in its curve of frequency over temperature. Record and fly alike.
//!
//! # Example
//! ```
//! use hrg_core::frequency::StepFrequencies;
//! use hrg_core::pps::Pps;
//! use hrg_core::timebase::Timebase;
//!
//! let mut pps = Pps::new(Timebase::REFERENCE);
//! assert_eq!(pps.error(), None, "nothing is known before the first pulses");
//! // A crystal that is fast by 1 ppm: 90 ticks more a second.
//! for second in 0..60u32 {
//!     pps.pulse((u64::from(second) * 90_000_090) as u32);
//!     let step = StepFrequencies {
//!         step: second,
//!         end_ticks: u64::from(second) * 90_000_000 + 45_000_000,
//!         frequency_hz: [Some(4900.0); 3],
//!         rejected: [0; 3],
//!         missing: [0; 3],
//!     };
//!     let (corrected, report) = pps.second(step);
//!     if second == 59 {
//!         assert!((report.correction_ppb - 1000.0).abs() < 1.0);
//!         assert!((corrected.frequency_hz[0].expect("kept") / 4900.0 - 1.000_001).abs() < 1e-9);
//!     }
//! }
//! ```

use crate::frequency::StepFrequencies;
use crate::rate_of_change::WINDOW;
use crate::timebase::Timebase;

/// A clock that is further off than this is not corrected further, and flagged: crystals are within 50 ppm over temperature and age.
pub const BOUND: f64 = 100e-6;

/// The correction changes by so much a second at most: for the model 0.0002 C per second.
pub const SLEW_PER_S: f64 = 0.02e-6;

/// A pulse is rejected if it is off its second by more than this fraction; several consecutive consistent ones are accepted.
const RHYTHM: f64 = 500e-6;
const ALIKE: u8 = 10;

/// A clock whose error is further from its correction than this, as after pulses that came late, is flagged: it is 0.01 C.
const UNCORRECTED: f64 = 1e-6;

/// Pulses that are further apart than this, s, begin anew: the timer wraps each 47 s.
const GAP_S: u32 = 20;

/// Seconds between marks, and marks.
const MARK_S: u32 = 10;
const MARKS: usize = 11;

/// The clock's error is taken from pulses that are at least so many seconds apart.
const SHORTEST_S: u32 = 8;

/// Pulse and clock of a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Timer tick of the last pulse.
    pub tick: u32,
    /// Its age at the end of the model step, ms; `u32::MAX`: there was none since the start.
    pub age_ms: u32,
    /// Correction that the unit applies for its fast clock, in parts per 1e9; 0 before the first measurement.
    pub correction_ppb: f32,
    /// The clock is further off than [`BOUND`], as far as is known, or more than 1 ppm further than it is corrected.
    pub out_of_bounds: bool,
}

impl Report {
    /// No pulse has ever come.
    pub const NONE: Self = Self { tick: 0, age_ms: u32::MAX, correction_ppb: 0.0, out_of_bounds: false };
}

/// The sum of deviations at a second.
#[derive(Debug, Clone, Copy)]
struct Mark {
    second: u32,
    deviation_ticks: i64,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Pps {
    timebase: Timebase,
    /// Pulses that came since the last step.
    new: heapless::Deque<u32, 2>,
    last: Option<u32>,
    /// Pulses' seconds since they began, and how many ticks too many the timer has counted by now.
    now: Mark,
    marks: heapless::Deque<Mark, MARKS>,
    correction: f64,
    /// Model steps since the last pulse.
    quiet_steps: u32,
    steps: u32,
    /// Pulses in a row that were out of rhythm by tenths of a second at most.
    alike: u8,
    /// The last that is known of the clock is that it is out of bounds.
    far: bool,
}

impl Pps {
    /// Before the first pulse. `timebase`: the timer that stamps them.
    #[must_use]
    pub const fn new(timebase: Timebase) -> Self {
        Self {
            timebase,
            new: heapless::Deque::new(),
            last: None,
            now: Mark { second: 0, deviation_ticks: 0 },
            marks: heapless::Deque::new(),
            correction: 0.0,
            quiet_steps: 0,
            steps: 0,
            alike: 0,
            far: false,
        }
    }

    /// The same, with the correction of before a reset.
    #[must_use]
    pub fn with_correction(self, correction: f64) -> Self {
        Self { correction: correction.clamp(-BOUND, BOUND), ..self }
    }

    /// Relative error of the clock (positive: fast) that is corrected.
    #[must_use]
    pub const fn correction(&self) -> f64 {
        self.correction
    }

    /// A pulse came at a tick of the timer. It counts for the step in which it was, whenever that is told.
    pub fn pulse(&mut self, tick: u32) {
        // (There is one a second; of disturbances the first two are looked at.)
        let _ = self.new.push_back(tick);
    }

    fn take(&mut self, tick: u32) {
        let rate = self.timebase.ticks_per_s().max(1);
        let began = match self.last.map(|last| tick.wrapping_sub(last)) {
            Some(ticks) if self.quiet_steps <= GAP_S => {
                let seconds = ticks.saturating_add(rate / 2) / rate;
                let deviation = i64::from(ticks) - i64::from(seconds) * i64::from(rate);
                let within = deviation.unsigned_abs() as f64 <= RHYTHM * f64::from(seconds) * f64::from(rate);
                let near = deviation.unsigned_abs() <= u64::from(rate / 8);
                self.alike = if near && !within { self.alike.saturating_add(1) } else { 0 };
                if (1..=GAP_S).contains(&seconds) && within {
                    self.now.second += seconds;
                    self.now.deviation_ticks += deviation;
                    true
                } else if ticks < rate - rate / 4 {
                    // A disturbance between two pulses.
                    return;
                } else {
                    false
                }
            }
            _ => false,
        };
        self.last = Some(tick);
        self.quiet_steps = 0;
        if !began {
            self.now = Mark { second: 0, deviation_ticks: 0 };
            self.marks.clear();
        }
        if self.marks.back().is_none_or(|m| self.now.second - m.second >= MARK_S) {
            if self.marks.is_full() {
                let _ = self.marks.pop_front();
            }
            let _ = self.marks.push_back(self.now);
        }
    }

    /// Relative error of the clock (positive: fast), by the pulses of up to 100 s; `None`: too few yet, or they have stopped.
    #[must_use]
    pub fn error(&self) -> Option<f64> {
        let first = self.marks.front()?;
        let seconds = self.now.second - first.second;
        let ticks = f64::from(seconds) * f64::from(self.timebase.ticks_per_s());
        (seconds >= SHORTEST_S && self.quiet_steps <= 2)
            .then(|| (self.now.deviation_ticks - first.deviation_ticks) as f64 / ticks)
    }

    /// A model step has ended: its frequencies, set right, and what is to be told.
    pub fn second(&mut self, mut step: StepFrequencies) -> (StepFrequencies, Report) {
        self.steps = self.steps.saturating_add(1);
        self.quiet_steps = self.quiet_steps.saturating_add(1);
        while let Some(tick) = self.new.pop_front() {
            if tick.wrapping_sub(step.end_ticks as u32) as i32 > 0 {
                let _ = self.new.push_front(tick);
                break;
            }
            self.take(tick);
        }
        let error = self.error();
        if let Some(error) = error {
            self.far = error.abs() > BOUND;
            let wanted = error.clamp(-BOUND, BOUND);
            let settling = self.steps <= WINDOW as u32;
            let most = if settling { f64::INFINITY } else { SLEW_PER_S };
            self.correction += (wanted - self.correction).clamp(-most, most);
        }
        self.far |= self.alike >= ALIKE;
        let behind = error.is_some_and(|e| (e - self.correction).abs() > UNCORRECTED);
        // A clock that is fast counts too many ticks a cycle: the frequency comes out too low. Without a correction nothing is touched.
        if self.correction != 0.0 {
            for f in step.frequency_hz.iter_mut().flatten() {
                *f *= 1.0 + self.correction;
            }
        }
        let report = match self.last {
            None => Report::NONE,
            Some(tick) => {
                let ms = (step.end_ticks as u32).wrapping_sub(tick) / self.timebase.ms(1).max(1);
                let long = self.quiet_steps > GAP_S;
                Report {
                    tick,
                    age_ms: if long { self.quiet_steps.saturating_mul(1000) } else { ms },
                    correction_ppb: (self.correction * 1e9) as f32,
                    out_of_bounds: self.far || behind,
                }
            }
        };
        (step, report)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A clock that is fast by `error`: `seconds` model steps with a pulse in the middle of each but those that `lost` names. The reports.
    fn run(error: f64, seconds: u32, noise_s: f64, lost: impl Fn(u32) -> bool) -> std::vec::Vec<(f64, Report)> {
        let mut pps = Pps::new(Timebase::REFERENCE);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        // Twelve uniform numbers make about a Gaussian of standard deviation 1.
        let mut noise = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * noise_s;
        let tick = |t: f64| (t * 90e6 * (1.0 + error)) as u64;
        (1..=seconds)
            .map(|k| {
                let at = f64::from(k) - 0.5 + noise();
                if !lost(k) {
                    pps.pulse(tick(at) as u32);
                }
                let step = StepFrequencies {
                    step: k,
                    end_ticks: u64::from(k) * 90_000_000,
                    frequency_hz: [Some(4900.0 / (1.0 + error)), None, Some(1.0)],
                    rejected: [0; 3],
                    missing: [0; 3],
                };
                let (step, report) = pps.second(step);
                assert_eq!(step.frequency_hz[1], None);
                (step.frequency_hz[0].expect("kept"), report)
            })
            .collect()
    }

    #[test]
    fn a_hundred_seconds_give_a_hundredth_of_a_ppm() {
        // Stamps good to 50 ns RMS, clocks of all sorts.
        for error in [-30e-6, -1e-7, 0.0, 2.5e-6, 80e-6] {
            let all = run(error, 120, 50e-9, |_| false);
            let (f, last) = all.last().expect("some");
            assert!((f64::from(last.correction_ppb) - error * 1e9).abs() < 10.0, "{error}: {last:?}");
            assert!((f / 4900.0 - 1.0).abs() < 1e-8, "{error}: {f}");
            assert!(!last.out_of_bounds && (490..=510).contains(&last.age_ms), "{last:?}");
        }
    }

    #[test]
    fn without_pulses_nothing_is_touched() {
        let all = run(5e-6, 50, 0.0, |_| true);
        assert!(all.iter().all(|(f, r)| *f == 4900.0 / (1.0 + 5e-6) && *r == Report::NONE));
    }

    #[test]
    fn pulses_that_come_late_move_the_correction_slowly() {
        let all = run(10e-6, 700, 0.0, |k| k < 100);
        for pair in all.windows(2) {
            let change = f64::from(pair[1].1.correction_ppb - pair[0].1.correction_ppb) / 1e9;
            assert!(change.abs() < 1.01 * SLEW_PER_S, "{pair:?}");
        }
        let last = all.last().expect("some").1;
        assert!((last.correction_ppb - 10_000.0).abs() < 10.0, "{last:?}");
    }

    #[test]
    fn lost_pulses_hold_the_correction_and_their_age_is_sent() {
        let all = run(3e-6, 400, 0.0, |k| (50..60).contains(&k) || k >= 300);
        assert!((all[58].1.correction_ppb - 3000.0).abs() < 10.0 && all[58].1.age_ms > 9000);
        let last = all.last().expect("some").1;
        assert!((last.correction_ppb - 3000.0).abs() < 10.0 && last.age_ms > 90_000, "{last:?}");
    }

    #[test]
    fn a_pulse_after_the_end_of_a_step_waits_for_the_next() {
        let step = |k: u64| StepFrequencies {
            step: k as u32,
            end_ticks: k * 90_000_000,
            frequency_hz: [None; 3],
            rejected: [0; 3],
            missing: [0; 3],
        };
        let (mut early, mut late) = (Pps::new(Timebase::REFERENCE), Pps::new(Timebase::REFERENCE));
        for k in 1..30 {
            // A tick after the end of step k, told before or after that step is closed.
            let tick = (k * 90_000_000 + 1) as u32;
            early.pulse(tick);
            let (_, a) = early.second(step(k));
            let (_, b) = late.second(step(k));
            late.pulse(tick);
            assert_eq!(a, b);
        }
    }

    #[test]
    fn a_clock_out_of_bounds_is_flagged_and_disturbances_are_not_pulses() {
        for error in [110e-6, 200e-6, 499e-6, 510e-6, 1e-3, -1e-3, 0.02] {
            assert!(run(error, 60, 0.0, |_| false).last().expect("some").1.out_of_bounds, "{error}");
            // It stays so when the pulses stop.
            assert!(run(error, 90, 0.0, |k| k > 60).last().expect("some").1.out_of_bounds, "{error}");
        }
        let late = run(30e-6, 100, 0.0, |k| k < 60);
        assert!(late[75].1.out_of_bounds, "known and not corrected yet: {:?}", late[75].1);
        let mut pps = Pps::new(Timebase::REFERENCE);
        for k in 0..60u32 {
            pps.take(k.wrapping_mul(90_000_000));
            pps.take(k.wrapping_mul(90_000_000).wrapping_add(12_345_678));
        }
        assert_eq!(pps.error(), Some(0.0));
    }
}
