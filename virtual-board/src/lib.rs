//! A digital twin of an STM32F446 (or STM32F405) board that runs the very ELF that gets flashed.
//!
//! The CPU is Unicorn; this library adds what Unicorn has not (interrupt controller, exception entry and
//! return, sleep) and the peripherals that the firmware uses, down to their registers. It knows the chip, the
//! ADC on its SPI and the wires; it knows nothing of gyros. The events on the wires come from a
//! [`World`].
//!
//! # Time
//! Time is counted in cycles of 180 MHz ([`CPU_HZ`]). One instruction takes one cycle of HCLK, as RCC sets
//! it, so runs repeat exactly. While the CPU sleeps, time jumps to the next event. Wait states, pipeline and bus contention do not move time; what they
//! would cost is estimated beside it, on request ([`cycles`]).
//!
//! # What is not modelled is an error
//! An access to a register that is not modelled stops the run with its address. So does a signal that would not pass on the chip: a wrong pin,
//! clock, bus mode or stream (`judge`), with a sentence that names the register and the section of the manual.
//!
//! # Navigating
//! | file | models |
//! |---|---|
//! | `board` | the loop that keeps time: events, interrupts, sleep |
//! | `elf` | the firmware's ELF, read once |
//! | `cpu` | the emulator, set up |
//! | `thumb` | the little that must be known of Thumb code |
//! | `exception` | entry and return of exceptions |
//! | `wires` | edges, ADC frames, bytes of the link |
//! | `flash` | programming and erasing, cut short or not |
//! | `debugger` | semihosting: the command line and the end of a test program |
//! | `environment` | what a test does to the board from outside |
//! | `rtt` | the debug probe that reads the log |
//! | `error` | why a run stops |
//! | `part` | the chips that the board can carry, and what is wired to them |
//! | `tables` | pins, clock gates, DMA requests, interrupts and bits of a chip |
//! | `mutation`, `register_writes` | writes to registers, recorded and changed |
//! | `chip` | which address belongs to which peripheral |
//! | `signals`, `spare` | signals that pins carry; peripherals that the unit leaves free, jumpers |
//! | `judge` | what must be so for a signal to pass: the sentences that end a run |
//! | `jumpers` | a bare board: wires between its own pins, and the peripherals that the unit leaves free |
//! | `pwm` | timers as sources of square waves |
//! | `clocks` | the clock tree, wait states, voltage scale, over-drive |
//! | `dma` | streams and their requests |
//! | `memory` | flash and RAM |
//! | `nvic` | NVIC, SCB, SysTick registers; exception priorities |
//! | `timer` | TIM2, TIM5 |
//! | `gpio` | ports, SYSCFG, EXTI |
//! | `serial` | SPI1, USART1 |
//! | `system` | RCC, PWR, FLASH, IWDG, DBGMCU |
//! | `ads131m08` | the ADC's protocol |
//! | `probe` | instructions of a function's calls |
//! | `cycles` | an estimate of cycles beside the count of instructions |

pub mod ads131m08;
pub mod board;
mod chip;
pub mod chip_adc;
mod clocks;
mod cpu;
pub mod cycles;
mod debugger;
mod dma;
pub mod elf;
mod environment;
pub mod error;
mod exception;
mod flash;
mod gpio;
mod judge;
mod jumpers;
mod memory;
pub mod mutation;
mod nvic;
pub mod part;
mod probe;
mod profile;
mod pwm;
mod register_writes;
mod rtt;
mod serial;
mod signals;
mod spare;
mod system;
pub mod tables;
mod thumb;
mod timer;
mod touched;
mod wires;

pub use board::{Board, Snapshot};
pub use cycles::Cycles;
pub use elf::Firmware;
pub use error::{RunError, Stop};
pub use probe::{Latency, Masked, Moment, Probe};
pub use profile::Cost;
pub use spare::Jumper;

/// Units of the board's time per second: cycles of the STM32F446 at its highest clock.
pub const CPU_HZ: u64 = 180_000_000;
/// Cycles per tick of the timers of the STM32F446 at its highest clock.
pub const CYCLES_PER_TICK: u64 = 2;
/// Start of flash.
pub const FLASH_START: u32 = 0x0800_0000;
/// Size of flash.
pub const FLASH_SIZE: u32 = 512 * 1024;
/// Start of RAM.
pub const RAM_START: u32 = 0x2000_0000;
/// Size of RAM.
pub const RAM_SIZE: u32 = 128 * 1024;

/// Mishap of the ADC or its bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdcMishap {
    /// Its supply fails for a moment.
    LosesSettings,
    /// A bit of a register changes: the register and the bit.
    Flips(usize, u32),
    /// A disturbance on the clock line leaves a byte too many in the processor's receiver.
    SlipsAByte,
}

/// Fault that a UART notices of a single byte (RM0390 section 25.4.3). The byte is received all the same, and need not be the one that was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineFault {
    /// Samples of a bit disagree: NF.
    Noise,
    /// There is no stop bit: FE.
    Framing,
}

/// Events on the wires. All times are cycles since power-on and must not go backwards per source.
pub trait World {
    /// Time of the next rising edge at capture input `channel` (0 to 2), or `None` if there will be none.
    fn next_edge(&mut self, channel: usize) -> Option<u64>;
    /// The eight codes that the ADC finishes at `cycles`, or `None` if it is silent.
    fn convert(&mut self, cycles: u64) -> Option<[i32; 8]>;
    /// Supply and temperature of the processor; `None`: as they were.
    fn ambient(&mut self, _cycles: u64) -> Option<chip_adc::Ambient> {
        None
    }
    /// The next byte that the other end of the link sends: when it has arrived, and the byte.
    fn next_link_byte(&mut self) -> Option<(u64, u8)> {
        None
    }
    /// Fault that the unit's receiver notices of the byte that arrives at `cycles`, beside the byte itself.
    fn line_fault(&mut self, _cycles: u64) -> Option<LineFault> {
        None
    }
    /// `true` if the frame that the ADC sends now is invalid on the wire.
    fn invalidate_adc_frame(&mut self) -> bool {
        false
    }
    /// An edge was captured: the channel and the timer's reading.
    fn captured(&mut self, _channel: usize, _stamp: u32) {}
    /// Time of the next pulse of the pulse per second, or `None` if there will be none.
    fn next_pulse(&mut self) -> Option<u64> {
        None
    }
    /// A pulse was captured: the reading of TIM2 at its edge.
    fn pulsed(&mut self, _stamp: u32) {}
    /// Mishap of the ADC or its bus before the sample that is finished at `cycles`.
    fn adc_mishap(&mut self, _cycles: u64) -> Option<AdcMishap> {
        None
    }
    /// The firmware has fetched a whole ADC frame: reading of the timer at its data-ready edge, and the bytes as they came in.
    fn fetched(&mut self, _stamp: u32, _frame: &[u8]) {}
    /// Bytes that the firmware has sent over the link, at the end of a DMA transfer.
    fn link_out(&mut self, cycles: u64, bytes: &[u8]);
    /// Bytes of the firmware's log (RTT up channel 0).
    fn log_out(&mut self, cycles: u64, bytes: &[u8]);
}

/// Nothing on any wire.
#[derive(Debug)]
pub struct NothingConnected;

impl World for NothingConnected {
    fn next_edge(&mut self, _: usize) -> Option<u64> {
        None
    }
    fn convert(&mut self, _: u64) -> Option<[i32; 8]> {
        None
    }
    fn link_out(&mut self, _: u64, _: &[u8]) {}
    fn log_out(&mut self, _: u64, _: &[u8]) {}
}
