//! `hrg fit lag`: how the resonators follow their surroundings.

use anyhow::Result;
use clap::Args;
use hrg_core::calibration::Calibration;
use hrg_core::temperature::TemperatureCurve;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::image_file;
use hrg_data::load::load_recording;
use hrg_data::recording::parquet;
use hrg_data::recording::steps::{Run, Steps};
use hrg_identify::fit;
use hrg_identify::thermometer::lag;
use hrg_identify::thermometer::lag::{Input, Output};
use std::path::{Path, PathBuf};

/// Arguments of `hrg fit lag`.
#[derive(Args)]
pub struct Arguments {
    /// Recording with a step of the chamber's temperature.
    recording: PathBuf,
    /// Calibration whose frequency-temperature curves are used; without it they are fitted to this recording.
    #[arg(long)]
    calibration: Option<PathBuf>,
    /// Input of the lag: case or chamber
    #[arg(long, default_value = "case", value_parser = ["case", "chamber"])]
    input: String,
    /// Output that answers the step: frequency, or rate where no curve of frequency is known (as zhao2022 has it)
    #[arg(long, default_value = "frequency", value_parser = ["frequency", "rate"])]
    from: String,
    /// Predict the resonator temperatures of this recording where its frequencies are missing.
    #[arg(long)]
    predict: Option<PathBuf>,
    /// File for a recording of that run with the predicted temperatures in the place of frequencies: for hrg fit.
    #[arg(long, requires = "predict")]
    recording_out: Option<PathBuf>,
    /// File for the report (JSON), or the prediction (CSV).
    #[arg(short, long)]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// Bad input, or a file that cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let input = if arguments.input == "chamber" { Input::Chamber } else { Input::Case };
    let output = if arguments.from == "rate" { Output::Rate } else { Output::Frequency };
    thermal_lag(arguments, input, output)
}

fn thermal_lag(arguments: &Arguments, input: Input, output: Output) -> Result<()> {
    let recording = load_recording(&arguments.recording)?;
    let curves = match (&arguments.calibration, output) {
        (Some(p), _) => image_file::load(p)?.axes.map(|a| a.curve),
        (None, Output::Frequency) => fit::prepare(std::slice::from_ref(&recording))?.calibration.axes.map(|a| a.curve),
        // (These curves are not used.)
        (None, Output::Rate) => Calibration::uncalibrated().axes.map(|a| a.curve),
    };
    let run = Run::new(Steps::new(&recording)?, curves);
    let responses = lag::identify(&run, input, output)?;
    table(&responses);
    match (&arguments.predict, &arguments.out) {
        (Some(predict), _) => predicted(predict, &responses, curves, input, arguments),
        (None, Some(out)) => hrg_data::output::write_file(out, serde_json::to_string_pretty(&responses)?.as_bytes()),
        (None, None) => Ok(()),
    }
}

/// Prints what was found.
fn table(responses: &[lag::Response]) {
    println!(
        "{:<5} {:>9} {:>8} {:>16} {:>8} {:>15}   another explanation",
        "axis",
        "gain",
        "+-",
        "time constant s",
        "+-",
        format!("residual {}", responses[0].output.unit())
    );
    for (name, r) in AXIS_NAMES.iter().zip(responses) {
        let f = &r.first_order;
        let second = r.second_order.as_ref().map(|s| {
            format!("two lags in series, {:.0} s and {:.0} s, leave {:.3} C", s.tau_s[0], s.tau_s[1], s.residual_c)
        });
        let bend = r.bend.as_ref().map(|b| {
            let (tau, std) = r.time_constant();
            format!(
                "the bias bends: {:.0} +- {:.0} s, log odds {:+.1}; with both by their odds {tau:.0} +- {std:.0} s",
                b.tau_s, b.tau_std_s, b.log_odds
            )
        });
        println!(
            "{name:<5} {:>9.4} {:>8.4} {:>16.1} {:>8.1} {:>15.3}   {}",
            f.gain,
            f.gain_std,
            f.tau_s[0],
            f.tau_std_s,
            f.residual_c,
            second.or(bend).unwrap_or_else(|| "none needed".into())
        );
    }
}

/// Predicts the resonators of another recording, and says how far off that is.
fn predicted(
    predict: &Path,
    responses: &[lag::Response],
    curves: [TemperatureCurve; AXES],
    input: Input,
    arguments: &Arguments,
) -> Result<()> {
    let other = load_recording(predict)?;
    let run = Run::new(Steps::new(&other)?, curves);
    let mut columns = Vec::new();
    for (a, r) in responses.iter().enumerate() {
        let u = lag::input_of(&run, a, input)
            .ok_or_else(|| BadInput::new(format!("{}: the {input:?} temperature is missing", predict.display())))?;
        // By the curves of a calibration of another kind a frequency would be no truth.
        let known = arguments.calibration.is_some() || r.output == Output::Frequency;
        let truth = if known { lag::resonator(&run, a) } else { vec![f64::NAN; run.steps.len()] };
        let predicted = r.of_temperature().predict(&u, truth.first().copied().filter(|t| t.is_finite()));
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
    if let Some(path) = &arguments.recording_out {
        let temperatures = columns.iter().map(|(p, _)| p.clone()).collect::<Vec<_>>();
        let temperatures = temperatures.try_into().map_err(|_| BadInput::new("three axes were expected"))?;
        parquet::write_text(path, &other.with_temperatures(&run.steps, temperatures).to_csv())?;
        println!("{}: a recording with these temperatures in the place of frequencies", path.display());
    }
    if let Some(out) = &arguments.out {
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
        hrg_data::output::write_file(out, csv.as_bytes())?;
    }
    Ok(())
}
