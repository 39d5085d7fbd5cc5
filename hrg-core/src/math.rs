//! Sine and cosine of angles of some turns, the same to the last bit on desktop and unit. All other functions are `libm`'s.
//!
//! With `libm::sincos` and `sincosf` in their place the unit's program takes 136836 bytes of flash instead of 127764, more than
//! the bound of 131072 (`cargo xtask size`): they reduce arguments of any size, and the one of singles computes in doubles, in
//! software. The functions here take angles up to a thousand turns, in the arithmetic of their type, and are good to two units in
//! the last place (test `as_libm`).
//!
//! # Example
//! ```
//! use hrg_core::math::{double, single};
//!
//! let (sine, cosine) = double::sin_cos(core::f64::consts::FRAC_PI_2);
//! assert!((sine - 1.0).abs() < 1e-15 && cosine.abs() < 1e-15);
//! assert!(single::sin_cos(1e9).0.is_nan(), "beyond a thousand turns");
//! ```

/// Reciprocals of 3!, 5!, ... with the signs of the sine's series, last first.
const SINE: [f64; 8] = [
    1.0 / 355_687_428_096_000.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    -1.0 / 5_040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];
/// The same of 2!, 4!, ... for the cosine.
const COSINE: [f64; 8] = [
    1.0 / 20_922_789_888_000.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 479_001_600.0,
    -1.0 / 3_628_800.0,
    1.0 / 40_320.0,
    -1.0 / 720.0,
    1.0 / 24.0,
    -1.0 / 2.0,
];

macro_rules! functions {
    ($module:ident, $type:ty, terms $terms:expr, quarter $quarter:expr) => {
        #[doc = concat!("In `", stringify!($type), "`.\n\n# Example\n```\nuse hrg_core::math::", stringify!($module), "::sin_cos;\n\nassert_eq!(sin_cos(0.0), (0.0, 1.0));\n```")]
        pub mod $module {
            /// Sine and cosine of an angle, rad; NaN beyond 6283 rad.
            #[must_use]
            pub fn sin_cos(x: $type) -> ($type, $type) {
                if !(x.abs() <= 6283.0) {
                    return (<$type>::NAN, <$type>::NAN);
                }
                // To the nearest quarter of a turn, which is given in parts of few digits: their multiples are exact.
                let quarters = nearest(x * (2.0 / core::f64::consts::PI) as $type);
                let mut r = x;
                for part in $quarter {
                    r -= quarters * part;
                }
                let z = r * r;
                let (mut s, mut c): ($type, $type) = (0.0, 0.0);
                for k in 8 - $terms..8 {
                    s = s * z + super::SINE[k] as $type;
                    c = c * z + super::COSINE[k] as $type;
                }
                let (s, c) = (r + r * (z * s), 1.0 + z * c);
                match quarters as i32 & 3 {
                    0 => (s, c),
                    1 => (c, -s),
                    2 => (-s, -c),
                    _ => (-c, s),
                }
            }

            /// Nearest whole number of one that is small.
            #[inline]
            fn nearest(x: $type) -> $type {
                (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i32 as $type
            }
        }
    };
}

functions!(
    single, f32, terms 5,
    quarter [1.570_312_5f32, 4.837_513e-4, 7.549_79e-8]
);
functions!(
    double, f64, terms 8,
    quarter [1.570_796_326_734_125_6f64, 6.077_100_506_506_192e-11]
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_libm() {
        // Worst deviations in units of the last place of one (sines near zero are smaller than that).
        let mut worst = [0.0f64; 2];
        for k in -400_000..=400_000i32 {
            let x = f64::from(k) * 1.234_567e-3 * if k % 7 == 0 { 12.0 } else { 1.0 };
            let (s, c) = double::sin_cos(x);
            let (ls, lc) = libm::sincos(x);
            worst[0] = worst[0].max((s - ls).abs().max((c - lc).abs()) / f64::EPSILON);
            let y = x as f32;
            let (s, c) = single::sin_cos(y);
            let (ls, lc) = libm::sincos(f64::from(y));
            let off = (f64::from(s) - ls).abs().max((f64::from(c) - lc).abs());
            worst[1] = worst[1].max(off / f64::from(f32::EPSILON));
        }
        assert!(worst.iter().all(|w| *w < 2.0), "{worst:?}");
    }

    #[test]
    fn what_is_no_angle() {
        assert!(double::sin_cos(f64::NAN).0.is_nan() && double::sin_cos(1e9).1.is_nan());
        assert!(single::sin_cos(f32::INFINITY).0.is_nan() && single::sin_cos(-1e6).1.is_nan());
        assert_eq!((double::sin_cos(0.0), single::sin_cos(0.0)), ((0.0, 1.0), (0.0, 1.0)));
    }
}
