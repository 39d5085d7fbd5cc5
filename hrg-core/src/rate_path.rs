//! The rate path: ADC codes in at 1 kHz, corrected rates out.
//!
//! # When a new bias takes effect
//! A bias is *pending* with the timer tick from which it holds. It takes effect at the first sample whose
//! data-ready edge, captured by the same timer, is at or after that tick. So the sample is defined by time
//! stamps, not by when a task ran, and a replay on a desktop does the same. A bias that arrives after its
//! tick has passed takes effect at the next sample and raises [`UnitStatus::BIAS_LATE`].
//!
//! # From samples to frames
//! By [`crate::filter`]. A frame's tick is the time that its rate is of. A sample that is missing is taken for the one before, and each frame that it
//! is part of is flagged; where more than [`MOST_HELD`] are missing in a row, the filter begins anew, and the first frame comes when it is filled.
//!
//! # Example
//! ```
//! use hrg_core::rate_path::{PendingBias, RatePath};
//! use hrg_core::status::AxisStatus;
//! use hrg_core::timebase::Timebase;
//!
//! let mut path = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
//! path.set_bias(PendingBias::at(180_000, 0, [0.25; 3], [AxisStatus::empty(); 3]));
//! let mut rate = |tick| path.sample(tick, [100, 100, 100, 0, 0, 0]).frame.expect("one a sample").rate_dph[0];
//! // 100 codes of 0.01 deg/h; the bias holds from its tick on.
//! assert_eq!((rate(90_000), rate(180_000)), (1.0, 0.75));
//! ```

use crate::compensator::Output;
use crate::filter::{Changed, Design, Filter, Samples, FRAMES};
use crate::frequency::StepFrequencies;
use crate::increments::{IncrementFrame, Integrator, RAD_PER_DPH_SAMPLE, SAMPLE_S};
use crate::output::OutputSettings;
use crate::rate_factors::Factors;
use crate::specific_force::SpecificForce;
use crate::status::{AxisStatus, UnitStatus};
use crate::timebase::Timebase;
use crate::AXES;

/// Channels of the ADC that the rate path takes: three rates, and three accelerometers (of which a unit with other things at channels 5 to 7 has
/// two).
pub const CHANNELS: usize = 2 * AXES;

/// Accelerometers that an alignment uses: those along axes 1 and 2.
const HORIZONTAL: usize = 2;

/// Codes at or beyond this magnitude are the ADC's end of scale (24 bits, two's complement).
pub const FULL_SCALE_CODE: i32 = 0x7F_FFF0;

/// Samples per rate frame at start: 1 kHz / 5 = 200 Hz. Settable over the link.
pub const DECIMATION: u16 = 5;

/// Samples of a frame at most: one a second.
pub const MOST_SAMPLES: u16 = 1000;

/// A bias with the moment from which it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendingBias {
    /// First timer tick (32-bit, wrapping) of its validity.
    pub effective_tick: u32,
    /// Number of the model step that made it.
    pub step: u32,
    /// Bias of each axis, deg/h.
    pub bias_dph: [f32; AXES],
    /// Factors of the rates.
    pub factors: Factors,
    /// Errors of the accelerometers.
    pub specific_force: SpecificForce,
    /// Status of each axis.
    pub status: [AxisStatus; AXES],
    /// Integrity word over the rest: a bit that flips in memory shows.
    integrity: u32,
}

/// A new bias takes effect this long after the end of the step it came from, ms. A unit that fetches its edges each 10 ms knows
/// the bias after 11 ms at most; the rest is reserve.
pub const BIAS_DELAY_MS: u32 = 50;

/// A bias older than this at a sample, ms, is flagged [`AxisStatus::TEMPERATURE_STALE`]: the model, which gives one each second, has
/// stopped.
pub const STALE_MS: u32 = 2_500;

/// A bias is late if the first sample after its tick comes this much later, ms: two sample times.
pub const LATE_MS: u32 = 2;

/// Time between two samples, us: the ADC's 1 kSPS.
pub const SAMPLE_US: u32 = 1000;

/// Two samples that are further apart than their time by more than this share of it, or nearer, come from an ADC at another rate. Its
/// crystal and the timer's differ by some 0.01 %.
const SPACING_SHARE: u32 = 50;

/// A missing sample is taken for the one before, so many times in a row at most; after a longer gap filter and increments begin anew.
pub const MOST_HELD: u32 = 10;

/// Half sample times by which the ADC's own filter delays: what increments are late by.
const ADC_DELAY_HALVES: u32 = Filter::Mean.delay_halves(1);

/// Over more sample times than this the spacing of two samples says nothing of the rate.
const SPACING_TIMES: u32 = 20;

/// A channel that gives the same code for so many samples (2 s) is stuck: a working ADC of 24 bits never repeats a code that
/// long. Flagged [`UnitStatus::ADC_FAULT`].
pub const STUCK_SAMPLES: u16 = 2000;

impl PendingBias {
    /// A bias of each axis, deg/h, with its status and the tick from which it holds.
    #[must_use]
    pub fn at(effective_tick: u32, step: u32, bias_dph: [f32; AXES], status: [AxisStatus; AXES]) -> Self {
        let (factors, specific_force) = (Factors::UNIT, SpecificForce::NONE);
        Self { effective_tick, step, bias_dph, factors, specific_force, status, integrity: 0 }.with_factors(factors)
    }

    /// The same with the errors of the accelerometers.
    #[must_use]
    pub fn with_specific_force(mut self, specific_force: SpecificForce) -> Self {
        self.specific_force = specific_force;
        self.integrity = self.fold();
        self
    }

    /// The same with what the rates are multiplied by.
    #[must_use]
    pub fn with_factors(mut self, factors: Factors) -> Self {
        self.factors = factors;
        self.integrity = self.fold();
        self
    }

    /// The bias that a model step gave, with the tick from which it holds.
    #[must_use]
    pub fn new(timebase: Timebase, step: &StepFrequencies, output: &Output) -> Self {
        let effective_tick = (step.end_ticks as u32).wrapping_add(timebase.ms(BIAS_DELAY_MS));
        Self::at(effective_tick, step.step, output.bias_dph, output.status)
            .with_factors(output.factors)
            .with_specific_force(output.specific_force)
    }

    #[inline]
    fn fold(&self) -> u32 {
        fold([self.effective_tick, self.step, word_of(self.status)])
            ^ fold(self.bias_dph.map(f32::to_bits))
            ^ self.factors.fold().rotate_left(7)
            ^ self.specific_force.fold().rotate_left(19)
    }

    /// `true` if its integrity word still fits its contents.
    #[inline]
    #[must_use]
    pub fn intact(&self) -> bool {
        self.integrity == self.fold()
    }
}

/// A number that changes with any bit of the three.
#[inline]
fn fold([a, b, c]: [u32; 3]) -> u32 {
    !(a ^ b.rotate_left(11) ^ c.rotate_left(22))
}

/// A number that changes with any bit of the status of the axes.
#[inline]
fn word_of(status: [AxisStatus; AXES]) -> u32 {
    fold(status.map(|s| s.bits().into()))
}

/// One frame of corrected rates: of [`crate::filter`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RateFrame {
    /// Sample times from start to its last sample: it counts time, and goes on where samples are lost.
    pub sample: u32,
    /// Timer tick of the time that the rate is of: that sample's data-ready edge, less the delay of the filters
    /// ([`Filter::delay_halves`]).
    pub tick: u32,
    /// Number of the model step whose bias was taken off the last sample.
    pub step: u32,
    /// Status of each axis, worst over the samples.
    pub axis_status: [AxisStatus; AXES],
    /// Status of the unit.
    pub unit_status: UnitStatus,
    /// Corrected rate of each axis, deg/h.
    pub rate_dph: [f32; AXES],
    /// Integrity word over the rest, from [`with_integrity`](Self::with_integrity) to [`intact`](Self::intact); not sent.
    pub(crate) integrity: u32,
}

impl RateFrame {
    /// With its integrity word computed: after the last change.
    #[inline]
    #[must_use]
    pub fn with_integrity(mut self) -> Self {
        self.integrity = self.fold();
        self
    }

    /// `true` if its integrity word still fits its contents: a queue in corrupted memory may hand out anything.
    #[inline]
    #[must_use]
    pub fn intact(&self) -> bool {
        self.integrity == self.fold()
    }

    #[inline]
    fn fold(&self) -> u32 {
        let status = word_of(self.axis_status) ^ u32::from(self.unit_status.bits()).rotate_left(27);
        // Non-zero for an all-zero frame, so that memory which never held a frame fails.
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
    pub adc_errors: u16,
    /// Sums of the codes of the accelerometers along axes 1 and 2.
    pub accelerometer_codes: [i64; 2],
    /// One of those was at its end of scale.
    pub accelerometer_saturated: bool,
}

/// Result of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Event {
    /// A frame to send.
    pub frame: Option<RateFrame>,
    /// The end of a bias' validity.
    pub summary: Option<Summary>,
    /// Increments are due: [`RatePath::increments`].
    pub increments: bool,
    /// Scale factors, decimation, bias or sums fail their integrity check: no frame is made, and the unit must start anew.
    pub corrupted: bool,
}

/// State since the last good sample.
#[derive(Debug, Clone, Copy)]
struct Last {
    tick: u32,
    since_ticks: u32,
    errors: u16,
}

/// State of the rate path.
#[derive(Debug, Clone)]
pub struct RatePath {
    /// [`STALE_MS`] and [`LATE_MS`] in ticks.
    stale_ticks: u32,
    late_ticks: i32,
    scale_dph: [f32; AXES],
    /// Integrity word over all settings.
    settings_integrity: u32,
    /// Settings of this frame, and those from the next one on.
    settings: OutputSettings,
    next_settings: OutputSettings,
    /// From the time that a frame is of to its last sample, ticks.
    delay_ticks: u32,
    /// Accelerometers that there are.
    accelerometers: u8,
    current: PendingBias,
    /// The current bias is older than [`STALE_MS`].
    stale: bool,
    /// Changes of the rates' codes in this frame, and for how many samples each has not changed.
    changed: [i32; AXES],
    unchanged: [u16; AXES],
    pending: Option<PendingBias>,
    /// Sample times since start.
    sample: u32,
    /// [`SAMPLE_US`] in ticks.
    sample_ticks: u32,
    /// Tick of the last sample or look, ticks from the last good sample to it, and errors counted meanwhile; `None` before the first.
    last: Option<Last>,
    // The frame being filled.
    sums: Sums,
    /// The same again: what is being summed has no integrity word.
    mirror: Sums,
    /// The last samples: what frames and increments are made of.
    samples: Samples,
    /// The last codes: they stand for samples that are missing.
    held: [i32; CHANNELS],
    /// The filter is being filled, for the first time or anew.
    filling: bool,
    /// Flags of the samples of the frames before, as far as they are part of this one.
    flags: [Flags; FRAMES - 1],
    /// Place of the oldest of them.
    oldest: u8,
    increments: Increments,
    axis_status: [AxisStatus; AXES],
    unit_status: UnitStatus,
    // The summary being filled.
    code_sum: [i64; CHANNELS],
    accelerometer_saturated: bool,
    in_summary: u16,
    errors: u16,
}

/// Flags of the samples of a frame.
#[derive(Debug, Clone, Copy, Default)]
struct Flags {
    axes: [AxisStatus; AXES],
    unit: UnitStatus,
}

/// State of the message of increments, beside its sums.
#[derive(Debug, Clone, Copy, Default)]
struct Increments {
    /// Tick at which the interval began, twice; `None`: the first one has not ended yet.
    from_tick: [Option<u32>; 2],
    flags: Flags,
    /// The message that is due.
    due: IncrementFrame,
}

/// Codes of 24 bits whose sum has 32 bits at most.
const PIECE: u16 = 200;

/// Sums of the frame being filled. Codes are summed as integers, in pieces of up to [`PIECE`] samples under one bias, so that the mean of a
/// thousand samples is as good as that of five; what the bias makes of a piece is computed once, when its last sample is in.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Samples.
    samples: u16,
    /// Samples of the piece, and their codes.
    in_piece: u16,
    codes: [i32; AXES],
    /// Corrected rates of the pieces before, deg/h.
    before_dph: [f32; AXES],
}

impl Sums {
    /// Adds a sample.
    #[inline(always)]
    fn add(&mut self, codes: &[i32; CHANNELS]) {
        self.samples += 1;
        self.in_piece += 1;
        for (sum, code) in self.codes.iter_mut().zip(codes) {
            *sum = sum.wrapping_add(*code);
        }
    }

    /// Mean corrected rates of the piece, deg/h.
    #[inline(always)]
    fn of_piece_dph(&self, bias: &PendingBias, scale_dph: &[f32; AXES]) -> [f32; AXES] {
        let share = 1.0 / f32::from(self.in_piece);
        let mut raw_dph = [0.0; AXES];
        for k in 0..AXES {
            raw_dph[k] = self.codes[k] as f32 * share * scale_dph[k];
        }
        bias.factors.corrected_dph(raw_dph, bias.bias_dph)
    }

    /// The piece is done.
    #[inline]
    fn end_piece(&mut self, bias: &PendingBias, scale_dph: &[f32; AXES]) {
        if self.in_piece == 0 {
            return;
        }
        let rates = self.of_piece_dph(bias, scale_dph);
        for (sum, rate) in self.before_dph.iter_mut().zip(rates) {
            *sum += rate * f32::from(self.in_piece);
        }
        (self.in_piece, self.codes) = (0, [0; AXES]);
    }

    /// Mean corrected rates of all, deg/h.
    #[inline(always)]
    fn mean_dph(&mut self, bias: &PendingBias, scale_dph: &[f32; AXES]) -> [f32; AXES] {
        if self.in_piece == self.samples {
            return self.of_piece_dph(bias, scale_dph);
        }
        self.end_piece(bias, scale_dph);
        let share = 1.0 / f32::from(self.samples);
        self.before_dph.map(|sum| sum * share)
    }

    /// `true` if all bits are the same.
    #[inline]
    fn equals(&self, other: &Self) -> bool {
        // (Word by word: a comparison of arrays is a call that compares bytes.)
        let mut differs = u32::from(self.samples ^ other.samples) | u32::from(self.in_piece ^ other.in_piece);
        for k in 0..AXES {
            differs |= (self.codes[k] ^ other.codes[k]) as u32;
            differs |= self.before_dph[k].to_bits() ^ other.before_dph[k].to_bits();
        }
        differs == 0
    }
}

impl RatePath {
    /// Frames are means. `timebase`: the timer of the ticks; `scale_dph`: deg/h per code of each axis; `decimation`: samples per frame, 1 to 1000.
    // (In line, as below: it is large, and is made where it stays.)
    #[inline]
    #[must_use]
    pub fn new(timebase: Timebase, scale_dph: [f32; AXES], decimation: u16) -> Self {
        let decimation = decimation.clamp(1, MOST_SAMPLES);
        let settings = OutputSettings { filter: Filter::Mean, decimation, ..OutputSettings::default() };
        let mut path = Self {
            stale_ticks: timebase.ms(STALE_MS),
            late_ticks: timebase.ms(LATE_MS) as i32,
            scale_dph,
            settings_integrity: 0,
            settings,
            next_settings: settings,
            delay_ticks: 0,
            accelerometers: AXES as u8,
            current: PendingBias::at(
                0,
                u32::MAX,
                [0.0; AXES],
                [AxisStatus::TEMPERATURE_STALE.union(AxisStatus::SETTLING); AXES],
            ),
            stale: false,
            changed: [0; AXES],
            unchanged: [0; AXES],
            pending: None,
            sample: 0,
            sample_ticks: timebase.us(SAMPLE_US).max(1),
            last: None,
            sums: Sums::default(),
            mirror: Sums::default(),
            samples: Samples::default(),
            held: [0; CHANNELS],
            filling: true,
            flags: [Flags::default(); FRAMES - 1],
            oldest: 0,
            increments: Increments::default(),
            axis_status: [AxisStatus::empty(); AXES],
            unit_status: UnitStatus::empty(),
            code_sum: [0; CHANNELS],
            accelerometer_saturated: false,
            in_summary: 0,
            errors: 0,
        };
        path.take_settings();
        path
    }

    /// The same with these settings of what is sent, of a unit with so many accelerometers (2 or 3).
    #[inline]
    #[must_use]
    pub fn with_output(mut self, settings: OutputSettings, accelerometers: u8) -> Self {
        self.accelerometers = accelerometers;
        self.next_settings = settings;
        self.take_settings();
        self
    }

    /// Sets the number of accelerometers (2 or 3), before the first sample.
    pub fn set_accelerometers(&mut self, accelerometers: u8) {
        self.accelerometers = accelerometers;
        self.settings_integrity = self.settings_now();
    }

    /// Settings of what is sent from the next frame on.
    pub fn set_output(&mut self, settings: OutputSettings) {
        let intact = self.settings_intact();
        if settings.possible() {
            self.next_settings = settings;
        }
        if intact {
            self.settings_integrity = self.settings_now();
        }
    }

    /// Samples per frame from the next frame on.
    pub fn set_decimation(&mut self, decimation: u16) {
        self.set_output(self.next_settings.with_decimation(decimation));
    }

    /// Settings of what is sent, of the next frame.
    #[must_use]
    pub fn output(&self) -> OutputSettings {
        self.next_settings
    }

    /// The settings that are due hold from now on.
    #[inline(never)]
    fn take_settings(&mut self) {
        if self.next_settings.increments != self.settings.increments {
            self.increments.flags = Flags::default();
        }
        self.settings = self.next_settings;
        let halves = self.settings.filter.delay_halves(self.settings.decimation);
        self.delay_ticks = halves * (self.sample_ticks / 2);
        self.restart();
        self.settings_integrity = self.settings_now();
    }

    /// The filter of the frames; `None`: they are means.
    #[inline]
    fn design(&self) -> Option<&'static Design> {
        self.settings.filter.design(self.settings.decimation)
    }

    /// `true` if the next good sample ends a frame.
    #[must_use]
    pub fn ends_next(&self) -> bool {
        let samples = if self.design().is_some() { self.samples.of_frame() } else { self.sums.samples };
        samples.saturating_add(1) >= self.settings.decimation
    }

    // (Out of line: with each frame, and wherever a setting changes.)
    #[inline(never)]
    fn settings_now(&self) -> u32 {
        let ticks =
            fold([self.stale_ticks, self.late_ticks as u32, self.delay_ticks]) ^ self.sample_ticks.rotate_left(13);
        let numbers = |s: &OutputSettings| u32::from(s.decimation) << 16 | u32::from(s.increments);
        let kinds = |s: &OutputSettings| s.filter as u32 | (s.framing as u32) << 8;
        let (now, next) = (&self.settings, &self.next_settings);
        let others = u32::from(self.accelerometers) << 24 | kinds(now) << 4 | kinds(next);
        let words = fold([numbers(now), numbers(next), others]);
        fold(self.scale_dph.map(f32::to_bits)) ^ ticks.rotate_left(7) ^ words.rotate_left(3)
    }

    #[inline]
    fn settings_intact(&self) -> bool {
        self.settings_integrity == self.settings_now()
    }

    /// The bias in use and the settings are as they were given.
    #[inline]
    fn numbers_intact(&self) -> bool {
        self.current.intact() && self.settings_intact()
    }

    /// A bit of the time between two samples flips.
    #[cfg(test)]
    pub(crate) fn flip_sample_ticks(&mut self, bit: u32) {
        self.sample_ticks ^= 1 << bit;
    }

    /// The next bias: pending until its tick.
    pub fn set_bias(&mut self, bias: PendingBias) {
        self.pending = Some(bias);
    }

    /// Takes one sample: the timer tick of its data-ready edge and the codes of the channels.
    #[inline]
    pub fn sample(&mut self, tick: u32, codes: [i32; CHANNELS]) -> Event {
        let mut event = Event::default();
        if self.due(tick) {
            event.summary = self.turn(tick);
        }
        let times = self.sample_times(tick);
        self.sample = self.sample.wrapping_add(times);
        if times == 0 {
            return event;
        }
        let mut missing = times - 1;
        if missing > MOST_HELD {
            missing = 0;
            self.restart();
        }
        self.sums.add(&codes);
        if self.design().is_none() {
            self.mirror.add(&codes);
        }
        for k in 0..AXES {
            let code = codes[k];
            self.changed[k] |= code ^ self.held[k];
            if !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&code) {
                self.axis_status[k] |= AxisStatus::OVER_RANGE;
                self.increments.flags.axes[k] |= AxisStatus::OVER_RANGE;
            }
        }
        for k in AXES..AXES + HORIZONTAL {
            self.code_sum[k] += i64::from(codes[k]);
            self.accelerometer_saturated |= !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&codes[k]);
        }
        self.in_summary = self.in_summary.saturating_add(1);
        if self.sums.in_piece >= PIECE {
            self.end_piece();
        }
        self.send(tick, &codes, missing, &mut event);
        self.held = codes;
        event
    }

    /// Output of a sample, and of those before it that are missing: the one before them stands for each.
    #[inline(always)]
    fn send(&mut self, tick: u32, codes: &[i32; CHANNELS], missing: u32, event: &mut Event) {
        let (design, increments) = (self.design(), self.settings.increments > 0);
        let held = self.held;
        let mut behind = missing;
        loop {
            let (now, at) = if behind == 0 {
                (codes, tick)
            } else {
                (&held, tick.wrapping_sub(behind.wrapping_mul(self.sample_ticks)))
            };
            if design.is_some() || increments {
                self.samples.push(design.is_some(), increments, now);
            }
            let increments_end = increments && self.samples.of_increments() >= self.settings.increments;
            let frame_ends = match design {
                Some(_) => self.samples.of_frame() >= self.settings.decimation,
                None => behind == 0 && self.sums.samples >= self.settings.decimation,
            };
            // Nothing goes out that is made of a bias or of settings that have changed in memory.
            if increments_end || frame_ends {
                event.corrupted |= !self.numbers_intact();
            }
            if increments_end {
                self.end_increments(at, behind, event);
            }
            if frame_ends {
                self.end_frame(at, behind, event);
            }
            if behind == 0 {
                break;
            }
            behind -= 1;
        }
        // The integrity word of settings is checked when a frame is complete, which would take long.
        event.corrupted |= self.settings.decimation > MOST_SAMPLES;
    }

    /// A frame ends.
    #[inline(always)]
    fn end_frame(&mut self, tick: u32, behind: u32, event: &mut Event) {
        // (The filter's samples have checks of their own.)
        let sums_intact =
            self.design().is_some() || self.sums.samples == self.settings.decimation && self.sums.equals(&self.mirror);
        event.corrupted |= !sums_intact;
        // The stale flag latches, because the tick counter wraps every 48 s.
        self.stale |= tick.wrapping_sub(self.current.effective_tick) > self.stale_ticks;
        if self.stale {
            self.axis_status.iter_mut().for_each(|s| *s |= AxisStatus::TEMPERATURE_STALE);
        }
        match self.finish_frame(tick, behind) {
            Ok(frame) if !event.corrupted => event.frame = frame,
            Ok(_) => {}
            Err(Changed) => event.corrupted = true,
        }
    }

    /// The message of increments is due: of the samples since the last one.
    #[inline]
    fn end_increments(&mut self, tick: u32, behind: u32, event: &mut Event) {
        let PendingBias { factors, bias_dph, specific_force, .. } = &self.current;
        let angle_of = factors.of_codes(self.scale_dph, *bias_dph, RAD_PER_DPH_SAMPLE);
        let velocity_of = specific_force.of_codes(SAMPLE_S);
        let mut saturated = [false; AXES];
        let mut integrator = Integrator::default();
        let mut first = true;
        let taken = self.samples.increments(|codes| {
            let [x, y, z, a, b, c] = *codes;
            for (saturated, code) in saturated.iter_mut().zip([a, b, c]) {
                *saturated |= !(-FULL_SCALE_CODE..=FULL_SCALE_CODE).contains(&code);
            }
            let (angle, velocity) = (angle_of.corrected([x, y, z]), velocity_of.corrected([a, b, c]));
            if core::mem::take(&mut first) {
                integrator = Integrator::after(angle, velocity);
            } else {
                integrator.add(angle, velocity);
            }
        });
        let from = core::mem::replace(&mut self.increments.from_tick, [Some(tick); 2]);
        // (The first of a start has no sample before it, and would count for one.)
        match (taken, from) {
            (Ok(samples), [Some(from), Some(again)]) if from == again => {
                self.make_increments(tick, behind, (samples, tick.wrapping_sub(from)), &integrator, saturated);
                event.increments = !event.corrupted;
            }
            (Ok(_), [None, None]) => {}
            _ => event.corrupted = true,
        }
    }

    /// Makes the message of increments.
    #[inline]
    fn make_increments(
        &mut self,
        tick: u32,
        behind: u32,
        (samples, ticks): (u16, u32),
        integrator: &Integrator,
        saturated: [bool; AXES],
    ) {
        // (The time that went by, over that of so many samples: the ADC has a clock of its own.)
        let time = ticks as f32 / (u32::from(samples) * self.sample_ticks).max(1) as f32;
        let (angle, velocity) = integrator.sums();
        let Flags { mut axes, unit } = core::mem::take(&mut self.increments.flags);
        let stale = tick.wrapping_sub(self.current.effective_tick) > self.stale_ticks || self.stale;
        let angle_rad = angle.map(|a| a * time);
        let mut velocity_mps = velocity.map(|v| v * time);
        for k in 0..AXES {
            axes[k] |= self.current.status[k];
            if stale {
                axes[k] |= AxisStatus::TEMPERATURE_STALE;
            }
            if self.current.specific_force.outside[k] {
                axes[k] |= AxisStatus::SCALE_FACTOR;
            }
            if !angle_rad[k].is_finite() {
                axes[k] |= AxisStatus::UNCALIBRATED;
            }
            if saturated[k] || k >= usize::from(self.accelerometers) {
                velocity_mps[k] = f32::NAN;
            }
        }
        self.increments.due = IncrementFrame {
            sample: self.sample.wrapping_sub(behind),
            tick: tick.wrapping_sub(ADC_DELAY_HALVES * (self.sample_ticks / 2)),
            ticks,
            axis_status: axes,
            unit_status: unit,
            angle_rad,
            velocity_mps,
            integrity: 0,
        };
    }

    /// The message of increments that an [`Event`] says is due.
    #[must_use]
    pub fn increments(&self) -> IncrementFrame {
        self.increments.due
    }

    /// Filter and increments begin anew.
    #[inline(never)]
    fn restart(&mut self) {
        self.samples.restart();
        self.filling = true;
        self.flags = Default::default();
        self.increments.from_tick = [None; 2];
    }

    /// Time has gone on to `tick`: ticks since the last good sample; `None` before the first.
    #[inline]
    fn ticks_since_good(&mut self, tick: u32) -> Option<u32> {
        let last = self.last.as_mut()?;
        let more = tick.wrapping_sub(last.tick);
        // (A look at the time and a sample may come in the wrong order.)
        if more as i32 > 0 {
            last.tick = tick;
            last.since_ticks = last.since_ticks.saturating_add(more);
        }
        Some(last.since_ticks)
    }

    /// Number of sample times from the sample before to this one. Samples that were lost between them are counted and
    /// flagged; so is an ADC at another rate. 0: it is the same sample once more, which is refused.
    #[inline]
    fn sample_times(&mut self, tick: u32) -> u32 {
        // (Memory may be corrupted; this must not divide by zero.)
        let period = self.sample_ticks.max(1);
        let Some(ticks) = self.ticks_since_good(tick) else {
            self.last = Some(Last { tick, since_ticks: 0, errors: 0 });
            return 1;
        };
        let times = ticks.saturating_add(period / 2) / period;
        let off = ticks.abs_diff(times.saturating_mul(period));
        let known = self.last.map_or(0, |l| l.errors);
        let lost = times.saturating_sub(1).saturating_sub(known.into());
        let elsewhere = times <= SPACING_TIMES && off > period / SPACING_SHARE;
        if times == 0 || lost > 0 || elsewhere {
            let more = if times == 0 { 1 } else { lost.min(0xFFFF) as u16 };
            self.errors = self.errors.saturating_add(more);
            self.unit_status |= UnitStatus::ADC_FAULT;
            self.increments.flags.unit |= UnitStatus::ADC_FAULT;
        }
        if times > 0 {
            self.last = Some(Last { tick, since_ticks: 0, errors: 0 });
        }
        times
    }

    /// A sample was missing or refused at about `tick`. When the next one has come, the one before stands for it ([`MOST_HELD`]); a mean whose samples all are
    /// missing is not sent, and the next frame carries [`UnitStatus::ADC_FAULT`].
    #[inline]
    pub fn missing(&mut self, tick: u32) -> Event {
        self.ticks_since_good(tick);
        if let Some(last) = &mut self.last {
            last.errors = last.errors.saturating_add(1);
        }
        self.errors = self.errors.saturating_add(1);
        self.unit_status |= UnitStatus::ADC_FAULT;
        self.increments.flags.unit |= UnitStatus::ADC_FAULT;
        Event { summary: self.turn(tick), ..Event::default() }
    }

    /// `true` if there is a pending bias, and `tick` has reached it.
    #[inline]
    fn due(&self, tick: u32) -> bool {
        self.pending.as_ref().is_some_and(|bias| tick.wrapping_sub(bias.effective_tick) as i32 >= 0)
    }

    /// Takes the pending bias into use if `tick` has reached it.
    #[inline(never)]
    fn turn(&mut self, tick: u32) -> Option<Summary> {
        if !self.due(tick) {
            return None;
        }
        let bias = self.pending?;
        let past = tick.wrapping_sub(bias.effective_tick) as i32;
        self.pending = None;
        // More than two sample times late: it was not there in time.
        if past > self.late_ticks {
            self.unit_status |= UnitStatus::BIAS_LATE;
        }
        self.end_piece();
        let summary = self.summarise();
        if self.sums.samples > 0 {
            // The frame that is being filled holds samples of both.
            self.axis_status.iter_mut().zip(self.current.status).for_each(|(to, from)| *to |= from);
        }
        self.current = bias;
        self.stale = false;
        Some(summary)
    }

    /// The second's sums take the codes of the piece.
    #[inline(always)]
    fn sum_up(&mut self) {
        for (sum, codes) in self.code_sum.iter_mut().zip(self.sums.codes) {
            *sum += i64::from(codes);
        }
    }

    /// The piece is done: it is full, or the bias changes.
    #[inline]
    fn end_piece(&mut self) {
        self.sum_up();
        self.sums.end_piece(&self.current, &self.scale_dph);
        self.mirror.end_piece(&self.current, &self.scale_dph);
    }

    #[inline]
    fn summarise(&mut self) -> Summary {
        let n = f64::from(self.in_summary);
        let mut raw_dph = [f32::NAN; AXES];
        let mut corrected_dph = [f32::NAN; AXES];
        if self.in_summary > 0 {
            for k in 0..AXES {
                raw_dph[k] = (self.code_sum[k] as f64 / n) as f32 * self.scale_dph[k];
            }
            corrected_dph = self.current.factors.corrected_dph(raw_dph, self.current.bias_dph);
        }
        let summary = Summary {
            step: self.current.step,
            samples: self.in_summary,
            raw_dph,
            corrected_dph,
            adc_errors: self.errors,
            accelerometer_codes: [self.code_sum[AXES], self.code_sum[AXES + 1]],
            accelerometer_saturated: self.accelerometer_saturated,
        };
        self.accelerometer_saturated = false;
        self.code_sum = [0; CHANNELS];
        self.in_summary = 0;
        self.errors = 0;
        summary
    }

    /// The frame that ends; `None`: the filter is not filled yet.
    #[inline]
    fn finish_frame(&mut self, tick: u32, behind: u32) -> Result<Option<RateFrame>, Changed> {
        self.sum_up();
        let design = self.design();
        let rate_dph = match design {
            Some(design) => self.samples.frame(design)?.map(|codes| {
                let mut raw_dph = codes;
                raw_dph.iter_mut().zip(self.scale_dph).for_each(|(raw, scale)| *raw *= scale);
                self.current.factors.corrected_dph(raw_dph, self.current.bias_dph)
            }),
            None => Some(self.sums.mean_dph(&self.current, &self.scale_dph)),
        };
        for k in 0..AXES {
            let moved = core::mem::take(&mut self.changed[k]) != 0;
            self.unchanged[k] = if moved { 0 } else { self.unchanged[k].saturating_add(self.sums.samples) };
            if self.unchanged[k] >= STUCK_SAMPLES {
                self.unit_status |= UnitStatus::ADC_FAULT;
            }
        }
        // (Flags from before the filter was filled are told once, by its first frame.)
        if design.is_some() && rate_dph.is_some() && !core::mem::take(&mut self.filling) {
            self.join_flags();
        }
        self.axis_status.iter_mut().zip(self.current.status).for_each(|(to, from)| *to |= from);
        let over = self.axis_status.map(|s| s.contains(AxisStatus::OVER_RANGE));
        let touched = self.current.factors.touched(over);
        self.axis_status.iter_mut().zip(touched).filter(|(_, t)| *t).for_each(|(s, _)| *s |= AxisStatus::NEIGHBOUR);
        for (rate, status) in rate_dph.iter().flatten().zip(&mut self.axis_status) {
            // Only an image of absurd numbers brings this about.
            if !rate.is_finite() {
                *status |= AxisStatus::UNCALIBRATED;
            }
        }
        let frame = rate_dph.map(|rate_dph| RateFrame {
            sample: self.sample.wrapping_sub(behind),
            tick: tick.wrapping_sub(self.delay_ticks),
            step: self.current.step,
            axis_status: self.axis_status,
            unit_status: self.unit_status,
            rate_dph,
            integrity: 0,
        });
        self.sums = Sums::default();
        self.mirror = Sums::default();
        if self.next_settings != self.settings {
            self.take_settings();
        }
        if frame.is_some() || design.is_none() {
            self.axis_status = [AxisStatus::empty(); AXES];
            self.unit_status = UnitStatus::empty();
        }
        Ok(frame)
    }

    /// Flags of this frame's samples stay for the frames that they are part of.
    #[inline]
    fn join_flags(&mut self) {
        let own = Flags {
            axes: self.axis_status.map(|s| s.intersection(AxisStatus::OVER_RANGE)),
            unit: self.unit_status.intersection(UnitStatus::ADC_FAULT),
        };
        for before in &self.flags {
            self.axis_status.iter_mut().zip(before.axes).for_each(|(to, from)| *to |= from);
            self.unit_status |= before.unit;
        }
        if let Some(oldest) = self.flags.get_mut(usize::from(self.oldest)) {
            *oldest = own;
        }
        self.oldest = (self.oldest + 1) % (FRAMES - 1) as u8;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    const GOOD: AxisStatus = AxisStatus::empty();

    #[test]
    fn bias_changes_at_its_tick_and_across_the_wrap() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
        let start = u32::MAX - 250_000;
        let bias = PendingBias::at(start.wrapping_add(270_000), 5, [1.0; 3], [GOOD; 3]);
        p.set_bias(bias);
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
    fn samples_are_counted_by_time_and_lost_or_repeated_ones_are_flagged() {
        let run = |ticks: &[u32]| {
            let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
            let frames: std::vec::Vec<_> = ticks.iter().filter_map(|t| p.sample(*t, [5; CHANNELS]).frame).collect();
            (frames, p.errors)
        };
        let steady: std::vec::Vec<u32> = (0..50u32).map(|k| (u32::MAX - 900_000).wrapping_add(90_000 * k)).collect();
        let (frames, errors) = run(&steady);
        assert!(errors == 0 && frames.iter().all(|f| f.unit_status.is_empty()));
        // A crystal that is off by 0.1 %.
        let (frames, errors) = run(&(0..50u32).map(|k| 90_090 * k).collect::<std::vec::Vec<_>>());
        assert!(errors == 0 && frames.iter().all(|f| f.unit_status.is_empty()));
        // Three samples are lost; one comes twice.
        let mut gap = steady.clone();
        gap.drain(20..23);
        gap.insert(30, gap[30]);
        let (frames, errors) = run(&gap);
        assert_eq!((errors, frames.len(), frames.last().map(|f| f.sample)), (4, 47, Some(50)));
        let flagged: std::vec::Vec<u32> =
            frames.iter().filter(|f| !f.unit_status.is_empty()).map(|f| f.sample).collect();
        assert_eq!(flagged, [24, 35], "the first after the gap, and the first after the repeat");
        // 500 SPS, 980 SPS and 1020 SPS.
        for (period, lost) in [(180_000, 49), (91_900, 0), (88_100, 0)] {
            let (frames, errors) = run(&(0..50u32).map(|k| period * k).collect::<std::vec::Vec<_>>());
            assert!(errors == lost && frames[1..].iter().all(|f| f.unit_status == UnitStatus::ADC_FAULT), "{period}");
        }
    }

    #[test]
    fn what_is_known_to_be_missing_is_not_counted_twice() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
        p.sample(0, [5; CHANNELS]);
        p.missing(90_000);
        p.missing(180_000);
        let frame = p.sample(270_000, [5; CHANNELS]).frame.expect("one a sample");
        assert_eq!((p.errors, frame.sample), (2, 4));
    }

    #[test]
    fn a_frame_that_would_never_end_is_noticed() {
        let corruptions: [fn(&mut RatePath); 6] = [
            |p| p.settings.decimation ^= 1,
            |p| p.settings.decimation ^= 1 << 9,
            |p| p.settings.decimation ^= 1 << 10,
            |p| p.settings.decimation ^= 1 << 15,
            |p| p.next_settings.decimation ^= 1 << 12,
            |p| {
                p.scale_dph[1] = 1.0;
                p.set_decimation(7);
            },
        ];
        for (k, corrupt) in corruptions.iter().enumerate() {
            let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 5);
            corrupt(&mut p);
            let noticed = (0..2000u32).find(|k| p.sample(k * 90_000, [*k as i32 & 3; CHANNELS]).corrupted);
            assert!(noticed.is_some_and(|sample| sample <= 1000), "{k}: {noticed:?}");
        }
    }

    /// The mean of a long frame, with a bias that changes within it, against f64.
    #[test]
    fn a_mean_of_a_thousand_samples_is_as_good_as_single_precision_can_state_it() {
        for decimation in [5u16, 100, 1000] {
            let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], decimation);
            let scale = f64::from(0.01f32);
            p.set_bias(PendingBias::at(0, 1, [2.5; 3], [GOOD; 3]));
            let (mut exact, mut worst, mut seed) = (0.0f64, 0.0f64, 1u32);
            for k in 0..20_000u32 {
                if k == 10_400 {
                    p.set_bias(PendingBias::at(k * 90_000, 2, [-1.5; 3], [GOOD; 3]));
                }
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // 71 000 deg/h with a third of a deg/h of noise, where sums of singles were off by 8 ppm.
                let code = 7_100_000 + (seed >> 27) as i32 - 16;
                exact += f64::from(code) * scale - if k < 10_400 { 2.5 } else { -1.5 };
                let Some(frame) = p.sample(k.wrapping_mul(90_000), [code; CHANNELS]).frame else { continue };
                let mean = exact / f64::from(decimation);
                worst = worst.max((f64::from(frame.rate_dph[0]) / mean - 1.0).abs());
                exact = 0.0;
            }
            assert!(worst < 0.25e-6, "{decimation}: {worst:e}");
        }
    }

    #[test]
    fn an_old_bias_a_stuck_channel_and_corrupted_memory_are_flagged() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
        p.set_bias(PendingBias::at(0, 1, [1.0; 3], [GOOD; 3]));
        let mut printed = std::vec::Vec::new();
        for k in 1..6000u32 {
            let code = k as i32 % 2;
            let codes = [code, code, if k > 3000 { 7 } else { code }, 0, 0, 0];
            let f = p.sample(90_000u32.wrapping_mul(k), codes).frame.expect("one a sample");
            printed.push((f.axis_status, f.unit_status));
        }
        let stale = printed.iter().position(|s| s.0 != [GOOD; 3]).expect("flagged") + 1;
        assert_eq!(stale, 2501);
        assert!(printed[stale..].iter().all(|s| s.0 == [AxisStatus::TEMPERATURE_STALE; 3]));
        let stuck = printed.iter().position(|s| !s.1.is_empty()).expect("flagged") + 1;
        assert_eq!((stuck, printed[stuck].1), (3001 + usize::from(STUCK_SAMPLES), UnitStatus::ADC_FAULT));
        // Every bit of what a rate is made with.
        for bit in 0..32 {
            for word in 0..10 {
                let mut q = p.clone();
                let flip = |f: &mut f32| *f = f32::from_bits(f.to_bits() ^ 1 << bit);
                match word {
                    0..=2 => flip(&mut q.scale_dph[word]),
                    3..=5 => flip(&mut q.current.bias_dph[word - 3]),
                    6 => q.current.effective_tick ^= 1 << bit,
                    7 => {
                        let mut r = RatePath::new(Timebase::REFERENCE, [0.01; 3], 5);
                        let _ = r.sample(0, [1; CHANNELS]);
                        match bit {
                            0..16 => r.sums.samples ^= 1 << bit,
                            _ => r.settings.decimation ^= 1 << (bit - 16),
                        }
                        let printed = (1..2000).find_map(|k| {
                            let e = r.sample(k * 90_000, [1; CHANNELS]);
                            (e.corrupted || e.frame.is_some()).then_some(e.corrupted)
                        });
                        // A frame that waits for 65 thousand samples is none that is wrong; the watchdog sees to it.
                        assert_ne!(printed, Some(false), "bit {bit}");
                        let mut r = RatePath::new(Timebase::REFERENCE, [0.01; 3], 2);
                        let _ = r.sample(0, [1; CHANNELS]);
                        let clean = r.clone().sample(90_000, [1; CHANNELS]);
                        for damage in [
                            |s: &mut Sums, bit: usize| s.codes[1] ^= 1 << bit,
                            |s: &mut Sums, bit: usize| s.in_piece ^= 1 << (bit % 16),
                            |s: &mut Sums, bit: usize| {
                                s.before_dph[0] = f32::from_bits(s.before_dph[0].to_bits() ^ 1 << bit);
                            },
                        ] {
                            let mut r = r.clone();
                            damage(&mut r.sums, bit);
                            let e = r.sample(90_000, [1; CHANNELS]);
                            assert!(e.corrupted || e == clean, "bit {bit} of a sum");
                        }
                        continue;
                    }
                    8 => q.current.status[bit / 8 % 3] ^= AxisStatus::from_bits_retain(1 << (bit % 8)),
                    _ => {
                        let mut scale = q.current.factors.scale();
                        flip(&mut scale[bit % 3]);
                        q.current.factors = Factors::new(scale, q.current.factors.coupling());
                    }
                }
                let e = q.sample(90_000u32.wrapping_mul(6000), [1, 2, 3, 4, 5, 6]);
                assert!(e.corrupted && e.frame.is_none(), "word {word} bit {bit}");
            }
        }
    }

    #[test]
    fn a_frame_that_has_changed_in_a_queue_is_not_intact() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 1);
        let frame = p.sample(7, [1, -2, 3, 0, 0, 0]).frame.expect("one a sample").with_integrity();
        assert!(frame.intact());
        for bit in 0..32 {
            for word in 0..8 {
                let mut f = frame;
                match word {
                    0 => f.sample ^= 1 << bit,
                    1 => f.tick ^= 1 << bit,
                    2 => f.step ^= 1 << bit,
                    3 => f.integrity ^= 1 << bit,
                    4..=6 => f.rate_dph[word - 4] = f32::from_bits(f.rate_dph[word - 4].to_bits() ^ 1 << bit),
                    _ => match bit / 8 {
                        3 => f.unit_status ^= UnitStatus::from_bits_retain(1 << (bit % 16)),
                        k => f.axis_status[k] ^= AxisStatus::from_bits_retain(1 << (bit % 8)),
                    },
                }
                assert!(!f.intact(), "word {word}, bit {bit}");
            }
        }
        // Memory that never held a frame.
        assert!(!RateFrame {
            sample: 0,
            tick: 0,
            step: 0,
            axis_status: [GOOD; 3],
            unit_status: UnitStatus::empty(),
            rate_dph: [0.0; 3],
            integrity: 0
        }
        .intact());
    }

    #[test]
    fn a_bias_of_each_second_is_never_stale_whatever_the_timer() {
        for hz in [1_000_000, 84_000_000, 90_000_000, 240_000_000, 480_000_000] {
            let timebase = Timebase::at(hz);
            let mut p = RatePath::new(timebase, [0.01; 3], 1);
            let mut flagged = 0;
            for ms in 0..10_000u32 {
                let tick = (u64::from(hz) * u64::from(ms) / 1000) as u32;
                if ms % 1000 == 0 && ms < 6000 {
                    p.set_bias(PendingBias::at(tick, ms / 1000, [0.0; 3], [GOOD; 3]));
                }
                let f = p.sample(tick, [ms as i32 & 3; CHANNELS]).frame.expect("one a sample");
                let stale = f.axis_status[0].contains(AxisStatus::TEMPERATURE_STALE);
                // The last bias came at 5 s.
                assert_eq!(stale, ms > 5000 + STALE_MS, "{hz} Hz, {ms} ms");
                flagged += u32::from(stale);
            }
            assert_eq!(flagged, 10_000 - 5001 - STALE_MS);
        }
    }

    #[test]
    fn a_bias_is_late_after_two_milliseconds_whatever_the_timer() {
        for hz in [84_000_000, 90_000_000, 240_000_000] {
            let timebase = Timebase::at(hz);
            for (late_ms, flagged) in [(1, false), (2, false), (3, true)] {
                let mut p = RatePath::new(timebase, [0.01; 3], 1);
                p.set_bias(PendingBias::at(0, 1, [0.0; 3], [GOOD; 3]));
                let f = p.sample(timebase.ms(late_ms), [1; CHANNELS]).frame.expect("one a sample");
                assert_eq!(f.unit_status.contains(UnitStatus::BIAS_LATE), flagged, "{hz} Hz, {late_ms} ms");
            }
        }
    }

    #[test]
    fn late_bias_and_missing_samples_are_flagged() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 2);
        p.set_bias(PendingBias::at(0, 1, [0.0; 3], [GOOD; 3]));
        let e = p.missing(200_000);
        assert_eq!(e.summary.map(|s| s.adc_errors), Some(1));
        let _ = p.sample(290_000, [0; CHANNELS]);
        let f = p.sample(380_000, [0, 0x7F_FFFF, 0, 0, 0, 0]).frame.expect("second sample");
        assert_eq!(f.unit_status, UnitStatus::ADC_FAULT | UnitStatus::BIAS_LATE);
        assert_eq!(f.axis_status, [GOOD, AxisStatus::OVER_RANGE, GOOD]);
    }

    #[test]
    fn factors_take_effect_with_their_bias_and_what_they_take_of_an_axis_over_range_is_flagged() {
        let mut p = RatePath::new(Timebase::REFERENCE, [0.5; 3], 1);
        let factors = Factors::new([2.0, 1.0, 1.0], [[0.0; 2], [0.0; 2], [0.0, 0.25]]);
        p.set_bias(PendingBias::at(90_000, 1, [1.0, 1.0, 1.0], [GOOD; 3]).with_factors(factors));
        let before = p.sample(0, [10, 20, 30, 0, 0, 0]).frame.expect("one a sample");
        let e = p.sample(90_000, [10, 20, 30, 0, 0, 0]);
        let after = e.frame.expect("one a sample");
        assert_eq!((before.rate_dph, after.rate_dph), ([5.0, 10.0, 15.0], [8.0, 9.0, 14.0 + 0.25 * 9.0]));
        assert_eq!(e.summary.map(|s| s.corrected_dph), Some([5.0, 10.0, 15.0]));
        let over = p.sample(180_000, [10, FULL_SCALE_CODE + 1, 30, 0, 0, 0]).frame.expect("one a sample");
        assert_eq!(over.axis_status, [GOOD, AxisStatus::OVER_RANGE, AxisStatus::NEIGHBOUR]);
        p.set_bias(PendingBias::at(270_000, 2, [0.0; 3], [GOOD; 3]));
        let ended = p.sample(270_000, [0; CHANNELS]).summary.expect("the bias ended");
        // The mean of two samples, corrected once.
        assert_eq!(ended.corrected_dph, factors.corrected_dph(ended.raw_dph, [1.0; 3]));
    }

    /// A path as a unit has it: 200 Hz by the filter, increments of five samples.
    fn filtered() -> RatePath {
        let settings = OutputSettings { increments: 5, ..OutputSettings::default() };
        let mut p = RatePath::new(Timebase::REFERENCE, [0.01; 3], 5).with_output(settings, 3);
        p.set_bias(PendingBias::at(0, 1, [0.5, 0.0, -0.5], [GOOD; 3]));
        p
    }

    /// Numbers of samples with which a frame ends, each with its flags; increments the same way.
    type Sent = (std::vec::Vec<RateFrame>, std::vec::Vec<IncrementFrame>);

    /// `n` samples of a ramp, but for those that `lost` says are missing: told of (`Some(true)`), or not.
    fn fly(p: &mut RatePath, n: u32, lost: impl Fn(u32) -> Option<bool>) -> Sent {
        let (mut frames, mut increments) = (std::vec::Vec::new(), std::vec::Vec::new());
        for k in 0..n {
            let codes = [1000, k as i32, -2000, 0, 0, 5000 + (k as i32 & 1)];
            let event = match lost(k) {
                None => p.sample(k * 90_000, codes),
                Some(true) => p.missing(k * 90_000),
                Some(false) => continue,
            };
            assert!(!event.corrupted, "sample {k}");
            frames.extend(event.frame);
            if event.increments {
                increments.push(p.increments());
            }
        }
        (frames, increments)
    }

    #[test]
    fn frames_are_of_the_time_that_their_tick_says() {
        let (frames, increments) = fly(&mut filtered(), 400, |_| None);
        // The first frame comes when the filter is filled.
        assert_eq!((frames[0].sample, frames.len()), (55, (400 - 55) / 5 + 1));
        for f in &frames {
            // 28 ms before the last sample, 26.5 of them by the filter.
            let last = f.sample - 1;
            assert_eq!(f.tick, (last * 90_000).wrapping_sub(28 * 90_000));
            let ramp = (last as f32 - 26.5) * 0.01;
            assert!((f.rate_dph[0] - 9.5).abs() < 1e-5 && (f.rate_dph[1] - ramp).abs() < 1e-5, "{f:?}");
            assert!(f.unit_status.is_empty() && f.axis_status == [GOOD; 3]);
        }
        // (The first interval begins with the end of five samples.)
        assert_eq!(increments.len(), 79);
        for i in &increments {
            assert_eq!((i.ticks, i.tick), (450_000, ((i.sample - 1) * 90_000).wrapping_sub(135_000)));
            let wanted = 5.0 * 9.5 * RAD_PER_DPH_SAMPLE;
            assert!((i.angle_rad[0] / wanted - 1.0).abs() < 1e-6 && i.velocity_mps[2] > 0.0);
        }
    }

    #[test]
    fn a_missing_sample_is_held_and_flags_every_frame_that_it_is_part_of() {
        for told in [true, false] {
            let (frames, increments) = fly(&mut filtered(), 400, |k| (k == 203).then_some(told));
            let flagged: std::vec::Vec<u32> =
                frames.iter().filter(|f| f.unit_status == UnitStatus::ADC_FAULT).map(|f| f.sample).collect();
            // 54 samples: eleven frames at most. (One that nobody told of is known with the sample after it.)
            assert_eq!(flagged, (0..11).map(|k| 205 + 5 * k).collect::<std::vec::Vec<_>>(), "{told}");
            assert!(frames.windows(2).all(|w| w[1].sample - w[0].sample == 5), "none is missing");
            let wrong = increments.iter().filter(|i| !i.unit_status.is_empty()).count();
            assert_eq!((wrong, increments.len()), (1, 79));
            assert!(increments.iter().all(|i| i.ticks == 450_000));
        }
    }

    #[test]
    fn after_a_long_gap_the_filter_begins_anew() {
        for told in [true, false] {
            let (frames, increments) = fly(&mut filtered(), 600, |k| (200..300).contains(&k).then_some(told));
            let first = frames.iter().find(|f| f.sample > 215).expect("it goes on");
            // 54 samples after the gap, on the next fifth.
            assert!((354..=360).contains(&first.sample) && first.unit_status == UnitStatus::ADC_FAULT, "{first:?}");
            assert!(frames.iter().filter(|f| f.sample > 365).all(|f| f.unit_status.is_empty()));
            let after = increments.iter().find(|i| i.sample > 300).expect("they go on");
            assert!(after.ticks == 450_000 && after.unit_status == UnitStatus::ADC_FAULT, "{after:?}");
        }
    }

    #[test]
    fn corrupted_sums_of_filter_and_increments_are_noticed() {
        for bit in 0..88 {
            let damages: [fn(&mut RatePath, u32); 4] = [
                |p, bit| p.samples.flip(bit),
                |p, bit| p.increments.from_tick[1] = p.increments.from_tick[1].map(|t| t ^ 1 << (bit % 32)),
                |p, bit| p.settings.increments ^= 1 << (bit % 16),
                |p, bit| p.delay_ticks ^= 1 << (bit % 32),
            ];
            for (k, damage) in damages.iter().enumerate() {
                let mut p = filtered();
                let _ = fly(&mut p, 102, |_| None);
                damage(&mut p, bit);
                let noticed = (102..112u32).any(|k| p.sample(k * 90_000, [1000, k as i32, -2000, 0, 0, 1]).corrupted);
                assert!(noticed, "damage {k}, bit {bit}");
            }
        }
    }

    /// Each message of increments is made of the bias and the scale factors; no frame ends with it.
    #[test]
    fn increments_are_not_sent_of_numbers_that_have_changed() {
        let damages: [fn(&mut RatePath); 5] = [
            |p| p.scale_dph[1] += 1.0,
            |p| p.current.bias_dph[0] += 1.0,
            |p| p.current.status[2] ^= AxisStatus::OVER_RANGE,
            |p| p.current.effective_tick ^= 1,
            |p| p.delay_ticks ^= 4,
        ];
        for (k, damage) in damages.iter().enumerate() {
            let mut p = filtered();
            p.set_output(OutputSettings { decimation: 1000, increments: 5, ..OutputSettings::default() });
            let event = |p: &mut RatePath, k: u32| p.sample(k * 90_000, [1000, k as i32, 0, 0, 0, 0]);
            let sent = (0..2050u32).filter(|k| event(&mut p, *k).increments).count();
            assert!(sent > 200, "{sent}");
            damage(&mut p);
            let events: std::vec::Vec<_> = (2050..2060).map(|k| event(&mut p, k)).collect();
            assert!(
                events.iter().any(|e| e.corrupted) && !events.iter().any(|e| e.increments),
                "damage {k}: {events:?}"
            );
        }
    }

    #[test]
    fn settings_change_with_the_frame() {
        let mut p = filtered();
        let _ = fly(&mut p, 100, |_| None);
        p.set_output(OutputSettings { filter: Filter::Mean, decimation: 10, ..OutputSettings::default() });
        let sent: std::vec::Vec<_> =
            (100..140u32).filter_map(|k| p.sample(k * 90_000, [1000, k as i32, 0, 0, 0, 0]).frame).collect();
        // The frame that was begun ends as it was; a mean of ten is 6 ms late.
        assert_eq!(sent.iter().map(|f| f.sample).collect::<std::vec::Vec<_>>(), [105, 115, 125, 135]);
        assert_eq!(sent[1].tick, 114 * 90_000 - 6 * 90_000);
        assert!((sent[1].rate_dph[1] - 1.095).abs() < 1e-6, "{}", sent[1].rate_dph[1]);
        // Impossible settings are not taken.
        p.set_output(OutputSettings { decimation: 0, ..OutputSettings::default() });
        assert_eq!(p.output().decimation, 10);
    }
}
