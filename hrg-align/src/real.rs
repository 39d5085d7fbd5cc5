//! Single and double precision under one name: the unit runs in `f32`, `f64` is the yardstick. Functions
//! of `libm` and the sine of [`hrg_core::math`], on both sides.
//!
//! # Example
//! ```
//! use hrg_align::real::{cholesky, identity, product};
//!
//! let root = cholesky(&[[4.0, 2.0], [2.0, 5.0]]).expect("positive");
//! assert_eq!(root, [[2.0, 0.0], [1.0, 2.0]]);
//! assert_eq!(product(&root, &identity()), root);
//! // A matrix that is no covariance has none.
//! assert_eq!(cholesky(&[[1.0f64, 2.0], [2.0, 1.0]]), None);
//! ```

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};
use hrg_core::math::{double, single};

/// A floating-point number.
pub trait Real:
    Copy
    + Debug
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// Zero, where a constant is needed.
    const ZERO: Self;
    /// Rounded from double precision.
    fn of(value: f64) -> Self;
    /// In double precision.
    fn f64(self) -> f64;
    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);
    /// Angle of a point.
    fn atan2(self, x: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;
    /// Neither infinite nor NaN.
    fn is_finite(self) -> bool;
    /// Zero.
    fn zero() -> Self {
        Self::ZERO
    }
    /// One.
    fn one() -> Self {
        Self::of(1.0)
    }
}

macro_rules! real {
    ($type:ty, $sin_cos:path, $atan2:path, $sqrt:path, $ln:path, $exp:path) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            #[inline]
            fn of(value: f64) -> Self {
                value as $type
            }
            #[inline]
            fn f64(self) -> f64 {
                f64::from(self)
            }
            #[inline]
            fn sin_cos(self) -> (Self, Self) {
                $sin_cos(self)
            }
            #[inline]
            fn atan2(self, x: Self) -> Self {
                $atan2(self, x)
            }
            #[inline]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline]
            fn ln(self) -> Self {
                $ln(self)
            }
            #[inline]
            fn exp(self) -> Self {
                $exp(self)
            }
            #[inline]
            fn is_finite(self) -> bool {
                <$type>::is_finite(self)
            }
        }
    };
}

real!(f32, single::sin_cos, libm::atan2f, libm::sqrtf, libm::logf, libm::expf);
real!(f64, double::sin_cos, libm::atan2, libm::sqrt, libm::log, libm::exp);

/// A square matrix, row by row.
pub type Matrix<T, const N: usize> = [[T; N]; N];

/// All zeros.
pub fn zeros<T: Real, const N: usize>() -> Matrix<T, N> {
    [[T::zero(); N]; N]
}

/// Ones on the diagonal.
pub fn identity<T: Real, const N: usize>() -> Matrix<T, N> {
    let mut m = zeros();
    for (i, row) in m.iter_mut().enumerate() {
        row[i] = T::one();
    }
    m
}

/// `a b`.
pub fn product<T: Real, const N: usize>(a: &Matrix<T, N>, b: &Matrix<T, N>) -> Matrix<T, N> {
    let mut out = zeros();
    for i in 0..N {
        for j in 0..N {
            let mut sum = T::zero();
            for k in 0..N {
                sum += a[i][k] * b[k][j];
            }
            out[i][j] = sum;
        }
    }
    out
}

/// `a p a^T` of a symmetric `p`; exactly symmetric.
pub fn congruence<T: Real, const N: usize>(a: &Matrix<T, N>, p: &Matrix<T, N>) -> Matrix<T, N> {
    let half = product(a, p);
    let mut out = zeros();
    for i in 0..N {
        // (A range to `i` would leave checks of `j` behind.)
        for j in 0..N {
            if j > i {
                break;
            }
            let mut sum = T::zero();
            for k in 0..N {
                sum += half[i][k] * a[j][k];
            }
            out[i][j] = sum;
            out[j][i] = sum;
        }
    }
    out
}

/// Lower-triangular `l` with `l l^T = p`; `None` where `p` is not positive definite.
pub fn cholesky<T: Real, const N: usize>(p: &Matrix<T, N>) -> Option<Matrix<T, N>> {
    let mut l = zeros::<T, N>();
    for i in 0..N {
        for j in 0..=i {
            let mut sum = p[i][j];
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            if i == j {
                if !(sum > T::zero()) {
                    return None;
                }
                l[i][i] = sum.sqrt();
            } else {
                l[i][j] = sum / l[j][j];
            }
        }
    }
    Some(l)
}

/// `exp(f dt)` to third order: enough for steps of a second of a platform that turns with the earth.
pub fn transition<T: Real, const N: usize>(f: &Matrix<T, N>, dt: T) -> Matrix<T, N> {
    let mut scaled = *f;
    scaled.iter_mut().flatten().for_each(|x| *x = *x * dt);
    let second = product(&scaled, &scaled);
    let third = product(&second, &scaled);
    let mut out = identity::<T, N>();
    for i in 0..N {
        for j in 0..N {
            out[i][j] += scaled[i][j] + second[i][j] * T::of(0.5) + third[i][j] * T::of(1.0 / 6.0);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cholesky_is_a_root_and_refuses_what_has_none() {
        let p = [[4.0, 2.0, 0.6], [2.0, 5.0, 1.0], [0.6, 1.0, 3.0]];
        let l = cholesky(&p).expect("positive");
        let again = congruence(&l, &identity());
        for i in 0..3 {
            for j in 0..3 {
                let difference: f64 = again[i][j] - p[i][j];
                assert!(difference.abs() < 1e-12);
            }
        }
        assert!(cholesky(&[[1.0, 2.0], [2.0, 1.0]]).is_none());
        assert!(cholesky(&[[f32::NAN]]).is_none());
    }
}
