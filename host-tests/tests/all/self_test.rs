//! The built-in test on the ELF: a good unit passes, and each fault that it is there for makes it fail.

use crate::support::field_log;
use hrg_board::host::{ask, maintain, self_test};
use hrg_board::replay::{default_elf, read_elf, CALIBRATION_A};
use hrg_board::wires::{AdcFault, AxisFault, WireFaults, Wires};
use hrg_core::events::Event;
use hrg_core::link::Message;
use hrg_core::maintenance::{Answer, Command, Reply};
use hrg_core::self_test::{Check, Item, Verdict};
use hrg_core::status::UnitStatus;
use hrg_core::unit_name::UnitName;
use hrg_study::faults::Scene;
use std::sync::LazyLock;
use virtual_board::ads131m08::Defect;
use virtual_board::chip_adc::Ambient;
use virtual_board::{Board, Firmware, CPU_HZ, FLASH_START};

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    Scene::new(&elf, 1).expect("a scene")
});

/// Seconds of the fault: from the middle of the settled time on.
const ALWAYS: std::ops::Range<f64> = 0.0..1e9;

fn items(board: &mut Board<Wires>) -> Vec<Item> {
    self_test(board, SCENE.calibration.unit).expect("answers").expect("goes on")
}

fn failures(items: &[Item]) -> Vec<(Check, u8)> {
    items.iter().filter(|i| i.verdict() == Verdict::Fail).map(|i| (i.check, i.index)).collect()
}

/// A settled unit with pulses per second, so far apart.
fn good(every_s: f64) -> Board<Wires> {
    let pulses = WireFaults { pulses: Some((0.5, every_s)), ..WireFaults::default() };
    let mut board = SCENE.off(SCENE.wires().with_faults(pulses), &SCENE.calibration).expect("runs");
    SCENE.keep(&mut board).expect("kept");
    board.reset_by_software().expect("restarts");
    board.run_until(40 * CPU_HZ).expect("runs");
    board
}

#[test]
fn a_good_unit_passes_flags_its_rates_meanwhile_and_keeps_a_record() {
    let mut board = good(1.000_01);
    board.world.received.rates.clear();
    let items = items(&mut board);
    assert_eq!(failures(&items), []);
    let verdicts = items.iter().filter(|i| i.verdict() == Verdict::Pass).count();
    assert_eq!((items.len(), verdicts), (53, 53), "{items:?}");
    // No rate went out of the test's voltages; those of its time are flagged.
    let sent = std::mem::take(&mut board.world.received.rates);
    let clean = sent.iter().filter(|f| f.unit_status.is_empty()).count();
    let flagged = sent.len() - clean;
    let largest = sent.iter().flat_map(|f| f.rate_dph).fold(0.0f32, |m, r| m.max(r.abs()));
    assert!(flagged > 600 && clean < 60, "{flagged} flagged, {clean} clean");
    assert!(largest < 100.0, "{largest} deg/h");
    board.run_until(board.now() + 3 * CPU_HZ).expect("runs");
    let after = std::mem::take(&mut board.world.received.rates);
    let since = after.iter().rposition(|f| !f.unit_status.is_empty()).map_or(0, |at| at + 1);
    assert!(after.len() - since > 380, "{} of {} are good", after.len() - since, after.len());
}

/// Bit of the record of the calibration in flash, and of the program.
const IN_IMAGE: u32 = FLASH_START + CALIBRATION_A + 100;

type Break = Box<dyn Fn(&mut Board<Wires>)>;

/// A fault while the unit runs, and an item that it makes fail.
fn faults() -> Vec<(&'static str, Break, (Check, u8))> {
    let channel = |n: usize, defect: Defect| -> Break { Box::new(move |b| b.break_channel(n, defect)) };
    let wires = |faults: WireFaults| -> Break { Box::new(move |b| b.world.set_faults(faults.clone())) };
    let axis =
        |a: usize, fault: AxisFault| wires(WireFaults { axis: vec![(a, fault, ALWAYS)], ..WireFaults::default() });
    let adc = |fault: AdcFault| wires(WireFaults { adc: vec![(fault, ALWAYS)], ..WireFaults::default() });
    let right = Defect::NONE;
    vec![
        ("gain of a rate channel 5 % low", channel(0, Defect { gain: 950, ..right }), (Check::Positive, 0)),
        ("gain of an accelerometer channel 3 % high", channel(3, Defect { gain: 1030, ..right }), (Check::Negative, 3)),
        ("a rate channel with the wrong sign", channel(1, Defect { gain: -1000, ..right }), (Check::Positive, 1)),
        ("a dead channel", channel(2, Defect { gain: 0, ..right }), (Check::Noise, 2)),
        (
            "a channel at its end of scale",
            channel(6, Defect { gain: 0, offset: 8_388_607, ..right }),
            (Check::Offset, 6),
        ),
        ("an offset of 2 mV", channel(4, Defect { offset: 14_000, ..right }), (Check::Offset, 4)),
        ("a noisy channel", channel(5, Defect { noise: 1000, ..right }), (Check::Noise, 5)),
        ("a multiplexer that does not switch", channel(0, Defect { at_pins: true, ..right }), (Check::Positive, 0)),
        ("a rate that oscillates", channel(2, Defect { noise: 300_000, ..right }), (Check::RateNoise, 2)),
        ("a rate whose code stands still", adc(AdcFault::Stuck), (Check::RateNoise, 0)),
        ("an ADC that is silent", adc(AdcFault::Silent), (Check::Samples, 0)),
        ("an ADC at half its rate", adc(AdcFault::HalfRate), (Check::Samples, 0)),
        (
            "a disturbed bus",
            wires(WireFaults { invalidate_every: Some(300), ..WireFaults::default() }),
            (Check::SamplesLost, 0),
        ),
        ("a resonator that is silent", axis(0, AxisFault::Stop), (Check::Temperature, 0)),
        ("a resonator outside its curve", axis(1, AxisFault::Drift(20.0)), (Check::Temperature, 1)),
        ("double edges", axis(2, AxisFault::Double(20e-6)), (Check::Edges, 2)),
        (
            "extra edges now and then",
            wires(WireFaults { glitch: Some((1, 60e-6)), ..WireFaults::default() }),
            (Check::Edges, 1),
        ),
        ("a bit of the program", Box::new(|b| b.flip_bit(in_program(), 3).expect("in flash")), (Check::Program, 0)),
        ("a bit of the image", Box::new(|b| b.flip_bit(IN_IMAGE, 5).expect("in flash")), (Check::Image, 0)),
        (
            "a supply of 2.9 V",
            Box::new(|b| b.set_ambient(Ambient { supply_v: 2.9, ..Ambient::default() })),
            (Check::SupplyVoltage, 0),
        ),
        (
            "a processor at 120 C",
            Box::new(|b| b.set_ambient(Ambient { temperature_c: 120.0, ..Ambient::default() })),
            (Check::ChipTemperature, 0),
        ),
        ("a supply that is too low", Box::new(|b| b.sag(27)), (Check::Supply, 0)),
        // (The last: no snapshot heals it.)
        ("a flash that is worn out", Box::new(Board::wear_flash_out), (Check::Log, 0)),
    ]
}

/// A byte of the program that never runs.
fn in_program() -> u32 {
    let firmware = Firmware::parse(SCENE.elf()).expect("an ELF");
    let last = firmware.flash().iter().take(0x4_0000).rposition(|b| *b != 0xFF).expect("a program");
    FLASH_START + last as u32 - 64
}

#[test]
fn each_fault_fails_its_item() {
    let mut board = good(1.0);
    let start = board.snapshot().expect("a moment");
    let mut missed = vec![];
    for (name, fault, wanted) in faults() {
        board.restore(&start).expect("back");
        fault(&mut board);
        // (A channel that jumps looks like motion: the service pin is tied low.)
        board.drive_pin(2, 13, false);
        let found = failures(&items(&mut board));
        if !found.contains(&wanted) {
            missed.push(format!("{name}: {found:?}"));
        }
    }
    assert!(missed.is_empty(), "{missed:#?}");
}

#[test]
fn a_clock_that_is_off_fails_against_the_pulses() {
    for (every, fails) in [(1.0, false), (1.000_09, false), (1.00013, true), (0.99987, true), (1.0007, true)] {
        let found = failures(&items(&mut good(every)));
        assert_eq!(found.contains(&(Check::Clock, 0)), fails, "a pulse each {every} s: {found:?}");
    }
}

/// The far end of the stack: the start of RAM.
const UNUSED: u32 = 0x2000_0000;

#[test]
fn faults_of_the_start_fail_it_and_are_in_the_field_log() {
    // At the stack's far end, which nothing uses.
    let stuck = |high| move |b: &mut Board<Wires>| b.stick_bit(UNUSED + 0x400, 17, high).expect("in RAM");
    let faults: [(&str, Break, Check); 5] = [
        (
            "two address lines are tied",
            Box::new(|b| b.join_words(UNUSED + (1 << 10), UNUSED + (1 << 9)).expect("in RAM")),
            Check::Memory,
        ),
        ("a bit of RAM is stuck low", Box::new(stuck(false)), Check::Memory),
        ("a bit of RAM is stuck high", Box::new(stuck(true)), Check::Memory),
        (
            "an address line is open",
            Box::new(|b| b.join_words(UNUSED + (1 << 14), UNUSED).expect("in RAM")),
            Check::Memory,
        ),
        ("a crystal of another frequency", Box::new(|b| b.set_crystal(12e6)), Check::Crystal),
    ];
    for (name, fault, wanted) in faults {
        let mut board = SCENE.off(SCENE.wires(), &SCENE.calibration).expect("runs");
        fault(&mut board);
        board.run_until(25 * CPU_HZ).expect("runs");
        let found = failures(&items(&mut board));
        assert!(found.contains(&(wanted, 0)), "{name}: {found:?}");
        if wanted == Check::Memory {
            let flags = board.world.received.rates.iter().map(|f| f.unit_status);
            assert!(flags.clone().count() > 1000 && flags.clone().all(|f| f.contains(UnitStatus::PROGRAM)), "{name}");
        }
        let log = field_log(&board);
        let told =
            |e: &Event| matches!(e, Event::Test { at_start: true, first: [check, 0], .. } if *check == wanted as u8);
        assert!(log.iter().any(|r| told(&r.event)), "{name}: {log:?}");
    }
}

#[test]
fn garbage_on_the_link_fails_it() {
    let mut board = good(1.0);
    let opened = maintain(&mut board, Command::Open(SCENE.calibration.unit)).expect("answers");
    assert_eq!(opened, Some(Answer::Done));
    board.world.hear(&Message::Maintain(Command::Test).encode());
    for _ in 0..20 {
        board.world.hear(&[7, 1, 2, 0]);
    }
    board.poll_link();
    board.run_until(board.now() + 8 * CPU_HZ).expect("runs");
    let item = (0..60).find_map(|number| {
        let tested = |m: &Message| match m {
            Message::Maintained(Reply::Tested { item, .. }) => Some(*item),
            _ => None,
        };
        let item = ask(&mut board, &Message::Maintain(Command::Tested(number)), 1.0, tested).expect("answers");
        item.filter(|i| i.check == Check::Link)
    });
    assert!(item.is_some_and(|i| i.value >= 20.0 && i.verdict() == Verdict::Fail), "{item:?}");
}

/// The image has rotted while the unit was off: it starts without, and the test says why.
#[test]
fn an_image_that_the_start_refused_fails_it() {
    let mut board = SCENE.off(SCENE.wires(), &SCENE.calibration).expect("runs");
    board.flip_bit(IN_IMAGE, 5).expect("in flash");
    board.run_until(20 * CPU_HZ).expect("runs");
    let found = self_test(&mut board, UnitName::default()).expect("answers").expect("goes on");
    assert!(failures(&found).contains(&(Check::Image, 0)), "{found:?}");
}
