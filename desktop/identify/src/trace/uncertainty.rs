//! Uncertainty of the bias of an image: the covariance of all its gains in its largest parts.
//!
//! The bias of a unit is uncertain because its gains are, because the parameters of its effects are, and because the constant of a
//! power-on is not that of the next. On the rows of the train runs the first two are one covariance of the bias at every row. Its
//! largest directions are kept, each as a bias made of the regressors that the unit has; what they do not hold, on average over
//! the rows, and the scatter of the constants of the days make the rest, which is the same at all times.

use super::data::{Candidate, Data};
use super::model::{Columns, Fitted, Specification, Term};
use super::regression::{posterior, Posterior};
use super::stated::Stated;
use super::user_effects::card_of;
use hrg_core::bias::{regressors, Scaling, TERMS};
use hrg_core::calibration::{Axis, DIRECTIONS};
use hrg_core::effects::MAX_PARAMETERS;
use hrg_core::visited::{LEVELS, TEMPERATURES};
use hrg_core::AXES;
use hrg_data::numeric::stats::dot;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Step of a parameter for its derivative: a share of itself, or of the span of temperature or of its quantity.
const SHARE: f32 = 0.01;
/// Smallest rest, as a share of the noise's variance of a 100 s mean's: an image that states its uncertainty states some.
const LEAST: f64 = 1e-6;

/// A refined parameter of a term: the term, which parameter, and its step for a derivative.
pub type Refined = (usize, usize, f32);

fn refined(data: &Data<'_>, terms: &[Term]) -> Vec<Refined> {
    let extent = data.extent();
    let mut out = Vec::new();
    for (e, t) in terms.iter().enumerate().filter(|(_, t)| t.parts.len() == 1 && t.lead().on_unit()) {
        for (place, how) in card_of(t.lead().facts).refine.iter().enumerate() {
            let parameters = &t.lead().parameters;
            let of = if how.by_factor() { parameters[place] } else { extent.width(*how, parameters) };
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
pub struct Joint {
    /// The columns.
    pub columns: Columns,
    /// Number of coefficients and days: the derivatives follow.
    fitted: usize,
    /// Of each derivative: the place in the list of refined parameters.
    derivatives: Vec<usize>,
}

impl Joint {
    /// The columns of a fitted model on the rows of an axis. `data` may be those of another run than it was fitted to.
    pub fn new(data: &Data<'_>, fitted: &Fitted, refined: &[Refined], a: usize) -> Self {
        let mut columns = fitted.model.columns(data, a);
        let count = columns.values.len();
        let mut derivatives = Vec::new();
        for (place, &(e, which, step)) in refined.iter().enumerate() {
            let Some(range) = fitted.gains(e, a) else { continue };
            let gains = &fitted.axes[a].coefficients[range];
            if let Some(d) = derivative(data, fitted.terms()[e].lead(), gains, a, which, step) {
                columns.values.push(d);
                columns.names.push("a parameter");
                columns.prior.push(None);
                derivatives.push(place);
            }
        }
        Self { columns, fitted: count, derivatives }
    }

    /// Number of coefficients and days, without derivatives.
    pub fn coefficients(&self) -> usize {
        self.fitted
    }
}

/// The uncertainty of a fitted model on the rows that it was fitted to.
#[derive(Debug)]
pub struct Known {
    /// Refined parameters.
    pub refined: Vec<Refined>,
    /// By axis: the coefficients with the derivatives behind them, over all noise models; `None` for an axis without data.
    pub posteriors: [Option<Posterior>; AXES],
    /// By axis: the uncertainty as an image states it.
    pub stated: [Option<Stated>; AXES],
}

/// The uncertainty of each axis of a fitted model.
pub fn of(data: &Data<'_>, fitted: &Fitted) -> Known {
    let refined = refined(data, fitted.terms());
    let joint: Vec<Option<Joint>> =
        (0..AXES).map(|a| (!data.axes[a].y.is_empty()).then(|| Joint::new(data, fitted, &refined, a))).collect();
    // A parameter is common to the axes: each knows as much of it as all of them together.
    let mut information = vec![0.0; refined.len()];
    let alone: Vec<Option<Posterior>> = (0..AXES)
        .map(|a| {
            let j = joint[a].as_ref()?;
            let p = fitted.axes[a].of_days.posterior(&data.axes[a], &j.columns.values, &j.columns.prior)?;
            for (k, place) in j.derivatives.iter().enumerate() {
                information[*place] += 1.0 / p.covariance[(j.fitted + k, j.fitted + k)];
            }
            Some(p)
        })
        .collect();
    let posteriors: [Option<Posterior>; AXES] = [0, 1, 2].map(|a: usize| {
        let (j, mut p) = (joint[a].as_ref()?, alone[a].clone()?);
        condition(&mut p.covariance, j, &information);
        p.each.iter_mut().for_each(|u| condition(&mut u.covariance, j, &information));
        Some(p)
    });
    let stated = [0, 1, 2].map(|a: usize| {
        let (j, p) = (joint[a].as_ref()?, posteriors[a].as_ref()?);
        Some(stated(data, fitted, a, j, &p.covariance, &refined, &information))
    });
    Known { refined, posteriors, stated }
}

/// The same where the posterior is given: each effect keeps its parameters.
pub fn given(data: &Data<'_>, fitted: &Fitted) -> Known {
    let posteriors = fitted.axes.each_ref().map(|fit| fit.posterior.clone());
    let stated = [0, 1, 2].map(|a: usize| {
        let covariance = &posteriors[a].as_ref()?.covariance;
        Some(stated(data, fitted, a, &Joint::new(data, fitted, &[], a), covariance, &[], &[]))
    });
    Known { refined: Vec::new(), posteriors, stated }
}

/// The same of the baseline by plain least squares: (X'X)^-1 X' N X (X'X)^-1 under the noise that generalised least squares find.
/// N = C C', and C' is the recursion of the noise run backwards.
pub fn of_plain(data: &Data<'_>, fitted: &Fitted) -> [Option<Stated>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let rows = &data.axes[a];
        let columns = Specification::default().columns(data, a);
        let under = posterior(rows, &columns.values, &columns.prior)?;
        let (n, p) = (rows.y.len(), columns.values.len());
        let inverse = DMatrix::from_fn(p, p, |i, j| dot(&columns.values[i], &columns.values[j])).try_inverse()?;
        let mut covariance = DMatrix::zeros(p, p);
        for u in &under.each {
            let back: Vec<Vec<f64>> = columns.values.iter().map(|c| rows.filters.backwards(u.noise_model, c)).collect();
            let m = DMatrix::from_fn(p, p, |i, j| u.variance_dph2 * dot(&back[i], &back[j]));
            covariance += (&inverse * m * &inverse) * u.weight;
        }
        debug_assert_eq!(n, rows.base[0].len());
        let joint = Joint { fitted: p, columns, derivatives: vec![] };
        Some(stated(data, fitted, a, &joint, &covariance, &[], &[]))
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
    refined: &[Refined],
    information: &[f64],
) -> Stated {
    let mut parameter_std = vec![[f64::NAN; MAX_PARAMETERS]; fitted.terms().len()];
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

/// Variance of the bias of an axis where the runs of the fit have not been, (deg/h)^2: the mean over the unknown entries of its map. The
/// baseline's coefficients are as uncertain there as their covariance says; the effects of the model may be others that do the same on the
/// runs of the fit, and so are uncertain by all that they do there (`effects_dph2`, their mean square). With no unknown entry it counts beyond
/// the ranges alone.
pub fn unvisited(axis: &Axis, scaling: &Scaling, covariance: &DMatrix<f64>, effects_dph2: f64) -> f64 {
    let ranges = axis.ranges();
    let places = (0..TEMPERATURES).flat_map(|entry| (0..LEVELS).map(move |level| (entry, level)));
    let states = places.map(|(entry, level)| ranges.middle(entry, level));
    let each: Vec<f64> = states
        .filter(|(t, r)| !axis.visited.knows(&ranges, *t, *r))
        .map(|(t, r)| {
            let x = DVector::from_iterator(TERMS, regressors(scaling, t, r).map(f64::from));
            (x.transpose() * covariance.view((0, 0), (TERMS, TERMS)) * &x)[(0, 0)]
        })
        .collect();
    effects_dph2 + each.iter().sum::<f64>() / each.len().max(1) as f64
}

/// Numbers of the coefficients that the unit has.
fn on_the_unit(fitted: &Fitted, a: usize, count: usize) -> Vec<usize> {
    let mut out = vec![true; count];
    for (e, t) in fitted.terms().iter().enumerate() {
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

/// A matrix whose product with its transpose is the covariance (what rounding has made negative is taken for zero).
pub fn square_root(c: &DMatrix<f64>) -> DMatrix<f64> {
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
