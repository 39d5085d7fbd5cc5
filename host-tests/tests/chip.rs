//! What may happen to the chip and to what is soldered beside it: ADC, crystal, supply, program, pulses per second. The ELF on the virtual board.

use hrg_board::faults::Scene;
use hrg_board::host::{burn, Burn};
use hrg_board::replay::{self, Options, Outcome};
use hrg_board::wires::{WireFaults, Wires};
use hrg_cal::recording::steps::Steps;
use hrg_cal::recording::Recording;
use hrg_core::calibration::Calibration;
use hrg_core::events::{records, Event, Record, SECTOR};
use hrg_core::pps::SLEW_PER_S;
use hrg_core::reset::{Halt, ResetCause};
use hrg_core::status::{AxisStatus, UnitStatus};
use std::path::Path;
use virtual_board::{AdcMishap, Board, Stop, CPU_HZ, CYCLES_PER_TICK, FLASH_START};

fn elf() -> Vec<u8> {
    replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first")
}

fn steps() -> Steps {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/simulated-ramp.csv"));
    Steps::new(&Recording::load(path).expect("usable")).expect("long enough")
}

fn run(seconds: u64, faults: WireFaults) -> Outcome {
    let options = Options { seconds: Some(seconds), faults, compare: true, ..Options::default() };
    replay::run(&elf(), None, &steps(), &options, |_| {}).expect("the board models all that the firmware does")
}

fn board() -> Board<Wires> {
    let mut board = Board::new(&elf(), Wires::new(steps(), [0.01; 3], 20e-9, 1, None, None)).expect("runs");
    board.faults_as_on_chip();
    board
}

fn unit_status(board: &Board<Wires>) -> UnitStatus {
    board.world.received.rates.last().expect("rates").unit_status
}

/// The field log, read where it lies.
fn events(board: &Board<Wires>) -> Vec<Record> {
    let at = |name: &str| board.firmware().address_of(name).expect("a symbol of memory.x");
    let sectors = ["_events_a_start", "_events_b_start"].map(|name| {
        let mut bytes = vec![0; SECTOR];
        board.read_memory(at(name), &mut bytes).expect("flash");
        bytes
    });
    records([&sectors[0], &sectors[1]]).collect()
}

#[test]
fn an_adc_that_loses_its_settings_or_its_step_is_set_up_again() {
    // In the middle of a second: at its turn, how many errors its report counts depends on when the report is made.
    const AT_S: f64 = 20.4;
    for (name, mishap) in [
        ("supply", AdcMishap::LosesSettings),
        ("sample rate", AdcMishap::Flips(0x03, 2)),
        ("gain", AdcMishap::Flips(0x04, 1)),
        ("channel", AdcMishap::Flips(0x0E, 0)),
        ("byte", AdcMishap::SlipsAByte),
    ] {
        let faults = WireFaults { adc_mishaps: vec![(AT_S, mishap)], ..WireFaults::default() };
        let o = run(30, faults);
        let r = &o.received;
        assert_eq!(r.differing, 0, "{name}: {:?}", r.first_difference);
        assert_eq!(o.watchdog_resets, 0, "{name}");
        let flagged: Vec<f64> = r
            .rates
            .iter()
            .zip(&r.rate_at)
            .filter(|(f, _)| f.unit_status.contains(UnitStatus::ADC_FAULT))
            .map(|(_, at)| *at as f64 / CPU_HZ as f64)
            // (The first frame has the ADC's first set-up in it.)
            .filter(|t| *t > 10.0)
            .collect();
        let (first, last) = (flagged.first().expect("flagged"), flagged.last().expect("flagged"));
        // A setting is looked at within a second; the set-up takes some twenty frames.
        assert!(*first > AT_S && *first < AT_S + 1.1 && *last < AT_S + 1.2, "{name}: flagged from {first} to {last}");
        println!("{name}: flagged after {:.3} s, good again after {:.3} s", first - AT_S, last - AT_S);
    }
}

#[test]
fn samples_that_were_not_fetched_leave_no_old_one_behind() {
    // Interrupts of TIM2 (28) are kept out for 5 ms: the ADC's store fills up. Whatever comes after that is of its own time: codes count up.
    let mut board = board();
    board.run_until(5 * CPU_HZ).expect("runs");
    let before = board.world.received.rates.len();
    board.disable_interrupt(28);
    board.run_until(5 * CPU_HZ + CPU_HZ / 200).expect("runs");
    board.enable_interrupt(28);
    // (Not to the moment of a sample, which is not fetched yet then.)
    board.run_until(6 * CPU_HZ + CPU_HZ / 8000).expect("runs");
    let after = &board.world.received.rates[before..];
    let flagged = after.iter().filter(|f| f.unit_status.contains(UnitStatus::ADC_FAULT)).count();
    assert!((1..=2).contains(&flagged), "{flagged}");
    assert_eq!(board.adc_backlog(), 0, "the ADC's store is empty after each frame");
}

#[test]
fn a_crystal_that_stops_ends_in_a_restart_on_the_chips_own_oscillator() {
    let mut board = board();
    board.run_until(30 * CPU_HZ).expect("runs");
    assert!(!unit_status(&board).contains(UnitStatus::TIMEBASE));
    board.stop_crystal();
    let at = board.now();
    assert_eq!(board.run_until(at + 5 * CPU_HZ).expect("runs"), Stop::Watchdog);
    assert!(board.now() - at < CPU_HZ, "the watchdog's half second");
    board.world.received = Default::default();
    board.run_until(at + 5 * CPU_HZ).expect("runs");
    assert!(board.world.received.rates.len() > 500);
    assert!(board.world.received.rates.iter().all(|f| f.unit_status.contains(UnitStatus::TIMEBASE)));
    let start = Event::Start { cause: ResetCause::Watchdog, halt: Halt::ClockLost, resets: 1, calibration: 0 };
    assert!(events(&board).iter().any(|r| r.event == start), "{:?}", events(&board));
}

#[test]
fn a_crystal_of_another_frequency_is_not_used() {
    for (hz, right) in
        [(8e6, true), (8.0004e6, true), (7e6, false), (12e6, false), (16e6, false), (25e6, false), (4e6, false)]
    {
        let mut board = board();
        board.set_crystal(hz);
        board.run_until(2 * CPU_HZ).expect("runs");
        assert_eq!(!unit_status(&board).contains(UnitStatus::TIMEBASE), right, "{hz} Hz");
    }
}

#[test]
fn a_sagging_supply_lets_nothing_into_flash() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.off(scene.wires().live(), &scene.calibration).expect("a board");
    board.run_until(2 * CPU_HZ).expect("runs");
    let mut new = scene.calibration.clone();
    new.sequence += 1;
    board.sag(6);
    let operations = board.flash_operations();
    assert!(burn(&mut board, &new).is_err(), "the unit says that the flash could not be written");
    assert_eq!(board.flash_operations(), operations);
    board.sag(0);
    assert_eq!(burn(&mut board, &new).expect("runs"), Burn::Done);
}

#[test]
fn a_program_that_has_changed_is_flagged() {
    let mut board = board();
    board.run_until(2 * CPU_HZ).expect("runs");
    assert_eq!(unit_status(&board), UnitStatus::DEFAULT_CALIBRATION);
    // A word that is never executed: the text of a panic, say; the last word of the program.
    let end = board.firmware().flash()[..0x4_0000].iter().rposition(|b| *b != 0xFF).expect("a program") as u32;
    board.flip_bit(FLASH_START + end, 3).expect("flash");
    board.run_until(40 * CPU_HZ).expect("runs");
    let first = board.world.received.rates.iter().position(|f| f.unit_status.contains(UnitStatus::PROGRAM));
    let at = board.world.received.rate_at[first.expect("flagged")] as f64 / CPU_HZ as f64 - 2.0;
    println!("flagged after {at:.1} s");
    assert!(at < 40.0);
    // And from the first frame after a restart.
    board.power_cut().expect("restarts");
    board.world.received = Default::default();
    board.run_until(board.now() + 2 * CPU_HZ).expect("runs");
    assert!(board.world.received.rates.iter().all(|f| f.unit_status.contains(UnitStatus::PROGRAM)));
}

#[test]
fn every_bit_of_the_program_counts() {
    // Short: some bits, each looked at by a start.
    let good = elf();
    let firmware = virtual_board::Firmware::parse(&good).expect("parses");
    let program: Vec<u32> = (0..0x4_0000u32).filter(|at| firmware.flash()[*at as usize] != 0xFF).collect();
    for k in 0..12 {
        let mut board = board();
        board.run_until(CPU_HZ / 2).expect("runs");
        let at = program[program.len() * k / 12 + 5];
        board.flip_bit(FLASH_START + at, (k % 8) as u8).expect("flash");
        board.power_cut().expect("restarts");
        board.world.received = Default::default();
        // (The flipped bit may stop it altogether: then nothing goes out.)
        let _ = board.run_until(board.now() + CPU_HZ);
        let rates = &board.world.received.rates;
        assert!(rates.iter().all(|f| f.unit_status.contains(UnitStatus::PROGRAM)), "bit {} of {at:#x}", k % 8);
    }
}

#[test]
fn pulses_per_second_set_the_frequencies_right() {
    let error = 3e-6;
    let pulses = Some((0.5, 1.0 + error));
    let o = run(200, WireFaults { pulses, ..WireFaults::default() });
    let r = &o.received;
    assert_eq!(r.differing, 0, "{:?}", r.first_difference);
    let last = r.housekeeping.last().expect("some");
    assert!((f64::from(last.clock_ppb) - error * 1e9).abs() < 10.0, "{} ppb", last.clock_ppb);
    assert!(last.pps_age_ms <= 1000, "{} ms", last.pps_age_ms);
    let without = run(200, WireFaults::default()).received;
    let plain = without.housekeeping.last().expect("some");
    assert_eq!((plain.pps_age_ms, plain.clock_ppb), (u32::MAX, 0.0));
    for (a, b) in last.frequency_hz.iter().zip(plain.frequency_hz) {
        assert!((a / b - 1.0 - error).abs() < 1e-8, "{a} {b}");
    }
    // From one step to the next the correction moves no more than the model can bear.
    for pair in r.housekeeping[25..].windows(2) {
        assert!(f64::from(pair[1].clock_ppb - pair[0].clock_ppb).abs() <= SLEW_PER_S * 1.01e9);
    }
    // A clock out of bounds is flagged.
    let far = run(40, WireFaults { pulses: Some((0.5, 1.0 + 200e-6)), ..WireFaults::default() }).received;
    assert!(far.housekeeping.last().expect("some").unit_status.contains(UnitStatus::TIMEBASE));
}

#[test]
fn the_mark_rises_with_the_sample_that_ends_a_frame() {
    let mut board = board();
    board.run_until(3 * CPU_HZ).expect("runs");
    board.watch_marks();
    let from = board.world.received.rates.len();
    board.run_until(4 * CPU_HZ).expect("runs");
    let marks = board.marks().to_vec();
    let frames = &board.world.received.rates[from..];
    assert!(marks.len() >= 199, "{}", marks.len());
    // The timer's zero is some time after power-on: so far is the first mark from its frame's tick, and every other from its own, but for the
    // interrupt's delay.
    let first = frames.iter().map(|f| u64::from(f.tick) * CYCLES_PER_TICK);
    let mut delays = Vec::new();
    for tick in first.skip(2).take(150) {
        // Frames are five milliseconds apart.
        let apart = marks.iter().map(|m| (m + 900_000_000 - tick) % 900_000).min().expect("a mark");
        delays.push(apart);
    }
    let (least, most) = (delays.iter().min().expect("some"), delays.iter().max().expect("some"));
    assert!(most - least < 2000, "{least} to {most} cycles");
}

#[test]
fn starts_that_follow_each_other_without_a_step_do_not_go_on_for_ever() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    let unknown = |board: &mut Board<Wires>| {
        board.world.received = Default::default();
        board.run_until(board.now() + 3 * CPU_HZ).expect("runs");
        let last = board.world.received.rates.last().expect("rates");
        last.axis_status.iter().all(|s| s.contains(AxisStatus::HISTORY_UNKNOWN))
    };
    // Half a second each: no model step.
    for _ in 0..3 {
        board.reset_by_software().expect("restarts");
        board.run_until(board.now() + CPU_HZ / 2).expect("runs");
    }
    board.reset_by_software().expect("restarts");
    assert!(unknown(&mut board), "kept states that nobody knows the age of are not gone on from");
    // One alone is.
    let mut board = scene.settled().expect("settles");
    board.reset_by_software().expect("restarts");
    assert!(!unknown(&mut board));
}

#[test]
fn the_field_log_tells_what_befell_the_unit() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.off(scene.wires().live(), &scene.calibration).expect("a board");
    board.run_until(10 * CPU_HZ).expect("runs");
    let mut new = scene.calibration.clone();
    new.sequence += 1;
    assert_eq!(burn(&mut board, &new).expect("runs"), Burn::Done);
    board.run_until(board.now() + 2 * CPU_HZ).expect("runs");
    board.power_cut().expect("restarts");
    board.run_until(board.now() + 5 * CPU_HZ).expect("runs");
    let all = events(&board);
    let starts: Vec<&Event> = all.iter().map(|r| &r.event).filter(|e| matches!(e, Event::Start { .. })).collect();
    let start = |calibration: &Calibration| Event::Start {
        cause: ResetCause::Power,
        halt: Halt::None,
        resets: 0,
        calibration: calibration.checksum(),
    };
    // (A burn ends with a restart.)
    let restart =
        Event::Start { cause: ResetCause::Software, halt: Halt::None, resets: 1, calibration: new.checksum() };
    assert_eq!(starts, [&start(&scene.calibration), &restart, &start(&new)]);
    assert!(
        all.iter().any(|r| r.event == Event::Burn { answer: 0, calibration: new.checksum() } && r.on_for_s >= 9),
        "{all:?}"
    );
    assert!(
        all.iter()
            .any(|r| matches!(r.event, Event::Axis { axis: 0, flags, .. } if flags.contains(AxisStatus::SETTLING))),
        "{all:?}"
    );
}

/// FLASH_OPTCR as docs/hardening.md has a unit fly.
const FLYING: u32 = 0x0FC6_55C1;

#[test]
fn with_the_option_bytes_that_fly_burns_and_the_field_log_are_written_and_the_program_is_not() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/hardening.md")).expect("there");
    assert!(page.contains("as it should fly, `0x0FC6 55C1`"), "docs/hardening.md and this test differ");
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("a board");
    board.set_options(FLYING);
    board.power_cut().expect("restarts");
    board.run_until(2 * CPU_HZ).expect("runs");
    assert_eq!(events(&board).iter().filter(|r| matches!(r.event, Event::Start { .. })).count(), 1);
    let mut new = scene.calibration.clone();
    new.sequence += 1;
    assert_eq!(burn(&mut board, &new).expect("runs"), Burn::Done);
    // Sectors 1 and 2 are the log, 6 and 7 the calibrations; all others are protected.
    assert_eq!(FLYING >> 16 & 0xFF, 1 << 1 | 1 << 2 | 1 << 6 | 1 << 7);
}

#[test]
fn every_bit_of_the_seal_counts() {
    let elf = elf();
    let firmware = virtual_board::Firmware::parse(&elf).expect("parses");
    let seal = firmware.flash().windows(4).position(|w| w == b"SEAL").expect("cargo xtask build seals it") as u32;
    for bit in (0..64).step_by(5) {
        let mut board = board();
        board.flip_bit(FLASH_START + seal + bit / 8, (bit % 8) as u8).expect("flash");
        board.run_until(CPU_HZ / 4).expect("runs");
        let rates = &board.world.received.rates;
        assert!(!rates.is_empty() && rates.iter().all(|f| f.unit_status.contains(UnitStatus::PROGRAM)), "bit {bit}");
    }
}

#[test]
fn states_of_a_false_clock_are_not_gone_on_from() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    board.stop_crystal();
    let at = board.now();
    assert_eq!(board.run_until(at + 2 * CPU_HZ).expect("runs"), Stop::Watchdog);
    board.run_until(at + 5 * CPU_HZ).expect("runs");
    // The crystal is back, and the unit is told to start anew.
    board.set_crystal(8e6);
    board.reset_by_software().expect("restarts");
    board.world.received = Default::default();
    let now = board.now();
    board.run_until(now + 3 * CPU_HZ).expect("runs");
    let last = board.world.received.rates.last().expect("rates");
    assert!(!last.unit_status.contains(UnitStatus::TIMEBASE));
    assert!(last.axis_status.iter().all(|s| s.contains(AxisStatus::HISTORY_UNKNOWN)), "{:?}", last.axis_status);
}
