//! Fixed properties of a chip: addresses, clock gates, alternate functions, DMA requests, interrupts, bits of registers.
//!
//! The tables in `chips/` are printed by `chip-tables` from stm32-metapac, whose source are STMicroelectronics' own files; a test there compares
//! them. Nothing in them comes from a firmware.

use std::collections::{BTreeMap, HashMap};
use std::fmt;

/// A bit of a register of RCC: offset and bit.
pub type RccBit = (u32, u32);

/// A peripheral.
#[derive(Debug, Clone)]
pub struct Peripheral {
    /// `TIM2`.
    pub name: String,
    /// First address of its registers.
    pub address: u32,
    /// Its clock gate; `None`: it is always clocked.
    pub enable: Option<RccBit>,
    /// Its reset.
    pub reset: Option<RccBit>,
}

/// A pin: port (0 is A) and number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pin(pub usize, pub usize);

impl Pin {
    /// `PA0`.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        let port = name.strip_prefix('P')?.bytes().next()?.checked_sub(b'A')?;
        Some(Self(usize::from(port), name.get(2..)?.parse().ok().filter(|n| *n < 16)?))
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", char::from(b'A' + self.0 as u8), self.1)
    }
}

/// A place of a DMA request.
#[derive(Debug, Clone)]
pub struct DmaPlace {
    /// 0 is DMA1.
    pub controller: usize,
    /// Stream.
    pub stream: usize,
    /// CHSEL.
    pub channel: u32,
    /// `SPI1_RX`.
    pub signal: String,
}

/// A field of a register.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// `CPHA`.
    pub name: String,
    /// Its lowest bit.
    pub bit: u32,
    /// Number of its bits.
    pub bits: u32,
}

impl Field {
    /// Its bits.
    #[must_use]
    pub fn mask(&self) -> u32 {
        (((1u64 << self.bits) - 1) << self.bit) as u32
    }
}

/// A register.
#[derive(Debug, Clone)]
pub struct Register {
    /// `SPI1.CR1`.
    pub name: String,
    /// Its fields; none: it is one number.
    pub fields: Vec<Field>,
}

impl Register {
    /// The bits that exist.
    #[must_use]
    pub fn mask(&self) -> u32 {
        if self.fields.is_empty() {
            u32::MAX
        } else {
            self.fields.iter().fold(0, |m, f| m | f.mask())
        }
    }
    /// Names of the fields that some bits belong to.
    #[must_use]
    pub fn fields_of(&self, bits: u32) -> String {
        let names: Vec<&str> = self.fields.iter().filter(|f| f.mask() & bits != 0).map(|f| f.name.as_str()).collect();
        names.join(", ")
    }
}

/// All of that.
#[derive(Debug, Clone, Default)]
pub struct Tables {
    /// By address.
    pub peripherals: BTreeMap<u32, Peripheral>,
    /// Alternate functions of the pins: number and signal (`TIM2_CH1`).
    pub pins: HashMap<Pin, Vec<(u32, String)>>,
    /// Places of DMA requests.
    pub dma: Vec<DmaPlace>,
    /// Names of interrupts, by number.
    pub interrupts: BTreeMap<usize, String>,
    /// By address.
    pub registers: BTreeMap<u32, Register>,
}

fn number(text: &str) -> Option<u32> {
    match text.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    }
}

impl Tables {
    /// Reads a table of `chips/`. A line that cannot be read is left out; the test reads them all.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        let mut out = Self::default();
        for line in text.lines().filter(|l| !l.starts_with('#')) {
            let _ = out.line(line);
        }
        out
    }

    fn line(&mut self, line: &str) -> Option<()> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match *words.first()? {
            "peripheral" => {
                let bit = |what: &str| {
                    let at = words.iter().position(|w| *w == what)?;
                    let (offset, bit) = words.get(at + 1)?.split_once(':')?;
                    Some((number(offset)?, number(bit)?))
                };
                let address = number(words.get(2)?)?;
                let name = (*words.get(1)?).to_string();
                self.peripherals
                    .insert(address, Peripheral { name, address, enable: bit("enable"), reset: bit("reset") });
            }
            "pin" => {
                let functions = words.get(2..)?.iter().map(|w| {
                    let (function, signal) = w.split_once('=')?;
                    Some((number(function)?, signal.to_string()))
                });
                self.pins.insert(Pin::parse(words.get(1)?)?, functions.collect::<Option<Vec<_>>>()?);
            }
            "dma" => self.dma.push(DmaPlace {
                controller: number(words.get(1)?.strip_prefix("DMA")?)? as usize - 1,
                stream: number(words.get(2)?)? as usize,
                channel: number(words.get(3)?)?,
                signal: (*words.get(4)?).to_string(),
            }),
            "interrupt" => {
                self.interrupts.insert(number(words.get(1)?)? as usize, (*words.get(2)?).to_string());
            }
            "register" => {
                let base = self.peripherals.values().find(|p| Some(&p.name.as_str()) == words.get(1))?.address;
                let field = |w: &&str| {
                    let mut parts = w.split(':');
                    let name = parts.next()?.to_string();
                    Some(Field { name, bit: number(parts.next()?)?, bits: number(parts.next()?)? })
                };
                let fields = words.get(4..)?.iter().map(field).collect::<Option<Vec<_>>>()?;
                let name = format!("{}.{}", words.get(1)?, words.get(3)?);
                self.registers.insert(base + number(words.get(2)?)?, Register { name, fields });
            }
            _ => return None,
        }
        Some(())
    }

    /// The peripheral whose registers an address lies in.
    #[must_use]
    pub fn peripheral_at(&self, address: u32) -> Option<&Peripheral> {
        let (base, found) = self.peripherals.range(..=address).next_back()?;
        (address - base < 0x400).then_some(found)
    }

    /// The alternate function that gives a pin to a signal; the first one, where the chip has several.
    #[must_use]
    pub fn function(&self, pin: Pin, signal: &str) -> Option<u32> {
        self.pins.get(&pin)?.iter().find(|(_, s)| s == signal).map(|(n, _)| *n)
    }

    /// Names of the signals of a pin's alternate function.
    #[must_use]
    pub fn signals(&self, pin: Pin, function: u32) -> String {
        let all = self.pins.get(&pin).into_iter().flatten().filter(|(n, _)| *n == function);
        let names: Vec<&str> = all.map(|(_, s)| s.as_str()).collect();
        if names.is_empty() {
            "nothing".into()
        } else {
            names.join(" or ")
        }
    }

    /// The number of an interrupt.
    #[must_use]
    pub fn interrupt(&self, name: &str) -> Option<usize> {
        self.interrupts.iter().find(|(_, n)| *n == name).map(|(k, _)| *k)
    }

    /// `SPI1.CR1`, or the address of what has no name.
    #[must_use]
    pub fn register_name(&self, address: u32) -> String {
        self.registers.get(&(address & !3)).map_or_else(|| format!("{address:#010x}"), |r| r.name.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_read() {
        for text in [crate::part::F446RE_TABLE, crate::part::F405RG_TABLE] {
            let mut tables = Tables::default();
            for line in text.lines().filter(|l| !l.starts_with('#')) {
                assert!(tables.line(line).is_some(), "{line}");
            }
            assert_eq!(tables.function(Pin(0, 9), "USART1_TX"), Some(7));
        }
    }

    // Rows written by hand from RM0390 (tables 28 and 29, section 6.3) and the data sheet of the STM32F446 (table 11).
    #[test]
    fn rows_of_the_manual() {
        let t = Tables::parse(crate::part::F446RE_TABLE);
        for (pin, signal, function) in [
            ("PA0", "TIM2_CH1", 1),
            ("PA1", "TIM2_CH2", 1),
            ("PB10", "TIM2_CH3", 1),
            ("PB2", "TIM2_CH4", 1),
            ("PC6", "TIM3_CH1", 2),
            ("PA5", "SPI1_SCK", 5),
            ("PA6", "SPI1_MISO", 5),
            ("PA7", "SPI1_MOSI", 5),
            ("PA9", "USART1_TX", 7),
            ("PA10", "USART1_RX", 7),
        ] {
            let pin = Pin::parse(pin).expect("a pin");
            assert_eq!(t.function(pin, signal), Some(function), "{pin} {signal}");
        }
        for (signal, controller, stream, channel) in [
            ("TIM2_CH1", 0, 5, 3),
            ("TIM2_CH2", 0, 6, 3),
            ("TIM2_CH3", 0, 1, 3),
            ("TIM2_CH4", 0, 7, 3),
            ("SPI1_RX", 1, 0, 3),
            ("SPI1_TX", 1, 3, 3),
            ("USART1_RX", 1, 5, 4),
            ("USART1_TX", 1, 7, 4),
        ] {
            let there = |d: &&DmaPlace| {
                (d.controller, d.stream, d.channel, d.signal.as_str()) == (controller, stream, channel, signal)
            };
            assert!(t.dma.iter().any(|d| there(&d)), "{signal}");
        }
        for (name, number) in
            [("EXTI9_5", 23), ("TIM2", 28), ("TIM3", 29), ("USART1", 37), ("TIM5", 50), ("DMA2_STREAM0", 56)]
        {
            assert_eq!(t.interrupt(name), Some(number), "{name}");
        }
        for (address, name, enable) in [
            (0x4000_0000, "TIM2", Some((0x40, 0))),
            (0x4001_3000, "SPI1", Some((0x44, 12))),
            (0x4001_1000, "USART1", Some((0x44, 4))),
            (0x4002_6400, "DMA2", Some((0x30, 22))),
            (0x4001_3C00, "EXTI", None),
        ] {
            let p = t.peripheral_at(address).expect("there");
            assert_eq!((p.name.as_str(), p.enable), (name, enable));
        }
    }
}
