//! A fitted model of the bias: baseline, effects, their uncertainty; on a recording, and as an image.

use super::data::{day_column, Candidate, Data};
use super::noise::NOISE_MODELS;
use super::stated::Stated;
use crate::fit;
use crate::fit::{baseline_columns, MEAN_S};
use hrg_core::bias::{Coefficients, Scaling, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm, Uncertainty, DIRECTIONS, MAX_EFFECTS};
use hrg_core::effects::{EffectId, MAX_OUTPUTS};
use hrg_core::half::Half;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::block_means;
use hrg_data::recording::steps::Run;
use nalgebra::{DMatrix, DVector};

/// An effect with the axes that have it.
#[derive(Debug, Clone)]
pub struct Term {
    /// The effect, or effects that were found together; the first gives the name.
    pub parts: Vec<Candidate>,
    /// By axis: variance of each gain before the data are seen, over the whitened noise's; empty where the axis does not have it.
    pub prior: [Vec<f64>; AXES],
}

impl Term {
    /// The effect that gives the name.
    #[must_use]
    pub fn lead(&self) -> &Candidate {
        &self.parts[0]
    }

    fn outputs(&self) -> usize {
        self.parts.iter().map(|c| c.facts.outputs).sum()
    }

    /// Its regressors on every step of a run; `number`: index among the train runs. A part that belongs to another run is zero.
    fn on_run(&self, run: &Run, number: Option<usize>, scaling: &Scaling, a: usize) -> Vec<Vec<f64>> {
        self.parts
            .iter()
            .flat_map(|c| {
                if c.run.is_some() && c.run != number {
                    return vec![vec![0.0; run.steps.len()]; c.facts.outputs];
                }
                let x = run.effect(c.facts.id, &c.parameters, c.starts.of(number), scaling, a);
                (0..c.facts.outputs).map(|j| x.iter().map(|v| f64::from(v[j])).collect()).collect()
            })
            .collect()
    }

    /// `true` if an axis has it.
    #[must_use]
    pub fn on(&self, a: usize) -> bool {
        !self.prior[a].is_empty()
    }
}

/// The columns of one axis' fit.
pub struct Columns {
    /// The baseline's, those of each term that the axis has, in order, then one for each day from the second on.
    pub values: Vec<Vec<f64>>,
    /// Name of each column.
    pub names: Vec<&'static str>,
    /// Variance of each coefficient before the data are seen, over the whitened noise's; `None`: unbounded.
    pub prior: Vec<Option<f64>>,
}

/// The columns of an axis, on the blocks that have data.
pub fn columns(data: &Data<'_>, terms: &[Term], a: usize) -> Columns {
    let base = &data.axes[a].base;
    let mut values = base[..TERMS].to_vec();
    let mut names: Vec<&'static str> = fit::NAMES.to_vec();
    let mut prior = vec![None; TERMS];
    for t in terms.iter().filter(|t| t.on(a)) {
        values.extend(t.parts.iter().flat_map(|c| data.columns(c, a, true).unwrap_or_default()));
        names.extend(std::iter::repeat_n(t.lead().facts.name, t.outputs()));
        prior.extend(t.prior[a].iter().map(|v| Some(*v)));
    }
    // Constants that belong to a day and not to the unit.
    values.extend(base[TERMS..].iter().cloned());
    names.extend(std::iter::repeat_n("the day", base.len() - TERMS));
    prior.resize(values.len(), None);
    Columns { values, names, prior }
}

/// Fit of one axis.
#[derive(Debug, Clone)]
pub struct AxisFit {
    /// Coefficients: the baseline's, then the gains of each term that the axis has, in order.
    pub coefficients: Vec<f64>,
    /// Their standard deviations.
    pub std: Vec<f64>,
    /// Constants of the days, from the second run on: see [`day_column`].
    pub days: Vec<f64>,
    /// Covariance of the coefficients and the days.
    covariance: DMatrix<f64>,
}

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// Effects beyond the baseline.
    pub terms: Vec<Term>,
    /// The axes.
    pub axes: [AxisFit; AXES],
    /// Set if the judged run continues the train run ([`Data::goes_on`]).
    goes_on: bool,
}

impl Fitted {
    /// Generalised least squares on exact columns. An effect confined to one run is zero in the others.
    ///
    /// # Errors
    /// Data that cannot hold the coefficients down.
    pub fn new(data: &Data<'_>, terms: &[Term], noise_models: [usize; AXES]) -> Result<Self, BadInput> {
        let one = |a: usize| -> Result<AxisFit, BadInput> {
            let rows = &data.axes[a];
            if data.runs.iter().all(|r| r.steps.absent[a]) {
                let count = TERMS + terms.iter().filter(|t| t.on(a)).map(Term::outputs).sum::<usize>();
                let zeros = vec![0.0; count];
                let covariance = DMatrix::zeros(count, count);
                return Ok(AxisFit { coefficients: zeros.clone(), std: zeros, days: vec![], covariance });
            }
            let Columns { values: mut columns, names, prior } = columns(data, terms, a);
            let mut y = rows.y.clone();
            let noise_model = NOISE_MODELS[noise_models[a]];
            columns.iter_mut().for_each(|c| noise_model.whiten(c, &rows.starts));
            noise_model.whiten(&mut y, &rows.starts);
            let fit = hrg_data::numeric::lsq::fit_shrunk(&columns, &y, &prior, &names)
                .map_err(|e| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a])))?;
            let mut coefficients = fit.coefficients;
            let days = coefficients.split_off(columns.len() + TERMS - rows.base.len());
            Ok(AxisFit { coefficients, std: fit.std, days, covariance: fit.covariance })
        };
        Ok(Self { terms: terms.to_vec(), axes: [one(0)?, one(1)?, one(2)?], goes_on: data.goes_on })
    }

    /// Range of the gains of term `e` among an axis' coefficients; `None` if the axis does not have it.
    pub fn gains(&self, e: usize, a: usize) -> Option<std::ops::Range<usize>> {
        let width = |t: &Term| if t.on(a) { t.outputs() } else { 0 };
        let from = TERMS + self.terms[..e].iter().map(width).sum::<usize>();
        self.terms[e].on(a).then(|| from..from + width(&self.terms[e]))
    }

    /// Places, among an axis' coefficients, of the gains of steps that last. A step of the train run ends with that run; where the log
    /// goes on without a break, the unit keeps it.
    pub fn lasting(&self, a: usize) -> Vec<usize> {
        let step = |t: &Term| match t.lead().facts.effect {
            EffectId::Step => Some(0),
            EffectId::Shock => Some(1),
            _ => None,
        };
        let steps = self.terms.iter().enumerate().filter_map(|(e, t)| Some((e, step(t).filter(|_| self.goes_on)?)));
        steps.filter_map(|(e, output)| Some(self.gains(e, a)?.start + output)).collect()
    }

    /// The bias of a run on every step, of the baseline and those terms that `which` lets through. `number`: which of the
    /// train runs it is, for terms that are confined to one.
    pub fn bias(
        &self,
        run: &Run,
        number: Option<usize>,
        scaling: &Scaling,
        a: usize,
        which: &dyn Fn(&Candidate) -> bool,
    ) -> Vec<f64> {
        let mut out = vec![0.0; run.steps.len()];
        for (column, k) in baseline_columns(run, scaling, a).iter().zip(&self.axes[a].coefficients) {
            for (o, x) in out.iter_mut().zip(column) {
                *o += k * x;
            }
        }
        if let Some(run) = number {
            let day: f64 = self.axes[a].days.iter().enumerate().map(|(d, k)| k * day_column(d, run)).sum();
            out.iter_mut().for_each(|o| *o += day);
        } else {
            let lasting: f64 = self.lasting(a).iter().map(|at| self.axes[a].coefficients[*at]).sum();
            out.iter_mut().for_each(|o| *o += lasting);
        }
        for (e, t) in self.terms.iter().enumerate().filter(|(_, t)| which(t.lead())) {
            let Some(range) = self.gains(e, a) else { continue };
            let gains = &self.axes[a].coefficients[range];
            for (column, g) in t.on_run(run, number, scaling, a).iter().zip(gains) {
                out.iter_mut().zip(column).for_each(|(o, x)| *o += g * x);
            }
        }
        out
    }

    /// Rates less the bias, by axis, on every step.
    pub fn residuals(
        &self,
        run: &Run,
        number: Option<usize>,
        scaling: &Scaling,
        which: &dyn Fn(&Candidate) -> bool,
    ) -> [Vec<f64>; AXES] {
        [0, 1, 2].map(|a| {
            let bias = self.bias(run, number, scaling, a, which);
            run.steps.rate_dph[a].iter().zip(bias).map(|(r, b)| r - b).collect()
        })
    }

    /// Variance that the uncertainty of the coefficients adds to the 100 s means of a run: about their mean, and of their mean.
    pub fn predicted_variance(
        &self,
        run: &Run,
        scaling: &Scaling,
        a: usize,
        which: &dyn Fn(&Candidate) -> bool,
    ) -> (f64, f64) {
        let mut columns: Vec<(usize, Vec<f64>)> =
            baseline_columns(run, scaling, a).iter().map(|c| block_means(c, MEAN_S)).enumerate().collect();
        let count = columns[0].1.len();
        columns.extend(self.lasting(a).into_iter().map(|at| (at, vec![1.0; count])));
        for (e, t) in self.terms.iter().enumerate().filter(|(_, t)| which(t.lead())) {
            let Some(range) = self.gains(e, a) else { continue };
            for (column, at) in t.on_run(run, None, scaling, a).iter().zip(range) {
                columns.push((at, block_means(column, MEAN_S)));
            }
        }
        let p = columns.len();
        let covariance = DMatrix::from_fn(p, p, |i, j| self.axes[a].covariance[(columns[i].0, columns[j].0)]);
        let rows: Vec<DVector<f64>> = (0..columns[0].1.len())
            .map(|k| DVector::from_iterator(p, columns.iter().map(|(_, c)| c.get(k).copied().unwrap_or(f64::NAN))))
            .filter(|r| r.iter().all(|v| v.is_finite()))
            .collect();
        if rows.is_empty() {
            return (0.0, 0.0);
        }
        let mean = rows.iter().sum::<DVector<f64>>() / rows.len() as f64;
        let about = rows
            .iter()
            .map(|r| {
                let x = r - &mean;
                (x.transpose() * &covariance * &x)[(0, 0)]
            })
            .sum::<f64>()
            / rows.len() as f64;
        (about, (mean.transpose() * &covariance * &mean)[(0, 0)])
    }

    /// The image: effects that a unit can compute, with their uncertainty where it is given, in as many directions as fit.
    pub fn image(&self, base: &Calibration, stated: &[Option<Stated>; AXES], notes: &mut Vec<String>) -> Calibration {
        let with = |count: usize| {
            let fewer = stated.each_ref().map(|s| s.as_ref().map(|s| s.with_directions(count)));
            let mut notes = Vec::new();
            (self.image_with(base, &fewer, &mut notes), notes)
        };
        let fits = |made: &(Calibration, Vec<String>)| made.0.to_bytes().is_some();
        let (image, more) = (1..=DIRECTIONS).rev().map(with).find(fits).unwrap_or_else(|| with(0));
        notes.extend(more);
        image
    }

    fn image_with(&self, base: &Calibration, stated: &[Option<Stated>; AXES], notes: &mut Vec<String>) -> Calibration {
        let mut c = base.clone();
        c.effects.clear();
        for a in 0..AXES {
            let fit = &self.axes[a];
            let lasting: f64 = self.lasting(a).iter().map(|at| fit.coefficients[*at]).sum();
            c.axes[a].coefficients = Coefficients::One(std::array::from_fn(|j| {
                (fit.coefficients[j] + if j == 0 { lasting } else { 0.0 }) as f32
            }));
            c.axes[a].bias_std_dph = [std::array::from_fn(|j| fit.std[j] as f32), [0.0; TERMS]];
            c.axes[a].uncertainty = Uncertainty::default();
            if let Some(s) = &stated[a] {
                c.axes[a].uncertainty.rest_dph2 = s.rest_dph2 as f32;
                for (to, from) in c.axes[a].uncertainty.baseline.iter_mut().zip(&s.directions) {
                    *to = std::array::from_fn(|j| from[j] as f32);
                }
            }
        }
        for (e, t) in self.terms.iter().enumerate().filter(|(_, t)| t.lead().on_unit()) {
            let mut from = 0;
            for part in &t.parts {
                if !part.on_unit() {
                    from += part.facts.outputs;
                    continue;
                }
                let mut term = EffectTerm::new(part.facts.id, part.parameters);
                term.start = part.starts.on_unit();
                for a in 0..AXES {
                    let own = self.gains(e, a).into_iter().flatten().skip(from).take(part.facts.outputs);
                    for (j, at) in own.enumerate() {
                        term.gains[a][j] = self.axes[a].coefficients[at] as f32;
                        term.gain_std[a][j] = self.axes[a].std[at] as f32;
                        let directions = stated[a].iter().flat_map(|s| &s.directions);
                        for (to, from) in term.directions.iter_mut().zip(directions) {
                            to[a][j] = Half::of(from[at] as f32);
                        }
                    }
                }
                from += part.facts.outputs;
                if c.effects.push(term).is_err() {
                    notes.push(format!("an image holds {MAX_EFFECTS} effects; {} did not fit", part.facts.name));
                }
            }
        }
        c
    }
}

/// Gives one axis of an image the coefficients of another image, without effects.
pub fn take_axis(image: &mut Calibration, from: &Calibration, a: usize) {
    image.axes[a].coefficients = from.axes[a].coefficients;
    image.axes[a].bias_std_dph = from.axes[a].bias_std_dph;
    image.axes[a].uncertainty = from.axes[a].uncertainty;
    for term in &mut image.effects {
        term.gains[a] = [0.0; MAX_OUTPUTS];
        term.gain_std[a] = [0.0; MAX_OUTPUTS];
        term.directions.iter_mut().for_each(|d| d[a] = [Half::ZERO; MAX_OUTPUTS]);
    }
}

/// An image with some axes of another one, effects and all; `None` if an image cannot hold the effects of both.
pub fn with_axes_of(image: &Calibration, other: &Calibration, axes: &[usize]) -> Option<Calibration> {
    let (mut merged, mut theirs) = (image.clone(), other.clone());
    for a in 0..AXES {
        take_axis(if axes.contains(&a) { &mut merged } else { &mut theirs }, other, a);
    }
    drop_idle_effects(&mut merged);
    drop_idle_effects(&mut theirs);
    for term in theirs.effects {
        merged.effects.push(term).ok()?;
    }
    merged.to_bytes().is_some().then_some(merged)
}

/// Takes out effects that no axis has.
pub fn drop_idle_effects(image: &mut Calibration) {
    image.effects.retain(|t| t.gains.iter().flatten().any(|g| *g != 0.0));
}
