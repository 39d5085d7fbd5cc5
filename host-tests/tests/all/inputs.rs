//! Inputs beside the frequencies, through the ELF: they come in by the link, the unit's biases are those of the desktop bit for bit, and
//! what is missing is flagged.

use hrg::unit::record::Recorder;
use hrg_board::replay::{self, read_elf, Options};
use hrg_board::wires::WireFaults;
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::EffectId;
use hrg_core::inputs::{drive, Input, InputValues, QuantitySet, BOARD, CHIP_C, CHIP_V};
use hrg_core::link::{Housekeeping, Message};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit::correct;
use std::ops::Range;
use std::path::Path;

#[test]
#[ignore = "cargo xtask test --rest"]
fn drives_at_the_adc_are_inputs_as_the_desktop_has_them() {
    let usual = replay::default_elf();
    let target = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../target"));
    let path = target.join("aux/thumbv7em-none-eabihf/firmware/firmware");
    assert!(usual.ends_with("thumbv7em-none-eabihf/firmware/firmware"));
    let elf = read_elf(&path).expect("cargo xtask size --aux builds it");
    let mut steps = steps();
    // (The other axes' drives are open wires.)
    let wave = steps.given[usize::from(drive(1))].clone();
    steps.given[usize::from(drive(0))].fill(f32::NAN);
    steps.given[usize::from(drive(2))].fill(f32::NAN);
    let options = Options { seconds: Some(120), ..Options::default() };
    let o =
        replay::run(&elf, Some(&calibration()), &steps, &options, |_| {}).expect("the board models all that it does");
    let r = &o.received;
    assert_eq!((r.differing, r.bad_frames), (0, 0), "{:?}", r.first_difference);
    for (h, used) in r.housekeeping.iter().zip(&r.inputs_used).skip(2) {
        assert_eq!(h.step, used.step);
        // The mean over the second: some samples of it are those of the second before.
        let k = h.step as usize;
        let read = used.values[usize::from(drive(1))];
        assert!((read - wave[k]).abs() < 2e-4, "step {k}: {read} {}", wave[k]);
        assert!(
            used.values[usize::from(drive(0))].is_nan() && !h.axis_status[1].contains(AxisStatus::INPUT),
            "{:?}",
            h.axis_status
        );
    }
}

/// The drive voltage of y, and the board's temperature behind lags on z.
fn calibration() -> Calibration {
    let mut c = Calibration::uncalibrated();
    c.set_unit_name("SIM-11");
    c.calibrated = true;
    c.axes.iter_mut().for_each(|a| a.uncertainty.rest_dph2 = 0.01);
    let mut term = EffectTerm::new(EffectId::DriveAmplitude.facts().id, [0.0; 2]);
    term.gains[1][0] = 100.0;
    c.effects.push(term).expect("room");
    let mut term = EffectTerm::new(EffectId::RecordedQuantity.facts().id, [f32::from(BOARD), 0.0]);
    term.gains[2] = [0.1, 0.01, 0.2, 0.5, -0.3, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    c.effects.push(term).expect("room");
    let of = |quantity, reference, from, to, without_dph| Input {
        quantity,
        reference,
        valid_from: from,
        valid_to: to,
        without_dph,
        ..Input::default()
    };
    c.inputs.push(of(drive(1), 1.2, 1.0, 1.4, [0.0, 5.0, 0.0])).expect("room");
    c.inputs[0].expected[1][0] = TOLD_DPH;
    c.inputs.push(of(BOARD, 20.0, -30.0, 70.0, [0.0, 0.0, 2.0])).expect("room");
    c
}

fn steps() -> Steps {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/simulated-ramp.csv"));
    let mut steps = Steps::new(&Recording::load(path).expect("usable")).expect("long enough");
    steps.unit_inputs = QuantitySet::BOARD.union(QuantitySet::one(drive(1)));
    let n = steps.len();
    let wave = |k: usize, period: f32| (k as f32 / period).sin();
    steps.given[usize::from(drive(1))] = (0..n).map(|k| 1.2 + 0.1 * wave(k, 30.0)).collect();
    steps.given[usize::from(BOARD)] = (0..n).map(|k| 25.0 + 10.0 * wave(k, 200.0)).collect();
    steps
}

/// In the place of the drive's effect while it is missing, deg/h.
const TOLD_DPH: f32 = 0.75;

const MISSING: Range<usize> = 60..90;
const OUTSIDE: Range<usize> = 120..130;

#[test]
fn an_image_with_inputs_flies_bit_for_bit_and_a_missing_one_is_flagged() {
    let elf = read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let mut steps = steps();
    steps.given[usize::from(drive(1))][MISSING].fill(f32::NAN);
    steps.given[usize::from(drive(1))][OUTSIDE].fill(1.5);
    let options = Options { seconds: Some(201), ..Options::default() };
    let o =
        replay::run(&elf, Some(&calibration()), &steps, &options, |_| {}).expect("the board models all that it does");
    let r = &o.received;
    assert_eq!((r.differing, r.bad_frames, o.watchdog_resets), (0, 0, 0), "{:?}", r.first_difference);
    assert!(r.housekeeping.len() >= 199 && r.inputs_used.len() + 1 >= r.housekeeping.len());
    // A second counts the values that came within it, and for three seconds none is missed.
    let flagged = |h: &Housekeeping| h.axis_status.map(|s| s.contains(AxisStatus::INPUT));
    for h in r.housekeeping.iter().skip(2) {
        let k = h.step as usize;
        let wanted = (MISSING.start + 2..MISSING.end).contains(&k) || OUTSIDE.contains(&k);
        assert_eq!(flagged(h), [false, wanted, false], "step {k}");
        let std = h.bias_std_dph[1];
        assert!((std - if wanted { 25.01f32.sqrt() } else { 0.1 }).abs() < 1e-4, "step {k}: {std}");
        assert!(!h.unit_status.contains(UnitStatus::LINK_ERRORS));
        // Within its three seconds the last value counts; then what temperature and ramp tell of it; nothing else moves y.
        let wanted = match k {
            _ if (MISSING.start + 2..MISSING.end).contains(&k) => TOLD_DPH,
            _ if MISSING.contains(&k) => 100.0 * (steps.given[usize::from(drive(1))][MISSING.start - 1] - 1.2),
            _ => 100.0 * (steps.given[usize::from(drive(1))][k] - 1.2),
        };
        assert!((h.bias_dph[1] - wanted).abs() < 1e-4, "step {k}: {} {wanted}", h.bias_dph[1]);
    }
    // The recording of it holds the inputs, and the desktop computes the same of the file.
    let path = host_tests::temporary("inputs").join("unit.csv");
    let mut recorder = Recorder::new(&path, "SIM-11");
    let mut used = r.inputs_used.iter().peekable();
    for h in &r.housekeeping {
        while let Some(u) = used.next_if(|u| u.step <= h.step) {
            recorder.take_inputs(*u);
        }
        let (second, late) = recorder.second(h);
        assert!(late.is_empty());
        recorder.push(&second).expect("written");
    }
    let again = Recording::load(&path).expect("readable");
    assert_eq!(again.meta("unit_inputs"), Some("board_c, drive_y_v, chip_c, chip_v"));
    let seconds = correct::recording(&calibration(), &again).expect("usable").seconds;
    assert_eq!(seconds.len(), r.housekeeping.len());
    for (ours, h) in seconds.iter().zip(&r.housekeeping) {
        assert_eq!(ours.bias_dph.map(f32::to_bits), h.bias_dph.map(f32::to_bits), "step {}", h.step);
        assert_eq!(ours.bias_std_dph[1].to_bits(), h.bias_std_dph[1].to_bits(), "step {}", h.step);
    }
}

/// The processor's own temperature, as its ADC shows it: codes of 0.1 C, that stand for long; a message cannot replace it.
#[test]
fn the_processors_temperature_is_an_input_and_no_message_replaces_it() {
    let elf = read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first");
    let mut steps = steps();
    steps.unit_inputs = QuantitySet::CHIP;
    let n = steps.len();
    steps.given[usize::from(CHIP_C)] =
        (0..n).map(|k| 40.0 + if k < 60 { 0.0 } else { 0.05 * (k - 60) as f32 }).collect();
    steps.given[usize::from(CHIP_V)] = vec![3.25; n];
    let mut image = calibration();
    image.effects.clear();
    image.inputs.clear();
    let mut term = EffectTerm::new(EffectId::RecordedQuantity.facts().id, [f32::from(CHIP_C), 0.0]);
    term.gains[0][0] = 1.0;
    image.effects.push(term).expect("room");
    let input = Input {
        quantity: CHIP_C,
        reference: 40.0,
        valid_from: 20.0,
        valid_to: 60.0,
        most_equal: 10,
        ..Input::default()
    };
    image.inputs.push(input).expect("room");
    // The electronics send another number under the same name.
    let other = Message::Inputs(InputValues::of([(CHIP_C, 55.0)])).encode();
    let link_in = (0..100).flat_map(|k| other.iter().map(move |b| (5.3 + f64::from(k), *b))).collect();
    let faults = WireFaults { link_in, ..WireFaults::default() };
    let options = Options { seconds: Some(120), faults, compare: false, ..Options::default() };
    let sent = replay::run(&elf, Some(&image), &steps, &options, |_| {}).expect("runs").received;
    for h in sent.housekeeping.iter().skip(2) {
        let k = h.step as usize;
        assert!(!h.axis_status[0].contains(AxisStatus::INPUT), "step {k}");
        let wanted = steps.given[usize::from(CHIP_C)][k] - 40.0;
        assert!((h.bias_dph[0] - wanted).abs() < 0.3, "step {k}: {} {wanted}", h.bias_dph[0]);
    }
    let options = Options { seconds: Some(120), ..Options::default() };
    let r = replay::run(&elf, Some(&image), &steps, &options, |_| {}).expect("runs").received;
    assert_eq!((r.differing, r.bad_frames), (0, 0), "{:?}", r.first_difference);
}
