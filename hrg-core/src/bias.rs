//! The baseline bias model: dong2023 eq 7, centred and scaled.
//!
//! `B = k0 + k1 u + k2 u^2 + k3 r + k4 r^2 + k5 u r`, with `u = (T - t_ref) / t_scale` and `r` the rate of
//! change in C per minute. One set of six coefficients, or a cooling and a heating set.
//!
//! # Two sets without a step
//! dong2023 switches sets where `r` changes sign; as its two `k0` differ, its bias steps there. Here the sets
//! blend: weight of heating `w = (r + band) / (2 band)`, clamped to 0..1, so the bias is continuous and on a
//! soak the mean of both.

/// Coefficients of one set.
pub const TERMS: usize = 6;

/// Centre and scale of temperature in the model, and where it stops being a polynomial.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scaling {
    /// Temperature at `u = 0`, C.
    pub t_ref_c: f32,
    /// Temperature difference of `u = 1`, C.
    pub t_scale_c: f32,
    /// Beyond these temperatures every power of `u` is continued linearly, C.
    pub t_linear_c: [f32; 2],
    /// Beyond this magnitude `r^2` is continued linearly, C per minute.
    pub r_linear: f32,
    /// Half-width of the blend between cooling and heating set, C per minute.
    pub blend_band: f32,
}

impl Scaling {
    /// Normalised temperature.
    #[inline]
    #[must_use]
    pub fn u(&self, temperature_c: f32) -> f32 {
        (temperature_c - self.t_ref_c) / self.t_scale_c
    }

    /// `u` and the point of the calibrated range nearest to it.
    #[inline]
    #[must_use]
    pub fn u_and_inside(&self, temperature_c: f32) -> (f32, f32) {
        let u = self.u(temperature_c);
        (u, clamp(u, self.u(self.t_linear_c[0]), self.u(self.t_linear_c[1])))
    }
}

/// Clamp that lets NaN through and never panics.
#[inline]
#[must_use]
pub fn clamp(x: f32, low: f32, high: f32) -> f32 {
    if x < low {
        low
    } else if x > high {
        high
    } else {
        x
    }
}

/// `x^2`, continued along its tangent from `inside` (equal to `x` within the range).
#[inline]
#[must_use]
pub fn square_or_tangent(x: f32, inside: f32) -> f32 {
    inside * inside + 2.0 * inside * (x - inside)
}

/// `x^3`, continued along its tangent.
#[inline]
#[must_use]
pub fn cube_or_tangent(x: f32, inside: f32) -> f32 {
    inside * inside * inside + 3.0 * inside * inside * (x - inside)
}

/// The six regressors of eq 7 at a temperature (C) and its rate of change (C per minute).
#[inline]
#[must_use]
pub fn regressors(scaling: &Scaling, temperature_c: f32, rate_c_per_min: f32) -> [f32; TERMS] {
    let (u, inside) = scaling.u_and_inside(temperature_c);
    let r = rate_c_per_min;
    let r_inside = clamp(r, -scaling.r_linear, scaling.r_linear);
    [1.0, u, square_or_tangent(u, inside), r, square_or_tangent(r, r_inside), u * r]
}

/// Weight of the heating set, 0 to 1.
#[inline]
#[must_use]
pub fn heating_weight(scaling: &Scaling, rate_c_per_min: f32) -> f32 {
    if scaling.blend_band > 0.0 {
        clamp(0.5 + 0.5 * rate_c_per_min / scaling.blend_band, 0.0, 1.0)
    } else if rate_c_per_min > 0.0 {
        1.0
    } else {
        0.0
    }
}

/// Coefficients of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Coefficients {
    /// One set for every sign of the rate of change.
    One([f32; TERMS]),
    /// A cooling and a heating set, blended over [`Scaling::blend_band`].
    CoolingHeating([f32; TERMS], [f32; TERMS]),
}

/// Sum of products, in order: the one dot product of the project.
#[inline]
#[must_use]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sum = 0.0;
    for (x, y) in a.iter().zip(b) {
        sum += x * y;
    }
    sum
}

impl Coefficients {
    /// Baseline bias in deg/h.
    #[inline]
    #[must_use]
    pub fn bias_dph(&self, scaling: &Scaling, temperature_c: f32, rate_c_per_min: f32) -> f32 {
        let x = regressors(scaling, temperature_c, rate_c_per_min);
        match self {
            Self::One(k) => dot(k, &x),
            Self::CoolingHeating(cooling, heating) => {
                let w = heating_weight(scaling, rate_c_per_min);
                (1.0 - w) * dot(cooling, &x) + w * dot(heating, &x)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: Scaling =
        Scaling { t_ref_c: 10.0, t_scale_c: 45.0, t_linear_c: [-40.0, 60.0], r_linear: 2.0, blend_band: 0.2 };

    #[test]
    fn two_sets_never_step() {
        let k = Coefficients::CoolingHeating([1.0, 0.5, 0.1, -0.2, 0.1, 0.3], [-2.0, 0.1, 0.4, 0.2, 0.2, -0.1]);
        let mut last = k.bias_dph(&S, 20.0, -0.5);
        let mut largest: f32 = 0.0;
        for n in 1..=1000 {
            let b = k.bias_dph(&S, 20.0, -0.5 + n as f32 * 1e-3);
            largest = largest.max((b - last).abs());
            last = b;
        }
        // 3 deg/h apart over 0.4 C/min: at most about 0.008 deg/h per 0.001 C/min.
        assert!(largest < 0.01, "{largest}");
    }

    #[test]
    fn linear_beyond_the_range() {
        let k = Coefficients::One([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        let b = |t: f32| k.bias_dph(&S, t, 0.0);
        assert!((b(60.0) - (50.0f32 / 45.0).powi(2)).abs() < 1e-6);
        let (d1, d2) = (b(80.0) - b(70.0), b(90.0) - b(80.0));
        assert!((d1 - d2).abs() < 1e-5, "{d1} {d2}");
    }
}
