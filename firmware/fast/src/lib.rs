//! The functions of hrg-core that run for each edge, each sample and each frame, compiled for speed.
//!
//! # Design
//! cargo has one level of optimization for a crate. hrg-core and the firmware are compiled for size, so that a program fits its slot
//! (memory.x); this crate is compiled for speed. The functions of hrg-core that it calls are marked `#[inline]`, as are those that they call, so
//! their code is made here. Nothing is computed here.
#![no_std]
#![warn(missing_docs)]

use core::sync::atomic::{AtomicU32, Ordering};
use heapless::Vec;
use hrg_core::adc::{Dialogue, Received, WORDS};
use hrg_core::calibration::Calibration;
use hrg_core::compensator::{Compensator, Model};
use hrg_core::frequency::CounterBank;
use hrg_core::history::Settling;
use hrg_core::increments::IncrementFrame;
use hrg_core::link::{Message, FAST_FRAME};
use hrg_core::rate_output::{Corruption, RateOutput, RateSecond};
use hrg_core::rate_path::{RateFrame, CHANNELS};
use static_cell::StaticCell;

/// [`Dialogue::receive`].
#[inline(never)]
pub fn receive(dialogue: &mut Dialogue, frame: &[u32; WORDS], missed: bool) -> Received {
    dialogue.receive(frame, missed)
}

/// [`RateOutput::good`].
///
/// # Errors
/// Memory is corrupted.
#[inline(never)]
pub fn sample(
    output: &mut RateOutput,
    tick: u32,
    codes: &[i32; CHANNELS],
    send: fn(RateFrame) -> bool,
) -> Result<Option<RateSecond>, Corruption> {
    output.good(tick, codes, send)
}

/// [`CounterBank::push`], of stamps that DMA has written.
#[inline(never)]
pub fn push(bank: &mut CounterBank, axis: usize, stamps: &[AtomicU32]) {
    bank.push(axis, stamps.iter().map(|stamp| stamp.load(Ordering::Relaxed)));
}

// A bias model in its place. (A large one: compiled for size it would be made on the stack and copied, several times.)
macro_rules! in_place {
    ($name:ident, $model:ty) => {
        /// A bias model in its place; `None`: there is one already.
        #[inline(never)]
        pub fn $name(place: &'static StaticCell<$model>, calibration: &Calibration) -> Option<&'static mut $model> {
            place.try_init_with(|| <$model>::new(calibration.clone(), 0.0))
        }
    };
}
in_place!(compensator, Compensator);
in_place!(settling, Model<Settling>);

/// Room for a rate frame and increments.
pub const FAST: usize = 2 * FAST_FRAME;

/// [`Message::encode_increments`].
#[inline(never)]
pub fn encode_increments(increments: &IncrementFrame, out: &mut Vec<u8, FAST>) {
    Message::encode_increments(increments, out);
}

/// [`Message::encode_rate`].
#[inline(never)]
pub fn encode(frame: &RateFrame, out: &mut Vec<u8, FAST>) {
    Message::encode_rate(frame, out);
}
