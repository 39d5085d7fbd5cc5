//! Quality of rates: residual scale factor and misalignment after the correction, by temperature; asymmetry and nonlinearity.

use super::Dwell;
use hrg_core::rate_factors::OTHERS;
use hrg_core::AXES;
use hrg_data::numeric::stats::{mean, std_dev};

/// Residual of an axis at a temperature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// The axis.
    pub axis: usize,
    /// Mean temperature, C.
    pub temperature_c: f64,
    /// Scale factor less one, ppm: slope of the corrected rate over the table's.
    pub scale_ppm: f64,
    /// Response of the axis to rates about the two others, urad.
    pub cross_urad: [f64; 2],
    /// Middle of plus and minus rates, deg/h (of specific forces m/s^2): the bias that is left, and of rates the earth's along the table's axis.
    pub middle: f64,
    /// Standard deviation of the scale factor by what its values scatter, ppm.
    pub scale_std_ppm: f64,
}

/// Width of a bin of temperature, C.
const BIN_C: f64 = 10.0;

/// Slope of the corrected rate of axis `a` over the rate about `about`, of one visit, ppm, and its weight; `None` where it was not turned both ways.
fn slope_ppm(visit: &[Dwell], a: usize, about: usize) -> Option<(f64, f64)> {
    if visit[0].about != Some(about) {
        return None;
    }
    let of = |d: &Dwell| vec![d.corrected[a] - d.table[a], d.given()];
    let (change, seconds) = super::plus_less_minus(visit, &of)?;
    Some((1e6 * change[0] / change[1], change[1] * change[1] * seconds)).filter(|s| s.0.is_finite())
}

/// Middle of the plus and the minus rates of a visit, in axis `a`, and its weight.
fn middle(visit: &[Dwell], a: usize) -> Option<(f64, f64)> {
    let (plus, minus, seconds) = super::plus_and_minus(visit, &|d| vec![d.corrected[a] - d.table[a]])?;
    Some((0.5 * (plus[0] + minus[0]), seconds))
}

/// Mean by weights, and its standard deviation by the scatter of the values; NaN of a single one.
fn weighted(values: &[(f64, f64)]) -> (f64, f64) {
    let total: f64 = values.iter().map(|v| v.1).sum();
    let mean = values.iter().map(|v| v.0 * v.1).sum::<f64>() / total;
    if values.len() < 2 {
        return (mean, f64::NAN);
    }
    let scatter = values.iter().map(|v| v.1 * (v.0 - mean).powi(2)).sum::<f64>() / total;
    (mean, (scatter / (values.len() - 1) as f64).sqrt())
}

/// Dwells of each visit.
pub(crate) fn visits(dwells: &[Dwell]) -> impl Iterator<Item = &[Dwell]> {
    dwells.chunk_by(|p, q| p.visit == q.visit)
}

/// Fewer visits about an axis say more of noise than of the unit.
const LEAST_VISITS: usize = 3;

/// Residuals by axis and temperature, coldest first, in bins of 10 C that have three visits about each axis.
#[must_use]
pub fn bins(dwells: &[Dwell]) -> Vec<Bin> {
    bins_of(dwells, LEAST_VISITS)
}

/// The same, where fewer visits about each axis are enough for a bin.
#[must_use]
pub fn bins_of(dwells: &[Dwell], least_visits: usize) -> Vec<Bin> {
    let mut out = Vec::new();
    for axis in 0..AXES {
        let mut by_bin = std::collections::BTreeMap::<i64, ([Vec<(f64, f64)>; AXES], Vec<f64>, Vec<(f64, f64)>)>::new();
        for visit in visits(dwells) {
            let Some(about) = visit[0].about else { continue };
            let t = mean(&visit.iter().map(|d| d.temperature_c[axis]).collect::<Vec<_>>());
            let Some(slope) = slope_ppm(visit, axis, about) else { continue };
            let bin = by_bin.entry((t / BIN_C).floor() as i64).or_default();
            bin.0[about].push(slope);
            bin.1.push(t);
            bin.2.extend(middle(visit, axis));
        }
        for (slopes, t, middles) in by_bin.into_values().filter(|(s, _, _)| s.iter().all(|v| v.len() >= least_visits)) {
            let (scale_ppm, scale_std_ppm) = weighted(&slopes[axis]);
            out.push(Bin {
                axis,
                temperature_c: mean(&t),
                scale_ppm,
                cross_urad: OTHERS[axis].map(|j| weighted(&slopes[j]).0),
                middle: weighted(&middles).0,
                scale_std_ppm,
            });
        }
    }
    out
}

/// Uncompensated errors of an axis: value and standard deviation; `None` if the runs have rates of one size only, which does not separate
/// the error from the bias or the scale factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quality {
    /// Scale factor of plus rates less that of minus rates, ppm.
    pub asymmetry_ppm: Option<(f64, f64)>,
    /// Gain of the scale factor from zero to the highest rate, by the square of the rate, ppm.
    pub nonlinearity_ppm: Option<(f64, f64)>,
}

/// Asymmetry and nonlinearity of an axis, from pairs of its visits after each other whose rates differ in size.
#[must_use]
pub fn quality(dwells: &[Dwell], axis: usize) -> Quality {
    // Of each visit: size of the rate, what plus and minus have in common, and their slope.
    let own: Vec<(f64, f64, f64)> = visits(dwells)
        .filter(|v| v[0].about == Some(axis))
        .filter_map(|v| {
            let (slope, _) = slope_ppm(v, axis, axis)?;
            let of = |sign: f64| -> Vec<f64> {
                let own = v.iter().filter(|d| sign * d.given() > 0.0);
                own.map(|d| d.corrected[axis] - d.table[axis]).collect()
            };
            let size = mean(&v.iter().map(|d| d.given().abs()).collect::<Vec<_>>());
            Some((size, 0.5 * (mean(&of(1.0)) + mean(&of(-1.0))), slope))
        })
        .collect();
    let top = own.iter().fold(0.0f64, |m, v| m.max(v.0));
    let (mut asymmetry, mut nonlinearity) = (Vec::new(), Vec::new());
    for pair in own.chunks_exact(2) {
        let [(size, common, slope), (other_size, other_common, other_slope)] = [pair[0], pair[1]];
        if (size - other_size).abs() < 0.1 * top {
            continue;
        }
        // Half of it on either side: common = asymmetry / 2 * |rate|.
        asymmetry.push(2e6 * (common - other_common) / (size - other_size));
        nonlinearity.push((slope - other_slope) * top * top / (size * size - other_size * other_size));
    }
    let of = |v: &[f64]| (v.len() >= 3).then(|| (mean(v), std_dev(v) / (v.len() as f64).sqrt()));
    Quality { asymmetry_ppm: of(&asymmetry), nonlinearity_ppm: of(&nonlinearity) }
}
