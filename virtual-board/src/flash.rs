//! Programming and erasing of the flash while the firmware runs, and what a power cut leaves of either.

use crate::board::Board;
use crate::cpu::uc;
use crate::error::RunError;
use crate::system::SECTORS;
use crate::{World, CPU_HZ, FLASH_SIZE, FLASH_START};
use unicorn_engine::{HookType, Prot};

/// Erase of a sector at its slowest, ms, by its size (KiB) and PSIZE (STM32F446 data sheet, table 47: x8, x16, x32; x64 needs a voltage that
/// the board does not have).
const ERASE_MS: [(u32, [u64; 3]); 3] = [(16, [800, 600, 500]), (64, [2400, 1400, 1100]), (128, [4000, 2600, 2000])];

impl<W: World> Board<W> {
    /// Counts a flash operation; whether it is the one that is cut short.
    pub(crate) fn operate(&mut self) -> bool {
        self.flash_operations += 1;
        let cut = self.flash_operations == self.stop_at_operation;
        if cut {
            self.stop_at_operation = u64::MAX;
            self.torn = true;
        }
        cut
    }

    /// While the flash is unlocked, writes to it are let through and watched. (Watching slows every store of
    /// the CPU down, so it is not done all the time; a write while locked is a fault of the CPU.)
    pub(crate) fn open_or_close_flash(&mut self) -> Result<(), RunError> {
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
            |c, _, address, size, _| {
                let word = address & !3;
                let mut old = [0; 4];
                let _ = c.mem_read(word, &mut old);
                let chip = c.get_data_mut();
                chip.flash_writes.push((word as u32, old, size));
                chip.attention = true;
                true
            },
        );
        self.flash_watch = Some(uc(hook)?);
        Ok(())
    }

    pub(crate) fn judge_flash_writes(&mut self) -> Result<(), RunError> {
        let writes = std::mem::take(&mut self.cpu.get_data_mut().flash_writes);
        for (address, old, size) in writes {
            let flash = &mut self.cpu.get_data_mut().flash;
            // A write of another width than PSIZE says is not done (RM0390 section 3.4.2, PGPERR).
            let wrong_width = flash.programming() && size != 1 << flash.width();
            if wrong_width {
                flash.refuse_width();
            }
            let protected = flash.programming() && flash.protects(address - FLASH_START);
            let programming = flash.programming() && !wrong_width && !protected && !self.worn_out;
            let mut new = [0; 4];
            self.get(address, &mut new)?;
            // Cut short, some of the bits that were to become zero have not.
            let short = if programming && self.operate() { Mask::new(self.flash_operations).next() as u32 } else { 0 };
            let kept = old.iter().zip(new).zip(short.to_le_bytes());
            let kept: Vec<u8> = kept.map(|((o, n), s)| if programming { o & (n | s) } else { *o }).collect();
            self.put(address, &kept)?;
            if !programming && !wrong_width && !protected && !self.worn_out {
                self.cpu.get_data_mut().flash.refuse();
            }
        }
        Ok(())
    }

    /// Erases the sector that the firmware has asked for, if any.
    pub(crate) fn erase_sector(&mut self) -> Result<(), RunError> {
        let Some(sector) = self.cpu.get_data_mut().flash.erase.take() else { return Ok(()) };
        if SECTORS.get(sector).is_some_and(|from| self.cpu.get_data_mut().flash.protects(*from)) {
            return Ok(());
        }
        let mut times = None;
        if let (Some(&from), Some(&to)) = (SECTORS.get(sector), SECTORS.get(sector + 1)) {
            times = ERASE_MS.iter().find(|(kib, _)| kib * 1024 == to - from).map(|(_, ms)| ms);
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
        let slowest = times.and_then(|ms| ms.get(chip.flash.width()).copied());
        let ms = slowest.ok_or_else(|| RunError::NotModelled {
            what: "an erase with PSIZE x64 and no external voltage (RM0390 section 3.8.5)".into(),
            pc: 0,
        })?;
        chip.now += ms * (CPU_HZ / 1000);
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
