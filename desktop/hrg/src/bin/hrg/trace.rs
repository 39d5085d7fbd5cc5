//! `hrg trace`: what the baseline model lacks.

use crate::colour::painted;
use crate::facts::FactsArguments;
use crate::{now, units, wait};
use anyhow::Result;
use clap::Args;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::recording::metadata::in_unit;
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
    /// Recording to test the result on. It is not used in the fit.
    #[arg(long, required_unless_present = "split")]
    verify: Option<PathBuf>,
    /// A third run, used only to judge. Without --judge the verify run judges, and the report names the axes for which it has also selected
    /// the model.
    #[arg(long, value_name = "RUN", conflicts_with = "split")]
    judge: Option<PathBuf>,
    /// Use one recording: fit to the part before SECONDS, test on the part after it. Lags and hysteresis continue over the split.
    #[arg(long, value_name = "SECONDS", conflicts_with = "verify")]
    split: Option<f64>,
    /// File for the report (JSON).
    #[arg(short, long)]
    out: PathBuf,
    /// File for the report as a page (HTML).
    #[arg(long)]
    html: Option<PathBuf>,
    /// Draw this limit into the page's first pictures, deg/h. (`hrg judge` tests it.)
    #[arg(short, long, value_name = "DEG/H", requires = "html")]
    limit: Option<f64>,
    /// File for the calibration image: the extended one if the verify run confirms it, else the baseline. No file is written if both are worse
    /// than the raw rates.
    #[arg(short, long)]
    calibration: Option<PathBuf>,
    /// The image that the unit has in use: the new one must beat it before it is recommended.
    #[arg(long)]
    in_use: Option<PathBuf>,
    /// A family of units of the same design (hrg family): the image is that of the highest probability under it, where the unit belongs to it and the family
    /// says more of it than the train runs do.
    #[arg(long, value_name = "FAMILY", conflicts_with = "rates")]
    prior: Option<PathBuf>,
    /// For a unit that will meet no other profile: recommend the burn even if the verify run only repeats the profile of a train run, or if the image
    /// leaves too much to say what it does on another one.
    #[arg(long)]
    repeat_is_enough: bool,
    /// The quantities beside the frequencies that the unit itself has, by their columns, with commas between (drive_x_v, or drive for all
    /// axes), or none. Without it, as the recordings state (# unit_inputs), or all that they hold but the sensors on the cases.
    #[arg(long, value_name = "COLUMNS")]
    inputs: Option<String>,
    /// Find the effects that the scale factors of this calibration lack, instead of effects of the bias. The runs must be from a rate table
    /// (hrg profile --rates). Every figure in deg/h in the report is then in ppm.
    #[arg(long, value_name = "CALIBRATION", conflicts_with_all = ["split", "calibration", "in_use"])]
    rates: Option<PathBuf>,
    /// Also search the verify run, and report if it finds the same classes. Information only.
    #[arg(long)]
    exchange: bool,
    /// End with exit status 3 unless the image should be burnt, or the verdict is confirmed.
    #[arg(long, value_name = "WHAT")]
    fail_unless: Option<Reached>,
    /// Accepted for scripts of before: a trace uses one processor.
    #[arg(long, hide = true)]
    jobs: Option<usize>,
    /// Allow recordings of different units.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
}

/// A conclusion that a script asks for.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Reached {
    /// The image should be burnt.
    Burn,
    /// Effects are named, and the verify run agrees.
    Confirmed,
}

/// Runs the command; `false` where the conclusion is not the one that `--fail-unless` asks for.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<bool> {
    let Arguments {
        runs,
        train,
        verify,
        judge,
        split,
        out,
        html,
        limit,
        calibration,
        in_use,
        prior,
        repeat_is_enough,
        inputs,
        rates,
        exchange,
        fail_unless,
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
    let mut judge = judge.map(|path| facts.load(&[path])).transpose()?.and_then(|mut runs| runs.pop());
    if let Some(listed) = &inputs {
        train.iter_mut().chain([&mut verify]).chain(&mut judge).try_for_each(|r| r.set_unit_inputs(listed))?;
    }
    let family = prior.as_deref().map(hrg::fleet::read_family).transpose()?;
    let options = trace::Options {
        units: units(different_units),
        in_use,
        repeat_is_enough,
        judge,
        exchange,
        own: Vec::new(),
        family,
    };
    let mut t = wait::with_a_bar("tracing", || trace::trace_with(&train, &verify, &options))?;
    if rates.is_some() {
        t.report.notes.push(RATES.into());
    }
    hrg_data::output::write_file(&out, serde_json::to_string_pretty(&t.report)?.as_bytes())?;
    if let Some(path) = html {
        hrg_data::output::write_file(&path, trace::html_with(&t, limit)?.as_bytes())?;
    }
    print_trace(&t.report);
    match calibration {
        Some(path) if t.report.image == trace::Image::None => {
            println!("{}: not written, for the reason that the first line gives", path.display());
        }
        Some(path) => {
            t.image.created_unix_s = now();
            image_file::save(&path, &t.image)?;
            let kind = if t.report.image == trace::Image::Extended { "extended" } else { "baseline" };
            println!("{}: the {kind} image", path.display());
        }
        None => {}
    }
    Ok(match fail_unless {
        None => true,
        Some(Reached::Burn) => t.report.burn,
        Some(Reached::Confirmed) => t.report.verdict_kind == trace::VerdictKind::Confirmed,
    })
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
    println!("{}", painted(&r.verdict));
    println!();
    let judged = if r.judged_by == "judge" { "judging run" } else { "verify" };
    println!("{:<5} {:^21} {:^52} {:>12}", "", "train", "verify", judged);
    println!(
        "{:<5} {:>10} {:>10} {:>10} {:>10} {:>10} {:>19} {:>12} {:>9}",
        "axis", "baseline", "effects", "baseline", "effects", "image", "image's mean", "image RMS", "noise"
    );
    for n in r.axes() {
        let (b, f) = (r.baseline[n], r.r#final[n]);
        let figure = |v: Option<f64>| v.map_or("-".to_string(), |v| format!("{v:.3}"));
        let block = r.block.as_ref().map(|b| b[n]);
        println!(
            "{n:<5} {:>10.3} {:>10.3} {:>10.3} {:>10.3} {:>10} {:>19} {:>12} {:>9.3}",
            b.train_rms_dph,
            f.train_rms_dph,
            b.verify_rms_dph,
            f.verify_rms_dph,
            figure(block.map(|b| b.verify_rms_dph)),
            block.map_or("-".to_string(), |b| format!("{:+.3} +- {:.3}", b.mean_dph, b.mean_std_dph)),
            figure(block.map(|_| r.judge[n].rms_dph)),
            r.noise_floor_dph[n],
        );
    }
    let means = r.baseline.values().next().map_or((0, 0), |b| (b.train_means, b.verify_means));
    let legend = format!(
        "deg/h: standard deviation of means over {} s ({} of train, {} of verify); the image RMS also contains the image's mean (the constant bias of that day); +- is its standard deviation",
        r.mean_s, means.0, means.1
    );
    println!("{}", in_unit(&legend, &r.rate_unit));
    for e in &r.effects {
        print_effect(e, &r.rate_unit);
    }
    if !(r.advice.is_empty() && r.notes.is_empty()) {
        println!();
    }
    for a in r.advice.iter().chain(&r.notes) {
        println!("- {a}");
    }
}

fn print_effect(e: &trace::report::Found, rate_unit: &str) {
    println!();
    let parameters = e.parameters_text();
    let gap = if parameters.is_empty() { "" } else { " " };
    println!("{}{gap}{parameters} ({}; {})", e.label(), e.class.name(), e.reach);
    for (n, gain) in &e.axes {
        let share = e.on_verify.get(n).map_or(String::new(), |v| {
            format!("; on the verify run {:.2} +- {:.2} times this, log score {:.1}", v.share, v.share_std, v.log_score)
        });
        println!("  {n}  {}{share}", in_unit(&e.gain_text(gain), rate_unit));
    }
    println!("  {:<22} {:>9} {:>9} {:>9} {:>10}", "candidate", "log prior", "evidence", "score", "less error");
    for k in &e.rank {
        println!(
            "  {:<22} {:>9.1} {:>9.1} {:>9.1} {:>8.1} %",
            k.name,
            k.score.log_prior,
            k.score.log_evidence,
            k.score.total(),
            100.0 * k.gain_in_cv
        );
    }
    if !e.indistinguishable_from.is_empty() {
        println!("  this profile cannot distinguish it from: {}", e.indistinguishable_from.join(", "));
    }
}
