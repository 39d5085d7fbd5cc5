//! A unit that moves takes no maintenance, whatever comes over its link.

use hrg_board::host::{maintain, running};
use hrg_board::replay::{default_elf, read_elf};
use hrg_board::wires::Wires;
use hrg_core::maintenance::{Answer, Command};
use hrg_study::faults::Scene;
use virtual_board::CPU_HZ;

/// Port C and pin 13: the service pin (firmware/src/board.rs).
const SERVICE: (usize, usize) = (2, 13);

#[test]
fn a_unit_that_moves_takes_no_maintenance_unless_its_service_pin_is_low() {
    let scene = Scene::new(&read_elf(&default_elf()).expect("built before"), 1).expect("a scene");
    let mut steps = scene.steps().clone();
    // At rest for 20 s, then it moves for 20 s, then it rests again.
    for (second, rate) in steps.rate_dph[1].iter_mut().enumerate() {
        *rate = if (20..40).contains(&second) { 900.0 * (second as f64).sin() } else { 3.0 };
    }
    let scale = scene.calibration.scale_factors_dph_per_code();
    let mut board = scene.off(Wires::new(steps, scale, 20e-9, 1, None, None), &scene.calibration).expect("runs");
    let unit = scene.calibration.unit;
    let at = |board: &mut virtual_board::Board<Wires>, second: u64| board.run_until(second * CPU_HZ).expect("runs");
    let ask = |board: &mut virtual_board::Board<Wires>, command| maintain(board, command).expect("answers");

    at(&mut board, 15);
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Done), "at rest");
    at(&mut board, 25);
    for command in [Command::Begin(500), Command::Newest, Command::Restart, Command::Program { length: 1000, sum: 0 }] {
        assert_eq!(ask(&mut board, command), Some(Answer::NotOpen), "the mode has ended");
    }
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Moving));
    board.drive_pin(SERVICE.0, SERVICE.1, false);
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Done), "with its service pin low");
    assert_eq!(ask(&mut board, Command::Close), Some(Answer::Done));
    board.drive_pin(SERVICE.0, SERVICE.1, true);
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Moving));
    // A restart does not help: it moved before.
    board.reset_by_software().expect("starts");
    running(&mut board, 1.0).expect("answers");
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Moving), "before it has seen a second");
    at(&mut board, 35);
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Moving));
    at(&mut board, 53);
    assert_eq!(ask(&mut board, Command::Open(unit)), Some(Answer::Done), "at rest for ten seconds");
}

/// A host that takes each moment in which a unit may not know yet that it moves.
#[test]
fn a_unit_that_moves_from_the_start_is_restarted_once_at_most() {
    let scene = Scene::new(&read_elf(&default_elf()).expect("built before"), 1).expect("a scene");
    let mut steps = scene.steps().clone();
    // A steady turn of 2 deg/s.
    steps.rate_dph[2].fill(7200.0);
    let scale = scene.calibration.scale_factors_dph_per_code();
    let mut board = scene.off(Wires::new(steps, scale, 20e-9, 1, None, None), &scene.calibration).expect("runs");
    let unit = scene.calibration.unit;
    let mut opened = 0;
    while board.now() < 30 * CPU_HZ {
        board.run_until(board.now() + CPU_HZ / 10).expect("runs");
        match maintain(&mut board, Command::Open(unit)) {
            Ok(Some(Answer::Done)) => {
                opened += 1;
                let _ = maintain(&mut board, Command::Restart);
            }
            answer => drop(answer),
        }
    }
    assert!(opened <= 1, "{opened} restarts");
    assert!(board.world.received.rates.len() > 29 * 200 - 400, "{} frames", board.world.received.rates.len());
}
