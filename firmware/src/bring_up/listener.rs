//! The other end of the link: UART5, its receiver by a DMA ring that is looked at (its interrupt is the rate task's executor).

use super::{give, pin};
use crate::params;
use core::sync::atomic::{fence, AtomicU32, Ordering};
use embassy_stm32::gpio::{AfType, OutputType, Pull, Speed};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::peripherals::UART5;
use embassy_stm32::rcc;
use hrg_core::link::{Deframer, Housekeeping, Message};
use hrg_core::AXES;

/// Streams of DMA1 that receive and send (RM0390 table 28), and the channel of UART5 on both.
const RX: usize = 0;
const TX: usize = 7;
const DMA_CHANNEL: u8 = 4;
/// All flags of stream 7 in HIFCR.
const TX_FLAGS: u32 = 0x3D << 22;
/// Clock of UART5: APB1, Hz.
const PCLK1_HZ: u32 = params::TIMER_HZ / 2;

/// Words of the ring: some 100 ms of the link at 200 frames a second.
const WORDS: usize = 256;
const BYTES: usize = 4 * WORDS;
static RING: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
/// Bytes of the command to send.
const LONGEST: usize = 4;
static SENT: [AtomicU32; LONGEST] = [const { AtomicU32::new(0) }; LONGEST];

/// Messages received since the counts were last cleared.
#[derive(Default)]
pub struct Counts {
    /// Rate frames, and the sums of their rates.
    pub rates: u32,
    pub sums: [f64; AXES],
    /// Housekeeping: how many, their samples and errors of the ADC, edges missing or rejected.
    pub seconds: u32,
    pub samples: u32,
    pub adc_errors: u32,
    pub edges_lost: u32,
    /// Pulses per second: how often another one was told.
    pub pulses: u32,
    /// Flags of the unit, in any frame.
    pub flags: u16,
    /// The last housekeeping.
    pub last: Option<Housekeeping>,
    /// Answers to [`Message::Identify`].
    pub identities: u32,
    /// Frames that are not valid.
    pub bad: u32,
}

/// See the module.
pub struct Listener {
    deframer: Deframer,
    at: usize,
    pulse: u32,
    /// Messages that it has received.
    pub counts: Counts,
}

/// Sets UART5 up.
pub fn start() -> Listener {
    give(pin!(PD2), 8, AfType::input(Pull::Up));
    give(pin!(PC12), 8, AfType::output(OutputType::PushPull, Speed::Medium));
    rcc::enable_and_reset::<UART5>();
    let uart = pac::UART5;
    uart.brr().write(|w| w.set_brr(((PCLK1_HZ + params::LINK_BAUD / 2) / params::LINK_BAUD) as u16));
    uart.cr3().write(|w| {
        w.set_dmar(true);
        w.set_dmat(true);
    });
    for (stream, dir, buffer) in
        [(RX, Dir::PERIPHERAL_TO_MEMORY, RING.as_ptr()), (TX, Dir::MEMORY_TO_PERIPHERAL, SENT.as_ptr())]
    {
        let st = pac::DMA1.st(stream);
        st.par().write_value(uart.dr().as_ptr() as u32);
        st.m0ar().write_value(buffer as u32);
        st.cr().write(|w| {
            w.set_chsel(DMA_CHANNEL);
            w.set_dir(dir);
            w.set_minc(true);
            w.set_circ(stream == RX);
        });
    }
    pac::DMA1.st(RX).ndtr().write(|w| w.set_ndt(BYTES as u16));
    pac::DMA1.st(RX).cr().modify(|w| w.set_en(true));
    uart.cr1().write(|w| {
        w.set_ue(true);
        w.set_te(true);
        w.set_re(true);
    });
    Listener { deframer: Deframer::default(), at: 0, pulse: 0, counts: Counts::default() }
}

impl Listener {
    /// Takes what has come.
    pub fn take(&mut self) {
        let to = (BYTES - usize::from(pac::DMA1.st(RX).ndtr().read().ndt())) % BYTES;
        fence(Ordering::SeqCst);
        while self.at != to {
            let word = RING[self.at / 4 % WORDS].load(Ordering::Relaxed);
            let byte = word.to_le_bytes()[self.at % 4];
            self.at = (self.at + 1) % BYTES;
            match self.deframer.push(byte) {
                None => {}
                Some(Ok(message)) => self.message(&message),
                Some(Err(_)) => self.counts.bad += 1,
            }
        }
    }

    fn message(&mut self, message: &Message) {
        let counts = &mut self.counts;
        match message {
            Message::Rate(frame) => {
                counts.rates += 1;
                counts.flags |= frame.unit_status.bits();
                counts.sums.iter_mut().zip(frame.rate_dph).for_each(|(sum, rate)| *sum += f64::from(rate));
            }
            Message::Housekeeping(h) => {
                counts.seconds += 1;
                counts.flags |= h.unit_status.bits();
                counts.samples += u32::from(h.samples);
                counts.adc_errors += u32::from(h.adc_errors);
                let lost = h.missing.iter().chain(&h.rejected);
                counts.edges_lost += lost.map(|n| u32::from(*n)).sum::<u32>();
                if h.pps_age_ms != u32::MAX && h.pps_tick != self.pulse {
                    self.pulse = h.pps_tick;
                    counts.pulses += 1;
                }
                counts.last = Some(*h);
            }
            Message::Identity(_) => counts.identities += 1,
            _ => {}
        }
    }

    /// Asks the unit who it is.
    pub fn ask(&mut self) {
        let frame = Message::Identify.encode();
        // (8 bytes: type, checksum, COBS and zero.)
        for (to, bytes) in SENT.iter().zip(frame.chunks(4)) {
            let byte = |k: usize| bytes.get(k).copied().unwrap_or(0);
            to.store(u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]), Ordering::Relaxed);
        }
        fence(Ordering::SeqCst);
        let st = pac::DMA1.st(TX);
        pac::DMA1.ifcr(1).write_value(pac::dma::regs::Ixr(TX_FLAGS));
        st.ndtr().write(|w| w.set_ndt(frame.len().min(4 * LONGEST) as u16));
        st.cr().modify(|w| w.set_en(true));
    }
}
