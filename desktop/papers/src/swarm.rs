//! Particle swarm, as the sources use it.
//!
//! Own code, not a crate: both sources prescribe what the crates on offer do not have (a limit of speed, an inertia that
//! falls with the iterations), and with it the whole method is one loop.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Constants of a swarm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// Particles.
    pub particles: usize,
    /// Iterations.
    pub iterations: usize,
    /// Pull towards a particle's own best.
    pub own: f64,
    /// Pull towards the swarm's best.
    pub common: f64,
    /// Inertia at the first and at the last iteration.
    pub inertia: [f64; 2],
}

/// dong2023, eq 8 to 10: constant inertia.
pub const DONG: Constants = Constants { particles: 200, iterations: 200, own: 1.5, common: 1.5, inertia: [0.8, 0.8] };

/// wu2023, its Table 1: falling inertia. It prints no limits of it; 0.9 and 0.4 are those of the method's authors.
pub const WU: Constants = Constants { particles: 100, iterations: 1000, own: 1.3, common: 1.7, inertia: [0.9, 0.4] };

/// Result of a swarm.
#[derive(Debug, Clone)]
pub struct Found {
    /// Best position.
    pub position: Vec<f64>,
    /// Objective there.
    pub value: f64,
    /// Best objective after each iteration.
    pub history: Vec<f64>,
    /// Best position after each iteration.
    pub path: Vec<Vec<f64>>,
}

/// Minimises `objective` in a box. `limits` are the box and the greatest speed (per iteration) of each dimension.
/// Particles stop at the walls. The same seed gives the same result.
pub fn minimise(
    constants: &Constants,
    limits: &[([f64; 2], f64)],
    seed: u64,
    mut objective: impl FnMut(&[f64]) -> f64,
) -> Found {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let draw = |rng: &mut ChaCha8Rng, low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let mut position: Vec<Vec<f64>> = (0..constants.particles)
        .map(|_| limits.iter().map(|([low, high], _)| draw(&mut rng, *low, *high)).collect())
        .collect();
    let mut speed: Vec<Vec<f64>> = (0..constants.particles)
        .map(|_| limits.iter().map(|(_, most)| draw(&mut rng, -most, *most)).collect())
        .collect();
    let mut own = position.clone();
    let mut own_value: Vec<f64> = position.iter().map(|x| objective(x)).collect();
    let first = (0..own.len()).min_by(|a, b| own_value[*a].total_cmp(&own_value[*b])).unwrap_or(0);
    let (mut best, mut best_value) = (own[first].clone(), own_value[first]);
    let mut history = Vec::with_capacity(constants.iterations);
    let mut path = Vec::with_capacity(constants.iterations);
    let [w_first, w_last] = constants.inertia;
    for iteration in 0..constants.iterations {
        hrg_data::numeric::progress::step();
        hrg_data::numeric::progress::reached(iteration as f64 / constants.iterations as f64);
        let w = w_first - (w_first - w_last) * iteration as f64 / constants.iterations as f64;
        for k in 0..position.len() {
            for (d, ([low, high], most)) in limits.iter().enumerate() {
                let x = position[k][d];
                let v = w * speed[k][d]
                    + constants.own * rng.random::<f64>() * (own[k][d] - x)
                    + constants.common * rng.random::<f64>() * (best[d] - x);
                speed[k][d] = v.clamp(-most, *most);
                position[k][d] = (x + speed[k][d]).clamp(*low, *high);
            }
            let value = objective(&position[k]);
            if value < own_value[k] {
                own_value[k] = value;
                own[k].clone_from(&position[k]);
                if value < best_value {
                    best_value = value;
                    best.clone_from(&position[k]);
                }
            }
        }
        history.push(best_value);
        path.push(best.clone());
    }
    Found { position: best, value: best_value, history, path }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_a_bowl_and_repeats_itself() {
        let bowl = |x: &[f64]| (x[0] - 0.3).powi(2) + (x[1] + 0.6).powi(2);
        let limits = [([-1.0, 1.0], 1.0); 2];
        let a = minimise(&DONG, &limits, 7, bowl);
        assert!(a.value < 1e-8, "{}", a.value);
        assert!(a.history.windows(2).all(|w| w[1] <= w[0]));
        assert_eq!(a.position, minimise(&DONG, &limits, 7, bowl).position);
        assert_ne!(a.position, minimise(&DONG, &limits, 8, bowl).position);
    }

    #[test]
    fn stays_in_its_box() {
        let a = minimise(&WU, &[([0.0, 1.0], 0.1)], 1, |x| x[0]);
        assert_eq!(a.position, [0.0]);
    }
}
