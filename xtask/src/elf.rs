//! How much flash and RAM an ELF takes, from its program headers.

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
            // What is loaded is in flash, wherever it runs.
            flash += u64::from(u32_at(elf, at + 16)?);
            if (0x2000_0000..0x3000_0000).contains(&address) {
                ram += u64::from(u32_at(elf, at + 20)?);
            }
        }
    }
    Some((flash, ram))
}

#[cfg(test)]
mod tests {
    #[test]
    fn not_an_elf_is_none() {
        assert_eq!(super::flash_and_ram(b"hello"), None);
    }
}
