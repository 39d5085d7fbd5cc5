//! Curves of the temperature that equation 7 does not hold.

use crate::draw::Draw;
use crate::world::World;
use std::f64::consts::PI;

fn of(w: &World, a: usize, f: impl Fn(f64) -> f64) -> Vec<f64> {
    w.t_c[a].iter().map(|&t| f(t)).collect()
}

/// Interference with a short period.
pub fn ripple_short(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (period_c, phase) = (d.common("period_c", 5.5..9.0), d.own("phase", 0.0..2.0 * PI));
    of(w, a, |t| (2.0 * PI * t / period_c + phase).sin())
}

/// Interference with a long period, another one on each axis.
pub fn ripple_long(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (period_c, phase) = (d.own("period_c", 14.0..20.0), d.own("phase", 0.0..2.0 * PI));
    of(w, a, |t| (2.0 * PI * t / period_c + phase).sin())
}

/// Interference whose period grows with temperature.
pub fn ripple_chirped(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (period_c, growth_c) = (d.common("period_at_0_c", 8.0..11.0), d.common("growth_c", 90.0..140.0));
    let phase = d.own("phase", 0.0..2.0 * PI);
    of(w, a, |t| (2.0 * PI * growth_c / period_c * (1.0 - (-t / growth_c).exp()) + phase).sin())
}

/// A smooth step (a coating's transition).
pub fn smooth_step(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c", -15.0..35.0), d.own("width_c", 1.5..4.0));
    of(w, a, |t| ((t - centre) / width).tanh())
}

/// Two bumps of opposite sign.
pub fn bumps(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let cold = (d.own("cold_c", -28.0..-5.0), d.own("cold_width_c", 3.0..6.0));
    let warm = (d.own("warm_c", 18.0..45.0), d.own("warm_width_c", 4.0..8.0), d.own("warm_weight", 0.6..1.3));
    let bell = |t: f64, centre: f64, width: f64| (-0.5 * ((t - centre) / width).powi(2)).exp();
    of(w, a, |t| bell(t, cold.0, cold.1) - warm.2 * bell(t, warm.0, warm.1))
}

/// Two hinges.
pub fn hinges(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (cold, warm) = (d.own("cold_c", -22.0..-8.0), d.own("warm_c", 28.0..44.0));
    let weight = d.own("warm_weight", 0.7..1.5);
    of(w, a, |t| (cold - t).max(0.0) - weight * (t - warm).max(0.0))
}

/// A steep exponential at the hot end (leakage current).
pub fn hot_exponential(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let scale = d.own("scale_c", 6.0..10.0);
    of(w, a, |t| ((t - 60.0) / scale).exp())
}

/// A steep exponential at the cold end (a glue that stiffens).
pub fn cold_exponential(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let scale = d.own("scale_c", 5.0..9.0);
    of(w, a, |t| (-(t + 40.0) / scale).exp())
}

/// A smooth curve through nine random knots.
pub fn random_spline(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let mut at = -45.0;
    let knots: Vec<(f64, f64)> = (0..12)
        .map(|_| {
            let knot = (at, d.quiet(-1.0..1.0));
            at += d.quiet(7.0..14.0);
            knot
        })
        .collect();
    of(w, a, |t| hermite(&knots, t))
}

/// Cubic Hermite interpolation with Catmull and Rom's slopes; constant outside.
fn hermite(knots: &[(f64, f64)], t: f64) -> f64 {
    let last = knots.len() - 1;
    let k = knots.partition_point(|&(at, _)| at <= t);
    if k == 0 {
        return knots[0].1;
    }
    if k > last {
        return knots[last].1;
    }
    let slope = |i: usize| {
        let (before, after) = (knots[i.saturating_sub(1)], knots[(i + 1).min(last)]);
        (after.1 - before.1) / (after.0 - before.0)
    };
    let ((t0, y0), (t1, y1)) = (knots[k - 1], knots[k]);
    let h = t1 - t0;
    let u = (t - t0) / h;
    let (u2, u3) = (u * u, u * u * u);
    (2.0 * u3 - 3.0 * u2 + 1.0) * y0
        + (u3 - 2.0 * u2 + u) * h * slope(k - 1)
        + (3.0 * u2 - 2.0 * u3) * y1
        + (u3 - u2) * h * slope(k)
}

/// A resonance of the holder that the drive crosses: dispersive, with both signs.
pub fn crossing_resonance(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c", -10.0..35.0), d.own("width_c", 3.0..6.0));
    of(w, a, |t| {
        let u = (t - centre) / width;
        u / (1.0 + u * u)
    })
}

/// The error of a table that is interpolated from entry to entry: a scallop within each 10 to 14 C.
pub fn table_scallops(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (pitch, offset) = (d.common("pitch_c", 12.0..17.0), d.own("offset_c", 0.0..10.0));
    of(w, a, |t| {
        let u = ((t + offset) / pitch).rem_euclid(1.0);
        u * (1.0 - u)
    })
}

/// The error of a table that is held from entry to entry: a saw-tooth.
pub fn table_saw(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (pitch, offset) = (d.common("pitch_c", 9.0..13.0), d.own("offset_c", 0.0..9.0));
    of(w, a, |t| ((t + offset) / pitch).rem_euclid(1.0))
}

/// A power of the distance from a neutral point, 0.5 to 0.8: a cusp.
pub fn cusp(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, power) = (d.own("centre_c", -5.0..30.0), d.common("power", 0.45..0.75));
    of(w, a, |t| (t - centre).abs().powf(power))
}

/// The anomaly of a two-level system (Schottky) in the middle of the range.
pub fn lone_bump(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c", -5.0..30.0), d.own("width_c", 6.0..10.0));
    of(w, a, |t| ((t - centre) / width).cosh().powi(-2))
}
