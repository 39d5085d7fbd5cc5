//! `temperature-step`: 0 below a temperature, 1 above it, with a smooth rise between: a joint that lets go, a mode that another one takes over, a phase
//! that changes. Stateless: heating and cooling pass it at the same temperature (where they do not, it is a [relay](super::relay)).

use super::bank::SmoothRise;
use super::parameters::Rise;
use super::{Effect, Inputs, Reach};

/// A smooth rise of temperature.
#[derive(Debug, Clone)]
pub struct TemperatureStep {
    rise: SmoothRise,
}

impl Effect for TemperatureStep {
    const NAME: &'static str = "temperature-step";
    const ID: u16 = 43;
    const REACH: Reach = Reach::Unit;

    type Parameters = Rise;
    type Regressors = [f32; 1];

    fn new(p: Rise, _: f32) -> Self {
        Self { rise: SmoothRise::new(p.middle_c, p.width_c) }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [self.rise.at(inputs.own_c())]
    }
}
