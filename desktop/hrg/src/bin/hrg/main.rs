//! `hrg`: recordings of HRG chamber runs in, coefficients and reports out.

// Standard output may be a pipe whose reader has had enough (`| head`): that is no error, and files are written all the
// same. These two stand before the modules and so take the place of std's in all of them.
macro_rules! print {
    ($($part:tt)*) => { $crate::say(format_args!($($part)*)) };
}
macro_rules! println {
    () => { $crate::say(format_args!("\n")) };
    ($($part:tt)*) => { $crate::say(format_args!("{}\n", format_args!($($part)*))) };
}

mod accelerometers;
mod align;
mod allan;
mod chamber;
mod compare;
mod correct;
mod effects;
mod facts;
mod fit;
mod heading;
mod images;
mod import;
mod lag;
mod log;
mod merge;
mod points;
mod profile;
mod rates;
mod report;
mod simulate;
mod simulate_alignment;
mod soaks;
mod trace;

use anyhow::Result;
use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, Parser, Subcommand};
use hrg_align_tools::ReadError;
use hrg_data::error::BadInput;
use hrg_data::image_file::FileError;
use hrg_identify::fit::independence::Units;
use hrg_identify::thermometer::points::TableError;
use hrg_papers::methods::MethodError;
use std::path::PathBuf;
use std::process::ExitCode;

/// Calibration of hemispherical resonator gyros over temperature.
#[derive(Parser)]
#[command(name = "hrg", version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a chamber run.
    ///
    /// Example: hrg simulate --profile dong --effect hysteresis:width_c=10,size=3 --seed 7 --out run.csv
    Simulate(simulate::Arguments),
    /// Fit static points: frequency and temperature of soaks.
    ///
    /// Example: hrg points host-tests/recordings/dong2023-table1.csv --out points.json
    Points(points::Arguments),
    /// Take the soaks out of runs: a row of frequencies and temperatures for each, for hrg points.
    ///
    /// Example: hrg soaks run.csv --out table.csv
    Soaks(soaks::Arguments),
    /// Identify the coefficients of a bias model.
    ///
    /// Example: hrg fit run.csv --method lsq --out cal.toml
    Fit(fit::Arguments),
    /// Identify by every method, and compare on runs that none of them saw.
    ///
    /// Example: hrg compare train.csv --verify verify.csv --out out/compare
    Compare(compare::Arguments),
    /// What changed from one calibration of a unit to the next, over the temperatures; with three and more, the trend and when to calibrate again.
    ///
    /// Example: hrg compare-images 2025.toml 2026.toml --out changes.svg
    CompareImages(images::Arguments),
    /// How the resonators follow their surroundings: gain and time constant from a chamber step.
    ///
    /// Example: hrg lag step.csv --calibration cal.toml --out lag.json
    Lag(lag::Arguments),
    /// Make a recording from a unit as it runs, over its link or from its log.
    ///
    /// Example: hrg record --port /dev/ttyUSB0 --out run.csv
    Record {
        /// Serial port of the link.
        #[arg(long, conflicts_with = "defmt", required_unless_present = "defmt")]
        port: Option<String>,
        /// The unit's log: lines as probe-rs or defmt-print show them, or the raw stream; - for standard input.
        #[arg(long)]
        defmt: Option<PathBuf>,
        /// The firmware that made a raw stream.
        #[arg(long)]
        elf: Option<PathBuf>,
        #[command(flatten)]
        facts: chamber::RecordArguments,
        /// Stop after so many rows.
        #[arg(long)]
        seconds: Option<u64>,
        /// Where the recording goes; a file that is there is not overwritten.
        #[arg(long)]
        out: PathBuf,
    },
    /// Which chamber profile tells the effects apart, and what a recording told: soaks, ramps, hours.
    ///
    /// Example: hrg profile --check run.csv
    Profile(profile::Arguments),
    /// Allan deviation of the rates, with confidence bars, and what is read off it.
    ///
    /// Example: hrg allan run.csv --out allan.svg
    Allan(allan::Arguments),
    /// Watch a unit: temperatures, rates, biases, status, link, soak, remaining time.
    ///
    /// Example: hrg monitor --port /dev/ttyUSB0 --profile cycle
    Monitor(chamber::MonitorArguments),
    /// Burn a calibration into a unit, read it back and see that the unit runs it.
    ///
    /// Example: hrg burn cal.toml --port /dev/ttyUSB0
    Burn(chamber::BurnArguments),
    /// Write the image of a calibration into a file, for a unit whose images come by the debug port.
    ///
    /// Example: hrg image cal.toml --unit HRG-7 --out image.bin
    Image(chamber::ImageArguments),
    /// Make a key that signs calibrations, for firmware built with the feature signed.
    ///
    /// Example: hrg keygen --out owner.key
    Keygen {
        /// Where the private key goes; the public one goes beside it, with .pub behind its name.
        #[arg(long)]
        out: PathBuf,
    },
    /// Read the calibrations in a unit, or its field log: what befell it, over power cuts.
    ///
    /// Example: hrg read --port /dev/ttyUSB0 --out in-use.toml
    Read {
        /// Serial port of the link.
        #[arg(long)]
        port: String,
        /// The field log instead: starts and their causes, flags that rose, burns; the newest last.
        #[arg(long, conflicts_with = "out")]
        events: bool,
        /// Where the image in use goes.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Self-alignment: azimuth, tilts and drifts from the velocities of a platform at rest in two positions.
    ///
    /// Example: hrg align --recording a.csv --filter linear --out report.json
    Align(align::Arguments),
    /// Bias, scale and cross-axis of a platform's accelerometers, from tilts that are known.
    ///
    /// Example: hrg accelerometers tilts.csv --latitude 45 --out accelerometers.json
    Accelerometers(accelerometers::Arguments),
    /// Which two positions to align in: those whose drifts are nearly equal and repeat best.
    ///
    /// Example: hrg heading day1.csv day2.csv day3.csv
    Heading(heading::Arguments),
    /// Simulate a platform to align, in two positions.
    ///
    /// Example: hrg simulate-alignment --seed 3 --out a.csv
    SimulateAlignment(simulate_alignment::Arguments),
    /// Find what the baseline model lacks, add it, and measure before and after on a run it never saw.
    ///
    /// Example: hrg trace --train a.csv --verify b.csv --out report.json --html report.html --calibration cal.toml
    Trace(trace::Arguments),
    /// The effects of the library: class, parameters, equation, state, source.
    ///
    /// Example: hrg effects hysteresis play-ladder
    Effects(effects::Arguments),
    /// Put columns of a chamber's own log into a recording, by time.
    ///
    /// Example: hrg merge run.csv --with chamber.csv --time Time=iso --columns chamber_c=PT100 --out merged.csv
    Merge(merge::Arguments),
    /// Make a recording of another program's file: any delimited table, or a PX4 log, by a map of its columns.
    ///
    /// Example: hrg import flight.ulg --map px4 --out run.csv
    Import(import::Arguments),
    /// Figures of a data sheet from recordings alone, with intervals: bias over temperature, loop width, turn-on repeatability,
    /// bias stability, angle random walk, sensitivity to ramps.
    ///
    /// Example: hrg report a.csv b.csv c.csv --html report.html
    Report(report::Arguments),
    /// Correct a recording as the unit does, on the desktop: row for row what it would send.
    ///
    /// Example: hrg correct run.csv --calibration cal.toml --out corrected.csv
    Correct(correct::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::try_parse().unwrap_or_else(|e| with_example(e).exit());
    hrg_data::error::exit("hrg", run(arguments.command), |e| {
        e.is::<FileError>() || e.is::<TableError>() || e.is::<MethodError>() || e.is::<ReadError>()
    })
}

/// Wrong arguments of a command: with the example that its help has.
fn with_example(mut e: clap::Error) -> clap::Error {
    let arguments = Arguments::command();
    let command = std::env::args().nth(1).and_then(|name| arguments.find_subcommand(name).cloned());
    let help = command.and_then(|c| c.get_long_about().map(ToString::to_string)).unwrap_or_default();
    if let Some(example) = help.lines().find_map(|line| line.strip_prefix("Example: ")).filter(|_| e.use_stderr()) {
        let tip = clap::builder::StyledStr::from(format!("for example: {example}"));
        e.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip]));
    }
    e
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Points(arguments) => points::run(arguments),
        Command::Soaks(arguments) => soaks::run(&arguments),
        Command::Trace(arguments) => trace::run(arguments),
        Command::Fit(arguments) => fit::run(arguments),
        Command::Compare(arguments) => compare::run(arguments),
        Command::CompareImages(arguments) => images::run(&arguments),
        Command::Record { port, defmt, elf, facts, seconds, out } => match (port, defmt) {
            (Some(port), _) => chamber::record_port(&port, &out, seconds, &facts),
            (None, Some(log)) => log::record(&log, elf.as_deref(), &out, &facts),
            (None, None) => Err(BadInput::new("give --port or --defmt").into()),
        },
        Command::Profile(arguments) => profile::run(arguments),
        Command::Effects(arguments) => effects::run(&arguments),
        Command::Allan(arguments) => allan::run(arguments),
        Command::Monitor(arguments) => chamber::monitor(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Report(arguments) => report::run(arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Correct(arguments) => correct::run(&arguments),
        Command::Burn(arguments) => chamber::burn(&arguments),
        Command::Image(arguments) => chamber::image(&arguments),
        Command::Keygen { out } => chamber::keygen(&out),
        Command::Read { port, events: true, .. } => chamber::read_events(&port),
        Command::Read { port, out, .. } => chamber::read(&port, out.as_deref()),
        Command::Align(arguments) => align::run(&arguments),
        Command::Accelerometers(arguments) => accelerometers::run(&arguments),
        Command::Heading(arguments) => heading::run(&arguments),
        Command::SimulateAlignment(arguments) => simulate_alignment::run(arguments),
        Command::Lag(arguments) => lag::run(&arguments),
    }
}

/// Prints to standard output. Once nobody reads it any more, nothing is printed.
fn say(text: std::fmt::Arguments<'_>) {
    use std::io::Write;
    if let Err(e) = std::io::stdout().write_fmt(text) {
        if e.kind() != std::io::ErrorKind::BrokenPipe {
            eprintln!("hrg: cannot write to standard output: {e}");
            std::process::exit(1);
        }
    }
}

/// Converts the option for recordings of different units.
fn units(different: bool) -> Units {
    if different {
        Units::Different
    } else {
        Units::Same
    }
}

/// Seconds since 1970.
fn now() -> u32 {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs() as u32)
}
