//! The board: clocks, pins, DMA streams, interrupts. What is wired where stands here and nowhere else.
//!
//! | signal | pin | peripheral |
//! |---|---|---|
//! | resonator x, y, z | PA0, PA1, PB10 | TIM2 channels 1, 2, 3 |
//! | converter data-ready | PB2 (STM32F405: PA3) and PC7, wired together | TIM2 channel 4, EXTI 7 |
//! | converter SCK, MISO, MOSI, CS | PA5, PA6, PA7, PB6 | SPI1 |
//! | link out, in | PA9, PA10 | USART1 |

use crate::capture::{self, Clock, Rings};
use crate::converter::{Converter, Wiring};
use crate::maintain::Sectors;
use crate::params;
use embassy_stm32::flash::Flash;
use embassy_stm32::mode::Async;
use embassy_stm32::peripherals::{DMA1_CH1, DMA1_CH5, DMA1_CH6, DMA2_CH5, DMA2_CH7, IWDG, USART1};
use embassy_stm32::time::Hertz;
use embassy_stm32::usart::{self, RingBufferedUartRx, Uart, UartTx};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{bind_interrupts, dma, pac, rcc};
use hrg_core::calibration::{self, Calibration};
use hrg_core::maintenance::Store;
use hrg_core::status::unit;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Irqs {
    DMA1_STREAM5 => dma::InterruptHandler<DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<DMA1_CH6>;
    DMA1_STREAM1 => dma::InterruptHandler<DMA1_CH1>;
    DMA2_STREAM5 => dma::InterruptHandler<DMA2_CH5>;
    DMA2_STREAM7 => dma::InterruptHandler<DMA2_CH7>;
    USART1 => usart::InterruptHandler<USART1>;
});

/// Everything on the board, set up.
pub struct Board {
    /// Edges of the resonators.
    pub rings: Rings,
    /// The timer.
    pub clock: Clock,
    /// The rate converter.
    pub converter: Converter,
    /// Frames out.
    pub link_out: UartTx<'static, Async>,
    /// Commands in.
    pub link_in: RingBufferedUartRx<'static>,
    /// Not yet running.
    pub watchdog: IndependentWatchdog<'static, IWDG>,
    /// Whether the last reset came from the watchdog.
    pub watchdog_reset: bool,
    /// The two calibration sectors.
    pub sectors: Sectors,
}

fn clocks() -> rcc::Config {
    let mut c = rcc::Config::default();
    c.hse = Some(rcc::Hse { freq: Hertz(params::HSE_HZ), mode: rcc::HseMode::Bypass });
    c.pll_src = rcc::PllSource::HSE;
    // See params::PLL_MUL.
    c.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::from_bits(params::PLL_MUL),
        divp: Some(rcc::PllPDiv::DIV2),
        divq: None,
        divr: None,
    });
    c.sys = rcc::Sysclk::PLL1_P;
    c.ahb_pre = rcc::AHBPrescaler::DIV1;
    c.apb1_pre = rcc::APBPrescaler::DIV4;
    c.apb2_pre = rcc::APBPrescaler::DIV2;
    c
}

impl Board {
    /// Sets everything up.
    pub fn new() -> Self {
        let mut config = embassy_stm32::Config::default();
        config.rcc = clocks();
        let p = embassy_stm32::init(config);
        let watchdog_reset = pac::RCC.csr().read().wdgrstf();
        pac::RCC.csr().modify(|w| w.set_rmvf(true));

        #[cfg(not(feature = "stm32f405rg"))]
        let data_ready: embassy_stm32::Peri<'static, params::DataReady> = p.PB2;
        #[cfg(feature = "stm32f405rg")]
        let data_ready: embassy_stm32::Peri<'static, params::DataReady> = p.PA3;
        let (rings, clock) = capture::start(
            p.TIM2,
            capture::Pins { x: p.PA0, y: p.PA1, z: p.PB10, data_ready },
            capture::Streams { x: p.DMA1_CH5, y: p.DMA1_CH6, z: p.DMA1_CH1 },
            Irqs,
        );

        let converter = Converter::new(Wiring {
            spi: p.SPI1,
            sck: p.PA5,
            miso: p.PA6,
            mosi: p.PA7,
            select: p.PB6,
            ready: p.PC7,
            ready_line: p.EXTI7,
            rx: p.DMA2_CH0,
            tx: p.DMA2_CH3,
        });

        let mut link_config = usart::Config::default();
        link_config.baudrate = params::LINK_BAUD;
        static LINK_RING: ConstStaticCell<[u8; params::LINK_RING]> = ConstStaticCell::new([0; params::LINK_RING]);
        // The configuration is a constant one, good for this USART.
        let uart = match Uart::new(p.USART1, p.PA10, p.PA9, p.DMA2_CH7, p.DMA2_CH5, Irqs, link_config) {
            Ok(uart) => uart,
            Err(_) => defmt::panic!("link configuration"),
        };
        let (link_out, link_in) = uart.split();

        Self {
            rings,
            clock,
            converter,
            link_out,
            link_in: link_in.into_ring_buffered(crate::once::<&mut [u8; params::LINK_RING]>(LINK_RING.try_take())),
            watchdog: IndependentWatchdog::new(p.IWDG, params::WATCHDOG_US),
            watchdog_reset,
            sectors: Sectors::new(Flash::new_blocking(p.FLASH)),
        }
    }

    /// The newest valid block of the two sectors with its sector and checksum, or the compiled-in default, whose checksum is
    /// given as zero; and what status to report.
    pub fn calibration(&self) -> (Calibration, Option<u8>, u32, u8) {
        let found = calibration::newest(self.sectors.view(0), self.sectors.view(1));
        let mut status = 0;
        if let Some(error) = found.refused {
            defmt::error!("calibration refused: {}", error);
            status |= unit::BLOCK_REFUSED;
        }
        match found.newest {
            Some((calibration, sector)) => {
                let checksum = calibration::stored_checksum(self.sectors.view(sector)).unwrap_or(0);
                (calibration, Some(sector), checksum, status)
            }
            None => (Calibration::uncalibrated(), None, 0, status | unit::DEFAULT_CALIBRATION),
        }
    }
}
