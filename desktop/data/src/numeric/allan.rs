//! Overlapping Allan deviation with confidence bars, and what is read off it: angle random walk, bias instability, rate
//! random walk.

use crate::axes::AXIS_NAMES;
use crate::error::BadInput;
use crate::numeric::stats::mean;
use crate::plot;
use crate::plot::{Panel, Series};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::borrow::Cow;

/// One point of the curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    /// Averaging time, s.
    pub tau_s: f64,
    /// Deviation, in the unit of the values.
    pub deviation: f64,
    /// The true value lies above this with 84 %.
    pub low: f64,
    /// And below this with 84 %: the bar is one sigma.
    pub high: f64,
    /// Differences that the point is the mean of.
    pub pairs: usize,
}

/// Samples that are summed up before the carry is looked after, in so many parts.
const BLOCK: usize = 256;
const PARTS: usize = 4;

/// Running sums of `(values - m) step_s`, from 0. Sums of blocks are added to the sum of the blocks before with its rounding
/// carried along: a day of samples loses nothing. Within a block four parts are summed up side by side, so that no addition waits
/// for the one before.
fn angles(values: &[f64], m: f64, step_s: f64) -> Vec<f64> {
    let rate = |v: f64| (v - m) * step_s;
    let mut angle = vec![0.0; values.len() + 1];
    let (mut sum, mut carry) = (0.0f64, 0.0f64);
    for (from, to) in values.chunks(BLOCK).zip(angle[1..].chunks_mut(BLOCK)) {
        let mut offset = 0.0 - carry;
        if from.len() == BLOCK {
            const PART: usize = BLOCK / PARTS;
            let mut local = [0.0; PARTS];
            for i in 0..PART {
                for (p, local) in local.iter_mut().enumerate() {
                    *local += rate(from[p * PART + i]);
                    to[p * PART + i] = *local;
                }
            }
            for (to, local) in to.chunks_exact_mut(PART).zip(local) {
                to.iter_mut().for_each(|a| *a = sum + (offset + *a));
                offset += local;
            }
        } else {
            for (v, to) in from.iter().zip(to) {
                offset += rate(*v);
                *to = sum + offset;
            }
        }
        let next = sum + offset;
        carry = (next - sum) - offset;
        sum = next;
    }
    angle
}

/// Sum of the squares of `c - 2 b + a`. In sixteen sums, so that no addition waits for the one before, and the same on every
/// processor.
// Compiled for wider vectors, too, where there are any; the sums are the same ones.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
fn second_differences(a: &[f64], b: &[f64], c: &[f64]) -> f64 {
    const WIDTH: usize = 16;
    let mut sums = [0.0f64; WIDTH];
    let (a, b, c) = (a.chunks_exact(WIDTH), b.chunks_exact(WIDTH), c.chunks_exact(WIDTH));
    let rest = a.remainder().iter().zip(b.remainder()).zip(c.remainder());
    let rest: f64 = rest.map(|((a, b), c)| (c - 2.0 * b + a) * (c - 2.0 * b + a)).sum();
    for ((a, b), c) in a.zip(b).zip(c) {
        for k in 0..WIDTH {
            let d = c[k] - 2.0 * b[k] + a[k];
            sums[k] += d * d;
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Longest gap that is bridged, in values.
const BRIDGED: usize = 3;
/// Largest share of the values that is bridged: the deviations are then off by at most half of it.
const MOST_BRIDGED: f64 = 0.02;

/// The values between gaps. Single missing ones (up to three in a row) take the mean of their neighbours where they are few; a longer
/// gap parts the data.
fn stretches(values: &[f64]) -> Vec<Cow<'_, [f64]>> {
    let missing = values.iter().filter(|v| !v.is_finite()).count();
    if missing == 0 {
        return vec![Cow::Borrowed(values)];
    }
    let mut bridged = values.to_vec();
    if missing as f64 <= MOST_BRIDGED * values.len() as f64 {
        let mut k = 1;
        while k < bridged.len() {
            if bridged[k].is_finite() || !bridged[k - 1].is_finite() {
                k += 1;
                continue;
            }
            let end = (k..bridged.len()).find(|e| bridged[*e].is_finite()).unwrap_or(bridged.len());
            if end < bridged.len() && end - k <= BRIDGED {
                let between = 0.5 * (bridged[k - 1] + bridged[end]);
                bridged[k..end].fill(between);
            }
            k = end;
        }
    }
    let parts = bridged.split(|v| !v.is_finite()).filter(|part| !part.is_empty());
    parts.map(|part| Cow::Owned(part.to_vec())).collect()
}

/// Overlapping Allan deviation of rates `step_s` apart at averaging times of so many steps. Only differences of values without a gap
/// between them count. Times beyond a third of the longest stretch without a gap are left out.
#[must_use]
pub fn overlapping(values: &[f64], step_s: f64, steps: &[usize]) -> Vec<Point> {
    let m = mean(values);
    let stretches: Vec<Vec<f64>> = stretches(values).iter().map(|part| angles(part, m, step_s)).collect();
    let longest = stretches.iter().map(|angle| angle.len() - 1).max().unwrap_or(0);
    let usable = |n: usize| stretches.iter().filter(move |angle| angle.len() > 2 * n);
    let deviation = |n: usize| -> (f64, usize) {
        let (mut squares, mut pairs) = (0.0, 0);
        for angle in usable(n) {
            let count = angle.len() - 2 * n;
            squares += second_differences(&angle[..count], &angle[n..n + count], &angle[2 * n..]);
            pairs += count;
        }
        ((squares / (2.0 * pairs as f64)).sqrt() / (n as f64 * step_s), pairs)
    };
    let mut out: Vec<Point> = Vec::new();
    for &n in steps.iter().filter(|n| **n > 0 && 3 * **n <= longest) {
        let (d, pairs) = deviation(n);
        let tau_s = n as f64 * step_s;
        out.push(Point { tau_s, deviation: d, low: d, high: d, pairs });
    }
    for k in 0..out.len() {
        let n = (out[k].tau_s / step_s).round();
        let count: usize = usable(n as usize).map(|angle| angle.len() - 1).sum();
        let edf = freedom(slope(&out, k), count as f64, n).max(1.0);
        out[k].low = out[k].deviation * (edf / chi_squared(edf, true)).sqrt();
        out[k].high = out[k].deviation * (edf / chi_squared(edf, false)).sqrt();
    }
    out
}

/// The value below which a chi-squared variable lies with 84 % (`upper`) or 16 %: one sigma of a normal one.
fn chi_squared(freedom: f64, upper: bool) -> f64 {
    let p = if upper { 0.8413 } else { 0.1587 };
    ChiSquared::new(freedom).map_or(f64::NAN, |chi| chi.inverse_cdf(p))
}

/// Averaging times in octaves, as steps: quick.
#[must_use]
pub fn octaves(values: usize) -> Vec<usize> {
    (0..).map(|k| 1usize << k).take_while(|n| 3 * n <= values).collect()
}

/// Averaging times for a curve: about ten a decade, as steps.
#[must_use]
pub fn decades(values: usize) -> Vec<usize> {
    let mut out: Vec<usize> =
        (0..).map(|k| 10f64.powf(f64::from(k) / 10.0).round() as usize).take_while(|n| 3 * n <= values).collect();
    out.dedup();
    out
}

/// Local slope of the curve in logarithms, over the neighbours of a point.
fn slope(points: &[Point], k: usize) -> f64 {
    let a = &points[k.saturating_sub(2)];
    let b = &points[(k + 2).min(points.len() - 1)];
    if b.tau_s > a.tau_s && a.deviation > 0.0 {
        (b.deviation / a.deviation).ln() / (b.tau_s / a.tau_s).ln()
    } else {
        -0.5
    }
}

/// Equivalent degrees of freedom of a point over `n` of `count` samples, by the kind of noise that the local slope tells
/// (NIST SP 1065, table 5).
fn freedom(slope: f64, count: f64, n: f64) -> f64 {
    let c = count + 1.0;
    if slope < -0.25 {
        // White rate noise.
        (3.0 * (c - 1.0) / (2.0 * n) - 2.0 * (c - 2.0) / c) * 4.0 * n * n / (4.0 * n * n + 5.0)
    } else if slope < 0.25 {
        // Flicker.
        if n < 1.5 {
            2.0 * (c - 2.0) * (c - 2.0) / (2.3 * c - 4.9)
        } else {
            5.0 * c * c / (4.0 * n * (c + 3.0 * n))
        }
    } else {
        // Random walk of rate.
        (c - 2.0) / n * ((c - 1.0).powi(2) - 3.0 * n * (c - 1.0) + 4.0 * n * n) / (c - 3.0).powi(2)
    }
}

/// Values read off a curve of rates in deg/h; `None` if the curve does not show them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Readings {
    /// Angle random walk, deg per root hour: the longest plateau of the deviation times the root of the averaging time.
    pub angle_random_walk_deg_per_root_h: Option<f64>,
    /// Its 95 % interval, which holds the plateau.
    pub angle_random_walk_interval_deg_per_root_h: Option<[f64; 2]>,
    /// Averaging times at the ends of the plateau, s.
    pub angle_random_walk_plateau_s: Option<[f64; 2]>,
    /// Bias instability, deg/h: the least deviation over 0.664.
    pub bias_instability_dph: Option<f64>,
    /// At this averaging time, s.
    pub bias_instability_at_s: Option<f64>,
    /// Set if the curve has turned up again: if not, the bias instability is an upper bound.
    pub bias_instability_reached: bool,
    /// Rate random walk, deg/h per root hour, where the curve rises with slope +1/2.
    pub rate_random_walk_dph_per_root_h: Option<f64>,
}

/// Flicker of coefficient `B` has a deviation of `0.664 B`: the square root of 2 ln 2 / pi.
pub const FLICKER: f64 = 0.664;
/// A slope within this of the wanted one counts.
const NEAR: f64 = 0.12;
/// Points of a plateau lie within this of its level, as a share, or within their own bar where that is wider.
const LEVEL: f64 = 0.05;
/// Allowed deviation of a point of a plateau beside its bar, as a share: the most precise ones do not outvote the others.
const UNEVEN: f64 = 0.03;
/// Points with a wider bar, by logarithm, say nothing of a plateau.
const WIDEST_BAR: f64 = 0.2;
/// Ratio of the averaging times at the ends of a plateau, at least.
const SHORTEST_PLATEAU: f64 = 2.5;

/// A level of `deviation * sqrt(tau)`.
#[derive(Debug, Clone, Copy)]
struct Plateau {
    level: f64,
    /// 95 % interval.
    interval: [f64; 2],
    /// Averaging times at its ends, s.
    ends_s: [f64; 2],
}

/// The longest plateau of `deviation * sqrt(tau)`, in deg per root hour: where the rate is white noise. A part of it counts by how well
/// its level is known, so that a chance level among few differences is no plateau.
fn plateau(points: &[Point]) -> Option<Plateau> {
    // By logarithms: level, bar, averaging time.
    let usable = |p: &&Point| p.pairs > 20 && p.deviation > 0.0 && (p.high / p.deviation).ln() < WIDEST_BAR;
    let all: Vec<(f64, f64, f64)> = points
        .iter()
        .filter(usable)
        .map(|p| (p.deviation.ln() + 0.5 * (p.tau_s / 3600.0).ln(), (p.high / p.deviation).ln(), p.tau_s.ln()))
        .collect();
    let mut best: Option<(f64, Plateau)> = None;
    for from in 0..all.len() {
        for to in from + 2..all.len() {
            let part = &all[from..=to];
            let share = |p: &(f64, f64, f64)| 1.0 / (p.1.powi(2) + UNEVEN.powi(2));
            let weight: f64 = part.iter().map(share).sum();
            let level = part.iter().map(|p| p.0 * share(p)).sum::<f64>() / weight;
            let long = part[part.len() - 1].2 - part[0].2;
            let flat = part.iter().all(|p| (p.0 - level).abs() <= LEVEL.max(p.1));
            if !flat || long < SHORTEST_PLATEAU.ln() || best.as_ref().is_some_and(|b| b.0 >= weight) {
                continue;
            }
            // The points overlap, so the mean of all is hardly better known than one of them; and the plateau is uneven.
            let bar = part.iter().map(|p| share(p) * p.1.powi(2)).sum::<f64>() / weight;
            let uneven = part.iter().map(|p| share(p) * (p.0 - level).powi(2)).sum::<f64>() / weight;
            let half = 1.96 * (bar + uneven).sqrt();
            let interval = [(level - half).exp(), (level + half).exp()];
            let ends_s = [part[0].2.exp(), part[part.len() - 1].2.exp()];
            best = Some((weight, Plateau { level: level.exp(), interval, ends_s }));
        }
    }
    best.map(|b| b.1)
}

/// Reads a curve. The rate random walk is the mean (by logarithms) of what the points with the right slope say.
#[must_use]
pub fn read(points: &[Point]) -> Readings {
    let mean_of = |wanted: f64, value: &dyn Fn(&Point) -> f64| -> Option<f64> {
        let logs: Vec<f64> = (0..points.len())
            .filter(|&k| points.len() > 4 && (slope(points, k) - wanted).abs() < NEAR && points[k].pairs > 20)
            .map(|k| value(&points[k]).ln())
            .collect();
        (logs.len() >= 3).then(|| mean(&logs).exp())
    };
    let least = points.iter().min_by(|a, b| a.deviation.total_cmp(&b.deviation));
    let reached = least.is_some_and(|l| points.iter().any(|p| p.tau_s > l.tau_s && p.low > l.deviation));
    let plateau = plateau(points);
    Readings {
        angle_random_walk_deg_per_root_h: plateau.map(|p| p.level),
        angle_random_walk_interval_deg_per_root_h: plateau.map(|p| p.interval),
        angle_random_walk_plateau_s: plateau.map(|p| p.ends_s),
        bias_instability_dph: least.map(|p| p.deviation / FLICKER),
        bias_instability_at_s: least.map(|p| p.tau_s),
        bias_instability_reached: reached,
        rate_random_walk_dph_per_root_h: mean_of(0.5, &|p| p.deviation * (3.0 * 3600.0 / p.tau_s).sqrt()),
    }
}

/// The report of `hrg allan` for one axis.
#[derive(Debug, Clone, Serialize)]
pub struct Axis {
    /// Its name.
    pub axis: &'static str,
    /// Values, missing ones among them.
    pub values: usize,
    /// Missing values.
    pub missing: usize,
    /// Values read off the curve.
    pub readings: Readings,
    /// The curve.
    pub curve: Vec<Point>,
}

/// Refuses values of which too few are there for an Allan deviation.
///
/// # Errors
/// One sentence without the axis.
pub fn enough(values: &[f64]) -> Result<(), BadInput> {
    let missing = values.iter().filter(|v| !v.is_finite()).count();
    if values.len() < 100 || 10 * missing > values.len() {
        return Err(BadInput::new(format!(
            "{} values, {missing} of them missing; an Allan deviation needs a hundred at the least, and nine of ten there",
            values.len()
        )));
    }
    Ok(())
}

/// Reports of axes by their numbers.
///
/// # Errors
/// If there are too few values, or many are missing.
pub fn report(rates: &[(usize, &[f64])], step_s: f64) -> Result<Vec<Axis>, BadInput> {
    let mut out = Vec::new();
    for &(a, values) in rates {
        enough(values).map_err(|e| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a])))?;
        let missing = values.iter().filter(|v| !v.is_finite()).count();
        let curve = overlapping(values, step_s, &decades(values.len()));
        out.push(Axis { axis: AXIS_NAMES[a], values: values.len(), missing, readings: read(&curve), curve });
    }
    Ok(out)
}

/// The curves with their bars.
///
/// # Errors
/// If the drawing library fails.
pub fn picture(axes: &[Axis], title: &str) -> anyhow::Result<String> {
    let mut series = Vec::new();
    for (a, axis) in axes.iter().enumerate() {
        let points = |f: &dyn Fn(&Point) -> f64| axis.curve.iter().map(|p| (p.tau_s, f(p))).collect();
        series.push(Series { label: axis.axis.into(), points: points(&|p| p.deviation), colour: a + 1, dots: false });
        // The bars: from low to high at each time, parted by nothing.
        let bars =
            axis.curve.iter().flat_map(|p| [(p.tau_s, p.low), (p.tau_s, p.high), (f64::NAN, f64::NAN)]).collect();
        series.push(Series { label: String::new(), points: bars, colour: a + 1, dots: false });
    }
    let panel = Panel {
        title: title.into(),
        x: "averaging time [s]".into(),
        y: "Allan deviation [deg/h]".into(),
        log: true,
        series,
    };
    plot::svg(&[panel], 1, 900, 520)
}

#[cfg(test)]
mod tests {
    use super::super::draws::Draws;
    use super::*;

    #[test]
    fn quantiles_of_chi_squared() {
        // Degrees of freedom, quantiles of 0.8413 and 0.1587; computed by scipy.stats.chi2.ppf.
        for (freedom, upper, lower) in [
            (1.0, 1.9865698, 0.0400924142),
            (1.5, 2.87012419, 0.160706836),
            (4.0, 6.59831819, 1.41662744),
            (10.0, 14.3244535, 5.6811827),
            (60.0, 70.8917751, 49.108727),
            (256.7259503382658, 279.351683, 234.099956),
            (2000.0, 2063.22309, 1936.77645),
            (600000.0, 601095.242, 598904.758),
        ] {
            for (wanted, got) in [(upper, chi_squared(freedom, true)), (lower, chi_squared(freedom, false))] {
                assert!((got / wanted - 1.0).abs() < 1e-3, "{freedom}: {got} for {wanted}");
            }
        }
    }

    /// The data of host-tests/reference/allan.py.
    fn data(n: usize) -> Vec<f64> {
        let (mut x, mut walk, mut slow) = (Draws::new(1), 0.0, 0.0);
        (0..n)
            .map(|_| {
                let white = x.centred();
                let step = x.centred();
                walk += 0.002 * step;
                slow = 0.99 * slow + 0.05 * step;
                3.0 + white + slow + walk
            })
            .collect()
    }

    #[test]
    fn as_allantools() {
        let reference = include_str!("../../../../host-tests/reference/allan.csv");
        let values = data(10_000);
        let mut compared = 0;
        for line in reference.lines().skip(2) {
            let cells: Vec<f64> = line.split(',').map(|c| c.parse().expect("a number")).collect();
            let p = overlapping(&values, 0.5, &[(cells[0] * 2.0) as usize])[0];
            assert!((p.deviation / cells[1] - 1.0).abs() < 1e-9, "{line}: {}", p.deviation);
            assert_eq!(p.pairs, cells[2] as usize);
            compared += 1;
        }
        assert!(compared >= 12, "{compared} points");
    }

    #[test]
    fn gaps_are_left_out_and_not_bridged() {
        let mut x = Draws::new(3);
        let white: Vec<f64> = (0..20_000).map(|_| x.centred() * 12f64.sqrt()).collect();
        // A tenth is missing, in pieces: bridged with the mean, the deviation at one step would be 5 % too small, at a hundred more.
        let mut gapped = white.clone();
        gapped.chunks_mut(500).for_each(|c| c[..50].fill(f64::NAN));
        for p in overlapping(&gapped, 1.0, &[1, 10, 100]) {
            assert!((p.deviation * p.tau_s.sqrt() - 1.0).abs() < 0.05, "{p:?}");
        }
        assert!(overlapping(&gapped, 1.0, &[151]).is_empty(), "no stretch is three times as long");
        // Single values that are missing part nothing.
        let mut spiked = white.clone();
        spiked.iter_mut().step_by(100).for_each(|v| *v = f64::NAN);
        let (whole, spiked) = (overlapping(&white, 1.0, &[1, 1000]), overlapping(&spiked, 1.0, &[1, 1000]));
        for (w, s) in whole.iter().zip(&spiked) {
            assert!((w.deviation / s.deviation - 1.0).abs() < 0.03, "{w:?} {s:?}");
        }
        assert_eq!(spiked.len(), 2);
        assert!(overlapping(&[f64::NAN; 300], 1.0, &[1]).is_empty());
        // Half of it is missing: refused.
        gapped.chunks_mut(500).for_each(|c| c[..250].fill(f64::NAN));
        assert!(report(&[(1, &gapped)], 1.0).expect_err("refused").0.contains("axis y: 20000 values, 10000 of them"));
    }

    #[test]
    fn the_interval_of_the_random_walk_holds_the_plateau() {
        // White noise, and quantisation noise that hides it at the shortest times.
        let mut held = 0;
        for seed in 1..=40u64 {
            let mut x = Draws::new(seed);
            let root12 = 12f64.sqrt();
            let mut before = 0.0;
            let rates: Vec<f64> = (0..40_000)
                .map(|_| {
                    let angle = 3.0 * x.centred();
                    let rate = root12 * x.centred() + angle - before;
                    before = angle;
                    rate
                })
                .collect();
            let r = read(&overlapping(&rates, 1.0, &decades(rates.len())));
            let [low, high] = r.angle_random_walk_interval_deg_per_root_h.expect("white noise shows");
            held += usize::from((low..high).contains(&(1.0 / 60.0)));
            assert!(high / low < 1.6, "seed {seed}: {low} to {high}");
            let [from, to] = r.angle_random_walk_plateau_s.expect("a plateau");
            assert!(from > 1.0, "seed {seed}: {from} to {to} s");
        }
        assert!(held >= 36, "{held} of 40");
    }

    #[test]
    fn what_was_put_in_is_read_off() {
        // White noise of 2 deg/h a second: 2 / 60 deg per root hour.
        let mut x = Draws::new(5);
        let root12 = 12f64.sqrt();
        let white: Vec<f64> = (0..40_000).map(|_| 2.0 * root12 * x.centred()).collect();
        let r = read(&overlapping(&white, 1.0, &decades(white.len())));
        let arw = r.angle_random_walk_deg_per_root_h.expect("white noise shows");
        assert!((arw * 60.0 / 2.0 - 1.0).abs() < 0.05, "{arw}");
        assert!(r.rate_random_walk_dph_per_root_h.is_none());
        // A random walk of 0.1 deg/h a root second: 6 deg/h per root hour.
        let mut sum = 0.0;
        let walk: Vec<f64> = (0..40_000)
            .map(|_| {
                sum += 0.1 * root12 * x.centred();
                sum
            })
            .collect();
        let r = read(&overlapping(&walk, 1.0, &decades(walk.len())));
        let rrw = r.rate_random_walk_dph_per_root_h.expect("a walk shows");
        assert!((rrw / 6.0 - 1.0).abs() < 0.25, "{rrw}");
    }

    #[test]
    fn bars_hold_the_truth_two_times_of_three() {
        let (mut inside, mut all) = (0, 0);
        for seed in 1..200u64 {
            let mut x = Draws::new(seed);
            let white: Vec<f64> = (0..600).map(|_| x.centred() * 12f64.sqrt()).collect();
            for p in overlapping(&white, 1.0, &[1, 3, 10, 30, 100]) {
                all += 1;
                inside += usize::from((p.low..p.high).contains(&(1.0 / p.tau_s.sqrt())));
            }
        }
        let share = f64::from(inside as u32) / f64::from(all as u32);
        assert!((0.6..0.76).contains(&share), "{share}");
    }
}
