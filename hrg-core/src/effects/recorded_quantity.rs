//! `recorded-quantity`: an input q, less its reference: q, q^2, q times normalised temperature, and q
//! behind lags of 300, 1500 and 6000 s, which start in equilibrium. The parameter `channel` is the number of the quantity
//! ([`crate::inputs::NAMES`]): 0 the board's temperature, 1 the supply, 2 to 4 the drives of x, y, z, 5 to 7 their quadrature voltages.
//! State: the lagged values. Source: Zhou 2025 (Micromachines 16(4) 357), whose regressors are drive, quadrature voltage and their past.

use super::parameters::Channel;
use super::{lag_share, Effect, Inputs, Reach, Span};
use crate::inputs::{Quantities, QuantitySet};

const TAUS_S: [f32; 3] = [300.0, 1500.0, 6000.0];

/// Curves and lags of an input.
#[derive(Debug, Clone)]
pub struct RecordedQuantity {
    channel: u8,
    share: [f32; 3],
    state: [f32; 3],
}

impl Effect for RecordedQuantity {
    const NAME: &'static str = "recorded-quantity";
    const ID: u16 = 38;
    const REACH: Reach = Reach::NeedsInput("its quantity");

    type Parameters = Channel;
    type Regressors = [f32; 6];

    fn new(p: Channel, step_s: f32) -> Self {
        Self { channel: p.channel as u8, share: TAUS_S.map(|tau| lag_share(step_s, tau)), state: [f32::NAN; 3] }
    }

    fn reads(p: Channel, _: usize) -> QuantitySet {
        QuantitySet::one(p.channel as u8)
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state
    }

    fn span(_: Channel) -> Span {
        Span::Time(TAUS_S[2])
    }

    fn stand_at(&mut self, quantities: &Quantities) {
        self.state = [quantities.get(self.channel); 3];
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 6] {
        let q = inputs.quantities.get(self.channel);
        if q.is_nan() {
            return [f32::NAN; 6];
        }
        for (state, share) in self.state.iter_mut().zip(self.share) {
            if state.is_nan() {
                *state = q;
            }
            *state += share * (q - *state);
        }
        let (_, u) = inputs.scaling.u_and_inside(inputs.own_c());
        [q, q * q, q * u, self.state[0], self.state[1], self.state[2]]
    }
}
