//! SPI1 and USART1; SPI2 as a slave of SPI1, and UART5, where jumpers join them. All of them move their data by DMA in this firmware; a whole transfer is one event, at the time
//! its last bit is on the wire.

use crate::{LineFault, CPU_HZ};

/// Of the wire at the other end (docs/formats.md).
pub const LINE_BAUD: f64 = 921_600.0;

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
    /// Its clock, Hz, of PCLK2.
    pub fn hz(&self, pclk2: u64) -> u64 {
        pclk2 / (2 << (self.regs[0] >> 3 & 7))
    }
    /// The board's time per byte.
    pub fn time_per_byte(&self, pclk2: u64) -> u64 {
        8 * CPU_HZ / self.hz(pclk2).max(1)
    }
    /// Enabled.
    pub fn on(&self) -> bool {
        self.regs[0] & 0x40 != 0
    }
    /// Why it does not answer a master as its slave; `hz`: the master's clock, `pclk`: its own bus.
    pub fn unfit_as_slave(&self, master: &Self, hz: u64, pclk: u64) -> Option<&'static str> {
        let (cr1, cr2, i2s) = (self.regs[0], self.regs[1], self.regs[7]);
        let differs = |mask: u32| (cr1 ^ master.regs[0]) & mask != 0;
        [
            (i2s & 1 << 11 != 0, "I2SCFGR.I2SMOD makes it an I2S (RM0390 section 26.7.8)"),
            (cr1 & 4 != 0, "CR1.MSTR is 1: two masters drive the clock (RM0390 section 26.7.1)"),
            (
                differs(3),
                "CR1.CPHA and CPOL are not the master's: bits are taken where they change (RM0390 section 26.7.1)",
            ),
            (differs(1 << 7), "CR1.LSBFIRST is not the master's: bytes come mirrored (RM0390 section 26.7.1)"),
            (differs(1 << 11), "CR1.DFF is not the master's: frames of another length (RM0390 section 26.7.1)"),
            (cr1 & 1 << 9 != 0, "CR1.SSM is 1: it does not look at NSS (RM0390 section 26.7.1)"),
            (cr1 & 1 << 10 != 0, "CR1.RXONLY is 1: it sends nothing (RM0390 section 26.7.1)"),
            (cr1 & 1 << 13 != 0, "CR1.CRCEN is 1: it appends its own CRC (RM0390 section 26.7.1)"),
            (cr1 & 1 << 15 != 0, "CR1.BIDIMODE is 1: one line for both directions (RM0390 section 26.7.1)"),
            (cr2 & 1 << 4 != 0, "CR2.FRF is 1: TI frames (RM0390 section 26.7.2)"),
            (cr2 & 3 != 3, "CR2 has RXDMAEN or TXDMAEN off: no stream serves it (RM0390 section 26.7.2)"),
            (2 * hz > pclk, "the master's clock is faster than half of PCLK1 (data sheet, SPI characteristics)"),
        ]
        .into_iter()
        .find_map(|(unfit, what)| unfit.then_some(what))
    }
    /// First setting that the ADC (mode 1, most significant bit first, full duplex) does not understand.
    pub fn unfit(&self) -> Option<&'static str> {
        let (cr1, cr2, i2s) = (self.regs[0], self.regs[1], self.regs[7]);
        [
            (i2s & 1 << 11 != 0, "I2SCFGR.I2SMOD makes it an I2S (RM0390 section 26.7.8)"),
            (cr1 & 1 == 0, "CR1.CPHA is 0: data are taken at the first edge, and the ADC shifts there: SPI mode 1 is needed (RM0390 section 26.7.1; SBAS950 section 8.5.1)"),
            (cr1 & 2 != 0, "CR1.CPOL is 1: the clock idles high, and SPI mode 1 is needed (RM0390 section 26.7.1; SBAS950 section 8.5.1)"),
            (cr1 & 1 << 7 != 0, "CR1.LSBFIRST is 1: bytes come mirrored, the ADC has its most significant bit first (RM0390 section 26.7.1; SBAS950 section 8.5.1)"),
            (cr1 & 3 << 8 != 3 << 8, "CR1.SSM and SSI must be 1, or NSS low ends the master's mode: MODF (RM0390 section 26.7.1)"),
            (cr1 & 1 << 10 != 0, "CR1.RXONLY is 1: nothing is sent to the ADC (RM0390 section 26.7.1)"),
            (cr1 & 1 << 11 != 0, "CR1.DFF is 1: frames of 16 bits, and the streams move bytes (RM0390 section 26.7.1)"),
            (cr1 & 1 << 13 != 0, "CR1.CRCEN is 1: the SPI appends its own CRC (RM0390 section 26.7.1)"),
            (cr1 & 1 << 15 != 0, "CR1.BIDIMODE is 1: one line for both directions (RM0390 section 26.7.1)"),
            (cr2 & 1 << 4 != 0, "CR2.FRF is 1: TI frames (RM0390 section 26.7.2)"),
        ]
        .into_iter()
        .find_map(|(unfit, what)| unfit.then_some(what))
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
    /// `true` if the receiver is on: CR1.UE and CR1.RE.
    pub fn receives(&self) -> bool {
        let on = 1 << 13 | 1 << 2;
        self.regs[3] & on == on
    }

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
    /// Baud that BRR makes of PCLK2 (RM0390 section 25.4.4).
    pub fn baud(&self, pclk2: u64) -> f64 {
        let brr = self.regs[2] & 0xFFFF;
        let usart_div = if self.regs[3] & 1 << 15 != 0 { (brr >> 4) * 8 + (brr & 7) } else { brr };
        pclk2 as f64 / f64::from(usart_div.max(1))
    }
    /// The board's time per byte: start, eight data, stop.
    pub fn time_per_byte(&self, pclk2: u64) -> u64 {
        (10.0 * CPU_HZ as f64 / self.baud(pclk2)) as u64
    }
    /// First setting that does not fit the wire (eight data bits, no parity, one stop bit).
    pub fn unfit(&self, out: bool) -> Option<&'static str> {
        let (cr1, cr2, cr3) = (self.regs[3], self.regs[4], self.regs[5]);
        [
            (
                cr1 & 1 << 12 != 0,
                "CR1.M is 1: nine data bits, and the wire has eight: framing errors (RM0390 section 25.6.4)",
            ),
            (cr1 & 1 << 10 != 0, "CR1.PCE is 1: the last data bit is a parity bit (RM0390 section 25.6.4)"),
            (out && cr1 & 1 != 0, "CR1.SBK is 1: it sends breaks (RM0390 section 25.6.4)"),
            (!out && cr1 & 2 != 0, "CR1.RWU is 1: the receiver is mute (RM0390 section 25.6.4)"),
            (cr2 & 3 << 12 != 0, "CR2.STOP is not one stop bit (RM0390 section 25.6.5)"),
            (cr2 & 1 << 14 != 0, "CR2.LINEN is 1: LIN frames (RM0390 section 25.6.5)"),
            (cr3 & 1 << 1 != 0, "CR3.IREN is 1: pulses for infrared (RM0390 section 25.6.6)"),
            (cr3 & 1 << 3 != 0, "CR3.HDSEL is 1: RX is not connected (RM0390 section 25.6.6)"),
            (cr3 & 1 << 5 != 0, "CR3.SCEN is 1: smartcard mode (RM0390 section 25.6.6)"),
            (out && cr3 & 1 << 9 != 0, "CR3.CTSE is 1: it waits for CTS, which is not wired (RM0390 section 25.6.6)"),
        ]
        .into_iter()
        .find_map(|(unfit, what)| unfit.then_some(what))
    }
    /// A byte has come and nobody fetched the one before.
    pub fn received_by_hand(&mut self, byte: u8) {
        if self.regs[0] & RXNE != 0 {
            self.regs[0] |= ORE;
        }
        self.regs[1] = u32::from(byte);
        self.regs[0] |= RXNE;
    }
    /// The DMA takes a byte out of DR: after a look of the program at SR that clears what a read of its own would.
    pub fn taken_by_dma(&mut self) {
        if std::mem::take(&mut self.sr_read) {
            self.regs[0] &= !(IDLE | ORE | 7);
        }
    }
    /// Sets the error flag of the byte that has just come.
    pub fn fault(&mut self, fault: LineFault) {
        self.regs[0] |= match fault {
            LineFault::Noise => 1 << 2,
            LineFault::Framing => 1 << 1,
        };
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
