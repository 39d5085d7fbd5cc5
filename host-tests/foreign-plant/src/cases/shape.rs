//! Cases of curves of temperature.

use crate::case::{Case, Effect};
use crate::physics::{shape as form, Form};
use crate::truth::Class::Shape;

fn case(name: &str, description: &str) -> Case {
    Case::new("shape", name, description)
}

fn effect(name: &'static str, form: Form) -> Effect {
    Effect::bias(Shape, name, form)
}

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("shape-ripple-short", "Interference with a period of 5.5 to 9 C.")
            .with(effect("short ripple", form::ripple_short)),
        case("shape-ripple-long", "Interference with a period of 14 to 20 C, another on each axis.")
            .with(effect("long ripple", form::ripple_long)),
        case("shape-ripple-chirped", "Interference whose period grows with temperature.")
            .with(effect("chirped ripple", form::ripple_chirped)),
        case("shape-smooth-step", "A smooth step.").with(effect("smooth step", form::smooth_step)),
        case("shape-bumps", "A bump in the cold and one in the warm, on x and z.")
            .with(effect("bumps", form::bumps).floors([3.0, 0.0, 3.0])),
        case("shape-hinges", "Two hinges.").with(effect("hinges", form::hinges)),
        case("shape-hot-exponential", "A steep exponential at the hot end.")
            .with(effect("hot exponential", form::hot_exponential)),
        case("shape-cold-exponential", "A steep exponential at the cold end.")
            .with(effect("cold exponential", form::cold_exponential)),
        case("shape-spline", "A smooth curve through random knots.").with(effect("spline", form::random_spline)),
        case("shape-resonance", "A resonance that the drive crosses.")
            .with(effect("resonance", form::crossing_resonance)),
        case("shape-table-scallops", "The error of a table with interpolation.")
            .with(effect("scallops", form::table_scallops)),
        case("shape-table-saw", "The error of a table without interpolation.").with(effect("saw", form::table_saw)),
        case("shape-cusp", "A cusp at a neutral temperature.").with(effect("cusp", form::cusp)),
        case("shape-lone-bump", "One wide bump of one floor, on z only.")
            .with(effect("lone bump", form::lone_bump).floors([0.0, 0.0, 1.0])),
        case("shape-large-step", "A smooth step of 6 floors, on x only.")
            .with(effect("smooth step", form::smooth_step).floors([6.0, 0.0, 0.0])),
    ]
}
