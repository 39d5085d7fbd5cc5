//! wu2023's four-parameter piecewise model (eq 3), for fibre-optic gyros: a coefficient of temperature change that
//! depends on its sign, and one of temperature that depends on the side of a breakpoint.
//!
//! `B = k0 + c d [d < 0] + h d [d >= 0] + l x [T < b] + u x [T >= b]`, with `d` the change over 60 s in C per minute
//! ([`crate::rate_of_change::Difference`]), `b` the breakpoint and `x = T - origin`. wu2023 *adds* a compensation to
//! the output; here, as everywhere in this crate, `B` is *subtracted*, so signs are opposite to its table.
//!
//! # Origin
//! wu2023 counts temperature from 0 C, so its compensation jumps by `(u - l) b` where `T` passes the breakpoint. With
//! the origin at the breakpoint it is continuous, which is what a system should fly; both can be stored.
//!
//! # Example
//! ```
//! use hrg_core::bias::four_parameter::regressors;
//!
//! // 10 C above a breakpoint of 20 C, cooling by half a degree per minute: constant, cooling, heating, low, high.
//! assert_eq!(regressors(20.0, 20.0, 30.0, -0.5), [1.0, -0.5, 0.0, 0.0, 10.0]);
//! ```

/// Linear coefficients: constant, cooling, heating, low, high.
pub const TERMS: usize = 5;

/// Coefficients and the two temperatures.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FourParameter {
    /// `k0` in deg/h; cooling and heating in deg/h per (C per minute); low and high in deg/h per C.
    pub constant_cooling_heating_low_high: [f32; TERMS],
    /// Breakpoint (wu2023: div_a), C.
    pub breakpoint_c: f32,
    /// Origin of the temperature in the model, C.
    pub origin_c: f32,
}

/// The five regressors at a temperature (C) and its change over 60 s (C per minute).
#[inline]
#[must_use]
pub fn regressors(breakpoint_c: f32, origin_c: f32, temperature_c: f32, difference_c_per_min: f32) -> [f32; TERMS] {
    let x = temperature_c - origin_c;
    let d = difference_c_per_min;
    let (cooling, heating) = if d < 0.0 { (d, 0.0) } else { (0.0, d) };
    let (low, high) = if temperature_c < breakpoint_c { (x, 0.0) } else { (0.0, x) };
    [1.0, cooling, heating, low, high]
}
