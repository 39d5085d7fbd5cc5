//! The two flash sectors that hold calibration images: the newest valid one is used.
//!
//! # Layout of a sector
//! Images lie one behind the other, each with room for a signature, and each begins at a multiple of [`STEP`]. An old unit's only
//! image at the start of a sector is the first of such a row. A place that begins with the magic holds an image; with
//! zeros, one that was refused; with erased flash and something behind it, one whose writing was cut short: it was
//! never committed, and no rate suffers from it. It goes into the field log, and not into the status.
//!
//! # What a start reads
//! The first word of each place, from the end of each sector backwards to its last valid image ([`PLACES`] words a sector at most); that
//! image; two words of each place behind it. Images that are not valid are read on the way, none of them beyond the begin of the next.
//! Whatever the sectors hold, no word is read more than four times. In instructions, counted in the ELF by
//! `a_start_looks_at_the_sectors_in_bounded_time`: 106 000, and 284 000 (1.6 ms) where the image in use is followed by nothing but changed
//! ones in both sectors.
//!
//! # Example
//! ```
//! use hrg_core::calibration::Calibration;
//! use hrg_core::sectors::{newest, Place, Sector, SECTOR_BYTES};
//!
//! let (mut a, mut b) = (vec![0xFF; SECTOR_BYTES], vec![0xFF; SECTOR_BYTES]);
//! for (sector, sequence) in [(&mut a, 1), (&mut b, 2)] {
//!     let image = Calibration { sequence, ..Calibration::uncalibrated() }.to_bytes().expect("fits");
//!     sector[..image.len()].copy_from_slice(&image);
//! }
//! let (image, place) = newest(&a, &b, None).newest.expect("both are valid");
//! assert_eq!((image.sequence, place), (2, Place { sector: Sector::B, offset: 0 }));
//! ```

use crate::bytes::{Reader, Writer};
use crate::calibration::{stated_length, Calibration, ImageError, COMMIT, MAGIC, MAX_BYTES, REFUSED};
use crate::events::{Event, Record, RECORD};
use crate::signature::{self, Key, SIGNATURE};
use crate::zero;

/// The two calibration sectors.
pub trait Store {
    /// Erases a sector. `false`: it failed.
    fn erase(&mut self, sector: Sector) -> bool;
    /// Programs bytes at a place, in their order; both multiples of four. `false`: it failed.
    fn write(&mut self, at: Place, bytes: &[u8]) -> bool;
    /// A whole sector: flash is in the address space.
    fn view(&self, sector: Sector) -> &[u8];
    /// The field log, where there is one: [`crate::events`].
    fn events(&self) -> &[u8] {
        &[]
    }
}

/// Bytes of a sector.
pub const SECTOR_BYTES: usize = 0x4000;
/// Images begin at multiples of this.
pub const STEP: usize = 256;
/// Places in a sector where an image may begin.
pub const PLACES: usize = SECTOR_BYTES / STEP;
/// Bytes of a page, by which the link reads the sectors ([`page`]).
pub const PAGE: usize = 4096;
/// Most signatures that a start checks: each takes a while.
pub const MOST_SIGNATURES: u32 = 4;

/// One of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sector {
    /// The first.
    A,
    /// The second.
    B,
}

impl Sector {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// 0 and 1.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::A => 0,
            Self::B => 1,
        }
    }

    /// The sector of a number.
    #[must_use]
    pub const fn from_number(number: u8) -> Option<Self> {
        match number {
            0 => Some(Self::A),
            1 => Some(Self::B),
            _ => None,
        }
    }

    fn of<T>(self, [a, b]: [T; 2]) -> T {
        match self {
            Self::A => a,
            Self::B => b,
        }
    }
}

/// Place of an image: its sector and the offset of its first byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Place {
    /// Sector.
    pub sector: Sector,
    /// Bytes from its start.
    pub offset: u32,
}

impl Place {
    /// As the link counts: bytes from the start of sector A, B following it.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.sector.number() as u32 * SECTOR_BYTES as u32 + self.offset
    }

    /// The place of a number.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match Sector::from_number(if number < 2 * SECTOR_BYTES as u32 {
            (number / SECTOR_BYTES as u32) as u8
        } else {
            2
        }) {
            Some(sector) => Some(Self { sector, offset: number % SECTOR_BYTES as u32 }),
            None => None,
        }
    }

    /// The page that it lies in, and the offset there.
    #[must_use]
    pub const fn in_page(self) -> (u8, u16) {
        ((self.number() as usize / PAGE) as u8, (self.number() as usize % PAGE) as u16)
    }
}

/// Place of a page of the sectors, as the link's Read counts them: sector A has the first four, sector B the next.
#[must_use]
pub const fn page(number: u8) -> Option<Place> {
    Place::from_number(number as u32 * PAGE as u32)
}

impl core::fmt::Display for Place {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "sector {:?}, byte {}", self.sector, self.offset)
    }
}

/// Bytes of a sector that an image of so many bytes takes, with room for its signature.
#[must_use]
pub const fn room(length: usize) -> usize {
    (length + SIGNATURE).next_multiple_of(STEP)
}

/// The checksum that stands at the end of an image; `None` where there is no room for one.
#[must_use]
pub fn stored_checksum(bytes: &[u8]) -> Option<u32> {
    let end = stated_length(bytes)?;
    Some(u32::from_le_bytes(*bytes.get(end.checked_sub(4)?..end)?.first_chunk()?))
}

/// Images found in the two flash sectors.
#[derive(Debug, Clone, PartialEq)]
pub struct Found<T> {
    /// The newest valid image, and the place that it came from.
    pub newest: Option<(T, Place)>,
    /// Why something was refused that may be newer than that: behind the last valid image of its sector, or in the other
    /// sector where that holds no valid image at all. It is an image whose memory has changed, or whose signature is not the
    /// key's. The unit flags it ([`crate::status::UnitStatus::IMAGE_REFUSED`]).
    pub refused: Option<ImageError>,
    /// Place at which the last burn was cut short before its image counted, if it was and no start has [marked](mark)
    /// it yet: for the field log ([`crate::events::Event::CutShort`]).
    pub cut_short: Option<Place>,
}

/// Looks at both sectors. `key`: images that it has not signed are refused.
#[inline(never)]
#[must_use]
pub fn newest(a: &[u8], b: &[u8], key: Option<Key>) -> Found<Calibration> {
    // An image is large, and the unit's stack small: one at a time, and the one that is used is read once more.
    let Found { newest, refused, cut_short } = sequences(a, b, key);
    let read = |(_, place): (u32, Place)| {
        let bytes = place.sector.of([a, b]).get(place.offset as usize..)?;
        Some((Calibration::from_bytes(bytes).ok()?, place))
    };
    Found { newest: newest.and_then(read), refused, cut_short }
}

/// The same, with the sequence number in the place of the image.
#[inline(never)]
#[must_use]
pub fn sequences(a: &[u8], b: &[u8], key: Option<Key>) -> Found<u32> {
    let sectors = [a, b];
    let mut last = sectors.map(|bytes| last_valid(bytes, bytes.len()));
    let mut unsigned = None;
    let mut checks = MOST_SIGNATURES;
    let newest = loop {
        let (sector, (offset, sequence)) = match last {
            // Sequence numbers compare across their wrap.
            [Some(x), Some(y)] if y.1.wrapping_sub(x.1) as i32 > 0 => (Sector::B, y),
            [Some(x), _] => (Sector::A, x),
            [None, Some(y)] => (Sector::B, y),
            [None, None] => break None,
        };
        let bytes = sector.of(sectors);
        if bytes.get(offset..).is_some_and(|place| trusted(place, key, &mut checks)) {
            break Some((sequence, Place { sector, offset: offset as u32 }));
        }
        unsigned = Some(ImageError::Signature);
        *sector.of(last.each_mut()) = last_valid(bytes, offset);
    };
    let (first, from) = newest.map_or((Sector::A, 0), |(_, place): (u32, Place)| {
        (place.sector, end_of(place.sector.of(sectors), place.offset as usize))
    });
    let mut out = Found { newest, refused: None, cut_short: None };
    for (sector, from) in [(first, from), (first.other(), 0)] {
        let bytes = sector.of(sectors);
        // (The other sector counts where the first has nothing to refuse, and it holds no valid image.)
        if out.refused.is_some() || sector != first && newest.is_some() && holds_valid(bytes) {
            break;
        }
        let found = not_valid(bytes, from);
        out.refused = found.refused;
        out.cut_short = out.cut_short.or(found.cut_short.map(|offset| Place { sector, offset }));
    }
    out.refused = unsigned.or(out.refused);
    out
}

// (Once in flash: each is called from several places, at a start and in a burn.)
/// The last valid image that begins and ends before `end`: where it begins, and its sequence number.
#[inline(never)]
fn last_valid(bytes: &[u8], end: usize) -> Option<(usize, u32)> {
    let mut end = end;
    for offset in (0..end).step_by(STEP).rev() {
        // (An image ends where the next one begins: so no word is read for two of them.)
        let Some(place) = bytes.get(offset..end).filter(|p| p.starts_with(&MAGIC)) else { continue };
        if let Ok(image) = Calibration::from_bytes(place) {
            return Some((offset, image.sequence));
        }
        end = offset;
    }
    None
}

/// End of the space of an image that begins at `offset`.
fn end_of(bytes: &[u8], offset: usize) -> usize {
    offset + room(bytes.get(offset..).and_then(stated_length).unwrap_or(MAX_BYTES).min(MAX_BYTES))
}

/// `true` if the image at the front of `place` may be used. `checks`: signatures that may still be checked.
fn trusted(place: &[u8], key: Option<Key>, checks: &mut u32) -> bool {
    let Some(key) = key else { return true };
    let Some(signature) = signature::behind(place).filter(|_| *checks > 0) else { return false };
    *checks -= 1;
    key.signed(place, signature)
}

fn holds_valid(bytes: &[u8]) -> bool {
    last_valid(bytes, bytes.len()).is_some()
}

/// Contents from a place on that are no valid image.
#[derive(Debug, Default)]
struct NotValid {
    /// Why the first thing is refused that is neither erased flash, nor an image that was refused in a burn or never committed.
    refused: Option<ImageError>,
    /// Offset of the last image before that whose burn was cut short.
    cut_short: Option<u32>,
}

#[inline(never)]
fn not_valid(bytes: &[u8], from: usize) -> NotValid {
    let mut out = NotValid::default();
    // Until there lies what is known already.
    let mut known_until = 0;
    for offset in (from..bytes.len()).step_by(STEP) {
        // The second word is the first that a burn programs.
        let Some((place, head)) = bytes.get(offset..).and_then(|p| Some((p, p.first_chunk::<8>()?))) else { break };
        if head.starts_with(&MAGIC) {
            out.refused = Some(Calibration::from_bytes(place).err().unwrap_or(ImageError::Signature));
            break;
        }
        let uncommitted = head.starts_with(&[0xFF; COMMIT]);
        if head.starts_with(&REFUSED) || *head != [0xFF; 8] && uncommitted {
            // (Older firmware has overwritten the length; of a burn that was cut short it may be missing.)
            let stated = stated_length(place).is_some_and(|length| (1..=MAX_BYTES).contains(&length));
            known_until = if stated { end_of(bytes, offset) } else { offset + room(MAX_BYTES) };
            if uncommitted {
                out.cut_short = Some(offset as u32);
            }
        } else if *head != [0xFF; 8] && offset >= known_until {
            out.refused = Some(ImageError::Foreign);
            break;
        }
    }
    out
}

/// Marks a place where a burn was cut short as refused: the next start does not find it again. Gives the event for the field log; `None` where
/// the flash could not be written.
pub fn mark(store: &mut impl Store, cut_short: Place) -> Option<Event> {
    store.write(cut_short, &REFUSED).then_some(Event::CutShort { place: cut_short.number() })
}

/// The place of an image of so many bytes ([`place_for`]), erased where it has to be; `None`: that failed. (A sector that is blank already is not worn out by asking
/// again.)
pub fn make_room(store: &mut (impl Store + ?Sized), newest: Option<Place>, length: usize) -> Option<Place> {
    let (place, erase) = place_for(store.view(Sector::A), store.view(Sector::B), newest, length);
    if erase && !store.view(place.sector).iter().all(|b| *b == 0xFF) && !store.erase(place.sector) {
        return None;
    }
    Some(place)
}

/// Words before what is kept for the log: a refused image's first word, the length as an image states it, [`KEPT`], a number.
const KEPT_HEAD: usize = 16;
/// Marks a place whose contents are kept for the log.
const KEPT: [u8; 4] = *b"KEPT";
/// Bytes of such a place in use.
const KEPT_BYTES: usize = KEPT_HEAD + KEPT_RECORDS * RECORD;
/// Its length, as the header of an image states it.
const KEPT_LENGTH: [u8; 4] = [0, 0, KEPT_BYTES as u8, 0];
/// Records that are kept: the constants, and what is sent ([`crate::output`]).
pub const KEPT_RECORDS: usize = zero::RECORDS + 1;

/// Puts records beside the images, at a place that counts as refused: so a start, and a burn, go by it. It may erase the sector that the newest image is not in.
/// `false`: the flash could not be written.
pub fn keep(store: &mut (impl Store + ?Sized), number: u32, records: &[[u8; RECORD]; KEPT_RECORDS]) -> bool {
    let newest = sequences(store.view(Sector::A), store.view(Sector::B), None).newest.map(|(_, place)| place);
    let Some(place) = make_room(store, newest, KEPT_BYTES) else { return false };
    let mut bytes = [0; KEPT_BYTES];
    let mut w = Writer::new(&mut bytes);
    w.bytes(&REFUSED);
    w.bytes(&KEPT_LENGTH);
    w.bytes(&KEPT);
    w.u32(number);
    records.iter().for_each(|record| w.bytes(record));
    store.write(place, &bytes)
}

/// The records that were kept last, and their number.
pub fn kept(store: &impl Store) -> Option<(u32, [[u8; RECORD]; KEPT_RECORDS])> {
    let mut found: Option<(u32, [[u8; RECORD]; KEPT_RECORDS])> = None;
    for place in [Sector::A, Sector::B].into_iter().flat_map(|s| store.view(s).chunks_exact(STEP)) {
        let mut r = Reader::new(place);
        let lead = [r.u32()?.to_le_bytes(), r.u32()?.to_le_bytes(), r.u32()?.to_le_bytes()];
        let number = r.u32()?;
        if lead != [REFUSED, KEPT_LENGTH, KEPT] {
            continue;
        }
        let mut records = [[0; RECORD]; KEPT_RECORDS];
        for (to, from) in records.iter_mut().zip(place.get(KEPT_HEAD..)?.chunks_exact(RECORD)) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
        }
        // (One that was cut short is none: each record has a checksum.)
        let whole = records.iter().all(|record| Record::from_bytes(record).is_some());
        if whole && found.is_none_or(|(newest, _)| number.wrapping_sub(newest) as i32 > 0) {
            found = Some((number, records));
        }
    }
    found
}

/// Chooses the place of an image of so many bytes, and tells if that sector must be erased first.
///
/// Behind all that was ever programmed in the sector of the newest image, with room for a signature. Into the other sector, which is then erased, where there is no
/// room; or where the other one holds something that is refused at each start, so that a burn ends that.
#[inline(never)]
#[must_use]
pub fn place_for(a: &[u8], b: &[u8], newest: Option<Place>, length: usize) -> (Place, bool) {
    let own = newest.map_or(Sector::A, |p| p.sector);
    let bytes = own.of([a, b]);
    let programmed = bytes.iter().rposition(|b| *b != 0xFF).map_or(0, |last| room(last + 1));
    // (An image may end with ones.)
    let offset = programmed.max(newest.map_or(0, |place| end_of(bytes, place.offset as usize)));
    let other = own.other().of([a, b]);
    let flagged = || !holds_valid(other) && not_valid(other, 0).refused.is_some();
    if offset + room(length) <= bytes.len() && !flagged() {
        (Place { sector: own, offset: offset as u32 }, false)
    } else {
        (Place { sector: own.other(), offset: 0 }, true)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::calibration::tests::full;
    use crate::calibration::MAX_BYTES;
    use std::vec;
    use std::vec::Vec;

    const ERASED: &[u8] = &[0xFF; SECTOR_BYTES];

    fn numbered(sequence: u32) -> Calibration {
        let mut c = full();
        c.sequence = sequence;
        c
    }

    fn bytes(sequence: u32) -> Vec<u8> {
        numbered(sequence).to_bytes().expect("fits").to_vec()
    }

    /// A sector with these at its places, one behind the other.
    fn sector(images: &[&[u8]]) -> Vec<u8> {
        let mut out = ERASED.to_vec();
        let mut at = 0;
        for image in images {
            out[at..at + image.len()].copy_from_slice(image);
            at += room(image.len());
        }
        out
    }

    fn found(a: &[u8], b: &[u8]) -> (Option<(u32, Place)>, Option<ImageError>) {
        let f = sequences(a, b, None);
        (f.newest, f.refused)
    }

    fn cut_short(a: &[u8], b: &[u8]) -> Option<Place> {
        sequences(a, b, None).cut_short
    }

    fn at(sector: Sector, offset: usize) -> Place {
        Place { sector, offset: offset as u32 }
    }

    #[test]
    fn places_and_pages_have_numbers() {
        for place in [at(Sector::A, 0), at(Sector::A, SECTOR_BYTES - STEP), at(Sector::B, 0), at(Sector::B, 768)] {
            assert_eq!(Place::from_number(place.number()), Some(place));
            let (number, offset) = place.in_page();
            let start = page(number).expect("a page");
            assert_eq!((start.sector, start.offset + u32::from(offset)), (place.sector, place.offset));
        }
        assert_eq!((Place::from_number(2 * SECTOR_BYTES as u32), Place::from_number(u32::MAX)), (None, None));
        assert_eq!((page(7).map(|p| p.sector), page(8), page(255)), (Some(Sector::B), None, None));
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let good = full().to_bytes().expect("fits");
        for bit in 0..good.len() * 8 {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            let found = newest(&bad, &[0xFF; MAX_BYTES], None);
            assert!(found.newest.is_none() && found.refused.is_some(), "bit {bit}: {found:?}");
        }
    }

    #[test]
    fn every_flipped_bit_of_the_last_image_of_a_row_is_noticed() {
        let (x, y) = (bytes(1), bytes(2));
        let good = sector(&[&x, &y]);
        let start = room(x.len());
        for bit in 0..y.len() * 8 {
            let mut bad = good.clone();
            bad[start + bit / 8] ^= 1 << (bit % 8);
            let (newest, refused) = found(&bad, ERASED);
            assert_eq!(newest, Some((1, at(Sector::A, 0))), "bit {bit}");
            assert!(refused.is_some(), "bit {bit}");
        }
    }

    #[test]
    fn newest_valid_image_wins() {
        let (x, y) = (numbered(u32::MAX), numbered(0));
        let (bx, mut by) = (bytes(u32::MAX), bytes(0));
        let cut_short = None;
        assert_eq!(newest(&bx, &by, None), Found { newest: Some((y, at(Sector::B, 0))), refused: None, cut_short });
        by[20] ^= 4;
        let refused = Some(ImageError::Checksum);
        assert_eq!(
            newest(&bx, &by, None),
            Found { newest: Some((x, at(Sector::A, 0))), refused, cut_short },
            "the older is used, and that is reported"
        );
        assert_eq!(newest(&[0xFF; 8], &by, None), Found { newest: None, refused, cut_short });
        assert_eq!(newest(&[0xFF; 8], &[], None), Found { newest: None, refused: None, cut_short });
    }

    #[test]
    fn the_last_of_a_row_wins_and_what_was_refused_before_it_is_forgotten() {
        let (one, two, three) = (bytes(1), bytes(2), bytes(3));
        let step = room(one.len());
        let mut torn = three.clone();
        torn[..4].fill(0xFF);
        torn[300..].fill(0xFF);
        let mut marked = three.clone();
        marked[..4].fill(0);
        // The marks that older firmware leaves of an image that it refuses.
        let mut marked_before = three.clone();
        marked_before[..8].fill(0);
        let mut changed = two.clone();
        changed[200] ^= 1;
        let foreign = Some(ImageError::Foreign);
        for (images, newest, refused) in [
            (vec![&one, &two, &three], Some((3, 2)), None),
            (vec![&one, &torn], Some((1, 0)), None),
            (vec![&one, &torn, &three], Some((3, 2)), None),
            (vec![&one, &marked], Some((1, 0)), None),
            (vec![&one, &marked, &torn], Some((1, 0)), None),
            (vec![&one, &changed], Some((1, 0)), Some(ImageError::Checksum)),
            (vec![&one, &changed, &three], Some((3, 2)), None),
            (vec![&torn], None, None),
            (vec![&one, &torn, &changed], Some((1, 0)), Some(ImageError::Checksum)),
            (vec![&marked_before], None, None),
            (vec![&torn, &one], Some((1, 1)), None),
        ] {
            let row: Vec<&[u8]> = images.into_iter().map(Vec::as_slice).collect();
            let s = sector(&row);
            let place = |sector| newest.map(|(n, k): (u32, usize)| (n, at(sector, k * step)));
            assert_eq!(found(&s, ERASED), (place(Sector::A), refused));
            assert_eq!(found(ERASED, &s), (place(Sector::B), refused));
        }
        // The other sector counts where it holds no valid image, and only there.
        let (old, new) = (sector(&[&one, &torn]), sector(&[&two]));
        assert_eq!(found(&old, &new), (Some((2, at(Sector::B, 0))), None));
        assert_eq!(found(&sector(&[&torn]), &new), (Some((2, at(Sector::B, 0))), None));
        let garbage = vec![0xA5; SECTOR_BYTES];
        assert_eq!(found(&garbage, &garbage), (None, foreign));
        // A burn that was cut short is found where it lies, until a burn follows it.
        assert_eq!(cut_short(&sector(&[&one, &torn]), ERASED), Some(at(Sector::A, step)));
        assert_eq!(cut_short(&sector(&[&one, &torn, &torn]), ERASED), Some(at(Sector::A, 2 * step)));
        assert_eq!(cut_short(&sector(&[&one, &torn, &three]), ERASED), None);
        assert_eq!(cut_short(&sector(&[&torn]), &new), Some(at(Sector::A, 0)));
        assert_eq!(cut_short(&old, &new), None);
        assert_eq!(cut_short(&sector(&[&one, &marked]), ERASED), None);
    }

    #[test]
    fn a_burn_appends_until_there_is_no_room() {
        let one = bytes(1);
        let length = one.len();
        assert_eq!(place_for(ERASED, ERASED, None, length), (at(Sector::A, 0), false));
        let row = sector(&[&one]);
        let own = Some(at(Sector::A, 0));
        assert_eq!(place_for(&row, ERASED, own, length), (at(Sector::A, room(length)), false));
        // Behind the last word that was ever programmed.
        let mut torn = row.clone();
        torn[room(length) + 1000] = 0xFE;
        assert_eq!(place_for(&torn, ERASED, own, length), (at(Sector::A, room(room(length) + 1001)), false));
        let mut full = row.clone();
        full[SECTOR_BYTES - room(length)] = 0;
        assert_eq!(place_for(&full, ERASED, own, length), (at(Sector::B, 0), true));
        // The flag of the other sector ends with a burn.
        let garbage = vec![0xA5; SECTOR_BYTES];
        assert_eq!(place_for(&row, &garbage, own, length), (at(Sector::B, 0), true));
        assert_eq!(place_for(&garbage, &row, Some(at(Sector::B, 0)), length), (at(Sector::A, 0), true));
        assert_eq!(place_for(&garbage, &garbage, None, length), (at(Sector::B, 0), true));
        assert_eq!(SECTOR_BYTES / room(MAX_BYTES), 3, "burns of the longest image for each erase");
    }
}
