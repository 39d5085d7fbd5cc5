//! Excel's files, and other spreadsheets': the columns that a map wants, as numbers.

use super::delimited::fill;
use super::map::Map;
use super::Table;
use crate::error::BadInput;
use calamine::{open_workbook_auto_from_rs, Data, Reader};
use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

/// `true` if the name of a file is that of a spreadsheet.
pub fn is_named_so(path: &Path) -> bool {
    let ending = path.extension().map(std::ffi::OsStr::to_ascii_lowercase);
    ending.is_some_and(|e| ["xlsx", "xlsm", "xlsb", "xls", "ods"].iter().any(|x| e == *x))
}

/// Cells of the rows of a sheet as text; dates as ISO 8601. `name`: of the sheet; by default the one with most rows (a first sheet often holds
/// remarks).
///
/// # Errors
/// A file that is no spreadsheet, or has no such sheet.
pub fn rows(bytes: Vec<u8>, name: Option<&str>) -> Result<Vec<Vec<String>>, BadInput> {
    let mut book = open_workbook_auto_from_rs(Cursor::new(bytes))
        .map_err(|e| BadInput(format!("it cannot be read as a spreadsheet: {e}")))?;
    let sheets = book.sheet_names();
    let mut longest = || {
        let height = |s: &String| book.worksheet_range(s).map_or(0, |r| r.rows().filter(|row| row.len() > 1).count());
        let heights: Vec<usize> = sheets.iter().map(height).collect();
        let most = heights.iter().max()?;
        sheets.iter().zip(&heights).find(|(_, h)| *h == most).map(|(s, _)| s.clone())
    };
    let name = name.map(String::from).or_else(&mut longest);
    let name = name.ok_or_else(|| BadInput::new("the spreadsheet has no sheet"))?;
    let sheet = book
        .worksheet_range(&name)
        .map_err(|e| BadInput(format!("the sheet \"{name}\" cannot be read: {e}; there are {}", sheets.join(", "))))?;
    // (A range begins at its first cell that is used.)
    let above = sheet.start().map_or(0, |(row, _)| row as usize);
    let empty = std::iter::repeat_n(Vec::new(), above);
    Ok(empty.chain(sheet.rows().map(|row| row.iter().map(text).collect())).collect())
}

fn text(cell: &Data) -> String {
    match cell {
        Data::DateTime(t) => match t.as_datetime() {
            Some(t) if !t.format("%Y").to_string().starts_with("1899") => t.format("%Y-%m-%dT%H:%M:%S%.f").to_string(),
            Some(t) => t.format("%H:%M:%S%.f").to_string(),
            None => t.as_f64().to_string(),
        },
        Data::Empty | Data::Error(_) => String::new(),
        other => other.to_string().trim().to_string(),
    }
}

/// Reads the columns of a sheet that a map wants.
///
/// # Errors
/// One sentence with row and column.
pub fn read(bytes: Vec<u8>, map: &Map) -> Result<Table, BadInput> {
    let rows = rows(bytes, map.table.sheet.as_deref())?;
    let filled = |row: &Vec<String>| row.iter().any(|c| !c.is_empty());
    let data = rows.iter().enumerate().skip(map.table.skip_lines).filter(|(_, r)| filled(r));
    fill(map, data.map(|(k, row)| Ok((k + 1, row.iter().map(|c| Cow::Borrowed(c.as_str())).collect()))))
}
