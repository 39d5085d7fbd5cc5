//! Polynomial fits of frequency and temperature, both ways.

use super::residual::{largest, residuals, rms, scaled};
use crate::thermometer::curve;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq::powers;
use serde::Serialize;

/// One polynomial fit.
#[derive(Debug, Clone, Serialize)]
pub struct PolyFit {
    /// Degree.
    pub degree: usize,
    /// Coefficients of the centred and scaled variable.
    pub coefficients: Vec<f64>,
    /// Residuals in C, in the order of the table.
    pub residuals_c: Vec<f64>,
    /// Root mean square of the residuals, C.
    pub rms_c: f64,
    /// Largest residual, C.
    pub max_c: f64,
    /// Root mean square of what each point is missed by when it is left out, C.
    pub leave_one_out_rms_c: f64,
}

/// Fits of one axis and reference.
#[derive(Debug, Clone, Serialize)]
pub struct AxisFits {
    /// `f(T)`, solved for T.
    pub forward: Vec<PolyFit>,
    /// `T(f)`.
    pub inverse: Vec<PolyFit>,
    /// Temperatures by the root of the forward cubic, C (the table's T3).
    pub root_c: Vec<f64>,
    /// Temperatures by the inverse cubic in the unit's f32, C (the table's T4).
    pub inverse_f32_c: Vec<f64>,
    /// Largest difference of f32 from f64 evaluation of the inverse cubic, C.
    pub f32_error_c: f64,
    /// Centre of the inverse cubic, Hz.
    pub centre_hz: f64,
    /// Scale of the inverse cubic, Hz.
    pub scale_hz: f64,
}

fn poly_fit(x: &[f64], y: &[f64], degree: usize, to_c: f64) -> Result<PolyFit, BadInput> {
    let (u, _, _) = scaled(x);
    let columns = powers(&u, degree);
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let centred: Vec<f64> = y.iter().map(|v| v - mean).collect();
    let fit = hrg_data::numeric::lsq::fit(&columns, &centred, None, &["1", "u", "u^2", "u^3"])?;
    let (e, left_out) = residuals(&columns, &centred);
    let e: Vec<f64> = e.iter().map(|v| v * to_c).collect();
    let left_out: Vec<f64> = left_out.iter().map(|v| v * to_c).collect();
    let mut coefficients = fit.coefficients;
    coefficients[0] += mean;
    Ok(PolyFit {
        degree,
        coefficients,
        rms_c: rms(&e),
        max_c: largest(&e),
        leave_one_out_rms_c: rms(&left_out),
        residuals_c: e,
    })
}

pub(super) fn axis_fits(temperature_c: &[f64], frequency_hz: &[f64]) -> Result<AxisFits, BadInput> {
    let n = temperature_c.len();
    let hz_per_c = (frequency_hz[n - 1] - frequency_hz[0]) / (temperature_c[n - 1] - temperature_c[0]);
    let forward_curve = curve::fit_forward(temperature_c, frequency_hz, 3)?;
    let inverse_curve = curve::fit_inverse(frequency_hz, temperature_c, None, 3)?;
    let inverse_f32_c: Vec<f64> = frequency_hz.iter().map(|f| f64::from(inverse_curve.temperature_c(*f))).collect();
    let c = inverse_curve.temperature_coefficients_c.map(f64::from);
    let f32_error_c = frequency_hz
        .iter()
        .zip(&inverse_f32_c)
        .map(|(f, t)| {
            let u = (f - inverse_curve.frequency_centre_hz) / f64::from(inverse_curve.frequency_scale_hz);
            (((c[3] * u + c[2]) * u + c[1]) * u + c[0] - t).abs()
        })
        .fold(0.0, f64::max);
    let root_c = frequency_hz
        .iter()
        .zip(&inverse_f32_c)
        .map(|(f, guess)| {
            forward_curve
                .root_c(*f, *guess)
                .ok_or_else(|| BadInput::new(format!("the forward cubic has no root at {f} Hz")))
        })
        .collect::<Result<_, _>>()?;
    let fits =
        |x: &[f64], y: &[f64], to_c: f64| (1..=3).map(|d| poly_fit(x, y, d, to_c)).collect::<Result<Vec<_>, _>>();
    Ok(AxisFits {
        forward: fits(temperature_c, frequency_hz, 1.0 / hz_per_c)?,
        inverse: fits(frequency_hz, temperature_c, 1.0)?,
        root_c,
        inverse_f32_c,
        f32_error_c,
        centre_hz: inverse_curve.frequency_centre_hz,
        scale_hz: f64::from(inverse_curve.frequency_scale_hz),
    })
}
