//! `ramp-by-shape` and `heating-by-shape`: dT/dt (or what of it is heating) times a piecewise-linear curve of temperature over nine
//! knots on the calibrated range, held at its edges. Stateless.

use super::bank::hats;
use super::{Effect, Inputs, Reach};

const KNOTS: usize = 9;

fn weights(inputs: &Inputs<'_>, rate: f32) -> [f32; KNOTS] {
    let (low, high) = (inputs.scaling.linear_below_c, inputs.scaling.linear_above_c);
    let out: [f32; KNOTS] = hats(inputs.own_c(), low, high);
    out.map(|x| rate * x)
}

/// dT/dt times the weights of the knots; C per minute.
#[derive(Debug, Clone)]
pub struct RampByShape;

impl Effect for RampByShape {
    const NAME: &'static str = "ramp-by-shape";
    const ID: u16 = 31;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; KNOTS];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; KNOTS] {
        weights(inputs, inputs.own().ramp_c_per_min)
    }
}

/// Heating part of dT/dt times the weights of the knots; C per minute.
#[derive(Debug, Clone)]
pub struct HeatingByShape;

impl Effect for HeatingByShape {
    const NAME: &'static str = "heating-by-shape";
    const ID: u16 = 32;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; KNOTS];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; KNOTS] {
        let r = inputs.own().ramp_c_per_min;
        weights(inputs, if r > 0.0 { r } else { 0.0 })
    }
}
