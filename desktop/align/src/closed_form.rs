//! Azimuth of two positions in closed form, with no filter: an independent check of the filters (chen2015, eq 16 to 20), and the drift of
//! each position by itself (its eq 21).
//!
//! In a position each velocity is a parabola of time: its slope is the tilt and its curvature the tilt's rate. At the middle of the
//! position, with the coupling of the tilts taken off, `th1' + Os th2 = d1 - Oc cos A` and `th2' - Os th1 = d2 + Oc sin A`. Turned by `b`
//! the drifts stay and `A` becomes `A + b`, so the difference of the two positions is `2 Oc sin(b/2)` long, whatever the drifts, and its
//! direction is that of `A + b/2`.

use super::Recording;
use hrg_align::{wrap, Config, ARCMIN, DEGREE, DPH};
use hrg_data::numeric::lsq;
use serde::Serialize;

/// Result of two positions by themselves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClosedForm {
    /// Heading of axis 1 as it stood in position 1, degrees, -180 to 180.
    pub azimuth_deg: f64,
    /// Length of the difference of the two positions over what it must be: 1, whatever azimuth and drifts are. A scale error of the
    /// accelerometers, a drift that came with the turn or a wrong angle of it show here.
    pub length_ratio: f64,
    /// Drifts about axes 1 and 2 in position 1 and in position 2, deg/h, at an azimuth.
    pub drift_by_position_dph: [[f64; 2]; 2],
}

/// Rows of a position that a parabola needs.
const FEWEST: usize = 20;

/// Tilt rates of a position with the coupling of the tilts taken off, rad/s.
fn apparent(recording: &Recording, config: &Config, position: u8) -> Option<[f64; 2]> {
    let rows: Vec<_> = recording.rows.iter().filter(|r| r.1 == position).collect();
    let (first, last) = (rows.first()?.0, rows.last()?.0);
    let (middle, half) = (0.5 * (first + last), 0.5 * (last - first));
    if rows.len() < FEWEST || !(half > 0.0) {
        return None;
    }
    let u: Vec<f64> = rows.iter().map(|r| (r.0 - middle) / half).collect();
    let mut slope = [0.0; 2];
    let mut rate = [0.0; 2];
    for k in 0..2 {
        let v: Vec<f64> = rows.iter().map(|r| r.2[k]).collect();
        let fit = lsq::fit(&lsq::powers(&u, 2), &v, None, &["1", "u", "u^2"]).ok()?;
        slope[k] = fit.coefficients[1] / half / config.gravity;
        rate[k] = 2.0 * fit.coefficients[2] / (half * half) / config.gravity;
    }
    // v1' = g th2, v2' = -g th1.
    let (tilt, rate) = ([-slope[1], slope[0]], [-rate[1], rate[0]]);
    let (_, os) = config.earth();
    Some([rate[0] + os * tilt[1], rate[1] - os * tilt[0]])
}

/// The closed form; drifts are given at `azimuth` (rad), or at its own where there is none. `None` where a position has too few rows or
/// the turn parts nothing.
#[must_use]
pub fn closed_form(recording: &Recording, config: &Config, azimuth: Option<f64>) -> Option<ClosedForm> {
    let [p, q] = [apparent(recording, config, 1)?, apparent(recording, config, 2)?];
    let (oc, _) = config.earth();
    let turn = recording.turn_deg * DEGREE;
    let wanted = 2.0 * oc * (0.5 * turn).sin();
    if wanted.abs() < 0.1 * oc {
        return None;
    }
    // p - q = -2 Oc sin(b/2) (sin(A + b/2), cos(A + b/2)).
    let difference = [p[0] - q[0], p[1] - q[1]];
    let own = wrap((-difference[0] / wanted).atan2(-difference[1] / wanted) - 0.5 * turn);
    let at = azimuth.unwrap_or(own);
    let drift = |seen: [f64; 2], a: f64| [(seen[0] + oc * a.cos()) / DPH, (seen[1] - oc * a.sin()) / DPH];
    Some(ClosedForm {
        azimuth_deg: own / DEGREE,
        length_ratio: difference[0].hypot(difference[1]) / wanted.abs(),
        drift_by_position_dph: [drift(p, at), drift(q, at + turn)],
    })
}

impl ClosedForm {
    /// Difference from an azimuth, arc minutes, -10800 to 10800.
    #[must_use]
    pub fn apart_arcmin(&self, azimuth_deg: f64) -> f64 {
        wrap((self.azimuth_deg - azimuth_deg) * DEGREE) / ARCMIN
    }
}

#[cfg(test)]
mod tests {
    use super::super::plant::Plant;
    use super::super::{FilterKind, Start};
    use super::*;
    use hrg_data::numeric::stats::quantile;

    /// A platform with next to no noise.
    fn quiet(plant: Plant) -> Plant {
        let angle_random_walk = 1e-5 * DEGREE / 60.0;
        Plant { velocity_noise: 0.0, pulse: 0.0, angle_random_walk, velocity_walk: 1e-9, bias: [0.0; 2], ..plant }
    }

    #[test]
    fn it_agrees_with_the_filter_and_shows_drift_that_came_with_the_turn() {
        let mut apart = Vec::new();
        for seed in 1..=60 {
            let (recording, _) = Plant::drawn(seed).play();
            let config = recording.config().expect("a site");
            let (outcome, _, _) = FilterKind::Linear.run(&recording, &config, Start::default());
            let Ok(e) = outcome else { continue };
            let c = closed_form(&recording, &config, Some(e.azimuth)).expect("two positions");
            apart.push(c.apart_arcmin(e.azimuth / DEGREE).abs());
        }
        // It does not weight readings as the filter does.
        assert!(apart.len() > 55 && quantile(&apart, 0.5) < 6.0 && quantile(&apart, 1.0) < 40.0, "{apart:?}");
        let quiet = quiet(Plant::chen(1));
        let moved = Plant { heading_drift: [0.3 * DPH, -0.1 * DPH], ..quiet };
        let (recording, truth) = moved.play();
        let config = recording.config().expect("a site");
        let c = closed_form(&recording, &config, Some(truth.azimuth)).expect("two positions");
        let [first, second] = c.drift_by_position_dph;
        assert!((second[0] - first[0] - 0.3).abs() < 0.01 && (second[1] - first[1] + 0.1).abs() < 0.01, "{c:?}");
    }
}
