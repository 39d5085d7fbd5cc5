//! `input-network`: one hidden layer of six neurons that see normalised temperature u, the ramp r over the fastest calibrated one, and an
//! input q, less its reference: `tanh(a u + b r + c q + d)`; u and r are held at the ends of the calibrated range. The hidden weights are drawn
//! by the parameter `seed` (a whole number) and stay as drawn, as in an extreme learning machine: a and b within -2 to 2, d within -1.5 to
//! 1.5, and c with either sign and a magnitude of 0.3 to 100 per unit of q, evenly in the logarithm. The output weights are the gains. The
//! parameter `channel` is the number of the quantity, as `recorded-quantity` has it. Stateless. Sources: Zhou 2025 (Micromachines 16(4) 357)
//! for a network on inputs; Huang, Zhu and Siew 2006 (Neurocomputing 70, 489) for hidden weights that are drawn.

use super::parameters::Hidden;
use super::{Effect, Inputs, Reach};
use crate::bias::{clamp, network::tanh};
use crate::inputs::QuantitySet;

const NEURONS: usize = 6;

/// Numbers that a neuron draws: four weights and the sign of one.
const DRAWS: u32 = 5;

/// Hidden layer on one input.
#[derive(Debug, Clone)]
pub struct InputNetwork {
    channel: u8,
    seed: u32,
}

impl InputNetwork {
    /// A number that is even over 0 to 1, the same for the same place.
    fn drawn(&self, place: u32) -> f32 {
        // The finalizer of MurmurHash3.
        let mut x = self.seed.wrapping_mul(0x9E37_79B9).wrapping_add(place.wrapping_add(1).wrapping_mul(0x85EB_CA6B));
        x = (x ^ (x >> 16)).wrapping_mul(0x85EB_CA6B);
        x = (x ^ (x >> 13)).wrapping_mul(0xC2B2_AE35);
        ((x ^ (x >> 16)) >> 8) as f32 / 16_777_216.0
    }

    /// Output of a neuron.
    fn neuron(&self, number: u32, u: f32, r: f32, q: f32) -> f32 {
        let [a, b, c, d, sign] = core::array::from_fn(|k| self.drawn(DRAWS * number + k as u32));
        // 0.3 to 100: exp(-1.204) to exp(4.605).
        let c = libm::expf(5.809 * c - 1.204) * if sign < 0.5 { -1.0 } else { 1.0 };
        tanh((4.0 * a - 2.0) * u + (4.0 * b - 2.0) * r + c * q + 3.0 * d - 1.5)
    }
}

impl Effect for InputNetwork {
    const NAME: &'static str = "input-network";
    const ID: u16 = 42;
    const REACH: Reach = Reach::NeedsInput("its quantity");

    type Parameters = Hidden;
    type Regressors = [f32; NEURONS];

    fn new(p: Hidden, _: f32) -> Self {
        Self { channel: p.channel as u8, seed: p.seed as u32 }
    }

    fn reads(p: Hidden, _: usize) -> QuantitySet {
        QuantitySet::one(p.channel as u8)
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; NEURONS] {
        let q = inputs.quantities.get(self.channel);
        let u = inputs.own_u();
        let r = clamp(inputs.own().ramp_c_per_min / inputs.scaling.linear_beyond_c_per_min, -1.0, 1.0);
        if q.is_nan() {
            return [f32::NAN; NEURONS];
        }
        core::array::from_fn(|k| self.neuron(k as u32, u, r, q))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_draws_the_same_and_evenly() {
        let layer = |seed| InputNetwork { channel: 2, seed };
        let (mut sum, mut low, mut high) = (0.0f64, 1.0f32, 0.0f32);
        for seed in 0..2000 {
            for place in 0..DRAWS * NEURONS as u32 {
                let x = layer(seed).drawn(place);
                assert_eq!(x.to_bits(), layer(seed).drawn(place).to_bits());
                sum += f64::from(x);
                (low, high) = (low.min(x), high.max(x));
            }
        }
        assert!((sum / 60_000.0 - 0.5).abs() < 0.005 && low < 0.001 && high > 0.999 && high < 1.0, "{sum} {low} {high}");
    }

    #[test]
    fn a_neuron_stays_within_one_and_its_input_moves_it() {
        let mut moved = 0;
        for seed in 0..100 {
            let layer = InputNetwork { channel: 2, seed };
            for number in 0..NEURONS as u32 {
                let at = |q| layer.neuron(number, 0.3, -0.5, q);
                assert!([-50.0, 0.0, 50.0].iter().all(|q| at(*q).abs() <= 1.0));
                moved += u32::from((at(0.05) - at(-0.05)).abs() > 0.01);
            }
        }
        assert!(moved > 450, "{moved}");
    }
}
