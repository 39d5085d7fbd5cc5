//! `drive-amplitude`: the amplitude-control drive voltage, which follows the resonator's damping. Needs it
//! recorded. Stateless. Source: dong2023 eq 3 (bias grows with the anisotropy of damping `D(1/tau)`).

use super::{Effect, Inputs, Reach};

/// Drive voltage of this axis; V.
#[derive(Debug, Clone)]
pub struct DriveAmplitude;

impl Effect for DriveAmplitude {
    const NAME: &'static str = "drive-amplitude";
    const ID: u16 = 14;
    const REACH: Reach = Reach::NeedsInput("drive_v");

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.recorded.drive_v[inputs.axis]]
    }
}
