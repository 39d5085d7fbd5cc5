//! The rate path: converter frame in, bias off, rate frame out. It is the interrupt of the converter's DMA, above everything
//! that is not a peripheral's own handler, and waits for nothing: queues that are full drop, and say so.
//!
//! No task runs it. At 1 kHz a wake and a poll took 250 instructions of each sample, a third of the whole way from data-ready;
//! and there is nothing in it to wait for.

use crate::channels::{BIAS, DIVIDER, FRAMES, RATE_ALIVE, SUMMARY, TICK};
use crate::converter::Converter;
use crate::once;
use crate::params::DROPS_IN_A_ROW;
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use hrg_core::converter::Fault;
use hrg_core::rate_path::{Event, RateFrame, RatePath};
use hrg_core::status::unit;
use static_cell::StaticCell;

/// The rate path on its way to the interrupt that runs it.
static START: Signal<CriticalSectionRawMutex, &'static mut Rate> = Signal::new();

/// What the rate path works with.
pub struct Rate {
    converter: Converter,
    path: RatePath,
    /// What start-up has found: in every frame.
    start_status: u8,
    dropped: u16,
    drops_to_say: bool,
    in_a_row: u16,
    /// Fetches of edges (each 10 ms) without a sample between them: the converter is silent after two.
    silent: u8,
}

impl Rate {
    /// Starts the rate path.
    pub fn start(converter: Converter, path: RatePath, start_status: u8) {
        static PLACE: StaticCell<Rate> = StaticCell::new();
        let rate = Self { converter, path, start_status, dropped: 0, drops_to_say: false, in_a_row: 0, silent: 0 };
        START.signal(once(PLACE.try_init(rate)));
        interrupt::DMA2_STREAM0.set_priority(Priority::P6);
        Converter::start();
    }

    /// A frame of the converter has come; `tick`: the timer at its data-ready edge.
    fn sample(&mut self, tick: u32) {
        self.silent = 0;
        self.stage();
        let event = match self.converter.codes() {
            Ok(codes) => {
                self.converter.set_up_done();
                self.path.sample(tick, codes)
            }
            Err(fault) => {
                if fault == Fault::Reset {
                    self.converter.set_up();
                }
                self.path.missing(tick)
            }
        };
        self.done(event);
    }

    /// Edges were fetched; `now`: the timer then.
    fn fetched(&mut self, now: u32) {
        self.silent = self.silent.saturating_add(1);
        if self.silent >= 2 {
            self.stage();
            let event = self.path.missing(now);
            self.done(event);
        }
    }

    fn stage(&mut self) {
        if let Some(staged) = BIAS.try_take() {
            self.path.stage(staged);
        }
    }

    fn done(&mut self, event: Event) {
        RATE_ALIVE.signal(());
        let Event { frame, summary, upset } = event;
        if upset {
            defmt::error!("bias or scale has changed in memory");
            crate::halt()
        }
        if let Some(mut frame) = frame {
            frame.unit_status |= self.start_status;
            if self.drops_to_say {
                frame.unit_status |= unit::FRAMES_DROPPED;
            }
            self.drops_to_say = !send(frame.sealed());
            if self.drops_to_say {
                self.dropped = self.dropped.saturating_add(1);
                self.in_a_row += 1;
                if self.in_a_row >= DROPS_IN_A_ROW {
                    defmt::error!("no frame has been taken for long: queue or link is upset");
                    crate::halt()
                }
            } else {
                self.in_a_row = 0;
            }
        }
        if let Some(summary) = summary {
            // Telemetry that is not listening loses a second of means; the rates went out all the same.
            let _ = SUMMARY.try_send((summary, self.dropped));
            if let Some(divider) = DIVIDER.try_take() {
                self.path.set_divider(divider);
            }
        }
    }
}

/// Whether there was room for a frame.
#[inline(never)]
fn send(frame: RateFrame) -> bool {
    FRAMES.try_send(frame).is_ok()
}

/// Has the rate path look at what the model has signalled to it.
pub fn wake() {
    interrupt::DMA2_STREAM0.pend();
}

/// The converter's frame is in, or the model has fetched edges.
#[interrupt]
fn DMA2_STREAM0() {
    static mut RATE: Option<&'static mut Rate> = None;
    let fetched = Converter::fetched();
    if RATE.is_none() {
        *RATE = START.try_take();
    }
    let Some(rate) = RATE else { return };
    if let Some(tick) = fetched {
        rate.sample(tick);
    }
    if let Some(now) = TICK.try_take() {
        rate.fetched(now);
    }
}
