//! Waits: places where the program reads a register again and again until it changes, in its start, in flight and in a burn.
//!
//! Each is made to fall through (the flag reads as it does at the end of the wait, at each place that looks at it), which the board must notice where no
//! rule makes it harmless; and the flag is made a millisecond late, which the unit must bear.

use super::exam::{Exam, Wrong};
use super::{function, judge, Verdict};
use crate::faults::trials;
use anyhow::Result;
use std::fmt::{self, Write as _};
use virtual_board::mutation::{Misread, RegisterRead};
use virtual_board::tables::Tables;
use virtual_board::{Firmware, CPU_HZ};

/// A wait, and what came of it.
#[derive(Debug, Clone)]
pub struct Wait {
    /// Register, with the fields that change.
    pub flag: String,
    /// Function that waits.
    pub function: String,
    /// Length, us.
    pub lasts_us: f64,
    /// Verdict where it falls through.
    pub fallen_through: Verdict,
    /// `true` if the unit bears the flag a millisecond late.
    pub late: bool,
}

impl Wait {
    /// `true` if the board notices that it falls through, and the unit bears that it lasts.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.late && self.fallen_through != Verdict::Unnoticed
    }
}

impl fmt::Display for Wait {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let found = match &self.fallen_through {
            Verdict::Sentence(sentence) => sentence,
            Verdict::Differs(what) | Verdict::Harmless(what) => *what,
            Verdict::Unnoticed => "not noticed",
        };
        let late = if self.late { "yes" } else { "no" };
        write!(f, "| {} | {} | {:.1} | {found} | {late} |", self.flag, self.function, self.lasts_us)
    }
}

/// First and last read of each wait, once for each place and register. (A stream's NDTR is read until it stands still, which is no flag.)
fn recorded(reads: &[RegisterRead], tables: &Tables) -> Vec<(RegisterRead, RegisterRead)> {
    let place = |r: &RegisterRead| (r.block, r.address, r.exception, r.writes);
    let mut waits: Vec<(RegisterRead, RegisterRead)> = Vec::new();
    for run in reads.chunk_by(|a, b| place(a) == place(b)) {
        if let [first, .., last] = run {
            let known = waits.iter().any(|(f, _)| (f.block, f.address) == (first.block, first.address));
            if first.value != last.value && !known && !tables.register_name(first.address).ends_with(".NDTR") {
                waits.push((*first, *last));
            }
        }
    }
    waits
}

/// Tries all waits.
///
/// # Errors
/// If an exam cannot be sat.
pub fn all(exam: &Exam<'_>, tables: &Tables, firmware: &Firmware) -> Result<Vec<Wait>> {
    let (good, reads) = exam.burn(&Wrong::Nothing);
    anyhow::ensure!(good.ended.is_none(), "the unmutated program: {}", good.ended.unwrap_or_default());
    let recorded = recorded(&reads, tables);
    trials(
        recorded.len() as u64,
        || Ok(()),
        |(), k| {
            let (first, last) = recorded[k as usize];
            let (number, mask, lasts) = (first.number, first.value ^ last.value, last.at - first.at);
            let early = Misread { number, mask, value: last.value, cycles: lasts };
            let late = Misread { number, mask, value: first.value, cycles: lasts + CPU_HZ / 1000 };
            let fields = tables.registers.get(&first.address).map(|r| r.fields_of(mask)).unwrap_or_default();
            let flag = format!("{} {fields}", tables.register_name(first.address));
            let function = function(firmware, first.block).to_string();
            let (fallen, _) = exam.burn(&Wrong::Read(early));
            // (That its start is over earlier is no difference.)
            let fallen_through = match judge(&good, &fallen) {
                Verdict::Sentence(sentence) => Verdict::Sentence(sentence),
                _ if fallen.runs_like(&good) => {
                    harmless(&flag, &function).map_or(Verdict::Unnoticed, Verdict::Harmless)
                }
                other => other,
            };
            let late = exam.burn(&Wrong::Read(late)).0.runs_like(&good);
            Ok(Wait { flag, function, lasts_us: lasts as f64 * 1e6 / CPU_HZ as f64, fallen_through, late })
        },
    )
}

/// The rule by which a wait that falls through does not matter, by flag and function.
fn harmless(flag: &str, function: &str) -> Option<&'static str> {
    let rules = [
        ("RCC.CR HSERDY", "", "the PLL locks on what runs only, and is waited for behind it (RM0390 section 6.2.3)"),
        ("PWR.CSR1 ODSWRDY", "", "the PLL takes longer to lock and is waited for behind it; the board looks at over-drive when the clock is switched (RM0390 section 5.1.3)"),
        ("RCC.CSR LSIRDY", "", "the watchdog switches LSI on itself (RM0390 section 6.2.5)"),
        ("IWDG.SR", "firmware::start", "until its next reload it counts from what the loader has set, half a second (RM0390 section 20.3)"),
    ];
    rules.iter().find(|(f, within, _)| flag.starts_with(f) && function.starts_with(within)).map(|(_, _, why)| *why)
}

/// The table of the page.
#[must_use]
pub fn markdown(waits: &[Wait]) -> String {
    let mut s = String::from(
        "| wait for | in | lasts [us] | the wait falls through | the unit bears it 1 ms late |\n|---|---|---:|---|---|\n",
    );
    waits.iter().for_each(|w| {
        let _ = writeln!(s, "{w}");
    });
    s
}
