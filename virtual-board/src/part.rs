//! The chips that the board can carry, and what is wired to their pins.

use crate::dma::{Place, Request};
use crate::tables::{Pin, RccBit, Tables};
use std::sync::LazyLock;

/// Highest PCLK2 at which SPI1 takes the last bit of a byte right, by OSPEEDR of its clock's pin, Hz: in master mode it samples by the clock
/// that comes back from the pin (errata ES0298 section 2.14). The clock on the wire has no part in it.
pub const FED_BACK_MAX_HZ: [u64; 4] = [25_000_000, 75_000_000, 84_000_000, 84_000_000];

/// The table of the STM32F446RE.
pub(crate) const F446RE_TABLE: &str = include_str!("../chips/stm32f446re.txt");
/// The table of the STM32F405RG.
pub(crate) const F405RG_TABLE: &str = include_str!("../chips/stm32f405rg.txt");

/// Limits of a chip's clocks.
#[derive(Debug)]
pub struct ClockLimits {
    /// HCLK, Hz.
    pub ahb: u64,
    /// PCLK1, Hz.
    pub apb1: u64,
    /// PCLK2, Hz.
    pub apb2: u64,
    /// Bits of PWR_CR that set the voltage scale.
    pub scale_mask: u32,
    /// Values of these bits, with the highest HCLK that each allows, Hz; slowest first.
    pub scales: &'static [(u32, u64)],
    /// HCLK above which over-drive is needed, Hz; `None`: the chip has none.
    pub over_drive_above: Option<u64>,
    /// HCLK for each number of wait states of the flash at 2.7 to 3.6 V, Hz.
    pub per_wait_state: u64,
    /// Source of these limits in the manual.
    pub manual: &'static str,
}

/// Wiring of the pins.
#[derive(Debug)]
pub struct Wiring {
    /// The resonators.
    pub resonators: [Pin; 3],
    /// The ADC's data-ready.
    pub data_ready: Pin,
    /// Pulses per second.
    pub pulse: Pin,
    /// The sample mark.
    pub mark: Pin,
    /// The ADC's clock.
    pub clock: Pin,
    /// From the ADC.
    pub from_adc: Pin,
    /// To the ADC.
    pub to_adc: Pin,
    /// The ADC's chip select.
    pub select: Pin,
    /// The ADC's SYNC/RESET.
    pub reset: Pin,
    /// The link, out of the chip.
    pub link_out: Pin,
    /// The link, into the chip.
    pub link_in: Pin,
}

/// A chip on the board.
#[derive(Debug)]
pub struct Part {
    /// `STM32F446RE`.
    pub name: &'static str,
    /// Its tables.
    pub tables: LazyLock<Tables>,
    /// DBGMCU_IDCODE.
    pub id: u32,
    /// Its clocks.
    pub clocks: ClockLimits,
    /// The reference manual.
    pub manual: &'static str,
    /// Wiring of its pins (docs/bench.md).
    pub wiring: Wiring,
    /// Clock gate and reset of each kilobyte of peripherals from 0x4000 0000 on.
    gates: LazyLock<Vec<Option<Gate>>>,
    /// Places of the requests of [`Request::ALL`].
    requests: LazyLock<Vec<Vec<Place>>>,
}

/// Bits of RCC that hold a peripheral still: clock gate and reset.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gate {
    pub(crate) enable: Option<RccBit>,
    pub(crate) reset: Option<RccBit>,
}

fn gates(tables: &Tables) -> Vec<Option<Gate>> {
    let at = |k: u32| tables.peripherals.get(&(0x4000_0000 + 0x400 * k));
    (0..0x200).map(|k| at(k).map(|p| Gate { enable: p.enable, reset: p.reset })).collect()
}

fn requests(tables: &Tables) -> Vec<Vec<Place>> {
    Request::ALL.iter().map(|r| r.places(tables)).collect()
}

impl Part {
    /// TIM2 at the chip's highest clocks, Hz: twice APB1.
    #[must_use]
    pub fn timer_hz(&self) -> u64 {
        2 * self.clocks.apb1
    }

    pub(crate) fn gate(&self, address: u32) -> Option<Gate> {
        *self.gates.get((address.wrapping_sub(0x4000_0000) >> 10) as usize)?
    }

    pub(crate) fn places(&self, request: Request) -> &[Place] {
        &self.requests[request.index()]
    }
}

const WIRING: Wiring = Wiring {
    resonators: [Pin(0, 0), Pin(0, 1), Pin(1, 10)],
    data_ready: Pin(1, 2),
    pulse: Pin(2, 6),
    mark: Pin(2, 8),
    clock: Pin(0, 5),
    from_adc: Pin(0, 6),
    to_adc: Pin(0, 7),
    select: Pin(1, 6),
    reset: Pin(2, 7),
    link_out: Pin(0, 9),
    link_in: Pin(0, 10),
};

/// The STM32F446RE: RM0390 sections 3.4.1 (table 6), 5.1.3 and 6.2, data sheet table 17.
pub static STM32F446RE: Part = Part {
    name: "STM32F446RE",
    tables: LazyLock::new(|| Tables::parse(F446RE_TABLE)),
    id: 0x1000_6421,
    clocks: ClockLimits {
        ahb: 180_000_000,
        apb1: 45_000_000,
        apb2: 90_000_000,
        scale_mask: 3 << 14,
        scales: &[(1, 120_000_000), (2, 144_000_000), (3, 180_000_000)],
        over_drive_above: Some(168_000_000),
        per_wait_state: 30_000_000,
        manual: "RM0390 sections 3.4.1 and 5.1.3",
    },
    manual: "RM0390",
    wiring: WIRING,
    gates: LazyLock::new(|| gates(&STM32F446RE.tables)),
    requests: LazyLock::new(|| requests(&STM32F446RE.tables)),
};

/// The STM32F405RG: RM0090 sections 3.5.1 (table 10) and 5.1.4. TIM2 channel 4 is not at PB2.
pub static STM32F405RG: Part = Part {
    name: "STM32F405RG",
    tables: LazyLock::new(|| Tables::parse(F405RG_TABLE)),
    id: 0x1007_6413,
    clocks: ClockLimits {
        ahb: 168_000_000,
        apb1: 42_000_000,
        apb2: 84_000_000,
        scale_mask: 1 << 14,
        scales: &[(0, 144_000_000), (1, 168_000_000)],
        over_drive_above: None,
        per_wait_state: 30_000_000,
        manual: "RM0090 sections 3.5.1 and 5.1.4",
    },
    manual: "RM0090",
    wiring: Wiring { data_ready: Pin(0, 3), ..WIRING },
    gates: LazyLock::new(|| gates(&STM32F405RG.tables)),
    requests: LazyLock::new(|| requests(&STM32F405RG.tables)),
};
