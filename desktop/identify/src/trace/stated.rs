//! Uncertainty of an axis, as an image states it.

use hrg_core::effects::MAX_PARAMETERS;

/// The uncertainty of one axis.
#[derive(Debug, Clone, Default)]
pub struct Stated {
    /// Variance that is the same at all times, (deg/h)^2.
    pub rest_dph2: f64,
    /// Each direction: a value for each coefficient of [`super::model::AxisFit`].
    pub directions: Vec<Vec<f64>>,
    /// Mean square of each over the train runs, (deg/h)^2.
    pub squares_dph2: Vec<f64>,
    /// For each term of the model: standard deviations of its refined parameters; NaN where none is.
    pub parameter_std: Vec<[f64; MAX_PARAMETERS]>,
}

impl Stated {
    /// With the largest directions only: the others join the rest.
    pub fn with_directions(&self, count: usize) -> Self {
        let mut fewer = self.clone();
        fewer.directions.truncate(count);
        fewer.rest_dph2 += self.squares_dph2.iter().skip(count).sum::<f64>();
        fewer
    }
}
