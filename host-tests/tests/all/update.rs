//! New programs over the link: what a unit takes, and what it runs afterwards, whatever becomes of the update.

use crate::support::field_log;
use hrg::unit::program::of_elf;
use hrg_board::host::{ask, cycles, maintain, programs, running, send_program, Program, Sent};
use hrg_board::replay::{default_elf, elf_for_slot_b, read_elf};
use hrg_board::wires::Wires;
use hrg_core::events::Event;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command};
use hrg_core::slots::{head, mark, State, ADDRESSES, HEAD};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::update::{Programs, TRIAL_S};
use hrg_study::faults::{good, Scene};
use std::sync::LazyLock;
use virtual_board::{Board, Firmware, Stop, CPU_HZ, FLASH_START};

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    Scene::new(&elf, 1).expect("a scene")
});

/// The program for slot B, as an ELF.
static ELF_B: LazyLock<Vec<u8>> =
    LazyLock::new(|| read_elf(&elf_for_slot_b()).expect("cargo xtask test builds the firmware for slot B, too"));

/// The program for a slot with another version.
fn program(slot: usize, version: u32) -> Vec<u8> {
    let elf = if slot == 0 { SCENE.elf() } else { &ELF_B };
    let mut body = of_elf(elf, ADDRESSES[slot]).expect("linked for it");
    body[head::VERSION - HEAD..][..4].copy_from_slice(&version.to_le_bytes());
    body
}

/// The program for slot B with other code at the start of a function.
fn with_code(function: &str, code: &[u16]) -> Vec<u8> {
    let mut body = program(1, 2_000_000);
    let at = Firmware::parse(&ELF_B).expect("parses").function(function).expect("is there");
    let from = (at - ADDRESSES[1]) as usize - HEAD;
    for (to, half) in body[from..].chunks_exact_mut(2).zip(code) {
        to.copy_from_slice(&half.to_le_bytes());
    }
    body
}

fn unsigned(body: Vec<u8>) -> Program {
    Program { body, signature: [0; 64] }
}

/// A unit that runs the program in slot A.
fn unit() -> Board<Wires> {
    let mut board = SCENE.restarted().expect("runs");
    board.run_until(2 * CPU_HZ).expect("runs");
    board
}

fn send(board: &mut Board<Wires>, program: &Program) -> Sent {
    send_program(board, SCENE.calibration.unit, program, |_, _| Ok(())).expect("answers")
}

/// Restarts the unit and asks each second which program it runs, for so long; a host that talks sends the token back. Gives the last answer, and the longest time
/// without rates, s.
fn after_restart(board: &mut Board<Wires>, seconds: u32, talks: bool) -> (Programs, f64) {
    assert_eq!(maintain(board, Command::Restart).expect("answers"), Some(Answer::Done));
    let end = board.now() + cycles(f64::from(seconds));
    board.world.received.rates.clear();
    board.world.received.rate_at = vec![board.now()];
    let mut last = None;
    while board.now() < end {
        let until = board.now() + CPU_HZ;
        while !matches!(board.run_until(until).expect("runs"), Stop::Time) {}
        if let Ok(told) = programs(board, 0.5) {
            if talks {
                let _ = maintain(board, Command::Echo(told.token));
            }
            last = Some(told);
        }
    }
    let longest = board.world.received.rate_at.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(u64::MAX);
    (last.expect("the unit says which program it runs"), longest as f64 / CPU_HZ as f64)
}

fn last_program(board: &Board<Wires>) -> Option<(u8, u8)> {
    field_log(board).iter().rev().find_map(|r| match r.event {
        Event::Program { slot, state, .. } => Some((slot, state)),
        _ => None,
    })
}

#[test]
fn a_new_program_is_tried_confirms_itself_and_can_be_left_again() {
    let mut board = unit();
    let before = programs(&mut board, 1.0).expect("answers");
    assert_eq!((before.slot, before.state, before.other_state), (0, State::Confirmed as u8, State::Empty as u8));
    let calibration = SCENE.calibration.checksum();

    // Rates go on while it comes, but for the erases of two sectors of 128 KiB.
    let new = unsigned(program(1, 1_002_003));
    board.world.received.rates.clear();
    let begun = board.now();
    assert_eq!(send(&mut board, &new), Sent::Committed);
    let (frames, took) = (board.world.received.rates.len() as f64, (board.now() - begun) as f64 / CPU_HZ as f64);
    println!("{took:.1} s for {} bytes", new.body.len());
    assert!(took < 60.0 && frames > 200.0 * (took - 4.5), "{frames} frames in {took} s");

    let (told, without) = after_restart(&mut board, 6, true);
    assert_eq!((told.slot, told.state, told.version), (1, State::Confirmed as u8, 1_002_003));
    assert!(without < 2.0, "{without} s without rates");
    let last = board.world.received.rates.last().expect("rates");
    assert!(good(last) || last.unit_status.is_empty(), "{last:?}");
    assert_eq!(running(&mut board, 1.0).expect("answers").calibration, calibration, "the calibration stays");
    assert_eq!(last_program(&board), Some((1, State::Confirmed as u8)));

    // Back, over a power cut.
    assert_eq!(maintain(&mut board, Command::Open(SCENE.calibration.unit)).expect("answers"), Some(Answer::Done));
    assert_eq!(maintain(&mut board, Command::RollBack).expect("answers"), Some(Answer::Done));
    board.power_cut().expect("starts");
    running(&mut board, 1.0).expect("answers");
    let told = programs(&mut board, 1.0).expect("answers");
    assert_eq!((told.slot, told.state, told.other_version), (0, State::Confirmed as u8, 1_002_003));
    assert_eq!(told.sum, before.sum);

    // And forth, into the slot that it came from.
    assert_eq!(maintain(&mut board, Command::Open(SCENE.calibration.unit)).expect("answers"), Some(Answer::Done));
    assert_eq!(maintain(&mut board, Command::RollBack).expect("answers"), Some(Answer::Done));
    let (told, _) = after_restart(&mut board, 2, false);
    assert_eq!((told.slot, told.version), (1, 1_002_003));
    assert_eq!(send(&mut board, &unsigned(program(0, 1_002_004))), Sent::Committed);
    let (told, _) = after_restart(&mut board, 6, true);
    assert_eq!((told.slot, told.state, told.version), (0, State::Confirmed as u8, 1_002_004));
}

#[test]
fn what_is_not_for_this_unit_is_refused_and_the_unit_runs_on() {
    let mut board = unit();
    let changed = |at: usize, to: &[u8]| {
        let mut body = program(1, 2_000_000);
        body[at - HEAD..][..to.len()].copy_from_slice(to);
        unsigned(body)
    };
    for (bad, answer) in [
        (unsigned(program(1, 0)), Answer::Older),
        (unsigned(program(0, 2_000_000)), Answer::Board),
        (changed(head::BOARD, b"another"), Answer::Board),
        (changed(head::MAGIC, b"none"), Answer::Program),
        (unsigned(vec![0; 192 * 1024]), Answer::Length),
    ] {
        assert_eq!(send(&mut board, &bad), Sent::Refused(answer));
    }
    board.power_cut().expect("starts");
    running(&mut board, 1.0).expect("answers");
    let told = programs(&mut board, 1.0).expect("answers");
    assert_eq!((told.slot, told.state, told.other_state), (0, State::Confirmed as u8, State::Empty as u8));
}

/// `b .`; an undefined instruction; `movs r1, #0; str r1, [r0]; bx lr`: an empty frame.
const HANGS: &[u16] = &[0xE7FE];
const FAULTS: &[u16] = &[0xDE00];
const SAYS_NOTHING: &[u16] = &[0x2100, 0x6001, 0x4770];

#[test]
fn a_new_program_that_is_no_good_is_left_by_itself() {
    const ENCODE: &str = "hrg_core::link::Message::encode";
    for (what, body, talks, within_s) in [
        ("it hangs at its first instruction", with_code("Reset", HANGS), true, 12),
        ("it hangs when it starts", with_code("firmware::start", HANGS), true, 12),
        ("it faults when it starts", with_code("firmware::start", FAULTS), true, 12),
        ("it hangs with the first sample", with_code("hrg_fast::sample", HANGS), true, 6),
        ("it faults with the first second", with_code("hrg_core::compensator::Model<P>::update", FAULTS), true, 6),
        ("it answers nothing", with_code(ENCODE, SAYS_NOTHING), true, TRIAL_S + 4),
        ("nobody talks to it", program(1, 2_000_000), false, TRIAL_S + 4),
    ] {
        let mut board = unit();
        assert_eq!(send(&mut board, &unsigned(body)), Sent::Committed, "{what}");
        let (told, without) = after_restart(&mut board, within_s, talks);
        println!("{what}: {without:.1} s without rates");
        assert_eq!((told.slot, told.state), (0, State::Confirmed as u8), "{what}");
        assert_eq!(told.other_state, State::Tried as u8, "{what}");
        assert!(without < 70.0, "{what}: {without} s without rates");
        assert_eq!(last_program(&board), Some((0, State::Confirmed as u8)), "{what}");
        // It is not tried again, and the way is free for a better one.
        board.power_cut().expect("starts");
        running(&mut board, 1.0).expect("answers");
        assert_eq!(programs(&mut board, 1.0).expect("answers").slot, 0, "{what}");
    }
}

#[test]
fn an_update_goes_on_after_a_pulled_cable_and_after_a_power_cut() {
    let new = unsigned(program(1, 1_002_003));
    for cut in [false, true] {
        let mut board = unit();
        let mut sent = 0;
        // The host goes away in the middle.
        let end = send_program(&mut board, SCENE.calibration.unit, &new, |_, there| {
            sent = there;
            if there < 20_000 {
                Ok(())
            } else {
                Err(std::io::Error::other("the cable is pulled").into())
            }
        });
        assert!(end.is_err() && sent >= 20_000);
        if cut {
            board.power_cut().expect("starts");
            running(&mut board, 1.0).expect("answers");
        }
        let mut first = None;
        let end = send_program(&mut board, SCENE.calibration.unit, &new, |_, there| {
            first = first.or(Some(there).filter(|there| *there > 0));
            Ok(())
        });
        assert_eq!(end.expect("answers"), Sent::Committed);
        assert!(first.is_some_and(|there| there + 256 >= sent), "it goes on at {first:?}, and had {sent}");
    }
}

#[test]
fn a_program_on_trial_takes_no_other_one() {
    let mut board = unit();
    assert_eq!(send(&mut board, &unsigned(program(1, 1_002_003))), Sent::Committed);
    let (told, _) = after_restart(&mut board, 3, false);
    assert_eq!((told.slot, told.state), (1, State::Tried as u8));
    assert_eq!(send(&mut board, &unsigned(program(0, 1_002_004))), Sent::Refused(Answer::Trial));
    // A token that it has not sent is none.
    for token in [0, told.token ^ 4] {
        let _ = maintain(&mut board, Command::Echo(token)).expect("answers");
    }
    board.run_until(board.now() + 5 * CPU_HZ).expect("runs");
    let again = ask(&mut board, &Message::Identify, 1.0, |m| match m {
        Message::Programs(p) => Some(*p),
        _ => None,
    });
    assert_eq!(again.expect("answers").map(|p| (p.slot, p.state)), Some((1, State::Tried as u8)));
}

/// The marks beside a program are in no sum: one that has lost a bit must not end a unit.
#[test]
fn a_unit_whose_mark_has_lost_a_bit_runs_and_says_so() {
    let marks = ADDRESSES[0] - FLASH_START;
    for (mark, bit) in [(mark::COMMITTED, 0), (mark::COMMITTED, 31), (mark::CONFIRMED, 5)] {
        let mut board = unit();
        let word = board.firmware().word(ADDRESSES[0] + mark as u32).expect("a mark") ^ 1 << bit;
        board.write_flash(marks + mark as u32, &word.to_le_bytes()).expect("flash");
        board.power_cut().expect("starts");
        board.world.received.rates.clear();
        board.run_until(board.now() + 2 * CPU_HZ).expect("runs");
        let last = board.world.received.rates.last().expect("it runs");
        assert!(last.unit_status.contains(UnitStatus::PROGRAM), "{last:?}");
    }
}

/// Another program may have left anything where this one keeps its states, and may have run for days.
#[test]
fn states_that_another_program_ran_after_are_not_gone_on_from() {
    for (sum, known) in [(None, true), (Some(0x1234_5678u32), false)] {
        let mut board = SCENE.settled().expect("settles");
        if let Some(sum) = sum {
            let ran = board.firmware().address_of(hrg_board::RAN_LAST).expect("there");
            board.write_ram(ran, &sum.to_le_bytes()).expect("RAM");
        }
        board.reset_by_software().expect("starts");
        board.run_until(board.now() + 30 * CPU_HZ).expect("runs");
        let last = board.world.received.rates.last().expect("rates");
        let unknown = last.axis_status.iter().any(|s| s.contains(AxisStatus::HISTORY_UNKNOWN));
        assert_eq!(unknown, !known, "{last:?}");
    }
}

/// A host that goes away between the commitment and the restart.
#[test]
fn a_program_that_was_committed_is_not_tried_at_a_reset_in_flight() {
    let mut board = unit();
    assert_eq!(send(&mut board, &unsigned(program(1, 1_002_003))), Sent::Committed);
    board.power_cut().expect("starts");
    running(&mut board, 1.0).expect("answers");
    let told = programs(&mut board, 1.0).expect("answers");
    assert_eq!((told.slot, told.other_state, told.other_version), (0, State::New as u8, 1_002_003));
    // It is there still, for a restart by a host.
    assert_eq!(maintain(&mut board, Command::Open(SCENE.calibration.unit)).expect("answers"), Some(Answer::Done));
    let (told, _) = after_restart(&mut board, 6, true);
    assert_eq!((told.slot, told.state), (1, State::Confirmed as u8));
}
