//! Power cuts.

use super::memory::{nearest, unsaid, SETTLES_S};
use super::{cycles, draws, good, run, trials, Extent, Report, Scene, BOUND_DPH, RESTART_S};
use crate::host::{burn, running, Burn};
use crate::replay::CALIBRATION_B;
use anyhow::{Context, Result};
use hrg_core::calibration::Calibration;
use hrg_core::status::AxisStatus;
use rand::Rng;

/// The unit must answer within this time after power comes back, s.
const UP_S: f64 = 1.0;

/// Cuts at every flash operation of a burn, and at random instructions of one.
///
/// # Errors
/// Where the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let old = scene.calibration.clone();
    let mut new = old.clone();
    new.sequence = old.sequence + 1;
    for a in &mut new.axes {
        a.scale_factor_dph_per_code *= 1.5;
    }
    // Sector B holds an image from before, as it does from the second burn on.
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
    anyhow::ensure!(burn(&mut board, &new)? == Burn::Done, "an undisturbed burn");
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
            format!("old image {o}, new image {n}, neither {neither}, no answer within {UP_S} s 0"),
            neither == 0,
        );
    };
    let cuts = operations / extent.every;
    let found = trials(cuts, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_flash_operation(1 + k * extent.every);
        anyhow::ensure!(burn(board, &new)? == Burn::Stopped, "the cut did not come");
        board.power_cut()?;
        let first = running(board, UP_S)?;
        if k % 20 == 0 {
            // The burn can be done again.
            let again = Calibration { sequence: new.sequence + 1, ..new.clone() };
            anyhow::ensure!(burn(board, &again)? == Burn::Done, "the second burn");
            anyhow::ensure!(running(board, UP_S)?.calibration == again.checksum(), "the second burn is not used");
        }
        Ok(first.calibration)
    })?;
    tell(&found, report, format!("power cut within flash operation 1 to {operations}"));
    let found = trials(extent.random, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_instruction(board.instructions() + draws(seed, 1, k).random_range(0..instructions));
        anyhow::ensure!(burn(board, &new)? == Burn::Stopped, "the cut did not come");
        board.power_cut()?;
        Ok(running(board, UP_S)?.calibration)
    })?;
    tell(&found, report, "power cut at a random instruction of a burn".into());
    for cold in [false, true] {
        restarts(scene, seed, extent, cold, report)?;
    }
    Ok(())
}

/// How a unit starts anew in a ramp, at a random instruction: its program resets it, or the power is cut.
fn restarts(scene: &Scene, seed: u64, extent: &Extent, cold: bool, report: &mut Report) -> Result<()> {
    let watched_s = RESTART_S + SETTLES_S;
    let outcomes = trials(
        (extent.random / 50).max(2),
        || {
            let mut board = scene.settled()?;
            let truth = scene.undisturbed(&mut board, watched_s + 3.0)?;
            let start = board.snapshot()?;
            Ok((board, start, truth))
        },
        |(board, start, truth), k| {
            board.restore(start)?;
            let before = board.now();
            board.run_until(before + draws(seed, 3, k).random_range(cycles(1.0)..cycles(2.0)))?;
            if cold {
                board.power_cut()?;
            } else {
                board.reset_by_software()?;
            }
            let at = board.now();
            run(board, at + cycles(watched_s))?;
            let sent = &board.world.received;
            let mut unflagged_dph = 0.0f32;
            for (f, t) in sent.rates.iter().zip(&sent.rate_at).filter(|(_, t)| **t > at) {
                let Some(truth) = truth.rates.get(nearest(truth, *t)) else { continue };
                unflagged_dph = unflagged_dph.max(unsaid(f, truth));
            }
            let last = sent.rates.last().context("rates after a restart")?;
            let unknown = last.axis_status.iter().all(|s| s.contains(AxisStatus::HISTORY_UNKNOWN));
            Ok((unflagged_dph, if cold { unknown } else { good(last) }))
        },
    )?;
    let worst = outcomes.iter().map(|o| o.0).fold(0.0, f32::max);
    let as_wanted = outcomes.iter().filter(|o| o.1).count();
    let (what, wanted) = if cold {
        ("power cut in a ramp, at a random instruction", "flagged history-unknown")
    } else {
        ("reset by the program in a ramp, at a random instruction", "good")
    };
    report.row(
        what,
        outcomes.len() as u64,
        format!(
            "{wanted} {watched_s:.0} s later {as_wanted}; unflagged error at most {worst:.3} deg/h, from the start on"
        ),
        worst <= BOUND_DPH && as_wanted == outcomes.len(),
    );
    Ok(())
}
