//! Action of an effect of a case on its runs.

use std::collections::BTreeMap;

/// Three axes of one run.
pub(crate) type Three = [Vec<f64>; 3];

/// Action of one effect, before and after scaling.
pub(crate) struct Acting {
    /// By run and axis, unscaled, as the form gives it; empty where it does not act.
    pub(crate) form: Vec<Three>,
    /// By run and axis: means of 100 s of the form.
    pub(crate) means: Vec<Three>,
    /// By axis.
    pub(crate) scale: [f64; 3],
    /// By axis: size reached, floors.
    pub(crate) floors: [f64; 3],
    /// Drawn numbers, by axis.
    pub(crate) parameters: BTreeMap<String, BTreeMap<String, f64>>,
}
