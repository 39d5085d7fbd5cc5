//! Commands of the pages: each that a page tells a user to type exists, with every option.

use host_tests::program;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

/// Commands of commands.
const GROUPS: [(&str, &str); 16] = [
    ("fit", "points"),
    ("fit", "soaks"),
    ("fit", "lag"),
    ("unit", "burn"),
    ("unit", "read"),
    ("unit", "events"),
    ("unit", "image"),
    ("unit", "keygen"),
    ("unit", "zero"),
    ("unit", "output"),
    ("unit", "test"),
    ("unit", "update"),
    ("unit", "pack"),
    ("align", "accelerometers"),
    ("align", "heading"),
    ("align", "simulate"),
];

/// Commands of a page: lines of code, and code within sentences, that begin with one of our programs.
fn commands(page: &str) -> Vec<String> {
    let spans = page.split('`').enumerate().filter(|(k, _)| k % 2 == 1).map(|(_, s)| s);
    let ours = |s: &str| s.starts_with("hrg ") || s.starts_with("hrg-board ") || s.starts_with("cargo xtask ");
    page.lines()
        .chain(spans)
        // Text that follows two blanks and a # is a remark.
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
    let programs = BTreeMap::from([("hrg", program("hrg")), ("hrg-board", program("hrg-board"))]);
    let mut helps: BTreeMap<String, String> = BTreeMap::new();
    let mut pages = vec![top.join("README.md")];
    pages.extend(std::fs::read_dir(top.join("docs")).expect("there").map(|e| e.expect("readable").path()));
    let mut checked = 0;
    // (docs/reference.md is printed from the programs' own help.)
    let written = |p: &Path| p.extension().is_some_and(|e| e == "md") && !p.ends_with("reference.md");
    for page in pages.iter().filter(|p| written(p)) {
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
            // A command of a command: `hrg unit burn`.
            let mut words = words.peekable();
            let nested = words.next_if(|w| GROUPS.contains(&(command, w.trim_end_matches(['`', ',', '.']))));
            let path: Vec<&str> = [Some(command), nested].into_iter().flatten().collect();
            let help = helps.entry(format!("{name} {path:?}")).or_insert_with(|| {
                let o = Command::new(&programs[name]).args(&path).arg("--help").output().expect("runs");
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

/// Pages of the project, by their paths from its folder.
fn pages(top: &Path) -> Vec<String> {
    let docs = std::fs::read_dir(top.join("docs")).expect("docs").map(|e| e.expect("readable").file_name());
    let docs = docs.map(|n| format!("docs/{}", n.to_string_lossy())).filter(|n| n.ends_with(".md"));
    let others =
        ["README.md", "CHANGELOG.md", "python/README.md", "hrg-core/README.md", "host-tests/foreign-plant/README.md"];
    docs.chain(others.map(String::from)).collect()
}

/// The name that a forge and mdBook give a heading as the target of a link.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn links_between_pages_lead_somewhere() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut checked = 0;
    for page in pages(&top) {
        let text = std::fs::read_to_string(top.join(&page)).expect("readable");
        let prose: Vec<&str> = text.split("\n```").step_by(2).collect();
        for link in prose.iter().flat_map(|p| p.split("](").skip(1)).filter_map(|rest| rest.split(')').next()) {
            if link.contains("://") || link.contains(char::is_whitespace) {
                continue;
            }
            let (file, target) = link.split_once('#').unwrap_or((link, ""));
            let at = top.join(&page);
            let at = if file.is_empty() { at } else { at.parent().expect("a folder").join(file) };
            // (docs/reference.md is printed for the book.)
            assert!(at.exists() || file == "reference.md", "{page}: the link {link} leads nowhere");
            if !target.is_empty() {
                let there = std::fs::read_to_string(&at).expect("a page");
                let headings = there.lines().filter(|l| l.starts_with('#')).map(|l| anchor(l.trim_start_matches('#')));
                assert!(headings.into_iter().any(|h| h == target), "{page}: {link}: no such heading");
            }
            checked += 1;
        }
    }
    assert!(checked > 100, "{checked}");
}

#[test]
fn the_book_has_every_page_once() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let summary = std::fs::read_to_string(top.join("docs/SUMMARY.md")).expect("docs/SUMMARY.md");
    for page in pages(&top) {
        let Some(name) = page.strip_prefix("docs/").filter(|n| *n != "SUMMARY.md") else { continue };
        assert_eq!(summary.matches(&format!("]({name})")).count(), 1, "docs/SUMMARY.md and {name}");
    }
}

/// The last line of a page that a command prints: the commit, and the short form of what the program computed.
fn stamp(text: &str) -> Option<(&str, Option<&str>)> {
    let line = text.lines().rev().find_map(|l| l.strip_prefix("<!-- printed by `")?.strip_suffix(" -->"))?;
    let (_, rest) = line.split_once("` at commit ")?;
    Some(rest.split_once(", short form ").map_or((rest, None), |(commit, form)| (commit, Some(form))))
}

/// A page whose figures come from traces is of a program that finds what this one finds; every page that a command prints names its commit.
#[test]
fn pages_that_a_command_prints_are_of_this_program() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let o = Command::new(program("hrg-study")).arg("short-form").output().expect("runs");
    let now = String::from_utf8_lossy(&o.stdout).trim().to_string();
    assert!(o.status.success() && now.len() == 8, "{now}: {}", String::from_utf8_lossy(&o.stderr));
    let git = |arguments: &[&str]| Command::new("git").args(arguments).current_dir(&top).output();
    let history = git(&["rev-parse", "--is-shallow-repository"]).is_ok_and(|o| o.stdout.starts_with(b"false"));
    let of_traces = ["demo", "foreign", "measured", "study"];
    let others = ["alignment-results", "bench", "controls", "methods-results", "promises", "trace-peers"];
    for name in of_traces.into_iter().chain(others) {
        let text = std::fs::read_to_string(top.join(format!("docs/{name}.md"))).expect("a page");
        let (commit, form) =
            stamp(&text).unwrap_or_else(|| panic!("docs/{name}.md does not say at which commit it was printed"));
        let known = || git(&["merge-base", "--is-ancestor", commit, "HEAD"]).is_ok_and(|o| o.status.success());
        assert!(!history || known(), "docs/{name}.md was printed at {commit}, which is no commit of this history");
        assert!(form.is_some() || others.contains(&name), "docs/{name}.md has no short form");
        assert!(
            form.is_none_or(|f| f == now),
            "docs/{name}.md was printed by a program that finds other things (short form {form:?}, now {now}): print it anew by the command in its last line"
        );
    }
}

#[test]
fn commands_that_a_page_shows_are_those_that_are_run() {
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let ours = ["hrg ", "hrg-board ", "hrg-study ", "cargo xtask "];
    for page in pages(&top).iter().filter(|p| *p != "docs/reference.md" && *p != "docs/demo.md") {
        let mut run = false;
        let mut fenced = false;
        for (n, line) in std::fs::read_to_string(top.join(page)).expect("readable").lines().enumerate() {
            if let Some(info) = line.trim_start().strip_prefix("```") {
                fenced = !fenced;
                run = fenced && info.starts_with("sh");
                continue;
            }
            let set_apart = fenced || line.starts_with("    ");
            let command = ours.iter().any(|o| line.trim_start().starts_with(o));
            assert!(
                run || !(set_apart && command),
                "{page}:{}: in a block fenced with sh, cargo xtask pages runs it",
                n + 1
            );
        }
    }
}

#[test]
fn a_board_without_a_firmware_says_how_to_build_one() {
    let folder = std::env::temp_dir().join(format!("hrg-docs-{}", std::process::id()));
    let o = Command::new(program("hrg-board"))
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
fn a_reader_that_has_had_enough_is_no_error() {
    let folder = std::env::temp_dir().join(format!("hrg-docs-pipe-{}", std::process::id()));
    let serve = format!("serve --seconds 1 --folder {}", folder.display());
    for (name, arguments) in [("hrg", "effects"), ("hrg-board", serve.as_str())] {
        // The reader is gone before the first line.
        let program = program(name);
        let script = format!("set -o pipefail; (sleep 0.3; exec {} {arguments}) | true", program.display());
        let o = Command::new("bash").args(["-c", &script]).output().expect("bash");
        assert!(o.status.success() && o.stderr.is_empty(), "{name}: {}", String::from_utf8_lossy(&o.stderr));
    }
    let _ = std::fs::remove_dir_all(&folder);
}

#[test]
fn a_board_takes_no_calibration_of_another_unit_or_scale() {
    let d = std::env::temp_dir().join(format!("hrg-docs-fits-{}", std::process::id()));
    std::fs::create_dir_all(&d).expect("a temporary folder");
    let run = |name: &str, program: &Path, arguments: &str| {
        let o = Command::new(program).current_dir(&d).args(arguments.split(' ')).output().expect("runs");
        (o.status.code(), format!("{name}: {}", String::from_utf8_lossy(&o.stderr)))
    };
    let (hrg, board) = (program("hrg"), program("hrg-board"));
    for (unit, out) in [("1", "a.csv"), ("2", "b.csv")] {
        let (code, message) = run("hrg", &hrg, &format!("simulate --profile fast --unit {unit} --out {out}"));
        assert_eq!(code, Some(0), "{message}");
    }
    assert_eq!(run("hrg", &hrg, "fit a.csv --out a.toml").0, Some(0));
    assert_eq!(run("hrg", &hrg, "fit a.csv --scale-factor 0.01,0.01,0.01 --out scaled.toml").0, Some(0));
    let (code, message) = run("run", &board, "run --recording a.csv --calibration a.toml --seconds 3 --out c.csv");
    assert_eq!(code, Some(0), "{message}");
    let corrected = std::fs::read_to_string(d.join("c.csv")).expect("written");
    assert!(
        corrected.contains("# latitude_deg: 28.2") && corrected.contains("# scale_factor_dph_per_code: 0.008583069")
    );
    for (command, says) in [
        ("run --recording b.csv --calibration a.toml --out no.csv", "SIM-1"),
        ("serve --recording b.csv --calibration a.toml --folder no", "SIM-1"),
        ("run --recording a.csv --calibration scaled.toml --out no.csv", "0.01 0.01 0.01"),
    ] {
        let (code, message) = run(command, &board, command);
        assert!(code == Some(2) && message.contains(says), "{message}");
    }
    assert!(!d.join("no.csv").exists() && !d.join("no").exists());
}
