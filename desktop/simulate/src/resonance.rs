//! Losses and stiffness of a resonator, what they do to its rate, and the voltages by which its loops show them.
//!
//! # Losses
//! `1/Q = 1/Q_bulk(T) + 1/Q_gas + 1/Q_stem`, as shares of that at the reference temperature. The bulk's grows with temperature. Gas leaves the
//! walls faster when they are warm, and its pressure follows within hours. The stem's drifts. The rate has an error by the *anisotropy* of the
//! losses (dong2023 eq 3), whose share of the whole changes with temperature. The amplitude loop shows the whole, by an actuator whose gain
//! follows the board, seconds late and with noise.
//!
//! # Stiffness
//! The frequency split changes with temperature and creeps behind it, and its axis turns: the force that nulls the quadrature is split times
//! `sin 4(angle)`. The rate has an error by the force; the loop shows it with an offset that follows the board, late and with noise.

use super::noise::normal;
use super::plant::lag;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Temperature at which the losses are one, C.
const REFERENCE_C: f64 = 10.0;

/// Drive and quadrature of a run, V at each second.
pub(super) struct Resonance {
    /// Drive that holds the amplitude, as the loop shows it.
    pub(super) drive_v: Vec<f64>,
    /// Voltage that nulls the quadrature, as the loop shows it.
    pub(super) quad_v: Vec<f64>,
    /// Anisotropy of the losses, as the drive that it would need: the rate's error goes with it.
    pub(super) anisotropy_v: Vec<f64>,
    /// Quadrature force: the rate's error goes with it.
    pub(super) force_v: Vec<f64>,
}

/// Numbers of a unit's resonator.
pub(super) struct Resonator {
    drive_v: f64,
    bulk_per_c: f64,
    bulk_per_c2: f64,
    gas: f64,
    gas_scale_c: f64,
    gas_s: f64,
    stem: f64,
    share_per_c: f64,
    actuator_per_c: f64,
    amplitude_loop_s: f64,
    split_v: f64,
    split_per_c: f64,
    creep_per_c: f64,
    creep_s: f64,
    angle: f64,
    turn_per_c: f64,
    mismatch_v: f64,
    offset_v_per_c: f64,
    quadrature_loop_s: f64,
}

/// Noise of the amplitude loop, V.
const DRIVE_NOISE_V: f64 = 3e-4;
/// Noise of the quadrature loop, V.
const QUAD_NOISE_V: f64 = 3e-4;

impl Resonator {
    /// Of an axis of a unit.
    pub(super) fn of(unit_seed: u64, axis: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(unit_seed ^ 0xD217_E000);
        rng.set_stream(axis as u64);
        let mut of = |range: std::ops::Range<f64>| rng.random_range(range);
        Self {
            drive_v: of(1.1..1.3),
            bulk_per_c: of(1e-3..2e-3),
            bulk_per_c2: of(4e-6..1.2e-5),
            gas: of(0.01..0.03),
            gas_scale_c: of(25.0..40.0),
            gas_s: of(4000.0..12_000.0),
            stem: of(0.012..0.02),
            share_per_c: of(-5e-4..5e-4),
            actuator_per_c: of(-2e-4..2e-4),
            amplitude_loop_s: of(2.0..6.0),
            split_v: of(0.15..0.3),
            split_per_c: of(-1.5e-3..1.5e-3),
            creep_per_c: of(1e-3..3e-3),
            creep_s: of(1500.0..5000.0),
            angle: of(0.1..0.3),
            turn_per_c: of(-2e-3..2e-3),
            mismatch_v: of(0.02..0.035),
            offset_v_per_c: of(-2e-5..2e-5),
            quadrature_loop_s: of(0.5..2.0),
        }
    }

    /// Its run through temperatures of resonator and board (C, each second). `drifts`: of the stem's losses and of the mismatch, unit variance.
    pub(super) fn resonate(
        &self,
        resonator_c: &[f64],
        board_c: &[f64],
        drifts: [&[f64]; 2],
        rng: &mut ChaCha8Rng,
    ) -> Resonance {
        let [stem, mismatch] = drifts;
        let x: Vec<f64> = resonator_c.iter().map(|t| t - REFERENCE_C).collect();
        let emitted: Vec<f64> = x.iter().map(|x| self.gas * (x / self.gas_scale_c).exp()).collect();
        let gas = lag(&emitted, self.gas_s);
        let creep = lag(&x, self.creep_s);
        let loss =
            |k: usize| 1.0 + self.bulk_per_c * x[k] + self.bulk_per_c2 * x[k] * x[k] + gas[k] + self.stem * stem[k];
        let force = |k: usize| {
            let split = self.split_v * (1.0 + self.split_per_c * x[k] + self.creep_per_c * (creep[k] - x[k]));
            split * (4.0 * (self.angle + self.turn_per_c * x[k])).sin() + self.mismatch_v * mismatch[k]
        };
        let steps = || 0..x.len();
        let of_board = |k: usize| board_c[k] - REFERENCE_C;
        let drive: Vec<f64> =
            steps().map(|k| self.drive_v * loss(k) * (1.0 + self.actuator_per_c * of_board(k))).collect();
        let quad: Vec<f64> = steps().map(|k| force(k) + self.offset_v_per_c * of_board(k)).collect();
        let mut shown = |v: &[f64], tau_s, noise_v| -> Vec<f64> {
            lag(v, tau_s).into_iter().map(|v| v + noise_v * normal(rng)).collect()
        };
        Resonance {
            drive_v: shown(&drive, self.amplitude_loop_s, DRIVE_NOISE_V),
            quad_v: shown(&quad, self.quadrature_loop_s, QUAD_NOISE_V),
            anisotropy_v: steps().map(|k| self.drive_v * loss(k) * (1.0 + self.share_per_c * x[k])).collect(),
            force_v: steps().map(force).collect(),
        }
    }
}
