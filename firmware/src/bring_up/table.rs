//! The table: what was reached, what is expected, and whether that is enough.

use super::expected::EXPECTED;
use embassy_time::Timer;

/// Largest permitted difference of a figure from its expected value.
pub enum Bound {
    /// By so much, in its unit.
    By(f32),
    /// By that share of what is expected: what cycles are estimated to (docs/bench.md), and a board has other caches, buses and waits.
    Share(f32),
    /// The expected value is the data sheet's longest. A figure may be less, or more by so much, which the program needs for itself.
    AtMost(f32),
    /// From the first to the second, whatever the virtual board has.
    Between(f32, f32),
}

/// A figure: its name, which names the jumpers that it goes over, its unit, its bound.
pub struct Row(&'static str, &'static str, Bound);

/// The rows, in their order.
#[derive(Clone, Copy)]
pub enum Item {
    WaveX,
    WaveY,
    WaveZ,
    ShortestPeriod,
    LongestPeriod,
    EdgesLost,
    Samples,
    AdcErrors,
    RateX,
    RateY,
    RateZ,
    AdcReset,
    RateFrames,
    BadFrames,
    Answers,
    Pulses,
    Clock,
    Lsi,
    LsiSpread,
    Status,
    Latency,
    WorstLatency,
    Update,
    Load,
    Erase,
    FirstFrame,
}

/// Number of rows.
pub const ROWS: usize = Item::FirstFrame as usize + 1;
const _: () = assert!(EXPECTED.len() == ROWS);

/// By how much an estimate of cycles may be off on a board.
const ESTIMATE: Bound = Bound::Share(0.25);

const TABLE: [Row; ROWS] = [
    Row("wave x (PB9-PA0): frequency", "Hz", Bound::By(0.01)),
    Row("wave y (PA8-PA1): frequency", "Hz", Bound::By(0.01)),
    Row("wave z (PB14-PB10): frequency", "Hz", Bound::By(0.01)),
    Row("wave x: shortest period captured", "ticks", Bound::By(0.0)),
    Row("wave x: longest period captured", "ticks", Bound::By(0.0)),
    Row("waves x, y, z: edges missing or rejected", "", Bound::By(0.0)),
    Row("data-ready (PC9-PB2): samples a second", "", Bound::By(1.0)),
    Row("ADC frames (PB6-PB12, PA5-PB13, PA7-PC3, PC2-PA6): refused", "", Bound::By(0.0)),
    Row("corrected rate x", "deg/h", Bound::By(0.001)),
    Row("corrected rate y", "deg/h", Bound::By(0.001)),
    Row("corrected rate z", "deg/h", Bound::By(0.001)),
    Row("ADC reset (PC7-PC0): resets after three bad frames", "", Bound::By(0.0)),
    Row("link out (PA9-PD2): rate frames a second", "", Bound::By(1.0)),
    Row("link out (PA9-PD2): bad frames", "", Bound::By(0.0)),
    Row("link in (PC12-PA10): answers to a question", "", Bound::By(0.0)),
    Row("pulses per second (PB8-PC6): taken", "", Bound::By(0.0)),
    Row("pulses per second: the unit's clock is fast by", "ppb", Bound::By(50.0)),
    // Data sheet, LSI oscillator characteristics.
    Row("LSI by the crystal: frequency", "Hz", Bound::Between(17_000.0, 47_000.0)),
    // At least a count, for LSI is not in step with the timer. No manual has a most; a tenth of the shortest would be captures that were missed.
    Row("LSI by the crystal: eight periods, longest less shortest", "us", Bound::Between(1.0, 17.0)),
    Row("flags of the unit: no calibration, and nothing else", "", Bound::By(0.0)),
    Row("data-ready to corrected sample: mean", "cycles", ESTIMATE),
    Row("data-ready to corrected sample: worst", "cycles", ESTIMATE),
    Row("bias update", "cycles", ESTIMATE),
    Row("load of the unit's tasks", "%", ESTIMATE),
    // (The watchdog is given more patience before and less after: each takes some periods of LSI.)
    Row("erase of sector 2", "ms", Bound::AtMost(2.0)),
    Row("start of the clocks to the first rate frame", "ms", Bound::By(10.0)),
];

/// Measured figures; not a number where it was not measured.
pub struct Reached([f32; ROWS]);

impl Reached {
    /// Nothing yet.
    pub fn nothing() -> Self {
        Self([f32::NAN; ROWS])
    }

    /// A figure.
    pub fn set(&mut self, item: Item, value: f32) {
        self.0[item as usize] = value;
    }

    /// Prints all of it.
    pub async fn print(&self) {
        let mut passed = 0;
        for ((Row(name, unit, bound), reached), (_, expected)) in TABLE.iter().zip(self.0).zip(EXPECTED) {
            let (least, most) = match bound {
                Bound::By(by) => (expected - by, expected + by),
                Bound::Share(share) => (expected - share * expected, expected + share * expected),
                Bound::AtMost(more) => (0.0, expected + more),
                Bound::Between(least, most) => (*least, *most),
            };
            let pass = (least..=most).contains(&reached);
            passed += u32::from(pass);
            defmt::info!(
                "row {=str}: reached {=f32} {=str}, expected {=f32} ({=f32} to {=f32}): {=str}",
                name,
                reached,
                unit,
                expected,
                least,
                most,
                if pass { "pass" } else { "FAIL" }
            );
            // The log drops what the probe has not read in time.
            Timer::after_millis(50).await;
        }
        defmt::info!(
            "bring-up ends: {=u32} of {=u32} rows pass; send in this log as docs/bring-up.md says",
            passed,
            ROWS as u32
        );
    }
}
