//! `hrg import --with`: columns of another log, put into a recording by time.

use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::recording::import::guess::{guess, text_of};
use hrg_data::recording::merge::{merge, Wanted};
use hrg_data::recording::Recording;
use std::path::{Path, PathBuf};

/// A log of another instrument, and its columns.
#[derive(Args)]
#[group(skip)]
pub struct Log {
    /// Log of the chamber or of another instrument, by time put beside the recording: any table, as text or Excel.
    #[arg(long, value_name = "LOG")]
    pub with: Option<PathBuf>,
    /// With --with: the log's column of times, and their form: s (the default), ms, min, h, unix, iso, or a pattern like "%d.%m.%Y %H:%M:%S";
    /// "Date+Time=..." where they stand in two columns. Without it they are guessed
    #[arg(long, value_name = "COLUMN[=FORM]", requires = "with")]
    time: Option<String>,
    /// With --with: reading of the log's clock at the unit's power-on, in the same form; by default that of hrg record in the recording.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true, requires = "with")]
    power_on: Option<String>,
    /// With --with: added to the log's times, s: for a clock that is off, or a log in local time.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, allow_hyphen_values = true)]
    offset: f64,
    /// With --with: columns, chamber_c=Temperature,case_x_c=Sensor1; temp_c or temp_x_c where the recording has no thermometer; "chamber_c=T in K"
    /// converts (K, F, mC; mV). Without it they are guessed
    #[arg(long, value_name = "NAME=COLUMN,...", value_delimiter = ',', requires = "with")]
    columns: Vec<String>,
    /// With --with: longest step between two rows of the log, s; a longer step is a gap. Default: five usual steps.
    #[arg(long, value_name = "SECONDS", requires = "with")]
    gap: Option<f64>,
}

/// The text of a recording with columns of a log, both as they were read.
pub fn merged(recording: &Path, run: &str, with: &Path, log: &Log) -> Result<String> {
    let Log { time, power_on, offset, columns, gap, .. } = log;
    let here = |path: &Path, e: BadInput| BadInput::new(format!("{}: {e}", path.display()));
    let r = Recording::parse(run.as_bytes()).map_err(|e| here(recording, e))?;
    let (text, note) = text_of(with).map_err(|e| here(with, e))?;
    let lacking = time.is_none() || columns.is_empty();
    // (Units that the header names count for columns that are given, too.)
    let guessed = match guess(&text) {
        Err(e) if lacking => return Err(here(with, e).into()),
        guessed => guessed.ok(),
    };
    let time_is_guessed = time.is_none();
    let (mut time, mut columns) = (time.clone(), columns.clone());
    if let Some(guess) = guessed.as_ref().filter(|_| lacking) {
        time = time.or_else(|| guess.time());
        if columns.is_empty() {
            columns = guess.beside(&r);
        }
        if time.is_none() || columns.is_empty() {
            let names: Vec<&str> = guess.columns.iter().map(|c| c.name.as_str()).collect();
            let lacks = if time.is_none() {
                "time is known; give it by --time"
            } else {
                "temperature is known; give it by --columns temp_c=NAME"
            };
            return Err(here(with, BadInput(format!("no column for a {lacks}; there are {}", names.join(", ")))).into());
        }
        let other = guess.other_thermometers();
        if !other.is_empty() && log.columns.is_empty() {
            println!("note: of several thermometers the first is taken; the others are {}", other.join(", "));
        }
        println!(
            "note: guessed: --time \"{}\" --columns \"{}\"",
            time.as_deref().unwrap_or_default(),
            columns.join(",")
        );
    }
    let wanted = Wanted::parse(time.as_deref().unwrap_or_default(), &columns).map_err(BadInput::from)?;
    let mut wanted = wanted;
    if let Some(guess) = &guessed {
        for note in wanted.take_units(|column| guess.unit_of(column)) {
            println!("note: {note}");
        }
    }
    let wanted = Wanted { power_on: power_on.clone(), offset_s: *offset, gap_s: *gap, ..wanted };
    if !(offset.is_finite() && gap.is_none_or(|g| g > 0.0)) {
        return Err(BadInput::new("--offset is a number of seconds, --gap a positive one").into());
    }
    let source = with.file_name().unwrap_or_default().to_string_lossy();
    let run = run.trim_start_matches('\u{feff}');
    let text = text.trim_start_matches('\u{feff}');
    let merged = merge(run, text, &source, &wanted).or_else(|e| {
        // (Day and month may be changed about in a guess: the order that overlaps is the right one.)
        let other = guessed.as_ref().filter(|_| time_is_guessed).and_then(|_| wanted.other_order());
        let found = other.and_then(|w| Some((merge(run, text, &source, &w).ok()?, w)));
        found
            .map(|(m, w)| {
                println!(
                    "note: its dates are read as {}: in the other order they do not overlap the recording",
                    w.format.name()
                );
                m
            })
            .ok_or_else(|| here(with, e))
    })?;
    for note in note.iter().chain(&merged.notes) {
        println!("note: {note}");
    }
    for (name, n) in &merged.filled {
        println!("{name}: a value in {n} of {} rows", merged.rows);
    }
    Ok(merged.text)
}
