//! The rows of a recording's text, cut into pieces at line ends that are read side by side. The columns are filled in place; what the pieces
//! say of lines counts from their beginning, until they are joined in order.

use super::lines::{self, Lines};
use super::metadata;
use crate::error::BadInput;
use crate::numeric::side_by_side;
use std::io::Read;
use std::sync::{Mutex, PoisonError};

/// Columns of the rows, from the header.
pub(super) struct Header<'h> {
    /// Names of the columns.
    pub names: &'h [&'h str],
    /// Set for the columns that are read.
    pub kept: &'h [bool],
}

/// Result of reading the rows.
pub(super) struct Rows {
    /// A column each; empty where it is not read.
    pub columns: Vec<Vec<f64>>,
    /// Missing values of each.
    pub missing: Vec<usize>,
    /// Line and column of the first one.
    pub first_missing: Option<(usize, usize)>,
}

/// Result of reading a piece.
struct Piece {
    rows: usize,
    lines: usize,
    missing: Vec<usize>,
    first_missing: Option<(usize, usize)>,
    /// Metadata among the rows, each with its line.
    metadata: Vec<(usize, String)>,
    /// The line of a row that cannot be read, and its text; no text where it is none. Nothing behind it was looked at.
    failed: Option<(usize, Option<String>)>,
}

/// Source of the threads' work.
struct Feed<'c, R> {
    lines: Lines<R>,
    /// Unfilled part of the columns, and its number of rows.
    columns: Vec<&'c mut [f64]>,
    left: usize,
    /// Number of lines of each piece.
    pieces: Vec<usize>,
    /// Set if nothing behind the pieces so far is wanted; and the reason, if it cannot be read.
    stopped: bool,
    failed: Option<BadInput>,
}

impl<'c, R: Read> Feed<'c, R> {
    /// The next piece: its text, its number, and the places for its values.
    fn next(&mut self, text: &mut Vec<u8>) -> Option<(usize, Vec<&'c mut [f64]>)> {
        if self.stopped {
            return None;
        }
        let taken = self.lines.next(text).and_then(|there| {
            let lines = lines::count(text);
            if lines > self.left {
                return Err(BadInput::new("there are more lines than were expected"));
            }
            Ok(there.then_some(lines))
        });
        let lines = taken.unwrap_or_else(|e| {
            self.failed = Some(e);
            None
        });
        let Some(lines) = lines else {
            self.stopped = true;
            return None;
        };
        self.left -= lines;
        let mut places = Vec::new();
        for rest in &mut self.columns {
            // (A column that is not read has no place.)
            let here = lines.min(rest.len());
            let (place, after) = std::mem::take(rest).split_at_mut(here);
            places.push(place);
            *rest = after;
        }
        self.pieces.push(lines);
        Some((self.pieces.len() - 1, places))
    }
}

impl Header<'_> {
    /// Reads all rows, the first of them in line number `line`. There are at most `most` lines. Metadata among them are taken.
    ///
    /// # Errors
    /// That of the first line that cannot be used; where there are more lines.
    pub fn read(
        &self,
        lines: Lines<impl Read + Send>,
        line: usize,
        most: usize,
        metadata: &mut metadata::Lines,
    ) -> Result<Rows, BadInput> {
        let mut columns: Vec<Vec<f64>> =
            self.kept.iter().map(|kept| if *kept { vec![0.0; most] } else { Vec::new() }).collect();
        let places = columns.iter_mut().map(Vec::as_mut_slice).collect();
        let threads = lines.pieces();
        let feed = Feed { lines, columns: places, left: most, pieces: Vec::new(), stopped: false, failed: None };
        let feed = Mutex::new(feed);
        let made = Mutex::new(Vec::new());
        let work = || {
            let mut text = Vec::new();
            loop {
                // (The lock is given back before the work.)
                let next = feed.lock().unwrap_or_else(PoisonError::into_inner).next(&mut text);
                let Some((k, places)) = next else { return };
                let piece = self.piece(&text, places);
                if piece.failed.is_some() {
                    feed.lock().unwrap_or_else(PoisonError::into_inner).stopped = true;
                }
                made.lock().unwrap_or_else(PoisonError::into_inner).push((k, piece));
            }
        };
        side_by_side::on_all(threads, work);
        let Feed { pieces, failed, .. } = feed.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut made: Vec<(usize, Piece)> = made.into_inner().unwrap_or_else(PoisonError::into_inner);
        made.sort_by_key(|(k, _)| *k);
        let (mut before, mut rows, mut from) = (line - 1, 0, 0);
        let (mut missing, mut first_missing) = (vec![0; self.names.len()], None);
        for ((_, piece), most) in made.into_iter().zip(pieces) {
            for (line, text) in piece.metadata {
                metadata.take(before + line, &text)?;
            }
            match piece.failed {
                // Once more, with its number in the file.
                Some((line, Some(text))) => self.row(before + line, &text, &mut |_, _| {})?,
                Some((line, None)) => return Err(lines::not_text(before + line)),
                None => {}
            }
            for column in columns.iter_mut().filter(|c| !c.is_empty() && rows != from) {
                column.copy_within(from..from + piece.rows, rows);
            }
            missing.iter_mut().zip(&piece.missing).for_each(|(sum, n)| *sum += n);
            first_missing = first_missing.or(piece.first_missing.map(|(line, column)| (before + line, column)));
            rows += piece.rows;
            from += most;
            before += piece.lines;
        }
        if let Some(e) = failed {
            return Err(e);
        }
        columns.iter_mut().for_each(|c| c.truncate(rows));
        Ok(Rows { columns, missing, first_missing })
    }

    fn piece(&self, bytes: &[u8], mut columns: Vec<&mut [f64]>) -> Piece {
        let mut out = Piece {
            rows: 0,
            lines: 0,
            missing: vec![0; self.names.len()],
            first_missing: None,
            metadata: Vec::new(),
            failed: None,
        };
        let (mut rest, bad) = match std::str::from_utf8(bytes) {
            Ok(text) => (text, false),
            Err(e) => (std::str::from_utf8(&bytes[..e.valid_up_to()]).unwrap_or(""), true),
        };
        // Text before it in its line is no row, either.
        if bad {
            rest = &rest[..rest.rfind('\n').map_or(0, |k| k + 1)];
        }
        loop {
            if rest.is_empty() {
                out.failed = bad.then_some((out.lines + 1, None));
                return out;
            }
            out.lines += 1;
            let end = memchr::memchr(b'\n', rest.as_bytes());
            let (line, after) = end.map_or((rest, ""), |at| (&rest[..at], &rest[at + 1..]));
            let line = line.trim_end_matches('\r');
            if let Some(meta) = line.trim_start().strip_prefix('#') {
                out.metadata.push((out.lines, meta.to_string()));
            } else if !line.trim().is_empty() {
                let (at, number) = (out.rows, out.lines);
                let taken = self.row(number, line, &mut |k, value| {
                    if value.is_nan() {
                        out.missing[k] += 1;
                        out.first_missing.get_or_insert((number, k + 1));
                    }
                    columns[k][at] = value;
                });
                if taken.is_err() {
                    out.failed = Some((number, Some(line.to_string())));
                    return out;
                }
                out.rows += 1;
            }
            rest = after;
        }
    }

    /// Reads the cells of a row, giving each that is kept to `take`.
    fn row(&self, line: usize, row: &str, take: &mut impl FnMut(usize, f64)) -> Result<(), BadInput> {
        let mut cells = 0;
        let (bytes, mut from) = (row.as_bytes(), 0);
        for end in memchr::memchr_iter(b',', bytes).chain([bytes.len()]) {
            cells += 1;
            if self.kept.get(cells - 1) == Some(&true) {
                take(cells - 1, self.number(line, &row[from..end], cells)?);
            }
            from = end + 1;
        }
        if cells != self.names.len() {
            // A decimal comma makes two cells of one.
            let commas = if cells > self.names.len() {
                " (numbers with decimal commas need semicolons between the cells)"
            } else {
                ""
            };
            return Err(BadInput(format!(
                "line {line} has {cells} cells, the header has {}; correct or remove the line{commas}",
                self.names.len()
            )));
        }
        Ok(())
    }

    /// Value of a cell; NaN where it is missing.
    fn number(&self, line: usize, cell: &str, column: usize) -> Result<f64, BadInput> {
        if let Some(value) = fast_float2::parse(cell).ok().filter(|v: &f64| v.is_finite()) {
            return Ok(value);
        }
        let cell = cell.trim();
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        fast_float2::parse(cell).ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
            BadInput(format!(
                "line {line}, column {column} ({}): \"{}\" is not a number; correct or empty the cell",
                self.names.get(column - 1).unwrap_or(&""),
                cell.chars().take(24).collect::<String>()
            ))
        })
    }
}
