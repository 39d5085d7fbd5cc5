//! The rows of a recording's text, cut into pieces at line ends that are read side by side. The columns are filled in place; what the pieces
//! say of lines counts from their beginning, until they are joined in order.

use super::metadata;
use crate::numeric::side_by_side;
use crate::BadInput;

/// What the header says of the rows.
pub(super) struct Header<'h> {
    /// Names of the columns.
    pub names: &'h [&'h str],
    /// Which of them are read.
    pub kept: &'h [bool],
}

/// What came of the rows.
pub(super) struct Rows {
    /// A column each; empty where it is not read.
    pub columns: Vec<Vec<f64>>,
    /// Missing values of each.
    pub missing: Vec<usize>,
    /// Line and column of the first one.
    pub first_missing: Option<(usize, usize)>,
}

/// What came of a piece.
struct Piece<'t> {
    rows: usize,
    lines: usize,
    missing: Vec<usize>,
    first_missing: Option<(usize, usize)>,
    /// Metadata among the rows, each with its line.
    metadata: Vec<(usize, &'t str)>,
    /// The line of a row that cannot be read, and the text from it on. Nothing behind it was looked at.
    failed: Option<(usize, &'t str)>,
}

impl Header<'_> {
    /// Reads all rows of a text whose first line has number `line`, in pieces of about so many bytes. Metadata among them are taken.
    ///
    /// # Errors
    /// That of the first line that cannot be used.
    pub fn read(
        &self,
        text: &str,
        line: usize,
        piece: usize,
        metadata: &mut metadata::Lines,
    ) -> Result<Rows, BadInput> {
        let texts = cut(text, piece);
        // A piece has no more rows than lines.
        let most = side_by_side::each(texts.clone(), |t| memchr::memchr_iter(b'\n', t.as_bytes()).count() + 1);
        let total = most.iter().sum();
        let mut columns: Vec<Vec<f64>> =
            self.kept.iter().map(|kept| if *kept { vec![0.0; total] } else { Vec::new() }).collect();
        let mut parts: Vec<(&str, Vec<&mut [f64]>)> = texts.into_iter().map(|t| (t, Vec::new())).collect();
        for column in &mut columns {
            let mut rest = &mut column[..];
            for ((_, slices), n) in parts.iter_mut().zip(&most) {
                let part;
                (part, rest) = rest.split_at_mut((*n).min(rest.len()));
                slices.push(part);
            }
        }
        let pieces = side_by_side::each(parts, |(text, slices)| self.piece(text, slices));
        let (mut before, mut rows, mut from) = (line - 1, 0, 0);
        let (mut missing, mut first_missing) = (vec![0; self.names.len()], None);
        for (piece, most) in pieces.into_iter().zip(most) {
            for (line, text) in piece.metadata {
                metadata.take(before + line, text)?;
            }
            if let Some((line, text)) = piece.failed {
                // Once more, with its number in the file.
                self.row(before + line, text, &mut |_, _| {})?;
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
        columns.iter_mut().for_each(|c| c.truncate(rows));
        Ok(Rows { columns, missing, first_missing })
    }

    fn piece<'t>(&self, text: &'t str, mut columns: Vec<&mut [f64]>) -> Piece<'t> {
        let mut out = Piece {
            rows: 0,
            lines: 0,
            missing: vec![0; self.names.len()],
            first_missing: None,
            metadata: Vec::new(),
            failed: None,
        };
        let mut rest = text;
        while let Some(first) = rest.bytes().next() {
            out.lines += 1;
            // Nearly all lines: a row of data, taken off the front of the text without a look for its end.
            let (row, after) = if matches!(first, b'0'..=b'9' | b'-') {
                (rest, None)
            } else {
                let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
                let line = line.trim_end_matches('\r');
                if let Some(meta) = line.trim_start().strip_prefix('#') {
                    out.metadata.push((out.lines, meta));
                    rest = after;
                    continue;
                }
                if line.trim().is_empty() {
                    rest = after;
                    continue;
                }
                (line, Some(after))
            };
            let (at, line) = (out.rows, out.lines);
            let taken = self.row(line, row, &mut |k, value| {
                if value.is_nan() {
                    out.missing[k] += 1;
                    out.first_missing.get_or_insert((line, k + 1));
                }
                columns[k][at] = value;
            });
            match taken {
                Ok(behind) => rest = after.unwrap_or(behind),
                Err(_) => {
                    out.failed = Some((line, row));
                    return out;
                }
            }
            out.rows += 1;
        }
        out
    }

    /// Takes a row off the front of `text`, giving each cell that is read to `take`; gives what follows the row.
    #[inline]
    fn row<'t>(&self, line: usize, text: &'t str, take: &mut impl FnMut(usize, f64)) -> Result<&'t str, BadInput> {
        let bytes = text.as_bytes();
        let (mut at, mut cells) = (0, 0);
        loop {
            let kept = self.kept.get(cells) == Some(&true);
            cells += 1;
            let (value, end) = match plain_number(&bytes[at..]) {
                Some((value, n)) => (value, at + n),
                None => {
                    let end =
                        bytes[at..].iter().position(|b| matches!(b, b',' | b'\n')).map_or(bytes.len(), |n| at + n);
                    let value = if kept { self.number(line, text[at..end].trim(), cells)? } else { 0.0 };
                    (value, end)
                }
            };
            if kept {
                take(cells - 1, value);
            }
            at = (end + 1).min(bytes.len());
            if bytes.get(end) != Some(&b',') {
                break;
            }
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
        Ok(&text[at..])
    }

    /// A cell that is not a plain number: missing, with an exponent, very long, or wrong.
    fn number(&self, line: usize, cell: &str, column: usize) -> Result<f64, BadInput> {
        if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
            return Ok(f64::NAN);
        }
        cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
            BadInput(format!(
                "line {line}, column {column} ({}): \"{}\" is not a number; correct or empty the cell",
                self.names.get(column - 1).unwrap_or(&""),
                cell.chars().take(24).collect::<String>()
            ))
        })
    }
}

/// A text in pieces of about so many bytes, each of whole lines.
fn cut(text: &str, piece: usize) -> Vec<&str> {
    let mut out = Vec::new();
    let mut rest = text;
    while rest.len() > piece {
        let end = rest.as_bytes()[piece..].iter().position(|b| *b == b'\n').map_or(rest.len(), |n| piece + n + 1);
        let first;
        (first, rest) = rest.split_at(end);
        out.push(first);
    }
    out.push(rest);
    out
}

/// Powers of ten that an f64 holds exactly.
const EXACT: [f64; 16] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];

/// A number of at most 15 digits, with or without sign and point, and the place of the comma or line feed that ends it. Such a
/// number is a quotient of two that an f64 holds exactly, so that one division gives what the standard library's parser gives.
#[inline]
fn plain_number(bytes: &[u8]) -> Option<(f64, usize)> {
    let negative = bytes.first() == Some(&b'-');
    let (whole, from) = digits(bytes, usize::from(negative), 0);
    let count = from - usize::from(negative);
    let (mantissa, at, fraction) = if bytes.get(from) == Some(&b'.') {
        let (mantissa, at) = digits(bytes, from + 1, whole);
        (mantissa, at, at - from - 1)
    } else {
        (whole, from, 0)
    };
    if !(1..=15).contains(&(count + fraction)) {
        return None;
    }
    let end = match bytes.get(at) {
        None | Some(b',' | b'\n') => at,
        Some(b'\r') if matches!(bytes.get(at + 1), None | Some(b'\n')) => at + 1,
        Some(_) => return None,
    };
    let value = mantissa as f64 / EXACT[fraction];
    Some((if negative { -value } else { value }, end))
}

/// Powers of ten up to eight digits.
const SHIFT: [u64; 9] = [1, 10, 100, 1000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// Takes digits from a place on, behind those of `value`; gives what they make together (modulo 2^64) and the place behind them. Eight bytes at
/// a time: how many of them are digits, and what their value is, takes a few operations on the word that they make.
#[inline]
fn digits(bytes: &[u8], mut at: usize, mut value: u64) -> (u64, usize) {
    while let Some(eight) = bytes.get(at..).and_then(<[u8]>::first_chunk::<8>) {
        let x = u64::from_le_bytes(*eight) ^ 0x3030_3030_3030_3030;
        // The high bit of each byte that is no digit: above 9 now, or above 127. (No byte carries into the next: their high bits are left out.)
        let low = x & 0x7F7F_7F7F_7F7F_7F7F;
        let others = ((low + 0x7676_7676_7676_7676) | x) & 0x8080_8080_8080_8080;
        let n = others.trailing_zeros() as usize / 8;
        if n == 0 {
            return (value, at);
        }
        // The digits at the end of the word, zeros before them; pairs, fours and eight of them.
        let x = x << (64 - 8 * n);
        let x = x.wrapping_mul(10).wrapping_add(x >> 8);
        let four = |x: u64, scale: u64| (x & 0x0000_00FF_0000_00FF).wrapping_mul(scale);
        let sum = four(x, 0x000F_4240_0000_0064).wrapping_add(four(x >> 16, 0x0000_2710_0000_0001)) >> 32;
        value = value.wrapping_mul(SHIFT[n]).wrapping_add(sum);
        at += n;
        if n < 8 {
            return (value, at);
        }
    }
    while let Some(b) = bytes.get(at).filter(|b| b.is_ascii_digit()) {
        value = value.wrapping_mul(10).wrapping_add(u64::from(b - b'0'));
        at += 1;
    }
    (value, at)
}

#[cfg(test)]
mod tests {
    use super::*;

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
