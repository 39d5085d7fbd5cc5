//! The states of the model in RAM that a reset leaves alone: a unit that starts anew goes on from them.
//!
//! # Design
//! Two places, written in turn each second; each ends with a checksum ([`hrg_core::history`]). The start-up code of cortex-m-rt neither
//! clears nor fills the section `.uninit`. After a power-on it holds anything, which has no checksum.

use crate::redundant::Compensator;
use crate::stack;
use core::sync::atomic::{AtomicU32, Ordering};
use hrg_core::history::{newer, Kept, KEPT_WORDS};
use hrg_core::reset::{Halt, ResetCause};
use hrg_core::stopped::{self, Silent, Stopped};

type Place = [AtomicU32; KEPT_WORDS];

// (The name is what the virtual board looks for.)
#[allow(unsafe_code)] // The section is one of cortex-m-rt's, made for this.
#[unsafe(link_section = ".uninit.kept")]
#[unsafe(export_name = "_kept_states")]
static PLACES: [Place; 2] = [const { [const { AtomicU32::new(0) }; KEPT_WORDS] }; 2];

/// Word of the last stop, as [`hrg_core::stopped`] has it.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.stop")]
static STOP: [AtomicU32; stopped::WORDS] = [const { AtomicU32::new(0) }; stopped::WORDS];
/// Parts that have gone silent, should the watchdog bite: [`WORD`] and their bits; PC and LR of the code that ran then.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.silent")]
static SILENT: [AtomicU32; 3] = [const { AtomicU32::new(0) }; 3];
/// Starts that went on from kept states, without a step since: [`WORD`] and a number.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.resumed")]
static RESUMED: AtomicU32 = AtomicU32::new(0);

/// The unit was at rest: [`WORD`] and 1.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.rest")]
#[unsafe(export_name = "_kept_rest")]
static REST: AtomicU32 = AtomicU32::new(0);

/// The correction of the clock, parts per 1e9 as a float, and its bits turned over.
#[cfg(feature = "pps")]
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".uninit.correction")]
static CORRECTION: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];

// The word in memory.x that says which program ran last.
#[allow(unsafe_code)] // Only its address is used.
unsafe extern "C" {
    static _ran_last: u8;
}

/// `true` if the program that ran before this start was this one, by the sum of its slot; from now on it is. What another one has left lies anywhere, and may be
/// of days ago: this program then starts as after a power-on.
pub fn ran_last(sum: u32) -> bool {
    let place = core::ptr::with_exposed_provenance_mut::<u32>((&raw const _ran_last).addr());
    // SAFETY: a word of RAM that the linker gives to nobody; only called at the start.
    #[allow(unsafe_code)]
    unsafe {
        let before = place.read_volatile();
        place.write_volatile(sum);
        before == sum
    }
}

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

/// Notes that the unit moves, or rests, for the next start.
pub fn note_moving(moving: bool) {
    REST.store(WORD | u32::from(!moving), Ordering::Relaxed);
}

/// `true` if the unit has to rest for a while before it counts as resting: after a reset, unless it was at rest before. (A power-on is that of somebody who
/// has the unit at hand.)
pub fn moved(cause: ResetCause) -> bool {
    cause.is_brief() && number(&REST) == 0
}

/// Leaves word for the next start.
pub fn leave(stop: &Stopped) {
    STOP.iter().zip(stop.to_words()).for_each(|(to, word)| to.store(word, Ordering::Relaxed));
}

/// Notes the parts that have gone silent (none: all run), and PC and LR of the code that ran, where they are known.
pub fn note_silent(parts: Silent, [pc, lr]: [u32; 2]) {
    let words = [WORD | u32::from(parts.bits()), pc, lr];
    SILENT.iter().zip(words).for_each(|(to, word)| to.store(word, Ordering::Relaxed));
}

/// Word of the last stop, with the stack that was used until then; clears it.
pub fn last_stop(cause: ResetCause, stack: u32) -> Stopped {
    let words = core::array::from_fn(|k| STOP.get(k).map_or(0, read));
    let [parts, pc, lr] = &SILENT;
    let silent = Stopped {
        silent: Silent::from_bits_truncate(number(parts) as u8),
        stack,
        pc: read(pc),
        lr: read(lr),
        ..Stopped::default()
    };
    STOP.iter().for_each(|word| word.store(0, Ordering::Relaxed));
    note_silent(Silent::empty(), [0; 2]);
    if cause == ResetCause::Power {
        return Stopped::default();
    }
    let stop = Stopped::from_words(&words).unwrap_or_default();
    match (stop.halt, cause) {
        // With a stack that has left the RAM the processor cannot even enter the handler of the fault, and stands until the watchdog bites.
        (Halt::None, ResetCause::Watchdog) if stack::is_full(stack) => Stopped { stack, halt: Halt::Stack, ..stop },
        (Halt::None, ResetCause::Watchdog) if !silent.silent.is_empty() => silent,
        _ => Stopped { stack, ..stop },
    }
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
