//! `hrg fit`: coefficients of a bias model.

use crate::facts::FactsArguments;
use crate::wait::with_a_bar;
use crate::{now, units};
use anyhow::Result;
use clap::Args;
use hrg_core::calibration::Calibration;
use hrg_core::temperature::TemperatureCurve;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_identify::family::Family;
use hrg_identify::fit;
use hrg_identify::fit::enough_data;
use hrg_papers::history::csv;
use hrg_papers::method::Method;
use hrg_papers::methods;
use hrg_papers::methods::Identified;
use std::path::{Path, PathBuf};

/// Arguments of `hrg fit`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings of one unit.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Scale factors and misalignments over temperature from runs on a rate table (table_rate_?_dph), added to --calibration.
    ///
    /// Example: hrg fit --rates table.csv --calibration cal.toml --verify unseen.csv --out cal2.toml
    #[arg(long, requires = "calibration", group = "added")]
    rates: bool,
    /// Bias, scale factor and misalignment of three accelerometers over temperature from runs in positions (force_?_mps2, table_force_?_mps2), added to
    /// --calibration.
    ///
    /// Example: hrg fit --accelerometers tumble.csv --calibration cal.toml --verify unseen.csv --out cal2.toml
    #[arg(long, requires = "calibration", group = "added")]
    accelerometers: bool,
    /// With --rates or --accelerometers: the unit's calibration, whose biases are taken off and to which the rest is added.
    #[arg(long, requires = "added")]
    calibration: Option<PathBuf>,
    /// With --rates or --accelerometers: runs that the fit does not see; before and after are printed on them.
    #[arg(long, requires = "added")]
    verify: Vec<PathBuf>,
    /// A family of units of the same design (hrg family): the coefficients are those of the highest probability under it and the recordings. A unit
    /// that does not belong to it is reported and fitted without.
    #[arg(long, value_name = "FAMILY", conflicts_with_all = ["added", "method", "uniform", "breakpoint", "degree", "history"])]
    prior: Option<PathBuf>,
    /// Method of identification (docs/methods.md)
    #[arg(long, default_value = "lsq")]
    method: Method,
    /// Seed of swarms and genetic searches: the same seed gives the same image.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Give every degree the same weight instead of every second.
    #[arg(long)]
    uniform: bool,
    /// A calibration whose curves of frequency over temperature are taken, of soaks (hrg fit points --calibration) for instance. The
    /// temperatures of a recording of sensors, or of predicted ones, stay; the image then has these curves.
    #[arg(long, value_name = "CAL")]
    curve: Option<PathBuf>,
    /// The breakpoint of the four-parameter methods (fog-...), C, instead of searching it: wu2023's div_a.
    #[arg(long, allow_negative_numbers = true)]
    breakpoint: Option<f64>,
    /// Degree of the curve of polynomial and direct: 1 to 10, or auto (the one that leaves the least of held-out parts of the runs).
    #[arg(long, value_name = "N|auto")]
    degree: Option<hrg_papers::method::Degree>,
    /// File for the course of the search: objective and best coefficients after each iteration (CSV).
    #[arg(long)]
    history: Option<PathBuf>,
    /// Allow recordings of different units.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
    /// File for the calibration: text, or the binary image if it ends in .bin
    // (Not there where a command follows, `hrg fit points`; then nothing of this is asked for.)
    #[arg(short, long, required = true)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Some(out) = arguments.out.clone() else {
        return Err(BadInput::new("give --out, for the calibration").into());
    };
    if let Some(calibration) = &arguments.calibration {
        let (runs, verify) = (&arguments.recordings, &arguments.verify);
        let added = if arguments.rates { crate::rates::fit } else { crate::forces::fit };
        return added(runs, calibration, verify, &out);
    }
    let Arguments {
        recordings,
        method,
        seed,
        uniform,
        prior,
        curve,
        breakpoint,
        degree,
        history,
        different_units,
        facts,
        ..
    } = arguments;
    let recordings = facts.load(&recordings)?;
    let of_sensors = recordings.iter().all(|r| r.thermometer.is_sensor());
    let known = known_curves(curve.as_deref(), prior.is_some() && !of_sensors)?;
    let mut prepared = fit::prepare_with(&recordings, units(different_units), known)?;
    let options = hrg_papers::method::Options { seed, uniform, breakpoint_c: breakpoint, degree };
    let (mut by, mut about, mut image) = (method.to_string(), Vec::new(), None);
    if let Some(family) = prior.as_deref().map(hrg::fleet::read_family).transpose()? {
        let of_family = family.prepare(&recordings, units(different_units))?;
        (image, about) = under(&family, &of_family)?;
        if image.is_some() {
            (by, prepared) = (format!("the family {}", family.name), of_family);
        }
    }
    let identified =
        || with_a_bar(&format!("fitting by {method}"), || methods::identify_with(&prepared, method, &options));
    let mut found = match image {
        Some(calibration) => {
            Identified { calibration, parameters: 0, seconds: 0.0, notes: Vec::new(), history: Vec::new() }
        }
        None => identified()?,
    };
    found.notes.splice(0..0, about);
    if let Some(history) = history {
        if found.history.is_empty() {
            return Err(BadInput(format!(
                "{method} is solved exactly: there is no course of a search to write; leave --history out"
            ))
            .into());
        }
        hrg_data::output::write_file(&history, csv(&found.history).as_bytes())?;
    }
    found.calibration.created_unix_s = now();
    found.calibration.sequence = 1;
    let mean_s = prepared.runs.first().map_or(fit::MEAN_S, |r| r.steps.mean_s);
    let raw = fit::spread(prepared.runs.iter().map(|r| &r.steps.rate_dph), mean_s);
    let corrected: Vec<_> = prepared.runs.iter().map(|r| fit::correct(&found.calibration, &r.steps)).collect();
    let fitted = fit::spread(&corrected, mean_s);
    let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
    for &a in &present {
        found.calibration.axes[a].train_rms_dph = fitted[a] as f32;
    }
    if let Some(known) = known.filter(|_| of_sensors) {
        fit::fly_by(&mut found.calibration, known)?;
    }
    image_file::save(&out, &found.calibration)?;
    let unit = recordings.first().map_or("deg/h", |r| r.rate_unit());
    println!("{:<5} {:>22} {:>22} {:>8}", "axis", format!("raw, 3 sigma [{unit}]"), "fitted, 3 sigma", "means");
    for a in present {
        let means: usize = prepared.runs.iter().map(|r| enough_data::means(r, a).0).sum();
        println!("{:<5} {:>22.4} {:>22.4} {means:>8}", AXIS_NAMES[a], 3.0 * raw[a], 3.0 * fitted[a]);
    }
    println!("three sigma of means over {mean_s} s, on the data of the fit, as the unit corrects them");
    for n in found.notes.iter().chain(&prepared.notes) {
        println!("note: {n}");
    }
    println!("{}: {by}, image {:08x}", out.display(), found.calibration.checksum());
    Ok(())
}

/// The curves of a calibration, for those of frequency over temperature. `has_curves`: a family brings those that its coefficients were learnt with.
fn known_curves(file: Option<&Path>, has_curves: bool) -> Result<Option<[TemperatureCurve; AXES]>> {
    let Some(file) = file else { return Ok(None) };
    if has_curves {
        return Err(BadInput::new(
            "--prior has the curves of frequency over temperature that its coefficients were learnt with; leave --curve out",
        )
        .into());
    }
    Ok(Some(image_file::load(file)?.axes.map(|a| a.curve)))
}

/// The image of a unit under a family, and the remarks on it; none of a unit that does not belong to it.
fn under(family: &Family, prepared: &fit::Prepared) -> Result<(Option<Calibration>, Vec<String>)> {
    let member = family.member(prepared, [None; AXES])?;
    let mut notes = vec![member.sentence(family)];
    let image = member.belongs().then(|| family.image(&member, prepared, &mut notes));
    Ok((image, notes))
}
