//! Checks of a calibration's numbers: each is finite and within the limits of a gyro.

use super::{Calibration, EffectTerm, ImageError};
use crate::bias::Coefficients;
use crate::effects::shape;
use crate::inputs::{Input, QuantitySet, QUANTITIES};
use crate::rate_factors::{RateAxis, MOST_PPM};

/// Any coefficient beyond this is not one of a gyro (deg/h, C, Hz and their ratios).
const ABSURD: f32 = 1e7;
/// Any variance of a bias beyond this is not one of a gyro, (deg/h)^2.
const ABSURD_SQUARE: f32 = ABSURD * ABSURD;

impl Calibration {
    /// Checks that every number is finite and possible, and every effect one that a unit can compute.
    ///
    /// # Errors
    /// The first defect found.
    pub fn check(&self) -> Result<(), ImageError> {
        let s = &self.scaling;
        finite(&[
            s.t_ref_c,
            s.t_scale_c,
            s.linear_below_c,
            s.linear_above_c,
            s.linear_beyond_c_per_min,
            s.blend_band_c_per_min,
        ])?;
        let possible = |ok: bool, what| {
            if ok {
                Ok(())
            } else {
                Err(ImageError::Absurd(what))
            }
        };
        possible(s.t_ref_c.abs() <= 300.0, "reference temperature")?;
        possible((0.1..=1000.0).contains(&s.t_scale_c), "temperature scale")?;
        possible(s.linear_below_c < s.linear_above_c, "temperature range")?;
        possible(s.linear_beyond_c_per_min > 0.0, "range of the rate of change")?;
        possible(s.blend_band_c_per_min >= 0.0, "blend band")?;
        for a in &self.axes {
            if !a.curve.frequency_centre_hz.is_finite() {
                return Err(ImageError::NotFinite);
            }
            finite(&a.curve.temperature_coefficients_c)?;
            finite(&[
                a.curve.frequency_scale_hz,
                a.curve.valid_from_c,
                a.curve.valid_to_c,
                a.scale_factor_dph_per_code,
                a.train_rms_dph,
                a.verify_rms_dph,
            ])?;
            finite(&[a.valid_from_c_per_min, a.valid_to_c_per_min])?;
            finite(&a.bias_std_dph[0])?;
            finite(&a.bias_std_dph[1])?;
            finite(a.uncertainty.baseline.as_flattened())?;
            let variances = [a.uncertainty.rest_dph2, a.visited.unvisited_dph2];
            possible(variances.iter().all(|v| (0.0..=ABSURD_SQUARE).contains(v)), "variance")?;
            match &a.coefficients {
                Coefficients::One(k) => finite(k)?,
                Coefficients::CoolingHeating(c, h) => {
                    finite(c)?;
                    finite(h)?;
                }
                Coefficients::FourParameter(m) => {
                    finite(&m.constant_cooling_heating_low_high)?;
                    finite(&[m.breakpoint_c, m.origin_c])?;
                }
                Coefficients::Direct(k) => finite(k)?,
                Coefficients::Network(w) => finite(w)?,
            }
            let centres = if a.curve.is_of_sensor() { -273.15..=500.0 } else { 100.0..=100_000.0 };
            possible(centres.contains(&a.curve.frequency_centre_hz), "centre frequency")?;
            possible((1e-3..=1e4).contains(&a.curve.frequency_scale_hz), "frequency scale")?;
            possible(
                a.curve.valid_from_c < a.curve.valid_to_c
                    && a.curve.valid_from_c >= -273.15
                    && a.curve.valid_to_c <= 500.0,
                "temperature range",
            )?;
            possible(a.scale_factor_dph_per_code != 0.0, "scale factor")?;
            possible(a.valid_from_c_per_min <= a.valid_to_c_per_min, "range of the rate of change")?;
        }
        possible(self.accelerometers.possible(), "accelerometers")?;
        self.rates.iter().flatten().try_for_each(RateAxis::check)?;
        for one in self.specific_force.iter().flatten() {
            possible(one.possible(), "accelerometers")?;
            one.errors.check()?;
        }
        self.effects.iter().try_for_each(EffectTerm::check)?;
        self.inputs.iter().try_for_each(Input::check)?;
        let described = self.inputs.iter().map(|i| QuantitySet::one(i.quantity));
        self.inputs_among(described.collect())
    }
}

impl Input {
    /// Checks that the input is one that there is, with a range about its reference.
    fn check(&self) -> Result<(), ImageError> {
        let numbers = [self.reference, self.scale, self.valid_from, self.valid_to];
        if !numbers.iter().all(|v| v.is_finite()) {
            return Err(ImageError::NotFinite);
        }
        finite(&self.without_dph)?;
        finite(self.expected.as_flattened())?;
        let ordered = self.valid_from <= self.reference && self.reference <= self.valid_to;
        if usize::from(self.quantity) >= QUANTITIES
            || !ordered
            || self.without_dph.iter().any(|s| *s < 0.0)
            || !(self.scale > 0.0)
            || self.counts_s == 0
        {
            return Err(ImageError::Absurd("input"));
        }
        Ok(())
    }
}

impl RateAxis {
    /// Checks that the axis' numbers are those of a gyro.
    fn check(&self) -> Result<(), ImageError> {
        self.numbers().try_for_each(|v| finite(&[v]))?;
        let small = |values: &[f32]| values.iter().all(|v| v.abs() <= MOST_PPM);
        let checks = [
            (small(&self.scale_correction_ppm), "scale factor"),
            (small(self.misalignment_urad.as_flattened()), "misalignment"),
            (self.rate_valid_from_c < self.rate_valid_to_c, "temperature range"),
            (self.rate_valid_from_c_per_min <= self.rate_valid_to_c_per_min, "range of the rate of change"),
        ];
        checks.into_iter().find(|(ok, _)| !ok).map_or(Ok(()), |(_, what)| Err(ImageError::Absurd(what)))
    }
}

impl EffectTerm {
    /// Checks that the effect's numbers are possible, and that a unit can compute it.
    fn check(&self) -> Result<(), ImageError> {
        finite(&self.parameters)?;
        if self.start.abs() > 1.0 || self.start.is_nan() {
            return Err(ImageError::Absurd("start of an effect"));
        }
        for row in self.gains.iter().chain(&self.gain_std) {
            finite(row)?;
        }
        for gain in self.directions.as_flattened().as_flattened() {
            finite(&[gain.value()])?;
        }
        match shape(self.id) {
            None => Err(ImageError::UnknownEffect(self.id)),
            Some(s) if !s.on_unit => Err(ImageError::NotOnUnit(self.id)),
            // (A play of negative width would jump each second.)
            Some(s) if s.positive.iter().zip(&self.parameters).any(|(wanted, v)| *wanted && !(*v > 0.0)) => {
                Err(ImageError::Absurd("width or time constant of an effect"))
            }
            Some(_) => Ok(()),
        }
    }
}

fn finite(values: &[f32]) -> Result<(), ImageError> {
    for v in values {
        if !v.is_finite() {
            return Err(ImageError::NotFinite);
        }
        if v.abs() > ABSURD {
            return Err(ImageError::Absurd("coefficient"));
        }
    }
    Ok(())
}
