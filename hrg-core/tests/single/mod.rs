//! Numbers in single precision: every bit pattern, and the corners among them.

use proptest::prelude::*;

/// Corners of single precision.
pub const CORNERS: [f32; 16] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MIN_POSITIVE,
    1e-45,
    -1e-45,
    f32::MAX,
    f32::MIN,
    1e30,
    -1e30,
    16_777_216.0,
    f32::EPSILON,
];

/// Corners, and every bit pattern.
pub fn single() -> impl Strategy<Value = f32> {
    prop_oneof![
        1 => proptest::sample::select(&CORNERS[..]),
        2 => any::<u32>().prop_map(f32::from_bits),
        1 => -100f32..100.0,
    ]
}
