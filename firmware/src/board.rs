//! The board: clocks, pins, DMA streams, interrupts. The wiring is defined here and nowhere else.
//!
//! | signal | pin | peripheral |
//! |---|---|---|
//! | resonator x, y, z | PA0, PA1, PB10 | TIM2 channels 1, 2, 3 |
//! | ADC data-ready | PB2 (STM32F405: PA3) | TIM2 channel 4 |
//! | ADC SYNC/RESET | PC7 | output |
//! | pulse per second in | PC6 | TIM3 channel 1 |
//! | sample mark out | PC8 | output |
//! | ADC SCK, MISO, MOSI, CS | PA5, PA6, PA7, PB6 | SPI1 |
//! | link out, in | PA9, PA10 | USART1 |
//! | service (low: maintenance while the unit moves) | PC13 | input |

use crate::adc::{self, Adc, Wiring};
#[cfg(feature = "battery")]
use crate::backup;
use crate::capture::{self, Clock, Rings};
#[cfg(feature = "inputs")]
use crate::chip::Chip;
use crate::maintain::{self, Sectors};
use crate::params;
#[cfg(feature = "pps")]
use crate::pps;
use crate::receive::{self, Receiver};
use crate::watchdog::{self, Patience, Watchdog};
use crate::{clock, program, time};
use embassy_stm32::flash::Flash;
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::interrupt;
use embassy_stm32::mode::Async;
#[cfg(feature = "pps")]
use embassy_stm32::peripherals::TIM3;
use embassy_stm32::peripherals::{DMA2_CH5, DMA2_CH7, PA9, TIM2, USART1};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::{Ch1, Ch2, Ch3, Ch4, TimerPin};
use embassy_stm32::usart::{self, UartTx};
use embassy_stm32::{bind_interrupts, dma, pac, rcc, Peri};
use hrg_core::calibration::Calibration;
#[cfg(feature = "field-log")]
use hrg_core::events::Journal;
use hrg_core::reset::ResetCause;
use hrg_core::sectors::Store;
use hrg_core::sectors::{self, Place, Sector};
use hrg_core::status::UnitStatus;

bind_interrupts!(struct Irqs {
    DMA2_STREAM5 => dma::InterruptHandler<DMA2_CH5>;
    DMA2_STREAM7 => dma::InterruptHandler<DMA2_CH7>;
});

/// The ADC's frame is to be fetched: its data-ready edge was captured. Passes on where the stack has the interrupted code's registers.
#[allow(unsafe_code)] // The vector table wants the name; the stack pointer is that of entry only before a prologue.
#[unsafe(naked)]
#[unsafe(export_name = "TIM2")]
extern "C" fn captured() {
    core::arch::naked_asm!("mov r0, sp", "b {}", sym data_ready)
}

/// `interrupted`: r0 to r3, r12, LR, PC, xPSR of the code that runs below.
extern "C" fn data_ready(interrupted: &[u32; 8]) {
    adc::data_ready();
    watchdog::sampled(interrupted);
}

/// A pulse per second came.
#[cfg(feature = "pps")]
#[interrupt]
fn TIM3() {
    pps::captured();
}

/// The link's line has fallen idle.
#[interrupt]
fn USART1() {
    receive::line_is_idle();
}

/// The ADC's frame is in.
#[interrupt]
fn DMA2_STREAM0() {
    adc::transferred();
}

/// One pin as input of a timer, pulled down so that a missing resonator is silent.
macro_rules! capture_input {
    ($pin:expr, $timer:ty, $channel:ty) => {{
        let alternate = TimerPin::<$timer, $channel>::af_num(&*$pin);
        alternate_function(Flex::new($pin), alternate, AfType::input(Pull::Down))
    }};
}

fn alternate_function(mut pin: Flex<'static>, number: u8, kind: AfType) -> Flex<'static> {
    pin.set_as_af_unchecked(number, kind);
    pin
}

/// Alternate function of SPI1 on PA5 to PA7 (data sheet, table 11).
const SPI1_FUNCTION: u8 = 5;

/// Alternate function of USART1 on PA9 and PA10.
const USART1_FUNCTION: u8 = 7;

/// Everything on the board, set up.
pub struct Board {
    /// Edges of the resonators.
    pub rings: Rings,
    /// The timer.
    pub clock: Clock,
    /// The rate ADC.
    pub adc: Adc,
    /// Frames out.
    pub link_out: UartTx<'static, Async>,
    /// Commands in.
    pub link_in: Receiver,
    /// Running.
    pub watchdog: Watchdog,
    /// Why the processor started.
    pub reset_cause: ResetCause,
    /// The two calibration sectors.
    pub sectors: Sectors,
    /// Tied low: maintenance even while the unit moves.
    pub service: Input<'static>,
    /// The field log.
    #[cfg(feature = "field-log")]
    pub journal: Journal,
    /// The program's own check.
    pub program: program::Check,
    /// The crystal is right.
    pub crystal: bool,
    /// The processor's own temperature and supply.
    #[cfg(feature = "inputs")]
    pub chip: Chip,
}

/// `crystal`: it is right; else the chip's own oscillator drives the PLL, at the same input of 2 MHz.
fn clocks(crystal: bool) -> rcc::Config {
    let mut c = rcc::Config::default();
    c.hse = crystal.then_some(rcc::Hse { freq: Hertz(params::HSE_HZ), mode: rcc::HseMode::Bypass });
    c.hsi = true;
    c.pll_src = if crystal { rcc::PllSource::HSE } else { rcc::PllSource::HSI };
    // See params::PLL_MUL.
    c.pll = Some(rcc::Pll {
        prediv: if crystal { rcc::PllPreDiv::DIV4 } else { rcc::PllPreDiv::DIV8 },
        mul: rcc::PllMul::from_bits(params::PLL_MUL),
        divp: Some(rcc::PllPDiv::DIV2),
        // Nothing runs on these two, but 0, which stands for none, is no setting of the chip (RM0390 section 6.3.2).
        divq: Some(rcc::PllQDiv::DIV8),
        #[cfg(not(feature = "stm32f405rg"))]
        divr: Some(rcc::PllRDiv::DIV4),
        #[cfg(feature = "stm32f405rg")]
        divr: None,
    });
    c.sys = rcc::Sysclk::PLL1_P;
    c.ahb_pre = rcc::AHBPrescaler::DIV1;
    c.apb1_pre = rcc::APBPrescaler::DIV4;
    // Half of what it may be: see params::ADC_SPI_PRESCALER.
    c.apb2_pre = rcc::APBPrescaler::DIV4;
    c
}

/// Why the processor started (RM0390 section 6.3.21), and forgets it. Every reset pulls the pin low, too.
fn reset_cause() -> ResetCause {
    let flags = pac::RCC.csr().read();
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    if flags.porrstf() || flags.borrstf() {
        ResetCause::Power
    } else if flags.wdgrstf() || flags.wwdgrstf() {
        ResetCause::Watchdog
    } else if flags.sftrstf() {
        ResetCause::Software
    } else {
        ResetCause::Pin
    }
}

/// The link's sender. (Before its receiver: it sets the USART up.)
fn link_out(
    usart: Peri<'static, USART1>,
    pin: Peri<'static, PA9>,
    stream: Peri<'static, DMA2_CH7>,
) -> UartTx<'static, Async> {
    let mut config = usart::Config::default();
    config.baudrate = params::LINK_BAUD;
    // The configuration is a constant one, good for this USART.
    match UartTx::new(usart, pin, stream, Irqs, config) {
        Ok(uart) => uart,
        Err(_) => defmt::panic!("link configuration"),
    }
}

impl Board {
    /// Sets everything up.
    pub fn new() -> Self {
        let crystal = clock::crystal_is_right();
        if !crystal {
            clock::give_up();
        }
        let mut config = embassy_stm32::Config::default();
        config.rcc = clocks(crystal);
        #[cfg(feature = "battery")]
        {
            backup::clock();
            config.rcc.ls = rcc::LsConfig::default_lse();
            // (embassy writes this as well, to the same register.)
            config.rcc.mux.rtcsel = rcc::mux::Rtcsel::LSE;
        }
        let p = embassy_stm32::init(config);
        time::start();
        if crystal {
            clock::watch();
        }
        clock::watch_supply();
        #[cfg(feature = "battery")]
        backup::start();
        maintain::cache();
        let reset_cause = reset_cause();
        let (watchdog, patience): (Watchdog, Patience) = Watchdog::new(p.IWDG);
        clock::wait_for_supply();
        #[cfg(feature = "self-test")]
        crate::self_test::memory();
        #[cfg_attr(not(feature = "field-log"), allow(unused_mut))]
        let mut sectors = Sectors::new(Flash::new_blocking(p.FLASH), patience);
        #[cfg(feature = "field-log")]
        // Before anything is measured: it may erase, half a second long.
        let journal = Journal::open(&mut sectors, !reset_cause.is_brief());

        #[cfg(not(feature = "stm32f405rg"))]
        let data_ready = capture_input!(p.PB2, TIM2, Ch4);
        #[cfg(feature = "stm32f405rg")]
        let data_ready = capture_input!(p.PA3, TIM2, Ch4);
        #[cfg(feature = "pps")]
        pps::prepare(p.TIM3, capture_input!(p.PC6, TIM3, Ch1));
        let (rings, clock) = capture::start(
            p.TIM2,
            [
                capture_input!(p.PA0, TIM2, Ch1),
                capture_input!(p.PA1, TIM2, Ch2),
                capture_input!(p.PB10, TIM2, Ch3),
                data_ready,
            ],
            (p.DMA1_CH5, p.DMA1_CH6, p.DMA1_CH1),
        );

        let out = AfType::output(OutputType::PushPull, Speed::High);
        let clock_out = AfType::output(OutputType::PushPull, Speed::VeryHigh);
        let adc = Adc::new(Wiring {
            spi: p.SPI1,
            bus: [
                alternate_function(Flex::new(p.PA5), SPI1_FUNCTION, clock_out),
                alternate_function(Flex::new(p.PA7), SPI1_FUNCTION, out),
                alternate_function(Flex::new(p.PA6), SPI1_FUNCTION, AfType::input(Pull::Down)),
            ],
            select: Output::new(p.PB6, Level::High, Speed::High),
            reset: Output::new(p.PC7, Level::High, Speed::Low),
            #[cfg(feature = "pps")]
            mark: Output::new(p.PC8, Level::Low, Speed::High),
            rx: p.DMA2_CH0,
            tx: p.DMA2_CH3,
        });

        // Without a cable the line rests high, and no noise wakes the receiver.
        let link_pin = alternate_function(Flex::new(p.PA10), USART1_FUNCTION, AfType::input(Pull::Up));

        Self {
            rings,
            clock,
            adc,
            link_out: link_out(p.USART1, p.PA9, p.DMA2_CH7),
            link_in: Receiver::start(link_pin, p.DMA2_CH5, Irqs),
            watchdog,
            reset_cause,
            sectors,
            service: Input::new(p.PC13, Pull::Up),
            #[cfg(feature = "field-log")]
            journal,
            program: program::Check::new(p.CRC),
            crystal,
            #[cfg(feature = "inputs")]
            chip: Chip::start(p.ADC1),
        }
    }

    /// The newest valid image of the two sectors, or the compiled-in default.
    pub fn calibration(&self) -> Loaded {
        let found = sectors::newest(self.sectors.view(Sector::A), self.sectors.view(Sector::B), maintain::KEY);
        let mut status = UnitStatus::empty();
        if let Some(error) = found.refused {
            defmt::error!("calibration refused: {}", error);
            status |= UnitStatus::IMAGE_REFUSED;
        }
        let cut_short = found.cut_short;
        let refused = found.newest.as_ref().and_then(|(c, _)| c.inputs_among(params::INPUTS).err());
        if let Some(error) = refused {
            defmt::error!("calibration refused: {}", error);
        }
        match found.newest {
            // It keeps its name and its number: the next image must be newer.
            Some((Calibration { unit, sequence, .. }, place)) if refused.is_some() => Loaded {
                calibration: Calibration { unit, sequence, ..Calibration::uncalibrated() },
                place: Some(place),
                checksum: 0,
                status: status | UnitStatus::DEFAULT_CALIBRATION | UnitStatus::IMAGE_REFUSED,
                cut_short,
            },
            Some((calibration, place)) => {
                let image = self.sectors.view(place.sector).get(place.offset as usize..);
                let checksum = image.and_then(sectors::stored_checksum).unwrap_or(0);
                Loaded { calibration, place: Some(place), checksum, status, cut_short }
            }
            None => Loaded {
                calibration: Calibration::uncalibrated(),
                place: None,
                checksum: 0,
                status: status | UnitStatus::DEFAULT_CALIBRATION,
                cut_short,
            },
        }
    }
}

/// The calibration in use.
pub struct Loaded {
    /// The calibration.
    pub calibration: Calibration,
    /// Place of the calibration in flash; `None`: it is the default.
    pub place: Option<Place>,
    /// Checksum of its image; 0: it is the default.
    pub checksum: u32,
    /// Flags to report of it.
    pub status: UnitStatus,
    /// Place of a burn that was cut short since.
    pub cut_short: Option<Place>,
}
