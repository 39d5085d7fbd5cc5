//! `hrg report`: figures of a data sheet from recordings alone.

use crate::facts::FactsArguments;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// What `hrg report` is told.
#[derive(Args)]
pub struct Arguments {
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
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recordings, json, html, facts } = arguments;
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
