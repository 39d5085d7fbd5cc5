//! Effects that a user has written in Python: columns in, columns out.

use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_identify::trace::user_effects::{Computed, OwnEffect, States};
use numpy::{PyArray1, PyArray2, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, PoisonError};

use crate::refused;

/// First exception that a user's function raised.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    fn keep(&self, e: PyErr) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
    }

    /// Makes it the cause of an error, if there was one.
    pub fn cause(&self, py: Python<'_>, of: &PyErr) {
        let raised = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        if raised.is_some() {
            of.set_cause(py, raised);
        }
    }
}

/// The effect of an `hrg.OwnEffect`.
pub fn effect(e: &Bound<'_, PyAny>, raised: &Raised) -> PyResult<OwnEffect> {
    let name: String = e.getattr("name")?.extract()?;
    let parameter: Option<(String, Vec<f64>)> = e.getattr("parameter")?.extract()?;
    let columns = e.getattr("_columns")?.unbind();
    let raised = raised.clone();
    let compute = move |states: &States<'_>| -> Computed {
        Python::attach(|py| {
            computed(py, &columns, states).map_err(|e| {
                let kind = e.get_type(py).qualname().map_or_else(|_| "an error".into(), |n| n.to_string());
                let printed = format!("its function raised {kind}: {}; correct the function", e.value(py));
                raised.keep(e);
                printed
            })
        })
    };
    OwnEffect::new(&name, parameter, compute).map_err(refused)
}

fn computed(py: Python<'_>, columns: &Py<PyAny>, states: &States<'_>) -> PyResult<Vec<Vec<f64>>> {
    let a = states.axis;
    let given = PyDict::new(py);
    let array = |v: Vec<f64>| PyArray1::from_vec(py, v);
    given.set_item("axis", AXIS_NAMES[a])?;
    given.set_item("step_s", states.step_s())?;
    given.set_item("time_s", array(states.time_s()))?;
    given.set_item("temperature_c", array(states.temperature_c(a)))?;
    given.set_item("ramp_c_per_min", array(states.ramp_c_per_min(a)))?;
    given.set_item("frequency_hz", array(states.frequency_hz()))?;
    let all: Vec<Vec<f64>> = (0..AXES).map(|k| states.temperature_c(k)).collect();
    let all = PyArray2::from_vec2(py, &all).map_err(|e| crate::bad(e.to_string()))?;
    given.set_item("temperatures_c", all.call_method0("transpose")?)?;
    for (name, values) in states.recorded() {
        given.set_item(name, array(values))?;
    }
    let out: PyReadonlyArray2<'_, f64> = columns.bind(py).call1((given, states.parameter))?.extract()?;
    Ok(out.as_array().outer_iter().map(|c| c.to_vec()).collect())
}
