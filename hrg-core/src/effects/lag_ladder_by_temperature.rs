//! `lag-ladder-by-temperature`: the lags of `lag-ladder`, each times normalised temperature (held at the edges of the calibrated
//! range): thermal memory whose gain changes with temperature. State: as there.

use super::lag_ladder::{LagLadder, RUNGS};
use super::parameters::Taus;
use super::{Effect, Inputs, Reach, Span};

/// Lags of temperature, less temperature, times normalised temperature; C.
#[derive(Debug, Clone)]
pub struct LagLadderByTemperature {
    lags: LagLadder,
}

impl Effect for LagLadderByTemperature {
    const NAME: &'static str = "lag-ladder-by-temperature";
    const ID: u16 = 20;
    const REACH: Reach = Reach::Unit;
    const TIMES_TEMPERATURE: bool = true;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self { lags: LagLadder::new(p, step_s) }
    }

    fn memory(&mut self) -> &mut [f32] {
        self.lags.memory()
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let u = inputs.own_u();
        self.lags.step(inputs).map(|x| u * x)
    }
}
