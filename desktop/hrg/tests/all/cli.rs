//! The command `hrg` as a user meets it: files in, files out, exit status, one sentence for what cannot be used.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let p = std::env::temp_dir().join(format!("hrg-cli-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&p).expect("a temporary folder");
    p
}

fn hrg(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hrg")).current_dir(folder).args(arguments).output().expect("hrg runs")
}

fn ok(folder: &Path, arguments: &[&str]) -> String {
    let o = hrg(folder, arguments);
    assert!(o.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&o.stderr));
    String::from_utf8_lossy(&o.stdout).into_owned()
}

/// Exit status 2, and the one line on standard error.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let o = hrg(folder, arguments);
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert_eq!(o.status.code(), Some(2), "{arguments:?}: {error}");
    let last = error.lines().last().unwrap_or("").to_string();
    assert!(!last.contains("panicked"), "{error}");
    last
}

#[test]
fn broken_recordings_are_refused_with_their_place() {
    let d = folder("broken");
    let head = "time_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph\n";
    let row = |k: usize| format!("{k},4900.{k:04},4890.{k:04},4700.{k:04},1.{k},2.{k},3.{k}\n");
    let body: String = (0..300).map(row).collect();
    let backward: String = (0..300).rev().map(row).collect();
    for (name, content, says) in [
        ("empty.csv", String::new(), "the file is empty"),
        ("header.csv", head.to_string(), "no row"),
        ("column.csv", head.replace(",fz_hz", "") + &body, "line 1: the column fz_hz is missing"),
        ("text.csv", head.to_string() + &body.replacen("4890.0003", "abc", 1), "line 5, column 3 (fy_hz): \"abc\""),
        ("cells.csv", head.to_string() + &body + "301,1,2\n", "line 302 has 3 cells"),
        ("back.csv", head.to_string() + &backward, "column time_s"),
        ("extra.csv", head.to_string() + &body.replace("4890.", "1,"), "cells"),
        ("still.csv", head.to_string() + &body, "fx_hz spans"),
    ] {
        std::fs::write(d.join(name), content).expect("written");
        let error = refused(&d, &["fit", name, "--out", "cal.toml"]);
        assert!(error.contains(name) || name == "still.csv", "{error}");
        assert!(error.contains(says), "{name}: {error}");
    }
    std::fs::write(d.join("binary.csv"), [0xFFu8, 0xFE, 0, 1, 2]).expect("written");
    assert!(refused(&d, &["fit", "binary.csv", "--out", "cal.toml"]).contains("UTF-8"));
    assert!(refused(&d, &["fit", "nowhere.csv", "--out", "cal.toml"]).contains("cannot read nowhere.csv"));
    assert!(refused(&d, &["simulate", "--effect", "gremlins", "--out", "x.csv"]).contains("gremlins"));
    assert!(refused(&d, &["simulate", "--profile", "20,5x", "--out", "x.csv"]).contains("5x"));
    assert!(refused(&d, &["simulate", "--profile", "fast", "--out", "no/such/run.csv"]).contains("no folder no/such;"));
    std::fs::write(d.join("lab.csv"), "minutes;T;w\n0,0;20,1;1,5\n").expect("written");
    let error = refused(&d, &["import", "lab.csv", "--out", "run.csv"]);
    assert!(error.contains("no column is known for a rate") && error.contains("--map map.toml"), "{error}");
    assert!(!d.join("cal.toml").exists(), "nothing is written for a refused input");
}

/// As [`hrg`], where no file may grow beyond so many blocks of 512 bytes: a disk that fills up.
fn hrg_on_a_small_disk(folder: &Path, blocks: u32, arguments: &str) -> Output {
    let command = format!("trap '' XFSZ; ulimit -f {blocks}; exec '{}' {arguments}", env!("CARGO_BIN_EXE_hrg"));
    Command::new("sh").current_dir(folder).args(["-c", &command]).output().expect("sh")
}

#[test]
fn a_full_disk_and_an_interrupted_write_lose_nothing() {
    let d = folder("full");
    ok(&d, &["simulate", "--profile", "20,5m", "--out", "run.csv"]);
    let before = std::fs::read(d.join("run.csv")).expect("there");
    assert!(before.len() > 8 * 512);
    let o = hrg_on_a_small_disk(&d, 8, "simulate --profile 20,9m --out run.csv");
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert!(!o.status.success() && error.contains("cannot write run.csv"), "{error}");
    assert_eq!(std::fs::read(d.join("run.csv")).expect("there"), before, "the old file is untouched");
    assert!(!d.join("run.csv.part").exists());
    // Recording: complete rows up to where the disk was full.
    let line = |k: u32| {
        format!("INFO t={k}000 f=4898.6{k},4890.6{k},4702.3{k} T=6,5,4 dT=0,0,0 b=0,0,0 raw=1.{k},2.{k},3.{k} status=00,00,00,00 cal=00000000 no=0 made=0 mode=0\n")
    };
    std::fs::write(d.join("unit.log"), (1..400).map(line).collect::<String>()).expect("written");
    ok(&d, &["record", "--defmt", "unit.log", "--out", "whole.csv"]);
    let o = hrg_on_a_small_disk(&d, 16, "record --defmt unit.log --out cut.csv");
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert!(!o.status.success() && error.contains("cannot write cut.csv; its "), "{error}");
    let (whole, cut) = (std::fs::read_to_string(d.join("whole.csv")), std::fs::read_to_string(d.join("cut.csv")));
    let (whole, cut) = (whole.expect("there"), cut.expect("there"));
    assert!(cut.len() > 7000 && cut.ends_with('\n') && whole.starts_with(&cut), "{} bytes", cut.len());
}

#[test]
fn files_of_any_size_and_kind_are_refused_in_a_sentence() {
    let d = folder("kinds");
    // A gigabyte of nothing: sparse, and refused without reading it all.
    for name in ["huge.csv", "huge.toml"] {
        std::fs::File::create(d.join(name)).and_then(|f| f.set_len(1 << 30)).expect("a sparse file");
    }
    assert!(refused(&d, &["fit", "huge.csv", "--out", "cal.toml"]).contains("byte 1 is zero"));
    ok(&d, &["simulate", "--profile", "20,5m", "--out", "run.csv"]);
    let text = std::fs::read_to_string(d.join("run.csv")).expect("there");
    let error = refused(&d, &["burn", "huge.toml", "--port", "nowhere"]);
    assert!(error.contains("huge.toml has 1073741824 bytes"), "{error}");
    // Another encoding; line ends and a mark of another system.
    let utf16: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    std::fs::write(d.join("utf16.csv"), utf16).expect("written");
    assert!(refused(&d, &["fit", "utf16.csv", "--out", "cal.toml"]).contains("UTF-16"));
    let latin = text.replacen("# ", "# grad: \u{1}C\n# ", 1).into_bytes();
    let latin: Vec<u8> = latin.into_iter().map(|b| if b == 1 { 0xB0 } else { b }).collect();
    std::fs::write(d.join("latin.csv"), latin).expect("written");
    assert!(refused(&d, &["fit", "latin.csv", "--out", "cal.toml"]).contains("line 1 is not UTF-8"));
    std::fs::write(d.join("dos.csv"), format!("\u{feff}{}", text.replace('\n', "\r\n"))).expect("written");
    let allan = |name: &str| ok(&d, &["allan", name]).replace(name, "");
    assert_eq!(allan("dos.csv"), allan("run.csv"));
    assert!(refused(&d, &["fit", ".", "--out", "cal.toml"]).contains("cannot read ."));
}

#[test]
fn from_simulation_to_report() {
    let d = folder("whole");
    for (profile, seed, out) in [("cycle", "31", "t.csv"), ("verify", "32", "v.csv")] {
        let effect = "hysteresis:width_c=14,size=3";
        ok(&d, &["simulate", "--profile", profile, "--seed", seed, "--unit", "5", "--effect", effect, "--out", out]);
    }
    let table = ok(&d, &["fit", "t.csv", "--out", "cal.toml"]);
    assert!(table.contains("condition"));
    ok(&d, &["fit", "t.csv", "--method", "two-sets", "--uniform", "--out", "cal.bin"]);
    let (json, html) = ("report.json", "report.html");
    ok(
        &d,
        &["trace", "--train", "t.csv", "--verify", "v.csv", "--out", json, "--html", html, "--calibration", "ext.toml"],
    );
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(d.join(json)).expect("written")).expect("JSON");
    assert_eq!(report["version"], 3);
    assert_eq!(report["verdict_kind"], "confirmed");
    assert_eq!((&report["chosen_on"], &report["judged_by"]), (&"train".into(), &"verify".into()));
    for key in ["log_prior", "log_evidence"] {
        assert!(report["effects"][0]["score"][key].is_f64() && report["effects"][0]["rank"][0]["score"][key].is_f64());
    }
    assert_eq!(report["burn"], true);
    assert_eq!(report["effects"][0]["name"], "hysteresis");
    assert_eq!(report["effects"][0]["class"], "hysteresis");
    assert!(report["cleaned"]["t.csv"].is_object() && report["outside_fit"].is_f64());
    let width = report["effects"][0]["parameters"]["width_c"].as_f64().expect("a number");
    assert!((width - 14.0).abs() < 2.0, "{width}");
    for axis in ["x", "y", "z"] {
        let before = report["baseline"][axis]["verify_rms_dph"].as_f64().expect("a number");
        let after = report["final"][axis]["verify_rms_dph"].as_f64().expect("a number");
        let floor = report["noise_floor_dph"][axis].as_f64().expect("a number");
        assert!(after < 0.6 * before && after < 1.3 * floor, "{axis}: {before} {after} {floor}");
        // (By chance this verify run shows the effect on x in another size, by 2.6 deviations.)
        let of_size = "where hysteresis stands for it, which the verify run shows in another size";
        let left: &[&str] = if axis == "x" { &[of_size] } else { &[] };
        assert_eq!(report["left_over"][axis], serde_json::json!(left));
        assert_eq!(report["unexplained"][axis], axis == "x");
        let ratio = &report["floor_ratio"][axis];
        assert!(ratio["low"].as_f64() < ratio["ratio"].as_f64() && ratio["ratio"].as_f64() < ratio["high"].as_f64());
        for key in ["log_score", "mse_fall", "mse_fall_std", "rms_dph", "constant_dph"] {
            assert!(report["judge"][axis][key].is_f64(), "{key}");
        }
        let block = &report["block"][axis];
        for key in ["verify_rms_dph", "mean_dph", "mean_std_dph"] {
            assert!(block[key].is_f64(), "{key}");
        }
        assert!(block["used_means"].as_u64() > Some(300));
    }
    let page = std::fs::read_to_string(d.join(html)).expect("written");
    assert!(page.contains("<svg") && !page.contains("src=\"http"), "one self-contained page");
    let image = std::fs::read_to_string(d.join("ext.toml")).expect("written");
    assert!(image.contains("name = \"hysteresis\""));
}

#[test]
fn runs_that_share_data_or_are_of_two_units_are_refused() {
    let d = folder("independent");
    for (unit, seed, out) in [("7", "1", "a.csv"), ("7", "2", "b.csv"), ("8", "3", "other.csv")] {
        ok(&d, &["simulate", "--profile", "fast", "--unit", unit, "--seed", seed, "--out", out]);
    }
    let text = std::fs::read_to_string(d.join("a.csv")).expect("there");
    let (lines, n) = (text.lines().collect::<Vec<_>>(), text.lines().count());
    let head = lines.iter().position(|l| l.starts_with("time_s")).expect("a header") + 1;
    let part =
        |from: usize, to: usize| lines[..head].iter().chain(&lines[from..to]).fold(String::new(), |s, l| s + l + "\n");
    std::fs::write(d.join("begin.csv"), part(head, n * 2 / 3)).expect("written");
    std::fs::write(d.join("end.csv"), part(n / 2, n)).expect("written");
    std::fs::copy(d.join("a.csv"), d.join("copy.csv")).expect("copied");
    let trace = |train: &[&str], verify: &str| {
        let mut a = vec!["trace", "--out", "r.json", "--verify", verify];
        train.iter().for_each(|t| a.extend(["--train", t]));
        refused(&d, &a)
    };
    for (train, verify) in [
        (vec!["a.csv"], "a.csv"),
        (vec!["a.csv"], "copy.csv"),
        (vec!["begin.csv"], "end.csv"),
        (vec!["a.csv", "copy.csv"], "b.csv"),
    ] {
        let e = trace(&train, verify);
        assert!(e.contains("share data"), "{train:?} {verify}: {e}");
    }
    assert!(refused(&d, &["fit", "a.csv", "copy.csv", "--out", "c.toml"]).contains("share data"));
    assert!(refused(&d, &["compare", "a.csv", "--verify", "copy.csv", "--methods", "lsq", "--out", "c"])
        .contains("share data"));
    for e in [
        trace(&["a.csv"], "other.csv"),
        refused(&d, &["fit", "a.csv", "other.csv", "--out", "c.toml"]),
        refused(&d, &["compare", "a.csv", "--verify", "other.csv", "--methods", "lsq", "--out", "c"]),
    ] {
        assert!(e.contains("different units") && e.contains("SIM-7") && e.contains("SIM-8"), "{e}");
    }
    assert!(!d.join("r.json").exists() && !d.join("c.toml").exists());
    ok(&d, &["fit", "a.csv", "other.csv", "--different-units", "--out", "c.toml"]);
    ok(&d, &["trace", "--train", "a.csv", "--verify", "b.csv", "--out", "r.json"]);
}

#[test]
fn methods_side_by_side() {
    let d = folder("compare");
    for (profile, seed, out) in
        [("fast", "41", "t.csv"), ("fast", "42", "v.csv"), ("up", "43", "up.csv"), ("lag", "44", "lag.csv")]
    {
        ok(&d, &["simulate", "--profile", profile, "--seed", seed, "--unit", "6", "--out", out]);
    }
    let methods = "lsq,pso,pso-literal,fog-lsq,direct";
    // A program that is not hrg-board: no cost is counted, and the error tells it.
    let error = refused(
        &d,
        &["compare", "t.csv", "--verify", "v.csv", "--methods", methods, "--out", "c", "--board", "/bin/false"],
    );
    assert!(error.contains("could not count what the images cost"), "{error}");
    let alone = d.join("hrg");
    // (Not copied: a process that another test starts meanwhile would hold the copy open for writing, and nothing runs such a file.)
    std::fs::hard_link(env!("CARGO_BIN_EXE_hrg"), &alone)
        .or_else(|_| std::fs::copy(env!("CARGO_BIN_EXE_hrg"), &alone).map(drop))
        .expect("there");
    let o = Command::new(&alone)
        .current_dir(&d)
        .args(["compare", "t.csv", "--verify", "v.csv", "--methods", methods, "--out", "c"])
        .output()
        .expect("runs");
    assert!(o.status.success() && String::from_utf8_lossy(&o.stderr).contains("not counted"));
    let c: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(d.join("c/compare.json")).expect("written")).expect("JSON");
    let error = |m: &str| {
        let row = c["rows"].as_array().expect("rows").iter().find(|r| r["method"] == m).expect("there").clone();
        row["verify_3sigma_dph"][0].as_f64().expect("a number")
    };
    assert!((error("pso") / error("lsq") - 1.0).abs() < 1e-4);
    let about = c["about_verify"].as_str().expect("a sentence");
    assert!(about.starts_with("every verify run repeats a training profile"), "{about}");
    assert!(c["rows"][0]["repeat_3sigma_dph"].is_array() && c["rows"][0]["other_3sigma_dph"].is_null());
    assert!(c["raw"]["train_stages_3sigma_dph"][1][0].as_f64().is_some_and(|v| v > 0.0));
    for file in ["searches.svg", "pso-history.csv"] {
        assert!(d.join("c").join(file).exists(), "{file}");
    }
    let o = Command::new(&alone)
        .current_dir(&d)
        .args(["compare", "t.csv", "--verify", "v.csv", "--verify", "up.csv", "--methods", "lsq", "--from", "10m"])
        .args(["--out", "c2"])
        .output()
        .expect("runs");
    let text = String::from_utf8_lossy(&o.stdout).into_owned();
    assert!(text.contains("of the verify runs 1 repeat a training profile and 1 do not"), "{text}");
    assert!(refused(&d, &["compare", "t.csv", "--verify", "v.csv", "--from", "9h", "--out", "c"]).contains("earlier"));
    assert!(error("pso-literal") > error("lsq") && (error("direct") / error("lsq") - 1.0).abs() < 0.15);
    assert!(std::fs::read_to_string(d.join("c/compare.svg")).expect("written").contains("pso-literal"));

    assert!(refused(&d, &["compare", "t.csv", "--verify", "v.csv", "--methods", "guess", "--out", "c"])
        .contains("polynomial"));
    let error = refused(&d, &["fit", "up.csv", "--method", "fog-pso", "--out", "no.toml"]);
    assert!(error.contains("no cooling ramp") && !d.join("no.toml").exists(), "{error}");
    let error = refused(&d, &["fit", "t.csv", "--method", "ga-bp", "--uniform", "--out", "no.toml"]);
    assert!(error.contains("the same weight"), "{error}");
    for (out, seed) in [("a.toml", "5"), ("b.toml", "5")] {
        ok(&d, &["fit", "t.csv", "--method", "ga-bp", "--seed", seed, "--out", out]);
    }
    let crc = |f: &str| {
        let text = std::fs::read_to_string(d.join(f)).expect("written");
        text.lines().find(|l| l.starts_with("network_dph")).expect("a network").to_string()
    };
    assert_eq!(crc("a.toml"), crc("b.toml"), "the same seed, the same image");

    let table = ok(&d, &["lag", "lag.csv", "--calibration", "a.toml", "--predict", "t.csv", "--out", "p.csv"]);
    assert!(table.contains("time constant") && table.contains("predicted"), "{table}");
    assert!(
        refused(&d, &["lag", "up.csv", "--input", "chamber", "--calibration", "t.csv"]).contains("not a calibration")
    );
}

#[test]
fn alignments_end_in_an_azimuth_or_a_sentence() {
    let d = folder("align");
    ok(&d, &["simulate-alignment", "--seed", "0", "--out", "a.csv"]);
    ok(&d, &["simulate-alignment", "--seed", "0", "--one-position", "--out", "one.csv"]);
    for (filter, within) in [("linear", 0.15), ("upf", 0.15), ("ekf", 0.3)] {
        ok(&d, &["align", "--recording", "a.csv", "--filter", filter, "--out", "r.json"]);
        let r: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(d.join("r.json")).expect("written")).expect("JSON");
        assert_eq!(r["filter"], filter);
        let azimuth = r["azimuth_deg"].as_f64().expect("a number");
        assert!((azimuth - 100.0).abs() < within, "{filter}: {azimuth}");
        for key in ["azimuth_std_arcmin", "tilt1_arcmin", "tilt2_arcmin", "drift1_dph", "drift2_dph"] {
            assert!(r[key].is_f64(), "{filter}: {key}");
        }
        assert!(r["history"].as_array().expect("seconds").len() > 150);
    }
    std::fs::remove_file(d.join("r.json")).expect("there");
    // A filter that has not found it is refused, and the base is not blamed for one that has diverged.
    let e = refused(&d, &["align", "--recording", "a.csv", "--filter", "upf-literal"]);
    assert!(e.contains("closed form") && e.contains("--filter linear"), "{e}");
    let e = refused(&d, &["align", "--recording", "a.csv", "--filter", "ekf", "--first-azimuth=-80"]);
    assert!(e.contains("diverged from its first azimuth of -80"), "{e}");
    let e = refused(&d, &["align", "--recording", "one.csv", "--out", "r.json"]);
    assert!(e.contains("one.csv") && e.contains("there was no turn"), "{e}");
    let text =
        std::fs::read_to_string(d.join("a.csv")).expect("written").replace("# latitude_deg: 45", "# latitude_deg: -88");
    std::fs::write(d.join("pole.csv"), text).expect("written");
    assert!(refused(&d, &["align", "--recording", "pole.csv", "--out", "r.json"]).contains("beyond 80 degrees"));
    assert!(!d.join("r.json").exists());
}

#[test]
fn rest_log_and_profile() {
    let d = folder("rest");
    ok(&d, &["simulate", "--profile", "25,2h", "--seed", "3", "--out", "rest.csv"]);
    let table = ok(&d, &["allan", "rest.csv", "--out", "a.svg", "--json", "a.json"]);
    assert!(table.contains("angle random walk") && table.contains("under "), "{table}");
    assert!(std::fs::read_to_string(d.join("a.svg")).expect("written").contains("averaging time"));
    let line = |k: u32| {
        format!("{k}.06 INFO  t={k}000 f=4898.6,4890.6,4702.3 T=6,5,5 dT=0,0,0 b=0,0,0 raw=1,2,3 status=00,00,00,00 cal=0a no=1 made=0 mode=0")
    };
    let mut log = String::from("0.01 INFO  hrg firmware 0.1.0: unit HRG-9, calibration 0000000a no. 1, status 00\n");
    (1..300).for_each(|k| log.push_str(&(line(k) + "\n")));
    std::fs::write(d.join("run.log"), log).expect("written");
    assert!(ok(&d, &["record", "--defmt", "run.log", "--out", "run.csv"]).contains("299 rows"));
    assert!(std::fs::read_to_string(d.join("run.csv")).expect("written").contains("# unit: HRG-9"));
    assert!(refused(&d, &["record", "--defmt", "run.log", "--out", "run.csv"]).contains("there already"));
    std::fs::write(d.join("other.log"), "nothing of the kind\n").expect("written");
    assert!(refused(&d, &["record", "--defmt", "other.log", "--out", "no.csv"]).contains("no line of a second"));
    std::fs::write(d.join("raw.log"), [0u8, 1, 200, 3]).expect("written");
    assert!(refused(&d, &["record", "--defmt", "raw.log", "--out", "no.csv"]).contains("--elf"));
    let no_port = refused(&d, &["monitor", "--port", "/dev/none"]);
    assert!(no_port.contains("cannot open the port") && no_port.contains(" there"), "{no_port}");
    // A command with too few arguments, or unknown ones, is shown with the example of its help.
    for command in ["trace", "fit", "monitor", "unit burn", "fit points", "align"] {
        let words: Vec<&str> = command.split(' ').chain(["--nonsense"]).collect();
        let o = hrg(&d, &words);
        let printed = String::from_utf8_lossy(&o.stderr);
        assert!(o.status.code() == Some(2) && printed.contains(&format!("for example: hrg {command} ")), "{printed}");
    }
    assert!(refused(&d, &["fit", "none.csv", "--out", "cal.toml"]).contains("hrg simulate --out"));
    assert!(refused(&d, &["burn", "run.csv", "--port", "/dev/none"]).contains("not a calibration"));
    let words = ok(&d, &["profile", "--profile", "20,-40@1,1h,50@1,1h,20@1", "--for", "hysteresis,kink"]);
    assert!(words.contains("hysteresis") && words.contains("ramp to -40 C at 1 C/min (60 min)"), "{words}");
    assert!(refused(&d, &["profile", "--for", "gremlins"]).contains("gremlins"));
}

#[test]
fn a_profile_may_begin_below_zero() {
    let d = folder("below-zero");
    let text = ok(&d, &["profile", "--for", "cubic", "--profile", "-40,50@1,30m,-40@1,30m"]);
    assert!(text.contains("Begin at -40 C"), "{text}");
    let error = refused(&d, &["monitor", "--port", "/dev/null/none", "--profile", "-40,5x"]);
    assert!(error.contains("5x"), "{error}");
}

#[test]
fn a_reader_that_has_had_enough_is_no_error_and_files_are_written_all_the_same() {
    let d = folder("pipe");
    let table = concat!(env!("CARGO_MANIFEST_DIR"), "/../../host-tests/recordings/dong2023-table1.csv");
    for k in 0..10 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_hrg"))
            .current_dir(&d)
            .args(["points", table, "--out", &format!("{k}.json")])
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::piped())
            .spawn()
            .expect("hrg runs");
        drop(child.stdout.take());
        let o = child.wait_with_output().expect("ends");
        assert!(o.status.success() && o.stderr.is_empty(), "{}", String::from_utf8_lossy(&o.stderr));
        assert!(d.join(format!("{k}.json")).exists());
    }
}

#[test]
fn a_log_is_shown_as_the_link_is() {
    let d = folder("monitor-log");
    let second = |k: u32| {
        format!("INFO  t={} on={k}.0 f=4898.6,4890.7,4702.3 T=6.3,4.9,5.0 dT=0.2,0.2,0.2 b=1.0,2.0,3.0 raw=4.5,5.5,6.5 status=00,00,00,00 cal=deadbeef no=4 made=1795219200 mode=0\n", 1000 * k)
    };
    let head =
        "INFO  hrg firmware 0.1.0: unit HRG-9, calibration deadbeef no. 4, status 00, start after power-on, 0 resets\n";
    std::fs::write(d.join("log.txt"), head.to_string() + &(1..90).map(second).collect::<String>()).expect("written");
    let text = ok(&d, &["monitor", "--defmt", "log.txt", "--snapshot", "60", "--profile", "-40,50@1,2h"]);
    for part in [
        "unit HRG-9",
        "image deadbeef no. 4 of 2026-11-21",
        "on for 0:01:00",
        "+0.200",
        "3.48 h left",
        "this is the unit's log",
    ] {
        assert!(text.contains(part), "{part} is not on\n{text}");
    }
    std::fs::write(d.join("none.txt"), "nothing\n").expect("written");
    assert!(refused(&d, &["monitor", "--defmt", "none.txt", "--snapshot", "1"]).contains("no line of a second"));
    assert!(!hrg(&d, &["monitor"]).status.success());
}

/// dong2023's section 2 from a unit's run: soaks, their curves, a fit on these curves; and zhao2022's path: a time constant from the rate,
/// predicted temperatures, a fit on them, an image that works by frequency.
#[test]
fn soaks_curves_and_predicted_temperatures_end_in_images() {
    let d = folder("soaks");
    let soaks = "25,-40@set,3h,-20@set,3h,0@set,3h,15@set,3h,30@set,3h,40@set,3h,50@set,3h";
    ok(&d, &["simulate", "--profile", soaks, "--unit", "6", "--out", "soaks.csv"]);
    ok(&d, &["simulate", "--profile", "cycle", "--unit", "6", "--seed", "2", "--out", "run.csv"]);
    let text = ok(&d, &["soaks", "soaks.csv", "--out", "table.csv"]);
    assert!(text.contains("table.csv: 7 soaks"), "{text}");
    let text = ok(&d, &["points", "table.csv", "--calibration", "curves.toml"]);
    assert!(text.contains("z: T(f) about") && text.contains("referred to the case"), "{text}");
    assert!(std::fs::read_to_string(d.join("curves.toml")).expect("written").contains("SIM-6"));
    let text = ok(&d, &["fit", "run.csv", "--curve", "curves.toml", "--out", "cal.toml"]);
    assert!(text.contains("temperatures are those of the curves that were given"), "{text}");
    let line = |file: &str, key: &str| {
        let text = std::fs::read_to_string(d.join(file)).expect("written");
        text.lines().filter(|l| l.starts_with(key)).map(String::from).collect::<Vec<_>>()
    };
    let key = "temperature_coefficients_c";
    assert!(line("cal.toml", key).len() == 3 && line("cal.toml", key) == line("curves.toml", key));
    let error = refused(&d, &["soaks", "run.csv", "--hold", "5h", "--out", "no.csv"]);
    assert!(error.contains("no soak") && !d.join("no.csv").exists(), "{error}");

    ok(
        &d,
        &[
            "simulate",
            "--kind",
            "zhao",
            "--profile",
            "25,4h,35@5,5h",
            "--unit",
            "6",
            "--seed",
            "3",
            "--out",
            "step.csv",
        ],
    );
    ok(&d, &["simulate", "--kind", "zhao", "--profile", "zhao", "--unit", "6", "--seed", "4", "--out", "train.csv"]);
    ok(&d, &["lag", "step.csv", "--from", "rate", "--predict", "train.csv", "--recording-out", "predicted.csv"]);
    let text = ok(
        &d,
        &[
            "fit",
            "predicted.csv",
            "--method",
            "ga-bp",
            "--curve",
            "curves.toml",
            "--history",
            "h.csv",
            "--out",
            "net.toml",
        ],
    );
    assert!(text.contains("ga-bp"), "{text}");
    assert_eq!(line("net.toml", key), line("curves.toml", key), "it works by frequency");
    assert_eq!(std::fs::read_to_string(d.join("h.csv")).expect("written").lines().count(), 1 + 3 * 60);
    // On the unit, by frequency, it takes most of the bias off.
    ok(&d, &["correct", "train.csv", "--calibration", "net.toml", "--out", "corrected.csv"]);
    let spread = |file: &str| {
        let text = std::fs::read_to_string(d.join(file)).expect("written");
        let mut rows = text.lines().filter(|l| !l.starts_with('#')).map(|l| l.split(',').collect::<Vec<_>>());
        let header = rows.next().expect("a header");
        let x = header.iter().position(|h| *h == "rate_x_dph").expect("a rate");
        // From the ramp on.
        let v: Vec<f64> = rows.skip(5 * 3600).filter_map(|r| r[x].parse().ok()).collect();
        let mean = v.iter().sum::<f64>() / v.len() as f64;
        (v.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / v.len() as f64).sqrt()
    };
    assert!(spread("corrected.csv") < 0.5 * spread("train.csv"), "{} {}", spread("corrected.csv"), spread("train.csv"));
    let e = refused(&d, &["fit", "run.csv", "--method", "lsq", "--history", "h2.csv", "--out", "no.toml"]);
    assert!(e.contains("solved exactly"), "{e}");
    let e = refused(&d, &["fit", "run.csv", "--curve", "net.csv", "--out", "no.toml"]);
    assert!(e.contains("net.csv"), "{e}");
}

#[test]
fn a_folder_of_hrg_calibrate_stays_that_of_its_unit_and_profile() {
    let d = folder("calibrate-folder");
    let run = |unit: &str, profile: &str| {
        let wanted = "calibrate --port none --limit 2 --from 0 --to 40 --folder u --unit";
        let o = hrg(&d, &wanted.split(' ').chain([unit, "--profile", profile]).collect::<Vec<_>>());
        assert!(!o.status.success());
        [o.stdout, o.stderr].map(|text| String::from_utf8_lossy(&text).into_owned())
    };
    let refusal = |unit, profile| {
        let [_, e] = run(unit, profile);
        e
    };
    assert!(refusal("HRG-1", "cycle").contains("none"), "there is no port");
    let e = refusal("HRG-2", "cycle");
    assert!(e.contains("--unit HRG-1, and now it is HRG-2"), "{e}");
    let e = refusal("HRG-1", "20,1h");
    assert!(e.contains("--profile cycle, and now it is 20,1h"), "{e}");
    // A test that failed, or was torn, is made again.
    for test in ["{\"verdict\": \"FAIL\"}", "{\"verd", "{\"verdict\": \"PASS\"}"] {
        std::fs::write(d.join("u/test.json"), test).expect("written");
        let [printed, _] = run("HRG-1", "cycle");
        let printed = printed.contains("1. built-in test: done before");
        assert_eq!(printed, test.contains("PASS"), "{test}");
    }
}

#[cfg(unix)]
#[test]
fn a_fleet_looks_at_each_file_once_and_not_at_hidden_ones() {
    let d = folder("fleet-links");
    std::fs::create_dir_all(d.join("units/b")).expect("made");
    ok(&d, &["simulate", "--profile", "20,40@2,10m", "--out", "units/a.csv"]);
    std::fs::copy(d.join("units/a.csv"), d.join("units/.hidden.csv")).expect("copied");
    std::os::unix::fs::symlink("..", d.join("units/b/up")).expect("linked");
    std::os::unix::fs::symlink("../a.csv", d.join("units/b/again.csv")).expect("linked");
    let printed = ok(&d, &["fleet", "units", "--out", "out"]);
    assert!(printed.contains("1 units"), "{printed}");
    for out in ["units/out", "units/b/up/out"] {
        let o = hrg(&d, &["fleet", "units", "--out", out]);
        assert!(String::from_utf8_lossy(&o.stderr).contains("lies in the folder that is read"), "{out}");
    }
}
