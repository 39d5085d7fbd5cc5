//! The binary: files beside each other, sentences for bad input.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn run(arguments: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_foreign-plant")).args(arguments).current_dir(folder).output().expect("it runs")
}

/// A folder of a test's own, empty.
fn empty(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn make_writes_recordings_and_truth() {
    let folder = empty("files");
    let output = run(&["make", "--case", "days-constants-rod", "--seed", "5", "--out", "a"], &folder);
    assert!(output.status.success(), "{output:?}");
    let expected = ["judge.csv", "train-1.csv", "train-2.csv", "truth.json", "verify.csv"]
        .map(|end| format!("days-constants-rod-5-{end}"));
    assert_eq!(names(&folder.join("a")), expected);
    let text = std::fs::read_to_string(folder.join("a/days-constants-rod-5-truth.json")).expect("the truth");
    let truth: foreign_plant::Truth = serde_json::from_str(&text).expect("the truth's format");
    assert_eq!(truth.runs.len(), 4);
    for run in &truth.runs {
        assert!(folder.join("a").join(&run.file).exists(), "{}", run.file);
    }
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["classes"][0], "memory");
    assert_eq!(json["effects"][0]["axes"], serde_json::json!(["x", "y", "z"]));
}

#[test]
fn list_shows_every_case() {
    let folder = empty("list");
    let output = run(&["list"], &folder);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(text.lines().count(), foreign_plant::cases().len());
}

#[test]
fn clean_takes_the_spectrum_of_a_table_for_each_third_unit() {
    let folder = empty("own-residuals");
    let rows: String =
        (0..600).map(|i| format!("{i},{}\n", (f64::from(i) * 0.37).sin() + f64::from(i * 7919 % 101) / 50.0)).collect();
    std::fs::write(folder.join("own.csv"), format!("t,residual\n{rows}")).expect("written");
    let output =
        run(&["clean", "--count", "3", "--out", "c", "--residuals", "own.csv", "--columns", "residual"], &folder);
    assert!(output.status.success(), "{output:?}");
    let truths: Vec<String> = names(&folder.join("c")).into_iter().filter(|n| n.ends_with("truth.json")).collect();
    assert_eq!(truths, ["clean-series-own-2-truth.json", "clean-usual-0-truth.json", "clean-white-1-truth.json"]);
}

#[test]
fn parts_with_seeds_of_their_own_share_no_unit() {
    let folder = empty("parts");
    for (first, out) in [("0", "a"), ("2", "b")] {
        let output = run(&["clean", "--first", first, "--count", "2", "--out", out], &folder);
        assert!(output.status.success(), "{output:?}");
    }
    let seeds = |part: &str| -> Vec<u64> {
        names(&folder.join(part))
            .into_iter()
            .filter(|n| n.ends_with("truth.json"))
            .map(|n| {
                let text = std::fs::read_to_string(folder.join(part).join(n)).expect("the truth");
                serde_json::from_str::<foreign_plant::Truth>(&text).expect("the truth's format").seed
            })
            .collect()
    };
    let (mut a, mut b) = (seeds("a"), seeds("b"));
    a.sort_unstable();
    b.sort_unstable();
    assert_eq!((a, b), (vec![0, 1], vec![2, 3]));
}

#[test]
fn bad_input_gets_a_sentence_and_exit_status_2() {
    let folder = empty("bad-input");
    for (arguments, sentence) in [
        (vec!["make", "--case", "no-such", "--out", "a"], "there is no case `no-such`; `foreign-plant list` shows all"),
        (vec!["clean", "--count", "1", "--out", "a", "--residuals", "none.csv"], "cannot read none.csv"),
        (vec!["clean", "--count", "1", "--out", "a", "--step", "0"], "--step must lie between 0.01 and 3600 s"),
    ] {
        let output = run(&arguments, &folder);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(sentence) && text.lines().count() == 1, "{text}");
    }
    assert!(names(&folder).is_empty(), "nothing is written on bad input");
}
