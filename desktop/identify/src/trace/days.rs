//! Gains with a part of the day. On several train runs each part of the model (the baseline's temperature terms, its ramp terms, each effect)
//! may be larger on one day than on the next: its size is a common one, and a share of it that belongs to the day. A part has such a share
//! where the evidence is enough to name anything; the next day's share is uncertain by the deviation of the highest evidence.

use super::data::AxisRows;
use super::odds::{EFFECT, THRESHOLD};
use super::regression::{self, Posterior};
use hrg_data::numeric::stats::log_sum;
use nalgebra::DMatrix;
use std::ops::Range;

/// Deviations that are tried, as shares of the size.
const TRIED: [f64; 3] = [0.05, 0.15, 0.5];

/// A part of a model: its name, and the numbers of its coefficients.
pub type Part = (&'static str, Range<usize>);

/// A part whose size differs from day to day.
#[derive(Debug, Clone)]
pub struct Differs {
    /// Its name.
    pub name: &'static str,
    /// Deviation of its size from day to day, over the size.
    pub relative_std: f64,
    /// The numbers of its coefficients.
    numbers: Range<usize>,
    /// Their values.
    values: Vec<f64>,
    /// Its bias, deg/h.
    bias: Vec<f64>,
}

/// Contribution of the days to the sizes of the parts of a model, one axis.
#[derive(Debug, Clone, Default)]
pub struct OfDays {
    /// The parts that differ.
    pub parts: Vec<Differs>,
    /// Variance of the whitened noise, (deg/h)^2.
    noise_dph2: f64,
}

impl OfDays {
    /// Learns it beside a fit without it: the part that differs most plainly, then the next beside it.
    pub fn new(
        rows: &AxisRows,
        columns: &[Vec<f64>],
        prior: &[Option<f64>],
        mut parts: Vec<Part>,
        without: &Posterior,
    ) -> Self {
        let noise_dph2 = without.each.iter().map(|u| u.weight * u.variance_dph2).sum::<f64>();
        let mut found = Self { parts: Vec::new(), noise_dph2 };
        let mut evidence = without.evidence;
        while rows.starts.len() > 1 && !parts.is_empty() {
            let tried = |part: &Part| {
                let part = Differs::new(rows, columns, part, without);
                let with = |relative_std: &f64| {
                    let mut more = found.clone();
                    more.parts.push(Differs { relative_std: *relative_std, ..part.clone() });
                    Some((more.posterior(rows, columns, prior)?.evidence, more))
                };
                let each: Vec<(f64, Self)> = TRIED.iter().filter_map(with).collect();
                let all = log_sum(&each.iter().map(|e| e.0).collect::<Vec<_>>()) - (TRIED.len() as f64).ln();
                let (at, more) = each.into_iter().max_by(|x, y| x.0.total_cmp(&y.0))?;
                Some((EFFECT + all - evidence, at, more))
            };
            let best = parts.iter().enumerate().filter_map(|(k, p)| Some((k, tried(p)?)));
            let Some((k, (score, at, more))) = best.max_by(|x, y| x.1 .0.total_cmp(&y.1 .0)) else { break };
            if score < THRESHOLD {
                break;
            }
            parts.remove(k);
            (found, evidence) = (more, at);
        }
        found
    }

    /// `true` if the days add anything.
    pub fn there(&self) -> bool {
        !self.parts.is_empty()
    }

    /// The coefficients of some columns, of which the model's come first, for a day that nobody has seen.
    pub fn posterior(&self, rows: &AxisRows, columns: &[Vec<f64>], prior: &[Option<f64>]) -> Option<Posterior> {
        let count = columns.len();
        let (mut all, mut variances) = (columns.to_vec(), prior.to_vec());
        // The common size of a part is free, so that the shares do not take a part of it: coefficients that are shrunk get the whole beside them.
        let mut wholes = Vec::new();
        for part in &self.parts {
            if part.numbers.clone().all(|j| prior[j].is_some()) {
                wholes.push((part, all.len()));
                all.push(part.bias.clone());
                variances.push(None);
            }
            all.extend((0..rows.starts.len()).map(|run| rows.in_run(run, &part.bias)));
            variances.resize(all.len(), Some(part.relative_std * part.relative_std / self.noise_dph2));
        }
        let mut common = DMatrix::identity(count, all.len());
        for (part, at) in wholes {
            for (j, value) in part.numbers.clone().zip(&part.values) {
                common[(j, at)] = *value;
            }
        }
        let mut found = regression::posterior(rows, &all, &variances)?;
        found.coefficients = &common * found.coefficients;
        found.covariance = self.of_another_day(&common * found.covariance * common.transpose());
        for u in &mut found.each {
            u.coefficients = &common * &u.coefficients;
            u.covariance = self.of_another_day(&common * &u.covariance * common.transpose());
        }
        Some(found)
    }

    /// Covariance of the coefficients, with the share of another day.
    fn of_another_day(&self, mut out: DMatrix<f64>) -> DMatrix<f64> {
        for Differs { numbers, values, relative_std, .. } in &self.parts {
            for (i, u) in numbers.clone().zip(values) {
                for (j, v) in numbers.clone().zip(values) {
                    out[(i, j)] += relative_std * relative_std * u * v;
                }
            }
        }
        out
    }
}

impl Differs {
    /// A part of a fit, of which it is not known yet by how much it differs.
    fn new(rows: &AxisRows, columns: &[Vec<f64>], (name, numbers): &Part, fit: &Posterior) -> Self {
        let values: Vec<f64> = numbers.clone().map(|j| fit.coefficients[j]).collect();
        let mut bias = vec![0.0; rows.y.len()];
        for (column, gain) in columns[numbers.clone()].iter().zip(&values) {
            bias.iter_mut().zip(column).for_each(|(b, x)| *b += gain * x);
        }
        Self { name, relative_std: 0.0, numbers: numbers.clone(), values, bias }
    }
}
