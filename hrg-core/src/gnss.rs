//! GNSS time of frames: a pulse per second says when a second begins, a message says which one it was.
//!
//! The host (or the navigator) sends [`GnssTime`] within a second after each pulse, as receivers give it (NMEA's ZDA; UBX-TIM-TP; PPS messages). Between messages
//! seconds are counted by the pulses. The unit sends a [`TimeMark`] each second: the tick of the last pulse and its time. So a frame's time is
//! that of the mark, and the ticks between them over the timer's rate ([`TimeMark::seconds_to`]).
//!
//! # Error
//! A pulse is stamped with a tick (11 ns at 90 MHz). The timer is off by what is left of its correction, some 0.02 ppm, so 20 ns a second between pulses. What the
//! receiver states for its own pulse is added. Without pulses the mark stays, and its stated error grows by [`COAST_NS_PER_S`].
//!
//! # Example
//! ```
//! use hrg_core::gnss::{GnssClock, GnssTime};
//! use hrg_core::timebase::Timebase;
//!
//! let mut clock = GnssClock::new(Timebase::REFERENCE);
//! clock.pulse(1_000);
//! clock.set(GnssTime { week: 2394, second: 604_799, std_ns: 20, leap_s: 18 }, 9_000_000);
//! clock.pulse(90_001_000);
//! // The next second is the first of the next week.
//! let mark = clock.mark(90_500_000, 0.0).expect("known");
//! assert_eq!((mark.tick, mark.week, mark.second), (90_001_000, 2395, 0));
//! ```

use crate::timebase::Timebase;

/// Seconds of a week.
pub const WEEK_S: u32 = 604_800;

/// Seconds from 1970 to the start of GPS time, 6 January 1980.
pub const GPS_EPOCH_UNIX_S: u64 = 315_964_800;

/// Leap seconds that are not known.
pub const NO_LEAP: u8 = 255;

/// Growth of the stated error where no pulse comes, ns in a second: a clock as it is corrected, with a margin.
pub const COAST_NS_PER_S: u32 = 50;

/// A message counts for the last pulse while that is no older than this, ms.
const OLDEST_MS: u32 = 950;

/// A pulse's second may be so much longer or shorter, as a share of it.
const RHYTHM: u32 = 2000;

/// Messages in a row that contradict the seconds that were counted, until they are accepted.
const CONTRADICTIONS: u8 = 3;

/// Time of the pulse that came last, from a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GnssTime {
    /// GPS week, counted on (no wrap at 1024).
    pub week: u16,
    /// Second of that week.
    pub second: u32,
    /// Standard deviation of the pulse, ns.
    pub std_ns: u32,
    /// Leap seconds, GPS time less UTC; 255: not known.
    pub leap_s: u8,
}

/// Source of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Quality {
    /// Not at all.
    #[default]
    None = 0,
    /// Seconds are counted without a pulse.
    Coasting = 1,
    /// By pulses; the last message is older than two seconds.
    Counted = 2,
    /// By pulses and messages.
    Told = 3,
}

/// A moment of the timer in GNSS time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TimeMark {
    /// Timer tick of the last pulse.
    pub tick: u32,
    /// GPS week.
    pub week: u16,
    /// Second of it.
    pub second: u32,
    /// Standard deviation of that, ns.
    pub std_ns: u32,
    /// Leap seconds; 255: not known.
    pub leap_s: u8,
    /// [`Quality`].
    pub quality: u8,
}

impl TimeMark {
    /// Seconds from the mark to a tick, within 23 s of it. `correction`: relative error of the timer, positive: fast.
    #[must_use]
    pub fn seconds_to(&self, tick: u32, timebase: Timebase, correction: f64) -> f64 {
        f64::from(tick.wrapping_sub(self.tick) as i32) / f64::from(timebase.ticks_per_s()) * (1.0 - correction)
    }

    /// The mark's time in us since 1970 (UTC); `None`: the leap seconds are not known.
    #[must_use]
    pub fn unix_us(&self) -> Option<u64> {
        let seconds = u64::from(self.week) * u64::from(WEEK_S) + u64::from(self.second) + GPS_EPOCH_UNIX_S;
        (self.leap_s != NO_LEAP).then(|| (seconds - u64::from(self.leap_s)) * 1_000_000)
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub struct GnssClock {
    timebase: Timebase,
    last: Option<u32>,
    mark: Option<TimeMark>,
    /// Pulses since the last message that was used.
    untold: u32,
    contradictions: u8,
}

impl GnssClock {
    /// Nothing is known. `timebase`: the timer that stamps the pulses.
    #[must_use]
    pub const fn new(timebase: Timebase) -> Self {
        Self { timebase, last: None, mark: None, untold: 0, contradictions: 0 }
    }

    /// A pulse came at a tick.
    pub fn pulse(&mut self, tick: u32) {
        let rate = self.timebase.ticks_per_s().max(1);
        let Some(last) = self.last else {
            self.last = Some(tick);
            return;
        };
        let ticks = tick.wrapping_sub(last);
        let seconds = ticks.saturating_add(rate / 2) / rate;
        if seconds == 0 || ticks.abs_diff(seconds.saturating_mul(rate)) > seconds.saturating_mul(rate / RHYTHM) {
            // A disturbance, or another source of pulses: a mark is made of it only by the next messages.
            if seconds > 0 {
                (self.last, self.mark) = (Some(tick), None);
            }
            return;
        }
        self.last = Some(tick);
        self.untold = self.untold.saturating_add(seconds);
        if let Some(mark) = &mut self.mark {
            // (It may have been carried on meanwhile.)
            let second = mark.second + (tick.wrapping_sub(mark.tick).saturating_add(rate / 2)) / rate;
            mark.week = mark.week.wrapping_add((second / WEEK_S) as u16);
            (mark.tick, mark.second) = (tick, second % WEEK_S);
        }
    }

    /// A message came, when the timer read `now`: of the last pulse. One that contradicts the seconds counted is used when three in a row do; impossible
    /// ones, and ones without a pulse, never.
    pub fn set(&mut self, time: GnssTime, now: u32) {
        let Some(tick) = self.last.filter(|last| now.wrapping_sub(*last) <= self.timebase.ms(OLDEST_MS)) else {
            return;
        };
        if time.second >= WEEK_S {
            return;
        }
        let agrees = self.mark.is_none_or(|m| (m.week, m.second) == (time.week, time.second));
        self.contradictions = if agrees { 0 } else { self.contradictions + 1 };
        if agrees || self.contradictions >= CONTRADICTIONS {
            let GnssTime { week, second, std_ns, leap_s } = time;
            self.mark = Some(TimeMark { tick, week, second, std_ns, leap_s, quality: 0 });
            (self.untold, self.contradictions) = (0, 0);
        }
    }

    /// The mark when the timer reads `now`; `correction`: relative error of the timer. Where pulses have stopped it is carried on to the last whole second, so
    /// that it is never far from a frame.
    pub fn mark(&mut self, now: u32, correction: f64) -> Option<TimeMark> {
        let rate = self.timebase.ticks_per_s().max(1);
        let mark = self.mark.as_mut()?;
        // (A second of the timer, as it is corrected.)
        let second = rate.wrapping_add_signed((f64::from(rate) * correction) as i32).max(1);
        let mut coasted = 0;
        while now.wrapping_sub(mark.tick) as i32 > (2 * second) as i32 && coasted < 60 {
            mark.tick = mark.tick.wrapping_add(second);
            mark.second += 1;
            if mark.second == WEEK_S {
                (mark.week, mark.second) = (mark.week.wrapping_add(1), 0);
            }
            mark.std_ns = mark.std_ns.saturating_add(COAST_NS_PER_S);
            coasted += 1;
        }
        let by_pulse = self.last == Some(mark.tick);
        let quality = match (by_pulse, self.untold) {
            (false, _) => Quality::Coasting,
            (true, 0..=2) => Quality::Told,
            (true, _) => Quality::Counted,
        };
        // A tick is even over 11 ns; what the correction leaves goes into the second that follows.
        let tick_ns = 1e9 / f64::from(rate) / 3.464;
        let own_ns = libm::sqrt(f64::from(mark.std_ns) * f64::from(mark.std_ns) + tick_ns * tick_ns);
        Some(TimeMark { std_ns: own_ns as u32 + 1, quality: quality as u8, ..*mark })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: u64 = 90_000_000;

    fn told(week: u16, second: u32) -> GnssTime {
        GnssTime { week, second, std_ns: 20, leap_s: 18 }
    }

    /// A clock with pulses at seconds `from..to`, fast by 10 ppm, told at each of them.
    fn running(seconds: core::ops::Range<u32>) -> GnssClock {
        let mut clock = GnssClock::new(Timebase::REFERENCE);
        for s in seconds {
            clock.pulse(tick(s));
            clock.set(told(2394, 1000 + s), tick(s).wrapping_add(9_000_000));
        }
        clock
    }

    fn tick(second: u32) -> u32 {
        (u64::from(second) * (RATE + 900)) as u32
    }

    #[test]
    fn a_frame_s_time_is_that_of_the_mark_and_the_ticks_between() {
        let mut clock = running(0..200);
        let mark = clock.mark(tick(199) + 50_000_000, 1e-5).expect("known");
        assert_eq!((mark.week, mark.second, mark.quality), (2394, 1199, Quality::Told as u8));
        // Half a second later by the true time.
        let at = tick(199).wrapping_add(45_000_450);
        assert!((mark.seconds_to(at, Timebase::REFERENCE, 1e-5) - 0.5).abs() < 1e-9);
        assert_eq!(mark.unix_us(), Some((2394 * 604_800 + 1199 + GPS_EPOCH_UNIX_S - 18) * 1_000_000));
        assert!((20..25).contains(&mark.std_ns), "{}", mark.std_ns);
    }

    #[test]
    fn seconds_are_counted_without_messages_and_without_pulses() {
        let mut clock = running(0..10);
        for s in 10..20 {
            clock.pulse(tick(s));
        }
        let mark = clock.mark(tick(19) + 9, 0.0).expect("known");
        assert_eq!((mark.second, mark.quality), (1019, Quality::Counted as u8));
        // Ten seconds without a pulse.
        let mark = clock.mark(tick(29) + 9_000_000, 1e-5).expect("known");
        assert_eq!((mark.second, mark.quality), (1028, Quality::Coasting as u8));
        assert!(mark.std_ns >= 9 * COAST_NS_PER_S && mark.tick.abs_diff(tick(28)) < 20, "{mark:?}");
        // And with pulses again.
        clock.pulse(tick(30));
        let mark = clock.mark(tick(30) + 9, 1e-5).expect("known");
        assert_eq!(mark.second, 1030);
    }

    #[test]
    fn what_contradicts_is_used_after_three_and_what_has_no_pulse_never() {
        let mut clock = running(0..10);
        for s in 10..13u32 {
            clock.pulse(tick(s));
            clock.set(told(2394, 5000 + s), tick(s) + 1000);
            let mark = clock.mark(tick(s) + 2000, 0.0).expect("known");
            assert_eq!(mark.second, if s < 12 { 1000 + s } else { 5000 + s }, "{s}");
        }
        let mut clock = GnssClock::new(Timebase::REFERENCE);
        clock.set(told(1, 1), 5);
        assert_eq!(clock.mark(6, 0.0), None);
        clock.pulse(0);
        clock.set(told(1, 1), 89_000_000);
        assert_eq!(clock.mark(89_000_000, 0.0), None, "nearly a second late");
        clock.set(told(1, WEEK_S), 1000);
        assert_eq!(clock.mark(1000, 0.0), None, "no week has that second");
    }
}
