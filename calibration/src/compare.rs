//! Methods side by side: the same training runs, the same unseen runs, one table.

use crate::fit::evidence;
use crate::fit::independence::{self, Units};
use crate::fit::method::Method;
use crate::fit::methods::{identify, Identified};
use crate::fit::{self, MEAN_S};
use crate::image_file;
use crate::numeric::allan;
use crate::numeric::stats::{block_means, std_dev};
use crate::plot::{self, Panel, Series};
use crate::recording::facts;
use crate::recording::steps::{Run, Steps};
use crate::recording::Recording;
use crate::{trace, BadInput, AXIS_NAMES};
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// What an image costs on the unit, as `hrg-board cost` counts it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// The calibration.
    pub calibration: String,
    /// Mean instructions of one update: three axes, frequencies to biases, windows and states included.
    pub update_instructions: f64,
    /// Mean instructions of the bias model of one axis alone.
    pub bias_instructions: f64,
    /// Mean instructions of turning one frequency into a temperature and a slope; zero where the model needs neither.
    pub curve_instructions: f64,
    /// Length of the block.
    pub bytes: usize,
    /// Frames that the ELF sent.
    pub frames: usize,
    /// Frames that differ from hrg-core on the desktop.
    pub differing: usize,
}

/// What is compared: a method, or the traced model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contender {
    /// A method.
    Method(Method),
    /// What [`crate::trace`] finds.
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

/// A method in the comparison.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Row {
    /// Its name.
    pub method: String,
    /// Numbers identified per axis.
    pub parameters: usize,
    /// Three sigma of 100 s means on the training runs, per axis, deg/h.
    pub train_3sigma_dph: [f64; AXES],
    /// The same on the unseen runs: the mean over them.
    pub verify_3sigma_dph: [f64; AXES],
    /// Bias instability of the unseen runs by Allan deviation (its least value over 0.664), deg/h.
    pub bias_instability_dph: [f64; AXES],
    /// How long the identification took, s.
    pub identification_s: f64,
    /// What it costs on the unit; missing where `hrg-board` was not at hand.
    #[serde(rename = "weight")]
    pub cost: Option<Cost>,
    /// What the search reached.
    pub notes: Vec<String>,
}

/// The comparison.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Comparison {
    /// The unit.
    pub unit: String,
    /// Three sigma of 100 s means of the raw rate on the unseen runs, per axis, deg/h.
    pub raw_3sigma_dph: [f64; AXES],
    /// Bias instability of the raw rate.
    pub raw_bias_instability_dph: [f64; AXES],
    /// The methods.
    pub rows: Vec<Row>,
    /// Methods that could not be used, and why.
    pub left_out: Vec<String>,
}

/// Root mean square over the axes that are there.
#[must_use]
pub fn over_axes(v: &[f64; AXES]) -> f64 {
    let there: Vec<f64> = v.iter().copied().filter(|x| x.is_finite()).collect();
    (there.iter().map(|x| x * x).sum::<f64>() / there.len() as f64).sqrt()
}

/// Mean over runs of a figure of each axis.
fn over_runs(runs: &[[Vec<f64>; AXES]], figure: impl Fn(&[f64]) -> f64) -> [f64; AXES] {
    // (An axis that is not there has no finite rate.)
    let there = |a: usize| runs.iter().any(|r| r[a].iter().any(|v| v.is_finite()));
    [0, 1, 2].map(|a: usize| {
        if !there(a) {
            f64::NAN
        } else {
            runs.iter().map(|r| figure(&r[a])).sum::<f64>() / runs.len().max(1) as f64
        }
    })
}

fn three_sigma(v: &[f64]) -> f64 {
    3.0 * std_dev(&block_means(v, MEAN_S))
}

/// Least Allan deviation over 0.664: the level of flicker that would give it.
fn bias_instability(v: &[f64]) -> f64 {
    let points = allan::overlapping(v, f64::from(hrg_core::MODEL_STEP_S), &allan::octaves(v.len()));
    points.iter().map(|p| p.deviation).fold(f64::INFINITY, f64::min) / allan::FLICKER
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
        }
    })
}

/// Compares methods, the traced model among them. Calibrations go to `out` as `METHOD.toml`.
///
/// # Errors
/// Recordings that cannot be used; a method that cannot is listed in [`Comparison::left_out`].
pub fn compare(
    train: &[Recording],
    verify: &[Recording],
    methods: &[Contender],
    seed: u64,
    units: Units,
    out: &Path,
    mut progress: impl FnMut(&str),
) -> anyhow::Result<Comparison> {
    let prepared = fit::prepare_for(train, units)?;
    let steps = unseen_steps(train, verify, &prepared, units)?;
    let first = verify.first().ok_or_else(|| BadInput::new("no recording to verify on was given"))?;
    let train_steps: Vec<Steps> = prepared.runs.iter().map(|r| r.steps.clone()).collect();
    let raw: Vec<[Vec<f64>; AXES]> = steps.iter().map(|s| s.rate_dph.clone()).collect();
    let mut rows = Vec::new();
    let mut left_out = Vec::new();
    for contender in methods {
        let method = contender.name();
        progress(method);
        let found = match contender {
            Contender::Trace => traced(train, first, units),
            Contender::Method(m) => identify(&prepared, *m, seed).map_err(BadInput::from),
        };
        let found = match found {
            Ok(f) => f,
            Err(e) => {
                left_out.push(format!("{method}: {e}"));
                continue;
            }
        };
        let path = out.join(format!("{method}.toml"));
        let corrected =
            |steps: &[Steps]| -> Vec<_> { steps.iter().map(|s| fit::correct(&found.calibration, s)).collect() };
        let (on_train, on_verify) = (corrected(&train_steps), corrected(&steps));
        let mut calibration: Calibration = found.calibration;
        calibration.sequence = 1;
        let (t, v) = (over_runs(&on_train, three_sigma), over_runs(&on_verify, three_sigma));
        for a in train_steps[0].present() {
            calibration.axes[a].train_rms_dph = (t[a] / 3.0) as f32;
            calibration.axes[a].verify_rms_dph = (v[a] / 3.0) as f32;
        }
        image_file::save(&path, &calibration)?;
        rows.push(Row {
            method: method.to_string(),
            parameters: found.parameters,
            train_3sigma_dph: t,
            verify_3sigma_dph: v,
            bias_instability_dph: over_runs(&on_verify, bias_instability),
            identification_s: found.seconds,
            cost: None,
            notes: found.notes,
        });
    }
    Ok(Comparison {
        unit: first.unit().to_string(),
        raw_3sigma_dph: over_runs(&raw, three_sigma),
        raw_bias_instability_dph: over_runs(&raw, bias_instability),
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
    verify
        .iter()
        .map(|r| {
            if r.corrected() {
                return Err(BadInput::new("the recording to verify on holds corrected rates; use the raw one"));
            }
            for t in train {
                independence::require(&[(t, "train"), (r, "verify")])?;
            }
            let run = Run::new(Steps::new(r)?, curves);
            evidence::require(&run, if r.source.is_empty() { "the verify run" } else { &r.source })?;
            Ok(run.steps)
        })
        .collect()
}

/// Has `hrg-board cost` count what each image costs. A program of its own, because it brings the emulator with it.
///
/// # Errors
/// Where it cannot be started, or fails.
pub fn count_costs(c: &mut Comparison, board: &Path, out: &Path, recording: &Path, seconds: u64) -> anyhow::Result<()> {
    let files: Vec<PathBuf> = c.rows.iter().map(|r| out.join(format!("{}.toml", r.method))).collect();
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
    for (row, w) in c.rows.iter_mut().zip(costs) {
        row.cost = Some(w);
    }
    Ok(())
}

/// A column more: its heading, and what stands there for a method.
pub type Column<'a> = (&'a str, &'a dyn Fn(&str) -> String);

/// The table, plain text or Markdown. `last` adds a column.
#[must_use]
pub fn table(c: &Comparison, markdown: bool, last: Option<Column<'_>>) -> String {
    let header = [
        "method",
        "numbers",
        "train 3s",
        "verify 3s",
        "instability",
        "time s",
        "f to bias",
        "update",
        "bytes",
        "ELF differs",
    ];
    let mut lines: Vec<Vec<String>> = vec![header.map(String::from).to_vec()];
    let dash = || "-".to_string();
    let figure = |v: f64| if v < 0.1 { format!("{v:.4}") } else { format!("{v:.3}") };
    lines.push(
        [
            "raw".into(),
            dash(),
            dash(),
            figure(over_axes(&c.raw_3sigma_dph)),
            figure(over_axes(&c.raw_bias_instability_dph)),
        ]
        .into_iter()
        .chain((0..5).map(|_| dash()))
        .collect(),
    );
    for r in &c.rows {
        let w = r.cost.as_ref();
        lines.push(vec![
            r.method.clone(),
            r.parameters.to_string(),
            figure(over_axes(&r.train_3sigma_dph)),
            figure(over_axes(&r.verify_3sigma_dph)),
            figure(over_axes(&r.bias_instability_dph)),
            format!("{:.2}", r.identification_s),
            w.map_or_else(dash, |w| format!("{:.0}", w.bias_instructions + w.curve_instructions)),
            w.map_or_else(dash, |w| format!("{:.0}", w.update_instructions)),
            w.map_or_else(dash, |w| w.bytes.to_string()),
            w.map_or_else(dash, |w| format!("{} of {}", w.differing, w.frames)),
        ]);
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
/// Where the drawing library fails.
pub fn picture(c: &Comparison) -> anyhow::Result<String> {
    let bars = |title: &str, y: &dyn Fn(&Row) -> [f64; 2], raw: Option<f64>| plot::Bars {
        title: title.to_string(),
        unit: "deg/h".to_string(),
        labels: ["on the training runs".into(), "on runs never seen".into()],
        rows: raw
            .map(|r| ("raw".to_string(), [f64::NAN, r]))
            .into_iter()
            .chain(c.rows.iter().map(|r| (r.method.clone(), y(r))))
            .collect(),
    };
    plot::bars(
        &bars(
            &format!("{}: three sigma of 100 s means, RMS of the axes", c.unit),
            &|r| [over_axes(&r.train_3sigma_dph), over_axes(&r.verify_3sigma_dph)],
            Some(over_axes(&c.raw_3sigma_dph)),
        ),
        860,
    )
}

/// One line per axis and method: corrected 100 s means over time, for looking closer.
///
/// # Errors
/// Where a calibration or the drawing fails.
pub fn residuals(c: &Comparison, verify: &Recording, out: &Path) -> anyhow::Result<String> {
    let steps = Steps::new(verify)?;
    let means = |v: &[f64]| -> Vec<(f64, f64)> {
        block_means(v, MEAN_S)
            .into_iter()
            .enumerate()
            .map(|(k, m)| ((k as f64 + 0.5) * MEAN_S as f64 / 3600.0, m))
            .collect()
    };
    let mut panels = Vec::new();
    for r in &c.rows {
        let calibration = image_file::load(&out.join(format!("{}.toml", r.method)))?;
        let corrected = fit::correct(&calibration, &steps);
        panels.push(Panel {
            title: r.method.clone(),
            x: "time [h]".into(),
            y: "deg/h".into(),
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
        assert!(e.contains("guess") && e.contains("polynomial, ga-bp, direct and trace"), "{e}");
    }
}
