//! A whole run of the ELF over a recording.

use crate::host;
use crate::twin::Twin;
use crate::wires::{Received, WireFaults, Wires};
use anyhow::{Context, Result};
use hrg_core::calibration::Calibration;
use hrg_core::inputs::{Channel, QuantitySet};
use hrg_core::output::OutputSettings;
use hrg_core::parts::{self, Parts};
use hrg_core::status::UnitStatus;
use hrg_core::timebase::Timebase;
use hrg_data::error::BadInput;
use hrg_data::log::Decoder;
use hrg_data::numeric::stats::{block_means, std_dev};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::Recording;
use hrg_identify::fit::correct;
use std::path::{Path, PathBuf};
use virtual_board::part::{self, Part};
use virtual_board::{Board, Cost, Firmware, Probe, Stop, CPU_HZ};

/// Flash offset of calibration sector A (memory.x).
pub const CALIBRATION_A: u32 = 0x4000;

/// Flash offset of calibration sector B (memory.x).
pub const CALIBRATION_B: u32 = 0x8000;

/// Flash offset of the field log (memory.x).
pub const FIELD_LOG: u32 = 0xC000;

/// Options of a run.
#[derive(Debug, Clone)]
pub struct Options {
    /// RMS jitter of every edge, s.
    pub jitter_s: f64,
    /// Seed of the jitter.
    pub seed: u64,
    /// Faults on the wires.
    pub faults: WireFaults,
    /// Compare every frame with the desktop.
    pub compare: bool,
    /// Stop after this time, s; `None`: the whole recording.
    pub seconds: Option<u64>,
    /// Functions whose calls are counted, by a part of their symbol.
    pub count: Vec<&'static str>,
    /// Accelerometers: time (s) from which, and increments of velocity (m/s) second by second.
    pub accelerations: Option<(f64, Vec<[f64; 3]>)>,
    /// The unit is told to send by these settings in its third second; what it sent before is not kept.
    pub output: Option<OutputSettings>,
    /// Count instructions function by function.
    pub profile: bool,
    /// The chip on the board.
    pub part: &'static Part,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            jitter_s: 20e-9,
            seed: 1,
            faults: WireFaults::default(),
            compare: true,
            seconds: None,
            count: vec![],
            accelerations: None,
            output: None,
            profile: false,
            part: &part::STM32F446RE,
        }
    }
}

/// Result of a run.
#[derive(Debug)]
pub struct Outcome {
    /// All that the unit sent.
    pub received: Received,
    /// Resets by the watchdog.
    pub watchdog_resets: usize,
    /// Calls of the functions asked for in [`Options::count`], in that order.
    pub calls: Vec<Probe>,
    /// Costs of each function, most cycles first, where asked for.
    pub profile: Vec<(String, Cost)>,
    /// Deepest stack, bytes.
    pub stack_bytes: u32,
    /// Static RAM, bytes.
    pub static_bytes: u32,
    /// Simulated seconds.
    pub seconds: f64,
    /// Instructions executed.
    pub instructions: u64,
    /// Time it took here, s.
    pub wall_s: f64,
}

/// Path of the firmware ELF within the folder that cargo builds into.
const ELF: &str = "thumbv7em-none-eabihf/firmware/firmware";

/// Path of the firmware ELF after a build: in the folder of builds that this program lies in, else in that of the source it was
/// built from.
#[must_use]
pub fn default_elf() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|exe| {
        // PROFILE/hrg-board, or PROFILE/deps/a_test.
        exe.ancestors().skip(2).take(2).map(|folder| folder.join(ELF)).find(|p| p.is_file())
    });
    beside.unwrap_or_else(|| {
        Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap_or(Path::new(".")).join("target").join(ELF)
    })
}

/// Path of the firmware for slot B, beside that ELF (`cargo xtask test` builds it).
#[must_use]
pub fn elf_for_slot_b() -> PathBuf {
    let own = default_elf();
    let target = own.ancestors().nth(Path::new(ELF).components().count()).unwrap_or(Path::new("."));
    target.join("slot-b").join(ELF)
}

/// Parts that a firmware was built with; all of them where it does not state them.
#[must_use]
pub fn parts(firmware: &Firmware) -> Parts {
    let word = firmware.address_of(parts::SYMBOL).and_then(|at| firmware.word(at));
    word.map_or(Parts::all().difference(Parts::AUX), Parts::from_bits_retain)
}

/// Reads the ELF.
///
/// # Errors
/// If it has not been built, or is another file.
pub fn read_elf(path: &Path) -> Result<Vec<u8>, BadInput> {
    let failed = |why: &str| {
        BadInput(format!(
            "cannot read the firmware {}: {why}; build it with `cargo xtask build` in the project's folder, or give another with --elf",
            path.display()
        ))
    };
    let bytes = std::fs::read(path).map_err(|e| failed(&e.to_string()))?;
    if bytes.starts_with(b"\x7FELF") {
        Ok(bytes)
    } else {
        Err(failed("it is no ELF"))
    }
}

/// Plays `steps` into the ELF with `calibration` in its flash (`None`: an empty sector). `progress` is told the
/// share that is done.
///
/// # Errors
/// If the firmware does something that the board does not model.
pub fn run(
    elf: &[u8],
    calibration: Option<&Calibration>,
    steps: &Steps,
    options: &Options,
    mut progress: impl FnMut(f64),
) -> Result<Outcome> {
    let used = calibration.cloned().unwrap_or_else(Calibration::uncalibrated);
    let start_status = if calibration.is_some() { UnitStatus::empty() } else { UnitStatus::DEFAULT_CALIBRATION };
    let (scale, name) = (used.scale_factors_dph_per_code(), used.unit);
    let parts = parts(&Firmware::parse(elf)?);
    let timebase = Timebase::at(options.part.timer_hz() as u32);
    let twin = options.compare.then(|| Twin::at(timebase, used, start_status, parts).with_ambient(steps));
    let sensors = steps.thermometer == Thermometer::Sensors;
    let twin = twin.map(|t| if sensors { t.with_sensors() } else { t });
    let wires = Wires::new(steps.clone(), scale, options.jitter_s, options.seed, twin, Some(Decoder::new(elf)?))
        .with_faults(options.faults.clone())
        .with_aux(parts.contains(Parts::AUX))
        .with_inputs(sent_by_link(parts, steps));
    let wires = match &options.accelerations {
        Some((start, increments)) => wires.with_accelerations(*start, increments.clone()),
        None => wires,
    };
    let mut board = Board::on(options.part, elf, wires)?;
    if let Some(c) = calibration {
        let image = c.to_bytes().context("the calibration does not fit an image")?;
        board.write_flash(CALIBRATION_A, &image)?;
    }
    let probes = options.count.iter().map(|part| board.count_calls(part)).collect::<Result<Vec<_>, _>>()?;
    if options.profile {
        board.start_profile();
    }
    let seconds = options.seconds.unwrap_or(u64::MAX).min(steps.len() as u64);
    let start = std::time::Instant::now();
    let mut watchdog_resets = 0;
    for second in 1..=seconds {
        if let Some(settings) = options.output.filter(|_| second == 3) {
            host::set_output(&mut board, name, settings)?;
            board.world.received = Received::default();
        }
        while board.now() < second * CPU_HZ && board.run_until(second * CPU_HZ)? == Stop::Watchdog {
            watchdog_resets += 1;
        }
        progress(second as f64 / seconds as f64);
    }
    Ok(Outcome {
        calls: probes.iter().filter_map(|p| board.probe(*p).cloned()).collect(),
        profile: if options.profile { board.profile() } else { vec![] },
        stack_bytes: board.stack_used(),
        static_bytes: board.static_bytes(),
        seconds: board.now() as f64 / CPU_HZ as f64,
        instructions: board.instructions(),
        received: board.world.received,
        watchdog_resets,
        wall_s: start.elapsed().as_secs_f64(),
    })
}

/// Inputs that the electronics send by the link to a unit with these parts: what the recording has, but for the drives where they are at
/// the ADC.
fn sent_by_link(parts: Parts, steps: &Steps) -> QuantitySet {
    let wired = Channel::DRIVES.iter().filter(|_| parts.contains(Parts::AUX));
    let wired: QuantitySet = wired.map(|c| QuantitySet::one(c.quantity)).collect();
    if parts.contains(Parts::INPUTS) {
        steps.unit_inputs.difference(wired).difference(QuantitySet::CHIP)
    } else {
        QuantitySet::empty()
    }
}

/// One second as the unit reported it.
#[derive(Debug, Clone, Copy)]
pub struct Second {
    /// In housekeeping.
    pub unit: correct::Second,
    /// Mean of the corrected rates in the 200 Hz frames, deg/h: the unit's own mean is rounded otherwise.
    pub frames_dph: [f64; 3],
}

impl Outcome {
    /// The run, second by second, with the means of the frames themselves.
    #[must_use]
    pub fn seconds_of_frames(&self) -> Vec<Second> {
        let mut out = Vec::new();
        let mut frames = self.received.rates.iter().peekable();
        for h in &self.received.housekeeping {
            // The samples that housekeeping sums up ran under the bias of the step before; frames of earlier steps
            // (and those before the first bias, whose step is the largest number) belong to no second.
            let number = |step: u32| step.wrapping_add(1);
            let mut sum = [0.0; 3];
            let mut count = 0.0;
            while let Some(f) = frames.next_if(|f| number(f.step) <= h.step) {
                if number(f.step) == h.step {
                    for (s, r) in sum.iter_mut().zip(f.rate_dph) {
                        *s += f64::from(r);
                    }
                    count += 1.0;
                }
            }
            let frames_dph = sum.map(|s| if count > 0.0 { s / count } else { f64::NAN });
            out.push(Second { unit: h.into(), frames_dph });
        }
        out
    }
}

/// Three sigma of 100 s means of each axis, deg/h: raw and corrected. The first second, which ran without a bias, is
/// left out. NaN where fewer than two means are left.
#[must_use]
pub fn three_sigma(seconds: &[Second]) -> ([f64; 3], [f64; 3]) {
    if seconds.len() < 201 {
        return ([f64::NAN; 3], [f64::NAN; 3]);
    }
    let of = |pick: &dyn Fn(&Second) -> f64| {
        let series: Vec<f64> = seconds.iter().skip(1).map(pick).collect();
        3.0 * std_dev(&block_means(&series, 100))
    };
    ([0, 1, 2].map(|a| of(&|s| f64::from(s.unit.raw_dph[a]))), [0, 1, 2].map(|a| of(&|s| s.frames_dph[a])))
}

/// The run as a recording of corrected rates, with raw rates and the rest beside them.
#[must_use]
pub fn to_csv(source: &Recording, calibration: Option<&Calibration>, seconds: &[Second]) -> String {
    let seconds: Vec<correct::Second> = seconds.iter().map(|s| s.unit).collect();
    correct::to_csv(source, "through the ELF on the virtual board", 0.0, calibration, &seconds)
}
