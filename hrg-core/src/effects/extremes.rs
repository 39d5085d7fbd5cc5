//! `extremes`: the highest and the lowest temperature since power-on, each less temperature; C: memory that only an extreme
//! changes (a wiped-out loop, a set that creeps once). State: both, starting at the first temperature.

use super::{Effect, Inputs, Reach, Span};

/// Highest and lowest temperature so far, less temperature; C.
#[derive(Debug, Clone)]
pub struct Extremes {
    /// The highest, then the lowest.
    state_c: [f32; 2],
}

impl Effect for Extremes {
    const NAME: &'static str = "extremes";
    const ID: u16 = 35;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; 2];

    fn new(_: (), _: f32) -> Self {
        Self { state_c: [f32::NAN; 2] }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state_c
    }

    fn span(_: ()) -> Span {
        Span::All
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let t = inputs.own_c();
        let [highest, lowest] = &mut self.state_c;
        if !(*highest >= t) {
            *highest = t;
        }
        if !(*lowest <= t) {
            *lowest = t;
        }
        [*highest - t, *lowest - t]
    }
}
