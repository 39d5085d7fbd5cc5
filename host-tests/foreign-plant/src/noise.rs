//! Noise of the rate output, per axis.
//!
//! Each part is scaled by what its spectrum must give, so that its 100 s means have a standard deviation of 1 about the mean of a run;
//! the parts are then mixed by shares of variance. The noise that a run really got is measured and goes into the truth.

use crate::draw::Properties;
use crate::means::{deviation, means};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};
use rustfft::{num_complex::Complex, FftPlanner};
use std::f64::consts::PI;
use std::sync::Arc;

use crate::series::Series;

/// Kinds of noise.
#[derive(Clone, Debug)]
pub enum Noise {
    /// White and 1/f, with some random walk and a line now and then: levels differ by unit and axis.
    Usual,
    /// White only.
    White,
    /// White and 1/f^exponent in equal shares.
    Flicker(f64),
    /// White and random walk in equal shares.
    Walk,
    /// White, 1/f and four lines of 3 s to 900 s.
    Lines,
    /// White, and a first-order Gauss-Markov process of 10 to 40 min with three eighths of the variance.
    GaussMarkov,
    /// White whose deviation grows fourfold from cold to hot, and 1/f.
    GrowsWithTemperature,
    /// Student's t with 3 degrees of freedom, and 1/f.
    HeavyTails,
    /// White whose deviation trebles for minutes at random, and 1/f.
    Bursts,
    /// The spectrum of a measured series with random phases, and a little white.
    Series(Arc<Series>),
}

impl Noise {
    /// Name for lists and truth.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Usual => "usual".into(),
            Self::White => "white".into(),
            Self::Flicker(exponent) => format!("flicker-{exponent:.1}"),
            Self::Walk => "walk".into(),
            Self::Lines => "lines".into(),
            Self::GaussMarkov => "gauss-markov".into(),
            Self::GrowsWithTemperature => "grows-with-temperature".into(),
            Self::HeavyTails => "heavy-tails".into(),
            Self::Bursts => "bursts".into(),
            Self::Series(series) => format!("series-{}", series.name),
        }
    }
}

/// Shares of variance of the 100 s means. The unit draws them once for each axis.
#[derive(Clone, Copy, Debug)]
pub struct Mixture {
    white: f64,
    flicker: f64,
    exponent: f64,
    walk: f64,
    lines: f64,
    markov: f64,
    markov_s: f64,
}

impl Mixture {
    /// The mixture of one axis of a unit.
    #[must_use]
    pub fn draw(rng: &mut Properties, noise: &Noise) -> Self {
        let exponent = rng.random_range(0.8..1.4);
        let none = Self { white: 1.0, flicker: 0.0, exponent, walk: 0.0, lines: 0.0, markov: 0.0, markov_s: 1000.0 };
        let some_flicker = Self { flicker: rng.random_range(0.06..0.22), ..none };
        let walk = rng.random_range(0.0..0.04);
        let lines = if rng.random_bool(0.25) { rng.random_range(0.02..0.06) } else { 0.0 };
        let markov_s = rng.random_range(600.0..2400.0);
        match noise {
            Noise::Usual => Self { walk, lines, ..some_flicker },
            Noise::White | Noise::Series(_) => none,
            Noise::Flicker(exponent) => Self { flicker: 1.0, exponent: *exponent, ..none },
            Noise::Walk => Self { walk: 1.0, ..none },
            Noise::Lines => Self { lines: 0.4, ..some_flicker },
            Noise::GaussMarkov => Self { markov: 0.6, markov_s, ..none },
            Noise::GrowsWithTemperature | Noise::HeavyTails | Noise::Bursts => some_flicker,
        }
    }
}

/// Noise of one axis in one run, for a unit whose 100 s means should deviate by 1. `t_c` is the temperature of that axis.
#[must_use]
pub fn sample(rng: &mut ChaCha8Rng, noise: &Noise, mixture: Mixture, t_c: &[f64], dt_s: f64) -> Vec<f64> {
    let n = t_c.len();
    let m = mixture;
    let total = m.white + m.flicker + m.walk + m.lines + m.markov;
    let mut out = vec![0.0; n];
    let mut add = |share: f64, part: Vec<f64>| {
        let weight = (share / total).sqrt();
        out.iter_mut().zip(part).for_each(|(out, part)| *out += weight * part);
    };
    add(m.white, white(rng, noise, t_c, dt_s));
    if m.flicker > 0.0 {
        add(m.flicker, correlated(rng, n, dt_s, |f| f.powf(-m.exponent)));
    }
    if m.walk > 0.0 {
        add(m.walk, walk(rng, n));
    }
    if m.lines > 0.0 {
        add(m.lines, lines(rng, n, dt_s));
    }
    if m.markov > 0.0 {
        add(m.markov, correlated(rng, n, dt_s, |f| 1.0 / (1.0 + (2.0 * PI * f * m.markov_s).powi(2))));
    }
    if let Noise::Series(series) = noise {
        let column = rng.random_range(0..series.columns.len());
        let measured = series.surrogate(rng, column, n, dt_s);
        let scale = 0.9 / deviation(&means(&measured, dt_s, 0)).max(1e-12);
        out.iter_mut().zip(measured).for_each(|(out, x)| *out = 0.19_f64.sqrt() * *out + scale * x);
    }
    out
}

/// White noise; its deviation, tails or stationarity by kind.
fn white(rng: &mut ChaCha8Rng, noise: &Noise, t_c: &[f64], dt_s: f64) -> Vec<f64> {
    let scale = (100.0 / dt_s).sqrt();
    let n = t_c.len();
    let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    match noise {
        Noise::GrowsWithTemperature => {
            // Fourfold from -40 to 60 C; 1 in the mean square over a run that visits all of it.
            let level = |t: f64| 4.0_f64.powf((t + 40.0) / 100.0) / 2.33;
            t_c.iter().map(|&t| scale * level(t) * normal(rng)).collect()
        }
        Noise::HeavyTails => match StudentT::new(3.0) {
            Ok(student) => (0..n).map(|_| scale / 3.0_f64.sqrt() * student.sample(rng)).collect(),
            Err(_) => (0..n).map(|_| scale * normal(rng)).collect(),
        },
        Noise::Bursts => {
            let (mut loud, mut left) = (false, 0.0);
            (0..n)
                .map(|_| {
                    left -= dt_s;
                    if left <= 0.0 {
                        loud = !loud;
                        let mean_s = if loud { 300.0 } else { 2700.0 };
                        left = -mean_s * (1.0 - rng.random::<f64>()).ln();
                    }
                    scale / 1.8_f64.sqrt() * if loud { 3.0 } else { 1.0 } * normal(rng)
                })
                .collect()
        }
        _ => (0..n).map(|_| scale * normal(rng)).collect(),
    }
}

/// Noise of the given power spectrum, by inverse transform of a random spectrum twice as long as the run. It is scaled so that its
/// 100 s means deviate by 1 about the mean of `n` samples, in expectation.
#[must_use]
pub fn correlated(rng: &mut ChaCha8Rng, n: usize, dt_s: f64, power: impl Fn(f64) -> f64) -> Vec<f64> {
    let length = 2 * n;
    let mut spectrum = vec![Complex::new(0.0, 0.0); length];
    let mut expected = 0.0;
    for k in 1..length / 2 {
        let f = k as f64 / (length as f64 * dt_s);
        let amplitude = power(f).sqrt();
        let (re, im): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
        spectrum[k] = Complex::new(re, im) * amplitude;
        spectrum[length - k] = spectrum[k].conj();
        // Mean over 100 s lets through sinc^2 of the power; taking off the mean of the run leaves 1 - sinc^2.
        let kept = sinc(f * 100.0).powi(2) * (1.0 - sinc(f * n as f64 * dt_s).powi(2));
        expected += 4.0 * amplitude * amplitude * kept;
    }
    FftPlanner::new().plan_fft_inverse(length).process(&mut spectrum);
    let scale = 1.0 / expected.max(1e-300).sqrt();
    spectrum.iter().take(n).map(|x| x.re * scale).collect()
}

fn sinc(x: f64) -> f64 {
    if x.abs() < 1e-9 {
        1.0
    } else {
        (PI * x).sin() / (PI * x)
    }
}

/// Random walk: its path over n steps deviates from its mean by sqrt(n/6) steps, in expectation.
fn walk(rng: &mut ChaCha8Rng, n: usize) -> Vec<f64> {
    let step = (6.0 / n as f64).sqrt();
    let mut at = 0.0;
    (0..n)
        .map(|_| {
            let jump: f64 = StandardNormal.sample(rng);
            at += step * jump;
            at
        })
        .collect()
}

/// Four lines: two fast ones that 100 s means hardly see, and two of minutes.
fn lines(rng: &mut ChaCha8Rng, n: usize, dt_s: f64) -> Vec<f64> {
    let mut out = vec![0.0; n];
    for (shortest, longest, share) in [(3.0, 12.0, 0.0), (15.0, 60.0, 0.0), (220.0, 420.0, 0.5), (430.0, 900.0, 0.5)] {
        let period_s: f64 = rng.random_range(shortest..longest);
        let phase = rng.random_range(0.0..2.0 * PI);
        let amplitude = if share > 0.0 {
            (2.0_f64 * share).sqrt() / sinc(100.0 / period_s).abs()
        } else {
            rng.random_range(0.5..3.0)
        };
        for (i, out) in out.iter_mut().enumerate() {
            *out += amplitude * (2.0 * PI * i as f64 * dt_s / period_s + phase).sin();
        }
    }
    out
}
