//! Comparisons of methods, figures of a data sheet, and what tables of the laboratory give.

use crate::recording::Recording;
use crate::values::{framed, names, of_json, table};
use crate::{bad, refused, work, Calibration};
use hrg::judge as judging;
use hrg::judge::Limit;
use hrg::report;
use hrg_align::normal_gravity;
use hrg_align_tools::accelerometers;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::page;
use hrg_data::plot::escape;
use hrg_data::recording::facts;
use hrg_identify::fit::independence;
use hrg_identify::fit::independence::Units;
use hrg_identify::thermometer::soaks as standing;
use hrg_papers::compare as comparing;
use hrg_papers::compare::{Contender, Own};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Figures, with the text and the page that show them.
#[pyclass(frozen, module = "hrg")]
pub struct Figures {
    what: &'static str,
    json: String,
    text: String,
    html: String,
    calibrations: Vec<(String, hrg_core::calibration::Calibration)>,
}

#[pymethods]
impl Figures {
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        of_json(py, &self.json)
    }
    fn to_json(&self) -> &str {
        &self.json
    }
    fn to_html(&self) -> &str {
        &self.html
    }
    /// Fitted calibrations, by the name of their method.
    #[getter]
    fn calibrations<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        self.calibrations.iter().try_for_each(|(name, c)| d.set_item(name, Calibration::of(c.clone())))?;
        Ok(d)
    }
    fn __getattr__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.to_dict(py)?.get_item(name).map_err(|_| {
            pyo3::exceptions::PyAttributeError::new_err(format!("{} has no \"{name}\"; see to_dict()", self.what))
        })
    }
    /// Names for the key Tab: the keys of the file, too.
    fn __dir__<'py>(slf: &Bound<'py, Self>) -> PyResult<Vec<String>> {
        names(slf.as_any(), &slf.get().to_dict(slf.py())?)
    }
    fn _repr_html_(&self) -> String {
        framed(&self.html)
    }
    fn __str__(&self) -> &str {
        &self.text
    }
    fn __repr__(&self) -> String {
        format!("<hrg.Figures: {}>", self.what)
    }
}

fn clean(recordings: &[Bound<'_, Recording>]) -> PyResult<Vec<hrg_data::recording::Recording>> {
    recordings.iter().map(|r| r.get().at_rest()).collect()
}

/// Corrected rates of a user's own method for a run: the run with other rates, a value for each row and axis.
fn corrected(
    of: &Bound<'_, Recording>,
    bias_dph: &PyReadonlyArray2<'_, f64>,
) -> PyResult<hrg_data::recording::Recording> {
    let mut r = of.get().clean.clone();
    let (present, bias) = (r.present().collect::<Vec<_>>(), bias_dph.as_array());
    let wanted = (r.time_s.len(), present.len());
    if bias.dim() != wanted {
        return Err(bad(format!(
            "it gave an array of shape {:?} where {wanted:?} is asked: a bias for each row and axis, deg/h",
            bias.dim()
        )));
    }
    for (k, a) in present.into_iter().enumerate() {
        r.rate_dph[a].iter_mut().zip(bias.column(k)).for_each(|(rate, bias)| *rate -= bias);
    }
    Ok(r)
}

/// See `hrg.compare`.
#[pyfunction]
#[pyo3(signature = (train, verify, out, *, methods = None, seed = 1, from_s = 0.0, different_units = false, progress = None, own = Vec::new()))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn compare(
    py: Python<'_>,
    train: Vec<Bound<'_, Recording>>,
    verify: Vec<Bound<'_, Recording>>,
    out: PathBuf,
    methods: Option<Vec<String>>,
    seed: u64,
    from_s: f64,
    different_units: bool,
    progress: Option<Py<PyAny>>,
    own: Vec<OwnMethod<'_>>,
) -> PyResult<Figures> {
    let mut methods_of_own = Vec::new();
    for (name, seconds, on_train, on_verify) in own {
        let here = |e: PyErr| bad(format!("{name}: {}", e.value(py)));
        let all = |runs: &[Bound<'_, Recording>], biases: &[PyReadonlyArray2<'_, f64>]| {
            runs.iter().zip(biases).map(|(r, b)| corrected(r, b)).collect::<PyResult<Vec<_>>>()
        };
        methods_of_own.push(Own {
            train: Some(all(&train, &on_train).map_err(here)?),
            verify: all(&verify, &on_verify).map_err(here)?,
            name,
            seconds,
        });
    }
    let (train, verify) = (clean(&train)?, clean(&verify)?);
    let contenders = match methods {
        None => Contender::all(),
        Some(names) => names.iter().map(|m| Contender::by_name(m)).collect::<Result<Vec<_>, _>>().map_err(refused)?,
    };
    let units = if different_units { Units::Different } else { Units::Same };
    let options = comparing::Options { seed, units, from_s };
    work::run(py, progress.as_ref(), move || {
        let c = comparing::compare(&train, &verify, (&contenders, &methods_of_own), &options, &out, |_| {})?;
        let text = comparing::table(&c, false, None);
        let body =
            format!("<h1>Methods on {}</h1>{}<pre>{}</pre>", escape(&c.unit), comparing::picture(&c)?, escape(&text));
        let html = page::page("hrg compare", &body);
        let calibrations = c
            .rows
            .iter()
            .filter(|r| r.own.is_none())
            .map(|r| Ok((r.method.clone(), image_file::load(&out.join(format!("{}.toml", r.method)))?)))
            .collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Figures { what: "a comparison", json: serde_json::to_string_pretty(&c)?, text, html, calibrations })
    })
}

/// Name, seconds, and biases for each row and axis of the train runs and of the verify runs, deg/h.
type OwnMethod<'py> = (String, f64, Vec<PyReadonlyArray2<'py, f64>>, Vec<PyReadonlyArray2<'py, f64>>);

/// See `hrg.judge`.
#[pyfunction]
#[pyo3(signature = (runs, calibration, limit_dph, from_c, to_c, *, means_s = 100, different_units = false))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn judge(
    py: Python<'_>,
    runs: Vec<Bound<'_, Recording>>,
    calibration: &Bound<'_, Calibration>,
    limit_dph: f64,
    from_c: f64,
    to_c: f64,
    means_s: usize,
    different_units: bool,
) -> PyResult<Figures> {
    let (runs, c) = (clean(&runs)?, calibration.get().inner.clone());
    let limit = Limit { limit_dph, from_c, to_c, means_s };
    work::run(py, None, move || {
        let mut notes = Vec::new();
        for r in &runs {
            notes.extend(facts::fits(&c, r, different_units).map_err(BadInput::from)?);
        }
        let mut j = judging::judge(&runs, &c, &limit)?;
        notes.dedup();
        j.notes.splice(0..0, notes);
        Ok(Figures {
            what: "a judgement",
            json: serde_json::to_string_pretty(&j)?,
            text: format!("{}\n\n{}", j.line(), j.table()),
            html: j.html()?,
            calibrations: Vec::new(),
        })
    })
}

/// See `hrg.data_sheet`.
#[pyfunction]
pub fn data_sheet(py: Python<'_>, recordings: Vec<Bound<'_, Recording>>) -> PyResult<Figures> {
    let all = clean(&recordings)?;
    work::run(py, None, move || {
        let r = report::report(&all)?;
        Ok(Figures {
            what: "a data sheet",
            json: serde_json::to_string_pretty(&r)?,
            text: report::text(&r),
            html: report::html(&r)?,
            calibrations: Vec::new(),
        })
    })
}

/// See `hrg.soaks`.
#[pyfunction]
#[pyo3(signature = (recordings, *, settled_c_per_min = 0.01, hold_s = 600.0))]
pub fn soaks(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    settled_c_per_min: f64,
    hold_s: f64,
) -> PyResult<String> {
    if !(settled_c_per_min > 0.0 && hold_s > 0.0) {
        return Err(bad("settled_c_per_min and hold_s must be above zero"));
    }
    let runs = clean(&recordings)?;
    work::run(py, None, move || {
        independence::same_unit(&runs.iter().collect::<Vec<_>>(), Units::Same)?;
        let first = runs.first().ok_or_else(|| BadInput::new("no recording was given"))?;
        let settled = standing::Settled { within_c_per_min: settled_c_per_min, for_s: hold_s };
        let mut all = Vec::new();
        for r in &runs {
            all.extend(standing::find(r, &settled)?);
        }
        Ok(standing::table(first.unit(), &all))
    })
}

/// Bias, scale and cross-axis of a platform's accelerometers, from the path of a table of tilts (a1_mps2, a2_mps2, tilt1_arcmin,
/// tilt2_arcmin) at a latitude in degrees: a dictionary for :func:`align`.
#[pyfunction]
#[pyo3(signature = (path, *, latitude_deg, gravity_mps2 = None))]
pub fn identify_accelerometers<'py>(
    py: Python<'py>,
    path: PathBuf,
    latitude_deg: f64,
    gravity_mps2: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let gravity = gravity_mps2.unwrap_or_else(|| normal_gravity(latitude_deg));
    if !(latitude_deg.abs() <= 90.0 && (9.0..10.5).contains(&gravity)) {
        return Err(bad("latitude or gravity is impossible; give degrees and m/s^2"));
    }
    let found = work::run(py, None, move || {
        let here = |e: BadInput| BadInput::new(format!("{}: {e}", path.display()));
        Ok(serde_json::to_string(&accelerometers::identify(&table(&path)?, gravity).map_err(here)?)?)
    })?;
    of_json(py, &found)
}
