//! Kinds of units: what bias and noise each has.

use super::noise::Noise;
use hrg_core::bias::{regressors, Scaling, TERMS};
use hrg_core::AXES;
use hrg_data::error::BadInput;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Kind of unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// A unit like dong2023's: eq 7.
    #[default]
    Hrg,
    /// A fibre-optic gyro like wu2023's: four parameters and a breakpoint. With resonators for thermometers, its frequency column
    /// stands for its temperature sensor.
    Fog,
    /// A gyro like zhao2022's: bias a curve of temperature that bends more than a cubic.
    Zhao,
}

impl Kind {
    /// By name: hrg, fog, zhao.
    ///
    /// # Errors
    /// Any other name.
    pub fn parse(name: &str) -> Result<Self, BadInput> {
        match name {
            "hrg" => Ok(Self::Hrg),
            "fog" => Ok(Self::Fog),
            "zhao" => Ok(Self::Zhao),
            _ => Err(BadInput::new(format!("kind \"{name}\" is not known; there are hrg, fog and zhao"))),
        }
    }

    /// Noise of such a gyro, of the size that its paper is left with.
    #[must_use]
    pub fn noise(self) -> Noise {
        let hrg = Noise::default();
        let of = |white_100s_dph, flicker_dph, walk_per_root_h_dph| Noise {
            white_100s_dph,
            flicker_dph,
            walk_per_root_h_dph,
            ..hrg
        };
        match self {
            Self::Hrg => hrg,
            Self::Fog => of(0.0055, 0.0005, 0.0003),
            Self::Zhao => of(0.06, 0.008, 0.008),
        }
    }

    /// The bias of a unit of this kind at a temperature (C) and its rate of change (C per minute).
    pub(super) fn bias(self, unit_seed: u64) -> impl Fn(&Scaling, usize, f64, f64) -> f64 {
        let coefficients = unit_coefficients(unit_seed);
        let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(71));
        // Each axis of each unit a little different.
        let own: [[f64; 5]; AXES] = [0; AXES].map(|_| [0; 5].map(|_| rng.random_range(0.7..1.3)));
        move |scaling, a, t, r| {
            let o = &own[a];
            match self {
                Self::Hrg => {
                    let x = regressors(scaling, t as f32, r as f32);
                    x.iter().zip(&coefficients[a]).map(|(x, c)| f64::from(*x) * c).sum()
                }
                // deg/h: raw standard deviation about 0.016 on the profile `wu` (theirs: 0.0156).
                Self::Fog => {
                    let x = t - 20.0 * o[4];
                    let change = if r < 0.0 { 0.011 * o[0] } else { 0.017 * o[1] };
                    let slope = if x < 0.0 { -0.00022 * o[2] } else { 0.00035 * o[3] };
                    0.3 + change * r + slope * x
                }
                // deg/h: from about -2.4 to -11 between 0 and 60 C of the chamber, with a slope at 0 C, where its time constant is read from the
                // output (theirs).
                Self::Zhao => {
                    let x = (t - 6.7) / 60.0;
                    let bend = 2.6 * o[0];
                    let s = |x: f64| (bend * (2.0 * x - 0.9 * o[1])).tanh();
                    let curve = 0.5 * x + 0.5 * (s(x) - s(0.0)) / (s(1.0) - s(0.0));
                    -2.4497 - 8.5716 * curve + 0.25 * o[2] * (7.0 * o[3] * x).sin()
                }
            }
        }
    }
}

/// The bias model that a simulated unit is given: eq 7 in the scaling of the uncalibrated image.
fn unit_coefficients(unit_seed: u64) -> [[f64; TERMS]; AXES] {
    let mut rng = ChaCha8Rng::seed_from_u64(unit_seed.wrapping_mul(0x9E37_79B9).wrapping_add(17));
    [0, 1, 2].map(|_| {
        // deg/h at u = 1 (45 C from the middle) and at 1 C per minute: sizes that give dong2023's raw 7 to
        // 10 deg/h (3 sigma).
        [3.0, 3.2, 1.3, 0.6, 0.08, 0.25]
            .map(|s| s * (0.5 + rng.random::<f64>()) * if rng.random_bool(0.5) { 1.0 } else { -1.0 })
    })
}
