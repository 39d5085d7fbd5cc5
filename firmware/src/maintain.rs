//! Maintenance mode: what the host asks, done on the two calibration sectors. The rules are in `hrg_core::maintenance`.
//!
//! The chip has one bank of flash: while a sector is erased (2 s at most, STM32F446 data sheet) the processor stands still, and nothing is
//! measured or sent. That is why it takes a mode. Edges and samples lost meanwhile are flagged as any other. Most burns erase nothing; the
//! programming of a word takes 16 us.

use crate::channels::{ANSWER, MAINTAIN, MAINTENANCE_OPEN};
#[cfg(feature = "field-log")]
use crate::channels::{EVENTS, ON_FOR_S, ZERO};
use crate::clock;
use crate::params;
use crate::watchdog::Patience;
use core::ops::Range;
#[cfg(any(feature = "field-log", feature = "self-test"))]
use core::sync::atomic::Ordering;
#[cfg(feature = "field-log")]
use embassy_futures::select::{select, Either};
use embassy_stm32::flash::{Blocking, Flash, FLASH_BASE};
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::pac::FLASH;
use embassy_time::{with_deadline, Instant, Timer};
#[cfg(feature = "field-log")]
use hrg_core::events::{self, Event, Journal, Record};
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Maintenance, Reply};
use hrg_core::sectors::Store;
use hrg_core::sectors::{Place, Sector};
use hrg_core::signature::Key;

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _calibration_a_start: u8;
    static _calibration_a_end: u8;
    static _calibration_b_start: u8;
    static _calibration_b_end: u8;
    #[cfg(feature = "field-log")]
    static _events_a_start: u8;
    #[cfg(feature = "field-log")]
    static _events_a_end: u8;
    #[cfg(feature = "field-log")]
    static _events_b_start: u8;
    #[cfg(feature = "field-log")]
    static _events_b_end: u8;
}

/// The key whose signatures the unit wants; `None`: it takes images without.
#[cfg(not(feature = "signed"))]
pub const KEY: Option<Key> = None;
/// The key whose signatures the unit wants (build.rs).
#[cfg(feature = "signed")]
pub const KEY: Option<Key> = Some(Key::new(include!(concat!(env!("OUT_DIR"), "/public-key.rs"))));

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

    /// First address of a sector, and its end.
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

/// Has the flash erase 32 bits at a time, twice as fast as it starts with (STM32F446 data sheet, table 47): 2 s at most. (embassy leaves
/// PSIZE as it is for an erase.)
fn erase_by_words() {
    // The two keys unlock the control register (RM0390 section 3.5.2); a key too many would lock it until the next reset.
    if FLASH.cr().read().lock() {
        FLASH.keyr().write_value(0x4567_0123);
        FLASH.keyr().write_value(0xCDEF_89AB);
    }
    FLASH.cr().modify(|w| w.set_psize(Psize::PSIZE32));
}

/// Empties the flash caches, which know nothing of an erase (RM0390 section 3.5.3). They are reset while they are off.
fn forget_cached() {
    FLASH.acr().modify(|w| {
        w.set_icen(false);
        w.set_dcen(false);
    });
    FLASH.acr().modify(|w| {
        w.set_icrst(true);
        w.set_dcrst(true);
    });
    FLASH.acr().modify(|w| {
        w.set_icrst(false);
        w.set_dcrst(false);
    });
    cache();
}

/// Prefetch and both caches of the flash on: at 180 MHz it gives a word each sixth cycle.
pub fn cache() {
    FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
}

impl Sectors {
    /// Erases; `false`: it failed, or the supply is too low for it.
    fn erase_range(&mut self, Range { start, end }: Range<u32>) -> bool {
        let flash = &mut self.flash;
        clock::supplied()
            && self.patience.during(|| {
                erase_by_words();
                let done = flash.blocking_erase(start, end).is_ok();
                forget_cached();
                done
            })
    }

    /// Programs; `false` as above.
    fn program(&mut self, at: u32, bytes: &[u8]) -> bool {
        clock::supplied() && self.flash.blocking_write(at, bytes).is_ok()
    }

    /// A sector of the field log in flash.
    #[cfg(feature = "field-log")]
    fn log_range(sector: usize) -> Range<usize> {
        let [start, end] = if sector == 0 {
            [&raw const _events_a_start, &raw const _events_a_end]
        } else {
            [&raw const _events_b_start, &raw const _events_b_end]
        };
        start.addr()..end.addr()
    }
}

#[cfg(feature = "field-log")]
impl events::Store for Sectors {
    fn log(&self, sector: usize) -> &[u8] {
        let address = Self::log_range(sector).start;
        // SAFETY: a sector of the field log (memory.x), of that size, which nothing but this type writes to, and only with `&mut self`.
        #[allow(unsafe_code)]
        unsafe {
            core::slice::from_raw_parts(core::ptr::with_exposed_provenance(address), events::SECTOR)
        }
    }
    fn erase_log(&mut self, sector: usize) -> bool {
        let range = Self::log_range(sector);
        self.erase_range((range.start - FLASH_BASE) as u32..(range.end - FLASH_BASE) as u32)
    }
    fn write_log(&mut self, sector: usize, offset: usize, record: &[u8; events::RECORD]) -> bool {
        let at = Self::log_range(sector).start - FLASH_BASE + offset;
        self.program(at as u32, record)
    }
}

impl Store for Sectors {
    fn erase(&mut self, sector: Sector) -> bool {
        self.erase_range(Self::offsets(sector))
    }
    fn write(&mut self, at: Place, bytes: &[u8]) -> bool {
        self.program(Self::offsets(at.sector).start + at.offset, bytes)
    }
    fn events(&self, _sector: usize) -> &[u8] {
        #[cfg(feature = "field-log")]
        return events::Store::log(self, _sector);
        #[cfg(not(feature = "field-log"))]
        &[]
    }
    fn view(&self, sector: Sector) -> &[u8] {
        let range = Self::range(sector);
        // SAFETY: a calibration sector (memory.x), which nothing but this type writes to, and only with `&mut self`.
        #[allow(unsafe_code)]
        unsafe {
            core::slice::from_raw_parts(core::ptr::with_exposed_provenance(range.start), range.len())
        }
    }
}

/// See the module.
#[embassy_executor::task]
pub async fn task(
    maintenance: &'static mut Maintenance,
    mut sectors: Sectors,
    #[cfg_attr(not(any(feature = "field-log", feature = "self-test")), allow(unused_variables))] calibration: u32,
    #[cfg(feature = "field-log")] mut journal: Journal,
) {
    // (Events do not keep the mode open.)
    let mut idle = Instant::now() + params::MAINTENANCE_IDLE;
    loop {
        #[cfg(feature = "field-log")]
        let next = match with_deadline(idle, select(MAINTAIN.receive(), EVENTS.receive())).await {
            Ok(Either::First(command)) => Ok(command),
            Ok(Either::Second((on_for_s, event))) => {
                journal.write(&mut sectors, Record { on_for_s, event });
                continue;
            }
            Err(late) => Err(late),
        };
        #[cfg(not(feature = "field-log"))]
        let next = with_deadline(idle, MAINTAIN.receive()).await;
        let command = match next {
            Ok(command) => command,
            Err(_) if maintenance.open() => {
                idle = Instant::now() + params::MAINTENANCE_IDLE;
                maintenance.command(&Command::Close, &mut sectors);
                MAINTENANCE_OPEN.signal(false);
                continue;
            }
            Err(_) => {
                idle = Instant::now() + params::MAINTENANCE_IDLE;
                continue;
            }
        };
        idle = Instant::now() + params::MAINTENANCE_IDLE;
        #[cfg_attr(not(feature = "self-test"), allow(unused_mut))]
        let mut reply = maintenance.command(&command, &mut sectors);
        #[cfg(feature = "self-test")]
        if (command, reply) == (Command::Test, Reply::Answer(Answer::Done, 0)) {
            reply = if crate::channels::ALIGNING.load(Ordering::Relaxed) {
                Reply::Answer(Answer::Aligning, 0)
            } else {
                let items = maintenance.items_mut();
                crate::self_test::run(&sectors, calibration, items).await;
                #[cfg(feature = "field-log")]
                crate::self_test::record(&mut sectors, &mut journal, items);
                Reply::TestDone(items.len() as u8)
            };
        }
        #[cfg(feature = "field-log")]
        match (command, reply) {
            // (END without BEGIN is ignored.)
            (Command::End, Reply::Answer(Answer::NotOpen | Answer::Order, _)) => {}
            (Command::End, Reply::Answer(answer, value)) => {
                let event = Event::Burn { answer: answer as u8, calibration: value };
                let _ = EVENTS.try_send((ON_FOR_S.load(Ordering::Relaxed), event));
            }
            (Command::Zero(zero), Reply::Answer(Answer::Done, _)) => {
                for record in hrg_core::zero::records(&zero, calibration, ON_FOR_S.load(Ordering::Relaxed)) {
                    journal.write(&mut sectors, record);
                }
                ZERO.signal(zero);
            }
            _ => {}
        }
        ANSWER.signal(Message::Maintained(reply));
        MAINTENANCE_OPEN.signal(maintenance.open());
        if command == Command::Restart && matches!(reply, Reply::Answer(Answer::Done, _)) {
            // The answer goes out first.
            Timer::after(params::RESTART_WAIT).await;
            cortex_m::peripheral::SCB::sys_reset();
        }
    }
}
