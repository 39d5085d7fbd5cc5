//! A unit on a rate table: which rates the table gives it, and what its gyros make of them.
//!
//! # Physics of the scale factor
//! The drive holds the amplitude of the vibration against a damping that grows with temperature, and its electrodes saturate: force
//! `F = tanh(g d)`, damping `d(T) = 1/Q(T)` relative to 20 C, so that the amplitude falls where the drive comes to its limit. The
//! rebalance force of a rate is proportional to that amplitude. The amplitude follows a body that lags behind the resonator, so a ramp shows
//! in it; the reference of the ADC adds a parabola. None of this is a polynomial or a ramp term, which is what a fit has.
//!
//! # Physics of the misalignment
//! Each sensitive axis is a unit vector that the mounting tilts; the tilt goes with the temperature linearly and a little with its
//! square. Plus and minus rates differ a little (asymmetry), and the rate's square adds to the scale factor (nonlinearity).

use super::tilt::Tilt;
use hrg_core::AXES;
use hrg_data::error::BadInput;
use hrg_data::recording::metadata::EARTH_RATE_DPH;
use hrg_data::recording::turns::{END_S, SETTLE_S};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One step of a scheme: the axis that lies along the table's, and which way it turns; `None`: at rest.
pub type Turn = Option<(usize, f64)>;

/// The eight steps: at rest, plus and minus about each axis, at rest.
pub const EIGHT: [Turn; 8] =
    [None, Some((0, 1.0)), Some((0, -1.0)), Some((1, 1.0)), Some((1, -1.0)), Some((2, 1.0)), Some((2, -1.0)), None];

/// Motion of a rate table.
#[derive(Debug, Clone, PartialEq)]
pub struct Scheme {
    /// Its steps, which are repeated.
    pub steps: Vec<Turn>,
    /// Rates, deg/s: the first for the first round, and so on, and again.
    pub rates_deg_per_s: Vec<f64>,
    /// Time of a step, s: [`SETTLE_S`], whole revolutions, and [`END_S`].
    pub dwell_s: usize,
}

impl Default for Scheme {
    /// The eight steps at 18 and 9 deg/s in turn, 120 s each beside settling and end: six and three revolutions.
    fn default() -> Self {
        Self { steps: EIGHT.to_vec(), rates_deg_per_s: vec![18.0, 9.0], dwell_s: SETTLE_S + 120 + END_S }
    }
}

impl Scheme {
    /// Rates by a text like `18,9` (deg/s).
    ///
    /// # Errors
    /// Anything that is no list of rates of 0.1 to 1000 deg/s.
    pub fn of_rates(text: &str) -> Result<Self, BadInput> {
        let rate = |t: &str| t.trim().parse().ok().filter(|r: &f64| (0.1..=1000.0).contains(r));
        let rates: Option<Vec<f64>> = text.split(',').map(rate).collect();
        let rates_deg_per_s =
            rates.ok_or_else(|| BadInput::new(format!("\"{text}\" is no list of rates in deg/s, like 18,9")))?;
        Ok(Self { rates_deg_per_s, ..Self::default() })
    }

    /// The step at a second, and its rate, deg/h.
    fn at(&self, second: usize) -> (Turn, f64) {
        let n = second / self.dwell_s;
        let round = n / self.steps.len();
        let rate = self.rates_deg_per_s[round % self.rates_deg_per_s.len()];
        (self.steps[n % self.steps.len()], 3600.0 * rate)
    }

    /// The table's rate in each second along the axes of the case, deg/h.
    #[must_use]
    pub fn table_rates_dph(&self, seconds: usize) -> [Vec<f64>; AXES] {
        [0, 1, 2].map(|a| {
            (0..seconds)
                .map(|k| match self.at(k) {
                    (Some((axis, sign)), rate) if axis == a => sign * rate,
                    _ => 0.0,
                })
                .collect()
        })
    }

    /// The earth's rate in each second along the axes of the case, deg/h: the axis that turns points up, the others go round with it.
    fn earth_rates_dph(&self, seconds: usize, latitude_deg: f64) -> Vec<[f64; AXES]> {
        let (sin, cos) = latitude_deg.to_radians().sin_cos();
        let mut angle = 0.0f64;
        let mut up = 2;
        (0..seconds)
            .map(|k| {
                let (turn, rate_dph) = self.at(k);
                let mut turned = 0.0;
                if let Some((axis, sign)) = turn {
                    up = axis;
                    turned = (sign * rate_dph / 3600.0).to_radians();
                }
                // Mean over the second.
                let (from, to) = (angle, angle + turned);
                let (north, west) = if turned == 0.0 {
                    (from.cos(), from.sin())
                } else {
                    ((to.sin() - from.sin()) / turned, (from.cos() - to.cos()) / turned)
                };
                angle = to;
                let mut out = [0.0; AXES];
                out[up] = EARTH_RATE_DPH * sin;
                out[(up + 1) % AXES] = EARTH_RATE_DPH * cos * north;
                out[(up + 2) % AXES] = -EARTH_RATE_DPH * cos * west;
                out
            })
            .collect()
    }
}

/// Response of a unit's gyros to a rate.
#[derive(Debug, Clone)]
pub struct Gyros {
    axes: [Gyro; AXES],
}

#[derive(Debug, Clone)]
struct Gyro {
    constant: f64,
    /// Drive over its limit at 20 C, and C over which the damping grows by e.
    drive: f64,
    damping_c: f64,
    /// Parabola of the reference.
    bend: f64,
    /// Scale that makes the change over -40 to 60 C as large as wanted, with its sign.
    size: f64,
    asymmetry: f64,
    /// At 20 deg/s.
    nonlinearity: f64,
    tilt: Tilt,
}

/// Time by which the amplitude's body is behind the resonator, s.
const BODY_LAG_S: f64 = 240.0;

/// Change of a scale factor over -40 to 60 C.
const SCALE_SPAN: f64 = 300e-6;

/// Largest misalignment, rad.
const TILT: f64 = 300e-6;

/// The rate of [`Gyro::nonlinearity`], deg/h.
const FULL_DPH: f64 = 72_000.0;

impl Gyro {
    fn new(rng: &mut ChaCha8Rng) -> Self {
        let sign = |rng: &mut ChaCha8Rng| if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let mut g = Self {
            constant: rng.random_range(-800e-6..800e-6),
            drive: rng.random_range(0.5..0.7),
            damping_c: rng.random_range(55.0..75.0),
            bend: rng.random_range(-0.08..0.08),
            size: 1.0,
            asymmetry: 1e-6 * rng.random_range(3.0..8.0) * sign(rng),
            nonlinearity: 1e-6 * rng.random_range(2.0..5.0) * sign(rng),
            tilt: Tilt {
                at_20_c: [0; 2].map(|_| TILT * rng.random_range(0.6..1.0) * sign(rng)),
                per_c: [0; 2].map(|_| 1e-6 * rng.random_range(-0.5..0.5)),
                per_c2: [0; 2].map(|_| 1e-9 * rng.random_range(-0.3..0.3)),
            },
        };
        let curve: Vec<f64> = (0..=100).map(|k| g.shape(f64::from(k) - 40.0)).collect();
        let span = curve.iter().fold(f64::MIN, |a, b| a.max(*b)) - curve.iter().fold(f64::MAX, |a, b| a.min(*b));
        g.size = SCALE_SPAN / span * rng.random_range(0.9..1.1) * sign(rng);
        g
    }

    /// Amplitude at a temperature over that at 20 C, and the reference's parabola.
    fn shape(&self, t: f64) -> f64 {
        let amplitude = |t: f64| {
            // One half is the loss of the surface, which does not change.
            let damping = 0.5 + 0.5 * ((t - 20.0) / self.damping_c).exp();
            let wanted = self.drive * damping;
            wanted.tanh() / wanted
        };
        amplitude(t) / amplitude(20.0) - 1.0 + 0.1 * self.bend * ((t - 20.0) / 60.0).powi(2)
    }

    /// Share of the rate along its axis that the channel gives, for the temperature of the amplitude's body.
    fn scale(&self, body_c: f64, along_dph: f64) -> f64 {
        // (A double zero has a sign.)
        let half = if along_dph == 0.0 { 0.0 } else { 0.5 * self.asymmetry * along_dph.signum() };
        1.0 + self.constant + self.size * self.shape(body_c) + half + self.nonlinearity * (along_dph / FULL_DPH).powi(2)
    }
}

impl Gyros {
    /// Those of a unit.
    #[must_use]
    pub fn of(unit_seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(0x5CA1_E000));
        Self { axes: [0; AXES].map(|_| Gyro::new(&mut rng)) }
    }

    /// Scale factor of an axis on a soak at a temperature for small rates: what its channel gives over the rate along its sensitive axis.
    #[must_use]
    pub fn scale_factor(&self, axis: usize, temperature_c: f64) -> f64 {
        self.axes[axis].scale(temperature_c, 0.0)
    }

    /// Elements of `M` beside its diagonal at a temperature, urad, that undo the tilts; rows in the order of
    /// [`hrg_core::rate_factors::OTHERS`].
    #[must_use]
    pub fn misalignment_urad(&self, temperature_c: f64) -> [[f64; 2]; AXES] {
        use hrg_core::rate_factors::OTHERS;
        let tilts = self.axes.each_ref().map(|g| g.tilt.at(temperature_c));
        // Of a tilt j of axis a through the third axis; the inverse of a matrix near one, to the second order.
        let of = |a: usize, to: usize| (0..2).find(|j| OTHERS[a][*j] == to).map_or(0.0, |j| tilts[a][j]);
        [0, 1, 2].map(|a: usize| {
            [0, 1].map(|j: usize| {
                let (to, third) = (OTHERS[a][j], OTHERS[a][1 - j]);
                1e6 * (of(a, third) * of(third, to) - of(a, to))
            })
        })
    }

    /// Asymmetry of an axis: scale factor of plus less that of minus rates, ppm.
    #[must_use]
    pub fn asymmetry_ppm(&self, axis: usize) -> f64 {
        1e6 * self.axes[axis].asymmetry
    }

    /// Gain of its scale factor from zero up to a rate in deg/s, ppm.
    #[must_use]
    pub fn nonlinearity_ppm(&self, axis: usize, rate_deg_per_s: f64) -> f64 {
        1e6 * self.axes[axis].nonlinearity * (rate_deg_per_s * 3600.0 / FULL_DPH).powi(2)
    }

    /// Rates of the channels without bias, second by second, under a scheme.
    pub(super) fn rates_dph(
        &self,
        scheme: &Scheme,
        resonator_c: &[Vec<f64>; AXES],
        latitude_deg: f64,
    ) -> [Vec<f64>; AXES] {
        let n = resonator_c[0].len();
        let table = scheme.table_rates_dph(n);
        let earth = scheme.earth_rates_dph(n, latitude_deg);
        [0, 1, 2].map(|a: usize| {
            let others = hrg_core::rate_factors::OTHERS[a];
            let share = 1.0 - (-1.0 / BODY_LAG_S).exp();
            let mut body_c = resonator_c[a].first().copied().unwrap_or(0.0);
            (0..n)
                .map(|k| {
                    let t = resonator_c[a][k];
                    body_c += share * (t - body_c);
                    let gyro = &self.axes[a];
                    let total = |j: usize| table[j][k] + earth[k][j];
                    let along = gyro.tilt.along(t, total(a), others.map(total));
                    gyro.scale(body_c, along) * along
                })
                .collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_axis_changes_by_three_hundred_ppm_and_bends() {
        for unit in 0..20 {
            let gyros = Gyros::of(unit);
            for a in 0..AXES {
                let at = |t: f64| 1e6 * gyros.scale_factor(a, t);
                let curve: Vec<f64> = (0..=10).map(|k| at(f64::from(10 * k) - 40.0)).collect();
                let span =
                    curve.iter().fold(f64::MIN, |m, v| m.max(*v)) - curve.iter().fold(f64::MAX, |m, v| m.min(*v));
                assert!((260.0..340.0).contains(&span), "unit {unit}: {span}");
                let bend = (at(-40.0) + at(60.0) - 2.0 * at(10.0)).abs();
                assert!(bend > 5.0, "unit {unit}: no straight line, {bend}");
            }
        }
    }

    #[test]
    fn whole_revolutions_leave_the_vertical_part_of_the_earths_rate() {
        let scheme = Scheme::default();
        let n = 2 * scheme.dwell_s;
        let earth = scheme.earth_rates_dph(n, 30.0);
        // The second step turns about x at 18 deg/s: six revolutions behind the settling.
        let mean = |a: usize| earth[scheme.dwell_s + SETTLE_S..n - END_S].iter().map(|e| e[a]).sum::<f64>() / 120.0;
        assert!((mean(0) - 0.5 * EARTH_RATE_DPH).abs() < 1e-9, "{}", mean(0));
        assert!(mean(1).abs() < 1e-6 && mean(2).abs() < 1e-6, "{} {}", mean(1), mean(2));
        assert_eq!(scheme.table_rates_dph(n)[0][n - 1], 64_800.0);
    }

    #[test]
    fn rates_are_read_from_a_text() {
        assert_eq!(Scheme::of_rates("18, 9").expect("fine").rates_deg_per_s, [18.0, 9.0]);
        for bad in ["", "0", "18;9", "nan", "1e9"] {
            assert!(Scheme::of_rates(bad).is_err(), "{bad}");
        }
    }
}
