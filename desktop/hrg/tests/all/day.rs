//! The documented day as a user walks it on files: names, earth rate, scale factor, tables of other programs, correction.

use hrg_data::recording::Recording;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn folder(name: &str) -> PathBuf {
    let p = std::env::temp_dir().join(format!("hrg-day-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&p);
    std::fs::create_dir_all(&p).expect("a temporary folder");
    p
}

fn hrg(folder: &Path, arguments: &str) -> Output {
    let arguments = arguments.split_whitespace().map(|a| a.replace('_', " ").replace("  ", "_"));
    Command::new(env!("CARGO_BIN_EXE_hrg")).current_dir(folder).args(arguments).output().expect("hrg runs")
}

/// Standard output and standard error of a command that must succeed. (In arguments, `_` is a blank and `__` is `_`.)
fn ok(folder: &Path, arguments: &str) -> String {
    let o = hrg(folder, arguments);
    assert!(o.status.success(), "{arguments}: {}", String::from_utf8_lossy(&o.stderr));
    format!("{}{}", String::from_utf8_lossy(&o.stdout), String::from_utf8_lossy(&o.stderr))
}

/// Exit status 2, and the last line on standard error.
fn refused(folder: &Path, arguments: &str) -> String {
    let o = hrg(folder, arguments);
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert_eq!(o.status.code(), Some(2), "{arguments}: {error}");
    error.lines().last().unwrap_or("").to_string()
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect("written")
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).expect("written");
}

/// A constant of the baseline of each axis, deg/h.
fn constants(folder: &Path, name: &str) -> [f32; 3] {
    let c = hrg_data::image_file::load(&folder.join(name)).expect("a calibration");
    c.axes.each_ref().map(|a| match a.coefficients {
        hrg_core::bias::Coefficients::One(k) => k[0],
        _ => panic!("eq 7 was asked for"),
    })
}

const NED: &str = "--axes x=north_y=east_z=down";

#[test]
fn the_earths_rate_is_removed_or_reported() {
    let d = folder("earth");
    ok(&d, "simulate --profile fast --latitude 50 --axes x=up_y=south_z=west --out told.csv");
    ok(&d, "simulate --profile fast --latitude 50 --axes x=up_y=south_z=west --no-attitude --out untold.csv");
    ok(&d, "simulate --profile fast --latitude -30 --axes x=north_y=east_z=down --out elsewhere.csv");
    let stated = ok(&d, "fit told.csv --out told.toml");
    assert!(!stated.contains("earth's rate"), "{stated}");
    let unstated = ok(&d, "fit untold.csv --out untold.toml");
    assert!(unstated.contains("up to 15.04 deg/h") && unstated.contains("--latitude"), "{unstated}");
    ok(&d, "fit untold.csv --latitude 50 --axes x=up_y=south_z=west --out given.toml");
    ok(&d, "fit elsewhere.csv --out elsewhere.toml");
    let [stated, unstated, printed, elsewhere] =
        ["told.toml", "untold.toml", "given.toml", "elsewhere.toml"].map(|n| constants(&d, n));
    let (s, c) = 50f64.to_radians().sin_cos();
    for (a, part) in [15.041_067 * s, -15.041_067 * c, 0.0].into_iter().enumerate() {
        assert!((f64::from(unstated[a] - stated[a]) - part).abs() < 1e-3, "axis {a}: {} {}", unstated[a], stated[a]);
        // (The same simulated unit, in another place: its own bias is the same.)
        assert!((printed[a] - stated[a]).abs() < 1e-3 && (elsewhere[a] - stated[a]).abs() < 1e-3, "axis {a}");
    }
    assert!(refused(&d, &format!("fit told.csv --latitude 51 {NED} --out no.toml")).contains("latitude 50"));
    assert!(refused(&d, "fit untold.csv --latitude 51 --out no.toml").contains("without axes"));
    assert!(refused(&d, &format!("fit untold.csv --latitude 91 {NED} --out no.toml")).contains("-90 to 90"));
    assert!(refused(&d, "fit told.csv untold.csv --out no.toml").contains("others do not"));
    let trace = "trace --train told.csv --verify untold.csv --out r.json";
    assert!(refused(&d, trace).contains("others do not"));
    ok(&d, "simulate --profile up --seed 2 --no-attitude --out up.csv");
    let printed = ok(&d, "trace --train untold.csv --verify up.csv --out r.json --calibration r.toml");
    assert!(printed.contains("up to 15.04 deg/h") && read(&d, "r.json").contains("up to 15.04 deg/h"), "{printed}");
    assert!(!d.join("no.toml").exists());
}

#[test]
fn a_fit_keeps_the_scale_factor_and_says_where_none_is_known() {
    let d = folder("scale");
    ok(&d, "simulate --profile fast --out known.csv");
    let text = read(&d, "known.csv");
    let line = text.lines().find(|l| l.starts_with("# scale_factor_dph_per_code: ")).expect("told");
    write(&d, "unknown.csv", &text.replace(&format!("{line}\n"), ""));
    write(&d, "own.csv", &text.replace(line, "# scale_factor_dph_per_code: 0.01 0.02 -0.03"));
    let scale = |name: &str| hrg_data::image_file::load(&d.join(name)).expect("there").scale_factors_dph_per_code();
    assert!(!ok(&d, "fit known.csv --out known.toml").contains("scale factor"));
    let printed = ok(&d, "fit unknown.csv --out unknown.toml");
    assert!(
        printed.contains("the default of 20 deg/s at 2^23 codes") && printed.contains("--scale-factor"),
        "{printed}"
    );
    assert_eq!(scale("unknown.toml"), [72_000.0 / 8_388_608.0; 3]);
    ok(&d, "fit own.csv --out own.toml");
    assert_eq!(scale("own.toml"), [0.01, 0.02, -0.03]);
    ok(&d, "simulate --profile fast --seed 2 --out again.csv");
    let again = read(&d, "again.csv").replace(line, "# scale_factor_dph_per_code: 0.01 0.02 -0.03");
    write(&d, "verify.csv", &again);
    ok(&d, "trace --train own.csv --verify verify.csv --out r.json --calibration traced.toml");
    assert_eq!(scale("traced.toml"), [0.01, 0.02, -0.03]);
    ok(&d, "fit unknown.csv --base own.toml --out kept.toml");
    assert_eq!(scale("kept.toml"), [0.01, 0.02, -0.03]);
    assert_eq!(constants(&d, "kept.toml"), constants(&d, "unknown.toml"), "true deg/h stay what they are");
    // Rates that were made with a scale factor are converted to the one that is given.
    let printed = ok(
        &d,
        "fit own.csv --scale-factor 0.02,0.02,-0.03 --out twice.toml --latitude 28.2 --axes x=north_y=east_z=down",
    );
    assert!(printed.contains("converted"), "{printed}");
    assert_eq!(scale("twice.toml"), [0.02, 0.02, -0.03]);
    // (x is measured twice as large, with the earth's rate in it, which is not.)
    let ([a, ..], [b, ..]) = (constants(&d, "own.toml"), constants(&d, "twice.toml"));
    let earth = 15.041_067 * 28.2f64.to_radians().cos();
    assert!((f64::from(b) - (2.0 * (f64::from(a) + earth) - earth)).abs() < 1e-3, "{a} {b}");
    // Contradicting facts are refused.
    assert!(refused(&d, "fit known.csv --base own.toml --out no.toml").contains("0.01 0.02 -0.03"));
    assert!(refused(&d, "fit known.csv own.csv --out no.toml").contains("different scale factors"));
    assert!(refused(&d, "trace --train known.csv --verify own.csv --out r.json").contains("different scale factors"));
    assert!(refused(&d, "compare known.csv --verify own.csv --methods lsq --out c").contains("different scale factors"));
    assert!(refused(&d, "correct own.csv --calibration known.toml --out no.csv").contains("0.01 0.02 -0.03"));
    assert!(refused(&d, "fit known.csv --scale-factor 1,2 --out no.toml").contains("three numbers"));
    assert!(!d.join("no.toml").exists() && !d.join("no.csv").exists());
}

#[test]
fn a_unit_gets_its_name_from_the_user_and_keeps_it() {
    let d = folder("names");
    ok(&d, "simulate --profile fast --unit 3 --out named.csv");
    let text = read(&d, "named.csv");
    for (name, line) in [("none.csv", ""), ("default.csv", "# unit: default\n"), ("unnamed.csv", "# unit: unnamed\n")] {
        write(&d, name, &text.replace("# unit: SIM-3\n", line));
        let printed = ok(&d, &format!("fit {name} --out cal.toml"));
        assert!(printed.contains("names no unit") && printed.contains("--unit"), "{printed}");
        ok(&d, &format!("fit {name} --unit HRG-042 --out cal.toml"));
        assert!(read(&d, "cal.toml").contains("unit = \"HRG-042\""));
        let printed = ok(&d, &format!("correct {name} --calibration cal.toml --out c.csv"));
        assert!(printed.contains("nothing shows that they belong together"), "{printed}");
    }
    assert!(!ok(&d, "fit named.csv --unit SIM-3 --out sim.toml").contains("names no unit"));
    let e = refused(&d, "fit named.csv --unit HRG-042 --out no.toml");
    assert!(e.contains("named.csv") && e.contains("SIM-3") && e.contains("HRG-042"), "{e}");
    assert!(refused(&d, "fit none.csv --unit default --out no.toml").contains("without a name"));
    assert!(refused(&d, "fit none.csv --unit HRG_042 --out no.toml").contains("no blanks"));
    assert!(refused(&d, "fit none.csv --unit HRG-0123456789abc --out no.toml").contains("1 to 16"));
    let e = refused(&d, "correct named.csv --calibration cal.toml --out no.csv");
    assert!(e.contains("SIM-3") && e.contains("HRG-042"), "{e}");
    ok(&d, "correct named.csv --calibration cal.toml --different-units --out c.csv");
    // Two long names that begin alike are two.
    let long = |n: u8| format!("# unit: HRG-2026-batch-A-{n}\n");
    write(&d, "a.csv", &text.replace("# unit: SIM-3\n", &long(1)));
    write(&d, "b.csv", &text.replace("# unit: SIM-3\n", &long(2)));
    assert!(ok(&d, "fit a.csv --out a.toml").contains("does not fit"));
    assert!(!ok(&d, "correct a.csv --calibration a.toml --out c.csv").contains("nothing shows"));
    assert!(refused(&d, "correct b.csv --calibration a.toml --out no.csv").contains("HRG-2026-batch-A-2"));
    assert!(!d.join("no.toml").exists() && !d.join("no.csv").exists());
}

#[test]
fn metadata_that_cannot_be_used_are_refused() {
    let d = folder("metadata");
    ok(&d, "simulate --profile 20,5m --out run.csv");
    let text = read(&d, "run.csv");
    for (from, to, says) in [
        ("# rates: raw", "# rates: Corrected", "\"Corrected\" is not raw or corrected, in small letters"),
        ("# rates: raw", "# rates: raw\n# Rates: corrected", "differ"),
        ("# rates: raw", "# rates = corrected", "is written with \"=\""),
        ("# rates: raw", "  ## rates: Raw", "\"Raw\" is not raw"),
        ("x=north", "X=north", "\"X=north\" names no axis"),
        ("x=north", "x=forward", "\"x=forward\" names no direction"),
        ("# power_on_s: 0", "# power_on_s: abc", "\"abc\" is not a time in seconds"),
        ("# latitude_deg: 28.2\n", "", "axes is given without latitude_deg"),
        ("# latitude_deg: 28.2", "# latitude_deg: 128.2", "-90 to 90"),
        ("# axes: x=north y=east z=down\n", "", "latitude_deg is given without axes"),
        ("# unit: SIM-1", "# unit: SIM-1\n# unit: SIM-2", "metadata unit: line 2 and line 3 differ"),
        ("time_s,", "#time_s,", "the column time_s is missing"),
        ("time_s,", "Time_s,", "small letters"),
    ] {
        assert!(text.contains(from), "{from}");
        write(&d, "bad.csv", &text.replacen(from, to, 1));
        for command in ["allan bad.csv", "fit bad.csv --out no.toml"] {
            let e = refused(&d, command);
            assert!(e.contains("bad.csv") && e.contains(says), "{to}: {e}");
        }
    }
}

/// The recording with other separators, decimal marks and quotes.
fn dialect(text: &str, separator: &str, comma: bool, quotes: bool) -> String {
    let mut out = String::new();
    for line in text.lines() {
        if line.starts_with('#') {
            out += line;
        } else {
            let cells: Vec<String> = line
                .split(',')
                .map(|c| {
                    if comma && c.starts_with(|c: char| c.is_ascii_digit() || c == '-') {
                        c.replace('.', ",")
                    } else {
                        c.into()
                    }
                })
                .map(|c| if quotes { format!("\"{c}\"") } else { c })
                .collect();
            out += &cells.join(separator);
        }
        out += "\n";
    }
    out
}

#[test]
fn tables_of_other_programs_are_the_same_recording() {
    let d = folder("dialects");
    ok(&d, "simulate --profile 20,30m --defects --out run.csv");
    let text = read(&d, "run.csv");
    let plain = Recording::load(&d.join("run.csv")).expect("readable");
    for (name, other) in [
        ("semicolons", dialect(&text, ";", false, false)),
        ("decimal commas", dialect(&text, ";", true, false)),
        ("tabs", dialect(&text, "\t", true, false)),
        ("quotes", dialect(&text, ",", false, true)),
        ("quotes and decimal commas", dialect(&text, ";", true, true)),
        ("a spreadsheet's", format!("\u{feff}{}", dialect(&text, ";", true, false).replace('\n', "\r\n"))),
        ("a quoted header alone", text.replacen("time_s,", "\"time_s\",", 1)),
        ("an old Macintosh's", text.replace('\n', "\r")),
        ("the columns' old names", text.replace("case_", "shell_")),
        ("padded metadata", text.replace("# rates: raw\n", "# rates: raw,,,,,,\n")),
    ] {
        write(&d, "other.csv", &other);
        let mut other = Recording::load(&d.join("other.csv")).unwrap_or_else(|e| panic!("{name}: {e}"));
        other.source.clone_from(&plain.source);
        // (A NaN is not equal to itself, and its text is.)
        assert!(format!("{other:?}") == format!("{plain:?}"), "{name}");
    }
    for (name, other, says) in [
        ("decimal commas between commas", dialect(&text, ",", true, false), "need semicolons"),
        ("quoted decimal commas between commas", dialect(&text, ",", true, true), "decimal or a thousands comma"),
        ("both marks", dialect(&text, ";", false, false).replacen("4906.", "4906,", 1), "decimal"),
        ("spaces", dialect(&text, " ", false, false), "put commas"),
        ("an open quote", dialect(&text, ",", false, true).replacen("\"1\"", "\"1", 1), "not closed"),
        (
            "no header",
            text.lines().filter(|l| !l.starts_with("time_s")).map(|l| format!("{l}\n")).collect(),
            "column time_s is missing",
        ),
    ] {
        write(&d, "other.csv", &other);
        let e = refused(&d, "allan other.csv");
        assert!(e.contains(says), "{name}: {e}");
    }
}

#[test]
fn a_corrected_recording_is_what_the_unit_would_send() {
    let d = folder("correct");
    ok(&d, "simulate --profile cycle --effect thermal-lag --out a.csv");
    ok(&d, "simulate --profile verify --effect thermal-lag --seed 2 --out b.csv");
    ok(&d, "trace --train a.csv --verify b.csv --out r.json --calibration cal.toml");
    let printed = ok(&d, "correct b.csv --calibration cal.toml --out c.csv");
    assert!(printed.contains("seconds of SIM-1"), "{printed}");
    let text = read(&d, "c.csv");
    let header = "time_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph,raw_x_dph,raw_y_dph,raw_z_dph,bias_x_dph,bias_y_dph,bias_z_dph,bias_std_x_dph,bias_std_y_dph,bias_std_z_dph,temperature_x_c,temperature_y_c,temperature_z_c,status_x,status_y,status_z,status_unit";
    assert!(text.contains("# rates: corrected\n") && text.contains(header), "{}", &text[..600]);
    let (b, c) = (Recording::load(&d.join("b.csv")).expect("there"), Recording::load(&d.join("c.csv")).expect("there"));
    assert_eq!((b.time_s.len(), b.earth_rate_dph), (c.time_s.len(), c.earth_rate_dph));
    let spread = |v: &[f64]| hrg_data::numeric::stats::std_dev(&hrg_data::numeric::stats::block_means(v, 100));
    assert!(spread(&c.rate_dph[0]) < 0.5 * spread(&b.rate_dph[0]));
    assert!(refused(&d, "correct c.csv --calibration cal.toml --out e.csv").contains("corrected already"));
    assert!(refused(&d, "fit c.csv --out e.toml").contains("on top of another"));
    assert!(refused(&d, "correct b.csv --calibration r.json --out e.csv").contains("not a calibration"));
    assert!(refused(&d, "correct nowhere.csv --calibration cal.toml --out e.csv").contains("cannot read nowhere.csv"));
}

#[test]
fn a_chambers_own_log_is_merged_by_time() {
    let d = folder("merge");
    ok(&d, "simulate --profile fast --out run.csv");
    let text = read(&d, "run.csv");
    // Recording of a unit alone: no sensor but its own; and the time of its power-on.
    let r = Recording::parse(text.as_bytes()).expect("readable");
    let mut bare = String::from("# unit: SIM-1\n# power_on_unix_s: 1795255200.5\ntime_s,fx_hz,fy_hz,fz_hz,rate_x_dph,rate_y_dph,rate_z_dph,status_x\n");
    for k in 0..r.time_s.len() {
        let [f, g, h] = [0, 1, 2].map(|a: usize| r.frequency_hz[a][k]);
        let [x, y, z] = [0, 1, 2].map(|a: usize| r.rate_dph[a][k]);
        bare += &format!("{},{f},{g},{h},{x},{y},{z},128\n", r.time_s[k]);
    }
    write(&d, "bare.csv", &bare);
    // The chamber's log: another dialect, each ten seconds, local time of UTC+8, a degree sign in its own encoding.
    let mut log = b"Chamber 7, \xB0C\r\nDatum;Luft;G1;G2;G3\r\n".to_vec();
    let column = |name: &str, k: usize| format!("{:.3}", r.column(name).expect("simulated")[k]).replace('.', ",");
    for k in (0..r.time_s.len()).step_by(10).filter(|k| !(1000..1200).contains(k)) {
        let t = 36_000 + 8 * 3600 + k as u64 + 1;
        let cells = ["chamber_c", "case_x_c", "case_y_c", "case_z_c"].map(|c| column(c, k)).join(";");
        log.extend(format!("21.11.2026 {:02}:{:02}:{:02},5;{cells}\r\n", t / 3600, t / 60 % 60, t % 60).into_bytes());
    }
    std::fs::write(d.join("log.csv"), log).expect("written");
    let arguments = "import bare.csv --with log.csv --time Datum=%d.%m.%Y_%H:%M:%S%.f --offset -28800 --out m.csv --columns chamber__c=Luft,case__x__c=G1,case__y__c=G2,shell__z__c=G3";
    let e = refused(&d, arguments);
    assert!(e.contains("log.csv") && e.contains("is not a time of the form"), "a decimal comma within a time: {e}");
    let log = std::fs::read(d.join("log.csv")).expect("there");
    let log: Vec<u8> = String::from_utf8_lossy(&log).replace(",5;", ".5;").into_bytes();
    std::fs::write(d.join("log.csv"), log).expect("written");
    let printed = ok(&d, arguments);
    assert!(printed.contains("1 gaps") && printed.contains("chamber_c: a value in "), "{printed}");
    let merged = read(&d, "m.csv");
    assert!(merged.contains("# merged: chamber_c case_x_c case_y_c case_z_c from log.csv"));
    let m = Recording::parse(merged.as_bytes()).expect("a recording");
    assert_eq!((&m.time_s, &m.frequency_hz, m.status.len()), (&r.time_s, &r.frequency_hz, r.time_s.len()));
    for name in ["chamber_c", "case_x_c", "case_z_c"] {
        let (merged, truth) = (m.column(name).expect("merged"), r.column(name).expect("simulated"));
        let empty = merged.iter().filter(|v| v.is_nan()).count();
        assert!((180..230).contains(&empty), "{name}: {empty} cells in the gap and at the end are empty");
        let off = merged.iter().zip(truth).map(|(a, b)| (a - b).abs()).filter(|d| d.is_finite()).fold(0.0, f64::max);
        assert!(off < 0.1, "{name}: off by {off} C");
    }
    // With it the temperatures are those of the cases; without, of a curve that was shifted.
    assert!(ok(&d, "fit m.csv --out m.toml").contains("follow their cases"));
    assert!(ok(&d, "fit bare.csv --out b.toml").contains("no temperature sensor"));
    assert!(refused(&d, &arguments.replace("bare.csv", "m.csv").replace("--out m.csv", "--out n.csv"))
        .contains("values in chamber_c already"));
    let e = refused(&d, &arguments.replace(" --offset -28800", ""));
    assert!(e.contains("do not overlap") && e.contains("--offset"), "{e}");
    assert!(refused(&d, &arguments.replace("Datum", "Zeit")).contains("no column Zeit"));
    assert!(refused(&d, &arguments.replace("bare.csv", "log.csv")).contains("log.csv: "));
}

#[test]
fn a_log_gives_what_it_knows_and_takes_the_rest_from_the_user() {
    let d = folder("log");
    let line = |k: u32| {
        format!("{k}.06 INFO  t={k}000 f=4898.6,4890.6,4702.3 T=6,5,5 dT=0,0,0 b=0,0,0 raw=1,2,3 status=00,00,00,00 cal=0a no=1 made=0 mode=0\n")
    };
    let body: String = (1..200).map(line).collect();
    let boot =
        |name: &str| format!("0.01 INFO  hrg firmware 0.1.0: unit {name}, calibration 0000000a no. 1, status 00\n");
    write(&d, "named.log", &(boot("HRG-9") + &body));
    write(&d, "fresh.log", &(boot("default") + &body));
    write(&d, "sensors.txt", "time_s,case_x_c\n2,20\n50,21.5\n300,22\n");
    let all = format!("--latitude -33.9 {NED} --scale-factor 0.01,0.01,-0.01");
    ok(&d, &format!("record --defmt fresh.log --unit HRG-042 {all} --case-sensors sensors.txt --out a.csv"));
    let text = read(&d, "a.csv");
    for line in [
        "# unit: HRG-042",
        "# latitude_deg: -33.9",
        "# axes: x=north y=east z=down",
        "# scale_factor_dph_per_code: 0.01 0.01 -0.01",
    ] {
        assert!(text.contains(line), "{line}");
    }
    assert!(!text.contains("power_on_unix_s"), "a log that lies about has no clock");
    let r = Recording::load(&d.join("a.csv")).expect("a recording");
    let x = r.column("case_x_c").expect("recorded");
    let there: Vec<_> = x.iter().enumerate().filter(|(_, v)| v.is_finite()).collect();
    assert_eq!(there, [(1, &20.0), (49, &21.5)], "each in the row of its time");
    write(&d, "late.txt", "case_x_c=20\n");
    let e = refused(&d, "record --defmt fresh.log --case-sensors late.txt --out no.csv");
    assert!(e.contains("late.txt: line 1: time_s is missing") && e.contains("hrg import"), "{e}");
    ok(&d, "record --defmt fresh.log --out b.csv");
    assert!(read(&d, "b.csv").contains("# unit: unnamed"));
    ok(&d, "record --defmt named.log --unit HRG-9 --out c.csv");
    let e = refused(&d, "record --defmt named.log --unit HRG-042 --out d.csv");
    assert!(e.contains("the unit is HRG-9, --unit says HRG-042") && !d.join("d.csv").exists(), "{e}");
    assert!(refused(&d, "record --defmt named.log --latitude 3 --out d.csv").contains("without axes"));
}
