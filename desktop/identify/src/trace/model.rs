//! A fitted model of the bias: baseline, effects, their uncertainty; on a recording, and as an image.

use super::data::{day_column, Candidate, Data};
use super::days::{OfDays, Part};
use super::regression::{posterior, Posterior};
use super::stated::Stated;
use crate::fit;
use crate::fit::baseline_columns;
use hrg_core::bias::{Coefficients, Scaling, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm, Uncertainty, DIRECTIONS, MAX_EFFECTS};
use hrg_core::effects::{EffectId, MAX_OUTPUTS};
use hrg_core::half::Half;
use hrg_core::inputs::{self, Input, QuantitySet};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::block_means;
use hrg_data::recording::steps::Run;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Terms of the baseline that depend on the temperature alone: 1, T, T^2. The others, of the ramp, are shrunk as a family is.
pub const TEMPERATURE_TERMS: usize = 3;

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

/// A model before it is fitted: effects, and the variances of gains before the data are seen.
#[derive(Debug, Clone, Default)]
pub struct Specification {
    /// Effects beyond the baseline.
    pub terms: Vec<Term>,
    /// By axis: variance of the baseline's ramp terms about zero, over the whitened noise's; `None`: unbounded.
    pub ramp_prior: [Option<[f64; TERMS - TEMPERATURE_TERMS]>; AXES],
}

impl Specification {
    /// The same with those terms only that `keep` lets through.
    #[must_use]
    pub fn only(&self, keep: impl Fn(&Term) -> bool) -> Self {
        Self { terms: self.terms.iter().filter(|t| keep(t)).cloned().collect(), ..self.clone() }
    }

    /// The same without term `k`.
    #[must_use]
    pub fn without(&self, k: usize) -> Self {
        let mut fewer = self.clone();
        fewer.terms.remove(k);
        fewer
    }

    /// The same with what remembers the path of the temperature on another branch (its number in [`super::data::Starts::BRANCHES`]) at the begin of one
    /// run; what begins a run that nobody has seen stays.
    #[must_use]
    pub fn beginning(&self, run: usize, branch: usize) -> Self {
        let mut other = self.clone();
        for part in other.terms.iter_mut().flat_map(|t| &mut t.parts) {
            *part = part.starting(part.starts.with_seen(run, branch));
        }
        other
    }

    /// Range of the gains of term `e` among an axis' coefficients; `None` if the axis does not have it.
    #[must_use]
    pub fn gains(&self, e: usize, a: usize) -> Option<Range<usize>> {
        let width = |t: &Term| if t.on(a) { t.outputs() } else { 0 };
        let from = TERMS + self.terms[..e].iter().map(width).sum::<usize>();
        self.terms[e].on(a).then(|| from..from + width(&self.terms[e]))
    }

    /// Parts of the model whose sizes may differ from day to day, by the coefficients of an axis: temperature terms, ramp terms, effects.
    fn parts(&self, a: usize) -> Vec<Part> {
        let lasts = |e: &usize| self.terms[*e].parts.iter().all(|c| c.run.is_none());
        let effects = (0..self.terms.len())
            .filter(lasts)
            .filter_map(|e| Some((self.terms[e].lead().facts.name, self.gains(e, a)?)));
        let baseline = [("temperature terms", 1..TEMPERATURE_TERMS), ("ramp terms", TEMPERATURE_TERMS..TERMS)];
        baseline.into_iter().chain(effects).collect()
    }

    /// The columns of an axis, on the blocks that have data.
    #[must_use]
    pub fn columns(&self, data: &Data<'_>, a: usize) -> Columns {
        let base = &data.axes[a].base;
        let mut values = base[..TERMS].to_vec();
        let mut names: Vec<&'static str> = fit::NAMES.to_vec();
        let mut prior = vec![None; TEMPERATURE_TERMS];
        match self.ramp_prior[a] {
            Some(variances) => prior.extend(variances.map(Some)),
            None => prior.resize(TERMS, None),
        }
        for t in self.terms.iter().filter(|t| t.on(a)) {
            values.extend(t.parts.iter().flat_map(|c| {
                let none = || vec![vec![0.0; base[0].len()]; c.facts.outputs];
                data.columns(c, a, true).unwrap_or_else(none)
            }));
            names.extend(std::iter::repeat_n(t.lead().facts.name, t.outputs()));
            prior.extend(t.prior[a].iter().map(|v| Some(*v)));
        }
        // Constants that belong to a day and not to the unit.
        values.extend(base[TERMS..].iter().cloned());
        names.extend(std::iter::repeat_n("the day", base.len() - TERMS));
        prior.resize(values.len(), None);
        Columns { values, names, prior }
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
    /// Contribution of the days to the sizes of the model's parts, with several train runs.
    pub of_days: OfDays,
    /// The fit under each noise model; `None` of a plain fit, and of an axis without data.
    pub posterior: Option<Posterior>,
}

impl AxisFit {
    /// Of an axis without data.
    pub(crate) fn absent(count: usize) -> Self {
        let zeros = vec![0.0; count];
        let covariance = DMatrix::zeros(count, count);
        Self {
            coefficients: zeros.clone(),
            std: zeros,
            days: vec![],
            covariance,
            of_days: OfDays::default(),
            posterior: None,
        }
    }

    /// From coefficients with the constants of the days behind them, and the covariance of both.
    pub(crate) fn new(
        mut coefficients: Vec<f64>,
        covariance: DMatrix<f64>,
        days: usize,
        posterior: Option<Posterior>,
    ) -> Self {
        let std = (0..coefficients.len() - days).map(|j| covariance[(j, j)].max(0.0).sqrt()).collect();
        let days = coefficients.split_off(coefficients.len() - days);
        Self { coefficients, std, days, covariance, of_days: OfDays::default(), posterior }
    }
}

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fitted {
    /// Its effects and variances.
    pub model: Specification,
    /// The axes.
    pub axes: [AxisFit; AXES],
    /// Set if the judged run continues the train run ([`Data::goes_on`]).
    goes_on: bool,
    /// Quantities beside the frequencies that the runs have.
    inputs: Vec<Input>,
}

/// Parts of a bias on a run that the coefficients of an axis move.
pub struct Moves {
    /// Of each coefficient: its column, by step.
    columns: Vec<Vec<f64>>,
    /// Of the coefficients.
    covariance: DMatrix<f64>,
    /// Seconds of a mean.
    mean_s: usize,
}

impl Moves {
    /// Variance that the uncertainty of the coefficients adds to the means of some steps: about their mean, and of their mean.
    pub fn predicted_variance(&self, of_steps: impl Fn(usize) -> bool) -> (f64, f64) {
        let means = |column: &Vec<f64>| {
            let kept = column.iter().enumerate().map(|(k, v)| if of_steps(k) { *v } else { f64::NAN });
            block_means(&kept.collect::<Vec<_>>(), self.mean_s)
        };
        let columns: Vec<Vec<f64>> = self.columns.iter().map(means).collect();
        let rows: Vec<DVector<f64>> = (0..columns[0].len())
            .map(|k| {
                DVector::from_iterator(columns.len(), columns.iter().map(|c| c.get(k).copied().unwrap_or(f64::NAN)))
            })
            .filter(|r| r.iter().all(|v| v.is_finite()))
            .collect();
        if rows.is_empty() {
            return (0.0, 0.0);
        }
        let variance = |x: &DVector<f64>| (x.transpose() * &self.covariance * x)[(0, 0)];
        let mean = rows.iter().sum::<DVector<f64>>() / rows.len() as f64;
        let about = rows.iter().map(|r| variance(&(r - &mean))).sum::<f64>() / rows.len() as f64;
        (about, variance(&mean))
    }
}

impl Fitted {
    /// Generalised least squares on exact columns, over all noise models. An effect confined to one run is zero in the others.
    ///
    /// # Errors
    /// Data that cannot hold the coefficients down.
    pub fn new(data: &Data<'_>, model: &Specification) -> Result<Self, BadInput> {
        Self::by(data, model, |a, columns, days| {
            let rows = &data.axes[a];
            // (Least squares name the columns that the data cannot tell apart.)
            let Some(alone) = posterior(rows, &columns.values, &columns.prior) else {
                lsq::fit_shrunk(&columns.values, &rows.y, &columns.prior, &columns.names)?;
                return Err(BadInput::new("the equations are singular; record a longer run"));
            };
            let of_days = OfDays::new(rows, &columns.values, &columns.prior, model.parts(a), &alone);
            let found = if of_days.there() {
                of_days.posterior(rows, &columns.values, &columns.prior).unwrap_or(alone)
            } else {
                alone
            };
            let coefficients = found.coefficients.iter().copied().collect();
            Ok(AxisFit { of_days, ..AxisFit::new(coefficients, found.covariance.clone(), days, Some(found)) })
        })
    }

    /// The baseline by plain least squares, as `hrg fit` gives it.
    ///
    /// # Errors
    /// Data that cannot hold the coefficients down.
    pub fn plain(data: &Data<'_>) -> Result<Self, BadInput> {
        Self::by(data, &Specification::default(), |a, columns, days| {
            let fit = lsq::fit_shrunk(&columns.values, &data.axes[a].y, &columns.prior, &columns.names)?;
            Ok(AxisFit::new(fit.coefficients, fit.covariance, days, None))
        })
    }

    /// By any fit of an axis: it is given the axis, its columns and the number of days behind them.
    pub(crate) fn by(
        data: &Data<'_>,
        model: &Specification,
        fit: impl Fn(usize, Columns, usize) -> Result<AxisFit, BadInput>,
    ) -> Result<Self, BadInput> {
        let one = |a: usize| -> Result<AxisFit, BadInput> {
            if data.runs.iter().all(|r| r.steps.absent[a]) {
                let count = TERMS + model.terms.iter().filter(|t| t.on(a)).map(Term::outputs).sum::<usize>();
                return Ok(AxisFit::absent(count));
            }
            let days = data.axes[a].base.len() - TERMS;
            fit(a, model.columns(data, a), days).map_err(|e| BadInput::new(format!("axis {}: {e}", AXIS_NAMES[a])))
        };
        Ok(Self {
            model: model.clone(),
            axes: [one(0)?, one(1)?, one(2)?],
            goes_on: data.goes_on,
            inputs: data.table(),
        })
    }

    /// The same with another state of what remembers the path of the temperature at the begin of a run that nobody has seen: the number of
    /// a branch in [`super::data::Starts::BRANCHES`].
    #[must_use]
    pub fn starting(&self, branch: usize) -> Self {
        let mut other = self.clone();
        for part in other.model.terms.iter_mut().flat_map(|t| &mut t.parts) {
            *part = part.starting(part.starts.with_unseen(branch));
        }
        other
    }

    /// `true` if the judged run continues the train run.
    #[must_use]
    pub fn goes_on(&self) -> bool {
        self.goes_on
    }

    /// Effects beyond the baseline.
    #[must_use]
    pub fn terms(&self) -> &[Term] {
        &self.model.terms
    }

    /// Range of the gains of term `e` among an axis' coefficients; `None` if the axis does not have it.
    #[must_use]
    pub fn gains(&self, e: usize, a: usize) -> Option<Range<usize>> {
        self.model.gains(e, a)
    }

    /// Places, among an axis' coefficients, of the gains of steps that last. A step of the train run ends with that run; where the log
    /// goes on without a break, the unit keeps it.
    #[must_use]
    pub fn lasting(&self, a: usize) -> Vec<usize> {
        let step = |t: &Term| match t.lead().facts.effect {
            EffectId::Step => Some(0),
            EffectId::Shock => Some(1),
            _ => None,
        };
        let steps = self.terms().iter().enumerate().filter_map(|(e, t)| Some((e, step(t).filter(|_| self.goes_on)?)));
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
        for (e, t) in self.terms().iter().enumerate().filter(|(_, t)| which(t.lead())) {
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

    /// Numbers of the gains on an axis of the effects that `which` does not let through.
    pub fn without<'s>(&'s self, a: usize, which: &'s dyn Fn(&Candidate) -> bool) -> impl Iterator<Item = usize> + 's {
        let left_out = self.terms().iter().enumerate().filter(move |(_, t)| !which(t.lead()));
        left_out.filter_map(move |(e, _)| self.gains(e, a)).flatten()
    }

    /// Rates of the blocks less the bias, by axis: those of `data`, be they the rows of the fit or those of another run.
    pub fn left(&self, data: &Data<'_>, which: &dyn Fn(&Candidate) -> bool) -> [Vec<f64>; AXES] {
        [0, 1, 2].map(|a: usize| {
            let rows = &data.axes[a];
            let columns = self.model.columns(data, a).values;
            let fit = &self.axes[a];
            let mut gains: Vec<f64> = fit.coefficients.iter().chain(&fit.days).copied().collect();
            self.without(a, which).for_each(|at| gains[at] = 0.0);
            let mut left = rows.y.clone();
            for (column, g) in columns.iter().zip(gains) {
                left.iter_mut().zip(column).for_each(|(l, x)| *l -= g * x);
            }
            left
        })
    }

    /// Parts of the bias on a run that the coefficients of an axis move; of the effects, those that `which` takes.
    pub fn moves(&self, run: &Run, scaling: &Scaling, a: usize, which: &dyn Fn(&Candidate) -> bool) -> Moves {
        let mut columns: Vec<(usize, Vec<f64>)> = baseline_columns(run, scaling, a).into_iter().enumerate().collect();
        columns.extend(self.lasting(a).into_iter().map(|at| (at, vec![1.0; run.steps.len()])));
        for (e, t) in self.terms().iter().enumerate().filter(|(_, t)| which(t.lead())) {
            let Some(range) = self.gains(e, a) else { continue };
            columns.extend(range.zip(t.on_run(run, None, scaling, a)));
        }
        let p = columns.len();
        let covariance = DMatrix::from_fn(p, p, |i, j| self.axes[a].covariance[(columns[i].0, columns[j].0)]);
        Moves { columns: columns.into_iter().map(|(_, c)| c).collect(), covariance, mean_s: run.steps.mean_s }
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
        for (e, t) in self.terms().iter().enumerate().filter(|(_, t)| t.lead().on_unit()) {
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
        notes.extend(fit::take_inputs(&mut c, &self.inputs));
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

/// Takes out effects that no axis has.
pub fn drop_idle_effects(image: &mut Calibration) {
    image.effects.retain(|t| t.gains.iter().flatten().any(|g| *g != 0.0));
    drop_idle_inputs(image);
}

/// Takes out inputs that no effect reads.
fn drop_idle_inputs(image: &mut Calibration) {
    let needed = inputs::needed(image);
    image.inputs.retain(|i| needed.contains(QuantitySet::one(i.quantity)));
}
