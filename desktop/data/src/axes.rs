//! The three axes of a unit.

/// Names of the axes, in order.
pub const AXIS_NAMES: [&str; 3] = ["x", "y", "z"];
