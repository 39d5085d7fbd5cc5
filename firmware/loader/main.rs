//! The loader, in sector 0: chooses the slot whose program is started. The rules are in `hrg_core::slots`, whose file it is compiled with.
//!
//! # Design
//! It is flashed once and never written again, so it is small and uses nothing else: no variables, no crate, no clock but the one of the reset (HSI,
//! 16 MHz). It checks sums by the chip's CRC unit, and no signatures: those the program in the other slot has checked before it committed. The only thing
//! that it writes is the mark that a program is tried, byte by byte, which any supply can do; a program whose mark cannot be written is not tried.
//!
//! It starts the watchdog, at half a second as it is after a reset, so a program that does nothing at all is reset, too, and found tried.
//!
//! firmware/build.rs compiles it and puts it into the firmware's ELF. Its length and its sum stand in two reserved places of its vector table: the program
//! that runs checks it, too.
#![no_std]
#![no_main]
#![allow(unsafe_code)] // Registers and flash are addresses here.

#[path = "../../hrg-core/src/slots.rs"]
#[allow(dead_code)] // What only the program asks.
mod slots;

use core::arch::{asm, naked_asm};
use core::ptr::{read_volatile, with_exposed_provenance, with_exposed_provenance_mut, write_volatile};
use slots::{chosen, mark, order, Choice, Slot, ERASED, TABLE};

/// Registers of RM0390: RCC_AHB1ENR (6.3.10), RCC_CSR (6.3.21), CRC_DR and CRC_CR (4.4), FLASH_KEYR, FLASH_SR and FLASH_CR (3.8), IWDG_KR (20.4), and the
/// processor's VTOR (PM0214 section 4.4.4).
mod register {
    pub const RCC_AHB1ENR: usize = 0x4002_3830;
    pub const RCC_CSR: usize = 0x4002_3874;
    pub const CRC_DR: usize = 0x4002_3000;
    pub const CRC_CR: usize = 0x4002_3008;
    pub const FLASH_KEYR: usize = 0x4002_3C04;
    pub const FLASH_SR: usize = 0x4002_3C0C;
    pub const FLASH_CR: usize = 0x4002_3C10;
    pub const IWDG_KR: usize = 0x4000_3000;
    pub const VTOR: usize = 0xE000_ED08;
}

/// RCC_AHB1ENR: clock of the CRC unit.
const CRC_ON: u32 = 1 << 12;
/// RCC_CSR: the reset was one by software. (The program clears the flags at each start.)
const BY_SOFTWARE: u32 = 1 << 28;
/// FLASH_SR: busy. FLASH_CR: program (PSIZE 0: bytes), lock.
const BUSY: u32 = 1 << 16;
const PROGRAM: u32 = 1;
const LOCK: u32 = 1 << 31;
/// Polls of the flash after which a mark counts as not written: a byte takes 100 us at most (STM32F446 data sheet, table 47), some 300 polls at 16 MHz.
const POLLS: u32 = 20_000;
/// IWDG_KR: start. With the prescaler and the reload value of a reset 4096 * 4 / 32 kHz = 0.5 s, until the program sets its own time.
const START: u32 = 0xCCCC;

// Symbols of memory.x: only their addresses are used.
unsafe extern "C" {
    static _loader_stack: u8;
    static _slot_a_start: u8;
    static _slot_a_end: u8;
    static _slot_b_start: u8;
    static _slot_b_end: u8;
}

/// A vector: the stack's top, an address of code, or a number.
union Vector {
    stack: *const u8,
    code: unsafe extern "C" fn() -> !,
    number: u32,
}
// SAFETY: constants.
unsafe impl Sync for Vector {}

const STUCK: Vector = Vector { code: stuck };
const NONE: Vector = Vector { number: 0 };

/// Stack, reset, and the faults. firmware/build.rs puts length and sum into places 7 and 8, which are reserved.
#[unsafe(link_section = ".vectors")]
#[used]
static VECTORS: [Vector; 16] = [
    Vector { stack: &raw const _loader_stack },
    Vector { code: reset },
    STUCK,
    STUCK,
    STUCK,
    STUCK,
    STUCK,
    NONE,
    NONE,
    NONE,
    NONE,
    STUCK,
    STUCK,
    NONE,
    STUCK,
    STUCK,
];

/// A fault, which nothing here can have: the watchdog ends it.
#[unsafe(naked)]
unsafe extern "C" fn stuck() -> ! {
    naked_asm!("b .")
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        core::hint::spin_loop();
    }
}

fn read(address: usize) -> u32 {
    // SAFETY: a register, or a word of flash.
    unsafe { read_volatile(with_exposed_provenance(address)) }
}

fn write(address: usize, value: u32) {
    // SAFETY: a register that nobody else uses now.
    unsafe { write_volatile(with_exposed_provenance_mut(address), value) }
}

/// The two slots.
fn all() -> [Slot<'static>; 2] {
    let range = |start: *const u8, end: *const u8| {
        // SAFETY: a slot in flash (memory.x). The one byte that is written there (`tried`) is read back by itself.
        Slot(unsafe { core::slice::from_raw_parts(start, end.addr() - start.addr()) })
    };
    [range(&raw const _slot_a_start, &raw const _slot_a_end), range(&raw const _slot_b_start, &raw const _slot_b_end)]
}

/// `true` if a program is as it was built. (One that was flashed without its sum cannot be checked.)
fn intact(slot: &Slot<'_>) -> bool {
    let Some(body) = slot.body() else { return false };
    let expected = slot.word(mark::SUM);
    if expected == ERASED {
        return true;
    }
    let enabled = read(register::RCC_AHB1ENR);
    write(register::RCC_AHB1ENR, enabled | CRC_ON);
    // A peripheral must not be written in the cycles after its clock was switched on (errata ES0298).
    read(register::RCC_AHB1ENR);
    write(register::CRC_CR, 1);
    for word in body.chunks_exact(4) {
        if let [a, b, c, d] = *word {
            write(register::CRC_DR, u32::from_le_bytes([a, b, c, d]));
        }
    }
    let sum = read(register::CRC_DR);
    write(register::CRC_CR, 1);
    write(register::RCC_AHB1ENR, enabled);
    sum == expected
}

/// Marks a program as tried; `false`: the mark could not be written.
fn tried(slot: &Slot<'_>) -> bool {
    let at = slot.0.as_ptr().expose_provenance() + mark::TRIED;
    let idle = || (0..POLLS).any(|_| read(register::FLASH_SR) & BUSY == 0);
    write(register::FLASH_KEYR, 0x4567_0123);
    write(register::FLASH_KEYR, 0xCDEF_89AB);
    // The sequence of RM0390 section 3.6.3: no operation under way, PG, the byte, its end.
    if !idle() {
        return false;
    }
    write(register::FLASH_CR, PROGRAM);
    // SAFETY: a byte of a slot that nobody runs from.
    unsafe { write_volatile(with_exposed_provenance_mut::<u8>(at), 0) };
    let done = idle();
    write(register::FLASH_CR, LOCK);
    done && read(at) != ERASED
}

/// Starts a program: never comes back.
fn start(slot: &Slot<'_>) -> ! {
    let table = slot.0.as_ptr().expose_provenance() + TABLE;
    write(register::VTOR, table as u32);
    // SAFETY: the program's own stack and its reset, as the processor takes them at a reset.
    unsafe {
        asm!("dsb", "isb", "msr msp, {stack}", "bx {reset}", stack = in(reg) read(table), reset = in(reg) read(table + 4), options(noreturn, nostack))
    }
}

unsafe extern "C" fn reset() -> ! {
    write(register::IWDG_KR, START);
    let slots = all();
    let fit = |Choice { slot, trial, .. }: Choice| slots.get(slot).is_some_and(|s| intact(s) && (!trial || tried(s)));
    if let Some(slot) =
        chosen(order(slots, read(register::RCC_CSR) & BY_SOFTWARE != 0), fit).and_then(|slot| slots.get(slot))
    {
        start(slot);
    }
    // SAFETY: it does not come back.
    unsafe { stuck() }
}
