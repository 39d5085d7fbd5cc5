//! The program as it would be built with another constant: bytes of it are changed in flash, and its sum is made again.

use anyhow::{Context, Result};
use hrg_core::adc::SETTINGS;
use hrg_core::slots::{mark, sum, Slot, ADDRESSES, ERASED, HEAD, ROOM};
use virtual_board::{Board, Firmware, World, FLASH_START};

/// A word of the head that nobody reads, which is chosen so that the sum stays: a unit says its sum, and must not be told by it.
const SPARE: usize = HEAD + 200;

/// Changes bytes of the program in slot A, at an address. Its sum stays as it was.
///
/// # Errors
/// A place outside the flash.
pub fn with<W: World>(board: &mut Board<W>, address: u32, bytes: &[u8]) -> Result<()> {
    board.write_flash(address - FLASH_START, bytes)?;
    let mut slot = vec![0; ROOM];
    board.read_memory(ADDRESSES[0], &mut slot)?;
    let slot = Slot(&slot);
    // (A program that was flashed without a sum has none.)
    if slot.word(mark::SUM) != ERASED {
        let body = slot.body().context("no program in slot A")?;
        let spare = word_for(body, SPARE - HEAD, slot.word(mark::SUM)).context("no spare word in the head")?;
        board.write_flash(ADDRESSES[0] - FLASH_START + SPARE as u32, &spare.to_le_bytes())?;
    }
    Ok(())
}

/// The word that a body must have at a place for its [`sum`] to be this one. (The sum is a division of polynomials, which can be undone word by word.)
fn word_for(body: &[u8], at: usize, wanted: u32) -> Option<u32> {
    let before = sum(body.get(..at)?);
    let mut after = wanted;
    for word in body.get(at + 4..)?.chunks_exact(4).rev() {
        after = undone(after) ^ u32::from_le_bytes(word.try_into().ok()?);
    }
    Some(undone(after) ^ before)
}

/// The register of the sum before the 32 shifts of a word.
fn undone(mut crc: u32) -> u32 {
    for _ in 0..32 {
        // The polynomial is odd: its lowest bit tells if it was subtracted.
        crc = if crc & 1 == 0 { crc >> 1 } else { (crc ^ 0x04C1_1DB7) >> 1 | 1 << 31 };
    }
    crc
}

/// Address of the value of a setting of the ADC in the program.
///
/// # Errors
/// If there is none.
pub fn setting(firmware: &Firmware, register: u8) -> Result<u32> {
    let at = table(firmware.flash()).context("the table of the ADC's settings is not in the program")?;
    let k = SETTINGS.iter().position(|(r, _)| *r == register).context("the program does not set this register")?;
    Ok(FLASH_START + (at + 4 * k) as u32)
}

/// Offset of the first value in the table of settings: pairs of a value and an address, as the compiler lays them.
fn table(flash: &[u8]) -> Option<usize> {
    let of = |swapped: bool| -> Vec<u8> {
        let pair = |(address, value): (u8, u16)| {
            let [low, high] = value.to_le_bytes();
            if swapped {
                [low, high, address, 0]
            } else {
                [address, 0, low, high]
            }
        };
        SETTINGS.into_iter().flat_map(pair).collect()
    };
    // (The byte beside the address is filled with anything.)
    let alike = |a: &[u8], b: &[u8], swapped: bool| {
        a.iter().zip(b).enumerate().all(|(k, (x, y))| k % 4 == if swapped { 3 } else { 1 } || x == y)
    };
    [true, false].into_iter().find_map(|swapped| {
        let wanted = of(swapped);
        (0..flash.len() - wanted.len())
            .step_by(2)
            .find(|at| alike(flash.get(*at..).unwrap_or_default(), &wanted, swapped))
            .map(|at| at + if swapped { 0 } else { 2 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_is_kept_by_one_word() {
        let body: Vec<u8> = (0..400u32).map(|k| (k * 37 % 251) as u8).collect();
        let wanted = sum(&body);
        let mut changed = body.clone();
        changed[300] ^= 0x55;
        assert_ne!(sum(&changed), wanted);
        let word = word_for(&changed, 80, wanted).expect("there");
        changed[80..84].copy_from_slice(&word.to_le_bytes());
        assert_eq!(sum(&changed), wanted);
        assert_eq!(word_for(&body, 80, wanted), Some(u32::from_le_bytes(body[80..84].try_into().expect("four"))));
    }
}
