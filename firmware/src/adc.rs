//! ADS131M08: eight simultaneous 24-bit channels over SPI1. Channels 0 to 2 are the rates of the three gyros,
//! 3 and 4 the accelerometers along axes 1 and 2.
//!
//! # Design
//! The data-ready edge is stamped by TIM2 and raises EXTI 7, whose handler starts a DMA transfer of one frame of
//! ten 24-bit words: status, eight channels, CRC. The DMA's end wakes the rate task ([`crate::rate`]). The frame
//! sent meanwhile is the NULL command. A frame whose CRC (CCITT, seed 0xFFFF) is wrong is refused.
//!
//! # Tradeoffs
//! embassy's SPI sets the bus and both DMA streams up for each transfer, about 60 register accesses and two
//! wakes; at 1 kHz that is most of the processor's work. Here all is set up once and a transfer takes eight
//! writes. The crate `ads131m08` is blocking and leaves the CRC to its caller, so the two register writes of
//! start-up are done here too. Buffers are atomics, because the DMA writes them.
//! Register numbers and bits: ADS131M08 data sheet SBAS950 section 8.6; RM0390 for SPI, DMA and EXTI.

use crate::board::wired;
use crate::params;
use core::sync::atomic::{fence, AtomicU32, Ordering};
use embassy_stm32::gpio::{Flex, Input, Output};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use embassy_stm32::pac::spi::vals::{Br, Cpha, Mstr};
use embassy_stm32::peripherals::{DMA2_CH0, DMA2_CH3, EXTI7, SPI1};
use embassy_stm32::{rcc, Peri};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use hrg_core::adc::{decode, Fault, FRAME, WORDS};
use hrg_core::rate_path::CHANNELS;

/// WREG of CLOCK (0x03): all channels on, oversampling 4096 (1 kSPS at 8.192 MHz), high resolution.
const WRITE_CLOCK: [u16; 2] = [0x6000 | 0x03 << 7, 0xFF00 | 0b101 << 2 | 0b10];
/// WREG of MODE (0x02): 24-bit words, time-out on; clears the RESET flag.
const WRITE_MODE: [u16; 2] = [0x6000 | 0x02 << 7, 0x0110];
/// Transfer complete, half and error of a stream, as they stand from its first bit in LISR and LIFCR (RM0390 section 9.5).
const STREAM_FLAGS: u32 = 0b11_1000;

/// A frame has come: the timer's tick at its data-ready edge.
static FETCHED: Signal<CriticalSectionRawMutex, u32> = Signal::new();
static RECEIVED: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
static SENT: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// What the ADC is wired to, its pins set up.
#[allow(dead_code)] // Held, so that nobody else takes them.
pub struct Wiring {
    /// The bus.
    pub spi: Peri<'static, SPI1>,
    /// Clock, to the ADC, from the ADC.
    pub bus: [Flex<'static>; 3],
    /// Chip select, high.
    pub select: Output<'static>,
    /// Data-ready.
    pub ready: Input<'static>,
    /// Its interrupt line.
    pub ready_line: Peri<'static, EXTI7>,
    /// Receiving stream.
    pub rx: Peri<'static, DMA2_CH0>,
    /// Sending stream.
    pub tx: Peri<'static, DMA2_CH3>,
}

/// The ADC on its bus.
pub struct Adc {
    settings_sent: u8,
    _wiring: Wiring,
}

/// The address of a buffer, for the DMA.
fn address(buffer: &'static [AtomicU32; WORDS]) -> u32 {
    core::ptr::from_ref(buffer) as u32
}

fn start_transfer() {
    wired::SELECT.0.bsrr().write(|w| w.set_br(wired::SELECT.1, true));
    // Receiver first: it must be ready for the first byte.
    for stream in [wired::RX, wired::TX] {
        let st = pac::DMA2.st(stream);
        st.ndtr().write(|w| w.set_ndt(FRAME as u16));
        st.cr().modify(|w| w.set_en(true));
    }
}

/// Data-ready (its EXTI line): fetches the frame.
pub fn data_ready() {
    pac::EXTI.pr(0).write(|w| w.set_line(wired::READY_LINE, true));
    // A transfer that is still running (set-up writes) is left alone; this sample is skipped.
    if !pac::DMA2.st(wired::RX).cr().read().en() {
        start_transfer();
    }
}

/// The end of a transfer (the receiving stream's interrupt): hands the frame to the rate task.
pub fn transferred() {
    if !pac::DMA2.isr(0).read().tcif(wired::RX) {
        return;
    }
    wired::SELECT.0.bsrr().write(|w| w.set_bs(wired::SELECT.1, true));
    let flags = wired::STREAM_BITS.iter().fold(0, |flags, bit| flags | STREAM_FLAGS << bit);
    pac::DMA2.ifcr(0).write_value(pac::dma::regs::Ixr(flags));
    FETCHED.signal(pac::TIM2.ccr(3).read());
}

impl Adc {
    /// Sets up the bus and the streams; the ADC itself is set up by [`sample`](Self::sample).
    pub fn new(wiring: Wiring) -> Self {
        rcc::enable_and_reset::<SPI1>();
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
            w.set_br(Br::from_bits(params::ADC_SPI_PRESCALER));
            w.set_spe(true);
        });
        for (stream, dir, buffer) in
            [(wired::RX, Dir::PERIPHERAL_TO_MEMORY, &RECEIVED), (wired::TX, Dir::MEMORY_TO_PERIPHERAL, &SENT)]
        {
            let st = pac::DMA2.st(stream);
            st.par().write_value(spi.dr().as_ptr() as u32);
            st.m0ar().write_value(address(buffer));
            st.cr().write(|w| {
                w.set_chsel(wired::DMA_CHANNEL);
                w.set_dir(dir);
                w.set_minc(true);
                w.set_pl(Pl::VERY_HIGH);
                w.set_tcie(stream == wired::RX);
            });
        }
        let line = wired::READY_LINE;
        pac::SYSCFG.exticr(line / 4).modify(|w| w.set_exti(line % 4, wired::READY_PORT));
        pac::EXTI.ftsr(0).modify(|w| w.set_line(line, true));
        pac::EXTI.imr(0).modify(|w| w.set_line(line, true));
        Self { settings_sent: 0, _wiring: wiring }
    }

    /// Fetches from the next data-ready edge on: when somebody is there to take the frames.
    pub fn start(&mut self) {
        pac::EXTI.pr(0).write(|w| w.set_line(wired::READY_LINE, true));
        wired::enable_interrupts();
    }

    /// The next sample: the timer's tick at its data-ready edge, and the codes of channels 0 to 4 (three rates, two
    /// accelerometers) or what is wrong with the frame. After a reset the ADC is set up again meanwhile.
    pub async fn sample(&mut self) -> (u32, Result<[i32; CHANNELS], Fault>) {
        let tick = FETCHED.wait().await;
        fence(Ordering::SeqCst);
        let word = |k: usize| RECEIVED[k].load(Ordering::Relaxed);
        let codes = decode(&[word(0), word(1), word(2), word(3), word(4), word(5), word(6), word(7)]);
        match codes {
            Ok(_) => self.set_up_done(),
            Err(Fault::Reset) => self.set_up(),
            Err(_) => {}
        }
        (tick, codes)
    }

    /// Has the next frame carry a setting: for each frame that reports a reset, until none does.
    fn set_up(&mut self) {
        self.settings_sent = self.settings_sent.wrapping_add(1);
        let [command, value] = if self.settings_sent % 2 == 1 { WRITE_CLOCK } else { WRITE_MODE };
        let mut frame = [0u8; WORDS * 4];
        frame[..2].copy_from_slice(&command.to_be_bytes());
        frame[3..5].copy_from_slice(&value.to_be_bytes());
        Self::send_next(&frame);
    }

    /// Has the next frame carry the NULL command again.
    fn set_up_done(&mut self) {
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
}
