//! Faults of the thermometer. A form gives the error of what it indicates: of a frequency as a fraction of it, of a sensor in C.
//! Its scale is free unless the case fixes the size.

use crate::draw::Draw;
use crate::operators::{lag, minus, play};
use crate::world::World;
use std::f64::consts::TAU;

/// Seconds of the log's length, as a share from its begin.
fn log_time_s(w: &World, share: f64) -> f64 {
    w.plan.log_from_s + share * w.plan.hours * 3600.0
}

/// The frequency jumps once, within some seconds, and stays.
pub fn hop(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let at_s = log_time_s(w, d.run(0.3..0.7));
    w.time_s.iter().map(|&t| if t < at_s { 0.0 } else { 1.0 }).collect()
}

/// The frequency drifts from power-on by a logarithm, alike in every run (the getter works).
pub fn frequency_ageing(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let scale_s = d.own("scale_s", 1500.0..4000.0);
    w.time_s.iter().map(|t| (1.0 + t / scale_s).ln()).collect()
}

/// The counter's clock is an RC oscillator on the board: a parabola of the board's temperature.
pub fn board_clock(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let turn = d.common("turn_c", 20.0..35.0);
    let body = lag(&w.board_c, w.dt_s, 600.0, w.start_c());
    body.iter().map(|t| ((t - turn) / 50.0).powi(2)).collect()
}

/// The counter's clock warms up after power-on.
pub fn clock_warm_up(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let tau_s = d.common("tau_s", 2500.0..5000.0);
    w.time_s.iter().map(|t| (-t / tau_s).exp()).collect()
}

/// The counter's clock drifts from run to run, as a worn synthesiser does.
pub fn clock_drift(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let waves: Vec<(f64, f64)> = (0..4).map(|_| (d.run(5000.0..16000.0), d.run(0.0..TAU))).collect();
    w.time_s.iter().map(|t| waves.iter().map(|(period, phase)| (TAU * t / period + phase).sin()).sum()).collect()
}

/// An activity dip: another mode pulls the frequency within some degrees.
pub fn activity_dip(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, width) = (d.own("centre_c", 0.0..35.0), d.own("width_c", 5.0..8.0));
    w.t_c[a]
        .iter()
        .map(|t| {
            let u = (t - centre) / width;
            u * (-0.5 * u * u).exp()
        })
        .collect()
}

/// A sensor that sits behind glue: it is late.
pub fn late_sensor(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 200.0..400.0);
    minus(&lag(&w.t_c[a], w.dt_s, tau_s, w.start_c()), &w.t_c[a])
}

/// A sensor that has come loose at some time in this run: it reads partly the air.
pub fn loose_sensor(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let at_s = log_time_s(w, d.run(0.3..0.6));
    let air = lag(&w.air_c, w.dt_s, 60.0, w.start_c());
    (0..w.len()).map(|i| if w.time_s[i] < at_s { 0.0 } else { air[i] - w.t_c[a][i] }).collect()
}

/// A sensor that sticks: it has play.
pub fn sticking_sensor(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let half = d.own("half_c", 1.2..2.0);
    minus(&play(&w.t_c[a], half, w.start_c() + w.plan.branch * half), &w.t_c[a])
}
