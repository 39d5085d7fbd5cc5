//! Means of 100 s and their deviation: the measure of every figure in the truth.

/// Length of a mean, s.
pub const MEAN_S: f64 = 100.0;

/// Means over 100 s of the samples from `first` on; a rest shorter than 100 s is left out.
#[must_use]
pub fn means(x: &[f64], dt_s: f64, first: usize) -> Vec<f64> {
    let each = (MEAN_S / dt_s).round() as usize;
    x[first..].chunks_exact(each).map(|chunk| chunk.iter().sum::<f64>() / each as f64).collect()
}

/// Largest of |x| within each 100 s.
#[must_use]
pub fn peaks(x: &[f64], dt_s: f64, first: usize) -> Vec<f64> {
    let each = (MEAN_S / dt_s).round() as usize;
    x[first..].chunks_exact(each).map(|chunk| chunk.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()))).collect()
}

/// Standard deviation about the mean.
#[must_use]
pub fn deviation(x: &[f64]) -> f64 {
    let n = x.len().max(1) as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Root of the mean square of several figures.
#[must_use]
pub fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64).sqrt()
}
