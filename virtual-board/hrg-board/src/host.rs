//! The host's end of the link, in step with the board: what a test engineer's computer asks of the unit.

use crate::wires::{Received, Wires};
use anyhow::{Context, Result};
use hrg_core::calibration::Calibration;
use hrg_core::link::{Identity, Message};
use hrg_core::maintenance::{self, Answer, Command, Reply};
use hrg_core::output::OutputSettings;
use hrg_core::self_test::Item;
use hrg_core::signature::SIGNATURE;
use hrg_core::slots;
use hrg_core::unit_name::UnitName;
use hrg_core::update::{self, Programs};
use virtual_board::{Board, Stop, CPU_HZ};

/// The unit answers a command within this time, an erase among them, s.
const ANSWER_S: f64 = 3.0;
/// The built-in test takes less than this, where parts do not answer, s.
const TEST_S: f64 = 20.0;

/// A slice of waiting for an answer, in cycles of the CPU.
const SLICE: u64 = CPU_HZ / 500;

/// End of a burn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Burn {
    /// The unit runs the new image.
    Done,
    /// The board stopped where it was told to.
    Stopped,
}

/// Sends a message and waits for its answer; `None`: the board stopped where it was told to.
///
/// # Errors
/// If no answer comes in time.
pub fn ask<T>(
    board: &mut Board<Wires>,
    message: &Message,
    seconds: f64,
    pick: impl Fn(&Message) -> Option<T>,
) -> Result<Option<T>> {
    board.world.hear(&message.encode());
    board.poll_link();
    let end = board.now() + cycles(seconds);
    while board.now() < end {
        match board.run_until(board.now() + SLICE)? {
            Stop::Instruction | Stop::Flash | Stop::Exit(_) => return Ok(None),
            Stop::Time | Stop::Watchdog | Stop::Software => {}
        }
        if let Some(t) = board.world.received.other.drain(..).find_map(|m| pick(&m)) {
            return Ok(Some(t));
        }
    }
    anyhow::bail!("no answer to {message:?} within {seconds} s")
}

/// A command of the maintenance mode and the unit's answer; `None`: the board stopped where it was told to.
///
/// # Errors
/// As [`ask`].
pub fn maintain(board: &mut Board<Wires>, command: Command) -> Result<Option<Answer>> {
    Ok(maintained(board, command)?.map(|(answer, _)| answer))
}

/// The same with the number that comes with the answer.
fn maintained(board: &mut Board<Wires>, command: Command) -> Result<Option<(Answer, u32)>> {
    ask(board, &Message::Maintain(command), ANSWER_S, |m| match m {
        Message::Maintained(Reply::Answer(answer, value)) => Some((*answer, *value)),
        _ => None,
    })
}

/// End of sending a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sent {
    /// The unit tries it from its next start on.
    Committed,
    /// The unit refuses it.
    Refused(Answer),
    /// The board stopped where it was told to.
    Stopped,
}

/// A program for the slot that does not run, from its head on.
#[derive(Debug, Clone)]
pub struct Program {
    /// From its head on.
    pub body: Vec<u8>,
    /// Its signature.
    pub signature: [u8; SIGNATURE],
}

/// Sends a program, as `hrg unit update` does. `between` is called before each command, with the bytes that the unit has.
///
/// # Errors
/// If the unit does not answer.
pub fn send_program(
    board: &mut Board<Wires>,
    unit: UnitName,
    program: &Program,
    mut between: impl FnMut(&mut Board<Wires>, u32) -> Result<()>,
) -> Result<Sent> {
    let mut done = |board: &mut Board<Wires>, command: Command, there: u32| -> Result<Result<u32, Sent>> {
        between(board, there)?;
        Ok(match maintained(board, command)? {
            None => Err(Sent::Stopped),
            Some((Answer::Done, value)) => Ok(value),
            Some((answer, _)) => Err(Sent::Refused(answer)),
        })
    };
    let (length, sum) = (program.body.len() as u32, slots::sum(&program.body));
    if let Err(end) = done(board, Command::Open(unit), 0)? {
        return Ok(end);
    }
    let mut next = loop {
        match done(board, Command::Program { length, sum }, 0)? {
            Ok(next) => break next,
            Err(Sent::Refused(Answer::More)) => {}
            Err(end) => return Ok(end),
        }
    };
    while let Some(command) = update::piece(&program.body, next) {
        match done(board, command, next)? {
            Ok(there) => next = there,
            Err(end) => return Ok(end),
        }
    }
    Ok(match done(board, Command::Commit(program.signature), length)? {
        Ok(_) => Sent::Committed,
        Err(end) => end,
    })
}

/// Programs of the unit, asked now.
///
/// # Errors
/// If it does not answer.
pub fn programs(board: &mut Board<Wires>, seconds: f64) -> Result<Programs> {
    let found = ask(board, &Message::Identify, seconds, |m| match m {
        Message::Programs(programs) => Some(*programs),
        _ => None,
    })?;
    found.context("the board stopped")
}

/// Has the unit test itself, and gives the items; `None`: the board stopped where it was told to.
///
/// # Errors
/// If the unit refuses, or does not answer.
pub fn self_test(board: &mut Board<Wires>, unit: UnitName) -> Result<Option<Vec<Item>>> {
    let Some(opened) = maintain(board, Command::Open(unit))? else { return Ok(None) };
    anyhow::ensure!(opened == Answer::Done, "maintenance mode: {opened}");
    let done = ask(board, &Message::Maintain(Command::Test), TEST_S, |m| match m {
        Message::Maintained(Reply::TestDone(items)) => Some(*items),
        _ => None,
    })?;
    let Some(count) = done else { return Ok(None) };
    let mut items = Vec::new();
    for number in 0..count {
        let item = ask(board, &Message::Maintain(Command::Tested(number)), ANSWER_S, |m| match m {
            Message::Maintained(Reply::Tested { number: n, item }) if *n == number => Some(*item),
            _ => None,
        })?;
        let Some(item) = item else { return Ok(None) };
        items.push(item);
    }
    Ok(Some(items))
}

/// Burns an image and restarts the unit.
///
/// # Errors
/// If the unit refuses a command, or does not answer.
pub fn burn(board: &mut Board<Wires>, image: &Calibration) -> Result<Burn> {
    let bytes = image.to_bytes().context("the image does not fit")?;
    for command in maintenance::burn(image.unit, &bytes).chain([Command::Restart]) {
        match maintain(board, command)? {
            None => return Ok(Burn::Stopped),
            Some(Answer::Done) => {}
            Some(other) => anyhow::bail!("{command:?}: {other}"),
        }
    }
    // The restart comes 20 ms after its answer; then the unit starts.
    let end = board.now() + cycles(0.2);
    loop {
        match board.run_until(end)? {
            Stop::Time => return Ok(Burn::Done),
            Stop::Instruction | Stop::Flash | Stop::Exit(_) => return Ok(Burn::Stopped),
            Stop::Watchdog | Stop::Software => {}
        }
    }
}

/// Identity of a unit, with its image, at most `seconds` after its power came back.
///
/// # Errors
/// If it does not answer by then.
pub fn running(board: &mut Board<Wires>, seconds: f64) -> Result<Identity> {
    // Bytes on their way in are lost with the power.
    board.world.missing_s();
    board.world.received = Received::default();
    // Not before the receiver listens.
    while !matches!(board.run_until(board.now() + cycles(0.03))?, Stop::Time) {}
    let identity = ask(board, &Message::Identify, seconds, |m| match m {
        Message::Identity(i) => Some(*i),
        _ => None,
    })?;
    identity.context("the board stopped")
}

/// Has the unit of a name send by these settings; they hold from the end of a second on, and two seconds have gone by after it.
///
/// # Errors
/// If the unit refuses them, or the board does not model what it does.
pub fn set_output(board: &mut Board<Wires>, unit: UnitName, settings: OutputSettings) -> Result<()> {
    for command in [Command::Open(unit), Command::Output(settings), Command::Close] {
        let answer = maintain(board, command)?;
        anyhow::ensure!(answer == Some(Answer::Done), "{command:?}: {answer:?}");
    }
    board.run_until(board.now() + cycles(1.2))?;
    board.world.set_output(settings);
    Ok(())
}

/// Seconds as cycles.
pub fn cycles(seconds: f64) -> u64 {
    (seconds * CPU_HZ as f64) as u64
}
