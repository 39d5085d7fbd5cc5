//! Tools of several tests on the ELF.

use hrg_board::wires::Wires;
use hrg_core::events::{records, Record, SECTOR};
use object::{Object, ObjectSegment};
use virtual_board::Board;

/// The events that a board's flash holds.
pub fn field_log(board: &Board<Wires>) -> Vec<Record> {
    let mut bytes = vec![0; SECTOR];
    let at = board.firmware().address_of("_events_start").expect("there");
    board.read_memory(at, &mut bytes).expect("in flash");
    records(&bytes).collect()
}

/// An ELF with other bytes from an address on.
pub fn patched(elf: &[u8], address: u32, change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut out = elf.to_vec();
    let file = object::File::parse(elf).expect("an ELF");
    let within = |s: &object::Segment<'_, '_>| (s.address()..s.address() + s.size()).contains(&u64::from(address));
    let segment = file.segments().find(within).expect("it is loaded");
    change(&mut out[(segment.file_range().0 + u64::from(address) - segment.address()) as usize..]);
    out
}
