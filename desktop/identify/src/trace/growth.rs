//! Noise that grows with temperature: learnt by axis from what the baseline leaves of the train runs, before anything is searched. It is
//! measured by the second differences of neighbouring blocks, so neither physics that follows temperature nor slow noise is taken for it.

use super::data::Data;
use super::floor::robust_square;
use super::model::Fitted;
use super::noise::Growth;
use super::odds::{EFFECT, THRESHOLD};
use crate::fit::Prepared;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{log_sum, mean};

/// Logarithms that are tried: the deviation falls or grows twofold or fourfold from cold to hot.
const TRIED: [f64; 4] =
    [-2.0 * std::f64::consts::LN_2, -std::f64::consts::LN_2, std::f64::consts::LN_2, 2.0 * std::f64::consts::LN_2];

/// The blocks of train runs, with the growth of their noise.
///
/// # Errors
/// Data that cannot hold the baseline down.
pub(super) fn data(prepared: &Prepared) -> Result<Data<'_>, BadInput> {
    let (runs, scaling, lag_s) = (&prepared.runs, prepared.calibration.scaling, prepared.mean_lag_s());
    let data = match prepared.coarse_s {
        Some(coarse_s) => Data::in_blocks(runs, scaling, lag_s, coarse_s),
        None => Data::new(runs, scaling, lag_s),
    };
    let left = Fitted::plain(&data)?.left(&data, &|_| true);
    let growth = [0, 1, 2].map(|a: usize| of_axis(&data, &left[a], a));
    Ok(data.with_growth(growth))
}

/// The growth of an axis: one of the values tried where it is as probable as anything that is named, weighted by their likelihoods.
fn of_axis(data: &Data<'_>, left: &[f64], a: usize) -> Growth {
    let temperatures: Vec<f64> = data.states(a).into_iter().map(|s| s.map_or(f64::NAN, |s| s.0)).collect();
    let low_c = temperatures.iter().copied().fold(f64::INFINITY, f64::min);
    let high_c = temperatures.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !(high_c > low_c) || temperatures.iter().any(|t| t.is_nan()) {
        return Growth::default();
    }
    let growth = |by: f64| {
        let of = Growth { by, low_c, high_c, mean: 0.0 };
        Growth { mean: mean(&temperatures.iter().map(|t| of.log_from_middle(*t)).collect::<Vec<_>>()), ..of }
    };
    // Second differences of three neighbours: of physics that follows temperature they hold next to nothing.
    let three = left.chunks_exact(3).zip(temperatures.chunks_exact(3));
    let triples: Vec<(f64, f64)> = three.map(|(y, t)| ((y[0] - 2.0 * y[1] + y[2]) / 6f64.sqrt(), t[1])).collect();
    let likelihood = |by: f64| {
        let growth = growth(by);
        let logs: f64 = triples.iter().map(|(_, t)| growth.at(*t).ln()).sum();
        let whitened: Vec<f64> = triples.iter().map(|(d, t)| d / growth.at(*t)).collect();
        -0.5 * triples.len() as f64 * robust_square(&whitened).max(1e-300).ln() - logs
    };
    let (none, tried) = (likelihood(0.0), TRIED.map(likelihood));
    let all = log_sum(&tried);
    if EFFECT - (TRIED.len() as f64).ln() + all - none < THRESHOLD {
        return Growth::default();
    }
    growth(TRIED.iter().zip(&tried).map(|(by, e)| by * (e - all).exp()).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::independence::Units;
    use crate::fit::prepare_for;
    use hrg_simulate::{Plan, Profile};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn noise_that_grows_is_learnt_on_the_axis_that_has_it() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let plan = Plan::of(Profile::parse("cycle").expect("named"), 1, 1);
        let mut prepared = prepare_for(&[plan.simulate().recording], Units::default()).expect("usable");
        let run = &mut prepared.runs[0];
        let (low, high) = run.temperature_range(0);
        for k in 0..run.steps.len() {
            let Some((t, _)) = run.state(k, 0) else { continue };
            // Ten times what the axis has: 3 deg/h in means of 100 s in the middle, threefold from cold to hot.
            let level = 30.0 * 3f64.powf(f64::from((t - low) / (high - low)) - 0.5);
            let drawn: f64 = StandardNormal.sample(&mut rng);
            run.steps.rate_dph[0][k] += level * drawn;
        }
        let data = data(&prepared).expect("a baseline");
        let [x, y, z] = data.growth.map(|g| g.by.exp());
        assert!((2.2..4.1).contains(&x) && y == 1.0 && z == 1.0, "{x} {y} {z}");
        let sentence = data.growth[0].sentence("x").expect("there");
        assert!(
            sentence.starts_with("axis x: the white noise is") && data.growth[1].sentence("y").is_none(),
            "{sentence}"
        );
    }
}
