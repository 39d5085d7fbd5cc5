//! `quadrature`: the quadrature-nulling voltage: a phase error of the demodulator lets a part of it into the
//! rate. Needs it as an input, from which its reference is taken. Stateless.

use super::{Effect, Inputs, Reach};
use crate::inputs::{quad, QuantitySet};

/// Quadrature-nulling voltage of this axis, less its reference; V.
#[derive(Debug, Clone)]
pub struct Quadrature;

impl Effect for Quadrature {
    const NAME: &'static str = "quadrature";
    const ID: u16 = 15;
    const REACH: Reach = Reach::NeedsInput("quad_?_v");

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    fn reads(_: (), axis: usize) -> QuantitySet {
        QuantitySet::one(quad(axis))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.quantities.quad_v(inputs.axis)]
    }
}
