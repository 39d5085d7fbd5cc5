//! Reads the text of a recording, as it is. Strict about form: a missing column or text in a number ends with the line and column.

use super::columns::{self, Role};
use super::format::{named, Thermometer};
use super::{dialect, metadata, Cleaned, Defect, Recording};
use crate::BadInput;
use hrg_core::AXES;

impl Recording {
    /// Reads the text of a recording, as it is. Other dialects than plain CSV are read as [`dialect`] says.
    ///
    /// # Errors
    /// A sentence with line and column.
    pub fn parse(bytes: &[u8]) -> Result<Self, BadInput> {
        let text = utf8(bytes)?;
        if !dialect::is_plain(text) {
            return Self::parse_plain(&dialect::plain(text)?);
        }
        match Self::parse_plain(text) {
            // Quoted further down: the header does not tell.
            Err(_) if text.contains('"') => Self::parse_plain(&dialect::plain(text)?),
            result => result,
        }
    }

    fn parse_plain(text: &str) -> Result<Self, BadInput> {
        let bad = |s: String| Err(BadInput(s));
        let mut out = Self::default();
        let mut header: Option<Vec<Slot>> = None;
        let mut names: Vec<&str> = Vec::new();
        let mut metadata = metadata::Lines::default();
        let mut missing = Vec::new();
        let mut first_missing = None;
        let rows_guess = text.len() / 80;
        let (mut rest, mut number) = (text, 0);
        while let Some(first) = rest.bytes().next() {
            number += 1;
            // Nearly all lines: a row of data, taken off the front of the text without a look for its end.
            if let (Some(slots), b'0'..=b'9' | b'-') = (&header, first) {
                let row = Row { line: number, slots, names: &names };
                rest = out.row(row, rest, &mut missing, &mut first_missing)?;
                continue;
            }
            let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
            rest = after;
            let line = line.trim_end_matches('\r');
            if let Some(meta) = line.trim_start().strip_prefix('#') {
                metadata.take(number, meta)?;
            } else if line.trim().is_empty() {
            } else if let Some(slots) = &header {
                let row = Row { line: number, slots, names: &names };
                out.row(row, line, &mut missing, &mut first_missing)?;
            } else {
                names = line.split(',').map(str::trim).collect();
                header = Some(out.slots(&names, number, rows_guess, &metadata)?);
                missing = vec![0usize; names.len()];
            }
        }
        if header.is_none() {
            return bad("the file is empty: there is no header line; a recording begins with time_s,fx_hz,...".into());
        }
        metadata::check(&metadata.entries)?;
        out.meta = metadata.entries;
        out.complete()?;
        if let Some((line, column, name)) = first_missing {
            let total: usize = missing.iter().sum();
            out.notes.push(format!("{total} values are missing, the first at line {line}, column {column} ({name})"));
            for (name, count) in names.iter().zip(missing).filter(|(_, count)| *count > 0) {
                out.cleaned.push(Cleaned { column: (*name).to_string(), defect: Defect::Missing, count });
            }
        }
        Ok(out)
    }

    /// A recording of columns that are in memory: names as in a file ([`columns`]), values with NaN where missing.
    ///
    /// # Errors
    /// As [`Self::parse`] has them; columns of different lengths.
    pub fn from_columns(metadata: &[(String, String)], columns: Vec<(String, Vec<f64>)>) -> Result<Self, BadInput> {
        let (names, values): (Vec<String>, Vec<Vec<f64>>) = columns.into_iter().unzip();
        let rows = values.first().map_or(0, Vec::len);
        if let Some(k) = values.iter().position(|v| v.len() != rows) {
            return Err(BadInput(format!(
                "column {} has {} values, {} has {rows}; give columns of one length",
                names[k],
                values[k].len(),
                names[0]
            )));
        }
        let mut lines = metadata::Lines::default();
        for (n, (key, value)) in metadata.iter().enumerate() {
            lines.take(n + 1, &format!("{key}: {value}"))?;
        }
        let mut out = Self::default();
        let header: Vec<&str> = names.iter().map(String::as_str).collect();
        // (There are no lines to name.)
        let slots = out
            .slots(&header, 0, 0, &lines)
            .map_err(|e| BadInput(e.0.trim_start_matches("line 0: ").trim_start_matches("line 0, ").to_string()))?;
        metadata::check(&lines.entries)?;
        for ((slot, name), values) in slots.into_iter().zip(&names).zip(values) {
            let count = values.iter().filter(|v| v.is_nan()).count();
            if count > 0 && slot != Slot::Ignored {
                out.notes.push(format!("column {name}: {count} values are missing"));
                out.cleaned.push(Cleaned { column: name.clone(), defect: Defect::Missing, count });
            }
            out.place(slot, values);
        }
        out.meta = lines.entries;
        out.complete()?;
        Ok(out)
    }

    fn place(&mut self, slot: Slot, values: Vec<f64>) {
        match slot {
            Slot::Time => self.time_s = values,
            Slot::Reading(a) => self.frequency_hz[a] = values,
            Slot::Rate(a) => self.rate_dph[a] = values,
            Slot::Optional(k) => self.optional[k].1 = values,
            Slot::Status { k, .. } => {
                self.status.resize(values.len(), [0; 4]);
                self.status.iter_mut().zip(values).for_each(|(row, v)| row[k] = v as u16);
            }
            Slot::Ignored => {}
        }
    }

    /// Takes a row of data off the front of `text`; gives what follows it.
    fn row<'t>(
        &mut self,
        row: Row<'_>,
        text: &'t str,
        missing: &mut [usize],
        first_missing: &mut Option<(usize, usize, String)>,
    ) -> Result<&'t str, BadInput> {
        let bytes = text.as_bytes();
        let (mut at, mut cells) = (0, 0);
        loop {
            let slot = row.slots.get(cells).copied();
            cells += 1;
            let (value, end) = match plain_number(&bytes[at..]) {
                Some((value, n)) => (value, at + n),
                None => {
                    let end =
                        bytes[at..].iter().position(|b| matches!(b, b',' | b'\n')).map_or(bytes.len(), |n| at + n);
                    let value = match slot {
                        None | Some(Slot::Ignored) => 0.0,
                        Some(_) => row.number(text[at..end].trim(), cells)?,
                    };
                    (value, end)
                }
            };
            if let Some(slot) = slot.filter(|s| !matches!(s, Slot::Ignored)) {
                if value.is_nan() {
                    missing[cells - 1] += 1;
                    first_missing.get_or_insert_with(|| (row.line, cells, row.names[cells - 1].to_string()));
                }
                self.push(slot, value);
            }
            at = (end + 1).min(bytes.len());
            if bytes.get(end) != Some(&b',') {
                break;
            }
        }
        if cells != row.slots.len() {
            // A decimal comma makes two cells of one.
            let commas = if cells > row.slots.len() {
                " (numbers with decimal commas need semicolons between the cells)"
            } else {
                ""
            };
            return Err(BadInput(format!(
                "line {} has {cells} cells, the header has {}; mend or remove the line{commas}",
                row.line,
                row.slots.len()
            )));
        }
        Ok(&text[at..])
    }

    /// Gives times to rows that have none, and columns to axes that the file does not have.
    fn complete(&mut self) -> Result<(), BadInput> {
        let first = self.present().next().unwrap_or(0);
        let rows = self.rate_dph[first].len();
        if rows == 0 {
            return Err(BadInput::new("there is a header but no row of data; record something"));
        }
        if let Some(step) = self.meta(metadata::TIME_STEP).and_then(|v| v.parse::<f64>().ok()) {
            if !self.time_s.is_empty() {
                self.notes.push(format!(
                    "column time_s is not used: the metadata say that rows are {step} s apart, in their order"
                ));
            }
            self.time_s = (0..rows).map(|k| k as f64 * step).collect();
        }
        for a in 0..AXES {
            if self.absent[a] {
                (self.frequency_hz[a], self.rate_dph[a]) = (vec![f64::NAN; rows], vec![f64::NAN; rows]);
            } else if self.thermometer == Thermometer::None {
                self.frequency_hz[a] = vec![f64::NAN; rows];
            } else if self.thermometer == Thermometer::OneSensor && a != first {
                self.frequency_hz[a] = self.frequency_hz[first].clone();
            }
        }
        if self.absent.contains(&true) {
            let there = named(self.absent.map(|a| !a));
            self.notes.push(format!(
                "the recording has no other axes than {there}: what an effect needs from another is not offered"
            ));
        }
        Ok(())
    }

    fn slots(
        &mut self,
        names: &[&str],
        line: usize,
        rows: usize,
        metadata: &metadata::Lines,
    ) -> Result<Vec<Slot>, BadInput> {
        let commented = metadata.commented_header;
        let first = self.axes_of_header(names, line, metadata)?;
        if names.iter().all(|n| n.parse::<f64>().is_ok()) {
            return Err(BadInput(format!(
                "line {line} holds numbers where the header should be, the names of the columns{}",
                commented
                    .map_or(String::new(), |at| format!(": the header in line {at} begins with #, take the # away"))
            )));
        }
        let mut slots = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let name = columns::today(name);
            if names[..k].iter().any(|n| columns::today(n) == name) {
                return Err(BadInput(format!("line {line}, column {}: {name} is there twice; remove one", k + 1)));
            }
            let Some((column, a)) = columns::find(name) else {
                self.notes.push(format!("column {name} is not known and is ignored"));
                slots.push(Slot::Ignored);
                continue;
            };
            let slot = match column.role {
                Role::Time => Slot::Time,
                Role::Reading(t) if t == self.thermometer && t == Thermometer::OneSensor => Slot::Reading(first),
                Role::Reading(t) if t == self.thermometer && !self.absent[a] => Slot::Reading(a),
                Role::Reading(_) => {
                    self.notes.push(format!("column {name} is not used: {} the thermometer", self.says_thermometer()));
                    Slot::Ignored
                }
                Role::Rate => Slot::Rate(a),
                Role::Optional => {
                    self.optional.push((column.name(a), Vec::with_capacity(rows)));
                    Slot::Optional(self.optional.len() - 1)
                }
                Role::Status => Slot::Status {
                    k: if column.is_of_axes() { a } else { AXES },
                    first: !slots.iter().any(|s| matches!(s, Slot::Status { .. })),
                },
                Role::Computed => Slot::Ignored,
            };
            slots.push(slot);
        }
        Ok(slots)
    }

    /// Which columns are the thermometer, in words.
    fn says_thermometer(&self) -> &'static str {
        match self.thermometer {
            Thermometer::Frequency => {
                "the resonators' frequencies are (\"# thermometer: sensor\" would choose the sensors)"
            }
            Thermometer::Sensors => "the sensors temp_?_c are",
            Thermometer::OneSensor => "the sensor temp_c is",
            Thermometer::None => "the metadata say that nothing is",
        }
    }

    /// Decides what the thermometer is and which axes there are; gives the first axis.
    fn axes_of_header(&mut self, names: &[&str], line: usize, metadata: &metadata::Lines) -> Result<usize, BadInput> {
        let has = |wanted: &str| names.contains(&wanted);
        let any = |t: Thermometer| (0..AXES).any(|a| has(t.column(a)));
        let sensor = if any(Thermometer::Sensors) { Thermometer::Sensors } else { Thermometer::OneSensor };
        self.thermometer = match metadata.get("thermometer") {
            Some("sensor") => sensor,
            Some("none") => Thermometer::None,
            None if !any(Thermometer::Frequency) && any(sensor) => sensor,
            _ => Thermometer::Frequency,
        };
        let rate = |a: usize| columns::RATE.name(a);
        let time = columns::TIME.name(0);
        let there = |a: usize| has(rate(a)) || (self.thermometer.parts_axes() && has(self.thermometer.column(a)));
        // Names in capitals are an oversight, not an axis left out.
        let nearly = |a: usize| names.iter().any(|n| n.eq_ignore_ascii_case(rate(a)));
        self.absent = [0, 1, 2].map(|a| !(there(a) || nearly(a)));
        if !self.absent.contains(&false) {
            self.absent = [false; AXES];
        }
        let mut wanted = if metadata.get(metadata::TIME_STEP).is_some() { vec![] } else { vec![time] };
        if self.thermometer != Thermometer::None {
            wanted.extend(self.present().map(|a| self.thermometer.column(a)));
        }
        wanted.extend(self.present().map(rate));
        for name in wanted {
            if !names.contains(&name) {
                let advice = if name == time {
                    "rows that are evenly apart may have \"# time_step_s: SECONDS\" in its place"
                } else {
                    "a recording needs time_s, and for each axis rate_?_dph and f?_hz (or temp_?_c, or temp_c for all; \"# thermometer: none\" where there is none)"
                };
                return Err(BadInput(format!(
                    "line {line}: the column {name} is missing{}; {advice}; there are {}",
                    why_missing(name, names),
                    names.join(", ")
                )));
            }
        }
        Ok(self.present().next().unwrap_or(0))
    }

    fn push(&mut self, slot: Slot, value: f64) {
        match slot {
            Slot::Time => self.time_s.push(value),
            Slot::Reading(a) => self.frequency_hz[a].push(value),
            Slot::Rate(a) => self.rate_dph[a].push(value),
            Slot::Optional(k) => self.optional[k].1.push(value),
            Slot::Status { k, first } => {
                if first {
                    self.status.push([0; 4]);
                }
                if let Some(row) = self.status.last_mut() {
                    row[k] = value as u16;
                }
            }
            Slot::Ignored => {}
        }
    }
}

/// The text of a file, without its byte-order mark.
pub(crate) fn utf8(bytes: &[u8]) -> Result<&str, BadInput> {
    std::str::from_utf8(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)).map_err(|e| {
        let line = 1 + bytes[..e.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
        BadInput(format!("line {line} is not UTF-8 text; save the file as CSV in UTF-8"))
    })
}

/// What the header shows of why a column is missing.
fn why_missing(wanted: &str, names: &[&str]) -> String {
    if let Some(near) = names.iter().find(|n| n.eq_ignore_ascii_case(wanted)) {
        return format!(" (there is {near}: names are written in small letters)");
    }
    if let [one] = names {
        if one.contains('|') || one.split_whitespace().count() > 2 {
            return " (put commas, semicolons or tabs between the cells)".into();
        }
    }
    String::new()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Slot {
    Time,
    /// Of an axis' thermometer.
    Reading(usize),
    Rate(usize),
    Optional(usize),
    /// Of an axis or the unit; the first such column of the file.
    Status {
        k: usize,
        first: bool,
    },
    Ignored,
}

/// What is known of a row before it is read.
#[derive(Clone, Copy)]
struct Row<'a> {
    line: usize,
    slots: &'a [Slot],
    names: &'a [&'a str],
}

impl Row<'_> {
    /// A cell that is not a plain number: missing, with an exponent, very long, or wrong.
    fn number(&self, cell: &str, column: usize) -> Result<f64, BadInput> {
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
            BadInput(format!(
                "line {}, column {column} ({}): \"{}\" is not a number; mend or empty the cell",
                self.line,
                self.names.get(column - 1).unwrap_or(&""),
                shorten(cell)
            ))
        })
    }
}

/// Powers of ten that an f64 holds exactly.
const EXACT: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// A number of at most 15 digits, with or without sign and point, and the place of the comma or line feed that ends it. Such a
/// number is a quotient of two that an f64 holds exactly, so that one division gives what the standard library's parser gives.
#[inline]
fn plain_number(bytes: &[u8]) -> Option<(f64, usize)> {
    let negative = bytes.first() == Some(&b'-');
    let start = usize::from(negative);
    let (mut mantissa, mut point, mut at) = (0u64, None, start);
    while let Some(&b) = bytes.get(at) {
        match b {
            b'0'..=b'9' => mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(b - b'0')),
            b'.' if point.is_none() => point = Some(at),
            b',' | b'\n' => break,
            b'\r' if matches!(bytes.get(at + 1), None | Some(b'\n')) => break,
            _ => return None,
        }
        at += 1;
    }
    let digits = at - start - usize::from(point.is_some());
    if digits == 0 || digits > 15 {
        return None;
    }
    let value = mantissa as f64 / EXACT[point.map_or(0, |p| at - p - 1)];
    let end = at + usize::from(bytes.get(at) == Some(&b'\r'));
    Some((if negative { -value } else { value }, end))
}

fn shorten(cell: &str) -> String {
    cell.chars().take(24).collect()
}

#[cfg(test)]
mod tests {
    use super::super::samples::{rows, HEAD};
    use super::*;
    use std::fmt::Write as _;

    fn error(text: &str) -> String {
        match Recording::parse(text.as_bytes()) {
            Err(e) => e.0,
            Ok(mut r) => r.clean().expect_err("must be refused").0,
        }
    }

    #[test]
    fn each_defect_gets_one_sentence_with_its_place() {
        assert!(error("").contains("empty"));
        assert!(error(HEAD).contains("no row"));
        assert!(error("time_s,fx_hz\n1,2\n").contains("rate_x_dph is missing"));
        let text = rows(20).replace("5,4900", "5,hello");
        assert!(error(&text).starts_with("line 8, column 2 (fx_hz): \"hello"), "{}", error(&text));
        assert!(error(&(rows(20) + "21,1,2\n")).contains("line 23 has 3 cells"));
        let mut back = HEAD.to_string();
        for k in (0..20).rev() {
            let _ = writeln!(back, "{k},1,2,3,4,5,6");
        }
        assert!(error(&back).contains("time_s"));
        assert!(Recording::parse(b"\xff\xfe\x00").expect_err("not text").0.contains("line 1"));
        assert!(error(&rows(20).replace("# unit: A", "# rate_unit: rad/s")).contains("deg/h"));
    }

    #[test]
    fn plain_numbers_are_what_the_standard_library_reads() {
        let mut draws = crate::numeric::draws::Draws::new(1);
        for k in 0..200_000u32 {
            let x = draws.bits();
            let value = (x >> 12) as f64 / EXACT[(x % 16) as usize] * if k % 2 == 0 { -1e-4 } else { 1e-4 };
            let text = format!("{value:.*}", (x % 13) as usize);
            let wanted: f64 = text.parse().expect("a number");
            for (end, more) in [("", 0), (",1", 0), ("\n", 0), ("\r\n", 1), ("\r", 1)] {
                match plain_number(format!("{text}{end}").as_bytes()) {
                    Some((v, at)) => assert_eq!((v.to_bits(), at), (wanted.to_bits(), text.len() + more), "{text}"),
                    None => assert!(text.len() > 15, "{text}"),
                }
            }
        }
        for odd in ["", "-", ".", "1e5", "+1", "0x1", "inf", "1.2.3", " 1", "1 ", "--1", "1_0", "1\r\r\n", "1\r2"] {
            assert_eq!(plain_number(odd.as_bytes()), None, "{odd}");
        }
    }
}
