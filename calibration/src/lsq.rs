//! Least squares by QR with scaled columns: coefficients, standard deviations, condition number.

use crate::BadInput;
use nalgebra::{DMatrix, DVector};

/// Result of a least-squares fit.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Coefficients, in the units of the columns.
    pub coefficients: Vec<f64>,
    /// Their standard deviations for white residuals.
    pub std: Vec<f64>,
    /// Condition number of the columns, each scaled to unit length.
    pub condition: f64,
    /// Residuals of the rows that took part.
    pub residuals: Vec<f64>,
    /// Residual standard deviation, degrees of freedom taken off.
    pub sigma: f64,
}

/// Fits `y = X b` where `columns[j][row]` are the columns of X. Rows with a weight of zero or a value that is not
/// finite take no part.
///
/// # Errors
/// Too few rows, or columns that the data cannot tell apart: the sentence names them by `names`.
pub fn fit(columns: &[Vec<f64>], y: &[f64], weights: Option<&[f64]>, names: &[&str]) -> Result<Fit, BadInput> {
    let p = columns.len();
    let rows: Vec<usize> = (0..y.len())
        .filter(|&k| y[k].is_finite() && columns.iter().all(|c| c[k].is_finite()) && weights.is_none_or(|w| w[k] > 0.0))
        .collect();
    let n = rows.len();
    if n < p + 2 {
        return Err(BadInput::new(format!(
            "only {n} usable rows for {p} coefficients; record a longer run, or fill the missing values"
        )));
    }
    let root = |k: usize| weights.map_or(1.0, |w| w[k].sqrt());
    let scale: Vec<f64> =
        columns.iter().map(|c| rows.iter().map(|&k| (c[k] * root(k)).powi(2)).sum::<f64>().sqrt()).collect();
    if let Some(j) = scale.iter().position(|s| *s <= 0.0) {
        return Err(BadInput::new(format!(
            "the regressor {} is zero throughout; the run never does what it stands for",
            names.get(j).unwrap_or(&"?")
        )));
    }
    let x = DMatrix::from_fn(n, p, |i, j| columns[j][rows[i]] * root(rows[i]) / scale[j]);
    let b = DVector::from_fn(n, |i, _| y[rows[i]] * root(rows[i]));
    let qr = x.clone().qr();
    let r = qr.r();
    let sv = r.clone().singular_values();
    let condition = sv[0] / sv[p - 1].max(f64::MIN_POSITIVE);
    if !(condition < 1e10) {
        // Name the columns of the weakest direction.
        let svd = r.svd(false, true);
        let weakest = svd.v_t.map(|v| v.row(p - 1).iter().map(|x| x.abs()).collect::<Vec<_>>()).unwrap_or_default();
        let involved: Vec<&str> =
            weakest.iter().enumerate().filter(|(_, w)| **w > 0.3).filter_map(|(j, _)| names.get(j).copied()).collect();
        return Err(BadInput::new(format!(
            "the run cannot tell {} apart (condition number {condition:.0e}); record soaks at more temperatures and ramps in both directions",
            involved.join(", ")
        )));
    }
    // The reflections are applied to b, one after the other: Q itself, as large as the data, is never made.
    let mut turned = b.clone();
    qr.q_tr_mul(&mut turned);
    let z = qr
        .r()
        .solve_upper_triangular(&turned.rows(0, p))
        .ok_or_else(|| BadInput::new("the normal equations are singular; record a longer run"))?;
    drop(turned);
    let residual = &b - &x * &z;
    let sigma = (residual.norm_squared() / (n - p) as f64).sqrt();
    let inverse = qr.r().try_inverse().ok_or_else(|| BadInput::new("the normal equations are singular"))?;
    Ok(Fit {
        coefficients: z.iter().zip(&scale).map(|(z, s)| z / s).collect(),
        std: (0..p).map(|j| sigma * inverse.row(j).norm() / scale[j]).collect(),
        condition,
        residuals: residual.iter().zip(&rows).map(|(e, &k)| e / root(k)).collect(),
        sigma,
    })
}

/// Values of a polynomial's columns `1, u, u^2 ... u^degree`.
#[must_use]
pub fn powers(u: &[f64], degree: usize) -> Vec<Vec<f64>> {
    (0..=degree).map(|d| u.iter().map(|x| x.powi(d as i32)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_and_states_its_uncertainty() {
        let u: Vec<f64> = (0..200).map(|k| f64::from(k) / 100.0 - 1.0).collect();
        let y: Vec<f64> =
            u.iter().enumerate().map(|(k, u)| 2.0 - 3.0 * u + 0.1 * ((k * 37 % 11) as f64 - 5.0)).collect();
        let f = fit(&powers(&u, 1), &y, None, &["1", "u"]).expect("fits");
        assert!((f.coefficients[0] - 2.0).abs() < 4.0 * f.std[0]);
        assert!((f.coefficients[1] + 3.0).abs() < 4.0 * f.std[1]);
        assert!(f.condition < 2.0);
    }

    #[test]
    fn what_cannot_be_told_apart_is_named() {
        let u: Vec<f64> = (0..50).map(f64::from).collect();
        let columns = vec![vec![1.0; 50], u.clone(), u.iter().map(|x| 2.0 * x).collect()];
        let e = fit(&columns, &u, None, &["one", "this", "that"]).expect_err("singular");
        assert!(e.0.contains("this, that"), "{e}");
        assert!(fit(&columns, &u[..3], None, &[]).expect_err("few").0.contains("usable rows"));
    }
}
