//! `cooling-heating`: the difference between a heating and a cooling set of coefficients: `(w - 1/2)` times each
//! regressor of eq 7, with `w` the weight of heating (0 to 1, blended over the band of [`crate::bias`]). Six
//! regressors. Stateless. Source: the two sets of dong2023's Table 3.

use super::{Effect, Inputs, Reach};
use crate::bias::{heating_weight, regressors, TERMS};

/// Half the difference of a heating and a cooling set.
#[derive(Debug, Clone)]
pub struct CoolingHeating;

impl Effect for CoolingHeating {
    const NAME: &'static str = "cooling-heating";
    const ID: u16 = 18;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; TERMS];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; TERMS] {
        let w = heating_weight(inputs.scaling, inputs.own().ramp_c_per_min) - 0.5;
        let mut out = [0.0; TERMS];
        for (o, x) in out.iter_mut().zip(regressors(inputs.scaling, inputs.own_c(), inputs.own().ramp_c_per_min)) {
            *o = w * x;
        }
        out
    }
}
