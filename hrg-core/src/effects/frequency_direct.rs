//! `frequency-direct`: bias as a cubic of normalised frequency, with no temperature in between: three
//! regressors `v, v^2, v^3`. Stateless. Source: the outlook of dong2023.
//!
//! As temperature is a curve of frequency, these span what `u, u^2, cubic` span: as an *addition* to the
//! baseline it is `cubic` by another name.

use super::{Effect, Inputs, Reach};

/// `v, v^2, v^3` of the normalised frequency.
#[derive(Debug, Clone)]
pub struct FrequencyDirect;

impl Effect for FrequencyDirect {
    const NAME: &'static str = "frequency-direct";
    const ID: u16 = 17;
    const REACH: Reach = Reach::Unit;

    type Parameters = ();
    type Regressors = [f32; 3];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 3] {
        let v = inputs.own().frequency_u;
        [v, v * v, v * v * v]
    }
}
