//! A recording as a table, and its file: CSV by the contract of recordings, version 2.

use std::io;
use std::path::Path;

/// One column: its name, decimals in the file, and values. NaN is an empty cell.
#[derive(Clone, Debug)]
pub struct Column {
    /// Name with unit, as in the header.
    pub name: String,
    /// Decimals written.
    pub decimals: usize,
    /// One value a row.
    pub values: Vec<f64>,
}

/// A recording of one power-on.
#[derive(Clone, Debug)]
pub struct Recording {
    /// Metadata, in the order of the file; the first is `hrg-recording`.
    pub metadata: Vec<(String, String)>,
    /// Columns, in the order of the file.
    pub columns: Vec<Column>,
    /// Set if lines end with CR LF, as some loggers write them.
    pub crlf: bool,
    /// Text of an invalid number: nothing, or `NaN`.
    pub invalid: &'static str,
}

impl Recording {
    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.values.len())
    }

    /// Values of the column `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.name == name).map(|c| c.values.as_slice())
    }

    /// The file's text.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let end = if self.crlf { "\r\n" } else { "\n" };
        let mut out = String::with_capacity(self.rows() * self.columns.len() * 10);
        for (key, value) in &self.metadata {
            out += &format!("# {key}: {value}{end}");
        }
        let names: Vec<&str> = self.columns.iter().map(|c| c.name.as_str()).collect();
        out += &names.join(",");
        out += end;
        for row in 0..self.rows() {
            for (k, column) in self.columns.iter().enumerate() {
                if k > 0 {
                    out.push(',');
                }
                let value = column.values[row];
                if value.is_nan() {
                    out += self.invalid;
                } else {
                    push_fixed(&mut out, value, column.decimals);
                }
            }
            out += end;
        }
        out
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If the system cannot write the file.
    pub fn save(&self, path: &Path) -> io::Result<()> {
        std::fs::write(path, self.to_csv())
    }
}

/// Appends `value` with `decimals` decimals. Integers are several times as fast to write as the general form of a float; the values of a
/// recording times 10^7 stay far below 2^53.
fn push_fixed(out: &mut String, value: f64, decimals: usize) {
    let scaled = (value * 10_f64.powi(decimals as i32)).round();
    if scaled < 0.0 {
        out.push('-');
    }
    let mut rest = scaled.abs() as u64;
    let mut digits = [b'0'; 24];
    let mut at = digits.len();
    let mut written = 0;
    while rest > 0 || written <= decimals {
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
        written += 1;
        if written == decimals {
            at -= 1;
            digits[at] = b'.';
        }
    }
    out.extend(digits[at..].iter().map(|&digit| char::from(digit)));
}

#[cfg(test)]
mod tests {
    use super::push_fixed;

    #[test]
    fn fixed_numbers_are_written_as_the_standard_library_writes_them() {
        for (value, decimals) in [
            (0.0, 3),
            (4903.5, 7),
            (-0.004, 2),
            (-12.5, 4),
            (0.09, 1),
            (7.0, 0),
            (86_400.0, 0),
            (-1e-9, 5),
            (999.96, 1),
        ] {
            let mut text = String::new();
            push_fixed(&mut text, value, decimals);
            let standard = format!("{value:.decimals$}");
            assert_eq!(text, if standard.parse() == Ok(0.0) { standard.replace('-', "") } else { standard });
        }
    }
}
