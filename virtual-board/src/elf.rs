//! The firmware's ELF, read once: what lies where in flash, and what is called how.

use crate::error::RunError;
use crate::{FLASH_SIZE, FLASH_START, RAM_SIZE, RAM_START};
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Object, ObjectSegment, ObjectSymbol, SymbolKind};
use std::ops::Range;

/// A function or variable.
#[derive(Debug, Clone)]
struct Symbol {
    /// Path as one writes it (`hrg_core::link::Message::encode`), whatever mangling the compiler used.
    path: String,
    address: u32,
    size: u32,
    function: bool,
}

/// The firmware.
#[derive(Debug, Clone)]
pub struct Firmware {
    flash: Vec<u8>,
    statics: Range<u32>,
    stack: Range<u32>,
    /// By address.
    symbols: Vec<Symbol>,
}

/// The path of a mangled name, without hashes: `<a::B>::c` of the v0 mangling and `a::B::c` of the legacy one are the same path.
fn path(mangled: &str) -> String {
    let name = format!("{:#}", rustc_demangle::demangle(mangled));
    // A method of a type that stands in another module than its type: `module::<impl a::B>::c`.
    let name = name.split_once("<impl ").map_or(name.as_str(), |(_, of)| of);
    match name.strip_prefix('<').unwrap_or(name).split_once(">::") {
        Some((of, method)) if !of.contains(['<', ' ']) => format!("{of}::{method}"),
        _ => name.to_string(),
    }
}

impl Firmware {
    /// Reads an ELF.
    ///
    /// # Errors
    /// If it is none, or does not fit the board.
    pub fn parse(elf: &[u8]) -> Result<Self, RunError> {
        let file = object::File::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
        let mut flash = vec![0xFFu8; FLASH_SIZE as usize];
        for segment in file.segments() {
            let data = segment.data().map_err(|e| RunError::Elf(e.to_string()))?;
            if data.is_empty() {
                continue;
            }
            let address = load_address(elf, segment.address())?;
            let at = address.checked_sub(FLASH_START).map_or(usize::MAX, |a| a as usize);
            flash
                .get_mut(at..at.saturating_add(data.len()))
                .ok_or_else(|| RunError::Elf(format!("a segment at {address:#010x} is outside the flash")))?
                .copy_from_slice(data);
        }
        let ram_end = RAM_START + RAM_SIZE;
        let in_ram = file
            .segments()
            .filter(|s| (RAM_START..ram_end).contains(&(s.address() as u32)))
            .map(|s| (s.address() as u32, s.address().saturating_add(s.size()).min(u64::from(ram_end)) as u32));
        let (start, end) = in_ram.fold((ram_end, RAM_START), |(a, b), (c, d)| (a.min(c), b.max(d)));
        let statics = if start < end { start..end } else { RAM_START..RAM_START };
        let mut symbols: Vec<Symbol> = file
            .symbols()
            .filter_map(|s| {
                let function = s.kind() == SymbolKind::Text;
                let address = if function { s.address() as u32 & !1 } else { s.address() as u32 };
                Some(Symbol { path: path(s.name().ok()?), address, size: s.size() as u32, function })
            })
            .collect();
        symbols.sort_by(|a, b| (a.address, &a.path).cmp(&(b.address, &b.path)));
        // A program behind a loader has a stack of its own.
        let own = symbols.iter().find(|s| s.path == "_stack_start").map(|s| s.address);
        let first = u32::from_le_bytes([flash[0], flash[1], flash[2], flash[3]]);
        let top = own.unwrap_or(first).clamp(RAM_START, ram_end);
        // It grows down to the statics, or to the start of RAM where it lies below them.
        let stack = if top <= statics.start { RAM_START..top } else { statics.end.min(top)..top };
        Ok(Self { flash, statics, stack, symbols })
    }

    /// The whole flash.
    #[must_use]
    pub fn flash(&self) -> &[u8] {
        &self.flash
    }

    /// The word at an address in flash.
    #[must_use]
    pub fn word(&self, address: u32) -> Option<u32> {
        let at = address.checked_sub(FLASH_START)? as usize;
        Some(u32::from_le_bytes(self.flash.get(at..at + 4)?.try_into().ok()?))
    }

    /// Range of RAM that statics occupy.
    #[must_use]
    pub fn statics(&self) -> Range<u32> {
        self.statics.clone()
    }

    /// Range of RAM in which the stack may grow.
    #[must_use]
    pub fn stack(&self) -> Range<u32> {
        self.stack.clone()
    }

    /// Address of the control block of the log.
    #[must_use]
    pub fn rtt(&self) -> Option<u32> {
        self.address_of("_SEGGER_RTT")
    }

    /// Address of the one function of a path.
    ///
    /// # Errors
    /// If there is none, or several.
    pub fn function(&self, path: &str) -> Result<u32, RunError> {
        let mut found: Vec<u32> =
            self.symbols.iter().filter(|s| s.function && s.path == path).map(|s| s.address).collect();
        found.dedup();
        match found[..] {
            [entry] => Ok(entry),
            _ => Err(RunError::Elf(format!("{} functions are called {path}", found.len()))),
        }
    }

    /// Address of the variable or function of a path.
    #[must_use]
    pub fn address_of(&self, path: &str) -> Option<u32> {
        self.place_of(path).map(|place| place.start)
    }

    /// The bytes of a variable, by its path.
    #[must_use]
    pub fn place_of(&self, path: &str) -> Option<Range<u32>> {
        self.symbols.iter().find(|s| s.path == path).map(|s| s.address..s.address.saturating_add(s.size))
    }

    /// The path of the variable or function that an address lies in.
    #[must_use]
    pub fn symbol_at(&self, address: u32) -> Option<&str> {
        let within = |s: &&Symbol| s.size > 0 && (s.address..s.address.saturating_add(s.size)).contains(&address);
        self.symbols.iter().find(within).map(|s| s.path.as_str())
    }

    /// The path of the function that begins last before an address in flash.
    #[must_use]
    pub fn function_before(&self, address: u32) -> Option<&str> {
        let before = self.symbols.partition_point(|s| s.address <= address);
        self.symbols[..before].iter().rev().find(|s| s.function && s.address >= FLASH_START).map(|s| s.path.as_str())
    }
}

/// Address at which a segment is loaded (physical), given the address at which it runs.
fn load_address(elf: &[u8], virtual_address: u64) -> Result<u32, RunError> {
    let file = ElfFile32::<object::Endianness>::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
    let endian = file.endian();
    file.elf_program_headers()
        .iter()
        .find(|h| u64::from(h.p_vaddr(endian)) == virtual_address && h.p_filesz(endian) > 0)
        .map(|h| h.p_paddr(endian))
        .ok_or_else(|| RunError::Elf(format!("no program header for {virtual_address:#x}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_manglings_give_one_path() {
        for (mangled, expected) in [
            ("_ZN8hrg_core4link7Message6encode17h0123456789abcdefE", "hrg_core::link::Message::encode"),
            ("_RNvMs_NtCs1234_8hrg_core4linkNtB4_7Message6encode", "hrg_core::link::Message::encode"),
            (
                "_ZN8hrg_core4link5codec41_$LT$impl$u20$hrg_core..link..Message$GT$6encode17h0123456789abcdefE",
                "hrg_core::link::Message::encode",
            ),
            ("_ZN8hrg_core3adc6decode17h0123456789abcdefE", "hrg_core::adc::decode"),
            ("_RNvNtCs1234_8hrg_core3adc6decode", "hrg_core::adc::decode"),
            ("_SEGGER_RTT", "_SEGGER_RTT"),
        ] {
            assert_eq!(path(mangled), expected);
        }
    }
}
