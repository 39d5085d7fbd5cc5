//! The named cases, by class.

mod clean;
mod conditions;
mod event;
mod hysteresis;
mod input;
mod memory;
mod mixtures;
mod power_on;
mod rate;
mod shape;
mod thermometer;

use crate::case::Case;

/// All named cases.
#[must_use]
pub fn cases() -> Vec<Case> {
    [
        memory::cases(),
        hysteresis::cases(),
        shape::cases(),
        rate::cases(),
        power_on::cases(),
        input::cases(),
        thermometer::cases(),
        event::cases(),
        mixtures::cases(),
        conditions::cases(),
        clean::cases(),
    ]
    .concat()
}
