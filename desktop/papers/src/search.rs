//! Searches for the coefficients of a linear model beyond least squares: outliers, swarms, the smallest range.

use crate::form::{range, Data};
use crate::history::History;
use crate::stages::Stage;
use crate::{minimax, stages, swarm};
use hrg_core::bias::{Scaling, TERMS};
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::median;
use hrg_data::recording::steps::Run;
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

/// Result of a swarm, in the coefficients of the model.
pub(super) struct Searched {
    pub(super) k: Vec<f64>,
    /// By how much the objective is above the least there is, as a share.
    pub(super) above: f64,
    /// The objective after each iteration.
    pub(super) objective: Vec<f64>,
    /// The best coefficients after each iteration.
    pub(super) path: Vec<Vec<f64>>,
}

impl Searched {
    /// Course of the search.
    pub(super) fn history(&self, of: String, objective_name: &'static str, names: &[&'static str]) -> History {
        let (objective, coefficients) = (self.objective.clone(), self.path.clone());
        History { of, objective_name, objective, names: names.to_vec(), coefficients }
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
pub(super) fn orthogonal_swarm(d: &Data, seed: u64) -> Result<Searched, BadInput> {
    let exact = d.fit(None)?;
    let mean = hrg_data::numeric::stats::mean(&d.y);
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
    let upper = lower.transpose();
    let coefficients = |z: &[f64]| -> Result<Vec<f64>, BadInput> {
        let scaled = upper
            .solve_upper_triangular(&(DVector::from_column_slice(z) * length))
            .ok_or_else(|| BadInput::new("the normal equations are singular"))?;
        let mut k: Vec<f64> = scaled.iter().zip(&scale).map(|(k, s)| k / s).collect();
        k[0] += mean;
        Ok(k)
    };
    let least = exact.squares;
    // The sum of squares is the least one and the square of the distance to its place.
    let distance = |z: &[f64]| z.iter().zip(target.iter()).map(|(z, t)| (z - t).powi(2)).sum::<f64>() * length * length;
    let rms = |squares: f64| (squares / exact.rows as f64).sqrt();
    Ok(Searched {
        k: coefficients(&found.position)?,
        above: distance(&found.position) / least,
        objective: found.path.iter().map(|z| rms(least + distance(z))).collect(),
        path: found.path.iter().map(|z| coefficients(z)).collect::<Result<_, _>>()?,
    })
}

/// dong2023's swarm in its orthogonal coordinates, on columns of one's own: the coefficients, and by how much their sum of
/// squares is above the least.
///
/// # Errors
/// If the columns are linearly dependent.
pub fn swarm_on(columns: Vec<Vec<f64>>, y: Vec<f64>, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let (lengths, names) = (vec![y.len()], vec!["column"; columns.len()]);
    let found = orthogonal_swarm(&Data { columns, y, lengths, names }, seed)?;
    Ok((found.k, found.above))
}

/// Units in which dong2023's box of -1..1 may be meant: its Table 3 prints none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LiteralUnits {
    /// Rates of this unit in a deg/h.
    rate: f64,
    /// Ramps of this unit in a C per minute.
    ramp: f64,
}

impl LiteralUnits {
    /// deg/s and C/s: with them the coefficients of a unit that eq 7 describes lie in -1..1, as those of Table 3 do.
    pub(super) const SECONDS: Self = Self { rate: 1.0 / 3600.0, ramp: 1.0 / 60.0 };
    /// deg/s and C per 10 ms: with them Table 3's coefficients leave 9.0 and 7.4 deg/h over the paper's profile, where its Table 4 has 7.07 and 9.51;
    /// with C/s they leave 552 and 524.
    pub(super) const SAMPLES: Self = Self { rate: 1.0 / 3600.0, ramp: 1.0 / 6000.0 };

    /// Factors that convert the coefficients of eq 7 from deg/h and C per minute to these units.
    fn factors(self) -> [f64; TERMS] {
        let (y, r) = (self.rate, self.ramp);
        [y, y, y, y / r, y / (r * r), y / r]
    }
}

/// Result of dong2023's swarm as printed.
pub(super) struct LiteralSearched {
    /// In the unit's centred terms.
    pub(super) found: Searched,
    /// The largest coefficient of the least-squares solution in the units of the box: up to 1 the box holds it.
    pub(super) largest: f64,
    /// Condition number of the regressors in those units.
    pub(super) condition: f64,
}

/// Regressors of eq 7 as printed, `1, T, T^2, dT/dt, (dT/dt)^2, T dT/dt` with T in C, on the steps of one stage.
pub(super) fn printed_columns(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    stage: Stage,
    units: LiteralUnits,
) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::new(); TERMS];
    for run in runs {
        for (k, of) in stages::of_run(run, scaling, a).into_iter().enumerate() {
            let Some(s) = run.bias_state(k, a).filter(|_| of == Some(stage)) else { continue };
            let (t, r) = (f64::from(s.temperature_c), units.ramp * f64::from(s.ramp_c_per_min));
            for (c, v) in columns.iter_mut().zip([1.0, t, t * t, r, r * r, t * r]) {
                c.push(v);
            }
        }
    }
    columns
}

/// dong2023's swarm as printed, on the data of one stage: coefficients of [`printed_columns`], each within -1..1.
pub(super) fn literal_swarm(
    columns: &[Vec<f64>],
    scaling: &Scaling,
    d: &Data,
    seed: u64,
    units: LiteralUnits,
) -> Result<LiteralSearched, BadInput> {
    let y: Vec<f64> = d.y.iter().map(|y| units.rate * y).collect();
    let folded = Folded::new(columns, &y);
    let found = swarm::minimise(&swarm::DONG, &[([-1.0, 1.0], 1.0); TERMS], seed, |k| folded.sum_of_squares(k));
    let exact = d.fit(None)?;
    let (t0, s) = (f64::from(scaling.t_ref_c), f64::from(scaling.t_scale_c));
    let factors = units.factors();
    // The same model in the unit's centred terms, and back.
    let centred = |k: &[f64]| {
        let k: Vec<f64> = k.iter().zip(factors).map(|(k, f)| k / f).collect();
        vec![
            k[0] + k[1] * t0 + k[2] * t0 * t0,
            (k[1] + 2.0 * k[2] * t0) * s,
            k[2] * s * s,
            k[3] + k[5] * t0,
            k[4],
            k[5] * s,
        ]
    };
    let c = &exact.coefficients;
    let printed = [
        c[0] - c[1] * t0 / s + c[2] * t0 * t0 / (s * s),
        c[1] / s - 2.0 * c[2] * t0 / (s * s),
        c[2] / (s * s),
        c[3] - c[5] * t0 / s,
        c[4],
        c[5] / s,
    ];
    let largest = printed.iter().zip(factors).map(|(k, f)| (k * f).abs()).fold(0.0, f64::max);
    let squares = |value: f64| value / (units.rate * units.rate);
    let values = folded.a.clone().symmetric_eigenvalues();
    Ok(LiteralSearched {
        found: Searched {
            k: centred(&found.position),
            above: squares(found.value) / exact.squares - 1.0,
            objective: found.history.iter().map(|v| (squares(*v).max(0.0) / exact.rows as f64).sqrt()).collect(),
            path: found.path.iter().map(|k| centred(k)).collect(),
        },
        largest,
        condition: (values.max() / values.min().max(f64::MIN_POSITIVE)).sqrt(),
    })
}

pub(super) fn smallest_range(d: &Data) -> Result<(Vec<f64>, f64), BadInput> {
    let (rest, smallest) = minimax::fit(&d.columns[1..], &d.y)?;
    Ok((d.with_constant(&rest), smallest))
}

/// The swarm on the range, about the least-squares solution: coordinates are standard deviations of 100 s means over
/// the spread of each centred column, the box three of them either way.
pub(super) fn range_swarm(d: &Data, seed: u64) -> Result<Searched, BadInput> {
    let smallest = smallest_range(d)?.1;
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
    let coefficients = |z: &[f64]| {
        let both = z.iter().zip(&columns).zip(&fit.coefficients[1..]);
        d.with_constant(&both.map(|((z, (_, s)), k)| k + z * s).collect::<Vec<f64>>())
    };
    Ok(Searched {
        k: coefficients(&found.position),
        above: (found.value / smallest - 1.0).max(0.0),
        path: found.path.iter().map(|z| coefficients(z)).collect(),
        objective: found.history,
    })
}
