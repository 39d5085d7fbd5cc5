//! Sensors on the gyros' cases and in the chamber, read while a unit is recorded: lines of text from a file that grows, a pipe or
//! a serial port.
//!
//! A line is `case_x_c=23.52 case_y_c=23.47 case_z_c=23.91 chamber_c=24.98` (any of them, in any order; blanks, commas or
//! semicolons between), or the file has a header line of such names and lines of values. `time_s`, where it is there, is the
//! time since the unit's power-on; else a reading belongs to the moment at which its line comes. A value is written into the one
//! row that it belongs to: what reads the recording draws straight lines between.

use hrg_core::inputs;
use hrg_data::error::BadInput;
use hrg_data::recording::columns;
use hrg_data::recording::columns::{Column, CASE, CHAMBER};
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{channel, Receiver, Sender};
use std::sync::Arc;
use std::time::Duration;

/// The columns that sensors fill.
pub const COLUMNS: [Column; 2] = [CASE, CHAMBER];

/// Names of the sensors beside a unit.
#[must_use]
pub fn names() -> Vec<&'static str> {
    COLUMNS.iter().flat_map(|c| c.names).copied().collect()
}

/// Names of the inputs beside the frequencies, by number.
#[must_use]
pub fn names_of_inputs() -> Vec<&'static str> {
    inputs::NAMES.to_vec()
}

/// Baud rate of a port that names none.
const BAUD: u32 = 9600;

/// Interval of the checks for a new line.
const AGAIN: Duration = Duration::from_millis(100);

/// Why a line is none of sensors.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// A name that is none of those there are.
    #[error("\"{name}\" is not known here: there are time_s, {known}")]
    Name {
        /// In the line.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// A value that is no number.
    #[error("\"{0}\" is not a number")]
    Number(String),
    /// Values without a header before them, or more or fewer than it has names.
    #[error("values without names; write NAME=VALUE, or a header line of names first")]
    NoHeader,
}

/// Contents of a line.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Time since the unit's power-on, s, where the line tells.
    pub time_s: Option<f64>,
    /// Values in the order of the names; NaN where not told.
    pub values: Vec<f64>,
}

impl Reading {
    /// Puts the values that are told in the place of others.
    fn put_into(&self, values: &mut [f64]) {
        values.iter_mut().zip(&self.values).filter(|(_, v)| v.is_finite()).for_each(|(to, v)| *to = *v);
    }
}

/// Index of a value; `None` is the time.
type Target = Option<usize>;

/// Reads lines of values with names.
#[derive(Debug)]
pub struct Lines {
    names: Vec<&'static str>,
    header: Vec<Target>,
}

impl Lines {
    /// Of values that may have these names.
    #[must_use]
    pub fn of(names: Vec<&'static str>) -> Self {
        Self { names, header: Vec::new() }
    }

    fn target(&self, name: &str) -> Result<Target, LineError> {
        let name = columns::today(name);
        if name == columns::TIME.name(0) {
            return Ok(None);
        }
        let at = self.names.iter().position(|n| *n == name);
        at.map(Some)
            .ok_or_else(|| LineError::Name { name: name.chars().take(24).collect(), known: self.names.join(", ") })
    }

    /// Takes a line; `None` where it is empty, a comment (`#`) or a header.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn take(&mut self, line: &str) -> Result<Option<Reading>, LineError> {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            return Ok(None);
        }
        let mut reading = Reading { time_s: None, values: vec![f64::NAN; self.names.len()] };
        let mut put = |target: Target, text: &str| -> Result<(), LineError> {
            let text = text.trim();
            let value = match text {
                "" => f64::NAN,
                _ => text.parse().map_err(|_| LineError::Number(text.chars().take(24).collect()))?,
            };
            match target {
                Some(k) => reading.values[k] = value,
                None => reading.time_s = Some(value).filter(|t: &f64| t.is_finite()),
            }
            Ok(())
        };
        if line.contains('=') {
            for item in line.split([' ', ',', ';', '\t']).filter(|i| !i.is_empty()) {
                let (name, value) = item.split_once('=').ok_or(LineError::NoHeader)?;
                put(self.target(name)?, value)?;
            }
            return Ok(Some(reading));
        }
        let cells: Vec<&str> = line.split([',', ';', '\t']).map(str::trim).collect();
        if cells.iter().any(|c| c.starts_with(|c: char| c.is_ascii_alphabetic()) && !c.eq_ignore_ascii_case("nan")) {
            self.header = cells.into_iter().map(|c| self.target(c)).collect::<Result<_, _>>()?;
            return Ok(None);
        }
        if cells.len() != self.header.len() {
            return Err(LineError::NoHeader);
        }
        for (target, cell) in self.header.iter().zip(cells) {
            put(*target, cell)?;
        }
        Ok(Some(reading))
    }
}

/// Sensors that are read meanwhile, by a thread of their own.
#[derive(Debug)]
pub struct Sensors {
    names: Vec<&'static str>,
    lines: Receiver<Result<Reading, String>>,
    stop: Arc<AtomicBool>,
    waiting: VecDeque<Reading>,
    last_s: f64,
    /// Readings that came.
    pub readings: u64,
    /// Lines that could not be read.
    pub bad: u64,
    /// The first of those, in words.
    pub first_bad: Option<String>,
}

impl Drop for Sensors {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

impl Sensors {
    /// Opens a file, a pipe or a port (`/dev/ttyACM0`, or `/dev/ttyACM0@115200`). Of a file that is there already, lines
    /// without a time are older than the recording and not used.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(source: &str) -> Result<Self, BadInput> {
        Self::open_for(source, names())
    }

    /// The same of values with these names.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open_for(source: &str, names: Vec<&'static str>) -> Result<Self, BadInput> {
        let of_lines = Lines::of(names.clone());
        let (path, baud) = match source.rsplit_once('@').map(|(p, b)| (p, b.parse())) {
            Some((path, Ok(baud))) => (path, baud),
            _ => (source, BAUD),
        };
        let cannot = |e: &dyn std::fmt::Display| {
            BadInput::new(format!("cannot read values from {source}: {e}; give a file or a port that is there"))
        };
        let meta = std::fs::metadata(path).map_err(|e| cannot(&e))?;
        let (send, lines) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        if meta.file_type().is_char_device() {
            let port = serialport::new(path, baud).timeout(AGAIN).open().map_err(|e| cannot(&e))?;
            std::thread::spawn(move || follow(port, of_lines, 0, &send, &stopped));
        } else if meta.is_dir() {
            return Err(cannot(&"it is a folder"));
        } else {
            // (Opening a pipe waits for who writes into it.)
            let (path, old) = (Path::new(path).to_path_buf(), if meta.is_file() { meta.len() } else { 0 });
            std::fs::File::open(&path).map(drop).or_else(|e| if meta.is_file() { Err(cannot(&e)) } else { Ok(()) })?;
            std::thread::spawn(move || {
                if let Ok(file) = std::fs::File::open(path) {
                    follow(file, of_lines, old, &send, &stopped);
                }
            });
        }
        Ok(Self::new(names, lines, stop))
    }

    fn new(names: Vec<&'static str>, lines: Receiver<Result<Reading, String>>, stop: Arc<AtomicBool>) -> Self {
        Self { names, lines, stop, waiting: VecDeque::new(), last_s: 0.0, readings: 0, bad: 0, first_bad: None }
    }

    /// Reads a whole file, for a recording that is made of a log: each line must tell its time.
    ///
    /// # Errors
    /// If the file or one of its lines cannot be read.
    pub fn of_file(path: &str) -> Result<Self, BadInput> {
        let bytes = hrg_data::files::read_file(Path::new(path), hrg_data::files::MOST_RECORDING, true)?;
        let (mut lines, mut sensors) = (Lines::of(names()), Self::new(names(), channel().1, Arc::default()));
        for (k, line) in String::from_utf8_lossy(&bytes).lines().enumerate() {
            let bad = |e: &dyn std::fmt::Display| BadInput::new(format!("{path}: line {}: {e}", k + 1));
            let Some(reading) = lines.take(line).map_err(|e| bad(&e))? else { continue };
            if reading.time_s.is_none() {
                return Err(bad(
                    &"time_s is missing; beside a log, sensors need the time since the unit's power-on (or use hrg import)",
                ));
            }
            sensors.readings += 1;
            sensors.waiting.push_back(reading);
        }
        Ok(sensors)
    }

    /// The newest value of each name that has come since last asked, whatever its time; NaN where none has.
    pub fn newest(&mut self) -> Vec<f64> {
        self.receive();
        let mut values = vec![f64::NAN; self.names.len()];
        self.waiting.drain(..).for_each(|r| r.put_into(&mut values));
        values
    }

    /// Takes what the thread has read.
    fn receive(&mut self) {
        for line in self.lines.try_iter() {
            match line {
                Ok(reading) => {
                    self.readings += 1;
                    self.waiting.push_back(reading);
                }
                Err(why) => {
                    self.bad += 1;
                    self.first_bad.get_or_insert(why);
                }
            }
        }
    }

    /// The values that belong to the row of a time (s since the unit's power-on); NaN where none came since the row before.
    pub fn at(&mut self, now_s: f64) -> Vec<f64> {
        self.receive();
        // The unit was switched off and on: it counts from zero again.
        let from_s = if now_s < self.last_s { f64::NEG_INFINITY } else { self.last_s };
        let mut values = vec![f64::NAN; self.names.len()];
        self.waiting.retain(|r| {
            let time_s = r.time_s.unwrap_or(now_s);
            if time_s > from_s && time_s <= now_s {
                r.put_into(&mut values);
            }
            time_s > now_s
        });
        self.last_s = now_s;
        values
    }

    /// Counts of readings and of bad lines, in a sentence.
    #[must_use]
    pub fn summary(&self) -> String {
        let bad = match &self.first_bad {
            Some(why) => format!("; {} lines could not be read, the first: {why}", self.bad),
            None => String::new(),
        };
        format!("{} readings{bad}", self.readings)
    }
}

/// Sends what lines say until told to stop. Lines that begin before `old` bytes count only where they tell their time.
fn follow(source: impl Read, mut lines: Lines, old: u64, send: &Sender<Result<Reading, String>>, stop: &AtomicBool) {
    let mut reader = BufReader::new(source);
    let (mut line, mut at, mut number) = (Vec::new(), 0, 0u64);
    while !stop.load(Ordering::Relaxed) {
        // A line may come in pieces.
        match reader.by_ref().take(1 << 16).read_until(b'\n', &mut line) {
            Ok(n) if n > 0 && line.ends_with(b"\n") => {}
            Ok(n) if n > 0 && line.len() > 1 << 16 => {}
            Ok(n) => {
                if n == 0 {
                    std::thread::sleep(AGAIN);
                }
                continue;
            }
            Err(e) if matches!(e.kind(), std::io::ErrorKind::TimedOut | std::io::ErrorKind::Interrupted) => continue,
            Err(e) => {
                let _ = send.send(Err(format!("they are gone ({e})")));
                return;
            }
        }
        number += 1;
        let is_old = at < old;
        at += line.len() as u64;
        let message = match lines.take(&String::from_utf8_lossy(&line)) {
            Ok(Some(reading)) if !is_old || reading.time_s.is_some() => Some(Ok(reading)),
            Ok(_) => None,
            Err(e) => Some(Err(format!("line {number}: {e}"))),
        };
        line.clear();
        if message.is_some_and(|m| send.send(m).is_err()) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn lines_are_read_in_both_forms() {
        let mut l = Lines::of(names());
        let values =
            |r: Reading| (r.time_s, r.values.iter().map(|v| if v.is_nan() { -1.0 } else { *v }).collect::<Vec<_>>());
        let known = names().join(", ");
        let unknown = LineError::Name { name: "humidity".into(), known };
        let mut read = |line: &str| l.take(line).map(|r| r.map(values));
        assert_eq!(read("case_x_c=1.5 chamber_c=-4"), Ok(Some((None, vec![1.5, -1.0, -1.0, -4.0]))));
        assert_eq!(read("time_s=7, shell_y_c=2;case_z_c=\n"), Ok(Some((Some(7.0), vec![-1.0, 2.0, -1.0, -1.0]))));
        assert_eq!(read("1,2"), Err(LineError::NoHeader));
        assert_eq!(read("time_s,chamber_c"), Ok(None));
        assert_eq!(read("3,25.5"), Ok(Some((Some(3.0), vec![-1.0, -1.0, -1.0, 25.5]))));
        assert_eq!(read("4,nan"), Ok(Some((Some(4.0), vec![-1.0; 4]))));
        assert_eq!((read(""), read("# a comment")), (Ok(None), Ok(None)));
        assert_eq!(read("1,2,3"), Err(LineError::NoHeader));
        assert_eq!(read("case_x_c=warm"), Err(LineError::Number("warm".into())));
        assert_eq!(read("humidity=3"), Err(unknown.clone()));
        assert_eq!(read("time_s,case_x_c,humidity"), Err(unknown.clone()));
    }

    #[test]
    fn a_reading_goes_into_one_row_and_old_ones_into_none() {
        let path = std::env::temp_dir().join(format!("hrg-sensors-{}.txt", std::process::id()));
        std::fs::write(&path, "case_x_c=99\ntime_s=2.5 case_y_c=7\ncase_x_c").expect("written");
        let mut s = Sensors::open(path.to_str().expect("text")).expect("there");
        let mut f = std::fs::File::options().append(true).open(&path).expect("there");
        // The line that had begun is complete now, and as old as its beginning; the next is new.
        f.write_all(b"=98\ncase_x_c=20.25 chamber_c=21\nnonsense\n").expect("written");
        let mut rows = Vec::new();
        for k in 1..200 {
            std::thread::sleep(Duration::from_millis(20));
            rows.push(s.at(f64::from(k)));
            if s.bad > 0 {
                break;
            }
        }
        rows.push(s.at(500.0));
        let _ = std::fs::remove_file(&path);
        let column = |k: usize| rows.iter().map(|r| r[k]).filter(|v| v.is_finite()).collect::<Vec<_>>();
        assert_eq!((column(0), column(3)), (vec![20.25], vec![21.0]), "once each, and nothing old");
        assert_eq!(column(1).len() + column(2).len(), column(1).iter().filter(|v| **v == 7.0).count());
        assert!(
            s.summary().starts_with("2 readings; 1 lines could not be read, the first: line 5: "),
            "{}",
            s.summary()
        );
        assert!(Sensors::open("/nowhere/at all").is_err() && Sensors::open("/tmp").is_err());
    }
}
