//! Defects of real files: spikes, missing and stuck values, repeated times, a gap.

use hrg_core::AXES;
use hrg_data::recording::Recording;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Adds what real files have: spikes, missing values, gaps, stuck values, repeated times.
pub fn inject_defects(recording: &mut Recording, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0xD127);
    let n = recording.time_s.len();
    for a in 0..AXES {
        for _ in 0..n / 500 {
            let k = rng.random_range(0..n);
            recording.rate_dph[a][k] += if rng.random_bool(0.5) { 500.0 } else { -300.0 };
            let k = rng.random_range(0..n);
            recording.frequency_hz[a][k] += if rng.random_bool(0.5) { 3.0 } else { -5.0 };
            recording.rate_dph[a][rng.random_range(0..n)] = f64::NAN;
            recording.frequency_hz[a][rng.random_range(0..n)] = f64::NAN;
        }
        let at = rng.random_range(0..n - 200);
        let value = recording.rate_dph[a][at];
        recording.rate_dph[a][at..at + 120].fill(value);
    }
    for _ in 0..20 {
        let k = rng.random_range(1..n);
        recording.time_s[k] = recording.time_s[k - 1];
    }
    // A gap of three minutes: the rows are gone.
    let at = rng.random_range(n / 4..n / 2);
    for k in at..(at + 180).min(n) {
        recording.time_s[k] = f64::NAN;
    }
}
