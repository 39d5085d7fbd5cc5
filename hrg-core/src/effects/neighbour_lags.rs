//! `neighbour-lags`: temperatures of the two other axes, as they are and behind lags of 400, 1500 and 5000 s, less that of this
//! axis; C. State: the lagged temperatures, starting in equilibrium.

use super::{lag_share, settle, Effect, Inputs, Reach, Span};
use crate::AXES;

/// Lagged temperature differences to the other axes; C.
#[derive(Debug, Clone)]
pub struct NeighbourLags {
    share: [f32; 3],
    state_c: [[f32; 3]; 2],
    /// The part of the last step that was too small for the states.
    rest_c: [[f32; 3]; 2],
}

impl NeighbourLags {
    /// Time constants of the lags, s.
    pub const TAUS_S: [f32; 3] = [400.0, 1500.0, 5000.0];
}

impl Effect for NeighbourLags {
    const NAME: &'static str = "neighbour-lags";
    const ID: u16 = 23;
    const REACH: Reach = Reach::Unit;
    const NEIGHBOURS: bool = true;

    type Parameters = ();
    type Regressors = [f32; 8];

    fn new(_: (), step_s: f32) -> Self {
        Self { share: Self::TAUS_S.map(|tau| lag_share(step_s, tau)), state_c: [[f32::NAN; 3]; 2], rest_c: [[0.0; 3]; 2] }
    }

    fn memory(&mut self) -> &mut [f32] {
        self.state_c.as_flattened_mut()
    }

    fn span(_: ()) -> Span {
        Span::Time(Self::TAUS_S[2])
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 8] {
        let own = inputs.own_c();
        let mut out = [0.0; 8];
        for (n, (state, rest)) in self.state_c.iter_mut().zip(&mut self.rest_c).enumerate() {
            let t = inputs.other_c((inputs.axis + 1 + n) % AXES);
            if state[0].is_nan() {
                *state = [t; 3];
            }
            out[4 * n] = t - own;
            for k in 0..3 {
                settle(&mut state[k], &mut rest[k], self.share[k], t);
                out[4 * n + 1 + k] = state[k] - own;
            }
        }
        out
    }
}
