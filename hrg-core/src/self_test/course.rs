//! The course of the ADC's test: each channel's inputs shorted, then at the ADC's two test voltages, then at the pins again.
//!
//! The multiplexer of a channel chooses (CHn_CFG.MUX; data sheet SBAS950, input multiplexer and internal test signals). All channels are
//! switched, one in a frame; the digital filter settles; then the codes are averaged.
//!
//! # Example
//! ```
//! use hrg_core::self_test::course::{Course, Next};
//!
//! let mut course = Course::default();
//! // The first eight frames switch the eight channels.
//! let first: Vec<Next> = (0..9).map(|_| course.frame(Some(&[0; 8]))).collect();
//! assert_eq!(first[7], Next::Switch { channel: 7, place: 0b01 });
//! assert_eq!(first[8], Next::Wait);
//! ```

use crate::adc::ALL_CHANNELS;

/// Places of the multiplexers, one after the other: shorted, positive and negative test voltage, pins.
const PLACES: [u16; 4] = [0b01, 0b10, 0b11, 0b00];
/// Frames that are left out after the last channel was switched: the command is carried out at the end of the next frame, the ADC keeps two samples,
/// and its filter settles within four.
const SETTLE: u16 = 12;
/// Frames that are averaged in each place.
const FRAMES: [u16; 4] = [100, 100, 100, 500];

/// Figures of the eight channels, in codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levels {
    /// Mean with shorted inputs, at the positive and at the negative test voltage.
    pub means: [[f32; ALL_CHANNELS]; 3],
    /// Standard deviation with shorted inputs, of successive differences.
    pub noise: [f32; ALL_CHANNELS],
    /// The same at the pins.
    pub pins: [f32; ALL_CHANNELS],
}

impl Levels {
    /// None.
    pub const MISSING: Self =
        Self { means: [[f32::NAN; ALL_CHANNELS]; 3], noise: [f32::NAN; ALL_CHANNELS], pins: [f32::NAN; ALL_CHANNELS] };
}

/// Action after a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// Connect a channel.
    Switch {
        /// From 0.
        channel: u8,
        /// CHn_CFG.MUX.
        place: u16,
    },
    /// Nothing.
    Wait,
    /// The figures are there.
    Done(Levels),
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Course {
    place: usize,
    frames: u16,
    count: u16,
    before: [i32; ALL_CHANNELS],
    sums: [i64; ALL_CHANNELS],
    squares: [f32; ALL_CHANNELS],
    levels: Levels,
}

impl Default for Course {
    fn default() -> Self {
        Self {
            place: 0,
            frames: 0,
            count: 0,
            before: [0; ALL_CHANNELS],
            sums: [0; ALL_CHANNELS],
            squares: [0.0; ALL_CHANNELS],
            levels: Levels::MISSING,
        }
    }
}

impl Course {
    /// A frame has come, with its codes; `None`: it was not valid.
    pub fn frame(&mut self, codes: Option<&[i32; ALL_CHANNELS]>) -> Next {
        let frame = self.frames;
        self.frames += 1;
        let place = PLACES.get(self.place).copied().unwrap_or(0);
        if usize::from(frame) < ALL_CHANNELS {
            return Next::Switch { channel: frame as u8, place };
        }
        if frame < ALL_CHANNELS as u16 + SETTLE {
            return Next::Wait;
        }
        if let Some(codes) = codes {
            self.add(codes);
        }
        if self.count < FRAMES.get(self.place).copied().unwrap_or(0) {
            return Next::Wait;
        }
        self.close();
        if self.place < PLACES.len() {
            Next::Wait
        } else {
            Next::Done(self.levels)
        }
    }

    fn add(&mut self, codes: &[i32; ALL_CHANNELS]) {
        for k in 0..ALL_CHANNELS {
            self.sums[k] += i64::from(codes[k]);
            let step = codes[k].wrapping_sub(self.before[k]) as f32;
            if self.count > 0 {
                self.squares[k] += step * step;
            }
        }
        self.before = *codes;
        self.count += 1;
    }

    /// Figures of this place; the next one begins.
    fn close(&mut self) {
        let n = f32::from(self.count);
        let noise = self.squares.map(|s| libm::sqrtf(s / (2.0 * (n - 1.0))));
        match self.levels.means.get_mut(self.place) {
            Some(means) => *means = self.sums.map(|s| s as f32 / n),
            None => self.levels.pins = noise,
        }
        if self.place == 0 {
            self.levels.noise = noise;
        }
        let levels = self.levels;
        *self = Self { place: self.place + 1, levels, ..Self::default() };
    }
}
