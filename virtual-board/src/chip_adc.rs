//! ADC1 as the unit uses it: an injected group of the internal reference and the internal thermometer, started by software (RM0390 chapter 13).

use crate::CPU_HZ;

/// The codes that this chip's maker has written into the system memory, half-words from [`FACTORY_AT`] on: the internal reference at 3.3 V, the
/// thermometer at 30 and 110 C.
pub const FACTORY: [u16; 3] = [1502, 943, 1196];
/// Address of the first of them.
pub const FACTORY_AT: u32 = 0x1FFF_7A2A;

/// Highest clock of the ADC, MHz (data sheet, ADC characteristics).
const MOST_MHZ: f64 = 36.0;
/// Least sampling time of the internal reference and thermometer, us.
const LEAST_US: f64 = 10.0;
/// Sampling times by SMPx, cycles of the ADC; a conversion takes 12 more.
const SAMPLING: [f64; 8] = [3.0, 15.0, 28.0, 56.0, 84.0, 112.0, 144.0, 480.0];

const REFERENCE: u32 = 17;

/// The supply, and the temperature of the chip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ambient {
    /// V.
    pub supply_v: f64,
    /// C.
    pub temperature_c: f64,
}

impl Default for Ambient {
    fn default() -> Self {
        Self { supply_v: 3.3, temperature_c: 35.0 }
    }
}

impl Ambient {
    /// Codes of the reference and of the thermometer.
    #[must_use]
    pub fn codes(self) -> [u16; 2] {
        let [reference, cold, hot] = FACTORY.map(f64::from);
        let at_3_3_v = [reference, cold + (self.temperature_c - 30.0) * (hot - cold) / 80.0];
        at_3_3_v.map(|code| (code * 3.3 / self.supply_v).round().clamp(0.0, 4095.0) as u16)
    }
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub struct ChipAdc {
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr1: u32,
    jsqr: u32,
    jdr: [u32; 4],
    ccr: u32,
    /// When the conversions are done, cycles.
    done: Option<u64>,
    /// Ambient of the chip.
    pub ambient: Ambient,
}

impl ChipAdc {
    /// As at power-on, in the same ambient.
    #[must_use]
    pub fn reset(&self) -> Self {
        Self { ambient: self.ambient, ..Self::default() }
    }

    /// A register by its word.
    pub fn read(&mut self, word: usize, now: u64) -> Option<u32> {
        if self.done.is_some_and(|at| now >= at) {
            self.done = None;
            self.sr |= 1 << 2;
        }
        Some(match word {
            0 => self.sr,
            1 => self.cr1,
            2 => self.cr2,
            3 => self.smpr1,
            14 => self.jsqr,
            15..=18 => self.jdr[word - 15],
            0xC1 => self.ccr,
            _ => return None,
        })
    }

    /// Writes a register; an error: conversions that a chip would not do right. `pclk_hz`: clock of APB2.
    pub fn write(&mut self, word: usize, value: u32, now: u64, pclk_hz: f64) -> Option<Result<(), String>> {
        match word {
            // Flags are cleared by zeros.
            0 => self.sr &= value,
            1 => self.cr1 = value,
            3 => self.smpr1 = value,
            14 => self.jsqr = value,
            0xC1 => self.ccr = value,
            2 => {
                self.cr2 = value & !(1 << 22);
                if value & 1 << 22 != 0 {
                    return Some(self.convert(now, pclk_hz));
                }
            }
            _ => return None,
        }
        Some(Ok(()))
    }

    fn convert(&mut self, now: u64, pclk_hz: f64) -> Result<(), String> {
        let clock = pclk_hz / f64::from(2 * (1 + (self.ccr >> 16 & 3)));
        let last = self.jsqr >> 20 & 3;
        if self.cr2 & 1 == 0 {
            return Err("ADC1 is started while it is off (RM0390 section 13.3.1)".into());
        }
        if clock > MOST_MHZ * 1e6 {
            return Err(format!("ADC1 runs at {:.1} MHz, of 36 at most: ADC_CCR.ADCPRE", clock / 1e6));
        }
        if self.ccr & 1 << 23 == 0 {
            return Err("ADC1 converts the internal thermometer while it is off: ADC_CCR.TSVREFE".into());
        }
        if last > 0 && self.cr1 & 1 << 8 == 0 {
            return Err("ADC1 converts the first of a group only: ADC1_CR1.SCAN".into());
        }
        let [reference, thermometer] = self.ambient.codes();
        let mut cycles = 0.0;
        for k in 0..=last {
            // A group shorter than four begins with a later place.
            let channel = self.jsqr >> (5 * (3 - last + k)) & 31;
            let Some(sampling) = channel.checked_sub(10).map(|c| SAMPLING[(self.smpr1 >> (3 * c) & 7) as usize]) else {
                return Err(format!("ADC1 converts channel {channel}, which is not connected"));
            };
            if sampling / clock * 1e6 < LEAST_US {
                return Err(format!("ADC1 samples channel {channel} for less than 10 us: ADC1_SMPR1"));
            }
            cycles += sampling + 12.0;
            self.jdr[k as usize] = u32::from(if channel == REFERENCE { reference } else { thermometer });
        }
        self.sr |= 1 << 3;
        self.done = Some(now + (cycles / clock * CPU_HZ as f64) as u64);
        Ok(())
    }
}
