//! `hrg judge`: does the unit pass?

use crate::colour::painted;
use crate::facts::FactsArguments;
use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg::judge::{judge, Limit, Verdict};
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::facts;
use std::path::PathBuf;

/// Arguments of `hrg judge`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings of raw rates.
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,
    /// Calibration that the unit has, or is to get.
    #[arg(short, long)]
    calibration: PathBuf,
    /// Largest error of the corrected rates that passes, deg/h, the constant included.
    #[arg(short, long, value_name = "DEG/H", allow_hyphen_values = true)]
    limit: f64,
    /// Lowest temperature of the range, C (of the resonators).
    #[arg(long, value_name = "C", allow_hyphen_values = true)]
    from: f64,
    /// Highest temperature of the range, C.
    #[arg(long, value_name = "C", allow_hyphen_values = true)]
    to: f64,
    /// Duration of the means that are judged.
    #[arg(long, value_name = "SECONDS", default_value = "100s", value_parser = seconds)]
    means: usize,
    /// File for the answer (JSON).
    #[arg(short, long)]
    out: Option<PathBuf>,
    /// File for the answer as a page with pictures (HTML).
    #[arg(long)]
    html: Option<PathBuf>,
    /// Use a calibration of another unit.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
}

fn seconds(text: &str) -> Result<usize, String> {
    let number = text.strip_suffix('s').unwrap_or(text);
    number.parse().map_err(|_| format!("{text} is no duration in whole seconds; write 100 or 100s"))
}

/// Runs the command; gives the verdict, whose exit status is the program's.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<Verdict> {
    let Arguments { runs, calibration, limit, from, to, means, out, html, different_units, facts: given } = arguments;
    let limit = Limit { limit_dph: *limit, from_c: *from, to_c: *to, means_s: *means };
    limit.check()?;
    let c = image_file::load(calibration)?;
    let runs = given.load(runs)?;
    let mut notes = Vec::new();
    for r in &runs {
        notes.extend(facts::fits(&c, r, *different_units).map_err(BadInput::from)?);
    }
    let mut judgement = with_a_bar("judging", || judge(&runs, &c, &limit))?;
    notes.dedup();
    judgement.notes.splice(0..0, notes);
    println!("{}", painted(&judgement.line()));
    println!();
    print!("{}", painted(&judgement.table()));
    for note in &judgement.notes {
        println!("note: {note}");
    }
    // (On the terminal they stand above, as the runs were read.)
    let of_runs = runs.iter().flat_map(|r| r.notes.iter().map(|n| format!("{}: {n}", r.source)));
    judgement.notes.extend(of_runs);
    if let Some(path) = out {
        hrg_data::output::write_file(path, serde_json::to_string_pretty(&judgement)?.as_bytes())?;
    }
    if let Some(path) = html {
        hrg_data::output::write_file(path, judgement.html()?.as_bytes())?;
    }
    Ok(judgement.verdict)
}
