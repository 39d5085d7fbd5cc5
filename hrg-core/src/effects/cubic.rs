//! `cubic`: `u^3`, the next power of the baseline's temperature polynomial. Stateless.
//! Source: the usual polynomial order selection; dong2023 stops at `T^2`.

use super::{Effect, Inputs, Reach};

/// `u^3` with `u = (T - t_ref) / t_scale`, continued linearly outside the calibrated range.
#[derive(Debug, Clone)]
pub struct Cubic;

impl Effect for Cubic {
    const NAME: &'static str = "cubic";
    const ID: u16 = 1;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.scaling.cube(inputs.own_c())]
    }
}
