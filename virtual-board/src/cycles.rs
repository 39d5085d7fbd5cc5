//! An estimate of cycles beside the exact count of instructions: the processor's pipeline, the flash's wait states behind its
//! accelerator, the peripherals' buses, exceptions.
//!
//! # Sources
//! Instruction timings: Cortex-M4 technical reference manual (ARM 100166, revision r0p1), tables 3-1 and 7-1 and section 3.3.3 (loads and
//! stores that follow each other). Flash: RM0390 sections 3.4.1 and 3.4.2 (64 lines of 128 bits for instructions, 8 for literals, least
//! recently used goes first; prefetch of the line that follows). Exceptions: 12 cycles in, 10 out.
//!
//! # What is assumed
//! - A taken branch refills the pipeline in 1 cycle where its target is in the instruction, in 2 where it comes from a register or from
//!   memory, and in one more where the target is an instruction of 32 bits that lies across a word boundary (the manual: 1 to 3).
//! - A division takes 7 cycles (the manual: 2 to 12, by its operands).
//! - An access to a peripheral waits for two clocks of its bus.
//! - A word that DMA moves costs the processor one cycle of the bus.
//! - Constants in flash that are not read relative to the program counter cost no wait state, nor does a conflict of literal and
//!   instruction at the flash's port.
//!
//! Its error is in docs/bench.md: it is compared with cycles that others have measured and published.

use crate::FLASH_START;

/// Estimated cycles, by what takes them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cycles {
    /// Instructions in the pipeline, as if memory never let them wait.
    pub pipeline: u64,
    /// Waiting for flash: instructions and literals.
    pub flash: u64,
    /// Waiting for a bus: peripherals, DMA.
    pub bus: u64,
    /// Entering exceptions and leaving them.
    pub exceptions: u64,
}

impl Cycles {
    /// All of them.
    #[must_use]
    pub fn total(self) -> u64 {
        self.pipeline + self.flash + self.bus + self.exceptions
    }
}

/// Refill of the pipeline after a branch to a place that the instruction holds, and to one from a register or from memory.
const REFILL: [u32; 2] = [1, 2];
/// A division.
const DIVISION: u32 = 7;
/// Clocks of a peripheral's bus that an access waits for.
const BUS_CLOCKS: u64 = 2;
const EXCEPTION_ENTRY: u64 = 12;
const EXCEPTION_RETURN: u64 = 10;
/// A line that was fetched ahead still costs this (found from the published cycles, docs/bench.md).
const LINE_AHEAD: u64 = 1;
/// Bytes of a line of flash.
const LINE: u32 = 16;

/// Settings of the flash accelerator (FLASH_ACR).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Accelerator {
    /// Wait states.
    pub wait_states: u32,
    /// The line that follows is fetched ahead.
    pub prefetch: bool,
    /// Lines of instructions are kept.
    pub instructions: bool,
    /// Lines of literals are kept.
    pub literals: bool,
}

impl Accelerator {
    /// From the register.
    #[must_use]
    pub fn from_acr(acr: u32) -> Self {
        Self {
            wait_states: acr & 0xF,
            prefetch: acr & 1 << 8 != 0,
            instructions: acr & 1 << 9 != 0,
            literals: acr & 1 << 10 != 0,
        }
    }
}

/// End of an instruction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flow {
    Next,
    /// May branch, to a place that it holds.
    Branch,
    /// May branch, to a place from a register or from memory.
    Indirect,
}

/// Access of a single load or store, for the one that follows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Access {
    None,
    /// A load, into this register.
    Load(u8),
    /// A store.
    Store,
}

/// One instruction.
#[derive(Debug, Clone, Copy)]
struct Instruction {
    bytes: usize,
    cycles: u32,
    flow: Flow,
    access: Access,
    /// Register that the address of a single load or store is made with.
    base: u8,
    /// Single-precision registers: result and what it is made of.
    float: Option<[u8; 3]>,
    /// Address of a literal.
    literal: Option<u32>,
}

impl Instruction {
    fn plain(bytes: usize, cycles: u32) -> Self {
        Self { bytes, cycles, flow: Flow::Next, access: Access::None, base: NONE, float: None, literal: None }
    }
    fn flow(self, flow: Flow) -> Self {
        Self { flow, ..self }
    }
    /// A single load or store: two cycles, one behind another.
    fn single(bytes: usize, access: Access, base: u8) -> Self {
        let cycles = if access == Access::Store { 1 } else { 2 };
        Self { access, base, ..Self::plain(bytes, cycles) }
    }
}

/// No register.
const NONE: u8 = 0xFF;
/// The program counter, as a register.
const PC: u8 = 15;

/// A block of code that runs from its first instruction to its last.
#[derive(Debug, Clone, Default)]
struct Block {
    bytes: u32,
    cycles: u32,
    /// Refill of the pipeline, where the block ends with a branch that is taken.
    refill: u32,
    literals: Vec<u32>,
}

impl Block {
    fn new(code: &[u8], address: u32) -> Self {
        let mut block = Self { bytes: code.len() as u32, ..Self::default() };
        let (mut at, mut before) = (0, Instruction::plain(0, 0));
        while at + 1 < code.len() {
            let i = decode(code, at, address);
            block.cycles += i.cycles;
            // Loads behind each other overlap, unless the address waits for the load before.
            if let (Access::Load(_), Access::Load(to)) = (i.access, before.access) {
                block.cycles -= u32::from(i.base != to);
            }
            if let (Some([_, a, b]), Some([to, ..])) = (i.float, before.float) {
                block.cycles += u32::from(a == to || b == to);
            }
            block.refill = match i.flow {
                Flow::Next => 0,
                Flow::Branch => REFILL[0],
                Flow::Indirect => REFILL[1],
            };
            block.literals.extend(i.literal);
            before = i;
            at += i.bytes;
        }
        block
    }
}

/// Lines of flash that are kept, the one used last first.
#[derive(Debug, Clone)]
struct Lines<const N: usize> {
    lines: Vec<u32>,
}

impl<const N: usize> Default for Lines<N> {
    fn default() -> Self {
        Self { lines: Vec::with_capacity(N + 1) }
    }
}

impl<const N: usize> Lines<N> {
    /// `true` if a line is kept; it is the one used last from now on.
    fn touch(&mut self, line: u32) -> bool {
        let at = self.lines.iter().position(|l| *l == line);
        let found = at.is_some();
        let at = at.unwrap_or_else(|| {
            self.lines.push(line);
            self.lines.len() - 1
        });
        self.lines[..=at].rotate_right(1);
        self.lines.truncate(N);
        found
    }

    fn holds(&self, line: u32) -> bool {
        self.lines.contains(&line)
    }
}

/// The estimate, as the program runs.
#[derive(Debug, Clone, Default)]
pub struct Estimate {
    cycles: Cycles,
    blocks: std::collections::HashMap<u32, std::sync::Arc<Block>>,
    /// End of the block that ran last, and the refill if the next block begins elsewhere.
    after: (u32, u32),
    line: u32,
    /// The line that is fetched ahead, and the cycle when it is there.
    ahead: Option<(u32, u64)>,
    instructions: Lines<64>,
    literals: Lines<8>,
    /// Exceptions that run, and when each was entered.
    running: Vec<(u16, u64)>,
    /// The longest that each has run for, those that came into it included.
    longest: std::collections::BTreeMap<u16, u64>,
}

impl Estimate {
    /// So far.
    #[must_use]
    pub fn cycles(&self) -> Cycles {
        self.cycles
    }

    /// A block of code runs.
    pub fn block(&mut self, address: u32, size: u32, code: &[u8], flash: Accelerator) {
        let known = self.blocks.get(&address).filter(|b| b.bytes == size).cloned();
        let block = known.unwrap_or_else(|| {
            let at = (address - FLASH_START) as usize;
            let block = std::sync::Arc::new(Block::new(&code[at..at + size as usize], address));
            self.blocks.insert(address, block.clone());
            block
        });
        let (expected, refill) = self.after;
        if address != expected && refill > 0 {
            let at = (address - FLASH_START) as usize;
            let across = address & 2 != 0 && code.get(at + 1).is_some_and(|high| *high >= WIDE);
            self.cycles.pipeline += u64::from(refill + u32::from(across));
        }
        self.after = (address + size, block.refill);
        let lines = address / LINE..=(address + size - 1) / LINE;
        for line in lines {
            self.fetch(line, flash);
            let (from, to) = ((line * LINE).max(address), ((line + 1) * LINE).min(address + size));
            // The part of the block's cycles that falls to this line, by its bytes.
            let share = |bytes: u32| u64::from(block.cycles * bytes / size);
            self.cycles.pipeline += share(to - address) - share(from - address);
        }
        for literal in &block.literals {
            let there = self.literals.touch(literal / LINE);
            if !(there && flash.literals) {
                self.cycles.flash += u64::from(flash.wait_states);
            }
        }
    }

    fn fetch(&mut self, line: u32, flash: Accelerator) {
        if line == self.line {
            return;
        }
        self.line = line;
        let now = self.cycles.total();
        let fetch = u64::from(flash.wait_states);
        let ahead = self.ahead.filter(|(l, _)| *l == line);
        let there = self.instructions.touch(line);
        if !(there && flash.instructions) {
            let wait = ahead.map_or(fetch, |(_, at)| at.saturating_sub(now).max(LINE_AHEAD).min(fetch));
            self.cycles.flash += wait;
        }
        if flash.prefetch && !(flash.instructions && self.instructions.holds(line + 1)) {
            self.ahead = Some((line + 1, self.cycles.total() + 1 + fetch));
        }
    }

    /// A peripheral is accessed; `bus_ratio`: of its bus, from the processor's clock.
    pub fn peripheral(&mut self, bus_ratio: u64) {
        self.cycles.bus += BUS_CLOCKS * bus_ratio;
    }

    /// DMA moves a word.
    pub fn dma(&mut self) {
        self.cycles.bus += 1;
    }

    /// The longest that an exception has run for, those that came into it included, in cycles. The number is that of the vector table.
    #[must_use]
    pub fn longest(&self, exception: u16) -> u64 {
        self.longest.get(&exception).copied().unwrap_or(0)
    }

    /// An exception is entered.
    pub fn enter(&mut self, exception: u16) {
        self.running.push((exception, self.cycles.total()));
        self.cycles.exceptions += EXCEPTION_ENTRY;
        self.after = (0, 0);
    }

    /// An exception is left.
    pub fn leave(&mut self) {
        self.cycles.exceptions += EXCEPTION_RETURN;
        if let Some((exception, since)) = self.running.pop() {
            let longest = self.longest.entry(exception).or_default();
            *longest = (*longest).max(self.cycles.total() - since);
        }
        self.after = (0, 0);
    }
}

/// A first half-word whose upper byte is at least that begins an instruction of 32 bits.
const WIDE: u8 = 0xE8;

fn half(code: &[u8], at: usize) -> u32 {
    u32::from(code.get(at).copied().unwrap_or(0)) | u32::from(code.get(at + 1).copied().unwrap_or(0)) << 8
}

/// The instruction at an offset of code that begins at `address`.
fn decode(code: &[u8], at: usize, address: u32) -> Instruction {
    let first = half(code, at);
    let pc = address + at as u32 + 4;
    if first >> 8 < u32::from(WIDE) {
        narrow(first, pc)
    } else {
        wide(first, half(code, at + 2), pc)
    }
}

/// The instruction of 16 bits (ARMv7-M reference manual, section A5.2).
fn narrow(i: u32, pc: u32) -> Instruction {
    let register = |shift: u32| (i >> shift & 7) as u8;
    let listed = (i & 0xFF).count_ones();
    let one = Instruction::plain(2, 1);
    match i >> 11 {
        0b01000 => match i >> 8 & 7 {
            // BX, BLX.
            0b111 => one.flow(Flow::Indirect),
            // ADD, MOV into the program counter.
            0b100 | 0b110 if i & 0x87 == 0x87 => one.flow(Flow::Indirect),
            _ => one,
        },
        0b01001 => Instruction {
            literal: Some((pc & !3) + 4 * (i & 0xFF)),
            ..Instruction::single(2, Access::Load((i >> 8 & 7) as u8), PC)
        },
        0b01010 | 0b01011 => {
            let load = i >> 9 & 7 >= 3;
            Instruction::single(2, if load { Access::Load(register(0)) } else { Access::Store }, register(3))
        }
        0b01100 | 0b01110 | 0b10000 => Instruction::single(2, Access::Store, register(3)),
        0b01101 | 0b01111 | 0b10001 => Instruction::single(2, Access::Load(register(0)), register(3)),
        0b10010 => Instruction::single(2, Access::Store, 13),
        0b10011 => Instruction::single(2, Access::Load((i >> 8 & 7) as u8), 13),
        0b10110 | 0b10111 => match i >> 8 & 0xF {
            // PUSH, POP.
            0b0100 | 0b0101 => Instruction::plain(2, 1 + listed + (i >> 8 & 1)),
            0b1100 => Instruction::plain(2, 1 + listed),
            0b1101 => Instruction::plain(2, 2 + listed).flow(Flow::Indirect),
            // CBZ, CBNZ.
            0b0001 | 0b0011 | 0b1001 | 0b1011 => one.flow(Flow::Branch),
            _ => one,
        },
        0b11000 | 0b11001 => Instruction::plain(2, 1 + listed),
        0b11010..=0b11100 => one.flow(Flow::Branch),
        _ => one,
    }
}

/// The instruction of 32 bits (ARMv7-M reference manual, section A5.3).
fn wide(first: u32, second: u32, pc: u32) -> Instruction {
    let one = Instruction::plain(4, 1);
    let to = (second >> 12) as u8;
    let base = (first & 0xF) as u8;
    match first >> 9 {
        // Several loads or stores; doubles, exclusives, tables of branches.
        0b111_0100 => several(first, second),
        0b111_0101 => one,
        0b111_0110 | 0b111_0111 => float(first, second, pc),
        0b111_1000..=0b111_1011 if second & 0x8000 == 0 => one,
        0b111_1000..=0b111_1011 => match second & 0x5000 {
            // Barriers, special registers.
            0 if first >> 6 & 0xE == 0xE => Instruction::plain(4, 2),
            _ => one.flow(Flow::Branch),
        },
        0b111_1100 if first & 0x10 == 0 => Instruction::single(4, Access::Store, base),
        // LDR into the program counter.
        0b111_1100 if to == PC && first & 0x60 == 0x40 => Instruction::plain(4, 2).flow(Flow::Indirect),
        0b111_1100 => Instruction {
            literal: (base == PC).then(|| literal(pc, first, second & 0xFFF)),
            ..Instruction::single(4, Access::Load(to), base)
        },
        // Multiplications and divisions; other data processing.
        0b111_1101 if matches!(first & 0xFFF0, 0xFB90 | 0xFBB0) => Instruction::plain(4, DIVISION),
        _ => one,
    }
}

/// Address of a literal; bit 7 of the first half-word: behind, not before.
fn literal(pc: u32, first: u32, offset: u32) -> u32 {
    let pc = pc & !3;
    if first & 0x80 == 0 {
        pc.wrapping_sub(offset)
    } else {
        pc.wrapping_add(offset)
    }
}

fn several(first: u32, second: u32) -> Instruction {
    if first & 0x40 == 0 {
        let n = second.count_ones();
        let load = first & 0x10 != 0;
        let i = Instruction::plain(4, 1 + n);
        return if load && second & 0x8000 != 0 { i.flow(Flow::Indirect) } else { i };
    }
    if first & 0xFFF0 == 0xE8D0 && second & 0xFFE0 == 0xF000 {
        // TBB, TBH.
        return Instruction::plain(4, 2).flow(Flow::Indirect);
    }
    // LDREX, STREX and their kin take two; doubles take three.
    let exclusive = first & 0x0120 == 0;
    Instruction::plain(4, if exclusive { 2 } else { 3 })
}

/// Floating point (ARMv7-M reference manual, section A6.4 to A6.7).
fn float(first: u32, second: u32, pc: u32) -> Instruction {
    if first & 0x0F00 != 0x0E00 {
        if first & 0x0FE0 == 0x0C40 {
            // Two core registers.
            return Instruction::plain(4, 2);
        }
        if first & 0x0120 != 0x0100 {
            return Instruction::plain(4, 1 + (second & 0xFF));
        }
        let constant = first & 0x1F == 0x1F;
        return Instruction {
            literal: constant.then(|| literal(pc, first, 4 * (second & 0xFF))),
            ..Instruction::plain(4, 2)
        };
    }
    if second & 0x10 != 0 {
        return Instruction::plain(4, 1);
    }
    let name = |high: u32, low: u32| (high << 1 | low) as u8;
    let d = name(second >> 12 & 0xF, first >> 6 & 1);
    let n = name(first & 0xF, second >> 7 & 1);
    let m = name(second & 0xF, second >> 5 & 1);
    let (cycles, sources) = match first >> 4 & 0xB {
        // With an accumulator.
        0b0000 | 0b0001 | 0b1001 | 0b1010 => (3, [n, m]),
        0b0010 | 0b0011 => (1, [n, m]),
        0b1000 => (14, [n, m]),
        // Square root, then what has one operand or none.
        _ if first & 0xF == 1 && second & 0xC0 == 0xC0 => (14, [m, NONE]),
        _ => (1, [if second & 0x40 == 0 { NONE } else { m }, NONE]),
    };
    Instruction { float: Some([d, sources[0], sources[1]]), ..Instruction::plain(4, cycles) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(halves: &[u16]) -> Block {
        let code: Vec<u8> = halves.iter().flat_map(|h| h.to_le_bytes()).collect();
        Block::new(&code, FLASH_START)
    }

    /// Machine code as GNU as writes it; cycles as tables 3-1 and 7-1 of the processor's manual have them.
    #[test]
    fn instructions_take_what_the_manual_says() {
        for (what, code, cycles, refill) in [
            // ldr r0,[r1]; ldr r2,[r3]; ldr r4,[r2]; str r4,[r5,#4]: the second overlaps with the first, the third waits for its address.
            ("loads", &[0x6808, 0x681A, 0x6814, 0x606C][..], 2 + 1 + 2 + 1, 0),
            // push {r4-r7,lr}; pop {r4-r7,pc}
            ("stack", &[0xB5F0, 0xBDF0], 6 + 6, 2),
            // mul; umull; smlal; udiv
            ("products", &[0xFB01, 0xF002, 0xFBA2, 0x0103, 0xFBC2, 0x0103, 0xFBB1, 0xF0F2], 3 + 7, 0),
            // ldrd; strd; ldmia r0!,{r1-r4}; stmia.w r0,{r1-r3}
            ("several", &[0xE9D2, 0x0100, 0xE9C2, 0x0102, 0xC81E, 0xE880, 0x000E], 3 + 3 + 5 + 4, 0),
            // vldr s0; vmul s1,s0,s0; vadd s2,s3,s4; vfma s5,s6,s7
            ("floats", &[0xED90, 0x0A00, 0xEE60, 0x0A00, 0xEE31, 0x1A82, 0xEEE3, 0x2A23], 2 + 1 + 1 + 3, 0),
            // vdiv; vsqrt; vpush {s16-s19}; vmov s0,r0; vmov r0,r1,s2,s3
            (
                "long floats",
                &[0xEE84, 0x4A85, 0xEEF1, 0x5AC6, 0xED2D, 0x8A04, 0xEE00, 0x0A10, 0xEC51, 0x0A11],
                14 + 14 + 5 + 1 + 2,
                0,
            ),
            // vmul s1,s0,s0; vadd s2,s0,s1: the sum waits for the product.
            ("dependent floats", &[0xEE60, 0x0A00, 0xEE30, 0x1A20], 1 + 2, 0),
            // ldrex; strex; dmb; mrs; it eq; moveq
            ("rest", &[0xE851, 0x0F00, 0xE841, 0x0200, 0xF3BF, 0x8F5F, 0xF3EF, 0x8010, 0xBF08, 0x2001], 10, 0),
            ("tbb", &[0xE8DF, 0xF000], 2, 2),
            ("bl", &[0xF7FF, 0xFFD4], 1, 1),
            ("bx lr", &[0x4770], 1, 2),
        ] {
            let b = block(code);
            assert_eq!((b.cycles, b.refill, b.bytes as usize), (cycles, refill, 2 * code.len()), "{what}");
        }
        // ldr r0,[pc,#8] from the third half-word: the word that holds the program counter, four on, and eight.
        assert_eq!(block(&[0xBF00, 0xBF00, 0xBF00, 0x4802]).literals, [FLASH_START + 8 + 8]);
    }

    /// Four lines of `nop`, run twice.
    fn lines(flash: Accelerator) -> [u64; 2] {
        let code = [0x00, 0xBF].repeat(32);
        let mut estimate = Estimate::default();
        let mut pass = || {
            let before = estimate.cycles().flash;
            for part in 0..2 {
                estimate.block(FLASH_START + 32 * part, 32, &code, flash);
            }
            estimate.cycles().flash - before
        };
        [pass(), pass()]
    }

    #[test]
    fn flash_waits_unless_a_line_is_there() {
        let all = Accelerator::from_acr(0x705);
        assert_eq!(all, Accelerator { wait_states: 5, prefetch: true, instructions: true, literals: true });
        // The first line waits; the others come while eight cycles of the line before pass, and cost one.
        assert_eq!(lines(all), [5 + 3, 0]);
        assert_eq!(lines(Accelerator { prefetch: false, ..all }), [4 * 5, 0]);
        assert_eq!(lines(Accelerator { instructions: false, ..all }), [5 + 3, 5 + 3]);
        assert_eq!(lines(Accelerator::from_acr(5)), [4 * 5, 4 * 5]);
        assert_eq!(lines(Accelerator::from_acr(0x700)), [0, 0]);
    }

    #[test]
    fn the_line_used_longest_ago_goes_first() {
        let mut lines = Lines::<2>::default();
        assert_eq!([1, 2, 1, 3, 2, 3].map(|l| lines.touch(l)), [false, false, true, false, false, true]);
    }
}
