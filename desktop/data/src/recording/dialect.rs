//! Tables as other programs write them, brought to plain CSV: commas between the cells, decimal points, no quotes.
//!
//! | read | as |
//! |---|---|
//! | cells separated by commas, semicolons or tabs, or as a first line `sep=;` says | the header decides, once for the file |
//! | `"quoted"` cells and lines, a quote within them doubled | without their quotes |
//! | `1,5` in a file of semicolons or tabs | 1.5 |
//! | lines that end in CR LF or in CR | lines |
//!
//! Ambiguous text is refused: a comma within quotes between commas (decimals or thousands?), and decimal points beside decimal commas. A
//! plain file is left as it is, after a check of its header alone.

use crate::error::BadInput;
use std::borrow::Cow;

/// Why a table cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DialectError {
    /// A quote has no second one at the end of its cell.
    #[error("line {0}: a quote is not closed at the end of its cell; a cell may not hold a line break")]
    OpenQuote(usize),
    /// A comma within quotes, in a file separated by commas.
    #[error("line {line}, column {column}: \"{cell}\" holds a comma, in a file whose cells are separated by commas: it may be a decimal or a thousands comma; save the file with decimal points and without thousands commas")]
    Comma {
        /// Line.
        line: usize,
        /// Column.
        column: usize,
        /// Text of the cell.
        cell: String,
    },
    /// Decimal points in one place, decimal commas in another.
    #[error("line {comma} has decimal commas, line {point} decimal points; save the file with one of them, best with points")]
    Mixed {
        /// A line with a decimal comma.
        comma: usize,
        /// A line with a decimal point.
        point: usize,
    },
}

impl From<DialectError> for BadInput {
    fn from(e: DialectError) -> Self {
        Self(e.to_string())
    }
}

/// The header: the first line that is neither empty nor metadata.
fn header(text: &str) -> Option<&str> {
    text.lines().find(|l| {
        let l = l.trim_start();
        !(l.is_empty() || l.starts_with('#') || l.starts_with("\"#"))
    })
}

/// `true` if the text needs no conversion, as far as the lines up to the header tell.
#[must_use]
pub fn is_plain(text: &str) -> bool {
    if !text.contains('\n') && text.contains('\r') {
        return false;
    }
    let Some(header) = header(text) else { return true };
    // (The header is a part of the text: what stands before it is metadata.)
    let before = &text[..header.as_ptr() as usize - text.as_ptr() as usize];
    !(header.contains([';', '\t', '"', '\r']) || header.starts_with("sep=") || before.contains('"'))
}

/// A line, and the rest of the text; `alone`: lines end in CR alone.
fn split_line(text: &str, alone: bool) -> (&str, &str) {
    let (line, rest) = text.split_once(if alone { '\r' } else { '\n' }).unwrap_or((text, ""));
    (line.trim_end_matches('\r'), rest)
}

/// The separator of a header: what stands in it most often outside quotes.
fn separator_of(header: &str) -> char {
    if let Some(printed) = header.strip_prefix("sep=").and_then(|s| s.chars().next()) {
        return printed;
    }
    let mut quoted = false;
    let mut counts = [(0usize, ','), (0, ';'), (0, '\t')];
    for c in header.chars() {
        quoted ^= c == '"';
        if let Some(count) = counts.iter_mut().find(|(_, s)| *s == c && !quoted) {
            count.0 += 1;
        }
    }
    let most = counts.iter().map(|c| c.0).max().unwrap_or(0);
    counts.iter().find(|c| c.0 == most).map_or(',', |c| c.1)
}

/// Decimal sign of a numeric cell: comma (`Some(true)`) or point (`Some(false)`).
fn decimal(cell: &str) -> Option<bool> {
    let at = cell.find([',', '.'])?;
    let comma = cell.as_bytes()[at] == b',';
    let digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    let (whole, rest) = (cell[..at].trim_start_matches(['-', '+']), &cell[at + 1..]);
    let fraction = rest.split_once(['e', 'E']).map_or(rest, |(f, _)| f);
    (digits(whole) && digits(fraction) && !(whole.is_empty() && fraction.is_empty())).then_some(comma)
}

/// Texts that programs write for a missing value, in small letters.
const MISSING: [&str; 10] = ["nan", "-", "--", "---", "n/a", "na", "#n/a", "#nv", "null", "none"];

/// `true` if a cell is empty, or holds a text that stands for a missing value.
#[must_use]
pub fn is_missing(cell: &str) -> bool {
    cell.is_empty() || MISSING.contains(&cell.to_lowercase().as_str())
}

/// A number with a decimal point or comma; `None` where a cell holds none.
#[must_use]
pub fn number(cell: &str) -> Option<f64> {
    let value = cell.parse().or_else(|_| cell.replacen(',', ".", 1).parse());
    value.ok().filter(|v: &f64| v.is_finite())
}

/// Cells of a line without their quotes. `None`: a quote is not closed at the end of its cell.
pub fn cells(line: &str, separator: char) -> Option<Vec<Cow<'_, str>>> {
    let mut out = Vec::new();
    let mut rest = line;
    loop {
        let start = rest.trim_start_matches(' ');
        let (cell, after) = if let Some(inside) = start.strip_prefix('"') {
            let (mut text, mut from) = (String::new(), inside);
            loop {
                let (piece, next) = from.split_once('"')?;
                text.push_str(piece);
                match next.strip_prefix('"') {
                    Some(more) => {
                        text.push('"');
                        from = more;
                    }
                    None => break (Cow::Owned(text.trim().to_string()), next),
                }
            }
        } else {
            let at = rest.find(separator).unwrap_or(rest.len());
            (Cow::Borrowed(rest[..at].trim()), &rest[at..])
        };
        out.push(cell);
        let after = after.trim_start_matches(' ');
        match after.strip_prefix(separator) {
            Some(more) => rest = more,
            None => return after.is_empty().then_some(out),
        }
    }
}

/// The table as plain CSV, line for line.
///
/// # Errors
/// [`DialectError`], with its place.
pub fn plain(text: &str) -> Result<String, DialectError> {
    let alone = !text.contains('\n');
    let mut out = String::with_capacity(text.len());
    let (mut rest, mut number) = (text, 0);
    let mut separator = None;
    let (mut comma_line, mut point_line) = (None, None);
    while !rest.is_empty() {
        let line;
        (line, rest) = split_line(rest, alone);
        number += 1;
        let bare = line.trim_start();
        if bare.starts_with('#') {
            out.push_str(bare);
        } else if bare.starts_with("\"#") {
            let whole = cells(bare, '\n').ok_or(DialectError::OpenQuote(number))?;
            out.push_str(&whole[0]);
        } else if separator.is_none() && bare.starts_with("sep=") {
            separator = Some(separator_of(bare));
        } else if !bare.trim_matches([',', ';', '\t', ' ']).is_empty() {
            let separator = *separator.get_or_insert_with(|| separator_of(bare));
            let cells = cells(line, separator).ok_or(DialectError::OpenQuote(number))?;
            for (k, cell) in cells.iter().enumerate() {
                if k > 0 {
                    out.push(',');
                }
                match decimal(cell) {
                    Some(true) if separator == ',' => {
                        return Err(DialectError::Comma { line: number, column: k + 1, cell: cell.to_string() })
                    }
                    Some(true) => {
                        comma_line.get_or_insert(number);
                        out.push_str(&cell.replace(',', "."));
                    }
                    Some(false) => {
                        point_line.get_or_insert(number);
                        out.push_str(cell);
                    }
                    // Words; a comma in them would be taken for a border.
                    None => out.push_str(&cell.replace(',', " ")),
                }
            }
        }
        out.push('\n');
    }
    match (comma_line, point_line) {
        (Some(comma), Some(point)) => Err(DialectError::Mixed { comma, point }),
        _ => Ok(out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_dialects_become_plain() {
        for (text, wanted) in [
            ("a;b\n1,5;-2,25\n", "a,b\n1.5,-2.25\n"),
            ("a\tb\r\n1.5\t\r\n", "a,b\n1.5,\n"),
            ("\"a\",\"b\"\n\"1\",2\n", "a,b\n1,2\n"),
            ("\"# unit: A; B\"\na;b\n1;\"x;\"\"y\"\"\"\n", "# unit: A; B\na,b\n1,x;\"y\"\n"),
            ("sep=;\na;b\n1;2,5e-3\n;\n", "\na,b\n1,2.5e-3\n\n"),
            ("a;b\r1;2\r", "a,b\n1,2\n"),
            ("a;b\n1;one, two\n", "a,b\n1,one  two\n"),
            ("a ; b\n 1 ; \"2\" \n", "a,b\n1,2\n"),
        ] {
            assert!(!is_plain(text), "{text}");
            assert_eq!(plain(text).as_deref(), Ok(wanted), "{text}");
        }
        assert!(
            is_plain("# unit: A\n\na,b\n1,2\n") && is_plain("") && is_plain("# a: \"b\"") && !is_plain("# a: b\ra;b\r")
        );
    }

    #[test]
    fn what_could_mean_two_things_is_refused() {
        assert_eq!(
            plain("\"a\",\"b\"\n1,\"4,898\"\n"),
            Err(DialectError::Comma { line: 2, column: 2, cell: "4,898".into() })
        );
        assert_eq!(plain("a;b\n1.5;2\n1;2,5\n"), Err(DialectError::Mixed { comma: 3, point: 2 }));
        assert_eq!(plain("a;b\n1;\"2\n"), Err(DialectError::OpenQuote(2)));
    }
}
