//! What is left after the model: noise, or structure? And where does it live?
//!
//! Two looks. First, generic curves (of temperature while heating and while cooling, of the rate of change, of both
//! together, of time) are offered to the final model of each axis, with the noise colour refitted and the usual
//! penalty: if one of them is worth adding, structure is left there. Second, the residual's 100 s means are compared
//! with what their own successive differences say of white noise: structure that is slower than the means shows as
//! a ratio above one, whatever its shape. Last, the verify run is looked at: a model that is right leaves the floor
//! there too.

use super::data::Data;
use super::gls::{Basis, View, COLOURS};
use super::search::Model;
use super::Fitted;
use crate::fit::MEAN_S;
use crate::stats::dot;
use crate::stats::{block_means, mean};
use hrg_core::AXES;

/// Worth above which a generic curve counts as structure.
const WORTH: f64 = 10.0;
/// Ratio of the means' deviation to what their differences tell, above which slow structure is said to be left.
const RATIO: f64 = 1.6;

/// Ratio of the verify run's residual to the floor above which structure is said to be left there.
const VERIFY_RATIO: f64 = 2.0;

/// The verdict on one axis.
#[derive(Debug, Clone, Default)]
pub struct Left {
    /// In words; empty where only noise is left.
    pub where_it_lives: Vec<String>,
    /// Estimated standard deviation of 100 s means of the noise, deg/h.
    pub floor_dph: f64,
}

/// Judges the residuals.
pub fn judge(data: &Data<'_>, model: &Model, fitted: &Fitted, after: &[[Vec<f64>; AXES]]) -> [Left; AXES] {
    [0, 1, 2].map(|a: usize| {
        let mut left = Left::default();
        let means: Vec<Vec<f64>> = after.iter().map(|r| block_means(&r[a], MEAN_S)).collect();
        let all: Vec<f64> = means.iter().flatten().copied().filter(|v| v.is_finite()).collect();
        let m = mean(&all);
        let n = all.len() as f64;
        let freedom = (n - fitted.coefficients[a].len() as f64).max(1.0);
        let spread = (all.iter().map(|v| (v - m).powi(2)).sum::<f64>() / freedom).sqrt();
        let (mut sum, mut count) = (0.0, 0.0);
        for series in &means {
            for w in series.windows(2).filter(|w| w[0].is_finite() && w[1].is_finite()) {
                sum += (w[1] - w[0]).powi(2);
                count += 1.0;
            }
        }
        let quick = (sum / (2.0 * f64::max(count, 1.0))).sqrt();
        for (name, columns) in generic(data, a) {
            let worth = worth(data, model, a, &columns);
            if worth > WORTH {
                left.where_it_lives.push(name.to_string());
            }
        }
        let several = |name: &str| model.effects.iter().filter(|e| e.facts.name == name).count() > 1;
        if several("step") {
            left.where_it_lives.push("in time: the rates jump more than once, so something switches".into());
        }
        if several("periodic") {
            left.where_it_lives.push("in time: more than one period is needed, so it is not one that repeats".into());
        }
        if model.effects.len() >= super::search::MOST {
            left.where_it_lives.push("in nothing simple: as many effects are needed as the search allows".into());
        }
        if spread > RATIO * quick {
            left.where_it_lives.push(format!(
                "in slow changes (100 s means scatter by {:.1} times what neighbours differ by)",
                spread / quick
            ));
        }
        left.floor_dph = if left.where_it_lives.is_empty() { spread } else { quick };
        left
    })
}

/// Adds what an unseen run says: a model that is right leaves the floor there too. (Not asked where an effect was
/// found that nobody can predict: it stays in the verify run.)
pub fn judge_verify(left: &mut Left, verify_rms_dph: f64) {
    let ratio = verify_rms_dph / left.floor_dph;
    if ratio > VERIFY_RATIO {
        left.where_it_lives.push(format!("on the verify run ({ratio:.1} times the noise floor)"));
    }
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
fn worth(data: &Data<'_>, model: &Model, a: usize, columns: &[Vec<f64>]) -> f64 {
    let rows = &data.axes[a];
    let (mut without, mut with) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let mut added = 0;
    for colour in COLOURS {
        let view = View::new(rows, colour);
        let mut basis = Basis::default();
        for e in &model.effects {
            for c in data.columns(e, a, false).unwrap_or_default() {
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
