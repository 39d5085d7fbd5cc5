//! Effects put into a simulated run: those of the library, and some that it does not have.

use super::plant::Plant;
use hrg_core::bias::{regressors, Scaling, TERMS};
use hrg_core::effects::{shape, EffectId, Inputs, Reach, Running, ALL, MAX_PARAMETERS};
use hrg_core::inputs::Quantities;
use hrg_data::cards;
use hrg_data::cards::card;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{block_means, std_dev};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// An effect that the library does not have: what the tool should call unexplained (or a shape of temperature).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unmodelled {
    /// Interference ripple in temperature, with a period in C.
    Ripple,
    /// A mode crossing: a bump over a few degrees.
    Bump,
    /// Sloshing that starts with the second hour and dies out, with a period in s.
    WaveTrain,
    /// The rate of change acts only when cold.
    Product,
    /// A relay with temperature memory: switches at 30 C rising and at -10 C falling.
    Relay,
    /// Two bursts that come and go.
    DriftBurst,
}

impl Unmodelled {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Ripple, Self::Bump, Self::WaveTrain, Self::Product, Self::Relay, Self::DriftBurst];

    /// The name in commands and tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ripple => "unmodelled-ripple",
            Self::Bump => "unmodelled-bump",
            Self::WaveTrain => "unmodelled-wave-train",
            Self::Product => "unmodelled-product",
            Self::Relay => "unmodelled-relay",
            Self::DriftBurst => "unmodelled-drift-burst",
        }
    }

    fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|u| u.name() == name)
    }

    /// Its parameter unless told otherwise, and the range from which it is drawn.
    fn parameter(self) -> (f64, Option<[f64; 2]>) {
        match self {
            Self::Ripple => (14.0, Some([9.0, 16.0])),
            Self::Bump => (5.0, Some([3.0, 7.0])),
            Self::WaveTrain => (1500.0, Some([700.0, 2000.0])),
            Self::Product | Self::Relay | Self::DriftBurst => (0.0, None),
        }
    }

    /// Its bias with gain one, from temperatures (C) and their slopes (C per minute) each second.
    fn bias(self, t: &[f64], r: &[f64], p: f64) -> Vec<f64> {
        let mut relay = 0.0;
        (0..t.len())
            .map(|k| {
                let s = k as f64;
                match self {
                    Self::Ripple => (std::f64::consts::TAU * t[k] / p).sin(),
                    Self::Bump => (-((t[k] - 12.0) / p).powi(2)).exp(),
                    Self::WaveTrain => {
                        let x = s - 7000.0;
                        if x < 0.0 {
                            0.0
                        } else {
                            (std::f64::consts::TAU * x / p).sin() * (-x / 5000.0).exp()
                        }
                    }
                    Self::Product => r[k] * (-(t[k] + 25.0) / 12.0).exp().min(3.0),
                    Self::Relay => {
                        if t[k] > 30.0 {
                            relay = 1.0;
                        } else if t[k] < -10.0 {
                            relay = 0.0;
                        }
                        relay
                    }
                    Self::DriftBurst => {
                        let burst = |c: f64, w: f64| (-((s - c) / w).powi(2)).exp();
                        burst(6000.0, 900.0) - 0.8 * burst(17_000.0, 1400.0)
                    }
                }
            })
            .collect()
    }
}

/// Source of an effect that can be put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// An effect of the library.
    Library(EffectId),
    /// One that the library does not have.
    Unmodelled(Unmodelled),
}

impl Source {
    /// The name in commands and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Library(effect) => effect.name(),
            Self::Unmodelled(effect) => effect.name(),
        }
    }

    /// The inner parameters unless told otherwise, and the range from which the first is drawn.
    fn parameters(self) -> ([f64; MAX_PARAMETERS], Option<[f64; 2]>) {
        match self {
            Self::Library(effect) => {
                let generator = card(effect).generator;
                (generator.usual, generator.range)
            }
            Self::Unmodelled(effect) => {
                let (usual, range) = effect.parameter();
                ([usual, 0.0], range)
            }
        }
    }

    /// `true` if a unit can compensate it.
    #[must_use]
    pub fn on_unit(self) -> bool {
        matches!(self, Self::Library(effect) if effect.facts().reach == Reach::Unit)
    }
}

/// An effect to put in: which, its parameters, its size.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectSpec {
    /// The effect.
    pub source: Source,
    /// Inner parameters, in their units.
    pub parameters: [f64; MAX_PARAMETERS],
    /// Residual of it after the baseline fit, RMS of 100 s means, in noise floors.
    pub size: f64,
}

impl EffectSpec {
    /// `NAME[:key=value,...]` with the keys `size` and the effect's own parameters (`tau_s`, `width_c`, ...).
    ///
    /// # Errors
    /// A sentence that names what is wrong.
    pub fn parse(text: &str) -> Result<Self, BadInput> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let known = EffectId::by_name(name).map(Source::Library);
        let Some(source) = known.or_else(|| Unmodelled::by_name(name).map(Source::Unmodelled)) else {
            return Err(BadInput::new(format!(
                "effect \"{name}\" is not known; there are {}, {} and secret:SEED",
                ALL.iter().map(|f| f.name).collect::<Vec<_>>().join(", "),
                Unmodelled::ALL.map(Unmodelled::name).join(", ")
            )));
        };
        let names = match source {
            Source::Library(effect) => effect.facts().parameters,
            Source::Unmodelled(_) => &["p"],
        };
        let mut spec = Self { source, parameters: source.parameters().0, size: 2.0 };
        for item in rest.split(',').filter(|s| !s.is_empty()) {
            let value = item.split_once('=').and_then(|(k, v)| v.parse::<f64>().ok().map(|v| (k, v)));
            let place = value.and_then(|(key, v)| names.iter().position(|n| *n == key).map(|at| (at, v)));
            match (value, place) {
                // (A unit has it in single precision.)
                (Some((key, v)), _) if !(v as f32).is_finite() => {
                    return Err(BadInput::new(format!("effect {name}: {key} is {v}; give a number")));
                }
                (_, Some((at, v))) if must_be_positive(source, at) && (v as f32) <= 0.0 => {
                    return Err(BadInput::new(format!("effect {name}: {} is {v}; give a number above 0", names[at])));
                }
                (_, Some((at, v))) if names[at].ends_with("_c") && v.abs() > 1000.0 => {
                    return Err(BadInput::new(format!("effect {name}: {} is {v} C; no gyro comes there", names[at])));
                }
                (_, Some((at, v))) if names[at].ends_with("_s") && v < 0.0 => {
                    return Err(BadInput::new(format!(
                        "effect {name}: {} is {v}; give a time of 0 or more",
                        names[at]
                    )));
                }
                (Some(("size", v)), _) => spec.size = v,
                (_, Some((at, v))) => spec.parameters[at] = v,
                _ => {
                    return Err(BadInput::new(format!(
                        "effect {name}: \"{item}\" is not one of size=...{}",
                        names.iter().map(|n| format!(", {n}=...")).collect::<String>()
                    )))
                }
            }
        }
        let place = |name: &str| names.iter().position(|n| *n == name);
        if let (Some(low), Some(high)) = (place("low_c"), place("high_c")) {
            let (low, high) = (spec.parameters[low], spec.parameters[high]);
            if low >= high {
                return Err(BadInput::new(format!(
                    "effect {name}: low_c is {low} and high_c is {high}; give a low_c below high_c"
                )));
            }
        }
        Ok(spec)
    }

    /// Effect, parameter and size drawn by a seed; one in five is not modelled.
    #[must_use]
    pub fn secret(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x5EC2_E75E_C2E7);
        let inside: Vec<EffectId> = cards::all().filter(|(_, c)| c.generator.secret).map(|(f, _)| f.effect).collect();
        let source = if rng.random_bool(0.2) {
            Source::Unmodelled(Unmodelled::ALL[rng.random_range(0..Unmodelled::ALL.len())])
        } else {
            Source::Library(inside[rng.random_range(0..inside.len())])
        };
        Self::drawn(source, rng.random_range(2.0..5.0), &mut rng)
    }

    /// An effect of a size with its parameter drawn within what the physics allows.
    #[must_use]
    pub fn drawn(source: Source, size: f64, rng: &mut ChaCha8Rng) -> Self {
        let (mut parameters, range) = source.parameters();
        if let Some([low, high]) = range {
            parameters[0] = rng.random_range(low..high);
        }
        Self { source, parameters, size }
    }
}

/// `true` for an inner parameter that is a time, a width, a period or a ramp.
fn must_be_positive(source: Source, at: usize) -> bool {
    match source {
        Source::Library(effect) => shape(effect.facts().id).is_some_and(|s| s.positive[at]),
        Source::Unmodelled(_) => false,
    }
}

/// Bias of one effect for one axis, with gain one.
pub(super) fn effect_bias(
    spec: &EffectSpec,
    plant: &Plant,
    quantities: &[Quantities],
    scaling: &Scaling,
    a: usize,
    mix: f64,
) -> Vec<f64> {
    let n = plant.board_c.len();
    let effect = match spec.source {
        Source::Library(effect) => effect.facts(),
        Source::Unmodelled(effect) => {
            return effect.bias(&plant.resonator_c[a], &plant.slope_c_per_min[a], spec.parameters[0])
        }
    };
    let Some(mut running) = Running::new(effect.id, &spec.parameters.map(|p| p as f32), 1.0) else {
        return vec![0.0; n];
    };
    // Effects with several regressors: a fixed mix.
    let weights = [1.0, mix, 0.5, -0.6, 0.4, 0.3, -0.3, 0.2];
    (0..n)
        .map(|k| {
            let thermal = plant.thermal(k);
            let inputs = Inputs { scaling, thermal: &thermal, axis: a, quantities: &quantities[k] };
            running.step(&inputs).iter().take(effect.outputs).zip(weights).map(|(x, w)| f64::from(*x) * w).sum()
        })
        .collect()
}

/// Residual of a series after the baseline fit, RMS of 100 s means.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back() {
        for u in Unmodelled::ALL {
            assert_eq!(EffectSpec::parse(u.name()).expect("known").source, Source::Unmodelled(u));
        }
        assert!(EffectSpec::parse("ripple").is_ok_and(|s| s.source == Source::Library(EffectId::Ripple)));
        assert!(EffectSpec::parse("bump").is_err());
    }

    #[test]
    fn each_parameter_is_set_by_its_name() {
        let s = EffectSpec::parse("relay:off_c=-5,size=3").expect("known");
        assert_eq!((s.parameters, s.size), ([30.0, -5.0], 3.0));
        for (text, told) in [
            ("warm-up:tau_s=-5", "tau_s is -5; give a number above 0"),
            ("widening-play:width_hot_c=0", "width_hot_c is 0; give a number above 0"),
            ("kink:break_c=inf", "break_c is inf; give a number"),
            ("kink:size=NaN", "size is NaN; give a number"),
            ("thermal-lag:size=1e300", "give a number"),
            ("thermal-lag:tau_s=1e-50", "give a number above 0"),
            ("timebase:lag_s=-5", "give a time of 0 or more"),
            ("ramp-band:middle_c=1e30", "no gyro comes there"),
            ("temperature-shape:low_c=5,high_c=-5", "low_c is 5 and high_c is -5; give a low_c below high_c"),
        ] {
            let refused = EffectSpec::parse(text).expect_err("refused").0;
            assert!(refused.contains(told), "{text}: {refused}");
        }
        assert!(EffectSpec::parse("kink:break_c=-5").is_ok(), "a temperature may be below zero");
        assert!(EffectSpec::parse("relay:width_c=1").expect_err("refused").0.contains("on_c=..., off_c=..."));
    }
}
