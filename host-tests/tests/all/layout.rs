//! Facts that stand in two files because two programs each read their own.

use hrg_board::replay::{default_elf, read_elf, CALIBRATION_A, CALIBRATION_B};
use hrg_core::sectors::SECTOR_BYTES;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;
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

/// Packages, each with its features, as cargo builds these together. A package that is built for this machine and for a macro may be there twice.
fn features(packages: &[&str], edges: &str) -> BTreeMap<String, BTreeSet<String>> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["tree", "--locked", "--prefix", "none", "--format", "{p}|{f}", "--edges", edges]);
    cargo.args(packages.iter().flat_map(|p| ["--package", p]));
    let output = cargo.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut all = BTreeMap::<String, BTreeSet<String>>::new();
    for line in String::from_utf8_lossy(&output.stdout).lines() {
        if let Some((package, features)) = line.trim_end_matches(" (*)").split_once('|') {
            all.entry(package.replace(" (proc-macro)", "")).or_default().insert(features.into());
        }
    }
    assert!(all.len() > 50, "{}", all.len());
    all
}

#[test]
fn nothing_is_compiled_twice_for_other_features() {
    let programs = ["hrg", "hrg-board", "hrg-study", "foreign-plant"];
    let tests = [&programs[..], &["hrg-core", "virtual-board", "chip-tables", "host-tests", "xtask"]].concat();
    let with_tests = features(&tests, "normal,build,dev");
    for (of, found) in [
        ("the programs", features(&programs, "normal,build")),
        ("the wheel", features(&["hrg-python"], "normal,build")),
        // The commands that docs/CONTRIBUTING.md has one run.
        ("the tests on the virtual board", features(&["host-tests"], "normal,build,dev")),
    ] {
        for (package, features) in found {
            let others = with_tests.get(&package).filter(|others| !features.is_subset(others));
            assert_eq!(others, None, "{package} has the features {features:?} in {of}, and these in the test command");
        }
    }
}
