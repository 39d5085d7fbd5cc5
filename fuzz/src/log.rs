//! The log: ELF files, raw defmt streams, and lines of text.

use hrg::unit::record::{unit_in_log, Second};
use hrg::unit::sensors::Lines;
use hrg_data::log::Decoder;
use std::cell::RefCell;

/// Path of the ELF, seen from this package and from the tests.
const BUILT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../target/thumbv7em-none-eabihf/firmware/firmware");

thread_local! {
    /// The firmware's own ELF, where it is built.
    static ELF: RefCell<Option<Vec<u8>>> = RefCell::new(std::fs::read(BUILT).ok());
    static STREAM: RefCell<Option<Decoder>> = ELF.with_borrow(|e| RefCell::new(e.as_ref().and_then(|e| Decoder::new(e).ok())));
}

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    let _ = Decoder::new(data);
    STREAM.with_borrow_mut(|s| {
        if let Some(decoder) = s {
            for line in decoder.push(data) {
                let _ = Second::from_log(&line);
            }
        }
    });
    if let Ok(text) = std::str::from_utf8(data) {
        let mut sensors = Lines::of(hrg::unit::sensors::names());
        for line in text.lines() {
            let _ = sensors.take(line);
            let _ = (Second::from_log(line), unit_in_log(line));
        }
    }
}
