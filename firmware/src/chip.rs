//! The processor's own temperature and supply: its ADC1, whose conversions wait for nobody.
//!
//! # Design
//! Once a second the model takes the conversions that it has begun a second before, and begins the next: an injected group of the internal
//! reference and three times the thermometer, at the longest sampling time (both want 10 us). So nothing waits, and no interrupt comes. The
//! arithmetic is in [`hrg_core::chip`]. Registers: RM0390 chapter 13; the maker's codes: data sheet, tables of the internal reference and of the
//! temperature sensor.

use crate::params;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::pac;
use embassy_stm32::pac::adc::vals::SampleTime;
use embassy_stm32::pac::adccommon::vals::Adcpre;
use embassy_stm32::peripherals::ADC1;
use embassy_stm32::{rcc, Peri};
use hrg_core::chip::{Factory, CONVERSIONS};
use hrg_core::inputs::{InputBank, CHIP_C, CHIP_V};

/// The internal reference, and the thermometer.
const REFERENCE: u8 = 17;
#[cfg(not(feature = "stm32f405rg"))]
const THERMOMETER: u8 = 18;
#[cfg(feature = "stm32f405rg")]
const THERMOMETER: u8 = 16;

/// The maker's codes in the system memory: of the reference, and of the thermometer at 30 and 110 C.
const CODES: [usize; 3] = [0x1FFF_7A2A, 0x1FFF_7A2C, 0x1FFF_7A2E];

/// Cycles that the ADC and the thermometer take to start, 3 and 10 us (data sheet), twice.
const SETTLES: u32 = 20 * (params::TIMER_HZ / 500_000);

/// Bits of the last supply, V, and temperature, C.
static SUPPLY_V: AtomicU32 = AtomicU32::new(f32::NAN.to_bits());
static TEMPERATURE_C: AtomicU32 = AtomicU32::new(f32::NAN.to_bits());

/// The last supply, V, and temperature, C; NaN: there is none.
#[cfg(feature = "self-test")]
pub fn latest() -> (f32, f32) {
    let value = |bits: &AtomicU32| f32::from_bits(bits.load(Ordering::Relaxed));
    (value(&SUPPLY_V), value(&TEMPERATURE_C))
}

/// See the module.
pub struct Chip {
    factory: Factory,
    _adc: Peri<'static, ADC1>,
}

fn code(address: usize) -> u16 {
    // SAFETY: a half-word of the system memory, which is there on all chips of the family and only read.
    #[allow(unsafe_code)]
    unsafe {
        core::ptr::with_exposed_provenance::<u16>(address).read_volatile()
    }
}

impl Chip {
    /// Sets the ADC up and begins the first conversions.
    pub fn start(adc: Peri<'static, ADC1>) -> Self {
        rcc::enable_and_reset::<ADC1>();
        // PCLK2 is 45 MHz: 11.25 for the ADC, of 36 at most.
        pac::ADC123_COMMON.ccr().write(|w| {
            w.set_adcpre(Adcpre::DIV4);
            w.set_tsvrefe(true);
        });
        let registers = pac::ADC1;
        registers.cr1().write(|w| w.set_scan(true));
        registers.smpr1().write(|w| {
            w.set_smp(usize::from(REFERENCE) - 10, SampleTime::CYCLES480);
            w.set_smp(usize::from(THERMOMETER) - 10, SampleTime::CYCLES480);
        });
        registers.jsqr().write(|w| {
            w.set_jl(CONVERSIONS as u8 - 1);
            w.set_jsq(0, REFERENCE);
            (1..CONVERSIONS).for_each(|k| w.set_jsq(k, THERMOMETER));
        });
        registers.cr2().write(|w| w.set_adon(true));
        cortex_m::asm::delay(SETTLES);
        registers.cr2().modify(|w| w.set_jswstart(true));
        let [reference, at_30_c, at_110_c] = CODES.map(code);
        Self { factory: Factory { reference, at_30_c, at_110_c }, _adc: adc }
    }

    /// Puts in temperature and supply as they were a second ago, where they were measured; begins the next conversions.
    pub fn second(&mut self, inputs: &mut InputBank) {
        let registers = pac::ADC1;
        let done = registers.sr().read().jeoc();
        let codes = core::array::from_fn(|k| registers.jdr(k).read().jdata());
        registers.sr().write(|w| w.0 = !0b0_1110);
        registers.cr2().modify(|w| w.set_jswstart(true));
        let found = self.factory.values(codes).filter(|_| done);
        let shown = found.unwrap_or((f32::NAN, f32::NAN));
        SUPPLY_V.store(shown.0.to_bits(), Ordering::Relaxed);
        TEMPERATURE_C.store(shown.1.to_bits(), Ordering::Relaxed);
        if let Some((supply_v, temperature_c)) = found {
            inputs.set(CHIP_C, temperature_c);
            inputs.set(CHIP_V, supply_v);
        }
    }
}
