//! Something that the fits leave over, and what adding it does.

use super::residual::{largest, rms};
use serde::Serialize;
use std::collections::BTreeMap;

/// Something that is left over, and what adding it does.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOver {
    /// Name.
    pub name: String,
    /// Reference it is seen against.
    pub reference: String,
    /// Finding, in a sentence.
    pub finding: String,
    /// Inner parameters.
    pub parameters: BTreeMap<String, f64>,
    /// Per axis: gain and what the fit leaves before and after.
    pub axes: BTreeMap<String, BeforeAfter>,
    /// Chance that noise alone gives as much.
    pub p_value: f64,
    /// Statistic that it is judged by.
    pub statistic: String,
    /// Physical causes that these points cannot tell apart.
    pub indistinguishable_from: Vec<String>,
}

/// Residuals before and after, C.
#[derive(Debug, Clone, Serialize)]
pub struct BeforeAfter {
    /// Size on this axis, C.
    pub gain: f64,
    /// RMS before.
    pub rms_before_c: f64,
    /// RMS after.
    pub rms_after_c: f64,
    /// Largest before.
    pub max_before_c: f64,
    /// Largest after.
    pub max_after_c: f64,
    /// Leave-one-out RMS before.
    pub leave_one_out_before_c: f64,
    /// Leave-one-out RMS after.
    pub leave_one_out_after_c: f64,
}

pub(super) fn before_after(gain: f64, e0: &[f64], l0: &[f64], e1: &[f64], l1: &[f64]) -> BeforeAfter {
    BeforeAfter {
        gain,
        rms_before_c: rms(e0),
        rms_after_c: rms(e1),
        max_before_c: largest(e0),
        max_after_c: largest(e1),
        leave_one_out_before_c: rms(l0),
        leave_one_out_after_c: rms(l1),
    }
}
