//! Quantities that the recording holds beside temperature: supply, board, drive, quadrature.

use crate::draw::Draw;
use crate::operators::{lag, minus};
use crate::world::World;

fn centred(x: &[f64], about: f64) -> impl Iterator<Item = f64> + '_ {
    x.iter().map(move |x| x - about)
}

/// The drive, squared about a working point.
pub fn drive_squared(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let about = d.own("about_v", 1.15..1.35);
    centred(&w.drive_v[a], about).map(|u| u * u).collect()
}

/// The quadrature voltage times temperature.
pub fn quad_times_t(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let neutral = d.own("neutral_c", -10.0..30.0);
    centred(&w.quad_v[a], 0.08).zip(&w.t_c[a]).map(|(u, t)| u * (t - neutral)).collect()
}

/// The supply, late: a regulator warms with its load.
pub fn supply_late(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 300.0..700.0);
    centred(&lag(&w.supply_v, w.dt_s, tau_s, w.supply_v[0]), 5.0).collect()
}

/// The supply, at once.
pub fn supply(_: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    centred(&w.supply_v, 5.0).collect()
}

/// The drive of the neighbouring axis.
pub fn other_axis_drive(_: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    centred(&w.drive_v[(a + 1) % 3], 1.2).collect()
}

/// The supply below a threshold: a regulator drops out.
pub fn supply_threshold(d: &mut Draw, w: &World, _: usize) -> Vec<f64> {
    let threshold = d.common("threshold_v", 4.99..5.01);
    w.supply_v.iter().map(|u| (threshold - u).max(0.0)).collect()
}

/// The board against the resonator, late.
pub fn board_late(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let tau_s = d.own("tau_s", 900.0..1800.0);
    minus(&lag(&w.board_c, w.dt_s, tau_s, w.start_c()), &w.t_c[a])
}

/// The quadrature voltage, rectified.
pub fn quad_rectified(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let about = d.own("about_v", 0.07..0.09);
    centred(&w.quad_v[a], about).map(f64::abs).collect()
}

/// The drive times the quadrature voltage.
pub fn drive_times_quad(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (drive, quad) = (d.own("drive_v", 1.1..1.3), d.own("quad_v", 0.05..0.11));
    centred(&w.drive_v[a], drive).zip(centred(&w.quad_v[a], quad)).map(|(u, v)| u * v).collect()
}

/// The anisotropy of the loss: a share of it that changes with temperature.
pub fn loss_anisotropy(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let per_c = d.own("anisotropy_per_c", -6e-4..6e-4);
    let turn_per_c = d.own("axis_rad_per_c", -4e-4..4e-4);
    let angle = d.own("axis_rad", 0.3..0.6);
    let of = |(l, t): (&f64, &f64)| l * (1.0 + per_c * (t - 25.0)) * (2.0 * (angle + turn_per_c * (t - 25.0))).sin();
    w.loss[a].iter().zip(&w.t_c[a]).map(of).collect()
}

/// The quadrature force, let through by an error of the demodulator's phase that follows the board.
pub fn quadrature_leak(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (phase, per_c) = (d.own("phase_rad", 0.01..0.03), d.own("phase_rad_per_c", -1.2e-4..1.2e-4));
    w.force_v[a].iter().zip(&w.board_c).map(|(q, b)| q * (phase + per_c * (b - 25.0)).sin()).collect()
}

/// The drive, at once and in proportion.
pub fn drive(_: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    centred(&w.drive_v[a], 1.2).collect()
}
