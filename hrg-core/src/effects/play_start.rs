//! `play-start`: what plays of seven widths from `width_min_c` to `width_max_c` owe to the branch that they began on: the output of a
//! play that began at its upper end less that of one that began in the middle, and the same for the lower end; C. Both die
//! out as temperature sweeps the width. It belongs to a run and not to the unit, which does not know its history.

use super::bank::rung;
use super::{Effect, Inputs, Reach, MAX_PARAMETERS};
use crate::bias::clamp;

const RUNGS: usize = 7;

/// Outputs of plays that began elsewhere, less that of one that began in the middle; C.
#[derive(Debug, Clone)]
pub struct PlayStart {
    half_c: [f32; RUNGS],
    /// Upper, middle, lower.
    state_c: [[f32; 3]; RUNGS],
}

impl Effect for PlayStart {
    const NAME: &'static str = "play-start";
    const ID: u16 = 40;
    const PARAMETERS: &'static [&'static str] = &["width_min_c", "width_max_c"];
    const REACH: Reach = Reach::Unpredictable;

    type Regressors = [f32; 2 * RUNGS];

    fn new(p: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self { half_c: core::array::from_fn(|k| 0.5 * rung(p[0], p[1], k, RUNGS)), state_c: [[f32::NAN; 3]; RUNGS] }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2 * RUNGS] {
        let t = inputs.own_c();
        let mut out = [0.0; 2 * RUNGS];
        for k in 0..RUNGS {
            let half = self.half_c[k];
            if self.state_c[k][0].is_nan() {
                self.state_c[k] = [t + half, t, t - half];
            }
            let s = self.state_c[k].map(|s| clamp(s, t - half, t + half));
            self.state_c[k] = s;
            out[2 * k] = s[0] - s[1];
            out[2 * k + 1] = s[2] - s[1];
        }
        out
    }
}
