//! `hrg compare`: every method on the same data.

use crate::facts::FactsArguments;
use crate::units;
use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::recording::{parquet, Recording};
use hrg_papers::compare;
use hrg_papers::compare::{Contender, Options, Own};
use hrg_papers::history;
use hrg_simulate::profile::duration_s;
use std::path::{Path, PathBuf};

/// Arguments of `hrg compare`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings to learn from.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Recording that is only evaluated. Several may be given.
    #[arg(long, required = true)]
    verify: Vec<PathBuf>,
    /// Methods, separated by commas; by default all, and trace.
    #[arg(long, value_delimiter = ',')]
    methods: Vec<String>,
    /// A method of your own beside them: NAME=FILE, a recording with its corrected rates of the verify run (time_s, rate_?_dph); files with
    /// + between them for several verify runs. Several may be given.
    #[arg(long, value_name = "NAME=FILE")]
    also: Vec<String>,
    /// Seed of swarms and genetic searches.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Judge each run from this time on, such as 5h, 90m or 600s: leaves a first soak out.
    #[arg(long, default_value = "0s")]
    from: String,
    /// Folder for the images, the table (JSON and Markdown) and the pictures.
    #[arg(short, long, default_value = "out/compare")]
    out: PathBuf,
    /// hrg-board, which counts what the images cost on the virtual board; by default the one beside this program.
    #[arg(long)]
    board: Option<PathBuf>,
    /// Allow recordings of different units.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recordings, verify, methods, also, seed, from, out, board, different_units, facts } = arguments;
    let from_s = duration_s(&from).ok_or_else(|| {
        BadInput(format!("--from {from}: not a time; give hours, minutes or seconds, such as 5h, 90m or 600s"))
    })?;
    let options = Options { seed, units: units(different_units), from_s };
    let own = also.iter().map(|a| own_method(a)).collect::<Result<Vec<_>>>()?;
    compare_methods((&recordings, &verify), &facts, (&methods, &own), &options, &out, board)
}

/// A method of a user's own, by `NAME=FILE[+FILE...]`.
fn own_method(text: &str) -> Result<Own> {
    let Some((name, files)) = text.split_once('=').filter(|(name, _)| !name.is_empty()) else {
        return Err(BadInput(format!("--also {text}: not of the form NAME=FILE")).into());
    };
    if !name.chars().all(|c| c.is_alphanumeric() || "-_.".contains(c)) {
        return Err(BadInput(format!("--also {text}: a name has letters, digits, - and _")).into());
    }
    let verify = files.split('+').map(|f| corrected_rates(Path::new(f))).collect::<Result<_>>()?;
    Ok(Own { name: name.to_string(), verify, train: None, seconds: 0.0 })
}

/// A recording of corrected rates; it may do without a thermometer.
fn corrected_rates(path: &Path) -> Result<Recording> {
    let here = |e: BadInput| BadInput(format!("{}: {e}", path.display()));
    let bytes = parquet::read_text(path)?;
    let without = [b"# thermometer: none\n".as_slice(), &bytes].concat();
    let mut r = Recording::parse(&bytes).or_else(|e| Recording::parse(&without).map_err(|_| here(e)))?;
    r.order().map_err(here)?;
    Ok(r)
}

fn compare_methods(
    (recordings, verify): (&[PathBuf], &[PathBuf]),
    facts: &FactsArguments,
    (methods, own): (&[String], &[Own]),
    options: &Options,
    out: &Path,
    board: Option<PathBuf>,
) -> Result<()> {
    let contenders = if methods.is_empty() {
        Contender::all()
    } else {
        methods.iter().map(|m| Contender::by_name(m)).collect::<Result<_, _>>()?
    };
    std::fs::create_dir_all(out).map_err(|e| BadInput::new(format!("cannot make {}: {e}", out.display())))?;
    let (train, unseen) = (facts.load(recordings)?, facts.load(verify)?);
    let mut c =
        with_a_bar("comparing", || compare::compare(&train, &unseen, (&contenders, own), options, out, |_| ()))?;
    let beside = std::env::current_exe()
        .ok()
        .and_then(|p| p.parent().map(|d| d.join("hrg-board")))
        .filter(|p| board.is_none() && p.is_file());
    match board.or(beside) {
        Some(_) if hrg_data::recording::resonators::require_resonators(&unseen[0]).is_err() => eprintln!(
            "the firmware reads three resonators and this recording has none: what the images cost on the unit is not counted"
        ),
        Some(board) => {
            with_a_bar("counting what the images cost on the virtual board", || {
                compare::count_costs(&mut c, &board, out, &verify[0], 120)
            })?;
        }
        None => eprintln!(
            "hrg-board is not beside this program: what the images cost on the unit is not counted (--board PATH)"
        ),
    }
    hrg_data::output::write_file(&out.join("compare.json"), serde_json::to_string_pretty(&c)?.as_bytes())?;
    hrg_data::output::write_file(&out.join("compare.md"), compare::table(&c, true, None).as_bytes())?;
    hrg_data::output::write_file(&out.join("compare.svg"), compare::picture(&c)?.as_bytes())?;
    hrg_data::output::write_file(&out.join("residuals.svg"), compare::residuals(&c, &unseen[0], out)?.as_bytes())?;
    let searched = c.rows.iter().any(|r| !r.history.is_empty());
    if searched {
        hrg_data::output::write_file(&out.join("searches.svg"), compare::searches(&c)?.as_bytes())?;
    }
    for r in c.rows.iter().filter(|r| !r.history.is_empty()) {
        hrg_data::output::write_file(
            &out.join(format!("{}-history.csv", r.method)),
            history::csv(&r.history).as_bytes(),
        )?;
    }
    print!("{}", compare::table(&c, false, None));
    println!("3s: three sigma of means over {} s; cooling, heating: the same of each stage, a soak with the ramp before it, of unseen repeats (of the training runs where there is none);", c.mean_s);
    println!("repeat, other: on unseen runs of a training profile, and of other profiles; mean: of the unseen runs, which 3s leaves out; instability: least Allan deviation / 0.664;");
    println!("{}, RMS of the axes. {}.", c.rate_unit, c.about_verify);
    println!("instructions on the unit: f to bias, of one axis' calibration curve f-T and bias model; update, of all three axes with");
    println!(
        "slopes, states and checks; ELF differs: frames of two minutes that are not those of hrg-core on this machine"
    );
    for r in &c.rows {
        println!("{}: {}", r.method, r.notes.join("; "));
    }
    for l in &c.left_out {
        println!("left out, {l}");
    }
    println!(
        "{}: images, compare.json, compare.md, compare.svg, residuals.svg{}",
        out.display(),
        if searched { ", searches.svg, METHOD-history.csv" } else { "" }
    );
    Ok(())
}
