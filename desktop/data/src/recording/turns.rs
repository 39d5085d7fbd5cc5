//! Times of a step on a rate table in which the rate is not steady.

/// Settling time of table and unit after a change of rate, s.
pub const SETTLE_S: usize = 20;

/// Last seconds of a step that do not count, s: the means of a unit end 50 ms behind the second, and so hold part of the next rate.
pub const END_S: usize = 2;
