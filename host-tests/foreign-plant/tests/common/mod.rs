//! A reader of recordings and a least-squares fit, written for these tests alone.
#![allow(dead_code)] // Each test file uses a part.

use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// A recording as its text says it.
pub struct Table {
    pub metadata: BTreeMap<String, String>,
    pub columns: BTreeMap<String, Vec<f64>>,
}

/// Reads a recording; panics with what is wrong.
pub fn read(text: &str) -> Table {
    let mut metadata = BTreeMap::new();
    let mut lines = text.lines().peekable();
    while let Some(line) = lines.next_if(|line| line.starts_with('#')) {
        let (key, value) = line[1..].split_once(':').unwrap_or_else(|| panic!("metadata without a colon: {line}"));
        metadata.insert(key.trim().to_owned(), value.trim().to_owned());
    }
    let header: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns = vec![Vec::new(); header.len()];
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), header.len(), "cells of the row: {line}");
        for (column, cell) in columns.iter_mut().zip(cells) {
            column.push(if cell.is_empty() { f64::NAN } else { cell.parse().expect("a number") });
        }
    }
    Table { metadata, columns: header.into_iter().map(str::to_owned).zip(columns).collect() }
}

/// Means over 100 values.
pub fn means(x: &[f64]) -> Vec<f64> {
    x.chunks_exact(100).map(|c| c.iter().sum::<f64>() / 100.0).collect()
}

pub fn deviation(x: &[f64]) -> f64 {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / x.len() as f64).sqrt()
}

/// Columns of equation 7 but for its constant, from a temperature each second: T, T^2, r, r^2, T r with r over 60 s.
pub fn eq7(t_c: &[f64]) -> Vec<Vec<f64>> {
    let last = t_c.len() - 1;
    let ramp: Vec<f64> = (0..t_c.len())
        .map(|i| {
            let (from, to) = (i.saturating_sub(30), (i + 30).min(last));
            (t_c[to] - t_c[from]) / (to - from) as f64 * 60.0
        })
        .collect();
    let by = |f: &dyn Fn(f64, f64) -> f64| means(&t_c.iter().zip(&ramp).map(|(&t, &r)| f(t, r)).collect::<Vec<_>>());
    vec![by(&|t, _| t), by(&|t, _| t * t), by(&|_, r| r), by(&|_, r| r * r), by(&|t, r| t * r)]
}

/// Fits `y` by a constant and the columns; the coefficients, the constant first.
pub fn fit(columns: &[Vec<f64>], y: &[f64]) -> Vec<f64> {
    let scale: Vec<f64> = columns.iter().map(|c| c.iter().fold(1e-30, |a: f64, x| a.max(x.abs()))).collect();
    let design =
        DMatrix::from_fn(
            y.len(),
            columns.len() + 1,
            |i, k| if k == 0 { 1.0 } else { columns[k - 1][i] / scale[k - 1] },
        );
    let normal = design.transpose() * &design;
    let right = design.transpose() * DVector::from_column_slice(y);
    let solution = normal.cholesky().expect("independent columns").solve(&right);
    solution.iter().enumerate().map(|(k, x)| if k == 0 { *x } else { x / scale[k - 1] }).collect()
}

/// Deviation of what the coefficients leave of `y`.
pub fn left(columns: &[Vec<f64>], coefficients: &[f64], y: &[f64]) -> f64 {
    let rest: Vec<f64> = (0..y.len())
        .map(|i| y[i] - columns.iter().zip(&coefficients[1..]).map(|(c, k)| k * c[i]).sum::<f64>())
        .collect();
    deviation(&rest)
}
