//! `aging`: time, in hours: a drift that goes on. A unit that does not know how old its calibration is cannot
//! predict it. Stateless.

use super::{Effect, Inputs, Reach};

/// Time since power-on; h.
#[derive(Debug, Clone)]
pub struct Aging;

impl Effect for Aging {
    const NAME: &'static str = "aging";
    const ID: u16 = 10;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unpredictable;

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.thermal.time_s / 3600.0]
    }
}
