//! Plan of a run, and the body that its thermometer shows.

use crate::chamber::{Leg, Program, Span};

/// Body of each gyro that the bias follows: a thermometer without fault shows the temperature of that body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Followed {
    /// The resonator: the thermometer is its frequency.
    Resonator,
    /// The case: a sensor on it is the thermometer.
    Case,
    /// The base plate: one sensor on it serves all axes.
    Base,
}

/// Plan of a run.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// The chamber's program.
    pub program: Program,
    /// Legs in the place of those that the program draws; none: the program's.
    pub legs: &'static [Leg],
    /// Its temperatures.
    pub span: Span,
    /// Length of the log, h.
    pub hours: f64,
    /// Time from power-on to the first row, s.
    pub log_from_s: f64,
    /// State of memory of path at power-on: 1 for a unit that came from the hot end, -1 from the cold end.
    pub branch: f64,
    /// Heat that slow bodies have kept of the day before at power-on, C above all others.
    pub kept_c: f64,
}
