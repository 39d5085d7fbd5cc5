//! Facts of an ELF: flash and RAM that it needs, and the sum of its program.

use crate::slots;

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

/// Bytes in flash, and bytes of static RAM, of a 32-bit little-endian ELF.
pub fn flash_and_ram(elf: &[u8]) -> Option<(u64, u64)> {
    if elf.get(..5)? != [0x7F, b'E', b'L', b'F', 1] {
        return None;
    }
    let table = u32_at(elf, 28)? as usize;
    let (size, count) = (usize::from(u16_at(elf, 42)?), usize::from(u16_at(elf, 44)?));
    let (mut flash, mut ram) = (0, 0);
    for k in 0..count {
        let at = table + k * size;
        let load = u32_at(elf, at)? == 1;
        let address = u32_at(elf, at + 8)?;
        if load {
            // Loaded segments are in flash, wherever they run.
            flash += u64::from(u32_at(elf, at + 16)?);
            if (0x2000_0000..0x3000_0000).contains(&address) {
                ram += u64::from(u32_at(elf, at + 20)?);
            }
        }
    }
    Some((flash, ram))
}

/// File offset, address and size of a section.
fn section(elf: &[u8], name: &str) -> Option<(usize, u32, usize)> {
    let table = u32_at(elf, 32)? as usize;
    let (size, count) = (usize::from(u16_at(elf, 46)?), usize::from(u16_at(elf, 48)?));
    let names = u32_at(elf, table + usize::from(u16_at(elf, 50)?) * size + 16)? as usize;
    (0..count).map(|k| table + k * size).find_map(|at| {
        let from = elf.get(names + u32_at(elf, at)? as usize..)?;
        (from.starts_with(name.as_bytes()) && from.get(name.len()) == Some(&0)).then_some(())?;
        Some((u32_at(elf, at + 16)? as usize, u32_at(elf, at + 12)?, u32_at(elf, at + 20)? as usize))
    })
}

/// Bytes that an ELF puts into flash between two addresses; bytes that it leaves out are erased.
fn flash(elf: &[u8], from: u32, to: u32) -> Option<Vec<u8>> {
    let table = u32_at(elf, 28)? as usize;
    let (size, count) = (usize::from(u16_at(elf, 42)?), usize::from(u16_at(elf, 44)?));
    let mut out = vec![0xFF; to.checked_sub(from)? as usize];
    for at in (0..count).map(|k| table + k * size) {
        let (kind, offset, address, bytes) =
            (u32_at(elf, at)?, u32_at(elf, at + 4)?, u32_at(elf, at + 12)?, u32_at(elf, at + 16)?);
        let (begin, end) = (address.max(from), (address + bytes).min(to));
        if kind == 1 && begin < end {
            let source = (offset + (begin - address)) as usize;
            let n = (end - begin) as usize;
            let target = (begin - from) as usize;
            out.get_mut(target..target + n)?.copy_from_slice(elf.get(source..source + n)?);
        }
    }
    Some(out)
}

/// Writes the sum of the program into the marks of its slot.
pub fn write_integrity_word(elf: &mut [u8]) -> Option<u32> {
    let (offset, slot, _) = section(elf, ".slot")?;
    let start = slot + slots::HEAD as u32;
    let length = u32_at(elf, offset + slots::head::LENGTH)?;
    let sum = slots::sum(&flash(elf, start, start.checked_add(length)?)?);
    elf.get_mut(offset + slots::mark::SUM..)?.get_mut(..4)?.copy_from_slice(&sum.to_le_bytes());
    Some(sum)
}

#[cfg(test)]
mod tests {
    #[test]
    fn not_an_elf_is_none() {
        assert_eq!(super::flash_and_ram(b"hello"), None);
    }
}
