//! Functions of the ramp r = dT/dt that equation 7 does not hold. Ramps are in C/min.

use crate::draw::Draw;
use crate::operators::slope_per_min;
use crate::world::World;

fn of(w: &World, a: usize, f: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    w.t_c[a].iter().zip(&w.ramp[a]).map(|(&t, &r)| f(t, r)).collect()
}

/// Saturation.
pub fn saturating(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let knee = d.own("knee_c_per_min", 0.2..0.4);
    of(w, a, |_, r| (r / knee).tanh())
}

/// Nothing when cooling; a saturating push when heating.
pub fn heating_push(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let knee = d.own("knee_c_per_min", 0.25..0.5);
    of(w, a, |_, r| 1.0 - (-r.max(0.0) / knee).exp())
}

/// Cooling only, above a least ramp.
pub fn cooling_above(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let least = d.own("least_c_per_min", 0.4..0.7);
    of(w, a, |_, r| (-r - least).max(0.0))
}

/// A dead zone on both sides.
pub fn dead_zone(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let zone = d.own("zone_c_per_min", 0.5..0.8);
    of(w, a, |_, r| r.signum() * (r.abs() - zone).max(0.0))
}

/// A root of the ramp.
pub fn root(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let power = d.common("power", 0.3..0.5);
    of(w, a, |_, r| r.signum() * r.abs().powf(power))
}

/// |r| to a power of 0.4 to 0.7, the same for both directions.
pub fn even_root(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let power = d.own("power", 0.4..0.7);
    of(w, a, |_, r| r.abs().powf(power))
}

/// r times a bump of the temperature.
pub fn within_a_band(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c", -10.0..30.0), d.own("width_c", 8.0..14.0));
    of(w, a, |t, r| r * (-0.5 * ((t - centre) / width).powi(2)).exp())
}

/// r T^2.
pub fn times_t_squared(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let centre = d.own("centre_c", 0.0..20.0);
    of(w, a, |t, r| r * (t - centre).powi(2))
}

/// r times an exponential of the temperature.
pub fn times_exponential(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let scale = d.own("scale_c", 14.0..22.0);
    of(w, a, |t, r| r * (t / scale).exp())
}

/// A window of ramps in which a joint sticks and slips.
pub fn window(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c_per_min", 0.5..0.8), d.common("width_c_per_min", 0.15..0.3));
    of(w, a, |_, r| (-0.5 * ((r.abs() - centre) / width).powi(2)).exp() * r.signum())
}

/// The temperature's effect differs between heating and cooling by a smooth switch.
pub fn two_slopes(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (knee, centre) = (d.common("knee_c_per_min", 0.08..0.15), d.own("centre_c", 0.0..20.0));
    of(w, a, |t, r| (r / knee).tanh() * (t - centre))
}

/// An odd power that fast ramps bring out: |r|^2.5.
pub fn steep_power(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let power = d.own("power", 2.3..3.0);
    of(w, a, |_, r| r.signum() * r.abs().powf(power))
}

/// The slope of the ramp: d2T/dt2.
pub fn acceleration(_: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    slope_per_min(&w.ramp[a], w.dt_s, 120.0)
}
