//! A firmware without the parts that a unit can do without: it runs on the virtual board, its frames are those of the desktop, and it
//! refuses what it was built without.

use hrg_align::Refusal;
use hrg_board::replay::{self, parts, read_elf, Options};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::EffectId;
use hrg_core::inputs::{self, Input};
use hrg_core::parts::Parts;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use std::path::Path;
use virtual_board::Firmware;

/// `cargo xtask size --minimal`, and `cargo xtask test --rest` for the others, build them there.
fn elf(name: &str) -> Vec<u8> {
    let top = concat!(env!("CARGO_MANIFEST_DIR"), "/../target");
    let path = format!("{top}/{name}/thumbv7em-none-eabihf/firmware/firmware");
    read_elf(Path::new(&path)).expect("cargo xtask size --minimal builds it")
}

fn steps() -> Steps {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/simulated-ramp.csv"));
    Steps::new(&Recording::load(path).expect("usable")).expect("long enough")
}

/// With a lag of 20 s on x and a play of 2 C on y.
fn calibration() -> Calibration {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("SIM-11");
    c.calibrated = true;
    for (effect, parameter, axis) in [(EffectId::ThermalLag, 20.0, 0), (EffectId::Hysteresis, 2.0, 1)] {
        let mut term = EffectTerm::new(effect.facts().id, [parameter, 0.0]);
        term.gains[axis][0] = 0.5;
        c.effects.push(term).expect("room");
    }
    c
}

/// Runs an ELF and compares every frame with the desktop; gives the flag of an unknown past of each second, by axis.
fn run(elf: &[u8], seconds: u64) -> Vec<[bool; 3]> {
    let options = Options { seconds: Some(seconds), ..Options::default() };
    let o =
        replay::run(elf, Some(&calibration()), &steps(), &options, |_| {}).expect("the board models all that it does");
    let r = &o.received;
    assert_eq!(r.differing, 0, "{:?}", r.first_difference);
    assert_eq!((o.watchdog_resets, r.bad_frames), (0, 0));
    assert!(r.housekeeping.len() as u64 + 2 >= seconds);
    r.housekeeping.iter().map(|h| h.axis_status.map(|s| s.contains(AxisStatus::HISTORY_UNKNOWN))).collect()
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_unit_that_takes_no_inputs_refuses_an_image_that_needs_one() {
    let mut needs = calibration();
    let mut term = EffectTerm::new(EffectId::DriveAmplitude.facts().id, [0.0; 2]);
    term.gains[0][0] = 1.0;
    needs.effects.push(term).expect("room");
    needs.inputs.push(Input { quantity: inputs::drive(0), ..Input::default() }).expect("room");
    let options = Options { seconds: Some(4), compare: false, ..Options::default() };
    let o = replay::run(&elf("minimal"), Some(&needs), &steps(), &options, |_| {}).expect("runs");
    let h = o.received.housekeeping.last().expect("some");
    let refused = UnitStatus::DEFAULT_CALIBRATION | UnitStatus::IMAGE_REFUSED;
    assert!(h.unit_status.contains(refused) && h.bias_dph == [0.0; 3], "{h:?}");
    let logged = "calibration refused: NotOnUnit(14)";
    assert!(o.received.log.iter().any(|line| line.contains(logged)), "{:?}", o.received.log);
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn the_smallest_unit_sends_what_the_desktop_does_and_flags_an_unknown_past() {
    let elf = elf("minimal");
    assert_eq!(parts(&Firmware::parse(&elf).expect("an ELF")), Parts::empty());
    let unknown = run(&elf, 100);
    // Three time constants of the lag; z has no effect. (The play is swept when the temperature has gone 2 C.)
    let last = |a: usize| unknown.iter().rposition(|u| u[a]);
    println!("flagged until second {:?}", [0, 1, 2].map(last));
    assert!(last(0).is_some_and(|s| (55..=75).contains(&s)), "{:?}", last(0));
    assert!(unknown[0][1] && last(2).is_none());
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn the_smallest_unit_says_that_it_has_no_alignment() {
    let (recording, _) = hrg_align_tools::plant::Plant::chen(1).play();
    let a = hrg_study::align::align(&elf("minimal"), &recording, None).expect("runs");
    assert_eq!(a.outcome.received.differing, 0, "{:?}", a.outcome.received.first_difference);
    let refusals: Vec<u8> = a.reports.iter().map(|r| r.refusal).collect();
    assert_eq!(refusals, [Refusal::NotBuiltIn as u8]);
    let why = Refusal::from_number(refusals[0]).expect("a refusal").to_string();
    assert!(why.contains("feature align"), "{why}");
}

#[test]
#[ignore = "cargo xtask test --rest builds these"]
fn each_part_may_be_left_out_alone() {
    for (name, part) in [
        ("align", Parts::ALIGN),
        ("pps", Parts::PPS),
        ("field-log", Parts::FIELD_LOG),
        ("lockstep", Parts::LOCKSTEP),
        ("past", Parts::PAST),
        ("inputs", Parts::INPUTS),
        ("self-test", Parts::SELF_TEST),
    ] {
        let elf = elf(&format!("without-{name}"));
        assert_eq!(
            parts(&Firmware::parse(&elf).expect("an ELF")),
            Parts::all().difference(part | Parts::AUX),
            "{name}"
        );
        let unknown = run(&elf, 30);
        assert!(unknown[2][0] && !unknown[2][2], "{name}");
    }
}
