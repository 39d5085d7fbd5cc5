//! `cooling-heating-held`: as `cooling-heating`, but the set of the last direction holds: -1/2 times each regressor of eq 7 from the
//! first cooling on, 1/2 from the first heating on, so that a soak belongs to the ramp before it. The bias steps where the
//! direction changes. A direction counts from the band of [`crate::bias`] on. State: the direction, 0 before the first one.
//! Source: dong2023 fits a cooling stage, which has the soak after it, and a heating stage (its Table 3).

use super::{Effect, Inputs, Reach};
use crate::bias::{regressors, TERMS};

/// Half the difference of a heating and a cooling set, by the last direction.
#[derive(Debug, Clone)]
pub struct CoolingHeatingHeld {
    start: f32,
    /// -0.5 cooling, 0.5 heating.
    weight: f32,
}

impl Effect for CoolingHeatingHeld {
    const NAME: &'static str = "cooling-heating-held";
    const ID: u16 = 40;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = ();
    type Regressors = [f32; TERMS];

    fn new(_: (), _: f32) -> Self {
        Self { start: 0.0, weight: f32::NAN }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = -0.5 * branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.weight)
    }

    fn soak_at(&mut self, _: f32) {
        self.weight = 0.0;
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; TERMS] {
        let (ramp, band) = (inputs.own().ramp_c_per_min, inputs.scaling.blend_band_c_per_min);
        if self.weight.is_nan() {
            self.weight = self.start;
        }
        if ramp > band {
            self.weight = 0.5;
        } else if ramp < -band {
            self.weight = -0.5;
        }
        let mut out = [0.0; TERMS];
        for (o, x) in out.iter_mut().zip(regressors(inputs.scaling, inputs.own_c(), ramp)) {
            *o = self.weight * x;
        }
        out
    }
}
