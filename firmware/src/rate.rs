//! The rate task: ADC frame in, bias off, rate frame out. It runs on an interrupt executor above all other tasks and waits for
//! nothing but its inputs: queues that are full drop, and the drop is flagged. The decisions are in
//! [`hrg_core::rate_output`].

use crate::adc::{self, Adc};
#[cfg(any(feature = "sensors", feature = "aux"))]
use crate::channels::SENSORS;
use crate::channels::{self, BIAS, DECIMATION, FETCHED, FRAMES, LOOK, RATES_RUN, RATE_ALIVE, RATE_PATH, SECONDS};
use crate::stop::halt;
use core::future::poll_fn;
use core::task::Poll;
use hrg_core::rate_output::RateOutput;
use hrg_core::rate_path::RateFrame;
use hrg_core::reset::Halt;

fn send(frame: RateFrame) -> bool {
    FRAMES.try_send(frame).is_ok()
}

/// Work of the rate task, with the moment that it is of.
enum Work {
    /// A frame of the ADC has come.
    Frame(u32),
    /// The time has gone on.
    Look(u32),
}

impl Work {
    /// The next work, if there is any.
    fn next() -> Option<Self> {
        FETCHED.take().map(Self::Frame).or_else(|| LOOK.take().map(Self::Look))
    }

    /// Waits for it.
    async fn wait() -> Self {
        poll_fn(|context| {
            let work = Self::next().or_else(|| {
                RATE_PATH.register(context.waker());
                Self::next()
            });
            work.map_or(Poll::Pending, Poll::Ready)
        })
        .await
    }
}

/// See the module.
#[embassy_executor::task]
pub async fn task(mut adc: Adc, output: &'static mut RateOutput) {
    #[cfg(any(feature = "sensors", feature = "aux"))]
    let mut sensors = hrg_core::sensors::SensorBank::new(crate::params::TIMEBASE);
    adc.start();
    loop {
        let work = Work::wait().await;
        let second = match work {
            Work::Frame(tick) => {
                let received = adc.receive();
                let Some(codes) = received.sample() else { continue };
                #[cfg(any(feature = "sensors", feature = "aux"))]
                if let Some(window) = codes.is_ok().then(|| sensors.push(tick, received.sensors())).flatten() {
                    SENSORS.signal(window);
                }
                output.sample(tick, codes, send)
            }
            Work::Look(now) => {
                adc.look();
                #[cfg(feature = "self-test")]
                adc.test();
                // (A bias comes 50 ms before it holds, a decimation waits for the second's end: no need to look at each sample.)
                if let Some(bias) = BIAS.try_take() {
                    output.set_bias(bias);
                }
                if let Some(decimation) = DECIMATION.try_take() {
                    output.set_decimation(decimation);
                }
                output.set_standing(channels::standing());
                output.look(now, send)
            }
        };
        adc::mark_next(output.ends_next());
        #[cfg(feature = "bring-up")]
        crate::bring_up::rate_task_ran();
        RATE_ALIVE.give();
        RATES_RUN.give();
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
