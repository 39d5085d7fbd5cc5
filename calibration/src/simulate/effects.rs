//! Effects put into a simulated run: those of the library, and some that it does not have.

use super::plant::Plant;
use crate::numeric::lsq;
use crate::numeric::stats::{block_means, std_dev};
use crate::BadInput;
use hrg_core::bias::{regressors, Scaling, TERMS};
use hrg_core::effects::{by_name, Inputs, Recorded, Running, ALL, MAX_PARAMETERS};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// An effect to put in: name, parameters, size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectSpec {
    /// Name, from the library or an outsider's.
    pub name: String,
    /// Inner parameter, in its unit.
    pub parameter: f64,
    /// What it leaves after the baseline fit, RMS of 100 s means, in noise floors.
    pub size: f64,
}

/// Effects that the library does not have; what the tool should call unexplained (or a shape of temperature).
pub const OUTSIDERS: [&str; 6] = [
    "outsider-ripple",
    "outsider-bump",
    "outsider-wave-train",
    "outsider-product",
    "outsider-relay",
    "outsider-drift-burst",
];

/// The inner parameter where a specification names none.
fn default_parameter(name: &str) -> f64 {
    match name {
        "kink" => 8.0,
        "thermal-lag" => 2400.0,
        "hysteresis" => 12.0,
        "warm-up" => 1800.0,
        "step" => 9000.0,
        "periodic" => 900.0,
        "timebase" => 694.0,
        "outsider-ripple" => 14.0,
        "outsider-bump" => 5.0,
        "outsider-wave-train" => 1500.0,
        _ => 0.0,
    }
}

impl EffectSpec {
    /// `NAME[:key=value,...]` with the keys `size` and the effect's own parameter (`tau_s`, `width_c`, ...).
    ///
    /// # Errors
    /// A sentence that names what is wrong.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        if by_name(name).is_none() && !OUTSIDERS.contains(&name) {
            return Err(BadInput::new(format!(
                "effect \"{name}\" is not known; there are {}, {} and secret:SEED",
                ALL.iter().map(|f| f.name).collect::<Vec<_>>().join(", "),
                OUTSIDERS.join(", ")
            )));
        }
        let mut spec = Self { name: name.into(), parameter: default_parameter(name), size: 2.0 };
        for item in rest.split(',').filter(|s| !s.is_empty()) {
            let value = item.split_once('=').and_then(|(k, v)| v.parse::<f64>().ok().map(|v| (k, v)));
            match value {
                Some(("size", v)) => spec.size = v,
                Some((key, v))
                    if by_name(name).is_some_and(|f| f.parameters.contains(&key)) || OUTSIDERS.contains(&name) =>
                {
                    spec.parameter = v;
                }
                _ => {
                    return Err(BadInput::new(format!(
                        "effect {name}: \"{item}\" is not one of size=..., {}",
                        by_name(name).map_or("p=...".to_string(), |f| f.parameters.join("=..., "))
                    )))
                }
            }
        }
        Ok(spec)
    }

    /// Effect, parameter and size drawn by a seed; one in five from outside the library.
    #[must_use]
    pub fn secret(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5EC2_E75E_C2E7);
        let inside = ["cubic", "kink", "thermal-lag", "hysteresis", "axis-gradient", "warm-up", "step", "periodic"];
        let name = if rng.random_bool(0.2) {
            OUTSIDERS[rng.random_range(0..OUTSIDERS.len())]
        } else {
            inside[rng.random_range(0..inside.len())]
        };
        Self::drawn(name, rng.random_range(2.0..5.0), &mut rng)
    }

    /// A named effect of a size with its parameter drawn within what the physics allows.
    #[must_use]
    pub fn drawn(name: &str, size: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut range = |low: f64, high: f64| rng.random_range(low..high);
        let parameter = match name {
            "kink" => range(-18.0, 32.0),
            "thermal-lag" => range(1200.0, 6000.0),
            "hysteresis" => range(5.0, 25.0),
            "warm-up" => range(700.0, 4000.0),
            "step" => range(4000.0, 20_000.0),
            "periodic" => range(400.0, 3000.0),
            "outsider-ripple" => range(9.0, 16.0),
            "outsider-bump" => range(3.0, 7.0),
            "outsider-wave-train" => range(700.0, 2000.0),
            _ => 0.0,
        };
        Self { name: name.into(), parameter, size }
    }
}

/// Bias of one effect for one axis, with gain one.
pub(super) fn effect_bias(
    spec: &EffectSpec,
    plant: &Plant,
    recorded: &[Recorded],
    scaling: &Scaling,
    a: usize,
    mix: f64,
) -> Vec<f64> {
    let n = plant.board_c.len();
    if let Some(facts) = by_name(&spec.name) {
        let mut p = [spec.parameter as f32, 0.0];
        if spec.name == "temperature-shape" {
            p = [-38.0, 60.0];
        }
        let p: [f32; MAX_PARAMETERS] = p;
        let Some(mut running) = Running::new(facts.id, &p, 1.0) else {
            return vec![0.0; n];
        };
        // Effects with several regressors: a fixed mix.
        let weights = [1.0, mix, 0.5, -0.6, 0.4, 0.3, -0.3, 0.2];
        return (0..n)
            .map(|k| {
                let thermal = plant.thermal(k);
                let inputs = Inputs { scaling, thermal: &thermal, axis: a, recorded: recorded[k] };
                running.step(&inputs).iter().take(facts.outputs).zip(weights).map(|(x, w)| f64::from(*x) * w).sum()
            })
            .collect();
    }
    let t = &plant.resonator_c[a];
    let r = &plant.slope_c_per_min[a];
    let p = spec.parameter;
    let mut relay = 0.0;
    (0..n)
        .map(|k| {
            let s = k as f64;
            match spec.name.as_str() {
                // Interference ripple in temperature.
                "outsider-ripple" => (std::f64::consts::TAU * t[k] / p).sin(),
                // A mode crossing: a bump over a few degrees.
                "outsider-bump" => (-((t[k] - 12.0) / p).powi(2)).exp(),
                // Sloshing that starts with the second hour and dies out.
                "outsider-wave-train" => {
                    let x = s - 7000.0;
                    if x < 0.0 {
                        0.0
                    } else {
                        (std::f64::consts::TAU * x / p).sin() * (-x / 5000.0).exp()
                    }
                }
                // Rate of change acts only when cold.
                "outsider-product" => r[k] * (-(t[k] + 25.0) / 12.0).exp().min(3.0),
                // A relay with temperature memory: switches at 30 C rising and at -10 C falling.
                "outsider-relay" => {
                    if t[k] > 30.0 {
                        relay = 1.0;
                    } else if t[k] < -10.0 {
                        relay = 0.0;
                    }
                    relay
                }
                // Two bursts that come and go.
                _ => {
                    let burst = |c: f64, w: f64| (-((s - c) / w).powi(2)).exp();
                    burst(6000.0, 900.0) - 0.8 * burst(17_000.0, 1400.0)
                }
            }
        })
        .collect()
}

/// What a series leaves, RMS of 100 s means, after the baseline has taken its share.
pub(super) fn left_after_baseline(series: &[f64], plant: &Plant, scaling: &Scaling, a: usize) -> f64 {
    let columns: Vec<Vec<f64>> = (0..TERMS)
        .map(|j| {
            let column: Vec<f64> = (0..series.len())
                .map(|k| {
                    f64::from(
                        regressors(scaling, plant.resonator_c[a][k] as f32, plant.slope_c_per_min[a][k] as f32)[j],
                    )
                })
                .collect();
            block_means(&column, 100)
        })
        .collect();
    let y = block_means(series, 100);
    lsq::fit(&columns, &y, None, &[]).map_or_else(|_| std_dev(&y), |f| (f.squares / f.rows as f64).sqrt())
}
