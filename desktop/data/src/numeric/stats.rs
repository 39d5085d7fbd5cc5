//! Small statistics.

use statrs::distribution::{Beta, ContinuousCDF};

/// The 95 % interval of a share, `part` of `of` (Clopper and Pearson 1934).
#[must_use]
pub fn share_interval(part: usize, of: usize) -> (f64, f64) {
    let quantile = |a: usize, b: usize, p: f64| Beta::new(a as f64, b as f64).map_or(f64::NAN, |d| d.inverse_cdf(p));
    let low = if part == 0 { 0.0 } else { quantile(part, of - part + 1, 0.025) };
    let high = if part == of { 1.0 } else { quantile(part + 1, of - part, 0.975) };
    (low, high)
}

/// Sum of products. In eight sums, so that no addition waits for the one before, and the same on every processor. For functions
/// that are compiled for wider vectors; others take [`dot`].
#[inline(always)]
#[must_use]
pub fn sum_of_products(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a, b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a.remainder().iter().zip(b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a.zip(b) {
        add_products(&mut sums, a, b);
    }
    sums.iter().sum::<f64>() + rest
}

/// `x -= f q`.
#[inline(always)]
pub fn take_off(x: &mut [f64], f: f64, q: &[f64]) {
    for (x, q) in x.iter_mut().zip(q) {
        *x -= f * q;
    }
}

/// Inner product: [`sum_of_products`], compiled for wider vectors, too, where there are any; the sums are the same ones.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
#[must_use]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    sum_of_products(a, b)
}

/// Inner products of four columns with one: each as [`dot`] gives it, in less time than four of them.
#[multiversion::multiversion(targets("x86_64+avx2", "x86_64+avx512f"))]
#[must_use]
pub fn four_dots(a: [&[f64]; 4], b: &[f64]) -> [f64; 4] {
    let n = b.len();
    let (p, q, r, s) = (&a[0][..n], &a[1][..n], &a[2][..n], &a[3][..n]);
    let (mut of_p, mut of_q, mut of_r, mut of_s) = ([0.0; 8], [0.0; 8], [0.0; 8], [0.0; 8]);
    for at in (0..n / 8 * 8).step_by(8) {
        let part = at..at + 8;
        add_products(&mut of_p, &p[part.clone()], &b[part.clone()]);
        add_products(&mut of_q, &q[part.clone()], &b[part.clone()]);
        add_products(&mut of_r, &r[part.clone()], &b[part.clone()]);
        add_products(&mut of_s, &s[part.clone()], &b[part]);
    }
    let rest = n / 8 * 8..n;
    [
        sum_with_rest(&of_p, &p[rest.clone()], &b[rest.clone()]),
        sum_with_rest(&of_q, &q[rest.clone()], &b[rest.clone()]),
        sum_with_rest(&of_r, &r[rest.clone()], &b[rest.clone()]),
        sum_with_rest(&of_s, &s[rest.clone()], &b[rest]),
    ]
}

#[inline(always)]
fn add_products(sums: &mut [f64; 8], a: &[f64], b: &[f64]) {
    for k in 0..8 {
        sums[k] += a[k] * b[k];
    }
}

/// (Not inlined: the compiler would keep the four sums of each place side by side, in the place of the eight places of each sum.)
#[inline(never)]
fn sum_with_rest(sums: &[f64; 8], a: &[f64], b: &[f64]) -> f64 {
    sums.iter().sum::<f64>() + a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>()
}

/// Median; reorders `values`. `None` if empty.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let n = values.len();
    if n == 0 {
        return None;
    }
    let (_, m, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    Some(*m)
}

/// Mean of the finite values; NaN if there is none.
#[must_use]
pub fn mean(values: &[f64]) -> f64 {
    // Eight sums side by side: no addition waits for the one before.
    let (mut n, mut sums) = (0usize, [0.0; 8]);
    for chunk in values.chunks(8) {
        for (s, v) in sums.iter_mut().zip(chunk) {
            let there = v.is_finite();
            n += usize::from(there);
            *s += if there { *v } else { 0.0 };
        }
    }
    let s: f64 = sums.iter().sum();
    if n == 0 {
        f64::NAN
    } else {
        s / n as f64
    }
}

/// Standard deviation of the finite values about their mean; 0 for fewer than two.
#[must_use]
pub fn std_dev(values: &[f64]) -> f64 {
    let m = mean(values);
    let (mut n, mut s) = (0usize, 0.0);
    for v in values.iter().filter(|v| v.is_finite()) {
        n += 1;
        s += (v - m) * (v - m);
    }
    if n < 2 {
        0.0
    } else {
        (s / (n - 1) as f64).sqrt()
    }
}

/// Logarithm of the sum of numbers given by their logarithms; minus infinity of none.
#[must_use]
pub fn log_sum(logs: &[f64]) -> f64 {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return most;
    }
    most + logs.iter().map(|l| (l - most).exp()).sum::<f64>().ln()
}

/// Means over windows of `length` values; windows with less than half of their values are left out (NaN).
#[must_use]
pub fn block_means(values: &[f64], length: usize) -> Vec<f64> {
    values
        .chunks(length.max(1))
        .filter(|c| 2 * c.len() >= length)
        .map(|c| {
            let good = c.iter().filter(|v| v.is_finite()).count();
            if 2 * good >= length {
                mean(c)
            } else {
                f64::NAN
            }
        })
        .collect()
}

/// The value below which a share `p` of the `values` lies; NaN if empty.
#[must_use]
pub fn quantile(values: &[f64], p: f64) -> f64 {
    let mut v: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    if v.is_empty() {
        return f64::NAN;
    }
    let at = p.clamp(0.0, 1.0) * (v.len() - 1) as f64;
    let (_, low, above) = v.select_nth_unstable_by(at.floor() as usize, f64::total_cmp);
    let (low, share) = (*low, at - at.floor());
    if share > 0.0 {
        low + (above.iter().copied().fold(f64::INFINITY, f64::min) - low) * share
    } else {
        low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_inner_products_are_those_of_one_to_the_bit() {
        let wave = |n: usize, f: f64| (0..n).map(|k| (f * k as f64).sin() / 3.0).collect::<Vec<f64>>();
        for n in (0..40).chain([857]) {
            let (a, b) = ([0.3, 0.7, 1.1, 1.9].map(|f| wave(n + 3, f)), wave(n, 2.3));
            let four = four_dots([&a[0], &a[1], &a[2], &a[3]], &b);
            let each = [0, 1, 2, 3].map(|k: usize| dot(&a[k][..n], &b));
            assert_eq!(four.map(f64::to_bits), each.map(f64::to_bits), "{n}");
        }
    }

    #[test]
    fn block_means_skip_what_is_missing() {
        let v = [1.0, 3.0, f64::NAN, f64::NAN, f64::NAN, 5.0, 2.0];
        let b = block_means(&v, 2);
        assert_eq!(b[0], 2.0);
        assert!(b[1].is_nan());
        assert_eq!(&b[2..], &[5.0, 2.0]);
    }
}
