//! A platform to align, simulated: rotation matrices, not the equations of the filters. Simulated data only.

use super::Recording;
use hrg_align::{normal_gravity, wrap, ARCMIN, DEGREE, DPH, EARTH_RATE};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Properties of a platform and its surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plant {
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Heading of axis 1 in position 1, rad.
    pub azimuth: f64,
    /// Tilts about axes 1 and 2 at the start, rad.
    pub tilt: [f64; 2],
    /// Drifts about the three axes, rad/s.
    pub drift: [f64; 3],
    /// Drift that comes with the turn, rad/s: a gyro that feels its heading.
    pub heading_drift: [f64; 2],
    /// Gyro random walk, rad per root second.
    pub angle_random_walk: f64,
    /// Accelerometer biases, m/s^2.
    pub bias: [f64; 2],
    /// Accelerometer white noise, m/s per root second.
    pub velocity_walk: f64,
    /// White noise of a velocity reading (the base's shaking, the counter), m/s.
    pub velocity_noise: f64,
    /// Velocity of one pulse, m/s; 0: no quantisation.
    pub pulse: f64,
    /// Seconds in position 1, of the turn, in position 2.
    pub seconds: [usize; 3],
    /// Angle of the turn as commanded, rad.
    pub turn: f64,
    /// Error of the turn, rad.
    pub turn_error: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// True state at the end of the recording, which it does not contain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Azimuth of axis 1 as it would stand without the turn, rad.
    pub azimuth: f64,
    /// Tilts about axes 1 and 2 as they stand, rad.
    pub tilt: [f64; 2],
    /// Drifts about axes 1 and 2, rad/s.
    pub drift: [f64; 2],
}

/// Steps of the integration per second.
const STEPS: usize = 20;

impl Plant {
    /// chen2015's case: 45 degrees, tilts of 3', azimuth 100 degrees, drifts of 0.2, 0.1, 0.2 deg/h (north, east, vertical),
    /// accelerometer bias of 1e-5 g, 200 s, of which the turn takes 30 s in the middle. Noise: readings 0.3 mm/s, pulses of
    /// 0.5 mm/s, gyros 0.0005 deg/sqrt(h), accelerometers 5 ug/sqrt(Hz).
    #[must_use]
    pub fn chen(seed: u64) -> Self {
        let g = normal_gravity(45.0);
        let azimuth = 100.0 * DEGREE;
        // Its drifts are about north and east; the platform's about its own axes.
        let (north, east) = (0.2 * DPH, 0.1 * DPH);
        let (s, c) = azimuth.sin_cos();
        Self {
            latitude_deg: 45.0,
            azimuth,
            tilt: [3.0 * ARCMIN; 2],
            drift: [c * north + s * east, -s * north + c * east, 0.2 * DPH],
            heading_drift: [0.0; 2],
            angle_random_walk: 5e-4 * DEGREE / 60.0,
            bias: [1e-5 * g; 2],
            velocity_walk: 5e-6 * g,
            velocity_noise: 3e-4,
            pulse: 5e-4,
            seconds: [85, 30, 85],
            turn: 90.0 * DEGREE,
            turn_error: 0.0,
            seed,
        }
    }

    /// As [`chen`](Self::chen), with azimuth anywhere on the circle, tilts of 3' either way and drifts of 0.2 deg/h, one
    /// sigma each.
    #[must_use]
    pub fn drawn(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed.wrapping_add(0xA119));
        let mut normal = |sigma: f64| -> f64 {
            let n: f64 = StandardNormal.sample(&mut rng);
            sigma * n
        };
        let drift = [0.2 * DPH; 3].map(&mut normal);
        let tilt = [3.0 * ARCMIN; 2].map(&mut normal);
        let bias = [1e-5 * 9.8; 2].map(&mut normal);
        Self { azimuth: rng.random_range(-180.0..180.0) * DEGREE, drift, tilt, bias, ..Self::chen(seed) }
    }

    /// Plays it. One position only where the third time is zero.
    #[must_use]
    pub fn play(&self) -> (Recording, Truth) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
        let g = normal_gravity(self.latitude_deg);
        let (sin, cos) = (self.latitude_deg * DEGREE).sin_cos();
        let earth = Vector3::new(EARTH_RATE * cos, 0.0, -EARTH_RATE * sin);
        // From north-east-down to the platform: azimuth, then the tilts.
        let mut c: Matrix3<f64> = Rotation3::from_euler_angles(self.tilt[0], self.tilt[1], 0.0).matrix().transpose()
            * Rotation3::from_axis_angle(&Vector3::z_axis(), self.azimuth).matrix().transpose();
        let dt = 1.0 / STEPS as f64;
        let mut velocity = [0.0; 2];
        let mut zero = [normal() * self.velocity_noise, normal() * self.velocity_noise];
        let mut rows = Vec::new();
        let read = |v: f64| if self.pulse > 0.0 { (v / self.pulse).floor() * self.pulse } else { v };
        let [first, between, second] = self.seconds;
        let total = first + between + second;
        let rate = if between > 0 { (self.turn + self.turn_error) / between as f64 } else { 0.0 };
        rows.push((0.0, 1u8, [0.0; 2]));
        for k in 0..total {
            let turning = (first..first + between).contains(&k);
            if k == first && between == 0 && second > 0 {
                c = spin(self.turn + self.turn_error) * c;
            }
            if k == first + between && second > 0 {
                velocity = [0.0; 2];
                zero = [normal() * self.velocity_noise, normal() * self.velocity_noise];
                // The instant of the restart is a row of its own only where time has passed since the last one.
                if between > 0 {
                    rows.push((k as f64, 2, [0.0; 2]));
                }
            }
            let past_turn = k >= first + between;
            for _ in 0..STEPS {
                let walk = self.angle_random_walk / dt.sqrt();
                let drift = |a: usize| self.drift[a] + if past_turn && a < 2 { self.heading_drift[a] } else { 0.0 };
                let inertial = Vector3::new(
                    drift(0) + walk * normal(),
                    drift(1) + walk * normal(),
                    self.drift[2] - EARTH_RATE * sin + if turning { rate } else { 0.0 },
                );
                let turn = (inertial - c * earth) * dt;
                // Half a step, the specific force, half a step.
                let half = Rotation3::new(-0.5 * turn);
                c = half.matrix() * c;
                let force = c * Vector3::new(0.0, 0.0, -g);
                for a in 0..2 {
                    velocity[a] += (force[a] + self.bias[a]) * dt + self.velocity_walk * dt.sqrt() * normal();
                }
                c = half.matrix() * c;
            }
            if !turning {
                let position = if past_turn && second > 0 { 2 } else { 1 };
                let v = [0, 1].map(|a: usize| read(velocity[a] + normal() * self.velocity_noise - zero[a]));
                rows.push(((k + 1) as f64, position, v));
            }
        }
        let turned = if second > 0 { self.turn } else { 0.0 };
        let error = if second > 0 { self.turn_error } else { 0.0 };
        let late = if second > 0 { self.heading_drift } else { [0.0; 2] };
        let truth = Truth {
            azimuth: wrap(c[(0, 1)].atan2(c[(0, 0)]) - turned - error),
            tilt: [c[(1, 2)], -c[(0, 2)]],
            drift: [self.drift[0] + late[0], self.drift[1] + late[1]],
        };
        let recording = Recording {
            latitude_deg: Some(self.latitude_deg),
            gravity_mps2: Some(g),
            // Uncertainty of a reading: noise, and the pulse.
            velocity_noise_mps: Some((self.velocity_noise.powi(2) + self.pulse.powi(2) / 12.0).sqrt()),
            angle_walk_deg_per_root_h: Some(self.angle_random_walk * 60.0 / DEGREE),
            accelerometer_ug_per_root_hz: Some(self.velocity_walk / g * 1e6),
            drift_dph: None,
            tilt_arcmin: None,
            heading_drift_dph: None,
            turn_error_arcmin: None,
            turn_deg: self.turn / DEGREE,
            rows,
        };
        (recording, truth)
    }
}

fn spin(angle: f64) -> Matrix3<f64> {
    *Rotation3::from_axis_angle(&Vector3::z_axis(), -angle).matrix()
}
