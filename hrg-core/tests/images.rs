//! Stored calibration images: what a unit in the field holds must load in every firmware to come.

use hrg_core::accelerometers::Accelerometers;
use hrg_core::bias::four_parameter::FourParameter;
use hrg_core::bias::Coefficients;
use hrg_core::calibration::{Calibration, ImageError, Parts, Uncertainty, VERSION};
use hrg_core::compensator::Compensator;
use hrg_core::frequency::StepFrequencies;
use hrg_core::rate_factors::Factors;
use hrg_core::sectors::{newest, Found, Place, Sector};
use hrg_core::status::AxisStatus;

const DEFAULT: &[u8] = include_bytes!("images/version-1-default.bin");
const EFFECTS: &[u8] = include_bytes!("images/version-1-effects.bin");
const MODELS: &[u8] = include_bytes!("images/version-1-models.bin");
const UNCERTAIN: &[u8] = include_bytes!("images/version-1-uncertain.bin");
const ACCELEROMETERS: &[u8] = include_bytes!("images/version-1-accelerometers.bin");
const RATES: &[u8] = include_bytes!("images/version-1-rates.bin");

fn read(image: &[u8]) -> Calibration {
    Calibration::from_bytes(image).expect("a stored image loads")
}

fn parts(image: &[u8]) -> Parts {
    Parts::from_bits(image[5]).expect("known parts")
}

#[test]
fn each_image_holds_what_was_put_into_it() {
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
fn an_image_may_state_its_uncertainty() {
    let u = read(UNCERTAIN);
    assert_eq!(parts(UNCERTAIN), Parts::UNCERTAINTY);
    assert_eq!((u.axes[0].uncertainty.rest_dph2, u.axes[2].uncertainty.baseline[0]), (0.25, [0.5; 6]));
    assert_eq!(u.effects.iter().map(|t| t.start).collect::<Vec<_>>(), [0.0, -1.0, 0.0]);
    let directions: Vec<(f32, f32)> =
        u.effects.iter().map(|t| (t.directions[1][2][0].value(), t.directions[1][1][0].value())).collect();
    assert_eq!(directions, [(-0.125, 0.0); 3]);
    assert_eq!(read(EFFECTS).axes[0].uncertainty, Uncertainty::default(), "this one states none");
}

#[test]
fn an_image_may_hold_the_errors_of_accelerometers() {
    assert_eq!(parts(ACCELEROMETERS), Parts::UNCERTAINTY | Parts::ACCELEROMETERS);
    let (c, before) = (read(ACCELEROMETERS), read(UNCERTAIN));
    assert_eq!(c.accelerometers.bias_mps2, [2.103_628_2e-4, -8.969_197_5e-4]);
    assert_eq!(c.accelerometers.matrix, [[1.019_075, 0.002_941_191_4], [-0.005_269_312_3, 1.002_997_9]]);
    assert_eq!(Calibration { accelerometers: before.accelerometers, ..c }, before);
    assert_eq!(before.accelerometers, Accelerometers::IDEAL, "this one holds none");
}

#[test]
fn an_image_may_hold_scale_factors_and_misalignments() {
    let r = read(RATES);
    assert!(parts(RATES).contains(Parts::RATES));
    let y = r.rates.expect("stated")[1];
    assert_eq!(
        (y.scale_correction_ppm, y.misalignment_urad),
        ([100.0, -50.0, 25.0, 12.5, -6.25, 3.125], [[300.0, -200.0], [-1.5, 2.5]])
    );
    assert_eq!((y.rate_valid_from_c, y.rate_valid_to_c_per_min, y.scale_std_ppm[2]), (-40.0, 1.5, 2.0));
    for without in [DEFAULT, EFFECTS, MODELS, UNCERTAIN, ACCELEROMETERS] {
        assert_eq!(read(without).rates, None, "the unit matrix and the constant scale factors");
    }
}

#[test]
fn an_image_is_written_as_it_was_stored() {
    // A part that is not stated takes no bytes: an image keeps its checksum where a later program has more parts.
    for image in [DEFAULT, EFFECTS, MODELS, UNCERTAIN, ACCELEROMETERS, RATES] {
        let again = read(image).to_bytes().expect("fits");
        assert!(again == image, "the layout has changed");
    }
}

#[test]
fn a_newer_image_is_refused_and_the_older_one_used() {
    let mut newer = EFFECTS.to_vec();
    newer[4] = VERSION + 1;
    let end = newer.len() - 4;
    let crc = hrg_core::bytes::crc32(&newer[..end]).to_le_bytes();
    newer[end..].copy_from_slice(&crc);
    let found = newest(MODELS, &newer, None);
    let refused = Some(ImageError::Version(VERSION + 1));
    assert_eq!(
        found,
        Found { newest: Some((read(MODELS), Place { sector: Sector::A, offset: 0 })), refused, cut_short: None }
    );
}

#[test]
fn an_image_without_rates_corrects_by_the_bias_alone_to_the_last_bit() {
    for image in [DEFAULT, EFFECTS, MODELS, UNCERTAIN, ACCELEROMETERS] {
        let c = read(image);
        let mut unit = Compensator::new(c.clone(), 0.0);
        for step in 0..400u32 {
            let frequency_hz = c.axes.each_ref().map(|a| {
                let share = f64::from(step) / 400.0 - 0.5;
                Some(a.curve.frequency_centre_hz + share * f64::from(a.curve.frequency_scale_hz))
            });
            let end_ticks = u64::from(step + 1) * 90_000_000;
            let now =
                unit.update(&StepFrequencies { step, end_ticks, frequency_hz, rejected: [0; 3], missing: [0; 3] });
            assert!(now.factors.same(&Factors::UNIT));
            assert!(now.status.iter().all(|s| !s.contains(AxisStatus::SCALE_FACTOR)));
            let raw = [step as f32 * 1.7 - 300.0, 1e-3 * step as f32, -65_000.3];
            let corrected = now.factors.corrected_dph(raw, now.bias_dph);
            for a in 0..3 {
                assert_eq!(corrected[a].to_bits(), (raw[a] - now.bias_dph[a]).to_bits());
            }
        }
    }
    // And with them it does not.
    let mut unit = Compensator::new(read(RATES), 0.0);
    let curve = read(RATES).axes.map(|a| a.curve.frequency_centre_hz);
    let step = StepFrequencies {
        step: 0,
        end_ticks: 90_000_000,
        frequency_hz: curve.map(Some),
        rejected: [0; 3],
        missing: [0; 3],
    };
    assert!(!unit.update(&step).factors.same(&Factors::UNIT));
}
