//! Residuals of a least-squares fit to a few points.

use super::table::Points;
use hrg_data::numeric::lsq::powers;
use nalgebra::{DMatrix, DVector};

pub(super) fn scaled(values: &[f64]) -> (Vec<f64>, f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
    (values.iter().map(|v| (v - centre) / half).collect(), centre, half)
}

pub(super) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

pub(super) fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// Projection onto what columns leave: residual = M y.
pub(super) fn residual_maker(columns: &[Vec<f64>]) -> DMatrix<f64> {
    let n = columns[0].len();
    let x = DMatrix::from_fn(n, columns.len(), |i, j| columns[j][i]);
    let q = x.qr().q();
    DMatrix::identity(n, n) - &q * q.transpose()
}

/// Residuals, and residuals of left-out points (the deleted residuals `e / (1 - h)`).
pub(super) fn residuals(columns: &[Vec<f64>], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let m = residual_maker(columns);
    let e = &m * DVector::from_column_slice(y);
    let left_out = (0..y.len()).map(|k| e[k] / m[(k, k)].max(1e-12)).collect();
    (e.iter().copied().collect(), left_out)
}

/// Columns of the inverse cubic of an axis.
pub(super) fn cubic_columns(p: &Points, a: usize) -> Vec<Vec<f64>> {
    powers(&scaled(&p.frequency_hz[a]).0, 3)
}
