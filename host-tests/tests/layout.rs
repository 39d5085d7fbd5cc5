//! Facts that stand in two files because the linker, the firmware and the virtual board each read their own.

use hrg_board::replay::CALIBRATION_A;

fn text(path: &str) -> String {
    std::fs::read_to_string(format!("{}/../{path}", env!("CARGO_MANIFEST_DIR"))).expect("in the repository")
}

/// The hexadecimal number that follows `before`.
fn hex_after(text: &str, before: &str) -> u32 {
    let rest = text.split(before).nth(1).unwrap_or_else(|| panic!("{before} is missing"));
    let digits: String = rest.chars().filter(|c| *c != '_').take_while(char::is_ascii_hexdigit).collect();
    u32::from_str_radix(&digits, 16).expect("a number")
}

#[test]
fn linker_firmware_and_board_agree_on_the_calibration_sectors() {
    let (memory, params) = (text("memory.x"), text("firmware/src/params.rs"));
    let flash = hex_after(&memory, "FLASH : ORIGIN = 0x");
    for sector in ["A", "B"] {
        let linker = hex_after(&memory, &format!("CAL_{sector} : ORIGIN = 0x"));
        let firmware = hex_after(&params, &format!("CALIBRATION_{sector}: u32 = 0x"));
        assert_eq!(linker - flash, firmware, "sector {sector}");
    }
    assert_eq!(hex_after(&params, "CALIBRATION_A: u32 = 0x"), CALIBRATION_A);
}
