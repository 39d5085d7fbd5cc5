//! Pulses per second in (TIM3, channel 1), and the sample mark out.
//!
//! # Design
//! All four channels of TIM2 are taken. TIM3 counts the same clock with 16 bits, and TIM2's start starts it (trigger mode, RM0390 section
//! 17.3.15), so each capture of TIM3 is the low half of a tick of TIM2. The interrupt must come within 65536 ticks (0.7 ms) of its pulse; a
//! pulse that comes while flash is erased gets a wrong tick, which [`hrg_core::pps`] drops.
//!
//! The mark rises at the data-ready edge of each sample with which a rate frame ends, and falls at the next data-ready edge. It comes
//! as late as the interrupt does (some 0.1 us); the frame's own tick is exact.

use embassy_stm32::gpio::{Flex, Output};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, Sms, Ts};
use embassy_stm32::peripherals::TIM3;
use embassy_stm32::{rcc, Peri};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;

/// A pulse came: the tick of TIM2.
pub static PULSE: Signal<CriticalSectionRawMutex, u32> = Signal::new();

/// Sets TIM3 up to start with TIM2: before that one starts. `pin`: set up as its channel 1.
pub fn prepare(timer: Peri<'static, TIM3>, pin: Flex<'static>) {
    rcc::enable_and_reset::<TIM3>();
    let t = pac::TIM3;
    t.arr().write(|w| w.set_arr(u16::MAX));
    t.ccmr_input(0).write(|w| w.set_ccs(0, CcmrInputCcs::TI4));
    t.ccer().write(|w| w.set_cce(0, true));
    t.dier().write(|w| w.set_ccie(0, true));
    // Internal trigger 1 is TIM2 (RM0390 table 100).
    t.smcr().write(|w| {
        w.set_ts(Ts::ITR1);
        w.set_sms(Sms::TRIGGER_MODE);
    });
    interrupt::TIM3.unpend();
    // SAFETY: what the handler touches was set up.
    #[allow(unsafe_code)]
    unsafe {
        interrupt::TIM3.enable();
    }
    // Held for ever: a pin that is dropped is an input no more.
    core::mem::forget((timer, pin));
}

/// The interrupt of TIM3.
pub fn captured() {
    let t = pac::TIM3;
    // (Reading it clears the interrupt's flag.)
    let capture = u32::from(t.ccr(0).read().ccr());
    let now = pac::TIM2.cnt().read();
    let age = now.wrapping_sub(capture) & 0xFFFF;
    PULSE.signal(now.wrapping_sub(age));
}

/// Port and pin of the mark: PC8.
const MARK: (pac::gpio::Gpio, usize) = (pac::GPIOC, 8);

/// The mark's pin, low.
pub type MarkPin = Output<'static>;

/// At a data-ready edge: whether its sample ends a frame.
pub fn mark(ends: bool) {
    #[cfg(feature = "bring-up")]
    crate::bring_up::data_ready();
    MARK.0.bsrr().write(|w| {
        if ends {
            w.set_bs(MARK.1, true);
        } else {
            w.set_br(MARK.1, true);
        }
    });
}
