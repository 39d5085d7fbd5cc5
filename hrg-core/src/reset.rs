//! Why a unit started, and what a start is told.
//!
//! # Example
//! ```
//! use hrg_core::reset::{Halt, ResetCause};
//!
//! assert_eq!(ResetCause::from_number(3), Some(ResetCause::Watchdog));
//! assert_eq!(ResetCause::Watchdog.name(), "watchdog");
//! assert_eq!(Halt::from_number(200), None);
//! ```

/// Why the processor started anew.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum ResetCause {
    /// Power came, or had been too low.
    #[default]
    Power = 0,
    /// The reset pin was low, nobody knows for how long.
    Pin = 1,
    /// A command, or the program itself.
    Software = 2,
    /// The watchdog.
    Watchdog = 3,
}

impl ResetCause {
    /// Name of each in files and on screens, in the order of their numbers.
    pub const NAMES: [&str; 4] = ["power", "pin", "software", "watchdog"];

    /// `true` if states that were kept in RAM are recent: the reset took less than a second.
    #[must_use]
    pub const fn is_brief(self) -> bool {
        matches!(self, Self::Software | Self::Watchdog)
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The cause with a number.
    #[must_use]
    pub fn from_number(n: u8) -> Option<Self> {
        [Self::Power, Self::Pin, Self::Software, Self::Watchdog].into_iter().find(|c| *c as u8 == n)
    }
}

/// Cause of the last stop: it is left in memory that a reset leaves alone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Halt {
    /// Nothing was left: power was off, or the watchdog found it hanging.
    #[default]
    None = 0,
    /// A panic.
    Panic = 1,
    /// A fault of the processor.
    Fault = 2,
    /// Memory has changed.
    Corruption = 3,
    /// The crystal has stopped.
    ClockLost = 4,
    /// The stack has left its room, which stops the processor at once.
    Stack = 5,
}

impl Halt {
    /// Name of each in files and on screens, in the order of their numbers.
    pub const NAMES: [&str; 6] = ["nothing", "panic", "fault", "corruption", "clock-lost", "stack-overflow"];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The halt with a number.
    #[must_use]
    pub fn from_number(n: u8) -> Option<Self> {
        [Self::None, Self::Panic, Self::Fault, Self::Corruption, Self::ClockLost, Self::Stack]
            .into_iter()
            .find(|h| *h as u8 == n)
    }
}
