//! The constants of a unit at rest, measured against the earth's rate (`hrg unit zero`).

use hrg_core::link::Housekeeping;
use hrg_core::status::{AxisStatus, UnitStatus};
use hrg_core::zero::{Zero, MOST_DPH};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{block_means, mean, std_dev};

/// Least seconds without a flag.
pub const LEAST_S: usize = 60;

/// Seconds of a mean, whose scatter is that of the noise.
const MEAN_S: usize = 10;

/// Means of a unit at rest scatter by less than this many times what white noise of its seconds would: flicker and drift do three.
const MOST_SCATTER: f64 = 6.0;

/// Seconds of a unit at rest.
#[derive(Debug, Default)]
pub struct Measured {
    rates_dph: [Vec<f64>; AXES],
    /// Seconds that were left out, as the unit flagged them.
    pub flagged: usize,
}

/// Constants against those in use.
#[derive(Debug, Clone, Copy)]
pub struct Renewed {
    /// To be sent.
    pub zero: Zero,
    /// Rates less the earth's, deg/h: what was found beside the constants in use.
    pub found_dph: [f64; AXES],
}

impl Measured {
    /// Takes a second; one with a flag, of an axis or of the unit, is left out (a link that had garbage once is no fault of the rates).
    pub fn take(&mut self, h: &Housekeeping) {
        let axes = h.axis_status.iter().all(AxisStatus::is_empty);
        let unit = h.unit_status.difference(UnitStatus::LINK_ERRORS).is_empty();
        if !axes || !unit || h.corrected_dph.iter().any(|r| !r.is_finite()) {
            self.flagged += 1;
            return;
        }
        self.rates_dph.iter_mut().zip(h.corrected_dph).for_each(|(to, r)| to.push(r.into()));
    }

    /// Seconds that count.
    #[must_use]
    pub fn seconds(&self) -> usize {
        self.rates_dph[0].len()
    }

    /// The constants. `earth_dph`: the earth's rate along each axis; `attitude_deg`: standard uncertainty of the attitude, degrees; `in_use`:
    /// what the unit adds already.
    ///
    /// # Errors
    /// Too few seconds, a unit that moves, constants that no turn-on explains.
    pub fn constants(
        &self,
        earth_dph: [f64; AXES],
        attitude_deg: f64,
        in_use: &Zero,
        made_unix_s: u32,
    ) -> Result<Renewed, BadInput> {
        if self.seconds() < LEAST_S {
            return Err(BadInput::new(format!(
                "only {} seconds came without a flag ({} had one); {LEAST_S} are needed: wait until hrg monitor shows good",
                self.seconds(),
                self.flagged
            )));
        }
        let total = earth_dph.iter().map(|e| e * e).sum::<f64>().sqrt();
        let mut renewed = Renewed { zero: Zero { made_unix_s, ..*in_use }, found_dph: [0.0; AXES] };
        for (a, rates) in self.rates_dph.iter().enumerate() {
            let means = block_means(rates, MEAN_S);
            let differences: Vec<f64> = rates.windows(2).map(|w| w[1] - w[0]).collect();
            let white = std_dev(&differences) / 2f64.sqrt() / (MEAN_S as f64).sqrt();
            let scatter = std_dev(&means);
            if scatter > MOST_SCATTER * white {
                return Err(BadInput::new(format!(
                    "axis {}: means of {MEAN_S} s scatter by {scatter:.3} deg/h, {:.0} times what its noise would: the unit moves, or its temperature changes; let it stand",
                    AXIS_NAMES[a],
                    scatter / white
                )));
            }
            let found = mean(rates) - earth_dph[a];
            // An axis that is off by an angle sees so much more or less of the earth's rate; across it, to first order.
            let across = (total * total - earth_dph[a] * earth_dph[a]).max(0.0).sqrt() * attitude_deg.to_radians();
            let std = (scatter * scatter / means.len() as f64 + across * across).sqrt();
            let constant = f64::from(in_use.constant_dph[a]) + found;
            if constant.abs() > f64::from(MOST_DPH) {
                return Err(BadInput::new(format!(
                    "axis {}: {constant:.2} deg/h beside the calibration is more than a unit takes ({MOST_DPH}); check latitude, axes and the image",
                    AXIS_NAMES[a]
                )));
            }
            renewed.found_dph[a] = found;
            renewed.zero.constant_dph[a] = constant as f32;
            renewed.zero.std_dph[a] = std as f32;
        }
        Ok(renewed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn second(rates: [f32; AXES]) -> Housekeeping {
        Housekeeping { corrected_dph: rates, ..Housekeeping::default() }
    }

    /// White noise of 1 deg/h about these rates.
    fn measured(rates: [f32; AXES], seconds: u32, drift: f32) -> Measured {
        let mut m = Measured::default();
        let mut state = 1u32;
        for k in 0..seconds {
            let noise = [0; AXES].map(|_| {
                (0..12)
                    .map(|_| {
                        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                        (state >> 8) as f32 / 16_777_216.0
                    })
                    .sum::<f32>()
                    - 6.0
            });
            m.take(&second(core::array::from_fn(|a| rates[a] + noise[a] + drift * k as f32)));
        }
        m
    }

    #[test]
    fn the_constant_is_what_is_beside_the_earths_rate() {
        let earth = [10.0, 0.0, -11.0];
        let old = Zero { made_unix_s: 1, constant_dph: [0.5, 0.0, 0.0], std_dph: [0.0; AXES] };
        let r = measured([10.25, -1.0, -11.0], 600, 0.0).constants(earth, 0.1, &old, 77).expect("at rest");
        for (a, wanted) in [0.75, -1.0, 0.0].into_iter().enumerate() {
            let (constant, std) = (r.zero.constant_dph[a], r.zero.std_dph[a]);
            assert!((constant - wanted).abs() < 4.0 * std && (0.03..0.08).contains(&std), "{a}: {constant} {std}");
        }
        assert_eq!(r.zero.made_unix_s, 77);
        // With a poor attitude, the axis across the earth's rate is uncertain by it.
        let poor = measured([10.25, -1.0, -11.0], 600, 0.0).constants(earth, 5.0, &old, 77).expect("at rest");
        assert!((poor.zero.std_dph[1] - 14.866 * 5f32.to_radians()).abs() < 0.01, "{:?}", poor.zero);
    }

    #[test]
    fn movement_flags_and_absurd_constants_are_refused() {
        let none = Zero::default();
        let of = |m: &Measured| m.constants([0.0; AXES], 0.1, &none, 1).expect_err("refused").0;
        assert!(of(&measured([0.0; AXES], 50, 0.0)).contains("only 50 seconds"));
        assert!(of(&measured([0.0; AXES], 300, 0.1)).contains("the unit moves"));
        assert!(of(&measured([0.0, 0.0, 15.0], 300, 0.0)).contains("axis z: 15."));
        let mut m = Measured::default();
        m.take(&Housekeeping { axis_status: [AxisStatus::SETTLING; AXES], ..second([0.0; AXES]) });
        m.take(&Housekeeping { unit_status: UnitStatus::ADC_FAULT, ..second([0.0; AXES]) });
        m.take(&Housekeeping { unit_status: UnitStatus::LINK_ERRORS, ..second([0.0; AXES]) });
        assert_eq!((m.seconds(), m.flagged), (1, 2));
    }
}
