//! `hrg points`: fits of static points.

use anyhow::Result;
use clap::Args;
use hrg_cal::thermometer::points;
use hrg_cal::BadInput;
use std::path::PathBuf;

/// What `hrg points` is told.
#[derive(Args)]
pub struct Arguments {
    /// The table.
    table: PathBuf,
    /// Where the report goes.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { table, out } = arguments;
    let bytes = hrg_cal::read_file(&table, hrg_cal::MOST_RECORDING, true)?;
    let p = points::Points::parse(&String::from_utf8_lossy(&bytes))
        .map_err(|e| BadInput::new(format!("{}: {e}", table.display())))?;
    let report = points::report(&p)?;
    print_points(&report);
    if let Some(out) = out {
        hrg_cal::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
    }
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
        println!("{} (against the {}): {}", e.name, e.reference, e.finding);
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
