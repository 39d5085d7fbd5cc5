//! Scale factor and misalignment over temperature: from a raw rate to a corrected one. The sign rule and the order of operations stand
//! here, and nowhere else:
//!
//! `corrected = M(T) * S(T) * (raw - bias)`
//!
//! # Frames
//! `raw` is what each gyro gives along its own sensitive axis, in deg/h by the constant scale factor of the image. `raw - bias` is still
//! along the sensitive axes, and so is `S (raw - bias)`, whose unit is right now. `M` brings it to the axes of the unit's case, which are
//! those of the rate table that it was calibrated on. So the bias lies in the frame of the gyros.
//!
//! # Equations
//! `S` is diagonal: `S_i = 1 + 1e-6 (c0 + c1 u + c2 u^2 + c3 u^3 + c4 r + c5 u r)` with the temperature `u` of axis `i`
//! ([`crate::bias::Scaling::u`]) and its ramp `r` in C per minute. `M` has ones on its diagonal, and beside it
//! `M_ij = 1e-6 (m0 + m1 u)` with the temperature of axis `i`, in the order of [`OTHERS`]. Source: IEEE Std 1431-2004, section 9 (scale
//! factor, misalignment and their sensitivities to temperature).
//!
//! # Cost
//! The factors are computed once a model step. A sample costs one multiplication an axis, and where `M` is not the unit matrix two more with
//! their sums. Without factors in the image they are exactly one and zero, which leave each rate as it is to the last bit.
//!
//! # Example
//! ```
//! use hrg_core::rate_factors::Factors;
//!
//! // S: x reads 200 ppm too little. M: x takes 300 urad of y.
//! let factors = Factors::new([1.0002, 1.0, 1.0], [[3.0e-4, 0.0], [0.0; 2], [0.0; 2]]);
//! let corrected = factors.corrected_dph([10_001.0, 20_000.0, 0.0], [1.0, 0.0, 0.0]);
//! assert!((corrected[0] - 10_008.0).abs() < 0.01);
//! assert_eq!(Factors::default().corrected_dph([10_001.0; 3], [1.0; 3]), [10_000.0; 3]);
//! ```
//!
//! # Limits
//! Outside the temperatures and ramps of its fit a factor keeps the value at the end of the range, and beyond [`MOST_PPM`] it is
//! limited; either is flagged [`AxisStatus::SCALE_FACTOR`].

use crate::bias::{clamp, Scaling, State};
use crate::schema::layout;
use crate::status::AxisStatus;
use crate::AXES;

/// Terms of a scale factor: `1, u, u^2, u^3`, the ramp `r`, and `u r`: a body that lags answers to a ramp by the slope of its curve, which
/// is another one at another temperature.
pub const SCALE_TERMS: usize = 6;

/// Temperatures at which the standard deviation of a scale factor is stated: the ends of its range, and three between, evenly.
pub const STATED_AT: usize = 5;

/// Regressors of an element of the misalignment: `1` and `u`.
pub const MISALIGNMENT_TERMS: usize = 2;

/// The other axes of each axis, in the order of its misalignments.
pub const OTHERS: [[usize; 2]; AXES] = [[1, 2], [0, 2], [0, 1]];

/// A factor further than this from that of a perfect gyro is limited, ppm (of a misalignment: urad). An HRG is within 1 %, its
/// mounting within 1 degree.
pub const MOST_PPM: f32 = 50_000.0;

/// Scale factor and misalignment of one axis over temperature, as the image holds them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RateAxis {
    /// Lowest temperature of the fit, C.
    pub rate_valid_from_c: f32,
    /// Highest temperature of the fit, C.
    pub rate_valid_to_c: f32,
    /// Fastest cooling of the fit, C per minute.
    pub rate_valid_from_c_per_min: f32,
    /// Fastest heating of the fit, C per minute.
    pub rate_valid_to_c_per_min: f32,
    /// Factor of the rate, less one, ppm: coefficients of [`scale_regressors`].
    pub scale_correction_ppm: [f32; SCALE_TERMS],
    /// Standard deviation of that correction on a soak at each of [`STATED_AT`] temperatures, ppm: noise, and what the curve does not follow.
    pub scale_std_ppm: [f32; STATED_AT],
    /// Elements of the row of `M` beside its diagonal, in the order of [`OTHERS`], urad: at `u = 0`, then what each gains per `u`.
    pub misalignment_urad: [[f32; 2]; MISALIGNMENT_TERMS],
    /// Standard deviations of both at the lowest temperature of the fit, then at the highest, urad; the same two causes.
    pub misalignment_std_urad: [[f32; 2]; 2],
}
layout! { RateAxis {
    rate_valid_from_c: f32, "lowest temperature of the fit of scale factor and misalignment, C";
    rate_valid_to_c: f32, "highest temperature of that fit, C";
    rate_valid_from_c_per_min: f32, "fastest cooling of that fit, C per minute";
    rate_valid_to_c_per_min: f32, "fastest heating of that fit, C per minute";
    scale_correction_ppm: [f32; SCALE_TERMS], "what the rate is multiplied by, less one: coefficients of 1, u, u^2, u^3, r, u r, ppm";
    scale_std_ppm: [f32; STATED_AT], "standard deviation of that on a soak, at five temperatures evenly from the lowest to the highest of the range, ppm";
    misalignment_urad: [[f32; 2]; MISALIGNMENT_TERMS], "elements of the row of M beside its diagonal, urad: at u = 0, then per u";
    misalignment_std_urad: [[f32; 2]; 2], "their standard deviations at the lowest temperature of the range, then at the highest, urad";
} }

/// Regressors of a scale factor at a temperature (C) and its ramp (C per minute), inside the range of the fit.
#[inline]
#[must_use]
pub fn scale_regressors(scaling: &Scaling, temperature_c: f32, ramp_c_per_min: f32) -> [f32; SCALE_TERMS] {
    let u = scaling.u(temperature_c);
    [1.0, u, u * u, u * u * u, ramp_c_per_min, u * ramp_c_per_min]
}

/// A factor's distance from one (or zero), ppm, brought into its limits. `true`: it was outside, or is no number and taken as zero.
fn limited(ppm: f32) -> (f32, bool) {
    if !ppm.is_finite() {
        return (0.0, true);
    }
    let inside = clamp(ppm, -MOST_PPM, MOST_PPM);
    (inside, inside.to_bits() != ppm.to_bits())
}

impl RateAxis {
    /// [`scale_regressors`] in a thermal state, held at the end of the range of the fit; `true`: the state is beyond it.
    #[must_use]
    pub(crate) fn regressors(&self, scaling: &Scaling, state: &State) -> ([f32; SCALE_TERMS], bool) {
        let temperature_c = clamp(state.temperature_c, self.rate_valid_from_c, self.rate_valid_to_c);
        let ramp = clamp(state.ramp_c_per_min, self.rate_valid_from_c_per_min, self.rate_valid_to_c_per_min);
        let beyond = temperature_c != state.temperature_c || ramp != state.ramp_c_per_min;
        (scale_regressors(scaling, temperature_c, ramp), beyond)
    }

    /// Factor, misalignments and status of the axis in a thermal state.
    #[must_use]
    pub fn at(&self, scaling: &Scaling, state: &State) -> (f32, [f32; 2], AxisStatus) {
        let (x, mut beyond) = self.regressors(scaling, state);
        let mut of = |ppm: f32| {
            let (ppm, outside) = limited(ppm);
            beyond |= outside;
            1e-6 * ppm
        };
        let mut sum_ppm = 0.0;
        for (c, x) in self.scale_correction_ppm.iter().zip(x) {
            sum_ppm += c * x;
        }
        let scale = 1.0 + of(sum_ppm);
        let [at_zero, per_u] = &self.misalignment_urad;
        let coupling = [of(at_zero[0] + per_u[0] * x[1]), of(at_zero[1] + per_u[1] * x[1])];
        (scale, coupling, if beyond { AxisStatus::SCALE_FACTOR } else { AxisStatus::empty() })
    }

    /// Standard deviation of the scale factor on a soak at a temperature, ppm: between those stated, evenly; beyond the range, that of its end.
    #[must_use]
    pub fn scale_std_at_ppm(&self, temperature_c: f32) -> f32 {
        self.between(&self.scale_std_ppm, temperature_c)
    }

    /// Value at a temperature between those that stand evenly over the range; beyond it, that of its end.
    #[must_use]
    pub(crate) fn between(&self, stated: &[f32; STATED_AT], temperature_c: f32) -> f32 {
        let at = self.share_of_range(temperature_c) * (STATED_AT - 1) as f32;
        let below = (at as usize).min(STATED_AT - 2);
        let [low, high] = [stated[below], stated[below + 1]];
        low + (at - below as f32) * (high - low)
    }

    /// Standard deviation of a misalignment at a temperature, urad, in the order of [`OTHERS`]; the same way.
    #[must_use]
    pub fn misalignment_std_at_urad(&self, other: usize, temperature_c: f32) -> f32 {
        let [low, high] = [self.misalignment_std_urad[0][other], self.misalignment_std_urad[1][other]];
        low + self.share_of_range(temperature_c) * (high - low)
    }

    /// Position of a temperature in the range of the fit: 0 at its lowest or below, 1 at its highest or above.
    fn share_of_range(&self, temperature_c: f32) -> f32 {
        let (low, high) = (self.rate_valid_from_c, self.rate_valid_to_c);
        if high > low {
            (clamp(temperature_c, low, high) - low) / (high - low)
        } else {
            0.0
        }
    }

    /// Its numbers, all of them.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = f32> + '_ {
        let range = [
            self.rate_valid_from_c,
            self.rate_valid_to_c,
            self.rate_valid_from_c_per_min,
            self.rate_valid_to_c_per_min,
        ];
        let rows = self.misalignment_urad.as_flattened().iter().chain(self.misalignment_std_urad.as_flattened());
        let scale = self.scale_correction_ppm.iter().chain(&self.scale_std_ppm);
        range.into_iter().chain(scale.chain(rows).copied())
    }
}

/// Factors of the rates of a second: `S` and `M` at its temperatures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors {
    /// Diagonal of `S`.
    scale: [f32; AXES],
    /// `M` beside its diagonal, each row in the order of [`OTHERS`].
    coupling: [[f32; 2]; AXES],
    /// Set if an element of `coupling` is not zero.
    coupled: bool,
}

impl Default for Factors {
    fn default() -> Self {
        Self::UNIT
    }
}

impl Factors {
    /// Those of an image that has none: they leave a rate as it is, to the last bit.
    pub const UNIT: Self = Self { scale: [1.0; AXES], coupling: [[0.0; 2]; AXES], coupled: false };

    /// Of a diagonal of `S` and the elements of `M` beside its diagonal, rows in the order of [`OTHERS`].
    #[must_use]
    pub fn new(scale: [f32; AXES], coupling: [[f32; 2]; AXES]) -> Self {
        Self { scale, coupling, coupled: coupling.as_flattened().iter().any(|c| *c != 0.0) }
    }

    /// Diagonal of `S`.
    #[must_use]
    pub fn scale(&self) -> [f32; AXES] {
        self.scale
    }

    /// `M` beside its diagonal, rows in the order of [`OTHERS`].
    #[must_use]
    pub fn coupling(&self) -> [[f32; 2]; AXES] {
        self.coupling
    }

    /// Corrected rates, deg/h: the one rule of signs and order, in the unit's arithmetic.
    #[inline(always)]
    #[must_use]
    pub fn corrected_dph(&self, raw_dph: [f32; AXES], bias_dph: [f32; AXES]) -> [f32; AXES] {
        let mut scaled = [0.0; AXES];
        for (k, to) in scaled.iter_mut().enumerate() {
            *to = self.scale[k] * (raw_dph[k] - bias_dph[k]);
        }
        if self.coupled {
            self.aligned(scaled)
        } else {
            scaled
        }
    }

    /// The same rule for codes of an ADC, with all that does not change from sample to sample multiplied out: `scale` of a code, then `unit` of the
    /// result.
    #[inline]
    #[must_use]
    pub fn of_codes(&self, scale: [f32; AXES], bias: [f32; AXES], unit: f32) -> OfCodes {
        let mut of = OfCodes { factors: *self, gain: [0.0; AXES], offset: [0.0; AXES] };
        for k in 0..AXES {
            of.gain[k] = self.scale[k] * scale[k] * unit;
            of.offset[k] = self.scale[k] * bias[k] * unit;
        }
        of
    }

    /// `M` times rates.
    #[inline]
    fn aligned(&self, rates: [f32; AXES]) -> [f32; AXES] {
        let mut out = rates;
        for (k, to) in out.iter_mut().enumerate() {
            let [first, second] = OTHERS[k];
            *to += self.coupling[k][0] * rates[first] + self.coupling[k][1] * rates[second];
        }
        out
    }

    /// Axes whose corrected rate holds something of a rate of those marked in `of`.
    #[inline]
    #[must_use]
    pub fn touched(&self, of: [bool; AXES]) -> [bool; AXES] {
        let mut out = [false; AXES];
        for (k, to) in out.iter_mut().enumerate() {
            *to = OTHERS[k].iter().zip(self.coupling[k]).any(|(j, c)| of[*j] && c != 0.0);
        }
        out
    }

    /// `true` if both are the same to the last bit.
    #[must_use]
    pub fn same(&self, other: &Self) -> bool {
        let words = |f: &Self| f.words();
        words(self) == words(other) && self.coupled == other.coupled
    }

    fn words(&self) -> [[u32; AXES]; AXES] {
        let column = |j: usize| [self.coupling[0][j], self.coupling[1][j], self.coupling[2][j]].map(f32::to_bits);
        [self.scale.map(f32::to_bits), column(0), column(1)]
    }

    /// A number that changes with any bit of them.
    #[inline]
    pub(crate) fn fold(&self) -> u32 {
        let mut sum = u32::from(self.coupled);
        for [a, b, c] in self.words() {
            sum = sum.rotate_left(5) ^ a ^ b.rotate_left(11) ^ c.rotate_left(22);
        }
        sum
    }
}

/// [`Factors`] for codes: [`Factors::of_codes`].
#[derive(Debug, Clone, Copy)]
pub struct OfCodes {
    factors: Factors,
    gain: [f32; AXES],
    offset: [f32; AXES],
}

impl OfCodes {
    /// Corrected values of codes.
    #[inline(always)]
    #[must_use]
    pub fn corrected(&self, codes: [i32; AXES]) -> [f32; AXES] {
        let mut out = [0.0; AXES];
        for (k, to) in out.iter_mut().enumerate() {
            *to = self.gain[k] * codes[k] as f32 - self.offset[k];
        }
        if self.factors.coupled {
            self.factors.aligned(out)
        } else {
            out
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::calibration::Calibration;
    use proptest::prelude::*;

    fn state(temperature_c: f32, ramp_c_per_min: f32) -> State {
        State { temperature_c, ramp_c_per_min, difference_c_per_min: 0.0, frequency_u: 0.0, frequency_u_per_min: 0.0 }
    }

    fn axis() -> RateAxis {
        RateAxis {
            rate_valid_from_c: -40.0,
            rate_valid_to_c: 60.0,
            rate_valid_from_c_per_min: -2.0,
            rate_valid_to_c_per_min: 2.0,
            scale_correction_ppm: [100.0, 50.0, -20.0, 10.0, 5.0, 3.0],
            scale_std_ppm: [4.0, 2.0, 1.0, 2.0, 6.0],
            misalignment_std_urad: [[1.0, 2.0], [3.0, 6.0]],
            misalignment_urad: [[300.0, -200.0], [10.0, 20.0]],
        }
    }

    #[test]
    fn factors_are_those_of_the_equation_and_are_held_at_the_ends_of_the_range() {
        let scaling = &Calibration::uncalibrated().scaling;
        let (scale, coupling, status) = axis().at(scaling, &state(55.0, 1.0));
        // u = 1: 100 + 50 - 20 + 10 + 5 + 3 ppm. A single holds one to 0.06 ppm.
        assert!((scale - 1.000_148).abs() < 1.2e-7, "{scale}");
        assert!((coupling[0] - 310e-6).abs() < 1e-10 && (coupling[1] + 180e-6).abs() < 1e-10, "{coupling:?}");
        assert_eq!(status, AxisStatus::empty());
        for (beyond, end) in [((80.0, 1.0), (60.0, 1.0)), ((-70.0, 0.0), (-40.0, 0.0)), ((20.0, -9.0), (20.0, -2.0))] {
            let (held, at_end) =
                (axis().at(scaling, &state(beyond.0, beyond.1)), axis().at(scaling, &state(end.0, end.1)));
            assert_eq!((held.0, held.1, held.2), (at_end.0, at_end.1, AxisStatus::SCALE_FACTOR));
        }
    }

    #[test]
    fn standard_deviations_are_those_stated_and_lie_between_them() {
        let a = axis();
        // -40 to 60 C: stated at -40, -15, 10, 35 and 60.
        let stated = [(-70.0, 4.0), (-40.0, 4.0), (-27.5, 3.0), (10.0, 1.0), (50.0, 4.4), (60.0, 6.0), (90.0, 6.0)];
        for (t, std) in stated {
            assert!((a.scale_std_at_ppm(t) - std).abs() < 1e-5, "{t}: {}", a.scale_std_at_ppm(t));
        }
        assert_eq!([-40.0, 10.0, 99.0].map(|t| a.misalignment_std_at_urad(1, t)), [2.0, 4.0, 6.0]);
        assert_eq!(RateAxis::default().scale_std_at_ppm(20.0), 0.0);
    }

    #[test]
    fn what_is_impossible_is_limited_and_flagged() {
        let scaling = &Calibration::uncalibrated().scaling;
        for (c, most) in [(1e6, 1.05), (-1e6, 0.95), (f32::NAN, 1.0), (f32::INFINITY, 1.0)] {
            let mut a = axis();
            a.scale_correction_ppm[0] = c;
            let (scale, _, status) = a.at(scaling, &state(20.0, 0.0));
            assert!((scale - most).abs() < 1e-6 && status == AxisStatus::SCALE_FACTOR, "{c}: {scale}");
        }
        let mut a = axis();
        a.misalignment_urad[1][1] = f32::MAX;
        let (_, coupling, status) = a.at(scaling, &state(40.0, 0.0));
        assert_eq!((coupling[1], status), (1e-6 * MOST_PPM, AxisStatus::SCALE_FACTOR));
    }

    #[test]
    fn the_matrix_is_the_one_of_the_rule() {
        let f = Factors::new([1.5, 0.5, 2.0], [[0.25, 0.5], [-0.5, 0.125], [1.0, -1.0]]);
        // S (raw - bias) = 6, 2, 8; M has rows 1 0.25 0.5, -0.5 1 0.125, 1 -1 1.
        assert_eq!(
            f.corrected_dph([5.0, 5.0, 5.0], [1.0, 1.0, 1.0]),
            [6.0 + 0.5 + 4.0, -3.0 + 2.0 + 1.0, 6.0 - 2.0 + 8.0]
        );
        assert_eq!(f.touched([true, false, false]), [false, true, true]);
        // Of codes of 0.5, in units of which four make one.
        assert_eq!(f.of_codes([0.5; 3], [1.0; 3], 4.0).corrected([10, 10, 10]), [42.0, 0.0, 48.0]);
        let one = Factors::new([1.0; 3], [[0.0, 1e-4], [0.0; 2], [0.0; 2]]);
        assert_eq!(
            (one.touched([false, false, true]), one.touched([true, true, false])),
            ([true, false, false], [false; 3])
        );
    }

    #[test]
    fn every_bit_changes_the_fold() {
        let f = Factors::new([1.0, 1.1, 0.9], [[1e-4, 2e-4], [3e-4, 4e-4], [5e-4, 6e-4]]);
        for bit in 0..32 {
            let flip = |v: &mut f32| *v = f32::from_bits(v.to_bits() ^ 1 << bit);
            for word in 0..9 {
                let mut g = f;
                match word {
                    0..=2 => flip(&mut g.scale[word]),
                    _ => flip(&mut g.coupling[(word - 3) / 2][(word - 3) % 2]),
                }
                assert!(g.fold() != f.fold() && !g.same(&f), "word {word} bit {bit}");
            }
        }
        assert_ne!(Factors { coupled: false, ..f }.fold(), f.fold());
    }

    proptest! {
        #[test]
        fn without_factors_a_rate_is_what_it_was_to_the_last_bit(raw in proptest::array::uniform3(any::<f32>()), bias in proptest::array::uniform3(any::<f32>())) {
            let out = Factors::UNIT.corrected_dph(raw, bias);
            for k in 0..AXES {
                let was = raw[k] - bias[k];
                prop_assert!(out[k].to_bits() == was.to_bits() || (out[k].is_nan() && was.is_nan()));
            }
        }
    }
}
