//! The table of a fleet: one row a unit, one column a figure.

use super::Row;
use hrg_data::recording::parquet::{write_table, Cells};
use std::collections::BTreeSet;

/// The columns of the table: those that each unit has, then the figures by their names.
fn columns(rows: &[Row]) -> Vec<(String, Cells)> {
    let text =
        |name: &str, of: &dyn Fn(&Row) -> String| (name.to_string(), Cells::Texts(rows.iter().map(of).collect()));
    let number =
        |name: &str, of: &dyn Fn(&Row) -> f64| (name.to_string(), Cells::Numbers(rows.iter().map(of).collect(), None));
    let mut out = vec![
        text("unit", &|r| r.unit.clone()),
        text("batch", &|r| r.batch.clone()),
        number("runs", &|r| r.runs as f64),
        text("error", &|r| r.error.clone()),
        text("verdict", &|r| r.verdict.clone()),
        text("image", &|r| r.image.clone()),
        number("burn", &|r| f64::from(u8::from(r.burn))),
        text("effects", &|r| r.effects.clone()),
        text("passes", &|r| r.passes.clone()),
    ];
    let names: BTreeSet<&String> = rows.iter().flat_map(|r| r.figures.keys()).collect();
    out.extend(names.into_iter().map(|n| number(n, &|r| r.figure(n).unwrap_or(f64::NAN))));
    out
}

/// The table as Parquet.
///
/// # Errors
/// None in practice.
pub(super) fn parquet(rows: &[Row]) -> anyhow::Result<Vec<u8>> {
    write_table(&columns(rows))
}
