//! Least squares by QR: coefficients, standard deviations, condition number.
//!
//! The rows go by in blocks that fit the processor's first cache: each block is turned, by Householder reflections, into the
//! triangle of all rows before it. So the data are read once, nothing of their size is made beside them, and the accuracy is that
//! of a QR of the whole (normal equations would square the condition number).

use crate::error::BadInput;
use crate::numeric::stats::{sum_of_products, take_off};
use nalgebra::DMatrix;

/// Result of a least-squares fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Coefficients, in the units of the columns.
    pub coefficients: Vec<f64>,
    /// Their standard deviations for white residuals.
    pub std: Vec<f64>,
    /// Their covariance for white residuals, row by row.
    pub covariance: DMatrix<f64>,
    /// Condition number of the columns, each scaled to unit length.
    pub condition: f64,
    /// Rows that took part.
    pub rows: usize,
    /// Sum of their squared residuals, by their weights.
    pub squares: f64,
    /// Residual standard deviation, degrees of freedom taken off.
    pub sigma: f64,
}

/// Rows of a block.
const BLOCK: usize = 256;

/// The triangle `R` of a QR factorisation of rows `[x, y]`, and a block of rows that are not in it yet.
struct Triangle {
    /// Columns: the regressors, then y.
    width: usize,
    /// `R`, row by row.
    r: Vec<f64>,
    /// The block, column by column.
    block: Vec<f64>,
    /// Rows in the block, and in all.
    waiting: usize,
    rows: usize,
}

/// Turns `n` rows of a block into a triangle: one reflection a column, over that column of the triangle and of the block.
// Compiled for wider vectors, too, where there are any; the sums are the same ones.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn reflect(r: &mut [f64], block: &mut [f64], width: usize, n: usize) {
    for j in 0..width {
        let (left, right) = block.split_at_mut((j + 1) * BLOCK);
        let column = &left[j * BLOCK..j * BLOCK + n];
        let below = sum_of_products(column, column);
        if below == 0.0 {
            continue;
        }
        let corner = r[j * width + j];
        let length = (corner * corner + below).sqrt();
        let new = if corner > 0.0 { -length } else { length };
        let head = corner - new;
        let scale = 2.0 / (head * head + below);
        r[j * width + j] = new;
        for (k, other) in (j + 1..width).zip(right.chunks_exact_mut(BLOCK)) {
            let other = &mut other[..n];
            let above = &mut r[j * width + k];
            let part = scale * (head * *above + sum_of_products(column, other));
            *above -= part * head;
            take_off(other, part, column);
        }
    }
}

impl Triangle {
    fn new(regressors: usize) -> Self {
        let width = regressors + 1;
        Self { width, r: vec![0.0; width * width], block: vec![0.0; width * BLOCK], waiting: 0, rows: 0 }
    }

    /// Adds a row: the regressors, then y. One with a value that is not finite takes no part.
    fn push(&mut self, row: &[f64]) {
        if !row.iter().all(|v| v.is_finite()) {
            return;
        }
        if self.waiting == BLOCK {
            self.fold();
        }
        for (j, v) in row.iter().enumerate() {
            self.block[j * BLOCK + self.waiting] = *v;
        }
        self.waiting += 1;
    }

    /// Adds a block of rows, column by column, unless something is missing in it.
    fn push_whole<'a>(&mut self, columns: impl Iterator<Item = &'a [f64]>) -> bool {
        self.fold();
        for (to, from) in self.block.chunks_exact_mut(BLOCK).zip(columns) {
            to[..from.len()].copy_from_slice(from);
            self.waiting = from.len();
        }
        let (before, rows) = (self.r.clone(), self.rows);
        self.fold();
        // A missing value leaves nothing finite behind.
        let whole = self.r.iter().all(|v| v.is_finite());
        if !whole {
            (self.r, self.rows) = (before, rows);
        }
        whole
    }

    /// Turns the block into the triangle.
    fn fold(&mut self) {
        let n = std::mem::take(&mut self.waiting);
        self.rows += n;
        reflect(&mut self.r, &mut self.block, self.width, n);
    }

    fn solve(mut self, names: &[&str]) -> Result<Fit, BadInput> {
        self.fold();
        let (width, p, n) = (self.width, self.width - 1, self.rows);
        if n < p + 2 {
            return Err(BadInput::new(format!(
                "only {n} usable rows for {p} coefficients; record a longer run, or fill the missing values"
            )));
        }
        let at = |i: usize, j: usize| self.r[i * width + j];
        let scale: Vec<f64> = (0..p).map(|j| (0..=j).map(|i| at(i, j).powi(2)).sum::<f64>().sqrt()).collect();
        if let Some(j) = scale.iter().position(|s| *s <= 0.0) {
            return Err(BadInput::new(format!(
                "the regressor {} is zero throughout: the run never does what it stands for, or the thermometer reads in steps that are too coarse to show it",
                names.get(j).unwrap_or(&"?")
            )));
        }
        let r = DMatrix::from_fn(p, p, |i, j| if i <= j { at(i, j) / scale[j] } else { 0.0 });
        let sv = r.clone().singular_values();
        let condition = sv[0] / sv[p - 1].max(f64::MIN_POSITIVE);
        if !(condition < 1e10) {
            // Name the columns of the weakest direction.
            let svd = r.svd(false, true);
            let weakest = svd.v_t.map(|v| v.row(p - 1).iter().map(|x| x.abs()).collect::<Vec<_>>()).unwrap_or_default();
            let involved: Vec<&str> = weakest
                .iter()
                .enumerate()
                .filter(|(_, w)| **w > 0.3)
                .filter_map(|(j, _)| names.get(j).copied())
                .collect();
            return Err(BadInput::new(format!(
                "the run cannot tell {} apart (condition number {condition:.0e}); record soaks at more temperatures and ramps in both directions",
                involved.join(", ")
            )));
        }
        let singular = || BadInput::new("the equations are singular; record a longer run");
        let turned = nalgebra::DVector::from_fn(p, |i, _| at(i, p));
        let z = r.solve_upper_triangular(&turned).ok_or_else(singular)?;
        let inverse = r.try_inverse().ok_or_else(singular)?;
        let squares = at(p, p).powi(2);
        let sigma = (squares / (n - p) as f64).sqrt();
        let unscaled = DMatrix::from_fn(p, p, |i, j| sigma * inverse[(i, j)] / scale[i]);
        Ok(Fit {
            coefficients: z.iter().zip(&scale).map(|(z, s)| z / s).collect(),
            std: (0..p).map(|j| sigma * inverse.row(j).norm() / scale[j]).collect(),
            covariance: &unscaled * unscaled.transpose(),
            condition,
            rows: n,
            squares,
            sigma,
        })
    }
}

/// Fits `y = X b` where `columns[j][row]` are the columns of X. Rows with a weight of zero or a value that is not
/// finite take no part.
///
/// # Errors
/// Too few rows, or columns that the data cannot tell apart: the sentence names them by `names`.
pub fn fit(columns: &[Vec<f64>], y: &[f64], weights: Option<&[f64]>, names: &[&str]) -> Result<Fit, BadInput> {
    super::progress::step();
    let mut triangle = Triangle::new(columns.len());
    let mut row = vec![0.0; columns.len() + 1];
    for from in (0..y.len()).step_by(BLOCK) {
        let rows = from..(from + BLOCK).min(y.len());
        if weights.is_none() && triangle.push_whole(columns.iter().map(|c| &c[rows.clone()]).chain([&y[rows.clone()]]))
        {
            continue;
        }
        for k in rows {
            let weight = weights.map_or(1.0, |w| w[k]);
            if weight > 0.0 {
                for (to, value) in row.iter_mut().zip(columns.iter().map(|c| c[k]).chain([y[k]])) {
                    *to = value * weight.sqrt();
                }
                triangle.push(&row);
            }
        }
    }
    triangle.solve(names)
}

/// The same without columns: `row` fills in row `k` of `n`, `regressors` of them and then y, or says that it takes no part.
///
/// # Errors
/// As [`fit`].
pub fn fit_rows(
    n: usize,
    regressors: usize,
    names: &[&str],
    mut row: impl FnMut(usize, &mut [f64]) -> bool,
) -> Result<Fit, BadInput> {
    super::progress::step();
    let mut triangle = Triangle::new(regressors);
    let mut values = vec![0.0; regressors + 1];
    for k in 0..n {
        if row(k, &mut values) {
            triangle.push(&values);
        }
    }
    triangle.solve(names)
}

/// Values of a polynomial's columns `1, u, u^2 ... u^degree`.
#[must_use]
pub fn powers(u: &[f64], degree: usize) -> Vec<Vec<f64>> {
    (0..=degree).map(|d| u.iter().map(|x| x.powi(d as i32)).collect()).collect()
}

/// Least squares with shrinkage: coefficient `j` is taken as drawn from a normal distribution about zero with the variance
/// `prior[j]`, in units of the noise's variance; `None`: any value is as likely as any other. The covariance is that of the
/// coefficients after the data are seen.
///
/// # Errors
/// Data that cannot hold down the coefficients without a prior.
pub fn fit_shrunk(columns: &[Vec<f64>], y: &[f64], prior: &[Option<f64>], names: &[&str]) -> Result<Fit, BadInput> {
    super::progress::step();
    let p = columns.len();
    // A prior is a row of its own: the coefficient, seen as zero with the noise's deviation.
    let priors: Vec<(usize, f64)> =
        prior.iter().enumerate().filter_map(|(j, v)| v.map(|v| (j, 1.0 / v.max(1e-300).sqrt()))).collect();
    let mut triangle = Triangle::new(p);
    let mut row = vec![0.0; p + 1];
    let mut count = 0;
    for k in 0..y.len() {
        for (to, c) in row.iter_mut().zip(columns) {
            *to = c[k];
        }
        row[p] = y[k];
        count += usize::from(row.iter().all(|v| v.is_finite()));
        triangle.push(&row);
    }
    for (j, weight) in &priors {
        row.fill(0.0);
        row[*j] = *weight;
        triangle.push(&row);
    }
    let free = p - priors.len();
    if count < free + 2 {
        return Err(BadInput::new(format!(
            "only {count} usable rows for {free} coefficients; record a longer run, or fill the missing values"
        )));
    }
    // Each prior is a row and takes a coefficient: the degrees of freedom are those of the rows and the free coefficients.
    let mut fit = triangle.solve(names)?;
    fit.rows = count;
    Ok(fit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_and_states_its_uncertainty() {
        let u: Vec<f64> = (0..200).map(|k| f64::from(k) / 100.0 - 1.0).collect();
        let y: Vec<f64> =
            u.iter().enumerate().map(|(k, u)| 2.0 - 3.0 * u + 0.1 * ((k * 37 % 11) as f64 - 5.0)).collect();
        let f = fit(&powers(&u, 1), &y, None, &["1", "u"]).expect("fits");
        assert!((f.coefficients[0] - 2.0).abs() < 4.0 * f.std[0]);
        assert!((f.coefficients[1] + 3.0).abs() < 4.0 * f.std[1]);
        assert!(f.condition < 2.0);
    }

    #[test]
    fn blocks_give_what_the_whole_gives() {
        // Over several blocks, with rows left out, weights, and columns of a condition of thousands.
        let n = 3 * BLOCK + 77;
        let u: Vec<f64> = (0..n).map(|k| (k as f64 * 0.37).sin() + k as f64 / n as f64).collect();
        let mut columns = powers(&u, 5);
        columns[2][10] = f64::NAN;
        let y: Vec<f64> = (0..n).map(|k| u[k] - 0.3 * u[k].powi(4) + ((k * 7919 % 97) as f64 - 48.0) * 1e-2).collect();
        let weights: Vec<f64> = (0..n).map(|k| (k % 5) as f64).collect();
        let ours = fit(&columns, &y, Some(&weights), &[]).expect("fits");
        let rows: Vec<usize> = (0..n).filter(|k| *k != 10 && weights[*k] > 0.0).collect();
        let x = DMatrix::from_fn(rows.len(), 6, |i, j| columns[j][rows[i]] * weights[rows[i]].sqrt());
        let b = nalgebra::DVector::from_fn(rows.len(), |i, _| y[rows[i]] * weights[rows[i]].sqrt());
        let whole = x.clone().svd(true, true).solve(&b, 0.0).expect("solved");
        for j in 0..6 {
            assert!((ours.coefficients[j] - whole[j]).abs() < 1e-11 * whole.norm(), "{j}");
        }
        let squares = (&b - &x * &whole).norm_squared();
        assert!((ours.squares / squares - 1.0).abs() < 1e-12 && ours.rows == rows.len());
    }

    #[test]
    fn columns_that_cannot_be_separated_are_named() {
        let u: Vec<f64> = (0..50).map(f64::from).collect();
        let columns = vec![vec![1.0; 50], u.clone(), u.iter().map(|x| 2.0 * x).collect()];
        let e = fit(&columns, &u, None, &["one", "this", "that"]).expect_err("singular");
        assert!(e.0.contains("this, that"), "{e}");
        assert!(fit(&columns, &u[..3], None, &[]).expect_err("few").0.contains("usable rows"));
    }
}
