//! Peripherals that the unit leaves free, and the jumpers of a bare board.

use crate::clocks::Clocks;
use crate::pwm::{Wave, KINDS};
use crate::serial::{Spi, Usart};
use crate::tables::Pin;

/// Debug exception and monitor control; the cycle counter (PM0214 has neither: ARMv7-M reference manual, sections C1.6.5 and C1.8).
pub const DEMCR: u32 = 0xE000_EDFC;

/// A wire: the pin that drives it, the pin that it leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Jumper {
    /// Drives.
    pub from: Pin,
    /// Receives.
    pub to: Pin,
}

/// The counter of the processor's cycles.
#[derive(Debug, Clone, Default)]
pub struct CycleCounter {
    /// DEMCR as it was written.
    pub demcr: u32,
    /// DWT_CTRL as it was written.
    pub control: u32,
    /// Added to the cycles of the processor, modulo its width.
    pub offset: u64,
    /// Its reading while it stands.
    pub held: u32,
}

/// Peripherals that the unit leaves free.
#[derive(Debug, Clone)]
pub struct Spare {
    /// Jumpers between pins.
    pub jumpers: Vec<Jumper>,
    /// Timers that make square waves.
    pub waves: [Wave; KINDS.len()],
    /// SPI slave.
    pub spi2: Spi,
    /// Second UART.
    pub uart5: Usart,
    /// Time at which its running transmission ends.
    pub uart5_done: u64,
    /// Cycle counter.
    pub counter: CycleCounter,
    /// Cycles of the processor before its clock changed last, and when that was.
    pub cycles: (u64, u64),
}

impl Default for Spare {
    fn default() -> Self {
        Self {
            jumpers: Vec::new(),
            waves: std::array::from_fn(|k| Wave::new(&KINDS[k])),
            spi2: Spi::default(),
            uart5: Usart::default(),
            uart5_done: u64::MAX,
            counter: CycleCounter::default(),
            cycles: (0, 0),
        }
    }
}

impl Spare {
    /// Time of the next event.
    pub fn next_event(&self) -> u64 {
        self.waves.iter().fold(self.uart5_done, |next, w| next.min(w.next_event()))
    }

    /// The timers' clocks are these from now on.
    pub fn follow_clocks(&mut self, clocks: &Clocks, now: u64) {
        self.waves.iter_mut().for_each(|w| w.set_clock(clocks, now));
    }
}
