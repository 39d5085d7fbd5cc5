//! `foreign-plant`: writes recordings of foreign physics, with the truth beside them.

use anyhow::{bail, Context, Result};
use clap::{Parser, Subcommand};
use foreign_plant::case::{run, Case, RunSpec, AXES};
use foreign_plant::chamber::{Leg, Program};
use foreign_plant::clean::{clean_case, control_noise};
use foreign_plant::draw::{Design, Seed};
use foreign_plant::generate::Generated;
use foreign_plant::series::{Selection, Series};
use foreign_plant::truth::Truth;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// Chamber runs of HRG units with physics that `hrg trace` was not written for, and the truth beside them.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// List the cases: name, group, classes of a right answer, whether a unit can compensate it, description.
    List,
    /// Write one case: NAME-SEED-train.csv (or -train-1.csv ...), NAME-SEED-verify.csv, NAME-SEED-judge.csv, NAME-SEED-truth.json.
    #[command(after_help = "Examples: foreign-plant make --case memory-rod --seed 1 --out /tmp/rod
          foreign-plant make --case memory-rod --design 1 --seed 1 --units 30 --out /tmp/fleet --more 22,-42@2,20m,55@2,20m")]
    Make {
        /// Name of the case, of those that `list` shows.
        #[arg(long)]
        case: String,
        /// Seed of the unit and of its runs.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Units, with seeds from there on.
        #[arg(long, default_value_t = 1)]
        units: u64,
        /// Seed of a design that all of them are of; each unit has properties of its own else.
        #[arg(long)]
        design: Option<u64>,
        /// Properties of a unit lie within this share of the range over which designs differ.
        #[arg(long, default_value_t = 0.3)]
        spread: f64,
        /// A further run by a profile, such as 22,-42@2,20m,55@2: start (C), then ramps (C at C/min) and soaks; no size depends on it.
        #[arg(long, allow_hyphen_values = true)]
        more: Vec<String>,
        /// Folder to write into; made where it is missing.
        #[arg(long)]
        out: PathBuf,
    },
    /// Write every case under N seeds.
    #[command(after_help = "Example: foreign-plant all --seeds 3 --out /tmp/foreign")]
    All {
        /// First seed.
        #[arg(long, default_value_t = 1)]
        first: u64,
        /// Number of seeds.
        #[arg(long, default_value_t = 3)]
        seeds: u64,
        /// Folder to write into.
        #[arg(long)]
        out: PathBuf,
    },
    /// Work out the truth of every case under seeds 1 to N and print sizes and reach; nothing is written.
    Reach {
        /// Number of seeds.
        #[arg(long, default_value_t = 3)]
        seeds: u64,
        /// Cases whose name contains this.
        #[arg(long, default_value = "")]
        only: String,
    },
    /// Run `hrg trace` on every unit of a folder and grade its reports by their truths.
    #[command(after_help = "Example: foreign-plant grade --hrg target/release/hrg --folder /tmp/foreign")]
    Grade {
        /// The program.
        #[arg(long, default_value = "target/release/hrg")]
        hrg: PathBuf,
        /// Folder with written units.
        #[arg(long)]
        folder: PathBuf,
        /// Page to write the table to; else it is printed.
        #[arg(long)]
        page: Option<PathBuf>,
        /// File for the table with a row a unit; else it follows the figures.
        #[arg(long)]
        units: Option<PathBuf>,
        /// Text above the table.
        #[arg(long, default_value = "")]
        heading: String,
    },
    /// Write clean units under many kinds of noise.
    #[command(
        after_help = "Example: foreign-plant clean --count 30 --out /tmp/clean --residuals imu_raw_data.csv --skip 5 \
                            --columns imu.gyro.x,imu.gyro.y --against imu.temperature"
    )]
    Clean {
        /// Number of units.
        #[arg(long, default_value_t = 30)]
        count: usize,
        /// Seed of the first unit; each next one has the next seed. Seeds that do not overlap are other units.
        #[arg(long, default_value_t = 0)]
        first: usize,
        /// Folder to write into.
        #[arg(long)]
        out: PathBuf,
        /// Tables of measured residuals: each third unit takes its noise spectrum from one.
        #[arg(long, num_args = 1..)]
        residuals: Vec<PathBuf>,
        /// Columns of the tables, by name or number from 0 (default: the last).
        #[arg(long, value_delimiter = ',')]
        columns: Vec<String>,
        /// Column of temperature, by name or number: what equation 7 explains by it is taken off first.
        #[arg(long)]
        against: Option<String>,
        /// Rows to leave out at the beginning of each table.
        #[arg(long, default_value_t = 0)]
        skip: usize,
        /// Time from row to row, s (default: a table is stretched over a run).
        #[arg(long)]
        step: Option<f64>,
    },
}

fn main() -> ExitCode {
    match Arguments::parse().command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("{e:#}");
            ExitCode::from(2)
        }
    }
}

impl Command {
    fn run(self) -> Result<()> {
        match self {
            Self::List => list(),
            Self::Make { case, seed, units, design, spread, more, out } => {
                let all = foreign_plant::cases();
                let Some(case) = all.into_iter().find(|c| c.name == case) else {
                    bail!("there is no case `{case}`; `foreign-plant list` shows all");
                };
                let more = more.iter().map(|text| by_profile(text)).collect::<Result<_>>()?;
                let case = Case { more, ..case };
                let design = design.map(|seed| Design { seed, spread });
                let jobs: Vec<_> = (seed..seed + units).map(|unit| (case.clone(), Seed { unit, design })).collect();
                write_all(&jobs, &out)?;
            }
            Self::All { first, seeds, out } => write_all(&jobs(first..first + seeds, ""), &out)?,
            Self::Reach { seeds, only } => reach(&jobs(1..seeds + 1, &only)),
            Self::Grade { hrg, folder, page, units, heading } => {
                let all = foreign_plant::grade::folder(&hrg, &folder)?;
                let rows = foreign_plant::grade::units(&all);
                let mut table = foreign_plant::grade::table(&all);
                match units {
                    None => table += &format!("\n{rows}"),
                    Some(path) => {
                        std::fs::write(&path, rows).with_context(|| format!("cannot write {}", path.display()))?;
                    }
                }
                match page {
                    None => print!("{table}"),
                    Some(path) => std::fs::write(&path, format!("{heading}\n\n{table}"))
                        .with_context(|| format!("cannot write {}", path.display()))?,
                }
            }
            Self::Clean { count, first, out, residuals, columns, against, skip, step } => {
                if step.is_some_and(|s| !(0.01..=3600.0).contains(&s)) {
                    bail!("--step must lie between 0.01 and 3600 s");
                }
                let selection = Selection { columns, against, skip, step_s: step };
                let series = residuals
                    .iter()
                    .map(|path| Series::read(path, &selection).map(Arc::new))
                    .collect::<Result<Vec<_>>>()?;
                let jobs: Vec<(Case, Seed)> = (0..count)
                    .map(|k| first + k)
                    .map(|k| (clean_case(k as u64, &control_noise(k, &series)), Seed::from(k as u64)))
                    .collect();
                write_all(&jobs, &out)?;
            }
        }
        Ok(())
    }
}

/// A run by a profile that is written out.
fn by_profile(text: &str) -> Result<RunSpec> {
    let mut parts = text.split(',').map(str::trim);
    let number = |t: &str| {
        t.parse::<f64>().ok().filter(|v| v.is_finite()).with_context(|| format!("--more: `{t}` is no number"))
    };
    let start_c = number(parts.next().unwrap_or_default())?;
    let mut legs: Vec<Leg> = vec![Leg { to_c: start_c, c_per_min: 1.0, hold_min: 0.0 }];
    let (mut at, mut minutes) = (start_c, 0.0);
    for part in parts {
        if let Some((to, ramp)) = part.split_once('@') {
            let (to_c, c_per_min) = (number(to)?, number(ramp)?);
            if c_per_min <= 0.0 {
                bail!("--more: the ramp of `{part}` must be above 0");
            }
            minutes += (to_c - at).abs() / c_per_min;
            at = to_c;
            legs.push(Leg { to_c, c_per_min, hold_min: 0.0 });
        } else {
            let in_min = [("h", 60.0), ("m", 1.0), ("s", 1.0 / 60.0)]
                .iter()
                .find_map(|(unit, f)| Some((part.strip_suffix(unit)?, f)));
            let (value, factor) =
                in_min.with_context(|| format!("--more: `{part}` is neither a ramp like -42@2 nor a soak like 20m"))?;
            let hold_min = number(value)? * factor;
            minutes += hold_min;
            if let Some(last) = legs.last_mut() {
                last.hold_min += hold_min;
            }
        }
    }
    let mut spec = run(Program::Cycles, minutes / 60.0);
    spec.plan.span.start_c = start_c;
    spec.plan.legs = Box::leak(legs.into_boxed_slice());
    Ok(spec)
}

fn jobs(seeds: std::ops::Range<u64>, only: &str) -> Vec<(Case, Seed)> {
    let cases = foreign_plant::cases();
    let chosen = cases.iter().filter(|case| case.name.contains(only));
    chosen.flat_map(|case| seeds.clone().map(|seed| (case.clone(), Seed::from(seed)))).collect()
}

fn list() {
    for case in foreign_plant::cases() {
        let classes: Vec<&str> = case.classes().iter().map(|c| c.name()).collect();
        let compensable = if case.why_not_compensable().is_none() { "yes" } else { "no" };
        println!(
            "{:<42} {:<12} {:<32} {compensable:<4} {}",
            case.name,
            case.group,
            classes.join(","),
            case.description
        );
    }
}

/// Runs `work` on every job, on all processors; results in the order of the jobs.
fn parallel<T: Send>(jobs: &[(Case, Seed)], work: impl Fn(&Case, Seed) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let workers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(jobs.len().max(1));
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                let Some((case, seed)) = jobs.get(k) else { break };
                let result = work(case, *seed);
                if let Ok(mut results) = results.lock() {
                    results.push((k, result));
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|(k, _)| *k);
    results.into_iter().map(|(_, result)| result).collect()
}

fn write_all(jobs: &[(Case, Seed)], out: &Path) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let written = parallel(jobs, |case, seed| write(&case.generate(seed), out));
    written.into_iter().collect::<Result<Vec<()>>>()?;
    println!("{} units written to {}", jobs.len(), out.display());
    Ok(())
}

fn write(made: &Generated, out: &Path) -> Result<()> {
    let files = made.truth.runs.iter().map(|run| out.join(&run.file));
    let recordings = made.train.iter().chain([&made.verify, &made.judge]).chain(&made.more);
    for (path, recording) in files.zip(recordings) {
        recording.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let path = out.join(format!("{}-{}-truth.json", made.truth.case, made.truth.seed));
    std::fs::write(&path, made.truth.to_json()?).with_context(|| format!("cannot write {}", path.display()))
}

fn reach(jobs: &[(Case, Seed)]) {
    println!(
        "{:<42} {:>4} {:>4} {:>4}  {:<22} {:>17}  {:>17}  {:>17}",
        "case", "seed", "comp", "axis", "sizes (floors)", "raw (dph)", "eq7 (floors)", "oracle (floors)"
    );
    for truth in parallel(jobs, |case, seed| case.generate(seed).truth) {
        for axis in AXES {
            print_axis(&truth, axis);
        }
    }
}

fn print_axis(truth: &Truth, axis: &str) {
    let sizes: Vec<String> =
        truth.effects.iter().filter_map(|e| e.size_floors.get(axis)).map(|s| format!("{s:.2}")).collect();
    let figures: Vec<_> = truth.runs.iter().filter_map(|run| run.axes.get(axis)).collect();
    if figures.is_empty() {
        return;
    }
    let of = |f: &dyn Fn(&foreign_plant::truth::AxisFigures) -> f64| {
        figures.iter().map(|x| format!("{:.2}", f(x))).collect::<Vec<_>>().join(" ")
    };
    println!(
        "{:<42} {:>4} {:>4} {axis:>4}  {:<22} {:>17}  {:>17}  {:>17}",
        truth.case,
        truth.seed,
        if truth.compensable { "yes" } else { "no" },
        sizes.join(" "),
        of(&|x| x.raw_dph),
        of(&|x| x.eq7_floors),
        of(&|x| x.oracle_floors),
    );
}
