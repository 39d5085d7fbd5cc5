//! Parquet in and out, by the commands: files that pandas wrote (`recordings/pandas/make.py`), and a round trip of our own.

use host_tests::{hrg, ok, temporary};
use std::path::Path;

fn text(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect("written")
}

#[test]
fn a_recording_that_pandas_wrote_is_one() {
    let d = temporary("parquet-recording");
    let printed = ok(&d, "import PANDAS/recording.parquet --out run.csv");
    assert!(printed.contains("300 rows, 1.000 s apart, axes x; temp_x_c from 20.00 to 57.38 C"), "{printed}");
    let run = text(&d, "run.csv");
    for line in ["# unit: PANDAS-1", "# thermometer: sensor", "# power_on_s: 0", "time_s,temp_x_c,rate_x_dph"] {
        assert!(run.lines().any(|l| l == line), "{line}: {run}");
    }
    // Row 3 as make.py makes it: 1.5 + 0.03 + 0.001 (3 * 7919 mod 101); row 7 has no rate.
    assert!(run.contains("\n3,20.375000,1.552000\n") || run.contains("\n3,20.375,1.552\n"), "{run}");
    assert!(run.lines().any(|l| l.starts_with("7,20.875") && l.ends_with(',')), "{run}");
    // Every command takes it as it is.
    let out = ok(&d, "allan PANDAS/recording.parquet");
    assert!(out.contains("x"), "{out}");
}

#[test]
fn a_table_that_pandas_wrote_is_read_by_a_map() {
    let d = temporary("parquet-table");
    let map = "hrg-map = 1\n[table]\nkeep = { imu = \"left\" }\n[time]\ncolumn = \"when\"\nunit = \"iso\"\n\
               [temperature]\nall = { column = \"celsius\" }\n[rate]\nz = { column = \"gyro\", unit = \"rad/s\" }\n";
    std::fs::write(d.join("map.toml"), map).expect("written");
    let (code, printed, error) = hrg(&d, "import PANDAS/table.parquet --map map.toml --out run.csv");
    assert_eq!(code, Some(0), "{error}");
    assert!(printed.contains("150 rows, 0.080 s apart, axes z"), "{printed}");
    assert!(error.contains("1 cells are empty") && error.contains("shapes.list.element"), "{error}");
    let rows: Vec<Vec<String>> = text(&d, "run.csv")
        .lines()
        .filter(|l| l.starts_with(|c: char| c.is_ascii_digit()))
        .map(|l| l.split(',').map(String::from).collect())
        .collect();
    let number = |row: usize, cell: usize| rows[row][cell].parse::<f64>().expect("a number");
    assert!((number(1, 0) - 0.08).abs() < 1e-6 && rows[2][1].is_empty() && number(4, 1) == 21.0, "{:?}", &rows[..5]);
    // k = 2: 1.5 + 0.02 + 0.001 (2 * 7919 mod 101), in single precision of rad/s.
    assert!((number(1, 2) - 1.602).abs() < 1e-6, "{:?}", rows[1]);
    std::fs::write(d.join("map.toml"), map.replace("gyro", "rate")).expect("written");
    let (code, _, error) = hrg(&d, "import PANDAS/table.parquet --map map.toml");
    assert!(code == Some(2) && error.contains("\"rate\", is not in the file; there are \"when\", \"imu\""), "{error}");
    let (code, _, error) = hrg(&d, "import PANDAS/table.parquet");
    assert!(code == Some(2) && error.contains("table.parquet: ") && error.lines().count() == 1, "{error}");
}

#[test]
fn what_goes_out_as_parquet_comes_back_the_same() {
    let d = temporary("parquet-round");
    ok(&d, "simulate --profile fast --out run.csv");
    ok(&d, "simulate --profile fast --out run.parquet");
    ok(&d, "fit run.csv --out a.toml");
    ok(&d, "fit run.parquet --out b.toml");
    let numbers = |name: &str| -> Vec<String> {
        text(&d, name).lines().filter(|l| !l.contains("crc32") && !l.contains("created")).map(String::from).collect()
    };
    assert_eq!(numbers("a.toml"), numbers("b.toml"), "the same numbers to the last bit");
    ok(&d, "correct run.csv --calibration a.toml --out corrected.csv");
    ok(&d, "correct run.parquet --calibration a.toml --out corrected.parquet");
    ok(&d, "import corrected.parquet --out back.csv");
    let rows = |name: &str| -> Vec<Vec<Option<f64>>> {
        let text = text(&d, name);
        let rows = text.lines().filter(|l| l.starts_with(|c: char| c.is_ascii_digit()));
        rows.map(|l| l.split(',').map(|c| c.parse().ok()).collect()).collect()
    };
    assert_eq!(rows("corrected.csv"), rows("back.csv"));
    let meta = |name: &str| {
        let mut lines: Vec<String> = text(&d, name).lines().filter(|l| l.starts_with('#')).map(String::from).collect();
        lines.sort();
        lines
    };
    assert_eq!(meta("corrected.csv"), meta("back.csv"));
    // Parquet by its beginning, whatever its name; and what is none.
    std::fs::copy(d.join("run.parquet"), d.join("run.dat")).expect("copied");
    ok(&d, "fit run.dat --out c.toml");
    std::fs::write(d.join("no.parquet"), "PAR1 and no more").expect("written");
    let (code, _, error) = hrg(&d, "fit no.parquet --out d.toml");
    assert!(code == Some(2) && error.contains("no.parquet: cannot be read as Parquet"), "{error}");
}
