//! Clean units: nothing is there to be found, under every kind of noise.

use crate::case::{run, Case};
use crate::chamber::Program;
use crate::draw::stream;
use crate::generate::Generated;
use crate::noise::Noise;
use crate::series::Series;
use crate::truth::Class;
use rand::Rng;
use std::sync::Arc;

/// A clean unit under one kind of noise: equation 7, the unit's constants, and noise. One unit in three has a second train run on another
/// day.
#[must_use]
pub fn clean(seed: u64, noise: &Noise) -> Generated {
    clean_case(seed, noise).generate(seed)
}

/// The case behind [`clean`].
#[must_use]
pub fn clean_case(seed: u64, noise: &Noise) -> Case {
    let name = format!("clean-{}", noise.name());
    let mut rng = stream(seed, &["clean", &name]);
    let programs = [
        Program::Cycles,
        Program::Stairs,
        Program::TwoSpeed,
        Program::SetpointWalk,
        Program::ShrinkingLoops,
        Program::SawSweep,
        Program::Soaks,
    ];
    let mut any = || programs[rng.random_range(0..programs.len())];
    let (train, verify, second) = (any(), any(), any());
    let mut case =
        Case::new("clean", &name, "Equation 7 and noise, no effect.").noise(noise.clone()).programs(train, verify);
    if rng.random_bool(1.0 / 3.0) {
        case = case.and_train(run(second, 7.0));
    }
    if matches!(noise, Noise::Lines | Noise::Series(_)) {
        // A line is a period; a measured spectrum may hold one.
        case = case.also(Class::Event);
    }
    case
}

/// The noise of control number `index`. With `series` each third control has a measured spectrum; without, a third have the kinds that
/// resemble measured ones most: random walk, lines, flicker.
#[must_use]
pub fn control_noise(index: usize, series: &[Arc<Series>]) -> Noise {
    let turn = index / 3;
    if index % 3 == 2 {
        if !series.is_empty() {
            return Noise::Series(series[turn % series.len()].clone());
        }
        return [Noise::Walk, Noise::Lines, Noise::Flicker(1.4), Noise::Flicker(1.0)][turn % 4].clone();
    }
    let kinds = [
        Noise::Usual,
        Noise::White,
        Noise::Flicker(0.8),
        Noise::Flicker(1.0),
        Noise::Flicker(1.2),
        Noise::Flicker(1.4),
        Noise::Walk,
        Noise::Lines,
        Noise::GaussMarkov,
        Noise::GrowsWithTemperature,
        Noise::HeavyTails,
        Noise::Bursts,
    ];
    kinds[(turn * 2 + index % 3) % kinds.len()].clone()
}
