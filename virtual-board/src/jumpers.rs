//! A bare board with jumpers: wires from pins to pins of the same chip, and the peripherals that the unit leaves free, which make there what the
//! unit else gets from outside: square waves (`pwm`), an SPI slave, a second UART. And the processor's own cycle counter.
//!
//! A signal passes a jumper only if both of its ends are set for it (`judge`). As soon as there is a jumper, there is nothing else on the
//! wires: no ADC, and nobody at the link.

use crate::board::Board;
use crate::chip::Chip;
use crate::dma::Request;
use crate::error::RunError;
use crate::pwm::{Wave, KINDS};
use crate::serial::{Spi, Usart, LINE_BAUD};
use crate::signals::{FIRST_JUMPER, JUMPERS};
use crate::spare::{Jumper, DEMCR};
use crate::tables::Pin;
use crate::World;

const SPI2: u32 = 0x4000_3800;
const UART5: u32 = 0x4000_5000;
const DWT: u32 = 0xE000_1000;

impl Chip {
    /// Cycles of the processor: what its clock has ticked, asleep or not; where cycles are estimated, its waiting comes on top, which moves no time.
    pub fn processor_cycles(&self) -> u64 {
        let (before, since) = self.spare.cycles;
        before + self.pace.ticks_in(self.now - since) + self.stalls()
    }

    fn stalls(&self) -> u64 {
        let instructions = self.instructions - self.estimated_from;
        self.estimate.as_ref().map_or(0, |e| e.cycles().total().saturating_sub(instructions))
    }

    /// The processor's clock is another one from now on.
    pub fn recount(&mut self, cycles: u64) {
        self.spare.cycles = (cycles - self.stalls(), self.now);
    }

    fn counter(&mut self) -> u32 {
        let c = &self.spare.counter;
        if c.control & 1 == 0 {
            return c.held;
        }
        let count = self.processor_cycles().wrapping_add(c.offset) as u32;
        if self.dbgmcu & 1 == 0 {
            self.mismatch(|| {
                "DWT_CYCCNT stands still while the processor sleeps: DBGMCU_CR.DBG_SLEEP is 0 (RM0390 section 33.16.1)"
                    .into()
            });
        }
        count
    }

    fn counter_on(&mut self) -> bool {
        let on = self.spare.counter.demcr & 1 << 24 != 0;
        if !on {
            self.mismatch(|| "DWT is off: DEMCR.TRCENA is 0 (ARMv7-M reference manual, section C1.6.5)".into());
        }
        on
    }

    /// A register of what the unit leaves free.
    pub fn read_spare(&mut self, address: u32) -> Option<u32> {
        let word = ((address & 0x3FF) / 4) as usize;
        let now = self.now;
        match address & !0x3FF {
            SPI2 => self.spare.spi2.read(word),
            UART5 => self.spare.uart5.read(word),
            DWT if self.counter_on() => match word {
                // Four comparators, as the STM32F4 has them.
                0 => Some(self.spare.counter.control & 1 | 4 << 28),
                1 => Some(self.counter()),
                _ => None,
            },
            DWT => Some(0),
            _ if address & !3 == DEMCR => Some(self.spare.counter.demcr),
            base => self.spare.waves.iter().find(|w| w.kind.base == base)?.read(word, now),
        }
    }

    /// The same for a write.
    pub fn write_spare(&mut self, address: u32, value: u32) -> Option<()> {
        let word = ((address & 0x3FF) / 4) as usize;
        let now = self.now;
        match address & !0x3FF {
            SPI2 => self.spare.spi2.write(word, value),
            UART5 => {
                // CR1: its interrupts are not modelled.
                (word != 3 || value & 0x1F0 == 0).then_some(())?;
                self.spare.uart5.write(word, value)
            }
            DWT if self.counter_on() => {
                let cycles = self.processor_cycles();
                let count = self.counter();
                let c = &mut self.spare.counter;
                match word {
                    0 => {
                        c.held = count;
                        c.offset = u64::from(c.held).wrapping_sub(cycles);
                        c.control = value;
                        // Nothing but the cycle counter.
                        (value & 0x01FF_F000 == 0).then_some(())?;
                    }
                    1 => {
                        c.held = value;
                        c.offset = u64::from(value).wrapping_sub(cycles);
                    }
                    _ => return None,
                }
                Some(())
            }
            DWT => Some(()),
            _ if address & !3 == DEMCR => {
                self.spare.counter.demcr = value;
                Some(())
            }
            base => {
                let wave = self.spare.waves.iter_mut().find(|w| w.kind.base == base)?;
                let done = wave.write(word, value, now);
                let (name, strange) = (wave.kind.name, wave.strange());
                if let Some(what) = strange {
                    self.mismatch(|| format!("{name}_{what} (RM0390 sections 16.4, 17.4 and 18.4)"));
                }
                done
            }
        }
    }

    /// Those whose reset is asked for are as at power-on.
    pub fn reset_spare(&mut self) {
        let part = self.part;
        let asked =
            |chip: &Self, address: u32| part.gate(address).and_then(|g| g.reset).is_some_and(|bit| chip.rcc.bit(bit));
        for (k, kind) in KINDS.iter().enumerate() {
            if asked(self, kind.base) {
                self.spare.waves[k] = Wave::new(kind);
                self.spare.waves[k].set_clock(&self.clocks, self.now);
            }
        }
        if asked(self, SPI2) {
            self.spare.spi2 = Spi::default();
        }
        if asked(self, UART5) {
            self.spare.uart5 = Usart::default();
        }
    }

    /// `true` if a pin is set to a signal, at one end of a jumper; if not, the run ends.
    fn carries_at(&mut self, slot: usize, pin: Pin, name: &str, drives: bool) -> bool {
        if let Some(known) = self.carried[slot] {
            return known;
        }
        let fault = self.end_fault(pin, name, name, drives);
        self.carried[slot] = Some(fault.is_none());
        let good = fault.is_none();
        if let Some(what) = fault {
            self.mismatch(|| what);
        }
        good
    }

    /// The jumper that comes from a pin which can have a signal, of those that lead where it is asked for; whether it carries that signal.
    fn comes(&mut self, name: &str, to: impl Fn(Pin) -> bool) -> Option<Pin> {
        let part = self.part;
        let can = |j: &Jumper| to(j.to) && part.tables.function(j.from, name).is_some();
        let k = self.spare.jumpers.iter().position(can)?;
        let Jumper { from, to } = self.spare.jumpers[k];
        self.carries_at(FIRST_JUMPER + 2 * k, from, name, true).then_some(to)
    }

    /// Pin to which a jumper leads the signal of a pin, if that pin can receive it as the signal of this name.
    fn goes(&mut self, from: Pin, name: &str) -> Option<Pin> {
        let part = self.part;
        let can = |j: &Jumper| j.from == from && part.tables.function(j.to, name).is_some();
        let k = self.spare.jumpers.iter().position(can)?;
        let to = self.spare.jumpers[k].to;
        self.carries_at(FIRST_JUMPER + 2 * k + 1, to, name, false).then_some(to)
    }

    /// A port's outputs may have changed: what is at the other ends of their jumpers.
    pub fn spread(&mut self, port: usize) {
        for k in 0..self.spare.jumpers.len() {
            let Jumper { from, to } = self.spare.jumpers[k];
            if from.0 == port && self.ports[port].is_output(from.1) {
                let high = self.ports[port].driven(from.1);
                self.arrive(to, high);
            }
        }
    }

    /// A level arrives at a pin.
    fn arrive(&mut self, pin: Pin, high: bool) {
        if self.ports[pin.0].drive(pin.1, high) && self.syscfg.port_of(pin.1) == pin.0 {
            self.exti.edge(pin.1, high);
            self.update_lines();
            self.attention = true;
        }
    }

    /// UART5 begins to send, if it has something to send.
    pub fn start_spare(&mut self) {
        if self.spare.uart5_done == u64::MAX && self.spare.uart5.transmitting() {
            if let Some((c, n)) = self.serving(Request::Uart5Tx) {
                let time = self.spare.uart5.time_per_byte(self.clocks.pclk1);
                self.spare.uart5_done = self.now + u64::from(self.dma[c].streams[n].ndtr) * time;
            }
        }
    }

    /// `true` if UART5 uses the format of the link, out or in.
    fn uart5_works(&mut self, out: bool) -> bool {
        let baud = self.spare.uart5.baud(self.clocks.pclk1);
        if let Some(what) = self.spare.uart5.unfit(out) {
            self.mismatch(|| format!("UART5_{what}"));
            return false;
        }
        if (baud / LINE_BAUD - 1.0).abs() > 0.02 {
            self.mismatch(|| {
                format!("UART5_BRR makes {baud:.0} baud of PCLK1, and the link has {LINE_BAUD:.0}: framing errors (RM0390 section 25.4.5)")
            });
            return false;
        }
        self.awake(UART5, "no bit moves")
    }
}

impl<W: World> Board<W> {
    /// Puts jumpers on the board, and takes everything else off its wires.
    ///
    /// # Errors
    /// More than there is room for.
    pub fn join(&mut self, jumpers: &[Jumper]) -> Result<(), RunError> {
        if jumpers.len() > JUMPERS {
            return Err(RunError::Elf(format!("{} jumpers are more than {JUMPERS}", jumpers.len())));
        }
        self.cpu.get_data_mut().spare.jumpers = jumpers.to_vec();
        Ok(())
    }

    /// Handles the next event of what the unit leaves free.
    pub(crate) fn spare_event(&mut self) -> Result<(), RunError> {
        let spare = &mut self.cpu.get_data_mut().spare;
        let at = spare.next_event();
        if spare.uart5_done == at {
            return self.finish_uart5();
        }
        let Some(wave) = spare.waves.iter_mut().find(|w| w.next_event() == at) else { return Ok(()) };
        let signals = wave.kind.signals;
        for (channel, high) in wave.advance().into_iter().flatten() {
            let chip = self.cpu.get_data_mut();
            if let Some(to) = chip.comes(signals[channel], |_| true) {
                chip.arrive(to, high);
                self.level(to, high, at)?;
            }
        }
        Ok(())
    }

    /// The level at a pin that the unit listens to changes.
    fn level(&mut self, pin: Pin, high: bool, at: u64) -> Result<(), RunError> {
        let wiring = &self.cpu.get_data().part.wiring;
        if let Some(channel) = wiring.resonators.iter().position(|p| *p == pin) {
            if high {
                self.resonator_edge(channel, at)?;
            }
        } else if pin == wiring.data_ready {
            if !high {
                self.data_ready(at)?;
            }
        } else if pin == wiring.pulse && high {
            self.pulse_edge(at);
        }
        Ok(())
    }

    /// Bytes that come back to SPI1 for bytes that it sends.
    pub(crate) fn slave(&mut self, sent: &[u8]) -> Result<Vec<u8>, RunError> {
        let chip = self.cpu.get_data_mut();
        let wiring = &chip.part.wiring;
        // No driver at MISO: its pull decides.
        let Pin(port, pin) = wiring.from_adc;
        let mut back = vec![if chip.ports[port].pull(pin) == 1 { 0xFF } else { 0 }; sent.len()];
        if chip.bus_dead || !chip.spare.spi2.on() || !chip.awake(SPI2, "no bit moves") {
            return Ok(back);
        }
        let clocked = chip.goes(wiring.clock, "SPI2_SCK").is_some();
        let selected = chip.goes(wiring.select, "SPI2_NSS").is_some_and(|p| !chip.ports[p.0].receives(p.1));
        if !clocked || !selected {
            return Ok(back);
        }
        let (hz, pclk1) = (chip.spi1.hz(chip.clocks.pclk2), chip.clocks.pclk1);
        if let Some(what) = chip.spare.spi2.unfit_as_slave(&chip.spi1, hz, pclk1) {
            chip.mismatch(|| format!("SPI2_{what}"));
            return Ok(back);
        }
        let listens = chip.goes(wiring.to_adc, "SPI2_MOSI");
        let answers = chip.comes("SPI2_MISO", |to| to == wiring.from_adc).is_some();
        let (Some(rx), Some(tx)) = (chip.serving(Request::Spi2Rx), chip.serving(Request::Spi2Tx)) else {
            chip.mismatch(|| {
                "SPI2 is selected and has nothing to send: no stream serves it (RM0390 section 26.3.9)".into()
            });
            return Ok(back);
        };
        let stream = |chip: &Self, (c, n): (usize, usize)| {
            let s = &chip.cpu.get_data().dma[c].streams[n];
            (s.memory(), s.ndtr.min(sent.len() as u32))
        };
        let ((to, taken), (from, given)) = (stream(self, rx), stream(self, tx));
        let mut bytes = vec![0; given as usize];
        let done = self.get(from, &mut bytes);
        self.moved_by_dma(tx, done)?;
        if answers {
            // Bytes that it has not got are not sent: the line stays.
            bytes.iter().zip(&mut back).for_each(|(b, to)| *to = *b);
        }
        let received = if listens.is_some() { sent.to_vec() } else { vec![0; sent.len()] };
        let chip = self.cpu.get_data_mut();
        chip.moved(rx, taken);
        chip.moved(tx, given);
        let done = self.put(to, &received[..taken as usize]);
        self.moved_by_dma(rx, done)?;
        Ok(back)
    }

    /// Passes the bytes of USART1 to UART5, if a jumper leads there.
    pub(crate) fn reach_uart5(&mut self, bytes: &[u8]) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        let from = chip.part.wiring.link_out;
        if !chip.spare.uart5.receiving() || chip.goes(from, "UART5_RX").is_none() || !chip.uart5_works(false) {
            return Ok(());
        }
        for byte in bytes {
            let chip = self.cpu.get_data_mut();
            if !chip.spare.uart5.receives_by_dma() {
                chip.spare.uart5.received_by_hand(*byte);
                continue;
            }
            let Some(rx) = chip.serving(Request::Uart5Rx) else { continue };
            let to = chip.dma[rx.0].streams[rx.1].memory();
            chip.moved(rx, 1);
            let done = self.put(to, &[*byte]);
            self.moved_by_dma(rx, done)?;
        }
        Ok(())
    }

    /// Passes the bytes of UART5 to USART1.
    fn finish_uart5(&mut self) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        chip.spare.uart5_done = u64::MAX;
        let Some(tx) = chip.stream(Request::Uart5Tx) else { return Ok(()) };
        let s = &chip.dma[tx.0].streams[tx.1];
        let (from, n) = (s.memory(), s.ndtr);
        chip.moved(tx, n);
        chip.spare.uart5.transmitted();
        let (now, to) = (chip.now, chip.part.wiring.link_in);
        let passes = chip.uart5_works(true) && chip.comes("UART5_TX", |pin| pin == to).is_some();
        let mut bytes = vec![0; n as usize];
        let done = self.get(from, &mut bytes);
        self.moved_by_dma(tx, done)?;
        if passes {
            for byte in bytes {
                self.take_byte(now, byte, None)?;
            }
        }
        Ok(())
    }
}
