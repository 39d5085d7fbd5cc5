//! The bias model of this unit, once or in lockstep.

use hrg_core::compensator::{Model, Output};
use hrg_core::frequency::StepFrequencies;

/// The bias model of this unit.
#[cfg(feature = "past")]
pub type Compensator = Model<hrg_core::history::History>;
/// The bias model of this unit.
#[cfg(not(feature = "past"))]
pub type Compensator = Model<hrg_core::history::Settling>;

/// Models that run: two in separate memory with `lockstep`, so that a bit that flips in one of them shows. (The bring-up program is never flown, and needs the
/// memory.)
pub const CHANNELS: usize = if cfg!(all(feature = "lockstep", not(feature = "bring-up"))) { 2 } else { 1 };

/// One step of the models; `None` if they differ.
#[cfg(all(feature = "lockstep", not(feature = "bring-up")))]
pub fn update([first, second]: &mut [&'static mut Compensator; CHANNELS], step: &StepFrequencies) -> Option<Output> {
    hrg_core::compensator::update_both([first, second], step)
}

/// One step of the model.
#[cfg(not(all(feature = "lockstep", not(feature = "bring-up"))))]
pub fn update([model]: &mut [&'static mut Compensator; CHANNELS], step: &StepFrequencies) -> Option<Output> {
    Some(model.update(step))
}
