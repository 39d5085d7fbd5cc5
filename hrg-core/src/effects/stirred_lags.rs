//! `stirred-lags`: as `lag-ladder`, with times that become shorter while the temperature moves, as `1 / (1 + |r| / r0)` with `r` the ramp
//! dT/dt: a body that gas or liquid around it cools the better, the more a ramp stirs it. `tau_max_s` is the longest on a soak; the
//! shortest is 60 s. At the ramp `r0` all are half as long. Steps by the implicit Euler rule. State: the lagged temperatures, starting in
//! equilibrium.
//! Source: heat transfer by convection grows with the difference that drives it; the first order of an even function of the ramp.

use super::arrhenius_ladder::{Relaxing, RUNGS};
use super::parameters::Stirred;
use super::{Effect, Inputs, Reach, Span};
use crate::bias::clamp;

/// Lags of temperature with times that follow the ramp, less temperature; C.
#[derive(Debug, Clone)]
pub struct StirredLags {
    lags: Relaxing,
    per_ramp: f32,
}

impl Effect for StirredLags {
    const NAME: &'static str = "stirred-lags";
    const ID: u16 = 45;
    const REACH: Reach = Reach::Unit;

    type Parameters = Stirred;
    type Regressors = [f32; RUNGS];

    fn new(p: Stirred, step_s: f32) -> Self {
        Self { lags: Relaxing::new(p.tau_max_s, step_s), per_ramp: 1.0 / p.ramp_c_per_min }
    }

    fn memory(&mut self) -> &mut [f32] {
        self.lags.memory()
    }

    fn span(p: Stirred) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let faster = clamp(1.0 + inputs.own().ramp_c_per_min.abs() * self.per_ramp, 1.0, 150.0);
        self.lags.follow(inputs.own_c(), faster)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bias::{Scaling, State};
    use crate::thermal::{AxisThermal, Thermal};
    use crate::AXES;

    /// Lags behind a ramp of some hours, C.
    fn behind(ramp_c_per_min: f32, p: Stirred) -> [f32; RUNGS] {
        let scaling = Scaling {
            t_ref_c: 10.0,
            t_scale_c: 45.0,
            linear_below_c: -45.0,
            linear_above_c: 65.0,
            linear_beyond_c_per_min: 6.0,
            blend_band_c_per_min: 0.2,
        };
        let mut effect = StirredLags::new(p, 1.0);
        let mut lags = [0.0; RUNGS];
        for k in 0..40_000 {
            let state = State {
                temperature_c: ramp_c_per_min / 60.0 * k as f32,
                ramp_c_per_min,
                difference_c_per_min: ramp_c_per_min,
                frequency_u: 0.0,
                frequency_u_per_min: 0.0,
            };
            let thermal = Thermal { axes: [AxisThermal { state, known: true, age: 0, settled: true }; AXES], time_s: 1.0 };
            lags = effect.step(&Inputs { scaling: &scaling, thermal: &thermal, axis: 0, quantities: &crate::inputs::Quantities::NONE });
        }
        lags
    }

    #[test]
    fn a_ramp_shortens_the_times() {
        // Behind a steady ramp a lag is its time constant times the ramp.
        for ramp in [0.05, 0.5, -2.0] {
            let lags = behind(ramp, Stirred { ramp_c_per_min: 0.5, tau_max_s: 3600.0 });
            let times = lags.map(|lag| -lag / (ramp / 60.0));
            let wanted = |tau: f32| tau / (1.0 + ramp.abs() / 0.5);
            assert!((times[0] / wanted(60.0) - 1.0).abs() < 0.02 && (times[8] / wanted(3600.0) - 1.0).abs() < 0.02, "{ramp}: {times:?}");
        }
        assert!(behind(0.0, Stirred { ramp_c_per_min: 0.5, tau_max_s: 3600.0 }).iter().all(|lag| *lag == 0.0));
        // A ramp at which the times are half as long may be as small as it likes: the lags stay numbers.
        assert!(behind(3.0, Stirred { ramp_c_per_min: 1e-38, tau_max_s: 3600.0 }).iter().all(|lag| lag.is_finite()));
    }
}
