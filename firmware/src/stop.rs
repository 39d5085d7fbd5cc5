//! The stop: the firmware leaves the reason for the next start and waits for the watchdog.

use crate::retained;
use core::panic::{Location, PanicInfo};
use hrg_core::reset::Halt;

/// Nothing more goes out, and the watchdog resets the unit. Why is left for the start.
pub fn halt(why: Halt) -> ! {
    cortex_m::interrupt::disable();
    retained::leave_word(why);
    loop {
        cortex_m::asm::nop();
    }
}

/// Gives the value of a start-up cell, once; halts on a second request, which would be a bug.
pub fn once<T>(taken: Option<T>) -> T {
    match taken {
        Some(taken) => taken,
        None => halt(Halt::Corruption),
    }
}

/// A panic is a bug: log where, and halt.
#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    match info.location().map(|at: &Location<'_>| (at.file(), at.line())) {
        Some((file, line)) => defmt::error!("panic at {=str}:{=u32}", file, line),
        None => defmt::error!("panic"),
    }
    halt(Halt::Panic)
}

/// A fault of the processor: halt.
#[cortex_m_rt::exception]
#[allow(unsafe_code)] // cortex-m-rt wants it so.
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    halt(Halt::Fault)
}
