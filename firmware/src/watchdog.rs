//! The independent watchdog (IWDG): fed while every part of the unit runs, and given more time while a sector is erased.
//!
//! # Design
//! One type owns the peripheral; maintenance borrows it for the length of an erase through [`Patience`]. The time to feed it is decided by
//! [`hrg_core::supervision`].
//!
//! # Tradeoffs
//! embassy's `IndependentWatchdog` cannot change its time once it runs, so the four registers are driven here (RM0390 chapter 20).

use crate::channels::{self, LINK_ALIVE, MODEL_ALIVE, RATE_ALIVE, TELEMETRY_ALIVE};
use crate::params::{self, Time};
use crate::program;
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::IWDG as REGISTERS;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::Peri;
use embassy_time::{Duration, Timer};
use hrg_core::status::UnitStatus;
use hrg_core::supervision::{Alive, Supervision, LOOK_MS};

fn feed() {
    REGISTERS.kr().write(|w| w.set_key(Key::RESET));
}

fn set((prescaler, reload): Time) {
    REGISTERS.kr().write(|w| w.set_key(Key::ENABLE));
    REGISTERS.pr().write(|w| w.set_pr(Pr::from_bits(prescaler)));
    REGISTERS.rlr().write(|w| w.set_rl(reload));
    while REGISTERS.sr().read().0 != 0 {}
    feed();
}

/// The watchdog.
pub struct Watchdog {
    _peripheral: Peri<'static, IWDG>,
}

/// The right to lengthen the watchdog's time for a while.
pub struct Patience(());

impl Watchdog {
    /// Takes the peripheral and starts it: the start of the unit is watched as well.
    pub fn new(peripheral: Peri<'static, IWDG>) -> (Self, Patience) {
        REGISTERS.kr().write(|w| w.set_key(Key::START));
        set(params::WATCHDOG_USUAL);
        (Self { _peripheral: peripheral }, Patience(()))
    }

    /// Feeds it for ever. Being a thread task this also proves that threads get to run.
    /// Between two looks a piece of the program is checked.
    pub async fn watch(self, mut program: program::Check) -> ! {
        feed();
        let mut supervision = Supervision::default();
        loop {
            Timer::after(Duration::from_millis(u64::from(LOOK_MS))).await;
            let alive = Alive {
                rates: RATE_ALIVE.take(),
                model: MODEL_ALIVE.take(),
                link: LINK_ALIVE.take(),
                telemetry: TELEMETRY_ALIVE.take(),
            };
            if supervision.look(alive) {
                feed();
            }
            #[cfg(feature = "self-test")]
            if channels::PROGRAM_TEST.try_take().is_some() {
                // The pass that is under way, then a whole one.
                program.whole();
                channels::PROGRAM_TESTED.signal(program.whole());
            }
            if program.piece() == Some(program::Verdict::Changed) {
                channels::stand(UnitStatus::PROGRAM, true);
            }
        }
    }
}

impl Patience {
    /// Does something that keeps the processor from feeding for up to [`params::WATCHDOG_ERASE`].
    pub fn during<T>(&mut self, work: impl FnOnce() -> T) -> T {
        set(params::WATCHDOG_ERASE);
        let done = work();
        set(params::WATCHDOG_USUAL);
        done
    }
}
