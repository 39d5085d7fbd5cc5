//! An alignment from start to end over any filter: positions, the turn, what is wrong with the base or the readings, and
//! whether there is an azimuth to give out.
//!
//! # Example
//! ```
//! use hrg_align::{aligner::Aligner, linear::Linear, Config, Refusal};
//!
//! let config = Config::new(45.0, 9.806, 0.002).expect("a site");
//! let mut aligner = Aligner::new(Linear::<f64>::new(config), &config);
//! aligner.step([0.0, 0.0]);
//! // One position is no alignment: the result is a refusal, not a number.
//! assert!(matches!(aligner.outcome(), Err(Refusal::OnePosition)));
//! ```

use crate::{Begin, Config, Estimate, Filter, Refusal, ARCMIN, DEGREE};
use core::f64::consts::PI;

/// Seconds that each position must last.
pub const SHORTEST: u32 = 30;
/// The azimuth has converged where twice its standard deviation is below this: within 15', 95 times of 100.
pub const CONVERGED: f64 = 15.0 * ARCMIN;
/// Not converged at all above this standard deviation.
pub const UNKNOWN: f64 = 20.0 * DEGREE;
/// Limit of the check of the two positions: chi-square with one degree of freedom, one in a thousand.
pub const INTEGRITY_LIMIT: f64 = 10.8;
/// Running mean of the squared innovations over their variance (1 where all is well) beyond which the base moves.
pub const MOVING: f64 = 3.0;
/// Readings in that mean.
const MEMORY: f64 = 20.0;
/// So often may the velocities be begun anew before the base is called moving.
const RESTARTS: u32 = 2;
/// A turn must differ from none, and from a whole one, by this, rad.
const SMALLEST_TURN: f64 = PI / 6.0;
/// An increment of velocity beyond this share of gravity is no small tilt: 3 degrees.
const STEEPEST: f64 = 0.052;
/// So many increments in a row that are the same to the last digit come from no sensor.
const STUCK: u32 = 30;

/// An alignment that runs.
#[derive(Debug, Clone)]
pub struct Aligner<F> {
    filter: F,
    gravity: f64,
    elapsed_s: f64,
    step_s: f64,
    seconds: [u32; 2],
    /// 0 or 1.
    position: usize,
    turned: f64,
    /// Site and expected errors of this alignment; the uncertainty that a turn adds to the azimuth follows from them.
    config: Config,
    /// Variances that the turn has added: [`Config::turn_variances`].
    turn_variances: [f64; 2],
    surprise: f64,
    restarts: u32,
    converged_at_s: Option<f64>,
    last: [f64; 2],
    increment: [f64; 2],
    same: [u32; 2],
    /// Steps without readings since the last one.
    missed: u32,
    /// Estimate of the filter since the last step or turn: computed once, because it costs more than a step.
    belief: Option<Estimate>,
    refusal: Option<Refusal>,
}

impl<F: Begin> Aligner<F> {
    /// Before the first alignment.
    pub const IDLE: Self = Self::around(F::IDLE);

    /// Begins: velocities are zero now.
    pub fn begin(&mut self, config: Config) {
        self.filter.begin(config);
        self.rewind(&config);
    }
}

impl<F: Filter> Aligner<F> {
    /// Begins with a filter that has just been started with `config`: velocities are zero now.
    #[must_use]
    pub fn new(filter: F, config: &Config) -> Self {
        let mut out = Self::around(filter);
        out.rewind(config);
        out
    }

    const fn around(filter: F) -> Self {
        Self {
            filter,
            gravity: 0.0,
            elapsed_s: 0.0,
            step_s: 1.0,
            seconds: [0; 2],
            position: 0,
            turned: 0.0,
            config: Config::IDLE,
            turn_variances: [0.0; 2],
            surprise: 1.0,
            restarts: 0,
            converged_at_s: None,
            last: [0.0; 2],
            increment: [f64::NAN; 2],
            same: [0; 2],
            missed: 0,
            belief: None,
            refusal: None,
        }
    }

    /// All but the filter as at the start.
    fn rewind(&mut self, config: &Config) {
        self.gravity = config.gravity;
        self.elapsed_s = 0.0;
        self.step_s = config.step;
        self.seconds = [0; 2];
        self.position = 0;
        self.turned = 0.0;
        self.config = *config;
        self.turn_variances = [0.0; 2];
        self.surprise = 1.0;
        self.restarts = 0;
        self.converged_at_s = None;
        self.last = [0.0; 2];
        self.increment = [f64::NAN; 2];
        self.same = [0; 2];
        self.missed = 0;
        self.belief = None;
        self.refusal = None;
    }

    /// One step without readings: time goes on.
    pub fn miss(&mut self) {
        self.elapsed_s += self.step_s;
        if let Some(seconds) = self.seconds.get_mut(self.position) {
            *seconds += 1;
        }
        self.missed += 1;
        if self.filter.step([f64::NAN; 2]).is_none() {
            self.refuse(Refusal::Breakdown);
        }
        self.belief = self.estimate();
    }

    /// One step of readings, m/s.
    pub fn step(&mut self, velocity: [f64; 2]) {
        self.elapsed_s += self.step_s;
        if let Some(seconds) = self.seconds.get_mut(self.position) {
            *seconds += 1;
        }
        let steps = f64::from(core::mem::take(&mut self.missed) + 1);
        for k in 0..2 {
            let increment = (velocity[k] - self.last[k]) / steps;
            self.same[k] = if (increment - self.increment[k]).abs() < 1e-9 { self.same[k] + 1 } else { 0 };
            self.increment[k] = increment;
            if self.same[k] >= STUCK || !(increment.abs() <= STEEPEST * self.gravity * self.step_s) {
                self.refuse(Refusal::Saturated);
            }
        }
        self.last = velocity;
        match self.filter.step(velocity) {
            Some(squares) => {
                let now = 0.5 * (squares[0] + squares[1]);
                self.surprise += (now - self.surprise) / MEMORY;
                if self.surprise > MOVING {
                    self.restarts += 1;
                    self.surprise = 1.0;
                    self.filter.forget_velocity();
                    if self.restarts > RESTARTS {
                        self.refuse(Refusal::BaseMoving);
                    }
                }
            }
            None => self.refuse(Refusal::Breakdown),
        }
        self.belief = self.estimate();
        let known = self.position == 1 && self.belief.is_some_and(|e| 2.0 * e.azimuth_std <= CONVERGED);
        match (known, self.converged_at_s) {
            (true, None) => self.converged_at_s = Some(self.elapsed_s),
            (false, Some(_)) => self.converged_at_s = None,
            _ => {}
        }
    }

    /// The velocities read this at the first reading of a position, where they do not begin at zero.
    pub fn set_velocity(&mut self, velocity: [f64; 2]) {
        self.filter.set_velocity(velocity);
        self.last = velocity;
    }

    /// The platform stands in position 2 now, turned by `angle` (rad) in `seconds` without readings.
    pub fn turn(&mut self, angle: f64, seconds: f64) {
        if self.position == 1 {
            return;
        }
        self.filter.turn(angle, seconds);
        self.turn_variances = self.config.turn_variances(angle);
        self.belief = self.estimate();
        self.elapsed_s += seconds;
        self.position = 1;
        self.turned = angle;
        self.surprise = 1.0;
        self.last = [0.0; 2];
        self.increment = [f64::NAN; 2];
        self.same = [0; 2];
        self.missed = 0;
    }

    /// Estimate of the filter, with the uncertainty that the turn adds where that is stated.
    fn estimate(&self) -> Option<Estimate> {
        let mut e = self.filter.estimate()?;
        let [azimuth, length] = self.turn_variances;
        if azimuth > 0.0 {
            // The filter's own uncertainty of the length is as that of the azimuth, for that of (cos A, sin A) is a circle.
            let own = e.azimuth_std * e.azimuth_std;
            e.azimuth_std = libm::sqrt(own + azimuth);
            e.integrity = e.integrity.map(|i| i * own / (own + length));
        }
        Some(e)
    }

    /// Something outside the filter has made the alignment invalid; the first such thing is kept.
    pub fn refuse(&mut self, refusal: Refusal) {
        self.refusal.get_or_insert(refusal);
    }

    /// Estimate of the filter, also where it must not be given out.
    #[must_use]
    pub fn belief(&self) -> Option<Estimate> {
        self.belief
    }

    /// Seconds since the start, the turn included.
    #[must_use]
    pub fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    /// Position, 1 or 2.
    #[must_use]
    pub fn position(&self) -> u8 {
        self.position as u8 + 1
    }

    /// Since when the azimuth is known to 15' (two sigma); `None` while it is not.
    #[must_use]
    pub fn converged_at_s(&self) -> Option<f64> {
        self.converged_at_s
    }

    /// The result.
    ///
    /// # Errors
    /// Why there is none.
    pub fn outcome(&self) -> Result<Estimate, Refusal> {
        if let Some(refusal) = self.refusal {
            return Err(refusal);
        }
        if self.position == 0 {
            return Err(Refusal::OnePosition);
        }
        let part = super::wrap(self.turned).abs();
        if part < SMALLEST_TURN {
            return Err(Refusal::SmallTurn);
        }
        if self.seconds.iter().any(|s| f64::from(*s) * self.step_s < f64::from(SHORTEST)) {
            return Err(Refusal::TooShort);
        }
        let estimate = self.belief.ok_or(Refusal::Breakdown)?;
        if !(estimate.azimuth_std <= UNKNOWN) {
            return Err(Refusal::NotConverged);
        }
        if estimate.integrity.is_some_and(|i| !(i <= INTEGRITY_LIMIT)) {
            return Err(Refusal::Inconsistent);
        }
        Ok(estimate)
    }
}
