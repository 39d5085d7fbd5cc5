//! The thermal plant: chamber, case, resonator and board; and what only a recording has.

use super::noise::drift;
use super::resonance::{Resonance, Resonator};
use hrg_core::bias::State;
use hrg_core::inputs::{case, drive, quad, Quantities, BOARD, QUANTITIES, SUPPLY};
use hrg_core::thermal::{AxisThermal, Thermal};
use hrg_core::AXES;
use rand_chacha::ChaCha8Rng;

/// Thermal lag of the resonators behind the case, s (zhao2022: 694 s; the axes of one unit differ a little).
pub const RESONATOR_LAG_S: [f64; AXES] = [694.0, 655.0, 741.0];

/// Lag of the cases behind the chamber, s.
const CASE_LAG_S: [f64; AXES] = [420.0, 380.0, 450.0];

/// Lag of the board behind the chamber, s.
const BOARD_LAG_S: f64 = 1500.0;

/// Case above chamber in equilibrium, C: dong2023 Table 1 at mid-range.
const CASE_RISE_C: [f64; AXES] = [5.8, 4.4, 4.5];

/// Resonator above case in equilibrium, C.
const SELF_HEATING_C: [f64; AXES] = [0.9, 1.1, 0.8];

/// Time in which self-heating builds up after power-on, s.
const HEATING_TAU_S: f64 = 1800.0;

/// Temperatures of the plant each second.
pub(super) struct Plant {
    pub(super) case_c: [Vec<f64>; AXES],
    pub(super) resonator_c: [Vec<f64>; AXES],
    pub(super) slope_c_per_min: [Vec<f64>; AXES],
    pub(super) board_c: Vec<f64>,
}

pub(super) fn lag(input: &[f64], tau: f64) -> Vec<f64> {
    let share = 1.0 - (-1.0 / tau).exp();
    let mut y = input.first().copied().unwrap_or(0.0);
    input
        .iter()
        .map(|x| {
            y += share * (x - y);
            y
        })
        .collect()
}

impl Plant {
    /// The plant at a step, for effects: its frequencies are proportional to temperature.
    pub(super) fn thermal(&self, k: usize) -> Thermal {
        let axes = [0, 1, 2].map(|a| {
            let temperature_c = self.resonator_c[a][k] as f32;
            let ramp_c_per_min = self.slope_c_per_min[a][k] as f32;
            let state = State {
                temperature_c,
                ramp_c_per_min,
                difference_c_per_min: ramp_c_per_min,
                frequency_u: (temperature_c - 10.0) / 45.0,
                frequency_u_per_min: ramp_c_per_min / 45.0,
            };
            AxisThermal { state, known: true, age: 0, settled: true }
        });
        Thermal { axes, time_s: (k + 1) as f32 }
    }

    pub(super) fn new(chamber: &[f64]) -> Self {
        let heating: Vec<f64> = (0..chamber.len()).map(|k| 1.0 - (-(k as f64) / HEATING_TAU_S).exp()).collect();
        let case_c = [0, 1, 2].map(|a| {
            let mut s = lag(chamber, CASE_LAG_S[a]);
            s.iter_mut().zip(&heating).for_each(|(s, h)| *s += CASE_RISE_C[a] * (0.4 + 0.6 * h));
            s
        });
        let resonator_c = [0, 1, 2].map(|a| {
            let mut r = lag(&case_c[a], RESONATOR_LAG_S[a]);
            r.iter_mut().zip(&heating).for_each(|(r, h)| *r += SELF_HEATING_C[a] * h);
            r
        });
        let slope_c_per_min = [0, 1, 2].map(|a| {
            let r = &resonator_c[a];
            (0..r.len()).map(|k| if k == 0 { 0.0 } else { (r[k] - r[k - 1]) * 60.0 }).collect()
        });
        Self {
            board_c: lag(chamber, BOARD_LAG_S).iter().map(|b| b + 9.0).collect(),
            case_c,
            resonator_c,
            slope_c_per_min,
        }
    }
}

/// The quantities of a run that only a recording has.
pub(super) struct Monitors {
    pub(super) board_c: Vec<f64>,
    pub(super) supply_v: Vec<f64>,
    pub(super) resonance: [Resonance; AXES],
    pub(super) clock_ppm: Vec<f64>,
}

impl Monitors {
    /// Of a run: `unit_seed` is the unit, `rng` the run.
    pub(super) fn new(plant: &Plant, unit_seed: u64, rng: &mut ChaCha8Rng) -> Self {
        let n = plant.board_c.len();
        let board_c: Vec<f64> = plant.board_c.iter().zip(drift(n, 5000.0, rng)).map(|(b, w)| b + 0.8 * w).collect();
        let supply_v = drift(n, 4000.0, rng).iter().map(|w| 5.0 + 0.02 * w).collect();
        let stem = [0; AXES].map(|_| drift(n, 6000.0, rng));
        let mismatch = [0; AXES].map(|_| drift(n, 8000.0, rng));
        // The noise of the loops has a stream of its own.
        let mut loops = rng.clone();
        loops.set_stream(1);
        let resonance = [0, 1, 2].map(|a: usize| {
            let unit = Resonator::of(unit_seed, a);
            unit.resonate(&plant.resonator_c[a], &board_c, [&stem[a], &mismatch[a]], &mut loops)
        });
        Self { board_c, supply_v, resonance, clock_ppm: drift(n, 7000.0, rng) }
    }

    /// Quantities of each second as the physics has them, which make the bias; a recording has what the loops show of them. Temperatures
    /// from the model's reference.
    pub(super) fn quantities(&self, plant: &Plant, t_ref_c: f32) -> Vec<Quantities> {
        (0..plant.board_c.len())
            .map(|k| {
                let mut values = [f32::NAN; QUANTITIES];
                let mut set = |number: u8, value: f32| values[usize::from(number)] = value;
                set(BOARD, self.board_c[k] as f32 - t_ref_c);
                set(SUPPLY, self.supply_v[k] as f32);
                for a in 0..AXES {
                    set(case(a), plant.case_c[a][k] as f32 - t_ref_c);
                    set(drive(a), self.resonance[a].anisotropy_v[k] as f32);
                    set(quad(a), self.resonance[a].force_v[k] as f32);
                }
                Quantities::new(values)
            })
            .collect()
    }
}
