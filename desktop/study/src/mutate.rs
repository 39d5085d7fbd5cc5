//! Proof by mutation: the set-up code of the flashed program is made wrong in one place, and the board must notice.
//!
//! # Design
//! The program starts once, and each write to a register is taken down until the first corrected rate has gone out. A mutant is one of these
//! writes with another value, left out, behind the next one, or sent elsewhere: to the next instance, port, stream, pin or interrupt. It is changed on its way to the
//! register ([`virtual_board::mutation`]), which is the same as another constant in the instruction that writes it, with no program to be built.
//! The bits that exist are taken from the tables of stm32-metapac, not from the program. Constants that are in no such write are changed in the program itself:
//! vectors, and the settings of the ADC ([`rebuilt`]). Waits are few: all of them are tried.
//!
//! Each mutant then goes through an `exam`: start, two seconds of flight with pulses per second and a command, a crystal that stops, a sagging
//! supply with a burn, the built-in test, resonators unplugged, an undefined instruction. It is *noticed* where the board ends the run with a sentence, or where what the
//! unit sends or logs differs from the unmutated program by more than a start that is some instructions longer explains. It is *harmless* where a rule of `rules` says so, with the manual's section. Nothing else may be left.

mod exam;
pub mod rebuilt;
mod rules;
mod waits;

use crate::faults::{draws, trials, Scene};
use anyhow::{Context, Result};
use exam::{Exam, Outcome, Wrong};
use hrg_core::adc::SETTINGS;
use rand::seq::IndexedRandom;
use rand::Rng;
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::sync::OnceLock;
use virtual_board::mutation::{Change, Mutation, RegisterWrite};
use virtual_board::part::Part;
use virtual_board::tables::{Register, Tables};
use virtual_board::Firmware;

/// Data, no set-up: the CRC unit's data register, which is fed the program word by word, and the alarm of the time driver (CCR2 of TIM5).
fn data(address: u32) -> bool {
    matches!(address, 0x4002_3000 | 0x4000_0C38)
}
/// Interrupts whose handlers run tasks, which set things up as well: UART4 and UART5, as exceptions.
const EXECUTORS: [u16; 2] = [16 + 52, 16 + 53];
/// So many writes of one place in the program to one register are taken: a timer's compare value is written again and again.
const ALIKE: usize = 3;

/// Mutants of a campaign, unless told otherwise.
pub const COUNT: u64 = 400;

/// The place that is wrong in a mutant.
#[derive(Debug, Clone)]
enum Place {
    /// A write, as the program writes it, and its change on the way.
    Write(RegisterWrite, Change),
    /// The vector of an exception, and its value.
    Vector(u32, u32),
    /// A register of the ADC, bits that change, and its value.
    Setting(u8, u16, u16),
}

/// One place, made wrong.
#[derive(Debug, Clone)]
struct Mutant {
    place: Place,
    /// Kind of the mutation.
    kind: &'static str,
}

/// Value that a register would hold without a write; 0 for registers that act on ones alone.
fn before(w: &RegisterWrite) -> u32 {
    if acts_on_ones(w.address) {
        0
    } else {
        w.before
    }
}

impl Mutant {
    fn describe(&self, tables: &Tables, firmware: &Firmware) -> String {
        let kind = self.kind;
        let (w, change) = match &self.place {
            Place::Write(w, change) => (w, change),
            Place::Vector(exception, value) => {
                return format!("{kind}: vector {exception} becomes {value:#010x}, {}", function(firmware, *value))
            }
            Place::Setting(register, bits, value) => {
                return format!("{kind}: register {register:#04x} of the ADC becomes {value:#06x} (bits {bits:#06x})")
            }
        };
        let name = tables.register_name(w.address);
        let fields = |bits| tables.registers.get(&w.address).map(|r| r.fields_of(bits)).unwrap_or_default();
        let became = match *change {
            Change::LeftOut => "left out".to_string(),
            Change::Later => "behind the next write".to_string(),
            Change::Becomes { address, value } if address == w.address => {
                format!("{value:#010x} ({})", fields(w.value ^ value))
            }
            Change::Becomes { address, value } => format!("{value:#010x} at {}", tables.register_name(address)),
        };
        format!(
            "{kind}: {name} {:#010x}->{:#010x} becomes {became}, in {}",
            w.before,
            w.value,
            function(firmware, w.block)
        )
    }

    /// The program with it.
    fn wrong(&self, firmware: &Firmware) -> Result<Wrong> {
        Ok(match &self.place {
            Place::Write(w, change) => Wrong::Write(Mutation { number: w.number, change: *change }),
            Place::Vector(exception, value) => {
                Wrong::Program(vectors(firmware)? + 4 * exception, value.to_le_bytes().to_vec())
            }
            Place::Setting(register, _, value) => {
                Wrong::Program(rebuilt::setting(firmware, *register)?, value.to_le_bytes().to_vec())
            }
        })
    }
}

/// Name of the function at an address.
fn function(firmware: &Firmware, address: u32) -> &str {
    firmware.function_before(address & !1).unwrap_or("?")
}

/// Address of the program's vectors.
fn vectors(firmware: &Firmware) -> Result<u32> {
    firmware.address_of("__vector_table").context("the program has no table of vectors")
}

/// Registers of which a one does something and a zero nothing: sets and clears of the NVIC, BSRR, IFCR.
fn acts_on_ones(address: u32) -> bool {
    match address {
        0xE000_E100..=0xE000_E2FF => true,
        0x4002_0000..=0x4002_1FFF => address & 0x3FF == 0x18,
        0x4002_6000..=0x4002_67FF => matches!(address & 0x3FF, 8 | 0xC),
        _ => false,
    }
}

/// Verdict on a mutant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// The board ended the run with this sentence.
    Sentence(String),
    /// The unit acts otherwise; the difference.
    Differs(&'static str),
    /// It does not matter; the rule that says so.
    Harmless(&'static str),
    /// No difference was noticed.
    Unnoticed,
}

/// All mutants, with what came of them.
#[derive(Debug)]
pub struct Campaign {
    /// In the order of their numbers: what, and what came of it.
    pub mutants: Vec<(String, Verdict)>,
    /// Writes that mutants were made of.
    pub writes: usize,
    /// All waits.
    pub waits: Vec<waits::Wait>,
}

/// The writes that mutants are made of.
fn set_up(recorded: &[RegisterWrite]) -> Vec<RegisterWrite> {
    let mut alike = HashMap::<(u32, u32), usize>::new();
    let fresh = |w: &&RegisterWrite| {
        let n = alike.entry((w.block, w.address)).or_default();
        *n += 1;
        *n <= ALIKE
    };
    let set_up = |w: &&RegisterWrite| !data(w.address) && (w.exception == 0 || EXECUTORS.contains(&w.exception));
    recorded.iter().filter(set_up).filter(fresh).copied().collect()
}

/// Registers of the core, which stm32-metapac does not have: ARMv7-M architecture reference manual, sections B3.2 and B3.4.
fn fields(tables: &Tables, address: u32) -> Vec<u32> {
    let each = |bits: std::ops::Range<u32>| bits.map(|b| 1 << b).collect();
    match address {
        0xE000_E100..=0xE000_E1FF => each(0..32),
        0xE000_E200..=0xE000_E3FF => each(0..32),
        // Priorities: the upper four bits of each byte.
        0xE000_E400..=0xE000_E4FF => vec![0xF0],
        0xE000_ED88 => vec![3 << 20, 3 << 22],
        _ => match tables.registers.get(&address) {
            Some(Register { fields, .. }) if !fields.is_empty() => {
                fields.iter().map(virtual_board::tables::Field::mask).collect()
            }
            _ => each(0..32),
        },
    }
}

/// Other addresses and values of a write made by mistake.
fn neighbours(tables: &Tables, w: &RegisterWrite) -> Vec<(u32, u32)> {
    let mut out = Vec::new();
    // Another instance: the next peripheral of the same letters.
    if let Some(p) = tables.peripheral_at(w.address) {
        let kind = |name: &str| name.trim_end_matches(|c: char| c.is_ascii_digit()).to_string();
        let kind = if p.name.starts_with("GPIO") { "GPIO".to_string() } else { kind(&p.name) };
        let others = tables.peripherals.values().filter(|q| q.address != p.address && q.name.starts_with(&kind));
        let near = others.filter(|q| tables.registers.contains_key(&(q.address + (w.address - p.address))));
        out.extend(near.map(|q| (q.address + (w.address - p.address), w.value)));
        // Another stream of a DMA controller.
        if p.name.starts_with("DMA") && w.address - p.address >= 0x10 {
            let (first, last) = (p.address + 0x10, p.address + 0xD0);
            out.extend(
                [w.address + 0x18, w.address - 0x18]
                    .into_iter()
                    .filter(|a| (first..last).contains(a))
                    .map(|a| (a, w.value)),
            );
        }
        // The next register.
        out.extend([w.address + 4].into_iter().filter(|a| tables.registers.contains_key(a)).map(|a| (a, w.value)));
    }
    // The same change one field further: another pin, gate, channel or interrupt.
    let before = before(w);
    let changed = w.value ^ before;
    let fields = fields(tables, w.address);
    for f in fields.iter().filter(|f| **f & changed != 0) {
        let width = f.count_ones();
        let moved = |to: u32| {
            w.value & !(f | to) | before & f | if to > *f { (w.value & f) << width } else { (w.value & f) >> width }
        };
        out.extend(
            [f << width, f >> width].into_iter().filter(|to| fields.contains(to)).map(|to| (w.address, moved(to))),
        );
    }
    out.retain(|(address, value)| (*address, *value) != (w.address, w.value));
    out
}

/// The mutant of a number. (Vectors: of the 15 exceptions and 97 interrupts of the chip, behind the stack and the reset, which the loader has.)
fn mutant(part: &Part, writes: &[RegisterWrite], firmware: &Firmware, seed: u64, number: u64) -> Option<Mutant> {
    let tables = &part.tables;
    let mut draw = draws(seed, 20, number);
    for _ in 0..100 {
        match number % 7 {
            5 => {
                let last = 16 + *tables.interrupts.keys().max()? as u32;
                let at = vectors(firmware).ok()?;
                let exception = draw.random_range(2..=last);
                let good = firmware.word(at + 4 * exception)?;
                let other = firmware.word(at + 4 * draw.random_range(2..=last))?;
                let value = if draw.random::<bool>() { good & !1 } else { other };
                if value != good {
                    return Some(Mutant { place: Place::Vector(exception, value), kind: "vector" });
                }
                continue;
            }
            6 => {
                let (register, good) = *SETTINGS.choose(&mut draw)?;
                let bits = if draw.random::<bool>() { 1 << draw.random_range(0..16) } else { draw.random::<u16>() };
                return Some(Mutant { place: Place::Setting(register, bits, good ^ bits), kind: "setting" });
            }
            _ => {}
        }
        let write = *writes.choose(&mut draw)?;
        let field = *fields(tables, write.address).choose(&mut draw)?;
        let becomes = |value| Change::Becomes { address: write.address, value };
        let (kind, change) = match number % 7 {
            0 => {
                let bits: Vec<u32> = (0..32).filter(|b| field & 1 << b != 0).collect();
                ("bit", becomes(write.value ^ 1 << bits.choose(&mut draw)?))
            }
            1 => ("field", becomes(write.value & !field | draw.random::<u32>() & field)),
            2 => ("left out", Change::LeftOut),
            3 => ("order", Change::Later),
            _ => {
                let Some(&(address, value)) = neighbours(tables, &write).choose(&mut draw) else { continue };
                ("elsewhere", Change::Becomes { address, value })
            }
        };
        if change != becomes(write.value) {
            return Some(Mutant { place: Place::Write(write, change), kind });
        }
    }
    None
}

/// Runs a campaign.
///
/// # Errors
/// If the unmutated program cannot be run, or complains.
pub fn campaign(elf: &[u8], seed: u64, count: u64) -> Result<Campaign> {
    let scene = Scene::new(elf, 1)?;
    let exam = Exam::new(&scene)?;
    let part = &virtual_board::part::STM32F446RE;
    let recorded = exam.writes()?;
    let writes = set_up(&recorded);
    let rules = rules::Rules::new(part, &recorded);
    let good = exam.sit(&Wrong::Nothing);
    anyhow::ensure!(good.ended.is_none(), "the unmutated program: {}", good.ended.unwrap_or_default());
    let again = good.difference(&exam.sit(&Wrong::Nothing));
    anyhow::ensure!(again.is_none(), "the unmutated program does not run twice alike: {}", again.unwrap_or_default());
    let firmware = Firmware::parse(elf)?;
    // The controls: a vector that nobody reads, and a bit of the ADC that it does not have.
    for control in [
        Wrong::Program(vectors(&firmware)? + 4 * 13, vec![1, 0, 1, 8]),
        Wrong::Program(rebuilt::setting(&firmware, 0x08)?, vec![0xF0, 0]),
    ] {
        let found = judge(&good, &exam.sit(&control));
        anyhow::ensure!(found == Verdict::Unnoticed, "a change that cannot matter is noticed: {found:?}");
    }
    let good_long = OnceLock::new();
    let mutants = trials(
        count,
        || Ok(()),
        |(), k| {
            let m = mutant(part, &writes, &firmware, seed, k).context("no mutant can be made")?;
            let line = format!("{k}: {}", m.describe(&part.tables, &firmware));
            let wrong = m.wrong(&firmware)?;
            let found = exam.sit(&wrong);
            let harmless = || match m.place {
                Place::Write(..) => rules.harmless(&good.registers, &found.registers),
                Place::Vector(exception, _) => rules.vector(exception),
                Place::Setting(register, bits, _) => rules::setting(register, bits),
            };
            let verdict = match judge(&good, &found) {
                Verdict::Unnoticed => {
                    let excused = harmless().map(Verdict::Harmless);
                    excused.unwrap_or_else(|| {
                        judge(good_long.get_or_init(|| exam.long_flight(&Wrong::Nothing)), &exam.long_flight(&wrong))
                    })
                }
                verdict => verdict,
            };
            let line = match verdict {
                Verdict::Unnoticed => format!("{line}; {}", different(&part.tables, &good.registers, &found.registers)),
                _ => line,
            };
            Ok((line, verdict))
        },
    )?;
    let waits = waits::all(&exam, &part.tables, &firmware)?;
    Ok(Campaign { mutants, writes: writes.len(), waits })
}

/// Registers that differ after the start, with both values.
fn different(tables: &Tables, good: &BTreeMap<u32, u32>, found: &BTreeMap<u32, u32>) -> String {
    let differs = good.iter().filter_map(|(address, value)| {
        let other = found.get(address).copied().unwrap_or(0);
        (other != *value).then(|| format!("{} {value:#010x} -> {other:#010x}", tables.register_name(*address)))
    });
    format!("after the start: {}", differs.collect::<Vec<_>>().join(", "))
}

fn judge(good: &Outcome, found: &Outcome) -> Verdict {
    if let Some(sentence) = &found.ended {
        return Verdict::Sentence(sentence.clone());
    }
    match good.difference(found) {
        Some(what) => Verdict::Differs(what),
        None => Verdict::Unnoticed,
    }
}

impl Campaign {
    fn count(&self, of: impl Fn(&Verdict) -> bool) -> usize {
        self.mutants.iter().filter(|(_, v)| of(v)).count()
    }

    /// Mutants that nobody noticed.
    pub fn unnoticed(&self) -> impl Iterator<Item = &str> {
        self.mutants.iter().filter(|(_, v)| *v == Verdict::Unnoticed).map(|(m, _)| m.as_str())
    }

    /// The tables of the page.
    #[must_use]
    pub fn markdown(&self) -> String {
        let mut s = String::from("| what became of the mutants | |\n|---|---:|\n");
        let sentences = self.count(|v| matches!(v, Verdict::Sentence(_)));
        let _ = writeln!(s, "| the board ended the run with a sentence | {sentences} |");
        let mut differs = BTreeMap::<&str, usize>::new();
        let mut harmless = BTreeMap::<&str, usize>::new();
        for (_, v) in &self.mutants {
            match v {
                Verdict::Differs(what) => *differs.entry(what).or_default() += 1,
                Verdict::Harmless(rule) => *harmless.entry(rule).or_default() += 1,
                Verdict::Sentence(_) | Verdict::Unnoticed => {}
            }
        }
        for (what, n) in &differs {
            let _ = writeln!(s, "| {what} | {n} |");
        }
        let _ = writeln!(s, "| harmless by the manual | {} |", harmless.values().sum::<usize>());
        let _ = writeln!(s, "| not noticed | {} |", self.unnoticed().count());
        let _ = writeln!(s, "| all, of {} writes | {} |", self.writes, self.mutants.len());
        s.push_str("\n| harmless, because | |\n|---|---:|\n");
        for (rule, n) in &harmless {
            let _ = writeln!(s, "| {rule} | {n} |");
        }
        s.push('\n');
        s.push_str(&waits::markdown(&self.waits));
        s
    }
}

/// Runs a campaign, prints it, and fails where a mutant was not noticed.
///
/// # Errors
/// As [`campaign`]; where one was not noticed; where the page cannot be written.
pub fn mutate(elf: &[u8], seed: u64, count: u64, list: bool, page: Option<&std::path::Path>) -> Result<()> {
    let start = std::time::Instant::now();
    let all = campaign(elf, seed, count)?;
    for (m, verdict) in all.mutants.iter().filter(|(_, v)| list || *v == Verdict::Unnoticed) {
        println!("{m}\n    {verdict:?}");
    }
    println!("{}seed {seed}, {:.0} s", all.markdown(), start.elapsed().as_secs_f64());
    if let Some(page) = page {
        crate::pages::splice(page, "mutants", &all.markdown())?;
    }
    let unnoticed = all.unnoticed().count();
    anyhow::ensure!(unnoticed == 0, "{unnoticed} mutants were not noticed");
    let waits: Vec<String> = all.waits.iter().filter(|w| !w.holds()).map(ToString::to_string).collect();
    anyhow::ensure!(waits.is_empty(), "waits that do not hold: {}", waits.join("; "));
    Ok(())
}
