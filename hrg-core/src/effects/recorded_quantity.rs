//! `recorded-quantity`: a quantity that only a recording has, less its first value: q, q^2, q times normalised temperature, and q
//! behind lags of 300, 1500 and 6000 s. The parameter `channel` says which one: 0 the board's temperature, 1 the supply, 2 to 4
//! the drives of x, y, z, 5 to 7 their quadrature voltages. State: the first value and the lagged ones.

use super::parameters::Channel;
use super::{lag_share, Effect, Inputs, Reach, Recorded};

const TAUS_S: [f32; 3] = [300.0, 1500.0, 6000.0];

/// Curves and lags of a recorded quantity.
#[derive(Debug, Clone)]
pub struct RecordedQuantity {
    channel: usize,
    share: [f32; 3],
    first: f32,
    state: [f32; 3],
}


impl RecordedQuantity {
    fn value(&self, r: &Recorded) -> f32 {
        match self.channel {
            0 => r.board_c,
            1 => r.supply_v,
            k @ 2..=4 => r.drive_v[k - 2],
            k @ 5..=7 => r.quad_v[k - 5],
            _ => f32::NAN,
        }
    }
}

impl Effect for RecordedQuantity {
    const NAME: &'static str = "recorded-quantity";
    const ID: u16 = 38;
    const REACH: Reach = Reach::NeedsInput("a recorded quantity");

    type Parameters = Channel;
    type Regressors = [f32; 6];

    fn new(p: Channel, step_s: f32) -> Self {
        Self {
            channel: p.channel as usize,
            share: TAUS_S.map(|tau| lag_share(step_s, tau)),
            first: f32::NAN,
            state: [0.0; 3],
        }
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 6] {
        let q = self.value(&inputs.recorded);
        if self.first.is_nan() {
            self.first = q;
        }
        let d = q - self.first;
        if d.is_nan() {
            return [f32::NAN; 6];
        }
        for k in 0..3 {
            self.state[k] += self.share[k] * (d - self.state[k]);
        }
        let (_, u) = inputs.scaling.u_and_inside(inputs.own_c());
        [d, d * d, d * u, self.state[0], self.state[1], self.state[2]]
    }
}
