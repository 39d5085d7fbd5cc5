//! The link: any bytes in, and whatever comes out of them obeyed by the maintenance mode. The sector in use is never touched.
#![no_main]

use hrg_core::calibration::{Calibration, MAX_BYTES};
use hrg_core::link::{Deframer, Message};
use hrg_core::maintenance::{Maintenance, Store};
use hrg_core::sectors::Sector;
use libfuzzer_sys::fuzz_target;

struct Flash([[u8; MAX_BYTES]; 2]);

impl Store for Flash {
    fn erase(&mut self, sector: Sector) -> bool {
        assert_eq!(sector, Sector::B, "the sector in use");
        self.0[1].fill(0xFF);
        true
    }
    fn write(&mut self, sector: Sector, offset: u16, bytes: &[u8]) -> bool {
        assert_eq!(sector, Sector::B, "the sector in use");
        assert!(offset % 4 == 0 && bytes.len() % 4 == 0);
        self.0[1][usize::from(offset)..usize::from(offset) + bytes.len()].copy_from_slice(bytes);
        true
    }
    fn view(&self, sector: Sector) -> &[u8] {
        &self.0[usize::from(sector.number())]
    }
}

fn obey(m: &Message, mode: &mut Maintenance, flash: &mut Flash) {
    let wire = m.encode();
    // Equal as bytes: a NaN in a field is not equal to itself.
    let again = Message::decode(&wire[..wire.len() - 1]).expect("what we send we read");
    assert_eq!(again.encode(), wire);
    if let Message::Maintain(command) = m {
        let _ = mode.command(command, flash);
    }
}

fuzz_target!(|data: &[u8]| {
    let mut flash = Flash([[0xFF; MAX_BYTES]; 2]);
    let image = Calibration::uncalibrated();
    let mut mode = Maintenance::new(image.unit, 0, Some(Sector::A), false);
    let mut deframer = Deframer::default();
    for &byte in data {
        if let Some(Ok(m)) = deframer.push(byte) {
            obey(&m, &mut mode, &mut flash);
        }
    }
    // The fuzzer does not guess checksums either: pieces between zeros are taken for a type and its fields.
    for plain in data.split(|b| *b == 0xA7) {
        let mut frame = plain.to_vec();
        frame.extend(hrg_core::bytes::crc32(plain).to_le_bytes());
        let mut wire = vec![0; frame.len() + frame.len() / 254 + 2];
        let n = cobs(&frame, &mut wire);
        if let Ok(m) = Message::decode(&wire[..n]) {
            obey(&m, &mut mode, &mut flash);
        }
    }
});

/// COBS, written down once more so that the fuzzed code does not check itself.
fn cobs(plain: &[u8], out: &mut [u8]) -> usize {
    let (mut code_at, mut at, mut code) = (0, 1, 1u8);
    for &b in plain {
        if b != 0 {
            out[at] = b;
            at += 1;
            code += 1;
        }
        if b == 0 || code == 0xFF {
            out[code_at] = code;
            code_at = at;
            at += 1;
            code = 1;
        }
    }
    out[code_at] = code;
    at
}
