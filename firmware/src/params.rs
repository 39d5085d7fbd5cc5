//! Every number that shapes the unit's timing, wiring and memory, each with its unit and its reason.

use embassy_time::Duration;
use hrg_core::inputs::QuantitySet;
use hrg_core::timebase::Timebase;

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

/// The same as the core's time.
pub const TIMEBASE: Timebase = Timebase::at(TIMER_HZ);

/// Edges each capture ring holds. 256 at 10 kHz (twice any resonator) last 25 ms; they are fetched every
/// [`FETCH_PERIOD`].
pub const RING: usize = 256;

/// Period at which captured edges are fetched. Much shorter than the ring lasts and than a gate (0.1 s), and shorter
/// than [`hrg_core::rate_path::BIAS_DELAY_MS`] by enough to finish the bias in time.
pub const FETCH_PERIOD: Duration = Duration::from_millis(10);

/// Prescaler of the ADC's SPI clock, as BR of SPI_CR1: APB2 at 45 MHz / 4 = 11.25 MHz. The ADS131M08 takes 25 MHz; a frame of 30 bytes
/// takes 21 us, 2 % of the sample time. APB2 could run at 90 MHz, but SPI1 takes what it receives by its clock as the *pin* has it:
/// above 84 MHz of APB2 the last bit of a byte may be wrong, whatever the clock on the wire (errata ES0298 section 2.14).
pub const ADC_SPI_PRESCALER: u8 = 0b001;

/// Link rate, baud. A rate frame is 38 bytes of 10 bits on the wire: 380 kbit/s at 1 kHz; RS-422 carries 921600 over tens of metres.
pub const LINK_BAUD: u32 = 921_600;

/// Bytes of the link's receive ring: 5 ms at line rate.
pub const LINK_RING: usize = 512;

/// Rate frames and increments that may wait for the link: 20 ms where both come at 200 Hz.
pub const FRAME_QUEUE: usize = 8;

/// Accelerometers: at channels 3 to 5 of the ADC, or at 3 and 4 where channels 5 to 7 are other things.
pub const ACCELEROMETERS: u8 = if cfg!(any(feature = "aux", feature = "sensors")) { 2 } else { 3 };

/// The temperature sensors of a unit that has no resonators: feature `sensors`.
#[cfg(feature = "sensors")]
pub const SENSOR: hrg_core::sensors::Platinum = hrg_core::sensors::Platinum::PT1000;

/// Inputs beside the frequencies that come in to this unit, by the link: an image that needs another is refused. Take out what your
/// electronics do not send.
#[cfg(feature = "inputs")]
pub const INPUTS: QuantitySet = QuantitySet::all();
/// Inputs beside the frequencies: none.
#[cfg(not(feature = "inputs"))]
pub const INPUTS: QuantitySet = QuantitySet::empty();

/// Inputs at channels 5 to 7 of the ADC: what each is, with its scale.
#[cfg(feature = "aux")]
pub const AUX: [hrg_core::inputs::Channel; hrg_core::AXES] = hrg_core::inputs::Channel::DRIVES;

/// Messages with inputs that may wait until they are merged, each [`FETCH_PERIOD`]: a line at its full rate carries 18 of them meanwhile.
#[cfg(feature = "inputs")]
pub const INPUT_QUEUE: usize = 20;

/// Events that may wait to be written: more than can happen in a second.
#[cfg(feature = "field-log")]
pub const EVENT_QUEUE: usize = 8;

/// A time of the watchdog: prescaler (4 << it) and reload value, of the 32 kHz clock.
pub type Time = (u8, u16);

/// Watchdog while a sector is erased, as PR and RLR of the IWDG at 32 kHz: 256 / 32 kHz * 1000 = 8 s. The erase of 128 KiB
/// takes 2 s at most (STM32F446 data sheet, 32 bits at a time; 4 s byte by byte), and the processor stands still meanwhile: one bank of flash.
pub const WATCHDOG_ERASE: Time = (6, 1000);
/// Watchdog otherwise, the same way: 16 / 32 kHz * 1000 = 0.5 s. It is fed each [`hrg_core::supervision::LOOK_MS`] while all parts
/// run.
pub const WATCHDOG_USUAL: Time = (2, 1000);

/// Maintenance mode ends by itself after this long without a command: a host that went away leaves no open door.
pub const MAINTENANCE_IDLE: Duration = Duration::from_secs(120);
/// From the answer to a restart to the restart: a frame of 30 bytes takes 0.3 ms.
pub const RESTART_WAIT: Duration = Duration::from_millis(20);
