//! Exceptions: which is taken when, what is stacked on entry, and the way back.

use crate::board::Board;
use crate::cpu::uc;
use crate::error::RunError;
use crate::probe::Probe;
use crate::{World, FLASH_SIZE, FLASH_START};
use unicorn_engine::RegisterARM;

impl<W: World> Board<W> {
    /// Takes the pending interrupt of highest priority, if it may.
    pub(crate) fn interrupts(&mut self) -> Result<(), RunError> {
        if std::mem::take(&mut self.cpu.get_data_mut().nmi) {
            const NMI: u16 = 2;
            return self.enter_exception(NMI);
        }
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

    pub(crate) fn enter_exception(&mut self, exception: u16) -> Result<(), RunError> {
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
        self.judge_vectors(pc)?;
        self.get(vector_at, &mut vector)?;
        let cpu = &mut self.cpu;
        uc(cpu.reg_write(RegisterARM::SP, u64::from(frame_at)))?;
        uc(cpu.reg_write(RegisterARM::LR, if nested { 0xFFFF_FFE1 } else { 0xFFFF_FFE9 }))?;
        uc(cpu.reg_write(RegisterARM::XPSR, u64::from(0x0100_0000 | u32::from(exception))))?;
        uc(cpu.reg_write(RegisterARM::PC, u64::from(u32::from_le_bytes(vector))))?;
        let chip = cpu.get_data_mut();
        chip.probes.iter_mut().for_each(Probe::interrupt);
        if let Some(estimate) = &mut chip.estimate {
            estimate.enter(exception);
        }
        chip.nvic.enter(exception);
        chip.event = true;
        Ok(())
    }

    /// Looks at all vectors of a table before the first is taken: each that is not reserved is the address of Thumb code in flash.
    fn judge_vectors(&mut self, pc: u32) -> Result<(), RunError> {
        if std::mem::replace(&mut self.cpu.get_data_mut().nvic.vectors_judged, true) {
            return Ok(());
        }
        let chip = self.cpu.get_data();
        let table = chip.nvic.vtor().max(FLASH_START);
        let interrupts = chip.part.tables.interrupts.keys().max().map_or(0, |n| *n as u32 + 1);
        for exception in 1..16 + interrupts {
            let mut vector = [0; 4];
            self.get(table + 4 * exception, &mut vector)?;
            let vector = u32::from_le_bytes(vector);
            if vector != 0 && vector & 1 == 0 {
                let what =
                    format!("vector {exception} has no Thumb bit: a usage fault, INVSTATE (PM0214 section 2.3.4)");
                return Err(RunError::Cpu { what, pc });
            }
            if vector != 0 && !(FLASH_START..FLASH_START + FLASH_SIZE).contains(&vector) {
                let what =
                    format!("vector {exception} is {vector:#010x}, where there is no flash (PM0214 section 2.3.4)");
                return Err(RunError::Cpu { what, pc });
            }
        }
        Ok(())
    }

    pub(crate) fn leave_exception(&mut self) -> Result<(), RunError> {
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
        if let Some(estimate) = &mut chip.estimate {
            estimate.leave();
        }
        chip.nvic.leave();
        chip.event = true;
        chip.update_lines();
        Ok(())
    }
}
