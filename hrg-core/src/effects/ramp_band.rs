//! `ramp-band`: within some degrees the bias follows the ramp otherwise: dT/dt, and what of it is heating, C per minute, times
//! `(1 - u^2) exp(-u^2 / 2)`, with `u = (T - middle) / width`. It is the slope of a swing: where another mode pulls the frequency (an activity dip),
//! the thermometer errs by that swing, and the ramp that it shows by the slope. Sharper than the curves of
//! [`ramp-by-shape`](super::ramp_by_shape). Stateless.

use super::parameters::Band;
use super::{Effect, Inputs, Reach};
use crate::bias::clamp;

/// Widths from the middle beyond which there is nothing.
const FAR: f32 = 10.0;

/// The slope of a swing times dT/dt.
#[derive(Debug, Clone)]
pub struct RampBand {
    band: Band,
}

impl Effect for RampBand {
    const NAME: &'static str = "ramp-band";
    const ID: u16 = 58;
    const REACH: Reach = Reach::Unit;

    type Parameters = Band;
    type Regressors = [f32; 2];

    fn new(band: Band, _: f32) -> Self {
        Self { band }
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let u = clamp((inputs.own_c() - self.band.middle_c) / self.band.width_c, -FAR, FAR);
        let bell = libm::expf(-0.5 * u * u);
        let ramp = inputs.own().ramp_c_per_min;
        let slope = (1.0 - u * u) * bell;
        [ramp * slope, if ramp > 0.0 { ramp * slope } else { 0.0 }]
    }
}
