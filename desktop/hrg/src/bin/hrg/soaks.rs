//! `hrg fit soaks`: a table of static points out of runs.

use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::load::load_recording;
use hrg_identify::fit::independence;
use hrg_identify::thermometer::soaks;
use hrg_identify::thermometer::soaks::Settled;
use hrg_simulate::profile::duration_s;
use std::path::PathBuf;

/// Arguments of `hrg fit soaks`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings of one unit that hold soaks.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Every resonator changes by less than this in a soak, C per minute.
    #[arg(long, default_value_t = 0.01)]
    settled: f64,
    /// For so long at the least, such as 10m or 1h.
    #[arg(long, default_value = "10m")]
    hold: String,
    /// File for the table (CSV), for hrg fit points.
    #[arg(short, long)]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { recordings, settled, hold, out } = arguments;
    let for_s = duration_s(hold)
        .ok_or_else(|| BadInput(format!("--hold {hold}: not a time; give hours, minutes or seconds, such as 10m")))?;
    if !(*settled > 0.0) {
        return Err(BadInput(format!("--settled {settled}: give a ramp above zero, C per minute")).into());
    }
    let runs = recordings.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
    independence::same_unit(&runs.iter().collect::<Vec<_>>(), independence::Units::Same)?;
    let mut all = Vec::new();
    for r in &runs {
        all.extend(soaks::find(r, &Settled { within_c_per_min: *settled, for_s })?);
    }
    hrg_data::output::write_file(out, soaks::table(runs[0].unit(), &all).as_bytes())?;
    print!("{}", soaks::lines(&all));
    println!("{}: {} soaks", out.display(), all.len());
    Ok(())
}
