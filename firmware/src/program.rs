//! The program checks itself in flash: once at start, and again and again while it runs, with the chip's CRC unit. So does it check the loader.
//!
//! # Design
//! `cargo xtask build` writes the sum of the finished program into the marks of its slot ([`hrg_core::slots`]); an update brings it along. A program
//! that was flashed without it (by `cargo run`) says so in its log, and is not checked. The sum is that of the CRC unit: CRC-32/MPEG-2 over words (RM0390 chapter 4).
//! That of the loader stands in two reserved places of its vector table, and counts as zero there.

use crate::maintain::slots;
use core::ops::Range;
use embassy_stm32::crc::Crc;
use embassy_stm32::peripherals::CRC;
use embassy_stm32::Peri;
use hrg_core::slots::{mark, Slot, ERASED, HEAD, LOADER_LENGTH, LOADER_SUM};

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _loader_start: u8;
}

/// Bytes of the loader at most: a sector.
const LOADER_ROOM: usize = 16 * 1024;

/// Words that are checked at a time: each [`hrg_core::supervision::LOOK_MS`].
const WORDS: usize = 256;

/// State of the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// As it was built.
    Intact,
    /// Its sum was never written.
    Unsealed,
    /// It has changed.
    Changed,
}

/// A piece of flash with its sum.
struct Part {
    range: Range<usize>,
    sum: u32,
    /// Address of a word that counts as zero; 0: none.
    left_out: usize,
}

/// Goes through the program.
pub struct Check {
    unit: Crc<'static>,
    /// The program, and the loader.
    parts: [Part; 2],
    /// The part and the address that this pass has come to.
    part: usize,
    at: usize,
}

/// A word of flash.
fn word(address: usize) -> u32 {
    // SAFETY: only called within the ranges of the program, by whole words; volatile, for what matters is what stands there now.
    #[allow(unsafe_code)]
    unsafe {
        core::ptr::with_exposed_provenance::<u32>(address).read_volatile()
    }
}

impl Check {
    /// Reads the sums.
    pub fn new(unit: Peri<'static, CRC>) -> Self {
        let (own, all) = slots();
        let slot = all.get(own).copied().unwrap_or(Slot(&[]));
        let start = slot.0.as_ptr().addr() + HEAD;
        let program = start..start + slot.body().map_or(0, <[u8]>::len);
        let loader = (&raw const _loader_start).addr();
        let length = (word(loader + LOADER_LENGTH) as usize).min(LOADER_ROOM) & !3;
        let parts = [
            Part { range: program, sum: slot.word(mark::SUM), left_out: 0 },
            Part { range: loader..loader + length, sum: word(loader + LOADER_SUM), left_out: loader + LOADER_SUM },
        ];
        Self { unit: Crc::new(unit), part: 0, at: parts[0].range.start, parts }
    }

    /// The whole program at once: at start.
    pub fn whole(&mut self) -> Verdict {
        loop {
            if let Some(verdict) = self.some(usize::MAX) {
                return verdict;
            }
        }
    }

    /// The next piece of it; at the end of a pass, or where a part has changed, how it is.
    pub fn piece(&mut self) -> Option<Verdict> {
        self.some(WORDS)
    }

    fn some(&mut self, words: usize) -> Option<Verdict> {
        let [program, _] = &self.parts;
        if program.sum == ERASED {
            // An erased place was never written.
            return Some(Verdict::Unsealed);
        }
        let Part { range, sum, left_out } = self.parts.get(self.part)?;
        // (The marks are in no sum.)
        let (own, all) = slots();
        if self.part == 0 && self.at == range.start && !all.get(own).is_some_and(Slot::marks_sound) {
            return Some(Verdict::Changed);
        }
        let stop = range.end.min(self.at.saturating_add(words.saturating_mul(4)));
        while self.at < stop {
            self.unit.feed_word(if self.at == *left_out { 0 } else { word(self.at) });
            self.at += 4;
        }
        if self.at < range.end {
            return None;
        }
        let same = self.unit.read() == *sum;
        self.unit.reset();
        let last = self.part + 1 == self.parts.len();
        self.part = if last || !same { 0 } else { self.part + 1 };
        self.at = self.parts.get(self.part)?.range.start;
        match (same, last) {
            (false, _) => Some(Verdict::Changed),
            (true, true) => Some(Verdict::Intact),
            (true, false) => None,
        }
    }
}
