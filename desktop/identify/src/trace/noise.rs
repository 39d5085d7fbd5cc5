//! Least squares with correlated noise.
//!
//! The noise of a block mean is modelled as first-order autoregressive plus moving average (ARMA(1,1)): white noise,
//! a slow Gauss-Markov process on top of it, and what lies between; flicker is close to one of these over the two decades that a
//! chamber run spans. Whitening is a recursion that is applied to data and regressors alike; the likelihood then is
//! that of white residuals. The noise parameters are taken from a small grid, anew for every model that is
//! compared, so that structure can be explained by the model or by the noise, whichever does it better.

use hrg_data::numeric::stats::{dot, sum_of_products, take_off};

/// One noise model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseModel {
    /// Autoregressive coefficient per block.
    pub phi: f64,
    /// Moving-average coefficient; equal to `phi` for white noise.
    pub theta: f64,
    /// Variance of the slow part over that of the white part.
    pub slow: f64,
}

/// The noise models: white, and white beside Gauss-Markov processes with memories of 20, 100 and 2000 blocks (the last is close to a walk
/// over a chamber run) whose variances are 0.1, 1, 10 and 100 times that of the white part. Flicker is close to one of these over the two
/// decades that a chamber run spans; a slow part far above the white one is what a model leaves that lacks something.
pub const NOISE_MODELS: [NoiseModel; 13] = [
    NoiseModel { phi: 0.0, theta: 0.0, slow: 0.0 },
    NoiseModel { phi: 0.95, theta: 0.89271, slow: 0.1 },
    NoiseModel { phi: 0.95, theta: 0.72395, slow: 1.0 },
    NoiseModel { phi: 0.95, theta: 0.37709, slow: 10.0 },
    NoiseModel { phi: 0.95, theta: 0.08208, slow: 100.0 },
    NoiseModel { phi: 0.99, theta: 0.95510, slow: 0.1 },
    NoiseModel { phi: 0.99, theta: 0.86761, slow: 1.0 },
    NoiseModel { phi: 0.99, theta: 0.64097, slow: 10.0 },
    NoiseModel { phi: 0.99, theta: 0.26716, slow: 100.0 },
    NoiseModel { phi: 0.9995, theta: 0.99004, slow: 0.1 },
    NoiseModel { phi: 0.9995, theta: 0.96887, slow: 1.0 },
    NoiseModel { phi: 0.9995, theta: 0.90486, slow: 10.0 },
    NoiseModel { phi: 0.9995, theta: 0.72981, slow: 100.0 },
];

/// Slow part from which on a noise model stands for a misfit, where its memory is a part of a run: no gyro has such noise.
const MISFIT: f64 = 10.0;
/// Autoregressive coefficient of the longest memory that is a part of a run.
const WITHIN_A_RUN: f64 = 0.99;

/// Noise whose deviation changes with temperature: its logarithm along the temperatures of the train runs. Beyond them it stays as it is at
/// their ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Growth {
    /// Logarithm of the deviation at the highest temperature over that at the lowest; 0: the same everywhere.
    pub by: f64,
    /// Lowest temperature, C.
    pub low_c: f64,
    /// Highest temperature, C.
    pub high_c: f64,
    /// Mean of the logarithm over the rows of the train runs, from the middle of the temperatures on.
    pub mean: f64,
}

impl Growth {
    /// Deviation at a temperature over its geometric mean on the train runs.
    pub fn at(&self, temperature_c: f64) -> f64 {
        (self.log_from_middle(temperature_c) - self.mean).exp()
    }

    /// A sentence about it, where there is any.
    pub fn sentence(&self, axis: &str) -> Option<String> {
        let (low, high) = (self.low_c, self.high_c);
        let (from, to) = if self.by > 0.0 { (low, high) } else { (high, low) };
        (self.by != 0.0).then(|| {
            format!(
                "axis {axis}: the noise is {:.1} times as large at {to:.0} C as at {from:.0} C; quiet rows count for more in fit and judgement",
                self.by.abs().exp()
            )
        })
    }

    /// Logarithm of the deviation at a temperature over that in the middle of the temperatures.
    pub fn log_from_middle(&self, temperature_c: f64) -> f64 {
        if self.by == 0.0 {
            return 0.0;
        }
        self.by * ((temperature_c.clamp(self.low_c, self.high_c) - self.low_c) / (self.high_c - self.low_c) - 0.5)
    }
}

impl NoiseModel {
    /// Log of its probability before the data are seen: it falls with the deviation of the slow part.
    pub fn log_prior(&self) -> f64 {
        let odds = |n: &Self| 1.0 / (n.slow / 0.1).max(1.0).sqrt();
        (odds(self) / NOISE_MODELS.iter().map(odds).sum::<f64>()).ln()
    }

    /// `true` if it stands for what a model lacks, and not for the noise of a gyro.
    pub fn is_misfit(&self) -> bool {
        self.slow >= MISFIT && self.phi <= WITHIN_A_RUN
    }

    /// Factor on the first value of a run, which has no past.
    pub fn first_factor(&self) -> f64 {
        ((1.0 - self.phi * self.phi) / (1.0 + self.theta * self.theta - 2.0 * self.phi * self.theta)).sqrt()
    }

    /// Whitens a column in place; `starts` are the indices at which a run begins.
    pub fn whiten(&self, x: &mut [f64], starts: &[usize]) {
        if self.phi == 0.0 && self.theta == 0.0 {
            return;
        }
        for (k, &from) in starts.iter().enumerate() {
            let to = starts.get(k + 1).copied().unwrap_or(x.len());
            let (mut past, mut e) = (0.0, 0.0);
            for (j, v) in x[from..to].iter_mut().enumerate() {
                let now = *v;
                e = if j == 0 { now * self.first_factor() } else { now - self.phi * past + self.theta * e };
                past = now;
                *v = e;
            }
        }
    }

    /// A column whitened by every model of [`NOISE_MODELS`]: as [`whiten`](Self::whiten) does it, side by side.
    pub fn whiten_by_all(x: &[f64], starts: &[usize]) -> [Vec<f64>; NOISE_MODELS.len()] {
        let phi = NOISE_MODELS.map(|c| c.phi);
        let theta = NOISE_MODELS.map(|c| c.theta);
        let first = NOISE_MODELS.map(|c| if c == NOISE_MODELS[0] { 1.0 } else { c.first_factor() });
        let mut out = [(); NOISE_MODELS.len()].map(|()| Vec::with_capacity(x.len()));
        for (k, &from) in starts.iter().enumerate() {
            let to = starts.get(k + 1).copied().unwrap_or(x.len());
            let (mut past, mut e) = (0.0, [0.0; NOISE_MODELS.len()]);
            for (j, &now) in x[from..to].iter().enumerate() {
                for s in 0..NOISE_MODELS.len() {
                    e[s] = if j == 0 { now * first[s] } else { now - phi[s] * past + theta[s] * e[s] };
                }
                past = now;
                for (o, e) in out.iter_mut().zip(e) {
                    o.push(e);
                }
            }
        }
        out
    }

    /// The adjoint of the recursion that [`whiten`](Self::whiten) undoes: the inner product of two results is that of the columns over the
    /// noise's covariance.
    pub fn backwards(&self, x: &[f64], starts: &[usize]) -> Vec<f64> {
        let mut out = vec![0.0; x.len()];
        for (k, &from) in starts.iter().enumerate() {
            let to = starts.get(k + 1).copied().unwrap_or(x.len());
            let mut after = 0.0;
            for j in (from..to).rev() {
                let now = x[j] + self.phi * after;
                let now = if j == from { now / self.first_factor() } else { now };
                out[j] = now - self.theta * after;
                after = now;
            }
        }
        out
    }
}

/// Takes out of `x` what orthonormal columns span; a second time where so little is left that rounding shows.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn reduce(columns: &[Vec<f64>], x: &mut [f64]) {
    let before = sum_of_products(x, x);
    for q in columns {
        let d = sum_of_products(q, x);
        take_off(x, d, q);
    }
    if sum_of_products(x, x) < SMALL * before {
        for q in columns {
            let d = sum_of_products(q, x);
            take_off(x, d, q);
        }
    }
}

/// Share of a column's squares below which what is left of it is cleaned of rounding.
const SMALL: f64 = 1e-4;

/// An orthonormal basis that grows.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    /// Orthonormal columns.
    pub columns: Vec<Vec<f64>>,
}

impl Basis {
    /// Takes out of `x` what the basis spans.
    pub fn reduce(&self, x: &mut [f64]) {
        reduce(&self.columns, x);
    }

    /// Adds a column; `false` where the basis spans it already (to a relative 1e-5).
    pub fn add(&mut self, x: Vec<f64>) -> bool {
        self.add_measured(x) > 0.0
    }

    /// As [`add`](Self::add); gives the square of the length that the column adds, 0 where it adds none.
    pub fn add_measured(&mut self, mut x: Vec<f64>) -> f64 {
        let before = dot(&x, &x);
        self.reduce(&mut x);
        let left = dot(&x, &x);
        if !(left > 1e-10 * before) || before == 0.0 {
            return 0.0;
        }
        let f = 1.0 / left.sqrt();
        x.iter_mut().for_each(|v| *v *= f);
        self.columns.push(x);
        left
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_moving_average_is_that_of_the_white_and_the_slow_part() {
        // y - phi y before is the white part less phi times the one before, and the slow part's innovation of variance
        // slow (1 - phi^2): its autocovariances at 0 and 1 are those of a moving average, (1 + theta^2) s and -theta s.
        for n in NOISE_MODELS.iter().filter(|n| n.slow > 0.0) {
            let own = 1.0 + n.phi * n.phi + n.slow * (1.0 - n.phi * n.phi);
            let (ratio, wanted) = (n.theta / (1.0 + n.theta * n.theta), n.phi / own);
            assert!((ratio - wanted).abs() < 1e-5, "{n:?}: {ratio} {wanted}");
        }
    }

    #[test]
    fn the_adjoint_is_that_of_the_inverse() {
        // <W x, C' y> = <x, y>, if C is the inverse of the whitening W.
        let n = 40;
        let x: Vec<f64> = (0..n).map(|k| (k as f64 * 0.7).sin()).collect();
        let y: Vec<f64> = (0..n).map(|k| (k as f64 * 1.3).cos() + 0.1).collect();
        for noise in NOISE_MODELS {
            let mut w = x.clone();
            noise.whiten(&mut w, &[0, 15]);
            let (one, other) = (dot(&w, &noise.backwards(&y, &[0, 15])), dot(&x, &y));
            assert!((one - other).abs() < 1e-9, "{noise:?}: {one} {other}");
        }
    }
}
