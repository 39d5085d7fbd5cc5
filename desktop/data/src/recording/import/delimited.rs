//! Tables as text: the columns that a map wants, as numbers.

use super::map::{Layout, Map};
use super::{choose, Table};
use crate::error::BadInput;
use std::borrow::Cow;

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

/// A number with a decimal point or comma; NaN where there is none.
pub(super) fn number(cell: &str, iso: bool) -> Option<f64> {
    if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
        return Some(f64::NAN);
    }
    if iso {
        return seconds(cell);
    }
    let value = cell.parse().or_else(|_| cell.replacen(',', ".", 1).parse());
    value.ok().filter(|v: &f64| v.is_finite())
}

/// Seconds since 1970 of a date like 2024-05-01T12:00:00.5, in UTC where it names no zone.
fn seconds(cell: &str) -> Option<f64> {
    let of = |t: chrono::DateTime<chrono::Utc>| t.timestamp_micros() as f64 * 1e-6;
    if let Ok(t) = chrono::DateTime::parse_from_rfc3339(cell) {
        return Some(of(t.to_utc()));
    }
    ["%Y-%m-%dT%H:%M:%S%.f", "%Y-%m-%d %H:%M:%S%.f"]
        .iter()
        .find_map(|f| chrono::NaiveDateTime::parse_from_str(cell, f).ok())
        .map(|t| of(t.and_utc()))
}

/// Reads the columns of a table that a map wants.
///
/// # Errors
/// One sentence with line and column.
pub fn read(bytes: &[u8], map: &Map) -> Result<Table, BadInput> {
    let text = crate::recording::utf8(bytes)?;
    let layout = &map.table;
    let data = |l: &str| !l.trim().is_empty() && (layout.comment.is_empty() || !l.starts_with(&layout.comment));
    let mut lines = text.lines().enumerate().skip(layout.skip_lines).filter(|(_, l)| data(l)).peekable();
    let Some(&(first_line, first)) = lines.peek() else { return Err(BadInput::new("there is no header line")) };
    let separator = Separator::of(layout, first)?;
    let open = |line: usize| BadInput(format!("line {}: a quote is not closed at the end of its cell", line + 1));
    let head = separator.cells(first).ok_or_else(|| open(first_line))?;
    let names: Vec<String> = if layout.header {
        lines.next();
        head.into_iter().map(Cow::into_owned).collect()
    } else {
        (1..=head.len()).map(|k| k.to_string()).collect()
    };
    let wanted = choose(map, &names)?;
    let keep: Vec<(usize, &str)> = layout
        .keep
        .iter()
        .map(|(name, word)| {
            let at = names.iter().position(|n| n == name).ok_or_else(|| {
                BadInput(format!(
                    "the map keeps rows by the column \"{name}\", which is not there; there are {}",
                    names.join(", ")
                ))
            })?;
            Ok((at, word.as_str()))
        })
        .collect::<Result<_, BadInput>>()?;
    let iso: Vec<bool> = wanted
        .iter()
        .map(|(_, name)| {
            let time = map.time.column.as_ref().is_some_and(|c| c.all().contains(&name.as_str()));
            time && map.time.unit.as_deref() == Some("iso")
        })
        .collect();
    let mut table = Table { columns: wanted.iter().map(|(_, n)| (n.clone(), Vec::new())).collect(), notes: Vec::new() };
    let (mut dropped, mut empty) = (0, 0usize);
    for (line, row) in lines {
        let cells = separator.cells(row).ok_or_else(|| open(line))?;
        let cell = |at: usize| cells.get(at).map_or("", |c| c.as_ref());
        if keep.iter().any(|(at, word)| cell(*at) != *word) {
            continue;
        }
        if dropped < layout.drop_rows {
            dropped += 1;
            continue;
        }
        for (((at, name), iso), (_, values)) in wanted.iter().zip(&iso).zip(&mut table.columns) {
            let value = number(cell(*at), *iso).ok_or_else(|| {
                let shown: String = cell(*at).chars().take(24).collect();
                BadInput(format!(
                    "line {}, column \"{name}\": \"{shown}\" is not a number; correct or empty the cell",
                    line + 1
                ))
            })?;
            empty += usize::from(value.is_nan());
            values.push(value);
        }
    }
    if empty > 0 {
        table.notes.push(format!("{empty} cells are empty"));
    }
    Ok(table)
}
