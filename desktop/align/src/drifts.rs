//! Drifts of a platform's gyros, alignment by alignment (chen2015, eq 21): a file that grows by a line with each, and the new one
//! compared with those before.

use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{mean, std_dev};
use std::fmt::Write as _;
use std::path::Path;

const HEADER: &str = "unix_s,azimuth_deg,turn_deg,drift1_1_dph,drift2_1_dph,drift1_2_dph,drift2_2_dph";
/// Numbers of a line.
const NUMBERS: usize = 7;
/// Alignments before, from which on there is something to compare with.
const FEWEST: usize = 3;
/// A drift that is further from the mean of those before than so many of their standard deviations has changed.
const CHANGED: f64 = 3.0;

/// One alignment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// Time, seconds since 1970.
    pub unix_s: u32,
    /// Azimuth, degrees.
    pub azimuth_deg: f64,
    /// Angle of the turn, degrees.
    pub turn_deg: f64,
    /// Drifts about axes 1 and 2 in position 1 and in position 2, deg/h.
    pub drift_by_position_dph: [[f64; 2]; 2],
}

/// Reads a file of drifts; none where it is not there yet.
///
/// # Errors
/// One sentence with path and line.
pub fn load(path: &Path) -> Result<Vec<Entry>, BadInput> {
    if !path.exists() {
        return Ok(vec![]);
    }
    let bytes = hrg_data::files::read_file(path, hrg_data::files::MOST_RECORDING, true)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty());
    if lines.next().is_some_and(|(_, l)| l.trim() != HEADER) {
        return Err(BadInput::new(format!(
            "{}: not a file of drifts: it begins otherwise than {HEADER}",
            path.display()
        )));
    }
    lines
        .map(|(n, line)| {
            let cells: Vec<f64> = line.split(',').filter_map(|c| c.trim().parse().ok()).collect();
            let [unix_s, azimuth_deg, turn_deg, a, b, c, d]: [f64; NUMBERS] = cells.try_into().map_err(|_| {
                BadInput::new(format!("{}: line {} does not have {NUMBERS} numbers", path.display(), n + 1))
            })?;
            Ok(Entry { unix_s: unix_s as u32, azimuth_deg, turn_deg, drift_by_position_dph: [[a, b], [c, d]] })
        })
        .collect()
}

/// Writes a file of drifts.
///
/// # Errors
/// If it cannot be written.
pub fn save(path: &Path, all: &[Entry]) -> anyhow::Result<()> {
    let mut text = format!("{HEADER}\n");
    for e in all {
        let [[a, b], [c, d]] = e.drift_by_position_dph;
        let _ = writeln!(text, "{},{:.4},{},{a:.5},{b:.5},{c:.5},{d:.5}", e.unix_s, e.azimuth_deg, e.turn_deg);
    }
    hrg_data::output::write_file(path, text.as_bytes())
}

/// Compares the drifts with earlier ones: a sentence for each gyro and position. Entries before count only if they had the same turn.
#[must_use]
pub fn compare(before: &[Entry], now: &Entry) -> Vec<String> {
    let alike: Vec<&Entry> = before.iter().filter(|e| (e.turn_deg - now.turn_deg).abs() < 1.0).collect();
    if alike.len() < FEWEST {
        return vec![format!(
            "{} alignments before with this turn: {FEWEST} are needed to tell whether a drift has changed",
            alike.len()
        )];
    }
    let mut out = Vec::new();
    for position in 0..2 {
        for axis in 0..2 {
            let old: Vec<f64> = alike.iter().map(|e| e.drift_by_position_dph[position][axis]).collect();
            let (m, s) = (mean(&old), std_dev(&old));
            let new = now.drift_by_position_dph[position][axis];
            let changed = (new - m).abs() > CHANGED * s;
            out.push(format!(
                "gyro {}, position {}: {new:.4} deg/h, before {m:.4} +- {s:.4} ({} alignments){}",
                axis + 1,
                position + 1,
                old.len(),
                if changed { ": changed; look at its calibration" } else { "" }
            ));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drifts_are_kept_and_a_changed_one_is_named() {
        let entry = |k: u32, extra: f64| {
            let wobble = 0.01 * f64::from(k % 3);
            let drift_by_position_dph = [[0.1 + wobble, -0.2 + extra], [0.12 + wobble, -0.19 + wobble]];
            Entry { unix_s: 1_795_219_200 + k, azimuth_deg: 100.5, turn_deg: 90.0, drift_by_position_dph }
        };
        let path = std::env::temp_dir().join(format!("hrg-drifts-{}.csv", std::process::id()));
        let _ = std::fs::remove_file(&path);
        assert_eq!(load(&path), Ok(vec![]));
        let all: Vec<Entry> = (0..6).map(|k| entry(k, 0.005 * f64::from(k % 2))).collect();
        save(&path, &all).expect("written");
        let read = load(&path).expect("read");
        assert_eq!(read.len(), all.len());
        for (r, a) in read.iter().zip(&all) {
            let both = r.drift_by_position_dph.as_flattened().iter().zip(a.drift_by_position_dph.as_flattened());
            assert!(r.unix_s == a.unix_s && both.into_iter().all(|(x, y)| (x - y).abs() < 1e-5), "{r:?} {a:?}");
        }
        assert!(compare(&read[..2], &all[3])[0].contains("are needed"));
        let words = compare(&read, &entry(7, 0.3));
        assert!(words[1].contains("gyro 2, position 1") && words[1].contains("changed"), "{words:?}");
        assert_eq!(words.iter().filter(|w| w.contains("changed")).count(), 1, "{words:?}");
        std::fs::write(&path, "a,b\n").expect("written");
        assert!(load(&path).expect_err("refused").0.contains("not a file of drifts"));
        let _ = std::fs::remove_file(&path);
    }
}
