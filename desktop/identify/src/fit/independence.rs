//! Tests if recordings are independent witnesses: a run that is judged on must not hold data that were learnt from.
//!
//! Names prove nothing: a file may be copied, cut into overlapping parts, resampled or given twice. So the content is
//! compared, in two ways. Rows: windows of `WINDOW` consecutive rows with the same rates, wherever they stand in the two
//! files and whatever their times are. Noise: the second differences of the rates each second, which are noise and
//! nothing else, at every shift in time, as they are and as means of ten seconds; two runs of one unit have different noise, a
//! resampled, thinned or smoothed copy has the same.

use hrg_data::error::BadInput;
use hrg_data::recording::names;
use hrg_data::recording::steps::{Run, Steps};
use hrg_data::recording::Recording;
use realfft::RealFftPlanner;
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Consecutive rows that must agree. With only three bits of noise a row they agree by chance once in 1e28 pairs.
const WINDOW: usize = 32;
/// Windows that must agree before rows are called shared.
const LEAST_WINDOWS: usize = 4;
/// Rates that differ by less than this are the same, deg/h: what a sum and its difference with the earth rate round to.
const SAME_DPH: f64 = 1e-6;
/// Seconds over which noise is compared.
const STRETCH_S: usize = 256;
/// Correlation of the noise of two stretches above which they are the same data.
const SAME_NOISE: f64 = 0.98;

/// Permission to use runs of different units together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Units {
    /// Runs of different units are refused.
    #[default]
    Same,
    /// The user has stated that they may differ.
    Different,
}

/// Refuses runs of different units, unless `units` allows them; then a note says so. A run that names no unit may be of any
/// ([`hrg_data::recording::facts::agree`] says so).
///
/// # Errors
/// One sentence that names two of them.
pub fn same_unit(recordings: &[&Recording], units: Units) -> Result<Option<String>, BadInput> {
    let mut named = recordings.iter().filter(|r| r.unit() != names::NONE);
    let Some(first) = named.next() else { return Ok(None) };
    let Some(other) = named.find(|r| r.unit() != first.unit()) else { return Ok(None) };
    let pair = format!("{} is of unit {}, {} of unit {}", called(first), first.unit(), called(other), other.unit());
    match units {
        Units::Same => Err(BadInput::new(format!(
            "the recordings are of different units ({pair}): a calibration belongs to one unit; --different-units if you mean it"
        ))),
        Units::Different => Ok(Some(format!("the recordings are of different units: {pair}"))),
    }
}

/// Overlap of two recordings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shared {
    /// Time in the first one at which the data begin that both have, s on its own clock.
    pub first_s: f64,
    /// The same in the second one.
    pub second_s: f64,
}

/// Refuses recordings of which two share data. `roles` says what each is given as, in words for the sentence.
///
/// # Errors
/// One sentence that names both and where they overlap.
pub fn require(recordings: &[(&Recording, &str)]) -> Result<(), BadInput> {
    for (k, (a, role_a)) in recordings.iter().enumerate() {
        for (b, role_b) in &recordings[k + 1..] {
            if let Some(s) = shared(a, b) {
                return Err(BadInput::new(format!(
                    "the {role_a} recording {} and the {role_b} recording {} share data (the first from {:.0} s on, the second from {:.0} s on): an error judged on data that were learnt from says nothing; give runs of different power-ons",
                    called(a),
                    called(b),
                    s.first_s,
                    s.second_s
                )));
            }
        }
    }
    Ok(())
}

/// The file, or where there is none the name of the run.
fn called(r: &Recording) -> String {
    if r.source.is_empty() {
        format!("\"{}\"", r.meta("run").unwrap_or("unnamed"))
    } else {
        r.source.clone()
    }
}

/// Finds data that two recordings share; `None` if they are independent.
#[must_use]
pub fn shared(a: &Recording, b: &Recording) -> Option<Shared> {
    shared_rows(a, b).or_else(|| shared_noise(a, b))
}

/// Hashes of windows of consecutive rows, with the row at which each begins. Of a long recording every window whose hash
/// ends in zeros, so that equal windows are kept in both.
fn windows(r: &Recording, keep: u64) -> Vec<(u64, usize)> {
    let axes: Vec<usize> = (0..r.rate_dph.len()).filter(|&a| !r.rate_dph[a].is_empty()).collect();
    let rows: Vec<u64> = (0..r.time_s.len())
        .map(|k| {
            let mut h = DefaultHasher::new();
            for &a in &axes {
                let v = r.rate_dph[a][k] + r.earth_rate_dph.map_or(0.0, |e| e[a]);
                // A value that is missing or was taken out says nothing.
                (if v.is_finite() { (v / SAME_DPH).round() as i64 } else { i64::MIN }).hash(&mut h);
            }
            h.finish()
        })
        .collect();
    rolling(&rows)
        .into_iter()
        .enumerate()
        .filter(|(_, hash)| hash % keep == 0)
        // Rows that stand still (a stuck or a missing channel) are alike in all files.
        .filter(|(k, _)| 2 * rows[*k..k + WINDOW].windows(2).filter(|w| w[0] != w[1]).count() >= WINDOW)
        .map(|(k, hash)| (hash, k))
        .collect()
}

/// A hash of each [`WINDOW`] consecutive values, each from the one before it (Karp and Rabin 1987).
fn rolling(rows: &[u64]) -> Vec<u64> {
    const BASE: u64 = 0x9E37_79B9_7F4A_7C15;
    let leaving = (0..WINDOW).fold(1u64, |p, _| p.wrapping_mul(BASE));
    let mut hash = 0u64;
    let mut out = Vec::with_capacity(rows.len());
    for (k, row) in rows.iter().enumerate() {
        hash = hash.wrapping_mul(BASE).wrapping_add(*row);
        if k >= WINDOW {
            hash = hash.wrapping_sub(rows[k - WINDOW].wrapping_mul(leaving));
        }
        if k + 1 >= WINDOW {
            // The low bits of a product depend on few bits of its factors: fold the high ones in.
            out.push(hash ^ (hash >> 32));
        }
    }
    out
}

fn shared_rows(a: &Recording, b: &Recording) -> Option<Shared> {
    let keep = (a.time_s.len().max(b.time_s.len()) / 200_000) as u64 + 1;
    let first: HashMap<u64, usize> = windows(a, keep).into_iter().rev().collect();
    let both: Vec<(usize, usize)> =
        windows(b, keep).into_iter().filter_map(|(h, k)| first.get(&h).map(|f| (*f, k))).collect();
    let (f, k) = *both.first()?;
    (both.len() * keep as usize >= LEAST_WINDOWS).then(|| Shared { first_s: a.time_s[f], second_s: b.time_s[k] })
}

/// Parameters of the comparison of noise on one time scale.
struct Scale {
    /// Seconds that are averaged before differences are formed.
    mean_s: usize,
    /// Values in a stretch.
    stretch: usize,
    /// Correlation of two stretches, of either sign, above which they are the same data.
    same: f64,
}

/// Second by second: parts of a file as short as two stretches are found. By means of ten seconds: what was filtered, thinned out or
/// interpolated still has its slower noise; two runs of one unit have not, and their correlation over a hundred values stays within 0.5.
const SCALES: [Scale; 2] =
    [Scale { mean_s: 1, stretch: STRETCH_S, same: SAME_NOISE }, Scale { mean_s: 10, stretch: 100, same: 0.7 }];

/// The scales on which recordings with rows so far apart have noise of their own: between rows there are straight lines, alike in all.
fn scales(step_s: f64) -> Vec<Scale> {
    let slow = Scale { mean_s: step_s.ceil() as usize, stretch: 100, same: 0.7 };
    let own = SCALES.into_iter().filter(|s| s.mean_s as f64 > step_s - 0.5);
    if step_s > 10.5 {
        vec![slow]
    } else {
        own.collect()
    }
}

/// Second differences of the means of the rates of one axis, zero where one is missing; scaled to unit variance.
fn noise(steps: &Steps, a: usize, mean_s: usize) -> Vec<f64> {
    let v = &hrg_data::numeric::stats::block_means(&steps.rate_dph[a], mean_s);
    let mut d: Vec<f64> =
        v.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]).map(|d| if d.is_finite() { d } else { 0.0 }).collect();
    let scale = (d.iter().map(|x| x * x).sum::<f64>() / d.len().max(1) as f64).sqrt();
    // A wild value must not pass for noise that is shared.
    d.iter_mut().for_each(|x| *x = if scale > 0.0 { (*x / scale).clamp(-4.0, 4.0) } else { 0.0 });
    d
}

/// The same noise at some shift: the shift by correlation of the whole, then stretch by stretch.
fn shared_noise(a: &Recording, b: &Recording) -> Option<Shared> {
    let (sa, sb) = (Steps::new(a).ok()?, Steps::new(b).ok()?);
    scales(a.step_s().max(b.step_s())).iter().find_map(|scale| {
        (0..sa.rate_dph.len()).find_map(|axis| {
            let (x, y) = (noise(&sa, axis, scale.mean_s), noise(&sb, axis, scale.mean_s));
            best_shifts(&x, &y).into_iter().find_map(|shift| {
                let at = stretches(&x, &y, shift, scale)?;
                let seconds = |k: i64| (k * scale.mean_s as i64) as f64;
                let second = sb.start_s + seconds(at as i64 - shift);
                Some(Shared { first_s: sa.start_s + seconds(at as i64), second_s: second })
            })
        })
    })
}

/// Shifts at which the correlation of two series stands out most: `x[k]` beside `y[k - shift]`.
fn best_shifts(x: &[f64], y: &[f64]) -> Vec<i64> {
    let n = (x.len() + y.len()).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, back) = (planner.plan_fft_forward(n), planner.plan_fft_inverse(n));
    let spectrum = |v: &[f64]| {
        let mut padded = v.to_vec();
        padded.resize(n, 0.0);
        let mut out = forward.make_output_vec();
        // Lengths are those that the plan asks for.
        let _ = forward.process(&mut padded, &mut out);
        out
    };
    let mut product: Vec<_> = spectrum(x).iter().zip(spectrum(y)).map(|(x, y)| x * y.conj()).collect();
    if let Some(p) = product.first_mut() {
        p.im = 0.0;
    }
    if let Some(p) = product.last_mut() {
        p.im = 0.0;
    }
    let mut c = back.make_output_vec();
    if back.process(&mut product, &mut c).is_err() {
        return Vec::new();
    }
    let mut places: Vec<usize> = (0..n).collect();
    let most = 4.min(n);
    places.select_nth_unstable_by(most - 1, |i, j| c[*j].abs().total_cmp(&c[*i].abs()));
    places[..most].iter().map(|&k| if k < x.len() { k as i64 } else { k as i64 - n as i64 }).collect()
}

/// First place in `x` of a stretch whose noise is that of `y` at a shift, if at least two are.
fn stretches(x: &[f64], y: &[f64], shift: i64, scale: &Scale) -> Option<usize> {
    let from = shift.max(0) as usize;
    let to = x.len().min((y.len() as i64 + shift).max(0) as usize);
    let n = scale.stretch;
    let same: Vec<usize> = (from..to.saturating_sub(n))
        .step_by(n)
        .filter(|&k| {
            let u = &x[k..k + n];
            let at = (k as i64 - shift) as usize;
            let v = &y[at..at + n];
            let dot = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
            let power = (dot(u, u) * dot(v, v)).sqrt();
            let active = u.iter().filter(|x| **x != 0.0).count();
            // Differences of noise change their sign from one to the next; those of a smooth course go on, and are alike in many runs.
            let smooth = dot(&u[1..], &u[..n - 1]) > 0.5 * dot(u, u);
            2 * active > n && !smooth && dot(u, v).abs() > scale.same * power
        })
        .collect();
    (same.len() >= 2).then(|| same[0])
}

/// A run whose temperatures differ by less than this from another's, on average, repeats its profile, C.
const REPEATS_WITHIN_C: f64 = 1.0;

/// Temperatures of the first axis of a run, one a minute, from where it is judged on, C.
fn by_minutes(run: &Run) -> Vec<f64> {
    let a = run.steps.present().next().unwrap_or(0);
    let from = run.steps.run_in;
    (from..run.steps.len()).step_by(60).map(|k| run.state(k, a).map_or(f64::NAN, |(t, _)| f64::from(t))).collect()
}

/// True where a run has the temperatures of an earlier one, minute by minute from the first one on, and does not last longer: it
/// then shows nothing of other temperatures and ramps.
#[must_use]
pub fn repeats(run: &Run, earlier: &Run) -> bool {
    let (run, earlier) = (by_minutes(run), by_minutes(earlier));
    let apart: Vec<f64> = run.iter().zip(&earlier).map(|(x, y)| (x - y).abs()).filter(|d| d.is_finite()).collect();
    let mean = apart.iter().sum::<f64>() / apart.len().max(1) as f64;
    100 * run.len() <= 101 * earlier.len() && mean < REPEATS_WITHIN_C
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrg_simulate::{Plan, Profile};

    fn run(seed: u64) -> Recording {
        Plan::of(Profile::parse("fast").expect("named"), 21, seed).simulate().recording
    }

    fn part(r: &Recording, from: usize, to: usize) -> Recording {
        let mut out = r.clone();
        let cut = |v: &mut Vec<f64>| *v = v[from..to].to_vec();
        cut(&mut out.time_s);
        out.frequency_hz.iter_mut().for_each(cut);
        out.rate_dph.iter_mut().for_each(cut);
        out.optional.iter_mut().for_each(|(_, v)| cut(v));
        out
    }

    #[test]
    fn two_runs_of_a_unit_are_independent() {
        for seed in 1..6 {
            assert_eq!(shared(&run(seed), &run(seed + 100)), None);
        }
    }

    #[test]
    fn copies_parts_and_other_attitudes_are_found() {
        let r = run(1);
        assert!(shared(&r, &r).is_some());
        let n = r.time_s.len();
        // Two parts that share two minutes.
        let found = shared(&part(&r, 0, n / 2 + 60), &part(&r, n / 2 - 60, n)).expect("overlap");
        assert!((found.first_s - (n / 2 - 60) as f64).abs() < 5.0 && found.second_s == found.first_s, "{found:?}");
        assert_eq!(
            shared(&part(&r, 0, n / 2), &part(&r, n / 2, n)),
            None,
            "parts that do not overlap are independent here"
        );
        // The same data with other times and with the earth rate taken off.
        let mut other = r.clone();
        other.time_s.iter_mut().for_each(|t| *t += 5000.0);
        other.rate_dph[0].iter_mut().for_each(|v| *v -= 7.520_533_5);
        let own = r.earth_rate_dph.unwrap_or_default();
        other.earth_rate_dph = Some([own[0] + 7.520_533_5, own[1], own[2]]);
        assert!(shared(&r, &other).is_some());
    }

    #[test]
    fn a_resampled_copy_is_found() {
        let r = run(2);
        // Rounded to other digits, so that no row is the same.
        let mut other = part(&r, 300, r.time_s.len());
        other.rate_dph.iter_mut().for_each(|v| v.iter_mut().for_each(|x| *x = (*x * 50.0).round() / 50.0));
        assert!(shared_rows(&r, &other).is_none());
        let found = shared(&r, &other).expect("the same noise");
        assert!((found.first_s - found.second_s).abs() < 1.0, "{found:?}");
        // Thinned out to means of two seconds, smoothed, turned round in sign.
        let pairs = |v: &Vec<f64>| v.chunks_exact(2).map(|p| 0.5 * (p[0] + p[1])).collect::<Vec<f64>>();
        let mut thin = r.clone();
        thin.time_s = pairs(&r.time_s);
        thin.frequency_hz.iter_mut().for_each(|v| *v = pairs(v));
        thin.rate_dph.iter_mut().for_each(|v| *v = pairs(v));
        thin.optional.clear();
        assert!(shared(&r, &thin).is_some(), "means of two seconds");
        let mut smooth = r.clone();
        smooth.rate_dph.iter_mut().for_each(|v| {
            let s: Vec<f64> = v.windows(3).map(|w| w.iter().sum::<f64>() / 3.0).collect();
            v[1..=s.len()].copy_from_slice(&s);
        });
        assert!(shared(&r, &smooth).is_some(), "smoothed");
        let mut negative = r.clone();
        negative.rate_dph.iter_mut().flatten().for_each(|v| *v = -*v);
        assert!(shared(&r, &negative).is_some(), "turned round");
    }

    #[test]
    fn channels_that_stand_still_share_nothing() {
        let (mut a, mut b) = (run(3), run(4));
        for r in [&mut a, &mut b] {
            r.rate_dph[1].fill(0.0);
            r.rate_dph[2].fill(f64::NAN);
            r.rate_dph[0].iter_mut().for_each(|v| *v = v.round());
        }
        assert_eq!(shared(&a, &b), None);
    }

    #[test]
    fn the_sentence_names_both() {
        let r = run(5);
        let e = require(&[(&r, "train"), (&run(6), "train"), (&r, "verify")]).expect_err("shared").0;
        assert!(e.contains("the train recording") && e.contains("the verify recording"), "{e}");
    }
}
