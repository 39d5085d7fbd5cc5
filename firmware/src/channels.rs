//! Channels and signals between tasks. Nothing else is shared.

use crate::params::FRAME_QUEUE;
use core::sync::atomic::{AtomicBool, AtomicU16, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use hrg_core::align_mode::{Command, Report};
use hrg_core::compensator::Output;
use hrg_core::frequency::StepFrequencies;
use hrg_core::increments::IncrementFrame;
#[cfg(feature = "inputs")]
use hrg_core::inputs::InputValues;
use hrg_core::link::{Housekeeping, InputsUsed, Message};
use hrg_core::maintenance;
use hrg_core::output::OutputSettings;
use hrg_core::pps;
use hrg_core::rate_output::RateSecond;
use hrg_core::rate_path::{PendingBias, RateFrame};
use hrg_core::status::UnitStatus;
use hrg_core::stopped::Stopped;
use hrg_core::AXES;

type Mutex = CriticalSectionRawMutex;

/// A sign of life. (A signal costs five times as much, a thousand times a second.)
pub struct Sign(AtomicBool);

impl Sign {
    #[allow(clippy::declare_interior_mutable_const)] // The start of each of them.
    const NONE: Self = Self(AtomicBool::new(false));

    /// It is given.
    pub fn give(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// It was given since the last time it was taken.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// A moment, as the timer counts, from one that writes it to one that takes it.
pub struct Tick {
    there: AtomicBool,
    at: AtomicU32,
}

impl Tick {
    #[allow(clippy::declare_interior_mutable_const)] // The start of each of them.
    const NONE: Self = Self { there: AtomicBool::new(false), at: AtomicU32::new(0) };

    /// Writes it and wakes the rate path.
    pub fn tell(&self, at: u32) {
        self.at.store(at, Ordering::Relaxed);
        self.there.store(true, Ordering::Release);
        crate::rate::wake();
    }

    /// The newest, if it was not taken yet.
    pub fn take(&self) -> Option<u32> {
        // (An interrupt that writes the next between the two would have it taken twice.)
        self.there.load(Ordering::Relaxed).then(|| {
            cortex_m::interrupt::free(|_| {
                self.there.store(false, Ordering::Relaxed);
                self.at.load(Ordering::Relaxed)
            })
        })
    }
}

/// A message to the link, the newest. The link waits for [`NEWS`] of all of them: to look at each costs more than to send a frame.
pub struct Outgoing<T>(Signal<Mutex, T>);

impl<T> Outgoing<T> {
    const fn new() -> Self {
        Self(Signal::new())
    }

    /// Hands it over.
    pub fn signal(&self, message: T) {
        self.0.signal(message);
        NEWS.signal(());
    }

    /// The newest that was not taken yet.
    pub fn take(&self) -> Option<T> {
        self.0.try_take()
    }
}

/// One of the messages to the link is there.
pub static NEWS: Signal<Mutex, ()> = Signal::new();
/// Model to rate path: the next bias and when it holds.
pub static BIAS: Signal<Mutex, PendingBias> = Signal::new();
/// Interrupt to rate path: a frame of the ADC has come; the timer at its data-ready edge.
pub static FETCHED: Tick = Tick::NONE;
/// Model to rate path, every fetch: the timer. Lets the rate path run when the ADC is silent.
pub static LOOK: Tick = Tick::NONE;
/// Rate path, model and threads to the interrupt of each sample: they have run ([`crate::watchdog::sampled`]).
pub static RATES_RUN: Sign = Sign::NONE;
pub static MODEL_RUNS: Sign = Sign::NONE;
pub static THREADS_RUN: Sign = Sign::NONE;
/// Rate path to watchdog: it has run.
pub static RATE_ALIVE: Sign = Sign::NONE;
/// Model to watchdog: it has run.
pub static MODEL_ALIVE: Sign = Sign::NONE;
/// Link out to watchdog: it has sent.
pub static LINK_ALIVE: Sign = Sign::NONE;
/// Telemetry to watchdog: it has had a second.
pub static TELEMETRY_ALIVE: Sign = Sign::NONE;
/// Rate path to link: frames out. Dropped, and counted, when full.
pub static FRAMES: Channel<Mutex, Fast, FRAME_QUEUE> = Channel::new();
/// Rate path to telemetry: means of the second past, and frames dropped since start.
pub static SECONDS: Channel<Mutex, RateSecond, 2> = Channel::new();
/// Model to telemetry: a step, what came of it, and what the pulses per second have shown.
pub static STEP: Channel<Mutex, (StepFrequencies, Output, pps::Report), 2> = Channel::new();
/// Telemetry to link: housekeeping out.
pub static HOUSEKEEPING: Outgoing<Housekeeping> = Outgoing::new();
/// Link in to model: inputs beside the frequencies.
#[cfg(feature = "inputs")]
pub static INPUTS: Channel<Mutex, InputValues, { crate::params::INPUT_QUEUE }> = Channel::new();
/// Model to link: the inputs that a step has used.
pub static INPUTS_USED: Outgoing<InputsUsed> = Outgoing::new();
/// Telemetry to log.
pub static LOG: Signal<Mutex, Housekeeping> = Signal::new();
/// Link in to link out: word of the last stop.
pub static STOPPED: Outgoing<Stopped> = Outgoing::new();
/// Link in to link out: an answer.
pub static ANSWER: Outgoing<Message> = Outgoing::new();
/// Telemetry to the built-in test: each second.
#[cfg(feature = "self-test")]
pub static HOUSEKEPT: Signal<Mutex, Housekeeping> = Signal::new();
/// The built-in test to the rate path: go through the ADC's places; and what came of it.
#[cfg(feature = "self-test")]
pub static ADC_TEST: Signal<Mutex, ()> = Signal::new();
#[cfg(feature = "self-test")]
pub static ADC_TESTED: Signal<Mutex, hrg_core::self_test::course::Levels> = Signal::new();
/// The built-in test to the watchdog's task, which goes through the program: all of it now; and how it is.
#[cfg(feature = "self-test")]
pub static PROGRAM_TEST: Signal<Mutex, ()> = Signal::new();
#[cfg(feature = "self-test")]
pub static PROGRAM_TESTED: Signal<Mutex, crate::program::Verdict> = Signal::new();
/// Link in to telemetry: bad frames since start.
pub static LINK_ERRORS: Signal<Mutex, u16> = Signal::new();
/// Link in to telemetry: what the host asks of an alignment.
pub static ALIGN: Channel<Mutex, Command, 4> = Channel::new();
/// Telemetry to link: each second of an alignment.
pub static ALIGNMENT: Outgoing<Report> = Outgoing::new();
/// Telemetry to model: the bias trim that an alignment has found.
pub static TRIM: Signal<Mutex, [f32; AXES]> = Signal::new();
/// Maintenance to model: constants that were renewed.
#[cfg(feature = "field-log")]
pub static ZERO: Signal<Mutex, hrg_core::zero::Zero> = Signal::new();
/// Link in to maintenance.
pub static MAINTAIN: Channel<Mutex, maintenance::Command, 2> = Channel::new();
/// Maintenance to telemetry: whether a calibration may be written.
pub static MAINTENANCE_OPEN: Signal<Mutex, bool> = Signal::new();
/// Link in to rate path: samples per frame.
pub static DECIMATION: Signal<Mutex, u16> = Signal::new();
/// Maintenance to rate path: what is sent.
pub static OUTPUT: Signal<Mutex, OutputSettings> = Signal::new();
/// Settings of the output now ([`OutputSettings::word`]), as the rate path has it.
static SENT: AtomicU32 = AtomicU32::new(0);
/// Link in to model: GNSS time of the last pulse, and when it came.
#[cfg(feature = "pps")]
pub static GNSS_TIME: Signal<Mutex, (hrg_core::gnss::GnssTime, u32)> = Signal::new();
/// Model to link out: the last pulse in GNSS time.
#[cfg(feature = "pps")]
pub static TIME_MARK: Outgoing<hrg_core::gnss::TimeMark> = Outgoing::new();
/// Rate path to model: channels 5 to 7 of the ADC over a second.
#[cfg(any(feature = "sensors", feature = "aux"))]
pub static SENSORS: Signal<Mutex, hrg_core::sensors::Window> = Signal::new();
/// Any task that sees an event to maintenance, which writes the field log; with the time since power-on, s.
#[cfg(feature = "field-log")]
pub static EVENTS: Channel<Mutex, (u32, hrg_core::events::Event), { crate::params::EVENT_QUEUE }> = Channel::new();

/// A host has shown that it receives from the unit.
pub static ECHOED: AtomicBool = AtomicBool::new(false);
/// The last second had samples.
pub static RATES: AtomicBool = AtomicBool::new(false);
/// The program is on trial, beside one to go back to.
pub static ON_TRIAL: AtomicBool = AtomicBool::new(false);
/// The unit moves.
pub static MOVING: AtomicBool = AtomicBool::new(false);
/// Link in to link out: the programs of the unit.
pub static PROGRAMS: Outgoing<hrg_core::update::Programs> = Outgoing::new();

/// Time since power-on at the last second, s.
pub static ON_FOR_S: AtomicU32 = AtomicU32::new(0);

/// The built-in test runs: what it does to the rates is no fault.
#[cfg(feature = "self-test")]
pub static TESTING: AtomicBool = AtomicBool::new(false);
/// An alignment runs.
#[cfg(feature = "self-test")]
pub static ALIGNING: AtomicBool = AtomicBool::new(false);

/// Settings of the output now.
pub fn sent() -> OutputSettings {
    OutputSettings::from_word(SENT.load(Ordering::Relaxed)).unwrap_or_default()
}

/// The rate path sends by these settings.
pub fn sends(settings: OutputSettings) {
    SENT.store(settings.word(), Ordering::Relaxed);
}

/// A message of the rate path.
pub enum Fast {
    /// A rate frame.
    Rates(RateFrame),
    /// Increments.
    Increments(IncrementFrame),
}

impl Fast {
    /// `true` if it is as it was made.
    pub fn intact(&self) -> bool {
        match self {
            Self::Rates(frame) => frame.intact(),
            Self::Increments(increments) => increments.intact(),
        }
    }
}

/// Flags of the unit that stand since they were found, after the start.
static STANDING: AtomicU16 = AtomicU16::new(0);

/// Those flags.
pub fn standing() -> UnitStatus {
    UnitStatus::from_bits_retain(STANDING.load(Ordering::Relaxed))
}

/// Raises or lowers one of them.
pub fn stand(flag: UnitStatus, stands: bool) {
    if stands {
        STANDING.fetch_or(flag.bits(), Ordering::Relaxed);
    } else {
        STANDING.fetch_and(!flag.bits(), Ordering::Relaxed);
    }
}
