//! `second-derivative`: `d2T/dt2`, C per minute squared, from the change of `dT/dt` through a first-order high
//! pass of 20 s (so it answers 20 s after the slope's own 9.5 s). State: the lagged `dT/dt`.

use super::{lag_share, Effect, Inputs, Reach};

/// Time constant of the high pass, s.
const TAU_S: f32 = 20.0;

/// Rate of change of the rate of change of temperature; C per minute squared.
#[derive(Debug, Clone)]
pub struct SecondDerivative {
    share: f32,
    state: f32,
}

impl Effect for SecondDerivative {
    const NAME: &'static str = "second-derivative";
    const ID: u16 = 5;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), step_s: f32) -> Self {
        Self { share: lag_share(step_s, TAU_S), state: f32::NAN }
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state)
    }

    // It settles with the slope of temperature itself, which is flagged until then.
    fn soak_at(&mut self, _: f32) {}

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let r = inputs.own().ramp_c_per_min;
        if self.state.is_nan() {
            self.state = r;
        }
        let out = (r - self.state) * (60.0 / TAU_S);
        self.state += self.share * (r - self.state);
        [out]
    }
}
