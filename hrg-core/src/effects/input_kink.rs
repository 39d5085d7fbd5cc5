//! `input-kink`: `max(q - break_at, 0)` and q, with q an input less its reference: a change of slope, as a rectifier, a limiter or a regulator at its end makes it. The
//! parameter `channel` is the number of the quantity, as `recorded-quantity` has it; of a quantity
//! that each axis has, any axis' number stands for the own one.
//! Stateless.

use super::parameters::Bend;
use super::{Effect, Inputs, Reach};
use crate::bias::clamp;
use crate::inputs::{of_axis, QuantitySet};

/// The part of an input above a value, and the input.
#[derive(Debug, Clone)]
pub struct InputKink {
    bend: Bend,
}

impl Effect for InputKink {
    const NAME: &'static str = "input-kink";
    const ID: u16 = 56;
    const REACH: Reach = Reach::NeedsInput("its quantity");

    type Parameters = Bend;
    type Regressors = [f32; 2];

    fn new(bend: Bend, _: f32) -> Self {
        Self { bend }
    }

    fn reads(p: Bend, axis: usize) -> QuantitySet {
        QuantitySet::one(of_axis(p.channel as u8, axis))
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let q = inputs.quantities.get(of_axis(self.bend.channel as u8, inputs.axis));
        [clamp(q - self.bend.break_at, 0.0, f32::INFINITY), q]
    }
}
