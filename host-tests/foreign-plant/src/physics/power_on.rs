//! Functions of the time since power-on.

use crate::draw::Draw;
use crate::world::World;
use std::f64::consts::PI;

fn of(w: &World, f: impl Fn(f64) -> f64) -> Vec<f64> {
    w.time_s.iter().map(|&t| f(t)).collect()
}

/// Two exponentials of opposite sign or not.
pub fn two_exponentials(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (fast, slow) = (d.common("fast_s", 250.0..600.0), d.own("slow_s", 4000.0..8000.0));
    let weight = d.own("fast_weight", -1.5..2.5);
    of(w, |t| weight * (-t / fast).exp() + (-t / slow).exp())
}

/// A logarithm.
pub fn logarithm(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let scale = d.own("scale_s", 60.0..240.0);
    of(w, |t| (1.0 + t / scale).ln())
}

/// A stretched exponential.
pub fn stretched(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (scale, power) = (d.own("scale_s", 1500.0..3500.0), d.common("power", 0.4..0.6));
    of(w, |t| (-(t / scale).powf(power)).exp())
}

/// A power law.
pub fn power_law(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (scale, power) = (d.own("scale_s", 300.0..900.0), d.own("power", 0.7..1.5));
    of(w, |t| (1.0 + t / scale).powf(-power))
}

/// Rises first, then decays: two stages in line.
pub fn rise_and_decay(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let peak = d.own("peak_s", 900.0..2200.0);
    of(w, |t| t / peak * (1.0 - t / peak).exp())
}

/// A loop that rings out.
pub fn ringing(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (period, decay) = (d.own("period_s", 2400.0..4200.0), d.common("decay_s", 4000.0..7000.0));
    of(w, |t| (2.0 * PI * t / period).cos() * (-t / decay).exp())
}

/// A heater of the electronics that cuts in late.
pub fn late_start(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (start, width) = (d.common("start_s", 3000.0..5500.0), d.common("width_s", 200.0..500.0));
    of(w, |t| ((t - start) / width).tanh())
}

/// One exponential with a time constant of its own on each axis: about 700, 2000 and 5000 s.
pub fn tau_by_axis(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau = d.own("tau_factor", 0.85..1.15) * [700.0, 2000.0, 5000.0][a];
    of(w, |t| (-t / tau).exp())
}

/// An exponential whose amplitude is set by the temperature at power-on.
pub fn by_start_temperature(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (tau, neutral) = (d.own("tau_s", 1800.0..3600.0), d.common("neutral_c", 5.0..20.0));
    of(w, |t| (w.start_c() - neutral) * (-t / tau).exp())
}

/// A slope over temperature that settles after power-on.
pub fn settling_slope(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (tau, neutral) = (d.own("tau_s", 4000.0..8000.0), d.own("neutral_c", 0.0..25.0));
    w.time_s.iter().zip(&w.t_c[a]).map(|(&t, &c)| (c - neutral) * (-t / tau).exp()).collect()
}

/// An exponential whose time constant is set by the temperature at power-on: slow in the cold.
pub fn tau_by_start_temperature(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let (tau, span) = (d.own("tau_at_20_c_s", 1500.0..2500.0), d.common("span_c", 40.0..60.0));
    let tau = tau * ((20.0 - w.start_c()) / span).exp();
    of(w, |t| (-t / tau).exp())
}
