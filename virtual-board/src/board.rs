//! The board: CPU, chip, wires, and the loop that keeps time.
//!
//! # Design
//! Unicorn runs until a block hook finds that the next event is due or that something needs attention; then this
//! loop handles events in order of time, takes the interrupt of highest priority if it may, and goes on. The
//! hook counts Thumb instructions; a block is never left inside an IT block. On exception entry the extended
//! frame (with the floating-point registers) is stacked always, as if lazy stacking were off.

use crate::chip::{Chip, Request};
use crate::memory::Memory;
use crate::probe::Probe;
use crate::system::{Iwdg, CSR_POWER_ON, CSR_SOFTWARE, CSR_WATCHDOG, SECTORS};
use crate::{World, CPU_HZ, FLASH_SIZE, FLASH_START, RAM_SIZE, RAM_START};
use object::{Object, ObjectSegment, ObjectSymbol};
use unicorn_engine::{
    Arch, ArmCpuModel, Context, HookType, Mode, Prot, RegisterARM, TlbEntry, TlbType, UcHookId, Unicorn,
};

/// Why a run ended in error.
#[derive(Debug)]
pub enum RunError {
    /// The ELF is not one for this board.
    Elf(String),
    /// The firmware did something that the board does not model; the program counter is where it did.
    NotModelled {
        /// What.
        what: String,
        /// Where.
        pc: u32,
    },
    /// The CPU stopped on its own: a fault.
    Cpu {
        /// What Unicorn said.
        what: String,
        /// Where.
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

/// Why [`Board::run_until`] came back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The time is reached.
    Time,
    /// The watchdog has reset the unit; it starts anew when run on.
    Watchdog,
    /// The firmware has reset itself.
    Software,
    /// The instruction asked for with [`Board::stop_at_instruction`] is reached.
    Instruction,
    /// The flash operation asked for with [`Board::stop_at_flash_operation`] was begun, and not finished.
    Flash,
}

/// Erase of a sector of 128 KiB, at its slowest (data sheet: 2 s).
const ERASE_CYCLES: u64 = 2 * CPU_HZ;
const EVENTS_PER_LOOK: u64 = CPU_HZ / 100;
const FLASH_END: u32 = FLASH_START + FLASH_SIZE - 1;
/// What RAM holds at power-on.
const PAINT: u8 = 0xA5;
const SLEEP_LIMIT: u64 = CPU_HZ * 10;

/// What goes on outside the chip: when the next thing happens there, and what happened last.
#[derive(Debug, Clone, Copy)]
struct Wires {
    next_edge: [u64; 3],
    next_sample: u64,
    next_byte: Option<(u64, u8)>,
    link_idle: u64,
    next_look: u64,
    ready_stamp: u32,
    fetch_stamp: u32,
    spoilt: bool,
}

/// The board with firmware in its flash.
pub struct Board<W: World> {
    // Dropped first: it points into the memories.
    cpu: Unicorn<'static, Chip>,
    flash: Memory,
    ram: Memory,
    /// What is on the wires.
    pub world: W,
    rtt: Option<u32>,
    static_end: u32,
    wires: Wires,
    flash_watch: Option<UcHookId>,
    stop_at: u64,
    flash_operations: u64,
    stop_at_operation: u64,
    torn: bool,
    as_on_chip: bool,
    upsets: u64,
    hardware_watchdog: bool,
}

/// A board at a moment, to come back to: [`Board::snapshot`].
pub struct Snapshot<W> {
    context: Context,
    chip: Chip,
    flash: Vec<u8>,
    ram: Vec<u8>,
    world: W,
    wires: Wires,
}

impl<W> std::fmt::Debug for Snapshot<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Snapshot at cycle {}", self.chip.now)
    }
}

impl<W: World> std::fmt::Debug for Board<W> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Board at cycle {}", self.now())
    }
}

type Cpu<'a> = Unicorn<'a, Chip>;

fn uc<T>(result: Result<T, unicorn_engine::uc_error>) -> Result<T, RunError> {
    result.map_err(|e| RunError::Cpu { what: format!("{e:?}"), pc: 0 })
}

impl<W: World> Board<W> {
    /// Puts the firmware into flash and switches the board on.
    ///
    /// # Errors
    /// Where the ELF does not fit the board.
    pub fn new(elf: &[u8], world: W) -> Result<Self, RunError> {
        let file = object::File::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
        let mut flash_memory = Memory::new(FLASH_START, FLASH_SIZE)?;
        let mut ram_memory = Memory::new(RAM_START, RAM_SIZE)?;
        // RAM is not zero at power-on; painted, it shows how far the stack came.
        ram_memory.write(RAM_START, &vec![PAINT; RAM_SIZE as usize]).ok_or(RunError::Flash(0))?;
        let mut flash = vec![0xFFu8; FLASH_SIZE as usize];
        for segment in file.segments() {
            let data = segment.data().map_err(|e| RunError::Elf(e.to_string()))?;
            if data.is_empty() {
                continue;
            }
            let address = load_address(elf, segment.address())?;
            let at = address.checked_sub(FLASH_START).map(|a| a as usize).unwrap_or(usize::MAX);
            flash
                .get_mut(at..at.saturating_add(data.len()))
                .ok_or_else(|| RunError::Elf(format!("a segment at {address:#010x} is outside the flash")))?
                .copy_from_slice(data);
        }
        let static_end = file
            .segments()
            .filter(|s| (RAM_START..RAM_START + RAM_SIZE).contains(&(s.address() as u32)))
            .map(|s| (s.address() + s.size()) as u32)
            .max()
            .unwrap_or(RAM_START);
        let rtt = file.symbols().find(|s| s.name() == Ok("_SEGGER_RTT")).map(|s| s.address() as u32);

        let mut cpu = uc(Unicorn::new_with_data(Arch::ARM, Mode::THUMB | Mode::MCLASS, Chip::new(CSR_POWER_ON, 0)))?;
        uc(cpu.ctl_set_cpu_model(ArmCpuModel::CORTEX_M4 as i32))?;
        flash_memory.write(FLASH_START, &flash).ok_or(RunError::Flash(0))?;
        for (memory, start, size, access) in [
            (&flash_memory, FLASH_START, FLASH_SIZE, Prot::READ | Prot::EXEC),
            (&flash_memory, 0, FLASH_SIZE, Prot::READ),
            (&ram_memory, RAM_START, RAM_SIZE, Prot::READ | Prot::WRITE),
        ] {
            // SAFETY: the memories live in `Board` beside the emulator, which is dropped before them.
            #[allow(unsafe_code)]
            uc(unsafe { cpu.mem_map_ptr(u64::from(start), u64::from(size), access, memory.pointer()) })?;
        }
        for (base, size) in [(0x4000_0000u64, 0x8_0000u64), (0xE000_0000, 0x10_0000)] {
            uc(cpu.mmio_map(
                base,
                size,
                Some(move |c: &mut Cpu<'_>, offset: u64, size: usize| {
                    let address = (base + offset) as u32;
                    let value = c.get_data_mut().read(address & !3);
                    let shifted = value >> (8 * (address & 3));
                    u64::from(match size {
                        1 => shifted & 0xFF,
                        2 => shifted & 0xFFFF,
                        _ => shifted,
                    })
                }),
                Some(move |c: &mut Cpu<'_>, offset: u64, size: usize, value: u64| {
                    let address = (base + offset) as u32;
                    let chip = c.get_data_mut();
                    // Registers are written whole, but for byte-wide interrupt priorities and half-words
                    // written to a register's lower half.
                    chip.write(address, value as u32, size);
                }),
            ))?;
        }
        // Unicorn takes RAM for executable and then checks every store for code that it overwrites, which costs a third of the
        // speed. Code runs from flash only; here that is said.
        uc(cpu.ctl_set_tlb_type(TlbType::VIRTUAL))?;
        uc(cpu.add_tlb_hook(0, u64::MAX, |c, address, _| {
            c.get_data_mut().it_stale = true;
            let perms = match address as u32 {
                FLASH_START..=FLASH_END => Prot::ALL,
                // What the chip shows at address 0: its flash. Nothing runs there.
                0..FLASH_SIZE => Prot::READ,
                _ => Prot::READ | Prot::WRITE,
            };
            Some(TlbEntry { paddr: address, perms })
        }))?;
        // No exit addresses: clearing one up after each run would cost more than most runs.
        uc(cpu.ctl_exits_enable())?;
        // Size and number of instructions of the block that begins at each half-word.
        let mut blocks = vec![(0u16, 0u16); FLASH_SIZE as usize / 2];
        let code = flash.clone();
        uc(cpu.add_block_hook(
            u64::from(FLASH_START),
            u64::from(FLASH_START + FLASH_SIZE),
            move |c, address, size| {
                let at = (address as usize - FLASH_START as usize) / 2;
                let mut block = blocks[at];
                if u32::from(block.0) != size {
                    let n = thumb_instructions(&code[at * 2..at * 2 + size as usize]);
                    block = (size as u16, u16::from(n));
                    blocks[at] = block;
                }
                let n = u64::from(block.1);
                if std::mem::take(&mut c.get_data_mut().it_stale) {
                    // Filling the TLB for a store within an IT block leaves that block's state behind, and the next
                    // instructions would be taken for conditional ones.
                    let in_state = c.reg_read(RegisterARM::XPSR).is_ok_and(|x| x & IT_STATE != 0);
                    if in_state && !within_it(&code, at * 2) {
                        c.get_data_mut().forget_it = true;
                        let _ = c.emu_stop();
                        return;
                    }
                }
                let chip = c.get_data_mut();
                if chip.now >= chip.deadline || chip.attention || chip.masked {
                    let stop = chip.now >= chip.deadline || chip.attention || {
                        let primask = c.reg_read(RegisterARM::PRIMASK).unwrap_or(0);
                        let basepri = c.reg_read(RegisterARM::BASEPRI).unwrap_or(0);
                        primask & 1 == 0 && basepri == 0
                    };
                    // The stopped block is not executed; it comes again.
                    if stop && !c.reg_read(RegisterARM::XPSR).is_ok_and(|x| x & IT_STATE != 0) {
                        let _ = c.emu_stop();
                        return;
                    }
                }
                let chip = c.get_data_mut();
                if chip.watched {
                    let link = c.reg_read(RegisterARM::LR).unwrap_or(0) as u32;
                    let chip = c.get_data_mut();
                    let now = (chip.now, chip.instructions);
                    let ready = chip.ready;
                    chip.probes.iter_mut().for_each(|p| p.block(address as u32, now, ready, || link));
                    if let Some(count) = chip.profile.as_mut().and_then(|p| p.get_mut(at)) {
                        *count += n;
                    }
                }
                let chip = c.get_data_mut();
                chip.now += n;
                chip.instructions += n;
            },
        ))?;
        // WFE and SEV are found by their encodings.
        for at in (0..flash.len() - 1).step_by(2) {
            let address = u64::from(FLASH_START) + at as u64;
            match (flash[at], flash[at + 1]) {
                (0x20, 0xBF) => {
                    // Unicorn must not see it: it is stepped over here.
                    uc(cpu.add_code_hook(address, address, |c, address, _| {
                        let _ = c.reg_write(RegisterARM::PC, (address + 2) | 1);
                        let chip = c.get_data_mut();
                        chip.attention = true;
                        if chip.event {
                            chip.event = false;
                        } else {
                            chip.asleep = true;
                        }
                        let _ = c.emu_stop();
                    }))?;
                }
                (0x40, 0xBF) => {
                    uc(cpu.add_code_hook(address, address, |c, _, _| c.get_data_mut().event = true))?;
                }
                _ => {}
            }
        }
        uc(cpu.add_intr_hook(|c, number| {
            let chip = c.get_data_mut();
            if number == 8 {
                chip.returning = true;
            } else {
                chip.error.get_or_insert(format!("the firmware raised CPU exception {number}"));
            }
            let _ = c.emu_stop();
        }))?;
        let mut board = Self {
            cpu,
            flash: flash_memory,
            ram: ram_memory,
            world,
            rtt,
            static_end,
            wires: Wires {
                next_edge: [0; 3],
                next_sample: 0,
                next_byte: None,
                link_idle: u64::MAX,
                next_look: 0,
                ready_stamp: 0,
                fetch_stamp: 0,
                spoilt: false,
            },
            flash_watch: None,
            stop_at: u64::MAX,
            flash_operations: 0,
            stop_at_operation: u64::MAX,
            torn: false,
            as_on_chip: false,
            upsets: 0,
            hardware_watchdog: false,
        };
        for channel in 0..3 {
            board.wires.next_edge[channel] = board.world.next_edge(channel).unwrap_or(u64::MAX);
        }
        board.wires.next_byte = board.world.next_link_byte();
        board.restart(CSR_POWER_ON)?;
        Ok(board)
    }

    /// Cycles since power-on.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.cpu.get_data().now
    }

    /// Instructions executed since power-on.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.cpu.get_data().instructions
    }

    /// Counts the instructions of every call of the function whose symbol contains `part` from now on; gives the number
    /// to ask [`probe`](Self::probe) with.
    ///
    /// # Errors
    /// Where the ELF has no such function, or several.
    pub fn count_calls(&mut self, elf: &[u8], part: &str) -> Result<usize, RunError> {
        let file = object::File::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
        let mut found: Vec<u32> = file
            .symbols()
            .filter(|s| s.kind() == object::SymbolKind::Text && s.name().is_ok_and(|n| n.contains(part)))
            .map(|s| s.address() as u32 & !1)
            .collect();
        found.sort_unstable();
        found.dedup();
        let [entry] = found[..] else {
            return Err(RunError::Elf(format!("{} functions are called {part}", found.len())));
        };
        let chip = self.cpu.get_data_mut();
        chip.watched = true;
        chip.probes.push(Probe::new(entry));
        Ok(chip.probes.len() - 1)
    }

    /// Counts instructions function by function from now on; see [`profile`](Self::profile).
    pub fn start_profile(&mut self) {
        let chip = self.cpu.get_data_mut();
        chip.watched = true;
        chip.profile = Some(vec![0; FLASH_SIZE as usize / 2]);
    }

    /// Instructions of each function since [`start_profile`](Self::start_profile), most first; inlined ones count for where
    /// they are inlined.
    ///
    /// # Errors
    /// Where the ELF cannot be read.
    pub fn profile(&self, elf: &[u8]) -> Result<Vec<(String, u64)>, RunError> {
        let file = object::File::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
        let mut functions: Vec<(usize, String)> = file
            .symbols()
            .filter(|s| s.kind() == object::SymbolKind::Text && s.address() as u32 >= FLASH_START)
            .filter_map(|s| Some(((s.address() as u32 - FLASH_START) as usize / 2, s.name().ok()?.to_string())))
            .collect();
        functions.sort();
        let mut out = std::collections::BTreeMap::<String, u64>::new();
        for (at, count) in self.cpu.get_data().profile.iter().flatten().enumerate().filter(|(_, c)| **c > 0) {
            let before = functions.partition_point(|f| f.0 <= at);
            let name = before.checked_sub(1).map_or("?", |k| functions[k].1.as_str());
            *out.entry(name.to_string()).or_default() += count;
        }
        let mut out: Vec<(String, u64)> = out.into_iter().collect();
        out.sort_by_key(|f| std::cmp::Reverse(f.1));
        Ok(out)
    }

    /// Where the one variable or function lies whose symbol contains `part`.
    #[must_use]
    pub fn address_of(elf: &[u8], part: &str) -> Option<u32> {
        let file = object::File::parse(elf).ok()?;
        let address = file.symbols().find(|s| s.name().is_ok_and(|n| n.contains(part)))?.address();
        Some(address as u32)
    }

    /// The name of the variable or function at an address, where the ELF has one.
    #[must_use]
    pub fn symbol_at(elf: &[u8], address: u32) -> Option<String> {
        let file = object::File::parse(elf).ok()?;
        let at = u64::from(address);
        let symbol = file.symbols().find(|s| s.size() > 0 && (s.address()..s.address() + s.size()).contains(&at))?;
        Some(symbol.name().ok()?.to_string())
    }

    /// Counts the calls of all probes anew.
    pub fn forget_calls(&mut self) {
        for p in &mut self.cpu.get_data_mut().probes {
            p.calls.clear();
            p.latency = Default::default();
        }
    }

    /// Instructions of each block of code since [`start_profile`](Self::start_profile), by the block's address.
    #[must_use]
    pub fn profile_blocks(&self) -> Vec<(u32, u64)> {
        let counts = self.cpu.get_data().profile.iter().flatten().enumerate();
        counts.filter(|(_, n)| **n > 0).map(|(k, n)| (FLASH_START + 2 * k as u32, *n)).collect()
    }

    /// What [`count_calls`](Self::count_calls) has counted so far.
    #[must_use]
    pub fn probe(&self, number: usize) -> Option<&Probe> {
        self.cpu.get_data().probes.get(number)
    }

    /// Writes into flash from outside, as a programmer does: erased bits and all. `offset` from its start.
    ///
    /// # Errors
    /// Outside the flash.
    pub fn write_flash(&mut self, offset: u32, bytes: &[u8]) -> Result<(), RunError> {
        self.flash.write(FLASH_START + offset, bytes).ok_or(RunError::Flash(offset))
    }

    /// Reads memory.
    ///
    /// # Errors
    /// Where there is none.
    pub fn read_memory(&self, address: u32, bytes: &mut [u8]) -> Result<(), RunError> {
        self.get(address, bytes)
    }

    /// Has [`run_until`](Self::run_until) stop at the first block of code at or after this many instructions since
    /// power-on.
    pub fn stop_at_instruction(&mut self, instructions: u64) {
        self.stop_at = instructions;
    }

    /// Has [`run_until`](Self::run_until) stop within the n-th flash operation from now (1 is the next; programming a word and
    /// erasing a sector are one each), which is left half done: some bits changed, some not. A power cut then and there.
    pub fn stop_at_flash_operation(&mut self, n: u64) {
        self.stop_at_operation = self.flash_operations.saturating_add(n);
    }

    /// Flash operations since power-on: words programmed and sectors erased.
    #[must_use]
    pub fn flash_operations(&self) -> u64 {
        self.flash_operations
    }

    /// From now on a fault of the firmware ends no run: it is taken as the chip takes it, with the HardFault handler, or lock-up
    /// where there is no stack for that. An access to a register that is not modelled counts as a bus fault.
    pub fn faults_as_on_chip(&mut self) {
        self.as_on_chip = true;
    }

    /// Switches an interrupt off behind the firmware's back.
    pub fn disable_interrupt(&mut self, number: usize) {
        let register = 0xE000_E180 + 4 * (number as u32 / 32);
        let _ = self.cpu.get_data_mut().nvic.write(register, 1 << (number % 32), 4);
    }

    /// Sets the option byte WDG_SW to 0 and cuts the power: from now on the watchdog runs from every reset.
    ///
    /// # Errors
    /// As [`run_until`](Self::run_until).
    pub fn watch_from_reset(&mut self) -> Result<(), RunError> {
        self.hardware_watchdog = true;
        self.power_cut()
    }

    /// Faults taken since then.
    #[must_use]
    pub fn faults(&self) -> u64 {
        self.upsets
    }

    /// The board as it is, world and all.
    ///
    /// # Errors
    /// While flash is being written.
    pub fn snapshot(&self) -> Result<Snapshot<W>, RunError>
    where
        W: Clone,
    {
        if self.flash_watch.is_some() {
            return Err(RunError::NotModelled { what: "a snapshot while flash is written".into(), pc: self.pc() });
        }
        let mut context = uc(self.cpu.context_alloc())?;
        uc(self.cpu.context_save(&mut context))?;
        let (mut flash, mut ram) = (vec![0; FLASH_SIZE as usize], vec![0; RAM_SIZE as usize]);
        self.get(FLASH_START, &mut flash)?;
        self.get(RAM_START, &mut ram)?;
        Ok(Snapshot {
            context,
            chip: self.cpu.get_data().clone(),
            flash,
            ram,
            world: self.world.clone(),
            wires: self.wires,
        })
    }

    /// Back to a moment of this board.
    ///
    /// # Errors
    /// Where the emulator refuses.
    pub fn restore(&mut self, s: &Snapshot<W>) -> Result<(), RunError>
    where
        W: Clone,
    {
        uc(self.cpu.context_restore(&s.context))?;
        *self.cpu.get_data_mut() = s.chip.clone();
        self.put(FLASH_START, &s.flash)?;
        self.put(RAM_START, &s.ram)?;
        self.world = s.world.clone();
        self.wires = s.wires;
        self.stop_at = u64::MAX;
        self.stop_at_operation = u64::MAX;
        self.torn = false;
        self.upsets = 0;
        self.open_or_close_flash()
    }

    /// The firmware did something that it should not.
    fn upset(&mut self, what: RunError) -> Result<(), RunError> {
        if !self.as_on_chip {
            return Err(what);
        }
        self.upsets += 1;
        const HARD_FAULT: u16 = 3;
        let within = self.cpu.get_data().nvic.stack.contains(&HARD_FAULT);
        if within || self.enter_exception(HARD_FAULT).is_err() {
            let chip = self.cpu.get_data_mut();
            chip.locked_up = true;
            chip.asleep = true;
        }
        Ok(())
    }

    /// What a DMA stream reads or writes; outside memory it is a transfer error, which on the chip stops the stream.
    fn moved_by_dma(&self, done: Result<(), RunError>) -> Result<(), RunError> {
        done.or_else(|e| if self.as_on_chip { Ok(()) } else { Err(e) })
    }

    /// Cuts the power and brings it back: RAM is lost, flash stays as it is.
    ///
    /// # Errors
    /// As [`run_until`](Self::run_until).
    pub fn power_cut(&mut self) -> Result<(), RunError> {
        self.put(RAM_START, &vec![PAINT; RAM_SIZE as usize])?;
        self.torn = false;
        self.restart(CSR_POWER_ON)?;
        self.open_or_close_flash()
    }

    /// Bytes of stack used so far: from the top of RAM down to the lowest byte ever written above the statics.
    #[must_use]
    pub fn stack_used(&self) -> u32 {
        let mut rest = vec![0; (RAM_START + RAM_SIZE - self.static_end) as usize];
        if self.ram.read(self.static_end, &mut rest).is_none() {
            return 0;
        }
        let untouched = rest.iter().take_while(|b| **b == PAINT).count();
        (rest.len() - untouched) as u32
    }

    /// Asks the world for the next byte of the link, where it had none when it was last asked.
    pub fn poll_link(&mut self) {
        if self.wires.next_byte.is_none() {
            self.wires.next_byte = self.world.next_link_byte();
        }
    }

    /// Bytes of RAM that statics take.
    #[must_use]
    pub fn static_bytes(&self) -> u32 {
        self.static_end - RAM_START
    }

    /// Flips one bit of RAM or flash.
    ///
    /// # Errors
    /// Where there is no memory.
    pub fn flip_bit(&mut self, address: u32, bit: u8) -> Result<(), RunError> {
        let mut byte = [0];
        self.read_memory(address, &mut byte)?;
        byte[0] ^= 1 << (bit & 7);
        self.put(address, &byte)
    }

    fn get(&self, address: u32, out: &mut [u8]) -> Result<(), RunError> {
        self.ram.read(address, out).or_else(|| self.flash.read(address, out)).ok_or_else(|| self.outside(address))
    }

    fn put(&mut self, address: u32, from: &[u8]) -> Result<(), RunError> {
        let done = self.ram.write(address, from).or_else(|| self.flash.write(address, from));
        done.ok_or_else(|| self.outside(address))
    }

    fn outside(&self, address: u32) -> RunError {
        RunError::NotModelled { what: format!("no memory at {address:#010x}"), pc: self.pc() }
    }

    fn restart(&mut self, cause: u32) -> Result<(), RunError> {
        let (now, instructions) = (self.now(), self.instructions());
        let mut chip = Chip::new(cause, now);
        chip.instructions = instructions;
        chip.watched = self.cpu.get_data().watched;
        chip.profile = self.cpu.get_data_mut().profile.take();
        chip.probes = std::mem::take(&mut self.cpu.get_data_mut().probes);
        chip.probes.iter_mut().for_each(Probe::interrupt);
        if self.hardware_watchdog {
            chip.iwdg = Iwdg::hardware(now);
        }
        *self.cpu.get_data_mut() = chip;
        let (mut sp, mut pc) = ([0; 4], [0; 4]);
        self.get(FLASH_START, &mut sp)?;
        self.get(FLASH_START + 4, &mut pc)?;
        let (sp, pc) = (u32::from_le_bytes(sp), u32::from_le_bytes(pc));
        uc(self.cpu.reg_write(RegisterARM::XPSR, 0x0100_0000))?;
        uc(self.cpu.reg_write(RegisterARM::PRIMASK, 0))?;
        uc(self.cpu.reg_write(RegisterARM::BASEPRI, 0))?;
        uc(self.cpu.reg_write(RegisterARM::CONTROL, 0))?;
        uc(self.cpu.reg_write(RegisterARM::SP, u64::from(sp)))?;
        uc(self.cpu.reg_write(RegisterARM::LR, 0xFFFF_FFFF))?;
        uc(self.cpu.reg_write(RegisterARM::PC, u64::from(pc | 1)))?;
        self.wires.next_sample = now;
        Ok(())
    }

    /// Runs until `cycles` since power-on.
    ///
    /// # Errors
    /// Where the firmware does what the board does not model, or the CPU faults.
    pub fn run_until(&mut self, cycles: u64) -> Result<Stop, RunError> {
        loop {
            self.events()?;
            if self.now() >= cycles {
                return Ok(Stop::Time);
            }
            if self.instructions() >= self.stop_at {
                self.stop_at = u64::MAX;
                return Ok(Stop::Instruction);
            }
            let chip = self.cpu.get_data_mut();
            chip.attention = false;
            chip.masked = false;
            if chip.now >= chip.iwdg.next_event() {
                self.restart(CSR_WATCHDOG)?;
                return Ok(Stop::Watchdog);
            }
            if chip.nvic.reset {
                self.restart(CSR_SOFTWARE)?;
                return Ok(Stop::Software);
            }
            if chip.asleep {
                if !chip.locked_up && (chip.event || chip.nvic.any_pending()) {
                    chip.asleep = false;
                    chip.event = false;
                } else {
                    self.sleep(cycles)?;
                    continue;
                }
            }
            if let Err(e) = self.interrupts() {
                self.upset(e)?;
                continue;
            }
            let next = self.next_event().min(cycles);
            let left = self.stop_at.saturating_sub(self.instructions());
            let chip = self.cpu.get_data_mut();
            // While it is awake, a cycle is an instruction.
            chip.deadline = next.min(chip.now.saturating_add(left));
            chip.nvic.changed = false;
            let pc = uc(self.cpu.reg_read(RegisterARM::PC))?;
            let ran = self.cpu.emu_start(pc | 1, 0xFFFF_FFF0, 0, 0);
            if std::mem::take(&mut self.cpu.get_data_mut().forget_it) {
                let xpsr = uc(self.cpu.reg_read(RegisterARM::XPSR))?;
                uc(self.cpu.reg_write(RegisterARM::XPSR, xpsr & !IT_STATE))?;
            }
            let chip = self.cpu.get_data_mut();
            let error = chip.error.take();
            let returning = std::mem::take(&mut chip.returning);
            if let Err(e) = ran {
                self.upset(RunError::Cpu { what: format!("{e:?}"), pc: self.pc() })?;
                continue;
            }
            if let Some(what) = error {
                self.upset(RunError::NotModelled { what, pc: self.pc() })?;
                continue;
            }
            if returning {
                if let Err(e) = self.leave_exception() {
                    self.upset(e)?;
                }
            }
            self.open_or_close_flash()?;
            if !self.cpu.get_data().flash_writes.is_empty() {
                self.judge_flash_writes()?;
            }
            if let Some(sector) = self.cpu.get_data_mut().flash.erase.take() {
                if let (Some(&from), Some(&to)) = (SECTORS.get(sector), SECTORS.get(sector + 1)) {
                    let mut content = vec![0xFF; (to - from) as usize];
                    if self.operate() {
                        // Cut short: what was a zero may be one by now, or not.
                        self.get(FLASH_START + from, &mut content)?;
                        let mut mask = Mask::new(self.flash_operations);
                        content.iter_mut().for_each(|b| *b |= mask.next() as u8);
                    }
                    self.put(FLASH_START + from, &content)?;
                }
                let chip = self.cpu.get_data_mut();
                chip.flash.done();
                // The processor stands still: code comes from the same bank.
                chip.now += ERASE_CYCLES;
            }
            if std::mem::take(&mut self.torn) {
                return Ok(Stop::Flash);
            }
        }
    }

    /// Counts a flash operation; whether it is the one that is cut short.
    fn operate(&mut self) -> bool {
        self.flash_operations += 1;
        let cut = self.flash_operations == self.stop_at_operation;
        if cut {
            self.stop_at_operation = u64::MAX;
            self.torn = true;
        }
        cut
    }

    /// Sleeps until the next event that is not an edge, or an edge that has something to say to the CPU.
    fn sleep(&mut self, cycles: u64) -> Result<(), RunError> {
        let other = self.next_but_edges().min(cycles);
        loop {
            let (channel, edge) = match self.wires.next_edge {
                [a, b, c] if a <= b && a <= c => (0, a),
                [_, b, c] if b <= c => (1, b),
                [_, _, c] => (2, c),
            };
            let next = edge.min(other);
            let chip = self.cpu.get_data_mut();
            if next == u64::MAX || next > chip.now + SLEEP_LIMIT {
                return Err(RunError::Cpu { what: "it sleeps and nothing will wake it".into(), pc: self.pc() });
            }
            chip.now = chip.now.max(next);
            if edge > other {
                return Ok(());
            }
            self.edge(channel)?;
            let chip = self.cpu.get_data_mut();
            if chip.dma[0].speaks() || chip.tim2.irq() {
                chip.update_lines();
                return Ok(());
            }
        }
    }

    /// Where the CPU is.
    #[must_use]
    pub fn pc(&self) -> u32 {
        self.cpu.reg_read(RegisterARM::PC).unwrap_or(0) as u32
    }

    fn next_event(&self) -> u64 {
        self.wires.next_edge.iter().fold(self.next_but_edges(), |a, b| a.min(*b))
    }

    fn next_but_edges(&self) -> u64 {
        let chip = self.cpu.get_data();
        let mut next = self.wires.next_sample.min(self.wires.next_look).min(self.wires.link_idle);
        next = next.min(self.wires.next_byte.map_or(u64::MAX, |(t, _)| t));
        next.min(chip.tim2.next_event())
            .min(chip.tim5.next_event())
            .min(chip.spi_done)
            .min(chip.usart_done)
            .min(chip.iwdg.next_event())
    }

    /// Handles everything that is due.
    fn events(&mut self) -> Result<(), RunError> {
        let now = self.now();
        let mut any = false;
        for channel in 0..3 {
            while self.wires.next_edge[channel] <= now {
                self.edge(channel)?;
                any = true;
            }
        }
        while self.wires.next_sample <= now {
            self.sample();
            any = true;
        }
        let chip = self.cpu.get_data_mut();
        if chip.tim2.next_event() <= now {
            chip.tim2.advance(now);
            any = true;
        }
        if chip.tim5.next_event() <= now {
            chip.tim5.advance(now);
            any = true;
        }
        if chip.spi_done <= now {
            self.finish_spi()?;
            any = true;
        }
        if self.cpu.get_data().usart_done <= now {
            self.finish_usart()?;
            any = true;
        }
        while let Some((at, byte)) = self.wires.next_byte.filter(|(t, _)| *t <= now) {
            self.receive(at, byte)?;
            any = true;
        }
        if self.wires.link_idle <= now {
            self.wires.link_idle = u64::MAX;
            self.cpu.get_data_mut().usart1.idle();
            any = true;
        }
        if self.wires.next_look <= now {
            self.wires.next_look = now + EVENTS_PER_LOOK;
            self.look_at_rtt()?;
        }
        if any {
            self.cpu.get_data_mut().update_lines();
        }
        Ok(())
    }

    fn edge(&mut self, channel: usize) -> Result<(), RunError> {
        let at = self.wires.next_edge[channel];
        let chip = self.cpu.get_data_mut();
        if let Some((stamp, dma)) = chip.tim2.edge(channel, true, at) {
            if dma {
                if let Some(stream) = chip.stream(Request::Tim2(channel)) {
                    let to = chip.dma[stream.0].streams[stream.1].memory();
                    chip.moved(stream, 1);
                    let done = self.put(to, &stamp.to_le_bytes());
                    self.moved_by_dma(done)?;
                }
            }
            self.world.captured(channel, stamp);
        }
        self.wires.next_edge[channel] = self.world.next_edge(channel).unwrap_or(u64::MAX);
        Ok(())
    }

    fn sample(&mut self) {
        let at = self.wires.next_sample;
        self.wires.next_sample = at + self.cpu.get_data().converter.period(CPU_HZ).max(1);
        let Some(codes) = self.world.convert(at) else {
            return;
        };
        self.wires.spoilt = self.world.spoil_converter_frame();
        let chip = self.cpu.get_data_mut();
        chip.ready = (at.min(chip.now), chip.instructions);
        chip.spoil = self.wires.spoilt;
        chip.converter.convert(codes);
        // Data-ready falls at its EXTI pin and at channel 4 of TIM2.
        if let Some((stamp, _)) = chip.tim2.edge(3, false, at) {
            self.wires.ready_stamp = stamp;
        }
        chip.exti.edge(7, false);
    }

    fn finish_spi(&mut self) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        chip.spi_done = u64::MAX;
        let (Some(rx), Some(tx)) = (chip.stream(Request::Spi1Rx), chip.stream(Request::Spi1Tx)) else {
            return Ok(());
        };
        let n = chip.dma[rx.0].streams[rx.1].ndtr;
        let from = chip.dma[tx.0].streams[tx.1].memory();
        let to = chip.dma[rx.0].streams[rx.1].memory();
        let stamp = chip.tim2.capture(3);
        let mut bytes = vec![0; n as usize];
        let done = self.get(from, &mut bytes);
        self.moved_by_dma(done)?;
        let chip = self.cpu.get_data_mut();
        for b in &mut bytes {
            *b = chip.converter.exchange(*b);
        }
        chip.moved(rx, n);
        chip.moved(tx, n);
        let (codes, good) = chip.converter.sent();
        let done = self.put(to, &bytes);
        self.moved_by_dma(done)?;
        self.wires.fetch_stamp = stamp;
        if n == 30 {
            // With the reset flag of the converter in its status, the codes are not to be used.
            let good = good && bytes[0] & 0x04 == 0;
            self.world.fetched(self.wires.fetch_stamp, codes, good);
        }
        Ok(())
    }

    fn finish_usart(&mut self) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        chip.usart_done = u64::MAX;
        let Some(tx) = chip.stream(Request::Usart1Tx) else {
            return Ok(());
        };
        let s = &chip.dma[tx.0].streams[tx.1];
        let (from, n) = (s.memory(), s.ndtr);
        chip.moved(tx, n);
        chip.usart1.transmitted();
        let now = chip.now;
        let mut bytes = vec![0; n as usize];
        let done = self.get(from, &mut bytes);
        self.moved_by_dma(done)?;
        self.world.link_out(now, &bytes);
        Ok(())
    }

    fn receive(&mut self, at: u64, byte: u8) -> Result<(), RunError> {
        self.wires.next_byte = self.world.next_link_byte();
        let chip = self.cpu.get_data_mut();
        if !chip.usart1.receiving() {
            return Ok(());
        }
        let idle_after = at + chip.usart1.cycles_per_byte();
        self.wires.link_idle =
            if self.wires.next_byte.is_some_and(|(t, _)| t <= idle_after) { u64::MAX } else { idle_after };
        match chip.usart1.receives_by_dma().then(|| chip.stream(Request::Usart1Rx)).flatten() {
            Some(rx) => {
                let to = chip.dma[rx.0].streams[rx.1].memory();
                chip.moved(rx, 1);
                let done = self.put(to, &[byte]);
                self.moved_by_dma(done)?;
            }
            None => chip.usart1.received_by_hand(byte),
        }
        Ok(())
    }

    fn look_at_rtt(&mut self) -> Result<(), RunError> {
        let Some(block) = self.rtt else { return Ok(()) };
        let mut b = [0u8; 48];
        self.get(block, &mut b)?;
        let field = |at: usize| u32::from_le_bytes([b[at], b[at + 1], b[at + 2], b[at + 3]]);
        if &b[..10] != b"SEGGER RTT" {
            return Ok(());
        }
        let (buffer, size, write, mut read) = (field(28), field(32), field(36), field(40));
        if write == read || size == 0 || write >= size || read >= size {
            return Ok(());
        }
        let mut bytes = Vec::new();
        while read != write {
            let end = if read < write { write } else { size };
            let mut part = vec![0; (end - read) as usize];
            if self.get(buffer.wrapping_add(read), &mut part).is_err() {
                return Ok(()); // the debug probe finds no log there
            }
            bytes.extend(part);
            read = end % size;
        }
        self.put(block + 40, &read.to_le_bytes())?;
        let now = self.now();
        self.world.log_out(now, &bytes);
        Ok(())
    }

    fn interrupts(&mut self) -> Result<(), RunError> {
        loop {
            let chip = self.cpu.get_data();
            if !chip.nvic.any_pending() {
                return Ok(());
            }
            let primask = uc(self.cpu.reg_read(RegisterARM::PRIMASK))? & 1 != 0;
            let basepri = uc(self.cpu.reg_read(RegisterARM::BASEPRI))? as u8;
            match chip.nvic.next(primask, basepri) {
                Some(exception) => self.enter_exception(exception)?,
                None => {
                    // Pending but masked: look when the mask is off.
                    if primask || basepri != 0 {
                        self.cpu.get_data_mut().masked = true;
                    }
                    return Ok(());
                }
            }
        }
    }

    const CORE: [RegisterARM; 6] =
        [RegisterARM::R0, RegisterARM::R1, RegisterARM::R2, RegisterARM::R3, RegisterARM::R12, RegisterARM::LR];
    const FLOAT: [RegisterARM; 8] = [
        RegisterARM::D0,
        RegisterARM::D1,
        RegisterARM::D2,
        RegisterARM::D3,
        RegisterARM::D4,
        RegisterARM::D5,
        RegisterARM::D6,
        RegisterARM::D7,
    ];

    fn enter_exception(&mut self, exception: u16) -> Result<(), RunError> {
        let cpu = &mut self.cpu;
        let sp = uc(cpu.reg_read(RegisterARM::SP))? as u32;
        let unaligned = sp.wrapping_sub(0x68);
        let frame_at = unaligned & !7;
        let xpsr = uc(cpu.reg_read(RegisterARM::XPSR))? as u32;
        let pc = uc(cpu.reg_read(RegisterARM::PC))? as u32 & !1;
        let mut frame = Vec::with_capacity(0x68);
        for r in Self::CORE {
            frame.extend((uc(cpu.reg_read(r))? as u32).to_le_bytes());
        }
        frame.extend(pc.to_le_bytes());
        frame.extend((xpsr & !0x200 | (unaligned & 4) << 7).to_le_bytes());
        for r in Self::FLOAT {
            frame.extend(uc(cpu.reg_read(r))?.to_le_bytes());
        }
        frame.extend((uc(cpu.reg_read(RegisterARM::FPSCR))? as u32).to_le_bytes());
        frame.extend([0; 4]);
        let nested = !cpu.get_data().nvic.stack.is_empty();
        let vector_at = cpu.get_data().nvic.vtor().max(FLASH_START) + 4 * u32::from(exception);
        let mut vector = [0; 4];
        self.put(frame_at, &frame)?;
        self.get(vector_at, &mut vector)?;
        let cpu = &mut self.cpu;
        uc(cpu.reg_write(RegisterARM::SP, u64::from(frame_at)))?;
        uc(cpu.reg_write(RegisterARM::LR, if nested { 0xFFFF_FFE1 } else { 0xFFFF_FFE9 }))?;
        uc(cpu.reg_write(RegisterARM::XPSR, u64::from(0x0100_0000 | u32::from(exception))))?;
        uc(cpu.reg_write(RegisterARM::PC, u64::from(u32::from_le_bytes(vector) | 1)))?;
        let chip = cpu.get_data_mut();
        chip.probes.iter_mut().for_each(Probe::interrupt);
        chip.nvic.enter(exception);
        chip.event = true;
        Ok(())
    }

    fn leave_exception(&mut self) -> Result<(), RunError> {
        let sp = uc(self.cpu.reg_read(RegisterARM::SP))? as u32;
        let mut frame = [0u8; 0x68];
        self.get(sp, &mut frame)?;
        let cpu = &mut self.cpu;
        let word = |n: usize| u32::from_le_bytes([frame[n * 4], frame[n * 4 + 1], frame[n * 4 + 2], frame[n * 4 + 3]]);
        for (n, r) in Self::CORE.into_iter().enumerate() {
            uc(cpu.reg_write(r, u64::from(word(n))))?;
        }
        for (n, r) in Self::FLOAT.into_iter().enumerate() {
            let value = u64::from(word(8 + 2 * n)) | u64::from(word(9 + 2 * n)) << 32;
            uc(cpu.reg_write(r, value))?;
        }
        uc(cpu.reg_write(RegisterARM::FPSCR, u64::from(word(24))))?;
        let xpsr = word(7);
        let sp = sp + 0x68 + if xpsr & 0x200 != 0 { 4 } else { 0 };
        uc(cpu.reg_write(RegisterARM::XPSR, u64::from(xpsr & !0x200)))?;
        uc(cpu.reg_write(RegisterARM::SP, u64::from(sp)))?;
        uc(cpu.reg_write(RegisterARM::PC, u64::from(word(6) | 1)))?;
        let chip = cpu.get_data_mut();
        chip.nvic.leave();
        chip.event = true;
        chip.update_lines();
        Ok(())
    }

    /// While the flash is unlocked, writes to it are let through and watched. (Watching slows every store of
    /// the CPU down, so it is not done all the time; a write while locked is a fault of the CPU.)
    fn open_or_close_flash(&mut self) -> Result<(), RunError> {
        let unlocked = self.cpu.get_data().flash.unlocked();
        if unlocked == self.flash_watch.is_some() {
            return Ok(());
        }
        if let Some(hook) = self.flash_watch.take() {
            uc(self.cpu.remove_hook(hook))?;
            uc(self.cpu.mem_protect(u64::from(FLASH_START), u64::from(FLASH_SIZE), Prot::READ | Prot::EXEC))?;
            return Ok(());
        }
        uc(self.cpu.mem_protect(u64::from(FLASH_START), u64::from(FLASH_SIZE), Prot::ALL))?;
        let hook = self.cpu.add_mem_hook(
            HookType::MEM_WRITE,
            u64::from(FLASH_START),
            u64::from(FLASH_START + FLASH_SIZE - 1),
            |c, _, address, _, _| {
                let word = address & !3;
                let mut old = [0; 4];
                let _ = c.mem_read(word, &mut old);
                let chip = c.get_data_mut();
                chip.flash_writes.push((word as u32, old));
                chip.attention = true;
                true
            },
        );
        self.flash_watch = Some(uc(hook)?);
        Ok(())
    }

    fn judge_flash_writes(&mut self) -> Result<(), RunError> {
        let writes = std::mem::take(&mut self.cpu.get_data_mut().flash_writes);
        for (address, old) in writes {
            let programming = self.cpu.get_data().flash.programming();
            let mut new = [0; 4];
            self.get(address, &mut new)?;
            // Cut short, some of the bits that were to become zero have not.
            let short = if programming && self.operate() { Mask::new(self.flash_operations).next() as u32 } else { 0 };
            let kept = old.iter().zip(new).zip(short.to_le_bytes());
            let kept: Vec<u8> = kept.map(|((o, n), s)| if programming { o & (n | s) } else { *o }).collect();
            self.put(address, &kept)?;
            if !programming {
                self.cpu.get_data_mut().flash.refuse();
            }
        }
        Ok(())
    }
}

/// Bits at random, for what a power cut leaves: splitmix64.
struct Mask(u64);

impl Mask {
    fn new(seed: u64) -> Self {
        Self(seed)
    }
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }
}

/// Where a segment is loaded (its physical address), given where it runs.
fn load_address(elf: &[u8], virtual_address: u64) -> Result<u32, RunError> {
    use object::read::elf::{ElfFile32, ProgramHeader};
    let file = ElfFile32::<object::Endianness>::parse(elf).map_err(|e| RunError::Elf(e.to_string()))?;
    let endian = file.endian();
    file.elf_program_headers()
        .iter()
        .find(|h| u64::from(h.p_vaddr(endian)) == virtual_address && h.p_filesz(endian) > 0)
        .map(|h| h.p_paddr(endian))
        .ok_or_else(|| RunError::Elf(format!("no program header for {virtual_address:#x}")))
}

/// Where xPSR holds the state of an IT block.
const IT_STATE: u64 = 0x0600_FC00;

/// Length of the Thumb instruction that begins at an offset, bytes.
fn thumb_length(code: &[u8], at: usize) -> usize {
    // A first half-word of 0b11101, 0b11110 or 0b11111 begins an instruction of four bytes.
    if code.get(at + 1).is_some_and(|high| *high >= 0xE8) {
        4
    } else {
        2
    }
}

/// Whether the instruction at an offset is one of those that an IT instruction before it makes conditional.
fn within_it(code: &[u8], at: usize) -> bool {
    (1..=8).filter_map(|back| at.checked_sub(2 * back)).any(|it| {
        let mask = code[it] & 0xF;
        if code[it + 1] != 0xBF || mask == 0 {
            return false;
        }
        let mut next = it + 2;
        (0..4 - mask.trailing_zeros()).any(|_| {
            let here = next == at;
            next += thumb_length(code, next);
            here
        })
    })
}

/// Number of Thumb instructions in a block.
fn thumb_instructions(code: &[u8]) -> u8 {
    let mut at = 0;
    let mut n = 0u8;
    while at + 1 < code.len() {
        at += thumb_length(code, at);
        n = n.saturating_add(1);
    }
    n
}
