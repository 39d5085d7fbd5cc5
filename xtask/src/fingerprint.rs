//! `cargo xtask fingerprint`: what the project computes, a checksum a result, to compare before and after a change that should change
//! nothing. `hrg-study fingerprint` computes images, calibration files, frames and corrected recordings; here are the traces of twenty
//! units and a short study. All files stay in `target/fingerprint`, to see where two differ.

use crate::{foreign_plant, root, study, Failure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Units of the second plant, seed 1: one of each class, files of other forms, clean ones.
const FOREIGN: [&str; 10] = [
    "memory-rod",
    "hysteresis-crossing-plays",
    "shape-hinges",
    "rate-saturating",
    "power-on-stretched",
    "input-supply",
    "event-step",
    "file-defects",
    "file-one-sensor",
    "clean-flicker",
];

/// Units of `hrg simulate`: train profile and effects.
const SIMULATED: [(&str, &[&str]); 10] = [
    ("dong", &[]),
    ("dong", &["hysteresis"]),
    ("cycle", &["thermal-lag"]),
    ("stairs", &["kink"]),
    ("cycle", &["warm-up"]),
    ("dong", &["step"]),
    ("stairs", &["periodic"]),
    ("cycle", &["axis-gradient"]),
    ("dong", &["drive-amplitude"]),
    ("cycle", &["cubic", "hysteresis"]),
];

/// Arguments of the study: a unit of each effect and size, three clean ones.
const STUDY: [&str; 5] = ["trace", "--runs", "1", "--clean", "3"];

/// Makes everything and prints the checksums.
pub fn print(arguments: &[String]) -> Result<(), Failure> {
    let plant = foreign_plant()?;
    let programs = root().join("target/release").canonicalize().map_err(|e| Failure(e.to_string()))?;
    let folder = root().join("target/fingerprint");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).map_err(|e| Failure(format!("{}: {e}", folder.display())))?;
    let folder = folder.canonicalize().map_err(|e| Failure(e.to_string()))?;
    let plant = plant.canonicalize().map_err(|e| Failure(e.to_string()))?;
    let mut results = Vec::new();
    for case in FOREIGN {
        run_in(&folder, Command::new(&plant).args(["make", "--case", case, "--seed", "1", "--out", "."]))?;
        results.push(traced(&programs, &folder, &format!("{case}-1"))?);
    }
    for (k, (profile, effects)) in SIMULATED.iter().enumerate() {
        let name = format!("simulated-{}", k + 1);
        for (part, profile) in [("train", *profile), ("verify", "verify")] {
            let seed = (2 * k + usize::from(part == "verify")).to_string();
            let mut simulate = Command::new(programs.join("hrg"));
            simulate.args(["simulate", "--profile", profile, "--unit", &(k + 1).to_string(), "--seed", &seed]);
            simulate.args(effects.iter().flat_map(|e| ["--effect", e]));
            run_in(&folder, simulate.arg("--out").arg(format!("{name}-{part}.csv")))?;
        }
        results.push(traced(&programs, &folder, &name)?);
    }
    results.push(short_study(&programs, &folder)?);
    let files = results.into_iter().flat_map(|r| ["--file".to_string(), folder.join(r).display().to_string()]);
    study("fingerprint", &arguments.iter().cloned().chain(files).collect::<Vec<_>>())
}

/// Runs a program in the folder, silently: reports then name their files alike wherever the folder lies.
fn run_in(folder: &Path, command: &mut Command) -> Result<(), Failure> {
    let shown = format!("{command:?}");
    match command.current_dir(folder).stdin(std::process::Stdio::null()).output() {
        Ok(o) if o.status.success() => Ok(()),
        Ok(o) => Err(Failure(format!("{shown} ended with {}: {}", o.status, String::from_utf8_lossy(&o.stderr)))),
        Err(e) => Err(Failure(format!("{shown} could not be started: {e}"))),
    }
}

/// Traces the unit whose files begin with `name`; gives the report's name.
fn traced(programs: &Path, folder: &Path, name: &str) -> Result<PathBuf, Failure> {
    println!("tracing {name}");
    let mut trains: Vec<String> = std::fs::read_dir(folder)
        .map_err(|e| Failure(e.to_string()))?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|file| file.starts_with(&format!("{name}-train")))
        .collect();
    trains.sort();
    let report = format!("{name}-report.json");
    let mut trace = Command::new(programs.join("hrg"));
    trace.arg("trace");
    trace.args(trains.iter().flat_map(|train| ["--train", train]));
    run_in(folder, trace.args(["--verify", &format!("{name}-verify.csv"), "--out", &report]))?;
    Ok(report.into())
}

/// The trials of a short study, without the seconds that each took.
fn short_study(programs: &Path, folder: &Path) -> Result<PathBuf, Failure> {
    println!("a short study");
    run_in(folder, Command::new(programs.join("hrg-study")).args(STUDY).args(["--out", "all.csv"]))?;
    let all = std::fs::read_to_string(folder.join("all.csv")).map_err(|e| Failure(e.to_string()))?;
    let kept: String =
        all.lines().map(|l| l.rsplit_once(',').map_or(l, |(kept, _)| kept)).flat_map(|l| [l, "\n"]).collect();
    std::fs::write(folder.join("study.csv"), kept).map_err(|e| Failure(e.to_string()))?;
    Ok("study.csv".into())
}
