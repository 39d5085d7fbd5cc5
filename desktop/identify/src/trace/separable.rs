//! Effects that a chamber profile can tell apart: before the run, from its temperatures alone; after it, from the recording. The columns
//! and the measure are those that [`super::search`] uses on data.
//!
//! An effect of two noise floors is told from another if, over the whole run, the other leaves more of it unexplained than
//! the threshold of the search in log-likelihood. So a longer run tells more, as it does with data.

use super::data::Data;
use super::odds::THRESHOLD;
use super::search::Search;
use crate::fit::prepare;
use hrg_core::effects::EffectId;
use hrg_data::error::BadInput;
use hrg_data::recording::Recording;
use serde::Serialize;

/// Size at which effects are to be told apart, noise floors (RMS of 100 s means after the baseline fit).
pub const SIZE: f64 = 2.0;

/// Separation of one effect from the others in a run.
#[derive(Debug, Clone, Serialize)]
pub struct Verdict {
    /// The effect.
    pub name: String,
    /// Share of its size that the baseline leaves: the rest looks like eq 7.
    pub left_by_baseline: f64,
    /// Effects that it would be taken for, with the share that they explain.
    pub taken_for: Vec<(String, f64)>,
}

/// Below this share the baseline takes an effect so fully that it cannot be seen, and does no harm either.
pub const SEEN: f64 = 0.02;

/// Judges a recording (or a simulated one) for some effects.
///
/// # Errors
/// A recording that cannot be used.
pub fn judge(recordings: &[Recording], wanted: &[EffectId]) -> Result<Vec<Verdict>, BadInput> {
    let prepared = prepare(recordings)?;
    let data = Data::new(&prepared.runs, prepared.calibration.scaling, prepared.mean_lag_s());
    // (An axis that the recording does not have is not judged.)
    let there: Vec<usize> = data.axes.iter().map(|a| a.y.len()).filter(|n| *n > 0).collect();
    let rows = there.iter().copied().min().unwrap_or(0);
    if rows < 40 {
        return Err(BadInput::new(format!("only {rows} usable means in the run; a profile of some hours is needed")));
    }
    let search = Search::new(&data);
    // An effect of that size counts so much in log-likelihood over all axes.
    let hundreds = (rows * data.block_s) as f64 / 100.0;
    let weight = 0.5 * hundreds * SIZE * SIZE * there.len() as f64;
    let limit = 1.0 - THRESHOLD / weight;
    Ok(search
        .overlaps(wanted)
        .into_iter()
        .map(|o| Verdict {
            name: o.effect.name().to_string(),
            left_by_baseline: o.left,
            taken_for: o
                .shares
                .into_iter()
                .filter(|(_, s)| *s > limit)
                .map(|(n, s)| (n.name().to_string(), s))
                .collect(),
        })
        .collect())
}

/// Effects that are neither told from every other nor hidden in the baseline.
#[must_use]
pub fn not_separable(verdicts: &[Verdict]) -> Vec<String> {
    verdicts
        .iter()
        .filter(|v| v.left_by_baseline >= SEEN && !v.taken_for.is_empty())
        .map(|v| {
            let names: Vec<&str> = v.taken_for.iter().map(|(n, _)| n.as_str()).collect();
            format!("{} (for {})", v.name, names.join(", "))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_data::cards::parted;
    use hrg_simulate::{Plan, Profile};

    fn verdicts(profile: &str) -> Vec<Verdict> {
        let r = Plan::of(Profile::parse(profile).expect("fine"), 1, 1).simulate().recording;
        judge(&[r], &parted()).expect("usable")
    }

    #[test]
    fn a_recording_of_one_axis_is_judged_by_it() {
        let mut r = Plan::of(Profile::parse("cycle").expect("fine"), 1, 1).simulate().recording;
        r.absent = [true, false, true];
        for a in [0, 2] {
            r.frequency_hz[a].fill(f64::NAN);
            r.rate_dph[a].fill(f64::NAN);
        }
        let hysteresis = judge(&[r], &[hrg_core::effects::EffectId::Hysteresis]).expect("usable");
        assert!(hysteresis[0].taken_for.is_empty(), "{hysteresis:?}");
    }

    #[test]
    fn a_full_cycle_parts_more_than_a_ramp_one_way() {
        let (cycle, up) = (not_separable(&verdicts("cycle")), not_separable(&verdicts("up")));
        assert!(cycle.len() < up.len(), "{cycle:?} {up:?}");
        // On a ramp one way a play is an offset: hysteresis hides.
        let of = |v: &[Verdict], n: &str| v.iter().find(|v| v.name == n).expect("wanted").clone();
        let up_verdicts = verdicts("up");
        let hysteresis = of(&up_verdicts, "hysteresis");
        assert!(hysteresis.left_by_baseline < 0.3 || !hysteresis.taken_for.is_empty(), "{hysteresis:?}");
        assert!(of(&verdicts("cycle"), "hysteresis").taken_for.is_empty());
    }
}
