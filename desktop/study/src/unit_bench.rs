//! Costs of the unit, counted in the ELF by the virtual board, with bounds; costs of the alternatives; and the
//! distance of its numbers from the limits that their noise sets.

use crate::faults::Scene;
use anyhow::{Context, Result};
use hrg_board::replay::{self, Options};
use hrg_board::symbol;
use hrg_core::calibration::{Calibration, DEFAULT_SCALE_FACTOR};
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP};
use hrg_core::rate_factors::RateAxis;
use hrg_core::rate_path::RatePath;
use hrg_core::temperature::{ForwardCurve, TemperatureCurve};
use hrg_core::timebase::Timebase;
use hrg_core::AXES;
use object::{Object, ObjectSegment};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write as _;
use virtual_board::{Board, NothingConnected, CPU_HZ};

/// One counted figure.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Name of the figure.
    pub what: &'static str,
    /// Its value, in `unit`.
    pub value: f64,
    /// More than that fails CI: a tenth above what was measured, so that another compiler does not break it.
    pub bound: f64,
    /// Limit that the project sets itself, where it has one.
    pub goal: Option<f64>,
    /// Of what.
    pub unit: &'static str,
}

/// Seconds that are counted.
const SECONDS: u64 = 20;

/// Bytes that an ELF takes of flash: what is loaded.
fn flash_bytes(elf: &[u8]) -> Result<f64> {
    let file = object::File::parse(elf)?;
    Ok(file.segments().map(|s| s.file_range().1).sum::<u64>() as f64)
}

/// The unit's costs. Everything on: 3 x 4.9 kHz, 1 kSPS, an image with four effects, link and log.
///
/// # Errors
/// If the ELF does not run, or lacks a function that is counted.
pub fn unit(elf: &[u8]) -> Result<Vec<Figure>> {
    let scene = Scene::new(elf, 1)?;
    let run = |edges: bool, calibration: &Calibration| -> Result<Board<hrg_board::wires::Wires>> {
        let mut wires = scene.wires();
        if !edges {
            wires.set_frequency(f64::NAN);
        }
        let mut board = scene.off(wires, calibration)?;
        for part in COUNTED {
            board.count_calls(part)?;
        }
        board.run_until(30 * CPU_HZ)?;
        // (From here on: it takes longer to run.)
        board.start_estimate();
        board.forget_calls();
        Ok(board)
    };
    let count = |board: &mut Board<hrg_board::wires::Wires>| -> Result<f64> {
        let before = board.instructions();
        board.run_until((30 + SECONDS) * CPU_HZ)?;
        Ok((board.instructions() - before) as f64 / SECONDS as f64)
    };
    let factors = with_factors(&scene.calibration);
    let (mut with, mut without) = (run(true, &scene.calibration)?, run(false, &scene.calibration)?);
    let mut scaled = run(true, &factors)?;
    let (all, bare) = (count(&mut with)?, count(&mut without)?);
    count(&mut scaled)?;
    let edges: f64 = with.world.received.housekeeping.iter().rev().take(1).flat_map(|h| h.frequency_hz).sum();
    let mean = |board: &Board<_>, k: usize| -> Result<f64> {
        board.probe(k).and_then(virtual_board::Probe::mean).with_context(|| format!("{} was not called", COUNTED[k]))
    };
    let latency = with.probe(SAMPLE).context("counted")?.latency;
    let masked = with.longest_masked();
    let (fixed, stack) = (f64::from(with.static_bytes()), f64::from(with.stack_used()));
    let mut figures = vec![
        figure("capture edge, fetched and counted", (all - bare) / edges, 34.7, None, "instructions"),
        figure("bias update, three axes, four effects", mean(&with, UPDATE)?, 7870.0, None, "instructions"),
        figure(
            "data-ready to corrected sample, mean",
            latency.instructions as f64 / latency.calls as f64,
            1476.0,
            None,
            "instructions",
        ),
        figure("longest stretch without interrupts", masked.instructions as f64, 449.0, None, "instructions"),
        figure(
            "data-ready to corrected sample, worst, the frame's way over the wire included",
            latency.most_cycles as f64 / (CPU_HZ as f64 / 1e6),
            40.7,
            None,
            "us",
        ),
        figure("ADC frame checked and taken apart", mean(&with, DECODE)?, 283.0, None, "instructions"),
        figure("sample corrected", mean(&with, SAMPLE)?, 941.0, None, "instructions"),
        figure(
            "the same, scale factor and misalignment over temperature",
            mean(&scaled, SAMPLE)?,
            944.0,
            None,
            "instructions",
        ),
        figure("rate frame encoded", mean(&with, ENCODE)?, 1340.0, None, "instructions"),
        figure("everything, a second", all, 2_785_000.0, None, "instructions"),
        figure("share of 180 MHz", 100.0 * all / CPU_HZ as f64, 1.55, Some(3.0), "%"),
        figure("flash", flash_bytes(elf)?, 180_500.0, Some(hrg_core::slots::ROOM as f64), "bytes"),
        figure("static RAM", fixed, 66_100.0, None, "bytes"),
        figure("stack, painted", stack, 54_700.0, None, "bytes"),
        figure("static RAM and stack", fixed + stack, 121_000.0, Some(131_072.0), "bytes"),
    ];
    figures.extend(estimated(&with)?);
    Ok(figures)
}

/// A calibration with scale factor and misalignment over temperature: each element of both matrices counts.
fn with_factors(c: &Calibration) -> Calibration {
    let axis = RateAxis {
        rate_valid_from_c: -60.0,
        rate_valid_to_c: 90.0,
        rate_valid_from_c_per_min: -10.0,
        rate_valid_to_c_per_min: 10.0,
        scale_correction_ppm: [500.0, -150.0, 40.0, 10.0, 5.0, -3.0],
        misalignment_urad: [[300.0, -200.0], [10.0, 20.0]],
        ..RateAxis::default()
    };
    Calibration { rates: Some([axis; AXES]), ..c.clone() }
}

/// The same in cycles, as the virtual board estimates them, of a board that has run its seconds.
fn estimated(board: &Board<hrg_board::wires::Wires>) -> Result<Vec<Figure>> {
    let cycles = board.estimate();
    let a_second = cycles.total() as f64 / SECONDS as f64;
    let update = board.probe(UPDATE).and_then(virtual_board::Probe::mean_estimate).context("no update was called")?;
    let latency = board.probe(SAMPLE).context("counted")?.latency;
    // The tasks but that of the rates run in this interrupt.
    let stretch = board.longest_interrupt("UART4").context("no task ran")?;
    let unit = "cycles, estimated";
    Ok(vec![
        figure("bias update, three axes, four effects", update, 13_900.0, None, unit),
        figure(
            "data-ready to corrected sample, mean",
            latency.estimated as f64 / latency.calls as f64,
            2760.0,
            None,
            unit,
        ),
        figure("longest stretch without interrupts", board.longest_masked().estimate as f64, 740.0, None, unit),
        figure("longest stretch of the tasks", stretch as f64, 175_000.0, None, unit),
        figure("everything, a second", a_second, 4_968_000.0, None, unit),
        figure("of it, waiting for flash", cycles.flash as f64 / SECONDS as f64, 752_000.0, None, unit),
        figure("of it, waiting for buses", cycles.bus as f64 / SECONDS as f64, 193_000.0, None, unit),
        figure("share of 180 MHz, by cycles", 100.0 * a_second / CPU_HZ as f64, 2.76, Some(3.0), "%, estimated"),
    ])
}

fn figure(what: &'static str, value: f64, bound: f64, goal: Option<f64>, unit: &'static str) -> Figure {
    Figure { what, value, bound, goal, unit }
}

const COUNTED: [&str; 4] = [symbol::UPDATE, symbol::DECODE, symbol::SAMPLE, symbol::ENCODE];
const UPDATE: usize = 0;
const DECODE: usize = 1;
const SAMPLE: usize = 2;
const ENCODE: usize = 3;

/// One way from frequency to temperature.
#[derive(Debug, Clone)]
pub struct Way {
    /// Name of the way.
    pub what: &'static str,
    /// Instructions of a call.
    pub instructions: f64,
    /// Multiply-adds that its formula needs, at one each; divisions and functions count as one, too.
    pub floor: u32,
    /// Worst error over the range, C, against the same formula in exact arithmetic.
    pub worst_c: f64,
}

const WAYS: [(&str, &str, u32); 8] = [
    ("cubic in f, f32, uncentred", "uncentred_single", 3),
    ("cubic in f, f64 (soft), uncentred", "uncentred_double", 3),
    ("root of f(T), Newton, f64", "newton", 24),
    ("root of f(T), Cardano, f64, libm", "cardano", 12),
    ("table of 64 cells, linear", "table", 5),
    ("network 1-5-1, f32, libm", "network", 18),
    ("network 1-5-1, f32, micromath", "network_micromath", 18),
    ("ours: centred exactly, cubic in f32", "ours", 5),
];

fn default_law() -> TemperatureCurve {
    Calibration::uncalibrated().axes[0].curve
}

/// The alternatives beside ours, on one virtual CPU.
///
/// # Errors
/// If the ELF is not that of `alternatives`.
pub fn ways(elf: &[u8]) -> Result<Vec<Way>> {
    const POINTS: usize = 200;
    let mut board = Board::new(elf, NothingConnected)?;
    for (_, symbol, _) in WAYS {
        board.count_calls(&format!("alternatives::{symbol}"))?;
    }
    // It ends asleep, with nothing to wake it.
    let _ = board.run_until(CPU_HZ);
    let results = board.firmware().address_of("alternatives::RESULTS").context("no results in this ELF")?;
    let curve = default_law();
    // Curve whose root firmware/src/bin/alternatives.rs computes.
    let forward = ForwardCurve {
        t0_c: 0.0,
        scale_c: 1.0,
        c: [4_895.602_740_431_214, 0.479_352_328_114_589_44, -0.000_257_673_834_871_828_66, -5.622_241_434_603_012e-7],
    };
    let mut out = Vec::new();
    for (k, (what, _, floor)) in WAYS.into_iter().enumerate() {
        let mut worst = 0.0f64;
        for p in 0..POINTS {
            let mut bytes = [0; 4];
            board.read_memory(results + 4 * (k * POINTS + p) as u32, &mut bytes)?;
            let f = 4878.0 + 0.22 * p as f64;
            let c = curve.temperature_coefficients_c.map(f64::from);
            let u = (f - curve.frequency_centre_hz) / f64::from(curve.frequency_scale_hz);
            let mut truth = ((c[3] * u + c[2]) * u + c[1]) * u + c[0];
            if what.starts_with("root") {
                truth = forward.root_c(f, truth).context("no root")?;
            }
            worst = worst.max((f64::from(f32::from_le_bytes(bytes)) - truth).abs());
        }
        let instructions = board.probe(k).and_then(virtual_board::Probe::mean).context("was not called")?;
        out.push(Way { what, instructions, floor, worst_c: worst });
    }
    Ok(out)
}

/// One figure beside what its noise allows.
#[derive(Debug, Clone)]
pub struct Limit {
    /// Name of the figure.
    pub what: String,
    /// Reached.
    pub reached: f64,
    /// The least that is possible.
    pub bound: f64,
    /// Of what.
    pub unit: &'static str,
}

/// Frequency: RMS error of one-second gates over `n` seconds, and the Cramer-Rao bound for jitter of `jitter_s` and the timer's
/// steps. For times `t_i = t_0 + i / f` with independent errors of variance `s^2`, the bound of `1 / f` is `s^2 / sum (i - mean)^2`.
fn frequency(jitter_s: f64, n: u32) -> (f64, f64) {
    const TICKS: f64 = Timebase::REFERENCE.ticks_per_s() as f64;
    const HZ: f64 = 4898.626;
    let mut bank = CounterBank::new(Config::REFERENCE, GATES_PER_STEP);
    let mut draw = ChaCha8Rng::seed_from_u64(8);
    let (mut squares, mut count, mut edges) = (0.0, 0u32, 0.0);
    let mut k = 0u64;
    while count < n {
        k += 1;
        let jitter: f64 = StandardNormal.sample(&mut draw);
        let t = ((k as f64 / HZ + 1e-4 + jitter * jitter_s) * TICKS) as u64;
        while t > bank.close_tick() {
            let at = bank.close_tick();
            let Some(step) = bank.poll(at as u32) else { continue };
            if let Some(f) = step.frequency_hz[0].filter(|_| step.step > 0) {
                squares += (f - HZ) * (f - HZ);
                count += 1;
                edges = HZ;
            }
        }
        bank.push(0, [t as u32]);
    }
    // A time stamp is cut to whole ticks: an error of a tick's twelfth part, as variance.
    let variance = jitter_s * jitter_s + 1.0 / (12.0 * TICKS * TICKS);
    let spread = edges * (edges * edges - 1.0) / 12.0;
    ((squares / f64::from(count)).sqrt(), HZ * HZ * (variance / spread).sqrt())
}

/// Corrected rate: RMS error of a frame's mean of five samples with white noise of `noise` codes, in codes, and the least possible:
/// that noise and the rounding to codes, averaged.
fn rate(noise: f64, n: u32) -> (f64, f64) {
    let mut path = RatePath::new(Timebase::REFERENCE, [DEFAULT_SCALE_FACTOR; 3], 5);
    let mut draw = ChaCha8Rng::seed_from_u64(9);
    let (mut squares, mut count) = (0.0, 0u32);
    let mut tick = 0u32;
    while count < n {
        let rate = draw.random_range(-20_000.0..20_000.0f64);
        let mut frame = None;
        while frame.is_none() {
            let codes = std::array::from_fn(|_| {
                let white: f64 = StandardNormal.sample(&mut draw);
                (rate + noise * white).round() as i32
            });
            tick = tick.wrapping_add(90_000);
            frame = path.sample(tick, codes).frame;
        }
        for r in frame.map(|f| f.rate_dph).unwrap_or_default() {
            squares += (f64::from(r) / f64::from(DEFAULT_SCALE_FACTOR) - rate).powi(2);
            count += 1;
        }
    }
    ((squares / f64::from(count)).sqrt(), ((noise * noise + 1.0 / 12.0) / 5.0).sqrt())
}

/// The figures beside their bounds.
#[must_use]
pub fn limits() -> Vec<Limit> {
    let mut out = Vec::new();
    for jitter_ns in [0.0, 5.0, 20.0, 100.0] {
        let (reached, bound) = frequency(jitter_ns * 1e-9, 3000);
        let what = format!("frequency in a 1 s gate, {jitter_ns} ns of jitter");
        out.push(Limit { what, reached: reached * 1e6, bound: bound * 1e6, unit: "uHz" });
        let c_per_hz = f64::from(default_law().slope_c_per_hz(default_law().frequency_centre_hz));
        let what = format!("temperature that it gives, {jitter_ns} ns of jitter");
        out.push(Limit { what, reached: reached * c_per_hz * 1e6, bound: bound * c_per_hz * 1e6, unit: "uC" });
    }
    for noise in [1.0, 10.0] {
        let (reached, bound) = rate(noise, 100_000);
        let what = format!("corrected rate of a frame, {noise} codes of noise a sample");
        let dph = f64::from(DEFAULT_SCALE_FACTOR) * 1e3;
        out.push(Limit { what, reached: reached * dph, bound: bound * dph, unit: "mdeg/h" });
    }
    out
}

/// All tables as Markdown.
///
/// # Errors
/// As [`unit()`] and [`ways`].
pub fn tables(elf: &[u8], alternatives: &[u8]) -> Result<(String, bool)> {
    let mut s = String::from("### On the unit\n\n| what | counted | bound in CI | limit |\n|---|---:|---:|---:|\n");
    let mut within = true;
    for f in unit(elf)? {
        let digits = usize::from(f.value < 100.0) * 2;
        let goal = f.goal.map_or_else(String::new, |g| format!("{g:.0}"));
        let _ = writeln!(s, "| {} [{}] | {:.digits$} | {} | {goal} |", f.what, f.unit, f.value, f.bound);
        within &= f.value <= f.bound;
    }
    s.push_str("\n### Frequency to temperature, as others would write it\n\n| way | instructions | multiply-adds of the formula | worst error [C] |\n|---|---:|---:|---:|\n");
    for w in ways(alternatives)? {
        let _ = writeln!(s, "| {} | {:.0} | {} | {:.1e} |", w.what, w.instructions, w.floor, w.worst_c);
    }
    s.push_str("\n### How near to the limit\n\n| what | reached | limit | ratio |\n|---|---:|---:|---:|\n");
    for l in limits() {
        let _ =
            writeln!(s, "| {} [{}] | {:.3} | {:.3} | {:.2} |", l.what, l.unit, l.reached, l.bound, l.reached / l.bound);
    }
    s.push_str("\n### The virtual board itself\n\n| what | times real time on this machine |\n|---|---:|\n");
    for (what, speed) in speed(elf)? {
        let _ = writeln!(s, "| {what} | {speed:.0} |");
    }
    Ok((s, within))
}

/// Speed of the board, in times of real time: the unit as it flies, and with every frame compared with the desktop.
///
/// # Errors
/// As [`unit()`].
pub fn speed(elf: &[u8]) -> Result<Vec<(&'static str, f64)>> {
    let scene = Scene::new(elf, 1)?;
    let mut out = Vec::new();
    for (what, compare) in [("everything on", false), ("everything on, every frame compared with the desktop", true)] {
        let options = Options { seconds: Some(300), compare, ..Options::default() };
        let outcome = replay::run(elf, Some(&scene.calibration), scene.steps(), &options, |_| {})?;
        anyhow::ensure!(outcome.received.differing == 0, "the unit and the desktop differ");
        out.push((what, outcome.seconds / outcome.wall_s));
    }
    Ok(out)
}
