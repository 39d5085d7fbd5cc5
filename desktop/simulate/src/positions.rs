//! A unit in positions: which specific force it feels, and what its accelerometers make of it.
//!
//! # Physics
//! A quartz pendulum that a coil in a magnet holds at its place. The flux of the magnet falls with temperature as that of a ferromagnet below its Curie
//! point, `(1 - (T/Tc)^2)^0.36`, so the current of one g rises by some 150 ppm per C. The bias is stress in the pendulum's joints, which gives way about
//! one temperature: an arc tangent. Both follow a body that lags behind the resonator. The pendulum tilts with temperature, linearly and a little with its
//! square; the square of the specific force adds to the bias. None of this is a polynomial or a ramp term, which is what a fit has.

use super::noise::normal;
use super::tilt::Tilt;
use hrg_core::accelerometers::STANDARD_GRAVITY_MPS2;
use hrg_core::rate_factors::OTHERS;
use hrg_core::AXES;
use hrg_data::recording::metadata::EARTH_RATE_DPH;
use hrg_data::recording::turns::{END_S, SETTLE_S};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Each axis up and down in turn, s in each: settling, a minute, and the end.
const DWELL_S: usize = SETTLE_S + 60 + END_S;

/// The six positions.
const SIX: [(usize, f64); 6] = [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)];

/// Time by which the pendulum's body is behind the resonator, s.
const BODY_LAG_S: f64 = 180.0;

/// White noise of a mean of a second, m/s^2: 5 ug.
const NOISE_MPS2: f64 = 5e-5;

fn position(second: usize) -> (usize, f64) {
    SIX[second / DWELL_S % SIX.len()]
}

/// Specific force along the axes of the case in each second, m/s^2: the axis of the position points up (or down).
#[must_use]
pub fn table_mps2(seconds: usize) -> [Vec<f64>; AXES] {
    [0, 1, 2].map(|a| {
        let of = |k| match position(k) {
            (axis, sign) if axis == a => sign * STANDARD_GRAVITY_MPS2,
            _ => 0.0,
        };
        (0..seconds).map(of).collect()
    })
}

/// The earth's rate in each second along the axes of the case, deg/h: the axis after that which points up points north.
pub(super) fn earth_rates_dph(seconds: usize, latitude_deg: f64) -> [Vec<f64>; AXES] {
    let (sin, cos) = latitude_deg.to_radians().sin_cos();
    [0, 1, 2].map(|a| {
        let of = |k| match position(k) {
            (axis, sign) if axis == a => sign * EARTH_RATE_DPH * sin,
            (axis, _) if (axis + 1) % AXES == a => EARTH_RATE_DPH * cos,
            _ => 0.0,
        };
        (0..seconds).map(of).collect()
    })
}

/// The accelerometers of a unit.
#[derive(Debug, Clone)]
pub struct Accelerometers {
    axes: [Pendulum; AXES],
}

#[derive(Debug, Clone)]
struct Pendulum {
    scale: f64,
    curie_k: f64,
    bias_mps2: f64,
    stress_mps2: f64,
    gives_way_c: f64,
    width_c: f64,
    /// Of the square of the specific force, s^2/m.
    square: f64,
    tilt: Tilt,
}

impl Pendulum {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        let ug = 1e-6 * STANDARD_GRAVITY_MPS2;
        let sign = |rng: &mut ChaCha8Rng| if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        Self {
            scale: rng.random_range(-2e-3..2e-3),
            curie_k: rng.random_range(1150.0..1300.0),
            bias_mps2: ug * rng.random_range(-3000.0..3000.0),
            stress_mps2: ug * rng.random_range(400.0..700.0) * sign(rng),
            gives_way_c: rng.random_range(0.0..30.0),
            width_c: rng.random_range(50.0..80.0),
            square: ug / STANDARD_GRAVITY_MPS2.powi(2) * rng.random_range(5.0..20.0) * sign(rng),
            tilt: Tilt {
                at_20_c: [0; 2].map(|_| 1e-6 * rng.random_range(300.0..1000.0) * sign(rng)),
                per_c: [0; 2].map(|_| 1e-6 * rng.random_range(-1.0..1.0)),
                per_c2: [0; 2].map(|_| 1e-9 * rng.random_range(-0.6..0.6)),
            },
        }
    }

    /// Current of one g over that at 20 C.
    fn magnet(&self, t: f64) -> f64 {
        let flux = |t: f64| (1.0 - ((t + 273.15) / self.curie_k).powi(2)).powf(0.36);
        flux(20.0) / flux(t)
    }

    fn bias(&self, t: f64) -> f64 {
        self.bias_mps2 + self.stress_mps2 * ((t - self.gives_way_c) / self.width_c).atan()
    }
}

impl Accelerometers {
    /// Those of a unit.
    #[must_use]
    pub fn of(unit_seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(0xACCE_1E00));
        Self { axes: [0; AXES].map(|_| Pendulum::new(&mut rng)) }
    }

    /// Bias of an accelerometer on a soak at a temperature, m/s^2.
    #[must_use]
    pub fn bias_mps2(&self, axis: usize, temperature_c: f64) -> f64 {
        self.axes[axis].bias(temperature_c)
    }

    /// The same with what the square of the specific force adds on average over six positions, four of which lie across it.
    #[must_use]
    pub fn bias_in_positions_mps2(&self, axis: usize, temperature_c: f64) -> f64 {
        self.bias_mps2(axis, temperature_c) + self.axes[axis].square * STANDARD_GRAVITY_MPS2.powi(2) / 3.0
    }

    /// Share of the specific force along its axis that an accelerometer gives on a soak at a temperature.
    #[must_use]
    pub fn scale_factor(&self, axis: usize, temperature_c: f64) -> f64 {
        (1.0 + self.axes[axis].scale) * self.axes[axis].magnet(temperature_c)
    }

    /// Specific forces that they give, m/s^2, second by second.
    pub(super) fn forces_mps2(&self, resonator_c: &[Vec<f64>; AXES], rng: &mut ChaCha8Rng) -> [Vec<f64>; AXES] {
        let n = resonator_c[0].len();
        let table = table_mps2(n);
        let share = 1.0 - (-1.0 / BODY_LAG_S).exp();
        [0, 1, 2].map(|a: usize| {
            let one = &self.axes[a];
            let mut body_c = resonator_c[a].first().copied().unwrap_or(0.0);
            (0..n)
                .map(|k| {
                    body_c += share * (resonator_c[a][k] - body_c);
                    let along = one.tilt.along(body_c, table[a][k], OTHERS[a].map(|j| table[j][k]));
                    (1.0 + one.scale) * one.magnet(body_c) * along
                        + one.bias(body_c)
                        + one.square * along * along
                        + NOISE_MPS2 * normal(rng)
                })
                .collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_accelerometer_changes_as_those_of_its_kind() {
        for unit in 0..20 {
            let all = Accelerometers::of(unit);
            for a in 0..AXES {
                let per_c = (all.scale_factor(a, 30.0) - all.scale_factor(a, 10.0)) / 20.0 * 1e6;
                assert!((110.0..180.0).contains(&per_c), "unit {unit}: {per_c} ppm per C");
                let span = (all.bias_mps2(a, 60.0) - all.bias_mps2(a, -40.0)).abs() / 9.8e-6;
                assert!((300.0..1500.0).contains(&span), "unit {unit}: {span} ug");
            }
        }
    }

    #[test]
    fn each_axis_points_up_and_down_in_a_round() {
        let table = table_mps2(6 * DWELL_S);
        for axis in &table {
            assert_eq!(axis.iter().filter(|f| **f > 9.0).count(), DWELL_S);
            assert!(axis.iter().sum::<f64>().abs() < 1e-9);
        }
    }
}
