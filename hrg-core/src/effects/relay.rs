//! `relay`: 1 once the temperature has risen above `on_c`, 0 once it has fallen below `off_c`: a contact or a joint that snaps.
//! State: which of the two, starting with the nearer one. Source: the element of Preisach's model.

use super::parameters::Thresholds;
use super::{Effect, Inputs, Reach, Span};

impl Thresholds {
    /// `true` where a relay goes on at a temperature (C), `false` where it goes off, `None` where it stays as it is.
    #[inline]
    #[must_use]
    pub fn switched(self, temperature_c: f32) -> Option<bool> {
        if temperature_c > self.on_c {
            Some(true)
        } else if temperature_c < self.off_c {
            Some(false)
        } else {
            None
        }
    }

    /// Temperature between both, C.
    #[inline]
    pub(super) fn middle_c(self) -> f32 {
        0.5 * (self.on_c + self.off_c)
    }

    /// Distance from the lower to the upper one, C.
    #[inline]
    pub(super) fn apart_c(self) -> f32 {
        self.on_c - self.off_c
    }
}

/// A switch with two thresholds.
#[derive(Debug, Clone)]
pub struct Relay {
    thresholds: Thresholds,
    start: f32,
    state: f32,
}

impl Effect for Relay {
    const NAME: &'static str = "relay";
    const ID: u16 = 26;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Thresholds;
    type Regressors = [f32; 1];

    fn new(p: Thresholds, _: f32) -> Self {
        Self { thresholds: p, start: 0.0, state: f32::NAN }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state)
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.state = if temperature_c > self.thresholds.middle_c() { 1.0 } else { 0.0 };
    }

    fn span(p: Thresholds) -> Span {
        Span::Range(p.apart_c().abs())
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state.is_nan() {
            // In the middle: as it would be at most temperatures on that side.
            let above = t > self.thresholds.middle_c();
            self.state = if self.start > 0.0 || (self.start == 0.0 && above) { 1.0 } else { 0.0 };
        }
        if let Some(on) = self.thresholds.switched(t) {
            self.state = if on { 1.0 } else { 0.0 };
        }
        [self.state]
    }
}
