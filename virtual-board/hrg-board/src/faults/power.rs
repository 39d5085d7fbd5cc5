//! Power cuts.

use super::{cycles, draws, run, trials, Extent, Report, Scene};
use crate::replay::CALIBRATION_B;
use crate::wires::Wires;
use anyhow::{Context, Result};
use hrg_core::calibration::Calibration;
use hrg_core::link::{Identity, Message};
use hrg_core::maintenance::{chunks, Command, Reply};
use rand::Rng;
use virtual_board::{Board, Stop};

/// The unit must answer within this time after power comes back, s.
const UP_S: f64 = 1.0;

/// How a burn ended.
enum Burn {
    Done,
    /// The board stopped where it was told to.
    Stopped,
}

/// A slice of waiting for an answer, s.
const SLICE_S: f64 = 0.002;

/// Sends a command and waits for its answer; `None`: the board stopped.
fn ask<T>(
    board: &mut Board<Wires>,
    message: &Message,
    seconds: f64,
    pick: impl Fn(&Message) -> Option<T>,
) -> Result<Option<T>> {
    board.world.hear(&message.encode());
    board.poll_link();
    let end = board.now() + cycles(seconds);
    while board.now() < end {
        match board.run_until(board.now() + cycles(SLICE_S))? {
            Stop::Instruction | Stop::Flash => return Ok(None),
            Stop::Time | Stop::Watchdog | Stop::Software => {}
        }
        if let Some(t) = board.world.received.other.drain(..).find_map(|m| pick(&m)) {
            return Ok(Some(t));
        }
    }
    anyhow::bail!("no answer to {message:?} within {seconds} s")
}

fn burn(board: &mut Board<Wires>, block: &Calibration) -> Result<Burn> {
    let bytes = block.to_bytes().context("fits")?;
    let begin = [Command::Open(block.unit), Command::Begin(bytes.len() as u16)];
    for command in begin.into_iter().chain(chunks(&bytes)).chain([Command::End, Command::Restart]) {
        let answer = ask(board, &Message::Maintain(command), 3.0, |m| match m {
            Message::Maintained(Reply::Answer(answer, _)) => Some(*answer),
            _ => None,
        })?;
        match answer {
            None => return Ok(Burn::Stopped),
            Some(hrg_core::maintenance::Answer::Done) => {}
            Some(other) => anyhow::bail!("{command:?}: {other}"),
        }
    }
    // The restart comes 20 ms after its answer; then the unit starts.
    let end = board.now() + cycles(0.2);
    loop {
        match board.run_until(end)? {
            Stop::Time => return Ok(Burn::Done),
            Stop::Instruction | Stop::Flash => return Ok(Burn::Stopped),
            Stop::Watchdog | Stop::Software => {}
        }
    }
}

/// Which block the unit runs after its power came back.
fn running(board: &mut Board<Wires>) -> Result<Identity> {
    // What was on its way in is lost with the power.
    board.world.silence();
    board.world.received = crate::wires::Received::default();
    run(board, board.now() + cycles(0.03))?;
    let identity = ask(board, &Message::Identify, UP_S, |m| match m {
        Message::Identity(i) => Some(*i),
        _ => None,
    })?;
    identity.context("it stopped")
}

/// Cuts at every flash operation of a burn, and at random instructions of one.
///
/// # Errors
/// Where the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let old = scene.calibration.clone();
    let mut new = old.clone();
    new.sequence = old.sequence + 1;
    for a in &mut new.axes {
        a.rate_scale_dph *= 1.5;
    }
    // Sector B holds a block from before, as it does from the second burn on.
    let mut older = old.clone();
    older.sequence = old.sequence.wrapping_sub(1);
    let ready = || -> Result<_> {
        let mut board = scene.off(scene.wires(), &old)?;
        board.write_flash(CALIBRATION_B, &older.to_bytes().context("fits")?)?;
        run(&mut board, cycles(0.1))?;
        let start = board.snapshot()?;
        Ok((board, start))
    };
    let (mut board, _) = ready()?;
    let (operations, instructions) = (board.flash_operations(), board.instructions());
    anyhow::ensure!(matches!(burn(&mut board, &new)?, Burn::Done), "an undisturbed burn");
    let operations = board.flash_operations() - operations;
    let instructions = board.instructions() - instructions;

    let sums = |(o, n): (u32, u32), t: &u32| match *t {
        c if c == old.checksum() => (o + 1, n),
        c if c == new.checksum() => (o, n + 1),
        _ => (o, n),
    };
    let tell = |found: &[u32], report: &mut Report, what: String| {
        let (o, n) = found.iter().fold((0, 0), sums);
        let neither = found.len() as u32 - o - n;
        report.row(
            what,
            found.len() as u64,
            format!("old block {o}, new block {n}, neither {neither}, no answer within {UP_S} s 0"),
            neither == 0,
        );
    };
    let cuts = operations / extent.every;
    let found = trials(cuts, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_flash_operation(1 + k * extent.every);
        anyhow::ensure!(matches!(burn(board, &new)?, Burn::Stopped), "the cut did not come");
        board.power_cut()?;
        let first = running(board)?;
        if k % 20 == 0 {
            // The burn can be done again.
            let again = Calibration { sequence: new.sequence + 1, ..new.clone() };
            anyhow::ensure!(matches!(burn(board, &again)?, Burn::Done), "the second burn");
            anyhow::ensure!(running(board)?.calibration == again.checksum(), "the second burn is not used");
        }
        Ok(first.calibration)
    })?;
    tell(&found, report, format!("power cut within flash operation 1 to {operations}"));
    let found = trials(extent.random, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_instruction(board.instructions() + draws(seed, 1, k).random_range(0..instructions));
        anyhow::ensure!(matches!(burn(board, &new)?, Burn::Stopped), "the cut did not come");
        board.power_cut()?;
        Ok(running(board)?.calibration)
    })?;
    tell(&found, report, "power cut at a random instruction of a burn".into());
    Ok(())
}
