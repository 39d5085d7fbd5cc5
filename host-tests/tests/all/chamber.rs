//! A chamber day against the virtual board: record, burn, read back, lose the power.

use hrg::unit::port::{Burn, Unit};
use hrg::unit::record::{Recorder, Second};
use hrg_board::host;
use hrg_board::replay::{self, CALIBRATION_A};
use hrg_board::serve;
use hrg_board::wires::Wires;
use hrg_core::calibration::Calibration;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command};
use hrg_core::sectors::{room, Place, Sector};
use hrg_core::unit_name::UnitName;
use hrg_data::log::Decoder;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_simulate::{Plan, Profile};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use virtual_board::{Board, CPU_HZ};

fn elf() -> Vec<u8> {
    replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first")
}

fn folder(name: &str) -> PathBuf {
    let p = std::env::temp_dir().join(format!("hrg-chamber-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&p);
    std::fs::create_dir_all(&p).expect("a temporary folder");
    p
}

fn steps() -> Steps {
    Steps::new(&Plan::of(Profile::parse("cycle").expect("named"), 2, 3).simulate().recording).expect("long enough")
}

fn image(sequence: u32, constant: f32) -> Calibration {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("HRG-7");
    c.calibrated = true;
    c.created_unix_s = 1_795_219_200;
    c.sequence = sequence;
    for a in &mut c.axes {
        a.coefficients = hrg_core::bias::Coefficients::One([constant, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }
    c
}

#[test]
fn an_image_is_burnt_over_the_link_survives_power_off_and_is_never_fitted_twice() {
    let d = folder("burn");
    let (elf, steps) = (elf(), steps());
    let options = serve::Options { speed: 12.0, seconds: None, folder: d.clone(), as_on_chip: false };
    let link = d.join("link").display().to_string();
    let power = |work: &dyn Fn()| {
        let stop = AtomicBool::new(false);
        std::thread::scope(|s| {
            let board = s.spawn(|| serve::serve(&elf, None, &steps, &options, &stop));
            while !d.join("link").exists() {
                std::thread::sleep(Duration::from_millis(20));
            }
            work();
            stop.store(true, Ordering::Relaxed);
            board.join().expect("no panic").expect("the board runs");
        });
    };
    power(&|| {
        let mut unit = Unit::open(&link).expect("a port");
        assert_eq!(unit.identity().expect("answers").unit, UnitName::UNNAMED);
        // A unit without a name gets one from its user, not from a file.
        let burn = |unit: &mut Unit, c: &Calibration, printed: &Burn| {
            unit.burn(c, printed, |_| {}).map_err(|e| e.why.to_string())
        };
        let (nothing, named) = (Burn::default(), Burn { unit: Some("HRG-7".into()), ..Burn::default() });
        let e = burn(&mut unit, &image(0, 1.5), &nothing).expect_err("refused");
        assert!(e.contains("has no name yet") && e.contains("--unit HRG-7"), "{e}");
        let after = burn(&mut unit, &image(0, 1.5), &named).expect("burnt");
        assert_eq!(after.identity.sequence, 1);
        let wrong = Calibration { unit: UnitName::new("HRG-8"), ..image(0, 2.0) };
        let e = burn(&mut unit, &wrong, &nothing).expect_err("refused");
        assert!(e.contains("HRG-8") && e.contains("nothing was written"), "{e}");
        let e = burn(&mut unit, &Calibration::uncalibrated(), &nothing).expect_err("refused");
        assert!(e.contains("no calibration"), "{e}");
        assert_eq!(burn(&mut unit, &image(0, 2.5), &nothing).expect("burnt").identity.sequence, 2);
    });
    power(&|| {
        let mut unit = Unit::open(&link).expect("a port");
        let (identity, images) = unit.read().expect("readable");
        assert_eq!(identity.sequence, 2);
        // Both burns went into the first sector, one behind the other.
        let offset = room(image(1, 1.5).to_bytes().expect("fits").len()) as u32;
        assert_eq!(images.in_use, Some((Place { sector: Sector::A, offset }, Ok(image(2, 2.5)))));
        assert_eq!(images.newest, images.in_use);
        // A recording of the unit, with the image applied: its rates are the raw ones all the same.
        let mut recorder = Recorder::new(&d.join("run.csv"), "HRG-7");
        while recorder.rows() < 200 {
            if let Some(Message::Housekeeping(h)) = unit.next(Duration::from_secs(2)).expect("the port is there") {
                if h.step > 3 {
                    assert_eq!((h.bias_dph[0], h.sequence, h.created_unix_s), (2.5, 2, 1_795_219_200));
                }
                recorder.push(&Second::from(&h)).expect("written");
            }
        }
    });
    let r = Recording::load(&d.join("run.csv")).expect("a recording");
    assert!(!r.corrected() && r.unit() == "HRG-7" && r.time_s.len() == 200);
    // The means of the rate path end some 70 ms after the second, by the time that the unit takes to start: the share of
    // the next second is found from the row that tells it best, and is that of every row.
    let pair = |k: usize| -> [f64; 2] {
        let at = (r.time_s[k] - 1.0) as usize;
        [steps.rate_dph[0][at], steps.rate_dph[0][at + 1]]
    };
    let change = |k: &usize| (pair(*k)[1] - pair(*k)[0]).abs();
    let best = (10..200).max_by(|a, b| change(a).total_cmp(&change(b))).expect("rows");
    let share = (r.rate_dph[0][best] - pair(best)[0]) / (pair(best)[1] - pair(best)[0]);
    assert!((0.06..0.08).contains(&share), "{share}");
    for k in 10..200 {
        let [this, next] = pair(k);
        let expected = this + share * (next - this);
        assert!((r.rate_dph[0][k] - expected).abs() < 0.002, "row {k}: {} for {expected}", r.rate_dph[0][k]);
    }
}

#[test]
fn maintenance_ends_by_itself() {
    let (elf, old) = (elf(), image(1, 1.0));
    let wires = Wires::new(steps(), [0.01; 3], 0.0, 1, None, Some(Decoder::new(&elf).expect("a table"))).live();
    let mut board = Board::new(&elf, wires).expect("a board");
    board.write_flash(CALIBRATION_A, &old.to_bytes().expect("fits")).expect("in flash");
    board.run_until(CPU_HZ / 10).expect("runs");
    let printed = |board: &mut _, command| host::maintain(board, command).expect("answers").expect("nothing stops it");
    let begin = Command::Begin(500);
    assert_eq!(printed(&mut board, begin), Answer::NotOpen, "closed at first");
    assert_eq!(printed(&mut board, Command::Open(old.unit)), Answer::Done);
    assert_eq!(printed(&mut board, begin), Answer::Done);
    let later = board.now() + 125 * CPU_HZ;
    board.run_until(later).expect("runs");
    assert_eq!(printed(&mut board, begin), Answer::NotOpen, "two minutes without a command");
    assert_eq!(host::running(&mut board, 1.0).expect("answers").calibration, old.checksum());
}

#[test]
fn the_log_alone_gives_the_same_recording_as_the_link() {
    let elf = elf();
    let d = folder("log");
    let steps = steps();
    let options = replay::Options { seconds: Some(60), compare: false, ..replay::Options::default() };
    let outcome = replay::run(&elf, Some(&image(1, 0.5)), &steps, &options, |_| {}).expect("runs");
    let mut from_link = Recorder::new(&d.join("link.csv"), "HRG-7");
    for h in &outcome.received.housekeeping {
        from_link.push(&Second::from(h)).expect("written");
    }
    let mut from_log = Recorder::new(&d.join("log.csv"), "?");
    for line in &outcome.received.log {
        if let Some(name) = hrg::unit::record::unit_in_log(line) {
            from_log.head.unit = name.into();
        }
        if let Some(s) = Second::from_log(line) {
            from_log.push(&s).expect("written");
        }
    }
    let read = |name: &str| std::fs::read_to_string(d.join(name)).expect("there");
    // The last second may be on one way and not yet on the other.
    let (a, b) = (read("link.csv"), read("log.csv"));
    let lines = a.lines().count().min(b.lines().count());
    assert!(lines > 60, "{lines} lines");
    assert!(a.lines().take(lines).eq(b.lines().take(lines)));
}
