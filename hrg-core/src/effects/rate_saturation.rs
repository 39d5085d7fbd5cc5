//! `rate-saturation`: `tanh(r / r0)` with `r` the ramp dT/dt: a bias that follows the ramp and levels off beyond `r0`, as where
//! convection sets in and carries off the gradient that conduction alone would build up. Stateless. Source: none
//! published; the simplest curve that has eq 7's term in dT/dt as its limit at small ramps.

use super::parameters::Ramp;
use super::{Effect, Inputs, Reach};

/// The ramp, levelling off.
#[derive(Debug, Clone)]
pub struct RateSaturation {
    per_ramp: f32,
}

impl Effect for RateSaturation {
    const NAME: &'static str = "rate-saturation";
    const ID: u16 = 37;
    const REACH: Reach = Reach::Unit;

    type Parameters = Ramp;
    type Regressors = [f32; 1];

    fn new(p: Ramp, _: f32) -> Self {
        Self { per_ramp: if p.ramp_c_per_min > 0.0 { 1.0 / p.ramp_c_per_min } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [libm::tanhf(inputs.own().ramp_c_per_min * self.per_ramp)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bias::{Scaling, State};
    use crate::thermal::{AxisThermal, Thermal};
    use crate::AXES;

    fn at(ramp_c_per_min: f32) -> f32 {
        let scaling =
            Scaling { t_ref_c: 10.0, t_scale_c: 45.0, linear_below_c: -45.0, linear_above_c: 65.0, linear_beyond_c_per_min: 6.0, blend_band_c_per_min: 0.2 };
        let state = State {
            temperature_c: 20.0,
            ramp_c_per_min,
            difference_c_per_min: ramp_c_per_min,
            frequency_u: 0.0,
            frequency_u_per_min: 0.0,
        };
        let thermal = Thermal { axes: [AxisThermal { state, known: true, age: 0, settled: true }; AXES], time_s: 1.0 };
        let mut effect = RateSaturation::new(Ramp { ramp_c_per_min: 0.5 }, 1.0);
        effect.step(&Inputs { scaling: &scaling, thermal: &thermal, axis: 0, quantities: &crate::inputs::Quantities::NONE })[0]
    }

    #[test]
    fn it_is_linear_at_small_ramps_and_levels_off() {
        assert!((at(0.005) - 0.01).abs() < 1e-6, "{}", at(0.005));
        assert!((at(0.5) - 0.761_594_2).abs() < 1e-6, "{}", at(0.5));
        assert!((at(5.0) - 1.0).abs() < 1e-6 && at(-5.0) == -at(5.0));
    }
}
