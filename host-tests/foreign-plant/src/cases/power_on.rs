//! Cases of functions of the time since power-on.

use crate::case::{run, Case, Effect, RunSpec};
use crate::chamber::Program;
use crate::physics::{power_on as form, Form};
use crate::truth::Class::{self, PowerOn};

fn case(name: &str, description: &str) -> Case {
    Case::new("power-on", name, description)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(PowerOn, name, form)
}

/// A run that starts at another temperature.
fn started_at(start_c: f64, program: Program, hours: f64) -> RunSpec {
    let mut spec = run(program, hours);
    spec.plan.span.start_c = start_c;
    spec
}

/// Three train runs that start at 22, -25 and 48 C, and a verify run that starts at 3 C.
fn from_four_temperatures(case: Case) -> Case {
    let programs = (Program::Cycles, Program::SetpointWalk);
    case.programs(programs.0, programs.1)
        .and_train(started_at(-25.0, Program::Stairs, 7.0))
        .and_train(started_at(48.0, Program::TwoSpeed, 7.0))
        .verify_with(|verify| verify.plan.span.start_c = 3.0)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("power-on-two-exponentials", "A fast and a slow exponential.")
            .with(effect("two exponentials", form::two_exponentials)),
        case("power-on-logarithm", "A logarithm of time.")
            .with(effect("logarithm", form::logarithm).or(&[Class::Event])),
        case("power-on-stretched", "A stretched exponential.").with(effect("stretched exponential", form::stretched)),
        case("power-on-power-law", "A power law, on x and z.")
            .with(effect("power law", form::power_law).floors([3.0, 0.0, 2.0])),
        case("power-on-rise-and-decay", "Rises for half an hour, then decays.")
            .with(effect("rise and decay", form::rise_and_decay)),
        case("power-on-ringing", "A loop that rings out.").with(effect("ringing", form::ringing)),
        case("power-on-late-start", "A heater of the electronics cuts in after an hour or more.")
            .with(effect("late start", form::late_start).or(&[Class::Event])),
        case("power-on-tau-by-axis", "One exponential, of 700, 2000 and 5000 s on x, y and z.")
            .with(effect("exponential", form::tau_by_axis)),
        from_four_temperatures(case(
            "power-on-by-start-temperature",
            "The amplitude is set by the temperature at power-on.",
        ))
        .with(effect("exponential", form::by_start_temperature)),
        case("power-on-settling-slope", "The slope over temperature settles after power-on.")
            .with(effect("settling slope", form::settling_slope)),
        from_four_temperatures(case(
            "power-on-tau-by-start",
            "The time constant is set by the temperature at power-on.",
        ))
        .with(effect("exponential", form::tau_by_start_temperature).floors([2.0; 3])),
        case("power-on-small", "A stretched exponential of one floor, on y only.")
            .with(effect("stretched exponential", form::stretched).floors([0.0, 1.0, 0.0])),
    ]
}
