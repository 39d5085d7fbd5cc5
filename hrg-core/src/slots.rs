//! The two slots for programs in flash: what a slot holds, and which one is started.
//!
//! # Layout of a slot
//! | bytes | content | programmed |
//! |---|---|---|
//! | 0 to 255 | marks ([`mark`]): signature, sum, what became of the program | a word at a time, each once |
//! | 256 to 511 | head ([`head`]): what the program is | with the program |
//! | from 512 on | the program, from its vector table on | |
//!
//! Signature and sum are of everything from the head to the program's end, one piece. A slot holds nothing until its mark `COMMITTED` is there, which
//! the program in the other slot writes last, after it has checked the rest (`hrg_core::update`).
//!
//! # Which one is started
//! The loader asks [`order`]. A program that was committed and never tried comes first: the loader marks it as tried *before* it starts it. If it does
//! not confirm itself, the next start finds it tried and not confirmed, and takes the other one: so nothing has to be copied or erased on the way
//! back, and a program has one chance. Of those confirmed the one that was put into use last comes first: each slot has a row of numbers, of which the
//! last one that is valid counts; a unit goes back by a further number in the other slot ([`next_number`]).
//! A number has 16 bits and their complement, so that one whose programming was cut short is none.
//!
//! The loader is compiled with this file as it is: it uses nothing of the rest of the crate.
//!
//! # Example
//! ```
//! use hrg_core::slots::{numbered, mark, order, Choice, Slot, CONFIRMED, COMMITTED};
//!
//! let mut a = vec![0xFF; 1024];
//! let mut put = |at: usize, word: u32| a[at..at + 4].copy_from_slice(&word.to_le_bytes());
//! put(mark::COMMITTED, COMMITTED);
//! put(mark::TRIED, 0);
//! put(mark::CONFIRMED, CONFIRMED);
//! put(mark::NUMBERS, numbered(1));
//! let b = vec![0xFF; 1024];
//! assert_eq!(order([Slot(&a), Slot(&b)], true), [Some(Choice { slot: 0, trial: false, held: false }), None]);
//! ```

/// Erased flash.
pub const ERASED: u32 = u32::MAX;
/// The mark of a program that may be started.
pub const COMMITTED: u32 = u32::from_le_bytes(*b"COMM");
/// The mark of a program that has confirmed itself.
pub const CONFIRMED: u32 = u32::from_le_bytes(*b"GOOD");
/// The first word of a head.
pub const MAGIC: u32 = u32::from_le_bytes(*b"HRGP");

/// Addresses of the slots, A and B (memory.x).
pub const ADDRESSES: [u32; 2] = [0x0801_0000, 0x0804_0000];
/// Bytes of a program at most, marks and head included: those of the smaller slot.
pub const ROOM: usize = 192 * 1024;
/// Bytes of the first sector of each slot; the second is the rest.
pub const FIRST_SECTORS: [usize; 2] = [64 * 1024, 128 * 1024];
/// Offsets of the loader's length and of its sum, in reserved places of its vector table. The sum is that of the loader with a zero in its place.
pub const LOADER_LENGTH: usize = 28;
/// See [`LOADER_LENGTH`].
pub const LOADER_SUM: usize = 32;
/// Offset of the head.
pub const HEAD: usize = 256;
/// Offset of the vector table. (A table of 113 vectors lies at a multiple of 512: PM0214 section 4.4.4.)
pub const TABLE: usize = 512;

/// Offsets of the marks.
///
/// # Example
/// ```
/// use hrg_core::slots::{mark, HEAD};
///
/// assert_eq!(mark::NUMBERS + 4 * mark::NUMBER_COUNT, HEAD);
/// ```
pub mod mark {
    /// Signature of the program, 64 bytes.
    pub const SIGNATURE: usize = 0;
    /// Sum of the program: CRC-32/MPEG-2 of its words from the head on.
    pub const SUM: usize = 64;
    /// Bytes from the head on that are being written, or were.
    pub const LENGTH: usize = 68;
    /// Bits of what the program must do to confirm itself, as the one before it did it (`hrg_core::update::Condition`).
    pub const EXPECTED: usize = 72;
    /// [`super::COMMITTED`]: it may be started.
    pub const COMMITTED: usize = 76;
    /// Not erased: the loader has started it for the first time.
    pub const TRIED: usize = 80;
    /// [`super::CONFIRMED`]: it has found itself good.
    pub const CONFIRMED: usize = 84;
    /// When it was put into use: a row of [`NUMBER_COUNT`] numbers up to the head.
    pub const NUMBERS: usize = 128;
    /// Numbers in that row.
    pub const NUMBER_COUNT: usize = (super::HEAD - NUMBERS) / 4;
}

/// Offsets in the head, from the slot's start.
///
/// # Example
/// ```
/// use hrg_core::slots::{head, HEAD};
///
/// assert_eq!(head::BOARD + head::TEXT, head::NAME);
/// assert_eq!(head::MAGIC, HEAD);
/// ```
pub mod head {
    /// [`super::MAGIC`].
    pub const MAGIC: usize = super::HEAD;
    /// Bytes from the head to the program's end.
    pub const LENGTH: usize = super::HEAD + 4;
    /// Address of the slot that the program is linked for.
    pub const ADDRESS: usize = super::HEAD + 8;
    /// Version of the program: the higher the newer.
    pub const VERSION: usize = super::HEAD + 12;
    /// Board that it is for, as text with zeros behind, [`TEXT`] bytes.
    pub const BOARD: usize = super::HEAD + 16;
    /// The program's name for people, the same way.
    pub const NAME: usize = super::HEAD + 48;
    /// Bytes of a text.
    pub const TEXT: usize = 32;
}

/// A slot, from its first byte on.
#[derive(Debug, Clone, Copy)]
pub struct Slot<'a>(pub &'a [u8]);

/// State of what a slot holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Nothing, or a program that is not complete.
    Empty = 0,
    /// A program that was never started.
    New = 1,
    /// A program that was started and has not confirmed itself: it is on trial, or has failed.
    Tried = 2,
    /// A program that has confirmed itself.
    Confirmed = 3,
}

impl State {
    /// The state of a number; `None`: there is none.
    #[must_use]
    pub const fn from_number(n: u8) -> Option<Self> {
        match n {
            0 => Some(Self::Empty),
            1 => Some(Self::New),
            2 => Some(Self::Tried),
            3 => Some(Self::Confirmed),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Empty => "empty",
            Self::New => "new",
            Self::Tried => "on trial",
            Self::Confirmed => "confirmed",
        }
    }
}

/// A number as its word: 16 bits and their complement.
#[must_use]
pub const fn numbered(n: u16) -> u32 {
    n as u32 | (!n as u32) << 16
}

/// Bits that a mark may have lost: it is in no sum, and a unit whose mark has lost one must start all the same.
const LOST: u32 = 3;

/// `true` if a word holds a mark. (An erased word, or none, is sixteen bits away from each. A mark of which a power cut has left a part is never written before
/// what it vouches for is there and checked.)
const fn holds(word: u32, mark: u32) -> bool {
    (word ^ mark).count_ones() <= LOST
}

impl<'a> Slot<'a> {
    /// `true` if its marks are as they were written: none has lost a bit.
    #[must_use]
    pub fn marks_sound(&self) -> bool {
        let confirmed = self.word(mark::CONFIRMED);
        self.word(mark::COMMITTED) == COMMITTED && (confirmed == CONFIRMED || confirmed == ERASED)
    }

    /// The word at an offset; erased behind the slot's end.
    #[must_use]
    pub fn word(&self, at: usize) -> u32 {
        match self.0.get(at..) {
            Some([a, b, c, d, ..]) => u32::from_le_bytes([*a, *b, *c, *d]),
            _ => ERASED,
        }
    }

    /// State of what it holds.
    #[must_use]
    pub fn state(&self) -> State {
        if !holds(self.word(mark::COMMITTED), COMMITTED) {
            State::Empty
        } else if holds(self.word(mark::CONFIRMED), CONFIRMED) {
            State::Confirmed
        } else if self.word(mark::TRIED) == ERASED {
            State::New
        } else {
            State::Tried
        }
    }

    /// Place of the next number in the row; `None`: the row is full.
    #[must_use]
    pub fn number_place(&self) -> Option<usize> {
        let mut place = mark::NUMBERS + 4 * mark::NUMBER_COUNT;
        while place > mark::NUMBERS && self.word(place - 4) == ERASED {
            place -= 4;
        }
        if place < HEAD {
            Some(place)
        } else {
            None
        }
    }

    /// When it was put into use: the last valid number; 0: never.
    #[must_use]
    pub fn number(&self) -> u16 {
        let mut place = HEAD;
        while place > mark::NUMBERS {
            place -= 4;
            let n = self.word(place) as u16;
            if self.word(place) == numbered(n) {
                return n;
            }
        }
        0
    }

    /// Everything from the head to the program's end; `None`: its length is none.
    #[must_use]
    pub fn body(&self) -> Option<&'a [u8]> {
        let length = self.word(head::LENGTH) as usize;
        if length < TABLE - HEAD + 8 || !length.is_multiple_of(4) {
            return None;
        }
        self.0.get(HEAD..HEAD.checked_add(length)?)
    }

    /// Version of its program.
    #[must_use]
    pub fn version(&self) -> u32 {
        self.word(head::VERSION)
    }

    /// A text of the head.
    #[must_use]
    pub fn text(&self, at: usize) -> [u8; head::TEXT] {
        let mut out = [0; head::TEXT];
        if let Some(from) = self.0.get(at..) {
            let mut k = 0;
            while k < head::TEXT && k < from.len() {
                out[k] = from[k];
                k += 1;
            }
        }
        out
    }
}

/// Sum of a program: CRC-32/MPEG-2 of its words, as the chip's CRC unit makes it (RM0390 chapter 4). Bytes behind the last word are left out.
#[must_use]
pub fn sum(body: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for word in body.chunks_exact(4) {
        if let [a, b, c, d] = *word {
            crc ^= u32::from_le_bytes([a, b, c, d]);
            for _ in 0..32 {
                crc = crc << 1 ^ if crc >> 31 != 0 { 0x04C1_1DB7 } else { 0 };
            }
        }
    }
    crc
}

/// A slot to be started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// 0: A, 1: B.
    pub slot: usize,
    /// For the first time: it is to be marked as tried.
    pub trial: bool,
    /// Not beside a program that has confirmed itself: it has failed its trial, or nobody has asked for the trial now.
    pub held: bool,
}

/// The slots in the order in which to start them; see [`chosen`]. `restarted`: by a command, which is the time for a trial. (A program that was committed and not
/// restarted into must not be tried at a reset in flight.)
#[must_use]
pub fn order([a, b]: [Slot<'_>; 2], restarted: bool) -> [Option<Choice>; 2] {
    // The higher the rank the earlier; 0: never.
    let rank = |slot: &Slot<'_>, other: &Slot<'_>| {
        let newer = slot.number() > other.number();
        match (slot.state(), other.state()) {
            (State::Empty, _) => 0,
            // (Never before one that was put into use after it.)
            (State::New, State::Confirmed) if !newer => 1,
            (State::New, _) => 4,
            (State::Confirmed, _) => 2 + newer as u8,
            (State::Tried, _) => 1,
        }
    };
    let choice = |slot: usize, rank: u8, held: bool| {
        if rank > 0 {
            Some(Choice { slot, trial: rank == 4, held })
        } else {
            None
        }
    };
    let held = |slot: &Slot<'_>, other: &Slot<'_>| {
        let waits = matches!(slot.state(), State::New) && !restarted;
        (waits || matches!(slot.state(), State::Tried)) && matches!(other.state(), State::Confirmed)
    };
    let (of_a, of_b) = (rank(&a, &b), rank(&b, &a));
    let (a, b) = (choice(0, of_a, held(&a, &b)), choice(1, of_b, held(&b, &a)));
    match (of_a >= of_b, a, b) {
        (true, Some(_), _) | (false, _, None) => [a, b],
        _ => [b, a],
    }
}

/// The slot to start: the first in the order that is not held and is fit (its sum is right, and a trial could be marked). Where none is so the first that is not held, which
/// sees that itself and says so. `None`: there is no program.
#[must_use]
pub fn chosen(order: [Option<Choice>; 2], mut fit: impl FnMut(Choice) -> bool) -> Option<usize> {
    let free = |choice: &Choice| !choice.held;
    let mut k = 0;
    while k < order.len() {
        match order[k] {
            Some(choice) if free(&choice) && fit(choice) => return Some(choice.slot),
            _ => k += 1,
        }
    }
    let [first, second] = order;
    match first.filter(free) {
        Some(choice) => Some(choice.slot),
        None => second.or(first).map(|choice| choice.slot),
    }
}

/// The number that puts a slot into use, before the other one; `None`: there are no more.
#[must_use]
pub fn next_number(slots: [Slot<'_>; 2]) -> Option<u16> {
    let [a, b] = slots.map(|s| s.number());
    (if a > b { a } else { b }).checked_add(1)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec;
    use std::vec::Vec;

    fn slot(state: State, numbers: &[u16]) -> Vec<u8> {
        let mut out = vec![0xFF; 1024];
        let mut put = |at: usize, word: u32| out[at..at + 4].copy_from_slice(&word.to_le_bytes());
        if state != State::Empty {
            put(mark::COMMITTED, COMMITTED);
        }
        if matches!(state, State::Tried | State::Confirmed) {
            put(mark::TRIED, 0xFFFF_FF00);
        }
        if state == State::Confirmed {
            put(mark::CONFIRMED, CONFIRMED);
        }
        for (k, n) in numbers.iter().enumerate() {
            put(mark::NUMBERS + 4 * k, numbered(*n));
        }
        out
    }

    fn first(a: &[u8], b: &[u8]) -> Option<(usize, bool)> {
        order([Slot(a), Slot(b)], true)[0].map(|c| (c.slot, c.trial))
    }

    #[test]
    fn a_new_program_has_one_chance_and_the_other_comes_back() {
        use State as S;
        for state in [S::Empty, S::New, S::Tried, S::Confirmed] {
            assert_eq!(Slot(&slot(state, &[1])).state(), state);
            assert_eq!(State::from_number(state as u8), Some(state));
        }
        for ((a, numbers_a), (b, numbers_b), expected) in [
            ((S::Confirmed, &[1][..]), (S::Empty, &[][..]), Some((0, false))),
            ((S::Confirmed, &[1]), (S::New, &[2]), Some((1, true))),
            ((S::Confirmed, &[1]), (S::Tried, &[2]), Some((0, false))),
            ((S::Confirmed, &[1]), (S::Confirmed, &[2]), Some((1, false))),
            // Back, and forth again.
            ((S::Confirmed, &[1, 3]), (S::Confirmed, &[2]), Some((0, false))),
            ((S::Confirmed, &[1, 3]), (S::Confirmed, &[2, 4]), Some((1, false))),
            // Its number was never written.
            ((S::Confirmed, &[1]), (S::New, &[]), Some((0, false))),
            ((S::Tried, &[1]), (S::Tried, &[2]), Some((0, false))),
            ((S::Empty, &[1]), (S::Tried, &[2]), Some((1, false))),
            ((S::Empty, &[]), (S::Empty, &[]), None),
        ] {
            let (a, b) = (slot(a, numbers_a), slot(b, numbers_b));
            assert_eq!(first(&a, &b), expected);
            // The two places are alike; of two that are equal A comes first.
            let swapped = first(&b, &a).map(|(slot, trial)| (1 - slot, trial));
            assert!(swapped == expected || Slot(&a).state() == Slot(&b).state());
        }
    }

    #[test]
    fn a_number_whose_programming_was_cut_short_is_none() {
        let mut whole = slot(State::Confirmed, &[1, 3]);
        assert_eq!((Slot(&whole).number(), Slot(&whole).number_place()), (3, Some(mark::NUMBERS + 8)));
        let torn: Vec<u32> = (0..32).map(|bit| numbered(9) | 1 << bit).filter(|w| *w != numbered(9)).collect();
        for word in torn {
            whole[mark::NUMBERS + 8..mark::NUMBERS + 12].copy_from_slice(&word.to_le_bytes());
            assert_eq!(Slot(&whole).number(), 3);
            assert_eq!(Slot(&whole).number_place(), Some(mark::NUMBERS + 12));
        }
        let full = slot(State::Confirmed, &[5; mark::NUMBER_COUNT]);
        assert_eq!((Slot(&full).number(), Slot(&full).number_place()), (5, None));
        assert_eq!(next_number([Slot(&full), Slot(&slot(State::Confirmed, &[u16::MAX]))]), None);
    }

    #[test]
    fn the_sum_is_that_of_the_crc_unit() {
        // CRC-32/MPEG-2 of "12345678", by another program; the unit takes words, most significant byte first.
        let words: Vec<u8> = b"12345678".chunks(4).flat_map(|w| [w[3], w[2], w[1], w[0]]).collect();
        assert_eq!(sum(&words), 0x49E3_C2FB);
    }

    #[test]
    fn a_length_that_is_none_gives_no_program() {
        let mut s = slot(State::New, &[1]);
        assert!(Slot(&s).body().is_none(), "erased");
        for (length, there) in
            [(256u32 + 8, true), (768, true), (772, false), (770, false), (8, false), (u32::MAX - 3, false)]
        {
            s[head::LENGTH..head::LENGTH + 4].copy_from_slice(&length.to_le_bytes());
            assert_eq!(Slot(&s).body().map(<[u8]>::len), there.then_some(length as usize), "{length}");
        }
        assert!(Slot(&[]).body().is_none() && Slot(&[]).state() == State::Empty);
    }
}
