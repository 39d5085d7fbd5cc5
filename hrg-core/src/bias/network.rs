//! zhao2022's 1-5-1 network: temperature in, five tanh neurons, bias out.
//!
//! `B = b2 + sum_i w2_i tanh(w1_i u + b1_i)`, `u` the normalised temperature. Beyond the calibrated range `u` is held at
//! its end, where the unit says so in its status: a network knows nothing out there.
//!
//! `tanh` comes from `libm::expf` and is good to 1e-7 of one, so for weights of a few deg/h the network in single
//! precision agrees with the same in double to about 1e-6 of the sum of its `|w2|` (test).
//!
//! # Example
//! ```
//! use hrg_core::bias::network::{evaluate, WEIGHTS};
//!
//! // Without weights between the layers only the last threshold is left.
//! let mut weights = [0.0; WEIGHTS];
//! weights[WEIGHTS - 1] = -0.75;
//! assert_eq!(evaluate(&weights, 0.3), -0.75);
//! ```

use super::Scaling;

/// Hidden neurons.
pub const HIDDEN: usize = 5;
/// Weights and thresholds: `w1[5], b1[5], w2[5], b2`.
pub const WEIGHTS: usize = 3 * HIDDEN + 1;

/// The bias in deg/h at a normalised input. `weights` in the order of [`WEIGHTS`].
#[inline]
#[must_use]
pub fn evaluate(weights: &[f32; WEIGHTS], u: f32) -> f32 {
    let mut sum = weights[WEIGHTS - 1];
    for i in 0..HIDDEN {
        sum += weights[2 * HIDDEN + i] * tanh(weights[i] * u + weights[HIDDEN + i]);
    }
    sum
}

/// Hyperbolic tangent.
pub(crate) fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (libm::expf(2.0 * x) + 1.0)
}

/// The network's input at a temperature: normalised, and held beyond the calibrated range.
#[inline]
#[must_use]
pub fn input(scaling: &Scaling, temperature_c: f32) -> f32 {
    scaling.u_and_inside(temperature_c).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_precision_costs_a_millionth() {
        let w: [f32; WEIGHTS] = [3.0, -1.5, 0.7, 8.0, -2.0, 0.1, 0.9, -0.4, -3.0, 2.0, 4.0, -3.0, 5.0, 1.5, -2.5, -6.0];
        let scale: f64 = w[2 * HIDDEN..].iter().map(|x| f64::from(x.abs())).sum();
        let mut worst = 0.0f64;
        for k in -2000..=2000 {
            let u = k as f32 / 1000.0;
            let mut exact = f64::from(w[WEIGHTS - 1]);
            for i in 0..HIDDEN {
                let a = f64::from(w[i]) * f64::from(u) + f64::from(w[HIDDEN + i]);
                exact += f64::from(w[2 * HIDDEN + i]) * libm::tanh(a);
            }
            worst = worst.max((f64::from(evaluate(&w, u)) - exact).abs());
        }
        assert!(worst < 1e-6 * scale, "{worst:e} of {scale}");
    }
}
