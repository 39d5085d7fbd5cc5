//! `hrg align accelerometers`: bias, scale and cross-axis of the accelerometers of a platform.

use anyhow::Result;
use clap::Args;
use hrg_align::normal_gravity;
use hrg_align_tools::accelerometers::identify;
use hrg_data::error::BadInput;
use std::path::PathBuf;

/// Arguments of `hrg align accelerometers`.
#[derive(Args)]
pub struct Arguments {
    /// Tilts of a tilting table and what the accelerometers read: a1_mps2,a2_mps2,tilt1_arcmin,tilt2_arcmin
    table: PathBuf,
    /// Latitude, degrees, for gravity.
    #[arg(long, allow_negative_numbers = true)]
    latitude: f64,
    /// Gravity, m/s^2, where it is known better.
    #[arg(long)]
    gravity: Option<f64>,
    /// Calibration that gets them: --out is then this calibration with them, for the unit's align mode.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// File for them (JSON, or the calibration), for hrg align --accelerometers
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { table, latitude, gravity, calibration, out } = arguments;
    let gravity = gravity.unwrap_or_else(|| normal_gravity(*latitude));
    if !(latitude.abs() <= 90.0 && (9.0..10.5).contains(&gravity)) {
        return Err(BadInput::new("latitude or gravity is impossible; give degrees and m/s^2").into());
    }
    let bytes = hrg_data::files::read_file(table, hrg_data::files::MOST_RECORDING, true)?;
    let found = identify(&String::from_utf8_lossy(&bytes), gravity)
        .map_err(|e| BadInput::new(format!("{}: {e}", table.display())))?;
    match calibration {
        Some(path) => {
            let mut c = hrg_data::image_file::load(path)?;
            c.accelerometers = found.accelerometers.in_image();
            hrg_data::image_file::save(out, &c)?;
        }
        None => hrg_data::output::write_file(out, serde_json::to_string_pretty(&found)?.as_bytes())?,
    }
    println!("{:<5} {:>22} {:>24} {:>24} {:>15}", "", "bias m/s^2", "along axis 1", "along axis 2", "residual m/s^2");
    for k in 0..2 {
        let (a, s) = (&found.accelerometers, &found.std[k]);
        let pair = |value: f64, std: f64| format!("{value:.6} +- {std:.6}");
        println!(
            "{:<5} {:>22} {:>24} {:>24} {:>15.6}",
            k + 1,
            pair(a.bias_mps2[k], s[0]),
            pair(a.matrix[k][0], s[1]),
            pair(a.matrix[k][1], s[2]),
            found.residual_mps2[k]
        );
    }
    println!("{}: {} tilts", out.display(), found.rows);
    Ok(())
}
