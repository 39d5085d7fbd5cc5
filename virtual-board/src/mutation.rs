//! Writes to registers and reads of them: recorded, and changed. They show the effect of a firmware with another constant, a forgotten line, a
//! wrong instance or a wait too few on the chip, with no need of building it: the n-th write since power-on reaches the chip as something else, the n-th
//! read gives something else.

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

/// A read of the firmware from a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegisterRead {
    /// Reads of registers before it, since power-on.
    pub number: u64,
    /// Writes to registers before it.
    pub writes: u64,
    /// The exception that runs: 0 is none, from 16 on interrupts.
    pub exception: u16,
    /// First address of the block of code that it is in.
    pub block: u32,
    /// Of the register.
    pub address: u32,
    /// The register's value.
    pub value: u32,
    /// Time, cycles since power-on.
    pub at: u64,
}

/// Change of what a register reads, to every place in the program, for a while from a read on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Misread {
    /// [`RegisterRead::number`] of the first.
    pub number: u64,
    /// Bits that read otherwise.
    pub mask: u32,
    /// Their value.
    pub value: u32,
    /// Length, cycles.
    pub cycles: u64,
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
    /// It happens behind the next one.
    Later,
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
    /// One that waits for the next.
    held: Option<RegisterWrite>,
    /// All since asked for.
    pub recorded: Option<Vec<RegisterWrite>>,
}

impl Writes {
    /// `true` if the next write is to be recorded.
    pub fn recording(&self) -> bool {
        self.recorded.is_some()
    }
    /// Writes to registers since power-on.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.count
    }
    /// Takes a write down; gives those that happen now, in their order.
    pub fn pass(&mut self, mut write: RegisterWrite) -> [Option<RegisterWrite>; 2] {
        write.number = self.count;
        self.count += 1;
        if let Some(all) = &mut self.recorded {
            all.push(write);
        }
        match self.mutation.filter(|m| m.number == write.number).map(|m| m.change) {
            None => [Some(write), self.held.take()],
            Some(Change::LeftOut) => [None, None],
            Some(Change::Becomes { address, value }) => [Some(RegisterWrite { address, value, ..write }), None],
            Some(Change::Later) => {
                self.held = Some(write);
                [None, None]
            }
        }
    }
}

/// The book of the reads.
#[derive(Debug, Clone, Default)]
pub struct Reads {
    count: u64,
    /// The one that is changed.
    pub misread: Option<Misread>,
    /// Register and time of the first.
    since: Option<(u32, u64)>,
    /// All since asked for.
    pub recorded: Option<Vec<RegisterRead>>,
}

impl Reads {
    /// Takes a read down; gives what the firmware reads.
    pub fn pass(&mut self, mut read: RegisterRead) -> u32 {
        read.number = self.count;
        self.count += 1;
        if let Some(all) = &mut self.recorded {
            all.push(read);
        }
        let Some(m) = self.misread.filter(|m| read.number >= m.number) else { return read.value };
        let (address, since) = *self.since.get_or_insert((read.address, read.at));
        if read.address == address && read.at < since + m.cycles {
            read.value & !m.mask | m.value & m.mask
        } else {
            read.value
        }
    }
}
