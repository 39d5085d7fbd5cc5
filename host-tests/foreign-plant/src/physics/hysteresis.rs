//! Memory of the path: what the temperature was, not when.

use crate::draw::Draw;
use crate::operators::{bouc_wen, dahl, duhem, lag, minus, play, play_by, relay, sum};
use crate::world::World;

/// State of a play of half width `half` at power-on.
fn play_start(w: &World, half: f64) -> f64 {
    w.start_c() + w.plan.branch * half
}

/// `play(T) - T` of half width `half`.
fn one_play(w: &World, a: usize, half: f64) -> Vec<f64> {
    minus(&play(&w.t_c[a], half, play_start(w, half)), &w.t_c[a])
}

/// Three plays of small, middle and large width.
pub fn three_plays(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let halves = [d.own("small_c", 1.5..3.0), d.own("middle_c", 5.0..9.0), d.own("large_c", 14.0..22.0)];
    let weights = [d.own("small_weight", 0.4..0.8), d.own("middle_weight", 0.3..0.6), d.own("large_weight", 0.2..0.5)];
    let parts: Vec<_> = halves.into_iter().zip(weights).map(|(half, weight)| (weight, one_play(w, a, half))).collect();
    sum(&parts)
}

/// Two plays of opposite sign: the loop crosses itself.
pub fn crossing_plays(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (narrow, wide) = (d.own("narrow_c", 2.0..4.0), d.own("wide_c", 12.0..18.0));
    sum(&[(1.0, one_play(w, a, narrow)), (-d.own("wide_weight", 0.35..0.5), one_play(w, a, wide))])
}

/// Relays with thresholds `centre -+ half`, all of one weight unless given.
fn relays(w: &World, a: usize, relays: &[(f64, f64, f64)]) -> Vec<f64> {
    let parts: Vec<_> = relays
        .iter()
        .map(|&(centre, half, weight)| (weight, relay(&w.t_c[a], centre - half, centre + half, w.plan.branch)))
        .collect();
    sum(&parts)
}

/// Preisach's plane with a smooth density: 250 relays about 10 C.
pub fn preisach_smooth(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (centre, spread) = (d.own("centre_c", 0.0..22.0), d.common("spread_c", 14.0..22.0));
    let half = d.common("half_width_c", 5.0..9.0);
    let plane: Vec<_> = (0..250)
        .map(|_| {
            let bell: f64 = (0..6).map(|_| d.quiet(-1.0..1.0)).sum::<f64>() / 2.0_f64.sqrt();
            (centre + spread * bell, half * d.quiet(0.2..1.9), 1.0)
        })
        .collect();
    relays(w, a, &plane)
}

/// Preisach's plane with twelve relays of unlike weight: steps are visible.
pub fn preisach_coarse(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let plane: Vec<_> = (0..12).map(|_| (d.quiet(-25.0..45.0), d.quiet(3.0..12.0), d.quiet(0.3..1.0))).collect();
    relays(w, a, &plane)
}

/// Soft relays: a smooth step that is taken later on the way back.
pub fn soft_relays(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let parts: Vec<_> = ["cold", "warm"]
        .into_iter()
        .zip([-12.0..2.0, 20.0..38.0])
        .map(|(name, range)| {
            let centre = d.own(&format!("{name}_centre_c"), range);
            let half = d.own(&format!("{name}_half_c"), 4.0..9.0);
            let soft = d.common(&format!("{name}_softness_c"), 3.0..6.0);
            let path = play(&w.t_c[a], half, play_start(w, half));
            (1.0, path.iter().map(|p| ((p - centre) / soft).tanh()).collect())
        })
        .collect();
    sum(&parts)
}

/// Bouc and Wen's model.
pub fn bouc_wen_loop(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (limit, n) = (d.own("limit_c", 6.0..12.0), d.common("exponent", 1.1..2.0));
    let share = d.common("share_of_beta", 0.55..0.85);
    bouc_wen(&w.t_c[a], limit, n, share, -w.plan.branch * 0.8 * limit)
}

/// Duhem's form after Coleman and Hodgdon, about a saturating curve.
pub fn duhem_loop(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (span, centre) = (d.own("span_c", 9.0..18.0), d.own("centre_c", 0.0..20.0));
    let curve = |t: f64| ((t - centre) / 30.0).tanh();
    duhem(&w.t_c[a], span, 0.004, curve, curve(w.start_c()) + 0.2 * w.plan.branch)
}

/// Dry friction after Dahl.
pub fn dahl_friction(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    dahl(&w.t_c[a], d.own("span_c", 5.0..12.0), -0.8 * w.plan.branch)
}

/// A play whose share grows with temperature.
pub fn growing_gain(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (half, span) = (d.own("half_c", 4.0..8.0), d.common("growth_span_c", 25.0..40.0));
    one_play(w, a, half).iter().zip(&w.t_c[a]).map(|(x, t)| x * (t / span).exp()).collect()
}

/// A play whose width grows with temperature.
pub fn growing_width(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (half, span) = (d.own("half_at_0_c", 3.0..5.0), d.common("growth_span_c", 30.0..45.0));
    let start = play_start(w, half * (w.start_c() / span).exp());
    minus(&play_by(&w.t_c[a], start, |t| half * (t / span).exp()), &w.t_c[a])
}

/// A contact that closes at one temperature and opens at another.
pub fn two_thresholds(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (down, gap) = (d.own("opens_c", -12.0..12.0), d.own("gap_c", 12.0..25.0));
    relay(&w.t_c[a], down, down + gap, w.plan.branch)
}

/// Two contacts, each with its pair of thresholds.
pub fn two_contacts(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let cold = (d.own("cold_c", -25.0..-5.0), d.own("cold_half_c", 3.0..7.0), 1.0);
    let warm = (d.own("warm_c", 22.0..42.0), d.own("warm_half_c", 3.0..8.0), d.own("warm_weight", -1.3..-0.6));
    relays(w, a, &[cold, warm])
}

/// Joints that slip until they hold, squared: butterfly loops.
pub fn butterfly(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let half = d.own("half_c", 9.0..16.0);
    let middle = d.own("middle", 0.2..0.5);
    one_play(w, a, half).iter().map(|x| (x / half - middle).powi(2)).collect()
}

/// The hottest and the coldest that the unit has met since power-on.
pub fn extremes(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let cold_weight = d.own("cold_weight", 0.4..0.9);
    let (mut hottest, mut coldest) = (w.start_c(), w.start_c());
    w.t_c[a]
        .iter()
        .map(|&t| {
            hottest = hottest.max(t);
            coldest = coldest.min(t);
            hottest + cold_weight * coldest
        })
        .collect()
}

/// A play on a body slower than the resonator.
pub fn play_on_slow_body(d: &mut Draw, w: &World, a: usize) -> Vec<f64> {
    let (tau_s, half) = (d.own("tau_s", 500.0..900.0), d.own("half_c", 5.0..10.0));
    let body = lag(&w.t_c[a], w.dt_s, tau_s, w.start_c());
    minus(&play(&body, half, play_start(w, half)), &body)
}
