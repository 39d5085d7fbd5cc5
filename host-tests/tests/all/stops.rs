//! Post-mortem: a unit whose program faults, hangs or overruns its stack says on its next start where and how, by the link and in its log.

use crate::support::{field_log, patched};
use hrg_board::replay::{default_elf, read_elf};
use hrg_board::symbol;
use hrg_board::wires::Wires;
use hrg_core::events::Event;
use hrg_core::link::Message;
use hrg_core::maintenance::Command;
use hrg_core::reset::{Halt, ResetCause};
use hrg_core::stopped::{Silent, Stopped};
use hrg_core::unit_name::UnitName;
use hrg_study::faults::Scene;
use std::sync::LazyLock;
use virtual_board::{Board, Firmware, Stop, CPU_HZ, FLASH_START};

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    Scene::new(&elf, 1).expect("a scene")
});

const COMMAND: &str = "hrg_core::maintenance::Maintenance::command";

/// The program with other code at the start of a function, and that function's address.
fn with_code(function: &str, code: &[u16]) -> (Vec<u8>, u32) {
    let at = Firmware::parse(SCENE.elf()).expect("parses").function(function).expect("is there");
    let put =
        |to: &mut [u8]| to.iter_mut().zip(code.iter().flat_map(|half| half.to_le_bytes())).for_each(|(t, b)| *t = b);
    (patched(SCENE.elf(), at, put), at)
}

/// Runs such a program until it has stopped and started anew; gives what it says then, by the link and in its log, and the function's address.
fn post_mortem(function: &str, code: &[u16]) -> (Stopped, Vec<Stopped>, u32) {
    let (elf, at) = with_code(function, code);
    let scene = Scene::new(&elf, 1).expect("a scene");
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("runs");
    board.run_until(2 * CPU_HZ).expect("runs");
    if function == COMMAND {
        board.world.hear(&Message::Maintain(Command::Open(UnitName::new("HRG-21"))).encode());
        board.poll_link();
    }
    let stop = board.run_until(board.now() + 6 * CPU_HZ).expect("runs");
    assert_eq!(stop, Stop::Watchdog, "{function}");
    board.world.received = hrg_board::wires::Received::default();
    // The unit answers before it stops again.
    let (from, mut told) = (board.now(), None);
    while told.is_none() && board.now() < from + 2 * CPU_HZ {
        board.world.hear(&Message::Identify.encode());
        board.poll_link();
        board.run_until(board.now() + CPU_HZ / 20).expect("runs");
        told = board.world.received.other.iter().find_map(|m| match m {
            Message::Stopped(s) => Some(*s),
            _ => None,
        });
    }
    (told.expect("it says why it has stopped"), logged(&board), at)
}

/// The stops that the log tells.
fn logged(board: &Board<Wires>) -> Vec<Stopped> {
    let mut out: Vec<Stopped> = Vec::new();
    for record in field_log(board) {
        match record.event {
            Event::Start { halt, cause: ResetCause::Watchdog, .. } => out.push(Stopped { halt, ..Stopped::default() }),
            Event::Stopped(piece) => out.last_mut().expect("behind a start").add(piece),
            _ => {}
        }
    }
    out
}

/// The same stop again has its start alone.
fn only_once(logged: &[Stopped]) {
    let bare = |s: &Stopped| Stopped { halt: s.halt, ..Stopped::default() } == *s;
    assert!(logged.iter().skip(1).all(bare), "{logged:?}");
}

const UNDEFINED: [u16; 1] = [0xDE00];
const HANGS: [u16; 1] = [0xE7FE];
/// Reads the word at 0xDEADBEE0.
const NO_SUCH_ADDRESS: [u16; 5] = [0xF64B, 0x60E0, 0xF6CD, 0x60AD, 0x6800];
/// Pushes nine registers for ever.
const PUSHES: [u16; 2] = [0xB5FF, 0xE7FD];

#[test]
fn a_fault_is_told_with_its_place_and_kind() {
    for (function, code, cfsr, address, behind) in [
        (symbol::UPDATE, &UNDEFINED[..], 1 << 16, 0, 0),
        (symbol::SAMPLE, &NO_SUCH_ADDRESS[..], 1 << 9 | 1 << 15, 0xDEAD_BEE0, 8),
    ] {
        let (told, logged, at) = post_mortem(function, code);
        assert_eq!((told.halt, told.pc, told.cfsr, told.hfsr), (Halt::Fault, at + behind, cfsr, 1 << 30), "{told:x?}");
        assert_eq!(told.address, address);
        assert!(told.lr & 1 == 1 && told.lr > FLASH_START, "the caller: {:x}", told.lr);
        assert!((20_000..54_000).contains(&told.stack), "{}", told.stack);
        assert_eq!(logged.first(), Some(&told));
        only_once(&logged);
    }
}

#[test]
fn a_part_that_hangs_is_named_and_so_is_a_stack_that_is_full() {
    for (function, silent) in
        [(symbol::SAMPLE, Silent::RATES), (symbol::UPDATE, Silent::MODEL), (COMMAND, Silent::THREADS)]
    {
        let (told, logged, at) = post_mortem(function, &HANGS);
        assert_eq!((told.halt, told.silent, told.pc), (Halt::None, silent, at), "{function}");
        assert_eq!(logged.first(), Some(&told));
        only_once(&logged);
    }
    let (told, logged, _) = post_mortem(symbol::UPDATE, &PUSHES);
    assert_eq!((told.halt, told.silent), (Halt::Stack, Silent::empty()), "{told:x?}");
    assert_eq!(logged.first(), Some(&told));
    only_once(&logged);
}

#[test]
fn a_unit_that_was_told_to_restart_says_nothing() {
    let mut board = SCENE.off(SCENE.wires(), &SCENE.calibration).expect("runs");
    board.run_until(3 * CPU_HZ).expect("runs");
    board.reset_by_software().expect("restarts");
    board.run_until(board.now() + CPU_HZ).expect("runs");
    board.world.hear(&Message::Identify.encode());
    board.poll_link();
    board.run_until(board.now() + CPU_HZ).expect("runs");
    let told: Vec<&Message> = board.world.received.other.iter().collect();
    assert!(matches!(told[..], [Message::Identity(_), Message::Programs(_)]), "{told:?}");
    assert_eq!(logged(&board), []);
}
