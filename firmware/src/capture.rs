//! TIM2: time stamps of the three resonators' edges and of the ADC's data-ready.
//!
//! # Design
//! TIM2 runs free at [`TIMER_HZ`] over 32 bits. Channels 1 to 3 capture a resonator each; every capture makes a DMA
//! stream copy it into a ring, so the processor does nothing per edge. Channel 4 captures the data-ready edge
//! of the ADC: the time of every sample on the same clock. It needs no DMA: its interrupt starts the transfer of the sample
//! ([`crate::adc`]), at whose end the stamp is read, well before the next.
//!
//! # Tradeoffs
//! embassy's `InputCapture` waits for one channel at a time, so the timer is driven through its low-level layer. Its ring of a DMA stream
//! takes two interrupts a turn and looks at each word by itself: together a tenth of the unit's load. Here the rings turn without
//! an interrupt, and a fetch hands out what lies between its place and the stream's.
//! A ring that was not fetched in time overruns, and whole turns of it are lost. The stamps themselves tell: they are that much further apart, and the
//! counter counts the edges as missing, or locks anew. So no flag of the stream is asked, whose time beside NDTR the manual does not state. An
//! over-captured channel (edge before the DMA took the last one; not possible below 1 MHz) would show as a missing edge.

use crate::params::{RING, TIMER_HZ};
use crate::stop::halt;
use core::sync::atomic::{fence, AtomicU32, Ordering};
use embassy_stm32::gpio::Flex;
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::{Pl, Size};
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH5, DMA1_CH6, TIM2};
use embassy_stm32::timer::low_level::{FilterValue, InputCaptureMode, InputTISelection, MasterMode, Timer};
use embassy_stm32::timer::Channel;
use embassy_stm32::Peri;
use hrg_core::reset::Halt;
use hrg_core::AXES;

/// Streams of DMA1 of channels 1 to 3 (RM0390 table 28).
const STREAMS: [usize; AXES] = [5, 6, 1];
/// DMA channel of TIM2 on those streams.
const DMA_CHANNEL: u8 = 3;

/// The streams, so that nobody else takes them.
pub type Streams = (Peri<'static, DMA1_CH5>, Peri<'static, DMA1_CH6>, Peri<'static, DMA1_CH1>);

/// Stamps of each resonator, written by its stream.
static STAMPS: [[AtomicU32; RING]; AXES] = [const { [const { AtomicU32::new(0) }; RING] }; AXES];

/// The rings, fetched by the model task.
pub struct Rings {
    /// The next stamp to fetch of each ring.
    at: [usize; AXES],
    _streams: Streams,
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
pub fn start(tim: Peri<'static, TIM2>, pins: [Flex<'static>; 4], streams: Streams) -> (Rings, Clock) {
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

    for axis in 0..AXES {
        start_ring(axis);
    }
    timer.start();
    (Rings { at: [0; AXES], _streams: streams, _timer: timer, _pins: pins }, Clock)
}

/// Has the stream of an axis copy each capture into its ring, for ever.
fn start_ring(axis: usize) {
    let stream = pac::DMA1.st(STREAMS[axis]);
    stream.par().write_value(pac::TIM2.ccr(axis).as_ptr() as u32);
    stream.m0ar().write_value(STAMPS[axis].as_ptr() as u32);
    stream.ndtr().write(|w| w.set_ndt(RING as u16));
    stream.cr().write(|w| {
        w.set_chsel(DMA_CHANNEL);
        w.set_minc(true);
        w.set_circ(true);
        w.set_psize(Size::BITS32);
        w.set_msize(Size::BITS32);
        w.set_pl(Pl::VERY_HIGH);
    });
    stream.cr().modify(|w| w.set_en(true));
}

/// A stream that has met an error stands still (RM0390 section 9.3.19), which only a start heals.
fn check(axis: usize) {
    let stream = STREAMS[axis];
    if pac::DMA1.isr(stream / 4).read().teif(stream % 4) {
        defmt::error!("DMA1 stream {=usize} has met an error", stream);
        halt(Halt::Fault)
    }
}

impl Rings {
    /// Hands the time stamps of one axis that have come since the last call to `take`, in order: in two parts where they go round
    /// the ring's end.
    pub fn fetch(&mut self, axis: usize, mut take: impl FnMut(&[AtomicU32])) {
        let (Some(at), Some(ring)) = (self.at.get_mut(axis), STAMPS.get(axis)) else {
            return;
        };
        check(axis);
        let to = (RING - usize::from(pac::DMA1.st(STREAMS[axis]).ndtr().read().ndt())) % RING;
        fence(Ordering::SeqCst);
        let from = core::mem::replace(at, to);
        if to >= from {
            take(ring.get(from..to).unwrap_or_default());
        } else {
            take(ring.get(from..).unwrap_or_default());
            take(ring.get(..to).unwrap_or_default());
        }
    }
}
