//! The file of a family: JSON.

use super::population::Population;
use super::{Family, OfAxis, States};
use crate::thermometer::curve::DesignCurve;
use hrg_core::bias::Scaling;
use hrg_core::bytes;
use hrg_core::effects::{EffectId, MAX_PARAMETERS};
use hrg_core::visited::{Ranges, Visited, TEMPERATURES};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the format.
const VERSION: u32 = 3;

/// In the place of the checksum while it is computed.
const NO_CHECKSUM: &str = "00000000";

/// A run that a family was learnt from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceRun {
    /// File that it was read from.
    pub file: String,
    /// Duration, h.
    pub hours: f64,
    /// CRC-32 of its frequencies and rates, hexadecimal.
    pub crc32: String,
}

/// A unit that a family was learnt from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Source {
    /// Its name.
    pub unit: String,
    /// Its runs.
    pub runs: Vec<SourceRun>,
}

/// An effect with its parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Name.
    pub effect: String,
    /// Parameters: those of the family.
    pub parameters: [f32; MAX_PARAMETERS],
    /// State at the begin of a run, for an effect that remembers the path of the temperature: 0 in the middle, 1 and -1 on a branch.
    pub start: f32,
}

/// An effect of a family, or effects that were found together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FamilyTerm {
    /// The effects; the first gives the name.
    pub parts: Vec<Part>,
    /// Axes that have it.
    pub axes: [bool; 3],
}

/// Noise of an axis: a white part beside a slow one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NoiseFacts {
    /// White part: variance of means over a second, (deg/h)^2; of means over n seconds it is an n-th.
    pub white_dph2_s: f64,
    /// Slow part: its variance, (deg/h)^2.
    pub slow_dph2: f64,
    /// Its correlation time, s.
    pub slow_s: f64,
}

/// An axis as the file has it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct AxisFacts {
    /// Names of the coefficients.
    coefficients: Vec<String>,
    /// Their means over the units, deg/h per unit of each regressor.
    mean: Vec<f64>,
    /// Their covariance from unit to unit, row by row.
    between_units: Vec<Vec<f64>>,
    /// The same from day to day.
    between_days: Vec<Vec<f64>>,
    /// Noise.
    noise: NoiseFacts,
    /// Share of the runs that each noise model stands for.
    noise_models: Vec<f64>,
    /// Ranges of the map of visited states: temperatures (C), ramps (C per minute).
    visited_ranges: [f32; 4],
    /// The map: as that of an image.
    visited_levels: [u8; TEMPERATURES],
    /// Temperature by frequency; none where the thermometers are sensors.
    curve: Option<DesignCurve>,
}

/// The part of a file that every version has.
#[derive(Deserialize)]
struct Head {
    #[serde(rename = "hrg-family")]
    version: u32,
}

#[derive(Serialize, Deserialize)]
struct File {
    #[serde(rename = "hrg-family")]
    version: u32,
    /// CRC-32 of the file with zeros here, hexadecimal.
    checksum: String,
    name: String,
    /// The earth's rate was taken off the rates.
    without_earth_rate: bool,
    temperatures_c: [f32; 2],
    ramps_c_per_min: [f32; 2],
    lag_s: f64,
    coarse_s: usize,
    #[serde(with = "OfScaling")]
    scaling: Scaling,
    effects: Vec<FamilyTerm>,
    axes: BTreeMap<String, AxisFacts>,
    sources: Vec<Source>,
}

impl File {
    fn text(&self) -> Result<String, BadInput> {
        serde_json::to_string_pretty(self)
            .map(|text| text + "\n")
            .map_err(|e| BadInput(format!("the family cannot be written: {e}")))
    }
}

/// The fields of a [`Scaling`] in the file.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Scaling")]
struct OfScaling {
    t_ref_c: f32,
    t_scale_c: f32,
    linear_below_c: f32,
    linear_above_c: f32,
    linear_beyond_c_per_min: f32,
    blend_band_c_per_min: f32,
}

fn rows(m: &DMatrix<f64>) -> Vec<Vec<f64>> {
    m.row_iter().map(|r| r.iter().copied().collect()).collect()
}

impl Family {
    /// The family as JSON.
    ///
    /// # Errors
    /// Numbers that JSON does not hold.
    pub fn to_json(&self) -> Result<String, BadInput> {
        let axes = AXIS_NAMES.iter().enumerate().filter_map(|(a, name)| {
            let axis = self.axes[a].as_ref()?;
            let p = &axis.population;
            let facts = AxisFacts {
                coefficients: self.coefficients(a),
                mean: p.mean.iter().copied().collect(),
                between_units: rows(&p.between),
                between_days: rows(&p.days),
                noise: axis.noise,
                noise_models: axis.noise_models.to_vec(),
                visited_ranges: {
                    let r = axis.visited.ranges;
                    [r.from_c, r.to_c, r.from_c_per_min, r.to_c_per_min]
                },
                visited_levels: axis.visited.map.visited_levels,
                curve: axis.curve,
            };
            Some(((*name).to_string(), facts))
        });
        let mut file = File {
            version: VERSION,
            checksum: NO_CHECKSUM.into(),
            name: self.name.clone(),
            without_earth_rate: self.without_earth_rate,
            temperatures_c: self.temperatures_c,
            ramps_c_per_min: self.ramps_c_per_min,
            lag_s: self.lag_s,
            coarse_s: self.coarse_s,
            scaling: self.scaling,
            effects: self.terms.clone(),
            axes: axes.collect(),
            sources: self.sources.clone(),
        };
        file.checksum = format!("{:08x}", bytes::crc32(file.text()?.as_bytes()));
        file.text()
    }

    /// Reads a family.
    ///
    /// # Errors
    /// One sentence: no JSON of a family, another version, an effect that this program does not know, numbers that do not go together.
    pub fn from_json(text: &str) -> Result<Self, BadInput> {
        let no_family = |e: serde_json::Error| BadInput(format!("this is no family as hrg family writes it: {e}"));
        // (The version comes first: another one has other fields.)
        let Head { version } = serde_json::from_str(text).map_err(no_family)?;
        if version != VERSION {
            return Err(BadInput(format!(
                "the family has version {version}, this program reads {VERSION}; learn it again from its recordings (hrg family)"
            )));
        }
        let mut file: File = serde_json::from_str(text).map_err(no_family)?;
        let stated = std::mem::replace(&mut file.checksum, NO_CHECKSUM.into());
        if stated != format!("{:08x}", bytes::crc32(file.text()?.as_bytes())) {
            return Err(BadInput::new(
                "the family's numbers are not those that hrg family wrote: its checksum is another; learn it again from its recordings",
            ));
        }
        let unknown = file.effects.iter().flat_map(|t| &t.parts).find(|p| EffectId::by_name(&p.effect).is_none());
        if let Some(p) = unknown {
            return Err(BadInput(format!(
                "the family has the effect {}, which this program does not know; learn it again with this program",
                p.effect
            )));
        }
        let mut family = Self {
            name: file.name,
            sources: file.sources,
            without_earth_rate: file.without_earth_rate,
            scaling: file.scaling,
            terms: file.effects,
            temperatures_c: file.temperatures_c,
            ramps_c_per_min: file.ramps_c_per_min,
            lag_s: file.lag_s,
            coarse_s: file.coarse_s.max(1),
            axes: [None, None, None],
        };
        for (a, name) in AXIS_NAMES.iter().enumerate() {
            let Some(facts) = file.axes.get(*name) else { continue };
            let p = family.coefficients(a).len();
            let square = |m: &[Vec<f64>]| m.len() == p && m.iter().all(|r| r.len() == p);
            if facts.mean.len() != p || !square(&facts.between_units) || !square(&facts.between_days) {
                return Err(BadInput(format!(
                    "axis {name} of the family: its effects make {p} coefficients, its numbers are for {}",
                    facts.mean.len()
                )));
            }
            let between = DMatrix::from_fn(p, p, |i, j| facts.between_units[i][j]);
            let days = DMatrix::from_fn(p, p, |i, j| facts.between_days[i][j]);
            let right = between.clone().cholesky().is_some()
                && days.diagonal().iter().all(|v| *v >= 0.0)
                && facts.noise.white_dph2_s > 0.0;
            if !right {
                return Err(BadInput(format!("axis {name} of the family: its variances are none")));
            }
            let population = Population {
                mean: DVector::from_column_slice(&facts.mean),
                between,
                days,
                left_out: 0.0,
                log_odds: Vec::new(),
            };
            let noise_models = facts.noise_models.clone().try_into().map_err(|_| {
                BadInput(format!(
                    "axis {name} of the family: {} noise models, this program has others",
                    facts.noise_models.len()
                ))
            })?;
            let [from_c, to_c, from_c_per_min, to_c_per_min] = facts.visited_ranges;
            let visited = States {
                ranges: Ranges { from_c, to_c, from_c_per_min, to_c_per_min },
                map: Visited { visited_levels: facts.visited_levels, unvisited_dph2: 0.0 },
            };
            family.axes[a] = Some(OfAxis { population, noise: facts.noise, noise_models, visited, curve: facts.curve });
        }
        Ok(family)
    }
}
