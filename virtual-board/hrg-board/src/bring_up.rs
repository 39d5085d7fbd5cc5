//! The bring-up program (docs/bring-up.md) on the virtual board, with the jumpers of that page.

use anyhow::{bail, Context, Result};
use hrg_data::log::Decoder;
use std::path::Path;
use virtual_board::tables::Pin;
use virtual_board::{Board, Jumper, Stop, World, CPU_HZ};

/// The jumpers: from, to.
pub const JUMPERS: [(&str, &str); 12] = [
    ("PB9", "PA0"),
    ("PA8", "PA1"),
    ("PB14", "PB10"),
    ("PC9", "PB2"),
    ("PB6", "PB12"),
    ("PA5", "PB13"),
    ("PA7", "PC3"),
    ("PC2", "PA6"),
    ("PC7", "PC0"),
    ("PA9", "PD2"),
    ("PC12", "PA10"),
    ("PB8", "PC6"),
];

/// The last line of the program begins with that.
const LAST: &str = "bring-up ends: ";
/// It comes within so many seconds.
const LONGEST_S: u64 = 60;
/// LSI of this board, Hz: none whose periods are whole counts of a timer.
const LSI_HZ: u64 = 31_640;
/// The sector whose erase it measures lies here; what must be empty for it.
const LOG_SECTOR_START: u32 = 0x8000;

/// A row of the table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Its name, which names its jumpers.
    pub name: String,
    /// Measured figure; not a number: it was not measured.
    pub reached: f32,
    /// It passes.
    pub pass: bool,
}

/// Report of the program.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Its log.
    pub log: Vec<String>,
    /// Time at which it came to its end, s.
    pub ended_s: Option<f64>,
}

impl Outcome {
    /// The rows of its table.
    #[must_use]
    pub fn rows(&self) -> Vec<Row> {
        self.log.iter().filter_map(|line| row(line)).collect()
    }
}

/// The row that a line of the log is.
fn row(line: &str) -> Option<Row> {
    let (_, row) = line.split_once("row ")?;
    let (name, rest) = row.split_once(": reached ")?;
    let reached = rest.split_whitespace().next()?.parse().ok()?;
    Some(Row { name: name.into(), reached, pass: rest.ends_with(": pass") })
}

/// Nothing on the wires but the jumpers; the log is read.
struct Log {
    decoder: Decoder,
    lines: Vec<(u64, String)>,
}

impl World for Log {
    fn next_edge(&mut self, _: usize) -> Option<u64> {
        None
    }
    fn convert(&mut self, _: u64) -> Option<[i32; 8]> {
        None
    }
    fn link_out(&mut self, _: u64, _: &[u8]) {}
    fn log_out(&mut self, cycles: u64, bytes: &[u8]) {
        self.lines.extend(self.decoder.push(bytes).into_iter().map(|line| (cycles, line)));
    }
}

/// The jumpers, without those that are named (`PB9-PA0`).
///
/// # Errors
/// If there is no jumper of that name.
pub fn jumpers(without: &[&str]) -> Result<Vec<Jumper>> {
    let known = JUMPERS.map(|(from, to)| format!("{from}-{to}"));
    if let Some(gone) = without.iter().find(|gone| !known.iter().any(|j| j == *gone)) {
        bail!("there is no jumper {gone}: they are {}", known.join(", "));
    }
    let pin = |name: &str| Pin::parse(name).with_context(|| format!("{name} is no pin"));
    JUMPERS
        .into_iter()
        .zip(&known)
        .filter(|(_, name)| !without.contains(&name.as_str()))
        .map(|((from, to), _)| Ok(Jumper { from: pin(from)?, to: pin(to)? }))
        .collect()
}

/// Runs the program to its end. `shown` is told each line as it comes; cycles are estimated where it is asked for, and counted by instructions
/// otherwise.
///
/// # Errors
/// If the program does something that the board does not model, or does not come to its end.
pub fn run(elf: &[u8], jumpers: &[Jumper], estimate: bool, mut shown: impl FnMut(&str)) -> Result<Outcome> {
    let mut board = Board::new(elf, Log { decoder: Decoder::new(elf)?, lines: Vec::new() })?;
    board.join(jumpers)?;
    board.set_lsi(LSI_HZ);
    if estimate {
        board.start_estimate();
    }
    let erased = vec![0xFF; 0x4000];
    board.write_flash(LOG_SECTOR_START, &erased)?;
    let mut out = Outcome::default();
    for tenth in 1..=10 * LONGEST_S {
        let stop = board.run_until(tenth * CPU_HZ / 10)?;
        for (at, line) in board.world.lines.drain(..) {
            shown(&line);
            if line.contains(LAST) {
                out.ended_s = Some(at as f64 / CPU_HZ as f64);
            }
            out.log.push(line);
        }
        if out.ended_s.is_some() {
            return Ok(out);
        }
        if stop != Stop::Time {
            bail!("the unit was reset: {stop:?}");
        }
    }
    bail!("the program did not come to its end within {LONGEST_S} s")
}

/// Puts the lines of a log into a page, each in the place of the line that begins as it does, up to its first number.
fn show(page: &Path, log: &[String]) -> Result<()> {
    let key = |line: &str| match line.trim().split_once(": reached ") {
        Some((name, _)) => name.to_string(),
        None => line.trim().split(char::is_numeric).next().unwrap_or("").to_string(),
    };
    let text = std::fs::read_to_string(page).with_context(|| format!("cannot read {}", page.display()))?;
    let new = text.lines().map(|line| {
        let printed = line.starts_with("    INFO ").then(|| log.iter().find(|l| key(l) == key(line))).flatten();
        printed.map_or_else(|| line.to_string(), |l| format!("    {}", l.trim_end()))
    });
    hrg_data::output::write_file(page, (new.collect::<Vec<_>>().join("\n") + "\n").as_bytes())
}

/// `hrg-board bring-up`.
///
/// # Errors
/// As [`run`]; and where a row fails.
pub fn command(elf: &[u8], without: Option<&str>, expect: Option<&Path>, page: Option<&Path>) -> Result<()> {
    let out = run(elf, &jumpers(without.as_slice())?, true, |line| println!("{line}"))?;
    let rows = out.rows();
    if let Some(page) = page {
        show(page, &out.log)?;
    }
    if let Some(path) = expect {
        if let Some(row) = rows.iter().find(|r| r.reached.is_nan()) {
            bail!("{} was not measured: nothing is written", row.name);
        }
        let values: String = rows.iter().map(|r| format!("    ({:?}, {:?}),\n", r.name, r.reached)).collect();
        let text = format!(
            "//! Figures of the virtual board for each row of the table: printed by `cargo xtask bring-up --virtual --expect`; not written by hand.\n\n/// In the order of the rows: name, figure.\npub const EXPECTED: &[(&str, f32)] = &[\n{values}];\n"
        );
        hrg_data::output::write_file(path, text.as_bytes())?;
        println!("written to {}: run it again", path.display());
        return Ok(());
    }
    let failed: Vec<&str> = rows.iter().filter(|r| !r.pass).map(|r| r.name.as_str()).collect();
    if !failed.is_empty() {
        bail!("{} of {} rows fail: {}", failed.len(), rows.len(), failed.join("; "));
    }
    Ok(())
}
