//! The rate path: converter codes in at 1 kHz, corrected rates out.
//!
//! # When a new bias takes effect
//! A bias is *staged* with the timer tick from which it holds. It takes effect at the first sample whose
//! data-ready edge, captured by the same timer, is at or after that tick. So the sample is defined by time
//! stamps, not by when a task ran, and a replay on a desktop does the same. A bias that arrives after its
//! tick has passed takes effect at the next sample and raises [`unit::BIAS_LATE`].

use crate::compensator::Output;
use crate::frequency::StepFrequencies;
use crate::status::{axis, unit};
use crate::AXES;

/// Channels of the converter that are used: three rates, two horizontal accelerometers.
pub const CHANNELS: usize = AXES + 2;

/// Codes at or beyond this magnitude are the converter's end of scale (24 bits, two's complement).
pub const FULL_SCALE_CODE: i32 = 0x7F_FFF0;

/// Samples per rate frame at start: 1 kHz / 5 = 200 Hz. Settable over the link.
pub const DIVIDER: u16 = 5;

/// Samples of a frame at most: one a second.
pub const MOST_SAMPLES: u16 = 1000;

/// A bias with the moment from which it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Staged {
    /// First timer tick (32-bit, wrapping) of its validity.
    pub effective_tick: u32,
    /// Number of the model step that made it.
    pub step: u32,
    /// Bias of each axis, deg/h.
    pub bias_dph: [f32; AXES],
    /// Status of each axis.
    pub status: [u8; AXES],
    /// Over the rest: a bit that flips in memory shows.
    seal: u32,
}

/// A new bias takes effect this long after the end of the step it came from: 50 ms at 90 MHz. A unit that fetches
/// its edges each 10 ms knows the bias after 11 ms at most; the rest is reserve.
pub const BIAS_DELAY_TICKS: u32 = 4_500_000;

/// A bias older than this at a sample is flagged [`axis::TEMPERATURE_STALE`]: the model, which speaks each second, has
/// stopped. 2.5 s at 90 MHz.
pub const STALE_TICKS: u32 = 225_000_000;

/// A corrected rate, deg/h: the one sign rule, in the unit's arithmetic.
#[inline(always)]
#[must_use]
pub fn corrected_dph(raw_dph: f32, bias_dph: f32) -> f32 {
    raw_dph - bias_dph
}

/// A channel that gives the same code for so many samples (2 s) is stuck: a converter of 24 bits that measures is never that
/// quiet. Flagged [`unit::CONVERTER_FAULT`].
pub const STUCK_SAMPLES: u16 = 2000;

impl Staged {
    /// A bias of each axis, deg/h, with its status and the tick from which it holds.
    #[must_use]
    pub fn at(effective_tick: u32, step: u32, bias_dph: [f32; AXES], status: [u8; AXES]) -> Self {
        let mut staged = Self { effective_tick, step, bias_dph, status, seal: 0 };
        staged.seal = staged.fold();
        staged
    }

    /// The bias that a model step gave, with the tick from which it holds.
    #[must_use]
    pub fn new(step: &StepFrequencies, output: &Output) -> Self {
        let effective_tick = (step.end_ticks as u32).wrapping_add(BIAS_DELAY_TICKS);
        Self::at(effective_tick, step.step, output.bias_dph, output.status)
    }

    fn fold(&self) -> u32 {
        let [a, b, c] = self.status;
        fold([self.effective_tick, self.step, u32::from_le_bytes([a, b, c, 0])]) ^ fold(self.bias_dph.map(f32::to_bits))
    }

    /// Whether it is as it was made.
    #[must_use]
    pub fn whole(&self) -> bool {
        self.seal == self.fold()
    }
}

fn settings_seal(scale_dph: &[f32; AXES], divider: u16, next_divider: u16) -> u32 {
    fold(scale_dph.map(f32::to_bits)).wrapping_add((u32::from(divider) << 16) | u32::from(next_divider))
}

/// A number that changes with any bit of the three.
fn fold([a, b, c]: [u32; 3]) -> u32 {
    !(a ^ b.rotate_left(11) ^ c.rotate_left(22))
}

/// One frame of corrected rates: the mean of `divider` samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateFrame {
    /// Number of the last sample in it, since start.
    pub sample: u32,
    /// Timer tick of that sample's data-ready edge.
    pub tick: u32,
    /// Number of the model step whose bias was taken off the last sample.
    pub step: u32,
    /// Status of each axis, worst over the samples.
    pub axis_status: [u8; AXES],
    /// Status of the unit.
    pub unit_status: u8,
    /// Corrected rate of each axis, deg/h.
    pub rate_dph: [f32; AXES],
    /// Over the rest, between [`sealed`](Self::sealed) and [`whole`](Self::whole); not sent.
    pub(crate) seal: u32,
}

impl RateFrame {
    /// With its seal renewed: after the last change.
    #[must_use]
    pub fn sealed(mut self) -> Self {
        self.seal = self.fold();
        self
    }

    /// Whether it is as it was when it was sealed: a queue whose memory was upset may hand out anything.
    #[must_use]
    pub fn whole(&self) -> bool {
        self.seal == self.fold()
    }

    fn fold(&self) -> u32 {
        let [a, b, c] = self.axis_status;
        let status = u32::from_le_bytes([a, b, c, self.unit_status]);
        // Not zero for zeros: memory that never held a frame is no frame.
        fold([self.sample, self.tick, self.step])
            ^ fold(self.rate_dph.map(f32::to_bits)).rotate_left(5)
            ^ status
            ^ 0x5EA1_ED00
    }
}

/// Means over the samples that shared one bias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Model step of the bias that ended.
    pub step: u32,
    /// Samples in the means.
    pub samples: u16,
    /// Mean raw rate, deg/h; NaN without samples.
    pub raw_dph: [f32; AXES],
    /// Mean corrected rate, deg/h; NaN without samples.
    pub corrected_dph: [f32; AXES],
    /// Samples missing or refused in that time.
    pub converter_errors: u16,
    /// Sums of the codes of the accelerometers along axes 1 and 2.
    pub accelerometer_codes: [i64; 2],
    /// One of those was at its end of scale.
    pub accelerometer_saturated: bool,
}

/// What a sample may give.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Event {
    /// A frame to send.
    pub frame: Option<RateFrame>,
    /// The end of a bias' validity.
    pub summary: Option<Summary>,
    /// What the rates are made with is not what it was: memory was upset, and no frame is made. The unit must start anew.
    pub upset: bool,
}

/// State of the rate path.
#[derive(Debug, Clone)]
pub struct RatePath {
    scale_dph: [f32; AXES],
    /// Over scale and dividers.
    settings_seal: u32,
    divider: u16,
    current: Staged,
    /// The current bias is older than [`STALE_TICKS`].
    stale: bool,
    /// The last codes, what has changed in them in this frame, and for how many samples each has not changed.
    last_codes: [i32; AXES],
    changed: [i32; AXES],
    unchanged: [u16; AXES],
    pending: Option<Staged>,
    sample: u32,
    // The frame being filled.
    in_frame: u16,
    sum_dph: [f32; AXES],
    /// The same two again: what is being summed has no seal.
    mirror: (u16, [f32; AXES]),
    /// Samples per frame from the next frame on.
    next_divider: u16,
    axis_status: [u8; AXES],
    unit_status: u8,
    // The summary being filled.
    code_sum: [i64; CHANNELS],
    accelerometer_saturated: bool,
    in_summary: u16,
    errors: u16,
}

impl RatePath {
    /// `scale_dph`: deg/h per code of each axis; `divider`: samples per frame, 1 to 1000.
    #[must_use]
    pub fn new(scale_dph: [f32; AXES], divider: u16) -> Self {
        let divider = divider.clamp(1, MOST_SAMPLES);
        Self {
            scale_dph,
            settings_seal: settings_seal(&scale_dph, divider, divider),
            divider,
            current: Staged::at(0, u32::MAX, [0.0; AXES], [axis::TEMPERATURE_STALE | axis::SETTLING; AXES]),
            stale: false,
            last_codes: [0; AXES],
            changed: [0; AXES],
            unchanged: [0; AXES],
            pending: None,
            sample: 0,
            in_frame: 0,
            sum_dph: [0.0; AXES],
            mirror: (0, [0.0; AXES]),
            next_divider: divider,
            axis_status: [0; AXES],
            unit_status: 0,
            code_sum: [0; CHANNELS],
            accelerometer_saturated: false,
            in_summary: 0,
            errors: 0,
        }
    }

    /// Samples per frame from the next frame on.
    pub fn set_divider(&mut self, divider: u16) {
        let whole = self.settings_whole();
        self.next_divider = divider.clamp(1, MOST_SAMPLES);
        if whole {
            self.settings_seal = settings_seal(&self.scale_dph, self.divider, self.next_divider);
        }
    }

    fn settings_whole(&self) -> bool {
        self.settings_seal == settings_seal(&self.scale_dph, self.divider, self.next_divider)
    }

    /// Stages the next bias.
    pub fn stage(&mut self, staged: Staged) {
        self.pending = Some(staged);
    }

    /// Takes one sample: the timer tick of its data-ready edge and the codes of the channels.
    #[inline(never)]
    pub fn sample(&mut self, tick: u32, codes: [i32; CHANNELS]) -> Event {
        let mut event = Event { frame: None, summary: None, upset: false };
        if self.due(tick) {
            event.summary = self.turn(tick);
        }
        self.sample = self.sample.wrapping_add(1);
        for k in 0..AXES {
            let code = codes[k];
            let rate_dph = corrected_dph(code as f32 * self.scale_dph[k], self.current.bias_dph[k]);
            self.sum_dph[k] += rate_dph;
            self.mirror.1[k] += rate_dph;
            self.changed[k] |= code ^ self.last_codes[k];
            self.last_codes[k] = code;
            if !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&code) {
                self.axis_status[k] |= axis::OVER_RANGE;
            }
            self.code_sum[k] += i64::from(code);
        }
        for k in AXES..CHANNELS {
            self.code_sum[k] += i64::from(codes[k]);
            self.accelerometer_saturated |= !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&codes[k]);
        }
        self.in_summary = self.in_summary.saturating_add(1);
        self.in_frame += 1;
        self.mirror.0 += 1;
        if self.in_frame < self.divider {
            // Its seal is looked at when a frame is whole, which would take long.
            event.upset = self.divider > MOST_SAMPLES;
            return event;
        }
        let unequal = self.in_frame != self.divider
            || self.mirror.0 != self.divider
            || self.sum_dph.iter().zip(&self.mirror.1).any(|(a, b)| a.to_bits() != b.to_bits());
        event.upset = unequal || !self.current.whole() || !self.settings_whole();
        // An old bias is said from then on, whatever the timer, which wraps every 48 s, makes of its age later.
        self.stale |= tick.wrapping_sub(self.current.effective_tick) > STALE_TICKS;
        if self.stale {
            self.axis_status.iter_mut().for_each(|s| *s |= axis::TEMPERATURE_STALE);
        }
        let frame = self.finish_frame(tick);
        if !event.upset {
            event.frame = Some(frame);
        }
        event
    }

    /// Says that a sample was missing or refused at about `tick`. A frame whose samples all are missing is
    /// not sent; the next one carries [`unit::CONVERTER_FAULT`].
    pub fn missing(&mut self, tick: u32) -> Event {
        self.errors = self.errors.saturating_add(1);
        self.unit_status |= unit::CONVERTER_FAULT;
        Event { frame: None, summary: self.turn(tick), upset: false }
    }

    /// Whether there is a pending bias, and `tick` has reached it.
    #[inline]
    fn due(&self, tick: u32) -> bool {
        self.pending.as_ref().is_some_and(|staged| tick.wrapping_sub(staged.effective_tick) as i32 >= 0)
    }

    /// Takes the pending bias into use if `tick` has reached it.
    #[inline(never)]
    fn turn(&mut self, tick: u32) -> Option<Summary> {
        if !self.due(tick) {
            return None;
        }
        let staged = self.pending?;
        let past = tick.wrapping_sub(staged.effective_tick) as i32;
        self.pending = None;
        // More than two sample times late: it was not there in time.
        if past > LATE_TICKS {
            self.unit_status |= unit::BIAS_LATE;
        }
        let summary = self.summarise();
        if self.in_frame > 0 {
            // The frame that is being filled holds samples of both.
            self.axis_status.iter_mut().zip(self.current.status).for_each(|(to, from)| *to |= from);
        }
        self.current = staged;
        self.stale = false;
        Some(summary)
    }

    fn summarise(&mut self) -> Summary {
        let n = f64::from(self.in_summary);
        let mut raw_dph = [f32::NAN; AXES];
        let mut corrected_dph = [f32::NAN; AXES];
        if self.in_summary > 0 {
            for k in 0..AXES {
                raw_dph[k] = (self.code_sum[k] as f64 / n) as f32 * self.scale_dph[k];
                corrected_dph[k] = self::corrected_dph(raw_dph[k], self.current.bias_dph[k]);
            }
        }
        let summary = Summary {
            step: self.current.step,
            samples: self.in_summary,
            raw_dph,
            corrected_dph,
            converter_errors: self.errors,
            accelerometer_codes: [self.code_sum[AXES], self.code_sum[AXES + 1]],
            accelerometer_saturated: self.accelerometer_saturated,
        };
        self.accelerometer_saturated = false;
        self.code_sum = [0; CHANNELS];
        self.in_summary = 0;
        self.errors = 0;
        summary
    }

    fn finish_frame(&mut self, tick: u32) -> RateFrame {
        let share = 1.0 / f32::from(self.in_frame);
        for k in 0..AXES {
            self.axis_status[k] |= self.current.status[k];
            let moved = core::mem::take(&mut self.changed[k]) != 0;
            self.unchanged[k] = if moved { 0 } else { self.unchanged[k].saturating_add(self.in_frame) };
            if self.unchanged[k] >= STUCK_SAMPLES {
                self.unit_status |= unit::CONVERTER_FAULT;
            }
        }
        for (sum, status) in self.sum_dph.iter().zip(&mut self.axis_status) {
            // Only a block of absurd numbers brings this about.
            if !sum.is_finite() {
                *status |= axis::UNCALIBRATED;
            }
        }
        let frame = RateFrame {
            sample: self.sample,
            tick,
            step: self.current.step,
            axis_status: self.axis_status,
            unit_status: self.unit_status,
            rate_dph: self.sum_dph.map(|s| s * share),
            seal: 0,
        };
        self.in_frame = 0;
        self.sum_dph = [0.0; AXES];
        self.mirror = (0, [0.0; AXES]);
        if self.next_divider != self.divider {
            self.divider = self.next_divider;
            self.settings_seal = settings_seal(&self.scale_dph, self.divider, self.next_divider);
        }
        self.axis_status = [0; AXES];
        self.unit_status = 0;
        frame
    }
}

/// A bias is late if the first sample after its tick is this much later (2 ms at 90 MHz).
const LATE_TICKS: i32 = 180_000;

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn bias_changes_at_its_tick_and_across_the_wrap() {
        let mut p = RatePath::new([0.01; 3], 1);
        let start = u32::MAX - 250_000;
        let staged = Staged::at(start.wrapping_add(270_000), 5, [1.0; 3], [0; 3]);
        p.stage(staged);
        let mut rates = [0.0; 6];
        for (k, r) in rates.iter_mut().enumerate() {
            let e = p.sample(start.wrapping_add(90_000 * k as u32), [100; CHANNELS]);
            *r = e.frame.expect("one frame a sample").rate_dph[0];
            if k == 3 {
                let s = e.summary.expect("the first bias ended here");
                assert_eq!((s.samples, s.raw_dph[0]), (3, 1.0));
            }
        }
        assert_eq!(rates, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn a_frame_that_would_never_end_is_noticed() {
        let upsets: [fn(&mut RatePath); 6] = [
            |p| p.divider ^= 1,
            |p| p.divider ^= 1 << 9,
            |p| p.divider ^= 1 << 10,
            |p| p.divider ^= 1 << 15,
            |p| p.next_divider ^= 1 << 12,
            |p| {
                p.scale_dph[1] = 1.0;
                p.set_divider(7);
            },
        ];
        for (k, upset) in upsets.iter().enumerate() {
            let mut p = RatePath::new([0.01; 3], 5);
            upset(&mut p);
            let noticed = (0..2000u32).find(|k| p.sample(k * 90_000, [*k as i32 & 3; CHANNELS]).upset);
            assert!(noticed.is_some_and(|sample| sample <= 1000), "{k}: {noticed:?}");
        }
    }

    #[test]
    fn an_old_bias_a_stuck_channel_and_upset_memory_are_said() {
        let mut p = RatePath::new([0.01; 3], 1);
        p.stage(Staged::at(0, 1, [1.0; 3], [0; 3]));
        let mut said = std::vec::Vec::new();
        for k in 1..6000u32 {
            let code = k as i32 % 2;
            let codes = [code, code, if k > 3000 { 7 } else { code }, 0, 0];
            let f = p.sample(90_000u32.wrapping_mul(k), codes).frame.expect("one a sample");
            said.push((f.axis_status, f.unit_status));
        }
        let stale = said.iter().position(|s| s.0 != [0; 3]).expect("said") + 1;
        assert_eq!(stale, 2501);
        assert!(said[stale..].iter().all(|s| s.0 == [axis::TEMPERATURE_STALE; 3]));
        let stuck = said.iter().position(|s| s.1 != 0).expect("said") + 1;
        assert_eq!((stuck, said[stuck].1), (3001 + usize::from(STUCK_SAMPLES), unit::CONVERTER_FAULT));
        // Every bit of what a rate is made with.
        for bit in 0..32 {
            for word in 0..9 {
                let mut q = p.clone();
                let flip = |f: &mut f32| *f = f32::from_bits(f.to_bits() ^ 1 << bit);
                match word {
                    0..=2 => flip(&mut q.scale_dph[word]),
                    3..=5 => flip(&mut q.current.bias_dph[word - 3]),
                    6 => q.current.effective_tick ^= 1 << bit,
                    7 => {
                        let mut r = RatePath::new([0.01; 3], 5);
                        let _ = r.sample(0, [1; CHANNELS]);
                        match bit {
                            0..16 => r.in_frame ^= 1 << bit,
                            _ => r.divider ^= 1 << (bit - 16),
                        }
                        let said = (1..2000).find_map(|k| {
                            let e = r.sample(k * 90_000, [1; CHANNELS]);
                            (e.upset || e.frame.is_some()).then_some(e.upset)
                        });
                        // A frame that waits for 65 thousand samples is none that is wrong; the watchdog sees to it.
                        assert_ne!(said, Some(false), "bit {bit}");
                        let mut r = RatePath::new([0.01; 3], 2);
                        let _ = r.sample(0, [1; CHANNELS]);
                        let clean = r.clone().sample(90_000, [1; CHANNELS]);
                        flip(&mut r.sum_dph[1]);
                        let e = r.sample(90_000, [1; CHANNELS]);
                        assert!(e.upset || e == clean, "bit {bit} of a sum");
                        continue;
                    }
                    _ => q.current.status[bit / 8 % 3] ^= 1 << (bit % 8),
                }
                let e = q.sample(0, [1, 2, 3, 4, 5]);
                assert!(e.upset && e.frame.is_none(), "word {word} bit {bit}");
            }
        }
    }

    #[test]
    fn a_frame_that_has_changed_in_a_queue_is_not_whole() {
        let mut p = RatePath::new([0.01; 3], 1);
        let sealed = p.sample(7, [1, -2, 3, 0, 0]).frame.expect("one a sample").sealed();
        assert!(sealed.whole());
        for bit in 0..32 {
            for word in 0..8 {
                let mut f = sealed;
                match word {
                    0 => f.sample ^= 1 << bit,
                    1 => f.tick ^= 1 << bit,
                    2 => f.step ^= 1 << bit,
                    3 => f.seal ^= 1 << bit,
                    4..=6 => f.rate_dph[word - 4] = f32::from_bits(f.rate_dph[word - 4].to_bits() ^ 1 << bit),
                    _ => match bit / 8 {
                        3 => f.unit_status ^= 1 << (bit % 8),
                        k => f.axis_status[k] ^= 1 << (bit % 8),
                    },
                }
                assert!(!f.whole(), "word {word}, bit {bit}");
            }
        }
        // Memory that never held a frame.
        assert!(!RateFrame {
            sample: 0,
            tick: 0,
            step: 0,
            axis_status: [0; 3],
            unit_status: 0,
            rate_dph: [0.0; 3],
            seal: 0
        }
        .whole());
    }

    #[test]
    fn late_bias_and_missing_samples_are_said() {
        let mut p = RatePath::new([0.01; 3], 2);
        p.stage(Staged::at(0, 1, [0.0; 3], [0; 3]));
        let e = p.missing(200_000);
        assert_eq!(e.summary.map(|s| s.converter_errors), Some(1));
        let _ = p.sample(290_000, [0; CHANNELS]);
        let f = p.sample(380_000, [0, 0x7F_FFFF, 0, 0, 0]).frame.expect("second sample");
        assert_eq!(f.unit_status, unit::CONVERTER_FAULT | unit::BIAS_LATE);
        assert_eq!(f.axis_status, [0, axis::OVER_RANGE, 0].map(|b| b));
    }
}
