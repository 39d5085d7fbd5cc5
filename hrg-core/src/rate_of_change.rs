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

/// Steps in the window of the slope: 20 s at one step a second.
pub const WINDOW: usize = 20;

/// Steps of the difference of wu2023: 60 s.
pub const DIFFERENCE: usize = 60;

/// The slope is given once this many values are in; before, it is zero.
pub const WINDOW_MIN: usize = 10;

/// Least-squares slope over a sliding window. Delay on a change of slope: 9.5 s.
#[derive(Debug, Clone, PartialEq)]
pub struct SlopeWindow {
    values: [f32; WINDOW],
    filled: usize,
    at: usize,
}

impl Default for SlopeWindow {
    fn default() -> Self {
        Self { values: [f32::NAN; WINDOW], filled: 0, at: 0 }
    }
}

impl SlopeWindow {
    /// Takes the newest value (`None`: missing, left out of the fit) and gives the slope per minute. Zero until [`WINDOW_MIN`] values are in.
    pub fn push(&mut self, value: Option<f32>) -> f32 {
        self.values[self.at] = value.unwrap_or(f32::NAN);
        let newest = self.at;
        self.at = (self.at + 1) % WINDOW;
        self.filled = (self.filled + 1).min(WINDOW);
        // Ages are small integers and values are taken relative to a recent one: f32 loses nothing.
        let mut reference = f32::NAN;
        for age in 0..self.filled {
            let v = self.values[(newest + WINDOW - age) % WINDOW];
            if !v.is_nan() {
                reference = v;
                break;
            }
        }
        let (mut n, mut sx, mut sxx, mut sy, mut sxy) = (0u32, 0u32, 0u32, 0.0f32, 0.0f32);
        let mut age = 0u32;
        let mut index = newest;
        while (age as usize) < self.filled {
            let v = self.values[index];
            if !v.is_nan() {
                let y = v - reference;
                n += 1;
                sx += age;
                sxx += age * age;
                sy += y;
                sxy += age as f32 * y;
            }
            age += 1;
            index = if index == 0 { WINDOW - 1 } else { index - 1 };
        }
        if (n as usize) < WINDOW_MIN {
            return 0.0;
        }
        let nf = n as f32;
        let den = (n * sxx - sx * sx) as f32;
        // Age runs backwards, hence the sign.
        -(nf * sxy - sx as f32 * sy) / den * (60.0 / crate::MODEL_STEP_S)
    }

    /// Whether the window is full.
    #[must_use]
    pub fn settled(&self) -> bool {
        self.filled == WINDOW
    }
}

/// Temperature now minus that of [`DIFFERENCE`] steps ago, in C per minute (wu2023). Delay: 30 s.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    values: [f32; DIFFERENCE],
    filled: usize,
    at: usize,
}

impl Default for Difference {
    fn default() -> Self {
        Self { values: [0.0; DIFFERENCE], filled: 0, at: 0 }
    }
}

impl Difference {
    /// Takes the newest temperature in C; zero until a minute is in. A missing value repeats the last one.
    pub fn push(&mut self, temperature_c: f32) -> f32 {
        let old = self.values[self.at];
        self.values[self.at] = temperature_c;
        self.at = (self.at + 1) % DIFFERENCE;
        if self.filled < DIFFERENCE {
            self.filled += 1;
            return 0.0;
        }
        (temperature_c - old) * (60.0 / (DIFFERENCE as f32 * crate::MODEL_STEP_S))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_on_a_ramp_even_with_holes() {
        let mut w = SlopeWindow::default();
        let mut d = Difference::default();
        let (mut s, mut e) = (0.0, 0.0);
        for k in 0..200u16 {
            let t = 20.0 + f32::from(k) * 0.05;
            s = w.push(if k % 7 == 3 { None } else { Some(t) });
            e = d.push(t);
        }
        assert!((s - 3.0).abs() < 1e-3, "slope {s}");
        assert!((e - 3.0).abs() < 1e-3, "difference {e}");
    }

    #[test]
    fn delay_is_as_documented() {
        // A slope that grows steadily: the window must give the slope of 9.5 s ago.
        let mut w = SlopeWindow::default();
        let mut s = 0.0;
        for k in 0..400 {
            let t = k as f32;
            s = w.push(Some(0.5 * 1e-3 * t * t));
        }
        let slope_at = s / 60.0 / 1e-3;
        assert!((399.0 - slope_at - 9.5).abs() < 0.1, "slope of {slope_at}");
    }

    #[test]
    fn no_slope_from_few_values() {
        let mut w = SlopeWindow::default();
        for k in 0..9 {
            assert_eq!(w.push(Some(k as f32)), 0.0);
        }
        assert_eq!(SlopeWindow::default().push(None), 0.0);
    }
}
