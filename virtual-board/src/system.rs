//! RCC, PWR, FLASH, IWDG, DBGMCU.

/// RCC: plain registers; oscillators and PLL are ready some time after they were switched on, the crystal only where there is one.
#[derive(Debug, Clone)]
pub struct Rcc {
    regs: [u32; 0x98 / 4],
    /// The crystal's frequency, Hz; `None`: it is dead.
    pub crystal_hz: Option<f64>,
    /// Time that it needs to start, in the board's time.
    pub crystal_start: u64,
    /// Times at which HSE, PLL and LSI are ready, if they are on and have what they need.
    ready: [u64; 3],
}

/// Of [`Rcc::ready`].
const HSE: usize = 0;
const PLL: usize = 1;
const LSI: usize = 2;

/// A crystal starts in 2 ms, typically; one of these oscillators is sooner (data sheet, HSE oscillator characteristics: t_SU(HSE)).
pub const CRYSTAL_START: u64 = crate::CPU_HZ / 500;
/// The longest that the PLL takes to lock: 300 us (data sheet, main PLL characteristics: t_LOCK).
const PLL_LOCK: u64 = crate::CPU_HZ * 3 / 10_000;
/// The longest that LSI takes to start: 40 us (data sheet, LSI oscillator characteristics: t_su(LSI)).
const LSI_START: u64 = crate::CPU_HZ * 4 / 100_000;

/// Of the board's crystal, Hz.
pub const CRYSTAL_HZ: f64 = 8e6;
/// Of the chip's own oscillator, Hz.
const HSI_HZ: f64 = 16e6;
/// RCC_CR: HSEON, HSERDY, HSEBYP, CSSON. RCC_CIR: CSSF, CSSC.
const HSE_ON: u32 = 1 << 16;
const HSE_READY: u32 = 1 << 17;
const PLL_READY: u32 = 1 << 25;
const HSE_BYPASS: u32 = 1 << 18;
const CSS_ON: u32 = 1 << 19;
const CSS_FLAG: u32 = 1 << 7;
const CSS_CLEAR: u32 = 1 << 23;

/// Reset causes of RCC_CSR.
pub const CSR_POWER_ON: u32 = 0x0E00_0000;
/// Watchdog reset (and pin reset, which always joins it).
pub const CSR_WATCHDOG: u32 = 0x2400_0000;
/// Software reset (and pin reset).
pub const CSR_SOFTWARE: u32 = 0x1400_0000;

impl Rcc {
    pub fn new(cause: u32) -> Self {
        let mut regs = [0; 0x98 / 4];
        regs[0] = 0x83;
        regs[1] = 0x2400_3010;
        // Clocks in sleep mode: all of them.
        regs[0x50 / 4..=0x64 / 4].fill(u32::MAX);
        // RTCAPBEN.
        regs[0x40 / 4] = 0x400;
        regs[0x74 / 4] = cause;
        Self { regs, crystal_hz: Some(CRYSTAL_HZ), crystal_start: CRYSTAL_START, ready: [u64::MAX; 3] }
    }
    /// Keeps the causes of earlier resets that nobody has cleared.
    pub fn add_causes(&mut self, before: &Self) {
        self.regs[0x74 / 4] |= before.regs[0x74 / 4] & 0xFE00_0000;
    }
    /// Clears them.
    pub fn clear_causes(&mut self) {
        self.regs[0x74 / 4] &= !0xFE00_0000;
    }
    /// AHB1ENR, BKPSRAMEN.
    pub fn backup_clocked(&self) -> bool {
        self.regs[0x30 / 4] & 1 << 18 != 0
    }
    /// Prescalers of APB1 and APB2 from the processor's clock (CFGR; RM0390 section 6.3.3).
    pub fn apb_prescalers(&self) -> [u64; 2] {
        [10, 13].map(|at| match self.regs[2] >> at & 7 {
            by @ 4.. => 1 << (by - 3),
            _ => 1,
        })
    }
    /// The board has an oscillator at OSC_IN, as a NUCLEO-F446RE has: HSE must be bypassed (RM0390 section 6.2.1).
    fn crystal_runs(&self) -> bool {
        self.regs[0] & (HSE_ON | HSE_BYPASS) == HSE_ON | HSE_BYPASS && self.crystal_hz.is_some()
    }
    /// `true` for HSE and for the PLL if it is on and ready at that time.
    pub fn ready_at(&self, now: u64) -> [bool; 2] {
        [self.crystal_runs() && now >= self.ready[HSE], now >= self.ready[PLL]]
    }
    /// RCC_CR or RCC_CSR was written: what begins to start, or stops.
    fn follow_switches(&mut self, now: u64) {
        let after = |ready: &mut u64, on: bool, at: u64| *ready = if on { (*ready).min(at) } else { u64::MAX };
        let (on, pll, lsi) = (self.crystal_runs(), self.regs[0] & 1 << 24 != 0, self.regs[0x1D] & 1 != 0);
        after(&mut self.ready[HSE], on, now + self.crystal_start);
        // It locks on to what runs.
        let source = if self.regs[1] & 1 << 22 != 0 { self.ready[HSE] } else { now };
        after(&mut self.ready[PLL], pll, source.max(now).saturating_add(PLL_LOCK));
        after(&mut self.ready[LSI], lsi, now + LSI_START);
    }
    /// `true` if LSI is on and ready.
    pub fn lsi_runs(&self, now: u64) -> bool {
        now >= self.ready[LSI]
    }
    /// HSE, Hz, where it runs.
    pub fn crystal(&self) -> Option<u64> {
        self.crystal_hz.filter(|_| self.crystal_runs()).map(|hz| hz.round() as u64)
    }
    /// RCC_CR.
    pub fn control(&self) -> u32 {
        self.regs[0]
    }
    /// RCC_PLLCFGR.
    pub fn pll_settings(&self) -> u32 {
        self.regs[1]
    }
    /// RCC_CFGR.
    pub fn configuration(&self) -> u32 {
        self.regs[2]
    }
    /// RCC_CFGR, SW: what drives the processor.
    pub fn switch(&self) -> u32 {
        self.regs[2] & 3
    }
    /// RCC_DCKCFGR, TIMPRE.
    pub fn fast_timers(&self) -> bool {
        self.regs[0x8C / 4] & 1 << 24 != 0
    }
    /// A bit of a register: offset and bit.
    pub fn bit(&self, (offset, bit): (u32, u32)) -> bool {
        self.regs.get(offset as usize / 4).is_some_and(|r| r & 1 << bit != 0)
    }
    /// The crystal stops. With the clock security system on the chip goes over to HSI (RM0390 section 6.2.7), and this says that the NMI is due;
    /// without, a processor that runs on it stands still.
    pub fn crystal_stops(&mut self) -> bool {
        let watched = self.crystal_runs() && self.regs[0] & CSS_ON != 0;
        self.crystal_hz = None;
        if watched {
            self.regs[0] &= !(HSE_ON | CSS_ON);
            self.regs[2] &= !3;
            self.regs[3] |= CSS_FLAG;
        }
        watched
    }
    /// HSE / RTCPRE in units of HSI; `None`: it does not run.
    fn divided_crystal(&self) -> Option<f64> {
        let pllm = self.regs[2] >> 16 & 0x1F;
        (self.crystal_runs() && pllm >= 2).then_some(())?;
        Some(self.crystal_hz? / f64::from(pllm) / HSI_HZ)
    }
    pub fn read(&self, word: usize, now: u64) -> Option<u32> {
        let value = *self.regs.get(word)?;
        Some(match word {
            // CR: HSI, PLLI2S and PLLSAI ready follow their on bits.
            0 => {
                let [hse, pll] = self.ready_at(now);
                let ready = value & !0x2A02_0002 | (value & 0x1400_0001) << 1;
                ready | if hse { HSE_READY } else { 0 } | if pll { PLL_READY } else { 0 }
            }
            // CFGR: SWS follows SW.
            2 => value & !0xC | (value & 3) << 2,
            // BDCR, CSR: LSE and LSI ready.
            0x1C => value & !2 | (value & 1) << 1,
            0x1D => value & !2 | u32::from(self.lsi_runs(now)) << 1,
            _ => value,
        })
    }
    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        let slot = self.regs.get_mut(word)?;
        if word == 0x1D {
            let causes = if value & (1 << 24) != 0 { 0 } else { *slot & 0xFE00_0000 };
            *slot = causes | (value & 1);
        } else if word == 3 {
            let flag = if value & CSS_CLEAR != 0 { 0 } else { *slot & CSS_FLAG };
            *slot = value & !(CSS_FLAG | CSS_CLEAR) | flag;
        } else if word == 0 {
            // Ready bits and HSICAL are the chip's.
            *slot = value & !0x2A02_FF02;
        } else if word == 2 {
            // SWS is the chip's.
            *slot = value & !0xC;
        } else {
            *slot = value;
        }
        if matches!(word, 0 | 0x1D) {
            self.follow_switches(now);
        }
        Some(())
    }
}

#[cfg(test)]
mod readiness {
    use super::*;

    const MS: u64 = crate::CPU_HZ / 1000;
    const HSE_AND_BYPASS: u32 = HSE_ON | HSE_BYPASS;

    #[test]
    fn oscillators_and_pll_are_ready_when_the_data_sheet_says() {
        let mut rcc = Rcc::new(CSR_POWER_ON);
        let ready = |rcc: &Rcc, now: u64| rcc.read(0, now).unwrap_or(0) & (HSE_READY | PLL_READY);
        // PLLSRC: HSE.
        rcc.write(1, 0x2400_3010 | 1 << 22, 0);
        rcc.write(0, 1 | HSE_AND_BYPASS | 1 << 24, MS);
        assert_eq!(ready(&rcc, 3 * MS - 1), 0);
        assert_eq!(ready(&rcc, 3 * MS), HSE_READY);
        assert_eq!(ready(&rcc, 3 * MS + MS * 3 / 10), HSE_READY | PLL_READY, "it locks on to what runs");
        // Another write of the same starts nothing anew; off is off at once.
        rcc.write(0, 1 | HSE_AND_BYPASS | 1 << 24, 4 * MS);
        assert_eq!(ready(&rcc, 4 * MS), HSE_READY | PLL_READY);
        rcc.write(0, 1 | HSE_AND_BYPASS, 5 * MS);
        assert_eq!(ready(&rcc, 5 * MS), HSE_READY);
        let lsi = |rcc: &Rcc, now: u64| rcc.read(0x1D, now).unwrap_or(0) & 3;
        rcc.write(0x1D, 1, 6 * MS);
        assert_eq!((lsi(&rcc, 6 * MS), lsi(&rcc, 7 * MS)), (1, 3));
    }

    #[test]
    fn a_dead_crystal_is_never_ready_and_a_slow_one_later() {
        let mut dead = Rcc { crystal_hz: None, ..Rcc::new(CSR_POWER_ON) };
        dead.write(0, 1 | HSE_AND_BYPASS, 0);
        assert_eq!(dead.read(0, 1_000_000 * MS).unwrap_or(0) & HSE_READY, 0);
        let mut slow = Rcc { crystal_start: 50 * MS, ..Rcc::new(CSR_POWER_ON) };
        slow.write(0, 1 | HSE_AND_BYPASS, 0);
        assert_eq!([49, 50].map(|ms| slow.read(0, ms * MS).unwrap_or(0) & HSE_READY), [0, HSE_READY]);
        // Switched to before that, the chip would not follow.
        slow.write(2, 1, 0);
        assert!(crate::clocks::clocks(&slow, MS).is_err_and(|e| e.contains("before it is ready")));
    }
}

/// TIM11 as far as it counts the crystal: its channel 1 on HSE / RTCPRE (TIM11_OR), the counter on HSI. Only the counter's reading at each
/// capture matters, so time has no part in it: each look at a capture that was taken is the next one.
#[derive(Debug, Clone)]
pub struct CrystalCounter {
    regs: [u32; 0x54 / 4],
    captures: u32,
}

impl Default for CrystalCounter {
    fn default() -> Self {
        let mut regs = [0; 0x54 / 4];
        regs[11] = 0xFFFF; // ARR
        Self { regs, captures: 0 }
    }
}

impl CrystalCounter {
    /// First setting, while it counts, that changes its count and is not modelled.
    pub fn strange(&self) -> Option<&'static str> {
        let r = &self.regs;
        [
            (r[0] & 0x308 != 0, "CR1 has OPM or CKD"),
            (r[6] >> 4 & 0xF != 0, "CCMR1 has a filter"),
            (r[10] & 0xFFFF != 0, "PSC divides its clock"),
            (r[11] & 0xFFFF != 0xFFFF, "ARR is not its longest: it counts from 0 again in between"),
            (r[8] & 0xA == 8 || r[8] & 0xA == 0xA, "CCER has it capture both edges"),
        ]
        .into_iter()
        .find_map(|(strange, what)| (r[0] & 1 != 0 && strange).then_some(what))
    }
    fn captures(&self, rcc: &Rcc) -> Option<f64> {
        const CR1: usize = 0;
        const CCMR1: usize = 6;
        const CCER: usize = 8;
        const OR: usize = 20;
        let set_up =
            self.regs[CR1] & 1 != 0 && self.regs[CCER] & 1 != 0 && self.regs[CCMR1] & 3 == 1 && self.regs[OR] & 3 == 2;
        let prescaler = f64::from(1u32 << (self.regs[CCMR1] >> 2 & 3));
        set_up.then(|| rcc.divided_crystal()).flatten().map(|ratio| prescaler / ratio)
    }
    pub fn read(&mut self, word: usize, rcc: &Rcc) -> Option<u32> {
        const SR: usize = 4;
        const CCR1: usize = 13;
        Some(match (word, self.captures(rcc)) {
            (SR, Some(_)) => 2,
            (SR, None) => 0,
            (CCR1, Some(ticks)) => {
                self.captures += 1;
                (f64::from(self.captures) * ticks) as u32 & 0xFFFF
            }
            _ => *self.regs.get(word)?,
        })
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        *self.regs.get_mut(word)? = value;
        Some(())
    }
}

/// The CRC unit (RM0390 chapter 4): CRC-32/MPEG-2 of words.
#[derive(Debug, Clone)]
pub struct ProgramCrc(u32);

impl Default for ProgramCrc {
    fn default() -> Self {
        Self(u32::MAX)
    }
}

impl ProgramCrc {
    pub fn read(&self, word: usize) -> Option<u32> {
        match word {
            0 => Some(self.0),
            1 | 2 => Some(0),
            _ => None,
        }
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        match word {
            0 => {
                self.0 ^= value;
                for _ in 0..32 {
                    self.0 = self.0 << 1 ^ if self.0 >> 31 != 0 { 0x04C1_1DB7 } else { 0 };
                }
            }
            1 => {}
            2 if value & 1 != 0 => self.0 = u32::MAX,
            2 => {}
            _ => return None,
        }
        Some(())
    }
}

/// Parts that a battery at VBAT supplies: RCC_BDCR, the RTC (a calendar from 2000 on, on a crystal of its own) and the backup SRAM.
#[derive(Debug, Clone)]
pub struct Backup {
    bdcr: u32,
    /// Cycle at which the RTC began.
    began: Option<u64>,
    /// Cycle at which LSE was switched on.
    lse_on: Option<u64>,
    sram: Vec<u32>,
}

impl Default for Backup {
    fn default() -> Self {
        // Contents of the memory without a battery.
        Self { bdcr: 0, began: None, lse_on: None, sram: vec![0x5A5A_5A5A; 1024] }
    }
}

impl Backup {
    const BDRST: u32 = 1 << 16;
    const RTCEN: u32 = 1 << 15;
    /// LSE takes two seconds to start (data sheet, typical).
    const LSE_START: u64 = 2 * crate::CPU_HZ;
    fn crystal_runs(&self, now: u64) -> bool {
        self.lse_on.is_some_and(|at| now >= at + Self::LSE_START)
    }
    pub fn bdcr(&self, now: u64) -> u32 {
        self.bdcr & !2 | u32::from(self.crystal_runs(now)) << 1
    }
    pub fn set_bdcr(&mut self, value: u32, now: u64) {
        if value & Self::BDRST != 0 {
            // (The SRAM stays: RM0390 section 6.3.20.)
            (self.bdcr, self.began, self.lse_on) = (Self::BDRST, None, None);
            return;
        }
        // A source of the RTC, once selected, stays until the domain is reset (RM0390 section 6.3.20).
        const RTCSEL: u32 = 3 << 8;
        let selected = self.bdcr & RTCSEL;
        let value = if selected == 0 { value } else { value & !RTCSEL | selected };
        self.bdcr = value & !2;
        self.lse_on = (value & 1 != 0).then(|| self.lse_on.unwrap_or(now));
        // RTCSEL: 1 is LSE, which must run.
        let on_lse = value & Self::RTCEN != 0 && value >> 8 & 3 == 1 && value & 1 != 0;
        self.began = on_lse.then(|| self.began.unwrap_or(now + Self::LSE_START));
    }
    /// A register of the RTC: TR, DR, ISR.
    pub fn rtc(&self, word: usize, now: u64) -> Option<u32> {
        let seconds = self.began.filter(|b| now >= *b).map(|b| (now - b) / crate::CPU_HZ);
        let bcd = |n: u64| (16 * (n / 10) + n % 10) as u32;
        Some(match (word, seconds) {
            (0, Some(s)) => bcd(s / 3600 % 24) << 16 | bcd(s / 60 % 60) << 8 | bcd(s % 60),
            // (Days of January, which is enough.)
            (1, Some(s)) => 0x2100 | bcd(1 + s / 86_400),
            // RSF: the registers follow.
            (3, Some(_)) => 1 << 5,
            (0 | 1 | 3, None) => 0,
            _ => return None,
        })
    }
    pub fn read(&self, word: usize) -> u32 {
        self.sram[word % 1024]
    }
    pub fn write(&mut self, word: usize, value: u32) {
        self.sram[word % 1024] = value;
    }
}

/// PWR: CR, CSR with every regulator ready.
#[derive(Debug, Clone)]
pub struct Pwr {
    regs: [u32; 2],
    /// Cycles at which over-drive is ready, and switched to; `u64::MAX`: it is off.
    over_drive: [u64; 2],
    /// The supply is at so many tenths of a volt less than 3.3 V.
    pub sag_tenths: u32,
}

impl Default for Pwr {
    fn default() -> Self {
        // VOS: scale 1 of the STM32F405 and its kin; of the STM32F446, the highest (RM0390 section 5.4.1).
        Self { regs: [3 << 14, 0], over_drive: [u64::MAX; 2], sag_tenths: 0 }
    }
}

/// Time that each step of over-drive takes (STM32F446 data sheet, over-drive switching characteristics: some 45 us; the sheet was not at hand when
/// this was written). A program that waits for the flags waits as long as they take.
const OVER_DRIVE: u64 = 45 * (crate::CPU_HZ / 1_000_000);

impl Pwr {
    /// ODRDY and ODSWRDY at a time, in their places in PWR_CSR, which are those of ODEN and ODSWEN in PWR_CR.
    pub fn over_drive(&self, now: u64) -> u32 {
        let [ready, switched] = self.over_drive.map(|at| now >= at);
        u32::from(ready) << 16 | u32::from(switched) << 17
    }
    pub fn read(&self, word: usize, now: u64) -> Option<u32> {
        match word {
            0 => Some(self.regs[0]),
            1 => {
                // PVDO: the supply is below the level that PLS sets. Typical levels, falling, mV (STM32F405 data sheet, table 19; the F446's is the
                // same).
                const FALLING_MV: [u32; 8] = [2040, 2190, 2340, 2470, 2600, 2840, 2930, 3030];
                let level = FALLING_MV[(self.regs[0] >> 5 & 7) as usize];
                let below = self.regs[0] & 1 << 4 != 0 && 3300 - 100 * self.sag_tenths < level;
                Some(self.regs[1] | 1 << 14 | self.over_drive(now) | u32::from(below) << 2)
            }
            _ => None,
        }
    }
    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        *self.regs.get_mut(word)? = value;
        if word == 0 {
            let [on, switch] = [16, 17].map(|bit| value & 1 << bit != 0);
            let [ready, switched] = &mut self.over_drive;
            *ready = if on { (*ready).min(now + OVER_DRIVE) } else { u64::MAX };
            *switched = if on && switch { (*switched).min((*ready).max(now) + OVER_DRIVE) } else { u64::MAX };
        }
        Some(())
    }
    /// PWR_CR.
    pub fn control(&self) -> u32 {
        self.regs[0]
    }
    /// DBP: the backup domain may be written.
    pub fn backup_open(&self) -> bool {
        self.regs[0] & 1 << 8 != 0
    }
}

/// Sector starts of the 512 KiB part, and its end.
pub const SECTORS: [u32; 9] = [0, 0x4000, 0x8000, 0xC000, 0x1_0000, 0x2_0000, 0x4_0000, 0x6_0000, 0x8_0000];

/// FLASH: ACR, KEYR, OPTKEYR, SR, CR, OPTCR.
#[derive(Debug, Clone)]
pub struct Flash {
    regs: [u32; 6],
    key: u8,
    /// A wrong key was written: locked until the next reset.
    shut: bool,
    /// A sector whose erase was started.
    pub erase: Option<usize>,
}

const SR: usize = 3;
const CR: usize = 4;
const LOCK: u32 = 1 << 31;

impl Default for Flash {
    fn default() -> Self {
        Self { regs: [0, 0, 0, 0, LOCK, 0x0FFF_AAED], key: 0, shut: false, erase: None }
    }
}

impl Flash {
    /// FLASH_ACR.
    pub fn acr(&self) -> u32 {
        self.regs[0]
    }

    pub fn read(&self, word: usize) -> Option<u32> {
        match word {
            1 | 2 => Some(0),
            n => self.regs.get(n).copied(),
        }
    }
    pub fn write(&mut self, word: usize, value: u32) -> Option<()> {
        match word {
            1 => {
                self.key = match (self.key, value) {
                    (0, 0x4567_0123) => 1,
                    (1, 0xCDEF_89AB) if !self.shut => {
                        self.regs[CR] &= !LOCK;
                        0
                    }
                    // A wrong key locks it until the next reset (RM0390 section 3.5.1).
                    _ => {
                        self.shut = true;
                        0
                    }
                };
            }
            SR => self.regs[SR] &= !(value & 0xF3),
            CR => {
                if self.regs[CR] & LOCK == 0 {
                    self.regs[CR] = value & !(1 << 16);
                    let start = value & (1 << 16) != 0;
                    if start && value & 4 != 0 {
                        return None; // a mass erase is not modelled
                    }
                    if start && value & 3 == 3 {
                        // PG and SER: PGSERR (RM0390 section 3.8.4).
                        self.regs[SR] |= 1 << 7;
                    } else if start && value & 2 != 0 {
                        // STRT with SER: erase.
                        self.erase = Some((value >> 3 & 0xF) as usize);
                    }
                }
            }
            n => *self.regs.get_mut(n)? = value,
        }
        Some(())
    }
    /// FLASH_ACR.
    pub fn access_control(&self) -> u32 {
        self.regs[0]
    }
    /// `true` if the control register is unlocked.
    pub fn unlocked(&self) -> bool {
        self.regs[CR] & LOCK == 0
    }
    /// Option bytes, as FLASH_OPTCR shows them after the next reset.
    pub fn set_options(&mut self, optcr: u32) {
        self.regs[5] = optcr;
    }
    /// The option bytes.
    pub fn options(&self) -> u32 {
        self.regs[5]
    }
    /// `true` if a sector is write-protected (nWRP; RM0390 section 3.6.4), which is an error (WRPERR).
    pub fn protects(&mut self, offset: u32) -> bool {
        let sector = SECTORS.iter().rposition(|start| *start <= offset).unwrap_or(0);
        let protected = self.regs[5] & 1 << (16 + sector) == 0;
        if protected {
            self.regs[SR] |= 1 << 4;
        }
        protected
    }
    /// `true` if a write to flash programs it.
    pub fn programming(&self) -> bool {
        self.regs[CR] & (LOCK | 1) == 1
    }
    /// PSIZE: 0 for x8, 1 for x16, 2 for x32, 3 for x64.
    pub fn width(&self) -> usize {
        (self.regs[CR] >> 8 & 3) as usize
    }
    /// A write of another width than PSIZE says.
    pub fn refuse_width(&mut self) {
        self.regs[SR] |= 1 << 6;
    }
    /// A write that was not allowed.
    pub fn refuse(&mut self) {
        self.regs[SR] |= 1 << 7;
    }
    /// The operation is done: EOP, which rises only with EOPIE (RM0390 section 3.8.4).
    pub fn done(&mut self) {
        self.regs[SR] |= self.regs[CR] >> 24 & 1;
    }
}

/// IWDG on LSI.
#[derive(Debug, Clone)]
pub struct Iwdg {
    /// PR and RLR, as they are in effect.
    regs: [u32; 2],
    /// As they were written: in effect once they are taken.
    written: [u32; 2],
    running: bool,
    /// LSI, Hz; 17 to 47 kHz (data sheet).
    pub lsi_hz: u64,
    /// PR and RLR may be written: 0x5555 was the last key.
    open: bool,
    /// A write of PR or RLR is taken at these cycles, and no other before: PVU, RVU (RM0390 section 20.4.4).
    busy: [u64; 2],
    /// Cycle at which it bites.
    pub bites: u64,
}

impl Default for Iwdg {
    fn default() -> Self {
        let regs = [0, 0xFFF];
        Self { regs, written: regs, running: false, lsi_hz: 32_000, open: false, busy: [0; 2], bites: 0 }
    }
}

impl Iwdg {
    fn take(&mut self, now: u64) {
        for ((reg, written), busy) in self.regs.iter_mut().zip(self.written).zip(self.busy) {
            if now >= busy {
                *reg = written;
            }
        }
    }
    fn restart(&mut self, now: u64) {
        self.take(now);
        let [prescaler, reload] = self.regs;
        let lsi_cycles = (4u64 << prescaler) * (u64::from(reload) + 1);
        self.bites = now + lsi_cycles * crate::CPU_HZ / self.lsi_hz.max(1);
    }
    /// It runs, and LSI with it.
    pub fn running(&self) -> bool {
        self.running
    }
    /// As the option byte WDG_SW = 0 has it: running from reset, with the longest reload at the shortest prescaler (0.5 s).
    pub fn hardware(now: u64, lsi_hz: u64) -> Self {
        let mut iwdg = Self { running: true, lsi_hz, ..Self::default() };
        iwdg.restart(now);
        iwdg
    }
    pub fn read(&self, word: usize, now: u64) -> Option<u32> {
        match word {
            0 => Some(0),
            3 => Some(u32::from(now < self.busy[0]) | u32::from(now < self.busy[1]) << 1),
            1 | 2 => Some(self.written[word - 1]),
            _ => None,
        }
    }
    pub fn write(&mut self, word: usize, value: u32, now: u64) -> Option<()> {
        match word {
            0 => {
                self.open = value & 0xFFFF == 0x5555;
                if value == 0xCCCC {
                    self.running = true;
                }
                if self.running && (value == 0xCCCC || value == 0xAAAA) {
                    self.restart(now);
                }
            }
            1 | 2 if self.open && now >= self.busy[word - 1] => {
                self.take(now);
                // Up to five cycles of LSI.
                self.busy[word - 1] = now + 5 * crate::CPU_HZ / self.lsi_hz.max(1);
                self.written[word - 1] = if word == 1 { (value & 7).min(6) } else { value & 0xFFF };
            }
            1 | 2 => {}
            _ => return None,
        }
        Some(())
    }
    /// `true` if PR and RLR may be written.
    pub fn open(&self) -> bool {
        self.open
    }
    pub fn next_event(&self) -> u64 {
        if self.running {
            self.bites
        } else {
            u64::MAX
        }
    }
}
