//! The DMA controllers: streams, their requests, and what a stream must be set to for each.

use crate::tables::Tables;

/// A DMA request that a peripheral makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    Tim2(usize),
    Spi1Rx,
    Spi1Tx,
    Usart1Rx,
    Usart1Tx,
    Spi2Rx,
    Spi2Tx,
    Uart5Rx,
    Uart5Tx,
}

/// Place that serves a request: controller (0 is DMA1), stream, channel.
pub type Place = (usize, usize, u32);

impl Request {
    /// All of them, in the order of [`index`](Self::index).
    pub const ALL: [Self; 12] = [
        Self::Tim2(0),
        Self::Tim2(1),
        Self::Tim2(2),
        Self::Tim2(3),
        Self::Spi1Rx,
        Self::Spi1Tx,
        Self::Usart1Rx,
        Self::Usart1Tx,
        Self::Spi2Rx,
        Self::Spi2Tx,
        Self::Uart5Rx,
        Self::Uart5Tx,
    ];

    /// Its place in lists.
    pub fn index(self) -> usize {
        match self {
            Self::Tim2(n) => n,
            Self::Spi1Rx => 4,
            Self::Spi1Tx => 5,
            Self::Usart1Rx => 6,
            Self::Usart1Tx => 7,
            Self::Spi2Rx => 8,
            Self::Spi2Tx => 9,
            Self::Uart5Rx => 10,
            Self::Uart5Tx => 11,
        }
    }

    /// Its name in the tables.
    pub fn signal(self) -> String {
        match self {
            Self::Tim2(n) => format!("TIM2_CH{}", n + 1),
            Self::Spi1Rx => "SPI1_RX".into(),
            Self::Spi1Tx => "SPI1_TX".into(),
            Self::Usart1Rx => "USART1_RX".into(),
            Self::Usart1Tx => "USART1_TX".into(),
            Self::Spi2Rx => "SPI2_RX".into(),
            Self::Spi2Tx => "SPI2_TX".into(),
            Self::Uart5Rx => "UART5_RX".into(),
            Self::Uart5Tx => "UART5_TX".into(),
        }
    }

    /// Its places by the tables of a chip.
    pub fn places(self, tables: &Tables) -> Vec<Place> {
        let signal = self.signal();
        tables.dma.iter().filter(|d| d.signal == signal).map(|d| (d.controller, d.stream, d.channel)).collect()
    }

    /// The register that is read or written, the width of an item (PSIZE), and whether data go to the peripheral.
    fn data(self) -> (u32, u32, bool) {
        match self {
            Self::Tim2(n) => (0x4000_0034 + 4 * n as u32, 2, false),
            Self::Spi1Rx => (0x4001_300C, 0, false),
            Self::Spi1Tx => (0x4001_300C, 0, true),
            Self::Usart1Rx => (0x4001_1004, 0, false),
            Self::Usart1Tx => (0x4001_1004, 0, true),
            Self::Spi2Rx => (0x4000_380C, 0, false),
            Self::Spi2Tx => (0x4000_380C, 0, true),
            Self::Uart5Rx => (0x4000_5004, 0, false),
            Self::Uart5Tx => (0x4000_5004, 0, true),
        }
    }
}

/// One DMA stream.
#[derive(Debug, Default, Clone)]
pub struct Stream {
    pub cr: u32,
    pub ndtr: u32,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    /// Value written to NDTR last.
    pub reload: u32,
    /// Its transfer was stopped half way, and NDTR has not been written since.
    interrupted: bool,
}

impl Stream {
    pub fn enabled(&self) -> bool {
        self.cr & 1 != 0
    }
    /// Memory address of the next item.
    pub fn memory(&self) -> u32 {
        if self.cr & (1 << 10) != 0 {
            // In direct mode the memory's width is the peripheral's (RM0390 section 9.5.5).
            self.m0ar.wrapping_add(self.reload.wrapping_sub(self.ndtr).wrapping_mul(1 << (self.cr >> 11 & 3)))
        } else {
            self.m0ar
        }
    }

    /// First setting that the chip does not support, or that is not modelled.
    fn strange(&self) -> Option<&'static str> {
        [
            (self.cr & 1 << 5 != 0, "PFCTRL: the peripheral ends the transfer, which SPI, USART and timers cannot"),
            (self.cr & 1 << 9 != 0, "PINC: the address of the peripheral goes on with each item"),
            (self.cr & 1 << 18 != 0, "DBM: two buffers, which is not modelled"),
            (self.cr >> 6 & 3 > 1, "DIR: memory to memory"),
            (self.cr >> 11 & 3 == 3, "PSIZE = 3 is reserved"),
            (self.cr & 1 << 10 == 0, "no MINC: every item goes to the same place in memory"),
            (self.cr & 0xF010_0000 != 0, "a reserved bit"),
            (self.fcr & 1 << 7 != 0, "FEIE: in direct mode an item that comes late raises FEIF, which nobody clears"),
            (self.fcr & 4 != 0, "DMDIS: items wait in the FIFO, which is not modelled"),
            (self.m0ar & ((1 << (self.cr >> 11 & 3)) - 1) != 0, "M0AR is not aligned to the items"),
            (self.ndtr == 0, "NDTR = 0: there is nothing to move"),
        ]
        .into_iter()
        .find_map(|(strange, what)| strange.then_some(what))
    }

    /// Why it does not serve a request as this needs it.
    pub fn unfit(&self, request: Request) -> Option<String> {
        let (register, width, out) = request.data();
        if let Some(what) = self.strange() {
            return Some(what.into());
        }
        if self.par != register {
            return Some(format!("PAR is {:#010x}, and the register is at {register:#010x}", self.par));
        }
        if (self.cr >> 6 & 1 == 1) != out {
            return Some("DIR is the other direction".into());
        }
        (self.cr >> 11 & 3 != width).then(|| format!("PSIZE = {} is not the width of the register", self.cr >> 11 & 3))
    }
}

const FLAG_AT: [u32; 4] = [0, 6, 16, 22];
const TRANSFER_ERROR: u32 = 1 << 3;
pub const HALF: u32 = 1 << 4;
pub const COMPLETE: u32 = 1 << 5;

/// One DMA controller.
#[derive(Debug, Default, Clone)]
pub struct Dma {
    isr: [u32; 2],
    pub streams: [Stream; 8],
}

impl Dma {
    pub fn raise(&mut self, n: usize, flags: u32) {
        self.isr[n / 4] |= flags << FLAG_AT[n % 4];
    }

    /// A stream's transfer has failed: TEIF, and it is off.
    pub fn fail(&mut self, n: usize) {
        self.raise(n, TRANSFER_ERROR);
        self.streams[n].cr &= !1;
    }

    /// Part of a write that the chip does not accept: the stream and the reason.
    pub fn refuses(&self, offset: u32, value: u32) -> Option<(usize, &'static str)> {
        let n = offset.checked_sub(0x10)? as usize / 0x18;
        let s = self.streams.get(n)?;
        // EN and the interrupts' enables are always open.
        const OPEN: u32 = 0x1F;
        let what = match (offset - 0x10) % 0x18 {
            0 if s.enabled() && value & 1 != 0 && (value ^ s.cr) & !OPEN != 0 => "CR cannot be changed while EN is 1",
            0 if !s.enabled() && value & 1 != 0 && self.isr[n / 4] >> FLAG_AT[n % 4] & 0x3D != 0 => {
                "EN is set while flags of the stream stand in LISR or HISR"
            }
            0 if !s.enabled() && value & 1 != 0 && s.interrupted => {
                "EN is set after a transfer that was stopped half way, without NDTR and M0AR written anew: the manual does not say where it goes on"
            }
            4 | 8 if s.enabled() => "NDTR and PAR cannot be written while EN is 1",
            0xC if s.enabled() => "M0AR cannot be written while EN is 1",
            _ => return None,
        };
        Some((n, what))
    }

    pub fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0 | 4 => self.isr[(offset / 4) as usize],
            8 | 0xC => 0,
            _ => {
                let s = self.streams.get(((offset - 0x10) / 0x18) as usize)?;
                match (offset - 0x10) % 0x18 {
                    0 => s.cr,
                    4 => s.ndtr,
                    8 => s.par,
                    0xC => s.m0ar,
                    0x10 => s.m1ar,
                    _ => s.fcr,
                }
            }
        })
    }

    pub fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0 | 4 => {}
            8 | 0xC => self.isr[(offset / 4 - 2) as usize] &= !value,
            _ => {
                let n = ((offset - 0x10) / 0x18) as usize;
                let s = self.streams.get_mut(n)?;
                match (offset - 0x10) % 0x18 {
                    0 => {
                        let was = s.enabled();
                        s.cr = value;
                        if was && !s.enabled() && s.ndtr > 0 {
                            s.interrupted = s.ndtr < s.reload;
                            self.raise(n, COMPLETE);
                        }
                    }
                    4 => {
                        s.ndtr = value & 0xFFFF;
                        s.reload = s.ndtr;
                        s.interrupted = false;
                    }
                    8 => s.par = value,
                    0xC => s.m0ar = value,
                    0x10 => s.m1ar = value,
                    _ => s.fcr = value,
                }
            }
        }
        Some(())
    }

    /// `true` if any stream has a flag set.
    pub fn speaks(&self) -> bool {
        self.isr != [0, 0]
    }

    pub fn irq(&self, n: usize) -> bool {
        let flags = self.isr[n / 4] >> FLAG_AT[n % 4];
        let cr = self.streams[n].cr;
        (flags & HALF != 0 && cr & 8 != 0)
            || (flags & COMPLETE != 0 && cr & 16 != 0)
            || (flags & TRANSFER_ERROR != 0 && cr & 4 != 0)
    }
}
