//! A chamber run from a plant model: everything in it is simulated, and known.
//!
//! Chamber profile -> case (first-order lag) -> resonator (first-order lag of 694 s, zhao2022) with self-heating
//! -> frequency by the curves of dong2023's Table 1 -> bias by eq 7, plus effects -> rate with white, flicker and
//! random-walk noise, and the earth's rate of the attitude. Losses and stiffness of the resonators make the effects of drive and quadrature,
//! and the loops show them in a recording, late and with noise. The case sensor has the steps of a DS18B20 (0.0625 C).
//! In the place of resonators platinum resistors at an ADC may stand, one in each gyro ([`Plan::thermometer`]): all that a gyro
//! without a resonator has.

mod defects;
mod effects;
mod noise;
mod plant;
pub mod positions;
pub mod profile;
mod resonance;
mod tilt;
pub mod turning;
mod units;

pub use defects::inject_defects;
pub use effects::{EffectSpec, Source, Unmodelled};
pub use noise::Noise;
pub use plant::RESONATOR_LAG_S;
pub use profile::{Leg, Profile, PROFILES};
pub use units::Kind;

use effects::{effect_bias, left_after_baseline};
use hrg_core::calibration::Calibration;
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{block_means, std_dev};
use hrg_data::recording::columns;
use hrg_data::recording::columns::Column;
use hrg_data::recording::metadata;
use hrg_data::recording::metadata::{Attitude, Direction};
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::Recording;
use noise::{normal, rate_noise};
use plant::{Monitors, Plant};
use positions::Accelerometers;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use turning::{Gyros, Scheme};

/// A run to simulate. The same `unit_seed` is the same unit; `seed` is the noise of this run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// Kind of unit.
    pub kind: Kind,
    /// Thermometers: resonators, or a sensor in each gyro ([`Thermometer::Sensors`]). With sensors the recording has no column of a
    /// resonator: no frequency, no case sensor to calibrate it by, no drive, no quadrature.
    pub thermometer: Thermometer,
    /// Chamber profile.
    pub profile: Profile,
    /// Effects put in.
    pub effects: Vec<EffectSpec>,
    /// Seed of the unit.
    pub unit_seed: u64,
    /// Seed of the noise.
    pub seed: u64,
    /// Noise level.
    pub noise: Noise,
    /// The profile on which the effects have the sizes wanted. Gains belong to the unit: the same unit, effects and
    /// sizing have the same gains on any other profile. `None`: the profile `cycle`.
    pub sizing: Option<Profile>,
    /// Attitude: its recording holds the components of the earth's rate along its axes, and states it.
    pub attitude: Attitude,
    /// A rate table that turns it; its recording then holds the table's rates, and the whole earth's rate. `None`: it stands still.
    pub turning: Option<Scheme>,
    /// It is held in six positions, gone round again and again, and its recording holds specific forces.
    pub positions: bool,
}

/// Attitude of a simulated unit by default.
pub const ATTITUDE: Attitude =
    Attitude { latitude_deg: 28.2, axes: [Some(Direction::North), Some(Direction::East), Some(Direction::Down)] };

/// True values that the recording does not contain.
#[derive(Debug, Clone)]
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
    /// Recording as a chamber would have made it.
    pub recording: Recording,
    /// True values behind it.
    pub truth: Truth,
    /// The noise in the rates, deg/h: without it they are the bias (and the earth's rate).
    pub noise_dph: [Vec<f64>; AXES],
}

impl Plan {
    /// A unit like dong2023's without any effect, with the noise of its kind.
    #[must_use]
    pub fn of(profile: Profile, unit_seed: u64, seed: u64) -> Self {
        let kind = Kind::Hrg;
        let thermometer = Thermometer::Frequency;
        Self {
            kind,
            thermometer,
            profile,
            effects: vec![],
            unit_seed,
            seed,
            noise: kind.noise(),
            sizing: None,
            attitude: ATTITUDE,
            turning: None,
            positions: false,
        }
    }

    /// It does not keep its attitude.
    fn moved(&self) -> bool {
        self.turning.is_some() || self.positions
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
        let monitors = Monitors::new(&plant, self.unit_seed, &mut rng);
        let default = Calibration::uncalibrated();
        let floor = [0; AXES].map(|_| std_dev(&block_means(&rate_noise(n, &self.noise, &mut rng), 100)));
        self.effects
            .iter()
            .zip(self.signs())
            .map(|(spec, signs)| {
                [0, 1, 2].map(|a: usize| {
                    let bias = effect_bias(
                        spec,
                        &plant,
                        &monitors.quantities(&plant, default.scaling.t_ref_c),
                        &default.scaling,
                        a,
                        signs[a].1,
                    );
                    let left = left_after_baseline(&bias, &plant, &default.scaling, a);
                    // (Of what the baseline takes whole, rounding is left.)
                    let size = (bias.iter().map(|b| b * b).sum::<f64>() / n as f64).sqrt();
                    if left > 1e-6 * size {
                        signs[a].0 * spec.size * floor[a] / left
                    } else {
                        0.0
                    }
                })
            })
            .collect()
    }

    /// Looks whether each effect can have its size.
    ///
    /// # Errors
    /// An effect whose parameters give no bias on the profile on which it has its size, or one that is no number.
    pub fn check(&self) -> Result<(), BadInput> {
        let gains = self.gains();
        let none = |(spec, gains): &(&EffectSpec, &[f64; AXES])| {
            spec.size != 0.0 && gains.iter().all(|g| *g == 0.0 || !g.is_finite())
        };
        match self.effects.iter().zip(&gains).find(none) {
            Some((spec, _)) => Err(BadInput::new(format!(
                "effect {}: with these parameters it adds nothing to the bias of the profile on which it has its size (cycle), or nothing that is a number; give others (a quantity that there is, a time within the profile)",
                spec.source.name()
            ))),
            None => Ok(()),
        }
    }

    fn metadata(&self, default: &Calibration) -> Vec<(String, String)> {
        let version = if self.thermometer.is_sensor() { "2" } else { "1" };
        let mut meta = vec![
            ("hrg-recording", version.to_string()),
            ("unit", format!("SIM-{}", self.unit_seed)),
            ("run", format!("simulated-{}", self.seed)),
            ("rate_unit", "deg/h".to_string()),
            ("rates", "raw".to_string()),
            ("power_on_s", "0".to_string()),
            (metadata::SCALE_FACTOR, metadata::scale_text(&default.scale_factors_dph_per_code())),
        ];
        if !self.moved() {
            let before_scale = meta.len() - 1;
            let place = [("latitude_deg", self.attitude.latitude_deg.to_string()), ("axes", self.attitude.axes_text())];
            meta.splice(before_scale..before_scale, place);
        }
        if self.thermometer.is_sensor() {
            meta.push(("thermometer", "sensor".to_string()));
        }
        meta.into_iter().map(|(k, v)| (k.to_string(), v)).collect()
    }

    /// Columns of sensors, supplies and loops.
    fn beside_rates(&self, chamber: Vec<f64>, plant: &Plant, monitors: Monitors) -> Vec<(&'static str, Vec<f64>)> {
        let with_sensors = self.thermometer.is_sensor();
        let alone = |column: Column, values: Vec<f64>| (column.name(0), values);
        let mut optional: Vec<(&'static str, Vec<f64>)> = Vec::new();
        if !with_sensors {
            optional.extend(of_axes(columns::CASE, plant.case_c.each_ref().map(|c| in_sensor_steps(c))));
        }
        optional.push(alone(columns::CHAMBER, chamber));
        optional.push(alone(columns::BOARD, monitors.board_c));
        optional.push(alone(columns::SUPPLY, monitors.supply_v));
        if !with_sensors {
            let resonance = monitors.resonance;
            optional.extend(of_axes(columns::DRIVE, resonance.each_ref().map(|r| r.drive_v.clone())));
            optional.extend(of_axes(columns::QUADRATURE, resonance.map(|r| r.quad_v)));
        }
        optional
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
        let monitors = Monitors::new(&plant, self.unit_seed, &mut rng);
        let has_clock_drift = self.effects.iter().any(|e| e.source == Source::Library(EffectId::Timebase));
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
                let bias =
                    effect_bias(spec, &plant, &monitors.quantities(&plant, scaling.t_ref_c), scaling, a, signs[a].1);
                for (r, b) in rate[a].iter_mut().zip(&bias) {
                    *r += gains[a] * b;
                }
            }
        }
        let raw_dph = [0, 1, 2].map(|a: usize| std_dev(&block_means(&rate[a], 100)));
        if let Some(scheme) = &self.turning {
            let turned = Gyros::of(self.unit_seed).rates_dph(scheme, &plant.resonator_c, self.attitude.latitude_deg);
            for (to, from) in rate.iter_mut().zip(turned) {
                to.iter_mut().zip(from).for_each(|(r, t)| *r += t);
            }
        }
        if self.positions {
            let earth = positions::earth_rates_dph(n, self.attitude.latitude_deg);
            rate.iter_mut().flatten().zip(earth.iter().flatten()).for_each(|(r, e)| *r += e);
        }
        let with_sensors = self.thermometer.is_sensor();
        let readings = [0, 1, 2].map(|a: usize| -> Vec<f64> {
            if with_sensors {
                return plant.resonator_c[a].iter().map(|t| t + SENSOR_NOISE_C * normal(&mut rng)).collect();
            }
            let curve = &default.axes[a].curve;
            (0..n)
                .map(|k| {
                    let f = curve.frequency_hz(plant.resonator_c[a][k]).unwrap_or(f64::NAN);
                    let clock = if has_clock_drift { 1.0 + 1e-6 * monitors.clock_ppm[k] } else { 1.0 };
                    f * clock + self.noise.frequency_hz * normal(&mut rng)
                })
                .collect()
        });
        let mut optional = self.beside_rates(chamber, &plant, monitors);
        if let Some(scheme) = &self.turning {
            optional.extend(of_axes(columns::TABLE_RATE, scheme.table_rates_dph(n)));
        }
        if self.positions {
            let all = Accelerometers::of(self.unit_seed);
            optional.extend(of_axes(columns::FORCE, all.forces_mps2(&plant.resonator_c, &mut rng)));
            optional.extend(of_axes(columns::TABLE_FORCE, positions::table_mps2(n)));
        }
        Simulated {
            recording: Recording {
                meta: self.metadata(&default),
                time_s: (0..n).map(|k| (k + 1) as f64).collect(),
                thermometer: self.thermometer,
                frequency_hz: readings,
                rate_dph: rate,
                optional,
                // As a file with it is after reading: the file has it.
                earth_rate_dph: (!self.moved()).then(|| self.attitude.earth_rate_dph()),
                ..Recording::default()
            },
            noise_dph: noise,
            truth: Truth { effects: self.effects.clone(), gains, floor_dph, raw_dph },
        }
    }
}

/// Noise of a platinum resistor at an ADC, one reading a second, C.
const SENSOR_NOISE_C: f64 = 0.001;

/// Step of a DS18B20 of 12 bits, C.
const CASE_STEP_C: f64 = 0.0625;

/// Temperatures as such a sensor gives them.
fn in_sensor_steps(temperatures_c: &[f64]) -> Vec<f64> {
    temperatures_c.iter().map(|t| (t / CASE_STEP_C).round() * CASE_STEP_C).collect()
}

/// Values under the names of a column that each axis has.
fn of_axes(column: Column, values: [Vec<f64>; AXES]) -> impl Iterator<Item = (&'static str, Vec<f64>)> {
    values.into_iter().enumerate().map(move |(a, v)| (column.name(a), v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::effects::ALL;

    fn plan(effects: &[&str]) -> Plan {
        Plan {
            effects: effects.iter().map(|e| EffectSpec::parse(e).expect("known")).collect(),
            ..Plan::of(Profile::parse("fast").expect("named"), 3, 5)
        }
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
    fn a_unit_with_sensors_is_the_same_unit_without_resonators() {
        let by_frequency = Plan { kind: Kind::Fog, ..plan(&[]) };
        let by_sensor = Plan { thermometer: Thermometer::Sensors, ..by_frequency.clone() };
        let (a, b) = (by_frequency.simulate().recording, by_sensor.simulate().recording);
        assert_eq!(a.rate_dph, b.rate_dph);
        // One sensor in each gyro, which its thermal lag tells from the others'.
        assert!(b.frequency_hz[0].iter().zip(&b.frequency_hz[2]).any(|(x, z)| (x - z).abs() > 1.0));
        let mut read = Recording::parse(b.to_csv().as_bytes()).expect("readable");
        read.clean().expect("usable");
        assert_eq!((read.thermometer, read.meta("thermometer")), (Thermometer::Sensors, Some("sensor")));
        let largest = |a: usize| {
            let both = read.frequency_hz[a].iter().zip(&b.frequency_hz[a]);
            both.map(|(r, b)| (r - b).abs()).fold(0.0, f64::max)
        };
        assert!((0..AXES).all(|a| largest(a) < 1e-4));
        let names: Vec<&str> = read.optional.iter().map(|(n, _)| *n).collect();
        assert_eq!(names, ["chamber_c", "board_c", "supply_v"]);
    }

    #[test]
    fn an_effect_that_does_nothing_is_refused() {
        for text in ["input-kink:channel=99", "recorded-quantity:channel=40", "step:time_s=1e8"] {
            let refused = plan(&["kink", text]).check().expect_err(text).0;
            assert!(refused.starts_with(&format!("effect {}: ", text.split(':').next().unwrap_or(""))), "{refused}");
        }
        for facts in ALL {
            assert_eq!(plan(&[facts.name]).check(), Ok(()), "{}", facts.name);
        }
        assert_eq!(plan(&["thermal-lag:size=0"]).check(), Ok(()));
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
