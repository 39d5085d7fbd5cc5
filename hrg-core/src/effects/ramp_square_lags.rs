//! `ramp-square-lags`: `(dT/dt)^2` behind eight lags of `tau_min_s` to `tau_max_s`, evenly in the logarithm: creep, settling of glue or of a coating, which a fast ramp either
//! way stirs and which decays afterwards. State: the lagged squares, (C per minute)^2, starting at zero.

use super::bank::rung;
use super::parameters::Taus;
use super::{lag_share, Effect, Inputs, Reach, Span};

const RUNGS: usize = 8;

/// Lags of the squared ramp; (C per minute)^2.
#[derive(Debug, Clone)]
pub struct RampSquareLags {
    share: [f32; RUNGS],
    state: [f32; RUNGS],
    /// Temperature of a soak from which the unit was brought to where it begins; NaN: it was there.
    soaked_c: f32,
}

impl Effect for RampSquareLags {
    const NAME: &'static str = "ramp-square-lags";
    const ID: u16 = 49;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self {
            share: core::array::from_fn(|k| lag_share(step_s, rung(p.tau_min_s, p.tau_max_s, k, RUNGS))),
            state: [0.0; RUNGS],
            soaked_c: f32::NAN,
        }
    }

    fn memory(&mut self) -> &mut [f32] {
        &mut self.state
    }

    fn soak_at(&mut self, temperature_c: f32) {
        self.soaked_c = temperature_c;
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        // The way back from the hot was as fast as the fit knows ramps, and long; that from the cold slow: between both lies every other.
        if core::mem::replace(&mut self.soaked_c, f32::NAN) > inputs.own_c() {
            let fastest = inputs.scaling.linear_beyond_c_per_min;
            self.state = [fastest * fastest; RUNGS];
        }
        let ramp = inputs.own().ramp_c_per_min;
        for (state, share) in self.state.iter_mut().zip(&self.share) {
            *state += share * (ramp * ramp - *state);
        }
        self.state
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bias::{Scaling, State};
    use crate::thermal::{AxisThermal, Thermal};
    use crate::AXES;

    #[test]
    fn between_a_hot_and_a_cold_past_lies_every_other() {
        let scaling = Scaling {
            t_ref_c: 10.0,
            t_scale_c: 45.0,
            linear_below_c: -45.0,
            linear_above_c: 65.0,
            linear_beyond_c_per_min: 2.0,
            blend_band_c_per_min: 0.2,
        };
        let state = State {
            temperature_c: 20.0,
            ramp_c_per_min: 0.0,
            difference_c_per_min: 0.0,
            frequency_u: 0.0,
            frequency_u_per_min: 0.0,
        };
        let axis = AxisThermal { state, known: true, age: 0, settled: true };
        let thermal = Thermal { axes: [axis; AXES], time_s: 1.0 };
        let quantities = &crate::inputs::Quantities::NONE;
        let after = |soaked_c: f32| {
            let mut effect = RampSquareLags::new(Taus { tau_min_s: 60.0, tau_max_s: 6000.0 }, 1.0);
            effect.soak_at(soaked_c);
            effect.step(&Inputs { scaling: &scaling, thermal: &thermal, axis: 0, quantities })
        };
        assert_eq!(after(-45.0), [0.0; RUNGS]);
        assert!(after(65.0).iter().all(|x| (3.9..4.0).contains(x)), "{:?}", after(65.0));
    }
}
