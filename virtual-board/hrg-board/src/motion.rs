//! Motions of a unit on the board's wires, in closed form: what its gyros and accelerometers see at each moment, through the ADC's own filter.

use std::f64::consts::PI;
use virtual_board::ads131m08::filter_weights;

/// Moments per sample time at which a motion is looked at.
const PER_SAMPLE: usize = 32;
const SAMPLE_S: f64 = 1e-3;

/// Deg/h in a rad/s.
const DPH: f64 = 180.0 / PI * 3600.0;

/// A motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// A vibration of one rate.
    Rate {
        /// Axis.
        axis: usize,
        /// Amplitude, deg/h.
        amplitude_dph: f64,
        /// Frequency, Hz.
        hz: f64,
    },
    /// Turned by an angle about an axis that goes round in the y-z plane: a drift about x.
    Coning {
        /// The angle, rad.
        angle_rad: f64,
        /// Rounds a second.
        hz: f64,
    },
    /// Turned about x and shaken along y, in phase: an acceleration along z.
    Sculling {
        /// Amplitude of the angle, rad.
        angle_rad: f64,
        /// Amplitude of the acceleration, m/s^2.
        mps2: f64,
        /// Frequency, Hz.
        hz: f64,
    },
}

impl Motion {
    /// Rates (deg/h) and specific force (m/s^2) at a time, s.
    #[must_use]
    pub fn at(&self, t: f64) -> ([f64; 3], [f64; 3]) {
        let none = [0.0; 3];
        match *self {
            Self::Rate { axis, amplitude_dph, hz } => {
                let mut rates = none;
                rates[axis % 3] = amplitude_dph * (2.0 * PI * hz * t).sin();
                (rates, none)
            }
            Self::Coning { angle_rad, hz } => {
                let w = 2.0 * PI * hz;
                let (sin, cos) = (w * t).sin_cos();
                let rates = [-2.0 * (0.5 * angle_rad).sin().powi(2), -angle_rad.sin() * sin, angle_rad.sin() * cos];
                (rates.map(|r| r * w * DPH), none)
            }
            Self::Sculling { angle_rad, mps2, hz } => {
                let w = 2.0 * PI * hz;
                ([angle_rad * w * (w * t).cos() * DPH, 0.0, 0.0], [0.0, mps2 * (w * t).sin(), 0.0])
            }
        }
    }

    /// The same as the ADC gives it for a sample that is finished at `t`.
    #[must_use]
    pub fn sampled(&self, weights: &[f64], t: f64) -> ([f64; 3], [f64; 3]) {
        let (mut rates, mut forces) = ([0.0; 3], [0.0; 3]);
        for (k, w) in weights.iter().enumerate() {
            // (The middle of the weights lies 1.5 sample times back.)
            let (r, f) = self.at(t - (k as f64 + 1.5) * SAMPLE_S / PER_SAMPLE as f64);
            for a in 0..3 {
                rates[a] += w * r[a];
                forces[a] += w * f[a];
            }
        }
        (rates, forces)
    }
}

/// The ADC's filter at the moments that [`Motion::sampled`] looks at.
#[must_use]
pub fn adc_filter() -> Vec<f64> {
    filter_weights(PER_SAMPLE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_is_a_sinc3_over_a_sample_time_and_half_a_sample_late_thrice() {
        let weights = adc_filter();
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        for hz in [10.0, 60.0, 250.0, 500.0, 940.0] {
            let motion = Motion::Rate { axis: 0, amplitude_dph: 1.0, hz };
            // The amplitude of what comes out, by two moments a quarter of a period apart; in phase 1.5 ms later.
            let at = |t: f64| motion.sampled(&weights, t).0[0];
            let quarter = 0.25 / hz;
            let (in_phase, across) = (at(1.5e-3 + quarter), at(1.5e-3));
            let x = PI * hz * SAMPLE_S;
            let wanted = (x.sin() / x).powi(3);
            assert!(
                (in_phase - wanted).abs() < 2e-3 && across.abs() < 1e-9,
                "{hz} Hz: {in_phase} for {wanted}, {across}"
            );
        }
    }
}
