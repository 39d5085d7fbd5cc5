//! Uncertainty of the bias of an image: the covariance of all its gains in its largest parts.
//!
//! The bias of a unit is uncertain because its gains are, because the parameters of its effects are, and because the constant of a
//! power-on is not that of the next. On the rows of the train runs the first two are one covariance of the bias at every row. Its
//! largest directions are kept, each as a bias made of the regressors that the unit has; what they do not hold, on average over
//! the rows, and the scatter of the constants of the days make the rest, which is the same at all times.

use super::data::{Candidate, Data};
use super::noise::{NoiseModel, NOISE_MODELS};
use super::model::{columns, Columns, Fitted, Term};
use super::stated::Stated;
use super::user_effects::card_of;
use hrg_core::calibration::DIRECTIONS;
use hrg_core::effects::MAX_PARAMETERS;
use hrg_core::AXES;
use hrg_data::numeric::stats::dot;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Step of a parameter for its derivative: a share of itself, or of the temperature span.
const SHARE: f32 = 0.01;
/// Smallest rest, as a share of the noise's variance of a 100 s mean's: an image that states its uncertainty states some.
const LEAST: f64 = 1e-6;

/// A refined parameter of a term: the term, which parameter, and its step for a derivative.
fn refined(data: &Data<'_>, terms: &[Term]) -> Vec<(usize, usize, f32)> {
    let (low, high) = data.temperature_range();
    let mut out = Vec::new();
    for (e, t) in terms.iter().enumerate().filter(|(_, t)| t.parts.len() == 1 && t.lead().on_unit()) {
        for (place, how) in card_of(t.lead().facts).refine.iter().enumerate() {
            let of = if how.by_factor() { t.lead().parameters[place] } else { high - low };
            out.push((e, place, SHARE * of));
        }
    }
    out
}

/// Derivative of the bias of an axis with respect to a parameter, on the blocks.
fn derivative(data: &Data<'_>, c: &Candidate, gains: &[f64], a: usize, which: usize, step: f32) -> Option<Vec<f64>> {
    let moved = |sign: f32| {
        let mut c = *c;
        c.parameters[which] += sign * step;
        let columns = data.columns(&c, a, true)?;
        let n = columns.first()?.len();
        Some((0..n).map(|k| columns.iter().zip(gains).map(|(x, g)| g * x[k]).sum::<f64>()).collect::<Vec<f64>>())
    };
    let (up, down) = (moved(1.0)?, moved(-1.0)?);
    Some(up.iter().zip(&down).map(|(u, d)| (u - d) / (2.0 * f64::from(step))).collect())
}

/// The columns of one axis' fit with the derivatives behind them.
struct Joint {
    columns: Columns,
    /// Number of coefficients and days: the derivatives follow.
    fitted: usize,
    /// Of each derivative: the place in the list of refined parameters.
    derivatives: Vec<usize>,
}

impl Joint {
    fn new(data: &Data<'_>, fitted: &Fitted, refined: &[(usize, usize, f32)], a: usize) -> Self {
        let mut columns = columns(data, &fitted.terms, a);
        let count = columns.values.len();
        let mut derivatives = Vec::new();
        for (place, &(e, which, step)) in refined.iter().enumerate() {
            let Some(range) = fitted.gains(e, a) else { continue };
            let gains = &fitted.axes[a].coefficients[range];
            if let Some(d) = derivative(data, fitted.terms[e].lead(), gains, a, which, step) {
                columns.values.push(d);
                columns.names.push("a parameter");
                columns.prior.push(None);
                derivatives.push(place);
            }
        }
        Self { columns, fitted: count, derivatives }
    }

    /// The fit under one noise model. `None` where the data cannot hold the coefficients down.
    fn under(&self, data: &Data<'_>, a: usize, noise: NoiseModel, weights: Weights) -> Option<Under> {
        let rows = &data.axes[a];
        let (mut x, mut y) = (self.columns.values.clone(), rows.y.clone());
        x.iter_mut().for_each(|c| noise.whiten(c, &rows.starts));
        noise.whiten(&mut y, &rows.starts);
        let fit = hrg_data::numeric::lsq::fit_shrunk(&x, &y, &self.columns.prior, &self.columns.names).ok()?;
        let p = self.columns.values.len();
        // Restricted likelihood: of what the coefficients cannot explain (Patterson and Thompson 1971).
        let determinant =
            2.0 * fit.covariance.clone().cholesky()?.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let information = 2.0 * p as f64 * fit.sigma.ln() - determinant;
        let free = (fit.rows + self.columns.prior.iter().flatten().count()) as f64 - p as f64;
        let likelihood =
            noise.first_factor().ln() * rows.starts.len() as f64 - free * fit.sigma.ln() - 0.5 * information;
        if weights == Weights::Noise {
            return Some(Under {
                likelihood,
                covariance: fit.covariance,
                coefficients: DVector::from_vec(fit.coefficients),
            });
        }
        // Of plain least squares under noise that is not white: (X'X)^-1 X' N X (X'X)^-1. N = C C', and C' is the recursion of the
        // noise run backwards.
        let n = rows.y.len();
        let g = DMatrix::from_fn(p, p, |i, j| dot(&self.columns.values[i], &self.columns.values[j])).try_inverse()?;
        let ends: Vec<usize> = rows.starts.iter().skip(1).copied().chain([n]).rev().map(|end| n - end).collect();
        let back: Vec<Vec<f64>> = self
            .columns
            .values
            .iter()
            .map(|c| {
                let mut c: Vec<f64> = c.iter().rev().copied().collect();
                noise.give(&mut c, &ends);
                c
            })
            .collect();
        let m = DMatrix::from_fn(p, p, |i, j| fit.sigma * fit.sigma * dot(&back[i], &back[j]));
        // The same coefficients, whatever the noise.
        Some(Under { likelihood, covariance: &g * m * &g, coefficients: DVector::zeros(p) })
    }

    /// The covariance over all noise models, each by its probability: the mean of theirs, and the scatter of their coefficients about
    /// those of the fit (`fitted` is its noise model). A run of some hours hardly tells a slow noise from none, and the constant hangs
    /// on it.
    fn covariance(&self, data: &Data<'_>, a: usize, fitted: NoiseModel, weights: Weights) -> Option<DMatrix<f64>> {
        let fitted = self.under(data, a, fitted, weights)?;
        let each: Vec<Under> = NOISE_MODELS.iter().filter_map(|s| self.under(data, a, *s, weights)).collect();
        let best = each.iter().map(|u| u.likelihood).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = each.iter().map(|u| (u.likelihood - best).exp()).sum();
        let mut mean = DMatrix::zeros(self.columns.values.len(), self.columns.values.len());
        for u in each {
            let apart = u.coefficients - &fitted.coefficients;
            mean += (u.covariance + &apart * apart.transpose()) * ((u.likelihood - best).exp() / sum);
        }
        Some(mean)
    }
}

/// A fit under one noise model.
struct Under {
    /// Restricted log-likelihood of the noise model, but for a constant.
    likelihood: f64,
    covariance: DMatrix<f64>,
    coefficients: DVector<f64>,
}

/// Weights of the fit that gave the coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weights {
    /// By plain least squares.
    Plain,
    /// With the weights that the noise model asks for.
    Noise,
}

/// The uncertainty of each axis of a fitted model; `None` for an axis that has no data.
pub fn of(data: &Data<'_>, fitted: &Fitted, noise_models: [usize; AXES], weights: Weights) -> [Option<Stated>; AXES] {
    let refined = refined(data, &fitted.terms);
    let joint: Vec<Option<Joint>> =
        (0..AXES).map(|a| (!data.axes[a].y.is_empty()).then(|| Joint::new(data, fitted, &refined, a))).collect();
    // A parameter is common to the axes: each knows as much of it as all of them together.
    let mut information = vec![0.0; refined.len()];
    let alone: Vec<Option<DMatrix<f64>>> = (0..AXES)
        .map(|a| {
            let j = joint[a].as_ref()?;
            let c = j.covariance(data, a, NOISE_MODELS[noise_models[a]], weights)?;
            for (k, place) in j.derivatives.iter().enumerate() {
                information[*place] += 1.0 / c[(j.fitted + k, j.fitted + k)];
            }
            Some(c)
        })
        .collect();
    [0, 1, 2].map(|a: usize| {
        let j = joint[a].as_ref()?;
        let mut covariance = alone[a].clone()?;
        condition(&mut covariance, j, &information);
        Some(stated(data, fitted, a, j, &covariance, &refined, &information))
    })
}

/// Gives a covariance the knowledge of all axes of each parameter: the variance of the parameter becomes that of all, and what hangs
/// on it follows.
fn condition(covariance: &mut DMatrix<f64>, joint: &Joint, information: &[f64]) {
    for (k, place) in joint.derivatives.iter().enumerate() {
        let at = joint.fitted + k;
        let own = covariance[(at, at)];
        let more = information[*place] - 1.0 / own;
        if more > 0.0 {
            // One further observation of the parameter, of variance 1 / more.
            let column = covariance.column(at).clone_owned();
            let gain = 1.0 / (own + 1.0 / more);
            *covariance -= &column * column.transpose() * gain;
        }
    }
}

fn stated(
    data: &Data<'_>,
    fitted: &Fitted,
    a: usize,
    joint: &Joint,
    covariance: &DMatrix<f64>,
    refined: &[(usize, usize, f32)],
    information: &[f64],
) -> Stated {
    let mut parameter_std = vec![[f64::NAN; MAX_PARAMETERS]; fitted.terms.len()];
    for (place, &(e, which, _)) in refined.iter().enumerate() {
        if information[place] > 0.0 {
            parameter_std[e][which] = (1.0 / information[place]).sqrt();
        }
    }
    let fit = &fitted.axes[a];
    let count = fit.coefficients.len();
    let unit = on_the_unit(fitted, a, count);
    // Columns that move the bias: the unit's coefficients, then the parameters.
    let moves: Vec<usize> = unit.iter().copied().chain(joint.fitted..joint.columns.values.len()).collect();
    let n = data.axes[a].y.len();
    let x = DMatrix::from_fn(n, moves.len(), |k, j| joint.columns.values[moves[j]][k]);
    let c = DMatrix::from_fn(moves.len(), moves.len(), |i, j| covariance[(moves[i], moves[j])]);
    let root = square_root(&c);
    let along = &x * &root;
    let e = SymmetricEigen::new(along.transpose() * &along / n as f64);
    let total: f64 = e.eigenvalues.iter().map(|v| v.max(0.0)).sum();
    let mut order: Vec<usize> = (0..e.eigenvalues.len()).collect();
    order.sort_by(|i, j| e.eigenvalues[*j].total_cmp(&e.eigenvalues[*i]));
    let own: Vec<Vec<f64>> = unit.iter().map(|&j| joint.columns.values[j].clone()).collect();
    let (mut directions, mut squares_dph2) = (Vec::new(), Vec::new());
    for &k in order.iter().take(DIRECTIONS) {
        let weights = &root * e.eigenvectors.column(k);
        let mut b: Vec<f64> = weights.iter().take(unit.len()).copied().collect();
        // Contribution of the parameters, projected on the unit's own regressors.
        let of_parameters: Vec<f64> =
            (0..n).map(|r| (unit.len()..moves.len()).map(|j| x[(r, j)] * weights[j]).sum::<f64>()).collect();
        if let Some(more) = projected(&own, &of_parameters) {
            b.iter_mut().zip(more).for_each(|(b, m)| *b += m);
        }
        let mut full = vec![0.0; count];
        unit.iter().zip(&b).for_each(|(at, v)| full[*at] = *v);
        let values: Vec<f64> = (0..n).map(|r| own.iter().zip(&b).map(|(x, b)| x[r] * b).sum()).collect();
        squares_dph2.push(dot(&values, &values) / n as f64);
        directions.push(full);
    }
    let noise = data.axes[a].y.iter().map(|v| v * v).sum::<f64>() / n as f64;
    let rest = (total - squares_dph2.iter().sum::<f64>()).max(0.0) + days(&fit.days, covariance, count) + LEAST * noise;
    Stated { rest_dph2: rest, directions, squares_dph2, parameter_std }
}

/// Numbers of the coefficients that the unit has.
fn on_the_unit(fitted: &Fitted, a: usize, count: usize) -> Vec<usize> {
    let mut out = vec![true; count];
    for (e, t) in fitted.terms.iter().enumerate() {
        let Some(range) = fitted.gains(e, a) else { continue };
        let mut at = range.start;
        for part in &t.parts {
            let has = t.lead().on_unit() && part.on_unit();
            out[at..at + part.facts.outputs].fill(has);
            at += part.facts.outputs;
        }
    }
    (0..count).filter(|j| out[*j]).collect()
}

/// A matrix whose square is the covariance (what rounding has made negative is taken for zero).
fn square_root(c: &DMatrix<f64>) -> DMatrix<f64> {
    let e = SymmetricEigen::new(c.clone());
    let roots = DVector::from_iterator(c.nrows(), e.eigenvalues.iter().map(|v| v.max(0.0).sqrt()));
    &e.eigenvectors * DMatrix::from_diagonal(&roots)
}

/// The combination of columns nearest to a series; shrunk a little, so that columns which are alike do not part.
fn projected(columns: &[Vec<f64>], y: &[f64]) -> Option<Vec<f64>> {
    if dot(y, y) <= 0.0 {
        return None;
    }
    let p = columns.len();
    let mut g = DMatrix::from_fn(p, p, |i, j| dot(&columns[i], &columns[j]));
    for j in 0..p {
        g[(j, j)] = g[(j, j)] * (1.0 + 1e-6) + 1e-300;
    }
    let b = DVector::from_fn(p, |i, _| dot(&columns[i], y));
    Some(g.cholesky()?.solve(&b).iter().copied().collect())
}

/// Day-to-day variance of the bias offset (turn-on repeatability), beyond the uncertainty of the fit.
fn days(days: &[f64], covariance: &DMatrix<f64>, first: usize) -> f64 {
    if days.is_empty() {
        return 0.0;
    }
    let all: Vec<f64> = std::iter::once(-days.iter().sum::<f64>()).chain(days.iter().copied()).collect();
    let n = all.len() as f64;
    let seen = all.iter().map(|d| d * d).sum::<f64>() / (n - 1.0);
    let own = (0..days.len()).map(|k| covariance[(first + k, first + k)]).sum::<f64>() / days.len() as f64;
    (seen - own).max(0.0) * (1.0 + 1.0 / n)
}
