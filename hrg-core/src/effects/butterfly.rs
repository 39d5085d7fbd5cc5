//! `butterfly`: `u` and `u^2` with `u = (play(T, width) - T) / (width / 2)`, -1 to 1: a loop that crosses itself, as strain has it that grows with the square of a
//! hysteretic quantity (magnetostriction, electrostriction, stress in a joint that slips). State: the output of the play, starting at the first temperature.

use super::bank::Play;
use super::parameters::Width;
use super::{Effect, Inputs, Reach, Span};

/// Stroke of a play over half its width, and the square of it.
#[derive(Debug, Clone)]
pub struct Butterfly {
    play: Play,
    per_c: f32,
}

impl Effect for Butterfly {
    const NAME: &'static str = "butterfly";
    const ID: u16 = 50;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;
    const MAY_AGREE: bool = true;

    type Parameters = Width;
    type Regressors = [f32; 2];

    fn new(p: Width, _: f32) -> Self {
        Self { play: Play::new(p.width_c), per_c: 2.0 / p.width_c }
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
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let t = inputs.own_c();
        let u = (self.play.follow(t) - t) * self.per_c;
        [u, u * u]
    }
}
