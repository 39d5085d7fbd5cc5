//! Two-position self-alignment of an HRG platform: azimuth, tilts and drifts from the velocities of a platform at rest.
//!
//! # The platform
//! Axes 1, 2, 3 (3 down), north-east-down. Azimuth `A`: heading of axis 1, clockwise from north. Small tilts `th1`, `th2`
//! about axes 1 and 2. Axes 1 and 2 are held by the gyros in inertial space, axis 3 is turned with the earth's vertical
//! component. `d1`, `d2`: drift rates of the platform. With `Oc`, `Os` the earth rate times cosine and sine of latitude:
//!
//! - `th1' = d1 - Oc cos A - Os th2`
//! - `th2' = d2 + Oc sin A + Os th1`
//! - `v1' = g th2`, `v2' = -g th1`; the velocities are what is measured.
//!
//! # Why two positions
//! In one position, the two tilt rates hold three unknowns: azimuth is off by the drift about east over `Oc`, 32' for 0.1
//! deg/h at 45 degrees, whatever the filter. Turned by 90 degrees about axis 3, the drifts stay with the gyros while the
//! earth rate seen by them turns: the difference of the two positions holds the azimuth and no drift.
//!
//! # Filters
//! One trait, [`Filter`]; four of them: [`linear::Linear`], the one to fly; [`ekf::Ekf`]; [`particles::Kernels`] and
//! [`particles::Literal`], the unscented particle filter in a form that works and as chen2015 has it.
//!
//! Derived afresh: the equations that chen2015 prints disagree with each other.
//!
//! # Example
//! ```
//! use hrg_align::{linear::Linear, Config, Filter, DEGREE, DPH};
//!
//! // A level platform without drift at 45 degrees, axis 1 to the north: it tilts about axis 1 only, by the horizontal earth rate.
//! let config = Config::new(45.0, 9.806, 0.002).expect("a site");
//! let mut filter = Linear::<f64>::new(config);
//! let (horizontal, _) = config.earth();
//! for k in 1..=60 {
//!     let t = f64::from(k) * config.step;
//!     let v2 = config.gravity * horizontal * t * t / 2.0;
//!     filter.step([0.0, v2]).expect("still works");
//! }
//! let found = filter.estimate().expect("still works");
//! assert!(found.azimuth.abs() < 0.5 * DEGREE);
//! // One position cannot tell azimuth and drift apart: the filter says how uncertain both are.
//! assert!(found.azimuth_std > 0.1 * DEGREE && found.drift_std[1] > 0.05 * DPH);
//! ```

#![no_std]
#![forbid(unsafe_code)]

pub mod aligner;
pub mod ekf;
pub mod linear;
pub mod particles;
pub mod real;
pub mod session;

use hrg_core::math::double;
use real::Real;

/// Earth rate, rad/s.
pub const EARTH_RATE: f64 = 7.292_115e-5;
/// Radians per degree.
pub const DEGREE: f64 = core::f64::consts::PI / 180.0;
/// Radians per arc minute.
pub const ARCMIN: f64 = DEGREE / 60.0;
/// Radians per second of a degree per hour.
pub const DPH: f64 = DEGREE / 3600.0;

/// Beyond this latitude, degrees, azimuth is not given: the horizontal earth rate, which holds it, is under a sixth.
pub const LATITUDE_LIMIT_DEG: f64 = 80.0;

/// Largest drift that a configuration may expect, one sigma, deg/h: the earth's own rate.
pub const LARGEST_DRIFT_DPH: f64 = 15.0;
/// Largest tilt that a configuration may expect, one sigma, arc minutes: beyond, tilts are not small.
pub const LARGEST_TILT_ARCMIN: f64 = 120.0;

/// Why there is no azimuth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Refusal {
    /// The latitude is missing or impossible.
    Latitude = 1,
    /// Too near to a pole.
    Pole = 2,
    /// The other numbers of the site are impossible.
    Site = 3,
    /// There was no turn: one position cannot tell azimuth from drift.
    OnePosition = 4,
    /// The turn is too small (or a whole one) to part azimuth from drift.
    SmallTurn = 5,
    /// Too little time in one of the positions.
    TooShort = 6,
    /// The azimuth is not known well enough yet.
    NotConverged = 7,
    /// The base moves: velocities do not follow the model.
    BaseMoving = 8,
    /// An accelerometer is at its end of scale, or stuck.
    Saturated = 9,
    /// The two positions contradict each other: drift that changed, a turn of another angle, a moved base.
    Inconsistent = 10,
    /// The filter broke down: a covariance that is not positive, a number that is not finite.
    Breakdown = 11,
    /// Samples were missing for too long.
    DataMissing = 12,
    /// The unit's firmware was built without alignment.
    NotBuiltIn = hrg_core::align_mode::NOT_BUILT_IN,
}

impl Refusal {
    /// The refusal with a number.
    #[must_use]
    pub fn from_number(n: u8) -> Option<Self> {
        use Refusal as R;
        [
            R::Latitude,
            R::Pole,
            R::Site,
            R::OnePosition,
            R::SmallTurn,
            R::TooShort,
            R::NotConverged,
            R::BaseMoving,
            R::Saturated,
            R::Inconsistent,
            R::Breakdown,
            R::DataMissing,
            R::NotBuiltIn,
        ]
        .into_iter()
        .find(|r| *r as u8 == n)
    }
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Latitude => "the latitude is missing or not between -90 and 90 degrees; give it",
            Self::Pole => "the latitude is beyond 80 degrees, where the earth's rate hardly tells azimuth; align elsewhere, or by other means",
            Self::Site => "gravity or a noise figure is impossible; give gravity in m/s^2, velocity noise in m/s",
            Self::OnePosition => "there was no turn; one position cannot tell azimuth from drift: turn the platform by 90 degrees and go on",
            Self::SmallTurn => "the turn is too near to a whole one to part azimuth from drift; turn by 90 or 180 degrees",
            Self::TooShort => "too little time in one of the positions; stay half a minute at the least in each",
            Self::NotConverged => "the azimuth is not known well enough yet; stay longer",
            Self::BaseMoving => "the base moves, or the gyros drift far more than was expected; align at rest, or expect more",
            Self::Saturated => "an accelerometer is at its end of scale or stuck; level the platform coarsely, or check its channel",
            Self::Inconsistent => "the two positions contradict each other; check the angle of the turn and whether base or drift moved, and repeat",
            Self::Breakdown => "the filter broke down; start it again",
            Self::DataMissing => "samples were missing for too long; check the ADC, and repeat",
            Self::NotBuiltIn => "the unit's firmware was built without alignment; flash one with the feature align",
        })
    }
}

impl core::error::Error for Refusal {}

/// Site, step and expected errors of an alignment. All errors are standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Config {
    /// Latitude, rad.
    pub latitude: f64,
    /// Gravity, m/s^2.
    pub gravity: f64,
    /// Noise of a velocity reading, m/s.
    pub velocity_noise: f64,
    /// Tilts at the start, rad.
    pub tilt: f64,
    /// Drifts, rad/s.
    pub drift: f64,
    /// Angle random walk of the gyros, rad per root second.
    pub angle_random_walk: f64,
    /// White noise of the accelerometers, m/s per root second.
    pub velocity_walk: f64,
    /// Tilt that the turn may add, rad: accelerometer biases do not turn with the tilt.
    pub turn_tilt: f64,
    /// Change of each axis' drift from one position to the other, rad/s; 0: nothing is known of it.
    pub heading_drift: f64,
    /// Difference of the turn from the stated angle, rad; 0: nothing is known of it.
    pub turn_error: f64,
    /// Time between steps, s.
    pub step: f64,
}

impl Config {
    /// Nothing yet.
    pub const IDLE: Self = Self {
        latitude: 0.0,
        gravity: 0.0,
        velocity_noise: 0.0,
        tilt: 0.0,
        drift: 0.0,
        angle_random_walk: 0.0,
        velocity_walk: 0.0,
        turn_tilt: 0.0,
        heading_drift: 0.0,
        turn_error: 0.0,
        step: 0.0,
    };

    /// A site, with the rest as usual: tilts of 10', drifts of 0.2 deg/h, 0.0005 deg/sqrt(h), 5 ug/sqrt(Hz), 1e-4
    /// rad at the turn, steps of a second.
    ///
    /// # Errors
    /// [`Refusal::Latitude`], [`Refusal::Pole`], [`Refusal::Site`].
    pub fn new(latitude_deg: f64, gravity: f64, velocity_noise: f64) -> Result<Self, Refusal> {
        if !(latitude_deg.abs() <= 90.0) {
            return Err(Refusal::Latitude);
        }
        if latitude_deg.abs() > LATITUDE_LIMIT_DEG {
            return Err(Refusal::Pole);
        }
        if !((9.0..10.5).contains(&gravity) && (0.0..1.0).contains(&velocity_noise)) {
            return Err(Refusal::Site);
        }
        Ok(Self {
            latitude: latitude_deg * DEGREE,
            gravity,
            // Readings finer than the filter's numbers are no better than these.
            velocity_noise: if velocity_noise > 1e-5 { velocity_noise } else { 1e-5 },
            tilt: 10.0 * ARCMIN,
            drift: 0.2 * DPH,
            angle_random_walk: 5e-4 * DEGREE / 60.0,
            velocity_walk: 5e-6 * gravity,
            turn_tilt: 1e-4,
            heading_drift: 0.0,
            turn_error: 0.0,
            step: 1.0,
        })
    }

    /// The same with other standard deviations of drifts (deg/h) and of tilts at the start (arc minutes); 0: as usual.
    ///
    /// # Errors
    /// [`Refusal::Site`] where they are impossible.
    pub fn with_prior(self, drift_dph: f64, tilt_arcmin: f64) -> Result<Self, Refusal> {
        if !((0.0..=LARGEST_DRIFT_DPH).contains(&drift_dph) && (0.0..=LARGEST_TILT_ARCMIN).contains(&tilt_arcmin)) {
            return Err(Refusal::Site);
        }
        Ok(Self {
            drift: if drift_dph > 0.0 { drift_dph * DPH } else { self.drift },
            tilt: if tilt_arcmin > 0.0 { tilt_arcmin * ARCMIN } else { self.tilt },
            ..self
        })
    }

    /// Variances that the turn by `angle` (rad) brings, to the azimuth (rad^2) and to the length of what it goes by, over that length. The
    /// two positions' rates differ by a vector of length `2 Oc sin(b/2)` along `A + b/2` (`docs/alignment.md`). A change of the drifts
    /// across it turns it, one along it changes its length; of the turn's error `e` half goes into the azimuth, and `e/2 cot(b/2)` into the
    /// length.
    #[must_use]
    pub fn turn_variances(&self, angle: f64) -> [f64; 2] {
        if self.heading_drift == 0.0 && self.turn_error == 0.0 {
            return [0.0; 2];
        }
        let (sin, cos) = double::sin_cos(0.5 * angle);
        let drift = self.heading_drift / (2.0 * self.earth().0 * sin);
        let (across, along) = (0.5 * self.turn_error, 0.5 * self.turn_error * cos / sin);
        [drift * drift + across * across, drift * drift + along * along]
    }

    /// Horizontal and vertical earth rate, rad/s.
    #[must_use]
    pub fn earth(&self) -> (f64, f64) {
        let (s, c) = double::sin_cos(self.latitude);
        (EARTH_RATE * c, EARTH_RATE * s)
    }
}

/// Normal gravity at a latitude on the ellipsoid (WGS 84, Somigliana), m/s^2.
#[must_use]
pub fn normal_gravity(latitude_deg: f64) -> f64 {
    let s = double::sin_cos(latitude_deg * DEGREE).0;
    let s2 = s * s;
    9.780_325_335_9 * (1.0 + 0.001_931_852_652_41 * s2) / libm::sqrt(1.0 - 0.006_694_379_990_14 * s2)
}

/// Estimate of an alignment filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Azimuth of axis 1 as it stood in position 1, rad, -pi to pi.
    pub azimuth: f64,
    /// Its standard deviation, rad.
    pub azimuth_std: f64,
    /// Tilts about axes 1 and 2 as they stand now, rad.
    pub tilt: [f64; 2],
    /// Their standard deviations.
    pub tilt_std: [f64; 2],
    /// Drifts about axes 1 and 2, rad/s.
    pub drift: [f64; 2],
    /// Their standard deviations.
    pub drift_std: [f64; 2],
    /// Chi-square, one degree of freedom, of the check that the filter gets for free; `None` where it has none.
    pub integrity: Option<f64>,
}

/// Interface of every alignment filter. Velocities start at zero at each position.
pub trait Filter {
    /// One step of [`Config::step`]: the velocity readings, m/s; NaN: there is none, time goes on without. Gives the
    /// squared innovation of each over its variance, or `None` if the filter has broken down.
    fn step(&mut self, velocity: [f64; 2]) -> Option<[f64; 2]>;
    /// The platform has been turned about axis 3 by `angle` (rad, clockwise from above), which took `seconds` without
    /// readings; velocities start at zero again.
    fn turn(&mut self, angle: f64, seconds: f64);
    /// The velocities read this now, at the first reading of a position; without it they begin at zero.
    fn set_velocity(&mut self, velocity: [f64; 2]);
    /// Velocities cannot be trusted to go on from where they were: their errors are unknown from here.
    fn forget_velocity(&mut self);
    /// The filter's estimate; `None` if the filter has broken down.
    fn estimate(&self) -> Option<Estimate>;
}

/// A filter that starts from nothing but its configuration, where it lies: a particle filter of tens of kilobytes must
/// not pass over the unit's stack.
pub trait Begin: Filter {
    /// Before its first start.
    const IDLE: Self;
    /// Starts (anew).
    fn begin(&mut self, config: Config);
}

/// Velocity errors unknown, m/s.
const ANY_VELOCITY: f64 = 1.0;

/// One Kalman update with a reading of state `index` itself, in Joseph's form. An outlier is not thrown away but taken
/// less: the innovation's variance is widened to a ninth of its square. Gives the squared innovation over its variance,
/// and the logarithm of its likelihood, for the variance as used.
fn update<T: Real, const N: usize>(
    x: &mut [T; N],
    p: &mut real::Matrix<T, N>,
    index: usize,
    reading: T,
    noise: T,
) -> (T, T) {
    if !reading.is_finite() {
        return (T::one(), T::zero());
    }
    let innovation = reading - x[index];
    let own = p[index][index] + noise;
    let square = innovation * innovation;
    let ninth = square * T::of(1.0 / 9.0);
    let variance = if ninth > own { ninth } else { own };
    let row = p[index];
    let inverse = T::one() / variance;
    let gain = row.map(|r| r * inverse);
    for i in 0..N {
        x[i] += gain[i] * innovation;
        for j in 0..N {
            if j > i {
                break;
            }
            // (I - K h) P (I - K h)^T + K r K^T, multiplied out for a reading of one state.
            let value = p[i][j] - gain[i] * row[j] - row[i] * gain[j] + gain[i] * gain[j] * variance;
            p[i][j] = value;
            p[j][i] = value;
        }
    }
    (square / own, T::of(-0.5) * (square * inverse + variance.ln()))
}

/// `true` if the state is finite and the variances are finite and above zero.
fn sound<T: Real, const N: usize>(x: &[T; N], p: &real::Matrix<T, N>) -> bool {
    x.iter().all(|v| v.is_finite()) && (0..N).all(|i| p[i][i].is_finite() && p[i][i] > T::zero())
}

/// Turns the two tilts of a state by an angle about axis 3: their values and covariances. `first` is the index of th1.
fn turn_tilts<T: Real, const N: usize>(x: &mut [T; N], p: &mut real::Matrix<T, N>, first: usize, angle: f64) {
    let (s, c) = T::of(angle).sin_cos();
    let mut r = real::identity::<T, N>();
    r[first][first] = c;
    r[first][first + 1] = s;
    r[first + 1][first] = -s;
    r[first + 1][first + 1] = c;
    let (a, b) = (x[first], x[first + 1]);
    x[first] = c * a + s * b;
    x[first + 1] = c * b - s * a;
    *p = real::congruence(&r, p);
}

/// Sets a velocity to a value with a variance of its own.
fn reset<T: Real, const N: usize>(x: &mut [T; N], p: &mut real::Matrix<T, N>, index: usize, value: T, variance: T) {
    if index >= N {
        return;
    }
    x[index] = value;
    for k in 0..N {
        p[index][k] = T::zero();
        p[k][index] = T::zero();
    }
    p[index][index] = variance;
}

/// Most steps of a turn: with 23 degrees each, heading within a step is as good as its middle to 1e-5 rad of tilt, and the particle filter stays
/// under the watchdog's time.
const TURN_STEPS: f64 = 4.0;

/// Reads both velocities, `first` and the one after it: see [`update`]. Squares, and the sum of the likelihoods.
fn read<T: Real, const N: usize>(
    x: &mut [T; N],
    p: &mut real::Matrix<T, N>,
    first: usize,
    velocity: [T; 2],
    noise: T,
) -> ([T; 2], T) {
    let (a, la) = update(x, p, first, velocity[0], noise);
    let (b, lb) = update(x, p, first + 1, velocity[1], noise);
    ([a, b], la + lb)
}

/// Sets both velocities, each with the variance of a reading.
fn set<T: Real, const N: usize>(
    x: &mut [T; N],
    p: &mut real::Matrix<T, N>,
    first: usize,
    velocity: [f64; 2],
    config: &Config,
) {
    let noise = T::of(config.velocity_noise * config.velocity_noise);
    for k in 0..2 {
        reset(x, p, first + k, T::of(velocity[k]), noise);
    }
}

/// Forgets how far both velocities can be trusted.
fn forget<T: Real, const N: usize>(x: &mut [T; N], p: &mut real::Matrix<T, N>, first: usize) {
    for k in first..first + 2 {
        reset(x, p, k, x[k], T::of(ANY_VELOCITY * ANY_VELOCITY));
    }
}

/// Ends a turn: makes the tilts (at `tilt` and after) less certain and sets the velocities (at `first` and after) to zero.
fn land<T: Real, const N: usize>(
    x: &mut [T; N],
    p: &mut real::Matrix<T, N>,
    tilt: usize,
    first: usize,
    config: &Config,
) {
    for k in tilt..tilt + 2 {
        p[k][k] += T::of(config.turn_tilt * config.turn_tilt);
    }
    set(x, p, first, [0.0; 2], config);
}

/// Cuts a turn into steps: their number and length, s.
fn turn_steps(seconds: f64, step: f64) -> (u32, f64) {
    let n = libm::ceil(seconds / step);
    let n = if n >= 1.0 { n } else { 1.0 };
    let n = if n > TURN_STEPS { TURN_STEPS } else { n };
    (n as u32, seconds / n)
}

/// An angle brought to -pi..pi.
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    let turns = libm::round(angle / (2.0 * core::f64::consts::PI));
    angle - turns * 2.0 * core::f64::consts::PI
}
