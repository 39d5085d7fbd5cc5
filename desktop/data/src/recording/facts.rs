//! Facts that a user states of a unit beside its recordings: its name, its attitude, its scale factor. Also tests if recordings and a
//! calibration image agree about them.

use crate::error::BadInput;
use crate::recording::metadata::{same_scale, scale_text, Attitude, EARTH_RATE_DPH, SCALE_FACTOR};
use crate::recording::names;
use crate::recording::Recording;
use hrg_core::calibration::{Calibration, DEFAULT_SCALE_FACTOR};
use hrg_core::AXES;

/// Why what was given cannot be used with a recording, or a recording not with an image.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Disagreement {
    /// Two names.
    #[error("the recording is of unit {recording}, not of {stated}; check which is meant")]
    Unit {
        /// In the recording.
        recording: String,
        /// Elsewhere.
        stated: String,
    },
    /// The image is of another unit than the recording.
    #[error("the recording is of unit {recording}, the calibration of {image}; take the calibration of that unit")]
    ImageUnit {
        /// In the recording.
        recording: String,
        /// In the image.
        image: String,
    },
    /// Two attitudes.
    #[error("the recording says latitude {0} and axes {1}; leave --latitude and --axes out, or correct the file")]
    Attitude(String, String),
    /// An attitude for rates that are free of the earth's rate.
    #[error("the recording says that the earth's rate is removed already; leave --latitude and --axes out")]
    EarthRateTwice,
    /// The recording was made with another scale factor than the image has.
    #[error("the recording was made with the scale factor {recording} deg/h per code (x y z), the calibration has {image}; {advice}")]
    Scale {
        /// In the recording.
        recording: String,
        /// In the image.
        image: String,
        /// Advice to the user.
        advice: &'static str,
    },
    /// Two recordings were made with different scale factors.
    #[error("two recordings were made with different scale factors, {0} and {1} deg/h per code (x y z); give --scale-factor X,Y,Z to bring the rates of both to one")]
    Scales(String, String),
    /// Frequencies for an image of sensors, or the other way.
    #[error("the recording's thermometers are {recording}, those of the calibration {image}; take a calibration that was fitted to recordings of this kind")]
    Thermometer {
        /// In the recording.
        recording: &'static str,
        /// In the image.
        image: &'static str,
    },
    /// The earth's rate is off some rates and not off others.
    #[error("some of the recordings tell latitude and axes, so that the earth's rate is taken off, and others do not; add them to the others, or give --latitude and --axes")]
    EarthRate,
}

impl From<Disagreement> for BadInput {
    fn from(e: Disagreement) -> Self {
        Self(e.to_string())
    }
}

/// Facts that a user states beside the recordings.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Facts {
    /// Name of the unit.
    pub unit: Option<String>,
    /// Attitude while it was recorded.
    pub attitude: Option<Attitude>,
    /// Scale factor of its rate channels, deg/h per code.
    pub scale_factor: Option<[f32; AXES]>,
    /// A calibration whose name and scale factor hold on.
    pub base: Option<Calibration>,
}

impl Facts {
    /// Adds what is given to a recording that does not state it. Rates that were made with another scale factor than the one given
    /// are converted, and a note says so.
    ///
    /// # Errors
    /// If the recording contradicts them.
    pub fn apply(&self, r: &mut Recording) -> Result<(), BadInput> {
        for name in self.unit.as_deref().into_iter().chain(self.base.as_ref().and_then(names::of)) {
            if r.unit() == names::NONE {
                r.set_meta("unit", name);
            } else if names::kept(r.unit()) != name {
                return Err(Disagreement::Unit { recording: r.unit().into(), stated: name.into() }.into());
            }
        }
        if let (Some(_), Some(what)) = (&self.attitude, r.stands_for()) {
            return Err(BadInput(format!("the recording holds {what} in the place of rates, without the earth's rate: leave --latitude and --axes out")));
        }
        if let Some(attitude) = &self.attitude {
            match Attitude::of(r.meta("latitude_deg"), r.meta("axes"))? {
                Some(own) if own.agrees_with(attitude) => {}
                Some(own) => {
                    return Err(Disagreement::Attitude(own.latitude_deg.to_string(), own.axes_text()).into());
                }
                None if r.without_earth_rate() => return Err(Disagreement::EarthRateTwice.into()),
                None => {
                    r.set_meta("latitude_deg", &attitude.latitude_deg.to_string());
                    r.set_meta("axes", &attitude.axes_text());
                }
            }
        }
        self.scale(r)
    }

    fn scale(&self, r: &mut Recording) -> Result<(), BadInput> {
        let own = r.scale_factor();
        let base = self.base.as_ref().map(Calibration::scale_factors_dph_per_code);
        if let (None, Some(own), Some(base)) = (self.scale_factor, own, base) {
            if !same_scale(&own, &base) {
                let advice = "give the right one with --scale-factor X,Y,Z: the rates are then converted";
                return Err(
                    Disagreement::Scale { recording: scale_text(&own), image: scale_text(&base), advice }.into()
                );
            }
        }
        let Some(scale) = self.scale_factor.or(base) else { return Ok(()) };
        if let Some(own) = own.filter(|own| !same_scale(own, &scale)) {
            for (column, (new, old)) in r.rate_dph.iter_mut().zip(scale.iter().zip(own)) {
                let ratio = f64::from(*new) / f64::from(old);
                column.iter_mut().for_each(|v| *v *= ratio);
            }
            r.notes.push(format!(
                "the rates were made with the scale factor {} deg/h per code (x y z) and are converted to {}",
                scale_text(&own),
                scale_text(&scale)
            ));
        }
        r.set_meta(SCALE_FACTOR, &scale_text(&scale));
        Ok(())
    }
}

/// Facts that recordings used together have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreed {
    /// Scale factor that made their rates, deg/h per code; the default where none of them tells.
    pub scale_factor: [f32; AXES],
    /// Notes on unknown facts.
    pub notes: Vec<String>,
}

/// Checks that recordings may be used together.
///
/// # Errors
/// [`Disagreement`] of scale factors, or of what was done about the earth's rate.
pub fn agree(recordings: &[&Recording]) -> Result<Agreed, Disagreement> {
    let all = || recordings.iter().copied();
    let mut notes = Vec::new();
    let mut scales = all().filter_map(Recording::scale_factor);
    let first = scales.next();
    if let Some((a, b)) = first.and_then(|a| scales.find(|b| !same_scale(&a, b)).map(|b| (a, b))) {
        return Err(Disagreement::Scales(scale_text(&a), scale_text(&b)));
    }
    let untold = all().filter(|r| r.scale_factor().is_none()).count();
    if first.is_none() && all().all(|r| r.stands_for().is_none()) {
        notes.push(format!(
            "no scale factor is known: the default of 20 deg/s at 2^23 codes ({DEFAULT_SCALE_FACTOR} deg/h per code) is assumed; give the unit's own with --scale-factor X,Y,Z or --base OLD.toml"
        ));
    } else if first.is_some() && untold > 0 {
        notes.push(format!("{untold} of the recordings do not tell their scale factor: that of the others is assumed"));
    }
    match (all().any(Recording::without_earth_rate), all().all(Recording::without_earth_rate)) {
        (true, false) => return Err(Disagreement::EarthRate),
        // (An oscillator does not turn with the earth.)
        (false, _) if all().any(|r| r.stands_for().is_some()) => {}
        (false, _) => notes.push(format!(
            "latitude and axes are not known: each axis' constant k0 holds its part of the earth's rate, up to {EARTH_RATE_DPH:.2} deg/h, beside the gyro's own bias; give --latitude and --axes"
        )),
        (true, true) => {}
    }
    if all().any(|r| r.unit() == names::NONE) {
        notes.push(if all().count() > 1 {
            "a recording names no unit: nothing shows that all are of one; name it with --unit NAME".into()
        } else {
            "the recording names no unit, and so the calibration is of none; name it with --unit NAME".into()
        });
    }
    Ok(Agreed { scale_factor: first.unwrap_or([DEFAULT_SCALE_FACTOR; AXES]), notes })
}

/// Checks that a calibration image may be used on a recording; unknown facts come back as notes.
///
/// # Errors
/// [`Disagreement`] of names (unless `different_units`), or of scale factors.
pub fn fits(c: &Calibration, r: &Recording, different_units: bool) -> Result<Vec<String>, Disagreement> {
    let mut notes = Vec::new();
    let kind = |sensor: bool| if sensor { "sensors" } else { "resonators" };
    if let Some(a) = r.present().find(|&a| c.axes[a].curve.is_of_sensor() != r.thermometer.is_sensor()) {
        let image = kind(c.axes[a].curve.is_of_sensor());
        return Err(Disagreement::Thermometer { recording: kind(r.thermometer.is_sensor()), image });
    }
    match names::of(c) {
        Some(image) if r.unit() != names::NONE => {
            if image != names::kept(r.unit()) && !different_units {
                return Err(Disagreement::ImageUnit { recording: r.unit().into(), image: image.into() });
            }
        }
        _ => {
            notes
                .push("the recording or the calibration names no unit: nothing shows that they belong together".into());
        }
    }
    let image = c.scale_factors_dph_per_code();
    match r.scale_factor() {
        Some(own) if !same_scale(&own, &image) => {
            return Err(Disagreement::Scale {
                recording: scale_text(&own),
                image: scale_text(&image),
                advice: "its biases belong to rates of that scale: fit the recording anew, or take the calibration that the unit had",
            })
        }
        Some(_) => {}
        None => notes.push("the recording has no scale factor: that of the calibration is used".into()),
    }
    Ok(notes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(meta: &[(&str, &str)]) -> Recording {
        let mut r = Recording { rate_dph: [vec![1.0], vec![2.0], vec![4.0]], ..Recording::default() };
        meta.iter().for_each(|(k, v)| r.set_meta(k, v));
        r
    }

    #[test]
    fn given_metadata_are_added_or_refused() {
        let attitude = Attitude::of(Some("30"), Some("x=north y=east z=down")).expect("fine");
        let stated = Facts { unit: Some("HRG-7".into()), attitude, ..Facts::default() };
        let mut r = recording(&[("unit", "default")]);
        stated.apply(&mut r).expect("all of it is new");
        assert_eq!((r.unit(), r.meta("latitude_deg")), ("HRG-7", Some("30")));
        stated.apply(&mut r).expect("the same again");
        let e = stated.apply(&mut recording(&[("unit", "HRG-8")])).expect_err("refused").0;
        assert!(e.contains("HRG-8") && e.contains("HRG-7"), "{e}");
        let other = [("latitude_deg", "31"), ("axes", "x=north y=east z=down")];
        assert!(stated.apply(&mut recording(&other)).expect_err("refused").0.contains("latitude 31"));
        assert!(stated.apply(&mut recording(&[("earth_rate", "removed")])).expect_err("refused").0.contains("already"));
    }

    #[test]
    fn a_scale_factor_that_is_given_converts_and_one_that_is_kept_must_agree() {
        let mut r = recording(&[(SCALE_FACTOR, "0.01 0.01 0.01")]);
        Facts { scale_factor: Some([0.02, 0.01, -0.01]), ..Facts::default() }.apply(&mut r).expect("converted");
        let [x, y, z] = &r.rate_dph;
        assert!((x[0] - 2.0).abs() < 1e-6 && y[0] == 2.0 && z[0] == -4.0, "{:?}", r.rate_dph);
        assert_eq!((r.scale_factor(), r.notes.len()), (Some([0.02, 0.01, -0.01]), 1));
        let mut base = Calibration::uncalibrated();
        base.axes.iter_mut().for_each(|a| a.scale_factor_dph_per_code = 0.03);
        let stated = Facts { base: Some(base.clone()), ..Facts::default() };
        let e = stated.apply(&mut recording(&[(SCALE_FACTOR, "0.01 0.01 0.01")])).expect_err("refused").0;
        assert!(e.contains("0.01 0.01 0.01") && e.contains("0.03 0.03 0.03"), "{e}");
        let mut r = recording(&[]);
        stated.apply(&mut r).expect("taken over");
        assert_eq!((r.scale_factor(), r.rate_dph[0][0]), (Some([0.03; 3]), 1.0));
        assert!(matches!(fits(&Calibration::uncalibrated(), &r, false), Err(Disagreement::Scale { .. })));
        assert_eq!(fits(&base, &r, false).map(|n| n.len()), Ok(1));
    }

    #[test]
    fn what_nobody_knows_is_noted_and_what_differs_refused() {
        let notes = agree(&[&recording(&[])]).expect("one agrees with itself").notes.join("\n");
        assert!(notes.contains("2^23") && notes.contains("15.04") && notes.contains("--unit"), "{notes}");
        let all = [("unit", "A"), ("earth_rate", "removed"), (SCALE_FACTOR, "0.01 0.01 0.01")];
        assert_eq!(agree(&[&recording(&all)]).expect("known").notes, Vec::<String>::new());
        let [mut a, b] = [recording(&all), recording(&all[..1])];
        assert_eq!(agree(&[&a, &b]), Err(Disagreement::EarthRate));
        a.set_meta(SCALE_FACTOR, "0.02 0.02 0.02");
        assert!(matches!(agree(&[&a, &recording(&all)]), Err(Disagreement::Scales(_, _))));
    }
}
