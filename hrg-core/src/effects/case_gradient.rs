//! `case-gradient`: shell sensor less resonator temperature, C: heat that flows through the gyro's case. Needs
//! the shell sensor, which only a chamber set-up has. Stateless.

use super::{one, Effect, Inputs, Reach, MAX_OUTPUTS, MAX_PARAMETERS};

/// Shell temperature less resonator temperature; C.
#[derive(Debug, Clone)]
pub struct CaseGradient;

impl Effect for CaseGradient {
    const NAME: &'static str = "case-gradient";
    const ID: u16 = 8;
    const PARAMETERS: &'static [&'static str] = &[];
    const OUTPUTS: usize = 1;
    const REACH: Reach = Reach::NeedsInput("shell_c");

    fn new(_: &[f32; MAX_PARAMETERS], _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; MAX_OUTPUTS] {
        one(inputs.recorded.shell_c[inputs.axis] - inputs.own_c())
    }
}
