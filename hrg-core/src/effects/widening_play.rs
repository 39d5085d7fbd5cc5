//! `widening-play`: `play(T, width) - T`, with a width that changes with temperature: `width_cold_c` at the lower end of the calibrated range, `width_hot_c` at its upper one,
//! geometrically between them and held beyond: a joint of two materials whose clearance or friction grows as they expand. State: the play's output, starting at the first
//! temperature. Source: generalised play (Krasnosel'skii and Pokrovskii 1989).

use super::bank::Play;
use super::parameters::EndWidths;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

/// Output of a play whose width follows temperature, less temperature; C.
#[derive(Debug, Clone)]
pub struct WideningPlay {
    play: Play,
    cold_c: f32,
    log_ratio: f32,
}

impl Effect for WideningPlay {
    const NAME: &'static str = "widening-play";
    const ID: u16 = 51;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = EndWidths;
    type Regressors = [f32; 1];

    fn new(p: EndWidths, _: f32) -> Self {
        Self {
            play: Play::new(p.width_cold_c),
            cold_c: p.width_cold_c,
            log_ratio: libm::logf(p.width_hot_c / p.width_cold_c),
        }
    }

    fn start_on(&mut self, branch: f32) {
        self.play.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.play.state_c)
    }

    fn span(p: EndWidths) -> Span {
        Span::Range(p.width_cold_c.max(p.width_hot_c))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        let (low, high) = (inputs.scaling.linear_below_c, inputs.scaling.linear_above_c);
        let part = if high > low { clamp((t - low) / (high - low), 0.0, 1.0) } else { 0.0 };
        self.play.widen(self.cold_c * libm::expf(self.log_ratio * part));
        [self.play.follow(t) - t]
    }
}
