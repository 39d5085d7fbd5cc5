//! Methods over several units and several draws of noise: a table of one draw ranks what the next draw turns round.

use super::{Case, Work};
use crate::faults::trials;
use crate::inputs::Unit;
use anyhow::{Context, Result};
use hrg_core::AXES;
use hrg_data::cost::Cost;
use hrg_data::image_file;
use hrg_data::numeric::stats::{block_means, mean, quantile};
use hrg_data::recording::steps::{Run, Steps, MEAN_S};
use hrg_identify::fit;
use hrg_identify::fit::independence::Units;
use hrg_papers::compare;
use hrg_papers::compare::{Comparison, Contender};
use hrg_papers::stages;
use hrg_papers::stages::Stage;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Figures of a method on runs that it did not see; NaN: none.
const COLUMNS: [&str; 5] = ["repeat", "cooling", "heating", "other profile", "mean there"];
/// Places of the two that the short table has.
const REPEAT: usize = 0;
const OTHER: usize = 3;

type Figures = [f64; COLUMNS.len()];

/// The runs on which images are judged, and neither identified nor chosen.
struct Judge {
    repeat: Option<(Steps, [Vec<Option<Stage>>; AXES])>,
    other: Steps,
    /// Steps at the start of each run that are not judged.
    skip: usize,
    /// The unit of the figures, deg/h, by axis.
    unit_dph: [f64; AXES],
}

impl Judge {
    /// Root mean square over the axes of a figure of each, in its unit.
    fn over_axes(&self, rates: &[Vec<f64>; AXES], figure: impl Fn(&[f64]) -> f64) -> f64 {
        compare::over_axes(&[0, 1, 2].map(|a: usize| figure(&rates[a]) / self.unit_dph[a]))
    }

    fn figures(&self, correct: impl Fn(&Steps) -> [Vec<f64>; AXES]) -> Figures {
        let judged = |steps: &Steps| {
            let mut rates = correct(steps);
            rates.iter_mut().for_each(|v| v.iter_mut().take(self.skip).for_each(|v| *v = f64::NAN));
            rates
        };
        // (A run without a stage has none.)
        let three_sigma = |v: &[f64]| match compare::three_sigma(v, MEAN_S) {
            0.0 => f64::NAN,
            sigma => sigma,
        };
        let mut out = [f64::NAN; COLUMNS.len()];
        if let Some((steps, stages)) = &self.repeat {
            let rates = judged(steps);
            out[REPEAT] = self.over_axes(&rates, three_sigma);
            for (k, stage) in Stage::ALL.into_iter().enumerate() {
                let part = [0, 1, 2].map(|a: usize| stages::only(&rates[a], &stages[a], stage));
                out[REPEAT + 1 + k] = self.over_axes(&part, three_sigma);
            }
        }
        let rates = judged(&self.other);
        out[OTHER] = self.over_axes(&rates, three_sigma);
        out[OTHER + 1] = self.over_axes(&rates, |v| mean(&block_means(v, MEAN_S)));
        out
    }
}

/// Figures of each method over all units and draws.
pub struct Spread {
    /// Name and figures, a row for each draw.
    pub rows: Vec<(String, Vec<Figures>)>,
    /// The first comparison, whose images are counted and flown.
    pub first: Comparison,
    /// Methods that could not be used, and why.
    pub left_out: Vec<String>,
}

/// Three significant digits, or so.
pub fn short(v: f64) -> String {
    match v.abs() {
        size if size.is_nan() => "-".into(),
        size if size >= 99.95 => format!("{v:.0}"),
        size if size >= 9.995 => format!("{v:.1}"),
        size if size >= 0.9995 => format!("{v:.2}"),
        size if size >= 0.09995 => format!("{v:.3}"),
        _ => format!("{v:.4}"),
    }
}

/// Median, and least and most of all draws.
pub fn cell(all: &[f64]) -> String {
    let v: Vec<f64> = all.iter().copied().filter(|v| v.is_finite()).collect();
    match v.len() {
        0 => String::new(),
        1 => short(v[0]),
        _ => format!("{} ({} to {})", short(quantile(&v, 0.5)), short(quantile(&v, 0.0)), short(quantile(&v, 1.0))),
    }
}

/// A method's name in a table.
fn named(method: &str) -> String {
    if method == "raw" {
        method.into()
    } else {
        format!("`{method}`")
    }
}

/// Columns of costs on the unit.
const COSTS: [&str; 4] = ["f to bias", "update", "bytes", "ELF differs"];

fn costs(cost: Option<&Cost>) -> [String; COSTS.len()] {
    cost.map_or_else(Default::default, |w| {
        [
            format!("{:.0}", w.bias_instructions + w.curve_instructions),
            format!("{:.0}", w.update_instructions),
            w.bytes.to_string(),
            format!("{} of {}", w.differing, w.frames),
        ]
    })
}

impl Spread {
    /// A figure of a method on all draws; none where the method could not be used.
    fn figure(&self, method: &str, column: usize) -> Vec<f64> {
        let row = self.rows.iter().find(|(name, _)| name == method);
        row.iter().flat_map(|(_, all)| all.iter().map(|f| f[column])).collect()
    }

    /// `true` if a method has this figure.
    fn has(&self, column: usize) -> bool {
        self.rows.iter().any(|(_, all)| all.iter().any(|f| f[column].is_finite()))
    }

    /// The table of a case. `theirs`: what the source prints for a method.
    pub fn table(&self, theirs: &[(&str, &str)]) -> String {
        let shown: Vec<usize> = (0..COLUMNS.len()).filter(|c| self.has(*c)).collect();
        let counted = self.first.rows.iter().any(|r| r.cost.is_some());
        let mut head = vec!["method", "numbers"];
        head.extend(shown.iter().map(|c| COLUMNS[*c]));
        if counted {
            head.extend(COSTS);
        }
        if !theirs.is_empty() {
            head.push("theirs");
        }
        let mut out = format!("| {} |\n|---|{}\n", head.join(" | "), "--:|".repeat(head.len() - 1));
        for (method, _) in &self.rows {
            let row = self.first.rows.iter().find(|r| r.method == *method);
            let mut cells = vec![named(method), row.map_or_else(String::new, |r| r.parameters.to_string())];
            cells.extend(shown.iter().map(|c| cell(&self.figure(method, *c))));
            if counted {
                cells.extend(costs(row.and_then(|r| r.cost.as_ref())));
            }
            if !theirs.is_empty() {
                cells.push(theirs.iter().find(|(n, _)| n == method).map_or_else(String::new, |(_, t)| (*t).into()));
            }
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        // Methods that are left out for one reason stand together.
        let mut reasons: Vec<(String, Vec<&str>)> = Vec::new();
        for (method, why) in self.left_out.iter().filter_map(|l| l.split_once(": ")) {
            let why = why.replacen(method, "it", 1);
            match reasons.iter_mut().find(|(other, _)| *other == why) {
                Some((_, all)) => all.push(method),
                None => reasons.push((why, vec![method])),
            }
        }
        for (why, all) in reasons {
            let _ = writeln!(out, "\nLeft out: `{}`: {why}.", all.join("`, `"));
        }
        out
    }

    /// Medians as bars.
    ///
    /// # Errors
    /// If the drawing library fails.
    pub fn picture(&self, title: &str, unit: &str) -> Result<String> {
        let median = |m: &str, column| quantile(&self.figure(m, column), 0.5);
        let of = |(m, _): &(String, Vec<Figures>)| (m.clone(), [median(m, REPEAT), median(m, OTHER)]);
        let bars = hrg_data::plot::Bars {
            title: title.into(),
            unit: unit.into(),
            labels: ["repeat of the training run", "another profile"].map(String::from),
            rows: self.rows.iter().map(of).collect(),
        };
        hrg_data::plot::bars(&bars, 860)
    }
}

/// Gathers what the draws of a case gave.
fn gather(draws: Vec<(Comparison, Vec<(String, Figures)>)>) -> Result<Spread> {
    let mut rows: Vec<(String, Vec<Figures>)> = Vec::new();
    let mut left_out: Vec<String> = Vec::new();
    let mut first = None;
    for (c, figures) in draws {
        for (method, f) in figures {
            match rows.iter_mut().find(|(name, _)| *name == method) {
                Some((_, all)) => all.push(f),
                None => rows.push((method, vec![f])),
            }
        }
        for l in &c.left_out {
            if !left_out.iter().any(|other| other.split(':').next() == l.split(':').next()) {
                left_out.push(l.clone());
            }
        }
        first.get_or_insert(c);
    }
    // In the order of the methods, whatever the first draw could not use.
    let order = |name: &str| Contender::all().iter().position(|c| c.name() == name);
    rows.sort_by_key(|(name, _)| order(name));
    Ok(Spread { rows, first: first.context("no draw")?, left_out })
}

/// Figures of raw rates and of all images of a comparison.
fn judged(c: &Comparison, folder: &Path, judge: &Judge) -> Result<Vec<(String, Figures)>> {
    let mut out = vec![("raw".to_string(), judge.figures(|s| s.rate_dph.clone()))];
    for r in &c.rows {
        let image = image_file::load(&folder.join(format!("{}.toml", r.method)))?;
        out.push((r.method.clone(), judge.figures(|s| fit::correct(&image, s))));
    }
    Ok(out)
}

/// Folder of a draw's images.
pub fn folder(out: &Path, case: &str, unit: u64, seed: u64) -> PathBuf {
    out.join(case).join(format!("{unit}-{seed}"))
}

/// Seed of the noise of a unit's training run on a draw; those of its other runs follow it.
pub fn case_noise(work: &Work<'_>, unit: u64, seed: u64) -> u64 {
    10_000 * work.seed + 1000 * unit + 10 * seed
}

/// Every method on some units of a case, on some draws of noise for each.
///
/// # Errors
/// If a run cannot be made, or no method can be used.
pub fn spread(case: &Case, work: &Work<'_>) -> Result<Spread> {
    let all =
        trials(work.units * work.seeds, || Ok(()), |(), k| one(case, work, 1 + k / work.seeds, 1 + k % work.seeds))?;
    gather(all)
}

fn one(case: &Case, work: &Work<'_>, unit: u64, seed: u64) -> Result<(Comparison, Vec<(String, Figures)>)> {
    let folder = folder(work.out, case.name, unit, seed);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let noise = case_noise(work, unit, seed);
    let train = case.run_of(case.profile, unit, noise)?;
    // The trace decides on this one.
    let verify = case.run_of(case.profile, unit, noise + 1)?;
    let repeat = Steps::new(&case.run_of(case.profile, unit, noise + 9)?)?;
    let other = Steps::new(&case.run_of(case.other, unit, noise + 8)?)?;
    let prepared = fit::prepare(std::slice::from_ref(&train))?;
    let run = Run::new(repeat, prepared.calibration.axes.each_ref().map(|a| a.curve));
    let stages = [0, 1, 2].map(|a| stages::of_run(&run, &prepared.calibration.scaling, a));
    let options = compare::Options { seed, units: Units::Same, from_s: case.from_s };
    let c = compare::compare(&[train], &[verify], (&Contender::all(), &[]), &options, &folder, |_| {})?;
    let judge = Judge { repeat: Some((run.steps, stages)), other, skip: case.from_s as usize, unit_dph: [1.0; AXES] };
    let figures = judged(&c, &folder, &judge)?;
    Ok((c, figures))
}

/// Every method on units of the second plant (the truths of a folder, and the runs that they name), judged on the run that chose nothing, in its
/// noise floors. What these units lack is no member of this project's library of effects.
///
/// # Errors
/// Files that are missing or cannot be read.
pub fn foreign(recordings: &Path, work: &Work<'_>) -> Result<Spread> {
    let listed = std::fs::read_dir(recordings).with_context(|| format!("cannot read {}", recordings.display()))?;
    let mut truths: Vec<PathBuf> = listed.filter_map(|f| f.ok().map(|f| f.path())).collect();
    truths.retain(|f| f.to_string_lossy().ends_with("-truth.json"));
    truths.sort();
    gather(trials(truths.len() as u64, || Ok(()), |(), k| one_foreign(&truths[k as usize], work))?)
}

fn one_foreign(file: &Path, work: &Work<'_>) -> Result<(Comparison, Vec<(String, Figures)>)> {
    let unit = Unit::read(file)?;
    let (run, floors) = unit.judge()?;
    // (Three floors, so that three sigma of the noise is 1.)
    let judge = Judge { repeat: None, other: Steps::new(&run)?, skip: 0, unit_dph: floors.map(|f| 3.0 * f) };
    let (case, seed) = unit.name();
    let folder = folder(work.out, case, seed, 1);
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let options = compare::Options { seed: 1, units: Units::Same, from_s: 0.0 };
    let (train, verify) = (unit.runs("train")?, unit.runs("verify")?);
    let c = compare::compare(&train, &verify, (&Contender::all(), &[]), &options, &folder, |_| {})?;
    let figures = judged(&c, &folder, &judge)?;
    Ok((c, figures))
}

/// The short table: a row for each method, two columns for each case.
pub fn summary(cases: &[(&str, &Spread)]) -> String {
    let mut out = String::from("| method |");
    let mut rule = String::from("|---|");
    for (name, s) in cases {
        let repeat = s.has(REPEAT);
        let _ = if repeat { write!(out, " {name}: repeat | other profile |") } else { write!(out, " {name} |") };
        rule.push_str(if repeat { "--:|--:|" } else { "--:|" });
    }
    let _ = writeln!(out, "\n{rule}");
    for method in std::iter::once("raw").chain(Contender::all().iter().map(|c| c.name())) {
        let mut cells = Vec::new();
        for (_, s) in cases {
            if s.has(REPEAT) {
                cells.push(cell(&s.figure(method, REPEAT)));
            }
            cells.push(cell(&s.figure(method, OTHER)));
        }
        if cells.iter().any(|c| !c.is_empty()) {
            let _ = writeln!(out, "| {} | {} |", named(method), cells.join(" | "));
        }
    }
    out
}
