//! Tables as text: the columns that a map wants, as numbers.

use super::decode::{decode, has_wide_characters};
use super::map::{Layout, Map};
use super::{choose, imu_number, Table};
use crate::error::BadInput;
use crate::recording::dialect::{is_missing, number, DialectError};
use crate::recording::lines::Lines;
use crate::recording::time_form::{Days, TimeForm};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Read;

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

/// Cells of the lines of a text that hold data, the text given piece by piece.
pub(super) struct Rows<'l> {
    layout: &'l Layout,
    /// Known from the first line of data on, the header.
    separator: Option<Separator>,
    /// End of a line. (Old programs end lines by a carriage return alone.)
    by: Option<char>,
    /// Lines before this piece.
    before: usize,
}

impl<'l> Rows<'l> {
    pub fn new(layout: &'l Layout) -> Self {
        Self { layout, separator: None, by: None, before: 0 }
    }

    /// Cells of the lines of the next piece, which is one of whole lines, with the number of each line.
    ///
    /// # Errors
    /// A separator that is none.
    pub fn of<'t>(&mut self, text: &'t str) -> Result<impl Iterator<Item = Row<'t>> + use<'t, 'l>, BadInput> {
        let (layout, before) = (self.layout, self.before);
        let by = *self.by.get_or_insert(if text.contains('\n') { '\n' } else { '\r' });
        let data = |l: &str| !l.trim().is_empty() && (layout.comment.is_empty() || !l.starts_with(&layout.comment));
        let lines = move || {
            let all = text.split(by).map(|l| l.trim_end_matches('\r')).enumerate();
            all.map(move |(k, l)| (before + k, l)).filter(move |(k, l)| *k >= layout.skip_lines && data(l))
        };
        self.before += memchr::memchr_iter(by as u8, text.as_bytes()).count();
        if self.separator.is_none() {
            self.separator = lines().next().map(|(_, first)| Separator::of(layout, first)).transpose()?;
        }
        let separator = self.separator.unwrap_or(Separator::Space);
        Ok(lines().map(move |(line, l)| {
            let cells = separator.cells(l);
            let open = || BadInput(format!("line {}: a quote is not closed at the end of its cell", line + 1));
            Ok((line + 1, cells.ok_or_else(open)?))
        }))
    }
}

/// Cells of the lines of a whole text that hold data, with the number of each line; the header is the first.
pub(super) fn lines<'t, 'l>(
    text: &'t str,
    layout: &'l Layout,
) -> Result<impl Iterator<Item = Row<'t>> + use<'t, 'l>, BadInput> {
    let mut rows = Rows::new(layout).of(text)?.peekable();
    if rows.peek().is_none() {
        return Err(BadInput::new("there is no header line"));
    }
    Ok(rows)
}

/// Bytes of text that are read at once.
pub(super) const PIECE: usize = 16 << 20;

/// A table as text, read piece by piece.
pub(super) struct Text<'m> {
    lines: Lines<Box<dyn Read>>,
    rows: Rows<'m>,
    filling: Filling<'m>,
    encoding: Option<&'m str>,
    /// A note where the encoding was guessed.
    note: Option<String>,
    piece: Vec<u8>,
}

impl<'m> Text<'m> {
    /// Of any text, read in pieces of so many bytes.
    ///
    /// # Errors
    /// A text that cannot be read, an encoding that is none.
    pub fn new(mut from: impl Read + 'static, map: &'m Map, piece: usize) -> Result<Self, BadInput> {
        let cannot = |e: std::io::Error| BadInput(format!("it cannot be read: {e}"));
        let mut begin = Vec::new();
        from.by_ref().take(piece.max(4096) as u64).read_to_end(&mut begin).map_err(cannot)?;
        let encoding = map.table.encoding.as_deref();
        let of = |lines: Box<dyn Read>, encoding, note| Self {
            lines: Lines::new(lines, 0, piece),
            rows: Rows::new(&map.table),
            filling: Filling::new(map),
            encoding,
            note,
            piece: Vec::new(),
        };
        // (A line of UTF-16 does not end with a byte of its own: it is unpacked as a whole.)
        if has_wide_characters(&begin, encoding)? {
            from.read_to_end(&mut begin).map_err(cannot)?;
            let (text, note) = decode(&begin, encoding)?;
            return Ok(of(Box::new(std::io::Cursor::new(text.into_owned().into_bytes())), None, note));
        }
        Ok(of(Box::new(std::io::Cursor::new(begin).chain(from)), encoding, None))
    }

    /// The rows of the next piece; `None` behind the last.
    ///
    /// # Errors
    /// One sentence with line and column.
    pub fn next_piece(&mut self) -> Result<Option<Table>, BadInput> {
        if !self.lines.next(&mut self.piece)? {
            return Ok(None);
        }
        let (text, note) = decode(&self.piece, self.encoding)?;
        self.note = self.note.take().or(note);
        self.filling.take(self.rows.of(&text)?, !text.ends_with(['\n', '\r']))?;
        Ok(Some(self.filling.table()))
    }

    /// Notes of the whole, behind the last piece.
    ///
    /// # Errors
    /// There was no header.
    pub fn notes(&mut self) -> Result<Vec<String>, BadInput> {
        let mut notes = self.filling.notes()?;
        notes.extend(self.note.take());
        Ok(notes)
    }
}

/// The columns that a map wants, of rows of cells with the number of the line of each; the header is the first, if the map says that there is
/// one.
///
/// # Errors
/// One sentence with line and column.
pub(super) fn fill<'t>(map: &Map, rows: impl Iterator<Item = Row<'t>>) -> Result<Table, BadInput> {
    let mut filling = Filling::new(map);
    filling.take(rows, false)?;
    let mut table = filling.table();
    table.notes = filling.notes()?;
    Ok(table)
}

/// A table that rows are put into.
struct Filling<'m> {
    map: &'m Map,
    /// From the header on.
    head: Option<Head<'m>>,
    /// Rows that were dropped by the map, cells that are empty, cells that hold a text for a missing value.
    dropped: usize,
    empty: usize,
    missing: usize,
    /// Rows that are two: how many, and the line of the first.
    glued: Option<(usize, usize)>,
    /// Line of a last row that is cut off.
    cut: Option<usize>,
    /// Lines of the first decimal comma and point.
    comma: Option<usize>,
    point: Option<usize>,
}

/// Facts from the header.
struct Head<'m> {
    /// Number of columns.
    width: usize,
    /// Columns of numbers: place and name.
    numbers: Vec<(usize, String)>,
    kept: Kept<'m>,
    clock: Option<Clock>,
    values: Vec<Vec<f64>>,
}

impl<'m> Head<'m> {
    fn new(map: &'m Map, names: &[String]) -> Result<Self, BadInput> {
        let clock = Clock::of(map, names)?;
        let mut numbers = choose(map, names)?;
        numbers.retain(|(at, _)| clock.as_ref().is_none_or(|c| !c.places.contains(at)));
        let values = vec![Vec::new(); numbers.len()];
        Ok(Self { width: names.len(), numbers, kept: Kept::new(&map.table, names)?, clock, values })
    }
}

impl<'m> Filling<'m> {
    fn new(map: &'m Map) -> Self {
        let (dropped, empty, missing) = (0, 0, 0);
        Self { map, head: None, dropped, empty, missing, glued: None, cut: None, comma: None, point: None }
    }

    /// Takes rows. `open`: the last of them may be cut off, as its line has no end.
    fn take<'t>(&mut self, rows: impl Iterator<Item = Row<'t>>, open: bool) -> Result<(), BadInput> {
        let layout = &self.map.table;
        let mut rows = rows.peekable();
        if self.head.is_none() {
            let names: Vec<String> = match rows.peek() {
                Some(Ok((_, head))) if layout.header => head.iter().map(ToString::to_string).collect(),
                Some(Ok((_, head))) => (1..=head.len()).map(|k| k.to_string()).collect(),
                Some(Err(e)) => return Err(e.clone()),
                None => return Ok(()),
            };
            if layout.header {
                rows.next();
            }
            self.head = Some(Head::new(self.map, &names)?);
        }
        let Some(head) = &mut self.head else { return Ok(()) };
        while let Some(row) = rows.next() {
            let (line, cells) = row?;
            let cell = |at: usize| cells.get(at).map_or("", |c| c.as_ref());
            if !head.kept.has(cell) {
                continue;
            }
            if self.dropped < layout.drop_rows {
                self.dropped += 1;
                continue;
            }
            // (A trailing separator makes empty cells.)
            if cells.iter().skip(head.width).any(|c| !c.is_empty()) {
                self.glued = Some(self.glued.map_or((1, line), |(n, first)| (n + 1, first)));
                continue;
            }
            if open && cells.len() < head.width && rows.peek().is_none() {
                self.cut = Some(line);
                break;
            }
            if let Some(clock) = &mut head.clock {
                clock.take(line, cell)?;
            }
            for ((at, name), values) in head.numbers.iter().zip(&mut head.values) {
                let text = cell(*at);
                let none = is_missing(text) || layout.missing.iter().any(|m| m == text);
                let value = if none { Some(f64::NAN) } else { number(text) };
                self.empty += usize::from(text.is_empty());
                self.missing += usize::from(none && !text.is_empty());
                values.push(value.ok_or_else(|| no_number(line, name, text))?);
                // (Decimal commas beside decimal points: one of them parts thousands.)
                self.comma = self.comma.or(text.contains(',').then_some(line));
                self.point = self.point.or((!none && text.contains('.')).then_some(line));
                if let (Some(comma), Some(point)) = (self.comma, self.point) {
                    return Err(DialectError::Mixed { comma, point }.into());
                }
            }
        }
        Ok(())
    }

    /// The rows so far.
    fn table(&mut self) -> Table {
        let Some(head) = &mut self.head else { return Table::default() };
        let names = head.numbers.iter().map(|(_, n)| n.clone());
        let columns = names.zip(head.values.iter_mut().map(std::mem::take)).collect();
        let time_s = head.clock.as_mut().map(|c| std::mem::take(&mut c.time_s));
        Table { columns, time_s, notes: Vec::new() }
    }

    fn notes(&self) -> Result<Vec<String>, BadInput> {
        let Some(head) = &self.head else { return Err(BadInput::new("there is no header line")) };
        let mut notes = Vec::new();
        if self.empty > 0 {
            notes.push(format!("{} cells are empty", self.empty));
        }
        if self.missing > 0 {
            notes.push(format!("{} cells hold a text for a missing value", self.missing));
        }
        notes.extend(left_out(self.glued, self.cut));
        notes.extend(super::others(&head.kept.imus, self.map.table.instance)?);
        Ok(notes)
    }
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
