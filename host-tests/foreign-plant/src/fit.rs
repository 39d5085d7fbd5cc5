//! Linear least squares.

use nalgebra::{DMatrix, DVector};

/// The columns of dong2023's equation 7 but for its constant: T, T^2, r, r^2, T r.
#[must_use]
pub fn eq7(t_c: &[f64], ramp: &[f64]) -> Vec<Vec<f64>> {
    let by = |f: fn(f64, f64) -> f64| t_c.iter().zip(ramp).map(|(&t, &r)| f(t, r)).collect();
    vec![by(|t, _| t), by(|t, _| t * t), by(|_, r| r), by(|_, r| r * r), by(|t, r| t * r)]
}

/// Coefficients of the columns that fit `y` best. Columns are scaled within; a column that others explain gets the least coefficient.
#[must_use]
pub fn solve(columns: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let scales: Vec<f64> = columns.iter().map(|c| c.iter().map(|x| x * x).sum::<f64>().sqrt().max(1e-300)).collect();
    let matrix = DMatrix::from_fn(y.len(), columns.len(), |i, k| columns[k][i] / scales[k]);
    let svd = matrix.svd(true, true);
    match svd.solve(&DVector::from_column_slice(y), 1e-9) {
        Ok(solution) => solution.iter().zip(&scales).map(|(x, scale)| x / scale).collect(),
        // Without U or V only; both are asked for above.
        Err(_) => vec![0.0; columns.len()],
    }
}

/// `y` less what the columns give with `coefficients`.
#[must_use]
pub fn leftover(columns: &[Vec<f64>], coefficients: &[f64], y: &[f64]) -> Vec<f64> {
    (0..y.len())
        .map(|i| y[i] - columns.iter().zip(coefficients).map(|(column, k)| k * column[i]).sum::<f64>())
        .collect()
}
