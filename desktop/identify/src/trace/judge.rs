//! The judge: does what the train runs say, with its uncertainty and its noise, predict another run better than the baseline does?
//!
//! Two numbers by axis answer it. The *log score* is `log p(run | train, model) - log p(run | train, baseline)`: the density of the run's
//! block means under the prediction of each, with the uncertainty of its gains and parameters, its noise models by their weights, and the
//! run's own constant (and events that nobody can predict) integrated out. Size, sign and correlated noise are in it, and an axis without an effect gives about 0. The *fall* is
//! that of the mean square error about the run's own mean, with the deviation that it has as the share of the prediction that the run shows
//! is known no better: `fall = (2 share - 1)` times the mean square of the prediction.

use super::data::{AxisRows, Candidate, Data, Starts};
use super::model::Fitted;
use super::noise::Basis;
use super::odds::THRESHOLD;
use super::regression::Under;
use super::uncertainty::{square_root, Joint, Known};
use crate::matrices::log_determinant;
use hrg_core::AXES;
use hrg_data::numeric::stats::{dot, log_sum};
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Deviations beyond which a fall is none of chance: two-sided, for three axes together, at the [level](super::odds::LEVEL) of a test.
pub const DEVIATIONS: f64 = 2.39;

/// A model's answer to a run, one axis, against another model's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Agreement {
    /// Log density of the run under the larger model less that under the smaller one.
    pub log_score: f64,
    /// Fall of the mean square error, (deg/h)^2; negative where it rises.
    pub mse_fall: f64,
    /// Its standard deviation, by that of the share.
    pub mse_fall_std: f64,
    /// Share of the predicted difference that the run shows, by generalised least squares: 1 where the larger model is right, 0 where the
    /// smaller one is.
    pub share: f64,
    /// Its standard deviation, by the noise.
    pub share_std: f64,
    /// Standard deviation of a share of 1, by the uncertainty of the larger model's gains and parameters.
    pub predicted_std: f64,
}

impl Agreement {
    /// `true` where the run is more probable under the larger model, and the error falls.
    fn speaks_for(&self) -> bool {
        self.log_score > 0.0 && self.mse_fall > 0.0
    }

    /// `true` where the error falls by more than chance.
    #[must_use]
    pub fn wins(&self) -> bool {
        self.mse_fall > DEVIATIONS * self.mse_fall_std
    }

    /// `true` where the run shows the difference in another size than the larger model predicts, by more than chance: what it stands for is
    /// something else.
    #[must_use]
    pub fn is_of_another_size(&self) -> bool {
        self.share_std > 0.0 && (self.share - 1.0).abs() > DEVIATIONS * self.share_std.hypot(self.predicted_std)
    }

    /// `true` where the error rises by more than chance.
    #[must_use]
    pub fn loses(&self) -> bool {
        -self.mse_fall > DEVIATIONS * self.mse_fall_std
    }
}

/// Axes on which a run bears the larger model out: those that speak for it, if the axes together are more probable under it by the odds at
/// which an effect is named, and the error of one of them falls by more than chance. (A model that holds on one axis is more probable on the next.)
pub fn borne_out<K: Copy>(each: &[(K, Agreement)]) -> Vec<K> {
    let gain: Vec<_> = each.iter().filter(|(_, a)| a.speaks_for()).collect();
    let together: f64 = gain.iter().map(|(_, a)| a.log_score).sum();
    if together > THRESHOLD && gain.iter().any(|(_, a)| a.wins()) {
        gain.iter().map(|(k, _)| *k).collect()
    } else {
        Vec::new()
    }
}

/// Mean square of what something leaves of a run beyond the noise.
#[derive(Debug, Clone, Copy)]
pub struct Misfit {
    /// The mean square, (deg/h)^2.
    pub square: f64,
    /// Its deviation as a share of it: it is a few slow swings (`Means::spread_of_square`).
    pub spread: f64,
}

/// `true` if an image leaves less than the baseline on a run with another profile, too, by more than chance. `runs`: misfit of the image and of
/// the baseline on each run that did not learn. Those of another run are as far from their means as those of these runs are.
#[must_use]
pub fn holds_elsewhere(runs: &[(Misfit, Misfit)]) -> bool {
    let n = runs.len().max(1) as f64;
    let log = runs.iter().map(|(image, baseline)| (image.square / baseline.square).ln()).sum::<f64>() / n;
    let variance = runs.iter().map(|(i, b)| i.spread * i.spread + b.spread * b.spread).sum::<f64>() / n;
    log < -DEVIATIONS * (variance * (1.0 + 1.0 / n)).sqrt()
}

/// The predictions of a model for a run.
pub struct Prediction {
    axes: [Option<OnAxis>; AXES],
    /// The same from every state that what remembers the path of the temperature may have at the begin of the run; empty where the state is
    /// known.
    starts: Vec<[Option<OnAxis>; AXES]>,
}

struct OnAxis {
    /// Columns with the derivatives of refined parameters behind them.
    columns: Vec<Vec<f64>>,
    /// Number of coefficients: derivatives follow.
    coefficients: usize,
    /// Fit under each noise model, and the covariance of coefficients and derivatives.
    each: Vec<(Under, DMatrix<f64>)>,
    /// The mean prediction.
    mean: Vec<f64>,
}

impl Prediction {
    /// Of a fitted model for a run (`data`, see [`Data::unseen`]); terms that `which` lets through.
    pub fn new(data: &Data<'_>, fitted: &Fitted, known: &Known, which: &dyn Fn(&Candidate) -> bool) -> Self {
        let of = |a: usize| {
            let posterior = fitted.axes[a].posterior.as_ref()?;
            let joint_posterior = known.posteriors[a].as_ref()?;
            if data.axes[a].y.is_empty() {
                return None;
            }
            let joint = Joint::new(data, fitted, &known.refined, a);
            let coefficients = joint.coefficients();
            let mut columns = joint.columns.values;
            // Terms that cannot be predicted are not there on another run.
            for at in fitted.without(a, which) {
                columns[at].fill(0.0);
            }
            let each = posterior
                .each
                .iter()
                .map(|u| {
                    let of_joint = joint_posterior.each.iter().find(|j| j.noise_model == u.noise_model);
                    (u.clone(), of_joint.map_or_else(|| joint_posterior.covariance.clone(), |j| j.covariance.clone()))
                })
                .collect();
            let gains: Vec<f64> = posterior.coefficients.iter().copied().collect();
            let mean = sum(&columns[..coefficients], &gains, data.axes[a].y.len());
            Some(OnAxis { columns, coefficients, each, mean })
        };
        Self { axes: [of(0), of(1), of(2)], starts: Vec::new() }
    }

    /// The same for a unit that does not know the state at the begin of a run: the prediction is the unit's, and the density the mean over all
    /// states.
    pub fn of_unit(data: &Data<'_>, fitted: &Fitted, known: &Known, which: &dyn Fn(&Candidate) -> bool) -> Self {
        let remembers = fitted.terms().iter().flat_map(|t| &t.parts).any(|c| c.facts.remembers_path);
        let branches = if remembers && !fitted.goes_on() { 0..Starts::BRANCHES.len() } else { 0..0 };
        let starts = branches.map(|b| Self::new(data, &fitted.starting(b), known, which).axes).collect();
        Self { starts, ..Self::new(data, fitted, known, which) }
    }

    /// The mean prediction for an axis, on the blocks.
    pub fn mean(&self, a: usize) -> Option<&[f64]> {
        self.axes[a].as_ref().map(|x| &x.mean[..])
    }

    /// Log density of a run, all axes.
    pub fn log_density(&self, data: &Data<'_>) -> f64 {
        (0..AXES).filter_map(|a| self.log_density_on(a, &data.axes[a])).sum()
    }

    /// The same of one axis.
    fn log_density_on(&self, a: usize, rows: &AxisRows) -> Option<f64> {
        let own = self.axes[a].as_ref()?;
        let each: Vec<f64> = self.starts.iter().filter_map(|s| Some(s[a].as_ref()?.log_density(rows))).collect();
        Some(if each.is_empty() { own.log_density(rows) } else { log_sum(&each) - (each.len() as f64).ln() })
    }

    /// This model against a smaller one on a run. `None` for an axis without data.
    pub fn against(&self, smaller: &Self, data: &Data<'_>, a: usize) -> Option<Agreement> {
        let (large, small) = (self.axes[a].as_ref()?, smaller.axes[a].as_ref()?);
        let rows = &data.axes[a];
        let log_score = self.log_density_on(a, rows)? - smaller.log_density_on(a, rows)?;
        Some(Agreement { log_score, ..large.fall(&small.mean, rows) })
    }

    /// The same against any prediction of the rates (on the blocks of the axis); the log score is left 0.
    pub fn fall_against(&self, prediction: &[f64], data: &Data<'_>, a: usize) -> Option<Agreement> {
        Some(self.axes[a].as_ref()?.fall(prediction, &data.axes[a]))
    }
}

impl OnAxis {
    /// Log density of the rates of a run, its constant integrated out.
    fn log_density(&self, rows: &AxisRows) -> f64 {
        log_sum(&self.under_each(rows))
    }

    /// Under each noise model: the log of its weight, and of the density.
    fn under_each(&self, rows: &AxisRows) -> Vec<f64> {
        self.each.iter().map(|(u, c)| u.weight.ln() + self.under(u, c, rows)).collect()
    }

    /// The same under one noise model: a multivariate t, as the noise's variance is known from the train runs no better than that.
    fn under(&self, u: &Under, covariance: &DMatrix<f64>, rows: &AxisRows) -> f64 {
        let n = rows.y.len() as f64;
        let gains: Vec<f64> = u.coefficients.iter().copied().collect();
        let predicted = sum(&self.columns[..self.coefficients], &gains, rows.y.len());
        let mut left: Vec<f64> = rows.y.iter().zip(&predicted).map(|(y, p)| y - p).collect();
        let sigma = u.variance_dph2.sqrt();
        let whitened = |x: &mut Vec<f64>| {
            rows.filters.whiten(u.noise_model, x);
            x.iter_mut().for_each(|v| *v /= sigma);
        };
        let mut constant = vec![1.0; rows.y.len()];
        whitened(&mut constant);
        whitened(&mut left);
        let mut basis = Basis::default();
        let mut lengths = basis.add_measured(constant).ln();
        for column in &rows.happened {
            let mut column = column.clone();
            whitened(&mut column);
            let length = basis.add_measured(column);
            lengths += if length > 0.0 { length.ln() } else { 0.0 };
        }
        basis.reduce(&mut left);
        // The uncertainty of the coefficients along its own directions: a column of the run for each.
        let root = square_root(covariance);
        let p = self.columns.len();
        let columns: Vec<Vec<f64>> = (0..p)
            .map(|j| {
                let mut x = self.columns[j].clone();
                whitened(&mut x);
                basis.reduce(&mut x);
                x
            })
            .collect();
        let g = DMatrix::from_fn(p, p, |i, j| dot(&columns[i], &columns[j]));
        let m = DMatrix::identity(root.ncols(), root.ncols()) + root.transpose() * &g * &root;
        let b = root.transpose() * DVector::from_fn(p, |i, _| dot(&columns[i], &left));
        let Some(factor) = m.cholesky() else { return f64::NEG_INFINITY };
        let determinant = log_determinant(&factor);
        let squares = (dot(&left, &left) - b.dot(&factor.solve(&b))).max(0.0);
        let (freedom, n) = (u.free, n - (basis.columns.len() - 1) as f64);
        rows.filters.log_determinant(u.noise_model)
            - (n - 1.0) * sigma.ln()
            - 0.5 * lengths
            - 0.5 * determinant
            - 0.5 * (freedom + n - 1.0) * (1.0 + squares / freedom).ln()
    }

    /// Fall of the mean square error from another prediction to this one, and the share of the difference that the run shows.
    fn fall(&self, other: &[f64], rows: &AxisRows) -> Agreement {
        let n = rows.y.len() as f64;
        let mut own = Basis::default();
        for column in std::iter::once(&vec![1.0; rows.y.len()]).chain(&rows.happened) {
            own.add(column.clone());
        }
        let about = |mut x: Vec<f64>| {
            own.reduce(&mut x);
            x
        };
        let d = about(self.mean.iter().zip(other).map(|(l, s)| l - s).collect());
        let before = about(rows.y.iter().zip(other).map(|(y, s)| y - s).collect());
        let after: Vec<f64> = before.iter().zip(&d).map(|(e, d)| e - d).collect();
        let power = dot(&d, &d);
        if !(power > 1e-9 * dot(&before, &before)) {
            return Agreement::default();
        }
        // The share that the run shows, by generalised least squares beside the run's constant. The noise is that of both runs: each noise
        // model by its weight after this run, too, and what this model leaves counts as noise.
        let each = self.under_each(rows);
        let all = log_sum(&each);
        let (mut share, mut square, mut of_noise, mut of_model) = (0.0, 0.0, 0.0, 0.0);
        for ((u, covariance), e) in self.each.iter().zip(&each) {
            let mut basis = Basis::default();
            let whitened = |mut x: Vec<f64>, basis: &Basis| {
                rows.filters.whiten(u.noise_model, &mut x);
                basis.reduce(&mut x);
                x
            };
            for column in std::iter::once(&vec![1.0; rows.y.len()]).chain(&rows.happened) {
                let column = whitened(column.clone(), &basis);
                basis.add(column);
            }
            let [d, before, after] = [&d, &before, &after].map(|x| whitened(x.clone(), &basis));
            let length = dot(&d, &d).max(1e-300);
            let variance = (u.free * u.variance_dph2 + dot(&after, &after)) / (u.free + n);
            let (weight, s) = ((e - all).exp(), dot(&before, &d) / length);
            share += weight * s;
            square += weight * s * s;
            of_noise += weight * variance / length;
            let shown = DVector::from_iterator(
                self.columns.len(),
                self.columns.iter().map(|c| dot(&whitened(c.clone(), &basis), &d) / length),
            );
            of_model += weight * (covariance * &shown).dot(&shown);
        }
        let share_std = (of_noise + (square - share * share).max(0.0)).sqrt();
        Agreement {
            log_score: 0.0,
            mse_fall: (dot(&before, &before) - dot(&after, &after)) / n,
            mse_fall_std: 2.0 * share_std * power / n,
            share,
            share_std,
            predicted_std: of_model.max(0.0).sqrt(),
        }
    }
}

fn sum(columns: &[Vec<f64>], gains: &[f64], n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n];
    for (column, g) in columns.iter().zip(gains) {
        out.iter_mut().zip(column).for_each(|(o, x)| *o += g * x);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_gains_is_borne_out_where_another_one_gains_by_more_than_chance() {
        let of = |log_score: f64, deviations: f64| Agreement {
            log_score,
            mse_fall: deviations,
            mse_fall_std: 1.0,
            ..Agreement::default()
        };
        let on = |each: &[Agreement]| borne_out(&each.iter().copied().enumerate().collect::<Vec<_>>());
        assert_eq!(on(&[of(3.0, 4.0), of(2.0, 1.0), of(0.5, -0.1)]), [0, 1]);
        // Less probable, or of less than the odds together, or by no more than chance on any.
        assert_eq!(on(&[of(9.0, 4.0), of(-0.1, 4.0)]), [0]);
        assert_eq!(on(&[of(3.0, 4.0), of(1.0, 4.0), of(-9.0, 4.0)]), [0; 0]);
        assert_eq!(on(&[of(9.0, 2.3), of(9.0, 2.3)]), [0; 0]);
    }

    #[test]
    fn what_a_misfit_is_elsewhere_is_known_by_how_it_swings() {
        let of = |share: f64, spread: f64| (Misfit { square: share, spread }, Misfit { square: 1.0, spread });
        // exp(-2.39 * 0.5) = 0.303.
        assert!(holds_elsewhere(&[of(0.29, 0.25)]) && !holds_elsewhere(&[of(0.31, 0.25)]));
        assert!(holds_elsewhere(&[of(0.8, 0.04)]) && !holds_elsewhere(&[of(0.1, 0.5)]));
        // A second run tells more, and both count alike.
        assert!(
            holds_elsewhere(&[of(0.34, 0.25), of(0.34, 0.25)]) && !holds_elsewhere(&[of(0.29, 0.25), of(1.0, 0.25)])
        );
        assert!(holds_elsewhere(&[of(0.0, 0.25)]) && !holds_elsewhere(&[of(f64::NAN, 0.25)]));
    }
}
