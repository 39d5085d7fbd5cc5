//! The filter between samples at 1 kHz and frames: what of a vibration is in the rates, and of what time a frame is.
//!
//! # Two filters
//! | [`Filter`] | frames | pass band | -3 dB | stop band | delay |
//! |---|---|---|---|---|---|
//! | `LinearPhase` | of 5 samples (200 Hz) | flat to 0.1 dB to 60 Hz | 79 Hz | 80 dB from 130 Hz on | 28 ms |
//! | `Mean`, and any other number of samples `n` | means | none | 262 Hz (`n` = 1), 86 Hz (5), 442 Hz / `n` (from 20 on) | none: 13 dB beside its zeros | (`n` + 2) / 2 ms |
//!
//! All of it with the ADC's own filter, a sinc3 over one sample time (data sheet SBAS950), whose droop the pass band makes up for. What folds
//! back round 1 kHz is 72 dB down by the sinc3 alone. The coefficients are integers whose sum is 2^22, and codes are integers too: a constant code comes out
//! to the last bit, on the unit as on the desktop. `bench/filter/design.py` has made them.
//!
//! # Delay
//! Both filters and the sinc3 are symmetrical, so their delay is the same at all frequencies ([`Filter::delay_halves`]), and a frame's tick is the time that
//! its rate is of: that of its last sample less the delay.
//!
//! # Example
//! ```
//! use hrg_core::filter::{Filter, Samples};
//!
//! let design = Filter::LinearPhase.design(5).expect("200 Hz");
//! let mut samples = Samples::default();
//! let mut frame = |_| {
//!     samples.push(true, false, &[1000, -7, 0, 0, 0, 0]);
//!     (samples.of_frame() == 5).then(|| samples.frame(design).expect("intact")).flatten()
//! };
//! let mut frames = (0..200).filter_map(&mut frame);
//! // Of a constant code each frame is that code.
//! assert_eq!(frames.next(), Some([1000.0, -7.0, 0.0]));
//! ```

use crate::rate_path::CHANNELS;
use crate::AXES;

/// Bits of the sum of the coefficients.
const BITS: u32 = 22;

/// Half sample times by which the ADC's sinc3 delays.
const ADC_HALVES: u32 = 3;

/// From samples to frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Filter {
    /// Means of the samples of a frame.
    Mean = 0,
    /// A low-pass filter of linear phase, where there is one for that many samples a frame; else means.
    #[default]
    LinearPhase = 1,
}

/// A low-pass filter.
#[derive(Debug, PartialEq, Eq)]
pub struct Design {
    /// Samples per frame.
    decimation: u16,
    /// Coefficients of the samples: [`KEPT`] of them.
    taps: &'static [i32; KEPT],
}

/// All coefficients of a symmetrical filter, from those of one half.
const fn whole<const HALF: usize, const ALL: usize>(half: [i32; HALF]) -> [i32; ALL] {
    let mut all = [0; ALL];
    let mut k = 0;
    while k < HALF {
        all[HALF + k] = half[k];
        all[HALF - 1 - k] = half[k];
        k += 1;
    }
    all
}

/// Samples per frame from 1 kHz to 200 Hz.
const HZ60_SAMPLES: u16 = 5;
static HZ60: Design = Design { decimation: HZ60_SAMPLES, taps: &TAPS_60 };
static TAPS_60: [i32; 54] = whole([
    734889, 656835, 516841, 342895, 167644, 20395, -79378, -125328, -123726, -89742, -42009, 2732, 33404, 45987, 42637,
    29288, 12821, -1238, -9925, -12877, -11540, -8070, -4378, -1619, -120, 364, 370,
]);

impl Filter {
    /// The filter with a number.
    #[must_use]
    pub const fn from_number(n: u8) -> Option<Self> {
        match n {
            0 => Some(Self::Mean),
            1 => Some(Self::LinearPhase),
            _ => None,
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::LinearPhase => "linear-phase",
        }
    }

    /// The low-pass filter for so many samples a frame; `None`: frames are means.
    #[must_use]
    pub const fn design(self, decimation: u16) -> Option<&'static Design> {
        match (self, decimation) {
            (Self::LinearPhase, HZ60_SAMPLES) => Some(&HZ60),
            _ => None,
        }
    }

    /// Half sample times from the moment that a frame of so many samples is of to the data-ready edge of its last sample, the ADC's filter
    /// included.
    #[must_use]
    pub const fn delay_halves(self, decimation: u16) -> u32 {
        let taps = match self.design(decimation) {
            Some(design) => design.taps.len() as u32,
            None => decimation as u32,
        };
        taps.saturating_sub(1) + ADC_HALVES
    }

    /// The same in us.
    #[must_use]
    pub const fn delay_us(self, decimation: u16) -> u32 {
        self.delay_halves(decimation) * (crate::rate_path::SAMPLE_US / 2)
    }
}

/// Samples that are kept: those of the filter.
pub const KEPT: usize = TAPS_60.len();

/// Frames of the filter that a sample is part of.
pub const FRAMES: usize = KEPT.div_ceil(HZ60_SAMPLES as usize);

/// Place of the next sample; samples since the last frame, since the last message of increments, and since the start as far as they matter: a byte each,
/// the place in the lowest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Counts(u32);

impl Counts {
    const fn byte(self, n: u32) -> u8 {
        (self.0 >> (8 * n)) as u8
    }
    #[inline(always)]
    const fn at(self) -> usize {
        self.byte(0) as usize
    }
    const fn of_frame(self) -> u16 {
        self.byte(1) as u16
    }
    const fn of_increments(self) -> u16 {
        self.byte(2) as u16
    }
    #[inline(always)]
    const fn filled(self) -> usize {
        self.byte(3) as usize
    }
    /// One sample more, which counts for what there is.
    #[inline(always)]
    const fn next(self, frame: bool, increments: bool) -> Self {
        let full = self.filled() >= KEPT;
        let more = 1 | (frame as u32) << 8 | (increments as u32) << 16 | (!full as u32) << 24;
        let word = self.0.wrapping_add(more);
        Self(if word & 0xFF >= KEPT as u32 { word & !0xFF } else { word })
    }
}

/// The last samples, and what shows that memory has changed: sums of the codes that frame and increments are made of, and the counts a second time.
#[derive(Debug, Clone)]
pub struct Samples {
    /// Each sample twice, [`KEPT`] places apart: so the last ones always lie in a row.
    codes: [[i32; CHANNELS]; 2 * KEPT],
    frame_sum: i32,
    increments_sum: i32,
    counts: Counts,
    /// The same, all bits inverted.
    inverse: u32,
}

impl Default for Samples {
    fn default() -> Self {
        Self { codes: [[0; CHANNELS]; 2 * KEPT], frame_sum: 0, increments_sum: 0, counts: Counts(0), inverse: !0 }
    }
}

/// Sums over the samples of a frame.
#[derive(Default)]
struct Sums {
    products: [i64; AXES],
    codes: i32,
}

impl Sums {
    /// Of samples with their coefficients.
    #[inline(always)]
    fn of(codes: &[[i32; CHANNELS]], taps: &[i32]) -> Self {
        let mut sums = Self::default();
        // (Axis by axis: three sums of 64 bits at once do not stay in the processor's registers.)
        for (k, product) in sums.products.iter_mut().enumerate() {
            let (mut sum, mut check) = (0, 0i32);
            for (codes, tap) in codes.iter().zip(taps) {
                sum += i64::from(*tap) * i64::from(codes[k]);
                check = check.wrapping_add(codes[k]);
            }
            *product = sum;
            sums.codes = sums.codes.wrapping_add(check);
        }
        sums
    }
}

/// Sum of the codes of the rates.
#[inline(always)]
fn of_rates(codes: &[i32; CHANNELS]) -> i32 {
    codes[0].wrapping_add(codes[1]).wrapping_add(codes[2])
}

/// Sum of all codes.
#[inline(always)]
fn of_all(codes: &[i32; CHANNELS]) -> i32 {
    of_rates(codes).wrapping_add(codes[3]).wrapping_add(codes[4]).wrapping_add(codes[5])
}

/// Memory of a filter has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Changed;

impl Samples {
    /// Samples since the last frame.
    #[must_use]
    #[inline]
    pub fn of_frame(&self) -> u16 {
        self.counts.of_frame()
    }

    /// Samples since the last message of increments.
    #[must_use]
    #[inline]
    pub fn of_increments(&self) -> u16 {
        self.counts.of_increments()
    }

    /// Takes a sample, which counts for the frame, for the increments, or for both.
    #[inline(always)]
    pub fn push(&mut self, frame: bool, increments: bool, codes: &[i32; CHANNELS]) {
        let at = self.counts.at();
        // The one that leaves the window of a frame: it gives its place to the new one.
        let left = self.codes.get(at).map_or(0, of_rates);
        for place in [at, at + KEPT] {
            if let Some(place) = self.codes.get_mut(place) {
                *place = *codes;
            }
        }
        self.frame_sum = self.frame_sum.wrapping_add(of_rates(codes)).wrapping_sub(left);
        self.increments_sum = self.increments_sum.wrapping_add(of_all(codes));
        self.counts = self.counts.next(frame, increments);
        self.inverse = !Counts(!self.inverse).next(frame, increments).0;
    }

    /// The counts, of which one begins anew; whether they were intact.
    #[inline(always)]
    fn begin(&mut self, byte: u32) -> (Counts, bool) {
        let (counts, intact) = (self.counts, self.counts.0 == !self.inverse);
        self.counts.0 &= !(0xFF << (8 * byte));
        self.inverse |= 0xFF << (8 * byte);
        (counts, intact)
    }

    /// The last `n` samples, oldest first.
    #[inline(always)]
    fn last(&self, counts: Counts, n: usize) -> &[[i32; CHANNELS]] {
        let end = counts.at() + KEPT;
        self.codes.get(end.saturating_sub(n)..end).unwrap_or_default()
    }

    /// The frame that is due, in codes; `None`: too few samples have come since the start.
    ///
    /// # Errors
    /// Its memory has changed.
    #[inline(always)]
    pub fn frame(&mut self, design: &Design) -> Result<Option<[f32; AXES]>, Changed> {
        let (counts, intact) = self.begin(1);
        let sums = Sums::of(self.last(counts, KEPT), design.taps);
        if !intact || sums.codes != self.frame_sum || counts.of_frame() != design.decimation {
            return Err(Changed);
        }
        let whole = counts.filled() >= KEPT;
        Ok(whole.then(|| sums.products.map(|sum| sum as f32 * (1.0 / (1u32 << BITS) as f32))))
    }

    /// The samples of the message of increments that is due, each given to `take`, oldest first; the one before them goes first, as far as there was one.
    /// Gives their number.
    ///
    /// # Errors
    /// Its memory has changed. (What was taken is of no use then.)
    #[inline(always)]
    pub fn increments(&mut self, mut take: impl FnMut(&[i32; CHANNELS])) -> Result<u16, Changed> {
        let (counts, intact) = self.begin(2);
        let n = usize::from(counts.of_increments());
        let before = usize::from(counts.filled() > n);
        let mut sum = core::mem::take(&mut self.increments_sum);
        let mut first = before > 0;
        for codes in self.last(counts, (n + before).min(KEPT)) {
            take(codes);
            if !core::mem::take(&mut first) {
                sum = sum.wrapping_sub(of_all(codes));
            }
        }
        if !intact || sum != 0 {
            return Err(Changed);
        }
        Ok(counts.of_increments())
    }

    /// A bit of its memory flips: 0 to 31 of a code in use, 32 to 63 of a sum, then of a count.
    #[cfg(test)]
    pub(crate) fn flip(&mut self, bit: u32) {
        let at = self.counts.at() + KEPT - 2;
        match bit {
            0..32 => self.codes[at][1] ^= 1 << bit,
            32..64 => self.frame_sum ^= 1 << (bit - 32),
            _ => self.counts.0 ^= 1 << (bit - 64),
        }
    }

    /// Begins anew: samples were lost.
    pub fn restart(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::f64::consts::PI;
    use std::vec::Vec;

    /// Gain of a filter at a frequency, Hz, without the ADC's.
    fn gain(taps: &[i32], hz: f64) -> f64 {
        let (mut re, mut im) = (0.0, 0.0);
        for (k, c) in taps.iter().enumerate() {
            let phase = 2.0 * PI * hz * k as f64 / 1000.0;
            re += f64::from(*c) * phase.cos();
            im += f64::from(*c) * phase.sin();
        }
        re.hypot(im) / f64::from(1u32 << BITS)
    }

    fn sinc3(hz: f64) -> f64 {
        let x = PI * hz / 1000.0;
        if x == 0.0 {
            1.0
        } else {
            (x.sin() / x).powi(3)
        }
    }

    fn db(gain: f64) -> f64 {
        20.0 * gain.max(1e-12).log10()
    }

    #[test]
    fn the_bands_are_those_of_the_table() {
        let (passes, stops) = (60.0, 130.0);
        let design = Filter::LinearPhase.design(5).expect("there");
        assert_eq!(design.taps.iter().map(|c| i64::from(*c)).sum::<i64>(), 1 << BITS);
        assert!(design.taps.iter().eq(design.taps.iter().rev()), "linear phase");
        let at = |hz: f64| db(gain(design.taps, hz) * sinc3(hz));
        for k in 0..=5000 {
            let hz = f64::from(k) * 0.1;
            let level = at(hz);
            if hz <= passes {
                assert!(level.abs() < 0.1, "{hz} Hz: {level} dB");
            }
            // (Down to -80 dB without the help of the ADC's filter.)
            if hz >= stops {
                assert!(db(gain(design.taps, hz)) < -80.0, "{hz} Hz: {level} dB");
            }
        }
        assert!((at(79.2) + 3.0).abs() < 0.05, "{}", at(79.2));
        // Means, at the -3 dB of the table.
        for (n, hz) in [(1, 261.5), (5, 85.5), (100, 4.42)] {
            let mean = std::vec![(1 << BITS) / n; n as usize];
            let level = db(gain(&mean, hz) * sinc3(hz));
            assert!((level + 3.0).abs() < 0.1, "{n}: {level}");
        }
        // Folded back round the ADC's own rate into the pass band.
        let fold = [1000.0 - passes, 1000.0 + passes].map(|hz| db(sinc3(hz).abs()));
        assert!(fold.iter().all(|level| *level < -71.0), "{fold:?}");
        assert_eq!(FRAMES, 11);
    }

    #[test]
    fn delays_are_those_of_the_table_and_of_a_ramp() {
        let us = |filter: Filter, n| filter.delay_us(n);
        assert_eq!([us(Filter::LinearPhase, 5), us(Filter::LinearPhase, 10)], [28_000, 6_000]);
        assert_eq!([us(Filter::Mean, 1), us(Filter::Mean, 5), us(Filter::LinearPhase, 1000)], [1500, 3500, 501_000]);
        // A ramp comes out as it was so many samples before: the delay of the filter without the ADC's.
        let design = Filter::LinearPhase.design(5).expect("there");
        let halves = Filter::LinearPhase.delay_halves(5) - ADC_HALVES;
        let mut samples = Samples::default();
        for k in 0..1000i32 {
            samples.push(true, false, &[64 * k, 0, 0, 0, 0, 0]);
            if samples.of_frame() == 5 {
                if let Ok(Some([found, ..])) = samples.frame(design) {
                    assert_eq!(found, (64 * k - 32 * halves as i32) as f32);
                }
            }
        }
    }

    #[test]
    fn frames_are_the_convolution_at_their_times() {
        let design = Filter::LinearPhase.design(5).expect("there");
        let codes: Vec<i32> = (0..400u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 9) as i32 - (1 << 22)).collect();
        let (mut samples, mut frames) = (Samples::default(), 0);
        for (k, code) in codes.iter().enumerate() {
            samples.push(true, false, &[*code, -*code, 0, 0, 0, 0]);
            if samples.of_frame() < 5 {
                continue;
            }
            let Some(found) = samples.frame(design).expect("intact") else {
                assert!(k < design.taps.len());
                continue;
            };
            frames += 1;
            let sum: i64 =
                design.taps.iter().zip(codes[..=k].iter().rev()).map(|(c, x)| i64::from(*c) * i64::from(*x)).sum();
            let wanted = sum as f32 / (1u32 << BITS) as f32;
            assert_eq!(found, [wanted, -wanted, 0.0], "sample {k}");
        }
        assert_eq!(frames, (400 - 54) / 5 + 1);
    }
}
