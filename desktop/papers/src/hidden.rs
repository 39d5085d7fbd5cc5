//! The hidden layers of `inputs-network`: drawn by seeds, chosen by what they leave of rows that were held out.

use crate::form::{Data, Form};
use hrg_core::bias::Scaling;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::recording::steps::Run;
use hrg_identify::fit::MEAN_S;

/// Pairs of layers that are tried.
const PAIRS: u16 = 64;
/// Parts of which each is held out in turn, and contiguous pieces of which each part has two.
const FOLDS: usize = 5;

/// The pair of layers that leaves the least of held-out means, of those that a seed draws.
///
/// # Errors
/// Where no pair can be fitted: the reason of the last.
pub(super) fn choose(runs: &[Run], scaling: &Scaling, a: usize, seed: u64) -> Result<Form, BadInput> {
    let first = (seed % 64) as u16 * 2 * PAIRS;
    let mut best: Option<(f64, Form)> = None;
    let mut why = BadInput::new("no network can be fitted");
    for pair in 0..PAIRS {
        let form = Form::InputNetwork([first + 2 * pair, first + 2 * pair + 1]);
        match held_out(&Data::new(runs, scaling, a, form).means(MEAN_S)) {
            Ok(left) if best.as_ref().is_none_or(|(least, _)| left < *least) => best = Some((left, form)),
            Ok(_) => {}
            Err(e) => why = e,
        }
    }
    best.map(|(_, form)| form).ok_or(why)
}

/// Sum of squares that fits to the other parts leave of each part.
fn held_out(d: &Data) -> Result<f64, BadInput> {
    let rows = d.y.len();
    let fold = |k: usize| (k * 2 * FOLDS / rows) % FOLDS;
    let mut left = 0.0;
    for out in 0..FOLDS {
        let pick = |v: &[f64]| (0..rows).filter(|k| fold(*k) != out).map(|k| v[k]).collect::<Vec<_>>();
        let columns: Vec<Vec<f64>> = d.columns.iter().map(|c| pick(c)).collect();
        let fit = lsq::fit(&columns, &pick(&d.y), None, &d.names)?;
        left += (0..rows)
            .filter(|k| fold(*k) == out)
            .map(|k| (d.y[k] - d.columns.iter().zip(&fit.coefficients).map(|(c, x)| c[k] * x).sum::<f64>()).powi(2))
            .sum::<f64>();
    }
    Ok(left)
}
