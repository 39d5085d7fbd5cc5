//! The stack: painted at the start, so that the next start can tell how deep it went.

#[allow(unsafe_code)] // Symbols of the linker (memory.x): only their addresses are used.
unsafe extern "C" {
    static _stack_start: u8;
    static _stack_end: u8;
}

/// Contents of stack that was never used. (The virtual board's RAM is full of it at power-on.)
const PAINT: u32 = 0xA5A5_A5A5;

/// Bytes below the caller's own that are left alone: this function's frame.
const OWN: usize = 256;

/// Largest piece that is put on the stack at once: what does not fit leaves the rest as it was (PUSH, an exception's frame).
const PIECE: u32 = 256;

/// `true` if so many bytes that were used are all there is.
pub fn is_full(used: u32) -> bool {
    let room = (&raw const _stack_start).addr() - (&raw const _stack_end).addr();
    used + PIECE > room as u32
}

/// Bytes that were used since the last call at the most; paints anew what is free. Before a first call it is of no meaning.
#[inline(never)]
pub fn repaint() -> u32 {
    let here = 0u32;
    let (top, bottom) = ((&raw const _stack_start).addr(), (&raw const _stack_end).addr());
    let end = (&raw const here).addr().saturating_sub(OWN);
    let free = (bottom..end).step_by(4);
    // SAFETY: words of the stack's room, below all frames that are in use; an interrupt that comes into it has left when this goes on.
    #[allow(unsafe_code)]
    unsafe {
        let paint = core::ptr::without_provenance_mut::<u32>;
        let lowest = free.clone().find(|at| paint(*at).read_volatile() != PAINT);
        free.for_each(|at| paint(at).write_volatile(PAINT));
        (top - lowest.unwrap_or(end)) as u32
    }
}
