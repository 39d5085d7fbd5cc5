//! The built-in test: asks the parts of the unit for what they can tell of themselves. The items and their limits are in
//! [`hrg_core::self_test`].

use crate::channels::{self, ADC_TEST, ADC_TESTED, HOUSEKEPT, PROGRAM_TEST, PROGRAM_TESTED};
use crate::program::Verdict;
use crate::{clock, maintain};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_time::{with_timeout, Duration};
use hrg_core::events::Event;
#[cfg(feature = "field-log")]
use hrg_core::events::{Journal, Record};
use hrg_core::link::Housekeeping;
use hrg_core::sectors::{self, Sector, Store};
use hrg_core::self_test::{self, failed, Check, Item, Items, SECONDS};
use hrg_core::status::UnitStatus;
use hrg_core::AXES;

/// Longest that the ADC's course takes: one second, and the wait for its begin.
const ADC_WITHIN: Duration = Duration::from_secs(3);
/// Longest wait for a second of housekeeping, or for the program's sum.
const SECOND_WITHIN: Duration = Duration::from_secs(3);

/// Bits of the memory that the start has found bad.
static MEMORY: AtomicU32 = AtomicU32::new(0);

/// The unit runs on its crystal.
static CRYSTAL: AtomicBool = AtomicBool::new(false);

/// Tests the memory, and keeps the result. Before any DMA stream is on.
pub fn memory() {
    MEMORY.store(crate::memory::bad_bits(), Ordering::Relaxed);
}

/// Bits of the memory are bad.
pub fn memory_is_bad() -> bool {
    MEMORY.load(Ordering::Relaxed) > 0
}

fn of_memory() -> Item {
    Item::none_of(Check::Memory, 0, MEMORY.load(Ordering::Relaxed))
}

/// The short test, of what the start has found; `None`: it passes.
pub fn at_start(program: Verdict, status: UnitStatus, crystal: bool) -> Option<Event> {
    CRYSTAL.store(crystal, Ordering::Relaxed);
    let items = [
        of_memory(),
        Item::of(Check::Program, program != Verdict::Changed),
        Item::of(Check::Image, !status.contains(UnitStatus::IMAGE_REFUSED)),
        Item::of(Check::Crystal, crystal),
        Item::of(Check::Supply, clock::supplied()),
    ];
    let event = event(&items, true);
    items.iter().any(|item| item.verdict() == self_test::Verdict::Fail).then_some(event)
}

/// The record of a test.
pub fn event(items: &[Item], at_start: bool) -> Event {
    let (count, first) = failed(items);
    let first = first.map_or([0; 2], |item| [item.check as u8, item.index]);
    Event::Test { at_start, failed: count.min(0xFF) as u8, first }
}

/// Writes the record of a test to the field log, and adds the item that says so.
#[cfg(feature = "field-log")]
#[inline(never)]
pub fn record(sectors: &mut maintain::Sectors, journal: &mut Journal, items: &mut Items) {
    let record = Record { on_for_s: channels::ON_FOR_S.load(Ordering::Relaxed), event: event(items, false) };
    let read_back = journal.write_and_read(sectors, record);
    let _ = items.push(Item::of_option(Check::Log, read_back));
}

/// All items but the field log's. Rates are flagged meanwhile.
pub async fn run(store: &impl Store, calibration: u32, items: &mut Items) {
    items.clear();
    channels::TESTING.store(true, Ordering::Relaxed);
    channels::stand(UnitStatus::ADC_FAULT, true);
    let errors = HOUSEKEPT.try_take().map(|h| h.link_errors);
    ADC_TESTED.reset();
    ADC_TEST.signal(());
    let levels = with_timeout(ADC_WITHIN, ADC_TESTED.wait()).await.ok();
    self_test::of_adc(levels.as_ref(), items);
    // The second in which the ADC was away, and the one in which it was set up anew.
    HOUSEKEPT.reset();
    for _ in 0..SECONDS {
        second().await;
    }
    let seconds = [second().await, second().await];
    channels::stand(UnitStatus::ADC_FAULT, false);
    channels::TESTING.store(false, Ordering::Relaxed);
    PROGRAM_TESTED.reset();
    PROGRAM_TEST.signal(());
    let program = with_timeout(SECOND_WITHIN, PROGRAM_TESTED.wait()).await.ok();
    let [first, last] = &seconds;
    let broken = last.link_errors.wrapping_sub(errors.unwrap_or(first.link_errors));
    rest(store, calibration, &seconds, program, broken, items);
}

/// Items that need no wait.
#[inline(never)]
fn rest(
    store: &impl Store,
    calibration: u32,
    seconds: &[Housekeeping; SECONDS],
    program: Option<Verdict>,
    broken: u16,
    items: &mut Items,
) {
    let (image, curves_c) = of_image(store, calibration);
    self_test::of_seconds(seconds, curves_c, items);
    let program = match program {
        Some(Verdict::Unsealed) => Item::not_tested(Check::Program),
        verdict => Item::of(Check::Program, verdict == Some(Verdict::Intact)),
    };
    for item in [
        Item::of(Check::Crystal, CRYSTAL.load(Ordering::Relaxed)),
        Item::of(Check::Supply, clock::supplied()),
        of_memory(),
        program,
        image,
        Item::none_of(Check::Link, 0, broken.into()),
    ] {
        let _ = items.push(item);
    }
    #[cfg(feature = "inputs")]
    {
        let (supply_v, temperature_c) = crate::chip::latest();
        self_test::of_chip(supply_v, temperature_c, items);
    }
}

/// The next second; one of nothing where none comes.
async fn second() -> Housekeeping {
    let missing = Housekeeping { frequency_hz: [f64::NAN; AXES], ..Housekeeping::default() };
    with_timeout(SECOND_WITHIN, HOUSEKEPT.wait()).await.unwrap_or(missing)
}

/// The image in flash against the one in use, and the range of each axis' curve.
fn of_image(store: &impl Store, calibration: u32) -> (Item, Option<[[f32; 2]; AXES]>) {
    let found = sectors::newest(store.view(Sector::A), store.view(Sector::B), maintain::KEY);
    let Some((image, place)) = found.newest else {
        // (A unit that was never calibrated has nothing to refuse.)
        let blank = calibration == 0 && found.refused.is_none();
        let item = if blank { Item::not_tested(Check::Image) } else { Item::of(Check::Image, false) };
        return (item, None);
    };
    let stored = store.view(place.sector).get(place.offset as usize..).and_then(sectors::stored_checksum);
    let same = stored == Some(calibration) && found.refused.is_none();
    let curves = image.axes.each_ref().map(|axis| [axis.curve.valid_from_c, axis.curve.valid_to_c]);
    (Item::of(Check::Image, same), Some(curves))
}
