//! The board's writes to registers and reads of them: recording them, and changing one.

use crate::board::Board;
use crate::mutation::{Misread, Mutation, RegisterRead, RegisterWrite};
use crate::World;
use std::collections::BTreeMap;

impl<W: World> Board<W> {
    /// Takes down from now on what is written to registers.
    pub fn record_writes(&mut self) {
        self.cpu.get_data_mut().writes.recorded = Some(Vec::new());
    }

    /// Writes recorded since.
    #[must_use]
    pub fn recorded_writes(&self) -> &[RegisterWrite] {
        self.cpu.get_data().writes.recorded.as_deref().unwrap_or_default()
    }

    /// Takes down from now on what is read from registers.
    pub fn record_reads(&mut self) {
        self.cpu.get_data_mut().reads.recorded = Some(Vec::new());
    }

    /// Reads recorded since.
    #[must_use]
    pub fn recorded_reads(&self) -> &[RegisterRead] {
        self.cpu.get_data().reads.recorded.as_deref().unwrap_or_default()
    }

    /// Changes what one read gives, or those of a while. The count goes on over resets of the processor.
    pub fn misread(&mut self, misread: Misread) {
        self.cpu.get_data_mut().reads.misread = Some(misread);
    }

    /// Values of all registers, by address: those of the tables and of the core. Reading here has no effect.
    #[must_use]
    pub fn registers(&self) -> BTreeMap<u32, u32> {
        let mut chip = self.cpu.get_data().clone();
        // SCB's, and those of the NVIC.
        let core = (0xE000_ED08..=0xE000_ED24).chain([0xE000_ED88, 0xE000_EF34]).chain(0xE000_E100..0xE000_E110);
        let core = core.chain(0xE000_E400..0xE000_E461).filter(|a| a % 4 == 0);
        let all: Vec<u32> = chip.part.tables.registers.keys().copied().chain(core).collect();
        let read = |address| {
            let value = chip.read(address);
            // One that is not modelled, or not clocked, shows nothing.
            chip.error.take().map_or(Some((address, value)), |_| None)
        };
        all.into_iter().filter_map(read).collect()
    }

    /// Changes one write. The count goes on over resets of the processor.
    pub fn mutate(&mut self, mutation: Mutation) {
        self.cpu.get_data_mut().writes.mutation = Some(mutation);
    }
}
