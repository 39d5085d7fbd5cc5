//! Costs of the program, block by block.

use std::ops::AddAssign;

/// Costs of a piece of code.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cost {
    /// Instructions executed.
    pub instructions: u64,
    /// Estimated cycles ([`crate::cycles`]): waits for buses and DMA, and exceptions that came into it, included.
    pub cycles: u64,
}

impl AddAssign for Cost {
    fn add_assign(&mut self, other: Self) {
        self.instructions += other.instructions;
        self.cycles += other.cycles;
    }
}

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct Profile {
    blocks: Vec<Cost>,
    /// The block that runs, and the estimate at its begin.
    running: Option<(usize, u64)>,
}

impl Profile {
    /// For blocks of numbers below `blocks`.
    pub(crate) fn new(blocks: usize) -> Self {
        Self { blocks: vec![Cost::default(); blocks], running: None }
    }

    /// A block begins: its number, its instructions, the cycles estimated so far.
    pub(crate) fn begin(&mut self, block: usize, instructions: u64, estimate: u64) {
        if let Some((before, since)) = self.running.replace((block, estimate)) {
            // (A reset begins the estimate anew.)
            self.blocks[before].cycles += estimate.saturating_sub(since);
        }
        self.blocks[block].instructions += instructions;
    }

    /// Numbers and costs of the blocks that ran.
    pub(crate) fn costs(&self) -> impl Iterator<Item = (usize, Cost)> + '_ {
        self.blocks.iter().copied().enumerate().filter(|(_, cost)| *cost != Cost::default())
    }
}
