//! Errors of the two horizontal accelerometers (chen2015, eq 2), taken out of the velocities of an alignment.
//!
//! `a = b + M A`: `A` is what there is along axes 1 and 2, `a` what the two read. Found by `hrg align accelerometers`, kept in the
//! calibration, the same in the unit's align mode and on the desktop. The vertical accelerometer takes no part.
//!
//! # Example
//! ```
//! use hrg_core::accelerometers::Accelerometers;
//!
//! let a = Accelerometers { bias_mps2: [1e-3, 0.0], ..Accelerometers::IDEAL };
//! assert!(a.possible());
//! // After ten seconds at rest the first has read 0.01 m/s, all of it bias.
//! assert!(a.correct([0.01, 0.0], 10.0)[0].abs() < 1e-9);
//! ```

use crate::schema::layout;

/// One g, m/s^2.
pub const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;

/// Acceleration of one code of the ADC, m/s^2: two g at the end of 24 bits.
pub const MPS2_PER_CODE: f64 = 2.0 * STANDARD_GRAVITY_MPS2 / 8_388_608.0;

/// Scale and cross-axis beyond these are no accelerometer's, but a wrong column.
pub const ODDEST: f32 = 0.2;
/// Biases beyond this are no accelerometer's, m/s^2.
pub const LARGEST_BIAS_MPS2: f32 = 1.0;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accelerometers {
    /// Readings at rest and level, m/s^2.
    pub bias_mps2: [f32; 2],
    /// Rows: what accelerometer 1 and 2 read for an acceleration along axis 1 and along axis 2.
    pub matrix: [[f32; 2]; 2],
}
layout! { Accelerometers {
    bias_mps2: [f32; 2], "readings at rest and level, m/s^2";
    matrix: [[f32; 2]; 2], "rows: what accelerometer 1 and 2 read for an acceleration along axis 1 and along axis 2";
} }

impl Default for Accelerometers {
    fn default() -> Self {
        Self::IDEAL
    }
}

impl Accelerometers {
    /// Without errors: what an image means that says nothing of them.
    pub const IDEAL: Self = Self { bias_mps2: [0.0; 2], matrix: [[1.0, 0.0], [0.0, 1.0]] };

    /// `true` if the matrix and the biases are within the limits of an accelerometer.
    #[must_use]
    pub fn possible(&self) -> bool {
        let [[a, b], [c, d]] = self.matrix;
        [a - 1.0, b, c, d - 1.0].iter().all(|e| e.abs() < ODDEST)
            && self.bias_mps2.iter().all(|b| b.abs() < LARGEST_BIAS_MPS2)
    }

    /// The velocity that there was, m/s, from the one that was read `time_s` after it began at zero.
    #[must_use]
    pub fn correct(&self, read_mps: [f64; 2], time_s: f64) -> [f64; 2] {
        let [[a, b], [c, d]] = self.matrix.map(|row| row.map(f64::from));
        let [first, second] = self.bias_mps2;
        let w = [read_mps[0] - f64::from(first) * time_s, read_mps[1] - f64::from(second) * time_s];
        let determinant = a * d - b * c;
        [(d * w[0] - b * w[1]) / determinant, (a * w[1] - c * w[0]) / determinant]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_read_becomes_what_there_was() {
        let a = Accelerometers { bias_mps2: [2e-4, -3e-4], matrix: [[1.02, 0.003], [-0.002, 0.98]] };
        let (there, t) = ([0.31, -0.17], 40.0);
        let read = [0, 1].map(|k: usize| {
            f64::from(a.bias_mps2[k]) * t + (0..2).map(|j| f64::from(a.matrix[k][j]) * there[j]).sum::<f64>()
        });
        let again = a.correct(read, t);
        assert!((0..2).all(|k| (again[k] - there[k]).abs() < 1e-15), "{again:?}");
        assert_eq!(Accelerometers::IDEAL.correct(read, t), read, "without errors nothing changes, to the bit");
    }

    #[test]
    fn what_no_accelerometer_is_is_not_possible() {
        assert!(Accelerometers::IDEAL.possible());
        for (bias_mps2, matrix) in [
            ([0.0; 2], [[0.0, 1.0], [1.0, 0.0]]),
            ([0.0; 2], [[f32::NAN, 0.0], [0.0, 1.0]]),
            ([0.0, 9.8], Accelerometers::IDEAL.matrix),
        ] {
            assert!(!Accelerometers { bias_mps2, matrix }.possible(), "{bias_mps2:?} {matrix:?}");
        }
    }
}
