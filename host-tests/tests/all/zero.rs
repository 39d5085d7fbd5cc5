//! Constants renewed in the field, on the ELF: taken in maintenance mode, kept over power cuts, tied to their image, bounded, taken back.

use hrg_board::host::maintain;
use hrg_board::replay::{self, read_elf, CALIBRATION_A};
use hrg_board::wires::Wires;
use hrg_core::calibration::Calibration;
use hrg_core::maintenance::{Answer, Command};
use hrg_core::zero::Zero;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use std::path::Path;
use virtual_board::{Board, CPU_HZ};

/// Biases and uncertainties of the last second, after so many.
fn after(board: &mut Board<Wires>, seconds: u64) -> ([f32; 3], [f32; 3]) {
    board.world.received.housekeeping.clear();
    board.run_until(board.now() + seconds * CPU_HZ).expect("runs");
    let h = board.world.received.housekeeping.last().expect("there are");
    (h.bias_dph, h.bias_std_dph)
}

#[test]
fn renewed_constants_hold_over_power_cuts_under_their_image_and_are_taken_back() {
    let elf = read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/simulated-ramp.csv"));
    let steps = Steps::new(&Recording::load(path).expect("usable")).expect("long enough");
    let mut image = Calibration::uncalibrated();
    image.set_unit_name("SIM-11");
    image.calibrated = true;
    image.sequence = 3;
    image.axes.iter_mut().for_each(|a| a.uncertainty.rest_dph2 = 0.01);
    let mut board = Board::new(&elf, Wires::new(steps, [0.01; 3], 0.0, 1, None, None).live()).expect("runs");
    board.write_flash(CALIBRATION_A, &image.to_bytes().expect("fits")).expect("in flash");
    assert_eq!(after(&mut board, 3), ([0.0; 3], [0.1; 3]));
    let zero = Zero { made_unix_s: 1_764_000_000, constant_dph: [0.5, -1.25, 3.0], std_dph: [0.0, 0.25, 0.5] };
    let ask = |board: &mut Board<Wires>, command| maintain(board, command).expect("answers");
    let closed = ask(&mut board, Command::Zero(zero));
    assert_eq!(closed, Some(Answer::NotOpen));
    assert_eq!(ask(&mut board, Command::Open(image.unit)), Some(Answer::Done));
    let much = Zero { constant_dph: [0.0, 0.0, 10.5], ..zero };
    assert_eq!(ask(&mut board, Command::Zero(much)), Some(Answer::Bound));
    assert_eq!(ask(&mut board, Command::Zero(zero)), Some(Answer::Done));
    let stds = [0.01f32.sqrt(), (0.01f32 + 0.0625).sqrt(), (0.01f32 + 0.25).sqrt()];
    let near = |(bias, std): ([f32; 3], [f32; 3])| {
        assert_eq!(bias, zero.constant_dph);
        assert!(std.iter().zip(stds).all(|(a, b)| (a - b).abs() < 1e-6), "{std:?} {stds:?}");
    };
    near(after(&mut board, 3));
    // Over a power cut, and one in the middle of a second set, the first holds.
    board.power_cut().expect("restarts");
    near(after(&mut board, 3));
    // Under another image it does not.
    let mut other = image.clone();
    other.sequence = 4;
    hrg_board::host::burn(&mut board, &other).expect("burnt");
    assert_eq!(after(&mut board, 3).0, [0.0; 3]);
    // Set again and taken back.
    assert_eq!(ask(&mut board, Command::Open(image.unit)), Some(Answer::Done));
    assert_eq!(ask(&mut board, Command::Zero(zero)), Some(Answer::Done));
    near(after(&mut board, 2));
    assert_eq!(ask(&mut board, Command::Zero(Zero { made_unix_s: 5, ..Zero::default() })), Some(Answer::Done));
    assert_eq!(after(&mut board, 2).0, [0.0; 3]);
    board.power_cut().expect("restarts");
    assert_eq!(after(&mut board, 3).0, [0.0; 3]);
}
