//! The bias model: fetches edges, makes frequencies, temperatures and biases, once a second.

use crate::capture::{Clock, Rings};
use crate::channels::{self, BIAS, LOOK, MODEL_ALIVE, MODEL_RUNS, STEP, TRIM};
#[cfg(feature = "inputs")]
use crate::chip::Chip;
use crate::params::{FETCH_PERIOD, TIMEBASE};
#[cfg(feature = "pps")]
use crate::pps::PULSE;
use crate::redundant::{update, Compensator, CHANNELS};
use crate::retained;
use crate::stop::halt;
use embassy_time::Ticker;
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
#[cfg(feature = "pps")]
use hrg_core::gnss::GnssClock;
#[cfg(feature = "inputs")]
use hrg_core::link::InputsUsed;
#[cfg(feature = "pps")]
use hrg_core::pps::Pps;
#[cfg(not(feature = "pps"))]
use hrg_core::pps::Report;
use hrg_core::rate_path::PendingBias;
use hrg_core::reset::Halt;
use hrg_core::status::UnitStatus;
use hrg_core::AXES;

/// Results of the start.
pub struct Start {
    /// The crystal is right.
    pub crystal: bool,
    /// The processor's own temperature and supply.
    #[cfg(feature = "inputs")]
    pub chip: Chip,
    /// The correction of the clock before a reset.
    #[cfg(feature = "pps")]
    pub correction: f64,
}

/// A pulse, and the time that a host says it was of.
#[cfg(feature = "pps")]
fn take_pulse(pps: &mut Pps, gnss: &mut GnssClock) {
    if let Some(pulse) = PULSE.try_take() {
        pps.pulse(pulse);
        gnss.pulse(pulse);
    }
    if let Some((time, at)) = channels::GNSS_TIME.try_take() {
        gnss.set(time, at);
    }
}

/// See the module.
#[embassy_executor::task]
pub async fn task(
    mut rings: Rings,
    clock: Clock,
    #[cfg_attr(not(feature = "inputs"), allow(unused_mut))] mut start: Start,
    mut models: [&'static mut Compensator; CHANNELS],
) {
    let mut bank = CounterBank::new(Config::at(TIMEBASE), GATES_PER_STEP);
    #[cfg(feature = "pps")]
    let mut pps = Pps::new(TIMEBASE).with_correction(start.correction);
    #[cfg(feature = "pps")]
    let mut gnss = GnssClock::new(TIMEBASE);
    #[cfg(feature = "inputs")]
    let mut inputs = hrg_core::inputs::InputBank::default();
    let mut ticker = Ticker::every(FETCH_PERIOD);
    loop {
        ticker.next().await;
        // The time first, then the edges: all edges before that time are then in.
        let now = clock.now();
        for k in 0..AXES {
            rings.fetch(k, |stamps| hrg_fast::push(&mut bank, k, stamps));
        }
        #[cfg(feature = "pps")]
        take_pulse(&mut pps, &mut gnss);
        #[cfg(feature = "inputs")]
        while let Ok(values) = channels::INPUTS.try_receive() {
            inputs.receive(&values);
        }
        LOOK.tell(now);
        MODEL_ALIVE.give();
        MODEL_RUNS.give();
        let Some(step) = bank.poll(now) else { continue };
        #[cfg(feature = "pps")]
        let (step, report) = pps.second(step);
        #[cfg(feature = "pps")]
        if let Some(mark) = gnss.mark(now, pps.correction()) {
            channels::TIME_MARK.signal(mark);
        }
        #[cfg(not(feature = "pps"))]
        let report = Report::NONE;
        #[cfg(feature = "sensors")]
        let step =
            hrg_core::sensors::with_readings(step, channels::SENSORS.try_take().as_ref(), &crate::params::SENSOR);
        channels::stand(UnitStatus::TIMEBASE, report.out_of_bounds);
        if let Some(trim) = TRIM.try_take() {
            models.iter_mut().for_each(|model| model.set_trim(trim));
        }
        #[cfg(feature = "inputs")]
        {
            start.chip.second(&mut inputs);
            #[cfg(feature = "aux")]
            if let Some(window) = channels::SENSORS.try_take().filter(|w| w.step == step.step) {
                inputs.take(&window, &crate::params::AUX);
            }
            let values = inputs.step();
            models.iter_mut().for_each(|model| model.set_inputs(values));
            if inputs.any() {
                channels::INPUTS_USED.signal(InputsUsed { step: step.step, values: *values.values() });
            }
        }
        #[cfg(feature = "field-log")]
        if let Some(zero) = channels::ZERO.try_take() {
            models.iter_mut().for_each(|model| model.set_zero(zero));
        }
        let Some(output) = update(&mut models, &step) else {
            defmt::error!("the two models differ: corruption detected");
            halt(Halt::Corruption)
        };
        BIAS.signal(PendingBias::new(TIMEBASE, &step, &output));
        // States that a false clock has made are of no use after the next start.
        if !start.crystal || report.out_of_bounds {
            retained::forget();
        } else {
            #[cfg(feature = "pps")]
            retained::keep_correction(pps.correction());
            retained::keep(models[0], step.step);
            #[cfg(feature = "battery")]
            crate::backup::keep(models[CHANNELS - 1]);
        }
        // Telemetry that is not listening loses a second; the bias is on its way.
        let _ = STEP.try_send((step, output, report));
    }
}
