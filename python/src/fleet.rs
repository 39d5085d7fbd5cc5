//! Many units at once: what `hrg/fleet.py` hands to the workers of a Dask scheduler.

use crate::{refused, work};
use hrg::fleet;
use hrg::fleet::{Kept, Row, UnitFiles, Wanted};
use pyo3::prelude::*;
use std::path::PathBuf;

fn wanted(family: Option<PathBuf>, limit: Option<[f64; 3]>) -> Wanted {
    Wanted { family, limit }
}

fn unit_of(json: &str) -> PyResult<UnitFiles> {
    serde_json::from_str(json).map_err(refused)
}

fn row_of(json: &str) -> PyResult<Row> {
    serde_json::from_str(json).map_err(refused)
}

fn json_of(row: &Row) -> PyResult<String> {
    serde_json::to_string(row).map_err(refused)
}

/// The units of a folder, each as JSON.
#[pyfunction]
#[pyo3(signature = (folder, out, family=None, limit=None))]
pub fn fleet_units(
    folder: PathBuf,
    out: PathBuf,
    family: Option<PathBuf>,
    limit: Option<[f64; 3]>,
) -> PyResult<Vec<String>> {
    let units = fleet::units(&folder, &out, &wanted(family, limit)).map_err(refused)?;
    units.iter().map(|u| serde_json::to_string(u).map_err(refused)).collect()
}

/// The row of a unit, as JSON.
#[pyfunction]
#[pyo3(signature = (unit, family=None, limit=None))]
pub fn fleet_row(py: Python<'_>, unit: &str, family: Option<PathBuf>, limit: Option<[f64; 3]>) -> PyResult<String> {
    let (files, wanted): (UnitFiles, Wanted) = (unit_of(unit)?, wanted(family, limit));
    json_of(&work::run(py, None, || Ok(fleet::row(&files, &wanted)))?)
}

/// The row of a unit that is there already, as JSON; `None`: it is to be made.
#[pyfunction]
#[pyo3(signature = (out, unit, family=None, limit=None))]
pub fn fleet_kept(
    out: PathBuf,
    unit: &str,
    family: Option<PathBuf>,
    limit: Option<[f64; 3]>,
) -> PyResult<Option<String>> {
    let kept = Kept::new(&out).map_err(refused)?;
    kept.get(&unit_of(unit)?, &wanted(family, limit)).as_ref().map(json_of).transpose()
}

/// Keeps a row.
#[pyfunction]
#[pyo3(signature = (out, unit, row, family=None, limit=None))]
pub fn fleet_keep(
    out: PathBuf,
    unit: &str,
    row: &str,
    family: Option<PathBuf>,
    limit: Option<[f64; 3]>,
) -> PyResult<()> {
    let kept = Kept::new(&out).map_err(refused)?;
    kept.keep(&unit_of(unit)?, &wanted(family, limit), &row_of(row)?).map_err(refused)
}

/// Writes table and page of some rows.
#[pyfunction]
pub fn fleet_write(out: PathBuf, title: &str, rows: Vec<String>) -> PyResult<()> {
    let rows: Vec<Row> = rows.iter().map(|r| row_of(r)).collect::<PyResult<_>>()?;
    fleet::write(&out, title, &rows).map_err(refused)
}
