//! GPIO ports, SYSCFG's EXTI multiplexers, EXTI.

/// One port: plain registers, with BSRR acting on ODR.
#[derive(Debug, Default, Clone)]
pub struct Port {
    regs: [u32; 10],
    /// Levels driven from outside.
    pub input: u16,
}

const MODER: usize = 0;
const IDR: usize = 4;
const ODR: usize = 5;
const BSRR: usize = 6;

impl Port {
    pub fn read(&self, word: usize) -> Option<u32> {
        match word {
            IDR => {
                let mut level = 0u32;
                for pin in 0..16 {
                    let source =
                        if self.regs[MODER] >> (2 * pin) & 3 == 1 { self.regs[ODR] } else { u32::from(self.input) };
                    level |= source & (1 << pin);
                }
                Some(level)
            }
            BSRR => Some(0),
            n => self.regs.get(n).copied(),
        }
    }

    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        match word {
            BSRR => {
                self.regs[ODR] &= !(value >> 16);
                self.regs[ODR] |= value & 0xFFFF;
            }
            IDR => {}
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }

    /// Whether a pin is an output.
    pub fn is_output(&self, pin: usize) -> bool {
        self.regs[MODER] >> (2 * pin) & 3 == 1
    }

    /// The alternate function that a pin is given to.
    pub fn alternate(&self, pin: usize) -> Option<u32> {
        (self.regs[MODER] >> (2 * pin) & 3 == 2).then(|| self.regs[8 + pin / 8] >> (4 * (pin % 8)) & 0xF)
    }

    /// Level of a pin as an output.
    pub fn driven(&self, pin: usize) -> bool {
        self.regs[ODR] & (1 << pin) != 0
    }
}

/// SYSCFG: MEMRMP, PMC, EXTICR1-4, CMPCR, CFGR.
#[derive(Debug, Clone, Default)]
pub struct Syscfg {
    regs: [u32; 12],
}

impl Syscfg {
    pub fn read(&self, word: usize) -> Option<u32> {
        // CMPCR: the compensation cell is ready as soon as it is on.
        self.regs.get(word).map(|v| if word == 8 && v & 1 != 0 { v | 0x100 } else { *v })
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        *self.regs.get_mut(word)? = value;
        Some(())
    }
}

/// EXTI: IMR, EMR, RTSR, FTSR, SWIER, PR.
#[derive(Debug, Clone, Default)]
pub struct Exti {
    regs: [u32; 6],
}

impl Exti {
    pub fn read(&self, word: usize) -> Option<u32> {
        self.regs.get(word).copied()
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        match word {
            4 => self.regs[5] |= value & self.regs[0],
            5 => self.regs[5] &= !value,
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }
    /// Whether any of the lines of a mask asks for an interrupt.
    pub fn irq(&self, mask: u32) -> bool {
        self.regs[5] & self.regs[0] & mask != 0
    }
}
