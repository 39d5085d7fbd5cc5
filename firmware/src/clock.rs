//! The crystal: looked at before the unit relies on it, and watched afterwards.
//!
//! # Design
//! At reset the processor runs on the chip's own oscillator (HSI, 16 MHz). With that, TIM11 counts the crystal's clock (HSE) before anything else is
//! set up: its channel 1 can be connected to HSE / RTCPRE inside the chip (TIM11_OR, RM0390 section 18.5.12). A crystal that does not start, or
//! is off by more than [`TOLERANCE`], is not used: the unit then runs on HSI by the PLL and says [`UnitStatus::TIMEBASE`].
//!
//! While it runs, the clock security system raises the NMI when the crystal stops; the unit leaves word of it and stops, and the watchdog, on
//! an oscillator of its own, starts it anew, on HSI.
//!
//! # What this sees
//! A dead crystal, one of another frequency, one on an overtone. Not an error of some percent: HSI itself is off by -8 to +4.5 % over
//! -40 to 105 C (STM32F446 data sheet, table 41), so the tolerance cannot be 5 %. And LSI (17 to 47 kHz) is no measure at all. For the fine error there are pulses per second
//! ([`hrg_core::pps`]).

use crate::params::HSE_HZ;
use crate::stop::halt;
use embassy_stm32::pac;
use hrg_core::reset::Halt;

/// Share by which the crystal may be off the chip's own oscillator.
const TOLERANCE: f32 = 0.1;

/// HSI, Hz.
pub const HSI_HZ: u32 = 16_000_000;

/// Loops of a few cycles of HSI that a crystal is given to start: more than 20 ms (data sheet: 2 ms typically).
const PATIENCE: u32 = 100_000;

/// Prescaler of HSE for TIM11: 8 makes 1 MHz of 8 MHz.
const RTCPRE: u8 = 8;
/// Captures take each eighth edge (IC1PSC = 3).
const PRESCALER: u32 = 8;
/// Captures over which is counted.
const CAPTURES: u32 = 16;
/// TIM11_OR: channel 1 is HSE / RTCPRE.
const HSE_TO_CHANNEL_1: u32 = 0b10;

/// Tests if the crystal runs, and at its frequency. Call it before clocks are set up.
pub fn crystal_is_right() -> bool {
    let rcc = pac::RCC;
    rcc.cr().modify(|w| {
        w.set_hsebyp(true);
        w.set_hseon(true);
    });
    if !soon(|| rcc.cr().read().hserdy()) {
        return false;
    }
    rcc.cfgr().modify(|w| w.set_rtcpre(RTCPRE));
    rcc.apb2enr().modify(|w| w.set_tim11en(true));
    // A peripheral must not be written in the cycles after its clock was switched on (errata, "delay after an RCC peripheral clock enabling").
    let _ = rcc.apb2enr().read();
    cortex_m::asm::dsb();
    let timer = pac::TIM11;
    timer.or().write_value(HSE_TO_CHANNEL_1);
    timer.arr().write(|w| w.set_arr(u16::MAX));
    timer.ccmr_input(0).write(|w| {
        w.set_ccs(0, pac::timer::vals::CcmrInputCcs::TI4);
        w.set_icpsc(0, 3);
    });
    timer.ccer().write(|w| w.set_cce(0, true));
    timer.cr1().write(|w| w.set_cen(true));
    let counted = count();
    rcc.apb2rstr().modify(|w| w.set_tim11rst(true));
    rcc.apb2rstr().modify(|w| w.set_tim11rst(false));
    rcc.apb2enr().modify(|w| w.set_tim11en(false));
    rcc.cfgr().modify(|w| w.set_rtcpre(0));
    let expected = (CAPTURES * PRESCALER * u32::from(RTCPRE)) as f32 * (HSI_HZ as f32 / HSE_HZ as f32);
    counted.is_some_and(|counted| ((counted as f32) / expected - 1.0).abs() < TOLERANCE)
}

/// Ticks of HSI in [`CAPTURES`] captures; `None`: they do not come.
fn count() -> Option<u32> {
    let timer = pac::TIM11;
    let capture = || soon(|| timer.sr().read().ccif(0)).then(|| timer.ccr(0).read().ccr());
    let mut before = capture()?;
    let mut ticks = 0;
    for _ in 0..CAPTURES {
        let now = capture()?;
        ticks += u32::from(now.wrapping_sub(before));
        before = now;
    }
    Some(ticks)
}

/// `true` if the condition comes true within the permitted polls.
fn soon(come: impl Fn() -> bool) -> bool {
    (0..PATIENCE).any(|_| come())
}

/// The crystal is given up: HSE off, so that the set-up of the clocks does not wait for it.
pub fn give_up() {
    pac::RCC.cr().modify(|w| {
        w.set_hseon(false);
        w.set_hsebyp(false);
    });
}

/// From now on the NMI comes when the crystal stops. After clocks were set up on it.
pub fn watch() {
    pac::RCC.cr().modify(|w| w.set_csson(true));
}

/// The supply is watched: flash is not written below 2.75 V at the least ([`supplied`]). The level at which the chip resets itself is an option byte
/// (docs/hardening.md).
pub fn watch_supply() {
    pac::PWR.cr1().modify(|w| {
        // Level 5: 2.75 to 2.92 V falling, 2.86 to 2.99 V rising (data sheet, characteristics of the reset and power control block).
        w.set_pls(0b101);
        w.set_pvde(true);
    });
}

/// Waits for a supply that is still rising, 50 ms at most.
pub fn wait_for_supply() {
    let _ = (0..2_000_000).any(|_| supplied());
}

/// `true` if the supply is good enough to write flash 32 bits at a time (2.7 V at least: RM0390 section 3.4.1).
pub fn supplied() -> bool {
    !pac::PWR.csr1().read().pvdo()
}

/// The crystal has stopped: the chip has gone over to HSI, at a tenth of the speed. Nothing can be measured.
#[cortex_m_rt::exception]
#[allow(unsafe_code)] // cortex-m-rt wants it so.
unsafe fn NonMaskableInt() {
    pac::RCC.cir().modify(|w| w.set_cssc(true));
    halt(Halt::ClockLost)
}
