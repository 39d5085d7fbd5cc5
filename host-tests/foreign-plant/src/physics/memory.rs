//! Thermal memory: the bias follows bodies that are slower than the resonator, or differences between bodies.

use crate::draw::Draw;
use crate::operators::{delayed, lag, lag_by, minus, relaxation, rod_end, sum};
use crate::world::World;
use std::f64::consts::PI;

/// A body behind two poles.
pub fn two_poles(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (first_s, second_s) = (d.common("first_tau_s", 500.0..900.0), d.own("second_tau_s", 700.0..1400.0));
    let body = lag(&lag(&w.t_c[a], w.dt_s, first_s, w.start_c()), w.dt_s, second_s, w.start_c());
    minus(&body, &w.t_c[a])
}

/// Three bodies side by side, one of opposite sign.
pub fn three_bodies(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let taus = [("fast_s", 250.0..450.0), ("middle_s", 1000.0..1600.0), ("slow_s", 4000.0..7000.0)];
    let weights = [d.own("fast_weight", -1.2..-0.8), d.own("middle_weight", 0.8..1.2), d.own("slow_weight", 0.2..0.4)];
    let parts: Vec<_> = taus
        .into_iter()
        .zip(weights)
        .map(|((name, range), weight)| {
            (weight, minus(&lag(&w.t_c[a], w.dt_s, d.common(name, range), w.start_c()), &w.t_c[a]))
        })
        .collect();
    sum(&parts)
}

/// The far end of a rod of silica.
pub fn rod(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let diffusion_s = d.own("diffusion_s", 2500.0..6000.0);
    minus(&rod_end(&w.t_c[a], w.dt_s, diffusion_s, w.start_c()), &w.t_c[a])
}

/// Fractional relaxation (Cole and Cole's spectrum of time constants), order 0.5 to 0.7.
pub fn fractional(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (order, tau_s) = (d.common("order", 0.5..0.7), d.own("tau_s", 900.0..2000.0));
    let spectrum = broad(tau_s, |u| (order * PI).sin() / ((order * u).cosh() + (order * PI).cos()));
    minus(&relaxation(&w.t_c[a], w.dt_s, w.start_c(), &spectrum), &w.t_c[a])
}

/// Relaxation with a log-normal spectrum of time constants, more than a decade wide.
pub fn log_normal(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (width, tau_s) = (d.common("ln_width", 1.0..1.5), d.common("tau_s", 1000.0..2200.0));
    let spectrum = broad(tau_s, |u| (-0.5 * (u / width).powi(2)).exp());
    minus(&relaxation(&w.t_c[a], w.dt_s, w.start_c(), &spectrum), &w.t_c[a])
}

/// A spectrum of 21 time constants about `tau_s`, of density `density(ln(tau / tau_s))`.
fn broad(tau_s: f64, density: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    let steps: Vec<f64> = (-10..=10).map(|k| f64::from(k) * 0.45).collect();
    let total: f64 = steps.iter().map(|&u| density(u)).sum();
    steps.iter().map(|&u| (density(u) / total, tau_s * u.exp())).collect()
}

/// One pole, another one on each axis: about 400, 1200 and 3000 s.
pub fn tau_by_axis(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_factor", 0.85..1.15) * [400.0, 1200.0, 3000.0][a];
    minus(&lag(&w.t_c[a], w.dt_s, tau_s, w.start_c()), &w.t_c[a])
}

/// Effect that heating alone excites and that decays with time.
pub fn heating_only(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 1500.0..3000.0);
    fading(w, tau_s, |i| w.ramp[a][i].max(0.0))
}

/// Effect that cooling alone excites and that decays with time.
pub fn cooling_only(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 900.0..1800.0);
    fading(w, tau_s, |i| (-w.ramp[a][i]).max(0.0))
}

/// Creep: either direction of ramp stirs the same relaxation.
pub fn creep_after_ramps(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 1800.0..3600.0);
    fading(w, tau_s, |i| w.ramp[a][i].powi(2))
}

fn fading(w: &World, tau_s: f64, stir: impl Fn(usize) -> f64) -> Vec<f64> {
    let keep = (-w.dt_s / tau_s).exp();
    let mut state = 0.0;
    (0..w.len())
        .map(|i| {
            state = state * keep + stir(i) * w.dt_s / 60.0;
            state
        })
        .collect()
}

/// A body that warms fast and cools slowly.
pub fn asymmetric(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (warming_s, cooling_s) = (d.own("warming_s", 400.0..700.0), d.own("cooling_s", 1500.0..2800.0));
    let body = lag_by(&w.t_c[a], w.dt_s, w.start_c(), |_, gap| if gap > 0.0 { warming_s } else { cooling_s });
    minus(&body, &w.t_c[a])
}

/// A time constant by Arrhenius' law: slow in the cold.
pub fn arrhenius(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (tau_s, activation_k) = (d.own("tau_at_25_c_s", 700.0..1300.0), d.common("activation_k", 1500.0..2500.0));
    let t_c = &w.t_c[a];
    let body = lag_by(t_c, w.dt_s, w.start_c(), |i, _| {
        tau_s * (activation_k * (1.0 / (t_c[i] + 273.15) - 1.0 / 298.15)).exp()
    });
    minus(&body, t_c)
}

/// A lag whose gain grows with temperature.
pub fn gain_by_temperature(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (tau_s, span_c) = (d.own("tau_s", 900.0..1800.0), d.common("gain_span_c", 35.0..50.0));
    let body = lag(&w.t_c[a], w.dt_s, tau_s, w.start_c());
    body.iter().zip(&w.t_c[a]).map(|(b, t)| (b - t) * (1.0 + (t - 10.0) / span_c)).collect()
}

/// A time constant that shrinks while the temperature moves (gas stirred by the ramp).
pub fn tau_by_ramp(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (still_s, ramp) = (d.own("still_s", 2500.0..4000.0), d.common("ramp_c_per_min", 0.3..0.6));
    let body = lag_by(&w.t_c[a], w.dt_s, w.start_c(), |i, _| still_s / (1.0 + w.ramp[a][i].abs() / ramp));
    minus(&body, &w.t_c[a])
}

/// Holder of the pre-amplifier against the base plate: neither is recorded.
pub fn hidden_gradient(_: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    minus(&w.holder_c[a], &w.base_c)
}

/// Board against base plate, where neither is recorded: mostly what self-heating makes of it.
pub fn board_gradient(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let share = d.own("share_of_slow_board", 0.5..0.8);
    let slow = lag(&w.board_c, w.dt_s, 1500.0, w.start_c());
    (0..w.len()).map(|i| share * slow[i] + (1.0 - share) * w.board_c[i] - w.base_c[i]).collect()
}

/// The square of a gradient along the holder (thermal stress of a bimetal).
pub fn gradient_squared(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 900.0..1600.0);
    let body = lag(&w.t_c[a], w.dt_s, tau_s, w.start_c());
    body.iter().zip(&w.t_c[a]).map(|(b, t)| (b - t) * (b - t).abs()).collect()
}

/// An underdamped second-order response.
pub fn underdamped(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (period_s, damping) = (d.own("period_s", 2400.0..4000.0), d.common("damping", 0.25..0.45));
    let omega = 2.0 * PI / period_s;
    let (mut at, mut speed) = (w.start_c(), 0.0);
    w.t_c[a]
        .iter()
        .map(|&t| {
            speed += w.dt_s * (omega * omega * (t - at) - 2.0 * damping * omega * speed);
            at += w.dt_s * speed;
            at - t
        })
        .collect()
}

/// A pure delay: the temperature of some minutes ago.
pub fn dead_time(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let delay_s = d.own("delay_s", 700.0..1300.0);
    minus(&delayed(&w.t_c[a], w.dt_s, delay_s, w.start_c()), &w.t_c[a])
}

/// The neighbour's resonator, late.
pub fn neighbour(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 700.0..1500.0);
    let other = lag(&w.t_c[(a + 1) % 3], w.dt_s, tau_s, w.start_c());
    minus(&other, &w.t_c[a])
}

/// One slow body that still holds what the day before left in it.
pub fn kept_from_yesterday(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 3500.0..6000.0);
    minus(&lag(&w.t_c[a], w.dt_s, tau_s, w.kept_start_c()), &w.t_c[a])
}

/// One pole of ten to twenty minutes.
pub fn one_pole(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 700.0..1200.0);
    minus(&lag(&w.t_c[a], w.dt_s, tau_s, w.start_c()), &w.t_c[a])
}
