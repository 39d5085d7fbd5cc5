//! Inputs from outside the chip, and actions of a test behind the firmware's back: crystal, supply, probe, flipped bits, registers.

use crate::board::Board;
use crate::error::RunError;
use crate::system::CSR_SOFTWARE;
use crate::{World, FLASH_START};

/// Offset of the flags of up channel 0 in the control block of RTT.
const RTT_FLAGS: u32 = 44;

impl<W: World> Board<W> {
    /// A bit of a peripheral's register changes. The peripheral then acts as after a write of that value.
    ///
    /// # Errors
    /// A register that is not modelled.
    pub fn flip_register(&mut self, address: u32, bit: u32) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        let value = chip.read(address);
        chip.write(address, value ^ 1 << (bit & 31), 4);
        match chip.error.take() {
            Some(what) => Err(RunError::NotModelled { what, pc: self.pc() }),
            None => Ok(()),
        }
    }

    /// Writes a register behind the firmware's back.
    ///
    /// # Errors
    /// A register that is not modelled, or a value that ends the run.
    pub fn write_register(&mut self, address: u32, value: u32) -> Result<(), RunError> {
        self.cpu.get_data_mut().write(address, value, 4);
        self.complain()
    }

    /// Reads a register behind the firmware's back: without the effects that reading has.
    ///
    /// # Errors
    /// A register that is not modelled.
    pub fn read_register(&self, address: u32) -> Result<u32, RunError> {
        let mut chip = self.cpu.get_data().clone();
        let value = chip.read(address);
        match chip.error {
            Some(what) => Err(RunError::NotModelled { what, pc: self.pc() }),
            None => Ok(value),
        }
    }

    /// Switches an interrupt off behind the firmware's back.
    pub fn disable_interrupt(&mut self, number: usize) {
        let register = 0xE000_E180 + 4 * (number as u32 / 32);
        let _ = self.cpu.get_data_mut().nvic.write(register, 1 << (number % 32), 4);
    }

    /// Switches it on again.
    pub fn enable_interrupt(&mut self, number: usize) {
        let register = 0xE000_E100 + 4 * (number as u32 / 32);
        let _ = self.cpu.get_data_mut().nvic.write(register, 1 << (number % 32), 4);
    }

    /// Something drives a pin (port 0 is A) to a level from now on.
    pub fn drive_pin(&mut self, port: usize, pin: usize, high: bool) {
        if let Some(port) = self.cpu.get_data_mut().ports.get_mut(port) {
            port.drive(pin, high);
        }
    }

    /// Another crystal: its frequency, Hz. Before the program looks at it.
    pub fn set_crystal(&mut self, hz: f64) {
        self.cpu.get_data_mut().rcc.crystal_hz = Some(hz);
    }

    /// Sets the start-up time of the crystal, in units of [`crate::CPU_HZ`]; 2 ms where no other is given.
    pub fn set_crystal_start(&mut self, time: u64) {
        self.cpu.get_data_mut().rcc.crystal_start = time;
    }

    /// The crystal stops, for good.
    pub fn stop_crystal(&mut self) {
        let chip = self.cpu.get_data_mut();
        if chip.rcc.crystal_stops() {
            chip.nmi = true;
            chip.follow_clocks();
        } else {
            chip.locked_up = true;
            chip.asleep = true;
        }
    }

    /// Sets the option bytes, as a programmer does: FLASH_OPTCR.
    pub fn set_options(&mut self, optcr: u32) {
        self.cpu.get_data_mut().flash.set_options(optcr);
    }

    /// The supply sags by so many tenths of a volt, or comes back.
    pub fn sag(&mut self, tenths: u32) {
        self.cpu.get_data_mut().pwr.sag_tenths = tenths;
    }

    /// A probe sets the log to wait where its buffer is full, as probe-rs does, and then reads no more.
    ///
    /// # Errors
    /// A firmware without a log.
    pub fn leave_probe_blocking(&mut self) -> Result<(), RunError> {
        let block = self.firmware.rtt().ok_or_else(|| RunError::Elf("the firmware has no log".into()))?;
        // Flags of up channel 0: the lowest two bits are its mode; 2 blocks (SEGGER, UM08001).
        let mut flags = [0; 4];
        self.get(block + RTT_FLAGS, &mut flags)?;
        flags[0] = flags[0] & !3 | 2;
        self.put(block + RTT_FLAGS, &flags)?;
        self.probe_gone = true;
        Ok(())
    }

    /// The resonators' wires come off.
    ///
    /// # Errors
    /// If an input floats then.
    pub fn unplug_resonators(&mut self) -> Result<(), RunError> {
        self.wires.next_edge = [u64::MAX; 3];
        match self.cpu.get_data().floating_input(0..3) {
            Some(what) => Err(RunError::NotModelled { what, pc: self.pc() }),
            None => Ok(()),
        }
    }

    /// Another LSI, which the watchdog runs on, Hz: 17 to 47 kHz.
    pub fn set_lsi(&mut self, hz: u64) {
        self.cpu.get_data_mut().iwdg.lsi_hz = hz;
    }

    /// Flips one bit of RAM or flash.
    ///
    /// # Errors
    /// If there is no memory.
    pub fn flip_bit(&mut self, address: u32, bit: u8) -> Result<(), RunError> {
        let mut byte = [0];
        self.read_memory(address, &mut byte)?;
        byte[0] ^= 1 << (bit & 7);
        self.put(address, &byte)
    }

    /// Writes to RAM, as a probe does.
    ///
    /// # Errors
    /// If there is none.
    pub fn write_ram(&mut self, address: u32, bytes: &[u8]) -> Result<(), RunError> {
        self.ram.write(address, bytes).ok_or_else(|| self.outside(address))
    }

    /// Sets the option byte WDG_SW to 0 and cuts the power: from now on the watchdog runs from every reset.
    ///
    /// # Errors
    /// As [`run_until`](Self::run_until).
    pub fn watch_from_reset(&mut self) -> Result<(), RunError> {
        self.hardware_watchdog = true;
        self.power_cut()
    }

    /// From now on a battery at VBAT carries what it carries.
    pub fn fit_battery(&mut self) {
        self.battery = true;
    }

    /// Takes down from now on when the sample mark rises.
    pub fn watch_marks(&mut self) {
        self.cpu.get_data_mut().mark_rises = Some(Vec::new());
    }

    /// The cycles at which it rose.
    #[must_use]
    pub fn marks(&self) -> &[u64] {
        self.cpu.get_data().mark_rises.as_deref().unwrap_or_default()
    }

    /// Samples that the ADC keeps because no frame has taken them.
    #[must_use]
    pub fn adc_backlog(&self) -> usize {
        self.cpu.get_data().adc.backlog()
    }

    /// Faults taken since then.
    #[must_use]
    pub fn faults(&self) -> u64 {
        self.mishaps
    }

    /// Reads memory.
    ///
    /// # Errors
    /// If there is none.
    pub fn read_memory(&self, address: u32, bytes: &mut [u8]) -> Result<(), RunError> {
        self.get(address, bytes)
    }

    /// Writes into flash from outside, as a programmer does: erased bits and all. `offset` from its start.
    ///
    /// # Errors
    /// Outside the flash.
    pub fn write_flash(&mut self, offset: u32, bytes: &[u8]) -> Result<(), RunError> {
        self.flash.write(FLASH_START + offset, bytes).ok_or(RunError::Flash(offset))
    }

    /// Cuts the power for so many cycles.
    ///
    /// # Errors
    /// As [`run_until`](Self::run_until).
    pub fn power_off(&mut self, cycles: u64) -> Result<(), RunError> {
        self.cpu.get_data_mut().now += cycles;
        self.power_cut()
    }

    /// Resets the processor as its own program does; RAM stays as it is.
    ///
    /// # Errors
    /// As [`run_until`](Self::run_until).
    pub fn reset_by_software(&mut self) -> Result<(), RunError> {
        // It has looked at the causes of earlier resets, and cleared them.
        self.cpu.get_data_mut().rcc.clear_causes();
        self.restart(CSR_SOFTWARE)
    }
}
