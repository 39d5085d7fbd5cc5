//! `hrg`: recordings of HRG chamber runs in, coefficients and reports out.

mod chamber;
mod correct;
mod facts;
mod import;
mod merge;

use anyhow::Result;
use clap::{Parser, Subcommand};
use facts::{FactsArguments, Place};
use hrg_cal::align::plant::Plant;
use hrg_cal::align::FilterKind;
use hrg_cal::compare::{self, Contender};
use hrg_cal::fit::evidence;
use hrg_cal::fit::independence::Units;
use hrg_cal::fit::method::Method;
use hrg_cal::fit::methods;
use hrg_cal::image_file;
use hrg_cal::numeric::allan;
use hrg_cal::numeric::stats::{block_means, std_dev};
use hrg_cal::recording::steps::{Run, Steps};
use hrg_cal::recording::Recording;
use hrg_cal::simulate::{EffectSpec, Kind, Leg, Noise, Plan, Profile, ATTITUDE, PROFILES};
use hrg_cal::thermometer::lag;
use hrg_cal::thermometer::points;
use hrg_cal::trace::cards::parted;
use hrg_cal::trace::separable;
use hrg_cal::{align, fit, load_recording, trace, BadInput, AXIS_NAMES};
use hrg_core::effects::EffectId;
use std::path::{Path, PathBuf};
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
    Simulate {
        /// A named profile (dong, cycle, verify, stairs, ramps, fast, zhao, up, wu, lag) or one like 20,-40@1,2h,50@1,2h
        #[arg(long, default_value = "dong")]
        profile: String,
        /// Effect to put in: NAME[:key=value,...], or secret:SEED. Several may be given.
        #[arg(long)]
        effect: Vec<String>,
        /// Seed of this run's noise: another seed is another run of the same unit.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Which unit: its bias coefficients and how it feels an effect.
        #[arg(long, default_value_t = 1)]
        unit: u64,
        /// Kind of unit: hrg (like dong2023's), fog (like wu2023's) or zhao (like zhao2022's)
        #[arg(long, default_value = "hrg")]
        kind: String,
        /// White noise: standard deviation of 100 s means, deg/h; by default that of the kind
        #[arg(long)]
        noise: Option<f64>,
        /// Put spikes, gaps, missing, stuck values and repeated times in.
        #[arg(long)]
        dirty: bool,
        /// How the unit stands; by default at 28.2 degrees north, x=north y=east z=down.
        #[command(flatten)]
        place: Place,
        /// Leave latitude and axes out of the file: a fit then finds the earth's rate in the constants.
        #[arg(long)]
        no_attitude: bool,
        /// Where the recording goes.
        #[arg(long)]
        out: PathBuf,
    },
    /// Fit static points: frequency and temperature of soaks.
    ///
    /// Example: hrg points host-tests/recordings/dong2023-table1.csv --out points.json
    Points {
        /// The table.
        table: PathBuf,
        /// Where the report goes.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Identify the coefficients of a bias model.
    ///
    /// Example: hrg fit run.csv --method lsq --out cal.toml
    Fit {
        /// Recordings of one unit.
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
        /// How: see docs/methods.md
        #[arg(long, default_value = "lsq")]
        method: Method,
        /// Seed of swarms and genetic searches: the same seed gives the same block.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Weigh every degree alike instead of every second.
        #[arg(long)]
        uniform: bool,
        /// Allow recordings of different units.
        #[arg(long)]
        different_units: bool,
        #[command(flatten)]
        facts: FactsArguments,
        /// Where the calibration goes: text, or the binary block if it ends in .bin
        #[arg(long)]
        out: PathBuf,
    },
    /// Identify by every method, and compare on runs that none of them saw.
    ///
    /// Example: hrg compare train.csv --verify verify.csv --out out/compare
    Compare {
        /// Recordings to learn from.
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
        /// Recording that is only evaluated. Several may be given.
        #[arg(long, required = true)]
        verify: Vec<PathBuf>,
        /// Methods, separated by commas; by default all, and trace.
        #[arg(long, value_delimiter = ',')]
        methods: Vec<String>,
        /// Seed of swarms and genetic searches.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Folder for the blocks, the table (JSON and Markdown) and the pictures.
        #[arg(long, default_value = "out/compare")]
        out: PathBuf,
        /// hrg-board, which weighs the blocks on the virtual board; by default the one beside this program.
        #[arg(long)]
        board: Option<PathBuf>,
        /// Allow recordings of different units.
        #[arg(long)]
        different_units: bool,
    },
    /// How the resonators follow their surroundings: gain and time constant from a chamber step.
    ///
    /// Example: hrg lag step.csv --calibration cal.toml --out lag.json
    Lag {
        /// Recording with a step of the chamber's temperature.
        recording: PathBuf,
        /// Calibration whose frequency-temperature laws are used; without it they are fitted to this recording.
        #[arg(long)]
        calibration: Option<PathBuf>,
        /// What drives the lag: case or chamber (shell: an old name of case)
        #[arg(long, default_value = "case", value_parser = ["case", "shell", "chamber"])]
        input: String,
        /// Predict the resonator temperatures of this recording where its frequencies are missing.
        #[arg(long)]
        predict: Option<PathBuf>,
        /// Where the report (JSON), or the prediction (CSV), goes.
        #[arg(long)]
        out: Option<PathBuf>,
    },
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
    Profile {
        /// Effects to be told apart, separated by commas; by default those that a unit can compensate.
        #[arg(long = "for", value_delimiter = ',')]
        wanted: Vec<String>,
        /// Judge this recording instead of the named profiles. Several are judged together.
        #[arg(long)]
        check: Vec<PathBuf>,
        /// Judge this profile, written out like 20,-40@1,2h,50@1,2h
        #[arg(long)]
        profile: Option<String>,
    },
    /// Allan deviation of the rates, with confidence bars, and what is read off it.
    ///
    /// Example: hrg allan run.csv --out allan.svg
    Allan {
        /// Recording; best one at rest and at one temperature.
        recording: PathBuf,
        /// Where the picture (SVG) goes.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Where the curves (JSON) go.
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Watch a unit: temperatures, rates, biases, status, link, soak, remaining time.
    ///
    /// Example: hrg monitor --port /dev/ttyUSB0 --profile cycle
    Monitor(chamber::MonitorArguments),
    /// Burn a calibration into a unit, read it back and see that the unit runs it.
    ///
    /// Example: hrg burn cal.toml --port /dev/ttyUSB0
    Burn(chamber::BurnArguments),
    /// Read the calibrations in a unit.
    ///
    /// Example: hrg read --port /dev/ttyUSB0 --out in-use.toml
    Read {
        /// Serial port of the link.
        #[arg(long)]
        port: String,
        /// Where the block in use goes.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Self-alignment: azimuth, tilts and drifts from the velocities of a platform at rest in two positions.
    ///
    /// Example: hrg align --recording a.csv --filter linear --out report.json
    Align {
        /// Recording: time_s,position,v1_mps,v2_mps
        #[arg(long)]
        recording: PathBuf,
        /// Filter.
        #[arg(long, default_value = "linear")]
        filter: FilterKind,
        /// First azimuth of the EKF, degrees.
        #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
        first_azimuth: f64,
        /// Seed of the literal particle filter.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Where the report (JSON) goes.
        #[arg(long)]
        out: PathBuf,
    },
    /// Simulate a platform to align, in two positions.
    ///
    /// Example: hrg simulate-alignment --seed 3 --out a.csv
    SimulateAlignment {
        /// Seed: 0 is chen2015's case, any other a platform of its own.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// Error of the turn, arc minutes.
        #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
        turn_error: f64,
        /// Stay in position 1.
        #[arg(long)]
        one_position: bool,
        /// Where the recording goes.
        #[arg(long)]
        out: PathBuf,
    },
    /// Find what the baseline model lacks, add it, and measure before and after on a run it never saw.
    ///
    /// Example: hrg trace --train a.csv --verify b.csv --out report.json --html report.html --calibration cal.toml
    Trace {
        /// Recording to learn from. Several may be given.
        #[arg(long, required = true)]
        train: Vec<PathBuf>,
        /// Recording that is only evaluated.
        #[arg(long, required_unless_present = "split")]
        verify: Option<PathBuf>,
        /// Instead of a verify run: learn from the one train recording before this time, evaluate on the rest, with lags and
        /// hysteresis carried on from its beginning.
        #[arg(long, value_name = "SECONDS", conflicts_with = "verify")]
        split: Option<f64>,
        /// Where the report (JSON) goes.
        #[arg(long)]
        out: PathBuf,
        /// Where the report as a page goes.
        #[arg(long)]
        html: Option<PathBuf>,
        /// Where the calibration image goes: the extended one where the verify run bears it out, else the baseline; nothing is
        /// written where neither beats the raw rates.
        #[arg(long)]
        calibration: Option<PathBuf>,
        /// The image that the unit has in use: the new one must beat it before it is recommended.
        #[arg(long)]
        in_use: Option<PathBuf>,
        /// Allow recordings of different units.
        #[arg(long)]
        different_units: bool,
        #[command(flatten)]
        facts: FactsArguments,
    },
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
    Report {
        /// Recordings of one unit, each one power-on.
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
        /// Where the figures (JSON) go.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Where the figures as a page, with pictures, go.
        #[arg(long)]
        html: Option<PathBuf>,
        #[command(flatten)]
        facts: FactsArguments,
    },
    /// Close the loop on the measured recordings that come with the project: every method and the trace, before and after.
    ///
    /// Example: hrg measured
    Measured {
        /// Folder of the recordings.
        #[arg(default_value = "host-tests/recordings/measured")]
        folder: PathBuf,
    },
    /// Correct a recording as the unit does, on the desktop: row for row what it would send.
    ///
    /// Example: hrg correct run.csv --calibration cal.toml --out corrected.csv
    Correct(correct::Arguments),
}

/// Train runs and the verify run, perhaps parts of one.
fn runs_of_trace(
    train: &[PathBuf],
    verify: Option<PathBuf>,
    split: Option<f64>,
    facts: &FactsArguments,
) -> Result<(Vec<Recording>, Recording)> {
    let mut train = facts.load(train)?;
    if let Some(verify) = verify {
        return Ok((train, facts.load(&[verify])?.remove(0)));
    }
    match (train.pop(), train.is_empty(), split) {
        (Some(whole), true, Some(at_s)) => {
            let (before, after) = whole.split(at_s)?;
            Ok((vec![before], after))
        }
        _ => Err(BadInput::new("--split parts one recording: give one --train").into()),
    }
}

fn units(different: bool) -> Units {
    if different {
        Units::Different
    } else {
        Units::Same
    }
}

fn main() -> ExitCode {
    hrg_cal::exit("hrg", run(Arguments::parse().command))
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Simulate { profile, effect, seed, unit, kind, noise, dirty, place, no_attitude, out } => {
            let kind = Kind::parse(&kind)?;
            let usual = kind.noise();
            let effects = effect
                .iter()
                .map(|e| match e.strip_prefix("secret:") {
                    Some(s) => s
                        .parse()
                        .map(EffectSpec::secret)
                        .map_err(|_| BadInput::new(format!("\"{e}\": secret: takes a whole number as seed"))),
                    None => EffectSpec::parse(e),
                })
                .collect::<Result<Vec<_>, _>>()?;
            let noise = Noise { white_100s_dph: noise.unwrap_or(usual.white_100s_dph), ..usual };
            let attitude = place.attitude()?.unwrap_or(ATTITUDE);
            let plan = Plan { kind, effects, noise, attitude, ..Plan::of(Profile::parse(&profile)?, unit, seed) };
            let mut simulated = plan.simulate();
            if dirty {
                hrg_cal::simulate::soil(&mut simulated.recording, seed);
            }
            if no_attitude {
                simulated.recording.restore_earth_rate();
                simulated.recording.meta.retain(|(k, _)| k != "latitude_deg" && k != "axes");
            }
            hrg_cal::write_file(&out, simulated.recording.to_csv().as_bytes())?;
            println!(
                "{}: {} rows, simulated (unit SIM-{}, seed {seed})",
                out.display(),
                simulated.recording.time_s.len(),
                plan.unit_seed
            );
            Ok(())
        }
        Command::Points { table, out } => {
            let bytes = hrg_cal::read_file(&table, hrg_cal::MOST_RECORDING, true)?;
            let p = points::Points::parse(&String::from_utf8_lossy(&bytes))
                .map_err(|e| BadInput::new(format!("{}: {e}", table.display())))?;
            let report = points::report(&p)?;
            print_points(&report);
            if let Some(out) = out {
                hrg_cal::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
            }
            Ok(())
        }
        Command::Trace { train, verify, split, out, html, calibration, in_use, different_units, facts } => {
            let (train, verify) = runs_of_trace(&train, verify, split, &facts)?;
            let in_use = in_use.map(|p| image_file::load(&p)).transpose()?;
            if let Some(c) = &in_use {
                hrg_cal::recording::facts::fits(c, &verify, different_units).map_err(BadInput::from)?;
            }
            let options = trace::Options { units: units(different_units), in_use };
            let mut t = trace::trace_with(&train, &verify, &options)?;
            hrg_cal::write_file(&out, serde_json::to_string_pretty(&t.report)?.as_bytes())?;
            if let Some(path) = html {
                hrg_cal::write_file(&path, trace::html(&t)?.as_bytes())?;
            }
            print_trace(&t.report);
            match calibration {
                Some(path) if t.report.image == trace::Image::None => {
                    println!("{}: not written, no image beats the raw rates", path.display());
                }
                Some(path) => {
                    t.image.created_unix_s = now();
                    image_file::save(&path, &t.image)?;
                    let kind = if t.report.image == trace::Image::Extended { "extended" } else { "baseline" };
                    println!("{}: the {kind} image", path.display());
                }
                None => {}
            }
            Ok(())
        }
        Command::Fit { recordings, method, seed, uniform, different_units, facts, out } => {
            let recordings = facts.load(&recordings)?;
            let prepared = fit::prepare_for(&recordings, units(different_units))?;
            let mut found = methods::identify_weighted(&prepared, method, seed, uniform)?;
            found.calibration.created_unix_s = now();
            found.calibration.sequence = 1;
            // Three sigma of 100 s means over all runs together.
            let of = |series: Vec<[Vec<f64>; 3]>| {
                [0, 1, 2].map(|a: usize| {
                    let means: Vec<f64> = series.iter().flat_map(|s| block_means(&s[a], fit::MEAN_S)).collect();
                    std_dev(&means)
                })
            };
            let raw = of(prepared.runs.iter().map(|r| r.steps.rate_dph.clone()).collect());
            let fitted = of(prepared.runs.iter().map(|r| fit::correct(&found.calibration, &r.steps)).collect());
            let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
            for &a in &present {
                found.calibration.axes[a].train_rms_dph = fitted[a] as f32;
            }
            image_file::save(&out, &found.calibration)?;
            println!("{:<5} {:>22} {:>22} {:>8}", "axis", "raw, 3 sigma [deg/h]", "fitted, 3 sigma", "means");
            for a in present {
                let means: usize = prepared.runs.iter().map(|r| evidence::means(r, a).0).sum();
                println!("{:<5} {:>22.4} {:>22.4} {means:>8}", AXIS_NAMES[a], 3.0 * raw[a], 3.0 * fitted[a]);
            }
            println!("three sigma of 100 s means, on the data of the fit, as the unit corrects them");
            for n in found.notes.iter().chain(&prepared.notes) {
                println!("note: {n}");
            }
            println!("{}: {method}, block {:08x}", out.display(), found.calibration.checksum());
            Ok(())
        }
        Command::Compare { recordings, verify, methods, seed, out, board, different_units } => {
            compare_methods(&recordings, &verify, &methods, seed, units(different_units), &out, board)
        }
        Command::Record { port, defmt, elf, facts, seconds, out } => match (port, defmt) {
            (Some(port), _) => chamber::record_port(&port, &out, seconds, &facts),
            (None, Some(log)) => chamber::record_log(&log, elf.as_deref(), &out, &facts),
            (None, None) => Err(BadInput::new("give --port or --defmt").into()),
        },
        Command::Profile { wanted, check, profile } => chamber_profile(&wanted, &check, profile.as_deref()),
        Command::Allan { recording, out, json } => {
            let r = load_recording(&recording)?;
            // Rates on an even grid of the recording's own step.
            let (rates, step_s) = r.even_rates();
            let rates: Vec<(usize, &[f64])> = r.present().map(|a| (a, rates[a].as_slice())).collect();
            let axes =
                allan::report(&rates, step_s).map_err(|e| BadInput::new(format!("{}: {e}", recording.display())))?;
            println!(
                "{:<5} {:>24} {:>22} {:>12} {:>26}",
                "axis", "angle random walk", "bias instability", "at", "rate random walk"
            );
            println!("{:<5} {:>24} {:>22} {:>12} {:>26}", "", "deg/sqrt(h)", "deg/h", "s", "deg/h/sqrt(h)");
            for a in &axes {
                let (n, r) = (a.axis, &a.readings);
                let show = |v: Option<f64>| v.map_or("does not show".to_string(), |v| format!("{v:.5}"));
                let least = if r.bias_instability_reached { "" } else { "under " };
                println!(
                    "{n:<5} {:>24} {:>22} {:>12} {:>26}",
                    show(r.angle_random_walk_deg_per_root_h),
                    format!("{least}{}", show(r.bias_instability_dph)),
                    r.bias_instability_at_s.map_or(String::new(), |t| format!("{t:.0}")),
                    show(r.rate_random_walk_dph_per_root_h)
                );
            }
            if let Some(missing) = axes.iter().map(|a| a.missing).max().filter(|m| *m > 0) {
                println!("up to {missing} missing values an axis, bridged with the mean");
            }
            if let Some(out) = out {
                let title =
                    format!("{}, {}: overlapping Allan deviation, bars of one sigma", r.unit(), recording.display());
                hrg_cal::write_file(&out, allan::picture(&axes, &title)?.as_bytes())?;
            }
            if let Some(json) = json {
                hrg_cal::write_file(&json, serde_json::to_string_pretty(&axes)?.as_bytes())?;
            }
            Ok(())
        }
        Command::Monitor(arguments) => chamber::monitor(&arguments),
        Command::Merge(arguments) => merge::run(&arguments),
        Command::Report { recordings, json, html, facts } => {
            let report = hrg_cal::report::report(&facts.load(&recordings)?)?;
            print!("{}", hrg_cal::report::text(&report));
            if let Some(path) = json {
                hrg_cal::write_file(&path, serde_json::to_string_pretty(&report)?.as_bytes())?;
            }
            if let Some(path) = html {
                hrg_cal::write_file(&path, hrg_cal::report::html(&report)?.as_bytes())?;
            }
            Ok(())
        }
        Command::Measured { folder } => {
            println!("{}", hrg_cal::measured::imu(&folder)?);
            println!("{}", hrg_cal::measured::gpsdo(&folder)?);
            print!("{}", hrg_cal::measured::uberclock(&folder)?);
            Ok(())
        }
        Command::Import(arguments) => import::run(&arguments),
        Command::Correct(arguments) => correct::run(&arguments),
        Command::Burn(arguments) => chamber::burn(&arguments),
        Command::Read { port, out } => chamber::read(&port, out.as_deref()),
        Command::Align { recording, filter, first_azimuth, seed, out } => {
            let r = align::Recording::load(&recording)?;
            let start = align::Start { azimuth_deg: first_azimuth, seed, ..align::Start::default() };
            let report =
                align::align(&r, filter, start).map_err(|e| BadInput::new(format!("{}: {e}", recording.display())))?;
            hrg_cal::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
            println!("azimuth  {:>9.4} deg    +- {:.2}'", report.azimuth_deg, report.azimuth_std_arcmin);
            let [t1, t2] = report.tilt_std_arcmin;
            println!("tilts    {:>9.3}' {:>9.3}'   +- {t1:.3}' {t2:.3}'", report.tilt1_arcmin, report.tilt2_arcmin);
            let [d1, d2] = report.drift_std_dph;
            println!("drifts   {:>9.4} {:>9.4} deg/h   +- {d1:.4} {d2:.4}", report.drift1_dph, report.drift2_dph);
            match report.converged_at_s {
                Some(t) => println!("known to 15' (two sigma) since {t:.0} s"),
                None => println!("not known to 15' (two sigma)"),
            }
            if let Some(i) = report.integrity {
                println!("the two positions agree: chi-square {i:.2} (limit 10.8)");
            }
            Ok(())
        }
        Command::SimulateAlignment { seed, turn_error, one_position, out } => {
            let mut plant = if seed == 0 { Plant::chen(0) } else { Plant::drawn(seed) };
            plant.turn_error = turn_error / 60.0 / 180.0 * std::f64::consts::PI;
            if one_position {
                plant.seconds[2] = 0;
            }
            let (r, _) = plant.play();
            hrg_cal::write_file(&out, r.to_csv().as_bytes())?;
            println!("{}: {} rows, simulated", out.display(), r.rows.len());
            Ok(())
        }
        Command::Lag { recording, calibration, input, predict, out } => {
            let input = if input == "chamber" { lag::Input::Chamber } else { lag::Input::Case };
            thermal_lag(&recording, calibration.as_deref(), input, predict.as_deref(), out.as_deref())
        }
    }
}

fn compare_methods(
    recordings: &[PathBuf],
    verify: &[PathBuf],
    methods: &[String],
    seed: u64,
    units: Units,
    out: &Path,
    board: Option<PathBuf>,
) -> Result<()> {
    let contenders = if methods.is_empty() {
        Contender::all()
    } else {
        methods.iter().map(|m| Contender::by_name(m)).collect::<Result<_, _>>()?
    };
    std::fs::create_dir_all(out).map_err(|e| BadInput::new(format!("cannot make {}: {e}", out.display())))?;
    let train = recordings.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
    let unseen = verify.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
    let bar = indicatif::ProgressBar::new_spinner();
    let mut c = compare::compare(&train, &unseen, &contenders, seed, units, out, |m| {
        bar.set_message(format!("identifying by {m}"));
        bar.tick();
    })?;
    let beside = std::env::current_exe()
        .ok()
        .and_then(|p| p.parent().map(|d| d.join("hrg-board")))
        .filter(|p| board.is_none() && p.is_file());
    match board.or(beside) {
        Some(_) if hrg_cal::recording::format::require_resonators(&unseen[0]).is_err() => eprintln!(
            "the firmware reads three resonators and this recording has none: what the blocks cost on the unit is not weighed"
        ),
        Some(board) => {
            bar.set_message("weighing the blocks on the virtual board");
            bar.tick();
            compare::weigh(&mut c, &board, out, &verify[0], 120)?;
        }
        None => eprintln!(
            "hrg-board is not beside this program: what the blocks cost on the unit is not weighed (--board PATH)"
        ),
    }
    bar.finish_and_clear();
    hrg_cal::write_file(&out.join("compare.json"), serde_json::to_string_pretty(&c)?.as_bytes())?;
    hrg_cal::write_file(&out.join("compare.md"), compare::table(&c, true, None).as_bytes())?;
    hrg_cal::write_file(&out.join("compare.svg"), compare::picture(&c)?.as_bytes())?;
    hrg_cal::write_file(&out.join("residuals.svg"), compare::residuals(&c, &unseen[0], out)?.as_bytes())?;
    print!("{}", compare::table(&c, false, None));
    println!("3s: three sigma of 100 s means; instability: least Allan deviation / 0.664; deg/h, RMS of the axes");
    println!("instructions on the unit: f to bias, of one axis' temperature law and bias model; update, of all three axes with");
    println!(
        "slopes, states and checks; ELF differs: frames of two minutes that are not those of hrg-core on this machine"
    );
    for r in &c.rows {
        println!("{}: {}", r.method, r.notes.join("; "));
    }
    for l in &c.left_out {
        println!("left out, {l}");
    }
    println!("{}: blocks, compare.json, compare.md, compare.svg, residuals.svg", out.display());
    Ok(())
}

fn chamber_profile(wanted: &[String], check: &[PathBuf], profile: Option<&str>) -> Result<()> {
    let known = parted();
    let one = |w: &String| {
        EffectId::by_name(w).filter(|e| known.contains(e)).ok_or_else(|| {
            let names: Vec<&str> = known.iter().map(|e| e.name()).collect();
            BadInput::new(format!("effect \"{w}\" is not one that a profile parts; there are {}", names.join(", ")))
        })
    };
    let wanted: Vec<EffectId> =
        if wanted.is_empty() { known.clone() } else { wanted.iter().map(one).collect::<Result<_, _>>()? };
    let say = |verdicts: &[separable::Verdict]| {
        println!("{:<20} {:>22}   taken for", "effect", "left by the baseline");
        for v in verdicts {
            let taken: Vec<String> = v.taken_for.iter().map(|(n, s)| format!("{n} ({:.1} %)", 100.0 * s)).collect();
            let note = match (v.left_by_baseline < separable::SEEN, taken.is_empty()) {
                (true, _) => "hidden in the baseline: not seen, and no harm".to_string(),
                (false, true) => "-".to_string(),
                (false, false) => taken.join(", "),
            };
            println!("{:<20} {:>20.1} %   {note}", v.name, 100.0 * v.left_by_baseline);
        }
    };
    if !check.is_empty() {
        let recordings = check.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
        let verdicts = separable::judge(&recordings, &wanted)?;
        say(&verdicts);
        let rest = separable::not_told(&verdicts);
        if rest.is_empty() {
            println!("this data tells all of them apart, from two noise floors up");
        } else {
            println!("not told apart here: {}; hrg profile shows which runs would", rest.join("; "));
        }
        return Ok(());
    }
    let judge = |p: &Profile| -> Result<Vec<separable::Verdict>> {
        let recording = Plan::of(p.clone(), 1, 1).simulate().recording;
        Ok(separable::judge(&[recording], &wanted)?)
    };
    if let Some(text) = profile {
        let p = Profile::parse(text)?;
        say(&judge(&p)?);
        println!("{}", in_words(&p));
        return Ok(());
    }
    println!("{:<8} {:>6}   not told apart, from two noise floors up", "profile", "hours");
    let mut best: Option<(usize, f64, &str, Profile)> = None;
    for (name, text) in PROFILES {
        let p = Profile::parse(text)?;
        let hours = p.temperatures().len() as f64 / 3600.0;
        let rest = match judge(&p) {
            Ok(v) => separable::not_told(&v),
            Err(e) => {
                println!("{name:<8} {hours:>6.1}   cannot be used: {e}");
                continue;
            }
        };
        println!("{name:<8} {hours:>6.1}   {}", if rest.is_empty() { "-".into() } else { rest.join("; ") });
        // The baseline itself wants both directions over a wide range.
        let t = p.temperatures();
        let (low, high) = t.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let both = t.windows(2).any(|w| w[1] < w[0]) && t.windows(2).any(|w| w[1] > w[0]);
        if high - low >= 60.0 && both && best.as_ref().is_none_or(|b| (rest.len(), hours) < (b.0, b.1)) {
            best = Some((rest.len(), hours, name, p));
        }
    }
    if let Some((_, _, name, p)) = best {
        println!("\nbest of those that go both ways over 60 C and more: {name}. {}", in_words(&p));
    }
    Ok(())
}

/// A profile as a test engineer sets it.
fn in_words(p: &Profile) -> String {
    let mut t = p.start_c;
    let mut parts = vec![format!("Begin at {t} C, power on")];
    for leg in &p.legs {
        parts.push(match leg {
            Leg::Ramp(to, rate) => {
                let text = format!("ramp to {to} C at {rate} C/min ({:.0} min)", (to - t).abs() / rate);
                t = *to;
                text
            }
            Leg::Soak(s) => format!("soak {:.0} min", s / 60.0),
        });
    }
    format!("{}; {:.1} h in all", parts.join(", "), p.temperatures().len() as f64 / 3600.0)
}

fn thermal_lag(
    path: &Path,
    calibration: Option<&Path>,
    input: lag::Input,
    predict: Option<&Path>,
    out: Option<&Path>,
) -> Result<()> {
    let recording = load_recording(path)?;
    let laws = match calibration {
        Some(p) => image_file::load(p)?.axes.map(|a| a.law),
        None => fit::prepare(std::slice::from_ref(&recording))?.calibration.axes.map(|a| a.law),
    };
    let run = Run::new(Steps::new(&recording)?, laws);
    let responses = lag::identify(&run, input)?;
    println!(
        "{:<5} {:>8} {:>9} {:>16} {:>12}   two lags in series",
        "axis", "gain", "+-", "time constant s", "residual C"
    );
    for (name, r) in AXIS_NAMES.iter().zip(&responses) {
        let f = &r.first_order;
        let second = r.second_order.as_ref().map_or("not needed".to_string(), |s| {
            format!("{:.0} s and {:.0} s leave {:.3} C", s.tau_s[0], s.tau_s[1], s.residual_c)
        });
        println!(
            "{name:<5} {:>8.4} {:>9.4} {:>16.1} {:>12.3}   {second}",
            f.gain, f.gain_std, f.tau_s[0], f.residual_c
        );
    }
    let Some(predict) = predict else {
        if let Some(out) = out {
            hrg_cal::write_file(out, serde_json::to_string_pretty(&responses)?.as_bytes())?;
        }
        return Ok(());
    };
    let other = load_recording(predict)?;
    let run = Run::new(Steps::new(&other)?, laws);
    let mut columns = Vec::new();
    for (a, r) in responses.iter().enumerate() {
        let u = lag::input_of(&run, a, input)
            .ok_or_else(|| BadInput::new(format!("{}: the {input:?} temperature is missing", predict.display())))?;
        let truth = lag::resonator(&run, a);
        let model = r.second_order.as_ref().unwrap_or(&r.first_order);
        let predicted = model.predict(&u, truth.first().copied().filter(|t| t.is_finite()));
        let errors: Vec<f64> = predicted.iter().zip(&truth).map(|(p, t)| p - t).filter(|e| e.is_finite()).collect();
        if !errors.is_empty() {
            let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let worst = errors.iter().fold(0.0f64, |m, e| m.max(e.abs()));
            println!(
                "{}: predicted over {} s; where the frequency is known the prediction is off by {rms:.2} C RMS, {worst:.2} C at most",
                AXIS_NAMES[a],
                predicted.len(),
            );
        }
        columns.push((predicted, truth));
    }
    if let Some(out) = out {
        let mut csv = String::from("time_s");
        for n in AXIS_NAMES {
            csv.push_str(&format!(",predicted_{n}_c,temperature_{n}_c"));
        }
        csv.push('\n');
        for k in 0..run.steps.len() {
            csv.push_str(&format!("{}", run.steps.start_s + k as f64));
            for (p, t) in &columns {
                csv.push_str(&format!(",{:.4},{:.4}", p[k], t[k]));
            }
            csv.push('\n');
        }
        hrg_cal::write_file(out, csv.as_bytes())?;
    }
    Ok(())
}

fn now() -> u32 {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs() as u32)
}

fn print_trace(r: &trace::Report) {
    println!(
        "{:<5} {:>12} {:>12} {:>12} {:>12} {:>14} {:>12}   left, in floors",
        "axis", "base/train", "base/verify", "final/train", "final/verify", "means", "noise floor"
    );
    for n in r.axes() {
        let (b, f, ratio) = (r.baseline[n], r.r#final[n], r.floor_ratio[n]);
        println!(
            "{n:<5} {:>12.3} {:>12.3} {:>12.3} {:>12.3} {:>14} {:>12.3}   {:.2} [{:.2}, {:.2}]",
            b.train_rms_dph,
            b.verify_rms_dph,
            f.train_rms_dph,
            f.verify_rms_dph,
            format!("{} / {}", f.train_means, f.verify_means),
            r.noise_floor_dph[n],
            ratio.ratio,
            ratio.low,
            ratio.high
        );
    }
    println!("standard deviation of 100 s means, deg/h; how many means there are, train / verify; in brackets 95 %");
    if let Some(block) = &r.block {
        println!();
        println!("{:<5} {:>14} {:>26}   the written image on the verify run", "axis", "verify", "mean against train");
        for (n, b) in block {
            println!(
                "{n:<5} {:>14.3} {:>26}",
                b.verify_rms_dph,
                format!("{:+.3} +- {:.3}", b.mean_dph, b.mean_std_dph)
            );
        }
    }
    for e in &r.effects {
        println!();
        let parameters: Vec<String> = e.parameters.iter().map(|(n, v)| format!("{n} {v:.1}")).collect();
        let p_value = e.p_value.map_or("not tested".to_string(), |p| format!("{p:.1e}"));
        println!("effect {} {} ({}, {}; p-value {p_value})", e.name, parameters.join(", "), e.class.name(), e.reach);
        for (n, v) in &e.on_verify {
            println!("  axis {n}: the verify run shows {:.2} +- {:.2} of it", v.share, v.share_std);
        }
        for k in &e.rank {
            println!(
                "  {:<20} {:>6.1} % less cross-validated error, worth {:.1}",
                k.name,
                100.0 * k.gain_in_cv,
                k.worth
            );
        }
        if !e.indistinguishable_from.is_empty() {
            println!("  not told apart on this profile: {}", e.indistinguishable_from.join(", "));
        }
    }
    println!();
    println!("{}", r.verdict);
    for a in r.advice.iter().chain(&r.notes) {
        println!("- {a}");
    }
}

fn print_points(r: &points::Report) {
    println!("Residuals of T(f) and of f(T) solved for T, in C");
    println!(
        "{:<9} {:<5} {:<7} {:>6} {:>9} {:>9} {:>14}",
        "reference", "axis", "fit", "degree", "RMS", "largest", "leave-one-out"
    );
    for (reference, axes) in &r.fits {
        for (axis, f) in axes {
            for (kind, fits) in [("T(f)", &f.inverse), ("f(T)", &f.forward)] {
                for p in fits {
                    println!(
                        "{reference:<9} {axis:<5} {kind:<7} {:>6} {:>9.4} {:>9.4} {:>14.4}",
                        p.degree, p.rms_c, p.max_c, p.leave_one_out_rms_c
                    );
                }
            }
        }
    }
    if !r.each_other.is_empty() {
        println!("\nEach as the other's thermometer, in C: no sensor takes part");
        println!(
            "{:<6} {:>6} {:>24} {:>24} {:>24} {:>12} {:>9}",
            "pair", "soaks", "against the chamber", "by the other", "leave-one-out", "correlation", "p-value"
        );
    }
    for p in &r.each_other {
        let two = |v: [f64; 2]| format!("{:.4} / {:.4}", v[0], v[1]);
        println!(
            "{:<6} {:>6} {:>24} {:>24} {:>24} {:>12.3} {:>9.1e}",
            p.axes.join(" "),
            p.soaks,
            two(p.against_chamber_rms_c),
            two(p.by_the_other_rms_c),
            two(p.by_the_other_leave_one_out_c),
            p.correlation,
            p.p_value
        );
    }
    for e in &r.effects {
        println!();
        println!("{} (against the {}): {}", e.name, e.reference, e.finding);
        println!("p-value: {:.1e} ({})", e.p_value, e.statistic);
        if !e.indistinguishable_from.is_empty() {
            println!("these points cannot tell it from: {}", e.indistinguishable_from.join(", "));
        }
        println!("{:<5} {:>9} {:>20} {:>20} {:>24}", "axis", "gain [C]", "RMS [C]", "largest [C]", "leave-one-out [C]");
        for (axis, b) in &e.axes {
            let pair = |x: f64, y: f64| format!("{x:.4} -> {y:.4}");
            println!(
                "{axis:<5} {:>9.4} {:>20} {:>20} {:>24}",
                b.gain,
                pair(b.rms_before_c, b.rms_after_c),
                pair(b.max_before_c, b.max_after_c),
                pair(b.leave_one_out_before_c, b.leave_one_out_after_c)
            );
        }
    }
    for a in &r.advice {
        println!("\n{a}");
    }
}
