//! Conditions for a signal to pass: clocks, pins, buses, streams. The board takes nothing of the firmware for granted; where something is not as the
//! chip needs it, the run ends with one sentence: what the chip would do, which register, which section of the manual.
//!
//! A pin that is not yet set up is legal while nobody uses it: so each thing is judged when a signal would pass.

use crate::chip::Chip;
use crate::clocks::{self, Pace};
use crate::dma::Request;
use crate::part::FED_BACK_MAX_HZ;
use crate::serial::LINE_BAUD;
use crate::signals::{Signal, SIGNALS};
use crate::tables::Pin;

/// The bus with the ADC works up to so much, Hz. The ADC changes its output up to 20 ns after a rising edge of SCK (SBAS950, switching
/// characteristics, 2.7 to 3.6 V), and SPI1 wants it some 5 ns before the falling one (STM32F446 data sheet, SPI dynamic characteristics): half a
/// bit of 25 ns. (The ADC itself takes 25 MHz.) Neither sheet was at hand when both times were written down: compare them before you rely on
/// this limit. The unit is at half of it.
const ADC_SPI_MAX_HZ: u64 = 20_000_000;
/// A pin at its lowest speed gives so much at 50 pF and 2.7 V, Hz (STM32F446 data sheet, I/O AC characteristics).
const LOW_SPEED_HZ: u64 = 4_000_000;

impl Chip {
    /// Something that the chip suffers without a sign: here it ends the run, unless faults are to be as on the chip.
    pub fn mismatch(&mut self, what: impl FnOnce() -> String) {
        if self.strict && self.error.is_none() {
            self.error = Some(what());
            self.attention = true;
        }
    }

    fn pin_of(&self, signal: Signal) -> Pin {
        let w = &self.part.wiring;
        match signal {
            Signal::Capture(3) => w.data_ready,
            Signal::Capture(n) => w.resonators[n.min(2)],
            Signal::Pulse => w.pulse,
            Signal::BusClock => w.clock,
            Signal::FromAdc => w.from_adc,
            Signal::ToAdc => w.to_adc,
            Signal::LinkOut => w.link_out,
            Signal::LinkIn => w.link_in,
            Signal::Select => w.select,
            Signal::Reset => w.reset,
            Signal::Mark => w.mark,
        }
    }

    /// `true` if a pin carries a signal; if not, the run ends.
    pub fn carries(&mut self, signal: Signal) -> bool {
        let k = signal.index();
        if let Some(known) = self.carried[k] {
            return known;
        }
        let found = self.pin_fault(signal);
        self.carried[k] = Some(found.is_none());
        let good = found.is_none();
        if let Some(what) = found {
            self.mismatch(|| what);
        }
        good
    }

    fn pin_fault(&self, signal: Signal) -> Option<String> {
        let pin = self.pin_of(signal);
        if let Some(what) = self.end_fault(pin, signal.name(), signal.wire(), signal.drives()) {
            return Some(what);
        }
        let port = self.ports.get(pin.0)?;
        let (wire, port_name) = (signal.wire(), char::from(b'A' + pin.0 as u8));
        let fast = matches!(signal, Signal::BusClock | Signal::ToAdc) && self.spi1.hz(self.clocks.pclk2) > LOW_SPEED_HZ;
        if fast && port.speed(pin.1) == 0 {
            return Some(format!(
                "{wire} is too fast for {pin}: GPIO{port_name}_OSPEEDR is 0, good for 4 MHz (RM0390 section 7.4.3; data sheet, I/O AC characteristics)"
            ));
        }
        let speed = port.speed(pin.1) as usize & 3;
        if signal == Signal::BusClock && self.clocks.pclk2 > FED_BACK_MAX_HZ[speed] {
            return Some(format!(
                "the last bit of a byte from the ADC is not certain: PCLK2 has {} MHz, and GPIO{port_name}_OSPEEDR of {pin}, the clock that SPI1 samples by, is {speed}, good for {} MHz (errata ES0298 section 2.14)",
                self.clocks.pclk2 / 1_000_000,
                FED_BACK_MAX_HZ[speed] / 1_000_000
            ));
        }
        if signal == Signal::LinkIn && port.pull(pin.1) != 1 {
            return Some(format!(
                "{pin} floats without a cable, and its noise wakes the receiver: GPIO{port_name}_PUPDR has no pull-up (RM0390 section 7.4.4)"
            ));
        }
        if signal == Signal::FromAdc && !matches!(port.pull(pin.1), 1 | 2) {
            return Some(format!(
                "{pin} floats between frames, when the ADC lets go of it: GPIO{port_name}_PUPDR has no pull (RM0390 section 7.4.4)"
            ));
        }
        None
    }

    /// Why a pin is no end of a wire for a signal of a peripheral (no name: for an output of the program).
    pub fn end_fault(&self, pin: Pin, name: &str, wire: &str, drives: bool) -> Option<String> {
        let port = self.ports.get(pin.0)?;
        let port_name = char::from(b'A' + pin.0 as u8);
        let mode = port.mode(pin.1);
        let wanted = if name.is_empty() { 1 } else { 2 };
        if mode != wanted {
            let is = ["an input", "an output", "on its alternate function", "analog"][mode as usize & 3];
            let needed = if name.is_empty() { "an output" } else { "on its alternate function" };
            return Some(format!(
                "{wire} does not pass {pin}: GPIO{port_name}_MODER has it as {is}, and it must be {needed} (RM0390 section 7.4.1)"
            ));
        }
        if !name.is_empty() {
            let (has, needs) = (port.function(pin.1), self.part.tables.function(pin, name)?);
            if has != needs {
                let is = self.part.tables.signals(pin, has);
                return Some(format!(
                    "{wire} does not pass {pin}: GPIO{port_name}_AFR has alternate function {has}, which is {is}; {name} is {needs} (RM0390 section 7.4.10)"
                ));
            }
            if let Some(other) = self.rival(pin, name) {
                return Some(format!(
                    "{other} is set to {name} as well as {pin}: two pins are joined (RM0390 section 7.3.2)"
                ));
            }
        }
        (drives && port.open_drain(pin.1)).then(|| {
            format!(
                "{wire} never goes high: {pin} is open drain, GPIO{port_name}_OTYPER, and nothing pulls it up (RM0390 section 7.4.2)"
            )
        })
    }

    /// Another pin that is given to the same signal.
    fn rival(&self, pin: Pin, name: &str) -> Option<Pin> {
        let tables = &self.part.tables;
        let given = |p: &Pin| {
            self.ports.get(p.0).is_some_and(|port| {
                port.mode(p.1) == 2 && tables.pins[p].iter().any(|(n, s)| s == name && *n == port.function(p.1))
            })
        };
        tables.pins.keys().find(|p| **p != pin && given(p)).copied()
    }

    /// The pins of the debug port (RM0390 section 33.4) are still its own: else no probe reads the log.
    pub fn probe_connected(&self) -> bool {
        [13, 14].into_iter().all(|pin| self.ports[0].mode(pin) == 2 && self.ports[0].function(pin) == 0)
    }

    /// An input that a wire has come off must be pulled down, or it counts noise.
    pub fn floating_input(&self, wires: impl Iterator<Item = usize>) -> Option<String> {
        wires.map(Signal::Capture).find_map(|s| {
            let pin = self.pin_of(s);
            (!matches!(self.ports[pin.0].pull(pin.1), 1 | 2)).then(|| {
                format!("{pin} floats where its wire has come off: GPIO_PUPDR has no pull, and TIM2 captures noise (RM0390 section 7.4.4)")
            })
        })
    }

    /// `true` if the peripheral at an address has its clock and is not held in its reset. (`what`: words for the action that fails.)
    pub fn awake(&mut self, address: u32, what: &str) -> bool {
        let Some(gate) = self.part.gate(address) else { return true };
        let (enable, reset) = (gate.enable, gate.reset);
        let off = enable.is_some_and(|e| !self.rcc.bit(e));
        let held = reset.is_some_and(|r| self.rcc.bit(r));
        if off || held {
            let part = self.part;
            self.mismatch(|| {
                let name = part.tables.peripheral_at(address).map_or("?", |p| p.name.as_str());
                let (register, bit) = if off { enable } else { reset }.unwrap_or_default();
                let register = part.tables.register_name(0x4002_3800 + register);
                let state = if off { "is not clocked" } else { "is held in reset" };
                format!("{name} {state}: {register} bit {bit} is {}, so {what} (RM0390 section 6.3)", u32::from(!off))
            });
        }
        !(off || held)
    }

    /// Clocks are as RCC says from now on; too fast a clock ends the run.
    pub fn follow_clocks(&mut self) {
        match clocks::clocks(&self.rcc, self.now) {
            Ok(c) => {
                if c != self.clocks {
                    let now = self.now;
                    let cycles = self.processor_cycles();
                    self.pace = Pace::of(c.hclk);
                    self.spare.follow_clocks(&c, now);
                    self.recount(cycles);
                    for timer in [&mut self.tim2, &mut self.tim3, &mut self.tim5] {
                        timer.set_pace(Pace::of(c.timers), now);
                    }
                    self.clocks = c;
                    self.carried = [None; SIGNALS];
                }
                // (Over-drive counts as soon as it is there, and not when it is asked for.)
                let power = self.pwr.control() & !(0b11 << 16) | self.pwr.over_drive(self.now);
                let acr = self.flash.access_control();
                if let Err(what) = clocks::judge(c, &self.part.clocks, acr, power) {
                    self.mismatch(|| what);
                }
            }
            Err(what) => self.mismatch(|| format!("{what} (RM0390 section 6.3)")),
        }
    }

    /// A write to the settings of the PLL while it runs does nothing.
    pub fn pll_locked(&mut self, word: usize, value: u32) {
        let on = self.rcc.control() & 1 << 24 != 0;
        let used = self.rcc.switch() == 2;
        if word == 1 && on && value != self.rcc.pll_settings() {
            self.mismatch(|| {
                "RCC_PLLCFGR is written while the PLL runs, which does nothing (RM0390 section 6.3.2)".into()
            });
        }
        // The STM32F446 has it: 0 and 1 are not allowed.
        let third = self.part.clocks.over_drive_above.is_some();
        if word == 1 && third && value >> 28 & 7 < 2 {
            self.mismatch(|| "RCC_PLLCFGR.PLLR is 0 or 1, which is not allowed (RM0390 section 6.3.2)".into());
        }
        if word == 0 && used && value & 1 << 24 == 0 {
            self.mismatch(|| {
                "RCC_CR.PLLON is cleared while the PLL drives the processor, which does nothing (RM0390 section 6.3.1)"
                    .into()
            });
        }
    }

    /// A write to RCC_CR or PWR_CR that does nothing, or stops what runs.
    pub fn refused_switch(&mut self, base: u32, value: u32) {
        const HSE_ON: u32 = 1 << 16;
        const HSE_BYPASS: u32 = 1 << 18;
        const PLL_ON: u32 = 1 << 24;
        const OVER_DRIVE: u32 = 1 << 16;
        let (control, power) = (self.rcc.control(), self.pwr.control());
        let from_hse = self.rcc.switch() == 1 || self.rcc.switch() == 2 && self.rcc.pll_settings() & 1 << 22 != 0;
        let vos = self.part.clocks.scale_mask;
        let what = match base {
            0x4002_3800 if value >> 3 & 0x1F != 16 => {
                "RCC_CR.HSITRIM is not 16: HSI is off by up to 8 %, and no measure of the crystal (RM0390 section 6.3.1)"
            }
            0x4002_3800 if control & value & HSE_ON != 0 && (control ^ value) & HSE_BYPASS != 0 => {
                "RCC_CR.HSEBYP is written while HSE is on, which does nothing (RM0390 section 6.3.1)"
            }
            0x4002_3800 if from_hse && control & HSE_ON != 0 && value & HSE_ON == 0 => {
                "RCC_CR.HSEON is cleared while HSE drives the processor, which does nothing (RM0390 section 6.3.1)"
            }
            0x4000_7000 if value >> 20 & 3 != 0 => {
                "PWR_CR.FMSSR or FISSR stops the flash, from which the program runs (RM0390 section 5.4.1)"
            }
            0x4000_7000 if control & PLL_ON != 0 && (power ^ value) & vos != 0 => {
                "PWR_CR.VOS is written while the PLL is on: it counts only when that is off (RM0390 section 5.4.1)"
            }
            0x4000_7000
                if self.part.clocks.over_drive_above.is_some()
                    && value & !power & OVER_DRIVE << 1 != 0
                    && self.pwr.over_drive(self.now) & OVER_DRIVE == 0 =>
            {
                "PWR_CR.ODSWEN is set before over-drive is ready (RM0390 section 5.1.3)"
            }
            _ => return,
        };
        self.mismatch(|| what.into());
    }

    /// `true` if a capture input captures an edge at its pin.
    pub fn captures(&mut self, signal: Signal, rising: bool) -> bool {
        let (base, channel) = match signal {
            Signal::Capture(n) => (0x4000_0000, n),
            _ => (0x4000_0400, 0),
        };
        let timer = if base == 0x4000_0000 { &self.tim2 } else { &self.tim3 };
        if !timer.listens(channel) {
            return false;
        }
        let late = timer.filters(channel);
        if let Some(why) = timer.receives_nothing(channel, rising) {
            self.mismatch(|| {
                format!("{} is not captured: {}: {why} (RM0390 section 17.4)", signal.wire(), signal.name())
            });
            // A filter alone lets the edge through, later.
            if !late {
                return false;
            }
        }
        self.carries(signal) && self.awake(base, "it captures nothing")
    }

    /// Reports a wrong set-up of a timer.
    pub fn judge_timer(&mut self, address: u32) {
        let (name, timer) = match address & !0x3FF {
            0x4000_0000 => ("TIM2", &self.tim2),
            0x4000_0400 => ("TIM3", &self.tim3),
            _ => ("TIM5", &self.tim5),
        };
        let slave = timer.enslaved() && name != "TIM3";
        if let Some(what) = timer.strange().or(slave.then_some("SMCR has a slave mode: another clock, or a reset")) {
            self.mismatch(|| format!("{name}_{what} (RM0390 section 17.4)"));
        }
    }

    /// The enabled stream that serves a request, fit for it.
    pub fn serving(&mut self, request: Request) -> Option<(usize, usize)> {
        let (c, n) = self.stream(request)?;
        if let Some(why) = self.dma[c].streams[n].unfit(request) {
            self.mismatch(|| {
                format!("DMA{} stream {n} does not serve {}: {why} (RM0390 section 9.5)", c + 1, request.signal())
            });
            return None;
        }
        let base = if c == 0 { 0x4002_6000 } else { 0x4002_6400 };
        self.awake(base, "no stream moves").then_some((c, n))
    }

    /// `true` if SPI1 and the ADC understand each other: a transfer is about to begin.
    pub fn bus_works(&mut self) -> bool {
        let hz = self.spi1.hz(self.clocks.pclk2);
        if let Some(what) = self.spi1.unfit() {
            self.mismatch(|| format!("SPI1_{what}"));
            return false;
        }
        let pins = [Signal::BusClock, Signal::FromAdc, Signal::ToAdc, Signal::Select, Signal::Reset];
        if !pins.into_iter().all(|s| self.carries(s)) {
            return false;
        }
        if hz > ADC_SPI_MAX_HZ {
            let mhz = hz as f64 / 1e6;
            self.mismatch(|| {
                format!("SPI1_CR1.BR makes {mhz:.2} MHz: half a bit is shorter than the ADC's output delay and SPI1's set-up time, which allow 20 MHz (SBAS950, switching characteristics; RM0390 section 26.7.1)")
            });
            return false;
        }
        self.awake(0x4001_3000, "no bit moves")
    }

    /// `true` if USART1 uses the format of the wire, out or in.
    pub fn line_works(&mut self, out: bool) -> bool {
        let baud = self.usart1.baud(self.clocks.pclk2);
        if let Some(what) = self.usart1.unfit(out) {
            self.mismatch(|| format!("USART1_{what}"));
            return false;
        }
        // Half a bit in ten, shared by both ends and their crystals.
        if (baud / LINE_BAUD - 1.0).abs() > 0.02 {
            self.mismatch(|| {
                format!("USART1_BRR makes {baud:.0} baud of PCLK2, and the wire has {LINE_BAUD:.0}: framing errors (RM0390 section 25.4.5)")
            });
            return false;
        }
        // A receiver that is on needs its pin as soon as the program uses the line, with or without a cable.
        if out && self.usart1.receives() && !self.carries(Signal::LinkIn) {
            return false;
        }
        self.carries(if out { Signal::LinkOut } else { Signal::LinkIn }) && self.awake(0x4001_1000, "no bit moves")
    }

    /// Reports set-ups that would fail when the processor sleeps.
    pub fn judge_sleep(&mut self) {
        if let Some(what) = self.nvic.strange() {
            self.mismatch(|| what.into());
        }
        if !self.nvic.float_unit_on() {
            self.mismatch(|| "SCB_CPACR leaves the floating-point unit off: its first instruction is a usage fault (PM0214 section 4.6.1)".into());
        }
        // Captures and the link go by DMA into memory, and the flash is fetched from when it wakes.
        const MEMORY: [(u32, &str); 3] = [(15, "the flash's interface"), (16, "SRAM1"), (17, "SRAM2")];
        if let Some((_, what)) = MEMORY.iter().find(|(bit, _)| !self.rcc.bit((0x50, *bit))) {
            self.mismatch(|| format!("RCC_AHB1LPENR stops {what} while the processor sleeps, and DMA has no memory (RM0390 section 6.3.14)"));
        }
        if self.rcc.bit((0x80, 31)) {
            self.mismatch(|| "RCC_SSCGR.SSCGEN spreads the spectrum of the clock that the thermometer is timed by (RM0390 section 6.3.22)".into());
        }
        if self.syscfg.remapped() && self.nvic.vtor() < crate::FLASH_START {
            self.mismatch(|| {
                "SYSCFG_MEMRMP shows no flash at address 0, where VTOR has the vectors (RM0390 section 8.2.1)".into()
            });
        }
        // AHB1, APB1, APB2.
        for (on, asleep) in [(0x30, 0x50), (0x40, 0x60), (0x44, 0x64)] {
            let stopped = (0..32).find(|bit| self.rcc.bit((on, *bit)) && !self.rcc.bit((asleep, *bit)));
            if let Some(bit) = stopped {
                let part = self.part;
                self.mismatch(|| {
                    let register = part.tables.register_name(0x4002_3800 + asleep);
                    format!("{register} bit {bit} is 0: a peripheral in use stops while the processor sleeps (RM0390 section 6.3.16)")
                });
            }
        }
    }
}
