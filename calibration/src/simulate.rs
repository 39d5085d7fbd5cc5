//! A chamber run from a plant model: everything in it is simulated, and known.
//!
//! Chamber profile -> case (first-order lag) -> resonator (first-order lag of 694 s, zhao2022) with self-heating
//! -> frequency by the laws of dong2023's Table 1 -> bias by eq 7, plus effects -> rate with white, flicker and
//! random-walk noise, and the earth's rate of the attitude. The case sensor has the steps of a DS18B20 (0.0625 C).

use crate::metadata::{self, Attitude, Direction};
use crate::recording::Recording;
use crate::stats::{block_means, std_dev};
use crate::BadInput;
use hrg_core::bias::{regressors, Scaling, State, TERMS};
use hrg_core::calibration::Calibration;
use hrg_core::effects::{by_name, Inputs, Recorded, Running, ALL, MAX_PARAMETERS};
use hrg_core::thermal::{AxisThermal, Thermal};
use hrg_core::AXES;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// One leg of a chamber profile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Leg {
    /// Drive to a temperature (C) at a rate (C per minute).
    Ramp(f64, f64),
    /// Hold for a time (s).
    Soak(f64),
}

/// A chamber profile: where it starts (C), and its legs.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Temperature at the start, in equilibrium, C.
    pub start_c: f64,
    /// Legs in order.
    pub legs: Vec<Leg>,
}

/// Profiles with a name.
pub const PROFILES: [(&str, &str); 10] = [
    ("dong", "25,-40@1,5h,50@1,1h"),
    ("cycle", "20,-40@1,110m,50@1,110m,20@1,20m"),
    ("verify", "20,50@0.8,100m,-35@1.2,2h,30@0.6,1h,-10@1,90m"),
    ("stairs", "20,-40@1,1h,-20@1,1h,0@1,1h,20@1,1h,40@1,1h,50@1,40m,0@1,40m"),
    ("ramps", "20,50@0.5,30m,-40@1.5,40m,50@3,40m,-40@3,40m,20@1,30m"),
    ("fast", "10,40@4,6m,-10@5,10m,45@5,10m,10@3"),
    ("zhao", "0,2h,60@5,100m"),
    ("wu", "20,-40@1,1h,60@1,1h,20@1,30m"),
    ("lag", "20,4h,30@10,3h"),
    ("up", "-40,2h,50@1,2h"),
];

impl Profile {
    /// A named profile, or one written out: start temperature, then `TARGET@RATE` (C, C per minute) and soaks
    /// (`90m`, `5h`, `600s`), separated by commas.
    ///
    /// # Errors
    /// A sentence that names the leg.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let text = PROFILES.iter().find(|(n, _)| *n == text).map_or(text, |(_, t)| t);
        let bad = |leg: &str| {
            BadInput::new(format!(
                "profile: \"{leg}\" is neither a start temperature, a ramp like -40@1, nor a soak like 90m; named ones are {}",
                PROFILES.map(|(n, _)| n).join(", ")
            ))
        };
        let mut parts = text.split(',').map(str::trim);
        let first = parts.next().unwrap_or("");
        let start_c: f64 = first.parse().map_err(|_| bad(first))?;
        let mut legs = Vec::new();
        for leg in parts {
            legs.push(if let Some((target, rate)) = leg.split_once('@') {
                let rate: f64 = rate.parse().map_err(|_| bad(leg))?;
                if !(rate > 0.0) {
                    return Err(bad(leg));
                }
                Leg::Ramp(target.parse().map_err(|_| bad(leg))?, rate)
            } else {
                let (number, unit) = leg.split_at(leg.len().saturating_sub(1));
                let seconds = match unit {
                    "h" => 3600.0,
                    "m" => 60.0,
                    "s" => 1.0,
                    _ => return Err(bad(leg)),
                };
                Leg::Soak(number.parse::<f64>().map_err(|_| bad(leg))? * seconds)
            });
        }
        if legs.is_empty() {
            return Err(bad(text));
        }
        Ok(Self { start_c, legs })
    }

    /// Chamber temperature each second.
    #[must_use]
    pub fn temperatures(&self) -> Vec<f64> {
        let mut out = vec![self.start_c];
        let mut t = self.start_c;
        for leg in &self.legs {
            match *leg {
                Leg::Ramp(target, rate) => {
                    let steps = ((target - t).abs() / rate * 60.0).ceil();
                    let from = t;
                    for k in 1..=steps as usize {
                        out.push(from + (target - from) * k as f64 / steps);
                    }
                    t = target;
                }
                Leg::Soak(s) => out.extend(std::iter::repeat_n(t, s as usize)),
            }
        }
        out
    }
}

/// An effect to put in: name, parameters, size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectSpec {
    /// Name, from the library or an outsider's.
    pub name: String,
    /// Inner parameter, in its unit.
    pub parameter: f64,
    /// What it leaves after the baseline fit, RMS of 100 s means, in noise floors.
    pub size: f64,
}

/// Effects that the library does not have; what the tool should call unexplained (or a shape of temperature).
pub const OUTSIDERS: [&str; 6] = [
    "outsider-ripple",
    "outsider-bump",
    "outsider-wave-train",
    "outsider-product",
    "outsider-relay",
    "outsider-drift-burst",
];

/// The inner parameter where a specification names none.
fn default_parameter(name: &str) -> f64 {
    match name {
        "kink" => 8.0,
        "thermal-lag" => 2400.0,
        "hysteresis" => 12.0,
        "warm-up" => 1800.0,
        "step" => 9000.0,
        "periodic" => 900.0,
        "timebase" => 694.0,
        "outsider-ripple" => 14.0,
        "outsider-bump" => 5.0,
        "outsider-wave-train" => 1500.0,
        _ => 0.0,
    }
}

impl EffectSpec {
    /// `NAME[:key=value,...]` with the keys `size` and the effect's own parameter (`tau_s`, `width_c`, ...).
    ///
    /// # Errors
    /// A sentence that names what is wrong.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        if by_name(name).is_none() && !OUTSIDERS.contains(&name) {
            return Err(BadInput::new(format!(
                "effect \"{name}\" is not known; there are {}, {} and secret:SEED",
                ALL.iter().map(|f| f.name).collect::<Vec<_>>().join(", "),
                OUTSIDERS.join(", ")
            )));
        }
        let mut spec = Self { name: name.into(), parameter: default_parameter(name), size: 2.0 };
        for item in rest.split(',').filter(|s| !s.is_empty()) {
            let value = item.split_once('=').and_then(|(k, v)| v.parse::<f64>().ok().map(|v| (k, v)));
            match value {
                Some(("size", v)) => spec.size = v,
                Some((key, v))
                    if by_name(name).is_some_and(|f| f.parameters.contains(&key)) || OUTSIDERS.contains(&name) =>
                {
                    spec.parameter = v;
                }
                _ => {
                    return Err(BadInput::new(format!(
                        "effect {name}: \"{item}\" is not one of size=..., {}",
                        by_name(name).map_or("p=...".to_string(), |f| f.parameters.join("=..., "))
                    )))
                }
            }
        }
        Ok(spec)
    }

    /// Effect, parameter and size drawn by a seed; one in five from outside the library.
    #[must_use]
    pub fn secret(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5EC2_E75E_C2E7);
        let inside = ["cubic", "kink", "thermal-lag", "hysteresis", "axis-gradient", "warm-up", "step", "periodic"];
        let name = if rng.random_bool(0.2) {
            OUTSIDERS[rng.random_range(0..OUTSIDERS.len())]
        } else {
            inside[rng.random_range(0..inside.len())]
        };
        Self::drawn(name, rng.random_range(2.0..5.0), &mut rng)
    }

    /// A named effect of a size with its parameter drawn within what the physics allows.
    #[must_use]
    pub fn drawn(name: &str, size: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut range = |low: f64, high: f64| rng.random_range(low..high);
        let parameter = match name {
            "kink" => range(-18.0, 32.0),
            "thermal-lag" => range(1200.0, 6000.0),
            "hysteresis" => range(5.0, 25.0),
            "warm-up" => range(700.0, 4000.0),
            "step" => range(4000.0, 20_000.0),
            "periodic" => range(400.0, 3000.0),
            "outsider-ripple" => range(9.0, 16.0),
            "outsider-bump" => range(3.0, 7.0),
            "outsider-wave-train" => range(700.0, 2000.0),
            _ => 0.0,
        };
        Self { name: name.into(), parameter, size }
    }
}

/// Noise of the rates, all in deg/h.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Standard deviation that white noise alone gives 100 s means.
    pub white_100s_dph: f64,
    /// Flicker: standard deviation of each of five first-order processes, one per decade of time constant.
    pub flicker_dph: f64,
    /// Random walk: standard deviation gathered in an hour.
    pub walk_per_root_h_dph: f64,
    /// Frequency noise of a 1 s gate, Hz.
    pub frequency_hz: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { white_100s_dph: 0.2, flicker_dph: 0.025, walk_per_root_h_dph: 0.02, frequency_hz: 5e-6 }
    }
}

/// What kind of unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// A unit like dong2023's: eq 7.
    #[default]
    Hrg,
    /// A fibre-optic gyro like wu2023's: four parameters and a breakpoint; its frequency column stands for its
    /// temperature sensor.
    Fog,
    /// A gyro like zhao2022's: bias a curve of temperature that bends more than a cubic.
    Zhao,
}

impl Kind {
    /// By name: hrg, fog, zhao.
    ///
    /// # Errors
    /// Any other name.
    pub fn parse(name: &str) -> Result<Self, BadInput> {
        match name {
            "hrg" => Ok(Self::Hrg),
            "fog" => Ok(Self::Fog),
            "zhao" => Ok(Self::Zhao),
            _ => Err(BadInput::new(format!("kind \"{name}\" is not known; there are hrg, fog and zhao"))),
        }
    }

    /// Noise of such a gyro, of the size that its paper is left with.
    #[must_use]
    pub fn noise(self) -> Noise {
        let hrg = Noise::default();
        let of = |white_100s_dph, flicker_dph, walk_per_root_h_dph| Noise {
            white_100s_dph,
            flicker_dph,
            walk_per_root_h_dph,
            ..hrg
        };
        match self {
            Self::Hrg => hrg,
            Self::Fog => of(0.0055, 0.0005, 0.0003),
            Self::Zhao => of(0.06, 0.008, 0.008),
        }
    }

    /// The bias of a unit of this kind at a temperature (C) and its rate of change (C per minute).
    fn bias(self, unit_seed: u64) -> impl Fn(&Scaling, usize, f64, f64) -> f64 {
        let coefficients = unit_coefficients(unit_seed);
        let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(71));
        // Each axis of each unit a little different.
        let own: [[f64; 5]; AXES] = [0; AXES].map(|_| [0; 5].map(|_| rng.random_range(0.7..1.3)));
        move |scaling, a, t, r| {
            let o = &own[a];
            match self {
                Self::Hrg => {
                    let x = regressors(scaling, t as f32, r as f32);
                    x.iter().zip(&coefficients[a]).map(|(x, c)| f64::from(*x) * c).sum()
                }
                // deg/h: raw standard deviation about 0.016 on the profile `wu` (theirs: 0.0156).
                Self::Fog => {
                    let x = t - 20.0 * o[4];
                    let change = if r < 0.0 { 0.011 * o[0] } else { 0.017 * o[1] };
                    let slope = if x < 0.0 { -0.00022 * o[2] } else { 0.00035 * o[3] };
                    0.3 + change * r + slope * x
                }
                // deg/h: from about -2.4 to -11 between 0 and 60 C of the chamber (theirs).
                Self::Zhao => {
                    let x = (t - 6.7) / 60.0;
                    let bend = 2.6 * o[0];
                    let s = |x: f64| (bend * (2.0 * x - 0.9 * o[1])).tanh();
                    let curve = (s(x) - s(0.0)) / (s(1.0) - s(0.0));
                    -2.4497 - 8.5716 * curve + 0.25 * o[2] * (7.0 * o[3] * x).sin()
                }
            }
        }
    }
}

/// A run to simulate. The same `unit_seed` is the same unit; `seed` is the noise of this run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What kind of unit.
    pub kind: Kind,
    /// Chamber profile.
    pub profile: Profile,
    /// Effects put in.
    pub effects: Vec<EffectSpec>,
    /// Which unit.
    pub unit_seed: u64,
    /// Which noise.
    pub seed: u64,
    /// How much noise.
    pub noise: Noise,
    /// The profile on which the effects have the sizes wanted. Gains belong to the unit: the same unit, effects and
    /// sizing have the same gains on any other profile. `None`: the profile `cycle`.
    pub sizing: Option<Profile>,
    /// How the unit stands: its recording holds the components of the earth's rate along its axes, and says so.
    pub attitude: Attitude,
}

/// Where a simulated unit stands unless told otherwise.
pub const ATTITUDE: Attitude =
    Attitude { latitude_deg: 28.2, axes: [Direction::North, Direction::East, Direction::Down] };

/// What the simulator knows and the recording does not tell.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Truth {
    /// Effects.
    pub effects: Vec<EffectSpec>,
    /// Their gains per axis (deg/h per unit of the first regressor).
    pub gains: Vec<[f64; AXES]>,
    /// Standard deviation of 100 s means of the noise put in, per axis, deg/h.
    pub floor_dph: [f64; AXES],
    /// Standard deviation of 100 s means of the raw rate.
    pub raw_dph: [f64; AXES],
}

/// A simulated run.
#[derive(Debug, Clone)]
pub struct Simulated {
    /// What a chamber would have recorded.
    pub recording: Recording,
    /// What it does not tell.
    pub truth: Truth,
    /// The noise in the rates, deg/h: without it they are the bias (and the earth's rate).
    pub noise_dph: [Vec<f64>; AXES],
}

/// Thermal lag of the resonators behind the case, s (zhao2022: 694 s; the axes of one unit differ a little).
const RESONATOR_LAG_S: [f64; AXES] = [694.0, 655.0, 741.0];
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
struct Plant {
    case_c: [Vec<f64>; AXES],
    resonator_c: [Vec<f64>; AXES],
    slope_c_per_min: [Vec<f64>; AXES],
    board_c: Vec<f64>,
}

fn lag(input: &[f64], tau: f64) -> Vec<f64> {
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
    fn thermal(&self, k: usize) -> Thermal {
        let axes = [0, 1, 2].map(|a| {
            let temperature_c = self.resonator_c[a][k] as f32;
            let rate_c_per_min = self.slope_c_per_min[a][k] as f32;
            let state = State {
                temperature_c,
                rate_c_per_min,
                difference_c_per_min: rate_c_per_min,
                frequency_u: (temperature_c - 10.0) / 45.0,
                frequency_u_per_min: rate_c_per_min / 45.0,
            };
            AxisThermal { state, known: true, age: 0, settled: true }
        });
        Thermal { axes, time_s: (k + 1) as f32 }
    }

    fn new(chamber: &[f64]) -> Self {
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

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// A smooth wander with a time constant, unit variance.
fn wander(n: usize, tau: f64, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let keep = (-1.0 / tau).exp();
    let drive = (1.0 - keep * keep).sqrt();
    let mut x = normal(rng);
    (0..n)
        .map(|_| {
            x = keep * x + drive * normal(rng);
            x
        })
        .collect()
}

/// Noise of one rate channel.
fn rate_noise(n: usize, noise: &Noise, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let white = noise.white_100s_dph * 10.0;
    let mut out: Vec<f64> = (0..n).map(|_| white * normal(rng)).collect();
    for decade in 1..=5 {
        for (o, w) in out.iter_mut().zip(wander(n, 10f64.powi(decade), rng)) {
            *o += noise.flicker_dph * w;
        }
    }
    let mut walk = 0.0;
    for o in &mut out {
        walk += noise.walk_per_root_h_dph / 60.0 * normal(rng);
        *o += walk;
    }
    out
}

/// The bias model that a simulated unit is given: eq 7 in the scaling of the uncalibrated block.
fn unit_coefficients(unit_seed: u64) -> [[f64; TERMS]; AXES] {
    let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(17));
    [0, 1, 2].map(|_| {
        // deg/h at u = 1 (45 C from the middle) and at 1 C per minute: sizes that give dong2023's raw 7 to
        // 10 deg/h (3 sigma).
        [3.0, 3.2, 1.3, 0.6, 0.08, 0.25]
            .map(|s| s * (0.5 + rng.random::<f64>()) * if rng.random_bool(0.5) { 1.0 } else { -1.0 })
    })
}

/// Bias of one effect for one axis, with gain one.
fn effect_bias(
    spec: &EffectSpec,
    plant: &Plant,
    recorded: &[Recorded],
    scaling: &Scaling,
    a: usize,
    mix: f64,
) -> Vec<f64> {
    let n = plant.board_c.len();
    if let Some(facts) = by_name(&spec.name) {
        let mut p = [spec.parameter as f32, 0.0];
        if spec.name == "temperature-shape" {
            p = [-38.0, 60.0];
        }
        let p: [f32; MAX_PARAMETERS] = p;
        let Some(mut running) = Running::new(facts.id, &p, 1.0) else {
            return vec![0.0; n];
        };
        // Effects with several regressors: a fixed mix.
        let weights = [1.0, mix, 0.5, -0.6, 0.4, 0.3, -0.3, 0.2];
        return (0..n)
            .map(|k| {
                let thermal = plant.thermal(k);
                let inputs = Inputs { scaling, thermal: &thermal, axis: a, recorded: recorded[k] };
                running.step(&inputs).iter().take(facts.outputs).zip(weights).map(|(x, w)| f64::from(*x) * w).sum()
            })
            .collect();
    }
    let t = &plant.resonator_c[a];
    let r = &plant.slope_c_per_min[a];
    let p = spec.parameter;
    let mut relay = 0.0;
    (0..n)
        .map(|k| {
            let s = k as f64;
            match spec.name.as_str() {
                // Interference ripple in temperature.
                "outsider-ripple" => (std::f64::consts::TAU * t[k] / p).sin(),
                // A mode crossing: a bump over a few degrees.
                "outsider-bump" => (-((t[k] - 12.0) / p).powi(2)).exp(),
                // Sloshing that starts with the second hour and dies out.
                "outsider-wave-train" => {
                    let x = s - 7000.0;
                    if x < 0.0 {
                        0.0
                    } else {
                        (std::f64::consts::TAU * x / p).sin() * (-x / 5000.0).exp()
                    }
                }
                // Rate of change acts only when cold.
                "outsider-product" => r[k] * (-(t[k] + 25.0) / 12.0).exp().min(3.0),
                // A relay with temperature memory: switches at 30 C rising and at -10 C falling.
                "outsider-relay" => {
                    if t[k] > 30.0 {
                        relay = 1.0;
                    } else if t[k] < -10.0 {
                        relay = 0.0;
                    }
                    relay
                }
                // Two bursts that come and go.
                _ => {
                    let burst = |c: f64, w: f64| (-((s - c) / w).powi(2)).exp();
                    burst(6000.0, 900.0) - 0.8 * burst(17_000.0, 1400.0)
                }
            }
        })
        .collect()
}

/// What a series leaves, RMS of 100 s means, after the baseline has taken its share.
fn left_after_baseline(series: &[f64], plant: &Plant, scaling: &Scaling, a: usize) -> f64 {
    let columns: Vec<Vec<f64>> = (0..TERMS)
        .map(|j| {
            let column: Vec<f64> = (0..series.len())
                .map(|k| {
                    f64::from(
                        regressors(scaling, plant.resonator_c[a][k] as f32, plant.slope_c_per_min[a][k] as f32)[j],
                    )
                })
                .collect();
            block_means(&column, 100)
        })
        .collect();
    let y = block_means(series, 100);
    crate::lsq::fit(&columns, &y, None, &[]).map_or_else(|_| std_dev(&y), |f| (f.squares / f.rows as f64).sqrt())
}

/// The quantities of a run that only a recording has.
struct Monitors {
    board_c: Vec<f64>,
    supply_v: Vec<f64>,
    drive_v: [Vec<f64>; AXES],
    quad_v: [Vec<f64>; AXES],
    clock_ppm: Vec<f64>,
}

impl Monitors {
    /// Each follows temperature and wanders by itself.
    fn new(plant: &Plant, rng: &mut ChaCha8Rng) -> Self {
        let n = plant.board_c.len();
        Self {
            board_c: plant.board_c.iter().zip(wander(n, 5000.0, rng)).map(|(b, w)| b + 0.8 * w).collect(),
            supply_v: wander(n, 4000.0, rng).iter().map(|w| 5.0 + 0.02 * w).collect(),
            drive_v: [0, 1, 2].map(|a: usize| {
                let w = wander(n, 6000.0, rng);
                (0..n).map(|k| 1.2 + 0.002 * (plant.resonator_c[a][k] - 10.0) + 0.02 * w[k]).collect()
            }),
            quad_v: [0, 1, 2].map(|a: usize| {
                let w = wander(n, 8000.0, rng);
                (0..n).map(|k| 0.1 - 0.001 * plant.resonator_c[a][k] + 0.03 * w[k]).collect()
            }),
            clock_ppm: wander(n, 7000.0, rng),
        }
    }

    fn recorded(&self, plant: &Plant) -> Vec<Recorded> {
        (0..plant.board_c.len())
            .map(|k| Recorded {
                case_c: [0, 1, 2].map(|b: usize| plant.case_c[b][k] as f32),
                board_c: self.board_c[k] as f32,
                supply_v: self.supply_v[k] as f32,
                drive_v: self.drive_v.each_ref().map(|v| v[k] as f32),
                quad_v: self.quad_v.each_ref().map(|v| v[k] as f32),
            })
            .collect()
    }
}

impl Plan {
    /// A unit like dong2023's without any effect, with the noise of its kind.
    #[must_use]
    pub fn of(profile: Profile, unit_seed: u64, seed: u64) -> Self {
        let kind = Kind::Hrg;
        Self { kind, profile, effects: vec![], unit_seed, seed, noise: kind.noise(), sizing: None, attitude: ATTITUDE }
    }

    /// Sign and mix of each effect on each axis: they belong to the unit, not to the run.
    fn signs(&self) -> Vec<[(f64, f64); AXES]> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.unit_seed.wrapping_add(0xEFFE_C700));
        self.effects
            .iter()
            .map(|_| [0; AXES].map(|_| (if rng.random_bool(0.5) { 1.0 } else { -1.0 }, rng.random_range(-0.8..0.8))))
            .collect()
    }

    /// Gains that give the effects their sizes on the sizing profile.
    fn gains(&self) -> Vec<[f64; AXES]> {
        if self.effects.is_empty() {
            return Vec::new();
        }
        let reference = Profile { start_c: 20.0, legs: vec![] };
        let profile = self.sizing.clone().or_else(|| Profile::parse("cycle").ok()).unwrap_or(reference);
        let plant = Plant::new(&profile.temperatures());
        let n = plant.board_c.len();
        let mut rng = ChaCha8Rng::seed_from_u64(self.unit_seed ^ 0x6A1_5000);
        let monitors = Monitors::new(&plant, &mut rng);
        let default = Calibration::uncalibrated();
        let floor = [0; AXES].map(|_| std_dev(&block_means(&rate_noise(n, &self.noise, &mut rng), 100)));
        self.effects
            .iter()
            .zip(self.signs())
            .map(|(spec, signs)| {
                [0, 1, 2].map(|a: usize| {
                    let bias = effect_bias(spec, &plant, &monitors.recorded(&plant), &default.scaling, a, signs[a].1);
                    let left = left_after_baseline(&bias, &plant, &default.scaling, a);
                    if left > 0.0 {
                        signs[a].0 * spec.size * floor[a] / left
                    } else {
                        0.0
                    }
                })
            })
            .collect()
    }

    /// Simulates the run.
    #[must_use]
    pub fn simulate(&self) -> Simulated {
        let chamber = self.profile.temperatures();
        let n = chamber.len();
        let plant = Plant::new(&chamber);
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let default = Calibration::uncalibrated();
        let scaling = &default.scaling;
        let monitors = Monitors::new(&plant, &mut rng);
        let has_clock_wander = self.effects.iter().any(|e| e.name == "timebase");
        let quantised: [Vec<f64>; AXES] =
            [0, 1, 2].map(|a| plant.case_c[a].iter().map(|t| (t / 0.0625).round() * 0.0625).collect());
        let noise = [0; AXES].map(|_| rate_noise(n, &self.noise, &mut rng));
        let floor_dph = [0, 1, 2].map(|a: usize| std_dev(&block_means(&noise[a], 100)));
        let bias = self.kind.bias(self.unit_seed);
        let mut rate = [0, 1, 2].map(|a| -> Vec<f64> {
            (0..n)
                .map(|k| bias(scaling, a, plant.resonator_c[a][k], plant.slope_c_per_min[a][k]) + noise[a][k])
                .collect()
        });
        let gains = self.gains();
        for ((spec, signs), gains) in self.effects.iter().zip(self.signs()).zip(&gains) {
            for a in 0..AXES {
                let bias = effect_bias(spec, &plant, &monitors.recorded(&plant), scaling, a, signs[a].1);
                for (r, b) in rate[a].iter_mut().zip(&bias) {
                    *r += gains[a] * b;
                }
            }
        }
        let raw_dph = [0, 1, 2].map(|a: usize| std_dev(&block_means(&rate[a], 100)));
        let frequency_hz = [0, 1, 2].map(|a: usize| -> Vec<f64> {
            let law = &default.axes[a].law;
            (0..n)
                .map(|k| {
                    let f = law.frequency_hz(plant.resonator_c[a][k]).unwrap_or(f64::NAN);
                    let clock = if has_clock_wander { 1.0 + 1e-6 * monitors.clock_ppm[k] } else { 1.0 };
                    f * clock + self.noise.frequency_hz * normal(&mut rng)
                })
                .collect()
        });
        let mut optional: Vec<(&'static str, Vec<f64>)> = Vec::new();
        let [qx, qy, qz] = quantised;
        let [dx, dy, dz] = monitors.drive_v;
        let [ux, uy, uz] = monitors.quad_v;
        for (name, values) in crate::recording::OPTIONAL.into_iter().zip([
            qx,
            qy,
            qz,
            chamber,
            monitors.board_c,
            monitors.supply_v,
            dx,
            dy,
            dz,
            ux,
            uy,
            uz,
        ]) {
            optional.push((name, values));
        }
        let meta = [
            ("hrg-recording", "1".to_string()),
            ("unit", format!("SIM-{}", self.unit_seed)),
            ("run", format!("simulated-{}", self.seed)),
            ("rate_unit", "deg/h".to_string()),
            ("rates", "raw".to_string()),
            ("power_on_s", "0".to_string()),
            ("latitude_deg", self.attitude.latitude_deg.to_string()),
            ("axes", self.attitude.axes_text()),
            (metadata::SCALE_FACTOR, metadata::scale_text(&default.scale_factors_dph_per_code())),
        ];
        Simulated {
            recording: Recording {
                meta: meta.into_iter().map(|(k, v)| (k.to_string(), v)).collect(),
                time_s: (0..n).map(|k| (k + 1) as f64).collect(),
                frequency_hz,
                rate_dph: rate,
                optional,
                // As a file with it is after reading: the file has it.
                earth_rate_dph: Some(self.attitude.earth_rate_dph()),
                ..Recording::default()
            },
            noise_dph: noise,
            truth: Truth { effects: self.effects.clone(), gains, floor_dph, raw_dph },
        }
    }
}

/// Adds what real files have: spikes, missing values, gaps, stuck values, repeated times.
pub fn soil(recording: &mut Recording, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xD127);
    let n = recording.time_s.len();
    for a in 0..AXES {
        for _ in 0..n / 500 {
            let k = rng.random_range(0..n);
            recording.rate_dph[a][k] += if rng.random_bool(0.5) { 500.0 } else { -300.0 };
            let k = rng.random_range(0..n);
            recording.frequency_hz[a][k] += if rng.random_bool(0.5) { 3.0 } else { -5.0 };
            recording.rate_dph[a][rng.random_range(0..n)] = f64::NAN;
            recording.frequency_hz[a][rng.random_range(0..n)] = f64::NAN;
        }
        let at = rng.random_range(0..n - 200);
        let value = recording.rate_dph[a][at];
        recording.rate_dph[a][at..at + 120].fill(value);
    }
    for _ in 0..20 {
        let k = rng.random_range(1..n);
        recording.time_s[k] = recording.time_s[k - 1];
    }
    // A gap of three minutes: the rows are gone.
    let at = rng.random_range(n / 4..n / 2);
    for k in at..(at + 180).min(n) {
        recording.time_s[k] = f64::NAN;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(effects: &[&str]) -> Plan {
        Plan {
            effects: effects.iter().map(|e| EffectSpec::parse(e).expect("known")).collect(),
            ..Plan::of(Profile::parse("fast").expect("named"), 3, 5)
        }
    }

    #[test]
    fn profiles_are_parsed_and_refused_with_the_leg() {
        for (name, _) in PROFILES {
            assert!(Profile::parse(name).expect("named").temperatures().len() > 600);
        }
        assert!(Profile::parse("20,50@x").expect_err("bad").0.contains("50@x"));
        assert!(Profile::parse("nothing").is_err());
        let p = Profile::parse("20,50@3,10m").expect("fine").temperatures();
        assert_eq!(p.len(), 1 + 600 + 600);
    }

    #[test]
    fn a_seed_repeats_exactly_and_another_does_not() {
        let a = plan(&["hysteresis"]).simulate();
        assert_eq!(a.recording, plan(&["hysteresis"]).simulate().recording);
        let mut other = plan(&["hysteresis"]);
        other.seed = 6;
        assert_ne!(a.recording.rate_dph, other.simulate().recording.rate_dph);
    }

    #[test]
    fn the_recording_does_not_tell() {
        let a = plan(&[]).simulate().recording;
        let b = plan(&["kink:size=4"]).simulate().recording;
        assert_eq!(a.meta, b.meta);
        assert_eq!(a.optional.len(), b.optional.len());
    }

    #[test]
    fn sizes_are_in_noise_floors() {
        let s = plan(&["thermal-lag:tau_s=900,size=3"]).simulate();
        // Refit by hand: with the effect the baseline leaves sqrt(1 + 9) floors.
        for a in 0..AXES {
            assert!(s.truth.gains[0][a] != 0.0);
            assert!((0.12..0.5).contains(&s.truth.floor_dph[a]), "{}", s.truth.floor_dph[a]);
        }
    }
}
