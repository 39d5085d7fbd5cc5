//! Cases of memory of the path.

use crate::case::{Case, Effect};
use crate::chamber::Program;
use crate::physics::{hysteresis as form, Form};
use crate::truth::Class::{self, Hysteresis};

fn case(name: &str, description: &str) -> Case {
    Case::new("hysteresis", name, description)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Hysteresis, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("hysteresis-three-plays", "A small, a middle and a large play.")
            .with(effect("three plays", form::three_plays)),
        case("hysteresis-crossing-plays", "Two plays of opposite sign: the loop crosses itself.")
            .with(effect("crossing plays", form::crossing_plays)),
        case("hysteresis-preisach-smooth", "Preisach's plane with a smooth density.")
            .with(effect("Preisach, smooth", form::preisach_smooth).beside(&[Class::Shape])),
        case("hysteresis-preisach-coarse", "Twelve relays of unlike weight: steps are visible.")
            .with(effect("Preisach, coarse", form::preisach_coarse).beside(&[Class::Shape])),
        case("hysteresis-soft-relays", "Smooth steps that are taken later on the way back.")
            .with(effect("soft relays", form::soft_relays).beside(&[Class::Shape])),
        case("hysteresis-bouc-wen", "Bouc and Wen's model.").with(effect("Bouc-Wen", form::bouc_wen_loop)),
        case("hysteresis-duhem", "Duhem's form about a saturating curve.")
            .with(effect("Duhem", form::duhem_loop).beside(&[Class::Shape])),
        case("hysteresis-dahl", "Dry friction after Dahl, on z only.")
            .with(effect("Dahl", form::dahl_friction).floors([0.0, 0.0, 3.0])),
        case("hysteresis-growing-gain", "A play whose share grows with temperature.")
            .with(effect("growing gain", form::growing_gain)),
        case("hysteresis-growing-width", "A play whose width grows with temperature.")
            .with(effect("growing width", form::growing_width)),
        case("hysteresis-two-thresholds", "A contact that closes at one temperature and opens at another.")
            .with(effect("two thresholds", form::two_thresholds).beside(&[Class::Shape])),
        case("hysteresis-two-contacts", "Two contacts, on x and y.")
            .with(effect("two contacts", form::two_contacts).beside(&[Class::Shape]).floors([3.0, 2.5, 0.0]))
            .programs(Program::SetpointWalk, Program::SawSweep),
        case("hysteresis-butterfly", "Butterfly loops.")
            .with(effect("butterfly", form::butterfly).beside(&[Class::Shape])),
        case("hysteresis-extremes", "The hottest and the coldest since power-on.")
            .with(effect("extremes", form::extremes).beside(&[Class::Shape]).or(&[Class::PowerOn]))
            .programs(Program::SetpointWalk, Program::Stairs),
        case("hysteresis-slow-body", "A play on a body slower than the resonator.")
            .with(effect("play on a slow body", form::play_on_slow_body).or(&[Class::Memory])),
        case("hysteresis-minor-loops", "Three plays, trained on full ramps, verified on shrinking loops.")
            .with(effect("three plays", form::three_plays).floors([4.0; 3]))
            .programs(Program::Cycles, Program::ShrinkingLoops),
        case("hysteresis-small", "Soft relays of one floor.")
            .with(effect("soft relays", form::soft_relays).beside(&[Class::Shape]).floors([1.0; 3])),
    ]
}
