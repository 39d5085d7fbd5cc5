//! The promises of docs/promises.md, attacked: faults into the flashed program on the virtual board, counted.
//!
//! Every trial begins at the same moment of a running unit ([`Scene`]) and draws its fault from the seed and its own number
//! alone, so a campaign gives the same figures on any number of threads, and one trial can be run again by itself.
//!
//! | module | attacks |
//! |---|---|
//! | [`power`] | cuts while a calibration is written, and at random instructions |
//! | [`update`] | cuts while a new program is written, and while it is on trial |
//! | [`memory`] | flipped bits in the image in flash, in RAM, and in registers |
//! | [`chip`] | ADC, program, crystal, supply, starts |
//! | [`sensors`] | resonators and ADC, one by one and in pairs |
//! | [`link`] | noise, cut, mutated, replayed and reordered frames, floods |
//! | [`load`] | everything at once |
//! | [`time`] | a year of time stamps |

pub mod chip;
pub mod link;
pub mod load;
pub mod memory;
pub mod power;
pub mod sensors;
pub mod time;
pub mod update;

use anyhow::{Context, Result};
use hrg_board::replay::CALIBRATION_A;
use hrg_board::wires::{Received, Wires};
use hrg_board::{KEPT_REST, KEPT_STATES, RAN_LAST};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::EffectId;
use hrg_core::frequency::StepFrequencies;
use hrg_core::rate_path::RateFrame;
use hrg_core::slots::{mark, ADDRESSES};
use hrg_core::status::AxisStatus;
use hrg_core::AXES;
use hrg_data::recording::steps::Steps;
use hrg_identify::fit::correct::Model;
use hrg_identify::fit::prepare;
use hrg_papers::method::Method;
use hrg_papers::methods::identify;
use hrg_simulate::{Plan, Profile};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::fmt::Write as _;
use virtual_board::{Board, Stop, CPU_HZ};

/// A corrected rate that is flagged good and further than this from that of an undisturbed unit is a broken promise, deg/h.
/// (The noise of the simulated unit is six times as large.)
pub const BOUND_DPH: f32 = 0.1;

/// After a fault that stops it, the unit sends rates again within this time, s: the watchdog's half second (three with the
/// link's own patience) and a start.
pub const RESTART_S: f64 = 4.0;

/// A unit that runs: the ELF, a calibration with effects, a chamber run on its wires.
pub struct Scene {
    elf: Vec<u8>,
    steps: Steps,
    /// Calibration in its flash.
    pub calibration: Calibration,
    /// The states of its model when the scene begins: it has been on for hours.
    kept: Vec<u32>,
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Scene")
    }
}

/// Seconds after which a unit has settled.
const SETTLED_S: u64 = 40;

impl Scene {
    /// A simulated unit on the ramp of a chamber run. Its image holds eq 7, as fitted, and five effects on top: all that a
    /// unit runs at most in practice, so that their states are there to be hit.
    ///
    /// # Errors
    /// If the simulated run cannot be fitted.
    pub fn new(elf: &[u8], seed: u64) -> Result<Self> {
        let recording = Plan::of(Profile::parse("cycle")?, 21, seed).simulate().recording;
        let prepared = prepare(std::slice::from_ref(&recording))?;
        let mut calibration = identify(&prepared, Method::Lsq, seed)?.calibration;
        calibration.set_unit_name("HRG-21");
        for (effect, parameters, gain, on) in [
            (EffectId::Cubic, [0.0; 2], 0.05, &[0, 1, 2][..]),
            (EffectId::ThermalLag, [900.0, 0.0], 0.1, &[0, 1, 2]),
            (EffectId::Hysteresis, [4.0, 0.0], 0.05, &[0, 1, 2]),
            (EffectId::WarmUp, [1500.0, 0.0], 0.2, &[0, 1, 2]),
            (EffectId::AxisGradient, [0.0; 2], 0.05, &[LOOKS_AT_OTHERS]),
        ] {
            let facts = effect.facts();
            let mut term = EffectTerm::new(facts.id, parameters);
            for axis in on {
                term.gains[*axis][..facts.outputs].fill(gain);
            }
            calibration.effects.push(term).ok().context("room for five effects")?;
        }
        let mut steps = Steps::new(&recording)?;
        let mut model = Model::new(calibration.clone(), 0.0);
        for k in 0..RAMP_FROM {
            model.step(&StepFrequencies {
                step: k as u32,
                end_ticks: 0,
                frequency_hz: steps.frequency_hz.each_ref().map(|f| Some(f[k]).filter(|f| f.is_finite())),
                rejected: [0; AXES],
                missing: [0; AXES],
            });
        }
        let kept = model.keep();
        // From the middle of the first ramp. The rates stand still, so that a frame is right whichever samples it is of.
        steps.frequency_hz.iter_mut().for_each(|f| drop(f.drain(..RAMP_FROM)));
        for (series, rate) in steps.rate_dph.iter_mut().zip([1.2345, -2.3456, 0.7891]) {
            series.fill(rate);
        }
        Ok(Self { elf: elf.to_vec(), steps, calibration, kept })
    }

    /// The chamber run that it lives through.
    #[must_use]
    pub fn steps(&self) -> &Steps {
        &self.steps
    }

    /// The program.
    #[must_use]
    pub fn elf(&self) -> &[u8] {
        &self.elf
    }

    /// Signals on its wires.
    #[must_use]
    pub fn wires(&self) -> Wires {
        let scale = self.calibration.scale_factors_dph_per_code();
        Wires::new(self.steps.clone(), scale, 20e-9, 1, None, None)
    }

    /// A board that is just being switched on, with that on its wires and an image in sector A.
    ///
    /// # Errors
    /// If the ELF does not run on the board.
    pub fn off(&self, wires: Wires, image: &Calibration) -> Result<Board<Wires>> {
        let mut board = Board::new(&self.elf, wires)?;
        board.write_flash(CALIBRATION_A, &image.to_bytes().context("fits an image")?)?;
        board.faults_as_on_chip();
        Ok(board)
    }

    /// A board that starts after a reset of its program, with the states of a unit that has been on for hours.
    ///
    /// # Errors
    /// As [`off`](Self::off).
    pub fn restarted(&self) -> Result<Board<Wires>> {
        let mut board = self.off(self.wires(), &self.calibration)?;
        self.keep(&mut board)?;
        board.reset_by_software()?;
        Ok(board)
    }

    /// Puts the states of a unit that has been on for hours where a unit keeps them.
    ///
    /// # Errors
    /// A firmware that keeps none.
    pub fn keep(&self, board: &mut Board<Wires>) -> Result<()> {
        let address = board.firmware().address_of(KEPT_STATES).context("the firmware keeps no states")?;
        let bytes: Vec<u8> = self.kept.iter().flat_map(|w| w.to_le_bytes()).collect();
        // They are those of the program in slot A, and the unit was at rest.
        let (rest, value) = KEPT_REST;
        let rest = board.firmware().address_of(rest).context("the firmware does not keep if it was at rest")?;
        board.write_ram(rest, &value.to_le_bytes())?;
        let ran = board.firmware().address_of(RAN_LAST).context("the firmware does not say who ran last")?;
        let sum = board.firmware().word(ADDRESSES[0] + mark::SUM as u32).context("no slot")?;
        board.write_ram(ran, &sum.to_le_bytes())?;
        Ok(board.write_ram(address, &bytes)?)
    }

    /// A board that has settled and has nothing to complain of.
    ///
    /// # Errors
    /// As [`off`](Self::off).
    pub fn settled(&self) -> Result<Board<Wires>> {
        let mut board = self.restarted()?;
        run(&mut board, SETTLED_S * CPU_HZ)?;
        board.world.received = Received::default();
        Ok(board)
    }

    /// Frames that the board sends in the next seconds if nothing is wrong.
    ///
    /// # Errors
    /// As [`off`](Self::off).
    pub fn undisturbed(&self, board: &mut Board<Wires>, seconds: f64) -> Result<Received> {
        let start = board.snapshot()?;
        let until = board.now() + (seconds * CPU_HZ as f64) as u64;
        run(board, until)?;
        let received = std::mem::take(&mut board.world.received);
        board.restore(&start)?;
        anyhow::ensure!(received.rates.iter().all(good), "the undisturbed unit complains");
        Ok(received)
    }
}

/// The axis of a scene that has an effect which looks at the others.
const LOOKS_AT_OTHERS: usize = 2;

/// Step of the run at which scenes begin.
const RAMP_FROM: usize = 9000;

/// A frame that the unit stands behind.
#[must_use]
pub fn good(f: &RateFrame) -> bool {
    f.axis_status.iter().all(AxisStatus::is_empty) && f.unit_status.is_empty()
}

/// Resets on the way: how many, and when the last.
#[derive(Debug, Clone, Copy, Default)]
struct Resets {
    n: u32,
    last: Option<u64>,
}

/// Runs to a time.
fn run(board: &mut Board<Wires>, until: u64) -> Result<Resets> {
    let mut resets = Resets::default();
    loop {
        match board.run_until(until)? {
            Stop::Time => return Ok(resets),
            Stop::Watchdog | Stop::Software => resets = Resets { n: resets.n + 1, last: Some(board.now()) },
            Stop::Instruction | Stop::Flash | Stop::Exit(_) => anyhow::bail!("stopped where nobody asked for it"),
        }
    }
}

/// The random numbers of a trial.
pub(crate) fn draws(seed: u64, part: u64, trial: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed ^ part.rotate_left(48) ^ trial.wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

/// Trials 0 to `n` on all cores; `make` sets a worker up, `trial` does one. In the order of their numbers. A terminal shows how far they are.
pub(crate) fn trials<S, T: Send>(
    n: u64,
    make: impl Fn() -> Result<S> + Sync,
    trial: impl Fn(&mut S, u64) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(n.max(1) as usize);
    let bar = indicatif::ProgressBar::new(n);
    bar.set_style(indicatif::ProgressStyle::with_template("{bar:40} {pos} of {len}, {eta} left")?);
    let (make, trial, counted) = (&make, &trial, &bar);
    let parts = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..workers as u64)
            .map(|w| {
                scope.spawn(move || -> Result<Vec<(u64, T)>> {
                    let mut state = make()?;
                    (w..n)
                        .step_by(workers)
                        .map(|k| {
                            let done = trial(&mut state, k).with_context(|| format!("trial {k}"))?;
                            counted.inc(1);
                            Ok((k, done))
                        })
                        .collect()
                })
            })
            .collect();
        handles
            .into_iter()
            .map(|h| h.join().map_err(|_| anyhow::anyhow!("a worker panicked"))?)
            .collect::<Result<Vec<_>>>()
    })?;
    bar.finish_and_clear();
    let mut all: Vec<(u64, T)> = parts.into_iter().flatten().collect();
    all.sort_by_key(|(k, _)| *k);
    Ok(all.into_iter().map(|(_, t)| t).collect())
}

/// One row of the report.
#[derive(Debug, Clone)]
pub struct Row {
    /// Part of the unit that was attacked.
    pub what: String,
    /// Number of faults tried.
    pub tried: u64,
    /// Effects of the faults.
    pub found: String,
    /// `true` if the promise was kept.
    pub kept: bool,
}

/// The rows of a campaign.
#[derive(Debug, Default)]
pub struct Report {
    /// In order.
    pub rows: Vec<Row>,
}

impl Report {
    fn row(&mut self, what: impl Into<String>, tried: u64, found: impl Into<String>, kept: bool) {
        let row = Row { what: what.into(), tried, found: found.into(), kept };
        println!("{:<44} {:>9}  {}{}", row.what, row.tried, row.found, if kept { "" } else { "  BROKEN" });
        self.rows.push(row);
    }

    /// `true` if every promise was kept.
    #[must_use]
    pub fn kept(&self) -> bool {
        self.rows.iter().all(|r| r.kept)
    }

    fn markdown(&self) -> String {
        let mut s = String::from("| attacked | faults | what happened |\n|---|---:|---|\n");
        for r in &self.rows {
            let _ =
                writeln!(s, "| {} | {} | {}{} |", r.what, r.tried, r.found, if r.kept { "" } else { " **BROKEN**" });
        }
        s
    }
}

/// Extent of a campaign: faults tried of each kind.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Power cuts at random instructions, and bits of RAM flipped.
    pub random: u64,
    /// Every n-th flash operation and bit of an image.
    pub every: u64,
    /// `true`: each fault of a resonator is tried on each axis; `false`: on one of them.
    pub on_each_axis: bool,
    /// Every n-th pair of sensor faults.
    pub pairs: u64,
    /// Bytes of noise on the link.
    pub bytes: u64,
    /// Seconds under full load.
    pub load_s: u64,
    /// Every n-th wrap of the timer in a year.
    pub wraps: u64,
}

impl Extent {
    /// Extent of the figures in docs/promises.md.
    pub const FULL: Self =
        Self { random: 10_000, every: 1, on_each_axis: true, pairs: 1, bytes: 10_000_000, load_s: 3600, wraps: 7 };
    /// Extent of every test run.
    pub const SHORT: Self =
        Self { random: 40, every: 200, on_each_axis: false, pairs: 100, bytes: 100_000, load_s: 5, wraps: 30_000 };
}

/// The parts of a campaign, in order.
pub const PARTS: [&str; 10] =
    ["power", "update", "image", "memory", "registers", "chip", "sensors", "link", "time", "load"];

/// The whole campaign, or one of its [`PARTS`]. Prints each row as it comes.
///
/// # Errors
/// If the firmware cannot be run at all; broken promises are in the report.
pub fn campaign(elf: &[u8], seed: u64, extent: &Extent, only: Option<&str>) -> Result<Report> {
    let scene = Scene::new(elf, seed)?;
    let mut report = Report::default();
    println!("{:<44} {:>9}  what happened", "attacked", "faults");
    let wanted = |part: &str| only.is_none_or(|o| o == part);
    std::thread::scope(|scope| {
        // One long run, which cannot be parted: beside the others.
        let load = wanted("load").then(|| scope.spawn(|| load::attack(&scene, extent)));
        for part in PARTS.iter().filter(|p| wanted(p)) {
            match *part {
                "power" => power::attack(&scene, seed, extent, &mut report)?,
                "update" => update::attack(&scene, seed, extent, &mut report)?,
                "image" => memory::image(&scene, extent, &mut report)?,
                "memory" => memory::ram(&scene, seed, extent, &mut report)?,
                "registers" => memory::registers(&scene, seed, extent, &mut report)?,
                "chip" => chip::attack(&scene, seed, extent, &mut report)?,
                "sensors" => sensors::attack(&scene, extent, &mut report)?,
                "link" => link::attack(&scene, seed, extent, &mut report)?,
                "time" => time::attack(extent, &mut report),
                _ => {}
            }
        }
        if let Some(load) = load {
            let row = load.join().map_err(|_| anyhow::anyhow!("the load's thread panicked"))??;
            report.row(row.what, row.tried, row.found, row.kept);
        }
        Ok(report)
    })
}

/// [`campaign`], and its table written between the marks of a page.
///
/// # Errors
/// As [`campaign`]; where a promise was broken; where the page cannot be written.
pub fn faults(
    elf: &[u8],
    seed: u64,
    extent: &Extent,
    only: Option<&str>,
    page: Option<&std::path::Path>,
) -> Result<()> {
    let start = std::time::Instant::now();
    let report = campaign(elf, seed, extent, only)?;
    let total: u64 = report.rows.iter().map(|r| r.tried).sum();
    println!("{total} faults tried, seed {seed}, {:.0} s", start.elapsed().as_secs_f64());
    if let Some(page) = page {
        crate::pages::splice(page, "faults", &report.markdown())?;
    }
    let broken = report.rows.iter().filter(|r| !r.kept).count();
    anyhow::ensure!(broken == 0, "{broken} promises were broken");
    println!("every promise was kept");
    Ok(())
}
