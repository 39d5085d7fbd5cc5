//! Contents of the flash before the program: the loader, in sector 0, and the marks and the head of the program's own slot ([`hrg_core::slots`]).
//!
//! # Design
//! The ELF holds all of it, so that one file is flashed and flown. firmware/build.rs compiles the loader; slot.x gives each static its place. A probe that flashes this ELF
//! writes a program that is confirmed already, and takes the mark from whatever the other slot holds: what was flashed last is what runs.
//! `cargo xtask build` writes the sum into the marks; a program that was flashed without it (by `cargo run`) says so in its log, and is not checked.

use hrg_core::slots::{head, mark, numbered, COMMITTED, CONFIRMED, ERASED, HEAD, TABLE};

/// The loader.
#[allow(unsafe_code)] // The section is slot.x's.
#[unsafe(link_section = ".loader")]
#[used]
static LOADER: [u8; LOADER_BYTES.len()] = *LOADER_BYTES;
const LOADER_BYTES: &[u8; include_bytes!(concat!(env!("OUT_DIR"), "/loader.bin")).len()] =
    include_bytes!(concat!(env!("OUT_DIR"), "/loader.bin"));

/// Words of the marks.
const MARKS: usize = HEAD / 4;

/// The marks of a program that is there by a probe.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".slot.marks")]
#[used]
static OWN: [u32; MARKS] = {
    let mut marks = [ERASED; MARKS];
    marks[mark::COMMITTED / 4] = COMMITTED;
    marks[mark::TRIED / 4] = 0;
    marks[mark::CONFIRMED / 4] = CONFIRMED;
    marks[mark::NUMBERS / 4] = numbered(1);
    marks
};

/// Bytes of the head behind what the linker writes: magic, length, address.
const REST: usize = TABLE - head::VERSION;

/// The rest of the head.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".slot.head")]
#[used]
static HEAD_REST: [u8; REST] = {
    let mut out = [0; REST];
    let version = VERSION.to_le_bytes();
    let (board, name) = (BOARD.as_bytes(), env!("CARGO_PKG_VERSION").as_bytes());
    let mut k = 0;
    while k < head::TEXT {
        if k < version.len() {
            out[k] = version[k];
        }
        if k < board.len() {
            out[head::BOARD - head::VERSION + k] = board[k];
        }
        if k < name.len() {
            out[head::NAME - head::VERSION + k] = name[k];
        }
        k += 1;
    }
    out
};

/// The version of cargo as a number.
const VERSION: u32 = include!(concat!(env!("OUT_DIR"), "/version.rs"));

/// Board that the program is for: its chip, and the wiring of `board`.
const BOARD: &str = if cfg!(feature = "stm32f405rg") { "stm32f405rg wiring 1" } else { "stm32f446re wiring 1" };

/// In the place of the other slot's mark: nothing is committed there.
#[allow(unsafe_code)] // As above.
#[unsafe(link_section = ".other_slot")]
#[used]
static OTHER: u32 = 0;
