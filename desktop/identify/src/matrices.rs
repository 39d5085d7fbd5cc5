//! Pieces of linear algebra that several fits need.

use nalgebra::{Cholesky, DMatrix, Dyn};

/// A symmetric matrix from its lower triangle.
pub fn symmetric(n: usize, at: impl Fn(usize, usize) -> f64) -> DMatrix<f64> {
    let mut m = DMatrix::from_fn(n, n, |i, j| if j <= i { at(i, j) } else { 0.0 });
    m.fill_upper_triangle_with_lower_triangle();
    m
}

/// Log determinant of a factored matrix.
pub fn log_determinant(f: &Cholesky<f64, Dyn>) -> f64 {
    2.0 * f.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>()
}
