//! A table of static points: one row per soak.

use hrg_core::AXES;
use hrg_data::recording::columns;

/// Fewest soaks of a table, or of one axis of it.
pub(super) const LEAST_SOAKS: usize = 6;
/// More rows are those of a recording.
const MOST_SOAKS: usize = 1000;

/// Quantity in a column of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Slot {
    Chamber,
    Frequency(usize),
    Case(usize),
}

/// Why a table of soaks cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TableError {
    /// Text where a number should be.
    #[error("line {line}, column {column}: \"{cell}\" is not a number")]
    NotANumber {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// Text of the cell.
        cell: String,
    },
    /// Too few rows.
    #[error("the table has {0} soaks; a cubic with a leave-one-out check needs six at the least")]
    TooFew(usize),
    /// A recording in the place of a table.
    #[error("the table has {0} rows; one of soaks has some ten: this is a recording, and hrg fit soaks (hrg.soaks) takes the soaks out of it")]
    TooMany(usize),
    /// A column that is there twice.
    #[error("line {line}, column {column}: {name} is there twice; remove one")]
    Twice {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// Its name.
        name: String,
    },
    /// A column that is not there.
    #[error("line {line}: the column {missing} is missing; a table of soaks has f?_hz, and chamber_c or case_?_c; there are {there}")]
    Missing {
        /// Line, from 1.
        line: usize,
        /// Missing column.
        missing: &'static str,
        /// Columns that are there.
        there: String,
    },
}

impl From<TableError> for hrg_data::error::BadInput {
    fn from(e: TableError) -> Self {
        Self(e.to_string())
    }
}

/// A table of soaks; NaN where a cell is empty.
#[derive(Debug, Clone, Default)]
pub struct Points {
    /// Number of soaks.
    pub rows: usize,
    /// Chamber temperature, C.
    pub chamber_c: Vec<f64>,
    /// Frequencies, Hz.
    pub frequency_hz: [Vec<f64>; AXES],
    /// Sensors on the cases, C.
    pub case_c: [Vec<f64>; AXES],
}

impl Points {
    /// Reads the table. Frequencies of one to three bodies or modes; sensors on their cases and the chamber's sensor may be
    /// missing, in single cells or altogether.
    ///
    /// # Errors
    /// One sentence with line and column.
    pub fn parse(text: &str) -> Result<Self, TableError> {
        let mut header: Option<Vec<Option<Slot>>> = None;
        let mut out = Self::default();
        for (index, line) in text.lines().enumerate() {
            if line.starts_with('#') || line.trim().is_empty() {
                continue;
            }
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let Some(slots) = &header else {
                header = Some(out.slots(&cells, index + 1)?);
                continue;
            };
            out.rows += 1;
            let rows = out.rows;
            for (k, slot) in slots.iter().enumerate() {
                let Some(slot) = slot else { continue };
                let cell = cells.get(k).copied().unwrap_or("");
                let value = if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
                    f64::NAN
                } else {
                    cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| TableError::NotANumber {
                        line: index + 1,
                        column: k + 1,
                        cell: cell.into(),
                    })?
                };
                match slot {
                    Slot::Chamber => out.chamber_c.push(value),
                    Slot::Frequency(a) => out.frequency_hz[*a].push(value),
                    Slot::Case(a) => out.case_c[*a].push(value),
                }
            }
            for column in out.frequency_hz.iter_mut().chain(&mut out.case_c).chain([&mut out.chamber_c]) {
                column.resize(rows, f64::NAN);
            }
        }
        if out.rows < LEAST_SOAKS {
            return Err(TableError::TooFew(out.rows));
        }
        if out.rows > MOST_SOAKS {
            return Err(TableError::TooMany(out.rows));
        }
        Ok(out)
    }

    fn slots(&mut self, names: &[&str], line: usize) -> Result<Vec<Option<Slot>>, TableError> {
        let of = |name: &str| -> Option<Slot> {
            let (column, a) = columns::find(name)?;
            match column {
                c if *c == columns::CHAMBER => Some(Slot::Chamber),
                c if *c == columns::FREQUENCY => Some(Slot::Frequency(a)),
                c if *c == columns::CASE => Some(Slot::Case(a)),
                _ => None,
            }
        };
        let slots: Vec<Option<Slot>> = names.iter().map(|n| of(n)).collect();
        for (k, slot) in slots.iter().enumerate().filter(|(_, s)| s.is_some()) {
            if slots[..k].contains(slot) {
                return Err(TableError::Twice { line, column: k + 1, name: names[k].into() });
            }
        }
        let has = |wanted: &dyn Fn(&Slot) -> bool| slots.iter().flatten().any(wanted);
        let missing = if !has(&|s| matches!(s, Slot::Frequency(_))) {
            "fx_hz (or fy_hz, fz_hz)"
        } else if !has(&|s| !matches!(s, Slot::Frequency(_))) {
            "chamber_c (or case_x_c, ...)"
        } else {
            return Ok(slots);
        };
        Err(TableError::Missing { line, missing, there: names.join(", ") })
    }

    /// The rows that have the frequency of every axis, and the reference.
    pub(super) fn complete(&self, reference: &str) -> Option<Self> {
        let all = |k: &usize| {
            (0..AXES).all(|a| self.frequency_hz[a][*k].is_finite() && self.temperatures(reference, a)[*k].is_finite())
        };
        let rows: Vec<usize> = (0..self.rows).filter(all).collect();
        let pick = |v: &[f64]| rows.iter().map(|&k| v[k]).collect::<Vec<f64>>();
        (rows.len() >= LEAST_SOAKS).then(|| Self {
            rows: rows.len(),
            chamber_c: pick(&self.chamber_c),
            frequency_hz: self.frequency_hz.each_ref().map(|v| pick(v)),
            case_c: self.case_c.each_ref().map(|v| pick(v)),
        })
    }

    pub(super) fn temperatures(&self, reference: &str, a: usize) -> &[f64] {
        if reference == "shell" {
            &self.case_c[a]
        } else {
            &self.chamber_c
        }
    }
}
