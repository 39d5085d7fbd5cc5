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

/// The genetic search as the paper describes it, with what its missing Table 1 would say assumed: individuals, generations (its curve ends at 15), odds
/// of a crossover and of a mutation of each weight, and the steps of back-propagation of a trial and of the end.
mod printed {
    pub const POPULATION: usize = 30;
    pub const GENERATIONS: usize = 15;
    /// Weights before training lie within this.
    pub const SPAN: f64 = 0.5;
    pub const CROSSOVER: f64 = 0.7;
    pub const MUTATION: f64 = 0.05;
    pub const TRIAL: usize = 300;
    pub const END: usize = 3000;
    /// Samples that are trained on, at most, and one in so many that judges.
    pub const SAMPLES: usize = 150;
    pub const TESTED: usize = 3;
}

/// Back-propagation: down the slope of the mean square, with momentum.
fn back_propagate(w: &mut [f64], u: &[f64], y: &[f64], steps: usize) {
    const RATE: f64 = 0.1;
    const MOMENTUM: f64 = 0.9;
    let mut speed = [0.0; WEIGHTS];
    let mut slopes = [0.0; WEIGHTS];
    for _ in 0..steps {
        let mut gradient = [0.0; WEIGHTS];
        for (u, y) in u.iter().zip(y) {
            let error = forward(w, *u, |k, d| slopes[k] = d) - y;
            gradient.iter_mut().zip(&slopes).for_each(|(g, s)| *g += error * s);
        }
        for ((w, v), g) in w.iter_mut().zip(&mut speed).zip(&gradient) {
            *v = MOMENTUM * *v - RATE * g / u.len() as f64;
            *w += *v;
        }
    }
}

/// Trains as zhao2022 describes it: each individual is trained by back-propagation, and its fitness is the error on *test* samples, here every third
/// sample of the train run (the paper's are those of the runs that it then judges by). Roulette, crossover of whole weights, mutation.
///
/// # Errors
/// Too few points.
pub fn train_as_printed(u: &[f64], y: &[f64], seed: u64) -> Result<Trained, BadInput> {
    enough(u)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let scale = Scale::of(y);
    let thin = u.len().div_ceil(printed::SAMPLES * printed::TESTED / (printed::TESTED - 1)).max(1);
    let all: Vec<(f64, f64)> = u.iter().zip(y).step_by(thin).map(|(u, y)| (*u, scale.scaled(*y))).collect();
    let part = |tested: bool| -> (Vec<f64>, Vec<f64>) {
        let kept = |k: usize| k.is_multiple_of(printed::TESTED) == tested;
        all.iter().enumerate().filter(|(k, _)| kept(*k)).map(|(_, s)| *s).unzip()
    };
    let ((u, y), (test_u, test_y)) = (part(false), part(true));
    let judged = |start: &[f64]| {
        let mut w = start.to_vec();
        back_propagate(&mut w, &u, &y, printed::TRIAL);
        error(&w, &test_u, &test_y)
    };
    let drawn = |rng: &mut ChaCha8Rng| rng.random_range(-printed::SPAN..printed::SPAN);
    let mut population: Vec<(f64, Vec<f64>)> = (0..printed::POPULATION)
        .map(|_| {
            let w: Vec<f64> = (0..WEIGHTS).map(|_| drawn(&mut rng)).collect();
            (judged(&w), w)
        })
        .collect();
    let mut history = Vec::new();
    for _ in 0..printed::GENERATIONS {
        hrg_data::numeric::progress::step();
        population.sort_by(|a, b| a.0.total_cmp(&b.0));
        history.push(population[0].0);
        let fitness: Vec<f64> = population.iter().map(|(e, _)| 1.0 / e.max(1e-12)).collect();
        let whole: f64 = fitness.iter().sum();
        let mut next = vec![population[0].clone()];
        while next.len() < printed::POPULATION {
            let mut parent = || {
                let mut at = rng.random_range(0.0..whole);
                fitness.iter().position(|f| {
                    at -= f;
                    at <= 0.0
                })
            };
            let (a, b) = (parent().unwrap_or(0), parent().unwrap_or(0));
            let mut child = population[a].1.clone();
            if rng.random_bool(printed::CROSSOVER) {
                let at = rng.random_range(1..WEIGHTS);
                child[at..].copy_from_slice(&population[b].1[at..]);
            }
            for w in &mut child {
                if rng.random_bool(printed::MUTATION) {
                    *w = drawn(&mut rng);
                }
            }
            next.push((judged(&child), child));
        }
        population = next;
    }
    population.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut w = population.swap_remove(0).1;
    back_propagate(&mut w, &u, &y, printed::END);
    let rms = |e: f64| scale.half * (e / test_u.len() as f64).sqrt();
    Ok(Trained { weights: scale.weights(&w), generations_rms_dph: history.into_iter().map(rms).collect() })
}

/// Scale of the outputs: the search has them of order one.
struct Scale {
    middle: f64,
    half: f64,
}

impl Scale {
    fn of(y: &[f64]) -> Self {
        let (low, high) = y.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        Self { middle: 0.5 * (low + high), half: (0.5 * (high - low)).max(1e-9) }
    }

    fn scaled(&self, y: f64) -> f64 {
        (y - self.middle) / self.half
    }

    /// Weights whose output is in deg/h.
    fn weights(&self, w: &[f64]) -> [f32; WEIGHTS] {
        std::array::from_fn(|k| {
            let out = if k >= 2 * HIDDEN { w[k] * self.half } else { w[k] };
            (if k == WEIGHTS - 1 { out + self.middle } else { out }) as f32
        })
    }
}

fn enough(u: &[f64]) -> Result<(), BadInput> {
    if u.len() < 3 * WEIGHTS {
        return Err(BadInput::new(format!(
            "{} points are too few for {WEIGHTS} weights of a network; record a longer run",
            u.len()
        )));
    }
    Ok(())
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
    enough(u)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let scale = Scale::of(y);
    let scaled: Vec<f64> = y.iter().map(|v| scale.scaled(*v)).collect();
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
    let rms = |e: f64| scale.half * (e / u.len() as f64).sqrt();
    Ok(Trained {
        weights: scale.weights(best.1.as_slice()),
        generations_rms_dph: errors.into_iter().map(rms).collect(),
    })
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

    /// As printed it learns, too, and less than down the slope to its end.
    #[test]
    fn the_printed_search_learns_less() {
        let u: Vec<f64> = (0..400).map(|k| f64::from(k) / 200.0 - 1.0).collect();
        let y: Vec<f64> = u.iter().map(|u| -6.0 - 4.0 * (3.0 * u).tanh() + 0.5 * (4.0 * u).sin()).collect();
        let rms = |t: &Trained| {
            let left = |(u, y): (&f64, &f64)| f64::from(hrg_core::bias::network::evaluate(&t.weights, *u as f32)) - y;
            (u.iter().zip(&y).map(|p| left(p).powi(2)).sum::<f64>() / u.len() as f64).sqrt()
        };
        let (ours, theirs) = (train(&u, &y, 3).expect("trains"), train_as_printed(&u, &y, 3).expect("trains"));
        assert!(rms(&theirs) < 0.5 && rms(&theirs) > 3.0 * rms(&ours), "{} {}", rms(&theirs), rms(&ours));
        assert_eq!(theirs, train_as_printed(&u, &y, 3).expect("trains"));
        assert!(theirs.generations_rms_dph.windows(2).all(|g| g[1] <= g[0]));
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
