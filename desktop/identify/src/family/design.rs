//! Knowledge that a chamber run is expected to bring of the next unit of a family: Bayesian experimental design.
//!
//! Before a run is made, its columns are known (they are those of its temperatures), its noise is the family's, and so is the covariance that the
//! coefficients will have behind it: no rate is needed (Lindley 1956; Chaloner and Verdinelli 1995, A-optimality). The figure of a run is the mean
//! variance of the bias that it leaves over another run, about the constant of that one.

use super::member::another_day;
use super::{Family, OfAxis};
use crate::matrices::symmetric;
use crate::trace::data::Data;
use crate::trace::noise::NOISE_MODELS;
use crate::trace::uncertainty::square_root;
use hrg_core::AXES;
use hrg_data::numeric::stats::{dot, mean};
use hrg_data::recording::steps::Run;
use nalgebra::{DMatrix, DVector};

/// A run over which uncertainty is stated: the mean products of the columns of its bias, about their means.
#[derive(Debug, Clone)]
pub struct Over {
    pub(super) axes: [Option<DMatrix<f64>>; AXES],
}

impl Family {
    /// The parts of the uncertainty over a run.
    #[must_use]
    pub fn over(&self, run: &Run) -> Over {
        let (data, specification) = (self.blocks(run), self.specification());
        let of = |a: usize| {
            self.axes[a].as_ref()?;
            let columns = specification.columns(&data, a).values;
            let n = columns.first().map_or(0, Vec::len);
            let centred: Vec<Vec<f64>> = columns
                .into_iter()
                .map(|c| {
                    let middle = mean(&c);
                    c.into_iter().map(|v| v - middle).collect()
                })
                .collect();
            let p = centred.len();
            (n > 0).then(|| symmetric(p, |i, j| dot(&centred[i], &centred[j]) / n as f64))
        };
        Over { axes: [of(0), of(1), of(2)] }
    }

    /// Standard uncertainty of the bias of a unit over a run, about its constant there, root mean square, deg/h, by axis: once another run of the unit was
    /// recorded, or before anything was. NaN for an axis that the family does not have.
    #[must_use]
    pub fn expected_dph(&self, recorded: Option<&Run>, over: &Over) -> [f64; AXES] {
        let specification = self.specification();
        let data = recorded.map(|run| self.blocks(run));
        std::array::from_fn(|a| {
            let (Some(axis), Some(over)) = (&self.axes[a], &over.axes[a]) else { return f64::NAN };
            let days = &axis.population.days;
            let covariance = match &data {
                None => &axis.population.between + days,
                Some(data) => {
                    let columns = specification.columns(data, a).values;
                    let each = NOISE_MODELS.iter().enumerate().filter(|(s, _)| axis.noise_models[*s] > SMALL);
                    let (mut sum, mut all) = (DMatrix::zeros(columns.len(), columns.len()), 0.0);
                    for (s, _) in each {
                        let weight = axis.noise_models[s];
                        sum += behind(axis, data, a, &columns, s) * weight;
                        all += weight;
                    }
                    sum / all
                }
            };
            covariance.component_mul(over).sum().max(0.0).sqrt()
        })
    }

    /// Deviation of the constant of an axis from day to day, deg/h: no run makes it smaller. NaN for an axis that the family does not have.
    #[must_use]
    pub fn days_dph(&self) -> [f64; AXES] {
        std::array::from_fn(|a| self.axes[a].as_ref().map_or(f64::NAN, |x| x.population.days[(0, 0)].sqrt()))
    }
}

/// Noise models with a smaller share are left out.
const SMALL: f64 = 0.02;

/// Covariance of the coefficients of another day behind a run, under one noise model.
fn behind(axis: &OfAxis, data: &Data<'_>, a: usize, columns: &[Vec<f64>], noise_model: usize) -> DMatrix<f64> {
    let rows = &data.axes[a];
    let days = &axis.population.days;
    let x: Vec<Vec<f64>> = columns.iter().map(|c| rows.filters.whitened(noise_model, c)).collect();
    let variance = axis.noise.white_dph2_s / data.block_s as f64 * NOISE_MODELS[noise_model].innovation();
    let root = square_root(&(&axis.population.between + days));
    let p = x.len();
    let gram = symmetric(p, |i, j| dot(&x[i], &x[j]) / variance);
    let m = DMatrix::identity(p, p) + root.transpose() * gram * &root;
    let Some(inverse) = m.cholesky().map(|f| f.inverse()) else { return &axis.population.between + days };
    let covariance = &root * inverse * root.transpose();
    another_day(&DVector::zeros(p), &covariance, &axis.population).1
}
