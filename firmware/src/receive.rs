//! Receiver of the link: bytes into a ring, by DMA, which nothing on the line stops.
//!
//! # Design
//! embassy's `RingBufferedUartRx` stops its stream at a framing or noise error and starts it again without setting it up.
//! The manual does not state where the stream then goes on (RM0390 section 9.3.14 wants address and number written anew),
//! and driver and stream may be apart until the ring has gone round: a unit that has received one disturbed byte would
//! receive none of the next hundreds. Here the stream runs from start to power-off. A byte that is wrong is a frame that is
//! wrong, which the checksum finds; the line's own flags are counted, and nothing else is done about them.
//!
//! A waiting task is woken when the line falls idle, and when the ring is half full or full.

use crate::params;
use crate::stop::once;
use core::future::poll_fn;
use core::sync::atomic::{AtomicU16, Ordering};
use core::task::Poll;
use embassy_futures::select::select;
use embassy_stm32::dma::{self, ReadableRingBuffer, TransferOptions};
use embassy_stm32::gpio::Flex;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::peripherals::DMA2_CH5;
use embassy_stm32::Peri;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use static_cell::ConstStaticCell;

/// DMA request number of USART1's receiver on that stream (RM0390 table 29).
const REQUEST: u8 = 4;

/// The line has fallen idle.
static IDLE: Signal<CriticalSectionRawMutex, ()> = Signal::new();
/// Idle lines whose bytes before had a framing or noise error, or were too fast.
static LINE_FAULTS: AtomicU16 = AtomicU16::new(0);

/// The interrupt of USART1: what sends needs none.
pub fn line_is_idle() {
    let usart = pac::USART1;
    let flags = usart.sr().read();
    // A read of SR, then one of DR, clears the flag, and those of errors (RM0390 section 25.6.1). If a byte waits in DR, that is the DMA's read: two
    // that race for it would lose it.
    if !flags.rxne() {
        let _ = usart.dr().read();
    }
    if flags.fe() || flags.ne() || flags.ore() {
        LINE_FAULTS.store(LINE_FAULTS.load(Ordering::Relaxed).saturating_add(1), Ordering::Relaxed);
    }
    IDLE.signal(());
}

/// Bytes that have come in.
pub struct Receiver {
    ring: ReadableRingBuffer<'static, u8>,
    _pin: Flex<'static>,
}

impl Receiver {
    /// Listens from now on. `pin`: set up as the receiver's input; the USART is set up already, to send.
    pub fn start<I>(pin: Flex<'static>, stream: Peri<'static, DMA2_CH5>, irqs: I) -> Self
    where
        I: Binding<<DMA2_CH5 as dma::ChannelInstance>::Interrupt, dma::InterruptHandler<DMA2_CH5>> + 'static,
    {
        static RING: ConstStaticCell<[u8; params::LINK_RING]> = ConstStaticCell::new([0; params::LINK_RING]);
        let usart = pac::USART1;
        let from = usart.dr().as_ptr().cast::<u8>();
        // SAFETY: the source is the data register of USART1, whose receiver nobody else uses, and the request number is that of USART1 on this
        // stream; the buffer is static.
        #[allow(unsafe_code)]
        let mut ring = unsafe {
            ReadableRingBuffer::new(
                dma::Channel::new(stream, irqs),
                REQUEST,
                from,
                once::<&mut [u8; params::LINK_RING]>(RING.try_take()),
                TransferOptions::default(),
            )
        };
        ring.start();
        usart.cr3().modify(|w| w.set_dmar(true));
        usart.cr1().modify(|w| {
            w.set_re(true);
            w.set_idleie(true);
        });
        interrupt::USART1.unpend();
        // SAFETY: what the handler touches is set up.
        #[allow(unsafe_code)]
        unsafe {
            interrupt::USART1.enable();
        }
        Self { ring, _pin: pin }
    }

    /// Waits for bytes; gives how many. `None`: some were lost, because they were not fetched in time.
    pub async fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        loop {
            match self.ring.read(buffer) {
                Ok((0, _)) => {}
                Ok((n, _)) => return Some(n),
                Err(_) => {
                    self.ring.clear();
                    return None;
                }
            }
            let ring = &mut self.ring;
            let mut waits = false;
            let more = poll_fn(|context| {
                ring.set_waker(context.waker());
                if core::mem::replace(&mut waits, true) {
                    Poll::Ready(())
                } else {
                    Poll::Pending
                }
            });
            select(IDLE.wait(), more).await;
        }
    }

    /// Faults of the line since start.
    pub fn line_faults(&self) -> u16 {
        LINE_FAULTS.load(Ordering::Relaxed)
    }
}
