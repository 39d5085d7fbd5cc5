//! `quadrature`: the quadrature-nulling voltage: a phase error of the demodulator lets a part of it into the
//! rate. Needs it recorded. Stateless.

use super::{Effect, Inputs, Reach};

/// Quadrature-nulling voltage of this axis; V.
#[derive(Debug, Clone)]
pub struct Quadrature;

impl Effect for Quadrature {
    const NAME: &'static str = "quadrature";
    const ID: u16 = 15;
    const REACH: Reach = Reach::NeedsInput("quad_v");

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.recorded.quad_v[inputs.axis]]
    }
}
