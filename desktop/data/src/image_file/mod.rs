//! The calibration file: one text file (TOML) that says what the binary image holds, with units, and turns into it
//! and back without loss. The checksum is that of the image, so a number changed by hand is noticed.

mod error;
mod reader;
mod writer;

pub use error::FileError;
pub use reader::from_text;
pub use writer::to_text;

use crate::error::BadInput;
use hrg_core::calibration::{Calibration, ImageError, MAX_BYTES};
use hrg_core::temperature::TemperatureCurve;
use std::path::Path;

/// Version of the file.
const VERSION: u32 = 1;

/// Keys for the centre and scale of a thermometer that is a sensor.
const SENSOR: [(&str, &str); 2] =
    [("frequency_centre_hz", "sensor_centre_c"), ("frequency_scale_hz", "sensor_scale_c")];

/// The table of the four-parameter model.
const FOUR_PARAMETER: &str = "four_parameter_dph";

/// Key of the constant part of the bias's variance.
const REST: &str = "uncertainty_rest_dph2";
/// The directions of that uncertainty.
const DIRECTIONS_KEY: &str = "uncertainty_directions_dph";
/// Key of an effect's state at the begin of a unit.
const START: &str = "start";

/// Errors of the accelerometers, for the align mode.
const ACCELEROMETERS: &str = "accelerometers";

/// Three accelerometers over temperature.
const ACCELEROMETER: &str = "accelerometer";

/// The inputs beside the frequencies.
const INPUT: &str = "input";
/// Field of an input that stands in the file as a name.
const QUANTITY: &str = "quantity";

/// Checksums are written in hexadecimal.
fn is_checksum(name: &str) -> bool {
    name.ends_with("_crc32")
}

/// Reads a calibration, text or binary.
///
/// # Errors
/// One sentence with the path.
pub fn load(path: &Path) -> anyhow::Result<Calibration> {
    let bytes = crate::files::read_file(path, crate::files::MOST_CALIBRATION, false)?;
    let here = |e: String| BadInput::new(format!("{}: {e}", path.display()));
    if bytes.starts_with(&hrg_core::calibration::MAGIC) {
        return Ok(Calibration::from_bytes(&bytes).map_err(|e: ImageError| here(e.to_string()))?);
    }
    let text = std::str::from_utf8(&bytes).map_err(|_| here("it is neither a calibration file nor an image".into()))?;
    let c = from_text(text).map_err(|e| here(e.to_string()))?;
    if c.to_bytes().is_none() {
        return Err(here(format!(
            "it holds more than an image can ({MAX_BYTES} bytes): take out an effect, no unit would load it"
        ))
        .into());
    }
    Ok(c)
}

/// Writes a calibration: binary where the path ends in `.bin`, else text.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, c: &Calibration) -> anyhow::Result<()> {
    if path.extension().is_some_and(|e| e == "bin") {
        let bytes = c.to_bytes().ok_or_else(|| anyhow::anyhow!("the calibration does not fit an image"))?;
        return crate::output::write_file(path, &bytes);
    }
    crate::output::write_file(path, to_text(c).as_bytes())
}

/// The curve of a sensor that has read from `low_c` to `high_c`: a reading is a temperature.
#[must_use]
pub fn sensor_curve(low_c: f64, high_c: f64) -> TemperatureCurve {
    // The centre is a number that single precision holds, so that the curve gives back what it is given.
    let centre = (0.5 * (low_c + high_c)).round() as f32;
    let scale = (0.5 * (high_c - low_c)).ceil().max(1.0) as f32;
    TemperatureCurve {
        frequency_centre_hz: f64::from(centre),
        frequency_scale_hz: scale,
        temperature_coefficients_c: [centre, scale, 0.0, 0.0],
        valid_from_c: low_c as f32,
        valid_to_c: high_c as f32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_core::bias::four_parameter::FourParameter;
    use hrg_core::bias::Coefficients;
    use hrg_core::calibration::EffectTerm;
    use hrg_core::half::Half;
    use hrg_core::rate_factors::RateAxis;
    use hrg_core::specific_force::{Accelerometer, AccelerometerBias};
    use proptest::prelude::*;

    #[test]
    fn a_change_by_hand_is_noticed() {
        let text = to_text(&Calibration::uncalibrated());
        assert!(from_text(&text).is_ok());
        let changed = text.replace("t_ref_c = 10.0", "t_ref_c = 11.0");
        assert_ne!(text, changed);
        assert!(from_text(&changed).expect_err("noticed").to_string().contains("checksum"));
        assert!(matches!(from_text("a = 1"), Err(FileError::NotOne(_))));
        let error = |text: &str| from_text(text).expect_err("none").to_string();
        assert!(
            error("a = 1\nb, c\n").starts_with("this is not a calibration file: line 2: "),
            "{}",
            error("a = 1\nb, c\n")
        );
        assert!(error("# unit: A\ntime_s,fx_hz\n1,2\n").contains("it is a recording"));
    }

    #[test]
    fn what_is_missing_or_wrong_is_named_with_its_place() {
        let text = to_text(&Calibration::uncalibrated());
        for (from, to, says) in [
            ("t_scale_c", "t_size_c", "[scaling] lacks t_scale_c"),
            ("frequency_scale_hz", "scale_hz", "[axis.x] lacks frequency_scale_hz (for a sensor sensor_scale_c)"),
            ("calibrated = false", "calibrated = 7.5", "the calibration file: calibrated cannot be 7.5"),
            ("[axis.y]", "[axis.q]", "the calibration file lacks [axis.y]"),
            ("bias_dph = [", "bias_of_frequency_dph = [", "[axis.x]: bias_of_frequency_dph must be 7 numbers"),
            ("bias_dph = [", "no_bias_dph = [", "[axis.x] must have one bias model: bias_dph, or"),
            ("hrg_calibration = 1", "hrg_calibration = 9", "is of version 9, this program reads version 1"),
        ] {
            let changed = text.replace(from, to);
            assert_ne!(text, changed, "{from}");
            let e = from_text(&changed).expect_err(says).to_string();
            assert!(e.contains(says), "{e}");
        }
    }

    proptest! {
        #[test]
        fn text_and_image_are_the_same_calibration(k in proptest::array::uniform6(-1e3f32..1e3), g in -9f32..9.0, f0 in 4e3f64..5e3) {
            let mut c = Calibration::uncalibrated();
            c.set_unit_name("HRG-7");
            c.axes[0].coefficients = Coefficients::One(k);
            c.axes[1].coefficients = Coefficients::CoolingHeating(k, [g; 6]);
            c.axes[2].curve.frequency_centre_hz = f0;
            c.axes[1].curve = sensor_curve(g.into(), f64::from(g) + 40.0);
            let rest = if g < -3.0 {
                Coefficients::Network(std::array::from_fn(|j| k[j % 6] + j as f32))
            } else if g < 3.0 {
                Coefficients::Direct(std::array::from_fn(|j| k[j % 6]))
            } else {
                let m = FourParameter { constant_cooling_heating_low_high: [g; 5], breakpoint_c: g, origin_c: k[0] };
                Coefficients::FourParameter(m)
            };
            c.axes[2].coefficients = rest;
            let mut e = EffectTerm::new(7, [0.0; 2]);
            e.start = -1.0;
            e.directions[1][0][0] = Half::of(g);
            c.axes[2].uncertainty.rest_dph2 = g.abs();
            c.axes[2].uncertainty.baseline[1][3] = -g;
            e.gains[1][1] = g;
            c.accelerometers.bias_mps2[1] = g / 10.0;
            c.accelerometers.matrix[0][1] = 1e-3;
            c.effects.push(e).expect("room");
            if g > 0.0 {
                let mut r = RateAxis { rate_valid_from_c: -40.0, rate_valid_to_c: g, ..RateAxis::default() };
                r.scale_correction_ppm = [k[0], k[1], k[2], k[3], g, -g];
                r.misalignment_urad = [[k[4], g], [g, k[5]]];
                c.rates = Some([r; 3]);
            }
            if g > 3.0 {
                let bias_mps2 = k.map(|k| 1e-4 * k);
                let bias = AccelerometerBias { bias_mps2, bias_std_mps2: [1e-5 * g; 5] };
                let errors = RateAxis { rate_valid_to_c: g, misalignment_urad: [[g, -g]; 2], ..RateAxis::default() };
                c.specific_force = Some([Accelerometer { bias, errors }; 3]);
            }
            let again = from_text(&to_text(&c)).expect("readable");
            prop_assert_eq!(again.to_bytes(), c.to_bytes());
        }
    }
}
