//! Smallest range (largest minus smallest residual) of a linear model, exactly: wu2023's first objective as a linear
//! program.
//!
//! `min hi - lo` with `lo <= y - X b <= hi` in every row. Few unknowns and many rows: only rows that matter enter the
//! program, the most violated ones being added until none is (cutting planes), so each program stays small and the
//! result is the optimum of all rows.

use hrg_data::error::BadInput;
use microlp::{ComparisonOp, OptimizationDirection, Problem};

/// Rows are fulfilled to this share of the range of `y`.
const TOLERANCE: f64 = 1e-7;

/// Smallest range of `y - X b`, and the `b` of it. The constant is not among the columns: it moves no range.
///
/// # Errors
/// If the columns do not determine `b`.
pub fn fit(columns: &[Vec<f64>], y: &[f64]) -> Result<(Vec<f64>, f64), BadInput> {
    let spread = |v: &[f64]| {
        v.iter().copied().fold(f64::NEG_INFINITY, f64::max) - v.iter().copied().fold(f64::INFINITY, f64::min)
    };
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    // Centred and scaled, all numbers are of order one.
    let (y_mean, y_scale) = (mean(y), spread(y));
    if !(y_scale > 0.0) {
        return Ok((vec![0.0; columns.len()], 0.0));
    }
    let middle: Vec<f64> = columns.iter().map(|c| mean(c)).collect();
    let scale: Vec<f64> = columns.iter().map(|c| spread(c)).collect();
    if scale.iter().any(|s| !(*s > 0.0)) {
        return Err(BadInput::new("a regressor is constant throughout; the run never does what it stands for"));
    }
    let row = |k: usize| columns.iter().zip(middle.iter().zip(&scale)).map(move |(c, (m, s))| (c[k] - m) / s);
    let value = |k: usize| (y[k] - y_mean) / y_scale;
    let failed = |e: microlp::Error| BadInput::new(format!("the smallest range was not found: {e}"));

    // Rows to begin with: evenly spread.
    let mut rows: Vec<usize> = (0..y.len()).step_by((y.len() / (4 * columns.len() + 8)).max(1)).collect();
    for _ in 0..200 {
        let mut problem = Problem::new(OptimizationDirection::Minimize);
        // No coefficient of a centred, scaled problem is anywhere near this; the bound keeps a program with few rows finite.
        let b: Vec<_> = columns.iter().map(|_| problem.add_var(0.0, (-1e3, 1e3))).collect();
        let low = problem.add_var(-1.0, (-1e3, 1e3));
        let high = problem.add_var(1.0, (-1e3, 1e3));
        for &k in &rows {
            let terms = |bound| b.iter().copied().zip(row(k)).chain([(bound, 1.0)]).collect::<Vec<_>>();
            problem.add_constraint(terms(low), ComparisonOp::Le, value(k));
            problem.add_constraint(terms(high), ComparisonOp::Ge, value(k));
        }
        let solution = problem
            .solve()
            .map_err(failed)?
            .into_solution()
            .map_err(|_| BadInput::new("the smallest range was not found in time"))?;
        let coefficients: Vec<f64> = b.iter().map(|v| solution.var_value(*v)).collect();
        let (low, high) = (solution.var_value(low), solution.var_value(high));
        let residual = |k: usize| value(k) - row(k).zip(&coefficients).map(|(x, b)| x * b).sum::<f64>();
        let residuals: Vec<f64> = (0..y.len()).map(residual).collect();
        let above = (0..y.len()).max_by(|a, b| residuals[*a].total_cmp(&residuals[*b]));
        let below = (0..y.len()).min_by(|a, b| residuals[*a].total_cmp(&residuals[*b]));
        let (Some(above), Some(below)) = (above, below) else { break };
        let worst = (residuals[above] - high).max(low - residuals[below]);
        if worst <= TOLERANCE {
            let b = coefficients.iter().zip(&scale).map(|(b, s)| b * y_scale / s).collect();
            return Ok((b, (residuals[above] - residuals[below]) * y_scale));
        }
        for k in [above, below] {
            if !rows.contains(&k) {
                rows.push(k);
            }
        }
    }
    Err(BadInput::new("the smallest range was not found: the program does not end"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_the_smallest_of_all() {
        // x^2 on 0..1 by a straight line: the best range is 1/4, the slope 1 (Chebyshev).
        let x: Vec<f64> = (0..=1000).map(|k| f64::from(k) / 1000.0).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 * x * x).collect();
        let (b, range) = fit(&[x], &y).expect("a program");
        assert!((b[0] - 3.0).abs() < 1e-3 && (range - 0.75).abs() < 1e-6, "{b:?} {range}");
    }

    #[test]
    fn a_constant_column_is_refused() {
        assert!(fit(&[vec![1.0; 9]], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]).is_err());
    }
}
