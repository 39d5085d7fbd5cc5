//! Effects by physics. A form returns what one axis feels over a whole run, in any unit: the generator scales it to the size asked for.
//! Properties of the unit are drawn before anything of the run is looked at, so that they are the same in every run.

pub mod event;
pub mod hysteresis;
pub mod input;
pub mod memory;
pub mod power_on;
pub mod rate;
pub mod shape;
pub mod thermometer;

use crate::draw::Draw;
use crate::world::World;

/// Form of an effect on axis number `axis` (0 to 2) over a run.
pub type Form = fn(&mut Draw, &World, usize) -> Vec<f64>;
