//! TIM2 and TIM5: 32-bit counters at half the CPU clock with capture (TIM2) and compare (TIM5).

use crate::CYCLES_PER_TICK;

/// Registers by word offset: CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, CCR1-4, DCR,
/// DMAR, OR.
#[derive(Debug, Clone, Default)]
pub struct Timer {
    regs: [u32; 0x54 / 4],
    /// Cycle at which the counter would have been zero.
    zero: u64,
    /// Counter while stopped.
    held: u32,
    /// Compare and overflow have been looked at up to this cycle.
    looked: u64,
}

const CR1: usize = 0;
const DIER: usize = 3;
const SR: usize = 4;
const EGR: usize = 5;
const CCER: usize = 8;
const CNT: usize = 9;
const PSC: usize = 10;
const ARR: usize = 11;
const CCR1: usize = 13;

impl Timer {
    fn running(&self) -> bool {
        self.regs[CR1] & 1 != 0
    }

    fn cycles_per_count(&self) -> u64 {
        CYCLES_PER_TICK * (u64::from(self.regs[PSC]) + 1)
    }

    fn span(&self) -> u64 {
        u64::from(self.regs[ARR]) + 1
    }

    pub fn count(&self, now: u64) -> u32 {
        if self.running() {
            ((now.saturating_sub(self.zero) / self.cycles_per_count()) % self.span()) as u32
        } else {
            self.held
        }
    }

    pub fn read(&mut self, word: usize, now: u64) -> Option<u32> {
        Some(match word {
            CNT => self.count(now),
            EGR => 0,
            n if (CCR1..CCR1 + 4).contains(&n) => {
                // Reading a capture clears its flag.
                if self.is_capture(n - CCR1) {
                    self.regs[SR] &= !(2 << (n - CCR1));
                }
                self.regs[n]
            }
            n => *self.regs.get(n)?,
        })
    }

    fn is_capture(&self, channel: usize) -> bool {
        self.regs[6 + channel / 2] >> (8 * (channel % 2)) & 3 != 0
    }

    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        match word {
            CR1 => {
                let was = self.running();
                let count = self.count(now);
                self.regs[CR1] = value;
                if self.running() && !was {
                    self.zero = now - u64::from(self.held) * self.cycles_per_count();
                    self.looked = now;
                } else if was && !self.running() {
                    self.held = count;
                }
            }
            SR => self.regs[SR] &= value,
            EGR => {
                if value & 1 != 0 {
                    self.zero = now;
                    self.held = 0;
                    self.looked = now;
                    // URS set: no flag.
                    if self.regs[CR1] & 4 == 0 {
                        self.regs[SR] |= 1;
                    }
                }
            }
            CNT => {
                self.held = value;
                self.zero = now.saturating_sub(u64::from(value) * self.cycles_per_count());
            }
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }

    /// Whether its start is its trigger output (CR2, MMS = 1), and it runs.
    pub fn triggers_by_start(&self) -> bool {
        self.regs[1] >> 4 & 7 == 1 && self.running()
    }

    /// Whether it waits for internal trigger `n` to start (SMCR: SMS = 6).
    pub fn waits_for(&self, n: u32) -> bool {
        self.regs[2] & 7 == 6 && self.regs[2] >> 4 & 7 == n && !self.running()
    }

    /// Time of the next compare match or overflow that raises an enabled interrupt.
    pub fn next_event(&self) -> u64 {
        if !self.running() || self.regs[DIER] & 0x1F == 0 {
            return u64::MAX;
        }
        let per = self.cycles_per_count();
        let span = self.span() * per;
        let next = |at: u64| {
            // First time at or after `looked` at which the counter is `at`.
            let phase = self.zero + at * per;
            if phase >= self.looked {
                phase
            } else {
                phase + (self.looked - phase).div_ceil(span) * span
            }
        };
        let mut best = u64::MAX;
        if self.regs[DIER] & 1 != 0 {
            best = best.min(next(self.span()));
        }
        for ch in 0..4 {
            let at = u64::from(self.regs[CCR1 + ch]);
            if self.regs[DIER] & (2 << ch) != 0 && !self.is_capture(ch) && at < self.span() {
                best = best.min(next(at));
            }
        }
        best
    }

    /// Sets the flags of everything that happened up to and with `now`.
    pub fn advance(&mut self, now: u64) {
        if !self.running() || now < self.looked {
            return;
        }
        let per = self.cycles_per_count();
        let span = self.span() * per;
        let happened = |at: u64| {
            let phase = self.zero + at * per;
            let first = if phase >= self.looked { phase } else { phase + (self.looked - phase).div_ceil(span) * span };
            first <= now
        };
        let mut sr = self.regs[SR];
        if happened(self.span()) {
            sr |= 1;
        }
        for ch in 0..4 {
            let at = u64::from(self.regs[CCR1 + ch]);
            if !self.is_capture(ch) && at < self.span() && happened(at) {
                sr |= 2 << ch;
            }
        }
        self.regs[SR] = sr;
        self.looked = now + 1;
    }

    /// An edge at the input of a channel (0 to 3). Gives the stamp if the channel captures that edge, and
    /// whether it asks for DMA.
    pub fn edge(&mut self, channel: usize, rising: bool, at: u64) -> Option<(u32, bool)> {
        let ccer = self.regs[CCER] >> (4 * channel);
        let falling_wanted = ccer & 2 != 0;
        if !self.running() || ccer & 1 == 0 || !self.is_capture(channel) || rising == falling_wanted {
            return None;
        }
        let stamp = self.count(at);
        if self.regs[SR] & (2 << channel) != 0 {
            self.regs[SR] |= 0x200 << channel;
        }
        self.regs[CCR1 + channel] = stamp;
        self.regs[SR] |= 2 << channel;
        let dma = self.regs[DIER] & (0x200 << channel) != 0;
        if dma {
            // The DMA reads CCRx at once.
            self.regs[SR] &= !(2 << channel);
        }
        Some((stamp, dma))
    }

    /// What a channel captured last.
    pub fn capture(&self, channel: usize) -> u32 {
        self.regs[CCR1 + channel]
    }

    /// Whether the interrupt line is high.
    pub fn irq(&self) -> bool {
        self.regs[SR] & self.regs[DIER] & 0x1F != 0
    }
}
