//! The rate path: ADC frame in, bias off, rate frame out. It waits for nothing but its inputs: queues that are full drop, and the drop is
//! flagged. The decisions are in [`hrg_core::rate_output`].
//!
//! # Design
//! It runs in an interrupt of its own, above all tasks, which [`wake`] pends: a task on an executor cost a tenth of the unit's load in
//! wakers and polls, a thousand times a second.

use crate::adc::{self, Adc};
#[cfg(any(feature = "sensors", feature = "aux"))]
use crate::channels::SENSORS;
use crate::channels::{self, Fast, BIAS, DECIMATION, FETCHED, FRAMES, LOOK, OUTPUT, RATES_RUN, RATE_ALIVE, SECONDS};
use crate::params::{ACCELEROMETERS, TIMEBASE};
use crate::stop::{halt, once};
use core::sync::atomic::{AtomicPtr, Ordering};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use hrg_core::output::OutputSettings;
use hrg_core::rate_output::{Corruption, RateOutput, RateSecond};
use hrg_core::rate_path::{RateFrame, RatePath};
use hrg_core::reset::Halt;
use hrg_core::status::UnitStatus;
use hrg_core::AXES;
use static_cell::StaticCell;

fn send(frame: RateFrame) -> bool {
    FRAMES.try_send(Fast::Rates(frame)).is_ok()
}

/// Work of the rate path, with the moment that it is of.
enum Work {
    /// A frame of the ADC has come.
    Frame(u32),
    /// The time has gone on.
    Look(u32),
}

impl Work {
    /// The next work, if there is any.
    #[inline(always)]
    fn next() -> Option<Self> {
        FETCHED.take().map(Self::Frame).or_else(|| LOOK.take().map(Self::Look))
    }
}

/// State of the rate path.
pub struct Rates {
    adc: Adc,
    output: RateOutput,
    #[cfg(any(feature = "sensors", feature = "aux"))]
    sensors: hrg_core::sensors::SensorBank,
}

/// The state, for the interrupt and for nobody else.
static STATE: AtomicPtr<Rates> = AtomicPtr::new(core::ptr::null_mut());

/// Settings that rates begin with.
pub struct Start {
    /// Of the output.
    pub sent: OutputSettings,
    /// Scale factors, deg/h per code.
    pub scale_dph: [f32; AXES],
    /// Flags that the start has found.
    pub status: UnitStatus,
}

/// Begins: hands the state to the interrupt, and fetches from the next data-ready edge on.
// (Out of line, and the state is made here: it is large, and what the start needs of the stack must not have it beside it.)
#[inline(never)]
pub fn start(adc: Adc, start: &Start) {
    static PLACE: StaticCell<Rates> = StaticCell::new();
    channels::sends(start.sent);
    let state = once(PLACE.try_init_with(|| Rates {
        adc,
        output: RateOutput::new(
            RatePath::new(TIMEBASE, start.scale_dph, start.sent.decimation).with_output(start.sent, ACCELEROMETERS),
            start.status,
        ),
        #[cfg(any(feature = "sensors", feature = "aux"))]
        sensors: hrg_core::sensors::SensorBank::new(TIMEBASE),
    }));
    STATE.store(state, Ordering::Release);
    interrupt::UART5.set_priority(Priority::P6);
    interrupt::UART5.unpend();
    // SAFETY: what the handler touches is set up.
    #[allow(unsafe_code)]
    unsafe {
        interrupt::UART5.enable();
    }
    adc::start();
}

/// Has the rate path look for work: pends the interrupt of a peripheral that the unit does not use.
#[inline(always)]
pub fn wake() {
    interrupt::UART5.pend();
}

/// The rate path: all work that there is.
#[interrupt]
fn UART5() {
    // SAFETY: `start` has put a state there that lives for ever and hands it to nobody else, and an interrupt does not interrupt itself.
    #[allow(unsafe_code)]
    let Some(rates) = (unsafe { STATE.load(Ordering::Acquire).as_mut() }) else {
        return;
    };
    while let Some(work) = Work::next() {
        rates.work(&work);
    }
}

impl Rates {
    #[inline(always)]
    fn work(&mut self, work: &Work) {
        let second = match *work {
            Work::Frame(tick) => {
                let received = self.adc.receive();
                let Some(codes) = received.sample() else { return };
                #[cfg(any(feature = "sensors", feature = "aux"))]
                if let Some(window) = codes.is_ok().then(|| self.sensors.push(tick, received.sensors())).flatten() {
                    SENSORS.signal(window);
                }
                match codes {
                    Ok(codes) => hrg_fast::sample(&mut self.output, tick, codes, send),
                    Err(_) => self.output.bad(tick, send),
                }
            }
            Work::Look(now) => self.look(now),
        };
        if let Some(increments) = self.output.increments() {
            // (A link that takes none loses it: the next message's sample number tells.)
            let _ = FRAMES.try_send(Fast::Increments(increments));
        }
        adc::mark_next(self.output.ends_next());
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

    /// The time has gone on.
    // (Out of line: a hundred times a second.)
    #[inline(never)]
    fn look(&mut self, now: u32) -> Result<Option<RateSecond>, Corruption> {
        self.adc.look();
        #[cfg(feature = "self-test")]
        self.adc.test();
        // (A bias comes 50 ms before it holds, a decimation waits for the second's end: no need to look at each sample.)
        if let Some(bias) = BIAS.try_take() {
            self.output.set_bias(bias);
        }
        if let Some(decimation) = DECIMATION.try_take() {
            self.output.set_decimation(decimation);
        }
        if let Some(settings) = OUTPUT.try_take() {
            self.output.set_output(settings);
        }
        channels::sends(self.output.output());
        self.output.set_standing(channels::standing());
        self.output.look(now, send)
    }
}
