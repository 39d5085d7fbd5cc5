//! Readings of thermometers: the resonator's frequency, and sensors on the cases.

use crate::draw::Properties;
use crate::operators::lag;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Frequency of one resonator as a quartic of temperature about 25 C.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    at_25_hz: f64,
    /// Fractional, per C to the power of the index plus one.
    terms: [f64; 4],
}

impl Curve {
    /// The curve of axis number `axis`: near 4.90, 4.89 and 4.71 kHz, and 96 ppm/C.
    #[must_use]
    pub fn draw(rng: &mut Properties, axis: usize) -> Self {
        let centre = [4903.0, 4893.0, 4712.0][axis % 3];
        Self {
            at_25_hz: centre + rng.random_range(-12.0..12.0),
            terms: [
                96e-6 + rng.random_range(-3e-6..3e-6),
                -5.4e-8 + rng.random_range(-1.2e-8..1.2e-8),
                rng.random_range(-1.2e-10..1.2e-10),
                rng.random_range(-1.2e-12..1.2e-12),
            ],
        }
    }

    /// Frequency at temperature `t_c`, Hz.
    #[must_use]
    pub fn hz(&self, t_c: f64) -> f64 {
        let u = t_c - 25.0;
        let [a, b, c, d] = self.terms;
        self.at_25_hz * (1.0 + u * (a + u * (b + u * (c + u * d))))
    }

    /// Slope at `t_c`, Hz/C.
    #[must_use]
    pub fn hz_per_c(&self, t_c: f64) -> f64 {
        let u = t_c - 25.0;
        let [a, b, c, d] = self.terms;
        self.at_25_hz * (a + u * (2.0 * b + u * (3.0 * c + u * 4.0 * d)))
    }

    /// Temperature at which the curve gives `hz`, by Newton's method from `near_c`.
    #[must_use]
    pub fn t_c(&self, hz: f64, near_c: f64) -> f64 {
        let mut t = near_c;
        for _ in 0..8 {
            let step = (hz - self.hz(t)) / self.hz_per_c(t);
            t += step;
            if step.abs() < 1e-10 {
                break;
            }
        }
        t
    }
}

/// A sensor that is glued to a body.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Reads so much too high, C.
    pub offset_c: f64,
    /// Reads so much too steep, as a fraction.
    pub gain_error: f64,
    /// Lag behind its body, s.
    pub lag_s: f64,
    /// Step of its output, C.
    pub step_c: f64,
    /// Noise before rounding, C.
    pub noise_c: f64,
}

impl Sensor {
    /// A digital case sensor: steps of 0.0625 C, sometimes 0.1 C.
    #[must_use]
    pub fn draw(rng: &mut Properties) -> Self {
        Self {
            offset_c: rng.random_range(-0.5..0.5),
            gain_error: rng.random_range(-0.006..0.006),
            lag_s: rng.random_range(8.0..45.0),
            step_c: if rng.random_bool(0.3) { 0.1 } else { 0.0625 },
            noise_c: rng.random_range(0.01..0.05),
        }
    }

    /// Readings for its body's temperatures.
    #[must_use]
    pub fn read(&self, rng: &mut ChaCha8Rng, body_c: &[f64], dt_s: f64) -> Vec<f64> {
        let start = body_c.first().copied().unwrap_or(25.0);
        lag(body_c, dt_s, self.lag_s, start)
            .into_iter()
            .map(|t| {
                let noise: f64 = StandardNormal.sample(rng);
                let analogue = t + self.offset_c + self.gain_error * (t - 25.0) + self.noise_c * noise;
                (analogue / self.step_c).round() * self.step_c
            })
            .collect()
    }
}
