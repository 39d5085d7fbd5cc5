//! Tables as text: the columns that a map wants, as numbers.

use super::decode::decode;
use super::map::{Layout, Map};
use super::{choose, imu_number, Table};
use crate::error::BadInput;
use crate::recording::dialect::{is_missing, number, DialectError};
use crate::recording::time_form::{Days, TimeForm};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Separator of the cells.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Separator {
    Char(char),
    Space,
}

impl Separator {
    fn of(layout: &Layout, header: &str) -> Result<Self, BadInput> {
        Ok(match layout.separator.as_deref() {
            Some("comma") => Self::Char(','),
            Some("semicolon") => Self::Char(';'),
            Some("tab") => Self::Char('\t'),
            Some("space") => Self::Space,
            Some(other) => {
                let mut c = other.chars();
                match (c.next(), c.next()) {
                    (Some(one), None) => Self::Char(one),
                    _ => {
                        return Err(BadInput(format!(
                            "the map's separator \"{other}\" is none; there are comma, semicolon, tab, space, or one character"
                        )))
                    }
                }
            }
            None => {
                let count = |s: char| header.chars().filter(|c| *c == s).count();
                let (most, s) =
                    [',', ';', '\t'].map(|s| (count(s), s)).into_iter().max_by_key(|c| c.0).unwrap_or((0, ','));
                if most > 0 {
                    Self::Char(s)
                } else {
                    Self::Space
                }
            }
        })
    }

    fn cells<'t>(self, line: &'t str) -> Option<Vec<Cow<'t, str>>> {
        match self {
            Self::Space => Some(line.split_whitespace().map(Cow::Borrowed).collect()),
            Self::Char(c) if line.contains('"') => crate::recording::dialect::cells(line, c),
            Self::Char(c) => Some(line.split(c).map(|s| Cow::Borrowed(s.trim())).collect()),
        }
    }
}

/// A row of cells with the number of its line.
pub(super) type Row<'t> = Result<(usize, Vec<Cow<'t, str>>), BadInput>;

/// Cells of the lines of a text that hold data, with the number of each line; the header is the first.
pub(super) fn lines<'t>(text: &'t str, layout: &'t Layout) -> Result<impl Iterator<Item = Row<'t>> + 't, BadInput> {
    let data = |l: &str| !l.trim().is_empty() && (layout.comment.is_empty() || !l.starts_with(&layout.comment));
    // (Old programs end lines by a carriage return alone.)
    let by = if text.contains('\n') { '\n' } else { '\r' };
    let all = text.split(by).map(|l| l.trim_end_matches('\r')).enumerate();
    let mut lines = all.skip(layout.skip_lines).filter(move |(_, l)| data(l)).peekable();
    let Some(&(_, first)) = lines.peek() else { return Err(BadInput::new("there is no header line")) };
    let separator = Separator::of(layout, first)?;
    Ok(lines.map(move |(line, l)| {
        let cells = separator.cells(l);
        let open = || BadInput(format!("line {}: a quote is not closed at the end of its cell", line + 1));
        Ok((line + 1, cells.ok_or_else(open)?))
    }))
}

/// Reads the columns of a table that a map wants.
///
/// # Errors
/// One sentence with line and column.
pub fn read(bytes: &[u8], map: &Map) -> Result<Table, BadInput> {
    let (text, note) = decode(bytes, map.table.encoding.as_deref())?;
    let mut table = fill(map, lines(&text, &map.table)?, !text.ends_with(['\n', '\r']))?;
    table.notes.extend(note);
    Ok(table)
}

/// The columns that a map wants, of rows of cells with the number of the line of each; the header is the first, if the map says that there is
/// one. `open`: the last row may be cut off, as its line has no end.
///
/// # Errors
/// One sentence with line and column.
pub(super) fn fill<'t>(map: &Map, rows: impl Iterator<Item = Row<'t>>, open: bool) -> Result<Table, BadInput> {
    let layout = &map.table;
    let mut rows = rows.peekable();
    let names: Vec<String> = match rows.peek() {
        Some(Ok((_, head))) if layout.header => head.iter().map(ToString::to_string).collect(),
        Some(Ok((_, head))) => (1..=head.len()).map(|k| k.to_string()).collect(),
        Some(Err(e)) => return Err(e.clone()),
        None => return Err(BadInput::new("there is no header line")),
    };
    if layout.header {
        rows.next();
    }
    let wanted = choose(map, &names)?;
    let mut kept = Kept::new(layout, &names)?;
    let mut clock = Clock::of(map, &names)?;
    let numbers: Vec<_> =
        wanted.iter().filter(|(at, _)| clock.as_ref().is_none_or(|c| !c.places.contains(at))).collect();
    let mut table =
        Table { columns: numbers.iter().map(|(_, n)| (n.clone(), Vec::new())).collect(), ..Table::default() };
    let (mut dropped, mut empty, mut missing) = (0, 0usize, 0usize);
    let (mut glued, mut cut) = (None::<(usize, usize)>, None);
    let (mut comma, mut point) = (None, None);
    while let Some(row) = rows.next() {
        let (line, cells) = row?;
        let cell = |at: usize| cells.get(at).map_or("", |c| c.as_ref());
        if !kept.has(cell) {
            continue;
        }
        if dropped < layout.drop_rows {
            dropped += 1;
            continue;
        }
        // (A trailing separator makes empty cells.)
        if cells.iter().skip(names.len()).any(|c| !c.is_empty()) {
            glued = Some(glued.map_or((1, line), |(n, first)| (n + 1, first)));
            continue;
        }
        if open && cells.len() < names.len() && rows.peek().is_none() {
            cut = Some(line);
            break;
        }
        if let Some(clock) = &mut clock {
            clock.take(line, cell)?;
        }
        for ((at, name), (_, values)) in numbers.iter().zip(&mut table.columns) {
            let text = cell(*at);
            let none = is_missing(text) || layout.missing.iter().any(|m| m == text);
            let value = if none { Some(f64::NAN) } else { number(text) };
            empty += usize::from(text.is_empty());
            missing += usize::from(none && !text.is_empty());
            values.push(value.ok_or_else(|| no_number(line, name, text))?);
            // (Decimal commas beside decimal points: one of them parts thousands.)
            comma = comma.or(text.contains(',').then_some(line));
            point = point.or((!none && text.contains('.')).then_some(line));
            if let (Some(comma), Some(point)) = (comma, point) {
                return Err(DialectError::Mixed { comma, point }.into());
            }
        }
    }
    if empty > 0 {
        table.notes.push(format!("{empty} cells are empty"));
    }
    if missing > 0 {
        table.notes.push(format!("{missing} cells hold a text for a missing value"));
    }
    table.notes.extend(left_out(glued, cut));
    table.notes.extend(super::others(&kept.imus, layout.instance));
    table.time_s = clock.map(|c| c.time_s);
    Ok(table)
}

/// The rows that a map keeps.
struct Kept<'l> {
    /// Columns that must hold these words.
    words: Vec<(usize, &'l str)>,
    /// The column with the number of the IMU, and the number.
    number: Option<(usize, u8)>,
    /// The numbers that were seen.
    imus: BTreeSet<u8>,
}

impl<'l> Kept<'l> {
    fn new(layout: &'l Layout, names: &[String]) -> Result<Self, BadInput> {
        let place = |name: &String| names.iter().position(|n| n == name);
        let word = |(name, word): (&String, &'l String)| {
            let at = place(name).ok_or_else(|| {
                BadInput(format!(
                    "the map keeps rows by the column \"{name}\", which is not there; there are {}",
                    names.join(", ")
                ))
            })?;
            Ok((at, word.as_str()))
        };
        let words = layout.keep.iter().map(word).collect::<Result<_, BadInput>>()?;
        let number = layout.instance_column.as_ref().and_then(place).map(|at| (at, layout.instance));
        Ok(Self { words, number, imus: BTreeSet::new() })
    }

    fn has<'c>(&mut self, cell: impl Fn(usize) -> &'c str) -> bool {
        if self.words.iter().any(|(at, word)| cell(*at) != *word) {
            return false;
        }
        let Some((at, wanted)) = self.number else { return true };
        let number = imu_number(number(cell(at)));
        self.imus.extend(number);
        number == Some(wanted)
    }
}

/// Notes on rows that were left out: how many are two rows glued together and where the first is, and the line that is cut off.
fn left_out(glued: Option<(usize, usize)>, cut: Option<usize>) -> Vec<String> {
    let glued = glued.map(|(count, first)| {
        format!("{count} rows have more cells than the header, the first in line {first}: left out")
    });
    let cut = cut.map(|line| format!("line {line}, the last, is cut off: left out"));
    glued.into_iter().chain(cut).collect()
}

fn no_number(line: usize, name: &str, cell: &str) -> BadInput {
    let shown: String = cell.chars().take(24).collect();
    let advice = if cell.contains([':', '/']) {
        "it looks like a time: name its form as unit in [time]"
    } else {
        "correct or empty the cell, or add the text to missing in [table]"
    };
    BadInput(format!("line {line}, column \"{name}\": \"{shown}\" is not a number; {advice}"))
}

/// Times that are no numbers, or stand in two columns.
struct Clock {
    form: TimeForm,
    /// Name of the column.
    name: String,
    /// Places of the column and of the second one.
    places: Vec<usize>,
    days: Days,
    time_s: Vec<f64>,
}

impl Clock {
    fn of(map: &Map, names: &[String]) -> Result<Option<Self>, BadInput> {
        let (Some(column), form) = (&map.time.column, map.time.form()?) else { return Ok(None) };
        if form.is_number() && map.time.second_column.is_none() {
            return Ok(None);
        }
        let columns = std::iter::once(column).chain(&map.time.second_column);
        let places: Vec<usize> =
            columns.filter_map(|c| c.all().iter().find_map(|n| names.iter().position(|t| t == n))).collect();
        let name = places.first().map_or_else(String::new, |at| names[*at].clone());
        Ok(Some(Self { form, name, places, days: Days::default(), time_s: Vec::new() }))
    }

    fn take<'c>(&mut self, line: usize, cell: impl Fn(usize) -> &'c str) -> Result<(), BadInput> {
        let text = self.places.iter().map(|at| cell(*at)).collect::<Vec<_>>().join(" ");
        if text.trim().is_empty() {
            self.time_s.push(f64::NAN);
            return Ok(());
        }
        let time_s = self.form.read(text.trim()).ok_or_else(|| {
            let shown: String = text.chars().take(32).collect();
            let form = self.form.name();
            BadInput(format!("line {line}, column \"{}\": \"{shown}\" is not a time of the form {form}", self.name))
        })?;
        self.time_s.push(if self.form.of_a_day() { self.days.next(time_s, &self.form) } else { time_s });
        Ok(())
    }
}
