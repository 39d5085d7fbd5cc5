//! Exam that each mutant goes through.

use super::rebuilt;
use crate::faults::load::LATENCY;
use crate::faults::Scene;
use anyhow::{Context, Result};
use hrg_board::host;
use hrg_board::host::cycles;
use hrg_board::replay::{CALIBRATION_A, CALIBRATION_B};
use hrg_board::symbol;
use hrg_board::wires::{WireFaults, Wires, BYTE_CYCLES};
use hrg_core::calibration::Calibration;
use hrg_core::link::{Housekeeping, Message};
use hrg_core::rate_path::RateFrame;
use hrg_core::self_test::Item;
use hrg_core::update::Programs;
use std::collections::BTreeMap;
use virtual_board::mutation::{Misread, Mutation, RegisterRead, RegisterWrite};
use virtual_board::{Board, Stop, CPU_HZ};

/// The first rate has gone out by then, s; a unit that has sent none is silent.
const SILENT_S: f64 = 0.6;
/// The flight: a second, and the frame that sums it up.
const FLIGHT_S: f64 = 2.2;
/// A flight over the end of TIM2, which comes after 2^32 / 90 MHz = 47.7 s.
const LONG_S: f64 = 50.0;
/// Time at which the unit is asked for its identity, s.
const ASKED_S: f64 = 0.8;

/// One thing that is wrong with a program, or with a chip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Wrong {
    /// Nothing.
    Nothing,
    /// A write to a register.
    Write(Mutation),
    /// A read of a register.
    Read(Misread),
    /// Bytes of the program, from an address on.
    Program(u32, Vec<u8>),
}

/// The scene of the exams.
pub struct Exam<'a> {
    scene: &'a Scene,
    image: Vec<u8>,
    new: Calibration,
}

/// Messages and log of a stretch of an exam.
#[derive(Debug, Default, Clone, PartialEq)]
struct Stretch {
    rates: Vec<RateFrame>,
    rate_at: Vec<u64>,
    delay_cycles: Vec<u32>,
    housekeeping: Vec<Housekeeping>,
    other: Vec<Message>,
    log: Vec<String>,
    /// From data-ready to the corrected sample, cycles at most.
    latency: u64,
}

/// Record of a unit's actions.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct Outcome {
    /// The sentence that the board ended the run with.
    pub ended: Option<String>,
    silent: bool,
    stretches: Vec<Stretch>,
    resets: Vec<(u64, Stop)>,
    answers: Vec<String>,
    marks: Vec<u64>,
    /// Values of all registers after the start.
    pub registers: BTreeMap<u32, u32>,
}

/// A start that takes some instructions more shifts all times, and by rounding the last digits of temperatures and rates: no difference. Times may differ by so much
/// from one frame to the next, us; stamps, ticks of the timer; rates, deg/h; temperatures, C.
const TIME_US: f64 = 150.0;
const TICKS: i64 = 2;
const RATE_DPH: f32 = 0.01;
const TEMPERATURE_C: f32 = 0.01;
/// The clock against the pulses, parts per 1e9.
const CLOCK_PPB: f32 = 50.0;
/// Ticks of TIM2 in a microsecond.
const TICKS_PER_US: f64 = 90.0;
/// Commands without a pause: five rings of the link's receiver.
const FLOOD: usize = 5 * 513 / 8;
/// Resets by the watchdog come within this, ms: its clock is a slow one.
const RESET_MS: f64 = 5.0;

fn near(a: f32, b: f32, within: f32) -> bool {
    a == b || (a - b).abs() <= within || a.is_nan() && b.is_nan()
}

/// Two rows of the same length, pair by pair.
fn pairs<'a, T>(a: &'a [T], b: &'a [T], alike: impl Fn(&T, &T) -> bool + 'a) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(x, y)| alike(x, y))
}

fn cycles_near(a: u64, b: u64, us: f64) -> bool {
    (a as f64 - b as f64).abs() * 1e6 / CPU_HZ as f64 <= us
}

impl Stretch {
    fn rates_alike(&self, other: &Self) -> bool {
        let since = |r: &[RateFrame], f: &RateFrame| i64::from(f.tick.wrapping_sub(r[0].tick));
        pairs(&self.rates, &other.rates, |a, b| {
            let ticks = since(&self.rates, a) - since(&other.rates, b);
            let rates = a.rate_dph.iter().zip(b.rate_dph).all(|(x, y)| near(*x, y, RATE_DPH));
            ticks.abs() <= TICKS && rates && (a.axis_status, a.unit_status) == (b.axis_status, b.unit_status)
        })
    }

    fn times_alike(&self, other: &Self) -> bool {
        let gaps = |s: &Self| s.rate_at.windows(2).map(|w| w[1] - w[0]).collect::<Vec<_>>();
        let delays = |s: &Self| s.delay_cycles.iter().map(|d| u64::from(*d)).collect::<Vec<_>>();
        pairs(&gaps(self), &gaps(other), |a, b| cycles_near(*a, *b, TIME_US))
            && pairs(&delays(self), &delays(other), |a, b| cycles_near(*a, *b, TIME_US))
    }

    fn housekeeping_alike(&self, other: &Self) -> bool {
        pairs(&self.housekeeping, &other.housekeeping, |a, b| {
            let temperatures = a.temperature_c.iter().zip(b.temperature_c).all(|(x, y)| near(*x, y, TEMPERATURE_C));
            let pulse = |h: &Housekeeping| h.pps_age_ms == u32::MAX;
            // (Pulses come at the same times, so a longer start makes all their ticks smaller.)
            let start_us = f64::from(a.pps_tick.wrapping_sub(b.pps_tick) as i32) / TICKS_PER_US;
            temperatures
                && pulse(a) == pulse(b)
                && start_us.abs() <= TIME_US
                && near(a.clock_ppb, b.clock_ppb, CLOCK_PPB)
                && (a.axis_status, a.unit_status, a.samples) == (b.axis_status, b.unit_status, b.samples)
        }) && pairs(&self.between_pulses(), &other.between_pulses(), |a, b| (a - b).abs() <= TICKS)
    }

    /// Ticks from one pulse of the housekeeping to the next.
    fn between_pulses(&self) -> Vec<i64> {
        let ticks = |w: &[Housekeeping]| i64::from(w[1].pps_tick.wrapping_sub(w[0].pps_tick));
        self.housekeeping.windows(2).map(ticks).collect()
    }

    /// Messages but for their numbers, but that of which unit, which image and which program.
    fn others_alike(&self, other: &Self) -> bool {
        pairs(&self.other, &other.other, |a, b| match (a, b) {
            (Message::Programs(a), Message::Programs(b)) => Programs { token: 0, ..*a } == Programs { token: 0, ..*b },
            (Message::Stopped(a), Message::Stopped(b)) => (a.halt, a.pc, a.cfsr) == (b.halt, b.pc, b.cfsr),
            _ => a == b,
        })
    }

    /// Every sample is corrected in the time that docs/promises.md gives it, or the other's are late as well.
    fn latency_alike(&self, other: &Self) -> bool {
        other.latency <= LATENCY || self.latency > LATENCY
    }

    /// Lines but for their numbers.
    fn logs_alike(&self, other: &Self) -> bool {
        let words =
            |line: &String| line.chars().filter(|c| !c.is_ascii_digit() && *c != '.' && *c != '-').collect::<String>();
        pairs(&self.log, &other.log, |a, b| words(a) == words(b))
    }
}

impl Outcome {
    fn all(&self, other: &Self, alike: impl Fn(&Stretch, &Stretch) -> bool) -> bool {
        pairs(&self.stretches, &other.stretches, alike)
    }

    fn resets_alike(&self, other: &Self) -> bool {
        pairs(&self.resets, &other.resets, |(at, stop), (other_at, other_stop)| {
            stop == other_stop && cycles_near(*at, *other_at, 1000.0 * RESET_MS)
        })
    }

    /// `true` if the unit runs, and stops and answers as another does, at whatever time.
    #[must_use]
    pub fn runs_like(&self, other: &Self) -> bool {
        let kinds = |o: &Self| o.resets.iter().map(|(_, stop)| *stop).collect::<Vec<_>>();
        self.ended.is_none() && !self.silent && kinds(self) == kinds(other) && self.answers == other.answers
    }

    /// First difference of another record from this one, if any. A shift of the start is none.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let marks = (self.marks.len() as i64 - other.marks.len() as i64).abs() <= 1;
        [
            (other.silent, "the unit is silent"),
            (!self.resets_alike(other), "its watchdog bites at another time, or not"),
            (!self.all(other, Stretch::rates_alike), "its rates differ"),
            (!self.all(other, Stretch::housekeeping_alike), "its housekeeping differs"),
            (!self.all(other, Stretch::others_alike), "what else it sends differs"),
            (!self.all(other, Stretch::logs_alike), "its log differs"),
            (self.answers != other.answers, "it answers otherwise"),
            (!marks, "its sample mark differs"),
            (!self.all(other, Stretch::times_alike), "what it sends comes at other times"),
            (!self.all(other, Stretch::latency_alike), "a sample is corrected later than promised"),
        ]
        .into_iter()
        .find_map(|(differs, what)| differs.then_some(what))
    }
}

impl<'a> Exam<'a> {
    /// With an image in sector A.
    ///
    /// # Errors
    /// An image that does not fit.
    pub fn new(scene: &'a Scene) -> Result<Self> {
        let image = scene.calibration.to_bytes().context("fits an image")?.to_vec();
        let mut new = scene.calibration.clone();
        new.sequence += 1;
        Ok(Self { scene, image, new })
    }

    fn board(&self, wrong: &Wrong) -> Result<Board<Wires>> {
        let faults = WireFaults { pulses: Some((0.5, 1.0)), ..WireFaults::default() };
        let mut board = Board::new(self.scene.elf(), self.scene.wires().live().with_faults(faults))?;
        board.write_flash(CALIBRATION_A, &self.image)?;
        match wrong {
            Wrong::Nothing => {}
            Wrong::Write(mutation) => board.mutate(*mutation),
            Wrong::Read(misread) => board.misread(*misread),
            Wrong::Program(address, bytes) => rebuilt::with(&mut board, *address, bytes)?,
        }
        Ok(board)
    }

    /// All writes to registers until the first corrected rate has gone out.
    ///
    /// # Errors
    /// If no rate goes out.
    pub fn writes(&self) -> Result<Vec<RegisterWrite>> {
        let mut board = self.board(&Wrong::Nothing)?;
        board.record_writes();
        while board.world.received.rates.is_empty() {
            anyhow::ensure!(board.now() < cycles(SILENT_S), "no rate within {SILENT_S} s");
            board.run_until(board.now() + cycles(0.001))?;
        }
        Ok(board.recorded_writes().to_vec())
    }

    /// Record of a start, a flight and a burn with an erase, and all reads of registers in it.
    pub fn burn(&self, wrong: &Wrong) -> (Outcome, Vec<RegisterRead>) {
        let (mut out, mut reads) = (Outcome::default(), Vec::new());
        let mut fly = || -> Result<()> {
            let mut board = self.board(wrong)?;
            // The sector for the new image is used up.
            board.write_flash(CALIBRATION_B, &vec![0; hrg_core::sectors::SECTOR_BYTES])?;
            board.record_reads();
            run(&mut board, SILENT_S, &mut out)?;
            out.silent = board.world.received.rates.is_empty();
            run(&mut board, ASKED_S, &mut out)?;
            out.answers.push(format!("{:?}", host::burn(&mut board, &self.new).map_err(|e| e.to_string())));
            run(&mut board, FLIGHT_S, &mut out)?;
            take(&mut board, &mut out);
            reads = board.recorded_reads().to_vec();
            Ok(())
        };
        let flown = fly();
        out.ended = flown.err().map(|e| format!("{e:#}"));
        (out, reads)
    }

    /// Has a mutant, or the program as it is, sit the exam.
    pub fn sit(&self, wrong: &Wrong) -> Outcome {
        let mut out = Outcome::default();
        if let Err(e) = self.all(wrong, &mut out) {
            out.ended = Some(format!("{e:#}"));
        }
        out
    }

    /// Record of a long flight, for a mutant that the exam did not notice.
    pub fn long_flight(&self, wrong: &Wrong) -> Outcome {
        let mut out = Outcome::default();
        let mut fly = || -> Result<()> {
            let mut board = self.board(wrong)?;
            run(&mut board, LONG_S, &mut out)?;
            take(&mut board, &mut out);
            Ok(())
        };
        let flown = fly();
        out.ended = flown.err().map(|e| format!("{e:#}"));
        out
    }

    fn all(&self, wrong: &Wrong, out: &mut Outcome) -> Result<()> {
        let mut board = self.board(wrong)?;
        board.watch_marks();
        board.count_calls(symbol::SAMPLE)?;
        run(&mut board, SILENT_S, out)?;
        board.forget_calls();
        out.silent = board.world.received.rates.is_empty();
        out.registers = board.registers();
        if out.silent {
            return Ok(());
        }
        run(&mut board, ASKED_S, out)?;
        board.world.hear(&Message::Identify.encode());
        board.poll_link();
        run(&mut board, FLIGHT_S, out)?;
        out.marks = board.marks().to_vec();
        take(&mut board, out);
        let flown = board.snapshot()?;
        // The crystal stops: the chip says so, and the watchdog starts the unit anew.
        board.stop_crystal();
        let end = FLIGHT_S + 1.5;
        run(&mut board, end, out)?;
        take(&mut board, out);
        board.restore(&flown)?;
        self.supply(&mut board, out)?;
        // The built-in test looks at each channel of the ADC.
        board.restore(&flown)?;
        self.test(&mut board, out)?;
        board.restore(&flown)?;
        flood(&mut board, out)?;
        // Connectors come off.
        board.restore(&flown)?;
        board.unplug_resonators()?;
        board.restore(&flown)?;
        crash(&mut board, out)
    }

    /// The built-in test: each figure is within its limits, or not.
    fn test(&self, board: &mut Board<Wires>, out: &mut Outcome) -> Result<()> {
        let tested = host::self_test(board, self.new.unit);
        let verdicts = |items: Vec<Item>| -> Vec<_> { items.iter().map(|i| (i.check, i.index, i.verdict())).collect() };
        out.answers.push(format!("{:?}", tested.map(|t| t.map(verdicts)).map_err(|e| e.to_string())));
        take(board, out);
        Ok(())
    }

    /// The supply sags, to just under the level below which flash is not written, and to just above.
    fn supply(&self, board: &mut Board<Wires>, out: &mut Outcome) -> Result<()> {
        board.sag(5);
        out.answers.push(format!("{:?}", host::burn(board, &self.new).map_err(|e| e.to_string())));
        board.sag(4);
        out.answers.push(format!("{:?}", host::burn(board, &self.new).map_err(|e| e.to_string())));
        take(board, out);
        Ok(())
    }
}

/// Commands come without a pause, as many as fill the receiver's ring several times: each is answered, or not.
fn flood(board: &mut Board<Wires>, out: &mut Outcome) -> Result<()> {
    let commands = Message::Identify.encode().repeat(FLOOD);
    board.world.hear(&commands);
    board.poll_link();
    let end = board.now() as f64 / CPU_HZ as f64 + commands.len() as f64 * BYTE_CYCLES as f64 / CPU_HZ as f64;
    run(board, end + 0.05, out)?;
    take(board, out);
    Ok(())
}

/// The program becomes one that faults with each sample: the unit says where, and stands still until the watchdog bites.
fn crash(board: &mut Board<Wires>, out: &mut Outcome) -> Result<()> {
    const UNDEFINED: [u8; 2] = 0xDE00u16.to_le_bytes();
    let at = board.firmware().function(symbol::SAMPLE)?;
    rebuilt::with(board, at, &UNDEFINED)?;
    board.faults_as_on_chip();
    board.reset_by_software()?;
    let end = FLIGHT_S + 1.5;
    run(board, end, out)?;
    take(board, out);
    Ok(())
}

/// Runs until a time, s, through resets.
fn run(board: &mut Board<Wires>, until_s: f64, out: &mut Outcome) -> Result<()> {
    loop {
        match board.run_until(cycles(until_s))? {
            Stop::Time => return Ok(()),
            stop => out.resets.push((board.now(), stop)),
        }
    }
}

/// Ends a stretch.
fn take(board: &mut Board<Wires>, out: &mut Outcome) {
    let r = std::mem::take(&mut board.world.received);
    let latency = board.probe(0).map_or(0, |p| p.latency.most_cycles);
    board.forget_calls();
    out.stretches.push(Stretch {
        latency,
        rates: r.rates,
        rate_at: r.rate_at,
        delay_cycles: r.delay_cycles,
        housekeeping: r.housekeeping,
        other: r.other,
        log: r.log,
    });
}
