//! Rates and increments as a navigator gets them, measured through the ELF on the virtual board: the response of its filters to a swept vibration, the time that its frames are of,
//! coning and sculling in its increments, GNSS time, and what link and processor have left.

use crate::faults::Scene;
use anyhow::{Context, Result};
use hrg_board::host::{cycles, set_output};
use hrg_board::motion::Motion;
use hrg_board::wires::{WireFaults, Wires};
use hrg_core::accelerometers::STANDARD_GRAVITY_MPS2;
use hrg_core::align_mode;
use hrg_core::filter::Filter;
use hrg_core::gnss::{GnssTime, WEEK_S};
use hrg_core::increments::IncrementFrame;
use hrg_core::link::{Message, RATE_FRAME};
use hrg_core::output::{Framing, OutputSettings};
use hrg_core::timebase::Timebase;
use hrg_identify::forces::UG_OF_MPS2;
use std::f64::consts::PI;
use std::fmt::Write as _;
use virtual_board::{Board, Stop, CPU_HZ};

/// Rad/s of a deg/h.
const RAD_S: f64 = PI / 180.0 / 3600.0;
/// Amplitude of a swept vibration, deg/h: far above the noise of codes, far below the end of the scale.
const AMPLITUDE_DPH: f64 = 20_000.0;
/// Largest rate of a coning or sculling motion, rad/s.
const MOST_RAD_S: f64 = 0.25;
/// Seconds of each measurement.
const SECONDS: f64 = 2.0;
/// A filter that has to be filled, and a housekeeping second.
const SETTLE_S: f64 = 0.5;
/// Bytes that the line carries in a second.
const LINE: f64 = 92_160.0;

/// A unit that has settled, with pulses from a time on, s, each second.
fn with_pulses(scene: &Scene, wires: Wires, first_s: f64) -> Result<Board<Wires>> {
    let faults = WireFaults { pulses: Some((first_s, 1.0)), ..WireFaults::default() };
    let mut board = scene.off(wires.with_faults(faults), &scene.calibration)?;
    scene.keep(&mut board)?;
    board.reset_by_software()?;
    board.run_until(cycles(first_s - 0.1))?;
    Ok(board)
}

/// A board whose unit sends by these settings, at rest until now.
///
/// # Errors
/// If the unit refuses them.
pub fn sending(scene: &Scene, settings: OutputSettings) -> Result<Board<Wires>> {
    let mut board = scene.settled()?;
    set(scene, &mut board, settings)?;
    Ok(board)
}

/// Has the unit send by these settings.
fn set(scene: &Scene, board: &mut Board<Wires>, settings: OutputSettings) -> Result<()> {
    set_output(board, scene.calibration.unit, settings)
}

/// Response to a vibration.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// Frequency, Hz.
    pub hz: f64,
    /// Frequency at which it appears in the frames, Hz.
    pub appears_hz: f64,
    /// Gain.
    pub gain: f64,
    /// From the time that the frames' ticks say to the true one, us; NaN where too little of it is left to tell.
    pub late_us: f64,
}

/// Has the unit vibrate at each frequency and measures what is in its frames.
///
/// # Errors
/// If the unit cannot be run.
pub fn sweep(scene: &Scene, settings: OutputSettings, frequencies: &[f64]) -> Result<Vec<Response>> {
    let mut board = sending(scene, settings)?;
    let start = board.snapshot()?;
    let frame_hz = 1000.0 / f64::from(settings.decimation);
    frequencies
        .iter()
        .map(|&hz| {
            board.restore(&start)?;
            let from = board.now() as f64 / CPU_HZ as f64;
            board.world.set_motion(Motion::Rate { axis: 1, amplitude_dph: AMPLITUDE_DPH, hz }, from);
            board.run_until(board.now() + cycles(SETTLE_S))?;
            board.world.received.rates.clear();
            board.run_until(board.now() + cycles(SECONDS))?;
            let frames = &board.world.received.rates;
            let w = 2.0 * PI * hz;
            let at: Vec<f64> = frames.iter().map(|f| board.world.seconds_at(f.tick)).collect();
            let rows: Vec<[f64; 3]> = at.iter().map(|t| [1.0, (w * t).sin(), (w * t).cos()]).collect();
            let rates: Vec<f64> = frames.iter().map(|f| f64::from(f.rate_dph[1])).collect();
            let [_, sin, cos] = least_squares(&rows, &rates);
            let gain = sin.hypot(cos) / AMPLITUDE_DPH;
            let late_us = if gain > 0.01 { -cos.atan2(sin) / w * 1e6 } else { f64::NAN };
            let folded = hz % frame_hz;
            Ok(Response { hz, appears_hz: folded.min(frame_hz - folded), gain, late_us })
        })
        .collect()
}

/// Coefficients of three columns that fit values best.
fn least_squares(rows: &[[f64; 3]], values: &[f64]) -> [f64; 3] {
    // Normal equations: the columns are sines, a quarter of a period apart, and a constant.
    let mut m = [[0.0; 4]; 3];
    for (row, y) in rows.iter().zip(values) {
        for (j, a) in row.iter().enumerate() {
            for (k, b) in row.iter().enumerate() {
                m[j][k] += a * b;
            }
            m[j][3] += a * y;
        }
    }
    for j in 0..3 {
        let pivot = m[j];
        for (_, row) in m.iter_mut().enumerate().filter(|(k, _)| *k != j) {
            let share = row[j] / pivot[j];
            row.iter_mut().zip(pivot).for_each(|(to, from)| *to -= share * from);
        }
    }
    [0, 1, 2].map(|k| m[k][3] / m[k][k])
}

/// A rotation, scalar first.
type Turn = [f64; 4];

fn product(p: Turn, q: Turn) -> Turn {
    [
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    ]
}

fn inverse(q: Turn) -> Turn {
    [q[0], -q[1], -q[2], -q[3]]
}

/// Rotation by a vector, rad.
fn rotation(v: [f64; 3]) -> Turn {
    let angle = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let s = if angle < 1e-12 { 0.5 } else { (0.5 * angle).sin() / angle };
    [(0.5 * angle).cos(), v[0] * s, v[1] * s, v[2] * s]
}

/// A vector, turned.
fn turned(q: Turn, v: [f64; 3]) -> [f64; 3] {
    let [_, x, y, z] = product(product(q, [0.0, v[0], v[1], v[2]]), inverse(q));
    [x, y, z]
}

/// Rest of an effect after a navigator has added up what the unit sends.
#[derive(Debug, Clone, Copy)]
pub struct Left {
    /// Frequency, Hz.
    pub hz: f64,
    /// The effect itself: drift, deg/h, or acceleration, ug.
    pub truth: f64,
    /// Error by the increments.
    pub by_increments: f64,
    /// Error by rate frames as they come, of means.
    pub by_frames: f64,
}

/// Attitude of a coning motion at a time.
fn coning_at(angle_rad: f64, hz: f64, t: f64) -> Turn {
    let (sin, cos) = (2.0 * PI * hz * t).sin_cos();
    let half = 0.5 * angle_rad;
    [half.cos(), 0.0, half.sin() * cos, half.sin() * sin]
}

/// Board with increments of five samples beside means of five, moving.
fn moving(scene: &Scene, motion: Motion) -> Result<Board<Wires>> {
    let settings = OutputSettings { filter: Filter::Mean, increments: 5, ..OutputSettings::default() };
    let mut board = sending(scene, settings)?;
    let from = board.now() as f64 / CPU_HZ as f64;
    board.world.set_motion(motion, from);
    board.run_until(board.now() + cycles(SETTLE_S))?;
    board.world.received.increments.clear();
    board.world.received.rates.clear();
    board.run_until(board.now() + cycles(SECONDS))?;
    Ok(board)
}

/// Drift about x beside that of the motion, deg/h: by the increments, and by means of the rates.
fn drifts(scene: &Scene, angle_rad: f64, hz: f64) -> Result<(f64, f64)> {
    let board = moving(scene, Motion::Coning { angle_rad, hz })?;
    let r = &board.world.received;
    let drift = |turns: &mut dyn Iterator<Item = (f64, [f64; 3])>, from: f64| {
        let (mut q, mut end) = (coning_at(angle_rad, hz, from), from);
        for (at, turn) in turns {
            q = product(q, rotation(turn));
            end = at;
        }
        let left = product(q, inverse(coning_at(angle_rad, hz, end)));
        2.0 * left[1].atan2(left[0]).to_degrees() / (end - from) * 3600.0
    };
    let begins = |i: &IncrementFrame| board.world.seconds_at(i.tick.wrapping_sub(i.ticks));
    let first = r.increments.first().context("no increments came")?;
    let mut by_increments = r.increments.iter().map(|i| (board.world.seconds_at(i.tick), i.angle_rad.map(f64::from)));
    let by_increments = drift(&mut by_increments, begins(first));
    // A frame is of the middle of its five samples.
    let half = 2.5e-3;
    let first = r.rates.first().context("no rates came")?;
    let mut by_frames = r
        .rates
        .iter()
        .map(|f| (board.world.seconds_at(f.tick) + half, f.rate_dph.map(|d| f64::from(d) * RAD_S * 2.0 * half)));
    let by_frames = drift(&mut by_frames, board.world.seconds_at(first.tick) - half);
    Ok((by_increments, by_frames))
}

/// Drift about x under coning: what a navigator makes of it.
///
/// # Errors
/// If the unit cannot be run.
pub fn coning(scene: &Scene, hz: f64) -> Result<Left> {
    let angle_rad = MOST_RAD_S / (2.0 * PI * hz);
    // (The unit takes its bias off, and this motion has none.)
    let rest = drifts(scene, 0.0, hz)?;
    let found = drifts(scene, angle_rad, hz)?;
    let truth = -2.0 * (0.5 * angle_rad).sin().powi(2) * 2.0 * PI * hz / RAD_S;
    Ok(Left { hz, truth, by_increments: found.0 - rest.0, by_frames: found.1 - rest.1 })
}

/// Acceleration along z under sculling.
///
/// # Errors
/// If the unit cannot be run.
pub fn sculling(scene: &Scene, hz: f64) -> Result<Left> {
    let w = 2.0 * PI * hz;
    let angle_rad = MOST_RAD_S / w;
    let board = moving(scene, Motion::Sculling { angle_rad, mps2: STANDARD_GRAVITY_MPS2, hz })?;
    let r = &board.world.received;
    let first = r.increments.first().context("no increments came")?;
    let from = board.world.seconds_at(first.tick.wrapping_sub(first.ticks));
    let end = r.increments.last().map_or(from, |i| board.world.seconds_at(i.tick));
    // Velocity along z in the axes of the room, from the attitude at the start on.
    let start = rotation([angle_rad * (w * from).sin(), 0.0, 0.0]);
    let (mut q, mut plain) = (start, start);
    let (mut by_increments, mut by_frames) = (0.0, 0.0);
    for i in &r.increments {
        let (angle, velocity) = (i.angle_rad.map(f64::from), i.velocity_mps.map(f64::from));
        by_increments += turned(q, velocity)[2];
        q = product(q, rotation(angle));
        // (A mean has nothing of what the motion brings to z within an interval.)
        by_frames += turned(plain, [velocity[0], velocity[1], 0.0])[2];
        plain = product(plain, rotation(angle));
    }
    let z = |t: f64| (angle_rad * (w * t).sin()).sin() * STANDARD_GRAVITY_MPS2 * (w * t).sin();
    let steps = ((end - from) * 1e5) as usize;
    let step = (end - from) / steps as f64;
    let truth = (0..steps).map(|k| z(from + (k as f64 + 0.5) * step)).sum::<f64>() * step;
    let seconds = end - from;
    Ok(Left {
        hz,
        truth: truth / seconds * UG_OF_MPS2,
        by_increments: (by_increments - truth) / seconds * UG_OF_MPS2,
        by_frames: (by_frames - truth) / seconds * UG_OF_MPS2,
    })
}

/// Errors of GNSS time.
#[derive(Debug, Clone, Copy)]
pub struct TimeError {
    /// Largest error of a frame's time, ns.
    pub most_ns: f64,
    /// Largest standard deviation that a mark states, ns.
    pub stated_ns: u32,
    /// Marks seen.
    pub marks: usize,
}

/// Pulses at known times, a message after each: the error of frames' times by the marks.
///
/// # Errors
/// If the unit cannot be run, or knows no time.
pub fn gnss_time(scene: &Scene) -> Result<TimeError> {
    let first_s = 3.123_456_789;
    let mut board = with_pulses(scene, scene.wires(), first_s)?;
    board.world.received = Default::default();
    const WEEK: u16 = 2394;
    // Near a week's end, so that it is crossed.
    let began = WEEK_S - 20;
    let (mut most_ns, mut stated_ns, mut marks) = (0.0f64, 0, 0);
    for k in 0..60u32 {
        board.run_until(cycles(first_s + f64::from(k) + 0.2))?;
        let second = (began + k) % WEEK_S;
        let time = GnssTime { week: WEEK + u16::from(began + k >= WEEK_S), second, std_ns: 20, leap_s: 18 };
        board.world.hear(&Message::GnssTime(time).encode());
        board.poll_link();
        // Frames of the last second by the last mark.
        let r = std::mem::take(&mut board.world.received);
        let Some((mark, _)) = r.marks.last() else { continue };
        let since = f64::from(mark.week - WEEK) * f64::from(WEEK_S) + f64::from(mark.second) - f64::from(began);
        for frame in &r.rates {
            let by_mark = first_s + since + mark.seconds_to(frame.tick, Timebase::REFERENCE, 0.0);
            most_ns = most_ns.max(1e9 * (by_mark - board.world.seconds_at(frame.tick)).abs());
        }
        stated_ns = stated_ns.max(mark.std_ns);
        marks += 1;
    }
    anyhow::ensure!(marks > 10, "only {marks} marks came");
    Ok(TimeError { most_ns, stated_ns, marks })
}

/// Cost of everything at once.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    /// Bytes on the line in a second.
    pub bytes: f64,
    /// Estimated cycles of the processor in a second.
    pub cycles: f64,
}

impl Budget {
    /// Share of the line that is used.
    #[must_use]
    pub fn of_line(&self) -> f64 {
        self.bytes / LINE
    }

    /// Share of the processor that is used.
    #[must_use]
    pub fn of_processor(&self) -> f64 {
        self.cycles / CPU_HZ as f64
    }
}

/// Rates and increments at 200 Hz, housekeeping, GNSS time and an alignment at once.
///
/// # Errors
/// If the unit cannot be run.
pub fn budget(scene: &Scene) -> Result<Budget> {
    const RUN_S: f64 = 10.0;
    let mut board = with_pulses(scene, scene.wires(), 40.0)?;
    set(scene, &mut board, OutputSettings { increments: 5, ..OutputSettings::default() })?;
    let begin = align_mode::Command::Begin { latitude_deg: 45.0, gravity_mps2: 0.0, velocity_noise_mps: 1e-3 };
    board.world.hear(&Message::Align(begin).encode());
    board.poll_link();
    board.run_until(board.now() + cycles(1.5))?;
    let time = GnssTime { week: 2394, second: 1, std_ns: 20, leap_s: 18 };
    board.world.hear(&Message::GnssTime(time).encode());
    board.poll_link();
    board.run_until(board.now() + cycles(1.5))?;
    board.world.received = Default::default();
    board.start_estimate();
    board.run_until(board.now() + cycles(RUN_S))?;
    let r = &board.world.received;
    let encoded = |messages: usize, one: &Message| messages as f64 * one.encode().len() as f64;
    let mut bytes = r.rates.len() as f64 * RATE_FRAME as f64;
    for (count, one) in [
        (r.increments.len(), r.increments.last().map(|i| Message::Increments(*i))),
        (r.housekeeping.len(), r.housekeeping.last().map(|h| Message::Housekeeping(*h))),
        (r.alignment.len(), r.alignment.last().map(|a| Message::Alignment(*a))),
        (r.marks.len(), r.marks.last().map(|(m, _)| Message::TimeMark(*m))),
    ] {
        bytes += encoded(count, &one.context("a message did not come")?);
    }
    Ok(Budget { bytes: bytes / RUN_S, cycles: board.estimate().total() as f64 / RUN_S })
}

/// Bytes that a unit sends in MAVLink's framing within some seconds, with increments at 200 Hz and GNSS time.
///
/// # Errors
/// If the unit cannot be run, or has no such framing.
pub fn in_mavlink(scene: &Scene, seconds: f64) -> Result<Vec<u8>> {
    let mut board = with_pulses(scene, scene.wires().live(), 40.0)?;
    set(scene, &mut board, OutputSettings { increments: 5, framing: Framing::Mavlink, ..OutputSettings::default() })?;
    let run = |board: &mut Board<Wires>, until: u64| -> Result<()> {
        let stop = board.run_until(until)?;
        anyhow::ensure!(stop == Stop::Time, "the unit stopped: {stop:?}");
        Ok(())
    };
    run(&mut board, cycles(42.2))?;
    let time = GnssTime { week: 2394, second: 1, std_ns: 20, leap_s: 18 };
    board.world.hear(&Message::GnssTime(time).encode());
    board.poll_link();
    let settled = board.now() + cycles(1.5);
    run(&mut board, settled)?;
    let _ = board.world.printed();
    let end = board.now() + cycles(seconds);
    run(&mut board, end)?;
    let bytes = board.world.printed();
    // The same command leads back.
    set(scene, &mut board, OutputSettings::default())?;
    Ok(bytes)
}

/// Frequencies of the page: pass bands, stop bands, and what folds back round 200 Hz and 1 kHz. (Beside whole multiples of the frame rate, where a vibration
/// stands still in the frames.)
const SWEPT_HZ: [f64; 16] =
    [5.3, 10.3, 20.3, 30.3, 40.3, 50.3, 59.7, 79.2, 100.3, 130.3, 160.3, 250.3, 400.3, 700.3, 869.3, 950.3];

/// All of it as Markdown, between the marks of a page or on standard output.
///
/// # Errors
/// As the measurements.
pub fn report(elf: &[u8], page: Option<&std::path::Path>) -> Result<()> {
    let scene = Scene::new(elf, 1)?;
    let mut out = String::new();
    let kinds = [
        ("linear phase, 200 Hz", OutputSettings::default()),
        ("means of 5, 200 Hz", OutputSettings { filter: Filter::Mean, ..OutputSettings::default() }),
    ];
    let found = kinds.iter().map(|(_, settings)| sweep(&scene, *settings, &SWEPT_HZ)).collect::<Result<Vec<_>>>()?;
    writeln!(
        out,
        "| vibration [Hz] | {} |",
        kinds.map(|(name, _)| format!("{name}: gain [dB] | appears at [Hz] | late [us]")).join(" | ")
    )?;
    writeln!(out, "|--:|{}", "--:|--:|--:|".repeat(kinds.len()))?;
    for (k, hz) in SWEPT_HZ.iter().enumerate() {
        write!(out, "| {hz} |")?;
        for responses in &found {
            let r = responses[k];
            let late = if r.late_us.is_nan() || r.hz > 100.0 { String::new() } else { format!("{:+.2}", r.late_us) };
            write!(out, " {:.2} | {:.1} | {late} |", 20.0 * r.gain.max(1e-9).log10(), r.appears_hz)?;
        }
        writeln!(out)?;
    }
    writeln!(out, "\n| coning at [Hz] | drift [deg/h] | left by increments [deg/h] | left by means at 200 Hz [deg/h] |\n|--:|--:|--:|--:|")?;
    for hz in [5.0, 10.0, 20.0, 50.0] {
        let l = coning(&scene, hz)?;
        writeln!(out, "| {hz} | {:.2} | {:+.4} | {:+.3} |", l.truth, l.by_increments, l.by_frames)?;
    }
    writeln!(out, "\n| sculling at [Hz] | acceleration [ug] | left by increments [ug] | left by means at 200 Hz [ug] |\n|--:|--:|--:|--:|")?;
    for hz in [5.0, 10.0, 20.0, 50.0] {
        let l = sculling(&scene, hz)?;
        writeln!(out, "| {hz} | {:.0} | {:+.2} | {:+.1} |", l.truth, l.by_increments, l.by_frames)?;
    }
    let t = gnss_time(&scene)?;
    let b = budget(&scene)?;
    writeln!(out, "\n| what | reached | limit |\n|---|--:|--:|")?;
    writeln!(
        out,
        "| error of a frame's GNSS time, largest of {} seconds [ns] | {:.1} | {} stated |",
        t.marks, t.most_ns, t.stated_ns
    )?;
    writeln!(out, "| everything on, of the link at 921600 Bd [%] | {:.1} | 66.7 |", 100.0 * b.of_line())?;
    writeln!(
        out,
        "| everything on, of the processor at 180 MHz, by cycles [%, estimated] | {:.2} | 3 |",
        100.0 * b.of_processor()
    )?;
    print!("{out}");
    if let Some(page) = page {
        crate::pages::splice(page, "output", &out)?;
    }
    Ok(())
}
