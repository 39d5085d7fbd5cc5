//! Drive and quadrature as a resonator and its loops make them: losses and stiffness come first, the voltages follow, and the rate has its
//! errors from the losses and the stiffness themselves.
//!
//! # Losses
//! `1/Q = 1/Q_bulk(T) + 1/Q_gas(t) + 1/Q_stem(t)`. The bulk's grows with temperature. The pressure of the gas goes to an equilibrium that grows
//! exponentially with temperature (walls give off gas, a getter takes it), within hours. The stem's drifts. A loop holds the amplitude:
//! its voltage is the loss over the actuator's gain, which depends on the board's temperature; the loop takes seconds and has noise.
//!
//! # Stiffness
//! The frequency split changes with temperature and creeps behind it; its axis turns by some degrees. The voltage that nulls the quadrature
//! is split times `sin 4(angle)`, behind a loop of its own.
//!
//! # Rates
//! `B = 1/2 D sin 2(angle - axis)`, `D` the anisotropy of the loss, a share of the whole that changes a little with temperature; and the
//! quadrature force times the sine of the demodulator's phase error, which follows the board.

use crate::draw::{stream, Properties, Seed};
use crate::operators::lag;
use crate::world::World;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Makes the losses, the stiffness and the voltages of a run.
pub(crate) fn resonate(world: &mut World, seed: Seed, case: &str, run: usize) {
    for a in 0..3 {
        let axis = a.to_string();
        let mut unit = Properties::new(seed, &[case, "losses", &axis]);
        let mut day = stream(seed, &[case, "losses", &axis, &run.to_string()]);
        let loss = loss(world, a, &mut unit, &mut day);
        let force = mismatch(world, a, &mut unit, &mut day);
        let gain_per_c = unit.random_range(-4e-4..4e-4);
        let volts = unit.random_range(1.0..1.5);
        let drive: Vec<f64> =
            loss.iter().zip(&world.board_c).map(|(l, b)| volts * l * (1.0 + gain_per_c * (b - 25.0))).collect();
        world.drive_v[a] = loop_of(&drive, world.dt_s, unit.random_range(2.0..6.0), 4e-4, &mut day);
        let offset_per_c = unit.random_range(-2e-5..2e-5);
        let quad: Vec<f64> = force.iter().zip(&world.board_c).map(|(q, b)| q + offset_per_c * (b - 25.0)).collect();
        world.quad_v[a] = loop_of(&quad, world.dt_s, unit.random_range(0.5..2.0), 2e-4, &mut day);
        world.loss[a] = loss;
        world.force_v[a] = force;
    }
}

/// A quantity as a loop shows it: late, and with noise (V at each second).
fn loop_of(x: &[f64], dt_s: f64, tau_s: f64, noise_v: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let late = lag(x, dt_s, tau_s, x[0]);
    late.into_iter().map(|x| x + noise_v * normal(rng)).collect()
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// The loss over that at 25 C in a good vacuum.
fn loss(w: &World, a: usize, unit: &mut Properties, day: &mut ChaCha8Rng) -> Vec<f64> {
    let (linear, square) = (unit.random_range(8e-4..2e-3), unit.random_range(4e-6..1.2e-5));
    let (gas, scale_c, tau_s) =
        (unit.random_range(0.02..0.06), unit.random_range(22.0..35.0), unit.random_range(4000.0..12_000.0));
    let (stem, stem_s) = (unit.random_range(0.006..0.014), unit.random_range(2500.0..7000.0));
    let keep = (-w.dt_s / stem_s).exp();
    let mut drift = stem * normal(day);
    // The gas of the day before, at another temperature.
    let mut pressure = gas * day.random_range(0.6..1.6);
    w.t_c[a]
        .iter()
        .map(|t| {
            let x = t - 25.0;
            pressure += (1.0 - (-w.dt_s / tau_s).exp()) * (gas * (x / scale_c).exp() - pressure);
            drift = drift * keep + stem * (1.0 - keep * keep).sqrt() * normal(day);
            1.0 + linear * x + square * x * x + pressure + drift
        })
        .collect()
}

/// The force that nulls the quadrature, V.
fn mismatch(w: &World, a: usize, unit: &mut Properties, day: &mut ChaCha8Rng) -> Vec<f64> {
    let (split_v, per_c, creep_per_c) =
        (unit.random_range(0.15..0.3), unit.random_range(-1.5e-3..1.5e-3), unit.random_range(1e-3..3e-3));
    let (creep_s, angle, turn_per_c) =
        (unit.random_range(1500.0..5000.0), unit.random_range(0.1..0.3), unit.random_range(-2e-3..2e-3));
    let late = lag(&w.t_c[a], w.dt_s, creep_s, w.start_c());
    let (drift_v, drift_s) = (unit.random_range(0.002..0.006), unit.random_range(3000.0..9000.0));
    let keep = (-w.dt_s / drift_s).exp();
    let mut drift = drift_v * normal(day);
    w.t_c[a]
        .iter()
        .zip(late)
        .map(|(t, late)| {
            drift = drift * keep + drift_v * (1.0 - keep * keep).sqrt() * normal(day);
            let split = split_v * (1.0 + per_c * (t - 25.0) + creep_per_c * (late - t));
            split * (4.0 * (angle + turn_per_c * (t - 25.0))).sin() + drift
        })
        .collect()
}
