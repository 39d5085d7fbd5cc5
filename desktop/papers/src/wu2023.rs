//! wu2023 from end to end, on a simulated gyro of its kind that has temperature sensors and no resonator: identified on a cooling and a
//! heating run, corrected as the unit would, and measured again on another profile, one direction after the other.
//!
//! Each step is a file that the next one reads, as with `hrg simulate`, `hrg fit` and `hrg correct`.

use crate::method::Method;
use crate::methods;
use hrg_core::AXES;
use hrg_data::image_file;
use hrg_data::numeric::stats::{block_means, std_dev};
use hrg_data::recording::thermometer::Thermometer;
use hrg_data::recording::{columns, parquet, Recording};
use hrg_identify::fit;
use hrg_identify::fit::correct;
use hrg_identify::fit::MEAN_S;
use hrg_simulate::{Kind, Plan, Profile};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

/// A run: its name, its profile, the seed of its noise.
struct Run {
    name: &'static str,
    profile: &'static str,
    seed: u64,
}

/// Runs to learn from: 1 C per minute over the whole range, a power-on for each direction.
const TRAIN: [Run; 2] = [
    Run { name: "cooling", profile: "60,1h,-40@1,1h", seed: 11 },
    Run { name: "heating", profile: "-40,1h,60@1,1h", seed: 12 },
];

/// Run to judge on: other ramps, other ends, cooling and then heating in one run.
const VERIFY: Run = Run { name: "verify", profile: "55,30m,-35@0.9,1h,50@0.8,1h", seed: 21 };

/// The unit.
const UNIT: u64 = 3;

/// The baseline, the paper's model by the exact solution, and by its swarm.
const METHODS: [Method; 4] = [Method::Lsq, Method::TwoSets, Method::FogLsq, Method::FogPso];

/// Standard deviation of the 100 s means of some rows of each axis, deg/h.
fn deviation(r: &Recording, rows: Range<usize>) -> [f64; AXES] {
    r.rate_dph.each_ref().map(|rate| std_dev(&block_means(&rate[rows.clone()], MEAN_S)))
}

/// The rows of the verify run, by what it does there. The first mean is left out: the first row of a unit has no bias yet.
fn parts(r: &Recording) -> [(&'static str, Range<usize>); 3] {
    let chamber = r.column(columns::CHAMBER.name(0)).unwrap_or_default();
    // The last of its lowest temperatures: from there on it heats.
    let coldest = (0..chamber.len()).rev().min_by(|a, b| chamber[*a].total_cmp(&chamber[*b])).unwrap_or(0);
    let (first, turn, end) = (MEAN_S, coldest.max(MEAN_S), r.time_s.len().max(MEAN_S));
    [("cooling", first..turn), ("heating", turn..end), ("whole run", first..end)]
}

/// Writes a run into the folder and reads it as a user would.
fn run(folder: &Path, d: &Run) -> anyhow::Result<Recording> {
    let plan = Plan {
        kind: Kind::Fog,
        noise: Kind::Fog.noise(),
        thermometer: Thermometer::Sensors,
        ..Plan::of(Profile::parse(d.profile)?, UNIT, d.seed)
    };
    let path = folder.join(format!("{}.csv", d.name));
    hrg_data::output::write_file(&path, plan.simulate().recording.to_csv().as_bytes())?;
    Recording::load(&path)
}

/// Runs it all in a folder; gives what it came to as text.
///
/// # Errors
/// A folder that cannot be written.
pub fn report(folder: &Path) -> anyhow::Result<String> {
    let train = TRAIN.iter().map(|d| run(folder, d)).collect::<anyhow::Result<Vec<_>>>()?;
    let verify = run(folder, &VERIFY)?;
    let prepared = fit::prepare(&train)?;
    let mut reached = Vec::new();
    let mut corrected = Vec::new();
    for method in METHODS {
        let mut found = methods::identify(&prepared, method, 1)?;
        found.calibration.sequence = 1;
        reached.extend(found.notes.iter().filter(|n| n.contains("breakpoint")).map(|n| format!("{method} {n}")));
        let path = folder.join(format!("{method}.toml"));
        image_file::save(&path, &found.calibration)?;
        let image = image_file::load(&path)?;
        // As it was read, before any cleaning: a unit sees it so.
        let raw = Recording::parse(&parquet::read_text(&folder.join(format!("{}.csv", VERIFY.name)))?)?;
        let seconds = correct::recording(&image, &raw)?.seconds;
        let text = correct::to_csv(&raw, "corrected on the desktop", raw.power_on_s(), Some(&image), &seconds);
        let path = folder.join(format!("{}-{method}.csv", VERIFY.name));
        hrg_data::output::write_file(&path, text.as_bytes())?;
        corrected.push((method, Recording::load(&path)?));
    }
    let mut s = format!(
        "A simulated gyro like wu2023's with a temperature sensor in each axis (noise 0.001 C) and no resonator.\nLearnt from a cooling and a heating run ({}; {}), judged on another ({}).\nStandard deviation of 100 s means [deg/h]; in brackets what the correction takes off it. Its noise alone has {:.4}.\n\n",
        TRAIN[0].profile,
        TRAIN[1].profile,
        VERIFY.profile,
        Kind::Fog.noise().white_100s_dph
    );
    let _ = writeln!(s, "   {:<11}{:<10}{:>9}{:>20}{:>20}", "", "method", "x", "y", "z");
    for (part, rows) in parts(&verify) {
        let raw = deviation(&verify, rows.clone());
        let _ = writeln!(s, "   {part:<11}{:<10}{:>9.5}{:>20.5}{:>20.5}", "raw", raw[0], raw[1], raw[2]);
        for (method, r) in &corrected {
            let after = deviation(r, rows.clone());
            let _ = write!(s, "   {part:<11}{:<10}", method.name());
            for a in 0..AXES {
                let share = format!("({:.0} %)", 100.0 * (1.0 - after[a] / raw[a]));
                let width = if a == 0 { 9 } else { 11 };
                let _ = write!(s, "{:>width$.5} {share:<8}", after[a]);
            }
            s.truncate(s.trim_end().len());
            s.push('\n');
        }
    }
    let _ = writeln!(
        s,
        "\n   found: {}\n   wu2023's own gyro (measured by its author, smoothed over 100 s): 0.01563 raw, 0.00612 by its swarm, 0.00695 (56 %) burnt\n   and run again",
        reached.join("; ")
    );
    Ok(s)
}
