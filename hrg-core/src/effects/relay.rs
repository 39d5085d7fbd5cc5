//! `relay`: 1 once the temperature has risen above `on_c`, 0 once it has fallen below `off_c`: a contact or a joint that snaps.
//! State: which of the two, starting with the nearer one. Source: the element of Preisach's model.

use super::parameters::Thresholds;
use super::{Effect, Inputs, Reach, Span};

/// A switch with two thresholds.
#[derive(Debug, Clone)]
pub struct Relay {
    on_c: f32,
    off_c: f32,
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
        Self { on_c: p.on_c, off_c: p.off_c, start: 0.0, state: f32::NAN }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.state)
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.state = if temperature_c > 0.5 * (self.on_c + self.off_c) { 1.0 } else { 0.0 };
    }

    fn span(p: Thresholds) -> Span {
        Span::Range((p.on_c - p.off_c).abs())
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state.is_nan() {
            // In the middle: as it would be at most temperatures on that side.
            let above = t > 0.5 * (self.on_c + self.off_c);
            self.state = if self.start > 0.0 || (self.start == 0.0 && above) { 1.0 } else { 0.0 };
        }
        if t > self.on_c {
            self.state = 1.0;
        } else if t < self.off_c {
            self.state = 0.0;
        }
        [self.state]
    }
}
