//! The bring-up of a bare board (docs/bring-up.md).

use crate::{output, programs, root, run, setup, variant, Failure, Toolchain};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The last line of the program begins with that.
const LAST: &str = "bring-up ends: ";
/// A board that says nothing more for so long will say nothing more.
const PATIENCE: Duration = Duration::from_secs(60);

/// Builds the program.
pub fn elf(t: &Toolchain) -> Result<PathBuf, Failure> {
    println!("building the bring-up program");
    variant(t, "bring-up", |c| c.args(["--features", "bring-up"]))
}

/// `cargo xtask bring-up`.
pub fn bring_up(arguments: &[String]) -> Result<(), Failure> {
    let (on_virtual, rest): (Vec<&String>, Vec<&String>) = arguments.iter().partition(|a| *a == "--virtual");
    if on_virtual.is_empty() && !rest.is_empty() {
        return Err(Failure(format!("{} goes with --virtual only", rest[0])));
    }
    if on_virtual.is_empty() {
        probe()?;
    }
    let t = setup::toolchain()?;
    let elf = elf(&t)?;
    if on_virtual.is_empty() {
        return judge(&on_board(&elf)?);
    }
    programs()?;
    run(Command::new(root().join("target/release/hrg-board")).args(["bring-up", "--elf"]).arg(&elf).args(rest))
}

/// Only builds it: `cargo xtask size --bring-up`, and for the tests.
pub fn build() -> Result<(), Failure> {
    setup::toolchain().and_then(|t| elf(&t)).map(drop)
}

/// That a probe is there.
pub fn probe() -> Result<(), Failure> {
    let list = output(Command::new("probe-rs").arg("list")).ok_or_else(|| {
        Failure(
            "no board can be reached, because probe-rs is not installed (cargo install probe-rs-tools --locked)".into(),
        )
    })?;
    if list.contains("No debug probes were found") || list.trim().is_empty() {
        return Err(Failure("no debug probe is seen: plug a NUCLEO-F446RE in by its USB port CN1; if it is plugged in, Linux needs the udev rules of https://probe.rs/docs/getting-started/probe-setup (docs/bring-up.md, step 0)".into()));
    }
    Ok(())
}

/// Flashes the program, shows its log up to its last line, and gives it.
pub fn on_board(elf: &Path) -> Result<Vec<String>, Failure> {
    probe_rs(elf, |line| line.contains(LAST))
}

/// Flashes a program, shows what probe-rs prints until that ends, or to a last line, and gives it.
pub fn probe_rs(elf: &Path, last: impl Fn(&str) -> bool) -> Result<Vec<String>, Failure> {
    let mut child = Command::new("probe-rs")
        .args(["run", "--chip", "STM32F446RETx"])
        .arg(elf)
        .current_dir(root())
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|e| Failure(format!("probe-rs could not be started: {e}")))?;
    let (sender, lines) = std::sync::mpsc::channel();
    if let Some(stdout) = child.stdout.take() {
        std::thread::spawn(move || {
            BufReader::new(stdout).lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
    }
    let mut log = Vec::new();
    let mut until = Instant::now() + PATIENCE;
    while let Ok(line) = lines.recv_timeout(until.saturating_duration_since(Instant::now())) {
        println!("{line}");
        until = Instant::now() + PATIENCE;
        log.push(line);
        if log.last().is_some_and(|line| last(line)) {
            break;
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    Ok(log)
}

/// Checks that a log reports all rows as passed.
pub fn judge(log: &[String]) -> Result<(), Failure> {
    let last = log.iter().find_map(|l| l.split_once(LAST));
    let Some((_, sum)) = last else {
        return Err(Failure("the program did not come to its end: docs/bring-up.md says what each line means".into()));
    };
    let (passed, rest) = sum.split_once(" of ").unwrap_or_default();
    if passed == rest.split_whitespace().next().unwrap_or("?") {
        Ok(())
    } else {
        Err(Failure("not every row passes: docs/bring-up.md says what each means".into()))
    }
}

/// Rows of a log: name, what was reached.
pub fn rows(log: &[String]) -> Vec<(String, String)> {
    let row = |line: &String| {
        let (_, row) = line.split_once("row ")?;
        let (name, rest) = row.split_once(": reached ")?;
        Some((name.to_string(), rest.split(", expected").next()?.trim().to_string()))
    };
    log.iter().filter_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_the_last_line_are_found() {
        let line = |s: &str| s.to_string();
        let log = [
            line("INFO  row wave x (PB9-PA0): frequency: reached 4900.1 Hz, expected 4900.1 Hz (1 to 2): pass"),
            line("INFO  bring-up ends: 1 of 2 rows pass; send in"),
        ];
        assert_eq!(rows(&log), [(line("wave x (PB9-PA0): frequency"), line("4900.1 Hz"))]);
        assert!(judge(&log).is_err() && judge(&log[..1]).is_err());
        assert!(judge(&[line("bring-up ends: 2 of 2 rows pass")]).is_ok());
    }
}
