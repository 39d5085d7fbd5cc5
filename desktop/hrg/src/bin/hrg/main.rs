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
mod anonymise;
mod calibrate;
mod chamber;
mod colour;
mod compare;
mod correct;
mod effects;
mod export;
mod facts;
mod family;
mod fit;
mod fleet;
mod forces;
mod heading;
mod images;
mod import;
mod judge;
mod lag;
mod log;
mod merge;
mod output;
mod points;
mod profile;
mod program;
mod rates;
mod report;
mod self_test;
mod simulate;
mod simulate_alignment;
mod soaks;
mod trace;
mod wait;

use anstyle::Style;
use anyhow::Result;
use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use hrg_align_tools::ReadError;
use hrg_data::error::BadInput;
use hrg_data::image_file::FileError;
use hrg_identify::fit::independence::Units;
use hrg_identify::thermometer::points::TableError;
use hrg_papers::methods::MethodError;
use std::path::PathBuf;
use std::process::ExitCode;

/// Temperature calibration for gyros: from a thermal-chamber run to the coefficients, the error that is left, and its cause.
#[derive(Parser)]
#[command(name = "hrg", version, about, max_term_width = MOST_COLUMNS)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a recording from another program's file: any delimited table, Parquet, or a log of PX4 or ArduPilot. Or add columns of a chamber's
    /// own log to a recording, matched by time.
    ///
    /// Example: hrg import flight.ulg --map px4 -o run.csv
    Import(import::Arguments),
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
        /// File for the recording; a file that is there is not overwritten.
        #[arg(short, long)]
        out: PathBuf,
    },
    /// Watch a unit: temperatures, rates, biases, status, link, soak, remaining time.
    ///
    /// Example: hrg monitor --port /dev/ttyUSB0 --profile cycle
    Monitor(chamber::MonitorArguments),
    /// Simulate a chamber run.
    ///
    /// Example: hrg simulate --profile dong --effect hysteresis:width_c=10,size=3 --seed 7 --out run.csv
    Simulate(simulate::Arguments),
    /// Calibrate a unit in one go: test, train run, verify run, fit, trace, judge, burn, report. Stopped at any step, it goes on there.
    ///
    /// Example: hrg calibrate --port /dev/ttyUSB0 --profile cycle --limit 1 --from -40 --to 50 --folder HRG-7
    Calibrate(calibrate::Arguments),
    /// Say whether a unit stays within a limit over a range of temperatures: PASS, FAIL or NOT COVERED (exit status 0, 3, 4).
    ///
    /// Example: hrg judge b.csv --calibration cal.toml --limit 1 --from -40 --to 60 --html judged.html
    Judge(judge::Arguments),
    /// Figures of a data sheet from recordings alone, with intervals: bias over temperature, loop width, turn-on repeatability,
    /// bias stability, angle random walk, sensitivity to ramps, thermal lag.
    ///
    /// Example: hrg report a.csv b.csv c.csv --html report.html
    Report(report::Arguments),
    /// Allan deviation of the rates, with confidence bars, and the noise figures that it shows.
    ///
    /// Example: hrg allan run.csv --out allan.svg
    Allan(allan::Arguments),
    /// Make a copy of a recording that you can give away: without names and dates; with --latitude and --axes without the place.
    ///
    /// Example: hrg anonymise run.csv --latitude 48.1 --axes "x=north y=east z=down" -o for-others.csv
    Anonymise(anonymise::Arguments),
    /// Fit the cubic of temperature that ArduPilot or PX4 compensates by, and write their parameters.
    ///
    /// Example: hrg export warming.csv --verify flight.csv --for ardupilot -o imu0.param
    Export(export::Arguments),
    /// Correct a recording as the unit does, on the desktop: row for row what it would send.
    ///
    /// Example: hrg correct run.csv --calibration cal.toml --out corrected.csv
    Correct(correct::Arguments),
    /// List the effects that a chamber profile can distinguish, or the soaks, ramps and hours of a recording.
    ///
    /// Example: hrg profile --check run.csv
    Profile(profile::Arguments),
    /// Identify the coefficients of a bias model from runs; or the curves of static points, soaks, the lag of the resonators.
    ///
    /// Example: hrg fit run.csv --method lsq -o cal.toml
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
    Fit {
        #[command(subcommand)]
        of: Option<FitCommand>,
        #[command(flatten)]
        arguments: fit::Arguments,
    },
    /// Learn what the units of one design share, for the next one: fewer hours in the chamber with hrg fit --prior.
    ///
    /// Example: hrg family units/*.csv -o design-a.json
    Family(family::Arguments),
    /// Look at many units at once: a table with a row for each (Parquet), distributions, outliers, batches, calibrations that have aged. A run that was
    /// stopped goes on where it was.
    ///
    /// Example: hrg fleet units -o out/fleet
    Fleet(fleet::Arguments),
    /// Find the effects that the baseline model lacks, add them, and measure before and after on a run that the search never saw.
    ///
    /// Example: hrg trace a.csv --verify b.csv -o report.json --html report.html --calibration cal.toml
    Trace(trace::Arguments),
    /// Differences between calibrations of a unit, over the temperatures; with three and more, the trend and when to calibrate again.
    ///
    /// Example: hrg compare-images 2025.toml 2026.toml --out changes.svg
    CompareImages(images::Arguments),
    /// Burn, read, sign or write out calibration images; new programs; tests and the field log.
    ///
    /// Example: hrg unit burn cal.toml --port /dev/ttyUSB0
    #[command(subcommand)]
    Unit(UnitCommand),
    /// Self-alignment: azimuth, tilts and drifts from the velocities of a platform at rest in two positions.
    ///
    /// Example: hrg align a.csv --filter linear -o report.json
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
    Align {
        #[command(subcommand)]
        of: Option<AlignCommand>,
        #[command(flatten)]
        arguments: align::Arguments,
    },
    /// The effects of the library: class, parameters, equation, state, source.
    ///
    /// Example: hrg effects hysteresis play-ladder
    Effects(effects::Arguments),
    /// Identify by every method, and compare on runs that none of them saw.
    ///
    /// Example: hrg compare train.csv --verify verify.csv --out out/compare
    Compare(compare::Arguments),
    /// Write the tab completions for bash, zsh, fish, elvish or powershell to standard output.
    ///
    /// Example: hrg completions bash > ~/.local/share/bash-completion/completions/hrg
    Completions {
        /// Program that completes.
        #[arg(value_name = "FOR")]
        program: clap_complete::Shell,
    },
    /// Write a manual page for each command into a folder.
    ///
    /// Example: hrg man ~/.local/share/man/man1
    Man {
        /// The folder.
        folder: PathBuf,
    },
    // Former places of commands, for scripts that call them there.
    #[command(hide = true)]
    Merge(import::Arguments),
    #[command(hide = true)]
    Points(points::Arguments),
    #[command(hide = true)]
    Soaks(soaks::Arguments),
    #[command(hide = true)]
    Lag(lag::Arguments),
    #[command(hide = true)]
    Burn(chamber::BurnArguments),
    #[command(hide = true)]
    Image(chamber::ImageArguments),
    #[command(hide = true)]
    Keygen(chamber::KeygenArguments),
    #[command(hide = true)]
    Read(chamber::ReadArguments),
    #[command(hide = true)]
    Accelerometers(accelerometers::Arguments),
    #[command(hide = true)]
    Heading(heading::Arguments),
    #[command(hide = true)]
    SimulateAlignment(simulate_alignment::Arguments),
}

/// Other things to fit.
#[derive(Subcommand)]
enum FitCommand {
    /// Fit static points: frequency and temperature of soaks.
    ///
    /// Example: hrg fit points host-tests/recordings/dong2023-table1.csv --out points.json
    Points(points::Arguments),
    /// Take the soaks out of runs: a row of frequencies and temperatures for each, for hrg fit points.
    ///
    /// Example: hrg fit soaks run.csv --out table.csv
    Soaks(soaks::Arguments),
    /// Gain and time constant by which the resonators follow their surroundings, from a chamber step.
    ///
    /// Example: hrg fit lag step.csv --calibration cal.toml --out lag.json
    Lag(lag::Arguments),
}

/// Commands about the images of a unit.
#[derive(Subcommand)]
enum UnitCommand {
    /// Burn a calibration into a unit, read it back and see that the unit runs it.
    ///
    /// Example: hrg unit burn cal.toml --port /dev/ttyUSB0
    Burn(chamber::BurnArguments),
    /// Read the calibrations in a unit.
    ///
    /// Example: hrg unit read --port /dev/ttyUSB0 -o in-use.toml
    Read(chamber::ReadArguments),
    /// Print the last stop of a unit and its field log over power cuts: starts and their causes, stops, flags that rose, burns.
    ///
    /// Example: hrg unit events --port /dev/ttyUSB0 --elf firmware.elf
    Events(chamber::EventsArguments),
    /// Write the image of a calibration into a file, for a unit whose images come by the debug port.
    ///
    /// Example: hrg unit image cal.toml --unit HRG-7 --out image.bin
    Image(chamber::ImageArguments),
    /// Renew the constants of a unit at rest, whose latitude and axes are known, apart from its calibration.
    ///
    /// Example: hrg unit zero --port /dev/ttyUSB0 --latitude 48.1 --axes "x=north y=east z=down"
    Zero(chamber::ZeroArguments),
    /// Show or set what a unit sends: filter, frames a second, increments of angle and velocity, framing. It is stored in the unit.
    ///
    /// Example: hrg unit output --port /dev/ttyUSB0 --increments 5
    Output(output::Arguments),
    /// Have a unit test itself, and test its link: PASS or FAIL (exit status 0, 3).
    ///
    /// Example: hrg unit test --port /dev/ttyUSB0 --against run.csv
    Test(self_test::Arguments),
    /// Give a unit a new program over its link, with a way back; or ask which programs it holds.
    ///
    /// Example: hrg unit update hrg-0.1.0.prog --port /dev/ttyUSB0
    Update(program::UpdateArguments),
    /// Pack the firmware, linked for both slots, into a file for hrg unit update, and sign it.
    ///
    /// Example: hrg unit pack a.elf b.elf --key owner.key --out hrg-0.1.0.prog
    Pack(program::PackArguments),
    /// Make a key that signs calibrations and programs, for firmware built with the feature signed.
    ///
    /// Example: hrg unit keygen -o owner.key
    Keygen(chamber::KeygenArguments),
}

/// Commands beside an alignment.
#[derive(Subcommand)]
enum AlignCommand {
    /// Bias, scale and cross-axis of a platform's accelerometers, from tilts that are known.
    ///
    /// Example: hrg align accelerometers tilts.csv --latitude 45 --out accelerometers.json
    Accelerometers(accelerometers::Arguments),
    /// Find the two positions to align in: those whose drifts are nearly equal and repeat best.
    ///
    /// Example: hrg align heading day1.csv day2.csv day3.csv
    Heading(heading::Arguments),
    /// Simulate a platform to align, in two positions.
    ///
    /// Example: hrg align simulate --seed 3 --out a.csv
    Simulate(simulate_alignment::Arguments),
}

/// Exit status of a trace that does not say what `--fail-unless` asks for.
const NOT_REACHED: u8 = 3;

/// Commands by purpose, as the help lists them.
const GROUPS: [(&str, &[&str]); 7] = [
    ("Get data", &["import", "record", "monitor", "simulate", "anonymise"]),
    ("Judge", &["judge", "report", "fleet", "allan", "correct", "profile"]),
    ("Calibrate", &["calibrate", "fit", "trace", "family", "compare-images", "export"]),
    ("The unit", &["unit"]),
    ("Alignment", &["align"]),
    ("Study", &["effects", "compare"]),
    ("This program", &["completions", "man"]),
];

/// Help is no wider than this.
const MOST_COLUMNS: usize = 100;

/// A text in lines of at most `columns` characters, parted between words.
fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= columns => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_string()),
        }
    }
    lines
}

/// The program with its commands grouped in its help.
fn program() -> clap::Command {
    let command = Arguments::command();
    let width = GROUPS.iter().flat_map(|(_, names)| names.iter()).map(|n| n.len()).max().unwrap_or(0);
    let mut listed = String::new();
    let head = Style::new().bold().underline();
    let name_style = Style::new().bold();
    let columns = terminal_size::terminal_size().map_or(MOST_COLUMNS, |(w, _)| usize::from(w.0)).min(MOST_COLUMNS);
    for (group, names) in GROUPS {
        listed += &format!("\n{head}{group}:{head:#}\n");
        for name in names {
            let about = command.find_subcommand(name).and_then(|c| c.get_about()).map(ToString::to_string);
            let lines = wrapped(&about.unwrap_or_default(), columns.saturating_sub(width + 4).max(20));
            let indent = format!("\n{}", " ".repeat(width + 4));
            listed += &format!("  {name_style}{name:<width$}{name_style:#}  {}\n", lines.join(&indent));
        }
    }
    let template = format!("{{about}}\n\n{{usage-heading}} {{usage}}\n{listed}\n{head}Options:{head:#}\n{{options}}");
    command.help_template(template)
}

fn main() -> ExitCode {
    let arguments = program()
        .try_get_matches()
        .and_then(|m| Arguments::from_arg_matches(&m))
        .unwrap_or_else(|e| with_example(e).exit());
    let mut status = ExitCode::SUCCESS;
    let done = run(arguments.command, &mut status);
    let failed = done.is_err();
    let code = hrg_data::error::exit("hrg", done, |e| {
        e.is::<FileError>() || e.is::<TableError>() || e.is::<MethodError>() || e.is::<ReadError>()
    });
    if failed {
        code
    } else {
        status
    }
}

/// Wrong arguments of a command: with the example that its help has.
fn with_example(mut e: clap::Error) -> clap::Error {
    let arguments = Arguments::command();
    let mut words = std::env::args().skip(1);
    let command = words.next().and_then(|name| arguments.find_subcommand(name).cloned());
    let mut nested = |c: &clap::Command| words.next().and_then(|name| c.find_subcommand(name).cloned());
    let command = command.map(|c| nested(&c).unwrap_or(c));
    let help = command.and_then(|c| c.get_long_about().map(ToString::to_string)).unwrap_or_default();
    if let Some(example) = help.lines().find_map(|line| line.strip_prefix("Example: ")).filter(|_| e.use_stderr()) {
        let tip = clap::builder::StyledStr::from(format!("for example: {example}"));
        e.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip]));
    }
    e
}

/// Runs a command; `status`: the exit status of an answer, where the command has one.
fn run(command: Command, status: &mut ExitCode) -> Result<()> {
    match command {
        Command::Import(arguments) | Command::Merge(arguments) => import::run(&arguments),
        Command::Record { port, defmt, elf, facts, seconds, out } => match (port, defmt) {
            (Some(port), _) => chamber::record_port(&port, &out, seconds, &facts),
            (None, Some(log)) => log::record(&log, elf.as_deref(), &out, &facts),
            (None, None) => Err(BadInput::new("give --port or --defmt").into()),
        },
        Command::Monitor(arguments) => match &arguments.defmt {
            Some(log) => log::monitor(log, arguments.elf.as_deref(), arguments.state()?, arguments.snapshot),
            None => chamber::monitor(&arguments),
        },
        Command::Simulate(arguments) => simulate::run(arguments),
        Command::Calibrate(arguments) => reached(calibrate::run(&arguments), status),
        Command::Judge(arguments) => {
            *status = ExitCode::from(judge::run(&arguments)?.exit_status());
            Ok(())
        }
        Command::Report(arguments) => report::run(arguments),
        Command::Export(arguments) => export::run(arguments),
        Command::Anonymise(arguments) => anonymise::run(&arguments),
        Command::Allan(arguments) => allan::run(arguments),
        Command::Correct(arguments) => correct::run(&arguments),
        Command::Profile(arguments) => profile::run(arguments),
        Command::Fit { of: Some(FitCommand::Points(arguments)), .. } | Command::Points(arguments) => {
            points::run(arguments)
        }
        Command::Fit { of: Some(FitCommand::Soaks(arguments)), .. } | Command::Soaks(arguments) => {
            soaks::run(&arguments)
        }
        Command::Fit { of: Some(FitCommand::Lag(arguments)), .. } | Command::Lag(arguments) => lag::run(&arguments),
        Command::Fit { of: None, arguments } => fit::run(arguments),
        Command::Family(arguments) => family::run(&arguments),
        Command::Fleet(arguments) => fleet::run(&arguments),
        Command::Trace(arguments) => reached(trace::run(arguments), status),
        Command::Compare(arguments) => compare::run(arguments),
        Command::CompareImages(arguments) => images::run(&arguments),
        Command::Unit(UnitCommand::Burn(arguments)) | Command::Burn(arguments) => chamber::burn(&arguments),
        Command::Unit(UnitCommand::Image(arguments)) | Command::Image(arguments) => chamber::image(&arguments),
        Command::Unit(UnitCommand::Events(arguments)) => chamber::events(&arguments),
        Command::Unit(UnitCommand::Zero(arguments)) => chamber::renew(&arguments),
        Command::Unit(UnitCommand::Output(arguments)) => output::run(&arguments),
        Command::Unit(UnitCommand::Update(arguments)) => program::update(&arguments),
        Command::Unit(UnitCommand::Pack(arguments)) => program::pack(&arguments),
        Command::Unit(UnitCommand::Test(arguments)) => {
            if !self_test::run(&arguments)? {
                *status = ExitCode::from(NOT_REACHED);
            }
            Ok(())
        }
        Command::Unit(UnitCommand::Keygen(arguments)) | Command::Keygen(arguments) => chamber::keygen(&arguments.out),
        Command::Unit(UnitCommand::Read(arguments)) | Command::Read(arguments) => chamber::read(&arguments),
        Command::Align { of: Some(AlignCommand::Accelerometers(arguments)), .. }
        | Command::Accelerometers(arguments) => accelerometers::run(&arguments),
        Command::Align { of: Some(AlignCommand::Heading(arguments)), .. } | Command::Heading(arguments) => {
            heading::run(&arguments)
        }
        Command::Align { of: Some(AlignCommand::Simulate(arguments)), .. } | Command::SimulateAlignment(arguments) => {
            simulate_alignment::run(arguments)
        }
        Command::Align { of: None, arguments } => align::run(&arguments),
        Command::Effects(arguments) => effects::run(&arguments),
        Command::Completions { program } => {
            let mut text = Vec::new();
            clap_complete::generate(program, &mut Arguments::command(), "hrg", &mut text);
            print!("{}", String::from_utf8_lossy(&text));
            Ok(())
        }
        Command::Man { folder } => {
            std::fs::create_dir_all(&folder)
                .and_then(|()| clap_mangen::generate_to(Arguments::command(), &folder))
                .map_err(|e| BadInput(format!("{}: {e}", folder.display())))?;
            println!("{}: a page for each command, as man -l {}", folder.display(), folder.join("hrg.1").display());
            Ok(())
        }
    }
}

/// The exit status of a command that may end without what it was to reach.
fn reached(done: Result<bool>, status: &mut ExitCode) -> Result<()> {
    if !done? {
        *status = ExitCode::from(NOT_REACHED);
    }
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_help_lists_every_command_once() {
        let grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        let command = Arguments::command();
        let visible: Vec<&str> =
            command.get_subcommands().filter(|c| !c.is_hide_set()).map(clap::Command::get_name).collect();
        assert_eq!(grouped.len(), visible.len(), "{visible:?}");
        assert!(visible.iter().all(|v| grouped.contains(v)), "{visible:?}");
        program().debug_assert();
        assert_eq!(wrapped("a bb ccc dddd", 6), ["a bb", "ccc", "dddd"]);
    }
}
