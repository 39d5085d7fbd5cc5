//! Scale factor and misalignment through the ELF: a simulated unit on a simulated rate table, before and after, on runs that the fit never saw.

use anyhow::{Context, Result};
use hrg_board::replay::{self, Options, Outcome};
use hrg_core::calibration::Calibration;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit::prepare;
use hrg_identify::rates;
use hrg_identify::rates::{bins_of, dwells_of_unit, Bin, Dwell};
use hrg_papers::method::Method;
use hrg_papers::methods;
use hrg_simulate::turning::Scheme;
use hrg_simulate::{Plan, Profile};
use std::path::Path;

/// Chamber runs that the fit does not see: three rounds of the eight steps on a soak each.
pub const UNSEEN: [&str; 2] = ["-28,58m", "42,58m"];

/// Rounds in each of them.
const ROUNDS: usize = 3;

/// One round of the steps on one soak: what the tests fly.
pub const SHORT: [&str; 1] = ["47,20m"];

/// A simulated unit with its images.
pub struct Scene {
    /// Bias alone.
    pub before: Calibration,
    /// With scale factors and misalignments.
    pub after: Calibration,
    /// Runs that the fit has not seen.
    pub unseen: Vec<Recording>,
}

/// A run on the table, as a file with it is after reading.
fn turned(unit: u64, seed: u64, profile: &str) -> Result<Recording> {
    let plan = Plan::of(Profile::parse(profile)?, unit, seed);
    let mut r = Plan { turning: Some(Scheme::default()), ..plan }.simulate().recording;
    r.clean()?;
    Ok(r)
}

/// The calibration of the biases of a simulated unit.
pub(crate) fn bias_of(unit: u64) -> Result<Calibration> {
    let train = Plan::of(Profile::parse("cycle")?, unit, 1).simulate().recording;
    Ok(methods::identify(&prepare(&[train])?, Method::Lsq, 1)?.calibration)
}

impl Scene {
    /// Simulates the unit of a seed, calibrates it, and simulates runs of these profiles.
    ///
    /// # Errors
    /// If a fit fails.
    pub fn new(unit: u64, profiles: &[&str]) -> Result<Self> {
        let before = bias_of(unit)?;
        let after = rates::identify(&[turned(unit, 2, rates::CHAMBER)?], &before)?.calibration;
        let unseen = (3..).zip(profiles).map(|(seed, p)| turned(unit, seed, p)).collect::<Result<_>>()?;
        Ok(Self { before, after, unseen })
    }
}

/// A run through the ELF, each frame compared with the desktop.
///
/// # Errors
/// As [`replay::run`].
pub fn fly(elf: &[u8], calibration: &Calibration, r: &Recording) -> Result<Outcome> {
    let options = Options { compare: true, ..Options::default() };
    replay::run(elf, Some(calibration), &Steps::new(r)?, &options, |_| {})
}

/// Residuals of the rates that the unit sent, in bins of so many visits about each axis at least.
///
/// # Errors
/// A run without dwells.
pub fn left(outcomes: &[(Outcome, &Recording)], calibration: &Calibration, visits: usize) -> Result<Vec<Bin>> {
    let mut all: Vec<Dwell> = Vec::new();
    for (o, r) in outcomes {
        let seconds: Vec<_> = o.seconds_of_frames().iter().map(|s| s.unit).collect();
        let next = all.last().map_or(0, |d| d.visit);
        all.extend(dwells_of_unit(r, calibration, &seconds, next)?);
    }
    Ok(bins_of(&all, visits))
}

/// Runs it, prints it, and leaves the images in a folder.
///
/// # Errors
/// If a step fails.
pub fn rates(elf: &[u8], unit: u64, out: &Path) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    println!("Simulated unit SIM-{unit} on a simulated rate table, through the firmware's ELF on the virtual board.");
    let scene = Scene::new(unit, &UNSEEN)?;
    for (name, c) in [("before", &scene.before), ("after", &scene.after)] {
        image_file::save(&out.join(format!("{name}.toml")), c)?;
        let outcomes =
            scene.unseen.iter().map(|r| Ok((fly(elf, c, r)?, r))).collect::<Result<Vec<(Outcome, &Recording)>>>()?;
        let frames: usize = outcomes.iter().map(|(o, _)| o.received.rates.len() + o.received.housekeeping.len()).sum();
        let differing: usize = outcomes.iter().map(|(o, _)| o.received.differing).sum();
        println!("{name}: {frames} frames, {differing} differ from hrg-core on the desktop");
        println!(
            "  {:<5} {:>8} {:>20} {:>14} {:>14}",
            "axis", "T [C]", "scale factor [ppm]", "cross [urad]", "cross [urad]"
        );
        for b in left(&outcomes, c, ROUNDS)? {
            println!(
                "  {:<5} {:>8.1} {:>20.2} {:>14.2} {:>14.2}",
                AXIS_NAMES[b.axis], b.temperature_c, b.scale_ppm, b.cross_urad[0], b.cross_urad[1]
            );
        }
    }
    println!(
        "what the unit's rates are off on {} runs that the fit never saw, {AXES} axes, at temperatures with {ROUNDS} visits; image {:08x}",
        UNSEEN.len(),
        scene.after.checksum()
    );
    Ok(())
}
