//! `hrg fit points`: fits of static points.

use anyhow::Result;
use clap::Args;
use hrg_core::calibration::Calibration;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::names;
use hrg_identify::thermometer::points;
use std::path::{Path, PathBuf};

/// Arguments of `hrg fit points`.
#[derive(Args)]
pub struct Arguments {
    /// The table.
    table: PathBuf,
    /// File for the report.
    #[arg(short, long)]
    out: Option<PathBuf>,
    /// File for an image that has the curves of this table and no bias yet, for hrg fit --curve: text, or binary if it ends in .bin
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Name of the unit, for that image; by default the one in the table.
    #[arg(long)]
    unit: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { table, out, calibration, unit } = arguments;
    let bytes = hrg_data::files::read_file(&table, hrg_data::files::MOST_RECORDING, true)?;
    let text = String::from_utf8_lossy(&bytes);
    let p = points::Points::parse(&text).map_err(|e| BadInput::new(format!("{}: {e}", table.display())))?;
    let report = points::report(&p)?;
    print_points(&report);
    if let Some(out) = out {
        hrg_data::output::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
    }
    if let Some(path) = calibration {
        let in_table = text.lines().find_map(|l| l.strip_prefix("# unit:")).map(|n| n.trim().to_string());
        write_curves(&p, unit.or(in_table.filter(|n| n != names::NONE)), &path)?;
    }
    Ok(())
}

/// Writes an image with the curves of the table.
fn write_curves(p: &points::Points, unit: Option<String>, path: &Path) -> Result<()> {
    let mut image = Calibration::uncalibrated();
    image.created_unix_s = crate::now();
    image.sequence = 1;
    if let Some(unit) = unit {
        image.set_unit_name(names::check(&unit).map_err(BadInput::from)?);
    }
    let found = points::curves(p)?;
    for (a, found) in found.into_iter().enumerate() {
        let Some((curve, reference)) = found else {
            println!("{}: not in the table; the image has the compiled-in curve", AXIS_NAMES[a]);
            continue;
        };
        println!(
            "{}: T(f) about {:.3} Hz, from {:.2} to {:.2} C, referred to the {reference}",
            AXIS_NAMES[a], curve.frequency_centre_hz, curve.valid_from_c, curve.valid_to_c
        );
        image.axes[a].curve = curve;
    }
    image_file::save(path, &image)?;
    println!(
        "{}: these curves, and no bias yet: hrg fit RUN.csv --curve {} --out cal.toml",
        path.display(),
        path.display()
    );
    Ok(())
}

fn print_points(r: &points::Report) {
    println!("Residuals of T(f) and of f(T) solved for T, in C");
    println!(
        "{:<9} {:<5} {:<7} {:>6} {:>9} {:>9} {:>14}",
        "reference", "axis", "fit", "degree", "RMS", "largest", "leave-one-out"
    );
    for (reference, axes) in &r.fits {
        for (axis, f) in axes {
            for (kind, fits) in [("T(f)", &f.inverse), ("f(T)", &f.forward)] {
                for p in fits {
                    println!(
                        "{reference:<9} {axis:<5} {kind:<7} {:>6} {:>9.4} {:>9.4} {:>14.4}",
                        p.degree, p.rms_c, p.max_c, p.leave_one_out_rms_c
                    );
                }
            }
        }
    }
    if !r.each_other.is_empty() {
        println!("\nEach as the other's thermometer, in C: no sensor takes part");
        println!(
            "{:<6} {:>6} {:>24} {:>24} {:>24} {:>12} {:>9}",
            "pair", "soaks", "against the chamber", "by the other", "leave-one-out", "correlation", "p-value"
        );
    }
    for p in &r.each_other {
        let two = |v: [f64; 2]| format!("{:.4} / {:.4}", v[0], v[1]);
        println!(
            "{:<6} {:>6} {:>24} {:>24} {:>24} {:>12.3} {:>9.1e}",
            p.axes.join(" "),
            p.soaks,
            two(p.against_chamber_rms_c),
            two(p.by_the_other_rms_c),
            two(p.by_the_other_leave_one_out_c),
            p.correlation,
            p.p_value
        );
    }
    for e in &r.effects {
        println!();
        println!("{} (against the {}): {}", e.name, hrg_identify::thermometer::points::called(&e.reference), e.finding);
        println!("p-value: {:.1e} ({})", e.p_value, e.statistic);
        if !e.indistinguishable_from.is_empty() {
            println!("these points cannot tell it from: {}", e.indistinguishable_from.join(", "));
        }
        println!("{:<5} {:>9} {:>20} {:>20} {:>24}", "axis", "gain [C]", "RMS [C]", "largest [C]", "leave-one-out [C]");
        for (axis, b) in &e.axes {
            let pair = |x: f64, y: f64| format!("{x:.4} -> {y:.4}");
            println!(
                "{axis:<5} {:>9.4} {:>20} {:>20} {:>24}",
                b.gain,
                pair(b.rms_before_c, b.rms_after_c),
                pair(b.max_before_c, b.max_after_c),
                pair(b.leave_one_out_before_c, b.leave_one_out_after_c)
            );
        }
    }
    for a in &r.advice {
        println!("\n{a}");
    }
}
