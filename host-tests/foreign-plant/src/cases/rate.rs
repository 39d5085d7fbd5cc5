//! Cases of functions of the ramp. Their runs have ramps of several speeds.

use crate::case::{Case, Effect};
use crate::chamber::Program::{self, Brisk, SawSweep, SetpointWalk, ShrinkingLoops, TwoSpeed};
use crate::physics::{rate as form, Form};
use crate::truth::Class::{self, Rate};

fn case(name: &str, description: &str, programs: (Program, Program)) -> Case {
    Case::new("rate", name, description).programs(programs.0, programs.1)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Rate, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("rate-saturating", "dT/dt saturates.", (TwoSpeed, SetpointWalk))
            .with(effect("saturating", form::saturating)),
        case("rate-heating-push", "A saturating push in heating, nothing in cooling.", (SetpointWalk, TwoSpeed))
            .with(effect("heating push", form::heating_push).or(&[Class::Hysteresis])),
        case("rate-cooling-above", "Cooling above a least ramp only.", (TwoSpeed, ShrinkingLoops))
            .with(effect("cooling above", form::cooling_above)),
        case("rate-dead-zone", "A dead zone on both sides.", (TwoSpeed, SetpointWalk))
            .with(effect("dead zone", form::dead_zone)),
        case("rate-root", "A root of dT/dt, on x and y.", (SetpointWalk, SawSweep))
            .with(effect("root", form::root).floors([3.0, 3.0, 0.0])),
        case("rate-even-root", "|dT/dt| to a power below one.", (SetpointWalk, TwoSpeed))
            .with(effect("even root", form::even_root)),
        case("rate-within-a-band", "dT/dt counts within a band of temperature.", (TwoSpeed, SetpointWalk))
            .with(effect("within a band", form::within_a_band)),
        case("rate-times-t-squared", "r T^2.", (SawSweep, SetpointWalk)).with(effect("r T^2", form::times_t_squared)),
        case("rate-times-exponential", "r times a steep exponential of temperature.", (SetpointWalk, TwoSpeed))
            .with(effect("r exp T", form::times_exponential)),
        case("rate-window", "A window of ramps in which a joint sticks and slips.", (SetpointWalk, TwoSpeed))
            .with(effect("window", form::window)),
        case("rate-two-slopes", "Another slope over temperature in heating than in cooling.", (SawSweep, SetpointWalk))
            .with(effect("two slopes", form::two_slopes).or(&[Class::Hysteresis])),
        case("rate-steep-power", "An odd power of 2.3 to 3, on y only.", (Brisk, TwoSpeed))
            .with(effect("steep power", form::steep_power).floors([0.0, 3.0, 0.0])),
        case("rate-acceleration", "The slope of the ramp: d2T/dt2.", (SetpointWalk, TwoSpeed))
            .with(effect("d2T/dt2", form::acceleration).or(&[Class::Memory])),
        case("rate-small", "Saturating dT/dt of one floor.", (TwoSpeed, SetpointWalk))
            .with(effect("saturating", form::saturating).floors([1.0; 3])),
    ]
}
