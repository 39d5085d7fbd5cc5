//! 100 s means of a residual.

use crate::fit::MEAN_S;
use hrg_data::numeric::stats::{block_means, mean, std_dev};

/// 100 s means of a residual.
#[derive(Debug, Clone)]
pub struct Means(Vec<f64>);

impl Means {
    /// Of a residual on every step.
    pub fn of(residual: &[f64]) -> Self {
        Self(block_means(residual, MEAN_S))
    }

    /// A series that already is one of means.
    pub fn of_means(means: &[f64]) -> Self {
        Self(means.to_vec())
    }

    /// Standard deviation about their mean.
    pub fn deviation(&self) -> f64 {
        std_dev(&self.0)
    }

    /// Their mean.
    pub fn mean(&self) -> f64 {
        mean(&self.0)
    }

    /// Number of finite means.
    pub fn count(&self) -> usize {
        self.0.iter().filter(|v| v.is_finite()).count()
    }

    /// The series; NaN marks a gap.
    pub fn series(&self) -> &[f64] {
        &self.0
    }
}

/// Standard deviation of 100 s means of several runs together, each about its own mean, and how many means there are.
pub fn spread<'s>(series: impl IntoIterator<Item = &'s Vec<f64>>) -> (f64, usize) {
    let (mut squares, mut count, mut runs) = (0.0, 0usize, 0usize);
    for s in series {
        let m = Means::of(s);
        let n = m.count();
        if n > 1 {
            squares += m.deviation().powi(2) * (n - 1) as f64;
            count += n;
            runs += 1;
        }
    }
    (if count > runs { (squares / (count - runs) as f64).sqrt() } else { 0.0 }, count)
}

/// Fall of the mean square error from one residual to another of the same run, and the deviation that noise of a floor gives it.
pub fn fall(before: &Means, after: &Means, floor: f64) -> (f64, f64) {
    let both = before.0.iter().zip(&after.0).filter(|(b, a)| b.is_finite() && a.is_finite());
    let rows: Vec<(f64, f64)> = both.map(|(b, a)| (*b, b - a)).collect();
    let n = rows.len().max(1) as f64;
    let (mb, md) = rows.iter().fold((0.0, 0.0), |(b, d), r| (b + r.0 / n, d + r.1 / n));
    let (product, power) =
        rows.iter().fold((0.0, 0.0), |(p, q), r| (p + (r.0 - mb) * (r.1 - md), q + (r.1 - md).powi(2)));
    ((2.0 * product - power) / n, 2.0 * floor * power.sqrt() / n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_judged_about_their_own_mean() {
        let (a, mut b) = (vec![1.0; 3000], vec![5.0; 3000]);
        b[..1500].fill(5.5);
        let (s, n) = spread([&a, &b]);
        assert!(s < 0.3 && n == 60, "{s} {n}");
    }
}
