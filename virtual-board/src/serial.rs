//! SPI1 and USART1. Both move their data by DMA in this firmware; a whole transfer is one event, at the time
//! its last bit is on the wire.

/// SPI: CR1, CR2, SR, DR, CRCPR, RXCRCR, TXCRCR, I2SCFGR, I2SPR.
#[derive(Debug, Clone, Default)]
pub struct Spi {
    regs: [u32; 9],
}

impl Spi {
    pub fn read(&self, word: usize) -> Option<u32> {
        match word {
            // SR: transmitter empty, not busy, nothing received: transfers are done by DMA in one event.
            2 => Some(2),
            n => self.regs.get(n).copied(),
        }
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        *self.regs.get_mut(word)? = value;
        Some(())
    }
    /// Enabled as master, with both DMA requests on.
    pub fn moving(&self) -> bool {
        self.regs[0] & 0x44 == 0x44 && self.regs[1] & 3 == 3
    }
    /// Cycles per byte.
    pub fn cycles_per_byte(&self) -> u64 {
        // APB2 is half the CPU clock.
        8 * 2 * (2u64 << ((self.regs[0] >> 3) & 7))
    }
}

/// USART: SR, DR, BRR, CR1, CR2, CR3, GTPR.
#[derive(Debug, Clone)]
pub struct Usart {
    regs: [u32; 7],
    /// SR was read: reading DR clears the error and idle flags.
    sr_read: bool,
}

impl Default for Usart {
    fn default() -> Self {
        Self { regs: [0xC0, 0, 0, 0, 0, 0, 0], sr_read: false }
    }
}

const RXNE: u32 = 1 << 5;
const IDLE: u32 = 1 << 4;
const ORE: u32 = 1 << 3;
const TC: u32 = 1 << 6;

impl Usart {
    pub fn read(&mut self, word: usize) -> Option<u32> {
        match word {
            0 => {
                self.sr_read = true;
                Some(self.regs[0])
            }
            1 => {
                self.regs[0] &= !RXNE;
                if self.sr_read {
                    self.regs[0] &= !(IDLE | ORE | 7);
                    self.sr_read = false;
                }
                Some(self.regs[1])
            }
            n => self.regs.get(n).copied(),
        }
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        match word {
            0 => self.regs[0] &= value | !(TC | RXNE),
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }
    pub fn transmitting(&self) -> bool {
        // Enabled, transmitter on, DMA to the transmitter.
        self.regs[3] & 0x2008 == 0x2008 && self.regs[5] & 0x80 != 0
    }
    pub fn receiving(&self) -> bool {
        self.regs[3] & 0x2004 == 0x2004
    }
    pub fn receives_by_dma(&self) -> bool {
        self.regs[5] & 0x40 != 0
    }
    /// Cycles per byte: start, eight data, stop.
    pub fn cycles_per_byte(&self) -> u64 {
        // APB2 is half the CPU clock; BRR is in its cycles per bit.
        10 * 2 * u64::from(self.regs[2].max(1))
    }
    /// A byte has come and nobody fetched the one before.
    pub fn received_by_hand(&mut self, byte: u8) {
        if self.regs[0] & RXNE != 0 {
            self.regs[0] |= ORE;
        }
        self.regs[1] = u32::from(byte);
        self.regs[0] |= RXNE;
    }
    pub fn idle(&mut self) {
        self.regs[0] |= IDLE;
    }
    pub fn transmitted(&mut self) {
        self.regs[0] |= TC;
    }
    pub fn irq(&self) -> bool {
        let (sr, cr1, cr3) = (self.regs[0], self.regs[3], self.regs[5]);
        let enabled = cr1 & 0x1F0;
        sr & enabled & 0x1F0 != 0 || (enabled & RXNE != 0 && sr & ORE != 0) || (cr3 & 1 != 0 && sr & (ORE | 6) != 0)
    }
}
