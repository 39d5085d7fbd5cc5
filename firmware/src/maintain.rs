//! Maintenance mode: what the host asks, done on the two calibration sectors and on the slot that does not run. The rules are in `hrg_core::maintenance` and
//! `hrg_core::update`.
//!
//! The chip has one bank of flash: while a sector is erased (2 s at most, STM32F446 data sheet) the processor stands still, and nothing is
//! measured or sent. That is why it takes a mode. Edges and samples lost meanwhile are flagged as any other. Most burns erase nothing; the
//! programming of a word takes 16 us.

use crate::channels::{ANSWER, ECHOED, MAINTAIN, MAINTENANCE_OPEN, MOVING, ON_TRIAL, RATES};
#[cfg(feature = "field-log")]
use crate::channels::{EVENTS, ON_FOR_S, OUTPUT, ZERO};
use crate::clock;
use crate::params;
use crate::watchdog::Patience;
use core::ops::Range;
use core::sync::atomic::Ordering;
#[cfg(feature = "field-log")]
use embassy_futures::select::{select, Either};
use embassy_stm32::flash::{Blocking, Flash, FLASH_BASE};
use embassy_stm32::gpio::Input;
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::pac::FLASH;
use embassy_time::{with_deadline, Duration, Instant, Timer};
#[cfg(feature = "field-log")]
use hrg_core::events::{self, Event, Journal, Record};
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Maintenance, Reply};
use hrg_core::sectors::Store;
use hrg_core::sectors::{Place, Sector};
use hrg_core::signature::Key;
use hrg_core::slots::{mark, Slot, State, FIRST_SECTORS};
use hrg_core::update::{self, Condition, Programs, Trial, Verdict};

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _calibration_a_start: u8;
    static _calibration_a_end: u8;
    static _calibration_b_start: u8;
    static _calibration_b_end: u8;
    #[cfg(feature = "field-log")]
    static _events_start: u8;
    #[cfg(feature = "field-log")]
    static _events_end: u8;
    static _slot_a_start: u8;
    static _slot_a_end: u8;
    static _slot_b_start: u8;
    static _slot_b_end: u8;
}

/// Addresses of a slot.
fn slot_range(slot: usize) -> Range<usize> {
    let [start, end] = match slot {
        0 => [&raw const _slot_a_start, &raw const _slot_a_end],
        _ => [&raw const _slot_b_start, &raw const _slot_b_end],
    };
    start.addr()..end.addr()
}

/// A slot in flash.
fn slot_bytes(slot: usize) -> &'static [u8] {
    let range = slot_range(slot);
    // SAFETY: a slot (memory.x), which only `Sectors` writes to; bytes are read once each, and what is decided by them is checked after the last write.
    #[allow(unsafe_code)]
    unsafe {
        core::slice::from_raw_parts(core::ptr::with_exposed_provenance(range.start), range.len())
    }
}

/// The slot that this program is linked for: 0: A, 1: B (build.rs).
const OWN: usize = include!(concat!(env!("OUT_DIR"), "/slot.rs"));

/// The slot of this program, and both.
pub fn slots() -> (usize, [Slot<'static>; 2]) {
    (OWN, [0, 1].map(|slot| Slot(slot_bytes(slot))))
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

    /// The field log in flash.
    #[cfg(feature = "field-log")]
    fn log_range() -> Range<usize> {
        (&raw const _events_start).addr()..(&raw const _events_end).addr()
    }
}

#[cfg(feature = "field-log")]
impl events::Store for Sectors {
    fn log(&self) -> &[u8] {
        let address = Self::log_range().start;
        // SAFETY: the sector of the field log (memory.x), of that size, which nothing but this type writes to, and only with `&mut self`.
        #[allow(unsafe_code)]
        unsafe {
            core::slice::from_raw_parts(core::ptr::with_exposed_provenance(address), events::SECTOR)
        }
    }
    fn erase_log(&mut self) -> bool {
        let range = Self::log_range();
        self.erase_range((range.start - FLASH_BASE) as u32..(range.end - FLASH_BASE) as u32)
    }
    fn write_log(&mut self, offset: usize, record: &[u8; events::RECORD]) -> bool {
        let at = Self::log_range().start - FLASH_BASE + offset;
        self.program(at as u32, record)
    }
}

impl update::Store for Sectors {
    fn own(&self) -> usize {
        OWN
    }
    fn slot(&self, slot: usize) -> (&[u8], u32) {
        (slot_bytes(slot), slot_range(slot).start as u32)
    }
    fn erase_slot(&mut self, slot: usize, sector: usize) -> bool {
        let Range { start, end } = slot_range(slot);
        let second = start + FIRST_SECTORS[slot % 2];
        let range = if sector == 0 { start..second } else { second..end };
        // (Never the one that runs.)
        slot != OWN && self.erase_range((range.start - FLASH_BASE) as u32..(range.end - FLASH_BASE) as u32)
    }
    fn write_slot(&mut self, slot: usize, offset: usize, bytes: &[u8]) -> bool {
        self.program((slot_range(slot).start - FLASH_BASE + offset) as u32, bytes)
    }
}

/// Actions of the unit now.
fn condition(calibration: u32) -> Condition {
    Condition {
        rates: RATES.load(Ordering::Relaxed),
        calibrated: calibration != 0,
        echoed: ECHOED.load(Ordering::Relaxed),
    }
}

/// The programs of the unit.
pub fn programs(token: u32) -> Programs {
    Programs::of(slots(), token)
}

/// `true` if a program that was put into use after this one was left by the loader: it has changed.
pub fn newer_was_left() -> bool {
    let (own, all) = slots();
    let [own, other] = [own, 1 - own].map(|slot| all.get(slot).copied().unwrap_or(Slot(&[])));
    other.state() == State::Confirmed && other.number() > own.number()
}

impl Store for Sectors {
    fn erase(&mut self, sector: Sector) -> bool {
        self.erase_range(Self::offsets(sector))
    }
    fn write(&mut self, at: Place, bytes: &[u8]) -> bool {
        self.program(Self::offsets(at.sector).start + at.offset, bytes)
    }
    fn events(&self) -> &[u8] {
        #[cfg(feature = "field-log")]
        return events::Store::log(self);
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

/// The program that runs, until it has confirmed itself.
struct OnTrial {
    trial: Trial,
    /// The next look, each second.
    next: Instant,
}

impl OnTrial {
    /// `None`: it has.
    fn begin(sectors: &impl update::Store) -> Option<Self> {
        let own = Slot(sectors.slot(sectors.own()).0);
        let expected = own.word(mark::EXPECTED) as u8;
        let on_trial = own.state() != State::Confirmed;
        ON_TRIAL.store(on_trial && update::has_other(sectors), Ordering::Relaxed);
        on_trial.then(|| Self { trial: Trial::new(expected), next: Instant::now() + Duration::from_secs(1) })
    }

    /// `true` if it has confirmed itself now. A program that has had its time starts anew, and the loader takes the one before.
    fn look(&mut self, sectors: &mut impl update::Store, now: Condition) -> bool {
        if Instant::now() < self.next {
            return false;
        }
        self.next += Duration::from_secs(1);
        match self.trial.second(now) {
            Verdict::Wait => false,
            Verdict::Confirm => {
                let done = update::confirm(sectors);
                if done {
                    ON_TRIAL.store(false, Ordering::Relaxed);
                }
                defmt::info!("the program has confirmed itself: {=bool}", done);
                done
            }
            // Without a program to go back to a reset would not help: it goes on trying.
            Verdict::GiveUp if !update::has_other(sectors) => {
                self.trial.again();
                false
            }
            Verdict::GiveUp => {
                defmt::error!("the program could not confirm itself: the one before comes back");
                cortex_m::peripheral::SCB::sys_reset()
            }
        }
    }
}

/// The event of the program that runs.
#[cfg(feature = "field-log")]
pub fn program_event() -> Event {
    let Programs { slot, state, sum, .. } = programs(0);
    Event::Program { slot, state, sum }
}

/// Has a command carried out. (Where a whole program is checked, its sum and its signature, that takes longer than a watchdog whose oscillator is fast would wait.)
fn carry_out(maintenance: &mut Maintenance, command: &Command, sectors: &mut Sectors) -> Reply {
    let long = matches!(command, Command::Commit(_) | Command::RollBack);
    if long {
        sectors.patience.begin();
    }
    let reply = maintenance.command(command, sectors);
    if long {
        sectors.patience.end();
    }
    reply
}

/// Settings that the field log keeps, and that hold from now on.
#[cfg(feature = "field-log")]
fn keep(command: &Command, calibration: u32, sectors: &mut Sectors, journal: &mut Journal) {
    let on_for_s = ON_FOR_S.load(Ordering::Relaxed);
    match command {
        Command::Zero(zero) => {
            for record in hrg_core::zero::records(zero, calibration, on_for_s) {
                journal.write(sectors, record);
            }
            ZERO.signal(*zero);
        }
        Command::Output(settings) => {
            journal.write(sectors, Record { on_for_s, event: Event::Output { settings: settings.word() } });
            OUTPUT.signal(*settings);
        }
        _ => {}
    }
}

/// See the module.
#[embassy_executor::task]
pub async fn task(
    maintenance: &'static mut Maintenance,
    mut sectors: Sectors,
    service: Input<'static>,
    calibration: u32,
    #[cfg(feature = "field-log")] mut journal: Journal,
) {
    // (Events do not keep the mode open.)
    let mut idle = Instant::now() + params::MAINTENANCE_IDLE;
    let mut trial = OnTrial::begin(&sectors);
    loop {
        if let Some(on) = &mut trial {
            if on.look(&mut sectors, condition(calibration)) {
                trial = None;
                #[cfg(feature = "field-log")]
                journal
                    .write(&mut sectors, Record { on_for_s: ON_FOR_S.load(Ordering::Relaxed), event: program_event() });
            }
        }
        let wake = trial.as_ref().map_or(idle, |on| on.next.min(idle));
        #[cfg(feature = "field-log")]
        let next = match with_deadline(wake, select(MAINTAIN.receive(), EVENTS.receive())).await {
            Ok(Either::First(command)) => Ok(command),
            Ok(Either::Second((on_for_s, event))) => {
                journal.write(&mut sectors, Record { on_for_s, event });
                continue;
            }
            Err(late) => Err(late),
        };
        #[cfg(not(feature = "field-log"))]
        let next = with_deadline(wake, MAINTAIN.receive()).await;
        let command = match next {
            Ok(command) => command,
            Err(_) if Instant::now() < idle => continue,
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
        maintenance.set_condition(condition(calibration));
        maintenance.set_moving(MOVING.load(Ordering::Relaxed) && service.is_high());
        #[cfg_attr(not(feature = "self-test"), allow(unused_mut))]
        let mut reply = carry_out(maintenance, &command, &mut sectors);
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
            (command, Reply::Answer(Answer::Done, _)) => keep(&command, calibration, &mut sectors, &mut journal),
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
