//! Evidence of models that are linear in their gains, with shrinkage.
//!
//! Columns come in groups (the rungs of a ladder, the knots of a curve). The gains of a group are taken as drawn from one normal
//! distribution; its variance is the one of the highest evidence (MacKay 1992). So ten gains of one family cost what they bring,
//! and not ten times a penalty. The evidence is restricted: it does not depend on the baseline's coefficients (Patterson and
//! Thompson 1971), so slow noise is not underestimated. All is computed from inner products of whitened columns.

use super::data::AxisRows;
use super::model::TEMPERATURE_TERMS;
use super::noise::{Basis, NOISE_MODELS};
use crate::matrices::{log_determinant, symmetric};
use hrg_core::bias::TERMS;
use hrg_data::numeric::stats::{dot, log_sum, std_dev};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

/// The group of the baseline's ramp terms: every model has it, with a variance of its own, so that a unit without them is not charged for
/// them.
pub const RAMP: usize = 0;
/// Contiguous parts of the rows for cross-validation.
const FOLDS: usize = 6;
/// A gain may move the rates by as many deviations of what the baseline leaves: a prior that keeps two large gains of opposite sign
/// from standing for one small effect.
const LARGEST_GAIN: f64 = 3.0;
/// Steps towards the variances of highest evidence.
const STEPS: usize = 12;

/// A group of a model, with the variance of its gains in units of the noise's variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Index of the group.
    pub group: usize,
    /// Variance of its gains (of columns of unit deviation) over that of the noise.
    pub variance: f64,
}

/// One axis under one noise model: columns whitened and free of the baseline.
#[derive(Debug)]
struct View {
    /// Number of the noise model.
    noise_model: usize,
    base: Basis,
    y: Vec<f64>,
    /// Sum of squares of the rates.
    squares: f64,
    /// Rows less coefficients of the baseline.
    free: f64,
    /// Part of the log-likelihood that belongs to the noise model alone.
    constant: f64,
    columns: Vec<Vec<f64>>,
    /// Products with the rates.
    b: Vec<f64>,
    /// Products of a column with every other, as far as they are known.
    products: Vec<Vec<f64>>,
    /// Products of the columns of each group with each other.
    own: Vec<DMatrix<f64>>,
}

impl View {
    fn new(rows: &AxisRows, noise_model: usize) -> Self {
        let mut base = Basis::default();
        let mut information = 0.0;
        for column in rows.base[..TEMPERATURE_TERMS].iter().chain(&rows.base[TERMS..]) {
            let length = base.add_measured(rows.filters.whitened(noise_model, column));
            if length > 0.0 {
                information += length.ln();
            }
        }
        let mut y = rows.filters.whitened(noise_model, &rows.y);
        base.reduce(&mut y);
        let free = y.len().saturating_sub(base.columns.len()).max(1) as f64;
        let constant = rows.filters.log_determinant(noise_model) - 0.5 * information;
        let squares = dot(&y, &y);
        Self {
            noise_model,
            base,
            y,
            squares,
            free,
            constant,
            columns: vec![],
            b: vec![],
            products: vec![],
            own: vec![],
        }
    }

    /// A column whitened and free of the baseline.
    fn free_of_baseline(&self, rows: &AxisRows, mut c: Vec<f64>) -> Vec<f64> {
        rows.filters.whiten(self.noise_model, &mut c);
        self.take_off_baseline(&mut c);
        c
    }

    fn take_off_baseline(&self, c: &mut [f64]) {
        let before = dot(c, c);
        self.base.reduce(c);
        if dot(c, c) < 1e-9 * before {
            c.fill(0.0);
        }
    }

    /// Adds a whitened column.
    fn push(&mut self, mut c: Vec<f64>) {
        self.take_off_baseline(&mut c);
        self.b.push(dot(&c, &self.y));
        self.columns.push(c);
        self.products.push(Vec::new());
    }

    /// Product of two columns.
    fn product(&self, i: usize, j: usize) -> f64 {
        let known = |i: usize, j: usize| self.products[i].get(j).copied();
        known(i, j).or_else(|| known(j, i)).unwrap_or_else(|| dot(&self.columns[i], &self.columns[j]))
    }

    /// Makes the products of these columns with all others known.
    fn know(&mut self, columns: &[usize]) {
        for &i in columns {
            let from = self.products[i].len();
            let more: Vec<f64> = self.columns[from..].iter().map(|c| dot(c, &self.columns[i])).collect();
            self.products[i].extend(more);
        }
    }
}

/// A model of one axis under one noise model, ready to be extended.
struct Base {
    /// `L^-1 D^1/2 G`, for every column.
    half: DMatrix<f64>,
    /// `L^-1 D^1/2 b`.
    rates: DVector<f64>,
    left: f64,
    evidence: f64,
}

/// Gain in evidence by a group at its best variance.
#[derive(Debug, Clone, Copy)]
pub struct Extension {
    /// Evidence of the extended model.
    pub evidence: f64,
    /// Variance of the group's gains.
    pub variance: f64,
}

/// A model of one axis with its variances.
#[derive(Debug, Clone)]
pub struct AxisModel {
    /// Its groups.
    pub shares: Vec<Share>,
    /// Log evidence, the mean over all noise models.
    pub evidence: f64,
    /// Index of the best noise model in [`NOISE_MODELS`].
    pub noise_model: usize,
}

/// All that is known of one axis.
pub struct Axis<'d> {
    rows: &'d AxisRows,
    views: Vec<View>,
    /// Columns of each group; `None` where the axis does not have what the group needs.
    groups: Vec<Option<Vec<usize>>>,
    /// Deviation of each column before it was scaled.
    pub scale: Vec<f64>,
    /// Variance of what the baseline leaves, (deg/h)^2.
    limit: f64,
}

impl<'d> Axis<'d> {
    /// Of the rows of an axis, with one group: the ramp terms of the baseline ([`RAMP`]).
    pub fn new(rows: &'d AxisRows) -> Self {
        let views: Vec<View> = (0..NOISE_MODELS.len()).map(|s| View::new(rows, s)).collect();
        let limit = views[0].squares / views[0].free;
        let mut axis = Self { rows, views, groups: vec![], scale: vec![], limit };
        axis.push(Some(rows.base[TEMPERATURE_TERMS..TERMS].to_vec()));
        axis
    }

    /// The baseline: its ramp terms with the variance of highest evidence.
    pub fn baseline_model(&self) -> AxisModel {
        self.best(&[Share { group: RAMP, variance: 1.0 }])
    }

    /// Adds a group of new columns; `None` where it is missing.
    pub fn push(&mut self, columns: Option<Vec<Vec<f64>>>) {
        let group = columns.map(|c| self.add_columns(c));
        self.push_group(group);
    }

    /// Adds columns that no group has yet; gives their numbers.
    pub fn add_columns(&mut self, columns: Vec<Vec<f64>>) -> Vec<usize> {
        let from = self.scale.len();
        for mut c in columns {
            self.scale.push(to_unit_deviation(&mut c));
            for (v, c) in self.views.iter_mut().zip(self.rows.filters.whiten_by_all(&c)) {
                v.push(c);
            }
        }
        (from..self.scale.len()).collect()
    }

    /// Adds a group of columns that are there; `None` where it is missing.
    pub fn push_group(&mut self, group: Option<Vec<usize>>) {
        for v in &mut self.views {
            let x = group.as_deref().unwrap_or_default();
            v.own.push(symmetric(x.len(), |i, j| dot(&v.columns[x[i]], &v.columns[x[j]])));
        }
        self.groups.push(group);
    }

    /// Takes back all groups from number `count` on.
    pub fn truncate(&mut self, count: usize) {
        for v in &mut self.views {
            v.own.truncate(count);
        }
        self.groups.truncate(count);
        let columns = self.groups.iter().flatten().flatten().max().map_or(0, |k| k + 1);
        self.scale.truncate(columns);
        for v in &mut self.views {
            v.columns.truncate(columns);
            v.b.truncate(columns);
            v.products.truncate(columns);
            v.products.iter_mut().for_each(|p| p.truncate(columns));
        }
    }

    /// Columns of a group.
    pub fn columns_of(&self, group: usize) -> Option<&[usize]> {
        self.groups[group].as_deref()
    }

    fn expand(&self, shares: &[Share]) -> (Vec<usize>, Vec<f64>) {
        let (mut columns, mut root) = (Vec::new(), Vec::new());
        for s in shares {
            let own = self.columns_of(s.group).unwrap_or_default();
            root.extend(std::iter::repeat_n(s.variance.sqrt(), own.len()));
            columns.extend_from_slice(own);
        }
        (columns, root)
    }

    /// `I + D^1/2 G D^1/2` factored, and `D^1/2 b`.
    fn factor(&self, s: usize, columns: &[usize], root: &[f64]) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        let v = &self.views[s];
        let p = columns.len();
        let unit = |i: usize, j: usize| f64::from(u8::from(i == j));
        let m = symmetric(p, |i, j| root[i] * root[j] * v.product(columns[i], columns[j]) + unit(i, j));
        let c = DVector::from_fn(p, |i, _| root[i] * v.b[columns[i]]);
        Some((m.cholesky()?, c))
    }

    fn of(&self, s: usize, left: f64, determinant: f64) -> f64 {
        let v = &self.views[s];
        -0.5 * (v.free * (left / v.free).max(1e-300).ln() + determinant) + v.constant
    }

    /// Finds the variances of highest evidence under one noise model, by fixed-point steps.
    fn optimise(&self, s: usize, shares: &mut [Share]) -> f64 {
        if shares.is_empty() {
            return self.of(s, self.views[s].squares, 0.0);
        }
        let mut last = f64::NEG_INFINITY;
        for step in 0..STEPS {
            let (columns, root) = self.expand(shares);
            let Some((f, c)) = self.factor(s, &columns, &root) else { return last };
            let z = f.solve(&c);
            let left = self.views[s].squares - c.dot(&z);
            let evidence = self.of(s, left, log_determinant(&f));
            if step > 2 && evidence < last + 0.02 {
                return evidence.max(last);
            }
            last = evidence;
            let noise = (left / self.views[s].free).max(1e-300);
            let most = self.most(noise);
            let inverse = f.inverse();
            let mut at = 0;
            for share in shares.iter_mut() {
                let own = at..at + self.groups[share.group].as_ref().map_or(0, Vec::len);
                at = own.end;
                let determined: f64 = own.clone().map(|k| 1.0 - inverse[(k, k)]).sum();
                let squares: f64 = own.map(|k| (root[k] * z[k]).powi(2)).sum();
                // The plain step is slow near its end: half as far again.
                let ratio = (squares / noise / determined.max(1e-9) / share.variance).clamp(0.02, 50.0).powf(1.5);
                share.variance = (share.variance * ratio).clamp(1e-10, most);
            }
        }
        last
    }

    fn most(&self, noise: f64) -> f64 {
        (LARGEST_GAIN * LARGEST_GAIN * self.limit / noise.max(1e-300)).max(1e-9)
    }

    /// A model with the variances of highest evidence under its best noise model, from variances to start with. Its evidence is the mean
    /// over all noise models by their probabilities before the data are seen.
    pub fn best(&self, shares: &[Share]) -> AxisModel {
        let mut own = shares.to_vec();
        let (mut each, mut best) = self.under_each(&own);
        for _ in 0..3 {
            self.optimise(best, &mut own);
            let (now, next) = self.under_each(&own);
            each = now;
            if next == best {
                break;
            }
            best = next;
        }
        AxisModel { shares: own, evidence: mean_evidence(&each), noise_model: best }
    }

    /// Log evidence under each noise model, variances as they are, and the number of the best.
    fn under_each(&self, shares: &[Share]) -> ([f64; NOISE_MODELS.len()], usize) {
        let each = std::array::from_fn(|s| self.evidence(s, shares));
        let best = (0..each.len()).max_by(|x: &usize, y| each[*x].total_cmp(&each[*y])).unwrap_or(0);
        (each, best)
    }

    fn base(&mut self, s: usize, shares: &[Share]) -> Option<Base> {
        let (columns, root) = self.expand(shares);
        self.views[s].know(&columns);
        let (f, c) = self.factor(s, &columns, &root)?;
        let v = &self.views[s];
        let (p, all) = (columns.len(), v.columns.len());
        let mut half = DMatrix::from_fn(p, all, |i, j| root[i] * v.products[columns[i]][j]);
        f.l_dirty().solve_lower_triangular_mut(&mut half);
        let rates = f.l_dirty().solve_lower_triangular(&c)?;
        let left = v.squares - rates.dot(&rates);
        let evidence = self.of(s, left, log_determinant(&f));
        Some(Base { half, rates, left, evidence })
    }

    /// Evidence of the model with each offered group added: the model's own variances stay. `None` for a group that the axis does not have.
    pub fn extensions(&mut self, model: &AxisModel, offered: &[bool]) -> Vec<Option<Extension>> {
        // Of each group: its evidence under each noise model, and the best of them with its variance.
        let mut each = vec![([f64::NEG_INFINITY; NOISE_MODELS.len()], f64::NEG_INFINITY, 0.0); self.groups.len()];
        for s in 0..NOISE_MODELS.len() {
            let Some(base) = self.base(s, &model.shares) else { continue };
            let most = self.most(base.left / self.views[s].free);
            for (k, (each, best, at)) in each.iter_mut().enumerate() {
                let Some(group) = self.groups[k].as_ref().filter(|_| offered[k]) else { continue };
                let (values, along) = self.spectrum(s, &base, k, group);
                let (gain, variance) = best_gain(&values, &along, self.views[s].free, base.left, most);
                each[s] = base.evidence + gain;
                if each[s] > *best {
                    (*best, *at) = (each[s], variance);
                }
            }
        }
        let extension = |(each, best, variance): ([f64; NOISE_MODELS.len()], f64, f64)| {
            (best > f64::NEG_INFINITY).then(|| Extension { evidence: mean_evidence(&each), variance })
        };
        each.into_iter().map(extension).collect()
    }

    /// A group free of what the model explains, along its principal directions: their squares, and their products with the rates.
    fn spectrum(&self, s: usize, base: &Base, number: usize, group: &[usize]) -> (Vec<f64>, Vec<f64>) {
        let v = &self.views[s];
        let m = group.len();
        let half = |i: usize| base.half.column(group[i]);
        let g = symmetric(m, |i, j| v.own[number][(i, j)] - half(i).dot(&half(j)));
        let b = DVector::from_fn(m, |i, _| v.b[group[i]] - half(i).dot(&base.rates));
        if m == 1 {
            return (vec![g[(0, 0)].max(0.0)], vec![b[0]]);
        }
        let e = SymmetricEigen::new(g);
        let along = e.eigenvectors.transpose() * b;
        (e.eigenvalues.iter().map(|v| v.max(0.0)).collect(), along.iter().copied().collect())
    }

    /// Log likelihood of rows that a model did not see: each sixth of the rows predicted from the others.
    pub fn cross_validated(&self, model: &AxisModel) -> f64 {
        let (columns, root) = self.expand(&model.shares);
        let v = &self.views[model.noise_model];
        let (p, n) = (columns.len(), v.y.len());
        let mut error = 0.0;
        let whole = symmetric(p, |i, j| dot(&v.columns[columns[i]], &v.columns[columns[j]]));
        for f in 0..FOLDS {
            let part = n * f / FOLDS..n * (f + 1) / FOLDS;
            let y = &v.y[part.clone()];
            let x: Vec<&[f64]> = columns.iter().map(|c| &v.columns[*c][part.clone()]).collect();
            let b: Vec<f64> = x.iter().map(|c| dot(c, y)).collect();
            let m = symmetric(p, |i, j| {
                root[i] * root[j] * (whole[(i, j)] - dot(x[i], x[j])) + f64::from(u8::from(i == j))
            });
            let c = DVector::from_fn(p, |i, _| root[i] * (v.b[columns[i]] - b[i]));
            let Some(f) = m.cholesky() else { return f64::NEG_INFINITY };
            let z = f.solve(&c);
            let predicted = |k: usize| (0..p).map(|i| root[i] * z[i] * x[i][k]).sum::<f64>();
            error += y.iter().enumerate().map(|(k, y)| (y - predicted(k)).powi(2)).sum::<f64>();
        }
        self.of(model.noise_model, error, 0.0)
    }

    /// Log evidence of a model with its variances as they are, under one noise model.
    pub fn evidence(&self, noise_model: usize, shares: &[Share]) -> f64 {
        let (columns, root) = self.expand(shares);
        let Some((f, c)) = self.factor(noise_model, &columns, &root) else { return f64::NEG_INFINITY };
        let left = self.views[noise_model].squares - c.dot(&f.solve(&c));
        self.of(noise_model, left, log_determinant(&f))
    }

    /// Evidence of a model with other columns in the place of one of its groups: variances and noise model stay.
    pub fn evidence_with(&self, model: &AxisModel, group: usize, columns: Vec<Vec<f64>>) -> f64 {
        let v = &self.views[model.noise_model];
        let fresh: Vec<Vec<f64>> = columns
            .into_iter()
            .map(|mut c| {
                to_unit_deviation(&mut c);
                v.free_of_baseline(self.rows, c)
            })
            .collect();
        let others: Vec<Share> = model.shares.iter().filter(|s| s.group != group).copied().collect();
        let own = model.shares.iter().find(|s| s.group == group).map_or(0.0, |s| s.variance.sqrt());
        let (known, mut root) = self.expand(&others);
        root.extend(std::iter::repeat_n(own, fresh.len()));
        let (p, n) = (known.len(), root.len());
        let product = |i: usize, j: usize| match (i < p, j < p) {
            (true, true) => v.product(known[i], known[j]),
            (true, false) => dot(&v.columns[known[i]], &fresh[j - p]),
            (false, true) => dot(&fresh[i - p], &v.columns[known[j]]),
            (false, false) => dot(&fresh[i - p], &fresh[j - p]),
        };
        let m = symmetric(n, |i, j| root[i] * root[j] * product(i, j) + f64::from(u8::from(i == j)));
        let c = DVector::from_fn(n, |i, _| root[i] * if i < p { v.b[known[i]] } else { dot(&fresh[i - p], &v.y) });
        let Some(f) = m.cholesky() else { return f64::NEG_INFINITY };
        self.of(model.noise_model, v.squares - c.dot(&f.solve(&c)), log_determinant(&f))
    }

    /// Residual of the rates after a model: whitened by a noise model, free of the baseline.
    pub fn left(&self, noise_model: usize, shares: &[Share]) -> Vec<f64> {
        let (columns, root) = self.expand(shares);
        let Some((f, c)) = self.factor(noise_model, &columns, &root) else { return vec![] };
        let z = f.solve(&c);
        let v = &self.views[noise_model];
        let mut y = v.y.clone();
        for (i, c) in columns.iter().enumerate() {
            hrg_data::numeric::stats::take_off(&mut y, root[i] * z[i], &v.columns[*c]);
        }
        y
    }

    /// The baseline's basis under a noise model.
    pub fn basis(&self, noise_model: usize) -> &Basis {
        &self.views[noise_model].base
    }

    /// A whitened column, free of the baseline.
    pub fn column(&self, noise_model: usize, column: usize) -> &[f64] {
        &self.views[noise_model].columns[column]
    }
}

/// The gain in evidence of a group at its best variance, at most `most`, and that variance. `values` are the squares of its principal
/// directions, `along` their products with the rates, of which the model leaves squares of `left`.
fn best_gain(values: &[f64], along: &[f64], free: f64, left: f64, most: f64) -> (f64, f64) {
    let gain = |variance: f64| {
        let (mut determinant, mut explained) = (0.0, 0.0);
        for (d, c) in values.iter().zip(along) {
            determinant += (variance * d).ln_1p();
            explained += variance * c * c / (1.0 + variance * d);
        }
        -0.5 * (determinant + free * (1.0 - explained / left).max(1e-12).ln())
    };
    if let (&[d], &[c]) = (values, along) {
        // Of one column: the share q = variance d / (1 + variance d) at which the derivative is zero.
        let share = c * c / (d * left);
        let q = (free * share - 1.0) / (share * (free - 1.0));
        let variance = if q > 0.0 { (q / ((1.0 - q).max(1e-12) * d)).min(most) } else { 1e-9 * most };
        return (gain(variance), variance);
    }
    let top = most.max(1e-300).ln();
    let (mut best, mut at) = (f64::NEG_INFINITY, top);
    for k in 0..14 {
        let x = top - 1.4 * f64::from(k);
        let g = gain(x.exp());
        if g > best {
            (best, at) = (g, x);
        }
    }
    let mut step = 0.7;
    for _ in 0..4 {
        for x in [at - step, (at + step).min(top)] {
            let g = gain(x.exp());
            if g > best {
                (best, at) = (g, x);
            }
        }
        step *= 0.5;
    }
    (best, at.exp())
}

/// Scales a column to unit deviation; gives its deviation before.
fn to_unit_deviation(c: &mut [f64]) -> f64 {
    let s = std_dev(c);
    let s = if s > 1e-12 { s } else { 1.0 };
    c.iter_mut().for_each(|v| *v /= s);
    s
}

/// Log of the mean evidence over the noise models by their probabilities, from the logs under each.
fn mean_evidence(each: &[f64; NOISE_MODELS.len()]) -> f64 {
    let each: Vec<f64> = each.iter().zip(NOISE_MODELS).map(|(e, n)| e + n.log_prior()).collect();
    log_sum(&each)
}
