//! A curve over temperature and ramp through the values of visits, with what it does not follow of the unit.
//!
//! # Method
//! `value = x b + g(T, r) + noise`: the terms `x` of the image, which are the unit's own, and a misfit `g` that no term describes. `g` is a
//! random curve of standard deviation `s` on a soak, alike at temperatures that are near each other ([`LENGTH_C`]); with a ramp it grows
//! ([`RAMP_C_PER_MIN`]). The coefficients are those of least squares, each value weighed by its own variance (noise and `g`, which is larger on a ramp): the image has the terms
//! alone, so they have to be near the values, whatever a `g` that neighbours have in common could take of them. That is in what is stated. The result is the mean over `s`
//! by its restricted likelihood and a half-Cauchy prior whose scale is [`PRIOR`] of the noise of a
//! value: a few temperatures say little of `s`, and a flat prior would let it be anything. Sources: Rasmussen and Williams, Gaussian
//! Processes for Machine Learning (2006), section 2.7 (a curve of known terms with a random one) and chapter 5; Gelman, Bayesian Analysis 1
//! (2006) 515 (the prior).
//!
//! The image has no `g`, so the standard deviation of the curve is that of `x b - (x b + g)`: the coefficients' and the misfit's, which go
//! together where there are values.

use crate::matrices::log_determinant;
use nalgebra::{DMatrix, DVector};

/// Temperatures this far apart have little misfit in common, C.
const LENGTH_C: f64 = 25.0;

/// At such a ramp the variance of the misfit is twice that of a soak, C per minute.
const RAMP_C_PER_MIN: f64 = 1.0;

/// Grid of the misfit over the noise of a mean value: the smallest, from one to the next, and how many.
const SMALLEST: f64 = 0.02;
const STEP: f64 = std::f64::consts::SQRT_2;
const STEPS: i32 = 24;

/// Scale of the prior of the misfit, over the noise of a mean value.
const PRIOR: f64 = 0.1;

/// Values that are left over for the noise at least, beyond the coefficients.
const LEAST_FREE: usize = 4;

/// A value of a visit.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    /// Regressors of all terms.
    pub x: Vec<f64>,
    /// Mean temperature, C, and ramp, C per minute.
    pub at: (f64, f64),
    /// The value.
    pub value: f64,
    /// The variance of its noise is that of a mean of 100 s over this.
    pub weight: f64,
}

/// One size of the misfit.
#[derive(Debug, Clone)]
struct Hypothesis {
    probability: f64,
    /// Variance of the misfit.
    misfit: f64,
    coefficients: DVector<f64>,
    covariance: DMatrix<f64>,
    /// Coefficients over values.
    gain: DMatrix<f64>,
    /// Variance of the noise of a mean of 100 s.
    noise: f64,
}

/// A curve that was found.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Coefficients of all terms; zero of those that were left out.
    pub coefficients: Vec<f64>,
    /// Standard deviation of the noise of a mean of 100 s, in the rate's unit.
    pub noise: f64,
    /// Standard deviation of what the curve does not follow on a soak.
    pub misfit: f64,
    /// Values that took part.
    pub values: usize,
    in_use: Vec<usize>,
    hypotheses: Vec<Hypothesis>,
    at: Vec<(f64, f64)>,
}

/// Covariance of the misfits of two states, relative to the variance on a soak.
fn common(a: (f64, f64), b: (f64, f64)) -> f64 {
    let apart = (a.0 - b.0) / LENGTH_C;
    (-0.5 * apart * apart).exp() * (1.0 + a.1 * b.1 / (RAMP_C_PER_MIN * RAMP_C_PER_MIN))
}

impl Curve {
    /// Through points, by the terms in use out of `terms`; `None`: too few points, or terms that they do not tell apart.
    pub(crate) fn fit(points: &[Point], terms: usize, in_use: &[usize]) -> Option<Self> {
        let (n, p) = (points.len(), in_use.len());
        if n < p + LEAST_FREE {
            return None;
        }
        let x = DMatrix::from_fn(n, p, |k, j| points[k].x[in_use[j]]);
        let y = DVector::from_fn(n, |k, _| points[k].value);
        let likeness = DMatrix::from_fn(n, n, |k, l| common(points[k].at, points[l].at));
        let typical = n as f64 / points.iter().map(|p| p.weight).sum::<f64>();
        let of = |k: i32| {
            let ratio = SMALLEST * STEP.powi(k);
            let part = ratio * ratio * typical;
            let mut v = part * &likeness;
            points.iter().enumerate().for_each(|(k, p)| v[(k, k)] += 1.0 / p.weight);
            // (On a grid of equal ratios, a density of s counts by s.)
            let prior = ratio / (1.0 + (ratio / PRIOR).powi(2));
            hypothesis(&x, &y, v, part).map(|(log, h)| (log + prior.ln(), h))
        };
        let all: Vec<(f64, Hypothesis)> = (0..STEPS).filter_map(of).collect();
        let best = all.iter().map(|h| h.0).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = all.iter().map(|h| (h.0 - best).exp()).sum();
        if !sum.is_finite() || sum <= 0.0 {
            return None;
        }
        let hypotheses: Vec<Hypothesis> =
            all.into_iter().map(|(log, h)| Hypothesis { probability: (log - best).exp() / sum, ..h }).collect();
        let mean = |of: &dyn Fn(&Hypothesis) -> f64| hypotheses.iter().map(|h| h.probability * of(h)).sum::<f64>();
        let mut coefficients = vec![0.0; terms];
        for (j, term) in in_use.iter().enumerate() {
            coefficients[*term] = mean(&|h| h.coefficients[j]);
        }
        Some(Self {
            coefficients,
            noise: mean(&|h| h.noise).sqrt(),
            misfit: mean(&|h| h.misfit).sqrt(),
            values: n,
            in_use: in_use.to_vec(),
            at: points.iter().map(|p| p.at).collect(),
            hypotheses,
        })
    }

    /// The curve for regressors `x` in a thermal state (C, C per minute), and its standard deviation.
    #[must_use]
    pub fn along(&self, x: &[f64], at: (f64, f64)) -> (f64, f64) {
        let row = DVector::from_fn(self.in_use.len(), |j, _| x[self.in_use[j]]);
        let value: f64 = x.iter().zip(&self.coefficients).map(|(x, c)| x * c).sum();
        let likeness = DVector::from_fn(self.at.len(), |k, _| common(self.at[k], at));
        let own = common(at, at);
        let variance = |h: &Hypothesis| {
            let together = (&h.gain * &likeness).dot(&row);
            let spread = h.coefficients.dot(&row) - value;
            (&h.covariance * &row).dot(&row) + h.misfit * (own - 2.0 * together) + spread * spread
        };
        let total: f64 = self.hypotheses.iter().map(|h| h.probability * variance(h)).sum();
        (value, total.max(0.0).sqrt())
    }
}

/// Noise and misfit of covariance `v` times the noise, of which the misfit has `part` on a soak, with the logarithm of the restricted likelihood; and the
/// coefficients that take each value by its own variance.
fn hypothesis(x: &DMatrix<f64>, y: &DVector<f64>, v: DMatrix<f64>, part: f64) -> Option<(f64, Hypothesis)> {
    let free = (x.nrows() - x.ncols()) as f64;
    let alone = DMatrix::from_fn(x.ncols(), x.nrows(), |j, k| x[(k, j)] / v[(k, k)]);
    let gain = (&alone * x).cholesky()?.solve(&alone);
    let coefficients = &gain * y;
    let spread = &gain * &v * gain.transpose();
    let v = v.cholesky()?;
    let weighted = v.solve(x);
    let information = (x.transpose() * &weighted).cholesky()?;
    let left = y - x * information.solve(&(weighted.transpose() * y));
    let squares = left.dot(&v.solve(&left));
    let log = -0.5 * (log_determinant(&v) + log_determinant(&information) + free * squares.ln());
    // Mean of the variance that so many squares leave open.
    let noise = squares / (free - 2.0);
    Some((
        log,
        Hypothesis { probability: 0.0, misfit: part * noise, coefficients, covariance: spread * noise, gain, noise },
    ))
    .filter(|h| h.0.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Straight lines through a curve of exponential shape: the errors are as large as stated, with much misfit and with none.
    #[test]
    fn errors_are_as_large_as_stated() {
        for bend in [0.0, 4.0, 20.0, 100.0] {
            let (mut z2, mut count) = (0.0, 0.0);
            for seed in 0..60 {
                let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
                let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
                let (size, place) = (bend * noise(), 25.0 + 30.0 * noise());
                // An arch of a temperature, 35 C wide: no polynomial, and no random curve of the fit's kind.
                let truth = |t: f64| 3.0 + 2.0 * t / 35.0 + size / (1.0 + ((t - place) / 35.0).powi(2));
                let points: Vec<Point> = (0..55)
                    .map(|k| {
                        let t = -40.0 + 25.0 * f64::from(k / 11);
                        let u = t / 35.0;
                        Point { x: vec![1.0, u, u * u], at: (t, 0.0), value: truth(t) + 3.0 * noise(), weight: 1.0 }
                    })
                    .collect();
                let curve = Curve::fit(&points, 3, &[0, 1, 2]).expect("fits");
                assert!((1.5..5.0).contains(&curve.noise), "{}", curve.noise);
                for t in [-30.0, -3.0, 22.0, 47.0] {
                    let u = t / 35.0;
                    let (value, std) = curve.along(&[1.0, u, u * u], (t, 0.0));
                    z2 += ((value - truth(t)) / std).powi(2);
                    count += 1.0;
                }
            }
            println!("bend {bend}: z^2 {:.2}", z2 / count);
            assert!((0.4..1.5).contains(&(z2 / count)), "bend {bend}: {}", z2 / count);
        }
    }

    #[test]
    fn too_few_values_or_terms_that_are_alike_give_none() {
        let point = |t: f64| Point { x: vec![1.0, t, 2.0 * t], at: (t, 0.0), value: t, weight: 1.0 };
        let points: Vec<Point> = (0..10).map(|k| point(f64::from(k))).collect();
        assert!(Curve::fit(&points, 3, &[0, 1]).is_some());
        assert!(Curve::fit(&points[..5], 3, &[0, 1]).is_none());
    }
}
