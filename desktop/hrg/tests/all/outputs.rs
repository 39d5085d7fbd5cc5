//! Every command that writes, to every kind of place: a file, a symbolic link, a pipe, a device, standard output. Nothing but a regular
//! file is ever replaced.
#![cfg(unix)]

use std::os::unix::fs::{symlink, FileTypeExt};
use std::path::Path;
use std::process::{Command, Output};

fn hrg(folder: &Path, arguments: &[&str]) -> Output {
    let o = Command::new(env!("CARGO_BIN_EXE_hrg")).current_dir(folder).args(arguments).output().expect("hrg runs");
    assert!(o.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&o.stderr));
    o
}

/// Commands with a place for each output.
const COMMANDS: &[&str] = &[
    "simulate --profile fast --seed 1 --out {1}",
    "import cycle.csv --out {1}",
    "fit cycle.csv --out {1}",
    "fit fast.csv --method pso --out {1} --history {2}",
    "correct fast.csv --calibration cal.toml --out {1}",
    "trace --train cycle.csv --verify verify.csv --out {1} --html {2} --calibration {3}",
    "report cycle.csv --json {1} --html {2}",
    "allan rest.csv --out {1} --json {2}",
    "lag lag.csv --calibration cal.toml --out {1}",
    "lag lag.csv --calibration cal.toml --predict fast.csv --out {1} --recording-out {2}",
    "points points.csv --out {1} --calibration {2}",
    "compare-images cal.toml cal.toml --out {1}",
    "simulate-alignment --seed 3 --out {1}",
    "align --recording turn.csv --out {1}",
];

/// Two short chamber profiles: the places matter here, not the results.
const SHORT: &str = "20,45@1.5,15m,-5@1.5,15m,20@1.5";
/// The other one.
const OTHER: &str = "20,40@1,20m,0@1,20m,20@1";

/// Numbers of the places.
const PLACES: [usize; 3] = [1, 2, 3];

fn prepared(d: &Path) {
    for (profile, name, seed) in [
        (SHORT, "cycle.csv", "1"),
        (OTHER, "verify.csv", "2"),
        ("fast", "fast.csv", "3"),
        ("25,10m,50@20,70m", "lag.csv", "4"),
    ] {
        hrg(d, &["simulate", "--profile", profile, "--seed", seed, "--out", name]);
    }
    hrg(d, &["simulate", "--profile", "25,1h", "--seed", "5", "--out", "rest.csv"]);
    hrg(d, &["simulate-alignment", "--seed", "3", "--out", "turn.csv"]);
    hrg(d, &["fit", "cycle.csv", "--out", "cal.toml"]);
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/../../host-tests/recordings/dong2023-table1.csv");
    std::fs::copy(table, d.join("points.csv")).expect("copied");
}

#[test]
fn only_regular_files_are_replaced() {
    let d = std::env::temp_dir().join(format!("hrg-outputs-{}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a folder");
    prepared(&d);
    let made = |program: &str, rest: &[&str]| {
        Command::new(program).current_dir(&d).args(rest).status().is_ok_and(|s| s.success())
    };
    // (Only root makes devices; others cannot replace one either.)
    let mut device = true;
    for k in PLACES {
        assert!(made("mkfifo", &[&format!("pipe{k}")]));
        symlink(format!("behind{k}"), d.join(format!("link{k}"))).expect("linked");
        device &= made("mknod", &[&format!("null{k}"), "c", "1", "3"]);
    }
    let kind = |name: &str| std::fs::symlink_metadata(d.join(name)).expect("there").file_type();
    for command in COMMANDS {
        let places: Vec<usize> = PLACES.into_iter().filter(|k| command.contains(&format!("{{{k}}}"))).collect();
        let to = |place: &dyn Fn(usize) -> String| -> Output {
            let filled = places.iter().fold((*command).to_string(), |c, k| c.replace(&format!("{{{k}}}"), &place(*k)));
            hrg(&d, &filled.split(' ').collect::<Vec<_>>())
        };
        to(&|k| format!("plain{k}"));
        let plain: Vec<Vec<u8>> =
            places.iter().map(|k| std::fs::read(d.join(format!("plain{k}"))).expect("written")).collect();
        // (A calibration holds the second of its making.)
        let same = |n: usize, other: &[u8]| other.len() == plain[n].len() && other[..8] == plain[n][..8];

        places.iter().for_each(|k| std::fs::write(d.join(format!("behind{k}")), "old").expect("written"));
        to(&|k| format!("link{k}"));
        let readers: Vec<_> = places
            .iter()
            .map(|k| d.join(format!("pipe{k}")))
            .map(|pipe| std::thread::spawn(move || std::fs::read(pipe).expect("readable")))
            .collect();
        to(&|k| format!("pipe{k}"));
        if device {
            to(&|k| format!("null{k}"));
        }
        let printed = to(&|_| "-".into()).stdout;
        for (n, (k, reader)) in places.iter().zip(readers).enumerate() {
            assert!(plain[n].len() > 20, "{command}");
            assert!(kind(&format!("link{k}")).is_symlink(), "{command} replaces a link");
            let behind = std::fs::read(d.join(format!("behind{k}"))).expect("there");
            assert!(same(n, &behind), "{command} through a link");
            assert!(same(n, &reader.join().expect("read")), "{command} into a pipe");
            assert!(kind(&format!("pipe{k}")).is_fifo(), "{command} replaces a pipe");
            assert!(!device || kind(&format!("null{k}")).is_char_device(), "{command} replaces a device");
            assert!(printed.windows(8).any(|w| w == &plain[n][..8]), "{command} to standard output");
        }
        assert!(!d.join("-").exists(), "{command} makes a file -");
    }
    let parts = std::fs::read_dir(&d)
        .expect("readable")
        .filter(|e| e.as_ref().is_ok_and(|e| e.file_name().to_string_lossy().ends_with(".part")));
    assert_eq!(parts.count(), 0, "nothing is left beside the outputs");
}

/// `hrg`, `hrg-board` and the Python package write by the one writer: nothing else makes, opens or renames a file to write it, but for keys,
/// which are made once and never replaced.
#[test]
fn there_is_one_writer() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut folders = ["data", "identify", "simulate", "align", "papers", "hrg", "study"]
        .map(|f| root.join(format!("desktop/{f}/src")))
        .to_vec();
    folders.extend(["virtual-board/hrg-board/src", "python/src"].map(|f| root.join(f)));
    let mut seen = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder of sources") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("text");
            let code = text.split("mod tests {").next().unwrap_or("");
            let excepted = path.ends_with("data/src/output.rs") || path.ends_with("unit/keys.rs");
            for call in ["fs::write(", "File::create(", "fs::rename(", "OpenOptions", "File::options("] {
                assert!(excepted || !code.contains(call), "{call} in {}", path.display());
            }
            seen += 1;
        }
    }
    assert!(seen > 120, "{seen} files");
}
