//! The little that must be known of Thumb code: how long an instruction is, how many a block has, what an IT makes conditional.

/// Bits of xPSR that hold the state of an IT block.
pub const IT_STATE: u64 = 0x0600_FC00;

/// Length of the Thumb instruction that begins at an offset, bytes.
fn length(code: &[u8], at: usize) -> usize {
    // A first half-word of 0b11101, 0b11110 or 0b11111 begins an instruction of four bytes.
    if code.get(at + 1).is_some_and(|high| *high >= 0xE8) {
        4
    } else {
        2
    }
}

/// `true` if the instruction at an offset is one of those that an IT instruction before it makes conditional.
pub fn within_it(code: &[u8], at: usize) -> bool {
    (1..=8).filter_map(|back| at.checked_sub(2 * back)).any(|it| {
        let mask = code[it] & 0xF;
        if code[it + 1] != 0xBF || mask == 0 {
            return false;
        }
        let mut next = it + 2;
        (0..4 - mask.trailing_zeros()).any(|_| {
            let here = next == at;
            next += length(code, next);
            here
        })
    })
}

/// Number of Thumb instructions in a block.
pub fn instructions(code: &[u8]) -> u8 {
    let mut at = 0;
    let mut n = 0u8;
    while at + 1 < code.len() {
        at += length(code, at);
        n = n.saturating_add(1);
    }
    n
}
