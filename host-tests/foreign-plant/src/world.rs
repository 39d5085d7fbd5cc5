//! All that happens in one run, but for noise and effects: the chamber, the unit's bodies, and its electrical quantities.

use crate::chamber;
use crate::operators::{lag, slope_per_min};
use crate::plan::{Followed, Plan};
use crate::unit::Unit;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// One run, sampled each `dt_s` from power-on.
#[derive(Clone, Debug)]
pub struct World {
    /// Step, s.
    pub dt_s: f64,
    /// Number of the first logged sample.
    pub first: usize,
    /// Plan by which the run was made.
    pub plan: Plan,
    /// Time since power-on, s.
    pub time_s: Vec<f64>,
    /// Air of the chamber, C.
    pub air_c: Vec<f64>,
    /// Base plate, C.
    pub base_c: Vec<f64>,
    /// Board, C.
    pub board_c: Vec<f64>,
    /// Cases, C.
    pub case_c: [Vec<f64>; 3],
    /// Holders, C; recorded by nobody.
    pub holder_c: [Vec<f64>; 3],
    /// The body that the bias follows, C.
    pub t_c: [Vec<f64>; 3],
    /// Its ramp, C/min.
    pub ramp: [Vec<f64>; 3],
    /// Supply, V.
    pub supply_v: Vec<f64>,
    /// Amplitude-control drive, V: it follows the damping.
    pub drive_v: [Vec<f64>; 3],
    /// Quadrature-nulling voltage, V.
    pub quad_v: [Vec<f64>; 3],
    /// Loss of the resonators over that at 25 C; empty unless the case makes the voltages of it.
    pub loss: [Vec<f64>; 3],
    /// Force that nulls the quadrature, V; the same.
    pub force_v: [Vec<f64>; 3],
}

impl World {
    /// Runs the chamber and the unit by `plan`.
    #[must_use]
    pub fn run(rng: &mut ChaCha8Rng, unit: &Unit, plan: Plan, followed: Followed, dt_s: f64) -> Self {
        let seconds = plan.log_from_s + plan.hours * 3600.0;
        let set_points = if plan.legs.is_empty() {
            plan.program.set_points(rng, plan.span, dt_s, seconds)
        } else {
            chamber::set_points(plan.legs, 0.0, plan.span.start_c, dt_s, seconds)
        };
        let air_c = unit.chamber.air(&set_points, dt_s);
        let bodies = unit.network.run(&air_c, dt_s);
        let t_c = match followed {
            Followed::Resonator => bodies.resonator_c,
            Followed::Case => bodies.case_c.clone(),
            Followed::Base => [bodies.base_c.clone(), bodies.base_c.clone(), bodies.base_c.clone()],
        };
        let ramp = [0, 1, 2].map(|a| slope_per_min(&t_c[a], dt_s, 2.0 * dt_s));
        let n = air_c.len();
        let e = &unit.electrics;
        let drive_v = [0, 1, 2].map(|a| {
            let own = ornstein(rng, n, dt_s, 0.016, 4000.0);
            t_c[a].iter().zip(own).map(|(t, own)| e.drive_v[a] * (1.0 + e.drive_per_c[a] * (t - 25.0)) + own).collect()
        });
        let quad_v = [0, 1, 2].map(|a| {
            let own = ornstein(rng, n, dt_s, 0.020, 3000.0);
            t_c[a].iter().zip(own).map(|(t, own)| e.quad_v[a] + e.quad_v_per_c[a] * (t - 25.0) + own).collect()
        });
        Self {
            dt_s,
            first: (plan.log_from_s / dt_s).round() as usize,
            plan,
            time_s: (0..n).map(|i| i as f64 * dt_s).collect(),
            supply_v: supply(rng, n, dt_s),
            air_c,
            base_c: bodies.base_c,
            board_c: bodies.board_c,
            case_c: bodies.case_c,
            holder_c: bodies.holder_c,
            t_c,
            ramp,
            drive_v,
            quad_v,
            loss: [const { Vec::new() }; 3],
            force_v: [const { Vec::new() }; 3],
        }
    }

    /// Number of samples, from power-on.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// `true` if there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Temperature at power-on, C.
    #[must_use]
    pub fn start_c(&self) -> f64 {
        self.plan.span.start_c
    }

    /// State at power-on of a body that remembers the day before, C.
    #[must_use]
    pub fn kept_start_c(&self) -> f64 {
        self.start_c() + self.plan.kept_c
    }
}

/// An Ornstein-Uhlenbeck process of deviation `sigma` and correlation time `tau_s`.
fn ornstein(rng: &mut ChaCha8Rng, n: usize, dt_s: f64, sigma: f64, tau_s: f64) -> Vec<f64> {
    let keep = (-dt_s / tau_s).exp();
    let kick = sigma * (1.0 - keep * keep).sqrt();
    let first: f64 = StandardNormal.sample(rng);
    let mut at = sigma * first;
    (0..n)
        .map(|_| {
            let noise: f64 = StandardNormal.sample(rng);
            at = at * keep + kick * noise;
            at
        })
        .collect()
}

/// A bench supply: slow drift, and a neighbour's load that comes and goes.
fn supply(rng: &mut ChaCha8Rng, n: usize, dt_s: f64) -> Vec<f64> {
    let drift = ornstein(rng, n, dt_s, 0.012, 5000.0);
    let (mut loaded, mut left_s) = (false, rng.random_range(300.0..2000.0));
    let load: Vec<f64> = (0..n)
        .map(|_| {
            left_s -= dt_s;
            if left_s <= 0.0 {
                loaded = !loaded;
                left_s = rng.random_range(600.0..3600.0);
            }
            if loaded {
                -0.040
            } else {
                0.0
            }
        })
        .collect();
    let sag = lag(&load, dt_s, 20.0, 0.0);
    drift.iter().zip(sag).map(|(drift, sag)| 5.02 + drift + sag).collect()
}
