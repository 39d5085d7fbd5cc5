//! The linear filter: azimuth enters the model only through `c = cos A` and `s = sin A`, and given those the model is
//! linear. So both are states, with a prior that is uniform on the circle (mean 0, variance 1/2 each): no first guess, no
//! particles, one Kalman filter of eight states `th1 th2 d1 d2 v1 v2 c s`.
//!
//! That `c^2 + s^2 = 1` enters at the output only: normalising inside would make later updates inconsistent. The output
//! is the point of the circle nearest to `(c, s)` by their covariance; how far off the circle `(c, s)` lies is a check of
//! the whole alignment for free.
//!
//! # Example
//! ```
//! use hrg_align::{linear::Linear, Config, Filter};
//!
//! // It needs no azimuth to start from. A reading that is missing (NaN) lets time go on.
//! let config = Config::new(45.0, 9.806, 0.002).expect("a site");
//! let mut filter = Linear::<f32>::new(config);
//! assert_eq!(filter.step([f64::NAN; 2]), Some([1.0; 2]));
//! assert!(filter.estimate().is_some());
//! ```

use crate::real::{congruence, transition, zeros, Matrix, Real};
use crate::{forget, land, read, set, sound, turn_steps, turn_tilts, wrap, Begin, Config, Estimate, Filter};
use hrg_core::math::double;

/// States.
pub const STATES: usize = 8;
const TH: usize = 0;
const D: usize = 2;
const V: usize = 4;
const C: usize = 6;
const S: usize = 7;

/// See the module.
#[derive(Debug, Clone)]
pub struct Linear<T> {
    config: Config,
    x: [T; STATES],
    p: Matrix<T, STATES>,
    /// Angle by which the platform has been turned since position 1, rad.
    turned: f64,
    phi: Matrix<T, STATES>,
}

impl<T: Real> Linear<T> {
    /// Nothing known but the priors; the velocities are zero now.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let mut p = zeros();
        let square = |v: f64| T::of(v * v);
        for k in 0..2 {
            p[TH + k][TH + k] = square(config.tilt);
            p[D + k][D + k] = square(config.drift);
            // The velocity at the start is itself a reading.
            p[V + k][V + k] = square(config.velocity_noise);
            p[C + k][C + k] = T::of(0.5);
        }
        let mut out = Self { config, x: [T::zero(); STATES], p, turned: 0.0, phi: zeros() };
        out.phi = out.over(config.step, true);
        out
    }

    /// Transition over a time, at the present heading.
    fn over(&self, seconds: f64, readings: bool) -> Matrix<T, STATES> {
        let (oc, os) = self.config.earth();
        let (sin, cos) = double::sin_cos(self.turned);
        let mut f = zeros();
        f[TH][D] = T::one();
        f[TH][TH + 1] = T::of(-os);
        f[TH][C] = T::of(-oc * cos);
        f[TH][S] = T::of(oc * sin);
        f[TH + 1][D + 1] = T::one();
        f[TH + 1][TH] = T::of(os);
        f[TH + 1][C] = T::of(oc * sin);
        f[TH + 1][S] = T::of(oc * cos);
        if readings {
            f[V][TH + 1] = T::of(self.config.gravity);
            f[V + 1][TH] = T::of(-self.config.gravity);
        }
        transition(&f, T::of(seconds))
    }

    fn predict(&mut self, phi: &Matrix<T, STATES>, seconds: f64) {
        let x = self.x;
        for (to, row) in self.x.iter_mut().zip(phi) {
            let mut sum = T::zero();
            for (a, b) in row.iter().zip(&x) {
                sum += *a * *b;
            }
            *to = sum;
        }
        self.p = congruence(phi, &self.p);
        let walk = |v: f64| T::of(v * v * seconds);
        for k in 0..2 {
            self.p[TH + k][TH + k] += walk(self.config.angle_random_walk);
            self.p[V + k][V + k] += walk(self.config.velocity_walk);
        }
    }
}

/// Points of the circle that are tried first.
const GRID: usize = 64;

impl<T: Real> Begin for Linear<T> {
    const IDLE: Self = Self {
        config: Config::IDLE,
        x: [T::ZERO; STATES],
        p: [[T::ZERO; STATES]; STATES],
        turned: 0.0,
        phi: [[T::ZERO; STATES]; STATES],
    };

    fn begin(&mut self, config: Config) {
        *self = Self::new(config);
    }
}

impl<T: Real> Filter for Linear<T> {
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    fn step(&mut self, velocity: [f64; 2]) -> Option<[f64; 2]> {
        let phi = self.phi;
        self.predict(&phi, self.config.step);
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
            let phi = self.over(length, false);
            self.predict(&phi, length);
            turn_tilts(&mut self.x, &mut self.p, TH, part);
            self.turned += part;
        }
        land(&mut self.x, &mut self.p, TH, V, &self.config);
        self.phi = self.over(self.config.step, true);
    }

    fn set_velocity(&mut self, velocity: [f64; 2]) {
        set(&mut self.x, &mut self.p, V, velocity, &self.config);
    }

    fn forget_velocity(&mut self) {
        forget(&mut self.x, &mut self.p, V);
    }

    fn estimate(&self) -> Option<Estimate> {
        if !sound(&self.x, &self.p) {
            return None;
        }
        let x = self.x.map(Real::f64);
        let p = |i: usize, j: usize| self.p[i][j].f64();
        // W: the inverse of the covariance of (c, s).
        let det = p(C, C) * p(S, S) - p(C, S) * p(C, S);
        if !(det > 0.0) {
            return None;
        }
        let w = [[p(S, S) / det, -p(C, S) / det], [-p(C, S) / det, p(C, C) / det]];
        let cost = |u: [f64; 2]| {
            let (a, b) = (u[0] - x[C], u[1] - x[S]);
            0.5 * (w[0][0] * a * a + 2.0 * w[0][1] * a * b + w[1][1] * b * b)
        };
        // Around the circle by turning one point, in working precision; then Newton's steps.
        let (gs, gc) = T::of(2.0 * core::f64::consts::PI / GRID as f64).sin_cos();
        let coarse = [T::of(w[0][0]), T::of(2.0 * w[0][1]), T::of(w[1][1])];
        let mut u = [T::one(), T::zero()];
        let (mut best, mut least) = (u, T::of(f64::MAX));
        for _ in 0..GRID {
            let (a, b) = (u[0] - self.x[C], u[1] - self.x[S]);
            let here = coarse[0] * a * a + coarse[1] * a * b + coarse[2] * b * b;
            if here < least {
                least = here;
                best = u;
            }
            u = [u[0] * gc - u[1] * gs, u[0] * gs + u[1] * gc];
        }
        let length = libm::sqrt(best[0].f64() * best[0].f64() + best[1].f64() * best[1].f64());
        let mut best = best.map(|v| v.f64() / length);
        let turn = |u: [f64; 2], s: f64, c: f64| [u[0] * c - u[1] * s, u[0] * s + u[1] * c];
        let mut bend = f64::NAN;
        for _ in 0..6 {
            let (a, b) = (best[0] - x[C], best[1] - x[S]);
            let along = [-best[1], best[0]];
            let pull = [w[0][0] * a + w[0][1] * b, w[1][0] * a + w[1][1] * b];
            let slope = along[0] * pull[0] + along[1] * pull[1];
            let sway =
                w[0][0] * along[0] * along[0] + 2.0 * w[0][1] * along[0] * along[1] + w[1][1] * along[1] * along[1];
            bend = sway - (best[0] * pull[0] + best[1] * pull[1]);
            if !(bend > 0.0) {
                bend = sway;
            }
            // Numbers that are not numbers are caught below; core's clamp passes them on.
            let step = (-slope / bend).clamp(-0.1, 0.1);
            let (s, c) = double::sin_cos(step);
            best = turn(best, s, c);
            if step.abs() < 1e-9 {
                break;
            }
        }
        let integrity = 2.0 * cost(best);
        // The others follow the correction of (c, s).
        let (a, b) = (best[0] - x[C], best[1] - x[S]);
        let pull = [w[0][0] * a + w[0][1] * b, w[1][0] * a + w[1][1] * b];
        let shifted = |k: usize| x[k] + p(k, C) * pull[0] + p(k, S) * pull[1];
        // Their variance given the azimuth's: given (c, s) exactly, plus what its uncertainty along the circle moves.
        let along = [-best[1], best[0]];
        let deviation = |k: usize| {
            let g = [p(k, C) * w[0][0] + p(k, S) * w[1][0], p(k, C) * w[0][1] + p(k, S) * w[1][1]];
            let given = p(k, k) - g[0] * p(k, C) - g[1] * p(k, S);
            let moved = g[0] * along[0] + g[1] * along[1];
            libm::sqrt(if given > 0.0 { given } else { 0.0 } + moved * moved / bend)
        };
        let out = Estimate {
            azimuth: wrap(libm::atan2(best[1], best[0])),
            azimuth_std: libm::sqrt(1.0 / bend),
            tilt: [shifted(TH), shifted(TH + 1)],
            tilt_std: [deviation(TH), deviation(TH + 1)],
            drift: [shifted(D), shifted(D + 1)],
            drift_std: [deviation(D), deviation(D + 1)],
            integrity: Some(integrity),
        };
        (out.azimuth.is_finite() && out.azimuth_std.is_finite()).then_some(out)
    }
}
