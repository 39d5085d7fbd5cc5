//! Costs of the unit within their bounds, and its numbers near their limits (`cargo xtask bench`).

use hrg_board::{replay, symbol};
use hrg_study::faults::Scene;
use hrg_study::unit_bench as bench;
use virtual_board::CPU_HZ;

#[test]
fn the_units_costs_are_within_their_bounds() {
    let elf = replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let figures = bench::unit(&elf).expect("counts");
    for f in &figures {
        println!("{}: {:.1} {} (bound {})", f.what, f.value, f.unit, f.bound);
    }
    let beyond: Vec<_> = figures.iter().filter(|f| !(0.02 * f.bound..=f.bound).contains(&f.value)).collect();
    assert!(beyond.is_empty(), "over their bounds, or counting nothing: {beyond:#?}");
}

#[test]
fn ours_is_exact_and_cheap_beside_the_alternatives() {
    let elf = replay::read_elf(&replay::default_elf().with_file_name("alternatives")).expect("built with the firmware");
    let ways = bench::ways(&elf).expect("counts");
    let ours = ways.last().expect("there is ours");
    assert!(ours.worst_c < 1e-5, "{ours:?}");
    for w in &ways[..ways.len() - 1] {
        // Cheaper only where the error is a thousand times ours.
        assert!(w.instructions > ours.instructions || w.worst_c > 1000.0 * ours.worst_c, "{w:?} beside {ours:?}");
    }
}

#[test]
fn frequency_and_rate_are_at_their_limits() {
    for l in bench::limits() {
        let ratio = l.reached / l.bound;
        // Without jitter the timer's steps are no noise: the regression averages them better than noise.
        assert!(ratio < 1.1 && (ratio > 0.9 || l.what.ends_with(" 0 ns of jitter")), "{l:?}");
    }
}

#[test]
fn what_is_counted_is_there_to_be_counted() {
    let elf = replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let scene = Scene::new(&elf, 1).expect("a scene");
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("a board");
    let all = [symbol::UPDATE, symbol::BIAS, symbol::CURVE, symbol::DECODE, symbol::SAMPLE, symbol::ENCODE];
    for name in all {
        board.count_calls(name).expect("in the ELF");
    }
    board.run_until(5 * CPU_HZ).expect("runs");
    for (k, name) in all.iter().enumerate() {
        assert!(board.probe(k).and_then(virtual_board::Probe::mean).is_some(), "{name} was never called");
    }
}
