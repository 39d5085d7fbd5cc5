//! The fields of an image, in the order in which they lie in it. The names are those of the calibration file.
//!
//! # Example
//! ```
//! use hrg_core::calibration::layouts::Header;
//! use hrg_core::schema::{size, Layout};
//!
//! let names: Vec<&str> = Header::FIELDS.iter().map(|f| f.name).collect();
//! assert_eq!(names, ["magic", "version", "parts", "length"]);
//! assert_eq!(size(Header::FIELDS), 8);
//! ```

use super::{Axis, Calibration};
use crate::bias::four_parameter::{self, FourParameter};
use crate::bias::{direct, network, Coefficients, Scaling, TERMS};
use crate::effects::MAX_PARAMETERS;
use crate::inputs::Input;
use crate::schema::{layout, Field, Layout, Wire};
use crate::temperature::TemperatureCurve;
use crate::unit_name::UnitName;
use crate::AXES;

/// Header of an image, before its payload.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Header {
    /// [`super::MAGIC`].
    pub magic: [u8; 4],
    /// Version of the layout.
    pub version: u8,
    /// Bits of the [`Parts`](super::Parts) that stand behind the effects.
    pub parts: u8,
    /// Bytes of the whole image, checksum included.
    pub length: u16,
}
layout! { Header {
    magic: [u8; 4], "`HRGC`";
    version: u8, "version of the layout";
    parts: u8, "parts behind the effects: bit 0 uncertainty, 1 accelerometers, 2 scale factors and misalignments, 3 temperatures and ramps visited together, 4 inputs, 5 accelerometers over temperature; 6 and 7 are free";
    length: u16, "bytes of the whole image, checksum included";
} }

layout! { Calibration {
    unit: UnitName, "name of the unit, padded with zeros";
    created_unix_s: u32, "when it was made, seconds since 1970; 0: the compiled-in default";
    sequence: u32, "counts up with each image burnt";
    data_crc32: u32, "CRC-32 of the recordings that made it";
    calibrated: bool, "0: the compiled-in default";
} }

layout! { Scaling {
    t_ref_c: f32, "temperature at u = 0, C";
    t_scale_c: f32, "temperature difference of u = 1, C";
    linear_below_c: f32, "below, powers of u are continued linearly, C";
    linear_above_c: f32, "above, powers of u are continued linearly, C";
    linear_beyond_c_per_min: f32, "beyond this ramp its square is continued linearly, C per minute";
    blend_band_c_per_min: f32, "half-width of the blend of cooling and heating set, C per minute";
} }

layout! { TemperatureCurve {
    frequency_centre_hz: f64, "centre of the frequency, Hz (of a sensor: C)";
    frequency_scale_hz: f32, "half-width of the fitted range, Hz (of a sensor: C)";
    temperature_coefficients_c: [f32; 4], "temperature by powers of the scaled frequency, C";
    valid_from_c: f32, "lowest temperature of the fit, C";
    valid_to_c: f32, "highest temperature of the fit, C";
} }

layout! { FourParameter {
    constant_cooling_heating_low_high: [f32; four_parameter::TERMS], "constant (deg/h), cooling and heating (deg/h per C per minute), low and high (deg/h per C)";
    breakpoint_c: f32, "breakpoint, C";
    origin_c: f32, "where temperature counts from, C";
} }

layout! { Axis {
    bias_std_dph: [[f32; TERMS]; 2], "standard deviations of the coefficients, deg/h: cooling (or the only) set, heating set";
    scale_factor_dph_per_code: f32, "deg/h per code of the ADC";
    valid_from_c_per_min: f32, "fastest cooling of the fit, C per minute";
    valid_to_c_per_min: f32, "fastest heating of the fit, C per minute";
    train_rms_dph: f32, "standard deviation of 100 s means on the data of the fit, deg/h";
    verify_rms_dph: f32, "the same on a run that the fit never saw, deg/h; 0: not measured";
} }

layout! { Input {
    quantity: u8, "number of the quantity";
    counts_s: u8, "seconds for which a value counts";
    most_equal: u16, "messages in a row with the same value, beyond which it stands still";
    reference: f32, "value from which its effects count it, in its unit";
    scale: f32, "change that its effects count as one, in its unit";
    valid_from: f32, "lowest value that is not flagged, in its unit";
    valid_to: f32, "highest value that is not flagged, in its unit";
    expected: [[f32; TERMS]; AXES], "its effects as temperature and ramp tell them, by axis: coefficients of eq 7, deg/h";
    without_dph: [f32; AXES], "standard deviation of what these do not tell of its effects, in training, by axis, deg/h";
} }

/// First fields of an effect.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct EffectHead {
    /// Number of the effect.
    pub id: u16,
    /// Regressors, and so gains of an axis.
    pub outputs: u8,
    /// Inner parameters; zeros where it has fewer.
    pub parameters: [f32; MAX_PARAMETERS],
    /// As [`EffectTerm::start`](super::EffectTerm::start).
    pub start: f32,
}
layout! { EffectHead {
    id: u16, "number of the effect";
    outputs: u8, "n, the number of its gains on an axis";
    parameters: [f32; MAX_PARAMETERS], "inner parameters; zeros where it has fewer";
    start: f32, "place on its path at the unit's start, of an effect that remembers the path";
} }

/// A field of a bias model that is one row of singles.
const fn row(name: &'static str, meaning: &'static str, count: usize) -> Field {
    Field { name, meaning, format: <f32 as Wire>::FORMAT, count, row: count }
}

/// Bias models: number in an image, and fields.
pub const MODELS: [(u8, &[Field]); 5] = [
    (1, &[row("bias_dph", "eq 7, deg/h", TERMS)]),
    (
        2,
        &[
            row("bias_cooling_dph", "eq 7, cooling set, deg/h", TERMS),
            row("bias_heating_dph", "eq 7, heating set, deg/h", TERMS),
        ],
    ),
    (3, FourParameter::FIELDS),
    (4, &[row("bias_of_frequency_dph", "curve of frequency, deg/h", direct::TERMS)]),
    (5, &[row("network_dph", "weights of the network", network::WEIGHTS)]),
];

impl Coefficients {
    /// Its number in an image.
    #[must_use]
    pub const fn kind(&self) -> u8 {
        match self {
            Self::One(_) => 1,
            Self::CoolingHeating(..) => 2,
            Self::FourParameter(_) => 3,
            Self::Direct(_) => 4,
            Self::Network(_) => 5,
        }
    }
}
