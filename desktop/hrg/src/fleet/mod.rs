//! Many units at once: a row of figures for each, a table of all, and a page that shows distributions, outliers and batches.
//!
//! A unit is looked at by itself ([`row`]), so the work parts on cores here ([`run`]) and on machines in Python's `hrg.fleet`, which calls the same function:
//! the same rows, to the last digit. A row is kept as soon as it is there ([`Kept`]); a run that was stopped goes on with the others. A file that cannot be
//! read, or a unit that cannot be used, is a row with a reason.

mod page;
mod table;

use page::html;
pub use page::{outliers, Outlier};
use table::parquet;

use crate::judge::{judge, Limit};
use crate::report;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::load::read_with;
use hrg_data::numeric::side_by_side;
use hrg_data::numeric::stats::{block_means, mean, std_dev};
use hrg_data::recording::facts::Facts;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::{names, parquet as packed, Recording};
use hrg_identify::family::Family;
use hrg_identify::fit;
use hrg_identify::fit::independence::Units;
use hrg_identify::trace;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read as _;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::{Path, PathBuf};

/// Version of rows: one that was kept by another is made anew.
const VERSION: u32 = 2;

/// The files of one unit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct UnitFiles {
    /// Name of the unit.
    pub unit: String,
    /// Folder of its first recording, from the folder of the fleet on.
    pub batch: String,
    /// Its recordings, in the order of their names.
    pub runs: Vec<PathBuf>,
    /// The calibration that it has in use, if one of its name lies there; of several the last by name.
    pub calibration: Option<PathBuf>,
}

/// Wishes for a fleet.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Wanted {
    /// File of a family to which the units should belong.
    pub family: Option<PathBuf>,
    /// Largest error that passes, deg/h, and the range of temperatures, C.
    pub limit: Option<[f64; 3]>,
}

impl Wanted {
    /// The limit by which units are judged, if there is one.
    #[must_use]
    pub fn judged_by(&self) -> Option<Limit> {
        self.limit.map(|[limit_dph, from_c, to_c]| Limit { limit_dph, from_c, to_c, means_s: fit::MEAN_S })
    }
}

/// One unit.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the unit.
    pub unit: String,
    /// Its batch.
    pub batch: String,
    /// Number of its recordings.
    pub runs: usize,
    /// Reasons why something could not be used; empty where all could.
    pub error: String,
    /// Verdict of the trace; empty where it has one run only.
    pub verdict: String,
    /// Image that the trace has written: extended, baseline, none.
    pub image: String,
    /// The trace recommends it.
    pub burn: bool,
    /// Effects that were named, with their parameters.
    pub effects: String,
    /// PASS, FAIL or NOT COVERED by the image on the last run; empty where no limit was given.
    pub passes: String,
    /// Figures by name, as text of the shortest decimal that reads back as the same number.
    pub figures: BTreeMap<String, String>,
    /// Units of figures, by their names without the letter of an axis; where there is none, the name says it.
    pub units: BTreeMap<String, String>,
}

impl Row {
    fn put(&mut self, name: &str, value: f64) {
        if value.is_finite() {
            self.figures.insert(name.to_string(), format!("{value}"));
        }
    }

    /// A figure.
    #[must_use]
    pub fn figure(&self, name: &str) -> Option<f64> {
        self.figures.get(name)?.parse().ok()
    }
}

/// Endings of recordings.
const RECORDINGS: [&str; 3] = [".csv", ".csv.gz", ".parquet"];
/// The head of a recording has its unit's name within so many bytes.
const HEAD: u64 = 1 << 16;

/// The units of a folder and of the folders in it, by their names. Files whose names begin with a dot, and what a link leads to a second time, are no
/// recordings. Paths are absolute.
///
/// # Errors
/// A folder that cannot be read, or holds no recording; `out` in it; a family or a limit that cannot be used.
pub fn units(folder: &Path, out: &Path, wanted: &Wanted) -> anyhow::Result<Vec<UnitFiles>> {
    wanted.judged_by().map_or(Ok(()), |l| l.check())?;
    // (A family that is none is no reason of a unit.)
    wanted.family.as_deref().map(read_family).transpose()?;
    let unreadable = |at: &Path, e: std::io::Error| BadInput(format!("cannot read {}: {e}", at.display()));
    let folder = &folder.canonicalize().map_err(|e| unreadable(folder, e))?;
    let there =
        out.ancestors().find_map(|at| if at.as_os_str().is_empty() { Path::new(".") } else { at }.canonicalize().ok());
    if there.is_some_and(|at| at.starts_with(folder)) {
        return Err(
            BadInput(format!("--out {} lies in the folder that is read; give another place", out.display())).into()
        );
    }
    let (mut files, mut open, mut seen) = (Vec::new(), vec![folder.clone()], BTreeSet::from([folder.clone()]));
    while let Some(at) = open.pop() {
        let entries = std::fs::read_dir(&at).map_err(|e| unreadable(&at, e))?;
        // (Files before links to them.)
        let mut paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
        paths.sort_by_key(|p| (p.is_symlink(), p.clone()));
        let hidden = |p: &PathBuf| p.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        for path in paths.into_iter().filter(|p| !hidden(p)) {
            let real = path.canonicalize().unwrap_or_else(|_| path.clone());
            if folder.starts_with(&real) || !seen.insert(real) {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                files.push(path);
            }
        }
    }
    files.sort();
    let ends = |p: &Path, with: &str| p.to_string_lossy().ends_with(with);
    let mut units: BTreeMap<String, UnitFiles> = BTreeMap::new();
    for path in files.iter().filter(|p| RECORDINGS.iter().any(|e| ends(p, e))) {
        let name = name_of(path).unwrap_or_else(|| path.file_name().unwrap_or_default().to_string_lossy().to_string());
        let beneath = path.parent().and_then(|p| p.strip_prefix(folder).ok());
        let batch = beneath.map(|p| p.display().to_string()).unwrap_or_default();
        let unit =
            units.entry(name.clone()).or_insert(UnitFiles { unit: name, batch, runs: vec![], calibration: None });
        unit.runs.push(path.clone());
    }
    for path in files.iter().filter(|p| ends(p, ".toml")) {
        let Ok(calibration) = image_file::load(path) else { continue };
        if let Some(unit) = units.get_mut(calibration.unit_name()) {
            unit.calibration = Some(path.clone());
        }
    }
    if units.is_empty() {
        return Err(BadInput(format!("{}: no recording there (.csv, .csv.gz, .parquet)", folder.display())).into());
    }
    Ok(units.into_values().collect())
}

/// The name of the unit in the head of a recording.
fn name_of(path: &Path) -> Option<String> {
    if packed::begins_as_parquet(path) || path.to_string_lossy().ends_with(".gz") {
        return Recording::parse(&packed::read_text(path).ok()?)
            .ok()
            .map(|r| r.unit().to_string())
            .filter(|n| n != names::NONE);
    }
    let mut head = Vec::new();
    std::fs::File::open(path).ok()?.take(HEAD).read_to_end(&mut head).ok()?;
    let text = String::from_utf8_lossy(&head);
    let line = text.lines().take_while(|l| l.starts_with('#')).find_map(|l| l[1..].trim().strip_prefix("unit:"))?;
    Some(line.trim().to_string()).filter(|n| !n.is_empty())
}

/// The row of a unit.
#[must_use]
pub fn row(files: &UnitFiles, wanted: &Wanted) -> Row {
    let mut out =
        Row { unit: files.unit.clone(), batch: files.batch.clone(), runs: files.runs.len(), ..Row::default() };
    let filled = catch_unwind(AssertUnwindSafe(|| {
        let mut filled = out.clone();
        let done = fill(&mut filled, files, wanted);
        if let Err(e) = done {
            filled.error = join(&filled.error, &format!("{e:#}"));
        }
        filled
    }));
    match filled {
        Ok(filled) => filled,
        Err(_) => {
            out.error = "hrg itself failed on it, which is a defect: please report it with the files".into();
            out
        }
    }
}

fn join(a: &str, b: &str) -> String {
    if a.is_empty() {
        b.to_string()
    } else {
        format!("{a}; {b}")
    }
}

fn fill(out: &mut Row, files: &UnitFiles, wanted: &Wanted) -> anyhow::Result<()> {
    let mut runs = Vec::new();
    for path in &files.runs {
        match read_with(path, &Facts::default()) {
            Ok(r) => runs.push(r),
            Err(e) => out.error = join(&out.error, &format!("{e:#}")),
        }
    }
    anyhow::ensure!(!runs.is_empty(), "no recording that can be used");
    let folders: BTreeSet<&Path> = files.runs.iter().filter_map(|p| p.parent()).collect();
    if folders.len() > 1 {
        let each: Vec<String> = folders.iter().map(|f| f.display().to_string()).collect();
        let each = each.join(", ");
        out.error = join(
            &out.error,
            &format!("its recordings lie in {each}: if these are two units, give each a name of its own"),
        );
    }
    out.put("hours", runs.iter().map(|r| r.time_s.len() as f64 * r.step_s()).sum::<f64>() / 3600.0);
    let figures = report::report(&runs)?;
    for axis in &figures.axes {
        for q in &axis.quantities {
            let name = snake(q.name);
            out.put(&format!("{name}_{}", axis.axis), q.value.unwrap_or(f64::NAN));
            out.units.insert(name, q.unit.to_string());
        }
    }
    let family = wanted.family.as_deref().map(read_family).transpose()?;
    if let Some(family) = &family {
        let member = family.member(&family.prepare(&runs, Units::Same)?, [None; AXES])?;
        for (a, e) in member.evidence.iter().enumerate() {
            out.put(&format!("family_log_odds_{}", AXIS_NAMES[a]), e.map_or(f64::NAN, |e| e.family - e.own));
        }
    }
    let in_use = files.calibration.as_deref().map(image_file::load).transpose()?;
    let last = runs.last().map(Steps::new).transpose()?;
    if let (Some(c), Some(steps)) = (&in_use, &last) {
        aged(out, c, steps);
    }
    let image = if runs.len() > 1 {
        let (verify, train) = runs.split_last().unwrap_or((&runs[0], &[]));
        Some(traced(out, train, verify)?)
    } else {
        in_use
    };
    if let (Some(limit), Some(image), Some(verify)) = (wanted.judged_by(), &image, runs.last()) {
        let judged = judge(std::slice::from_ref(verify), image, &limit)?;
        out.passes = judged.verdict.word().to_string();
        for (name, axis) in &judged.axes {
            out.put(&format!("largest_error_dph_{name}"), axis.largest_dph.unwrap_or(f64::NAN));
        }
    }
    Ok(())
}

/// A family from its file.
///
/// # Errors
/// A file that is none.
pub fn read_family(path: &Path) -> Result<Family, BadInput> {
    let text = std::fs::read_to_string(path).map_err(|e| BadInput(format!("cannot read {}: {e}", path.display())))?;
    Family::from_json(&text).map_err(|e| BadInput(format!("{}: {e}", path.display())))
}

/// The trace of a unit, its last run kept back.
fn traced(out: &mut Row, train: &[Recording], verify: &Recording) -> anyhow::Result<Calibration> {
    let traced = trace::trace(train, verify)?;
    let r = &traced.report;
    let json = |v: serde_json::Value| v.as_str().unwrap_or_default().to_string();
    out.verdict = json(serde_json::to_value(r.verdict_kind)?);
    out.image = json(serde_json::to_value(r.image)?);
    out.burn = r.burn;
    let effect = |e: &trace::Found| {
        let p: Vec<String> = e.parameters.iter().map(|(n, v)| format!("{n}={v:.4}")).collect();
        if p.is_empty() {
            e.name.clone()
        } else {
            format!("{}:{}", e.name, p.join(","))
        }
    };
    out.effects = r.effects.iter().map(effect).collect::<Vec<_>>().join(" + ");
    for a in verify.present() {
        let name = AXIS_NAMES[a];
        out.put(&format!("noise_floor_dph_{name}"), r.noise_floor_dph[name]);
        out.put(&format!("baseline_dph_{name}"), r.baseline[name].verify_rms_dph);
        let left = r.block.as_ref().map(|b| b[name]);
        out.put(&format!("image_dph_{name}"), left.map_or(f64::NAN, |b| b.verify_rms_dph));
        out.put(&format!("image_constant_dph_{name}"), left.map_or(f64::NAN, |b| b.mean_dph));
    }
    Ok(traced.image)
}

/// The error that the calibration in use leaves of the last run, over what it states: a unit whose calibration has aged leaves more.
fn aged(out: &mut Row, c: &Calibration, steps: &Steps) {
    let seconds = fit::correct::correct(c, steps);
    for a in steps.present() {
        let left = |f: &dyn Fn(&fit::correct::Second) -> f32| -> Vec<f64> {
            block_means(&seconds.iter().map(|s| f64::from(f(s))).collect::<Vec<_>>(), fit::MEAN_S)
        };
        let (rates, stated) = (left(&|s| s.corrected_dph[a]), left(&|s| s.bias_std_dph[a].powi(2)));
        let good: Vec<f64> = rates.iter().copied().filter(|v| v.is_finite()).collect();
        let square = mean(&good.iter().map(|v| v * v).collect::<Vec<_>>());
        let variance: Vec<f64> = stated.into_iter().filter(|v| v.is_finite()).collect();
        // (The noise of a mean, by what neighbours differ by.)
        let steps: Vec<f64> = good.windows(2).map(|w| (w[1] - w[0]) / 2f64.sqrt()).collect();
        let expected = mean(&variance) + std_dev(&steps).powi(2);
        out.put(&format!("in_use_dph_{}", AXIS_NAMES[a]), square.sqrt());
        out.put(&format!("in_use_over_stated_{}", AXIS_NAMES[a]), (square / expected).sqrt());
    }
}

/// A name of a figure as that of a column.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_alphanumeric() {
            out.push(c.to_ascii_lowercase());
        } else if !out.ends_with('_') {
            out.push('_');
        }
    }
    out.trim_end_matches('_').to_string()
}

/// Rows that are there already.
#[derive(Debug, Clone)]
pub struct Kept {
    folder: PathBuf,
}

#[derive(Serialize, Deserialize)]
struct KeptRow {
    key: String,
    row: Row,
}

impl Kept {
    /// In a folder for what comes of a fleet.
    ///
    /// # Errors
    /// A folder that cannot be made.
    pub fn new(out: &Path) -> Result<Self, BadInput> {
        let folder = out.join("rows");
        std::fs::create_dir_all(&folder).map_err(|e| BadInput(format!("cannot make {}: {e}", folder.display())))?;
        Ok(Self { folder })
    }

    fn file(&self, files: &UnitFiles) -> PathBuf {
        let crc = crc::Crc::<u64>::new(&crc::CRC_64_XZ);
        self.folder.join(format!("{:016x}.json", crc.checksum(files.unit.as_bytes())))
    }

    /// The row of a unit whose files, wishes and program are as they were.
    #[must_use]
    pub fn get(&self, files: &UnitFiles, wanted: &Wanted) -> Option<Row> {
        let kept: KeptRow = serde_json::from_slice(&std::fs::read(self.file(files)).ok()?).ok()?;
        (kept.key == key(files, wanted)).then_some(kept.row)
    }

    /// Keeps a row.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn keep(&self, files: &UnitFiles, wanted: &Wanted, row: &Row) -> anyhow::Result<()> {
        let text = serde_json::to_string(&KeptRow { key: key(files, wanted), row: row.clone() })?;
        hrg_data::output::write_file(&self.file(files), text.as_bytes())
    }
}

/// Everything that a row depends on: program, wishes, and the sizes and times of its files.
fn key(files: &UnitFiles, wanted: &Wanted) -> String {
    let of = |p: &PathBuf| {
        let about = std::fs::metadata(p).ok();
        let at =
            about.as_ref().and_then(|m| m.modified().ok()).and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        (p.display().to_string(), about.map(|m| m.len()), at.map(|t| t.as_nanos()))
    };
    let all: Vec<_> = files.runs.iter().chain(&files.calibration).chain(&wanted.family).map(of).collect();
    format!("{VERSION} {} {wanted:?} {all:?}", env!("CARGO_PKG_VERSION"))
}

/// Writes table (`fleet.parquet`) and page (`fleet.html`) of some rows into a folder.
///
/// # Errors
/// Files that cannot be written.
pub fn write(out: &Path, title: &str, rows: &[Row]) -> anyhow::Result<()> {
    hrg_data::output::write_file(&out.join("fleet.parquet"), &parquet(rows)?)?;
    hrg_data::output::write_file(&out.join("fleet.html"), html(title, rows)?.as_bytes())
}

/// The rows of all units, on all cores, in the order of the units. `each` is told of each row as it comes: `true` where it was kept.
///
/// # Errors
/// A row that cannot be kept.
pub fn run(
    units: &[UnitFiles],
    wanted: &Wanted,
    kept: &Kept,
    each: impl Fn(&Row, bool) + Sync,
) -> anyhow::Result<Vec<Row>> {
    let one = |files: &UnitFiles| -> anyhow::Result<Row> {
        if let Some(row) = kept.get(files, wanted) {
            each(&row, true);
            return Ok(row);
        }
        let row = row(files, wanted);
        kept.keep(files, wanted, &row)?;
        each(&row, false);
        Ok(row)
    };
    side_by_side::each(units.iter().collect(), one).into_iter().collect()
}
