//! `cargo xtask test`: what is built for a chip and what for this machine are built side by side; then all tests run, two programs at a time.

use crate::{
    bring_up, cargo, field, hil, library, other_chip, programs, python, reference, root, run, sensors, setup, signed,
    size,
};
use crate::{Failure, Toolchain};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

const HOST_PACKAGES: [&str; 14] = [
    "hrg-core",
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

/// Programs that run at once. (Some use two processors by themselves.)
const AT_ONCE: usize = 2;

/// Tests that take longest, the longest first: they begin before the others, so that none is left alone at the end.
const LONGEST: [&str; 10] =
    ["faults", "rates", "hrg_cal", "elf", "python", "measured", "wu2023", "bring_up", "day", "pages"];

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
        let told: Vec<String> = took.iter().filter(|t| t.1 > 0).map(|(name, s)| format!("{name} {s} s")).collect();
        println!("time (chip and host were built side by side): {}; in all {in_all} s", told.join(", "));
    }
}

/// `cargo xtask test`.
pub fn test() -> Result<(), Failure> {
    let begun = Instant::now();
    let course = Course::default();
    let t = course.step("set-up", || setup::toolchain().and_then(|t| setup::host().map(|()| t)))?;
    course.step("format", || run(&mut cargo(&["fmt", "--all", "--check"])))?;
    let (programs, python) = std::thread::scope(|scope| {
        let target = scope.spawn(|| for_chips(&course, &t));
        let host = for_host(&course);
        let target = target.join().unwrap_or_else(|_| Err(Failure("the build for the chips panicked".into())));
        Ok((host?, target?))
    })?;
    if python.is_none() {
        course.step("the Python package", python::install)?;
    }
    course.step("the reference", || reference::write(&["--check".to_string()]))?;
    let sum = course.step("tests", || Ok(all_of(works(programs, python)?)))?;
    course.print(begun.elapsed().as_secs());
    println!("{} passed, {} failed, {} of the passed skipped", sum.passed, sum.failed, sum.skipped.len());
    sum.skipped.iter().for_each(|s| println!("{s}"));
    if sum.failed == 0 && sum.passed > 0 {
        Ok(())
    } else {
        Err(Failure("tests failed".into()))
    }
}

/// Builds for the chips, and in folders of their own; gives why the Python package cannot be tested, if it cannot.
fn for_chips(course: &Course, t: &Toolchain) -> Result<Option<String>, Failure> {
    course.step("the firmware", size)?;
    course.step("the second chip", || other_chip(t))?;
    course.step("the firmware that wants signed calibrations", || signed(t))?;
    course.step("the firmware with temperature sensors", || sensors(t))?;
    course.step("the bring-up program", bring_up::build)?;
    course.step("the tests for the chip", || hil::chip_tests(t).map(drop))?;
    course.step("hrg-core in a firmware of another kind", || library::example(t))?;
    course.step("lints, target", || {
        for what in [&["--features", ""][..], &["--features", "bring-up"], &["--test", "chip"]] {
            let lint = ["--quiet", "--profile", "firmware", "-p", "firmware", "--locked"];
            run(t.cargo("clippy").args(lint).args(what).args(["--", "-D", "warnings"]))?;
        }
        Ok(())
    })?;
    course.step("hrg-core as it would be published", library::package)?;
    course.step("the table of the second chip", || {
        // (In a folder of its own: one build of stm32-metapac knows one chip.)
        run(cargo(&["test", "--quiet", "--release", "--locked", "-p", "chip-tables", "--no-default-features"]).args([
            "--features",
            "stm32f405rg",
            "--target-dir",
            "target/chip-tables",
        ]))
    })?;
    course.step("what the Python package needs", || Ok(python::prepare().err()))
}

/// Runs lints and builds for the host; gives the test programs.
fn for_host(course: &Course) -> Result<Vec<Program>, Failure> {
    let packages: Vec<&str> = HOST_PACKAGES.iter().flat_map(|p| ["-p", p]).collect();
    course.step("lints, host", || {
        run(cargo(&["clippy", "--quiet", "--release", "--locked", "--all-targets"]).args(&packages).args([
            "-p",
            "hrg-python",
            "--",
            "-D",
            "warnings",
        ]))
    })?;
    course.step("documentation", || {
        run(cargo(&["doc", "--quiet", "--release", "--locked", "--no-deps"])
            .args(&packages)
            .env("RUSTDOCFLAGS", "-D warnings"))
    })?;
    course.step("programs", programs)?;
    course.step("test programs", || test_programs(&packages))
}

/// A test program of cargo's.
struct Program {
    name: String,
    path: PathBuf,
    /// The folder of its package.
    folder: PathBuf,
}

/// Builds all test programs, and the programs of the packages beside them.
fn test_programs(packages: &[&str]) -> Result<Vec<Program>, Failure> {
    let built = cargo(&["test", "--release", "--locked", "--no-run", "--message-format", "json-render-diagnostics"])
        .args(packages)
        .current_dir(root())
        .stderr(Stdio::inherit())
        .output()
        .map_err(|e| Failure(format!("cargo test --no-run: {e}")))?;
    let programs: Vec<Program> = String::from_utf8_lossy(&built.stdout).lines().filter_map(program).collect();
    if built.status.success() && !programs.is_empty() {
        Ok(programs)
    } else {
        Err(Failure("the tests were not built".into()))
    }
}

/// The test program that a message of cargo's names.
fn program(message: &str) -> Option<Program> {
    let is_test =
        message.contains("\"reason\":\"compiler-artifact\"") && message.contains("\"test\":true},\"features\"");
    let path = PathBuf::from(field(message, "executable").filter(|_| is_test)?);
    let folder = Path::new(field(message, "manifest_path")?).parent()?.to_path_buf();
    let file = path.file_name()?.to_str()?;
    Some(Program { name: file.rsplit_once('-').map_or(file, |(name, _)| name).to_string(), path, folder })
}

/// Something that runs, and ends with lines as `test result: ok. 3 passed; 0 failed` prints them.
struct Work {
    name: String,
    command: Command,
}

/// This program again, with other arguments.
fn myself(arguments: &[&str]) -> Result<Command, Failure> {
    let mut c = Command::new(std::env::current_exe().map_err(|e| Failure(e.to_string()))?);
    c.args(arguments).current_dir(root());
    Ok(c)
}

/// Everything that is to run, the longest first.
fn works(programs: Vec<Program>, python: Option<String>) -> Result<Vec<Work>, Failure> {
    let mut all: Vec<Work> = Vec::new();
    for p in programs {
        let mut command = Command::new(p.path);
        command.current_dir(&p.folder).env("CARGO_MANIFEST_DIR", &p.folder);
        all.push(Work { name: p.name, command });
    }
    let mut documentation = cargo(&["test", "--quiet", "--release", "--locked", "--doc"]);
    documentation.args(HOST_PACKAGES.iter().flat_map(|p| ["-p", p])).current_dir(root());
    all.push(Work { name: "examples of the documentation".into(), command: documentation });
    all.push(Work { name: "pages".into(), command: myself(&["pages", crate::pages::BUILT])? });
    match python {
        None => all.push(Work { name: "python".into(), command: myself(&["python"])? }),
        Some(why) => {
            let mut say = Command::new("echo");
            say.arg(why);
            all.push(Work { name: "python".into(), command: say });
        }
    }
    all.sort_by_key(|w| LONGEST.iter().position(|name| *name == w.name).unwrap_or(LONGEST.len()));
    Ok(all)
}

/// Results of tests.
#[derive(Default, Debug, PartialEq)]
struct Sum {
    passed: u64,
    failed: u64,
    /// Tests that need what is not there (a network, Python): a line of each.
    skipped: Vec<String>,
}

impl Sum {
    fn add(&mut self, said: &str) {
        for line in said.lines() {
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
    }
}

/// Runs everything, some at once; prints what each says when it has ended.
fn all_of(works: Vec<Work>) -> Sum {
    let queue = Mutex::new(works.into_iter());
    let sum = Mutex::new(Sum::default());
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                loop {
                    // (The lock is given back before the work.)
                    let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some(Work { name, mut command }) = next else { break };
                    let begun = Instant::now();
                    let ended = command.stdin(Stdio::null()).output();
                    let mut sum = sum.lock().unwrap_or_else(PoisonError::into_inner);
                    println!("\n{name}, {} s", begun.elapsed().as_secs());
                    match ended {
                        Ok(o) => {
                            let said = String::from_utf8_lossy(&o.stdout);
                            print!("{said}{}", String::from_utf8_lossy(&o.stderr));
                            let before = sum.failed;
                            sum.add(&said);
                            if !o.status.success() && sum.failed == before {
                                println!("{name} ended with {}", o.status);
                                sum.failed += 1;
                            }
                        }
                        Err(e) => {
                            println!("{name} could not be started: {e}");
                            sum.failed += 1;
                        }
                    }
                }
            });
        }
    });
    sum.into_inner().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summaries_are_added() {
        let mut sum = Sum::default();
        sum.add(
            "test a ... ok\ntest result: ok. 12 passed; 0 failed; 1 ignored; finished in 0.1s\nskipped: no network\n",
        );
        sum.add("test result: FAILED. 3 passed; 2 failed; 0 ignored\n");
        assert_eq!(sum, Sum { passed: 15, failed: 2, skipped: vec!["skipped: no network".into()] });
    }

    #[test]
    fn what_fails_without_a_summary_is_a_failure() {
        let mut works = Vec::new();
        for (name, script) in [
            ("good", "echo 'test result: ok. 2 passed; 0 failed'"),
            ("bad", "echo 'test result: FAILED. 1 passed; 3 failed'; exit 101"),
            ("silent", "exit 3"),
        ] {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            works.push(Work { name: name.into(), command });
        }
        works.push(Work { name: "missing".into(), command: Command::new("no-such-program-of-the-tests") });
        let sum = all_of(works);
        assert_eq!((sum.passed, sum.failed), (3, 5));
    }

    #[test]
    fn test_programs_are_found_in_what_cargo_says() {
        let message = |test: &str, executable: &str| {
            format!(
                "{{\"reason\":\"compiler-artifact\",\"manifest_path\":\"/p/host-tests/Cargo.toml\",\"profile\":{{\"test\":{test}}},\"features\":[],\"executable\":{executable}}}"
            )
        };
        let found = program(&message("true", "\"/t/deps/day-12ab\"")).expect("a program");
        assert_eq!((found.name.as_str(), found.folder), ("day", PathBuf::from("/p/host-tests")));
        assert!(program(&message("false", "\"/t/hrg\"")).is_none());
        assert!(program(&message("true", "null")).is_none());
    }
}
