//! The clock tree: what RCC's registers make of crystal and oscillator, and whether chip and flash can bear it.

use crate::part::ClockLimits;
use crate::system::Rcc;
use crate::CPU_HZ;

/// Of the chip's own oscillator, Hz.
pub const HSI_HZ: u64 = 16_000_000;

/// Frequencies of a set-up, Hz.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Clocks {
    pub hclk: u64,
    pub pclk1: u64,
    pub pclk2: u64,
    /// Of the timers of APB1.
    pub timers: u64,
    /// Of the timers of APB2.
    pub timers2: u64,
}

impl Clocks {
    /// After a reset: HSI, undivided.
    pub const RESET: Self = Self { hclk: HSI_HZ, pclk1: HSI_HZ, pclk2: HSI_HZ, timers: HSI_HZ, timers2: HSI_HZ };
}

/// Ticks of a clock in the board's time: `units` of [`CPU_HZ`] make `ticks`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pace {
    pub units: u64,
    pub ticks: u64,
}

impl Pace {
    pub fn of(hz: u64) -> Self {
        let (mut a, mut b) = (CPU_HZ, hz.max(1));
        while b != 0 {
            (a, b) = (b, a % b);
        }
        Self { units: CPU_HZ / a, ticks: hz.max(1) / a }
    }
    /// Whole ticks in a time.
    pub fn ticks_in(self, units: u64) -> u64 {
        if self.ticks == 1 {
            return units / self.units;
        }
        (u128::from(units) * u128::from(self.ticks) / u128::from(self.units)) as u64
    }
    /// The time after which so many ticks have passed.
    pub fn time_of(self, ticks: u64) -> u64 {
        if self.ticks == 1 {
            return ticks * self.units;
        }
        (u128::from(ticks) * u128::from(self.units)).div_ceil(u128::from(self.ticks)) as u64
    }
}

const CR_PLL_ON: u32 = 1 << 24;

/// The PLL's output P, Hz; its settings must be within their bounds (RM0390 section 6.3.2).
fn pll(rcc: &Rcc) -> Result<u64, String> {
    let r = rcc.pll_settings();
    let (m, n) = (u64::from(r & 0x3F), u64::from(r >> 6 & 0x1FF));
    let p = 2 * (u64::from(r >> 16 & 3) + 1);
    let (q, from_hse) = (r >> 24 & 0xF, r & 1 << 22 != 0);
    let source = if from_hse { rcc.crystal() } else { Some(HSI_HZ) };
    let Some(source) = source else { return Err("the PLL's source, HSE, does not run".into()) };
    if m < 2 || !(50..=432).contains(&n) || q < 2 {
        return Err(format!("PLLM {m}, PLLN {n} or PLLQ {q} is none that is allowed (2 to 63, 50 to 432, 2 to 15)"));
    }
    // Input of 0.95 to 2.1 MHz, VCO of 100 to 432 MHz (data sheet, characteristics of the main PLL).
    let (input, vco) = (source as f64 / m as f64, source as f64 * n as f64 / m as f64);
    if !(0.95e6..=2.1e6).contains(&input) {
        return Err(format!("the PLL's input is {:.3} MHz, and it locks from 0.95 to 2.1 MHz", input / 1e6));
    }
    if !(99.9e6..=432.5e6).contains(&vco) {
        return Err(format!("the PLL's VCO would run at {:.1} MHz, and it does so from 100 to 432 MHz", vco / 1e6));
    }
    Ok(source * n / m / p)
}

/// Frequencies of what RCC says now; an error is what the chip would do.
pub fn clocks(rcc: &Rcc, now: u64) -> Result<Clocks, String> {
    let early = |name: &str| {
        format!("RCC_CFGR.SW asks for {name} before it is ready: the chip goes on with its old clock until then, which is not modelled")
    };
    let source = match (rcc.switch(), rcc.ready_at(now)) {
        (0, _) => HSI_HZ,
        (1, [ready, _]) => {
            let hz = rcc.crystal().ok_or("the processor's clock is HSE, which does not run")?;
            ready.then_some(hz).ok_or_else(|| early("HSE"))?
        }
        (2, _) if rcc.control() & CR_PLL_ON == 0 => return Err("the processor's clock is the PLL, which is off".into()),
        (2, [_, ready]) => {
            let hz = pll(rcc)?;
            ready.then_some(hz).ok_or_else(|| early("the PLL"))?
        }
        _ => return Err("SW = 3 is not allowed (the PLL's output R is not modelled)".into()),
    };
    let cfgr = rcc.configuration();
    let ahb = match cfgr >> 4 & 0xF {
        0..8 => 0,
        n @ 8..12 => n - 7,
        n => n - 6,
    };
    let apb = |bits: u32| if bits < 4 { 0 } else { bits - 3 };
    let (apb1, apb2) = (apb(cfgr >> 10 & 7), apb(cfgr >> 13 & 7));
    let hclk = source >> ahb;
    let (pclk1, pclk2) = (hclk >> apb1, hclk >> apb2);
    // TIMPRE: timers at up to four times PCLK (RM0390 section 6.3.25).
    let timers = |divided: u32, pclk: u64| match (divided, rcc.fast_timers()) {
        (0, _) => pclk,
        (_, false) => 2 * pclk,
        (_, true) => (4 * pclk).min(hclk),
    };
    Ok(Clocks { hclk, pclk1, pclk2, timers: timers(apb1, pclk1), timers2: timers(apb2, pclk2) })
}

/// Checks that chip and flash bear these clocks; else states their reaction. `acr`: FLASH_ACR, `power`: PWR_CR.
pub fn judge(c: Clocks, limits: &ClockLimits, acr: u32, power: u32) -> Result<(), String> {
    // A crystal is off by some parts per million: that is not over the limit.
    let over = |hz: u64, limit: u64| hz > limit + limit / 1000;
    let mhz = |hz: u64| hz as f64 / 1e6;
    let too_fast = [(c.hclk, limits.ahb, "HCLK"), (c.pclk1, limits.apb1, "PCLK1"), (c.pclk2, limits.apb2, "PCLK2")];
    if let Some((hz, limit, name)) = too_fast.into_iter().find(|(hz, limit, _)| over(*hz, *limit)) {
        return Err(format!(
            "{name} is {:.3} MHz, and the chip works up to {:.0} MHz ({})",
            mhz(hz),
            mhz(limit),
            limits.manual
        ));
    }
    let waits = u64::from(acr & 0xF);
    if over(c.hclk, limits.per_wait_state * (waits + 1)) {
        return Err(format!(
            "FLASH_ACR has {waits} wait states at an HCLK of {:.3} MHz: the processor reads wrong instructions; one is needed per {:.0} MHz ({})",
            mhz(c.hclk),
            mhz(limits.per_wait_state),
            limits.manual
        ));
    }
    let scale = (power & limits.scale_mask) >> limits.scale_mask.trailing_zeros();
    let allowed = limits.scales.iter().find(|(bits, _)| *bits == scale).map_or(0, |(_, hz)| *hz);
    if over(c.hclk, allowed) {
        return Err(format!(
            "PWR_CR.VOS = {scale} supplies the core for {:.0} MHz, and HCLK is {:.3} MHz ({})",
            mhz(allowed),
            mhz(c.hclk),
            limits.manual
        ));
    }
    // ODEN and ODSWEN.
    if limits.over_drive_above.is_some_and(|hz| over(c.hclk, hz)) && power >> 16 & 3 != 3 {
        return Err(format!(
            "HCLK is {:.3} MHz without over-drive: PWR_CR.ODEN and ODSWEN are needed ({})",
            mhz(c.hclk),
            limits.manual
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::{STM32F405RG, STM32F446RE};

    // The examples are RM0390 table 6 and section 5.1.3, and RM0090 table 10.
    #[test]
    fn wait_states_scales_and_over_drive_are_those_of_the_manual() {
        let at = |mhz: u64| Clocks { hclk: mhz * 1_000_000, pclk1: 1, pclk2: 1, timers: 1, timers2: 1 };
        let f446 = &STM32F446RE.clocks;
        let power = |vos: u32, over_drive: bool| vos << 14 | if over_drive { 3 << 16 } else { 0 };
        for (mhz, waits, vos, over_drive, good) in [
            (30, 0, 1, false, true),
            (31, 0, 1, false, false),
            (120, 3, 1, false, true),
            (121, 4, 1, false, false),
            (144, 4, 2, false, true),
            (150, 4, 2, false, false),
            (150, 4, 3, false, true),
            (168, 5, 3, false, true),
            (180, 5, 3, false, false),
            (180, 5, 3, true, true),
            (180, 4, 3, true, false),
            (181, 6, 3, true, false),
        ] {
            assert_eq!(judge(at(mhz), f446, waits, power(vos, over_drive)).is_ok(), good, "{mhz} MHz");
        }
        let f405 = &STM32F405RG.clocks;
        for (mhz, waits, vos, good) in
            [(168, 5, 1, true), (168, 4, 1, false), (168, 5, 0, false), (144, 4, 0, true), (180, 5, 1, false)]
        {
            assert_eq!(judge(at(mhz), f405, waits, vos << 14).is_ok(), good, "{mhz} MHz");
        }
    }

    #[test]
    fn ticks_and_times_agree() {
        for hz in [90_000_000, 84_000_000, 16_000_000, 168_000_000] {
            let pace = Pace::of(hz);
            assert_eq!(pace.ticks_in(CPU_HZ), hz);
            for ticks in [1, 2, 3, 999, 1_000_001] {
                assert_eq!(pace.ticks_in(pace.time_of(ticks)), ticks);
                assert_eq!(pace.ticks_in(pace.time_of(ticks) - 1), ticks - 1);
            }
        }
    }
}
