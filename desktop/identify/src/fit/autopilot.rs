//! Calibrations for flight controllers: ArduPilot's and PX4's own compensation is a cubic of temperature, whose parameters are made here. Their
//! formulas have no ramp and no memory.
//!
//! ArduPilot (`AP_InertialSensor_tempcal.cpp`): `rate - p(T - 35)`, `p(d) = 1e-6 (c1 d + c2 d^2 + c3 d^3)` in rad/s, `T` held within `TMIN` and
//! `TMAX`. The constant is its own gyro calibration's, made at each start.
//! PX4 (`sensors/temperature_compensation`): `rate - (X0 + X1 d + X2 d^2 + X3 d^3)` in rad/s, `d = T - TREF`, `T` held within `TMIN` and `TMAX`.

use super::Prepared;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{block_means, std_dev};
use hrg_data::recording::metadata::DPH_PER_RAD_S;
use hrg_data::recording::steps::Run;
use std::fmt::Write as _;

/// Coefficients of a cubic.
const TERMS: usize = 4;

/// A flight controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autopilot {
    /// ArduPilot.
    Ardupilot,
    /// PX4.
    Px4,
}

impl Autopilot {
    /// ArduPilot's formula has a fixed reference temperature, PX4's a parameter.
    fn reference_c(self, low_c: f64, high_c: f64) -> f64 {
        match self {
            Self::Ardupilot => 35.0,
            Self::Px4 => (0.5 * (low_c + high_c) * 10.0).round() / 10.0,
        }
    }
}

/// A cubic of temperature by axis.
#[derive(Debug, Clone)]
pub struct Cubic {
    autopilot: Autopilot,
    /// Range of temperatures of the fit, C.
    pub range_c: [f64; 2],
    reference_c: f64,
    /// Coefficients from the constant on, rad/s per C to the power; `None` for an axis that is absent.
    coefficients: [Option<[f64; TERMS]>; AXES],
}

/// Temperature and rate of an axis, second by second; those that are missing are left out.
fn seconds(run: &Run, a: usize) -> Vec<(f64, f64)> {
    let both = (0..run.steps.len()).filter_map(|k| Some((f64::from(run.state(k, a)?.0), run.steps.rate_dph[a][k])));
    both.filter(|(t, r)| t.is_finite() && r.is_finite()).collect()
}

impl Cubic {
    /// The least squares fit to runs; each has a constant of its own, and the image the mean of them.
    ///
    /// # Errors
    /// Too few temperatures for a cubic.
    pub fn fit(prepared: &Prepared, autopilot: Autopilot) -> Result<Self, BadInput> {
        let runs = &prepared.runs;
        let all = |a: usize| runs.iter().flat_map(move |r| seconds(r, a));
        let there: Vec<usize> = runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
        let temperatures = there.iter().flat_map(|a| all(*a)).map(|(t, _)| t);
        let (low, high) = temperatures.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| (l.min(t), h.max(t)));
        let range_c = [(low * 10.0).floor() / 10.0, (high * 10.0).ceil() / 10.0];
        let reference_c = autopilot.reference_c(low, high);
        let mut coefficients = [None; AXES];
        for &a in &there {
            let mut columns = vec![Vec::new(); TERMS - 1 + runs.len()];
            let mut y = Vec::new();
            for (n, run) in runs.iter().enumerate() {
                for (t, rate) in seconds(run, a) {
                    let d = (t - reference_c) / 10.0;
                    for (k, column) in columns.iter_mut().enumerate() {
                        column.push(match k.checked_sub(TERMS - 1) {
                            None => d.powi(k as i32 + 1),
                            Some(of_run) => f64::from(u8::from(of_run == n)),
                        });
                    }
                    y.push(rate / DPH_PER_RAD_S);
                }
            }
            let fit = lsq::fit(&columns, &y, None, &[])
                .map_err(|e| BadInput(format!("axis {}: no cubic can be fitted: {e}", AXIS_NAMES[a])))?;
            let constant = fit.coefficients[TERMS - 1..].iter().sum::<f64>() / runs.len() as f64;
            let of = |k: usize| fit.coefficients[k - 1] / 10f64.powi(k as i32);
            coefficients[a] = Some([constant, of(1), of(2), of(3)]);
        }
        Ok(Self { autopilot, range_c, reference_c, coefficients })
    }

    /// The bias at a temperature by the flight controller's formula, deg/h; its constant included.
    #[must_use]
    pub fn bias_dph(&self, a: usize, temperature_c: f64) -> Option<f64> {
        let c = self.coefficients[a]?;
        let d = temperature_c.clamp(self.range_c[0], self.range_c[1]) - self.reference_c;
        Some((c[0] + (c[1] + (c[2] + c[3] * d) * d) * d) * DPH_PER_RAD_S)
    }

    /// Standard deviation of the means of a run, raw and corrected, deg/h; `None` for an axis that is absent.
    #[must_use]
    pub fn leaves(&self, run: &Run, a: usize) -> Option<[f64; 2]> {
        self.coefficients[a]?;
        let raw = &run.steps.rate_dph[a];
        let bias = |k: usize| run.state(k, a).and_then(|s| self.bias_dph(a, f64::from(s.0))).unwrap_or(f64::NAN);
        let corrected: Vec<f64> = raw.iter().enumerate().map(|(k, r)| r - bias(k)).collect();
        Some([raw, &corrected].map(|v| std_dev(&block_means(v, run.steps.mean_s))))
    }

    /// Share of a run whose temperature is outside the range of the fit, where the formula holds the value of the end.
    #[must_use]
    pub fn outside(&self, run: &Run) -> f64 {
        let there = run.steps.present().flat_map(|a| seconds(run, a));
        let (outside, all) = there.fold((0usize, 0usize), |(o, n), (t, _)| {
            (o + usize::from(t < self.range_c[0] - 0.1 || t > self.range_c[1] + 0.1), n + 1)
        });
        outside as f64 / all.max(1) as f64
    }

    /// The parameters as a file of the flight controller's ground stations. `imu`: number of the IMU, from 0; `device_id`: PX4's of that gyro.
    #[must_use]
    pub fn parameters(&self, imu: u8, device_id: u32) -> String {
        let mut out = String::new();
        let [low, high] = self.range_c;
        let each = |k: usize| self.coefficients.iter().enumerate().filter_map(move |(a, c)| Some((a, (*c)?[k])));
        match self.autopilot {
            Autopilot::Ardupilot => {
                let n = imu + 1;
                let _ = writeln!(out, "INS_TCAL{n}_ENABLE 1\nINS_TCAL{n}_TMIN {low:.1}\nINS_TCAL{n}_TMAX {high:.1}");
                for k in 1..TERMS {
                    for (a, c) in each(k) {
                        let _ = writeln!(out, "INS_TCAL{n}_GYR{k}_{} {:.9}", ["X", "Y", "Z"][a], c * 1e6);
                    }
                }
            }
            Autopilot::Px4 => {
                // Vehicle, component, name, value, and the type: 6 for an integer, 9 for a real number.
                let mut line = |name: String, value: String, kind: u8| {
                    let _ = writeln!(out, "1\t1\t{name}\t{value}\t{kind}");
                };
                line("TC_G_ENABLE".into(), "1".into(), 6);
                line(format!("TC_G{imu}_ID"), device_id.to_string(), 6);
                for (name, value) in [("TMIN", low), ("TMAX", high), ("TREF", self.reference_c)] {
                    line(format!("TC_G{imu}_{name}"), format!("{value:.1}"), 9);
                }
                for k in 0..TERMS {
                    for (a, c) in each(k) {
                        line(format!("TC_G{imu}_X{k}_{a}"), format!("{c:.9e}"), 9);
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::prepare;
    use hrg_data::recording::Recording;
    use std::collections::BTreeMap;

    fn warming() -> Recording {
        let mut text = String::from("time_s,temp_c,rate_x_dph,rate_y_dph,rate_z_dph\n");
        for k in 0..2400u32 {
            let t = 22.0 + 24.0 * (1.0 - (-f64::from(k) / 800.0).exp());
            let d = t - 35.0;
            let noise = f64::from(k * 7919 % 101) / 50.0 - 1.0;
            text += &format!(
                "{k},{t:.4},{},{},{}\n",
                100.0 + 20.0 * d - 0.3 * d * d + noise,
                -3.0 * d + noise,
                0.02 * d.powi(3) + noise
            );
        }
        Recording::parse(text.as_bytes()).expect("a recording")
    }

    /// Each flight controller's own formula, in its own arithmetic, typed from its source.
    fn flown(text: &str, autopilot: Autopilot, axis: usize, temperature_c: f32) -> f32 {
        let line = |l: &str| -> Option<(String, f32)> {
            let mut words = l.split_whitespace().skip(if autopilot == Autopilot::Px4 { 2 } else { 0 });
            Some((words.next()?.to_string(), words.next()?.parse().ok()?))
        };
        let p: BTreeMap<String, f32> = text.lines().filter_map(line).collect();
        match autopilot {
            Autopilot::Ardupilot => {
                let t = temperature_c.clamp(p["INS_TCAL2_TMIN"], p["INS_TCAL2_TMAX"]) - 35.0;
                let c = [1, 2, 3].map(|k: usize| p[&format!("INS_TCAL2_GYR{k}_{}", ["X", "Y", "Z"][axis])]);
                (c[0] + (c[1] + c[2] * t) * t) * t * 1.0e-6
            }
            Autopilot::Px4 => {
                let t = temperature_c.clamp(p["TC_G1_TMIN"], p["TC_G1_TMAX"]) - p["TC_G1_TREF"];
                let x = [0, 1, 2, 3].map(|k: usize| p[&format!("TC_G1_X{k}_{axis}")]);
                x[0] + x[1] * t + x[2] * t * t + x[3] * t * t * t
            }
        }
    }

    #[test]
    fn their_formulas_take_the_bias_off() {
        let prepared = prepare(&[warming()]).expect("prepares");
        for autopilot in [Autopilot::Ardupilot, Autopilot::Px4] {
            let cubic = Cubic::fit(&prepared, autopilot).expect("fits");
            let text = cubic.parameters(1, 3_932_178);
            for (axis, truth) in
                [|d: f64| 20.0 * d - 0.3 * d * d, |d: f64| -3.0 * d, |d: f64| 0.02 * d.powi(3)].iter().enumerate()
            {
                for t in [24.0, 31.0, 38.0, 44.0f32] {
                    let own = |t: f32| f64::from(flown(&text, autopilot, axis, t)) * DPH_PER_RAD_S;
                    let (gained, wanted) = (own(t) - own(35.0), truth(f64::from(t) - 35.0));
                    assert!((gained - wanted).abs() < 1.0, "{autopilot:?} {axis} {t}: {gained} {wanted}");
                    let ours =
                        cubic.bias_dph(axis, f64::from(t)).expect("there") - cubic.bias_dph(axis, 35.0).expect("there");
                    assert!((gained - ours).abs() < 0.01, "{autopilot:?} {axis} {t}: {gained} {ours}");
                }
                let [raw, left] = cubic.leaves(&prepared.runs[0], axis).expect("there");
                assert!(left < 0.5 && raw > 10.0, "{raw} {left}");
            }
            assert!(text.contains("TC_G1_ID\t3932178\t6") || text.contains("INS_TCAL2_ENABLE 1"));
        }
    }
}
