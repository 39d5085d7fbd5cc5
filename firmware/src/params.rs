//! Every number that shapes the unit's timing, wiring and memory, each with its unit and its reason.

use embassy_time::Duration;

/// Crystal or ST-LINK clock, Hz. A NUCLEO-F446RE feeds 8 MHz into OSC_IN.
pub const HSE_HZ: u32 = 8_000_000;

/// Multiplier of the PLL: [`HSE_HZ`] / 4 * this / 2 is the clock of the processor, 180 MHz.
#[cfg(not(feature = "stm32f405rg"))]
pub const PLL_MUL: u16 = 180;
/// Multiplier of the PLL: the STM32F405 goes up to 168 MHz.
#[cfg(feature = "stm32f405rg")]
pub const PLL_MUL: u16 = 168;

/// Clock of TIM2, Hz: twice APB1 (a quarter of the processor's clock), as APB1 is divided. At 90 MHz one tick is 11.1 ns.
pub const TIMER_HZ: u32 = HSE_HZ / 4 * PLL_MUL as u32 / 4;

/// Pin of TIM2 channel 4, which stamps the converter's data-ready edge.
#[cfg(not(feature = "stm32f405rg"))]
pub type DataReady = embassy_stm32::peripherals::PB2;
/// Pin of TIM2 channel 4: the STM32F405 has it on PA3, not on PB2.
#[cfg(feature = "stm32f405rg")]
pub type DataReady = embassy_stm32::peripherals::PA3;

/// Edges each capture ring holds. 256 at 10 kHz (twice any resonator) last 25 ms; they are fetched every
/// [`FETCH_PERIOD`].
pub const RING: usize = 256;

/// How often captured edges are fetched. Much shorter than the ring lasts and than a gate (0.1 s), and
/// shorter than [`hrg_core::rate_path::BIAS_DELAY_TICKS`] by enough to finish the bias in time.
pub const FETCH_PERIOD: Duration = Duration::from_millis(10);

/// Divider of the converter's SPI clock, as BR of SPI_CR1: 90 MHz / 8 = 11.25 MHz. The ADS131M08 takes 25 MHz; a
/// frame of 30 bytes takes 21 us, 2 % of the sample time, and the lines may be long.
pub const CONVERTER_SPI_DIVIDER: u8 = 0b010;

/// Link rate, baud. A rate frame is 35 bytes of 10 bits on the wire: 350 kbit/s at 1 kHz; RS-422 carries 921600 over tens of metres.
pub const LINK_BAUD: u32 = 921_600;

/// Bytes of the link's receive ring: 5 ms at line rate.
pub const LINK_RING: usize = 512;

/// Rate frames that may wait for the link: 40 ms at 200 Hz.
pub const FRAME_QUEUE: usize = 8;

/// So many frames dropped one after the other (1.25 s at 200 Hz) are no link that is busy, but one that has stopped taking them.
pub const DROPS_IN_A_ROW: u16 = 250;

/// Watchdog, us. The rate path runs each millisecond, the model each ten, and both are looked at each [`WATCHDOG_FEED`]; the
/// longest legitimate pause is none.
pub const WATCHDOG_US: u32 = 500_000;

/// Watchdog while a sector is erased, as PR and RLR of the IWDG at 32 kHz: 256 / 32 kHz * 1000 = 8 s. The erase of 128 KiB
/// takes 2 s at most (STM32F446 data sheet, word-wide), and the processor stands still meanwhile: one bank of flash.
pub const WATCHDOG_ERASE: (u8, u16) = (6, 1000);
/// Watchdog otherwise, the same way: as [`WATCHDOG_US`].
pub const WATCHDOG_USUAL: (u8, u16) = (2, 1000);

/// How often the watchdog is fed, if the rate path has run.
pub const WATCHDOG_FEED: Duration = Duration::from_millis(100);

/// The watchdog is not fed once link or telemetry, which speak at least each second, have been quiet for so many
/// [`WATCHDOG_FEED`]s.
pub const QUIET_FEEDS: u8 = 25;

/// The rates of a step come this long after its frequencies at most.
pub const SUMMARY_WAIT: Duration = Duration::from_millis(200);

/// Calibration sector A, bytes from the start of flash (memory.x: CAL_A).
pub const CALIBRATION_A: u32 = 0x4_0000;
/// Calibration sector B (memory.x: CAL_B).
pub const CALIBRATION_B: u32 = 0x6_0000;
/// Size of either sector, bytes.
pub const CALIBRATION_SIZE: u32 = 0x2_0000;
/// Maintenance mode ends by itself after this long without a command: a host that went away leaves no open door.
pub const MAINTENANCE_IDLE: Duration = Duration::from_secs(120);
/// From the answer to a restart to the restart: a frame of 30 bytes takes 0.3 ms.
pub const RESTART_WAIT: Duration = Duration::from_millis(20);
