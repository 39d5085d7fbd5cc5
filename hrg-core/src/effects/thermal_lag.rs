//! `thermal-lag`: `lag(T, tau) - T`: the bias follows a body that is slower (or, with the sign of the gain,
//! faster) than the resonator: mount, electronics, housing. State: the lagged temperature, starting in
//! equilibrium with the first one. Source: first-order thermal lag of zhao2022 (694 s for its unit).

use super::parameters::Tau;
use super::{lag_share, settle, Effect, Inputs, Reach, Span};

/// First-order lag of temperature, less temperature; C.
#[derive(Debug, Clone)]
pub struct ThermalLag {
    share: f32,
    state_c: f32,
    /// The part of the last step that was too small for the state.
    rest_c: f32,
}

impl Effect for ThermalLag {
    const NAME: &'static str = "thermal-lag";
    const ID: u16 = 4;
    const REACH: Reach = Reach::Unit;

    type Parameters = Tau;
    type Regressors = [f32; 1];

    fn new(parameters: Tau, step_s: f32) -> Self {
        Self { share: lag_share(step_s, parameters.tau_s), state_c: f32::NAN, rest_c: 0.0 }
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state_c)
    }

    fn span(p: Tau) -> Span {
        Span::Time(p.tau_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state_c.is_nan() {
            self.state_c = t;
        }
        settle(&mut self.state_c, &mut self.rest_c, self.share, t);
        [self.state_c - t]
    }
}
