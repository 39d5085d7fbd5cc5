//! The checksums that the tests on the chip expect (`firmware/tests/chip.rs`) are what the desktop computes; and those tests pass on the virtual board.

use hrg_board::chip_tests::{tests, Outcome};
use std::path::Path;

#[path = "../../../firmware/tests/same/mod.rs"]
mod same;

#[test]
fn checksums_are_those_of_the_desktop() {
    let models = same::IMAGES.map(|(name, image, _)| (name, same::model(image).expect("a stored image loads")));
    for (name, found) in models {
        println!("{name} {found:#010x}");
    }
    println!("functions {:#010x}, edges {:#010x}", same::functions(), same::edges());
    assert_eq!(models, same::IMAGES.map(|(name, _, expected)| (name, expected)));
    assert_eq!((same::functions(), same::edges()), (same::FUNCTIONS, same::EDGES));
}

/// The check value of CRC-32/MPEG-2 in the catalogue of CRC algorithms.
#[test]
fn the_reference_of_the_crc_unit_is_right() {
    assert_eq!(same::crc_32_mpeg_2(b"123456789"), 0x0376_E6E7);
}

/// `cargo xtask test` and `cargo xtask size --chip-tests` build it there.
fn elf() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/chip/chip-tests.elf");
    hrg_board::replay::read_elf(&path).expect("cargo xtask size --chip-tests builds it")
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn the_tests_for_the_chip_pass_on_the_virtual_board() {
    let elf = elf();
    let tests = tests(&elf).expect("it holds tests");
    assert_eq!(tests.len(), 6);
    for test in &tests {
        let (outcome, log) = test.run(&elf).expect("it fits the board");
        assert_eq!(outcome, Outcome::Ok, "{}: {log:?}", test.name);
        assert!(test.name.starts_with("chip::tests::"), "{}", test.name);
    }
}

/// A byte of a stored image is wrong in flash: the test of the models says so, in its log, too.
#[test]
#[ignore = "cargo xtask test --rest"]
fn a_wrong_byte_fails_its_test() {
    let mut elf = elf();
    let (_, image, _) = same::IMAGES[0];
    let at = elf.windows(image.len()).position(|w| w == image).expect("the ELF holds the image");
    elf[at + image.len() / 2] ^= 1;
    let tests = tests(&elf).expect("it holds tests");
    let test = tests.iter().find(|t| t.name.contains("models_give")).expect("there");
    let (outcome, log) = test.run(&elf).expect("it fits the board");
    assert_eq!(outcome, Outcome::Failed("exit code 134".into()));
    assert!(log.iter().any(|l| l.contains("expected 626d761c")), "{log:?}");
}

/// Without a debugger, a breakpoint is a HardFault.
#[test]
#[ignore = "cargo xtask test --rest"]
fn semihosting_without_a_debugger_ends_the_run() {
    let mut board = virtual_board::Board::new(&elf(), virtual_board::NothingConnected).expect("it fits the board");
    let end = board.run_until(virtual_board::CPU_HZ).expect_err("it asks for its command line");
    assert!(end.to_string().contains("none is attached"), "{end}");
}
