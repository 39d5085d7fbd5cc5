//! Hours that a family spares the next unit: units of one design by the second plant, a short run under the family against a long one without.

use crate::inputs::Unit;
use anyhow::{Context, Result};
use clap::Args;
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::side_by_side;
use hrg_data::numeric::stats::{block_means, mean, quantile, std_dev};
use hrg_data::recording::steps::{Steps, MEAN_S};
use hrg_data::recording::Recording;
use hrg_identify::family::Family;
use hrg_identify::fit;
use hrg_identify::fit::independence::Units;
use hrg_identify::trace;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Arguments of `hrg-study family`.
#[derive(Args)]
pub struct Arguments {
    /// Families (hrg family), each with a folder of new units of its design and, behind a colon, one of units of another design:
    /// FAMILY:NEW:FOREIGN. The units are of the second plant and have a further, short run.
    #[arg(required = true)]
    cases: Vec<String>,
    /// Print each unit, too.
    #[arg(long)]
    list: bool,
    /// Write the tables into this page, between its marks.
    #[arg(long)]
    pub page: Option<PathBuf>,
}

/// Means at the begin of the judging run that are left out: the unit settles.
const SETTLING: usize = 10;
/// Status bits that say no more than that a unit settles.
const SETTLES: u16 = 1 << 7;

/// Error of the bias of an image on the run that judges, by axis.
#[derive(Debug, Clone, Copy, Default)]
struct OnJudge {
    /// Standard deviation of the error, noise left out, deg/h; NaN for an axis that is not there.
    error_dph: [f64; AXES],
    /// Squared error over stated variance, mean of the means of 100 s, constant included, where nothing is flagged.
    squared: [f64; AXES],
    /// The figure that a user measures: standard deviation of the corrected rates' means, noise included.
    left_dph: [f64; AXES],
}

impl OnJudge {
    fn new(image: &Calibration, steps: &Steps, truth: &[Vec<f64>; AXES]) -> Self {
        let seconds = fit::correct::correct(image, steps);
        let left = fit::correct(image, steps);
        let mut out = Self::default();
        for a in 0..AXES {
            let bias: Vec<f64> = seconds.iter().map(|s| f64::from(s.bias_dph[a])).collect();
            let stated = seconds.iter().map(|s| (s.status[a] & !SETTLES == 0, f64::from(s.bias_std_dph[a]).powi(2)));
            let variance: Vec<f64> = stated.map(|(clean, v)| if clean { v } else { f64::NAN }).collect();
            let means = |x: &[f64]| block_means(x, MEAN_S);
            let both = means(&bias).into_iter().zip(means(&variance)).zip(&truth[a]).skip(SETTLING);
            let each: Vec<(f64, f64)> = both.map(|((b, v), t)| (b - t, v)).filter(|e| e.0.is_finite()).collect();
            out.error_dph[a] = std_dev(&each.iter().map(|e| e.0).collect::<Vec<_>>());
            let over: Vec<f64> = each.iter().map(|(e, v)| e * e / v).filter(|z| z.is_finite()).collect();
            out.squared[a] = mean(&over);
            out.left_dph[a] = std_dev(&means(&left[a]).into_iter().skip(SETTLING).collect::<Vec<_>>());
        }
        out
    }
}

fn rms(each: [f64; AXES]) -> f64 {
    mean(&each.map(|e| e * e)).sqrt()
}

/// Images of a new unit, judged.
struct Row {
    name: String,
    /// The long run without the family, the short one without, the short one with.
    images: [OnJudge; 3],
    /// `true` if it was taken for one of the family.
    belongs: bool,
    hours: [f64; 2],
}

impl Row {
    fn ratio(&self) -> f64 {
        rms(self.images[2].error_dph) / rms(self.images[0].error_dph)
    }
}

fn one(family: &Family, file: &Path) -> Result<Row> {
    let unit = Unit::read(file)?;
    let (train, verify, short) = (unit.runs("train")?, unit.runs("verify")?, unit.runs("more")?);
    let (judge, _) = unit.judge()?;
    let (steps, truth) = (Steps::new(&judge)?, AXIS_NAMES.map(|name| unit.bias(name)));
    let traced = |train: &[Recording]| trace::trace(train, &verify[0]).map(|t| t.image);
    let (long, alone) = (traced(&train)?, traced(&short)?);
    let prepared = family.prepare(&short, Units::Same)?;
    let member = family.member(&prepared, [None; AXES])?;
    // (As hrg trace --prior does with a unit that does not belong.)
    let offered = || {
        let options = trace::Options { family: Some(family.clone()), ..trace::Options::default() };
        trace::trace_with(&short, &verify[0], &options).map(|t| t.image)
    };
    let with = if member.belongs() { family.image(&member, &prepared, &mut Vec::new()) } else { offered()? };
    let hours = |r: &[Recording]| r.iter().map(|r| r.time_s.len() as f64 / 3600.0).sum();
    Ok(Row {
        name: format!("{}-{}: {}", unit.name().0, unit.name().1, member.sentence(family)),
        images: [&long, &alone, &with].map(|i| OnJudge::new(i, &steps, &truth)),
        belongs: member.belongs(),
        hours: [hours(&train), hours(&short)],
    })
}

fn rows(family: &Family, folder: &Path) -> Result<Vec<Row>> {
    let read = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut all: Vec<PathBuf> = read.filter_map(|f| Some(f.ok()?.path())).collect();
    all.retain(|p| p.to_string_lossy().ends_with("-truth.json"));
    all.sort();
    anyhow::ensure!(!all.is_empty(), "{}: no truth of a unit", folder.display());
    side_by_side::each(all, |p| one(family, &p)).into_iter().collect()
}

/// Runs the command.
///
/// # Errors
/// Files that cannot be read, or units that cannot be used.
pub fn run(arguments: &Arguments) -> Result<String> {
    let mut s = String::new();
    let _ = writeln!(s, "| family | new units | runs [h] | long, alone | short, alone | short, family | short with over long alone | with noise | squared error over stated variance, x y z | taken for its own |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|");
    let mut foreign = String::from("\n| family | units of another design | taken for its own | short, alone | short, offered the family | worst of them over alone |\n|---|---:|---:|---:|---:|---:|\n");
    for case in &arguments.cases {
        let parts: Vec<&str> = case.split(':').collect();
        let [file, new, other] = parts[..] else {
            return Err(BadInput(format!("\"{case}\": give FAMILY:NEW:FOREIGN")).into());
        };
        let family = Family::from_json(&std::fs::read_to_string(file).with_context(|| file.to_string())?)?;
        let (own, others) = (rows(&family, Path::new(new))?, rows(&family, Path::new(other))?);
        if arguments.list {
            for r in own.iter().chain(&others) {
                println!("{}: {:.2}, errors {:.3?}", r.name, r.ratio(), r.images.map(|i| i.error_dph));
            }
        }
        let over = |rows: &[Row], f: &dyn Fn(&Row) -> f64, p: f64| quantile(&rows.iter().map(f).collect::<Vec<_>>(), p);
        let error = |k: usize| move |r: &Row| rms(r.images[k].error_dph);
        let squared = [0, 1, 2].map(|a: usize| {
            let each = own.iter().map(|r| r.images[2].squared[a]).filter(|v| v.is_finite());
            format!("{:.2}", mean(&each.collect::<Vec<_>>()))
        });
        let noisy = |r: &Row| rms(r.images[2].left_dph) / rms(r.images[0].left_dph);
        let _ = writeln!(
            s,
            "| {}, {} units | {} | {:.1}, {:.1} | {:.3} | {:.3} | {:.3} | {:.2} ({:.2}) | {:.3} ({:.3}) | {} | {} |",
            family.name,
            family.sources.len(),
            own.len(),
            over(&own, &|r| r.hours[0], 0.5),
            over(&own, &|r| r.hours[1], 0.5),
            over(&own, &error(0), 0.5),
            over(&own, &error(1), 0.5),
            over(&own, &error(2), 0.5),
            over(&own, &Row::ratio, 0.5),
            over(&own, &Row::ratio, 0.9),
            over(&own, &noisy, 0.5),
            over(&own, &noisy, 0.9),
            squared.join(" "),
            own.iter().filter(|r| r.belongs).count(),
        );
        let worst = |r: &Row| rms(r.images[2].error_dph) / rms(r.images[1].error_dph);
        let _ = writeln!(
            foreign,
            "| {} | {} | {} | {:.3} | {:.3} | {:.2} |",
            family.name,
            others.len(),
            others.iter().filter(|r| r.belongs).count(),
            over(&others, &error(1), 0.5),
            over(&others, &error(2), 0.5),
            over(&others, &worst, 1.0),
        );
    }
    Ok(s + &foreign)
}
