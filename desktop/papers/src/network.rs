//! Training of zhao2022's 1-5-1 network: a genetic algorithm finds 16 starting weights, Levenberg-Marquardt finishes
//! (in place of the paper's back-propagation, which goes down the same slope, slower).

use hrg_core::bias::network::{HIDDEN, WEIGHTS};
use hrg_data::error::BadInput;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned, VecStorage};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

const POPULATION: usize = 60;
const GENERATIONS: usize = 60;
/// Starting weights lie within this, inputs and outputs being scaled to -1..1.
const SPAN: f64 = 3.0;
/// The best of the population from which the slope is gone down, so that one bad valley does not decide.
const STARTS: usize = 4;

/// The network in f64, and its derivatives by the weights.
fn forward(w: &[f64], u: f64, mut slopes: impl FnMut(usize, f64)) -> f64 {
    let mut sum = w[WEIGHTS - 1];
    slopes(WEIGHTS - 1, 1.0);
    for i in 0..HIDDEN {
        let h = (w[i] * u + w[HIDDEN + i]).tanh();
        let out = w[2 * HIDDEN + i];
        sum += out * h;
        let inner = out * (1.0 - h * h);
        slopes(i, inner * u);
        slopes(HIDDEN + i, inner);
        slopes(2 * HIDDEN + i, h);
    }
    sum
}

struct Training<'a> {
    u: &'a [f64],
    y: &'a [f64],
    w: DVector<f64>,
}

/// A whisper of ridge keeps weights that the data do not need from running off to where single precision ends.
const RIDGE: f64 = 1e-4;

impl LeastSquaresProblem<f64, Dyn, Dyn> for Training<'_> {
    type ResidualStorage = VecStorage<f64, Dyn, nalgebra::U1>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = VecStorage<f64, Dyn, nalgebra::U1>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.w.copy_from(x);
    }
    fn params(&self) -> DVector<f64> {
        self.w.clone()
    }
    fn residuals(&self) -> Option<DVector<f64>> {
        let n = self.u.len();
        let w = self.w.as_slice();
        Some(DVector::from_fn(n + WEIGHTS, |k, _| {
            if k < n {
                forward(w, self.u[k], |_, _| {}) - self.y[k]
            } else {
                RIDGE * w[k - n]
            }
        }))
    }
    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let n = self.u.len();
        let mut j = DMatrix::zeros(n + WEIGHTS, WEIGHTS);
        for k in 0..n {
            forward(self.w.as_slice(), self.u[k], |c, d| j[(k, c)] = d);
        }
        for c in 0..WEIGHTS {
            j[(n + c, c)] = RIDGE;
        }
        Some(j)
    }
}

fn error(w: &[f64], u: &[f64], y: &[f64]) -> f64 {
    u.iter().zip(y).map(|(u, y)| (forward(w, *u, |_, _| {}) - y).powi(2)).sum()
}

/// Breeds starting weights: tournaments, blended crossover, mutation, the two best kept. Best first, and the least error of each
/// generation.
fn breed(u: &[f64], y: &[f64], rng: &mut ChaCha8Rng) -> (Vec<Vec<f64>>, Vec<f64>) {
    let mut history = Vec::with_capacity(GENERATIONS);
    let mut population: Vec<(f64, Vec<f64>)> = (0..POPULATION)
        .map(|_| {
            let w: Vec<f64> = (0..WEIGHTS).map(|_| rng.random_range(-SPAN..SPAN)).collect();
            (error(&w, u, y), w)
        })
        .collect();
    for generation in 0..GENERATIONS {
        hrg_data::numeric::progress::step();
        population.sort_by(|a, b| a.0.total_cmp(&b.0));
        history.push(population[0].0);
        let spread = SPAN * 0.2 * (1.0 - generation as f64 / GENERATIONS as f64);
        let mut next: Vec<(f64, Vec<f64>)> = population[..2].to_vec();
        while next.len() < POPULATION {
            // Of three drawn, the best (the population is sorted).
            let mut parent = || (0..3).map(|_| rng.random_range(0..POPULATION)).min().unwrap_or(0);
            let (a, b) = (parent(), parent());
            let child: Vec<f64> = population[a]
                .1
                .iter()
                .zip(&population[b].1)
                .map(|(x, y)| {
                    let mixed = x + rng.random_range(-0.25..1.25) * (y - x);
                    let jolt: f64 = StandardNormal.sample(rng);
                    if rng.random_bool(0.15) {
                        mixed + spread * jolt
                    } else {
                        mixed
                    }
                })
                .collect();
            next.push((error(&child, u, y), child));
        }
        population = next;
    }
    population.sort_by(|a, b| a.0.total_cmp(&b.0));
    (population.into_iter().map(|(_, w)| w).collect(), history)
}

/// A network that was trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The weights for [`hrg_core::bias::network::evaluate`].
    pub weights: [f32; WEIGHTS],
    /// RMS of what the best of each generation of the genetic search leaves, deg/h: before the slope is gone down.
    pub generations_rms_dph: Vec<f64>,
}

/// Trains on inputs `u` (about -1 to 1) and biases `y` (deg/h); the same seed gives the same
/// network.
///
/// # Errors
/// Too few points.
pub fn train(u: &[f64], y: &[f64], seed: u64) -> Result<Trained, BadInput> {
    if u.len() < 3 * WEIGHTS {
        return Err(BadInput::new(format!(
            "{} points are too few for {WEIGHTS} weights of a network; record a longer run",
            u.len()
        )));
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // The outputs are scaled to order one for the search.
    let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    let (middle, half) = (0.5 * (low + high), (0.5 * (high - low)).max(1e-9));
    let scaled: Vec<f64> = y.iter().map(|v| (v - middle) / half).collect();
    let (starts, errors) = breed(u, &scaled, &mut rng);
    let best = starts
        .into_iter()
        .take(STARTS)
        .map(|w| {
            let start = Training { u, y: &scaled, w: DVector::from_vec(w) };
            let (end, report) = LevenbergMarquardt::new().with_patience(20).minimize(start);
            (report.objective_function, end.w)
        })
        .filter(|(e, w)| e.is_finite() && w.iter().all(|x| x.is_finite()))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .ok_or_else(|| BadInput::new("the network's training came to no end; record a longer run"))?;
    let weights = std::array::from_fn(|k| {
        let w = best.1[k];
        let out = if k >= 2 * HIDDEN { w * half } else { w };
        (if k == WEIGHTS - 1 { out + middle } else { out }) as f32
    });
    Ok(Trained { weights, generations_rms_dph: errors.iter().map(|e| half * (e / u.len() as f64).sqrt()).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn learns_a_curve_and_repeats_itself() {
        let u: Vec<f64> = (0..400).map(|k| f64::from(k) / 200.0 - 1.0).collect();
        let y: Vec<f64> = u.iter().map(|u| -6.0 - 4.0 * (3.0 * u).tanh() + 0.5 * (4.0 * u).sin()).collect();
        let trained = train(&u, &y, 3).expect("trains");
        let w = trained.weights;
        assert!(trained.generations_rms_dph.windows(2).all(|g| g[1] <= g[0]));
        let worst = u
            .iter()
            .zip(&y)
            .map(|(u, y)| (f64::from(hrg_core::bias::network::evaluate(&w, *u as f32)) - y).abs())
            .fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst}");
        assert_eq!(trained, train(&u, &y, 3).expect("trains"));
        assert!(train(&u[..20], &y[..20], 3).is_err());
    }

    #[test]
    fn the_slopes_are_those_of_the_network() {
        let w: Vec<f64> = (0..WEIGHTS).map(|k| (k as f64 * 0.7).sin()).collect();
        let mut slopes = [0.0; WEIGHTS];
        forward(&w, 0.4, |k, d| slopes[k] = d);
        for k in 0..WEIGHTS {
            let mut moved = w.clone();
            moved[k] += 1e-6;
            let by_difference = (forward(&moved, 0.4, |_, _| {}) - forward(&w, 0.4, |_, _| {})) / 1e-6;
            assert!((by_difference - slopes[k]).abs() < 1e-5);
        }
    }
}
