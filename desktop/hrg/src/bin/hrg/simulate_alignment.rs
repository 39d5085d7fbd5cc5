//! `hrg align simulate`: a platform to align.

use anyhow::Result;
use clap::Args;
use hrg_align_tools::plant::Plant;
use std::path::PathBuf;

/// Arguments of `hrg align simulate`.
#[derive(Args)]
pub struct Arguments {
    /// Seed: 0 is chen2015's case, any other a platform of its own.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// chen2015's case with this draw of its noise (the draws of docs/alignment-results.md begin with 0).
    #[arg(long, conflicts_with = "seed")]
    chen: Option<u64>,
    /// Error of the turn, arc minutes.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    turn_error: f64,
    /// Stay in position 1.
    #[arg(long)]
    one_position: bool,
    /// File for the recording.
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { seed, chen, turn_error, one_position, out } = arguments;
    let mut plant = match (chen, seed) {
        (Some(draw), _) => Plant::chen(draw),
        (None, 0) => Plant::chen(0),
        (None, seed) => Plant::drawn(seed),
    };
    plant.turn_error = turn_error / 60.0 / 180.0 * std::f64::consts::PI;
    if one_position {
        plant.seconds[2] = 0;
    }
    let (r, _) = plant.play();
    hrg_data::output::write_file(&out, r.to_csv().as_bytes())?;
    println!("{}: {} rows, simulated", out.display(), r.rows.len());
    Ok(())
}
