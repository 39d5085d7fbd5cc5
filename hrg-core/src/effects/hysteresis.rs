//! `hysteresis`: `play(T, width) - T`: the bias follows temperature through a slack of `width`, as a joint with
//! friction does. State: the output of the play operator, starting at the first temperature.
//! Source: play operator (Krasnosel'skii and Pokrovskii 1989), the element of Prandtl-Ishlinskii models.

use super::bank::Play;
use super::parameters::Width;
use super::{Effect, Inputs, Reach, Span};

/// Output of a play of full width `width_c`, less temperature; C.
#[derive(Debug, Clone)]
pub struct Hysteresis {
    play: Play,
}

impl Effect for Hysteresis {
    const NAME: &'static str = "hysteresis";
    const ID: u16 = 6;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Width;
    type Regressors = [f32; 1];

    fn new(parameters: Width, _: f32) -> Self {
        Self { play: Play::new(parameters.width_c) }
    }

    fn start_on(&mut self, branch: f32) {
        self.play.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.play.state_c)
    }

    fn span(p: Width) -> Span {
        Span::Range(p.width_c)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        [self.play.follow(t) - t]
    }
}
