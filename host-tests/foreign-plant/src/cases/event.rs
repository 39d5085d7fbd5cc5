//! Cases of events. A unit cannot take any of them off. If one falls into the train run only, the verify run can still be clean, provided it
//! is kept out of the coefficients.

use crate::case::{Case, Effect, Runs};
use crate::physics::{event as form, Form};
use crate::truth::Class::{self, Event};

fn case(name: &str, description: &str) -> Case {
    Case::new("event", name, description)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Event, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("event-step", "One step in the train run.").with(effect("step", form::step).only(Runs::Train)),
        case("event-step-one-axis", "One step of 1.5 floors in the train run, on y only.")
            .with(effect("step", form::step).floors([0.0, 1.5, 0.0]).only(Runs::Train)),
        case("event-step-later", "One step, in the verify run only.")
            .with(effect("step", form::step).only(Runs::Verify).or(&[Class::None])),
        case("event-there-and-back", "Up and back down in the train run, on x and z.")
            .with(effect("there and back", form::there_and_back).floors([3.0, 0.0, 2.0]).only(Runs::Train)),
        case("event-shock", "A shock that relaxes, in the train run.")
            .with(effect("shock", form::shock).only(Runs::Train)),
        case("event-bursts", "Bursts of some minutes, in both runs, at other times.")
            .with(effect("bursts", form::bursts).floors([1.5; 3])),
        case("event-telegraph", "Telegraph noise in both runs.").with(effect("telegraph", form::telegraph)),
        case("event-periodic", "A period of half an hour or so in both runs, of another phase.")
            .with(effect("periodic", form::periodic).floors([2.0; 3])),
        case("event-drifting-period", "A period that drifts, in both runs.")
            .with(effect("drifting period", form::drifting_period).floors([2.0; 3])),
        case("event-creaks", "Disturbances as the temperature passes three marks, in the train run only.").with(
            effect("creaks", form::creaks).floors([1.5; 3]).only(Runs::Train).or(&[Class::Shape, Class::Hysteresis]),
        ),
        case("event-slow-bump", "A slow bump of an hour in the train run.")
            .with(effect("slow bump", form::slow_bump).only(Runs::Train)),
        case("event-slips", "Seven steps of random height, in both runs.").with(effect("slips", form::slips)),
    ]
}
