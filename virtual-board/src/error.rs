//! Why a run stops: with an error, or at a moment that was asked for.

/// Why a run ended in error.
#[derive(Debug)]
pub enum RunError {
    /// The ELF is not one for this board.
    Elf(String),
    /// The firmware did something that the board does not model; the program counter is where it did.
    NotModelled {
        /// The access or event that is not modelled.
        what: String,
        /// Program counter at that moment.
        pc: u32,
    },
    /// The CPU stopped on its own: a fault.
    Cpu {
        /// The message of Unicorn.
        what: String,
        /// Program counter at that moment.
        pc: u32,
    },
    /// A flash address outside the flash.
    Flash(u32),
}

impl std::fmt::Display for RunError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Elf(what) => write!(f, "the firmware ELF cannot be run: {what}"),
            Self::NotModelled { what, pc } => write!(f, "{what} (at {pc:#010x})"),
            Self::Cpu { what, pc } => write!(f, "the CPU stopped: {what} (at {pc:#010x})"),
            Self::Flash(a) => write!(f, "flash offset {a:#x} is outside the flash"),
        }
    }
}

impl std::error::Error for RunError {}

/// Why [`crate::Board::run_until`] came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The time is reached.
    Time,
    /// The watchdog has reset the unit; it starts anew when run on.
    Watchdog,
    /// The firmware has reset itself.
    Software,
    /// The instruction asked for with [`crate::Board::stop_at_instruction`] is reached.
    Instruction,
    /// A test program has ended, under a debugger ([`crate::Board::attach_debugger`]): its exit code, 0 where it went well.
    Exit(u32),
    /// The flash operation asked for with [`crate::Board::stop_at_flash_operation`] was begun, and not finished.
    Flash,
}
