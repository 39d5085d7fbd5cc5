//! One unit and its laboratory: every number that stays the same from run to run, but for the effects.

use crate::chamber::Chamber;
use crate::electrics::Electrics;
use crate::noise::Mixture;
use crate::sensors::{Curve, Sensor};
use crate::thermal::Network;

/// Numbers of a unit, of the sensors on it and of the chamber it stands in.
#[derive(Clone, Debug)]
pub struct Unit {
    /// Serial number.
    pub serial: u32,
    /// The chamber.
    pub chamber: Chamber,
    /// Thermal network.
    pub network: Network,
    /// Supply, drives, quadrature.
    pub electrics: Electrics,
    /// Frequency curves.
    pub curves: [Curve; 3],
    /// Case sensors, or the sensors that take the place of the frequency.
    pub sensors: [Sensor; 3],
    /// White noise of the frequency, Hz.
    pub frequency_noise_hz: [f64; 3],
    /// Noise floors to aim at, deg/h.
    pub floors_dph: [f64; 3],
    /// Noise of the rates.
    pub mixtures: [Mixture; 3],
    /// k0 [deg/h].
    pub k0_dph: [f64; 3],
    /// Shape of the equation-7 bias: k1 to k5, yet to be scaled.
    pub shape: [[f64; 5]; 3],
    /// Three sigma of that bias over the widest run, deg/h.
    pub three_sigma_dph: [f64; 3],
}
