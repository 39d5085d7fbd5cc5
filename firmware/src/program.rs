//! The program checks itself in flash: once at start, and again and again while it runs, with the chip's CRC unit.
//!
//! # Design
//! `cargo xtask build` writes the sum of the finished program into the ELF, into its section `.seal` behind the vector table. A program that was
//! flashed without it (by `cargo run`) says so in its log, and is not checked.
//!
//! The sum is that of the CRC unit: CRC-32/MPEG-2 over words (RM0390 chapter 4), of the vector table and of everything from `.text` on.

use core::ops::Range;
use embassy_stm32::crc::Crc;
use embassy_stm32::peripherals::CRC;
use embassy_stm32::Peri;

#[allow(unsafe_code)] // Symbols of the linker (memory.x, cortex-m-rt): only their addresses are used.
unsafe extern "C" {
    static __vector_table: u8;
    static _program_start: u8;
    static __sidata: u8;
    static __sdata: u8;
    static __edata: u8;
}

/// Stored sum: [`INTACT`], then the sum. Erased until the sum is written.
#[allow(unsafe_code)] // The section is memory.x's.
#[unsafe(link_section = ".seal")]
#[used]
static INTEGRITY: [u32; 2] = [u32::MAX; 2];

/// Marks the integrity word.
const INTACT: u32 = u32::from_le_bytes(*b"SEAL");

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

/// Goes through the program.
pub struct Check {
    unit: Crc<'static>,
    integrity: [u32; 2],
    /// Ranges to check: the vector table, the rest.
    table: Range<usize>,
    rest: Range<usize>,
    /// Progress of this pass.
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
    /// Reads the integrity word.
    pub fn new(unit: Peri<'static, CRC>) -> Self {
        let table = (&raw const __vector_table).addr();
        let integrity = (&raw const INTEGRITY).addr();
        let data = (&raw const __edata).addr() - (&raw const __sdata).addr();
        let end = ((&raw const __sidata).addr() + data).next_multiple_of(4);
        let rest = (&raw const _program_start).addr()..end;
        Self {
            unit: Crc::new(unit),
            integrity: [word(integrity), word(integrity + 4)],
            at: table,
            table: table..integrity,
            rest,
        }
    }

    /// The whole program at once: at start.
    pub fn whole(&mut self) -> Verdict {
        loop {
            if let Some(verdict) = self.some(usize::MAX) {
                return verdict;
            }
        }
    }

    /// The next piece of it; at the end of a pass, how it is.
    pub fn piece(&mut self) -> Option<Verdict> {
        self.some(WORDS)
    }

    fn some(&mut self, words: usize) -> Option<Verdict> {
        let [intact, sum] = self.integrity;
        if intact != INTACT {
            // An erased place was never written; anything else was.
            return Some(if self.integrity == [u32::MAX; 2] { Verdict::Unsealed } else { Verdict::Changed });
        }
        let in_table = self.at < self.table.end;
        let end = if in_table { self.table.end } else { self.rest.end };
        let stop = end.min(self.at.saturating_add(words.saturating_mul(4)));
        while self.at < stop {
            self.unit.feed_word(word(self.at));
            self.at += 4;
        }
        if self.at < end {
            return None;
        }
        if in_table {
            self.at = self.rest.start;
            return None;
        }
        let found = self.unit.read();
        self.unit.reset();
        self.at = self.table.start;
        Some(if found == sum { Verdict::Intact } else { Verdict::Changed })
    }
}
