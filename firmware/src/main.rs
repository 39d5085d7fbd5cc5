//! The navigation computer of an HRG inertial unit (STM32F446RE).
//!
//! Functions:
//! - measures three resonator frequencies (TIM2 captures by DMA) and reads three rates (ADS131M08, 1 kSPS);
//! - turns frequencies into temperatures and biases once a second, with the calibration in flash;
//! - takes the biases off the rates and sends them at 200 Hz over RS-422, with housekeeping each second;
//! - logs one line a second over RTT (defmt);
//! - feeds its watchdog only while all of that runs.
//!
//! | task | runs on | file |
//! |---|---|---|
//! | rates (no task) | an interrupt of their own, above all tasks | `rate` |
//! | model | interrupt executor | `model` |
//! | link in, link out | interrupt executor, that of the model | `link` |
//! | telemetry, align mode, log | thread | `telemetry` |
//! | maintenance: a calibration into flash | thread | `maintain` |
//! | watchdog | thread | `watchdog` |
//!
//! Pins are in `board`, numbers in `params`; all that computes is in the crate `hrg_core`.
#![no_std]
#![no_main]

#[cfg(all(feature = "aux", feature = "sensors"))]
compile_error!("the features aux and sensors want the same channels of the ADC: take one of them");

mod adc;
#[cfg(feature = "battery")]
mod backup;
mod board;
mod capture;
mod channels;
#[cfg(feature = "inputs")]
mod chip;
mod clock;
mod link;
mod maintain;
#[cfg(feature = "self-test")]
mod memory;
mod model;
mod params;
#[cfg(feature = "pps")]
mod pps;
mod program;
mod rate;
mod receive;
mod redundant;
mod retained;
#[cfg(feature = "self-test")]
mod self_test;
mod settings;
mod slot;
mod stack;
mod stop;
mod telemetry;
mod time;
mod watchdog;
mod wired;

use crate::redundant::{Compensator, CHANNELS};
use crate::stop::once;
use crate::watchdog::Watchdog;
use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, SpawnError, SpawnToken, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use hrg_core::align_mode::AlignMode;
use hrg_core::calibration::Calibration;
use hrg_core::events::Event;
#[cfg(feature = "field-log")]
use hrg_core::events::{self, Record, Store as _};
use hrg_core::link::Identity;
use hrg_core::maintenance::Maintenance;
use hrg_core::option_bytes::{self, Difference};
use hrg_core::output;
use hrg_core::parts::Parts;
use hrg_core::reset::ResetCause;
use hrg_core::sectors;
use hrg_core::status::UnitStatus;
use hrg_core::stopped::Stopped;
use hrg_core::telemetry::Telemetry;
#[cfg(feature = "field-log")]
use hrg_core::zero;
use static_cell::{ConstStaticCell, StaticCell};

/// Parts that this program was built with, for the tools that read the ELF.
#[used]
#[allow(unsafe_code)] // A name of its own, and no other symbol has it.
#[unsafe(export_name = "_built_with")]
static BUILT_WITH: u32 = built_with().bits();

/// Parts by feature.
const fn built_with() -> Parts {
    let mut parts = Parts::empty();
    if cfg!(feature = "align") {
        parts = parts.union(Parts::ALIGN);
    }
    if cfg!(feature = "pps") {
        parts = parts.union(Parts::PPS);
    }
    if cfg!(feature = "field-log") {
        parts = parts.union(Parts::FIELD_LOG);
    }
    if cfg!(feature = "lockstep") {
        parts = parts.union(Parts::LOCKSTEP);
    }
    if cfg!(feature = "past") {
        parts = parts.union(Parts::PAST);
    }
    if cfg!(feature = "inputs") {
        parts = parts.union(Parts::INPUTS);
    }
    if cfg!(feature = "aux") {
        parts = parts.union(Parts::AUX);
    }
    if cfg!(feature = "self-test") {
        parts = parts.union(Parts::SELF_TEST);
    }
    parts
}

/// Runs the model and the link, in the interrupt of a peripheral that the unit does not use: what takes long in a thread delays neither a bias nor
/// a frame.
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
    let (watchdog, program) = start(spawner);
    watchdog.watch(program).await
}

/// One compensator in its place.
// Out of line, as is `start`: what they need of stack while they build is not needed for ever.
#[inline(never)]
fn compensator(place: &'static StaticCell<Compensator>, calibration: &Calibration) -> &'static mut Compensator {
    #[cfg(feature = "past")]
    return once(hrg_fast::compensator(place, calibration));
    #[cfg(not(feature = "past"))]
    once(hrg_fast::settling(place, calibration))
}

/// Has the model go on from what was kept before a reset; gives the number of resets since power-on.
#[inline(never)]
fn resume(models: &mut [&'static mut Compensator; CHANNELS], cause: ResetCause) -> u32 {
    if let Some(kept) = retained::newest(cause) {
        models.iter_mut().for_each(|m| m.resume(&kept));
    } else {
        #[cfg(feature = "battery")]
        if let Some(kept) = backup::newest(cause) {
            models.iter_mut().for_each(|m| m.resume(&kept));
        }
    }
    models[0].resets()
}

/// Has the model add the constants that were renewed under this image.
#[cfg(feature = "field-log")]
#[inline(never)]
fn set_zero(models: &mut [&'static mut Compensator; CHANNELS], sectors: &maintain::Sectors, checksum: u32) {
    if let Some(zero) = zero::newest(events::records(sectors.log()), checksum) {
        models.iter_mut().for_each(|m| m.set_zero(zero));
    }
}

/// Settings that rates begin with; they are sent as it was set last.
#[cfg_attr(not(feature = "field-log"), allow(unused_variables))]
#[inline(never)]
fn rates(sectors: &maintain::Sectors, calibration: &Calibration, status: UnitStatus) -> rate::Start {
    #[cfg(feature = "field-log")]
    let sent = output::newest(events::records(sectors.log())).unwrap_or_default();
    #[cfg(not(feature = "field-log"))]
    let sent = output::OutputSettings::default();
    // (A program with that framing may have stored it.)
    #[cfg(not(feature = "mavlink"))]
    let sent = output::OutputSettings { framing: output::Framing::Own, ..sent };
    rate::Start { sent, scale_dph: calibration.scale_factors_dph_per_code(), status }
}

/// Maintenance mode of this build.
fn maintenance(identity: &Identity, place: Option<sectors::Place>) -> &'static mut Maintenance {
    static MAINTENANCE: StaticCell<Maintenance> = StaticCell::new();
    let maintenance = Maintenance::new(identity.unit, identity.sequence, place, cfg!(feature = "locked"))
        .with_key(maintain::KEY)
        .with_inputs(params::INPUTS)
        .with_log(cfg!(feature = "field-log"))
        .with_test(cfg!(feature = "self-test"))
        .with_mavlink(cfg!(feature = "mavlink"));
    once(MAINTENANCE.try_init(maintenance))
}

/// Logs faults that the start has found.
fn warn(verdict: program::Verdict, crystal: bool, stopped: &Stopped, unprotected: Difference) {
    match verdict {
        program::Verdict::Intact => {}
        program::Verdict::Unsealed => {
            defmt::warn!("the program was flashed without its checksum and cannot check itself: use cargo xtask flash");
        }
        program::Verdict::Changed => defmt::error!("the program in flash has changed"),
    }
    if !crystal {
        defmt::error!("the crystal is dead or wrong: running on the chip's own oscillator");
    }
    for what in unprotected.in_words() {
        defmt::warn!("option bytes: {=str}", what);
    }
    if stopped.says_something() {
        defmt::warn!(
            "stopped before by {=str} at {=u32:08x} (from {=u32:08x}, faults {=u32:08x} {=u32:08x} at {=u32:08x}), {=str}:{=u16}, silent {=u8:05b}, stack {=u32}",
            stopped.halt.name(),
            stopped.pc,
            stopped.lr,
            stopped.cfsr,
            stopped.hfsr,
            stopped.address,
            stopped.file(),
            stopped.line,
            stopped.silent.bits(),
            stopped.stack
        );
    }
}

/// Logs events of the start, and writes them to the field log.
#[inline(never)]
#[cfg_attr(not(feature = "field-log"), allow(unused_variables))]
fn record(board: &mut board::Board, on_for_s: u32, stopped: &Stopped, events: [Option<Event>; 3]) {
    let [start, test, cut_short] = events;
    #[cfg(feature = "field-log")]
    // (The same stop again and again would fill the log.)
    let told = || events::last_stop(events::records(board.sectors.log())) == Some(*stopped);
    #[cfg(not(feature = "field-log"))]
    let told = || true;
    let new = stopped.says_something() && !told();
    #[cfg(feature = "field-log")]
    let program = Some(maintain::program_event())
        .filter(|p| events::last_program(events::records(board.sectors.log())) != Some(*p));
    #[cfg(not(feature = "field-log"))]
    let program = None;
    let pieces = stopped.pieces().filter(|_| new).map(Event::Stopped);
    for event in start.into_iter().chain(program).chain(pieces).chain(test).chain(cut_short) {
        match event {
            Event::Test { .. } => defmt::error!("the test at the start fails: hrg unit events says where"),
            Event::CutShort { .. } => defmt::warn!("a burn was cut short"),
            _ => {}
        }
        #[cfg(feature = "field-log")]
        board.journal.write(&mut board.sectors, Record { on_for_s, event });
    }
}

/// Sets the board up and starts all tasks.
#[inline(never)]
fn start(spawner: Spawner) -> (Watchdog, program::Check) {
    let mut board = board::Board::new();
    // (As late as this, at full speed: what has used the stack until here is not what uses most.)
    let stack_used = stack::repaint();
    #[cfg(feature = "bring-up")]
    bring_up::prepare(&mut board.sectors);
    let programs = maintain::programs(0);
    let before = if retained::ran_last(programs.sum) { board.reset_cause } else { ResetCause::Power };
    let stopped = retained::last_stop(before, stack_used);
    let verdict = board.program.whole();
    let board::Loaded { calibration, place, checksum, mut status, cut_short } = board.calibration();
    status.set(UnitStatus::TIMEBASE, !board.crystal);
    // (A newer one that was left has changed.)
    status.set(UnitStatus::PROGRAM, verdict == program::Verdict::Changed || maintain::newer_was_left());
    #[cfg(feature = "self-test")]
    status.set(UnitStatus::PROGRAM, status.contains(UnitStatus::PROGRAM) || self_test::memory_is_bad());
    static COMPENSATORS: [StaticCell<Compensator>; CHANNELS] = [const { StaticCell::new() }; CHANNELS];
    let mut compensators = COMPENSATORS.each_ref().map(|place| compensator(place, &calibration));
    let resets = resume(&mut compensators, before);
    channels::MOVING.store(retained::moved(before), core::sync::atomic::Ordering::Relaxed);
    #[cfg(feature = "field-log")]
    set_zero(&mut compensators, &board.sectors, checksum);
    let identity = Identity {
        unit: calibration.unit,
        calibration: checksum,
        created_unix_s: calibration.created_unix_s,
        sequence: calibration.sequence,
        reset_cause: board.reset_cause,
        resets: resets.min(0xFFFF) as u16,
        option_bytes: embassy_stm32::pac::FLASH.optcr().read().0,
        ..Identity::default()
    };
    defmt::info!(
        "hrg firmware {=str}: unit {=str}, calibration {=u32:08x} no. {=u32}, status {=u16:02x}, start after {=str}, {=u32} resets",
        env!("CARGO_PKG_VERSION"),
        calibration.unit_name(),
        identity.calibration,
        identity.sequence,
        status.bits(),
        board.reset_cause.name(),
        resets
    );
    warn(verdict, board.crystal, &stopped, option_bytes::differences(identity.option_bytes));
    let start =
        Event::Start { cause: board.reset_cause, halt: stopped.halt, resets: identity.resets, calibration: checksum };
    let cut_short = cut_short.and_then(|place| sectors::mark(&mut board.sectors, place));
    #[cfg(feature = "self-test")]
    let test = self_test::at_start(verdict, status, board.crystal);
    #[cfg(not(feature = "self-test"))]
    let test = None;
    record(&mut board, compensators[0].on_for_s() as u32, &stopped, [Some(start), test, cut_short]);
    let rates = rates(&board.sectors, &calibration, status);
    static ALIGNMENT: ConstStaticCell<telemetry::Alignment> = ConstStaticCell::new(telemetry::Alignment::IDLE);
    let alignment = once(ALIGNMENT.try_take());
    AlignMode::set_accelerometers(alignment, calibration.accelerometers);
    let telemetry = Telemetry::new(alignment, params::TIMEBASE, identity, status)
        .with_trims_in_maintenance_only(cfg!(feature = "signed"));
    let maintenance = maintenance(&identity, place);

    let model_start = model::Start {
        crystal: board.crystal,
        #[cfg(feature = "inputs")]
        chip: board.chip,
        #[cfg(feature = "pps")]
        correction: retained::correction(before),
    };
    // Peripheral interrupts stay at the top; the rate path comes next, then model and link, threads last.
    interrupt::UART4.set_priority(Priority::P8);
    let model_spawner = MODEL_EXECUTOR.start(interrupt::UART4);
    rate::start(board.adc, &rates);
    spawned(model::task(board.rings, board.clock, model_start, compensators), |t| model_spawner.spawn(t));
    spawned(link::send(board.link_out), |t| model_spawner.spawn(t));
    spawned(link::receive(board.link_in, identity, stopped), |t| model_spawner.spawn(t));
    spawned(telemetry::task(telemetry), |t| spawner.spawn(t));
    spawned(telemetry::log(), |t| spawner.spawn(t));
    #[cfg(feature = "field-log")]
    let maintenance = maintain::task(maintenance, board.sectors, board.service, checksum, board.journal);
    #[cfg(not(feature = "field-log"))]
    let maintenance = maintain::task(maintenance, board.sectors, board.service, checksum);
    spawned(maintenance, |t| spawner.spawn(t));
    #[cfg(feature = "bring-up")]
    bring_up::start(spawner);
    (board.watchdog, board.program)
}

// (Here, so that no line number in the flown program depends on it.)
#[cfg(feature = "bring-up")]
mod bring_up;
