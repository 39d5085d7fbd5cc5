//! `soft-relay`: a smooth rise of temperature that is taken later on the way back: 0 well below, 1 well above, with the rise about `on_c` while heating and
//! about `off_c` while cooling, each over as many degrees as lie between both: a phase that changes with a loop, a joint that lets go little by little. State: the output
//! of a play of that width. Source: a Preisach operator with one smooth hump (Brokate and Sprekels 1996, section 2.4).

use super::bank::{Play, SmoothRise};
use super::parameters::Thresholds;
use super::{Effect, Inputs, Reach, Span};

/// A smooth rise of the output of a play.
#[derive(Debug, Clone)]
pub struct SoftRelay {
    play: Play,
    rise: SmoothRise,
}

impl Effect for SoftRelay {
    const NAME: &'static str = "soft-relay";
    const ID: u16 = 47;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Thresholds;
    type Regressors = [f32; 1];

    fn new(p: Thresholds, _: f32) -> Self {
        Self { play: Play::new(p.apart_c()), rise: SmoothRise::new(p.middle_c(), p.apart_c()) }
    }

    fn start_on(&mut self, branch: f32) {
        self.play.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.play.state_c)
    }

    fn span(p: Thresholds) -> Span {
        Span::Range(p.apart_c().abs())
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [self.rise.at(self.play.follow(inputs.own_c()))]
    }
}
