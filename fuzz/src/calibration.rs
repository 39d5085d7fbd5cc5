//! Calibrations, as image and as text: what is accepted is the same there and back, and a unit that runs it stays finite.

use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;

fn fly(c: &Calibration) {
    let mut unit = Compensator::new(c.clone(), 0.0);
    for k in 0..80u32 {
        let f = f64::from(k) * 0.05;
        let lost = k % 17 == 3;
        let frequency = [(!lost).then_some(4900.0 + f), Some(4892.0 - f), Some(if k == 40 { 1e9 } else { 4703.6 })];
        let out = unit.step(&frequency);
        assert!(out.bias_dph.iter().all(|b| b.is_finite()), "{:?}", out);
    }
}

/// Takes an input; it panics where something promised does not hold.
pub fn run(data: &[u8]) {
    // The fuzzer does not guess checksums: the last four bytes are made right.
    let mut image = data.to_vec();
    if image.len() > 12 {
        let end = image.len() - 4;
        image[6..8].copy_from_slice(&(data.len() as u16).to_le_bytes());
        let crc = hrg_core::bytes::crc32(&image[..end]).to_le_bytes();
        image[end..].copy_from_slice(&crc);
    }
    if let Ok(c) = Calibration::from_bytes(&image) {
        let again = c.to_bytes().expect("what was read can be written");
        assert_eq!(Calibration::from_bytes(&again).as_ref(), Ok(&c));
        fly(&c);
    }
    if let Ok(text) = std::str::from_utf8(data) {
        if let Ok(c) = hrg_data::image_file::from_text(text) {
            let again =
                hrg_data::image_file::from_text(&hrg_data::image_file::to_text(&c)).expect("what we write we read");
            assert_eq!(again.to_bytes(), c.to_bytes());
            fly(&c);
        }
    }
}
