//! The firmware that wants signed calibrations and has a battery, on the virtual board. Its key is that of `host-tests/keys`.

use hrg::unit::keys;
use hrg::unit::program::of_elf;
use hrg_board::host::{maintain, running, send_program, Program, Sent};
use hrg_board::replay::{self, CALIBRATION_A};
use hrg_board::wires::Wires;
use hrg_core::align_mode::Command as Align;
use hrg_core::calibration::Calibration;
use hrg_core::link::Message;
use hrg_core::maintenance::{burn, Answer};
use hrg_core::slots::ADDRESSES;
use hrg_core::status::UnitStatus;
use hrg_study::faults::Scene;
use std::path::Path;
use virtual_board::{Board, CPU_HZ};

/// `cargo xtask test` builds it, as `cargo xtask size --signed` does.
fn elf() -> Vec<u8> {
    let usual = replay::default_elf();
    let target = usual.ancestors().nth(3).expect("a folder of builds");
    let elf = target.join("signed").join(usual.strip_prefix(target).expect("lies there"));
    replay::read_elf(&elf).expect("cargo xtask size --signed builds it")
}

fn signed(image: &Calibration) -> Vec<u8> {
    let key = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/keys/test.key"));
    keys::sign(&image.to_bytes().expect("fits"), &keys::load(key).expect("a key"))
}

fn numbered(scene: &Scene, above: u32) -> Calibration {
    Calibration { sequence: scene.calibration.sequence + above, ..scene.calibration.clone() }
}

/// Sends bytes as an image; gives the last answer.
fn send(board: &mut Board<Wires>, image: &Calibration, bytes: &[u8]) -> Answer {
    let mut last = Answer::Done;
    for command in burn(image.unit, bytes) {
        last = maintain(board, command).expect("answers").expect("nothing stops it");
        if last != Answer::Done {
            break;
        }
    }
    last
}

/// A unit with a signed image that has just started.
fn unit(scene: &Scene) -> Board<Wires> {
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("starts");
    board.write_flash(CALIBRATION_A, &signed(&scene.calibration)).expect("flash");
    board
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_unit_with_a_key_runs_what_its_owner_has_signed_and_nothing_else() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    // Unsigned, as the debug port may leave it.
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("starts");
    assert_eq!(running(&mut board, 1.0).expect("answers").calibration, 0);
    board.run_until(2 * CPU_HZ).expect("runs");
    let last = board.world.received.rates.last().expect("rates");
    assert_eq!(last.unit_status, UnitStatus::IMAGE_REFUSED | UnitStatus::DEFAULT_CALIBRATION);

    let mut board = unit(&scene);
    assert_eq!(running(&mut board, 1.0).expect("answers").calibration, scene.calibration.checksum());
    let next = numbered(&scene, 1);
    let bytes = next.to_bytes().expect("fits");
    let mut changed = signed(&next);
    changed[bytes.len() + 40] ^= 1;
    for coming in [&bytes[..], &changed] {
        assert_eq!(send(&mut board, &next, coming), Answer::Signature);
    }
    assert_eq!(send(&mut board, &scene.calibration, &signed(&scene.calibration)), Answer::NotNewer, "replayed");
    board.power_cut().expect("starts");
    assert_eq!(running(&mut board, 1.0).expect("answers").calibration, scene.calibration.checksum());
    assert_eq!(send(&mut board, &next, &signed(&next)), Answer::Done);
    board.power_cut().expect("starts");
    assert_eq!(running(&mut board, 1.0).expect("answers").calibration, next.checksum());
    board.run_until(board.now() + 2 * CPU_HZ).expect("runs");
    assert!(board.world.received.rates.last().is_some_and(|r| r.unit_status.is_empty()));
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn an_alignment_is_accepted_in_maintenance_mode_only() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = unit(&scene);
    board.run_until(3 * CPU_HZ).expect("runs");
    board.world.hear(&Message::Align(Align::Accept).encode());
    board.poll_link();
    board.run_until(6 * CPU_HZ).expect("runs");
    let h = &board.world.received.housekeeping;
    let flagged = h.iter().filter(|h| h.unit_status.contains(UnitStatus::LINK_ERRORS)).count();
    assert_eq!((h.last().expect("some").link_errors, flagged), (1, 1));
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_check_costs_a_start_what_is_documented() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let usual = Scene::new(&replay::read_elf(&replay::default_elf()).expect("built before"), 1).expect("a scene");
    let mut without = unit(&usual);
    running(&mut without, 1.0).expect("answers");
    let mut board = unit(&scene);
    running(&mut board, 1.0).expect("answers");
    let (stack, stack_without) = (board.stack_used(), without.stack_used());
    // (All that a start with a check does more; the time driver's interrupt may come into the check.)
    let at_start = board.instructions() - without.instructions();
    let next = numbered(&scene, 1);
    let begun = board.now();
    assert_eq!(send(&mut board, &next, &signed(&next)), Answer::Done);
    let burn_s = (board.now() - begun) as f64 / CPU_HZ as f64;
    println!(
        "a check of an image of {} bytes: {at_start} instructions; stack of a start {stack} bytes, {stack_without} without the feature; a signed burn but for its restart: {burn_s:.2} s",
        next.to_bytes().expect("fits").len(),
    );
    // Measured, and a tenth on top.
    assert!((3_000_000..4_217_000).contains(&at_start), "{at_start}");
    assert!(stack < 54_700, "{stack} bytes of stack");
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_unit_with_a_key_takes_programs_that_its_owner_has_signed() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = unit(&scene);
    board.run_until(2 * CPU_HZ).expect("runs");
    let body =
        of_elf(&replay::read_elf(&replay::elf_for_slot_b()).expect("built"), ADDRESSES[1]).expect("linked for B");
    let key = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/keys/test.key"));
    let sign = |body: &[u8]| -> [u8; 64] {
        let with = keys::sign(body, &keys::load(key).expect("a key"));
        *with.last_chunk().expect("behind it")
    };
    let good = sign(&body);
    let mut torn = good;
    torn[40] ^= 1;
    let mut other = body.clone();
    other[5000] ^= 1;
    let unit = scene.calibration.unit;
    let send = |board: &mut Board<Wires>, body: &[u8], signature| {
        let program = Program { body: body.to_vec(), signature };
        send_program(board, unit, &program, |_, _| Ok(())).expect("answers")
    };
    for (bytes, signature) in [(&body, [0; 64]), (&body, torn), (&other, good)] {
        assert_eq!(send(&mut board, bytes, signature), Sent::Refused(Answer::Signature));
    }
    let begun = board.now();
    assert_eq!(send(&mut board, &body, good), Sent::Committed);
    println!("an update with its check: {:.1} s", (board.now() - begun) as f64 / CPU_HZ as f64);
    assert!(board.stack_used() < 54_700, "{}", board.stack_used());
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_battery_carries_the_states_over_a_short_power_cut_and_no_longer() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let known = |battery: bool, off_s: f64| {
        let wires = scene.wires();
        let mut board = Board::new(&elf(), wires).expect("runs");
        if battery {
            board.fit_battery();
        }
        board.write_flash(CALIBRATION_A, &signed(&scene.calibration)).expect("in flash");
        // The scene's kept states: a unit that has been on for hours.
        board.run_until(CPU_HZ / 10).expect("runs");
        scene.keep(&mut board).expect("kept");
        board.reset_by_software().expect("restarts");
        board.run_until(30 * CPU_HZ).expect("runs");
        let on = board.world.received.housekeeping.last().expect("some").on_for_s;
        assert!(on > 9000.0, "{on}");
        board.power_off((off_s * CPU_HZ as f64) as u64).expect("restarts");
        board.world.received = Default::default();
        let until = board.now() + 3 * CPU_HZ;
        board.run_until(until).expect("runs");
        let h = board.world.received.housekeeping.last().expect("some");
        let unknown = h.axis_status[0].contains(hrg_core::status::AxisStatus::HISTORY_UNKNOWN);
        assert_eq!(unknown, h.on_for_s < 100.0, "{} s", h.on_for_s);
        !unknown
    };
    assert!(known(true, 0.5));
    assert!(known(true, 3.5));
    assert!(!known(true, 20.0), "too long ago");
    assert!(!known(false, 0.5), "no battery");
}
