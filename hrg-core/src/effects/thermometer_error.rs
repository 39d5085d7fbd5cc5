//! `thermometer-error`: what the resonator's temperature and the case sensor behind a lag of `lag_s` differ by, as it is and times
//! normalised temperature; C. A frequency that ages or hops makes this difference, and an error of the bias with it. State: the
//! lagged case temperature.

use super::parameters::Lag;
use super::{lag_share, Effect, Inputs, Reach};

/// Resonator against case sensor.
#[derive(Debug, Clone)]
pub struct ThermometerError {
    share: f32,
    case_c: f32,
}

impl Effect for ThermometerError {
    const NAME: &'static str = "thermometer-error";
    const ID: u16 = 39;
    const REACH: Reach = Reach::NeedsChamber("case sensors");

    type Parameters = Lag;
    type Regressors = [f32; 2];

    fn new(p: Lag, step_s: f32) -> Self {
        Self { share: lag_share(step_s, p.lag_s), case_c: f32::NAN }
    }

    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 2] {
        let case = inputs.quantities.case_c(inputs.axis);
        if case.is_nan() {
            return [f32::NAN; 2];
        }
        if self.case_c.is_nan() {
            self.case_c = case;
        }
        self.case_c += self.share * (case - self.case_c);
        let d = inputs.own_c() - inputs.scaling.t_ref_c - self.case_c;
        let u = inputs.own_u();
        [d, d * u]
    }
}
