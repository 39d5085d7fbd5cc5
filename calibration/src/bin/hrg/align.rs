//! `hrg align`: azimuth, tilts and drifts of a platform at rest.

use anyhow::Result;
use clap::Args;
use hrg_cal::align::{self, FilterKind};
use hrg_cal::BadInput;
use std::path::PathBuf;

/// What `hrg align` is told.
#[derive(Args)]
pub struct Arguments {
    /// Recording: time_s,position,v1_mps,v2_mps
    #[arg(long)]
    recording: PathBuf,
    /// Filter.
    #[arg(long, default_value = "linear")]
    filter: FilterKind,
    /// First azimuth of the EKF, degrees.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    first_azimuth: f64,
    /// Seed of the literal particle filter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the report (JSON) goes.
    #[arg(long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recording, filter, first_azimuth, seed, out } = arguments;
    let r = align::Recording::load(&recording)?;
    let start = align::Start { azimuth_deg: first_azimuth, seed, ..align::Start::default() };
    let report = align::align(&r, filter, start).map_err(|e| BadInput::new(format!("{}: {e}", recording.display())))?;
    hrg_cal::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
    println!("azimuth  {:>9.4} deg    +- {:.2}'", report.azimuth_deg, report.azimuth_std_arcmin);
    let [t1, t2] = report.tilt_std_arcmin;
    println!("tilts    {:>9.3}' {:>9.3}'   +- {t1:.3}' {t2:.3}'", report.tilt1_arcmin, report.tilt2_arcmin);
    let [d1, d2] = report.drift_std_dph;
    println!("drifts   {:>9.4} {:>9.4} deg/h   +- {d1:.4} {d2:.4}", report.drift1_dph, report.drift2_dph);
    match report.converged_at_s {
        Some(t) => println!("known to 15' (two sigma) since {t:.0} s"),
        None => println!("not known to 15' (two sigma)"),
    }
    if let Some(i) = report.integrity {
        println!("the two positions agree: chi-square {i:.2} (limit 10.8)");
    }
    Ok(())
}
