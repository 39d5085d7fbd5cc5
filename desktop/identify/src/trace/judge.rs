//! The judgement on the verify run: what each model leaves there, whether one is better than another by more than chance,
//! and how many noise floors are left.

use super::floor::{Clean, Neighbours, Ratio};
use super::report::Agreement;
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

/// The noise of one axis on one run, and the distribution by which it is judged.
#[derive(Debug, Clone, Copy)]
pub struct Noise<'c> {
    /// Mean squares of the differences of neighbouring means.
    pub neighbours: Neighbours,
    /// Distributions of noise for runs of these lengths.
    pub clean: &'c Clean,
}

impl Noise<'_> {
    /// Deviation of 100 s means if noise is all there is.
    pub fn floor(&self) -> f64 {
        self.clean.floor(&self.neighbours)
    }

    /// A deviation in floors; `predicted` is the variance that the model's own uncertainty adds.
    pub fn ratio(&self, deviation: f64, predicted: f64) -> Ratio {
        self.clean.ratio(&self.neighbours, deviation, predicted)
    }

    /// Standard deviation of the difference between the means of two runs.
    pub fn shift(&self) -> f64 {
        self.clean.shift(&self.neighbours)
    }
}

/// Share of the series over which neighbouring products are summed for the uncertainty of a sum.
const LAGS: f64 = 0.125;

/// Share of the predicted difference between `larger` and `smaller` that the run shows: both are residuals of the same run. The residual of
/// the smaller one is fitted by the difference of their predictions; the slope is 1 if the larger one is right. `floor` is the deviation of
/// the noise.
///
/// The uncertainty is that of a sum of correlated products (Newey and West 1987), at least that of noise of the floor's
/// size.
pub fn agreement(smaller: &Means, larger: &Means, floor: f64) -> Agreement {
    let rows: Vec<(f64, f64)> = smaller
        .0
        .iter()
        .zip(&larger.0)
        .filter(|(s, l)| s.is_finite() && l.is_finite())
        .map(|(s, l)| (*s, s - l))
        .collect();
    let n = rows.len() as f64;
    if rows.len() < 4 {
        return Agreement::NONE;
    }
    let (ms, md) = rows.iter().fold((0.0, 0.0), |(s, d), r| (s + r.0 / n, d + r.1 / n));
    let e: Vec<f64> = rows.iter().map(|r| r.0 - ms).collect();
    let d: Vec<f64> = rows.iter().map(|r| r.1 - md).collect();
    let power: f64 = d.iter().map(|d| d * d).sum();
    let before_dph2 = e.iter().map(|e| e * e).sum::<f64>() / n;
    if !(power > 1e-9 * n * floor * floor) {
        // The two models are the same on this run.
        return Agreement { share: 1.0, before_dph2, gain_std_dph2: 0.0, ..Agreement::NONE };
    }
    let share = e.iter().zip(&d).map(|(e, d)| e * d).sum::<f64>() / power;
    let products: Vec<f64> = e.iter().zip(&d).map(|(e, d)| (e - share * d) * d).collect();
    let sum_at = |lag: usize| products[lag..].iter().zip(&products).map(|(x, y)| x * y).sum::<f64>();
    let lags = (LAGS * n) as usize;
    let correlated = (1..=lags)
        .map(|lag| 2.0 * (1.0 - lag as f64 / (lags + 1) as f64) * sum_at(lag))
        .fold(sum_at(0), |sum, x| sum + x);
    let share_std = correlated.max(floor * floor * power).sqrt() / power;
    Agreement {
        share,
        share_std,
        before_dph2,
        gain_dph2: (2.0 * share - 1.0) * power / n,
        gain_std_dph2: 2.0 * share_std * power / n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize, size: f64) -> Vec<f64> {
        (0..n).map(|k| size * (k as f64 / 40.0).sin()).collect()
    }

    fn grain(n: usize, seed: u64) -> Vec<f64> {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| StandardNormal.sample(&mut rng)).collect()
    }

    #[test]
    fn what_is_there_wins_and_what_is_not_loses() {
        let n = 300;
        let plus = |a: &[f64], b: &[f64]| Means(a.iter().zip(b).map(|(a, b)| a + b).collect());
        let minus = |a: &Means, b: &[f64]| Means(a.0.iter().zip(b).map(|(a, b)| a - b).collect());
        let mut false_wins = 0;
        for seed in 0..100 {
            let g = grain(n, seed);
            let there = plus(&g, &wave(n, 2.0));
            let right = agreement(&there, &minus(&there, &wave(n, 2.0)), 1.0);
            assert!(right.wins() && (right.share - 1.0).abs() < 5.0 * right.share_std, "{right:?}");
            let twice = agreement(&there, &minus(&there, &wave(n, 5.0)), 1.0);
            assert!(twice.loses(), "{twice:?}");
            let nothing = plus(&g, &wave(n, 0.0));
            false_wins += usize::from(agreement(&nothing, &minus(&nothing, &wave(n, 0.3)), 1.0).wins());
            assert!(agreement(&nothing, &minus(&nothing, &wave(n, 2.0)), 1.0).loses());
        }
        assert!(false_wins <= 2, "{false_wins}");
        let g = Means(grain(n, 1));
        let same = agreement(&g, &g, 1.0);
        assert!(!same.wins() && !same.loses());
    }

    #[test]
    fn runs_are_judged_about_their_own_mean() {
        let (a, mut b) = (vec![1.0; 3000], vec![5.0; 3000]);
        b[..1500].fill(5.5);
        let (s, n) = spread([&a, &b]);
        assert!(s < 0.3 && n == 60, "{s} {n}");
    }
}
