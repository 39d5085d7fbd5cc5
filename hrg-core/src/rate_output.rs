//! The rate path with all that a unit decides around it: what is sent, what is flagged, when to stop.
//!
//! The firmware's rate task, the digital twin and the fuzz target drive this type alike: a bias and a decimation in, samples and
//! looks at the time in, frames and the means of a second out.
//!
//! # Example
//! ```
//! use hrg_core::adc::Fault;
//! use hrg_core::rate_output::RateOutput;
//! use hrg_core::rate_path::RatePath;
//! use hrg_core::status::UnitStatus;
//! use hrg_core::timebase::Timebase;
//!
//! let mut output = RateOutput::new(RatePath::new(Timebase::REFERENCE, [0.01; 3], 1), UnitStatus::empty());
//! let mut frames = Vec::new();
//! let mut send = |frame| {
//!     frames.push(frame);
//!     true
//! };
//! output.sample(90_000, Ok(&[100, 200, 300, 0, 0, 0]), &mut send).expect("intact");
//! output.sample(180_000, Err(Fault::Crc), &mut send).expect("intact");
//! output.sample(270_000, Ok(&[100, 200, 300, 0, 0, 0]), &mut send).expect("intact");
//! // The sample with a wrong checksum is not sent; the frame after it says so.
//! assert_eq!(frames.len(), 2);
//! assert_eq!((frames[0].unit_status, frames[1].unit_status), (UnitStatus::empty(), UnitStatus::ADC_FAULT));
//! ```

use crate::adc::Fault;
use crate::filter::KEPT;
use crate::increments::IncrementFrame;
use crate::output::OutputSettings;
use crate::rate_path::{Event, PendingBias, RateFrame, RatePath, Summary, CHANNELS, MOST_SAMPLES};
use crate::status::UnitStatus;

/// Looks at the time (the model takes one each 10 ms) without a sample between them after which the ADC is silent.
pub const SILENT_LOOKS: u8 = 2;

/// So many samples in a row of which no frame is made mean that the rate path's memory has changed: the longest frame, and a filter that is being
/// filled. (An ADC that loses more than ten samples in a row again and again comes here too: its filter is never filled.)
const UNSENT: u16 = MOST_SAMPLES + KEPT as u16;

/// So many frames dropped one after the other (1.25 s at 200 Hz) mean a stalled link, not a busy one.
pub const DROPS_IN_A_ROW: u16 = 250;

/// Part of the memory that has changed: nothing may be sent any more, and the unit must start anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Corruption {
    /// Scale factors, decimation, bias or sums fail their integrity check.
    RatePath,
    /// The queue of frames takes none for long: it or the link that empties it is corrupted.
    Queue,
}

/// Result of a second of rates, for telemetry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateSecond {
    /// Means over the samples that shared one bias.
    pub summary: Summary,
    /// Frames dropped since start.
    pub dropped: u16,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct RateOutput {
    path: RatePath,
    /// Flags found at start-up: in every frame.
    start_status: UnitStatus,
    /// Standing flags found after start-up.
    standing: UnitStatus,
    dropped: u16,
    /// A frame was dropped since the last one that was sent.
    flag_drop: bool,
    drops_in_a_row: u16,
    looks_without_sample: u8,
    /// Samples since the last frame.
    unsent: u16,
    /// Settings to be used from the next second on.
    next: Option<OutputSettings>,
    /// Increments are due.
    increments: bool,
}

impl RateOutput {
    /// `start_status`: what start-up has found; it is in every frame.
    #[inline]
    #[must_use]
    pub const fn new(path: RatePath, start_status: UnitStatus) -> Self {
        Self {
            path,
            start_status,
            standing: UnitStatus::empty(),
            dropped: 0,
            flag_drop: false,
            drops_in_a_row: 0,
            looks_without_sample: 0,
            unsent: 0,
            next: None,
            increments: false,
        }
    }

    /// Sets the flags that hold from now on, beside those of start-up.
    pub fn set_standing(&mut self, status: UnitStatus) {
        self.standing = status;
    }

    /// Sets the number of accelerometers (2 or 3), before the first sample.
    pub fn set_accelerometers(&mut self, accelerometers: u8) {
        self.path.set_accelerometers(accelerometers);
    }

    /// `true` if the next good sample ends a frame.
    #[must_use]
    pub fn ends_next(&self) -> bool {
        self.path.ends_next()
    }

    /// The next bias.
    pub fn set_bias(&mut self, bias: PendingBias) {
        self.path.set_bias(bias);
    }

    /// Samples per frame from the end of this second on.
    pub fn set_decimation(&mut self, decimation: u16) {
        let settings = self.next.unwrap_or(self.path.output());
        self.next = Some(settings.with_decimation(decimation));
    }

    /// All settings of what is sent, from the end of this second on.
    pub fn set_output(&mut self, settings: OutputSettings) {
        self.next = Some(settings);
    }

    /// Settings of what is sent, of the next frame.
    #[must_use]
    pub fn output(&self) -> OutputSettings {
        self.path.output()
    }

    /// The increments that are due, if any: to be asked for after each sample. Status as in a rate frame.
    #[inline]
    pub fn increments(&mut self) -> Option<IncrementFrame> {
        core::mem::take(&mut self.increments).then(|| self.due_increments())
    }

    #[inline(never)]
    fn due_increments(&self) -> IncrementFrame {
        let mut frame = self.path.increments();
        frame.unit_status |= self.start_status | self.standing;
        frame.with_integrity()
    }

    /// A frame of the ADC has come: the timer's tick at its data-ready edge, and its codes or what is wrong with it. `send` puts a
    /// frame into the queue of the link; `false`: it is full.
    ///
    /// # Errors
    /// Memory is corrupted.
    #[inline]
    pub fn sample(
        &mut self,
        tick: u32,
        codes: Result<&[i32; CHANNELS], Fault>,
        send: impl FnOnce(RateFrame) -> bool,
    ) -> Result<Option<RateSecond>, Corruption> {
        match codes {
            Ok(codes) => self.good(tick, codes, send),
            Err(_) => self.bad(tick, send),
        }
    }

    /// [`sample`](Self::sample) with codes.
    ///
    /// # Errors
    /// As there.
    #[inline]
    pub fn good(
        &mut self,
        tick: u32,
        codes: &[i32; CHANNELS],
        send: impl FnOnce(RateFrame) -> bool,
    ) -> Result<Option<RateSecond>, Corruption> {
        self.looks_without_sample = 0;
        let event = self.path.sample(tick, *codes);
        self.unsent = if event.frame.is_some() { 0 } else { self.unsent.saturating_add(1) };
        if self.unsent > UNSENT {
            return Err(Corruption::RatePath);
        }
        // (Four samples of five.)
        if event.frame.is_none() && event.summary.is_none() && !event.corrupted && !event.increments {
            return Ok(None);
        }
        self.done(event, send)
    }

    /// [`sample`](Self::sample) without codes.
    ///
    /// # Errors
    /// As there.
    pub fn bad(&mut self, tick: u32, send: impl FnOnce(RateFrame) -> bool) -> Result<Option<RateSecond>, Corruption> {
        self.looks_without_sample = 0;
        let event = self.path.missing(tick);
        self.done(event, send)
    }

    /// The timer reads `now`: where no sample has come for [`SILENT_LOOKS`], one is missing.
    ///
    /// # Errors
    /// As [`sample`](Self::sample).
    pub fn look(&mut self, now: u32, send: impl FnOnce(RateFrame) -> bool) -> Result<Option<RateSecond>, Corruption> {
        self.looks_without_sample = self.looks_without_sample.saturating_add(1);
        if self.looks_without_sample < SILENT_LOOKS {
            return Ok(None);
        }
        let event = self.path.missing(now);
        self.done(event, send)
    }

    #[inline]
    fn done(&mut self, event: Event, send: impl FnOnce(RateFrame) -> bool) -> Result<Option<RateSecond>, Corruption> {
        let Event { frame, summary, corrupted, increments } = event;
        if corrupted {
            return Err(Corruption::RatePath);
        }
        self.increments |= increments;
        if let Some(mut frame) = frame {
            frame.unit_status |= self.start_status | self.standing;
            if self.flag_drop {
                frame.unit_status |= UnitStatus::FRAMES_DROPPED;
            }
            self.flag_drop = !send(frame.with_integrity());
            if self.flag_drop {
                self.dropped = self.dropped.saturating_add(1);
                self.drops_in_a_row += 1;
                if self.drops_in_a_row >= DROPS_IN_A_ROW {
                    return Err(Corruption::Queue);
                }
            } else {
                self.drops_in_a_row = 0;
            }
        }
        Ok(summary.map(|summary| {
            if let Some(settings) = self.next.take() {
                self.path.set_output(settings);
            }
            RateSecond { summary, dropped: self.dropped }
        }))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::status::AxisStatus;
    use crate::timebase::Timebase;
    use std::vec::Vec;

    const MS: u32 = Timebase::REFERENCE.ms(1);

    fn output(decimation: u16) -> RateOutput {
        let path = RatePath::new(Timebase::REFERENCE, [0.01; 3], decimation);
        RateOutput::new(path, UnitStatus::IMAGE_REFUSED)
    }

    fn codes(k: u32) -> Result<&'static [i32; CHANNELS], Fault> {
        const CODES: [[i32; CHANNELS]; 8] = [
            [0; CHANNELS],
            [1; CHANNELS],
            [2; CHANNELS],
            [3; CHANNELS],
            [4; CHANNELS],
            [5; CHANNELS],
            [6; CHANNELS],
            [7; CHANNELS],
        ];
        Ok(&CODES[k as usize % 8])
    }

    #[test]
    fn every_frame_carries_what_start_up_found_and_a_drop_is_flagged_once() {
        let mut out = output(1);
        let mut sent: Vec<RateFrame> = Vec::new();
        for k in 0..10 {
            let room = !(3..5).contains(&k);
            let take = |f| {
                if room {
                    sent.push(f);
                }
                room
            };
            assert_eq!(out.sample(k * MS, codes(k), take), Ok(None));
        }
        let status: Vec<UnitStatus> = sent.iter().map(|f| f.unit_status).collect();
        let (usual, drop) = (UnitStatus::IMAGE_REFUSED, UnitStatus::IMAGE_REFUSED | UnitStatus::FRAMES_DROPPED);
        assert_eq!(status, [usual, usual, usual, drop, usual, usual, usual, usual]);
        assert!(sent.iter().all(RateFrame::intact));
    }

    #[test]
    fn a_queue_that_takes_nothing_for_long_is_corrupted() {
        let mut out = output(1);
        let mut k = 0;
        let dropped = loop {
            match out.sample(k * MS, codes(k), |_| false) {
                Ok(_) => k += 1,
                Err(e) => break e,
            }
        };
        assert_eq!((dropped, k + 1), (Corruption::Queue, u32::from(DROPS_IN_A_ROW)));
        // One frame that is taken begins the count anew.
        let mut out = output(1);
        for k in 0..3 * u32::from(DROPS_IN_A_ROW) {
            let taken = k % 200 == 0;
            assert_eq!(out.sample(k * MS, codes(k), |_| taken), Ok(None), "{k}");
        }
    }

    /// With a time between samples that is too long, each sample is taken for the one before; with one too short, all between them for lost.
    #[test]
    fn samples_of_which_no_frame_is_made_are_noticed() {
        for bit in 0..32 {
            let path = RatePath::new(Timebase::REFERENCE, [0.01; 3], 5).with_output(OutputSettings::default(), 3);
            let mut out = RateOutput::new(path, UnitStatus::empty());
            let sample = |out: &mut RateOutput, k: u32| out.sample(k * MS, codes(k), |_| true);
            assert!((0..200).all(|k| sample(&mut out, k) == Ok(None)));
            out.path.flip_sample_ticks(bit);
            let noticed = (200..210 + u32::from(UNSENT)).find_map(|k| sample(&mut out, k).err());
            assert_eq!(noticed, Some(Corruption::RatePath), "bit {bit}");
        }
    }

    #[test]
    fn a_silent_adc_is_missed_at_the_second_look_and_the_second_still_ends() {
        let mut out = output(1);
        assert_eq!(out.sample(0, codes(0), |_| true), Ok(None));
        out.set_bias(PendingBias::at(25 * MS, 1, [0.0; 3], [AxisStatus::empty(); 3]));
        assert_eq!(out.look(10 * MS, |_| true), Ok(None));
        assert_eq!(out.look(20 * MS, |_| true), Ok(None));
        let second = out.look(30 * MS, |_| true).expect("intact").expect("the bias is due");
        assert_eq!((second.summary.samples, second.summary.adc_errors), (1, 2));
        // The next frame says that samples were missing.
        let mut status = UnitStatus::empty();
        let take = |f: RateFrame| {
            status = f.unit_status;
            true
        };
        assert_eq!(out.sample(31 * MS, codes(1), take), Ok(None));
        assert!(status.contains(UnitStatus::ADC_FAULT));
    }

    #[test]
    fn the_decimation_changes_with_the_second() {
        let mut out = output(1);
        out.set_decimation(5);
        let mut samples = Vec::new();
        for k in 0..40u32 {
            if k == 10 {
                out.set_bias(PendingBias::at(20 * MS, 1, [0.0; 3], [AxisStatus::empty(); 3]));
            }
            let take = |f: RateFrame| {
                samples.push(f.sample);
                true
            };
            out.sample(k * MS, codes(k), take).expect("intact");
        }
        // The frame that was begun keeps its length.
        assert_eq!(samples[..22], (1..=22).collect::<Vec<_>>());
        assert_eq!(samples[22..25], [27, 32, 37]);
    }
}
