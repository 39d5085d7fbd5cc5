//! The unscented particle filter, in two forms over the model of [`super::ekf`]. `N` unscented Kalman filters each.
//!
//! - [`Literal`]: as van der Merwe and chen2015 have it. Each step every filter makes a proposal, a state is drawn from
//!   it and weighted by likelihood times transition prior over proposal. Azimuth and drifts are constants, so the
//!   transition prior is nearly a spike, weights collapse, and most runs fail. Kept as it is, to show that.
//! - [`Kernels`]: the same filters as a mixture. Each keeps its mean and is weighted by how well it predicted the reading;
//!   when few weights are left, the heavy ones are split along the azimuth, their covariance shared out among the
//!   children.
//!
//! # Example
//! ```
//! use hrg_align::{particles::Kernels, Config, Filter};
//!
//! // Sixteen kernels around the circle; nothing is known of the azimuth.
//! let config = Config::new(45.0, 9.806, 0.002).expect("a site");
//! let mut filter = Kernels::<f64, 16>::new(config);
//! filter.step([0.0, 0.0]).expect("still works");
//! assert!(filter.estimate().expect("still works").azimuth_std > 0.5);
//! ```

use crate::ekf::{estimate, prior, walk, Model, A, D, STATES, TH, V};
use crate::real::{cholesky, zeros, Matrix, Real};
use crate::{forget, land, read, set, sound, turn_steps, turn_tilts, Begin, Config, Estimate, Filter};
use core::f64::consts::PI;
use hrg_core::math::double;

/// Particles of chen2015.
pub const CHEN: usize = 200;

#[derive(Debug, Clone, Copy)]
struct Particle<T> {
    x: [T; STATES],
    p: Matrix<T, STATES>,
    /// Logarithm of the weight.
    weight: T,
}

impl<T: Real> Particle<T> {
    const IDLE: Self = Self { x: [T::ZERO; STATES], p: [[T::ZERO; STATES]; STATES], weight: T::ZERO };

    /// Unscented prediction with 2 n points of equal weight. `false` if the covariance has no root.
    fn predict(&mut self, model: &Model<T>, config: &Config, seconds: f64, readings: bool) -> bool {
        let Some(root) = cholesky(&self.p) else { return false };
        let dt = T::of(seconds);
        let reach = T::of(libm::sqrt(STATES as f64));
        let mut points = [[T::zero(); STATES]; 2 * STATES];
        let mut mean = [T::zero(); STATES];
        let share = T::of(1.0 / (2 * STATES) as f64);
        for k in 0..STATES {
            for (point, sign) in [(2 * k, reach), (2 * k + 1, -reach)] {
                let mut x = self.x;
                for i in k..STATES {
                    x[i] += sign * root[i][k];
                }
                points[point] = model.advance(&x, dt, readings);
                for (m, v) in mean.iter_mut().zip(&points[point]) {
                    *m += *v * share;
                }
            }
        }
        let mut p = zeros::<T, STATES>();
        for point in &points {
            let mut d = [T::zero(); STATES];
            for i in 0..STATES {
                d[i] = point[i] - mean[i];
            }
            for i in 0..STATES {
                for j in 0..=i {
                    p[i][j] += d[i] * d[j] * share;
                }
            }
        }
        for i in 0..STATES {
            for j in 0..i {
                p[j][i] = p[i][j];
            }
        }
        walk(&mut p, config, seconds);
        self.x = mean;
        self.p = p;
        true
    }
}

/// The particles and what both forms do with them alike.
#[derive(Debug, Clone)]
struct Cloud<T, const N: usize> {
    config: Config,
    particles: [Particle<T>; N],
    turned: f64,
    broken: bool,
}

impl<T: Real, const N: usize> Cloud<T, N> {
    const IDLE: Self = Self { config: Config::IDLE, particles: [Particle::IDLE; N], turned: 0.0, broken: false };

    /// Evenly round the circle, each with a share of it.
    fn begin(&mut self, config: Config) {
        let apart = 2.0 * PI / N as f64;
        let p = prior(&config, apart);
        for (k, q) in self.particles.iter_mut().enumerate() {
            q.x = [T::ZERO; STATES];
            q.x[A] = T::of(-PI + (k as f64 + 0.5) * apart);
            q.p = p;
            q.weight = T::ZERO;
        }
        self.config = config;
        self.turned = 0.0;
        self.broken = false;
    }

    /// The largest weight.
    fn heaviest(&self) -> T {
        self.particles.iter().fold(self.particles[0].weight, |m, q| if q.weight > m { q.weight } else { m })
    }

    /// Weights as shares; they sum to one.
    fn shares(&self) -> [T; N] {
        let most = self.heaviest();
        let mut shares: [T; N] = core::array::from_fn(|k| (self.particles[k].weight - most).exp());
        let mut sum = T::zero();
        for s in &shares {
            sum += *s;
        }
        for s in &mut shares {
            *s = *s / sum;
        }
        shares
    }

    fn turn(&mut self, angle: f64, seconds: f64) {
        let (steps, length) = turn_steps(seconds, self.config.step);
        let part = 0.5 * angle / f64::from(steps);
        for _ in 0..steps {
            let model = Model::new(&self.config, self.turned + part);
            for q in &mut self.particles {
                turn_tilts(&mut q.x, &mut q.p, TH, part);
                self.broken |= !q.predict(&model, &self.config, length, false);
                turn_tilts(&mut q.x, &mut q.p, TH, part);
            }
            self.turned += 2.0 * part;
        }
        for q in &mut self.particles {
            land(&mut q.x, &mut q.p, TH, V, &self.config);
        }
    }

    fn set_velocity(&mut self, velocity: [f64; 2]) {
        for q in &mut self.particles {
            set(&mut q.x, &mut q.p, V, velocity, &self.config);
        }
    }

    fn forget_velocity(&mut self) {
        for q in &mut self.particles {
            forget(&mut q.x, &mut q.p, V);
        }
    }

    /// Mean and covariance of the mixture; azimuth round the circle.
    fn estimate(&self) -> Option<Estimate> {
        if self.broken || self.particles.iter().any(|q| !sound(&q.x, &q.p)) {
            return None;
        }
        let shares = self.shares();
        let (mut c, mut s) = (0.0, 0.0);
        let mut mean = [0.0; STATES];
        for (q, w) in self.particles.iter().zip(&shares) {
            let (sin, cos) = double::sin_cos(q.x[A].f64());
            c += w.f64() * cos;
            s += w.f64() * sin;
            for (m, v) in mean.iter_mut().zip(&q.x) {
                *m += w.f64() * v.f64();
            }
        }
        mean[A] = libm::atan2(s, c);
        let mut x = [T::zero(); STATES];
        let mut p = zeros::<T, STATES>();
        for k in 0..STATES {
            let mut variance = 0.0;
            for (q, w) in self.particles.iter().zip(&shares) {
                let d = q.x[k].f64() - mean[k];
                let d = if k == A { super::wrap(d) } else { d };
                variance += w.f64() * (q.p[k][k].f64() + d * d);
            }
            x[k] = T::of(mean[k]);
            p[k][k] = T::of(variance);
        }
        estimate(&x, &p)
    }

    /// Effective number of particles.
    fn effective(shares: &[T; N]) -> f64 {
        let sum: f64 = shares.iter().map(|w| w.f64() * w.f64()).sum();
        1.0 / sum
    }

    /// Systematic resampling: how many children each particle has, with the comb at `offset` (0 to 1).
    fn children(shares: &[T; N], offset: f64) -> [u16; N] {
        let mut out = [0u16; N];
        let (mut sum, mut tooth) = (0.0, 0);
        for (n, w) in out.iter_mut().zip(shares) {
            sum += w.f64();
            while tooth < N && (tooth as f64 + offset) / (N as f64) < sum {
                *n += 1;
                tooth += 1;
            }
        }
        // Rounding may leave the last tooth over.
        if tooth < N {
            out[N - 1] += (N - tooth) as u16;
        }
        out
    }

    /// Replaces the particles by their children, the comb at `offset`, where few of them carry the weight. Else brings the
    /// heaviest weight to zero, because a sum of hundreds of logarithms does not fit into single precision.
    fn renew(
        &mut self,
        shares: &[T; N],
        offset: impl FnOnce() -> f64,
        child: impl FnMut(&Particle<T>, u16, u16) -> Particle<T>,
    ) {
        if Self::effective(shares) < 0.5 * N as f64 {
            self.resample(&Self::children(shares, offset()), child);
        } else {
            let most = self.heaviest();
            for q in &mut self.particles {
                q.weight -= most;
            }
        }
    }

    /// Replaces the particles by their children, in place: the childless are overwritten. `child` makes child `j` of `m`
    /// from its parent.
    fn resample(&mut self, children: &[u16; N], mut child: impl FnMut(&Particle<T>, u16, u16) -> Particle<T>) {
        let mut free = 0;
        for k in 0..N {
            let m = children[k];
            if m == 0 {
                continue;
            }
            let parent = self.particles[k];
            for j in 1..m {
                while free < N && children[free] != 0 {
                    free += 1;
                }
                if free < N {
                    self.particles[free] = child(&parent, j, m);
                    free += 1;
                }
            }
            self.particles[k] = child(&parent, 0, m);
        }
    }
}

/// A kernel narrower than this, rad, is not split: over 3 degrees a circle is straight to a part in a thousand.
const NARROW: f64 = 3.0 * super::DEGREE;

/// The kernel form.
#[derive(Debug, Clone)]
pub struct Kernels<T, const N: usize> {
    cloud: Cloud<T, N>,
}

impl<T: Real, const N: usize> Kernels<T, N> {
    /// Nothing known of the azimuth.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let mut out = Self::IDLE;
        out.begin(config);
        out
    }
}

impl<T: Real, const N: usize> Begin for Kernels<T, N> {
    const IDLE: Self = Self { cloud: Cloud::IDLE };

    fn begin(&mut self, config: Config) {
        self.cloud.begin(config);
    }
}

impl<T: Real, const N: usize> Filter for Kernels<T, N> {
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    fn step(&mut self, velocity: [f64; 2]) -> Option<[f64; 2]> {
        let cloud = &mut self.cloud;
        let model = Model::<T>::new(&cloud.config, cloud.turned);
        let readings = velocity.map(T::of);
        let mut squares = [[T::zero(); 2]; N];
        for (q, out) in cloud.particles.iter_mut().zip(&mut squares) {
            cloud.broken |= !q.predict(&model, &cloud.config, cloud.config.step, true);
            // The reading is linear in the state, so the unscented update is the plain one.
            let (square, likelihood) = read(&mut q.x, &mut q.p, V, readings, model.noise);
            *out = square;
            q.weight += likelihood;
        }
        let shares = cloud.shares();
        let mut out = [0.0; 2];
        for (w, square) in shares.iter().zip(&squares) {
            for k in 0..2 {
                out[k] += w.f64() * square[k].f64();
            }
        }
        cloud.renew(
            &shares,
            || 0.5,
            |parent, j, m| {
                let mut child = *parent;
                child.weight = T::zero();
                let variance = parent.p[A][A];
                // Share of its parent's variance that a child keeps. A kernel that is narrow against the bend of the circle
                // is a good filter as it is: its children are copies. Splitting it on would open gaps between them.
                let narrow = NARROW * NARROW / variance.f64();
                if m > 1 && narrow < 1.0 {
                    let m = f64::from(m);
                    let even = 1.0 / (1.0 + (m * m - 1.0) / 12.0);
                    let kept = if even > narrow { even } else { narrow };
                    // Evenly along the azimuth; what their spread takes of the covariance is taken off each.
                    let apart = libm::sqrt(12.0 * (1.0 - kept) / (m * m - 1.0));
                    let place = apart * (f64::from(j) - 0.5 * (m - 1.0));
                    let taken = T::of(1.0 - kept) / variance;
                    let way = T::of(place) / variance.sqrt();
                    for i in 0..STATES {
                        child.x[i] += parent.p[i][A] * way;
                        for k in 0..STATES {
                            child.p[i][k] -= parent.p[i][A] * parent.p[k][A] * taken;
                        }
                    }
                }
                child
            },
        );
        let sum: f64 = out.iter().sum();
        (!cloud.broken && sum.is_finite()).then_some(out)
    }

    fn turn(&mut self, angle: f64, seconds: f64) {
        self.cloud.turn(angle, seconds);
    }
    fn set_velocity(&mut self, velocity: [f64; 2]) {
        self.cloud.set_velocity(velocity);
    }
    fn forget_velocity(&mut self) {
        self.cloud.forget_velocity();
    }
    fn estimate(&self) -> Option<Estimate> {
        self.cloud.estimate()
    }
}

/// Pseudo-random numbers: xorshift64* (Vigna), which is all that drawing states needs, on the unit as on the desktop.
#[derive(Debug, Clone)]
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Self {
        // Zero is the one state that it cannot leave.
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// 0 (not included) to 1.
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let bits = self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        (bits as f64 + 0.5) / (1u64 << 53) as f64
    }

    /// Normal, by Box and Muller.
    fn normal(&mut self) -> f64 {
        libm::sqrt(-2.0 * libm::log(self.uniform())) * double::sin_cos(2.0 * PI * self.uniform()).1
    }
}

/// The literal form.
#[derive(Debug, Clone)]
pub struct Literal<T, const N: usize> {
    cloud: Cloud<T, N>,
    random: Random,
}

impl<T: Real, const N: usize> Literal<T, N> {
    /// Before its start.
    pub const IDLE: Self = Self { cloud: Cloud::IDLE, random: Random(1) };

    /// Nothing known of the azimuth; `seed` of the draws.
    #[must_use]
    pub fn new(config: Config, seed: u64) -> Self {
        let mut out = Self::IDLE;
        out.begin(config, seed);
        out
    }

    /// Starts (anew) where it lies.
    pub fn begin(&mut self, config: Config, seed: u64) {
        self.cloud.begin(config);
        self.random = Random::new(seed);
        // Particles are states: drawn from the priors, but for the azimuth, which is even round the circle.
        for q in &mut self.cloud.particles {
            for (k, std) in [(TH, config.tilt), (TH + 1, config.tilt), (D, config.drift), (D + 1, config.drift)] {
                q.x[k] = T::of(std * self.random.normal());
            }
        }
    }
}

/// Logarithm of a normal density of a difference, with a lower-triangular root of its covariance, constants left out.
fn log_density<T: Real>(d: &[T; STATES], root: &Matrix<T, STATES>) -> T {
    let mut z = [T::zero(); STATES];
    let mut out = T::zero();
    for i in 0..STATES {
        let mut sum = d[i];
        for k in 0..i {
            sum -= root[i][k] * z[k];
        }
        z[i] = sum / root[i][i];
        out -= z[i] * z[i] * T::of(0.5) + root[i][i].ln();
    }
    out
}

impl<T: Real, const N: usize> Filter for Literal<T, N> {
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline(never)]
    fn step(&mut self, velocity: [f64; 2]) -> Option<[f64; 2]> {
        let Self { cloud, random } = self;
        let model = Model::<T>::new(&cloud.config, cloud.turned);
        let readings = velocity.map(T::of);
        let mut q_root = zeros::<T, STATES>();
        walk(&mut q_root, &cloud.config, cloud.config.step);
        for (k, row) in q_root.iter_mut().enumerate() {
            row[k] = row[k].sqrt();
        }
        for q in &mut cloud.particles {
            let before = model.advance(&q.x, T::of(cloud.config.step), true);
            cloud.broken |= !q.predict(&model, &cloud.config, cloud.config.step, true);
            read(&mut q.x, &mut q.p, V, readings, model.noise);
            let Some(root) = cholesky(&q.p) else {
                cloud.broken = true;
                continue;
            };
            // The draw from the proposal.
            let mut d = [T::zero(); STATES];
            for i in 0..STATES {
                let step = T::of(random.normal());
                for k in i..STATES {
                    d[k] += root[k][i] * step;
                }
            }
            let mut from_prior = [T::zero(); STATES];
            for k in 0..STATES {
                q.x[k] += d[k];
                from_prior[k] = q.x[k] - before[k];
            }
            let mut likelihood = T::zero();
            for k in 0..2 {
                let e = readings[k] - q.x[V + k];
                likelihood -= T::of(0.5) * e * e / model.noise;
            }
            q.weight += likelihood + log_density(&from_prior, &q_root) - log_density(&d, &root);
        }
        let shares = cloud.shares();
        cloud.renew(&shares, || random.uniform(), |parent, _, _| Particle { weight: T::zero(), ..*parent });
        // Drawn states miss the reading by more than their filters would: nothing is known of the base.
        (!cloud.broken).then_some([1.0; 2])
    }

    fn turn(&mut self, angle: f64, seconds: f64) {
        self.cloud.turn(angle, seconds);
    }
    fn set_velocity(&mut self, velocity: [f64; 2]) {
        self.cloud.set_velocity(velocity);
    }
    fn forget_velocity(&mut self) {
        self.cloud.forget_velocity();
    }
    fn estimate(&self) -> Option<Estimate> {
        self.cloud.estimate()
    }
}
