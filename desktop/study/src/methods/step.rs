//! zhao2022's experiment 1 on units of its kind: the resonator's time constant from the gyro's output.

use super::spread::{case_noise, cell, short};
use super::Work;
use crate::faults::trials;
use anyhow::Result;
use hrg_core::calibration::Calibration;
use hrg_data::numeric::stats::quantile;
use hrg_data::recording::steps::{Run, Steps};
use hrg_identify::thermometer::lag::{identify, Input, Output, Response};
use hrg_simulate::{Kind, Plan, Profile};
use std::fmt::Write as _;

/// Time constants of the simulated resonators, s.
const TRUE_S: [f64; 3] = hrg_simulate::RESONATOR_LAG_S;

/// Steps of temperature: how they are called, and their profiles.
const STEPS: [(&str, &str); 2] = [("0 to 10 C (theirs)", "lag"), ("25 to 35 C", "25,4h,35@5,5h")];

/// The table: error and stated deviation of the time constant, for a lag alone and with a bend by its odds.
///
/// # Errors
/// If a run cannot be simulated.
pub fn table(work: &Work<'_>) -> Result<String> {
    let mut out = String::from(
        "| step | model | error [%] | stated deviation [%] | RMS of error over deviation | refused |\n|---|---|--:|--:|--:|--:|\n",
    );
    for (name, profile) in STEPS {
        let all = trials(work.units * work.seeds, || Ok(()), |(), k| one(profile, work, k))?;
        let refused = all.iter().filter(|r| r.is_none()).count();
        let found: Vec<(usize, Response)> = all.into_iter().flatten().flat_map(|r| r.into_iter().enumerate()).collect();
        for (model, bends) in [("lag", false), ("lag, and a bend by its odds", true)] {
            let of = |r: &Response| match bends {
                false => (r.first_order.tau_s[0], r.first_order.tau_std_s),
                true => r.time_constant(),
            };
            let each = |v: &dyn Fn(f64, f64, f64) -> f64| -> Vec<f64> {
                found.iter().map(|(a, r)| (of(r), TRUE_S[*a])).map(|((tau, std), truth)| v(tau, std, truth)).collect()
            };
            let errors = each(&|tau, _, truth| 100.0 * (tau / truth - 1.0));
            let stated = each(&|_, std, truth| 100.0 * std / truth);
            let squares = each(&|tau, std, truth| ((tau - truth) / std).powi(2));
            let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            let _ = writeln!(
                out,
                "| {name} | {model} | {} | {} | {} (largest {}) | {refused} of {} |",
                cell(&errors),
                cell(&stated),
                short(rms),
                short(quantile(&squares, 1.0).sqrt()),
                work.units * work.seeds
            );
        }
    }
    Ok(out)
}

fn one(profile: &str, work: &Work<'_>, k: u64) -> Result<Option<[Response; 3]>> {
    let kind = Kind::Zhao;
    let unit = 1 + k / work.seeds;
    let seed = case_noise(work, unit, 1 + k % work.seeds);
    let plan = Plan { kind, noise: kind.noise(), ..Plan::of(Profile::parse(profile)?, unit, seed) };
    let curves = Calibration::uncalibrated().axes.map(|a| a.curve);
    Ok(identify(&Run::new(Steps::new(&plan.simulate().recording)?, curves), Input::Case, Output::Rate).ok())
}
