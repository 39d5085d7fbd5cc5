//! Tables that lie column by column (Parquet, ArduPilot's logs): the columns that a map wants, as numbers.

use super::map::Map;
use super::{choose, imu_number, Table};
use crate::error::BadInput;
use crate::recording::dialect;
use crate::recording::dialect::is_missing;
use crate::recording::parquet;
use crate::recording::parquet::Cells;
use crate::recording::time_form::TimeForm;
use std::collections::BTreeSet;
use std::path::Path;

/// A Parquet table, read batch by batch.
pub struct Batches<'m> {
    from: parquet::Batches<std::fs::File>,
    filling: Filling<'m>,
}

impl<'m> Batches<'m> {
    /// Of a file.
    ///
    /// # Errors
    /// A file that is none.
    pub fn open(path: &Path, map: &'m Map) -> Result<Self, BadInput> {
        Ok(Self { from: parquet::Batches::open(path)?, filling: Filling::new(map) })
    }

    /// The rows of the next batch; `None` behind the last.
    ///
    /// # Errors
    /// One sentence with row and column.
    pub fn next_batch(&mut self) -> Result<Option<Table>, BadInput> {
        self.from.next_batch()?.map(|columns| self.filling.take(&columns)).transpose()
    }

    /// Notes of the whole, behind the last batch.
    ///
    /// # Errors
    /// The file does not have the IMU that is wanted.
    pub fn notes(&self) -> Result<Vec<String>, BadInput> {
        let mut notes = self.filling.notes()?;
        if !self.from.others.is_empty() {
            notes.push(format!(
                "columns of lists, structures or decimals are left out: {}",
                crate::error::list(&self.from.others)
            ));
        }
        Ok(notes)
    }
}

/// The columns that a map wants, of those that are there.
///
/// # Errors
/// One sentence with row and column.
pub fn table(columns: &[(String, Cells)], map: &Map) -> Result<Table, BadInput> {
    let mut filling = Filling::new(map);
    let table = filling.take(columns)?;
    Ok(Table { notes: filling.notes()?, ..table })
}

/// A table that columns are put into, some rows at a time.
struct Filling<'m> {
    map: &'m Map,
    /// Rows so far, and those of them that were dropped by the map.
    rows: usize,
    dropped: usize,
    /// Cells that are empty.
    empty: usize,
    /// Numbers of IMUs.
    imus: BTreeSet<u8>,
}

impl<'m> Filling<'m> {
    fn new(map: &'m Map) -> Self {
        Self { map, rows: 0, dropped: 0, empty: 0, imus: BTreeSet::new() }
    }

    fn take(&mut self, columns: &[(String, Cells)]) -> Result<Table, BadInput> {
        let names: Vec<String> = columns.iter().map(|(n, _)| n.clone()).collect();
        let wanted = choose(self.map, &names)?;
        let mut table = Table::default();
        let rows = self.kept(columns)?;
        for (at, name) in wanted {
            let is_time = self.map.time.column.as_ref().is_some_and(|c| c.all().contains(&name.as_str()));
            let form = self.map.time.form()?;
            let dates = (is_time && !form.is_number()).then_some(&form);
            let cells = &columns[at].1;
            let values = rows.iter().map(|k| number(cells, *k, dates)).collect::<Option<Vec<f64>>>();
            let values = values.ok_or_else(|| {
                let row = rows.iter().find(|k| number(cells, **k, dates).is_none()).map_or(0, |k| self.rows + k + 1);
                let wanted = dates.map_or("a number".to_string(), |f| format!("a time of the form {}", f.name()));
                BadInput(format!("row {row}, column \"{name}\": the cell is not {wanted}; correct or empty it"))
            })?;
            if dates.is_some() {
                table.time_s = Some(values);
            } else {
                table.columns.push((name, values));
            }
        }
        self.empty += table.columns.iter().map(|(_, v)| v.iter().filter(|v| v.is_nan()).count()).sum::<usize>();
        self.rows += columns.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
        Ok(table)
    }

    /// The rows that the map keeps, in order.
    fn kept(&mut self, columns: &[(String, Cells)]) -> Result<Vec<usize>, BadInput> {
        let rows = columns.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
        let mut kept: Vec<usize> = (0..rows).collect();
        for (name, word) in &self.map.table.keep {
            let (_, cells) = columns.iter().find(|(n, _)| n == name).ok_or_else(|| {
                let names: Vec<&str> = columns.iter().map(|(n, _)| n.as_str()).collect();
                BadInput(format!(
                    "the map keeps rows by the column \"{name}\", which is not there; there are {}",
                    names.join(", ")
                ))
            })?;
            kept.retain(|k| match cells {
                Cells::Texts(v) => v.get(*k).is_some_and(|t| t == word),
                Cells::Numbers(v, _) => v.get(*k).is_some_and(|n| word.parse() == Ok(*n)),
            });
        }
        let numbers = self.map.table.instance_column.as_ref().and_then(|name| columns.iter().find(|(n, _)| n == name));
        if let Some((_, cells)) = numbers {
            let number = |k: usize| imu_number(number(cells, k, None));
            self.imus.extend(kept.iter().filter_map(|k| number(*k)));
            kept.retain(|k| number(*k) == Some(self.map.table.instance));
        }
        let dropped = (self.map.table.drop_rows - self.dropped).min(kept.len());
        self.dropped += dropped;
        Ok(kept.split_off(dropped))
    }

    fn notes(&self) -> Result<Vec<String>, BadInput> {
        let empty = (self.empty > 0).then(|| format!("{} cells are empty", self.empty));
        Ok(super::others(&self.imus, self.map.table.instance)?.into_iter().chain(empty).collect())
    }
}

/// A cell as a number, or in seconds where it is a date; `None` where it is neither.
fn number(cells: &Cells, k: usize, dates: Option<&TimeForm>) -> Option<f64> {
    match (cells, dates) {
        (Cells::Numbers(v, Some(per_second)), Some(_)) => v.get(k).map(|v| v / per_second),
        (Cells::Numbers(v, _), _) => v.get(k).copied(),
        (Cells::Texts(v), Some(form)) => form.read(v.get(k)?.trim()),
        (Cells::Texts(v), None) => {
            let text = v.get(k)?.trim();
            if is_missing(text) {
                Some(f64::NAN)
            } else {
                dialect::number(text)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "hrg-map = 1
[table]
drop_rows = 1
keep = { imu = \"0\" }
[time]
column = \"t\"
unit = \"ms\"
[temperature]
all = { column = \"T\" }
[rate]
z = { column = \"gz\", unit = \"deg/s\" }
";

    #[test]
    fn rows_and_columns_are_those_of_the_map() {
        let csv = "t,imu,T,gz\n0,0,20,1\n10,1,99,9\n20,0,21,2\n30,0,,3\n";
        let columns = parquet::first_rows(parquet::from_csv(csv));
        let read = |map: &str| table(&columns, &Map::parse(map).expect("a map"));
        let table = read(MAP).expect("fits");
        assert_eq!(table.columns[0], ("t".into(), vec![20.0, 30.0]));
        assert_eq!(table.columns[2], ("gz".into(), vec![2.0, 3.0]));
        assert!(table.columns[1].1[1].is_nan() && table.notes == ["1 cells are empty"]);
        let e = read(&MAP.replace("gz", "wz")).expect_err("no wz").0;
        assert!(e.contains("\"wz\"") && e.contains("\"gz\""), "{e}");
        let e = read(&MAP.replace("imu", "I")).expect_err("no I").0;
        assert!(e.contains("\"I\", which is not there; there are t, imu, T, gz"), "{e}");
    }
}
