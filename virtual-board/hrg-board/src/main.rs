//! `hrg-board`: the firmware ELF on a virtual board.

use anyhow::Result;
use clap::{Args, Parser, Subcommand};
use hrg_board::methods::Work;
use hrg_board::replay::{self, Options};
use hrg_board::{cost, faults, mutate, serve};
use hrg_cal::image_file;
use hrg_cal::recording::facts;
use hrg_cal::recording::format::Thermometer;
use hrg_cal::recording::steps::Steps;
use hrg_cal::recording::Recording;
use hrg_cal::simulate::{Plan, Profile};
use hrg_cal::{BadInput, AXIS_NAMES};
use hrg_core::calibration::Calibration;
use std::path::{Path, PathBuf};
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
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// What the unit costs in instructions and bytes, what others would write, and how near its numbers come to their limits.
    ///
    /// Example: hrg-board bench
    Bench {
        /// Page whose tables are written anew.
        #[arg(long)]
        page: Option<PathBuf>,
    },
    /// Checksums of frames, images and files: print them before and after a change that should change nothing.
    ///
    /// Example: hrg-board fingerprint > before.txt
    Fingerprint {
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
        /// A file whose checksum is printed, too. Several may be given.
        #[arg(long)]
        file: Vec<PathBuf>,
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
    /// Attack what the unit promises (docs/promises.md): power cuts, flipped bits, sensor faults, noise on the link, load, time.
    ///
    /// Example: hrg-board faults --short
    Faults {
        /// A small part of it, as the tests do.
        #[arg(long)]
        short: bool,
        /// Seed of every draw.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// One part alone.
        #[arg(long, value_parser = faults::PARTS)]
        only: Option<String>,
        /// One flipped bit of RAM again, by its number, with what happened on the way.
        #[arg(long, conflicts_with_all = ["short", "only"])]
        trial: Option<u64>,
        /// Of which kind that one is.
        #[arg(long, value_enum, default_value = "single")]
        upset: faults::memory::Upset,
        /// Page whose table is written anew.
        #[arg(long, conflicts_with = "only")]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Make the set-up code wrong in one write after the other; the board must notice.
    ///
    /// Example: hrg-board mutate --short
    Mutate {
        /// Seed of every draw.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// So many mutants.
        #[arg(long, default_value_t = mutate::COUNT)]
        count: u64,
        /// A tenth of them, as the tests do.
        #[arg(long)]
        short: bool,
        /// Print every mutant, not only those that were not noticed.
        #[arg(long)]
        list: bool,
        /// Page whose table is written anew.
        #[arg(long, conflicts_with = "short")]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// What calibrations cost on the unit: instructions and bytes, and whether the ELF computes what the desktop does.
    ///
    /// Example: hrg-board cost --recording run.csv cal.toml other.toml
    #[command(alias = "weigh")]
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
    /// Self-alignment: campaigns over the filters, what they cost on the unit, and chen2015's case on the ELF.
    ///
    /// Example: hrg-board align-demo --runs 200
    AlignDemo {
        /// Platforms in each campaign.
        #[arg(long, default_value_t = 200)]
        runs: u64,
        /// Seed.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Where the files go.
        #[arg(long, default_value = "out/alignment")]
        out: PathBuf,
        /// Write the figures as Markdown to this file, and the curves beside it.
        #[arg(long)]
        table: Option<PathBuf>,
        /// Firmware built with the feature upf.
        #[arg(long)]
        upf: Option<PathBuf>,
    },
    /// Every identification method on a simulated unit of each paper's kind, its cost counted, and flown.
    ///
    /// Example: hrg-board methods --out out/methods
    Methods {
        /// Seed of noise and searches.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Where the files go.
        #[arg(long, default_value = "out/methods")]
        out: PathBuf,
        /// Fly only so many seconds of the repeat runs.
        #[arg(long)]
        seconds: Option<u64>,
        /// Fly only the image of this unit (dong-like, wu-like or zhao-like).
        #[arg(long)]
        fly: Option<String>,
        /// Write the tables as Markdown to this file, and the pictures beside it.
        #[arg(long)]
        table: Option<PathBuf>,
        /// Write the short table into this page, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Scale factor and misalignment over temperature on a simulated unit and rate table, before and after, through the ELF.
    ///
    /// Example: hrg-board rates --seed 6
    Rates {
        /// Which unit.
        #[arg(long, default_value_t = 6)]
        seed: u64,
        /// Where the images go.
        #[arg(long, default_value = "out/rates")]
        out: PathBuf,
        /// The firmware; by default the one that is built here.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// The main job from end to end, on a simulated unit.
    ///
    /// Example: hrg-board demo --seed 7
    Demo {
        /// Which unit.
        #[arg(long, default_value_t = 10)]
        seed: u64,
        /// Where the files go.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Page into which what is printed goes, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
}

/// What `hrg-board run` is told.
#[derive(Args)]
struct RunArguments {
    /// Recording of raw rates.
    #[arg(long)]
    recording: PathBuf,
    /// Calibration, put into the unit's flash. Without it the sector is empty.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Where the corrected recording goes.
    #[arg(long)]
    out: PathBuf,
    /// Where the unit's decoded log goes.
    #[arg(long)]
    log: Option<PathBuf>,
    /// Where the unit's raw log goes, as a debug probe reads it.
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
    /// Print where the instructions go, function by function.
    #[arg(long)]
    profile: bool,
}

fn main() -> ExitCode {
    end_where_nobody_reads();
    hrg_cal::exit("hrg-board", run(Arguments::parse().command))
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
    let top = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
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
        Command::Serve { recording, calibration, speed, seconds, folder, elf } => {
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
            let options = serve::Options { speed, seconds, folder };
            serve::serve(&elf, calibration.as_ref(), &Steps::new(&source)?, &options, &stop)
        }
        Command::AlignDemo { runs, seed, out, table, upf } => {
            let elf = replay::read_elf(&replay::default_elf())?;
            let bench = replay::read_elf(&replay::default_elf().with_file_name("bench"))?;
            let upf = upf.map(|p| replay::read_elf(&p)).transpose()?;
            hrg_board::align::demo(&elf, &bench, upf.as_deref(), runs, seed, &out, table.as_deref())
        }
        Command::Bench { page } => bench(page.as_deref()),
        Command::ChipTests { elf } => hrg_board::chip_tests::command(&replay::read_elf(&elf)?),
        Command::BringUp { elf, without, expect, page } => {
            let expect = expect.then(|| top.join("firmware/src/bring_up/expected.rs"));
            let elf = replay::read_elf(&elf)?;
            hrg_board::bring_up::command(&elf, without.as_deref(), expect.as_deref(), page.as_deref())
        }
        Command::Fingerprint { elf, file } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            print!("{}{}", hrg_board::fingerprint::fingerprints(&elf)?, hrg_board::fingerprint::of_files(&file)?);
            Ok(())
        }
        Command::Faults { short, seed, only, trial, upset, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            if let Some(trial) = trial {
                return faults::memory::again(&faults::Scene::new(&elf, seed)?, seed, trial, upset);
            }
            let extent = if short { faults::Extent::SHORT } else { faults::Extent::FULL };
            faults::faults(&elf, seed, &extent, only.as_deref(), page.as_deref())
        }
        Command::Mutate { seed, count, short, list, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            mutate::mutate(&elf, seed, if short { count.div_ceil(10) } else { count }, list, page.as_deref())
        }
        Command::Methods { seed, out, seconds, fly, table, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            let (fly, table, page) = (fly.as_deref(), table.as_deref(), page.as_deref());
            hrg_board::methods::methods(&elf, &Work { out: &out, seed, seconds, fly, table, page })
        }
        Command::Rates { seed, out, elf } => {
            hrg_board::rates::rates(&replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?, seed, &out)
        }
        Command::Demo { seed, out, page, elf } => {
            let out = out.unwrap_or_else(|| PathBuf::from("out").join(format!("demo-{seed}")));
            let elf = elf.unwrap_or_else(replay::default_elf);
            let told = hrg_board::demo::demo(seed, &out, &elf, &top.join("host-tests/recordings/dong2023-table1.csv"))?;
            page.map_or(Ok(()), |page| hrg_cal::splice(&page, "demo", &format!("```\n{told}```\n")))
        }
    }
}

/// `hrg-board bench`.
fn bench(page: Option<&Path>) -> Result<()> {
    let elf = replay::read_elf(&replay::default_elf())?;
    let alternatives = replay::read_elf(&replay::default_elf().with_file_name("alternatives"))?;
    let (tables, within) = hrg_board::bench::tables(&elf, &alternatives)?;
    print!("{tables}");
    if let Some(page) = page {
        hrg_cal::splice(page, "unit", &tables)?;
    }
    anyhow::ensure!(within, "a figure is over its bound");
    Ok(())
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
    hrg_cal::write_file(&out, replay::to_csv(&source, calibration.as_ref(), &rows).as_bytes())?;
    if let Some(path) = defmt {
        hrg_cal::write_file(&path, &outcome.received.log_bytes)?;
    }
    if let Some(log) = log {
        hrg_cal::write_file(&log, (outcome.received.log.join("\n") + "\n").as_bytes())?;
    }
    if !outcome.profile.is_empty() {
        println!("{:>12} {:>6}  function", "per second", "share");
        for (name, count) in outcome.profile.iter().take(30) {
            let share = 100.0 * *count as f64 / outcome.instructions as f64;
            println!("{:>12.0} {share:>5.1}%  {}", *count as f64 / outcome.seconds, name);
        }
    }
    let (raw, corrected) = replay::three_sigma(&rows);
    println!("{:<5} {:>14} {:>14}   three sigma of 100 s means [deg/h], from the frames", "axis", "raw", "corrected");
    for a in 0..3 {
        println!("{:<5} {:>14.3} {:>14.3}", AXIS_NAMES[a], raw[a], corrected[a]);
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
    let mut source = hrg_cal::load_recording(path)?;
    if elf.is_none() || source.thermometer != Thermometer::Sensors {
        hrg_cal::recording::format::require_resonators(&source).map_err(|e| {
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
