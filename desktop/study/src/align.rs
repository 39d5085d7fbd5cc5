//! Align mode on the virtual board: an alignment recording played into the accelerometer channels, the commands of the
//! host over the link.

use anyhow::{Context, Result};
use hrg_align::{wrap, ARCMIN, DEGREE};
use hrg_align_tools::plant::Plant;
use hrg_align_tools::{study, Recording};
use hrg_board::replay::{self, Options, Outcome};
use hrg_board::wires::WireFaults;
use hrg_core::align_mode::{Command, Report};
use hrg_core::calibration::Calibration;
use hrg_core::inputs::QuantitySet;
use hrg_core::link::Message;
use hrg_data::recording::steps::Steps;
use std::path::Path;
use virtual_board::{Board, NothingConnected, Probe, CPU_HZ};

/// Time at which the host asks for the alignment, s after power-on.
const BEGIN_S: f64 = 4.5;
/// The first whole second after it, as the rate path counts seconds.
const START_S: f64 = 5.05;

/// Result of an alignment on the board.
#[derive(Debug)]
pub struct Aligned {
    /// Reports of the unit, second by second.
    pub reports: Vec<Report>,
    /// The whole run.
    pub outcome: Outcome,
    /// Time (s) at which the host accepted.
    pub accepted_s: f64,
}

impl Aligned {
    /// The last report before the end of the alignment.
    #[must_use]
    pub fn last(&self) -> Option<&Report> {
        self.reports.iter().rev().find(|r| r.stage != 4)
    }
}

/// Plays a recording (steps of a second) and accepts at its end.
///
/// # Errors
/// A recording that holds no whole seconds, a firmware that the board cannot run.
pub fn align(elf: &[u8], recording: &Recording, calibration: Option<&Calibration>) -> Result<Aligned> {
    let rows = &recording.rows;
    let first: Vec<[f64; 2]> = rows.iter().filter(|r| r.1 == 1).map(|r| r.2).collect();
    let second: Vec<_> = rows.iter().filter(|r| r.1 == 2).collect();
    let last_first = rows.iter().rev().find(|r| r.1 == 1).context("no row of position 1")?;
    let increments =
        |v: &[[f64; 2]]| -> Vec<[f64; 2]> { v.windows(2).map(|w| [w[1][0] - w[0][0], w[1][1] - w[0][1]]).collect() };
    let mut sent: Vec<(f64, Command)> = Vec::new();
    if recording.drift_dph.is_some() || recording.tilt_arcmin.is_some() {
        let [drift_dph, tilt_arcmin] = [recording.drift_dph, recording.tilt_arcmin].map(|v| v.unwrap_or(0.0) as f32);
        // (The bytes of a message take less than a millisecond.)
        sent.push((BEGIN_S - 0.01, Command::Expect { drift_dph, tilt_arcmin }));
    }
    sent.push((
        BEGIN_S,
        Command::Begin {
            latitude_deg: recording.latitude_deg.unwrap_or(f64::NAN) as f32,
            gravity_mps2: recording.gravity_mps2.unwrap_or(0.0) as f32,
            velocity_noise_mps: recording.velocity_noise_mps.unwrap_or(1e-3) as f32,
        },
    ));
    let mut accelerations = increments(&first);
    if let Some(begin) = second.first() {
        // On the unit a turn takes whole seconds, one at the least.
        let begins = begin.2 == [0.0; 2];
        let gap = (begin.0 - last_first.0 - if begins { 0.0 } else { 1.0 }).round().max(1.0);
        let turn_at = START_S + accelerations.len() as f64;
        sent.push((turn_at + 0.45, Command::TurnBegins));
        sent.push((turn_at + gap - 0.4, Command::TurnEnded { angle_deg: recording.turn_deg as f32 }));
        accelerations.extend(std::iter::repeat_n([0.0; 2], gap as usize));
        let mut velocities: Vec<[f64; 2]> = second.iter().map(|r| r.2).collect();
        if !begins {
            velocities.insert(0, [0.0; 2]);
        }
        accelerations.extend(increments(&velocities));
    }
    let end = START_S + accelerations.len() as f64;
    sent.push((end + 0.45, Command::Accept));
    let mut link_in = Vec::new();
    for (at, command) in &sent {
        for (k, byte) in Message::Align(*command).encode().into_iter().enumerate() {
            link_in.push((at + k as f64 * 20e-6, byte));
        }
    }
    let used = calibration.cloned().unwrap_or_else(Calibration::uncalibrated);
    let seconds = end as usize + 5;
    let constant = |value: f64| vec![value; seconds.max(200)];
    let frequency = |a: usize| used.axes[a].curve.frequency_hz(25.0).unwrap_or(used.axes[a].curve.frequency_centre_hz);
    let steps = Steps {
        start_s: 1.0,
        power_on_s: 0.0,
        run_in: 0,
        mean_s: hrg_data::recording::steps::MEAN_S,
        thermometer: Default::default(),
        in_turns: false,
        absent: Default::default(),
        frequency_hz: [0, 1, 2].map(|a: usize| constant(frequency(a))),
        rate_dph: [0, 1, 2].map(|_| constant(0.0)),
        case_c: Default::default(),
        chamber_c: vec![],
        quantities: Default::default(),
        given: Default::default(),
        unit_inputs: QuantitySet::empty(),
    };
    let options = Options {
        seconds: Some(seconds as u64),
        faults: WireFaults { link_in, ..WireFaults::default() },
        accelerations: Some((START_S, accelerations.into_iter().map(|[x, y]| [x, y, 0.0]).collect())),
        ..Options::default()
    };
    let outcome = replay::run(elf, calibration, &steps, &options, |_| {})?;
    Ok(Aligned { reports: outcome.received.alignment.clone(), outcome, accepted_s: end + 0.45 })
}

/// Cost of a function of the bench ELF.
#[derive(Debug, Clone)]
pub struct Cost {
    /// Name of the function's work, for the table.
    pub name: &'static str,
    /// Mean instructions of a call.
    pub instructions: f64,
}

/// Runs the bench ELF and counts the instructions of a step of each filter on the target.
///
/// # Errors
/// If the ELF lacks one of the functions, or does something that the board does not model.
pub fn costs(bench: &[u8]) -> Result<Vec<Cost>> {
    let functions = [
        ("linear, step", "bench::linear_step"),
        ("linear, azimuth from its state", "bench::linear_estimate"),
        ("ekf, step", "bench::ekf_step"),
        ("upf, kernel form, 200, step", "bench::kernels_step"),
        ("upf, literal, 200, step", "bench::literal_step"),
    ];
    let mut board = Board::new(bench, NothingConnected)?;
    let probes = functions.iter().map(|(_, path)| board.count_calls(path)).collect::<Result<Vec<_>, _>>()?;
    board.run_until(4 * CPU_HZ)?;
    functions
        .iter()
        .zip(probes)
        .map(|((name, _), p)| {
            let instructions =
                board.probe(p).and_then(Probe::mean).with_context(|| format!("{name} was never called"))?;
            Ok(Cost { name, instructions })
        })
        .collect()
}

/// `cargo xtask align-demo`: the campaigns, the costs, and chen2015's case on the ELF.
///
/// # Errors
/// If a step fails.
pub fn demo(elf: &[u8], bench: &[u8], runs: u64, seed: u64, out: &Path, table: Option<&Path>) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("cannot make {}", out.display()))?;
    let mut text = String::from(
        "# Alignment: figures\n\nPrinted by `cargo xtask align-demo`; everything here is simulated, save the table of chen2015, which is theirs.\n\n",
    );
    let say = |text: &mut String, part: &str| {
        println!("{part}");
        text.push_str(part);
        text.push('\n');
    };
    say(&mut text, &format!("## Campaigns\n{runs} platforms, azimuth anywhere on the circle, drifts of 0.2 deg/h and tilts of 3' (one sigma), 85 s in each\nposition and 30 s of turn. \"Refused\": the aligner gave no azimuth, and the reason.\n"));
    let rows = study::campaigns(runs, seed);
    say(&mut text, &study::table(&rows));
    let [drift, error] = study::WITH_THE_TURN;
    say(&mut text, &format!("## Drift that changes with the heading, and a wrong turn\nDrawn for each platform, one sigma: {drift} deg/h of each axis, {error}' of the turn. Stated: by `--heading-drift` and `--turn-error`.\n"));
    say(&mut text, &study::table(&study::with_the_turn(runs, seed)));
    say(&mut text, "## Can a turn's error be seen?\nShare of runs whose check of the two positions is beyond 3.84 (one in twenty by chance) and beyond the limit of 10.8:\n\n| turn wrong by ['] | beyond 3.84 | refused |\n|--:|--:|--:|");
    for (size, seen, refused) in study::turn_error_seen(runs, seed, &[0.0, 6.0, 30.0, 60.0]) {
        say(&mut text, &format!("| {size:.0} | {:.1} % | {:.1} % |", 100.0 * seen, 100.0 * refused));
    }
    say(&mut text, "\n## One position\nAzimuth error and median standard deviation after 200 s in one position, for drifts of a size that is known:\n\n| drift [deg/h] | error, RMS ['] | stated by the filter ['] |\n|--:|--:|--:|");
    for (known, error, stated) in study::one_position(runs, seed, &[0.2, 0.1, 0.022, 0.012]) {
        say(&mut text, &format!("| {known} | {error:.1} | {stated:.1} |"));
    }
    say(&mut text, &format!("\n## chen2015's case\n45 degrees, tilts 3', azimuth 100 degrees, drifts 0.2, 0.1, 0.2 deg/h (north, east, vertical), 200 s in two positions. Drifts\nhere are about the platform's axes; tilts as they stand at the end. Sizes of the errors over {runs} draws of noise, median and 95th percentile (draw N is\n`hrg align simulate --chen N`), the mean of the azimuth's error, and the deviation that the filter states (median). Each filter as it\nends; `hrg align` refuses what the aligner refuses.\n"));
    say(&mut text, &study::chen(runs));
    say(&mut text, "Theirs (its Table 1, turntable data through its filter; found, reference, error bound): azimuth 100.722, 100.545 deg (0.25); \ntilts 1.251, 1.052' (1) and 1.086, 1.037' (1); drifts 0.136, 0.126 deg/h (0.01) and -0.126, -0.106 deg/h (0.02).\n");
    say(&mut text, study::CLAIMS);
    say(&mut text, &study::claims(runs));
    let curves = study::curves(seed)?;
    hrg_data::output::write_file(&out.join("alignment.svg"), curves.as_bytes())?;
    say(&mut text, "## Cost on the unit\nInstructions of one step (a second of alignment), counted by the virtual board:\n\n| what | instructions | of a second |\n|---|--:|--:|");
    let costs = costs(bench)?;
    for c in &costs {
        say(
            &mut text,
            &format!("| {} | {:.0} | {:.4} % |", c.name, c.instructions, c.instructions / CPU_HZ as f64 * 100.0),
        );
    }
    let linear: f64 = costs.iter().take(2).map(|c| c.instructions).sum();
    say(
        &mut text,
        &format!(
            "\nThe kernel form takes {:.0} times the instructions of the linear filter (step and azimuth).\n",
            costs[3].instructions / linear
        ),
    );
    say(&mut text, "## The ELF\nchen2015's case played into the accelerometer channels of the virtual board, commands over the link:\n");
    let (recording, truth) = Plant::chen(seed).play();
    hrg_data::output::write_file(&out.join("chen.csv"), recording.to_csv().as_bytes())?;
    {
        let a = align(elf, &recording, None)?;
        let last = a.last().context("the unit has sent no report")?;
        let error = wrap(f64::from(last.azimuth_deg) * DEGREE - truth.azimuth) / ARCMIN;
        let frames = a.outcome.received.rates.len() + a.outcome.received.housekeeping.len() + a.reports.len();
        let same = format!("{} of {frames} frames differ from the desktop", a.outcome.received.differing);
        if let Some(d) = &a.outcome.received.first_difference {
            println!("{d}");
        }
        say(&mut text, &format!("- linear filter: azimuth {:.3} deg, error {error:.2}', sigma {:.2}'; {same}; stack {} bytes, static RAM {} bytes", last.azimuth_deg, last.azimuth_std_arcmin, a.outcome.stack_bytes, a.outcome.static_bytes));
    }
    hrg_data::output::write_file(&out.join("alignment.md"), text.as_bytes())?;
    if let Some(table) = table {
        hrg_data::output::write_file(table, text.as_bytes())?;
        hrg_data::output::write_file(&table.with_file_name("alignment.svg"), curves.as_bytes())?;
    }
    Ok(())
}
