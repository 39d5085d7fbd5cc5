//! Effects that act once, or at times that are not predictable.

use crate::draw::Draw;
use crate::world::World;
use std::f64::consts::PI;

/// Time as a share of the log.
fn share(w: &World, t: f64) -> f64 {
    (t - w.plan.log_from_s) / (w.plan.hours * 3600.0)
}

fn of(w: &World, f: impl Fn(f64) -> f64) -> Vec<f64> {
    w.time_s.iter().map(|&t| f(share(w, t))).collect()
}

/// One step.
pub fn step(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let at = d.run(0.25..0.75);
    of(w, |u| if u < at { 0.0 } else { 1.0 })
}

/// Up, and back down later.
pub fn there_and_back(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (from, long) = (d.run(0.2..0.5), d.run(0.12..0.3));
    of(w, |u| if u > from && u < from + long { 1.0 } else { 0.0 })
}

/// A shock that relaxes.
pub fn shock(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (at, fade) = (d.run(0.2..0.6), d.run(0.04..0.1));
    of(w, |u| if u < at { 0.0 } else { (-(u - at) / fade).exp() })
}

/// Bursts of a vibration that rectifies: three stretches of some minutes.
pub fn bursts(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let parts: Vec<(f64, f64, f64)> =
        (0..4).map(|k| (0.05 + 0.23 * f64::from(k) + d.run(0.0..0.15), d.run(0.01..0.03), d.run(-1.0..1.0))).collect();
    of(w, |u| parts.iter().map(|&(from, long, height)| if u > from && u < from + long { height } else { 0.0 }).sum())
}

/// Telegraph noise: two levels, dwell times of ten minutes or so.
pub fn telegraph(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let dwell_s = d.common("mean_dwell_s", 600.0..1500.0);
    let (mut level, mut left_s) = (1.0, 0.0);
    w.time_s
        .iter()
        .map(|_| {
            left_s -= w.dt_s;
            if left_s <= 0.0 {
                level = -level;
                left_s = -dwell_s * (1.0 - d.run(0.0..1.0)).ln();
            }
            level
        })
        .collect()
}

/// A period of half an hour or so: the laboratory's air conditioning. Its phase is the run's.
pub fn periodic(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (period_s, phase) = (d.common("period_s", 1400.0..2800.0), d.run(0.0..2.0 * PI));
    w.time_s.iter().map(|t| (2.0 * PI * t / period_s + phase).sin()).collect()
}

/// A period that drifts by half over the run.
pub fn drifting_period(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (turns, drift, phase) = (d.run(9.0..16.0), d.run(0.3..0.6), d.run(0.0..2.0 * PI));
    of(w, |u| (2.0 * PI * turns * (u + drift * u * u) + phase).sin())
}

/// Short disturbances as the temperature passes three marks (cables that creak), in one run only.
pub fn creaks(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let marks = [d.run(-25.0..-5.0), d.run(5.0..20.0), d.run(28.0..45.0)];
    let heights = [d.run(0.5..1.0), d.run(-1.0..-0.5), d.run(0.5..1.0)];
    let (mut out, mut last) = (vec![0.0; w.len()], w.start_c());
    for i in 0..w.len() {
        let t = w.t_c[a][i];
        for (mark, height) in marks.iter().zip(heights) {
            if (last - mark) * (t - mark) < 0.0 {
                let long = ((400.0 / w.dt_s) as usize).min(w.len() - i);
                out[i..i + long].iter_mut().for_each(|x| *x += height);
            }
        }
        last = t;
    }
    out
}

/// A slow bump of an hour: somebody opened a door.
pub fn slow_bump(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (at, width) = (d.run(0.3..0.7), d.run(0.04..0.08));
    of(w, |u| (-0.5 * ((u - at) / width).powi(2)).exp())
}

/// Steps of random height at random times: a joint that gives way again and again.
pub fn slips(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let steps: Vec<(f64, f64)> = (0..7).map(|_| (d.run(0.05..0.95), d.run(-1.0..1.0))).collect();
    of(w, |u| steps.iter().filter(|(at, _)| u > *at).map(|(_, height)| height).sum())
}
