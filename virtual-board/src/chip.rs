//! The chip behind the CPU: which address belongs to which peripheral, the DMA controllers, interrupt lines.

use crate::ads131m08::Ads131m08;
use crate::cycles::Estimate;
use crate::gpio::{Exti, Port, Syscfg};
use crate::nvic::{irq, Nvic};
use crate::probe::{Moment, Probe};
use crate::serial::{Spi, Usart};
use crate::system::{Backup, CrystalCounter, Flash, Iwdg, ProgramCrc, Pwr, Rcc};
use crate::timer::Timer;

/// A DMA request that a peripheral makes, with the streams that can serve it (RM0390 tables 28 and 29):
/// controller (0 is DMA1), stream, channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    Tim2(usize),
    Spi1Rx,
    Spi1Tx,
    Usart1Rx,
    Usart1Tx,
}

impl Request {
    fn streams(self) -> &'static [(usize, usize, u32)] {
        match self {
            Self::Tim2(0) => &[(0, 5, 3)],
            Self::Tim2(1) => &[(0, 6, 3)],
            Self::Tim2(2) => &[(0, 1, 3)],
            Self::Tim2(_) => &[(0, 7, 3), (0, 6, 3)],
            Self::Spi1Rx => &[(1, 0, 3), (1, 2, 3)],
            Self::Spi1Tx => &[(1, 3, 3), (1, 5, 3)],
            Self::Usart1Rx => &[(1, 2, 4), (1, 5, 4)],
            Self::Usart1Tx => &[(1, 7, 4)],
        }
    }
}

/// One DMA stream.
#[derive(Debug, Default, Clone)]
pub struct Stream {
    cr: u32,
    pub ndtr: u32,
    par: u32,
    m0ar: u32,
    m1ar: u32,
    fcr: u32,
    reload: u32,
}

impl Stream {
    fn enabled(&self) -> bool {
        self.cr & 1 != 0
    }
    /// Where the next item goes or comes from in memory.
    pub fn memory(&self) -> u32 {
        if self.cr & (1 << 10) != 0 {
            self.m0ar.wrapping_add(self.reload.wrapping_sub(self.ndtr).wrapping_mul(1 << (self.cr >> 13 & 3)))
        } else {
            self.m0ar
        }
    }
}

const FLAG_AT: [u32; 4] = [0, 6, 16, 22];
const HALF: u32 = 1 << 4;
const COMPLETE: u32 = 1 << 5;

/// One DMA controller.
#[derive(Debug, Default, Clone)]
pub struct Dma {
    isr: [u32; 2],
    pub streams: [Stream; 8],
}

impl Dma {
    fn raise(&mut self, n: usize, flags: u32) {
        self.isr[n / 4] |= flags << FLAG_AT[n % 4];
    }

    fn read(&self, offset: u32) -> Option<u32> {
        Some(match offset {
            0 | 4 => self.isr[(offset / 4) as usize],
            8 | 0xC => 0,
            _ => {
                let s = self.streams.get(((offset - 0x10) / 0x18) as usize)?;
                match (offset - 0x10) % 0x18 {
                    0 => s.cr,
                    4 => s.ndtr,
                    8 => s.par,
                    0xC => s.m0ar,
                    0x10 => s.m1ar,
                    _ => s.fcr,
                }
            }
        })
    }

    fn write(&mut self, offset: u32, value: u32) -> Option<()> {
        match offset {
            0 | 4 => {}
            8 | 0xC => self.isr[(offset / 4 - 2) as usize] &= !value,
            _ => {
                let n = ((offset - 0x10) / 0x18) as usize;
                let s = self.streams.get_mut(n)?;
                match (offset - 0x10) % 0x18 {
                    0 => {
                        let was = s.enabled();
                        s.cr = value;
                        if s.enabled() && !was {
                            s.reload = s.ndtr;
                        } else if was && !s.enabled() && s.ndtr > 0 {
                            self.raise(n, COMPLETE);
                        }
                    }
                    4 => s.ndtr = value & 0xFFFF,
                    8 => s.par = value,
                    0xC => s.m0ar = value,
                    0x10 => s.m1ar = value,
                    _ => s.fcr = value,
                }
            }
        }
        Some(())
    }

    /// Whether any stream has something to say.
    pub fn speaks(&self) -> bool {
        self.isr != [0, 0]
    }

    fn irq(&self, n: usize) -> bool {
        let flags = self.isr[n / 4] >> FLAG_AT[n % 4];
        let cr = self.streams[n].cr;
        (flags & HALF != 0 && cr & 8 != 0) || (flags & COMPLETE != 0 && cr & 16 != 0) || (flags & 8 != 0 && cr & 4 != 0)
    }
}

/// Everything behind the CPU.
#[derive(Debug, Clone)]
pub struct Chip {
    /// Cycles since power-on.
    pub now: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Functions whose calls are counted.
    pub probes: Vec<Probe>,
    /// Instructions of each block, by half its offset in flash, where asked for.
    pub profile: Option<Vec<u64>>,
    /// The estimate of cycles, where asked for.
    pub estimate: Option<Box<Estimate>>,
    /// There are probes, a profile or an estimate.
    pub watched: bool,
    /// The CPU must be stopped at the first block at or after this cycle.
    pub deadline: u64,
    /// The CPU must be stopped at the next block.
    pub attention: bool,
    /// An interrupt waits for PRIMASK or BASEPRI: the CPU must be stopped when they are off.
    pub masked: bool,
    /// The state of an IT block may have been left behind: see the TLB hook.
    pub it_stale: bool,
    /// It has been: to be cleared before the CPU goes on.
    pub forget_it: bool,
    pub asleep: bool,
    /// The NMI is pending.
    pub nmi: bool,
    /// A fault within a fault: the CPU stands until a reset.
    pub locked_up: bool,
    /// When the ADC was last ready.
    pub ready: Moment,
    /// The event register of WFE.
    pub event: bool,
    pub returning: bool,
    pub error: Option<String>,

    pub nvic: Nvic,
    pub rcc: Rcc,
    pub pwr: Pwr,
    pub flash: Flash,
    pub iwdg: Iwdg,
    pub tim2: Timer,
    pub tim3: Timer,
    pub tim5: Timer,
    pub tim11: CrystalCounter,
    pub crc: ProgramCrc,
    pub backup: Backup,
    /// Where a sample mark goes out, and, where they are watched, the cycles at which it rose.
    pub mark: (usize, usize),
    pub mark_rises: Option<Vec<u64>>,
    pub ports: [Port; 8],
    pub syscfg: Syscfg,
    pub exti: Exti,
    pub dma: [Dma; 2],
    pub spi1: Spi,
    pub usart1: Usart,
    pub adc: Ads131m08,
    /// Chip select of the ADC: port and pin.
    pub adc_select: (usize, usize),
    /// SYNC/RESET of the ADC: port and pin.
    pub adc_reset: (usize, usize),
    /// The next ADC frame is invalid.
    pub corrupt: bool,
    /// Bytes too many in the receiver of the SPI, and the last of a frame that they keep for the next.
    pub slipped: u32,
    pub left_over: u8,
    dbgmcu: u32,
    /// When the running SPI transfer ends.
    pub spi_done: u64,
    /// When the running USART transmission ends.
    pub usart_done: u64,
    /// Memory writes to flash waiting to be judged: address, old bytes.
    pub flash_writes: Vec<(u32, [u8; 4], usize)>,
}

impl Chip {
    pub fn new(cause: u32, now: u64) -> Self {
        Self {
            now,
            instructions: 0,
            probes: Vec::new(),
            profile: None,
            estimate: None,
            watched: false,
            deadline: 0,
            attention: false,
            masked: false,
            it_stale: false,
            forget_it: false,
            asleep: false,
            nmi: false,
            locked_up: false,
            ready: Moment::default(),
            event: false,
            returning: false,
            error: None,
            nvic: Nvic::default(),
            rcc: Rcc::new(cause),
            pwr: Pwr::default(),
            flash: Flash::default(),
            iwdg: Iwdg::default(),
            tim2: Timer::default(),
            tim3: Timer::default(),
            tim5: Timer::default(),
            tim11: CrystalCounter::default(),
            crc: ProgramCrc::default(),
            backup: Backup::default(),
            mark: (2, 8),
            mark_rises: None,
            ports: Default::default(),
            syscfg: Syscfg::default(),
            exti: Exti::default(),
            dma: Default::default(),
            spi1: Spi::default(),
            usart1: Usart::default(),
            adc: Ads131m08::default(),
            adc_select: (1, 6),
            adc_reset: (2, 7),
            corrupt: false,
            slipped: 0,
            left_over: 0,
            dbgmcu: 0,
            spi_done: u64::MAX,
            usart_done: u64::MAX,
            flash_writes: Vec::new(),
        }
    }

    /// Now, in all the ways that it is counted.
    pub fn moment(&self) -> Moment {
        Moment {
            cycles: self.now,
            instructions: self.instructions,
            estimate: self.estimate.as_ref().map_or(0, |e| e.cycles().total()),
        }
    }

    /// A register is accessed: the processor waits for its bus (RM0390 section 2.1: APB1, APB2, AHB1; others are the core's own).
    fn wait_for_bus(&mut self, address: u32) {
        let divider = match address >> 16 {
            0x4000 => self.rcc.apb_dividers()[0],
            0x4001 => self.rcc.apb_dividers()[1],
            0x4002 => 1,
            _ => return,
        };
        if let Some(estimate) = &mut self.estimate {
            estimate.peripheral(divider);
        }
    }

    pub fn read(&mut self, address: u32) -> u32 {
        self.wait_for_bus(address);
        let now = self.now;
        let word = ((address & 0x3FF) / 4) as usize;
        let value = match address & !0x3FF {
            0x4000_0000 => self.tim2.read(word, now),
            0x4000_0400 => self.tim3.read(word, now),
            0x4000_0C00 => self.tim5.read(word, now),
            0x4001_4800 => self.tim11.read(word, &self.rcc),
            0x4002_3000 => self.crc.read(word),
            0x4000_2800 => self.backup.rtc(word, now),
            0x4002_3800 if word == 0x1C => Some(self.backup.bdcr(now)),
            a @ 0x4002_4000..=0x4002_4C00 if self.rcc.backup_clocked() => {
                Some(self.backup.read((a - 0x4002_4000) as usize / 4 + word))
            }
            0x4000_3000 => self.iwdg.read(word),
            0x4000_7000 => self.pwr.read(word),
            0x4001_1000 => self.usart1.read(word),
            0x4001_3000 => self.spi1.read(word),
            0x4001_3800 => self.syscfg.read(word),
            0x4001_3C00 => self.exti.read(word),
            a @ 0x4002_0000..=0x4002_1C00 => self.ports[((a - 0x4002_0000) / 0x400) as usize].read(word),
            0x4002_3800 => self.rcc.read(word),
            0x4002_3C00 => self.flash.read(word),
            0x4002_6000 => self.dma[0].read(address & 0x3FF),
            0x4002_6400 => self.dma[1].read(address & 0x3FF),
            0xE000_E000..=0xE000_EC00 => self.nvic.read(address & !3),
            0xE004_2000 => match word {
                0 => Some(0x1000_6421), // IDCODE: STM32F446
                1 => Some(self.dbgmcu),
                _ => Some(0),
            },
            _ => None,
        };
        value.unwrap_or_else(|| {
            self.fail(format!("read of {address:#010x}: this register is not modelled"));
            0
        })
    }

    pub fn write(&mut self, address: u32, value: u32, size: usize) {
        self.wait_for_bus(address);
        let now = self.now;
        let word = ((address & 0x3FF) / 4) as usize;
        let done = match address & !0x3FF {
            0x4000_0000 => {
                let done = self.tim2.write(word, value, now);
                // TIM2 is internal trigger 1 of TIM3 (RM0390 table 100).
                if self.tim2.triggers_by_start() && self.tim3.waits_for(1) {
                    let _ = self.tim3.write(0, 1, now);
                }
                done
            }
            0x4000_0400 => self.tim3.write(word, value, now),
            0x4000_0C00 => self.tim5.write(word, value, now),
            0x4001_4800 => self.tim11.write(word, value),
            // (Thousands of words: no line changes.)
            0x4002_3000 => {
                let done = self.crc.write(word, value);
                if done.is_none() {
                    self.finish(done, address);
                }
                return;
            }
            // Without DBP the backup domain cannot be written (RM0390 section 5.1.4).
            0x4002_3800 if word == 0x1C => {
                if self.pwr.backup_open() {
                    self.backup.set_bdcr(value, now);
                }
                Some(())
            }
            a @ 0x4002_4000..=0x4002_4C00 if self.rcc.backup_clocked() => {
                if self.pwr.backup_open() {
                    self.backup.write((a - 0x4002_4000) as usize / 4 + word, value);
                }
                return;
            }
            0x4000_3000 => self.iwdg.write(word, value, now),
            0x4000_7000 => self.pwr.write(word, value),
            0x4001_1000 => self.usart1.write(word, value),
            0x4001_3000 => self.spi1.write(word, value),
            0x4001_3800 => self.syscfg.write(word, value),
            0x4001_3C00 => self.exti.write(word, value),
            a @ 0x4002_0000..=0x4002_1C00 => {
                return self.write_port(((a - 0x4002_0000) / 0x400) as usize, word, value, address);
            }
            0x4002_3800 => {
                // APB2RSTR: SPI1 begins anew.
                if word == 9 && value & 1 << 12 != 0 {
                    self.spi1 = Spi::default();
                    self.slipped = 0;
                }
                self.rcc.write(word, value)
            }
            0x4002_3C00 => self.flash.write(word, value),
            0x4002_6000 => self.dma[0].write(address & 0x3FF, value),
            0x4002_6400 => self.dma[1].write(address & 0x3FF, value),
            0xE000_E000..=0xE000_EC00 => self.nvic.write(address, value, size),
            0xE004_2000 => {
                if word == 1 {
                    self.dbgmcu = value;
                }
                Some(())
            }
            _ => None,
        };
        self.finish(done, address);
        self.start_transfers();
        self.update_lines();
    }

    /// A write to a port, and what its pins do with it.
    fn write_port(&mut self, port: usize, word: usize, value: u32, address: u32) {
        let now = self.now;
        let (p, pin) = self.mark;
        let before = self.ports[p].driven(pin);
        let done = self.ports[port].write(word, value);
        if !before && self.ports[p].driven(pin) && self.ports[p].is_output(pin) {
            if let Some(rises) = &mut self.mark_rises {
                rises.push(now);
            }
        }
        let (p, pin) = self.adc_select;
        if p == port {
            let selected = !self.ports[p].driven(pin);
            self.adc.select(selected, self.corrupt);
        }
        let (p, pin) = self.adc_reset;
        if p == port && self.ports[p].is_output(pin) {
            self.adc.sync_reset(self.ports[p].driven(pin), now, crate::CPU_HZ);
        }
        self.finish(done, address);
    }

    fn finish(&mut self, done: Option<()>, address: u32) {
        if done.is_none() {
            self.fail(format!("write to {address:#010x}: this register is not modelled"));
        }
        // A write may have moved the next event, or woken an interrupt.
        self.attention = true;
    }

    fn fail(&mut self, what: String) {
        self.error.get_or_insert(what);
        self.attention = true;
    }

    /// The enabled stream that serves a request, if any.
    pub fn stream(&self, request: Request) -> Option<(usize, usize)> {
        request.streams().iter().find_map(|&(c, s, channel)| {
            let stream = &self.dma[c].streams[s];
            (stream.enabled() && stream.cr >> 25 & 7 == channel).then_some((c, s))
        })
    }

    /// Counts `items` moved by a stream; wraps or stops it at its end and raises its flags.
    pub fn moved(&mut self, (c, n): (usize, usize), items: u32) {
        if let Some(estimate) = &mut self.estimate {
            (0..items).for_each(|_| estimate.dma());
        }
        let s = &mut self.dma[c].streams[n];
        let before = s.ndtr;
        s.ndtr = s.ndtr.saturating_sub(items);
        let mut flags = 0;
        let half = s.reload / 2;
        if before > half && s.ndtr <= half {
            flags |= HALF;
        }
        if s.ndtr == 0 {
            flags |= COMPLETE;
            if s.cr & 0x100 != 0 {
                s.ndtr = s.reload;
            } else {
                s.cr &= !1;
            }
        }
        self.dma[c].raise(n, flags);
    }

    fn start_transfers(&mut self) {
        if self.spi_done == u64::MAX && self.spi1.moving() {
            if let (Some((c, n)), Some(_)) = (self.stream(Request::Spi1Rx), self.stream(Request::Spi1Tx)) {
                self.spi_done = self.now + u64::from(self.dma[c].streams[n].ndtr) * self.spi1.cycles_per_byte();
            }
        }
        if self.usart_done == u64::MAX && self.usart1.transmitting() {
            if let Some((c, n)) = self.stream(Request::Usart1Tx) {
                self.usart_done = self.now + u64::from(self.dma[c].streams[n].ndtr) * self.usart1.cycles_per_byte();
            }
        }
    }

    /// Recomputes every interrupt line.
    pub fn update_lines(&mut self) {
        let n = &mut self.nvic;
        n.line(irq::TIM2, self.tim2.irq());
        n.line(irq::TIM3, self.tim3.irq());
        n.line(irq::TIM5, self.tim5.irq());
        n.line(irq::USART1, self.usart1.irq());
        n.line(irq::EXTI9_5, self.exti.irq(0x3E0));
        n.line(irq::EXTI15_10, self.exti.irq(0xFC00));
        for s in 0..7 {
            n.line(irq::DMA1_STREAM0 + s, self.dma[0].irq(s));
        }
        n.line(irq::DMA1_STREAM7, self.dma[0].irq(7));
        for s in 0..5 {
            n.line(irq::DMA2_STREAM0 + s, self.dma[1].irq(s));
        }
        for s in 5..8 {
            n.line(irq::DMA2_STREAM5 + s - 5, self.dma[1].irq(s));
        }
    }
}
