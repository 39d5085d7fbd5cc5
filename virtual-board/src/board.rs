//! The board: CPU, chip, wires, and the loop that keeps time.
//!
//! # Design
//! Unicorn runs until a block hook finds that the next event is due or that something needs attention; then this
//! loop handles events in order of time, takes the interrupt of highest priority if it may, and goes on. The
//! hook counts Thumb instructions; a block is never left inside an IT block. On exception entry the extended
//! frame (with the floating-point registers) is stacked always, as if lazy stacking were off.

use crate::ads131m08::Defect;
use crate::chip::Chip;
use crate::chip_adc::Ambient;
use crate::cpu::{self, uc, Code, Cpu, SharedCode};
use crate::cycles::Cycles;
use crate::elf::Firmware;
use crate::error::{RunError, Stop};
use crate::memory::Memory;
use crate::part::{Part, STM32F446RE};
use crate::probe::{Masked, Probe};
use crate::profile::{Cost, Profile};
use crate::system::{Iwdg, CSR_POWER_ON, CSR_SOFTWARE, CSR_WATCHDOG, SECTORS};
use crate::thumb::{self, IT_STATE};
use crate::touched::Watch;
use crate::{World, CPU_HZ, FLASH_SIZE, FLASH_START, RAM_SIZE, RAM_START};
use unicorn_engine::{Context, HookType, RegisterARM, UcHookId};

/// Interval at which the debug probe polls the log, cycles.
const EVENTS_PER_LOOK: u64 = CPU_HZ / 100;
/// Contents of RAM at power-on.
const PAINT: u8 = 0xA5;
const SLEEP_LIMIT: u64 = CPU_HZ * 10;

/// State outside the chip: times of the next events, and results of the last ones.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wires {
    pub(crate) next_edge: [u64; 3],
    pub(crate) next_sample: u64,
    pub(crate) next_pulse: u64,
    pub(crate) next_byte: Option<(u64, u8)>,
    pub(crate) link_idle: u64,
    pub(crate) next_look: u64,
    pub(crate) ready_stamp: u32,
    pub(crate) fetch_stamp: u32,
    pub(crate) invalid: bool,
}

/// The board with firmware in its flash.
pub struct Board<W: World> {
    // Dropped first: it points into the memories.
    pub(crate) cpu: Cpu<'static>,
    code: SharedCode,
    pub(crate) flash: Memory,
    pub(crate) ram: Memory,
    /// The world on the wires.
    pub world: W,
    pub(crate) firmware: Firmware,
    pub(crate) wires: Wires,
    pub(crate) flash_watch: Option<UcHookId>,
    pub(crate) watch: Option<Watch>,
    stop_at: u64,
    pub(crate) flash_operations: u64,
    pub(crate) stop_at_operation: u64,
    pub(crate) torn: bool,
    pub(crate) worn_out: bool,
    pub(crate) as_on_chip: bool,
    pub(crate) mishaps: u64,
    /// Set if no probe reads the log.
    pub(crate) probe_gone: bool,
    pub(crate) hardware_watchdog: bool,
    pub(crate) battery: bool,
    /// Command line that an attached debugger gives the program.
    pub(crate) command_line: Option<String>,
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

impl<W: World> Board<W> {
    /// Puts the firmware into flash and switches the board on.
    ///
    /// # Errors
    /// If the ELF does not fit the board.
    pub fn new(elf: &[u8], world: W) -> Result<Self, RunError> {
        Self::on(&STM32F446RE, elf, world)
    }

    /// The same with another chip on the board.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn on(part: &'static Part, elf: &[u8], world: W) -> Result<Self, RunError> {
        let firmware = Firmware::parse(elf)?;
        let mut flash = Memory::new(FLASH_START, FLASH_SIZE)?;
        let mut ram = Memory::new(RAM_START, RAM_SIZE)?;
        // RAM is not zero at power-on; painted, it shows how far the stack came.
        ram.write(RAM_START, &vec![PAINT; RAM_SIZE as usize]).ok_or(RunError::Flash(0))?;
        flash.write(FLASH_START, firmware.flash()).ok_or(RunError::Flash(0))?;
        let (cpu, code) = cpu::emulator(Chip::new(part, CSR_POWER_ON, 0), &flash, &ram, firmware.flash())?;
        let mut board = Self {
            cpu,
            code,
            flash,
            ram,
            world,
            firmware,
            wires: Wires {
                next_edge: [0; 3],
                next_sample: 0,
                next_pulse: u64::MAX,
                next_byte: None,
                link_idle: u64::MAX,
                next_look: 0,
                ready_stamp: 0,
                fetch_stamp: 0,
                invalid: false,
            },
            flash_watch: None,
            watch: None,
            stop_at: u64::MAX,
            flash_operations: 0,
            stop_at_operation: u64::MAX,
            torn: false,
            worn_out: false,
            as_on_chip: false,
            mishaps: 0,
            hardware_watchdog: false,
            battery: false,
            command_line: None,
            probe_gone: false,
        };
        for channel in 0..3 {
            board.wires.next_edge[channel] = board.world.next_edge(channel).unwrap_or(u64::MAX);
        }
        board.wires.next_byte = board.world.next_link_byte();
        board.wires.next_pulse = board.world.next_pulse().unwrap_or(u64::MAX);
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

    /// The firmware in its flash.
    #[must_use]
    pub fn firmware(&self) -> &Firmware {
        &self.firmware
    }

    /// A channel of the ADC has a defect from now on.
    pub fn break_channel(&mut self, channel: usize, defect: Defect) {
        self.cpu.get_data_mut().adc.break_channel(channel, defect);
    }

    /// The supply and the temperature of the chip from now on.
    pub fn set_ambient(&mut self, ambient: Ambient) {
        self.cpu.get_data_mut().chip_adc.ambient = ambient;
    }

    /// A bit of RAM is stuck from now on, whatever the processor writes.
    ///
    /// # Errors
    /// If the emulator refuses.
    pub fn stick_bit(&mut self, address: u32, bit: u32, high: bool) -> Result<(), RunError> {
        let (at, mask) = (u64::from(address & !3), 1u32 << (bit % 32));
        let hook = self.cpu.add_mem_hook(HookType::MEM_READ, at, at + 3, move |c, _, _, _, _| {
            let mut word = [0; 4];
            let _ = c.mem_read(at, &mut word);
            let word = u32::from_le_bytes(word);
            let word = if high { word | mask } else { word & !mask };
            let _ = c.mem_write(at, &word.to_le_bytes());
            true
        });
        uc(hook).map(drop)
    }

    /// A word of RAM follows another from now on, as if an address line were open: a write to `of` changes `also`, too.
    ///
    /// # Errors
    /// As [`stick_bit`](Self::stick_bit).
    pub fn join_words(&mut self, of: u32, also: u32) -> Result<(), RunError> {
        let (of, also) = (u64::from(of & !3), u64::from(also & !3));
        let hook = self.cpu.add_mem_hook(HookType::MEM_WRITE, of, of + 3, move |c, _, _, _, value| {
            let _ = c.mem_write(also, &(value as u32).to_le_bytes());
            true
        });
        uc(hook).map(drop)
    }

    /// The flash keeps what it holds from now on: nothing that is programmed stays.
    pub fn wear_flash_out(&mut self) {
        self.worn_out = true;
    }

    /// Counts the instructions of every call of a function from now on, by its path
    /// (`hrg_core::link::Message::encode`); gives the number to ask [`probe`](Self::probe) with.
    ///
    /// # Errors
    /// If the ELF has no such function, or several.
    pub fn count_calls(&mut self, path: &str) -> Result<usize, RunError> {
        let entry = self.firmware.function(path)?;
        let chip = self.cpu.get_data_mut();
        chip.watched = true;
        chip.probes.push(Probe::new(entry));
        Ok(chip.probes.len() - 1)
    }

    /// Counts instructions and estimates cycles function by function from now on; see [`profile`](Self::profile).
    pub fn start_profile(&mut self) {
        self.start_estimate();
        self.cpu.get_data_mut().profile = Some(Profile::new(FLASH_SIZE as usize / 2));
    }

    /// Costs of each function since [`start_profile`](Self::start_profile), most cycles first, by its path; inlined ones count for
    /// where they are inlined.
    #[must_use]
    pub fn profile(&self) -> Vec<(String, Cost)> {
        let mut out = std::collections::BTreeMap::<&str, Cost>::new();
        for (at, cost) in self.cpu.get_data().profile.iter().flat_map(Profile::costs) {
            let name = self.firmware.function_before(FLASH_START + 2 * at as u32).unwrap_or("?");
            *out.entry(name).or_default() += cost;
        }
        let mut out: Vec<(String, Cost)> = out.into_iter().map(|(name, n)| (name.to_string(), n)).collect();
        out.sort_by_key(|f| std::cmp::Reverse(f.1.cycles));
        out
    }

    /// Estimates cycles from now on, beside the count of instructions ([`crate::cycles`]).
    pub fn start_estimate(&mut self) {
        let chip = self.cpu.get_data_mut();
        chip.watched = true;
        chip.estimated_from = chip.instructions;
        chip.estimate = Some(Box::default());
    }

    /// Cycles since [`start_estimate`](Self::start_estimate); zero without.
    #[must_use]
    pub fn estimate(&self) -> Cycles {
        self.cpu.get_data().estimate.as_ref().map_or_else(Cycles::default, |e| e.cycles())
    }

    /// The longest that the handler of an interrupt has run for since [`start_estimate`](Self::start_estimate), in estimated cycles, what came
    /// into it included; none without, and where there is no interrupt of that name.
    #[must_use]
    pub fn longest_interrupt(&self, name: &str) -> Option<u64> {
        const FIRST: u16 = 16;
        let chip = self.cpu.get_data();
        let number = chip.part.tables.interrupt(name)?;
        Some(chip.estimate.as_ref()?.longest(FIRST + number as u16))
    }

    /// The longest stretch without interrupts since [`forget_calls`](Self::forget_calls).
    #[must_use]
    pub fn longest_masked(&self) -> Masked {
        self.cpu.get_data().masked_stretch
    }

    /// Counts the calls of all probes anew, and the longest stretch without interrupts.
    pub fn forget_calls(&mut self) {
        self.cpu.get_data_mut().masked_stretch = Masked::default();
        for p in &mut self.cpu.get_data_mut().probes {
            p.calls.clear();
            p.estimates.clear();
            p.latency = Default::default();
        }
    }

    /// Counts of [`count_calls`](Self::count_calls) so far.
    #[must_use]
    pub fn probe(&self, number: usize) -> Option<&Probe> {
        self.cpu.get_data().probes.get(number)
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
        self.cpu.get_data_mut().strict = false;
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
    /// If the emulator refuses.
    pub fn restore(&mut self, s: &Snapshot<W>) -> Result<(), RunError>
    where
        W: Clone,
    {
        uc(self.cpu.context_restore(&s.context))?;
        *self.cpu.get_data_mut() = s.chip.clone();
        self.put(FLASH_START, &s.flash)?;
        self.follow_flash()?;
        self.put(RAM_START, &s.ram)?;
        self.world = s.world.clone();
        self.wires = s.wires;
        self.stop_at = u64::MAX;
        self.stop_at_operation = u64::MAX;
        self.torn = false;
        self.mishaps = 0;
        self.open_or_close_flash()
    }

    /// The firmware did something that it should not.
    fn mishap(&mut self, what: RunError) -> Result<(), RunError> {
        if !self.as_on_chip {
            return Err(what);
        }
        self.mishaps += 1;
        self.note_fault(&what);
        const HARD_FAULT: u16 = 3;
        let within = self.cpu.get_data().nvic.stack.contains(&HARD_FAULT);
        if within || self.enter_exception(HARD_FAULT).is_err() {
            let chip = self.cpu.get_data_mut();
            chip.locked_up = true;
            chip.asleep = true;
        }
        Ok(())
    }

    /// Sets the fault's registers (PM0214 sections 4.4.10 to 4.4.13).
    fn note_fault(&mut self, what: &RunError) {
        const FORCED: u32 = 1 << 30;
        let [undefined, fetch, precise, address_valid] = [16, 8, 9, 15].map(|bit| 1u32 << bit);
        let chip = self.cpu.get_data_mut();
        let address = std::mem::take(&mut chip.bad_address);
        let kind = match what {
            RunError::Cpu { what, .. } if what.contains("INSN") || what.contains("EXCEPTION") => undefined,
            RunError::Cpu { what, .. } if what.contains("FETCH") => fetch,
            _ => precise | if address == 0 { 0 } else { address_valid },
        };
        chip.nvic.fault = [kind, FORCED, address];
    }

    /// Result of a DMA stream's access. Outside memory it is a transfer error, which stops the stream and raises TEIF (RM0390 section 9.3.17).
    pub(crate) fn moved_by_dma(&mut self, stream: (usize, usize), done: Result<(), RunError>) -> Result<(), RunError> {
        let Err(e) = done else { return Ok(()) };
        if !self.as_on_chip {
            return Err(e);
        }
        self.cpu.get_data_mut().dma[stream.0].fail(stream.1);
        Ok(())
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

    /// Bytes of stack used so far: from its top down to the lowest byte ever written above the statics or the start of RAM.
    #[must_use]
    pub fn stack_used(&self) -> u32 {
        let room = self.firmware.stack();
        let mut rest = vec![0; room.len()];
        if self.ram.read(room.start, &mut rest).is_none() {
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
        self.firmware.statics().len() as u32
    }

    pub(crate) fn get(&self, address: u32, out: &mut [u8]) -> Result<(), RunError> {
        if let Some(watch) = &self.watch {
            watch.accessed(address, out.len(), false);
        }
        self.ram.read(address, out).or_else(|| self.flash.read(address, out)).ok_or_else(|| self.outside(address))
    }

    pub(crate) fn put(&mut self, address: u32, from: &[u8]) -> Result<(), RunError> {
        if let Some(watch) = &self.watch {
            watch.accessed(address, from.len(), true);
        }
        let done = self.ram.write(address, from).or_else(|| self.flash.write(address, from));
        done.ok_or_else(|| self.outside(address))
    }

    pub(crate) fn outside(&self, address: u32) -> RunError {
        RunError::NotModelled { what: format!("no memory at {address:#010x}"), pc: self.pc() }
    }

    /// The emulator forgets programs that are not there any more.
    fn follow_flash(&mut self) -> Result<(), RunError> {
        // (No program lies before.)
        for pair in SECTORS.windows(2).filter(|pair| pair[0] >= 0x1_0000) {
            let mut now = vec![0; (pair[1] - pair[0]) as usize];
            self.get(FLASH_START + pair[0], &mut now)?;
            Code::follow(&self.code, &mut self.cpu, pair[0] as usize..pair[1] as usize, &now)?;
        }
        Ok(())
    }

    pub(crate) fn restart(&mut self, cause: u32) -> Result<(), RunError> {
        self.follow_flash()?;
        let (now, instructions) = (self.now(), self.instructions());
        let mut chip = Chip::new(self.cpu.get_data().part, cause, now);
        chip.writes = std::mem::take(&mut self.cpu.get_data_mut().writes);
        chip.reads = std::mem::take(&mut self.cpu.get_data_mut().reads);
        chip.instructions = instructions;
        chip.watched = self.cpu.get_data().watched;
        chip.profile = self.cpu.get_data_mut().profile.take();
        chip.probes = std::mem::take(&mut self.cpu.get_data_mut().probes);
        chip.probes.iter_mut().for_each(Probe::interrupt);
        chip.strict = !self.as_on_chip;
        // Causes of resets stand until the program clears them (RM0390 section 6.3.21).
        if cause != CSR_POWER_ON {
            chip.rcc.add_causes(&self.cpu.get_data().rcc);
        }
        // Parts outside the processor keep their state over its reset.
        let before = self.cpu.get_data_mut();
        chip.flash.set_options(before.flash.options());
        chip.rcc.crystal_hz = before.rcc.crystal_hz;
        chip.rcc.crystal_start = before.rcc.crystal_start;
        chip.pwr.sag_tenths = before.pwr.sag_tenths;
        chip.iwdg.lsi_hz = before.iwdg.lsi_hz;
        chip.chip_adc.ambient = before.chip_adc.ambient;
        chip.mark_rises = before.mark_rises.take();
        chip.spare.jumpers = std::mem::take(&mut before.spare.jumpers);
        if cause != CSR_POWER_ON {
            chip.adc = before.adc.clone();
        }
        if cause != CSR_POWER_ON || self.battery {
            chip.backup = before.backup.clone();
        }
        if self.hardware_watchdog {
            chip.iwdg = Iwdg::hardware(now, chip.iwdg.lsi_hz);
        }
        *self.cpu.get_data_mut() = chip;
        let (mut sp, mut pc) = ([0; 4], [0; 4]);
        self.get(FLASH_START, &mut sp)?;
        self.get(FLASH_START + 4, &mut pc)?;
        let (sp, pc) = (u32::from_le_bytes(sp), u32::from_le_bytes(pc));
        if pc & 1 == 0 {
            let what =
                "the reset vector has no Thumb bit: the processor locks up at once (PM0214 section 2.3.4)".into();
            return Err(RunError::Cpu { what, pc });
        }
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
    /// If the firmware does something that the board does not model, or the CPU faults.
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
                if !chip.locked_up && (chip.event || chip.nmi || chip.nvic.any_pending()) {
                    chip.asleep = false;
                    chip.event = false;
                } else {
                    self.sleep(cycles)?;
                    continue;
                }
            }
            if let Err(e) = self.interrupts() {
                self.mishap(e)?;
                continue;
            }
            let next = self.next_event().min(cycles);
            let left = self.stop_at.saturating_sub(self.instructions());
            let chip = self.cpu.get_data_mut();
            // While it is awake, a cycle is an instruction.
            let left = left.saturating_mul(chip.pace.units) / chip.pace.ticks;
            chip.deadline = next.min(chip.now.saturating_add(left));
            chip.nvic.changed = false;
            let pc = uc(self.cpu.reg_read(RegisterARM::PC))?;
            let ran = self.cpu.emu_start(pc | 1, 0xFFFF_FFF0, 0, 0);
            self.forget_it()?;
            let chip = self.cpu.get_data_mut();
            let error = chip.error.take();
            let call = chip.call.take();
            let returning = std::mem::take(&mut chip.returning);
            if let Err(e) = ran {
                self.mishap(RunError::Cpu { what: format!("{e:?}"), pc: self.pc() })?;
                continue;
            }
            if let Some(what) = error {
                self.mishap(RunError::NotModelled { what, pc: self.pc() })?;
                continue;
            }
            if let Some(call) = call {
                match self.answer(call) {
                    Ok(Some(stop)) => return Ok(stop),
                    Ok(None) => {}
                    Err(e) => self.mishap(e)?,
                }
                continue;
            }
            if returning {
                if let Err(e) = self.leave_exception() {
                    self.mishap(e)?;
                }
            }
            self.open_or_close_flash()?;
            if !self.cpu.get_data().flash_writes.is_empty() {
                self.judge_flash_writes()?;
            }
            self.erase_sector()?;
            if std::mem::take(&mut self.torn) {
                return Ok(Stop::Flash);
            }
        }
    }

    /// The emulator may stop with the state of an IT block in which it has looked up an address, or accessed a register, though the program counter is
    /// behind that block: the next instructions would be taken for conditional ones.
    fn forget_it(&mut self) -> Result<(), RunError> {
        let xpsr = uc(self.cpu.reg_read(RegisterARM::XPSR))?;
        if xpsr & IT_STATE == 0 {
            return Ok(());
        }
        let (pc, mut before) = (self.pc() & !1, [0; 32]);
        let from = pc.saturating_sub(16).max(FLASH_START);
        // (A program that has lost its way may be anywhere, below the flash, too.)
        let Some(at) = pc.checked_sub(from) else { return Ok(()) };
        if self.get(from, &mut before).is_ok() && !thumb::within_it(&before, at as usize) {
            uc(self.cpu.reg_write(RegisterARM::XPSR, xpsr & !IT_STATE))?;
            // The code that comes was translated with that state, and the block before leads to the translation from now on.
            uc(self.cpu.ctl_remove_cache(u64::from(pc), u64::from(pc) + 2))?;
        }
        Ok(())
    }

    /// Sleeps until the next event that is not an edge, or an edge that has something to say to the CPU.
    fn sleep(&mut self, cycles: u64) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        if !chip.locked_up {
            chip.judge_sleep();
            self.complain()?;
        }
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

    /// Reports a fault that the chip would bear without a sign, found outside the CPU's own running.
    pub(crate) fn complain(&mut self) -> Result<(), RunError> {
        match self.cpu.get_data_mut().error.take() {
            Some(what) => Err(RunError::NotModelled { what, pc: self.pc() }),
            None => Ok(()),
        }
    }

    /// Address of the instruction that the CPU executes.
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
        next = next.min(self.wires.next_byte.map_or(u64::MAX, |(t, _)| t)).min(self.wires.next_pulse);
        next.min(chip.tim2.next_event())
            .min(chip.tim3.next_event())
            .min(chip.tim5.next_event())
            .min(chip.spi_done)
            .min(chip.usart_done)
            .min(chip.spare.next_event())
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
            self.sample()?;
            any = true;
        }
        while self.wires.next_pulse <= now {
            self.pulse();
            any = true;
        }
        while self.cpu.get_data().spare.next_event() <= now {
            self.spare_event()?;
            any = true;
        }
        let chip = self.cpu.get_data_mut();
        if chip.tim2.next_event() <= now {
            chip.tim2.advance(now);
            any = true;
        }
        if chip.tim3.next_event() <= now {
            chip.tim3.advance(now);
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
            if !self.probe_gone {
                self.look_at_rtt()?;
            }
        }
        if any {
            self.cpu.get_data_mut().update_lines();
            self.complain()?;
        }
        Ok(())
    }
}
