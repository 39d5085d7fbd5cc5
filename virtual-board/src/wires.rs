//! Traffic on the wires: captured edges, ADC frames over SPI, bytes of the link.

use crate::board::Board;
use crate::dma::Request;
use crate::error::RunError;
use crate::nvic::irq;
use crate::probe::Moment;
use crate::signals::Signal;
use crate::timer::Captured;
use crate::{AdcMishap, World, CPU_HZ};

impl<W: World> Board<W> {
    pub(crate) fn edge(&mut self, channel: usize) -> Result<(), RunError> {
        self.resonator_edge(channel, self.wires.next_edge[channel])?;
        self.wires.next_edge[channel] = self.world.next_edge(channel).unwrap_or(u64::MAX);
        Ok(())
    }

    /// A rising edge at the input of a resonator.
    pub(crate) fn resonator_edge(&mut self, channel: usize, at: u64) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        if chip.captures(Signal::Capture(channel), true) {
            let captured = chip.tim2.edge(channel, at);
            self.capture_dma(channel, captured)?;
            self.world.captured(channel, captured.stamp);
        }
        Ok(())
    }

    /// The DMA that a capture of TIM2 asks for.
    fn capture_dma(&mut self, channel: usize, captured: Captured) -> Result<(), RunError> {
        if !captured.dma {
            return Ok(());
        }
        let chip = self.cpu.get_data_mut();
        if captured.interrupt {
            chip.nvic.pulse(irq::TIM2);
            chip.attention = true;
        }
        let Some(stream) = chip.serving(Request::Tim2(channel)) else { return Ok(()) };
        let to = chip.dma[stream.0].streams[stream.1].memory();
        chip.moved(stream, 1);
        let done = self.put(to, &captured.stamp.to_le_bytes());
        self.moved_by_dma(stream, done)
    }

    pub(crate) fn pulse(&mut self) {
        self.pulse_edge(self.wires.next_pulse);
        self.wires.next_pulse = self.world.next_pulse().unwrap_or(u64::MAX);
    }

    /// A rising edge at the input of the pulses per second.
    pub(crate) fn pulse_edge(&mut self, at: u64) {
        let chip = self.cpu.get_data_mut();
        if chip.captures(Signal::Pulse, true) {
            let stamp = chip.tim3.edge(0, at).stamp;
            // As TIM2 counts: the two run on the same clock.
            let apart = chip.tim2.count(at).wrapping_sub(stamp);
            let stamp = stamp.wrapping_add(apart);
            self.world.pulsed(stamp);
        }
    }

    pub(crate) fn sample(&mut self) -> Result<(), RunError> {
        let at = self.wires.next_sample;
        self.wires.next_sample = at + self.cpu.get_data().adc.period(CPU_HZ).max(1);
        if let Some(ambient) = self.world.ambient(at) {
            self.set_ambient(ambient);
        }
        let Some(codes) = self.world.convert(at) else {
            return Ok(());
        };
        self.wires.invalid = self.world.invalidate_adc_frame();
        let mishap = self.world.adc_mishap(at);
        let chip = self.cpu.get_data_mut();
        match mishap {
            None => {}
            Some(AdcMishap::LosesSettings) => chip.adc.lose_settings(),
            Some(AdcMishap::Flips(register, bit)) => chip.adc.flip(register, bit),
            Some(AdcMishap::SlipsAByte) => chip.slipped += 1,
        }
        if chip.adc.held() {
            return Ok(());
        }
        chip.corrupt = self.wires.invalid;
        chip.adc.convert(codes);
        if !chip.adc.drives_data_ready() {
            return Ok(());
        }
        self.data_ready(at)
    }

    /// Data-ready falls, at channel 4 of TIM2.
    pub(crate) fn data_ready(&mut self, at: u64) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        chip.ready = Moment { cycles: at.min(chip.now), ..chip.moment() };
        if chip.captures(Signal::Capture(3), false) {
            let captured = chip.tim2.edge(3, at);
            self.wires.ready_stamp = captured.stamp;
            self.capture_dma(3, captured)?;
        }
        Ok(())
    }

    pub(crate) fn finish_spi(&mut self) -> Result<(), RunError> {
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
        self.moved_by_dma(tx, done)?;
        if !self.cpu.get_data().spare.jumpers.is_empty() {
            bytes = self.slave(&bytes)?;
        }
        let chip = self.cpu.get_data_mut();
        if chip.spare.jumpers.is_empty() {
            for b in &mut bytes {
                *b = if chip.bus_dead { 0 } else { chip.adc.exchange(*b) };
            }
        }
        // A byte too many in the receiver puts all that follow it off by one, until the SPI is reset.
        for _ in 0..chip.slipped {
            bytes.rotate_right(1);
            if let Some(first) = bytes.first_mut() {
                std::mem::swap(first, &mut chip.left_over);
            }
        }
        chip.moved(rx, n);
        chip.moved(tx, n);
        let done = self.put(to, &bytes);
        self.moved_by_dma(rx, done)?;
        self.wires.fetch_stamp = stamp;
        if n == 30 {
            self.world.fetched(self.wires.fetch_stamp, &bytes);
        }
        Ok(())
    }

    pub(crate) fn finish_usart(&mut self) -> Result<(), RunError> {
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
        self.moved_by_dma(tx, done)?;
        if !self.cpu.get_data().line_dead {
            self.world.link_out(now, &bytes);
            self.reach_uart5(&bytes)?;
        }
        Ok(())
    }

    pub(crate) fn receive(&mut self, at: u64, byte: u8) -> Result<(), RunError> {
        self.wires.next_byte = self.world.next_link_byte();
        let fault = self.world.line_fault(at);
        self.take_byte(at, byte, self.wires.next_byte.map(|(t, _)| t))?;
        let usart = &mut self.cpu.get_data_mut().usart1;
        if let Some(fault) = fault.filter(|_| usart.receiving()) {
            usart.fault(fault);
        }
        Ok(())
    }

    /// A byte comes in at the link, and the next one at a time that is known, or not.
    pub(crate) fn take_byte(&mut self, at: u64, byte: u8, next: Option<u64>) -> Result<(), RunError> {
        let chip = self.cpu.get_data_mut();
        if !chip.usart1.receiving() {
            return Ok(());
        }
        if !chip.line_works(false) {
            return Ok(());
        }
        let idle_after = at + chip.usart1.time_per_byte(chip.clocks.pclk2);
        self.wires.link_idle = if next.is_some_and(|t| t <= idle_after) { u64::MAX } else { idle_after };
        match chip.usart1.receives_by_dma().then(|| chip.serving(Request::Usart1Rx)).flatten() {
            Some(rx) => {
                let to = chip.dma[rx.0].streams[rx.1].memory();
                chip.usart1.taken_by_dma();
                chip.moved(rx, 1);
                let done = self.put(to, &[byte]);
                self.moved_by_dma(rx, done)?;
            }
            None => chip.usart1.received_by_hand(byte),
        }
        Ok(())
    }
}
