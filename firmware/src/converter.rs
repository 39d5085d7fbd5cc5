//! ADS131M08: eight simultaneous 24-bit channels over SPI1. Channels 0 to 2 are the rates of the three gyros,
//! 3 and 4 the accelerometers along axes 1 and 2.
//!
//! # Design
//! The data-ready edge is stamped by TIM2 and raises EXTI 7, whose handler starts a DMA transfer of one frame of
//! ten 24-bit words: status, eight channels, CRC. The DMA's end is the rate path's interrupt ([`crate::rate`]). The frame
//! sent meanwhile is the NULL command. A frame whose CRC (CCITT, seed 0xFFFF) is wrong is refused.
//!
//! # Tradeoffs
//! embassy's SPI sets the bus and both DMA streams up for each transfer, about 60 register accesses and two
//! wakes; at 1 kHz that was most of the processor's work. Here all is set up once and a transfer takes eight
//! writes. The crate `ads131m08` is blocking and leaves the CRC to its caller, so the two register writes of
//! start-up are done here too. Buffers are atomics, because the DMA writes them.
//! Register numbers and bits: ADS131M08 data sheet SBAS950 section 8.6; RM0390 for SPI, DMA and EXTI.

use crate::params;
use core::sync::atomic::{fence, AtomicU32, Ordering};
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::InterruptExt;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use embassy_stm32::pac::spi::vals::{Br, Cpha, Mstr};
use embassy_stm32::peripherals::{DMA2_CH0, DMA2_CH3, EXTI7, PA5, PA6, PA7, PB6, PC7, SPI1};
use embassy_stm32::{rcc, Peri};
use hrg_core::converter::{decode, Fault, FRAME, WORDS};
use hrg_core::rate_path::CHANNELS;

/// WREG of CLOCK (0x03): all channels on, oversampling 4096 (1 kSPS at 8.192 MHz), high resolution.
const WRITE_CLOCK: [u16; 2] = [0x6000 | 0x03 << 7, 0xFF00 | 0b101 << 2 | 0b10];
/// WREG of MODE (0x02): 24-bit words, time-out on; clears the RESET flag.
const WRITE_MODE: [u16; 2] = [0x6000 | 0x02 << 7, 0x0110];
/// DMA2 stream that receives, stream that sends, and the channel of both (RM0390 table 29).
const RX: usize = 0;
const TX: usize = 3;
const DMA_CHANNEL: u8 = 3;
/// Transfer complete, half and error of both streams, as they stand in LISR and LIFCR (RM0390 section 9.5): stream 0 from bit 0,
/// stream 3 from bit 22.
const FLAGS: u32 = 0b11_1000 | 0b11_1000 << 22;
/// Chip select on port B, data-ready on port C.
const SELECT_PIN: usize = 6;
const READY_LINE: usize = 7;

static RECEIVED: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
static SENT: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// What the converter is wired to.
pub struct Wiring {
    /// The bus.
    pub spi: Peri<'static, SPI1>,
    /// Clock.
    pub sck: Peri<'static, PA5>,
    /// From the converter.
    pub miso: Peri<'static, PA6>,
    /// To the converter.
    pub mosi: Peri<'static, PA7>,
    /// Chip select.
    pub select: Peri<'static, PB6>,
    /// Data-ready.
    pub ready: Peri<'static, PC7>,
    /// Its interrupt line.
    pub ready_line: Peri<'static, EXTI7>,
    /// Receiving stream.
    pub rx: Peri<'static, DMA2_CH0>,
    /// Sending stream.
    pub tx: Peri<'static, DMA2_CH3>,
}

/// The converter on its bus.
pub struct Converter {
    settings_sent: u8,
    _pins: (Flex<'static>, Flex<'static>, Flex<'static>, Output<'static>, Input<'static>),
}

/// The address of a buffer, for the DMA.
fn address(buffer: &'static [AtomicU32; WORDS]) -> u32 {
    core::ptr::from_ref(buffer) as u32
}

// (Stream by stream: a loop over them costs as much again.)
fn start_transfer() {
    let (rx, tx) = (pac::DMA2.st(RX), pac::DMA2.st(TX));
    pac::GPIOB.bsrr().write(|w| w.set_br(SELECT_PIN, true));
    rx.ndtr().write(|w| w.set_ndt(FRAME as u16));
    tx.ndtr().write(|w| w.set_ndt(FRAME as u16));
    // Receiver first: it must be ready for the first byte.
    rx.cr().modify(|w| w.set_en(true));
    tx.cr().modify(|w| w.set_en(true));
}

/// Data-ready: fetch the frame.
#[interrupt]
fn EXTI9_5() {
    pac::EXTI.pr(0).write(|w| w.set_line(READY_LINE, true));
    // A transfer that is still running (set-up writes) is left alone; this sample is skipped.
    if !pac::DMA2.st(RX).cr().read().en() {
        start_transfer();
    }
}

impl Converter {
    /// Sets up the bus and the streams; the converter itself by [`set_up`](Self::set_up).
    pub fn new(w: Wiring) -> Self {
        rcc::enable_and_reset::<SPI1>();
        let pin = |p: Flex<'static>, kind| {
            let mut p = p;
            p.set_as_af_unchecked(5, kind);
            p
        };
        let out = AfType::output(OutputType::PushPull, Speed::High);
        let pins = (
            pin(Flex::new(w.sck), out),
            pin(Flex::new(w.miso), AfType::input(Pull::Down)),
            pin(Flex::new(w.mosi), out),
            Output::new(w.select, Level::High, Speed::High),
            Input::new(w.ready, Pull::Up),
        );
        let _ = (w.spi, w.rx, w.tx, w.ready_line);
        let spi = pac::SPI1;
        spi.cr2().write(|w| {
            w.set_rxdmaen(true);
            w.set_txdmaen(true);
        });
        spi.cr1().write(|w| {
            w.set_mstr(Mstr::MASTER);
            w.set_ssm(true);
            w.set_ssi(true);
            // Mode 1: clock idles low, data on its falling edge.
            w.set_cpha(Cpha::SECOND_EDGE);
            w.set_br(Br::from_bits(params::CONVERTER_SPI_DIVIDER));
            w.set_spe(true);
        });
        for (stream, dir, buffer) in
            [(RX, Dir::PERIPHERAL_TO_MEMORY, &RECEIVED), (TX, Dir::MEMORY_TO_PERIPHERAL, &SENT)]
        {
            let st = pac::DMA2.st(stream);
            st.par().write_value(spi.dr().as_ptr() as u32);
            st.m0ar().write_value(address(buffer));
            st.cr().write(|w| {
                w.set_chsel(DMA_CHANNEL);
                w.set_dir(dir);
                w.set_minc(true);
                w.set_pl(Pl::VERY_HIGH);
                w.set_tcie(stream == RX);
            });
        }
        pac::SYSCFG.exticr(READY_LINE / 4).modify(|w| w.set_exti(READY_LINE % 4, 2));
        pac::EXTI.ftsr(0).modify(|w| w.set_line(READY_LINE, true));
        pac::EXTI.imr(0).modify(|w| w.set_line(READY_LINE, true));
        Self { settings_sent: 0, _pins: pins }
    }

    /// Fetches from the next data-ready edge on: when somebody is there to take the frames.
    pub fn start() {
        pac::EXTI.pr(0).write(|w| w.set_line(READY_LINE, true));
        interrupt::DMA2_STREAM0.unpend();
        interrupt::EXTI9_5.unpend();
        // SAFETY: everything that the two handlers touch was set up by `new`.
        #[allow(unsafe_code)]
        unsafe {
            interrupt::DMA2_STREAM0.enable();
            interrupt::EXTI9_5.enable();
        }
    }

    /// Has the next frame carry a setting: call for each frame that reports [`Fault::Reset`], until none does.
    pub fn set_up(&mut self) {
        self.settings_sent = self.settings_sent.wrapping_add(1);
        let [command, value] = if self.settings_sent % 2 == 1 { WRITE_CLOCK } else { WRITE_MODE };
        let mut frame = [0u8; WORDS * 4];
        frame[..2].copy_from_slice(&command.to_be_bytes());
        frame[3..5].copy_from_slice(&value.to_be_bytes());
        Self::send_next(&frame);
    }

    /// Has the next frame carry the NULL command again.
    pub fn set_up_done(&mut self) {
        if self.settings_sent != 0 {
            self.settings_sent = 0;
            Self::send_next(&[0; WORDS * 4]);
        }
    }

    fn send_next(frame: &[u8; WORDS * 4]) {
        for (word, bytes) in SENT.iter().zip(frame.chunks_exact(4)) {
            word.store(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]), Ordering::Relaxed);
        }
        fence(Ordering::SeqCst);
    }

    /// Whether a frame has come since the last call: the timer's reading at its data-ready edge.
    #[inline]
    pub fn fetched() -> Option<u32> {
        if !pac::DMA2.isr(0).read().tcif(RX) {
            return None;
        }
        pac::GPIOB.bsrr().write(|w| w.set_bs(SELECT_PIN, true));
        pac::DMA2.ifcr(0).write_value(pac::dma::regs::Ixr(FLAGS));
        Some(pac::TIM2.ccr(3).read())
    }

    /// The codes of channels 0 to 4 in the frame that has come: three rates, two accelerometers.
    #[inline]
    pub fn codes(&self) -> Result<[i32; CHANNELS], Fault> {
        fence(Ordering::SeqCst);
        let word = |k: usize| RECEIVED[k].load(Ordering::Relaxed);
        decode(&[word(0), word(1), word(2), word(3), word(4), word(5), word(6), word(7)])
    }
}
