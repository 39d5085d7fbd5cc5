//! The coefficient image: what the desktop identifies and the unit keeps in flash.
//!
//! # Layout (little-endian)
//! `magic "HRGC"`, `version u8`, `parts u8`, `length u16` (of the whole image, checksum included), payload, `CRC-32` (ISO-HDLC)
//! of all before it. The payload is written and read by one pair of functions in `image.rs`, in one order.
//! Effects are named by the stable numbers of [`crate::effects`], so an old image loads in a new firmware; a new
//! image with an effect that an old firmware lacks is refused by name of error, never half used.
//!
//! # Versions
//! The optional parts ([`Parts`]) stand behind the payload, in the order of their bits. Something new is a new part, with a bit of
//! its own, and its absence means what images without it meant. So a firmware reads all older images; an older firmware reads a
//! newer image that lacks the new part, and refuses one that has it ([`ImageError::UnknownPart`]), flags it, and uses the other
//! sector or the default. The version counts up only where the payload itself changes ([`ImageError::Version`]).
//! Images are stored in `hrg-core/tests/images` and read by every test run.
//!
//! Every number is checked when an image is read: an image with a valid checksum and an absurd number is as
//! useless as a broken one.
//!
//! # Example
//! ```
//! use hrg_core::calibration::{Calibration, ImageError};
//!
//! let mut calibration = Calibration::uncalibrated();
//! calibration.set_unit_name("HRG-042");
//! let mut image = calibration.to_bytes().expect("fits");
//! assert_eq!(Calibration::from_bytes(&image), Ok(calibration));
//! // One bit that has changed, and the image is refused.
//! image[100] ^= 1;
//! assert_eq!(Calibration::from_bytes(&image), Err(ImageError::Checksum));
//! ```

mod check;
mod image;
pub use image::{stated_length, COMMIT, REFUSED};
pub mod layouts;

use crate::accelerometers::Accelerometers;
use crate::bias::{Coefficients, Scaling, TERMS};
use crate::effects::{MAX_OUTPUTS, MAX_PARAMETERS};
use crate::half::Half;
use crate::inputs::{self, InputTable, QuantitySet};
use crate::rate_factors::RateAxis;
use crate::specific_force::Accelerometer;
use crate::status::AxisStatus;
use crate::temperature::TemperatureCurve;
use crate::unit_name::UnitName;
use crate::visited::Visited;
use crate::AXES;
use heapless::Vec;

/// First bytes of every image.
pub const MAGIC: [u8; 4] = *b"HRGC";
/// Version of the layout that is written; every version from [`OLDEST`] to this one is read.
pub const VERSION: u8 = 1;
/// Oldest version that is read. It stays 1: a unit in the field keeps its calibration through every update of its firmware.
pub const OLDEST: u8 = 1;
/// Most effects in one image.
pub const MAX_EFFECTS: usize = 8;
/// Longest possible image in bytes.
pub const MAX_BYTES: usize = 4096;
/// Most directions of an [`Uncertainty`].
pub const DIRECTIONS: usize = 2;

bitflags::bitflags! {
    /// Parts that an image may hold beside what each image holds.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub struct Parts: u8 {
        /// [`Uncertainty`] of each axis, with the directions of the effects.
        const UNCERTAINTY = 1;
        /// [`Accelerometers`].
        const ACCELEROMETERS = 1 << 1;
        /// [`Calibration::rates`].
        const RATES = 1 << 2;
        /// [`Axis::visited`].
        const VISITED = 1 << 3;
        /// [`Calibration::inputs`].
        const INPUTS = 1 << 4;
        /// [`Calibration::specific_force`].
        const SPECIFIC_FORCE = 1 << 5;
    }
}

/// Uncertainty of the bias of one axis. Its variance at any moment is `rest_dph2` plus the sum of the squares of the
/// directions. Each direction is a bias made of the same regressors: of the baseline with these coefficients
/// (regressors of [`crate::bias::regressors`], whatever the baseline), of the effects with
/// [`EffectTerm::directions`]. So the covariance of all gains is kept in its largest parts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Uncertainty {
    /// Variance that no direction holds, (deg/h)^2; 0: the image does not state its uncertainty.
    pub rest_dph2: f32,
    /// Coefficients of each direction, deg/h per unit of the regressor.
    pub baseline: [[f32; TERMS]; DIRECTIONS],
}

/// One axis of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Frequency to temperature.
    pub curve: TemperatureCurve,
    /// Scale factor of the rate channel, deg/h per code of the ADC; its sign is that of the channel.
    pub scale_factor_dph_per_code: f32,
    /// Fastest cooling in the data of the fit, C per minute.
    pub valid_from_c_per_min: f32,
    /// Fastest heating in the data of the fit, C per minute.
    pub valid_to_c_per_min: f32,
    /// The baseline model.
    pub coefficients: Coefficients,
    /// Standard deviation of each coefficient, row after row: cooling then heating set, or the linear coefficients of
    /// another model in their order (zeros: not stated).
    pub bias_std_dph: [[f32; TERMS]; 2],
    /// Uncertainty of the bias.
    pub uncertainty: Uncertainty,
    /// Temperatures and ramps that the fit has seen together.
    pub visited: Visited,
    /// Standard deviation of 100 s means of the compensated rate in the training data, deg/h (0: not stated).
    pub train_rms_dph: f32,
    /// The same on a run that the fit never saw, deg/h (0: not measured).
    pub verify_rms_dph: f32,
}

/// One effect of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectTerm {
    /// Number of the effect.
    pub id: u16,
    /// Inner parameters, common to the axes.
    pub parameters: [f32; MAX_PARAMETERS],
    /// Place on its path at the unit's start, for an effect that remembers the path: see [`crate::effects::Effect::start_on`].
    pub start: f32,
    /// Gain of each regressor on each axis, deg/h per unit of the regressor.
    pub gains: [[f32; MAX_OUTPUTS]; AXES],
    /// Standard deviations of the gains.
    pub gain_std: [[f32; MAX_OUTPUTS]; AXES],
    /// Gains of each direction of the [`Uncertainty`] on each axis, deg/h per unit of the regressor.
    pub directions: [[[Half; MAX_OUTPUTS]; AXES]; DIRECTIONS],
}

impl EffectTerm {
    /// An effect whose gains are all zero.
    #[must_use]
    pub const fn new(id: u16, parameters: [f32; MAX_PARAMETERS]) -> Self {
        Self {
            id,
            parameters,
            start: 0.0,
            gains: [[0.0; MAX_OUTPUTS]; AXES],
            gain_std: [[0.0; MAX_OUTPUTS]; AXES],
            directions: [[[Half::ZERO; MAX_OUTPUTS]; AXES]; DIRECTIONS],
        }
    }
}

/// A calibration: all that makes a unit's numbers that unit's.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Name of the unit.
    pub unit: UnitName,
    /// Time at which it was made, seconds since 1970 (0: the compiled-in default).
    pub created_unix_s: u32,
    /// Counts up with each image burnt; the newest valid image wins.
    pub sequence: u32,
    /// CRC-32 of the recordings that made it.
    pub data_crc32: u32,
    /// False for the compiled-in default: rates are flagged uncalibrated.
    pub calibrated: bool,
    /// Centre and scale of the bias model.
    pub scaling: Scaling,
    /// The axes.
    pub axes: [Axis; AXES],
    /// Effects beyond the baseline.
    pub effects: Vec<EffectTerm, MAX_EFFECTS>,
    /// Errors of the accelerometers, for the align mode.
    pub accelerometers: Accelerometers,
    /// Scale factor and misalignment over temperature; `None`: the constant scale factors alone, and the unit matrix.
    pub rates: Option<[RateAxis; AXES]>,
    /// Inputs beside the frequencies that its effects need.
    pub inputs: InputTable,
    /// The accelerometers over temperature; `None`: without errors.
    pub specific_force: Option<[Accelerometer; AXES]>,
}

/// Why an image was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ImageError {
    /// The flash is erased (or there is nothing at all).
    NoImage,
    /// It does not begin as an image does, and is not erased either.
    Foreign,
    /// It is of another version.
    Version(u8),
    /// It holds a part that this program does not know (the byte of its [`Parts`]).
    UnknownPart(u8),
    /// Its length is impossible, or more than there is.
    Length(u16),
    /// Its checksum does not match.
    Checksum,
    /// A number is NaN or infinite.
    NotFinite,
    /// A number is impossible for a gyro (which: see the name).
    Absurd(&'static str),
    /// Its bias model is of a kind that this firmware does not know.
    UnknownModel(u8),
    /// It holds an effect that this firmware does not know.
    UnknownEffect(u16),
    /// It holds an effect that this unit cannot compute.
    NotOnUnit(u16),
    /// It needs an input that does not come in to this unit, or that it does not describe (the number in [`crate::inputs::NAMES`]).
    LacksInput(u8),
    /// It has no signature by the key of this firmware ([`crate::signature`]).
    Signature,
}

impl core::fmt::Display for ImageError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoImage => write!(f, "there is no calibration image"),
            Self::Foreign => write!(f, "what is there does not begin as a calibration image does"),
            Self::Version(v) => {
                write!(f, "the image is of version {v}, this program reads version {VERSION}")
            }
            Self::UnknownPart(bits) => {
                write!(f, "the image holds a part that this program does not know (parts {bits:#010b})")
            }
            Self::Length(n) => write!(f, "the image's length of {n} bytes is impossible"),
            Self::Checksum => write!(f, "the image's checksum does not match its content"),
            Self::NotFinite => write!(f, "the image holds a number that is not finite"),
            Self::Absurd(what) => write!(f, "the image's {what} is impossible"),
            Self::UnknownModel(kind) => {
                write!(f, "the image's bias model is of kind {kind}, which this program does not know")
            }
            Self::UnknownEffect(id) => {
                write!(f, "the image holds effect number {id}, which this program does not know")
            }
            Self::NotOnUnit(id) => write!(f, "the image holds effect number {id}, which a unit cannot compute"),
            Self::LacksInput(number) => {
                let name = inputs::NAMES.get(usize::from(*number)).unwrap_or(&"of an unknown number");
                write!(f, "the image needs the input {name}, which this unit does not have")
            }
            Self::Signature => write!(f, "the image is not signed with the key of this firmware"),
        }
    }
}

impl core::error::Error for ImageError {}

impl Calibration {
    /// `UNCALIBRATED` where it holds no bias of an axis: no coefficient, and no gain of an effect. An image that was learnt from one gyro says
    /// nothing of the others.
    #[must_use]
    pub fn status_of(&self, axis: usize) -> AxisStatus {
        let none = |k: &[f32]| k.iter().all(|k| *k == 0.0);
        let base = |a: &Axis| !matches!(&a.coefficients, Coefficients::One(k) if none(k));
        let gains = |t: &EffectTerm| t.gains.get(axis).is_some_and(|g| !none(g));
        if self.calibrated && (self.axes.get(axis).is_some_and(base) || self.effects.iter().any(gains)) {
            AxisStatus::empty()
        } else {
            AxisStatus::UNCALIBRATED
        }
    }

    /// Calibration of a unit that was never calibrated: the frequency curves of dong2023's Table 1 and no bias.
    ///
    /// The curves are the centred cubic fits of that table on its sensors at the case; `hrg fit points
    /// host-tests/recordings/dong2023-table1.csv` prints them and a host test compares.
    #[must_use]
    pub fn uncalibrated() -> Self {
        let curve = |frequency_centre_hz, frequency_scale_hz, temperature_coefficients_c, valid_from_c, valid_to_c| {
            TemperatureCurve {
                frequency_centre_hz,
                frequency_scale_hz,
                temperature_coefficients_c,
                valid_from_c,
                valid_to_c,
            }
        };
        let curves = [
            curve(4900.0, 21.152, [9.218_105, 44.580_624, 1.161_163_1, 0.166_985_72], -34.374, 55.128),
            curve(4891.9745, 20.227_5, [7.768_591_4, 44.597_454, 1.129_869, 0.170_522_93], -35.865, 53.673),
            curve(4703.596, 19.444, [7.809_050_6, 44.658_787, 1.113_637_7, 0.114_508_46], -35.849, 53.708),
        ];
        Self {
            unit: UnitName::UNNAMED,
            created_unix_s: 0,
            sequence: 0,
            data_crc32: 0,
            calibrated: false,
            scaling: Scaling {
                t_ref_c: 10.0,
                t_scale_c: 45.0,
                linear_below_c: -45.0,
                linear_above_c: 65.0,
                linear_beyond_c_per_min: 10.0,
                blend_band_c_per_min: 0.1,
            },
            axes: curves.map(|curve| Axis {
                curve,
                scale_factor_dph_per_code: DEFAULT_SCALE_FACTOR,
                valid_from_c_per_min: -10.0,
                valid_to_c_per_min: 10.0,
                coefficients: Coefficients::One([0.0; TERMS]),
                bias_std_dph: [[0.0; TERMS]; 2],
                uncertainty: Uncertainty::default(),
                visited: Visited::default(),
                train_rms_dph: 0.0,
                verify_rms_dph: 0.0,
            }),
            effects: Vec::new(),
            accelerometers: Accelerometers::IDEAL,
            rates: None,
            inputs: InputTable::new(),
            specific_force: None,
        }
    }

    /// The unit's name as text.
    #[must_use]
    pub fn unit_name(&self) -> &str {
        self.unit.as_str()
    }

    /// Scale factor of each axis, deg/h per code.
    #[must_use]
    pub fn scale_factors_dph_per_code(&self) -> [f32; AXES] {
        let [x, y, z] = &self.axes;
        [x.scale_factor_dph_per_code, y.scale_factor_dph_per_code, z.scale_factor_dph_per_code]
    }

    /// Checks that every input that the effects need comes in to a unit that has these.
    ///
    /// # Errors
    /// The first that does not.
    pub fn inputs_among(&self, unit: QuantitySet) -> Result<(), ImageError> {
        let lacking = inputs::needed(self).difference(unit).numbers().next();
        lacking.map_or(Ok(()), |number| Err(ImageError::LacksInput(number)))
    }

    /// Sets the name, as [`UnitName::new`] takes it.
    pub fn set_unit_name(&mut self, name: &str) {
        self.unit = UnitName::new(name);
    }
}

/// Scale factor of a unit that was never calibrated: 20 deg/s at the end of 24 bits.
pub const DEFAULT_SCALE_FACTOR: f32 = 72_000.0 / 8_388_608.0;

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::bias::four_parameter::FourParameter;
    use crate::bytes::crc32;
    use crate::effects::shape;
    use crate::effects::EffectId;
    use proptest::prelude::*;

    pub(crate) fn full() -> Calibration {
        let mut c = Calibration::uncalibrated();
        c.set_unit_name("HRG-101");
        c.sequence = 7;
        c.axes[1].coefficients = Coefficients::CoolingHeating([1.5; TERMS], [-2.5e-3; TERMS]);
        for id in [4u16, 6, 3] {
            let outputs = shape(id).expect("in the list").outputs;
            let mut e = EffectTerm::new(id, [600.0, 1.0]);
            for g in &mut e.gains {
                g[..outputs].fill(0.125);
            }
            c.effects.push(e).expect("room");
        }
        c
    }

    /// With two directions of uncertainty.
    pub(crate) fn uncertain() -> Calibration {
        let mut c = full();
        for a in &mut c.axes {
            a.uncertainty.rest_dph2 = 0.25;
            a.uncertainty.baseline[0] = [0.5; TERMS];
        }
        for e in &mut c.effects {
            let outputs = shape(e.id).expect("in the list").outputs;
            e.directions[1][2][..outputs].fill(Half::of(-0.125));
        }
        c
    }

    /// With scale factors and misalignments over temperature.
    pub(crate) fn of_rates() -> Calibration {
        let axis = RateAxis {
            rate_valid_from_c: -40.0,
            rate_valid_to_c: 60.0,
            rate_valid_from_c_per_min: -1.5,
            rate_valid_to_c_per_min: 1.5,
            scale_correction_ppm: [100.0, -50.0, 25.0, 12.5, -6.25, 3.125],
            scale_std_ppm: [1.0, 1.0, 2.0, 2.0, 0.5],
            misalignment_urad: [[300.0, -200.0], [-1.5, 2.5]],
            misalignment_std_urad: [[0.5; 2]; 2],
        };
        Calibration { rates: Some([axis; AXES]), ..full() }
    }

    fn others() -> Calibration {
        let mut c = full();
        let m = FourParameter {
            constant_cooling_heating_low_high: [1.0, 2.0, 3.0, 4.0, 5.0],
            breakpoint_c: 12.5,
            origin_c: -3.0,
        };
        c.axes[0].coefficients = Coefficients::FourParameter(m);
        c.axes[1].coefficients = Coefficients::Direct([0.5; 7]);
        c.axes[2].coefficients = Coefficients::Network([-1.25; 16]);
        c
    }

    #[test]
    fn there_and_back() {
        let mut platform = full();
        platform.accelerometers = Accelerometers { bias_mps2: [1e-4, -2e-4], matrix: [[1.01, 0.002], [0.0, 0.99]] };
        let both = Calibration { accelerometers: platform.accelerometers, ..of_rates() };
        for c in [Calibration::uncalibrated(), full(), others(), uncertain(), platform, of_rates(), both] {
            let bytes = c.to_bytes().expect("fits");
            assert_eq!(Calibration::from_bytes(&bytes), Ok(c.clone()));
            let mut sector = [0xFFu8; 4096];
            sector[..bytes.len()].copy_from_slice(&bytes);
            assert_eq!(Calibration::from_bytes(&sector), Ok(c));
        }
    }

    #[test]
    fn the_largest_image_fits() {
        let mut c = of_rates();
        c.effects.clear();
        for axis in &mut c.axes {
            // The longest of all.
            axis.coefficients = Coefficients::Network([1.0; 16]);
        }
        for _ in 0..MAX_EFFECTS {
            c.effects
                .push(EffectTerm {
                    gains: [[1.0; MAX_OUTPUTS]; 3],
                    gain_std: [[1.0; MAX_OUTPUTS]; 3],
                    directions: [[[Half::of(1.0); MAX_OUTPUTS]; 3]; DIRECTIONS],
                    ..EffectTerm::new(3, [0.0; 2])
                })
                .expect("room");
        }
        assert!(c.to_bytes().is_some());
    }

    #[test]
    fn each_defect_has_its_error() {
        let good = full().to_bytes().expect("fits");
        assert_eq!(Calibration::from_bytes(&[]), Err(ImageError::NoImage));
        assert_eq!(Calibration::from_bytes(&[0xFF; 64]), Err(ImageError::NoImage));
        let mut b = good.clone();
        b[4] = 9;
        assert_eq!(Calibration::from_bytes(&b), Err(ImageError::Version(9)));
        assert_eq!(Calibration::from_bytes(&good[..good.len() - 1]), Err(ImageError::Length(good.len() as u16)));
        let mut b = good.clone();
        b[40] ^= 1;
        assert_eq!(Calibration::from_bytes(&b), Err(ImageError::Checksum));
        let refused = |edit: &dyn Fn(&mut Calibration)| {
            let mut c = full();
            edit(&mut c);
            Calibration::from_bytes(&c.to_bytes().expect("fits")).expect_err("must be refused")
        };
        assert_eq!(refused(&|c| c.scaling.t_ref_c = f32::NAN), ImageError::NotFinite);
        assert_eq!(refused(&|c| c.axes[2].curve.frequency_centre_hz = f64::INFINITY), ImageError::NotFinite);
        assert_eq!(refused(&|c| c.axes[0].scale_factor_dph_per_code = 0.0), ImageError::Absurd("scale factor"));
        assert_eq!(refused(&|c| c.axes[0].curve.frequency_centre_hz = 3.0), ImageError::Absurd("centre frequency"));
        let sensor = |c: &mut Calibration, centre: f32| {
            c.axes[0].curve = TemperatureCurve {
                frequency_centre_hz: f64::from(centre),
                frequency_scale_hz: 46.0,
                temperature_coefficients_c: [centre, 46.0, 0.0, 0.0],
                ..c.axes[0].curve
            };
        };
        assert_eq!(refused(&|c| sensor(c, 600.0)), ImageError::Absurd("centre frequency"));
        let mut c = full();
        sensor(&mut c, 28.0);
        assert_eq!(Calibration::from_bytes(&c.to_bytes().expect("fits")).as_ref(), Ok(&c));
        assert_eq!(refused(&|c| c.effects[0].gains[0][0] = 1e9), ImageError::Absurd("coefficient"));
        let swapped = |c: &mut Calibration| c.accelerometers.matrix = [[0.0, 1.0], [1.0, 0.0]];
        assert_eq!(refused(&swapped), ImageError::Absurd("accelerometers"));
        for variance in [f32::NAN, -1.0, 1e15] {
            assert_eq!(refused(&|c| c.axes[1].uncertainty.rest_dph2 = variance), ImageError::Absurd("variance"));
            assert_eq!(refused(&|c| c.axes[1].visited.unvisited_dph2 = variance), ImageError::Absurd("variance"));
        }
        // (A constant that moves by ten thousand deg/h is none of a good gyro, and one all the same.)
        let mut c = uncertain();
        c.axes[1].uncertainty.rest_dph2 = 1e8;
        assert_eq!(Calibration::from_bytes(&c.to_bytes().expect("fits")).as_ref(), Ok(&c));
        assert_eq!(refused(&|c| c.effects[0].id = 11), ImageError::NotOnUnit(11));
        for (effect, parameters) in [
            (EffectId::Hysteresis, [-10.0, 0.0]),
            (EffectId::PlayLadder, [1.0, 0.0]),
            (EffectId::ThermalLag, [0.0, 0.0]),
            (EffectId::LagLadder, [-60.0, 6000.0]),
            (EffectId::ArrheniusLadder, [0.02, -1.0]),
            (EffectId::WarmUp, [-1800.0, 0.0]),
        ] {
            let e = refused(&|c| (c.effects[0].id, c.effects[0].parameters) = (effect.facts().id, parameters));
            assert_eq!(e, ImageError::Absurd("width or time constant of an effect"), "{effect:?}");
        }
        let nan = |c: &mut Calibration| c.axes[1].coefficients = Coefficients::Network([f32::NAN; 16]);
        assert_eq!(refused(&nan), ImageError::NotFinite);
        let rates = |edit: fn(&mut RateAxis)| {
            refused(&|c: &mut Calibration| {
                *c = of_rates();
                if let Some(r) = c.rates.as_mut() {
                    edit(&mut r[1]);
                }
            })
        };
        assert_eq!(rates(|r| r.scale_correction_ppm[2] = f32::NAN), ImageError::NotFinite);
        assert_eq!(rates(|r| r.scale_correction_ppm[0] = 60_000.0), ImageError::Absurd("scale factor"));
        assert_eq!(rates(|r| r.misalignment_urad[1][0] = -60_000.0), ImageError::Absurd("misalignment"));
        assert_eq!(rates(|r| r.rate_valid_to_c = -41.0), ImageError::Absurd("temperature range"));
        assert_eq!(rates(|r| r.rate_valid_to_c_per_min = -2.0), ImageError::Absurd("range of the rate of change"));
    }

    #[test]
    fn a_newer_program_reads_older_images_and_an_older_one_refuses_newer() {
        let good = full().to_bytes().expect("fits");
        for newest in VERSION..VERSION + 3 {
            assert_eq!(Calibration::from_bytes_up_to(newest, &good), Ok(full()), "newest {newest}");
        }
        let with = |at: usize, value: u8| {
            let mut image = good.clone();
            image[at] = value;
            let end = image.len() - 4;
            let crc = crc32(&image[..end]).to_le_bytes();
            image[end..].copy_from_slice(&crc);
            Calibration::from_bytes(&image)
        };
        // The same image with the number of a version to come, of none, and with a part to come.
        assert_eq!(with(4, VERSION + 1), Err(ImageError::Version(VERSION + 1)));
        assert_eq!(with(4, OLDEST - 1), Err(ImageError::Version(OLDEST - 1)));
        let to_come = Parts::all().bits() + 1;
        assert_eq!(with(5, to_come), Err(ImageError::UnknownPart(to_come)));
        // It names a part that it does not hold.
        assert!(matches!(with(5, Parts::RATES.bits()), Err(ImageError::Length(_))));
    }

    #[test]
    fn every_single_flipped_bit_is_found() {
        let good = full().to_bytes().expect("fits");
        for bit in 0..good.len() * 8 {
            let mut b = good.clone();
            b[bit / 8] ^= 1 << (bit % 8);
            assert!(Calibration::from_bytes(&b).is_err(), "bit {bit}");
        }
    }

    proptest! {
        #[test]
        fn garbage_is_refused_not_panicked_on(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let mut b = MAGIC.to_vec();
            b.extend([1, 0]);
            b.extend(bytes);
            prop_assert!(Calibration::from_bytes(&b).is_err());
        }
    }
}
