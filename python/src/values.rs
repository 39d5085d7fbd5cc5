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
