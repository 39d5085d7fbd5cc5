//! `hrg fit --accelerometers`: bias, scale factor and misalignment of accelerometers over temperature.

use crate::rates::{largest, of_one_unit, save, say_corrections, say_unseen};
use anyhow::Result;
use hrg_data::image_file;
use hrg_identify::forces;
use hrg_identify::forces::UG_OF_MPS2;
use hrg_identify::rates::{bins, Bin};
use std::path::{Path, PathBuf};

/// Fits, writes the image and prints what was found; with `verify` also before and after on runs that the fit did not see.
pub fn fit(runs: &[PathBuf], calibration: &Path, verify: &[PathBuf], out: &Path) -> Result<()> {
    let (recordings, unseen) = of_one_unit(runs, verify)?;
    let given = image_file::load(calibration)?;
    let mut found = forces::identify(&recordings, &given)?;
    save(&mut found.calibration, &given, out)?;
    let bias_ug = |a: usize, t: f64| {
        let (bias, std) = found.bias_at(a, t);
        (UG_OF_MPS2 * bias, UG_OF_MPS2 * std)
    };
    let image = &found.calibration;
    let stated = |a: usize| image.specific_force.as_ref().map(|all| &all[a].errors);
    say_corrections(&image.scaling, &found.factors, &stated, Some(("bias [ug]", &bias_ug)));
    found.notes.iter().for_each(|n| println!("note: {n}"));
    say_unseen(&unseen, [&given, image], &|c| Ok(bins(&forces::all_dwells(&unseen, &given, c)?)), &line)?;
    println!("{}: accelerometers over temperature, image {:08x}", out.display(), image.checksum());
    Ok(())
}

/// Residuals of an accelerometer: the largest over temperature.
fn line(own: &[&Bin]) -> String {
    format!(
        "bias at most {:8.2} ug, scale factor {:8.2} ppm, misalignments {:7.2} and {:7.2} urad, over {} temperatures",
        UG_OF_MPS2 * largest(own, &|b| b.middle),
        largest(own, &|b| b.scale_ppm),
        largest(own, &|b| b.cross_urad[0]),
        largest(own, &|b| b.cross_urad[1]),
        own.len()
    )
}
