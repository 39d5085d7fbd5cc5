//! The log: ELF files, raw defmt streams, and lines of text.
#![no_main]

use hrg_cal::unit::log::Decoder;
use hrg_cal::unit::record::{unit_in_log, Second};
use hrg_cal::unit::sensors::Lines;
use libfuzzer_sys::fuzz_target;
use std::cell::RefCell;

thread_local! {
    /// The firmware's own ELF, where `cargo xtask fuzz` says it is.
    static ELF: RefCell<Option<Vec<u8>>> = RefCell::new(std::env::var_os("HRG_ELF").and_then(|p| std::fs::read(p).ok()));
    static STREAM: RefCell<Option<Decoder>> = ELF.with_borrow(|e| RefCell::new(e.as_ref().and_then(|e| Decoder::new(e).ok())));
}

fuzz_target!(|data: &[u8]| {
    let _ = Decoder::new(data);
    STREAM.with_borrow_mut(|s| {
        if let Some(decoder) = s {
            for line in decoder.push(data) {
                let _ = Second::from_log(&line);
            }
        }
    });
    if let Ok(text) = std::str::from_utf8(data) {
        let mut sensors = Lines::default();
        for line in text.lines() {
            let _ = sensors.take(line);
            let _ = (Second::from_log(line), unit_in_log(line));
        }
    }
});
