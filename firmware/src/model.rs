//! The bias model: fetches edges, makes frequencies, temperatures and biases, once a second.

use crate::capture::{Clock, Rings};
use crate::channels::{self, BIAS, MODEL_ALIVE, STEP, TICK, TRIM};
use crate::halt::halt;
use crate::kept;
use crate::params::{FETCH_PERIOD, TIMEBASE};
use crate::pps::{PulseInput, PULSE};
use embassy_time::Ticker;
use hrg_core::compensator::{update_both, Compensator};
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
use hrg_core::pps::Pps;
use hrg_core::rate_path::PendingBias;
use hrg_core::reset::Halt;
use hrg_core::status::UnitStatus;
use hrg_core::AXES;

/// Results of the start.
pub struct Start {
    /// The crystal is right.
    pub crystal: bool,
    /// The correction of the clock before a reset.
    pub correction: f64,
}

/// See the module.
#[embassy_executor::task]
// (The input of the pulses is only held: a pin that is dropped is an input no more.)
pub async fn task(
    mut rings: Rings,
    clock: Clock,
    _pulses: PulseInput,
    start: Start,
    redundant: [&'static mut Compensator; 2],
) {
    let [first, second] = redundant;
    let mut bank = CounterBank::new(Config::at(TIMEBASE), GATES_PER_STEP);
    let mut pps = Pps::new(TIMEBASE).with_correction(start.correction);
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
        if let Some(pulse) = PULSE.try_take() {
            pps.pulse(pulse);
        }
        TICK.signal(now);
        MODEL_ALIVE.signal(());
        let Some(step) = bank.poll(now) else { continue };
        let (step, report) = pps.second(step);
        #[cfg(feature = "sensors")]
        let step =
            hrg_core::sensors::with_readings(step, channels::SENSORS.try_take().as_ref(), &crate::params::SENSOR);
        channels::stand(UnitStatus::TIMEBASE, report.out_of_bounds);
        if let Some(trim) = TRIM.try_take() {
            first.set_trim(trim);
            second.set_trim(trim);
        }
        let Some(output) = update_both([first, second], &step) else {
            defmt::error!("the two models differ: corruption detected");
            halt(Halt::Corruption)
        };
        BIAS.signal(PendingBias::new(TIMEBASE, &step, &output));
        // States that a false clock has made are of no use after the next start.
        if !start.crystal || report.out_of_bounds {
            kept::forget();
        } else {
            kept::keep_correction(pps.correction());
            kept::keep(first, step.step);
            #[cfg(feature = "battery")]
            crate::backup::keep(second);
        }
        // Telemetry that is not listening loses a second; the bias is on its way.
        let _ = STEP.try_send((step, output, report));
    }
}
