//! Bias straight from frequency (the outlook of dong2023): eq 7 with the normalised frequency `v` and its rate of
//! change `w` in place of temperature, and a cubic term for the curve that `T(f)` would have brought in.
//!
//! `B = k0 + k1 v + k2 v^2 + k3 v^3 + k4 w + k5 w^2 + k6 v w`, `v` about -1 to 1 over the calibrated range, `w` its
//! change per minute. No temperature curve and no sensor is needed to identify or to evaluate it.
//!
//! # Example
//! ```
//! use hrg_core::bias::direct::{evaluate, regressors, TERMS};
//!
//! let k: [f32; TERMS] = [1.0, 2.0, 0.0, 0.0, 0.5, 0.0, 0.0];
//! let (v, w, w_linear) = (0.5, 0.1, 0.2);
//! assert_eq!(evaluate(&k, v, w, w_linear), 1.0 + 2.0 * 0.5 + 0.5 * 0.1);
//! assert_eq!(regressors(v, w, w_linear)[1], v);
//! ```

use super::{clamp, cube_or_tangent, square_or_tangent};

/// Coefficients.
pub const TERMS: usize = 7;

/// Beyond this `|v|`, a little outside the calibrated range, powers of `v` are continued along their tangents.
pub const V_LINEAR: f32 = 1.1;

/// The seven regressors of a normalised frequency and its rate of change per minute, with `w^2` continued along its
/// tangent beyond `w_linear`.
#[inline]
#[must_use]
pub fn regressors(v: f32, w: f32, w_linear: f32) -> [f32; TERMS] {
    let v_inside = clamp(v, -V_LINEAR, V_LINEAR);
    let w_inside = clamp(w, -w_linear, w_linear);
    [1.0, v, square_or_tangent(v, v_inside), cube_or_tangent(v, v_inside), w, square_or_tangent(w, w_inside), v * w]
}

/// The bias in deg/h: the sum of coefficient times [`regressors`], nested, which takes half the instructions.
#[inline]
#[must_use]
pub fn evaluate(k: &[f32; TERMS], v: f32, w: f32, w_linear: f32) -> f32 {
    if v.abs() > V_LINEAR || w.abs() > w_linear {
        return super::dot(k, &regressors(v, w, w_linear));
    }
    k[0] + v * (k[1] + v * (k[2] + v * k[3])) + w * (k[4] + w * k[5] + v * k[6])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_and_long_are_the_same_and_meet_at_the_limits() {
        let k = [1.0, -3.0, 2.0, 0.5, -4.0, 1.5, 2.5];
        for i in -150..=150 {
            for j in -30..=30 {
                let (v, w) = (i as f32 / 100.0, j as f32 / 100.0);
                let (nested, long) = (evaluate(&k, v, w, 0.2), super::super::dot(&k, &regressors(v, w, 0.2)));
                assert!((nested - long).abs() < 1e-5, "{v} {w}: {nested} {long}");
            }
        }
    }
}
