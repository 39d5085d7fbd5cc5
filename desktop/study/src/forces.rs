//! Accelerometers through the ELF: a simulated unit in simulated positions, before and after, on a run that the fit never saw.

use crate::rates::bias_of;
use anyhow::{Context, Result};
use hrg_board::replay::{self, Options, Outcome};
use hrg_core::calibration::Calibration;
use hrg_core::output::OutputSettings;
use hrg_core::timebase::Timebase;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::image_file;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::forces::{dwells_of_unit, identify, CHAMBER, UG_OF_MPS2};
use hrg_identify::rates::{bins_of, Bin};
use hrg_simulate::{Plan, Profile};
use std::path::Path;

/// Chamber run that the fit does not see: two rounds of the positions on each of two soaks, and the ramp between them.
pub const UNSEEN: &str = "-28,18m,42@1.5,38m";

/// One round on one soak: what the tests fly.
pub const SHORT: &str = "47,10m";

/// Samples of a message of increments: as many as there can be.
const INCREMENTS: u16 = 50;

/// A simulated unit with its images.
pub struct Scene {
    /// Bias of the gyros alone.
    pub before: Calibration,
    /// With the accelerometers.
    pub after: Calibration,
    /// A run that the fit has not seen.
    pub unseen: Recording,
}

/// A run in positions, as a file with it is after reading.
fn positioned(unit: u64, seed: u64, profile: &str) -> Result<Recording> {
    let plan = Plan::of(Profile::parse(profile)?, unit, seed);
    let mut r = Plan { positions: true, ..plan }.simulate().recording;
    r.clean()?;
    Ok(r)
}

impl Scene {
    /// Simulates the unit of a seed, calibrates it, and simulates a run of this profile.
    ///
    /// # Errors
    /// If a fit fails.
    pub fn new(unit: u64, profile: &str) -> Result<Self> {
        let before = bias_of(unit)?;
        let after = identify(&[positioned(unit, 2, CHAMBER)?], &before)?.calibration;
        Ok(Self { before, after, unseen: positioned(unit, 3, profile)? })
    }
}

/// A run through the ELF with increments, each message compared with the desktop.
///
/// # Errors
/// As [`replay::run`]; a run without specific forces.
pub fn fly(elf: &[u8], calibration: &Calibration, r: &Recording) -> Result<Outcome> {
    let [forces, _] = r.forces_mps2().context("a run in positions")?;
    let by_second = (0..r.time_s.len()).map(|k| forces.map(|f| f[k])).collect();
    let options = Options {
        accelerations: Some((0.0, by_second)),
        output: Some(OutputSettings { increments: INCREMENTS, ..OutputSettings::default() }),
        ..Options::default()
    };
    replay::run(elf, Some(calibration), &Steps::new(r)?, &options, |_| {})
}

/// Specific forces that the unit sent, m/s^2, second by second of its run; NaN where it sent none.
fn sent_mps2(o: &Outcome, seconds: usize) -> Vec<[f64; AXES]> {
    let ticks_per_s = u64::from(Timebase::REFERENCE.ticks_per_s());
    let mut sums = vec![([0.0; AXES], 0u64); seconds];
    let mut at: Option<u64> = None;
    for i in &o.received.increments {
        let before = at.unwrap_or_else(|| u64::from(i.tick) - u64::from(i.ticks));
        let now = at.insert(before + u64::from(i.ticks));
        let Some((sum, ticks)) = sums.get_mut((*now / ticks_per_s) as usize) else { break };
        sum.iter_mut().zip(i.velocity_mps).for_each(|(s, v)| *s += f64::from(v));
        *ticks += u64::from(i.ticks);
    }
    let mean = |(sum, ticks): ([f64; AXES], u64)| {
        sum.map(|v| if ticks == 0 { f64::NAN } else { v * ticks_per_s as f64 / ticks as f64 })
    };
    sums.into_iter().map(mean).collect()
}

/// Residuals of the specific forces that the unit sent, in bins of so many visits of each axis at least.
///
/// # Errors
/// A run without dwells.
pub fn left(o: &Outcome, r: &Recording, calibration: &Calibration, visits: usize) -> Result<Vec<Bin>> {
    Ok(bins_of(&dwells_of_unit(r, calibration, &sent_mps2(o, r.time_s.len()), 0)?, visits))
}

/// Runs it, prints it, and leaves the images in a folder.
///
/// # Errors
/// If a step fails.
pub fn forces(elf: &[u8], unit: u64, out: &Path) -> Result<()> {
    println!("\nThe accelerometers of simulated unit SIM-{unit} in simulated positions, through the same ELF.");
    let scene = Scene::new(unit, UNSEEN)?;
    for (name, c) in [("before", &scene.before), ("after", &scene.after)] {
        image_file::save(&out.join(format!("forces-{name}.toml")), c)?;
        let o = fly(elf, c, &scene.unseen)?;
        let received = &o.received;
        println!(
            "{name}: {} messages of increments and {} frames, {} differ from hrg-core on the desktop",
            received.increments.len(),
            received.rates.len(),
            received.differing
        );
        println!(
            "  {:<5} {:>8} {:>12} {:>20} {:>14} {:>14}",
            "axis", "T [C]", "bias [ug]", "scale factor [ppm]", "cross [urad]", "cross [urad]"
        );
        for b in left(&o, &scene.unseen, c, 1)? {
            println!(
                "  {:<5} {:>8.1} {:>12.2} {:>20.2} {:>14.2} {:>14.2}",
                AXIS_NAMES[b.axis],
                b.temperature_c,
                UG_OF_MPS2 * b.middle,
                b.scale_ppm,
                b.cross_urad[0],
                b.cross_urad[1]
            );
        }
    }
    println!(
        "what the unit's specific forces are off on a run that the fit never saw; image {:08x}",
        scene.after.checksum()
    );
    Ok(())
}
