//! `hrg import` on files as a laboratory has them.

use hrg_data::recording::Recording;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let p = std::env::temp_dir().join(format!("hrg-import-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&p).expect("a temporary folder");
    p
}

fn lab(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../host-tests/recordings/lab");
    folder.join(name).to_str().expect("a path").to_string()
}

fn import(folder: &Path, arguments: &[&str]) -> Output {
    let o = Command::new(env!("CARGO_BIN_EXE_hrg")).arg("import").current_dir(folder).args(arguments).output();
    o.expect("hrg runs")
}

fn error(o: &Output) -> String {
    String::from_utf8_lossy(&o.stderr).into_owned()
}

#[test]
fn a_labs_files_are_a_recording_in_one_step() {
    // Latin-1, semicolons, decimal commas, dates, a title, texts for missing values; a thermometer of its own whose clock is 37 s ahead.
    let d = folder("lab");
    let (run, log) = (lab("lauf1.csv.gz"), lab("pt100_1.csv.gz"));
    let place = ["--unit", "FOG-3", "--latitude", "53.1", "--axes", "x=north y=east z=down"];
    let with = ["--with", &log, "--offset", "-37", "-o", "run.csv"];
    let o = import(&d, &[&[run.as_str()], &with[..], &place[..]].concat());
    assert!(o.status.success(), "{}", error(&o));
    let r = Recording::load(&d.join("run.csv")).expect("a recording");
    assert_eq!((r.time_s.len(), r.unit(), r.meta("power_on_unix_s")), (2521, "FOG-3", Some("1795159810.000")));
    assert!((r.step_s() - 10.0).abs() < 1e-9 && r.without_earth_rate());
    // (The chamber begins at 22 C and ends there; deg/s have become deg/h.)
    let t = &r.frequency_hz[0];
    assert!((t[2] - 22.0).abs() < 0.5 && t.iter().any(|t| *t > 55.0) && t.iter().any(|t| *t < -33.0));
    assert!(r.rate_dph[0].iter().filter(|v| v.is_finite()).all(|v| v.abs() < 100.0));
    assert_eq!(r.rate_dph[1].iter().filter(|v| v.is_nan()).count(), 6, "--- is a missing value");
    // The guess is a map that does the same.
    let map = String::from_utf8_lossy(&import(&d, &[&run]).stdout).into_owned();
    std::fs::write(d.join("map.toml"), &map).expect("written");
    let o = import(&d, &[&run, "--map", "map.toml", "-o", "mapped.csv"]);
    assert!(o.status.success(), "{}", error(&o));
    let again = Recording::load(&d.join("mapped.csv")).expect("a recording");
    let same = |x: &f64, y: &f64| x - 53.1f64.to_radians().cos() * 15.041_067 - y < 1e-3 || x.is_nan();
    assert!(again.rate_dph[0].iter().zip(&r.rate_dph[0]).all(|(x, y)| same(x, y)));
}

#[test]
fn a_spreadsheet_is_a_table() {
    let d = folder("excel");
    let o = import(&d, &[&lab("lab.xlsx"), "-o", "run.csv"]);
    assert!(o.status.success(), "{}", error(&o));
    let r = Recording::load(&d.join("run.csv")).expect("a recording");
    assert!(r.time_s.len() == 60 && r.step_s() == 10.0 && (r.frequency_hz[2][0] - 21.96).abs() < 0.01);
    assert!((r.rate_dph[0][0] - 23.548_65).abs() < 1e-4 && r.meta("power_on_unix_s").is_some());
}

#[test]
fn a_table_that_tells_too_little_ends_in_a_map_to_complete() {
    let d = folder("little");
    let rows: String = (0..20).map(|k| format!("{k},{},{}\n", 0.1 * f64::from(k), 20 + k)).collect();
    std::fs::write(d.join("odd.csv"), format!("time,alpha,temp\n{rows}")).expect("written");
    let o = import(&d, &["odd.csv", "-o", "run.csv"]);
    assert_eq!(o.status.code(), Some(2));
    assert!(error(&o).contains("no column is known for a rate") && !d.join("run.csv").exists(), "{}", error(&o));
    let map = String::from_utf8_lossy(&o.stdout).into_owned();
    let complete = map.replace("[rate]", "[rate]\nz = { column = \"alpha\", unit = \"deg/s\" }");
    std::fs::write(d.join("map.toml"), complete).expect("written");
    assert!(import(&d, &["odd.csv", "--map", "map.toml", "-o", "run.csv"]).status.success());
    let o = import(&d, &["odd.csv", "--map", "map.toml", "-o", "odd.csv"]);
    assert!(error(&o).contains("stays as it is") && o.status.code() == Some(2), "{}", error(&o));
    let wide = format!("time [s],wz [deg/h],temp [C]\n{rows}");
    std::fs::write(d.join("wide.csv"), wide.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>())
        .expect("written");
    let o = import(&d, &["wide.csv", "-o", "run.csv"]);
    assert!(o.status.success() && error(&o).contains("UTF-16"), "{}", error(&o));
    std::fs::write(d.join("mixed.csv"), "t [s];wz [deg/h];T [C]\n0;1,200;20.5\n1;1,300;20.5\n").expect("written");
    assert!(error(&import(&d, &["mixed.csv", "-o", "run.csv"])).contains("decimal commas"), "thousands or decimals");
    std::fs::write(d.join("words.txt"), "no table\nat all\n").expect("written");
    assert!(error(&import(&d, &["words.txt"])).contains("no table is found"));
}
