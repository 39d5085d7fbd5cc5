//! ADS131M08: eight simultaneous 24-bit channels over SPI1. Channels 0 to 2 are the rates of the three gyros,
//! 3 to 5 the accelerometers along axes 1 to 3 (`params::ACCELEROMETERS`).
//!
//! # Design
//! The data-ready edge is stamped by channel 4 of TIM2, whose interrupt starts a DMA transfer of one frame. The DMA's end wakes the rate
//! task ([`crate::rate`]). [`hrg_core::adc`] decides the messages between the two. A second capture before the first was read
//! (CC4OF), or an edge during a transfer, means a sample that was not fetched.
//!
//! SYNC/RESET of the ADC is a pin of the unit: a bus that is out of step, or an ADC that is silent, is reset by it, with SPI and streams.
//!
//! # Tradeoffs
//! embassy's SPI sets the bus and both DMA streams up for each transfer, about 60 register accesses and two
//! wakes; at 1 kHz that is most of the processor's work. Here all is set up once and a transfer takes eight
//! writes. The crate `ads131m08` is blocking and leaves the CRC to its caller. Buffers are atomics, because the DMA writes them.
//! Registers: RM0390 for SPI, DMA and TIM2.

use crate::channels::FETCHED;
#[cfg(feature = "self-test")]
use crate::channels::{ADC_TEST, ADC_TESTED};
use crate::params::{self, TIMER_HZ};
#[cfg(feature = "pps")]
use crate::pps;
use crate::wired;
use core::sync::atomic::{fence, AtomicBool, AtomicU32, Ordering};
use embassy_stm32::gpio::{Flex, Output};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::{Dir, Pl};
use embassy_stm32::pac::spi::vals::{Br, Cpha, Mstr};
use embassy_stm32::peripherals::{DMA2_CH0, DMA2_CH3, SPI1};
use embassy_stm32::{rcc, Peri};
use hrg_core::adc::{Dialogue, Next, Received, FRAME, WORDS};

/// All flags of a stream (transfer complete, half, error, direct mode error, FIFO error), as they stand from its first bit in LISR and LIFCR
/// (RM0390 section 9.5).
const STREAM_FLAGS: u32 = 0b11_1101;

/// The next sample ends a frame.
static ENDS: AtomicBool = AtomicBool::new(false);
/// A sample was ready and was not fetched.
static MISSED: AtomicBool = AtomicBool::new(false);
static RECEIVED: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
static SENT: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// Bus, pins and streams of the ADC, the pins set up.
#[allow(dead_code)] // Held, so that nobody else takes them.
pub struct Wiring {
    /// The bus.
    pub spi: Peri<'static, SPI1>,
    /// Clock, to the ADC, from the ADC.
    pub bus: [Flex<'static>; 3],
    /// Chip select, high.
    pub select: Output<'static>,
    /// SYNC/RESET of the ADC, high.
    pub reset: Output<'static>,
    /// Sample mark, low ([`pps::mark`]).
    #[cfg(feature = "pps")]
    pub mark: pps::MarkPin,
    /// Receiving stream.
    pub rx: Peri<'static, DMA2_CH0>,
    /// Sending stream.
    pub tx: Peri<'static, DMA2_CH3>,
}

/// The ADC on its bus.
pub struct Adc {
    dialogue: Dialogue,
    wiring: Wiring,
    /// Looks at the time since the last frame.
    quiet_looks: u8,
    /// Since when the ADC is held in reset, as the timer counts.
    reset_since: u32,
}

/// A reset of the ADC ends at the first look after this, ticks of the timer: 2 ms. Less than 2048 of the ADC's clocks (1 ms) are only a SYNC (data
/// sheet section 8.4.1).
const RESET_TICKS: u32 = TIMER_HZ / 500;

/// Looks at the time (one each 10 ms) without a frame after which the ADC is reset.
const QUIET_LOOKS: u8 = 20;

/// The address of a buffer, for the DMA.
fn address(buffer: &'static [AtomicU32; WORDS]) -> u32 {
    core::ptr::from_ref(buffer) as u32
}

#[inline(always)]
fn start_transfer() {
    wired::SELECT.0.bsrr().write(|w| w.set_br(wired::SELECT.1, true));
    // Receiver first: it must be ready for the first byte.
    for stream in [wired::RX, wired::TX] {
        let st = pac::DMA2.st(stream);
        st.ndtr().write(|w| w.set_ndt(FRAME as u16));
        st.cr().modify(|w| w.set_en(true));
    }
}

/// Data-ready (the interrupt of TIM2, channel 4): fetches the frame.
pub fn data_ready() {
    #[cfg(feature = "pps")]
    pps::mark(ENDS.load(Ordering::Relaxed));
    let timer = pac::TIM2;
    if timer.sr().read().ccof(3) {
        timer.sr().write(|w| {
            w.0 = u32::MAX;
            w.set_ccof(3, false);
        });
        MISSED.store(true, Ordering::Relaxed);
    }
    // (Reading it clears the interrupt's flag.)
    let _ = timer.ccr(3).read();
    // A transfer that is still running is left alone; so is one that has ended and was not handed over yet (after a time in which the
    // processor stood still, both interrupts wait, and this one comes first).
    if pac::DMA2.st(wired::RX).cr().read().en() || pac::DMA2.isr(0).read().tcif(wired::RX) {
        MISSED.store(true, Ordering::Relaxed);
    } else {
        start_transfer();
    }
}

/// Records whether the next sample ends a frame: that sample is marked at a pin ([`pps::mark`]).
pub fn mark_next(ends: bool) {
    ENDS.store(ends, Ordering::Relaxed);
}

/// The end of a transfer (the receiving stream's interrupt): hands the frame to the rate task.
pub fn transferred() {
    if !pac::DMA2.isr(0).read().tcif(wired::RX) {
        return;
    }
    wired::SELECT.0.bsrr().write(|w| w.set_bs(wired::SELECT.1, true));
    let flags = wired::STREAM_BITS.iter().fold(0, |flags, bit| flags | STREAM_FLAGS << bit);
    pac::DMA2.ifcr(0).write_value(pac::dma::regs::Ixr(flags));
    FETCHED.tell(pac::TIM2.ccr(3).read());
}

/// Fetches from the next data-ready edge on: when somebody is there to take the frames.
pub fn start() {
    wired::enable_interrupts();
}

impl Adc {
    /// Sets up the bus and the streams; the ADC itself is set up by what [`receive`](Self::receive) answers.
    pub fn new(wiring: Wiring) -> Self {
        set_up_bus();
        Self { dialogue: Dialogue::default(), wiring, quiet_looks: 0, reset_since: 0 }
    }

    /// The frame that has come ([`FETCHED`]): channels 0 to 5 are three rates and three accelerometers; where channels 5 to 7 are temperature
    /// sensors or inputs, there are two.
    pub fn receive(&mut self) -> Received {
        fence(Ordering::SeqCst);
        self.quiet_looks = 0;
        let word = |k: usize| RECEIVED[k].load(Ordering::Relaxed);
        let frame = [word(0), word(1), word(2), word(3), word(4), word(5), word(6), word(7)];
        let received = hrg_fast::receive(&mut self.dialogue, &frame, MISSED.swap(false, Ordering::Relaxed));
        send_next(received.command);
        match received.next {
            Next::Wait => {}
            Next::FetchAgain => {
                if !pac::DMA2.st(wired::RX).cr().read().en() {
                    start_transfer();
                }
            }
            Next::Reset => self.reset(),
        }
        received
    }

    /// Begins the built-in test where it is asked for, and hands on what came of it.
    #[cfg(feature = "self-test")]
    pub fn test(&mut self) {
        if ADC_TEST.try_take().is_some() {
            self.dialogue.test();
        }
        if let Some(levels) = self.dialogue.tested() {
            ADC_TESTED.signal(levels);
        }
    }

    /// Time has gone on by 10 ms: ends a reset of the ADC; begins one where it has been silent for long.
    pub fn look(&mut self) {
        if pac::TIM2.cnt().read().wrapping_sub(self.reset_since) >= RESET_TICKS {
            self.wiring.reset.set_high();
        }
        self.quiet_looks += 1;
        if self.quiet_looks >= QUIET_LOOKS {
            self.reset();
        }
    }

    /// Resets the ADC by its pin, until the first look after [`RESET_TICKS`], and the bus.
    fn reset(&mut self) {
        self.quiet_looks = 0;
        self.reset_since = pac::TIM2.cnt().read();
        self.wiring.reset.set_low();
        for stream in [wired::RX, wired::TX] {
            let cr = pac::DMA2.st(stream).cr();
            cr.modify(|w| w.set_en(false));
            // It ends the byte that it moves.
            while cr.read().en() {}
        }
        wired::SELECT.0.bsrr().write(|w| w.set_bs(wired::SELECT.1, true));
        set_up_bus();
        self.dialogue = Dialogue::default();
        send_next([0; 2]);
    }
}

/// SPI and streams as at power-on, and set up.
fn set_up_bus() {
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
    let flags = wired::STREAM_BITS.iter().fold(0, |flags, bit| flags | STREAM_FLAGS << bit);
    pac::DMA2.ifcr(0).write_value(pac::dma::regs::Ixr(flags));
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
}

/// Has the next frame carry a command: two words of 16 bits, each at the start of one of 24.
fn send_next([first, second]: [u16; 2]) {
    let ([a, b], [c, d]) = (first.to_be_bytes(), second.to_be_bytes());
    SENT[0].store(u32::from_le_bytes([a, b, 0, c]), Ordering::Relaxed);
    SENT[1].store(u32::from_le_bytes([d, 0, 0, 0]), Ordering::Relaxed);
    fence(Ordering::SeqCst);
}
