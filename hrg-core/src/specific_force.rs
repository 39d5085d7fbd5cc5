//! Three accelerometers over temperature: from codes to specific force along the axes of the case.
//!
//! `corrected = M(T) * S(T) * (raw - bias(T))`, the rule and the frames of [`crate::rate_factors`]: `raw` is what each accelerometer gives along its own
//! sensitive axis, in m/s^2 by its constant scale. Accelerometer `k` sits beside gyro `k`, whose resonator is its thermometer.
//!
//! # Equations
//! The bias has the terms of a scale factor: `b0 + b1 u + b2 u^2 + b3 u^3 + b4 r + b5 u r` ([`crate::rate_factors::scale_regressors`]). Source: IEEE Std 1293-2018
//! (model equation of a linear accelerometer; its nonlinear terms are left out).
//!
//! # Example
//! ```
//! use hrg_core::rate_factors::Factors;
//! use hrg_core::specific_force::SpecificForce;
//!
//! // Half of the scale is 1 g; z reads 1 mg too much and 200 ppm too little.
//! let g = SpecificForce::NONE.of_codes(1.0).corrected([0, 0, 1 << 22]);
//! assert!((g[2] - 9.806_65).abs() < 1e-5);
//! let factors = Factors::new([1.0, 1.0, 1.0002], [[0.0; 2]; 3]);
//! let errors = SpecificForce { bias_mps2: [0.0, 0.0, 9.8e-3], factors, ..SpecificForce::NONE };
//! let corrected = errors.of_codes(1.0).corrected([0, 0, 1 << 22]);
//! assert!((corrected[2] - 9.798_809).abs() < 1e-5);
//! ```

use crate::accelerometers::MPS2_PER_CODE;
use crate::bias::{clamp, Scaling, State};
use crate::rate_factors::{Factors, OfCodes, RateAxis, SCALE_TERMS, STATED_AT};
use crate::schema::layout;
use crate::status::AxisStatus;
use crate::AXES;

/// A bias beyond this is no accelerometer's, m/s^2.
pub const MOST_BIAS_MPS2: f32 = 1.0;

/// Bias of one accelerometer over temperature, as the image holds it; scale factor and misalignment are a [`RateAxis`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AccelerometerBias {
    /// Coefficients of [`crate::rate_factors::scale_regressors`], m/s^2.
    pub bias_mps2: [f32; SCALE_TERMS],
    /// Standard deviation on a soak at each of [`STATED_AT`] temperatures of the range, m/s^2: noise, and what the curve does not follow.
    pub bias_std_mps2: [f32; STATED_AT],
}
layout! { AccelerometerBias {
    bias_mps2: [f32; SCALE_TERMS], "bias of the accelerometer: coefficients of `1, u, u^2, u^3, r, u r`, m/s^2";
    bias_std_mps2: [f32; STATED_AT], "standard deviation of that on a soak at five temperatures of the range, evenly, m/s^2";
} }

/// One accelerometer over temperature.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Accelerometer {
    /// Its bias.
    pub bias: AccelerometerBias,
    /// Its scale factor and misalignment, with the range of the fit.
    pub errors: RateAxis,
}

impl Accelerometer {
    /// Bias, m/s^2, factor, misalignments and status in a thermal state. Outside the range of the fit they stay at its end, flagged.
    #[must_use]
    pub fn at(&self, scaling: &Scaling, state: &State) -> (f32, f32, [f32; 2], AxisStatus) {
        let (x, _) = self.errors.regressors(scaling, state);
        let mut bias = 0.0;
        for (c, x) in self.bias.bias_mps2.iter().zip(x) {
            bias += c * x;
        }
        let (scale, coupling, status) = self.errors.at(scaling, state);
        (clamp(bias, -MOST_BIAS_MPS2, MOST_BIAS_MPS2), scale, coupling, status)
    }

    /// Standard deviation of the bias on a soak at a temperature, m/s^2: between those stated; beyond the range, that of its end.
    #[must_use]
    pub fn bias_std_at_mps2(&self, temperature_c: f32) -> f32 {
        self.errors.between(&self.bias.bias_std_mps2, temperature_c)
    }

    /// `true` if each number is one of an accelerometer.
    #[must_use]
    pub fn possible(&self) -> bool {
        let bounded = |values: &[f32]| values.iter().all(|v| v.abs() <= MOST_BIAS_MPS2);
        bounded(&self.bias.bias_mps2)
            && bounded(&self.bias.bias_std_mps2)
            && self.bias.bias_std_mps2.iter().all(|s| *s >= 0.0)
    }
}

/// Errors of the accelerometers at the temperatures of a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpecificForce {
    /// Biases, m/s^2.
    pub bias_mps2: [f32; AXES],
    /// Scale factors and misalignments.
    pub factors: Factors,
    /// Accelerometers outside the temperatures or ramps of their fit.
    pub outside: [bool; AXES],
}

impl Default for SpecificForce {
    fn default() -> Self {
        Self::NONE
    }
}

impl SpecificForce {
    /// Those of an image that has none.
    pub const NONE: Self = Self { bias_mps2: [0.0; AXES], factors: Factors::UNIT, outside: [false; AXES] };

    /// From codes to specific force along the axes of the case, m/s^2, times `unit`.
    #[inline]
    #[must_use]
    pub fn of_codes(&self, unit: f32) -> OfCodes {
        self.factors.of_codes([MPS2_PER_CODE as f32; AXES], self.bias_mps2, unit)
    }

    /// `true` if both are the same to the last bit.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        self.bias_mps2.map(f32::to_bits) == other.bias_mps2.map(f32::to_bits)
            && self.factors.same(&other.factors)
            && self.outside == other.outside
    }

    /// A number that changes with any bit of them.
    #[inline]
    pub(crate) fn fold(&self) -> u32 {
        let [a, b, c] = self.bias_mps2.map(f32::to_bits);
        let outside = self.outside.iter().fold(0, |bits, o| bits << 1 | u32::from(*o));
        self.factors.fold().rotate_left(3) ^ a ^ b.rotate_left(11) ^ c.rotate_left(22) ^ outside.rotate_left(17)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Calibration;

    #[test]
    fn an_accelerometer_follows_its_curve_and_stays_at_the_end_of_its_range() {
        let scaling = &Calibration::uncalibrated().scaling;
        let state = |temperature_c, ramp_c_per_min| State {
            temperature_c,
            ramp_c_per_min,
            difference_c_per_min: 0.0,
            frequency_u: 0.0,
            frequency_u_per_min: 0.0,
        };
        let one = Accelerometer {
            bias: AccelerometerBias {
                bias_mps2: [0.01, 0.02, -0.005, 0.001, 0.003, 0.002],
                bias_std_mps2: [1e-4; STATED_AT],
            },
            errors: RateAxis {
                rate_valid_from_c: -40.0,
                rate_valid_to_c: 60.0,
                rate_valid_from_c_per_min: -2.0,
                rate_valid_to_c_per_min: 2.0,
                scale_correction_ppm: [100.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                ..RateAxis::default()
            },
        };
        assert!(one.possible() && (one.bias_std_at_mps2(13.0) - 1e-4).abs() < 1e-9);
        let (bias, scale, _, status) = one.at(scaling, &state(55.0, 1.0));
        // u = 1.
        assert!((bias - 0.031).abs() < 1e-7 && (scale - 1.0001).abs() < 1e-7 && status.is_empty());
        assert_eq!(one.at(scaling, &state(99.0, 1.0)).0, one.at(scaling, &state(60.0, 1.0)).0);
        assert!(one.at(scaling, &state(99.0, 1.0)).3.contains(AxisStatus::SCALE_FACTOR));
        let mut absurd = one;
        absurd.bias.bias_mps2[0] = f32::NAN;
        assert!(!absurd.possible());
    }

    #[test]
    fn every_bit_changes_the_fold() {
        let f = SpecificForce { bias_mps2: [1e-3, -2e-3, 3e-3], ..SpecificForce::NONE };
        for bit in 0..32 {
            for k in 0..AXES {
                let mut g = f;
                g.bias_mps2[k] = f32::from_bits(g.bias_mps2[k].to_bits() ^ 1 << bit);
                assert!(g.fold() != f.fold() && !g.same(&f));
            }
        }
    }
}
