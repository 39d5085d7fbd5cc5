//! Recordings that were measured elsewhere: they load, every command takes them, and the loop closes on them.

use host_tests::{hrg, ok, program, run, temporary, MEASURED};
use hrg_data::recording::steps::Steps;
use hrg_identify::fit;
use hrg_papers::method::Method;
use hrg_papers::methods;
use hrg_study::measured;
use hrg_study::measured::Figure;
use std::path::Path;
use std::process::Command;

#[test]
fn the_imu_is_what_its_file_says() {
    let r = measured::load(Path::new(MEASURED), "imu_raw_data").expect("there");
    assert_eq!((r.time_s.len(), r.step_s()), (8395, 1.0));
    // Row 7 of the file: -0.0703 rad/s at 51.96 C.
    assert!((r.frequency_hz[0][0] - 51.964_996_34).abs() < 1e-6);
    assert!((r.rate_dph[0][0] + 0.070_722_922_68 * 206_264.806_247).abs() < 1e-3);
    let (low, high) =
        r.frequency_hz[2].iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(*t), h.max(*t)));
    assert!((-17.8..-17.4).contains(&low) && (73.5..74.5).contains(&high), "{low} {high}");
    // Nothing much is taken for a defect.
    let taken: usize = r.cleaned.iter().map(|c| c.count).sum();
    assert!(taken < 300, "{:?}", r.cleaned);
}

/// Another implementation's figures for eq 7 (numpy, standard deviations of a population): 504, 193, 242 deg/h.
#[test]
fn eq_7_on_the_imu_is_what_others_find() {
    let whole = measured::load(Path::new(MEASURED), "imu_raw_data").expect("there");
    let (train, verify) = whole.split(measured::IMU_TRAIN_S).expect("within");
    let prepared = fit::prepare(&[train]).expect("usable");
    let found = methods::identify(&prepared, Method::Lsq, 1).expect("fits");
    let steps = Steps::new(&verify).expect("long enough");
    let corrected = fit::correct(&found.calibration, &steps);
    for (a, wanted) in [504.0, 193.0, 242.0].into_iter().enumerate() {
        let f = Figure::of(&corrected[a], 0.0);
        // Of 19 means, a sample's deviation is 2.7 % above that of a population.
        let population = f.deviation * (18.0f64 / 19.0).sqrt();
        assert!((population / wanted - 1.0).abs() < 0.02, "axis {a}: {population} {wanted}");
    }
}

#[test]
fn every_command_takes_the_imu() {
    let d = temporary("measured-imu");
    let printed = ok(&d, "import MEASURED/imu_raw_data.csv.gz --map MEASURED/imu_raw_data.toml --out run.csv");
    assert!(printed.contains("8395 rows") && printed.contains("axes x, y and z"), "{printed}");
    for command in [
        "fit run.csv --out cal.toml",
        "fit run.csv --method fog-lsq --uniform --out no.toml",
        "correct run.csv --calibration cal.toml --out corrected.csv",
        "trace --train run.csv --split 6500 --out t.json --html t.html --calibration extended.toml",
        "correct run.csv --calibration extended.toml --out extended.csv",
        "allan run.csv --out allan.svg --json allan.json",
        "profile --check run.csv",
        "report run.csv --json report.json --html report.html",
    ] {
        let (code, out, error) = hrg(&d, command);
        if command.contains("--uniform") {
            assert!(code == Some(2) && error.contains("the same weight"), "{command}: {error}");
        } else {
            assert_eq!(code, Some(0), "{command}: {out}{error}");
        }
    }
    let cal = std::fs::read_to_string(d.join("cal.toml")).expect("written");
    assert!(cal.contains("sensor_centre_c") && !cal.contains("frequency_centre_hz"), "{cal}");
    let corrected = std::fs::read_to_string(d.join("corrected.csv")).expect("written");
    assert!(
        corrected.contains("# thermometer: sensor")
            && corrected.contains("time_s,temp_x_c,temp_y_c,temp_z_c,rate_x_dph")
    );
    let report: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(d.join("t.json")).expect("written")).expect("JSON");
    // One thermometer: nothing may be stated of differences between axes, nor of a timebase.
    for e in report["effects"].as_array().expect("a list") {
        assert!(e["name"] != "axis-gradient" && e["name"] != "timebase", "{e}");
    }
    let (code, _, error) = hrg(&d, "lag run.csv");
    assert!(code == Some(2) && error.contains("case_x_c is missing"), "{error}");
    // The firmware reads resonators: the board says so.
    let o = Command::new(program("hrg-board"))
        .current_dir(&d)
        .args(["run", "--recording", "run.csv", "--calibration", "cal.toml", "--out", "no.csv"])
        .output()
        .expect("runs");
    let error = String::from_utf8_lossy(&o.stderr);
    assert!(o.status.code() == Some(2) && error.contains("three resonators"), "{error}");
}

#[test]
fn every_command_takes_one_axis_over_a_few_degrees() {
    let d = temporary("measured-gpsdo");
    let printed = ok(&d, "import MEASURED/gpsdo.short.csv.gz --map MEASURED/gpsdo.short.toml --out run.csv");
    assert!(printed.contains("axes x;"), "{printed}");
    let text = std::fs::read_to_string(d.join("run.csv")).expect("written");
    let head: Vec<&str> = text.lines().take_while(|l| !l.starts_with(|c: char| c.is_ascii_digit())).collect();
    assert_eq!(head.last(), Some(&"time_s,temp_x_c,rate_x_dph"));
    let rows: Vec<&str> = text.lines().skip(head.len()).collect();
    for (name, rows) in [("a.csv", &rows[..4000]), ("b.csv", &rows[4000..8000])] {
        std::fs::write(d.join(name), format!("{}\n{}\n", head.join("\n"), rows.join("\n"))).expect("written");
    }
    let out = ok(&d, "fit a.csv --out cal.toml");
    assert!(out.contains("the temperatures span") && out.contains("hard to tell apart"), "{out}");
    assert!(out.lines().any(|l| l.starts_with("x ")) && !out.lines().any(|l| l.starts_with("y ")), "{out}");
    let out = ok(&d, "trace --train a.csv --verify b.csv --out t.json --html t.html");
    assert!(!out.contains("on x, y, z"), "{out}");
    ok(&d, "compare a.csv --verify b.csv --methods lsq,polynomial --out compare");
    ok(&d, "correct b.csv --calibration cal.toml --out corrected.csv");
    ok(&d, "allan run.csv");
    let out = ok(&d, "report run.csv");
    assert!(out.contains("largest loop width"), "{out}");
    // A calibration for resonators is none for a sensor.
    ok(&d, "simulate --profile fast --out sim.csv");
    ok(&d, "fit sim.csv --out sim.toml");
    let (code, _, error) = hrg(&d, "correct b.csv --calibration sim.toml --different-units --out no.csv");
    assert!(code == Some(2) && error.contains("thermometers are sensors"), "{error}");
    let (code, _, error) = hrg(&d, "trace --train a.csv --verify sim.csv --different-units --out no.json");
    assert!(code == Some(2) && error.contains("different axes or thermometers"), "{error}");
}

#[test]
fn one_direction_is_taken_with_a_warning() {
    let d = temporary("measured-one");
    let r = measured::load(Path::new(MEASURED), "imu_raw_data").expect("there");
    // From the coldest row to the hottest: heating only.
    let rows: Vec<usize> = (0..r.time_s.len()).collect();
    let of = |k: &usize| r.frequency_hz[0][*k];
    let coldest = rows.iter().copied().min_by(|a, b| of(a).total_cmp(&of(b))).expect("rows");
    let hottest = rows.iter().copied().max_by(|a, b| of(a).total_cmp(&of(b))).expect("rows");
    assert!(coldest < hottest);
    let (_, heating) = r.split(r.time_s[coldest]).expect("within");
    let (heating, _) = heating.judged_part().split(r.time_s[hottest]).expect("within");
    std::fs::write(d.join("up.csv"), heating.to_csv()).expect("written");
    let out = ok(&d, "fit up.csv --out cal.toml");
    assert!(out.contains("no cooling ramp"), "{out}");
    let (code, _, error) = hrg(&d, "fit up.csv --method two-sets --out no.toml");
    assert!(code == Some(2) && error.contains("no cooling ramp"), "{error}");
}

#[test]
fn modes_of_one_body_are_each_others_thermometers() {
    let modes = measured::modes(Path::new(MEASURED)).expect("there");
    assert_eq!(modes.keys().collect::<Vec<_>>(), ["Back", "Bottom", "Front", "Top"]);
    for (orientation, p) in modes {
        let report = hrg_identify::thermometer::points::report(&p).expect("fits");
        assert!(!report.fits.contains_key("shell") && report.fits["chamber"].len() == 3);
        let pair = report.each_other.iter().find(|p| p.axes == ["x", "z"]).expect("three modes");
        // Published of these sweeps: the rests of two modes share a shape in all four orientations, 0.71 to 0.86.
        assert!(pair.correlation > 0.7 && pair.p_value < 0.05, "{orientation}: {pair:?}");
    }
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn the_loop_prints_its_figures() {
    let study = |folder: &str| run("hrg-study", Path::new(MEASURED), &format!("measured {folder}"));
    let (code, out, error) = study(".");
    assert_eq!(code, Some(0), "{error}");
    for words in ["raw", "lsq", "ga-bp", "fog-pso", "trace", "swap test", "A100 B300"] {
        assert!(out.contains(words), "{words}: {out}");
    }
    let (code, _, error) = study("nowhere");
    assert!(code == Some(2) && error.contains("cannot read nowhere"), "{error}");
}
