//! Post-mortem: what a unit that stops leaves in memory for its next start, and how it travels from there.
//!
//! A stop leaves a [`Stopped`] in RAM that a reset leaves alone, as [`Stopped::to_words`] has it. The next start reads it, writes it to the field
//! log in pieces ([`Stopped::pieces`], an [`Event::Stopped`](crate::events::Event::Stopped) each, behind its start), and sends it as a message of the
//! link after each identity.
//!
//! # Example
//! ```
//! use hrg_core::reset::Halt;
//! use hrg_core::stopped::Stopped;
//!
//! let stopped = Stopped { halt: Halt::Panic, line: 77, ..Stopped::default() }.in_file("firmware/src/model.rs");
//! let mut words = stopped.to_words();
//! assert_eq!(Stopped::from_words(&words), Some(stopped));
//! // The field log has it in pieces, and they make the same.
//! let mut again = Stopped { halt: Halt::Panic, ..Stopped::default() };
//! stopped.pieces().for_each(|p| again.add(p));
//! assert_eq!(again, stopped);
//! // Memory that holds anything holds none.
//! words[3] ^= 1;
//! assert_eq!(Stopped::from_words(&words), None);
//! ```

use crate::bytes::{crc32, Reader, Writer};
use crate::reset::Halt;
use crate::schema::{layout, size, take, Layout};

bitflags::bitflags! {
    /// Parts of a unit that had gone silent when the watchdog was no longer fed.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
    pub struct Silent: u8 {
        /// The rate path.
        const RATES = 1;
        /// The model.
        const MODEL = 1 << 1;
        /// Link out.
        const LINK = 1 << 2;
        /// Telemetry.
        const TELEMETRY = 1 << 3;
        /// The watchdog's own task, and with it all that runs in threads.
        const THREADS = 1 << 4;
    }
}

impl Silent {
    /// Names of the parts, in the order of their bits.
    pub const NAMES: [&str; 5] = ["rates", "model", "link", "telemetry", "threads"];
}

/// Bytes of a file's name that are kept: the last ones.
pub const FILE: usize = 24;

/// Word of a stop: where and why. Zeros where a stop of its kind has none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stopped {
    /// Why.
    pub halt: Halt,
    /// Parts that had gone silent.
    pub silent: Silent,
    /// Line of a panic.
    pub line: u16,
    /// Stack that was used at the worst, bytes.
    pub stack: u32,
    /// Instruction at which it stopped, or hung.
    pub pc: u32,
    /// Link register there: who had called.
    pub lr: u32,
    /// Kinds of the fault: the processor's CFSR.
    pub cfsr: u32,
    /// The processor's HFSR.
    pub hfsr: u32,
    /// Address whose access failed; 0: it is not known.
    pub address: u32,
    /// File of a panic: the end of its path, with zeros behind it.
    pub file: [u8; FILE],
}
layout! { Stopped {
    halt: Halt, "why: 0 nothing was left, 1 panic, 2 fault, 3 corruption, 4 clock lost, 5 stack overflow";
    silent: Silent, "parts that had gone silent: bit 0 rates, 1 model, 2 link, 3 telemetry, 4 threads";
    line: u16, "line of a panic";
    stack: u32, "stack used at the worst, bytes";
    pc: u32, "instruction at which it stopped, or hung";
    lr: u32, "link register there";
    cfsr: u32, "kinds of the fault (CFSR)";
    hfsr: u32, "the same, hard (HFSR)";
    address: u32, "address whose access failed; 0: not known";
    file: [u8; FILE], "file of a panic, the end of its path, zeros behind it";
} }

/// Words in which memory keeps a stop; the last is a checksum.
pub const WORDS: usize = size(Stopped::FIELDS) / 4 + 1;
const _: () = assert!(size(Stopped::FIELDS).is_multiple_of(4));

/// A piece of a stop, as a record of the field log holds it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Piece {
    /// Number of the word of the stop, from 0.
    pub number: u8,
    /// The word.
    pub value: u32,
}

impl Stopped {
    /// With the file of a panic.
    #[must_use]
    pub fn in_file(mut self, path: &str) -> Self {
        let end = path.len().saturating_sub(FILE);
        let kept = path.as_bytes().get(end..).unwrap_or_default();
        self.file.iter_mut().zip(kept).for_each(|(to, from)| *to = *from);
        self
    }

    /// The file of a panic as text.
    #[must_use]
    pub fn file(&self) -> &str {
        let end = self.file.iter().position(|b| *b == 0).unwrap_or(FILE);
        let bytes = self.file.get(..end).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or("?")
    }

    /// `true` if there is something to say.
    #[must_use]
    pub fn says_something(&self) -> bool {
        self.halt != Halt::None || !self.silent.is_empty()
    }

    /// As memory keeps it.
    #[must_use]
    pub fn to_words(&self) -> [u32; WORDS] {
        let mut bytes = [0; 4 * WORDS];
        let mut w = Writer::new(&mut bytes);
        self.put_fields(&mut w);
        let sum = crc32(bytes.get(..4 * (WORDS - 1)).unwrap_or_default());
        let mut words = [0; WORDS];
        for (word, b) in words.iter_mut().zip(bytes.as_chunks().0) {
            *word = u32::from_le_bytes(*b);
        }
        words[WORDS - 1] = sum;
        words
    }

    /// `None`: memory holds none.
    #[must_use]
    pub fn from_words(words: &[u32; WORDS]) -> Option<Self> {
        let bytes = bytes_of(words);
        let fields = bytes.get(..4 * (WORDS - 1))?;
        if crc32(fields) != words[WORDS - 1] {
            return None;
        }
        take(&mut Reader::new(fields))
    }

    /// Pieces for the field log: those that are not zero, but for the first word's reason, which the start's record has.
    pub fn pieces(&self) -> impl Iterator<Item = Piece> + use<> {
        let words = self.to_words();
        let pieces = (0..WORDS as u8 - 1).zip(words).map(|(number, value)| Piece { number, value });
        pieces.filter(|p| if p.number == 0 { p.value > 0xFF } else { p.value != 0 })
    }

    /// Takes a piece of the field log.
    pub fn add(&mut self, piece: Piece) {
        let mut words = self.to_words();
        if let Some(word) = words[..WORDS - 1].get_mut(usize::from(piece.number)) {
            *word = piece.value;
        }
        if let Some(with) = take(&mut Reader::new(&bytes_of(&words)[..4 * (WORDS - 1)])) {
            *self = with;
        }
    }
}

/// Words as the bytes that they are made of.
fn bytes_of(words: &[u32; WORDS]) -> [u8; 4 * WORDS] {
    let mut bytes = [0; 4 * WORDS];
    for (b, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
        *b = word.to_le_bytes();
    }
    bytes
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    fn fault() -> Stopped {
        Stopped {
            halt: Halt::Fault,
            silent: Silent::empty(),
            stack: 43_816,
            pc: 0x0801_2344,
            lr: 0x0801_0001,
            cfsr: 0x8200,
            hfsr: 0x4000_0000,
            address: 0xE000_0000,
            ..Stopped::default()
        }
    }

    #[test]
    fn words_and_pieces_lead_back() {
        let panic = Stopped { halt: Halt::Panic, line: 300, stack: 1, ..Stopped::default() };
        let silent = Stopped { silent: Silent::MODEL | Silent::LINK, stack: 7, ..Stopped::default() };
        for s in [fault(), panic.in_file("a/very/long/path/that/does/not/fit/at/all.rs"), silent] {
            let words = s.to_words();
            assert_eq!(Stopped::from_words(&words), Some(s));
            for k in 0..WORDS {
                for bit in 0..32 {
                    let mut bad = words;
                    bad[k] ^= 1 << bit;
                    assert_eq!(Stopped::from_words(&bad), None);
                }
            }
            let pieces: Vec<Piece> = s.pieces().collect();
            assert!(pieces.len() <= 8, "{pieces:?}");
            let mut again = Stopped { halt: s.halt, ..Stopped::default() };
            pieces.into_iter().for_each(|p| again.add(p));
            assert_eq!(again, s);
        }
        assert_eq!(Stopped::default().pieces().count(), 0);
        assert_eq!(Stopped { halt: Halt::Corruption, ..Stopped::default() }.pieces().count(), 0);
        assert!(!Stopped { stack: 5, ..Stopped::default() }.says_something());
    }

    #[test]
    fn the_end_of_a_path_is_kept() {
        assert_eq!(Stopped::default().in_file("hrg-core/src/link/codec.rs").file(), "g-core/src/link/codec.rs");
        assert_eq!(Stopped::default().in_file("x.rs").file(), "x.rs");
        assert_eq!(Stopped::default().file(), "");
    }

    #[test]
    fn a_foreign_piece_changes_nothing() {
        let mut s = fault();
        s.add(Piece { number: WORDS as u8, value: 1 });
        s.add(Piece { number: WORDS as u8 - 1, value: 1 });
        // A reason that there is not.
        s.add(Piece { number: 0, value: 0xFF });
        assert_eq!(s, fault());
    }
}
