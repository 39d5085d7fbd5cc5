//! The bias model of this unit, once or in lockstep.

use hrg_core::compensator::{Model, Output};
use hrg_core::frequency::StepFrequencies;

/// The bias model of this unit.
#[cfg(feature = "past")]
pub type Compensator = Model<hrg_core::history::History>;
/// The bias model of this unit.
#[cfg(not(feature = "past"))]
pub type Compensator = Model<hrg_core::history::Settling>;

/// Models that run: two in separate memory with `lockstep`, so that a bit that flips in one of them shows.
pub const CHANNELS: usize = if cfg!(feature = "lockstep") { 2 } else { 1 };

/// One step of the models; `None` if they differ.
#[cfg(feature = "lockstep")]
pub fn update([first, second]: &mut [&'static mut Compensator; CHANNELS], step: &StepFrequencies) -> Option<Output> {
    hrg_core::compensator::update_both([first, second], step)
}

/// One step of the model.
#[cfg(not(feature = "lockstep"))]
pub fn update([model]: &mut [&'static mut Compensator; CHANNELS], step: &StepFrequencies) -> Option<Output> {
    Some(model.update(step))
}
