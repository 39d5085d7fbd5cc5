//! The firmware for the STM32F405RG, as it is flashed, on the virtual board with that chip.

use hrg_board::replay::{self, default_elf, read_elf, Options};
use hrg_data::recording::steps::Steps;
use hrg_data::recording::Recording;
use std::path::Path;
use virtual_board::part::STM32F405RG;
use virtual_board::{Board, NothingConnected, CPU_HZ};

/// `cargo xtask test` and `cargo xtask size --stm32f405rg` build it there.
fn elf() -> Vec<u8> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/stm32f405rg/thumbv7em-none-eabihf/firmware/firmware");
    read_elf(Path::new(path)).expect("cargo xtask size --stm32f405rg builds it")
}

fn steps() -> Steps {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/recordings/simulated-ramp.csv"));
    Steps::new(&Recording::load(path).expect("usable")).expect("long enough")
}

/// The stamps are those of a timer at 84 MHz in the place of 90, so frequencies differ from those of the STM32F446 in their last digits. Given
/// its own stamps, every frame equals that of the desktop bit for bit; and the corrected rates of the two chips are the same within that.
#[test]
#[ignore = "cargo xtask test --rest"]
fn its_program_runs_to_corrected_rates_and_every_frame_is_that_of_the_desktop() {
    let options = Options { seconds: Some(60), part: &STM32F405RG, ..Options::default() };
    let o = replay::run(&elf(), None, &steps(), &options, |_| {}).expect("the board models all that it does");
    let r = &o.received;
    assert_eq!(r.differing, 0, "{:?}", r.first_difference);
    assert_eq!((o.watchdog_resets, r.bad_frames), (0, 0));
    let other = replay::run(
        &read_elf(&default_elf()).expect("built"),
        None,
        &steps(),
        &Options { seconds: Some(60), ..Options::default() },
        |_| {},
    )
    .expect("runs");
    let pairs = r.housekeeping.iter().zip(&other.received.housekeeping);
    let mut most = 0.0f64;
    for (a, b) in pairs.clone() {
        for (f, g) in a.frequency_hz.iter().zip(b.frequency_hz) {
            most = most.max((f - g).abs());
        }
    }
    println!(
        "{} rate frames, {} housekeeping frames; frequencies differ by {most:.1e} Hz at most",
        r.rates.len(),
        pairs.len()
    );
    assert!(r.rates.len() > 11_000 && pairs.len() >= 58, "{} {}", r.rates.len(), pairs.len());
    // The same edges, rounded to other ticks: a hundredth of a tick (0.1 ns) over the regression's second.
    assert!(most < 1e-4, "{most} Hz");
}

#[test]
#[ignore = "cargo xtask test --rest"]
fn a_program_for_the_other_chip_ends_the_run() {
    let f446 = read_elf(&default_elf()).expect("built");
    let mut board = Board::on(&STM32F405RG, &f446, NothingConnected).expect("it fits");
    let error = board.run_until(CPU_HZ).expect_err("it does not run").to_string();
    println!("{error}");
    assert!(error.contains("up to 168 MHz") || error.contains("PLL"), "{error}");
}
