//! The stop: the firmware leaves word for the next start and waits for the watchdog.

use crate::retained;
use core::panic::{Location, PanicInfo};
use cortex_m::peripheral::SCB;
use hrg_core::reset::Halt;
use hrg_core::stopped::Stopped;

/// Nothing more goes out, and the watchdog resets the unit. Word of it is left for the start.
fn stop(word: &Stopped) -> ! {
    cortex_m::interrupt::disable();
    retained::leave(word);
    loop {
        cortex_m::asm::nop();
    }
}

/// Stops for a reason, and leaves who had called.
#[inline(never)]
pub fn halt(why: Halt) -> ! {
    let pc = cortex_m::register::lr::read();
    stop(&Stopped { halt: why, pc, ..Stopped::default() })
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
    let (file, line) = info.location().map_or(("", 0), |at: &Location<'_>| (at.file(), at.line()));
    defmt::error!("panic at {=str}:{=u32}", file, line);
    stop(&Stopped { halt: Halt::Panic, line: line.min(0xFFFF) as u16, ..Stopped::default() }.in_file(file))
}

/// Bits of CFSR that say that an address register holds the address (PM0214 section 4.4.10).
const MMARVALID: u32 = 1 << 7;
const BFARVALID: u32 = 1 << 15;

/// A fault of the processor: halt.
#[cortex_m_rt::exception]
#[allow(unsafe_code)] // cortex-m-rt wants it so.
unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
    // SAFETY: reads of registers that have no side effect, where nothing else runs any more.
    let (cfsr, hfsr, mmfar, bfar) = unsafe {
        let scb = &*SCB::PTR;
        (scb.cfsr.read(), scb.hfsr.read(), scb.mmfar.read(), scb.bfar.read())
    };
    let address = match (cfsr & BFARVALID != 0, cfsr & MMARVALID != 0) {
        (true, _) => bfar,
        (_, true) => mmfar,
        _ => 0,
    };
    let (pc, lr) = (frame.pc(), frame.lr());
    stop(&Stopped { halt: Halt::Fault, pc, lr, cfsr, hfsr, address, ..Stopped::default() })
}
