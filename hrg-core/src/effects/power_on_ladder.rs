//! `power-on-ladder`: `exp(-t / tau_k)` for eight times from `tau_min_s` to `tau_max_s`, evenly in the logarithm, t since power-on: any
//! settling after power-on (stretched, logarithmic, several times) is a sum of these. State: none but that time.

use super::bank::rung;
use super::parameters::Taus;
use super::{Effect, Inputs, Reach, Span};

const RUNGS: usize = 8;

/// Exponential decays since power-on, 1 to 0.
#[derive(Debug, Clone)]
pub struct PowerOnLadder {
    tau_s: [f32; RUNGS],
}

impl Effect for PowerOnLadder {
    const NAME: &'static str = "power-on-ladder";
    const ID: u16 = 33;
    const COMMON: bool = true;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, _: f32) -> Self {
        Self { tau_s: core::array::from_fn(|k| rung(p.tau_min_s, p.tau_max_s, k, RUNGS)) }
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        self.tau_s.map(|tau| libm::expf(-inputs.thermal.time_s / tau))
    }
}

/// The same, times normalised temperature (held at the edges of the calibrated range).
#[derive(Debug, Clone)]
pub struct PowerOnLadderByTemperature {
    ladder: PowerOnLadder,
}

impl Effect for PowerOnLadderByTemperature {
    const NAME: &'static str = "power-on-ladder-by-temperature";
    const ID: u16 = 34;
    const REACH: Reach = Reach::Unit;
    const TIMES_TEMPERATURE: bool = true;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self { ladder: PowerOnLadder::new(p, step_s) }
    }

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        let u = inputs.own_u();
        self.ladder.step(inputs).map(|x| u * x)
    }
}

/// The same, times the normalised temperature that the unit had at power-on.
#[derive(Debug, Clone)]
pub struct PowerOnLadderByStart {
    ladder: PowerOnLadder,
    start_c: f32,
}

impl Effect for PowerOnLadderByStart {
    const NAME: &'static str = "power-on-ladder-by-start";
    const ID: u16 = 36;
    const REACH: Reach = Reach::Unit;

    type Parameters = Taus;
    type Regressors = [f32; RUNGS];

    fn new(p: Taus, step_s: f32) -> Self {
        Self { ladder: PowerOnLadder::new(p, step_s), start_c: f32::NAN }
    }

    fn memory(&mut self) -> &mut [f32] {
        core::slice::from_mut(&mut self.start_c)
    }

    /// A unit knows at which temperature it was switched on, whatever it had before: only the time since then may be another.
    fn soak_at(&mut self, _temperature_c: f32) {}

    fn span(p: Taus) -> Span {
        Span::Time(p.tau_max_s)
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; RUNGS] {
        if self.start_c.is_nan() {
            self.start_c = inputs.own_c();
        }
        let (_, u) = inputs.scaling.u_and_inside(self.start_c);
        self.ladder.step(inputs).map(|x| u * x)
    }
}
