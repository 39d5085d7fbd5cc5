//! Cost of a calibration on the unit, counted in the ELF.

use crate::replay::{self, Options};
use crate::symbol;
use anyhow::{Context, Result};
use hrg_core::bias::Coefficients;
use hrg_data::cost::Cost;
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use std::path::{Path, PathBuf};

/// Runs the ELF with a calibration for `seconds` and counts.
///
/// # Errors
/// A calibration that cannot be read, a firmware that the board cannot run.
pub fn cost(elf: &[u8], calibration: &Path, steps: &Steps, seconds: u64) -> Result<Cost> {
    let c = image_file::load(calibration)?;
    let options = Options {
        seconds: Some(seconds),
        count: vec![symbol::UPDATE, symbol::BIAS, symbol::CURVE],
        ..Options::default()
    };
    let outcome = replay::run(elf, Some(&c), steps, &options, |_| {})?;
    let [update, bias, curve] = &outcome.calls[..] else { anyhow::bail!("the functions were not counted") };
    Ok(Cost {
        calibration: calibration.display().to_string(),
        update_instructions: update.mean().context("no update was counted")?,
        bias_instructions: bias.mean().context("no evaluation was counted")?,
        curve_instructions: match c.axes[0].coefficients {
            Coefficients::Direct(_) if c.effects.is_empty() => 0.0,
            _ => curve.mean().context("no temperature was counted")?,
        },
        bytes: c.to_bytes().context("the calibration does not fit an image")?.len(),
        frames: outcome.received.rates.len() + outcome.received.housekeeping.len(),
        differing: outcome.received.differing as usize,
    })
}

/// The costs of several, counted as many at a time as there are cores.
///
/// # Errors
/// As [`cost`].
pub fn costs(elf: &[u8], calibrations: &[PathBuf], steps: &Steps, seconds: u64) -> Result<Vec<Cost>> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut out = Vec::new();
    for some in calibrations.chunks(cores) {
        let counted: Vec<Result<Cost>> = std::thread::scope(|s| {
            let running: Vec<_> = some.iter().map(|p| s.spawn(move || cost(elf, p, steps, seconds))).collect();
            running
                .into_iter()
                .map(|h| h.join().unwrap_or_else(|_| Err(anyhow::anyhow!("counting panicked"))))
                .collect()
        });
        for one in counted {
            out.push(one?);
        }
    }
    Ok(out)
}

/// As a table.
pub fn print(weights: &[Cost]) {
    println!("{:>14} {:>14} {:>7} {:>8} {:>10}   calibration", "f to bias", "update", "bytes", "frames", "differing");
    for w in weights {
        println!(
            "{:>14.0} {:>14.0} {:>7} {:>8} {:>10}   {}",
            w.bias_instructions + w.curve_instructions,
            w.update_instructions,
            w.bytes,
            w.frames,
            w.differing,
            w.calibration
        );
    }
    println!("f to bias: calibration curve f-T and bias model of one axis; update: three axes, all in");
    println!(
        "instructions, means of calls that no interrupt came into; differing: frames that are not those of the desktop"
    );
}
