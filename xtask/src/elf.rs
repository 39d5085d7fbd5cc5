//! Facts of an ELF: flash and RAM that it needs, and the integrity word of its program.

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

/// Marks the integrity word, as the firmware looks for it (`firmware/src/program.rs`).
const INTACT: [u8; 4] = *b"SEAL";

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
fn flash(elf: &[u8], from: u32, to: Option<u32>) -> Option<Vec<u8>> {
    let table = u32_at(elf, 28)? as usize;
    let (size, count) = (usize::from(u16_at(elf, 42)?), usize::from(u16_at(elf, 44)?));
    let mut out = vec![0xFF; to.map_or(0, |to| (to - from) as usize)];
    for at in (0..count).map(|k| table + k * size) {
        let (kind, offset, address, bytes) =
            (u32_at(elf, at)?, u32_at(elf, at + 4)? as usize, u32_at(elf, at + 12)?, u32_at(elf, at + 16)? as usize);
        let Some(start) = address.checked_sub(from).filter(|_| kind == 1 && bytes > 0) else { continue };
        let end = start as usize + bytes;
        if to.is_some_and(|to| address >= to) {
            continue;
        }
        if out.len() < end {
            out.resize(end, 0xFF);
        }
        out[start as usize..end].copy_from_slice(elf.get(offset..offset + bytes)?);
    }
    if let Some(to) = to {
        out.truncate((to - from) as usize);
    }
    out.resize(out.len().next_multiple_of(4), 0xFF);
    Some(out)
}

/// CRC-32/MPEG-2 of words, as the chip's CRC unit makes it.
fn crc(words: &[u8]) -> u32 {
    words.chunks_exact(4).fold(u32::MAX, |crc, w| {
        (0..32).fold(crc ^ u32::from_le_bytes([w[0], w[1], w[2], w[3]]), |crc, _| {
            crc << 1 ^ if crc >> 31 != 0 { 0x04C1_1DB7 } else { 0 }
        })
    })
}

/// Writes the sum of the program into its integrity word: of the vector table, and of everything from the fourth sector on, where the code begins.
pub fn write_integrity_word(elf: &mut [u8]) -> Option<u32> {
    let (_, table, _) = section(elf, ".vector_table")?;
    let (_, code, _) = section(elf, ".text")?;
    let (offset, address, size) = section(elf, ".seal")?;
    (size == 8).then_some(())?;
    let mut program = flash(elf, table, Some(address))?;
    program.extend(flash(elf, code, None)?);
    let sum = crc(&program);
    elf.get_mut(offset..offset + 4)?.copy_from_slice(&INTACT);
    elf.get_mut(offset + 4..offset + 8)?.copy_from_slice(&sum.to_le_bytes());
    Some(sum)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_sum_is_that_of_the_crc_unit() {
        // CRC-32/MPEG-2 of "12345678", by another program; the unit takes words, most significant byte first.
        let words: Vec<u8> = b"12345678".chunks(4).flat_map(|w| [w[3], w[2], w[1], w[0]]).collect();
        assert_eq!(super::crc(&words), 0x49E3_C2FB);
    }

    #[test]
    fn not_an_elf_is_none() {
        assert_eq!(super::flash_and_ram(b"hello"), None);
    }
}
