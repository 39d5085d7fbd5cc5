//! The navigation computer of an HRG inertial unit (STM32F446RE).
//!
//! What it does:
//! - measures three resonator frequencies (TIM2 captures by DMA) and reads three rates (ADS131M08, 1 kSPS);
//! - turns frequencies into temperatures and biases once a second, with the calibration in flash;
//! - takes the biases off the rates and sends them at 200 Hz over RS-422, with housekeeping each second;
//! - logs one line a second over RTT (defmt);
//! - feeds its watchdog only while the rate path runs.
//!
//! | task | priority | file |
//! |---|---|---|
//! | rate path (no task: the converter's interrupt) | above all tasks | `rate` |
//! | model | interrupt executor | `model` |
//! | link in, link out | interrupt executor | `link` |
//! | telemetry, align mode, log | thread | `telemetry` |
//! | maintenance: a calibration into flash | thread | `maintain` |
//! | watchdog | thread | here |
//!
//! Pins are in `board`, numbers in `params`; all that computes is in the crate `hrg_core`.
#![no_std]
#![no_main]

mod board;
mod capture;
mod channels;
mod converter;
mod link;
mod maintain;
mod model;
mod params;
mod rate;
mod telemetry;

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, SpawnError, SpawnToken, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;
use hrg_core::alignment::session::Session;
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::link::Identity;
use hrg_core::maintenance::Maintenance;
use hrg_core::rate_path::{self, RatePath};
use hrg_core::status::unit;
use static_cell::{ConstStaticCell, StaticCell};

/// Runs the model and the link, in the interrupt of a peripheral that the unit does not use: what takes long in a thread (an
/// alignment by particles) delays neither a bias nor a frame.
static MODEL_EXECUTOR: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
#[allow(unsafe_code)] // `on_interrupt` must be called from here and from nowhere else.
unsafe fn UART4() {
    // SAFETY: this is the interrupt that `MODEL_EXECUTOR` was started with.
    unsafe { MODEL_EXECUTOR.on_interrupt() }
}

fn spawned<S>(token: Result<SpawnToken<S>, SpawnError>, spawn: impl FnOnce(SpawnToken<S>)) {
    match token {
        Ok(token) => spawn(token),
        Err(_) => defmt::error!("a task was started twice"),
    }
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let watchdog = start(spawner);
    watch(watchdog).await
}

/// What start-up takes from a cell, once: a second time would be a bug.
fn once<T>(taken: Option<T>) -> T {
    match taken {
        Some(taken) => taken,
        None => halt(),
    }
}

/// One compensator in its place.
// Out of line, as is `start`: what they need of stack while they build is not needed for ever.
#[inline(never)]
fn lane(place: &'static StaticCell<Compensator>, calibration: &Calibration) -> &'static mut Compensator {
    once(place.try_init_with(|| Compensator::new(calibration.clone(), 0.0)))
}

/// Sets the board up and starts all tasks.
#[inline(never)]
fn start(spawner: Spawner) -> IndependentWatchdog<'static, embassy_stm32::peripherals::IWDG> {
    let board = board::Board::new();
    let (calibration, sector, checksum, mut unit_status) = board.calibration();
    if board.watchdog_reset {
        unit_status |= unit::WATCHDOG_RESET;
    }
    let identity = Identity {
        unit: calibration.unit,
        calibration: checksum,
        created_unix_s: calibration.created_unix_s,
        sequence: calibration.sequence,
    };
    let who = channels::Who { identity, unit_status };
    defmt::info!(
        "hrg firmware {=str}: unit {=str}, calibration {=u32:08x} no. {=u32}, status {=u8:02x}",
        env!("CARGO_PKG_VERSION"),
        calibration.unit_name(),
        identity.calibration,
        identity.sequence,
        unit_status
    );
    let path = RatePath::new(
        [
            calibration.axes[0].scale_factor_dph_per_code,
            calibration.axes[1].scale_factor_dph_per_code,
            calibration.axes[2].scale_factor_dph_per_code,
        ],
        rate_path::DIVIDER,
    );
    // The model runs twice, in separate memory: a bit that flips in one of them shows (hrg_core::compensator::update_both).
    static LANES: [StaticCell<Compensator>; 2] = [const { StaticCell::new() }; 2];
    let lanes = LANES.each_ref().map(|place| lane(place, &calibration));

    // Peripheral interrupts stay at the top; the rate path comes next, then model and link, threads last.
    rate::Rate::start(board.converter, path, unit_status);
    interrupt::UART4.set_priority(Priority::P8);
    let model_spawner = MODEL_EXECUTOR.start(interrupt::UART4);
    spawned(model::task(board.rings, board.clock, lanes), |t| model_spawner.spawn(t));
    spawned(link::send(board.link_out), |t| model_spawner.spawn(t));
    spawned(link::receive(board.link_in, who), |t| model_spawner.spawn(t));
    static SESSION: ConstStaticCell<Session<telemetry::Flown>> = ConstStaticCell::new(Session::IDLE);
    spawned(telemetry::task(who, once(SESSION.try_take())), |t| spawner.spawn(t));
    spawned(telemetry::log(), |t| spawner.spawn(t));
    static MAINTENANCE: StaticCell<Maintenance> = StaticCell::new();
    let maintenance = once(MAINTENANCE.try_init(Maintenance::new(
        identity.unit,
        identity.sequence,
        sector,
        cfg!(feature = "locked"),
    )));
    spawned(maintain::task(maintenance, board.sectors), |t| spawner.spawn(t));
    board.watchdog
}

/// Feeds the watchdog while rate path and model run, and link and telemetry have not stood still for long. Being a thread
/// task it also proves that threads get to run.
async fn watch(mut watchdog: IndependentWatchdog<'static, embassy_stm32::peripherals::IWDG>) -> ! {
    watchdog.unleash();
    let (mut link_quiet, mut telemetry_quiet) = (0u8, 0u8);
    loop {
        Timer::after(params::WATCHDOG_FEED).await;
        let since = |quiet: u8, alive: bool| if alive { 0 } else { quiet.saturating_add(1) };
        link_quiet = since(link_quiet, channels::LINK_ALIVE.try_take().is_some());
        telemetry_quiet = since(telemetry_quiet, channels::TELEMETRY_ALIVE.try_take().is_some());
        let running = channels::RATE_ALIVE.try_take().is_some() && channels::MODEL_ALIVE.try_take().is_some();
        if running && link_quiet.max(telemetry_quiet) < params::QUIET_FEEDS {
            watchdog.pet();
        }
    }
}

/// The unit has found itself upset: nothing more goes out, and the watchdog starts it anew (which is flagged).
fn halt() -> ! {
    cortex_m::interrupt::disable();
    loop {
        cortex_m::asm::nop();
    }
}

/// A panic is a bug: say where, and halt.
// So short that it is inlined where panics come together: there the compiler then sees that nobody reads their messages, and
// leaves out what would format them.
// (The compiler says that it ignores the attribute here; LLVM does not. It is 3.4 KiB.)
#[panic_handler]
#[allow(unused_attributes)]
#[inline(always)]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    panicked(info.location())
}

#[inline(never)]
fn panicked(at: Option<&core::panic::Location<'_>>) -> ! {
    cortex_m::interrupt::disable();
    match at {
        Some(at) => defmt::error!("panic at {=str}:{=u32}", at.file(), at.line()),
        None => defmt::error!("panic"),
    }
    halt()
}

/// A fault of the processor: halt.
#[cortex_m_rt::exception]
#[allow(unsafe_code)] // cortex-m-rt wants it so.
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    halt()
}
