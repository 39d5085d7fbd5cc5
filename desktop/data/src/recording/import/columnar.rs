//! Tables that lie column by column (Parquet, ArduPilot's logs): the columns that a map wants, as numbers.

use super::map::Map;
use super::{choose, imu_number, Table};
use crate::error::BadInput;
use crate::recording::dialect;
use crate::recording::dialect::is_missing;
use crate::recording::parquet;
use crate::recording::parquet::Cells;
use crate::recording::time_form::TimeForm;

/// Reads the columns of a Parquet table that a map wants.
///
/// # Errors
/// One sentence with row and column.
pub fn read(bytes: Vec<u8>, map: &Map) -> Result<Table, BadInput> {
    let contents = parquet::read(bytes)?;
    let mut table = table(&contents.columns, map)?;
    if !contents.others.is_empty() {
        table.notes.push(format!(
            "columns of lists, structures or decimals are left out: {}",
            crate::error::list(&contents.others)
        ));
    }
    Ok(table)
}

/// The columns that a map wants, of those that are there.
///
/// # Errors
/// One sentence with row and column.
pub fn table(columns: &[(String, Cells)], map: &Map) -> Result<Table, BadInput> {
    let names: Vec<String> = columns.iter().map(|(n, _)| n.clone()).collect();
    let wanted = choose(map, &names)?;
    let mut table = Table::default();
    let rows = kept(columns, map, &mut table.notes)?;
    for (at, name) in wanted {
        let is_time = map.time.column.as_ref().is_some_and(|c| c.all().contains(&name.as_str()));
        let form = map.time.form()?;
        let dates = (is_time && !form.is_number()).then_some(&form);
        let cells = &columns[at].1;
        let values = rows.iter().map(|k| number(cells, *k, dates)).collect::<Option<Vec<f64>>>();
        let values = values.ok_or_else(|| {
            let row = rows.iter().find(|k| number(cells, **k, dates).is_none()).map_or(0, |k| k + 1);
            let wanted = dates.map_or("a number".to_string(), |f| format!("a time of the form {}", f.name()));
            BadInput(format!("row {row}, column \"{name}\": the cell is not {wanted}; correct or empty it"))
        })?;
        if dates.is_some() {
            table.time_s = Some(values);
        } else {
            table.columns.push((name, values));
        }
    }
    let empty: usize = table.columns.iter().map(|(_, v)| v.iter().filter(|v| v.is_nan()).count()).sum();
    if empty > 0 {
        table.notes.push(format!("{empty} cells are empty"));
    }
    Ok(table)
}

/// The rows that the map keeps, in order.
fn kept(columns: &[(String, Cells)], map: &Map, notes: &mut Vec<String>) -> Result<Vec<usize>, BadInput> {
    let rows = columns.iter().map(|(_, c)| c.len()).max().unwrap_or(0);
    let mut kept: Vec<usize> = (0..rows).collect();
    for (name, word) in &map.table.keep {
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
    let numbers = map.table.instance_column.as_ref().and_then(|name| columns.iter().find(|(n, _)| n == name));
    if let Some((_, cells)) = numbers {
        let number = |k: usize| imu_number(number(cells, k, None));
        let imus = kept.iter().filter_map(|k| number(*k)).collect();
        let taken = map.table.instance;
        kept.retain(|k| number(*k) == Some(taken));
        if kept.is_empty() {
            let there: Vec<String> = std::collections::BTreeSet::iter(&imus).map(u8::to_string).collect();
            return Err(BadInput(format!("the file has no IMU {taken}; it has {}", crate::error::list(&there))));
        }
        notes.extend(super::others(&imus, taken));
    }
    Ok(kept.split_off(map.table.drop_rows.min(kept.len())))
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
        let bytes = parquet::from_csv(csv).expect("written");
        let table = read(bytes.clone(), &Map::parse(MAP).expect("a map")).expect("fits");
        assert_eq!(table.columns[0], ("t".into(), vec![20.0, 30.0]));
        assert_eq!(table.columns[2], ("gz".into(), vec![2.0, 3.0]));
        assert!(table.columns[1].1[1].is_nan() && table.notes == ["1 cells are empty"]);
        let e = read(bytes.clone(), &Map::parse(&MAP.replace("gz", "wz")).expect("a map")).expect_err("no wz").0;
        assert!(e.contains("\"wz\"") && e.contains("\"gz\""), "{e}");
        let e = read(bytes, &Map::parse(&MAP.replace("imu", "I")).expect("a map")).expect_err("no I").0;
        assert!(e.contains("\"I\", which is not there; there are t, imu, T, gz"), "{e}");
    }
}
