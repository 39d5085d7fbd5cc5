//! The bias model: fetches edges, makes frequencies, temperatures and biases, once a second.

use crate::capture::{Clock, Rings};
use crate::channels::{BIAS, STEP, TICK};
use crate::params::{BIAS_DELAY_TICKS, FETCH_PERIOD, GATES_PER_STEP};
use embassy_time::Ticker;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::{Bank, Config};
use hrg_core::rate_path::Staged;
use hrg_core::status::axis;
use hrg_core::AXES;

/// See the module.
#[embassy_executor::task]
pub async fn task(mut rings: Rings, clock: Clock, compensator: &'static mut Compensator) {
    let mut bank = Bank::new(Config::REFERENCE, GATES_PER_STEP);
    let mut ticker = Ticker::every(FETCH_PERIOD);
    loop {
        ticker.next().await;
        // The time first, then the edges: all edges before that time are then in.
        let now = clock.now();
        for k in 0..AXES {
            if !rings.fetch(k, |stamps| bank.push(k, stamps)) {
                bank.disturb(k);
            }
        }
        TICK.signal(now);
        let Some(step) = bank.poll(now) else { continue };
        let mut output = compensator.step(&step.frequency_hz);
        for k in 0..AXES {
            if step.rejected[k] + step.missing[k] > 0 {
                output.status[k] |= axis::EDGE_ERRORS;
            }
        }
        BIAS.signal(Staged {
            effective_tick: (step.end_ticks as u32).wrapping_add(BIAS_DELAY_TICKS),
            step: step.step,
            bias_dph: output.bias_dph,
            status: output.status,
        });
        // Telemetry that is not listening loses a second; the bias is on its way.
        let _ = STEP.try_send((step, output));
    }
}
