//! The first hour with a bare board (feature `bring-up`, docs/bring-up.md): a NUCLEO-F446RE and jumper wires, no gyro and no ADC. Peripherals that the unit
//! leaves free make its inputs; the unit's own tasks run as they fly. Their figures are measured and printed as a table.
//!
//! | does | with | file |
//! |---|---|---|
//! | three square waves, data-ready, pulses per second | TIM4, TIM1, TIM12, TIM8, TIM10 | `waves` |
//! | answers as the ADC does | SPI2 as a slave, EXTI 12 | `adc_model` |
//! | listens to the link, and asks | UART5 | `listener` |
//! | measures, and prints the table | the processor's cycle counter | `measure`, `table` |

mod adc_model;
mod expected;
mod listener;
mod measure;
mod table;
mod waves;

use crate::maintain::Sectors;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::DWT;
use embassy_executor::Spawner;
use embassy_stm32::gpio::{AfType, Flex};
use embassy_stm32::interrupt;
use embassy_stm32::pac;
use embassy_time::Instant;
use hrg_core::sectors::{Sector, Store};

/// The processor's cycles, modulo 32 bits.
pub fn cycles() -> u32 {
    DWT::cycle_count()
}

/// Cycles of that erase; 0: it was not done.
static ERASE: AtomicU32 = AtomicU32::new(0);
/// Duration of the same erase by the time driver, us: it loses turns of its counter while the processor is stalled.
static ERASE_US: AtomicU32 = AtomicU32::new(0);

/// The cycle counter runs, and a sector is erased (sector 2 of the flash, for calibrations; only where it is empty): before the unit's tasks run, which an erase would stop.
pub fn prepare(sectors: &mut Sectors) {
    // SAFETY: nothing else in this program uses the debug registers.
    #[allow(unsafe_code)]
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    if sectors.view(Sector::B).iter().all(|b| *b == 0xFF) {
        let (begun, time) = (cycles(), Instant::now());
        if sectors.erase(Sector::B) {
            ERASE.store(cycles().wrapping_sub(begun), Relaxed);
            ERASE_US.store(time.elapsed().as_micros() as u32, Relaxed);
        }
    } else {
        defmt::warn!("sector 2 holds a calibration: its erase is not measured; erase the chip first");
    }
}

/// The inputs begin, and are measured: after the unit's tasks were started.
pub fn start(spawner: Spawner) {
    adc_model::start();
    let listener = listener::start();
    crate::spawned(measure::task(listener, waves::start()), |t| spawner.spawn(t));
}

/// Data-ready was captured, and its sample is not corrected yet.
static FETCHING: AtomicBool = AtomicBool::new(false);
/// Cycle count at that data-ready, and cycles of this module's own interrupts since.
static READY_AT: AtomicU32 = AtomicU32::new(0);
static OWN_SINCE: AtomicU32 = AtomicU32::new(0);
/// Cycles of its own interrupts in all.
static OWN: AtomicU32 = AtomicU32::new(0);
/// From data-ready to the corrected sample: samples, cycles of all, most.
static SAMPLES: AtomicU32 = AtomicU32::new(0);
static SUM: AtomicU32 = AtomicU32::new(0);
static WORST: AtomicU32 = AtomicU32::new(0);

/// The interrupt of data-ready begins.
pub fn data_ready() {
    READY_AT.store(cycles(), Relaxed);
    OWN_SINCE.store(0, Relaxed);
    FETCHING.store(true, Relaxed);
}

/// The rate task has run; where its frame was in, it has corrected a sample.
pub fn rate_task_ran() {
    if pac::DMA2.st(crate::wired::RX).cr().read().en() || !FETCHING.swap(false, Relaxed) {
        return;
    }
    let took = cycles().wrapping_sub(READY_AT.load(Relaxed)).wrapping_sub(OWN_SINCE.load(Relaxed));
    SAMPLES.fetch_add(1, Relaxed);
    SUM.fetch_add(took, Relaxed);
    WORST.fetch_max(took, Relaxed);
}

/// Chip select has risen: a frame of the ADC has ended.
#[interrupt]
fn EXTI15_10() {
    let begun = cycles();
    pac::EXTI.pr(0).write(|w| w.set_line(adc_model::SELECT_LINE, true));
    adc_model::frame_ended();
    let took = cycles().wrapping_sub(begun);
    OWN_SINCE.fetch_add(took, Relaxed);
    OWN.fetch_add(took, Relaxed);
}

/// A pin for good: a signal of a peripheral (data sheet, table 11).
fn give(pin: Flex<'static>, function: u8, kind: AfType) {
    let mut pin = pin;
    pin.set_as_af_unchecked(function, kind);
    core::mem::forget(pin);
}

/// A pin that the unit leaves free.
macro_rules! pin {
    ($name:ident) => {{
        // SAFETY: the unit does not use it (crate::board), and this module once.
        #[allow(unsafe_code)]
        let pin = unsafe { embassy_stm32::peripherals::$name::steal() };
        embassy_stm32::gpio::Flex::new(pin)
    }};
}
use pin;
