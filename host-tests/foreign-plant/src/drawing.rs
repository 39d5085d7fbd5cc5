//! A unit, drawn for a case.

use crate::case::Case;
use crate::chamber::Chamber;
use crate::draw::{Properties, Seed};
use crate::electrics::Electrics;
use crate::noise::Mixture;
use crate::plan::Followed;
use crate::sensors::{Curve, Sensor};
use crate::thermal::Network;
use crate::unit::Unit;

impl Unit {
    /// The unit of `case` under `seed`.
    #[must_use]
    pub fn draw(case: &Case, seed: impl Into<Seed>) -> Self {
        let mut rng = Properties::new(seed.into(), &[&case.name, "unit"]);
        let rng = &mut rng;
        let chamber = Chamber::draw(rng);
        let network = Network::draw(rng);
        let electrics = Electrics::draw(rng);
        let curves = [0, 1, 2].map(|a| Curve::draw(rng, a));
        let thermometers = case.layout.followed != Followed::Resonator;
        let sensors = [0, 1, 2].map(|_| {
            let sensor = Sensor::draw(rng);
            // A thermometer that a fit leans on is a better one than a case sensor.
            let good = Sensor { lag_s: 5.0, step_c: 0.0078125, noise_c: 0.004, ..sensor };
            if thermometers {
                good
            } else {
                sensor
            }
        });
        let sign = |yes: bool| if yes { 1.0 } else { -1.0 };
        let shape = [0, 1, 2].map(|_| {
            let signs: [f64; 5] = [0, 1, 2, 3, 4].map(|_| sign(rng.random_bool(0.5)));
            [
                signs[0] * rng.random_range(0.02..0.06),
                signs[1] * rng.random_range(1e-4..6e-4),
                signs[2] * rng.random_range(0.2..1.0),
                signs[3] * rng.random_range(0.05..0.4),
                signs[4] * rng.random_range(0.003..0.015),
            ]
        });
        let (low, high) = case.floors_dph;
        let (from, to) = case.raw_three_sigma_dph;
        Self {
            serial: rng.serial(1000..9999),
            chamber,
            network,
            electrics,
            curves,
            sensors,
            frequency_noise_hz: [0, 1, 2].map(|_| rng.random_range(5e-5..3e-4)),
            floors_dph: [0, 1, 2].map(|_| low * (high / low).powf(rng.share())),
            mixtures: [0, 1, 2].map(|_| Mixture::draw(rng, &case.noise)),
            k0_dph: [0, 1, 2].map(|_| rng.random_range(-10.0..10.0)),
            shape,
            three_sigma_dph: [0, 1, 2].map(|_| rng.random_range(from..to)),
        }
    }
}
