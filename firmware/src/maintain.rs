//! Maintenance mode: what the host asks, done on the two calibration sectors. The rules are in `hrg_core::maintenance`.
//!
//! The chip has one bank of flash: while a sector is erased (2 s at most) the processor stands still, and nothing is
//! measured or sent. That is why it takes a mode. Edges and samples lost meanwhile are flagged as any other.

use crate::channels::{ANSWER, MAINTAIN, MAINTENANCE_OPEN};
use crate::params;
use embassy_stm32::flash::{Blocking, Flash, FLASH_BASE};
use embassy_stm32::pac;
use embassy_time::{with_timeout, Timer};
use hrg_core::calibration;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Maintenance, Reply, Store};

/// The two sectors in flash: written through the controller, read where they lie.
pub struct Sectors {
    flash: Flash<'static, Blocking>,
}

impl Sectors {
    /// On the chip's flash.
    pub fn new(flash: Flash<'static, Blocking>) -> Self {
        Self { flash }
    }

    fn start(sector: u8) -> u32 {
        if sector == 0 {
            params::CALIBRATION_A
        } else {
            params::CALIBRATION_B
        }
    }
}

/// Sets the watchdog's time and feeds it.
fn watchdog((prescaler, reload): (u8, u16)) {
    let w = pac::IWDG;
    w.kr().write(|r| r.set_key(pac::iwdg::vals::Key::ENABLE));
    w.pr().write(|r| r.set_pr(pac::iwdg::vals::Pr::from_bits(prescaler)));
    w.rlr().write(|r| r.set_rl(reload));
    while w.sr().read().0 != 0 {}
    w.kr().write(|r| r.set_key(pac::iwdg::vals::Key::RESET));
}

impl Store for Sectors {
    fn erase(&mut self, sector: u8) -> bool {
        let start = Self::start(sector);
        watchdog(params::WATCHDOG_ERASE);
        let done = self.flash.blocking_erase(start, start + params::CALIBRATION_SIZE).is_ok();
        watchdog(params::WATCHDOG_USUAL);
        done
    }
    fn write(&mut self, sector: u8, offset: u16, bytes: &[u8]) -> bool {
        self.flash.blocking_write(Self::start(sector) + u32::from(offset), bytes).is_ok()
    }
    fn view(&self, sector: u8) -> &[u8] {
        let address = FLASH_BASE + Self::start(sector) as usize;
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
