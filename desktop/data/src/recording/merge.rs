//! A chamber's own log into a recording, by time: `hrg import --with`.
//!
//! The rows of the recording stay as they are, with all their columns; values of the log are put beside them on straight lines between its
//! rows. Cells stay empty if the log has a gap, or has not begun.

use crate::error::BadInput;
use crate::numeric::stats::median;
use crate::recording::dialect;
use crate::recording::dialect::is_missing;
use crate::recording::import::map::{conversion, quantity_of};
use crate::recording::thermometer::Thermometer;
use crate::recording::time_form::{Days, TimeForm, DAY_S, FORMS};
use crate::recording::{columns, Recording};
use std::fmt::Write as _;

/// Neighbouring rows of a log that are further apart than so many usual steps have a gap between them.
const GAP_STEPS: f64 = 5.0;

/// Why a log cannot be merged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MergeError {
    /// `--time` or `--columns` that cannot be read.
    #[error("{0}")]
    Usage(String),
    /// A column is missing.
    #[error("there is no column {wanted}; its columns are {there}")]
    NoColumn {
        /// Wanted.
        wanted: String,
        /// Columns that the log has.
        there: String,
    },
    /// The recording has values there already.
    #[error("the recording has values in {0} already; rename that column, or merge under another name")]
    Taken(String),
    /// A time that cannot be read.
    #[error("line {line}: \"{text}\" is not a time of the form {format}")]
    Time {
        /// Line.
        line: usize,
        /// Text of the cell.
        text: String,
        /// Format that was expected.
        format: String,
    },
    /// A value that is none.
    #[error("line {line}: \"{text}\" in column {column} is not a number; correct or empty the cell")]
    Value {
        /// Line.
        line: usize,
        /// Column.
        column: String,
        /// Text of the cell.
        text: String,
    },
    /// Too short.
    #[error("it has {0} rows with a time that increases; at least two are needed")]
    Short(usize),
    /// The clocks have nothing to do with each other.
    #[error("its times are of a clock of its own, and the recording does not say when its power-on was; give what that clock showed then with --power-on TIME")]
    NoPowerOn,
    /// No common time.
    #[error("the times do not overlap: the recording runs from {run_from:.0} to {run_to:.0} s, the log, on the recording's clock, from {log_from:.0} to {log_to:.0} s; give --power-on TIME or --offset SECONDS")]
    NoOverlap {
        /// Of the recording, s.
        run_from: f64,
        /// Of the recording, s.
        run_to: f64,
        /// Of the log, s.
        log_from: f64,
        /// Of the log, s.
        log_to: f64,
    },
}

impl From<MergeError> for BadInput {
    fn from(e: MergeError) -> Self {
        Self(e.to_string())
    }
}

/// Options of a merge.
#[derive(Debug, Clone)]
pub struct Wanted {
    /// Column of the log's times; two with + between them, where date and time of day stand apart.
    pub time: String,
    /// Format of these times.
    pub format: TimeForm,
    /// Time of the log's clock at the unit's power-on, written as its times are.
    pub power_on: Option<String>,
    /// Added to the log's times, s.
    pub offset_s: f64,
    /// Columns: the recording's name, the log's name.
    pub columns: Vec<(String, String)>,
    /// Units of these columns in the log; `None`: that of the recording, or what the name of the column says.
    pub units: Vec<Option<String>>,
    /// Rows of the log that are further apart have a gap between them, s; `None`: five usual steps.
    pub gap_s: Option<f64>,
}

impl Wanted {
    /// From `COLUMN[=FORMAT]` and `name=column` or `name=column in UNIT` items.
    ///
    /// # Errors
    /// Names that no recording has, units that the quantity does not have, and forms that no time has.
    pub fn parse(time: &str, columns: &[String]) -> Result<Self, MergeError> {
        let (column, format) = time.split_once('=').unwrap_or((time, "s"));
        let (mut pairs, mut units): (Vec<(String, String)>, Vec<Option<String>>) = Default::default();
        for item in columns {
            let Some((ours, theirs)) = item.split_once('=') else {
                return Err(MergeError::Usage(format!(
                    "--columns: \"{item}\" is not of the form chamber_c=Temperature"
                )));
            };
            let ours = columns::today(ours.trim());
            if !(columns::optional().any(|o| o == ours) || is_thermometer(ours)) {
                return Err(MergeError::Usage(format!(
                    "--columns: a recording has no column {ours}; there are temp_?_c, temp_c, {}",
                    columns::optional_names()
                )));
            }
            if pairs.iter().any(|(o, _)| o == ours) {
                return Err(MergeError::Usage(format!("--columns: {ours} is named twice")));
            }
            let (theirs, unit) = match theirs.rsplit_once(" in ") {
                Some((name, unit)) => (name, Some(unit.trim().to_string())),
                None => (theirs, None),
            };
            conversion(quantity(ours), unit.as_deref()).map_err(|e| MergeError::Usage(format!("--columns: {e}")))?;
            units.push(unit);
            pairs.push((ours.into(), theirs.trim().into()));
        }
        Ok(Self {
            time: column.trim().into(),
            format: TimeForm::parse(format.trim()).ok_or_else(|| {
                MergeError::Usage(format!("--time: \"{}\" is no form of a time; there are {FORMS}", format.trim()))
            })?,
            power_on: None,
            offset_s: 0.0,
            columns: pairs,
            units,
            gap_s: None,
        })
    }

    /// The same with day and month changed about in its dates, where they have both in numbers.
    #[must_use]
    pub fn other_order(&self) -> Option<Self> {
        let TimeForm::Pattern(p) = &self.format else { return None };
        let other = match p {
            p if p.contains("%d/%m") => p.replace("%d/%m", "%m/%d"),
            p if p.contains("%m/%d/") => p.replace("%m/%d", "%d/%m"),
            _ => return None,
        };
        Some(Self { format: TimeForm::Pattern(other), ..self.clone() })
    }

    /// Takes the units that a log's own header names for columns whose unit was not given; gives a note on each that is converted.
    pub fn take_units(&mut self, of: impl Fn(&str) -> Option<&'static str>) -> Vec<String> {
        let mut notes = Vec::new();
        for ((ours, theirs), unit) in self.columns.iter().zip(&mut self.units) {
            let known = of(theirs).filter(|u| conversion(quantity(ours), Some(u)).is_ok_and(|c| c != (1.0, 0.0)));
            if let (None, Some(known)) = (&unit, known) {
                notes.push(format!(
                    "column {theirs} is converted from {known}; \"{ours}={theirs} in UNIT\" says another one"
                ));
                *unit = Some(known.to_string());
            }
        }
        notes
    }
}

/// Physical quantity of a column that may come from a log.
fn quantity(ours: &str) -> &'static str {
    if is_thermometer(ours) {
        "temperature"
    } else {
        quantity_of(ours)
    }
}

/// `true` for the readings of a thermometer, which a recording without one may get.
fn is_thermometer(name: &str) -> bool {
    columns::SENSOR.names.iter().chain(columns::ONE_SENSOR.names).any(|n| *n == name)
}

/// A log as it was read: time on its own clock, and the wanted columns.
struct Log {
    time_s: Vec<f64>,
    columns: Vec<Vec<f64>>,
    left_out: usize,
    /// Cells that hold neither a number nor a known text for none: the column, and the text.
    texts: Vec<(usize, String)>,
}

/// Names of the columns in a line.
fn names(line: &str) -> Vec<&str> {
    line.split(',').map(str::trim).collect()
}

impl Log {
    /// Reads the wanted columns. Lines before the header (a title, settings) are skipped.
    fn read(text: &str, wanted: &Wanted) -> Result<Self, BadInput> {
        let mut before = 0;
        let mut rest = text;
        // The header is the first line in which the name of the time column is a cell.
        while let Some(line) = rest.split_inclusive('\n').next() {
            let cells = line.trim_end().split([',', ';', '\t']).map(|c| c.trim().trim_matches('"').trim());
            if cells.into_iter().any(|c| c == wanted.time || wanted.time.split('+').any(|t| t == c)) {
                break;
            }
            before += 1;
            rest = &rest[line.len()..];
        }
        let first = text.lines().find(|l| l.contains([',', ';', '\t'])).unwrap_or("").trim();
        let none = |wanted: &str, there: &str| MergeError::NoColumn { wanted: wanted.into(), there: there.into() };
        if rest.is_empty() {
            return Err(none(&wanted.time, first).into());
        }
        let plain = if dialect::is_plain(rest) && !rest.contains('"') { rest.into() } else { dialect::plain(rest)? };
        let mut lines = plain.lines().enumerate().filter(|(_, l)| !l.trim().is_empty() && !l.starts_with('#'));
        let header = lines.next().map_or("", |(_, l)| l);
        let names = names(header);
        let at = |name: &str| names.iter().position(|n| *n == name).ok_or_else(|| none(name, header));
        let times = match at(&wanted.time) {
            Ok(one) => vec![one],
            Err(e) if !wanted.time.contains('+') => return Err(e.into()),
            Err(_) => wanted.time.split('+').map(|t| at(t.trim())).collect::<Result<Vec<_>, _>>()?,
        };
        let columns = wanted.columns.iter().map(|(_, theirs)| at(theirs)).collect::<Result<Vec<_>, _>>()?;
        let mut log = Self { time_s: vec![], columns: vec![vec![]; columns.len()], left_out: 0, texts: vec![] };
        let mut first_text: Vec<Option<MergeError>> = columns.iter().map(|_| None).collect();
        let (mut last, mut days) = (f64::NEG_INFINITY, Days::default());
        for (k, line) in lines {
            let number = before + k + 1;
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let cell = |at: usize| cells.get(at).copied().unwrap_or("");
            let time = times.iter().map(|at| cell(*at)).collect::<Vec<_>>().join(" ");
            let Some(mut t) = wanted.format.read(&time) else {
                if is_missing(time.trim()) {
                    log.left_out += 1;
                    continue;
                }
                let (text, format) = (time.chars().take(32).collect(), wanted.format.name());
                return Err(MergeError::Time { line: number, text, format }.into());
            };
            if wanted.format.of_a_day() {
                t = days.next(t, &wanted.format);
            }
            let mut values = Vec::new();
            for (n, (c, (_, theirs))) in columns.iter().zip(&wanted.columns).enumerate() {
                let text = || cell(*c).chars().take(24).collect::<String>();
                let v = value(cell(*c));
                if v.is_none() {
                    log.texts.push((n, text()));
                    first_text[n].get_or_insert_with(|| MergeError::Value {
                        line: number,
                        column: theirs.clone(),
                        text: text(),
                    });
                }
                values.push(v.unwrap_or(f64::NAN));
            }
            if t <= last {
                log.left_out += 1;
                continue;
            }
            last = t;
            log.time_s.push(t);
            log.columns.iter_mut().zip(values).for_each(|(to, v)| to.push(v));
        }
        // Some texts are readings that failed; a column of texts is another column than was meant.
        let most = |n: usize| 2 * log.texts.iter().filter(|t| t.0 == n).count() > log.time_s.len();
        if let Some(e) = first_text.into_iter().enumerate().find_map(|(n, e)| e.filter(|_| most(n))) {
            return Err(e.into());
        }
        if log.time_s.len() < 2 {
            return Err(MergeError::Short(log.time_s.len()).into());
        }
        Ok(log)
    }
}

/// A cell: NaN where it is empty, `None` where it is no number.
fn value(cell: &str) -> Option<f64> {
    if is_missing(cell) {
        return Some(f64::NAN);
    }
    cell.parse().ok().filter(|v: &f64| v.is_finite())
}

/// A recording with columns of a log.
#[derive(Debug)]
pub struct Merged {
    /// The file.
    pub text: String,
    /// Rows of the recording.
    pub rows: usize,
    /// Of each column, how many of them got a value.
    pub filled: Vec<(String, usize)>,
    /// Notes of the merge.
    pub notes: Vec<String>,
}

/// Values on straight lines between the points of a log, at increasing times; NaN in gaps and beyond the ends.
fn between(log_s: &[f64], values: &[f64], gap_s: f64, times: &[f64]) -> Vec<f64> {
    let points: Vec<(f64, f64)> =
        log_s.iter().copied().zip(values.iter().copied()).filter(|(_, v)| v.is_finite()).collect();
    times
        .iter()
        .map(|t| {
            let after = points.partition_point(|(p, _)| p < t);
            match (after.checked_sub(1).and_then(|k| points.get(k)), points.get(after)) {
                (_, Some((at, v))) if at == t => *v,
                (Some((a, x)), Some((b, y))) if b - a <= gap_s => x + (y - x) * (t - a) / (b - a),
                _ => f64::NAN,
            }
        })
        .collect()
}

/// Merges. `run` and `log` are the files as they are; `source` names the log in the metadata.
///
/// # Errors
/// [`MergeError`]; and what [`Recording::parse`] refuses. Sentences about the log do not name it.
pub fn merge(run: &str, log: &str, source: &str, wanted: &Wanted) -> Result<Merged, BadInput> {
    let r = Recording::parse(run.as_bytes())?;
    let plain = if dialect::is_plain(run) { run.to_string() } else { dialect::plain(run)? };
    let mut table = Log::read(log, wanted)?;
    let form = || MergeError::Usage(format!("--power-on: not of the form {}", wanted.format.name()));
    let power_on = match &wanted.power_on {
        Some(text) => Some(wanted.format.read(text).ok_or_else(form)?),
        None if wanted.format.counts_from_1970(table.time_s[0]) => {
            Some(r.meta("power_on_unix_s").and_then(|v| v.parse().ok()).ok_or(MergeError::NoPowerOn)?)
        }
        // A time of day belongs to the day of the recording.
        None if wanted.format.of_a_day() => {
            let unix = r.meta("power_on_unix_s").and_then(|v| v.parse::<f64>().ok()).ok_or(MergeError::NoPowerOn)?;
            Some(unix.rem_euclid(DAY_S))
        }
        None => None,
    };
    // On the recording's clock.
    let shift_s = wanted.offset_s + power_on.map_or(0.0, |p: f64| r.power_on_s() - p);
    table.time_s.iter_mut().for_each(|t| *t += shift_s);
    if wanted.power_on.is_none() && wanted.format.of_a_day() {
        let middle = |t: &[f64]| 0.5 * (t.first().unwrap_or(&0.0) + t.last().unwrap_or(&0.0));
        let days = ((middle(&r.time_s) - middle(&table.time_s)) / DAY_S).round();
        table.time_s.iter_mut().for_each(|t| *t += days * DAY_S);
    }
    let finite = || r.time_s.iter().copied().filter(|t| t.is_finite());
    let (run_from, run_to) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    let (log_from, log_to) = (table.time_s[0], table.time_s[table.time_s.len() - 1]);
    if !(log_from <= run_to && log_to >= run_from) {
        return Err(MergeError::NoOverlap { run_from, run_to, log_from, log_to }.into());
    }
    let mut steps: Vec<f64> = table.time_s.windows(2).map(|w| w[1] - w[0]).collect();
    let usual = median(&mut steps).unwrap_or(1.0);
    let gap_s = wanted.gap_s.unwrap_or(GAP_STEPS * usual);
    let mut notes = Vec::new();
    if table.left_out > 0 {
        notes.push(format!("{} rows of the log have no time, or one that does not increase: left out", table.left_out));
    }
    let gaps = table.time_s.windows(2).filter(|w| w[1] - w[0] > gap_s).count();
    if gaps > 0 {
        notes.push(format!("the log has {gaps} gaps of more than {gap_s:.0} s: left empty"));
    }
    // A clock in another time zone is off by hours at both ends.
    let (ahead, behind) = (log_from - run_from, log_to - run_to);
    let hours = (0.5 * (ahead + behind) / 3600.0).round();
    let near = |t: f64| (t - 3600.0 * hours).abs() < 0.05 * (run_to - run_from).min(3600.0 * 4.0);
    if hours != 0.0 && near(ahead) && near(behind) && wanted.offset_s == 0.0 {
        notes.push(format!(
            "the log begins and ends {hours} h after the recording: if its clock is in another time zone, give --offset {}",
            -3600.0 * hours
        ));
    }
    if !table.texts.is_empty() {
        notes.push(format!("{} cells hold no number, as \"{}\": left empty", table.texts.len(), table.texts[0].1));
    }
    let mut added = Vec::new();
    let mut filled = Vec::new();
    for (((ours, _), unit), values) in wanted.columns.iter().zip(&wanted.units).zip(&mut table.columns) {
        let (factor, offset) = conversion(quantity(ours), unit.as_deref())?;
        values.iter_mut().for_each(|v| *v = *v * factor + offset);
        let none = |v: &&mut f64| quantity(ours) == "temperature" && !(-273.15..500.0).contains(*v) && v.is_finite();
        let outside: Vec<&mut f64> = values.iter_mut().filter(none).collect();
        if !outside.is_empty() {
            notes.push(format!(
                "{ours}: {} values, as {:.1} C, are no temperatures of a gyro: left empty",
                outside.len(),
                outside[0]
            ));
        }
        outside.into_iter().for_each(|v| *v = f64::NAN);
        let taken = is_thermometer(ours) && r.thermometer != Thermometer::None;
        if taken || r.column(ours).is_some_and(|c| c.iter().any(|v| v.is_finite())) {
            return Err(MergeError::Taken(ours.clone()).into());
        }
        let column = between(&table.time_s, values, gap_s, &r.time_s);
        filled.push((ours.clone(), column.iter().filter(|v| v.is_finite()).count()));
        added.push((ours.as_str(), column));
    }
    let text = beside(&plain, source, &added);
    Ok(Merged { text, rows: r.time_s.len(), filled, notes })
}

/// `true` for the line of metadata by which a recording has no thermometer.
fn is_none(line: &str) -> bool {
    line.strip_prefix('#')
        .and_then(|l| l.split_once(':'))
        .is_some_and(|(k, v)| k.trim() == "thermometer" && v.trim() == "none")
}

/// The text of a recording with columns added; one that is there and empty is filled.
fn beside(plain: &str, source: &str, added: &[(&str, Vec<f64>)]) -> String {
    let mut out = String::with_capacity(plain.len() + plain.len() / 4);
    // Of each column added: where it stands already.
    let mut there: Option<Vec<Option<usize>>> = None;
    let mut row = 0;
    let thermometer = added.iter().any(|(ours, _)| is_thermometer(ours));
    for line in plain.lines() {
        let line = line.trim_end_matches('\r');
        if thermometer && is_none(line) {
            out.push_str("# thermometer: sensor");
        } else if line.trim_start().starts_with('#') || line.trim().is_empty() {
            out.push_str(line);
        } else if let Some(there) = &there {
            let mut cells: Vec<String> = line.split(',').map(String::from).collect();
            for ((_, column), at) in added.iter().zip(there) {
                let v = column.get(row).copied().unwrap_or(f64::NAN);
                let text = if v.is_finite() { format!("{v:.4}") } else { String::new() };
                match at {
                    Some(at) => cells[*at] = text,
                    None => cells.push(text),
                }
            }
            out.push_str(&cells.join(","));
            row += 1;
        } else {
            let names = names(line);
            let at = |ours: &str| names.iter().position(|n| columns::today(n) == ours);
            let places: Vec<Option<usize>> = added.iter().map(|(ours, _)| at(ours)).collect();
            let list: Vec<&str> = added.iter().map(|(ours, _)| *ours).collect();
            let _ = writeln!(out, "# merged: {} from {source}", list.join(" "));
            out.push_str(line);
            for ((ours, _), _) in added.iter().zip(&places).filter(|(_, p)| p.is_none()) {
                out.push(',');
                out.push_str(ours);
            }
            there = Some(places);
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUN: &str = "# unit: A\n# power_on_unix_s: 1795255200\ntime_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph,temperature_x_c,chamber_c\n";

    fn run() -> String {
        (1..=20).fold(RUN.to_string(), |s, k| s + &format!("{k},4900.1,4890.1,4700.1,1,2,3,{k}.5,\n"))
    }

    fn wanted(time: &str) -> Wanted {
        Wanted::parse(time, &["chamber_c=Temp".into(), "case_x_c=S1".into()]).expect("fine")
    }

    fn column(text: &str, name: &str) -> Vec<f64> {
        Recording::parse(text.as_bytes()).expect("a recording").column(name).expect("there").to_vec()
    }

    #[test]
    fn straight_lines_between_the_logs_rows_and_nothing_in_gaps() {
        let log = "Chamber 7\nset;25\n\nZeit;Temp;S1\n2;20,5;1\n4;21,5;\n6;22,5;3\n14;30;5\n16;31;6\n";
        let w = Wanted { gap_s: Some(5.0), ..wanted("Zeit") };
        let m = merge(&run(), log, "log.csv", &w).expect("merges");
        let chamber = column(&m.text, "chamber_c");
        for (k, v) in chamber.iter().enumerate() {
            let t = k as f64 + 1.0;
            let truth = match t {
                2.0..=6.0 => 20.5 + 0.5 * (t - 2.0),
                14.0..=16.0 => 30.0 + 0.5 * (t - 14.0),
                _ => f64::NAN,
            };
            assert!((v - truth).abs() < 1e-9 || (v.is_nan() && truth.is_nan()), "{t} s: {v}, {truth}");
        }
        assert_eq!(column(&m.text, "case_x_c")[2], 1.5, "over an empty cell");
        assert_eq!(m.filled, [("chamber_c".to_string(), 8), ("case_x_c".to_string(), 8)]);
        assert!(m.text.contains("# merged: chamber_c case_x_c from log.csv\n") && m.text.contains("\n7,4900.1,"));
        assert!(m.text.lines().filter(|l| !l.starts_with('#')).all(|l| l.split(',').count() == 10));
        assert!(m.notes[0].contains("1 gaps of more than 5 s"), "{:?}", m.notes);
        assert!(merge(&m.text, log, "log.csv", &w).expect_err("refused").0.contains("values in chamber_c already"));
    }

    #[test]
    fn clocks_of_every_form_come_to_the_recordings() {
        let of = |time: &str, power_on: Option<&str>, offset_s: f64, stamps: [&str; 2]| {
            let log = format!("{time_column},Temp,S1\n{},10,1\n{},30,3\n", stamps[0], stamps[1], time_column = "when");
            let w = Wanted { power_on: power_on.map(String::from), offset_s, gap_s: Some(60.0), ..wanted(time) };
            merge(&run(), &log, "log", &w).map(|m| column(&m.text, "chamber_c")[9])
        };
        // Each: from 5 s (10 C) to 15 s (30 C) of the run, so 20 C at 10 s.
        for (time, power_on, offset, stamps) in [
            ("when", None, 0.0, ["5", "15"]),
            ("when=ms", None, 0.0, ["5000", "15000"]),
            ("when=s", Some("100"), 0.0, ["105", "115"]),
            ("when=min", None, -60.0, ["1.0833333333333333", "1.25"]),
            ("when=unix", None, 0.0, ["1795255205", "1795255215"]),
            ("when=iso", None, 0.0, ["2026-11-21T10:00:05", "2026-11-21 10:00:15.0"]),
            ("when=iso", None, 0.0, ["2026-11-21T18:00:05+08:00", "2026-11-21T10:00:15Z"]),
            ("when=iso", None, -28_800.0, ["2026-11-21T18:00:05", "2026-11-21T18:00:15"]),
            ("when=%d.%m.%Y %H:%M:%S", None, 0.0, ["21.11.2026 10:00:05", "21.11.2026 10:00:15"]),
            ("when=%d.%m.%Y %H:%M:%S %z", None, 0.0, ["21.11.2026 18:00:05 +0800", "21.11.2026 11:00:15 +0100"]),
            ("when=%H:%M:%S", Some("23:59:50"), 0.0, ["23:59:55", "00:00:05"]),
            ("when=%H:%M:%S", None, 0.0, ["10:00:05", "10:00:15"]),
        ] {
            let v = of(time, power_on, offset, stamps).unwrap_or_else(|e| panic!("{time}: {e}"));
            assert!((v - 20.0).abs() < 1e-3, "{time} {power_on:?}: {v}");
        }
        for (time, stamps, says) in [
            ("when", ["5", "soon"], "line 3: \"soon\" is not a time"),
            ("when=iso", ["5", "6"], "2026-11-21T10:15:00"),
            (
                "when",
                ["500", "600"],
                "recording runs from 1 to 20 s, the log, on the recording's clock, from 500 to 600 s",
            ),
            ("when", ["5", "5"], "1 rows"),
        ] {
            let e = of(time, None, 0.0, stamps).expect_err(says).0;
            assert!(e.contains(says), "{time}: {e}");
        }
        assert!(of("when=iso", Some("noon"), 0.0, ["5", "6"]).is_err());
        let untold = run().replace("# power_on_unix_s: 1795255200\n", "");
        let log = "when,Temp,S1\n1795255205,1,2\n1795255206,1,2\n";
        assert!(merge(&untold, log, "log", &wanted("when=unix")).expect_err("refused").0.contains("--power-on"));
    }

    #[test]
    fn a_thermometer_may_come_from_the_log() {
        let run: String = (1..=20)
            .fold("# thermometer: none\n# power_on_unix_s: 1795255200\ntime_s,rate_x_dph\n".into(), |s, k| {
                s + &format!("{k},1\n")
            });
        let log = "Datum;Uhrzeit;Pt\n21.11.2026;10:00:01;20,5\n21.11.2026;10:00:11;#NV\n21.11.2026;10:00:20;40\n";
        let w = Wanted::parse("Datum+Uhrzeit=%d.%m.%Y %H:%M:%S", &["temp_c=Pt".into()]).expect("fine");
        let w = Wanted { gap_s: Some(60.0), ..w };
        let r = Recording::parse(merge(&run, log, "log", &w).expect("merges").text.as_bytes()).expect("a recording");
        assert_eq!((r.thermometer, r.frequency_hz[0][0], r.frequency_hz[0][19]), (Thermometer::OneSensor, 20.5, 40.0));
        let with_resonators = merge(&self::run(), log, "log", &w).expect_err("it has a thermometer").0;
        assert!(with_resonators.contains("temp_c already"), "{with_resonators}");
    }

    #[test]
    fn units_of_a_log_are_converted() {
        let log = "t,T_K [K],U\n1,293.15,5000\n20,303.15,5000\n";
        let mut w = Wanted::parse("t", &["chamber_c=T_K [K]".into(), "supply_v=U in mV".into()]).expect("fine");
        w.gap_s = Some(60.0);
        assert_eq!(w.take_units(|name| name.ends_with("[K]").then_some("K")).len(), 1);
        let m = merge(&run(), log, "log", &w).expect("merges");
        assert!((column(&m.text, "chamber_c")[0] - 20.0).abs() < 1e-9, "{}", column(&m.text, "chamber_c")[0]);
        assert_eq!(column(&m.text, "supply_v")[3], 5.0);
        let e = Wanted::parse("t", &["chamber_c=T in Hz".into()]).expect_err("no unit of a temperature").to_string();
        assert!(e.contains("\"Hz\" is no unit of a temperature; there are C, K, mC, F"), "{e}");
    }

    #[test]
    fn what_is_asked_for_must_be_there() {
        for (time, columns, says) in [
            ("t=never", "chamber_c=T", "no form of a time"),
            ("t", "oven_c=T", "no column oven_c"),
            ("t", "chamber_c", "of the form"),
        ] {
            let e = Wanted::parse(time, &[columns.into()]).expect_err(says).to_string();
            assert!(e.contains(says), "{e}");
        }
        let twice = ["chamber_c=a".to_string(), "chamber_c=b".to_string()];
        assert!(Wanted::parse("t", &twice).expect_err("refused").to_string().contains("twice"));
        let e = |log: &str| merge(&run(), log, "log", &wanted("t")).expect_err("refused").0;
        assert!(e("x,Temp,S1\n1,2,3\n").contains("no column t; its columns are x,Temp,S1"));
        assert!(e("t,Temp\n1,2\n").contains("no column S1"));
        assert!(e("t,Temp,S1\n1,cold,none\n2,warm,3\n").contains("line 2: \"cold\" in column Temp"));
        let some = merge(&run(), "t,Temp,S1\n1,2,3\n2,OPEN,3\n5,850,3\n20,2,3\n", "log", &wanted("t")).expect("merges");
        assert!(some.notes.iter().any(|n| n.contains("1 cells hold no number, as \"OPEN\"")), "{:?}", some.notes);
        assert!(some.notes.iter().any(|n| n.contains("chamber_c: 1 values, as 850.0 C")), "{:?}", some.notes);
        assert!(e("").contains("no column t"));
    }
}
