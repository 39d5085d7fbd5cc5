//! Writes to registers: recorded, and changed. They show the effect of a firmware with another constant, a forgotten line or a
//! wrong instance on the chip, with no need of building it: the n-th write since power-on reaches the chip as something else.

/// A write of the firmware to a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegisterWrite {
    /// Writes to registers before it, since power-on.
    pub number: u64,
    /// The exception that runs: 0 is none, from 16 on interrupts.
    pub exception: u16,
    /// First address of the block of code that it is in.
    pub block: u32,
    /// Of the register.
    pub address: u32,
    /// As the processor writes it.
    pub value: u32,
    /// Bytes.
    pub size: usize,
    /// Value that the register read before.
    pub before: u32,
}

/// Change of a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It does not happen.
    LeftOut,
    /// It writes this, at this address.
    Becomes {
        /// Address of the write.
        address: u32,
        /// Value written.
        value: u32,
    },
}

/// A write that is changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mutation {
    /// Its [`RegisterWrite::number`].
    pub number: u64,
    /// Change of that write.
    pub change: Change,
}

/// The book of the writes.
#[derive(Debug, Clone, Default)]
pub struct Writes {
    count: u64,
    /// The one that is changed.
    pub mutation: Option<Mutation>,
    /// All since asked for.
    pub recorded: Option<Vec<RegisterWrite>>,
}

impl Writes {
    /// `true` if the next write is to be recorded.
    pub fn recording(&self) -> bool {
        self.recorded.is_some()
    }
    /// Takes a write down; gives where it goes, and what it writes; `None`: it does not happen.
    pub fn pass(&mut self, mut write: RegisterWrite) -> Option<(u32, u32)> {
        write.number = self.count;
        self.count += 1;
        if let Some(all) = &mut self.recorded {
            all.push(write);
        }
        match self.mutation.filter(|m| m.number == write.number).map(|m| m.change) {
            None => Some((write.address, write.value)),
            Some(Change::LeftOut) => None,
            Some(Change::Becomes { address, value }) => Some((address, value)),
        }
    }
}
