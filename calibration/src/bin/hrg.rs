//! `hrg`: recordings of HRG chamber runs in, coefficients and reports out.

use anyhow::Result;
use clap::{Parser, Subcommand};
use hrg_cal::simulate::{EffectSpec, Noise, Plan, Profile};
use hrg_cal::{file, fit, load_recording, points, trace, BadInput, AXIS_NAMES};
use std::path::PathBuf;
use std::process::ExitCode;

/// Calibration of hemispherical resonator gyros over temperature.
#[derive(Parser)]
#[command(name = "hrg", version, about, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a chamber run.
    ///
    /// Example: hrg simulate --profile dong --effect hysteresis:width_c=10,size=3 --seed 7 --out run.csv
    Simulate {
        /// A named profile (dong, cycle, verify, stairs, ramps, fast, zhao, up) or one like 20,-40@1,2h,50@1,2h
        #[arg(long, default_value = "dong")]
        profile: String,
        /// Effect to put in: NAME[:key=value,...], or secret:SEED. Several may be given.
        #[arg(long)]
        effect: Vec<String>,
        /// Seed of this run's noise: another seed is another run of the same unit.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Which unit: its bias coefficients and how it feels an effect.
        #[arg(long, default_value_t = 1)]
        unit: u64,
        /// White noise: standard deviation of 100 s means, deg/h.
        #[arg(long, default_value_t = 0.2)]
        noise: f64,
        /// Put spikes, gaps, missing, stuck values and repeated times in.
        #[arg(long)]
        dirty: bool,
        /// Where the recording goes.
        #[arg(long)]
        out: PathBuf,
    },
    /// Fit static points: frequency and temperature of soaks.
    ///
    /// Example: hrg points host-tests/recordings/dong2023-table1.csv --out points.json
    Points {
        /// The table.
        table: PathBuf,
        /// Where the report goes.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Identify the coefficients of the baseline model.
    ///
    /// Example: hrg fit run.csv --method lsq --out cal.toml
    Fit {
        /// Recordings of one unit.
        #[arg(required = true)]
        recordings: Vec<PathBuf>,
        /// How.
        #[arg(long, default_value = "lsq", value_parser = ["lsq"])]
        method: String,
        /// A cooling and a heating set of coefficients.
        #[arg(long)]
        two_sets: bool,
        /// Weigh every degree alike instead of every second.
        #[arg(long)]
        uniform: bool,
        /// Where the calibration goes: text, or the binary block if it ends in .bin
        #[arg(long)]
        out: PathBuf,
    },
    /// Find what the baseline model lacks, add it, and measure before and after on a run it never saw.
    ///
    /// Example: hrg trace --train a.csv --verify b.csv --out report.json --html report.html --calibration cal.toml
    Trace {
        /// Recording to learn from. Several may be given.
        #[arg(long, required = true)]
        train: Vec<PathBuf>,
        /// Recording that is only evaluated.
        #[arg(long)]
        verify: PathBuf,
        /// Where the report (JSON) goes.
        #[arg(long)]
        out: PathBuf,
        /// Where the report as a page goes.
        #[arg(long)]
        html: Option<PathBuf>,
        /// Where the extended calibration goes.
        #[arg(long)]
        calibration: Option<PathBuf>,
    },
}

fn main() -> ExitCode {
    hrg_cal::exit("hrg", run(Arguments::parse().command))
}

fn run(command: Command) -> Result<()> {
    match command {
        Command::Simulate { profile, effect, seed, unit, noise, dirty, out } => {
            let effects = effect
                .iter()
                .map(|e| match e.strip_prefix("secret:") {
                    Some(s) => s
                        .parse()
                        .map(EffectSpec::secret)
                        .map_err(|_| BadInput::new(format!("\"{e}\": secret: takes a whole number as seed"))),
                    None => EffectSpec::parse(e),
                })
                .collect::<Result<Vec<_>, _>>()?;
            let plan = Plan {
                profile: Profile::parse(&profile)?,
                effects,
                unit_seed: unit,
                seed,
                noise: Noise { white_100s_dph: noise, ..Noise::default() },
                sizing: None,
            };
            let mut simulated = plan.simulate();
            if dirty {
                hrg_cal::simulate::soil(&mut simulated.recording, seed);
            }
            hrg_cal::write_file(&out, simulated.recording.to_csv().as_bytes())?;
            println!(
                "{}: {} rows, simulated (unit SIM-{}, seed {seed})",
                out.display(),
                simulated.recording.time_s.len(),
                plan.unit_seed
            );
            Ok(())
        }
        Command::Points { table, out } => {
            let text = std::fs::read_to_string(&table)
                .map_err(|e| BadInput::new(format!("cannot read {}: {e}", table.display())))?;
            let p = points::Points::parse(&text).map_err(|e| BadInput::new(format!("{}: {e}", table.display())))?;
            let report = points::report(&p)?;
            print_points(&report);
            if let Some(out) = out {
                hrg_cal::write_file(&out, serde_json::to_string_pretty(&report)?.as_bytes())?;
            }
            Ok(())
        }
        Command::Trace { train, verify, out, html, calibration } => {
            let train = train.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
            let verify = load_recording(&verify)?;
            let mut t = trace::trace(&train, &verify)?;
            hrg_cal::write_file(&out, serde_json::to_string_pretty(&t.report)?.as_bytes())?;
            if let Some(path) = html {
                hrg_cal::write_file(&path, trace::html(&t)?.as_bytes())?;
            }
            if let Some(path) = calibration {
                t.extended.created_unix_s = now();
                file::save(&path, &t.extended)?;
            }
            print_trace(&t.report);
            Ok(())
        }
        Command::Fit { recordings, method: _, two_sets, uniform, out } => {
            let recordings = recordings.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
            let mut o = fit::least_squares(&recordings, &fit::Options { two_sets, uniform_in_temperature: uniform })?;
            o.calibration.created_unix_s = now();
            o.calibration.sequence = 1;
            file::save(&out, &o.calibration)?;
            println!("{:<5} {:>22} {:>22} {:>10}", "axis", "raw, 3 sigma [deg/h]", "fitted, 3 sigma", "condition");
            for a in 0..3 {
                println!(
                    "{:<5} {:>22.3} {:>22.3} {:>10.1}",
                    AXIS_NAMES[a],
                    3.0 * o.raw_dph[a],
                    3.0 * o.corrected_dph[a],
                    o.condition[a]
                );
            }
            println!("three sigma of 100 s means, on the data of the fit");
            for n in &o.notes {
                println!("note: {n}");
            }
            println!("{}: block {:08x}", out.display(), o.calibration.checksum());
            Ok(())
        }
    }
}

fn now() -> u32 {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).map_or(0, |d| d.as_secs() as u32)
}

fn print_trace(r: &trace::Report) {
    println!(
        "{:<5} {:>12} {:>12} {:>12} {:>12} {:>12}",
        "axis", "base/train", "base/verify", "final/train", "final/verify", "noise floor"
    );
    for n in AXIS_NAMES {
        println!(
            "{n:<5} {:>12.3} {:>12.3} {:>12.3} {:>12.3} {:>12.3}",
            r.baseline[n].train_rms_dph,
            r.baseline[n].verify_rms_dph,
            r.r#final[n].train_rms_dph,
            r.r#final[n].verify_rms_dph,
            r.noise_floor_dph[n]
        );
    }
    println!("standard deviation of 100 s means, deg/h");
    for e in &r.effects {
        println!();
        let parameters: Vec<String> = e.parameters.iter().map(|(n, v)| format!("{n} {v:.1}")).collect();
        println!("effect {} {} ({})", e.name, parameters.join(", "), e.reach);
        for k in &e.rank {
            println!(
                "  {:<20} {:>6.1} % less cross-validated error, worth {:.1}",
                k.name,
                100.0 * k.gain_in_cv,
                k.worth
            );
        }
        if !e.indistinguishable_from.is_empty() {
            println!("  not told apart on this profile: {}", e.indistinguishable_from.join(", "));
        }
    }
    println!();
    println!("{}", r.verdict);
    for a in r.advice.iter().chain(&r.notes) {
        println!("- {a}");
    }
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
    for e in &r.effects {
        println!();
        println!("{} (against the {}): {}", e.name, e.reference, e.finding);
        println!("chance by luck: {:.1e} ({})", e.chance_by_luck, e.statistic);
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
