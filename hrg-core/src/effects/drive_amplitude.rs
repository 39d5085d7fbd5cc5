//! `drive-amplitude`: the amplitude-control drive voltage, which follows the resonator's damping. Needs it
//! as an input, from which its reference is taken. Stateless. Source: dong2023 eq 3 (bias grows with the anisotropy of damping `D(1/tau)`).

use super::{Effect, Inputs, Reach};
use crate::inputs::{drive, QuantitySet};

/// Drive voltage of this axis, less its reference; V.
#[derive(Debug, Clone)]
pub struct DriveAmplitude;

impl Effect for DriveAmplitude {
    const NAME: &'static str = "drive-amplitude";
    const ID: u16 = 14;
    const REACH: Reach = Reach::NeedsInput("drive_?_v");

    type Parameters = ();
    type Regressors = [f32; 1];

    fn new(_: (), _: f32) -> Self {
        Self
    }

    fn reads(_: (), axis: usize) -> QuantitySet {
        QuantitySet::one(drive(axis))
    }

    #[inline]
    fn step(&mut self, inputs: &Inputs<'_>) -> [f32; 1] {
        [inputs.quantities.drive_v(inputs.axis)]
    }
}
