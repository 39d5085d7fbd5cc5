//! Mutations that do not matter, by the manual: a mutant that nobody noticed is harmless by a rule, or stays unnoticed.

use std::collections::BTreeMap;
use virtual_board::mutation::RegisterWrite;
use virtual_board::part::{Part, FED_BACK_MAX_HZ};
use virtual_board::tables::Pin;

/// The chip is in the state of the unmutated program when its start is over.
pub const SAME_STATE: &str =
    "the chip ends in the same state: bits that are read-only or cleared by 1, or a later write of the start puts it right before it is used";

/// Bits of a register, or of every register of a name, that do not matter.
struct Rule {
    /// Register, by the end of its name in the tables.
    register: &'static str,
    /// Fields; none: all of them.
    fields: &'static [&'static str],
    why: &'static str,
}

const fn rule(register: &'static str, fields: &'static [&'static str], why: &'static str) -> Rule {
    Rule { register, fields, why }
}

const RESERVED: &str = "reserved bits (the register's description)";
const UNWIRED: &str = "a pin that nothing is wired to (docs/bench.md)";
const UNUSED_INTERRUPT: &str =
    "an interrupt that nothing raises, or that is not enabled, has no effect (PM0214 section 4.3)";
const UNUSED_CLOCK: &str =
    "the clock or the reset of a peripheral that the program does not use: only current (RM0390 section 6.3)";
const ORDER: &str = "an interrupt keeps its order to those of the tasks, and may wait for its equals, whose handlers take microseconds (PM0214 section 4.3.7)";
const WAKES: &str =
    "an interrupt that only wakes tasks of UART4's priority comes no later than they run (PM0214 section 4.3.7)";
const RATE_TASK: &str =
    "the rate path runs between the end of a frame and the next data-ready, for less than 100 us: what has to wait for it at its own level can (PM0214 section 4.3.7)";
const LATER: &str = "it shows after 36 minutes only: the test time_has_its_interrupts looks at the register itself";
const RING_LASTS: &str =
    "an interrupt that counts the turns of the link's ring may wait for the tasks: it lasts 5 ms, the longest stretch of the tasks a tenth of it (docs/bench.md)";
const FRAME_LASTS: &str =
    "the end of a frame may wait for the tasks: the next data-ready comes 1 ms after the last, the longest stretch of the tasks is less than half of it (docs/bench.md)";
const READ_ONLY: &str = "IDR is read-only: it shows the pull of a pin that nothing drives yet (RM0390 section 7.4.5)";
const IDLE_STREAM: &str = "a stream that the program does not use moves nothing without EN (RM0390 section 9.5.5)";
const INPUT: &str = "OTYPER says nothing of an input (RM0390 section 7.4.2)";
const DRIVEN: &str = "the other end drives the line, push-pull: a pull of 40 kilohm does not move it (data sheet, I/O static characteristics)";
const NO_OUTPUT: &str = "ODR says nothing where the pin is no output of the program's own (RM0390 section 7.3.11)";
const NO_FUNCTION: &str = "AFR says nothing where the pin is not on its alternate function (RM0390 section 7.4.9)";
const SELECTED: &str =
    "the ADC is selected from the set-up of the pin until the first frame ends: that frame is the set-up's, and no sample of it is used (SBAS950 section 8.5.1.1)";
const FAST_ENOUGH: &str = "the pin is fast enough for its signal (data sheet, I/O AC characteristics: 4 and 25 MHz at the two lowest speeds), and the clock of SPI1 for PCLK2 (errata ES0298 section 2.14)";

/// Rules that need nothing but the register and its fields.
const RULES: &[Rule] = &[
    rule("FLASH.ACR", &["ICEN", "DCEN", "PRFTEN"], "caches and prefetch change the time that instructions take, and no result: after each erase the program empties them (RM0390 section 3.4.2)"),
    rule("FLASH.ACR", &["LATENCY"], "more wait states than needed: slower, and no result changes (RM0390 section 3.4.1)"),
    rule("FLASH.CR", &["EOPIE", "ERRIE"], UNUSED_INTERRUPT),
    rule("FLASH.CR", &["SNB"], "the sector's number is looked at when an erase starts (RM0390 section 3.8.5)"),
    rule("ST?.CR", &["TEIE", "DMEIE"], "no transfer error comes of addresses that are there (RM0390 section 9.3.17)"),
    rule("ST?.CR", &["MSIZE", "MBURST", "PBURST"], "in direct mode the chip sets widths and bursts itself (RM0390 section 9.5.5)"),
    rule("ST?.CR", &["CT", "PINCOS"], "without DBM, and without PINC, it has no effect (RM0390 section 9.5.5)"),
    rule("ST?.CR", &["PL"], "a stream waits for another for one access of the bus, and each is asked for once in 10 us at most (RM0390 section 9.3.4)"),
    rule("ST?.FCR", &["FTH", "FS"], "the FIFO is not used in direct mode (RM0390 section 9.5.10)"),
    rule("ST?.M1AR", &[], "the second buffer is used with DBM only (RM0390 section 9.5.9)"),
    rule("CR1", &["ARPE"], "ARR is not changed while the timer runs (RM0390 section 17.4.1)"),
    rule("TIM2.CR1", &["URS", "UIFREMAP"], "no interrupt or DMA request of an update event is enabled (RM0390 section 17.4.1)"),
    rule("TIM3.CR1", &["URS", "UIFREMAP"], "no interrupt or DMA request of an update event is enabled (RM0390 section 17.4.1)"),
    rule("TIM2.CR1", &["UDIS"], "PSC keeps its 0 and ARR is not buffered: no update event is needed (RM0390 section 17.4.1)"),
    rule("TIM5.CR1", &["UIFREMAP"], RESERVED),
    rule("TIM5.CR1", &["URS"], "the flag of the update that the start makes is cleared behind it (RM0390 section 17.4.1)"),
    rule("TIM2.SMCR", &["TS", "ETF", "ETPS", "ETP"], "trigger input that no slave mode uses (RM0390 section 17.4.3)"),
    rule("TIM5.SMCR", &["TS", "ETF", "ETPS", "ETP"], "trigger input that no slave mode uses (RM0390 section 17.4.3)"),
    rule("SMCR", &["MSM"], "it delays the trigger input by some clocks, and nothing else (RM0390 section 17.4.3)"),
    rule("TIM5.CR2", &[], "nothing takes the trigger output of TIM5, and it has no DMA request (RM0390 section 17.4.2)"),
    rule("TIM3.CR2", &["MMS", "CCDS"], "nothing takes the trigger output of TIM3, and it has no DMA request (RM0390 section 17.4.2)"),
    rule("TIM5.DIER", &["UIE", "CCIE0"], LATER),
    rule("TIM5.CCR0", &[], LATER),
    rule("TIM2.SR", &["UIF", "CCIF0", "CCIF1", "CCIF2", "CCOF0", "CCOF1", "CCOF2", "TIF"], "flags that nobody looks at: these channels are served by DMA (RM0390 section 17.4.5)"),
    rule("TIM3.CCER", &["CCE1", "CCE2", "CCE3", "CCP1", "CCP2", "CCP3", "CCNP1", "CCNP2", "CCNP3"], "channels 2 to 4 have no pin (RM0390 section 17.4.9)"),
    rule("TIM3.CCMR_INPUT1", &[], "channels 3 and 4 are off and have no pin (RM0390 section 17.4.8)"),
    rule("TIM5.CCMR_INPUT1", &[], "channels 3 and 4 are off and have no pin (RM0390 section 17.4.8)"),
    rule("TIM3.CCMR_INPUT0", &["CCS1", "ICPSC1", "ICF1", "OCCE1", "OCFE1", "OCM1", "OCPE1"], "channel 2 is off and has no pin (RM0390 section 17.4.7)"),
    rule("TIM5.CCER", &[], "no pin is set to a channel of TIM5 (RM0390 section 17.4.9)"),
    rule("TIM5.DIER", &["CCIE2", "CCIE3"], "one more call a turn of a handler that clears every flag it reads (RM0390 section 17.4.5)"),
    rule("TIM5.DIER", &["CCDE0", "CCDE1", "CCDE2", "CCDE3"], "no stream is set to a request of TIM5, and nothing else comes of one (RM0390 table 28)"),
    rule("USART1.CR1", &["RXNEIE"], "each byte then wakes the handler, which reads DR only while no byte waits for the DMA (RM0390 section 25.6.4)"),
    rule("USART1.CR3", &["EIE"], "an error then wakes the handler at once, which counts it and leaves DR to the DMA (RM0390 section 25.6.6)"),
    rule("TIM3.SR", &["UIF", "CCIF1", "CCIF2", "CCIF3", "CCOF0", "TIF"], "flags that nobody looks at (RM0390 section 17.4.5)"),
    rule("SPI1.CR1", &["CRCNEXT", "BIDIOE"], "without CRCEN, and without BIDIMODE, it has no effect (RM0390 section 26.7.1)"),
    rule("SPI1.CR2", &["ERRIE", "RXNEIE", "TXEIE"], UNUSED_INTERRUPT),
    rule("SPI1.CR2", &["SSOE"], "with SSM, NSS is no pin (RM0390 section 26.7.2)"),
    rule("SPI1.CRCPR", &[], "without CRCEN it has no effect (RM0390 section 26.7.5)"),
    rule("USART1.CR1", &["WAKE", "PS", "PEIE"], "without a mute receiver, and without parity, it has no effect (RM0390 section 25.6.4)"),
    rule("USART1.CR2", &["ADD", "LBDL", "LBDIE", "LBCL", "CPHA", "CPOL", "CLKEN"], "LIN, addresses and the synchronous clock, whose pin is not wired, are not used (RM0390 section 25.6.5)"),
    rule("USART1.CR3", &["IRLP", "NACK", "RTSE", "CTSIE"], "infrared, smartcards and the lines of flow control, which are not wired, are not used (RM0390 section 25.6.6)"),
    rule("USART1.CR3", &["ONEBIT"], "one sample a bit in the place of three: it matters on a noisy line (RM0390 section 25.6.6)"),
    rule("USART1.GTPR", &[], "infrared and smartcards are not used (RM0390 section 25.6.7)"),
    rule("PWR.CR1", &["LPDS", "PDDS", "CWUF", "CSBF", "FPDS", "LPLVDS", "MRLVDS", "UDEN"], "stop and standby modes are not used (RM0390 section 5.4.1)"),
    rule("PWR.CR1", &["ADCDC1"], "it makes the chip's own ADC less noisy, which only measures temperature and supply to some percent (RM0390 section 5.4.1)"),
    rule("PWR.CR1", &["DBP"], "the backup domain is used with a battery only (RM0390 section 5.4.1)"),
    rule("RCC.CR", &["HSION", "HSIRDY"], "HSI is asked for by nothing once the PLL runs on HSE (RM0390 section 6.2.2)"),
    rule("RCC.CR", &["PLLI2SON", "PLLSAION"], "nothing takes the clock of this PLL: only current (RM0390 section 6.3.1)"),
    rule("RCC.PLLCFGR", &["PLLQ", "PLLR"], "nothing takes these outputs of the PLL, and the setting is an allowed one (RM0390 section 6.3.2)"),
    rule("RCC.PLLI2SCFGR", &[], "this PLL is off (RM0390 section 6.3.23)"),
    rule("RCC.PLLSAICFGR", &[], "this PLL is off (RM0390 section 6.3.24)"),
    rule("RCC.CFGR", &["MCO1PRE", "MCO1SEL", "MCO1EN", "MCO2PRE", "MCO2SEL", "MCO2EN", "I2SSRC"], "clock outputs, whose pins are not set to them, and I2S are not used (RM0390 section 6.3.3)"),
    rule("RCC.CFGR", &["RTCPRE"], "HSE / RTCPRE goes to the RTC and TIM11, which do not use it from then on (RM0390 section 6.3.3)"),
    rule("RCC.BDCR", &[], "the backup domain is used with a battery only (RM0390 section 6.3.20)"),
    rule("RCC.CIR", &[], UNUSED_INTERRUPT),
    rule("RCC.CSR", &["LSION", "LSIRDY"], "the watchdog switches LSI on itself (RM0390 section 6.2.5)"),
    rule("RCC.DCKCFGR", &["CKDFSDM1ASEL", "CKDFSDM1SEL", "CKDFSDM2ASEL", "CLK48SEL", "DSISEL", "I2S1SRC", "I2S2SRC", "I2SSRC", "PLLDIVR", "PLLI2SDIVQ", "PLLI2SDIVR", "PLLSAIDIVQ", "PLLSAIDIVR", "SAI1ASRC", "SAI1BSRC", "SAI1SRC", "SAI2SRC", "SDMMCSEL"], "clocks of audio and USB, which the program does not use (RM0390 section 6.3.25)"),
    rule("RCC.DCKCFGR2", &[], "clocks of peripherals that the program does not use (RM0390 section 6.3.27)"),
    rule("DBGMCU.CR", &[], "what a debugger sees of sleep; the program does not change (RM0390 section 33.16.3)"),
    rule("DBGMCU.APB1FZR", &[], "what stands while a debugger halts the processor (RM0390 section 33.16.4)"),
    rule("LCKR", &[], "without the key's sequence nothing is locked (RM0390 section 7.4.8)"),
    rule("EXTI.IMR0", &[], "no line has an edge selected, and no interrupt of EXTI is enabled (RM0390 section 10.3.1)"),
];

/// Those of them that do nothing but wake tasks which run in UART4's interrupt.
const WAKING: [&str; 3] = ["DMA2_STREAM5", "DMA2_STREAM7", "USART1"];

/// The one of them whose ring lasts longer than any task runs: 5.5 ms, that of the link.
const RING: &str = "DMA2_STREAM5";

/// Streams that the program uses: address of CR.
const STREAMS: [u32; 7] = [0x4002_6028, 0x4002_6088, 0x4002_60A0, 0x4002_6410, 0x4002_6458, 0x4002_6488, 0x4002_64B8];

/// Peripherals that the program uses once its start is over. (TIM11 has counted the crystal by then, and is off.)
const USED: [&str; 16] = [
    "ADC1", "DMA1", "DMA2", "GPIOA", "GPIOB", "GPIOC", "TIM2", "TIM3", "TIM5", "SPI1", "USART1", "PWR", "CRC", "FLASH",
    "RCC", "IWDG",
];

/// Interrupts that the program lives by: those of its streams, timers and link, and those that run tasks. (The streams of the captures raise none.)
const RAISED: [&str; 9] =
    ["DMA2_STREAM0", "DMA2_STREAM5", "DMA2_STREAM7", "TIM2", "TIM3", "TIM5", "USART1", "UART4", "UART5"];

/// Fields of a register of the ADC that do not matter with all others as they are set: register (the first of each channel's five from 9 on), bits,
/// reason. (SBAS950 section 8.6.)
const SETTING_RULES: &[(u8, u16, &str)] = &[
    (0x02, 0xC0E0, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
    (0x02, 1 << 13, "the ADC's own watch over its registers: the exam changes none of them behind the unit's back; the campaign of faults does, and the test of all settings holds it against the data sheet (SBAS950 section 8.6)"),
    (0x02, 1 << 10, "a flag that a write of 1 does not change (SBAS950 section 8.6)"),
    (0x02, 0b1101, "the edge of DRDY is the same: all channels have the same phase, and it falls with each sample (SBAS950 section 8.5.1)"),
    (0x02, 1 << 4, "without the time-out an ADC whose frame was cut short waits for the next fall of its chip select (SBAS950 section 8.5.1)"),
    (0x03, 0x0003, "at 2.048 MHz the ADC's modulator is fast enough in each power mode (SBAS950 section 6.3)"),
    (0x03, 1 << 7, "the ADC's clock comes from an oscillator: its own for a crystal may be on (SBAS950 section 8.6)"),
    (0x06, 0xE000, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
    (0x06, 0x1E00, "the delay of the global chop, which is off (SBAS950 section 8.6)"),
    (0x06, 0x00FE, "settings of the current detection, which is off (SBAS950 section 8.6)"),
    (0x07, 0xFFFF, "settings of the current detection, which is off (SBAS950 section 8.6)"),
    (0x08, 0xFF00, "settings of the current detection, which is off (SBAS950 section 8.6)"),
    (0x08, 0x00F0, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
    (0x08, 0x000F, "each channel has the DC block off (SBAS950 section 8.6)"),
    (0x09, 0xFFC0, "a channel late or early by 0.125 ms at most, which no value shows: the test of all settings against the data sheet does (SBAS950 section 8.6)"),
    (0x09, 0x0038, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
    (0x09, 1 << 2, "the DC block is off for all channels (SBAS950 section 8.6)"),
    (0x0B, 0x00FF, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
    (0x0B, 0xFF00, "an offset of 255 codes at most, which the calibration takes (SBAS950 section 8.6)"),
    (0x0D, 0xFF00, "a gain of 30 parts per million at most, which the scale factor takes (SBAS950 section 8.6)"),
    (0x0C, 0x01FF, "a gain off by less than 1.6 %: within the limits of the built-in test, and a scale factor takes it (SBAS950 section 8.6)"),
    (0x0D, 0x00FF, "reserved bits of the ADC's registers (SBAS950 section 8.6)"),
];

/// First register of the ADC's channels behind those of the three rates, which the program takes nothing from, and the gains of these channels.
const FIRST_UNUSED: u8 = 0x09 + 3 * 5;
const UNUSED: [(u8, u16); 2] = [(0x04, 0xF000), (0x05, 0xFFFF)];

/// The rule by which changed bits of a setting of the ADC do not matter, if each is covered.
pub fn setting(register: u8, bits: u16) -> Option<&'static str> {
    let unused = UNUSED.iter().find(|(r, mask)| *r == register && bits & !mask == 0);
    if unused.is_some() || register >= FIRST_UNUSED {
        return Some("a channel of the ADC that this program takes nothing from (feature aux does); the test of all settings holds it against the data sheet (SBAS950 section 8.6)");
    }
    let of_each = if register >= 0x09 { 0x09 + (register - 0x09) % 5 } else { register };
    let rules: Vec<_> = SETTING_RULES.iter().filter(|(r, mask, _)| *r == of_each && mask & bits != 0).collect();
    let covered = rules.iter().fold(0, |all, (_, mask, _)| all | mask);
    rules.first().filter(|_| bits & !covered == 0).map(|(_, _, why)| *why)
}

/// The rules, with what they must know of the program.
pub struct Rules {
    part: &'static Part,
    wired: Vec<Pin>,
    /// Priorities at the end of the start, by interrupt.
    priorities: BTreeMap<usize, u32>,
}

/// Pins of the debug port (data sheet, table 10).
const SWDIO: Pin = Pin(0, 13);
const SWCLK: Pin = Pin(0, 14);

/// First byte of the priorities.
const PRIORITIES: u32 = 0xE000_E400;

impl Rules {
    /// For a program that writes this.
    pub fn new(part: &'static Part, recorded: &[RegisterWrite]) -> Self {
        let w = &part.wiring;
        let single =
            [w.data_ready, w.pulse, w.mark, w.clock, w.from_adc, w.to_adc, w.select, w.reset, w.link_out, w.link_in];
        // And the debug port.
        let wired = w.resonators.into_iter().chain(single).chain([SWDIO, SWCLK]).collect();
        let mut priorities = BTreeMap::new();
        for r in recorded.iter().filter(|r| (PRIORITIES..PRIORITIES + 0x100).contains(&r.address)) {
            for k in 0..r.size as u32 {
                priorities.insert((r.address - PRIORITIES + k) as usize, r.value >> (8 * k) & 0xF0);
            }
        }
        Self { part, wired, priorities }
    }

    /// The rule by which a mutant that nobody noticed is harmless, if any: every bit in which the registers differ after the start must be.
    pub fn harmless(&self, good: &BTreeMap<u32, u32>, found: &BTreeMap<u32, u32>) -> Option<&'static str> {
        let mut first = None;
        for (address, value) in good {
            let other = found.get(address).copied().unwrap_or(0);
            if other != *value {
                let why = self.bits(*address, value ^ other, other)?;
                first = first.or(Some(why));
            }
        }
        Some(first.unwrap_or(SAME_STATE))
    }

    /// Bits of a register that change, to this value.
    fn bits(&self, address: u32, bits: u32, value: u32) -> Option<&'static str> {
        match address {
            0xE000_E100..=0xE000_E3FF => return self.interrupts(address, bits),
            0xE000_E400..=0xE000_E4FF => return self.priorities(address, bits, value),
            0x4002_6010..=0x4002_67FF if address & 0x3FF >= 0x10 => {
                let cr = address - ((address & 0x3FF) - 0x10) % 0x18;
                if !STREAMS.contains(&cr) && (address != cr || value & 1 == 0) {
                    return Some(IDLE_STREAM);
                }
            }
            0x4002_0000..=0x4002_1FFF => {
                if let Some(why) = self.pins(address, bits, value) {
                    return Some(why);
                }
            }
            _ => {}
        }
        let name = self.part.tables.register_name(address);
        let register = self.part.tables.registers.get(&address)?;
        let peripheral = self.part.tables.peripheral_at(address)?;
        if !USED.contains(&peripheral.name.as_str()) && address < 0xE000_0000 {
            return Some("a peripheral that the program does not use");
        }
        // stm32-metapac has one set of registers for the timers of all families: here they have 16 bits, but for counters.
        let narrow = name.starts_with("TIM") && !register.fields.is_empty();
        let left = bits & register.mask() & if narrow { 0xFFFF } else { u32::MAX };
        if left == 0 {
            return Some(RESERVED);
        }
        if name.starts_with("RCC.A") && (name.contains("ENR") || name.ends_with("RSTR")) {
            return self.gates(address, left);
        }
        if name == "USART1.BRR" && (48..=49).contains(&value) {
            return Some("the baud rate is off by less than 2 % (RM0390 section 25.4.5)");
        }
        let mut why = None;
        for field in register.fields.iter().filter(|f| f.mask() & left != 0) {
            why = Some(
                RULES
                    .iter()
                    .find(|r| r.of(&name) && (r.fields.is_empty() || r.fields.contains(&field.name.as_str())))?
                    .why,
            );
        }
        if register.fields.is_empty() {
            why = RULES.iter().find(|r| r.of(&name) && r.fields.is_empty()).map(|r| r.why);
        }
        why
    }

    /// The rule by which the vector of an exception does not matter.
    pub fn vector(&self, exception: u32) -> Option<&'static str> {
        // NMI is the crystal's; HardFault takes what is not enabled by itself.
        match exception {
            0..=3 => None,
            4..=6 => Some("an exception that is not enabled: it becomes a HardFault (PM0214 section 2.4.1)"),
            7..=15 => Some("an exception that nothing raises (PM0214 section 2.3.2)"),
            n => {
                let name = self.part.tables.interrupts.get(&(n as usize - 16)).map_or("", String::as_str);
                (!RAISED.contains(&name)).then_some(UNUSED_INTERRUPT)
            }
        }
    }

    /// Bits that enable, disable or pend interrupts.
    fn interrupts(&self, address: u32, bits: u32) -> Option<&'static str> {
        let first = ((address & 0x7F) / 4 * 32) as usize;
        let raised = |n: usize| self.part.tables.interrupts.get(&n).is_some_and(|name| RAISED.contains(&name.as_str()));
        (0..32).filter(|b| bits & 1 << b != 0).all(|b| !raised(first + b)).then_some(UNUSED_INTERRUPT)
    }

    /// Priorities of four interrupts.
    fn priorities(&self, address: u32, bits: u32, value: u32) -> Option<&'static str> {
        let changed = (0..4).filter(|k| bits >> (8 * k) & 0xFF != 0);
        let each = changed.map(|k| self.priority((address - PRIORITIES + k) as usize, value >> (8 * k) & 0xF0));
        each.collect::<Option<Vec<_>>>()?.first().copied()
    }

    /// A priority, which must not change the order of interrupts that are raised.
    fn priority(&self, n: usize, new: u32) -> Option<&'static str> {
        let name = |n: usize| self.part.tables.interrupts.get(&n).map_or("", String::as_str);
        let raised = |n: usize| RAISED.contains(&name(n));
        if !raised(n) {
            return Some(UNUSED_INTERRUPT);
        }
        let of = |wanted: &str| self.priorities.iter().find(|(k, _)| name(**k) == wanted).map_or(0, |(_, p)| *p);
        if name(n) == RING {
            return Some(RING_LASTS);
        }
        if name(n) == "DMA2_STREAM0" {
            return Some(FRAME_LASTS);
        }
        if WAKING.contains(&name(n)) && new <= of("UART4") {
            return Some(WAKES);
        }
        if name(n) == "UART5" && new < of("UART4") {
            return Some(RATE_TASK);
        }
        let old = self.priorities.get(&n).copied().unwrap_or(0);
        let kept = |other: u32| old == other || (old < other) == (new < other) && new != other;
        self.priorities.iter().filter(|(k, _)| **k != n && raised(**k)).all(|(_, p)| kept(*p)).then_some(ORDER)
    }

    /// Clock gates and resets.
    fn gates(&self, address: u32, bits: u32) -> Option<&'static str> {
        let offset = address - 0x4002_3800;
        // Gates in sleep lie 0x20 behind those awake.
        let used = |bit: u32| {
            self.part.tables.peripherals.values().any(|p| {
                let mine =
                    |b: Option<(u32, u32)>| b.is_some_and(|(o, b)| b == bit && (o == offset || o + 0x20 == offset));
                USED.contains(&p.name.as_str()) && (mine(p.enable) || mine(p.reset))
            })
        };
        (0..32).filter(|b| bits & 1 << b != 0).all(|b| !used(b)).then_some(UNUSED_CLOCK)
    }

    /// Rule by which changed bits of a port's register do not matter; `None`: no rule applies.
    fn pins(&self, address: u32, bits: u32, value: u32) -> Option<&'static str> {
        let (port, register) = ((address - 0x4002_0000) as usize / 0x400, address & 0x3FF);
        // The mask of the k-th pin in the register, and the pins that it has.
        let mask = |k: usize| match register {
            0x00 | 0x08 | 0x0C => 3 << (2 * k),
            0x04 | 0x10 | 0x14 => 1 << k,
            0x18 => 0x1_0001 << k,
            _ => 0xFu32 << (4 * (k % 8)),
        };
        let pins = match register {
            0x00 | 0x04 | 0x08 | 0x0C | 0x10 | 0x14 | 0x18 => 0..16,
            0x20 => 0..8,
            0x24 => 8..16,
            _ => return None,
        };
        let touched: Vec<Pin> = pins.filter(|k| bits & mask(*k) != 0).map(|k| Pin(port, k)).collect();
        let wired: Vec<Pin> = touched.into_iter().filter(|p| self.wired.contains(p)).collect();
        if wired.is_empty() {
            return Some(UNWIRED);
        }
        let w = &self.part.wiring;
        let inputs = [&w.resonators[..], &[w.data_ready, w.pulse, w.from_adc, w.link_in, SWCLK]].concat();
        // Of the unit's outputs only the two of the bus are above what the lowest speed is good for. APB2 runs at half of its limit.
        let pclk2 = self.part.clocks.apb2 / 2;
        let fast_enough = |p: &Pin| match value >> (2 * p.1) & 3 {
            speed if *p == w.clock => FED_BACK_MAX_HZ[speed as usize] >= pclk2,
            speed => *p != w.to_adc || speed != 0,
        };
        let pulled = w.resonators.contains(&wired[0]) || [w.from_adc, w.link_in].contains(&wired[0]);
        match register {
            0x10 => Some(READ_ONLY),
            // The data of a pin that is no output.
            0x14 | 0x18 if wired.iter().all(|p| ![w.select, w.reset, w.mark].contains(p)) => Some(NO_OUTPUT),
            0x04 if wired.iter().all(|p| inputs.contains(p)) => Some(INPUT),
            0x20 | 0x24 if wired.iter().all(|p| [w.select, w.reset, w.mark].contains(p)) => Some(NO_FUNCTION),
            0x14 | 0x18 if wired.iter().all(|p| *p == w.select) && value == 0 => Some(SELECTED),
            0x08 if wired.iter().all(fast_enough) => Some(FAST_ENOUGH),
            // (The link in rests high: pulled down, it would receive a break.)
            0x0C if wired.iter().all(|p| {
                let pull = value >> (2 * p.1) & 3;
                !pulled || pull == 1 || pull == 2 && *p != w.link_in
            }) =>
            {
                Some(DRIVEN)
            }
            _ => None,
        }
    }
}

impl Rule {
    /// `true` if it is about a register of this name; `?` is any stream.
    fn of(&self, name: &str) -> bool {
        match self.register.split_once('?') {
            Some((before, after)) => name.contains(before) && name.ends_with(after),
            None => name == self.register || name.ends_with(&format!(".{}", self.register)),
        }
    }
}
