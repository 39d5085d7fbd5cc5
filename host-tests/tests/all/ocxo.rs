//! `hrg allan` on a measured oscillator, against the tables that Stable32 printed of it. The data are in the source distribution of
//! allantools 2024.6 (LGPL-3, not shipped here): pip fetches it. Without a network the test is skipped, and says so.

use host_tests::program;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

const MAP: &str = "hrg-map = 1
[table]
header = false
separator = \"space\"
[time]
step_s = 1.0
[rate]
x = { column = \"1\", offset = -10000000.0, factor = 100.0, unit = \"ppb\" }
";

/// The folder with the data; `None` where they cannot be fetched.
fn data() -> Option<PathBuf> {
    let cache = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/allantools");
    let folder = cache.join("allantools-2024.6/tests/ocxo");
    if !folder.join("ocxo_frequency.txt").is_file() {
        std::fs::create_dir_all(&cache).ok()?;
        let quiet = |c: &mut Command| c.output().ok().filter(|o| o.status.success()).map(drop);
        quiet(
            Command::new("python3")
                .args([
                    "-m",
                    "pip",
                    "download",
                    "--quiet",
                    "--no-deps",
                    "--no-binary",
                    ":all:",
                    "--timeout",
                    "10",
                    "--retries",
                    "1",
                ])
                .args(["allantools==2024.6", "--dest"])
                .arg(&cache),
        )?;
        quiet(Command::new("tar").arg("-xzf").arg(cache.join("allantools-2024.6.tar.gz")).arg("-C").arg(&cache))?;
    }
    folder.is_dir().then_some(folder)
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn allan_deviations_are_those_that_stable32_prints() {
    let Some(folder) = data() else {
        // xtask counts these lines; what println! writes in a test that passes is not shown.
        let _ = writeln!(std::io::stdout(), "skipped: the OCXO data of allantools could not be fetched from PyPI; hrg allan is not compared with Stable32");
        return;
    };
    let d = std::env::temp_dir().join(format!("hrg-ocxo-{}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a temporary folder");
    std::fs::write(d.join("map.toml"), MAP).expect("written");
    let hrg = program("hrg");
    let run = |arguments: &[&str]| {
        let o = Command::new(&hrg).current_dir(&d).args(arguments).output().expect("runs");
        assert!(o.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&o.stderr));
    };
    let data = folder.join("ocxo_frequency.txt");
    run(&["import", data.to_str().expect("UTF-8"), "--map", "map.toml", "--out", "run.csv"]);
    run(&["allan", "run.csv", "--json", "allan.json"]);
    let ours: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(d.join("allan.json")).expect("written")).expect("JSON");
    assert_eq!(ours[0]["values"], 19_982);
    let table = std::fs::read_to_string(folder.join("stable32_oadev_alltau.txt")).expect("in the distribution");
    let mut compared = 0;
    for row in table.lines().filter(|l| !l.trim_start().starts_with('#') && !l.trim().is_empty()) {
        let cells: Vec<&str> = row.split_whitespace().collect();
        let (tau, pairs, printed) = (cells[1], cells[2], cells[5]);
        let tau: f64 = tau.parse().expect("a number");
        let Some(point) = ours[0]["curve"].as_array().expect("a curve").iter().find(|p| p["tau_s"] == tau) else {
            continue;
        };
        // Parts per billion, as the map made them: with nine powers of ten less, to the digits that Stable32 prints.
        let mine = format!("{:.4e}", point["deviation"].as_f64().expect("a number") * 1e-9);
        let digits = |s: &str| -> (String, i32) {
            let (m, e) = s.split_once('e').expect("an exponent");
            (m.to_string(), e.parse().expect("a whole number"))
        };
        assert_eq!(digits(&mine), digits(printed), "at {tau} s");
        assert_eq!(point["pairs"].to_string(), pairs, "at {tau} s");
        compared += 1;
    }
    assert!(compared >= 20, "{compared} points");
}
