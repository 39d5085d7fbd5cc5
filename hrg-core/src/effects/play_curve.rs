//! `play-curve`: a curve of the output of a play of `width_c`, less the same curve of temperature: a piecewise-linear one over
//! eight knots on the calibrated range. A sum of such curves of several widths is a Preisach operator: soft relays, loops whose
//! gain changes with temperature. State: the play's output, starting at the first temperature.
//! Source: Brokate and Sprekels 1996, section 2.4 (a Preisach operator is an integral over plays of functions of their outputs).

use super::bank::{hats, Play};
use super::parameters::Width;
use super::{Effect, Inputs, Reach, Span};

const KNOTS: usize = 8;

/// Weights of the knots at the play's output less those at the temperature.
#[derive(Debug, Clone)]
pub struct PlayCurve {
    play: Play,
}

impl Effect for PlayCurve {
    const NAME: &'static str = "play-curve";
    const ID: u16 = 25;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;
    const CURVE: bool = true;

    type Parameters = Width;
    type Regressors = [f32; KNOTS];

    fn new(p: Width, _: f32) -> Self {
        Self { play: Play::new(p.width_c) }
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
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; KNOTS] {
        let t = inputs.own_c();
        let output = self.play.follow(t);
        let (low, high) = (inputs.scaling.linear_below_c, inputs.scaling.linear_above_c);
        let mut out: [f32; KNOTS] = hats(output, low, high);
        let direct: [f32; KNOTS] = hats(t, low, high);
        for k in 0..KNOTS {
            out[k] -= direct[k];
        }
        out
    }
}
