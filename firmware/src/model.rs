//! The bias model: fetches edges, makes frequencies, temperatures and biases, once a second.

use crate::capture::{Clock, Rings};
use crate::channels::{BIAS, STEP, TICK, TRIM};
use crate::params::{FETCH_PERIOD, TIMER_HZ};
use embassy_time::Ticker;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::{Bank, Config, GATES_PER_STEP};
use hrg_core::rate_path::Staged;
use hrg_core::AXES;

/// See the module.
#[embassy_executor::task]
pub async fn task(mut rings: Rings, clock: Clock, compensator: &'static mut Compensator) {
    let mut bank = Bank::new(Config::at(TIMER_HZ), GATES_PER_STEP);
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
        if let Some(trim) = TRIM.try_take() {
            compensator.set_trim(trim);
        }
        let output = compensator.update(&step);
        BIAS.signal(Staged::new(&step, &output));
        // Telemetry that is not listening loses a second; the bias is on its way.
        let _ = STEP.try_send((step, output));
    }
}
