//! TIM2: time stamps of the three resonators' edges and of the ADC's data-ready.
//!
//! # Design
//! TIM2 runs free at [`TIMER_HZ`] over 32 bits. Channels 1 to 3 capture a resonator each; every capture makes a DMA
//! stream copy it into a ring, so the processor does nothing per edge. Channel 4 captures the data-ready edge
//! of the ADC: the time of every sample on the same clock. It needs no DMA: its interrupt starts the transfer of the sample
//! ([`crate::adc`]), at whose end the stamp is read, well before the next.
//!
//! # Tradeoffs
//! embassy's `InputCapture` waits for one channel at a time, so the timer is driven through its low-level layer.
//! A ring that was not fetched in time overruns: that is reported per channel and the counter of that axis
//! locks anew. An over-captured channel (edge before the DMA took the last one; not possible below 1 MHz)
//! would show as a missing edge.

use crate::params::{RING, TIMER_HZ};
use crate::stop::once;
use embassy_stm32::dma::{self, ReadableRingBuffer, TransferOptions};
use embassy_stm32::gpio::Flex;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::pac;
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH5, DMA1_CH6, TIM2};
use embassy_stm32::timer::low_level::{FilterValue, InputCaptureMode, InputTISelection, MasterMode, Timer};
use embassy_stm32::timer::Channel;
use embassy_stm32::Peri;
use static_cell::ConstStaticCell;

/// DMA streams of channels 1 to 3 (RM0390 table 28: TIM2_CH1 stream 5, CH2 stream 6, CH3 stream 1, channel 3).
pub struct Streams {
    /// Resonator x.
    pub x: Peri<'static, DMA1_CH5>,
    /// Resonator y.
    pub y: Peri<'static, DMA1_CH6>,
    /// Resonator z.
    pub z: Peri<'static, DMA1_CH1>,
}

/// DMA request number of TIM2 on those streams.
const REQUEST: u8 = 3;

/// The rings, fetched by the model task.
pub struct Rings {
    rings: [ReadableRingBuffer<'static, u32>; 3],
    _timer: Timer<'static, TIM2>,
    _pins: [Flex<'static>; 4],
}

/// Reads the free-running timer.
#[derive(Clone, Copy)]
pub struct Clock;

impl Clock {
    /// Now, ticks.
    #[inline]
    pub fn now(self) -> u32 {
        pac::TIM2.cnt().read()
    }
}

/// Starts the timer and its captures. `pins`: of channels 1 to 4 (resonators x, y, z, data-ready), set up as its inputs.
pub fn start<I>(tim: Peri<'static, TIM2>, pins: [Flex<'static>; 4], streams: Streams, irqs: I) -> (Rings, Clock)
where
    I: Copy
        + Binding<<DMA1_CH5 as dma::ChannelInstance>::Interrupt, dma::InterruptHandler<DMA1_CH5>>
        + Binding<<DMA1_CH6 as dma::ChannelInstance>::Interrupt, dma::InterruptHandler<DMA1_CH6>>
        + Binding<<DMA1_CH1 as dma::ChannelInstance>::Interrupt, dma::InterruptHandler<DMA1_CH1>>
        + 'static,
{
    let timer = Timer::new(tim);
    debug_assert_eq!(timer.get_clock_frequency().0, TIMER_HZ);
    timer.set_max_compare_value(u32::MAX);
    // Its start is the trigger of TIM3 ([`crate::pps`]).
    timer.set_master_mode(MasterMode::ENABLE);
    timer.generate_update_event();
    for (channel, edge) in [
        (Channel::Ch1, InputCaptureMode::Rising),
        (Channel::Ch2, InputCaptureMode::Rising),
        (Channel::Ch3, InputCaptureMode::Rising),
        (Channel::Ch4, InputCaptureMode::Falling),
    ] {
        timer.set_input_ti_selection(channel, InputTISelection::Normal);
        timer.set_input_capture_filter(channel, FilterValue::NO_FILTER);
        timer.set_input_capture_prescaler(channel, 0);
        timer.set_input_capture_mode(channel, edge);
        timer.enable_channel(channel, true);
    }
    for channel in [Channel::Ch1, Channel::Ch2, Channel::Ch3] {
        timer.set_cc_dma_enable_state(channel, true);
    }
    timer.enable_input_interrupt(Channel::Ch4, true);

    static X: ConstStaticCell<[u32; RING]> = ConstStaticCell::new([0; RING]);
    static Y: ConstStaticCell<[u32; RING]> = ConstStaticCell::new([0; RING]);
    static Z: ConstStaticCell<[u32; RING]> = ConstStaticCell::new([0; RING]);
    let mut rings = [
        ring(dma::Channel::new(streams.x, irqs), 0, once(X.try_take())),
        ring(dma::Channel::new(streams.y, irqs), 1, once(Y.try_take())),
        ring(dma::Channel::new(streams.z, irqs), 2, once(Z.try_take())),
    ];
    for r in &mut rings {
        r.start();
    }
    timer.start();
    (Rings { rings, _timer: timer, _pins: pins }, Clock)
}

fn ring(
    channel: dma::Channel<'static>,
    index: usize,
    buffer: &'static mut [u32; RING],
) -> ReadableRingBuffer<'static, u32> {
    let source = pac::TIM2.ccr(index).as_ptr().cast::<u32>();
    // SAFETY: the source is a capture register of TIM2, which `Rings` owns, and the request number is that of
    // TIM2 on this stream; the buffer is static.
    #[allow(unsafe_code)]
    unsafe {
        ReadableRingBuffer::new(channel, REQUEST, source, buffer, TransferOptions::default())
    }
}

impl Rings {
    /// Hands the time stamps of one axis that have come since the last call to `take`, in order. `false` where
    /// the ring overran: stamps were lost.
    #[inline(never)]
    pub fn fetch(&mut self, axis: usize, mut take: impl FnMut(&[u32])) -> bool {
        let mut buffer = [0u32; 64];
        let Some(ring) = self.rings.get_mut(axis) else {
            return true;
        };
        loop {
            match ring.read(&mut buffer) {
                Ok((0, _)) => return true,
                Ok((n, _)) => take(&buffer[..n]),
                Err(_) => {
                    ring.clear();
                    return false;
                }
            }
        }
    }
}
