//! Flipped bits.

use super::{draws, good, run, trials, Extent, Report, Scene, BOUND_DPH, RESTART_S};
use anyhow::{Context, Result};
use hrg_board::host::cycles;
use hrg_board::replay::{CALIBRATION_A, CALIBRATION_B};
use hrg_board::wires::{Received, Wires};
use hrg_core::rate_path::RateFrame;
use hrg_core::sectors::room;
use hrg_core::status::UnitStatus;
use hrg_data::numeric::stats::share_interval;
use rand::Rng;
use virtual_board::{Board, Firmware, Stop, CPU_HZ, FLASH_START};

/// Effect of a flipped bit of RAM.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// Every frame as without it.
    Nothing,
    /// Frames differ, none of them further than [`BOUND_DPH`] and flagged good.
    Harmless,
    /// Frames further off, or none for a while, all flagged.
    Flagged,
    /// The unit was reset, sent rates again after so many seconds, and was good in the end.
    Reset(f64),
    /// The unit was reset, and its rates are flagged for longer than it takes to settle.
    Unwell,
    /// The unit was not reset and has stopped sending rates, or sent none within [`RESTART_S`] after a reset.
    Silent,
    /// Rates flagged good that were off: the largest error (deg/h), and for how long (s).
    Wrong(f32, f64),
}

/// From a restart until nothing is flagged, s: the window of the slope ([`hrg_core::rate_of_change::WINDOW`]), and some steps.
pub(super) const SETTLES_S: f64 = 26.0;

/// Seconds that a unit is watched after a flip: three model steps.
const WATCH_S: f64 = 3.3;

/// Error of the rates whose axis the unit stands behind, the worst of them, deg/h; zero where all that is wrong is flagged. A flag of
/// the unit is no excuse for an axis.
#[must_use]
pub fn unsaid(frame: &RateFrame, truth: &RateFrame) -> f32 {
    let mut worst = 0.0f32;
    for k in 0..3 {
        if frame.axis_status[k].is_empty() {
            let e = (frame.rate_dph[k] - truth.rate_dph[k]).abs();
            worst = worst.max(if e.is_nan() { f32::INFINITY } else { e });
        }
    }
    worst
}

/// Compares what a unit sent with what it sends undisturbed, frame by frame in order of their times.
fn judge(sent: &Received, truth: &Received, reset_at: Option<u64>, flipped_at: u64, end: u64) -> Fate {
    let (mut worst, mut wrong) = (0.0f32, 0u32);
    let mut differs = false;
    let mut flagged = false;
    let (mut back, mut paused) = (None, false);
    let mut last = flipped_at;
    for (f, &at) in sent.rates.iter().zip(&sent.rate_at) {
        // The longest pause that a running unit makes between frames is a few milliseconds.
        paused |= at > flipped_at && at - last > cycles(0.1);
        if reset_at.is_some_and(|r| at > r) {
            back = back.or(Some(at));
        }
        last = last.max(at);
        let Some(t) = truth.rates.get(nearest(truth, at)) else { continue };
        differs |= f != t;
        flagged |= !good(f);
        let e = unsaid(f, t);
        worst = worst.max(e);
        wrong += u32::from(e > BOUND_DPH);
    }
    if worst > BOUND_DPH {
        return Fate::Wrong(worst, f64::from(wrong) * 0.005);
    }
    if reset_at.is_some() {
        let well = sent.rates.last().is_some_and(good);
        return match back {
            Some(_) if !well => Fate::Unwell,
            Some(at) if (at - flipped_at) <= cycles(RESTART_S) => Fate::Reset((at - flipped_at) as f64 / CPU_HZ as f64),
            _ => Fate::Silent,
        };
    }
    if end - last > cycles(0.1) {
        return Fate::Silent;
    }
    match (differs, flagged || paused) {
        (_, true) => Fate::Flagged,
        (true, false) => Fate::Harmless,
        (false, false) => Fate::Nothing,
    }
}

/// Flips in the image in flash: alone in sector A, in the newer of two sectors, and in the newer of a row.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn image(scene: &Scene, extent: &Extent, report: &mut Report) -> Result<()> {
    let old = scene.calibration.clone();
    let mut new = old.clone();
    new.sequence = old.sequence + 1;
    let image = new.to_bytes().context("fits")?;
    let bits = image.len() as u64 * 8 / extent.every;
    for (what, place) in [
        ("bit of the image in flash", CALIBRATION_A),
        ("bit of the newer of two images, in sector B", CALIBRATION_B),
        ("bit of the newer of two images in a row", CALIBRATION_A + room(image.len()) as u32),
    ] {
        let two = place != CALIBRATION_A;
        let found = trials(
            bits,
            || {
                let mut board = scene.off(scene.wires(), if two { &old } else { &new })?;
                if two {
                    board.write_flash(place, &image)?;
                }
                let start = board.snapshot()?;
                Ok((board, start))
            },
            |(board, start), k| {
                board.restore(start)?;
                let bit = k * extent.every;
                board.flip_bit(FLASH_START + place + (bit / 8) as u32, (bit % 8) as u8)?;
                // (The ADC is set up in the first tenth.)
                run(board, cycles(0.3))?;
                let expected =
                    UnitStatus::IMAGE_REFUSED | if two { UnitStatus::empty() } else { UnitStatus::DEFAULT_CALIBRATION };
                let frames = &board.world.received.rates;
                Ok(!frames.is_empty() && frames.iter().all(|f| f.unit_status.contains(expected)))
            },
        )?;
        let noticed = found.iter().filter(|f| **f).count();
        report.row(
            what,
            bits,
            format!(
                "flagged in every frame {noticed}, not flagged {}; then runs {}",
                found.len() - noticed,
                if two { "the older image" } else { "the default, flagged uncalibrated" }
            ),
            noticed == found.len(),
        );
    }
    Ok(())
}

/// The share of [`Fate::Wrong`] that docs/promises.md admits. A campaign breaks the promise where the 95 % interval of what it found lies above.
const ADMITTED: f64 = 0.002;

/// Bits that change at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Corruption {
    /// One.
    Single,
    /// Two of one word.
    Double,
    /// Eight, one next to the other.
    Burst,
    /// One of the state of the rate path.
    Rates,
    /// One of a register of a peripheral.
    Register,
}

impl Corruption {
    const fn name(self) -> &'static str {
        match self {
            Self::Single => "bit of RAM in use, at a random time",
            Self::Double => "two bits of one word of RAM",
            Self::Burst => "eight bits of RAM in a row",
            Self::Rates => "bit of the rate path's state",
            Self::Register => "bit of a peripheral's register",
        }
    }

    /// The part of the seed that its trials draw from.
    const fn part(self) -> u64 {
        match self {
            Self::Single => 2,
            Self::Double => 5,
            Self::Burst => 6,
            Self::Register => 7,
            Self::Rates => 8,
        }
    }

    /// The bits that change, from the one that was drawn.
    fn bits(self, address: u32, bit: u8, draw: &mut impl Rng) -> Vec<(u32, u8)> {
        match self {
            Self::Single | Self::Register | Self::Rates => vec![(address, bit)],
            Self::Double => {
                let other = draw.random_range(1..32u32);
                let at = (u32::from(bit) + 8 * (address % 4) + other) % 32;
                vec![(address, bit), ((address & !3) + at / 8, (at % 8) as u8)]
            }
            Self::Burst => (0..8u32)
                .map(|k| {
                    let at = u32::from(bit) + k;
                    (address + at / 8, (at % 8) as u8)
                })
                .collect(),
        }
    }
}

/// Registers whose bits change, with how many of their bits are in use: those that the unit sets up and whose effect the board models. (Not
/// among them: pins, clock gates, the SPI's mode, addresses of peripherals in the DMA, which the board takes as they were set up.)
const REGISTERS: [(&str, u32, u32); 41] = {
    const TIM2: u32 = 0x4000_0000;
    const TIM3: u32 = 0x4000_0400;
    const TIM5: u32 = 0x4000_0C00;
    const DMA1: u32 = 0x4002_6000;
    const DMA2: u32 = 0x4002_6400;
    const NVIC: u32 = 0xE000_E100;
    const fn stream(dma: u32, n: u32, register: u32) -> u32 {
        dma + 0x10 + 0x18 * n + register
    }
    [
        ("TIM2 CR1", TIM2, 10),
        ("TIM2 DIER", TIM2 + 0x0C, 15),
        ("TIM2 CCMR1", TIM2 + 0x18, 16),
        ("TIM2 CCMR2", TIM2 + 0x1C, 16),
        ("TIM2 CCER", TIM2 + 0x20, 16),
        ("TIM2 PSC", TIM2 + 0x28, 16),
        ("TIM2 ARR", TIM2 + 0x2C, 32),
        ("TIM3 CCER", TIM3 + 0x20, 16),
        ("TIM3 DIER", TIM3 + 0x0C, 15),
        ("TIM5 CR1", TIM5, 10),
        ("TIM5 DIER", TIM5 + 0x0C, 15),
        ("TIM5 PSC", TIM5 + 0x28, 16),
        ("TIM5 ARR", TIM5 + 0x2C, 32),
        ("DMA1 S1CR", stream(DMA1, 1, 0), 28),
        ("DMA1 S1NDTR", stream(DMA1, 1, 4), 16),
        ("DMA1 S1M0AR", stream(DMA1, 1, 12), 32),
        ("DMA1 S5CR", stream(DMA1, 5, 0), 28),
        ("DMA1 S5NDTR", stream(DMA1, 5, 4), 16),
        ("DMA1 S5M0AR", stream(DMA1, 5, 12), 32),
        ("DMA1 S6CR", stream(DMA1, 6, 0), 28),
        ("DMA1 S6NDTR", stream(DMA1, 6, 4), 16),
        ("DMA1 S6M0AR", stream(DMA1, 6, 12), 32),
        ("DMA2 S0CR", stream(DMA2, 0, 0), 28),
        ("DMA2 S0NDTR", stream(DMA2, 0, 4), 16),
        ("DMA2 S0M0AR", stream(DMA2, 0, 12), 32),
        ("DMA2 S3CR", stream(DMA2, 3, 0), 28),
        ("DMA2 S3NDTR", stream(DMA2, 3, 4), 16),
        ("DMA2 S3M0AR", stream(DMA2, 3, 12), 32),
        ("DMA2 S5CR", stream(DMA2, 5, 0), 28),
        ("DMA2 S5NDTR", stream(DMA2, 5, 4), 16),
        ("DMA2 S5M0AR", stream(DMA2, 5, 12), 32),
        ("DMA2 S7CR", stream(DMA2, 7, 0), 28),
        ("DMA2 S7NDTR", stream(DMA2, 7, 4), 16),
        ("DMA2 S7M0AR", stream(DMA2, 7, 12), 32),
        ("SPI1 CR1", 0x4001_3000, 16),
        ("SPI1 CR2", 0x4001_3004, 8),
        ("USART1 CR1", 0x4001_100C, 16),
        ("USART1 CR3", 0x4001_1014, 12),
        ("NVIC ISER0", NVIC, 32),
        ("NVIC ISER1", NVIC + 4, 32),
        ("NVIC ISER2", NVIC + 8, 32),
    ]
};

/// The state of the rate path.
const RATES: &str = "firmware::rate::start::PLACE";
/// A prime that is no factor of the number of its bits.
const SCATTER: u64 = 7919;

/// Name of the register or symbol at an address: for the report of a failure.
fn place(program: &Firmware, corruption: Corruption, address: u32) -> String {
    let register = REGISTERS.iter().find(|r| corruption == Corruption::Register && r.1 == address).map(|r| r.0);
    register.or_else(|| program.symbol_at(address)).unwrap_or("stack").to_string()
}

/// One flip of the campaign again, with what happened on the way, in words.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn again(scene: &Scene, seed: u64, trial: u64, corruption: Corruption) -> Result<()> {
    let mut board = scene.settled()?;
    let truth = scene.undisturbed(&mut board, WATCH_S + RESTART_S + 1.0)?;
    let begin = board.now();
    let (bits, flipped_at) = draw(&board, seed, trial, corruption)?;
    let (address, bit) = bits[0];
    let name = place(board.firmware(), corruption, address);
    let ms = |at: u64| (at as f64 - flipped_at as f64) * 1e3 / CPU_HZ as f64;
    println!("bit {bit} of {address:#010x} ({name}), {:.1} ms into the scene", -ms(begin));
    run(&mut board, flipped_at)?;
    strike(&mut board, corruption, &bits)?;
    let end = flipped_at + cycles(WATCH_S + RESTART_S);
    while board.now() < end {
        let stop = board.run_until(end)?;
        if stop != Stop::Time {
            println!("{:9.1} ms: {stop:?} reset, {} CPU faults so far", ms(board.now()), board.faults());
        }
    }
    let pc = board.firmware().symbol_at(board.pc()).unwrap_or_default();
    println!("at the end: in {} ({:#010x}), {} CPU faults", pc, board.pc(), board.faults());
    let r = &board.world.received;
    let mut last = None;
    for (f, at) in r.rates.iter().zip(&r.rate_at).filter(|(_, at)| **at >= flipped_at) {
        let e = truth.rates.get(nearest(&truth, *at)).map_or(f32::NAN, |t| unsaid(f, t));
        let now = (f.axis_status, f.unit_status, e > BOUND_DPH);
        if last.replace((now, *at)).is_none_or(|(before, t)| before != now || at - t > cycles(0.1)) {
            println!("{:9.1} ms: frames {:?} {:?}, unflagged error {e} deg/h", ms(*at), f.axis_status, f.unit_status);
        }
    }
    println!("{:9.1} ms: last frame", last.map_or(f64::NAN, |l| ms(l.1)));
    Ok(())
}

/// Addresses and bits of a corruption, and its time.
fn draw(board: &Board<Wires>, seed: u64, trial: u64, corruption: Corruption) -> Result<(Vec<(u32, u8)>, u64)> {
    let mut draw = draws(seed, corruption.part(), trial);
    if corruption == Corruption::Register {
        // Each bit in use is as likely as another.
        let mut at = draw.random_range(0..REGISTERS.iter().map(|r| r.2).sum());
        let register = REGISTERS.iter().find(|r| {
            let here = at < r.2;
            at -= if here { 0 } else { r.2 };
            here
        });
        let address = register.map_or(REGISTERS[0].1, |r| r.1);
        return Ok((vec![(address, at as u8)], board.now() + draw.random_range(0..CPU_HZ)));
    }
    if corruption == Corruption::Rates {
        let place = board.firmware().place_of(RATES).context("the firmware has no state of the rate path")?;
        // (None twice, from all over it.)
        let bit = trial.wrapping_mul(SCATTER) % (8 * place.len().max(1) as u64);
        let flipped_at = board.now() + draw.random_range(0..CPU_HZ);
        return Ok((vec![(place.start + (bit / 8) as u32, (bit % 8) as u8)], flipped_at));
    }
    let (statics, stack) = (board.static_bytes(), board.stack_used());
    let at = draw.random_range(0..statics + stack);
    // Statics from their start up, the stack from its top down.
    let program = board.firmware();
    let address = if at < statics { program.statics().start + at } else { program.stack().end - 1 - (at - statics) };
    let flipped_at = board.now() + draw.random_range(0..CPU_HZ);
    let bit = draw.random_range(0..8);
    Ok((corruption.bits(address, bit, &mut draw), flipped_at))
}

/// It strikes.
fn strike(board: &mut Board<Wires>, corruption: Corruption, bits: &[(u32, u8)]) -> Result<()> {
    for &(address, bit) in bits {
        if corruption == Corruption::Register {
            board.flip_register(address, bit.into())?;
        } else {
            // (A burst may end behind the memory in use, never behind the RAM.)
            board.flip_bit(address, bit)?;
        }
    }
    Ok(())
}

/// The undisturbed frame that was sent at about the same time.
pub(super) fn nearest(truth: &Received, at: u64) -> usize {
    let step = 5 * CPU_HZ / 1000;
    let first = truth.rate_at.first().copied().unwrap_or(0);
    // Rates are sent 0.4 ms after their sample; housekeeping may delay them by 2 ms.
    (((at + step / 4).saturating_sub(first) / step) as usize).min(truth.rates.len().saturating_sub(1))
}

/// Corruptions `0..n` that something reads before it is overwritten, by one run: the others have no effect, for the board is deterministic.
///
/// # Errors
/// If the unit cannot be run at all, or sends other frames when it is watched.
pub fn looked_at(scene: &Scene, seed: u64, n: u64, corruption: Corruption) -> Result<Vec<bool>> {
    if corruption == Corruption::Register {
        return Ok(vec![true; n as usize]);
    }
    let mut board = scene.settled()?;
    // (They strike within a second.)
    let watched_s = 1.0 + WATCH_S;
    let end = board.now() + cycles(watched_s);
    let truth = scene.undisturbed(&mut board, watched_s)?;
    let mut drawn: Vec<(u64, usize, Vec<u32>)> = (0..n)
        .map(|k| {
            let (bits, at) = draw(&board, seed, k, corruption)?;
            Ok((at, k as usize, bits.iter().map(|(address, _)| *address).collect()))
        })
        .collect::<Result<_>>()?;
    drawn.sort_unstable();
    for (at, k, bytes) in &drawn {
        run(&mut board, *at)?;
        board.watch(*k, bytes)?;
    }
    run(&mut board, end)?;
    let read = board.looked_at()?;
    anyhow::ensure!(board.world.received.rates == truth.rates, "a unit that is watched sends other frames");
    Ok((0..n as usize).map(|k| read.contains(&k)).collect())
}

/// Effects of corruptions, each at a random place and a random time of a settled second: of those that `looked_at` says are read.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn flips(scene: &Scene, seed: u64, looked_at: &[bool], corruption: Corruption) -> Result<Vec<(u32, Fate)>> {
    trials(
        looked_at.len() as u64,
        || {
            let mut board = scene.settled()?;
            let truth = scene.undisturbed(&mut board, WATCH_S + RESTART_S + SETTLES_S + 1.0)?;
            let start = board.snapshot()?;
            Ok((board, start, truth))
        },
        |(board, start, truth), k| {
            board.restore(start)?;
            let (bits, flipped_at) = draw(board, seed, k, corruption)?;
            if !looked_at[k as usize] {
                return Ok((bits[0].0, Fate::Nothing));
            }
            run(board, flipped_at)?;
            strike(board, corruption, &bits)?;
            let mut end = flipped_at + cycles(WATCH_S);
            let mut reset_at = run(board, end)?.last;
            if reset_at.is_some() || board.faults() > 0 || quiet(&board.world.received, end) {
                // The watchdog takes its time.
                end += cycles(RESTART_S);
                reset_at = run(board, end)?.last.or(reset_at);
                if reset_at.is_some() {
                    // Until its window of the slope is full.
                    end += cycles(SETTLES_S);
                    run(board, end)?;
                }
            }
            let fate = judge(&board.world.received, truth, reset_at, flipped_at, end);
            Ok((bits[0].0, fate))
        },
    )
}

fn quiet(r: &Received, end: u64) -> bool {
    r.rate_at.last().is_none_or(|at| end - at > cycles(0.1))
}

/// A share of a campaign's trials: so many, one at the least.
fn share(extent: &Extent, of: u64) -> u64 {
    (extent.random / of).max(1)
}

/// Flips in RAM.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn ram(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    for (corruption, of) in
        [(Corruption::Single, 1), (Corruption::Double, 5), (Corruption::Burst, 5), (Corruption::Rates, 10)]
    {
        corruptions(scene, seed, share(extent, of), corruption, report)?;
    }
    Ok(())
}

/// Flips in the registers of peripherals.
///
/// # Errors
/// If the unit cannot be run at all.
pub fn registers(scene: &Scene, seed: u64, extent: &Extent, report: &mut Report) -> Result<()> {
    corruptions(scene, seed, share(extent, 5), Corruption::Register, report)
}

/// Corruptions of one kind.
fn corruptions(scene: &Scene, seed: u64, n: u64, corruption: Corruption, report: &mut Report) -> Result<()> {
    let looked_at = looked_at(scene, seed, n, corruption)?;
    let read = looked_at.iter().filter(|read| **read).count();
    let fates = flips(scene, seed, &looked_at, corruption)?;
    let count = |of: fn(&Fate) -> bool| fates.iter().filter(|(_, f)| of(f)).count();
    let slowest = fates.iter().map(|(_, f)| if let Fate::Reset(s) = f { *s } else { 0.0 }).fold(0.0, f64::max);
    let wrong: Vec<(f32, f64)> =
        fates.iter().filter_map(|(_, f)| if let Fate::Wrong(e, s) = f { Some((*e, *s)) } else { None }).collect();
    let program = Firmware::parse(scene.elf())?;
    println!("  {read} of {} are read before they are overwritten", fates.len());
    for (k, (address, fate)) in fates.iter().enumerate() {
        if matches!(fate, Fate::Silent | Fate::Unwell | Fate::Wrong(..)) {
            let name = place(&program, corruption, *address);
            println!("  trial {k}: {address:#010x} ({name}): {fate:?}");
        }
    }
    let unwell = count(|f| *f == Fate::Unwell);
    let silent = count(|f| *f == Fate::Silent);
    let lasting = wrong.iter().filter(|w| w.1 > 1.5).count();
    let (low, high) = share_interval(wrong.len(), fates.len());
    report.row(
        corruption.name(),
        fates.len() as u64,
        format!(
            "no effect {}, within {BOUND_DPH} deg/h {}, flagged {}, reset and back within {slowest:.1} s {}, flagged for longer after a reset {unwell}, silent for good {silent}, wrong and not flagged {} (95 %: {:.2} to {:.2} %; of them for more than 1.5 s: {lasting})",
            count(|f| *f == Fate::Nothing),
            count(|f| *f == Fate::Harmless),
            count(|f| *f == Fate::Flagged),
            count(|f| matches!(f, Fate::Reset(_))),
            wrong.len(),
            100.0 * low,
            100.0 * high,
        ),
        // (A register that was struck may keep a flag standing after a reset; the rates must come back.)
        silent == 0 && (corruption == Corruption::Register || unwell == 0) && low <= ADMITTED,
    );
    Ok(())
}
