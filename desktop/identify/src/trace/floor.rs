//! The noise floor, and how many floors are left.
//!
//! The floor is the deviation of 100 s means of a run if noise is all there is. Its noise models are those of the search ([`super::noise`]),
//! weighted by a likelihood that is restricted further: whatever changes more slowly than in 20 minutes is taken out of the residual
//! as a nuisance (cosines up to that period), for physics that follows temperature hardly moves between neighbouring means, and a model that
//! lacks something must not raise its own floor. So the white part and the beginning of the slow part are measured, and the noise models
//! say how far such noise scatters over the whole run. The spread of their answers is the interval of the ratio.

use super::means::Means;
use super::noise::{Basis, Filters, NoiseModel, NOISE_MODELS};
use hrg_data::numeric::stats::{dot, log_sum, mean};
use serde::Serialize;

/// Means in a period of the fastest change that is taken for a nuisance: 20 minutes.
const PERIOD_MEANS: usize = 12;
/// Means of a piece of a run that has its own nuisances.
pub(super) const PIECE: usize = 120;
/// Fewest means of a piece.
const LEAST: usize = 20;
/// Deviations beyond which a value is a jump and not noise: one value of a piece lies beyond them by chance at the [level](super::odds::LEVEL) of a test.
pub(super) const JUMP: f64 = 3.53;
/// Deviations of a normal distribution that hold 95 %.
const TWO_SIDED: f64 = 1.96;

/// A figure in noise floors with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Ratio {
    /// Deviation over floor.
    pub ratio: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Ratio {
    /// `true` if noise alone may explain it: the interval holds 1.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        self.low <= 1.0
    }
}

impl std::fmt::Display for Ratio {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.2} floors [{:.2}, {:.2}]", self.ratio, self.low, self.high)
    }
}

/// Mean square with values beyond [`JUMP`] deviations cut there.
pub(super) fn robust_square(d: &[f64]) -> f64 {
    let n = d.len().max(1) as f64;
    let mut s = d.iter().map(|x| x * x).sum::<f64>() / n;
    for _ in 0..20 {
        let most = JUMP * JUMP * s;
        // Cutting takes 0.15 % of a Gaussian's square.
        let next = d.iter().map(|x| (x * x).min(most)).sum::<f64>() / n / 0.9985;
        if (next / s - 1.0).abs() < 1e-4 || s <= 0.0 {
            break;
        }
        s = next;
    }
    s
}

/// The judged run's means under one noise model.
#[derive(Debug, Clone, Copy)]
struct Under {
    weight: f64,
    /// Expected variance about the run's mean, (deg/h)^2.
    variance: f64,
    /// Deviation of the logarithm of the variance that a run shows.
    spread: f64,
    /// Variance of the difference between this run's mean and that of the others, (deg/h)^2.
    shift: f64,
}

/// The noise of one axis on the run that is judged.
#[derive(Debug, Clone)]
pub struct Noise {
    each: Vec<Under>,
}

/// A part of a series that has its own nuisances.
struct Piece {
    /// Its values.
    y: Vec<f64>,
    /// Their whitening.
    filters: Filters,
}

impl Piece {
    /// From values with the relative deviation of the white noise of each.
    fn new(values: &[(f64, f64)]) -> Self {
        let (y, relative): (Vec<f64>, Vec<f64>) = values.iter().copied().unzip();
        Self { y, filters: Filters::new(&relative, &[0]) }
    }
}

/// Parts of a series of about [`PIECE`] values, each with the relative deviation of its noise; none is shorter than [`LEAST`].
fn chunks(part: &[(f64, f64)]) -> Vec<Piece> {
    let count = part.len().div_ceil(PIECE).max(1);
    part.chunks(part.len().div_ceil(count).max(1)).filter(|c| c.len() >= LEAST).map(Piece::new).collect()
}

/// Pieces of the finite values of a series, parted where it jumps.
fn pieces(series: &Means) -> Vec<Piece> {
    let both = series.series().iter().copied().zip(series.relative().iter().copied());
    let finite: Vec<(f64, f64)> = both.filter(|(v, _)| v.is_finite()).collect();
    let steps: Vec<f64> = finite.windows(2).map(|w| 2.0 * (w[1].0 - w[0].0) / (w[1].1 + w[0].1)).collect();
    let most = JUMP * robust_square(&steps).sqrt();
    let mut parts = vec![vec![]];
    for (k, v) in finite.iter().enumerate() {
        if k > 0 && steps[k - 1].abs() > most {
            parts.push(vec![]);
        }
        parts.last_mut().into_iter().for_each(|p| p.push(*v));
    }
    parts.iter().flat_map(|p| chunks(p)).collect()
}

/// Cosines over a piece down to the shortest period of a nuisance, the constant first.
fn nuisances(n: usize) -> Vec<Vec<f64>> {
    let cosine =
        |k: usize| (0..n).map(|j| (std::f64::consts::PI * k as f64 * (j as f64 + 0.5) / n as f64).cos()).collect();
    (0..=2 * n / PERIOD_MEANS).map(cosine).collect()
}

/// Remainder of some pieces under a noise model when everything slower than a period is taken out.
struct Fast {
    /// Whitened values.
    left: Vec<f64>,
    /// Values less nuisances.
    free: f64,
    /// Log determinants of noise and nuisances, twice the part of the likelihood that is no square.
    information: f64,
}

impl Fast {
    fn new(noise_model: usize, pieces: &[Piece]) -> Self {
        let (mut left, mut free, mut information) = (Vec::new(), 0.0, 0.0);
        for piece in pieces {
            let mut basis = Basis::default();
            for column in nuisances(piece.y.len()) {
                information += basis.add_measured(piece.filters.whitened(noise_model, &column)).max(1e-300).ln();
            }
            let mut y = piece.filters.whitened(noise_model, &piece.y);
            basis.reduce(&mut y);
            information -= 2.0 * piece.filters.log_determinant(noise_model);
            free += (piece.y.len() - basis.columns.len()) as f64;
            left.extend(y);
        }
        Self { left, free, information }
    }

    /// Variance of the whitened noise.
    fn innovation(&self) -> f64 {
        robust_square(&self.left) * self.left.len() as f64 / self.free
    }

    /// Restricted log-likelihood.
    fn log_likelihood(&self) -> f64 {
        -0.5 * (self.free * self.innovation().max(1e-300).ln() + self.information)
    }
}

impl Noise {
    /// From what is left on the other runs and on the one that is judged. `None` where they are too short.
    #[must_use]
    pub fn new(others: &[Means], judged: &Means) -> Option<Self> {
        let all: Vec<Piece> = others.iter().chain([judged]).flat_map(pieces).collect();
        // Noise that grows with temperature: mean square of its relative deviation on the judged run, and on the others.
        let (here, there) =
            (judged.relative_square(), mean(&others.iter().map(Means::relative_square).collect::<Vec<_>>()));
        let (n, other) = (judged.count(), others.iter().map(Means::count).sum::<usize>());
        if all.is_empty() || n < 4 {
            return None;
        }
        let white = |noise: &NoiseModel| 1.0 / noise.innovation();
        let mut each: Vec<(f64, Under)> = NOISE_MODELS
            .iter()
            .enumerate()
            .filter(|(_, noise)| !noise.is_misfit(n))
            .map(|(noise_model, noise)| {
                let fast = Fast::new(noise_model, &all);
                let innovation = fast.innovation();
                let likelihood = noise.log_prior() + fast.log_likelihood();
                let (variance, square) = noise.of_deviation(n);
                let of_mean = |n: usize, square: f64| noise.of_mean(n) + (square - 1.0) * white(noise) / n as f64;
                let own = of_mean(n, here) + if other > 0 { of_mean(other, there) } else { 0.0 };
                let spread = (2.0 * square / (variance * variance) + 2.0 / fast.free).sqrt();
                let (variance, shift) = (innovation * (variance + (here - 1.0) * white(noise)), innovation * own);
                let under = Under { weight: 0.0, variance, spread, shift };
                (likelihood, under)
            })
            .collect();
        let all = log_sum(&each.iter().map(|e| e.0).collect::<Vec<_>>());
        each.iter_mut().for_each(|(l, u)| u.weight = (*l - all).exp());
        Some(Self { each: each.into_iter().map(|e| e.1).collect() })
    }

    /// Variance below which the run's own lies with a probability, noise alone.
    fn quantile(&self, deviations: f64) -> f64 {
        let probability = normal(deviations);
        let below = |log: f64| -> f64 {
            self.each.iter().map(|u| u.weight * normal((log - u.variance.max(1e-300).ln()) / u.spread)).sum()
        };
        let logs = self.each.iter().map(|u| u.variance.max(1e-300).ln());
        let (mut low, mut high) =
            (logs.clone().fold(f64::INFINITY, f64::min) - 6.0, logs.fold(f64::NEG_INFINITY, f64::max) + 6.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if below(middle) < probability {
                low = middle;
            } else {
                high = middle;
            }
        }
        (0.5 * (low + high)).exp()
    }

    /// Deviation of 100 s means if noise is all there is.
    #[must_use]
    pub fn floor(&self) -> f64 {
        self.quantile(0.0).sqrt()
    }

    /// A deviation in floors; `predicted` is the variance that the model's own uncertainty adds.
    #[must_use]
    pub fn ratio(&self, deviation: f64, predicted: f64) -> Ratio {
        Ratio {
            ratio: deviation / self.floor(),
            low: deviation / (self.quantile(TWO_SIDED) + predicted).sqrt(),
            high: deviation / self.quantile(-TWO_SIDED).sqrt(),
        }
    }

    /// Standard deviation of the difference between the means of two runs.
    #[must_use]
    pub fn shift(&self) -> f64 {
        self.each.iter().map(|u| u.weight * u.shift).sum::<f64>().sqrt()
    }
}

/// Probability that a normal value lies below so many deviations (Abramowitz and Stegun 1964, 7.1.26, to 1.5e-7).
fn normal(x: f64) -> f64 {
    let z = x.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * z);
    let sum =
        t * (0.254_829_592 + t * (-0.284_496_736 + t * (1.421_413_741 + t * (-1.453_152_027 + t * 1.061_405_429))));
    let tail = 0.5 * sum * (-z * z).exp();
    if x < 0.0 {
        tail
    } else {
        1.0 - tail
    }
}

impl NoiseModel {
    /// Covariance of two values so many rows apart, over the variance of the whitened noise.
    fn covariance(&self, apart: usize) -> f64 {
        let (phi, theta) = (self.phi, self.theta);
        if phi == 0.0 {
            return if apart == 0 { 1.0 } else { 0.0 };
        }
        let own = (1.0 + theta * theta - 2.0 * phi * theta) / (1.0 - phi * phi);
        match apart {
            0 => own,
            k => (phi * own - theta) * phi.powi(k as i32 - 1),
        }
    }

    /// Variance of the mean of so many values.
    fn of_mean(&self, n: usize) -> f64 {
        let sum: f64 = (1..n).map(|k| 2.0 * (n - k) as f64 * self.covariance(k)).sum();
        (n as f64 * self.covariance(0) + sum) / (n * n) as f64
    }

    /// Expected variance of so many values about their mean, and the trace that its own variance is twice of.
    fn of_deviation(&self, n: usize) -> (f64, f64) {
        let size = n as f64;
        let covariances: Vec<f64> = (0..n).map(|k| self.covariance(k)).collect();
        // Sums of the rows of the covariance matrix.
        let mut before = vec![0.0; n + 1];
        for k in 0..n {
            before[k + 1] = before[k] + covariances[k];
        }
        let rows: Vec<f64> = (0..n).map(|k| before[k + 1] + before[n - k] - covariances[0]).collect();
        let all: f64 = rows.iter().sum();
        let squares: f64 =
            size * covariances[0].powi(2) + (1..n).map(|k| 2.0 * (n - k) as f64 * covariances[k].powi(2)).sum::<f64>();
        let square = squares - 2.0 / size * dot(&rows, &rows) + (all / size).powi(2);
        ((size * covariances[0] - all / size) / (size - 1.0), square / (size - 1.0).powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_data::numeric::stats::{quantile, std_dev};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn drawn(rng: &mut ChaCha8Rng) -> f64 {
        StandardNormal.sample(rng)
    }

    /// Means of noise of another make: white and five first-order processes.
    fn noise(n: usize, slow: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut out: Vec<f64> = (0..n).map(|_| drawn(rng)).collect();
        for tau in [1.0f64, 3.0, 10.0, 30.0, 100.0] {
            let keep = (-1.0 / tau).exp();
            let mut x = drawn(rng);
            for o in &mut out {
                x = keep * x + (1.0 - keep * keep).sqrt() * drawn(rng);
                *o += slow * x;
            }
        }
        out
    }

    fn of(judged: &[f64], other: &[f64]) -> Noise {
        Noise::new(&[Means::of_means(other)], &Means::of_means(judged)).expect("long enough")
    }

    #[test]
    fn clean_runs_are_noise_whatever_their_spectrum() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for slow in [0.0, 0.1, 0.2, 0.4] {
            let mut alarms = 0;
            let mut off = Vec::new();
            for _ in 0..200 {
                let (a, b) = (noise(300, slow, &mut rng), noise(250, slow, &mut rng));
                let r = of(&a, &b).ratio(std_dev(&a), 0.0);
                alarms += usize::from(!r.is_noise());
                off.push(r.ratio);
            }
            assert!(alarms <= 10, "slow {slow}: {alarms} of 200");
            let middle = quantile(&off, 0.5);
            assert!((0.9..1.12).contains(&middle), "slow {slow}: {middle}");
        }
    }

    #[test]
    fn structure_is_seen() {
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for (floors, least) in [(2.0f64, 95), (3.0, 100)] {
            let mut seen = 0;
            for _ in 0..100 {
                let (mut a, b) = (noise(300, 0.1, &mut rng), noise(250, 0.1, &mut rng));
                // So many floors in all, with a period of two hours.
                let size = (floors * floors - 1.0).sqrt() * 2f64.sqrt() * std_dev(&a);
                a.iter_mut()
                    .enumerate()
                    .for_each(|(k, v)| *v += size * (k as f64 / 72.0 * std::f64::consts::TAU).sin());
                seen += usize::from(!of(&a, &b).ratio(std_dev(&a), 0.0).is_noise());
            }
            assert!(seen >= least, "{floors} floors: {seen} of 100");
        }
    }

    #[test]
    fn noise_that_grows_with_temperature_has_its_own_floor_in_each_run() {
        // A cold run, and a hot one that is judged, four times as loud; a bit of the noise is slow and does not grow.
        let mut rng = ChaCha8Rng::seed_from_u64(10);
        let mut off = Vec::new();
        for _ in 0..100 {
            let mut loud = |by: f64| -> Vec<f64> {
                let mut slow = 0.0;
                let mut next = |_| {
                    slow = 0.95 * slow + 0.1 * drawn(&mut rng);
                    slow + by * drawn(&mut rng)
                };
                (0..300).map(&mut next).collect()
            };
            let (hot, cold) = (loud(2.0), loud(0.5));
            let means =
                |v: &[f64], by: f64| Means::with_relative(&each(v), &each(&vec![by; v.len()]), crate::fit::MEAN_S);
            let (judged, other) = (means(&hot, 2.0), means(&cold, 0.5));
            let of = Noise::new(&[other], &judged).expect("long enough");
            off.push(of.ratio(std_dev(&hot), 0.0).ratio);
        }
        let middle = quantile(&off, 0.5);
        assert!((0.95..1.06).contains(&middle), "{middle}");
    }

    /// A series of means on every step.
    fn each(means: &[f64]) -> Vec<f64> {
        means.iter().flat_map(|m| std::iter::repeat_n(*m, crate::fit::MEAN_S)).collect()
    }

    #[test]
    fn a_jump_does_not_raise_the_floor() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let (mut a, b) = (noise(300, 0.0, &mut rng), noise(250, 0.0, &mut rng));
        let before = of(&a, &b).floor();
        a[150..].iter_mut().for_each(|v| *v += 30.0);
        let after = of(&a, &b).floor();
        assert!((after / before - 1.0).abs() < 0.1, "{before} {after}");
        assert!(Noise::new(&[], &Means::of_means(&a[..8])).is_none());
    }

    #[test]
    fn the_variance_of_a_run_is_that_of_its_covariance() {
        for model in NOISE_MODELS {
            let n = 40;
            let r = nalgebra::DMatrix::from_fn(n, n, |i, j| model.covariance(i.abs_diff(j)));
            let h = nalgebra::DMatrix::from_fn(n, n, |i, j| f64::from(u8::from(i == j)) - 1.0 / n as f64);
            let hr = &h * &r;
            let (variance, square) = model.of_deviation(n);
            assert!((variance - hr.trace() / (n - 1) as f64).abs() < 1e-9 * variance.max(1.0), "{model:?}");
            let trace = (&hr * &hr).trace() / ((n - 1) * (n - 1)) as f64;
            assert!((square - trace).abs() < 1e-9 * trace.max(1.0), "{model:?}: {square} {trace}");
            assert!((model.of_mean(n) - r.sum() / (n * n) as f64).abs() < 1e-9, "{model:?}");
        }
    }
}
