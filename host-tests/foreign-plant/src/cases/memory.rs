//! Cases of thermal memory.

use crate::case::{Case, Effect};
use crate::chamber::Program;
use crate::physics::{memory as form, Form};
use crate::truth::Class::{self, Memory};

fn case(name: &str, description: &str) -> Case {
    Case::new("memory", name, description)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Memory, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("memory-two-poles", "The bias follows a body behind two poles.")
            .with(effect("two poles", form::two_poles)),
        case("memory-three-bodies", "Three bodies side by side, the fastest of opposite sign.")
            .with(effect("three bodies", form::three_bodies)),
        case("memory-rod", "The far end of a rod: one-dimensional diffusion.")
            .with(effect("rod", form::rod))
            .programs(Program::SetpointWalk, Program::Cycles),
        case("memory-fractional", "Fractional relaxation of order 0.5 to 0.7.")
            .with(effect("fractional", form::fractional)),
        case("memory-log-normal", "A log-normal spectrum of time constants, on x and z.")
            .with(effect("log-normal spectrum", form::log_normal).floors([3.0, 0.0, 2.5])),
        case("memory-tau-by-axis", "One pole, of 400, 1200 and 3000 s on x, y and z.")
            .with(effect("one pole", form::tau_by_axis)),
        case("memory-heating-only", "Heating alone stirs up a relaxation.")
            .with(effect("heating only", form::heating_only).or(&[Class::Rate])),
        case("memory-cooling-only", "Cooling alone stirs up a relaxation, on y and z.")
            .with(effect("cooling only", form::cooling_only).floors([0.0, 3.0, 3.0]).or(&[Class::Rate])),
        case("memory-creep", "Creep: either direction of ramp stirs the same relaxation.")
            .with(effect("creep after ramps", form::creep_after_ramps).or(&[Class::Rate])),
        case("memory-asymmetric", "A body that warms fast and cools slowly.")
            .with(effect("asymmetric", form::asymmetric).beside(&[Class::Rate])),
        case("memory-arrhenius", "A time constant by Arrhenius' law: slow in the cold.")
            .with(effect("Arrhenius", form::arrhenius).beside(&[Class::Rate])),
        case("memory-gain-by-temperature", "A lag whose gain grows with temperature and changes its sign.")
            .with(effect("gain by temperature", form::gain_by_temperature).beside(&[Class::Rate])),
        case("memory-tau-by-ramp", "A time constant that shrinks while the temperature moves.")
            .with(effect("tau by ramp", form::tau_by_ramp).beside(&[Class::Rate])),
        case("memory-hidden-gradient", "Holder against base plate; neither is recorded.")
            .with(effect("hidden gradient", form::hidden_gradient)),
        case("memory-board-gradient", "Board against base plate, neither recorded: much of it is self-heating.")
            .with(effect("board gradient", form::board_gradient).floors([2.0; 3]).or(&[Class::PowerOn]))
            .layout(|l| l.board = false),
        case("memory-gradient-squared", "The square of a gradient, with its sign.")
            .with(effect("gradient squared", form::gradient_squared).beside(&[Class::Rate])),
        case("memory-underdamped", "An underdamped response of second order.")
            .with(effect("underdamped", form::underdamped)),
        case("memory-dead-time", "The temperature of ten to twenty minutes ago.")
            .with(effect("dead time", form::dead_time)),
        case("memory-neighbour", "The neighbour's resonator, late.").with(effect("neighbour", form::neighbour)),
        case("memory-one-axis-small", "One pole, one floor, on y only.")
            .with(effect("one pole", form::one_pole).floors([0.0, 1.0, 0.0])),
        case("memory-large", "The far end of a rod, 6 floors.")
            .with(effect("rod", form::rod).floors([6.0; 3]))
            .programs(Program::SawSweep, Program::SetpointWalk),
    ]
}
