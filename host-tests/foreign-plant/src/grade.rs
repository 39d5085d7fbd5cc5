//! Grades `hrg trace` on written units by their truth: the class, what is flagged, what is left, and whether an image is worse than
//! the baseline. The program is run as a user runs it; only its report is read.

use crate::third::{third, OnThird};
use anyhow::{bail, Context, Result};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{IsTerminal, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;
use std::time::Instant;

/// An image counts as worse than the baseline from this ratio on: what the estimate of a deviation from 300 means varies by.
const WORSE: f64 = 1.02;
/// Floors from which on something that was not named counts as missed without a word.
const MISSED: f64 = 1.5;
/// Beginning of the names of the cases of clean units whose noise has a measured spectrum.
const MEASURED: &str = "clean-series-";

/// Grade of a report's answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Every class of the truth is named, and none that is not there.
    Right,
    /// Not right, and the report says that it is not sure: `unexplained`, `not-confirmed`, or structure left on an axis.
    Flagged,
    /// A class is named that is not there, and nothing is flagged.
    False,
    /// Something is not named, nothing is flagged, and more than 1.5 floors are left.
    Missed,
    /// Something small is not named: at most 1.5 floors are left.
    Small,
    /// The tool refused the files.
    Refused,
}

/// Result of one unit.
#[derive(Debug, Clone)]
pub struct Graded {
    /// Case and seed.
    pub name: String,
    /// Group of the case.
    pub group: String,
    /// The grade.
    pub grade: Grade,
    /// `true` if its noise has a measured spectrum.
    pub measured_spectrum: bool,
    /// Effects named, joined.
    pub named: String,
    /// `true` if an image is recommended.
    pub burn: bool,
    /// Largest ratio of the image's error to the baseline's, over the axes.
    pub worse: f64,
    /// `true` if a unit can compensate the effects.
    pub compensable: bool,
    /// Residual of the written image on the verify run, in floors, by axis.
    pub left: Vec<f64>,
    /// The same where the third run is learnt from, too; empty where there is none, or nothing to compensate.
    pub left_after_two: Vec<f64>,
    /// Residual of the truth's own forms there, fitted to the same train runs by least squares, in floors, by axis.
    pub left_by_the_truth: Vec<f64>,
    /// Size of its largest effect, in floors.
    pub size: f64,
    /// The image on the third run, by axis; empty where there is none.
    pub third: Vec<OnThird>,
    /// Time that the trace took on a processor, s.
    pub seconds: f64,
    /// Why the tool refused.
    pub why: String,
}

impl Graded {
    /// `true` if its image leaves less than the baseline on an axis of the third run, and on none more.
    fn helps(&self) -> bool {
        self.third.iter().any(OnThird::helps) && !self.hurts()
    }

    fn hurts(&self) -> bool {
        self.third.iter().any(OnThird::hurts)
    }
}

fn texts(v: &Value) -> BTreeSet<String> {
    v.as_array().into_iter().flatten().filter_map(Value::as_str).map(String::from).collect()
}

fn grade(truth: &Value, report: &Value) -> (Grade, String, f64) {
    let named: Vec<(&str, &str)> = report["effects"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|e| (e["name"].as_str().unwrap_or("?"), e["class"].as_str().unwrap_or("?")))
        .collect();
    let classes: BTreeSet<String> = named.iter().map(|n| n.1.to_string()).collect();
    let all = texts(&truth["classes"]);
    let effects: Vec<&Value> = truth["effects"].as_array().into_iter().flatten().collect();
    let mut allowed: BTreeSet<String> = all.iter().chain(&texts(&truth["beside"])).cloned().collect();
    for e in &effects {
        allowed.extend(texts(&e["classes"]));
        allowed.extend(texts(&e["beside"]));
    }
    let invented = classes.iter().any(|c| !allowed.contains(c));
    let hit = effects.iter().all(|e| !texts(&e["classes"]).is_disjoint(&classes));
    let nothing = classes.is_empty() && (all.contains("none") || effects.is_empty());
    let unexplained = report["unexplained"].as_object().is_some_and(|o| o.values().any(|v| v == true));
    let kind = report["verdict_kind"].as_str().unwrap_or("");
    let flagged = unexplained || matches!(kind, "unexplained" | "not-confirmed");
    let left = left_in_floors(truth, report).into_iter().fold(0.0, f64::max);
    let grade = if nothing || (hit && !invented) {
        Grade::Right
    } else if flagged {
        Grade::Flagged
    } else if invented {
        Grade::False
    } else if left > MISSED {
        Grade::Missed
    } else {
        Grade::Small
    };
    (grade, named.iter().map(|n| n.0).collect::<Vec<_>>().join("+"), left)
}

/// The verify run of a truth, by axis of the report: (floor, raw), deg/h.
fn floors(truth: &Value, report: &Value) -> Vec<(String, f64, f64)> {
    let run = truth["runs"].as_array().into_iter().flatten().find(|r| r["role"] == "verify");
    let axes = report["baseline"].as_object().map(|o| o.keys().cloned().collect::<Vec<_>>()).unwrap_or_default();
    axes.into_iter()
        .filter_map(|a| {
            let of = &run?["axes"][&a];
            Some((a.clone(), of["floor_dph"].as_f64()?, of["raw_dph"].as_f64()?))
        })
        .collect()
}

fn left_in_floors(truth: &Value, report: &Value) -> Vec<f64> {
    floors(truth, report)
        .into_iter()
        .map(|(a, floor, raw)| report["block"][&a]["verify_rms_dph"].as_f64().unwrap_or(raw) / floor)
        .collect()
}

fn against_baseline(truth: &Value, report: &Value) -> f64 {
    let each = floors(truth, report).into_iter().filter_map(|(a, _, raw)| {
        let image = report["block"][&a]["verify_rms_dph"].as_f64().unwrap_or(raw);
        Some(image / report["baseline"][&a]["verify_rms_dph"].as_f64()?)
    });
    each.fold(0.0, f64::max)
}

/// Size of the largest effect of a truth, in floors.
fn size(truth: &Value) -> f64 {
    let effects = truth["effects"].as_array().into_iter().flatten();
    let each = effects.flat_map(|e| e["size_floors"].as_object().into_iter().flatten().filter_map(|(_, v)| v.as_f64()));
    each.fold(0.0, f64::max)
}

/// Residual of the truth's own forms on the verify run, fitted to the same train runs, in floors by axis.
fn left_by_the_truth(truth: &Value, report: &Value) -> Vec<f64> {
    let run = truth["runs"].as_array().into_iter().flatten().find(|r| r["role"] == "verify");
    let of = |a: &String| run?["axes"][a]["oracle_floors"].as_f64();
    floors(truth, report).iter().filter_map(|(a, ..)| of(a)).collect()
}

/// The files of a truth with a role.
fn files(truth: &Value, folder: &Path, role: &str) -> Vec<PathBuf> {
    let runs = truth["runs"].as_array().into_iter().flatten().filter(|r| r["role"] == role);
    runs.map(|r| folder.join(r["file"].as_str().unwrap_or(""))).collect()
}

/// Runs the tool; its report, or the sentence by which it refuses, and the time that it took on a processor, s.
fn traced(
    hrg: &Path,
    [train, verify]: [&[PathBuf]; 2],
    [out, image]: [&Path; 2],
) -> Result<(Result<Value, String>, f64)> {
    let mut command = Command::new(hrg);
    command.arg("trace").args(train);
    for file in verify {
        command.arg("--verify").arg(file);
    }
    command.arg("--out").arg(out).arg("--calibration").arg(image);
    let begun = Instant::now();
    let mut child = command
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot run {}", hrg.display()))?;
    let mut printed = String::new();
    if let Some(mut errors) = child.stderr.take() {
        errors.read_to_string(&mut printed)?;
    }
    // (Its errors end with the program; what it has used stands until it is waited for.)
    let seconds = processor_time_s(child.id()).unwrap_or_else(|| begun.elapsed().as_secs_f64());
    let report = match child.wait()?.code() {
        Some(0) => Ok(serde_json::from_slice(&std::fs::read(out)?).context("the report is no JSON")?),
        Some(2) => Err(printed.lines().last().unwrap_or("").to_string()),
        _ => bail!("{}: hrg trace failed: {printed}", out.display()),
    };
    Ok((report, seconds))
}

/// Processor time of a child that has not been waited for, s; `None` on systems without `/proc`.
fn processor_time_s(pid: u32) -> Option<f64> {
    const TICKS_PER_S: f64 = 100.0;
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // Behind the name in parentheses: state, ten numbers, then the ticks of the program and of the system for it (proc(5)).
    let (_, numbers) = text.rsplit_once(')')?;
    let ticks: Vec<f64> = numbers.split_whitespace().skip(11).take(2).map(str::parse).collect::<Result<_, _>>().ok()?;
    Some(ticks.iter().sum::<f64>() / TICKS_PER_S)
}

/// Runs the tool on one written unit.
fn one(hrg: &Path, truth_file: &Path, scratch: &Path) -> Result<Graded> {
    let truth: Value = serde_json::from_slice(&std::fs::read(truth_file)?)
        .with_context(|| format!("{} is no truth file", truth_file.display()))?;
    let folder = truth_file.parent().unwrap_or(Path::new("."));
    let name = format!("{}-{}", truth["case"].as_str().unwrap_or("?"), truth["seed"]);
    // (The third run is for the grade alone.)
    let [train, verify, third_run] = ["train", "verify", "judge"].map(|role| files(&truth, folder, role));
    let [out, image, baseline, of_two, two] =
        ["json", "toml", "baseline.toml", "two.json", "two.toml"].map(|end| scratch.join(format!("{name}.{end}")));
    [&image, &baseline].into_iter().filter(|p| p.exists()).try_for_each(std::fs::remove_file)?;
    let (report, seconds) = traced(hrg, [&train, &verify], [&out, &image])?;
    let mut graded = Graded {
        name,
        group: truth["group"].as_str().unwrap_or("?").to_string(),
        grade: Grade::Refused,
        measured_spectrum: truth["case"].as_str().is_some_and(|case| case.starts_with(MEASURED)),
        named: String::new(),
        burn: false,
        worse: 0.0,
        compensable: truth["compensable"] == true && !texts(&truth["classes"]).contains("none"),
        left: vec![],
        left_after_two: vec![],
        left_by_the_truth: vec![],
        size: size(&truth),
        third: vec![],
        seconds,
        why: String::new(),
    };
    let report = match report {
        Ok(report) => report,
        Err(why) => return Ok(Graded { why, ..graded }),
    };
    let (grade, named, _) = grade(&truth, &report);
    graded.grade = grade;
    graded.named = named;
    graded.burn = report["burn"] == true;
    graded.worse = against_baseline(&truth, &report);
    graded.left = left_in_floors(&truth, &report);
    graded.left_by_the_truth = left_by_the_truth(&truth, &report);
    // (Where the baseline cannot be fitted, nothing is compared.)
    Command::new(hrg).arg("fit").args(&train).arg("--out").arg(&baseline).output()?;
    graded.third = third(hrg, &truth, folder, &image, &baseline)?;
    if graded.compensable && !third_run.is_empty() {
        let both = [&train[..], &third_run].concat();
        if let (Ok(report), _) = traced(hrg, [&both, &verify], [&of_two, &two])? {
            graded.left_after_two = left_in_floors(&truth, &report);
        }
    }
    Ok(graded)
}

/// Grades every written unit of a folder, on all processors.
///
/// # Errors
/// A folder without truth files, a program that cannot be run or that fails.
pub fn folder(hrg: &Path, folder: &Path) -> Result<Vec<Graded>> {
    let mut truths: Vec<PathBuf> = std::fs::read_dir(folder)
        .with_context(|| format!("cannot read the folder {}", folder.display()))?
        .filter_map(|e| e.ok().map(|e| e.path()))
        .filter(|p| p.to_string_lossy().ends_with("-truth.json"))
        .collect();
    truths.sort();
    if truths.is_empty() {
        bail!("{} holds no truth files; write units with `foreign-plant all --out {0}`", folder.display());
    }
    let scratch = folder.join("reports");
    std::fs::create_dir_all(&scratch)?;
    let next = AtomicUsize::new(0);
    let results = Mutex::new(Vec::new());
    let begun = Instant::now();
    let shown = std::io::stderr().is_terminal();
    let workers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| loop {
                let k = next.fetch_add(1, Ordering::Relaxed);
                let Some(truth) = truths.get(k) else { break };
                let graded = one(hrg, truth, &scratch);
                if let Ok(mut results) = results.lock() {
                    results.push((k, graded));
                    if shown {
                        let (done, all) = (results.len(), truths.len());
                        let left_s = begun.elapsed().as_secs_f64() * (all - done) as f64 / done as f64;
                        eprint!(
                            "\r{done} of {all} units, {:.0} min left   {}",
                            left_s / 60.0,
                            if done == all { "\n" } else { "" }
                        );
                    }
                }
            });
        }
    });
    let mut results = results.into_inner().unwrap_or_default();
    results.sort_by_key(|(k, _)| *k);
    results.into_iter().map(|(_, g)| g).collect()
}

/// Upper end of the 95 % interval of a share (Clopper and Pearson 1934), by bisection on the binomial sum.
fn upper(hits: usize, of: usize) -> f64 {
    // In logarithms: the first terms are smaller than a double can be.
    let tail = |p: f64| -> f64 {
        let mut term = of as f64 * (1.0 - p).ln();
        let mut sum = term.exp();
        for k in 1..=hits {
            term += ((of - k + 1) as f64 / k as f64 * p / (1.0 - p)).ln();
            sum += term.exp();
        }
        sum
    };
    if hits >= of {
        return 1.0;
    }
    let (mut low, mut high) = (hits as f64 / of.max(1) as f64, 1.0 - 1e-12);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if tail(middle) > 0.025 {
            low = middle;
        } else {
            high = middle;
        }
    }
    high
}

/// The table of a campaign, in Markdown. Where it has several seeds of several units each, the figures of each seed stand beside those of all.
#[must_use]
pub fn table(all: &[Graded]) -> String {
    let mut seeds: Vec<&str> = all.iter().map(|g| seed_of(&g.name)).collect();
    seeds.sort_by_key(|s| (s.len(), *s));
    seeds.dedup();
    if seeds.len() < 2 || 2 * seeds.len() > all.len() {
        seeds.clear();
    }
    let of_seed = |seed: &&str| -> Vec<(String, String)> {
        let own: Vec<Graded> = all.iter().filter(|g| seed_of(&g.name) == *seed).cloned().collect();
        figures(&own, false)
    };
    let each: Vec<_> = seeds.iter().map(of_seed).collect();
    let heads: String = seeds.iter().map(|s| format!(" seed {s} |")).collect();
    let mut s = format!("| figure | reached |{heads}\n|---|---|{}\n", "---|".repeat(seeds.len()));
    for (name, value) in figures(all, true) {
        let value_of = |of: &Vec<(String, String)>| of.iter().find(|f| f.0 == name).map_or("", |f| &f.1).to_string();
        let each: String = each.iter().map(|of| format!(" {} |", value_of(of))).collect();
        s += &format!("| {name} | {value} |{each}\n");
    }
    s
}

/// The seed in the name of a unit: what follows its last hyphen.
fn seed_of(name: &str) -> &str {
    name.rsplit_once('-').map_or(name, |n| n.1)
}

/// The figures of a campaign by name; shares with their `intervals`, or as a percentage alone.
fn figures(all: &[Graded], intervals: bool) -> Vec<(String, String)> {
    let judged: Vec<&Graded> = all.iter().filter(|g| g.grade != Grade::Refused).collect();
    let count = |grade: Grade| judged.iter().filter(|g| g.grade == grade).count();
    let n = judged.len();
    let share_of = |hits: usize, n: usize| {
        if !intervals {
            return format!("{:.1} %", 100.0 * hits as f64 / n.max(1) as f64);
        }
        format!(
            "{hits}/{n} ({:.1} %, 95 % interval {:.1} to {:.1} %)",
            100.0 * hits as f64 / n.max(1) as f64,
            100.0 * (1.0 - upper(n - hits, n.max(1))),
            100.0 * upper(hits, n.max(1))
        )
    };
    let share = |hits: usize| share_of(hits, n);
    let mut rows = Vec::new();
    let mut row = |name: &str, value: String| rows.push((name.to_string(), value));
    row("units judged, refused", format!("{n}, {}", all.len() - n));
    row("class right", share(count(Grade::Right)));
    row("class right, or honestly flagged", share(count(Grade::Right) + count(Grade::Flagged)));
    row("false class, not flagged", share(count(Grade::False)));
    row("missed above 1.5 floors, not flagged", share(count(Grade::Missed)));
    row("missed below 1.5 floors, not flagged", share(count(Grade::Small)));
    let compensable: Vec<&Graded> = judged.iter().copied().filter(|g| g.compensable).collect();
    match quantiles(&compensable, |g| &g.left) {
        None => row("units with something to compensate", "0".into()),
        Some(text) => row("floors left where compensable: median, 90th, 95th percentile, largest", text),
    }
    if let Some(text) = quantiles(&compensable, |g| &g.left_after_two) {
        row("the same, the third run learnt from as a second train run", text);
    }
    if let Some(text) = quantiles(&compensable, |g| &g.left_by_the_truth) {
        row("the same of the truth's own forms and parameters, fitted to the train runs alone by least squares", text);
    }
    row("image worse than the baseline", share(judged.iter().filter(|g| g.worse > WORSE).count()));
    row("image recommended", share(judged.iter().filter(|g| g.burn).count()));
    on_third(&judged, &share_of, &mut row);
    let mut seconds: Vec<f64> = judged.iter().map(|g| g.seconds).collect();
    seconds.sort_by(f64::total_cmp);
    if let (Some(median), Some(most)) = (seconds.get(seconds.len() / 2), seconds.last()) {
        row("seconds of a trace on one processor: median, most", format!("{median:.2}, {most:.2}"));
    }
    let measured: Vec<&&Graded> = judged.iter().filter(|g| g.measured_spectrum).collect();
    if !measured.is_empty() {
        let of = |hit: &dyn Fn(&Graded) -> bool| share_of(measured.iter().filter(|g| hit(g)).count(), measured.len());
        row("units with a measured spectrum: something named", of(&|g| !g.named.is_empty()));
        row("units with a measured spectrum: image recommended", of(&|g| g.burn));
    }
    rows
}

/// Median, 90th and 95th percentile and the largest of some figure of the axes; `None` where there is none.
fn quantiles(units: &[&Graded], of: impl Fn(&Graded) -> &Vec<f64>) -> Option<String> {
    let mut all: Vec<f64> = units.iter().flat_map(|g| of(g).iter().copied()).filter(|v| v.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    let at = |q: f64| all.get((q * all.len().saturating_sub(1) as f64) as usize).copied();
    Some(format!("{:.3}, {:.2}, {:.2}, {:.2}", at(0.5)?, at(0.9)?, at(0.95)?, at(1.0)?))
}

/// The rows of the third runs.
fn on_third(judged: &[&Graded], share: &dyn Fn(usize, usize) -> String, row: &mut impl FnMut(&str, String)) {
    let with: Vec<&&Graded> = judged.iter().filter(|g| !g.third.is_empty()).collect();
    if with.is_empty() {
        return;
    }
    let good: Vec<&&&Graded> = with.iter().filter(|g| g.compensable && g.size >= 2.0 && g.helps()).collect();
    if !good.is_empty() {
        row(
            "third run: recommended of the images that leave less (size 2 and up, compensable)",
            share(good.iter().filter(|g| g.burn).count(), good.len()),
        );
    }
    let burnt: Vec<&&&Graded> = with.iter().filter(|g| g.burn).collect();
    if !burnt.is_empty() {
        row(
            "third run: leave more on an axis than the baseline, of the recommended",
            share(burnt.iter().filter(|g| g.hurts()).count(), burnt.len()),
        );
    }
    let mut unseen: Vec<f64> = with.iter().flat_map(|g| &g.third).filter_map(|t| t.unseen).collect();
    unseen.sort_by(f64::total_cmp);
    if !unseen.is_empty() {
        let quantile = |q: f64| unseen[((unseen.len() - 1) as f64 * q).round() as usize];
        row(
            "third run, where the unit flags what the fit has not seen: squared error over stated variance, median, 90th percentile, axes",
            format!("{:.2}, {:.2}, {}", quantile(0.5), quantile(0.9), unseen.len()),
        );
    }
    let axes: Vec<&OnThird> = with.iter().flat_map(|g| &g.third).filter(|t| t.squared.is_some()).collect();
    for (name, from, to) in [("below 2", 0.0, 2.0), ("2 to 4", 2.0, 4.0), ("above 4", 4.0, f64::INFINITY)] {
        let mut each: Vec<f64> =
            axes.iter().filter(|t| (from..to).contains(&t.image_floors)).filter_map(|t| t.squared).collect();
        each.sort_by(f64::total_cmp);
        if let Some(median) = each.get(each.len() / 2) {
            let mean = each.iter().sum::<f64>() / each.len() as f64;
            let what = format!("third run: squared error over stated variance, {name} floors left: mean, median, axes");
            row(&what, format!("{mean:.2}, {median:.2}, {}", each.len()));
        }
    }
    let count: usize = axes.iter().map(|t| t.count).sum();
    let within = [0, 1].map(|k| axes.iter().map(|t| t.within[k] * t.count as f64).sum::<f64>() / count as f64);
    row(
        "third run: means within 1 and 1.96 standard uncertainties, constant included",
        format!("{:.1} %, {:.1} %", 100.0 * within[0], 100.0 * within[1]),
    );
}

/// One row a unit.
#[must_use]
pub fn units(all: &[Graded]) -> String {
    let mut s = String::from("| unit | grade | named | burn | floors left |\n|---|---|---|---|---|\n");
    for g in all {
        let left: Vec<String> = g.left.iter().map(|v| format!("{v:.2}")).collect();
        let named = match (&g.named[..], &g.why[..]) {
            ("", "") => "nothing",
            ("", why) => why,
            (named, _) => named,
        };
        s += &format!(
            "| {} | {} | {named} | {} | {} |\n",
            g.name,
            format!("{:?}", g.grade).to_lowercase(),
            match (g.burn, g.hurts()) {
                (false, _) => "",
                (true, false) => "yes",
                (true, true) => "yes; worse on the third run",
            },
            left.join(", ")
        );
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn truth() -> Value {
        json!({"case": "c", "seed": 1, "group": "g", "classes": ["memory"], "beside": ["rate"], "compensable": true,
            "effects": [{"classes": ["memory"], "beside": []}],
            "runs": [{"role": "verify", "file": "v.csv", "axes": {"x": {"floor_dph": 0.1, "raw_dph": 1.0}}}]})
    }

    fn report(classes: &[&str], kind: &str, left: f64) -> Value {
        let effects: Vec<Value> = classes.iter().map(|c| json!({"name": c, "class": c})).collect();
        json!({"effects": effects, "verdict_kind": kind, "unexplained": {"x": false},
            "baseline": {"x": {"verify_rms_dph": 0.5}}, "block": {"x": {"verify_rms_dph": left}}})
    }

    #[test]
    fn each_grade_is_given() {
        let of = |classes: &[&str], kind: &str, left: f64| grade(&truth(), &report(classes, kind, left)).0;
        assert_eq!(of(&["memory"], "confirmed", 0.1), Grade::Right);
        assert_eq!(of(&["memory", "rate"], "confirmed", 0.1), Grade::Right);
        assert_eq!(of(&["memory", "event"], "confirmed", 0.1), Grade::False);
        assert_eq!(of(&["event"], "not-confirmed", 0.1), Grade::Flagged);
        assert_eq!(of(&[], "nothing-lacks", 0.3), Grade::Missed);
        assert_eq!(of(&[], "nothing-lacks", 0.12), Grade::Small);
        assert!((left_in_floors(&truth(), &report(&[], "", 0.2))[0] - 2.0).abs() < 1e-12);
        assert!((against_baseline(&truth(), &report(&[], "", 0.6)) - 1.2).abs() < 1e-12);
    }

    #[test]
    fn units_with_a_measured_spectrum_are_counted_by_themselves() {
        let of = |measured_spectrum: bool, named: &str, burn: bool| Graded {
            name: "c".into(),
            group: "clean".into(),
            grade: Grade::Right,
            measured_spectrum,
            named: named.into(),
            burn,
            worse: 1.0,
            compensable: false,
            left: vec![1.0],
            left_after_two: vec![],
            left_by_the_truth: vec![],
            size: 0.0,
            third: vec![],
            seconds: 1.0,
            why: String::new(),
        };
        let all = [of(true, "step", false), of(true, "", false), of(false, "lag", true)];
        let t = table(&all);
        assert!(t.contains("| units with a measured spectrum: something named | 1/2 (50.0 %"), "{t}");
        assert!(t.contains("| units with a measured spectrum: image recommended | 0/2 (0.0 %"), "{t}");
        assert!(!table(&all[2..]).contains("measured spectrum"));
    }

    #[test]
    fn the_processor_time_of_a_program_is_read() {
        let begun = Instant::now();
        while begun.elapsed().as_secs_f64() < 0.2 {
            std::hint::spin_loop();
        }
        if let Some(seconds) = processor_time_s(std::process::id()) {
            assert!((0.02..1e5).contains(&seconds), "{seconds}");
        }
    }

    #[test]
    fn a_share_has_its_bound() {
        assert!((upper(0, 200) - 0.0183).abs() < 2e-4, "{}", upper(0, 200));
        assert!((upper(8, 200) - 0.0773).abs() < 5e-4, "{}", upper(8, 200));
    }

    #[test]
    fn intervals_are_those_of_the_tables() {
        // Clopper-Pearson, 95 %: 0 of 20, 3 of 20, 20 of 20, and shares of many.
        for (hits, of, high) in
            [(0, 20, 0.168_43), (3, 20, 0.378_93), (20, 20, 1.0), (247, 250, 0.997_52), (490, 500, 0.990_36)]
        {
            assert!((upper(hits, of) - high).abs() < 2e-5, "{hits}/{of}: {}", upper(hits, of));
        }
    }
}
