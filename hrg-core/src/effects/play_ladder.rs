//! `play-ladder`: `play(T, width_k) - T` for ten widths from `width_min_c` to `width_max_c`, evenly in the logarithm: a
//! Prandtl-Ishlinskii model, a sum of plays. State: their outputs, starting at the first temperature.
//! Source: Krasnosel'skii and Pokrovskii 1989; Kuhnen 2003.

use super::bank::rung;
use super::parameters::Widths;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

/// Number of plays.
pub const RUNGS: usize = 10;

/// Outputs of plays, less temperature; C.
#[derive(Debug, Clone)]
pub struct PlayLadder {
    half_c: [f32; RUNGS],
    start: f32,
    state_c: [f32; RUNGS],
}

impl Effect for PlayLadder {
    const NAME: &'static str = "play-ladder";
    const ID: u16 = 24;
    const REACH: Reach = Reach::Unit;
    const REMEMBERS_PATH: bool = true;

    type Parameters = Widths;
    type Regressors = [f32; RUNGS];

    fn new(p: Widths, _: f32) -> Self {
        Self { half_c: core::array::from_fn(|k| 0.5 * rung(p.width_min_c, p.width_max_c, k, RUNGS)), start: 0.0, state_c: [f32::NAN; RUNGS] }
    }

    fn start_on(&mut self, branch: f32) {
        self.start = branch;
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state_c
    }

    fn span(p: Widths) -> Span {
        Span::Range(p.width_max_c)
    }

    // (Two effects step it, and each would hold a copy.)
    #[inline(never)]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let t = inputs.own_c();
        if self.state_c[0].is_nan() {
            self.state_c = self.half_c.map(|half| t + self.start * half);
        }
        let mut out = [0.0; RUNGS];
        for k in 0..RUNGS {
            self.state_c[k] = clamp(self.state_c[k], t - self.half_c[k], t + self.half_c[k]);
            out[k] = self.state_c[k] - t;
        }
        out
    }
}
