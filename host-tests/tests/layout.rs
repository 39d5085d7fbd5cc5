//! Facts that stand in two files because the linker and the virtual board each read their own.

use hrg_board::replay::{default_elf, read_elf, CALIBRATION_A, CALIBRATION_B};
use hrg_core::sectors::SECTOR_BYTES;
use virtual_board::{Firmware, FLASH_START};

#[test]
fn linker_and_board_agree_on_the_calibration_sectors() {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    let firmware = Firmware::parse(&elf).expect("an ELF for the board");
    for (sector, offset) in [("a", CALIBRATION_A), ("b", CALIBRATION_B)] {
        let at =
            |end: &str| firmware.address_of(&format!("_calibration_{sector}_{end}")).expect("a symbol of memory.x");
        assert_eq!(
            (at("start"), at("end")),
            (FLASH_START + offset, FLASH_START + offset + SECTOR_BYTES as u32),
            "sector {sector}"
        );
    }
}
