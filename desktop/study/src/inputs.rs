//! Inputs beside the frequencies, proved: units of the second plant whose bias follows losses and stiffness, traced with their inputs and
//! without, judged on a run that chose nothing, and flown.

use anyhow::{Context, Result};
use hrg_board::replay;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::load::load_recording;
use hrg_data::numeric::stats::{block_means, quantile, std_dev};
use hrg_data::recording::metadata::NO_INPUTS;
use hrg_data::recording::steps::{Steps, MEAN_S};
use hrg_data::recording::Recording;
use hrg_identify::fit;
use hrg_identify::trace;
use hrg_papers::method::Method;
use hrg_papers::methods::identify;
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Arguments of `hrg-study inputs`.
#[derive(clap::Args, Debug)]
pub struct Arguments {
    /// Folder with units that foreign-plant has written: truths, train, verify and judge runs.
    #[arg(long)]
    folder: PathBuf,
    /// Seconds of the judging run that are flown through the ELF.
    #[arg(long, default_value_t = 600)]
    seconds: u64,
    /// Page whose table is written anew.
    #[arg(long)]
    pub page: Option<PathBuf>,
}

/// Methods that use inputs without a search.
const METHODS: [Method; 3] = [Method::Damping, Method::Inputs, Method::InputNetwork];

/// Results of a unit.
struct Row {
    name: String,
    /// By axis, in noise floors of the judging run: what the baseline leaves, the image without inputs, the image with them, and the images
    /// of [`METHODS`].
    left: [[f64; AXES]; 3 + METHODS.len()],
    /// By axis, what the report without inputs says that they would leave on the verify run, over what the image with them leaves there.
    told: Vec<f64>,
    burn: [bool; 2],
    named: String,
    inputs: usize,
    frames: usize,
    differing: usize,
}

/// A unit that the second plant has written: its truth, and the runs beside it.
pub(crate) struct Unit {
    truth: Value,
    folder: PathBuf,
}

impl Unit {
    /// Of the file of its truth.
    pub(crate) fn read(truth: &Path) -> Result<Self> {
        let folder = truth.parent().unwrap_or(Path::new(".")).to_path_buf();
        Ok(Self { truth: serde_json::from_slice(&std::fs::read(truth)?)?, folder })
    }

    /// Name of its case, and its seed.
    pub(crate) fn name(&self) -> (&str, u64) {
        (self.truth["case"].as_str().unwrap_or("?"), self.truth["seed"].as_u64().unwrap_or(0))
    }

    /// True bias of an axis on the run that judges, means of 100 s, deg/h; empty for an axis that is not there.
    pub(crate) fn bias(&self, axis: &str) -> Vec<f64> {
        let all = self.of_role("judge").last().and_then(|r| r["bias_dph"][axis].as_array());
        all.into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
    }

    fn of_role(&self, role: &str) -> impl Iterator<Item = &Value> {
        self.truth["runs"].as_array().into_iter().flatten().filter(move |r| r["role"] == role)
    }

    /// Runs of a role.
    pub(crate) fn runs(&self, role: &str) -> Result<Vec<Recording>> {
        self.of_role(role).map(|r| load_recording(&self.folder.join(r["file"].as_str().unwrap_or("?")))).collect()
    }

    /// The run that judges, and its noise floors, deg/h; NaN for an axis that is not there.
    pub(crate) fn judge(&self) -> Result<(Recording, [f64; AXES])> {
        let run = self.of_role("judge").last().context("no run that judges")?;
        let floor = |a: usize| run["axes"][AXIS_NAMES[a]]["floor_dph"].as_f64().unwrap_or(f64::NAN);
        Ok((self.runs("judge")?.pop().context("no run that judges")?, std::array::from_fn(floor)))
    }
}

/// The residual of an image on a run, in the noise floors of that run.
fn left(image: &Calibration, steps: &Steps, floors: [f64; AXES]) -> [f64; AXES] {
    let rates = fit::correct(image, steps);
    std::array::from_fn(|a| std_dev(&block_means(&rates[a], MEAN_S)) / floors[a])
}

fn one(elf: &[u8], truth_file: &Path, seconds: u64) -> Result<Row> {
    let unit = Unit::read(truth_file)?;
    let (mut train, mut verify) = (unit.runs("train")?, unit.runs("verify")?);
    let (judge, floors) = unit.judge()?;
    let verify_run = &mut verify[0];
    let with = trace::trace(&train, verify_run)?;
    let prepared = fit::prepare(&train)?;
    let by_method = METHODS.map(|m| identify(&prepared, m, 1).map(|i| i.calibration));
    for r in train.iter_mut().chain([&mut *verify_run]) {
        r.set_unit_inputs(NO_INPUTS)?;
    }
    let without = trace::trace(&train, verify_run)?;
    let steps = Steps::new(&judge)?;
    let options = replay::Options { seconds: Some(seconds), ..replay::Options::default() };
    let flown = replay::run(elf, Some(&with.image), &steps, &options, |_| {})?;
    let named: Vec<&str> = with.report.effects.iter().map(|e| e.name.as_str()).collect();
    let [damping, inputs, network] = by_method;
    let images = [&with.baseline, &without.image, &with.image, &damping?, &inputs?, &network?];
    let needs =
        |n: &str| without.report.effects.iter().any(|e| e.reach.starts_with("needs ") && e.axes.contains_key(n));
    let told = AXIS_NAMES.iter().filter(|n| needs(n));
    let told =
        told.map(|n| without.report.r#final[*n].verify_rms_dph / with.report.r#final[*n].verify_rms_dph).collect();
    Ok(Row {
        told,
        name: format!("{}-{}", unit.name().0, unit.name().1),
        left: images.map(|image| left(image, &steps, floors)),
        burn: [without.report.burn, with.report.burn],
        named: named.join(", "),
        inputs: with.image.inputs.len(),
        frames: flown.received.rates.len() + flown.received.housekeeping.len(),
        differing: flown.received.differing,
    })
}

/// Runs the command.
///
/// # Errors
/// Files that cannot be read, or a unit that cannot be traced.
pub fn run(arguments: &Arguments) -> Result<String> {
    let elf = replay::read_elf(&replay::default_elf())?;
    let folder = std::fs::read_dir(&arguments.folder).with_context(|| arguments.folder.display().to_string())?;
    let mut truths: Vec<PathBuf> = folder.filter_map(|f| Some(f.ok()?.path())).collect();
    truths.retain(|p| p.to_string_lossy().ends_with("-truth.json"));
    truths.sort();
    anyhow::ensure!(!truths.is_empty(), "{}: no truth of a unit", arguments.folder.display());
    let rows = truths.iter().map(|t| one(&elf, t, arguments.seconds)).collect::<Result<Vec<_>>>()?;
    let mut s = String::new();
    let _ = writeln!(
        s,
        "| left on the judging run, in noise floors, {} axes | median | 5th to 95th percentile |",
        3 * rows.len()
    );
    let _ = writeln!(s, "|---|---:|---:|");
    let traced = ["baseline", "image without inputs", "image with inputs"].map(String::from);
    let methods = METHODS.map(|m| format!("`--method {m}`"));
    for (k, what) in traced.iter().chain(&methods).enumerate() {
        let all: Vec<f64> = rows.iter().flat_map(|r| r.left[k]).collect();
        let [middle, low, high] = [0.5, 0.05, 0.95].map(|p| quantile(&all, p));
        let _ = writeln!(s, "| {what} | {middle:.2} | {low:.2} to {high:.2} |");
    }
    let burnt = |k: usize| rows.iter().filter(|r| r.burn[k]).count();
    let frames: usize = rows.iter().map(|r| r.frames).sum();
    let differing: usize = rows.iter().map(|r| r.differing).sum();
    let _ = writeln!(
        s,
        "\nRecommended: {} of {} images without inputs, {} with. Through the ELF, {} s of each judging run: {frames} frames, {differing} of them other than the desktop's.\n",
        burnt(0),
        rows.len(),
        burnt(1),
        arguments.seconds
    );
    let told: Vec<f64> = rows.iter().flat_map(|r| r.told.clone()).collect();
    let [middle, low, high] = [0.5, 0.05, 0.95].map(|p| quantile(&told, p));
    let _ = writeln!(
        s,
        "Without inputs, the report names one that would help on {} of {} axes. What it says would be left is, over what the model with inputs leaves on the verify run, {middle:.2} in the median ({low:.2} to {high:.2}).\n",
        told.len(),
        3 * rows.len()
    );
    let _ = writeln!(s, "| unit | named | inputs | baseline | without | with |\n|---|---|---:|---|---|---|");
    for r in &rows {
        let text = |v: [f64; AXES]| v.map(|v| format!("{v:.2}")).join(", ");
        let [b, without, with, ..] = r.left.map(text);
        let _ = writeln!(s, "| {} | {} | {} | {b} | {without} | {with} |", r.name, r.named, r.inputs);
    }
    Ok(s)
}
