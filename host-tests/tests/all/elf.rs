//! The firmware ELF, as it is flashed, on the virtual board.

use hrg_align::{wrap, Refusal, ARCMIN, DEGREE, DPH};
use hrg_align_tools::plant::Plant;
use hrg_align_tools::{FilterKind, Start};
use hrg_board::host::{maintain, running};
use hrg_board::replay::{self, Options, Outcome, CALIBRATION_A, CALIBRATION_B};
use hrg_board::wires::{AdcFault, AxisFault, WireFaults, Wires};
use hrg_board::KEPT_STATES;
use hrg_core::accelerometers::Accelerometers;
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::{self, Facts, Reach};
use hrg_core::frequency::StepFrequencies;
use hrg_core::history::KEPT_WORDS;
use hrg_core::link::Message;
use hrg_core::maintenance::{chunks, Answer, Command};
use hrg_core::reset::ResetCause;
use hrg_core::sectors::{room, SECTOR_BYTES, STEP};
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_data::log::Decoder;
use hrg_data::numeric::draws::Draws;
use hrg_data::numeric::stats;
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use hrg_identify::fit::correct::Model;
use hrg_identify::fit::prepare;
use hrg_papers::method::Method;
use hrg_papers::methods::identify;
use hrg_simulate::{Kind, Plan, Profile};
use hrg_study::align::align;
use hrg_study::faults::{good, Scene};
use std::sync::OnceLock;
use virtual_board::{Board, Stop, CPU_HZ};

fn elf() -> Vec<u8> {
    replay::read_elf(&replay::default_elf()).expect("cargo xtask test builds the firmware first")
}

/// From its 300th second on: there the resonators warm up fast.
fn recording() -> Recording {
    const FILE: &str = include_str!("../../recordings/simulated-ramp.csv");
    let early = |line: &str| line.split_once(',').and_then(|(t, _)| t.parse().ok()).is_some_and(|t: f64| t < 300.0);
    let text: String = FILE.split_inclusive('\n').filter(|line| !early(line)).collect();
    let mut recording = Recording::parse(text.as_bytes()).expect("readable");
    recording.clean().expect("usable");
    recording
}

/// A calibration of the simulated unit that made the recording, from a run of its own.
fn calibration() -> Calibration {
    static ONCE: OnceLock<Calibration> = OnceLock::new();
    ONCE.get_or_init(|| {
        let plan = Plan::of(Profile::parse("cycle").expect("named"), 11, 12);
        let prepared = prepare(&[plan.simulate().recording]).expect("prepares");
        identify(&prepared, Method::Lsq, 1).expect("fits").calibration
    })
    .clone()
}

fn run(calibration: Option<&Calibration>, seconds: u64, faults: WireFaults, compare: bool) -> Outcome {
    let steps = Steps::new(&recording()).expect("long enough");
    let options = Options { seconds: Some(seconds), faults, compare, ..Options::default() };
    replay::run(&elf(), calibration, &steps, &options, |_| {}).expect("the board models all that the firmware does")
}

#[test]
fn every_frame_equals_the_desktop_bit_for_bit() {
    let o = run(Some(&calibration()), 120, WireFaults::default(), true);
    let r = &o.received;
    assert!(r.rates.len() > 23_500 && r.housekeeping.len() >= 118, "{} {}", r.rates.len(), r.housekeeping.len());
    assert_eq!(r.differing, 0, "{:?}", r.first_difference);
    assert_eq!((r.bad_frames, o.watchdog_resets), (0, 0));
    let last = r.housekeeping.last().expect("there are");
    assert_eq!(
        (last.axis_status, last.unit_status),
        ([AxisStatus::empty(); 3], UnitStatus::empty()),
        "nothing to complain of"
    );
    assert_eq!((last.samples, last.dropped), (1000, 0));
}

#[test]
fn a_broken_elf_is_refused_and_not_panicked_on() {
    let good = elf();
    let mut draws = Draws::new(99);
    let mut draw = |n: usize| draws.below(n);
    let (mut refused, mut loaded) = (0, 0);
    for k in 0..60 {
        let mut bad = good.clone();
        match k % 3 {
            // The headers are at the front, the tables of sections at the back.
            0 => bad.truncate(draw(good.len())),
            1 => (0..4).for_each(|_| bad[draw(400)] ^= 1 << draw(8)),
            _ => (0..4).for_each(|_| bad[good.len() - 1 - draw(2000)] ^= 1 << draw(8)),
        }
        match Board::new(&bad, virtual_board::NothingConnected) {
            Ok(_) => loaded += 1,
            Err(e) => {
                assert!(!e.to_string().is_empty());
                refused += 1;
            }
        }
        let _ = Decoder::new(&bad);
    }
    assert!(refused > 10 && loaded > 0, "{refused} refused, {loaded} loaded");
    assert!(Board::new(&[], virtual_board::NothingConnected).is_err());
}

#[test]
fn the_comparison_can_fail() {
    // The digital twin is given another calibration than the unit: every housekeeping must differ.
    let (mine, mut other) = (calibration(), calibration());
    other.axes[0].curve.temperature_coefficients_c[0] += 1e-3;
    let steps = Steps::new(&recording()).expect("long enough");
    let scale = mine.scale_factors_dph_per_code();
    let twin = hrg_board::twin::Twin::new(other, UnitStatus::empty(), hrg_core::parts::Parts::all());
    let mut board = Board::new(&elf(), Wires::new(steps, scale, 20e-9, 1, Some(twin), None)).expect("runs");
    board.write_flash(CALIBRATION_A, &mine.to_bytes().expect("fits")).expect("in flash");
    board.run_until(3 * CPU_HZ).expect("runs");
    assert!(board.world.received.differing > 0);
}

#[test]
fn one_second_gates_resolve_ten_microhertz() {
    // A steady resonator with 20 ns of jitter on every edge; theory says 4.9 uHz.
    let mut steps = Steps::new(&recording()).expect("long enough");
    for (f, hz) in steps.frequency_hz.iter_mut().zip([4898.626, 4890.667, 4702.343]) {
        f.fill(hz);
    }
    let options = Options { seconds: Some(64), ..Options::default() };
    let o = replay::run(&elf(), None, &steps, &options, |_| {}).expect("runs");
    for (a, hz) in [4898.626, 4890.667, 4702.343].into_iter().enumerate() {
        let errors: Vec<f64> = o.received.housekeeping.iter().skip(1).map(|h| h.frequency_hz[a] - hz).collect();
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        println!("axis {a}: {:.2} uHz RMS in a 1 s gate", rms * 1e6);
        assert!(rms < 10e-6, "axis {a}: {rms} Hz");
        assert!(stats::mean(&errors).abs() < 5e-6, "axis {a} is off by {}", stats::mean(&errors));
    }
}

#[test]
fn a_silent_resonator_is_flagged_and_the_others_do_not_notice() {
    let c = calibration();
    let good = run(Some(&c), 60, WireFaults::default(), true);
    let faults = WireFaults { axis: vec![(1, AxisFault::Stop, 20.0..40.0)], ..WireFaults::default() };
    let bad = run(Some(&c), 60, faults, true);
    assert_eq!(bad.received.differing, 0, "{:?}", bad.received.first_difference);
    assert_eq!(bad.watchdog_resets, 0);
    for (g, b) in good.received.rates.iter().zip(&bad.received.rates) {
        assert_eq!(
            (g.rate_dph[0].to_bits(), g.rate_dph[2].to_bits()),
            (b.rate_dph[0].to_bits(), b.rate_dph[2].to_bits())
        );
    }
    let h = |s: usize| bad.received.housekeeping[s];
    assert!(h(25).axis_status[1].contains(AxisStatus::FREQUENCY_LOST));
    assert!(h(25).frequency_hz[1].is_nan());
    assert_eq!(h(25).bias_dph[1], h(19).bias_dph[1], "the last bias is held");
    assert!(h(38).axis_status[1].contains(AxisStatus::TEMPERATURE_STALE));
    assert!(
        !h(50).axis_status[1].intersects(AxisStatus::FREQUENCY_LOST | AxisStatus::TEMPERATURE_STALE),
        "it recovers by itself"
    );
    assert!(bad.received.log.iter().any(|l| l.contains("NaN")), "the log says so");
}

#[test]
fn glitches_are_counted_and_harmless() {
    let c = calibration();
    let good = run(Some(&c), 20, WireFaults::default(), true);
    let bad = run(Some(&c), 20, WireFaults { glitch: Some((0, 40e-6)), ..WireFaults::default() }, true);
    assert_eq!(bad.received.differing, 0, "{:?}", bad.received.first_difference);
    let (g, b) = (good.received.housekeeping[10], bad.received.housekeeping[10]);
    assert!((4..=5).contains(&b.rejected[0]), "about one in a thousand of 4900: {}", b.rejected[0]);
    assert!(b.axis_status[0].contains(AxisStatus::EDGE_ERRORS));
    assert_eq!(g.frequency_hz[0].to_bits(), b.frequency_hz[0].to_bits(), "the frequency does not move");
}

#[test]
fn a_silent_adc_is_flagged_and_the_unit_runs_on() {
    let faults = WireFaults { adc: vec![(AdcFault::Silent, 5.0..12.0)], ..WireFaults::default() };
    let o = run(Some(&calibration()), 20, faults, false);
    assert_eq!(o.watchdog_resets, 0, "an ADC that stops is no reason to reset");
    let silent: Vec<_> =
        o.received.housekeeping.iter().filter(|h| h.unit_status.contains(UnitStatus::ADC_FAULT)).collect();
    assert!(silent.len() >= 6, "{} seconds flagged", silent.len());
    assert!(silent.iter().all(|h| h.frequency_hz.iter().all(|f| f.is_finite())), "temperatures go on");
    let after = o.received.rates.iter().find(|r| r.tick > 6 * 90_000_000).expect("rates come back");
    assert!(after.unit_status.contains(UnitStatus::ADC_FAULT), "the first frame after says that samples were lost");
    assert!(o.received.rates.last().is_some_and(|r| r.unit_status.is_empty()));
}

#[test]
fn corrupted_adc_frames_are_refused() {
    let o = run(Some(&calibration()), 20, WireFaults { invalidate_every: Some(100), ..WireFaults::default() }, true);
    assert_eq!(o.received.differing, 0, "{:?}", o.received.first_difference);
    let h = o.received.housekeeping[10];
    assert_eq!((h.samples, h.adc_errors), (990, 10));
    assert!(h.unit_status.contains(UnitStatus::ADC_FAULT));
}

#[test]
fn garbage_on_the_link_is_counted_and_commands_still_work() {
    let byte_time = 10.0 / 921_600.0;
    let mut t = 2.0;
    let mut link_in = Vec::new();
    let mut draws = Draws::new(7);
    for k in 0..3000 {
        link_in.push((t, if k % 50 == 0 { 0 } else { draws.below(256) as u8 }));
        t += byte_time;
    }
    link_in.push((t + byte_time, 0));
    for (k, b) in Message::Identify.encode().into_iter().chain(Message::SetDecimation(10).encode()).enumerate() {
        link_in.push((4.0 + k as f64 * byte_time, b));
    }
    let c = calibration();
    let o = run(Some(&c), 10, WireFaults { link_in, ..WireFaults::default() }, false);
    assert_eq!(o.watchdog_resets, 0);
    let h = o.received.housekeeping.last().expect("there are");
    assert!(h.link_errors > 30, "{} bad frames counted", h.link_errors);
    assert!(o.received.housekeeping.iter().any(|h| h.unit_status.contains(UnitStatus::LINK_ERRORS)));
    assert!(o.received.log.iter().any(|l| l.contains("status=") && l.contains(",04 ")), "the log says so");
    let identity = o.received.other.iter().find_map(|m| match m {
        Message::Identity(i) => Some(*i),
        _ => None,
    });
    assert_eq!(identity.map(|i| i.calibration), Some(c.checksum()));
    let late: Vec<_> = o.received.rates.iter().filter(|r| r.tick > 8 * 90_000_000).collect();
    assert!(late.windows(2).all(|w| w[1].sample - w[0].sample == 10), "the decimation was set");
    assert!(o.received.rates.windows(2).all(|w| w[1].sample - w[0].sample <= 10), "no frame was lost");
}

#[test]
fn a_broken_image_is_refused_and_the_default_used() {
    let steps = Steps::new(&recording()).expect("long enough");
    let mut image = calibration().to_bytes().expect("fits");
    image[100] ^= 1;
    let elf = elf();
    let wires =
        Wires::new(steps, [hrg_core::calibration::DEFAULT_SCALE_FACTOR; 3], 0.0, 1, None, Decoder::new(&elf).ok());
    let mut board = Board::new(&elf, wires).expect("runs");
    board.write_flash(CALIBRATION_A, &image).expect("in flash");
    board.run_until(3 * CPU_HZ).expect("runs");
    let h = board.world.received.housekeeping.last().expect("there are");
    assert_eq!(h.unit_status, UnitStatus::DEFAULT_CALIBRATION | UnitStatus::IMAGE_REFUSED);
    assert!(h.axis_status.iter().all(|s| s.contains(AxisStatus::UNCALIBRATED)));
    assert!(board.world.received.log.iter().any(|l| l.contains("calibration refused: Checksum")));
}

#[test]
fn the_newer_of_two_images_is_used() {
    let steps = Steps::new(&recording()).expect("long enough");
    let (mut a, mut b) = (calibration(), calibration());
    (a.sequence, b.sequence) = (4, 5);
    let elf = elf();
    let mut board = Board::new(&elf, Wires::new(steps, [1.0; 3], 0.0, 1, None, None)).expect("runs");
    board.write_flash(CALIBRATION_A, &a.to_bytes().expect("fits")).expect("in flash");
    board.write_flash(CALIBRATION_B, &b.to_bytes().expect("fits")).expect("in flash");
    board.run_until(3 * CPU_HZ).expect("runs");
    assert_eq!(board.world.received.housekeeping.last().map(|h| h.calibration), Some(b.checksum()));
}

#[test]
fn the_stack_stays_small_and_the_load_low() {
    let steps = Steps::new(&recording()).expect("long enough");
    let elf = elf();
    let mut board = Board::new(&elf, Wires::new(steps, [0.01; 3], 20e-9, 1, None, None)).expect("runs");
    board.run_until(2 * CPU_HZ).expect("runs");
    let before = board.instructions();
    board.run_until(12 * CPU_HZ).expect("runs");
    let per_second = (board.instructions() - before) / 10;
    // 1.6 % of 180 MHz. Counted, not timed: the same on every machine.
    assert!(per_second < 2_900_000, "{per_second} instructions per second");
    let stack = board.stack_used();
    // Together with static RAM it is bounded by cargo xtask bench.
    assert!((1000..54_700).contains(&stack), "{stack} bytes of stack");
    println!("{per_second} instructions per second, {stack} bytes of stack");
}

#[test]
fn a_power_cut_at_any_instruction_is_survived() {
    let steps = Steps::new(&recording()).expect("long enough");
    let elf = elf();
    let mut board = Board::new(&elf, Wires::new(steps, [0.01; 3], 20e-9, 1, None, None)).expect("runs");
    let c = calibration();
    board.write_flash(CALIBRATION_A, &c.to_bytes().expect("fits")).expect("in flash");
    let mut draws = Draws::new(12345);
    for _ in 0..20 {
        // Somewhere in start-up or in the first second.
        board.stop_at_instruction(board.instructions() + draws.below(2_000_000) as u64);
        assert_eq!(board.run_until(board.now() + 2 * CPU_HZ).expect("runs"), Stop::Instruction);
        board.power_cut().expect("restarts");
        board.world.received.housekeeping.clear();
    }
    board.run_until(board.now() + 3 * CPU_HZ).expect("runs");
    let h = board.world.received.housekeeping.last().expect("it measures again");
    assert_eq!(h.calibration, c.checksum());
    assert!(h.frequency_hz.iter().all(|f| f.is_finite()));
}

#[test]
fn every_kind_of_model_runs_on_the_unit_as_on_the_desktop() {
    // One method of each kind of image. The recording's ramp moves all their inputs.
    let cycle = |kind, profile: &str| {
        let plan = Plan { kind, ..Plan::of(Profile::parse(profile).expect("named"), 11, 12) };
        prepare(&[plan.simulate().recording]).expect("prepares")
    };
    let (hrg, fog) = (cycle(Kind::Hrg, "cycle"), cycle(Kind::Fog, "wu"));
    let models = [
        (Method::TwoSets, &hrg),
        (Method::FogLsq, &fog),
        (Method::FogLiteral, &fog),
        (Method::Polynomial, &hrg),
        (Method::GaBp, &hrg),
        (Method::Direct, &hrg),
    ];
    for (method, prepared) in models {
        let calibration = identify(prepared, method, 1).expect("identifies").calibration;
        let outcome = run(Some(&calibration), 25, WireFaults::default(), true);
        let r = &outcome.received;
        assert!(r.rates.len() > 4_400, "{method}: {}", r.rates.len());
        assert_eq!(r.differing, 0, "{method}: {:?}", r.first_difference);
        let last = r.rates.last().expect("many");
        assert!(r.housekeeping.last().expect("many").bias_dph.iter().all(|b| *b != 0.0), "{method}: {last:?}");
    }
}

#[test]
fn the_unit_aligns_as_the_desktop_and_hands_its_drifts_on() {
    let (recording, truth) = Plant::chen(3).play();
    let a = align(&elf(), &recording, None).expect("runs");
    let r = &a.outcome.received;
    assert_eq!(r.differing, 0, "{:?}", r.first_difference);
    let seconds = recording.rows.last().expect("rows").0 as usize;
    assert!((seconds..seconds + 3).contains(&a.reports.len()), "{} reports", a.reports.len());
    let last = a.last().expect("reports");
    assert_eq!(last.refusal, 0);
    let error = wrap(f64::from(last.azimuth_deg) * DEGREE - truth.azimuth) / ARCMIN;
    assert!(error.abs() < 3.0 * f64::from(last.azimuth_std_arcmin), "{error}'");
    // The desktop's tool on the recording itself: readings differ by the rounding to codes only.
    let desktop = hrg_align_tools::align(&recording, FilterKind::Linear, Start::default()).expect("aligns");
    let off = (desktop.azimuth_deg - f64::from(last.azimuth_deg)).abs() * 60.0;
    assert!(off < 0.56, "{off}' apart");
    // Before the turn there was no azimuth to be had.
    assert!(a.reports.iter().filter(|r| r.stage < 3).all(|r| r.refusal != 0 && r.azimuth_deg.is_nan()));
    // Accepted: what the platform drifts by is off the rates, with the opposite sign.
    let bias =
        |t: f64| r.housekeeping.iter().find(|h| f64::from(h.time_ms) > t * 1000.0).expect("long enough").bias_dph;
    let (before, after) = (bias(a.accepted_s - 3.0), bias(a.accepted_s + 2.5));
    for k in 0..2 {
        let trim = after[k] - before[k];
        assert!((trim + last.drift_dph[k]).abs() < 1e-3, "axis {k}: {trim} for {}", last.drift_dph[k]);
    }
    assert_eq!(before[2], after[2]);
    let modes: Vec<u8> = r.housekeeping.iter().map(|h| h.mode).collect();
    assert!(modes.contains(&1) && modes.last() == Some(&0), "align mode is reported, and left");
}

#[test]
fn the_image_holds_errors_of_accelerometers_and_large_drifts_may_be_expected() {
    let errors = Accelerometers { bias_mps2: [2e-4, -3e-4], matrix: [[1.02, 0.003], [-0.002, 1.02]] };
    let (mut recording, truth) =
        Plant { drift: [1.5 * DPH, -1.1 * DPH, 0.2 * DPH], seconds: [45, 30, 45], ..Plant::chen(3) }.play();
    let mut begun = [None; 2];
    for (t, position, v) in &mut recording.rows {
        let start = *begun[usize::from(*position == 2)].get_or_insert(*t);
        let (b, m) = (errors.bias_mps2.map(f64::from), errors.matrix.map(|row| row.map(f64::from)));
        *v = [0, 1].map(|k: usize| b[k] * (*t - start) + m[k][0] * v[0] + m[k][1] * v[1]);
    }
    let calibration = Calibration { accelerometers: errors, ..Calibration::uncalibrated() };
    let mut run = |drift_dph: f64, calibration: &Calibration| {
        recording.drift_dph = Some(drift_dph);
        let a = align(&elf(), &recording, Some(calibration)).expect("runs");
        assert_eq!(a.outcome.received.differing, 0, "{:?}", a.outcome.received.first_difference);
        *a.last().expect("reports")
    };
    let last = run(1.5, &calibration);
    assert_eq!(last.refusal, 0);
    let error = wrap(f64::from(last.azimuth_deg) * DEGREE - truth.azimuth) / ARCMIN;
    assert!(error.abs() < 3.0 * f64::from(last.azimuth_std_arcmin), "{error}'");
    // Without the errors in the image, or with drifts that nobody expected, there is no azimuth.
    assert_ne!(run(1.5, &Calibration::uncalibrated()).refusal, 0);
    assert_ne!(run(0.1, &calibration).refusal, 0);
}

#[test]
fn no_turn_or_no_latitude_no_azimuth() {
    let (mut recording, _) = Plant { seconds: [40, 0, 0], ..Plant::chen(3) }.play();
    let a = align(&elf(), &recording, None).expect("runs");
    assert_eq!(a.outcome.received.differing, 0, "{:?}", a.outcome.received.first_difference);
    assert!(a.reports.iter().all(|r| r.refusal == Refusal::OnePosition as u8 && r.azimuth_deg.is_nan()));
    assert_eq!(a.outcome.received.housekeeping.last().expect("many").mode, 1, "nothing to accept: it goes on aligning");
    recording.latitude_deg = Some(85.0);
    recording.rows.truncate(5);
    let a = align(&elf(), &recording, None).expect("runs");
    assert_eq!(a.reports.len(), 1);
    assert_eq!(Refusal::from_number(a.reports[0].refusal), Some(Refusal::Pole));
}

#[test]
fn a_probe_that_stops_reading_does_not_stop_the_unit() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    let truth = scene.undisturbed(&mut board, 60.0).expect("runs");
    board.leave_probe_blocking().expect("a log");
    let until = board.now() + 60 * CPU_HZ;
    assert_eq!(board.run_until(until).expect("runs"), Stop::Time, "no reset");
    let sent = &board.world.received;
    assert_eq!((sent.rates.len(), sent.bad_frames), (truth.rates.len(), 0));
    assert!(sent.rates.iter().zip(&truth.rates).all(|(a, b)| a == b), "every rate as with a probe");
}

#[test]
fn an_image_of_another_unit_is_refused_and_never_runs() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.settled().expect("settles");
    let own = scene.calibration.clone();
    let mut stranger = own.clone();
    stranger.set_unit_name("HRG-22");
    stranger.sequence += 1;
    let bytes = stranger.to_bytes().expect("fits");
    // In a session that this unit has opened.
    assert_eq!(maintain(&mut board, Command::Open(own.unit)).expect("answers"), Some(Answer::Done));
    let samples = board.world.received.rates.len();
    assert_eq!(maintain(&mut board, Command::Begin(bytes.len() as u16)).expect("answers"), Some(Answer::Done));
    for chunk in chunks(&bytes) {
        assert_eq!(maintain(&mut board, chunk).expect("answers"), Some(Answer::Done));
    }
    assert_eq!(maintain(&mut board, Command::End).expect("answers"), Some(Answer::Image));
    let sent = &board.world.received.rates;
    assert!(sent.len() > samples && sent.iter().all(good), "a burn that erases nothing disturbs nothing");
    board.power_cut().expect("starts");
    let identity = running(&mut board, 1.0).expect("answers");
    assert_eq!((identity.unit, identity.calibration), (own.unit, own.checksum()));
    assert_eq!((identity.reset_cause, identity.resets), (ResetCause::Power, 0));
    board.run_until(board.now() + 3 * CPU_HZ).expect("runs");
    let last = board.world.received.rates.last().expect("rates");
    assert_eq!(last.unit_status, UnitStatus::empty(), "what was refused is no fault of the flash");
}

#[test]
fn only_a_burn_without_room_stops_the_unit() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let mut board = scene.off(scene.wires(), &scene.calibration).expect("starts");
    // The last place of sector A is taken, and sector B is not blank.
    board.write_flash(CALIBRATION_B - STEP as u32, &[0; 4]).expect("flash");
    board.write_flash(CALIBRATION_B, &[0; 4]).expect("flash");
    board.run_until(CPU_HZ / 10).expect("runs");
    let own = scene.calibration.clone();
    let length = own.to_bytes().expect("fits").len() as u16;
    assert_eq!(maintain(&mut board, Command::Open(own.unit)).expect("answers"), Some(Answer::Done));
    let begun = board.now();
    assert_eq!(maintain(&mut board, Command::Begin(length)).expect("answers"), Some(Answer::Done));
    let erase_s = (board.now() - begun) as f64 / CPU_HZ as f64;
    assert!((0.49..0.55).contains(&erase_s), "an erase by words takes 0.5 s at its slowest: {erase_s}");
}

#[test]
fn a_start_looks_at_the_sectors_in_bounded_time() {
    let scene = Scene::new(&elf(), 1).expect("a scene");
    let good = scene.calibration.to_bytes().expect("fits").to_vec();
    let mut bad = good.clone();
    bad[100] ^= 1;
    let step = room(good.len());
    let row = |image: &[u8]| -> Vec<u8> {
        let mut sector = vec![0xFF; SECTOR_BYTES];
        sector.chunks_exact_mut(step).for_each(|place| place[..image.len()].copy_from_slice(image));
        sector
    };
    let (full, corrupted, erased) = (row(&good), row(&bad), vec![0xFF; SECTOR_BYTES]);
    let mut first_good = corrupted.clone();
    first_good[..good.len()].copy_from_slice(&good);
    let mut one = erased.clone();
    one[..good.len()].copy_from_slice(&good);
    // Measured, and a tenth on top.
    for (what, a, b, bound) in [
        ("one image", &one, &erased, 117_000),
        ("both sectors full", &full, &full, 195_000),
        ("nothing but changed images behind the one in use", &first_good, &corrupted, 312_000),
    ] {
        let mut board = scene.off(scene.wires(), &scene.calibration).expect("starts");
        board.write_flash(CALIBRATION_A, a).expect("flash");
        board.write_flash(CALIBRATION_B, b).expect("flash");
        board.count_calls("hrg_core::sectors::newest").expect("in the ELF");
        let identity = running(&mut board, 1.0).expect("answers");
        assert_eq!(identity.calibration, scene.calibration.checksum(), "{what}");
        let calls = &board.probe(0).expect("counted").calls;
        println!("{what}: {calls:?} instructions to find the image");
        assert!(calls.len() == 1 && calls[0] < bound, "{what}: {calls:?}");
    }
}

#[test]
fn the_states_that_a_unit_keeps_are_those_of_the_desktop_bit_for_bit() {
    // Every effect that a unit can compute, a few at a time.
    let facts: Vec<&Facts> = effects::ALL.iter().filter(|f| f.reach == Reach::Unit).collect();
    let steps = Steps::new(&recording()).expect("long enough");
    for some in facts.chunks(7) {
        let mut image = calibration();
        for (k, f) in some.iter().enumerate() {
            let mut term = EffectTerm::new(f.id, parameters_for(f));
            for (axis, gains) in term.gains.iter_mut().enumerate() {
                for (j, g) in gains[..f.outputs].iter_mut().enumerate() {
                    *g = 0.01 * (1.0 + k as f32) * if (axis + j) % 2 == 0 { 1.0 } else { -0.7 };
                }
            }
            image.effects.push(term).expect("room");
        }
        let names: Vec<&str> = some.iter().map(|f| f.name).collect();
        let wires = Wires::new(steps.clone(), image.scale_factors_dph_per_code(), 20e-9, 1, None, None);
        let mut board = Board::new(&elf(), wires).expect("runs");
        board.write_flash(CALIBRATION_A, &image.to_bytes().expect("fits")).expect("in flash");
        board.run_until(45 * CPU_HZ).expect("runs");
        let housekeeping = &board.world.received.housekeeping;
        let last = housekeeping.last().expect("some").step;
        let mut model = Model::new(image, 0.0);
        for h in housekeeping {
            model.step(&StepFrequencies {
                step: h.step,
                end_ticks: 0,
                frequency_hz: h.frequency_hz.map(|f| Some(f).filter(|f| f.is_finite())),
                rejected: [0; 3],
                missing: [0; 3],
            });
            let _ = model.keep();
        }
        let place = board.firmware().address_of(KEPT_STATES).expect("kept") + last % 2 * KEPT_WORDS as u32 * 4;
        let mut bytes = vec![0; KEPT_WORDS * 4];
        board.read_memory(place, &mut bytes).expect("RAM");
        let kept: Vec<u32> = bytes.chunks(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let wanted = model.keep();
        // (The last word is the checksum; the second counts how often was kept.)
        let differing: Vec<usize> = (2..KEPT_WORDS - 1).filter(|k| kept[*k] != wanted[*k]).take(5).collect();
        let shown: Vec<(usize, f32, f32)> =
            differing.iter().map(|k| (*k, f32::from_bits(kept[*k]), f32::from_bits(wanted[*k]))).collect();
        assert!(differing.is_empty(), "{names:?}: {shown:?}");
    }
}

/// Parameters that are usual for an effect.
fn parameters_for(facts: &Facts) -> [f32; 2] {
    let mut p = [0.0; 2];
    for (to, name) in p.iter_mut().zip(facts.parameters) {
        *to = match *name {
            n if n.ends_with("max_s") => 6000.0,
            n if n.ends_with("min_s") => 60.0,
            n if n.ends_with("_s") => 900.0,
            "width_min_c" => 0.5,
            n if n.starts_with("width") => 8.0,
            "on_c" => 30.0,
            "off_c" => 10.0,
            n if n.contains("beta") => 0.01,
            _ => 20.0,
        };
    }
    p
}
