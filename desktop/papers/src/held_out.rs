//! Error of a model that is linear on parts of the train runs that it was not fitted to.

use crate::form::{Data, Form};
use crate::method::{Degree, Method};
use hrg_core::bias::Scaling;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::recording::steps::Run;
use hrg_identify::fit::MEAN_S;

/// Parts of which each is held out in turn, and contiguous pieces of which each part has two.
const FOLDS: usize = 5;

/// The degree that leaves the least of held-out means.
///
/// # Errors
/// Where none can be fitted: the reason of the last.
pub(super) fn degree(method: Method, runs: &[Run], scaling: &Scaling, a: usize) -> Result<Form, BadInput> {
    best((1..=Degree::MOST).map(|n| Form::of_degree(method, n)), runs, scaling, a)
}

/// The first of the forms that leave the least of held-out means.
///
/// # Errors
/// Where none can be fitted: the reason of the last.
pub(super) fn best(
    forms: impl Iterator<Item = Form>,
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
) -> Result<Form, BadInput> {
    let mut best: Option<(f64, Form)> = None;
    let mut why = BadInput::new("there is no model to be fitted");
    for form in forms {
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
