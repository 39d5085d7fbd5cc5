//! The rates and increments of a navigator, through the ELF: filters, the time of frames, GNSS time, link and processor; and settings that are kept.

use hrg_board::host::{cycles, maintain, running};
use hrg_board::replay::{default_elf, read_elf};
use hrg_board::twin::Twin;
use hrg_board::wires::Wires;
use hrg_core::filter::Filter;
use hrg_core::maintenance::{Answer, Command};
use hrg_core::output::{Framing, OutputSettings};
use hrg_core::parts::{Parts, SYMBOL};
use hrg_core::status::UnitStatus;
use hrg_study::faults::Scene;
use hrg_study::output::{budget, coning, gnss_time, in_mavlink, sculling, sending, sweep};
use virtual_board::{Firmware, Stop};

fn scene() -> Scene {
    Scene::new(&read_elf(&default_elf()).expect("built before"), 1).expect("a scene")
}

#[test]
fn a_vibration_comes_out_as_the_table_says_and_at_its_time() {
    let swept = [10.3, 40.3, 59.7, 130.3, 250.3, 700.3, 869.3, 950.3];
    for r in sweep(&scene(), OutputSettings::default(), &swept).expect("runs") {
        let db = 20.0 * r.gain.max(1e-9).log10();
        if r.hz <= 60.0 {
            assert!(db.abs() < 0.1 && r.late_us.abs() < 0.05, "{r:?}: {db} dB");
        } else if r.hz < 900.0 {
            assert!(db < -80.0, "{r:?}: {db} dB");
        } else {
            // (This folds back round the ADC's own rate.)
            assert!(db < -60.0, "{r:?}: {db} dB");
        }
    }
}

#[test]
fn coning_and_sculling_are_in_the_increments() {
    let scene = scene();
    for hz in [10.0, 50.0] {
        let (c, s) = (coning(&scene, hz).expect("runs"), sculling(&scene, hz).expect("runs"));
        assert!(c.by_increments.abs() < 0.02 && c.by_increments.abs() < 0.01 * c.by_frames.abs(), "{c:?}");
        assert!(s.by_increments.abs() < 0.5 && s.by_increments.abs() < 0.01 * s.by_frames.abs(), "{s:?}");
    }
}

#[test]
fn frames_have_gnss_time_and_everything_fits() {
    let scene = scene();
    let t = gnss_time(&scene).expect("runs");
    assert!(t.most_ns < 12.0 && (20..30).contains(&t.stated_ns) && t.marks > 50, "{t:?}");
    let b = budget(&scene).expect("runs");
    assert!(b.of_line() < 2.0 / 3.0 && b.of_processor() < 0.033, "{b:?}: {} {}", b.of_line(), b.of_processor());
}

#[test]
fn increments_are_those_of_the_desktop_bit_for_bit() {
    let scene = scene();
    let scale = scene.calibration.scale_factors_dph_per_code();
    let program = Firmware::parse(scene.elf()).expect("an ELF");
    let word = program.address_of(SYMBOL).and_then(|at| program.word(at));
    let twin =
        Twin::new(scene.calibration.clone(), UnitStatus::empty(), Parts::from_bits_retain(word.expect("its parts")));
    let wires = Wires::new(scene.steps().clone(), scale, 20e-9, 1, Some(twin), None);
    let mut board = scene.off(wires, &scene.calibration).expect("runs");
    assert_eq!(board.run_until(cycles(1.0)).ok(), Some(Stop::Time));
    let settings = OutputSettings { increments: 10, ..OutputSettings::default() };
    for command in [Command::Open(scene.calibration.unit), Command::Output(settings), Command::Close] {
        assert_eq!(maintain(&mut board, command).expect("answers"), Some(Answer::Done));
    }
    assert_eq!(board.run_until(cycles(8.0)).ok(), Some(Stop::Time));
    let r = &board.world.received;
    assert!(r.increments.len() > 450 && r.rates.len() > 1200, "{} {}", r.increments.len(), r.rates.len());
    assert_eq!((r.differing, &r.first_difference), (0, &None));
}

#[test]
fn what_is_sent_is_kept_over_a_power_cut_and_told_by_the_identity() {
    let scene = scene();
    let settings = OutputSettings { filter: Filter::Mean, decimation: 2, increments: 20, framing: Framing::Own };
    let mut board = sending(&scene, settings).expect("runs");
    board.power_cut().expect("off and on");
    let identity = running(&mut board, 2.0).expect("answers");
    assert_eq!((identity.filter, identity.decimation, identity.increments), (Filter::Mean, 2, 20));
    // 1.5 ms of the ADC, half a millisecond of the mean.
    assert_eq!(identity.delay_us, 2000);
    assert_eq!(board.run_until(board.now() + cycles(0.5)).ok(), Some(Stop::Time));
    board.world.received = Default::default();
    assert_eq!(board.run_until(board.now() + cycles(1.0)).ok(), Some(Stop::Time));
    let r = &board.world.received;
    let counts = (r.rates.len(), r.increments.len());
    assert!((495..=505).contains(&counts.0) && (45..=55).contains(&counts.1), "{counts:?}");
    // Impossible settings are refused.
    for bad in [OutputSettings { decimation: 0, ..settings }, OutputSettings { increments: 51, ..settings }] {
        assert_eq!(maintain(&mut board, Command::Open(scene.calibration.unit)).expect("answers"), Some(Answer::Done));
        assert_eq!(maintain(&mut board, Command::Output(bad)).expect("answers"), Some(Answer::Bound));
    }
}

#[test]
fn a_firmware_without_mavlink_refuses_that_framing() {
    let settings = OutputSettings { framing: Framing::Mavlink, ..OutputSettings::default() };
    let refused = sending(&scene(), settings).map(drop).expect_err("it has none").to_string();
    assert!(refused.contains("NoFraming"), "{refused}");
}

/// With the pulse and the time of GNSS, which go into the packets and out in no way of their own. (python/tests/test_bridge.py has pymavlink read a unit.)
#[test]
#[ignore = "cargo xtask test --rest"]
fn a_firmware_with_mavlink_sends_its_packets_and_nothing_else() {
    let usual = default_elf();
    let target = usual.ancestors().nth(3).expect("a folder of builds");
    let elf = target.join("mavlink").join(usual.strip_prefix(target).expect("lies there"));
    let elf = read_elf(&elf).expect("cargo xtask size --mavlink builds it");
    let bytes = in_mavlink(&Scene::new(&elf, 1).expect("a scene"), 3.0).expect("runs");
    // (The first may be one that was on its way.)
    let begin = bytes.windows(2).position(|w| w == [0xFD, 62]).expect("packets");
    let mut rest = &bytes[begin..];
    let (mut times, mut numbers, mut heartbeats) = (Vec::new(), Vec::new(), 0);
    while rest.len() >= 12 && rest.len() >= 12 + usize::from(rest[1]) {
        let (packet, others) = rest.split_at(12 + usize::from(rest[1]));
        assert_eq!(packet[0], 0xFD, "packets follow each other: {:02x?}", &rest[..40.min(rest.len())]);
        numbers.push(packet[4]);
        match packet[7] {
            105 => times.push(u64::from_le_bytes(*packet[10..].first_chunk().expect("eight bytes"))),
            _ => heartbeats += 1,
        }
        rest = others;
    }
    assert!(numbers.windows(2).all(|w| w[1] == w[0].wrapping_add(1)), "none is lost");
    assert!((595..=600).contains(&times.len()) && (2..=3).contains(&heartbeats), "{} {heartbeats}", times.len());
    assert!(times.windows(2).all(|w| (4998..=5002).contains(&(w[1] - w[0]))), "{times:?}");
    // Week 2394 of GPS began on 2025-11-23; 18 leap seconds.
    let start_us = 1_763_856_000_000_000 - 18_000_000;
    assert!((start_us..start_us + 10_000_000).contains(&times[0]), "{}", times[0]);
}
