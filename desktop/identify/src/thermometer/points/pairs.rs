//! Two resonators, or two modes of one, each as the other's thermometer.

use super::residual::{residual_maker, residuals, rms, scaled};
use super::table::{Points, LEAST_SOAKS};
use hrg_data::axes::AXIS_NAMES;
use hrg_data::numeric::lsq::powers;
use nalgebra::DVector;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

/// Draws of noise behind the p-value of a pair.
const PAIR_DRAWS: usize = 20_000;

/// Two resonators, or two modes of one, each as the other's thermometer.
#[derive(Debug, Clone, Serialize)]
pub struct Pair {
    /// The two.
    pub axes: [String; 2],
    /// Soaks that have both, and the chamber.
    pub soaks: usize,
    /// Residual of the cubic of each against the chamber, C.
    pub against_chamber_rms_c: [f64; 2],
    /// Residual of the first (second) when a cubic of the other predicts it, in C of its own slope: no sensor is involved.
    pub by_the_other_rms_c: [f64; 2],
    /// The same with each soak left out.
    pub by_the_other_leave_one_out_c: [f64; 2],
    /// Correlation of what both leave against the chamber. Near 1: the two agree, and it is the chamber's sensor, or its distance
    /// from the body, that does not follow.
    pub correlation: f64,
    /// Chance of as large a correlation if each left noise of its own.
    pub p_value: f64,
}

/// Every two axes: one predicted from the other, and what both leave against the chamber.
pub(super) fn each_other(p: &Points) -> Vec<Pair> {
    let mut out = Vec::new();
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let rows: Vec<usize> = (0..p.rows)
            .filter(|&k| [p.frequency_hz[a][k], p.frequency_hz[b][k], p.chamber_c[k]].iter().all(|v| v.is_finite()))
            .collect();
        if rows.len() < LEAST_SOAKS {
            continue;
        }
        let pick = |v: &[f64]| rows.iter().map(|&k| v[k]).collect::<Vec<f64>>();
        let (fa, fb, t) = (pick(&p.frequency_hz[a]), pick(&p.frequency_hz[b]), pick(&p.chamber_c));
        let columns = [&fa, &fb].map(|f| powers(&scaled(f).0, 3));
        let makers = columns.each_ref().map(|c| residual_maker(c));
        let e = makers.each_ref().map(|m| m * DVector::from_column_slice(&t));
        let seen = correlation(&e[0], &e[1]);
        let mut rng = ChaCha8Rng::seed_from_u64(2025);
        let mut noise = || DVector::from_fn(rows.len(), |_, _| StandardNormal.sample(&mut rng));
        let as_good =
            (0..PAIR_DRAWS).filter(|_| correlation(&(&makers[0] * noise()), &(&makers[1] * noise())) >= seen).count();
        // In C: over the slope of the predicted frequency by the chamber's temperature.
        let slope_hz_per_c = |f: &[f64]| -> f64 {
            let (mt, mf) = (hrg_data::numeric::stats::mean(&t), hrg_data::numeric::stats::mean(f));
            let both: f64 = t.iter().zip(f).map(|(t, f)| (t - mt) * (f - mf)).sum();
            both / t.iter().map(|t| (t - mt).powi(2)).sum::<f64>()
        };
        let predicted = |of: &[f64], by: &[Vec<f64>]| -> [f64; 2] {
            let (rest, left_out) = residuals(by, of);
            let slope = slope_hz_per_c(of).abs();
            [rms(&rest) / slope, rms(&left_out) / slope]
        };
        let (x, y) = (predicted(&fa, &columns[1]), predicted(&fb, &columns[0]));
        let against = |k: usize| e[k].norm() / (rows.len() as f64).sqrt();
        out.push(Pair {
            axes: [AXIS_NAMES[a].into(), AXIS_NAMES[b].into()],
            soaks: rows.len(),
            against_chamber_rms_c: [against(0), against(1)],
            by_the_other_rms_c: [x[0], y[0]],
            by_the_other_leave_one_out_c: [x[1], y[1]],
            correlation: seen,
            p_value: (as_good as f64 + 1.0) / (PAIR_DRAWS as f64 + 1.0),
        });
    }
    out
}

fn correlation(x: &DVector<f64>, y: &DVector<f64>) -> f64 {
    x.dot(y) / (x.norm() * y.norm())
}
