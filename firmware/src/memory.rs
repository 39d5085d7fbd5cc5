//! Test of the RAM at the start: each bit takes both values, and no address line is open or tied.
//!
//! # Design
//! It runs before anything else writes memory beside the processor (DMA), with interrupts off, and leaves each word as it was: states are
//! kept over resets. A pair of words is saved in registers, tested and put back within one piece of assembly, so that nothing that the
//! compiler keeps in memory, the stack under test included, is read meanwhile. At 180 MHz all of it takes 4 ms.

use core::arch::asm;

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _ram_start: u8;
    static _ram_end: u8;
}

/// A word's pattern; its neighbour has the inverse, and then the two change places.
const PATTERN: u32 = 0x5555_5555;

/// Bits of two words that do not hold what is written to them.
fn pair(a: usize, b: usize) -> u32 {
    let mut bad = 0u32;
    for pattern in [PATTERN, !PATTERN] {
        // SAFETY: both are words of RAM (the callers' ranges); each is back as it was before anything else runs: interrupts are off, and no DMA
        // stream is on yet.
        #[allow(unsafe_code)]
        unsafe {
            asm!(
                "ldr {old_a}, [{a}]",
                "ldr {old_b}, [{b}]",
                "str {pattern}, [{a}]",
                "mvn {seen}, {pattern}",
                "str {seen}, [{b}]",
                "ldr {seen}, [{a}]",
                "eor {seen}, {seen}, {pattern}",
                "orr {bad}, {bad}, {seen}",
                "ldr {seen}, [{b}]",
                "mvn {seen}, {seen}",
                "eor {seen}, {seen}, {pattern}",
                "orr {bad}, {bad}, {seen}",
                "str {old_b}, [{b}]",
                "str {old_a}, [{a}]",
                a = in(reg) a,
                b = in(reg) b,
                pattern = in(reg) pattern,
                old_a = out(reg) _,
                old_b = out(reg) _,
                seen = out(reg) _,
                bad = inout(reg) bad,
                options(nostack, preserves_flags),
            );
        }
    }
    bad
}

/// Bits of all words that do not hold what is written to them; 0: the memory is good. Bits of the same place in a word count once.
pub fn bad_bits() -> u32 {
    let (start, end) = ((&raw const _ram_start).addr(), (&raw const _ram_end).addr());
    cortex_m::interrupt::free(|_| {
        let words = (start..end).step_by(8).fold(0, |bad, at| bad | pair(at, at + 4));
        // Addresses that differ in one line, and in two.
        let line = |n: u32| Some(start + (1 << n)).filter(|at| *at < end);
        let lines = || (2..usize::BITS).map_while(line);
        let one = lines().fold(words, |bad, at| bad | pair(start, at));
        let tied =
            lines().enumerate().fold(one, |bad, (k, a)| lines().skip(k + 1).fold(bad, |bad, b| bad | pair(a, b)));
        tied.count_ones()
    })
}
