//! Drivers of the chip's peripherals: edge capture, ADC and serial port.
//!
//! # Design
//! TIMER3 runs free at 16 MHz over 32 bits. A rising edge of a resonator and a falling one of the ADC's data-ready are events of GPIOTE;
//! PPI has each of them capture the timer, without the processor. The interrupt only takes the stamps away before the next edge, 200 us
//! later. The ADC is read over SPIM2, rates go out on UARTE0 at 1 Mbaud.
//!
//! # Tradeoffs
//! A stamp is good to 62.5 ns: as 18 ns of jitter (`docs/bench.md`, "How near to the limit"). Sending takes the main loop up to half a
//! millisecond, in which edges are still stamped; a resonator's buffer of [`MOST_EDGES`] lasts for 12 ms.

use core::cell::RefCell;
use critical_section::Mutex;
use heapless::Vec;
use hrg_core::adc::{Dialogue, Fault, Next, FRAME, WORDS};
use hrg_core::rate_path::CHANNELS;
use hrg_core::timebase::Timebase;
use hrg_core::AXES;
use nrf52840_hal::gpio::{p0, Floating, Input, Level, Output, Pin, PushPull};
use nrf52840_hal::gpiote::Gpiote;
use nrf52840_hal::pac::{interrupt, Interrupt, Peripherals, NVIC, SPIM2, TIMER3, UARTE0};
use nrf52840_hal::ppi::{self, ConfigurablePpi};
use nrf52840_hal::{spim, uarte, Clocks, Spim, Uarte};

/// Ticks of TIMER3.
pub const TIMEBASE: Timebase = Timebase::at(16_000_000);

/// Stamps of a resonator that are kept until the main loop fetches them.
pub const MOST_EDGES: usize = 64;

/// Stamps of one resonator, in order.
pub type Stamps = Vec<u32, MOST_EDGES>;

/// The capture registers: resonators x, y, z, data-ready, and one for the time itself.
const DATA_READY: usize = AXES;
const NOW: usize = AXES + 1;

/// State shared by the capture interrupt and the main loop.
struct Captures {
    gpiote: Gpiote,
    timer: TIMER3,
    edges: [Stamps; AXES],
    /// Stamp of the newest data-ready edge that was not fetched, and how many there were.
    ready: Option<u32>,
    readies: u32,
}

static CAPTURES: Mutex<RefCell<Option<Captures>>> = Mutex::new(RefCell::new(None));

impl Captures {
    /// Takes what the timer has captured.
    fn fetch(&mut self) {
        let g = &self.gpiote;
        for (k, channel) in [g.channel0(), g.channel1(), g.channel2(), g.channel3()].iter().enumerate() {
            if !channel.is_event_triggered() {
                continue;
            }
            channel.reset_events();
            let stamp = self.timer.cc[k].read().bits();
            if k == DATA_READY {
                self.ready = Some(stamp);
                self.readies += 1;
            } else {
                let _ = self.edges[k].push(stamp); // A full one is seen by the main loop.
            }
        }
    }
}

#[interrupt]
fn GPIOTE() {
    critical_section::with(|cs| {
        if let Some(captures) = CAPTURES.borrow_ref_mut(cs).as_mut() {
            captures.fetch();
        }
    });
}

/// The chip, set up.
pub struct Board {
    spi: Spim<SPIM2>,
    select: Pin<Output<PushPull>>,
    uart: Uarte<UARTE0>,
    dialogue: Dialogue,
    command: [u16; 2],
    again: Option<u32>,
}

/// The place of the calibration image (memory.x).
pub fn image() -> &'static [u8] {
    extern "C" {
        static _calibration: [u8; hrg_core::calibration::MAX_BYTES];
    }
    // SAFETY: memory.x keeps 16 KiB of flash there, which nothing in this program writes.
    unsafe { &_calibration }
}

/// Starts the timer, and has edges of the pins capture it.
fn captures(timer: TIMER3, gpiote: Gpiote, pins: &[Pin<Input<Floating>>; NOW], ppi: ppi::Parts) -> Captures {
    gpiote.channel0().input_pin(&pins[0]).lo_to_hi().enable_interrupt();
    gpiote.channel1().input_pin(&pins[1]).lo_to_hi().enable_interrupt();
    gpiote.channel2().input_pin(&pins[2]).lo_to_hi().enable_interrupt();
    gpiote.channel3().input_pin(&pins[DATA_READY]).hi_to_lo().enable_interrupt();
    timer.bitmode.write(|w| w.bitmode()._32bit());
    // SAFETY: every value of 0 to 9 is one of the prescaler; 0 is 16 MHz.
    timer.prescaler.write(|w| unsafe { w.bits(0) });
    let (mut x, mut y, mut z, mut ready) = (ppi.ppi0, ppi.ppi1, ppi.ppi2, ppi.ppi3);
    route(&mut x, gpiote.channel0().event(), &timer.tasks_capture[0]);
    route(&mut y, gpiote.channel1().event(), &timer.tasks_capture[1]);
    route(&mut z, gpiote.channel2().event(), &timer.tasks_capture[2]);
    route(&mut ready, gpiote.channel3().event(), &timer.tasks_capture[DATA_READY]);
    timer.tasks_start.write(|w| w.tasks_start().set_bit());
    Captures { gpiote, timer, edges: [Stamps::new(), Stamps::new(), Stamps::new()], ready: None, readies: 0 }
}

type EventsIn = nrf52840_hal::pac::gpiote::EVENTS_IN;
type TasksCapture = nrf52840_hal::pac::timer3::TASKS_CAPTURE;

fn route(channel: &mut impl ConfigurablePpi, event: &EventsIn, task: &TasksCapture) {
    channel.set_event_endpoint(event);
    channel.set_task_endpoint(task);
    channel.enable();
}

impl Board {
    /// Sets the chip up. Call it once. Resonators at P0.03, P0.04, P0.28, data-ready at P0.29, SPI at P0.13 to P0.15 with its select at P0.16,
    /// the serial line at P0.06 (out) and P0.08 (in).
    pub fn start() -> Self {
        // (A second call is a defect of this program.)
        let p = Peripherals::take().unwrap_or_else(|| defmt::panic!("the board is started twice"));
        let _clocks = Clocks::new(p.CLOCK).enable_ext_hfosc();
        let pins = p0::Parts::new(p.P0);
        let inputs = [
            pins.p0_03.into_floating_input().degrade(),
            pins.p0_04.into_floating_input().degrade(),
            pins.p0_28.into_floating_input().degrade(),
            pins.p0_29.into_floating_input().degrade(),
        ];
        let captures = captures(p.TIMER3, Gpiote::new(p.GPIOTE), &inputs, ppi::Parts::new(p.PPI));
        critical_section::with(|cs| CAPTURES.borrow_ref_mut(cs).replace(captures));
        let spi = spim::Pins {
            sck: Some(pins.p0_13.into_push_pull_output(Level::Low).degrade()),
            mosi: Some(pins.p0_14.into_push_pull_output(Level::Low).degrade()),
            miso: Some(pins.p0_15.into_floating_input().degrade()),
        };
        let line = uarte::Pins {
            txd: pins.p0_06.into_push_pull_output(Level::High).degrade(),
            rxd: pins.p0_08.into_floating_input().degrade(),
            cts: None,
            rts: None,
        };
        let board = Self {
            spi: Spim::new(p.SPIM2, spi, spim::Frequency::M8, spim::MODE_1, 0),
            select: pins.p0_16.into_push_pull_output(Level::High).degrade(),
            uart: Uarte::new(p.UARTE0, line, uarte::Parity::EXCLUDED, uarte::Baudrate::BAUD1M),
            dialogue: Dialogue::default(),
            command: [0; 2],
            again: None,
        };
        // SAFETY: what the interrupt shares with this thread is behind a mutex.
        unsafe { NVIC::unmask(Interrupt::GPIOTE) };
        board
    }

    /// The time, ticks, and the edges of each resonator since the last call.
    pub fn edges(&mut self) -> (u32, [Stamps; AXES]) {
        critical_section::with(|cs| match CAPTURES.borrow_ref_mut(cs).as_mut() {
            Some(captures) => {
                captures.timer.tasks_capture[NOW].write(|w| w.tasks_capture().set_bit());
                let now = captures.timer.cc[NOW].read().bits();
                captures.fetch();
                (now, core::mem::take(&mut captures.edges))
            }
            None => (0, [Stamps::new(), Stamps::new(), Stamps::new()]),
        })
    }

    /// The next sample, if the ADC has one: the tick of its data-ready edge, and its codes or why there are none.
    pub fn sample(&mut self) -> Option<(u32, Result<[i32; CHANNELS], Fault>)> {
        let (ready, count) = critical_section::with(|cs| match CAPTURES.borrow_ref_mut(cs).as_mut() {
            Some(captures) => (captures.ready.take(), core::mem::take(&mut captures.readies)),
            None => (None, 0),
        });
        let tick = ready.or_else(|| self.again.take())?;
        let mut out = [0u8; FRAME];
        out[..2].copy_from_slice(&self.command[0].to_be_bytes());
        out[3..5].copy_from_slice(&self.command[1].to_be_bytes());
        let mut bytes = [0u8; 4 * WORDS];
        // (Bytes that the bus does not bring stay zero; their checksum is wrong.)
        let _ = self.spi.transfer_split_uneven(&mut self.select, &out, &mut bytes[..FRAME]);
        let mut frame = [0u32; WORDS];
        for (word, b) in frame.iter_mut().zip(bytes.chunks_exact(4)) {
            *word = u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        }
        let received = self.dialogue.receive(&frame, count > 1);
        self.command = received.command;
        // (The ADC's reset pin is not wired here: after `Next::Reset` the dialogue begins anew, which is all that is left to do.)
        self.again = (received.next == Next::FetchAgain).then_some(tick);
        Some((tick, received.sample()?.copied()))
    }

    /// Sends bytes; `false` where the line takes none.
    pub fn send(&mut self, bytes: &[u8]) -> bool {
        self.uart.write(bytes).is_ok()
    }
}
