//! How the coefficients of a linear model are found where least squares is not all: outliers, swarms, the smallest range.

use super::form::{range, Data};
use super::{minimax, swarm};
use crate::numeric::lsq;
use crate::numeric::stats::median;
use crate::recording::steps::Run;
use crate::BadInput;
use hrg_core::bias::{Scaling, TERMS};
use nalgebra::{DMatrix, DVector};

/// Sum of squares of a linear model folded into normal equations: `yy - 2 k.b + k.A k`, whatever the number of rows.
pub(super) struct Folded {
    a: DMatrix<f64>,
    b: DVector<f64>,
    yy: f64,
}

impl Folded {
    pub(super) fn new(columns: &[Vec<f64>], y: &[f64]) -> Self {
        let p = columns.len();
        let (mut a, mut b, mut yy) = (DMatrix::zeros(p, p), DVector::zeros(p), 0.0);
        let mut row = vec![0.0; p];
        for k in 0..y.len() {
            row.iter_mut().zip(columns).for_each(|(r, c)| *r = c[k]);
            if !(y[k].is_finite() && row.iter().all(|x| x.is_finite())) {
                continue;
            }
            for i in 0..p {
                for j in 0..=i {
                    a[(i, j)] += row[i] * row[j];
                }
                b[i] += row[i] * y[k];
            }
            yy += y[k] * y[k];
        }
        for i in 0..p {
            for j in i + 1..p {
                a[(i, j)] = a[(j, i)];
            }
        }
        Self { a, b, yy }
    }

    pub(super) fn sum_of_squares(&self, k: &[f64]) -> f64 {
        let mut s = self.yy;
        for i in 0..k.len() {
            s -= 2.0 * k[i] * self.b[i];
            for j in 0..k.len() {
                s += k[i] * self.a[(i, j)] * k[j];
            }
        }
        s
    }
}

/// Huber's weights: residuals beyond 1.345 robust standard deviations count linearly.
const HUBER: f64 = 1.345;

pub(super) fn huber(d: &Data) -> Result<(lsq::Fit, f64), BadInput> {
    let mut weights = vec![1.0; d.y.len()];
    let mut fit = d.fit(None)?;
    let mut down = 0.0;
    for _ in 0..50 {
        let residuals = d.residuals(&fit.coefficients);
        let mut sizes: Vec<f64> = residuals.iter().filter(|e| e.is_finite()).map(|e| e.abs()).collect();
        // The median of |e| is 0.6745 standard deviations of a normal distribution.
        let limit = HUBER * median(&mut sizes).unwrap_or(0.0) / 0.6745;
        if !(limit > 0.0) {
            break;
        }
        for (w, e) in weights.iter_mut().zip(&residuals) {
            *w = if e.abs() <= limit || e.is_nan() { 1.0 } else { limit / e.abs() };
        }
        down = weights.iter().filter(|w| **w < 1.0).count() as f64 / weights.len() as f64;
        let next = d.fit(Some(&weights))?;
        let moved = next
            .coefficients
            .iter()
            .zip(&fit.coefficients)
            .zip(&next.std)
            .map(|((n, o), s)| (n - o).abs() / s.max(1e-300))
            .fold(0.0, f64::max);
        fit = next;
        if moved < 1e-4 {
            break;
        }
    }
    Ok((fit, down))
}

/// dong2023's swarm where it can work: columns made orthogonal and of unit length, so that the coordinates of the
/// solution are within the length of `y` about its mean (which the constant takes), and its box of -1..1 holds it once `y`
/// is scaled to less than length one. Gives the coefficients and by how much their sum of squares is above the least.
pub(super) fn orthogonal_swarm(d: &Data, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let exact = d.fit(None)?;
    let mean = crate::numeric::stats::mean(&d.y);
    let about: Vec<f64> = d.y.iter().map(|y| y - mean).collect();
    let folded = Folded::new(&d.columns, &about);
    let p = d.columns.len();
    // A quarter of room: at a wall a swarm sticks.
    let length = 1.25 * folded.yy.sqrt().max(f64::MIN_POSITIVE);
    let scale: Vec<f64> = (0..p).map(|j| folded.a[(j, j)].sqrt()).collect();
    let normal = DMatrix::from_fn(p, p, |i, j| folded.a[(i, j)] / (scale[i] * scale[j]));
    // A = L L^T: z = L^T (scale k) / |y| are the orthogonal coordinates.
    let lower = normal
        .cholesky()
        .ok_or_else(|| BadInput::new("the run cannot tell the coefficients apart; record ramps in both directions"))?
        .l();
    let target = lower
        .solve_lower_triangular(&DVector::from_fn(p, |j, _| folded.b[j] / (scale[j] * length)))
        .ok_or_else(|| BadInput::new("the normal equations are singular"))?;
    // In these coordinates the sum of squares is that of y, and -2 z.t + z.z times the square of the length.
    let found = swarm::minimise(&swarm::DONG, &vec![([-1.0, 1.0], 1.0); p], seed, |z| {
        -2.0 * z.iter().zip(&target).map(|(z, t)| z * t).sum::<f64>() + z.iter().map(|z| z * z).sum::<f64>()
    });
    let z = DVector::from_vec(found.position);
    let scaled = lower
        .transpose()
        .solve_upper_triangular(&(&z * length))
        .ok_or_else(|| BadInput::new("the normal equations are singular"))?;
    let mut k: Vec<f64> = scaled.iter().zip(&scale).map(|(k, s)| k / s).collect();
    k[0] += mean;
    let least = exact.squares;
    let above = (z - target).norm_squared() * length * length / least;
    Ok((k, above))
}

/// dong2023's swarm in its orthogonal coordinates, on columns of one's own: the coefficients, and by how much their sum of
/// squares is above the least.
///
/// # Errors
/// Where the columns cannot be told apart.
pub fn swarm_on(columns: Vec<Vec<f64>>, y: Vec<f64>, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let (lengths, names) = (vec![y.len()], vec!["column"; columns.len()]);
    orthogonal_swarm(&Data { columns, y, lengths, names }, seed)
}

/// dong2023's swarm as printed: coefficients of `1, T, T^2, dT/dt, (dT/dt)^2, T dT/dt` with T in C, each within -1..1.
pub(super) fn literal_swarm(
    runs: &[Run],
    scaling: &Scaling,
    d: &Data,
    a: usize,
    seed: u64,
) -> Result<(Vec<f64>, f64), BadInput> {
    let mut columns = vec![Vec::new(); TERMS];
    for run in runs {
        for k in 0..run.steps.len() {
            let (t, r) = run
                .bias_state(k, a)
                .map_or((f64::NAN, f64::NAN), |s| (f64::from(s.temperature_c), f64::from(s.ramp_c_per_min)));
            for (c, v) in columns.iter_mut().zip([1.0, t, t * t, r, r * r, t * r]) {
                c.push(if t.is_nan() { f64::NAN } else { v });
            }
        }
    }
    let folded = Folded::new(&columns, &d.y);
    let found = swarm::minimise(&swarm::DONG, &[([-1.0, 1.0], 1.0); TERMS], seed, |k| folded.sum_of_squares(k));
    let least = d.fit(None)?.squares;
    // The same model in the unit's centred terms.
    let (t0, s) = (f64::from(scaling.t_ref_c), f64::from(scaling.t_scale_c));
    let k = &found.position;
    let centred = vec![
        k[0] + k[1] * t0 + k[2] * t0 * t0,
        (k[1] + 2.0 * k[2] * t0) * s,
        k[2] * s * s,
        k[3] + k[5] * t0,
        k[4],
        k[5] * s,
    ];
    Ok((centred, found.value / least - 1.0))
}

pub(super) fn smallest_range(d: &Data) -> Result<(Vec<f64>, f64), BadInput> {
    let (rest, smallest) = minimax::fit(&d.columns[1..], &d.y)?;
    Ok((d.with_constant(&rest), smallest))
}

/// The swarm on the range, about the least-squares solution: coordinates are standard deviations of 100 s means over
/// the spread of each centred column, the box three of them either way.
pub(super) fn range_swarm(d: &Data, seed: u64) -> Result<Vec<f64>, BadInput> {
    let fit = d.fit(None)?;
    let centre = d.residuals(&fit.coefficients);
    let width = 3.0 * range(&centre);
    let columns: Vec<(Vec<f64>, f64)> =
        d.columns[1..].iter().map(|c| (c.clone(), width / range(c).max(1e-12))).collect();
    let mut work = vec![0.0; d.y.len()];
    let found = swarm::minimise(&swarm::DONG, &vec![([-1.0, 1.0], 1.0); columns.len()], seed, |z| {
        work.copy_from_slice(&centre);
        for ((c, s), z) in columns.iter().zip(z) {
            work.iter_mut().zip(c).for_each(|(w, c)| *w -= z * s * c);
        }
        let (low, high) = work.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), w| (l.min(*w), h.max(*w)));
        high - low
    });
    let rest: Vec<f64> =
        found.position.iter().zip(&columns).zip(&fit.coefficients[1..]).map(|((z, (_, s)), k)| k + z * s).collect();
    Ok(d.with_constant(&rest))
}
