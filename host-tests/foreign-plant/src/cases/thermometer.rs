//! Cases of thermometers at fault. The bias is as equation 7 wants it; what the thermometer indicates is wrong. Noise is low, because a
//! bias sees a wrong temperature only through its slope.

use crate::case::{Case, Effect, Runs};
use crate::physics::thermometer as form;
use crate::plan::Followed;
use crate::truth::Class;

fn case(name: &str, description: &str) -> Case {
    let mut case = Case::new("thermometer", name, description).quiet(0.08, 0.15);
    case.raw_three_sigma_dph = (8.0, 10.0);
    case
}

const ONE_RUN: &str = "it is an accident of one run";

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("thermometer-hop", "The frequency of y jumps in the train run and stays.")
            .with(Effect::thermometer("hop", form::hop).floors([0.0, 3.0, 0.0]).only(Runs::Train).or(&[Class::Event])),
        case("thermometer-hop-later", "The frequency of x jumps in the verify run and stays.").with(
            Effect::thermometer("hop", form::hop)
                .floors([3.0, 0.0, 0.0])
                .only(Runs::Verify)
                .or(&[Class::Event, Class::None])
                .beyond(ONE_RUN),
        ),
        case("thermometer-ageing", "The frequency drifts from power-on by a logarithm, alike in every run.")
            .with(Effect::thermometer("ageing of the frequency", form::frequency_ageing).or(&[Class::PowerOn])),
        case("thermometer-board-clock", "The counter's clock is a parabola of the board's temperature, late.")
            .with(Effect::timebase("clock on the board", form::board_clock).or(&[Class::Memory])),
        case("thermometer-clock-warm-up", "The counter's clock warms up after power-on.")
            .with(Effect::timebase("clock warms up", form::clock_warm_up).or(&[Class::PowerOn])),
        case("thermometer-clock-wander", "The counter's clock drifts, another way in each run.")
            .with(Effect::timebase("clock drifts", form::clock_drift).or(&[Class::Event]).beyond(ONE_RUN)),
        case("thermometer-activity-dip", "Another mode pulls the frequency within some degrees.").with(
            Effect::thermometer("activity dip", form::activity_dip)
                .beside(&[Class::Rate])
                .floors([2.0; 3])
                .or(&[Class::Shape]),
        ),
        case("thermometer-coarse-frequency", "Frequencies in steps of 0.05 Hz, 0.1 C.")
            .layout(|l| l.frequency_step_hz = 0.05)
            .also(Class::Thermometer),
        case(
            "thermometer-case-sensor-loose",
            "The case sensor of x comes loose in the train run; the frequency is right.",
        )
        .layout(|l| l.loose_case_x = true)
        .also(Class::Thermometer),
        case("thermometer-late-sensor", "Sensors behind glue instead of frequencies: 200 to 400 s late.")
            .layout(|l| l.followed = Followed::Case)
            .with(
                Effect::thermometer("late sensor", form::late_sensor)
                    .beside(&[Class::Rate])
                    .natural([1.0; 3])
                    .or(&[Class::Memory]),
            ),
        case("thermometer-loose-sensor", "Sensors instead of frequencies; that of z comes loose in the train run.")
            .layout(|l| l.followed = Followed::Case)
            .with(
                Effect::thermometer("loose sensor", form::loose_sensor)
                    .floors([0.0, 0.0, 2.0])
                    .only(Runs::Train)
                    .or(&[Class::Event, Class::Memory]),
            ),
        case("thermometer-sticking-sensor", "Sensors with play instead of frequencies.")
            .layout(|l| l.followed = Followed::Case)
            .with(
                Effect::thermometer("sticking sensor", form::sticking_sensor).floors([2.0; 3]).or(&[Class::Hysteresis]),
            ),
    ]
}
