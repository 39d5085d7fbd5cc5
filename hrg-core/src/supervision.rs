//! Feeding of the watchdog: only while every part of the unit runs.
//!
//! # Example
//! ```
//! use hrg_core::stopped::Silent;
//! use hrg_core::supervision::{Alive, Supervision};
//!
//! let mut supervision = Supervision::default();
//! let all = Alive { rates: true, model: true, link: true, telemetry: true };
//! assert!(supervision.look(all).is_empty(), "nobody is silent: the watchdog is fed");
//! assert_eq!(supervision.look(Alive { rates: false, ..all }), Silent::RATES, "it is not: the rates stand still");
//! ```

use crate::stopped::Silent;

/// Interval between checks of the parts, ms. The rate path runs each millisecond and the model each ten, so both have
/// run between two checks.
pub const LOOK_MS: u32 = 100;

/// Link and telemetry speak at least each second. After this many looks without a word they have stopped (2.5 s).
pub const QUIET_LOOKS: u8 = 25;

/// Parts that have run since the last check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alive {
    /// The rate path has taken a sample, or noticed that one is missing.
    pub rates: bool,
    /// The model has fetched edges.
    pub model: bool,
    /// The link has sent a message.
    pub link: bool,
    /// Telemetry has had a second.
    pub telemetry: bool,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub struct Supervision {
    link_quiet: u8,
    telemetry_quiet: u8,
}

impl Supervision {
    /// A look: the parts that have stopped. The watchdog is to be fed where there is none.
    pub fn look(&mut self, alive: Alive) -> Silent {
        let since = |quiet: u8, alive: bool| if alive { 0 } else { quiet.saturating_add(1) };
        self.link_quiet = since(self.link_quiet, alive.link);
        self.telemetry_quiet = since(self.telemetry_quiet, alive.telemetry);
        let mut silent = Silent::empty();
        silent.set(Silent::RATES, !alive.rates);
        silent.set(Silent::MODEL, !alive.model);
        silent.set(Silent::LINK, self.link_quiet >= QUIET_LOOKS);
        silent.set(Silent::TELEMETRY, self.telemetry_quiet >= QUIET_LOOKS);
        silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: Alive = Alive { rates: true, model: true, link: true, telemetry: true };

    #[test]
    fn rates_and_model_have_no_patience_link_and_telemetry_some() {
        let mut s = Supervision::default();
        assert!(s.look(ALL).is_empty());
        assert_eq!(s.look(Alive { rates: false, ..ALL }), Silent::RATES);
        assert_eq!(s.look(Alive { model: false, ..ALL }), Silent::MODEL);
        for (quiet, who) in
            [(Alive { link: false, ..ALL }, Silent::LINK), (Alive { telemetry: false, ..ALL }, Silent::TELEMETRY)]
        {
            for look in 1..200u8 {
                assert_eq!(s.look(quiet), if look < QUIET_LOOKS { Silent::empty() } else { who }, "{look}");
            }
            assert!(s.look(ALL).is_empty(), "one word is enough");
        }
    }
}
