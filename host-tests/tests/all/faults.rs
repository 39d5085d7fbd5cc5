//! The promises of docs/promises.md, in the short form of `cargo xtask faults`.

use hrg_board::host::running;
use hrg_board::replay;
use hrg_core::reset::ResetCause;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_study::faults::memory::{self, Corruption};
use hrg_study::faults::{campaign, Extent, Scene};
use virtual_board::{Stop, CPU_HZ};

fn elf() -> Vec<u8> {
    replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first")
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn every_promise_is_kept_in_the_short_campaign() {
    let report = campaign(&elf(), 1, &Extent::SHORT, None).expect("runs");
    assert!(report.rows.len() > 30);
    for row in &report.rows {
        assert!(row.kept, "{row:?}");
    }
}

/// Trials that the campaign leaves out have no effect.
#[test]
#[ignore = "cargo xtask test --rest"]
fn bits_that_are_overwritten_before_they_are_read_have_no_effect() {
    let scene = Scene::new(&elf(), 2).expect("a scene");
    for corruption in [Corruption::Single, Corruption::Double, Corruption::Rates] {
        let looked_at = memory::looked_at(&scene, 2, 60, corruption).expect("runs");
        let read = looked_at.iter().filter(|read| **read).count();
        assert!((1..60).contains(&read), "{corruption:?}: {read} of 60");
        let fates = |of: &[bool]| memory::flips(&scene, 2, of, corruption).expect("runs");
        assert_eq!(fates(&looked_at), fates(&[true; 60]), "{corruption:?}");
    }
}

#[test]
fn the_watchdog_may_run_from_reset_and_bites_where_the_start_hangs() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("a board");
    board.watch_from_reset().expect("restarts");
    assert_eq!(board.run_until(30 * CPU_HZ).expect("runs"), Stop::Time, "no reset");
    // It was switched on half a minute ago: nothing else is wrong.
    let last = board.world.received.rates.last().expect("many");
    assert_eq!((last.axis_status, last.unit_status), ([AxisStatus::HISTORY_UNKNOWN; 3], UnitStatus::empty()));
    // A start that hangs: its first instruction jumps to itself for ever.
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("a board");
    let mut reset = [0; 4];
    board.read_memory(virtual_board::FLASH_START + 4, &mut reset).expect("flash");
    let at = u32::from_le_bytes(reset) & !1;
    board.write_flash(at - virtual_board::FLASH_START, &[0xFE, 0xE7]).expect("flash");
    board.watch_from_reset().expect("restarts");
    let begun = board.now();
    assert_eq!(board.run_until(30 * CPU_HZ).expect("runs"), Stop::Watchdog);
    assert!(board.now() - begun < CPU_HZ * 6 / 10);
}

#[test]
fn the_watchdog_bites_where_a_task_stands_still_and_that_is_flagged() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    // The model's executor is woken no more: its interrupt (UART4, number 52) is off.
    board.disable_interrupt(52);
    let begun = board.now();
    assert_eq!(board.run_until(begun + 10 * CPU_HZ).expect("runs"), Stop::Watchdog);
    assert!(board.now() - begun < CPU_HZ, "{} s", (board.now() - begun) as f64 / CPU_HZ as f64);
    board.world.received = Default::default();
    let identity = running(&mut board, 1.0).expect("answers");
    assert_eq!((identity.reset_cause, identity.resets), (ResetCause::Watchdog, 2), "the scene begins with a reset");
}

#[test]
fn a_queue_that_takes_no_frames_ends_in_a_reset() {
    // Found by flip 865 of the campaign: the queue took itself for full, rates stopped for good, and housekeeping went on.
    let elf = elf();
    let scene = Scene::new(&elf, 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    let queue = board.firmware().address_of("firmware::channels::FRAMES").expect("a queue of frames");
    // It depends on the moment, within a frame's 5 ms, what the queue holds.
    let stopped = (0..10 * 32u32).find(|at| {
        if *at > 0 && at % 32 == 0 {
            let next = board.now() + CPU_HZ / 2000;
            board.run_until(next).expect("runs");
            board.world.received = Default::default();
        }
        let at = at % 32;
        let start = board.snapshot().expect("now");
        let begun = board.now();
        board.flip_bit(queue + at / 8, (at % 8) as u8).expect("RAM");
        let stop = board.run_until(begun + CPU_HZ / 10).expect("runs");
        let found = stop == Stop::Time && board.world.received.rates.is_empty();
        if !found {
            board.restore(&start).expect("restores");
        }
        found
    });
    println!("bit {stopped:?} of the queue");
    assert!(stopped.is_some(), "no bit of the queue stops it: look for another way to stop the rates alone");
    let begun = board.now();
    assert_eq!(board.run_until(begun + 4 * CPU_HZ).expect("runs"), Stop::Watchdog);
    assert!(board.now() - begun < 3 * CPU_HZ);
}
