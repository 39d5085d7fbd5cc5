//! Numbers of half a single's length: its upper sixteen bits. As wide a range, and 0.4 % of a number: enough for what states how
//! uncertain another number is.
//!
//! # Example
//! ```
//! use hrg_core::half::Half;
//!
//! let half = Half::of(0.1);
//! assert!((half.value() / 0.1 - 1.0).abs() < 0.004);
//! assert_eq!(Half::from_bits(half.bits()), half);
//! ```

/// The upper half of an `f32`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Half(u16);

impl Half {
    /// Zero.
    pub const ZERO: Self = Self(0);

    /// The nearest one; what is not a number stays none.
    #[must_use]
    pub const fn of(v: f32) -> Self {
        let bits = v.to_bits();
        if v.is_nan() {
            return Self((bits >> 16) as u16 | 0x40);
        }
        Self((bits.wrapping_add(0x7FFF + (bits >> 16 & 1)) >> 16) as u16)
    }

    /// From the bits that [`bits`](Self::bits) gives.
    #[must_use]
    pub const fn from_bits(bits: u16) -> Self {
        Self(bits)
    }

    /// Its bits.
    #[must_use]
    pub const fn bits(self) -> u16 {
        self.0
    }

    /// Its value.
    #[inline]
    #[must_use]
    pub const fn value(self) -> f32 {
        f32::from_bits((self.0 as u32) << 16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_taken() {
        for v in [0.0, 1.0, -2.5, 3.1e-7, 6.02e23, -1.234_567] {
            let h = Half::of(v);
            assert!((h.value() - v).abs() <= v.abs() / 256.0, "{v} {}", h.value());
            assert_eq!(Half::of(h.value()), h);
            assert_eq!(Half::from_bits(h.bits()), h);
        }
        assert!(Half::of(f32::NAN).value().is_nan() && Half::of(f32::INFINITY).value().is_infinite());
        assert_eq!(Half::of(1.0 + 1.0 / 128.0).value(), 1.0 + 1.0 / 128.0);
        assert_eq!(Half::of(1.002).value(), 1.0);
        assert_eq!(Half::of(1.006).value(), 1.0 + 1.0 / 128.0);
    }
}
