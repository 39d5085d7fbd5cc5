//! The rate task: ADC frame in, bias off, rate frame out. It runs on an interrupt executor above all other tasks and waits for
//! nothing but its inputs: queues that are full drop, and the drop is flagged. The decisions are in
//! [`hrg_core::rate_output`].

use crate::adc::{self, Adc};
#[cfg(any(feature = "sensors", feature = "aux"))]
use crate::channels::SENSORS;
use crate::channels::{self, BIAS, DECIMATION, FRAMES, RATE_ALIVE, SECONDS, TICK};
use crate::stop::halt;
use embassy_futures::select::{select, Either};
use hrg_core::rate_output::RateOutput;
use hrg_core::rate_path::RateFrame;
use hrg_core::reset::Halt;

fn send(frame: RateFrame) -> bool {
    FRAMES.try_send(frame).is_ok()
}

/// See the module.
#[embassy_executor::task]
pub async fn task(mut adc: Adc, output: &'static mut RateOutput) {
    #[cfg(any(feature = "sensors", feature = "aux"))]
    let mut sensors = hrg_core::sensors::SensorBank::new(crate::params::TIMEBASE);
    adc.start();
    loop {
        let input = select(adc.sample(), TICK.wait()).await;
        if let Some(bias) = BIAS.try_take() {
            output.set_bias(bias);
        }
        output.set_standing(channels::standing());
        if let Some(decimation) = DECIMATION.try_take() {
            output.set_decimation(decimation);
        }
        let second = match input {
            Either::First((tick, codes, others)) => {
                #[cfg(any(feature = "sensors", feature = "aux"))]
                if let Some(window) = codes.is_ok().then(|| sensors.push(tick, others)).flatten() {
                    SENSORS.signal(window);
                }
                #[cfg(not(any(feature = "sensors", feature = "aux")))]
                let [_, _, _] = others;
                output.sample(tick, codes, send)
            }
            Either::Second(now) => {
                adc.look();
                output.look(now, send)
            }
        };
        adc::mark_next(output.ends_next());
        #[cfg(feature = "bring-up")]
        crate::bring_up::rate_task_ran();
        RATE_ALIVE.signal(());
        match second {
            // Telemetry that is not listening loses a second of means; the rates went out all the same.
            Ok(Some(second)) => drop(SECONDS.try_send(second)),
            Ok(None) => {}
            Err(corruption) => {
                defmt::error!("corruption detected: {}", corruption);
                halt(Halt::Corruption)
            }
        }
    }
}
