//! Noise of the rates and the frequencies.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// Noise of the rates, all in deg/h.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation that white noise alone gives 100 s means.
    pub white_100s_dph: f64,
    /// Flicker: standard deviation of each of five first-order processes, one per decade of time constant.
    pub flicker_dph: f64,
    /// Random walk: standard deviation gathered in an hour.
    pub walk_per_root_h_dph: f64,
    /// Frequency noise of a 1 s gate, Hz.
    pub frequency_hz: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { white_100s_dph: 0.2, flicker_dph: 0.025, walk_per_root_h_dph: 0.02, frequency_hz: 5e-6 }
    }
}

pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A first-order Gauss-Markov process with a time constant, unit variance.
pub(super) fn drift(n: usize, tau: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let keep = (-1.0 / tau).exp();
    let drive = (1.0 - keep * keep).sqrt();
    let mut x = normal(rng);
    (0..n)
        .map(|_| {
            x = keep * x + drive * normal(rng);
            x
        })
        .collect()
}

/// Noise of one rate channel.
pub(super) fn rate_noise(n: usize, noise: &Noise, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let white = noise.white_100s_dph * 10.0;
    let mut out: Vec<f64> = (0..n).map(|_| white * normal(rng)).collect();
    for decade in 1..=5 {
        for (o, w) in out.iter_mut().zip(drift(n, 10f64.powi(decade), rng)) {
            *o += noise.flicker_dph * w;
        }
    }
    let mut walk = 0.0;
    for o in &mut out {
        walk += noise.walk_per_root_h_dph / 60.0 * normal(rng);
        *o += walk;
    }
    out
}
