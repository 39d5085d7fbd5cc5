//! `hrg import`.

use crate::facts::Identity;
use crate::merge;
use anyhow::Result;
use hrg_data::error::BadInput;
use hrg_data::recording::facts::Facts;
use hrg_data::recording::import;
use hrg_data::recording::import::guess::{beginning_of, guess, text_of, Guess};
use hrg_data::recording::import::map::Map;
use hrg_data::recording::reduced::{self, rows_of, Reduced, MEAN_S};
use hrg_data::recording::resonators::named;
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::{columns, dialect, parquet, Recording};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Arguments {
    /// The file of another program: a table as text (any separator and encoding) or Excel, Parquet, a log of PX4, ArduPilot or Betaflight, a ROS bag (MCAP).
    file: PathBuf,
    /// A map (docs/formats.md), or the name of one that is built in: px4, ardupilot, ardupilot-tcal, ros, betaflight, adis, bosch. Without it the columns are guessed, and the
    /// guess is printed as a map
    #[arg(short, long)]
    map: Option<String>,
    /// Number of the IMU, from 0, where the file has several.
    #[arg(long, value_name = "N")]
    imu: Option<u8>,
    #[command(flatten)]
    log: merge::Log,
    #[command(flatten)]
    identity: Identity,
    /// File for the recording: text, or Parquet if it ends in .parquet. Without it the file is only looked at.
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// The text of a recording, as it is made of a file.
struct Made {
    text: String,
    notes: Vec<String>,
    /// The map that was guessed.
    guessed: Option<Guess>,
}

impl Made {
    /// By a map.
    fn by(file: &Path, map: &Map) -> Result<Self> {
        let r = import::read(file, map)?;
        Ok(Self { text: r.to_csv(), notes: r.notes, guessed: None })
    }

    fn of(file: &Path, name: Option<&str>, imu: Option<u8>) -> Result<Self> {
        if let Some(name) = name.or_else(|| import::built_in(file)) {
            return Self::by(file, &named_map(name, imu)?);
        }
        let here = |e: BadInput| BadInput(format!("{}: {e}", file.display()));
        let table = text_of(file).ok().map(|(text, _)| text).filter(|text| !is_recording(text));
        let Some(table) = table else {
            // Every column is kept, those that a unit computed, too.
            let bytes = parquet::read_text(file)?;
            Recording::parse(&bytes).map_err(|e| {
                let other = if e.0.contains("is missing") {
                    "; where they have other names, --map FILE says what each is (docs/formats.md)"
                } else {
                    ""
                };
                here(BadInput(e.0 + other))
            })?;
            let text = String::from_utf8_lossy(&bytes);
            let plain = if dialect::is_plain(&text) {
                text.into_owned()
            } else {
                dialect::plain(&text).map_err(|e| here(e.into()))?
            };
            return Ok(Self { text: plain, notes: Vec::new(), guessed: None });
        };
        let (guess, map) = guessed(file, &table, imu)?;
        Ok(Self { guessed: Some(guess), ..Self::by(file, &map)? })
    }
}

/// A map by its name, with the number of an IMU.
fn named_map(name: &str, imu: Option<u8>) -> Result<Map> {
    let mut map = Map::named(name)?;
    map.table.instance = imu.unwrap_or(map.table.instance);
    Ok(map)
}

/// The map that is guessed from the beginning of a table.
fn guessed(file: &Path, table: &str, imu: Option<u8>) -> Result<(Guess, Map)> {
    let here = |e: BadInput| BadInput(format!("{}: {e}", file.display()));
    let guess = guess(table).map_err(here)?;
    if let Some(lacks) = guess.lacks() {
        print!("{}", guess.map());
        let next = "save what is printed above as map.toml, complete it, and give it by --map map.toml";
        return Err(here(BadInput(format!("{lacks}; {next}"))).into());
    }
    let mut map = Map::parse(&guess.map()).map_err(here)?;
    if let Some(imu) = imu {
        if map.table.instance_column.is_none() {
            return Err(here(BadInput::new(
                "--imu is for files with several IMUs, and this table has no column with their numbers; name it as instance_column in a --map",
            ))
            .into());
        }
        map.table.instance = imu;
    }
    Ok((guess, map))
}

/// A file of text that is too large to be in memory: it is imported part by part.
struct Large {
    file: PathBuf,
    /// `None`: it is a recording.
    map: Option<Map>,
    guessed: Option<Guess>,
}

impl Large {
    /// `None` for a recording in another dialect than ours: that is read as a whole.
    fn open(file: &Path, name: Option<&str>, imu: Option<u8>) -> Result<Option<Self>> {
        let of = |map, guessed| Ok(Some(Self { file: file.to_path_buf(), map, guessed }));
        if let Some(name) = name {
            return of(Some(named_map(name, imu)?), None);
        }
        if parquet::begins_as_parquet(file) {
            return of(None, None);
        }
        let begin = beginning_of(file)?;
        if !is_recording(&begin) {
            let (guess, map) = guessed(file, &begin, imu)?;
            return of(Some(map), Some(guess));
        }
        if dialect::is_plain(&begin) {
            of(None, None)
        } else {
            Ok(None)
        }
    }

    fn run(&self, arguments: &Arguments) -> Result<()> {
        let facts = arguments.identity.facts()?;
        let looked = match &arguments.out {
            Some(out) => parquet::write_parts(out, |to| self.through(&facts, to))?,
            None => self.through(&facts, &mut |_| Ok(()))?,
        };
        told(arguments, self.guessed.as_ref(), &looked);
        Ok(())
    }

    /// Gives the text of the recording part by part, and looks at what it is reduced to as at any recording.
    fn through(&self, facts: &Facts, to: &mut dyn FnMut(&str) -> Result<()>) -> Result<Looked> {
        let here = |e: BadInput| BadInput(format!("{}: {e}", self.file.display()));
        let mut reduced = Reduced::default();
        let mut first = true;
        let mut give = |text: &str, part: Recording| -> Result<()> {
            if !std::mem::take(&mut first) {
                to(text)?;
                reduced.add(part);
                return Ok(());
            }
            let text = stated(text, facts).map_err(here)?;
            to(&text)?;
            reduced.add(Recording::parse(text.as_bytes()).map_err(here)?);
            Ok(())
        };
        let mut notes = Vec::new();
        if let Some(map) = &self.map {
            let mut parts = import::Parts::open(&self.file, map)?;
            let mut head = true;
            while let Some(part) = parts.next_part()? {
                let text = part.to_csv();
                give(if std::mem::take(&mut head) { &text } else { rows_of(&text) }, part)?;
            }
            notes = parts.notes()?;
        } else {
            let mut parts = reduced::Parts::open(&self.file)?;
            while let Some((text, part)) = parts.next_part().map_err(here)? {
                give(&String::from_utf8_lossy(&text), part)?;
            }
        }
        let rows = reduced.rows();
        let mut clean = reduced.recording().map_err(here)?;
        // (How it was reduced is no matter of what is written.)
        clean.notes =
            vec![format!("it is too large to be looked at row by row: what follows is of means of {MEAN_S} s")];
        clean.clean().map_err(here)?;
        Ok(Looked { notes, clean, rows })
    }
}

/// `true` if a text has columns of a recording, or nothing in it.
fn is_recording(text: &str) -> bool {
    let ours = |line: &str| {
        let names: Vec<&str> = line.split([',', ';', '\t']).map(|c| c.trim().trim_matches('"')).collect();
        // (A time that has our name may stand in anybody's table.)
        columns::RATE.names.iter().any(|n| names.contains(n))
    };
    text.starts_with("# hrg-recording") || text.lines().take(100).any(ours) || text.trim().is_empty()
}

/// Makes a recording of another program's file.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { file, map: name, imu, log, identity, out } = arguments;
    if log.with.is_some() && out.is_none() {
        return Err(BadInput::new("--with needs --out, for the recording with the columns of the log").into());
    }
    let here = |e: BadInput| BadInput(format!("{}: {e}", file.display()));
    let same = |o: &PathBuf| o.canonicalize().is_ok_and(|o| file.canonicalize().is_ok_and(|f| f == o));
    if out.as_ref().is_some_and(same) {
        return Err(here(BadInput::new(
            "-o is the file itself; give another name, so that the raw file stays as it is",
        ))
        .into());
    }
    if log.with.is_none() && Recording::is_large(file) && !import::is_whole(file) {
        if let Some(done) = Large::open(file, name.as_deref(), *imu)?.map(|large| large.run(arguments)) {
            return done;
        }
    }
    let mut made = Made::of(file, name.as_deref(), *imu)?;
    made.text = stated(&made.text, &identity.facts()?).map_err(here)?;
    if let Some(with) = &log.with {
        made.text = merge::merged(file, &made.text, with, log)?;
    }
    // Looked at as any recording is, before it is written.
    let mut clean = Recording::parse(made.text.as_bytes()).map_err(here)?;
    clean.clean().map_err(here)?;
    if let Some(out) = out {
        parquet::write_text(out, &made.text)?;
    }
    let rows = (clean.time_s.len(), clean.step_s());
    told(arguments, made.guessed.as_ref(), &Looked { notes: made.notes, clean, rows });
    Ok(())
}

/// A recording as it is looked at when it is imported.
struct Looked {
    /// Notes on the file that it comes from.
    notes: Vec<String>,
    /// The recording, cleaned.
    clean: Recording,
    /// Number of rows, and the time between two of them, s.
    rows: (usize, f64),
}

/// Tells what was made.
fn told(Arguments { file, out, .. }: &Arguments, guessed: Option<&Guess>, Looked { notes, clean, rows }: &Looked) {
    for note in notes {
        eprintln!("{}: {note}", file.display());
    }
    // (Lines and columns of the recording are those of the file that is written.)
    let written = out.as_ref().unwrap_or(file).display().to_string();
    for note in &clean.notes {
        eprintln!("{written}: {note}");
    }
    if let Some(guess) = guessed {
        print!("{}", guess.map());
        eprintln!("the columns are guessed as the map above says: if one is wrong, save it as map.toml, correct it, and give it by --map map.toml");
    }
    let summary = summary(&written, clean, *rows);
    // (What is printed beside a guess is a map, and beside a recording the recording: nothing else.)
    if guessed.is_some() || out.as_ref().is_some_and(|o| hrg_data::output::is_standard(o)) {
        eprintln!("{summary}");
    } else {
        println!("{summary}");
    }
}

/// The text of a recording with facts about the unit in its metadata.
fn stated(text: &str, facts: &Facts) -> Result<String, BadInput> {
    let mut r = Recording::parse(text.as_bytes())?;
    let before = r.meta.clone();
    facts.apply(&mut r)?;
    let new = r.meta.iter().filter(|m| !before.contains(m));
    let added: String = new.map(|(k, v)| format!("# {k}: {v}\n")).collect();
    let at = if text.starts_with("# hrg-recording") { text.find('\n').map_or(0, |k| k + 1) } else { 0 };
    Ok(format!("{}{added}{}", &text[..at], &text[at..]))
}

fn summary(shown: &str, clean: &Recording, (rows, step_s): (usize, f64)) -> String {
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
    format!("{shown}: {rows} rows, {step_s:.3} s apart, axes {}; {readings}", named(clean.absent.map(|a| !a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_imported_part_by_part_is_what_is_imported_as_a_whole() {
        let folder = std::env::temp_dir().join(format!("hrg-large-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let mut table = String::from("time [ms];gyro_x [deg/s];gyro_y [deg/s];gyro_z [deg/s];temperature [C]\n");
        for k in 0..3000 {
            table += &format!("{k};0,{};-0,{};0,5;{},25\n", k % 97 + 1, k % 31 + 1, 20 + k % 9);
        }
        let recording = "# unit: G-1\ntime_s,temp_c,rate_x_dph\n0,20,1\n1,20,2\n2,21,3\n".to_string();
        for (name, text) in [("table.csv", table), ("run.csv", recording)] {
            let file = folder.join(name);
            std::fs::write(&file, text).expect("written");
            let large = Large::open(&file, None, None).expect("fits").expect("by parts");
            let mut parts = String::new();
            let mut to = |text: &str| {
                parts += text;
                Ok(())
            };
            let Looked { clean, rows, .. } = large.through(&Facts::default(), &mut to).expect("fits");
            let whole = Made::of(&file, None, None).expect("fits");
            assert_eq!(parts, whole.text);
            assert!(rows.0 == Recording::parse(parts.as_bytes()).expect("ours").time_s.len() && clean.time_s.len() > 2);
            assert_eq!(large.guessed.map(|g| g.map()), whole.guessed.map(|g| g.map()));
        }
        let _ = std::fs::remove_dir_all(&folder);
    }
}
