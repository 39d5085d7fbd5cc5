//! Least squares with correlated noise.
//!
//! The noise of a block mean is modelled as first-order autoregressive plus moving average (ARMA(1,1)): white noise,
//! a slow Gauss-Markov process on top of it, and what lies between; flicker is close to one of these over the two decades that a
//! chamber run spans. Whitening is a recursion that is applied to data and regressors alike; the likelihood then is
//! that of white residuals. The noise parameters are taken from a small grid, anew for every model that is
//! compared, so that structure can be explained by the model or by the noise, whichever does it better.

use crate::matrices::symmetric;
use hrg_data::numeric::stats::{dot, sum_of_products, take_off};
use nalgebra::SymmetricEigen;
use std::borrow::Cow;

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

/// White noise whose deviation changes with temperature: its logarithm along the temperatures of the train runs. Beyond them it stays as it is at
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
                "axis {axis}: the white noise is {:.1} times as large at {to:.0} C as at {from:.0} C; quiet rows count for more in fit and judgement",
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

    /// `true` if it stands for what a model lacks, and not for the noise of a gyro: its slow part is larger than the white one, and forgets within a
    /// run of so many blocks.
    pub fn is_misfit(&self, blocks: usize) -> bool {
        self.slow > 1.0 && -self.phi.ln().recip() < blocks as f64
    }

    /// Variance of the whitened noise of a long run over that of the white part.
    pub fn innovation(&self) -> f64 {
        if self.theta == 0.0 {
            1.0
        } else {
            self.phi / self.theta
        }
    }
}

/// The recursions that whiten the rows of some runs, one for each noise model: the prediction of the next value from those before it
/// (Kalman's, for a slow part beside a white part whose deviation may differ from row to row), and the deviation of what is new in it.
#[derive(Debug, Clone, Default)]
pub struct Filters {
    /// Share of a prediction that stays in the next one; 0 before the first row of a run.
    keep: Vec<[f64; NOISE_MODELS.len()]>,
    /// Share of a value that goes into the next prediction.
    take: Vec<[f64; NOISE_MODELS.len()]>,
    /// Factor on what is new.
    scale: Vec<[f64; NOISE_MODELS.len()]>,
    /// Log determinant of each whitening.
    log_determinant: [f64; NOISE_MODELS.len()],
    /// Directions of the whitened rows in which the unit is unknown, for each noise model.
    unknown: [Vec<Unknown>; NOISE_MODELS.len()],
}

/// A direction of whitened rows in which something unknown lies beside the noise.
#[derive(Debug, Clone)]
struct Unknown {
    /// Of length 1.
    direction: Vec<f64>,
    /// Deviation of the noise along it over that of all.
    share: f64,
}

/// Variance of the size of a column of which nothing is known ([`Filters::beside`]), over that of the white part of a row.
pub(super) const UNKNOWN: f64 = 1e4;

impl Filters {
    /// Of rows with a relative deviation of the white part; `starts` are the rows at which a run begins.
    pub fn new(relative: &[f64], starts: &[usize]) -> Self {
        let zeros = vec![[0.0; NOISE_MODELS.len()]; relative.len()];
        let mut out = Self { keep: zeros.clone(), take: zeros.clone(), scale: zeros, ..Self::default() };
        for (s, noise) in NOISE_MODELS.iter().enumerate() {
            let NoiseModel { phi, slow, .. } = *noise;
            for (k, &from) in starts.iter().enumerate() {
                let to = starts.get(k + 1).copied().unwrap_or(relative.len());
                // Variance of the predicted slow part, over that of the white part.
                let mut known = slow;
                for (row, r) in relative[from..to].iter().enumerate() {
                    let (row, new) = (from + row, known + r * r);
                    if row + 1 < to {
                        out.take[row][s] = phi * known / new;
                        out.keep[row][s] = phi - out.take[row][s];
                    }
                    out.scale[row][s] = (noise.innovation() / new).sqrt();
                    out.log_determinant[s] += out.scale[row][s].ln();
                    known = phi * phi * known * r * r / new + slow * (1.0 - phi * phi);
                }
            }
        }
        out
    }

    /// The same with columns beside the noise, of whose sizes nothing is known: the covariance is the noise's and, of each column, its size's variance
    /// times its square.
    #[must_use]
    pub fn beside(mut self, columns: &[Vec<f64>]) -> Self {
        if columns.is_empty() {
            return self;
        }
        for (s, noise) in NOISE_MODELS.iter().enumerate() {
            let white: Vec<Vec<f64>> = columns.iter().map(|c| self.whitened(s, c)).collect();
            let e = SymmetricEigen::new(symmetric(white.len(), |i, j| dot(&white[i], &white[j])));
            let most = e.eigenvalues.max();
            // (What columns say twice has no length of its own.)
            for (k, square) in e.eigenvalues.iter().enumerate().filter(|(_, l)| **l > SAME * most) {
                let mut direction = vec![0.0; white[0].len()];
                for (column, part) in white.iter().zip(e.eigenvectors.column(k).iter()) {
                    take_off(&mut direction, -part / square.sqrt(), column);
                }
                let share = 1.0 / (1.0 + UNKNOWN / noise.innovation() * square).sqrt();
                self.log_determinant[s] += share.ln();
                self.unknown[s].push(Unknown { direction, share });
            }
        }
        self
    }

    /// Scales what lies along the unknown directions.
    fn along(&self, s: usize, x: &mut [f64], by: impl Fn(f64) -> f64) {
        for u in &self.unknown[s] {
            let part = dot(&u.direction, x);
            take_off(x, part * (1.0 - by(u.share)), &u.direction);
        }
    }

    /// Whitens a column in place by a noise model, given by its number.
    pub fn whiten(&self, s: usize, x: &mut [f64]) {
        let mut predicted = 0.0;
        for (k, v) in x.iter_mut().enumerate() {
            let now = *v;
            *v = (now - predicted) * self.scale[k][s];
            predicted = self.keep[k][s] * predicted + self.take[k][s] * now;
        }
        self.along(s, x, |share| share);
    }

    /// A column whitened by a noise model.
    pub fn whitened(&self, s: usize, x: &[f64]) -> Vec<f64> {
        let mut x = x.to_vec();
        self.whiten(s, &mut x);
        x
    }

    /// A column whitened by every model: as [`whiten`](Self::whiten) does it, side by side.
    pub fn whiten_by_all(&self, x: &[f64]) -> [Vec<f64>; NOISE_MODELS.len()] {
        let mut out = [(); NOISE_MODELS.len()].map(|()| vec![0.0; x.len()]);
        let mut predicted = [0.0; NOISE_MODELS.len()];
        for (k, &now) in x.iter().enumerate() {
            for (s, o) in out.iter_mut().enumerate() {
                o[k] = (now - predicted[s]) * self.scale[k][s];
            }
            for (s, p) in predicted.iter_mut().enumerate() {
                *p = self.keep[k][s] * *p + self.take[k][s] * now;
            }
        }
        out.iter_mut().enumerate().for_each(|(s, o)| self.along(s, o, |share| share));
        out
    }

    /// The adjoint of the recursion that [`whiten`](Self::whiten) undoes: the inner product of two results is that of the columns with the
    /// noise's covariance between them, without what is [unknown beside it](Self::beside).
    pub fn backwards(&self, s: usize, x: &[f64]) -> Vec<f64> {
        let mut after = 0.0;
        let mut out = vec![0.0; x.len()];
        for k in (0..x.len()).rev() {
            let (keep, take) = (self.keep[k][s], self.take[k][s]);
            out[k] = (x[k] + take * after) / self.scale[k][s];
            after = x[k] + (keep + take) * after;
        }
        out
    }

    /// The transposed whitening: the inner product of the result with a column is that of `x` with the whitened column.
    pub fn transposed(&self, s: usize, mut x: Vec<f64>) -> Vec<f64> {
        self.along(s, &mut x, |share| share);
        self.transpose_rows(s, 0, &mut x);
        x
    }

    /// The transposed recursion, in place, on rows of which the first has number `from`; those behind them count as zero.
    fn transpose_rows(&self, s: usize, from: usize, x: &mut [f64]) {
        let mut after = 0.0;
        for (k, v) in x.iter_mut().enumerate().rev() {
            let new = self.scale[from + k][s] * *v;
            *v = new + self.take[from + k][s] * after;
            after = self.keep[from + k][s] * after - new;
        }
    }

    /// For each row, the product of a whitened column with a whitened step at that row, which lasts to row `to`.
    pub fn steps(&self, s: usize, x: &[f64], from: usize, to: usize) -> Vec<f64> {
        let mut x = Cow::Borrowed(x);
        if !self.unknown[s].is_empty() {
            self.along(s, x.to_mut(), |share| share);
        }
        let mut out = x[from..to].to_vec();
        self.transpose_rows(s, from, &mut out);
        let mut sum = 0.0;
        for v in out.iter_mut().rev() {
            sum += *v;
            *v = sum;
        }
        out
    }

    /// Square of a whitened step at row `at`, which lasts to row `to`.
    pub fn square_of_step(&self, s: usize, at: usize, to: usize) -> f64 {
        let (mut predicted, mut sum) = (0.0, 0.0);
        let mut parts = vec![0.0; self.unknown[s].len()];
        for k in at..to {
            let new = (1.0 - predicted) * self.scale[k][s];
            sum += new * new;
            parts.iter_mut().zip(&self.unknown[s]).for_each(|(p, u)| *p += u.direction[k] * new);
            predicted = self.keep[k][s] * predicted + self.take[k][s];
        }
        let along = |(p, u): (&f64, &Unknown)| p * p * (1.0 - u.share * u.share);
        sum - parts.iter().zip(&self.unknown[s]).map(along).sum::<f64>()
    }

    /// Log determinant of the whitening by a noise model: its part in the log density of rows.
    pub fn log_determinant(&self, s: usize) -> f64 {
        self.log_determinant[s]
    }
}

/// Share of the longest direction's square below which a direction is rounding.
const SAME: f64 = 1e-12;

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
    fn whitened_noise_is_that_of_the_covariance() {
        // Rows of two runs whose white part is not the same everywhere: W' W is the inverse of the covariance, up to the innovation.
        let (n, second) = (24, 10);
        let relative: Vec<f64> = (0..n).map(|k| 0.5 + 0.1 * k as f64).collect();
        let filters = Filters::new(&relative, &[0, second]);
        for (s, noise) in NOISE_MODELS.iter().enumerate() {
            let covariance = nalgebra::DMatrix::from_fn(n, n, |i, j| {
                let together = (i < second) == (j < second);
                let slow = if together { noise.slow * noise.phi.powi(i.abs_diff(j) as i32) } else { 0.0 };
                slow + if i == j { relative[i] * relative[i] } else { 0.0 }
            });
            let mut w = nalgebra::DMatrix::zeros(n, n);
            for j in 0..n {
                let mut unit = vec![0.0; n];
                unit[j] = 1.0;
                filters.whiten(s, &mut unit);
                w.set_column(j, &nalgebra::DVector::from_vec(unit));
            }
            let white = &w * &covariance * w.transpose();
            let off = white - nalgebra::DMatrix::identity(n, n) * noise.innovation();
            // (The moving average is known to five digits.)
            assert!(off.amax() < 1e-4 * noise.innovation(), "{noise:?}: {off}");
            let log = 0.5 * (n as f64 * noise.innovation().ln() - covariance.determinant().ln());
            assert!((filters.log_determinant(s) - log).abs() < 1e-3, "{noise:?}");
            let step: Vec<f64> = (0..n).map(|k| f64::from(u8::from((4..second).contains(&k)))).collect();
            let (mut of_step, x) = (step.clone(), (0..n).map(|k| (k as f64 * 0.7).sin()).collect::<Vec<_>>());
            filters.whiten(s, &mut of_step);
            let product: f64 = of_step[..second].iter().zip(&x).map(|(a, b)| a * b).sum();
            assert!((filters.steps(s, &x, 0, second)[4] - product).abs() < 1e-9, "{noise:?}");
            assert!((filters.square_of_step(s, 4, second) - dot(&of_step[..second], &of_step[..second])).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_unknown_beside_the_noise_is_in_the_covariance() {
        let (n, second) = (30, 12);
        let relative: Vec<f64> = (0..n).map(|k| 0.5 + 0.05 * k as f64).collect();
        let decay = |from: usize, tau: f64| -> Vec<f64> {
            (0..n).map(|k| if k < from { 0.0 } else { (-((k - from) as f64) / tau).exp() }).collect()
        };
        let columns = [decay(18, 3.0), decay(18, 9.0), decay(18, 9.0)];
        let alone = Filters::new(&relative, &[0, second]);
        let filters = alone.clone().beside(&columns);
        for (s, noise) in NOISE_MODELS.iter().enumerate() {
            let covariance = nalgebra::DMatrix::from_fn(n, n, |i, j| {
                let together = (i < second) == (j < second);
                let slow = if together { noise.slow * noise.phi.powi(i.abs_diff(j) as i32) } else { 0.0 };
                let unknown: f64 = columns.iter().map(|c| UNKNOWN * c[i] * c[j]).sum();
                unknown + slow + if i == j { relative[i] * relative[i] } else { 0.0 }
            });
            let x: Vec<f64> = (0..n).map(|k| (k as f64 * 0.7).sin()).collect();
            let v = nalgebra::DVector::from_vec(x.clone());
            let wanted =
                (v.transpose() * covariance.clone().try_inverse().expect("regular") * &v)[0] * noise.innovation();
            let white = filters.whitened(s, &x);
            assert!((dot(&white, &white) / wanted - 1.0).abs() < 1e-4, "{noise:?}: {} {wanted}", dot(&white, &white));
            let log = 0.5 * (n as f64 * noise.innovation().ln() - covariance.determinant().ln());
            assert!((filters.log_determinant(s) - log).abs() < 1e-3, "{noise:?}: {} {log}", filters.log_determinant(s));
            // The other ways to whiten are the same.
            let by_all = &filters.whiten_by_all(&x)[s];
            assert!(by_all.iter().zip(&white).all(|(a, b)| (a - b).abs() < 1e-12));
            let step: Vec<f64> = (0..n).map(|k| f64::from(u8::from(k >= 20))).collect();
            let of_step = filters.whitened(s, &step);
            assert!((filters.steps(s, &x, second, n)[8] - dot(&x, &of_step)).abs() < 1e-9);
            assert!((filters.square_of_step(s, 20, n) - dot(&of_step, &of_step)).abs() < 1e-9);
            assert!((dot(&x, &filters.transposed(s, x.clone())) - dot(&x, &white)).abs() < 1e-9);
            // The adjoint is that of the noise alone.
            let back = filters.backwards(s, &x);
            assert!((dot(&alone.whitened(s, &x), &back) - dot(&x, &x)).abs() < 1e-6);
        }
    }

    #[test]
    fn the_adjoint_is_that_of_the_inverse() {
        // <W x, C' y> = <x, y>, if C is the inverse of the whitening W.
        let n = 40;
        let x: Vec<f64> = (0..n).map(|k| (k as f64 * 0.7).sin()).collect();
        let y: Vec<f64> = (0..n).map(|k| (k as f64 * 1.3).cos() + 0.1).collect();
        let filters = Filters::new(&vec![1.0; n], &[0, 15]);
        for s in 0..NOISE_MODELS.len() {
            let mut w = x.clone();
            filters.whiten(s, &mut w);
            let (one, other) = (dot(&w, &filters.backwards(s, &y)), dot(&x, &y));
            assert!((one - other).abs() < 1e-9, "{s}: {one} {other}");
            let (one, other) = (dot(&w, &y), dot(&x, &filters.transposed(s, y.clone())));
            assert!((one - other).abs() < 1e-9, "{s}: {one} {other}");
        }
    }
}
