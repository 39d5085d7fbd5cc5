//! Common properties of the units of a design: the distribution of their coefficients, by empirical Bayes.
//!
//! The coefficients of a unit are drawn from one normal distribution over the design, those of a day from one about its unit's:
//!
//! ```text
//! theta_unit ~ N(mean, between),   theta_day ~ N(theta_unit, days),   rates = columns theta_day + noise
//! ```
//!
//! `mean`, `between` and `days` are those of the highest likelihood, found by expectation and maximisation (Dempster, Laird and Rubin
//! 1977; the same model as Lindley and Smith 1972). A covariance of as many coefficients as there are units is poorly known: the part of it off
//! its diagonal is shrunk by the weight that predicts units best which were left out, and `days` is taken for diagonal.
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
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Facts of one run about the coefficients: information and right-hand side of its generalised least squares.
#[derive(Debug, Clone)]
pub struct OfRun {
    /// X' N^-1 X, N the covariance of the noise.
    pub information: DMatrix<f64>,
    /// X' N^-1 y.
    pub product: DVector<f64>,
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
    /// Weight of the diagonal that was chosen, in units.
    pub shrinkage: f64,
}

/// The same in the orthogonal basis.
struct InBasis {
    mean: DVector<f64>,
    between: DMatrix<f64>,
    /// Variance of each coefficient from day to day.
    days: DVector<f64>,
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
        OfRun { information: symmetrised(&information), product: self.back.transpose() * &run.product }
    }

    /// A population of those coefficients as one of the model's.
    fn population(&self, of: &InBasis, shrinkage: f64) -> Option<Population> {
        let covariance = |c: &DMatrix<f64>| symmetrised(&(&self.back * c * self.back.transpose()));
        Some(Population {
            mean: &self.back * &of.mean,
            between: covariance(&of.between),
            days: covariance(&bounded(&DMatrix::from_diagonal(&of.days), &self.precision)?),
            shrinkage,
        })
    }
}

/// Weights of the diagonal that are tried, in multiples of the number of coefficients: from a covariance that is taken as it is found to one without
/// correlations.
const WEIGHTS: [f64; 5] = [0.1, 0.5, 2.0, 8.0, 32.0];
/// Steps of expectation and maximisation; the likelihood changes by less than a hundredth of a unit of its logarithm behind them.
const STEPS: usize = 60;
/// Parts into which the units are cut to choose the weight.
const PARTS: usize = 5;
/// Fewest units of a family: a mean and a spread of each coefficient, and units left out to choose the weight.
pub const FEWEST: usize = 4;
/// Smallest variance, as a share of the mean square of a coefficient: keeps the covariance invertible.
const LEAST: f64 = 1e-8;

/// Facts of a unit's runs once the days are integrated out.
struct Expected {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    /// By coefficient: sum over the days of the expected square of a day's part.
    day_squares: DVector<f64>,
    /// Log likelihood, up to what does not depend on the population.
    likelihood: f64,
}

fn inverse(m: &DMatrix<f64>) -> Option<(DMatrix<f64>, Cholesky<f64, Dyn>)> {
    let f = m.clone().cholesky()?;
    Some((f.inverse(), f))
}

impl InBasis {
    /// Its likelihood for a unit, and what it expects of the unit.
    fn expect(&self, unit: &OfUnit) -> Option<Expected> {
        let p = self.mean.len();
        let (precision, of_between) = inverse(&self.between)?;
        let (mut information, mut product) = (precision.clone(), &precision * &self.mean);
        let mut likelihood = -0.5 * self.mean.dot(&product) - 0.5 * log_determinant(&of_between);
        let root = self.days.map(f64::sqrt);
        let mut each = Vec::new();
        for run in &unit.runs {
            // (I + D^1/2 G D^1/2), D the variances of the days: where one is zero it is no unknown.
            let m = DMatrix::from_fn(p, p, |i, j| {
                root[i] * run.information[(i, j)] * root[j] + f64::from(u8::from(i == j))
            });
            let (inner, f) = inverse(&m)?;
            let days = DMatrix::from_fn(p, p, |i, j| root[i] * inner[(i, j)] * root[j]);
            let gd = &run.information * &days;
            information += &run.information - &gd * &run.information;
            product += &run.product - &gd * &run.product;
            likelihood += 0.5 * (run.product.transpose() * &days * &run.product)[(0, 0)] - 0.5 * log_determinant(&f);
            each.push(days);
        }
        let (covariance, f) = inverse(&information)?;
        let mean = &covariance * &product;
        likelihood += 0.5 * mean.dot(&product) - 0.5 * log_determinant(&f);
        let mut day_squares = DVector::zeros(p);
        for (run, days) in unit.runs.iter().zip(&each) {
            let off = days * (&run.product - &run.information * &mean);
            let dg = days * &run.information;
            let spread = days + &dg * &covariance * dg.transpose();
            for j in 0..p {
                day_squares[j] += off[j] * off[j] + spread[(j, j)];
            }
        }
        Some(Expected { mean, covariance, day_squares, likelihood })
    }

    /// One step of expectation and maximisation.
    fn step(&self, units: &[&OfUnit], basis: &Basis, weight: f64) -> Option<(Self, f64)> {
        let (p, n) = (self.mean.len(), units.len() as f64);
        let expected: Vec<Expected> = units.iter().map(|u| self.expect(u)).collect::<Option<_>>()?;
        let mean = expected.iter().map(|e| &e.mean).sum::<DVector<f64>>() / n;
        let mut between = DMatrix::zeros(p, p);
        for e in &expected {
            let off = &e.mean - &mean;
            between += &e.covariance + &off * off.transpose();
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
        let between = bounded(&between, &basis.precision)?;
        let mean = {
            let (precision, _) = inverse(&between)?;
            let sum = &precision * (&mean * n);
            inverse(&(precision * n + &basis.precision))?.0 * sum
        };
        // A unit of one run does not part its day from itself.
        let several: Vec<(usize, &Expected)> =
            units.iter().map(|u| u.runs.len()).zip(&expected).filter(|(runs, _)| *runs > 1).collect();
        let runs = several.iter().map(|(runs, _)| runs).sum::<usize>() as f64;
        let days = if several.is_empty() {
            DVector::zeros(p)
        } else {
            several.iter().map(|(_, e)| &e.day_squares).sum::<DVector<f64>>() / runs
        };
        let likelihood = expected.iter().map(|e| e.likelihood).sum();
        Some((Self { mean, between, days }, likelihood))
    }

    fn with_weight(units: &[&OfUnit], basis: &Basis, weight: f64) -> Option<Self> {
        let mut now = Self::first(units, basis)?;
        for _ in 0..STEPS {
            now = now.step(units, basis, weight)?.0;
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
        let days = between.diagonal() * 0.01;
        let several = units.iter().any(|u| u.runs.len() > 1);
        Some(Self { mean, between, days: if several { days } else { DVector::zeros(p) } })
    }

    /// The population for a unit that it was not learnt from: mean and variances of `n` units are uncertain themselves, and the predictive
    /// distribution is Student's with the variance (n + 1) / (n - 3) times theirs (n / 2 where there are few).
    fn of_a_new_unit(mut self, n: usize) -> Self {
        let n = n as f64;
        self.between *= (n + 1.0) / (n - 3.0).max(0.5 * n);
        self
    }
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
        let score = |weight: f64| -> Option<f64> {
            (0..PARTS.min(units.len()))
                .map(|part| {
                    let (out, rest): (Vec<_>, Vec<_>) =
                        units.iter().enumerate().partition(|(k, _)| k % PARTS.min(units.len()) == part);
                    let rest: Vec<&OfUnit> = rest.into_iter().map(|(_, u)| u).collect();
                    let learnt = InBasis::with_weight(&rest, &basis, weight)?.of_a_new_unit(rest.len());
                    out.iter().map(|(_, u)| Some(learnt.expect(u)?.likelihood)).sum::<Option<f64>>()
                })
                .sum()
        };
        let scored = WEIGHTS.into_iter().filter_map(|w| Some((score(w * p)?, w * p)));
        let (_, weight) = scored.max_by(|x, y| x.0.total_cmp(&y.0))?;
        let all: Vec<&OfUnit> = units.iter().collect();
        let learnt = InBasis::with_weight(&all, &basis, weight)?.of_a_new_unit(units.len());
        basis.population(&learnt, weight)
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
                    OfRun { product: g.component_mul(&v), information: DMatrix::from_diagonal(&g) }
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
    fn a_handful_is_no_family() {
        assert!(Population::learn(&units(FEWEST - 1, 2, 0.1, 3), &[]).is_none());
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        assert!(rng.random_bool(1.0) && Population::learn(&units(FEWEST, 1, 0.1, 3), &[]).is_some());
    }
}
