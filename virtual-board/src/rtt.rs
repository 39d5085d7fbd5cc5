//! The debug probe: reads the firmware's log out of RAM, as SEGGER's RTT lays it down.

use crate::board::Board;
use crate::error::RunError;
use crate::World;

impl<W: World> Board<W> {
    /// Takes what is in up channel 0, and gives it to the world. The board does so each 10 ms; after the end of a program, do it once more.
    ///
    /// # Errors
    /// If the block of the log is outside memory, or the debug port's pins are another's.
    pub fn look_at_rtt(&mut self) -> Result<(), RunError> {
        let Some(block) = self.firmware.rtt() else { return Ok(()) };
        if !self.cpu.get_data().probe_connected() {
            let what = "PA13 or PA14 is not the debug port's any more: GPIOA_MODER or AFRH; no probe reads the log (RM0390 section 33.4)";
            self.cpu.get_data_mut().mismatch(|| what.into());
            return Ok(());
        }
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
}
