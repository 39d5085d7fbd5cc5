//! The kept states in the backup SRAM, which a battery at VBAT carries over a power cut (feature `battery`).
//!
//! # Design
//! States are of use only while they are recent, so the unit must know how long it was off: by the RTC, which the battery carries as well,
//! on a crystal of 32768 Hz (LSE). Each second the states are written behind the RTC's time. After a power-on the unit goes on from
//! them if no more than [`RECENT_S`] have passed: for that long a lost frequency is bridged, too. Else, or without a crystal, or with an empty
//! battery, the past is unknown, as it is in a unit without a battery.
//!
//! A power cut within the millisecond in which they are written loses them. A power cut over midnight of the RTC, which nobody sets, does as well.

use crate::redundant::Compensator;
use core::ptr::with_exposed_provenance_mut;
use embassy_stm32::pac::rcc::vals::Rtcsel;
use embassy_stm32::pac::{PWR, RCC, RTC};
use hrg_core::history::{Kept, KEPT_WORDS};
use hrg_core::reset::ResetCause;

/// States older than this are not gone on from, s: by then a lag of 15 minutes in the fastest ramp is off by 0.04 deg/h for 0.1 deg/h per C.
const RECENT_S: u32 = 5;

/// Start of the backup SRAM (RM0390 table 1), and its words.
const START: usize = 0x4002_4000;
const WORDS: usize = 1024;
/// Index of the RTC's time and date: behind the states.
const TIME: usize = KEPT_WORDS;
const DATE: usize = KEPT_WORDS + 1;
const _: () = assert!(DATE < WORDS);

fn word(k: usize) -> *mut u32 {
    with_exposed_provenance_mut(START + 4 * k.min(WORDS - 1))
}

fn read(k: usize) -> u32 {
    // SAFETY: within the backup SRAM, aligned; nobody else uses it.
    #[allow(unsafe_code)]
    unsafe {
        word(k).read_volatile()
    }
}

fn write(k: usize, value: u32) {
    // SAFETY: as above.
    #[allow(unsafe_code)]
    unsafe {
        word(k).write_volatile(value);
    }
}

/// Has the RTC run on its crystal, which may take seconds to start: nobody waits for it, and until then there is no time. Before clocks are set up,
/// which resets a backup domain that is set up otherwise.
pub fn clock() {
    RCC.apb1enr().modify(|w| w.set_pwren(true));
    // (See `clock.rs` on writing what was just given its clock.)
    let _ = RCC.apb1enr().read();
    cortex_m::asm::dsb();
    PWR.cr1().modify(|w| w.set_dbp(true));
    let _ = PWR.cr1().read();
    let domain = RCC.bdcr();
    let now = domain.read();
    if now.lseon() && now.rtcen() && now.rtcsel() == Rtcsel::LSE {
        return;
    }
    domain.write(|w| w.set_bdrst(true));
    domain.write(|w| w.set_bdrst(false));
    domain.modify(|w| w.set_lseon(true));
    domain.modify(|w| {
        w.set_rtcsel(Rtcsel::LSE);
        w.set_rtcen(true);
    });
}

/// Has the battery carry the memory. After clocks were set up.
pub fn start() {
    RCC.ahb1enr().modify(|w| w.set_bkpsramen(true));
    PWR.csr1().modify(|w| w.set_bre(true));
}

/// Time and date of the RTC, as they stand in its registers; `None`: it does not run.
fn time() -> Option<(u32, u32)> {
    // After a reset the registers follow the RTC within two of its cycles (RM0390 section 22.3.6).
    (RCC.bdcr().read().lserdy() && (0..3000).any(|_| RTC.isr().read().rsf()))
        .then(|| (RTC.tr().read().0, RTC.dr().read().0))
}

/// Seconds of the day of a time in the RTC's form (BCD).
fn seconds(time: u32) -> u32 {
    let two = |at: u32, tens: u32| (time >> (at + 4) & tens) * 10 + (time >> at & 0xF);
    two(16, 3) * 3600 + two(8, 7) * 60 + two(0, 7)
}

/// States kept before a power cut; `None`: nothing intact, or nothing recent.
pub fn newest(cause: ResetCause) -> Option<Kept<impl Fn(usize) -> u32 + Copy>> {
    let (now, today) = time()?;
    let (then, date) = (read(TIME), read(DATE));
    let recent = date == today && seconds(now).checked_sub(seconds(then)).is_some_and(|s| s <= RECENT_S);
    // (The states of one power cut serve one start.)
    write(DATE, 0);
    (recent && matches!(cause, ResetCause::Power | ResetCause::Pin)).then(|| Kept::of(read)).flatten()
}

/// Keeps the states of a model after a step.
pub fn keep(model: &mut Compensator) {
    let Some((time, date)) = time() else { return };
    write(DATE, 0);
    model.keep(write);
    write(TIME, time);
    write(DATE, date);
}
