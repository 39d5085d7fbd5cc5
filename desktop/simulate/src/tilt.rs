//! A sensitive axis that its mounting tilts: a unit vector near an axis of the case, which goes with temperature linearly and a little with its square.

/// Components of a sensitive axis along the two others, by temperature.
#[derive(Debug, Clone)]
pub(super) struct Tilt {
    /// At 20 C, rad.
    pub at_20_c: [f64; 2],
    /// Per C, rad.
    pub per_c: [f64; 2],
    /// Per C^2, rad.
    pub per_c2: [f64; 2],
}

impl Tilt {
    /// The components at a temperature, rad.
    pub fn at(&self, t: f64) -> [f64; 2] {
        let dt = t - 20.0;
        [0, 1].map(|j: usize| self.at_20_c[j] + self.per_c[j] * dt + self.per_c2[j] * dt * dt)
    }

    /// Part along it of a vector, given along its own axis of the case and along the two others.
    pub fn along(&self, t: f64, own: f64, others: [f64; 2]) -> f64 {
        let tilts = self.at(t);
        let length = (1.0 + tilts[0] * tilts[0] + tilts[1] * tilts[1]).sqrt();
        (own + tilts[0] * others[0] + tilts[1] * others[1]) / length
    }
}
