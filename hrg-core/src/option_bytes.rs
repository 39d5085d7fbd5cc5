//! Option bytes of the unit's processor (STM32F4), as `FLASH_OPTCR` shows them, against those with which a unit flies (docs/hardening.md).
//!
//! # Example
//! ```
//! use hrg_core::option_bytes::{differences, Difference, FLYING, SHIPPED};
//!
//! assert_eq!(differences(FLYING), Difference::empty());
//! assert_eq!(differences(SHIPPED), Difference::all());
//! // Protected for ever (RDP level 2) is protected, too.
//! assert_eq!(differences(FLYING & !0xFF00 | 0xCC00), Difference::empty());
//! ```

/// As a chip is shipped.
pub const SHIPPED: u32 = 0x0FFF_AAED;

/// As a unit flies.
pub const FLYING: u32 = 0x0FFE_55C1;

bitflags::bitflags! {
    /// Protections of a unit that its option bytes do not switch on.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct Difference: u8 {
        /// No reset below 2.7 V (BOR_LEV).
        const BROWN_OUT = 1;
        /// The debug port reads the flash (RDP level 0).
        const READ_OUT = 1 << 1;
        /// The watchdog waits for the program to start it (WDG_SW).
        const WATCHDOG = 1 << 2;
        /// The loader's sector may be written (nWRP).
        const WRITE_PROTECTION = 1 << 3;
    }
}

impl Difference {
    /// Each in words, in the order of the bits.
    pub const NAMES: [&str; 4] = [
        "no reset below 2.7 V (BOR_LEV)",
        "the debug port reads the flash (RDP)",
        "the watchdog waits for the program (WDG_SW)",
        "the loader's sector may be written (nWRP)",
    ];

    /// In words.
    pub fn in_words(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.into_iter().zip(Self::all()).filter(move |(_, bit)| self.contains(*bit)).map(|(name, _)| name)
    }
}

/// Level 0 of RDP, which protects nothing.
const OPEN: u32 = 0xAA;

/// The protections that are off.
#[must_use]
pub const fn differences(optcr: u32) -> Difference {
    let mut out = Difference::empty();
    if optcr & 0b1100 != FLYING & 0b1100 {
        out = out.union(Difference::BROWN_OUT);
    }
    if optcr >> 8 & 0xFF == OPEN {
        out = out.union(Difference::READ_OUT);
    }
    if optcr & 1 << 5 != 0 {
        out = out.union(Difference::WATCHDOG);
    }
    // (A zero protects.)
    if optcr & !FLYING & 0xFF_0000 != 0 {
        out = out.union(Difference::WRITE_PROTECTION);
    }
    out
}
