//! The supply, the option bytes and the watchdog's oscillator: the unit says how they are.

use hrg_board::replay::{default_elf, read_elf};
use hrg_board::wires::Wires;
use hrg_core::link::{Identity, Message};
use hrg_core::option_bytes::{FLYING, SHIPPED};
use hrg_core::status::UnitStatus;
use hrg_study::faults::Scene;
use std::sync::LazyLock;
use virtual_board::{Board, Stop, CPU_HZ};

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    Scene::new(&elf, 1).expect("a scene")
});

fn board() -> Board<Wires> {
    SCENE.off(SCENE.wires(), &SCENE.calibration).expect("runs")
}

/// Frames of so many tenths of a second from now on: how many there are, and how many have a flag.
fn flagged(board: &mut Board<Wires>, tenths: u64, flag: UnitStatus) -> (usize, usize) {
    board.world.received.rates.clear();
    assert_eq!(board.run_until(board.now() + tenths * CPU_HZ / 10).expect("runs"), Stop::Time);
    let frames = &board.world.received.rates;
    (frames.len(), frames.iter().filter(|f| f.unit_status.contains(flag)).count())
}

#[test]
fn a_low_supply_is_flagged_while_it_is_low() {
    let mut board = board();
    board.run_until(3 * CPU_HZ).expect("runs");
    let supply = UnitStatus::SUPPLY;
    assert_eq!(flagged(&mut board, 10, supply).1, 0);
    // 2.6 V: above the chip's own reset as shipped, below what 180 MHz need.
    board.sag(7);
    flagged(&mut board, 2, supply);
    let (all, low) = flagged(&mut board, 20, supply);
    assert!(all > 390 && low == all, "{low} of {all}");
    board.sag(0);
    flagged(&mut board, 2, supply);
    let (all, low) = flagged(&mut board, 20, supply);
    assert!(all > 390 && low == 0, "{low} of {all}");
    let told = board.world.received.housekeeping.iter().filter(|h| h.unit_status.contains(supply)).count();
    assert!((2..=3).contains(&told), "{told}");
}

/// The unit's identity, and its log.
fn identity(board: &mut Board<Wires>) -> Identity {
    board.world.hear(&Message::Identify.encode());
    board.poll_link();
    board.run_until(board.now() + CPU_HZ).expect("runs");
    let mut others = board.world.received.other.iter();
    others.find_map(|m| if let Message::Identity(i) = m { Some(*i) } else { None }).expect("it answers")
}

#[test]
fn identity_has_the_option_bytes_and_a_watchdog_without_its_oscillator_is_flagged() {
    for options in [SHIPPED, FLYING] {
        let mut board = board();
        board.set_options(options);
        board.run_until(2 * CPU_HZ).expect("runs");
        assert_eq!(identity(&mut board).option_bytes, options);
        assert_eq!(flagged(&mut board, 10, UnitStatus::WATCHDOG).1, 0);
    }
    let mut board = board();
    board.set_lsi(0);
    board.run_until(3 * CPU_HZ).expect("runs");
    let (all, dead) = flagged(&mut board, 10, UnitStatus::WATCHDOG);
    assert!(all > 190 && dead == all, "{dead} of {all}");
}
