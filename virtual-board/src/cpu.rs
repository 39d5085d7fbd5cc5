//! The CPU: Unicorn, set up as a Cortex-M4 that counts its instructions, stops for events and shows its peripherals.

use crate::chip::Chip;
use crate::chip_adc::{FACTORY, FACTORY_AT};
use crate::cycles::Accelerator;
use crate::error::RunError;
use crate::memory::Memory;
use crate::thumb::{self, IT_STATE};
use crate::{FLASH_SIZE, FLASH_START, RAM_SIZE, RAM_START};
use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;
use unicorn_engine::{Arch, ArmCpuModel, HookType, Mode, Prot, RegisterARM, TlbEntry, TlbType, UcHookId, Unicorn};

/// The emulator with the chip as its data.
pub type Cpu<'a> = Unicorn<'a, Chip>;

const FLASH_END: u32 = FLASH_START + FLASH_SIZE - 1;

/// An answer of the emulator, with its errors as ours.
pub fn uc<T>(result: Result<T, unicorn_engine::uc_error>) -> Result<T, RunError> {
    result.map_err(|e| RunError::Cpu { what: format!("{e:?}"), pc: 0 })
}

/// The emulator on these memories, which must outlive it; `code` is what the flash holds.
pub fn emulator(chip: Chip, flash: &Memory, ram: &Memory, code: &[u8]) -> Result<(Cpu<'static>, SharedCode), RunError> {
    let mut cpu = uc(Unicorn::new_with_data(Arch::ARM, Mode::THUMB | Mode::MCLASS, chip))?;
    uc(cpu.ctl_set_cpu_model(ArmCpuModel::CORTEX_M4 as i32))?;
    for (memory, start, size, access) in [
        (flash, FLASH_START, FLASH_SIZE, Prot::READ | Prot::EXEC),
        (flash, 0, FLASH_SIZE, Prot::READ),
        (ram, RAM_START, RAM_SIZE, Prot::READ | Prot::WRITE),
    ] {
        // SAFETY: the memories live in `Board` beside the emulator, which is dropped before them.
        #[allow(unsafe_code)]
        uc(unsafe { cpu.mem_map_ptr(u64::from(start), u64::from(size), access, memory.pointer()) })?;
    }
    map_registers(&mut cpu)?;
    map_system_memory(&mut cpu)?;
    forbid_code_in_ram(&mut cpu)?;
    // No exit addresses: clearing one up after each run would cost more than most runs.
    uc(cpu.ctl_exits_enable())?;
    let shared = Rc::new(RefCell::new(Code::new(code)));
    count_blocks(&mut cpu, shared.clone())?;
    let hooks = sleep_and_wake(&mut cpu, code, 0)?;
    shared.borrow_mut().hooks = hooks;
    // An address that nothing answers: the fault's registers tell it.
    uc(cpu.add_mem_hook(HookType::MEM_UNMAPPED, 1, 0, |c, _, address, _, _| {
        c.get_data_mut().bad_address = address as u32;
        false
    }))?;
    uc(cpu.add_intr_hook(|c, number| {
        let chip = c.get_data_mut();
        if number == 8 {
            chip.returning = true;
        } else {
            chip.error.get_or_insert(format!("the firmware raised CPU exception {number}"));
        }
        let _ = c.emu_stop();
    }))?;
    Ok((cpu, shared))
}

/// The maker's codes in the system memory.
fn map_system_memory(cpu: &mut Cpu<'_>) -> Result<(), RunError> {
    uc(cpu.mem_map(u64::from(FACTORY_AT & !0xFFF), 0x1000, Prot::READ))?;
    let bytes: Vec<u8> = FACTORY.iter().flat_map(|code| code.to_le_bytes()).collect();
    uc(cpu.mem_write(u64::from(FACTORY_AT), &bytes))
}

/// Peripherals and the core's own registers.
fn map_registers(cpu: &mut Cpu<'_>) -> Result<(), RunError> {
    for (base, size) in [(0x4000_0000u64, 0x8_0000u64), (0xE000_0000, 0x10_0000)] {
        uc(cpu.mmio_map(
            base,
            size,
            Some(move |c: &mut Cpu<'_>, offset: u64, size: usize| {
                let address = (base + offset) as u32;
                let chip = c.get_data_mut();
                chip.it_stale = true;
                let value = chip.load(address & !3);
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
                chip.it_stale = true;
                // Registers are written whole, but for byte-wide interrupt priorities and half-words
                // written to a register's lower half.
                chip.store(address, value as u32, size);
            }),
        ))?;
    }
    Ok(())
}

fn forbid_code_in_ram(cpu: &mut Cpu<'_>) -> Result<(), RunError> {
    // Unicorn takes RAM for executable and then checks every store for code that it overwrites, which costs a third of the
    // speed. Code runs from flash only; Unicorn is told so.
    uc(cpu.ctl_set_tlb_type(TlbType::VIRTUAL))?;
    uc(cpu.add_tlb_hook(0, u64::MAX, |c, address, _| {
        c.get_data_mut().it_stale = true;
        let perms = match address as u32 {
            FLASH_START..=FLASH_END => Prot::ALL,
            // Address 0 shows the chip's flash. Nothing runs there.
            0..FLASH_SIZE => Prot::READ,
            _ => Prot::READ | Prot::WRITE,
        };
        Some(TlbEntry { paddr: address, perms })
    }))?;
    Ok(())
}

/// The code in flash as the emulator has it, to look at where it is: it follows the flash at each restart ([`Code::follow`]), for a program that
/// writes another one does not run it before.
pub struct Code {
    bytes: Vec<u8>,
    /// Size and number of instructions of the block that begins at each half-word.
    blocks: Vec<(u16, u16)>,
    /// Hooks of instructions that the emulator must not see, with their offsets.
    hooks: Vec<(usize, UcHookId)>,
}

/// The same for the hooks.
pub type SharedCode = Rc<RefCell<Code>>;

impl Code {
    fn new(bytes: &[u8]) -> Self {
        let mut bytes = bytes.to_vec();
        bytes.resize(FLASH_SIZE as usize, 0xFF);
        Self { bytes, blocks: vec![(0, 0); FLASH_SIZE as usize / 2], hooks: Vec::new() }
    }

    /// Takes what is in a sector of the flash now.
    pub fn follow(code: &SharedCode, cpu: &mut Cpu<'_>, range: Range<usize>, now: &[u8]) -> Result<(), RunError> {
        if code.borrow().bytes.get(range.clone()) == Some(now) {
            return Ok(());
        }
        let old: Vec<(usize, UcHookId)> = {
            let code = &mut *code.borrow_mut();
            code.bytes[range.clone()].copy_from_slice(now);
            code.blocks[range.start / 2..range.end / 2].fill((0, 0));
            let (old, others) = code.hooks.drain(..).partition(|(at, _)| range.contains(at));
            code.hooks = others;
            old
        };
        for (_, hook) in old {
            uc(cpu.remove_hook(hook))?;
        }
        uc(cpu
            .ctl_remove_cache(u64::from(FLASH_START) + range.start as u64, u64::from(FLASH_START) + range.end as u64))?;
        let hooks = sleep_and_wake(cpu, now, range.start)?;
        code.borrow_mut().hooks.extend(hooks);
        Ok(())
    }
}

/// Counts instructions, and stops where something is due.
fn count_blocks(cpu: &mut Cpu<'_>, code: SharedCode) -> Result<(), RunError> {
    uc(cpu.add_block_hook(u64::from(FLASH_START), u64::from(FLASH_START + FLASH_SIZE), move |c, address, size| {
        let Code { bytes: code, blocks, .. } = &mut *code.borrow_mut();
        let at = (address as usize - FLASH_START as usize) / 2;
        let mut block = blocks[at];
        if u32::from(block.0) != size {
            let n = thumb::instructions(&code[at * 2..at * 2 + size as usize]);
            block = (size as u16, u16::from(n));
            blocks[at] = block;
        }
        let n = u64::from(block.1);
        if std::mem::take(&mut c.get_data_mut().it_stale) {
            // Filling the TLB, or an access to a register, within an IT block leaves that block's state behind, and the next
            // instructions would be taken for conditional ones.
            let in_state = c.reg_read(RegisterARM::XPSR).is_ok_and(|x| x & IT_STATE != 0);
            if in_state && !thumb::within_it(code, at * 2) {
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
            let primask = c.reg_read(RegisterARM::PRIMASK).is_ok_and(|p| p & 1 != 0);
            let chip = c.get_data_mut();
            let now = chip.moment();
            if let Some(profile) = &mut chip.profile {
                profile.begin(at, n, now.estimate);
            }
            if let Some(estimate) = &mut chip.estimate {
                let flash = Accelerator::from_acr(chip.flash.acr());
                estimate.block(address as u32, size, code, flash);
            }
            chip.masked_stretch.block(address as u32, now, primask);
            let ready = chip.ready;
            chip.probes.iter_mut().for_each(|p| p.block(address as u32, now, ready, || link));
        }
        let chip = c.get_data_mut();
        chip.block = address as u32;
        chip.pass(n);
        chip.instructions += n;
    }))?;
    Ok(())
}

/// WFE, SEV, and the breakpoint of semihosting, in a piece of flash from an offset on: gives the hooks.
fn sleep_and_wake(cpu: &mut Cpu<'_>, flash: &[u8], from: usize) -> Result<Vec<(usize, UcHookId)>, RunError> {
    let mut hooks = Vec::new();
    // They are found by their encodings.
    for at in (0..flash.len() - 1).step_by(2) {
        let address = u64::from(FLASH_START) + (from + at) as u64;
        let hook = match (flash[at], flash[at + 1]) {
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
                }))?
            }
            (0xAB, 0xBE) => uc(cpu.add_code_hook(address, address, |c, address, _| {
                let call = [RegisterARM::R0, RegisterARM::R1].map(|r| c.reg_read(r).unwrap_or(0) as u32);
                let _ = c.reg_write(RegisterARM::PC, (address + 2) | 1);
                c.get_data_mut().call = Some((call[0], call[1]));
                let _ = c.emu_stop();
            }))?,
            (0x40, 0xBF) => uc(cpu.add_code_hook(address, address, |c, _, _| c.get_data_mut().event = true))?,
            _ => continue,
        };
        hooks.push((from + at, hook));
    }
    Ok(hooks)
}
