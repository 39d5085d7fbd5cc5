//! Each figure of the report, with its interval and its conditions.

use super::{Bin, Mean, Quantity, BIN_C, SOAK};
use hrg_data::numeric::allan;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{block_means, mean, std_dev};
use hrg_data::recording::steps::{Run, Steps};
use hrg_data::recording::Recording;
use hrg_identify::fit::MEAN_S;
use hrg_identify::thermometer::lag;
use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};
use std::collections::VecDeque;
use std::fmt::Write as _;

/// A start is judged on this stretch after the first row, s.
const START_S: [usize; 2] = [0, 600];
/// Shortest stretch that an Allan deviation is taken of, s.
const STRETCH_S: usize = 1800;
/// On a soak the temperature, in means of a minute, stays within this, C.
const BAND_C: f64 = 0.5;
/// The temperature is smoothed over so many seconds.
const SMOOTHED_S: usize = 60;

/// `t` beyond which a share of 2.5 % lies.
pub(super) fn students(freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(1.96, |t| t.inverse_cdf(0.975))
}

/// Interval of a standard deviation of `n` values.
pub(super) fn deviation(values: &[f64]) -> Option<(f64, f64, f64)> {
    let n = values.iter().filter(|v| v.is_finite()).count();
    if n < 3 {
        return None;
    }
    let (s, freedom) = (std_dev(values), n as f64 - 1.0);
    let chi = ChiSquared::new(freedom).ok()?;
    Some((s, s * (freedom / chi.inverse_cdf(0.975)).sqrt(), s * (freedom / chi.inverse_cdf(0.025)).sqrt()))
}

/// Half of the 95 % interval of a mean of correlated values: their scatter, with the effective number of them by the correlation
/// of neighbours.
pub(super) fn half_width(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 3.0 {
        return f64::INFINITY;
    }
    let effective = (n * (1.0 - neighbours(values)) / (1.0 + neighbours(values))).clamp(2.0, n);
    students(effective - 1.0) * std_dev(values) / effective.sqrt()
}

/// Correlation of neighbouring values, 0 to 0.95.
pub(super) fn neighbours(values: &[f64]) -> f64 {
    let m = mean(values);
    let power: f64 = values.iter().map(|v| (v - m).powi(2)).sum();
    let both: f64 = values.windows(2).map(|w| (w[0] - m) * (w[1] - m)).sum();
    if power > 0.0 {
        (both / power).clamp(0.0, 0.95)
    } else {
        0.0
    }
}

pub(super) fn quantity(
    name: &'static str,
    unit: &'static str,
    v: Option<(f64, f64, f64)>,
    conditions: String,
) -> Quantity {
    Quantity { name, value: v.map(|v| v.0), low: v.map(|v| v.1), high: v.map(|v| v.2), unit, conditions }
}

pub(super) fn span_of_bias(bins: &[Bin]) -> Quantity {
    let name = "bias over temperature, peak to peak";
    let (Some(low), Some(high)) = (
        bins.iter().min_by(|x, y| x.mean_dph.total_cmp(&y.mean_dph)),
        bins.iter().max_by(|x, y| x.mean_dph.total_cmp(&y.mean_dph)),
    ) else {
        return quantity(name, "deg/h", None, "no temperatures".into());
    };
    let (v, w) = (high.mean_dph - low.mean_dph, low.half_width_dph.hypot(high.half_width_dph));
    let conditions = format!(
        "means over ranges {BIN_C:.0} C wide, from {:.1} to {:.1} C; lowest at {:.1} C, highest at {:.1} C",
        bins[0].from_c,
        bins[bins.len() - 1].to_c,
        low.temperature_c,
        high.temperature_c
    );
    let known = w.is_finite() && bins.len() > 1;
    quantity(name, "deg/h", known.then_some((v, (v - w).max(0.0), v + w)), conditions)
}

/// A coefficient with its interval: scatter of the residual, widened by the correlation of neighbours.
pub(super) fn coefficient(columns: &[Vec<f64>], y: &[f64], which: usize) -> Option<(f64, f64, f64)> {
    let f = lsq::fit(columns, y, None, &[]).ok()?;
    let rest: Vec<f64> =
        (0..y.len()).map(|k| y[k] - columns.iter().zip(&f.coefficients).map(|(c, b)| c[k] * b).sum::<f64>()).collect();
    let r = neighbours(&rest);
    let freedom = (y.len() as f64 * (1.0 - r) / (1.0 + r) - columns.len() as f64).max(1.0);
    let w = students(freedom) * f.std[which] * ((1.0 + r) / (1.0 - r)).sqrt();
    let v = f.coefficients[which];
    Some((v, v - w, v + w))
}

/// Time constant by which an axis' thermometer follows its case, or the chamber where no case was recorded: the mean over the runs that
/// show one. Its interval holds the scatter of the runs and the residual of each.
pub(super) fn thermal_lag(a: usize, runs: Option<&[Run]>) -> Quantity {
    let name = "thermal lag";
    let Some(runs) = runs else {
        return quantity(name, "s", None, "no temperatures".into());
    };
    let case = runs.iter().any(|r| lag::input_of(r, a, lag::Input::Case).is_some());
    let (input, body) = if case { (lag::Input::Case, "case") } else { (lag::Input::Chamber, "chamber") };
    let (mut found, mut why) = (Vec::new(), String::from("no run"));
    for run in runs {
        match lag::first_order(run, a, input, lag::Output::Frequency) {
            Ok(found_here) => found.push((found_here.lag.tau_s[0], 1.96 * found_here.lag.tau_std_s)),
            Err(e) => why = e.0,
        }
    }
    if found.is_empty() {
        return quantity(name, "s", None, why);
    }
    let (taus, widths): (Vec<f64>, Vec<f64>) = found.iter().copied().unzip();
    let n = taus.len() as f64;
    let scatter = if taus.len() > 1 { students(n - 1.0) * std_dev(&taus) / n.sqrt() } else { 0.0 };
    let own = (widths.iter().map(|w| w * w).sum::<f64>() / n).sqrt() / n.sqrt();
    let (v, w) = (mean(&taus), scatter.max(own));
    let conditions = format!(
        "first order, thermometer behind the {body}, in {} of {} runs; hrg fit lag prints the gain and the second lag",
        taus.len(),
        runs.len()
    );
    quantity(name, "s", Some((v, (v - w).max(0.0), v + w)), conditions)
}

pub(super) fn slope_of_temperature(means: &[Mean]) -> Quantity {
    let m: Vec<&Mean> = means.iter().filter(|m| m.t.is_finite()).collect();
    let middle = mean(&m.iter().map(|m| m.t).collect::<Vec<_>>());
    let columns = vec![vec![1.0; m.len()], m.iter().map(|m| m.t - middle).collect()];
    let y: Vec<f64> = m.iter().map(|m| m.rate).collect();
    let v = coefficient(&columns, &y, 1);
    let conditions = if v.is_some() {
        format!("straight line through {} means of 100 s", m.len())
    } else {
        "no temperatures".into()
    };
    quantity("bias temperature sensitivity", "deg/h per C", v, conditions)
}

/// Largest difference between heating and cooling at equal temperature, within a run.
pub(super) fn loop_width(means: &[Mean]) -> Quantity {
    let name = "largest loop width at equal temperature";
    let mut best: Option<(f64, f64, f64, usize)> = None;
    let temperature = |here: &[&Mean]| mean(&here.iter().map(|m| m.t).collect::<Vec<_>>());
    let mut count = 0;
    for run in 0..=means.iter().map(|m| m.run).max().unwrap_or(0) {
        for k in -40..=40 {
            let (from, to) = (f64::from(k) * 2.0, f64::from(k) * 2.0 + 2.0);
            let of = |sign: f64| -> Vec<&Mean> {
                let here = |m: &&Mean| m.run == run && m.t >= from && m.t < to && sign * m.ramp > SOAK;
                means.iter().filter(here).collect()
            };
            let (heating, cooling) = (of(1.0), of(-1.0));
            if heating.is_empty() || cooling.is_empty() {
                continue;
            }
            count += 1;
            let rate = |here: &[&Mean]| mean(&here.iter().map(|m| m.rate).collect::<Vec<_>>());
            let v = rate(&heating) - rate(&cooling);
            if best.is_none_or(|b| v.abs() > b.0.abs()) {
                let at = 0.5 * (temperature(&heating) + temperature(&cooling));
                best = Some((v, at, 1.0 / heating.len() as f64 + 1.0 / cooling.len() as f64, run));
            }
        }
    }
    let Some((v, at, share, run)) = best else {
        return quantity(
            name,
            "deg/h",
            None,
            "no temperature is passed both heating and cooling, faster than 0.1 C per minute".into(),
        );
    };
    // The scatter of one mean: what neighbours differ by, for the loop is not in it.
    let jumps: Vec<f64> =
        means.windows(2).filter(|w| w[0].run == w[1].run).map(|w| (w[1].rate - w[0].rate) / 2f64.sqrt()).collect();
    let scatter = (jumps.iter().map(|j| j * j).sum::<f64>() / jumps.len().max(1) as f64).sqrt();
    let w = students(jumps.len() as f64) * scatter * share.sqrt();
    quantity(
        name,
        "deg/h",
        Some((v.abs(), (v.abs() - w).max(0.0), v.abs() + w)),
        format!(
            "heating {} cooling, at {at:.0} C (bin of 2 C), recording {}; the largest of {count} temperatures; the interval is for this temperature alone",
            if v > 0.0 { "above" } else { "below" },
            run + 1
        ),
    )
}

/// Scatter of the first ten minutes of several recordings.
pub(super) fn turn_on(a: usize, steps: &[Steps], runs: Option<&[Run]>) -> Quantity {
    let name = "turn-on repeatability, 1 sigma";
    let [from, to] = START_S;
    let starts: Vec<f64> = steps.iter().map(|s| mean(&s.rate_dph[a][from.min(s.len())..to.min(s.len())])).collect();
    if starts.len() < 3 {
        return quantity(
            name,
            "deg/h",
            None,
            format!("at least three power-ons are needed, one recording each; here are {}", starts.len()),
        );
    }
    let temperatures: Vec<f64> = runs.map_or_else(Vec::new, |r| {
        r.iter().map(|r| r.state(to.min(r.steps.len()) / 2, a).map_or(f64::NAN, |s| f64::from(s.0))).collect()
    });
    let (low, high) = temperatures.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
    let mut conditions = format!("mean of the first {} min of {} recordings", (to - from) / 60, starts.len());
    if low.is_finite() {
        let _ = write!(conditions, ", begun at {low:.1} to {high:.1} C");
        if high - low > 2.0 {
            conditions += ": that difference is in the figure";
        }
    }
    let late = steps.iter().filter(|s| (s.start_s - s.power_on_s).abs() > 60.0).count();
    if late > 0 {
        let _ = write!(conditions, "; {late} of them begin more than a minute after power-on");
    }
    quantity(name, "deg/h", deviation(&starts), conditions)
}

/// Rates with the time between them, s.
type Stretch = (Vec<f64>, f64);

/// The longest stretch at one temperature; where there is none, the longest recording.
pub(super) fn stretch(a: usize, recordings: &[Recording], steps: &[Steps], runs: Option<&[Run]>) -> (Stretch, String) {
    let soak_of = |(number, run): (usize, &Run)| {
        let t: Vec<f64> = (0..run.steps.len()).map(|k| run.state(k, a).map_or(f64::NAN, |s| f64::from(s.0))).collect();
        let t = block_means(&t, SMOOTHED_S);
        let (from, to) = longest_within(&t, BAND_C);
        (number, from * SMOOTHED_S, (to * SMOOTHED_S).min(run.steps.len()), mean(&t[from..to]))
    };
    let best = runs.unwrap_or_default().iter().enumerate().map(soak_of).max_by_key(|(_, from, to, _)| to - from);
    if let Some((number, from, to, t)) = best.filter(|b| b.2 - b.1 >= STRETCH_S) {
        let text = format!("soak of {:.1} h at {t:.1} C, recording {}", (to - from) as f64 / 3600.0, number + 1);
        // (Rows that are further apart than a second are taken as they are: between them there are straight lines.)
        let (rates, step_s) = recordings[number].even_rates();
        if step_s > 1.5 {
            let at = |second: usize| ((second as f64 / step_s).round() as usize).min(rates[a].len());
            return ((rates[a][at(from)..at(to)].to_vec(), step_s), text);
        }
        return ((steps[number].rate_dph[a][from..to].to_vec(), 1.0), text);
    }
    let longest = (0..recordings.len()).max_by_key(|k| steps[*k].len()).unwrap_or(0);
    let (rates, step_s) = recordings[longest].even_rates();
    let hours = rates[a].len() as f64 * step_s / 3600.0;
    let text = if runs.is_some() {
        format!("recording {} of {hours:.1} h; there is no soak of half an hour, so temperature is in it", longest + 1)
    } else if recordings[longest].thermometer.is_sensor() {
        format!("recording {} of {hours:.1} h at {:.1} C", longest + 1, mean(&recordings[longest].frequency_hz[a]))
    } else {
        format!("recording {} of {hours:.1} h, temperature unknown", longest + 1)
    };
    ((rates[a].clone(), step_s), text)
}

/// The longest part of a series that stays within a band: its first place, and the one behind its last. NaN ends a part.
fn longest_within(values: &[f64], band: f64) -> (usize, usize) {
    // Places of values that may still be the least and the largest of the part: each list has those in order.
    let (mut least, mut most) = (VecDeque::new(), VecDeque::new());
    let (mut best, mut from) = ((0, 0), 0);
    for (k, v) in values.iter().enumerate() {
        if !v.is_finite() {
            (from, least, most) = (k + 1, VecDeque::new(), VecDeque::new());
            continue;
        }
        while least.back().is_some_and(|b: &usize| values[*b] >= *v) {
            least.pop_back();
        }
        while most.back().is_some_and(|b: &usize| values[*b] <= *v) {
            most.pop_back();
        }
        least.push_back(k);
        most.push_back(k);
        while let (Some(l), Some(m)) = (least.front(), most.front()) {
            if values[*m] - values[*l] <= band {
                break;
            }
            from = 1 + *l.min(m);
            for places in [&mut least, &mut most] {
                while places.front().is_some_and(|place| *place < from) {
                    places.pop_front();
                }
            }
        }
        if k + 1 - from > best.1 - best.0 {
            best = (from, k + 1);
        }
    }
    best
}

pub(super) fn stability((rates, step_s): &Stretch, conditions: &str) -> Quantity {
    let per_mean = ((MEAN_S as f64 / step_s).round() as usize).max(1);
    let v = deviation(&block_means(rates, per_mean)).map(|(s, l, h)| (3.0 * s, 3.0 * l, 3.0 * h));
    quantity("bias stability, 3 sigma of 100 s means", "deg/h", v, conditions.into())
}

/// From a bar of one sigma to 95 %, by logarithms.
pub(super) fn widened(p: &allan::Point, factor: f64) -> (f64, f64, f64) {
    let v = p.deviation * factor;
    (v, v * (p.low / p.deviation).powf(1.96), v * (p.high / p.deviation).powf(1.96))
}

pub(super) fn instability(curve: &[allan::Point], conditions: &str) -> Quantity {
    let name = "bias instability";
    let Some(least) = curve.iter().min_by(|x, y| x.deviation.total_cmp(&y.deviation)) else {
        return quantity(name, "deg/h", None, conditions.into());
    };
    let reached = allan::read(curve).bias_instability_reached;
    let bound = if reached { "" } else { "; the curve has no minimum yet, so this is an upper bound" };
    let conditions =
        format!("lowest Allan deviation divided by {}, at {:.0} s{bound}; {conditions}", allan::FLICKER, least.tau_s);
    quantity(name, "deg/h", Some(widened(least, 1.0 / allan::FLICKER)), conditions)
}

pub(super) fn random_walk(curve: &[allan::Point], conditions: &str) -> Quantity {
    let (name, unit) = ("angle random walk", "deg/sqrt(h)");
    let r = allan::read(curve);
    let found = r
        .angle_random_walk_deg_per_root_h
        .zip(r.angle_random_walk_interval_deg_per_root_h)
        .zip(r.angle_random_walk_plateau_s);
    let Some(((arw, [low, high]), [from, to])) = found else {
        let why = if curve.is_empty() { "" } else { "no plateau of the Allan deviation times the root of time; " };
        return quantity(name, unit, None, format!("{why}{conditions}"));
    };
    quantity(
        name,
        unit,
        Some((arw, low, high)),
        format!("plateau of the Allan deviation times the root of time, {from:.3} to {to:.3} s; {conditions}"),
    )
}

pub(super) fn ramp_sensitivity(means: &[Mean]) -> Quantity {
    let (name, unit) = ("bias sensitivity to ramp", "deg/h per C/min");
    let m: Vec<&Mean> = means.iter().filter(|m| m.t.is_finite() && m.ramp.is_finite()).collect();
    let fastest = m.iter().fold((0.0f64, 0.0f64), |(l, h), m| (l.min(m.ramp), h.max(m.ramp)));
    if fastest.1 - fastest.0 < 2.0 * SOAK {
        return quantity(name, unit, None, "no ramps in the recordings".into());
    }
    let (low, high) = m.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), m| (l.min(m.t), h.max(m.t)));
    let u: Vec<f64> = m.iter().map(|m| (2.0 * m.t - low - high) / (high - low).max(1e-9)).collect();
    let mut columns = lsq::powers(&u, 3);
    columns.push(m.iter().map(|m| m.ramp).collect());
    let y: Vec<f64> = m.iter().map(|m| m.rate).collect();
    let conditions = format!(
        "fitted together with a cubic of temperature; ramps from {:.2} to {:.2} C per minute",
        fastest.0, fastest.1
    );
    quantity(name, unit, coefficient(&columns, &y, 4), conditions)
}
