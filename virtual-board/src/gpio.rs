//! GPIO ports, SYSCFG's EXTI multiplexers, EXTI.

/// One port: plain registers, with BSRR acting on ODR.
#[derive(Debug, Default, Clone)]
pub struct Port {
    regs: [u32; 10],
    /// Levels driven from outside, by pins that something is wired to.
    input: u16,
    wired: u16,
}

const MODER: usize = 0;
const OTYPER: usize = 1;
const OSPEEDR: usize = 2;
const PUPDR: usize = 3;
const AFRL: usize = 8;
const IDR: usize = 4;
const ODR: usize = 5;
const BSRR: usize = 6;

impl Port {
    pub fn read(&self, word: usize) -> Option<u32> {
        match word {
            IDR => {
                let level = |pin: usize| match self.mode(pin) {
                    1 => self.driven(pin),
                    // An analog pin reads 0 (RM0390 section 7.3.12).
                    3 => false,
                    _ => self.receives(pin),
                };
                Some((0..16).fold(0, |levels, pin| levels | u32::from(level(pin)) << pin))
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

    /// As a reset leaves it: port A (0) and B (1) have the debug port's pins (RM0390 section 7.4).
    pub fn of(port: usize) -> Self {
        let mut regs = [0; 10];
        (regs[MODER], regs[OSPEEDR], regs[PUPDR]) = match port {
            0 => (0xA800_0000, 0x0C00_0000, 0x6400_0000),
            1 => (0x0000_0280, 0x0000_00C0, 0x0000_0100),
            _ => (0, 0, 0),
        };
        Self { regs, input: 0, wired: 0 }
    }

    /// From outside a pin is driven to a level from now on; gives whether that is another one.
    pub fn drive(&mut self, pin: usize, high: bool) -> bool {
        let changed = self.receives(pin) != high;
        self.wired |= 1 << pin;
        self.input = self.input & !(1 << pin) | u16::from(high) << pin;
        changed
    }

    /// The level at a pin from outside, or of its pull where nothing is wired to it.
    pub fn receives(&self, pin: usize) -> bool {
        if self.wired & 1 << pin != 0 {
            self.input & 1 << pin != 0
        } else {
            self.pull(pin) == 1
        }
    }

    /// `true` if a pin is an output.
    pub fn is_output(&self, pin: usize) -> bool {
        self.mode(pin) == 1
    }

    /// Input, output, alternate function, analog.
    pub fn mode(&self, pin: usize) -> u32 {
        self.regs[MODER] >> (2 * pin) & 3
    }

    /// The number in AFR.
    pub fn function(&self, pin: usize) -> u32 {
        self.regs[AFRL + pin / 8] >> (4 * (pin % 8)) & 0xF
    }

    /// Open drain.
    pub fn open_drain(&self, pin: usize) -> bool {
        self.regs[OTYPER] & 1 << pin != 0
    }

    /// 0 is the lowest.
    pub fn speed(&self, pin: usize) -> u32 {
        self.regs[OSPEEDR] >> (2 * pin) & 3
    }

    /// None, up, down.
    pub fn pull(&self, pin: usize) -> u32 {
        self.regs[PUPDR] >> (2 * pin) & 3
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
    /// Another memory than the flash is at address 0 (MEMRMP, MEM_MODE).
    pub fn remapped(&self) -> bool {
        self.regs[0] & 7 != 0
    }
    /// The port that an EXTI line is connected to (EXTICR; RM0390 section 8.2.3).
    pub fn port_of(&self, line: usize) -> usize {
        (self.regs[2 + line / 4] >> (4 * (line % 4)) & 0xF) as usize
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
    /// An edge comes on a line (RM0390 section 10.2).
    pub fn edge(&mut self, line: usize, rising: bool) {
        self.regs[5] |= self.regs[if rising { 2 } else { 3 }] & 1 << line;
    }
    /// `true` if any of the lines of a mask asks for an interrupt.
    pub fn irq(&self, mask: u32) -> bool {
        self.regs[5] & self.regs[0] & mask != 0
    }
}
