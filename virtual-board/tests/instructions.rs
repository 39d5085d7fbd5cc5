//! Instructions that the emulator alone would execute wrongly.

use virtual_board::{Board, NothingConnected, CPU_HZ};

/// An ELF with one segment, at the start of the flash.
fn elf(code: &[u8]) -> Vec<u8> {
    let n = code.len() as u32;
    let mut out = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    let mut halves = |values: &[u16]| values.iter().for_each(|v| out.extend(v.to_le_bytes()));
    // Executable, ARM; version; entry; program headers at 52, no sections; flags; sizes and numbers.
    halves(&[2, 40, 1, 0, 9, 0x0800, 52, 0, 0, 0, 0, 0, 52, 32, 1, 40, 0, 0]);
    // Loaded from offset 84, to virtual and physical address; sizes in file and memory; may be read and run.
    for word in [1, 84, 0x0800_0000, 0x0800_0000, n, n, 5, 4u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(code);
    out
}

#[test]
fn a_store_to_a_new_page_within_an_it_block_leaves_nothing_behind() {
    let code = [
        0x2002_0000u32.to_le_bytes(), // stack
        0x0800_0009u32.to_le_bytes(), // reset
        [0x07, 0x4A, 0x00, 0x20],     // ldr r2, =0x20010000 (a page that nothing has touched); movs r0, #0
        [0x07, 0x21, 0x01, 0x23],     // movs r1, #7; movs r3, #1
        [0x88, 0x42, 0x3E, 0xBF],     // cmp r0, r1 (carry clear); ittt cc
        [0x11, 0x60, 0x01, 0x30],     // strcc r1, [r2]; addcc r0, #1
        [0x81, 0x42, 0x00, 0xD2],     // cmpcc r1, r0 (carry set); bcs over the next
        [0x00, 0xBF, 0x29, 0x33],     // nop; adds r3, #41: not conditional
        [0x4F, 0xF0, 0x00, 0x54],     // mov r4, #0x20000000
        [0x23, 0x60, 0xFE, 0xE7],     // str r3, [r4]; b .
        0x2001_0000u32.to_le_bytes(),
    ];
    let mut board = Board::new(&elf(code.as_flattened()), NothingConnected).expect("a board");
    board.run_until(CPU_HZ / 1_000_000).expect("runs");
    let (mut stored, mut sum) = ([0; 4], [0; 4]);
    board.read_memory(0x2001_0000, &mut stored).expect("RAM");
    board.read_memory(0x2000_0000, &mut sum).expect("RAM");
    assert_eq!((u32::from_le_bytes(stored), u32::from_le_bytes(sum)), (7, 42));
}
