//! `chip-tables`: what the virtual board must know of a chip, printed from the data of stm32-metapac, which STMicroelectronics' own files
//! are the source of. The tables lie in `virtual-board/chips`; the test here compares them with what would be printed now.
//!
//!     cargo run -p chip-tables > virtual-board/chips/stm32f446re.txt
//!     cargo run -p chip-tables --no-default-features --features stm32f405rg > virtual-board/chips/stm32f405rg.txt

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use stm32_metapac::metadata::ir::{Array, BitOffset, Block, BlockItemInner, Field, IR};
use stm32_metapac::metadata::{Peripheral, METADATA};

/// Peripherals of which the virtual board has registers, and their neighbours, to which a write may be sent by mistake.
const WITH_REGISTERS: [&str; 31] = [
    "CRC", "DBGMCU", "DMA1", "DMA2", "EXTI", "FLASH", "GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG",
    "GPIOH", "IWDG", "PWR", "RCC", "RTC", "SPI1", "SPI2", "SYSCFG", "TIM10", "TIM11", "TIM2", "TIM3", "TIM4", "TIM5",
    "USART1", "USART2", "USART6", "WWDG",
];

fn main() {
    print!("{}", table());
}

/// The table of the chip that this was built for.
fn table() -> String {
    let mut out = format!(
        "# {}: printed by chip-tables from stm32-metapac; not written by hand.\n\
         # peripheral NAME ADDRESS [enable OFFSET:BIT] [reset OFFSET:BIT] [clock NAME]   (offsets in RCC)\n\
         # pin NAME FUNCTION=SIGNAL...\n\
         # dma CONTROLLER STREAM CHANNEL SIGNAL\n\
         # interrupt NUMBER NAME\n\
         # register PERIPHERAL OFFSET NAME FIELD:BIT:BITS...   (none: all of it)\n",
        METADATA.name
    );
    for p in METADATA.peripherals {
        peripheral(&mut out, p);
    }
    pins(&mut out);
    for p in METADATA.peripherals {
        for d in p.dma_channels {
            if let (Some(channel), Some(request)) = (d.channel, d.request) {
                let (controller, stream) = channel.split_once("_CH").unwrap_or((channel, "?"));
                let _ = writeln!(out, "dma {controller} {stream} {request} {}_{}", p.name, d.signal);
            }
        }
    }
    for i in METADATA.interrupts {
        let _ = writeln!(out, "interrupt {} {}", i.number, i.name);
    }
    for p in METADATA.peripherals.iter().filter(|p| WITH_REGISTERS.contains(&p.name)) {
        let mut registers = Registers::new();
        if let Some(r) = &p.registers {
            block(&mut registers, r.ir, r.block, 0, "");
        }
        for (offset, (name, fields)) in registers {
            let fields: String = fields.iter().map(|f| format!(" {f}")).collect();
            let _ = writeln!(out, "register {} {offset:#05x} {name}{fields}", p.name);
        }
    }
    out
}

fn peripheral(out: &mut String, p: &Peripheral) {
    let _ = write!(out, "peripheral {} {:#010x}", p.name, p.address);
    if let Some(rcc) = &p.rcc {
        for (what, register) in [("enable", &rcc.enable), ("reset", &rcc.reset)] {
            if let Some((offset, bit)) = register.as_ref().and_then(|r| rcc_bit(r.register, r.field)) {
                let _ = write!(out, " {what} {offset:#04x}:{bit}");
            }
        }
        if let stm32_metapac::metadata::PeripheralRccKernelClock::Clock(clock) = rcc.kernel_clock {
            let _ = write!(out, " clock {clock}");
        }
    }
    out.push('\n');
}

/// Offset of a register of RCC, and the bit of a field in it.
fn rcc_bit(register: &str, field: &str) -> Option<(u32, u32)> {
    let rcc = METADATA.peripherals.iter().find(|p| p.name == "RCC")?.registers.as_ref()?;
    let item = rcc.ir.blocks.iter().flat_map(|b| b.items).find(|i| i.name.eq_ignore_ascii_case(register))?;
    let BlockItemInner::Register(r) = &item.inner else { return None };
    let set = rcc.ir.fieldsets.iter().find(|s| Some(s.name) == r.fieldset)?;
    let field = set.fields.iter().find(|f| f.name.eq_ignore_ascii_case(field))?;
    let BitOffset::Regular(bit) = &field.bit_offset else { return None };
    Some((item.byte_offset, bit.offset))
}

/// Every pin with its alternate functions.
fn pins(out: &mut String) {
    let mut all: BTreeMap<&str, Vec<(u8, String)>> = METADATA.pins.iter().map(|p| (p.name, Vec::new())).collect();
    for p in METADATA.peripherals {
        for pin in p.pins {
            if let (Some(function), Some(of)) = (pin.af, all.get_mut(pin.pin)) {
                of.push((function, format!("{}_{}", p.name, pin.signal)));
            }
        }
    }
    for (pin, mut functions) in all {
        functions.sort();
        let functions: Vec<String> = functions.into_iter().map(|(n, signal)| format!("{n}={signal}")).collect();
        let _ = writeln!(out, "pin {pin} {}", functions.join(" "));
    }
}

/// Offset of each element of an array, and the number that its name gets.
fn elements(array: Option<&Array>) -> Vec<(u32, String)> {
    match array {
        None => vec![(0, String::new())],
        Some(Array::Regular(a)) => (0..a.len).map(|k| (k * a.stride, k.to_string())).collect(),
        Some(Array::Cursed(a)) => a.offsets.iter().enumerate().map(|(k, o)| (*o, k.to_string())).collect(),
    }
}

/// Registers by offset: name, fields. A timer's block is made of smaller ones, and what captures and what compares share a register.
type Registers = BTreeMap<u32, (String, BTreeSet<String>)>;

/// The registers of a block and of the blocks in it.
fn block(out: &mut Registers, ir: &IR, name: &str, base: u32, prefix: &str) {
    let plain = name.replace('_', "");
    let of_name = |b: &&Block| b.name.eq_ignore_ascii_case(&plain) || b.name.eq_ignore_ascii_case(name);
    let Some(b) = ir.blocks.iter().find(of_name) else { return };
    if let Some(more) = b.extends {
        block(out, ir, more, base, prefix);
    }
    for item in b.items {
        for (offset, number) in elements(item.array.as_ref()) {
            let at = base + item.byte_offset + offset;
            let name = format!("{prefix}{}{number}", item.name.to_uppercase());
            match &item.inner {
                BlockItemInner::Block(inner) => block(out, ir, inner.block, at, &format!("{name}.")),
                BlockItemInner::Register(r) => {
                    let of = &mut out.entry(at).or_insert_with(|| (name, BTreeSet::new())).1;
                    // A whole register has no fields: that of a smaller timer has fewer bits.
                    match r.fieldset {
                        Some(set) => fields(of, ir, set),
                        None => of.clear(),
                    }
                }
            }
        }
    }
}

fn fields(out: &mut BTreeSet<String>, ir: &IR, set: &str) {
    let Some(set) = ir.fieldsets.iter().find(|s| s.name == set) else { return };
    if let Some(more) = set.extends {
        fields(out, ir, more);
    }
    set.fields.iter().for_each(|f| field(out, f));
}

fn field(out: &mut BTreeSet<String>, f: &Field) {
    let ranges: Vec<(u32, u32)> = match &f.bit_offset {
        BitOffset::Regular(r) => vec![(r.offset, f.bit_size)],
        BitOffset::Cursed(r) => r.ranges.iter().map(|r| (*r.start(), r.end() - r.start() + 1)).collect(),
    };
    for (offset, number) in elements(f.array.as_ref()) {
        for (bit, bits) in &ranges {
            out.insert(format!("{}{number}:{}:{bits}", f.name.to_uppercase(), bit + offset));
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_table_is_that_of_stm32_metapac() {
        let name = stm32_metapac::metadata::METADATA.name.to_lowercase();
        let path = format!("{}/../chips/{name}.txt", env!("CARGO_MANIFEST_DIR"));
        let kept = std::fs::read_to_string(&path).expect("there");
        assert!(kept == super::table(), "{path} is not what stm32-metapac says: print it anew (see main.rs)");
    }
}
