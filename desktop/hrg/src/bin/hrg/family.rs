//! `hrg family`: what the units of one design share.

use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::load::load_recording;
use hrg_data::numeric::side_by_side;
use hrg_identify::family::{by_unit, Family, Learnt};
use hrg_identify::fit;
use std::path::PathBuf;

/// Arguments of `hrg family`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings of units of one design: several of a unit are known by its name.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Name of the design; by default that of the file.
    #[arg(long)]
    name: Option<String>,
    /// File for the family (JSON).
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let stem = || arguments.out.file_stem().unwrap_or_default().to_string_lossy().to_string();
    let name = arguments.name.clone().unwrap_or_else(stem);
    let each = side_by_side::each(arguments.recordings.clone(), |p| load_recording(&p));
    let (mut recordings, mut unread) = (Vec::new(), Vec::new());
    for (r, path) in each.into_iter().zip(&arguments.recordings) {
        match r {
            Ok(r) => recordings.push(r),
            Err(e) => unread.push(format!("{}: {e:#}", path.display())),
        }
    }
    let units = by_unit(recordings);
    let with_inputs = units.iter().flatten().any(|r| r.unit_inputs().is_ok_and(|i| !i.is_empty()));
    let longest = units.iter().flatten().max_by_key(|r| r.time_s.len()).cloned();
    let Learnt { family, left_out, unlike } = with_a_bar("learning the family", || Family::learn(&name, units))?;
    hrg_data::output::write_file(&arguments.out, family.to_json()?.as_bytes())?;
    let runs: usize = family.sources.iter().map(|s| s.runs.len()).sum();
    let hours: f64 = family.sources.iter().flat_map(|s| &s.runs).map(|r| r.hours).sum();
    println!(
        "family {name}: {} units, {runs} runs, {hours:.0} h; temperatures {:.0} to {:.0} C, ramps {:.1} to {:.1} C/min",
        family.sources.len(),
        family.temperatures_c[0],
        family.temperatures_c[1],
        family.ramps_c_per_min[0],
        family.ramps_c_per_min[1]
    );
    let of = family.sources.len() as f64;
    println!("the spreads between {of} units are known to {:.0} % of themselves", 100.0 / (2.0 * (of - 1.0)).sqrt());
    if let Some(longest) = longest {
        print_parts(&family, &longest)?;
    }
    if with_inputs {
        println!("note: a family has no effects of quantities beside the frequencies (drive, quadrature, board, supply): what a unit owes to them is not compensated");
    }
    if family.sources.iter().all(|s| s.runs.len() < 2) {
        println!("note: no unit has two runs: days are not told from units, and what a day adds lies in the spread between units");
    }
    for u in &unlike {
        println!("note: the unit {} is in the family: {}", u.unit, u.sentence());
    }
    for left in &left_out {
        println!("note: the unit {} is left out: {}", left.unit, left.why);
    }
    for why in unread {
        println!("note: left out: {why}");
    }
    println!("{}: for hrg fit --prior, hrg trace --prior and hrg profile --prior", arguments.out.display());
    Ok(())
}

/// Each part of the bias on the longest run: its mean over the units, and its spreads.
fn print_parts(family: &Family, longest: &hrg_data::recording::Recording) -> Result<(), BadInput> {
    let prepared = fit::prepare(std::slice::from_ref(longest))?;
    println!(
        "{:<5} {:<24} {:>16} {:>16} {:>16}",
        "axis", "root mean square [deg/h]", "of the mean", "between units", "between days"
    );
    let Some(run) = prepared.runs.first() else { return Ok(()) };
    for (a, axis) in AXIS_NAMES.iter().enumerate() {
        for (part, [mean, units, days]) in family.parts_on(run, a) {
            println!("{axis:<5} {part:<24} {mean:>16.3} {units:>16.3} {days:>16.3}");
        }
    }
    println!("on the longest run, each about its own mean there");
    Ok(())
}
