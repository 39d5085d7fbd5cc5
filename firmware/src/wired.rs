//! The ADC's wiring, as numbers in registers.

use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac;

/// Port and pin of the chip select: PB6.
pub const SELECT: (pac::gpio::Gpio, usize) = (pac::GPIOB, 6);
/// DMA2 stream that receives (RM0390 table 29: SPI1_RX).
pub const RX: usize = 0;
/// DMA2 stream that sends (SPI1_TX).
pub const TX: usize = 3;
/// First bit of each of the two in LISR and LIFCR (RM0390 section 9.5.1).
pub const STREAM_BITS: [u32; 2] = [0, 22];
/// DMA channel of SPI1 on both.
pub const DMA_CHANNEL: u8 = 3;

/// Lets data-ready and the end of a transfer through from now on.
pub fn enable_interrupts() {
    interrupt::DMA2_STREAM0.unpend();
    interrupt::TIM2.unpend();
    // SAFETY: everything that the two handlers touch was set up before the ADC was handed out.
    #[allow(unsafe_code)]
    unsafe {
        interrupt::DMA2_STREAM0.enable();
        interrupt::TIM2.enable();
    }
}
