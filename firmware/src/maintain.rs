//! Maintenance mode: what the host asks, done on the two calibration sectors. The rules are in `hrg_core::maintenance`.
//!
//! The chip has one bank of flash: while a sector is erased (2 s at most) the processor stands still, and nothing is
//! measured or sent. That is why it takes a mode. Edges and samples lost meanwhile are flagged as any other.

use crate::channels::{ANSWER, MAINTAIN, MAINTENANCE_OPEN};
use crate::params;
use crate::watchdog::Patience;
use core::ops::Range;
use embassy_stm32::flash::{Blocking, Flash, FLASH_BASE};
use embassy_time::{with_timeout, Timer};
use hrg_core::calibration;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Maintenance, Reply, Store};
use hrg_core::sectors::Sector;

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _calibration_a_start: u8;
    static _calibration_a_end: u8;
    static _calibration_b_start: u8;
    static _calibration_b_end: u8;
}

/// The two sectors in flash: written through the controller, read where they lie.
pub struct Sectors {
    flash: Flash<'static, Blocking>,
    patience: Patience,
}

impl Sectors {
    /// On the chip's flash.
    pub fn new(flash: Flash<'static, Blocking>, patience: Patience) -> Self {
        Self { flash, patience }
    }

    /// Where a sector begins, and its end.
    fn range(sector: Sector) -> Range<usize> {
        let [start, end] = match sector {
            Sector::A => [&raw const _calibration_a_start, &raw const _calibration_a_end],
            Sector::B => [&raw const _calibration_b_start, &raw const _calibration_b_end],
        };
        start.addr()..end.addr()
    }

    /// The same from the start of flash, as the controller counts.
    fn offsets(sector: Sector) -> Range<u32> {
        let range = Self::range(sector);
        (range.start - FLASH_BASE) as u32..(range.end - FLASH_BASE) as u32
    }
}

impl Store for Sectors {
    fn erase(&mut self, sector: Sector) -> bool {
        let Range { start, end } = Self::offsets(sector);
        let flash = &mut self.flash;
        self.patience.during(|| flash.blocking_erase(start, end).is_ok())
    }
    fn write(&mut self, sector: Sector, offset: u16, bytes: &[u8]) -> bool {
        self.flash.blocking_write(Self::offsets(sector).start + u32::from(offset), bytes).is_ok()
    }
    fn view(&self, sector: Sector) -> &[u8] {
        let address = Self::range(sector).start;
        // SAFETY: a calibration sector (memory.x), longer than that, which nothing but this type writes to, and only with
        // `&mut self`.
        #[allow(unsafe_code)]
        unsafe {
            core::slice::from_raw_parts(core::ptr::with_exposed_provenance(address), calibration::MAX_BYTES)
        }
    }
}

/// See the module.
#[embassy_executor::task]
pub async fn task(maintenance: &'static mut Maintenance, mut sectors: Sectors) {
    loop {
        let command = match with_timeout(params::MAINTENANCE_IDLE, MAINTAIN.receive()).await {
            Ok(command) => command,
            Err(_) if maintenance.open() => {
                maintenance.command(&Command::Close, &mut sectors);
                MAINTENANCE_OPEN.signal(false);
                continue;
            }
            Err(_) => continue,
        };
        let reply = maintenance.command(&command, &mut sectors);
        ANSWER.signal(Message::Maintained(reply));
        MAINTENANCE_OPEN.signal(maintenance.open());
        if command == Command::Restart && matches!(reply, Reply::Answer(Answer::Done, _)) {
            // The answer goes out first.
            Timer::after(params::RESTART_WAIT).await;
            cortex_m::peripheral::SCB::sys_reset();
        }
    }
}
