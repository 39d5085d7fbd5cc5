//! Flash and RAM as the emulator, the DMA and the debug probe share them.
//!
//! Unicorn is handed a pointer to each (its own copying functions look addresses up anew for every call, which
//! cost a fifth of the run time when each captured edge did so).

use crate::error::RunError;
use std::alloc::{alloc_zeroed, dealloc, handle_alloc_error, Layout};

/// One memory at a fixed address.
pub struct Memory {
    start: u32,
    layout: Layout,
    bytes: *mut u8,
}

#[allow(unsafe_code)] // The emulator needs a raw pointer to memory that it shares with us.
impl Memory {
    pub fn new(start: u32, size: u32) -> Result<Self, RunError> {
        let layout = Layout::from_size_align(size as usize, 4096).map_err(|e| RunError::Elf(e.to_string()))?;
        // SAFETY: the size is not zero.
        let bytes = unsafe { alloc_zeroed(layout) };
        if bytes.is_null() {
            handle_alloc_error(layout);
        }
        Ok(Self { start, layout, bytes })
    }

    /// For the emulator; valid as long as `self`.
    pub fn pointer(&self) -> *mut std::ffi::c_void {
        self.bytes.cast()
    }

    fn offset(&self, address: u32, n: usize) -> Option<usize> {
        let at = address.checked_sub(self.start)? as usize;
        (at.checked_add(n)? <= self.layout.size()).then_some(at)
    }

    pub fn read(&self, address: u32, out: &mut [u8]) -> Option<()> {
        let at = self.offset(address, out.len())?;
        // SAFETY: within the allocation; the emulator runs only inside `emu_start`, on this thread.
        unsafe { std::ptr::copy_nonoverlapping(self.bytes.add(at), out.as_mut_ptr(), out.len()) };
        Some(())
    }

    pub fn write(&mut self, address: u32, from: &[u8]) -> Option<()> {
        let at = self.offset(address, from.len())?;
        // SAFETY: as in `read`; and `&mut self`.
        unsafe { std::ptr::copy_nonoverlapping(from.as_ptr(), self.bytes.add(at), from.len()) };
        Some(())
    }
}

impl Drop for Memory {
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        // SAFETY: allocated with this layout. `Board` drops its emulator first.
        unsafe { dealloc(self.bytes, self.layout) }
    }
}
