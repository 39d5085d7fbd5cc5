//! `hrg anonymise`.

use crate::facts::Identity;
use anyhow::Result;
use hrg_data::error::BadInput;
use hrg_data::recording::{anonymise::anonymise, parquet, Recording};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Arguments {
    /// A recording.
    #[arg(value_name = "RUN")]
    file: PathBuf,
    #[command(flatten)]
    identity: Identity,
    /// File for the recording that can be given away.
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { file, identity, out } = arguments;
    let here = |e: BadInput| BadInput(format!("{}: {e}", file.display()));
    let mut r = Recording::parse(&parquet::read_text(file)?).map_err(here)?;
    identity.facts()?.apply(&mut r).map_err(here)?;
    let removed = anonymise(&mut r).map_err(here)?;
    parquet::write_text(out, &r.to_csv())?;
    removed.iter().for_each(|line| println!("{line}"));
    let columns: Vec<&str> = r.optional.iter().map(|(name, _)| *name).collect();
    let also = if columns.is_empty() { String::new() } else { format!(", and {}", hrg_data::error::list(&columns)) };
    println!("{}: {} rows; times, rates and thermometers{also} are as they were", out.display(), r.time_s.len());
    println!("note: look into the file before you give it away: temperatures and rates themselves are the unit's");
    Ok(())
}
