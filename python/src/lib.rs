//! The Python package `hrg`: the desktop crates themselves, with numpy arrays in and out. The file `lib/hrg/_hrg.pyi` describes its interface.

// Arguments come from Python by value.
#![allow(clippy::needless_pass_by_value)]

mod calibration;
mod fleet;
mod pages;
mod recording;
mod tools;
mod user_effects;
mod values;
mod work;

use calibration::Calibration;
use hrg_data::error::BadInput;
use pyo3::prelude::*;

pyo3::create_exception!(
    hrg,
    HrgError,
    pyo3::exceptions::PyValueError,
    "An input that cannot be used: one sentence that says what, where and what to do."
);

/// Bad input, and whatever else went wrong, as the one exception of the package.
fn refused(e: impl Into<anyhow::Error>) -> PyErr {
    HrgError::new_err(format!("{:#}", e.into()))
}

fn bad(sentence: impl Into<String>) -> PyErr {
    refused(BadInput::new(sentence))
}

#[pymodule]
fn _hrg(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("HrgError", m.py().get_type::<HrgError>())?;
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_class::<recording::Recording>()?;
    m.add_class::<recording::Corrected>()?;
    m.add_class::<calibration::Calibration>()?;
    m.add_class::<calibration::Report>()?;
    m.add_class::<pages::Figures>()?;
    m.add_class::<tools::LinkDecoder>()?;
    m.add_class::<tools::LogDecoder>()?;
    for function in [
        wrap_pyfunction!(calibration::fit, m)?,
        wrap_pyfunction!(calibration::methods, m)?,
        wrap_pyfunction!(calibration::trace, m)?,
        wrap_pyfunction!(pages::compare, m)?,
        wrap_pyfunction!(pages::data_sheet, m)?,
        wrap_pyfunction!(pages::judge, m)?,
        wrap_pyfunction!(pages::soaks, m)?,
        wrap_pyfunction!(pages::identify_accelerometers, m)?,
        wrap_pyfunction!(fleet::fleet_units, m)?,
        wrap_pyfunction!(fleet::fleet_row, m)?,
        wrap_pyfunction!(fleet::fleet_kept, m)?,
        wrap_pyfunction!(fleet::fleet_keep, m)?,
        wrap_pyfunction!(fleet::fleet_write, m)?,
        wrap_pyfunction!(calibration::correct, m)?,
        wrap_pyfunction!(recording::import_table, m)?,
        wrap_pyfunction!(recording::simulate, m)?,
        wrap_pyfunction!(tools::allan, m)?,
        wrap_pyfunction!(tools::align, m)?,
        wrap_pyfunction!(tools::points, m)?,
        wrap_pyfunction!(tools::effects, m)?,
    ] {
        m.add_function(function)?;
    }
    Ok(())
}
