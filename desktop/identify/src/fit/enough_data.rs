//! Tests if a run holds enough data behind a figure.

use crate::fit::MEAN_S;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::block_means;
use hrg_data::recording::steps::Run;

/// Least number of means behind a figure: a standard deviation of twenty is known to 16 %.
pub const LEAST_MEANS: usize = 20;

/// The same for the end of a run that was split (`--split`), which may be all that there is; a warning goes with it.
pub const LEAST_AFTER_SPLIT: usize = 12;

fn least(run: &Run) -> usize {
    if run.steps.run_in > 0 {
        LEAST_AFTER_SPLIT
    } else {
        LEAST_MEANS
    }
}

/// Seconds of a mean, in the order in which they are tried.
const MEANS_S: [usize; 3] = [MEAN_S, 30, 10];

/// Gives runs that are used together the longest means of which each of them holds enough (`mean_s` of their steps): 100 s, or 30
/// or 10. A note where they are shorter than the field's.
pub fn agree_on_means(runs: &mut [&mut Run]) -> Option<String> {
    let enough = |mean_s: usize| runs.iter().all(|r| (r.steps.len() - r.steps.run_in) / mean_s >= least(r));
    let mean_s = MEANS_S.into_iter().find(|m| enough(*m)).unwrap_or(MEAN_S);
    let before = runs.first().map_or(MEAN_S, |r| r.steps.mean_s);
    runs.iter_mut().for_each(|r| r.steps.mean_s = mean_s);
    (mean_s != before && mean_s < MEAN_S).then(|| {
        format!(
            "the runs are short: figures are of means of {mean_s} s, not of the usual {MEAN_S} s, and hold more noise"
        )
    })
}

/// Finite means of an axis, and how many the run's length allows.
#[must_use]
pub fn means(run: &Run, a: usize) -> (usize, usize) {
    let usable: Vec<f64> = run.steps.rate_dph[a]
        .iter()
        .enumerate()
        .map(|(k, r)| if run.state(k, a).is_some() { *r } else { f64::NAN })
        .collect();
    let m = block_means(&usable, run.steps.mean_s);
    (m.iter().filter(|v| v.is_finite()).count(), m.len() - run.steps.run_in / run.steps.mean_s)
}

/// A warning where the end of a split run has fewer than [`LEAST_MEANS`].
#[must_use]
pub fn few(run: &Run, what: &str) -> Option<String> {
    let fewest = run.steps.present().map(|a| means(run, a).0).min()?;
    (fewest < LEAST_MEANS).then(|| {
        format!(
            "{what} has only {fewest} means of {} s: a standard deviation of so few is known to {:.0} %",
            run.steps.mean_s,
            100.0 / (2.0 * (fewest as f64 - 1.0)).sqrt()
        )
    })
}

/// Means of a run whose axes take turns, one of so many: of the eight steps two turn an axis, and a step has a mean or two in 142 s.
const IN_TURNS: usize = 8;

/// Refuses a run of which an axis has fewer than [`LEAST_MEANS`] means, or less than half of those that its length allows (an eighth where the
/// axes take turns).
/// `what` names the run in the sentence: "the verify run v.csv".
///
/// # Errors
/// One sentence that says how many there are, and why.
pub fn require(run: &Run, what: &str) -> Result<(), BadInput> {
    for a in run.steps.present() {
        let name = AXIS_NAMES[a];
        let (good, all) = means(run, a);
        let least = least(run);
        let (one_of, share) = if run.steps.in_turns { (IN_TURNS, "an eighth") } else { (2, "half") };
        if good >= least && one_of * good >= all {
            continue;
        }
        return Err(BadInput::new(format!(
            "{what}: axis {name} has {good} usable means of {} s of {all}; a figure needs at least {least}, and {share} of the run: {}",
            run.steps.mean_s,
            reason(run, a, name)
        )));
    }
    Ok(())
}

/// The likeliest reason, in words.
fn reason(run: &Run, a: usize, name: &str) -> String {
    let steps = run.steps.len();
    if steps < LEAST_MEANS * run.steps.mean_s {
        return format!("the run lasts {steps} s; record an hour or more");
    }
    let mut frequencies: Vec<f64> = run.steps.frequency_hz[a].iter().copied().filter(|f| f.is_finite()).collect();
    if 2 * frequencies.len() < steps {
        let t = run.steps.thermometer;
        return format!("the {} {} is missing in {} of {steps} s", t.reading(), t.column(a), steps - frequencies.len());
    }
    let known = (0..steps).filter(|&k| run.state(k, a).is_some()).count();
    if 2 * known < steps && run.steps.thermometer.is_sensor() {
        return "its temperatures jump, or lie far outside those of the train runs; check the sensor".into();
    }
    if 2 * known < steps {
        let median = hrg_data::numeric::stats::median(&mut frequencies).unwrap_or(f64::NAN);
        let centre = run.curves[a].frequency_centre_hz;
        let guess = if (0.9..1.1).contains(&(median * 1000.0 / centre)) {
            "they look like kHz; convert them to Hz"
        } else {
            "this is another unit's run, or another calibration curve"
        };
        return format!(
            "its frequencies (median {median:.3}) are not those of a resonator about {centre:.1} Hz, as the calibration curve has it; {guess}"
        );
    }
    format!("the rates rate_{name}_dph are missing or were taken out")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::prepare;
    use hrg_data::recording::steps::Steps;
    use hrg_data::recording::Recording;
    use hrg_simulate::{Plan, Profile};

    fn run(profile: &str, seed: u64) -> Recording {
        Plan::of(Profile::parse(profile).expect("fine"), 21, seed).simulate().recording
    }

    #[test]
    fn each_reason_has_its_sentence() {
        let train = run("fast", 1);
        let curves = prepare(std::slice::from_ref(&train)).expect("prepares").calibration.axes.map(|a| a.curve);
        let judge = |r: &Recording| require(&Run::new(Steps::new(r).expect("steps"), curves), "the run");
        assert!(judge(&train).is_ok());
        let says = |r: &Recording, words: &str| {
            let e = judge(r).expect_err("refused").0;
            assert!(e.contains(words), "{e}");
        };
        says(&run("20,25@1,200s", 2), "the run lasts 501 s");
        let mut khz = train.clone();
        khz.frequency_hz.iter_mut().flatten().for_each(|f| *f /= 1000.0);
        says(&khz, "look like kHz");
        let mut other = train.clone();
        other.frequency_hz.iter_mut().flatten().for_each(|f| *f += 900.0);
        says(&other, "another unit");
        let mut lost = train.clone();
        let n = lost.rate_dph[1].len();
        lost.rate_dph[1][..n * 2 / 3].fill(f64::NAN);
        says(&lost, "axis y");
        let mut silent = train;
        let n = silent.frequency_hz[2].len();
        silent.frequency_hz[2][..n * 2 / 3].fill(f64::NAN);
        says(&silent, "frequency fz_hz is missing");
    }
}
