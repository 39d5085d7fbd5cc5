//! Rest: whether a unit moves, by its own rates.
//!
//! A unit that moves takes no maintenance ([`crate::maintenance::Answer::Moving`]): nobody on the link can change that, for the rates do not come from there. At rest
//! the mean rate of a second differs from that of the next by noise and by a bias that drifts, both far below [`SPREAD_DPH`]; in a vehicle, in flight or at sea it
//! does not. A unit without rates sends none that anybody could fly by, and does not count as moving.
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
//! ```

use crate::AXES;

/// Seconds that must be alike.
pub const SECONDS: usize = 10;
/// Their mean rates may spread by so much, deg/h: 0.01 deg/s.
pub const SPREAD_DPH: f32 = 36.0;

/// Mean rates of the last seconds.
#[derive(Debug, Clone)]
pub struct Still {
    rates_dph: [[f32; AXES]; SECONDS],
    next: usize,
}

impl Default for Still {
    /// Nothing is known: at rest.
    fn default() -> Self {
        Self { rates_dph: [[f32::NAN; AXES]; SECONDS], next: 0 }
    }
}

impl Still {
    /// The mean raw rates of a second, deg/h (NaN: there were none); `true` if the unit moves, or has moved within the last [`SECONDS`].
    pub fn second(&mut self, raw_dph: [f32; AXES]) -> bool {
        if let Some(to) = self.rates_dph.get_mut(self.next) {
            *to = raw_dph;
        }
        self.next = (self.next + 1) % SECONDS;
        (0..AXES).any(|axis| {
            // (A NaN is neither the least nor the most.)
            let rates = || self.rates_dph.iter().filter_map(|second| second.get(axis).copied());
            rates().fold(f32::NAN, f32::max) - rates().fold(f32::NAN, f32::min) > SPREAD_DPH
        })
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
        // Without rates it is not known to move.
        let mut none = Still::default();
        assert!((0..20).all(|_| !none.second([f32::NAN; AXES])));
    }
}
