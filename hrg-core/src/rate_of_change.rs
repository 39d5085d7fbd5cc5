//! Rate of change, causal, with its delay stated. The unit takes the slope of the normalised frequency, which is what it
//! measures, and makes the slope of temperature from it by the chain rule.
//!
//! Two estimators. [`SlopeWindow`] is what the unit uses: the least-squares slope over the last
//! [`WINDOW`] model steps. [`Difference`] is the one of wu2023 (temperature now minus 60 s ago). On a steady
//! ramp both are exact; where the slope changes, both answer late: the window by `(WINDOW - 1) / 2` = 9.5 s, the
//! difference by 30 s. White noise of the temperature enters the slope `sqrt(12 / N^3)` strong per second (0.039
//! for N = 20) and the difference `sqrt(2) / 60` (0.024).
//!
//! # Why 20 s
//! A resonator's temperature is known to 0.01 mK in a second, so noise is no matter: 0.02 mK per minute. Delay is:
//! at the start of a ramp the window lags behind the physics, and what the model then misses looks like a second
//! derivative that is not there. Even a counter that only shows millihertz (2 mK) gives 5 mK per minute.
//!
//! # Example
//! ```
//! use hrg_core::rate_of_change::{Difference, SlopeWindow};
//!
//! // A ramp of 0.02 a second is one of 1.2 a minute.
//! let (mut slope, mut difference) = (SlopeWindow::default(), Difference::default());
//! let (mut s, mut d) = (0.0, 0.0);
//! for k in 0..70 {
//!     s = slope.push(Some(0.02 * k as f32));
//!     d = difference.push(0.02 * k as f32);
//! }
//! assert!((s - 1.2).abs() < 1e-5 && (d - 1.2).abs() < 1e-3);
//! ```

/// Steps in the window of the slope: 20 s at one step a second.
pub const WINDOW: usize = 20;

/// Steps of the difference of wu2023: 60 s.
pub const DIFFERENCE: usize = 60;

/// The slope is given once this many values are in; before, it is zero.
pub const WINDOW_MIN: usize = 10;

/// Values are kept as whole numbers of 2^-28: normalised frequencies are of order one, and 4e-9 is finer than single
/// precision there. So the sums over the window are exact, and moving it on costs a few additions.
const UNIT: f32 = (1u32 << 28) as f32;

/// A slope per step, of values in that unit, as a slope per minute.
const PER_MINUTE: f32 = 60.0 / (UNIT * crate::MODEL_STEP_S);

/// In place of a value that is missing. (A value of -8 counts as missing, too.)
const MISSING: i32 = i32::MIN;

/// Least-squares slope over a sliding window, of values within -8 to 8. Delay on a change of slope: 9.5 s.
#[derive(Debug, Clone, PartialEq)]
pub struct SlopeWindow {
    /// Values in units of 2^-28, or [`MISSING`]; a ring.
    values: [i32; WINDOW],
    /// Index of the oldest value, which the next one replaces.
    at: usize,
    /// Values that are there.
    n: usize,
    /// Values taken, missing ones too, up to [`WINDOW`].
    filled: usize,
    settled: bool,
    /// Sum of the values that are there.
    sum: i64,
    /// Of a window without gaps, the sum of (mean age - age) times value, times [`WINDOW`]: the slope, but for a factor.
    moment: i64,
}

/// The window's length, the sum of its ages 0, 1, ..., and the sum of their squares about their mean, times the length.
const N: i64 = WINDOW as i64;
const AGES: i64 = N * (N - 1) / 2;
const SPREAD: i64 = N * N * (N * N - 1) / 12;

impl Default for SlopeWindow {
    fn default() -> Self {
        Self { values: [MISSING; WINDOW], at: 0, n: 0, filled: 0, settled: false, sum: 0, moment: 0 }
    }
}

impl SlopeWindow {
    /// Takes the newest value (`None`: missing, left out of the fit) and gives the slope per minute. Zero until
    /// [`WINDOW_MIN`] values are in.
    #[inline]
    pub fn push(&mut self, value: Option<f32>) -> f32 {
        let at = self.at.min(WINDOW - 1);
        let newest = value.map_or(MISSING, |v| (v * UNIT) as i32);
        let oldest = core::mem::replace(&mut self.values[at], newest);
        self.at = if at + 1 < WINDOW { at + 1 } else { 0 };
        if self.n < WINDOW || newest == MISSING {
            return self.with_gaps();
        }
        // All ages grow by one; the oldest, now as old as the window is long, leaves.
        self.moment += AGES * i64::from(newest) + (N * N - AGES) * i64::from(oldest) - N * self.sum;
        self.sum += i64::from(newest) - i64::from(oldest);
        self.moment as f32 * (PER_MINUTE / SPREAD as f32)
    }

    /// The slope of the values that are there, and all sums anew: where one is missing, or the window is not full yet.
    #[inline(never)]
    fn with_gaps(&mut self) -> f32 {
        let (older, newer) = self.values.split_at(self.at.min(WINDOW));
        let (mut n, mut s_age, mut s_age2, mut s_value, mut s_both) = (0, 0, 0, 0, 0);
        for (age, value) in (0i64..).zip(older.iter().rev().chain(newer.iter().rev())) {
            if *value != MISSING {
                n += 1;
                s_age += age;
                s_age2 += age * age;
                s_value += i64::from(*value);
                s_both += age * i64::from(*value);
            }
        }
        self.n = n as usize;
        self.filled = (self.filled + 1).min(WINDOW);
        self.settled = self.filled == WINDOW && self.n >= WINDOW_MIN;
        self.sum = s_value;
        self.moment = AGES * s_value - N * s_both;
        if self.n < WINDOW_MIN {
            return 0.0;
        }
        // Age runs backwards, hence the sign.
        (s_age * s_value - n * s_both) as f32 / (n * s_age2 - s_age * s_age) as f32 * PER_MINUTE
    }

    /// `true` if the window is full and holds enough values for a slope: after an outage it does not.
    #[inline]
    #[must_use]
    pub fn settled(&self) -> bool {
        self.settled
    }
}

/// Temperature now minus that of [`DIFFERENCE`] steps ago, in C per minute (wu2023). Delay: 30 s.
#[derive(Debug, Clone)]
pub struct Difference {
    /// A ring; NaN where nothing is yet.
    values: [f32; DIFFERENCE],
    at: usize,
}

impl Default for Difference {
    fn default() -> Self {
        Self { values: [f32::NAN; DIFFERENCE], at: 0 }
    }
}

impl Difference {
    /// Takes the newest temperature in C; zero until a minute is in. A missing value repeats the last one.
    #[inline]
    pub fn push(&mut self, temperature_c: f32) -> f32 {
        let at = self.at.min(DIFFERENCE - 1);
        let old = core::mem::replace(&mut self.values[at], temperature_c);
        self.at = if at + 1 < DIFFERENCE { at + 1 } else { 0 };
        if old.is_nan() {
            return 0.0;
        }
        (temperature_c - old) * (60.0 / (DIFFERENCE as f32 * crate::MODEL_STEP_S))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_on_a_ramp_even_with_gaps() {
        let mut w = SlopeWindow::default();
        let mut d = Difference::default();
        let (mut s, mut e) = (0.0, 0.0);
        for k in 0..200u16 {
            let t = f32::from(k) * 0.02;
            s = w.push(if k % 7 == 3 { None } else { Some(t) });
            e = d.push(t);
        }
        assert!((s - 1.2).abs() < 1e-5, "slope {s}");
        assert!((e - 1.2).abs() < 1e-3, "difference {e}");
    }

    #[test]
    fn delay_is_as_documented() {
        // A slope that grows steadily: the window must give the slope of 9.5 s ago.
        let mut w = SlopeWindow::default();
        let mut s = 0.0;
        for k in 0..400 {
            let t = k as f32;
            s = w.push(Some(0.5 * 1e-5 * t * t));
        }
        let slope_at = s / 60.0 / 1e-5;
        assert!((399.0 - slope_at - 9.5).abs() < 0.1, "slope of {slope_at}");
    }

    #[test]
    fn no_slope_from_few_values() {
        let mut w = SlopeWindow::default();
        for k in 0..9 {
            assert_eq!(w.push(Some(0.1 * k as f32)), 0.0);
        }
        assert_eq!(SlopeWindow::default().push(None), 0.0);
    }

    #[test]
    fn moving_on_is_as_summing_anew() {
        let mut w = SlopeWindow::default();
        let mut kept = [f64::NAN; 500];
        for k in 0..500usize {
            let x = (k as f32 * 0.37).sin() * 1.5;
            let missing = k % 11 == 4 || (200..230).contains(&k);
            kept[k] = if missing { f64::NAN } else { f64::from(x) };
            let s = w.push(Some(x).filter(|_| !missing));
            let rows = || (0..WINDOW.min(k + 1)).map(|a| (a as f64, kept[k - a])).filter(|(_, v)| v.is_finite());
            let n = rows().count() as f64;
            if n < WINDOW_MIN as f64 {
                assert_eq!(s, 0.0);
                continue;
            }
            let mean = |f: &dyn Fn((f64, f64)) -> f64| rows().map(f).sum::<f64>() / n;
            let (ma, mv) = (mean(&|r| r.0), mean(&|r| r.1));
            let slope = -60.0 * mean(&|r| (r.0 - ma) * (r.1 - mv)) / mean(&|r| (r.0 - ma) * (r.0 - ma));
            assert!((f64::from(s) - slope).abs() < 1e-5 * (1.0 + slope.abs()), "{k}: {s} {slope}");
        }
    }
}
