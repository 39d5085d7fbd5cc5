//! Evidence of models that are linear in their gains, with shrinkage.
//!
//! Columns come in groups (the rungs of a ladder, the knots of a curve). The gains of a group are taken as drawn from one normal
//! distribution; its variance is the one of the highest evidence (MacKay 1992). So ten gains of one family cost what they bring,
//! and not ten times a penalty. The evidence is restricted: it does not depend on the baseline's coefficients (Patterson and
//! Thompson 1971), so slow noise is not underestimated. All is computed from inner products of whitened columns.

use super::data::AxisRows;
use super::model::TEMPERATURE_TERMS;
use super::noise::{Basis, NOISE_MODELS};
use super::proposals::free_steps;
use crate::matrices::{log_determinant, symmetric};
use hrg_core::bias::TERMS;
use hrg_data::numeric::stats::{dot, four_dots, log_sum, std_dev, take_off};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::cell::OnceCell;
use std::collections::HashMap;

/// The group of the baseline's ramp terms: every model has it, with a variance of its own, so that a unit without them is not charged for
/// them.
pub const RAMP: usize = 0;
/// Contiguous parts of the rows for cross-validation.
const FOLDS: usize = 6;
/// A gain may move the rates by as many deviations of what the baseline leaves: a prior that keeps two large gains of opposite sign
/// from standing for one small effect.
const LARGEST_GAIN: f64 = 3.0;
/// A noise model whose evidence is behind that of the best by as much adds nothing, as a logarithm.
const NEGLIGIBLE: f64 = 10.0;
/// A walk over the run that grows as large as the white part. (A group that gains little under white noise may gain most under this one.)
const WALK: usize = 10;
const _: () = assert!(NOISE_MODELS[WALK].phi > 0.999 && NOISE_MODELS[WALK].slow == 1.0);
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

impl Share {
    /// The same, free to do what an effect that is taken out has done: its variance begins at 1 at the least. From next to nothing it would not come
    /// back where a noise model stands in for it.
    pub fn free(&self) -> Self {
        Self { variance: self.variance.max(1.0), ..*self }
    }
}

/// One axis under one noise model.
///
/// Whitened columns are not kept, as there are hundreds of them for each noise model: with `W` the whitening and `Q` an orthonormal basis of the
/// whitened baseline, the product of two columns is `c' W' (I - Q Q') W d`. One of the two is *weighted*, `W' (I - Q Q') W d`, and its products with all
/// columns are plain ones.
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
    /// Products of the columns with the rates.
    b: Vec<f64>,
    /// `true` for a column of which the baseline leaves something.
    there: Vec<bool>,
    /// Columns that were weighted.
    weighted: Vec<OnceCell<Vec<f64>>>,
    /// Products of a column with others; NaN where they were not asked for.
    products: Vec<Vec<f64>>,
    /// Products of the columns of each group with each other.
    own: Vec<DMatrix<f64>>,
    /// Squares of steps free of the baseline, once they were asked for.
    steps: OnceCell<Vec<f64>>,
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
            b: vec![],
            there: vec![],
            weighted: vec![],
            products: vec![],
            own: vec![],
            steps: OnceCell::new(),
        }
    }

    /// A column whitened and free of the baseline.
    fn free_of_baseline(&self, rows: &AxisRows, c: &[f64]) -> Vec<f64> {
        let mut c = rows.filters.whitened(self.noise_model, c);
        self.take_off_baseline(&mut c);
        c
    }

    /// Leaves nothing of a whitened column that the baseline spans, and gives `false` then.
    fn take_off_baseline(&self, c: &mut [f64]) -> bool {
        let before = dot(c, c);
        self.base.reduce(c);
        let left = dot(c, c) >= 1e-9 * before;
        if !left {
            c.fill(0.0);
        }
        left
    }

    /// Adds a column, given whitened.
    fn push(&mut self, white: &mut [f64]) {
        self.there.push(self.take_off_baseline(white));
        self.b.push(dot(white, &self.y));
        self.weighted.push(OnceCell::new());
        self.products.push(Vec::new());
    }

    fn truncate(&mut self, groups: usize, columns: usize) {
        self.own.truncate(groups);
        self.b.truncate(columns);
        self.there.truncate(columns);
        self.weighted.truncate(columns);
        self.products.truncate(columns);
        self.products.iter_mut().for_each(|p| p.truncate(columns));
    }

    /// A column, weighted.
    fn weighted(&self, rows: &AxisRows, columns: &[Vec<f64>], i: usize) -> &[f64] {
        let make = || rows.filters.transposed(self.noise_model, self.free_of_baseline(rows, &columns[i]));
        self.weighted[i].get_or_init(make)
    }

    /// Product of two columns.
    fn product(&self, rows: &AxisRows, columns: &[Vec<f64>], i: usize, j: usize) -> f64 {
        let known = |i: usize, j: usize| self.products[i].get(j).copied().filter(|p| !p.is_nan());
        let (i, j) = if self.weighted[i].get().is_none() && self.weighted[j].get().is_some() { (j, i) } else { (i, j) };
        known(i, j).or_else(|| known(j, i)).unwrap_or_else(|| self.product_of(rows, columns, i, j))
    }

    fn product_of(&self, rows: &AxisRows, columns: &[Vec<f64>], i: usize, j: usize) -> f64 {
        if self.there[j] {
            dot(self.weighted(rows, columns, i), &columns[j])
        } else {
            0.0
        }
    }

    /// Makes the products of these columns with each other and with some more known.
    fn know(&mut self, rows: &AxisRows, columns: &[Vec<f64>], own: &[usize], with: &[usize]) {
        for &i in own {
            self.products[i].resize(columns.len(), f64::NAN);
            self.weighted(rows, columns, i);
        }
        // (So few columns at once that they stay near the processor.)
        let all: Vec<usize> = own.iter().chain(with).copied().collect();
        for some in all.chunks(16) {
            for four in own.chunks(4) {
                let of = |k: usize| self.weighted[four[k.min(four.len() - 1)]].get().map_or(&[][..], Vec::as_slice);
                let weighted = [of(0), of(1), of(2), of(3)];
                for &j in some {
                    if four.iter().any(|i| self.products[*i][j].is_nan()) {
                        let products = if self.there[j] { four_dots(weighted, &columns[j]) } else { [0.0; 4] };
                        four.iter().zip(products).for_each(|(i, p)| self.products[*i][j] = p);
                    }
                }
            }
        }
    }
}

/// Columns of a new group: those that are there, by number, and new ones.
pub enum Part {
    /// Numbers of columns.
    There(Vec<usize>),
    /// Columns that no group has yet.
    New(Vec<Vec<f64>>),
}

/// The products of the columns of a model under one noise model, with each other and with the rates.
struct Products {
    with_each_other: DMatrix<f64>,
    with_rates: DVector<f64>,
}

impl Products {
    /// `I + D^1/2 G D^1/2` factored, and `D^1/2 b`; `root` is the diagonal of `D^1/2`.
    fn factor(&self, root: &[f64]) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        let m = DMatrix::from_fn(root.len(), root.len(), |i, j| {
            root[i] * root[j] * self.with_each_other[(i, j)] + f64::from(u8::from(i == j))
        });
        let c = DVector::from_fn(root.len(), |i, _| root[i] * self.with_rates[i]);
        Some((m.cholesky()?, c))
    }
}

/// A model of one axis under one noise model, ready to be extended.
struct Base {
    /// `L^-1 D^1/2 G`, for the columns that may be added.
    half: DMatrix<f64>,
    /// `L^-1 D^1/2 b`.
    rates: DVector<f64>,
    left: f64,
}

/// Gain in evidence by a group at its best variance.
#[derive(Debug, Clone, Copy)]
pub struct Extension {
    /// Evidence of the extended model.
    pub evidence: f64,
    /// Variance of the group's gains.
    pub variance: f64,
}

/// The same while the noise models are gone through.
#[derive(Clone)]
struct Extended {
    /// Evidence times probability of each noise model, as logarithms.
    each: [f64; NOISE_MODELS.len()],
    /// Largest of them.
    best: f64,
    /// Largest gain.
    most: f64,
    /// Variance under the best noise model.
    variance: f64,
}

impl Default for Extended {
    fn default() -> Self {
        Self { each: [f64::NEG_INFINITY; NOISE_MODELS.len()], best: f64::NEG_INFINITY, most: 0.0, variance: 0.0 }
    }
}

impl Extended {
    fn under(&mut self, s: usize, own: f64, gain: f64, variance: f64) {
        self.each[s] = own + gain;
        self.most = self.most.max(gain);
        if self.each[s] > self.best {
            (self.best, self.variance) = (self.each[s], variance);
        }
    }
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
    /// The columns, of unit deviation.
    columns: Vec<Vec<f64>>,
    views: Vec<View>,
    /// Columns of each group; `None` where the axis does not have what the group needs.
    groups: Vec<Option<Vec<usize>>>,
    /// Deviation of each column before it was scaled.
    pub scale: Vec<f64>,
    /// Variance of what the baseline leaves, (deg/h)^2.
    limit: f64,
    /// Extensions that were asked for before: of a model (its groups, and their variances as bits), by group.
    extended: HashMap<Vec<(usize, u64)>, Vec<Option<Extension>>>,
}

impl<'d> Axis<'d> {
    /// Of the rows of an axis, with one group: the ramp terms of the baseline ([`RAMP`]).
    pub fn new(rows: &'d AxisRows) -> Self {
        let views: Vec<View> = (0..NOISE_MODELS.len()).map(|s| View::new(rows, s)).collect();
        let limit = views[0].squares / views[0].free;
        let (columns, groups, scale) = (vec![], vec![], vec![]);
        let mut axis = Self { rows, columns, views, groups, scale, limit, extended: HashMap::new() };
        axis.push(Some(vec![Part::New(rows.base[TEMPERATURE_TERMS..TERMS].to_vec())]));
        axis
    }

    /// The baseline: its ramp terms with the variance of highest evidence.
    pub fn baseline_model(&self) -> AxisModel {
        self.best(&[Share { group: RAMP, variance: 1.0 }])
    }

    /// Adds a group; `None` where it is missing.
    pub fn push(&mut self, group: Option<Vec<Part>>) {
        let from = self.columns.len();
        let numbers = group.map(|parts| parts.into_iter().flat_map(|p| self.numbers_of(p)).collect::<Vec<_>>());
        let own = numbers.as_deref().unwrap_or_default();
        let mut white: Vec<_> = own.iter().map(|k| self.rows.filters.whiten_by_all(&self.columns[*k])).collect();
        for (s, v) in self.views.iter_mut().enumerate() {
            for (&k, white) in own.iter().zip(&mut white) {
                if k < from {
                    v.take_off_baseline(&mut white[s]);
                } else {
                    v.push(&mut white[s]);
                }
            }
            v.own.push(symmetric(own.len(), |i, j| dot(&white[i][s], &white[j][s])));
        }
        self.groups.push(numbers);
    }

    /// The numbers of a part's columns; new ones are scaled and kept.
    fn numbers_of(&mut self, part: Part) -> Vec<usize> {
        let new = match part {
            Part::There(numbers) => return numbers,
            Part::New(columns) => columns,
        };
        let from = self.columns.len();
        for mut c in new {
            self.scale.push(to_unit_deviation(&mut c));
            self.columns.push(c);
        }
        (from..self.columns.len()).collect()
    }

    /// Takes back all groups from number `count` on.
    pub fn truncate(&mut self, count: usize) {
        self.groups.truncate(count);
        self.extended.values_mut().for_each(|e| e.truncate(count));
        let columns = self.groups.iter().flatten().flatten().max().map_or(0, |k| k + 1);
        self.scale.truncate(columns);
        self.columns.truncate(columns);
        self.views.iter_mut().for_each(|v| v.truncate(count, columns));
    }

    /// Columns of a group.
    pub fn columns_of(&self, group: usize) -> Option<&[usize]> {
        self.groups[group].as_deref()
    }

    /// Numbers of the columns of a model.
    fn columns_in(&self, shares: &[Share]) -> Vec<usize> {
        shares.iter().flat_map(|s| self.columns_of(s.group).unwrap_or_default()).copied().collect()
    }

    /// Deviations of the gains of the columns of a model.
    fn deviations_in(&self, shares: &[Share]) -> Vec<f64> {
        let of = |s: &Share| std::iter::repeat_n(s.variance.sqrt(), self.columns_of(s.group).map_or(0, <[usize]>::len));
        shares.iter().flat_map(of).collect()
    }

    /// Products of the columns of a model under one noise model.
    fn products(&self, s: usize, shares: &[Share]) -> Products {
        let (v, columns) = (&self.views[s], self.columns_in(shares));
        let of_group = |share: usize| self.columns_of(shares[share].group).map_or(0, <[usize]>::len);
        let place = |share: usize| (0..of_group(share)).map(move |k| (share, k));
        let place: Vec<(usize, usize)> = (0..shares.len()).flat_map(place).collect();
        let with_each_other = symmetric(columns.len(), |i, j| {
            let ((share, k), (other, l)) = (place[i], place[j]);
            if share == other {
                v.own[shares[share].group][(k, l)]
            } else {
                v.product(self.rows, &self.columns, columns[i], columns[j])
            }
        });
        let with_rates = DVector::from_fn(columns.len(), |i, _| v.b[columns[i]]);
        Products { with_each_other, with_rates }
    }

    fn of(&self, s: usize, left: f64, determinant: f64) -> f64 {
        let v = &self.views[s];
        -0.5 * (v.free * (left / v.free).max(1e-300).ln() + determinant) + v.constant
    }

    /// Finds the variances of highest evidence under one noise model, by fixed-point steps.
    fn optimise(&self, s: usize, products: &Products, shares: &mut [Share]) {
        let mut last = f64::NEG_INFINITY;
        for step in 0..STEPS {
            let root = self.deviations_in(shares);
            let Some((f, c)) = products.factor(&root) else { return };
            let z = f.solve(&c);
            let left = self.views[s].squares - c.dot(&z);
            let evidence = self.of(s, left, log_determinant(&f));
            if step > 2 && evidence < last + 0.02 {
                return;
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
    }

    fn most(&self, noise: f64) -> f64 {
        (LARGEST_GAIN * LARGEST_GAIN * self.limit / noise.max(1e-300)).max(1e-9)
    }

    /// A model with the variances of highest evidence under its best noise model, from variances to start with. Its evidence is the mean
    /// over all noise models by their probabilities before the data are seen.
    pub fn best(&self, shares: &[Share]) -> AxisModel {
        let mut own = shares.to_vec();
        let products: [Products; NOISE_MODELS.len()] = std::array::from_fn(|s| self.products(s, shares));
        let (mut each, mut best) = self.under_each(&products, &own);
        for _ in 0..3 {
            self.optimise(best, &products[best], &mut own);
            let (now, next) = self.under_each(&products, &own);
            each = now;
            if next == best {
                break;
            }
            best = next;
        }
        AxisModel { shares: own, evidence: mean_evidence(&each), noise_model: best }
    }

    /// Log evidence under each noise model, variances as they are, and the number of the best.
    fn under_each(
        &self,
        products: &[Products; NOISE_MODELS.len()],
        shares: &[Share],
    ) -> ([f64; NOISE_MODELS.len()], usize) {
        let root = self.deviations_in(shares);
        let each = std::array::from_fn(|s| self.evidence(s, &products[s], &root));
        let best = (0..each.len()).max_by(|x: &usize, y| each[*x].total_cmp(&each[*y])).unwrap_or(0);
        (each, best)
    }

    /// Log evidence under one noise model.
    fn evidence(&self, s: usize, products: &Products, root: &[f64]) -> f64 {
        let Some((f, c)) = products.factor(root) else { return f64::NEG_INFINITY };
        let left = self.views[s].squares - c.dot(&f.solve(&c));
        self.of(s, left, log_determinant(&f))
    }

    fn base(&mut self, s: usize, shares: &[Share], more: &[usize]) -> Option<Base> {
        let (columns, root) = (self.columns_in(shares), self.deviations_in(shares));
        self.views[s].know(self.rows, &self.columns, &columns, more);
        let (f, c) = self.products(s, shares).factor(&root)?;
        let v = &self.views[s];
        let mut half = DMatrix::from_fn(columns.len(), more.len(), |i, j| root[i] * v.products[columns[i]][more[j]]);
        solve_lower_triangular(f.l_dirty(), &mut half);
        let rates = f.l_dirty().solve_lower_triangular(&c)?;
        let left = v.squares - rates.dot(&rates);
        Some(Base { half, rates, left })
    }

    /// Evidence of the model with each offered group added: the model's own variances stay. `None` for a group that the axis does not have.
    pub fn extensions(&mut self, model: &AxisModel, offered: &[bool]) -> Vec<Option<Extension>> {
        let key: Vec<(usize, u64)> = model.shares.iter().map(|s| (s.group, s.variance.to_bits())).collect();
        let mut all = self.extended.remove(&key).unwrap_or_default();
        all.resize(self.groups.len(), None);
        let wanted: Vec<usize> =
            (0..all.len()).filter(|&k| offered[k] && all[k].is_none() && self.groups[k].is_some()).collect();
        for (k, extension) in self.extended_by(model, &wanted) {
            all[k] = Some(extension);
        }
        let out = all.iter().zip(offered).map(|(e, offered)| e.filter(|_| *offered)).collect();
        self.extended.insert(key, all);
        out
    }

    /// The same of some groups that the axis has. The white noise, a walk and the two noise models that explain most come first. Another one is
    /// left out for a group if the largest gain of the group so far would not make it matter: a search asks for an order, and what it takes gets its
    /// evidence under all of them ([`Self::best`]).
    fn extended_by(&mut self, model: &AxisModel, groups: &[usize]) -> Vec<(usize, Extension)> {
        if groups.is_empty() {
            return vec![];
        }
        let root = self.deviations_in(&model.shares);
        let own: [f64; NOISE_MODELS.len()] = std::array::from_fn(|s| {
            self.evidence(s, &self.products(s, &model.shares), &root) + NOISE_MODELS[s].log_prior()
        });
        let mut order: [usize; NOISE_MODELS.len()] = std::array::from_fn(|s| s);
        order.swap(1, WALK);
        order[2..].sort_by(|x, y| own[*y].total_cmp(&own[*x]));
        let mut each = vec![Extended::default(); groups.len()];
        for (place, s) in order.into_iter().enumerate() {
            let matters = |e: &Extended| place < 4 || own[s] + e.most + NEGLIGIBLE >= e.best;
            let (wanted, groups): (Vec<&mut Extended>, Vec<usize>) =
                each.iter_mut().zip(groups).filter(|(e, _)| matters(e)).unzip();
            if groups.is_empty() {
                continue;
            }
            let of = |k: &usize| self.groups[*k].clone().unwrap_or_default();
            let mut more: Vec<usize> = groups.iter().flat_map(of).collect();
            more.sort_unstable();
            more.dedup();
            let Some(base) = self.base(s, &model.shares, &more) else { continue };
            let most = self.most(base.left / self.views[s].free);
            for (extended, k) in wanted.into_iter().zip(groups) {
                let (gain, variance) = self.added(s, &base, k, &more).best_gain(self.views[s].free, base.left, most);
                extended.under(s, own[s], gain, variance);
            }
        }
        let of = |(&k, e): (&usize, Extended)| {
            (e.best > f64::NEG_INFINITY).then(|| (k, Extension { evidence: log_sum(&e.each), variance: e.variance }))
        };
        groups.iter().zip(each).filter_map(of).collect()
    }

    /// A group free of what the model explains; `more` are the columns of `base`, in order.
    fn added(&self, s: usize, base: &Base, number: usize, more: &[usize]) -> Tridiagonal {
        let v = &self.views[s];
        let group = self.groups[number].as_deref().unwrap_or_default();
        let place = |k: &usize| more.partition_point(|m| m < k);
        let half: Vec<_> = group.iter().map(|k| base.half.column(place(k))).collect();
        let g = symmetric(group.len(), |i, j| v.own[number][(i, j)] - half[i].dot(&half[j]));
        let b = group.iter().zip(&half).map(|(k, half)| v.b[*k] - half.dot(&base.rates)).collect();
        Tridiagonal::new(g, b)
    }

    /// Log likelihood of rows that a model did not see: each sixth of the rows predicted from the others.
    pub fn cross_validated(&self, model: &AxisModel) -> f64 {
        let (columns, root) = (self.columns_in(&model.shares), self.deviations_in(&model.shares));
        let v = &self.views[model.noise_model];
        let (p, n) = (columns.len(), v.y.len());
        let mut error = 0.0;
        let white: Vec<Vec<f64>> = columns.iter().map(|c| self.column(model.noise_model, *c)).collect();
        let whole = symmetric(p, |i, j| dot(&white[i], &white[j]));
        for f in 0..FOLDS {
            let part = n * f / FOLDS..n * (f + 1) / FOLDS;
            let y = &v.y[part.clone()];
            let x: Vec<&[f64]> = white.iter().map(|c| &c[part.clone()]).collect();
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

    /// Evidence of a model with other columns in the place of one of its groups: variances and noise model stay.
    pub fn evidence_with(&self, model: &AxisModel, group: usize, mut columns: Vec<Vec<f64>>) -> f64 {
        let s = model.noise_model;
        let v = &self.views[s];
        columns.iter_mut().for_each(|c| _ = to_unit_deviation(c));
        let fresh: Vec<Vec<f64>> = columns.iter().map(|c| v.free_of_baseline(self.rows, c)).collect();
        let others: Vec<Share> = model.shares.iter().filter(|s| s.group != group).copied().collect();
        let own = model.shares.iter().find(|s| s.group == group).map_or(0.0, |s| s.variance.sqrt());
        let (known, mut root) = (self.columns_in(&others), self.deviations_in(&others));
        root.extend(std::iter::repeat_n(own, fresh.len()));
        let (p, n, there) = (known.len(), root.len(), self.products(s, &others));
        let with_each_other = symmetric(n, |i, j| match (i < p, j < p) {
            (true, true) => there.with_each_other[(i, j)],
            // (The lower triangle is asked for.)
            (_, true) if fresh[i - p].iter().any(|x| *x != 0.0) => {
                dot(v.weighted(self.rows, &self.columns, known[j]), &columns[i - p])
            }
            (_, true) => 0.0,
            (_, false) => dot(&fresh[i - p], &fresh[j - p]),
        });
        let of_rates = |i: usize, _| if i < p { there.with_rates[i] } else { dot(&fresh[i - p], &v.y) };
        self.evidence(s, &Products { with_each_other, with_rates: DVector::from_fn(n, of_rates) }, &root)
    }

    /// Residual of the rates after a model: whitened by a noise model, free of the baseline.
    pub fn left(&self, noise_model: usize, shares: &[Share]) -> Vec<f64> {
        let (columns, root) = (self.columns_in(shares), self.deviations_in(shares));
        let Some((f, c)) = self.products(noise_model, shares).factor(&root) else { return vec![] };
        let z = f.solve(&c);
        let v = &self.views[noise_model];
        let mut sum = vec![0.0; v.y.len()];
        for (i, c) in columns.iter().enumerate().filter(|(_, c)| v.there[**c]) {
            take_off(&mut sum, -root[i] * z[i], &self.columns[*c]);
        }
        let explained = v.free_of_baseline(self.rows, &sum);
        v.y.iter().zip(&explained).map(|(y, e)| y - e).collect()
    }

    /// Squares of a step at each row, free of the baseline.
    pub fn steps(&self, noise_model: usize) -> &[f64] {
        let v = &self.views[noise_model];
        v.steps.get_or_init(|| free_steps(self.rows, noise_model, &v.base))
    }

    /// A whitened column, free of the baseline.
    pub fn column(&self, noise_model: usize, column: usize) -> Vec<f64> {
        self.views[noise_model].free_of_baseline(self.rows, &self.columns[column])
    }
}

/// A group beside a model: the products of its columns with each other, and with the rates, turned so that the first are tridiagonal (Householder
/// 1958). Each variance of its gains then costs as many steps as there are columns.
struct Tridiagonal {
    diagonal: Vec<f64>,
    beside: Vec<f64>,
    rates: Vec<f64>,
}

impl Tridiagonal {
    fn new(mut products: DMatrix<f64>, mut rates: Vec<f64>) -> Self {
        let n = rates.len();
        let g = products.as_mut_slice();
        let mut beside = Vec::with_capacity(n);
        for k in 1..n {
            let mut v = g[(k - 1) * n + k..k * n].to_vec();
            let length = dot(&v, &v).sqrt();
            let turned = if v[0] > 0.0 { -length } else { length };
            beside.push(turned);
            v[0] -= turned;
            let square = dot(&v, &v);
            if k + 1 == n || square == 0.0 {
                // (One element is where it has to be.)
                beside[k - 1] = g[(k - 1) * n + k];
                continue;
            }
            let mut w: Vec<f64> = (k..n).map(|j| 2.0 / square * dot(&v, &g[j * n + k..(j + 1) * n])).collect();
            let along = dot(&v, &w) / square;
            take_off(&mut w, along, &v);
            for j in k..n {
                let column = &mut g[j * n + k..(j + 1) * n];
                take_off(column, w[j - k], &v);
                take_off(column, v[j - k], &w);
            }
            let along = 2.0 / square * dot(&v, &rates[k..]);
            take_off(&mut rates[k..], along, &v);
        }
        Self { diagonal: products.diagonal().iter().copied().collect(), beside, rates }
    }

    /// Gain in evidence at a variance of the gains; the model without the group leaves squares of `left` on `free` degrees of freedom.
    fn gain(&self, variance: f64, free: f64, left: f64) -> f64 {
        self.gains([variance], free, left)[0]
    }

    /// The same at several variances.
    fn gains<const N: usize>(&self, variances: [f64; N], free: f64, left: f64) -> [f64; N] {
        let (explained, determinants) = eliminated(&self.diagonal, &self.beside, &self.rates, variances);
        std::array::from_fn(|n| {
            -0.5 * (determinants[n] + free * (1.0 - variances[n] * explained[n] / left).max(1e-12).ln())
        })
    }

    /// The gain at the best variance, at most `most`, and that variance.
    fn best_gain(&self, free: f64, left: f64, most: f64) -> (f64, f64) {
        let gain = |variance: f64| self.gain(variance, free, left);
        if let (&[d], &[c]) = (&self.diagonal[..], &self.rates[..]) {
            // Of one column: the share q = variance d / (1 + variance d) at which the derivative is zero.
            let share = c * c / (d * left);
            let q = (free * share - 1.0) / (share * (free - 1.0));
            let variance = if q > 0.0 { (q / ((1.0 - q).max(1e-12) * d)).min(most) } else { 1e-9 * most };
            return (gain(variance), variance);
        }
        let top = most.max(1e-300).ln();
        let mut best = (f64::NEG_INFINITY, top);
        let mut try_logs = |logs: &[f64], gains: &[f64]| {
            for (x, g) in logs.iter().zip(gains) {
                if *g > best.0 {
                    best = (*g, *x);
                }
            }
            best
        };
        let logs: [f64; 14] = std::array::from_fn(|k| top - 1.4 * k as f64);
        let mut near = try_logs(&logs, &self.gains(logs.map(f64::exp), free, left));
        for step in [0.7, 0.35, 0.175, 0.0875] {
            let logs = [near.1 - step, (near.1 + step).min(top)];
            near = try_logs(&logs, &self.gains(logs.map(f64::exp), free, left));
        }
        (near.0, near.1.exp())
    }
}

/// Elimination of `I + v T`, `T` tridiagonal, at several variances `v`: by each, the squares that some rates have along it over it, and its log
/// determinant.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn eliminated<const N: usize>(
    diagonal: &[f64],
    beside: &[f64],
    rates: &[f64],
    variances: [f64; N],
) -> ([f64; N], [f64; N]) {
    let (mut logs, mut products, mut explained) = ([0.0; N], [1.0; N], [0.0; N]);
    let (mut last, mut pivot) = ([0.0; N], [1.0; N]);
    for (k, (d, c)) in diagonal.iter().zip(rates).enumerate() {
        let beside = if k > 0 { beside[k - 1] } else { 0.0 };
        for n in 0..N {
            let share = variances[n] * beside / pivot[n];
            // (What is added to the unit matrix has no negative part: below 1 there is rounding alone.)
            pivot[n] = (1.0 + variances[n] * d - share * (variances[n] * beside)).max(1.0);
            last[n] = c - share * last[n];
            explained[n] += last[n] * last[n] / pivot[n];
            products[n] *= pivot[n];
        }
        if products.iter().any(|p| *p > 1e100) {
            for n in 0..N {
                logs[n] += products[n].ln();
                products[n] = 1.0;
            }
        }
    }
    (explained, std::array::from_fn(|n| logs[n] + products[n].ln()))
}

/// Columns that are solved for side by side.
const ABREAST: usize = 16;

/// `L^-1 M` in the place of `M`.
fn solve_lower_triangular(l: &DMatrix<f64>, m: &mut DMatrix<f64>) {
    let n = l.nrows();
    if n == 0 {
        return;
    }
    let (l, mut rows) = (l.transpose(), vec![[0.0; ABREAST]; n]);
    for columns in m.as_mut_slice().chunks_mut(ABREAST * n) {
        for (c, column) in columns.chunks(n).enumerate() {
            rows.iter_mut().zip(column).for_each(|(row, x)| row[c] = *x);
        }
        solve_abreast(l.as_slice(), &mut rows);
        for (c, column) in columns.chunks_mut(n).enumerate() {
            column.iter_mut().zip(&rows).for_each(|(x, row)| *x = row[c]);
        }
    }
}

/// The same for some columns, given by rows; `l` by rows.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn solve_abreast(l: &[f64], rows: &mut [[f64; ABREAST]]) {
    let n = rows.len();
    for k in 0..n {
        let (done, rest) = rows.split_at_mut(k);
        let mut row = rest[0];
        for (l, done) in l[k * n..k * n + k].iter().zip(&*done) {
            for c in 0..ABREAST {
                row[c] -= l * done[c];
            }
        }
        for c in 0..ABREAST {
            row[c] /= l[k * n + k];
        }
        rest[0] = row;
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangular_systems_are_solved_as_nalgebra_solves_them() {
        for (n, count) in [(0, 3), (1, 1), (3, 16), (7, 17), (20, 50)] {
            let l = DMatrix::from_fn(n, n, |i, j| if i == j { 2.0 + i as f64 } else { ((3 * i + j) as f64).sin() });
            let m = DMatrix::from_fn(n, count, |i, j| ((i + 5 * j) as f64 * 0.3).cos());
            let (mut own, mut wanted) = (m.clone(), m);
            solve_lower_triangular(&l, &mut own);
            assert!(l.solve_lower_triangular_mut(&mut wanted));
            assert!((own - wanted).iter().all(|d| d.abs() < 1e-12), "{n} {count}");
        }
    }

    #[test]
    fn the_gain_of_a_group_is_that_of_the_whole_matrix() {
        // Gain = -1/2 (ln det(I + v G) + free ln(1 - v b' (I + v G)^-1 b / left)), for products of any size.
        for n in [1, 2, 3, 9] {
            let columns: Vec<Vec<f64>> = (0..n)
                .map(|j| (0..40).map(|k| ((k * (j + 2)) as f64 * 0.37).sin() + 0.2 * j as f64).collect())
                .collect();
            let y: Vec<f64> = (0..40).map(|k| (k as f64 * 0.9).cos() + 0.1 * k as f64).collect();
            let g = symmetric(n, |i, j| dot(&columns[i], &columns[j]));
            let b: Vec<f64> = columns.iter().map(|c| dot(c, &y)).collect();
            let (left, free) = (dot(&y, &y), 38.0);
            let turned = Tridiagonal::new(g.clone(), b.clone());
            for variance in [1e-6, 1e-3, 0.1, 30.0] {
                let f = (DMatrix::identity(n, n) + variance * &g).cholesky().expect("positive");
                let b = DVector::from_vec(b.clone());
                let explained = variance * b.dot(&f.solve(&b));
                let wanted = -0.5 * (log_determinant(&f) + free * (1.0 - explained / left).ln());
                assert!((turned.gain(variance, free, left) - wanted).abs() < 1e-9, "{n} {variance}");
            }
            let (best, at) = turned.best_gain(free, left, 10.0);
            assert!(
                (0..200).all(|k| turned.gain(10.0 * 0.9f64.powi(k), free, left) < best + 0.05),
                "{n}: {best} at {at}"
            );
        }
    }
}
