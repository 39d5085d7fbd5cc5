//! `hrg fit --rates`: scale factor and misalignment over temperature; `hrg profile --rates`: the scheme that tells them.

use crate::now;
use anyhow::Result;
use hrg_core::bias::Scaling;
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{RateAxis, OTHERS};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::image_file;
use hrg_data::load::load_recording;
use hrg_data::recording::turns::SETTLE_S;
use hrg_data::recording::Recording;
use hrg_identify::fit::independence::{same_unit, Units};
use hrg_identify::rates;
use hrg_identify::rates::{bins, quality, separable, AxisFit, Bin, Found};
use hrg_simulate::turning::Scheme;
use std::path::{Path, PathBuf};

/// Fits, writes the image and prints what was found; with `verify` also before and after on runs that the fit did not see.
pub fn fit(runs: &[PathBuf], calibration: &Path, verify: &[PathBuf], out: &Path) -> Result<()> {
    let (recordings, unseen) = of_one_unit(runs, verify)?;
    let given = image_file::load(calibration)?;
    let mut found = rates::identify(&recordings, &given)?;
    save(&mut found.calibration, &given, out)?;
    say_found(&found);
    found.notes.iter().for_each(|n| println!("note: {n}"));
    say_unseen(&unseen, [&given, &found.calibration], &|c| Ok(bins(&rates::all_dwells(&unseen, c)?)), &line)?;
    println!("{}: scale factors and misalignments, image {:08x}", out.display(), found.calibration.checksum());
    Ok(())
}

/// Writes an image to which something was added, as the next of its unit.
pub(crate) fn save(image: &mut Calibration, given: &Calibration, out: &Path) -> Result<()> {
    image.created_unix_s = now();
    image.sequence = given.sequence.saturating_add(1);
    image_file::save(out, image)
}

/// Prints what the images leave of each axis of runs that the fit did not see, if there are any. `line`: of the residuals of an axis.
pub(crate) fn say_unseen(
    unseen: &[Recording],
    [before, after]: [&Calibration; 2],
    bins: &dyn Fn(&Calibration) -> Result<Vec<Bin>>,
    line: &dyn Fn(&[&Bin]) -> String,
) -> Result<()> {
    if unseen.is_empty() {
        return Ok(());
    }
    let runs = if unseen.len() == 1 { "a run".into() } else { format!("{} runs", unseen.len()) };
    println!("\nbefore and after, on {runs} that the fit did not see:");
    for (name, c) in [("before", before), ("after", after)] {
        let all = bins(c)?;
        for (a, axis) in AXIS_NAMES.iter().enumerate() {
            let own: Vec<&Bin> = all.iter().filter(|b| b.axis == a).collect();
            let left = if own.is_empty() {
                "too few rounds to judge by: three within 10 C at least".into()
            } else {
                line(&own)
            };
            println!("  {name:<6} {axis}: {left}");
        }
    }
    Ok(())
}

/// Largest of the residuals of an axis.
pub(crate) fn largest(own: &[&Bin], values: &dyn Fn(&Bin) -> f64) -> f64 {
    own.iter().map(|b| values(b).abs()).fold(0.0, f64::max)
}

/// The runs of a fit, and those that it does not see, of one unit.
pub(crate) fn of_one_unit(runs: &[PathBuf], verify: &[PathBuf]) -> Result<(Vec<Recording>, Vec<Recording>)> {
    let load = |paths: &[PathBuf]| paths.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>();
    let (seen, unseen) = (load(runs)?, load(verify)?);
    let all: Vec<&Recording> = seen.iter().chain(&unseen).collect();
    if let Some(note) = same_unit(&all, Units::Same)? {
        println!("note: {note}");
    }
    Ok((seen, unseen))
}

/// A value with its standard deviation.
fn with_std((value, std): (f64, f64)) -> String {
    format!("{value:+.2} \u{b1} {std:.2}")
}

fn say_found(found: &Found) {
    let scaling = &found.calibration.scaling;
    println!(
        "{:<5} {:>7} {:>16} {:>18} {:>18}",
        "axis", "visits", "noise [deg/h]", "asymmetry [ppm]", "nonlinearity [ppm]"
    );
    for (a, fit) in found.axes.iter().enumerate() {
        let q = quality(&found.dwells, a);
        let known = |v: Option<(f64, f64)>| v.map_or_else(|| "not told".to_string(), with_std);
        println!(
            "{:<5} {:>7} {:>16.3} {:>18} {:>18}",
            AXIS_NAMES[a],
            fit.scale.values,
            fit.noise(),
            known(q.asymmetry_ppm),
            known(q.nonlinearity_ppm)
        );
    }
    println!("noise of a mean of 100 s; asymmetry and nonlinearity are reported, and not compensated");
    println!();
    say_corrections(scaling, &found.axes, &|a| found.calibration.rates.as_ref().map(|r| &r[a]), None);
}

/// Bias of an axis at a temperature, with its standard deviation.
type BiasAt<'a> = &'a dyn Fn(usize, f64) -> (f64, f64);

/// Prints corrections over temperature, over the ranges that the image states; with those of a bias in the unit of its heading.
pub(crate) fn say_corrections<'a>(
    scaling: &Scaling,
    axes: &[AxisFit],
    stated: &dyn Fn(usize) -> Option<&'a RateAxis>,
    bias: Option<(&str, BiasAt<'_>)>,
) {
    println!(
        "correction over temperature on a soak, with standard deviations (noise, and what the curve does not follow)"
    );
    let column = |text: Option<&str>| text.map_or_else(String::new, |text| format!("{text:>20} "));
    let heading = column(bias.map(|b| b.0));
    println!(
        "{:<5} {:>6} {heading}{:>20} {:>24} {:>24}",
        "axis", "T [C]", "scale factor [ppm]", "misalignment [urad]", ""
    );
    for (a, fit) in axes.iter().enumerate() {
        let Some(axis) = stated(a) else { continue };
        let (from, to) = (f64::from(axis.rate_valid_from_c), f64::from(axis.rate_valid_to_c));
        for k in 0..=4 {
            let t = from + 0.25 * f64::from(k) * (to - from);
            let cross = [0, 1].map(|j: usize| {
                let other = AXIS_NAMES[OTHERS[a][j]];
                format!("{}{other} {}", AXIS_NAMES[a], with_std(fit.misalignment_at(scaling, j, t)))
            });
            let bias = column(bias.map(|b| with_std(b.1(a, t))).as_deref());
            println!(
                "{:<5} {t:>6.1} {bias}{:>20} {:>24} {:>24}",
                AXIS_NAMES[a],
                with_std(fit.scale_at(scaling, t, 0.0)),
                cross[0],
                cross[1]
            );
        }
    }
}

/// Residuals of an axis: the mean of its scale factor over temperature, and the largest.
fn line(own: &[&Bin]) -> String {
    let mean = own.iter().map(|b| b.scale_ppm).sum::<f64>() / own.len() as f64;
    format!(
        "scale factor {mean:+8.2} ppm, at most {:6.2} from that over {} temperatures; misalignments at most {:6.2} and {:6.2} urad",
        largest(own, &|b| b.scale_ppm - mean),
        own.len(),
        largest(own, &|b| b.cross_urad[0]),
        largest(own, &|b| b.cross_urad[1])
    )
}

/// `hrg profile --rates`: the scheme in words, or what recordings told.
pub fn profile(check: &[PathBuf]) -> Result<()> {
    if check.is_empty() {
        let scheme = Scheme::default();
        let steps: Vec<String> = scheme
            .steps
            .iter()
            .map(|s| {
                s.map_or("rest".into(), |(a, sign)| format!("{}{}", if sign > 0.0 { '+' } else { '-' }, AXIS_NAMES[a]))
            })
            .collect();
        let rates: Vec<String> = scheme.rates_deg_per_s.iter().map(|r| format!("{r} deg/s")).collect();
        println!("Eight steps, gone round again and again: {}.", steps.join(", "));
        println!(
            "Each {} s: {SETTLE_S} s to settle, then whole revolutions. The axis that turns points up. Rates by rounds: {}.",
            scheme.dwell_s,
            rates.join(", ")
        );
        println!("Chamber: soaks of 2.5 h from -40 to 60 C and a slow ramp back, for instance {TRAIN}.");
        println!("Two sizes of rate part asymmetry from bias and nonlinearity from scale factor; soaks part temperature from ramp.");
        println!(
            "hrg simulate --rates 18,9 simulates it; hrg profile --rates --check RUN says what a run tells apart."
        );
        return Ok(());
    }
    let recordings = check.iter().map(|p| load_recording(p)).collect::<Result<Vec<_>>>()?;
    let dwells = rates::all_dwells(&recordings, &Calibration::uncalibrated())?;
    println!("{:<32} {:>28}", "term", "left by the others");
    for a in 0..AXES {
        for (term, left) in separable(&dwells, a).into_iter().enumerate() {
            let left = left.map_or_else(|| "not told apart".to_string(), |l| format!("{:.1} %", 100.0 * l));
            println!("{:<32} {left:>28}", rates::term_name(a, term));
        }
        let q = quality(&dwells, a);
        let seen = |v: Option<(f64, f64)>| v.map_or("not told apart", |_| "told by two sizes of rate");
        println!("{:<32} {:>28}", format!("asymmetry of {}", AXIS_NAMES[a]), seen(q.asymmetry_ppm));
        println!("{:<32} {:>28}", format!("nonlinearity of {}", AXIS_NAMES[a]), seen(q.nonlinearity_ppm));
    }
    Ok(())
}

/// Chamber profile that goes with the scheme.
const TRAIN: &str = hrg_identify::rates::CHAMBER;
