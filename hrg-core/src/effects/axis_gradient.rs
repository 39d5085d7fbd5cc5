//! `axis-gradient`: temperature of the two other axes less that of this one, C: heat that flows through the
//! block bends its mount. Two regressors (next axis, then the one after: x: y, z; y: z, x; z: x, y). Stateless.

use super::{Effect, Inputs, Reach};
use crate::AXES;

/// Temperature differences to the other axes; C.
#[derive(Debug, Clone)]
pub struct AxisGradient;

impl Effect for AxisGradient {
    const NAME: &'static str = "axis-gradient";
    const ID: u16 = 7;
    const REACH: Reach = Reach::Unit;
    const NEIGHBOURS: bool = true;

    type Parameters = ();
    type Regressors = [f32; 2];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let beyond = |n| inputs.other_c((inputs.axis + n) % AXES) - inputs.own_c();
        [beyond(1), beyond(2)]
    }
}
