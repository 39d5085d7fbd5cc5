//! Sine, cosine, arctangent and root for angles of some turns, the same to the last bit on desktop and unit.
//!
//! `libm` has them, too: but its sine reduces arguments of any size, which takes 5 KiB of the unit's flash, and in single
//! precision it computes in double, which the unit has to do in software. The functions here take angles up to a thousand turns,
//! in the arithmetic of their type, and are good to two units in the last place (test `as_libm`). Everything else is `libm`'s.

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
    ($module:ident, $type:ty, terms $terms:expr, quarter $quarter:expr, root $root:expr, $steps:expr) => {
        #[doc = concat!("In `", stringify!($type), "`.")]
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

            /// Angle of the point (x, y) from the x axis, rad, -pi to pi; 0 at the origin.
            #[must_use]
            pub fn atan2(y: $type, x: $type) -> $type {
                use core::f64::consts::{FRAC_PI_2, PI};
                let (small, large) = if y.abs() < x.abs() { (y.abs(), x.abs()) } else { (x.abs(), y.abs()) };
                if large == 0.0 {
                    return 0.0;
                }
                // Good to 0.004 rad.
                let t = small / large;
                let mut angle = t * (1.058_4 - 0.273 * t);
                if y.abs() >= x.abs() {
                    angle = FRAC_PI_2 as $type - angle;
                }
                if x < 0.0 {
                    angle = PI as $type - angle;
                }
                if y < 0.0 {
                    angle = -angle;
                }
                // The tangent of what is missing, and its arctangent by three terms.
                let (s, c) = sin_cos(angle);
                let (x, y) = (x / large, y / large);
                let e = (y * c - x * s) / (x * c + y * s);
                let z = e * e;
                angle + e * (1.0 - z * ((1.0 / 3.0) as $type - z * (0.2 as $type)))
            }

            /// Square root: NaN of a negative number.
            #[must_use]
            pub fn sqrt(x: $type) -> $type {
                if !(x > 0.0) || x == <$type>::INFINITY {
                    return if x < 0.0 { <$type>::NAN } else { x };
                }
                // Half the exponent: good to 4 %. Each of Heron's steps doubles the digits.
                let mut root = <$type>::from_bits((x.to_bits() >> 1) + $root);
                for _ in 0..$steps {
                    root = 0.5 * (root + x / root);
                }
                root
            }
        }
    };
}

functions!(
    single, f32, terms 5,
    quarter [1.570_312_5f32, 4.837_513e-4, 7.549_79e-8],
    root 0x1FBD_1DF5, 3
);
functions!(
    double, f64, terms 8,
    quarter [1.570_796_326_734_125_6f64, 6.077_100_506_506_192e-11],
    root 0x1FF7_A3BE_A91D_9B1B, 4
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_libm() {
        // Worst deviations in units of the last place of one (sines near zero are smaller than that).
        let (mut sine, mut tangent, mut root) = ([0.0f64; 2], [0.0f64; 2], [0.0f64; 2]);
        for k in -400_000..=400_000i32 {
            let x = f64::from(k) * 1.234_567e-3 * if k % 7 == 0 { 12.0 } else { 1.0 };
            let (s, c) = double::sin_cos(x);
            let (ls, lc) = libm::sincos(x);
            sine[0] = sine[0].max((s - ls).abs().max((c - lc).abs()) / f64::EPSILON);
            let y = x as f32;
            let (s, c) = single::sin_cos(y);
            let (ls, lc) = libm::sincos(f64::from(y));
            let off = (f64::from(s) - ls).abs().max((f64::from(c) - lc).abs());
            sine[1] = sine[1].max(off / f64::from(f32::EPSILON));
            let (a, b) = (ls * (1.0 + x.abs()), lc * (1.0 + x.abs()));
            let exact = libm::atan2(a, b);
            tangent[0] = tangent[0].max((double::atan2(a, b) - exact).abs() / f64::EPSILON);
            let off = (f64::from(single::atan2(a as f32, b as f32))
                - libm::atan2(f64::from(a as f32), f64::from(b as f32)))
            .abs();
            tangent[1] = tangent[1].max(off.min((off - 2.0 * core::f64::consts::PI).abs()) / f64::from(f32::EPSILON));
            let v = x.abs() + 1e-9;
            root[0] = root[0].max((double::sqrt(v) / libm::sqrt(v) - 1.0).abs() / f64::EPSILON);
            let w = v as f32;
            root[1] = root[1]
                .max((f64::from(single::sqrt(w)) / libm::sqrt(f64::from(w)) - 1.0).abs() / f64::from(f32::EPSILON));
        }
        for (name, worst, most) in [("sine", sine, 2.0), ("arctangent", tangent, 3.0), ("root", root, 2.0)] {
            assert!(worst.iter().all(|w| *w < most), "{name}: {worst:?}");
        }
    }

    #[test]
    fn what_is_no_angle_and_no_square() {
        assert!(double::sin_cos(f64::NAN).0.is_nan() && double::sin_cos(1e9).1.is_nan());
        assert!(double::sqrt(-1.0).is_nan() && double::sqrt(f64::NAN).is_nan());
        assert_eq!((double::sqrt(0.0), double::sqrt(f64::INFINITY)), (0.0, f64::INFINITY));
        assert_eq!(double::sqrt(4.0), 2.0);
        assert_eq!(double::atan2(0.0, 0.0), 0.0);
        assert!(double::atan2(f64::NAN, 1.0).is_nan());
        let pi = core::f64::consts::PI;
        for (y, x, angle) in [(0.0, 1.0, 0.0), (1.0, 0.0, 0.5 * pi), (0.0, -1.0, pi), (-1.0, 0.0, -0.5 * pi)] {
            assert!((double::atan2(y, x) - angle).abs() < 1e-15);
        }
    }
}
