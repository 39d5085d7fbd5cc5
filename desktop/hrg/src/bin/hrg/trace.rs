//! `hrg trace`: what the baseline model lacks.

use crate::facts::FactsArguments;
use crate::{now, units};
use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::Recording;
use hrg_identify::trace;
use std::path::PathBuf;

/// Arguments of `hrg trace`.
#[derive(Args)]
pub struct Arguments {
    /// Train runs: recordings to learn from.
    #[arg(value_name = "RUN", required_unless_present = "train")]
    runs: Vec<PathBuf>,
    /// The same.
    #[arg(long, hide = true)]
    train: Vec<PathBuf>,
    /// Recording that is only evaluated.
    #[arg(long, required_unless_present = "split")]
    verify: Option<PathBuf>,
    /// A third run, which chooses nothing and judges alone. Without it the verify run judges, and the report says where it has also
    /// chosen.
    #[arg(long, value_name = "RUN", conflicts_with = "split")]
    judge: Option<PathBuf>,
    /// Instead of a verify run: learn from the one train recording before this time, evaluate on the rest, with lags and
    /// hysteresis carried on from its beginning.
    #[arg(long, value_name = "SECONDS", conflicts_with = "verify")]
    split: Option<f64>,
    /// File for the report (JSON).
    #[arg(short, long)]
    out: PathBuf,
    /// File for the report as a page (HTML).
    #[arg(long)]
    html: Option<PathBuf>,
    /// File for the calibration image: the extended one where the verify run bears it out, else the baseline; nothing is
    /// written where neither beats the raw rates.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// The image that the unit has in use: the new one must beat it before it is recommended.
    #[arg(long)]
    in_use: Option<PathBuf>,
    /// Recommend a burn also where the verify run only repeats the profile of a train run.
    #[arg(long)]
    repeat_is_enough: bool,
    /// Trace what the scale factors lack under this calibration, on runs on a rate table (hrg profile --rates), in the place of what
    /// the biases lack. Every deg/h of the report is then a ppm.
    #[arg(long, value_name = "CALIBRATION", conflicts_with_all = ["split", "calibration", "in_use"])]
    rates: Option<PathBuf>,
    /// Search on the verify run, too, and say whether it names the same classes: advice.
    #[arg(long)]
    exchange: bool,
    /// Accepted for scripts of before: a trace uses one processor.
    #[arg(long, hide = true)]
    jobs: Option<usize>,
    /// Allow recordings of different units.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments {
        runs,
        train,
        verify,
        judge,
        split,
        out,
        html,
        calibration,
        in_use,
        repeat_is_enough,
        rates,
        exchange,
        jobs: _,
        different_units,
        facts,
    } = arguments;
    let runs = [runs, train].concat();
    let (mut train, mut verify) = runs_of_trace(&runs, verify, split, &facts)?;
    if let Some(path) = &rates {
        let under = image_file::load(path)?;
        for r in train.iter_mut().chain([&mut verify]) {
            hrg_data::recording::facts::fits(&under, r, different_units).map_err(BadInput::from)?;
            *r = hrg_identify::rates::lacking(r, &under)?;
        }
    }
    let in_use = in_use.map(|p| image_file::load(&p)).transpose()?;
    if let Some(c) = &in_use {
        hrg_data::recording::facts::fits(c, &verify, different_units).map_err(BadInput::from)?;
    }
    let judge = judge.map(|path| facts.load(&[path])).transpose()?.and_then(|mut runs| runs.pop());
    let options =
        trace::Options { units: units(different_units), in_use, repeat_is_enough, judge, exchange, own: Vec::new() };
    let mut t = trace::trace_with(&train, &verify, &options)?;
    if rates.is_some() {
        t.report.notes.push(RATES.into());
    }
    hrg_data::output::write_file(&out, serde_json::to_string_pretty(&t.report)?.as_bytes())?;
    if let Some(path) = html {
        hrg_data::output::write_file(&path, trace::html(&t)?.as_bytes())?;
    }
    print_trace(&t.report);
    match calibration {
        Some(path) if t.report.image == trace::Image::None => {
            println!("{}: not written, no image beats the raw rates", path.display());
        }
        Some(path) => {
            t.image.created_unix_s = now();
            image_file::save(&path, &t.image)?;
            let kind = if t.report.image == trace::Image::Extended { "extended" } else { "baseline" };
            println!("{}: the {kind} image", path.display());
        }
        None => {}
    }
    Ok(())
}

/// Note on the units in a report of scale factors.
const RATES: &str = "traced is what the scale factors lack: read ppm for every deg/h";

/// Train runs and the verify run, perhaps parts of one.
fn runs_of_trace(
    train: &[PathBuf],
    verify: Option<PathBuf>,
    split: Option<f64>,
    facts: &FactsArguments,
) -> Result<(Vec<Recording>, Recording)> {
    let mut train = facts.load(train)?;
    if let Some(verify) = verify {
        return Ok((train, facts.load(&[verify])?.remove(0)));
    }
    match (train.pop(), train.is_empty(), split) {
        (Some(whole), true, Some(at_s)) => {
            let (before, after) = whole.split(at_s)?;
            Ok((vec![before], after))
        }
        _ => Err(BadInput::new("--split parts one recording: give one --train").into()),
    }
}

fn print_trace(r: &trace::Report) {
    println!(
        "{:<5} {:>12} {:>12} {:>12} {:>12} {:>14} {:>12}   left, in floors",
        "axis", "base/train", "base/verify", "final/train", "final/verify", "means", "noise floor"
    );
    for n in r.axes() {
        let (b, f, ratio) = (r.baseline[n], r.r#final[n], r.floor_ratio[n]);
        println!(
            "{n:<5} {:>12.3} {:>12.3} {:>12.3} {:>12.3} {:>14} {:>12.3}   {:.2} [{:.2}, {:.2}]",
            b.train_rms_dph,
            b.verify_rms_dph,
            f.train_rms_dph,
            f.verify_rms_dph,
            format!("{} / {}", f.train_means, f.verify_means),
            r.noise_floor_dph[n],
            ratio.ratio,
            ratio.low,
            ratio.high
        );
    }
    println!("standard deviation of 100 s means, deg/h; how many means there are, train / verify; in brackets 95 %");
    if let Some(block) = &r.block {
        println!();
        println!("{:<5} {:>14} {:>26}   the image on the verify run", "axis", "verify", "mean against train");
        for (n, b) in block {
            println!(
                "{n:<5} {:>14.3} {:>26}",
                b.verify_rms_dph,
                format!("{:+.3} +- {:.3}", b.mean_dph, b.mean_std_dph)
            );
        }
    }
    for e in &r.effects {
        println!();
        let parameters: Vec<String> =
            e.parameters.iter().map(|(n, v)| format!("{n} {}", trace::report::three_digits(*v))).collect();
        let p_value = e.p_value.map_or("not tested".to_string(), |p| format!("{p:.1e}"));
        println!("effect {} {} ({}, {}; p-value {p_value})", e.name, parameters.join(", "), e.class.name(), e.reach);
        for (n, v) in &e.on_verify {
            println!("  axis {n}: the verify run shows {:.2} +- {:.2} of it", v.share, v.share_std);
        }
        for k in &e.rank {
            println!(
                "  {:<20} {:>6.1} % less cross-validated error, net evidence {:.1}",
                k.name,
                100.0 * k.gain_in_cv,
                k.net_evidence
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
