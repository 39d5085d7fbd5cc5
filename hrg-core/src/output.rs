//! Output of a unit: filter, samples a frame, increments, framing. A setting that is stored: the last one in the field log holds from each start
//! on.
//!
//! # Example
//! ```
//! use hrg_core::filter::Filter;
//! use hrg_core::output::OutputSettings;
//!
//! let settings = OutputSettings { filter: Filter::Mean, decimation: 1, ..OutputSettings::default() };
//! assert_eq!(OutputSettings::from_word(settings.word()), Some(settings));
//! assert!(!OutputSettings { increments: 2000, ..settings }.possible());
//! ```

use crate::events::{Event, Record};
use crate::filter::{Filter, KEPT};
use crate::rate_path::{DECIMATION, MOST_SAMPLES};

/// Samples of a message of increments, at most: so many are kept, and one before them.
pub const MOST_INCREMENTS: u16 = 50;
const _: () = assert!((MOST_INCREMENTS as usize) < KEPT);
/// Samples in a second.
const SAMPLES_PER_S: u32 = 1000;
/// Messages of rates and increments that the link carries in a second with a third of it to spare: without room, answers to commands would never go out.
pub const MOST_MESSAGES_PER_S: u32 = 1200;

/// Framing of what goes out beside answers to commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Framing {
    /// That of [`crate::link`].
    #[default]
    Own = 0,
    /// MAVLink 2 ([`crate::mavlink`]), where the firmware has it.
    Mavlink = 1,
}

impl Framing {
    /// The framing with a number.
    #[must_use]
    pub const fn from_number(n: u8) -> Option<Self> {
        match n {
            0 => Some(Self::Own),
            1 => Some(Self::Mavlink),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Own => "own",
            Self::Mavlink => "mavlink",
        }
    }
}

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OutputSettings {
    /// From samples to frames.
    pub filter: Filter,
    /// Samples of a rate frame, 1 to 1000.
    pub decimation: u16,
    /// Samples of a message of increments, 1 to 50; 0: none are sent.
    pub increments: u16,
    /// Framing of what goes out.
    pub framing: Framing,
}

impl Default for OutputSettings {
    fn default() -> Self {
        Self { filter: Filter::LinearPhase, decimation: DECIMATION, increments: 0, framing: Framing::Own }
    }
}

impl OutputSettings {
    /// The same with so many samples in a rate frame, brought into their limits.
    #[must_use]
    pub fn with_decimation(self, decimation: u16) -> Self {
        Self { decimation: decimation.clamp(1, MOST_SAMPLES), ..self }
    }

    /// Messages of rates and increments in a second.
    #[must_use]
    pub const fn messages_per_s(&self) -> u32 {
        let rates = if self.decimation == 0 { 0 } else { SAMPLES_PER_S / self.decimation as u32 };
        let increments = if self.increments == 0 { 0 } else { SAMPLES_PER_S / self.increments as u32 };
        rates + increments
    }

    /// `true` if the numbers are within their limits, and the link carries the messages.
    #[must_use]
    pub const fn possible(&self) -> bool {
        self.decimation >= 1
            && self.decimation <= MOST_SAMPLES
            && self.increments <= MOST_INCREMENTS
            && self.messages_per_s() <= MOST_MESSAGES_PER_S
    }

    /// All of it in a word.
    #[must_use]
    pub const fn word(&self) -> u32 {
        self.decimation as u32
            | (self.increments as u32) << 12
            | (self.filter as u32) << 24
            | (self.framing as u32) << 28
    }

    /// Back from that.
    #[must_use]
    pub const fn from_word(word: u32) -> Option<Self> {
        let (Some(filter), Some(framing)) =
            (Filter::from_number((word >> 24 & 0xF) as u8), Framing::from_number((word >> 28) as u8))
        else {
            return None;
        };
        let settings =
            Self { filter, decimation: (word & 0xFFF) as u16, increments: (word >> 12 & 0xFFF) as u16, framing };
        if settings.possible() {
            Some(settings)
        } else {
            None
        }
    }
}

/// The settings that a log holds last.
pub fn newest(log: impl IntoIterator<Item = Record>) -> Option<OutputSettings> {
    let word = |record: Record| match record.event {
        Event::Output { settings } => OutputSettings::from_word(settings),
        _ => None,
    };
    log.into_iter().filter_map(word).last()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_go_through_a_word_and_what_is_impossible_is_none() {
        for decimation in [1, 5, 1000] {
            for increments in [0, 5, 50] {
                for (filter, framing) in [(Filter::Mean, Framing::Mavlink), (Filter::LinearPhase, Framing::Own)] {
                    let settings = OutputSettings { filter, decimation, increments, framing };
                    assert_eq!(OutputSettings::from_word(settings.word()), Some(settings));
                }
            }
        }
        // (Rates and increments at 1 kHz both are more than the link carries.)
        for word in [0, 1001, 51 << 12 | 5, 1 << 12 | 1, 2 << 24 | 5, 3 << 28 | 5] {
            assert_eq!(OutputSettings::from_word(word), None, "{word:#x}");
        }
    }

    #[test]
    fn the_last_setting_of_a_log_holds() {
        let of = |decimation| OutputSettings { decimation, ..OutputSettings::default() };
        let record =
            |settings: OutputSettings| Record { on_for_s: 1, event: Event::Output { settings: settings.word() } };
        let other = Record { on_for_s: 2, event: Event::Lost { count: 1 } };
        assert_eq!(newest([record(of(5)), other, record(of(7)), other]), Some(of(7)));
        assert_eq!(newest([other]), None);
    }
}
