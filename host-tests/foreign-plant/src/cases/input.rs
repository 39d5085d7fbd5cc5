//! Cases of recorded quantities, which a unit takes as inputs.

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
        case(
            "input-loss-anisotropy",
            "Losses by bulk, gas and stem; their anisotropy is in the rate, the drive shows them behind its loop.",
        )
        .with(
            effect("anisotropy of the loss", form::loss_anisotropy)
                .beside(&[Class::Memory, Class::Shape])
                .floors([4.0; 3]),
        )
        .layout(|l| l.losses = true),
        case(
            "input-quadrature-leak",
            "A frequency split that creeps; its nulling force leaks into the rate by a phase error of the board.",
        )
        .with(
            effect("leak of the quadrature", form::quadrature_leak)
                .beside(&[Class::Memory, Class::Shape])
                .floors([4.0; 3]),
        )
        .layout(|l| l.losses = true),
        case("input-loss-and-quadrature", "Both of them.")
            .with(
                effect("anisotropy of the loss", form::loss_anisotropy)
                    .beside(&[Class::Memory, Class::Shape])
                    .floors([3.0; 3]),
            )
            .with(
                effect("leak of the quadrature", form::quadrature_leak)
                    .beside(&[Class::Memory, Class::Shape])
                    .floors([3.0; 3]),
            )
            .layout(|l| l.losses = true),
        case("input-drive-times-quad", "The drive times the quadrature voltage.")
            .with(effect("drive times quadrature", form::drive_times_quad)),
    ]
}
