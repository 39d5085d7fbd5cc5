//! Bias models. The baseline is dong2023 eq 7, centred and scaled; beside it stand those of the other sources:
//! [`four_parameter`] (wu2023), [`direct`] (frequency to bias) and [`network`] (zhao2022).
//!
//! # The baseline
//! `B = k0 + k1 u + k2 u^2 + k3 r + k4 r^2 + k5 u r`, with `u = (T - t_ref) / t_scale` and `r` the rate of
//! change in C per minute. One set of six coefficients, or a cooling and a heating set.
//!
//! # Two sets without a step
//! dong2023 switches sets where `r` changes sign; as its two `k0` differ, its bias steps there. Here the sets
//! blend: weight of heating `w = (r + band) / (2 band)`, clamped to 0..1, so the bias is continuous and on a
//! soak the mean of both.
//!
//! # Example
//! ```
//! use hrg_core::bias::{regressors, Coefficients, State};
//! use hrg_core::calibration::Calibration;
//!
//! let scaling = Calibration::uncalibrated().scaling;
//! let coefficients = Coefficients::One([1.5, 0.0, 0.0, 0.25, 0.0, 0.0]);
//! let soak = State {
//!     temperature_c: scaling.t_ref_c,
//!     ramp_c_per_min: 0.0,
//!     difference_c_per_min: 0.0,
//!     frequency_u: 0.0,
//!     frequency_u_per_min: 0.0,
//! };
//! assert_eq!(coefficients.bias_dph(&scaling, &soak), 1.5);
//! // The regressors of a fit are those of the unit.
//! assert_eq!(regressors(&scaling, scaling.t_ref_c, 2.0)[..4], [1.0, 0.0, 0.0, 2.0]);
//! ```

pub mod direct;
pub mod four_parameter;
pub mod network;

use four_parameter::FourParameter;

/// Inputs of a bias model: one axis, one model step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Temperature, C.
    pub temperature_c: f32,
    /// Its rate of change, C per minute ([`crate::rate_of_change::SlopeWindow`]).
    pub ramp_c_per_min: f32,
    /// Its change over the last 60 s, C per minute ([`crate::rate_of_change::Difference`]).
    pub difference_c_per_min: f32,
    /// Normalised frequency.
    pub frequency_u: f32,
    /// Its rate of change per minute.
    pub frequency_u_per_min: f32,
}

/// Coefficients of one set.
pub const TERMS: usize = 6;

/// Centre and scale of temperature in the model, and where it stops being a polynomial.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scaling {
    /// Temperature at `u = 0`, C.
    pub t_ref_c: f32,
    /// Temperature difference of `u = 1`, C.
    pub t_scale_c: f32,
    /// Below this temperature, and above the next, every power of `u` is continued linearly, C.
    pub linear_below_c: f32,
    /// The other end of that range, C.
    pub linear_above_c: f32,
    /// Beyond this magnitude `r^2` is continued linearly, C per minute.
    pub linear_beyond_c_per_min: f32,
    /// Half-width of the blend between cooling and heating set, C per minute.
    pub blend_band_c_per_min: f32,
}

impl Scaling {
    /// Normalised temperature.
    #[inline]
    #[must_use]
    pub fn u(&self, temperature_c: f32) -> f32 {
        (temperature_c - self.t_ref_c) / self.t_scale_c
    }

    /// `true` where powers of the normalised temperature are powers, and not continued along their tangents.
    #[inline]
    fn polynomial(&self, temperature_c: f32) -> bool {
        let (low, high) = (self.linear_below_c, self.linear_above_c);
        temperature_c >= low && temperature_c <= high
    }

    /// The cube of the normalised temperature, continued along its tangent beyond the calibrated range.
    #[inline]
    #[must_use]
    pub fn cube(&self, temperature_c: f32) -> f32 {
        if self.polynomial(temperature_c) {
            let u = self.u(temperature_c);
            return u * u * u;
        }
        let (u, inside) = self.u_and_inside(temperature_c);
        cube_or_tangent(u, inside)
    }

    /// Limit beyond which the square of the rate of change of normalised frequency is continued linearly, per minute:
    /// normalised frequency spans the calibrated range as `u` does, to within some percent.
    #[inline]
    #[must_use]
    pub fn w_linear(&self) -> f32 {
        self.linear_beyond_c_per_min / self.t_scale_c
    }

    /// `u` and the point of the calibrated range nearest to it.
    #[inline]
    #[must_use]
    pub fn u_and_inside(&self, temperature_c: f32) -> (f32, f32) {
        let (low, high) = (self.linear_below_c, self.linear_above_c);
        (self.u(temperature_c), self.u(clamp(temperature_c, low, high)))
    }
}

/// Clamp that lets NaN through and never panics.
#[inline]
#[must_use]
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    if x < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// `x^2`, continued along its tangent from `inside` (equal to `x` within the range).
#[inline]
#[must_use]
pub fn square_or_tangent(x: f32, inside: f32) -> f32 {
    inside * inside + 2.0 * inside * (x - inside)
}

/// `x^3`, continued along its tangent.
#[inline]
#[must_use]
pub fn cube_or_tangent(x: f32, inside: f32) -> f32 {
    inside * inside * inside + 3.0 * inside * inside * (x - inside)
}

/// The six regressors of eq 7 at a temperature (C) and its rate of change (C per minute).
#[inline]
#[must_use]
pub fn regressors(scaling: &Scaling, temperature_c: f32, ramp_c_per_min: f32) -> [f32; TERMS] {
    let (u, inside) = scaling.u_and_inside(temperature_c);
    let r = ramp_c_per_min;
    let r_inside = clamp(r, -scaling.linear_beyond_c_per_min, scaling.linear_beyond_c_per_min);
    [1.0, u, square_or_tangent(u, inside), r, square_or_tangent(r, r_inside), u * r]
}

/// Eq 7 at a temperature (C) and its rate of change (C per minute): the sum of coefficient times [`regressors`], nested, which
/// takes half the instructions.
#[inline]
fn evaluate(k: &[f32; TERMS], scaling: &Scaling, temperature_c: f32, ramp_c_per_min: f32) -> f32 {
    let (t, r) = (temperature_c, ramp_c_per_min);
    if !scaling.polynomial(t) || r.abs() > scaling.linear_beyond_c_per_min {
        return continued(k, scaling, t, r);
    }
    let u = scaling.u(t);
    k[0] + u * (k[1] + u * k[2]) + r * (k[3] + r * k[4] + u * k[5])
}

/// The same beyond the calibrated range.
#[cold]
#[inline(never)]
fn continued(k: &[f32; TERMS], scaling: &Scaling, temperature_c: f32, ramp_c_per_min: f32) -> f32 {
    dot(k, &regressors(scaling, temperature_c, ramp_c_per_min))
}

/// Weight of the heating set, 0 to 1.
#[inline]
#[must_use]
pub fn heating_weight(scaling: &Scaling, ramp_c_per_min: f32) -> f32 {
    if scaling.blend_band_c_per_min > 0.0 {
        clamp(0.5 + 0.5 * ramp_c_per_min / scaling.blend_band_c_per_min, 0.0, 1.0)
    } else if ramp_c_per_min > 0.0 {
        1.0
    } else {
        0.0
    }
}

/// Coefficients of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Coefficients {
    /// One set for every sign of the rate of change.
    One([f32; TERMS]),
    /// A cooling and a heating set, blended over [`Scaling::blend_band_c_per_min`].
    CoolingHeating([f32; TERMS], [f32; TERMS]),
    /// wu2023's piecewise model.
    FourParameter(FourParameter),
    /// A curve of frequency and its rate of change.
    Direct([f32; direct::TERMS]),
    /// zhao2022's network.
    Network([f32; network::WEIGHTS]),
}

/// Sum of products, in order: the one dot product of the project.
#[inline]
#[must_use]
pub fn dot<'a>(a: impl IntoIterator<Item = &'a f32>, b: impl IntoIterator<Item = &'a f32>) -> f32 {
    a.into_iter().zip(b).map(|(x, y)| x * y).reduce(|sum, product| sum + product).unwrap_or(0.0)
}

impl Coefficients {
    /// Bias in deg/h.
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    #[must_use]
    pub fn bias_dph(&self, scaling: &Scaling, state: &State) -> f32 {
        let (t, r) = (state.temperature_c, state.ramp_c_per_min);
        match self {
            Self::One(k) => evaluate(k, scaling, t, r),
            Self::CoolingHeating(cooling, heating) => {
                let w = heating_weight(scaling, r);
                (1.0 - w) * evaluate(cooling, scaling, t, r) + w * evaluate(heating, scaling, t, r)
            }
            Self::FourParameter(m) => dot(
                &m.constant_cooling_heating_low_high,
                &four_parameter::regressors(m.breakpoint_c, m.origin_c, t, state.difference_c_per_min),
            ),
            Self::Direct(k) => direct::evaluate(k, state.frequency_u, state.frequency_u_per_min, scaling.w_linear()),
            Self::Network(w) => network::evaluate(w, network::input(scaling, t)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: Scaling = Scaling {
        t_ref_c: 10.0,
        t_scale_c: 45.0,
        linear_below_c: -40.0,
        linear_above_c: 60.0,
        linear_beyond_c_per_min: 2.0,
        blend_band_c_per_min: 0.2,
    };

    fn at(temperature_c: f32, ramp_c_per_min: f32) -> State {
        let u = S.u(temperature_c);
        State {
            temperature_c,
            ramp_c_per_min,
            difference_c_per_min: ramp_c_per_min,
            frequency_u: u,
            frequency_u_per_min: ramp_c_per_min / 45.0,
        }
    }

    #[test]
    fn the_four_parameters_step_only_where_their_source_does() {
        let bias = |origin_c, t| {
            let m = FourParameter {
                constant_cooling_heating_low_high: [1.0, -2.0, 3.0, 0.5, -0.25],
                breakpoint_c: 20.0,
                origin_c,
            };
            Coefficients::FourParameter(m).bias_dph(&S, &at(t, 0.0))
        };
        assert!((bias(20.0, 20.0) - bias(20.0, 19.999)).abs() < 1e-3);
        assert!((bias(0.0, 20.0) - bias(0.0, 19.999) + 15.0).abs() < 1e-2, "the jump of the literal form");
        let m = FourParameter {
            constant_cooling_heating_low_high: [0.0, -2.0, 3.0, 0.0, 0.0],
            breakpoint_c: 0.0,
            origin_c: 0.0,
        };
        let b = |d| Coefficients::FourParameter(m).bias_dph(&S, &at(10.0, d));
        assert_eq!((b(-1.0), b(2.0), b(0.0)), (2.0, 6.0, 0.0));
    }

    #[test]
    fn no_model_runs_away_outside_its_range() {
        let m = FourParameter { constant_cooling_heating_low_high: [1.0; 5], breakpoint_c: 20.0, origin_c: 20.0 };
        let models = [
            Coefficients::One([1.0; 6]),
            Coefficients::FourParameter(m),
            Coefficients::Direct([1.0; 7]),
            Coefficients::Network([1.0; 16]),
        ];
        for model in models {
            let far = model.bias_dph(&S, &at(460.0, 20.0));
            let near = model.bias_dph(&S, &at(235.0, 10.0));
            // Ten and five scales out: straight lines at the most, save for the product with the rate.
            assert!(far.is_finite() && (far.abs() <= 4.2 * near.abs().max(60.0)), "{model:?} {near} {far}");
        }
    }

    #[test]
    fn nested_and_long_are_the_same_and_meet_at_the_limits() {
        let k = [1.0, -3.0, 2.0, 0.5, -0.4, 1.5];
        for i in -500..=700 {
            for j in -30..=30 {
                let (t, r) = (i as f32 / 10.0, j as f32 / 10.0);
                let (nested, long) = (evaluate(&k, &S, t, r), dot(&k, &regressors(&S, t, r)));
                assert!((nested - long).abs() < 1e-5, "{t} {r}: {nested} {long}");
            }
        }
    }

    #[test]
    fn two_sets_never_step() {
        let k = Coefficients::CoolingHeating([1.0, 0.5, 0.1, -0.2, 0.1, 0.3], [-2.0, 0.1, 0.4, 0.2, 0.2, -0.1]);
        let mut last = k.bias_dph(&S, &at(20.0, -0.5));
        let mut largest: f32 = 0.0;
        for n in 1..=1000 {
            let b = k.bias_dph(&S, &at(20.0, -0.5 + n as f32 * 1e-3));
            largest = largest.max((b - last).abs());
            last = b;
        }
        // 3 deg/h apart over 0.4 C/min: at most about 0.008 deg/h per 0.001 C/min.
        assert!(largest < 0.01, "{largest}");
    }

    #[test]
    fn linear_beyond_the_range() {
        let k = Coefficients::One([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let b = |t: f32| k.bias_dph(&S, &at(t, 0.0));
        assert!((b(60.0) - (50.0f32 / 45.0).powi(2)).abs() < 1e-6);
        let (d1, d2) = (b(80.0) - b(70.0), b(90.0) - b(80.0));
        assert!((d1 - d2).abs() < 1e-5, "{d1} {d2}");
    }
}
