//! `hrg import --with`: columns of another log, put into a recording by time.

use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::files::MOST_RECORDING;
use hrg_data::recording::merge::{merge, Wanted};
use hrg_data::recording::{parquet, Recording};
use std::path::{Path, PathBuf};

/// A log of another instrument, and its columns.
#[derive(Args)]
#[group(skip)]
pub struct Log {
    /// Log of the chamber or of another instrument, by time put beside the recording: any table separated by commas, semicolons or tabs.
    #[arg(long, value_name = "LOG", requires_all = ["time", "columns"])]
    pub with: Option<PathBuf>,
    /// With --with: the log's column of times, and their form: s (the default), ms, min, h, unix, iso, or a pattern like "%d.%m.%Y %H:%M:%S"
    #[arg(long, value_name = "COLUMN[=FORM]", requires = "with")]
    time: Option<String>,
    /// With --with: reading of the log's clock at the unit's power-on, in the same form; by default that of hrg record in the recording.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, requires = "with")]
    power_on: Option<String>,
    /// With --with: added to the log's times, s: for a clock that is off, or a log in local time.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_hyphen_values = true)]
    offset: f64,
    /// With --with: columns, chamber_c=Temperature,case_x_c=Sensor1
    #[arg(long, value_name = "NAME=COLUMN,...", value_delimiter = ',', requires = "with")]
    columns: Vec<String>,
    /// With --with: rows of the log that are further apart have a gap between them, s; by default five usual steps.
    #[arg(long, value_name = "SECONDS", requires = "with")]
    gap: Option<f64>,
}

/// Merges a log into a recording.
pub fn run(recording: &Path, with: &Path, log: &Log, out: &Path) -> Result<()> {
    let Log { time, power_on, offset, columns, gap, .. } = log;
    let wanted = Wanted::parse(time.as_deref().unwrap_or_default(), columns).map_err(BadInput::from)?;
    let wanted = Wanted { power_on: power_on.clone(), offset_s: *offset, gap_s: *gap, ..wanted };
    if !(offset.is_finite() && gap.is_none_or(|g| g > 0.0)) {
        return Err(BadInput::new("--offset is a number of seconds, --gap a positive one").into());
    }
    let here = |path: &Path, e: BadInput| BadInput::new(format!("{}: {e}", path.display()));
    let read = |path: &Path| hrg_data::files::read_file(path, MOST_RECORDING, true);
    let run = parquet::read_text(recording)?;
    Recording::parse(&run).map_err(|e| here(recording, e))?;
    // Chambers write their degree signs as they like; names of columns and numbers are ASCII.
    let (run, log) = (String::from_utf8_lossy(&run), read(with)?);
    let log = String::from_utf8_lossy(&log);
    let source = with.file_name().unwrap_or_default().to_string_lossy();
    let merged = merge(run.trim_start_matches('\u{feff}'), log.trim_start_matches('\u{feff}'), &source, &wanted)
        .map_err(|e| here(with, e))?;
    parquet::write_text(out, &merged.text)?;
    for note in &merged.notes {
        println!("note: {note}");
    }
    for (name, n) in &merged.filled {
        println!("{name}: a value in {n} of {} rows", merged.rows);
    }
    println!("{}: merged", out.display());
    Ok(())
}
