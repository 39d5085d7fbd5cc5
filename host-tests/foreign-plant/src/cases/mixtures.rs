//! Mixtures of two or three classes.

use crate::case::{Case, Effect, Runs};
use crate::chamber::Program::{SawSweep, SetpointWalk, TwoSpeed};
use crate::physics::{event, hysteresis, input, memory, power_on, rate, shape};
use crate::truth::Class::{self, Event, Hysteresis, Input, Memory, PowerOn, Rate, Shape};

fn case(name: &str, description: &str) -> Case {
    Case::new("mixture", name, description)
}

pub(super) fn cases() -> Vec<Case> {
    [of_two(), of_three()].concat()
}

fn of_two() -> Vec<Case> {
    vec![
        case("mix-plays-stretched", "Three plays and a stretched exponential from power-on.")
            .with(Effect::bias(Hysteresis, "three plays", hysteresis::three_plays))
            .with(Effect::bias(PowerOn, "stretched exponential", power_on::stretched)),
        case("mix-rod-ripple", "The far end of a rod, and interference over temperature.")
            .with(Effect::bias(Memory, "rod", memory::rod))
            .with(Effect::bias(Shape, "long ripple", shape::ripple_long)),
        case("mix-saturating-hinges", "Saturating dT/dt and two hinges.")
            .with(Effect::bias(Rate, "saturating", rate::saturating))
            .with(Effect::bias(Shape, "hinges", shape::hinges))
            .programs(TwoSpeed, SetpointWalk),
        case("mix-asymmetric-bouc-wen", "A body that warms fast and cools slowly, and Bouc and Wen's loop.")
            .with(Effect::bias(Memory, "asymmetric", memory::asymmetric).beside(&[Rate]))
            .with(Effect::bias(Hysteresis, "Bouc-Wen", hysteresis::bouc_wen_loop).floors([2.0; 3])),
        case("mix-logarithm-two-poles", "A logarithm from power-on and a body behind two poles.")
            .with(Effect::bias(PowerOn, "logarithm", power_on::logarithm))
            .with(Effect::bias(Memory, "two poles", memory::two_poles))
            .programs(SetpointWalk, TwoSpeed),
        case("mix-step-spline", "One step in the train run, and a smooth curve of temperature.")
            .with(Effect::bias(Shape, "spline", shape::random_spline))
            .with(Effect::bias(Event, "step", event::step).only(Runs::Train).floors([2.0; 3])),
        case("mix-supply-soft-relays", "The supply, late, and soft relays.")
            .with(Effect::bias(Hysteresis, "soft relays", hysteresis::soft_relays).beside(&[Shape]))
            .with(Effect::bias(Input, "supply, late", input::supply_late).floors([2.0; 3]))
            .layout(|l| l.electrics = true),
        case("mix-one-axis-each", "A rod on x, two thresholds on y, interference on z.")
            .with(Effect::bias(Memory, "rod", memory::rod).floors([3.0, 0.0, 0.0]))
            .with(
                Effect::bias(Hysteresis, "two thresholds", hysteresis::two_thresholds)
                    .beside(&[Shape])
                    .floors([0.0, 3.0, 0.0]),
            )
            .with(Effect::bias(Shape, "short ripple", shape::ripple_short).floors([0.0, 0.0, 3.0])),
    ]
}

fn of_three() -> Vec<Case> {
    vec![
        case("mix-rod-plays-stretched", "The far end of a rod, three plays and a stretched exponential.")
            .with(Effect::bias(Memory, "rod", memory::rod))
            .with(Effect::bias(Hysteresis, "three plays", hysteresis::three_plays).floors([2.0; 3]))
            .with(Effect::bias(PowerOn, "stretched exponential", power_on::stretched).floors([2.0; 3])),
        case("mix-band-step-log-normal", "dT/dt within a band, a smooth step, a spectrum of time constants.")
            .with(Effect::bias(Rate, "within a band", rate::within_a_band).floors([2.0; 3]))
            .with(Effect::bias(Shape, "smooth step", shape::smooth_step).floors([2.0; 3]))
            .with(Effect::bias(Memory, "log-normal spectrum", memory::log_normal).floors([3.0; 3]))
            .programs(SawSweep, SetpointWalk),
        case("mix-small-three", "A lag, a play that grows and a bump, each of one floor.")
            .with(Effect::bias(Memory, "one pole", memory::one_pole).floors([1.0; 3]))
            .with(Effect::bias(Hysteresis, "growing gain", hysteresis::growing_gain).floors([1.0; 3]))
            .with(Effect::bias(Shape, "lone bump", shape::lone_bump).floors([1.0; 3])),
        case("mix-telegraph-preisach-two-exponentials", "Telegraph noise on Preisach's loops and two exponentials.")
            .with(Effect::bias(Hysteresis, "Preisach, smooth", hysteresis::preisach_smooth).beside(&[Shape]))
            .with(Effect::bias(PowerOn, "two exponentials", power_on::two_exponentials).floors([2.0; 3]))
            .with(Effect::bias(Event, "telegraph", event::telegraph).floors([1.0; 3]).or(&[Class::None])),
    ]
}
