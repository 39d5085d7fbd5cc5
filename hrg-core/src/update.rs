//! New programs over the link: into the slot that does not run.
//!
//! # From the first byte to the confirmation
//! 1. [`Update::begin`] empties the other slot, a sector at a time (2 s at most each, in which the processor stands still), and writes down what comes:
//!    length and sum. Where that is what it was told before, it goes on where the last piece ended: after a pulled cable, or a power cut.
//! 2. [`Update::chunk`] programs a piece. Rates go on meanwhile.
//! 3. [`Update::end`] checks the program where it lies: its head (slot, board, version), its sum, and its signature where the unit has a [`Key`]. Then it
//!    puts signature, what is expected of it ([`Condition`]), the number and, last, the mark that commits it beside it.
//! 4. At the next start the loader marks it as tried and starts it ([`crate::slots`]).
//! 5. The new program is on [`Trial`]: it confirms itself when it does what the one before did, and a host has sent back the token that it has received from it. After [`TRIAL_S`] without
//!    that it starts anew, and the loader takes the one before. So does any reset meanwhile, that of the watchdog among them.
//!
//! Nothing is copied, and the slot that runs is never written to, but for numbers and its own confirmation. A power cut at any moment leaves the program that ran before,
//! or a new one that is complete and was checked.
//!
//! # Why not embassy-boot
//! Its swap moves pages between two partitions, a page being the largest sector that either has: 128 KiB here (embassy issue 3855). That leaves no room for two
//! programs, and wears each sector out by an update. Here both slots run in place, and an update file holds the program linked for each.
//!
//! # Example
//! ```
//! use hrg_core::update::{Condition, Trial, Verdict};
//!
//! let good = Condition { rates: true, calibrated: true, echoed: true };
//! let mut trial = Trial::new(good.bits());
//! // It has to do so for some seconds, one after the other.
//! let verdicts: Vec<_> = (0..3).map(|_| trial.second(good)).collect();
//! assert_eq!(verdicts, [Verdict::Wait, Verdict::Wait, Verdict::Confirm]);
//! ```

use crate::maintenance::{Answer, Command, CHUNK};
use crate::signature::{Key, SIGNATURE};
use crate::slots::{self, head, mark, next_number, numbered, Slot, State, COMMITTED, CONFIRMED, ERASED, HEAD, MAGIC};

/// A new program has so many seconds to confirm itself.
pub const TRIAL_S: u32 = 60;
/// It has to be good for so many, one after the other.
const GOOD_S: u32 = 3;

/// A confirmation that cannot be written (the supply is low, say) is tried again until so many seconds after that.
const PATIENCE_S: u32 = 10;

/// Sectors of a slot.
pub const SECTORS: usize = 2;

/// The two slots in flash. What is not overridden is that of a unit that has none, and takes no programs.
pub trait Store {
    /// Slot whose program runs (0: A, 1: B).
    fn own(&self) -> usize {
        0
    }
    /// A slot, and its address.
    fn slot(&self, _slot: usize) -> (&[u8], u32) {
        (&[], 0)
    }
    /// Erases one of its [`SECTORS`]. `false`: it failed.
    fn erase_slot(&mut self, _slot: usize, _sector: usize) -> bool {
        false
    }
    /// Programs bytes at an offset, in their order; both multiples of four. `false`: it failed.
    fn write_slot(&mut self, _slot: usize, _offset: usize, _bytes: &[u8]) -> bool {
        false
    }
}

/// Program that is being received.
#[derive(Debug, Clone, Copy)]
struct Coming {
    total: u32,
    /// Bytes that are there.
    next: u32,
}

/// Receives programs.
#[derive(Debug)]
pub struct Update {
    key: Option<Key>,
    coming: Option<Coming>,
    /// Length and sum of the program that the slot is emptied for, and its sectors that were erased.
    emptied: (u32, u32, usize),
}

impl Update {
    /// Receives nothing yet. `key`: takes only what it has signed.
    #[must_use]
    pub const fn new(key: Option<Key>) -> Self {
        Self { key, coming: None, emptied: (0, 0, 0) }
    }

    /// So many bytes will come, from the head to the program's end, with this sum. Gives the number of bytes that are there already;
    /// [`Answer::More`]: a sector was emptied, and the command is to be given again.
    pub fn begin(&mut self, total: u32, sum: u32, store: &mut impl Store) -> (Answer, u32) {
        self.coming = None;
        let (own, other) = (store.own(), 1 - store.own());
        if Slot(store.slot(own).0).state() != State::Confirmed {
            return (Answer::Trial, 0);
        }
        let room = (0..2).map(|s| store.slot(s).0.len()).min().unwrap_or(0).saturating_sub(HEAD);
        if total as usize > room || (total as usize) < slots::TABLE - HEAD + 8 || !total.is_multiple_of(4) {
            return (Answer::Length, room as u32);
        }
        let slot = Slot(store.slot(other).0);
        let marks = [slot.word(mark::LENGTH), slot.word(mark::SUM), slot.word(mark::COMMITTED)];
        if marks == [total, sum, ERASED] {
            let there = slot.0.get(HEAD..HEAD + total as usize).unwrap_or_default();
            // The last piece that has begun is written once more: the same over what is there of it.
            let last = there.iter().rposition(|b| *b != 0xFF).unwrap_or(0);
            let next = (last / CHUNK * CHUNK) as u32;
            self.coming = Some(Coming { total, next });
            return (Answer::Done, next);
        }
        // (Each sector is erased, even one that looks blank: an erase that a power cut has ended may read so, and not hold.)
        let (of_length, of_sum, done) = self.emptied;
        let done = if (of_length, of_sum) == (total, sum) { done } else { 0 };
        if done < SECTORS {
            let erased = store.erase_slot(other, done);
            self.emptied = (total, sum, done + usize::from(erased));
            return (if erased { Answer::More } else { Answer::Flash }, done as u32);
        }
        self.emptied = (0, 0, 0);
        let mut word = |at: usize, word: u32| store.write_slot(other, at, &word.to_le_bytes());
        if !(word(mark::SUM, sum) && word(mark::LENGTH, total)) {
            return (Answer::Flash, 0);
        }
        self.coming = Some(Coming { total, next: 0 });
        (Answer::Done, 0)
    }

    /// A piece of it. Gives the number of bytes that are there now.
    pub fn chunk(&mut self, offset: u32, length: u8, data: &[u8; CHUNK], store: &mut impl Store) -> (Answer, u32) {
        let Some(Coming { total, next }) = self.coming else { return (Answer::Order, 0) };
        let end = offset.saturating_add(length.into());
        // (Its answer was lost.)
        if end == next && offset < next {
            return (Answer::Done, next);
        }
        let Some(bytes) = data.get(..usize::from(length)).filter(|b| !b.is_empty() && b.len() % 4 == 0) else {
            return (Answer::Order, next);
        };
        if offset != next || end > total {
            return (Answer::Order, next);
        }
        let blank = bytes.iter().all(|b| *b == 0xFF);
        if !blank && !store.write_slot(1 - store.own(), HEAD + offset as usize, bytes) {
            self.coming = None;
            return (Answer::Flash, 0);
        }
        self.coming = Some(Coming { total, next: end });
        (Answer::Done, end)
    }

    /// The program is complete: checks it where it lies, and has the next start try it. Gives its version. `expected`: what it must have to confirm itself.
    pub fn end(&mut self, signature: &[u8; SIGNATURE], expected: Condition, store: &mut impl Store) -> (Answer, u32) {
        let Some(Coming { total, next }) = self.coming else { return (Answer::Order, 0) };
        if next != total {
            return (Answer::Order, next);
        }
        self.coming = None;
        let other = 1 - store.own();
        if let Err(answer) = self.judge(signature, total, store) {
            // It is not gone on with: what comes next begins with an erase.
            store.write_slot(other, mark::LENGTH, &[0; 4]);
            return (answer, 0);
        }
        let number = next_number([0, 1].map(|s| Slot(store.slot(s).0)));
        let Some((number, place)) = number.zip(Slot(store.slot(other).0).number_place()) else {
            return (Answer::Flash, 0);
        };
        let written = store.write_slot(other, mark::SIGNATURE, signature)
            && store.write_slot(other, mark::EXPECTED, &u32::from(expected.bits()).to_le_bytes())
            && store.write_slot(other, place, &numbered(number).to_le_bytes())
            && store.write_slot(other, mark::COMMITTED, &COMMITTED.to_le_bytes());
        let slot = Slot(store.slot(other).0);
        if written && slot.state() == State::New && slot.number() == number {
            (Answer::Done, slot.version())
        } else {
            (Answer::Flash, 0)
        }
    }

    /// Checks the program that has come.
    #[inline(never)]
    fn judge(&self, signature: &[u8; SIGNATURE], total: u32, store: &impl Store) -> Result<(), Answer> {
        let own = Slot(store.slot(store.own()).0);
        let (bytes, address) = store.slot(1 - store.own());
        let slot = Slot(bytes);
        let body = slot.body().filter(|body| body.len() == total as usize).ok_or(Answer::Program)?;
        if slot.word(head::MAGIC) != MAGIC || slots::sum(body) != slot.word(mark::SUM) {
            return Err(Answer::Program);
        }
        // (Before the rest: nothing is told of what somebody else has made.)
        if self.key.is_some_and(|key| !key.has_signed(body, signature)) {
            return Err(Answer::Signature);
        }
        if slot.word(head::ADDRESS) != address || slot.text(head::BOARD) != own.text(head::BOARD) {
            return Err(Answer::Board);
        }
        if slot.version() < own.version() {
            return Err(Answer::Older);
        }
        Ok(())
    }

    /// The program in the other slot is put into use again, from the next start on. Gives its version. (A unit with a key asks for the signature with which it
    /// came: it may have come before the key.)
    pub fn roll_back(&mut self, store: &mut impl Store) -> (Answer, u32) {
        self.coming = None;
        if !has_other(store) {
            return (Answer::NoProgram, 0);
        }
        let other = 1 - store.own();
        let slot = Slot(store.slot(other).0);
        if self.key.is_some_and(|key| !signed_as_it_came(&key, &slot)) {
            return (Answer::Signature, 0);
        }
        let version = slot.version();
        let number = next_number([0, 1].map(|s| Slot(store.slot(s).0)));
        match number.zip(slot.number_place()) {
            Some((n, at)) if store.write_slot(other, at, &numbered(n).to_le_bytes()) => (Answer::Done, version),
            _ => (Answer::Flash, 0),
        }
    }
}

/// `true` if the other slot has a whole program that has once confirmed itself: the way back.
pub fn has_other(store: &impl Store) -> bool {
    let slot = Slot(store.slot(1 - store.own()).0);
    slot.state() == State::Confirmed && slot.body().is_some_and(|body| slots::sum(body) == slot.word(mark::SUM))
}

/// `true` if a key has signed the program of a slot, by the signature that lies beside it.
fn signed_as_it_came(key: &Key, slot: &Slot<'_>) -> bool {
    let signature = slot.0.get(mark::SIGNATURE..).and_then(<[u8]>::first_chunk);
    slot.body().zip(signature).is_some_and(|(body, signature)| key.has_signed(body, signature))
}

/// The command that sends the piece of a program from an offset on; `None`: there is none.
#[must_use]
pub fn piece(body: &[u8], offset: u32) -> Option<Command> {
    let rest = body.get(offset as usize..).filter(|rest| !rest.is_empty())?;
    let mut data = [0xFF; CHUNK];
    let length = data.iter_mut().zip(rest).map(|(to, from)| *to = *from).count();
    Some(Command::Piece { offset, length: length as u8, data })
}

/// Confirms the program that runs. `false`: the flash could not be written.
pub fn confirm(store: &mut impl Store) -> bool {
    let own = store.own();
    store.write_slot(own, mark::CONFIRMED, &CONFIRMED.to_le_bytes())
        && Slot(store.slot(own).0).state() == State::Confirmed
}

/// Actions of a unit that the next program has to do as well.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condition {
    /// Samples come and rates go out.
    pub rates: bool,
    /// It has a calibration.
    pub calibrated: bool,
    /// A host has shown since the start that it receives from the unit, and the unit from it.
    pub echoed: bool,
}

impl Condition {
    /// As bits.
    #[must_use]
    pub const fn bits(self) -> u8 {
        self.rates as u8 | (self.calibrated as u8) << 1 | (self.echoed as u8) << 2
    }
}

/// Programs of a unit: the one that runs, and the one in the other slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Programs {
    /// Slot whose program runs: 0: A, 1: B.
    pub slot: u8,
    /// Its state ([`State`]).
    pub state: u8,
    /// Its version ([`version_number`]).
    pub version: u32,
    /// Its sum.
    pub sum: u32,
    /// Its name.
    pub name: [u8; head::TEXT],
    /// The same of the program in the other slot.
    pub other_state: u8,
    /// Version.
    pub other_version: u32,
    /// Sum.
    pub other_sum: u32,
    /// Name.
    pub other_name: [u8; head::TEXT],
    /// Number that a host sends back to show that it receives from the unit ([`crate::maintenance::Command::Echo`]).
    pub token: u32,
}

impl Programs {
    /// As they lie in flash.
    #[must_use]
    pub fn of((number, slots): (usize, [Slot<'_>; 2]), token: u32) -> Self {
        let [a, b] = slots;
        let [own, other] = if number == 0 { [a, b] } else { [b, a] };
        let there = other.state() != State::Empty;
        let of_other = |word: u32| if there { word } else { 0 };
        Self {
            slot: number as u8,
            state: own.state() as u8,
            version: own.version(),
            sum: own.word(mark::SUM),
            name: own.text(head::NAME),
            other_state: other.state() as u8,
            other_version: of_other(other.version()),
            other_sum: of_other(other.word(mark::SUM)),
            other_name: if there { other.text(head::NAME) } else { [0; head::TEXT] },
            token,
        }
    }
}

/// A version as its number: those of cargo, each part below 1000.
#[must_use]
pub const fn version_number(major: u32, minor: u32, patch: u32) -> u32 {
    (major * 1000 + minor) * 1000 + patch
}

/// Verdict on a program that is on trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is too early to say.
    Wait,
    /// It is good.
    Confirm,
    /// It had its time.
    GiveUp,
}

/// The trial of a program that runs for the first time.
#[derive(Debug, Clone)]
pub struct Trial {
    /// Bits of the [`Condition`] that it has to reach. That a host receives from it, and it from the host, is always one of them: a program that hears nothing, or says nothing, could
    /// not be replaced any more.
    expected: u8,
    seconds: u32,
    good: u32,
}

impl Trial {
    /// Begins. `expected`: as the mark `EXPECTED` holds it.
    #[must_use]
    pub const fn new(expected: u8) -> Self {
        Self { expected: expected & 0b11 | 0b100, seconds: 0, good: 0 }
    }

    /// Begins anew: there is no program to go back to.
    pub fn again(&mut self) {
        (self.seconds, self.good) = (0, 0);
    }

    /// A second has gone by.
    pub fn second(&mut self, now: Condition) -> Verdict {
        self.seconds = self.seconds.saturating_add(1);
        self.good = if now.bits() & self.expected == self.expected { self.good + 1 } else { 0 };
        if self.good >= GOOD_S && self.seconds < TRIAL_S + PATIENCE_S {
            Verdict::Confirm
        } else if self.seconds >= TRIAL_S {
            Verdict::GiveUp
        } else {
            Verdict::Wait
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::power_cut::Power;
    use crate::slots::{chosen, order, Choice, ADDRESSES};
    use std::vec;
    use std::vec::Vec;

    const SECTOR: usize = 2048;
    const GOOD: Condition = Condition { rates: true, calibrated: true, echoed: true };

    /// Two slots of two small sectors, whose power may be cut.
    #[derive(Clone)]
    struct Memory {
        slots: [Vec<u8>; 2],
        runs: usize,
        power: Power,
    }

    impl Memory {
        /// A unit that runs a program in slot A.
        fn new(version: u32) -> Self {
            let mut slots = [vec![0xFF; 2 * SECTOR], vec![0xA5; 2 * SECTOR]];
            let program = program(0, version, 700);
            slots[0][HEAD..HEAD + program.len()].copy_from_slice(&program);
            let mut put = |at: usize, word: u32| slots[0][at..at + 4].copy_from_slice(&word.to_le_bytes());
            put(mark::SUM, slots::sum(&program));
            put(mark::COMMITTED, COMMITTED);
            put(mark::TRIED, 0);
            put(mark::CONFIRMED, CONFIRMED);
            put(mark::NUMBERS, numbered(1));
            Self { slots, runs: 0, power: Power::ON }
        }
        fn both(&self) -> [Slot<'_>; 2] {
            [Slot(&self.slots[0]), Slot(&self.slots[1])]
        }
        /// Does as the loader does: gives the slot that it starts.
        fn start(&mut self) -> usize {
            self.start_after(true)
        }
        fn start_after(&mut self, restarted: bool) -> usize {
            let order = order(self.both(), restarted);
            let fit = |Choice { slot, trial, .. }: Choice| {
                let s = Slot(&self.slots[slot]);
                let whole = s.body().is_some_and(|body| slots::sum(body) == s.word(mark::SUM));
                if whole && trial {
                    self.slots[slot][mark::TRIED] = 0;
                }
                whole
            };
            self.runs = chosen(order, fit).expect("there is always a program that runs");
            self.runs
        }
        fn version(&self) -> u32 {
            Slot(&self.slots[self.runs]).version()
        }
    }

    impl Store for Memory {
        fn own(&self) -> usize {
            self.runs
        }
        fn slot(&self, slot: usize) -> (&[u8], u32) {
            (&self.slots[slot], ADDRESSES[slot])
        }
        fn erase_slot(&mut self, slot: usize, sector: usize) -> bool {
            assert_ne!(slot, self.runs, "never the one that runs");
            self.power.erase(&mut self.slots[slot][sector * SECTOR..][..SECTOR])
        }
        fn write_slot(&mut self, slot: usize, offset: usize, bytes: &[u8]) -> bool {
            assert!(slot != self.runs || offset < HEAD, "never the one that runs");
            self.power.program(&mut self.slots[slot][offset..], bytes)
        }
    }

    /// A program for a slot, from its head on.
    fn program(slot: usize, version: u32, length: usize) -> Vec<u8> {
        let mut out: Vec<u8> = (0..length).map(|k| (k as u32 * 7 + version) as u8).collect();
        let mut put = |at: usize, bytes: &[u8]| out[at - HEAD..at - HEAD + bytes.len()].copy_from_slice(bytes);
        put(head::MAGIC, &MAGIC.to_le_bytes());
        put(head::LENGTH, &(length as u32).to_le_bytes());
        put(head::ADDRESS, &ADDRESSES[slot].to_le_bytes());
        put(head::VERSION, &version.to_le_bytes());
        put(head::BOARD, &[7; head::TEXT]);
        out
    }

    /// A host that sends a program until the unit has it, or stops it.
    fn send(update: &mut Update, store: &mut Memory, program: &[u8]) -> (Answer, u32) {
        let begin = |update: &mut Update, store: &mut Memory| loop {
            match update.begin(program.len() as u32, slots::sum(program), store) {
                (Answer::More, _) => {}
                other => return other,
            }
        };
        let (answer, mut next) = begin(update, store);
        if answer != Answer::Done {
            return (answer, next);
        }
        while (next as usize) < program.len() {
            let Some(Command::Piece { offset, length, data }) = piece(program, next) else {
                unreachable!("there is more")
            };
            match update.chunk(offset, length, &data, store) {
                (Answer::Done, n) => next = n,
                other => return other,
            }
        }
        update.end(&[3; SIGNATURE], GOOD, store)
    }

    #[test]
    fn a_new_program_is_tried_once_and_confirms_itself() {
        let mut store = Memory::new(5);
        for (version, runs) in [(6, 1), (7, 0), (7, 1)] {
            let new = program(runs, version, 1000);
            assert_eq!(send(&mut Update::new(None), &mut store, &new), (Answer::Done, version));
            let before = store.clone();
            assert_eq!(store.start(), runs);
            assert_eq!(Update::new(None).begin(1000, 9, &mut store), (Answer::Trial, 0), "the way back stays");
            // It does not confirm itself: the one before comes back.
            assert_eq!(store.clone().start(), 1 - runs);
            assert!(confirm(&mut store));
            assert_eq!(store.start(), runs);
            // Back, and forth.
            let mut old = store.clone();
            assert_eq!(Update::new(None).roll_back(&mut old).0, Answer::Done);
            assert_eq!(old.start(), 1 - runs);
            assert_eq!(Update::new(None).roll_back(&mut old), (Answer::Done, version));
            assert_eq!(old.start(), runs);
            // With the sum of the one that was tried and failed nothing is put into use again.
            let mut failed = before;
            failed.start();
            failed.start();
            assert_eq!(Update::new(None).roll_back(&mut failed), (Answer::NoProgram, 0));
        }
    }

    /// The marks are in no sum.
    #[test]
    fn a_mark_that_has_lost_some_bits_still_counts_and_is_seen() {
        for mark in [mark::COMMITTED, mark::CONFIRMED] {
            for (one, two) in (0..32).flat_map(|one| (0..32).map(move |two| (one, two))) {
                let mut store = Memory::new(5);
                let mut word = Slot(&store.slots[0]).word(mark);
                word ^= 1 << one;
                word ^= if one == two { 0 } else { 1 << two };
                store.slots[0][mark..mark + 4].copy_from_slice(&word.to_le_bytes());
                assert_eq!(store.start(), 0);
                let slot = Slot(&store.slots[0]);
                assert_eq!((slot.state(), slot.marks_sound()), (State::Confirmed, false));
            }
        }
        assert!(Slot(&Memory::new(5).slots[0]).marks_sound());
    }

    #[test]
    fn a_program_that_has_failed_is_not_started_for_one_that_has_changed() {
        let mut store = Memory::new(5);
        assert_eq!(send(&mut Update::new(None), &mut store, &program(1, 6, 1000)).0, Answer::Done);
        assert_eq!(store.start(), 1, "tried");
        store.slots[0][HEAD + 400] ^= 1;
        assert_eq!(store.start(), 0, "it has changed, and says so");
        // A new one goes before one that has changed.
        let mut store = Memory::new(5);
        assert_eq!(send(&mut Update::new(None), &mut store, &program(1, 6, 1000)).0, Answer::Done);
        store.slots[0][HEAD + 400] ^= 1;
        assert_eq!(store.start(), 1);
    }

    #[test]
    fn a_program_is_tried_when_it_is_restarted_into_and_at_no_other_reset() {
        let mut store = Memory::new(5);
        assert_eq!(send(&mut Update::new(None), &mut store, &program(1, 6, 1000)).0, Answer::Done);
        assert_eq!([store.start_after(false), store.start_after(false)], [0; 2]);
        // The one that runs is started even if it has changed.
        let mut changed = store.clone();
        changed.slots[0][HEAD + 400] ^= 1;
        assert_eq!(changed.start_after(false), 0);
        assert_eq!(store.start_after(true), 1);
    }

    #[test]
    fn a_trial_ends_even_where_nothing_can_be_confirmed() {
        let mut trial = Trial::new(GOOD.bits());
        let verdicts: Vec<Verdict> = (0..100).map(|_| trial.second(GOOD)).collect();
        let end = (TRIAL_S + PATIENCE_S) as usize - 1;
        assert!(verdicts[3..end].iter().all(|v| *v == Verdict::Confirm));
        assert!(verdicts[end..].iter().all(|v| *v == Verdict::GiveUp));
        trial.again();
        let again: Vec<Verdict> = (0..3).map(|_| trial.second(GOOD)).collect();
        assert_eq!(again, [Verdict::Wait, Verdict::Wait, Verdict::Confirm]);
    }

    /// A unit had an unsigned program before it got one with a key.
    #[cfg(feature = "signed")]
    #[test]
    fn a_unit_with_a_key_does_not_go_back_to_what_nobody_has_signed() {
        let mut store = Memory::new(5);
        assert_eq!(send(&mut Update::new(None), &mut store, &program(1, 6, 1000)).0, Answer::Done);
        store.start();
        assert!(confirm(&mut store));
        let key = Key::new([7; 32]);
        assert_eq!(Update::new(Some(key)).roll_back(&mut store).0, Answer::Signature);
        assert_eq!(store.start(), 1);
        assert_eq!(Update::new(None).roll_back(&mut store).0, Answer::Done, "without a key");
    }

    #[test]
    fn what_is_not_for_this_unit_is_refused_and_what_runs_stays() {
        let mut store = Memory::new(5);
        let good = program(1, 6, 1000);
        let changed = |at: usize, byte: u8| {
            let mut p = good.clone();
            p[at - HEAD] ^= byte;
            p
        };
        for (bad, answer) in [
            (program(1, 4, 1000), Answer::Older),
            (program(0, 6, 1000), Answer::Board),
            (changed(head::BOARD + 31, 1), Answer::Board),
            (changed(head::MAGIC, 1), Answer::Program),
            (changed(head::LENGTH, 4), Answer::Program),
            (vec![0x5A; 2 * 2 * SECTOR], Answer::Length),
            (vec![0x5A; 64], Answer::Length),
            (vec![0x5A; 1002], Answer::Length),
        ] {
            assert_eq!(send(&mut Update::new(None), &mut store, &bad).0, answer);
            assert_eq!(store.start(), 0);
            assert_eq!(store.version(), 5);
        }
        // The sum that was told is not that of what came.
        let mut update = Update::new(None);
        while update.begin(good.len() as u32, 1, &mut store).0 == Answer::More {}
        assert_eq!(update.end(&[0; SIGNATURE], GOOD, &mut store), (Answer::Order, 0), "nothing came");
        assert_eq!(send(&mut Update::new(None), &mut store, &good), (Answer::Done, 6), "and a good one is taken");
        assert_eq!(Update::new(None).chunk(0, 4, &[0; CHUNK], &mut store).0, Answer::Order, "without begin");
    }

    #[test]
    fn an_update_that_is_cut_short_anywhere_goes_on_where_it_was() {
        let new = program(1, 6, 2900);
        let mut whole = Memory::new(5);
        whole.power.left = 1_000_000;
        assert_eq!(send(&mut Update::new(None), &mut whole, &new), (Answer::Done, 6));
        let operations = 1_000_000 - whole.power.left;
        for left in 1..=operations + 1 {
            let mut store = Memory::new(5);
            store.power.left = left;
            let answer = send(&mut Update::new(None), &mut store, &new).0;
            let committed = left > operations;
            assert_eq!(answer == Answer::Done, committed, "cut after {left}");
            store.power.left = u32::MAX;
            // A start finds one of the two, whole.
            let runs = store.start();
            assert!(runs == 0 && store.version() == 5 || runs == 1 && store.version() == 6 && left >= operations);
            if runs == 1 {
                continue;
            }
            let before = store.clone();
            assert_eq!(send(&mut Update::new(None), &mut store, &new), (Answer::Done, 6), "cut after {left}");
            assert_eq!((store.start(), store.version()), (1, 6));
            // Most of it was not sent twice.
            let (_, there) = Update::new(None).begin(2900, slots::sum(&new), &mut before.clone());
            let sent = left.saturating_sub(4 + 2) * 4;
            assert!(
                left >= operations - 20 || there + 2 * CHUNK as u32 + 8 >= sent,
                "cut after {left}: {there} of {sent}"
            );
        }
    }

    #[test]
    fn a_trial_asks_for_what_the_program_before_did_and_for_a_host() {
        let run = |expected: u8, condition: fn(u32) -> Condition| {
            let mut trial = Trial::new(expected);
            (1..).map(|s| (s, trial.second(condition(s)))).find(|(_, v)| *v != Verdict::Wait).expect("an end")
        };
        let none = Condition { rates: false, calibrated: false, echoed: false };
        assert_eq!(run(GOOD.bits(), |_| GOOD), (3, Verdict::Confirm));
        assert_eq!(run(GOOD.bits(), |s| Condition { echoed: s > 40, ..GOOD }), (43, Verdict::Confirm));
        assert_eq!(run(GOOD.bits(), |s| Condition { rates: s % 3 > 0, ..GOOD }), (TRIAL_S, Verdict::GiveUp));
        assert_eq!(run(GOOD.bits(), |_| Condition { calibrated: false, ..GOOD }), (TRIAL_S, Verdict::GiveUp));
        // A unit without rates or calibration is not asked for them; but for a host always.
        assert_eq!(
            run(none.bits(), |_| Condition { echoed: true, rates: false, calibrated: false }),
            (3, Verdict::Confirm)
        );
        assert_eq!(run(none.bits(), |_| Condition { echoed: false, ..GOOD }), (TRIAL_S, Verdict::GiveUp));
    }
}
