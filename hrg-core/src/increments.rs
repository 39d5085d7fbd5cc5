//! Increments of angle and velocity, integrated at 1 kHz: what a strapdown navigator adds up as it comes.
//!
//! # Why not the rates
//! A vibration that turns the unit about two axes out of phase (coning) turns it about the third as well, and one that shakes and turns it at once
//! (sculling) moves it: both are products of what happens within a frame, and are lost where only its mean is sent. Here they are added up sample
//! by sample, and the message carries their sum.
//!
//! # Algorithm
//! P. G. Savage, Strapdown inertial navigation integration algorithm design, parts 1 and 2, J. Guidance, Control, and Dynamics 21 (1998). With the
//! increments `a` of angle and `v` of velocity of a sample, and `A` and `V` what has come since the message before:
//!
//! - coning grows by `(A + a'/3) x a / 2`, where `a'` is that of the sample before;
//! - sculling grows by `((A + a'/3) x v + (V + v'/3) x a) / 2`;
//! - sent are `A` + coning, and `V + A x V / 2` + sculling.
//!
//! Savage has a sixth where a third stands: what a motion between two samples adds, for increments that are exact. Ours have gone through the ADC's sinc3. That is the mean
//! over a sample time, as an increment is, and two more of it, which take `x^2 / 6` of a product of two signals away at a phase of `x` a sample. Of circular motions with an amplitude `a`, the
//! product of neighbouring increments is `a^2 x^3` for small `x`; the sum needs a twelfth of it for what is between the samples, and a twelfth for what the filter has taken.
//!
//! The increment of velocity is in the body's axes as they were at the start of the interval.
//!
//! # Time
//! A sample's time is that of the unit's timer: the ADC's own oscillator is some 50 ppm off, and so would be every angle. The interval's ticks are in the
//! message. What the timer itself is off, in parts per 1e9, is in housekeeping (`clock_ppb`).
//!
//! # Example
//! ```
//! use hrg_core::increments::Integrator;
//!
//! let mut integrator = Integrator::default();
//! for _ in 0..5 {
//!     integrator.add([1e-3, 0.0, 0.0], [0.0, 9.8e-3, 0.0]);
//! }
//! // 5 ms at 1 rad/s about x; gravity along y turns into z.
//! let (angle, velocity) = integrator.sums();
//! assert!((angle[0] - 5e-3).abs() < 1e-9 && (velocity[1] - 49e-3).abs() < 1e-7);
//! assert!((velocity[2] - 0.5 * 5e-3 * 49e-3).abs() < 1e-6);
//! ```

use crate::status::{AxisStatus, UnitStatus};
use crate::AXES;

/// Angle of one deg/h over one sample time of 1 ms, rad.
pub const RAD_PER_DPH_SAMPLE: f32 = (core::f64::consts::PI / 180.0 / 3600.0 * 1e-3) as f32;

/// Time of a sample, s.
pub const SAMPLE_S: f32 = 1e-3;

/// Increments over an interval.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct IncrementFrame {
    /// Sample times from start to its last sample; the interval begins at that of the message before.
    pub sample: u32,
    /// Timer tick at which the interval ends.
    pub tick: u32,
    /// Length of the interval in ticks.
    pub ticks: u32,
    /// Status of each axis, worst over the samples.
    pub axis_status: [AxisStatus; AXES],
    /// Status of the unit.
    pub unit_status: UnitStatus,
    /// Increments of angle, corrected for coning, rad.
    pub angle_rad: [f32; AXES],
    /// Increments of velocity, corrected for rotation and sculling, m/s; NaN: no accelerometer there, or it was at its end of scale.
    pub velocity_mps: [f32; AXES],
    /// Integrity word over the rest; not sent.
    pub(crate) integrity: u32,
}

impl IncrementFrame {
    /// With its integrity word computed: after the last change.
    #[inline]
    #[must_use]
    pub fn with_integrity(mut self) -> Self {
        self.integrity = self.fold();
        self
    }

    /// `true` if its integrity word still fits its contents.
    #[must_use]
    pub fn intact(&self) -> bool {
        self.integrity == self.fold()
    }

    #[inline]
    fn fold(&self) -> u32 {
        let [x, y, z] = self.axis_status.map(|s| u32::from(s.bits()));
        let words = [self.sample, self.tick, self.ticks, x, y, z, self.unit_status.bits().into()];
        // (One rotation a word, each another one, so that every bit counts.)
        let [sample, tick, ticks, x, y, z, unit] = words;
        let status = x ^ y.rotate_left(16) ^ z.rotate_left(8) ^ unit.rotate_left(24);
        let [a, b, c] = self.angle_rad.map(f32::to_bits);
        let [d, e, f] = self.velocity_mps.map(f32::to_bits);
        let first = sample ^ tick.rotate_left(3) ^ ticks.rotate_left(7) ^ status.rotate_left(11);
        let second = a.rotate_left(13) ^ b.rotate_left(17) ^ c.rotate_left(19);
        let third = d.rotate_left(23) ^ e.rotate_left(27) ^ f.rotate_left(29);
        first ^ second ^ third ^ 0x1C2E_4E75
    }
}

/// Sums since the message before.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Integrator {
    angle: [f32; AXES],
    velocity: [f32; AXES],
    coning: [f32; AXES],
    sculling: [f32; AXES],
    /// Of the sample before.
    angle_before: [f32; AXES],
    velocity_before: [f32; AXES],
}

#[inline(always)]
fn cross(a: &[f32; AXES], b: &[f32; AXES]) -> [f32; AXES] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + k b`.
#[inline(always)]
fn along(a: &[f32; AXES], k: f32, b: &[f32; AXES]) -> [f32; AXES] {
    [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]]
}

impl Integrator {
    /// After the sample before the interval: its increments, of which nothing is added.
    #[must_use]
    pub fn after(angle: [f32; AXES], velocity: [f32; AXES]) -> Self {
        Self { angle_before: angle, velocity_before: velocity, ..Self::default() }
    }

    /// Takes the increments of a sample: angle in rad, velocity in m/s.
    #[inline(always)]
    pub fn add(&mut self, angle: [f32; AXES], velocity: [f32; AXES]) {
        const THIRD: f32 = 1.0 / 3.0;
        let a = along(&self.angle, THIRD, &self.angle_before);
        let v = along(&self.velocity, THIRD, &self.velocity_before);
        self.coning = along(&self.coning, 0.5, &cross(&a, &angle));
        self.sculling = along(&along(&self.sculling, 0.5, &cross(&a, &velocity)), 0.5, &cross(&v, &angle));
        self.angle = along(&self.angle, 1.0, &angle);
        self.velocity = along(&self.velocity, 1.0, &velocity);
        (self.angle_before, self.velocity_before) = (angle, velocity);
    }

    /// Increments of angle (rad) and velocity (m/s) since the message before, corrected.
    #[must_use]
    pub fn sums(&self) -> ([f32; AXES], [f32; AXES]) {
        let rotated = along(&self.velocity, 0.5, &cross(&self.angle, &self.velocity));
        (along(&self.angle, 1.0, &self.coning), along(&rotated, 1.0, &self.sculling))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::f64::consts::PI;
    use std::println;

    type V = [f64; 3];
    type Q = [f64; 4];

    fn product(p: Q, q: Q) -> Q {
        [
            p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
            p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
            p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
            p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
        ]
    }

    /// Rotation by a vector, rad.
    fn rotation(r: V) -> Q {
        let angle = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
        let s = if angle < 1e-12 { 0.5 } else { (0.5 * angle).sin() / angle };
        [(0.5 * angle).cos(), r[0] * s, r[1] * s, r[2] * s]
    }

    fn turned(q: Q, v: V) -> V {
        let r = product(product(q, [0.0, v[0], v[1], v[2]]), [q[0], -q[1], -q[2], -q[3]]);
        [r[1], r[2], r[3]]
    }

    fn single(v: V) -> [f32; 3] {
        v.map(|x| x as f32)
    }

    /// The mean of a quantity over two running means of a sample time, as the ADC's filter adds to an increment.
    fn filtered(at: impl Fn(f64) -> V, t: f64) -> V {
        const PIECES: usize = 16;
        let mut sum = [0.0; 3];
        for k in 0..PIECES * PIECES {
            let shift = ((k % PIECES) as f64 + (k / PIECES) as f64 + 1.0) / PIECES as f64 - 1.0;
            let v = at(t + shift * 1e-3);
            for j in 0..3 {
                sum[j] += v[j] / (PIECES * PIECES) as f64;
            }
        }
        sum
    }

    fn wide(v: [f32; 3]) -> V {
        v.map(f64::from)
    }

    /// Drift about x under classical coning of half-angle `a` (rad) at `hz`, deg/h: by the increments, and by plain means of so many samples.
    fn coning(a: f64, hz: f64, samples: usize) -> (f64, f64) {
        let w = 2.0 * PI * hz;
        // Attitude: turned by `a` about an axis that goes round in the y-z plane. The rate of the body, integrated, in closed form.
        let attitude =
            |t: f64| [(0.5 * a).cos(), 0.0, (0.5 * a).sin() * (w * t).cos(), (0.5 * a).sin() * (w * t).sin()];
        let integral =
            |t: f64| [-2.0 * (0.5 * a).sin().powi(2) * w * t, a.sin() * (w * t).cos(), a.sin() * (w * t).sin()];
        let (mut by_increments, mut by_means) = (attitude(0.0), attitude(0.0));
        let mut integrator = Integrator::default();
        let end = 10_000;
        for k in 0..end {
            let [from, to] = [k, k + 1].map(|k| filtered(integral, k as f64 * 1e-3));
            integrator.add(single([0, 1, 2].map(|j| to[j] - from[j])), [0.0; 3]);
            if (k + 1) % samples == 0 {
                by_increments = product(by_increments, rotation(wide(integrator.sums().0)));
                by_means = product(by_means, rotation(wide(integrator.angle)));
                integrator = Integrator::after(integrator.angle_before, integrator.velocity_before);
            }
        }
        let truth = attitude(end as f64 * 1e-3);
        let drift = |q: Q| {
            let d = product(q, [truth[0], -truth[1], -truth[2], -truth[3]]);
            2.0 * d[1].atan2(d[0]).to_degrees() / (end as f64 * 1e-3) * 3600.0
        };
        (drift(by_increments), drift(by_means))
    }

    /// Error of the mean acceleration along z under sculling (turned about x by `a` sin, shaken along y by `f` sin), m/s^2; the same of plain means.
    fn sculling(a: f64, f: f64, hz: f64, samples: usize) -> (f64, f64) {
        let w = 2.0 * PI * hz;
        let angle = |t: f64| a * (w * t).sin();
        let (mut truth, mut by_increments, mut by_means) = (0.0, 0.0, 0.0);
        let mut q = [1.0, 0.0, 0.0, 0.0];
        let mut plain = q;
        let mut integrator = Integrator::default();
        let end = 10_000;
        for k in 0..end {
            let t = k as f64 * 1e-3;
            let sums = |t: f64| [angle(t), -f / w * (w * t).cos(), 0.0];
            let [from, to] = [t, t + 1e-3].map(|t| filtered(sums, t));
            integrator.add(single([to[0] - from[0], 0.0, 0.0]), single([0.0, to[1] - from[1], 0.0]));
            // The truth along z, in the axes of the start: Simpson's rule.
            let z = |t: f64| angle(t).sin() * f * (w * t).sin();
            truth += (z(t) + 4.0 * z(t + 0.5e-3) + z(t + 1e-3)) * 1e-3 / 6.0;
            if (k + 1) % samples == 0 {
                let (angle, velocity) = integrator.sums();
                by_increments += turned(q, wide(velocity))[2];
                q = product(q, rotation(wide(angle)));
                by_means += turned(plain, wide(integrator.velocity))[2];
                plain = product(plain, rotation(wide(integrator.angle)));
                integrator = Integrator::after(integrator.angle_before, integrator.velocity_before);
            }
        }
        let seconds = end as f64 * 1e-3;
        ((by_increments - truth) / seconds, (by_means - truth) / seconds)
    }

    #[test]
    fn coning_and_sculling_are_taken_along() {
        println!("coning of 0.1 deg: drift left, deg/h, by increments and by means of the rates (200 Hz)");
        for (hz, bound) in [(5.0, 0.001), (10.0, 0.001), (20.0, 0.001), (50.0, 0.087), (100.0, 9.0)] {
            let (ours, plain) = coning(0.1f64.to_radians(), hz, 5);
            println!("  {hz:5.0} Hz: {ours:10.5} {plain:10.4}");
            assert!(ours.abs() < bound && ours.abs() < 0.05 * plain.abs().max(0.1), "{hz} Hz: {ours} and {plain}");
        }
        println!(
            "sculling of 0.1 deg and 1 g: error of the mean acceleration, ug, by increments and by means (200 Hz)"
        );
        for (hz, bound) in [(5.0, 0.05), (10.0, 0.05), (20.0, 0.3), (50.0, 6.0), (100.0, 100.0)] {
            let (ours, plain) = sculling(0.1f64.to_radians(), 9.806_65, hz, 5);
            let ug = 1e6 / 9.806_65;
            println!("  {hz:5.0} Hz: {:10.4} {:10.3}", ours * ug, plain * ug);
            assert!((ours * ug).abs() < bound, "{hz} Hz: {} and {}", ours * ug, plain * ug);
        }
    }

    #[test]
    fn every_bit_changes_the_fold() {
        let frame = IncrementFrame { angle_rad: [1e-3; 3], velocity_mps: [2e-3; 3], ..IncrementFrame::default() }
            .with_integrity();
        assert!(frame.intact() && !IncrementFrame::default().intact());
        for bit in 0..32 {
            for k in 0..3 {
                let mut f = frame;
                f.velocity_mps[k] = f32::from_bits(f.velocity_mps[k].to_bits() ^ 1 << bit);
                assert!(!f.intact());
            }
            assert!(!IncrementFrame { ticks: frame.ticks ^ 1 << bit, ..frame }.intact());
        }
    }
}
