//! Columns of the effects of a user's own, as a run holds them.

use hrg_core::effects::{Facts, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::AXES;

/// The columns of an effect for one value of its parameter, on a run.
#[derive(Debug)]
pub struct OwnColumns {
    /// Facts about it for the search.
    pub facts: &'static Facts,
    /// Value of the parameter; 0 where there is none.
    pub parameter: f32,
    axes: [Vec<[f32; MAX_OUTPUTS]>; AXES],
}

impl OwnColumns {
    /// From the regressors of each axis, step by step; empty for an axis that the run does not have.
    #[must_use]
    pub fn new(facts: &'static Facts, parameter: f32, axes: [Vec<[f32; MAX_OUTPUTS]>; AXES]) -> Self {
        Self { facts, parameter, axes }
    }

    /// `true` if these are the columns of the effect `id` with its parameter.
    #[must_use]
    pub fn are_of(&self, id: u16, parameters: &[f32; MAX_PARAMETERS]) -> bool {
        self.facts.id == id && self.parameter.to_bits() == parameters[0].to_bits()
    }

    /// The regressors of an axis, step by step; NaN where a value is missing.
    #[must_use]
    pub fn on(&self, a: usize) -> &[[f32; MAX_OUTPUTS]] {
        &self.axes[a]
    }
}
