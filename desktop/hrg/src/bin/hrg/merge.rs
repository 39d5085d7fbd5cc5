//! `hrg merge`.

use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::files::MOST_RECORDING;
use hrg_data::recording::merge::{merge, Wanted};
use hrg_data::recording::{parquet, Recording};
use std::path::{Path, PathBuf};

/// What `hrg merge` is told.
#[derive(Args)]
pub struct Arguments {
    /// Recording.
    recording: PathBuf,
    /// The chamber's own log: any table separated by commas, semicolons or tabs.
    #[arg(long, value_name = "CHAMBER.csv")]
    with: PathBuf,
    /// The log's column of times, and their form: s (the default), ms, min, h, unix, iso, or a pattern like "%d.%m.%Y %H:%M:%S"
    #[arg(long, value_name = "COLUMN[=FORM]")]
    time: String,
    /// What the log's clock showed at the unit's power-on, in the same form; by default what hrg record wrote into the file.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    power_on: Option<String>,
    /// Added to the log's times, s: for a clock that is off, or a log in local time.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_hyphen_values = true)]
    offset: f64,
    /// Columns: chamber_c=Temperature,case_x_c=Sensor1
    #[arg(long, value_name = "NAME=COLUMN,...", value_delimiter = ',', required = true)]
    columns: Vec<String>,
    /// Rows of the log that are further apart have a gap between them, s; by default five usual steps.
    #[arg(long, value_name = "SECONDS")]
    gap: Option<f64>,
    /// Where the merged recording goes.
    #[arg(long)]
    out: PathBuf,
}

/// Merges a log into a recording.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { recording, with, time, power_on, offset, columns, gap, out } = arguments;
    let wanted = Wanted::parse(time, columns).map_err(BadInput::from)?;
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
