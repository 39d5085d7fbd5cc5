//! `hrg report`: figures of a data sheet from recordings alone.

use crate::facts::FactsArguments;
use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `hrg report`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings of one unit, each one power-on.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// File for the figures (JSON).
    #[arg(long)]
    json: Option<PathBuf>,
    /// File for the figures as a page, with pictures (HTML).
    #[arg(long)]
    html: Option<PathBuf>,
    #[command(flatten)]
    facts: FactsArguments,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recordings, json, html, facts } = arguments;
    let runs = facts.load(&recordings)?;
    let report = with_a_bar("taking the figures", || hrg::report::report(&runs))?;
    print!("{}", hrg::report::text(&report));
    if let Some(path) = json {
        hrg_data::output::write_file(&path, serde_json::to_string_pretty(&report)?.as_bytes())?;
    }
    if let Some(path) = html {
        hrg_data::output::write_file(&path, hrg::report::html(&report)?.as_bytes())?;
    }
    Ok(())
}
