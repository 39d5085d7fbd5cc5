//! Scale factor and misalignment over temperature, from runs on a rate table in a chamber.
//!
//! # How
//! A [`Dwell`] is a time at one rate. Of each dwell `unbiased` is the mean raw rate less the bias of the calibration. The model of
//! [`hrg_core::rate_factors`] is linear in what is sought:
//!
//! `table_i - unbiased_i = 1e-6 (sum_k c_k x_k unbiased_i + sum_j (m0_ij + m1_ij u) S_j unbiased_j) + constant of the visit`
//!
//! with the unit's own regressors `x`. The constant of a visit (dwells of both signs about one axis, after each other) holds the earth's rate along the
//! table's axis and what the bias model leaves, so bias and scale factor are told apart by the sign of the rate. Each dwell counts
//! by its seconds. What the schemes of the runs do not tell apart is left out, and said ([`told_apart`]).
//!
//! # Asymmetry and nonlinearity
//! They are not compensated. Two visits of an axis after each other with rates of different size give one value each: the mean of plus and minus
//! changes by the asymmetry times the change of rate, half their difference by the nonlinearity. A slow change of the bias cancels.

mod dwells;
mod quality;

pub use dwells::{dwells, dwells_of_unit, Dwell};
pub use quality::{bins, quality, Bin, Quality};

use crate::fit::independence::{same_unit, Units};
use crate::numeric::lsq;
use crate::recording::Recording;
use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::{Scaling, State};
use hrg_core::calibration::Calibration;
use hrg_core::rate_factors::{RateAxis, MISALIGNMENT_TERMS, OTHERS, SCALE_TERMS};
use hrg_core::AXES;
use nalgebra::{DMatrix, DVector};

/// Coefficients of an axis: those of its scale factor, then both misalignments at `u = 0`, then both per `u`.
pub const TERMS: usize = SCALE_TERMS + 2 * MISALIGNMENT_TERMS;

/// A regressor of which the others leave less than this share is not told apart from them.
pub const LEAST_LEFT: f64 = 1e-3;

/// Order in which terms are given up where they are not told apart: the ramp, the powers of temperature from the highest, the misalignments' slopes.
const GIVEN_UP: [usize; 6] = [4, 3, 2, 8, 7, 1];

/// A ramp that moved less than this over all dwells is none, C per minute: the slope of a soak is noise.
const LEAST_RAMP: f64 = 0.1;

/// Chamber profile for the eight steps: soaks over the whole range, and a slow ramp back.
pub const CHAMBER: &str = "20,-40@1,2.5h,-15@1,2.5h,10@1,2.5h,35@1,2.5h,60@1,2.5h,-40@0.4";

/// Margin of the stated range beyond the data of the fit: the noise of temperature and slope on another day.
const MARGIN_C: f32 = 1.0;
/// The same for ramps, C per minute.
const MARGIN_C_PER_MIN: f32 = 0.1;

/// What was found for an axis.
#[derive(Debug, Clone)]
pub struct AxisFit {
    /// Coefficients in the order of [`TERMS`], ppm and urad; zero where not told apart.
    pub coefficients: [f64; TERMS],
    /// Their covariance; zero rows where not told apart.
    pub covariance: DMatrix<f64>,
    /// Terms that the runs did not tell apart.
    pub left_out: Vec<String>,
    /// Dwells that took part.
    pub dwells: usize,
    /// Standard deviation of the residual of a dwell of 100 s, deg/h.
    pub residual_dph: f64,
}

impl AxisFit {
    /// Correction of the scale factor in a thermal state, ppm, and its standard deviation.
    #[must_use]
    pub fn scale_at(&self, scaling: &Scaling, temperature_c: f64, ramp_c_per_min: f64) -> (f64, f64) {
        let x = hrg_core::rate_factors::scale_regressors(scaling, temperature_c as f32, ramp_c_per_min as f32);
        let mut row = [0.0; TERMS];
        row.iter_mut().zip(x).for_each(|(to, x)| *to = f64::from(x));
        self.along(row)
    }

    /// Misalignment to the first or second of the other axes at a temperature, urad, and its standard deviation.
    #[must_use]
    pub fn misalignment_at(&self, scaling: &Scaling, other: usize, temperature_c: f64) -> (f64, f64) {
        let mut row = [0.0; TERMS];
        row[SCALE_TERMS + other] = 1.0;
        row[SCALE_TERMS + 2 + other] = f64::from(scaling.u(temperature_c as f32));
        self.along(row)
    }

    fn along(&self, row: [f64; TERMS]) -> (f64, f64) {
        let x = DVector::from_column_slice(&row);
        let value = row.iter().zip(self.coefficients).map(|(x, c)| x * c).sum();
        (value, (x.transpose() * &self.covariance * x)[(0, 0)].max(0.0).sqrt())
    }
}

/// What was found for a unit.
#[derive(Debug, Clone)]
pub struct Found {
    /// The calibration with scale factors and misalignments.
    pub calibration: Calibration,
    /// Each axis.
    pub axes: [AxisFit; AXES],
    /// The dwells of all runs, corrected by the calibration that was found.
    pub dwells: Vec<Dwell>,
    /// What a reader should know.
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
        5 | 7 => format!("misalignment {own}{first}{}", if term == 7 { " with T" } else { "" }),
        _ => format!("misalignment {own}{second}{}", if term == 8 { " with T" } else { "" }),
    }
}

/// Regressors and the value of each dwell of an axis, the constant of each visit taken off, each weighted by the root of its seconds
/// over a hundred. `scale`: `S` of each axis in each dwell. Gives the number of visits, too.
struct Rows {
    columns: Vec<Vec<f64>>,
    y: Vec<f64>,
    visits: usize,
}

fn rows(dwells: &[Dwell], a: usize, scale: &[[f64; AXES]]) -> Rows {
    let mut columns = vec![Vec::new(); TERMS];
    let mut y = Vec::new();
    let mut visits = 0;
    let mut end = 0;
    for visit in dwells.chunk_by(|p, q| p.visit == q.visit) {
        let start = end;
        end += visit.len();
        if visit.len() < 2 {
            continue;
        }
        visits += 1;
        let first = y.len();
        for (k, d) in (start..).zip(visit) {
            let others = OTHERS[a];
            for (term, column) in columns.iter_mut().enumerate() {
                column.push(
                    1e-6 * match term {
                        0..SCALE_TERMS => d.scale_dph[a][term],
                        5 | 6 => scale[k][others[term - 5]] * d.unbiased_dph[others[term - 5]],
                        _ => scale[k][others[term - 7]] * d.by_temperature_dph[a][others[term - 7]],
                    },
                );
            }
            y.push(d.table_dph[a] - d.unbiased_dph[a]);
        }
        let seconds: Vec<f64> = visit.iter().map(|d| d.seconds as f64).collect();
        let total: f64 = seconds.iter().sum();
        for column in columns.iter_mut().chain([&mut y]) {
            let own = &mut column[first..];
            let mean = own.iter().zip(&seconds).map(|(v, s)| v * s).sum::<f64>() / total;
            own.iter_mut().zip(&seconds).for_each(|(v, s)| *v = (*v - mean) * (s / 100.0).sqrt());
        }
    }
    Rows { columns, y, visits }
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
pub fn told_apart(dwells: &[Dwell], a: usize) -> [Option<f64>; TERMS] {
    let columns = rows(dwells, a, &vec![[1.0; AXES]; dwells.len()]).columns;
    let in_use = terms_in_use(dwells, a, &columns);
    std::array::from_fn(|t| in_use.contains(&t).then(|| left(&columns, &in_use, t)))
}

fn terms_in_use(dwells: &[Dwell], a: usize, columns: &[Vec<f64>]) -> Vec<usize> {
    let largest = columns[0].iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let ramp = dwells.iter().map(|d| d.ramp_c_per_min[a].abs()).fold(0.0, f64::max);
    let moved = |t: &usize| columns[*t].iter().any(|v| v.abs() > 1e-6 * largest.max(1e-12));
    let mut in_use: Vec<usize> = (0..TERMS).filter(moved).filter(|t| *t != 4 || ramp >= LEAST_RAMP).collect();
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
        notes.extend(crate::recording::facts::fits(calibration, r, false)?);
    }
    // What is found replaces what is there: the rates are those of the constant scale factors.
    let plain = Calibration { rates: None, ..calibration.clone() };
    let dwells = all_dwells(recordings, &plain)?;
    for a in 0..AXES {
        let both = [1.0, -1.0].map(|s: f64| dwells.iter().any(|d| d.about == Some(a) && s * d.rate_dph() > 0.0));
        if both != [true; 2] {
            return Err(BadInput::new(format!(
                "the table did not turn both ways about {}: scale factors and misalignments need plus and minus rates about each axis (hrg profile --rates shows a scheme)",
                AXIS_NAMES[a]
            )));
        }
    }
    let mut scale = vec![[1.0; AXES]; dwells.len()];
    let mut axes = fit_axes(&dwells, &scale)?;
    // The misalignments multiply rates whose scale factor is right; a second pass has it to well below a part in 1e9.
    for (row, d) in scale.iter_mut().zip(&dwells) {
        *row = std::array::from_fn(|a| {
            let (ppm, _) = axes[a].scale_at(&plain.scaling, d.temperature_c[a], d.ramp_c_per_min[a]);
            1.0 + 1e-6 * ppm
        });
    }
    axes = fit_axes(&dwells, &scale)?;
    for fit in &axes {
        if !fit.left_out.is_empty() {
            notes.push(format!("not told apart by these runs, and left out: {}", fit.left_out.join(", ")));
        }
    }
    let mut found = plain;
    found.rates = Some([0, 1, 2].map(|a: usize| rate_axis(&axes[a], &dwells, a)));
    found.check().map_err(crate::image_file::FileError::Unusable)?;
    let dwells = all_dwells(recordings, &found)?;
    Ok(Found { calibration: found, axes, dwells, notes })
}

fn fit_axes(dwells: &[Dwell], scale: &[[f64; AXES]]) -> Result<[AxisFit; AXES], BadInput> {
    let [x, y, z] = [0, 1, 2].map(|a| fit_axis(dwells, a, scale));
    Ok([x?, y?, z?])
}

fn fit_axis(dwells: &[Dwell], a: usize, scale: &[[f64; AXES]]) -> Result<AxisFit, BadInput> {
    let Rows { columns, y, visits } = rows(dwells, a, scale);
    let in_use = terms_in_use(dwells, a, &columns);
    let names: Vec<String> = (0..TERMS).map(|t| term_name(a, t)).collect();
    let used: Vec<Vec<f64>> = in_use.iter().map(|t| columns[*t].clone()).collect();
    let used_names: Vec<&str> = in_use.iter().map(|t| names[*t].as_str()).collect();
    let fit = lsq::fit(&used, &y, None, &used_names)?;
    let free = y.len().saturating_sub(in_use.len() + visits);
    if free < 3 {
        return Err(BadInput::new(format!(
            "{} dwells about {} visits are too few for {} coefficients of axis {}; let the scheme go round more often",
            y.len(),
            visits,
            in_use.len(),
            AXIS_NAMES[a]
        )));
    }
    // The constants of the visits were found from the same dwells.
    let more = (y.len() - in_use.len()) as f64 / free as f64;
    let mut coefficients = [0.0; TERMS];
    let mut covariance = DMatrix::zeros(TERMS, TERMS);
    for (j, t) in in_use.iter().enumerate() {
        coefficients[*t] = fit.coefficients[j];
        for (l, s) in in_use.iter().enumerate() {
            covariance[(*t, *s)] = fit.covariance[(j, l)] * more;
        }
    }
    let left_out = (0..TERMS).filter(|t| !in_use.contains(t)).map(|t| names[t].clone()).collect();
    Ok(AxisFit { coefficients, covariance, left_out, dwells: y.len(), residual_dph: fit.sigma * more.sqrt() })
}

fn rate_axis(fit: &AxisFit, dwells: &[Dwell], a: usize) -> RateAxis {
    let k = fit.coefficients.map(|c| c as f32);
    let std: [f32; TERMS] = std::array::from_fn(|t| fit.covariance[(t, t)].sqrt() as f32);
    let range = |of: fn(&Dwell, usize) -> f64, margin: f32| {
        let values = dwells.iter().map(|d| of(d, a) as f32);
        let (low, high) = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        (low - margin, high + margin)
    };
    let (rate_valid_from_c, rate_valid_to_c) = range(|d, a| d.temperature_c[a], MARGIN_C);
    let (rate_valid_from_c_per_min, rate_valid_to_c_per_min) = range(|d, a| d.ramp_c_per_min[a], MARGIN_C_PER_MIN);
    let scale = |k: &[f32; TERMS]| std::array::from_fn(|t| k[t]);
    let pairs = |k: &[f32; TERMS]| [[k[5], k[6]], [k[7], k[8]]];
    RateAxis {
        rate_valid_from_c,
        rate_valid_to_c,
        rate_valid_from_c_per_min,
        rate_valid_to_c_per_min,
        scale_correction_ppm: scale(&k),
        scale_correction_std_ppm: scale(&std),
        misalignment_urad: pairs(&k),
        misalignment_std_urad: pairs(&std),
    }
}

/// What the factors of an image are on a soak at a temperature: factor of the scale and misalignments, as the unit computes them.
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
