//! Reads the text of a recording, as it is. Strict about form: a missing column or text in a number ends with the line and column.

use super::columns::{self, Role};
use super::lines::{self, not_text, Lines};
use super::resonators::named;
use super::rows::Header;
use super::thermometer::Thermometer;
use super::{dialect, metadata, parquet, Cleaned, Defect, Recording};
use crate::error::BadInput;
use hrg_core::AXES;
use std::io::Read;
use std::path::Path;

/// Bytes that a thread reads at once: they and what comes of them stay close to the processor.
const PIECE: usize = 1 << 20;

/// Files that are smaller are read as a whole.
const LARGE: u64 = 8 << 20;

impl Recording {
    /// Reads a file, as it is: text, packed or not, or Parquet.
    ///
    /// # Errors
    /// A sentence with the file, line and column.
    pub fn read(path: &Path) -> Result<Self, BadInput> {
        if let Some(read) = Self::read_reduced(path) {
            return read.map_err(|e| BadInput::new(format!("{}: {e}", path.display())));
        }
        if let Some(read) = Self::read_large(path) {
            return Ok(read);
        }
        Self::parse(&parquet::read_text(path)?).map_err(|e| BadInput::new(format!("{}: {e}", path.display())))
    }

    /// Reads a large file of plain text while it is loaded, so that it is never in memory as a whole. `None` for all others, and for
    /// whatever cannot be read so: [`Self::parse`] knows why, and more dialects.
    fn read_large(path: &Path) -> Option<Self> {
        let file = std::fs::File::open(path).ok()?;
        let size = file.metadata().ok().filter(std::fs::Metadata::is_file)?.len();
        if !(LARGE..=crate::files::MOST_RECORDING).contains(&size) || parquet::begins_as_parquet(path) {
            return None;
        }
        // (Rows are about as long as the first ones. All of them are counted if they become much shorter.)
        let about =
            |first: &[u8]| (1.1 * size as f64 * lines::count(first) as f64 / first.len() as f64) as usize + 1000;
        Self::stream(Lines::new(file, size, PIECE), true, about).ok().flatten()
    }

    /// Reads the text of a recording, as it is. Other dialects than plain CSV are read as [`dialect`] says.
    ///
    /// # Errors
    /// A sentence with line and column.
    pub fn parse(bytes: &[u8]) -> Result<Self, BadInput> {
        Self::parse_in_pieces(bytes, PIECE)
    }

    /// Whatever the pieces, the result is the same to the bit.
    fn parse_in_pieces(bytes: &[u8], piece: usize) -> Result<Self, BadInput> {
        match Self::stream(Lines::new(bytes, bytes.len() as u64, piece), true, |_| lines::count(bytes)) {
            Ok(Some(read)) => return Ok(read),
            // Quoted further down: the header does not tell.
            Err(e) if !bytes.contains(&b'"') => return Err(e),
            _ => {}
        }
        let text = dialect::plain(utf8(bytes)?)?;
        let text = text.as_bytes();
        Ok(Self::stream(Lines::new(text, text.len() as u64, piece), false, |_| lines::count(text))?.unwrap_or_default())
    }

    /// The header and what stands before it, then the rows. `most` tells from the first piece how many there are at most. `None` for a
    /// dialect other than plain CSV, where `other` asks for it.
    fn stream(
        mut lines: Lines<impl Read + Send>,
        other: bool,
        most: impl FnOnce(&[u8]) -> usize,
    ) -> Result<Option<Self>, BadInput> {
        let mut out = Self::default();
        let mut metadata = metadata::Lines::default();
        let (mut piece, mut number) = (Vec::new(), 0);
        let header = loop {
            if !lines.next(&mut piece)? {
                return Err(BadInput::new(
                    "the file is empty: there is no header line; a recording begins with time_s,fx_hz,...",
                ));
            }
            let text = utf8(&piece).map_err(|e| if number == 0 { e } else { not_text(number + 1) })?;
            if other && !dialect::is_plain(text) {
                return Ok(None);
            }
            let mut rest = text;
            let mut header = None;
            while header.is_none() && !rest.is_empty() {
                let line;
                (line, rest) = rest.split_once('\n').unwrap_or((rest, ""));
                number += 1;
                let line = line.trim_end_matches('\r');
                if let Some(meta) = line.trim_start().strip_prefix('#') {
                    metadata.take(number, meta)?;
                } else if !line.trim().is_empty() {
                    header = Some(line.to_string());
                }
            }
            if let Some(header) = header {
                lines.give_back(rest.as_bytes());
                break header;
            }
        };
        let most = most(&piece);
        let names: Vec<&str> = header.split(',').map(str::trim).collect();
        let slots = out.slots(&names, number, &metadata)?;
        let kept: Vec<bool> = slots.iter().map(|s| *s != Slot::Ignored).collect();
        let rows = Header { names: &names, kept: &kept }.read(lines, number + 1, most, &mut metadata)?;
        metadata::check(&metadata.entries)?;
        out.meta = metadata.entries;
        for (slot, values) in slots.into_iter().zip(rows.columns) {
            out.place(slot, values);
        }
        out.complete()?;
        if let Some((line, column)) = rows.first_missing {
            let (total, name) = (rows.missing.iter().sum::<usize>(), names[column - 1]);
            out.notes.push(format!("{total} values are missing, the first at line {line}, column {column} ({name})"));
            for (name, count) in names.iter().zip(rows.missing).filter(|(_, count)| *count > 0) {
                out.cleaned.push(Cleaned { column: (*name).to_string(), defect: Defect::Missing, count });
            }
        }
        Ok(Some(out))
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
            .slots(&header, 0, &lines)
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
            Slot::Status(k) => {
                self.status.resize(values.len(), [0; 4]);
                self.status.iter_mut().zip(values).for_each(|(row, v)| row[k] = v as u16);
            }
            Slot::Ignored => {}
        }
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

    fn slots(&mut self, names: &[&str], line: usize, metadata: &metadata::Lines) -> Result<Vec<Slot>, BadInput> {
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
                    self.optional.push((column.name(a), Vec::new()));
                    Slot::Optional(self.optional.len() - 1)
                }
                Role::Status => Slot::Status(if column.is_of_axes() { a } else { AXES }),
                Role::Computed => Slot::Ignored,
            };
            slots.push(slot);
        }
        Ok(slots)
    }

    /// Names the columns that are the thermometer, in words.
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
}

/// The text of a file, without its byte-order mark.
pub(super) fn utf8(bytes: &[u8]) -> Result<&str, BadInput> {
    std::str::from_utf8(bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes))
        .map_err(|e| not_text(1 + bytes[..e.valid_up_to()].iter().filter(|&&b| b == b'\n').count()))
}

/// Hint from the header at the reason why a column is missing.
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
    /// Of an axis or the unit.
    Status(usize),
    Ignored,
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
        assert!(Recording::parse(b"a\n\xff\xfe").expect_err("not text").0.contains("line 2"));
        assert!(Recording::parse(b"\xff\xfe\x00").expect_err("not text").0.contains("byte 3 is zero"));
        let text = rows(20);
        let bad = [text.as_bytes(), b"20,1,2\xb0,3,4,5,6\n", text.as_bytes()].concat();
        assert!(Recording::parse(&bad).expect_err("not text").0.starts_with("line 23 is not UTF-8"));
        assert!(error(&rows(20).replace("# unit: A", "# rate_unit: rad/s")).contains("deg/h"));
    }

    #[test]
    fn pieces_of_any_size_give_the_same() {
        let mut text = rows(60);
        let at = |text: &str, n: usize| text.match_indices('\n').nth(n).map_or(0, |(k, _)| k + 1);
        for (line, insert) in [
            (10, "# run: 7\n"),
            (20, "\n \n"),
            (30, "\r\n"),
            (35, " 31.5,,4890,4700,1,2,3\n"),
            (40, "38.25,4900,nan,4700,1e0,2,3\r\n"),
            (50, "  # unit: A\n"),
        ] {
            let k = at(&text, line);
            text.insert_str(k, insert);
        }
        let mut texts = vec![text.clone(), text.replace('\n', "\r\n"), text.trim_end().to_string()];
        // Every error names its line: in a row, in the number of cells, in metadata, and of two errors the first.
        for (line, insert) in [(45, "1,two,3,4,5,6,7\n"), (55, "1,2\n"), (33, "# unit: B\n"), (12, "# unit = B\n")] {
            let k = at(&text, line);
            let mut wrong = text.clone();
            wrong.insert_str(k, insert);
            texts.push(wrong.clone());
            let k = at(&wrong, 58);
            wrong.insert_str(k, "x\n");
            texts.push(wrong);
        }
        let mut errors = 0;
        for text in &texts {
            let whole = Recording::parse_in_pieces(text.as_bytes(), usize::MAX);
            errors += usize::from(whole.is_err());
            // All short pieces, some long ones, and those about the whole.
            let n = text.len();
            for piece in (1..100).chain((100..n).step_by(37)).chain(n - 2..n + 2) {
                let parted = Recording::parse_in_pieces(text.as_bytes(), piece);
                // (NaN is not equal to itself.)
                assert_eq!(format!("{parted:?}"), format!("{whole:?}"), "{piece} bytes");
            }
        }
        assert_eq!(errors, 8);
        let whole = Recording::parse_in_pieces(text.as_bytes(), usize::MAX).expect("readable");
        assert_eq!((whole.time_s.len(), whole.meta("run")), (62, Some("7")));
        assert!(
            whole.notes.iter().any(|n| n.contains("2 values are missing, the first at line 37, column 2")),
            "{:?}",
            whole.notes
        );
    }

    #[test]
    fn a_large_file_is_read_while_it_is_loaded_and_is_the_same() {
        let row = |k: u32| {
            let j = f64::from(k % 1009) * 1e-3;
            format!("{k},{},{:.5},{:.7},{},{},-{j}\n", 4900.0 + j, 4890.0 + j, 4700.0 - j, 1.0 + j, 2.0 - j)
        };
        let long: String = std::iter::once(HEAD.to_string()).chain((0..160_000).map(row)).collect();
        // Metadata and a blank line far behind the header, and a last line without an end.
        let mut mixed = long.clone();
        let at = mixed[5_000_000..].find('\n').map_or(0, |k| 5_000_001 + k);
        mixed.insert_str(at, "# run: 7\n\n");
        let mixed = mixed.trim_end().to_string();
        // Rows that become much shorter: more of them than the first ones tell.
        let short: String = (160_000..800_000).map(|k| format!("{k},1,2,3,4,5,6\n")).collect();
        let path = std::env::temp_dir().join(format!("hrg-large-{}.csv", std::process::id()));
        for (text, at_once) in [(long.clone(), true), (mixed, true), (long.clone() + &short, false)] {
            std::fs::write(&path, &text).expect("written");
            assert!(text.len() as u64 > LARGE);
            assert_eq!(Recording::read_large(&path).is_some(), at_once);
            assert_eq!(Recording::read(&path).expect("readable"), Recording::parse(text.as_bytes()).expect("readable"));
        }
        // An error far behind names its line, as in any file.
        std::fs::write(&path, long + "1,2\n").expect("written");
        let e = Recording::read(&path).expect_err("refused").0;
        assert!(e.contains("line 160003 has 2 cells") && e.contains("hrg-large"), "{e}");
        let _ = std::fs::remove_file(&path);
    }
}
