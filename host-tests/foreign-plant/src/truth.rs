//! The truth beside the recordings: what was put in, how large it is, and what perfect knowledge of its form would leave.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Classes of physics, as the reports of `hrg trace` name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Class {
    /// Thermal memory: lags, relaxations, gradients between bodies.
    Memory,
    /// Memory of the path, not of time.
    Hysteresis,
    /// A function of temperature.
    Shape,
    /// A function of dT/dt.
    Rate,
    /// A function of the time since power-on.
    PowerOn,
    /// A recorded quantity.
    Input,
    /// The thermometer is at fault.
    Thermometer,
    /// Happens once, or unpredictably.
    Event,
    /// Nothing is there to be found.
    None,
}

impl Class {
    /// The name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Memory => "memory",
            Self::Hysteresis => "hysteresis",
            Self::Shape => "shape",
            Self::Rate => "rate",
            Self::PowerOn => "power-on",
            Self::Input => "input",
            Self::Thermometer => "thermometer",
            Self::Event => "event",
            Self::None => "none",
        }
    }
}

/// One effect that was put in.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct EffectTruth {
    /// Name of its form, for readers.
    pub name: String,
    /// Classes that name it rightly: the first is what it is, the others are honestly equivalent on these recordings.
    pub classes: Vec<Class>,
    /// Classes that may be named beside a right one: parts of the form that are of them. Alone they are no right answer.
    pub beside: Vec<Class>,
    /// Axes that have it.
    pub axes: Vec<String>,
    /// Runs in which it acts: `all`, `train` or `verify`.
    pub runs: String,
    /// Size by axis: deviation of 100 s means after a fit of equation 7 to the effect alone, over the noise floor. On the train runs, or on
    /// the verify run where it acts only there.
    pub size_floors: BTreeMap<String, f64>,
    /// Size that the case asks for, by axis; null where the physics fixes it.
    pub stated_floors: BTreeMap<String, Option<f64>>,
    /// Deviation of its 100 s means before any fit, deg/h. Empty for a fault of the thermometer.
    pub deviation_dph: BTreeMap<String, f64>,
    /// Scale of a thermometer's fault: ppm of frequency, or C, for 1 of its form. Empty for an effect on the bias.
    pub fault_scale: BTreeMap<String, f64>,
    /// `true` if a unit can take it off: it then follows from its own frequencies or temperature and the time since power-on.
    pub compensable: bool,
    /// Why not, where it cannot.
    pub why_not: String,
    /// Properties of the unit that the form drew, by axis.
    pub parameters: BTreeMap<String, BTreeMap<String, f64>>,
}

/// Figures of one axis in one run. All are deviations of 100 s means about the run's mean, deg/h.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct AxisFigures {
    /// Noise that was put in: the floor.
    pub floor_dph: f64,
    /// The rate as recorded.
    pub raw_dph: f64,
    /// Left after equation 7, fitted on the train runs with a constant for each, on the temperature that the thermometer indicates (of a
    /// frequency: after a cubic has been calibrated on the train runs).
    pub eq7_dph: f64,
    /// Left after equation 7 on the true temperature and the exact regressors of all effects; gains from the train runs only.
    pub oracle_dph: f64,
    /// `eq7_dph` over `floor_dph`.
    pub eq7_floors: f64,
    /// `oracle_dph` over `floor_dph`.
    pub oracle_floors: f64,
    /// Constant of this run above that of the first train run, deg/h.
    pub constant_dph: f64,
}

/// One run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunTruth {
    /// `train`, `verify`, `judge`, or `more` for a run that nothing is sized by.
    pub role: String,
    /// File beside this truth.
    pub file: String,
    /// The chamber's program.
    pub program: String,
    /// Figures by axis.
    pub axes: BTreeMap<String, AxisFigures>,
    /// Of the run that judges, by axis: 100 s means of the bias, noise left out, deg/h; empty for the others.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bias_dph: BTreeMap<String, Vec<f64>>,
    /// Defects put into the file, by kind.
    pub defects: BTreeMap<String, usize>,
}

/// All that was put into one case.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Truth {
    /// Version of this format: 1.
    pub version: u32,
    /// Name of the case.
    pub case: String,
    /// Its seed.
    pub seed: u64,
    /// Description in a sentence.
    pub description: String,
    /// Group: a class's name, `mixture`, `condition` or `clean`.
    pub group: String,
    /// Classes of a right answer. The first is the primary class of the first effect; `none` where naming nothing is right.
    pub classes: Vec<Class>,
    /// Classes that may be named beside a right one, and are no right answer alone.
    pub beside: Vec<Class>,
    /// Effects put in.
    pub effects: Vec<EffectTruth>,
    /// `true` if a unit can reach the oracle on the verify run on every axis.
    pub compensable: bool,
    /// Why not, where it cannot.
    pub why_not: String,
    /// Kind of noise.
    pub noise: String,
    /// The bias of equation 7: k0 [deg/h], k1 [/C], k2 [/C^2], k3 [/(C/min)], k4 [/(C/min)^2], k5 [/C/(C/min)], by axis.
    pub eq7_coefficients: BTreeMap<String, [f64; 6]>,
    /// Deviation of that bias' 100 s means over its widest run, times 3, deg/h.
    pub eq7_three_sigma_dph: BTreeMap<String, f64>,
    /// The runs, train first.
    pub runs: Vec<RunTruth>,
}

impl Truth {
    /// The verify run.
    #[must_use]
    pub fn verify(&self) -> Option<&RunTruth> {
        self.runs.iter().find(|run| run.role == "verify")
    }

    /// The truth as a JSON text.
    ///
    /// # Errors
    /// None in practice: the structure has no value that JSON cannot hold, but for infinities, which become null.
    pub fn to_json(&self) -> serde_json::Result<String> {
        serde_json::to_string_pretty(self)
    }
}
