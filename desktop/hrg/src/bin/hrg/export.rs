//! `hrg export`: a calibration as parameters of a flight controller.

use crate::facts::FactsArguments;
use crate::units;
use anyhow::Result;
use clap::Args;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::{Run, Steps};
use hrg_identify::fit;
use hrg_identify::fit::autopilot::{Autopilot, Cubic};
use hrg_identify::fit::{enough_data, independence};
use std::path::PathBuf;

/// Arguments of `hrg export`.
#[derive(Args)]
pub struct Arguments {
    /// Recordings to learn from, with a thermometer (hrg import makes them of logs).
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,
    /// Recording to test the result on. It is not used in the fit.
    #[arg(long, value_name = "RUN")]
    verify: Option<PathBuf>,
    /// The flight controller.
    #[arg(long = "for", value_name = "NAME")]
    autopilot: Name,
    /// Number of the IMU, from 0.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..3))]
    imu: u8,
    /// PX4: the device_id of the gyro (sensor_gyro.device_id in the log); PX4 uses the parameters for that device only.
    #[arg(long, value_name = "ID", default_value_t = 0)]
    device_id: u32,
    /// File for the parameters.
    #[arg(short, long)]
    out: PathBuf,
    /// Allow recordings of different units.
    #[arg(long)]
    different_units: bool,
    #[command(flatten)]
    facts: FactsArguments,
}

/// Least span of temperatures that ArduPilot accepts, C.
const LEAST_SPAN_C: f64 = 10.0;

#[derive(Clone, Copy, clap::ValueEnum)]
enum Name {
    /// INS_TCALn_*, as NAME VALUE.
    Ardupilot,
    /// TC_Gn_*, as QGroundControl reads them.
    Px4,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { runs, verify, autopilot, imu, device_id, out, different_units, facts } = arguments;
    let autopilot = match autopilot {
        Name::Ardupilot => Autopilot::Ardupilot,
        Name::Px4 => Autopilot::Px4,
    };
    let train = facts.load(&runs)?;
    if let Some(what) = train.iter().find_map(|r| r.stands_for()) {
        return Err(BadInput(format!(
            "the recordings hold {what} in the place of rates: a flight controller has no use for them"
        ))
        .into());
    }
    let mut prepared = fit::prepare_for(&train, units(different_units))?;
    let mut unseen = None;
    if let Some(path) = verify {
        let r = facts.load(&[path])?.pop().ok_or_else(|| BadInput::new("no verify recording was given"))?;
        for t in &train {
            independence::require(&[(t, "train"), (&r, "verify")])?;
        }
        let curves = prepared.calibration.axes.each_ref().map(|a| a.curve);
        let mut run = Run::new(Steps::new(&r)?, curves);
        let all = prepared.runs.iter_mut().chain([&mut run]);
        prepared.notes.extend(enough_data::agree_on_means(&mut all.collect::<Vec<_>>()));
        enough_data::require(&run, "the verify run")?;
        unseen = Some(run);
    }
    let cubic = Cubic::fit(&prepared, autopilot)?;
    hrg_data::output::write_file(&out, cubic.parameters(imu, device_id).as_bytes())?;
    let mean_s = prepared.runs.first().map_or(fit::MEAN_S, |r| r.steps.mean_s);
    println!("{:<24} {:>12} {:>12}", "deg/h", "raw", "corrected");
    let each = prepared.runs.iter().map(|r| ("train", r)).chain(unseen.iter().map(|r| ("verify", r)));
    for (what, run) in each {
        for (a, name) in AXIS_NAMES.iter().enumerate() {
            if let Some([raw, corrected]) = cubic.leaves(run, a) {
                println!("{:<24} {raw:>12.3} {corrected:>12.3}", format!("{what} run, axis {name}"));
            }
        }
    }
    println!(
        "standard deviation of means over {mean_s} s about their mean, by the flight controller's formula; {:.1} to {:.1} C",
        cubic.range_c[0], cubic.range_c[1]
    );
    let span_c = cubic.range_c[1] - cubic.range_c[0];
    if span_c < LEAST_SPAN_C {
        println!("note: the runs span {span_c:.1} C only: a cubic of so little is good for nothing beyond it, and ArduPilot wants {LEAST_SPAN_C:.0} C");
    }
    let absent: Vec<&str> = (0..3).filter(|a| cubic.bias_dph(*a, 35.0).is_none()).map(|a| AXIS_NAMES[a]).collect();
    if !absent.is_empty() {
        println!("note: {} have no parameters: their rates are not in the recordings", hrg_data::error::list(&absent));
    }
    if autopilot == Autopilot::Ardupilot {
        println!("note: the constant is not among the parameters: ArduPilot finds it at each start (INS_GYROFFS)");
    } else if device_id == 0 {
        println!("note: TC_G{imu}_ID is 0, and PX4 will not use the parameters: give --device-id, sensor_gyro.device_id of the log");
    }
    if let Some(share) = unseen.as_ref().map(|r| cubic.outside(r)).filter(|s| *s > 0.005) {
        println!(
            "note: {:.0} % of the verify run is outside these temperatures: there the flight controller holds the value at the end",
            100.0 * share
        );
    }
    if unseen.is_none() {
        println!("note: nothing was tested on another run; --verify RUN does");
    }
    println!("{}: {} parameters", out.display(), cubic.parameters(imu, device_id).lines().count());
    Ok(())
}
