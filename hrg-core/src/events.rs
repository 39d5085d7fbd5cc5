//! The field log: what befell the unit, in flash, over power cuts.
//!
//! # Layout
//! One sector of 16 KiB: a head, then records of 16 bytes, one after the other ([`Record`]). A record whose checksum does not match (a power cut
//! while it was written) is skipped. The head is written last, when a log is begun; a sector without it holds no log.
//!
//! # When the sector is erased
//! An erase takes up to 0.5 s (STM32F446 data sheet, table 47), in which the processor stands still. So it is done only at power-on, before the
//! first rate, when less than a quarter of the sector is free. In flight a full log takes no more: what is lost is counted. The newest
//! [`CARRIED`] records are carried over in memory, and the constants that were renewed last and what is sent ([`crate::output`]) are put beside the calibration
//! images first ([`crate::sectors::keep`]): a power cut in that half second loses the older events, and no setting.
//!
//! # Why not `sequential-storage`
//! That crate erases when the next record needs it, and takes an asynchronous flash. Here the moment of the erase is what matters.
//!
//! # Example
//! ```
//! use hrg_core::events::{Event, Record};
//! use hrg_core::status::UnitStatus;
//!
//! let record = Record { on_for_s: 12, event: Event::Unit { flags: UnitStatus::ADC_FAULT } };
//! let mut bytes = record.to_bytes();
//! assert_eq!(Record::from_bytes(&bytes), Some(record));
//! // Half written, it is none.
//! bytes[4..].fill(0xFF);
//! assert_eq!(Record::from_bytes(&bytes), None);
//! ```

use crate::bytes;
use crate::output::OutputSettings;
use crate::reset::{Halt, ResetCause};
use crate::sectors;
use crate::status::{AxisStatus, UnitStatus};
use crate::stopped::{Piece, Stopped};
use crate::zero;
use crate::AXES;
use heapless::Vec;

/// Bytes of a record.
pub const RECORD: usize = 16;
/// Bytes of the sector.
pub const SECTOR: usize = 16 * 1024;
/// Records of it, the head included.
const RECORDS: usize = SECTOR / RECORD;
/// With fewer free records than this at power-on the log is begun anew.
const ROOM: usize = RECORDS / 4;

/// Places at its end that are for starts and burns.
const RESERVED: usize = 33;

/// Flags of an axis, or of the unit, are told once in so many seconds.
pub const PACE_S: u32 = 60;

/// Newest records that go on into a log that is begun anew.
pub const CARRIED: usize = 256;

/// The sector of the log.
pub trait Store {
    /// All bytes of it.
    fn log(&self) -> &[u8];
    /// Erases it.
    fn erase_log(&mut self) -> bool;
    /// Programs a record.
    fn write_log(&mut self, offset: usize, record: &[u8; RECORD]) -> bool;
}

/// Event of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It started: why, what had stopped it before, resets since power-on, checksum of the image in use.
    Start {
        /// Why.
        cause: ResetCause,
        /// Cause of the last stop.
        halt: Halt,
        /// Resets since power-on.
        resets: u16,
        /// Checksum of the image in use; 0: the compiled-in default.
        calibration: u32,
    },
    /// Flags of an axis rose, and its temperature (the bits of the number in C).
    Axis {
        /// 0 to 2.
        axis: u8,
        /// Flags that rose.
        flags: AxisStatus,
        /// Bits of its temperature, C.
        temperature: u32,
    },
    /// Flags of the unit rose.
    Unit {
        /// Flags that rose.
        flags: UnitStatus,
    },
    /// A burn ended: the answer's number ([`crate::maintenance::Answer`]), and the image's checksum where it was taken.
    Burn {
        /// Answer.
        answer: u8,
        /// Checksum.
        calibration: u32,
    },
    /// A burn was cut short before its image counted (a power cut, a pulled cable). The start that finds it marks the place as refused, and
    /// so reports it once ([`crate::sectors::mark`]).
    CutShort {
        /// Place of the image ([`crate::sectors::Place::number`]).
        place: u32,
    },
    /// Constants were renewed ([`crate::zero`]): when, and the low half of the checksum of the image they were measured under. Those of the
    /// axes follow.
    ZeroOf {
        /// Low half of that checksum.
        calibration: u16,
        /// Seconds since 1970.
        made_unix_s: u32,
    },
    /// The constant of an axis.
    Zero {
        /// 0 to 2.
        axis: u8,
        /// Bits of its standard uncertainty, deg/h ([`crate::half::Half`]).
        std: u16,
        /// Bits of it, deg/h.
        constant: u32,
    },
    /// The built-in test ([`crate::self_test`]): at the start, where it fails, or asked for.
    Test {
        /// It was that of the start.
        at_start: bool,
        /// Items that fail.
        failed: u8,
        /// Check of the first of them ([`crate::self_test::Check`]), and its channel or axis; of no meaning where none fails.
        first: [u8; 2],
    },
    /// The program that runs, where it is not as the log had it last: another one, on trial or confirmed, or one that came back
    /// ([`crate::update`]).
    Program {
        /// 0: A, 1: B.
        slot: u8,
        /// Its state ([`crate::slots::State`]).
        state: u8,
        /// Its sum.
        sum: u32,
    },
    /// The output was set ([`crate::output::OutputSettings::word`]).
    Output {
        /// The settings in a word.
        settings: u32,
    },
    /// A word of what the stop before the last start has left ([`crate::stopped`]).
    Stopped(Piece),
    /// The log is full: from here on only starts and burns are written, as long as the places reserved for them last (1), or nothing is (0).
    Lost {
        /// 1: starts and burns are written still; 0: nothing is.
        count: u16,
    },
}

impl Event {
    /// Goes into the stop that the log tells: a start begins it, its words fill it. `true` for a word.
    pub fn goes_into(&self, stop: &mut Stopped) -> bool {
        match *self {
            Self::Start { halt, .. } => *stop = Stopped { halt, ..Stopped::default() },
            Self::Stopped(piece) => {
                stop.add(piece);
                return true;
            }
            _ => {}
        }
        false
    }
}

/// An event with its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record {
    /// Time since power-on, over restarts, s.
    pub on_for_s: u32,
    /// The event.
    pub event: Event,
}

/// Kinds of records in flash. (0xFF is erased flash.)
mod kind {
    pub const HEAD: u8 = 1;
    pub const START: u8 = 2;
    pub const AXIS: u8 = 3;
    pub const UNIT: u8 = 4;
    pub const BURN: u8 = 5;
    pub const LOST: u8 = 6;
    pub const CUT_SHORT: u8 = 7;
    pub const ZERO_OF: u8 = 8;
    pub const ZERO: u8 = 9;
    pub const TEST: u8 = 10;
    pub const STOPPED: u8 = 11;
    pub const PROGRAM: u8 = 12;
    pub const OUTPUT: u8 = 13;
}

/// A record as it lies in flash: kind, a small number, a number of 16 bits, two words, checksum (CRC-32 of what is before it).
fn laid_out(kind: u8, small: u8, middle: u16, words: [u32; 2]) -> [u8; RECORD] {
    let mut out = [0; RECORD];
    out[0] = kind;
    out[1] = small;
    out[2..4].copy_from_slice(&middle.to_le_bytes());
    out[4..8].copy_from_slice(&words[0].to_le_bytes());
    out[8..12].copy_from_slice(&words[1].to_le_bytes());
    let sum = bytes::crc32(&out[..12]);
    out[12..].copy_from_slice(&sum.to_le_bytes());
    out
}

fn parts(bytes: &[u8; RECORD]) -> Option<(u8, u8, u16, [u32; 2])> {
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    (word(12) == self::bytes::crc32(&bytes[..12]))
        .then(|| (bytes[0], bytes[1], u16::from_le_bytes([bytes[2], bytes[3]]), [word(4), word(8)]))
}

impl Record {
    /// As it lies in flash.
    #[must_use]
    pub fn to_bytes(self) -> [u8; RECORD] {
        let t = self.on_for_s;
        match self.event {
            Event::Start { cause, halt, resets, calibration } => {
                laid_out(kind::START, cause as u8 | (halt as u8) << 4, resets, [t, calibration])
            }
            Event::Axis { axis, flags, temperature } => laid_out(kind::AXIS, axis, flags.bits(), [t, temperature]),
            Event::Unit { flags } => laid_out(kind::UNIT, 0, flags.bits(), [t, 0]),
            Event::Burn { answer, calibration } => laid_out(kind::BURN, answer, 0, [t, calibration]),
            Event::CutShort { place } => laid_out(kind::CUT_SHORT, 0, 0, [t, place]),
            Event::ZeroOf { calibration, made_unix_s } => laid_out(kind::ZERO_OF, 0, calibration, [t, made_unix_s]),
            Event::Zero { axis, std, constant } => laid_out(kind::ZERO, axis, std, [t, constant]),
            Event::Test { at_start, failed, first } => {
                laid_out(kind::TEST, failed, u16::from_le_bytes(first), [t, u32::from(at_start)])
            }
            Event::Stopped(Piece { number, value }) => laid_out(kind::STOPPED, number, 0, [t, value]),
            Event::Program { slot, state, sum } => laid_out(kind::PROGRAM, slot, state.into(), [t, sum]),
            Event::Output { settings } => laid_out(kind::OUTPUT, 0, 0, [t, settings]),
            Event::Lost { count } => laid_out(kind::LOST, 0, count, [t, 0]),
        }
    }

    /// `None`: no record, or a torn one.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; RECORD]) -> Option<Self> {
        let (kind, small, middle, [on_for_s, value]) = parts(bytes)?;
        let event = match kind {
            kind::START => Event::Start {
                cause: ResetCause::from_number(small & 0xF)?,
                halt: Halt::from_number(small >> 4)?,
                resets: middle,
                calibration: value,
            },
            kind::AXIS => {
                Event::Axis { axis: small, flags: AxisStatus::from_bits_truncate(middle), temperature: value }
            }
            kind::UNIT => Event::Unit { flags: UnitStatus::from_bits_truncate(middle) },
            kind::BURN => Event::Burn { answer: small, calibration: value },
            kind::CUT_SHORT => Event::CutShort { place: value },
            kind::ZERO_OF => Event::ZeroOf { calibration: middle, made_unix_s: value },
            kind::ZERO => Event::Zero { axis: small, std: middle, constant: value },
            kind::TEST => Event::Test { at_start: value != 0, failed: small, first: middle.to_le_bytes() },
            kind::STOPPED => Event::Stopped(Piece { number: small, value }),
            kind::PROGRAM => Event::Program { slot: small, state: middle.to_le_bytes()[0], sum: value },
            kind::OUTPUT => Event::Output { settings: value },
            kind::LOST => Event::Lost { count: middle },
            _ => return None,
        };
        Some(Self { on_for_s, event })
    }
}

/// The head's number of a sector; `None`: it has none.
fn head(sector: &[u8]) -> Option<u32> {
    match parts(sector.first_chunk()?)? {
        (kind::HEAD, _, _, [number, _]) => Some(number),
        _ => None,
    }
}

/// The records of a log, oldest first.
pub fn records(sector: &[u8]) -> impl Iterator<Item = Record> + '_ {
    let begun = head(sector).is_some();
    sector.chunks_exact(RECORD).filter(move |_| begun).filter_map(|r| Record::from_bytes(r.first_chunk()?))
}

/// The program that the log holds last.
#[must_use]
pub fn last_program(records: impl Iterator<Item = Record>) -> Option<Event> {
    records.map(|record| record.event).filter(|event| matches!(event, Event::Program { .. })).last()
}

/// The stop whose words the log holds last.
#[must_use]
pub fn last_stop(records: impl Iterator<Item = Record>) -> Option<Stopped> {
    let (mut stop, mut last) = (Stopped::default(), None);
    for record in records {
        if record.event.goes_into(&mut stop) {
            last = Some(stop);
        }
    }
    last
}

/// Settings of a log that must never be lost: the constants that were renewed last, and the output. `None`: neither was ever set.
#[inline(never)]
fn settings_of(log: &mut dyn Iterator<Item = Record>) -> Option<[Record; sectors::KEPT_RECORDS]> {
    let (mut zero, mut output) = (zero::NewestSet::default(), None);
    for record in log {
        zero.take(record);
        if matches!(record.event, Event::Output { .. }) {
            output = Some(record);
        }
    }
    let zero = zero.found();
    if zero.is_none() && output.is_none() {
        return None;
    }
    // (Constants of an image that there is not are none.)
    let none = Record { on_for_s: 0, event: Event::ZeroOf { calibration: 0, made_unix_s: 0 } };
    let of = |axis| Record { on_for_s: 0, event: Event::Zero { axis, std: 0, constant: 0 } };
    let [a, b, c, d] = zero.unwrap_or([none, of(0), of(1), of(2)]);
    let usual = Event::Output { settings: OutputSettings::default().word() };
    Some([a, b, c, d, output.unwrap_or(Record { on_for_s: 0, event: usual })])
}

/// Writes the log.
#[derive(Debug, Clone)]
pub struct Journal {
    /// The next record's number; [`RECORDS`]: there is no room.
    next: usize,
    lost: u16,
}

impl Journal {
    /// Finds the end of the log. `may_erase`: at power-on, before the first rate.
    pub fn open(store: &mut (impl Store + sectors::Store), may_erase: bool) -> Self {
        let number = head(store.log());
        let next = Self::end(store.log());
        let mut journal = Self { next: if number.is_some() { next } else { RECORDS }, lost: 0 };
        if RECORDS - journal.next < ROOM && (may_erase || next == 0) {
            journal.begin(store, number, next > 0);
        }
        journal
    }

    /// The number of the first record behind which everything is erased.
    fn end(sector: &[u8]) -> usize {
        let written = sector.chunks_exact(RECORD).rposition(|r| r.iter().any(|b| *b != 0xFF));
        written.map_or(0, |at| at + 1).min(RECORDS)
    }

    /// Begins the log anew. `before`: the number of the one that is there.
    #[inline(never)]
    fn begin(&mut self, store: &mut (impl Store + sectors::Store), before: Option<u32>, erase: bool) {
        let settings = settings_of(&mut records(store.log()));
        let mut carried: Vec<Record, CARRIED> = Vec::new();
        let there = records(store.log()).count();
        carried.extend(records(store.log()).skip(there.saturating_sub(CARRIED)));
        // (A log without a head was being begun when the power was cut: its constants are where they were put before that.)
        let beside = sectors::kept(store);
        let number = before.or(beside.map(|(number, _)| number)).unwrap_or(0).wrapping_add(1);
        let settings = match (before, settings, beside) {
            (Some(_), Some(set), _) => {
                if erase && !sectors::keep(store, number, &set.map(Record::to_bytes)) {
                    return;
                }
                Some(set)
            }
            (None, _, Some((_, set))) => settings_of(&mut set.iter().filter_map(Record::from_bytes)),
            _ => None,
        };
        if erase && !store.erase_log() {
            return;
        }
        self.next = 1;
        settings.iter().flatten().chain(&carried).for_each(|record| self.put(store, *record));
        if !store.write_log(0, &laid_out(kind::HEAD, 0, 0, [number, 0])) {
            self.next = RECORDS;
        }
    }

    /// Writes a record; where there is no room it is counted, and the log says that it is full.
    pub fn write(&mut self, store: &mut impl Store, record: Record) {
        use Event as E;
        let matters = matches!(
            record.event,
            E::Start { .. }
                | E::Burn { .. }
                | E::CutShort { .. }
                | E::ZeroOf { .. }
                | E::Zero { .. }
                | E::Program { .. }
                | E::Output { .. }
        );
        let room = if matters { RECORDS - 1 } else { RECORDS - RESERVED };
        if self.next >= room {
            // Reported once at the first flag without room, and once in the very last place.
            let first = !matters && self.next == room;
            if first || self.next == RECORDS - 1 {
                let event = Event::Lost { count: u16::from(first) };
                self.put(store, Record { event, ..record });
            }
            self.lost = self.lost.saturating_add(1);
            return;
        }
        self.put(store, record);
    }

    /// Writes a record and reads it back; `None`: there is no room for it. A log that could never be begun fails.
    pub fn write_and_read(&mut self, store: &mut impl Store, record: Record) -> Option<bool> {
        let at = self.next;
        self.write(store, record);
        if head(store.log()).is_none() {
            return Some(false);
        }
        let written = store.log().get(at * RECORD..(at + 1) * RECORD)?;
        (at < RECORDS - RESERVED).then_some(written == record.to_bytes())
    }

    fn put(&mut self, store: &mut impl Store, record: Record) {
        let at = self.next;
        // A place that could not be written is not tried again.
        self.next += 1;
        if !store.write_log(at * RECORD, &record.to_bytes()) {
            self.lost = self.lost.saturating_add(1);
        }
    }

    /// Events that were not written since the start.
    #[must_use]
    pub const fn lost(&self) -> u16 {
        self.lost
    }
}

/// Selects the flags to report: those that rise, once in [`PACE_S`] for each axis and for the unit.
#[derive(Debug, Clone, Default)]
pub struct Watch {
    before: ([AxisStatus; AXES], UnitStatus),
    /// Risen and not yet told.
    risen: ([AxisStatus; AXES], UnitStatus),
    /// Seconds until each may speak again.
    wait_s: [u32; AXES + 1],
}

impl Watch {
    /// A second: the status of axes and unit, and the temperatures. At most one event for each.
    pub fn second(
        &mut self,
        axes: [AxisStatus; AXES],
        unit: UnitStatus,
        temperature_c: [f32; AXES],
        mut tell: impl FnMut(Event),
    ) {
        self.wait_s.iter_mut().for_each(|w| *w = w.saturating_sub(1));
        for k in 0..AXES {
            self.risen.0[k] |= axes[k].difference(self.before.0[k]);
            if self.wait_s[k] == 0 && !self.risen.0[k].is_empty() {
                let flags = core::mem::take(&mut self.risen.0[k]);
                tell(Event::Axis { axis: k as u8, flags, temperature: temperature_c[k].to_bits() });
                self.wait_s[k] = PACE_S;
            }
        }
        self.risen.1 |= unit.difference(self.before.1);
        if self.wait_s[AXES] == 0 && !self.risen.1.is_empty() {
            tell(Event::Unit { flags: core::mem::take(&mut self.risen.1) });
            self.wait_s[AXES] = PACE_S;
        }
        self.before = (axes, unit);
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::power_cut::Power;
    use crate::sectors;
    use std::vec;
    use std::vec::Vec;

    /// Flash whose power may be cut.
    struct Memory {
        /// The log's sector, and the two of the calibrations.
        sectors: [Vec<u8>; 3],
        power: Power,
        erased: u32,
    }

    impl Memory {
        fn new(fill: u8) -> Self {
            Self { sectors: [vec![fill; SECTOR], vec![0xFF; SECTOR], vec![0xFF; SECTOR]], power: Power::ON, erased: 0 }
        }
        fn all(&self) -> Vec<Record> {
            records(&self.sectors[0]).collect()
        }
        fn erase(&mut self, sector: usize) -> bool {
            self.erased += 1;
            self.power.erase(&mut self.sectors[sector])
        }
        fn write(&mut self, sector: usize, offset: usize, bytes: &[u8]) -> bool {
            self.power.program(&mut self.sectors[sector][offset..], bytes)
        }
    }

    impl Store for Memory {
        fn log(&self) -> &[u8] {
            &self.sectors[0]
        }
        fn erase_log(&mut self) -> bool {
            self.erase(0)
        }
        fn write_log(&mut self, offset: usize, record: &[u8; RECORD]) -> bool {
            self.write(0, offset, record)
        }
    }

    impl sectors::Store for Memory {
        fn erase(&mut self, sector: sectors::Sector) -> bool {
            self.erase(1 + usize::from(sector.number()))
        }
        fn write(&mut self, at: sectors::Place, bytes: &[u8]) -> bool {
            self.write(1 + usize::from(at.sector.number()), at.offset as usize, bytes)
        }
        fn view(&self, sector: sectors::Sector) -> &[u8] {
            &self.sectors[1 + usize::from(sector.number())]
        }
    }

    fn event(k: u32) -> Record {
        Record { on_for_s: k, event: Event::Burn { answer: 0, calibration: k ^ 0x1234 } }
    }

    #[test]
    fn records_come_back_as_they_were() {
        let flags = AxisStatus::TEMPERATURE_RANGE | AxisStatus::NEIGHBOUR;
        for event in [
            Event::Start { cause: ResetCause::Watchdog, halt: Halt::Corruption, resets: 7, calibration: 0xDEAD_BEEF },
            Event::Axis { axis: 2, flags, temperature: 61.5f32.to_bits() },
            Event::Unit { flags: UnitStatus::ADC_FAULT },
            Event::Burn { answer: 7, calibration: 1 },
            Event::CutShort { place: 0x2_0400 },
            Event::Stopped(Piece { number: 3, value: 0x0801_2344 }),
            Event::Program { slot: 1, state: 2, sum: 0xABCD },
            Event::Lost { count: 3 },
        ] {
            let record = Record { on_for_s: 12_345, event };
            let bytes = record.to_bytes();
            assert_eq!(Record::from_bytes(&bytes), Some(record));
            for bit in 0..RECORD * 8 {
                let mut bad = bytes;
                bad[bit / 8] ^= 1 << (bit % 8);
                assert_eq!(Record::from_bytes(&bad), None);
            }
        }
        assert_eq!(Record::from_bytes(&[0xFF; RECORD]), None);
    }

    #[test]
    fn the_last_stop_is_that_of_the_newest_words() {
        let start = |halt| Event::Start { cause: ResetCause::Watchdog, halt, resets: 0, calibration: 0 };
        let fault = Stopped { halt: Halt::Fault, pc: 8, stack: 4, ..Stopped::default() };
        let other = Stopped { halt: Halt::Panic, line: 3, stack: 4, ..Stopped::default() }.in_file("a.rs");
        let told = |s: Stopped| std::iter::once(start(s.halt)).chain(s.pieces().map(Event::Stopped));
        let all = |events: Vec<Event>| last_stop(events.into_iter().map(|event| Record { on_for_s: 1, event }));
        assert_eq!(all(vec![start(Halt::None)]), None);
        assert_eq!(all(told(fault).chain(told(other)).collect()), Some(other));
        // A start without words, as after the same stop again.
        assert_eq!(all(told(other).chain(told(fault)).chain([start(Halt::Fault)]).collect()), Some(fault));
    }

    #[test]
    fn the_last_hundreds_are_kept_over_many_power_ons() {
        let mut store = Memory::new(0xA5);
        let mut k = 0;
        for _ in 0..40 {
            let mut journal = Journal::open(&mut store, true);
            for _ in 0..200 {
                journal.write(&mut store, event(k));
                k += 1;
            }
            assert_eq!(journal.lost(), 0);
            let all = store.all();
            let expected: Vec<Record> = (k - all.len() as u32..k).map(event).collect();
            assert_eq!(all, expected);
            assert!(k < 456 || all.len() >= CARRIED + 200, "{}", all.len());
        }
        // Once in half a sector.
        assert!(store.erased <= 1 + 8000 / 512, "{}", store.erased);
    }

    #[test]
    fn a_full_log_takes_no_more_and_counts() {
        let mut store = Memory::new(0xFF);
        let mut journal = Journal::open(&mut store, true);
        let flag = |k: u32| Record { on_for_s: k, event: Event::Unit { flags: UnitStatus::ADC_FAULT } };
        (0..1000).for_each(|k| journal.write(&mut store, flag(k)));
        let printed = |store: &Memory, count| store.all().iter().filter(|r| r.event == Event::Lost { count }).count();
        assert_eq!((printed(&store, 1), printed(&store, 0)), (1, 0));
        // Starts and burns have places of their own.
        (0..1000).for_each(|k| journal.write(&mut store, event(k)));
        assert_eq!((printed(&store, 1), printed(&store, 0)), (1, 1));
        assert_eq!(store.all().len() + usize::from(journal.lost()), 2002);
        assert_eq!(store.all().len(), RECORDS - 1);
        // A restart in flight does not erase either.
        let journal = Journal::open(&mut store, false);
        assert_eq!((store.erased, journal.next), (0, RECORDS), "no erase in flight");
        let mut journal = Journal::open(&mut store, true);
        assert_eq!((store.erased, journal.next), (1, CARRIED + 1));
        journal.write(&mut store, event(7));
        assert_eq!((store.all().len(), store.all().last()), (CARRIED + 1, Some(&event(7))));
        // A sector that holds no log is not erased in flight.
        let mut foreign = Memory::new(0xA5);
        assert_eq!((Journal::open(&mut foreign, false).next, foreign.erased, foreign.all().len()), (RECORDS, 0, 0));
    }

    #[test]
    fn a_cut_at_any_operation_loses_no_constants_and_at_most_the_older_events() {
        // From a log that is about to be begun anew: some records, the constants, more records, a power-on with its erase, some more.
        let set = zero::Zero { made_unix_s: 9, constant_dph: [1.0, -2.0, 0.5], ..zero::Zero::default() };
        let mut ready = Memory::new(0xFF);
        let mut journal = Journal::open(&mut ready, true);
        (0..100).for_each(|k| journal.write(&mut ready, event(k)));
        zero::records(&set, 7, 1).into_iter().for_each(|record| journal.write(&mut ready, record));
        let sent = OutputSettings { increments: 5, ..OutputSettings::default() };
        journal.write(&mut ready, Record { on_for_s: 1, event: Event::Output { settings: sent.word() } });
        (100..800).for_each(|k| journal.write(&mut ready, event(k)));
        let newest = |store: &Memory| zero::newest(store.all(), 7).map(|z| z.constant_dph);
        assert_eq!(newest(&ready), Some(set.constant_dph));
        for left in (1..90).chain(80 + CARRIED as u32 * 4 - 20..80 + CARRIED as u32 * 4 + 70) {
            let mut store = Memory { sectors: ready.sectors.clone(), power: Power { left }, erased: 0 };
            let mut journal = Journal::open(&mut store, true);
            (800..810).for_each(|k| journal.write(&mut store, event(k)));
            // Power comes back, and is cut there, too.
            let cut = store.power.left == 0;
            for left in if cut { [left % 60 + 1, u32::MAX] } else { [u32::MAX; 2] } {
                store.power.left = left;
                let _ = Journal::open(&mut store, true);
            }
            let mut journal = Journal::open(&mut store, true);
            journal.write(&mut store, event(9999));
            assert_eq!(store.all().last(), Some(&event(9999)), "cut after {left}");
            assert_eq!(newest(&store), Some(set.constant_dph), "cut after {left}");
            assert_eq!(crate::output::newest(store.all()), Some(sent), "cut after {left}");
            assert!(cut || store.all().len() > CARRIED + 10, "cut after {left}");
        }
    }

    #[test]
    fn flags_are_logged_when_they_rise_and_not_more_than_once_a_minute() {
        let mut watch = Watch::default();
        let mut logged = Vec::new();
        for second in 0..600 {
            let flicker = if second % 2 == 0 { AxisStatus::EDGE_ERRORS } else { AxisStatus::empty() };
            let once = if second == 30 { AxisStatus::FREQUENCY_LOST } else { AxisStatus::empty() };
            let axes = [flicker | once, AxisStatus::empty(), AxisStatus::empty()];
            watch.second(axes, UnitStatus::IMAGE_REFUSED, [20.0; 3], |e| logged.push((second, e)));
        }
        let unit: Vec<_> = logged.iter().filter(|(_, e)| matches!(e, Event::Unit { .. })).collect();
        assert_eq!(unit, [&(0, Event::Unit { flags: UnitStatus::IMAGE_REFUSED })]);
        let axis: Vec<_> = logged.iter().filter(|(_, e)| matches!(e, Event::Axis { .. })).collect();
        assert_eq!(axis.len(), 10, "{axis:?}");
        let lost = axis
            .iter()
            .any(|(_, e)| matches!(e, Event::Axis { flags, .. } if flags.contains(AxisStatus::FREQUENCY_LOST)));
        assert!(lost, "nothing that rose is forgotten");
    }
}
