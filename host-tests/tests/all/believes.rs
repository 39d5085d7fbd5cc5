//! The virtual board takes nothing of the firmware for granted: one write of its set-up made wrong ends the run with a sentence that names the register.
//! Sources of the sentences: RM0390 and the ADC's data sheet.

use crate::support::patched;
use hrg_board::replay::{default_elf, read_elf};
use hrg_board::wires::Wires;
use hrg_study::faults::Scene;
use std::sync::LazyLock;
use virtual_board::mutation::{Change, Mutation, RegisterWrite};
use virtual_board::{Board, RunError, Stop, CPU_HZ};

static SCENE: LazyLock<Scene> = LazyLock::new(|| {
    let elf = read_elf(&default_elf()).expect("cargo xtask test builds the firmware first");
    Scene::new(&elf, 1).expect("a scene")
});

/// Register writes of the program up to its first rate frame.
static WRITES: LazyLock<Vec<RegisterWrite>> = LazyLock::new(|| {
    let mut board = board();
    board.record_writes();
    while board.world.received.rates.is_empty() {
        board.run_until(board.now() + CPU_HZ / 1000).expect("runs");
    }
    board.recorded_writes().to_vec()
});

fn board() -> Board<Wires> {
    Board::new(SCENE.elf(), SCENE.wires()).expect("runs")
}

/// The last write to a register of which the value passes.
fn write_to(address: u32, passes: impl Fn(u32) -> bool) -> RegisterWrite {
    *WRITES.iter().rev().find(|w| w.address == address && passes(w.value)).expect("the program writes it")
}

/// Gives the end of the run after a change of one write.
fn ends(number: u64, change: Change) -> String {
    let mut board = board();
    board.mutate(Mutation { number, change });
    match board.run_until(CPU_HZ) {
        Err(RunError::NotModelled { what, .. }) => what,
        other => format!("{other:?}"),
    }
}

/// Gives the end of the run after a change of some bits of the last write to a register.
fn with_bits(address: u32, mask: u32, bits: u32) -> String {
    let w = write_to(address, |_| true);
    ends(w.number, Change::Becomes { address, value: w.value & !mask | bits })
}

const GPIOA: u32 = 0x4002_0000;
const GPIOB: u32 = 0x4002_0400;
const SPI1: u32 = 0x4001_3000;
const USART1: u32 = 0x4001_1000;
const TIM2: u32 = 0x4000_0000;
const DMA1: u32 = 0x4002_6000;
const DMA2: u32 = 0x4002_6400;
const RCC: u32 = 0x4002_3800;
const PWR: u32 = 0x4000_7000;
const FLASH: u32 = 0x4002_3C00;

fn expect(found: &str, parts: &[&str]) {
    println!("{found}");
    assert!(parts.iter().all(|p| found.contains(p)), "{found}");
}

// Changes that an outside review once found to go unnoticed: five instructions patched, and every frame was good.

#[test]
fn spi_in_mode_2_ends_the_run() {
    expect(&with_bits(SPI1, 3, 2), &["SPI1_CR1.CPHA is 0", "SBAS950", "RM0390 section"]);
    expect(&with_bits(SPI1, 3, 3), &["SPI1_CR1.CPOL is 1"]);
}

#[test]
fn spi_with_the_least_bit_first_ends_the_run() {
    expect(&with_bits(SPI1, 1 << 7, 1 << 7), &["SPI1_CR1.LSBFIRST is 1"]);
}

#[test]
fn data_ready_from_another_pin_ends_the_run() {
    // PB2 on alternate function 2, which is not TIM2's.
    expect(&with_bits(GPIOB + 0x20, 0xF00, 0x200), &["data-ready does not pass PB2", "TIM2_CH4 is 1"]);
}

#[test]
fn the_link_on_another_function_ends_the_run() {
    // PA9 and PA10 on alternate function 1: TIM1.
    let found = with_bits(GPIOA + 0x24, 0xFF0, 0x110);
    expect(&found, &["alternate function 1, which is TIM1_CH", "USART1_", "RM0390 section 7.4.10"]);
}

#[test]
fn spi_without_its_clock_ends_the_run() {
    let on = write_to(RCC + 0x44, |v| v & 1 << 12 != 0).number;
    // The first write that switches it on.
    let first = WRITES.iter().find(|w| w.address == RCC + 0x44 && w.value & 1 << 12 != 0).map_or(on, |w| w.number);
    expect(&ends(first, Change::LeftOut), &["SPI1 is not clocked: RCC.APB2ENR bit 12 is 0"]);
}

#[test]
fn pins_that_do_not_drive_end_the_run() {
    expect(&with_bits(GPIOA + 0x04, 1 << 5, 1 << 5), &["PA5 is open drain"]);
    expect(&with_bits(GPIOA + 0x08, 3 << 10, 0), &["too fast for PA5", "OSPEEDR is 0"]);
    expect(&with_bits(GPIOA + 0x0C, 3 << 12, 0), &["PA6 floats between frames"]);
    for pull in [0, 2] {
        expect(&with_bits(GPIOA + 0x0C, 3 << 20, pull << 20), &["PA10 floats without a cable", "has no pull-up"]);
    }
    expect(&with_bits(GPIOA, 3 << 10, 1 << 10), &["does not pass PA5", "MODER has it as an output"]);
    expect(&with_bits(GPIOA, 3 << 26, 0), &["no probe reads the log"]);
}

/// SPI1 takes what it receives by its clock as it comes back from PA5: APB2 must be slow enough for the speed of that pin.
#[test]
fn a_bus_too_fast_for_the_clock_that_comes_back_ends_the_run() {
    // PPRE2 of RCC_CFGR: APB2 at 90 MHz, where the clock on the wire is 22.5 MHz, or 11.25 with BR as it was.
    let errata = ["the last bit of a byte", "PCLK2 has 90 MHz", "ES0298 section 2.14"];
    expect(&with_bits(RCC + 0x08, 7 << 13, 4 << 13), &errata);
}

#[test]
fn streams_that_do_not_serve_end_the_run() {
    // Stream 5 of DMA1 (TIM2_CH1), then stream 0 of DMA2 (SPI1_RX).
    let ring = write_to(DMA1 + 0x88, |v| v & 1 == 0);
    for (flip, part) in [(1 << 6, "DIR"), (1 << 11, "PSIZE"), (1 << 9, "PINC"), (1 << 10, "MINC"), (1 << 5, "PFCTRL")] {
        let change = Change::Becomes { address: ring.address, value: ring.value ^ flip };
        expect(&ends(ring.number, change), &["DMA1 stream 5 does not serve TIM2_CH1", part, "RM0390 section 9.5"]);
    }
    let from = write_to(DMA2 + 0x18, |_| true);
    let change = Change::Becomes { address: from.address, value: from.value + 4 };
    expect(&ends(from.number, change), &["DMA2 stream 0 does not serve SPI1_RX", "PAR"]);
}

#[test]
fn captures_that_are_not_those_of_the_wire_end_the_run() {
    expect(&with_bits(TIM2 + 0x18, 3, 2), &["resonator x is not captured", "input of its neighbour"]);
    expect(&with_bits(TIM2 + 0x18, 0xF0, 0x30), &["its filter delays the edges"]);
    expect(&with_bits(TIM2 + 0x20, 2, 2), &["it captures the other edge"]);
    expect(&with_bits(TIM2, 0x10, 0x10), &["counts down"]);
}

#[test]
fn a_link_at_another_speed_or_form_ends_the_run() {
    expect(&with_bits(USART1 + 0x08, 0xFFFF, 45), &["USART1_BRR makes 1000000 baud", "framing errors"]);
    expect(&with_bits(USART1 + 0x0C, 1 << 12, 1 << 12), &["nine data bits"]);
    expect(&with_bits(USART1 + 0x0C, 1 << 10, 1 << 10), &["parity"]);
}

#[test]
fn clocks_that_chip_and_flash_cannot_bear_end_the_run() {
    let acr = write_to(FLASH, |v| v & 0xF == 5);
    expect(
        &ends(acr.number, Change::Becomes { address: FLASH, value: acr.value & !0xF | 4 }),
        &["4 wait states at an HCLK of 180", "RM0390 sections 3.4.1"],
    );
    let pll = write_to(RCC + 4, |_| true);
    let with_n = |n: u32| Change::Becomes { address: RCC + 4, value: pll.value & !(0x1FF << 6) | n << 6 };
    expect(&ends(pll.number, with_n(190)), &["HCLK is 190.000 MHz", "180 MHz"]);
    let buses = write_to(RCC + 8, |v| v & 3 == 2);
    expect(
        &ends(buses.number, Change::Becomes { address: RCC + 8, value: buses.value & !(7 << 10) }),
        &["PCLK1 is 180"],
    );
    // Over-drive is switched to by one write, and stays on with those after it.
    let switched =
        WRITES.iter().find(|w| w.address == PWR && w.value & 3 << 16 == 3 << 16).expect("the program writes it");
    let found = ends(switched.number, Change::LeftOut);
    // The program waits for ODSWRDY, which never comes, and the watchdog, which the loader has started, ends that.
    assert!(found.contains("Ok(Watchdog)") || found.contains("over-drive"), "{found}");
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_tenth_of_the_mutants_is_noticed_or_harmless() {
    let all = hrg_study::mutate::campaign(SCENE.elf(), 1, hrg_study::mutate::COUNT.div_ceil(10)).expect("runs");
    println!("{}", all.markdown());
    let unnoticed: Vec<&str> = all.unnoticed().collect();
    assert!(unnoticed.is_empty(), "{unnoticed:#?}");
    let waits: Vec<String> = all.waits.iter().filter(|w| !w.holds()).map(ToString::to_string).collect();
    assert!(all.waits.len() >= 6 && waits.is_empty(), "{waits:#?}");
}

#[test]
fn a_transfer_to_no_memory_ends_the_run_or_stops_the_stream() {
    // Stream 5 of DMA1 (TIM2_CH1): M0AR behind the end of RAM.
    let to = write_to(DMA1 + 0x94, |_| true);
    let wrong = Change::Becomes { address: to.address, value: 0x2002_0000 };
    expect(&ends(to.number, wrong), &["no memory at 0x20020000"]);
    let mut board = board();
    board.faults_as_on_chip();
    board.mutate(Mutation { number: to.number, change: wrong });
    // The next fetch finds TEIF: the unit says where, stands still, and the watchdog starts it anew.
    assert_eq!(board.run_until(10 * CPU_HZ).expect("runs"), Stop::Watchdog);
    assert!(board.world.received.rates.is_empty() && !board.world.received.log_bytes.is_empty());
}

#[test]
fn a_stream_that_was_stopped_half_way_must_be_set_up_anew() {
    let mut board = board();
    board.run_until(CPU_HZ).expect("runs");
    // Of the stream that receives from the link: a byte, then off and on.
    board.world.hear(&[0]);
    board.poll_link();
    board.run_until(CPU_HZ + CPU_HZ / 100).expect("runs");
    let cr = board.read_register(DMA2 + 0x88).expect("there");
    board.write_register(DMA2 + 0x88, cr & !1).expect("off");
    board.write_register(DMA2 + 0xC, 0x3D << 6).expect("its flags");
    let end = board.write_register(DMA2 + 0x88, cr).expect_err("on");
    expect(&end.to_string(), &["DMA2 stream 5", "stopped half way", "RM0390 section 9.5"]);
}

/// Gives the end of a run of the program with one byte changed.
fn with_byte(address: u32, change: impl Fn(u8) -> u8) -> String {
    let elf = patched(SCENE.elf(), address, |bytes| bytes[0] = change(bytes[0]));
    let end = Board::new(&elf, SCENE.wires()).and_then(|mut b| b.run_until(CPU_HZ));
    end.map_or_else(|e| e.to_string(), |stop| format!("{stop:?}"))
}

#[test]
fn vectors_without_their_thumb_bit_end_the_run() {
    const RESET: u32 = 0x0800_0004;
    // (The loader's table has the reset; the program's has the rest.)
    let tim2_vector = board().firmware().address_of("__vector_table").expect("a symbol") + 4 * (16 + 28);
    assert_eq!(with_byte(RESET, |b| b), "Time", "control");
    expect(&with_byte(RESET, |b| b & !1), &["reset vector", "locks up"]);
    expect(&with_byte(tim2_vector, |b| b & !1), &["vector 44", "INVSTATE"]);
}

#[test]
fn over_drive_takes_its_time() {
    // ODEN with ODSWEN at once.
    let oden = WRITES.iter().find(|w| w.address == PWR && w.value & 1 << 16 != 0).expect("the program writes it");
    let both = Change::Becomes { address: PWR, value: oden.value | 1 << 17 };
    expect(&ends(oden.number, both), &["ODSWEN", "before over-drive is ready"]);
}

#[test]
fn time_has_its_interrupts() {
    // Half a turn of the time's counter is 36 minutes: what counts the halves is looked at where it is set.
    const TIM5: u32 = 0x4000_0C00;
    let mut board = board();
    board.run_until(CPU_HZ).expect("runs");
    let read = |offset: u32| board.read_register(TIM5 + offset).expect("there");
    let (dier, psc, arr, half) = (read(0x0C), read(0x28), read(0x2C), read(0x34));
    assert_eq!(dier & 0b11, 0b11, "UIE and CC1IE: {dier:#x}");
    // 90 MHz / 90: microseconds, over 32 bits.
    assert_eq!((psc, arr, half), (89, u32::MAX, 1 << 31));
}

#[test]
fn memory_that_sleeps_and_a_spread_clock_end_the_run() {
    for (address, bit, set, parts) in [
        (RCC + 0x50, 16, false, ["SRAM1", "RCC_AHB1LPENR"]),
        (RCC + 0x50, 17, false, ["SRAM2", "6.3.14"]),
        (RCC + 0x50, 15, false, ["flash's interface", "6.3.14"]),
        (RCC + 0x80, 31, true, ["SSCGEN", "thermometer"]),
    ] {
        let mut board = board();
        board.run_until(CPU_HZ).expect("runs");
        let value = board.read_register(address).expect("there");
        let changed = if set { value | 1 << bit } else { value & !(1 << bit) };
        board.write_register(address, changed).expect("written");
        let end = board.run_until(2 * CPU_HZ).expect_err("ends");
        expect(&end.to_string(), &parts);
    }
}

#[test]
fn a_bus_whose_half_bit_is_too_short_ends_the_run() {
    // BR: PCLK2 / 2, 22.5 MHz.
    expect(&with_bits(SPI1, 0b111 << 3, 0), &["22.50 MHz", "half a bit", "SBAS950"]);
}
