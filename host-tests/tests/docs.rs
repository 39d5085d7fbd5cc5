//! What the pages tell a user to type is there: every command with every option.

use host_tests::program;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

/// Commands of a page: lines of code, and code within sentences, that begin with one of our programs.
fn commands(page: &str) -> Vec<String> {
    let spans = page.split('`').enumerate().filter(|(k, _)| k % 2 == 1).map(|(_, s)| s);
    let ours = |s: &str| s.starts_with("hrg ") || s.starts_with("hrg-board ") || s.starts_with("cargo xtask ");
    page.lines()
        .chain(spans)
        // What follows two blanks and a # is a remark.
        .map(|l| l.split("  #").next().unwrap_or(""))
        .flat_map(|l| l.split(" | "))
        .map(|l| l.trim().trim_start_matches("target/release/"))
        .filter(|l| ours(l) && !l.contains('\n'))
        .map(String::from)
        .collect()
}

#[test]
fn every_command_in_the_pages_exists_with_its_options() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let xtask = std::fs::read_to_string(top.join("xtask/src/main.rs")).expect("there");
    let programs =
        BTreeMap::from([("hrg", program("hrg-cal", "hrg")), ("hrg-board", program("hrg-board", "hrg-board"))]);
    let mut helps: BTreeMap<String, String> = BTreeMap::new();
    let mut pages = vec![top.join("README.md")];
    pages.extend(std::fs::read_dir(top.join("docs")).expect("there").map(|e| e.expect("readable").path()));
    let mut checked = 0;
    for page in pages.iter().filter(|p| p.extension().is_some_and(|e| e == "md")) {
        for line in commands(&std::fs::read_to_string(page).expect("readable")) {
            let mut words = line.split_whitespace();
            let (name, command) = (words.next().unwrap_or(""), words.next().unwrap_or(""));
            let here = format!("{}: {line}", page.display());
            if name == "cargo" {
                let command = words.next().unwrap_or("");
                assert!(xtask.contains(&format!("Some(\"{command}\")")), "{here}");
                checked += 1;
                continue;
            }
            if !command.starts_with(|c: char| c.is_ascii_lowercase()) {
                continue;
            }
            let help = helps.entry(format!("{name} {command}")).or_insert_with(|| {
                let o = Command::new(&programs[name]).args([command, "--help"]).output().expect("runs");
                assert!(o.status.success(), "{here}: there is no such command");
                String::from_utf8_lossy(&o.stdout).into_owned()
            });
            for option in words.filter_map(|w| w.strip_prefix("--")) {
                let option = option.trim_end_matches([',', '.', ')', ';']);
                let there =
                    help.split(|c: char| !(c.is_ascii_alphanumeric() || c == '-')).any(|w| w == format!("--{option}"));
                assert!(there, "{here}: there is no option --{option}");
                checked += 1;
            }
        }
    }
    assert!(checked > 60, "{checked}");
}

#[test]
fn a_board_without_a_firmware_says_how_to_build_one() {
    let folder = std::env::temp_dir().join(format!("hrg-docs-{}", std::process::id()));
    let o = Command::new(program("hrg-board", "hrg-board"))
        .args(["serve", "--elf", "nowhere/firmware", "--folder"])
        .arg(&folder)
        .stdin(Stdio::null())
        .output()
        .expect("runs");
    let error = String::from_utf8_lossy(&o.stderr).into_owned();
    assert_eq!(o.status.code(), Some(2), "{error}");
    assert!(
        error.contains("nowhere/firmware") && error.contains("cargo xtask build") && error.contains("--elf"),
        "{error}"
    );
    assert!(!folder.exists());
}

#[test]
fn a_board_takes_no_calibration_of_another_unit_or_scale() {
    let d = std::env::temp_dir().join(format!("hrg-docs-fits-{}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a temporary folder");
    let run = |name: &str, program: &Path, arguments: &str| {
        let o = Command::new(program).current_dir(&d).args(arguments.split(' ')).output().expect("runs");
        (o.status.code(), format!("{name}: {}", String::from_utf8_lossy(&o.stderr)))
    };
    let (hrg, board) = (program("hrg-cal", "hrg"), program("hrg-board", "hrg-board"));
    for (unit, out) in [("1", "a.csv"), ("2", "b.csv")] {
        let (code, said) = run("hrg", &hrg, &format!("simulate --profile fast --unit {unit} --out {out}"));
        assert_eq!(code, Some(0), "{said}");
    }
    assert_eq!(run("hrg", &hrg, "fit a.csv --out a.toml").0, Some(0));
    assert_eq!(run("hrg", &hrg, "fit a.csv --scale-factor 0.01,0.01,0.01 --out scaled.toml").0, Some(0));
    let (code, said) = run("run", &board, "run --recording a.csv --calibration a.toml --seconds 3 --out c.csv");
    assert_eq!(code, Some(0), "{said}");
    let corrected = std::fs::read_to_string(d.join("c.csv")).expect("written");
    assert!(
        corrected.contains("# latitude_deg: 28.2") && corrected.contains("# scale_factor_dph_per_code: 0.008583069")
    );
    for (command, says) in [
        ("run --recording b.csv --calibration a.toml --out no.csv", "SIM-1"),
        ("serve --recording b.csv --calibration a.toml --folder no", "SIM-1"),
        ("run --recording a.csv --calibration scaled.toml --out no.csv", "0.01 0.01 0.01"),
    ] {
        let (code, said) = run(command, &board, command);
        assert!(code == Some(2) && said.contains(says), "{said}");
    }
    assert!(!d.join("no.csv").exists() && !d.join("no").exists());
}
