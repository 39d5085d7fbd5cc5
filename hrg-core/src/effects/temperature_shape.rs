//! `temperature-shape`: a smooth curve of temperature, Chebyshev polynomials of degree 3 to 10 on the calibrated
//! range, held constant outside. Stateless. The fallback for a residual that repeats in temperature but has
//! no named shape.

use super::{Effect, Inputs, Reach, MAX_PARAMETERS};
use crate::bias::clamp;

/// Chebyshev `T3..T10` of temperature scaled to -1..1 between `low_c` and `high_c`.
#[derive(Debug, Clone)]
pub struct TemperatureShape {
    centre_c: f32,
    half_c: f32,
}

impl Effect for TemperatureShape {
    const NAME: &'static str = "temperature-shape";
    const ID: u16 = 3;
    const PARAMETERS: &'static [&'static str] = &["low_c", "high_c"];
    const REACH: Reach = Reach::Unit;

    type Regressors = [f32; 8];

    fn new(parameters: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        let half_c = 0.5 * (parameters[1] - parameters[0]);
        Self { centre_c: 0.5 * (parameters[0] + parameters[1]), half_c: if half_c > 0.0 { half_c } else { 1.0 } }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 8] {
        let x = clamp((inputs.own_c() - self.centre_c) / self.half_c, -1.0, 1.0);
        let (mut before, mut this) = (x, 2.0 * x * x - 1.0);
        let mut out = [0.0; 8];
        for value in &mut out {
            let next = 2.0 * x * this - before;
            before = this;
            this = next;
            *value = next;
        }
        out
    }
}
