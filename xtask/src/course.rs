//! `cargo xtask test`: what every change needs, in minutes; `cargo xtask test --rest`: parts that are slow and seldom break. Builds for a chip
//! and for this machine run side by side. Tests are run by `cargo test`, each crate's in one program; tests that need more than the first
//! command builds are ignored there.

use crate::{
    bench_unit, bring_up, cargo, hil, library, minimal, other_chip, python, reference, root, run, setup, signed, size,
    slot_b, with_feature, without,
};
use crate::{Failure, Toolchain};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

const HOST_PACKAGES: [&str; 15] = [
    "hrg-core",
    "hrg-align",
    "hrg-data",
    "hrg-identify",
    "hrg-simulate",
    "hrg-align-tools",
    "hrg-papers",
    "hrg",
    "hrg-study",
    "virtual-board",
    "hrg-board",
    "chip-tables",
    "host-tests",
    "foreign-plant",
    "xtask",
];

/// The steps of the course and how long each took.
#[derive(Default)]
struct Course {
    took: Mutex<Vec<(String, u64)>>,
}

impl Course {
    fn step<T>(&self, name: &str, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
        println!("{name}");
        let begun = Instant::now();
        let done = work();
        let mut took = self.took.lock().unwrap_or_else(PoisonError::into_inner);
        took.push((name.to_string(), begun.elapsed().as_secs()));
        done
    }

    /// Prints the time of each step.
    fn print(&self, in_all: u64) {
        let took = self.took.lock().unwrap_or_else(PoisonError::into_inner);
        let steps: Vec<String> = took.iter().filter(|t| t.1 > 0).map(|(name, s)| format!("{name} {s} s")).collect();
        println!("time (chip and host were built side by side): {}; in all {in_all} s", steps.join(", "));
    }
}

/// `-p PACKAGE` for each package of this machine.
fn packages() -> impl Iterator<Item = &'static str> {
    HOST_PACKAGES.iter().flat_map(|p| ["-p", p])
}

/// `cargo xtask test`.
pub fn test(arguments: &[String]) -> Result<(), Failure> {
    let rest = match arguments {
        [] => false,
        [one] if one == "--rest" => true,
        _ => return Err(Failure("cargo xtask test takes --rest, or nothing".into())),
    };
    let begun = Instant::now();
    let course = Course::default();
    let t = course.step("set-up", || setup::toolchain().and_then(|t| setup::host().map(|()| t)))?;
    let sum = if rest { the_rest(&course, &t)? } else { first(&course, &t)? };
    course.print(begun.elapsed().as_secs());
    println!("{} passed, {} failed, {} of the passed skipped", sum.passed, sum.failed, sum.skipped.len());
    sum.skipped.iter().for_each(|s| println!("{s}"));
    if sum.failed == 0 && sum.passed > 0 {
        Ok(())
    } else {
        Err(Failure("tests failed".into()))
    }
}

/// Format, lints, documentation, the firmware, and all tests but those that are ignored.
fn first(course: &Course, t: &Toolchain) -> Result<Sum, Failure> {
    course.step("format", || run(&mut cargo(&["fmt", "--all", "--check"])))?;
    course.step("status bits in the pages", reference::check)?;
    side_by_side(
        || {
            course.step("the firmware", size)?;
            course.step("the firmware for slot B", || slot_b(t))?;
            course.step("programs that count instructions", || bench_unit(t))?;
            course.step("lints, target", || lint_target(t, &["--features", ""]))?;
            course.step("lints, the loader", || {
                run(t.cargo("clippy").args(["--quiet", "-p", "loader", "--locked", "--", "-D", "warnings"]))
            })?;
            course.step("lints, target, the smallest", || {
                lint_target(t, &["--no-default-features", "--features", "stm32f446re"])
            })
        },
        || {
            course.step("lints, host", || {
                run(cargo(&["clippy", "--quiet", "--release", "--locked", "--all-targets"])
                    .args(packages())
                    .args(["--", "-D", "warnings"]))
            })?;
            course.step("documentation", || {
                run(cargo(&["doc", "--quiet", "--release", "--locked", "--no-deps"])
                    .args(packages())
                    .env("RUSTDOCFLAGS", "-D warnings"))
            })?;
            course.step("programs and tests", build_all)
        },
    )?;
    course.step("tests", || Sum::of(&mut tests(&["--no-fail-fast"])))
}

/// Other chips, other features, the wheel, the pages, and the tests that the first command ignores.
fn the_rest(course: &Course, t: &Toolchain) -> Result<Sum, Failure> {
    let mut no_python = None;
    course.step("the browser", setup::browser)?;
    side_by_side(
        || {
            course.step("the firmware", size)?;
            course.step("the firmware that wants signed calibrations", || signed(t))?;
            course.step("the smallest firmware", || minimal(t))?;
            course.step("the firmware with temperature sensors", || with_feature(t, "sensors"))?;
            course.step("the firmware with inputs at the ADC", || with_feature(t, "aux"))?;
            course.step("the firmware that speaks MAVLink", || with_feature(t, "mavlink"))?;
            course.step("the second chip", || other_chip(t))?;
            course.step("the firmware without each part", || without(t))?;
            course.step("the bring-up program", bring_up::build)?;
            course.step("the tests for the chip", || hil::chip_tests(t).map(drop))?;
            course.step("hrg-core in a firmware of another kind", || library::example(t))?;
            course.step("lints, target", || {
                lint_target(t, &["--features", "bring-up"])?;
                lint_target(t, &["--features", "mavlink"])?;
                lint_target(t, &["--test", "chip"])
            })?;
            course.step("hrg-core as it would be published", library::package)?;
            course.step("what the Python package needs", || {
                no_python = python::prepare().err();
                Ok(())
            })
        },
        || course.step("programs and tests", build_all),
    )?;
    let mut sum = course.step("tests", || Sum::of(&mut tests(&["--no-fail-fast", "--", "--ignored"])))?;
    course.step("examples of the documentation", || {
        sum.join(Sum::of(cargo(&["test", "--release", "--locked", "--doc", "--no-fail-fast"]).args(packages()))?);
        Ok(())
    })?;
    course.step("the table of the second chip", || {
        // (In a folder of its own: one build of stm32-metapac knows one chip.)
        let mut test = cargo(&["test", "--release", "--locked", "-p", "chip-tables", "--no-default-features"]);
        test.args(["--features", "stm32f405rg", "--target-dir", "target/chip-tables"]);
        sum.join(Sum::of(&mut test)?);
        Ok(())
    })?;
    course.step("the reference", reference::write)?;
    course.step("pages", || {
        sum.join(Sum::of(&mut myself(&["pages", crate::pages::BUILT])?)?);
        Ok(())
    })?;
    match no_python {
        Some(why) => sum.skipped.push(why),
        None => course.step("the Python package", || {
            run(&mut cargo(&[
                "clippy",
                "--quiet",
                "--release",
                "--locked",
                "-p",
                "hrg-python",
                "--",
                "-D",
                "warnings",
            ]))?;
            python::install()?;
            sum.join(Sum::of(&mut myself(&["python"])?)?);
            Ok(())
        })?,
    }
    Ok(sum)
}

fn lint_target(t: &Toolchain, of: &[&str]) -> Result<(), Failure> {
    let lint = ["--quiet", "--profile", "firmware", "-p", "firmware", "--locked"];
    run(t.cargo("clippy").args(lint).args(of).args(["--", "-D", "warnings"]))
}

/// Two works at once.
fn side_by_side(
    chips: impl FnOnce() -> Result<(), Failure> + Send,
    host: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    std::thread::scope(|scope| {
        let chips = scope.spawn(chips);
        let host = host();
        let chips = chips.join().unwrap_or_else(|_| Err(Failure("the build for the chips panicked".into())));
        host.and(chips)
    })
}

/// Builds programs and tests at once: so no processor waits for the other.
fn build_all() -> Result<(), Failure> {
    let mut build = cargo(&["build", "--quiet", "--release", "--locked", "--lib", "--bins", "--tests"]);
    run(build.args(packages()))
}

/// `cargo test` of the packages of this machine.
fn tests(arguments: &[&str]) -> Command {
    let (of_cargo, of_tests) = match arguments.iter().position(|a| *a == "--") {
        Some(at) => arguments.split_at(at),
        None => (arguments, &[][..]),
    };
    let mut c = cargo(&["test", "--release", "--locked", "--lib", "--bins", "--tests"]);
    c.args(packages()).args(of_cargo).args(of_tests);
    c
}

/// This program again, with other arguments.
fn myself(arguments: &[&str]) -> Result<Command, Failure> {
    let mut c = Command::new(std::env::current_exe().map_err(|e| Failure(e.to_string()))?);
    c.args(arguments);
    Ok(c)
}

/// Counts of tests.
#[derive(Default, Debug, PartialEq)]
struct Sum {
    passed: u64,
    failed: u64,
    /// Tests that need what is not there (a network, Python): a line of each.
    skipped: Vec<String>,
}

impl Sum {
    /// Runs a command and counts the tests in its output, which is printed as it comes. A command that fails without a failed test counts as
    /// one.
    fn of(command: &mut Command) -> Result<Self, Failure> {
        let shown = format!("{command:?}");
        let child = command.current_dir(root()).stdin(Stdio::null()).stdout(Stdio::piped()).spawn();
        let mut child = child.map_err(|e| Failure(format!("{shown}: {e}")))?;
        let mut sum = Self::default();
        if let Some(out) = child.stdout.take() {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                println!("{line}");
                sum.add(&line);
            }
        }
        let ended = child.wait().map_err(|e| Failure(e.to_string()))?;
        if !ended.success() && sum.failed == 0 {
            println!("ended with {ended}");
            sum.failed = 1;
        }
        Ok(sum)
    }

    fn add(&mut self, line: &str) {
        if let Some(at) = line.find("skipped: ") {
            self.skipped.push(line[at..].to_string());
        }
        if let Some(summary) = line.strip_prefix("test result: ") {
            let count = |word: &str| -> u64 {
                let parts = summary.split([';', '.']);
                parts.filter_map(|part| part.trim().strip_suffix(word)?.trim().parse().ok()).next().unwrap_or(0)
            };
            self.passed += count("passed");
            self.failed += count("failed");
        }
    }

    fn join(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.skipped.extend(other.skipped);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_are_added() {
        let mut sum = Sum::default();
        for line in [
            "test a ... ok",
            "test result: ok. 12 passed; 0 failed; 1 ignored; finished in 0.1s",
            "skipped: no network",
            "test result: FAILED. 3 passed; 2 failed; 0 ignored",
        ] {
            sum.add(line);
        }
        assert_eq!(sum, Sum { passed: 15, failed: 2, skipped: vec!["skipped: no network".into()] });
    }

    #[test]
    fn what_fails_without_a_summary_is_a_failure() {
        for (script, passed, failed) in [
            ("echo 'test result: ok. 2 passed; 0 failed'", 2, 0),
            ("echo 'test result: FAILED. 1 passed; 3 failed'; exit 101", 1, 3),
            ("exit 3", 0, 1),
        ] {
            let sum = Sum::of(Command::new("sh").args(["-c", script])).expect("runs");
            assert_eq!((sum.passed, sum.failed), (passed, failed), "{script}");
        }
        assert!(Sum::of(&mut Command::new("no-such-program-of-the-tests")).is_err());
    }
}
