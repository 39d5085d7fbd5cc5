//! Cases of recorded quantities. A unit in flight has none of them, so none of them can be burnt.

use crate::case::{Case, Effect};
use crate::physics::{input as form, Form};
use crate::truth::Class::{self, Input};

fn case(name: &str, description: &str) -> Case {
    Case::new("input", name, description).layout(|l| {
        l.electrics = true;
        l.board = true;
    })
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Input, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("input-drive", "The drive, in proportion, on x only.")
            .with(effect("drive", form::drive).floors([3.0, 0.0, 0.0])),
        case("input-drive-squared", "The drive, squared about a working point.")
            .with(effect("drive squared", form::drive_squared)),
        case("input-quad-times-t", "The quadrature voltage times temperature.")
            .with(effect("quadrature times T", form::quad_times_t)),
        case("input-quad-rectified", "The quadrature voltage, rectified, on y and z.")
            .with(effect("quadrature rectified", form::quad_rectified).floors([0.0, 3.0, 3.0])),
        case("input-supply", "The supply.").with(effect("supply", form::supply).floors([2.0; 3])),
        case("input-supply-late", "The supply behind a lag of 300 to 700 s.")
            .with(effect("supply, late", form::supply_late).floors([4.0; 3])),
        case("input-supply-threshold", "The supply below a threshold: a regulator drops out.")
            .with(effect("supply threshold", form::supply_threshold)),
        case("input-other-axis-drive", "The drive of the neighbouring axis.")
            .with(effect("drive of another axis", form::other_axis_drive)),
        case("input-board-late", "The board against the resonator, late.")
            .with(effect("board, late", form::board_late).or(&[Class::Memory]))
            .layout(|l| l.electrics = false),
        case("input-drive-times-quad", "The drive times the quadrature voltage.")
            .with(effect("drive times quadrature", form::drive_times_quad)),
    ]
}
