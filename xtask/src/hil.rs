//! The tests for the chip on a board and on the virtual one, and what differs: hardware in the loop.

use crate::bring_up::{elf as bring_up_elf, judge, on_board, probe, probe_rs, rows};
use crate::{field, programs, root, setup, Failure, Toolchain};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Builds the tests for the chip (`firmware/tests/chip.rs`); their ELF has the same place always.
pub fn chip_tests(t: &Toolchain) -> Result<PathBuf, Failure> {
    println!("building the tests for the chip");
    let folder = root().join("target/variants");
    let failed = |e: std::io::Error| Failure(format!("the tests for the chip: {e}"));
    let built = t
        .cargo("build")
        .args(["--quiet", "--profile", "firmware", "-p", "firmware", "--test", "chip", "--locked"])
        .args(["--message-format", "json-render-diagnostics", "--target-dir"])
        .arg(&folder)
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(failed)?;
    let printed = String::from_utf8_lossy(&built.stdout);
    let executable = printed.lines().filter_map(chip_test).next_back();
    let Some(from) = executable.filter(|_| built.status.success()) else {
        return Err(Failure("the tests for the chip were not built".into()));
    };
    let to = root().join("target/chip/chip-tests.elf");
    to.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(failed)?;
    std::fs::copy(from, &to).map_err(failed)?;
    Ok(to)
}

/// The program of tests that a message of cargo says was built. (Cargo builds the package's other programs, too.)
fn chip_test(message: &str) -> Option<&str> {
    let path = field(message, "executable")?;
    Path::new(path).file_name()?.to_str()?.starts_with("chip-").then_some(path)
}

/// Output of `hrg-board` for an ELF; it fails where that does.
fn on_virtual(command: &str, elf: &Path) -> Result<Vec<String>, Failure> {
    let o = Command::new(root().join("target/release/hrg-board"))
        .args([command, "--elf"])
        .arg(elf)
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Failure(e.to_string()))?;
    let lines: Vec<String> = String::from_utf8_lossy(&o.stdout).lines().map(String::from).collect();
    lines.iter().for_each(|line| println!("{line}"));
    if o.status.success() {
        Ok(lines)
    } else {
        Err(Failure(format!("hrg-board {command} fails on the virtual board")))
    }
}

/// Tests of a log: name, how it ended.
fn outcomes(log: &[String]) -> Vec<(String, String)> {
    let outcome = |line: &String| {
        let (name, end) = line.trim().strip_prefix("test ")?.split_once(" ... ")?;
        Some((name.trim().to_string(), end.trim().to_string()))
    };
    log.iter().filter_map(outcome).collect()
}

/// Prints what differs between a board and the virtual one, and how many do not.
fn compare(what: &str, board: &[(String, String)], simulated: &[(String, String)]) {
    let mut same = 0;
    for (name, expected) in simulated {
        match board.iter().find(|(n, _)| n == name) {
            Some((_, found)) if found == expected => same += 1,
            Some((_, found)) => println!("differs: {name}: board {found}, virtual board {expected}"),
            None => println!("differs: {name}: the board did not print it; virtual board {expected}"),
        }
    }
    println!("{same} of {} {what}", simulated.len());
}

/// `cargo xtask hil`: the same programs on a board and on the virtual one, and what differs. The tests need no wires; the bring-up needs its
/// jumpers, and is left out where that is asked for.
pub fn hil(arguments: &[String]) -> Result<(), Failure> {
    let (mut only_virtual, mut jumpers) = (false, true);
    for argument in arguments {
        match argument.as_str() {
            "--virtual" => only_virtual = true,
            "--bare" => jumpers = false,
            other => return Err(Failure(format!("there is no option {other}: --virtual and --bare are all"))),
        }
    }
    if !only_virtual {
        probe()?;
    }
    let t = setup::toolchain()?;
    let tests = chip_tests(&t)?;
    let bring_up = if jumpers { Some(bring_up_elf(&t)?) } else { None };
    programs()?;
    println!("on the virtual board");
    let simulated = on_virtual("chip-tests", &tests)?;
    let table = bring_up.as_ref().map(|elf| on_virtual("bring-up", elf)).transpose()?;
    if only_virtual {
        return Ok(());
    }
    println!("on the board");
    let measured = probe_rs(&tests, |_| false)?;
    let (found, expected) = (outcomes(&measured), outcomes(&simulated));
    let measured = bring_up.as_deref().map(on_board).transpose()?;
    compare("tests end alike", &found, &expected);
    if let (Some(measured), Some(table)) = (&measured, &table) {
        compare("rows are the same to the last digit", &rows(measured), &rows(table));
        judge(measured)?;
    }
    let failed = expected.iter().filter(|(name, _)| !found.iter().any(|(n, end)| n == name && end == "ok")).count();
    if failed > 0 {
        return Err(Failure(format!("{failed} of {} tests fail on the board", expected.len())));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_are_found_in_what_libtest_and_probe_rs_print() {
        let log = [
            "running 2 tests",
            "test chip::tests::a ... ok",
            "test chip::tests::bc      ... FAILED",
            "test result: ok",
        ];
        let log = log.map(String::from);
        let pair = |a: &str, b: &str| (a.to_string(), b.to_string());
        assert_eq!(outcomes(&log), [pair("chip::tests::a", "ok"), pair("chip::tests::bc", "FAILED")]);
        let message = r#"{"reason":"compiler-artifact","executable":"/a/b/chip-1","fresh":true}"#;
        assert_eq!(chip_test(message), Some("/a/b/chip-1"));
        assert_eq!(chip_test(r#"{"executable":null}"#), None);
    }
}
