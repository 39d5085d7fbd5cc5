//! The unit's own path: converter frames, time stamps, frequencies and codes as they please.
#![no_main]

use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::converter::{decode, WORDS};
use hrg_core::frequency::{Bank, Config, GATES_PER_STEP};
use hrg_core::rate_path::{RatePath, Staged, CHANNELS};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut bank = Bank::new(Config::REFERENCE, GATES_PER_STEP);
    let mut unit = Compensator::new(Calibration::uncalibrated(), 0.0);
    let mut path = RatePath::new([0.01; 3], 2);
    let mut now = 0u32;
    for chunk in data.chunks_exact(6) {
        let word = u32::from_le_bytes([chunk[2], chunk[3], chunk[4], chunk[5]]);
        match chunk[0] % 4 {
            0 => {
                // A train of edges with a period of its own.
                let axis = usize::from(chunk[1] % 4);
                let stamps: Vec<u32> =
                    (0..u32::from(chunk[1])).map(|k| now.wrapping_add(k.wrapping_mul(word >> 8))).collect();
                bank.push(axis, &stamps);
            }
            1 => {
                now = now.wrapping_add(word >> (chunk[1] % 32));
                if let Some(step) = bank.poll(now) {
                    let out = unit.update(&step);
                    assert!(out.bias_dph.iter().all(|b| b.is_finite()));
                    path.stage(Staged::new(&step, &out));
                }
            }
            2 => {
                let codes: [i32; CHANNELS] = std::array::from_fn(|k| (word.rotate_left(7 * k as u32) as i32) >> 8);
                let e = path.sample(now, codes);
                assert!(!e.upset);
                if let Some(f) = e.frame {
                    assert!(f.rate_dph.iter().all(|r| r.is_finite()));
                }
            }
            _ => {
                let _ = path.missing(now);
                bank.disturb(usize::from(chunk[1] % 4));
            }
        }
    }
    if let Some(frame) = data.first_chunk::<{ 4 * WORDS }>() {
        let _ = decode(&std::array::from_fn(|k| u32::from_le_bytes([0, 1, 2, 3].map(|n| frame[4 * k + n]))));
    }
});
