//! Shared parts of the families: geometric ladders of times and widths, and piecewise-linear curves over knots.

/// Rung `k` of `n` between `low` and `high`, evenly in the logarithm; `low` where there is nothing between.
pub fn rung(low: f32, high: f32, k: usize, n: usize) -> f32 {
    let ratio = if high > low && low > 0.0 { high / low } else { 1.0 };
    low * libm::expf(libm::logf(ratio) * k as f32 / (n - 1) as f32)
}

/// Weights of `N` knots evenly over `low..high` at `x`: two neighbours share one; beyond the ends the last knot has it all, so
/// that a curve continues as its edge is.
#[inline]
pub fn hats<const N: usize>(x: f32, low: f32, high: f32) -> [f32; N] {
    let mut out = [0.0; N];
    let (k, part) = cell::<N>(x, low, high);
    out[k] = 1.0 - part;
    out[k + 1] = part;
    out
}

/// The knot at or below `x` (at most the last but one), and how far `x` is on the way to the next, 0 to 1.
#[inline]
pub fn cell<const N: usize>(x: f32, low: f32, high: f32) -> (usize, f32) {
    let span = if high > low { high - low } else { 1.0 };
    let at = crate::bias::clamp((x - low) / span, 0.0, 1.0) * (N - 1) as f32;
    // (NaN is no number of a knot: it becomes the first.)
    let k = (at as usize).min(N - 2);
    (k, at - k as f32)
}
