//! NVIC, SCB and SysTick registers, and which exception comes next.

/// Interrupt numbers of the STM32F446 that the modelled peripherals use.
pub mod irq {
    pub const DMA1_STREAM0: usize = 11;
    pub const EXTI9_5: usize = 23;
    pub const TIM2: usize = 28;
    pub const TIM3: usize = 29;
    pub const USART1: usize = 37;
    pub const EXTI15_10: usize = 40;
    pub const DMA1_STREAM7: usize = 47;
    pub const TIM5: usize = 50;
    pub const DMA2_STREAM0: usize = 56;
    pub const DMA2_STREAM5: usize = 68;
}

const LINES: usize = 97;

/// State of the interrupt controller.
#[derive(Debug, Clone)]
pub struct Nvic {
    enabled: [u32; 4],
    pending: [u32; 4],
    active: [u32; 4],
    priority: [u8; LINES],
    /// Level of each line, so that a line that is still high pends again on return.
    level: [u32; 4],
    vtor: u32,
    /// The table of vectors there has been looked at.
    pub vectors_judged: bool,
    scr: u32,
    ccr: u32,
    shpr: [u32; 3],
    shcsr: u32,
    /// CFSR, HFSR and BFAR: the last fault.
    pub fault: [u32; 3],
    cpacr: u32,
    fpccr: u32,
    /// AIRCR, PRIGROUP.
    group: u32,
    systick: [u32; 4],
    /// Exception numbers that are active, innermost last.
    pub stack: Vec<u16>,
    /// A reset was asked for (AIRCR).
    pub reset: bool,
    /// Something changed that may let an interrupt in.
    pub changed: bool,
}

impl Default for Nvic {
    fn default() -> Self {
        Self {
            enabled: [0; 4],
            pending: [0; 4],
            active: [0; 4],
            priority: [0; LINES],
            level: [0; 4],
            vtor: 0,
            vectors_judged: false,
            scr: 0,
            ccr: 0x200,
            shpr: [0; 3],
            shcsr: 0,
            fault: [0; 3],
            cpacr: 0,
            fpccr: 0xC000_0000,
            group: 0,
            systick: [0; 4],
            stack: Vec::new(),
            reset: false,
            changed: false,
        }
    }
}

impl Nvic {
    /// Sets the level of a peripheral's line; a rising one pends.
    pub fn line(&mut self, n: usize, high: bool) {
        let (w, bit) = (n / 32, 1u32 << (n % 32));
        if high {
            if self.level[w] & bit == 0 || self.active[w] & bit == 0 {
                self.pending[w] |= bit;
                self.changed = true;
            }
            self.level[w] |= bit;
        } else {
            self.level[w] &= !bit;
        }
    }

    /// Base of the vector table.
    pub fn vtor(&self) -> u32 {
        self.vtor
    }

    fn priority_of(&self, exception: u16) -> i16 {
        match exception {
            2 => -2,
            0..16 => -1,
            _ => i16::from(self.priority[usize::from(exception) - 16]),
        }
    }

    /// `true` if an enabled interrupt is pending, whatever its priority: it wakes a sleeping CPU.
    pub fn any_pending(&self) -> bool {
        (0..4).any(|w| self.pending[w] & self.enabled[w] != 0)
    }

    /// The interrupt to take now, as exception number, given PRIMASK and BASEPRI.
    pub fn next(&self, primask: bool, basepri: u8) -> Option<u16> {
        if primask || !self.any_pending() {
            return None;
        }
        let current = self.stack.iter().map(|&e| self.priority_of(e)).min().unwrap_or(256);
        let ceiling = if basepri == 0 { current } else { current.min(i16::from(basepri)) };
        let mut best: Option<(i16, u16)> = None;
        for w in 0..4 {
            let mut bits = self.pending[w] & self.enabled[w];
            while bits != 0 {
                let n = w * 32 + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                if n >= LINES {
                    continue;
                }
                let p = i16::from(self.priority[n]);
                if p < ceiling && best.is_none_or(|(q, _)| p < q) {
                    best = Some((p, n as u16 + 16));
                }
            }
        }
        best.map(|(_, e)| e)
    }

    /// An exception is entered.
    pub fn enter(&mut self, exception: u16) {
        if let Some(n) = usize::from(exception).checked_sub(16) {
            self.pending[n / 32] &= !(1 << (n % 32));
            self.active[n / 32] |= 1 << (n % 32);
        }
        self.stack.push(exception);
    }

    /// The innermost exception returns.
    pub fn leave(&mut self) {
        if let Some(n) = self.stack.pop().and_then(|e| usize::from(e).checked_sub(16)) {
            let bit = 1 << (n % 32);
            self.active[n / 32] &= !bit;
            if self.level[n / 32] & bit != 0 {
                self.pending[n / 32] |= bit;
            }
        }
        self.changed = true;
    }

    /// First setting of the processor that must not be there when it sleeps for the first time: register and words.
    pub fn strange(&self) -> Option<&'static str> {
        [
            (self.scr & 4 != 0, "SCB_SCR.SLEEPDEEP makes WFE the stop mode: all clocks stop (RM0390 section 5.3.5)"),
            (
                self.scr & 2 != 0,
                "SCB_SCR.SLEEPONEXIT puts the processor to sleep at the end of each interrupt: what runs in thread mode does not go on (PM0214 section 4.4.6)",
            ),
            (
                self.group > 3,
                "SCB_AIRCR.PRIGROUP makes subpriorities of priorities: interrupts of different tasks do not preempt each other (PM0214 section 4.4.5)",
            ),
            (
                self.fpccr >> 31 == 0,
                "FPU_FPCCR.ASPEN is 0: interrupts do not save floating-point registers, and tasks overwrite each other's (PM0214 section 4.6.2)",
            ),
            (
                self.ccr & 0x18 != 0,
                "SCB_CCR.UNALIGN_TRP or DIV_0_TRP is 1: what the compiler takes for allowed is a usage fault (PM0214 section 4.4.7)",
            ),
            (
                self.vtor & 0x1FF != 0,
                "SCB_VTOR is not a multiple of 512, which a table of 113 vectors needs: others are fetched (PM0214 section 4.4.4)",
            ),
        ]
        .into_iter()
        .find_map(|(strange, what)| strange.then_some(what))
    }

    /// CPACR: CP10 and CP11 may be used.
    pub fn float_unit_on(&self) -> bool {
        matches!(self.cpacr >> 20 & 0xF, 0x5 | 0xF)
    }

    /// A line is high for a moment.
    pub fn pulse(&mut self, n: usize) {
        self.pending[n / 32] |= 1 << (n % 32);
        self.changed = true;
    }

    pub fn read(&self, address: u32) -> Option<u32> {
        let word = |base: u32| ((address - base) / 4) as usize;
        Some(match address {
            0xE000_E008 => 0, // ACTLR
            0xE000_E010..=0xE000_E01F => self.systick[word(0xE000_E010)],
            0xE000_E100..=0xE000_E10C => self.enabled[word(0xE000_E100)],
            0xE000_E180..=0xE000_E18C => self.enabled[word(0xE000_E180)],
            0xE000_E200..=0xE000_E20C => self.pending[word(0xE000_E200)],
            0xE000_E280..=0xE000_E28C => self.pending[word(0xE000_E280)],
            0xE000_E300..=0xE000_E30C => self.active[word(0xE000_E300)],
            0xE000_E400..=0xE000_E460 => {
                let at = (address - 0xE000_E400) as usize;
                (0..4).map(|k| u32::from(*self.priority.get(at + k).unwrap_or(&0)) << (8 * k)).sum()
            }
            0xE000_ED00 => 0x410F_C241, // CPUID: Cortex-M4 r0p1
            0xE000_ED04 => u32::from(self.stack.last().copied().unwrap_or(0)), // ICSR: VECTACTIVE
            0xE000_ED08 => self.vtor,
            0xE000_ED0C => 0xFA05_0000 | self.group << 8,
            0xE000_ED10 => self.scr,
            0xE000_ED14 => self.ccr,
            0xE000_ED18..=0xE000_ED20 => self.shpr[word(0xE000_ED18)],
            0xE000_ED24 => self.shcsr,
            0xE000_ED28 => self.fault[0],
            0xE000_ED2C => self.fault[1],
            0xE000_ED38 => self.fault[2],
            0xE000_ED30..=0xE000_ED3C => 0,
            0xE000_ED88 => self.cpacr,
            0xE000_EDF0 => 0, // DHCSR: no debugger
            0xE000_EF34 => self.fpccr,
            0xE000_EF38..=0xE000_EF3C => 0,
            _ => return None,
        })
    }

    pub fn write(&mut self, address: u32, value: u32, size: usize) -> Option<()> {
        let word = |base: u32| ((address - base) / 4) as usize;
        self.changed = true;
        match address {
            0xE000_E008 => {}
            0xE000_E010..=0xE000_E01F => {
                if address == 0xE000_E010 && value & 1 != 0 {
                    return None; // a running SysTick is not modelled
                }
                self.systick[word(0xE000_E010)] = value;
            }
            0xE000_E100..=0xE000_E10C => self.enabled[word(0xE000_E100)] |= value,
            0xE000_E180..=0xE000_E18C => self.enabled[word(0xE000_E180)] &= !value,
            0xE000_E200..=0xE000_E20C => self.pending[word(0xE000_E200)] |= value,
            0xE000_E280..=0xE000_E28C => {
                let w = word(0xE000_E280);
                // A line that is high pends again at once.
                self.pending[w] &= !value | self.level[w];
            }
            0xE000_E400..=0xE000_E460 => {
                let at = (address - 0xE000_E400) as usize;
                for k in 0..size {
                    if let Some(p) = self.priority.get_mut(at + k) {
                        *p = (value >> (8 * k)) as u8 & 0xF0;
                    }
                }
            }
            0xE000_ED04 => {
                // ICSR: nothing but SysTick and PendSV, which are not used.
                if value & 0x1600_0000 != 0 {
                    return None;
                }
            }
            0xE000_ED08 => (self.vtor, self.vectors_judged) = (value, false),
            // Without its key a write is lost.
            0xE000_ED0C if value >> 16 != 0x05FA => {}
            // VECTRESET and VECTCLRACTIVE are for a debugger.
            0xE000_ED0C if value & 3 != 0 => return None,
            0xE000_ED0C => {
                self.reset |= value & 4 != 0;
                self.group = value >> 8 & 7;
            }
            0xE000_ED10 => self.scr = value,
            0xE000_ED14 => self.ccr = value,
            0xE000_ED18..=0xE000_ED20 => self.shpr[word(0xE000_ED18)] = value,
            0xE000_ED24 => self.shcsr = value,
            // A one clears.
            0xE000_ED28 => self.fault[0] &= !value,
            0xE000_ED2C => self.fault[1] &= !value,
            0xE000_ED30..=0xE000_ED3C => {}
            0xE000_ED88 => self.cpacr = value,
            0xE000_EF00 => {
                // STIR
                let n = (value & 0x1FF) as usize;
                *self.pending.get_mut(n / 32)? |= 1 << (n % 32);
            }
            0xE000_EF34 => self.fpccr = value,
            _ => return None,
        }
        Some(())
    }
}
