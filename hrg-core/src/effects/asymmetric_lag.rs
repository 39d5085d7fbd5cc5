//! `asymmetric-lag`: a first-order lag of temperature, less temperature, with one time constant while it is colder than the resonator and warms, another
//! while it is warmer and cools: a body that is heated by contact or convection and gives its heat away by radiation, or the other way round. State: the
//! lagged temperature, starting in equilibrium with the first one. Source: first-order thermal lag of zhao2022 with a time for each direction.

use super::parameters::BothWays;
use super::{lag_share, settle, Effect, Inputs, Reach, Span};

/// First-order lag with a time constant for each direction, less temperature; C.
#[derive(Debug, Clone)]
pub struct AsymmetricLag {
    warming: f32,
    cooling: f32,
    state_c: f32,
    /// The part of the last step that was too small for the state.
    rest_c: f32,
}

impl Effect for AsymmetricLag {
    const NAME: &'static str = "asymmetric-lag";
    const ID: u16 = 53;
    const REACH: Reach = Reach::Unit;

    type Parameters = BothWays;
    type Regressors = [f32; 1];

    fn new(p: BothWays, step_s: f32) -> Self {
        let [warming, cooling] = [p.warming_tau_s, p.cooling_tau_s].map(|tau_s| lag_share(step_s, tau_s));
        Self { warming, cooling, state_c: f32::NAN, rest_c: 0.0 }
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state_c)
    }

    fn span(p: BothWays) -> Span {
        Span::Time(p.warming_tau_s.max(p.cooling_tau_s))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state_c.is_nan() {
            self.state_c = t;
        }
        let share = if t > self.state_c { self.warming } else { self.cooling };
        settle(&mut self.state_c, &mut self.rest_c, share, t);
        [self.state_c - t]
    }
}
