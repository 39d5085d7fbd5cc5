//! Tests that are built for the chip (embedded-test) on the virtual board, as probe-rs runs them on a real one: each from a reset of its own, chosen by the
//! command line that the debugger gives.

use anyhow::{bail, Context, Result};
use hrg_data::log::Decoder;
use object::{Object, ObjectSection, ObjectSymbol};
use serde::Deserialize;
use virtual_board::{Board, Stop, World, CPU_HZ};

/// Section in which embedded-test puts its list; the name of each symbol in it is a description.
const SECTION: &str = ".embedded_test";
/// A test that says nothing of its time has so long, s; probe-rs gives as much.
const LONGEST_S: u64 = 60;

/// Description that a symbol's name gives of its test.
#[derive(Deserialize)]
struct Description {
    name: String,
    ignored: bool,
    should_panic: bool,
    #[serde(default)]
    timeout: Option<u64>,
}

/// A test of the ELF.
pub struct Test {
    /// Module and name.
    pub name: String,
    entry: u32,
    ignored: bool,
    should_panic: bool,
    seconds: u64,
}

/// End of a test.
#[derive(Debug, PartialEq, Eq)]
pub enum Outcome {
    /// As it should.
    Ok,
    /// Not as it should; why.
    Failed(String),
    /// It was not run.
    Ignored,
}

/// The tests of an ELF.
///
/// # Errors
/// If it holds none.
pub fn tests(elf: &[u8]) -> Result<Vec<Test>> {
    let file = object::File::parse(elf).context("it is no ELF")?;
    let section = file.section_by_name(SECTION).context("the ELF holds no tests (section .embedded_test)")?;
    let (data, start) = (section.data()?, section.address());
    let mut out = Vec::new();
    for symbol in file.symbols().filter(|s| s.section_index() == Some(section.index())) {
        let Some(description) = symbol.name().ok().and_then(|n| serde_json::from_str::<Description>(n).ok()) else {
            continue;
        };
        // The entry, then the module: address and length.
        let word = |k: u64| -> Option<u32> {
            let at = (symbol.address() - start + 4 * k) as usize;
            Some(u32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?))
        };
        let words = [word(0), word(1), word(2)];
        let [Some(entry), Some(module), Some(length)] = words else { bail!("{SECTION} is cut off") };
        let module = text(&file, module, length).unwrap_or_default();
        out.push(Test {
            name: format!("{module}::{}", description.name),
            entry,
            ignored: description.ignored,
            should_panic: description.should_panic,
            seconds: description.timeout.unwrap_or(LONGEST_S),
        });
    }
    if out.is_empty() {
        bail!("the ELF holds no tests ({SECTION} has no descriptions)");
    }
    out.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(out)
}

/// A text of the program.
fn text(file: &object::File<'_>, address: u32, length: u32) -> Option<String> {
    let (start, length) = (u64::from(address), u64::from(length));
    let bytes = file.sections().find_map(|s| s.data_range(start, length).ok().flatten())?;
    Some(String::from_utf8_lossy(bytes).into_owned())
}

/// Nothing on the wires; the log is read.
struct Log(Decoder, Vec<String>);

impl World for Log {
    fn next_edge(&mut self, _: usize) -> Option<u64> {
        None
    }
    fn convert(&mut self, _: u64) -> Option<[i32; 8]> {
        None
    }
    fn link_out(&mut self, _: u64, _: &[u8]) {}
    fn log_out(&mut self, _: u64, bytes: &[u8]) {
        self.1.extend(self.0.push(bytes));
    }
}

impl Test {
    /// Runs it from a reset; also what it has logged.
    ///
    /// # Errors
    /// If the ELF does not fit the board.
    pub fn run(&self, elf: &[u8]) -> Result<(Outcome, Vec<String>)> {
        if self.ignored {
            return Ok((Outcome::Ignored, Vec::new()));
        }
        let mut board = Board::new(elf, Log(Decoder::new(elf)?, Vec::new()))?;
        board.attach_debugger(&format!("run_addr {}", self.entry));
        let end = board.run_until(self.seconds * CPU_HZ);
        // Reads the lines that are still in the log's buffer.
        let _ = board.look_at_rtt();
        let ended = match end {
            Ok(Stop::Exit(code)) => Ok(code),
            Ok(Stop::Time) => Err(format!("it did not end within {} s", self.seconds)),
            Ok(other) => Err(format!("the chip was reset: {other:?}")),
            Err(e) => Err(e.to_string()),
        };
        let outcome = match ended {
            Ok(0) if self.should_panic => Outcome::Failed("it should have panicked".into()),
            Ok(0) => Outcome::Ok,
            Ok(_) if self.should_panic => Outcome::Ok,
            Ok(code) => Outcome::Failed(format!("exit code {code}")),
            Err(why) => Outcome::Failed(why),
        };
        Ok((outcome, std::mem::take(&mut board.world.1)))
    }
}

/// `hrg-board chip-tests`: prints what libtest would.
///
/// # Errors
/// If a test fails.
pub fn command(elf: &[u8]) -> Result<()> {
    let tests = tests(elf)?;
    println!("running {} tests", tests.len());
    let (mut passed, mut failed, mut ignored) = (0, 0, 0);
    for test in &tests {
        let (outcome, log) = test.run(elf)?;
        let printed = match &outcome {
            Outcome::Ok => "ok".to_string(),
            Outcome::Ignored => "ignored".to_string(),
            Outcome::Failed(_) => "FAILED".to_string(),
        };
        println!("test {} ... {printed}", test.name);
        match outcome {
            Outcome::Ok => passed += 1,
            Outcome::Ignored => ignored += 1,
            Outcome::Failed(why) => {
                failed += 1;
                log.iter().for_each(|line| println!("    {line}"));
                println!("    {why}");
            }
        }
    }
    let word = if failed == 0 { "ok" } else { "FAILED" };
    println!("test result: {word}. {passed} passed; {failed} failed; {ignored} ignored");
    if failed > 0 {
        bail!("{failed} of {} tests on the chip fail", tests.len());
    }
    Ok(())
}
