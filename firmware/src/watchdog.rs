//! The independent watchdog (IWDG): fed while every part of the unit runs, and given more time while a sector is erased.
//!
//! # Design
//! One type owns the peripheral; maintenance borrows it for the length of an erase through [`Patience`]. The time to feed it is decided by
//! [`hrg_core::supervision`].
//!
//! # Tradeoffs
//! embassy's `IndependentWatchdog` cannot change its time once it runs, so the four registers are driven here (RM0390 chapter 20).

use crate::channels::{self, LINK_ALIVE, MODEL_ALIVE, MODEL_RUNS, RATES_RUN, RATE_ALIVE, TELEMETRY_ALIVE, THREADS_RUN};
use crate::clock;
use crate::params::{self, Time};
use crate::program;
use crate::retained;
use crate::settings::Settings;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_stm32::pac::iwdg::vals::{Key, Pr};
use embassy_stm32::pac::IWDG as REGISTERS;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::Peri;
use embassy_time::{Duration, Instant, Timer};
use hrg_core::status::UnitStatus;
use hrg_core::stopped::Silent;
use hrg_core::supervision::{Alive, Supervision, LOOK_MS};

fn feed() {
    REGISTERS.kr().write(|w| w.set_key(Key::RESET));
}

fn set((prescaler, reload): Time) {
    REGISTERS.kr().write(|w| w.set_key(Key::ENABLE));
    REGISTERS.pr().write(|w| w.set_pr(Pr::from_bits(prescaler)));
    REGISTERS.rlr().write(|w| w.set_rl(reload));
    // Five cycles of LSI, 0.3 ms of the slowest. One that does not run must not keep the unit from starting.
    let taken = (0..PATIENCE).any(|_| REGISTERS.sr().read().0 == 0);
    channels::stand(UnitStatus::WATCHDOG, !taken);
    feed();
}

/// Looks at a register, some cycles each: 5 ms at least.
const PATIENCE: u32 = 200_000;

/// Samples of the ADC, and the number of them in which each part runs once at least: a look's interval and a quarter.
static SAMPLES: AtomicU32 = AtomicU32::new(0);
const INTERVAL: u32 = 128;

/// Notes a part that does not run any more, as seen from the interrupt of each sample: from there up nobody else can tell. A part that
/// runs for ever silences those below it, so the highest of the silent ones is meant, and the code that was interrupted is where it hangs.
pub fn sampled(interrupted: &[u32; 8]) {
    let n = SAMPLES.load(Ordering::Relaxed).wrapping_add(1);
    SAMPLES.store(n, Ordering::Relaxed);
    if !n.is_multiple_of(INTERVAL) {
        return;
    }
    let (rates, model, threads) = (RATES_RUN.take(), MODEL_RUNS.take(), THREADS_RUN.take());
    let silent = match (rates, model, threads) {
        (false, ..) => Silent::RATES,
        (_, false, _) => Silent::MODEL,
        (.., false) => Silent::THREADS,
        _ => return,
    };
    let [.., lr, pc, _] = *interrupted;
    retained::note_silent(silent, [pc, lr]);
}

/// A trial is over by then, one way or the other.
const TRIAL_ENDS: Instant = Instant::from_secs(90);

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
        let mut settings = Settings::default();
        let mut sends = false;
        loop {
            Timer::after(Duration::from_millis(u64::from(LOOK_MS))).await;
            let alive = Alive {
                rates: RATE_ALIVE.take(),
                model: MODEL_ALIVE.take(),
                link: LINK_ALIVE.take(),
                telemetry: TELEMETRY_ALIVE.take(),
            };
            // (What sends sets the last register with its first frame.)
            settings.look(sends);
            sends |= alive.link;
            let silent = supervision.look(alive);
            retained::note_silent(silent, [0; 2]);
            // (A program on trial whose maintenance hangs could neither confirm itself nor give up.)
            let over = channels::ON_TRIAL.load(Ordering::Relaxed) && Instant::now() > TRIAL_ENDS;
            if silent.is_empty() && !over {
                feed();
            }
            THREADS_RUN.give();
            channels::stand(UnitStatus::SUPPLY, !clock::supplied());
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
        self.begin();
        let done = work();
        self.end();
        done
    }

    /// From now on nobody feeds for up to [`params::WATCHDOG_ERASE`].
    pub fn begin(&mut self) {
        set(params::WATCHDOG_ERASE);
    }

    /// It is over.
    pub fn end(&mut self) {
        set(params::WATCHDOG_USUAL);
    }
}
