//! `recorded-quantity`: an input q, less its reference: q, q^2, q times normalised temperature, and q
//! behind lags of 300, 1500 and 6000 s, which start in equilibrium. The parameter `channel` is the number of the quantity
//! ([`crate::inputs::NAMES`]): 0 the board's temperature, 1 the supply, 2 to 4 the drives of x, y, z, 5 to 7 their quadrature voltages.
//! `own-quantity`: the same, but each axis reads its own: `channel` is the number of any axis' quantity of that kind.
//! State: the lagged values. Source: Zhou 2025 (Micromachines 16(4) 357), whose regressors are drive, quadrature voltage and their past.

use super::parameters::Channel;
use super::{lag_share, Effect, Inputs, Reach, Span};
use crate::inputs::{of_axis, Quantities, QuantitySet};

const TAUS_S: [f32; 3] = [300.0, 1500.0, 6000.0];

/// Curves and lags of an input: of the same one on every axis, or of each axis' own.
#[derive(Debug, Clone)]
pub struct OfQuantity<const OWN: bool> {
    channel: u8,
    share: [f32; 3],
    state: [f32; 3],
}

/// Curves and lags of one input.
pub type RecordedQuantity = OfQuantity<false>;
/// Curves and lags of an input that each axis has.
pub type OwnQuantity = OfQuantity<true>;

/// The number of the quantity on an axis.
fn number<const OWN: bool>(channel: u8, axis: usize) -> u8 {
    if OWN {
        of_axis(channel, axis)
    } else {
        channel
    }
}

impl<const OWN: bool> Effect for OfQuantity<OWN> {
    const NAME: &'static str = if OWN { "own-quantity" } else { "recorded-quantity" };
    const ID: u16 = if OWN { 57 } else { 38 };
    const REACH: Reach = Reach::NeedsInput("its quantity");

    type Parameters = Channel;
    type Regressors = [f32; 6];

    fn new(p: Channel, step_s: f32) -> Self {
        Self { channel: p.channel as u8, share: TAUS_S.map(|tau| lag_share(step_s, tau)), state: [f32::NAN; 3] }
    }

    fn reads(p: Channel, axis: usize) -> QuantitySet {
        QuantitySet::one(number::<OWN>(p.channel as u8, axis))
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state
    }

    fn span(_: Channel) -> Span {
        Span::Time(TAUS_S[2])
    }

    fn stand_at(&mut self, quantities: &Quantities, axis: usize) {
        self.state = [quantities.get(number::<OWN>(self.channel, axis)); 3];
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 6] {
        let q = inputs.quantities.get(number::<OWN>(self.channel, inputs.axis));
        curves_and_lags(q, inputs, &self.share, &mut self.state)
    }
}

/// Regressors of a quantity.
// (Once in flash, for both.)
#[inline(never)]
fn curves_and_lags(q: f32, inputs: &Inputs<'_>, shares: &[f32; 3], states: &mut [f32; 3]) -> [f32; 6] {
    if q.is_nan() {
        return [f32::NAN; 6];
    }
    for (state, share) in states.iter_mut().zip(shares) {
        if state.is_nan() {
            *state = q;
        }
        *state += share * (q - *state);
    }
    let u = inputs.own_u();
    [q, q * q, q * u, states[0], states[1], states[2]]
}
