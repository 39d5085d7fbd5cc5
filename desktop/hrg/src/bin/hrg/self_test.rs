//! `hrg unit test`.

use crate::colour;
use anyhow::{Context, Result};
use clap::Args;
use hrg::unit::port::Unit;
use hrg::unit::self_test::Report;
use hrg_data::recording::Recording;
use std::path::PathBuf;

/// Arguments of `hrg unit test`.
#[derive(Args)]
pub struct Arguments {
    /// Serial port of the link.
    #[arg(long)]
    port: String,
    /// Recording of this unit whose noise is compared with that of a minute now: the one that it was calibrated with.
    #[arg(long)]
    against: Option<PathBuf>,
    /// Print a line for each figure.
    #[arg(long)]
    all: bool,
    /// File for all figures as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Prints the table; `true` if the unit passes.
pub fn run(arguments: &Arguments) -> Result<bool> {
    let against = arguments.against.as_deref().map(Recording::load).transpose()?;
    let mut unit = Unit::open(&arguments.port)?;
    let told = |what: &str| eprintln!("{what}");
    let report = Report::of(&mut unit, against.as_ref(), told).with_context(|| arguments.port.clone())?;
    if let Some(path) = &arguments.json {
        hrg_data::output::write_file(path, serde_json::to_string_pretty(&report)?.as_bytes())?;
    }
    println!("{}", colour::painted(&report.table(arguments.all)));
    Ok(report.verdict == "PASS")
}
