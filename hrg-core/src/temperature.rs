//! Resonator frequency to temperature, and back.
//!
//! The unit evaluates `T(f)` directly: a cubic in `u = (f - f0) / scale`, so that every term is of order one
//! and f32 suffices. dong2023 prints the same cubic uncentred, with terms of 2e6 that cancel to 50: evaluated
//! so, its temperatures sit 0.022 C low. The forward curve `f(T)` with its root by Newton's method is kept as
//! the reference that the inverse replaces.
//!
//! # Example
//! ```
//! use hrg_core::temperature::TemperatureCurve;
//!
//! let curve = TemperatureCurve {
//!     frequency_centre_hz: 4900.0,
//!     frequency_scale_hz: 22.0,
//!     temperature_coefficients_c: [9.6, 45.0, 0.4, -0.2],
//!     valid_from_c: -36.0,
//!     valid_to_c: 55.0,
//! };
//! assert_eq!(curve.temperature_c(4900.0), 9.6);
//! let f = curve.frequency_hz(25.0).expect("within the range");
//! assert!((curve.temperature_c(f) - 25.0).abs() < 2e-5);
//! ```

/// `T(f)`: a cubic about a centre. The unit evaluates this form.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TemperatureCurve {
    /// Centre `f0`, Hz. Subtracted without rounding.
    pub frequency_centre_hz: f64,
    /// Half-width of the fitted range, Hz.
    pub frequency_scale_hz: f32,
    /// Coefficients of `u^0..u^3`, C.
    pub temperature_coefficients_c: [f32; 4],
    /// Lowest temperature of the fit, C.
    pub valid_from_c: f32,
    /// Highest temperature of the fit, C.
    pub valid_to_c: f32,
}

impl TemperatureCurve {
    /// `true` if this is the curve of a temperature sensor: `T = T`. Its centre and scale are then temperatures in C,
    /// and so are the readings that it is given.
    #[must_use]
    pub fn is_of_sensor(&self) -> bool {
        self.temperature_coefficients_c == [self.frequency_centre_hz as f32, self.frequency_scale_hz, 0.0, 0.0]
    }

    /// Centred and scaled frequency, about -1 to 1 inside the fitted range.
    #[inline]
    #[must_use]
    pub fn normalised(&self, frequency_hz: f64) -> f32 {
        (frequency_hz - self.frequency_centre_hz) as f32 / self.frequency_scale_hz
    }

    /// Temperature in C of a frequency in Hz.
    ///
    /// Good to 2e-5 C against the same polynomial in f64 (test `table1`). Not clamped: compare with
    /// [`valid_from_c`](Self::valid_from_c) and [`valid_to_c`](Self::valid_to_c).
    #[inline]
    #[must_use]
    pub fn temperature_c(&self, frequency_hz: f64) -> f32 {
        self.at_c(self.normalised(frequency_hz))
    }

    /// Temperature in C at a normalised frequency.
    #[inline]
    #[must_use]
    pub fn at_c(&self, u: f32) -> f32 {
        ((self.temperature_coefficients_c[3] * u + self.temperature_coefficients_c[2]) * u
            + self.temperature_coefficients_c[1])
            * u
            + self.temperature_coefficients_c[0]
    }

    /// Slope dT/du in C at a normalised frequency.
    #[inline]
    #[must_use]
    pub fn slope_c(&self, u: f32) -> f32 {
        (3.0 * self.temperature_coefficients_c[3] * u + 2.0 * self.temperature_coefficients_c[2]) * u
            + self.temperature_coefficients_c[1]
    }

    /// Temperature in C and its slope dT/du in C at a normalised frequency: what a model step needs.
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    #[must_use]
    pub fn value_and_slope(&self, u: f32) -> (f32, f32) {
        (self.at_c(u), self.slope_c(u))
    }

    /// Slope dT/df in C per Hz at a frequency.
    #[must_use]
    pub fn slope_c_per_hz(&self, frequency_hz: f64) -> f32 {
        self.slope_c(self.normalised(frequency_hz)) / self.frequency_scale_hz
    }

    /// The frequency in Hz at a temperature in C: Newton's method on this curve, f64.
    ///
    /// For simulation and checks; `None` if it does not converge (far outside the range).
    #[must_use]
    pub fn frequency_hz(&self, temperature_c: f64) -> Option<f64> {
        let c = self.temperature_coefficients_c.map(f64::from);
        let mut u = (temperature_c - c[0]) / c[1];
        for _ in 0..30 {
            let value = ((c[3] * u + c[2]) * u + c[1]) * u + c[0] - temperature_c;
            let slope = (3.0 * c[3] * u + 2.0 * c[2]) * u + c[1];
            let step = value / slope;
            u -= step;
            if !u.is_finite() || libm::fabs(u) > 1e3 {
                return None;
            }
            if libm::fabs(step) < 1e-15 * (1.0 + libm::fabs(u)) {
                break;
            }
        }
        Some(self.frequency_centre_hz + u * f64::from(self.frequency_scale_hz))
    }
}

/// `f(T)`: the forward cubic (dong2023 eq 1 and 2), in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForwardCurve {
    /// Centre, C.
    pub t0_c: f64,
    /// Half-width of the fitted range, C.
    pub scale_c: f64,
    /// Coefficients of `v^0..v^3` with `v = (T - t0) / scale`, Hz.
    pub c: [f64; 4],
}

impl ForwardCurve {
    /// Frequency in Hz at a temperature in C.
    #[must_use]
    pub fn frequency_hz(&self, temperature_c: f64) -> f64 {
        let v = (temperature_c - self.t0_c) / self.scale_c;
        ((self.c[3] * v + self.c[2]) * v + self.c[1]) * v + self.c[0]
    }

    /// Root in C of `f(T) = frequency`, by Newton's method from `guess_c` (take the inverse curve's value).
    ///
    /// `None` if 30 steps do not converge.
    #[must_use]
    pub fn root_c(&self, frequency_hz: f64, guess_c: f64) -> Option<f64> {
        let mut v = (guess_c - self.t0_c) / self.scale_c;
        for _ in 0..30 {
            let value = ((self.c[3] * v + self.c[2]) * v + self.c[1]) * v + self.c[0] - frequency_hz;
            let slope = (3.0 * self.c[3] * v + 2.0 * self.c[2]) * v + self.c[1];
            let step = value / slope;
            v -= step;
            if !v.is_finite() {
                return None;
            }
            // Convergence is quadratic: the next step would be lost in the rounding of the frequency, which is some 1e-13 here.
            if libm::fabs(step) < 1e-11 * (1.0 + libm::fabs(v)) {
                return Some(self.t0_c + v * self.scale_c);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_and_root_agree() {
        let curve = TemperatureCurve {
            frequency_centre_hz: 4900.0,
            frequency_scale_hz: 22.0,
            temperature_coefficients_c: [9.6, 45.0, 0.4, -0.2],
            valid_from_c: -36.0,
            valid_to_c: 55.0,
        };
        for t in [-35.0, -10.0, 0.0, 33.3, 55.0] {
            let f = curve.frequency_hz(t).expect("converges");
            assert!((f64::from(curve.temperature_c(f)) - t).abs() < 2e-5);
        }
        assert!(curve.frequency_hz(f64::NAN).is_none());
    }
}
