//! A year of time stamps through the core, in jumps from wrap to wrap.

use super::{Extent, Report};
use hrg_core::filter::Filter;
use hrg_core::frequency::{Config, CounterBank, GATES_PER_STEP, SETTLE_US};
use hrg_core::rate_path::{PendingBias, RatePath, BIAS_DELAY_MS};
use hrg_core::status::AxisStatus;
use hrg_core::timebase::Timebase;

const DAYS: u64 = 366;
const TICKS: u64 = Timebase::REFERENCE.ticks_per_s() as u64;
/// Edges on either side of a wrap, s.
const AROUND_S: u64 = 2;
const HZ: f64 = 4871.747;

/// Failures found, counted.
#[derive(Debug, Default)]
struct Found {
    wraps: u64,
    steps: u64,
    off: u64,
    worst_hz: f64,
    times: u64,
    milliseconds_wrapped: bool,
}

/// Every `every`-th wrap of the 32-bit timer in a year, with edges, samples and biases on both sides of it.
fn leap(every: u64) -> Found {
    let mut bank = CounterBank::new(Config::REFERENCE, GATES_PER_STEP);
    let mut path = RatePath::new(Timebase::REFERENCE, [0.01; 3], 5);
    let mut found = Found::default();
    let mut last_ms = 0u32;
    let mut wrap = 1u64 << 32;
    let end = DAYS * 86_400 * TICKS;
    while wrap < end {
        // To the neighbourhood of the wrap: gates without edges go by.
        let from = wrap - AROUND_S * TICKS;
        while bank.close_tick() < from {
            let at = bank.close_tick();
            if let Some(step) = bank.poll(at as u32) {
                found.times += u64::from(step.end_ticks + u64::from(Timebase::REFERENCE.us(SETTLE_US)) != at);
                found.off += u64::from(step.frequency_hz.iter().any(Option::is_some) && found.steps == 0);
            }
        }
        let first = (from as f64 * HZ / TICKS as f64).ceil() as u64;
        let (mut good, mut next_sample) = (0, from);
        for k in 0..(2 * AROUND_S) * HZ as u64 {
            // In integers: a year of ticks have no room left in an f64 for a fraction of one.
            let t = ((u128::from(first + k) * u128::from(TICKS) * 1000) / u128::from((HZ * 1000.0) as u64)) as u64;
            while t > bank.close_tick() {
                let at = bank.close_tick();
                let Some(step) = bank.poll(at as u32) else { continue };
                found.steps += 1;
                found.times += u64::from(step.end_ticks + u64::from(Timebase::REFERENCE.us(SETTLE_US)) != at);
                let ms = (step.end_ticks / (TICKS / 1000)) as u32;
                found.milliseconds_wrapped |= ms < last_ms;
                last_ms = ms;
                if let Some(f) = step.frequency_hz[0] {
                    good += 1;
                    found.worst_hz = found.worst_hz.max((f - HZ).abs());
                }
                path.set_bias(PendingBias::at(
                    (step.end_ticks as u32).wrapping_add(Timebase::REFERENCE.ms(BIAS_DELAY_MS)),
                    step.step,
                    [0.0; 3],
                    [AxisStatus::empty(); 3],
                ));
            }
            // Samples of the rate path meanwhile, on the same clock.
            while next_sample < t {
                next_sample += TICKS / 1000;
                if let Some(f) = path
                    .sample(
                        next_sample as u32,
                        [next_sample as i32 & 3, 1 + (next_sample as i32 & 4), next_sample as i32 & 8, 0, 0, 0],
                    )
                    .frame
                {
                    // (A frame is of the middle of its samples, and of 1.5 ms before by the ADC's filter.)
                    let late = Filter::Mean.delay_halves(5) * (TICKS / 2000) as u32;
                    found.off += u64::from(f.tick.wrapping_add(late) != next_sample as u32);
                    // After the first bias of this neighbourhood no age is wrong.
                    found.off += u64::from(good > 1 && f.axis_status != [AxisStatus::empty(); 3]);
                }
            }
            bank.push(0, [t as u32]);
        }
        // The second before the wrap and the one across it.
        found.off += u64::from(good < 2);
        found.wraps += 1;
        wrap += every << 32;
    }
    found
}

/// The whole stretch.
pub fn attack(extent: &Extent, report: &mut Report) {
    let f = leap(extent.wraps);
    report.row(
        format!("{DAYS} days of time stamps, wrap by wrap"),
        f.wraps,
        format!(
            "wraps of the 32-bit timer{}; frequency off by {:.1} uHz at most; {} wrong frames or steps, {} wrong times",
            if f.milliseconds_wrapped { " and of the 32-bit milliseconds" } else { "" },
            f.worst_hz * 1e6,
            f.off,
            f.times
        ),
        f.off == 0 && f.times == 0 && f.worst_hz < 20e-6,
    );
}
