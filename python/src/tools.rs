//! Allan deviation, alignment, static points, effects, and what a unit sends.

use crate::recording::Recording;
use crate::values::{of_json, path_of, table};
use crate::{bad, refused, work, Calibration};
use hrg::unit::log::housekeeping_of_line;
use hrg_align_tools as alignment;
use hrg_align_tools::accelerometers::Accelerometers;
use hrg_align_tools::FilterKind;
use hrg_core::effects::{Facts, Reach};
use hrg_core::link::{Deframer, Housekeeping, Message};
use hrg_core::rate_path::RateFrame;
use hrg_core::schema::{Layout, Number};
use hrg_data::cards::card;
use hrg_data::files::MOST_ELF;
use hrg_data::log::Decoder;
use hrg_data::numeric::allan as curve;
use hrg_identify::thermometer::points as static_points;
use hrg_identify::trace::equations::equation;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::path::PathBuf;

/// See `hrg.allan`.
#[pyfunction]
#[pyo3(signature = (source, step_s = None))]
pub fn allan<'py>(py: Python<'py>, source: &Bound<'py, PyAny>, step_s: Option<f64>) -> PyResult<Bound<'py, PyDict>> {
    let axes = if let Ok(r) = source.cast::<Recording>() {
        let r = &r.get().clean;
        work::run(py, None, || {
            let (rates, step_s) = r.even_rates();
            let rates: Vec<(usize, &[f64])> = r.present().map(|a| (a, rates[a].as_slice())).collect();
            Ok(curve::report(&rates, step_s)?)
        })?
    } else {
        let step_s = step_s.ok_or_else(|| bad("give the time between the values with step_s"))?;
        let values: PyReadonlyArray1<'_, f64> = source.extract()?;
        let values = values.as_slice().map_err(|e| bad(e.to_string()))?;
        work::run(py, None, || Ok(curve::report(&[(0, values)], step_s)?))?
    };
    let out = PyDict::new(py);
    for a in axes {
        let of = |f: &dyn Fn(&curve::Point) -> f64| PyArray1::from_vec(py, a.curve.iter().map(f).collect());
        let d = PyDict::new(py);
        d.set_item("tau_s", of(&|p| p.tau_s))?;
        d.set_item("deviation_dph", of(&|p| p.deviation))?;
        d.set_item("low_dph", of(&|p| p.low))?;
        d.set_item("high_dph", of(&|p| p.high))?;
        d.set_item("missing", a.missing)?;
        d.set_item("angle_random_walk_deg_per_root_h", a.readings.angle_random_walk_deg_per_root_h)?;
        d.set_item("bias_instability_dph", a.readings.bias_instability_dph)?;
        d.set_item("bias_instability_at_s", a.readings.bias_instability_at_s)?;
        d.set_item("rate_random_walk_dph_per_root_h", a.readings.rate_random_walk_dph_per_root_h)?;
        out.set_item(a.axis, d)?;
    }
    Ok(out)
}

/// Errors of accelerometers: a file of them, what [`crate::pages::identify_accelerometers`] gave, or a calibration that holds them.
fn accelerometers_of(source: &Bound<'_, PyAny>) -> PyResult<Accelerometers> {
    if let Ok(c) = source.cast::<Calibration>() {
        return Ok(Accelerometers::of_image(&c.get().inner.accelerometers));
    }
    if let Ok(d) = source.cast::<PyDict>() {
        let text: String = source.py().import("json")?.call_method1("dumps", (d,))?.extract()?;
        return Accelerometers::parse(&text)
            .map_err(|e| bad(format!("accelerometers: {e}; give what hrg.accelerometers gave")));
    }
    Accelerometers::load(&source.extract::<PathBuf>()?).map_err(refused)
}

/// Azimuth, tilts and drifts of a platform at rest, from the path of a recording in two positions; filters are linear, ekf and others
/// (`hrg align --help`). A dictionary.
#[pyfunction]
#[pyo3(signature = (path, filter = "linear", *, drift_dph = None, tilt_arcmin = None, accelerometers = None, first_azimuth_deg = 0.0, seed = 1))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn align<'py>(
    py: Python<'py>,
    path: PathBuf,
    filter: &str,
    drift_dph: Option<f64>,
    tilt_arcmin: Option<f64>,
    accelerometers: Option<Bound<'py, PyAny>>,
    first_azimuth_deg: f64,
    seed: u64,
) -> PyResult<Bound<'py, PyAny>> {
    let kind = FilterKind::ALL.into_iter().find(|k| k.name() == filter).ok_or_else(|| {
        let known: Vec<&str> = FilterKind::ALL.into_iter().map(FilterKind::name).collect();
        bad(format!("there is no filter \"{filter}\"; there are {}", known.join(", ")))
    })?;
    let errors = accelerometers.map(|a| accelerometers_of(&a)).transpose()?;
    let report = work::run(py, None, move || {
        let mut r = alignment::Recording::load(&path)?;
        if let Some(errors) = errors {
            errors.correct(&mut r);
        }
        let start = alignment::Start { azimuth_deg: first_azimuth_deg, seed, ..alignment::Start::default() };
        (r.drift_dph, r.tilt_arcmin) = (drift_dph.or(r.drift_dph), tilt_arcmin.or(r.tilt_arcmin));
        Ok(serde_json::to_string(&alignment::align(&r, kind, start)?)?)
    })?;
    of_json(py, &report)
}

/// Fits of frequency over temperature from the path of a table of static points. A dictionary.
#[pyfunction]
pub fn points<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyAny>> {
    let report = work::run(py, None, move || {
        let p = static_points::Points::parse(&table(&path)?)
            .map_err(|e| hrg_data::error::BadInput::new(format!("{}: {e}", path.display())))?;
        Ok(serde_json::to_string(&static_points::report(&p)?)?)
    })?;
    of_json(py, &report)
}

/// The effects of the library, a dictionary each: name, id, class, equation, parameters, outputs, reach, needs, remembers_path.
#[pyfunction]
pub fn effects(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let out = PyList::empty(py);
    for f in hrg_core::effects::ALL {
        let Facts { effect, name, id, parameters, outputs, reach, remembers_path, .. } = f;
        let d = PyDict::new(py);
        d.set_item("name", name)?;
        d.set_item("id", id)?;
        d.set_item("class", card(*effect).class.name())?;
        d.set_item("equation", equation(*effect))?;
        d.set_item("parameters", parameters.to_vec())?;
        d.set_item("outputs", outputs)?;
        d.set_item("remembers_path", remembers_path)?;
        let (reach, needs) = match reach {
            Reach::Unit => ("unit", None),
            Reach::NeedsInput(what) | Reach::NeedsChamber(what) => ("needs-input", Some(what)),
            Reach::Unpredictable => ("unpredictable", None),
        };
        d.set_item("reach", reach)?;
        d.set_item("needs", needs)?;
        out.append(d)?;
    }
    Ok(out)
}

/// The fields of a message by their names: a number, or a list of them.
fn fields<'py, L: Layout>(py: Python<'py>, kind: &str, message: &L) -> PyResult<Bound<'py, PyDict>> {
    let d = PyDict::new(py);
    d.set_item("message", kind)?;
    for (at, field) in L::FIELDS.iter().enumerate() {
        let values = PyList::empty(py);
        for n in (0..field.count).filter_map(|k| message.number(at, k)) {
            match n {
                Number::Whole(v) => values.append(v)?,
                Number::Single(v) => values.append(v)?,
                Number::Double(v) => values.append(v)?,
            }
        }
        if field.row == 0 && values.len() == 1 {
            d.set_item(field.name, values.get_item(0)?)?;
        } else {
            d.set_item(field.name, values)?;
        }
    }
    Ok(d)
}

/// The link of a unit, byte by byte.
#[pyclass(module = "hrg")]
pub struct LinkDecoder {
    deframer: Deframer,
    errors: u64,
}

#[pymethods]
impl LinkDecoder {
    #[new]
    fn new() -> Self {
        Self { deframer: Deframer::default(), errors: 0 }
    }

    /// Frames that were not good so far.
    #[getter]
    fn errors(&self) -> u64 {
        self.errors
    }

    fn push<'py>(&mut self, py: Python<'py>, data: &[u8]) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let mut out = Vec::new();
        for byte in data {
            match self.deframer.push(*byte) {
                Some(Ok(Message::Rate(f))) => out.push(fields::<RateFrame>(py, "rate", &f)?),
                Some(Ok(Message::Housekeeping(h))) => out.push(fields::<Housekeeping>(py, "housekeeping", &h)?),
                Some(Ok(_)) | None => {}
                Some(Err(_)) => self.errors += 1,
            }
        }
        Ok(out)
    }
}

/// The log of a unit: lines, or the raw stream with the ELF that made it.
#[pyclass(module = "hrg", unsendable)]
pub struct LogDecoder {
    raw: Option<Decoder>,
}

#[pymethods]
impl LogDecoder {
    #[new]
    #[pyo3(signature = (elf = None))]
    fn new(elf: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let Some(elf) = elf else { return Ok(Self { raw: None }) };
        let bytes = hrg_data::files::read_file(&path_of(elf)?, MOST_ELF, false).map_err(refused)?;
        Ok(Self { raw: Some(Decoder::new(&bytes).map_err(refused)?) })
    }

    /// Lines of a raw stream.
    fn lines(&mut self, data: &[u8]) -> PyResult<Vec<String>> {
        let decoder = self.raw.as_mut().ok_or_else(|| bad("a raw log needs the firmware that made it; give elf"))?;
        Ok(decoder.push(data))
    }

    /// The second that a line tells, or `None`.
    #[staticmethod]
    fn second<'py>(py: Python<'py>, line: &str) -> PyResult<Option<Bound<'py, PyDict>>> {
        housekeeping_of_line(line).map(|h| fields::<Housekeeping>(py, "housekeeping", &h)).transpose()
    }
}
