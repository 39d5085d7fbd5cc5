//! What is left after the model: noise, or structure? And where does it live?
//!
//! Generic curves (of temperature while heating and while cooling, of the rate of change, of both together, of time) are
//! offered to the final model of each axis, with the noise model refitted and the usual penalty: if one of them is
//! worth adding, structure is left there. (What the verify run is left with is judged by [`super::floor`].)

use super::data::Data;
use super::gls::{Basis, View, COLOURS};
use super::model::Term;
use super::search::MOST;
use crate::stats::dot;
use hrg_core::AXES;

/// Worth above which a generic curve counts as structure.
const WORTH: f64 = 10.0;

/// Where structure is left on the train runs, by axis, in words; empty where none is.
pub fn judge(data: &Data<'_>, terms: &[Term]) -> [Vec<String>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let mut left: Vec<String> = generic(data, a)
            .iter()
            .filter(|(_, columns)| worth(data, terms, a, columns) > WORTH)
            .map(|(name, _)| (*name).to_string())
            .collect();
        let here = |name: &str| terms.iter().filter(|t| t.on[a] && t.candidate.facts.name == name).count();
        if here("step") > 1 {
            left.push("in time: the rates jump more than once, so something switches".into());
        }
        if here("periodic") > 1 {
            left.push("in time: more than one period is needed, so it is not one that repeats".into());
        }
        if terms.iter().filter(|t| t.on[a]).count() >= MOST {
            left.push("in nothing simple: as many effects are needed as the search allows".into());
        }
        left
    })
}

/// Generic curves, on the kept blocks of an axis.
fn generic(data: &Data<'_>, a: usize) -> Vec<(&'static str, Vec<Vec<f64>>)> {
    let rows = &data.axes[a];
    let mut state = Vec::new();
    let mut clock = Vec::new();
    for (run, &n) in data.runs.iter().zip(&data.blocks) {
        for b in 0..n {
            let k = b * data.block_s + data.block_s / 2;
            let now = &run.thermal[k];
            let (t, r) = now.state(a).map_or((0.0, 0.0), |s| (s.temperature_c, s.rate_c_per_min));
            state.push((f64::from(t), f64::from(r)));
            clock.push(b as f64 / n as f64 * 2.0 - 1.0);
        }
    }
    let state: Vec<(f64, f64)> = rows.keep.iter().map(|&k| state[k]).collect();
    let clock: Vec<f64> = rows.keep.iter().map(|&k| clock[k]).collect();
    let (low, high) = data.temperature_range();
    let (centre, half) = (f64::from(0.5 * (low + high)), f64::from(0.5 * (high - low)).max(1.0));
    let fastest = state.iter().map(|s| s.1.abs()).fold(0.05, f64::max);
    let x: Vec<f64> = state.iter().map(|s| ((s.0 - centre) / half).clamp(-1.0, 1.0)).collect();
    let r: Vec<f64> = state.iter().map(|s| s.1 / fastest).collect();
    let curve = |v: &[f64], degrees: std::ops::RangeInclusive<i32>, weight: &dyn Fn(usize) -> f64| -> Vec<Vec<f64>> {
        degrees
            .map(|d| {
                v.iter()
                    .enumerate()
                    .map(|(k, x)| (f64::from(d) * x.clamp(-1.0, 1.0).acos()).cos() * weight(k))
                    .collect()
            })
            .collect()
    };
    let heating = |k: usize| if r[k] > 0.1 { 1.0 } else { 0.0 };
    let cooling = |k: usize| if r[k] < -0.1 { 1.0 } else { 0.0 };
    let mut directions = curve(&x, 0..=5, &heating);
    directions.extend(curve(&x, 0..=5, &cooling));
    let mut products = curve(&x, 1..=4, &|k| r[k]);
    products.extend(curve(&x, 1..=2, &|k| r[k] * r[k]));
    vec![
        ("in temperature", curve(&x, 3..=12, &|_| 1.0)),
        ("in temperature, heating apart from cooling", directions),
        ("in dT/dt", curve(&r, 3..=7, &|_| 1.0)),
        ("in temperature and dT/dt together", products),
        ("in time", curve(&clock, 1..=14, &|_| 1.0)),
    ]
}

/// Worth of adding columns to the final model of one axis.
fn worth(data: &Data<'_>, terms: &[Term], a: usize, columns: &[Vec<f64>]) -> f64 {
    let rows = &data.axes[a];
    let (mut without, mut with) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let mut added = 0;
    for colour in COLOURS {
        let view = View::new(rows, colour);
        let mut basis = Basis::default();
        for t in terms.iter().filter(|t| t.on[a]) {
            for c in data.columns(&t.candidate, a, false).unwrap_or_default() {
                basis.add(view.column(rows, &c));
            }
        }
        let mut y = view.y.clone();
        basis.reduce(&mut y);
        let rss = dot(&y, &y);
        without = without.max(view.log_likelihood(rss, data.runs.len()));
        let own = basis.columns.len();
        for c in columns {
            basis.add(view.column(rows, c));
        }
        added = basis.columns.len() - own;
        let explained: f64 = basis.columns[own..].iter().map(|q| dot(q, &y).powi(2)).sum();
        with = with.max(view.log_likelihood(rss - explained, data.runs.len()));
    }
    with - without - 0.5 * (rows.y.len() as f64).ln() * added as f64
}
