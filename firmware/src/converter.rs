//! ADS131M08: eight simultaneous 24-bit channels over SPI. Channels 0 to 2 are the rates of the three gyros.
//!
//! # Design
//! The data-ready edge starts a DMA transfer of one frame of ten 24-bit words: status, eight channels, CRC.
//! The frame sent meanwhile is the NULL command. A frame whose CRC (CCITT, seed 0xFFFF) is wrong is refused.
//!
//! # Tradeoffs
//! The crate `ads131m08` is blocking and leaves the CRC to its caller; here the frame must come by DMA while
//! the processor sleeps, so the few register writes of start-up are done here too. Register numbers and bits:
//! ADS131M08 data sheet SBAS950, section 8.6.

use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::Output;
use embassy_stm32::mode::Async;
use embassy_stm32::spi::{mode::Master, Spi};

/// Bytes of a frame: ten words of 24 bits.
const FRAME: usize = 30;
/// Where the CRC stands in it.
const CRC_AT: usize = 27;
/// WREG of CLOCK (0x03): all channels on, oversampling 4096 (1 kSPS at 8.192 MHz), high resolution.
const WRITE_CLOCK: [u16; 2] = [0x6000 | 0x03 << 7, 0xFF00 | 0b101 << 2 | 0b10];
/// WREG of MODE (0x02): 24-bit words, time-out on; clears the RESET flag.
const WRITE_MODE: [u16; 2] = [0x6000 | 0x02 << 7, 0x0110];
/// Status bit: the converter has been reset and has lost its settings.
const STATUS_RESET: u16 = 1 << 10;

const CRC: crc::Crc<u16> = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);

/// Why a frame was refused.
#[derive(Clone, Copy, PartialEq, Eq, defmt::Format)]
pub enum Fault {
    /// The bus reported an error.
    Bus,
    /// The checksum is wrong.
    Crc,
    /// The converter has been reset: it is set up anew.
    Reset,
}

/// The converter on its bus.
pub struct Converter {
    spi: Spi<'static, Async, Master>,
    select: Output<'static>,
    /// Falls when a sample is ready.
    pub data_ready: ExtiInput<'static, Async>,
    received: [u8; FRAME],
}

impl Converter {
    /// Takes the bus; `select` must be high.
    pub fn new(spi: Spi<'static, Async, Master>, select: Output<'static>, data_ready: ExtiInput<'static, Async>) -> Self {
        Self { spi, select, data_ready, received: [0; FRAME] }
    }

    /// Writes the settings.
    pub async fn set_up(&mut self) {
        for [command, value] in [WRITE_CLOCK, WRITE_MODE] {
            let mut frame = [0u8; FRAME];
            frame[..2].copy_from_slice(&command.to_be_bytes());
            frame[3..5].copy_from_slice(&value.to_be_bytes());
            let _ = self.transfer(&frame).await;
        }
    }

    async fn transfer(&mut self, frame: &[u8; FRAME]) -> Result<(), Fault> {
        self.select.set_low();
        let result = self.spi.transfer(&mut self.received, frame).await;
        self.select.set_high();
        result.map_err(|_| Fault::Bus)
    }

    /// Fetches the sample that is ready: the codes of channels 0 to 2.
    pub async fn read(&mut self) -> Result<[i32; 3], Fault> {
        self.transfer(&[0; FRAME]).await?;
        let r = &self.received;
        let crc = CRC.checksum(&r[..CRC_AT]);
        if crc.to_be_bytes() != r[CRC_AT..CRC_AT + 2] {
            return Err(Fault::Crc);
        }
        if u16::from_be_bytes([r[0], r[1]]) & STATUS_RESET != 0 {
            return Err(Fault::Reset);
        }
        Ok([code(&r[3..6]), code(&r[6..9]), code(&r[9..12])])
    }
}

/// Sign-extends a big-endian word of 24 bits.
fn code(word: &[u8]) -> i32 {
    i32::from_be_bytes([word[0], word[1], word[2], 0]) >> 8
}
