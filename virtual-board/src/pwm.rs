//! TIM1, TIM4, TIM8, TIM10 and TIM12 as sources of square waves: PWM mode 1, counting up, with every setting preloaded (RM0390 sections 16.3.11, 17.3.9
//! and 18.4.9). Anything else that they can do is not modelled, and ends the run.

use crate::clocks::{Clocks, Pace};

/// Address and features of a timer.
#[derive(Debug)]
pub struct Kind {
    pub name: &'static str,
    pub base: u32,
    /// Its outputs, as the tables name them.
    pub signals: &'static [&'static str],
    /// It has BDTR, and its outputs are off until MOE is set.
    advanced: bool,
    /// It is on APB2.
    fast: bool,
}

const fn kind(name: &'static str, base: u32, signals: &'static [&'static str], advanced: bool, fast: bool) -> Kind {
    Kind { name, base, signals, advanced, fast }
}

/// RM0390 table 1 and sections 16 to 18.
pub static KINDS: [Kind; 5] = [
    kind("TIM1", 0x4001_0000, &["TIM1_CH1", "TIM1_CH2", "TIM1_CH3", "TIM1_CH4"], true, true),
    kind("TIM8", 0x4001_0400, &["TIM8_CH1", "TIM8_CH2", "TIM8_CH3", "TIM8_CH4"], true, true),
    kind("TIM10", 0x4001_4400, &["TIM10_CH1"], false, true),
    kind("TIM4", 0x4000_0800, &["TIM4_CH1", "TIM4_CH2", "TIM4_CH3", "TIM4_CH4"], false, false),
    kind("TIM12", 0x4000_1800, &["TIM12_CH1", "TIM12_CH2"], false, false),
];

const CR1: usize = 0;
const SMCR: usize = 2;
const DIER: usize = 3;
const SR: usize = 4;
const EGR: usize = 5;
const CCMR1: usize = 6;
const CCER: usize = 8;
const CNT: usize = 9;
const PSC: usize = 10;
const ARR: usize = 11;
const RCR: usize = 12;
const CCR1: usize = 13;
const BDTR: usize = 17;
const CHANNELS: usize = 4;

/// The settings that count in the running period; those of the registers follow at its end.
#[derive(Debug, Clone, Copy, Default)]
struct Shadow {
    psc: u64,
    arr: u64,
    ccr: [u64; CHANNELS],
}

/// An output changes: its channel, and its new level.
pub type Change = (usize, bool);

/// One timer.
#[derive(Debug, Clone)]
pub struct Wave {
    pub kind: &'static Kind,
    regs: [u32; 0x54 / 4],
    pace: Pace,
    now: Shadow,
    /// Time at which the running period began, and the counter's reading while it is stopped.
    began: u64,
    held: u64,
    level: [bool; CHANNELS],
}

impl Wave {
    pub fn new(kind: &'static Kind) -> Self {
        let mut regs = [0; 0x54 / 4];
        regs[ARR] = 0xFFFF;
        let now = Shadow { arr: 0xFFFF, ..Shadow::default() };
        Self { kind, regs, pace: Pace::of(Clocks::RESET.hclk), now, began: 0, held: 0, level: [false; CHANNELS] }
    }

    /// As RCC sets its clock.
    pub fn set_clock(&mut self, clocks: &Clocks, now: u64) {
        let pace = Pace::of(if self.kind.fast { clocks.timers2 } else { clocks.timers });
        if pace != self.pace {
            let count = self.count(now);
            self.pace = pace;
            self.begin(count, now);
        }
    }

    fn running(&self) -> bool {
        self.regs[CR1] & 1 != 0
    }

    fn begin(&mut self, count: u64, now: u64) {
        self.held = count;
        self.began = now.saturating_sub(self.after(count));
    }

    /// Time that so many counts take.
    fn after(&self, counts: u64) -> u64 {
        self.pace.time_of(counts * (self.now.psc + 1))
    }

    fn count(&self, now: u64) -> u64 {
        if self.running() {
            (self.pace.ticks_in(now.saturating_sub(self.began)) / (self.now.psc + 1)).min(self.now.arr)
        } else {
            self.held
        }
    }

    /// An update event: the registers count from now on.
    fn update(&mut self, now: u64) {
        self.now.psc = u64::from(self.regs[PSC] & 0xFFFF);
        self.now.arr = u64::from(self.regs[ARR] & 0xFFFF);
        self.now.ccr = std::array::from_fn(|k| u64::from(self.regs[CCR1 + k] & 0xFFFF));
        self.held = 0;
        self.began = now;
    }

    pub fn read(&self, word: usize, now: u64) -> Option<u32> {
        match word {
            CNT => Some(self.count(now) as u32),
            EGR => Some(0),
            n => self.regs.get(n).copied(),
        }
    }

    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        match word {
            CR1 => {
                let (was, count) = (self.running(), self.count(now));
                self.regs[CR1] = value;
                if was != self.running() {
                    self.begin(count, now);
                }
            }
            SR => self.regs[SR] &= value,
            EGR if value & 1 != 0 => {
                self.update(now);
                self.regs[SR] |= 1;
            }
            EGR => {}
            CNT => self.begin(u64::from(value & 0xFFFF), now),
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }

    fn on(&self, channel: usize) -> bool {
        channel < self.kind.signals.len() && self.regs[CCER] >> (4 * channel) & 1 != 0
    }

    /// First setting while it runs that is not modelled, or gives no square wave: register and words.
    pub fn strange(&self) -> Option<&'static str> {
        let r = &self.regs;
        let mode = |k: usize| r[CCMR1 + k / 2] >> (8 * (k % 2)) & 0xFF;
        let on = || (0..self.kind.signals.len()).filter(|k| self.on(*k));
        if !self.running() {
            return None;
        }
        [
            (r[CR1] & 0x78 != 0, "CR1 has OPM, DIR or CMS: it stops at its end, or counts down"),
            (r[CR1] & 2 != 0, "CR1 has UDIS: its settings never take effect"),
            (r[CR1] & 1 << 7 == 0, "CR1 has no ARPE: a new ARR counts at once, which is not modelled"),
            (r[DIER] != 0, "DIER asks for interrupts or DMA, which are not modelled"),
            (r[SMCR] != 0, "SMCR has another clock, or a trigger"),
            (self.kind.advanced && r[RCR] != 0, "RCR is not 0: settings take effect only each so many periods"),
            (on().any(|k| mode(k) & 3 != 0), "CCMR.CCS makes an input of an output"),
            (on().any(|k| mode(k) >> 4 & 7 != 6), "CCMR.OCM is not PWM mode 1"),
            (on().any(|k| mode(k) & 8 == 0), "CCMR has no OCPE: a new CCR counts at once, which is not modelled"),
            (on().any(|k| r[CCER] >> (4 * k) & 0xE != 0), "CCER has CCP, CCNE or CCNP: an inverted or a second output"),
            (
                self.kind.advanced && on().next().is_some() && r[BDTR] & 1 << 15 == 0,
                "BDTR.MOE is 0: its outputs are off",
            ),
        ]
        .into_iter()
        .find_map(|(strange, what)| strange.then_some(what))
    }

    /// Time at which the next output changes, or the period ends.
    pub fn next_event(&self) -> u64 {
        if !self.running() || self.regs[CCER] == 0 {
            return u64::MAX;
        }
        let falls = (0..CHANNELS).filter(|k| self.level[*k]).map(|k| self.began + self.after(self.now.ccr[k]));
        falls.fold(self.began + self.after(self.now.arr + 1), u64::min)
    }

    /// Carries out the event at the time of [`next_event`](Self::next_event).
    pub fn advance(&mut self) -> [Option<Change>; CHANNELS] {
        let at = self.next_event();
        let ends = at == self.began + self.after(self.now.arr + 1);
        if ends {
            self.update(at);
            self.regs[SR] |= 1;
        }
        let mut changes = [None; CHANNELS];
        for k in 0..CHANNELS {
            let high = self.on(k) && at < self.began + self.after(self.now.ccr[k]);
            if high != self.level[k] {
                self.level[k] = high;
                changes[k] = Some((k, high));
            }
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CPU_HZ;

    fn wave(psc: u32, arr: u32, ccr: u32) -> Wave {
        let mut w = Wave::new(&KINDS[0]);
        let clocks = Clocks { hclk: CPU_HZ, pclk1: 1, pclk2: 1, timers: CPU_HZ / 2, timers2: CPU_HZ };
        w.set_clock(&clocks, 0);
        for (word, value) in [(PSC, psc), (ARR, arr), (CCR1, ccr), (CCMR1, 0x68), (CCER, 1), (BDTR, 1 << 15), (EGR, 1)]
        {
            w.write(word, value, 10);
        }
        w
    }

    #[test]
    fn edges_come_where_the_counter_says_and_a_new_period_at_the_end_of_the_old() {
        let mut w = wave(1, 99, 30);
        w.write(CR1, 0x81, 1000);
        assert_eq!(w.strange(), None);
        let mut seen = Vec::new();
        for k in 0..5 {
            seen.push((w.next_event(), w.advance()[0]));
            if k == 1 {
                w.write(ARR, 109, w.next_event() - 1);
            }
        }
        let (up, down) = (Some((0, true)), Some((0, false)));
        // The first period has no edge at its beginning: the counter stood there before.
        assert_eq!(seen, [(1200, up), (1260, down), (1400, up), (1460, down), (1620, up)]);
    }

    #[test]
    fn outputs_of_an_advanced_timer_are_off_without_moe() {
        let mut w = wave(0, 99, 30);
        w.write(BDTR, 0, 0);
        w.write(CR1, 0x81, 0);
        assert!(w.strange().is_some_and(|s| s.starts_with("BDTR.MOE")));
    }
}
