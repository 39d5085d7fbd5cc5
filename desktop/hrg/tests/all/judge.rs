//! `hrg judge`: PASS, FAIL, NOT COVERED, against figures that the test computes from the corrected rates itself.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let d = std::env::temp_dir().join(format!("hrg-judge-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a folder");
    d
}

fn hrg(folder: &Path, arguments: &str) -> Output {
    let arguments = arguments.split_whitespace();
    Command::new(env!("CARGO_BIN_EXE_hrg")).current_dir(folder).args(arguments).output().expect("hrg runs")
}

/// Exit status, and what stands on standard output.
fn status(folder: &Path, arguments: &str) -> (Option<i32>, String) {
    let o = hrg(folder, arguments);
    (o.status.code(), format!("{}{}", String::from_utf8_lossy(&o.stdout), String::from_utf8_lossy(&o.stderr)))
}

/// Largest distance of the 100 s means of a corrected recording's rates from their mean, at temperatures within a range. (The recording has
/// the earth's rate, as a unit's rates have it.)
fn largest(file: &Path, axis: &str, range: std::ops::RangeInclusive<f64>) -> f64 {
    let text = std::fs::read_to_string(file).expect("written");
    let mut lines = text.lines().filter(|l| !l.starts_with('#'));
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let place = |name: String| names.iter().position(|n| *n == name).expect("the column");
    let (rate, temperature) = (place(format!("rate_{axis}_dph")), place(format!("temperature_{axis}_c")));
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect()).collect();
    let mean = |rows: &[Vec<f64>], k: usize| {
        let good: Vec<f64> = rows.iter().map(|r| r[k]).filter(|v| v.is_finite()).collect();
        good.iter().sum::<f64>() / good.len() as f64
    };
    let means: Vec<f64> = rows
        .chunks(100)
        .filter(|c| c.len() >= 50 && range.contains(&mean(c, temperature)))
        .map(|c| mean(c, rate))
        .collect();
    let middle = means.iter().sum::<f64>() / means.len() as f64;
    means.iter().map(|v| (v - middle).abs()).fold(0.0, f64::max)
}

/// A recording with something added to the rates of y.
fn with_constant(file: &Path, dph: f64) -> String {
    let text = std::fs::read_to_string(file).expect("there");
    let mut place = None;
    let row = |line: &str| {
        let mut cells: Vec<String> = line.split(',').map(String::from).collect();
        match place {
            None if line.starts_with('#') => {}
            None => place = cells.iter().position(|c| c == "rate_y_dph"),
            Some(k) => {
                if let Ok(v) = cells[k].parse::<f64>() {
                    cells[k] = (v + dph).to_string();
                }
            }
        }
        cells.join(",") + "\n"
    };
    text.lines().map(row).collect()
}

/// A recording without rates where the case of x is warmer than that.
fn without_rates(file: &Path, above_c: f64) -> String {
    let text = std::fs::read_to_string(file).expect("there");
    let mut places: Option<(usize, Vec<usize>)> = None;
    let row = |line: &str| {
        let mut cells: Vec<String> = line.split(',').map(String::from).collect();
        match &places {
            None if line.starts_with('#') => {}
            None => {
                let case = cells.iter().position(|c| c == "case_x_c").expect("a case");
                places = Some((case, (0..cells.len()).filter(|k| cells[*k].starts_with("rate_")).collect()));
            }
            Some((case, rates)) => {
                if cells[*case].parse::<f64>().is_ok_and(|t| t > above_c) {
                    rates.iter().for_each(|k| cells[*k].clear());
                }
            }
        }
        cells.join(",") + "\n"
    };
    text.lines().map(row).collect()
}

#[test]
fn a_unit_passes_fails_or_is_not_covered() {
    let d = folder("verdicts");
    for (profile, seed, out) in [("cycle", 31, "a.csv"), ("verify", 32, "b.csv")] {
        let made = hrg(
            &d,
            &format!(
                "simulate --profile {profile} --seed {seed} --unit 5 --effect hysteresis:width_c=14,size=3 --out {out}"
            ),
        );
        assert!(made.status.success());
    }
    assert!(hrg(&d, "fit a.csv -o cal.toml").status.success());
    assert!(hrg(&d, "correct b.csv --calibration cal.toml -o corrected.csv").status.success());
    let judged = |limit: &str, range: &str| {
        let (code, text) =
            status(&d, &format!("judge b.csv --calibration cal.toml --limit {limit} {range} -o j.json --html j.html"));
        let json = std::fs::read_to_string(d.join("j.json")).expect("written");
        (code, text, serde_json::from_str::<serde_json::Value>(&json).expect("JSON"))
    };
    let (code, text, json) = judged("50", "--from -30 --to 50");
    assert_eq!((code, &json["verdict"]), (Some(0), &"PASS".into()), "{text}");
    assert!(text.starts_with("PASS: "), "{text}");
    for axis in ["x", "y", "z"] {
        let most = largest(&d.join("corrected.csv"), axis, -30.0..=50.0);
        let of = &json["axes"][axis];
        let value = |key: &str| of[key].as_f64().expect("a number");
        assert!((value("largest_about_constant_dph") - most).abs() < 1e-3 * most, "{axis}: {most} {of}");
        assert!((value("largest_dph") - most).abs() < value("constant_dph").abs() + 1e-3, "{axis}: {most} {of}");
        assert!(value("raw_largest_dph") > value("largest_dph"));
        assert!(value("covered_from_c") <= -29.0 && value("covered_to_c") >= 49.0, "{of}");
        assert!(["heating", "cooling", "soak"].contains(&of["direction"].as_str().expect("a word")));
    }
    // The constant is in the largest error.
    let before = json["axes"]["y"]["constant_dph"].as_f64().expect("a number");
    std::fs::write(d.join("shifted.csv"), with_constant(&d.join("b.csv"), 60.0)).expect("written");
    let (code, text) =
        status(&d, "judge shifted.csv --calibration cal.toml --limit 50 --from -30 --to 50 -o shifted.json");
    let shifted = std::fs::read_to_string(d.join("shifted.json")).expect("written");
    let shifted: serde_json::Value = serde_json::from_str(&shifted).expect("JSON");
    let of = |key: &str| shifted["axes"]["y"][key].as_f64().expect("a number");
    assert!(code == Some(3) && text.starts_with("FAIL: y is 6"), "{text}");
    assert!((of("constant_dph") - before - 60.0).abs() < 1e-3 && of("largest_about_constant_dph") < 10.0, "{shifted}");
    let (code, text, json) = judged("0.05", "--from -30 --to 50");
    assert_eq!((code, &json["verdict"]), (Some(3), &"FAIL".into()), "{text}");
    assert!(text.starts_with("FAIL: x is ") && text.contains(" C while "), "{text}");
    let page = std::fs::read_to_string(d.join("j.html")).expect("written");
    assert!(page.contains("<svg") && page.contains("limit") && page.contains("FAIL"), "one page");
    let (code, text, json) = judged("50", "--from -30 --to 95");
    assert_eq!((code, &json["verdict"]), (Some(4), &"NOT COVERED".into()), "{text}");
    assert!(text.contains("data from -30.0 to"), "{text}");
    // Beyond the limit is beyond it, wherever else the run has not been.
    assert_eq!(judged("0.05", "--from -30 --to 95").0, Some(3));
    let (code, text, json) = judged("50", "--from 20 --to 20.3");
    assert_eq!((code, &json["axes"]["x"]["means"]), (Some(4), &0.into()), "{text}");
    assert!(text.contains("no mean of 100 s in that range"), "{text}");
    // Temperatures without rates cover nothing.
    std::fs::write(d.join("silent.csv"), without_rates(&d.join("b.csv"), 30.0)).expect("written");
    let (code, text) =
        status(&d, "judge silent.csv --calibration cal.toml --limit 50 --from -30 --to 50 -o silent.json");
    let silent = std::fs::read_to_string(d.join("silent.json")).expect("written");
    let silent: serde_json::Value = serde_json::from_str(&silent).expect("JSON");
    // (A resonator is warmer than its case while it cools.)
    assert!(code == Some(4) && silent["axes"]["x"]["covered_to_c"].as_f64() < Some(45.0), "{text}");
    let (code, text, json) = judged("1", "--from 150 --to 190");
    assert_eq!((code, &json["axes"]["x"]["largest_dph"]), (Some(4), &serde_json::Value::Null), "{text}");
    assert!(text.contains("have no data in that range"), "{text}");
}

#[test]
fn a_question_that_is_none_is_refused_in_a_sentence() {
    let d = folder("refused");
    assert!(hrg(&d, "simulate --profile fast --unit 5 --out a.csv").status.success());
    assert!(hrg(&d, "simulate --profile fast --unit 6 --out other.csv").status.success());
    assert!(hrg(&d, "fit a.csv -o cal.toml").status.success());
    assert!(hrg(&d, "correct a.csv --calibration cal.toml -o corrected.csv").status.success());
    for (arguments, sentence) in [
        ("a.csv --calibration cal.toml --limit 0 --from -10 --to 10", "is no limit"),
        ("a.csv --calibration cal.toml --limit 1 --from -1e9 --to 1e9", "chambers reach"),
        ("a.csv --calibration cal.toml --limit 1 --from 10 --to -10", "the lower temperature first"),
        ("a.csv --calibration cal.toml --limit 1 --from -10 --to 10 --means soon", "whole seconds"),
        ("other.csv --calibration cal.toml --limit 1 --from -10 --to 10", "SIM-6"),
        ("corrected.csv --calibration cal.toml --limit 1 --from -10 --to 10", "corrected rates"),
        ("none.csv --calibration cal.toml --limit 1 --from -10 --to 10", "none.csv"),
    ] {
        let (code, text) = status(&d, &format!("judge {arguments}"));
        assert!(code == Some(2) && text.contains(sentence), "{arguments}: {code:?} {text}");
    }
}

#[test]
fn a_trace_ends_with_3_where_it_does_not_say_burn() {
    let d = folder("fail-unless");
    for (profile, seed, out) in [("cycle", 31, "a.csv"), ("verify", 32, "b.csv")] {
        assert!(hrg(&d, &format!("simulate --profile {profile} --seed {seed} --unit 5 --out {out}")).status.success());
    }
    let trace = "trace a.csv --verify b.csv -o r.json";
    assert_eq!(status(&d, trace).0, Some(0));
    assert_eq!(status(&d, &format!("{trace} --fail-unless burn")).0, Some(3));
}

/// A recording of which some rows are changed: `row` gets the number of the row, from 0, and its cells.
fn changed(file: &Path, row: impl Fn(usize, &mut Vec<String>) -> bool) -> String {
    let text = std::fs::read_to_string(file).expect("there");
    let (mut out, mut n) = (String::new(), None);
    for line in text.lines() {
        let mut cells: Vec<String> = line.split(',').map(String::from).collect();
        let kept = match n {
            Some(k) => row(k, &mut cells),
            None => true,
        };
        n = if line.starts_with('#') { n } else { Some(n.map_or(0, |k: usize| k + 1)) };
        if kept {
            out += &(cells.join(",") + "\n");
        }
    }
    out
}

#[test]
fn spikes_count_gaps_do_not_and_a_run_that_was_learnt_from_is_named() {
    let d = folder("spikes");
    for (seed, profile, name) in [(1, "cycle", "a"), (2, "verify", "b")] {
        let made = format!("simulate --profile {profile} --seed {seed} --out {name}.csv");
        assert_eq!(status(&d, &made).0, Some(0));
    }
    assert_eq!(status(&d, "fit a.csv -o cal.toml").0, Some(0));
    let judged = |run: &str| status(&d, &format!("judge {run}.csv -c cal.toml -l 5 --from -20 --to 50"));
    let (code, text) = judged("b");
    assert!(code == Some(0) && !text.contains("spikes"), "{text}");
    // One sample in a hundred is 2000 deg/h off: each mean by 20.
    let spiked = changed(&d.join("b.csv"), |k, cells| {
        if k > 0 && k % 100 == 50 {
            cells[4] = (cells[4].parse::<f64>().expect("a rate") + 2000.0).to_string();
        }
        true
    });
    std::fs::write(d.join("spiked.csv"), spiked).expect("written");
    let (code, text) = judged("spiked");
    assert!(code == Some(3) && text.contains("spikes of the rates count here"), "{text}");
    assert!(text.contains("without the spikes: PASS, the largest error is"), "{text}");
    // The logger stopped for an hour on a ramp; the unit did not.
    let gap = changed(&d.join("b.csv"), |k, _| !(9000..12_600).contains(&k));
    std::fs::write(d.join("gap.csv"), gap).expect("written");
    let (code, text) = judged("gap");
    assert!(code == Some(0) && text.contains("behind a gap of more than 900 s"), "{text}");
    let (code, text) = judged("a");
    assert!(code == Some(0) && text.contains("was learnt from a run that is judged here"), "{text}");
    let _ = std::fs::remove_dir_all(&d);
}
