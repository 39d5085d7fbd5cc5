//! The bring-up of a bare board (docs/bring-up.md), and the comparison of a board with the virtual one.

use crate::{output, programs, root, run, seal, setup, Failure, Toolchain};
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The last line of the program begins with that.
const LAST: &str = "bring-up ends: ";
/// A board that says nothing more for so long will say nothing more.
const PATIENCE: Duration = Duration::from_secs(60);

/// Builds the program, in a folder of its own.
fn elf(t: &Toolchain) -> Result<PathBuf, Failure> {
    println!("building the bring-up program");
    let folder = root().join("target/bring-up");
    run(t
        .cargo("build")
        .args(["--quiet", "--profile", "firmware", "-p", "firmware", "--bin", "firmware", "--locked"])
        .args(["--features", "bring-up", "--target-dir"])
        .arg(&folder))?;
    let elf = folder.join(setup::TARGET).join("firmware/firmware");
    seal(&elf)?;
    Ok(elf)
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
fn probe() -> Result<(), Failure> {
    let list = output(Command::new("probe-rs").arg("list")).ok_or_else(|| {
        Failure(
            "no board can be reached, because probe-rs is not installed (cargo install probe-rs-tools --locked)".into(),
        )
    })?;
    if list.contains("No debug probes were found") || list.trim().is_empty() {
        return Err(Failure("no debug probe is connected: plug a NUCLEO-F446RE in by its USB port CN1".into()));
    }
    Ok(())
}

/// Flashes the program, shows its log, and gives it.
fn on_board(elf: &PathBuf) -> Result<Vec<String>, Failure> {
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
        let last = line.contains(LAST);
        log.push(line);
        if last {
            break;
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    Ok(log)
}

/// Whether a log says that all rows pass.
fn judge(log: &[String]) -> Result<(), Failure> {
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
fn rows(log: &[String]) -> Vec<(String, String)> {
    let row = |line: &String| {
        let (_, row) = line.split_once("row ")?;
        let (name, rest) = row.split_once(": reached ")?;
        Some((name.to_string(), rest.split(", expected").next()?.trim().to_string()))
    };
    log.iter().filter_map(row).collect()
}

/// `cargo xtask hil`: the same program on a board and on the virtual one, and what differs.
pub fn hil(arguments: &[String]) -> Result<(), Failure> {
    let only_virtual = match arguments {
        [] => false,
        [one] if one == "--virtual" => true,
        [other, ..] => return Err(Failure(format!("there is no option {other}"))),
    };
    if !only_virtual {
        probe()?;
    }
    let t = setup::toolchain()?;
    let elf = elf(&t)?;
    programs()?;
    println!("on the virtual board");
    let o = Command::new(root().join("target/release/hrg-board"))
        .args(["bring-up", "--elf"])
        .arg(&elf)
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Failure(e.to_string()))?;
    let simulated: Vec<String> = String::from_utf8_lossy(&o.stdout).lines().map(String::from).collect();
    simulated.iter().for_each(|line| println!("{line}"));
    judge(&simulated)?;
    if only_virtual {
        return Ok(());
    }
    println!("on the board");
    let measured = on_board(&elf)?;
    let (a, b) = (rows(&measured), rows(&simulated));
    let mut same = 0;
    for (name, reached) in &b {
        match a.iter().find(|(n, _)| n == name) {
            Some((_, board)) if board == reached => same += 1,
            Some((_, board)) => println!("differs: {name}: board {board}, virtual board {reached}"),
            None => println!("differs: {name}: the board did not print it; virtual board {reached}"),
        }
    }
    println!("{same} of {} rows are the same to the last digit", b.len());
    judge(&measured)
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
