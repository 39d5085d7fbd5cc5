//! Every identification method of the sources, on the same data, each ending in a block that the unit runs.
//!
//! A method is a *form* (which model) and a *search* (how its coefficients are found). Forms that are linear in their
//! coefficients have an exact solution, which a swarm can approach and not beat; what each search reaches beside that
//! solution is said in its notes.
//!
//! | name | form | search | source |
//! |---|---|---|---|
//! | `lsq` | eq 7 | least squares by QR | dong2023 |
//! | `two-sets` | eq 7, cooling and heating set, blended | least squares | dong2023 |
//! | `huber` | eq 7 | least squares, outliers weighed down (Huber) | |
//! | `pso` | eq 7 | swarm of dong2023 in orthogonal coordinates | dong2023 |
//! | `pso-literal` | eq 7 | the same swarm in its literal box: -1..1 on unscaled regressors | dong2023 |
//! | `pso-range` | eq 7 | the same swarm, smallest range of 100 s means | dong2023, wu2023 |
//! | `lp-range` | eq 7 | smallest range, exactly | |
//! | `fog-lsq` | four parameters, breakpoint scanned | least standard deviation of 100 s means, exactly | |
//! | `fog-pso` | four parameters, breakpoint searched too | swarm of wu2023, least standard deviation | wu2023 |
//! | `fog-lp` | four parameters, breakpoint scanned | smallest range, exactly | |
//! | `fog-pso-range` | four parameters, breakpoint searched too | swarm of wu2023, smallest range | wu2023 |
//! | `fog-literal` | four parameters, temperature from 0 C: steps at the breakpoint | least standard deviation, exactly | wu2023 |
//! | `polynomial` | cubic of temperature | least squares | zhao2022 |
//! | `ga-bp` | 1-5-1 network | genetic start, Levenberg-Marquardt | zhao2022 |
//! | `direct` | curve of frequency and its rate | least squares | dong2023, outlook |
//!
//! `hrg compare` adds the traced model ([`crate::trace`]) as `trace`.

use super::{minimax, network, swarm};
use crate::fit::{Prepared, MEAN_S};
use crate::numeric::lsq;
use crate::numeric::stats::{block_means, median, quantile};
use crate::recording::steps::Run;
use crate::{BadInput, AXIS_NAMES};
use hrg_core::bias::four_parameter::{self, FourParameter};
use hrg_core::bias::{self, direct, regressors, Coefficients, Scaling, State, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::{EffectId, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::AXES;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Names of the methods, in the order of the table above.
pub const NAMES: [&str; 15] = [
    "lsq",
    "two-sets",
    "huber",
    "pso",
    "pso-literal",
    "pso-range",
    "lp-range",
    "fog-lsq",
    "fog-pso",
    "fog-lp",
    "fog-pso-range",
    "fog-literal",
    "polynomial",
    "ga-bp",
    "direct",
];

/// Methods where a row may have a weight: their objective is a plain sum of squares.
pub const WEIGHABLE: [&str; 4] = ["lsq", "two-sets", "polynomial", "direct"];

/// What a block costs on the unit, as `hrg-board weigh` counts it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weight {
    /// The calibration weighed.
    pub calibration: String,
    /// Mean instructions of one update: three axes, frequencies to biases, windows and states included.
    pub update_instructions: f64,
    /// Mean instructions of the bias model of one axis alone.
    pub bias_instructions: f64,
    /// Mean instructions of turning one frequency into a temperature and a slope; zero where the model needs neither.
    pub law_instructions: f64,
    /// Length of the block.
    pub bytes: usize,
    /// Frames that the ELF sent.
    pub frames: usize,
    /// Frames that differ from hrg-core on the desktop.
    pub differing: usize,
}

/// What a method has identified.
#[derive(Debug, Clone)]
pub struct Identified {
    /// The calibration.
    pub calibration: Calibration,
    /// Numbers identified per axis, inner ones included.
    pub parameters: usize,
    /// How long it took here, s.
    pub seconds: f64,
    /// What the search reached beside the exact solution, and what the user should know.
    pub notes: Vec<String>,
}

/// A model that is linear in its coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    Baseline,
    TwoSets,
    Polynomial,
    Direct,
    Four { breakpoint_c: f32, origin_c: f32 },
}

impl Form {
    const POLYNOMIAL: [&'static str; 4] = ["1", "T", "T^2", "T^3"];
    const DIRECT: [&'static str; direct::TERMS] = ["1", "f", "f^2", "f^3", "df/dt", "(df/dt)^2", "f df/dt"];
    const FOUR: [&'static str; four_parameter::TERMS] = ["1", "dT when cooling", "dT when heating", "T low", "T high"];

    fn names(self) -> Vec<&'static str> {
        match self {
            Self::Baseline => crate::fit::NAMES.to_vec(),
            Self::TwoSets => crate::fit::NAMES.iter().chain(&crate::fit::NAMES).copied().collect(),
            Self::Polynomial => Self::POLYNOMIAL.to_vec(),
            Self::Direct => Self::DIRECT.to_vec(),
            Self::Four { .. } => Self::FOUR.to_vec(),
        }
    }

    /// The regressors of one step, by the unit's own code.
    fn row(self, scaling: &Scaling, s: &State, out: &mut [f64]) {
        let (t, r) = (s.temperature_c, s.rate_c_per_min);
        let mut fill = |values: &[f32]| out.iter_mut().zip(values).for_each(|(o, v)| *o = f64::from(*v));
        match self {
            Self::Baseline => fill(&regressors(scaling, t, r)),
            Self::TwoSets => {
                let (x, w) = (regressors(scaling, t, r), bias::heating_weight(scaling, r));
                let both: [f32; 2 * TERMS] =
                    std::array::from_fn(|j| if j < TERMS { (1.0 - w) * x[j] } else { w * x[j - TERMS] });
                fill(&both);
            }
            Self::Polynomial => {
                let x = regressors(scaling, t, r);
                fill(&[x[0], x[1], x[2], scaling.cube(t)]);
            }
            Self::Direct => fill(&direct::regressors(s.frequency_u, s.frequency_u_per_min, scaling.w_linear())),
            Self::Four { breakpoint_c, origin_c } => {
                fill(&four_parameter::regressors(breakpoint_c, origin_c, t, s.difference_c_per_min));
            }
        }
    }

    /// Puts coefficients into a calibration.
    fn store(self, c: &mut Calibration, a: usize, k: &[f64], std: &[f64]) -> Result<(), BadInput> {
        fn take<const N: usize>(k: &[f64], at: usize) -> [f32; N] {
            std::array::from_fn(|j| k.get(at + j).map_or(0.0, |x| *x as f32))
        }
        let axis = &mut c.axes[a];
        axis.coefficient_std = [take(std, 0), take(std, TERMS)];
        axis.coefficients = match self {
            Self::Baseline => Coefficients::One(take(k, 0)),
            Self::TwoSets => Coefficients::CoolingHeating(take(k, 0), take(k, TERMS)),
            Self::Polynomial => {
                let std3 = std.get(3).map_or(0.0, |x| *x as f32);
                axis.coefficient_std[0][3] = 0.0;
                let cubic = EffectId::Cubic.facts();
                if c.effects.is_empty() {
                    let none = [[0.0; MAX_OUTPUTS]; AXES];
                    let term =
                        EffectTerm { id: cubic.id, parameters: [0.0; MAX_PARAMETERS], gains: none, gain_std: none };
                    let _ = c.effects.push(term);
                }
                c.effects[0].gains[a][0] = k[3] as f32;
                c.effects[0].gain_std[a][0] = std3;
                Coefficients::One([k[0] as f32, k[1] as f32, k[2] as f32, 0.0, 0.0, 0.0])
            }
            Self::Direct => Coefficients::Direct(take(k, 0)),
            Self::Four { breakpoint_c, origin_c } => {
                Coefficients::FourParameter(FourParameter { k: take(k, 0), breakpoint_c, origin_c })
            }
        };
        Ok(())
    }
}

/// Columns and rates of one axis over all runs, run after run.
struct Data {
    columns: Vec<Vec<f64>>,
    y: Vec<f64>,
    lengths: Vec<usize>,
    names: Vec<&'static str>,
}

impl Data {
    fn new(runs: &[Run], scaling: &Scaling, a: usize, form: Form) -> Self {
        let names = form.names();
        let total = runs.iter().map(|r| r.steps.len()).sum();
        let mut columns = vec![Vec::new(); names.len()];
        let mut y = Vec::with_capacity(total);
        let mut row = vec![0.0; names.len()];
        for run in runs {
            for k in 0..run.steps.len() {
                match run.bias_state(k, a) {
                    Some(s) => form.row(scaling, s, &mut row),
                    None => row.fill(f64::NAN),
                }
                columns.iter_mut().zip(&row).for_each(|(c, v)| c.push(*v));
            }
            y.extend_from_slice(&run.steps.rate_dph[a]);
        }
        Self { columns, y, lengths: runs.iter().map(|r| r.steps.len()).collect(), names }
    }

    /// Means over windows that do not cross from one run into the next; rows with anything missing are left out.
    fn means(&self, length: usize) -> Self {
        let blocks = |values: &[f64]| -> Vec<f64> {
            let mut at = 0;
            let mut out = Vec::new();
            for n in &self.lengths {
                out.extend(block_means(&values[at..at + n], length));
                at += n;
            }
            out
        };
        let mut columns: Vec<Vec<f64>> = self.columns.iter().map(|c| blocks(c)).collect();
        let mut y = blocks(&self.y);
        let keep: Vec<bool> =
            (0..y.len()).map(|k| y[k].is_finite() && columns.iter().all(|c| c[k].is_finite())).collect();
        for v in columns.iter_mut().chain([&mut y]) {
            let mut flags = keep.iter();
            v.retain(|_| *flags.next().unwrap_or(&false));
        }
        let n = y.len();
        Self { columns, y, lengths: vec![n], names: self.names.clone() }
    }

    fn residuals(&self, k: &[f64]) -> Vec<f64> {
        (0..self.y.len()).map(|i| self.y[i] - self.columns.iter().zip(k).map(|(c, k)| c[i] * k).sum::<f64>()).collect()
    }

    fn fit(&self, weights: Option<&[f64]>) -> Result<lsq::Fit, BadInput> {
        lsq::fit(&self.columns, &self.y, weights, &self.names)
    }

    /// Adds the constant that brings the mean of the residuals to zero (the middle of their range would leave the mean of
    /// a run off zero), and gives all coefficients.
    fn with_constant(&self, rest: &[f64]) -> Vec<f64> {
        let mut k = vec![0.0];
        k.extend_from_slice(rest);
        k[0] = crate::numeric::stats::mean(&self.residuals(&k));
        k
    }
}

/// Least squares of a form over all steps of the runs, without columns of them.
fn fit_directly(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    form: Form,
    weights: Option<&[f64]>,
) -> Result<lsq::Fit, BadInput> {
    let names = form.names();
    let mut steps = runs.iter().flat_map(|run| (0..run.steps.len()).map(move |k| (run, k)));
    lsq::fit_rows(runs.iter().map(|r| r.steps.len()).sum(), names.len(), &names, |k, row| {
        let weight = weights.map_or(1.0, |w| w[k]);
        let Some((run, step)) = steps.next() else { return false };
        let Some(state) = run.bias_state(step, a) else { return false };
        form.row(scaling, state, row);
        row[names.len()] = run.steps.rate_dph[a][step];
        row.iter_mut().for_each(|v| *v *= weight.sqrt());
        weight > 0.0
    })
}

fn range(v: &[f64]) -> f64 {
    quantile(v, 1.0) - quantile(v, 0.0)
}

/// Sum of squares of a linear model folded into normal equations: `yy - 2 k.b + k.A k`, whatever the number of rows.
struct Folded {
    a: DMatrix<f64>,
    b: DVector<f64>,
    yy: f64,
}

impl Folded {
    fn new(columns: &[Vec<f64>], y: &[f64]) -> Self {
        let p = columns.len();
        let (mut a, mut b, mut yy) = (DMatrix::zeros(p, p), DVector::zeros(p), 0.0);
        let mut row = vec![0.0; p];
        for k in 0..y.len() {
            row.iter_mut().zip(columns).for_each(|(r, c)| *r = c[k]);
            if !(y[k].is_finite() && row.iter().all(|x| x.is_finite())) {
                continue;
            }
            for i in 0..p {
                for j in 0..=i {
                    a[(i, j)] += row[i] * row[j];
                }
                b[i] += row[i] * y[k];
            }
            yy += y[k] * y[k];
        }
        for i in 0..p {
            for j in i + 1..p {
                a[(i, j)] = a[(j, i)];
            }
        }
        Self { a, b, yy }
    }

    fn sum_of_squares(&self, k: &[f64]) -> f64 {
        let mut s = self.yy;
        for i in 0..k.len() {
            s -= 2.0 * k[i] * self.b[i];
            for j in 0..k.len() {
                s += k[i] * self.a[(i, j)] * k[j];
            }
        }
        s
    }
}

/// Weights that make every two degrees of temperature count alike, whatever time was spent there.
fn uniform_weights(runs: &[Run], a: usize) -> Vec<f64> {
    let bins: Vec<Option<i64>> = runs
        .iter()
        .flat_map(|r| {
            (0..r.steps.len()).map(move |k| r.bias_state(k, a).map(|s| (s.temperature_c / 2.0).floor() as i64))
        })
        .collect();
    let mut count = std::collections::BTreeMap::<i64, f64>::new();
    for b in bins.iter().flatten() {
        *count.entry(*b).or_default() += 1.0;
    }
    bins.iter().map(|b| b.map_or(0.0, |b| 1.0 / count[&b])).collect()
}

/// Runs one method on prepared data. The same seed gives the same block.
///
/// # Errors
/// One sentence that says what the data lack, and what run would supply it.
pub fn identify(prepared: &Prepared, method: &str, seed: u64) -> Result<Identified, BadInput> {
    identify_weighed(prepared, method, seed, false)
}

/// As [`identify`]; with `uniform`, every degree of temperature counts alike instead of every second
/// ([`WEIGHABLE`] methods only).
///
/// # Errors
/// As [`identify`].
pub fn identify_weighed(prepared: &Prepared, method: &str, seed: u64, uniform: bool) -> Result<Identified, BadInput> {
    if uniform && !WEIGHABLE.contains(&method) {
        return Err(BadInput::new(format!("{method} cannot weigh temperatures alike; {} can", WEIGHABLE.join(", "))));
    }
    let start = Instant::now();
    let mut calibration = prepared.calibration.clone();
    let mut notes = Vec::new();
    let mut parameters = 0;
    needs(prepared, method)?;
    let present: Vec<usize> = prepared.runs.first().map_or_else(Vec::new, |r| r.steps.present().collect());
    for a in present {
        let here = |e: BadInput| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a]));
        let mut note = |text: String| notes.push(format!("{}: {text}", AXIS_NAMES[a]));
        parameters = one_axis(prepared, &mut calibration, method, seed.wrapping_add(a as u64), uniform, a, &mut note)
            .map_err(here)?;
    }
    Ok(Identified { calibration, parameters, seconds: start.elapsed().as_secs_f64(), notes })
}

/// What a method needs to see in the data.
fn needs(prepared: &Prepared, method: &str) -> Result<(), BadInput> {
    if !(method == "two-sets" || method.starts_with("fog")) {
        return Ok(());
    }
    for (which, missing) in [("cooling", prepared.fastest[0] > -0.1), ("heating", prepared.fastest[1] < 0.1)] {
        if missing {
            return Err(BadInput::new(format!(
                "{method} has coefficients of its own for {which}, and there is no {which} ramp in the data; add a run that is {which} by at least 0.1 C per minute over the range of temperature"
            )));
        }
    }
    Ok(())
}

fn one_axis(
    prepared: &Prepared,
    calibration: &mut Calibration,
    method: &str,
    seed: u64,
    uniform: bool,
    a: usize,
    note: &mut dyn FnMut(String),
) -> Result<usize, BadInput> {
    let scaling = calibration.scaling;
    let runs = &prepared.runs;
    let data = |form| Data::new(runs, &scaling, a, form);
    let form = match method {
        "two-sets" => Form::TwoSets,
        "polynomial" => Form::Polynomial,
        "direct" => Form::Direct,
        _ => Form::Baseline,
    };
    match method {
        "lsq" | "two-sets" | "polynomial" | "direct" => {
            let weights = uniform.then(|| uniform_weights(runs, a));
            let fit = fit_directly(runs, &scaling, a, form, weights.as_deref())?;
            form.store(calibration, a, &fit.coefficients, &fit.std)?;
            note(format!("condition number {:.1}", fit.condition));
            Ok(fit.coefficients.len())
        }
        "huber" => {
            let (fit, down) = huber(&data(form))?;
            form.store(calibration, a, &fit.coefficients, &fit.std)?;
            note(format!("{:.2} % of the rows weighed down, condition number {:.1}", 100.0 * down, fit.condition));
            Ok(TERMS)
        }
        "pso" => {
            let d = data(form);
            let (k, above) = orthogonal_swarm(&d, seed)?;
            form.store(calibration, a, &k, &[])?;
            note(format!("sum of squares {:.1e} % above that of least squares", 100.0 * above));
            Ok(TERMS)
        }
        "pso-literal" => {
            let d = data(form);
            let (k, above) = literal_swarm(runs, &scaling, &d, a, seed)?;
            form.store(calibration, a, &k, &[])?;
            note(format!("sum of squares {:.2} times that of least squares", 1.0 + above));
            Ok(TERMS)
        }
        "lp-range" => {
            let d = data(form).means(MEAN_S);
            let (k, smallest) = smallest_range(&d)?;
            form.store(calibration, a, &k, &[])?;
            note(format!("range of 100 s means {smallest:.4} deg/h, the smallest there is"));
            Ok(TERMS)
        }
        "pso-range" => {
            let d = data(form).means(MEAN_S);
            let k = range_swarm(&d, seed)?;
            form.store(calibration, a, &k, &[])?;
            let (reached, smallest) = (range(&d.residuals(&k)), smallest_range(&d)?.1);
            note(format!(
                "range of 100 s means {reached:.4} deg/h, {:.2} % above the smallest there is",
                100.0 * (reached / smallest - 1.0).max(0.0)
            ));
            Ok(TERMS)
        }
        "fog-lsq" | "fog-literal" | "fog-lp" | "fog-pso" | "fog-pso-range" => {
            let m = four_parameters(runs, &scaling, a, method, seed, note)?;
            calibration.axes[a].coefficients = Coefficients::FourParameter(m);
            Ok(four_parameter::TERMS + 1)
        }
        "ga-bp" => {
            // The network sees what it will see on the unit, thinned to means of ten seconds.
            let (mut u, mut y) = (Vec::new(), Vec::new());
            for run in runs {
                let input: Vec<f64> = (0..run.steps.len())
                    .map(|k| {
                        run.bias_state(k, a)
                            .map_or(f64::NAN, |s| f64::from(bias::network::input(&scaling, s.temperature_c)))
                    })
                    .collect();
                for (u1, y1) in block_means(&input, 10).into_iter().zip(block_means(&run.steps.rate_dph[a], 10)) {
                    if u1.is_finite() && y1.is_finite() {
                        u.push(u1);
                        y.push(y1);
                    }
                }
            }
            calibration.axes[a].coefficients = Coefficients::Network(network::train(&u, &y, seed)?);
            Ok(bias::network::WEIGHTS)
        }
        other => Err(BadInput::new(format!("method \"{other}\" is not known; there are {}", NAMES.join(", ")))),
    }
}

/// Huber's weights: residuals beyond 1.345 robust standard deviations count linearly.
const HUBER: f64 = 1.345;

fn huber(d: &Data) -> Result<(lsq::Fit, f64), BadInput> {
    let mut weights = vec![1.0; d.y.len()];
    let mut fit = d.fit(None)?;
    let mut down = 0.0;
    for _ in 0..50 {
        let residuals = d.residuals(&fit.coefficients);
        let mut sizes: Vec<f64> = residuals.iter().filter(|e| e.is_finite()).map(|e| e.abs()).collect();
        // The median of |e| is 0.6745 standard deviations of a normal distribution.
        let limit = HUBER * median(&mut sizes).unwrap_or(0.0) / 0.6745;
        if !(limit > 0.0) {
            break;
        }
        for (w, e) in weights.iter_mut().zip(&residuals) {
            *w = if e.abs() <= limit || e.is_nan() { 1.0 } else { limit / e.abs() };
        }
        down = weights.iter().filter(|w| **w < 1.0).count() as f64 / weights.len() as f64;
        let next = d.fit(Some(&weights))?;
        let moved = next
            .coefficients
            .iter()
            .zip(&fit.coefficients)
            .zip(&next.std)
            .map(|((n, o), s)| (n - o).abs() / s.max(1e-300))
            .fold(0.0, f64::max);
        fit = next;
        if moved < 1e-4 {
            break;
        }
    }
    Ok((fit, down))
}

/// dong2023's swarm where it can work: columns made orthogonal and of unit length, so that the coordinates of the
/// solution are within the length of `y` about its mean (which the constant takes), and its box of -1..1 holds it once `y`
/// is scaled to less than length one. Gives the coefficients and by how much their sum of squares is above the least.
fn orthogonal_swarm(d: &Data, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let exact = d.fit(None)?;
    let mean = crate::numeric::stats::mean(&d.y);
    let about: Vec<f64> = d.y.iter().map(|y| y - mean).collect();
    let folded = Folded::new(&d.columns, &about);
    let p = d.columns.len();
    // A quarter of room: at a wall a swarm sticks.
    let length = 1.25 * folded.yy.sqrt().max(f64::MIN_POSITIVE);
    let scale: Vec<f64> = (0..p).map(|j| folded.a[(j, j)].sqrt()).collect();
    let normal = DMatrix::from_fn(p, p, |i, j| folded.a[(i, j)] / (scale[i] * scale[j]));
    // A = L L^T: z = L^T (scale k) / |y| are the orthogonal coordinates.
    let lower = normal
        .cholesky()
        .ok_or_else(|| BadInput::new("the run cannot tell the coefficients apart; record ramps in both directions"))?
        .l();
    let target = lower
        .solve_lower_triangular(&DVector::from_fn(p, |j, _| folded.b[j] / (scale[j] * length)))
        .ok_or_else(|| BadInput::new("the normal equations are singular"))?;
    // In these coordinates the sum of squares is that of y, and -2 z.t + z.z times the square of the length.
    let found = swarm::minimise(&swarm::DONG, &vec![([-1.0, 1.0], 1.0); p], seed, |z| {
        -2.0 * z.iter().zip(&target).map(|(z, t)| z * t).sum::<f64>() + z.iter().map(|z| z * z).sum::<f64>()
    });
    let z = DVector::from_vec(found.position);
    let scaled = lower
        .transpose()
        .solve_upper_triangular(&(&z * length))
        .ok_or_else(|| BadInput::new("the normal equations are singular"))?;
    let mut k: Vec<f64> = scaled.iter().zip(&scale).map(|(k, s)| k / s).collect();
    k[0] += mean;
    let least = exact.squares;
    let above = (z - target).norm_squared() * length * length / least;
    Ok((k, above))
}

/// dong2023's swarm in its orthogonal coordinates, on columns of one's own: the coefficients, and by how much their sum of
/// squares is above the least.
///
/// # Errors
/// Where the columns cannot be told apart.
pub fn swarm_on(columns: Vec<Vec<f64>>, y: Vec<f64>, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let (lengths, names) = (vec![y.len()], vec!["column"; columns.len()]);
    orthogonal_swarm(&Data { columns, y, lengths, names }, seed)
}

/// dong2023's swarm as printed: coefficients of `1, T, T^2, dT/dt, (dT/dt)^2, T dT/dt` with T in C, each within -1..1.
fn literal_swarm(runs: &[Run], scaling: &Scaling, d: &Data, a: usize, seed: u64) -> Result<(Vec<f64>, f64), BadInput> {
    let mut columns = vec![Vec::new(); TERMS];
    for run in runs {
        for k in 0..run.steps.len() {
            let (t, r) = run
                .bias_state(k, a)
                .map_or((f64::NAN, f64::NAN), |s| (f64::from(s.temperature_c), f64::from(s.rate_c_per_min)));
            for (c, v) in columns.iter_mut().zip([1.0, t, t * t, r, r * r, t * r]) {
                c.push(if t.is_nan() { f64::NAN } else { v });
            }
        }
    }
    let folded = Folded::new(&columns, &d.y);
    let found = swarm::minimise(&swarm::DONG, &[([-1.0, 1.0], 1.0); TERMS], seed, |k| folded.sum_of_squares(k));
    let least = d.fit(None)?.squares;
    // The same model in the unit's centred terms.
    let (t0, s) = (f64::from(scaling.t_ref_c), f64::from(scaling.t_scale_c));
    let k = &found.position;
    let centred = vec![
        k[0] + k[1] * t0 + k[2] * t0 * t0,
        (k[1] + 2.0 * k[2] * t0) * s,
        k[2] * s * s,
        k[3] + k[5] * t0,
        k[4],
        k[5] * s,
    ];
    Ok((centred, found.value / least - 1.0))
}

fn smallest_range(d: &Data) -> Result<(Vec<f64>, f64), BadInput> {
    let (rest, smallest) = minimax::fit(&d.columns[1..], &d.y)?;
    Ok((d.with_constant(&rest), smallest))
}

/// The swarm on the range, about the least-squares solution: coordinates are standard deviations of 100 s means over
/// the spread of each centred column, the box three of them either way.
fn range_swarm(d: &Data, seed: u64) -> Result<Vec<f64>, BadInput> {
    let fit = d.fit(None)?;
    let centre = d.residuals(&fit.coefficients);
    let width = 3.0 * range(&centre);
    let columns: Vec<(Vec<f64>, f64)> =
        d.columns[1..].iter().map(|c| (c.clone(), width / range(c).max(1e-12))).collect();
    let mut work = vec![0.0; d.y.len()];
    let found = swarm::minimise(&swarm::DONG, &vec![([-1.0, 1.0], 1.0); columns.len()], seed, |z| {
        work.copy_from_slice(&centre);
        for ((c, s), z) in columns.iter().zip(z) {
            work.iter_mut().zip(c).for_each(|(w, c)| *w -= z * s * c);
        }
        let (low, high) = work.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), w| (l.min(*w), h.max(*w)));
        high - low
    });
    let rest: Vec<f64> =
        found.position.iter().zip(&columns).zip(&fit.coefficients[1..]).map(|((z, (_, s)), k)| k + z * s).collect();
    Ok(d.with_constant(&rest))
}

/// Breakpoints that are tried lie this far apart, C.
const BREAKPOINT_STEP_C: f64 = 1.0;

/// wu2023's model: everything is judged on 100 s means, as there.
fn four_parameters(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    method: &str,
    seed: u64,
    note: &mut dyn FnMut(String),
) -> Result<FourParameter, BadInput> {
    let mut temperatures: Vec<f64> = Vec::new();
    for run in runs {
        temperatures
            .extend((0..run.steps.len()).filter_map(|k| run.bias_state(k, a)).map(|s| f64::from(s.temperature_c)));
    }
    // A tenth of the range on either side is left to each branch.
    let (low, high) = (quantile(&temperatures, 0.0), quantile(&temperatures, 1.0));
    let margin = 0.1 * (high - low);
    let count = ((high - low - 2.0 * margin) / BREAKPOINT_STEP_C).floor() as usize;
    let breakpoints: Vec<f32> = (0..=count).map(|k| (low + margin + k as f64 * BREAKPOINT_STEP_C) as f32).collect();
    let literal = method == "fog-literal";
    let form = |b: f32| Form::Four { breakpoint_c: b, origin_c: if literal { 0.0 } else { b } };
    let tables: Vec<Data> = breakpoints.iter().map(|b| Data::new(runs, scaling, a, form(*b)).means(MEAN_S)).collect();
    // The exact solutions, breakpoint by breakpoint.
    let by_range = method.contains("range") || method == "fog-lp";
    let mut best: Option<(f64, usize, Vec<f64>)> = None;
    for (n, d) in tables.iter().enumerate() {
        let (value, k) = if by_range {
            let (k, value) = smallest_range(d)?;
            (value, k)
        } else {
            let k = d.fit(None)?.coefficients;
            (crate::numeric::stats::std_dev(&d.residuals(&k)), k)
        };
        if best.as_ref().is_none_or(|b| value < b.0) {
            best = Some((value, n, k));
        }
    }
    let (exact, mut at, mut k) = best.ok_or_else(|| {
        BadInput::new("the temperatures span too little for a breakpoint; record a run over tens of degrees")
    })?;
    let what = if by_range { "range" } else { "standard deviation" };
    if method.starts_with("fog-pso") {
        (at, k) = four_parameter_swarm(&tables, by_range, seed)?;
        let e = tables[at].residuals(&k);
        let reached = if by_range { range(&e) } else { crate::numeric::stats::std_dev(&e) };
        note(format!(
            "{what} of 100 s means {reached:.5} deg/h, {:.3} % above the exact solution",
            100.0 * (reached / exact - 1.0).max(0.0)
        ));
    } else {
        note(format!("{what} of 100 s means {exact:.5} deg/h, the least there is"));
    }
    let b = breakpoints[at];
    if literal {
        note(format!("the bias jumps by {:.4} deg/h at {b:.0} C", (k[4] - k[3]) * f64::from(b)));
    }
    note(format!("breakpoint {b:.0} C"));
    Ok(FourParameter {
        k: std::array::from_fn(|j| k[j] as f32),
        breakpoint_c: b,
        origin_c: if literal { 0.0 } else { b },
    })
}

/// wu2023's swarm: four coefficients and the breakpoint. Its search ranges are in units of its gyro's output; here each
/// coefficient may move the bias by three ranges of the rate over the run. Its speed limit of 10 is a tenth of the range
/// of its temperature coefficients and an eightieth of that of its coefficients of change; a tenth is taken for all:
/// with an eightieth the swarm settles on a breakpoint before the coefficients have arrived.
fn four_parameter_swarm(tables: &[Data], by_range: bool, seed: u64) -> Result<(usize, Vec<f64>), BadInput> {
    let y = &tables[0].y;
    let width = 3.0 * range(y).max(1e-12);
    let scale: Vec<f64> = (1..four_parameter::TERMS)
        .map(|j| {
            let most = tables.iter().map(|d| range(&d.columns[j])).fold(0.0, f64::max);
            width / most.max(1e-12)
        })
        .collect();
    let mut limits: Vec<([f64; 2], f64)> = vec![([-1.0, 1.0], 0.1); 4];
    limits.push(([0.0, tables.len() as f64 - 1e-9], 0.1 * tables.len() as f64));
    let mut work = vec![0.0; y.len()];
    let found = swarm::minimise(&swarm::WU, &limits, seed, |z| {
        let d = &tables[z[4] as usize];
        let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for (i, w) in work.iter_mut().enumerate() {
            let mut e = d.y[i];
            for j in 0..4 {
                e -= z[j] * scale[j] * d.columns[j + 1][i];
            }
            *w = e;
            sum += e;
            low = low.min(e);
            high = high.max(e);
        }
        if by_range {
            return high - low;
        }
        let mean = sum / work.len() as f64;
        work.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>()
    });
    let at = found.position[4] as usize;
    let rest: Vec<f64> = found.position[..4].iter().zip(&scale).map(|(z, s)| z * s).collect();
    Ok((at, tables[at].with_constant(&rest)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{self, prepare};
    use crate::numeric::stats::std_dev;
    use crate::recording::steps::Steps;
    use crate::simulate::{Kind, Noise, Plan, Profile};

    fn plan(kind: Kind, profile: &str, seed: u64) -> Plan {
        Plan { kind, noise: kind.noise(), ..Plan::of(Profile::parse(profile).expect("named"), 5, seed) }
    }

    fn errors(c: &Calibration, plan: &Plan) -> ([f64; AXES], [f64; AXES]) {
        let s = plan.simulate();
        let corrected = fit::correct(c, &Steps::new(&s.recording).expect("long enough"));
        ([0, 1, 2].map(|a: usize| std_dev(&block_means(&corrected[a], MEAN_S))), s.truth.floor_dph)
    }

    #[test]
    fn every_method_of_an_hrg_reaches_the_noise_on_an_unseen_run() {
        let p = prepare(&[plan(Kind::Hrg, "cycle", 1).simulate().recording]).expect("prepares");
        let verify = plan(Kind::Hrg, "verify", 2);
        // What the data of the fit hold of range alone says less of another run: allowed twice the floor.
        for (method, most) in [
            ("lsq", 1.1),
            ("two-sets", 1.15),
            ("huber", 1.1),
            ("pso", 1.1),
            ("lp-range", 2.0),
            ("pso-range", 2.0),
            ("direct", 1.1),
        ] {
            let id = identify(&p, method, 3).expect("identifies");
            id.calibration.check().expect("a block");
            let (e, floor) = errors(&id.calibration, &verify);
            for a in 0..AXES {
                assert!(e[a] < most * floor[a], "{method} axis {a}: {} over {}", e[a], floor[a]);
            }
        }
    }

    #[test]
    fn a_swarm_approaches_least_squares_and_the_literal_box_does_not() {
        // A constant far above what varies, and a rate that the model explains almost wholly, are no harder.
        for (kind, profile) in [(Kind::Fog, "wu"), (Kind::Zhao, "zhao"), (Kind::Hrg, "cycle")] {
            let p = prepare(&[plan(kind, profile, 1).simulate().recording]).expect("prepares");
            for a in 0..AXES {
                let d = Data::new(&p.runs, &p.calibration.scaling, a, Form::Baseline);
                for seed in 0..5 {
                    let (k, above) = orthogonal_swarm(&d, seed).expect("swarms");
                    let squares =
                        |k: &[f64]| -> f64 { d.residuals(k).iter().filter(|e| e.is_finite()).map(|e| e * e).sum() };
                    let least = squares(&d.fit(None).expect("fits").coefficients);
                    assert!((0.0..1e-5).contains(&above), "{kind:?} axis {a}: {above:e}");
                    assert!((squares(&k) / least - 1.0).abs() < 2e-5, "{kind:?} axis {a}: what it says is so");
                }
            }
        }
        let p = prepare(&[plan(Kind::Hrg, "dong", 1).simulate().recording]).expect("prepares");
        for a in 0..AXES {
            let d = Data::new(&p.runs, &p.calibration.scaling, a, Form::Baseline);
            let (_, above) = orthogonal_swarm(&d, 1).expect("swarms");
            assert!((0.0..1e-5).contains(&above), "{above:e}");
            let (_, literal) = literal_swarm(&p.runs, &p.calibration.scaling, &d, a, 1).expect("swarms");
            assert!(
                literal > 0.01 && literal > 1e4 * above,
                "{literal}: the box cannot hold the constants of this unit"
            );
        }
    }

    #[test]
    fn folded_and_long_sums_are_the_same() {
        let p = prepare(&[plan(Kind::Hrg, "fast", 1).simulate().recording]).expect("prepares");
        let d = Data::new(&p.runs, &p.calibration.scaling, 0, Form::Baseline);
        let k = [1.0, -0.5, 0.25, 2.0, 0.1, -0.3];
        let long: f64 = d.residuals(&k).iter().filter(|e| e.is_finite()).map(|e| e * e).sum();
        assert!((Folded::new(&d.columns, &d.y).sum_of_squares(&k) / long - 1.0).abs() < 1e-9);
    }

    #[test]
    fn four_parameters_come_back_with_their_breakpoint() {
        let p = prepare(&[plan(Kind::Fog, "wu", 1).simulate().recording]).expect("prepares");
        let verify = plan(Kind::Fog, "wu", 2);
        for (method, most) in [("fog-lsq", 1.15), ("fog-pso", 1.15), ("fog-lp", 1.5), ("fog-pso-range", 1.5)] {
            let id = identify(&p, method, 3).expect("identifies");
            let (e, floor) = errors(&id.calibration, &verify);
            for a in 0..AXES {
                assert!(e[a] < most * floor[a], "{method} axis {a}: {} over {}", e[a], floor[a]);
            }
        }
    }

    #[test]
    fn exact_solutions_are_not_beaten_by_swarms() {
        let p = prepare(&[plan(Kind::Fog, "wu", 4).simulate().recording]).expect("prepares");
        for method in ["fog-pso", "fog-pso-range"] {
            let notes = identify(&p, method, 3).expect("identifies").notes;
            let above: Vec<f64> =
                notes.iter().filter_map(|n| n.split("deg/h, ").nth(1)?.split(' ').next()?.parse().ok()).collect();
            assert_eq!(above.len(), 3, "{notes:?}");
            assert!(above.iter().all(|x| (0.0..10.0).contains(x)), "{method}: {notes:?}");
        }
    }

    #[test]
    fn a_network_learns_a_gyro_and_repeats_itself() {
        let p = prepare(&[plan(Kind::Zhao, "zhao", 1).simulate().recording]).expect("prepares");
        let id = identify(&p, "ga-bp", 3).expect("identifies");
        assert_eq!(id.calibration, identify(&p, "ga-bp", 3).expect("identifies").calibration);
        let polynomial = identify(&p, "polynomial", 3).expect("identifies");
        let verify = plan(Kind::Zhao, "zhao", 2);
        let ((network, floor), (cubic, _)) =
            (errors(&id.calibration, &verify), errors(&polynomial.calibration, &verify));
        for a in 0..AXES {
            assert!(network[a] < 1.3 * floor[a], "axis {a}: {} over {}", network[a], floor[a]);
            assert!(network[a] < cubic[a], "axis {a}");
        }
    }

    #[test]
    fn outliers_hardly_move_the_robust_fit() {
        let clean = plan(Kind::Hrg, "cycle", 1).simulate().recording;
        let mut dirty = clean.clone();
        // A disturbance too long to be a spike and too small to be taken out: ten minutes of three deg/h in each hour.
        for v in &mut dirty.rate_dph {
            for (k, x) in v.iter_mut().enumerate() {
                if k % 3600 < 600 {
                    *x += 30.0;
                }
            }
        }
        let verify = plan(Kind::Hrg, "verify", 2);
        let p = prepare(&[dirty]).expect("prepares");
        let error = |method| {
            let (e, _) = errors(&identify(&p, method, 1).expect("identifies").calibration, &verify);
            e.iter().sum::<f64>()
        };
        assert!(error("huber") < 0.7 * error("lsq"), "{} {}", error("huber"), error("lsq"));
    }

    #[test]
    fn what_the_data_lack_is_said() {
        let p = prepare(&[plan(Kind::Hrg, "up", 1).simulate().recording]).expect("prepares");
        for method in ["two-sets", "fog-lsq"] {
            let e = identify(&p, method, 1).expect_err("refused").0;
            assert!(e.contains("cooling") && e.contains("add a run"), "{e}");
        }
        assert!(identify(&p, "guess", 1).expect_err("refused").0.contains("polynomial"));
        let quiet = Plan { noise: Noise::default(), ..plan(Kind::Hrg, "20,3h", 1) };
        let p = prepare(&[quiet.simulate().recording]).expect("with a warning");
        assert!(p.notes.iter().any(|n| n.contains("hard to tell apart")), "{:?}", p.notes);
    }
}
