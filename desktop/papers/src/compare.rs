//! Methods side by side: the same training runs, the same unseen runs, one table.

use crate::history;
use crate::history::History;
use crate::method::Method;
use crate::methods::{identify, Identified};
use crate::stages;
use crate::stages::Stage;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cost::Cost;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::numeric::allan;
use hrg_data::numeric::progress;
use hrg_data::numeric::stats::{block_means, mean, std_dev};
use hrg_data::plot;
use hrg_data::plot::{Panel, Series};
use hrg_data::recording::facts;
use hrg_data::recording::steps::{Run, Steps, MEAN_S};
use hrg_data::recording::Recording;
use hrg_identify::fit;
use hrg_identify::fit::enough_data;
use hrg_identify::fit::independence;
use hrg_identify::fit::independence::Units;
use hrg_identify::trace;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Subject of a comparison: a method, or the traced model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contender {
    /// A method.
    Method(Method),
    /// The model that [`hrg_identify::trace`] finds.
    Trace,
}

impl Contender {
    /// Every method, and the traced model.
    #[must_use]
    pub fn all() -> Vec<Self> {
        Method::ALL.into_iter().map(Self::Method).chain([Self::Trace]).collect()
    }

    /// The name in commands and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Method(method) => method.name(),
            Self::Trace => "trace",
        }
    }

    /// The one with a name.
    ///
    /// # Errors
    /// A sentence with the names that there are.
    pub fn by_name(name: &str) -> Result<Self, BadInput> {
        Self::all().into_iter().find(|c| c.name() == name).ok_or_else(|| {
            let names: Vec<&str> = Method::ALL.into_iter().map(Method::name).collect();
            BadInput::new(format!("method \"{name}\" is not known; there are {} and trace", names.join(", ")))
        })
    }
}

/// Three sigma of 100 s means, per axis, deg/h, and what else is read off corrected rates.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Judged {
    /// On the training runs.
    pub train_3sigma_dph: [f64; AXES],
    /// The same of each stage, cooling and heating, as dong2023's Table 4 has them.
    pub train_stages_3sigma_dph: [[f64; AXES]; 2],
    /// The same on the unseen runs: the mean over them.
    pub verify_3sigma_dph: [f64; AXES],
    /// The mean over those unseen runs that repeat a training profile; none where there is no such run.
    pub repeat_3sigma_dph: Option<[f64; AXES]>,
    /// The mean over those of another profile.
    pub other_3sigma_dph: Option<[f64; AXES]>,
    /// The stages of those that repeat a training profile; none where there is no such run.
    #[serde(default)]
    pub repeat_stages_3sigma_dph: Option<[[f64; AXES]; 2]>,
    /// Mean of the corrected rates of the unseen runs, RMS over the runs: what three sigma about each run's own mean leaves out.
    #[serde(default)]
    pub verify_mean_dph: [f64; AXES],
    /// Bias instability of the unseen runs by Allan deviation (its least value over 0.664), deg/h.
    pub bias_instability_dph: [f64; AXES],
}

/// A method in the comparison.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// Its name.
    pub method: String,
    /// Numbers identified per axis.
    pub parameters: usize,
    /// Errors that it reaches.
    #[serde(flatten)]
    pub judged: Judged,
    /// Duration of the identification, s.
    pub identification_s: f64,
    /// Cost on the unit; missing if `hrg-board` was not at hand.
    #[serde(rename = "weight")]
    pub cost: Option<Cost>,
    /// Notes of the search.
    pub notes: Vec<String>,
    /// Course of each search.
    #[serde(skip)]
    pub history: Vec<History>,
    /// Of a method of a user's own: corrected rates of the verify runs, a value each step. It has no image.
    #[serde(skip)]
    pub own: Option<Vec<[Vec<f64>; AXES]>>,
}

/// A method of a user's own: what it made of the runs.
#[derive(Debug, Clone)]
pub struct Own {
    /// Its name.
    pub name: String,
    /// Its corrected rates for each verify run, as recordings.
    pub verify: Vec<Recording>,
    /// The same for each train run, where it tells.
    pub train: Option<Vec<Recording>>,
    /// Duration of the identification, s; 0 where it is not known.
    pub seconds: f64,
}

impl Own {
    /// Corrected rates on the steps of a run.
    fn rates(&self, corrected: &Recording, of: &Steps) -> Result<[Vec<f64>; AXES], BadInput> {
        let own = Steps::new(corrected)?;
        let skip = (of.start_s - own.start_s).round();
        if !(skip >= 0.0 && skip as usize + of.len() <= own.len()) {
            let end = |s: &Steps| s.start_s + s.len() as f64 - 1.0;
            return Err(BadInput(format!(
                "{}: its rates run from {:.0} to {:.0} s, those of the run from {:.0} to {:.0} s; give a row for each second of the run",
                self.name,
                own.start_s,
                end(&own),
                of.start_s,
                end(of)
            )));
        }
        let lacks = of.present().find(|a| own.rate_dph[*a].iter().all(|v| v.is_nan()));
        if let Some(a) = lacks {
            return Err(BadInput(format!("{}: it has no rates of axis {}", self.name, AXIS_NAMES[a])));
        }
        Ok(own.rate_dph.map(|v| v[skip as usize..skip as usize + of.len()].to_vec()))
    }

    /// Its row.
    fn row(&self, bench: &Bench) -> Result<Row, BadInput> {
        let all = |runs: &[Recording], steps: &[Steps]| -> Result<Vec<_>, BadInput> {
            if runs.len() != steps.len() {
                return Err(BadInput(format!(
                    "{}: corrected rates of {} runs for {}",
                    self.name,
                    runs.len(),
                    steps.len()
                )));
            }
            runs.iter().zip(steps).map(|(r, s)| self.rates(r, s)).collect()
        };
        let verify = all(&self.verify, &bench.verify)?;
        let train = match &self.train {
            Some(runs) => all(runs, &bench.train)?,
            None => bench.train.iter().map(|s| [0, 1, 2].map(|_| vec![f64::NAN; s.len()])).collect(),
        };
        Ok(Row {
            method: self.name.clone(),
            parameters: 0,
            judged: bench.judged(train, verify.clone()),
            identification_s: self.seconds,
            cost: None,
            notes: vec!["a method of your own".into()],
            history: Vec::new(),
            own: Some(verify),
        })
    }
}

/// The comparison.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Comparison {
    /// The unit.
    pub unit: String,
    /// The raw rate, as a method that does nothing.
    pub raw: Judged,
    /// Unit of the figures: deg/h, or that of the quantity in the place of the rates.
    #[serde(default = "usual_unit")]
    pub rate_unit: String,
    /// Seconds of a mean: 100, or 30 or 10 where a run is too short for that.
    #[serde(default = "usual_mean_s")]
    pub mean_s: usize,
    /// The methods.
    pub rows: Vec<Row>,
    /// Sentence on the unseen runs that repeat a training profile, and those that do not.
    pub about_verify: String,
    /// Methods that could not be used, and why.
    pub left_out: Vec<String>,
}

fn usual_unit() -> String {
    hrg_data::recording::metadata::DEG_PER_H.into()
}

fn usual_mean_s() -> usize {
    MEAN_S
}

/// Root mean square over the axes that are there.
#[must_use]
pub fn over_axes(v: &[f64; AXES]) -> f64 {
    let there: Vec<f64> = v.iter().copied().filter(|x| x.is_finite()).collect();
    (there.iter().map(|x| x * x).sum::<f64>() / there.len() as f64).sqrt()
}

/// Mean over runs of a figure of each axis.
fn over_runs(runs: &[[Vec<f64>; AXES]], figure: impl Fn(&[f64]) -> f64) -> [f64; AXES] {
    [0, 1, 2].map(|a: usize| {
        // (An axis that is not there has no finite rate, and so has a run without a stage.)
        let there: Vec<f64> =
            runs.iter().filter(|r| r[a].iter().any(|v| v.is_finite())).map(|r| figure(&r[a])).collect();
        if there.is_empty() {
            f64::NAN
        } else {
            there.iter().sum::<f64>() / there.len() as f64
        }
    })
}

/// Three standard deviations of means over some seconds.
#[must_use]
pub fn three_sigma(v: &[f64], mean_s: usize) -> f64 {
    3.0 * std_dev(&block_means(v, mean_s))
}

/// Least Allan deviation over 0.664: the level of flicker that would give it.
fn bias_instability(v: &[f64]) -> f64 {
    let points = allan::overlapping(v, f64::from(hrg_core::MODEL_STEP_S), &allan::octaves(v.len()));
    points.iter().map(|p| p.deviation).fold(f64::INFINITY, f64::min) / allan::FLICKER
}

/// Rates of a run, axis by axis.
type Rates = [Vec<f64>; AXES];
/// The stage of each step of a run, axis by axis.
type Stages = [Vec<Option<Stage>>; AXES];

/// The runs on which images are judged.
struct Bench {
    train: Vec<Steps>,
    /// The stage of each step of each training run, axis by axis.
    stages: Vec<Stages>,
    verify: Vec<Steps>,
    verify_stages: Vec<Stages>,
    /// Set for each verify run that repeats a training profile.
    repeats: Vec<bool>,
    /// Steps at the start of each run that are not judged.
    skip: usize,
    /// Seconds of a mean.
    mean_s: usize,
}

impl Bench {
    fn new(prepared: &fit::Prepared, verify: Vec<Steps>, from_s: f64) -> Self {
        let scaling = &prepared.calibration.scaling;
        let curves = prepared.calibration.axes.each_ref().map(|a| a.curve);
        let runs: Vec<Run> = verify.iter().map(|v| Run::new(v.clone(), curves)).collect();
        let again = |v: &Run| prepared.runs.iter().any(|t| independence::repeats(v, t));
        let stages = |r: &Run| [0, 1, 2].map(|a| stages::of_run(r, scaling, a));
        Self {
            train: prepared.runs.iter().map(|r| r.steps.clone()).collect(),
            stages: prepared.runs.iter().map(stages).collect(),
            verify_stages: runs.iter().map(stages).collect(),
            repeats: runs.iter().map(again).collect(),
            mean_s: verify.first().map_or(MEAN_S, |s| s.mean_s),
            verify,
            skip: from_s as usize,
        }
    }

    /// Errors of rates after a given correction.
    fn judge(&self, correct: impl Fn(&Steps) -> [Vec<f64>; AXES]) -> Judged {
        self.judged(self.train.iter().map(&correct).collect(), self.verify.iter().map(&correct).collect())
    }

    /// Errors of corrected rates of the train runs and of the verify runs.
    fn judged(&self, mut train: Vec<[Vec<f64>; AXES]>, mut verify: Vec<[Vec<f64>; AXES]>) -> Judged {
        for rates in train.iter_mut().chain(&mut verify).flatten() {
            rates.iter_mut().take(self.skip).for_each(|v| *v = f64::NAN);
        }
        let three_sigma = |v: &[f64]| three_sigma(v, self.mean_s);
        let of_stage = |stage, runs: &[Rates], stages: &[Stages]| -> [f64; AXES] {
            let both = runs.iter().zip(stages);
            let parts: Vec<Rates> =
                both.map(|(r, s)| [0, 1, 2].map(|a: usize| stages::only(&r[a], &s[a], stage))).collect();
            over_runs(&parts, three_sigma)
        };
        fn only<T: Clone>(all: &[T], kinds: &[bool], kind: bool) -> Vec<T> {
            all.iter().zip(kinds).filter(|(_, k)| **k == kind).map(|(v, _)| v.clone()).collect()
        }
        let of_kind = |kind: bool| {
            let chosen = only(&verify, &self.repeats, kind);
            (!chosen.is_empty()).then(|| over_runs(&chosen, three_sigma))
        };
        let (again, again_stages) =
            (only(&verify, &self.repeats, true), only(&self.verify_stages, &self.repeats, true));
        Judged {
            train_3sigma_dph: over_runs(&train, three_sigma),
            train_stages_3sigma_dph: Stage::ALL.map(|s| of_stage(s, &train, &self.stages)),
            repeat_stages_3sigma_dph: (!again.is_empty())
                .then(|| Stage::ALL.map(|s| of_stage(s, &again, &again_stages))),
            verify_mean_dph: over_runs(&verify, |v| mean(v).powi(2)).map(f64::sqrt),
            verify_3sigma_dph: over_runs(&verify, three_sigma),
            repeat_3sigma_dph: of_kind(true),
            other_3sigma_dph: of_kind(false),
            bias_instability_dph: over_runs(&verify, |v| bias_instability(&v[self.skip.min(v.len())..])),
        }
    }

    /// Sentence on the verify runs: those that repeat a training profile, and the others.
    fn about(&self) -> String {
        let repeats = self.repeats.iter().filter(|r| **r).count();
        match (repeats, self.repeats.len() - repeats) {
            (_, 0) => "every verify run repeats a training profile: what a method does on another one is not known; give --verify a run of another profile as well".into(),
            (0, _) => "no verify run repeats a training profile".into(),
            (repeats, others) => format!("of the verify runs {repeats} repeat a training profile and {others} do not"),
        }
    }
}

/// The image of the traced model.
fn traced(train: &[Recording], verify: &Recording, units: Units) -> Result<Identified, BadInput> {
    let start = Instant::now();
    let options = trace::Options { units, ..trace::Options::default() };
    trace::trace_with(train, verify, &options).map(|t| {
        let names: Vec<String> = t.report.effects.iter().map(|e| e.name.clone()).collect();
        let gains: usize = t
            .image
            .effects
            .iter()
            .filter_map(|e| hrg_core::effects::by_id(e.id))
            .map(|f| f.outputs + f.parameters.len())
            .sum();
        Identified {
            parameters: hrg_core::bias::TERMS + gains,
            seconds: start.elapsed().as_secs_f64(),
            notes: vec![if names.is_empty() {
                "no effect beyond eq 7 is warranted".to_string()
            } else {
                format!("found {}", names.join(", "))
            }],
            calibration: t.image,
            history: Vec::new(),
        }
    })
}

/// Options of a comparison beside its recordings.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Seed of swarms and genetic searches.
    pub seed: u64,
    /// Permission for recordings of different units.
    pub units: Units,
    /// From this time of each run on the images are judged, s: a paper may leave the soak before its ramp out.
    pub from_s: f64,
}

/// Compares methods, the traced model and a user's own among them. Calibrations go to `out` as `METHOD.toml`.
///
/// # Errors
/// Recordings that cannot be used; a method that cannot is listed in [`Comparison::left_out`].
pub fn compare(
    train: &[Recording],
    verify: &[Recording],
    (methods, own): (&[Contender], &[Own]),
    options: &Options,
    out: &Path,
    mut tell: impl FnMut(&str),
) -> anyhow::Result<Comparison> {
    let &Options { seed, units, from_s } = options;
    let prepared = fit::prepare_for(train, units)?;
    let steps = unseen_steps(train, verify, &prepared, units)?;
    if let Some(short) =
        steps.iter().chain(prepared.runs.iter().map(|r| &r.steps)).find(|s| (s.len() as f64) < from_s + 600.0)
    {
        return Err(BadInput::new(format!(
            "a run lasts {} s: judged from {from_s} s on, less than ten minutes of it are left; give an earlier --from",
            short.len()
        ))
        .into());
    }
    let first = verify.first().ok_or_else(|| BadInput::new("no recording to verify on was given"))?;
    let bench = Bench::new(&prepared, steps, from_s);
    let mut rows = Vec::new();
    let mut left_out = Vec::new();
    for (k, contender) in methods.iter().enumerate() {
        let method = contender.name();
        tell(method);
        let part = |k: usize| k as f64 / methods.len() as f64;
        let found = progress::part(part(k), part(k + 1), || match contender {
            Contender::Trace => traced(train, first, units),
            Contender::Method(m) => identify(&prepared, *m, seed).map_err(BadInput::from),
        });
        let found = match found {
            Ok(f) => f,
            Err(e) => {
                left_out.push(format!("{method}: {e}"));
                continue;
            }
        };
        let path = out.join(format!("{method}.toml"));
        let judged = bench.judge(|s| fit::correct(&found.calibration, s));
        let mut calibration: Calibration = found.calibration;
        calibration.sequence = 1;
        for a in bench.train[0].present() {
            calibration.axes[a].train_rms_dph = (judged.train_3sigma_dph[a] / 3.0) as f32;
            calibration.axes[a].verify_rms_dph = (judged.verify_3sigma_dph[a] / 3.0) as f32;
        }
        image_file::save(&path, &calibration)?;
        rows.push(Row {
            method: method.to_string(),
            parameters: found.parameters,
            judged,
            identification_s: found.seconds,
            cost: None,
            notes: found.notes,
            history: found.history,
            own: None,
        });
    }
    for method in own {
        if rows.iter().any(|r| r.method == method.name) || method.name == "raw" {
            return Err(BadInput(format!("there is a method {} already; give yours another name", method.name)).into());
        }
        rows.push(method.row(&bench)?);
    }
    Ok(Comparison {
        unit: first.unit().to_string(),
        raw: bench.judge(|s| s.rate_dph.clone()),
        about_verify: bench.about(),
        rate_unit: first.rate_unit().to_string(),
        mean_s: bench.mean_s,
        rows,
        left_out,
    })
}

/// The verify runs on model steps: raw, of the same unit, with enough data, and sharing none with the train runs.
fn unseen_steps(
    train: &[Recording],
    verify: &[Recording],
    prepared: &fit::Prepared,
    units: Units,
) -> Result<Vec<Steps>, BadInput> {
    let all: Vec<&Recording> = train.iter().chain(verify).collect();
    independence::same_unit(&all, units)?;
    facts::agree(&all).map_err(BadInput::from)?;
    let curves = prepared.calibration.axes.each_ref().map(|a| a.curve);
    let steps = verify
        .iter()
        .map(|r| {
            if r.corrected() {
                return Err(BadInput::new("the recording to verify on holds corrected rates; use the raw one"));
            }
            for t in train {
                independence::require(&[(t, "train"), (r, "verify")])?;
            }
            Steps::new(r)
        })
        .collect::<Result<Vec<_>, BadInput>>()?;
    let mut runs: Vec<Run> = steps.into_iter().map(|s| Run::new(s, curves)).collect();
    let mut learnt = prepared.runs.clone();
    enough_data::agree_on_means(&mut learnt.iter_mut().chain(&mut runs).collect::<Vec<_>>());
    for (run, r) in runs.iter().zip(verify) {
        enough_data::require(run, r.source_or("the verify run"))?;
    }
    Ok(runs.into_iter().map(|r| r.steps).collect())
}

/// Has `hrg-board cost` count what each image costs. A program of its own, because it brings the emulator with it.
///
/// # Errors
/// If it cannot be started, or fails.
pub fn count_costs(c: &mut Comparison, board: &Path, out: &Path, recording: &Path, seconds: u64) -> anyhow::Result<()> {
    let with_image = |r: &&mut Row| r.own.is_none();
    let names = c.rows.iter_mut().filter(with_image).map(|r| out.join(format!("{}.toml", r.method)));
    let files: Vec<PathBuf> = names.collect();
    let output = Command::new(board)
        .args(["cost", "--json", "--seconds", &seconds.to_string(), "--recording"])
        .arg(recording)
        .args(&files)
        .output()?;
    if !output.status.success() {
        return Err(BadInput::new(format!(
            "{} could not count what the images cost: {}",
            board.display(),
            String::from_utf8_lossy(&output.stderr).trim()
        ))
        .into());
    }
    let costs: Vec<Cost> = serde_json::from_slice(&output.stdout).map_err(|_| {
        BadInput::new(format!("{} does not answer as hrg-board does; give the right one", board.display()))
    })?;
    for (row, w) in c.rows.iter_mut().filter(with_image).zip(costs) {
        row.cost = Some(w);
    }
    Ok(())
}

/// Headings of the table.
const HEADER: [&str; 14] = [
    "method",
    "numbers",
    "train 3s",
    "cooling",
    "heating",
    "repeat 3s",
    "other 3s",
    "mean",
    "instability",
    "time s",
    "f to bias",
    "update",
    "bytes",
    "ELF differs",
];

/// A column more: its heading, and what stands there for a method.
pub type Column<'a> = (&'a str, &'a dyn Fn(&str) -> String);

/// The table, plain text or Markdown. `last` adds a column.
#[must_use]
pub fn table(c: &Comparison, markdown: bool, last: Option<Column<'_>>) -> String {
    let dash = || "-".to_string();
    let figure = |v: f64| match v {
        v if v.is_nan() => dash(),
        v if v < 0.1 => format!("{v:.4}"),
        v => format!("{v:.3}"),
    };
    let judged = |j: &Judged| -> Vec<String> {
        // (Stages of unseen runs, where there are any.)
        let [cooling, heating] = j.repeat_stages_3sigma_dph.as_ref().unwrap_or(&j.train_stages_3sigma_dph);
        let unseen = [&j.repeat_3sigma_dph, &j.other_3sigma_dph];
        let all =
            [Some(&j.train_3sigma_dph), Some(cooling), Some(heating)].into_iter().chain(unseen.map(Option::as_ref));
        all.chain([Some(&j.verify_mean_dph), Some(&j.bias_instability_dph)])
            .map(|v| v.map_or_else(dash, |v| figure(over_axes(v))))
            .collect()
    };
    let mut lines: Vec<Vec<String>> = vec![HEADER.map(String::from).to_vec()];
    lines.push(["raw".to_string(), dash()].into_iter().chain(judged(&c.raw)).chain((0..5).map(|_| dash())).collect());
    for r in &c.rows {
        let w = r.cost.as_ref();
        let costs = [
            if r.identification_s > 0.0 { format!("{:.2}", r.identification_s) } else { dash() },
            w.map_or_else(dash, |w| format!("{:.0}", w.bias_instructions + w.curve_instructions)),
            w.map_or_else(dash, |w| format!("{:.0}", w.update_instructions)),
            w.map_or_else(dash, |w| w.bytes.to_string()),
            w.map_or_else(dash, |w| format!("{} of {}", w.differing, w.frames)),
        ];
        lines.push(
            [r.method.clone(), if r.own.is_some() { dash() } else { r.parameters.to_string() }]
                .into_iter()
                .chain(judged(&r.judged))
                .chain(costs)
                .collect(),
        );
    }
    if let Some((heading, cell)) = last {
        for (n, line) in lines.iter_mut().enumerate() {
            let text = if n == 0 { heading.to_string() } else { cell(&line[0]) };
            line.push(text);
        }
    }
    let width: Vec<usize> = (0..lines[0].len()).map(|j| lines.iter().map(|l| l[j].len()).max().unwrap_or(0)).collect();
    let mut out = String::new();
    for (n, line) in lines.iter().enumerate() {
        let cells: Vec<String> = line
            .iter()
            .enumerate()
            .map(|(j, c)| if j == 0 { format!("{c:<w$}", w = width[j]) } else { format!("{c:>w$}", w = width[j]) })
            .collect();
        if markdown {
            let _ = writeln!(out, "| {} |", cells.join(" | "));
            if n == 0 {
                let rules: Vec<String> = width
                    .iter()
                    .enumerate()
                    .map(|(j, w)| if j == 0 { "-".repeat(*w) } else { format!("{}:", "-".repeat(w - 1)) })
                    .collect();
                let _ = writeln!(out, "| {} |", rules.join(" | "));
            }
        } else {
            let _ = writeln!(out, "{}", cells.join("  "));
        }
    }
    out
}

/// The picture: errors on training and unseen runs, method by method.
///
/// # Errors
/// If the drawing library fails.
pub fn picture(c: &Comparison) -> anyhow::Result<String> {
    let pair = |j: &Judged| match (&j.repeat_3sigma_dph, &j.other_3sigma_dph) {
        (Some(repeat), Some(other)) => [over_axes(repeat), over_axes(other)],
        _ => [over_axes(&j.train_3sigma_dph), over_axes(&j.verify_3sigma_dph)],
    };
    let both = c.raw.repeat_3sigma_dph.is_some() && c.raw.other_3sigma_dph.is_some();
    let labels = if both {
        ["repeat of the training run", "another profile"]
    } else {
        ["on the training runs", "on runs never seen"]
    };
    let bars = plot::Bars {
        title: format!("{}: three sigma of means over {} s, RMS of the axes", c.unit, c.mean_s),
        unit: c.rate_unit.clone(),
        labels: labels.map(String::from),
        rows: [("raw".to_string(), pair(&c.raw))]
            .into_iter()
            .chain(c.rows.iter().map(|r| (r.method.clone(), pair(&r.judged))))
            .collect(),
    };
    plot::bars(&bars, 860)
}

/// The searches drawn: objective and coefficients over the iterations.
///
/// # Errors
/// If the drawing library fails.
pub fn searches(c: &Comparison) -> anyhow::Result<String> {
    let all: Vec<_> =
        c.rows.iter().filter(|r| !r.history.is_empty()).map(|r| (r.method.clone(), r.history.clone())).collect();
    history::picture(&all)
}

/// One line per axis and method: means of the corrected rates over time, for looking closer.
///
/// # Errors
/// If a calibration or the drawing fails.
pub fn residuals(c: &Comparison, verify: &Recording, out: &Path) -> anyhow::Result<String> {
    let steps = Steps::new(verify)?;
    let means = |v: &[f64]| -> Vec<(f64, f64)> {
        block_means(v, c.mean_s)
            .into_iter()
            .enumerate()
            .map(|(k, m)| ((k as f64 + 0.5) * c.mean_s as f64 / 3600.0, m))
            .collect()
    };
    let mut panels = Vec::new();
    for r in &c.rows {
        let corrected = match &r.own {
            Some(own) => own.first().cloned().unwrap_or_default(),
            None => fit::correct(&image_file::load(&out.join(format!("{}.toml", r.method)))?, &steps),
        };
        panels.push(Panel {
            title: r.method.clone(),
            x: "time [h]".into(),
            y: c.rate_unit.clone(),
            log: false,
            series: steps
                .present()
                .map(|a| Series {
                    label: AXIS_NAMES[a].to_string(),
                    points: means(&corrected[a]),
                    colour: a + 1,
                    dots: false,
                })
                .collect(),
        });
    }
    plot::svg(&panels, 3, 420, 260)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_method_is_refused_with_those_there_are() {
        assert_eq!(Contender::by_name("trace"), Ok(Contender::Trace));
        assert_eq!(Contender::by_name("ga-bp"), Ok(Contender::Method(Method::GaBp)));
        let e = Contender::by_name("guess").expect_err("refused").0;
        assert!(
            e.contains("guess") && e.contains("polynomial, polynomial-auto, table, ga-bp, ga-bp-literal, direct,"),
            "{e}"
        );
        assert!(e.ends_with("inputs-network and trace"), "{e}");
    }
}
