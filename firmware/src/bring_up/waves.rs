//! Square waves from timers: three resonators, the ADC's data-ready, a pulse per second.

use super::{give, pin};
use embassy_stm32::gpio::{AfType, OutputType, Speed};
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::Ocm;
use embassy_stm32::pac::timer::TimGp16;
use embassy_stm32::peripherals::{TIM1, TIM10, TIM12, TIM4, TIM8};
use embassy_stm32::rcc;

/// Counts of a period: of TIM4, TIM1 and TIM12, all at 90 MHz. Near the frequencies of a unit with the default calibration at 10 C: 4900.093,
/// 4891.836 and 4703.669 Hz.
pub const PERIODS: [u16; 3] = [18_367, 18_398, 19_134];

/// The periods go through these, one each 10 ms: so the resolution of the captures shows.
const DITHER: [i16; 4] = [0, 1, 0, -1];

/// TIM8: 30 MHz of 90, 1 kHz.
const READY: (u16, u16) = (2, 30_000);
/// TIM10: 10 kHz of 90 MHz, 1 Hz; high for 10 ms.
const PULSE: (u16, u16) = (8_999, 10_000);
const PULSE_HIGH: u16 = 100;

/// The three waves.
pub struct Waves {
    timers: [TimGp16; 3],
    step: usize,
}

/// Those of its registers that a timer with 1 or 2 channels, or an advanced one, has at the same places (RM0390 sections 16.4 to 18.5).
fn common(timer: *mut ()) -> TimGp16 {
    // SAFETY: the address of a timer.
    #[allow(unsafe_code)]
    unsafe {
        TimGp16::from_ptr(timer)
    }
}

/// A square wave at a channel (from 0 on): counts of a period of the divided clock, and of its high part.
fn wave(timer: TimGp16, channel: usize, prescaler: u16, period: u16, high: u16) {
    timer.psc().write_value(prescaler);
    timer.arr().write(|w| w.set_arr(period - 1));
    timer.ccr(channel).write(|w| w.set_ccr(high));
    timer.ccmr_output(channel / 2).modify(|w| {
        w.set_ocm(channel % 2, Ocm::PWM_MODE1);
        w.set_ocpe(channel % 2, true);
    });
    timer.ccer().modify(|w| w.set_cce(channel, true));
    // All of that counts from an update event on.
    timer.egr().write(|w| w.set_ug(true));
}

fn begin(timer: TimGp16) {
    timer.cr1().modify(|w| {
        w.set_arpe(true);
        w.set_cen(true);
    });
}

/// Sets all of them going.
pub fn start() -> Waves {
    rcc::enable_and_reset::<TIM1>();
    rcc::enable_and_reset::<TIM4>();
    rcc::enable_and_reset::<TIM8>();
    rcc::enable_and_reset::<TIM10>();
    rcc::enable_and_reset::<TIM12>();
    let [x, y, z, ready, pulse] =
        [pac::TIM4.as_ptr(), pac::TIM1.as_ptr(), pac::TIM12.as_ptr(), pac::TIM8.as_ptr(), pac::TIM10.as_ptr()]
            .map(common);
    let timers = [x, y, z];
    for ((timer, channel), period) in timers.into_iter().zip([3, 0, 0]).zip(PERIODS) {
        wave(timer, channel, 0, period, period / 2);
    }
    wave(ready, 3, READY.0, READY.1, READY.1 / 2);
    wave(pulse, 0, PULSE.0, PULSE.1, PULSE_HIGH);
    // The outputs of the advanced timers are off until then (RM0390 section 16.4.18).
    pac::TIM1.bdtr().modify(|w| w.set_moe(true));
    pac::TIM8.bdtr().modify(|w| w.set_moe(true));
    let out = AfType::output(OutputType::PushPull, Speed::Medium);
    give(pin!(PB9), 2, out);
    give(pin!(PA8), 1, out);
    give(pin!(PB14), 9, out);
    give(pin!(PC9), 3, out);
    give(pin!(PB8), 3, out);
    [x, y, z, ready, pulse].into_iter().for_each(begin);
    Waves { timers, step: 0 }
}

impl Waves {
    /// The next step of the dither.
    pub fn dither(&mut self) {
        self.step = (self.step + 1) % DITHER.len();
        for (timer, period) in self.timers.iter().zip(PERIODS) {
            timer.arr().write(|w| w.set_arr(period.saturating_add_signed(DITHER[self.step]) - 1));
        }
    }
}
