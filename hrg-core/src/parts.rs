//! Parts that a firmware was built with: a word in its ELF, for the tools that run the ELF or compare it with the desktop.
//!
//! # Example
//! ```
//! use hrg_core::parts::Parts;
//!
//! let built_with = Parts::from_bits_retain(0x1F);
//! assert!(built_with.contains(Parts::ALIGN | Parts::PAST));
//! ```

/// Name of the word in the ELF.
pub const SYMBOL: &str = "_built_with";

bitflags::bitflags! {
    /// Parts that a unit can do without; each is a feature of the firmware.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Parts: u32 {
        /// Self-alignment.
        const ALIGN = 1;
        /// Pulses per second in, sample mark out.
        const PPS = 1 << 1;
        /// The field log.
        const FIELD_LOG = 1 << 2;
        /// Two bias models, compared.
        const LOCKSTEP = 1 << 3;
        /// Effects with two more pasts ([`crate::history::History`]).
        const PAST = 1 << 4;
        /// Inputs beside the frequencies ([`crate::inputs`]).
        const INPUTS = 1 << 5;
        /// Inputs at channels 5 to 7 of the ADC.
        const AUX = 1 << 6;
        /// The built-in test.
        const SELF_TEST = 1 << 7;
    }
}
