//! `late-onset`: a smooth rise in the time since power-on, from 0 to 1, about `middle_s` and over `rise_s`: a heater or a control loop that cuts in late. Stateless.
//! (What happens at once is a [step](super::step), which may happen in one run alone.)

use super::bank::SmoothRise;
use super::parameters::Onset;
use super::{Effect, Inputs, Reach, Span};

/// A smooth rise of the time since power-on.
#[derive(Debug, Clone)]
pub struct LateOnset {
    rise: SmoothRise,
}

impl Effect for LateOnset {
    const NAME: &'static str = "late-onset";
    const ID: u16 = 52;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unit;

    type Parameters = Onset;
    type Regressors = [f32; 1];

    fn new(p: Onset, _: f32) -> Self {
        Self { rise: SmoothRise::new(p.middle_s, p.rise_s) }
    }

    /// Three of these times lead behind the rise.
    fn span(p: Onset) -> Span {
        Span::Time((p.middle_s + 0.5 * p.rise_s) / 3.0)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [self.rise.at(inputs.thermal.time_s)]
    }
}
