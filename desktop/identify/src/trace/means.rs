//! Means of a residual, over the seconds that the runs of a trace have agreed on: 100, or less where they are short.

use hrg_data::numeric::stats::{block_means, dot, mean, std_dev};

/// Means of a residual.
#[derive(Debug, Clone)]
pub struct Means {
    values: Vec<f64>,
    /// Relative deviation of the noise of each; 1 where it is not known.
    relative: Vec<f64>,
}

impl Means {
    /// Of a residual on every step.
    pub fn of(residual: &[f64], mean_s: usize) -> Self {
        Self::of_means(&block_means(residual, mean_s))
    }

    /// Of a residual on every step, whose noise has a relative deviation there.
    pub fn with_relative(residual: &[f64], relative: &[f64], mean_s: usize) -> Self {
        let relative = block_means(relative, mean_s).iter().map(|r| if r.is_finite() { *r } else { 1.0 }).collect();
        Self { values: block_means(residual, mean_s), relative }
    }

    /// A series that already is one of means.
    pub fn of_means(means: &[f64]) -> Self {
        Self { values: means.to_vec(), relative: vec![1.0; means.len()] }
    }

    /// Relative deviation of the noise of each.
    pub fn relative(&self) -> &[f64] {
        &self.relative
    }

    /// Mean square of the relative deviation of the finite ones.
    pub fn relative_square(&self) -> f64 {
        let squares = self.values.iter().zip(&self.relative).filter(|(v, _)| v.is_finite()).map(|(_, r)| r * r);
        mean(&squares.collect::<Vec<_>>())
    }

    /// Standard deviation about their mean.
    pub fn deviation(&self) -> f64 {
        std_dev(&self.values)
    }

    /// Deviation of their mean square about the mean, as a share of it, as far as the series tells how it swings: `(sum of rho(k)^2 / n)^0.5` over
    /// all lags `k`, where `rho` is its sample autocorrelation (Bartlett 1946).
    pub fn spread_of_square(&self) -> f64 {
        let mean = self.mean();
        let about: Vec<f64> = self.values.iter().map(|v| if v.is_finite() { v - mean } else { 0.0 }).collect();
        let square = dot(&about, &about).max(1e-300);
        let rho = |k: usize| dot(&about[k..], &about[..about.len() - k]) / square;
        ((1.0 + 2.0 * (1..about.len()).map(|k| rho(k).powi(2)).sum::<f64>()) / self.count().max(1) as f64).sqrt()
    }

    /// Their mean.
    pub fn mean(&self) -> f64 {
        mean(&self.values)
    }

    /// Number of finite means.
    pub fn count(&self) -> usize {
        self.values.iter().filter(|v| v.is_finite()).count()
    }

    /// The series; NaN marks a gap.
    pub fn series(&self) -> &[f64] {
        &self.values
    }
}

/// Standard deviation of the means of several runs together, each about its own mean, and how many means there are.
pub fn spread<'s>(series: impl IntoIterator<Item = &'s Vec<f64>>, mean_s: usize) -> (f64, usize) {
    let (mut squares, mut count, mut runs) = (0.0, 0usize, 0usize);
    for s in series {
        let m = Means::of(s, mean_s);
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
    let both = before.values.iter().zip(&after.values).filter(|(b, a)| b.is_finite() && a.is_finite());
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
    use rand::{Rng, SeedableRng};

    #[test]
    fn a_mean_square_is_known_by_how_often_the_series_swings() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let white: Vec<f64> = (0..400).map(|_| random.random_range(-1.0..1.0)).collect();
        let expected = (2.0f64 / 400.0).sqrt();
        assert!((Means::of_means(&white).spread_of_square() / expected - 1.0).abs() < 0.15);
        let swings = |count: f64| -> Vec<f64> { (0..400).map(|k| (f64::from(k) * count * 0.0157).sin()).collect() };
        let one = Means::of_means(&swings(1.0)).spread_of_square();
        assert!((0.4..0.9).contains(&one), "{one}");
        // A gap adds nothing.
        let mut gaps = white.clone();
        gaps[100..200].fill(f64::NAN);
        let with = Means::of_means(&gaps).spread_of_square();
        assert!((with / (2.0f64 / 300.0).sqrt() - 1.0).abs() < 0.2, "{with}");
    }

    #[test]
    fn runs_are_judged_about_their_own_mean() {
        let (a, mut b) = (vec![1.0; 3000], vec![5.0; 3000]);
        b[..1500].fill(5.5);
        let (s, n) = spread([&a, &b], 100);
        assert!(s < 0.3 && n == 60, "{s} {n}");
    }
}
