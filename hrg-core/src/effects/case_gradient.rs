//! `case-gradient`: case sensor less resonator temperature, C, each less its reference: heat that flows through the gyro's case. Needs
//! the case sensor, which usually only a chamber set-up has. Stateless.

use super::{Effect, Inputs, Reach};
use crate::inputs::{case, QuantitySet};

/// Case temperature less resonator temperature, each less its reference; C.
#[derive(Debug, Clone)]
pub struct CaseGradient;

impl Effect for CaseGradient {
    const NAME: &'static str = "case-gradient";
    const ID: u16 = 8;
    const REACH: Reach = Reach::NeedsInput("case_?_c");

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    fn reads(_: (), axis: usize) -> QuantitySet {
        QuantitySet::one(case(axis))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.quantities.case_c(inputs.axis) - (inputs.own_c() - inputs.scaling.t_ref_c)]
    }
}
