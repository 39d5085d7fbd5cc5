//! Significance: what the best of the library gains on surrogates of the residual. A surrogate has the spectrum of the whitened
//! residual, lines and slow drift included, and random phases (Theiler and others 1992).

use super::data::AxisRows;
use super::evidence::{Axis, AxisModel};
use hrg_core::AXES;
use hrg_data::numeric::stats::{mean, std_dev};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use realfft::RealFftPlanner;

/// Surrogates behind a significance.
const SURROGATES: usize = 40;

/// Surrogates of a series: its spectrum with random phases, run by run.
struct Phases {
    amplitudes: Vec<Vec<f64>>,
    lengths: Vec<usize>,
    planner: RealFftPlanner<f64>,
}

impl Phases {
    fn new(series: &[f64], starts: &[usize]) -> Self {
        let mut planner = RealFftPlanner::new();
        let (mut amplitudes, mut lengths) = (Vec::new(), Vec::new());
        for (k, &from) in starts.iter().enumerate() {
            let mut x = series[from..starts.get(k + 1).copied().unwrap_or(series.len())].to_vec();
            lengths.push(x.len());
            let fft = planner.plan_fft_forward(x.len().max(1));
            let mut y = fft.make_output_vec();
            // (The lengths fit: both are the plan's own.)
            if x.is_empty() || fft.process(&mut x, &mut y).is_err() {
                amplitudes.push(Vec::new());
                continue;
            }
            let n = lengths[k] as f64;
            amplitudes.push(y.iter().map(|c| c.norm() / n).collect());
        }
        Self { amplitudes, lengths, planner }
    }

    fn draw(&mut self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut out = Vec::new();
        for (amplitudes, &n) in self.amplitudes.iter().zip(&self.lengths) {
            if amplitudes.is_empty() {
                out.extend(std::iter::repeat_n(0.0, n));
                continue;
            }
            let inverse = self.planner.plan_fft_inverse(n);
            let mut spectrum = inverse.make_input_vec();
            let last = amplitudes.len() - 1;
            for (k, (s, a)) in spectrum.iter_mut().zip(amplitudes).enumerate() {
                let phase: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                (s.re, s.im) = (a * phase.cos(), a * phase.sin());
                // The mean, and the highest frequency of an even length, are real.
                if k == 0 || (k == last && n % 2 == 0) {
                    (s.re, s.im) = (a * phase.cos().signum(), 0.0);
                }
            }
            let mut x = inverse.make_output_vec();
            if inverse.process(&mut spectrum, &mut x).is_ok() {
                out.extend(x);
            }
        }
        out
    }
}

/// Chance that noise with the spectrum of what a model leaves gives any candidate a score of `score` or more. `price` is what each
/// candidate pays, `axis_price` what it pays for each axis.
pub fn p_value(
    rows: &[AxisRows; AXES],
    axes: &mut [Axis<'_>; AXES],
    model: &[AxisModel; AXES],
    seed: u64,
    price: &[f64],
    axis_price: f64,
    score: f64,
) -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut phases = Vec::new();
    let mut benches = Vec::new();
    for a in 0..AXES {
        let left = axes[a].left(model[a].noise_model, &model[a].shares);
        phases.push(Phases::new(&left, &rows[a].starts));
        let Some(bench) = axes[a].bench(&model[a]) else { return 1.0 };
        benches.push(bench);
    }
    let mut best: Vec<f64> = Vec::with_capacity(SURROGATES);
    for _ in 0..SURROGATES {
        hrg_data::numeric::progress::step();
        let mut total: Vec<f64> = price.iter().map(|p| -p).collect();
        for a in 0..AXES {
            let gains = axes[a].on_bench(&benches[a], &phases[a].draw(&mut rng));
            total.iter_mut().zip(gains).for_each(|(t, g)| *t += (g - axis_price).max(0.0));
        }
        best.push(total.into_iter().fold(f64::NEG_INFINITY, f64::max));
    }
    // Maxima over many candidates: Gumbel's distribution, by moments.
    let scale = (std_dev(&best) * 6f64.sqrt() / std::f64::consts::PI).max(0.3);
    let z = (score - (mean(&best) - 0.5772 * scale)) / scale;
    -(-(-z).exp()).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surrogate_has_the_spectrum_and_not_the_series() {
        let series: Vec<f64> = (0..500).map(|k| (f64::from(k) * 0.3).sin() + 0.01 * f64::from(k % 7)).collect();
        let mut phases = Phases::new(&series, &[0, 240]);
        let drawn = phases.draw(&mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(drawn.len(), series.len());
        let power = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>();
        for part in [0..240, 240..500] {
            assert!((power(&drawn[part.clone()]) / power(&series[part]) - 1.0).abs() < 1e-6);
        }
        assert!(drawn.iter().zip(&series).any(|(d, s)| (d - s).abs() > 0.5));
        let again = Phases::new(&drawn, &[0, 240]);
        for (x, y) in again.amplitudes.iter().flatten().zip(phases.amplitudes.iter().flatten()) {
            assert!((x - y).abs() < 1e-9);
        }
    }
}
