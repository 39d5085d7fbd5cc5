//! Temperature sensors in the place of resonators: platinum resistors at channels 5 to 7 of the rate ADC.
//!
//! For a gyro whose frequency is no thermometer, as wu2023's. The readings of a model step are the means of the samples of a second that ends
//! [`LEAD_MS`] before the step does, by the ticks of the samples: so they are there when the step is closed, and the desktop makes the same
//! ones bit for bit. In the steps they stand in the place of frequencies, in C; the image's curve is that of a sensor
//! ([`crate::temperature::TemperatureCurve::is_of_sensor`]).
//!
//! # Example
//! ```
//! use hrg_core::sensors::Platinum;
//!
//! // A Pt1000 at 0 C has 1000 ohm.
//! let sensor = Platinum::PT1000;
//! let t = sensor.temperature_c(1000.0 / sensor.ohm_per_code).expect("a sensor");
//! assert!(t.abs() < 1e-6);
//! assert_eq!(sensor.temperature_c(0.0), None, "a short circuit is none");
//! ```

use crate::frequency::StepFrequencies;
use crate::rate_path::FULL_SCALE_CODE;
use crate::timebase::Timebase;
use crate::{AXES, MODEL_STEP_S};

/// The readings' second ends so long before the model step, ms: more than a sample and its way through the unit.
pub const LEAD_MS: u32 = 10;

/// A second with fewer samples than this gives no reading.
const LEAST: u32 = 500;

/// A platinum resistor with a constant current, at an input of the ADC.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Platinum {
    /// Resistance at 0 C, ohm.
    pub r0_ohm: f64,
    /// Ohm of one code of the ADC.
    pub ohm_per_code: f64,
}

/// Callendar and Van Dusen's coefficients (IEC 60751:2022, section 5.2), per C, C^2, C^4.
const A: f64 = 3.9083e-3;
const B: f64 = -5.775e-7;
const C: f64 = -4.183e-12;

impl Platinum {
    /// Pt1000 with 0.5 mA at an input of 1.2 V full scale and 24 bits. An error of the current or of the resistor is an error of the temperature that
    /// does not change, so it is in the calibration.
    pub const PT1000: Self = Self { r0_ohm: 1000.0, ohm_per_code: 1.2 / 8_388_608.0 / 0.5e-3 };

    /// Temperature in C of a code; `None` outside -100 to 300 C: the sensor is broken or not there.
    #[must_use]
    pub fn temperature_c(&self, code: f64) -> Option<f64> {
        let ratio = code * self.ohm_per_code / self.r0_ohm;
        let mut t = (ratio - 1.0) / A;
        // Newton's method: the curve is nearly straight.
        for _ in 0..6 {
            let cold = if t < 0.0 { C } else { 0.0 };
            let value = 1.0 + t * (A + t * (B + t * (t - 100.0) * cold)) - ratio;
            let slope = A + t * (2.0 * B + t * (4.0 * t - 300.0) * cold);
            t -= value / slope;
        }
        (-100.0..=300.0).contains(&t).then_some(t)
    }
}

/// Samples of a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The model step that it belongs to.
    pub step: u32,
    sums: [i64; AXES],
    samples: u32,
    saturated: [bool; AXES],
}

impl Window {
    const fn of(step: u32) -> Self {
        Self { step, sums: [0; AXES], samples: 0, saturated: [false; AXES] }
    }

    /// Mean code of each channel; `None` where there are too few samples, or the channel was at its end of scale.
    #[must_use]
    pub fn means(&self) -> [Option<f64>; AXES] {
        core::array::from_fn(|k| {
            let there = self.samples >= LEAST && !self.saturated[k];
            there.then(|| self.sums[k] as f64 / f64::from(self.samples))
        })
    }

    /// Temperature of each axis, C; `None` where there is none.
    #[must_use]
    pub fn readings(&self, sensor: &Platinum) -> [Option<f64>; AXES] {
        self.means().map(|mean| mean.and_then(|code| sensor.temperature_c(code)))
    }
}

/// A model step with the readings of sensors in the place of frequencies.
#[must_use]
pub fn with_readings(step: StepFrequencies, window: Option<&Window>, sensor: &Platinum) -> StepFrequencies {
    let readings = window.filter(|w| w.step == step.step).map_or([None; AXES], |w| w.readings(sensor));
    StepFrequencies { frequency_hz: readings, rejected: [0; AXES], missing: [0; AXES], ..step }
}

/// Adds samples up to the seconds of model steps.
#[derive(Debug, Clone)]
pub struct SensorBank {
    second: u64,
    /// Time of the last sample, ticks since the timer's start, and the end of the second being filled.
    now: u64,
    end: u64,
    filling: Window,
}

impl SensorBank {
    /// Before the first sample. `timebase`: the timer of their ticks.
    #[must_use]
    pub const fn new(timebase: Timebase) -> Self {
        let second = timebase.ms((1000.0 * MODEL_STEP_S) as u32) as u64;
        Self { second, now: 0, end: second - timebase.ms(LEAD_MS) as u64, filling: Window::of(0) }
    }

    /// A sample: the tick of its data-ready edge, and the codes of the sensors' channels. Gives a second that is complete.
    pub fn push(&mut self, tick: u32, codes: [i32; AXES]) -> Option<Window> {
        let ahead = tick.wrapping_sub(self.now as u32) as i32;
        self.now += u64::from(ahead.max(0).unsigned_abs());
        let mut complete = None;
        if self.now >= self.end {
            // (After an outage seconds without any sample are left out.)
            let more = (self.now - self.end) / self.second.max(1) + 1;
            self.end += more * self.second;
            let next = self.filling.step.wrapping_add(more as u32);
            complete = Some(core::mem::replace(&mut self.filling, Window::of(next)));
        }
        self.filling.samples += 1;
        for k in 0..AXES {
            self.filling.sums[k] += i64::from(codes[k]);
            self.filling.saturated[k] |= !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&codes[k]);
        }
        complete
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// IEC 60751:2022, table 1: resistance of a Pt100 in ohm at temperatures in C.
    const TABLE: [(f64, f64); 8] = [
        (-100.0, 60.26),
        (-50.0, 80.31),
        (-10.0, 96.09),
        (0.0, 100.0),
        (25.0, 109.73),
        (60.0, 123.24),
        (100.0, 138.51),
        (250.0, 194.10),
    ];

    #[test]
    fn temperatures_are_those_of_the_standard() {
        for (t, pt100_ohm) in TABLE {
            let code = 10.0 * pt100_ohm / Platinum::PT1000.ohm_per_code;
            let found = Platinum::PT1000.temperature_c(code).map_or(f64::NAN, |f| f.clamp(-100.0, 300.0));
            // Its table is rounded to 0.01 ohm, which is 0.013 C for half of it.
            assert!((found - t).abs() < 0.015 || (t == -100.0 && found.is_nan()), "{t}: {found}");
        }
        for broken in [0.0, 8_388_607.0, -5e6, f64::NAN, 2e5] {
            assert_eq!(Platinum::PT1000.temperature_c(broken), None, "{broken}");
        }
    }

    #[test]
    fn seconds_belong_to_steps_across_gaps_and_wraps() {
        const S: u64 = 90_000_000;
        let mut bank = SensorBank::new(Timebase::REFERENCE);
        let mut seen = heapless::Vec::<(u32, u32), 128>::new();
        for k in 1..=100_000u64 {
            // Nothing from 60.0 to 62.5 s.
            if (60_000..62_500).contains(&k) {
                continue;
            }
            if let Some(w) = bank.push((k * S / 1000) as u32, [k as i32, 0, 0x7F_FFFF]) {
                let _ = seen.push((w.step, w.samples));
                let mean = w.readings(&Platinum { r0_ohm: 1.0, ohm_per_code: 1.0 });
                assert_eq!(mean[2], None, "saturated");
            }
        }
        // The first second is shorter by the lead and begins with the first sample.
        assert_eq!(seen[0], (0, 989));
        assert!(seen[1..59].iter().enumerate().all(|(k, w)| *w == (k as u32 + 1, 1000)));
        let after = seen.iter().position(|w| w.0 > 60).map(|k| seen[k]);
        assert_eq!(after, Some((62, 490)));
        assert!(seen.iter().skip(62).all(|w| w.1 == 1000));
    }
}
