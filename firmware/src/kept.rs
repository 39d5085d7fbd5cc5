//! The states of the model in RAM that a reset leaves alone: a unit that starts anew goes on from them.
//!
//! # Design
//! Two places, written in turn each second; each ends with a checksum ([`hrg_core::history`]). The start-up code of cortex-m-rt neither
//! clears nor fills the section `.uninit`. After a power-on it holds anything, which has no checksum.

use core::sync::atomic::{AtomicU32, Ordering};
use hrg_core::compensator::Compensator;
use hrg_core::history::{newer, Kept, KEPT_WORDS};

type Place = [AtomicU32; KEPT_WORDS];

// (The name is what the virtual board looks for.)
#[allow(unsafe_code)] // The section is one of cortex-m-rt's, made for this.
#[unsafe(link_section = ".uninit.kept")]
#[unsafe(export_name = "_kept_states")]
static PLACES: [Place; 2] = [const { [const { AtomicU32::new(0) }; KEPT_WORDS] }; 2];

fn words(place: &'static Place) -> impl Fn(usize) -> u32 + Copy {
    move |k| place.get(k).map_or(0, |word| word.load(Ordering::Relaxed))
}

/// What was kept before the reset; `None`: nothing intact.
pub fn newest() -> Option<Kept<impl Fn(usize) -> u32 + Copy>> {
    newer(PLACES.each_ref().map(words))
}

/// Keeps the states of a model after a step, in the older place. `step` counts the steps.
pub fn keep(model: &mut Compensator, step: u32) {
    let place = &PLACES[step as usize % 2];
    model.keep(|k, word| {
        if let Some(to) = place.get(k) {
            to.store(word, Ordering::Relaxed);
        }
    });
}
