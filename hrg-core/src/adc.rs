//! The ADS131M08: its frames, and what the unit says to it (data sheet SBAS950).
//!
//! # Frames
//! Ten 24-bit words, big-endian: the answer to the command of the frame before, eight channels, CRC (section 8.5). With the first word
//! the unit sends a command of its own.
//!
//! # The dialogue
//! The ADC forgets its settings where its supply fails. So [`Dialogue`] writes all of them ([`SETTINGS`]), reads them back, and only then
//! takes samples. While it takes them the ADC itself watches its registers: it makes a checksum of them all the time, and a change stands in the
//! status that comes with the next frame. (A setting may so be wrong in one sample.) Should that watch have stopped, one setting is read back every
//! [`READ_EVERY`] frames. A flag of a reset or a setting that has changed begins the set-up anew. After [`BAD_IN_A_ROW`] frames with a wrong checksum the bus itself may be out of step: bus and ADC are reset. So
//! they are after [`WITHOUT_SAMPLE`] frames that gave no sample, whatever the reason: frames may be valid and old, where the bus no longer fills them; an
//! ADC may never read back what was written; or memory has changed, and the dialogue waits for the end of a test that does not run.
//!
//! # Test
//! For the built-in test the multiplexers go through their places ([`crate::self_test::course`]); then the ADC is set up anew.
//!
//! # After a gap
//! The ADC keeps two samples (section 8.5.1.9.1, "after a pause in data collection"): where one was not fetched, the next frame
//! holds an old sample. It is refused, and a second one is fetched at once and dropped; then the store is empty.
//!
//! # Example
//! ```
//! use hrg_core::adc::{Dialogue, Fault, Next, WORDS};
//!
//! // Of a new ADC nothing is known: it is set up first. A frame of zeros has a wrong checksum, whatever is expected of it.
//! let mut dialogue = Dialogue::default();
//! let received = dialogue.receive(&[0; WORDS], false);
//! assert_eq!(received.sample(), Some(Err(Fault::Crc)));
//! assert_eq!(received.next, Next::Wait);
//! ```

use crate::rate_path::CHANNELS;
use crate::self_test::course::{self, Course, Levels};
use crate::AXES;

/// Bytes of a frame.
pub const FRAME: usize = 30;
/// Words of memory that hold it, as DMA puts it there: bytes in order, so that a word is little-endian.
pub const WORDS: usize = FRAME.div_ceil(4);
/// Status bit: the ADC has been reset and has lost its settings.
const STATUS_RESET: u16 = 1 << 10;
/// Status bit: the checksum that the ADC makes of its own registers has changed (section 8.5, register map CRC). Reading the status clears it.
const STATUS_MAP: u16 = 1 << 13;

/// Channels of the ADC.
pub const ALL_CHANNELS: usize = 8;

/// CHn_CFG of the first channel; each has five registers.
const FIRST_CHANNEL: u16 = 0x09;
/// CHn_CFG: no phase delay, DC block off, and the input pins (MUX 0).
const CONNECTED: u16 = 1 << 2;

/// Registers that the unit sets, each with its value: address, value (section 8.6). All that have a say in a code are among them.
pub const SETTINGS: [(u8, u16); 7 + 5 * ALL_CHANNELS] = {
    let mut all = [(0, 0); 7 + 5 * ALL_CHANNELS];
    // CLOCK: all channels on, oversampling 1024 (1 kSPS at 2.048 MHz), high resolution. (With more than 1024 a mean stands behind the sinc3, and what
    // folds back round 1 kHz is 26 dB down, not 72.)
    all[0] = (0x03, 0xFF00 | 0b011 << 2 | 0b10);
    // GAIN1, GAIN2: 1.
    (all[1], all[2]) = ((0x04, 0), (0x05, 0));
    // CFG: global chop off, its delay as after a reset; current detection off.
    all[3] = (0x06, 0x0600);
    // THRSHLD_MSB, THRSHLD_LSB: no current detection, no DC block.
    (all[4], all[5]) = ((0x07, 0), (0x08, 0));
    let mut k = 0;
    while k < ALL_CHANNELS {
        let (at, base) = (6 + 5 * k, FIRST_CHANNEL as u8 + 5 * k as u8);
        // CHn_CFG: input pins connected, no phase delay, DC block off. CHn_OCAL: 0. CHn_GCAL: 1.
        all[at] = (base, CONNECTED);
        (all[at + 1], all[at + 2]) = ((base + 1, 0), (base + 2, 0));
        (all[at + 3], all[at + 4]) = ((base + 3, 0x8000), (base + 4, 0));
        k += 1;
    }
    // MODE: the ADC watches its own registers; 24-bit words, time-out on; clears the flag of a reset. It comes last.
    all[6 + 5 * ALL_CHANNELS] = (0x02, 0x2110);
    all
};

/// One setting is read back in so many frames.
pub const READ_EVERY: u16 = 20;

/// So many frames in a row with a wrong checksum have bus and ADC reset.
pub const BAD_IN_A_ROW: u8 = 3;

/// So many frames in a row that give no sample (1.5 s) have bus and ADC reset, and the dialogue begin anew. The longest that is due are a test and a set-up:
/// 1.1 s.
pub const WITHOUT_SAMPLE: u16 = 1500;

/// Why a frame gives no sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Its checksum does not match.
    Crc,
    /// The ADC was reset: its settings must be written again.
    Reset,
    /// A setting is not as it was written.
    Setting,
    /// The settings are being written and read back.
    SetUp,
    /// The first frame after a pause: its sample is old.
    Gap,
    /// The channels are at the ADC's own voltages, for the built-in test.
    Test,
}

/// Command that the unit sends to the ADC in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Command {
    /// Nothing: the answer is the status.
    Null,
    /// Write a setting.
    Write(u8),
    /// Read it back.
    Read(u8),
    /// Connect a channel to a place of its multiplexer.
    Switch(u8, u16),
}

impl Command {
    /// The first two words of the frame that carries it (section 8.5.1.10).
    #[inline]
    const fn words(self) -> [u16; 2] {
        match self {
            Self::Null => [0; 2],
            Self::Write(k) => {
                let (address, value) = SETTINGS[k as usize % SETTINGS.len()];
                [0x6000 | (address as u16) << 7, value]
            }
            Self::Switch(channel, place) => [0x6000 | (FIRST_CHANNEL + 5 * channel as u16) << 7, CONNECTED | place],
            Self::Read(k) => [0xA000 | (SETTINGS[k as usize % SETTINGS.len()].0 as u16) << 7, 0],
        }
    }

    /// Fault that the ADC's answer to this command shows; `None`: the answer is as it must be. `written`: the unit has written to the
    /// registers since it last had the status.
    #[inline]
    const fn wrong(self, answer: u16, written: bool) -> Option<Fault> {
        match self {
            Self::Null if answer & STATUS_RESET != 0 => Some(Fault::Reset),
            Self::Null if answer & STATUS_MAP != 0 && !written => Some(Fault::Setting),
            Self::Read(k) if answer != SETTINGS[k as usize % SETTINGS.len()].1 => Some(Fault::Setting),
            _ => None,
        }
    }
}

/// Action after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Wait for the next data-ready edge.
    Wait,
    /// Fetch once more at once.
    FetchAgain,
    /// Reset the ADC by its pin, and the bus.
    Reset,
}

/// Result of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// There is a sample, or why there is none; `None`: the frame was one that only empties the ADC's store.
    state: Option<Result<(), Fault>>,
    codes: [i32; ALL_CHANNELS],
    /// The first two words of the next frame out.
    pub command: [u16; 2],
    /// Action that follows.
    pub next: Next,
}

impl Received {
    /// The codes of the channels in use, or why there are none; `None`: the frame was one that only empties the ADC's store.
    // (Side by side and by reference, because they come a thousand times a second: an enum that holds them is copied byte by byte.)
    #[must_use]
    #[inline]
    pub fn sample(&self) -> Option<Result<&[i32; CHANNELS], Fault>> {
        let codes = self.codes.first_chunk().unwrap_or(&[0; CHANNELS]);
        self.state.map(|state| state.map(|()| codes))
    }

    /// The codes of the three channels behind them, where temperature sensors or inputs may be ([`crate::sensors`]); of use where there is
    /// a sample.
    #[must_use]
    #[inline]
    pub fn sensors(&self) -> [i32; AXES] {
        *self.codes.last_chunk().unwrap_or(&[0; AXES])
    }
}

/// Commands of the set-up: all settings written, then read back, then what the last answers need to come, the first status among them: it
/// tells of the unit's own writes.
const SET_UP: u8 = 2 * SETTINGS.len() as u8 + 3;

/// See the module.
#[derive(Debug, Clone)]
pub struct Dialogue {
    /// The ADC may hold an old sample.
    behind: bool,
    /// The frame that comes only empties its store.
    emptying: bool,
    /// The command of the frame before the one that comes: that one holds its answer.
    before: Command,
    /// The command that the frame which comes carries.
    carried: Command,
    /// The next command of the set-up; from [`SET_UP`] on it is done.
    set_up: u8,
    frames: u16,
    bad_in_a_row: u8,
    /// Frames since the last sample.
    without_sample: u16,
    /// The test that runs, and the figures of the last one.
    course: Option<Course>,
    levels: Option<Levels>,
}

impl Default for Dialogue {
    /// Of an ADC of which nothing is known.
    fn default() -> Self {
        Self {
            behind: true,
            emptying: false,
            before: Command::Null,
            carried: Command::Null,
            set_up: 0,
            frames: 0,
            bad_in_a_row: 0,
            without_sample: 0,
            course: None,
            levels: None,
        }
    }
}

impl Dialogue {
    /// A frame was fetched. `missed`: since the one before, a sample was ready and was not fetched.
    // A function of its own in the ELF, so that the virtual board can count what it costs.
    #[inline]
    pub fn receive(&mut self, frame: &[u32; WORDS], missed: bool) -> Received {
        self.behind |= missed;
        let emptying = core::mem::take(&mut self.emptying);
        // (The first byte of each word in its highest bits.)
        let words = frame.map(u32::swap_bytes);
        let state = match checked(&words) {
            Err(fault) => self.invalid(fault),
            Ok(answer) => self.valid(answer),
        };
        let codes = codes(&words);
        let state = if self.course.is_some() { state.and(Err(Fault::Test)) } else { state };
        self.without_sample = if state.is_ok() { 0 } else { self.without_sample.saturating_add(1) };
        if self.bad_in_a_row >= BAD_IN_A_ROW || self.without_sample >= WITHOUT_SAMPLE {
            *self = Self::default();
            return Received { state: Some(state), codes, command: Command::Null.words(), next: Next::Reset };
        }
        self.emptying = state == Err(Fault::Gap);
        self.before = self.carried;
        self.carried = if self.course.is_some() { self.under_test(state, frame) } else { self.choose() };
        Received {
            state: (!emptying || state.is_err()).then_some(state),
            codes,
            command: self.carried.words(),
            next: if self.emptying { Next::FetchAgain } else { Next::Wait },
        }
    }

    /// The next command of a test.
    // (Out of line, with the frame as it came: what costs the usual sample nothing.)
    #[inline(never)]
    fn under_test(&mut self, state: Result<(), Fault>, frame: &[u32; WORDS]) -> Command {
        let Some(course) = self.course.as_mut().filter(|_| self.set_up >= SET_UP) else { return self.choose() };
        let codes = codes(&frame.map(u32::swap_bytes));
        match course.frame((state == Err(Fault::Test)).then_some(&codes)) {
            course::Next::Switch { channel, place } => Command::Switch(channel, place),
            course::Next::Wait => Command::Null,
            course::Next::Done(levels) => {
                self.levels = Some(levels);
                self.course = None;
                self.set_up = 0;
                Command::Null
            }
        }
    }

    /// Begins the test of the channels; it ends with a set-up.
    pub fn test(&mut self) {
        self.course = Some(Course::default());
        self.levels = None;
    }

    /// The figures of a test that has ended, once.
    pub fn tested(&mut self) -> Option<Levels> {
        self.levels.take()
    }

    #[inline]
    fn invalid(&mut self, fault: Fault) -> Result<(), Fault> {
        self.bad_in_a_row += 1;
        if self.set_up < SET_UP {
            // An answer was lost.
            self.set_up = 0;
        }
        Err(fault)
    }

    #[inline]
    fn valid(&mut self, answer: u16) -> Result<(), Fault> {
        self.bad_in_a_row = 0;
        let setting_up = self.set_up < SET_UP;
        if let Some(fault) = self.before.wrong(answer, setting_up || self.course.is_some()) {
            // (The flag of a reset stands until MODE is written.)
            if !setting_up || fault == Fault::Setting {
                self.set_up = 0;
                // (A test whose ADC forgets its places has no result.)
                self.course = None;
            }
            return Err(fault);
        }
        if setting_up {
            return Err(Fault::SetUp);
        }
        if core::mem::take(&mut self.behind) {
            return Err(Fault::Gap);
        }
        Ok(())
    }

    #[inline]
    fn choose(&mut self) -> Command {
        const N: u8 = SETTINGS.len() as u8;
        if self.set_up < SET_UP {
            let k = self.set_up;
            self.set_up += 1;
            return match k {
                0..N => Command::Write(k),
                _ if k < 2 * N => Command::Read(k - N),
                _ => Command::Null,
            };
        }
        self.frames = self.frames.wrapping_add(1) % (READ_EVERY * SETTINGS.len() as u16);
        if self.frames.is_multiple_of(READ_EVERY) {
            Command::Read((self.frames / READ_EVERY) as u8)
        } else {
            Command::Null
        }
    }
}

/// Bytes of a word of the frame, and where its last word, the CRC, begins.
const WORD: usize = 3;
const CRC_AT: usize = FRAME - WORD;

/// Four bytes of a frame from `byte` on, the first in the highest bits; zeros behind its end.
#[inline(always)]
fn four(words: &[u32; WORDS], byte: usize) -> u32 {
    let word = |k: usize| words.get(k).copied().unwrap_or(0);
    let (k, bits) = (byte / 4, 8 * (byte % 4) as u32);
    if bits == 0 {
        word(k)
    } else {
        word(k) << bits | word(k + 1) >> (32 - bits)
    }
}

/// The codes of all channels: sign-extended from 24 bits.
#[inline(always)]
fn codes(words: &[u32; WORDS]) -> [i32; ALL_CHANNELS] {
    core::array::from_fn(|channel| four(words, WORD * (channel + 1)) as i32 >> 8)
}

/// One step of the checksum, CRC-16 of CCITT's polynomial P = x^16 + x^12 + x^5 + 1, over 32 bits: `sum` x^32 + `word`, times x^16, modulo P.
///
/// P goes into it `q` times: the dividend by P, a product of the dividend and 1 / (1 + u) with u = x^-4 + x^-11 + x^-16; of that series, which
/// is (1 + u)(1 + u^2)(1 + u^4) as far as 32 bits go, each power is a shift. No table: one in flash costs the unit wait states, byte
/// by byte.
#[inline(always)]
const fn crc_step(sum: u32, word: u32) -> u32 {
    let dividend = sum << 16 ^ word;
    let q = dividend ^ dividend >> 4 ^ dividend >> 11 ^ dividend >> 16;
    let q = q ^ q >> 8 ^ q >> 22;
    let q = q ^ q >> 16;
    (q ^ q << 5 ^ q << 12) & 0xFFFF
}

/// The first word of a frame (an answer) whose checksum, over all words before its last, is right.
#[inline]
fn checked(words: &[u32; WORDS]) -> Result<u16, Fault> {
    // Its 27 bytes behind one of zeros, which has no effect; the seed of the checksum, 0xFFFF, inverts the first two.
    let mut sum = crc_step(0, words[0] >> 8 ^ 0x00FF_FF00);
    let mut byte = 3;
    while byte < CRC_AT {
        sum = crc_step(sum, four(words, byte));
        byte += 4;
    }
    if sum == four(words, CRC_AT) >> 16 {
        Ok((words[0] >> 16) as u16)
    } else {
        Err(Fault::Crc)
    }
}

/// The first word of a frame (an answer), and the codes of all channels.
///
/// # Errors
/// [`Fault::Crc`].
pub fn decode(frame: &[u32; WORDS]) -> Result<(u16, [i32; ALL_CHANNELS]), Fault> {
    let words = frame.map(u32::swap_bytes);
    checked(&words).map(|answer| (answer, codes(&words)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// The same by the crate that others use.
    const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

    fn words(bytes: &[u8; FRAME]) -> [u32; WORDS] {
        core::array::from_fn(|k| {
            let byte = |n: usize| bytes.get(4 * k + n).copied().unwrap_or(0xA5);
            u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)])
        })
    }

    fn frame(status: u16, codes: [i32; 8]) -> [u8; FRAME] {
        let mut f = [0; FRAME];
        f[..2].copy_from_slice(&status.to_be_bytes());
        for (k, c) in codes.iter().enumerate() {
            f[3 * (k + 1)..3 * (k + 2)].copy_from_slice(&c.to_be_bytes()[1..]);
        }
        let crc = CRC.checksum(&f[..CRC_AT]);
        f[CRC_AT..CRC_AT + 2].copy_from_slice(&crc.to_be_bytes());
        f
    }

    #[test]
    fn codes_keep_their_sign_and_flipped_bits_are_noticed() {
        let f = frame(0x0100, [1, -1, 8_388_607, -8_388_608, 42, 0, -7, 12]);
        assert_eq!(decode(&words(&f)), Ok((0x0100, [1, -1, 8_388_607, -8_388_608, 42, 0, -7, 12])));
        for bit in 0..29 * 8 {
            let mut g = f;
            g[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(decode(&words(&g)), Err(Fault::Crc), "bit {bit}");
        }
    }

    #[test]
    fn any_codes_come_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..2000 {
            let codes = core::array::from_fn(|_| rng.random_range(-8_388_608..=8_388_607));
            let (_, seen) = decode(&words(&frame(0x0100, codes))).expect("valid");
            assert_eq!(seen, codes);
        }
    }

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        // The check value of the catalogue of CRCs.
        assert_eq!(CRC.checksum(b"123456789"), 0x29B1);
    }

    /// An ADC that does what the data sheet says: registers, and the answer to the command of the frame before.
    struct Adc {
        registers: [u16; 64],
        /// The registers as its checksum was last made of them.
        summed: [u16; 64],
        answer: u16,
        codes: [i32; 8],
        noise: i32,
        invalid: bool,
    }

    impl Adc {
        fn new() -> Self {
            let mut registers = [0; 64];
            (registers[1], registers[2], registers[3], registers[6]) = (0x0500, 0x0510, 0xFF0E, 0x0600);
            Self { registers, summed: registers, answer: 0xFF28, codes: [5; 8], noise: 0, invalid: false }
        }

        fn exchange(&mut self, [command, value]: [u16; 2]) -> [u32; WORDS] {
            self.noise ^= 1;
            let at = |k: usize| match self.registers[9 + 5 * k] & 3 {
                0 => self.codes[k],
                place => [7, 1_118_481, -1_118_481][usize::from(place) - 1] + self.noise,
            };
            let mut out = frame(self.answer, core::array::from_fn(at));
            let address = usize::from(command >> 7 & 63);
            if self.registers[2] & 1 << 13 != 0 && self.registers[2..] != self.summed[2..] {
                self.registers[1] |= STATUS_MAP;
            }
            self.summed = self.registers;
            self.answer = match command >> 13 {
                0b011 => {
                    self.registers[address] = value;
                    if address == 2 {
                        self.registers[1] = self.registers[1] & !STATUS_RESET | value & STATUS_RESET;
                    }
                    0x4000 | command & 0x1FFF
                }
                0b101 => self.registers[address],
                _ => {
                    let status = self.registers[1];
                    self.registers[1] &= !STATUS_MAP;
                    status
                }
            };
            if self.invalid {
                out[7] ^= 1;
            }
            words(&out)
        }
    }

    /// `n` frames: what came of the last.
    fn talk(d: &mut Dialogue, adc: &mut Adc, command: &mut [u16; 2], n: usize) -> Received {
        let mut receive = None;
        for _ in 0..n {
            let h = d.receive(&adc.exchange(*command), false);
            *command = h.command;
            receive = Some(h);
        }
        receive.expect("at least one frame")
    }

    /// An ADC that was set up.
    fn ready() -> (Dialogue, Adc, [u16; 2]) {
        let (mut d, mut adc, mut command) = (Dialogue::default(), Adc::new(), [0; 2]);
        talk(&mut d, &mut adc, &mut command, 2 * usize::from(SET_UP));
        (d, adc, command)
    }

    const GOOD: Option<Result<&[i32; CHANNELS], Fault>> = Some(Ok(&[5; CHANNELS]));

    #[test]
    fn settings_are_written_and_read_back_before_the_first_sample() {
        let (mut d, mut adc, mut command) = (Dialogue::default(), Adc::new(), [0; 2]);
        for k in 0..=usize::from(SET_UP) {
            let h = talk(&mut d, &mut adc, &mut command, 1);
            assert!(matches!(h.sample(), Some(Err(_))), "frame {k}: {h:?}");
        }
        for (address, value) in SETTINGS {
            assert_eq!(adc.registers[usize::from(address)], value);
        }
        talk(&mut d, &mut adc, &mut command, 1);
        for k in 0..3 * usize::from(READ_EVERY) * SETTINGS.len() {
            let h = talk(&mut d, &mut adc, &mut command, 1);
            assert_eq!((h.sample(), h.next), (GOOD, Next::Wait), "sample {k}");
        }
    }

    #[test]
    fn a_setting_that_changes_is_noticed_and_written_again() {
        // With the ADC's own watch, and without.
        for (k, (watched, (address, value))) in
            [true, false].into_iter().flat_map(|w| SETTINGS.map(|s| (w, s))).enumerate()
        {
            let (mut d, mut adc, mut command) = ready();
            adc.registers[usize::from(address)] = value ^ 4;
            let mut within = 3;
            if !watched {
                adc.summed = adc.registers;
                within += usize::from(READ_EVERY) * SETTINGS.len();
            }
            let noticed =
                (0..within).any(|_| talk(&mut d, &mut adc, &mut command, 1).sample() == Some(Err(Fault::Setting)));
            assert!(noticed, "setting {k}");
            assert_eq!(talk(&mut d, &mut adc, &mut command, 2 * usize::from(SET_UP)).sample(), GOOD);
            assert_eq!(adc.registers[usize::from(address)], value);
        }
    }

    #[test]
    fn a_test_goes_through_the_places_and_ends_with_a_set_up() {
        let (mut d, mut adc, mut command) = ready();
        d.test();
        let mut levels = None;
        let mut frames = 0;
        while levels.is_none() {
            let h = d.receive(&adc.exchange(command), false);
            assert!(h.sample().is_some_and(|s| s.is_err()), "frame {frames}");
            (command, levels, frames) = (h.command, d.tested(), frames + 1);
        }
        let levels = levels.expect("there");
        assert_eq!(levels.means[0], [7.5; 8]);
        assert_eq!([levels.means[1][3], levels.means[2][7]], [1_118_481.5, -1_118_480.5]);
        assert!(levels.noise.iter().all(|n| (n - 0.5f32.sqrt()).abs() < 1e-6) && levels.pins == [0.0; 8]);
        assert!((800..1000).contains(&frames), "{frames} frames");
        talk(&mut d, &mut adc, &mut command, usize::from(SET_UP) + 3);
        assert_eq!(talk(&mut d, &mut adc, &mut command, 1).sample(), GOOD);
        // A reset within it ends it without figures.
        d.test();
        talk(&mut d, &mut adc, &mut command, 50);
        adc = Adc::new();
        talk(&mut d, &mut adc, &mut command, 3 * usize::from(SET_UP));
        assert!(d.tested().is_none());
        assert_eq!(talk(&mut d, &mut adc, &mut command, 1).sample(), GOOD);
    }

    #[test]
    fn a_reset_adc_is_set_up_again() {
        let (mut d, mut adc, mut command) = ready();
        let refused = (0..3 * u32::from(SET_UP))
            .map(|k| {
                if k == 5 {
                    adc = Adc::new();
                }
                talk(&mut d, &mut adc, &mut command, 1)
            })
            .filter(|received| received.sample() != GOOD)
            .count();
        assert!((usize::from(SET_UP)..usize::from(SET_UP) + 4).contains(&refused), "{refused}");
        assert_eq!(adc.registers[3], SETTINGS[0].1);
    }

    #[test]
    fn after_a_sample_that_was_not_fetched_the_store_of_the_adc_is_emptied() {
        let (mut d, mut adc, mut command) = ready();
        let h = d.receive(&adc.exchange(command), true);
        assert_eq!((h.sample(), h.next), (Some(Err(Fault::Gap)), Next::FetchAgain));
        let h = d.receive(&adc.exchange(h.command), false);
        assert_eq!((h.sample(), h.next), (None, Next::Wait));
        command = h.command;
        assert_eq!(talk(&mut d, &mut adc, &mut command, 1).sample(), GOOD);
    }

    #[test]
    fn frames_out_of_step_have_bus_and_adc_reset() {
        let (mut d, mut adc, mut command) = ready();
        adc.invalid = true;
        for k in 1..=BAD_IN_A_ROW {
            let h = talk(&mut d, &mut adc, &mut command, 1);
            assert_eq!(h.sample(), Some(Err(Fault::Crc)));
            assert_eq!(h.next, if k == BAD_IN_A_ROW { Next::Reset } else { Next::Wait });
        }
        adc = Adc::new();
        assert_eq!(talk(&mut d, &mut adc, &mut command, usize::from(SET_UP) + 3).sample(), GOOD);
    }

    #[test]
    fn valid_frames_that_no_longer_change_have_bus_and_adc_reset() {
        let (mut d, mut adc, mut command) = ready();
        let old = adc.exchange(command);
        // (Until the first setting is read back they pass for samples.)
        let within = usize::from(READ_EVERY + WITHOUT_SAMPLE);
        let frames = (0..=within).position(|_| d.receive(&old, false).next == Next::Reset);
        assert!(frames.is_some(), "no reset in {within} frames");
        // The bus works again.
        command = [0; 2];
        adc = Adc::new();
        assert_eq!(talk(&mut d, &mut adc, &mut command, usize::from(SET_UP) + 3).sample(), GOOD);
    }

    /// Memory has changed: a test that never ends.
    #[test]
    fn frames_that_give_no_sample_for_long_have_bus_and_adc_reset() {
        let (mut d, mut adc, mut command) = ready();
        for k in 1..=WITHOUT_SAMPLE {
            d.course = Some(Course::default());
            let next = talk(&mut d, &mut adc, &mut command, 1).next;
            assert_eq!(next == Next::Reset, k == WITHOUT_SAMPLE, "frame {k}");
        }
        adc = Adc::new();
        command = [0; 2];
        assert_eq!(talk(&mut d, &mut adc, &mut command, usize::from(SET_UP) + 3).sample(), GOOD);
    }
}
