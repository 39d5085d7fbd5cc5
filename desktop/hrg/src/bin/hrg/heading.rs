//! `hrg align heading`: which two positions to align in.

use anyhow::Result;
use clap::Args;
use hrg_align_tools::heading;
use hrg_align_tools::heading::Pair;
use std::path::PathBuf;

/// Arguments of `hrg align heading`.
#[derive(Args)]
pub struct Arguments {
    /// Calibrations of one gyro's drift over the heading: heading_deg,drift_dph
    #[arg(required = true)]
    calibrations: Vec<PathBuf>,
    /// Angle of the turn between the positions, degrees.
    #[arg(long, default_value_t = 90.0, allow_negative_numbers = true)]
    turn: f64,
    /// File for the pairs (JSON).
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let all = arguments.calibrations.iter().map(|p| heading::load(p)).collect::<Result<Vec<_>, _>>()?;
    let pairs = heading::pairs(&all, arguments.turn)?;
    println!(
        "{:>9} {:>9} {:>20} {:>16} {:>12}",
        "from deg", "to deg", "difference deg/h", "repeats deg/h", "both deg/h"
    );
    for Pair { from_deg, to_deg, difference_dph, repeats_dph, both_dph } in &pairs {
        println!("{from_deg:>9.1} {to_deg:>9.1} {difference_dph:>20.5} {repeats_dph:>16.5} {both_dph:>12.5}");
    }
    println!("best: {:.1} and {:.1} degrees, of {} calibrations", pairs[0].from_deg, pairs[0].to_deg, all.len());
    arguments
        .out
        .as_ref()
        .map_or(Ok(()), |out| hrg_data::output::write_file(out, serde_json::to_string_pretty(&pairs)?.as_bytes()))
}
