//! Rest: whether a unit moves, by its own rates.
//!
//! A unit that moves takes no maintenance ([`crate::maintenance::Answer::Moving`]): nobody on the link can change that, for the rates do not come from there. At rest
//! the mean rate of a second differs from that of the next by noise and by a bias that drifts, both far below [`SPREAD_DPH`], and it is the earth's rate and a bias, below
//! [`TURNING_DPH`]; in a vehicle, in flight or at sea one or the other is not so. A platform that is held against the stars, or turns as slowly as an orbit does, is
//! at rest by that. A unit without rates sends none that anybody could fly by, and does not count as moving.
//!
//! # Example
//! ```
//! use hrg_core::still::{Still, SECONDS, SPREAD_DPH};
//!
//! let mut still = Still::default();
//! assert!(!still.second([5.0, 10.0, -7.0]), "at rest");
//! assert!(still.second([5.0 + 2.0 * SPREAD_DPH, 10.0, -7.0]), "it has turned");
//! // At rest again, but not for long enough.
//! assert!((1..SECONDS).all(|_| still.second([5.0, 10.0, -7.0])));
//! assert!(!still.second([5.0, 10.0, -7.0]));
//! // As after a reset in motion: it has to rest first.
//! let mut moved = Still::after_motion();
//! assert!((1..SECONDS).all(|_| moved.second([5.0, 10.0, -7.0])));
//! assert!(!moved.second([5.0, 10.0, -7.0]));
//! ```

use crate::AXES;

/// Seconds that must be alike.
pub const SECONDS: usize = 10;
/// Their mean rates may spread by so much, deg/h: 0.01 deg/s.
pub const SPREAD_DPH: f32 = 36.0;

/// A mean rate of this size is turning, deg/h: 0.1 deg/s. The earth's rate and the raw bias of a gyro of this kind are below.
pub const TURNING_DPH: f32 = 360.0;

/// Mean rates of the last seconds.
#[derive(Debug, Clone)]
pub struct Still {
    rates_dph: [[f32; AXES]; SECONDS],
    next: usize,
    /// So many seconds more it counts as moving.
    wait: usize,
}

impl Default for Still {
    /// Nothing is known: at rest.
    fn default() -> Self {
        Self { rates_dph: [[f32::NAN; AXES]; SECONDS], next: 0, wait: 0 }
    }
}

impl Still {
    /// It has moved until now.
    #[must_use]
    pub fn after_motion() -> Self {
        Self { wait: SECONDS, ..Self::default() }
    }

    /// The mean raw rates of a second, deg/h (NaN: there were none); `true` if the unit moves, or has moved within the last [`SECONDS`].
    pub fn second(&mut self, raw_dph: [f32; AXES]) -> bool {
        if let Some(to) = self.rates_dph.get_mut(self.next) {
            *to = raw_dph;
        }
        self.next = (self.next + 1) % SECONDS;
        self.wait = self.wait.saturating_sub(1);
        let moves = (0..AXES).any(|axis| {
            // (A NaN is neither the least nor the most.)
            let rates = || self.rates_dph.iter().filter_map(|second| second.get(axis).copied());
            let (least, most) = (rates().fold(f32::NAN, f32::min), rates().fold(f32::NAN, f32::max));
            most - least > SPREAD_DPH || most > TURNING_DPH || least < -TURNING_DPH
        });
        moves || self.wait > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_and_a_drift_in_a_chamber_are_rest_and_a_vehicle_is_not() {
        let mut still = Still::default();
        // A bias that drifts by 30 deg/h in a minute, and noise of 2 deg/h each way.
        assert!((0..600).all(|s| !still.second([s as f32 * 0.5 + (s % 3) as f32, 15.0, f32::NAN])));
        // A moored ship: 0.05 deg/s in 8 s.
        let sway = |s: i32| 180.0 * libm::sinf(s as f32 * 0.8);
        assert!((600..700).skip(3).all(|s| still.second([sway(s), 0.0, 0.0]) || s < 604));
        // A turn that is as steady as the spread allows.
        for rate in [3.0 * 3600.0, -400.0] {
            let mut turning = Still::default();
            assert!((0..60).all(|_| turning.second([0.0, rate, 0.0])));
        }
        // Without rates it is not known to move.
        let mut none = Still::default();
        assert!((0..20).all(|_| !none.second([f32::NAN; AXES])));
    }
}
