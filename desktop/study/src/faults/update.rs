//! Power cuts while a new program comes, and while it is on trial.

use super::{draws, run, trials, Extent, Report, Scene};
use anyhow::{Context, Result};
use hrg_board::host::{cycles, maintain, programs, running};
use hrg_board::replay::{elf_for_slot_b, read_elf};
use hrg_board::wires::Wires;
use hrg_core::maintenance::{Answer, Command, CHUNK};
use hrg_core::slots::{self, Slot, State, ADDRESSES};
use hrg_core::update::{self, Programs};
use rand::Rng;
use virtual_board::{Board, Firmware, Snapshot, FLASH_START};

/// The unit must answer within this time after power comes back, s.
const UP_S: f64 = 1.0;
/// Seconds after the restart in which the program on trial confirms itself where a host talks to it.
const TRIAL_S: u32 = 6;

/// The commands of an update that nothing disturbs, and what was done before and after each.
struct Course {
    commands: Vec<Command>,
    /// Flash operations and instructions before the first command, and after each.
    done: Vec<(u64, u64)>,
}

/// The commands of an update as the host gives them: two sectors are emptied first.
fn commands(scene: &Scene, body: &[u8]) -> Vec<Command> {
    let begin = Command::Program { length: body.len() as u32, sum: slots::sum(body) };
    let pieces = (0..body.len()).step_by(CHUNK).filter_map(|offset| update::piece(body, offset as u32));
    [Command::Open(scene.calibration.unit)]
        .into_iter()
        .chain([begin; 3])
        .chain(pieces)
        .chain([Command::Commit([0; 64])])
        .collect()
}

/// A unit that runs, with something in its other slot.
fn unit(scene: &Scene) -> Result<Board<Wires>> {
    let mut board = scene.restarted()?;
    board.write_flash(0x4_0000 + 4, &[0; 4])?;
    board.write_flash(0x6_0000 + 4, &[0; 4])?;
    run(&mut board, cycles(1.0))?;
    Ok(board)
}

/// Gives a command that must not fail; `false`: the board stopped.
fn give(board: &mut Board<Wires>, command: Command) -> Result<bool> {
    match maintain(board, command)? {
        None => Ok(false),
        Some(Answer::Done | Answer::More) => Ok(true),
        Some(answer) => anyhow::bail!("{command:?}: {answer}"),
    }
}

fn course(scene: &Scene, commands: Vec<Command>) -> Result<Course> {
    let mut board = unit(scene)?;
    let count = |board: &Board<Wires>| (board.flash_operations(), board.instructions());
    let mut done = vec![count(&board)];
    for command in &commands {
        anyhow::ensure!(give(&mut board, *command)?, "nothing stops it");
        done.push(count(&board));
    }
    Ok(Course { commands, done })
}

/// A unit in the middle of an update: before its command of this number.
struct Midway {
    board: Board<Wires>,
    at: usize,
    start: Snapshot<Wires>,
}

impl Midway {
    fn new(scene: &Scene) -> Result<Self> {
        let board = unit(scene)?;
        let start = board.snapshot()?;
        Ok(Self { board, at: 0, start })
    }

    /// Goes on to before a command.
    fn go(&mut self, course: &Course, to: usize) -> Result<()> {
        self.board.restore(&self.start)?;
        if to > self.at {
            for command in course.commands.get(self.at..to).unwrap_or_default() {
                anyhow::ensure!(give(&mut self.board, *command)?, "nothing stops it");
            }
            self.at = to;
            self.start = self.board.snapshot()?;
        }
        Ok(())
    }

    /// Power comes back: the programs of the unit; `None`: it does not answer.
    fn after_cut(&mut self) -> Result<Option<Programs>> {
        self.board.power_cut()?;
        Ok(running(&mut self.board, UP_S).and_then(|_| programs(&mut self.board, UP_S)).ok())
    }
}

fn tell(report: &mut Report, what: String, found: &[Option<Programs>]) {
    let count = |slot: u8, states: &[State]| {
        let is = |p: &&Programs| p.slot == slot && states.iter().any(|s| *s as u8 == p.state);
        found.iter().flatten().filter(is).count()
    };
    let (old, new) = (count(0, &[State::Confirmed]), count(1, &[State::Tried, State::Confirmed]));
    let silent = found.iter().filter(|p| p.is_none()).count();
    let neither = found.len() - old - new - silent;
    report.row(
        what,
        found.len() as u64,
        format!("old program {old}, new program {new}, neither {neither}, no word of which within {UP_S} s {silent}"),
        neither + silent == 0,
    );
}

/// Cuts at every flash operation of an update, at random instructions of one, and at random instructions of the trial.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let elf = read_elf(&elf_for_slot_b()).context("the firmware for slot B: cargo xtask size --slot-b builds it")?;
    let firmware = Firmware::parse(&elf)?;
    let slot = firmware.flash().get((ADDRESSES[1] - FLASH_START) as usize..).unwrap_or_default();
    let body = Slot(slot).body().context("the firmware for slot B is not linked for it")?;
    let course = course(scene, commands(scene, body))?;
    let (first, last) = (course.done[0], course.done[course.done.len() - 1]);

    // (Fewer of the operations in a short campaign: most write a word of the program.)
    let every = if extent.every == 1 { 1 } else { extent.every * 10 };
    let operations = last.0 - first.0;
    let found = trials(
        operations / every,
        || Midway::new(scene),
        |midway, k| {
            let cut = first.0 + 1 + k * every;
            let at = course.done.partition_point(|(operations, _)| *operations < cut) - 1;
            midway.go(&course, at)?;
            midway.board.stop_at_flash_operation(cut - course.done[at].0);
            anyhow::ensure!(!give(&mut midway.board, course.commands[at])?, "the cut did not come");
            midway.after_cut()
        },
    )?;
    tell(report, format!("power cut within flash operation 1 to {operations} of an update"), &found);

    let mut moments: Vec<u64> = (0..extent.random).map(|k| draws(seed, 11, k).random_range(first.1..last.1)).collect();
    moments.sort_unstable();
    let found = trials(
        extent.random,
        || Midway::new(scene),
        |midway, k| {
            let cut = moments[k as usize];
            let at = course.done.partition_point(|(_, instructions)| *instructions <= cut) - 1;
            midway.go(&course, at)?;
            let into = cut - course.done[at].1;
            midway.board.stop_at_instruction(midway.board.instructions() + into);
            // (An answer may come before that instruction.)
            let _ = give(&mut midway.board, course.commands[at])?;
            midway.after_cut()
        },
    )?;
    tell(report, "power cut at a random instruction of an update".into(), &found);

    let found = trials(
        (extent.random / 10).max(4),
        || Midway::new(scene),
        |midway, k| {
            midway.go(&course, course.commands.len())?;
            anyhow::ensure!(give(&mut midway.board, Command::Restart)?, "nothing stops it");
            let until = midway.board.now() + draws(seed, 12, k).random_range(0..cycles(f64::from(TRIAL_S)));
            while midway.board.now() < until {
                let next = until.min(midway.board.now() + cycles(1.0));
                run(&mut midway.board, next)?;
                if let Ok(told) = programs(&mut midway.board, 0.2) {
                    let _ = maintain(&mut midway.board, Command::Echo(told.token));
                }
            }
            midway.after_cut()
        },
    )?;
    tell(report, format!("power cut within {TRIAL_S} s of the restart into a new program"), &found);
    Ok(())
}
