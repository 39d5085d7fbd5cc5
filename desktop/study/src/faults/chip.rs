//! Faults of the chip and of the parts soldered beside it: ADC, crystal, supply, program, starts that follow each other.

use super::memory::{nearest, unsaid, SETTLES_S};
use super::{draws, good, run, trials, Extent, Report, Scene, BOUND_DPH, RESTART_S};
use anyhow::{Context, Result};
use hrg_board::host::burn;
use hrg_board::host::cycles;
use hrg_board::wires::WireFaults;
use hrg_core::adc::{READ_EVERY, SETTINGS};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::supervision::LOOK_MS;
use rand::Rng;
use virtual_board::{AdcMishap, Firmware, FLASH_START};

/// A setting of the ADC is read back within so many seconds, and written again within some twenty frames more.
const SETTINGS_S: f64 = READ_EVERY as f64 * SETTINGS.len() as f64 / 1000.0 + 0.2;

/// A change of the ADC's registers stands in its status with the next frame: the wrong sample may be in a rate frame that has gone out by then, s.
const NOTICED_S: f64 = 0.012;

/// The program is gone through within half of this, and a bit behind the place that is looked at waits for the next pass: pieces of 256 words
/// (`firmware/src/program.rs`), one each look, of 208 KiB at most.
const PROGRAM_S: f64 = 2.0 * (208 * 1024 / 4 / 256) as f64 * LOOK_MS as f64 / 1000.0;

/// All of these.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn attack(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    adc(scene, seed, extent, report)?;
    program(scene, seed, extent, report)?;
    crystal(scene, report)?;
    slow_crystal(scene, report)?;
    supply(scene, report)?;
    restarts(scene, report)
}

/// The ADC loses its settings, one of them changes, its bus slips.
fn adc(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let n = (extent.random / 50).max(3);
    let found = trials(
        n,
        || {
            let mut board = scene.settled()?;
            let truth = scene.undisturbed(&mut board, SETTINGS_S + 4.0)?;
            let start = board.snapshot()?;
            Ok((board, start, truth))
        },
        |(board, start, truth), k| {
            board.restore(start)?;
            let mut draw = draws(seed, 8, k);
            let mishap = match k % 3 {
                0 => AdcMishap::LosesSettings,
                1 => AdcMishap::SlipsAByte,
                // MODE to the last of the channels' registers.
                _ => AdcMishap::Flips(draw.random_range(0x02..=0x30), draw.random_range(0..16)),
            };
            let begin = board.now();
            let at = begin + draw.random_range(cycles(0.5)..cycles(1.5));
            let at_s = at as f64 / virtual_board::CPU_HZ as f64;
            board.world.set_faults(WireFaults { adc_mishaps: vec![(at_s, mishap)], ..WireFaults::default() });
            run(board, at + cycles(SETTINGS_S + 2.0))?;
            let sent = &board.world.received;
            let (mut flagged, mut worst) = (None, 0.0f32);
            for (f, t) in sent.rates.iter().zip(&sent.rate_at).filter(|(_, t)| **t > at) {
                if f.unit_status.contains(UnitStatus::ADC_FAULT) {
                    flagged = Some((*t - at) as f64 / virtual_board::CPU_HZ as f64);
                }
                let counts = *t > at + cycles(NOTICED_S);
                if let Some(truth) = truth.rates.get(nearest(truth, *t)).filter(|_| counts) {
                    worst = worst.max(unsaid(f, truth));
                }
            }
            Ok((flagged, worst, sent.rates.last().is_some_and(good)))
        },
    )?;
    let last = found.iter().filter_map(|f| f.0).fold(0.0, f64::max);
    let silent = found.iter().filter(|f| f.0.is_none()).count();
    let worst = found.iter().map(|f| f.1).fold(0.0, f32::max);
    let well = found.iter().filter(|f| f.2).count();
    report.row(
        "ADC loses its settings, or one bit of them, or its bus slips",
        n,
        format!(
            "flagged until {last:.2} s later at the latest, not flagged {silent}; good again {well}; from 12 ms on unflagged error at most {worst:.3} deg/h"
        ),
        silent == 0 && well == found.len() && last <= SETTINGS_S && worst <= BOUND_DPH,
    );
    Ok(())
}

/// A bit of the program in flash.
fn program(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    let n = (extent.random / 100).max(4);
    let firmware = Firmware::parse(scene.elf())?;
    let places: Vec<u32> = (0..0x4_0000).filter(|at| firmware.flash()[*at as usize] != 0xFF).collect();
    let found = trials(
        n,
        || {
            let mut board = scene.settled()?;
            let truth = scene.undisturbed(&mut board, PROGRAM_S + 1.0)?;
            let start = board.snapshot()?;
            Ok((board, start, truth))
        },
        |(board, start, truth), k| {
            board.restore(start)?;
            let mut draw = draws(seed, 9, k);
            let at = board.now();
            board.flip_bit(FLASH_START + places[draw.random_range(0..places.len())], draw.random_range(0..8))?;
            let resets = run(board, at + cycles(PROGRAM_S))?.n;
            let sent = &board.world.received;
            let printed = sent.rates.iter().any(|f| f.unit_status.contains(UnitStatus::PROGRAM));
            let mut worst = 0.0f32;
            for (f, t) in sent.rates.iter().zip(&sent.rate_at) {
                if let Some(truth) = truth.rates.get(nearest(truth, *t)).filter(|_| f.unit_status.is_empty()) {
                    worst = worst.max(unsaid(f, truth));
                }
            }
            let stopped = sent.rate_at.last().is_none_or(|t| at + cycles(PROGRAM_S) - t > cycles(0.1));
            Ok((printed, resets > 0 || stopped || board.faults() > 0, worst))
        },
    )?;
    let printed = found.iter().filter(|f| f.0).count();
    let stopped = found.iter().filter(|f| !f.0 && f.1).count();
    let wrong = found.iter().filter(|f| f.2 > BOUND_DPH).count();
    report.row(
        "bit of the program in flash, while it runs",
        n,
        format!(
            "flagged within {PROGRAM_S:.0} s {printed}, stopped or reset before {stopped}, neither {}; rates off before they were flagged {wrong}",
            found.len() - printed - stopped
        ),
        printed + stopped == found.len(),
    );
    Ok(())
}

/// The crystal stops, or is another one.
fn crystal(scene: &Scene, report: &mut Report) -> Result<()> {
    let mut board = scene.settled()?;
    let at = board.now();
    board.stop_crystal();
    let resets = run(&mut board, at + cycles(RESTART_S + 2.0))?.n;
    let sent = &board.world.received;
    let back = sent.rate_at.iter().find(|t| **t > at + cycles(0.1)).context("rates after the restart")?;
    let flagged = sent.rates.iter().zip(&sent.rate_at).filter(|(_, t)| *t >= back);
    let flagged = flagged.clone().all(|(f, _)| f.unit_status.contains(UnitStatus::TIMEBASE));
    let back_s = (back - at) as f64 / virtual_board::CPU_HZ as f64;
    report.row(
        "crystal stops",
        1,
        format!(
            "{resets} reset, rates again after {back_s:.1} s, all flagged timebase: {}",
            if flagged { "yes" } else { "no" }
        ),
        resets == 1 && flagged && back_s <= RESTART_S,
    );
    let wrong = [0.5, 0.8, 0.87, 1.15, 1.25, 1.5, 2.0, 3.125];
    let mut found = 0;
    for share in wrong {
        let mut board = scene.off(scene.wires(), &scene.calibration)?;
        board.set_crystal(8e6 * share);
        run(&mut board, cycles(2.0))?;
        let rates = &board.world.received.rates;
        found += usize::from(!rates.is_empty() && rates.iter().all(|f| f.unit_status.contains(UnitStatus::TIMEBASE)));
    }
    report.row(
        "crystal of another frequency (4 to 25 MHz)",
        wrong.len() as u64,
        format!("flagged timebase in every frame {found}"),
        found == wrong.len(),
    );
    Ok(())
}

/// The crystal takes its time to start: 2 ms are typical; the unit waits for more than 20.
fn slow_crystal(scene: &Scene, report: &mut Report) -> Result<()> {
    let mut rows = Vec::new();
    for (start_ms, used) in [(0.1, true), (2.0, true), (10.0, true), (100.0, false), (1e4, false)] {
        let mut board = scene.off(scene.wires(), &scene.calibration)?;
        board.set_crystal_start((start_ms * 1e-3 * virtual_board::CPU_HZ as f64) as u64);
        run(&mut board, cycles(2.0))?;
        let rates = &board.world.received.rates;
        let flagged = rates.iter().filter(|f| f.unit_status.contains(UnitStatus::TIMEBASE)).count();
        rows.push((start_ms, !rates.is_empty() && flagged == if used { 0 } else { rates.len() }));
    }
    let right = rows.iter().filter(|r| r.1).count();
    report.row(
        "crystal that starts after 0.1 ms to 10 s",
        rows.len() as u64,
        format!("used where it starts within 20 ms, flagged timebase in every frame where it does not: {right}"),
        right == rows.len(),
    );
    Ok(())
}

/// The supply sags while a calibration is written.
fn supply(scene: &Scene, report: &mut Report) -> Result<()> {
    let mut board = scene.off(scene.wires(), &scene.calibration)?;
    run(&mut board, cycles(1.0))?;
    let mut new = scene.calibration.clone();
    new.sequence += 1;
    board.sag(6);
    let operations = board.flash_operations();
    let refused = burn(&mut board, &new).is_err();
    let untouched = board.flash_operations() == operations;
    board.sag(0);
    let done = burn(&mut board, &new).is_ok();
    report.row(
        "burn at 2.7 V",
        1,
        format!(
            "{}, flash {}; burnt when the supply is back: {}",
            if refused { "refused" } else { "not refused" },
            if untouched { "not touched" } else { "touched" },
            if done { "yes" } else { "no" }
        ),
        refused && untouched && done,
    );
    Ok(())
}

/// Starts that follow each other too fast for a model step.
fn restarts(scene: &Scene, report: &mut Report) -> Result<()> {
    let mut board = scene.settled()?;
    let truth = scene.undisturbed(&mut board, SETTLES_S + 8.0)?;
    let mut outcome = Vec::new();
    let start = board.snapshot()?;
    for resets in 1..=6u32 {
        board.restore(&start)?;
        for _ in 0..resets {
            board.reset_by_software()?;
            let now = board.now();
            run(&mut board, now + cycles(0.5))?;
        }
        let at = board.now();
        run(&mut board, at + cycles(SETTLES_S))?;
        let sent = &board.world.received;
        let worst = sent.rates.iter().zip(&sent.rate_at).filter(|(_, t)| **t > at).fold(0.0f32, |worst, (f, t)| {
            truth.rates.get(nearest(&truth, *t)).map_or(worst, |truth| worst.max(unsaid(f, truth)))
        });
        let unknown = sent.rates.last().is_some_and(|f| f.axis_status[0].contains(AxisStatus::HISTORY_UNKNOWN));
        outcome.push((worst, unknown));
    }
    let worst = outcome.iter().map(|o| o.0).fold(0.0, f32::max);
    let unknown = outcome.iter().filter(|o| o.1).count();
    report.row(
        "one to six starts, half a second apart",
        outcome.len() as u64,
        format!("history-unknown after {unknown} of them; unflagged error at most {worst:.3} deg/h"),
        worst <= BOUND_DPH && unknown == 3,
    );
    Ok(())
}
