//! `hrg correct`.

use crate::facts::FactsArguments;
use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg_core::status::AxisStatus;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::numeric::stats::median;
use hrg_data::recording::metadata::Attitude;
use hrg_data::recording::{facts, parquet, plausible, Recording};
use hrg_identify::fit::correct;
use std::path::PathBuf;

/// Arguments of `hrg correct`.
#[derive(Args)]
pub struct Arguments {
    /// Recording of raw rates.
    recording: PathBuf,
    /// Calibration.
    #[arg(short, long)]
    calibration: PathBuf,
    /// Use a calibration of another unit.
    #[arg(long)]
    different_units: bool,
    /// File for the corrected recording: text, or Parquet if it ends in .parquet
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    facts: FactsArguments,
}

/// Corrects a recording as a unit does.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { recording, calibration, different_units, out, facts: given } = arguments;
    let c = image_file::load(calibration)?;
    let here = |e: BadInput| BadInput::new(format!("{}: {e}", recording.display()));
    let bytes = parquet::read_text(recording)?;
    let mut r = Recording::parse(&bytes).map_err(here)?;
    given.apply(&mut r)?;
    let mut notes = facts::fits(&c, &r, *different_units).map_err(|e| here(e.into()))?;
    let corrected = with_a_bar("correcting", || correct::recording(&c, &r)).map_err(here)?;
    notes.extend(corrected.notes);
    let mut seconds = corrected.seconds;
    if let Some(parts) = given.earth_rate_dph()? {
        for s in &mut seconds {
            take_off(&mut s.corrected_dph, parts);
            take_off(&mut s.raw_dph, parts);
        }
        r.earth_rate_dph = Some(parts);
        notes.push("the earth's rate is taken off the rates, corrected and raw: a unit sends them with it".to_string());
    }
    let constants = [0, 1, 2].map(|a| {
        let seen = seconds.iter().skip(1).map(|s| f64::from(s.corrected_dph[a])).filter(|v| v.is_finite());
        median(&mut seen.collect::<Vec<_>>())
    });
    // (A file that tells the attitude holds the earth's rate: what a unit sends has it, too.)
    let of_file = Attitude::of(r.meta("latitude_deg"), r.meta("axes")).map_err(BadInput::from)?;
    let of_file = of_file.filter(|_| !r.without_earth_rate()).map(|a| a.earth_rate_dph());
    let constants = [0, 1, 2].map(|a| constants[a].map(|c| c - of_file.map_or(0.0, |parts| parts[a])));
    if r.meta("earth_rate").is_none() {
        notes.extend(plausible::earth_rate_otherwise(&constants, r.earth_rate_dph.or(of_file).as_ref()));
    }
    let text = correct::to_csv(&r, "corrected on the desktop", r.power_on_s(), Some(&c), &seconds);
    parquet::write_text(out, &text)?;
    for note in notes {
        println!("note: {note}");
    }
    println!("note: {}", correct::TURN_ON);
    let axes: Vec<usize> = r.present().collect();
    let flagged = seconds.iter().filter(|s| s.status[3] != 0 || axes.iter().any(|a| s.status[*a] != 0)).count();
    let outside = (AxisStatus::TEMPERATURE_RANGE | AxisStatus::RAMP_RANGE).bits();
    let outside = seconds.iter().filter(|s| axes.iter().any(|a| s.status[*a] & outside != 0)).count();
    println!(
        "{}: {} seconds of {}, calibration {:08x}; {flagged} of them flagged, {outside} outside the calibrated temperatures or ramps",
        out.display(),
        seconds.len(),
        c.unit_name(),
        c.checksum()
    );
    Ok(())
}

fn take_off(rates: &mut [f32; AXES], parts: [f64; AXES]) {
    rates.iter_mut().zip(parts).for_each(|(rate, part)| *rate -= part as f32);
}
