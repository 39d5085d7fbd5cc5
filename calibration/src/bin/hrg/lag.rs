//! `hrg lag`: how the resonators follow their surroundings.

use anyhow::Result;
use clap::Args;
use hrg_cal::recording::steps::{Run, Steps};
use hrg_cal::thermometer::lag;
use hrg_cal::{fit, image_file, load_recording, BadInput, AXIS_NAMES};
use hrg_core::temperature::TemperatureCurve;
use hrg_core::AXES;
use std::path::{Path, PathBuf};

/// What `hrg lag` is told.
#[derive(Args)]
pub struct Arguments {
    /// Recording with a step of the chamber's temperature.
    recording: PathBuf,
    /// Calibration whose frequency-temperature curves are used; without it they are fitted to this recording.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// What drives the lag: case or chamber (shell: an old name of case)
    #[arg(long, default_value = "case", value_parser = ["case", "shell", "chamber"])]
    input: String,
    /// Predict the resonator temperatures of this recording where its frequencies are missing.
    #[arg(long)]
    predict: Option<PathBuf>,
    /// Where the report (JSON), or the prediction (CSV), goes.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: Arguments) -> Result<()> {
    let Arguments { recording, calibration, input, predict, out } = arguments;
    let input = if input == "chamber" { lag::Input::Chamber } else { lag::Input::Case };
    thermal_lag(&recording, calibration.as_deref(), input, predict.as_deref(), out.as_deref())
}

fn thermal_lag(
    path: &Path,
    calibration: Option<&Path>,
    input: lag::Input,
    predict: Option<&Path>,
    out: Option<&Path>,
) -> Result<()> {
    let recording = load_recording(path)?;
    let curves = match calibration {
        Some(p) => image_file::load(p)?.axes.map(|a| a.curve),
        None => fit::prepare(std::slice::from_ref(&recording))?.calibration.axes.map(|a| a.curve),
    };
    let run = Run::new(Steps::new(&recording)?, curves);
    let responses = lag::identify(&run, input)?;
    println!(
        "{:<5} {:>8} {:>9} {:>16} {:>12}   two lags in series",
        "axis", "gain", "+-", "time constant s", "residual C"
    );
    for (name, r) in AXIS_NAMES.iter().zip(&responses) {
        let f = &r.first_order;
        let second = r.second_order.as_ref().map_or("not needed".to_string(), |s| {
            format!("{:.0} s and {:.0} s leave {:.3} C", s.tau_s[0], s.tau_s[1], s.residual_c)
        });
        println!(
            "{name:<5} {:>8.4} {:>9.4} {:>16.1} {:>12.3}   {second}",
            f.gain, f.gain_std, f.tau_s[0], f.residual_c
        );
    }
    match (predict, out) {
        (Some(predict), out) => predicted(predict, &responses, curves, input, out),
        (None, Some(out)) => hrg_cal::write_file(out, serde_json::to_string_pretty(&responses)?.as_bytes()),
        (None, None) => Ok(()),
    }
}

/// Predicts the resonators of another recording, and says how far off that is.
fn predicted(
    predict: &Path,
    responses: &[lag::Response],
    curves: [TemperatureCurve; AXES],
    input: lag::Input,
    out: Option<&Path>,
) -> Result<()> {
    let other = load_recording(predict)?;
    let run = Run::new(Steps::new(&other)?, curves);
    let mut columns = Vec::new();
    for (a, r) in responses.iter().enumerate() {
        let u = lag::input_of(&run, a, input)
            .ok_or_else(|| BadInput::new(format!("{}: the {input:?} temperature is missing", predict.display())))?;
        let truth = lag::resonator(&run, a);
        let model = r.second_order.as_ref().unwrap_or(&r.first_order);
        let predicted = model.predict(&u, truth.first().copied().filter(|t| t.is_finite()));
        let errors: Vec<f64> = predicted.iter().zip(&truth).map(|(p, t)| p - t).filter(|e| e.is_finite()).collect();
        if !errors.is_empty() {
            let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let worst = errors.iter().fold(0.0f64, |m, e| m.max(e.abs()));
            println!(
                "{}: predicted over {} s; where the frequency is known the prediction is off by {rms:.2} C RMS, {worst:.2} C at most",
                AXIS_NAMES[a],
                predicted.len(),
            );
        }
        columns.push((predicted, truth));
    }
    if let Some(out) = out {
        let mut csv = String::from("time_s");
        for n in AXIS_NAMES {
            csv.push_str(&format!(",predicted_{n}_c,temperature_{n}_c"));
        }
        csv.push('\n');
        for k in 0..run.steps.len() {
            csv.push_str(&format!("{}", run.steps.start_s + k as f64));
            for (p, t) in &columns {
                csv.push_str(&format!(",{:.4},{:.4}", p[k], t[k]));
            }
            csv.push('\n');
        }
        hrg_cal::write_file(out, csv.as_bytes())?;
    }
    Ok(())
}
