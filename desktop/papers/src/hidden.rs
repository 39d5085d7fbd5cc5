//! The hidden layers of `inputs-network`: drawn by seeds, chosen by what they leave of rows that were held out.

use crate::form::Form;
use crate::held_out;
use hrg_core::bias::Scaling;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::Run;

/// Pairs of layers that are tried.
const PAIRS: u16 = 64;

/// The pair of layers that leaves the least of held-out means, of those that a seed draws.
///
/// # Errors
/// Where no pair can be fitted: the reason of the last.
pub(super) fn choose(runs: &[Run], scaling: &Scaling, a: usize, seed: u64) -> Result<Form, BadInput> {
    let first = (seed % 64) as u16 * 2 * PAIRS;
    let pairs = (0..PAIRS).map(|pair| Form::InputNetwork([first + 2 * pair, first + 2 * pair + 1]));
    held_out::best(pairs, runs, scaling, a)
}
