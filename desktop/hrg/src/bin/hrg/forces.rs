//! `hrg fit --accelerometers`: bias, scale factor and misalignment of accelerometers over temperature.

use crate::now;
use crate::rates::{of_one_unit, runs_of, too_short, with_std};
use anyhow::Result;
use hrg_core::rate_factors::OTHERS;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::image_file;
use hrg_identify::forces;
use hrg_identify::forces::{Found, UG_OF_MPS2};
use hrg_identify::rates::{bins, Bin};
use std::path::{Path, PathBuf};

/// Fits, writes the image and prints what was found; with `verify` also before and after on runs that the fit did not see.
pub fn fit(runs: &[PathBuf], calibration: &Path, verify: &[PathBuf], out: &Path) -> Result<()> {
    let (recordings, unseen) = of_one_unit(runs, verify)?;
    let given = image_file::load(calibration)?;
    let mut found = forces::identify(&recordings, &given)?;
    found.calibration.created_unix_s = now();
    found.calibration.sequence = given.sequence.saturating_add(1);
    image_file::save(out, &found.calibration)?;
    say_found(&found);
    for n in &found.notes {
        println!("note: {n}");
    }
    if !unseen.is_empty() {
        println!("\nbefore and after, on {} that the fit did not see:", runs_of(unseen.len()));
        for (name, c) in [("before", &given), ("after", &found.calibration)] {
            say_bins(name, &bins(&forces::all_dwells(&unseen, &given, c)?));
        }
    }
    println!("{}: accelerometers over temperature, image {:08x}", out.display(), found.calibration.checksum());
    Ok(())
}

fn say_found(found: &Found) {
    let scaling = &found.calibration.scaling;
    println!(
        "correction over temperature on a soak, with standard deviations (noise, and what the curve does not follow)"
    );
    println!(
        "{:<5} {:>6} {:>20} {:>20} {:>24} {:>24}",
        "axis", "T [C]", "bias [ug]", "scale factor [ppm]", "misalignment [urad]", ""
    );
    for (a, fit) in found.factors.iter().enumerate() {
        let Some(one) = found.calibration.specific_force.as_ref().map(|all| &all[a].errors) else { continue };
        let (from, to) = (f64::from(one.rate_valid_from_c), f64::from(one.rate_valid_to_c));
        for k in 0..=4 {
            let t = from + 0.25 * f64::from(k) * (to - from);
            let cross = [0, 1].map(|j: usize| {
                let other = AXIS_NAMES[OTHERS[a][j]];
                format!("{}{other} {}", AXIS_NAMES[a], with_std(fit.misalignment_at(scaling, j, t)))
            });
            let (bias, std) = found.bias_at(a, t);
            println!(
                "{:<5} {t:>6.1} {:>20} {:>20} {:>24} {:>24}",
                AXIS_NAMES[a],
                with_std((UG_OF_MPS2 * bias, UG_OF_MPS2 * std)),
                with_std(fit.scale_at(scaling, t, 0.0)),
                cross[0],
                cross[1]
            );
        }
    }
}

/// Prints what is left by accelerometer: the largest over temperature.
fn say_bins(name: &str, all: &[Bin]) {
    for a in 0..AXES {
        let own: Vec<&Bin> = all.iter().filter(|b| b.axis == a).collect();
        if own.is_empty() {
            println!("{}", too_short(name, a));
            continue;
        }
        let largest = |values: &dyn Fn(&Bin) -> f64| own.iter().map(|b| values(b).abs()).fold(0.0, f64::max);
        println!(
            "  {name:<6} {}: bias at most {:8.2} ug, scale factor {:8.2} ppm, misalignments {:7.2} and {:7.2} urad, over {} temperatures",
            AXIS_NAMES[a],
            UG_OF_MPS2 * largest(&|b| b.middle),
            largest(&|b| b.scale_ppm),
            largest(&|b| b.cross_urad[0]),
            largest(&|b| b.cross_urad[1]),
            own.len()
        );
    }
}
