//! The chip behind the CPU: which address belongs to which peripheral, the DMA controllers, interrupt lines.

use crate::ads131m08::Ads131m08;
use crate::chip_adc::ChipAdc;
use crate::clocks::{Clocks, Pace};
use crate::cycles::Estimate;
use crate::dma::{Dma, Request, COMPLETE, HALF};
use crate::gpio::{Exti, Port, Syscfg};
use crate::mutation::{Reads, RegisterRead, RegisterWrite, Writes};
use crate::nvic::{irq, Nvic};
use crate::part::Part;
use crate::probe::{Masked, Moment, Probe};
use crate::profile::Profile;
use crate::serial::{Spi, Usart};
use crate::signals::{Signal, SIGNALS};
use crate::spare::{Spare, DEMCR};
use crate::system::{Backup, CrystalCounter, Flash, Iwdg, ProgramCrc, Pwr, Rcc};
use crate::tables::Pin;
use crate::timer::Timer;

/// Everything behind the CPU.
#[derive(Debug, Clone)]
pub struct Chip {
    /// Cycles since power-on.
    pub now: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Functions whose calls are counted.
    pub probes: Vec<Probe>,
    pub masked_stretch: Masked,
    /// Address of the last access that nothing answers.
    pub bad_address: u32,
    /// Costs of each block, by half its offset in flash, where asked for.
    pub profile: Option<Profile>,
    /// The estimate of cycles, where asked for.
    pub estimate: Option<Box<Estimate>>,
    /// Instructions executed before it began.
    pub estimated_from: u64,
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
    pub asleep: bool,
    /// The NMI is pending.
    pub nmi: bool,
    /// A fault within a fault: the CPU stands until a reset.
    pub locked_up: bool,
    /// Time at which the ADC was last ready.
    pub ready: Moment,
    /// The event register of WFE.
    pub event: bool,
    pub returning: bool,
    /// The program asks the debugger for something: the number of the call, its parameter.
    pub call: Option<(u32, u32)>,
    pub error: Option<String>,
    /// Set if faults that the chip bears without a sign end the run.
    pub strict: bool,
    /// Frequencies, and instructions in the board's time.
    pub clocks: Clocks,
    pub pace: Pace,
    /// Time left over from the last block.
    pub rest: u64,
    /// Result for each signal: its pin carries it or not; `None`: not asked for since the pins changed.
    pub carried: [Option<bool>; SIGNALS],
    /// The chip's tables and limits.
    pub part: &'static Part,
    /// Writes to registers.
    pub writes: Writes,
    /// The same of reads.
    pub reads: Reads,
    /// First address of the block of code that runs.
    pub block: u32,

    pub nvic: Nvic,
    pub rcc: Rcc,
    pub pwr: Pwr,
    pub flash: Flash,
    pub iwdg: Iwdg,
    pub tim2: Timer,
    pub tim3: Timer,
    pub tim5: Timer,
    /// The edge of LSI that TIM5 captured last.
    pub lsi_edge: u64,
    pub tim11: CrystalCounter,
    pub crc: ProgramCrc,
    pub backup: Backup,
    /// The cycles at which a sample mark rose, where they are watched.
    pub mark_rises: Option<Vec<u64>>,
    pub ports: [Port; 8],
    pub syscfg: Syscfg,
    pub exti: Exti,
    pub dma: [Dma; 2],
    pub spi1: Spi,
    pub usart1: Usart,
    pub spare: Spare,
    pub adc: Ads131m08,
    /// ADC1.
    pub chip_adc: ChipAdc,
    /// Set if bytes over the SPI, or (`line_dead`) out over the link, are lost.
    pub bus_dead: bool,
    pub line_dead: bool,
    /// The next ADC frame is invalid.
    pub corrupt: bool,
    /// Bytes too many in the receiver of the SPI, and the last of a frame that they keep for the next.
    pub slipped: u32,
    pub left_over: u8,
    pub dbgmcu: u32,
    /// Time at which the running SPI transfer ends.
    pub spi_done: u64,
    /// Time at which the running USART transmission ends.
    pub usart_done: u64,
    /// Memory writes to flash waiting to be judged: address, old bytes.
    pub flash_writes: Vec<(u32, [u8; 4], usize)>,
}

impl Chip {
    pub fn new(part: &'static Part, cause: u32, now: u64) -> Self {
        Self {
            part,
            writes: Writes::default(),
            reads: Reads::default(),
            block: 0,
            now,
            instructions: 0,
            probes: Vec::new(),
            masked_stretch: Masked::default(),
            bad_address: 0,
            profile: None,
            estimate: None,
            estimated_from: 0,
            watched: false,
            deadline: 0,
            attention: false,
            masked: false,
            it_stale: false,
            asleep: false,
            nmi: false,
            locked_up: false,
            ready: Moment::default(),
            event: false,
            returning: false,
            call: None,
            error: None,
            strict: true,
            clocks: Clocks::RESET,
            pace: Pace::of(Clocks::RESET.hclk),
            rest: 0,
            carried: [None; SIGNALS],
            nvic: Nvic::default(),
            rcc: Rcc::new(cause),
            pwr: Pwr::default(),
            flash: Flash::default(),
            iwdg: Iwdg::default(),
            tim2: Timer::default(),
            tim3: Timer::new(0xFFFF),
            tim5: Timer::default(),
            lsi_edge: 0,
            tim11: CrystalCounter::default(),
            crc: ProgramCrc::default(),
            backup: Backup::default(),
            mark_rises: None,
            ports: std::array::from_fn(Port::of),
            syscfg: Syscfg::default(),
            exti: Exti::default(),
            dma: Default::default(),
            spi1: Spi::default(),
            usart1: Usart::default(),
            spare: Spare::default(),
            adc: Ads131m08::default(),
            chip_adc: ChipAdc::default(),
            bus_dead: false,
            line_dead: false,
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
        let bus_ratio = match address >> 16 {
            0x4000 => self.rcc.apb_prescalers()[0],
            0x4001 => self.rcc.apb_prescalers()[1],
            0x4002 => 1,
            _ => return,
        };
        if let Some(estimate) = &mut self.estimate {
            estimate.peripheral(bus_ratio);
        }
    }

    pub fn read(&mut self, address: u32) -> u32 {
        self.wait_for_bus(address);
        if !self.awake(address, "a read gives 0") {
            return 0;
        }
        let now = self.now;
        let word = ((address & 0x3FF) / 4) as usize;
        let value = match address & !0x3FF {
            0x4000_0000 => self.tim2.read(word, now),
            0x4000_0400 => self.tim3.read(word, now),
            0x4000_0C00 => {
                self.catch_lsi();
                self.tim5.read(word, now)
            }
            0x4001_4800 => self.tim11.read(word, &self.rcc),
            0x4002_3000 => self.crc.read(word),
            0x4000_2800 => self.backup.rtc(word, now),
            0x4002_3800 if word == 0x1C => Some(self.backup.bdcr(now)),
            a @ 0x4002_4000..=0x4002_4C00 if self.rcc.backup_clocked() => {
                Some(self.backup.read((a - 0x4002_4000) as usize / 4 + word))
            }
            0x4000_3000 => self.iwdg.read(word, now),
            0x4000_7000 => self.pwr.read(word, now),
            0x4001_1000 => self.usart1.read(word),
            0x4001_2000 => self.chip_adc.read(word, now),
            0x4001_3000 => self.spi1.read(word),
            0x4001_3800 => self.syscfg.read(word),
            0x4001_3C00 => self.exti.read(word),
            a @ 0x4002_0000..=0x4002_1C00 => self.ports[((a - 0x4002_0000) / 0x400) as usize].read(word),
            0x4002_3800 => self.rcc.read(word, now),
            0x4002_3C00 => self.flash.read(word),
            0x4002_6000 => self.dma[0].read(address & 0x3FF),
            0x4002_6400 => self.dma[1].read(address & 0x3FF),
            0xE000_E000..=0xE000_EC00 if address & !3 != DEMCR => self.nvic.read(address & !3),
            0xE004_2000 => match word {
                0 => Some(self.part.id),
                1 => Some(self.dbgmcu),
                _ => Some(0),
            },
            _ => self.read_spare(address),
        };
        value.unwrap_or_else(|| {
            self.bad_address = address;
            self.fail(format!("read of {address:#010x}: this register is not modelled"));
            0
        })
    }

    /// Channel 4 of TIM5 has captured LSI until now, where it is led there (TIM5_OR, RM0390 section 17.4).
    fn catch_lsi(&mut self) {
        let Some(every) = self.tim5.captures_lsi() else { return };
        if !(self.rcc.lsi_runs(self.now) || self.iwdg.running()) {
            return;
        }
        let hz = u128::from(self.iwdg.lsi_hz.max(1));
        let edges = (u128::from(self.now) * hz / u128::from(crate::CPU_HZ)) as u64 / every * every;
        if edges != self.lsi_edge {
            self.lsi_edge = edges;
            let at = (u128::from(edges) * u128::from(crate::CPU_HZ)).div_ceil(hz) as u64;
            let captured = self.tim5.edge(3, at);
            if captured.dma || captured.interrupt {
                self.fail("TIM5_DIER asks for an interrupt or DMA with captures of LSI, which is not modelled".into());
            }
        }
    }

    /// Instructions are executed: one is one cycle of HCLK.
    pub fn pass(&mut self, instructions: u64) {
        if self.pace.ticks == 1 {
            self.now += instructions * self.pace.units;
        } else {
            let t = instructions * self.pace.units + self.rest;
            self.now += t / self.pace.ticks;
            self.rest = t % self.pace.ticks;
        }
    }

    /// A write of the firmware.
    pub fn store(&mut self, address: u32, value: u32, size: usize) {
        let before = if self.writes.recording() { self.clone().read(address & !3) } else { 0 };
        let write = RegisterWrite {
            number: 0,
            exception: self.nvic.stack.last().copied().unwrap_or(0),
            block: self.block,
            address,
            value,
            size,
            before,
        };
        for w in self.writes.pass(write).into_iter().flatten() {
            self.write(w.address, w.value, w.size);
        }
    }

    /// A read of the firmware.
    pub fn load(&mut self, address: u32) -> u32 {
        let at = self.now;
        let read = RegisterRead {
            number: 0,
            writes: self.writes.count(),
            exception: self.nvic.stack.last().copied().unwrap_or(0),
            block: self.block,
            address,
            value: self.read(address),
            at,
        };
        self.reads.pass(read)
    }

    pub fn write(&mut self, address: u32, value: u32, size: usize) {
        self.wait_for_bus(address);
        if !self.awake(address, "a write is lost") {
            return;
        }
        let now = self.now;
        let word = ((address & 0x3FF) / 4) as usize;
        let done = match address & !0x3FF {
            0x4000_0000 => {
                let done = self.tim2.write(word, value, now);
                self.judge_timer(address);
                // TIM2 is internal trigger 1 of TIM3 (RM0390 table 100).
                if self.tim2.triggers_by_start() && self.tim3.waits_for(1) {
                    let _ = self.tim3.write(0, 1, now);
                }
                done
            }
            0x4000_0400 | 0x4000_0C00 => {
                let timer = if address & 0x800 == 0 { &mut self.tim3 } else { &mut self.tim5 };
                let done = timer.write(word, value, now);
                self.judge_timer(address);
                done
            }
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
            0x4000_3000 | 0x4000_7000 | 0x4001_4800 | 0x4002_3800 | 0x4002_3C00 => {
                self.write_system(address & !0x3FF, word, value)
            }
            0x4001_1000 => self.usart1.write(word, value),
            0x4001_2000 => self.write_chip_adc(word, value),
            0x4001_3000 => self.spi1.write(word, value),
            0x4001_3800 => self.syscfg.write(word, value),
            0x4001_3C00 => self.exti.write(word, value),
            a @ 0x4002_0000..=0x4002_1C00 => {
                return self.write_port(((a - 0x4002_0000) / 0x400) as usize, word, value, address);
            }
            0x4002_6000 | 0x4002_6400 => {
                let c = (address >> 10 & 1) as usize;
                if let Some((n, what)) = self.dma[c].refuses(address & 0x3FF, value) {
                    self.mismatch(|| format!("DMA{} stream {n}: {what} (RM0390 section 9.5.5)", c + 1));
                }
                self.dma[c].write(address & 0x3FF, value)
            }
            0xE000_E000..=0xE000_EC00 if address & !3 != DEMCR => self.nvic.write(address, value, size),
            0xE004_2000 => {
                if word == 1 {
                    self.dbgmcu = value;
                }
                Some(())
            }
            _ => self.write_spare(address, value),
        };
        self.finish(done, address);
        self.start_transfers();
        self.update_lines();
    }

    fn write_chip_adc(&mut self, word: usize, value: u32) -> Option<()> {
        let (now, pclk2) = (self.now, self.clocks.pclk2 as f64);
        match self.chip_adc.write(word, value, now, pclk2)? {
            Ok(()) => {}
            Err(what) => self.mismatch(|| what),
        }
        Some(())
    }

    /// A write to what keeps the chip itself running: clocks, power, flash, watchdog, the look at the crystal.
    fn write_system(&mut self, base: u32, word: usize, value: u32) -> Option<()> {
        match base {
            0x4001_4800 => {
                let done = self.tim11.write(word, value);
                if let Some(what) = self.tim11.strange() {
                    self.mismatch(|| format!("TIM11_{what} (RM0390 section 18.5)"));
                }
                done
            }
            0x4000_3000 => {
                if matches!(word, 1 | 2) && !self.iwdg.open() {
                    self.mismatch(|| "IWDG_PR or IWDG_RLR is written without the key 0x5555 in IWDG_KR: the write is lost (RM0390 section 20.3.2)".into());
                }
                self.iwdg.write(word, value, self.now)
            }
            0x4000_7000 => {
                if word == 0 {
                    self.refused_switch(base, value);
                }
                let done = self.pwr.write(word, value, self.now);
                self.follow_clocks();
                done
            }
            0x4002_3800 => {
                self.pll_locked(word, value);
                if word == 0 {
                    self.refused_switch(base, value);
                }
                let done = self.rcc.write(word, value, self.now);
                if (4..=9).contains(&word) {
                    self.reset_peripherals();
                }
                self.follow_clocks();
                done
            }
            0x4002_3C00 => {
                // ICRST with ICEN, DCRST with DCEN.
                if word == 0 && value & value >> 2 & 0x600 != 0 {
                    self.mismatch(|| {
                        "FLASH_ACR.ICRST or DCRST is set while that cache is on, which is not allowed (RM0390 section 3.8.1)".into()
                    });
                }
                let done = self.flash.write(word, value);
                self.follow_clocks();
                done
            }
            _ => None,
        }
    }

    /// A write to a port, and what its pins do with it.
    fn write_port(&mut self, port: usize, word: usize, value: u32, address: u32) {
        const PUPDR: usize = 3;
        const BSRR: usize = 6;
        let now = self.now;
        let wiring = &self.part.wiring;
        let Pin(p, pin) = wiring.mark;
        let before = self.ports[p].driven(pin);
        let done = self.ports[port].write(word, value);
        if word == PUPDR && value & value >> 1 & 0x5555_5555 != 0 {
            self.mismatch(|| "GPIO_PUPDR sets a pin to 3, which is reserved (RM0390 section 7.4.4)".into());
        }
        if word != BSRR {
            self.carried = [None; SIGNALS];
        }
        if !before && self.ports[p].driven(pin) && self.carries(Signal::Mark) {
            if let Some(rises) = &mut self.mark_rises {
                rises.push(now);
            }
        }
        let Pin(p, pin) = wiring.select;
        if p == port {
            let selected = self.ports[p].is_output(pin) && !self.ports[p].driven(pin);
            self.adc.select(selected, self.corrupt);
        }
        let Pin(p, pin) = wiring.reset;
        if p == port && self.ports[p].is_output(pin) {
            self.adc.sync_reset(self.ports[p].driven(pin), now, crate::CPU_HZ);
        }
        self.spread(port);
        self.finish(done, address);
    }

    /// Those whose reset is asked for are as at power-on (RM0390 sections 6.3.5 to 6.3.9).
    fn reset_peripherals(&mut self) {
        let part = self.part;
        let held = |address: u32| {
            let gate = part.gate(address);
            gate.and_then(|g| g.reset)
        };
        let asked = |rcc: &Rcc, address: u32| held(address).is_some_and(|bit| rcc.bit(bit));
        for (address, timer, top) in [
            (0x4000_0000, &mut self.tim2, u32::MAX),
            (0x4000_0400, &mut self.tim3, 0xFFFF),
            (0x4000_0C00, &mut self.tim5, u32::MAX),
        ] {
            if asked(&self.rcc, address) {
                *timer = Timer::new(top);
                timer.set_pace(Pace::of(self.clocks.timers), self.now);
            }
        }
        self.reset_spare();
        if asked(&self.rcc, 0x4001_4800) {
            self.tim11 = CrystalCounter::default();
        }
        if asked(&self.rcc, 0x4001_3000) {
            self.spi1 = Spi::default();
            self.slipped = 0;
        }
        if asked(&self.rcc, 0x4001_1000) {
            self.usart1 = Usart::default();
        }
        if asked(&self.rcc, 0x4001_2000) {
            self.chip_adc = self.chip_adc.reset();
        }
        if asked(&self.rcc, 0x4000_7000) {
            let sag_tenths = self.pwr.sag_tenths;
            self.pwr = Pwr::default();
            self.pwr.sag_tenths = sag_tenths;
        }
        if asked(&self.rcc, 0x4002_3000) {
            self.crc = ProgramCrc::default();
        }
        if asked(&self.rcc, 0x4001_3800) {
            self.syscfg = Syscfg::default();
        }
        for (c, address) in [0x4002_6000, 0x4002_6400].into_iter().enumerate() {
            if asked(&self.rcc, address) {
                self.dma[c] = Dma::default();
            }
        }
        for port in 0..self.ports.len() {
            if asked(&self.rcc, 0x4002_0000 + 0x400 * port as u32) {
                self.ports[port] = Port::of(port);
                self.carried = [None; SIGNALS];
            }
        }
    }

    fn finish(&mut self, done: Option<()>, address: u32) {
        if done.is_none() {
            self.bad_address = address;
            self.fail(format!("write to {address:#010x}: this register is not modelled"));
        }
        // A write may have moved the next event, or woken an interrupt.
        self.attention = true;
    }

    fn fail(&mut self, what: String) {
        self.error.get_or_insert(what);
        self.attention = true;
    }

    /// The enabled stream that a request goes to, if any.
    pub fn stream(&self, request: Request) -> Option<(usize, usize)> {
        self.part.places(request).iter().find_map(|&(c, s, channel)| {
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
            if let (Some(_), Some(_)) = (self.stream(Request::Spi1Rx), self.stream(Request::Spi1Tx)) {
                self.bus_dead = !self.bus_works();
                if let (Some((c, n)), Some(_)) = (self.serving(Request::Spi1Rx), self.serving(Request::Spi1Tx)) {
                    let time = self.spi1.time_per_byte(self.clocks.pclk2);
                    self.spi_done = self.now + u64::from(self.dma[c].streams[n].ndtr) * time;
                }
            }
        }
        if self.usart_done == u64::MAX && self.usart1.transmitting() {
            if let Some((c, n)) = self.serving(Request::Usart1Tx) {
                self.line_dead = !self.line_works(true);
                let time = self.usart1.time_per_byte(self.clocks.pclk2);
                self.usart_done = self.now + u64::from(self.dma[c].streams[n].ndtr) * time;
            }
        }
        self.start_spare();
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
