//! The rate path: converter frame in, bias off, rate frame out. Runs above everything else and waits for nothing
//! but the converter: queues that are full drop, and say so.

use crate::channels::{BIAS, DIVIDER, FRAMES, RATE_ALIVE, SUMMARY, TICK};
use crate::converter::Converter;
use crate::params::DROPS_IN_A_ROW;
use embassy_futures::select::{select, Either};
use hrg_core::converter::Fault;
use hrg_core::rate_path::{Event, RatePath};
use hrg_core::status::unit;

/// See the module.
#[embassy_executor::task]
pub async fn task(mut converter: Converter, mut path: RatePath, start_status: u8) {
    converter.start();
    let mut dropped = 0u16;
    let mut drops_to_say = false;
    let mut in_a_row = 0u16;
    // Fetches of edges (each 10 ms) without a sample between them: the converter is silent after two.
    let mut silent = 0u8;
    loop {
        let event = match select(converter.next(), TICK.wait()).await {
            Either::First(tick) => {
                silent = 0;
                if let Some(staged) = BIAS.try_take() {
                    path.stage(staged);
                }
                match converter.codes() {
                    Ok(codes) => {
                        converter.set_up_done();
                        path.sample(tick, codes)
                    }
                    Err(fault) => {
                        if fault == Fault::Reset {
                            converter.set_up();
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
        let Event { frame, summary, upset } = event;
        if upset {
            defmt::error!("bias or scale has changed in memory");
            crate::halt()
        }
        if let Some(mut frame) = frame {
            frame.unit_status |= start_status;
            if drops_to_say {
                frame.unit_status |= unit::FRAMES_DROPPED;
            }
            drops_to_say = FRAMES.try_send(frame.sealed()).is_err();
            if drops_to_say {
                dropped = dropped.saturating_add(1);
                in_a_row += 1;
                if in_a_row >= DROPS_IN_A_ROW {
                    defmt::error!("no frame has been taken for long: queue or link is upset");
                    crate::halt()
                }
            } else {
                in_a_row = 0;
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
