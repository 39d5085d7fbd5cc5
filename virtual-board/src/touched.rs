//! First accesses to bytes of RAM: whether a byte is read before it is written again.
//!
//! A bit that changes in a byte which is written before it is read, or which nobody reads, has no effect: the board is deterministic. A campaign
//! of such changes can leave those out, and one run tells of all of them.

use crate::board::Board;
use crate::cpu::uc;
use crate::error::RunError;
use crate::{World, RAM_SIZE, RAM_START};
use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::rc::Rc;
use unicorn_engine::{HookType, MemType, UcHookId};

/// Bytes that are watched, and those that were read.
#[derive(Default)]
pub(crate) struct Touched {
    /// Watchers of a byte that was not accessed since.
    watched: HashMap<u32, Vec<usize>>,
    read: BTreeSet<usize>,
}

impl Touched {
    fn accessed(&mut self, bytes: Range<u32>, write: bool) {
        if self.watched.is_empty() {
            return;
        }
        for byte in bytes {
            let Some(watchers) = self.watched.remove(&byte) else { continue };
            if !write {
                self.read.extend(watchers);
            }
        }
    }
}

/// Shared by the board and the emulator's hook.
pub(crate) struct Watch {
    touched: Rc<RefCell<Touched>>,
    hook: UcHookId,
}

impl Watch {
    /// The board itself (DMA, exceptions, the debug probe) reads or writes.
    pub(crate) fn accessed(&self, address: u32, n: usize, write: bool) {
        self.touched.borrow_mut().accessed(address..address.saturating_add(n as u32), write);
    }
}

impl<W: World> Board<W> {
    /// Watches bytes of RAM from now on, each until its first access, for somebody with a number. (The board is several times slower from here to
    /// [`looked_at`](Self::looked_at).)
    ///
    /// # Errors
    /// If the emulator refuses.
    pub fn watch(&mut self, who: usize, bytes: &[u32]) -> Result<(), RunError> {
        if self.watch.is_none() {
            let touched = Rc::new(RefCell::new(Touched::default()));
            let seen = touched.clone();
            let ram = (u64::from(RAM_START), u64::from(RAM_START + RAM_SIZE - 1));
            let kinds = HookType::MEM_READ | HookType::MEM_WRITE;
            let hook = uc(self.cpu.add_mem_hook(kinds, ram.0, ram.1, move |c, kind, address, size, _| {
                // (As an access to a register does.)
                c.get_data_mut().it_stale = true;
                let bytes = address as u32..address as u32 + size as u32;
                seen.borrow_mut().accessed(bytes, kind == MemType::WRITE);
                true
            }))?;
            // Code that was translated before knows nothing of the hook.
            uc(self.cpu.ctl_flush_tb())?;
            self.watch = Some(Watch { touched, hook });
        }
        if let Some(watch) = &self.watch {
            let mut touched = watch.touched.borrow_mut();
            for byte in bytes {
                touched.watched.entry(*byte).or_default().push(who);
            }
        }
        Ok(())
    }

    /// Ends all watching: those of whom a byte was read before it was written.
    ///
    /// # Errors
    /// If the emulator refuses.
    pub fn looked_at(&mut self) -> Result<BTreeSet<usize>, RunError> {
        let Some(Watch { touched, hook }) = self.watch.take() else { return Ok(BTreeSet::new()) };
        uc(self.cpu.remove_hook(hook))?;
        uc(self.cpu.ctl_flush_tb())?;
        let read = std::mem::take(&mut touched.borrow_mut().read);
        Ok(read)
    }
}
