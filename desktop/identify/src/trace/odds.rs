//! Prior odds of an effect, and the odds from which on it is named. All are logarithms; each row is one line of the table in
//! `docs/trace.md`.

use hrg_data::cards::{Card, Class, Kind};

/// Log posterior odds from which on an effect joins a model. `hrg-study threshold` derives it: on noise alone, the whole step of the search
/// (proposals of events and refined parameters included) passes it in 1 % of the runs.
pub const THRESHOLD: f64 = 5.0;

/// An effect is there at all.
const EFFECT: f64 = -3.0;
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

/// A run begins on a branch of a play, and not in its middle.
pub const BRANCH: f64 = -2.0;

/// Chance that the search on noise alone finds an effect of a score or more. The best score of many candidates on noise falls off as
/// `exp(-score)`, and passes the threshold in 1 % of the runs.
pub fn p_value(score: f64) -> f64 {
    (FALSE_ALARMS * (THRESHOLD - score).exp()).min(1.0)
}

/// Share of noise alone that passes the threshold.
const FALSE_ALARMS: f64 = 0.01;
