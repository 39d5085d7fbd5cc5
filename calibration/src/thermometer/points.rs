//! Static points: one row per soak. Frequency-temperature fits both ways, and the trace of what they leave.
//!
//! # How a p-value is computed
//! Ten points and a cubic leave six degrees of freedom, and residuals of a fit are correlated among themselves.
//! So p-values are not read off a table: independent Gaussian noise is put at the points of each gyro, fitted and
//! searched in the very same way, [`DRAWS`] times with a fixed seed, and the share of draws that do at least as
//! well is the p-value. For the chamber reference the three gyros share one chamber sensor and are *not*
//! independent; there the noise is drawn once for all three.

use crate::list;
use crate::numeric::lsq::powers;
use crate::{BadInput, AXIS_NAMES};
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use std::collections::BTreeMap;

/// Draws of noise behind each p-value.
pub const DRAWS: usize = 100_000;

/// Fewest soaks of a table, or of one axis of it.
const LEAST_SOAKS: usize = 6;

/// What a column of the table is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Slot {
    Chamber,
    Frequency(usize),
    Case(usize),
}

/// Why a table of soaks cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TableError {
    /// Text where a number should be.
    #[error("line {line}, column {column}: \"{cell}\" is not a number")]
    NotANumber {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What stands there.
        cell: String,
    },
    /// Too few rows.
    #[error("the table has {0} soaks; a cubic with a leave-one-out check needs six at the least")]
    TooFew(usize),
    /// A column that is there twice.
    #[error("line {line}, column {column}: {name} is there twice; remove one")]
    Twice {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// Its name.
        name: String,
    },
    /// A column that is not there.
    #[error("line {line}: the column {missing} is missing; a table of soaks has f?_hz, and chamber_c or case_?_c; there are {there}")]
    Missing {
        /// Line, from 1.
        line: usize,
        /// What is missing.
        missing: &'static str,
        /// What is there.
        there: String,
    },
}

/// A table of soaks; NaN where a cell is empty.
#[derive(Debug, Clone, Default)]
pub struct Points {
    /// Number of soaks.
    pub rows: usize,
    /// Chamber temperature, C.
    pub chamber_c: Vec<f64>,
    /// Frequencies, Hz.
    pub frequency_hz: [Vec<f64>; AXES],
    /// Shell sensors, C.
    pub case_c: [Vec<f64>; AXES],
}

impl Points {
    /// Reads the table. Frequencies of one to three bodies or modes; sensors on their cases and the chamber's sensor may be
    /// missing, in single cells or altogether.
    ///
    /// # Errors
    /// One sentence with line and column.
    pub fn parse(text: &str) -> Result<Self, TableError> {
        let mut header: Option<Vec<Option<Slot>>> = None;
        let mut out = Self::default();
        for (index, line) in text.lines().enumerate() {
            if line.starts_with('#') || line.trim().is_empty() {
                continue;
            }
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            let Some(slots) = &header else {
                header = Some(out.slots(&cells, index + 1)?);
                continue;
            };
            out.rows += 1;
            let rows = out.rows;
            for (k, slot) in slots.iter().enumerate() {
                let Some(slot) = slot else { continue };
                let cell = cells.get(k).copied().unwrap_or("");
                let value = if cell.is_empty() || cell.eq_ignore_ascii_case("nan") {
                    f64::NAN
                } else {
                    cell.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| TableError::NotANumber {
                        line: index + 1,
                        column: k + 1,
                        cell: cell.into(),
                    })?
                };
                match slot {
                    Slot::Chamber => out.chamber_c.push(value),
                    Slot::Frequency(a) => out.frequency_hz[*a].push(value),
                    Slot::Case(a) => out.case_c[*a].push(value),
                }
            }
            for column in out.frequency_hz.iter_mut().chain(&mut out.case_c).chain([&mut out.chamber_c]) {
                column.resize(rows, f64::NAN);
            }
        }
        if out.rows < LEAST_SOAKS {
            return Err(TableError::TooFew(out.rows));
        }
        Ok(out)
    }

    fn slots(&mut self, names: &[&str], line: usize) -> Result<Vec<Option<Slot>>, TableError> {
        let of = |name: &str| -> Option<Slot> {
            let name = crate::recording::column_name(name);
            let axis =
                |before: &str, after: &str| AXIS_NAMES.iter().position(|n| format!("{before}{n}{after}") == name);
            (name == "chamber_c")
                .then_some(Slot::Chamber)
                .or_else(|| axis("f", "_hz").map(Slot::Frequency))
                .or_else(|| axis("case_", "_c").map(Slot::Case))
        };
        let slots: Vec<Option<Slot>> = names.iter().map(|n| of(n)).collect();
        for (k, slot) in slots.iter().enumerate().filter(|(_, s)| s.is_some()) {
            if slots[..k].contains(slot) {
                return Err(TableError::Twice { line, column: k + 1, name: names[k].into() });
            }
        }
        let has = |wanted: &dyn Fn(&Slot) -> bool| slots.iter().flatten().any(wanted);
        let missing = if !has(&|s| matches!(s, Slot::Frequency(_))) {
            "fx_hz (or fy_hz, fz_hz)"
        } else if !has(&|s| !matches!(s, Slot::Frequency(_))) {
            "chamber_c (or case_x_c, ...)"
        } else {
            return Ok(slots);
        };
        Err(TableError::Missing { line, missing, there: names.join(", ") })
    }

    /// The rows that have the frequency of every axis, and the reference.
    fn complete(&self, reference: &str) -> Option<Self> {
        let all = |k: &usize| {
            (0..AXES).all(|a| self.frequency_hz[a][*k].is_finite() && self.temperatures(reference, a)[*k].is_finite())
        };
        let rows: Vec<usize> = (0..self.rows).filter(all).collect();
        let pick = |v: &[f64]| rows.iter().map(|&k| v[k]).collect::<Vec<f64>>();
        (rows.len() >= LEAST_SOAKS).then(|| Self {
            rows: rows.len(),
            chamber_c: pick(&self.chamber_c),
            frequency_hz: self.frequency_hz.each_ref().map(|v| pick(v)),
            case_c: self.case_c.each_ref().map(|v| pick(v)),
        })
    }

    fn temperatures(&self, reference: &str, a: usize) -> &[f64] {
        if reference == "shell" {
            &self.case_c[a]
        } else {
            &self.chamber_c
        }
    }
}

/// One polynomial fit.
#[derive(Debug, Clone, Serialize)]
pub struct PolyFit {
    /// Degree.
    pub degree: usize,
    /// Coefficients of the centred and scaled variable.
    pub coefficients: Vec<f64>,
    /// Residuals in C, in the order of the table.
    pub residuals_c: Vec<f64>,
    /// Root mean square of the residuals, C.
    pub rms_c: f64,
    /// Largest residual, C.
    pub max_c: f64,
    /// Root mean square of what each point is missed by when it is left out, C.
    pub leave_one_out_rms_c: f64,
}

/// Fits of one axis and reference.
#[derive(Debug, Clone, Serialize)]
pub struct AxisFits {
    /// `f(T)`, solved for T.
    pub forward: Vec<PolyFit>,
    /// `T(f)`.
    pub inverse: Vec<PolyFit>,
    /// Temperatures by the root of the forward cubic, C (the table's T3).
    pub root_c: Vec<f64>,
    /// Temperatures by the inverse cubic in the unit's f32, C (the table's T4).
    pub inverse_f32_c: Vec<f64>,
    /// Largest difference of f32 from f64 evaluation of the inverse cubic, C.
    pub f32_error_c: f64,
    /// Centre of the inverse cubic, Hz.
    pub centre_hz: f64,
    /// Scale of the inverse cubic, Hz.
    pub scale_hz: f64,
}

/// Something that is left over, and what adding it does.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOver {
    /// Name.
    pub name: String,
    /// Reference it is seen against.
    pub reference: String,
    /// What it is, in a sentence.
    pub finding: String,
    /// Inner parameters.
    pub parameters: BTreeMap<String, f64>,
    /// Per axis: gain and what the fit leaves before and after.
    pub axes: BTreeMap<String, BeforeAfter>,
    /// Chance that noise alone gives as much.
    pub p_value: f64,
    /// What it is judged by.
    pub statistic: String,
    /// Physical causes that these points cannot tell apart.
    pub indistinguishable_from: Vec<String>,
}

/// Residuals before and after, C.
#[derive(Debug, Clone, Serialize)]
pub struct BeforeAfter {
    /// Size on this axis, C.
    pub gain: f64,
    /// RMS before.
    pub rms_before_c: f64,
    /// RMS after.
    pub rms_after_c: f64,
    /// Largest before.
    pub max_before_c: f64,
    /// Largest after.
    pub max_after_c: f64,
    /// Leave-one-out RMS before.
    pub leave_one_out_before_c: f64,
    /// Leave-one-out RMS after.
    pub leave_one_out_after_c: f64,
}

/// Two resonators, or two modes of one, each as the other's thermometer.
#[derive(Debug, Clone, Serialize)]
pub struct Pair {
    /// The two.
    pub axes: [String; 2],
    /// Soaks that have both, and the chamber.
    pub soaks: usize,
    /// What the cubic of each leaves against the chamber, C.
    pub against_chamber_rms_c: [f64; 2],
    /// What is left of the first (second) when a cubic of the other predicts it, in C of its own slope: no sensor takes part.
    pub by_the_other_rms_c: [f64; 2],
    /// The same with each soak left out.
    pub by_the_other_leave_one_out_c: [f64; 2],
    /// Correlation of what both leave against the chamber. Near 1: the two agree, and it is the chamber's sensor, or its distance
    /// from the body, that does not follow.
    pub correlation: f64,
    /// Chance of as large a correlation if each left noise of its own.
    pub p_value: f64,
}

/// The report of `hrg points`.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Version of the report.
    pub version: u32,
    /// By reference, then by axis.
    pub fits: BTreeMap<String, BTreeMap<String, AxisFits>>,
    /// Every two of the axes.
    pub each_other: Vec<Pair>,
    /// What is left over.
    pub effects: Vec<LeftOver>,
    /// What to do.
    pub advice: Vec<String>,
}

fn scaled(values: &[f64]) -> (Vec<f64>, f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (centre, half) = (0.5 * (low + high), 0.5 * (high - low));
    (values.iter().map(|v| (v - centre) / half).collect(), centre, half)
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
}

/// Projection onto what columns leave: residual = M y.
fn residual_maker(columns: &[Vec<f64>]) -> DMatrix<f64> {
    let n = columns[0].len();
    let x = DMatrix::from_fn(n, columns.len(), |i, j| columns[j][i]);
    let q = x.qr().q();
    DMatrix::identity(n, n) - &q * q.transpose()
}

/// Residuals, and residuals of left-out points (the deleted residuals `e / (1 - h)`).
fn residuals(columns: &[Vec<f64>], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let m = residual_maker(columns);
    let e = &m * DVector::from_column_slice(y);
    let left_out = (0..y.len()).map(|k| e[k] / m[(k, k)].max(1e-12)).collect();
    (e.iter().copied().collect(), left_out)
}

fn poly_fit(x: &[f64], y: &[f64], degree: usize, to_c: f64) -> Result<PolyFit, BadInput> {
    let (u, _, _) = scaled(x);
    let columns = powers(&u, degree);
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let centred: Vec<f64> = y.iter().map(|v| v - mean).collect();
    let fit = crate::numeric::lsq::fit(&columns, &centred, None, &["1", "u", "u^2", "u^3"])?;
    let (e, left_out) = residuals(&columns, &centred);
    let e: Vec<f64> = e.iter().map(|v| v * to_c).collect();
    let left_out: Vec<f64> = left_out.iter().map(|v| v * to_c).collect();
    let mut coefficients = fit.coefficients;
    coefficients[0] += mean;
    Ok(PolyFit {
        degree,
        coefficients,
        rms_c: rms(&e),
        max_c: largest(&e),
        leave_one_out_rms_c: rms(&left_out),
        residuals_c: e,
    })
}

fn axis_fits(temperature_c: &[f64], frequency_hz: &[f64]) -> Result<AxisFits, BadInput> {
    let n = temperature_c.len();
    let hz_per_c = (frequency_hz[n - 1] - frequency_hz[0]) / (temperature_c[n - 1] - temperature_c[0]);
    let forward_curve = crate::thermometer::curve::fit_forward(temperature_c, frequency_hz, 3)?;
    let inverse_curve = crate::thermometer::curve::fit_inverse(frequency_hz, temperature_c, None, 3)?;
    let inverse_f32_c: Vec<f64> = frequency_hz.iter().map(|f| f64::from(inverse_curve.temperature_c(*f))).collect();
    let c = inverse_curve.temperature_coefficients_c.map(f64::from);
    let f32_error_c = frequency_hz
        .iter()
        .zip(&inverse_f32_c)
        .map(|(f, t)| {
            let u = (f - inverse_curve.frequency_centre_hz) / f64::from(inverse_curve.frequency_scale_hz);
            (((c[3] * u + c[2]) * u + c[1]) * u + c[0] - t).abs()
        })
        .fold(0.0, f64::max);
    let root_c = frequency_hz
        .iter()
        .zip(&inverse_f32_c)
        .map(|(f, guess)| {
            forward_curve
                .root_c(*f, *guess)
                .ok_or_else(|| BadInput::new(format!("the forward cubic has no root at {f} Hz")))
        })
        .collect::<Result<_, _>>()?;
    let fits =
        |x: &[f64], y: &[f64], to_c: f64| (1..=3).map(|d| poly_fit(x, y, d, to_c)).collect::<Result<Vec<_>, _>>();
    Ok(AxisFits {
        forward: fits(temperature_c, frequency_hz, 1.0 / hz_per_c)?,
        inverse: fits(frequency_hz, temperature_c, 1.0)?,
        root_c,
        inverse_f32_c,
        f32_error_c,
        centre_hz: inverse_curve.frequency_centre_hz,
        scale_hz: f64::from(inverse_curve.frequency_scale_hz),
    })
}

/// The whole report.
///
/// # Errors
/// Where a fit is not possible.
pub fn report(p: &Points) -> Result<Report, BadInput> {
    let mut fits = BTreeMap::new();
    for reference in ["shell", "chamber"] {
        let mut axes = BTreeMap::new();
        for (a, name) in AXIS_NAMES.iter().enumerate() {
            let (f, t) = both(&p.frequency_hz[a], p.temperatures(reference, a));
            if f.len() >= LEAST_SOAKS {
                axes.insert((*name).to_string(), axis_fits(&t, &f)?);
            }
        }
        if !axes.is_empty() {
            fits.insert(reference.to_string(), axes);
        }
    }
    if fits.is_empty() {
        return Err(BadInput::new("no axis has six soaks with a frequency and a temperature"));
    }
    let mut effects = Vec::new();
    let mut advice = Vec::new();
    if let Some(p) = p.complete("chamber") {
        effects.extend(chamber_step(&p)?);
    }
    if let Some(p) = p.complete("shell") {
        effects.extend(common_shape(&p));
    }
    let each_other = each_other(p);
    for e in &effects {
        if e.name == EffectId::Step.name() {
            advice.push(
                "Refer the gyros to their shell sensors, not to the chamber: the step is between chamber and shell, all three gyros and all three shell sensors see it. Check the chamber's sensor (range switch, calibration points) across the step.".into(),
            );
        }
        if e.name == EffectId::Timebase.name() {
            advice.push(
                "Log the counter's clock against a reference and one independent thermometer beside the gyros: only that parts a shared timebase from a shared thermal state.".into(),
            );
        }
    }
    Ok(Report { version: 1, fits, each_other, effects, advice })
}

/// The rows in which both have a value.
fn both(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    x.iter().zip(y).filter(|(x, y)| x.is_finite() && y.is_finite()).map(|(x, y)| (*x, *y)).unzip()
}

/// Every two axes: one predicted from the other, and what both leave against the chamber.
fn each_other(p: &Points) -> Vec<Pair> {
    let mut out = Vec::new();
    for (a, b) in [(0, 1), (0, 2), (1, 2)] {
        let rows: Vec<usize> = (0..p.rows)
            .filter(|&k| [p.frequency_hz[a][k], p.frequency_hz[b][k], p.chamber_c[k]].iter().all(|v| v.is_finite()))
            .collect();
        if rows.len() < LEAST_SOAKS {
            continue;
        }
        let pick = |v: &[f64]| rows.iter().map(|&k| v[k]).collect::<Vec<f64>>();
        let (fa, fb, t) = (pick(&p.frequency_hz[a]), pick(&p.frequency_hz[b]), pick(&p.chamber_c));
        let columns = [&fa, &fb].map(|f| powers(&scaled(f).0, 3));
        let makers = columns.each_ref().map(|c| residual_maker(c));
        let e = makers.each_ref().map(|m| m * DVector::from_column_slice(&t));
        let seen = correlation(&e[0], &e[1]);
        let mut rng = ChaCha8Rng::seed_from_u64(2025);
        let mut noise = || DVector::from_fn(rows.len(), |_, _| StandardNormal.sample(&mut rng));
        let as_good =
            (0..PAIR_DRAWS).filter(|_| correlation(&(&makers[0] * noise()), &(&makers[1] * noise())) >= seen).count();
        // In C: over the slope of the predicted frequency by the chamber's temperature.
        let slope_hz_per_c = |f: &[f64]| -> f64 {
            let (mt, mf) = (crate::numeric::stats::mean(&t), crate::numeric::stats::mean(f));
            let both: f64 = t.iter().zip(f).map(|(t, f)| (t - mt) * (f - mf)).sum();
            both / t.iter().map(|t| (t - mt).powi(2)).sum::<f64>()
        };
        let predicted = |of: &[f64], by: &[Vec<f64>]| -> [f64; 2] {
            let (rest, left_out) = residuals(by, of);
            let slope = slope_hz_per_c(of).abs();
            [rms(&rest) / slope, rms(&left_out) / slope]
        };
        let (x, y) = (predicted(&fa, &columns[1]), predicted(&fb, &columns[0]));
        let against = |k: usize| e[k].norm() / (rows.len() as f64).sqrt();
        out.push(Pair {
            axes: [AXIS_NAMES[a].into(), AXIS_NAMES[b].into()],
            soaks: rows.len(),
            against_chamber_rms_c: [against(0), against(1)],
            by_the_other_rms_c: [x[0], y[0]],
            by_the_other_leave_one_out_c: [x[1], y[1]],
            correlation: seen,
            p_value: (as_good as f64 + 1.0) / (PAIR_DRAWS as f64 + 1.0),
        });
    }
    out
}

fn correlation(x: &DVector<f64>, y: &DVector<f64>) -> f64 {
    x.dot(y) / (x.norm() * y.norm())
}

/// Draws of noise behind the p-value of a pair.
const PAIR_DRAWS: usize = 20_000;

/// Columns of the inverse cubic of an axis.
fn cubic_columns(p: &Points, a: usize) -> Vec<Vec<f64>> {
    powers(&scaled(&p.frequency_hz[a]).0, 3)
}

/// A jump of the reference between two neighbouring soaks, at one place for all three gyros.
fn chamber_step(p: &Points) -> Result<Option<LeftOver>, BadInput> {
    let n = p.chamber_c.len();
    let order: Vec<f64> = p.chamber_c.clone();
    let with_step = |a: usize, after: usize| {
        let mut columns = cubic_columns(p, a);
        columns.push((0..n).map(|k| if order[k] > order[after] { 1.0 } else { 0.0 }).collect());
        columns
    };
    let before: Vec<DMatrix<f64>> = (0..AXES).map(|a| residual_maker(&cubic_columns(p, a))).collect();
    // The step must leave points on both sides for the cubic to be held down.
    let places: Vec<usize> = (1..n - 2).collect();
    let after: Vec<Vec<DMatrix<f64>>> =
        places.iter().map(|&s| (0..AXES).map(|a| residual_maker(&with_step(a, s))).collect()).collect();
    let search = |y: &DVector<f64>| {
        let start: f64 = before.iter().map(|m| (m * y).norm_squared()).sum();
        let mut best = (f64::INFINITY, 0);
        for (at, m) in after.iter().enumerate() {
            let left: f64 = m.iter().map(|m| (m * y).norm_squared()).sum();
            if left < best.0 {
                best = (left, at);
            }
        }
        (best.0 / start, best.1)
    };
    let (ratio, at) = search(&DVector::from_column_slice(&p.chamber_c));
    let mut rng = ChaCha8Rng::seed_from_u64(2023);
    let mut as_good = 0usize;
    for _ in 0..DRAWS {
        let y = DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng));
        as_good += usize::from(search(&y).0 <= ratio);
    }
    let p_value = (as_good as f64 + 1.0) / (DRAWS as f64 + 1.0);
    if p_value > 0.01 {
        return Ok(None);
    }
    let place = places[at];
    let mut axes = BTreeMap::new();
    for (a, name) in AXIS_NAMES.iter().enumerate() {
        let columns = with_step(a, place);
        let gain =
            crate::numeric::lsq::fit(&columns, &p.chamber_c, None, &["1", "u", "u^2", "u^3", "jump"])?.coefficients[4];
        let (e0, l0) = residuals(&cubic_columns(p, a), &p.chamber_c);
        let (e1, _) = residuals(&columns, &p.chamber_c);
        let l1: Vec<f64> = (0..n).map(|k| missed_by(p, a, k)).collect();
        axes.insert((*name).to_string(), before_after(gain, &e0, &l0, &e1, &l1));
    }
    let (from, to) = (p.chamber_c[place], p.chamber_c[place + 1]);
    Ok(Some(LeftOver {
        name: EffectId::Step.name().into(),
        reference: "chamber".into(),
        finding: format!(
            "between {from} and {to} C the chamber's temperature jumps against all three gyros, by {:.2} C on the mean",
            axes.values().map(|b| b.gain).sum::<f64>() / 3.0
        ),
        parameters: [("after_chamber_c".to_string(), from), ("before_chamber_c".to_string(), to)].into(),
        axes,
        p_value,
        statistic: format!(
            "residual sum of squares of the three cubics, with the best of {} places for a step against none; noise common to the three",
            places.len()
        ),
        indistinguishable_from: vec![],
    }))
}

/// What a soak is missed by if it is left out: the step is placed anew by the others, of all three gyros, and the cubic with
/// that step is fitted to them.
fn missed_by(p: &Points, a: usize, left_out: usize) -> f64 {
    let others: Vec<usize> = (0..p.chamber_c.len()).filter(|k| *k != left_out).collect();
    let y: Vec<f64> = others.iter().map(|&k| p.chamber_c[k]).collect();
    // A step half-way between two neighbours by the gyro's frequency, for every soak: the one left out too, whose chamber
    // temperature is what is to be predicted.
    let columns = |a: usize, after: usize| -> Vec<Vec<f64>> {
        let f = &p.frequency_hz[a];
        let threshold = 0.5 * (f[others[after]] + f[others[after + 1]]);
        let mut columns = cubic_columns(p, a);
        columns.push(f.iter().map(|f| if *f > threshold { 1.0 } else { 0.0 }).collect());
        columns
    };
    let fit = |a: usize, after: usize| {
        let rows: Vec<Vec<f64>> = columns(a, after).iter().map(|c| others.iter().map(|&k| c[k]).collect()).collect();
        crate::numeric::lsq::fit(&rows, &y, None, &["1", "u", "u^2", "u^3", "jump"]).ok()
    };
    let place = (1..y.len() - 2)
        .filter_map(|s| Some((s, (0..AXES).map(|a| fit(a, s).map(|f| f.squares)).sum::<Option<f64>>()?)))
        .min_by(|x, y| x.1.total_cmp(&y.1));
    let Some((fitted, place)) = place.and_then(|(s, _)| Some((fit(a, s)?, s))) else { return f64::NAN };
    let predicted: f64 = columns(a, place).iter().zip(&fitted.coefficients).map(|(c, k)| c[left_out] * k).sum();
    p.chamber_c[left_out] - predicted
}

/// Variance of what belongs to each of three residuals alone, from the variances of their differences (the three-cornered hat,
/// Gray and Allan 1974). At least a twentieth of the smallest residual's, for of ten points it may come out negative.
fn own_variances(e: &[Vec<f64>; AXES]) -> [f64; AXES] {
    let variance = |v: &[f64]| rms(v).powi(2);
    let difference = |a: usize, b: usize| variance(&e[a].iter().zip(&e[b]).map(|(x, y)| x - y).collect::<Vec<_>>());
    let least = 0.05 * e.iter().map(|v| variance(v)).fold(f64::INFINITY, f64::min);
    [0, 1, 2].map(|a| {
        let (b, c) = ((a + 1) % AXES, (a + 2) % AXES);
        (0.5 * (difference(a, b) + difference(a, c) - difference(b, c))).max(least)
    })
}

/// "x and y", and what is said of the others.
fn which(axes: &BTreeMap<String, BeforeAfter>, shrinks: impl Fn(&BeforeAfter) -> bool) -> String {
    let of =
        |wanted: bool| -> Vec<&String> { axes.iter().filter(|(_, b)| shrinks(b) == wanted).map(|(n, _)| n).collect() };
    let (yes, no) = (of(true), of(false));
    match (yes.is_empty(), no.is_empty()) {
        (false, true) => "shrinks on each axis".into(),
        (true, _) => "shrinks on no axis".into(),
        (false, false) => format!("shrinks on {} and not on {}", list(&yes), list(&no)),
    }
}

fn before_after(gain: f64, e0: &[f64], l0: &[f64], e1: &[f64], l1: &[f64]) -> BeforeAfter {
    BeforeAfter {
        gain,
        rms_before_c: rms(e0),
        rms_after_c: rms(e1),
        max_before_c: largest(e0),
        max_after_c: largest(e1),
        leave_one_out_before_c: rms(l0),
        leave_one_out_after_c: rms(l1),
    }
}

/// What the three cubics on the shell leave in common.
fn common_shape(p: &Points) -> Option<LeftOver> {
    let n = p.chamber_c.len();
    let makers: Vec<DMatrix<f64>> = (0..AXES).map(|a| residual_maker(&cubic_columns(p, a))).collect();
    let mean_correlation = |e: &[DVector<f64>]| {
        let r = |a: usize, b: usize| e[a].dot(&e[b]) / (e[a].norm() * e[b].norm());
        (r(0, 1) + r(1, 2) + r(0, 2)) / 3.0
    };
    let e: Vec<DVector<f64>> = (0..AXES).map(|a| &makers[a] * DVector::from_column_slice(&p.case_c[a])).collect();
    let seen = mean_correlation(&e);
    let mut rng = ChaCha8Rng::seed_from_u64(2024);
    let mut as_good = 0usize;
    for _ in 0..DRAWS {
        let drawn: Vec<DVector<f64>> =
            makers.iter().map(|m| m * DVector::from_fn(n, |_, _| StandardNormal.sample(&mut rng))).collect();
        as_good += usize::from(mean_correlation(&drawn) >= seen);
    }
    let p_value = (as_good as f64 + 1.0) / (DRAWS as f64 + 1.0);
    if p_value > 0.01 {
        return None;
    }
    let (residual, left_out): (Vec<Vec<f64>>, Vec<Vec<f64>>) =
        (0..AXES).map(|a| residuals(&cubic_columns(p, a), &p.case_c[a])).unzip();
    let residual: [Vec<f64>; AXES] = residual.try_into().ok()?;
    let own = own_variances(&residual);
    let mut axes = BTreeMap::new();
    for (a, name) in AXIS_NAMES.iter().enumerate() {
        let (b, c) = ((a + 1) % AXES, (a + 2) % AXES);
        // Predicted from the other two alone: their mean, each weighed by how little of it is its own.
        let weight = own[c] / (own[b] + own[c]);
        let shared = |e: &[Vec<f64>]| -> Vec<f64> {
            e[b].iter().zip(&e[c]).map(|(x, y)| weight * x + (1.0 - weight) * y).collect()
        };
        let less = |e: &[Vec<f64>]| -> Vec<f64> { e[a].iter().zip(shared(e)).map(|(o, s)| o - s).collect() };
        let figures =
            before_after(rms(&shared(&residual)), &residual[a], &left_out[a], &less(&residual), &less(&left_out));
        axes.insert((*name).to_string(), figures);
    }
    Some(LeftOver {
        name: EffectId::Timebase.name().into(),
        reference: "shell".into(),
        finding: format!(
            "what the three cubics leave has the same shape in all three gyros (mean correlation {seen:.3}); with what the other two predict taken off, the residual {}, its leave-one-out error {}",
            which(&axes, |b| b.rms_after_c < b.rms_before_c),
            which(&axes, |b| b.leave_one_out_after_c < b.leave_one_out_before_c)
        ),
        parameters: [("mean_correlation".to_string(), seen)].into(),
        axes,
        p_value,
        statistic: "mean pairwise correlation of the residuals of three cubics; noise independent on the three".into(),
        indistinguishable_from: vec![EffectId::Board.name().into(), EffectId::CaseGradient.name().into()],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten soaks of three gyros with a common shape, and noise of their own.
    fn table(common_c: f64, own_c: [f64; AXES], step_c: f64) -> Points {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut p = Points { rows: 10, ..Points::default() };
        for k in 0..10 {
            let t = f64::from(k) * 10.0 - 40.0;
            let shared = common_c * [1.0, -1.0, 0.5, -0.5, 1.5, -1.5, 0.7, -0.7, 1.0, -1.0][k as usize];
            p.chamber_c.push(t + if t > 0.0 { step_c } else { 0.0 });
            for a in 0..AXES {
                p.frequency_hz[a].push(4900.0 + 0.47 * t);
                let noise: f64 = StandardNormal.sample(&mut rng);
                p.case_c[a].push(t + shared + own_c[a] * noise);
            }
        }
        p
    }

    #[test]
    fn a_noisy_neighbour_counts_for_little() {
        let p = table(0.02, [0.002, 0.002, 0.05], 0.0);
        let residual: Vec<Vec<f64>> = (0..AXES).map(|a| residuals(&cubic_columns(&p, a), &p.case_c[a]).0).collect();
        let residual: [Vec<f64>; AXES] = residual.try_into().expect("three");
        let own = own_variances(&residual);
        assert!(own[2] > 20.0 * own[0] && own[2] > 20.0 * own[1], "{own:?}");
        // Weighed by it, the quiet axes predict each other; the plain mean with the noisy one would not.
        let left: Vec<f64> = residual[0].iter().zip(&residual[1]).map(|(x, y)| x - y).collect();
        let plain: Vec<f64> = (0..10).map(|k| residual[0][k] - 0.5 * (residual[1][k] + residual[2][k])).collect();
        assert!(rms(&left) < 0.2 * rms(&residual[0]) && rms(&plain) > 0.5 * rms(&residual[0]));
    }

    #[test]
    fn cells_and_columns_may_be_missing() {
        let text = |skip: &dyn Fn(usize) -> bool| -> String {
            let mut s = "chamber_c,fx_hz,fz_hz,shell_x_c\n".to_string();
            for k in 0..9 {
                let t = f64::from(k) * 5.0 + 20.0;
                // What the chamber's sensor misses is in both modes.
                let body = t + [0.3, -0.2, 0.1, -0.3, 0.2, -0.1, 0.3, -0.3, 0.1][k as usize];
                let case = if skip(k as usize) { String::new() } else { format!("{t}") };
                s += &format!("{t},{},{},{case}\n", 4900.0 + 0.47 * body, 9800.0 - 0.9 * body + 0.001 * body * body);
            }
            s
        };
        let r = report(&Points::parse(&text(&|k| k == 3)).expect("readable")).expect("fits");
        assert!(r.fits["shell"].len() == 1 && r.fits["shell"]["x"].inverse[2].residuals_c.len() == 8);
        assert_eq!(r.fits["chamber"].keys().collect::<Vec<_>>(), ["x", "z"]);
        let pair = &r.each_other[0];
        assert_eq!((pair.axes[1].as_str(), pair.soaks, r.each_other.len()), ("z", 9, 1));
        assert!(pair.correlation > 0.99 && pair.p_value < 1e-3, "{pair:?}");
        assert!(pair.by_the_other_rms_c[0] < 0.01 && pair.against_chamber_rms_c[0] > 0.05, "{pair:?}");
        let r = report(&Points::parse(&text(&|k| k > 4)).expect("readable")).expect("fits");
        assert!(!r.fits.contains_key("shell"), "five soaks are too few");
        let e = Points::parse("chamber_c,f_hz\n1,2\n").expect_err("no frequency").to_string();
        assert!(e.contains("fx_hz") && e.contains("there are chamber_c, f_hz"), "{e}");
    }

    #[test]
    fn words_follow_the_numbers() {
        let b = |before: f64, after: f64| BeforeAfter {
            gain: 0.0,
            rms_before_c: before,
            rms_after_c: after,
            max_before_c: 0.0,
            max_after_c: 0.0,
            leave_one_out_before_c: 0.0,
            leave_one_out_after_c: 0.0,
        };
        let say = |x: f64, y: f64| {
            let axes = [("x".to_string(), b(1.0, x)), ("y".to_string(), b(1.0, y))].into();
            which(&axes, |b| b.rms_after_c < b.rms_before_c)
        };
        assert_eq!(say(0.5, 0.5), "shrinks on each axis");
        assert_eq!(say(0.5, 1.5), "shrinks on x and not on y");
        assert_eq!(say(1.5, 1.5), "shrinks on no axis");
    }

    #[test]
    fn a_soak_left_out_does_not_place_the_step() {
        let p = table(0.0, [0.001; AXES], 3.0);
        let columns = |k: usize| {
            let mut c = cubic_columns(&p, 0);
            c.push(p.chamber_c.iter().map(|t| if *t > p.chamber_c[k] { 1.0 } else { 0.0 }).collect());
            c
        };
        // With the step where it is, each soak is predicted; the one next to it is not, if it may not say where the step is.
        let (_, kept) = residuals(&columns(4), &p.chamber_c);
        assert!(largest(&kept) < 0.1, "{kept:?}");
        let anew: Vec<f64> = (0..10).map(|k| missed_by(&p, 0, k)).collect();
        assert!(anew.iter().filter(|m| m.abs() > 1.0).count() == 1 && anew[5].abs() > 1.0, "{anew:?}");
    }
}
