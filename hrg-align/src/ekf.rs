//! The nonlinear model, and the extended Kalman filter over it (chen2015's baseline): states `th1 th2 A d1 d2 v1 v2`.
//!
//! It needs a first azimuth, and from a wrong one it may end anywhere.
//!
//! # Example
//! ```
//! use hrg_align::{ekf::Ekf, Config, Filter, DEGREE};
//!
//! // It needs an azimuth to start from, and how well that is known.
//! let config = Config::new(45.0, 9.806, 0.002).expect("a site");
//! let mut filter = Ekf::<f64>::new(config, 30.0 * DEGREE, 5.0 * DEGREE);
//! filter.step([0.0, 0.0]).expect("still works");
//! assert!((filter.estimate().expect("still works").azimuth - 30.0 * DEGREE).abs() < 1.0 * DEGREE);
//! ```

use crate::real::{congruence, product, zeros, Matrix, Real};
use crate::{forget, land, read, set, sound, turn_steps, turn_tilts, wrap, Config, Estimate, Filter};

/// States.
pub const STATES: usize = 7;
pub(super) const TH: usize = 0;
pub(super) const A: usize = 2;
pub(super) const D: usize = 3;
pub(super) const V: usize = 5;

/// Random walk of azimuth and drifts, so that they may follow what the model leaves out (the azimuth turns by the drift
/// about axis 3): rad per root second and rad/s per root second.
pub(super) const AZIMUTH_WALK: f64 = 1e-6;
pub(super) const DRIFT_WALK: f64 = 1e-11;

/// The model's constants in working precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model<T> {
    oc: T,
    os: T,
    g: T,
    pub(super) noise: T,
    /// Heading of axis 1 over the azimuth of position 1, rad.
    pub(super) turned: T,
}

impl<T: Real> Model<T> {
    pub(super) fn new(config: &Config, turned: f64) -> Self {
        let (oc, os) = config.earth();
        Self {
            oc: T::of(oc),
            os: T::of(os),
            g: T::of(config.gravity),
            noise: T::of(config.velocity_noise * config.velocity_noise),
            turned: T::of(turned),
        }
    }

    /// A state some seconds later: midpoint rule. Without readings the velocities stand still.
    pub(super) fn advance(&self, x: &[T; STATES], dt: T, readings: bool) -> [T; STATES] {
        let (sin, cos) = (x[A] + self.turned).sin_cos();
        let rate = |t1: T, t2: T| (x[D] - self.oc * cos - self.os * t2, x[D + 1] + self.oc * sin + self.os * t1);
        let half = dt * T::of(0.5);
        let (r1, r2) = rate(x[TH], x[TH + 1]);
        let (m1, m2) = (x[TH] + r1 * half, x[TH + 1] + r2 * half);
        let (r1, r2) = rate(m1, m2);
        let mut out = *x;
        out[TH] += r1 * dt;
        out[TH + 1] += r2 * dt;
        out[A] -= self.oc * (cos * m2 + sin * m1) * dt;
        if readings {
            out[V] += self.g * m2 * dt;
            out[V + 1] -= self.g * m1 * dt;
        }
        out
    }

    fn jacobian(&self, x: &[T; STATES], dt: T, readings: bool) -> Matrix<T, STATES> {
        let (sin, cos) = (x[A] + self.turned).sin_cos();
        let mut f = zeros::<T, STATES>();
        f[TH][D] = T::one();
        f[TH][TH + 1] = -self.os;
        f[TH][A] = self.oc * sin;
        f[TH + 1][D + 1] = T::one();
        f[TH + 1][TH] = self.os;
        f[TH + 1][A] = self.oc * cos;
        f[A][TH] = -self.oc * sin;
        f[A][TH + 1] = -self.oc * cos;
        if readings {
            f[V][TH + 1] = self.g;
            f[V + 1][TH] = -self.g;
        }
        let second = product(&f, &f);
        let mut phi = zeros();
        for i in 0..STATES {
            for j in 0..STATES {
                phi[i][j] = f[i][j] * dt + second[i][j] * dt * dt * T::of(0.5);
            }
            phi[i][i] += T::one();
        }
        phi
    }
}

/// Adds the process noise of some seconds to a covariance.
pub(super) fn walk<T: Real>(p: &mut Matrix<T, STATES>, config: &Config, seconds: f64) {
    let of = |v: f64| T::of(v * v * seconds);
    for k in 0..2 {
        p[TH + k][TH + k] += of(config.angle_random_walk);
        p[D + k][D + k] += of(DRIFT_WALK);
        p[V + k][V + k] += of(config.velocity_walk);
    }
    p[A][A] += of(AZIMUTH_WALK);
}

/// Priors of all states, with the azimuth known to some standard deviation.
pub(super) fn prior<T: Real>(config: &Config, azimuth_std: f64) -> Matrix<T, STATES> {
    let mut p = zeros();
    let square = |v: f64| T::of(v * v);
    for k in 0..2 {
        p[TH + k][TH + k] = square(config.tilt);
        p[D + k][D + k] = square(config.drift);
        p[V + k][V + k] = square(config.velocity_noise);
    }
    p[A][A] = square(azimuth_std);
    p
}

/// An estimate from mean and covariance.
pub(super) fn estimate<T: Real>(x: &[T; STATES], p: &Matrix<T, STATES>) -> Option<Estimate> {
    if !sound(x, p) {
        return None;
    }
    let std = |k: usize| libm::sqrt(p[k][k].f64());
    Some(Estimate {
        azimuth: wrap(x[A].f64()),
        azimuth_std: std(A),
        tilt: [x[TH].f64(), x[TH + 1].f64()],
        tilt_std: [std(TH), std(TH + 1)],
        drift: [x[D].f64(), x[D + 1].f64()],
        drift_std: [std(D), std(D + 1)],
        integrity: None,
    })
}

/// The extended Kalman filter.
#[derive(Debug, Clone)]
pub struct Ekf<T> {
    config: Config,
    x: [T; STATES],
    p: Matrix<T, STATES>,
    turned: f64,
}

impl<T: Real> Ekf<T> {
    /// Starts from an azimuth (rad) that is known to a standard deviation (rad).
    #[must_use]
    pub fn new(config: Config, azimuth: f64, azimuth_std: f64) -> Self {
        let mut x = [T::zero(); STATES];
        x[A] = T::of(azimuth);
        Self { config, x, p: prior(&config, azimuth_std), turned: 0.0 }
    }

    fn predict(&mut self, seconds: f64, readings: bool) {
        let model = Model::new(&self.config, self.turned);
        let phi = model.jacobian(&self.x, T::of(seconds), readings);
        self.x = model.advance(&self.x, T::of(seconds), readings);
        self.p = congruence(&phi, &self.p);
        walk(&mut self.p, &self.config, seconds);
    }
}

impl<T: Real> Filter for Ekf<T> {
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    fn step(&mut self, velocity: [f64; 2]) -> Option<[f64; 2]> {
        self.predict(self.config.step, true);
        let noise = T::of(self.config.velocity_noise * self.config.velocity_noise);
        let (squares, _) = read(&mut self.x, &mut self.p, V, velocity.map(T::of), noise);
        sound(&self.x, &self.p).then_some(squares.map(Real::f64))
    }

    fn turn(&mut self, angle: f64, seconds: f64) {
        let (steps, length) = turn_steps(seconds, self.config.step);
        let part = 0.5 * angle / f64::from(steps);
        for _ in 0..steps {
            turn_tilts(&mut self.x, &mut self.p, TH, part);
            self.turned += part;
            self.predict(length, false);
            turn_tilts(&mut self.x, &mut self.p, TH, part);
            self.turned += part;
        }
        land(&mut self.x, &mut self.p, TH, V, &self.config);
    }

    fn set_velocity(&mut self, velocity: [f64; 2]) {
        set(&mut self.x, &mut self.p, V, velocity, &self.config);
    }

    fn forget_velocity(&mut self) {
        forget(&mut self.x, &mut self.p, V);
    }

    fn estimate(&self) -> Option<Estimate> {
        estimate(&self.x, &self.p)
    }
}
