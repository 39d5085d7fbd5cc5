//! TIM2, TIM3 and TIM5: counters on the clock of their bus, with capture (TIM2, TIM3) and compare (TIM5).

use crate::clocks::{Pace, HSI_HZ};

/// Registers by word offset: CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, CCR1-4, DCR,
/// DMAR, OR.
#[derive(Debug, Clone)]
pub struct Timer {
    regs: [u32; 0x54 / 4],
    /// The highest count: 16 bits or 32.
    top: u32,
    pace: Pace,
    /// The prescaler that counts; PSC is the next.
    prescaler: u32,
    /// Cycle at which the counter would have been zero.
    zero: i64,
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

const OR: usize = 20;
const CR2: usize = 1;
const SMCR: usize = 2;
const CCMR1: usize = 6;

/// Result of an edge at a timer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Captured {
    /// The counter.
    pub stamp: u32,
    /// It asks for DMA.
    pub dma: bool,
    /// It asks for an interrupt, too.
    pub interrupt: bool,
}

impl Default for Timer {
    fn default() -> Self {
        Self::new(u32::MAX)
    }
}

impl Timer {
    /// With a counter up to `top`.
    pub fn new(top: u32) -> Self {
        let mut regs = [0; 0x54 / 4];
        regs[ARR] = top;
        Self { regs, top, pace: Pace::of(HSI_HZ), prescaler: 0, zero: 0, held: 0, looked: 0 }
    }

    fn running(&self) -> bool {
        self.regs[CR1] & 1 != 0
    }

    /// Counts since the counter would have been zero.
    fn counts(&self, now: u64) -> u64 {
        self.pace.ticks_in((now as i64 - self.zero).max(0) as u64) / self.prescaler()
    }

    fn prescaler(&self) -> u64 {
        u64::from(self.prescaler) + 1
    }

    fn span(&self) -> u64 {
        u64::from(self.regs[ARR]) + 1
    }

    pub fn count(&self, now: u64) -> u32 {
        if self.running() {
            (self.counts(now) % self.span()) as u32
        } else {
            self.held
        }
    }

    /// The time at which the counter, in its `counts`-th count since zero, begins that count.
    fn time_of(&self, counts: u64) -> u64 {
        (self.zero + self.pace.time_of(counts * self.prescaler()) as i64).max(0) as u64
    }

    /// The counter shows `count` from now on.
    fn set_count(&mut self, count: u32, now: u64) {
        self.held = count;
        self.zero = now as i64 - self.pace.time_of(u64::from(count) * self.prescaler()) as i64;
        self.looked = now;
    }

    /// Its clock changes.
    pub fn set_pace(&mut self, pace: Pace, now: u64) {
        if pace != self.pace {
            let count = self.count(now);
            self.pace = pace;
            self.set_count(count, now);
        }
    }

    /// An update event: the prescaler that was written counts from now on (RM0390 section 17.4.11).
    fn update(&mut self, now: u64) {
        if self.regs[CR1] & 2 == 0 {
            self.prescaler = self.regs[PSC] & 0xFFFF;
            self.set_count(0, now);
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
        self.regs[CCMR1 + channel / 2] >> (8 * (channel % 2)) & 3 != 0
    }

    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        match word {
            CR1 => {
                let was = self.running();
                let count = self.count(now);
                self.regs[CR1] = value;
                if self.running() && !was {
                    self.set_count(self.held, now);
                } else if was && !self.running() {
                    self.held = count;
                }
            }
            SR => self.regs[SR] &= value,
            EGR => {
                if value & 1 != 0 {
                    self.set_count(0, now);
                    self.update(now);
                    // Neither UDIS nor URS: the flag.
                    if self.regs[CR1] & 6 == 0 {
                        self.regs[SR] |= 1;
                    }
                }
                for channel in (0..4).filter(|c| value & 2 << c != 0) {
                    if self.is_capture(channel) {
                        self.regs[CCR1 + channel] = self.count(now);
                    }
                    self.regs[SR] |= 2 << channel;
                }
                // TG: TIF.
                self.regs[SR] |= value & 0x40;
            }
            CNT => self.set_count(value & self.top, now),
            ARR => self.regs[ARR] = value & self.top,
            // A captured value cannot be written (RM0390 section 17.4.13).
            n if (CCR1..CCR1 + 4).contains(&n) && self.is_capture(n - CCR1) => {}
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }

    /// First setting that is not modelled, or makes no sense on this board: register and words.
    pub fn strange(&self) -> Option<&'static str> {
        let r = &self.regs;
        [
            (
                self.running() && r[CR1] & 0x78 != 0,
                "CR1 has OPM, DIR or CMS: the counter stops at its end, or counts down",
            ),
            (self.running() && r[CR1] & 0x300 != 0, "CR1 has CKD: the inputs are sampled more slowly"),
            (r[DIER] & 0x4140 != 0, "DIER has TIE, UDE or TDE: interrupts or DMA requests that nobody serves"),
            (r[SMCR] & 0xFF08 != 0, "SMCR has an external trigger or clock"),
            (r[CR2] & 0x80 != 0, "CR2 has TI1S: channel 1 takes the exclusive or of three pins"),
            (
                r[CR2] & 8 != 0 && r[DIER] & 0x1E00 != 0,
                "CR2 has CCDS: DMA requests come with update events, not with captures",
            ),
        ]
        .into_iter()
        .find_map(|(strange, what)| strange.then_some(what))
    }

    /// `true` if its start is its trigger output (CR2, MMS = 1), and it runs.
    pub fn triggers_by_start(&self) -> bool {
        self.regs[CR2] >> 4 & 7 == 1 && self.running()
    }

    /// `true` if it waits for internal trigger `n` to start (SMCR: SMS = 6).
    pub fn waits_for(&self, n: u32) -> bool {
        self.regs[SMCR] & 7 == 6 && self.regs[SMCR] >> 4 & 7 == n && !self.running()
    }

    /// A slave mode other than to wait for a start.
    pub fn enslaved(&self) -> bool {
        !matches!(self.regs[SMCR] & 7, 0 | 6)
    }

    /// First time at or after `looked` at which the counter begins to be `at`.
    fn next(&self, at: u64) -> u64 {
        let span = self.span();
        let seen = self.counts(self.looked);
        let turn = seen.saturating_sub(at) / span;
        (turn..).map(|k| self.time_of(at + k * span)).find(|t| *t >= self.looked).unwrap_or(u64::MAX)
    }

    /// Time of the next compare match or overflow that raises an enabled interrupt.
    pub fn next_event(&self) -> u64 {
        if !self.running() || self.regs[DIER] & 0x1F == 0 {
            return u64::MAX;
        }
        let mut best = u64::MAX;
        if self.regs[DIER] & 1 != 0 {
            best = best.min(self.next(self.span()));
        }
        for ch in 0..4 {
            let at = u64::from(self.regs[CCR1 + ch]);
            if self.regs[DIER] & (2 << ch) != 0 && !self.is_capture(ch) && at < self.span() {
                best = best.min(self.next(at));
            }
        }
        best
    }

    /// Sets the flags of everything that happened up to and with `now`.
    pub fn advance(&mut self, now: u64) {
        if !self.running() || now < self.looked {
            return;
        }
        let mut sr = self.regs[SR];
        let overflow = self.next(self.span()) <= now;
        if overflow && self.regs[CR1] & 2 == 0 {
            sr |= 1;
        }
        for ch in 0..4 {
            let at = u64::from(self.regs[CCR1 + ch]);
            if !self.is_capture(ch) && at < self.span() && self.next(at) <= now {
                sr |= 2 << ch;
            }
        }
        self.regs[SR] = sr;
        if overflow && self.regs[CR1] & 2 == 0 && self.prescaler != self.regs[PSC] & 0xFFFF {
            let count = self.count(now);
            self.prescaler = self.regs[PSC] & 0xFFFF;
            self.set_count(count, now);
        }
        self.looked = now + 1;
    }

    /// `true` if a channel (0 to 3) is on, and the timer runs.
    pub fn listens(&self, channel: usize) -> bool {
        self.running() && self.regs[CCER] >> (4 * channel) & 1 != 0
    }

    /// Why an edge at the pin of a channel that is on is not captured as such, if so.
    pub fn receives_nothing(&self, channel: usize, rising: bool) -> Option<&'static str> {
        let mode = self.regs[CCMR1 + channel / 2] >> (8 * (channel % 2));
        let polarity = self.regs[CCER] >> (4 * channel) & 0xA;
        match (mode & 3, mode >> 2 & 3, mode >> 4 & 0xF, polarity) {
            (0, ..) => Some("it is an output (CCMR.CCS = 0), and drives the wire"),
            (2, ..) => Some("it captures the input of its neighbour (CCMR.CCS = 2)"),
            (3, ..) => Some("it captures the internal trigger (CCMR.CCS = 3)"),
            (_, 1.., ..) => Some("it captures only some of the edges (CCMR.ICPSC)"),
            (_, _, 1.., _) => Some("its filter delays the edges (CCMR.ICF)"),
            (.., 8) => Some("CCER.CCNP without CCP is not allowed"),
            (.., 0xA) => Some("it captures both edges (CCER.CCNP and CCP)"),
            (.., p) => (rising == (p == 2)).then_some("it captures the other edge (CCER.CCP)"),
        }
    }

    /// Rising edges of LSI for each capture, if channel 4 captures LSI (TIM5_OR, TI4_RMP = 1).
    pub fn captures_lsi(&self) -> Option<u64> {
        let mode = self.regs[CCMR1 + 1] >> 8 & 0xFF;
        let rising = self.regs[CCER] >> 12 & 0xB == 1;
        (self.running() && rising && mode & 0xF3 == 1 && self.regs[OR] >> 6 & 3 == 1).then(|| 1 << (mode >> 2 & 3))
    }

    /// Counts by which a channel's filter delays an edge: samples that must agree, times the clocks between them (RM0390 section 17.4.7).
    fn filter_delay(&self, channel: usize) -> u32 {
        const DELAY: [u32; 16] = [0, 2, 4, 8, 12, 16, 24, 32, 48, 64, 80, 96, 128, 160, 192, 256];
        DELAY[(self.regs[CCMR1 + channel / 2] >> (8 * (channel % 2) + 4) & 0xF) as usize] / self.prescaler() as u32
    }

    /// `true` if a channel has no other fault than that its filter delays edges.
    pub fn filters(&self, channel: usize) -> bool {
        self.filter_delay(channel) > 0 && self.regs[CCMR1 + channel / 2] >> (8 * (channel % 2)) & 0xF == 1
    }

    /// An edge at the input of a channel that takes it (else [`receives_nothing`](Self::receives_nothing)).
    pub fn edge(&mut self, channel: usize, at: u64) -> Captured {
        let stamp = self.count(at).wrapping_add(self.filter_delay(channel));
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
        Captured { stamp, dma, interrupt: self.regs[DIER] & (2 << channel) != 0 }
    }

    /// Value that a channel captured last.
    pub fn capture(&self, channel: usize) -> u32 {
        self.regs[CCR1 + channel]
    }

    /// `true` if the interrupt line is high.
    pub fn irq(&self) -> bool {
        self.regs[SR] & self.regs[DIER] & 0x1F != 0
    }
}
