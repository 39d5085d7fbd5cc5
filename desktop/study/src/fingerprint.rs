//! Fingerprints of what the project computes: run before and after a change that should change nothing, and compare.
//!
//! Each line names a result, its length in bytes and its CRC-64: a recording, calibration images and files of every kind of bias
//! model, a corrected recording, and each kind of frame that the ELF sends while it plays the recording. All draws have fixed
//! seeds and all images a fixed date, so two machines print the same.
//!
//! Frames and log depend on the instant at which the firmware starts the timer, so an ELF that starts up faster prints others. To
//! compare the computation alone, keep the ELF of before and give it with `--elf`: the core on the desktop then has to make the very
//! frames that the old ELF sends.

use anyhow::{Context, Result};
use hrg_board::replay::{self, Options};
use hrg_core::calibration::Calibration;
use hrg_core::link::Message;
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use hrg_identify::fit::correct;
use hrg_identify::fit::prepare;
use hrg_papers::method::Method;
use hrg_papers::methods::identify;
use hrg_simulate::{Kind, Plan, Profile};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Seconds that the ELF runs.
const SECONDS: u64 = 60;
/// The date in every image.
const CREATED_UNIX_S: u32 = 1_700_000_000;

const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);

fn line(out: &mut String, name: &str, bytes: &[u8]) {
    let _ = writeln!(out, "{:016x} {:>9}  {name}", CRC.checksum(bytes), bytes.len());
}

/// Frames as they go over the link.
fn frames(messages: impl Iterator<Item = Message>) -> Vec<u8> {
    messages.flat_map(|m| m.encode()).collect()
}

/// The fingerprints of files, by their names without their folders.
///
/// # Errors
/// If one cannot be read.
pub fn of_files(files: &[PathBuf]) -> Result<String> {
    let mut out = String::new();
    for file in files {
        let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
        line(&mut out, &file.file_name().unwrap_or_default().to_string_lossy(), &bytes);
    }
    Ok(out)
}

/// Fingerprints of all that is computed with this firmware.
///
/// # Errors
/// If a simulated run cannot be fitted, or the firmware cannot be run.
pub fn fingerprints(elf: &[u8]) -> Result<String> {
    let simulated = |kind, profile: &str| -> Result<_> {
        let plan = Plan { kind, ..Plan::of(Profile::parse(profile)?, 11, 12) };
        Ok(plan.simulate().recording)
    };
    let (hrg, fog) = (simulated(Kind::Hrg, "cycle")?, simulated(Kind::Fog, "wu")?);
    let mut out = String::new();
    line(&mut out, "recording, simulated", hrg.to_csv().as_bytes());
    line(&mut out, "image, default", &Calibration::uncalibrated().to_bytes().context("fits an image")?);
    let (hrg_fit, fog_fit) = (prepare(std::slice::from_ref(&hrg))?, prepare(&[fog])?);
    for (method, prepared) in [
        (Method::Lsq, &hrg_fit),
        (Method::TwoSets, &hrg_fit),
        (Method::FogLsq, &fog_fit),
        (Method::Direct, &hrg_fit),
        (Method::GaBp, &hrg_fit),
    ] {
        let mut calibration = identify(prepared, method, 1)?.calibration;
        calibration.created_unix_s = CREATED_UNIX_S;
        line(&mut out, &format!("image, {method}"), &calibration.to_bytes().context("fits an image")?);
        line(&mut out, &format!("calibration file, {method}"), image_file::to_text(&calibration).as_bytes());
        let options = Options { seconds: Some(SECONDS), ..Options::default() };
        let outcome = replay::run(elf, Some(&calibration), &Steps::new(&hrg)?, &options, |_| {})?;
        let received = &outcome.received;
        anyhow::ensure!(received.differing == 0, "{method}: the ELF and the desktop differ");
        line(&mut out, &format!("rate frames, {method}"), &frames(received.rates.iter().copied().map(Message::Rate)));
        let housekeeping = received.housekeeping.iter().copied().map(Message::Housekeeping);
        line(&mut out, &format!("housekeeping, {method}"), &frames(housekeeping));
        line(&mut out, &format!("log, {method}"), received.log.join("\n").as_bytes());
        let corrected = correct::recording(&calibration, &hrg)?;
        let text = correct::to_csv(&hrg, "fingerprint", 0.0, Some(&calibration), &corrected.seconds);
        line(&mut out, &format!("corrected recording, {method}"), text.as_bytes());
    }
    Ok(out)
}
