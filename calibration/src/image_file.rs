//! The calibration file: one text file (TOML) that says what the binary block holds, with units, and turns into it
//! and back without loss. The checksum is that of the block, so a number changed by hand is noticed.

use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::four_parameter::{self, FourParameter};
use hrg_core::bias::{direct, network, Coefficients, Scaling, TERMS};
use hrg_core::calibration::{Axis, BlockError, Calibration, EffectTerm};
use hrg_core::effects::{by_id, EffectId, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::temperature::TemperatureLaw;
use hrg_core::AXES;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the file.
const VERSION: u32 = 1;

#[derive(Debug, Serialize, Deserialize)]
struct File {
    hrg_calibration: u32,
    unit: String,
    created_unix_s: u32,
    sequence: u32,
    data_crc32: String,
    calibrated: bool,
    /// CRC-32 of the binary block.
    block_crc32: String,
    scaling: FileScaling,
    axis: BTreeMap<String, FileAxis>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    effect: Vec<FileEffect>,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileScaling {
    t_ref_c: f32,
    t_scale_c: f32,
    linear_below_c: f32,
    linear_above_c: f32,
    linear_beyond_c_per_min: f32,
    blend_band_c_per_min: f32,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileAxis {
    #[serde(skip_serializing_if = "Option::is_none")]
    frequency_centre_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    frequency_scale_hz: Option<f32>,
    /// In the place of the two above, where the thermometer is a sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    sensor_centre_c: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sensor_scale_c: Option<f32>,
    temperature_coefficients_c: [f32; 4],
    valid_from_c: f32,
    valid_to_c: f32,
    valid_from_c_per_min: f32,
    valid_to_c_per_min: f32,
    /// (`rate_scale_dph_per_code` in files of older programs.)
    #[serde(alias = "rate_scale_dph_per_code")]
    scale_factor_dph_per_code: f32,
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_dph: Option<[f32; TERMS]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_cooling_dph: Option<[f32; TERMS]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_heating_dph: Option<[f32; TERMS]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    four_parameter_dph: Option<FileFourParameter>,
    #[serde(skip_serializing_if = "Option::is_none")]
    bias_of_frequency_dph: Option<[f32; direct::TERMS]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    network_dph: Option<[f32; network::WEIGHTS]>,
    bias_std_dph: [[f32; TERMS]; 2],
    train_rms_dph: f32,
    verify_rms_dph: f32,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileFourParameter {
    constant_cooling_heating_low_high: [f32; four_parameter::TERMS],
    breakpoint_c: f32,
    origin_c: f32,
}

#[derive(Debug, Serialize, Deserialize)]
struct FileEffect {
    name: String,
    parameters: BTreeMap<String, f32>,
    gain_dph: BTreeMap<String, Vec<f32>>,
    gain_std_dph: BTreeMap<String, Vec<f32>>,
}

/// The file's text.
#[must_use]
pub fn to_text(c: &Calibration) -> String {
    let s = &c.scaling;
    let by_axis = |f: &dyn Fn(usize) -> Vec<f32>| {
        AXIS_NAMES.iter().enumerate().map(|(a, n)| ((*n).to_string(), f(a))).collect::<BTreeMap<_, _>>()
    };
    let file = File {
        hrg_calibration: VERSION,
        unit: c.unit_name().to_string(),
        created_unix_s: c.created_unix_s,
        sequence: c.sequence,
        data_crc32: format!("{:08x}", c.data_hash),
        calibrated: c.calibrated,
        block_crc32: format!("{:08x}", c.checksum()),
        scaling: FileScaling {
            t_ref_c: s.t_ref_c,
            t_scale_c: s.t_scale_c,
            linear_below_c: s.t_linear_c[0],
            linear_above_c: s.t_linear_c[1],
            linear_beyond_c_per_min: s.r_linear,
            blend_band_c_per_min: s.blend_band,
        },
        axis: c
            .axes
            .iter()
            .zip(AXIS_NAMES)
            .map(|(a, n)| {
                let sensor = a.law.is_of_sensor();
                let mut axis = FileAxis {
                    frequency_centre_hz: (!sensor).then_some(a.law.f0_hz),
                    frequency_scale_hz: (!sensor).then_some(a.law.scale_hz),
                    sensor_centre_c: sensor.then_some(a.law.f0_hz),
                    sensor_scale_c: sensor.then_some(a.law.scale_hz),
                    temperature_coefficients_c: a.law.c,
                    valid_from_c: a.law.min_c,
                    valid_to_c: a.law.max_c,
                    valid_from_c_per_min: a.rate_range_c_per_min[0],
                    valid_to_c_per_min: a.rate_range_c_per_min[1],
                    scale_factor_dph_per_code: a.scale_factor_dph_per_code,
                    bias_dph: None,
                    bias_cooling_dph: None,
                    bias_heating_dph: None,
                    four_parameter_dph: None,
                    bias_of_frequency_dph: None,
                    network_dph: None,
                    bias_std_dph: a.coefficient_std,
                    train_rms_dph: a.train_rms_dph,
                    verify_rms_dph: a.verify_rms_dph,
                };
                match a.coefficients {
                    Coefficients::One(k) => axis.bias_dph = Some(k),
                    Coefficients::CoolingHeating(c, h) => {
                        axis.bias_cooling_dph = Some(c);
                        axis.bias_heating_dph = Some(h);
                    }
                    Coefficients::FourParameter(m) => {
                        axis.four_parameter_dph = Some(FileFourParameter {
                            constant_cooling_heating_low_high: m.k,
                            breakpoint_c: m.breakpoint_c,
                            origin_c: m.origin_c,
                        });
                    }
                    Coefficients::Direct(k) => axis.bias_of_frequency_dph = Some(k),
                    Coefficients::Network(w) => axis.network_dph = Some(w),
                }
                (n.to_string(), axis)
            })
            .collect(),
        effect: c
            .effects
            .iter()
            .filter_map(|e| by_id(e.id).map(|f| (e, f)))
            .map(|(e, f)| FileEffect {
                name: f.name.to_string(),
                parameters: f.parameters.iter().zip(e.parameters).map(|(n, v)| ((*n).to_string(), v)).collect(),
                gain_dph: by_axis(&|a| e.gains[a][..f.outputs].to_vec()),
                gain_std_dph: by_axis(&|a| e.gain_std[a][..f.outputs].to_vec()),
            })
            .collect(),
    };
    let body = toml::to_string(&file).unwrap_or_else(|e| format!("# cannot be written: {e}\n"));
    format!(
        "# Calibration of an HRG unit. corrected = raw - bias.\n\
         # bias = k0 + k1 u + k2 u^2 + k3 r + k4 r^2 + k5 u r, u = (T - t_ref_c) / t_scale_c, r = dT/dt in C per minute,\n\
         # plus gain times regressor of each effect. T = c0 + c1 v + c2 v^2 + c3 v^3, v = (f - centre) / scale.\n\
         # block_crc32 is the checksum of the binary block: a number changed by hand no longer matches.\n{body}"
    )
}

/// Reads the file's text.
///
/// # Errors
/// One sentence.
pub fn from_text(text: &str) -> Result<Calibration, BadInput> {
    let f: File = toml::from_str(text)
        .map_err(|e| BadInput::new(format!("this is not a calibration file: {}", e.to_string().replace('\n', " "))))?;
    if f.hrg_calibration != VERSION {
        return Err(BadInput::new(format!(
            "the calibration file is of version {}, this program reads version {VERSION}",
            f.hrg_calibration
        )));
    }
    let hex = |s: &str, what: &str| {
        u32::from_str_radix(s, 16).map_err(|_| BadInput::new(format!("{what} \"{s}\" is not a hexadecimal number")))
    };
    let mut c = Calibration::uncalibrated();
    c.set_unit_name(&f.unit);
    c.created_unix_s = f.created_unix_s;
    c.sequence = f.sequence;
    c.data_hash = hex(&f.data_crc32, "data_crc32")?;
    c.calibrated = f.calibrated;
    let s = &f.scaling;
    c.scaling = Scaling {
        t_ref_c: s.t_ref_c,
        t_scale_c: s.t_scale_c,
        t_linear_c: [s.linear_below_c, s.linear_above_c],
        r_linear: s.linear_beyond_c_per_min,
        blend_band: s.blend_band_c_per_min,
    };
    for (a, n) in AXIS_NAMES.iter().enumerate() {
        let x = f.axis.get(*n).ok_or_else(|| BadInput::new(format!("the calibration file lacks [axis.{n}]")))?;
        let two_sets = x.bias_cooling_dph.zip(x.bias_heating_dph);
        let models = [
            x.bias_dph.map(Coefficients::One),
            two_sets.map(|(c, h)| Coefficients::CoolingHeating(c, h)),
            x.four_parameter_dph.as_ref().map(|m| {
                Coefficients::FourParameter(FourParameter {
                    k: m.constant_cooling_heating_low_high,
                    breakpoint_c: m.breakpoint_c,
                    origin_c: m.origin_c,
                })
            }),
            x.bias_of_frequency_dph.map(Coefficients::Direct),
            x.network_dph.map(Coefficients::Network),
        ];
        let mut given = models.into_iter().flatten();
        let (Some(coefficients), None) = (given.next(), given.next()) else {
            return Err(BadInput::new(format!(
                "[axis.{n}] must have one bias model: bias_dph, or bias_cooling_dph with bias_heating_dph, or four_parameter_dph, bias_of_frequency_dph or network_dph"
            )));
        };
        let (Some(f0_hz), Some(scale_hz)) =
            (x.frequency_centre_hz.or(x.sensor_centre_c), x.frequency_scale_hz.or(x.sensor_scale_c))
        else {
            return Err(BadInput::new(format!(
                "[axis.{n}] must have frequency_centre_hz with frequency_scale_hz, or for a sensor sensor_centre_c with sensor_scale_c"
            )));
        };
        c.axes[a] = Axis {
            law: TemperatureLaw {
                f0_hz,
                scale_hz,
                c: x.temperature_coefficients_c,
                min_c: x.valid_from_c,
                max_c: x.valid_to_c,
            },
            scale_factor_dph_per_code: x.scale_factor_dph_per_code,
            rate_range_c_per_min: [x.valid_from_c_per_min, x.valid_to_c_per_min],
            coefficients,
            coefficient_std: x.bias_std_dph,
            train_rms_dph: x.train_rms_dph,
            verify_rms_dph: x.verify_rms_dph,
        };
    }
    for e in &f.effect {
        let facts = EffectId::by_name(&e.name)
            .map(EffectId::facts)
            .ok_or_else(|| BadInput::new(format!("effect \"{}\" is not known to this program", e.name)))?;
        let mut term = EffectTerm {
            id: facts.id,
            parameters: [0.0; MAX_PARAMETERS],
            gains: [[0.0; MAX_OUTPUTS]; AXES],
            gain_std: [[0.0; MAX_OUTPUTS]; AXES],
        };
        for (to, name) in term.parameters.iter_mut().zip(facts.parameters) {
            *to = *e
                .parameters
                .get(*name)
                .ok_or_else(|| BadInput::new(format!("effect {} lacks the parameter {name}", e.name)))?;
        }
        for (a, n) in AXIS_NAMES.iter().enumerate() {
            for (to, from) in [(&mut term.gains[a], &e.gain_dph), (&mut term.gain_std[a], &e.gain_std_dph)] {
                let values = from.get(*n).filter(|v| v.len() == facts.outputs).ok_or_else(|| {
                    BadInput::new(format!("effect {}: axis {n} needs {} gains", e.name, facts.outputs))
                })?;
                to[..facts.outputs].copy_from_slice(values);
            }
        }
        c.effects
            .push(term)
            .map_err(|_| BadInput::new("the calibration file has more effects than a block can hold"))?;
    }
    c.check().map_err(|e| BadInput::new(format!("the calibration file cannot be used: {e}")))?;
    let stated = hex(&f.block_crc32, "block_crc32")?;
    if stated != c.checksum() {
        return Err(BadInput::new(format!(
            "the calibration file's checksum is {stated:08x}, its content gives {:08x}: it was changed by hand or damaged; make it anew, or set block_crc32 if the change is meant",
            c.checksum()
        )));
    }
    Ok(c)
}

/// Reads a calibration, text or binary.
///
/// # Errors
/// One sentence with the path.
pub fn load(path: &Path) -> anyhow::Result<Calibration> {
    let bytes = crate::read_file(path, crate::MOST_CALIBRATION, false)?;
    let here = |e: String| BadInput::new(format!("{}: {e}", path.display()));
    if bytes.starts_with(&hrg_core::calibration::MAGIC) {
        return Ok(Calibration::from_bytes(&bytes).map_err(|e: BlockError| here(e.to_string()))?);
    }
    let text = std::str::from_utf8(&bytes).map_err(|_| here("it is neither a calibration file nor a block".into()))?;
    Ok(from_text(text).map_err(|e| here(e.0))?)
}

/// Writes a calibration: binary where the path ends in `.bin`, else text.
///
/// # Errors
/// Where the file cannot be written.
pub fn save(path: &Path, c: &Calibration) -> anyhow::Result<()> {
    if path.extension().is_some_and(|e| e == "bin") {
        let bytes = c.to_bytes().ok_or_else(|| anyhow::anyhow!("the calibration does not fit a block"))?;
        return crate::write_file(path, &bytes);
    }
    crate::write_file(path, to_text(c).as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_change_by_hand_is_noticed() {
        let text = to_text(&Calibration::uncalibrated());
        assert!(from_text(&text).is_ok());
        let changed = text.replace("t_ref_c = 10.0", "t_ref_c = 11.0");
        assert_ne!(text, changed);
        assert!(from_text(&changed).expect_err("noticed").0.contains("checksum"));
        assert!(from_text("a = 1").expect_err("refused").0.contains("not a calibration file"));
    }

    proptest! {
        #[test]
        fn text_and_block_are_the_same_calibration(k in proptest::array::uniform6(-1e3f32..1e3), g in -9f32..9.0, f0 in 4e3f64..5e3) {
            let mut c = Calibration::uncalibrated();
            c.set_unit_name("HRG-7");
            c.axes[0].coefficients = Coefficients::One(k);
            c.axes[1].coefficients = Coefficients::CoolingHeating(k, [g; 6]);
            c.axes[2].law.f0_hz = f0;
            c.axes[1].law = crate::thermometer::curve::sensor_law(g.into(), f64::from(g) + 40.0);
            let rest = if g < -3.0 {
                Coefficients::Network(std::array::from_fn(|j| k[j % 6] + j as f32))
            } else if g < 3.0 {
                Coefficients::Direct(std::array::from_fn(|j| k[j % 6]))
            } else {
                let m = FourParameter { k: [g; 5], breakpoint_c: g, origin_c: k[0] };
                Coefficients::FourParameter(m)
            };
            c.axes[2].coefficients = rest;
            let mut e = EffectTerm { id: 7, parameters: [0.0; 2], gains: [[0.0; MAX_OUTPUTS]; 3], gain_std: [[0.0; MAX_OUTPUTS]; 3] };
            e.gains[1][1] = g;
            c.effects.push(e).expect("room");
            let again = from_text(&to_text(&c)).expect("readable");
            prop_assert_eq!(again.to_bytes(), c.to_bytes());
        }
    }
}
