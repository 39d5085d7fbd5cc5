//! Temperature and supply of the unit's own processor, from its ADC and three numbers of its maker.
//!
//! The ADC compares with its supply. So the conversion of the internal reference tells the supply, and with it the conversion of the internal
//! thermometer the temperature. The maker has measured both at 3.3 V, the thermometer at 30 and 110 C, and written the codes into the
//! chip (STM32F446 data sheet, tables of the internal reference and of the temperature sensor). A code is 0.3 C, and 2 mV of the supply; the
//! thermometer is 1.5 C off at most, and self-heating is in it: as an input of the model only its changes matter.
//!
//! # Example
//! ```
//! use hrg_core::chip::Factory;
//!
//! let factory = Factory { reference: 1502, at_30_c: 943, at_110_c: 1196 };
//! let (supply_v, temperature_c) = factory.values([1502, 943, 944, 942]).expect("possible");
//! assert_eq!((supply_v, temperature_c), (3.3, 30.0));
//! ```

/// Supply at which the maker's codes were measured, V.
const MEASURED_AT_V: f32 = 3.3;
/// Temperatures of the two codes of the thermometer, C.
const COLD_C: f32 = 30.0;
const HOT_C: f32 = 110.0;
/// Largest code of 12 bits.
const MOST: u16 = 4095;

/// Conversions of one look: the reference, then the thermometer three times.
pub const CONVERSIONS: usize = 4;

/// The maker's codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Factory {
    /// The internal reference, at 3.3 V.
    pub reference: u16,
    /// The thermometer at 30 C and 3.3 V.
    pub at_30_c: u16,
    /// The same at 110 C.
    pub at_110_c: u16,
}

impl Factory {
    /// Supply, V, and temperature, C; `None`: the maker's codes are not there, or a conversion is none.
    #[must_use]
    pub fn values(&self, [reference, thermometer @ ..]: [u16; CONVERSIONS]) -> Option<(f32, f32)> {
        let possible = |code: u16| (1..=MOST).contains(&code);
        let there =
            [self.reference, self.at_30_c, self.at_110_c, reference].into_iter().chain(thermometer).all(possible);
        if !there || self.at_110_c <= self.at_30_c {
            return None;
        }
        let share = f32::from(self.reference) / f32::from(reference);
        let sum: u16 = thermometer.iter().sum();
        let code = f32::from(sum) / thermometer.len() as f32 * share;
        let per_c = f32::from(self.at_110_c - self.at_30_c) / (HOT_C - COLD_C);
        Some((MEASURED_AT_V * share, COLD_C + (code - f32::from(self.at_30_c)) / per_c))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACTORY: Factory = Factory { reference: 1500, at_30_c: 940, at_110_c: 1190 };

    #[test]
    fn the_supply_scales_both() {
        // At 3.0 V every code is a tenth larger than at 3.3.
        let codes = |c: f32| {
            [1650, 0, 0, 0].map(|r: u16| if r > 0 { r } else { ((940.0 + 3.125 * (c - 30.0)) * 1.1).round() as u16 })
        };
        for c in [-40.0, 0.0, 30.0, 85.0] {
            let (v, t) = FACTORY.values(codes(c)).expect("possible");
            assert!((v - 3.0).abs() < 1e-6 && (t - c).abs() < 0.2, "{c}: {v} V, {t} C");
        }
    }

    #[test]
    fn without_the_makers_codes_or_a_conversion_there_is_nothing() {
        let good = [1500, 940, 940, 940];
        assert!(FACTORY.values(good).is_some());
        for k in 0..CONVERSIONS {
            for bad in [0, 4096, u16::MAX] {
                let mut codes = good;
                codes[k] = bad;
                assert_eq!(FACTORY.values(codes), None);
            }
        }
        for factory in [
            Factory { reference: u16::MAX, ..FACTORY },
            Factory { at_30_c: 0, ..FACTORY },
            Factory { at_110_c: 940, ..FACTORY },
        ] {
            assert_eq!(factory.values(good), None);
        }
    }
}
