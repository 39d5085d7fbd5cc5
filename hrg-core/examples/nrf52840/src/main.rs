//! A navigation computer on an nRF52840, by `nrf52840-hal`: edges of three resonators and samples of an ADS131M08 in, corrected rates out.
//!
//! Everything that computes is `hrg-core`, and all of it is in [`main`]. [`board`] holds what touches the chip; another chip needs another
//! one. The other half of a unit (maintenance mode, watchdog, self-test, redundant model) is in the project's `firmware`.
#![no_std]
#![no_main]

mod board;

use board::{Board, TIMEBASE};
use cortex_m_rt::entry;
use defmt_rtt as _;
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
use hrg_core::link::Message;
use hrg_core::rate_output::RateOutput;
use hrg_core::rate_path::{PendingBias, RatePath, DECIMATION};
use hrg_core::status::UnitStatus;
use panic_probe as _;

#[entry]
fn main() -> ! {
    let mut board = Board::start();
    // Without a valid image the rates are raw, and flagged so.
    let calibration = Calibration::from_bytes(board::image()).unwrap_or_else(|why| {
        defmt::error!("no calibration: {}", defmt::Display2Format(&why));
        Calibration::uncalibrated()
    });
    let path = RatePath::new(TIMEBASE, calibration.scale_factors_dph_per_code(), DECIMATION);
    let mut rates = RateOutput::new(path, UnitStatus::empty());
    let mut model = Compensator::new(calibration, 0.0);
    let mut counters = CounterBank::new(Config::at(TIMEBASE), GATES_PER_STEP);
    loop {
        // The time first, then the edges: all edges before that time are then in.
        let (now, edges) = board.edges();
        for (axis, stamps) in edges.iter().enumerate() {
            counters.push(axis, stamps.iter().copied());
            if stamps.is_full() {
                counters.disturb(axis); // There were more than were kept.
            }
        }
        if let Some(step) = counters.poll(now) {
            let output = model.update(&step);
            rates.set_bias(PendingBias::new(TIMEBASE, &step, &output));
        }
        if let Some((tick, codes)) = board.sample() {
            let sent = rates.sample(tick, codes.as_ref().map_err(|fault| *fault), |frame| board.send(&Message::Rate(frame).encode()));
            if let Err(corruption) = sent {
                // Memory has changed: nothing may be sent any more.
                defmt::panic!("corrupted: {}", defmt::Debug2Format(&corruption));
            }
        }
    }
}
