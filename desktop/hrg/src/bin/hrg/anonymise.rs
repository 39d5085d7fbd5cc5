//! `hrg anonymise`.

use crate::facts::Identity;
use anyhow::Result;
use hrg_data::error::BadInput;
use hrg_data::recording::reduced::{rows_of, Parts};
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
    let facts = identity.facts()?;
    let mut known = None;
    let mut without = |r: &mut Recording| {
        facts.apply(r).map_err(here)?;
        let (of_rows, removed) = anonymise(r, known).map_err(here)?;
        known = Some(of_rows);
        anyhow::Ok(removed)
    };
    let (mut removed, mut columns, mut rows) = (Vec::new(), Vec::new(), 0);
    if Recording::is_large(file) {
        parquet::write_parts(out, |to| {
            let mut parts = Parts::open(file)?;
            while let Some((_, mut r)) = parts.next_part().map_err(here)? {
                let of_part = without(&mut r)?;
                let text = r.to_csv();
                to(if rows == 0 { &text } else { rows_of(&text) })?;
                if rows == 0 {
                    (removed, columns) = (of_part, r.optional.iter().map(|(name, _)| *name).collect());
                }
                rows += r.time_s.len();
            }
            Ok(())
        })?;
    } else {
        let mut r = Recording::parse(&parquet::read_text(file)?).map_err(here)?;
        removed = without(&mut r)?;
        parquet::write_text(out, &r.to_csv())?;
        (rows, columns) = (r.time_s.len(), r.optional.iter().map(|(name, _)| *name).collect());
    }
    removed.iter().for_each(|line| println!("{line}"));
    let also = if columns.is_empty() { String::new() } else { format!(", and {}", hrg_data::error::list(&columns)) };
    println!("{}: {rows} rows; times, rates and thermometers{also} are as they were", out.display());
    println!("note: look into the file before you give it away: temperatures and rates themselves are the unit's");
    Ok(())
}
