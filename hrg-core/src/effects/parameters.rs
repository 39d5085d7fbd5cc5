//! Inner parameters of the effects: a type for each set of them, with named fields. In an image, and in a search that varies them, they are
//! a row of numbers in the order of the fields; [`Parameters`] leads from one to the other.
//!
//! # Example
//! ```
//! use hrg_core::effects::parameters::{Parameters, Taus};
//!
//! let taus = Taus::of(&[30.0, 3600.0]);
//! assert_eq!(taus.tau_max_s, 3600.0);
//! assert_eq!(taus.row(), [30.0, 3600.0]);
//! assert_eq!(Taus::NAMES, ["tau_min_s", "tau_max_s"]);
//! ```

use super::MAX_PARAMETERS;

/// A set of inner parameters.
pub trait Parameters: Copy {
    /// Their names, with unit.
    const NAMES: &'static [&'static str];
    /// Parameters that must be above zero: time constants, widths, periods and ramps.
    const POSITIVE: [bool; MAX_PARAMETERS];
    /// Of a row, in which zeros fill the places that it has not.
    fn of(row: &[f32; MAX_PARAMETERS]) -> Self;
    /// As a row.
    fn row(self) -> [f32; MAX_PARAMETERS];
}

impl Parameters for () {
    const NAMES: &'static [&'static str] = &[];
    const POSITIVE: [bool; MAX_PARAMETERS] = [false; MAX_PARAMETERS];
    fn of(_: &[f32; MAX_PARAMETERS]) -> Self {}
    fn row(self) -> [f32; MAX_PARAMETERS] {
        [0.0; MAX_PARAMETERS]
    }
}

macro_rules! parameters {
    ($($(#[$about:meta])+ $set:ident { $($field:ident: $positive:literal, $meaning:literal);+ })+) => {$(
        $(#[$about])+
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $set {
            $(#[doc = $meaning] pub $field: f32),+
        }

        impl Parameters for $set {
            const NAMES: &'static [&'static str] = &[$(stringify!($field)),+];
            const POSITIVE: [bool; MAX_PARAMETERS] = first(&[$($positive),+]);
            #[inline]
            fn of(row: &[f32; MAX_PARAMETERS]) -> Self {
                let mut numbers = row.iter().copied();
                Self { $($field: numbers.next().unwrap_or(0.0)),+ }
            }
            #[inline]
            fn row(self) -> [f32; MAX_PARAMETERS] {
                let mut row = [0.0; MAX_PARAMETERS];
                row.iter_mut().zip([$(self.$field),+]).for_each(|(to, v)| *to = v);
                row
            }
        }
    )+};
}

/// Of the first parameters; there are no others.
const fn first(of: &[bool]) -> [bool; MAX_PARAMETERS] {
    let mut out = [false; MAX_PARAMETERS];
    let mut k = 0;
    while k < of.len() {
        out[k] = of[k];
        k += 1;
    }
    out
}

// The field, `true` where it must be above zero, and its meaning.
parameters! {
    /// One time constant.
    Tau { tau_s: true, "Time constant, s." }
    /// A lag with a time constant for each direction.
    BothWays {
        warming_tau_s: true, "Time constant while it warms, s.";
        cooling_tau_s: true, "Time constant while it cools, s."
    }
    /// Time constants of a bank, evenly in the logarithm.
    Taus { tau_min_s: true, "Shortest time constant, s."; tau_max_s: true, "Longest time constant, s." }
    /// Time constants that follow temperature by Arrhenius' law.
    Arrhenius {
        beta_per_c: false, "Relative change of the time constants, per C.";
        tau_max_s: true, "Longest time constant at the reference temperature, s."
    }
    /// A damped oscillation.
    Swing { period_s: true, "Period without damping, s."; damping: true, "Damping, as a share of the critical one." }
    /// A lag that may be none.
    Lag { lag_s: false, "Time constant, s; 0: none." }
    /// A play.
    Width { width_c: true, "Full width, C." }
    /// Plays of a bank, evenly in the logarithm.
    Widths { width_min_c: true, "Narrowest full width, C."; width_max_c: true, "Widest full width, C." }
    /// A play whose width changes.
    EndWidths {
        width_cold_c: true, "Full width at the lower end of the calibrated range, C.";
        width_hot_c: true, "Full width at its upper end, C."
    }
    /// A range of temperature.
    TemperatureRange { low_c: false, "Lower end, C."; high_c: false, "Upper end, C." }
    /// A temperature at which something changes.
    Breakpoint { break_c: false, "Temperature of the change, C." }
    /// A rise from one level to another.
    Rise { middle_c: false, "Middle of the rise, C."; width_c: true, "Width of the rise, C." }
    /// A band of temperature.
    Band { middle_c: false, "Its middle, C."; width_c: true, "From the middle to where a bell over it has fallen to 0.61, C." }
    /// A relay.
    Thresholds { on_c: false, "Temperature above which it is on, C."; off_c: false, "Temperature below which it is off, C." }
    /// A period of temperature.
    Cycle { period_c: true, "Period, C." }
    /// A period of time.
    Period { period_s: true, "Period, s." }
    /// A moment.
    Moment { time_s: false, "Time since power-on, s." }
    /// A stretch of time from power-on.
    Until { until_s: true, "Its end, time since power-on, s." }
    /// A rise in time.
    Onset { middle_s: true, "Its middle, time since power-on, s."; rise_s: true, "Duration of the rise, s." }
    /// A moment, and the decay after it.
    Pulse { time_s: false, "Time since power-on, s."; tau_s: true, "Time constant of the decay, s." }
    /// A ramp.
    Ramp { ramp_c_per_min: true, "Rate of change, C per minute." }
    /// A range of ramps, either way.
    RampRange { ramp_max_c_per_min: true, "Fastest rate of change, C per minute." }
    /// A recorded quantity.
    Channel { channel: false, "Its number: see the effect." }
    /// A change of slope over a recorded quantity.
    Bend {
        break_at: false, "Value at which the slope changes, less the quantity's reference.";
        channel: false, "The quantity's number."
    }
    /// A hidden layer on a recorded quantity.
    Hidden { channel: false, "The quantity's number."; seed: false, "Seed of the weights, a whole number." }
    /// A recorded quantity of the electronics.
    Source { source: false, "0 the board's temperature, 1 the supply." }
}
