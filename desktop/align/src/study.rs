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

/// The numbers of chen2015's case at its end: filter, azimuth (deg), tilts (arc minutes) and drifts (deg/h) with their
/// errors.
#[must_use]
pub fn chen(seed: u64) -> String {
    let plant = Plant::chen(seed);
    let (recording, truth) = plant.play();
    let mut s = String::from(
        "| | azimuth [deg] | error ['] | tilt 1 ['] | error | tilt 2 ['] | error | drift 1 [deg/h] | error | drift 2 [deg/h] | error |\n|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n",
    );
    let Ok(config) = recording.config() else { return s };
    for filter in [FilterKind::Linear, FilterKind::Upf, FilterKind::UpfLiteral, FilterKind::Ekf] {
        let (_, _, history) = filter.run(&recording, &config, Start { seed, ..Start::default() });
        let Some((_, _, e)) = history.last() else {
            let _ = writeln!(s, "| {} | broke down |", filter.name());
            continue;
        };
        let _ = write!(
            s,
            "| {} | {:.3} | {:.2} ",
            filter.name(),
            e.azimuth / DEGREE,
            wrap(e.azimuth - truth.azimuth) / ARCMIN
        );
        for k in 0..2 {
            let _ = write!(s, "| {:.3} | {:.3} ", e.tilt[k] / ARCMIN, (e.tilt[k] - truth.tilt[k]) / ARCMIN);
        }
        for k in 0..2 {
            let _ = write!(s, "| {:.4} | {:.4} ", e.drift[k] / DPH, (e.drift[k] - truth.drift[k]) / DPH);
        }
        s.push_str("|\n");
    }
    s
}

/// Text above [`claims`].
pub const CLAIMS: &str = "## chen2015's claims\nThe times that it claims, read off its figures 3 to 5 (one position) and its turntable, beside ours on its case, where the second\nposition begins at 115 s. One position cannot do what it claims, with any filter: [papers.md](papers.md).\n";

/// chen2015's headline claims beside ours, on its case: when errors have come within a limit for good. Theirs are its figures 3 to 5 and its
/// turntable, as it prints them.
#[must_use]
pub fn claims(seed: u64) -> String {
    let plant = Plant::chen(seed);
    let (recording, truth) = plant.play();
    let mut s = String::from("| what | theirs | linear | upf | ekf |\n|---|---|--:|--:|--:|\n");
    let Ok(config) = recording.config() else { return s };
    let filters = [FilterKind::Linear, FilterKind::Upf, FilterKind::Ekf];
    let histories = filters.map(|f| f.run(&recording, &config, Start { seed, ..Start::default() }).2);
    // The first second from which on the error stays within a limit.
    let since = |history: &[(f64, u8, hrg_align::Estimate)], good: &dyn Fn(f64, &hrg_align::Estimate) -> bool| {
        history
            .iter()
            .rev()
            .take_while(|(t, _, e)| good(*t, e))
            .last()
            .map_or("never".to_string(), |h| format!("{:.0} s", h.0))
    };
    let azimuth = |limit: f64| {
        histories.each_ref().map(|h| since(h, &|_, e| wrap(e.azimuth - truth.azimuth).abs() < limit * ARCMIN))
    };
    // In the first position, where tilts are those at its start grown by what the platform turns.
    let level = histories.each_ref().map(|h| {
        h.iter()
            .find(|(_, _, e)| e.tilt_std.iter().all(|s| 2.0 * s <= ARCMIN))
            .map_or("never".into(), |h| format!("{:.0} s", h.0))
    });
    let rows = [
        ("azimuth within 7' for good", "160 s (EKF)", azimuth(7.0)),
        ("azimuth within 4' for good", "70 s (UPF)", azimuth(4.0)),
        ("azimuth within 15' for good", "80 s (UPF, turntable)", azimuth(15.0)),
        ("tilts known to 1' (two sigma)", "20 s", level),
    ];
    for (what, theirs, [linear, upf, ekf]) in rows {
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
    fn the_page_has_the_claims_as_they_are() {
        let claims = claims(1);
        println!("{CLAIMS}\n{claims}");
        let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/alignment-results.md");
        let page = std::fs::read_to_string(page).expect("there");
        assert!(page.contains(&claims) && page.contains(CLAIMS), "docs/alignment-results.md is behind: {claims}");
    }
}
