//! `hrg allan`: Allan deviation of the rates.

use crate::wait::with_a_bar;
use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::load::load_recording;
use hrg_data::numeric::allan;
use hrg_data::recording::metadata::in_unit;
use std::path::PathBuf;

/// Arguments of `hrg allan`.
#[derive(Args)]
pub struct Arguments {
    /// Recording; best one at rest and at one temperature.
    recording: PathBuf,
    /// File for the picture (SVG).
    #[arg(short, long)]
    out: Option<PathBuf>,
    /// File for the curves (JSON).
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Beyond this range of temperatures an Allan deviation shows the bias over temperature, C.
const MOST_C: f64 = 5.0;

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recording, out, json } = arguments;
    let r = load_recording(&recording)?;
    // Rates on an even grid of the recording's own step.
    let (rates, step_s) = r.even_rates();
    let rates: Vec<(usize, &[f64])> = r.present().map(|a| (a, rates[a].as_slice())).collect();
    let axes = with_a_bar("taking the deviations", || allan::report(&rates, step_s))
        .map_err(|e| BadInput::new(format!("{}: {e}", recording.display())))?;
    println!(
        "{:<5} {:>24} {:>22} {:>12} {:>26}",
        "axis", "angle random walk", "bias instability", "at", "rate random walk"
    );
    let units = ["deg/sqrt(h)", "deg/h", "s", "deg/h/sqrt(h)"].map(|u| in_unit(u, r.rate_unit()));
    println!("{:<5} {:>24} {:>22} {:>12} {:>26}", "", units[0], units[1], units[2], units[3]);
    for a in &axes {
        let (n, readings) = (a.axis, &a.readings);
        let show = |v: Option<f64>| v.map_or("does not show".to_string(), |v| format!("{v:.5}"));
        let least = if readings.bias_instability_reached { "" } else { "under " };
        println!(
            "{n:<5} {:>24} {:>22} {:>12} {:>26}",
            show(readings.angle_random_walk_deg_per_root_h),
            format!("{least}{}", show(readings.bias_instability_dph)),
            readings.bias_instability_at_s.map_or(String::new(), |t| format!("{t:.0}")),
            show(readings.rate_random_walk_dph_per_root_h)
        );
    }
    let readings = if r.thermometer.is_sensor() {
        r.present().next().map(|a| &r.frequency_hz[a][..])
    } else {
        r.column("case_x_c")
    };
    let finite = readings.unwrap_or_default().iter().filter(|v| v.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if high - low > MOST_C {
        println!("note: the temperature goes from {low:.0} to {high:.0} C: figures of long times hold the bias over temperature; take a soak");
    }
    if let Some(missing) = axes.iter().map(|a| a.missing).max().filter(|m| *m > 0) {
        println!("up to {missing} missing values an axis, bridged with the mean");
    }
    if let Some(out) = out {
        let title = format!("{}, {}: overlapping Allan deviation, bars of one sigma", r.unit(), recording.display());
        hrg_data::output::write_file(&out, in_unit(&allan::picture(&axes, &title)?, r.rate_unit()).as_bytes())?;
    }
    if let Some(json) = json {
        hrg_data::output::write_file(&json, serde_json::to_string_pretty(&axes)?.as_bytes())?;
    }
    Ok(())
}
