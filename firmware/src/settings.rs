//! Registers that stand still once the unit runs: a bit that changes in one of them is noticed, and the unit starts anew.
//!
//! # Design
//! Most of what goes wrong in a peripheral shows in what the unit makes of it, and is noticed there. A bit of the set-up that silences an input or the
//! link shows nowhere: no edge comes, no frame goes out, and everything waits. So each look of the watchdog reads all registers that nothing writes after
//! the start, and compares their sum with the first one. Registers that are written anew with each transfer are not among them, nor counters.
//!
//! The sum of words is that of Fowler, Noll and Vo: one word that differs always changes it.

use crate::stop::halt;
use hrg_core::reset::Halt;

/// Registers one behind the other: the address of the first, and how many.
struct Row(usize, usize);

/// Pins of a port: modes, types, speeds, pulls; then the alternate functions.
const fn port(base: usize) -> [Row; 2] {
    [Row(base, 4), Row(base + 0x20, 2)]
}

/// A timer that captures: control, triggers and interrupts; channels; prescaler and period.
const fn timer(base: usize) -> [Row; 3] {
    [Row(base, 4), Row(base + 0x18, 3), Row(base + 0x28, 2)]
}

/// A DMA stream that goes round for ever: control; addresses.
const fn ring(dma: usize, stream: usize) -> [Row; 2] {
    let base = dma + 0x10 + 0x18 * stream;
    [Row(base, 1), Row(base + 8, 2)]
}

const DMA1: usize = 0x4002_6000;
const DMA2: usize = 0x4002_6400;

/// All of them, part by part (RM0390 chapter 2 has the bases).
const STANDING: &[&[Row]] = &[
    &port(0x4002_0000),
    &port(0x4002_0400),
    &port(0x4002_0800),
    // RCC: PLL and prescalers; clocks of the buses' peripherals.
    &[Row(0x4002_3804, 2), Row(0x4002_3830, 3), Row(0x4002_3840, 2)],
    // TIM2: the captures.
    &timer(0x4000_0000),
    // TIM3: the pulse per second.
    #[cfg(feature = "pps")]
    &timer(0x4000_0400),
    // TIM5: the time of the tasks. (Its interrupts change with each alarm.)
    &[Row(0x4000_0C00, 1), Row(0x4000_0C28, 2)],
    &ring(DMA1, 1),
    &ring(DMA1, 5),
    &ring(DMA1, 6),
    // The link's receiver.
    &ring(DMA2, 5),
    // USART1: rate and control.
    &[Row(0x4001_1008, 4)],
    // NVIC: interrupts that are let through, and their priorities.
    &[Row(0xE000_E100, 3), Row(0xE000_E400, 23)],
];

fn sum() -> u32 {
    let mut sum = 0x811C_9DC5;
    for Row(first, count) in STANDING.iter().copied().flatten() {
        for k in 0..*count {
            // SAFETY: a word of a peripheral that is clocked; reading these changes nothing.
            #[allow(unsafe_code)]
            let word = unsafe { core::ptr::with_exposed_provenance::<u32>(first + 4 * k).read_volatile() };
            sum = (sum ^ word).wrapping_mul(0x0100_0193);
        }
    }
    sum
}

/// The sum that the registers had when everything ran.
#[derive(Default)]
pub struct Settings(Option<u32>);

impl Settings {
    /// Looks at them; `running`: everything has been set up. A sum that has changed stops the unit.
    pub fn look(&mut self, running: bool) {
        if running && *self.0.get_or_insert_with(sum) != sum() {
            defmt::error!("a peripheral's settings have changed");
            halt(Halt::Corruption)
        }
    }
}
