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

/// Registers that stand still once the unit runs, and a bit of each: where it changes, nothing else would notice for most of them.
const STANDING: [(&str, u32, u32); 18] = [
    ("GPIOA MODER: the link's output is an input", 0x4002_0000, 19),
    ("GPIOA AFRH: the link's output is none of the USART", 0x4002_0024, 4),
    ("GPIOB PUPDR: the data-ready line is not pulled down", 0x4002_040C, 5),
    ("GPIOC MODER: the pulse per second is no timer's input", 0x4002_0800, 13),
    ("RCC CFGR: slower APB1", 0x4002_3808, 10),
    ("RCC AHB1ENR: no clock of GPIOC", 0x4002_3830, 2),
    ("RCC APB1ENR: no clock of TIM3", 0x4002_3840, 1),
    ("TIM2 DIER: no interrupt of data-ready", 0x4000_000C, 4),
    ("TIM2 CCMR2: another input", 0x4000_001C, 8),
    ("TIM2 CCER: no capture of x", 0x4000_0020, 0),
    ("TIM3 CCER: no pulse per second", 0x4000_0420, 0),
    ("DMA1 S5CR: the ring of x does not go round", 0x4002_6088, 8),
    ("DMA2 S5CR: commands are not received", 0x4002_6488, 0),
    ("USART1 BRR: another rate", 0x4001_1008, 3),
    ("USART1 CR1: no sender", 0x4001_100C, 3),
    ("USART1 CR3: half duplex", 0x4001_1014, 3),
    ("NVIC ISER0: an interrupt that nobody handles", 0xE000_E100, 30),
    ("NVIC IPR: TIM2 above or below others", 0xE000_E41C, 5),
];

#[test]
fn a_setting_of_a_peripheral_that_changes_has_the_unit_start_anew() {
    let mut board = SCENE.settled().expect("settles");
    let start = board.snapshot().expect("kept");
    for (what, address, bit) in STANDING {
        board.restore(&start).expect("back");
        board.flip_register(address, bit).unwrap_or_else(|e| panic!("{what}: {e}"));
        let from = board.now();
        let stop = board.run_until(from + CPU_HZ).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(stop, Stop::Watchdog, "{what}");
        assert!(board.now() - from < 7 * CPU_HZ / 10, "{what}");
    }
}
