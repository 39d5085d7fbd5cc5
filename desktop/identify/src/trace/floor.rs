//! The noise floor, and how many floors are left.
//!
//! Noise is the difference of two neighbouring 100 s means: physics that follows temperature hardly moves between them. So the floor comes
//! from these differences (Allan variance at 100 s). The residual's own deviation also holds whatever structure a model has left.
//!
//! Gyro noise is not white: it flickers, so a run of hours scatters by more than its neighbours differ. The excess depends on its spectrum,
//! of which neighbours show a little: the Allan variance at 200 s against that at 100 s. [`Clean`] holds a few thousand series of pure
//! noise with spectra `1 + h / f^a` of all plausible `h` and `a`, as long as the runs at hand. Those whose two Allan variances relate as
//! the measured ones do give the distribution of the ratio of a clean run's deviation to the difference of its neighbours. Its median makes
//! the floor; its quantiles the interval of the ratio.

use hrg_data::numeric::stats::{quantile, std_dev};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use realfft::num_complex::Complex64;
use realfft::RealFftPlanner;
use serde::Serialize;

/// Series of pure noise behind a distribution.
const SERIES: usize = 2400;
/// Those among them whose short-time spectrum is nearest to the measured one.
const NEAREST: usize = 300;
/// Exponents of the slow part of the spectrum.
const EXPONENTS: [f64; 8] = [0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4, 1.5];
/// Probability left outside the interval on either side.
const TAIL: f64 = 0.025;

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

/// Ratio from which on the rest is not called noise, however wide its interval is: slow noise and structure look alike there.
const UNDECIDED: f64 = 1.6;

impl Ratio {
    /// `true` if noise alone explains it: the interval holds 1, and the ratio itself is not beyond that of clean runs.
    #[must_use]
    pub fn is_noise(&self) -> bool {
        self.low <= 1.0 && self.ratio < UNDECIDED
    }
}

impl std::fmt::Display for Ratio {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.2} floors [{:.2}, {:.2}]", self.ratio, self.low, self.high)
    }
}

/// Mean squares of differences of neighbouring means, robust against single jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbours {
    /// Allan variance at one mean.
    pub one: f64,
    /// Allan variance at two means.
    pub two: f64,
    /// Differences behind `one`.
    pub count: usize,
}

/// Deviations beyond which a difference is a jump and not noise.
const JUMP: f64 = 3.5;

/// Mean square with values beyond [`JUMP`] deviations cut there.
fn robust_square(d: &[f64]) -> f64 {
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

impl Neighbours {
    /// From one or more series of means; NaN marks a gap. `None` with fewer than ten pairs.
    #[must_use]
    pub fn of(series: &[&[f64]]) -> Option<Self> {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let finite = |w: &&[f64]| w.iter().all(|v| v.is_finite());
        let one: Vec<f64> =
            series.iter().flat_map(|s| s.windows(2).filter(finite).map(|w| half * (w[1] - w[0]))).collect();
        let two: Vec<f64> = series
            .iter()
            .flat_map(|s| s.windows(4).filter(finite).map(|w| 0.5 * half * (w[3] + w[2] - w[1] - w[0])))
            .collect();
        (one.len() >= 10 && two.len() >= 5).then(|| Self {
            one: robust_square(&one),
            two: robust_square(&two),
            count: one.len(),
        })
    }

    /// Log ratio of the two mean squares, which identifies the noise model: near -0.69 for white noise, 0 for flicker.
    fn noise_model(&self) -> f64 {
        (self.two.max(1e-300) / self.one.max(1e-300)).ln()
    }
}

/// One series of pure noise, in two parts: what it shows at short times, and how it scatters.
#[derive(Debug, Clone, Copy)]
struct Draw {
    noise_model: f64,
    /// Deviation of the judged part over the root of the Allan variance of both.
    spread: f64,
    /// Mean of the judged part less that of the other, in the same unit.
    shift: f64,
}

/// Distributions of clean noise for runs of given lengths.
#[derive(Debug, Clone)]
pub struct Clean {
    draws: Vec<Draw>,
    judged: usize,
}

impl Clean {
    /// For a run of `judged` means that is judged, with `other` means of other runs known beside it.
    #[must_use]
    pub fn new(judged: usize, other: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (judged, other) = (judged.clamp(4, 4096), other.min(4096));
        let length = (2 * (judged + other)).next_power_of_two().max(64);
        let mut planner = RealFftPlanner::<f64>::new();
        let back = planner.plan_fft_inverse(length);
        let mut spectrum = back.make_input_vec();
        let mut series = back.make_output_vec();
        let slow: Vec<Vec<f64>> = EXPONENTS.iter().map(|a| averaged(length, *a)).collect();
        let draws = (0..SERIES)
            .map(|_| {
                let exponent = rng.random_range(0..EXPONENTS.len());
                // Share of the slow part, at the frequency of one cycle in ten means: any order of magnitude, or none.
                let share = if rng.random_bool(0.25) { 0.0 } else { 10f64.powf(rng.random_range(-2.5..0.5)) };
                let level = share * 0.1f64.powf(EXPONENTS[exponent]);
                for (k, s) in spectrum.iter_mut().enumerate() {
                    let amplitude = (1.0 + level * slow[exponent][k]).sqrt();
                    *s = Complex64::new(normal(&mut rng), normal(&mut rng)) * amplitude;
                }
                // The mean of all is no matter; the two ends of a real spectrum have no phase.
                spectrum[0] = Complex64::ZERO;
                if let Some(last) = spectrum.last_mut() {
                    last.im = 0.0;
                }
                let _ = back.process(&mut spectrum, &mut series);
                draw(&series[..judged], &series[length - other..])
            })
            .collect();
        Self { draws, judged }
    }

    /// Draws whose short-time spectrum is nearest to the measured one.
    fn nearest(&self, n: &Neighbours) -> Vec<Draw> {
        let mut draws = self.draws.clone();
        let off = |d: &Draw| (d.noise_model - n.noise_model()).abs();
        draws.select_nth_unstable_by(NEAREST - 1, |x, y| off(x).total_cmp(&off(y)));
        draws.truncate(NEAREST);
        draws
    }

    /// The floor: the deviation of the judged run's means if they are noise alone, in the unit of the means.
    #[must_use]
    pub fn floor(&self, n: &Neighbours) -> f64 {
        let spreads: Vec<f64> = self.nearest(n).iter().map(|d| d.spread).collect();
        quantile(&spreads, 0.5) * n.one.sqrt()
    }

    /// A deviation of the judged run in floors. `predicted` is the variance that the uncertainty of the model's coefficients
    /// adds on that run.
    #[must_use]
    pub fn ratio(&self, n: &Neighbours, deviation: f64, predicted: f64) -> Ratio {
        let unit = n.one.sqrt();
        let more = if n.one > 0.0 { predicted / n.one } else { 0.0 };
        let plain: Vec<f64> = self.nearest(n).iter().map(|d| d.spread).collect();
        let wider: Vec<f64> = plain.iter().map(|s| (s * s + more).sqrt()).collect();
        Ratio {
            ratio: deviation / (quantile(&plain, 0.5) * unit),
            low: deviation / (quantile(&wider, 1.0 - TAIL) * unit),
            high: deviation / (quantile(&plain, TAIL) * unit),
        }
    }

    /// Standard deviation of the difference of the two runs' means if both are the same unit's noise.
    #[must_use]
    pub fn shift(&self, n: &Neighbours) -> f64 {
        std_dev(&self.nearest(n).iter().map(|d| d.shift).collect::<Vec<_>>()) * n.one.sqrt()
    }

    /// Means of the judged run.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.judged
    }
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

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// Power of `1 / f^a` noise after averaging over one mean, with what aliases, at the frequencies of a transform; at 0 none.
fn averaged(length: usize, a: f64) -> Vec<f64> {
    (0..=length / 2)
        .map(|k| {
            if k == 0 {
                return 0.0;
            }
            let f = k as f64 / length as f64;
            (-2..=2)
                .map(|alias| {
                    let g = (f + f64::from(alias)).abs();
                    let x = std::f64::consts::PI * g;
                    (x.sin() / x).powi(2) * g.powf(-a)
                })
                .sum()
        })
        .collect()
}

fn draw(judged: &[f64], other: &[f64]) -> Draw {
    let n = Neighbours::of(&[judged, other]).or_else(|| Neighbours::of(&[judged]));
    let Some(n) = n else { return Draw { noise_model: 0.0, spread: 1.0, shift: 0.0 } };
    let mean = |v: &[f64]| if v.is_empty() { 0.0 } else { v.iter().sum::<f64>() / v.len() as f64 };
    let unit = n.one.sqrt();
    Draw { noise_model: n.noise_model(), spread: std_dev(judged) / unit, shift: (mean(judged) - mean(other)) / unit }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means of noise of another make: white and five first-order processes.
    fn noise(n: usize, slow: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut out: Vec<f64> = (0..n).map(|_| normal(rng)).collect();
        for tau in [1.0f64, 3.0, 10.0, 30.0, 100.0] {
            let keep = (-1.0 / tau).exp();
            let mut x = normal(rng);
            for o in &mut out {
                x = keep * x + (1.0 - keep * keep).sqrt() * normal(rng);
                *o += slow * x;
            }
        }
        out
    }

    #[test]
    fn clean_runs_are_noise_whatever_their_colour() {
        let clean = Clean::new(300, 250, 1);
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for slow in [0.0, 0.1, 0.2, 0.4] {
            let mut alarms = 0;
            let mut off = Vec::new();
            for _ in 0..200 {
                let (a, b) = (noise(300, slow, &mut rng), noise(250, slow, &mut rng));
                let n = Neighbours::of(&[&a, &b]).expect("long enough");
                let r = clean.ratio(&n, std_dev(&a), 0.0);
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
        let clean = Clean::new(300, 250, 1);
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        for (floors, least) in [(1.5f64, 70), (2.0, 98)] {
            let mut seen = 0;
            for _ in 0..100 {
                let (mut a, b) = (noise(300, 0.1, &mut rng), noise(250, 0.1, &mut rng));
                // So many floors in all, with a period of two hours.
                let size = (floors * floors - 1.0).sqrt() * 2f64.sqrt() * std_dev(&a);
                a.iter_mut()
                    .enumerate()
                    .for_each(|(k, v)| *v += size * (k as f64 / 72.0 * std::f64::consts::TAU).sin());
                let n = Neighbours::of(&[&a, &b]).expect("long enough");
                seen += usize::from(!clean.ratio(&n, std_dev(&a), 0.0).is_noise());
            }
            assert!(seen >= least, "{floors} floors: {seen} of 100");
        }
    }

    #[test]
    fn a_jump_does_not_raise_the_floor() {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut a = noise(300, 0.0, &mut rng);
        let before = Neighbours::of(&[&a]).expect("long enough").one;
        a[150..].iter_mut().for_each(|v| *v += 30.0);
        let after = Neighbours::of(&[&a]).expect("long enough").one;
        assert!((after / before - 1.0).abs() < 0.1, "{before} {after}");
        assert!(Neighbours::of(&[&a[..8]]).is_none());
    }
}
