//! `play-ladder-by-temperature`: the plays of `play-ladder`, each times normalised temperature (held at the edges of the calibrated
//! range): a hysteresis whose size changes with temperature. State: as there.

use super::parameters::Widths;
use super::play_ladder::{PlayLadder, RUNGS};
use super::{Effect, Inputs, Reach, Span};

/// Outputs of plays, less temperature, times normalised temperature; C.
#[derive(Debug, Clone)]
pub struct PlayLadderByTemperature {
    plays: PlayLadder,
}

impl Effect for PlayLadderByTemperature {
    const NAME: &'static str = "play-ladder-by-temperature";
    const ID: u16 = 44;
    const REACH: Reach = Reach::Unit;
    const TIMES_TEMPERATURE: bool = true;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Widths;
    type Regressors = [f32; RUNGS];

    fn new(p: Widths, step_s: f32) -> Self {
        Self { plays: PlayLadder::new(p, step_s) }
    }

    fn start_on(&mut self, branch: f32) {
        self.plays.start_on(branch);
    }

    fn memory(&mut self) -> &mut [f32] {
        self.plays.memory()
    }

    fn span(p: Widths) -> Span {
        PlayLadder::span(p)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let u = inputs.own_u();
        self.plays.step(inputs).map(|x| u * x)
    }
}
