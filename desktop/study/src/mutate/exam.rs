//! Exam that each mutant goes through.

use super::rebuilt;
use crate::faults::Scene;
use anyhow::{Context, Result};
use hrg_board::host;
use hrg_board::host::cycles;
use hrg_board::replay::{CALIBRATION_A, CALIBRATION_B};
use hrg_board::symbol;
use hrg_board::wires::{WireFaults, Wires};
use hrg_core::calibration::Calibration;
use hrg_core::link::Message;
use std::collections::BTreeMap;
use virtual_board::mutation::{Misread, Mutation, RegisterRead, RegisterWrite};
use virtual_board::{Board, Stop};

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

/// Record of a unit's actions.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// The sentence that the board ended the run with.
    pub ended: Option<String>,
    silent: bool,
    sent: Vec<u8>,
    log: Vec<u8>,
    resets: Vec<(u64, Stop)>,
    answers: Vec<String>,
    marks: Vec<u64>,
    times: Vec<u64>,
    /// Values of all registers after the start.
    pub registers: BTreeMap<u32, u32>,
}

impl Outcome {
    /// `true` if the unit runs, and stops and answers as another does, at whatever time.
    #[must_use]
    pub fn runs_like(&self, other: &Self) -> bool {
        let kinds = |o: &Self| o.resets.iter().map(|(_, stop)| *stop).collect::<Vec<_>>();
        self.ended.is_none() && !self.silent && kinds(self) == kinds(other) && self.answers == other.answers
    }

    /// First difference of another record from this one, if any.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        [
            (other.silent, "the unit is silent"),
            (self.resets != other.resets, "its watchdog bites at another time, or not"),
            (self.sent != other.sent, "what it sends differs"),
            (self.log != other.log, "its log differs"),
            (self.answers != other.answers, "it answers otherwise"),
            (self.marks != other.marks, "its sample mark differs"),
            (self.times != other.times, "what it sends comes at other times"),
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
        run(&mut board, SILENT_S, out)?;
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
        out.times.clone_from(&board.world.received.rate_at);
        take(&mut board, out);
        let flown = board.snapshot()?;
        // The crystal stops: the chip says so, and the watchdog starts the unit anew.
        board.stop_crystal();
        let end = FLIGHT_S + 1.5;
        run(&mut board, end, out)?;
        take(&mut board, out);
        board.restore(&flown)?;
        self.supply(&mut board, out)?;
        // Connectors come off.
        board.restore(&flown)?;
        board.unplug_resonators()?;
        board.restore(&flown)?;
        crash(&mut board, out)
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

fn take(board: &mut Board<Wires>, out: &mut Outcome) {
    out.sent.extend(board.world.printed());
    out.log.extend(std::mem::take(&mut board.world.received.log_bytes));
}
