//! Electrical quantities of a unit: drive and quadrature.

use crate::draw::Properties;

/// Electrical numbers of one unit.
#[derive(Clone, Copy, Debug)]
pub struct Electrics {
    pub(crate) drive_v: [f64; 3],
    pub(crate) drive_per_c: [f64; 3],
    pub(crate) quad_v: [f64; 3],
    pub(crate) quad_v_per_c: [f64; 3],
}

impl Electrics {
    /// A unit.
    #[must_use]
    pub fn draw(rng: &mut Properties) -> Self {
        let mut three = |from: f64, to: f64| [0, 1, 2].map(|_| rng.random_range(from..to));
        Self {
            drive_v: three(1.1, 1.4),
            drive_per_c: three(8e-4, 1.6e-3),
            quad_v: three(0.05, 0.11),
            quad_v_per_c: three(2e-4, 6e-4),
        }
    }
}
