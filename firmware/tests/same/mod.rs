//! Results of the core as checksums: the same on a desktop (`host-tests/tests/all/chip.rs`) and on the chip
//! (`firmware/tests/chip.rs`). Nothing here needs wires, clocks or an allocator.

use hrg_core::bytes::Digest;
use hrg_core::calibration::Calibration;
use hrg_core::compensator::Compensator;
use hrg_core::frequency::{Config, CounterBank};
use hrg_core::timebase::Timebase;
use hrg_core::{math, AXES};

/// Stored images of every kind of bias model, and the checksum of what each makes of [`frequencies`].
pub const IMAGES: [(&str, &[u8], u32); 6] = [
    ("default", include_bytes!("../../../hrg-core/tests/images/version-1-default.bin"), 0x626d_761c),
    ("effects", include_bytes!("../../../hrg-core/tests/images/version-1-effects.bin"), 0xc34c_93cc),
    ("models", include_bytes!("../../../hrg-core/tests/images/version-1-models.bin"), 0x8a5d_329f),
    ("uncertain", include_bytes!("../../../hrg-core/tests/images/version-1-uncertain.bin"), 0xa987_9808),
    ("accelerometers", include_bytes!("../../../hrg-core/tests/images/version-1-accelerometers.bin"), 0xa987_9808),
    ("rates", include_bytes!("../../../hrg-core/tests/images/version-1-rates.bin"), 0x639f_d85c),
];
/// Of [`functions`].
pub const FUNCTIONS: u32 = 0x97fd_5a41;
/// Of [`edges`].
pub const EDGES: u32 = 0x2d4f_2eb3;

/// Steps of the model.
const STEPS: u16 = 900;

/// Resonator frequencies of a unit that warms up, wavers and cools down, Hz. Every 97th is missing.
fn frequencies(step: u16) -> [Option<f64>; AXES] {
    let t = f64::from(step) / f64::from(STEPS);
    let wave = f64::from(step % 50) / 50.0 - 0.5;
    [4900.0, 4892.0, 4703.7].map(|f| (step % 97 != 96).then_some(f + 30.0 * t * (1.0 - t) + 0.01 * wave))
}

/// Checksum of the model of an image over the frequencies: every bias, temperature and ramp, and rates corrected with it, bit for bit. `None`: the
/// image does not load.
pub fn model(image: &[u8]) -> Option<u32> {
    let mut model = Compensator::new(Calibration::from_bytes(image).ok()?, 0.0);
    let mut sum = Digest::default();
    for step in 0..STEPS {
        let output = model.step(&frequencies(step));
        let corrected = output.factors.corrected_dph([1.0e4, -2.0e4, 3.0e4], output.bias_dph);
        for values in [corrected, output.temperature_c, output.ramp_c_per_min, output.bias_dph, output.bias_std_dph] {
            // (The kind of NaN differs between processors and carries no information.)
            let bits = values.map(|v| if v.is_nan() { f32::NAN } else { v }.to_bits());
            bits.iter().for_each(|b| sum.update(&b.to_le_bytes()));
        }
    }
    Some(sum.finish())
}

/// The functions that are not the compiler's own.
pub fn functions() -> u32 {
    let mut sum = Digest::default();
    for k in -400..400i16 {
        let x = f32::from(k) * 0.037;
        let (s, c) = math::single::sin_cos(x);
        for value in [s, c, libm::expf(x), libm::logf(x.abs() + 0.1), libm::tanhf(x), libm::sqrtf(x.abs())] {
            sum.update(&value.to_bits().to_le_bytes());
        }
        let x = f64::from(k) * 0.037;
        let (s, c) = math::double::sin_cos(x);
        for value in [s, c, libm::exp(x), libm::log(x.abs() + 0.1), libm::sqrt(x.abs())] {
            sum.update(&value.to_bits().to_le_bytes());
        }
    }
    sum.finish()
}

/// Frequencies of time stamps, over the end of a counter of 32 bits.
pub fn edges() -> u32 {
    let mut bank = CounterBank::new(Config::at(Timebase::at(90_000_000)), 10);
    let mut sum = Digest::default();
    let mut stamps = [u32::MAX - 400_000_000; AXES];
    for k in 0..30_000u32 {
        for (axis, stamp) in stamps.iter_mut().enumerate() {
            // About 4.9 kHz of 90 MHz, with a jitter of some ticks.
            *stamp = stamp.wrapping_add(18_367 + 30 * axis as u32 + (k.wrapping_mul(2_654_435_761) >> 30));
            bank.push(axis, [*stamp]);
        }
        if let Some(step) = bank.poll(stamps[0]) {
            for f in step.frequency_hz.into_iter().flatten() {
                sum.update(&f.to_bits().to_le_bytes());
            }
        }
    }
    sum.finish()
}

/// CRC-32/MPEG-2, bit by bit: what the CRC unit is compared with.
pub fn crc_32_mpeg_2(bytes: &[u8]) -> u32 {
    bytes.iter().fold(u32::MAX, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte) << 24, |s, _| s << 1 ^ if s >> 31 != 0 { 0x04C1_1DB7 } else { 0 })
    })
}
