//! Forms that physics knows and no effect of the library has, tried in the place of an effect of another class.
//!
//! The trace names what an image can hold. What it holds may stand for another cause: a lag that is faster while the temperature moves looks like a
//! hysteresis beside a lag, and dry friction looks like a lag. An effect is explained if such a form in its place is excluded by the odds of every
//! claim. The forms are families: all that they cost is what a family of their class costs.

use super::data::Data;
use super::model::TEMPERATURE_TERMS;
use hrg_core::bias::TERMS;
use hrg_core::effects::parameters::{Parameters, Taus};
use hrg_core::effects::{rung, EffectId};
use hrg_data::cards::card;
use hrg_data::recording::steps::Run;

/// A form, as a family of columns.
pub struct Form {
    /// In words.
    pub about: &'static str,
    /// Means to tell it from an effect of another class, in words.
    pub told_by: &'static str,
    /// The family of the library whose class and prior odds it has.
    pub like: EffectId,
    /// Set if its columns are ramp terms in the place of the baseline's.
    pub of_ramp: bool,
    /// Groups of columns on the kept blocks of an axis; each is one try.
    pub groups: fn(&Data<'_>, usize) -> Vec<Vec<Vec<f64>>>,
}

/// Words by which a report says that an effect may be such a form.
pub const OF_A_FORM: &str = "which no effect of the library has";

/// All of them.
pub const FORMS: [Form; 4] = [
    Form {
        about: "a delay that is shorter while the temperature moves",
        told_by: "slow and fast ramps tell the two apart",
        like: EffectId::LagLadder,
        of_ramp: false,
        groups: stirred,
    },
    Form {
        about: "a delay that is shorter, the further it is behind",
        told_by: "small and large changes of temperature tell the two apart",
        like: EffectId::LagLadder,
        of_ramp: false,
        groups: convective,
    },
    Form {
        about: "dry friction",
        told_by: "slow and fast ramps tell the two apart",
        like: EffectId::PlayLadder,
        of_ramp: false,
        groups: friction,
    },
    Form {
        about: "a thermometer that reads in steps",
        told_by: "a finer thermometer tells the two apart",
        like: EffectId::ThermometerError,
        of_ramp: true,
        groups: in_steps,
    },
];

/// Powers of a ramp or of a distance by which a conductance grows: assumptions, in proportion and faster.
const POWERS: [i32; 2] = [1, 2];

/// Columns of a family.
const RUNGS: usize = 9;

/// Lags less temperature whose times are those of `lag-ladder` over `1 + (|r| / r0)^p`, with `r` the ramp: a body that gas around it cools the better, the
/// more a ramp stirs it. Tried are `r0` of the fastest ramp, a half, a quarter and an eighth of it, with `p` of 1 and 2.
fn stirred(data: &Data<'_>, a: usize) -> Vec<Vec<Vec<f64>>> {
    let fastest = data.states(a).iter().flatten().map(|s| s.1.abs()).fold(0.05, f64::max);
    let groups = POWERS.iter().flat_map(|p| [1.0, 0.5, 0.25, 0.125].map(|share| (*p, share * fastest)));
    groups.map(|(p, r0)| lags(data, a, move |_, ramp| 1.0 + (ramp.abs() / r0).powi(p))).collect()
}

/// The same over `1 + (|g| / g0)^p`, with `g` how far the lag is behind: convection, which carries the more for each degree, the more degrees there are. Tried
/// are `g0` of a tenth of the temperatures, a thirtieth and a hundredth.
fn convective(data: &Data<'_>, a: usize) -> Vec<Vec<Vec<f64>>> {
    let (low, high) = data.temperature_range();
    let span = f64::from(high - low).max(1.0);
    let groups = POWERS.iter().flat_map(|p| [0.1, 0.03, 0.01].map(|share| (*p, share * span)));
    groups.map(|(p, g0)| lags(data, a, move |behind, _| 1.0 + (behind.abs() / g0).powi(p))).collect()
}

/// Lags less temperature; `faster` gives by what each is faster, from how far it is behind (C) and the ramp (C per minute).
fn lags(data: &Data<'_>, a: usize, faster: impl Fn(f64, f64) -> f64) -> Vec<Vec<f64>> {
    let Some(taus) = (card(EffectId::LagLadder).grid)(&data.extent()).first().map(Taus::of) else { return vec![] };
    let states = data.states(a);
    let lag = |k: usize| {
        let tau_s = f64::from(rung(taus.tau_min_s, taus.tau_max_s, k, RUNGS));
        stepped(data, a, &states, |behind, step_s, from, to, ramp| {
            // (Exact for a straight line of temperature.)
            let times = step_s * faster(behind, ramp) / tau_s;
            let steady = (to - from) / times;
            (behind + steady) * (-times).exp() - steady
        })
    };
    (0..RUNGS).map(lag).collect()
}

/// Dry friction: `dz = dT - |dT| z / A` (Dahl 1968) for nine amplitudes `A`, from a fiftieth of the temperatures to one and a half times them. Its loops
/// do not depend on the ramp.
fn friction(data: &Data<'_>, a: usize) -> Vec<Vec<Vec<f64>>> {
    let (low, high) = data.temperature_range();
    let (span, states) = ((high - low).max(1.0), data.states(a));
    let loops = (0..RUNGS).map(|k| {
        let amplitude = f64::from(rung(0.02 * span, 1.5 * span, k, RUNGS));
        stepped(data, a, &states, |z, _, from, to, _| {
            let left = (-(to - from).abs() / amplitude).exp();
            z * left + (to - from).signum() * amplitude * (1.0 - left)
        })
    });
    vec![loops.collect()]
}

/// Ramp terms of the baseline of the temperature as it may have gone: in straight lines through the middles of the thermometer's steps. None where no
/// thermometer of the axis [reads in steps](reads_in_steps).
fn in_steps(data: &Data<'_>, a: usize) -> Vec<Vec<Vec<f64>>> {
    if !data.runs.iter().any(|run| reads_in_steps(&run.steps.frequency_hz[a])) {
        return vec![];
    }
    let smooth = |run: &Run| {
        let mut steps = run.steps.clone();
        steps.frequency_hz[a] = through_the_steps(&steps.frequency_hz[a]);
        Run::new(steps, run.curves)
    };
    let smooth: Vec<Run> = data.runs.iter().map(smooth).collect();
    let smooth = Data::in_blocks(&smooth, data.scaling, data.lag_s.into(), data.coarse_s);
    // (A step may be larger than what a temperature can do in a second: then the unit did not take it.)
    let (smooth, keep) = (&smooth.axes[a], &data.axes[a].keep);
    let Some(rows) = keep.iter().map(|k| smooth.keep.binary_search(k).ok()).collect::<Option<Vec<usize>>>() else {
        return vec![];
    };
    let of_rows = |column: &Vec<f64>| rows.iter().map(|k| column[*k]).collect();
    vec![smooth.base[TEMPERATURE_TERMS..TERMS].iter().map(of_rows).collect()]
}

/// `true` if a thermometer gives the reading of a second before more often than another one.
fn reads_in_steps(readings: &[f64]) -> bool {
    let (mut same, mut other) = (0, 0);
    for pair in readings.windows(2).filter(|p| p[0].is_finite() && p[1].is_finite()) {
        *(if pair[0] == pair[1] { &mut same } else { &mut other }) += 1;
    }
    same > other && other > 0
}

/// Readings on straight lines from the middle of each step to that of the next; before the first and behind the last as they are. Gaps stay.
fn through_the_steps(readings: &[f64]) -> Vec<f64> {
    let mut out = readings.to_vec();
    let mut last: Option<(f64, f64)> = None;
    for k in 1..readings.len() {
        let [before, now] = [readings[k - 1], readings[k]];
        if !(before.is_finite() && now.is_finite()) {
            last = None;
        } else if before != now {
            let here = (k as f64 - 0.5, 0.5 * (before + now));
            if let Some(from) = last {
                let slope = (here.1 - from.1) / (here.0 - from.0);
                for (j, v) in out.iter_mut().enumerate().take(k).skip(from.0.ceil() as usize) {
                    *v = from.1 + slope * (j as f64 - from.0);
                }
            }
            last = Some(here);
        }
    }
    out
}

/// A state from zero at the begin of each run, on the kept blocks: `step` gives the next one from the last, the seconds between them, the two temperatures
/// (C), and the ramp (C per minute). `states`: [`Data::states`] of the axis.
fn stepped(
    data: &Data<'_>,
    a: usize,
    states: &[Option<(f64, f64)>],
    step: impl Fn(f64, f64, f64, f64, f64) -> f64,
) -> Vec<f64> {
    let rows = &data.axes[a];
    let mut out = Vec::with_capacity(states.len());
    for number in 0..rows.starts.len() {
        let (mut state, mut last) = (0.0, None);
        for k in rows.run(number) {
            if let Some((now_c, ramp)) = states[k] {
                if let Some((block, last_c)) = last.replace((rows.keep[k], now_c)) {
                    state = step(state, ((rows.keep[k] - block) * data.block_s) as f64, last_c, now_c, ramp);
                }
            }
            out.push(state);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::data::tests::prepared;
    use crate::trace::data::Candidate;
    use crate::trace::growth;

    #[test]
    fn lags_that_nothing_makes_faster_are_those_of_the_unit() {
        let prepared = prepared("cycle");
        let data = growth::data(&prepared).expect("a baseline");
        let own = lags(&data, 0, |_, _| 1.0);
        let row = (card(EffectId::LagLadder).grid)(&data.extent())[0];
        let of_the_unit = data.columns(&Candidate::new(EffectId::LagLadder, row), 0, true).expect("needs nothing");
        for (k, (own, unit)) in own.iter().zip(&of_the_unit).enumerate() {
            let largest = unit.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            // (The mean of a block is not its middle where a soak begins.)
            let mean = own.iter().zip(unit).map(|(o, u)| (o - u).abs()).sum::<f64>() / own.len() as f64;
            assert!(mean < 0.02 * largest, "lag {k}: {mean} of {largest} C");
        }
        // A ramp, or how far they are behind, shortens them.
        let sum = |c: &[Vec<f64>]| c.iter().flatten().map(|v| v.abs()).sum::<f64>();
        for form in [stirred(&data, 0), convective(&data, 0)] {
            for of_power in form.chunks(form.len() / POWERS.len()) {
                let sums: Vec<f64> = of_power.iter().map(|g| sum(g)).collect();
                assert!(sums[0] < sum(&own) && sums.windows(2).all(|s| s[1] < s[0]), "{sums:?}");
            }
        }
    }

    #[test]
    fn steps_of_a_thermometer_are_taken_for_straight_lines() {
        let lines = through_the_steps(&[1.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, f64::NAN, 3.0, 3.0]);
        assert_eq!(lines[..7], [1.0, 1.0, 1.625, 1.875, 2.125, 2.375, 3.0]);
        assert!(lines[7].is_nan() && lines[8..] == [3.0; 2]);
        assert!(
            reads_in_steps(&[1.0, 1.0, 2.0, 2.0]) && !reads_in_steps(&[1.0, 2.0, 3.0]) && !reads_in_steps(&[1.0; 9])
        );
    }

    #[test]
    fn ramps_through_the_steps_are_nearer_to_the_true_ones() {
        let mut prepared = prepared("cycle");
        let ramps = |columns: &[Vec<f64>]| columns[0].clone();
        let (truth, read_fine) = {
            let data = growth::data(&prepared).expect("a baseline");
            (ramps(&data.axes[0].base[TEMPERATURE_TERMS..]), in_steps(&data, 0))
        };
        assert!(read_fine.is_empty());
        // Steps of about 0.2 C.
        let mut steps = prepared.runs[0].steps.clone();
        steps.frequency_hz[0].iter_mut().for_each(|f| *f = (*f / 0.1).round() * 0.1);
        prepared.runs[0] = Run::new(steps, prepared.runs[0].curves);
        let data = growth::data(&prepared).expect("a baseline");
        let off = |ramps: &[f64]| ramps.iter().zip(&truth).map(|(r, t)| (r - t).powi(2)).sum::<f64>();
        let (read, lines) = (off(&ramps(&data.axes[0].base[TEMPERATURE_TERMS..])), off(&ramps(&in_steps(&data, 0)[0])));
        println!("squared errors of the ramps: {read:.3} as read, {lines:.3} through the steps");
        assert!(lines < 0.25 * read, "{lines} {read}");
    }

    #[test]
    fn dry_friction_does_not_know_how_fast_it_went() {
        let loops = |profile: &str| {
            let prepared = prepared(profile);
            let data = growth::data(&prepared).expect("a baseline");
            let (low, high) = data.temperature_range();
            // (The amplitudes are shares of the temperatures that the resonator had.)
            friction(&data, 0)[0].iter().map(|z| z[z.len() - 1] / f64::from(high - low)).collect::<Vec<_>>()
        };
        let (slow, fast) = (loops("20,-30@0.5,1h,50@0.5,20m"), loops("20,-30@2,1h,50@2,20m"));
        // (The wide loops are not full.)
        for (slow, fast) in slow.iter().zip(&fast).take(5) {
            assert!((slow / fast - 1.0).abs() < 0.03, "{slow} {fast}");
        }
    }
}
