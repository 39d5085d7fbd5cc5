//! Prior odds of an effect, and the odds from which on it is named. All are logarithms; each row is one line of the table in
//! `docs/trace.md`.

use super::data::Starts;
use hrg_data::cards::{Card, Class, Kind};

/// Log posterior odds from which on a claim is made: 99 to 1, so that one in a hundred is wrong if the odds are what they say.
/// `hrg-study threshold` measures how often the whole first step of the search (proposals of events and refined parameters included)
/// passes it on noise alone.
pub const THRESHOLD: f64 = 4.6;

/// Probability by which chance may pass a test that is made once: of a unit with three axes, of a piece of a run. The numbers of deviations of the judge
/// ([`super::judge::DEVIATIONS`]) and of a jump (in `floor.rs`) are its quantiles, and an unknown state is left out until this share of it is left
/// (`run_in.rs`).
pub const LEVEL: f64 = 0.05;

/// An effect is there at all.
pub const EFFECT: f64 = -3.0;
/// An axis has it.
pub const AXIS: f64 = -1.0;
/// Its class is not in the model yet.
const NEW_CLASS: f64 = -2.0;
/// It is a family, and not a named form with one gain.
const FAMILY: f64 = -3.0;
/// It happens once, and another run cannot confirm it; each further one costs as much again, as what repeats is rather something that comes
/// back.
const EVENT: f64 = -6.0;

/// Log prior odds of an effect beside those of a model (their classes are given); `tries`: values of its parameter that were offered.
pub fn log_prior(card: &Card, tries: f64, model: &[Class]) -> f64 {
    let events = model.iter().filter(|c| **c == Class::Event).count();
    let mut sum = EFFECT - tries.max(1.0).ln();
    if !model.contains(&card.class) {
        sum += NEW_CLASS;
    }
    if matches!(card.kind, Kind::Family | Kind::Searched) {
        sum += FAMILY;
    }
    if card.class == Class::Event {
        sum += EVENT * (1 + events) as f64;
    }
    sum
}

/// A run begins at one of the three places of a play ([`Starts::BRANCHES`]) and not at another.
pub fn branch() -> f64 {
    -(Starts::BRANCHES.len() as f64).ln()
}

/// Probability that an effect of a score is not there: the odds as a chance.
pub fn p_value(score: f64) -> f64 {
    1.0 / (1.0 + score.exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::{floor, judge};
    use statrs::distribution::{ContinuousCDF, Normal};

    #[test]
    fn quantiles_are_those_of_the_level() {
        let normal = Normal::new(0.0, 1.0).expect("possible");
        let of = |tests: f64| normal.inverse_cdf(1.0 - LEVEL / tests / 2.0);
        assert!((judge::DEVIATIONS - of(3.0)).abs() < 5e-3);
        assert!((floor::JUMP - of(floor::PIECE as f64)).abs() < 5e-3);
        assert!((THRESHOLD - 99f64.ln()).abs() < 0.01);
    }
}
