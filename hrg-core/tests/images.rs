//! Stored calibration images of each version: what a unit in the field holds must load in every firmware to come.

use hrg_core::bias::four_parameter::FourParameter;
use hrg_core::bias::Coefficients;
use hrg_core::calibration::{Calibration, ImageError, VERSION};
use hrg_core::sectors::{newest, Found, Sector};

const DEFAULT: &[u8] = include_bytes!("images/version-1-default.bin");
const EFFECTS: &[u8] = include_bytes!("images/version-1-effects.bin");
const MODELS: &[u8] = include_bytes!("images/version-1-models.bin");

fn read(image: &[u8]) -> Calibration {
    Calibration::from_bytes(image).expect("an image of version 1 loads")
}

#[test]
fn version_1_holds_what_was_put_into_it() {
    let d = read(DEFAULT);
    assert_eq!((d.unit_name(), d.sequence, d.calibrated), ("default", 0, false));
    assert_eq!(
        (d.axes[0].curve.frequency_centre_hz, d.axes[2].curve.temperature_coefficients_c[1]),
        (4900.0, 44.658_787)
    );
    let e = read(EFFECTS);
    assert_eq!((e.unit_name(), e.sequence), ("HRG-101", 7));
    assert_eq!(e.axes[1].coefficients, Coefficients::CoolingHeating([1.5; 6], [-2.5e-3; 6]));
    let effects: Vec<(u16, f32, f32)> = e.effects.iter().map(|t| (t.id, t.parameters[0], t.gains[2][0])).collect();
    assert_eq!(effects, [(4, 600.0, 0.125), (6, 600.0, 0.125), (3, 600.0, 0.125)]);
    let m = read(MODELS);
    let four = FourParameter {
        constant_cooling_heating_low_high: [1.0, 2.0, 3.0, 4.0, 5.0],
        breakpoint_c: 12.5,
        origin_c: -3.0,
    };
    assert_eq!(m.axes[0].coefficients, Coefficients::FourParameter(four));
    assert_eq!(m.axes[1].coefficients, Coefficients::Direct([0.5; 7]));
    assert_eq!(m.axes[2].coefficients, Coefficients::Network([-1.25; 16]));
}

#[test]
fn an_image_of_this_version_is_written_as_it_was_stored() {
    for image in [DEFAULT, EFFECTS, MODELS] {
        let version = u16::from_le_bytes([image[4], image[5]]);
        let again = read(image).to_bytes().expect("fits");
        assert_eq!(version == VERSION, again == image, "the layout of version {version} has changed");
    }
}

#[test]
fn a_newer_image_is_refused_and_the_older_one_used() {
    let mut newer = EFFECTS.to_vec();
    newer[4] = (VERSION + 1) as u8;
    let end = newer.len() - 4;
    let crc = hrg_core::bytes::crc32(&newer[..end]).to_le_bytes();
    newer[end..].copy_from_slice(&crc);
    let found = newest(MODELS, &newer);
    let refused = Some(ImageError::Version(VERSION + 1));
    assert_eq!(found, Found { newest: Some((read(MODELS), Sector::A)), refused });
}
