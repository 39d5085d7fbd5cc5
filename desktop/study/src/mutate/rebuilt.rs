//! The program as it would be built with another constant: bytes of it are changed in flash, and its sum is made again.

use anyhow::{Context, Result};
use hrg_core::adc::SETTINGS;
use hrg_core::slots::{mark, sum, Slot, ADDRESSES, ERASED, ROOM};
use virtual_board::{Board, World, FLASH_START};

/// Changes bytes of the program in slot A, at an address.
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
        let sum = sum(slot.body().context("no program in slot A")?);
        board.write_flash(ADDRESSES[0] - FLASH_START + mark::SUM as u32, &sum.to_le_bytes())?;
    }
    Ok(())
}

/// Address of the value of a setting of the ADC in the program.
///
/// # Errors
/// If there is none.
pub fn setting<W: World>(board: &Board<W>, register: u8) -> Result<u32> {
    let at = table(board.firmware().flash()).context("the table of the ADC's settings is not in the program")?;
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
