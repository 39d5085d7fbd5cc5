//! `soft-relay`: a smooth rise of temperature that is taken later on the way back: 0 well below, 1 well above, with the rise about `on_c` while heating and
//! about `off_c` while cooling, each over as many degrees as lie between both: a phase that changes with a loop, a joint that lets go little by little. State: the output
//! of a play of that width. Source: a Preisach operator with one smooth hump (Brokate and Sprekels 1996, section 2.4).

use super::parameters::Thresholds;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

/// `s^2 (3 - 2 s)` of the output of a play, from 0 to 1.
#[derive(Debug, Clone)]
pub struct SoftRelay {
    half_c: f32,
    middle_c: f32,
    start: f32,
    state_c: f32,
}

impl Effect for SoftRelay {
    const NAME: &'static str = "soft-relay";
    const ID: u16 = 47;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Thresholds;
    type Regressors = [f32; 1];

    fn new(p: Thresholds, _: f32) -> Self {
        Self { half_c: 0.5 * (p.on_c - p.off_c), middle_c: 0.5 * (p.on_c + p.off_c), start: 0.0, state_c: f32::NAN }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state_c)
    }

    fn span(p: Thresholds) -> Span {
        Span::Range((p.on_c - p.off_c).abs())
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state_c.is_nan() {
            self.state_c = t + self.start * self.half_c;
        }
        self.state_c = clamp(self.state_c, t - self.half_c, t + self.half_c);
        let per_c = if self.half_c > 0.0 { 0.5 / self.half_c } else { 0.0 };
        let s = clamp(0.5 + (self.state_c - self.middle_c) * per_c, 0.0, 1.0);
        [s * s * (3.0 - 2.0 * s)]
    }
}
