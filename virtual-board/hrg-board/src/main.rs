//! `hrg-board`: the firmware ELF on a virtual board.

use anyhow::Result;
use clap::{Args, Parser, Subcommand};
use hrg_board::replay::{self, Options};
use hrg_board::{cost, serve};
use hrg_core::calibration::Calibration;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::facts;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::Recording;
use hrg_simulate::{Plan, Profile};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

/// Runs the very ELF that is flashed, on a virtual board.
#[derive(Parser)]
#[command(name = "hrg-board", version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Play a recording into the unit and keep what it sends.
    ///
    /// Example: hrg-board run --recording run.csv --calibration cal.toml --out corrected.csv --log run.log
    Run(RunArguments),
    /// The board live: link and log on pseudo-terminals, for hrg record, monitor, burn and read.
    ///
    /// Example: hrg-board serve --recording run.csv --folder out/board --speed 1
    Serve {
        /// Recording of raw rates that the unit lives through; by default a simulated chamber run.
        #[arg(long)]
        recording: Option<PathBuf>,
        /// Calibration, put into the unit's flash; by default what the folder's flash.bin holds.
        #[arg(long)]
        calibration: Option<PathBuf>,
        /// Target seconds per second here.
        #[arg(long, default_value_t = 1.0)]
        speed: f64,
        /// Stop after so many target seconds.
        #[arg(long)]
        seconds: Option<u64>,
        /// Folder for the links to the pseudo-terminals, and the flash.
        #[arg(long, default_value = "out/board")]
        folder: PathBuf,
        /// A fault of the program restarts the unit, as on the chip, in the place of a sentence that ends the run.
        #[arg(long)]
        as_on_chip: bool,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// The bring-up program on the virtual board, with the jumpers of docs/bring-up.md. cargo xtask bring-up --virtual builds and runs it.
    ///
    /// Example: hrg-board bring-up --elf target/bring-up/thumbv7em-none-eabihf/firmware/firmware
    BringUp {
        /// The program.
        #[arg(long)]
        elf: PathBuf,
        /// A jumper that is missing, PB9-PA0.
        #[arg(long, conflicts_with = "expect")]
        without: Option<String>,
        /// Write what was reached into the program's sources, as what is expected.
        #[arg(long)]
        expect: bool,
        /// Page whose log lines are written anew.
        #[arg(long, conflicts_with = "without")]
        page: Option<PathBuf>,
    },
    /// The tests for the chip (firmware/tests/chip.rs) on the virtual board; cargo xtask hil runs the same ELF on a real one.
    ///
    /// Example: hrg-board chip-tests --elf target/chip-tests.elf
    ChipTests {
        /// Their ELF.
        #[arg(long)]
        elf: PathBuf,
    },
    /// Cost of calibrations on the unit: instructions and bytes; and a comparison of the ELF with the desktop.
    ///
    /// Example: hrg-board cost --recording run.csv cal.toml other.toml
    Cost {
        /// Recording of raw rates.
        #[arg(long)]
        recording: PathBuf,
        /// Calibrations.
        #[arg(required = true)]
        calibrations: Vec<PathBuf>,
        /// Seconds of target time for each.
        #[arg(long, default_value_t = 120)]
        seconds: u64,
        /// Print JSON.
        #[arg(long)]
        json: bool,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
}

/// Arguments of `hrg-board run`.
#[derive(Args)]
struct RunArguments {
    /// Recording of raw rates.
    #[arg(long)]
    recording: PathBuf,
    /// Calibration, put into the unit's flash. Without it the sector is empty.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// File for the corrected recording.
    #[arg(long)]
    out: PathBuf,
    /// File for the unit's decoded log.
    #[arg(long)]
    log: Option<PathBuf>,
    /// File for the unit's raw log, as a debug probe reads it.
    #[arg(long)]
    defmt: Option<PathBuf>,
    /// Firmware; by default the one that cargo xtask build makes.
    #[arg(long)]
    elf: Option<PathBuf>,
    /// RMS jitter of each edge, ns.
    #[arg(long, default_value_t = 20.0)]
    jitter_ns: f64,
    /// Seed of the jitter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Stop after so many seconds of target time.
    #[arg(long)]
    seconds: Option<u64>,
    /// Print where instructions and estimated cycles go, function by function.
    #[arg(long)]
    profile: bool,
}

fn main() -> ExitCode {
    end_where_nobody_reads();
    hrg_data::error::exit("hrg-board", run(Arguments::parse().command), anyhow::Error::is::<image_file::FileError>)
}

/// Standard output may be a pipe whose reader has had enough (`| head`): the program then ends, which is no error.
fn end_where_nobody_reads() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let message = panic.payload().downcast_ref::<String>();
        if message.is_some_and(|m| m.starts_with("failed printing to stdout") && m.contains("Broken pipe")) {
            std::process::exit(0);
        }
        usual(panic);
    }));
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Run(arguments) => play(arguments),
        Command::Cost { recording, calibrations, seconds, json, elf } => {
            let steps = Steps::new(&load_raw(&recording, elf.as_ref())?)?;
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            let costs = cost::costs(&elf, &calibrations, &steps, seconds)?;
            if json {
                println!("{}", serde_json::to_string(&costs)?);
            } else {
                cost::print(&costs);
            }
            Ok(())
        }
        Command::Serve { recording, calibration, speed, seconds, folder, as_on_chip, elf } => {
            if !(0.01..=1000.0).contains(&speed) {
                return Err(BadInput::new("--speed must lie between 0.01 and 1000").into());
            }
            let source = match recording {
                Some(path) => load_raw(&path, elf.as_ref())?,
                None => {
                    println!("a simulated unit, profile cycle");
                    let mut simulated = Plan::of(Profile::parse("cycle")?, 1, 1).simulate().recording;
                    simulated.restore_earth_rate();
                    simulated
                }
            };
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            let calibration = matching(calibration, &source)?;
            let stop = Arc::new(AtomicBool::new(false));
            let set = stop.clone();
            ctrlc::set_handler(move || set.store(true, Ordering::Relaxed))?;
            let options = serve::Options { speed, seconds, folder, as_on_chip };
            serve::serve(&elf, calibration.as_ref(), &Steps::new(&source)?, &options, &stop)
        }
        Command::ChipTests { elf } => hrg_board::chip_tests::command(&replay::read_elf(&elf)?),
        Command::BringUp { elf, without, expect, page } => {
            let expect = expect.then(|| PathBuf::from("firmware/src/bring_up/expected.rs"));
            let elf = replay::read_elf(&elf)?;
            hrg_board::bring_up::command(&elf, without.as_deref(), expect.as_deref(), page.as_deref())
        }
    }
}

/// `hrg-board run`.
fn play(arguments: RunArguments) -> Result<()> {
    let RunArguments { recording, calibration, out, log, defmt, elf, jitter_ns, seed, seconds, profile } = arguments;
    let source = load_raw(&recording, elf.as_ref())?;
    let calibration = matching(calibration, &source)?;
    let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
    let steps = Steps::new(&source)?;
    let options = Options { jitter_s: jitter_ns * 1e-9, seed, seconds, profile, ..Options::default() };
    let bar = indicatif::ProgressBar::new(1000);
    bar.set_style(indicatif::ProgressStyle::with_template("running the ELF {bar:40} {percent}% {eta}")?);
    let outcome =
        replay::run(&elf, calibration.as_ref(), &steps, &options, |done| bar.set_position((done * 1000.0) as u64))?;
    bar.finish_and_clear();
    let rows = outcome.seconds_of_frames();
    hrg_data::output::write_file(&out, replay::to_csv(&source, calibration.as_ref(), &rows).as_bytes())?;
    if let Some(path) = defmt {
        hrg_data::output::write_file(&path, &outcome.received.log_bytes)?;
    }
    if let Some(log) = log {
        hrg_data::output::write_file(&log, (outcome.received.log.join("\n") + "\n").as_bytes())?;
    }
    if !outcome.profile.is_empty() {
        let all: u64 = outcome.profile.iter().map(|(_, cost)| cost.cycles).sum();
        println!("{:>12} {:>12} {:>6}  function", "instructions", "cycles", "share");
        for (name, cost) in outcome.profile.iter().take(40) {
            let a_second = |count: u64| count as f64 / outcome.seconds;
            let share = 100.0 * cost.cycles as f64 / all as f64;
            println!("{:>12.0} {:>12.0} {share:>5.1}%  {name}", a_second(cost.instructions), a_second(cost.cycles));
        }
        println!("per second; cycles are estimated (docs/bench.md)");
    }
    let (raw, corrected) = replay::three_sigma(&rows);
    if raw[0].is_nan() {
        println!("three sigma of 100 s means needs a run of 201 s; this one has {} s", rows.len());
    } else {
        println!(
            "{:<5} {:>14} {:>14}   three sigma of 100 s means [deg/h], from the frames",
            "axis", "raw", "corrected"
        );
        for a in 0..3 {
            println!("{:<5} {:>14.3} {:>14.3}", AXIS_NAMES[a], raw[a], corrected[a]);
        }
    }
    let r = &outcome.received;
    println!(
        "{} rate frames and {} housekeeping frames, {} differ from hrg-core on the desktop (largest difference {} deg/h)",
        r.rates.len(),
        r.housekeeping.len(),
        r.differing,
        r.largest_difference_dph
    );
    if let Some(d) = &r.first_difference {
        println!("first difference: {d}");
    }
    println!(
        "{:.0} instructions per second ({:.2} % of 180 MHz), {:.0} times real time, {} watchdog resets",
        outcome.instructions as f64 / outcome.seconds,
        outcome.instructions as f64 / outcome.seconds / 1.8e6,
        outcome.seconds / outcome.wall_s,
        outcome.watchdog_resets
    );
    Ok(())
}

/// A calibration for a recording: of its unit and its scale factor.
fn matching(path: Option<PathBuf>, source: &Recording) -> Result<Option<Calibration>> {
    let Some(path) = path else { return Ok(None) };
    let c = image_file::load(&path)?;
    let notes = facts::fits(&c, source, false).map_err(|e| BadInput::new(format!("{}: {e}", path.display())))?;
    notes.iter().for_each(|n| eprintln!("{}: {n}", path.display()));
    Ok(Some(c))
}

/// A recording of raw rates, as the unit measures them: with the earth's rate left in.
/// Sensors in the place of resonators are for a firmware of one's own (feature `sensors`).
fn load_raw(path: &std::path::Path, elf: Option<&PathBuf>) -> Result<Recording> {
    let mut source = hrg_data::load::load_recording(path)?;
    if elf.is_none() || source.thermometer != Thermometer::Sensors {
        hrg_data::recording::resonators::require_resonators(&source).map_err(|e| {
            let own = "a firmware with the feature sensors (cargo xtask size --sensors builds target/sensors) is given with --elf";
            BadInput::new(format!("{}: {e}; {own}", path.display()))
        })?;
    }
    source.restore_earth_rate();
    if source.corrected() {
        return Err(BadInput::new(format!(
            "{}: the rates are corrected already; play the raw recording",
            path.display()
        ))
        .into());
    }
    Ok(source)
}
