//! `hrg-study`: this repository's pages and campaigns. `cargo xtask` calls it.

use anyhow::Result;
use clap::{Parser, Subcommand};
use hrg_board::replay;
use hrg_data::error::BadInput;
use hrg_papers::methods::MethodError;
use hrg_study::methods::Work;
use hrg_study::pages::splice;
use hrg_study::{campaign, desktop_bench, faults, mutate};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Writes this repository's pages and runs its campaigns.
#[derive(Parser)]
#[command(name = "hrg-study", version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The seeded campaign behind docs/trace.md.
    ///
    /// Example: hrg-study trace --runs 1 --clean 3
    Trace(campaign::Arguments),
    /// False alarms of the trace's threshold: scores of the search on noise alone.
    ///
    /// Example: hrg-study threshold --units 30
    Threshold(hrg_study::threshold::Arguments),
    /// One checksum over the findings of three traces.
    ///
    /// Example: hrg-study short-form
    ShortForm,
    /// Time of reading, writing, fit, trace and Allan deviation on this machine.
    ///
    /// Example: hrg-study bench-desktop
    BenchDesktop(desktop_bench::Arguments),
    /// Cost of the unit in instructions and bytes, beside other ways to write it, and the distance of its numbers from their limits.
    ///
    /// Example: hrg-study bench
    Bench {
        /// Page whose tables are written anew.
        #[arg(long)]
        page: Option<PathBuf>,
    },
    /// Checksums of frames, images and files: print them before and after a change that should change nothing.
    ///
    /// Example: hrg-study fingerprint > before.txt
    Fingerprint {
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
        /// A file whose checksum is printed, too. Several may be given.
        #[arg(long)]
        file: Vec<PathBuf>,
    },
    /// Attack what the unit promises (docs/promises.md): power cuts, flipped bits, sensor faults, noise on the link, load, time.
    ///
    /// Example: hrg-study faults --short
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
        corruption: faults::memory::Corruption,
        /// Page whose table is written anew.
        #[arg(long, conflicts_with = "only")]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Make the set-up code wrong in one write after the other; the board must notice.
    ///
    /// Example: hrg-study mutate --short
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
    /// Self-alignment: campaigns over the filters, what they cost on the unit, and chen2015's case on the ELF.
    ///
    /// Example: hrg-study align-demo --runs 200
    AlignDemo {
        /// Platforms in each campaign.
        #[arg(long, default_value_t = hrg_align_tools::study::RUNS)]
        runs: u64,
        /// Seed.
        #[arg(long, default_value_t = hrg_align_tools::study::SEED)]
        seed: u64,
        /// Folder for the files.
        #[arg(long, default_value = "out/alignment")]
        out: PathBuf,
        /// Write the figures as Markdown to this file, and the curves beside it.
        #[arg(long)]
        table: Option<PathBuf>,
    },
    /// Every identification method on a simulated unit of each paper's kind, its cost counted, and flown.
    ///
    /// Example: hrg-study methods --out out/methods
    Methods {
        /// Seed of noise and searches.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Folder for the files.
        #[arg(long, default_value = "out/methods")]
        out: PathBuf,
        /// Units of each case.
        #[arg(long, default_value_t = 5)]
        units: u64,
        /// Draws of noise for each unit.
        #[arg(long, default_value_t = 5)]
        seeds: u64,
        /// Folder with recordings of the second plant: a case more.
        #[arg(long)]
        foreign: Option<PathBuf>,
        /// Fly only so many seconds of the repeat runs.
        #[arg(long)]
        seconds: Option<u64>,
        /// Fly only the image of this unit (dong-like, dong2023, wu-like or zhao-like; none: no flight).
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
    /// Example: hrg-study rates --seed 6
    Rates {
        /// Number of the unit.
        #[arg(long, default_value_t = 6)]
        seed: u64,
        /// Folder for the images.
        #[arg(long, default_value = "out/rates")]
        out: PathBuf,
        /// The firmware; by default the one that is built here.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Rates and increments as a navigator gets them: filters swept, coning and sculling, GNSS time, link and processor, through the ELF.
    ///
    /// Example: hrg-study output --page docs/navigator.md
    Output {
        /// Write the tables into this page, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
        /// The firmware; by default the one that is built here.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Units whose bias follows drive and quadrature: traced with their inputs and without, judged on a third run, and flown.
    ///
    /// Example: hrg-study inputs --folder out/inputs
    Inputs(hrg_study::inputs::Arguments),
    /// Hours that a family spares the next unit: a short run under it against a long one without, on units of one design by the second plant.
    ///
    /// Example: hrg-study family design-a.json:new-units:foreign-units
    Family(hrg_study::family::Arguments),
    /// The main job from end to end, on a simulated unit.
    ///
    /// Example: hrg-study demo --seed 7
    Demo {
        /// Number of the unit.
        #[arg(long, default_value_t = 10)]
        seed: u64,
        /// Folder for the files.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Page into which what is printed goes, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
        /// Firmware; by default the one that cargo xtask build makes.
        #[arg(long)]
        elf: Option<PathBuf>,
    },
    /// Close the loop on the measured recordings that come with the project: every method and the trace, before and after.
    ///
    /// Example: hrg-study measured
    Measured {
        /// Folder of the recordings.
        #[arg(default_value = "host-tests/recordings/measured")]
        folder: PathBuf,
        /// Page into which all of it is written, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
        /// Page into which the caption of the picture is written, between its marks.
        #[arg(long)]
        caption: Option<PathBuf>,
        /// File for the picture of the IMU (SVG).
        #[arg(long)]
        picture: Option<PathBuf>,
    },
    /// wu2023 from end to end on a simulated gyro with temperature sensors and no resonator: identify, correct, measure again, one
    /// direction after the other.
    ///
    /// Example: hrg-study wu2023 --out out/wu2023
    Wu2023 {
        /// Folder for the recordings, the calibrations and the corrected recordings.
        #[arg(long, default_value = "out/wu2023")]
        out: PathBuf,
        /// Page into which the table is written, between its marks.
        #[arg(long)]
        page: Option<PathBuf>,
    },
    /// Print the columns of recordings, and the bytes of calibration images and of the link's messages, with formats of Python's struct.
    ///
    /// Example: hrg-study formats
    Formats {
        /// Page whose tables, between their marks, are written anew.
        #[arg(long)]
        page: Option<PathBuf>,
    },
}

fn main() -> ExitCode {
    hrg_data::error::exit("hrg-study", run(Arguments::parse().command), anyhow::Error::is::<MethodError>)
}

fn run(command: Command) -> Result<()> {
    let top = std::env::current_dir()?;
    match command {
        Command::Trace(arguments) => campaign::run(&arguments),
        Command::Threshold(arguments) => hrg_study::threshold::run(&arguments),
        Command::ShortForm => {
            println!("{}", campaign::short_form()?);
            Ok(())
        }
        Command::BenchDesktop(arguments) => desktop_bench::run(&arguments),
        Command::Bench { page } => bench(page.as_deref()),
        Command::Fingerprint { elf, file } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            print!("{}{}", hrg_study::fingerprint::fingerprints(&elf)?, hrg_study::fingerprint::of_files(&file)?);
            Ok(())
        }
        Command::Faults { short, seed, only, trial, corruption, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            if let Some(trial) = trial {
                return faults::memory::again(&faults::Scene::new(&elf, seed)?, seed, trial, corruption);
            }
            let extent = if short { faults::Extent::SHORT } else { faults::Extent::FULL };
            faults::faults(&elf, seed, &extent, only.as_deref(), page.as_deref())
        }
        Command::Mutate { seed, count, short, list, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            mutate::mutate(&elf, seed, if short { count.div_ceil(10) } else { count }, list, page.as_deref())
        }
        Command::AlignDemo { runs, seed, out, table } => {
            let elf = replay::read_elf(&replay::default_elf())?;
            let bench = replay::read_elf(&replay::default_elf().with_file_name("bench"))?;
            hrg_study::align::demo(&elf, &bench, runs, seed, &out, table.as_deref())
        }
        Command::Methods { seed, out, units, seeds, foreign, seconds, fly, table, page, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            let (fly, table, page) = (fly.as_deref(), table.as_deref(), page.as_deref());
            let foreign = foreign.as_deref();
            hrg_study::methods::methods(
                &elf,
                &Work { out: &out, seed, units, seeds, foreign, seconds, fly, table, page },
            )
        }
        Command::Rates { seed, out, elf } => {
            let elf = replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?;
            hrg_study::rates::rates(&elf, seed, &out)?;
            hrg_study::forces::forces(&elf, seed, &out)
        }
        Command::Output { page, elf } => {
            hrg_study::output::report(&replay::read_elf(&elf.unwrap_or_else(replay::default_elf))?, page.as_deref())
        }
        Command::Inputs(arguments) => {
            let text = hrg_study::inputs::run(&arguments)?;
            print!("{text}");
            arguments.page.map_or(Ok(()), |page| splice(&page, "inputs", &text))
        }
        Command::Family(arguments) => {
            let text = hrg_study::family::run(&arguments)?;
            print!("{text}");
            arguments.page.map_or(Ok(()), |page| splice(&page, "family", &text))
        }
        Command::Demo { seed, out, page, elf } => {
            let out = out.unwrap_or_else(|| PathBuf::from("out").join(format!("demo-{seed}")));
            let elf = elf.unwrap_or_else(replay::default_elf);
            let text = hrg_study::demo::demo(seed, &out, &elf, &top.join("host-tests/recordings/dong2023-table1.csv"))?;
            page.map_or(Ok(()), |page| splice(&page, "demo", &format!("```\n{text}```\n")))
        }
        Command::Measured { folder, page, caption, picture } => measured(&folder, page, caption, picture),
        Command::Wu2023 { out, page } => {
            std::fs::create_dir_all(&out).map_err(|e| BadInput(format!("cannot make {}: {e}", out.display())))?;
            let text = hrg_papers::wu2023::report(&out)?;
            print!("{text}");
            page.map_or(Ok(()), |page| splice(&page, "wu2023", &format!("```\n{text}```\n")))
        }
        Command::Formats { page: None } => {
            hrg_study::formats::tables().iter().for_each(|(_, table)| println!("{table}"));
            Ok(())
        }
        Command::Formats { page: Some(page) } => {
            hrg_study::formats::tables().iter().try_for_each(|(name, table)| splice(&page, name, table))
        }
    }
}

/// `hrg-study bench`.
fn bench(page: Option<&Path>) -> Result<()> {
    let elf = replay::read_elf(&replay::default_elf())?;
    let alternatives = replay::read_elf(&replay::default_elf().with_file_name("alternatives"))?;
    let (tables, within) = hrg_study::unit_bench::tables(&elf, &alternatives)?;
    print!("{tables}");
    if let Some(page) = page {
        splice(page, "unit", &tables)?;
    }
    anyhow::ensure!(within, "a figure is over its bound");
    Ok(())
}

/// The loop on the measured recordings, printed, and written where it is wanted.
fn measured(folder: &Path, page: Option<PathBuf>, caption: Option<PathBuf>, picture: Option<PathBuf>) -> Result<()> {
    use hrg_study::measured;
    let mut all = String::new();
    for part in [measured::imu, measured::voltmeter, measured::gpsdo, measured::uberclock] {
        let text = part(folder)?;
        let gap = if all.is_empty() { "" } else { "\n" };
        print!("{gap}{text}");
        all += &format!("{gap}{text}");
    }
    if let Some(page) = page {
        splice(&page, "measured", &format!("```\n{all}```\n"))?;
    }
    if caption.is_none() && picture.is_none() {
        return Ok(());
    }
    let short = measured::imu_in_short(folder)?;
    if let Some(picture) = picture {
        hrg_data::output::write_file(&picture, short.picture.as_bytes())?;
    }
    let Some(page) = caption else { return Ok(()) };
    splice(&page, "measured", &format!("*{}*\n", short.caption))?;
    splice(&page, "voltmeter", &format!("*{}*\n", measured::voltmeter_in_short(folder)?.1))
}
