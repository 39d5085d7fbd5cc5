//! The files follow the contract of recordings, version 2.

mod common;

use common::{read, Table};
use foreign_plant::cases;
use foreign_plant::generate::Generated;

fn made(name: &str) -> Generated {
    cases().into_iter().find(|c| c.name == name).unwrap_or_else(|| panic!("no case {name}")).generate(1)
}

fn tables(name: &str) -> Vec<Table> {
    let made = made(name);
    made.train.iter().chain([&made.verify]).map(|r| read(&r.to_csv())).collect()
}

const ORDINARY: [&str; 10] = [
    "memory-rod",
    "hysteresis-duhem",
    "shape-spline",
    "rate-root",
    "power-on-logarithm",
    "input-supply",
    "thermometer-ageing",
    "event-step",
    "mix-one-axis-each",
    "clean-usual",
];

#[test]
fn every_file_names_its_version_unit_run_and_rate_unit() {
    for name in ORDINARY {
        let made = made(name);
        for recording in made.train.iter().chain([&made.verify]) {
            let text = recording.to_csv();
            assert!(text.starts_with("# hrg-recording: 1\n"), "{name}");
            let table = read(&text);
            for key in ["unit", "run", "rate_unit", "thermometer", "power_on_s"] {
                assert!(table.metadata.contains_key(key), "{name}: {key}");
            }
            assert_eq!(table.metadata["rate_unit"], "deg/h");
            let head = &text[..2000];
            assert!(!head.contains(name), "{name} is told by its file");
        }
        let units: Vec<&String> = made.train[0]
            .metadata
            .iter()
            .chain(&made.verify.metadata)
            .filter(|(k, _)| k == "unit")
            .map(|(_, v)| v)
            .collect();
        assert_eq!(units[0], units[1], "{name}: one unit");
    }
}

#[test]
fn required_columns_are_there_and_plausible() {
    for name in ORDINARY {
        for (k, table) in tables(name).iter().enumerate() {
            let time = &table.columns["time_s"];
            let hours = if k == 0 { 7.0 } else { 10.0 };
            assert_eq!(time.len(), (hours * 3600.0) as usize, "{name}");
            assert!(time.windows(2).all(|w| (w[1] - w[0] - 1.0).abs() < 1e-9), "{name}: one row a second");
            for (axis, low, high) in [("x", 4860.0, 4940.0), ("y", 4850.0, 4930.0), ("z", 4670.0, 4750.0)] {
                let hz = &table.columns[&format!("f{axis}_hz")];
                assert!(hz.iter().all(|f| (low..high).contains(f)), "{name}: f{axis}");
                let case = &table.columns[&format!("case_{axis}_c")];
                assert!(case.iter().all(|t| (-50.0..75.0).contains(t)), "{name}: case {axis}");
                let span =
                    |x: &[f64]| x.iter().fold(f64::MIN, |a, &b| a.max(b)) - x.iter().fold(f64::MAX, |a, &b| a.min(b));
                // 96 ppm/C of 4.7 to 4.9 kHz is 0.43 to 0.49 Hz/C; a fault of the thermometer may add to it.
                let slope = span(hz) / span(case);
                assert!((0.40..0.55).contains(&slope), "{name} {axis}: {slope} Hz/C");
                let steps = case.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|d| *d > 0.0).fold(f64::MAX, f64::min);
                assert!((steps - 0.0625).abs() < 1e-3 || (steps - 0.1).abs() < 1e-3, "{name}: case step {steps}");
                let rate = &table.columns[&format!("rate_{axis}_dph")];
                assert!(rate.iter().all(|r| r.abs() < 200.0), "{name}: rate {axis}");
            }
        }
    }
}

#[test]
fn axes_and_thermometers_are_those_of_the_case() {
    let one = &tables("file-one-axis")[0];
    assert!(one.columns.contains_key("fy_hz") && !one.columns.contains_key("fx_hz"));
    assert!(!one.columns.contains_key("rate_z_dph") && !one.columns.contains_key("case_x_c"));
    let two = &tables("file-two-axes")[1];
    assert!(
        two.columns.contains_key("fx_hz")
            && two.columns.contains_key("rate_z_dph")
            && !two.columns.contains_key("fy_hz")
    );
    let sensors = &tables("file-sensors")[0];
    assert_eq!(sensors.metadata["thermometer"], "sensor");
    assert!(sensors.columns.contains_key("temp_z_c") && !sensors.columns.contains_key("fz_hz"));
    let single = &tables("file-one-sensor")[0];
    assert!(single.columns.contains_key("temp_c") && !single.columns.contains_key("temp_x_c"));
    assert!(single.columns.contains_key("rate_z_dph"));
    let inputs = &tables("input-supply")[0];
    for column in ["supply_v", "drive_x_v", "quad_z_v", "board_c"] {
        assert!(inputs.columns.contains_key(column), "{column}");
    }
}

#[test]
fn unusual_files_are_as_unusual_as_they_say() {
    let slow = &tables("file-slow-rows")[0].columns["time_s"];
    assert!(slow.windows(2).all(|w| w[1] - w[0] == 5.0));
    let fast = &tables("file-fast-rows")[0].columns["time_s"];
    assert!(fast.windows(2).all(|w| w[1] - w[0] == 0.5));
    let old = &tables("file-old-names")[0];
    assert!(old.columns.contains_key("shell_x_c") && !old.columns.contains_key("case_x_c"));
    assert_eq!(old.metadata["axes"], "x=north y=east z=down");
    let untimed = &tables("file-untimed")[1];
    assert!(!untimed.columns.contains_key("time_s"));
    assert_eq!(untimed.metadata["time_step_s"], "1");
    let bare = &tables("file-bare")[0];
    assert_eq!(bare.columns.len(), 7, "time, three frequencies, three rates");
    let shuffled = &tables("file-shuffled")[0];
    assert_eq!(shuffled.metadata["power_on_s"], "86400");
    assert_eq!(shuffled.columns["time_s"][0], 86_400.0);
    let late = &tables("state-begins-in-ramp")[0];
    assert_eq!((late.metadata["power_on_s"].as_str(), late.columns["time_s"][0]), ("0", 4800.0));
    let ramp = &late.columns["case_x_c"];
    assert!((ramp[1200] - ramp[0]).abs() > 10.0, "the log begins in a ramp");
}

#[test]
fn the_earths_rate_is_in_the_rates_where_latitude_is_stated() {
    let mut case = cases().into_iter().find(|c| c.name == "file-old-names").expect("listed");
    let with = case.generate(2);
    case.layout.earth = false;
    let without = case.generate(2);
    let mean_difference = |axis: &str| {
        let name = format!("rate_{axis}_dph");
        let (a, b) = (with.verify.column(&name).expect("rate"), without.verify.column(&name).expect("rate"));
        a.iter().zip(b).map(|(a, b)| a - b).sum::<f64>() / a.len() as f64
    };
    // 15.041 deg/h times cos and -sin of 28.2 deg.
    assert!((mean_difference("x") - 13.256).abs() < 0.01);
    assert!(mean_difference("y").abs() < 1e-9);
    assert!((mean_difference("z") + 7.108).abs() < 0.01);
}

#[test]
fn defects_are_in_the_files_and_counted_in_the_truth() {
    let made = made("file-many-defects");
    for (run, recording) in made.truth.runs.iter().zip(made.train.iter().chain([&made.verify])) {
        let text = recording.to_csv();
        assert!(text.lines().count() > 10 && text.contains("\r\n") && text.contains("NaN"));
        let table = read(&text);
        let time = &table.columns["time_s"];
        let count = |f: &dyn Fn(f64) -> bool| time.windows(2).filter(|w| f(w[1] - w[0])).count();
        assert!(count(&|d| d == 0.0) > 0, "repeated times");
        assert!(count(&|d| d < 0.0) > 0, "backward times");
        assert!(count(&|d| d > 100.0) > 0, "gaps");
        let missing = table.columns["rate_x_dph"].iter().filter(|x| x.is_nan()).count();
        let stated = run.defects["missing rate_x_dph"];
        // Some fall into a gap or twice on one row; a repeated row or a stuck stretch may hold one more.
        assert!(missing > stated / 2, "{missing} of {stated}");
        assert!(run.defects.contains_key("spike fx_hz") && run.defects.contains_key("stuck rate_z_dph"));
    }
    assert!(made_counts("file-defects") < made_counts("file-many-defects"));
    assert_eq!(made_counts("memory-rod"), 0);
}

fn made_counts(name: &str) -> usize {
    made(name).truth.runs.iter().flat_map(|r| r.defects.values()).sum()
}
