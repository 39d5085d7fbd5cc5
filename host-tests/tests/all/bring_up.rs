//! The bring-up program, as it is flashed on a bare board, on the virtual board with the jumpers of docs/bring-up.md.

use hrg_board::bring_up::{jumpers, run, JUMPERS};
use hrg_board::replay::read_elf;
use std::path::Path;
use virtual_board::{Board, NothingConnected, CPU_HZ};

const TOP: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// `cargo xtask test` and `cargo xtask size --bring-up` build it there.
fn elf() -> Vec<u8> {
    let path = Path::new(TOP).join("target/bring-up/thumbv7em-none-eabihf/firmware/firmware");
    read_elf(&path).expect("cargo xtask size --bring-up builds it")
}

fn page() -> String {
    std::fs::read_to_string(Path::new(TOP).join("docs/bring-up.md")).expect("readable")
}

/// A line with its numbers left out.
fn without_numbers(line: &str) -> String {
    let number = |c: char| c.is_ascii_digit() || matches!(c, '.' | '-' | '+');
    line.split_whitespace()
        .map(|word| {
            let inner = word.trim_matches(|c: char| "()=:,".contains(c));
            let a_number = inner.starts_with(number) && inner.parse::<f64>().is_ok() || inner == "NaN";
            if a_number {
                word.replace(inner, "#")
            } else {
                word.to_string()
            }
        })
        .collect::<Vec<_>>()
        .join(" ")
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn every_row_passes_and_the_page_shows_what_is_printed() {
    let out = run(&elf(), &jumpers(&[]).expect("known"), true, |line| println!("{line}")).expect("runs");
    let rows = out.rows();
    let failed: Vec<_> = rows.iter().filter(|r| !r.pass).collect();
    assert!(rows.len() == 26 && failed.is_empty(), "{failed:?}");
    let printed: Vec<String> = out.log.iter().map(|l| without_numbers(l)).collect();
    let page = page();
    let shown: Vec<&str> = page.lines().map(str::trim).filter(|l| l.starts_with("INFO ")).collect();
    for line in &shown {
        let line = without_numbers(line);
        assert!(printed.contains(&line), "docs/bring-up.md shows a line that is not printed: {line}");
    }
    // Each row is shown, and the first lines.
    assert!(shown.len() >= rows.len() + 3, "{}", shown.len());
    for row in &rows {
        assert!(shown.iter().any(|l| l.contains(&row.name)), "docs/bring-up.md does not show: {}", row.name);
    }
}

#[test]
fn the_page_has_the_jumpers_of_the_board() {
    let page = page();
    for (from, to) in JUMPERS {
        assert!(page.lines().any(|l| l.starts_with('|') && l.contains(&format!("| {from} | {to} |"))), "{from} {to}");
    }
}

/// The run without some jumpers: every row that names one of them fails.
fn without(elf: &[u8], gone: &[&str]) {
    let left = jumpers(gone).expect("known");
    let out = run(elf, &left, false, |_| {}).unwrap_or_else(|e| panic!("without {gone:?}: {e}"));
    let rows = out.rows();
    println!("without {gone:?}: {} rows fail", rows.iter().filter(|r| !r.pass).count());
    for gone in gone {
        let named: Vec<_> = rows.iter().filter(|r| r.name.contains(gone)).collect();
        // (Bad frames there are none where none come.)
        let wrong: Vec<_> = named.iter().filter(|r| r.pass && !r.name.ends_with("bad frames")).collect();
        assert!(!named.is_empty() && wrong.is_empty(), "without {gone}: {wrong:?}");
    }
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_missing_jumper_fails_every_row_that_names_it() {
    let elf = elf();
    let names = JUMPERS.map(|(from, to)| format!("{from}-{to}"));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    // Two at a time: one of the ADC's six, and one of another part.
    let (adc, others) = (&names[3..9], [0, 1, 2, 9, 10, 11].map(|k| names[k]));
    for (adc, other) in adc.iter().zip(others) {
        without(&elf, &[adc, other]);
    }
    assert!(jumpers(&["PB9-PA1"]).is_err());
}

/// Registers: where, what is changed, what the sentence says.
#[test]
#[ignore = "cargo xtask test --rest"]
fn a_jumper_carries_a_signal_only_if_both_ends_are_set_for_it() {
    let elf = elf();
    for (address, clear, set, says) in [
        // GPIOB_MODER: PB9 an input.
        (0x4002_0400, 3 << 18, 0, "TIM4_CH4 does not pass PB9"),
        // GPIOA_AFRH: PA8 on function 7.
        (0x4002_0024, 0xF, 7, "TIM1_CH1 does not pass PA8: GPIOA_AFR has alternate function 7"),
        // GPIOC_OTYPER: PC9 open drain.
        (0x4002_0804, 0, 1 << 9, "TIM8_CH4 never goes high: PC9 is open drain"),
        // TIM8_BDTR: MOE off.
        (0x4001_0444, 1 << 15, 0, "TIM8_BDTR.MOE is 0"),
        // GPIOB_MODER: PB13 analog.
        (0x4002_0400, 0, 3 << 26, "SPI2_SCK does not pass PB13"),
        // SPI2_CR1: CPHA off.
        (0x4000_3800, 1, 0, "SPI2_CR1.CPHA and CPOL are not the master's"),
        // UART5_BRR: half the rate.
        (0x4000_5008, 0xFFFF, 98, "UART5_BRR makes"),
        // RCC_APB1ENR: UART5 without a clock.
        (0x4002_3840, 1 << 20, 0, "UART5 is not clocked"),
    ] {
        let mut board = Board::new(&elf, NothingConnected).expect("it fits");
        board.join(&jumpers(&[]).expect("known")).expect("room");
        board.run_until(CPU_HZ).expect("runs");
        let value = board.read_register(address).expect("there");
        let changed = board.write_register(address, value & !clear | set);
        let end = changed.and_then(|()| board.run_until(CPU_HZ + CPU_HZ / 4).map(drop));
        let error = end.expect_err(says).to_string();
        println!("{error}");
        assert!(error.contains(says), "{error}");
    }
}
