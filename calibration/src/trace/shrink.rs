//! Evidence of models that are linear in their gains, with shrinkage.
//!
//! Groups of columns (the rungs of a ladder, the knots of a curve) have gains that are drawn, so the model says, from one normal
//! distribution each; its variance is found by maximum evidence. So ten gains of one family cost what they bring, and not ten
//! times a penalty. All is computed from inner products, once for each axis and noise model.

use super::data::AxisRows;
use super::gls::Colour;
use crate::stats::{sum_of_products, take_off};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use std::ops::Range;

/// Contiguous parts of the rows for cross-validation.
pub const FOLDS: usize = 6;

/// Inner products of one axis under one noise model, free of the baseline.
pub struct Gram {
    /// Of columns with columns.
    g: DMatrix<f64>,
    /// Of columns with the rates.
    b: DVector<f64>,
    /// Of the rates with themselves.
    yy: f64,
    /// Rows less baseline coefficients.
    n: f64,
    /// What belongs to the noise model alone.
    constant: f64,
    /// The same, of each fold.
    folds: Vec<(DMatrix<f64>, DVector<f64>, f64)>,
}

/// Inner products of columns by tiles: `a[i] . a[j]`.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn products(columns: &[Vec<f64>], rows: Range<usize>, out: &mut DMatrix<f64>) {
    for i in 0..columns.len() {
        for j in 0..=i {
            let d = sum_of_products(&columns[i][rows.clone()], &columns[j][rows.clone()]);
            out[(i, j)] = d;
            out[(j, i)] = d;
        }
    }
}

/// Takes an orthonormal basis out of a column.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn project(basis: &[Vec<f64>], x: &mut [f64]) {
    for _ in 0..2 {
        for q in basis {
            let d = sum_of_products(q, x);
            take_off(x, d, q);
        }
    }
}

/// A group in a model with the variance of its gains, in units of the noise's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    pub group: usize,
    pub variance: f64,
}

/// A model solved.
pub struct Solved {
    pub evidence: f64,
    /// Columns in the model.
    pub columns: Vec<usize>,
    /// Their gains.
    pub gains: DVector<f64>,
    /// Variance of the noise (whitened).
    pub noise: f64,
    /// Covariance of the gains.
    pub covariance: DMatrix<f64>,
}

impl Gram {
    /// From the rows of an axis and its columns (on the kept blocks, scaled).
    pub fn new(rows: &AxisRows, columns: &[Vec<f64>], colour: Colour) -> Self {
        let mut basis: Vec<Vec<f64>> = Vec::new();
        let mut information = 0.0;
        let norm = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
        for column in &rows.base {
            let mut c = column.clone();
            colour.whiten(&mut c, &rows.starts);
            let before = norm(&c);
            project(&basis, &mut c);
            let left = norm(&c);
            if left > 1e-10 * before {
                information += left.ln();
                let f = 1.0 / left.sqrt();
                c.iter_mut().for_each(|v| *v *= f);
                basis.push(c);
            }
        }
        let seen = |x: &[f64]| {
            let mut c = x.to_vec();
            colour.whiten(&mut c, &rows.starts);
            project(&basis, &mut c);
            c
        };
        let white: Vec<Vec<f64>> = columns.iter().map(|c| seen(c)).collect();
        let y = seen(&rows.y);
        let p = white.len();
        let n = y.len();
        let mut folds = Vec::new();
        let (mut g, mut b, mut yy) = (DMatrix::zeros(p, p), DVector::zeros(p), 0.0);
        for f in 0..FOLDS {
            let part = n * f / FOLDS..n * (f + 1) / FOLDS;
            let mut gf = DMatrix::zeros(p, p);
            products(&white, part.clone(), &mut gf);
            let bf = DVector::from_iterator(p, white.iter().map(|c| sum_of_products(&c[part.clone()], &y[part.clone()])));
            let yf = sum_of_products(&y[part.clone()], &y[part]);
            g += &gf;
            b += &bf;
            yy += yf;
            folds.push((gf, bf, yf));
        }
        let free = (n - basis.len()) as f64;
        let constant = colour.first_factor().ln() * rows.starts.len() as f64 - 0.5 * information;
        Self { g, b, yy, n: free, constant, folds }
    }

    fn expand(&self, model: &[Share], groups: &[Range<usize>]) -> (Vec<usize>, Vec<f64>) {
        let (mut columns, mut root) = (Vec::new(), Vec::new());
        for s in model {
            columns.extend(groups[s.group].clone());
            root.extend(std::iter::repeat_n(s.variance.sqrt(), groups[s.group].len()));
        }
        (columns, root)
    }

    /// `I + D^1/2 G D^1/2` factored, and `D^1/2 b`.
    fn factor(&self, columns: &[usize], root: &[f64]) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        let p = columns.len();
        let m = DMatrix::from_fn(p, p, |i, j| {
            root[i] * root[j] * self.g[(columns[i], columns[j])] + if i == j { 1.0 } else { 0.0 }
        });
        let c = DVector::from_fn(p, |i, _| root[i] * self.b[columns[i]]);
        Some((m.cholesky()?, c))
    }

    /// Log evidence of the baseline alone.
    pub fn nothing(&self) -> f64 {
        -0.5 * self.n * (self.yy / self.n).ln() + self.constant
    }

    /// Log evidence of a model with its variances as they are.
    pub fn evidence(&self, model: &[Share], groups: &[Range<usize>]) -> f64 {
        let (columns, root) = self.expand(model, groups);
        let Some((f, c)) = self.factor(&columns, &root) else { return f64::NEG_INFINITY };
        let rss = self.yy - c.dot(&f.solve(&c));
        -0.5 * (self.n * (rss / self.n).max(1e-300).ln() + log_determinant(&f)) + self.constant
    }

    /// Finds the variances of a model by fixed-point steps (MacKay 1992), each at most `most` times the noise's.
    pub fn optimise(&self, model: &mut [Share], groups: &[Range<usize>], most: f64, steps: usize) -> f64 {
        let mut last = f64::NEG_INFINITY;
        for step in 0..steps {
            let (columns, root) = self.expand(model, groups);
            let Some((f, c)) = self.factor(&columns, &root) else { return last };
            let z = f.solve(&c);
            let rss = self.yy - c.dot(&z);
            let noise = (rss / self.n).max(1e-300);
            let evidence = -0.5 * (self.n * noise.ln() + log_determinant(&f)) + self.constant;
            if step > 2 && evidence < last + 0.02 {
                return evidence.max(last);
            }
            last = evidence;
            let inverse = f.inverse();
            let mut at = 0;
            for s in model.iter_mut() {
                let own = at..at + groups[s.group].len();
                at = own.end;
                let determined: f64 = own.clone().map(|k| 1.0 - inverse[(k, k)]).sum();
                let squares: f64 = own.map(|k| (root[k] * z[k]).powi(2)).sum();
                let next = squares / noise / determined.max(1e-9);
                // MacKay's step is slow near its end: go half as far again.
                let ratio = (next / s.variance).clamp(0.02, 50.0).powf(1.5);
                s.variance = (s.variance * ratio).clamp(1e-10, most);
            }
        }
        self.evidence(model, groups)
    }

    /// Gains of a model.
    pub fn solve(&self, model: &[Share], groups: &[Range<usize>]) -> Option<Solved> {
        let (columns, root) = self.expand(model, groups);
        let (f, c) = self.factor(&columns, &root)?;
        let z = f.solve(&c);
        let noise = ((self.yy - c.dot(&z)) / self.n).max(1e-300);
        let inverse = f.inverse();
        let p = columns.len();
        Some(Solved {
            evidence: -0.5 * (self.n * noise.ln() + log_determinant(&f)) + self.constant,
            gains: DVector::from_fn(p, |i, _| root[i] * z[i]),
            covariance: DMatrix::from_fn(p, p, |i, j| noise * root[i] * root[j] * inverse[(i, j)]),
            noise,
            columns,
        })
    }

    /// Error of rows that a model did not see, as a log likelihood: each fold predicted from the others.
    pub fn cross_validated(&self, model: &[Share], groups: &[Range<usize>]) -> f64 {
        let (columns, root) = self.expand(model, groups);
        let p = columns.len();
        let mut error = 0.0;
        for (gf, bf, yf) in &self.folds {
            if p == 0 {
                error += yf;
                continue;
            }
            let m = DMatrix::from_fn(p, p, |i, j| {
                let (a, b) = (columns[i], columns[j]);
                root[i] * root[j] * (self.g[(a, b)] - gf[(a, b)]) + if i == j { 1.0 } else { 0.0 }
            });
            let c = DVector::from_fn(p, |i, _| root[i] * (self.b[columns[i]] - bf[columns[i]]));
            let Some(f) = m.cholesky() else { return f64::NEG_INFINITY };
            let z = f.solve(&c);
            let w: Vec<f64> = (0..p).map(|i| root[i] * z[i]).collect();
            let mut e = *yf;
            for i in 0..p {
                e -= 2.0 * w[i] * bf[columns[i]];
                for j in 0..p {
                    e += w[i] * w[j] * gf[(columns[i], columns[j])];
                }
            }
            error += e.max(0.0);
        }
        -0.5 * self.n * (error / self.n).max(1e-300).ln() + self.constant
    }

    /// What a group adds to a model's evidence, and with which variance: the model's own variances stay.
    pub fn extension(&self, base: &Base, group: &Range<usize>, most: f64) -> (f64, f64) {
        let m = group.len();
        let p = base.columns.len();
        let mut g = DMatrix::from_fn(m, m, |i, j| self.g[(group.start + i, group.start + j)]);
        let mut b = DVector::from_fn(m, |i, _| self.b[group.start + i]);
        if p > 0 {
            // Free of what the model explains: the Schur complement.
            let cross = DMatrix::from_fn(p, m, |i, j| base.root[i] * self.g[(base.columns[i], group.start + j)]);
            let Some(f) = &base.factor else { return (f64::NEG_INFINITY, 0.0) };
            let half = f.l_dirty().solve_lower_triangular(&cross);
            let Some(half) = half else { return (f64::NEG_INFINITY, 0.0) };
            g -= half.transpose() * &half;
            b -= half.transpose() * &base.half;
        }
        let (values, c): (Vec<f64>, Vec<f64>) = if m == 1 {
            (vec![g[(0, 0)].max(0.0)], vec![b[0]])
        } else {
            let e = SymmetricEigen::new(g);
            let c = e.eigenvectors.transpose() * b;
            (e.eigenvalues.iter().map(|v| v.max(0.0)).collect(), c.iter().copied().collect())
        };
        let gain = |variance: f64| {
            let (mut determinant, mut explained) = (0.0, 0.0);
            for (d, c) in values.iter().zip(&c) {
                determinant += (variance * d).ln_1p();
                explained += variance * c * c / (1.0 + variance * d);
            }
            -0.5 * (determinant + self.n * (1.0 - explained / base.rss).max(1e-12).ln())
        };
        // Over eight decades below the most that is allowed.
        let (mut best, mut at) = (f64::NEG_INFINITY, 0.0);
        let mut step = 2.0f64;
        for k in 0..27 {
            let x = most.ln() - 0.7 * f64::from(k);
            let v = gain(x.exp());
            if v > best {
                (best, at) = (v, x);
            }
        }
        step *= 0.2;
        for _ in 0..3 {
            for x in [at - step, (at + step).min(most.ln())] {
                let v = gain(x.exp());
                if v > best {
                    (best, at) = (v, x);
                }
            }
            step *= 0.5;
        }
        (best, at.exp())
    }

    /// A model ready to be extended.
    pub fn base(&self, model: &[Share], groups: &[Range<usize>]) -> Base {
        let (columns, root) = self.expand(model, groups);
        let solved = self.factor(&columns, &root);
        let Some((f, c)) = solved.filter(|_| !columns.is_empty()) else {
            return Base { columns: vec![], root: vec![], factor: None, half: DVector::zeros(0), rss: self.yy, evidence: self.nothing() };
        };
        let half = f.l_dirty().solve_lower_triangular(&c).unwrap_or_else(|| DVector::zeros(c.len()));
        let rss = self.yy - half.dot(&half);
        let evidence = -0.5 * (self.n * (rss / self.n).max(1e-300).ln() + log_determinant(&f)) + self.constant;
        Base { columns, root, factor: Some(f), half, rss, evidence }
    }

    /// Variance of the noise under a model.
    pub fn noise(&self, base: &Base) -> f64 {
        base.rss / self.n
    }
}

/// See [`Gram::base`].
pub struct Base {
    columns: Vec<usize>,
    root: Vec<f64>,
    factor: Option<Cholesky<f64, Dyn>>,
    half: DVector<f64>,
    rss: f64,
    /// Log evidence of the model.
    pub evidence: f64,
}

fn log_determinant(f: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * f.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
}
