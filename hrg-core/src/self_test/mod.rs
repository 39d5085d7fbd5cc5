//! The built-in test: figures that a unit can measure of itself, each with its limits.
//!
//! A host asks for it in maintenance mode (`hrg unit test`); it takes some four seconds. For one of them the ADC's channels are connected to
//! voltages that it makes itself ([`course`]): no rates go out then, and those before and after are flagged
//! ([`crate::status::UnitStatus::ADC_FAULT`]). At each start the unit tests memory, program, image, crystal and supply, which costs
//! the rates nothing.
//!
//! # What it does not see
//! The ADC makes its test voltages of its own reference, so a reference that is off scales both: that shows only as a scale factor
//! ([`crate::rate_factors`]). The gyros themselves, and the way from them to the pins.
//!
//! # Example
//! ```
//! use hrg_core::self_test::{Check, Item, Verdict};
//!
//! // The second resonator is at 71.5 C; its curve was measured from -40 to 60.
//! let item = Item { check: Check::Temperature, index: 1, value: 71.5, low: -40.0, high: 60.0 };
//! assert_eq!((item.verdict(), item.check.facts().name), (Verdict::Fail, "temperature"));
//! ```

pub mod course;

use crate::adc::ALL_CHANNELS;
use crate::link::Housekeeping;
use crate::pps;
use crate::status::{AxisStatus, UnitStatus};
use crate::AXES;
use course::Levels;
use heapless::Vec;

/// Seconds of housekeeping that a test looks at: the first whole ones after the ADC is itself again.
pub const SECONDS: usize = 2;

/// Most items of a test.
pub const MOST: usize = 56;

/// Items of a test.
pub type Items = Vec<Item, MOST>;

/// Subject of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Check {
    /// Mean code of a channel whose inputs are shorted in the ADC.
    Offset = 0,
    /// The same at the ADC's positive test voltage, as a share of what it should be.
    Positive = 1,
    /// The same at the negative one.
    Negative = 2,
    /// Noise of a channel with shorted inputs.
    Noise = 3,
    /// Noise of a rate as it comes from the gyro.
    RateNoise = 4,
    /// Samples of the ADC in a second.
    Samples = 5,
    /// Samples missing or refused.
    SamplesLost = 6,
    /// Temperature that a resonator's frequency gives, within the range of its curve.
    Temperature = 7,
    /// Edges of a resonator that were missing or rejected.
    Edges = 8,
    /// The clock against the pulses per second.
    Clock = 9,
    /// The unit runs on its crystal.
    Crystal = 10,
    /// The supply is high enough.
    Supply = 11,
    /// Bits of memory that do not hold what is written, at the start.
    Memory = 12,
    /// The program has the sum that it was built with.
    Program = 13,
    /// The image in flash is the one in use, and has its sum.
    Image = 14,
    /// The record of this test was written to the field log and read back.
    Log = 15,
    /// Frames of the link that came in broken during the test.
    Link = 16,
    /// The processor's supply, by its own reference.
    SupplyVoltage = 17,
    /// Its temperature.
    ChipTemperature = 18,
}

/// Name and meaning of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Facts {
    /// Its name on screens.
    pub name: &'static str,
    /// Its subject.
    pub meaning: &'static str,
    /// Unit of its figure and limits.
    pub unit: &'static str,
}

impl Check {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 19] = [
        Self::Offset,
        Self::Positive,
        Self::Negative,
        Self::Noise,
        Self::RateNoise,
        Self::Samples,
        Self::SamplesLost,
        Self::Temperature,
        Self::Edges,
        Self::Clock,
        Self::Crystal,
        Self::Supply,
        Self::Memory,
        Self::Program,
        Self::Image,
        Self::Log,
        Self::Link,
        Self::SupplyVoltage,
        Self::ChipTemperature,
    ];

    /// The check of a number.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number)).copied()
    }

    /// Its name and meaning.
    #[must_use]
    pub const fn facts(self) -> Facts {
        let (name, meaning, unit) = match self {
            Self::Offset => ("offset", "ADC channel, inputs shorted", "codes"),
            Self::Positive => ("gain +", "ADC channel, positive test voltage, of what it should be", "1"),
            Self::Negative => ("gain -", "ADC channel, negative test voltage, of what it should be", "1"),
            Self::Noise => ("noise", "ADC channel, inputs shorted", "codes"),
            Self::RateNoise => ("rate noise", "as it comes from the gyro, at 1 kHz", "codes"),
            Self::Samples => ("samples", "of the ADC by the unit's clock", "per s"),
            Self::SamplesLost => ("samples lost", "missing or refused", "in 2 s"),
            Self::Temperature => ("temperature", "by the resonator, within the range of its curve", "C"),
            Self::Edges => ("edges", "of the resonator, missing or rejected", "in 2 s"),
            Self::Clock => ("clock", "against the pulses per second", "ppb"),
            Self::Crystal => ("crystal", "the clock is made of it", "1 is yes"),
            Self::Supply => ("supply", "above 2.75 V", "1 is yes"),
            Self::Memory => {
                ("memory", "bits of a word of RAM, any word, that do not hold a pattern, at the start", "of 32")
            }
            Self::Program => ("program", "has the sum that it was built with", "1 is yes"),
            Self::Image => ("image", "in flash, is the one in use and has its sum", "1 is yes"),
            Self::Log => ("field log", "this test's record reads back", "1 is yes"),
            Self::Link => ("link", "frames that came in broken", "in the test"),
            Self::SupplyVoltage => ("voltage", "supply of the processor, by its own reference", "V"),
            Self::ChipTemperature => ("chip", "temperature of the processor", "C"),
        };
        Facts { name, meaning, unit }
    }
}

/// Result of an item.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Within its limits.
    Pass,
    /// Outside, or there is no figure.
    Fail,
    /// There is nothing to test here (no pulses per second, no image).
    NotTested,
}

/// A figure with its limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Item {
    /// Its subject.
    pub check: Check,
    /// Channel or axis, from 0.
    pub index: u8,
    /// Figure; NaN: there is none.
    pub value: f32,
    /// Least that passes; NaN: not tested.
    pub low: f32,
    /// Most that passes; NaN: not tested.
    pub high: f32,
}

impl Item {
    /// A yes or no, of which yes passes.
    #[must_use]
    pub const fn of(check: Check, yes: bool) -> Self {
        Self { check, index: 0, value: if yes { 1.0 } else { 0.0 }, low: 1.0, high: 1.0 }
    }

    /// The same where it may be that there is nothing to test.
    #[must_use]
    pub fn of_option(check: Check, yes: Option<bool>) -> Self {
        yes.map_or(Self::not_tested(check), |yes| Self::of(check, yes))
    }

    /// A count, of which none passes.
    #[must_use]
    pub const fn none_of(check: Check, index: usize, count: u32) -> Self {
        Self { check, index: index as u8, value: count as f32, low: 0.0, high: 0.0 }
    }

    /// One that there is nothing to test of.
    #[must_use]
    pub const fn not_tested(check: Check) -> Self {
        Self { check, index: 0, value: f32::NAN, low: f32::NAN, high: f32::NAN }
    }

    /// Result by its limits.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        if self.low.is_nan() || self.high.is_nan() {
            Verdict::NotTested
        } else if (self.low..=self.high).contains(&self.value) {
            Verdict::Pass
        } else {
            Verdict::Fail
        }
    }
}

/// Items that fail: how many, and the first.
#[must_use]
pub fn failed(items: &[Item]) -> (usize, Option<&Item>) {
    let mut all = items.iter().filter(|item| item.verdict() == Verdict::Fail);
    let first = all.next();
    (usize::from(first.is_some()) + all.count(), first)
}

/// Code of the ADC's full scale, 1.2 V.
const FULL_SCALE: f32 = 8_388_608.0;
/// Mean code of shorted inputs: 1 mV, six times the largest offset of the data sheet (175 uV).
pub const MOST_OFFSET: f32 = FULL_SCALE / 1200.0;
/// Code at a test voltage: 2/15 of the full scale (data sheet, internal test signals).
pub const TEST_LEVEL: f32 = FULL_SCALE * 2.0 / 15.0;
/// Its share may be off by so much: offset, gain error of the ADC, and the resistors that make the voltage.
pub const GAIN_TOLERANCE: f32 = 0.02;
/// Noise of shorted inputs: some six times that of the data sheet with an oversampling of 1024 and gain 1.
pub const MOST_NOISE: f32 = 280.0;
/// Least noise, of shorted inputs and of a rate: less than a single step of one code in the course. An ADC of 24 bits whose codes stand still
/// does not convert.
pub const LEAST_NOISE: f32 = 0.03;
/// Noise of a rate: a hundredth of the full scale. (A unit that is turned or shaken during the test shows more.)
pub const MOST_RATE_NOISE: f32 = FULL_SCALE / 100.0;
/// Samples in a second, and how many fewer or more pass: the ADC's own clock is a crystal's, too.
const SAMPLES: [f32; 2] = [999.0, 1001.0];

/// Items of the ADC; `None`: its course came to no end.
#[inline(never)]
pub fn of_adc(levels: Option<&Levels>, items: &mut Items) {
    let missing = Levels::MISSING;
    let levels = levels.unwrap_or(&missing);
    let signs = [(Check::Offset, 0.0), (Check::Positive, TEST_LEVEL), (Check::Negative, -TEST_LEVEL)];
    for ((check, level), means) in signs.into_iter().zip(&levels.means) {
        for (channel, mean) in means.iter().enumerate() {
            let (value, low, high) = if level == 0.0 {
                (*mean, -MOST_OFFSET, MOST_OFFSET)
            } else {
                (mean / level, 1.0 - GAIN_TOLERANCE, 1.0 + GAIN_TOLERANCE)
            };
            let _ = items.push(Item { check, index: channel as u8, value, low, high });
        }
    }
    for channel in 0..ALL_CHANNELS {
        let value = levels.noise[channel];
        let _ =
            items.push(Item { check: Check::Noise, index: channel as u8, value, low: LEAST_NOISE, high: MOST_NOISE });
    }
    for axis in 0..AXES {
        let value = levels.pins[axis];
        let (check, high) = (Check::RateNoise, MOST_RATE_NOISE);
        let _ = items.push(Item { check, index: axis as u8, value, low: LEAST_NOISE, high });
    }
}

/// Supply of the processor, V: 3.3 and a tenth.
const SUPPLY_V: [f32; 2] = [2.97, 3.63];
/// Temperature of the processor, C: that of its data sheet.
const CHIP_C: [f32; 2] = [-40.0, 105.0];

/// Items of the processor itself: supply, V, and temperature, C; NaN where it has measured none.
pub fn of_chip(supply_v: f32, temperature_c: f32, items: &mut Items) {
    for (check, value, [low, high]) in
        [(Check::SupplyVoltage, supply_v, SUPPLY_V), (Check::ChipTemperature, temperature_c, CHIP_C)]
    {
        let _ = items.push(Item { check, index: 0, value, low, high });
    }
}

/// Items of whole seconds after the course. `curves_c`: range of each axis' curve; `None`: there is no calibration.
#[inline(never)]
pub fn of_seconds(seconds: &[Housekeeping; SECONDS], curves_c: Option<[[f32; 2]; AXES]>, items: &mut Items) {
    let [first, last] = seconds;
    let [low, high] = SAMPLES;
    let value = f32::from(last.samples);
    let _ = items.push(Item { check: Check::Samples, index: 0, value, low, high });
    let lost = u32::from(first.adc_errors) + u32::from(last.adc_errors);
    let _ = items.push(Item::none_of(Check::SamplesLost, 0, lost));
    for axis in 0..AXES {
        // (A temperature that is held for want of a frequency, or of one that is possible, is none.)
        let held = AxisStatus::FREQUENCY_LOST.union(AxisStatus::TEMPERATURE_STALE);
        let value = if last.axis_status[axis].intersects(held) { f32::NAN } else { last.temperature_c[axis] };
        let [low, high] = curves_c.map_or([f32::NAN; 2], |curves| curves[axis]);
        let _ = items.push(Item { check: Check::Temperature, index: axis as u8, value, low, high });
    }
    for axis in 0..AXES {
        let of = |h: &Housekeeping| u32::from(h.missing[axis]) + u32::from(h.rejected[axis]);
        // A silent resonator misses no edge: it has none.
        let edges = if last.frequency_hz[axis].is_finite() { of(first) + of(last) } else { u32::from(u16::MAX) };
        let _ = items.push(Item::none_of(Check::Edges, axis, edges));
    }
    // (A correction that stands at its end is of a clock that is beyond.)
    let bound = (0.99 * pps::BOUND * 1e9) as f32;
    // A clock that is far off is flagged at its first measurement; its correction comes slowly, and is 0 before. (A dead crystal is flagged, too.)
    let far = last.unit_status.contains(UnitStatus::TIMEBASE);
    let _ = items.push(if far || last.pps_age_ms <= 2000 && last.clock_ppb != 0.0 {
        let value = if far { f32::NAN } else { last.clock_ppb };
        Item { check: Check::Clock, index: 0, value, low: -bound, high: bound }
    } else {
        Item::not_tested(Check::Clock)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second() -> Housekeeping {
        Housekeeping {
            samples: 1000,
            frequency_hz: [4900.0; AXES],
            temperature_c: [20.0; AXES],
            pps_age_ms: 500,
            clock_ppb: 12.0,
            ..Housekeeping::default()
        }
    }

    fn good() -> Levels {
        let level = |v| [v; ALL_CHANNELS];
        Levels {
            means: [level(12.0), level(TEST_LEVEL * 1.001), level(-TEST_LEVEL * 0.999)],
            noise: level(25.0),
            pins: level(900.0),
        }
    }

    fn all(levels: Option<&Levels>, seconds: [Housekeeping; SECONDS]) -> Items {
        let mut items = Items::new();
        of_adc(levels, &mut items);
        of_seconds(&seconds, Some([[-40.0, 60.0]; AXES]), &mut items);
        items
    }

    #[test]
    fn a_good_unit_passes_and_each_check_fails_by_its_own_figure() {
        let items = all(Some(&good()), [second(); SECONDS]);
        assert_eq!(failed(&items), (0, None));
        let one = |change: &dyn Fn(&mut Levels, &mut Housekeeping)| {
            let (mut levels, mut last) = (good(), second());
            change(&mut levels, &mut last);
            let items = all(Some(&levels), [second(), last]);
            let (n, first) = failed(&items);
            (n, first.map(|i| (i.check, i.index)))
        };
        assert_eq!(one(&|l, _| l.means[0][3] = -8000.0), (1, Some((Check::Offset, 3))));
        assert_eq!(one(&|l, _| l.means[1][7] *= 0.95), (1, Some((Check::Positive, 7))));
        // The other sign is no voltage that is a little off.
        assert_eq!(one(&|l, _| l.means[2][0] = TEST_LEVEL), (1, Some((Check::Negative, 0))));
        assert_eq!(one(&|l, _| l.noise[1] = 0.0), (1, Some((Check::Noise, 1))));
        assert_eq!(one(&|l, _| l.pins[2] = 1e6), (1, Some((Check::RateNoise, 2))));
        assert_eq!(one(&|_, h| h.samples = 990), (1, Some((Check::Samples, 0))));
        assert_eq!(one(&|_, h| h.temperature_c[1] = 75.0), (1, Some((Check::Temperature, 1))));
        assert_eq!(one(&|_, h| h.axis_status[0] = AxisStatus::FREQUENCY_LOST), (1, Some((Check::Temperature, 0))));
        assert_eq!(one(&|_, h| h.frequency_hz[0] = f64::NAN), (1, Some((Check::Edges, 0))));
        assert_eq!(one(&|_, h| h.rejected[2] = 3), (1, Some((Check::Edges, 2))));
        assert_eq!(one(&|_, h| h.clock_ppb = 2e5), (1, Some((Check::Clock, 0))));
        assert_eq!(one(&|_, h| h.unit_status = UnitStatus::TIMEBASE), (1, Some((Check::Clock, 0))));
        // Without pulses, or before the first measurement, there is nothing to compare the clock with.
        assert_eq!(one(&|_, h| h.pps_age_ms = u32::MAX).0, 0);
        assert_eq!(one(&|_, h| h.clock_ppb = 0.0).0, 0);
        // An ADC whose course came to no end fails in each of its items.
        assert_eq!(failed(&all(None, [second(); SECONDS])).0, 4 * ALL_CHANNELS + AXES);
    }

    #[test]
    fn numbers_are_those_of_the_list() {
        for (k, check) in Check::ALL.into_iter().enumerate() {
            assert_eq!((check as usize, Check::from_number(k as u8)), (k, Some(check)));
        }
        assert_eq!(Check::from_number(Check::ALL.len() as u8), None);
    }
}
