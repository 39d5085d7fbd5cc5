//! `relay`: 1 once the temperature has risen above `on_c`, 0 once it has fallen below `off_c`: a contact or a joint that snaps.
//! State: which of the two, starting with the nearer one. Source: the element of Preisach's model.

use super::{Effect, Inputs, Reach, MAX_PARAMETERS};

/// A switch with two thresholds.
#[derive(Debug, Clone)]
pub struct Relay {
    on_c: f32,
    off_c: f32,
    state: f32,
}

impl Effect for Relay {
    const NAME: &'static str = "relay";
    const ID: u16 = 26;
    const PARAMETERS: &'static [&'static str] = &["on_c", "off_c"];
    const REACH: Reach = Reach::Unit;

    type Regressors = [f32; 1];

    fn new(p: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self { on_c: p[0], off_c: p[1], state: f32::NAN }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let t = inputs.own_c();
        if self.state.is_nan() {
            self.state = if t > 0.5 * (self.on_c + self.off_c) { 1.0 } else { 0.0 };
        }
        if t > self.on_c {
            self.state = 1.0;
        } else if t < self.off_c {
            self.state = 0.0;
        }
        [self.state]
    }
}
