//! Maintenance mode: a calibration into the unit over the link.
//!
//! # Two sectors, newest valid wins
//! An image is only ever written into the sector that is *not* in use, and counts only once its first word stands before it
//! ([`crate::sectors::newest`]). That word is programmed last, after the image was found to be one of this unit, valid and newer. So a
//! power cut at any moment leaves the old image or the new one, never neither; and an image that is refused never counts,
//! whatever comes. The sequence number counts burns; each sector has been erased half as often.
//!
//! # Who may write
//! No command is executed before [`Command::Open`] has named the unit as its image names it. A build with the firmware's feature
//! `locked` refuses that too. Chunks come in order; one that is repeated (its answer was lost) is answered again and
//! not written twice.

use crate::calibration::{Calibration, COMMIT, MAX_BYTES, REFUSED};
use crate::sectors::{stored_checksum, Sector};
use crate::unit_name::UnitName;

/// Bytes of a chunk.
pub const CHUNK: usize = 128;

/// The two calibration sectors.
pub trait Store {
    /// Erases a sector. `false`: it failed.
    fn erase(&mut self, sector: Sector) -> bool;
    /// Programs bytes at an offset; both multiples of four. `false`: it failed.
    fn write(&mut self, sector: Sector, offset: u16, bytes: &[u8]) -> bool;
    /// The first [`MAX_BYTES`] of a sector: flash is in the address space.
    fn view(&self, sector: Sector) -> &[u8];
}

/// What the host may ask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Enter maintenance mode; names the unit.
    Open(UnitName),
    /// Leave it.
    Close,
    /// An image of so many bytes will come: erases the sector that is not in use.
    Begin(u16),
    /// A piece of it.
    Chunk {
        /// Offset in the image.
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
        /// Sector.
        sector: Sector,
        /// Offset.
        offset: u16,
    },
    /// Start anew, with the newest image.
    Restart,
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

/// How a command went.
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
    /// What was written is not a valid image of this unit.
    Image = 7,
    /// The image is not newer than the one in use: it would never be used.
    NotNewer = 8,
}

impl Answer {
    /// The answer with a number.
    #[must_use]
    pub fn from_number(n: u8) -> Option<Self> {
        use Answer as A;
        [A::Done, A::NotOpen, A::OtherUnit, A::Locked, A::Length, A::Order, A::Flash, A::Image, A::NotNewer]
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
            Self::NotNewer => "the image is not newer than the one in use",
        })
    }
}

/// What goes back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reply {
    /// How it went, and a number: the next offset after a chunk, the image's checksum at its end.
    Answer(Answer, u32),
    /// A piece of a sector.
    Data {
        /// Sector.
        sector: Sector,
        /// Offset.
        offset: u16,
        /// The bytes.
        data: [u8; CHUNK],
    },
}

/// The mode's state.
#[derive(Debug)]
pub struct Maintenance {
    unit: UnitName,
    /// The sector in use; `None`: neither holds a valid image.
    in_use: Option<Sector>,
    sequence: u32,
    locked: bool,
    open: bool,
    /// Length of the image that comes, and what is there of it.
    coming: Option<(u16, u16)>,
    /// Its first bytes, which are programmed last.
    first: [u8; COMMIT],
}

impl Maintenance {
    /// Closed. `unit` and `sequence` are those of the calibration in use, `in_use` is its sector.
    #[must_use]
    pub const fn new(unit: UnitName, sequence: u32, in_use: Option<Sector>, locked: bool) -> Self {
        Self { unit, in_use, sequence, locked, open: false, coming: None, first: [0; COMMIT] }
    }

    /// Whether a calibration may be written now.
    #[must_use]
    pub fn open(&self) -> bool {
        self.open
    }

    fn other_sector(&self) -> Sector {
        self.in_use.map_or(Sector::A, Sector::other)
    }

    /// Obeys a command; [`Command::Restart`] is left to the caller where the answer is [`Answer::Done`].
    pub fn command(&mut self, command: &Command, store: &mut impl Store) -> Reply {
        let (answer, value) = match command {
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
                (answer, self.sequence)
            }
            _ if !self.open => (Answer::NotOpen, 0),
            Command::Close => {
                self.open = false;
                self.coming = None;
                (Answer::Done, 0)
            }
            Command::Begin(length) => {
                self.coming = None;
                if !(12..=MAX_BYTES).contains(&usize::from(*length)) {
                    (Answer::Length, 0)
                } else if store.erase(self.other_sector()) {
                    self.coming = Some((*length, 0));
                    (Answer::Done, 0)
                } else {
                    (Answer::Flash, 0)
                }
            }
            Command::Chunk { offset, length, data } => self.chunk(*offset, *length, data, store),
            Command::End => self.end(store),
            Command::Read { sector, offset } => {
                let from = usize::from(*offset);
                if let Some(data) = store.view(*sector).get(from..from + CHUNK).and_then(|p| p.first_chunk()) {
                    return Reply::Data { sector: *sector, offset: *offset, data: *data };
                }
                (Answer::Flash, 0)
            }
            Command::Restart => (Answer::Done, 0),
        };
        Reply::Answer(answer, value)
    }

    fn chunk(&mut self, offset: u16, length: u8, data: &[u8; CHUNK], store: &mut impl Store) -> (Answer, u32) {
        let Some((total, next)) = self.coming else {
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
                (COMMIT as u16, rest)
            }
            _ => (offset, words),
        };
        if !words.is_empty() && !store.write(self.other_sector(), at, words) {
            self.coming = None;
            return (Answer::Flash, 0);
        }
        self.coming = Some((total, end as u16));
        (Answer::Done, end)
    }

    fn end(&mut self, store: &mut impl Store) -> (Answer, u32) {
        match self.coming {
            Some((total, next)) if total == next => {}
            _ => return (Answer::Order, 0),
        }
        self.coming = None;
        let sector = self.other_sector();
        let refused = match Calibration::from_uncommitted(self.first, store.view(sector)) {
            Err(_) => Some(Answer::Image),
            // A unit that was never calibrated takes its name from its first image.
            Ok(image) if image.unit != self.unit && self.in_use.is_some() => Some(Answer::Image),
            Ok(image) if self.in_use.is_some() && image.sequence.wrapping_sub(self.sequence) as i32 <= 0 => {
                Some(Answer::NotNewer)
            }
            Ok(_) => None,
        };
        if let Some(answer) = refused {
            // (Should this fail, the first word is missing all the same.)
            store.write(sector, 0, &REFUSED);
            return (answer, 0);
        }
        let written = store.write(sector, 0, &self.first);
        match stored_checksum(store.view(sector)) {
            Some(checksum) if written && Calibration::from_bytes(store.view(sector)).is_ok() => {
                (Answer::Done, checksum)
            }
            _ => (Answer::Flash, 0),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::sectors::newest;
    use std::vec;
    use std::vec::Vec;

    /// Flash with a power cut after so many operations: a word programmed or a sector erased is one.
    struct Memory {
        sectors: [Vec<u8>; 2],
        left: u32,
    }

    impl Memory {
        fn spend(&mut self) -> bool {
            self.left = self.left.saturating_sub(1);
            self.left > 0
        }
    }

    impl Store for Memory {
        fn erase(&mut self, sector: Sector) -> bool {
            if !self.spend() {
                // Torn: half of it erased.
                let n = self.sectors[usize::from(sector.number())].len() / 2;
                self.sectors[usize::from(sector.number())][..n].fill(0xFF);
                return false;
            }
            self.sectors[usize::from(sector.number())].fill(0xFF);
            true
        }
        fn write(&mut self, sector: Sector, offset: u16, bytes: &[u8]) -> bool {
            for (k, word) in bytes.chunks(4).enumerate() {
                if !self.spend() {
                    return false;
                }
                let at = usize::from(offset) + 4 * k;
                for (to, from) in self.sectors[usize::from(sector.number())][at..at + 4].iter_mut().zip(word) {
                    *to &= from;
                }
            }
            true
        }
        fn view(&self, sector: Sector) -> &[u8] {
            &self.sectors[usize::from(sector.number())][..MAX_BYTES]
        }
    }

    fn image(sequence: u32) -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.set_unit_name("HRG-7");
        c.calibrated = true;
        c.sequence = sequence;
        c
    }

    fn burn(m: &mut Maintenance, store: &mut Memory, c: &Calibration) -> Answer {
        let bytes = c.to_bytes().expect("fits");
        for command in super::burn(c.unit, &bytes) {
            match m.command(&command, store) {
                Reply::Answer(Answer::Done, _) => {}
                Reply::Answer(answer, _) => return answer,
                Reply::Data { .. } => unreachable!("nothing was read"),
            }
        }
        Answer::Done
    }

    #[test]
    fn a_cut_at_every_operation_leaves_the_old_or_the_new_image() {
        let old = image(5);
        let new = image(6);
        for in_use in [Sector::A, Sector::B] {
            let mut finished = false;
            for left in 1..10_000 {
                let mut sectors = [vec![0xFF; MAX_BYTES], vec![0xFF; MAX_BYTES]];
                let bytes = old.to_bytes().expect("fits");
                sectors[usize::from(in_use.number())][..bytes.len()].copy_from_slice(&bytes);
                // The other sector holds an older image still.
                let older = image(4).to_bytes().expect("fits");
                sectors[usize::from(in_use.other().number())][..older.len()].copy_from_slice(&older);
                let mut store = Memory { sectors, left };
                let mut m = Maintenance::new(old.unit, old.sequence, Some(in_use), false);
                let answer = burn(&mut m, &mut store, &new);
                let (found, sector) = newest(&store.sectors[0], &store.sectors[1]).newest.expect("always one");
                if answer == Answer::Done {
                    assert_eq!((found, sector), (new.clone(), in_use.other()));
                    finished = true;
                    break;
                }
                assert!(found == old || found == new, "cut after {left} operations: no. {}", found.sequence);
            }
            assert!(finished);
        }
    }

    #[test]
    fn nothing_is_done_for_strangers_or_in_disorder() {
        let mut store = Memory { sectors: [vec![0xAA; MAX_BYTES], vec![0xAA; MAX_BYTES]], left: u32::MAX };
        let untouched = store.sectors.clone();
        let mut m = Maintenance::new(image(3).unit, 3, Some(Sector::A), false);
        let said = |m: &mut Maintenance, store: &mut Memory, c: Command| match m.command(&c, store) {
            Reply::Answer(a, _) => a,
            Reply::Data { .. } => Answer::Done,
        };
        assert_eq!(said(&mut m, &mut store, Command::Begin(500)), Answer::NotOpen);
        assert_eq!(said(&mut m, &mut store, Command::Restart), Answer::NotOpen);
        assert_eq!(said(&mut m, &mut store, Command::Open(UnitName::new("????????????????"))), Answer::OtherUnit);
        assert_eq!(said(&mut m, &mut store, Command::Read { sector: Sector::A, offset: 0 }), Answer::NotOpen);
        let mut locked = Maintenance::new(image(3).unit, 3, Some(Sector::A), true);
        assert_eq!(said(&mut locked, &mut store, Command::Open(image(3).unit)), Answer::Locked);
        assert_eq!(said(&mut m, &mut store, Command::Open(image(3).unit)), Answer::Done);
        for length in [0, 11, MAX_BYTES as u16 + 1, u16::MAX] {
            assert_eq!(said(&mut m, &mut store, Command::Begin(length)), Answer::Length);
        }
        let chunk = |offset, length| Command::Chunk { offset, length, data: [0; CHUNK] };
        assert_eq!(said(&mut m, &mut store, chunk(0, 128)), Answer::Order);
        assert_eq!(store.sectors, untouched);
        assert_eq!(said(&mut m, &mut store, Command::Begin(300)), Answer::Done);
        assert_eq!(said(&mut m, &mut store, chunk(4, 128)), Answer::Order);
        assert_eq!(said(&mut m, &mut store, chunk(0, 127)), Answer::Order, "not of whole words");
        assert_eq!(said(&mut m, &mut store, chunk(0, 255)), Answer::Order);
        assert_eq!(said(&mut m, &mut store, chunk(0, 128)), Answer::Done);
        assert_eq!(said(&mut m, &mut store, chunk(0, 128)), Answer::Done, "repeated");
        assert_eq!(said(&mut m, &mut store, Command::End), Answer::Order, "not complete");
        assert_eq!(said(&mut m, &mut store, chunk(128, 128)), Answer::Done);
        assert_eq!(said(&mut m, &mut store, chunk(256, 44)), Answer::Done);
        assert_eq!(said(&mut m, &mut store, Command::End), Answer::Image, "zeros are no image");
        assert_eq!(store.sectors[0], untouched[0], "the sector in use is never touched");
        assert_eq!(burn(&mut m, &mut store, &image(3)), Answer::NotNewer);
        assert_eq!(newest(&[0xFF; MAX_BYTES], store.view(Sector::B)).refused, None, "what was refused is no fault");
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
            for left in (1..2000).chain([u32::MAX]) {
                let mut sectors = [vec![0xFF; MAX_BYTES], vec![0xFF; MAX_BYTES]];
                let own = old.to_bytes().expect("fits");
                sectors[0][..own.len()].copy_from_slice(&own);
                let mut store = Memory { sectors, left };
                let mut m = Maintenance::new(old.unit, old.sequence, Some(Sector::A), false);
                let mut last = Answer::Done;
                let commands = [Command::Open(old.unit), Command::Begin(bytes.len() as u16)];
                for command in commands.into_iter().chain(chunks(&bytes)).chain([Command::End]) {
                    if let Reply::Answer(a, _) = m.command(&command, &mut store) {
                        last = a;
                    }
                }
                let found = newest(&store.sectors[0], &store.sectors[1]);
                assert_eq!(found.newest, Some((old.clone(), Sector::A)), "cut after {left} operations");
                if left == u32::MAX {
                    assert_eq!((last, found.refused), (answer, None));
                }
            }
        }
    }
}
