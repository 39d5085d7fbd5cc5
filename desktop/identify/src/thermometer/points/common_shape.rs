//! Common shape in the residuals of the three cubics on the sensors of the cases.

use super::left_over::{before_after, BeforeAfter, LeftOver};
use super::residual::{cubic_columns, residual_maker, residuals, rms};
use super::table::Points;
use super::DRAWS;
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::list;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::collections::BTreeMap;

/// Variance of what belongs to each of three residuals alone, from the variances of their differences (the three-cornered hat,
/// Gray and Allan 1974). At least a twentieth of the smallest residual's, for of ten points it may come out negative.
fn own_variances(e: &[Vec<f64>; AXES]) -> [f64; AXES] {
    let variance = |v: &[f64]| rms(v).powi(2);
    let difference = |a: usize, b: usize| variance(&e[a].iter().zip(&e[b]).map(|(x, y)| x - y).collect::<Vec<_>>());
    let least = 0.05 * e.iter().map(|v| variance(v)).fold(f64::INFINITY, f64::min);
    [0, 1, 2].map(|a| {
        let (b, c) = ((a + 1) % AXES, (a + 2) % AXES);
        (0.5 * (difference(a, b) + difference(a, c) - difference(b, c))).max(least)
    })
}

/// "x and y", and the others beside them.
fn which(axes: &BTreeMap<String, BeforeAfter>, shrinks: impl Fn(&BeforeAfter) -> bool) -> String {
    let of =
        |wanted: bool| -> Vec<&String> { axes.iter().filter(|(_, b)| shrinks(b) == wanted).map(|(n, _)| n).collect() };
    let (yes, no) = (of(true), of(false));
    match (yes.is_empty(), no.is_empty()) {
        (false, true) => "shrinks on each axis".into(),
        (true, _) => "shrinks on no axis".into(),
        (false, false) => format!("shrinks on {} and not on {}", list(&yes), list(&no)),
    }
}

/// Finds a common shape in the residuals of the three cubics on the sensors of the cases.
pub(super) fn common_shape(p: &Points) -> Option<LeftOver> {
    let n = p.chamber_c.len();
    let makers: Vec<DMatrix<f64>> = (0..AXES).map(|a| residual_maker(&cubic_columns(p, a))).collect();
    let mean_correlation = |e: &[DVector<f64>]| {
        let r = |a: usize, b: usize| e[a].dot(&e[b]) / (e[a].norm() * e[b].norm());
        (r(0, 1) + r(1, 2) + r(0, 2)) / 3.0
    };
    let e: Vec<DVector<f64>> = (0..AXES).map(|a| &makers[a] * DVector::from_column_slice(&p.case_c[a])).collect();
    let seen = mean_correlation(&e);
    let mut rng = ChaCha8Rng::seed_from_u64(2024);
    let mut as_good = 0usize;
    for _ in 0..DRAWS {
        let drawn: Vec<DVector<f64>> =
            makers.iter().map(|m| m * DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng))).collect();
        as_good += usize::from(mean_correlation(&drawn) >= seen);
    }
    let p_value = (as_good as f64 + 1.0) / (DRAWS as f64 + 1.0);
    if p_value > 0.01 {
        return None;
    }
    let (residual, left_out): (Vec<Vec<f64>>, Vec<Vec<f64>>) =
        (0..AXES).map(|a| residuals(&cubic_columns(p, a), &p.case_c[a])).unzip();
    let residual: [Vec<f64>; AXES] = residual.try_into().ok()?;
    let own = own_variances(&residual);
    let mut axes = BTreeMap::new();
    for (a, name) in AXIS_NAMES.iter().enumerate() {
        let (b, c) = ((a + 1) % AXES, (a + 2) % AXES);
        // Predicted from the other two alone: their mean, each weighted by how little of it is its own.
        let weight = own[c] / (own[b] + own[c]);
        let shared = |e: &[Vec<f64>]| -> Vec<f64> {
            e[b].iter().zip(&e[c]).map(|(x, y)| weight * x + (1.0 - weight) * y).collect()
        };
        let less = |e: &[Vec<f64>]| -> Vec<f64> { e[a].iter().zip(shared(e)).map(|(o, s)| o - s).collect() };
        let figures =
            before_after(rms(&shared(&residual)), &residual[a], &left_out[a], &less(&residual), &less(&left_out));
        axes.insert((*name).to_string(), figures);
    }
    Some(LeftOver {
        name: EffectId::Timebase.name().into(),
        reference: "shell".into(),
        finding: format!(
            "what the three cubics leave has the same shape in all three gyros (mean correlation {seen:.3}); with what the other two predict taken off, the residual {}, its leave-one-out error {}",
            which(&axes, |b| b.rms_after_c < b.rms_before_c),
            which(&axes, |b| b.leave_one_out_after_c < b.leave_one_out_before_c)
        ),
        parameters: [("mean_correlation".to_string(), seen)].into(),
        axes,
        p_value,
        statistic: "mean pairwise correlation of the residuals of three cubics; noise independent on the three".into(),
        indistinguishable_from: vec![EffectId::Board.name().into(), EffectId::CaseGradient.name().into()],
    })
}

#[cfg(test)]
mod tests {
    use super::super::samples::table;
    use super::*;

    #[test]
    fn a_noisy_neighbour_counts_for_little() {
        let p = table(0.02, [0.002, 0.002, 0.05], 0.0);
        let residual: Vec<Vec<f64>> = (0..AXES).map(|a| residuals(&cubic_columns(&p, a), &p.case_c[a]).0).collect();
        let residual: [Vec<f64>; AXES] = residual.try_into().expect("three");
        let own = own_variances(&residual);
        assert!(own[2] > 20.0 * own[0] && own[2] > 20.0 * own[1], "{own:?}");
        // Weighted by it, the quiet axes predict each other; the plain mean with the noisy one would not.
        let left: Vec<f64> = residual[0].iter().zip(&residual[1]).map(|(x, y)| x - y).collect();
        let plain: Vec<f64> = (0..10).map(|k| residual[0][k] - 0.5 * (residual[1][k] + residual[2][k])).collect();
        assert!(rms(&left) < 0.2 * rms(&residual[0]) && rms(&plain) > 0.5 * rms(&residual[0]));
    }

    #[test]
    fn words_follow_the_numbers() {
        let b = |before: f64, after: f64| BeforeAfter {
            gain: 0.0,
            rms_before_c: before,
            rms_after_c: after,
            max_before_c: 0.0,
            max_after_c: 0.0,
            leave_one_out_before_c: 0.0,
            leave_one_out_after_c: 0.0,
        };
        let say = |x: f64, y: f64| {
            let axes = [("x".to_string(), b(1.0, x)), ("y".to_string(), b(1.0, y))].into();
            which(&axes, |b| b.rms_after_c < b.rms_before_c)
        };
        assert_eq!(say(0.5, 0.5), "shrinks on each axis");
        assert_eq!(say(0.5, 1.5), "shrinks on x and not on y");
        assert_eq!(say(1.5, 1.5), "shrinks on no axis");
    }
}
