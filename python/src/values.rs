//! Values that go to Python and come from it: bytes, paths, JSON, pages, tables.

use hrg_data::error::BadInput;
use hrg_data::files::MOST_RECORDING;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};

/// Bytes for Python.
pub fn bytes<'py>(py: Python<'py>, b: &[u8]) -> Bound<'py, PyBytes> {
    PyBytes::new(py, b)
}

/// Reads a file as a calibration does.
pub fn path_of(source: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    source.extract::<PathBuf>().map(|p| Path::new(&p).to_path_buf())
}

/// JSON as Python has it.
pub fn of_json<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}

/// A page within a page: its styles stay its own.
pub fn framed(html: &str) -> String {
    let page = html.replace('&', "&amp;").replace('"', "&quot;");
    format!("<iframe srcdoc=\"{page}\" width=\"100%\" height=\"900\" style=\"border:0\"></iframe>")
}

/// Reads a table as text.
pub fn table(path: &Path) -> Result<String, BadInput> {
    let bytes = hrg_data::files::read_file(path, MOST_RECORDING, true)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Names of an object's own attributes, and of the keys of its file.
pub fn names(of: &Bound<'_, PyAny>, keys: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let own: Vec<String> = of.get_type().dir()?.iter().map(|n| n.extract()).collect::<PyResult<_>>()?;
    let keys = keys.call_method0("keys")?.try_iter()?.map(|k| k?.extract()).collect::<PyResult<Vec<String>>>()?;
    // (A word that Python keeps for itself has _ behind it.)
    let keys = keys.into_iter().map(|k| if k == "final" { "final_".to_string() } else { k });
    let mut all: Vec<String> = own.into_iter().chain(keys).collect();
    all.sort();
    all.dedup();
    Ok(all)
}
