//! Defects of recordings as loggers and cables make them, put in on purpose and counted.

use crate::draw::stream;
use crate::recording::Recording;
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// Extent of a file's defects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defects {
    /// A few of each kind.
    Few,
    /// Ten times as many, a long gap, and lines that end with CR LF.
    Many,
}

/// Puts defects into a recording; returns how many of each kind (rows, or runs of rows for `gap` and `stuck`).
pub fn put_in(recording: &mut Recording, defects: Defects, seed: u64, file: &str) -> BTreeMap<String, usize> {
    let mut rng = stream(seed, &["defects", file]);
    let many = defects == Defects::Many;
    let times = if many { 10 } else { 1 };
    let mut counts = BTreeMap::new();
    for name in ["rate_x_dph", "rate_y_dph", "rate_z_dph"] {
        counts.insert(format!("spike {name}"), spikes(recording, &mut rng, name, 3 * times, 60.0..900.0));
        counts.insert(format!("missing {name}"), missing(recording, &mut rng, name, 15 * times));
        counts.insert(format!("stuck {name}"), stuck(recording, &mut rng, name, 1 + usize::from(many)));
    }
    for name in ["fx_hz", "fy_hz", "fz_hz"] {
        counts.insert(format!("spike {name}"), spikes(recording, &mut rng, name, 2 * times, 3.0..60.0));
        counts.insert(format!("missing {name}"), missing(recording, &mut rng, name, 8 * times));
        counts.insert(format!("stuck {name}"), stuck(recording, &mut rng, name, usize::from(many)));
    }
    // Value of a digital sensor after its own reset.
    counts.insert("85 C case_x_c".into(), constant(recording, &mut rng, "case_x_c", 4 * times, 85.0));
    counts.insert("repeated row".into(), repeat_rows(recording, &mut rng, 5 * times));
    counts.insert("backward time".into(), exchange_rows(recording, &mut rng, 2 * times));
    let longest = if many { 1500 } else { 200 };
    counts.insert("gap".into(), gaps(recording, &mut rng, 2 + usize::from(many), longest));
    recording.crlf = many;
    recording.invalid = if many { "NaN" } else { "" };
    counts.retain(|_, count| *count > 0);
    counts
}

fn values<'a>(recording: &'a mut Recording, name: &str) -> Option<&'a mut Vec<f64>> {
    recording.columns.iter_mut().find(|c| c.name == name).map(|c| &mut c.values)
}

fn spikes(
    recording: &mut Recording,
    rng: &mut ChaCha8Rng,
    name: &str,
    count: usize,
    height: std::ops::Range<f64>,
) -> usize {
    let Some(values) = values(recording, name) else { return 0 };
    for _ in 0..count {
        let row = rng.random_range(0..values.len());
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        values[row] += sign * rng.random_range(height.clone());
    }
    count
}

fn missing(recording: &mut Recording, rng: &mut ChaCha8Rng, name: &str, count: usize) -> usize {
    constant(recording, rng, name, count, f64::NAN)
}

fn constant(recording: &mut Recording, rng: &mut ChaCha8Rng, name: &str, count: usize, value: f64) -> usize {
    let Some(values) = values(recording, name) else { return 0 };
    for _ in 0..count {
        let row = rng.random_range(0..values.len());
        values[row] = value;
    }
    count
}

fn stuck(recording: &mut Recording, rng: &mut ChaCha8Rng, name: &str, count: usize) -> usize {
    let Some(values) = values(recording, name) else { return 0 };
    for _ in 0..count {
        let long = rng.random_range(60..180);
        let row = rng.random_range(0..values.len() - long);
        let held = values[row];
        values[row..row + long].fill(held);
    }
    count
}

fn repeat_rows(recording: &mut Recording, rng: &mut ChaCha8Rng, count: usize) -> usize {
    for _ in 0..count {
        let row = rng.random_range(0..recording.rows());
        for column in &mut recording.columns {
            let value = column.values[row];
            column.values.insert(row, value);
        }
    }
    count
}

fn exchange_rows(recording: &mut Recording, rng: &mut ChaCha8Rng, count: usize) -> usize {
    for _ in 0..count {
        let row = rng.random_range(1..recording.rows() - 4);
        for column in &mut recording.columns {
            column.values.swap(row, row + 3);
        }
    }
    count
}

fn gaps(recording: &mut Recording, rng: &mut ChaCha8Rng, count: usize, longest: usize) -> usize {
    for _ in 0..count {
        let long = rng.random_range(longest / 4..longest);
        let row = rng.random_range(longest..recording.rows() - 2 * longest);
        for column in &mut recording.columns {
            column.values.drain(row..row + long);
        }
    }
    count
}
