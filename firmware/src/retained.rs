//! The states of the model in RAM that a reset leaves alone: a unit that starts anew goes on from them.
//!
//! # Design
//! Two places, written in turn each second; each ends with a checksum ([`hrg_core::history`]). The start-up code of cortex-m-rt neither
//! clears nor fills the section `.uninit`. After a power-on it holds anything, which has no checksum.

use crate::redundant::Compensator;
use core::sync::atomic::{AtomicU32, Ordering};
use hrg_core::history::{newer, Kept, KEPT_WORDS};
use hrg_core::reset::{Halt, ResetCause};

type Place = [AtomicU32; KEPT_WORDS];

// (The name is what the virtual board looks for.)
#[allow(unsafe_code)] // The section is one of cortex-m-rt's, made for this.
#[unsafe(link_section = ".uninit.kept")]
#[unsafe(export_name = "_kept_states")]
static PLACES: [Place; 2] = [const { [const { AtomicU32::new(0) }; KEPT_WORDS] }; 2];

/// Reason of the last stop that the unit left: [`WORD`] and a number.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.word")]
static LAST_WORD: AtomicU32 = AtomicU32::new(0);
/// Starts that went on from kept states, without a step since: [`WORD`] and a number.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.resumed")]
static RESUMED: AtomicU32 = AtomicU32::new(0);

/// The correction of the clock, parts per 1e9 as a float, and its bits turned over.
#[cfg(feature = "pps")]
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.correction")]
static CORRECTION: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

/// Marks a number in memory that a reset leaves alone as written by this program.
const WORD: u32 = 0x4852_4700;

/// So many starts in a row without a model step between them may go on from the same states: then they are old.
const RESUMPTIONS: u32 = 3;

/// Value of a word now. The compiler knows which values the program stores, and must not conclude from them what a
/// reset has left: so the read is volatile.
fn read(word: &AtomicU32) -> u32 {
    // SAFETY: a static, aligned and never borrowed otherwise; words are written whole.
    #[allow(unsafe_code)]
    unsafe {
        word.as_ptr().read_volatile()
    }
}

fn number(word: &AtomicU32) -> u32 {
    let word = read(word);
    if word & !0xFF == WORD {
        word & 0xFF
    } else {
        0
    }
}

/// Leaves word for the next start.
pub fn leave_word(why: Halt) {
    LAST_WORD.store(WORD | why as u32, Ordering::Relaxed);
}

/// Gives the reason of the last stop that the unit left, and clears it.
pub fn last_word(cause: ResetCause) -> Halt {
    let stated = Halt::from_number(number(&LAST_WORD) as u8).filter(|_| cause != ResetCause::Power);
    LAST_WORD.store(0, Ordering::Relaxed);
    stated.unwrap_or_default()
}

fn words(place: &'static Place) -> impl Fn(usize) -> u32 + Copy {
    move |k| place.get(k).map_or(0, read)
}

/// States kept before a reset; `None`: nothing intact, or nothing recent.
pub fn newest(cause: ResetCause) -> Option<Kept<impl Fn(usize) -> u32 + Copy>> {
    let before = number(&RESUMED);
    RESUMED.store(WORD | (before + 1).min(RESUMPTIONS), Ordering::Relaxed);
    if !cause.is_brief() {
        RESUMED.store(0, Ordering::Relaxed);
        return None;
    }
    (before < RESUMPTIONS).then(|| newer(PLACES.each_ref().map(words))).flatten()
}

/// The correction of the clock before a brief reset; 0: none is known.
#[cfg(feature = "pps")]
pub fn correction(cause: ResetCause) -> f64 {
    let [bits, turned] = CORRECTION.each_ref().map(read);
    let ppb = f32::from_bits(bits);
    if cause.is_brief() && bits == !turned && ppb.is_finite() {
        f64::from(ppb) / 1e9
    } else {
        0.0
    }
}

/// Discards the kept states: they are of no use any more, because the unit runs on a false clock.
pub fn forget() {
    for place in &PLACES {
        place[0].store(0, Ordering::Relaxed);
    }
}

/// Keeps the correction of the clock.
#[cfg(feature = "pps")]
pub fn keep_correction(correction: f64) {
    let bits = ((correction * 1e9) as f32).to_bits();
    CORRECTION[0].store(bits, Ordering::Relaxed);
    CORRECTION[1].store(!bits, Ordering::Relaxed);
}

/// Keeps the states of a model after a step, in the older place. `step` counts the steps.
pub fn keep(model: &mut Compensator, step: u32) {
    let place = &PLACES[step as usize % 2];
    model.keep(|k, word| {
        if let Some(to) = place.get(k) {
            to.store(word, Ordering::Relaxed);
        }
    });
    RESUMED.store(0, Ordering::Relaxed);
}
