//! The link: any bytes in, and whatever comes out of them carried out by the maintenance mode. The newest image is never erased, nor
//! is anything programmed where the flash is not erased.

use hrg_core::calibration::Calibration;
use hrg_core::link::{Deframer, Message};
use hrg_core::maintenance::Maintenance;
use hrg_core::sectors::Store;
use hrg_core::sectors::{sequences, Place, Sector};

/// Sectors of 8 KiB: soon full.
struct Flash([[u8; 8192]; 2]);

impl hrg_core::update::Store for Flash {}

impl Store for Flash {
    fn erase(&mut self, sector: Sector) -> bool {
        let newest = sequences(&self.0[0], &self.0[1], None).newest;
        assert!(newest.is_some_and(|(_, place)| place.sector != sector), "the newest image");
        self.0[usize::from(sector.number())].fill(0xFF);
        true
    }
    fn write(&mut self, at: Place, bytes: &[u8]) -> bool {
        let from = at.offset as usize;
        assert!(from.is_multiple_of(4) && bytes.len().is_multiple_of(4));
        let place = &mut self.0[usize::from(at.sector.number())][from..from + bytes.len()];
        assert!(place.iter().all(|b| *b == 0xFF), "programmed twice");
        place.copy_from_slice(bytes);
        true
    }
    fn view(&self, sector: Sector) -> &[u8] {
        &self.0[usize::from(sector.number())]
    }
}

fn execute(m: &Message, mode: &mut Maintenance, flash: &mut Flash) {
    let wire = m.encode();
    // Equal as bytes: a NaN in a field is not equal to itself.
    let again = Message::decode(&wire[..wire.len() - 1]).expect("what we send we read");
    assert_eq!(again.encode(), wire);
    if let Message::Maintain(command) = m {
        let _ = mode.command(command, flash);
    }
}

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    let mut flash = Flash([[0xFF; 8192]; 2]);
    let image = Calibration::uncalibrated();
    let bytes = image.to_bytes().expect("fits");
    flash.0[0][..bytes.len()].copy_from_slice(&bytes);
    let mut mode = Maintenance::new(image.unit, 0, Some(Place { sector: Sector::A, offset: 0 }), false);
    let mut deframer = Deframer::default();
    for &byte in data {
        if let Some(Ok(m)) = deframer.push(byte) {
            execute(&m, &mut mode, &mut flash);
        }
    }
    // The fuzzer does not guess checksums either: pieces between zeros are taken for a type and its fields.
    for plain in data.split(|b| *b == 0xA7) {
        let mut frame = plain.to_vec();
        frame.extend(hrg_core::bytes::crc32(plain).to_le_bytes());
        let mut wire = vec![0; frame.len() + frame.len() / 254 + 2];
        let n = cobs(&frame, &mut wire);
        if let Ok(m) = Message::decode(&wire[..n]) {
            execute(&m, &mut mode, &mut flash);
        }
    }
    assert!(sequences(&flash.0[0], &flash.0[1], None).newest.is_some(), "always a valid image");
}

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
