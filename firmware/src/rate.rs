//! The rate path: data-ready, converter frame, bias off, frame out. Runs above everything else and waits for
//! nothing but the converter: queues that are full drop, and say so.

use crate::capture::Clock;
use crate::channels::{BIAS, DIVIDER, FRAMES, RATE_ALIVE, SUMMARY, TICK};
use crate::converter::{Converter, Fault};
use embassy_futures::select::{select, Either};
use hrg_core::rate_path::{Event, RatePath};
use hrg_core::status::unit;

/// See the module.
#[embassy_executor::task]
pub async fn task(mut converter: Converter, clock: Clock, mut path: RatePath, start_status: u8) {
    let mut dropped = 0u16;
    let mut drops_to_say = false;
    // Fetches without a sample between them: the converter is silent after two.
    let mut silent = 0u8;
    converter.set_up().await;
    loop {
        let event = match select(converter.data_ready.wait_for_falling_edge(), TICK.wait()).await {
            Either::First(()) => {
                silent = 0;
                let tick = clock.data_ready();
                let codes = converter.read().await;
                if let Some(staged) = BIAS.try_take() {
                    path.stage(staged);
                }
                match codes {
                    Ok(codes) => path.sample(tick, codes),
                    Err(fault) => {
                        if fault == Fault::Reset {
                            converter.set_up().await;
                        }
                        path.missing(tick)
                    }
                }
            }
            Either::Second(now) => {
                silent = silent.saturating_add(1);
                if silent < 2 {
                    continue;
                }
                if let Some(staged) = BIAS.try_take() {
                    path.stage(staged);
                }
                path.missing(now)
            }
        };
        RATE_ALIVE.signal(());
        let Event { frame, summary } = event;
        if let Some(mut frame) = frame {
            frame.unit_status |= start_status;
            if drops_to_say {
                frame.unit_status |= unit::FRAMES_DROPPED;
            }
            drops_to_say = FRAMES.try_send(frame).is_err();
            if drops_to_say {
                dropped = dropped.saturating_add(1);
            }
        }
        if let Some(summary) = summary {
            // Telemetry that is not listening loses a second of means; the rates went out all the same.
            let _ = SUMMARY.try_send((summary, dropped));
            if let Some(divider) = DIVIDER.try_take() {
                path.set_divider(divider);
            }
        }
    }
}
