//! The seeded campaigns behind `docs/alignment.md`. Everything simulated.

use super::plant::Plant;
use super::{FilterKind, Start};
use hrg_align::aligner::INTEGRITY_LIMIT;
use hrg_align::{wrap, ARCMIN, DEGREE, DPH};
use hrg_data::numeric::stats::quantile;
use hrg_data::plot;
use hrg_data::plot::{Panel, Series};
use std::fmt::Write as _;

/// Results of one filter over a campaign.
#[derive(Debug, Clone)]
pub struct Row {
    /// Name of the case.
    pub name: String,
    /// Errors of azimuth at the end, arc minutes, run by run; infinite where the filter broke down.
    pub errors: Vec<f64>,
    /// Seconds from the end of the turn to an error that stays within 15'; runs that never got there are infinite.
    pub convergence_s: Vec<f64>,
    /// Mean of the squared errors of azimuth over their variance: 1 where standard deviations are true.
    pub normalised: f64,
    /// Runs that were refused by the aligner.
    pub refused: usize,
}

/// A failure: an error beyond this, arc minutes.
const FAILED: f64 = 60.0;

fn campaign(name: &str, filter: FilterKind, plants: &[Plant], start: impl Fn(u64) -> Start) -> Row {
    stated(name, filter, plants, start, [None; 2])
}

/// The same, with the drift that comes with the turn (deg/h) and the turn's error (arc minutes) stated, one sigma.
fn stated(
    name: &str,
    filter: FilterKind,
    plants: &[Plant],
    start: impl Fn(u64) -> Start,
    [heading_drift_dph, turn_error_arcmin]: [Option<f64>; 2],
) -> Row {
    let mut row = Row { name: name.into(), errors: vec![], convergence_s: vec![], normalised: 0.0, refused: 0 };
    let mut squares = Vec::new();
    for (k, plant) in plants.iter().enumerate() {
        let (played, truth) = plant.play();
        let recording = super::Recording { heading_drift_dph, turn_error_arcmin, ..played };
        let Ok(config) = recording.config() else { continue };
        let (outcome, _, history) = filter.run(&recording, &config, start(k as u64));
        row.refused += usize::from(outcome.is_err());
        let Some((_, _, last)) = history.last() else {
            row.errors.push(f64::INFINITY);
            continue;
        };
        let error = wrap(last.azimuth - truth.azimuth);
        row.errors.push(error.abs() / ARCMIN);
        squares.push((error / last.azimuth_std).powi(2));
        let turn_end = (plant.seconds[0] + plant.seconds[1]) as f64;
        let settled = history
            .iter()
            .rev()
            .take_while(|(_, _, e)| wrap(e.azimuth - truth.azimuth).abs() < 15.0 * ARCMIN)
            .last()
            .map_or(f64::INFINITY, |(t, _, _)| (t - turn_end).max(0.0));
        row.convergence_s.push(settled);
    }
    row.normalised = hrg_data::numeric::stats::mean(&squares);
    row
}

fn ranked(values: &[f64], p: f64) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    v.get(((v.len() as f64 * p) as usize).min(v.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
}

/// All campaigns: `runs` platforms each, those of the particle filters included.
#[must_use]
pub fn campaigns(runs: u64, seed: u64) -> Vec<Row> {
    let drawn: Vec<Plant> = (0..runs).map(|k| Plant::drawn(seed * 100_000 + k)).collect();
    let with = |edit: &dyn Fn(Plant) -> Plant| -> Vec<Plant> { drawn.iter().map(|p| edit(*p)).collect() };
    let nominal = Start::default();
    let seeded = |k: u64| Start { seed: seed.wrapping_add(k), ..nominal };
    // The EKF's first azimuth: anywhere, and taken as known.
    let anywhere =
        |k: u64| Start { azimuth_deg: (k as f64 * 137.507_764) % 360.0 - 180.0, azimuth_std_deg: 60.0, seed: k };
    let rough = with(&|p| Plant { velocity_noise: 1e-3, angle_random_walk: 1e-3 * DEGREE / 60.0, ..p });
    let signed = |p: &Plant, size: f64| if p.seed.is_multiple_of(2) { size } else { -size };
    vec![
        campaign("linear", FilterKind::Linear, &drawn, seeded),
        campaign("linear, single precision", FilterKind::LinearSingle, &drawn, seeded),
        campaign("upf, kernel form", FilterKind::Upf, &drawn, seeded),
        campaign("upf, literal", FilterKind::UpfLiteral, &drawn, seeded),
        campaign("ekf from any first azimuth", FilterKind::Ekf, &drawn, anywhere),
        campaign("linear, noise of 1 mm/s and 0.001 deg/sqrt(h)", FilterKind::Linear, &rough, seeded),
        campaign(
            "linear, turn of 180 deg",
            FilterKind::Linear,
            &with(&|p| Plant { turn: 180.0 * DEGREE, ..p }),
            seeded,
        ),
        campaign(
            "linear, turn wrong by 6'",
            FilterKind::Linear,
            &with(&|p| Plant { turn_error: signed(&p, 6.0 * ARCMIN), ..p }),
            seeded,
        ),
        campaign(
            "linear, 0.02 deg/h of drift come with the turn",
            FilterKind::Linear,
            &with(&|p| Plant { heading_drift: [signed(&p, 0.02 * DPH), 0.0], ..p }),
            seeded,
        ),
        campaign(
            "linear, one position of 200 s",
            FilterKind::Linear,
            &with(&|p| Plant { seconds: [200, 0, 0], ..p }),
            seeded,
        ),
    ]
}

/// Changes that come with the turn, drawn for each platform, one sigma: drift of each axis, deg/h, and the turn's error, arc minutes.
pub const WITH_THE_TURN: [f64; 2] = [0.02, 6.0];

/// Platforms whose drifts change with the heading, and whose turns are wrong, by [`WITH_THE_TURN`]: with neither, either and both of them,
/// as the filter takes them where nothing is stated, and where they are.
#[must_use]
pub fn with_the_turn(runs: u64, seed: u64) -> Vec<Row> {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let [drift_dph, error_arcmin] = WITH_THE_TURN;
    let plants = |drift: bool, error: bool| -> Vec<Plant> {
        (0..runs)
            .map(|k| {
                let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64((seed * 100_000 + k) ^ 0x7142);
                let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
                let [first, second, turn] = [normal(), normal(), normal()];
                let p = Plant::drawn(seed * 100_000 + k);
                let size = if drift { drift_dph * DPH } else { 0.0 };
                let turn_error = if error { turn * error_arcmin * ARCMIN } else { 0.0 };
                Plant { heading_drift: [first * size, second * size], turn_error, ..p }
            })
            .collect()
    };
    let seeded = |k: u64| Start { seed: seed.wrapping_add(k), ..Start::default() };
    let mut rows = Vec::new();
    for (name, drift, error) in
        [("drift with the heading", true, false), ("wrong turn", false, true), ("both", true, true)]
    {
        let own = plants(drift, error);
        rows.push(campaign(&format!("linear, {name}, not stated"), FilterKind::Linear, &own, seeded));
        let known = [drift.then_some(drift_dph), error.then_some(error_arcmin)];
        rows.push(stated(&format!("linear, {name}, stated"), FilterKind::Linear, &own, seeded, known));
    }
    rows
}

/// The campaigns as Markdown.
#[must_use]
pub fn table(rows: &[Row]) -> String {
    let mut s = String::from(
        "| filter | median ['] | 95 % ['] | largest ['] | beyond 60' | refused | to 15' after the turn, median [s] | normalised error squared |\n|---|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    let number = |v: f64, digits: usize| if v.is_finite() { format!("{v:.digits$}") } else { "never".into() };
    for r in rows {
        let failed = r.errors.iter().filter(|e| !(**e <= FAILED)).count();
        let _ = writeln!(
            s,
            "| {} | {} | {} | {} | {failed} of {} | {} | {} | {} |",
            r.name,
            number(ranked(&r.errors, 0.5), 2),
            number(ranked(&r.errors, 0.95), 2),
            number(ranked(&r.errors, 1.0), 1),
            r.errors.len(),
            r.refused,
            number(ranked(&r.convergence_s, 0.5), 0),
            number(r.normalised, 2)
        );
    }
    s
}

/// Tests if a turn's error shows: the share of runs whose check of the positions (chi-square, one degree of freedom) is beyond 3.84 (one in
/// twenty without an error), for turns wrong by some arc minutes.
#[must_use]
pub fn turn_error_seen(runs: u64, seed: u64, errors_arcmin: &[f64]) -> Vec<(f64, f64, f64)> {
    errors_arcmin
        .iter()
        .map(|&size| {
            let (mut seen, mut refused) = (0, 0);
            for k in 0..runs {
                let plant = Plant { turn_error: size * ARCMIN, ..Plant::drawn(seed * 100_000 + k) };
                let (recording, _) = plant.play();
                let Ok(config) = recording.config() else { continue };
                let (_, _, history) = FilterKind::Linear.run(&recording, &config, Start::default());
                let check = history.last().and_then(|h| h.2.integrity).unwrap_or(0.0);
                seen += usize::from(check > 3.84);
                refused += usize::from(check > INTEGRITY_LIMIT);
            }
            (size, seen as f64 / runs as f64, refused as f64 / runs as f64)
        })
        .collect()
}

/// chen2015's case, filter by filter, in two positions and in one: errors over time as curves (its Fig. 3 to 5).
///
/// # Errors
/// If the drawing library fails.
pub fn curves(seed: u64) -> anyhow::Result<String> {
    let two = Plant::chen(seed);
    let one = Plant { seconds: [200, 0, 0], ..two };
    let mut azimuth = Vec::new();
    let mut tilt = Vec::new();
    let mut drift = Vec::new();
    let cases = [
        ("linear", FilterKind::Linear, two, 1),
        ("UPF, kernel form", FilterKind::Upf, two, 2),
        ("EKF from 0 deg", FilterKind::Ekf, two, 3),
        ("linear, one position", FilterKind::Linear, one, 0),
    ];
    for (label, filter, plant, colour) in cases {
        let (recording, truth) = plant.play();
        let Ok(config) = recording.config() else { continue };
        let (_, _, history) = filter.run(&recording, &config, Start { seed, ..Start::default() });
        let series = |f: &dyn Fn(&hrg_align::Estimate) -> f64| Series {
            label: label.into(),
            points: history.iter().map(|(t, _, e)| (*t, f(e))).collect(),
            colour,
            dots: false,
        };
        let clip = |v: f64, most: f64| if v.abs() <= most { v } else { f64::NAN };
        azimuth.push(series(&|e| clip(wrap(e.azimuth - truth.azimuth) / ARCMIN, 120.0)));
        tilt.push(series(&|e| e.tilt_std[0] / ARCMIN));
        drift.push(series(&|e| clip((e.drift[0] - truth.drift[0]) / DPH, 0.5)));
    }
    let panel = |title: &str, y: &str, series| Panel {
        title: title.into(),
        x: "time [s]".into(),
        y: y.into(),
        log: false,
        series,
    };
    plot::svg(
        &[
            panel("Azimuth error, chen2015's case (turn from 85 to 115 s)", "arc minutes", azimuth),
            panel("Standard deviation of the tilt about axis 1", "arc minutes", tilt),
            panel("Error of the drift about axis 1", "deg/h", drift),
        ],
        1,
        900,
        330,
    )
}

/// Median of some errors' sizes, and their 95th percentile.
fn sizes(errors: &[f64], digits: usize) -> String {
    let sizes: Vec<f64> = errors.iter().map(|e| e.abs()).collect();
    format!("{:.digits$} ({:.digits$})", ranked(&sizes, 0.5), ranked(&sizes, 0.95))
}

/// chen2015's case at its end, over draws of noise 0 to `runs`: errors of azimuth, tilts (arc minutes) and drifts (deg/h), filter by filter.
#[must_use]
pub fn chen(runs: u64) -> String {
    let mut s = String::from(
        "| filter | azimuth ['] | mean of it | stated | tilt 1 ['] | tilt 2 ['] | drift 1 [deg/h] | drift 2 [deg/h] | refused |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    for filter in [FilterKind::Linear, FilterKind::Upf, FilterKind::UpfLiteral, FilterKind::Ekf] {
        // Azimuth, its deviation, tilts and drifts.
        let mut errors: [Vec<f64>; 6] = Default::default();
        let mut refused = 0;
        for seed in 0..runs {
            let (recording, truth) = Plant::chen(seed).play();
            let Ok(config) = recording.config() else { continue };
            let (outcome, _, history) = filter.run(&recording, &config, Start { seed, ..Start::default() });
            refused += usize::from(outcome.is_err());
            let Some((_, _, e)) = history.last() else { continue };
            let of = [
                wrap(e.azimuth - truth.azimuth) / ARCMIN,
                e.azimuth_std / ARCMIN,
                (e.tilt[0] - truth.tilt[0]) / ARCMIN,
                (e.tilt[1] - truth.tilt[1]) / ARCMIN,
                (e.drift[0] - truth.drift[0]) / DPH,
                (e.drift[1] - truth.drift[1]) / DPH,
            ];
            errors.iter_mut().zip(of).for_each(|(all, one)| all.push(one));
        }
        let _ = writeln!(
            s,
            "| {} | {} | {:.2} | {:.2} | {} | {} | {} | {} | {refused} of {runs} |",
            filter.name(),
            sizes(&errors[0], 2),
            hrg_data::numeric::stats::mean(&errors[0]),
            ranked(&errors[1], 0.5),
            sizes(&errors[2], 3),
            sizes(&errors[3], 3),
            sizes(&errors[4], 4),
            sizes(&errors[5], 4),
        );
    }
    s
}

/// Platforms of a campaign, and their seed, unless told otherwise.
pub const RUNS: u64 = 200;
/// See [`RUNS`].
pub const SEED: u64 = 1;

/// Text above [`claims`].
pub const CLAIMS: &str = "## chen2015's claims\nThe times that it claims, read off its figures 3 to 5 (one position) and its turntable, beside ours on its case over the same draws (median, 5 to 95 %), where the second\nposition begins at 115 s. One position cannot do what it claims, with any filter: [papers.md](papers.md).\n";

/// chen2015's headline claims beside ours, on its case, over draws of noise 0 to `runs`: when errors have come within a limit for good. Theirs are its
/// figures 3 to 5 and its turntable, as it prints them.
#[must_use]
pub fn claims(runs: u64) -> String {
    let mut s = String::from("| what | theirs | linear | upf | ekf |\n|---|---|--:|--:|--:|\n");
    let filters = [FilterKind::Linear, FilterKind::Upf, FilterKind::Ekf];
    const LIMITS: [f64; 3] = [7.0, 4.0, 15.0];
    // Seconds, by what is claimed and by filter.
    let mut seconds: [[Vec<f64>; 3]; 4] = Default::default();
    for seed in 0..runs {
        let (recording, truth) = Plant::chen(seed).play();
        let Ok(config) = recording.config() else { continue };
        for (k, filter) in filters.iter().enumerate() {
            let history = filter.run(&recording, &config, Start { seed, ..Start::default() }).2;
            for (n, limit) in LIMITS.into_iter().enumerate() {
                let good = |e: &hrg_align::Estimate| wrap(e.azimuth - truth.azimuth).abs() < limit * ARCMIN;
                let since = history.iter().rev().take_while(|(_, _, e)| good(e)).last();
                seconds[n][k].push(since.map_or(f64::INFINITY, |h| h.0));
            }
            // In the first position, where tilts are those at its start grown by what the platform turns.
            let level = history.iter().find(|(_, _, e)| e.tilt_std.iter().all(|s| 2.0 * s <= ARCMIN));
            seconds[3][k].push(level.map_or(f64::INFINITY, |h| h.0));
        }
    }
    let text = |v: &[f64]| {
        let second = |p: f64| match ranked(v, p) {
            s if s.is_finite() => format!("{s:.0}"),
            _ => "never".into(),
        };
        format!("{} s ({} to {})", second(0.5), second(0.05), second(0.95))
    };
    let rows = [
        ("azimuth within 7' for good", "160 s (EKF)"),
        ("azimuth within 4' for good", "70 s (UPF)"),
        ("azimuth within 15' for good", "80 s (UPF, turntable)"),
        ("tilts known to 1' (two sigma)", "20 s"),
    ];
    for ((what, theirs), ours) in rows.into_iter().zip(&seconds) {
        let [linear, upf, ekf] = ours.each_ref().map(|v| text(v));
        let _ = writeln!(s, "| {what} | {theirs} | {linear} | {upf} | {ekf} |");
    }
    s
}

/// Median azimuth error in one position for drifts known to so many deg/h: what no filter can do better.
#[must_use]
pub fn one_position(runs: u64, seed: u64, known_dph: &[f64]) -> Vec<(f64, f64, f64)> {
    known_dph
        .iter()
        .map(|&known| {
            let (mut errors, mut stds) = (Vec::new(), Vec::new());
            for k in 0..runs {
                let drawn = Plant::drawn(seed * 100_000 + k);
                // Drifts of that size, and taken to be.
                let drift = drawn.drift.map(|d| d / 0.2 * known);
                let (recording, truth) = Plant { drift, seconds: [200, 0, 0], ..drawn }.play();
                let Ok(mut config) = recording.config() else { continue };
                config.drift = known * DPH;
                let (_, _, history) = FilterKind::Linear.run(&recording, &config, Start::default());
                if let Some((_, _, e)) = history.last() {
                    errors.push((wrap(e.azimuth - truth.azimuth) / ARCMIN).powi(2));
                    stds.push(e.azimuth_std / ARCMIN);
                }
            }
            (known, hrg_data::numeric::stats::mean(&errors).sqrt(), quantile(&stds, 0.5))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_with_the_turn_is_in_the_uncertainty_where_it_is_stated() {
        // 800 platforms: the mean of their squares scatters by 0.05.
        let rows = with_the_turn(800, 3);
        print!("{}", table(&rows));
        for pair in rows.chunks_exact(2) {
            assert!(pair[0].normalised > 1.3, "{}: {}", pair[0].name, pair[0].normalised);
            assert!((0.9..1.15).contains(&pair[1].normalised), "{}: {}", pair[1].name, pair[1].normalised);
            // Nor are platforms refused for what is stated.
            assert!(pair[0].refused > 20 && pair[1].refused < 8, "{}: {}", pair[1].name, pair[1].refused);
        }
        // Without a turn that brings anything, nothing changes; with a turn of 180 degrees a drift counts for less.
        let config = Plant::chen(1).play().0.config().expect("a site");
        assert_eq!(config.turn_variances(1.5), [0.0; 2]);
        let config = hrg_align::Config { heading_drift: 0.02 * DPH, ..config };
        let std_arcmin = |angle: f64| config.turn_variances(angle * DEGREE)[0].sqrt() / ARCMIN;
        // 0.02 deg/h over 2 * 15.04 * cos 45 deg * sin(b/2).
        assert!(
            (std_arcmin(90.0) - 4.571).abs() < 0.01 && (std_arcmin(180.0) - 3.232).abs() < 0.01,
            "{}",
            std_arcmin(90.0)
        );
    }

    #[test]
    fn the_page_has_the_figures_of_this_program() {
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/alignment-results.md");
        let page = std::fs::read_to_string(page).expect("there");
        let drawn: Vec<Plant> = (0..RUNS).map(|k| Plant::drawn(SEED * 100_000 + k)).collect();
        let row = campaign("linear", FilterKind::Linear, &drawn, |k| Start { seed: SEED + k, ..Start::default() });
        let known = one_position(RUNS, SEED, &[0.1])[0];
        let stated = [
            table(&[row]).lines().last().unwrap_or("").to_string(),
            table(&with_the_turn(RUNS, SEED)),
            format!("| 0.1 | {:.1} | {:.1} |", known.1, known.2),
            CLAIMS.to_string(),
        ];
        for s in stated {
            assert!(
                page.contains(&s),
                "docs/alignment-results.md is behind (cargo xtask align-demo prints it anew): {s}"
            );
        }
    }
}
