//! Power cuts.

use super::memory::{nearest, unsaid, SETTLES_S};
use super::{draws, good, run, trials, Extent, Report, Scene, BOUND_DPH, RESTART_S};
use anyhow::{Context, Result};
use hrg_board::host::cycles;
use hrg_board::host::{burn, running, Burn};
use hrg_board::replay::{CALIBRATION_A, CALIBRATION_B};
use hrg_board::wires::Wires;
use hrg_core::calibration::{Calibration, COMMIT, REFUSED};
use hrg_core::sectors::{room, STEP};
use hrg_core::status::AxisStatus;
use rand::Rng;
use virtual_board::Board;

/// The unit must answer within this time after power comes back, s.
const UP_S: f64 = 1.0;

/// State of the flash before a burn.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Case {
    /// Room behind the image in use.
    Appended,
    /// The same, with an image between whose burn was cut short.
    BehindTorn,
    /// No room: the other sector, which holds an older image, is erased.
    Erased,
}

const CASES: [(Case, &str); 3] =
    [(Case::Appended, "appended"), (Case::BehindTorn, "appended behind a torn one"), (Case::Erased, "with an erase")];

/// A board that is just being switched on: in sector A an older image and the one in use, and what belongs to the case.
fn prepared(scene: &Scene, case: Case) -> Result<Board<Wires>> {
    let numbered = |back: u32| -> Result<Vec<u8>> {
        let sequence = scene.calibration.sequence.wrapping_sub(back);
        let image = Calibration { sequence, ..scene.calibration.clone() };
        Ok(image.to_bytes().context("fits")?.to_vec())
    };
    let mut board = scene.off(
        scene.wires(),
        &Calibration { sequence: scene.calibration.sequence.wrapping_sub(1), ..scene.calibration.clone() },
    )?;
    let own = numbered(0)?;
    let step = room(own.len()) as u32;
    board.write_flash(CALIBRATION_A + step, &own)?;
    match case {
        Case::Appended => {}
        Case::BehindTorn => board.write_flash(CALIBRATION_A + 2 * step + COMMIT as u32, &own[COMMIT..own.len() / 2])?,
        Case::Erased => {
            board.write_flash(CALIBRATION_B, &numbered(2)?)?;
            board.write_flash(CALIBRATION_B - STEP as u32, &REFUSED)?;
        }
    }
    Ok(board)
}

/// Cuts at every flash operation of a burn, and at random instructions of one.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    for (k, (case, name)) in CASES.into_iter().enumerate() {
        burns(scene, seed.wrapping_add(k as u64), extent, case, name, report)?;
    }
    for cold in [false, true] {
        restarts(scene, seed, extent, cold, report)?;
    }
    Ok(())
}

fn burns(scene: &Scene, seed: u64, extent: &Extent, case: Case, name: &str, report: &mut Report) -> Result<()> {
    let old = scene.calibration.clone();
    let mut new = old.clone();
    new.sequence = old.sequence + 1;
    for a in &mut new.axes {
        a.scale_factor_dph_per_code *= 1.5;
    }
    let ready = || -> Result<_> {
        let mut board = prepared(scene, case)?;
        run(&mut board, cycles(0.1))?;
        let start = board.snapshot()?;
        Ok((board, start))
    };
    let (mut board, _) = ready()?;
    let (operations, instructions, before) = (board.flash_operations(), board.instructions(), board.now());
    anyhow::ensure!(burn(&mut board, &new)? == Burn::Done, "an undisturbed burn");
    let stood_still = board.now() - before > cycles(0.4);
    anyhow::ensure!(stood_still == (case == Case::Erased), "an erase where there is no room, and only there");
    let operations = board.flash_operations() - operations;
    let instructions = board.instructions() - instructions;

    let tell = |found: &[Option<u32>], report: &mut Report, what: String| {
        let count = |checksum: Option<u32>| found.iter().filter(|f| **f == checksum).count();
        let (o, n, silent) = (count(Some(old.checksum())), count(Some(new.checksum())), count(None));
        let neither = found.len() - o - n - silent;
        report.row(
            what,
            found.len() as u64,
            format!("old image {o}, new image {n}, neither {neither}, no answer within {UP_S} s {silent}"),
            neither + silent == 0,
        );
    };
    let cuts = (operations / extent.every).max(1);
    let found = trials(cuts, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_flash_operation(1 + k * extent.every);
        anyhow::ensure!(burn(board, &new)? == Burn::Stopped, "the cut did not come");
        board.power_cut()?;
        let first = running(board, UP_S).ok();
        if k % 20 == 0 {
            // The burn can be done again.
            let again = Calibration { sequence: new.sequence + 1, ..new.clone() };
            anyhow::ensure!(burn(board, &again)? == Burn::Done, "the second burn");
            anyhow::ensure!(running(board, UP_S)?.calibration == again.checksum(), "the second burn is not used");
        }
        Ok(first.map(|i| i.calibration))
    })?;
    tell(&found, report, format!("power cut within flash operation 1 to {operations} of a burn, {name}"));
    let found = trials(extent.random / CASES.len() as u64, ready, |(board, start), k| {
        board.restore(start)?;
        board.stop_at_instruction(board.instructions() + draws(seed, 1, k).random_range(0..instructions));
        anyhow::ensure!(burn(board, &new)? == Burn::Stopped, "the cut did not come");
        board.power_cut()?;
        Ok(running(board, UP_S).ok().map(|i| i.calibration))
    })?;
    tell(&found, report, format!("power cut at a random instruction of a burn, {name}"));
    Ok(())
}

/// Restarts a unit in a ramp, at a random instruction: its program resets it, or the power is cut.
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
