//! Recordings, and what a unit makes of them.

use crate::{bad, refused, work};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::facts::Facts;
use hrg_data::recording::import::map::Map;
use hrg_data::recording::metadata::{scale_text, Attitude, KEYS};
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::{columns, import, names, parquet, Original, Recording as Inner};
use hrg_identify::fit::correct as corrections;
use hrg_simulate::{inject_defects, EffectSpec, Kind, Noise, Plan, Profile, ATTITUDE};
use numpy::ndarray::ArrayView1;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// A recording as read, and as cleaned. Nothing in it ever changes, so arrays may point into it.
#[pyclass(frozen, module = "hrg")]
pub struct Recording {
    /// Cleaned: what fits and traces take.
    pub clean: Inner,
    /// The recording as it was read.
    original: Original,
}

/// Metadata of the unit that a user states beside a recording.
#[derive(FromPyObject)]
pub struct Stated {
    #[pyo3(item)]
    unit: Option<String>,
    #[pyo3(item)]
    latitude_deg: Option<f64>,
    #[pyo3(item)]
    axes: Option<String>,
    #[pyo3(item)]
    scale_factor_dph_per_code: Option<[f32; AXES]>,
}

impl Stated {
    fn facts(&self) -> Result<Facts, BadInput> {
        let latitude = self.latitude_deg.map(|v| v.to_string());
        let unit = self.unit.as_deref().map(names::check).transpose().map_err(BadInput::from)?;
        Ok(Facts {
            unit: unit.map(String::from),
            attitude: Attitude::of(latitude.as_deref(), self.axes.as_deref())?,
            scale_factor: self.scale_factor_dph_per_code,
            base: None,
        })
    }
}

impl Recording {
    fn new(mut read: Inner, stated: &Stated) -> Result<Self, BadInput> {
        stated.facts()?.apply(&mut read)?;
        let original = read.clean_keeping()?;
        Ok(Self { clean: read, original })
    }

    /// The recording itself, for a work that needs a unit at rest.
    ///
    /// # Errors
    /// Where the rates are those of a unit that moves.
    pub fn at_rest(&self) -> PyResult<Inner> {
        let r = &self.clean;
        let name = if r.source.is_empty() { String::new() } else { format!("{}: ", r.source) };
        r.rests().map_err(|e| bad(format!("{name}{e}")))?;
        Ok(r.clone())
    }

    /// As it was read: a unit sees spikes, too.
    pub fn raw(&self) -> Inner {
        self.original.of(&self.clean)
    }

    fn named(&self, name: &str) -> Option<&[f64]> {
        let name = columns::today(name);
        let r = &self.clean;
        if name == columns::TIME.name(0) {
            return Some(&r.time_s);
        }
        let readings = r.thermometer.columns();
        for a in r.present() {
            if name == columns::RATE.name(a) {
                return Some(&r.rate_dph[a]);
            }
            if readings.is_some_and(|c| c.name(a) == name) {
                return Some(&r.frequency_hz[a]);
            }
        }
        r.column(name)
    }

    fn columns_there(&self) -> Vec<&'static str> {
        let r = &self.clean;
        let present: Vec<usize> = r.present().collect();
        let readings = r.thermometer.columns().into_iter().flat_map(|c| c.of(&present).iter().map(|a| c.name(*a)));
        let rates = present.iter().map(|a| columns::RATE.name(*a));
        [columns::TIME.name(0)].into_iter().chain(readings).chain(rates).chain(r.optional.iter().map(|c| c.0)).collect()
    }
}

/// The values as an array that looks into `owner`, which never changes; nobody may write to it.
fn view<'py>(owner: &Bound<'py, PyAny>, values: &[f64]) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let values = ArrayView1::from(values);
    // SAFETY: the values belong to `owner`, a frozen object whose vectors are never changed or moved, and which the array keeps alive.
    #[allow(unsafe_code)]
    let array = unsafe { PyArray1::borrow_from_array(&values, owner.clone()) };
    array.call_method1("setflags", (false,))?;
    Ok(array)
}

/// The bytes of what has `read()`.
fn bytes_of(source: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
    let content = source.call_method0("read")?;
    content.extract::<String>().map(String::into_bytes).or_else(|_| content.extract())
}

#[pymethods]
impl Recording {
    #[staticmethod]
    #[pyo3(signature = (source, stated))]
    fn _read(py: Python<'_>, source: &Bound<'_, PyAny>, stated: Stated) -> PyResult<Self> {
        if source.hasattr("read")? {
            let bytes = bytes_of(source)?;
            return py
                .detach(|| {
                    let text = if bytes.starts_with(b"PAR1") { parquet::to_csv(bytes)?.into_bytes() } else { bytes };
                    Self::new(Inner::parse(&text)?, &stated)
                })
                .map_err(refused);
        }
        let path: PathBuf = source.extract()?;
        let here = |e: BadInput| refused(BadInput::new(format!("{}: {e}", path.display())));
        let read = py.detach(|| Inner::read(&path)).map_err(refused)?;
        py.detach(|| {
            let mut read = Self::new(read, &stated)?;
            read.clean.source = path.display().to_string();
            Ok(read)
        })
        .map_err(here)
    }

    #[staticmethod]
    #[pyo3(signature = (columns, meta, stated, source = String::new(), judged_from_s = None))]
    fn _of_columns(
        py: Python<'_>,
        columns: Vec<(String, PyReadonlyArray1<'_, f64>)>,
        meta: Vec<(String, String)>,
        stated: Stated,
        source: String,
        judged_from_s: Option<f64>,
    ) -> PyResult<Self> {
        let columns: Vec<(String, Vec<f64>)> =
            columns.into_iter().map(|(name, values)| (name, values.as_array().to_vec())).collect();
        py.detach(|| {
            let mut read = Inner { source, judged_from_s, ..Inner::from_columns(&meta, columns)? };
            if judged_from_s.is_none() {
                return Self::new(read, &stated);
            }
            // A part of a run comes back as it was cleaned: by itself it has too few rates to be cleaned anew.
            read.earth_rate_dph =
                Attitude::of(read.meta("latitude_deg"), read.meta("axes"))?.map(|a| a.earth_rate_dph());
            read.notes.clear();
            let mut raw = read.copied();
            raw.restore_earth_rate();
            Ok(Self { original: Original::Whole(Box::new(raw)), clean: read })
        })
        .map_err(refused)
    }

    /// Keys of metadata with a meaning.
    #[staticmethod]
    fn _keys() -> Vec<&'static str> {
        KEYS.to_vec()
    }

    /// Content for a copy: columns as they were read, metadata, source, and the time from which it is judged.
    #[allow(clippy::type_complexity)] // It is the tuple that `_of_columns` takes.
    fn _content<'py>(
        &self,
        py: Python<'py>,
    ) -> (Vec<(String, Bound<'py, PyArray1<f64>>)>, Vec<(String, String)>, String, Option<f64>) {
        let r = if self.clean.judged_from_s.is_some() { self.clean.copied() } else { self.raw() };
        let present: Vec<usize> = r.present().collect();
        let mut columns: Vec<(String, Vec<f64>)> = vec![(columns::TIME.name(0).into(), r.time_s.clone())];
        for a in present.iter().copied() {
            columns.push((columns::RATE.name(a).into(), r.rate_dph[a].clone()));
        }
        if let Some(readings) = r.thermometer.columns() {
            // (One sensor for all axes is one column.)
            let of = readings.of(&present);
            columns.extend(of.iter().map(|a| (readings.name(*a).into(), r.frequency_hz[*a].clone())));
        }
        columns.extend(r.optional.iter().map(|(name, values)| ((*name).to_string(), values.clone())));
        if !r.status.is_empty() {
            let of = |k: usize| r.status.iter().map(|s| f64::from(s[k])).collect::<Vec<f64>>();
            columns.extend(present.iter().map(|a| (columns::STATUS.name(*a).into(), of(*a))));
            columns.push((columns::UNIT_STATUS.name(0).into(), of(AXES)));
        }
        let arrays = columns.into_iter().map(|(n, v)| (n, PyArray1::from_vec(py, v))).collect();
        (arrays, r.meta.clone(), self.clean.source.clone(), r.judged_from_s)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let restore = slf.py().import("hrg")?.getattr("_restored_recording")?;
        Ok((restore, slf.call_method0("_content")?.cast_into::<pyo3::types::PyTuple>()?.into_any()))
    }

    fn __len__(&self) -> usize {
        self.clean.time_s.len()
    }

    fn __repr__(&self) -> String {
        let r = &self.clean;
        let (from, to) = (r.time_s.first().unwrap_or(&0.0), r.time_s.last().unwrap_or(&0.0));
        let axes: Vec<&str> = r.present().map(|a| AXIS_NAMES[a]).collect();
        format!("<hrg.Recording of {}: {} rows, {from} to {to} s, axes {}>", r.unit(), r.time_s.len(), axes.join(" "))
    }

    fn __getitem__<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = slf.get().named(name).ok_or_else(|| {
            pyo3::exceptions::PyKeyError::new_err(format!(
                "there is no column {name}; there are {}",
                slf.get().columns_there().join(", ")
            ))
        })?;
        view(slf.as_any(), values)
    }

    #[getter]
    fn columns(&self) -> Vec<&'static str> {
        self.columns_there()
    }

    #[getter]
    fn meta<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        self.clean.meta.iter().try_for_each(|(k, v)| d.set_item(k, v))?;
        // (The columns are without it, so what is made of columns and metadata must not lose it again.)
        if self.clean.earth_rate_dph.is_some() {
            d.set_item("earth_rate", "removed")?;
        }
        Ok(d)
    }

    fn to_dict<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(slf.py());
        for name in slf.get().columns_there() {
            d.set_item(name, Self::__getitem__(slf, name)?)?;
        }
        Ok(d)
    }

    #[getter]
    fn unit(&self) -> &str {
        self.clean.unit()
    }

    #[getter]
    fn axes(&self) -> Vec<&'static str> {
        self.clean.present().map(|a| AXIS_NAMES[a]).collect()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        self.clean.notes.clone()
    }

    #[getter]
    fn earth_rate_dph(&self) -> Option<[f64; AXES]> {
        self.clean.earth_rate_dph
    }

    fn to_csv(&self, py: Python<'_>) -> String {
        py.detach(|| self.raw().to_csv())
    }

    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| parquet::write_text(&path, &self.raw().to_csv())).map_err(refused)
    }

    fn split(&self, at_s: f64) -> PyResult<(Self, Self)> {
        let (raw, raw_after) = self.raw().split(at_s).map_err(refused)?;
        let (clean, clean_after) = self.clean.split(at_s).map_err(refused)?;
        let whole = |raw| Original::Whole(Box::new(raw));
        Ok((Self { clean, original: whole(raw) }, Self { clean: clean_after, original: whole(raw_after) }))
    }
}

/// Seconds that a unit would have sent.
#[pyclass(frozen, module = "hrg")]
pub struct Corrected {
    pub(crate) seconds: Vec<corrections::Second>,
    pub(crate) text: String,
    pub(crate) notes: Vec<String>,
}

impl Corrected {
    fn table<'py, T: numpy::Element + Copy, const N: usize>(
        &self,
        py: Python<'py>,
        of: impl Fn(&corrections::Second) -> [T; N],
    ) -> PyResult<Bound<'py, PyArray2<T>>> {
        let flat: Vec<T> = self.seconds.iter().flat_map(of).collect();
        PyArray1::from_vec(py, flat).reshape([self.seconds.len(), N])
    }
}

#[pymethods]
impl Corrected {
    fn __len__(&self) -> usize {
        self.seconds.len()
    }
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.seconds.iter().map(|s| s.time_s).collect())
    }
    #[getter]
    fn corrected_dph<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.table(py, |s| s.corrected_dph)
    }
    #[getter]
    fn raw_dph<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.table(py, |s| s.raw_dph)
    }
    #[getter]
    fn bias_dph<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.table(py, |s| s.bias_dph)
    }
    #[getter]
    fn bias_std_dph<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.table(py, |s| s.bias_std_dph)
    }
    #[getter]
    fn temperature_c<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.table(py, |s| s.temperature_c)
    }
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u16>>> {
        self.table(py, |s| s.status)
    }
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }
    /// Its columns by the names of a recording, axes apart.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        d.set_item("time_s", self.time_s(py))?;
        let each = |name: &dyn Fn(&str) -> String, of: &dyn Fn(&corrections::Second) -> [f32; AXES]| {
            AXIS_NAMES.iter().enumerate().try_for_each(|(a, axis)| {
                d.set_item(name(axis), PyArray1::from_vec(py, self.seconds.iter().map(|s| of(s)[a]).collect()))
            })
        };
        each(&|a| format!("temp_{a}_c"), &|s| s.temperature_c)?;
        each(&|a| format!("raw_{a}_dph"), &|s| s.raw_dph)?;
        each(&|a| format!("rate_{a}_dph"), &|s| s.corrected_dph)?;
        each(&|a| format!("bias_{a}_dph"), &|s| s.bias_dph)?;
        each(&|a| format!("bias_std_{a}_dph"), &|s| s.bias_std_dph)?;
        for (k, name) in ["status_x", "status_y", "status_z", "status_unit"].iter().enumerate() {
            d.set_item(name, PyArray1::from_vec(py, self.seconds.iter().map(|s| s.status[k]).collect()))?;
        }
        Ok(d)
    }
    fn __repr__(&self) -> String {
        let (from, to) =
            (self.seconds.first().map_or(0.0, |s| s.time_s), self.seconds.last().map_or(0.0, |s| s.time_s));
        format!("<hrg.Corrected: {} seconds, {from} to {to} s>", self.seconds.len())
    }
    fn to_csv(&self) -> &str {
        &self.text
    }
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| parquet::write_text(&path, &self.text)).map_err(refused)
    }
}

/// A recording of another program's file (a path) by a map: the path of one, or px4, ardupilot, ardupilot-tcal, ros, betaflight, adis, bosch. `imu`: its number,
/// from 0, where the file has several.
#[pyfunction]
#[pyo3(signature = (path, map, *, imu = None))]
pub fn import_table(py: Python<'_>, path: PathBuf, map: &str, imu: Option<u8>) -> PyResult<Recording> {
    let mut map = Map::named(map).map_err(|e| bad(e.0))?;
    map.table.instance = imu.unwrap_or(map.table.instance);
    let cleaned = || -> anyhow::Result<Recording> {
        let mut clean = import::read(&path, &map)?;
        let original = clean.clean_keeping()?;
        Ok(Recording { clean, original })
    };
    py.detach(cleaned).map_err(refused)
}

/// A simulated chamber run, and a dictionary of what it does not tell: floor_dph (deg/h, standard deviation of 100 s means of the
/// noise) and gains_dph of the effects. Effects are written as for `hrg simulate --effect`: effects=["hysteresis:width_c=10"].
#[pyfunction]
#[pyo3(signature = (profile = "dong", *, effects = Vec::new(), unit = 1, seed = 1, kind = "hrg", thermometer = "frequency", white_100s_dph = None, defects = false))]
#[allow(clippy::too_many_arguments)] // They are a user's keywords.
pub fn simulate<'py>(
    py: Python<'py>,
    profile: &str,
    effects: Vec<String>,
    unit: u64,
    seed: u64,
    kind: &str,
    thermometer: &str,
    white_100s_dph: Option<f64>,
    defects: bool,
) -> PyResult<(Recording, Bound<'py, PyDict>)> {
    let kind = Kind::parse(kind).map_err(refused)?;
    let thermometer = match thermometer {
        "frequency" => Thermometer::Frequency,
        "sensor" => Thermometer::Sensors,
        other => return Err(bad(format!("thermometer \"{other}\" is not known; there are frequency and sensor"))),
    };
    let effects = effects.iter().map(|e| EffectSpec::parse(e)).collect::<Result<Vec<_>, _>>().map_err(refused)?;
    let usual = kind.noise();
    let noise = Noise { white_100s_dph: white_100s_dph.unwrap_or(usual.white_100s_dph), ..usual };
    let profile = Profile::parse(profile).map_err(refused)?;
    let plan = Plan { kind, thermometer, effects, noise, attitude: ATTITUDE, ..Plan::of(profile, unit, seed) };
    let (simulated, text) = work::run(py, None, || {
        let mut simulated = plan.simulate();
        if defects {
            inject_defects(&mut simulated.recording, seed);
        }
        // Contents of the file, to the digit: a simulation from here and one from the command line are the same recording.
        let text = simulated.recording.to_csv();
        Ok((simulated, text))
    })?;
    let stated = Stated { unit: None, latitude_deg: None, axes: None, scale_factor_dph_per_code: None };
    let recording = py.detach(|| Recording::new(Inner::parse(text.as_bytes())?, &stated)).map_err(refused)?;
    let truth = PyDict::new(py);
    truth.set_item("floor_dph", simulated.truth.floor_dph)?;
    truth.set_item("gains_dph", simulated.truth.gains)?;
    truth.set_item("scale_factor_dph_per_code", recording.clean.scale_factor().map(|s| scale_text(&s)))?;
    Ok((recording, truth))
}
