//! Maintenance mode: a calibration into the unit over the link.
//!
//! # Newest valid wins
//! An image is appended behind what its sector holds ([`crate::sectors`]); where there is no room, the *other* sector is erased and the
//! image goes to its start. So the newest valid image is never written to nor erased. A new one counts only once its first word stands
//! before it. That word is programmed last, after the image was found to be one of this unit, valid, newer, and signed where
//! the firmware wants it. So a power cut at any moment leaves the old image or the new one, never neither; and an image that is refused
//! never counts, whatever comes. The sequence number counts burns.
//!
//! # Who may write
//! No command is executed before [`Command::Open`] has named the unit as its image names it, and none while it moves ([`crate::still`]), unless its service pin is
//! tied low: so nobody on the link can open the mode of a unit in flight. A build with the firmware's feature
//! `locked` refuses that too; one with the feature `signed` takes only images that the owner of its key has signed. Chunks come in order;
//! one that is repeated (its answer was lost) is answered again and not written twice.
//!
//! # Example
//! ```
//! use hrg_core::maintenance::{burn, chunks, Command, CHUNK};
//! use hrg_core::unit_name::UnitName;
//!
//! // What a host sends to write an image: open, begin, its chunks, end.
//! let image = [7; 300];
//! assert_eq!(chunks(&image).count(), image.len().div_ceil(CHUNK));
//! let commands: Vec<Command> = burn(UnitName::new("HRG-042"), &image).collect();
//! assert_eq!(commands.first(), Some(&Command::Open(UnitName::new("HRG-042"))));
//! assert_eq!((commands.len(), commands.last()), (6, Some(&Command::End)));
//! ```

use crate::calibration::{stated_length, Calibration, ImageError, COMMIT, MAX_BYTES, REFUSED};
use crate::inputs::QuantitySet;
use crate::output::{Framing, OutputSettings};
use crate::sectors::{make_room, page, sequences, stored_checksum, Place, Sector, Store, PAGE};
use crate::self_test::{Item, Items};
use crate::signature::{behind, Key, SIGNATURE};
use crate::unit_name::UnitName;
use crate::update::{self, Condition, Update};
use crate::zero::Zero;

/// Bytes of a chunk.
pub const CHUNK: usize = 128;

/// The first of the pages that [`Command::Read`] has for the field log: four.
pub const LOG_PAGE: u8 = 248;

/// An image's number may be beyond that of the newest one by so much: a slip of a host must not use up the numbers, and an image that was signed
/// long ago must not become the newer one again.
pub const MOST_STEP: u32 = 1000;

/// The number that stands for no place.
pub const NOWHERE: u32 = u32::MAX;

fn number(place: Option<Place>) -> u32 {
    place.map_or(NOWHERE, Place::number)
}

/// Maintenance command of the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Enter maintenance mode; names the unit. Answered with the place of the image in use ([`Place::number`]).
    Open(UnitName),
    /// Leave it.
    Close,
    /// So many bytes will come: an image, and its signature where it has one. Answered with the place that they go to. Erases the other
    /// sector where there is no room in that of the newest image.
    Begin(u16),
    /// A piece of it.
    Chunk {
        /// Offset in what comes.
        offset: u16,
        /// Bytes in use.
        length: u8,
        /// The bytes.
        data: [u8; CHUNK],
    },
    /// The image is complete: check it where it lies.
    End,
    /// Read a piece of a sector.
    Read {
        /// Number of the page ([`page`]).
        page: u8,
        /// Offset in it.
        offset: u16,
    },
    /// Start anew, with the newest image.
    Restart,
    /// Ask for the image that runs from the next start on. Answered with its place.
    Newest,
    /// Renew the constants ([`crate::zero`]).
    Zero(Zero),
    /// Do the built-in test ([`crate::self_test`]). Answered when it has ended, some four seconds later ([`Reply::TestDone`]).
    Test,
    /// Ask for an item of the test that was done last, by its number from 0.
    Tested(u8),
    /// A program of so many bytes with this sum will come ([`crate::update`]).
    Program {
        /// Bytes from its head to its end.
        length: u32,
        /// Its sum ([`crate::slots::sum`]).
        sum: u32,
    },
    /// A piece of it.
    Piece {
        /// Offset from its head.
        offset: u32,
        /// Bytes in use, a multiple of four.
        length: u8,
        /// The bytes.
        data: [u8; CHUNK],
    },
    /// The program is complete, and this is its signature: check it where it lies, and have the next start try it.
    Commit([u8; SIGNATURE]),
    /// Have the next start take the program in the other slot again.
    RollBack,
    /// A host has received from the unit: the token of the last [`crate::update::Programs`]. No maintenance mode is needed.
    Echo(u32),
    /// Settings of the output, from now on and from each start on ([`crate::output`]). Answered with the settings in a word.
    Output(OutputSettings),
}

/// An image cut into the chunks that carry it, in order.
pub fn chunks(image: &[u8]) -> impl Iterator<Item = Command> + '_ {
    image.chunks(CHUNK).enumerate().map(|(k, piece)| {
        let mut data = [0; CHUNK];
        data[..piece.len()].copy_from_slice(piece);
        Command::Chunk { offset: (k * CHUNK) as u16, length: piece.len() as u8, data }
    })
}

/// The commands of a burn, in order: each is sent when the one before was answered [`Answer::Done`].
pub fn burn(unit: UnitName, image: &[u8]) -> impl Iterator<Item = Command> + '_ {
    [Command::Open(unit), Command::Begin(image.len() as u16)].into_iter().chain(chunks(image)).chain([Command::End])
}

/// Result of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Answer {
    /// Done.
    Done = 0,
    /// Maintenance mode is not open.
    NotOpen = 1,
    /// The name is that of another unit.
    OtherUnit = 2,
    /// The build is locked.
    Locked = 3,
    /// A length that no image has.
    Length = 4,
    /// A chunk that does not follow the one before.
    Order = 5,
    /// The flash could not be written or read.
    Flash = 6,
    /// The bytes written are not a valid image of this unit.
    Image = 7,
    /// The image is not newer than the newest one in flash: it would never be used.
    NotNewer = 8,
    /// The image is not signed with the key of this firmware.
    Signature = 9,
    /// The image's number is more than [`MOST_STEP`] beyond that of the newest one in flash.
    TooFar = 10,
    /// The image needs an input that this unit does not have: its number follows ([`crate::inputs::NAMES`]).
    Input = 11,
    /// The constants are larger than a unit takes ([`crate::zero::MOST_DPH`]), or no numbers; or a setting is beyond its limits.
    Bound = 12,
    /// The firmware has no field log to keep them in.
    NoLog = 13,
    /// The firmware has no built-in test, or none was done, or it has no item of that number.
    NoTest = 14,
    /// An alignment runs, which the test would make invalid.
    Aligning = 15,
    /// A sector was emptied, and there is more to be done: give the command again.
    More = 16,
    /// The program that runs has not confirmed itself yet.
    Trial = 17,
    /// The bytes written are no whole program.
    Program = 18,
    /// The program is for another board, or for the other slot.
    Board = 19,
    /// The program is older than the one that runs.
    Older = 20,
    /// The other slot holds no program that has run well.
    NoProgram = 21,
    /// The unit moves, and its service pin is open.
    Moving = 22,
    /// The firmware has no such framing.
    NoFraming = 23,
}

impl Answer {
    /// The answer with a number.
    #[must_use]
    pub fn from_number(n: u8) -> Option<Self> {
        use Answer as A;
        [
            A::Done,
            A::NotOpen,
            A::OtherUnit,
            A::Locked,
            A::Length,
            A::Order,
            A::Flash,
            A::Image,
            A::NotNewer,
            A::Signature,
            A::TooFar,
            A::Input,
            A::Bound,
            A::NoLog,
            A::NoTest,
            A::Aligning,
            A::More,
            A::Trial,
            A::Program,
            A::Board,
            A::Older,
            A::NoProgram,
            A::Moving,
            A::NoFraming,
        ]
        .into_iter()
        .find(|a| *a as u8 == n)
    }
}

impl core::fmt::Display for Answer {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Done => "done",
            Self::NotOpen => "maintenance mode is not open",
            Self::OtherUnit => "the unit has another name",
            Self::Locked => "the firmware is built without maintenance mode",
            Self::Length => "no image is as long as that",
            Self::Order => "a chunk does not follow the one before",
            Self::Flash => "the flash could not be written",
            Self::Image => "what was written is not a valid image of this unit",
            Self::NotNewer => "the image is not newer than the one that it holds",
            Self::Signature => "the image is not signed with the key of its firmware",
            Self::TooFar => "the image's number is more than 1000 beyond that of the one that it holds",
            Self::Input => "the image needs an input that this unit does not have",
            Self::Bound => "the numbers are beyond what it takes (constants to 10 deg/h; 1 to 1000 samples a frame, 50 of increments, 1200 messages of both a second)",
            Self::NoLog => "its firmware has no field log, where it would keep them",
            Self::NoTest => "its firmware has no built-in test, or there is no such item",
            Self::Aligning => "an alignment runs, which the test would make invalid: end it first",
            Self::More => "there is more to be emptied",
            Self::Trial => "the program that runs has not confirmed itself yet: wait a minute",
            Self::Program => "what was written is not a whole program",
            Self::Board => "the program is for another board, or for the other slot",
            Self::Older => "the program is older than the one that runs",
            Self::NoProgram => "the other slot holds no program that has run well",
            Self::Moving => "it moves: keep it still for ten seconds, or tie its service pin low",
            Self::NoFraming => "its firmware is built without that framing (feature `mavlink`)",
        })
    }
}

/// Reply of a unit to a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reply {
    /// Result, and a number: a place ([`NOWHERE`]: none), the next offset after a chunk, the image's checksum at its end.
    Answer(Answer, u32),
    /// A piece of a sector.
    Data {
        /// Number of the page.
        page: u8,
        /// Offset in it.
        offset: u16,
        /// The bytes.
        data: [u8; CHUNK],
    },
    /// An item of the built-in test.
    Tested {
        /// Number of the item, as it was asked for.
        number: u8,
        /// The item.
        item: Item,
    },
    /// The built-in test has ended: the number of its items. (No [`Answer`]: it may come after the host that asked has gone, and must be taken for
    /// nothing else.)
    TestDone(u8),
}

/// Image that a burn receives.
#[derive(Debug, Clone, Copy)]
struct Coming {
    place: Place,
    total: u16,
    /// Bytes that are there.
    next: u16,
}

/// The mode's state.
#[derive(Debug)]
pub struct Maintenance {
    unit: UnitName,
    /// The image in use; `None`: the compiled-in default.
    in_use: Option<Place>,
    /// The newest image in flash, which runs from the next start on, and its sequence number.
    newest: Option<(Place, u32)>,
    locked: bool,
    key: Option<Key>,
    /// Inputs beside the frequencies that the unit has.
    inputs: QuantitySet,
    /// There is a field log.
    log: bool,
    /// There is a built-in test.
    test: bool,
    /// There is MAVLink's framing.
    mavlink: bool,
    /// Items of the last one.
    items: Items,
    open: bool,
    coming: Option<Coming>,
    /// The first bytes of what comes, which are programmed last.
    first: [u8; COMMIT],
    /// Programs that come.
    update: Update,
    /// Actions of the unit now, which the next program has to do as well.
    condition: Condition,
    /// It moves, and nobody has tied its service pin.
    moving: bool,
}

impl Maintenance {
    /// Closed. `unit` and `sequence` are those of the calibration in use, `in_use` is its place.
    #[must_use]
    pub const fn new(unit: UnitName, sequence: u32, in_use: Option<Place>, locked: bool) -> Self {
        let newest = match in_use {
            Some(place) => Some((place, sequence)),
            None => None,
        };
        Self {
            unit,
            in_use,
            newest,
            locked,
            key: None,
            inputs: QuantitySet::all(),
            log: true,
            test: true,
            mavlink: true,
            items: Items::new(),
            open: false,
            coming: None,
            first: [0; COMMIT],
            update: Update::new(None),
            condition: Condition { rates: false, calibrated: false, echoed: false },
            moving: false,
        }
    }

    /// The same that takes only images signed with a key.
    #[must_use]
    pub fn with_key(self, key: Option<Key>) -> Self {
        Self { key, update: Update::new(key), ..self }
    }

    /// The same of a unit that has these inputs beside the frequencies.
    #[must_use]
    pub fn with_inputs(self, inputs: QuantitySet) -> Self {
        Self { inputs, ..self }
    }

    /// The same with a field log, or without one.
    #[must_use]
    pub fn with_log(self, log: bool) -> Self {
        Self { log, ..self }
    }

    /// The same with a built-in test, or without one.
    #[must_use]
    pub fn with_test(self, test: bool) -> Self {
        Self { test, ..self }
    }

    /// The same with MAVLink's framing, or without it.
    #[must_use]
    pub fn with_mavlink(self, mavlink: bool) -> Self {
        Self { mavlink, ..self }
    }

    /// Items of the last test, to be asked for; a test fills them in.
    pub fn items_mut(&mut self) -> &mut Items {
        &mut self.items
    }

    /// Tells what the unit does now: a new program will have to do it, too.
    pub fn set_condition(&mut self, condition: Condition) {
        self.condition = condition;
    }

    /// Tells that the unit moves ([`crate::still`]) and its service pin is open: no command is executed then, and the mode ends.
    pub fn set_moving(&mut self, moving: bool) {
        self.moving = moving;
        if moving {
            self.open = false;
            self.coming = None;
        }
    }

    /// `true` while a calibration may be written.
    #[must_use]
    pub fn open(&self) -> bool {
        self.open
    }

    /// Carries out a command; [`Command::Restart`], [`Command::Zero`], [`Command::Output`] and [`Command::Test`] are left to the caller where the answer is [`Answer::Done`].
    pub fn command(&mut self, command: &Command, store: &mut (impl Store + update::Store)) -> Reply {
        let (answer, value) = match command {
            Command::Open(_) if self.moving && !self.locked => (Answer::Moving, 0),
            Command::Open(name) => {
                let answer = if self.locked {
                    Answer::Locked
                } else if *name == self.unit {
                    self.open = true;
                    self.coming = None;
                    Answer::Done
                } else {
                    Answer::OtherUnit
                };
                (answer, number(self.in_use))
            }
            // (The caller looks at the token.)
            Command::Echo(_) => (Answer::Done, 0),
            _ if !self.open => (Answer::NotOpen, 0),
            Command::Close => {
                self.open = false;
                self.coming = None;
                (Answer::Done, 0)
            }
            Command::Begin(length) => self.begin(*length, store),
            Command::Chunk { offset, length, data } => self.chunk(*offset, *length, data, store),
            Command::End => self.end(store),
            Command::Read { page: number, offset } => {
                let within = usize::from(*offset) + CHUNK <= PAGE;
                let found = match number.checked_sub(LOG_PAGE).map(usize::from) {
                    Some(page) => Some((store.events(), page * PAGE)),
                    None => page(*number).map(|start| (store.view(start.sector), start.offset as usize)),
                };
                let piece = found
                    .filter(|_| within)
                    .and_then(|(sector, start)| sector.get(start + usize::from(*offset)..)?.first_chunk());
                if let Some(data) = piece {
                    return Reply::Data { page: *number, offset: *offset, data: *data };
                }
                (Answer::Flash, 0)
            }
            Command::Restart => (Answer::Done, 0),
            Command::Zero(_) if !self.log => (Answer::NoLog, 0),
            Command::Zero(zero) => (if zero.possible() { Answer::Done } else { Answer::Bound }, 0),
            Command::Output(_) if !self.log => (Answer::NoLog, 0),
            Command::Output(settings) if !settings.possible() => (Answer::Bound, 0),
            Command::Output(settings) if settings.framing == Framing::Mavlink && !self.mavlink => {
                (Answer::NoFraming, 0)
            }
            Command::Output(settings) => (Answer::Done, settings.word()),
            Command::Newest => (Answer::Done, number(self.newest.map(|(place, _)| place))),
            Command::Program { length, sum } => self.update.begin(*length, *sum, store),
            Command::Piece { offset, length, data } => self.update.chunk(*offset, *length, data, store),
            Command::Commit(signature) => self.update.end(signature, self.condition, store),
            Command::RollBack => self.update.roll_back(store),
            Command::Test if self.test => (Answer::Done, 0),
            Command::Test => (Answer::NoTest, 0),
            Command::Tested(number) => match self.items.get(usize::from(*number)) {
                Some(item) => return Reply::Tested { number: *number, item: *item },
                None => (Answer::NoTest, 0),
            },
        };
        Reply::Answer(answer, value)
    }

    fn begin(&mut self, total: u16, store: &mut impl Store) -> (Answer, u32) {
        self.coming = None;
        if !(12..=MAX_BYTES + SIGNATURE).contains(&usize::from(total)) {
            return (Answer::Length, 0);
        }
        let newest = self.newest.map(|(place, _)| place);
        let Some(place) = make_room(store, newest, usize::from(total)) else { return (Answer::Flash, 0) };
        self.coming = Some(Coming { place, total, next: 0 });
        (Answer::Done, place.number())
    }

    fn chunk(&mut self, offset: u16, length: u8, data: &[u8; CHUNK], store: &mut impl Store) -> (Answer, u32) {
        let Some(Coming { place, total, next }) = self.coming else {
            return (Answer::Order, 0);
        };
        let end = u32::from(offset) + u32::from(length);
        let repeated = end == u32::from(next) && offset < next;
        if repeated {
            return (Answer::Done, u32::from(next));
        }
        let n = usize::from(length);
        // All chunks but the last are of whole words.
        let last = end == u32::from(total);
        if offset != next || n == 0 || n > CHUNK || end > u32::from(total) || !(last || n % 4 == 0) {
            return (Answer::Order, u32::from(next));
        }
        let mut padded = [0xFF; CHUNK];
        padded.iter_mut().zip(data).take(n).for_each(|(to, from)| *to = *from);
        let words = padded.get(..n.next_multiple_of(4)).unwrap_or(&padded);
        // The first word waits for the end.
        let (at, words) = match words.split_first_chunk() {
            Some((first, rest)) if offset == 0 => {
                self.first = *first;
                (COMMIT as u32, rest)
            }
            _ => (u32::from(offset), words),
        };
        if !words.is_empty() && !store.write(Place { offset: place.offset + at, ..place }, words) {
            self.coming = None;
            return (Answer::Flash, 0);
        }
        self.coming = Some(Coming { place, total, next: end as u16 });
        (Answer::Done, end)
    }

    fn end(&mut self, store: &mut impl Store) -> (Answer, u32) {
        let Some(Coming { place, total, .. }) = self.coming.filter(|c| c.total == c.next) else {
            return (Answer::Order, 0);
        };
        self.coming = None;
        let from = place.offset as usize;
        let there = store.view(place.sector).get(from..from + usize::from(total)).unwrap_or_default();
        let sequence = match self.judge(there) {
            Ok(sequence) => sequence,
            Err((answer, value)) => {
                // (Should this fail, the first word is missing all the same.)
                store.write(place, &REFUSED);
                return (answer, value);
            }
        };
        let written = store.write(place, &self.first);
        let found = sequences(store.view(Sector::A), store.view(Sector::B), self.key).newest;
        match store.view(place.sector).get(from..).and_then(stored_checksum) {
            Some(checksum) if written && found == Some((sequence, place)) => {
                self.newest = Some((place, sequence));
                (Answer::Done, checksum)
            }
            _ => (Answer::Flash, 0),
        }
    }

    /// Checks that the image received, but for its first word, may run from the next start on: gives its sequence number.
    // Out of line: its stack is needed for a short time only.
    #[inline(never)]
    fn judge(&self, there: &[u8]) -> Result<u32, (Answer, u32)> {
        let no = |answer| Err((answer, 0));
        let image = Calibration::from_uncommitted(self.first, there).map_err(|_| (Answer::Image, 0))?;
        let own = stated_length(there).unwrap_or(0);
        if there.len() != own && there.len() != own + SIGNATURE {
            return no(Answer::Image);
        }
        // A unit that was never calibrated takes its name from its first image.
        if image.unit != self.unit && self.in_use.is_some() {
            return no(Answer::Image);
        }
        if let Err(ImageError::LacksInput(number)) = image.inputs_among(self.inputs) {
            return Err((Answer::Input, number.into()));
        }
        if let Some((_, newest)) = self.newest {
            match image.sequence.wrapping_sub(newest) {
                1..=MOST_STEP => {}
                step if (step as i32) > 0 => return no(Answer::TooFar),
                _ => return no(Answer::NotNewer),
            }
        }
        match self.key {
            Some(key) if !behind(there).is_some_and(|signature| key.signed(there, signature)) => no(Answer::Signature),
            _ => Ok(image.sequence),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::calibration::EffectTerm;
    use crate::effects::EffectId;
    use crate::events::Event;
    use crate::inputs::{self, Input};
    use crate::power_cut::Power;
    use crate::sectors::{mark, newest, room, Found, SECTOR_BYTES};
    use std::vec;
    use std::vec::Vec;

    /// Flash whose power may be cut.
    #[derive(Clone)]
    struct Memory {
        sectors: [Vec<u8>; 2],
        power: Power,
        erased: u32,
    }

    impl Memory {
        /// Erased sectors of so many bytes.
        fn of(bytes: usize) -> Self {
            Self { sectors: [vec![0xFF; bytes], vec![0xFF; bytes]], power: Power::ON, erased: 0 }
        }

        fn at(&mut self, sector: Sector) -> &mut Vec<u8> {
            &mut self.sectors[usize::from(sector.number())]
        }

        fn found(&self) -> Found<Calibration> {
            newest(&self.sectors[0], &self.sectors[1], None)
        }

        /// The unit starts.
        fn start(&self) -> Maintenance {
            match self.found().newest {
                Some((c, place)) => Maintenance::new(c.unit, c.sequence, Some(place), false),
                None => Maintenance::new(Calibration::uncalibrated().unit, 0, None, false),
            }
        }
    }

    impl update::Store for Memory {}

    impl Store for Memory {
        fn erase(&mut self, sector: Sector) -> bool {
            self.erased += 1;
            let Self { sectors, power, .. } = self;
            power.erase(&mut sectors[usize::from(sector.number())])
        }
        fn write(&mut self, at: Place, bytes: &[u8]) -> bool {
            assert!(at.offset.is_multiple_of(4));
            let Self { sectors, power, .. } = self;
            power.program(&mut sectors[usize::from(at.sector.number())][at.offset as usize..], bytes)
        }
        fn view(&self, sector: Sector) -> &[u8] {
            &self.sectors[usize::from(sector.number())]
        }
    }

    fn image(sequence: u32) -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.set_unit_name("HRG-7");
        c.calibrated = true;
        c.sequence = sequence;
        c
    }

    fn bytes(sequence: u32) -> Vec<u8> {
        image(sequence).to_bytes().expect("fits").to_vec()
    }

    fn burn_bytes(m: &mut Maintenance, store: &mut Memory, unit: UnitName, bytes: &[u8]) -> Answer {
        for command in super::burn(unit, bytes) {
            match m.command(&command, store) {
                Reply::Answer(Answer::Done, _) => {}
                Reply::Answer(answer, _) => return answer,
                other => unreachable!("{other:?}: nothing was read"),
            }
        }
        Answer::Done
    }

    fn burn(m: &mut Maintenance, store: &mut Memory, c: &Calibration) -> Answer {
        burn_bytes(m, store, c.unit, &c.to_bytes().expect("fits"))
    }

    /// A burn by a unit that has just started.
    fn burn_next(store: &mut Memory, sequence: u32) -> Answer {
        let mut m = store.start();
        // A unit that never had an image has no name yet.
        let unit = m.unit;
        burn_bytes(&mut m, store, unit, &bytes(sequence))
    }

    #[test]
    fn a_cut_at_every_operation_of_70_burns_leaves_the_old_or_the_new_image() {
        // Small sectors, so that they are full three times; numbers that wrap.
        let first = u32::MAX - 30;
        let mut store = Memory::of(20 * room(bytes(0).len()) + 300);
        let (mut cuts, mut erases) = (0, 0);
        for k in 0..70 {
            let number = first.wrapping_add(k);
            let old = store.found().newest.map(|(c, _)| c.sequence);
            let mut left = 1;
            let done = loop {
                let mut cut = Memory { power: Power { left }, ..store.clone() };
                let answer = burn_next(&mut cut, number);
                let is = cut.found().newest.map(|(c, _)| c.sequence);
                if answer == Answer::Done {
                    assert_eq!(is, Some(number));
                    break cut;
                }
                assert!(is == old || is == Some(number), "burn {k} cut after {left} operations: {is:?}");
                cuts += 1;
                // The next burn goes through and ends all complaint, whatever was left; each third time.
                if left.is_multiple_of(3) {
                    let mut again = Memory { power: Power::ON, ..cut };
                    let next = is.map_or(number, |n| n.wrapping_add(1));
                    assert_eq!(burn_next(&mut again, next), Answer::Done, "burn {k} after a cut at {left}");
                    let found = again.found();
                    assert_eq!((found.newest.map(|(c, _)| c.sequence), found.refused), (Some(next), None));
                }
                left += 1;
            };
            erases += done.erased - store.erased;
            assert_eq!(done.found().refused, None);
            store = Memory { power: Power::ON, ..done };
        }
        assert_eq!(erases, 2, "20 burns for each erase; sectors that are blank are not erased again");
        assert!(cuts > 7000, "{cuts}");
    }

    #[test]
    fn a_cut_behind_a_torn_image_and_one_with_the_sector_full_of_torn_ones() {
        let mut store = Memory::of(6 * room(bytes(0).len()));
        assert_eq!(burn_next(&mut store, 5), Answer::Done);
        let mut places = Vec::new();
        for k in 0..20 {
            // Cut somewhere in its middle, each time.
            let mut cut = Memory { power: Power { left: 10 + 4 * k }, ..store };
            assert_ne!(burn_next(&mut cut, 6), Answer::Done);
            let found = cut.found();
            assert_eq!(found.newest.map(|(c, p)| (c.sequence, p.number())), Some((5, 0)), "after {k} torn images");
            assert!(
                found.refused.is_none() && found.cut_short.is_some(),
                "it was never committed: {:?}",
                found.refused
            );
            places.push(cut.erased);
            store = Memory { power: Power::ON, ..cut };
            // A start reports it once, into the log.
            let at = found.cut_short.expect("found");
            assert_eq!(mark(&mut store, at), Some(Event::CutShort { place: at.number() }));
            assert_eq!((store.found().cut_short, store.found().refused), (None, None));
        }
        assert!(places[0] == 0 && places[19] > 5, "sector B is erased anew each time once A is full: {places:?}");
        assert_eq!(burn_next(&mut store, 6), Answer::Done);
        let found = store.found();
        assert_eq!((found.newest.map(|(c, _)| c.sequence), found.refused), (Some(6), None));
    }

    #[test]
    fn a_unit_whose_sectors_are_full_of_garbage_takes_a_burn_and_the_next_one_ends_the_flag() {
        let mut store = Memory::of(SECTOR_BYTES);
        store.sectors.iter_mut().for_each(|s| s.fill(0xA5));
        assert_eq!(burn_next(&mut store, 1), Answer::Done);
        let found = store.found();
        assert_eq!((found.newest.map(|(_, p)| p.sector), found.refused), (Some(Sector::B), Some(ImageError::Foreign)));
        assert_eq!(burn_next(&mut store, 2), Answer::Done);
        let found = store.found();
        assert_eq!((found.newest.map(|(_, p)| p.sector), found.refused), (Some(Sector::A), None));
    }

    #[test]
    fn a_number_may_step_by_a_thousand_and_no_further() {
        for (step, answer) in [
            (1, Answer::Done),
            (MOST_STEP, Answer::Done),
            (MOST_STEP + 1, Answer::TooFar),
            (i32::MAX as u32, Answer::TooFar),
            (1 << 31, Answer::NotNewer),
            (u32::MAX, Answer::NotNewer),
            (0, Answer::NotNewer),
        ] {
            let mut store = Memory::of(SECTOR_BYTES);
            assert_eq!(burn_next(&mut store, 7), Answer::Done);
            assert_eq!(burn_next(&mut store, 7u32.wrapping_add(step)), answer, "a step of {step}");
        }
        // The first image of a unit may have any.
        assert_eq!(burn_next(&mut Memory::of(SECTOR_BYTES), u32::MAX - 3), Answer::Done);
    }

    #[test]
    fn a_blank_sector_is_not_erased_again() {
        let mut store = Memory::of(2 * room(bytes(0).len()));
        assert_eq!((burn_next(&mut store, 1), burn_next(&mut store, 2)), (Answer::Done, Answer::Done));
        // The sector is full. A burn that only begins wears nothing out.
        let mut m = store.start();
        let unit = m.unit;
        for _ in 0..50 {
            m.command(&Command::Open(unit), &mut store);
            let begun = m.command(&Command::Begin(bytes(3).len() as u16), &mut store);
            assert!(matches!(begun, Reply::Answer(Answer::Done, _)));
        }
        assert_eq!(store.erased, 0);
    }

    #[test]
    fn a_sector_takes_a_row_of_burns_between_two_erases() {
        let mut c = image(0);
        for id in [4u16, 6, 3] {
            c.effects.push(crate::calibration::EffectTerm::new(id, [600.0, 1.0])).expect("room");
        }
        let mut store = Memory::of(SECTOR_BYTES);
        let mut last_erase = 0;
        for sequence in 1..=700 {
            c.sequence = sequence;
            let before = store.erased;
            let mut m = store.start();
            let unit = m.unit;
            assert_eq!(burn_bytes(&mut m, &mut store, unit, &c.to_bytes().expect("fits")), Answer::Done);
            if store.erased > before {
                let length = c.to_bytes().expect("fits").len();
                std::println!("{} burns of {length} bytes", sequence - last_erase - 1);
                // (Both sectors are blank at first.)
                let (fit, first) = ((SECTOR_BYTES / room(length)) as u32, last_erase == 0);
                assert_eq!(sequence - last_erase - 1, if first { 2 * fit } else { fit - 1 });
                last_erase = sequence;
            }
        }
        assert_eq!(store.found().newest.map(|(c, _)| c.sequence), Some(700));
    }

    #[test]
    fn a_framing_that_the_firmware_lacks_is_refused() {
        let mut store = Memory::of(SECTOR_BYTES);
        let settings = OutputSettings { framing: Framing::Mavlink, ..OutputSettings::default() };
        for (there, answer) in
            [(true, Reply::Answer(Answer::Done, settings.word())), (false, Reply::Answer(Answer::NoFraming, 0))]
        {
            let mut m = store.start().with_mavlink(there);
            let _ = m.command(&Command::Open(Calibration::uncalibrated().unit), &mut store);
            assert_eq!(m.command(&Command::Output(settings), &mut store), answer);
            let own = OutputSettings::default();
            assert_eq!(m.command(&Command::Output(own), &mut store), Reply::Answer(Answer::Done, own.word()));
        }
        let numbers = (0..=u8::MAX).filter_map(|n| Answer::from_number(n).map(|a| a as u8));
        assert!(numbers.eq(0..=Answer::NoFraming as u8));
    }

    #[test]
    fn an_old_units_image_loads_and_the_next_goes_behind_it() {
        let mut store = Memory::of(SECTOR_BYTES);
        for (sector, number) in [(Sector::A, 4), (Sector::B, 5)] {
            let image = bytes(number);
            store.at(sector)[..image.len()].copy_from_slice(&image);
        }
        let b = Place { sector: Sector::B, offset: 0 };
        assert_eq!(store.found(), Found { newest: Some((image(5), b)), refused: None, cut_short: None });
        let mut m = store.start();
        assert_eq!(burn(&mut m, &mut store, &image(6)), Answer::Done);
        let behind = Place { offset: room(bytes(0).len()) as u32, ..b };
        assert_eq!((store.found().newest, store.erased), (Some((image(6), behind)), 0));
        // The image in use, the image of the next start, and the bytes read there.
        assert_eq!(m.command(&Command::Open(image(6).unit), &mut store), Reply::Answer(Answer::Done, b.number()));
        assert_eq!(m.command(&Command::Newest, &mut store), Reply::Answer(Answer::Done, behind.number()));
        let (page, offset) = behind.in_page();
        match m.command(&Command::Read { page, offset }, &mut store) {
            Reply::Data { data, .. } => assert_eq!(data, bytes(6)[..CHUNK]),
            other => panic!("{other:?}"),
        }
        // A second burn without a restart must be newer than the first.
        assert_eq!(burn(&mut m, &mut store, &image(6)), Answer::NotNewer);
        assert_eq!(burn(&mut m, &mut store, &image(7)), Answer::Done);
        assert_eq!(store.found().newest.map(|(c, _)| c.sequence), Some(7));
    }

    #[test]
    fn nothing_is_done_for_strangers_or_in_disorder() {
        let mut store = Memory::of(SECTOR_BYTES);
        let own = bytes(3);
        store.sectors[0][..own.len()].copy_from_slice(&own);
        let untouched = store.sectors.clone();
        let mut m = store.start();
        let printed = |m: &mut Maintenance, store: &mut Memory, c: Command| match m.command(&c, store) {
            Reply::Answer(a, _) => a,
            Reply::Data { .. } | Reply::Tested { .. } | Reply::TestDone(_) => Answer::Done,
        };
        for command in [Command::Begin(500), Command::Restart, Command::Newest, Command::Read { page: 0, offset: 0 }] {
            assert_eq!(printed(&mut m, &mut store, command), Answer::NotOpen);
        }
        assert_eq!(printed(&mut m, &mut store, Command::Open(UnitName::new("????????????????"))), Answer::OtherUnit);
        let mut locked = Maintenance::new(image(3).unit, 3, None, true);
        assert_eq!(printed(&mut locked, &mut store, Command::Open(image(3).unit)), Answer::Locked);
        assert_eq!(printed(&mut m, &mut store, Command::Open(image(3).unit)), Answer::Done);
        for (page, offset, answer) in
            [(0, 0, Answer::Done), (7, 3968, Answer::Done), (7, 3969, Answer::Flash), (8, 0, Answer::Flash)]
        {
            assert_eq!(printed(&mut m, &mut store, Command::Read { page, offset }), answer);
        }
        for length in [0, 11, (MAX_BYTES + SIGNATURE + 1) as u16, u16::MAX] {
            assert_eq!(printed(&mut m, &mut store, Command::Begin(length)), Answer::Length);
        }
        let chunk = |offset, length| Command::Chunk { offset, length, data: [0; CHUNK] };
        assert_eq!(printed(&mut m, &mut store, chunk(0, 128)), Answer::Order);
        assert_eq!(store.sectors, untouched);
        assert_eq!(printed(&mut m, &mut store, Command::Begin(300)), Answer::Done);
        assert_eq!(printed(&mut m, &mut store, chunk(4, 128)), Answer::Order);
        assert_eq!(printed(&mut m, &mut store, chunk(0, 127)), Answer::Order, "not of whole words");
        assert_eq!(printed(&mut m, &mut store, chunk(0, 255)), Answer::Order);
        assert_eq!(printed(&mut m, &mut store, chunk(0, 128)), Answer::Done);
        assert_eq!(printed(&mut m, &mut store, chunk(0, 128)), Answer::Done, "repeated");
        assert_eq!(printed(&mut m, &mut store, Command::End), Answer::Order, "not complete");
        assert_eq!(printed(&mut m, &mut store, chunk(128, 128)), Answer::Done);
        assert_eq!(printed(&mut m, &mut store, chunk(256, 44)), Answer::Done);
        assert_eq!(printed(&mut m, &mut store, Command::End), Answer::Image, "zeros are no image");
        assert_eq!(burn(&mut m, &mut store, &image(3)), Answer::NotNewer);
        assert_eq!(burn_bytes(&mut m, &mut store, image(3).unit, &[&bytes(4)[..], &[7; 4]].concat()), Answer::Image);
        let own_end = room(own.len());
        assert_eq!(store.sectors[0][..own_end], untouched[0][..own_end], "the image in use is never touched");
        assert_eq!((store.found().refused, store.erased), (None, 0), "what was refused is no fault");
        let mut wanting = image(9);
        let drive = EffectId::DriveAmplitude;
        let mut term = EffectTerm::new(drive.facts().id, [0.0; 2]);
        term.gains[2][0] = 1.0;
        wanting.effects.push(term).expect("room");
        wanting.inputs.push(Input { quantity: inputs::drive(2), ..Input::default() }).expect("room");
        let mut m = m.with_inputs(QuantitySet::SUPPLY);
        let bytes = wanting.to_bytes().expect("fits");
        let mut last = None;
        for command in super::burn(wanting.unit, &bytes) {
            last = Some(m.command(&command, &mut store));
        }
        assert_eq!(last, Some(Reply::Answer(Answer::Input, inputs::drive(2).into())), "which one is in the answer");
        let mut m = m.with_inputs(QuantitySet::all());
        let mut stranger = image(9);
        stranger.set_unit_name("HRG-8");
        assert_eq!(burn(&mut m, &mut store, &stranger), Answer::OtherUnit);
    }

    #[test]
    fn an_image_that_was_refused_never_counts() {
        // In a session with this unit: an image of another unit, one that is not newer, one that is not whole.
        let old = image(5);
        let mut stranger = image(9);
        stranger.set_unit_name("HRG-8");
        let mut torn = image(9).to_bytes().expect("fits");
        *torn.last_mut().expect("bytes") ^= 1;
        for (bytes, answer) in [
            (stranger.to_bytes().expect("fits"), Answer::Image),
            (image(5).to_bytes().expect("fits"), Answer::NotNewer),
            (torn, Answer::Image),
        ] {
            for left in (1..300).chain([u32::MAX]) {
                let mut store = Memory::of(2 * MAX_BYTES);
                let own = old.to_bytes().expect("fits");
                store.sectors[0][..own.len()].copy_from_slice(&own);
                store.power.left = left;
                let mut m = store.start();
                let mut last = Answer::Done;
                let commands = [Command::Open(old.unit), Command::Begin(bytes.len() as u16)];
                for command in commands.into_iter().chain(chunks(&bytes)).chain([Command::End]) {
                    if let Reply::Answer(a, _) = m.command(&command, &mut store) {
                        last = a;
                    }
                }
                let found = store.found();
                let first = Place { sector: Sector::A, offset: 0 };
                assert_eq!(found.newest, Some((old.clone(), first)), "cut after {left} operations");
                if left == u32::MAX {
                    assert_eq!((last, found.refused), (answer, None));
                }
            }
        }
    }

    #[cfg(feature = "signed")]
    mod signed {
        use super::*;
        use crate::sectors::{sequences, MOST_SIGNATURES};
        use ed25519_dalek::{Signer, SigningKey};

        fn owner() -> SigningKey {
            SigningKey::from_bytes(&[7; 32])
        }

        fn key(of: &SigningKey) -> Option<Key> {
            Some(Key::new(of.verifying_key().to_bytes()))
        }

        /// The bytes of a burn: an image and its signature.
        fn signed(image: &[u8], by: &SigningKey) -> Vec<u8> {
            [image, &by.sign(image).to_bytes()[..]].concat()
        }

        /// A unit that runs image 5, signed, at the start of sector A.
        fn unit() -> (Memory, Maintenance) {
            let mut store = Memory::of(SECTOR_BYTES);
            let own = signed(&bytes(5), &owner());
            store.sectors[0][..own.len()].copy_from_slice(&own);
            let m = store.start().with_key(key(&owner()));
            (store, m)
        }

        fn runs(store: &Memory) -> (Option<u32>, Option<ImageError>) {
            let found = sequences(&store.sectors[0], &store.sectors[1], key(&owner()));
            (found.newest.map(|(n, _)| n), found.refused)
        }

        #[test]
        fn an_image_counts_with_its_owners_signature_only() {
            let unit_name = image(0).unit;
            let (mut store, mut m) = unit();
            assert_eq!(runs(&store), (Some(5), None));
            let other = SigningKey::from_bytes(&[8; 32]);
            for (what, coming) in [
                ("missing", bytes(6)),
                ("erased", [&bytes(6)[..], &[0xFF; SIGNATURE]].concat()),
                ("zeros", [&bytes(6)[..], &[0; SIGNATURE]].concat()),
                ("another key", signed(&bytes(6), &other)),
                ("of another image", [&bytes(6)[..], &owner().sign(&bytes(7)).to_bytes()].concat()),
            ] {
                assert_eq!(burn_bytes(&mut m, &mut store, unit_name, &coming), Answer::Signature, "{what}");
                assert_eq!(runs(&store), (Some(5), None), "{what}");
            }
            assert_eq!(burn_bytes(&mut m, &mut store, unit_name, &signed(&bytes(6), &owner())), Answer::Done);
            assert_eq!(runs(&store), (Some(6), None));
            // An older one is signed well, and older.
            assert_eq!(burn_bytes(&mut m, &mut store, unit_name, &signed(&bytes(5), &owner())), Answer::NotNewer);
            // A unit that asks for no signature takes both.
            let mut m = store.start();
            assert_eq!(burn_bytes(&mut m, &mut store, unit_name, &signed(&bytes(7), &other)), Answer::Done);
            assert_eq!(burn_bytes(&mut m, &mut store, unit_name, &bytes(8)), Answer::Done);
            assert_eq!(store.found().newest.map(|(c, _)| c.sequence), Some(8));
            // And one that asks for it does not run them.
            assert_eq!(runs(&store), (Some(6), Some(ImageError::Signature)));
        }

        #[test]
        fn every_flipped_bit_of_image_and_signature_is_noticed() {
            let unit_name = image(0).unit;
            let good = signed(&bytes(6), &owner());
            let image_bits = bytes(6).len() * 8;
            // Each bit of the signature, and bits of the image whose checksum is made to fit again.
            for bit in (image_bits..good.len() * 8).chain((8 * 12..image_bits - 32).step_by(97)) {
                let mut bad = good.clone();
                bad[bit / 8] ^= 1 << (bit % 8);
                let end = image_bits / 8;
                let crc = crate::bytes::crc32(&bad[..end - 4]).to_le_bytes();
                bad[end - 4..end].copy_from_slice(&crc);
                let (mut store, mut m) = unit();
                let answer = burn_bytes(&mut m, &mut store, unit_name, &bad);
                assert_ne!(answer, Answer::Done, "bit {bit}");
                if bit >= image_bits {
                    assert_eq!(answer, Answer::Signature, "bit {bit}");
                }
                // Put there by somebody else: it does not run either.
                let (mut store, _) = unit();
                let at = room(bytes(5).len());
                store.sectors[0][at..at + bad.len()].copy_from_slice(&bad);
                let (number, refused) = runs(&store);
                assert!(number == Some(5) && refused.is_some(), "bit {bit}: {number:?} {refused:?}");
            }
        }

        #[test]
        fn a_start_checks_a_few_signatures_only() {
            let other = SigningKey::from_bytes(&[8; 32]);
            for (wrong, runs_at_last) in [(MOST_SIGNATURES - 1, Some(5)), (MOST_SIGNATURES, None)] {
                let (mut store, _) = unit();
                for k in 0..wrong {
                    let mut m = store.start();
                    let coming = signed(&bytes(6 + k), &other);
                    assert_eq!(burn_bytes(&mut m, &mut store, image(0).unit, &coming), Answer::Done);
                }
                assert_eq!(runs(&store), (runs_at_last, Some(ImageError::Signature)));
            }
        }
    }
}
