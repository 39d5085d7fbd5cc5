//! A jump of the chamber's temperature between two neighbouring soaks.

use super::left_over::{before_after, LeftOver};
use super::residual::{cubic_columns, residual_maker, residuals};
use super::table::Points;
use super::DRAWS;
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// A jump of the reference between two neighbouring soaks, at one place for all three gyros.
pub(super) fn chamber_step(p: &Points) -> Result<Option<LeftOver>, BadInput> {
    let n = p.chamber_c.len();
    let order: Vec<f64> = p.chamber_c.clone();
    let with_step = |a: usize, after: usize| {
        let mut columns = cubic_columns(p, a);
        columns.push((0..n).map(|k| if order[k] > order[after] { 1.0 } else { 0.0 }).collect());
        columns
    };
    let before: Vec<DMatrix<f64>> = (0..AXES).map(|a| residual_maker(&cubic_columns(p, a))).collect();
    // The step must leave points on both sides for the cubic to be held down.
    let places: Vec<usize> = (1..n - 2).collect();
    let after: Vec<Vec<DMatrix<f64>>> =
        places.iter().map(|&s| (0..AXES).map(|a| residual_maker(&with_step(a, s))).collect()).collect();
    let search = |y: &DVector<f64>| {
        let start: f64 = before.iter().map(|m| (m * y).norm_squared()).sum();
        let mut best = (f64::INFINITY, 0);
        for (at, m) in after.iter().enumerate() {
            let left: f64 = m.iter().map(|m| (m * y).norm_squared()).sum();
            if left < best.0 {
                best = (left, at);
            }
        }
        (best.0 / start, best.1)
    };
    let (ratio, at) = search(&DVector::from_column_slice(&p.chamber_c));
    let mut rng = ChaCha8Rng::seed_from_u64(2023);
    let mut as_good = 0usize;
    for _ in 0..DRAWS {
        let y = DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng));
        as_good += usize::from(search(&y).0 <= ratio);
    }
    let p_value = (as_good as f64 + 1.0) / (DRAWS as f64 + 1.0);
    if p_value > 0.01 {
        return Ok(None);
    }
    let place = places[at];
    let mut axes = BTreeMap::new();
    for (a, name) in AXIS_NAMES.iter().enumerate() {
        let columns = with_step(a, place);
        let gain = hrg_data::numeric::lsq::fit(&columns, &p.chamber_c, None, &["1", "u", "u^2", "u^3", "jump"])?
            .coefficients[4];
        let (e0, l0) = residuals(&cubic_columns(p, a), &p.chamber_c);
        let (e1, _) = residuals(&columns, &p.chamber_c);
        let l1: Vec<f64> = (0..n).map(|k| missed_by(p, a, k)).collect();
        axes.insert((*name).to_string(), before_after(gain, &e0, &l0, &e1, &l1));
    }
    let (from, to) = (p.chamber_c[place], p.chamber_c[place + 1]);
    Ok(Some(LeftOver {
        name: EffectId::Step.name().into(),
        reference: "chamber".into(),
        finding: format!(
            "between {from} and {to} C the chamber's temperature jumps against all three gyros, by {:.2} C on the mean",
            axes.values().map(|b| b.gain).sum::<f64>() / 3.0
        ),
        parameters: [("after_chamber_c".to_string(), from), ("before_chamber_c".to_string(), to)].into(),
        axes,
        p_value,
        statistic: format!(
            "residual sum of squares of the three cubics, with the best of {} places for a step against none; noise common to the three",
            places.len()
        ),
        indistinguishable_from: vec![],
    }))
}

/// Prediction error of a soak that is left out: the step is placed anew by the others, of all three gyros, and the cubic with that step is
/// fitted to them.
fn missed_by(p: &Points, a: usize, left_out: usize) -> f64 {
    let others: Vec<usize> = (0..p.chamber_c.len()).filter(|k| *k != left_out).collect();
    let y: Vec<f64> = others.iter().map(|&k| p.chamber_c[k]).collect();
    // A step half-way between two neighbours by the gyro's frequency, for every soak: the one left out too, whose chamber
    // temperature is what is to be predicted.
    let columns = |a: usize, after: usize| -> Vec<Vec<f64>> {
        let f = &p.frequency_hz[a];
        let threshold = 0.5 * (f[others[after]] + f[others[after + 1]]);
        let mut columns = cubic_columns(p, a);
        columns.push(f.iter().map(|f| if *f > threshold { 1.0 } else { 0.0 }).collect());
        columns
    };
    let fit = |a: usize, after: usize| {
        let rows: Vec<Vec<f64>> = columns(a, after).iter().map(|c| others.iter().map(|&k| c[k]).collect()).collect();
        hrg_data::numeric::lsq::fit(&rows, &y, None, &["1", "u", "u^2", "u^3", "jump"]).ok()
    };
    let place = (1..y.len() - 2)
        .filter_map(|s| Some((s, (0..AXES).map(|a| fit(a, s).map(|f| f.squares)).sum::<Option<f64>>()?)))
        .min_by(|x, y| x.1.total_cmp(&y.1));
    let Some((fitted, place)) = place.and_then(|(s, _)| Some((fit(a, s)?, s))) else { return f64::NAN };
    let predicted: f64 = columns(a, place).iter().zip(&fitted.coefficients).map(|(c, k)| c[left_out] * k).sum();
    p.chamber_c[left_out] - predicted
}

#[cfg(test)]
mod tests {
    use super::super::residual::largest;
    use super::super::samples::table;
    use super::*;

    #[test]
    fn a_soak_left_out_does_not_place_the_step() {
        let p = table(0.0, [0.001; AXES], 3.0);
        let columns = |k: usize| {
            let mut c = cubic_columns(&p, 0);
            c.push(p.chamber_c.iter().map(|t| if *t > p.chamber_c[k] { 1.0 } else { 0.0 }).collect());
            c
        };
        // With the step where it is, each soak is predicted; the one next to it is not, if it may not say where the step is.
        let (_, kept) = residuals(&columns(4), &p.chamber_c);
        assert!(largest(&kept) < 0.1, "{kept:?}");
        let anew: Vec<f64> = (0..10).map(|k| missed_by(&p, 0, k)).collect();
        assert!(anew.iter().filter(|m| m.abs() > 1.0).count() == 1 && anew[5].abs() > 1.0, "{anew:?}");
    }
}
