//! Coefficients of one axis over all noise models: each model's generalised least squares, weighted by its restricted likelihood
//! (Patterson and Thompson 1971). A run of some hours hardly tells a slow noise from none, and the constant hangs on it; so neither the
//! coefficients nor their covariance rest on one noise model.

use super::data::AxisRows;
use super::noise::NOISE_MODELS;
use crate::matrices::{log_determinant, symmetric};
use hrg_data::numeric::stats::{dot, log_sum};
use nalgebra::{DMatrix, DVector};

/// Noise models with a smaller share of the posterior are left out.
const NEGLIGIBLE: f64 = 0.05;

/// A fit under one noise model.
#[derive(Debug, Clone)]
pub struct Under {
    /// Number of the noise model in [`NOISE_MODELS`].
    pub noise_model: usize,
    /// Its share of the posterior; the shares of all add up to 1.
    pub weight: f64,
    /// Variance of the whitened noise, (deg/h)^2.
    pub variance_dph2: f64,
    /// The coefficients.
    pub coefficients: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Rows less coefficients without a prior.
    pub free: f64,
}

/// The coefficients of one axis.
#[derive(Debug, Clone)]
pub struct Posterior {
    /// Under each noise model that counts.
    pub each: Vec<Under>,
    /// Their mean.
    pub coefficients: DVector<f64>,
    /// Their covariance: the mean of the covariances, and the scatter of the coefficients about their mean.
    pub covariance: DMatrix<f64>,
    /// Log of the restricted likelihood, the mean over all noise models.
    pub evidence: f64,
}

/// The posterior of the coefficients of some columns on the rows of an axis. `prior`: variance of each coefficient about zero before the
/// data are seen, over that of the whitened noise; `None`: unbounded. `None` where the columns cannot be told apart.
pub fn posterior(rows: &AxisRows, columns: &[Vec<f64>], prior: &[Option<f64>]) -> Option<Posterior> {
    let mut each = under_each(rows, columns, prior);
    let all = |each: &[(f64, Under)]| log_sum(&each.iter().map(|e| e.0).collect::<Vec<_>>());
    let evidence = all(&each);
    each.retain(|e| (e.0 - evidence).exp() > NEGLIGIBLE);
    let kept = all(&each);
    let each: Vec<Under> = each.into_iter().map(|(l, under)| Under { weight: (l - kept).exp(), ..under }).collect();
    (!each.is_empty()).then(|| Posterior::of(each, evidence))
}

/// The fit under each noise model, with the log of its restricted likelihood times its probability before the data are seen. Fewer where the columns
/// cannot be told apart.
pub fn under_each(rows: &AxisRows, columns: &[Vec<f64>], prior: &[Option<f64>]) -> Vec<(f64, Under)> {
    let (n, p) = (rows.y.len(), columns.len());
    let free = n as f64 - prior.iter().filter(|v| v.is_none()).count() as f64;
    if free < 2.0 {
        return Vec::new();
    }
    let spread = prior.iter().flatten().map(|v| v.max(1e-300).ln()).sum::<f64>();
    NOISE_MODELS
        .iter()
        .enumerate()
        .filter_map(|(noise_model, noise)| {
            let x: Vec<Vec<f64>> = columns.iter().map(|c| rows.filters.whitened(noise_model, c)).collect();
            let y = rows.filters.whitened(noise_model, &rows.y);
            // Columns of unit length, so that the equations are as good as they can be.
            let scale: Vec<f64> = x.iter().map(|c| dot(c, c).sqrt().max(1e-100)).collect();
            let mut g = symmetric(p, |i, j| dot(&x[i], &x[j]) / (scale[i] * scale[j]));
            for (j, variance) in prior.iter().enumerate() {
                // (The last term keeps columns that differ by rounding alone apart.)
                g[(j, j)] += variance.map_or(0.0, |v| 1.0 / (v.max(1e-300) * scale[j] * scale[j])) + 1e-12;
            }
            let b = DVector::from_fn(p, |i, _| dot(&x[i], &y) / scale[i]);
            let factor = g.cholesky()?;
            let solved = factor.solve(&b);
            let variance_dph2 = ((dot(&y, &y) - b.dot(&solved)) / free).max(1e-300);
            let lengths = 2.0 * scale.iter().map(|s| s.ln()).sum::<f64>();
            let information = lengths + log_determinant(&factor);
            let likelihood = noise.log_prior() + rows.filters.log_determinant(noise_model)
                - 0.5 * free * variance_dph2.ln()
                - 0.5 * (information + spread);
            let inverse = factor.inverse();
            let covariance = DMatrix::from_fn(p, p, |i, j| variance_dph2 * inverse[(i, j)] / (scale[i] * scale[j]));
            let coefficients = DVector::from_fn(p, |i, _| solved[i] / scale[i]);
            let finite = likelihood.is_finite() && coefficients.iter().all(|c| c.is_finite());
            let under = Under { noise_model, weight: 0.0, variance_dph2, coefficients, covariance, free };
            finite.then_some((likelihood, under))
        })
        .collect()
}

impl Posterior {
    /// From the fits under some noise models, whose weights add up to 1.
    pub fn of(each: Vec<Under>, evidence: f64) -> Self {
        let coefficients: DVector<f64> = each.iter().map(|u| &u.coefficients * u.weight).sum();
        let mut covariance = DMatrix::zeros(coefficients.len(), coefficients.len());
        for u in &each {
            let apart = &u.coefficients - &coefficients;
            covariance += (&u.covariance + &apart * apart.transpose()) * u.weight;
        }
        Self { each, coefficients, covariance, evidence }
    }
}
