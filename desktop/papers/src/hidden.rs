//! The hidden layers of `inputs-network`: drawn by seeds, chosen by what they leave of rows that were held out.

use crate::form::{Data, Form};
use crate::held_out::held_out;
use hrg_core::bias::Scaling;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::Run;
use hrg_identify::fit::MEAN_S;

/// Pairs of layers that are tried.
const PAIRS: u16 = 64;

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
