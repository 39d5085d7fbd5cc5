//! The ADS131M08 ADC as its SPI master sees it (data sheet SBAS950).
//!
//! Frames of ten words, of 24 bits unless MODE.WLENGTH says otherwise. The words out are latched when chip select falls: the answer to the last command, the
//! eight channels, a CRC (of CCITT or ANSI by MODE.CRC_TYPE, seed 0xFFFF). The words in are executed when the frame ends; with MODE.RX_CRC_EN only behind a checksum of
//! their own. With MODE.REG_CRC_EN a register that changes stands in STATUS; a frame's status is that at the end of the frame before.
//!
//! Settings under which no such ADC gives good samples give none here: a channel that is off (CLOCK.CHn_EN) sends zeros; DRDY that is let go instead of driven high
//! (MODE.DRDY_HiZ) makes no edge against the pull-down of the unit; a reference from outside that nothing drives (CLOCK.EXTREF_EN)
//! gives codes that mean nothing. (Sections 8.3, 8.5 and 8.6. At 2.048 MHz the modulator is fast enough in each of its power modes, section 6.3.)
//!
//! It keeps two samples (section 8.5.1.9.1): a frame takes the oldest; a third one that comes meanwhile replaces the second.
//! SYNC/RESET low for 2048 clocks or longer resets it, for less it begins its conversions anew and forgets those that it has (section
//! 8.4.1). While it is low nothing is converted.

use std::collections::VecDeque;

const WORDS: usize = 10;
/// Bytes of the longest frame: words of 32 bits.
const LONGEST: usize = WORDS * 4;
const CCITT: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
const ANSI: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_CMS);

/// Code at a test voltage: 2/15 of the full scale, whatever the gain (data sheet, internal test signals).
const TEST_LEVEL: i64 = (1 << 23) * 2 / 15;
/// Codes by which a converted voltage of its own scatters at most, each way: the data sheet's noise with an oversampling of 1024, some 6 uV RMS.
const OWN_NOISE: i64 = 77;

/// Defect of a channel, from its multiplexer to its code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Defect {
    /// Gain, thousandths; 1000 is right, -1000 has the wrong sign, 0 is dead.
    pub gain: i64,
    /// Offset, codes.
    pub offset: i64,
    /// Noise, codes each way.
    pub noise: i64,
    /// Its multiplexer stays at the pins.
    pub at_pins: bool,
}

impl Defect {
    /// None.
    pub const NONE: Self = Self { gain: 1000, offset: 0, noise: 0, at_pins: false };
}

/// Registers STATUS, MODE and CLOCK, and bits of the second, of the third, and of the first.
const STATUS: usize = 0x01;
const MODE: usize = 0x02;
const CLOCK: usize = 0x03;
const RX_CRC: u16 = 1 << 12;
const MAP_CRC: u16 = 1 << 13;
const HIGH_IMPEDANCE: u16 = 1 << 1;
const EXTERNAL_REFERENCE: u16 = 1 << 6;
const CRC_ERROR: u16 = 1 << 12;
const MAP_CHANGED: u16 = 1 << 13;

/// Weights of the ADC's filter, a sinc3, for a signal that is known at so many moments per sample time, newest first: its output is that of three running
/// means over a sample time, one behind the other (section 8.3, digital filter). The moments lie in the middle of their pieces.
#[must_use]
pub fn filter_weights(per_sample: usize) -> Vec<f64> {
    let mean = vec![1.0 / per_sample as f64; per_sample];
    let with = |a: &[f64]| -> Vec<f64> {
        let mut out = vec![0.0; a.len() + per_sample - 1];
        for (k, x) in a.iter().enumerate() {
            for (j, y) in mean.iter().enumerate() {
                out[k + j] += x * y;
            }
        }
        out
    };
    with(&with(&mean))
}

/// Master clock that the modulator's clock is made of, Hz.
const CLKIN_HZ: u64 = 2_048_000;

/// The ADC.
#[derive(Debug, Clone)]
pub struct Ads131m08 {
    registers: [u16; 64],
    answer: u16,
    /// Of the frame that was latched last.
    codes: [i32; 8],
    /// Samples that no frame has taken.
    store: VecDeque<[i32; 8]>,
    /// Since when SYNC/RESET is low, cycles.
    low_since: Option<u64>,
    out: [u8; LONGEST],
    input: [u8; LONGEST],
    /// Bytes of a word of the frame that is under way.
    word_bytes: usize,
    at: usize,
    selected: bool,
    corrupt: bool,
    defects: [Defect; 8],
    /// State of the noise's generator.
    noise: u32,
}

impl Default for Ads131m08 {
    fn default() -> Self {
        let mut registers = [0u16; 64];
        registers[0x00] = 0x2800; // ID: eight channels
        registers[0x01] = 0x0500; // STATUS: RESET, 24-bit words
        registers[0x02] = 0x0510; // MODE
        registers[0x03] = 0xFF0E; // CLOCK
        registers[0x06] = 0x0600; // CFG
        (0..8).for_each(|n| registers[0x0C + 5 * n] = 0x8000); // GCAL: 1
        Self {
            registers,
            answer: 0xFF28,
            codes: [0; 8],
            store: VecDeque::new(),
            low_since: None,
            out: [0; LONGEST],
            input: [0; LONGEST],
            word_bytes: 3,
            at: 0,
            selected: false,
            corrupt: false,
            defects: [Defect::NONE; 8],
            noise: 1,
        }
    }
}

impl Ads131m08 {
    /// A checksum of the kind that is set.
    fn checksum(&self, bytes: &[u8]) -> u16 {
        if self.registers[MODE] & 1 << 11 == 0 {
            CCITT.checksum(bytes)
        } else {
            ANSI.checksum(bytes)
        }
    }

    /// `true` if a conversion that is done makes an edge at DRDY.
    #[must_use]
    pub fn drives_data_ready(&self) -> bool {
        self.registers[MODE] & HIGH_IMPEDANCE == 0 && self.registers[CLOCK] >> 8 != 0
    }

    /// Cycles of a clock of `hz` between samples, from the oversampling ratio set.
    #[must_use]
    pub fn period(&self, hz: u64) -> u64 {
        let ratio = match (self.registers[0x03] >> 2) & 7 {
            0b111 => 16_256,
            n => 128u64 << n,
        };
        hz * ratio * 2 / CLKIN_HZ
    }

    /// A channel has a defect from now on.
    pub fn break_channel(&mut self, channel: usize, defect: Defect) {
        self.defects[channel % 8] = defect;
    }

    /// Registers as at power-on. (No reset repairs a channel.)
    fn forget(&mut self) {
        *self = Self { defects: self.defects, noise: self.noise, ..Self::default() };
    }

    /// A conversion is done.
    pub fn convert(&mut self, codes: [i32; 8]) {
        self.store.truncate(1);
        self.store.push_back(codes);
    }

    /// `true` while SYNC/RESET holds it.
    #[must_use]
    pub fn held(&self) -> bool {
        self.low_since.is_some()
    }

    /// The level at SYNC/RESET, at a time in cycles of a clock of `hz`.
    pub fn sync_reset(&mut self, high: bool, now: u64, hz: u64) {
        match (self.low_since, high) {
            (None, false) => self.low_since = Some(now),
            (Some(since), true) => {
                if (now - since) * CLKIN_HZ >= 2048 * hz {
                    self.forget();
                }
                self.store.clear();
                self.low_since = None;
            }
            _ => {}
        }
    }

    /// Samples that no frame has taken.
    #[must_use]
    pub fn backlog(&self) -> usize {
        self.store.len()
    }

    /// Its supply fails for a moment: all registers are as at power-on.
    pub fn lose_settings(&mut self) {
        self.forget();
    }

    /// A bit of a register changes.
    pub fn flip(&mut self, register: usize, bit: u32) {
        let register = register % 64;
        self.set(register, self.registers[register] ^ 1 << (bit % 16));
    }

    /// A register takes a value. With MODE.REG_CRC_EN a change stands in STATUS until that is read (section 8.5, register map CRC).
    fn set(&mut self, register: usize, value: u16) {
        let changes = std::mem::replace(&mut self.registers[register], value) != value;
        if changes && register > STATUS && self.registers[MODE] & MAP_CRC != 0 {
            self.registers[STATUS] |= MAP_CHANGED;
        }
    }

    /// Chip select changes; `corrupt` flips a bit of the frame that begins.
    pub fn select(&mut self, selected: bool, corrupt: bool) {
        if selected && !self.selected {
            self.at = 0;
            self.corrupt = corrupt;
            self.latch();
        }
        if !selected && self.selected && self.at >= 2 * self.word_bytes {
            self.execute();
        }
        self.selected = selected;
    }

    fn latch(&mut self) {
        self.codes = self.store.pop_front().unwrap_or(self.codes);
        let mut words = [0u32; WORDS];
        words[0] = u32::from(self.answer) << 8;
        for (n, w) in words[1..9].iter_mut().enumerate() {
            *w = self.converted(n) as u32 & 0xFF_FFFF;
        }
        let length = self.registers[MODE] >> 8 & 3;
        self.word_bytes = [2, 3, 4, 4][usize::from(length)];
        for (bytes, w) in self.out.chunks_exact_mut(self.word_bytes).zip(words) {
            // Of 24 bits: the upper 16; all; with zeros behind; with the sign before.
            match length {
                0b00 => bytes.copy_from_slice(&w.to_be_bytes()[1..3]),
                0b01 => bytes.copy_from_slice(&w.to_be_bytes()[1..]),
                0b10 => bytes.copy_from_slice(&(w << 8).to_be_bytes()),
                _ => bytes.copy_from_slice(&((w << 8) as i32 >> 8).to_be_bytes()),
            }
        }
        let end = (WORDS - 1) * self.word_bytes;
        let crc = self.checksum(&self.out[..end]);
        self.out[end..end + 2].copy_from_slice(&crc.to_be_bytes());
        if self.corrupt {
            self.out[4] ^= 0x10;
        }
    }

    /// Converts a channel's code by the registers (sections 8.3 and 8.6): multiplexer, gain, DC block, calibration.
    fn converted(&mut self, n: usize) -> i32 {
        if self.registers[CLOCK] & 1 << (8 + n) == 0 {
            return 0;
        }
        if self.registers[CLOCK] & EXTERNAL_REFERENCE != 0 {
            return self.scatter(1 << 22) as i32;
        }
        let defect = self.defects[n];
        let noise = self.scatter(OWN_NOISE);
        let more = self.scatter(defect.noise);
        let r = |k: usize| self.registers[k];
        let channel = |k: usize| r(0x09 + 5 * n + k);
        let gain = r(0x04 + n / 4) >> (4 * (n % 4)) & 7;
        let blocked = r(0x08) & 0xF != 0 && channel(0) & 1 << 2 == 0;
        let place = if defect.at_pins { 0 } else { channel(0) & 3 };
        // (Its own noise is on the rates already: they are a recording's.)
        let input = match place {
            0 if blocked => 0,
            0 => i64::from(self.codes[n]) << gain,
            0b01 => noise,
            0b10 => TEST_LEVEL + noise,
            _ => noise - TEST_LEVEL,
        };
        let input = input * defect.gain / 1000 + defect.offset + more;
        let offset = i64::from((i32::from(channel(1) as i16) << 8) | i32::from(channel(2) >> 8));
        let scale = i64::from(channel(3)) << 8 | i64::from(channel(4) >> 8);
        (((input - offset) * scale) >> 23).clamp(-8_388_608, 8_388_607) as i32
    }

    /// The next number of the noise, up to `most` each way.
    fn scatter(&mut self, most: i64) -> i64 {
        self.noise = self.noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        i64::from(self.noise >> 8) * (2 * most + 1) / (1 << 24) - most
    }

    /// Moves one byte each way.
    pub fn exchange(&mut self, byte: u8) -> u8 {
        if !self.selected || self.at >= WORDS * self.word_bytes {
            return 0;
        }
        self.input[self.at] = byte;
        let out = self.out[self.at];
        self.at += 1;
        out
    }

    fn word(&self, index: usize) -> u16 {
        let at = index * self.word_bytes;
        u16::from_be_bytes([self.input[at], self.input[at + 1]])
    }

    fn execute(&mut self) {
        let command = self.word(0);
        // The checksum of what comes in stands behind the command, and its value where it has one.
        if self.registers[MODE] & RX_CRC != 0 {
            let words = if command >> 13 == 0b011 { 2 } else { 1 };
            let expected = self.checksum(&self.input[..words * self.word_bytes]);
            if self.at < (words + 1) * self.word_bytes || self.word(words) != expected {
                self.registers[STATUS] |= CRC_ERROR;
                self.answer = self.registers[STATUS] | 0x00FF;
                return;
            }
        }
        let address = usize::from(command >> 7) & 63;
        match command >> 13 {
            0b011 => {
                let value = self.word(1);
                self.set(address, value);
                if address == 0x02 {
                    self.registers[STATUS] = self.registers[STATUS] & !0x0400 | value & 0x0400;
                }
                self.answer = 0x4000 | (command & 0x1FFF);
            }
            0b101 => self.answer = self.registers[address],
            _ if command == 0x0011 => self.forget(),
            _ => {
                self.answer = self.registers[STATUS] | 0x00FF;
                self.registers[STATUS] &= !MAP_CHANGED;
            }
        }
    }
}
