//! `quartic`: `u^4`, the power of temperature behind `cubic`. Stateless.
//! Source: the usual polynomial order selection.

use super::{Effect, Inputs, Reach, MAX_PARAMETERS};

/// `u^4` with `u = (T - t_ref) / t_scale`.
#[derive(Debug, Clone)]
pub struct Quartic;

impl Effect for Quartic {
    const NAME: &'static str = "quartic";
    const ID: u16 = 42;
    const PARAMETERS: &'static [&'static str] = &[];
    const REACH: Reach = Reach::Unit;

    type Regressors = [f32; 1];

    fn new(_: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        let u = inputs.scaling.u(inputs.own_c());
        [u * u * u * u]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Calibration;
    use crate::effects::Recorded;
    use crate::thermal::Thermometer;

    #[test]
    fn it_is_the_fourth_power() {
        let c = Calibration::uncalibrated();
        let mut thermometer = Thermometer::new(c.axes.clone().map(|a| a.curve), 0.0);
        thermometer.step(&[Some(4900.0); 3]);
        let inputs = Inputs { scaling: &c.scaling, thermal: thermometer.now(), axis: 0, recorded: Recorded::NONE };
        let u = c.scaling.u(inputs.own_c());
        assert_eq!(Quartic::new(&[0.0; 2], 1.0).step(&inputs), [u * u * u * u]);
    }
}
