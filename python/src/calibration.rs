//! Calibrations, how they are fitted, and what they lack.

use crate::recording::{Corrected, Recording};
use crate::values::{bytes, framed, names, of_json};
use crate::{bad, refused, user_effects, work};
use hrg::images::bias_on_ramp;
use hrg_core::calibration::Calibration as Inner;
use hrg_core::effects::by_id;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::facts;
use hrg_identify::fit as fits;
use hrg_identify::fit::correct as corrections;
use hrg_identify::fit::independence::Units;
use hrg_identify::trace as tracing;
use hrg_identify::trace::Trace;
use hrg_papers::method::Method;
use hrg_papers::methods as identify;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;

/// Coefficients of a unit.
#[pyclass(frozen, module = "hrg")]
pub struct Calibration {
    pub inner: Inner,
    notes: Vec<String>,
}

impl Calibration {
    pub fn of(inner: Inner) -> Self {
        Self { inner, notes: Vec::new() }
    }
}

fn units(different: bool) -> Units {
    if different {
        Units::Different
    } else {
        Units::Same
    }
}

/// Seconds since 1970.
fn now() -> u32 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |d| u32::try_from(d.as_secs()).unwrap_or(u32::MAX))
}

#[pymethods]
impl Calibration {
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        image_file::load(&path).map(Self::of).map_err(refused)
    }

    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        image_file::from_text(text).map(Self::of).map_err(|e| refused(BadInput::from(e)))
    }

    #[staticmethod]
    fn from_bytes(image: &[u8]) -> PyResult<Self> {
        Inner::from_bytes(image).map(Self::of).map_err(|e| bad(e.to_string()))
    }

    fn to_toml(&self) -> String {
        image_file::to_text(&self.inner)
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let image = self.inner.to_bytes().ok_or_else(|| bad("the calibration does not fit an image"))?;
        Ok(bytes(py, &image))
    }

    fn write(&self, path: PathBuf) -> PyResult<()> {
        image_file::save(&path, &self.inner).map_err(refused)
    }

    #[getter]
    fn unit(&self) -> &str {
        self.inner.unit_name()
    }

    #[getter]
    fn checksum(&self) -> u32 {
        self.inner.checksum()
    }

    #[getter]
    fn created_unix_s(&self) -> u32 {
        self.inner.created_unix_s
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    #[getter]
    fn effects<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let mut out = Vec::new();
        for e in &self.inner.effects {
            let Some(facts) = by_id(e.id) else { continue };
            let d = PyDict::new(py);
            let parameters = PyDict::new(py);
            for (name, value) in facts.parameters.iter().zip(e.parameters) {
                parameters.set_item(*name, value)?;
            }
            let gains = PyDict::new(py);
            for (name, g) in AXIS_NAMES.iter().zip(&e.gains) {
                gains.set_item(*name, g[..facts.outputs].to_vec())?;
            }
            d.set_item("name", facts.name)?;
            d.set_item("parameters", parameters)?;
            d.set_item("gains_dph", gains)?;
            out.push(d);
        }
        Ok(out)
    }

    /// Lowest and highest temperature that every axis was fitted on, C.
    #[getter]
    fn temperature_range_c(&self) -> (f32, f32) {
        let curves = || self.inner.axes.iter().map(|a| a.curve);
        let low = curves().map(|c| c.valid_from_c).fold(f32::NEG_INFINITY, f32::max);
        (low, curves().map(|c| c.valid_to_c).fold(f32::INFINITY, f32::min))
    }

    /// Bias and standard uncertainty on a ramp after a soak, of each temperature, the axes one after the other.
    #[allow(clippy::type_complexity)] // Two arrays.
    fn _bias<'py>(
        &self,
        py: Python<'py>,
        states: Vec<(f64, f64)>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
        let each: Vec<(f64, f64)> = work::run(py, None, || {
            Ok(states.iter().flat_map(|(t, ramp)| bias_on_ramp(&self.inner, *t, *ramp)).collect())
        })?;
        let (bias, std): (Vec<f64>, Vec<f64>) = each.into_iter().unzip();
        Ok((PyArray1::from_vec(py, bias), PyArray1::from_vec(py, std)))
    }

    #[staticmethod]
    fn _restored(toml: &str, notes: Vec<String>) -> PyResult<Self> {
        let inner = image_file::from_text(toml).map_err(|e| refused(BadInput::from(e)))?;
        Ok(Self { inner, notes })
    }

    #[allow(clippy::type_complexity)] // It is the tuple that `_restored` takes.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String, Vec<String>))> {
        Ok((slf.get_type().getattr("_restored")?, (slf.get().to_toml(), slf.get().notes.clone())))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|o| o.get().inner == self.inner)
    }

    fn __repr__(&self) -> String {
        let effects: Vec<&str> = self.inner.effects.iter().filter_map(|e| by_id(e.id)).map(|f| f.name).collect();
        let with = if effects.is_empty() { String::new() } else { format!(" with {}", effects.join(", ")) };
        format!("<hrg.Calibration {:08x} of {}{with}>", self.inner.checksum(), self.inner.unit_name())
    }
}

/// Names of the methods of :func:`fit` and :func:`compare`.
#[pyfunction]
pub fn methods() -> Vec<&'static str> {
    Method::ALL.into_iter().map(Method::name).collect()
}

/// See `hrg.fit`.
#[pyfunction]
#[pyo3(signature = (recordings, method = "lsq", *, seed = 1, uniform = false, breakpoint_c = None, degree = None, curve = None, different_units = false, progress = None))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn fit(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    method: &str,
    seed: u64,
    uniform: bool,
    breakpoint_c: Option<f64>,
    degree: Option<Bound<'_, PyAny>>,
    curve: Option<Bound<'_, Calibration>>,
    different_units: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Calibration> {
    let method = Method::by_name(method)
        .ok_or_else(|| bad(format!("there is no method \"{method}\"; there are {}", methods().join(", "))))?;
    let degree = degree.map(|d| d.str()?.to_string_lossy().parse().map_err(|e: String| bad(e))).transpose()?;
    let runs = recordings.iter().map(|r| r.get().at_rest()).collect::<PyResult<Vec<_>>>()?;
    let known = curve.map(|c| c.get().inner.axes.clone().map(|a| a.curve));
    work::run(py, progress.as_ref(), move || {
        let prepared = fits::prepare_with(&runs, units(different_units), known)?;
        let options = hrg_papers::method::Options { seed, uniform, breakpoint_c, degree };
        let mut found = identify::identify_with(&prepared, method, &options)?;
        found.calibration.created_unix_s = now();
        found.calibration.sequence = 1;
        let corrected: Vec<_> = prepared.runs.iter().map(|r| fits::correct(&found.calibration, &r.steps)).collect();
        let fitted = fits::spread(&corrected, prepared.runs.first().map_or(fits::MEAN_S, |r| r.steps.mean_s));
        for a in prepared.runs.first().into_iter().flat_map(|r| r.steps.present()) {
            found.calibration.axes[a].train_rms_dph = fitted[a] as f32;
        }
        if let Some(known) = known.filter(|_| runs.iter().all(|r| r.thermometer.is_sensor())) {
            fits::fly_by(&mut found.calibration, known)?;
        }
        let notes = found.notes.into_iter().chain(prepared.notes).collect();
        Ok(Calibration { inner: found.calibration, notes })
    })
}

/// Result of a trace.
#[pyclass(frozen, module = "hrg")]
pub struct Report {
    json: String,
    html: String,
    verdict: String,
    image: Option<Inner>,
    baseline: Inner,
}

#[pymethods]
impl Report {
    #[getter]
    fn verdict(&self) -> &str {
        &self.verdict
    }
    #[getter]
    fn calibration(&self) -> Option<Calibration> {
        self.image.clone().map(Calibration::of)
    }
    #[getter]
    fn baseline_calibration(&self) -> Calibration {
        Calibration::of(self.baseline.clone())
    }
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        of_json(py, &self.json)
    }
    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        // `final_` is `final` of the file; that is a word that some programs keep for themselves.
        self.to_dict(py)?.get_item(name.trim_end_matches('_')).map_err(|_| {
            pyo3::exceptions::PyAttributeError::new_err(format!("a report has no \"{name}\"; see to_dict()"))
        })
    }
    /// Names for the key Tab: the keys of the file, too.
    fn __dir__<'py>(slf: &Bound<'py, Self>) -> PyResult<Vec<String>> {
        names(slf.as_any(), &slf.get().to_dict(slf.py())?)
    }
    #[staticmethod]
    fn _restored(json: String, html: String, verdict: String, image: Option<String>, baseline: &str) -> PyResult<Self> {
        let of = |toml: &str| image_file::from_text(toml).map_err(|e| refused(BadInput::from(e)));
        Ok(Self { json, html, verdict, image: image.as_deref().map(of).transpose()?, baseline: of(baseline)? })
    }
    #[allow(clippy::type_complexity)] // It is the tuple that `_restored` takes.
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, String, String, Option<String>, String))> {
        let r = slf.get();
        let image = r.image.as_ref().map(image_file::to_text);
        let content = (r.json.clone(), r.html.clone(), r.verdict.clone(), image, image_file::to_text(&r.baseline));
        Ok((slf.get_type().getattr("_restored")?, content))
    }
    fn _repr_html_(&self) -> String {
        framed(&self.html)
    }
    fn to_json(&self) -> &str {
        &self.json
    }
    fn to_html(&self) -> &str {
        &self.html
    }
    fn __repr__(&self) -> String {
        format!("<hrg.Report: {}>", self.verdict)
    }
}

/// See `hrg.trace`.
#[pyfunction]
#[pyo3(signature = (train, verify, *, in_use = None, judge = None, exchange = false, repeat_is_enough = false, different_units = false, jobs = None, progress = None, own_effects = Vec::new(), limit_dph = None, prior = None))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn trace(
    py: Python<'_>,
    train: Vec<Bound<'_, Recording>>,
    verify: &Bound<'_, Recording>,
    in_use: Option<Bound<'_, Calibration>>,
    judge: Option<Bound<'_, Recording>>,
    exchange: bool,
    repeat_is_enough: bool,
    different_units: bool,
    jobs: Option<usize>,
    progress: Option<Py<PyAny>>,
    own_effects: Vec<Bound<'_, PyAny>>,
    limit_dph: Option<f64>,
    prior: Option<std::path::PathBuf>,
) -> PyResult<Report> {
    let family = prior.as_deref().map(hrg::fleet::read_family).transpose().map_err(refused)?;
    let train = train.iter().map(|r| r.get().at_rest()).collect::<PyResult<Vec<_>>>()?;
    let verify = verify.get().at_rest()?;
    let in_use = in_use.map(|c| c.get().inner.clone());
    let judge = judge.map(|r| r.get().at_rest()).transpose()?;
    // (A trace uses one processor; scripts of before give a number.)
    let _ = jobs;
    if let Some(c) = &in_use {
        facts::fits(c, &verify, different_units).map_err(|e| refused(BadInput::from(e)))?;
    }
    let raised = user_effects::Raised::default();
    let own = own_effects.iter().map(|e| user_effects::effect(e, &raised)).collect::<PyResult<Vec<_>>>()?;
    let options =
        tracing::Options { own, units: units(different_units), in_use, repeat_is_enough, judge, exchange, family };
    let traced = work::run(py, progress.as_ref(), move || {
        let t: Trace = tracing::trace_with(&train, &verify, &options)?;
        let mut image = (t.report.image != tracing::Image::None).then(|| t.image.clone());
        if let Some(image) = &mut image {
            image.created_unix_s = now();
        }
        Ok(Report {
            json: serde_json::to_string_pretty(&t.report)?,
            html: tracing::html_with(&t, limit_dph)?,
            verdict: t.report.verdict.clone(),
            image,
            baseline: t.baseline,
        })
    });
    traced.inspect_err(|e| raised.cause(py, e))
}

/// See `hrg.correct`.
#[pyfunction]
#[pyo3(signature = (recording, calibration, *, different_units = false))]
pub fn correct(
    py: Python<'_>,
    recording: &Bound<'_, Recording>,
    calibration: &Bound<'_, Calibration>,
    different_units: bool,
) -> PyResult<Corrected> {
    let (recording, c) = (recording.get(), &calibration.get().inner);
    let r = &py.detach(|| recording.raw());
    let mut notes = facts::fits(c, r, different_units).map_err(|e| refused(BadInput::from(e)))?;
    let made = work::run(py, None, || {
        let made = corrections::recording(c, r)?;
        let text = corrections::to_csv(r, "corrected on the desktop", r.power_on_s(), Some(c), &made.seconds);
        Ok(Corrected { seconds: made.seconds, text, notes: made.notes })
    })?;
    notes.extend(made.notes);
    Ok(Corrected { notes, ..made })
}
