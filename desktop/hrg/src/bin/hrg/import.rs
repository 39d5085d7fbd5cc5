//! `hrg import`.

use crate::merge;
use anyhow::Result;
use hrg_data::error::BadInput;
use hrg_data::recording::import;
use hrg_data::recording::import::map::{Map, BUILT_IN};
use hrg_data::recording::resonators::named;
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::{dialect, parquet, Recording};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Arguments {
    /// The file of another program.
    file: PathBuf,
    /// A map (docs/formats.md), or the name of one that is built in: px4, ardupilot, adis, bosch. Without it the file has the columns
    /// of a recording
    #[arg(long, conflicts_with = "with")]
    map: Option<String>,
    #[command(flatten)]
    log: merge::Log,
    /// File for the recording: text, or Parquet if it ends in .parquet. Without it the file is only looked at.
    #[arg(short, long)]
    out: Option<PathBuf>,
}

fn map(name: &str) -> Result<Map> {
    if let Some((_, text)) = BUILT_IN.iter().find(|(n, _)| *n == name) {
        return Ok(Map::parse(text)?);
    }
    let path = Path::new(name);
    let text = std::fs::read_to_string(path).map_err(|e| {
        let known: Vec<&str> = BUILT_IN.iter().map(|(n, _)| *n).collect();
        BadInput(format!("cannot read the map {name}: {e}; built in are {}", known.join(", ")))
    })?;
    Ok(Map::parse(&text).map_err(|e| BadInput(format!("{name}: {e}")))?)
}

/// Makes a recording of another program's file.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { file, map: name, log, out } = arguments;
    if let Some(with) = &log.with {
        let Some(out) = out else {
            return Err(BadInput::new("--with needs --out, for the recording with the columns of the log").into());
        };
        return merge::run(file, with, log, out);
    }
    let here = |e: BadInput| BadInput(format!("{}: {e}", file.display()));
    let (text, notes) = match name {
        Some(name) => {
            let r = import::read(file, &map(name)?)?;
            (r.to_csv(), r.notes)
        }
        // Every column is kept, those that a unit computed, too.
        None => {
            let bytes = parquet::read_text(file)?;
            Recording::parse(&bytes).map_err(|e| {
                let other = e.0.contains("is missing");
                let map = if other {
                    "; where they have other names, --map FILE says what each is (docs/formats.md)"
                } else {
                    ""
                };
                here(BadInput(e.0 + map))
            })?;
            let text = String::from_utf8_lossy(&bytes);
            let text = if dialect::is_plain(&text) {
                text.into_owned()
            } else {
                dialect::plain(&text).map_err(|e| here(e.into()))?
            };
            (text, Vec::new())
        }
    };
    // Looked at as any recording is, before it is written.
    let mut clean = Recording::parse(text.as_bytes()).map_err(here)?;
    clean.clean().map_err(here)?;
    for note in notes.iter().chain(&clean.notes) {
        eprintln!("{}: {note}", file.display());
    }
    let shown = out.as_ref().map_or_else(|| file.display().to_string(), |o| o.display().to_string());
    if let Some(out) = out {
        parquet::write_text(out, &text)?;
    }
    let range = |a: usize| {
        let v = clean.frequency_hz[a].iter().filter(|v| v.is_finite());
        v.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)))
    };
    let first = clean.present().next().unwrap_or(0);
    let (low, high) = range(first);
    let readings = match clean.thermometer {
        Thermometer::None => "no thermometer".to_string(),
        t => format!("{} from {low:.2} to {high:.2} {}", t.column(first), if t.is_sensor() { "C" } else { "Hz" }),
    };
    println!(
        "{shown}: {} rows, {:.3} s apart, axes {}; {readings}",
        clean.time_s.len(),
        clean.step_s(),
        named(clean.absent.map(|a| !a))
    );
    Ok(())
}
