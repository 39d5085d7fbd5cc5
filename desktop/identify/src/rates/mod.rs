//! Scale factor and misalignment over temperature, from runs on a rate table in a chamber.
//!
//! # How
//! A [`Dwell`] is a time at one rate. Of each dwell `unbiased` is the mean raw rate less the bias of the calibration. The model of
//! [`hrg_core::rate_factors`] is linear in what is sought:
//!
//! `table_i - unbiased_i = 1e-6 (sum_k c_k x_k unbiased_i + sum_j (m0_ij + m1_ij u) S_j unbiased_j) + constant of the visit`
//!
//! with the unit's own regressors `x`. The constant of a visit (dwells of both signs about one axis, after each other) holds the earth's
//! rate along the table's axis and the residual of the bias model; plus less minus rates are free of it. So each visit about axis i gives a
//! value of its scale factor, and one of its share in each other axis. A [`Curve`] goes through the values of each. Terms that the schemes
//! of the runs do not tell apart are left out, and stated ([`separable`]).
//!
//! # Asymmetry and nonlinearity
//! They are not compensated. Two visits of an axis after each other with rates of different size give one value each: the mean of plus and minus
//! changes by the asymmetry times the change of rate, half their difference by the nonlinearity. A slow change of the bias cancels.

mod curve;
mod dwells;
mod lacks;
mod quality;

pub use curve::Curve;
pub(crate) use curve::Point;
pub(crate) use dwells::{by_step, of_values, Given, Values};
pub use dwells::{dwells, dwells_of_unit, Dwell};
pub use lacks::lacking;
pub use quality::{bins, bins_of, quality, Bin, Quality};

use crate::fit::independence::{same_unit, Units};
use hrg_core::bias::{Scaling, State};
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{scale_regressors, RateAxis, MISALIGNMENT_TERMS, OTHERS, SCALE_TERMS, STATED_AT};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::mean;
use hrg_data::recording::Recording;
use nalgebra::{DMatrix, DVector};
pub(crate) use quality::visits;

/// Coefficients of an axis: those of its scale factor, then both misalignments at `u = 0`, then both per `u`.
pub const TERMS: usize = SCALE_TERMS + 2 * MISALIGNMENT_TERMS;

/// A regressor of which the others leave less than this share is not told apart from them.
pub const LEAST_LEFT: f64 = 1e-3;

/// Order in which terms are given up where they are not told apart: the ramps, the powers of temperature from the highest, the misalignments' slopes.
const GIVEN_UP: [usize; 7] = [5, 4, 3, 2, 9, 8, 1];

/// A ramp that moved less than this over all dwells is none, C per minute: the slope of a soak is noise.
const LEAST_RAMP: f64 = 0.1;

/// Chamber profile for the eight steps: soaks over the whole range, and a slow ramp back.
pub const CHAMBER: &str = "20,-40@1,2.5h,-15@1,2.5h,10@1,2.5h,35@1,2.5h,60@1,2.5h,-40@0.4";

/// Margin of the stated range beyond the data of the fit: the noise of temperature and slope on another day.
const MARGIN_C: f32 = 1.0;
/// The same for ramps, C per minute.
const MARGIN_C_PER_MIN: f32 = 0.1;

/// Fit of an axis.
#[derive(Debug, Clone)]
pub struct AxisFit {
    /// Correction of its scale factor, ppm.
    pub scale: Curve,
    /// Its misalignments, urad, in the order of [`OTHERS`].
    pub misalignment: [Curve; 2],
    /// Terms that the runs did not tell apart.
    pub left_out: Vec<String>,
}

impl AxisFit {
    /// Correction of the scale factor in a thermal state, ppm, and its standard deviation: noise, and what the curve does not follow.
    #[must_use]
    pub fn scale_at(&self, scaling: &Scaling, temperature_c: f64, ramp_c_per_min: f64) -> (f64, f64) {
        let x = scale_regressors(scaling, temperature_c as f32, ramp_c_per_min as f32);
        self.scale.along(&x.map(f64::from), (temperature_c, ramp_c_per_min))
    }

    /// Misalignment to the first or second of the other axes at a temperature, urad, and its standard deviation, as that of the scale factor.
    #[must_use]
    pub fn misalignment_at(&self, scaling: &Scaling, other: usize, temperature_c: f64) -> (f64, f64) {
        let u = f64::from(scaling.u(temperature_c as f32));
        self.misalignment[other].along(&[1.0, u], (temperature_c, 0.0))
    }

    /// Standard deviation of the noise of a dwell of 100 s, in the unit of the values.
    #[must_use]
    pub fn noise(&self) -> f64 {
        self.scale.noise
    }
}

/// Result for a unit.
#[derive(Debug, Clone)]
pub struct Found {
    /// The calibration with scale factors and misalignments.
    pub calibration: Calibration,
    /// Each axis.
    pub axes: [AxisFit; AXES],
    /// The dwells of all runs, corrected by the calibration that was found.
    pub dwells: Vec<Dwell>,
    /// Remarks for the reader.
    pub notes: Vec<String>,
}

/// The dwells of several recordings of one unit, under a calibration.
///
/// # Errors
/// As [`dwells`]; recordings of different units.
pub fn all_dwells(recordings: &[Recording], calibration: &Calibration) -> Result<Vec<Dwell>, BadInput> {
    let mut out: Vec<Dwell> = Vec::new();
    for r in recordings {
        let next = out.last().map_or(0, |d| d.visit);
        out.extend(dwells(r, calibration, next)?);
    }
    Ok(out)
}

/// Name of a term of an axis.
#[must_use]
pub fn term_name(axis: usize, term: usize) -> String {
    let [first, second] = OTHERS[axis].map(|j| AXIS_NAMES[j]);
    let own = AXIS_NAMES[axis];
    match term {
        0 => format!("scale factor of {own}"),
        1..=3 => format!("scale factor of {own} with T^{term}"),
        4 => format!("scale factor of {own} with the ramp"),
        5 => format!("scale factor of {own} with T times the ramp"),
        6 | 8 => format!("misalignment {own}{first}{}", if term == 8 { " with T" } else { "" }),
        _ => format!("misalignment {own}{second}{}", if term == 9 { " with T" } else { "" }),
    }
}

/// Regressors of each dwell of an axis, the mean of each visit taken off, each weighted by the root of its seconds over a hundred.
fn columns(dwells: &[Dwell], a: usize) -> Vec<Vec<f64>> {
    let mut columns = vec![Vec::new(); TERMS];
    for visit in visits(dwells).filter(|v| v.len() >= 2) {
        let first = columns[0].len();
        let others = OTHERS[a];
        for d in visit {
            let regressors = [0, 1].map(|j: usize| (d.unbiased[others[j]], d.by_temperature[a][others[j]]));
            let cross = regressors.map(|r| r.0).into_iter().chain(regressors.map(|r| r.1));
            columns.iter_mut().zip(d.scaled[a].into_iter().chain(cross)).for_each(|(c, v)| c.push(1e-6 * v));
        }
        let seconds: Vec<f64> = visit.iter().map(|d| d.seconds as f64).collect();
        let total: f64 = seconds.iter().sum();
        for column in &mut columns {
            let own = &mut column[first..];
            let mean = own.iter().zip(&seconds).map(|(v, s)| v * s).sum::<f64>() / total;
            own.iter_mut().zip(&seconds).for_each(|(v, s)| *v = (*v - mean) * (s / 100.0).sqrt());
        }
    }
    columns
}

/// Share of the length of column `of` that the others, those `in_use`, do not explain.
fn left(columns: &[Vec<f64>], in_use: &[usize], of: usize) -> f64 {
    let y = DVector::from_column_slice(&columns[of]);
    let size = y.norm();
    if size == 0.0 {
        return 0.0;
    }
    let others: Vec<DVector<f64>> = in_use
        .iter()
        .filter(|t| **t != of)
        .map(|t| DVector::from_column_slice(&columns[*t]))
        .filter(|c| c.norm() > 0.0)
        .map(|c| c.normalize())
        .collect();
    if others.is_empty() {
        return 1.0;
    }
    let m = DMatrix::from_columns(&others);
    let svd = m.clone().svd(true, true);
    svd.solve(&y, 1e-12).map_or(0.0, |k| (&y - m * k).norm() / size)
}

/// For each term of an axis: the share of its regressor that the other terms, in a fit of all that can be told apart, leave; `None`: left out.
#[must_use]
pub fn separable(dwells: &[Dwell], a: usize) -> [Option<f64>; TERMS] {
    let columns = columns(dwells, a);
    let in_use = terms_in_use(dwells, a, &columns);
    std::array::from_fn(|t| in_use.contains(&t).then(|| left(&columns, &in_use, t)))
}

pub(crate) fn terms_in_use(dwells: &[Dwell], a: usize, columns: &[Vec<f64>]) -> Vec<usize> {
    let largest = columns[0].iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let ramp = dwells.iter().map(|d| d.ramp_c_per_min[a].abs()).fold(0.0, f64::max);
    let moved = |t: &usize| columns[*t].iter().any(|v| v.abs() > 1e-6 * largest.max(1e-12));
    let mut in_use: Vec<usize> =
        (0..columns.len()).filter(moved).filter(|t| ![4, 5].contains(t) || ramp >= LEAST_RAMP).collect();
    for term in GIVEN_UP {
        if in_use.iter().all(|t| left(columns, &in_use, *t) >= LEAST_LEFT) {
            break;
        }
        in_use.retain(|t| *t != term);
    }
    in_use
}

/// Identifies scale factors and misalignments. `calibration`: the unit's own, whose biases are taken off.
///
/// # Errors
/// Recordings of another unit, without the table's rates, or in which the table did not turn about each axis both ways.
pub fn identify(recordings: &[Recording], calibration: &Calibration) -> Result<Found, BadInput> {
    let all: Vec<&Recording> = recordings.iter().collect();
    let mut notes: Vec<String> = same_unit(&all, Units::Same)?.into_iter().collect();
    for r in recordings {
        notes.extend(hrg_data::recording::facts::fits(calibration, r, false)?);
    }
    // The fit replaces the factors in the image: the rates are those of the constant scale factors.
    let plain = Calibration { rates: None, ..calibration.clone() };
    let dwells = all_dwells(recordings, &plain)?;
    for a in 0..AXES {
        let both = [1.0, -1.0].map(|s: f64| dwells.iter().any(|d| d.about == Some(a) && s * d.given() > 0.0));
        if both != [true; 2] {
            return Err(BadInput::new(format!(
                "the table did not turn both ways about {}: scale factors and misalignments need plus and minus rates about each axis (hrg profile --rates shows a scheme)",
                AXIS_NAMES[a]
            )));
        }
    }
    // The fit depends on the other coefficients only by 1e-3 and less of them: the third pass changes nothing.
    let mut axes = fit_axes(&dwells, None)?;
    for _ in 0..2 {
        axes = fit_axes(&dwells, Some(&axes))?;
    }
    for fit in &axes {
        if !fit.left_out.is_empty() {
            notes.push(format!("not told apart by these runs, and left out: {}", fit.left_out.join(", ")));
        }
    }
    let mut found = plain;
    found.rates = Some([0, 1, 2].map(|a: usize| rate_axis(&axes[a], &dwells, a, &found.scaling)));
    found.check().map_err(hrg_data::image_file::FileError::Unusable)?;
    let dwells = all_dwells(recordings, &found)?;
    Ok(Found { calibration: found, axes, dwells, notes })
}

pub(crate) fn fit_axes(dwells: &[Dwell], last: Option<&[AxisFit; AXES]>) -> Result<[AxisFit; AXES], BadInput> {
    let [x, y, z] = [0, 1, 2].map(|a| fit_axis(dwells, a, last));
    Ok([x?, y?, z?])
}

/// Sum over the coefficients of a curve.
fn sum<'a>(curve: &Curve, values: impl IntoIterator<Item = &'a f64>) -> f64 {
    curve.coefficients.iter().zip(values).map(|(c, v)| 1e-6 * c * v).sum()
}

/// A value less its bias, times its scale factor.
pub(crate) fn times_scale(d: &Dwell, a: usize, last: Option<&[AxisFit; AXES]>) -> f64 {
    d.unbiased[a] + last.map_or(0.0, |l| sum(&l[a].scale, &d.scaled[a]))
}

/// Value that a misalignment adds.
pub(crate) fn coupled(d: &Dwell, a: usize, other: usize, last: Option<&[AxisFit; AXES]>) -> f64 {
    let from = OTHERS[a][other];
    last.map_or(0.0, |l| sum(&l[a].misalignment[other], &[d.unbiased[from], d.by_temperature[a][from]]))
}

/// The values of the visits about axis `about`, for what axis `a` lacks. `terms`: regressors of a dwell; `lacks`: what they are to explain.
fn points(
    dwells: &[Dwell],
    a: usize,
    about: usize,
    terms: &dyn Fn(&Dwell) -> Vec<f64>,
    lacks: &dyn Fn(&Dwell) -> f64,
) -> Vec<Point> {
    let own = visits(dwells).filter(|v| v[0].about == Some(about));
    own.filter_map(|visit| {
        let (change, weight_s) = plus_less_minus(visit, &|d| {
            let mut values = terms(d);
            values.push(lacks(d));
            values
        })?;
        let (value, regressors) = change.split_last()?;
        let size = *regressors.first()?;
        let middle = |of: &dyn Fn(&Dwell) -> f64| mean(&visit.iter().map(of).collect::<Vec<_>>());
        Some(Point {
            x: regressors.iter().map(|x| x / size).collect(),
            at: (middle(&|d| d.temperature_c[a]), middle(&|d| d.ramp_c_per_min[a])),
            value: 1e6 * value / size,
            weight: 1e-12 * size * size * weight_s / 100.0,
        })
    })
    .collect()
}

/// Mean of a visit's plus rates and that of its minus rates, and the seconds by which the noise of their sum or difference counts; `None` where it was not
/// turned both ways.
pub(crate) fn plus_and_minus(visit: &[Dwell], of: &dyn Fn(&Dwell) -> Vec<f64>) -> Option<(Vec<f64>, Vec<f64>, f64)> {
    let side = |sign: f64| {
        let own: Vec<&Dwell> = visit.iter().filter(|d| sign * d.given() > 0.0).collect();
        let seconds: f64 = own.iter().map(|d| d.seconds as f64).sum();
        let mut total = own.first().map(|d| vec![0.0; of(d).len()])?;
        for d in own {
            total.iter_mut().zip(of(d)).for_each(|(t, v)| *t += v * d.seconds as f64 / seconds);
        }
        Some((total, seconds))
    };
    let ((plus, plus_s), (minus, minus_s)) = (side(1.0)?, side(-1.0)?);
    Some((plus, minus, 1.0 / (1.0 / plus_s + 1.0 / minus_s)))
}

/// Mean of a visit's plus rates less that of its minus rates, and the seconds of [`plus_and_minus`].
pub(super) fn plus_less_minus(visit: &[Dwell], of: &dyn Fn(&Dwell) -> Vec<f64>) -> Option<(Vec<f64>, f64)> {
    let (plus, minus, seconds) = plus_and_minus(visit, of)?;
    Some((plus.iter().zip(&minus).map(|(p, m)| p - m).collect(), seconds))
}

fn fit_axis(dwells: &[Dwell], a: usize, last: Option<&[AxisFit; AXES]>) -> Result<AxisFit, BadInput> {
    let columns = columns(dwells, a);
    let in_use = terms_in_use(dwells, a, &columns);
    let curve = |about: usize, points: Vec<Point>, terms: &[usize]| {
        let own: Vec<usize> = (0..terms.len()).filter(|k| in_use.contains(&terms[*k])).collect();
        Curve::fit(&points, terms.len(), &own).ok_or_else(|| {
            BadInput::new(format!(
                "{} visits of axis {} with plus and minus rates are too few for {} coefficients of axis {}; let the scheme go round more often",
                points.len(),
                AXIS_NAMES[about],
                own.len(),
                AXIS_NAMES[a]
            ))
        })
    };
    let own = points(dwells, a, a, &|d| d.scaled[a].to_vec(), &|d| {
        d.table[a] - d.unbiased[a] - coupled(d, a, 0, last) - coupled(d, a, 1, last)
    });
    let scale = curve(a, own, &[0, 1, 2, 3, 4, 5])?;
    let misalignment = |j: usize| {
        let about = OTHERS[a][j];
        let cross = points(
            dwells,
            a,
            about,
            &|d| {
                // By temperature with the scale factor of the mean.
                let by = times_scale(d, about, last) / d.unbiased[about];
                vec![times_scale(d, about, last), by * d.by_temperature[a][about]]
            },
            &|d| d.table[a] - times_scale(d, a, last) - coupled(d, a, 1 - j, last),
        );
        curve(about, cross, &[SCALE_TERMS + j, SCALE_TERMS + 2 + j])
    };
    let left_out = (0..TERMS).filter(|t| !in_use.contains(t)).map(|t| term_name(a, t)).collect();
    Ok(AxisFit { scale, misalignment: [misalignment(0)?, misalignment(1)?], left_out })
}

pub(crate) fn rate_axis(fit: &AxisFit, dwells: &[Dwell], a: usize, scaling: &Scaling) -> RateAxis {
    let range = |of: fn(&Dwell, usize) -> f64, margin: f32| {
        let values = dwells.iter().map(|d| of(d, a) as f32);
        let (low, high) = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        (low - margin, high + margin)
    };
    let (rate_valid_from_c, rate_valid_to_c) = range(|d, a| d.temperature_c[a], MARGIN_C);
    let (rate_valid_from_c_per_min, rate_valid_to_c_per_min) = range(|d, a| d.ramp_c_per_min[a], MARGIN_C_PER_MIN);
    let at = |k: usize, of: usize| {
        f64::from(rate_valid_from_c + k as f32 / of as f32 * (rate_valid_to_c - rate_valid_from_c))
    };
    let cross = [0, 1].map(|j: usize| &fit.misalignment[j]);
    RateAxis {
        rate_valid_from_c,
        rate_valid_to_c,
        rate_valid_from_c_per_min,
        rate_valid_to_c_per_min,
        scale_correction_ppm: std::array::from_fn(|t| fit.scale.coefficients[t] as f32),
        scale_std_ppm: std::array::from_fn(|k| fit.scale_at(scaling, at(k, STATED_AT - 1), 0.0).1 as f32),
        misalignment_urad: [0, 1].map(|term: usize| cross.map(|c| c.coefficients[term] as f32)),
        misalignment_std_urad: [0, 1]
            .map(|end: usize| [0, 1].map(|j: usize| fit.misalignment_at(scaling, j, at(end, 1)).1 as f32)),
    }
}

/// Factors of an image on a soak at a temperature: factor of the scale and misalignments, as the unit computes them.
#[must_use]
pub fn on_soak(axis: &RateAxis, scaling: &Scaling, temperature_c: f32) -> (f32, [f32; 2]) {
    let state = State {
        temperature_c,
        ramp_c_per_min: 0.0,
        difference_c_per_min: 0.0,
        frequency_u: 0.0,
        frequency_u_per_min: 0.0,
    };
    let (scale, coupling, _) = axis.at(scaling, &state);
    (scale, coupling)
}
