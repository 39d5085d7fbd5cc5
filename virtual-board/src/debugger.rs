//! The debugger's side of semihosting (Arm, "Semihosting for AArch32 and AArch64"), as far as a test program needs it: its command line, and its end.

use crate::board::Board;
use crate::error::{RunError, Stop};
use crate::World;
use unicorn_engine::RegisterARM;

const SYS_GET_CMDLINE: u32 = 0x15;
const SYS_EXIT: u32 = 0x18;
const SYS_EXIT_EXTENDED: u32 = 0x20;
/// The reason of an orderly end.
const APPLICATION_EXIT: u32 = 0x2_0026;

impl<W: World> Board<W> {
    /// A debugger is attached that answers semihosting, and gives the program this command line. Without one, a call of the program is a fault.
    pub fn attach_debugger(&mut self, command_line: &str) {
        self.command_line = Some(command_line.into());
    }

    /// Answers a call of the program: its number, and its parameter. A call that ends the program ends the run.
    pub(crate) fn answer(&mut self, (call, parameter): (u32, u32)) -> Result<Option<Stop>, RunError> {
        let Some(line) = &self.command_line else {
            return Err(RunError::NotModelled {
                what: "BKPT 0xAB asks a debugger, and none is attached: the chip takes a HardFault (ARMv7-M reference manual, section C1.6.3)".into(),
                pc: self.pc(),
            });
        };
        match call {
            SYS_GET_CMDLINE => {
                let [buffer, room] = self.words(parameter)?;
                let text = [line.as_bytes(), &[0]].concat();
                let fits = text.len() <= room as usize;
                if fits {
                    let length = (text.len() - 1) as u32;
                    self.put(buffer, &text)?;
                    self.put(parameter + 4, &length.to_le_bytes())?;
                }
                let result = if fits { 0 } else { u32::MAX };
                crate::cpu::uc(self.cpu.reg_write(RegisterARM::R0, u64::from(result)))?;
                Ok(None)
            }
            SYS_EXIT => Ok(Some(Stop::Exit(u32::from(parameter != APPLICATION_EXIT)))),
            SYS_EXIT_EXTENDED => {
                let [reason, code] = self.words(parameter)?;
                Ok(Some(Stop::Exit(if reason == APPLICATION_EXIT { code } else { code.max(1) })))
            }
            other => Err(RunError::NotModelled { what: format!("semihosting call {other:#x}"), pc: self.pc() }),
        }
    }

    /// Two words of memory.
    fn words(&self, address: u32) -> Result<[u32; 2], RunError> {
        let mut bytes = [0; 8];
        self.get(address, &mut bytes)?;
        let [a, b, c, d, e, f, g, h] = bytes;
        Ok([u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])])
    }
}
