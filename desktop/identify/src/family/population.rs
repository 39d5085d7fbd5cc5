//! Common properties of the units of a design: the distribution of their coefficients, by empirical Bayes.
//!
//! The coefficients of a unit are drawn from one normal distribution over the design, those of a day from one about its unit's:
//!
//! ```text
//! theta_unit ~ N(mean, between),   theta_day ~ N(theta_unit, days),   rates = columns theta_day + noise
//! ```
//!
//! `mean`, `between` and `days` are those of the highest likelihood: `between` by expectation and maximisation (Dempster, Laird and Rubin 1977; the same
//! model as Lindley and Smith 1972), `mean` by generalised least squares, `days` by minorisation and maximisation, as expectation takes hundreds of steps
//! where a variance is next to nothing. A covariance of as many coefficients as there are units is poorly known: the part of it off its diagonal is shrunk by
//! the weight that predicts units best which were left out, and `days` is taken for diagonal. The likelihood of the units that were left out also tells
//! which effects the units share ([`Population::left_out`]), and which unit the others do not resemble ([`Population::log_odds`]).
//!
//! # Basis
//! Which numbers a diagonal holds is a choice. Columns that look alike (a ladder of time constants) have large gains of opposite signs, and what matters is
//! their sum: variances of each alone would make it far too uncertain. So the diagonals are those of other coefficients: of columns that are orthogonal, with
//! the noise for their unit, over all runs on average. In order of the model each new column is what those before it do not hold; the first is the constant.
//!
//! # Directions that no run tells
//! Some combinations of gains hardly change the rates of any run, and would be whatever noise makes of them, large and with opposite signs: another past of the unit
//! brings them out. Here as in the trace each gain has a variance that it may have at all, found by evidence. It holds for the mean, `mean ~ N(0, gains)`, and
//! units and days do not differ by more: 1 / between has 1 / gains added.

use crate::matrices::log_determinant;
use crate::trace::uncertainty::square_root;
use hrg_data::numeric::side_by_side;
use hrg_data::numeric::stats::log_sum;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Facts of one run about the coefficients: information and right-hand side of its generalised least squares.
#[derive(Debug, Clone)]
pub struct OfRun {
    /// X' N^-1 X, N the covariance of the noise.
    pub information: DMatrix<f64>,
    /// X' N^-1 y.
    pub product: DVector<f64>,
    /// Rows of y.
    pub rows: usize,
}

/// The runs of one unit.
#[derive(Debug, Clone)]
pub struct OfUnit {
    /// Its runs.
    pub runs: Vec<OfRun>,
}

/// The distribution of the coefficients of one axis over the units of a design.
#[derive(Debug, Clone)]
pub struct Population {
    /// Mean of each coefficient.
    pub mean: DVector<f64>,
    /// Covariance from unit to unit.
    pub between: DMatrix<f64>,
    /// Covariance from day to day.
    pub days: DMatrix<f64>,
    /// Log likelihood of the units, each under a population that was learnt without it, up to what does not depend on the model.
    pub left_out: f64,
    /// Of each unit: natural logarithm of the odds of that against what its runs say by themselves; no number for a unit whose runs say nothing. Empty where it
    /// was read from a file.
    pub log_odds: Vec<f64>,
}

/// The same in the orthogonal basis.
#[derive(Clone)]
struct InBasis {
    mean: DVector<f64>,
    between: DMatrix<f64>,
    /// Variance of each coefficient from day to day.
    days: DVector<f64>,
}

/// Its matrices, made once for all units.
struct Made {
    /// Inverse of `between`, and the logarithm of its determinant.
    precision: DMatrix<f64>,
    log_between: f64,
    /// Standard deviation of each coefficient from day to day.
    day: DVector<f64>,
}

/// A covariance with a precision added.
fn bounded(covariance: &DMatrix<f64>, precision: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let root = square_root(covariance);
    let inner = DMatrix::identity(root.nrows(), root.nrows()) + root.transpose() * precision * &root;
    Some(symmetrised(&(&root * inverse(&inner)?.0 * root.transpose())))
}

/// A symmetric matrix without what rounding has done to it.
fn symmetrised(m: &DMatrix<f64>) -> DMatrix<f64> {
    0.5 * (m + m.transpose())
}

/// Coefficients of orthogonal columns: `basis * theta`, upper triangular.
struct Basis {
    /// Its inverse.
    back: DMatrix<f64>,
    /// Precision of its coefficients before anything is seen.
    precision: DMatrix<f64>,
}

/// Share of the information of each coefficient that is added: keeps the basis invertible where columns say the same.
const TOUCH: f64 = 1e-9;

impl Basis {
    /// That of the mean information of all runs. `gains`: variances of the last coefficients before anything is seen.
    fn of(units: &[OfUnit], gains: &[f64]) -> Option<Self> {
        let runs = || units.iter().flat_map(|u| &u.runs);
        let mean = runs().map(|r| &r.information).sum::<DMatrix<f64>>() / runs().count().max(1) as f64;
        let p = mean.nrows();
        let touched = DMatrix::from_fn(p, p, |i, j| mean[(i, j)] * if i == j { 1.0 + TOUCH } else { 1.0 });
        let back = touched.cholesky()?.l().transpose().try_inverse()?;
        let free = p - gains.len().min(p);
        let precision = DVector::from_fn(p, |j, _| if j < free { 0.0 } else { 1.0 / gains[j - free].max(1e-300) });
        let precision = back.transpose() * DMatrix::from_diagonal(&precision) * &back;
        Some(Self { back, precision: symmetrised(&precision) })
    }

    /// Facts of a run about those coefficients.
    fn of_run(&self, run: &OfRun) -> OfRun {
        let information = self.back.transpose() * &run.information * &self.back;
        OfRun { information: symmetrised(&information), product: self.back.transpose() * &run.product, rows: run.rows }
    }

    /// A population of those coefficients as one of the model's.
    fn population(&self, of: &InBasis, units: &[OfUnit], left_out: &Prediction) -> Option<Population> {
        let made = of.made()?;
        let alone = |u: &OfUnit| of.alone(&made, u, self);
        let log_odds =
            left_out.logs.iter().zip(units).map(|(with, u)| Some(with - alone(u)?)).collect::<Option<Vec<f64>>>()?;
        let covariance = |c: &DMatrix<f64>| symmetrised(&(&self.back * c * self.back.transpose()));
        Some(Population {
            mean: &self.back * &of.mean,
            between: covariance(&of.between),
            days: covariance(&bounded(&DMatrix::from_diagonal(&of.days), &self.precision)?),
            left_out: left_out.sum(),
            log_odds,
        })
    }
}

/// Weights of the diagonal that are tried, in multiples of the number of coefficients: from a covariance that is taken as it is found to one without
/// correlations.
const WEIGHTS: [f64; 5] = [0.02, 0.1, 0.5, 2.0, 8.0];
/// Steps of expectation and maximisation; the likelihood changes by less than a hundredth of a unit of its logarithm behind them.
const STEPS: usize = 60;
/// Parts into which the units are cut, each left out once; fewer than twice as many units are left out one by one.
const PARTS: usize = 5;
/// Fewest units of a family: a mean and a spread of each coefficient, and units left out to choose the weight.
pub const FEWEST: usize = 4;
/// Smallest variance, as a share of the mean square of a coefficient: keeps the covariance invertible.
const LEAST: f64 = 1e-8;

/// Facts of a unit's runs once the days are integrated out.
struct Expected {
    mean: DVector<f64>,
    /// Inverse of its covariance, in factors.
    of_covariance: Cholesky<f64, Dyn>,
    /// Log likelihood, up to what does not depend on the population.
    likelihood: f64,
}

fn inverse(m: &DMatrix<f64>) -> Option<(DMatrix<f64>, Cholesky<f64, Dyn>)> {
    let f = m.clone().cholesky()?;
    Some((f.inverse(), f))
}

impl InBasis {
    fn made(&self) -> Option<Made> {
        let (precision, f) = inverse(&self.between)?;
        Some(Made { precision, log_between: log_determinant(&f), day: self.days.map(f64::sqrt) })
    }

    /// A run's information on the coefficients of its unit, its right-hand side, and what it adds to the logarithm of the likelihood, once its day is
    /// integrated out.
    fn without_day(made: &Made, run: &OfRun) -> Option<(DMatrix<f64>, DVector<f64>, f64)> {
        // L L' = I + D^1/2 G D^1/2, D the variances of the days: where one is zero it is no unknown.
        let (p, day) = (made.day.len(), &made.day);
        let mut g = DMatrix::from_fn(p, p, |i, j| day[i] * run.information[(i, j)]);
        let inner = DMatrix::from_fn(p, p, |i, j| g[(i, j)] * day[j] + f64::from(u8::from(i == j)));
        let f = inner.cholesky()?;
        // L^-1 D^1/2 G and L^-1 D^1/2 b.
        let mut b = day.component_mul(&run.product);
        let l = f.l_dirty();
        if !(l.solve_lower_triangular_mut(&mut g) && l.solve_lower_triangular_mut(&mut b)) {
            return None;
        }
        let log = 0.5 * b.norm_squared() - 0.5 * log_determinant(&f);
        Some((&run.information - g.tr_mul(&g), &run.product - g.tr_mul(&b), log))
    }

    /// The same of all runs of a unit.
    fn without_days(&self, made: &Made, unit: &OfUnit) -> Option<(DMatrix<f64>, DVector<f64>, f64)> {
        let p = self.mean.len();
        let mut sum = (DMatrix::zeros(p, p), DVector::zeros(p), 0.0);
        for run in &unit.runs {
            let (information, product, log) = Self::without_day(made, run)?;
            sum = (sum.0 + information, sum.1 + product, sum.2 + log);
        }
        Some(sum)
    }

    /// Its likelihood for a unit, and what it expects of the unit.
    fn expect(&self, made: &Made, unit: &OfUnit) -> Option<Expected> {
        let (information, product, log) = self.without_days(made, unit)?;
        let of_mean = &made.precision * &self.mean;
        let f = (information + &made.precision).cholesky()?;
        let product = product + &of_mean;
        let mean = f.solve(&product);
        let likelihood = log - 0.5 * self.mean.dot(&of_mean) - 0.5 * made.log_between + 0.5 * mean.dot(&product)
            - 0.5 * log_determinant(&f);
        Some(Expected { mean, of_covariance: f, likelihood })
    }

    /// Log likelihood of a unit of which nothing is known but the variances that gains have at all: its coefficients have a prior with the weight of one row
    /// of its own about what was found.
    fn alone(&self, made: &Made, unit: &OfUnit, basis: &Basis) -> Option<f64> {
        let (information, product, log) = self.without_days(made, unit)?;
        let rows = unit.runs.iter().map(|r| r.rows).sum::<usize>().max(1) as f64;
        let whole = (&information + &basis.precision).cholesky()?;
        let one_row = (&information / rows + &basis.precision).cholesky()?;
        let fitted = 0.5 * product.dot(&whole.solve(&product));
        Some(log + fitted + 0.5 * (log_determinant(&one_row) - log_determinant(&whole)))
    }

    /// One step of expectation and maximisation: the covariance from unit to unit, and with it the mean of the highest likelihood.
    fn step(&self, units: &[&OfUnit], basis: &Basis, weight: f64) -> Option<Self> {
        let (p, n) = (self.mean.len(), units.len() as f64);
        let made = self.made()?;
        let expected: Vec<Expected> = units.iter().map(|u| self.expect(&made, u)).collect::<Option<_>>()?;
        let mean = expected.iter().map(|e| &e.mean).sum::<DVector<f64>>() / n;
        let mut between = DMatrix::zeros(p, p);
        for e in &expected {
            let off = &e.mean - &mean;
            between += e.of_covariance.inverse() + &off * off.transpose();
        }
        between /= n;
        let least = mean.map(|m| m * m).max().max(1e-12) * LEAST;
        let keep = n / (n + weight);
        let between = DMatrix::from_fn(p, p, |i, j| {
            if i == j {
                between[(i, i)] * (1.0 + LEAST) + least
            } else {
                keep * 0.5 * (between[(i, j)] + between[(j, i)])
            }
        });
        let next = Self { between: bounded(&between, &basis.precision)?, ..self.clone() };
        next.with_mean(units, basis)
    }

    /// With the mean of the highest likelihood under its covariances (generalised least squares).
    fn with_mean(&self, units: &[&OfUnit], basis: &Basis) -> Option<Self> {
        let made = self.made()?;
        let (mut information, mut product) = (basis.precision.clone(), DVector::zeros(self.mean.len()));
        for unit in units {
            // A unit tells G and b of itself, and of the mean P - P (P + G)^-1 P and P (P + G)^-1 b.
            let (g, b, _) = self.without_days(&made, unit)?;
            let f = (g + &made.precision).cholesky()?;
            product += &made.precision * f.solve(&b);
            information += &made.precision - &made.precision * f.solve(&made.precision);
        }
        let touch = information.diagonal() * LEAST;
        let mean = inverse(&symmetrised(&(information + DMatrix::from_diagonal(&touch))))?.0 * product;
        Some(Self { mean, ..self.clone() })
    }

    /// With variances of the days of a higher likelihood: each is multiplied by the root of what its days explain over what is expected of them by chance
    /// (minorisation and maximisation; Zhou, Hu, Qiao and Sinsheimer 2019). Where days do not differ it falls to nothing in a few steps.
    fn with_days(&self, units: &[&OfUnit]) -> Option<Self> {
        let (made, p) = (self.made()?, self.mean.len());
        let (mut explained, mut expected) = (DVector::<f64>::zeros(p), DVector::<f64>::zeros(p));
        for unit in units {
            let of_unit = self.expect(&made, unit)?;
            for run in &unit.runs {
                let (information, product, _) = Self::without_day(&made, run)?;
                let off = product - &information * &of_unit.mean;
                let left = &information - &information * of_unit.of_covariance.solve(&information);
                explained += off.component_mul(&off);
                expected += left.diagonal();
            }
        }
        let days = DVector::from_fn(p, |j, _| {
            let factor = (explained[j] / expected[j].max(f64::MIN_POSITIVE)).sqrt();
            self.days[j] * if factor.is_finite() { factor } else { 1.0 }
        });
        Some(Self { days, ..self.clone() })
    }

    fn with_weight(units: &[&OfUnit], basis: &Basis, weight: f64) -> Option<Self> {
        let mut now = Self::first(units, basis)?;
        // (A unit of one run does not part its day from itself.)
        let several = units.iter().any(|u| u.runs.len() > 1);
        for _ in 0..STEPS {
            now = now.step(units, basis, weight)?;
            if several {
                now = now.with_days(units)?;
            }
        }
        Some(now)
    }

    /// The begin of the steps: each unit by itself, with a little of the mean information of all.
    fn first(units: &[&OfUnit], basis: &Basis) -> Option<Self> {
        let sums: Vec<(DMatrix<f64>, DVector<f64>)> = units
            .iter()
            .map(|u| {
                (u.runs.iter().map(|r| &r.information).sum::<DMatrix<f64>>(), u.runs.iter().map(|r| &r.product).sum())
            })
            .collect();
        let n = units.len() as f64;
        let all = sums.iter().map(|s| &s.0).sum::<DMatrix<f64>>();
        let little = DMatrix::from_diagonal(&all.diagonal()) * (1e-6 / n);
        let (inverse_of_all, _) = inverse(&(&all + &little + &basis.precision))?;
        let mean = inverse_of_all * sums.iter().map(|s| &s.1).sum::<DVector<f64>>();
        let each: Vec<DVector<f64>> = sums
            .iter()
            .map(|(g, b)| {
                Some(inverse(&(g + &little + &basis.precision))?.0 * (b + (&little + &basis.precision) * &mean))
            })
            .collect::<Option<_>>()?;
        let p = mean.len();
        let square = |j: usize| each.iter().map(|e| (e[j] - mean[j]).powi(2)).sum::<f64>() / n;
        let between =
            DMatrix::from_fn(p, p, |i, j| if i == j { square(i) + LEAST * mean[i] * mean[i] + 1e-18 } else { 0.0 });
        let several = units.iter().any(|u| u.runs.len() > 1);
        let days = between.diagonal() * if several { 0.01 } else { 0.0 };
        Some(Self { mean, between, days })
    }

    /// With a covariance from unit to unit that is wider by a factor.
    fn wider(mut self, factor: f64) -> Self {
        self.between *= factor;
        self
    }
}

/// Variance of a new unit over that of the `n` units (four at the least) that a population was learnt from: their mean and variances are uncertain
/// themselves, and the predictive distribution is Student's ([`possible_scales`]).
fn variance_of_a_new_unit(n: usize) -> f64 {
    let n = n as f64;
    (n + 1.0) / (n - 3.0).max(1.0)
}

impl Population {
    /// Learns a population. `gains`: variances of the last coefficients before anything is seen. `None` for fewer than [`FEWEST`] units, or numbers that no matrix can be made of.
    #[must_use]
    pub fn learn(units: &[OfUnit], gains: &[f64]) -> Option<Self> {
        if units.len() < FEWEST {
            return None;
        }
        let basis = Basis::of(units, gains)?;
        let in_basis = |u: &OfUnit| OfUnit { runs: u.runs.iter().map(|r| basis.of_run(r)).collect() };
        let units: Vec<OfUnit> = units.iter().map(in_basis).collect();
        let p = units.first()?.runs.first()?.product.len() as f64;
        let scored = side_by_side::each(WEIGHTS.to_vec(), |w| Prediction::new(&units, &basis, w * p));
        let best = scored.into_iter().flatten().max_by(|x, y| x.sum().total_cmp(&y.sum()))?;
        let all: Vec<&OfUnit> = units.iter().collect();
        let learnt = InBasis::with_weight(&all, &basis, best.weight)?;
        let learnt = learnt.wider(variance_of_a_new_unit(units.len())).wider(best.wider);
        basis.population(&learnt, &units, &best)
    }
}

/// Eighths of a normal distribution, by their medians.
const EIGHTHS: [f64; 8] = [-1.534, -0.887, -0.489, -0.157, 0.157, 0.489, 0.887, 1.534];

/// Factors by which the covariance of a new unit may differ from that of the `n` units it was learnt from, each as probable: with them a normal
/// distribution becomes Student's with n - 1 degrees of freedom (quantiles of chi squared by Wilson and Hilferty 1931).
fn possible_scales(n: usize) -> [f64; 8] {
    let n = n as f64;
    let of_mean = (n + 1.0) / (n - 1.0);
    let c = 2.0 / (9.0 * (n - 1.0));
    EIGHTHS.map(|z| of_mean / (1.0 - c + z * c.sqrt()).max(0.1).powi(3))
}

/// The same over what a population has in it for a new unit.
pub(super) fn scales_of_a_new_unit(n: usize) -> [f64; 8] {
    possible_scales(n).map(|s| s / variance_of_a_new_unit(n))
}

/// Factors by which the covariance between the units that were left out may be larger than that of the others: what fewer units than coefficients have in
/// common is taken for narrower than it is.
const WIDER: [f64; 8] = [0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0];

/// Prediction of units that were left out.
struct Prediction {
    /// Log likelihood of each unit under a population that was learnt without it and the others of its part.
    logs: Vec<f64>,
    /// The weight of the diagonal, in units, and the factor by which the covariance is wider.
    weight: f64,
    wider: f64,
}

impl Prediction {
    fn sum(&self) -> f64 {
        self.logs.iter().sum()
    }

    /// The best over the factors.
    fn new(units: &[OfUnit], basis: &Basis, weight: f64) -> Option<Self> {
        let parts = if units.len() < 2 * PARTS { units.len() } else { PARTS };
        let mut each: Vec<Self> =
            WIDER.iter().map(|wider| Self { logs: vec![0.0; units.len()], weight, wider: *wider }).collect();
        for part in 0..parts {
            let rest: Vec<&OfUnit> =
                units.iter().enumerate().filter(|(k, _)| k % parts != part).map(|(_, u)| u).collect();
            let learnt = InBasis::with_weight(&rest, basis, weight)?;
            for to in &mut each {
                let scaled = |scale: f64| {
                    let one = learnt.clone().wider(scale * to.wider);
                    Some((one.made()?, one))
                };
                let each = possible_scales(rest.len()).into_iter().map(scaled).collect::<Option<Vec<_>>>()?;
                for k in (part..units.len()).step_by(parts) {
                    let log = |(made, one): &(Made, InBasis)| Some(one.expect(made, &units[k])?.likelihood);
                    let logs = each.iter().map(log).collect::<Option<Vec<f64>>>()?;
                    to.logs[k] = log_sum(&logs) - (logs.len() as f64).ln();
                }
            }
        }
        each.into_iter().max_by(|x, y| x.sum().total_cmp(&y.sum()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Units of two coefficients, `runs` runs each; information of a run differs by coefficient.
    fn units(n: usize, runs: usize, days: f64, seed: u64) -> Vec<OfUnit> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = |deviation: f64| -> f64 {
            let x: f64 = StandardNormal.sample(&mut rng);
            deviation * x
        };
        (0..n)
            .map(|_| {
                let common = normal(0.5);
                let theta = [3.0 + common, -1.0 + common + normal(0.2)];
                let of_run = |information: [f64; 2], normal: &mut dyn FnMut(f64) -> f64| {
                    let value = |j: usize, normal: &mut dyn FnMut(f64) -> f64| {
                        theta[j] + normal(if j == 0 { days } else { 0.0 }) + normal(1.0 / information[j].sqrt())
                    };
                    let g = DVector::from_row_slice(&information);
                    let v = DVector::from_row_slice(&[value(0, normal), value(1, normal)]);
                    OfRun { product: g.component_mul(&v), information: DMatrix::from_diagonal(&g), rows: 400 }
                };
                OfUnit { runs: (0..runs).map(|_| of_run([400.0, 100.0], &mut normal)).collect() }
            })
            .collect()
    }

    #[test]
    fn mean_spread_and_days_come_back() {
        let found = Population::learn(&units(200, 2, 0.3, 1), &[]).expect("learnt");
        let off = |a: f64, b: f64| (a / b - 1.0).abs();
        assert!(off(found.mean[0], 3.0) < 0.05 && off(found.mean[1], -1.0) < 0.1, "{}", found.mean);
        assert!(
            off(found.between[(0, 0)], 0.25) < 0.25 && off(found.between[(1, 1)], 0.29) < 0.25,
            "{}",
            found.between
        );
        assert!(found.between[(0, 1)] > 0.15, "units whose first is large have a large second: {}", found.between);
        assert!(off(found.days[(0, 0)], 0.09) < 0.25 && found.days[(1, 1)] < 0.01, "{}", found.days);
    }

    #[test]
    fn a_unit_that_was_left_out_lies_where_the_population_says() {
        // Few units: the covariance is shrunk, and what is predicted must not be too narrow.
        let mut squares = 0.0;
        let (rounds, n) = (60, 12);
        for seed in 0..rounds {
            let all = units(n + 1, 1, 0.0, 100 + seed);
            let learnt = Population::learn(&all[..n], &[]).expect("learnt");
            // (A run of 400 and 100 tells the coefficients to 0.05 and 0.1.)
            let run = &all[n].runs[0];
            let v = run.product.component_div(&run.information.diagonal());
            let off = v - &learnt.mean;
            let own = DMatrix::from_diagonal(&run.information.diagonal().map(|g| 1.0 / g));
            squares += (off.transpose() * (&learnt.between + own).try_inverse().expect("regular") * &off)[(0, 0)] / 2.0;
        }
        let mean = squares / rounds as f64;
        assert!((0.6..1.5).contains(&mean), "{mean}");
    }

    #[test]
    fn a_unit_that_the_others_do_not_resemble_is_told_by_its_odds() {
        let mut all = units(12, 2, 0.0, 5);
        let odds = Population::learn(&all, &[]).expect("learnt").log_odds;
        assert!(odds.iter().all(|o| *o > -3.0), "{odds:.1?}");
        // Its second coefficient is 3 larger, six times what units differ by.
        all[4].runs.iter_mut().for_each(|r| r.product[1] += 3.0 * r.information[(1, 1)]);
        let odds = Population::learn(&all, &[]).expect("learnt").log_odds;
        assert!(odds[4] < -5.0 && odds.iter().enumerate().all(|(k, o)| k == 4 || *o > -3.0), "{odds:.1?}");
    }

    #[test]
    fn days_that_do_not_differ_come_out_as_nothing() {
        let found = Population::learn(&units(30, 2, 0.3, 6), &[]).expect("learnt");
        // (A run tells the second coefficient to 0.1, and units differ by 0.54.)
        assert!(found.days[(1, 1)] < 1e-3, "{}", found.days);
    }

    #[test]
    fn a_handful_is_no_family() {
        assert!(Population::learn(&units(FEWEST - 1, 2, 0.1, 3), &[]).is_none());
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        assert!(rng.random_bool(1.0) && Population::learn(&units(FEWEST, 1, 0.1, 3), &[]).is_some());
    }
}
