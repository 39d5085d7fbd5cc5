//! SPI2 as a slave that answers as the ADS131M08 does (SBAS950): its frames, its registers, its reset. It does not have conversions of its own, nor the
//! two samples that the ADC keeps.

use super::{give, pin};
use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use embassy_stm32::gpio::{AfType, OutputType, Pull, Speed};
use embassy_stm32::interrupt::{self, InterruptExt};
use embassy_stm32::pac;
use embassy_stm32::pac::dma::vals::Dir;
use embassy_stm32::pac::gpio::vals::Idr;
use embassy_stm32::pac::spi::vals::{Cpha, Mstr};
use embassy_stm32::peripherals::SPI2;
use embassy_stm32::rcc;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::blocking_mutex::Mutex;

/// The EXTI line of chip select, PB12, and the number of port B in SYSCFG_EXTICR.
pub const SELECT_LINE: usize = 12;
const PORT_B: u8 = 1;
/// Streams of DMA1 that receive and send (RM0390 table 28), and the channel of SPI2 on both.
const RX: usize = 3;
const TX: usize = 4;
const DMA_CHANNEL: u8 = 0;
/// All flags of stream 3 in LIFCR, and of stream 4 in HIFCR.
const RX_FLAGS: u32 = 0x3D << 22;
const TX_FLAGS: u32 = 0x3D;

/// Codes of the eight channels; one more and one less by turns, for the unit flags an ADC whose codes never change.
const CODES: [i32; 8] = [10_000, -20_000, 30_000, 100_000, -100_000, 1, -2, 3];

const FRAME: usize = 30;
const WORDS: usize = FRAME.div_ceil(4);
static SENT: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];
static RECEIVED: [AtomicU32; WORDS] = [const { AtomicU32::new(0) }; WORDS];

/// So many of the next frames have a wrong checksum.
static INVALIDATE: AtomicU32 = AtomicU32::new(0);
/// Resets by the pin.
static RESETS: AtomicU32 = AtomicU32::new(0);

/// The next frames have a wrong checksum.
pub fn invalidate(frames: u32) {
    INVALIDATE.store(frames, Relaxed);
}

/// Resets by the pin so far.
pub fn resets() -> u32 {
    RESETS.load(Relaxed)
}

struct AdcModel {
    registers: [u16; 64],
    /// To the command of the frame before.
    answer: u16,
    held: bool,
    /// Frames, by two.
    odd: bool,
}

static ADC_MODEL: Mutex<CriticalSectionRawMutex, RefCell<AdcModel>> = Mutex::new(RefCell::new(AdcModel::RESET));

impl AdcModel {
    /// As after a reset (SBAS950 section 8.6).
    const RESET: Self = {
        let mut registers = [0; 64];
        (registers[0], registers[1], registers[2], registers[3], registers[6]) =
            (0x2800, 0x0500, 0x0510, 0xFF0E, 0x0600);
        let mut channel = 0;
        while channel < 8 {
            registers[0x0C + 5 * channel] = 0x8000;
            channel += 1;
        }
        Self { registers, answer: 0xFF28, held: false, odd: false }
    };

    /// Does what a frame has asked for (section 8.5.1.10).
    fn execute(&mut self, command: u16, value: u16) {
        const STATUS: usize = 1;
        const MODE: usize = 2;
        const RESET: u16 = 1 << 10;
        let address = usize::from(command >> 7 & 63);
        self.answer = match command >> 13 {
            0b011 => {
                self.registers[address] = value;
                if address == MODE {
                    self.registers[STATUS] = self.registers[STATUS] & !RESET | value & RESET;
                }
                0x4000 | command & 0x1FFF
            }
            0b101 => self.registers[address],
            _ => self.registers[STATUS],
        };
    }

    /// The next frame: the answer, the codes, their checksum, each at the start of a word of 24 bits.
    fn frame(&self) -> [u8; 4 * WORDS] {
        let mut bytes = [0; 4 * WORDS];
        bytes[..2].copy_from_slice(&self.answer.to_be_bytes());
        for (to, code) in bytes[3..27].chunks_exact_mut(3).zip(CODES) {
            let code = if self.odd { code + 1 } else { code - 1 };
            to.copy_from_slice(&code.to_be_bytes()[1..]);
        }
        let sum = crc(&bytes[..27]);
        bytes[27..29].copy_from_slice(&sum.to_be_bytes());
        bytes
    }

    /// A frame has ended; the next is made ready.
    fn ended(&mut self) {
        // SYNC/RESET, low.
        let held = pac::GPIOC.idr().read().idr(0) == Idr::LOW;
        if held && !self.held {
            RESETS.fetch_add(1, Relaxed);
        }
        if pac::DMA1.st(RX).ndtr().read().ndt() != 0 {
            // Not a whole frame: SPI and streams begin anew.
            set_up();
        } else if !held {
            let word = |k: usize| RECEIVED[k].load(Relaxed).to_le_bytes();
            let ([a, b, _, c], [d, ..]) = (word(0), word(1));
            self.execute(u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]));
        }
        if held {
            *self = Self { held, ..Self::RESET };
        }
        self.held = held;
        self.odd = !self.odd;
        self.arm();
    }

    fn arm(&self) {
        let mut frame = self.frame();
        let invalidate = INVALIDATE.load(Relaxed);
        if invalidate > 0 {
            INVALIDATE.store(invalidate - 1, Relaxed);
            frame[28] ^= 1;
        }
        for (to, bytes) in SENT.iter().zip(frame.chunks_exact(4)) {
            to.store(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]), Relaxed);
        }
        pac::DMA1.ifcr(0).write_value(pac::dma::regs::Ixr(RX_FLAGS));
        pac::DMA1.ifcr(1).write_value(pac::dma::regs::Ixr(TX_FLAGS));
        for stream in [RX, TX] {
            let st = pac::DMA1.st(stream);
            st.ndtr().write(|w| w.set_ndt(FRAME as u16));
            st.cr().modify(|w| w.set_en(true));
        }
    }
}

/// The interrupt of chip select's rising edge.
pub fn frame_ended() {
    ADC_MODEL.lock(|adc_model| adc_model.borrow_mut().ended());
}

/// CRC-16 of CCITT's polynomial, seed 0xFFFF, four bits at a time.
fn crc(bytes: &[u8]) -> u16 {
    const TABLE: [u16; 16] = {
        let mut table = [0; 16];
        let mut k = 0;
        while k < 16 {
            let mut crc = (k as u16) << 12;
            let mut bit = 0;
            while bit < 4 {
                crc = crc << 1 ^ if crc & 0x8000 != 0 { 0x1021 } else { 0 };
                bit += 1;
            }
            table[k] = crc;
            k += 1;
        }
        table
    };
    bytes
        .iter()
        .flat_map(|b| [b >> 4, b & 0xF])
        .fold(0xFFFF, |crc, half| crc << 4 ^ TABLE[usize::from(crc >> 12) ^ usize::from(half)])
}

/// SPI2 and its streams, as after a reset.
fn set_up() {
    for stream in [RX, TX] {
        let cr = pac::DMA1.st(stream).cr();
        cr.modify(|w| w.set_en(false));
        while cr.read().en() {}
    }
    rcc::enable_and_reset::<SPI2>();
    let spi = pac::SPI2;
    for (stream, dir, buffer) in [(RX, Dir::PERIPHERAL_TO_MEMORY, &RECEIVED), (TX, Dir::MEMORY_TO_PERIPHERAL, &SENT)] {
        let st = pac::DMA1.st(stream);
        st.par().write_value(spi.dr().as_ptr() as u32);
        st.m0ar().write_value(core::ptr::from_ref(buffer) as u32);
        st.cr().write(|w| {
            w.set_chsel(DMA_CHANNEL);
            w.set_dir(dir);
            w.set_minc(true);
        });
    }
    spi.cr2().write(|w| {
        w.set_rxdmaen(true);
        w.set_txdmaen(true);
    });
    // A slave that its NSS selects, in mode 1.
    spi.cr1().write(|w| {
        w.set_mstr(Mstr::SLAVE);
        w.set_cpha(Cpha::SECOND_EDGE);
        w.set_spe(true);
    });
}

/// Ready for the first frame.
pub fn start() {
    // SPI2 is alternate function 5.
    give(pin!(PB12), 5, AfType::input(Pull::Up));
    give(pin!(PB13), 5, AfType::input(Pull::Down));
    give(pin!(PC3), 5, AfType::input(Pull::Down));
    give(pin!(PC2), 5, AfType::output(OutputType::PushPull, Speed::High));
    let mut reset = pin!(PC0);
    reset.set_as_input(Pull::Up);
    core::mem::forget(reset);
    set_up();
    ADC_MODEL.lock(|adc_model| adc_model.borrow().arm());
    pac::RCC.apb2enr().modify(|w| w.set_syscfgen(true));
    // (See `clock` on writing what was just given its clock.)
    let _ = pac::RCC.apb2enr().read();
    cortex_m::asm::dsb();
    pac::SYSCFG.exticr(SELECT_LINE / 4).modify(|w| w.set_exti(SELECT_LINE % 4, PORT_B));
    pac::EXTI.rtsr(0).modify(|w| w.set_line(SELECT_LINE, true));
    pac::EXTI.imr(0).modify(|w| w.set_line(SELECT_LINE, true));
    interrupt::EXTI15_10.unpend();
    // SAFETY: what the handler touches was set up.
    #[allow(unsafe_code)]
    unsafe {
        interrupt::EXTI15_10.enable();
    }
}
