//! `lag-ladder-by-temperature`: the lags of `lag-ladder`, each times normalised temperature (held at the edges of the calibrated
//! range): thermal memory whose gain changes with temperature. State: as there.

use super::lag_ladder::{LagLadder, RUNGS};
use super::{Effect, Inputs, Reach, Span, MAX_PARAMETERS};

/// Lags of temperature, less temperature, times normalised temperature; C.
#[derive(Debug, Clone)]
pub struct LagLadderByTemperature {
    lags: LagLadder,
}

impl Effect for LagLadderByTemperature {
    const NAME: &'static str = "lag-ladder-by-temperature";
    const ID: u16 = 20;
    const PARAMETERS: &'static [&'static str] = LagLadder::PARAMETERS;
    const REACH: Reach = Reach::Unit;

    type Regressors = [f32; RUNGS];

    fn new(p: &[f32; MAX_PARAMETERS], step_s: f32) -> Self {
        Self { lags: LagLadder::new(p, step_s) }
    }

    fn memory(&mut self) -> &mut [f32] {
        self.lags.memory()
    }

    fn span(p: &[f32; MAX_PARAMETERS]) -> Span {
        Span::Time(p[1])
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let (_, u) = inputs.scaling.u_and_inside(inputs.own_c());
        self.lags.step(inputs).map(|x| u * x)
    }
}
