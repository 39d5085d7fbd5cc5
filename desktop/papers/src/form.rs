//! Models that are linear in their coefficients: their regressors by the unit's own code, and their data.

use crate::method::{Degree, Method, Model};
use crate::stages::{self, Stage};
use hrg_core::bias::four_parameter::{self, FourParameter};
use hrg_core::bias::{self, direct, regressors, Coefficients, Scaling, State, TERMS};
use hrg_core::calibration::{Calibration, EffectTerm};
use hrg_core::effects::parameters::{Channel, Hidden, Parameters, TemperatureRange};
use hrg_core::effects::{EffectId, MAX_PARAMETERS};
use hrg_core::inputs;
use hrg_data::error::BadInput;
use hrg_data::numeric::lsq;
use hrg_data::numeric::stats::{block_means, mean, quantile};
use hrg_data::recording::steps::Run;

/// Effect beside the baseline.
#[derive(Debug, Clone, Copy)]
struct Term {
    effect: EffectId,
    parameters: [f32; MAX_PARAMETERS],
    /// The first regressor that is used, and their number.
    first: usize,
    outputs: usize,
}

/// Curves of temperature in an image: Chebyshev polynomials of degree 3 to 10, and the points of a table.
const SHAPE: EffectId = EffectId::TemperatureShape;
const POINTS: EffectId = EffectId::TemperatureSpline;

/// A model that is linear in its coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    Baseline,
    TwoSets,
    TwoSetsHeld,
    /// Of a degree.
    Polynomial(u8),
    /// Of a degree.
    Direct(u8),
    Table,
    Inputs,
    Damping,
    /// With the seed of the layer on the drive and of that on the quadrature voltage.
    InputNetwork([u16; 2]),
    Four {
        breakpoint_c: f32,
        origin_c: f32,
    },
}

impl Form {
    /// Of a method; `None` where its model is not linear, or a breakpoint or a degree is searched too.
    pub(super) fn of(method: Method, degree: Option<Degree>) -> Option<Self> {
        match method.parts().model {
            Model::OneSet => Some(Self::Baseline),
            Model::CoolingHeating => Some(Self::TwoSets),
            Model::CoolingHeatingHeld => Some(Self::TwoSetsHeld),
            Model::Polynomial(own) | Model::Frequency(own) => match degree.unwrap_or(own) {
                Degree::Of(n) => Some(Self::of_degree(method, n)),
                Degree::HeldOut => None,
            },
            Model::Table => Some(Self::Table),
            Model::Inputs => Some(Self::Inputs),
            Model::Damping => Some(Self::Damping),
            Model::FourParameters | Model::FourParametersLiteral | Model::Network | Model::InputNetwork => None,
        }
    }

    /// Of a method whose degree may be chosen.
    pub(super) fn of_degree(method: Method, degree: u8) -> Self {
        match method.parts().model {
            Model::Frequency(_) => Self::Direct(degree),
            _ => Self::Polynomial(degree),
        }
    }

    const POLYNOMIAL: [&'static str; 11] =
        ["1", "T", "T^2", "T^3", "degree 4", "degree 5", "degree 6", "degree 7", "degree 8", "degree 9", "degree 10"];
    const DIRECT: [&'static str; direct::TERMS] = ["1", "f", "f^2", "f^3", "df/dt", "(df/dt)^2", "f df/dt"];
    const TABLE: [&'static str; 14] = [
        "point 1", "point 2", "point 3", "point 4", "point 5", "point 6", "point 7", "point 8", "point 9", "point 10",
        "point 11", "point 12", "point 13", "point 14",
    ];
    const FOUR: [&'static str; four_parameter::TERMS] = ["1", "dT when cooling", "dT when heating", "T low", "T high"];

    const OF_INPUTS: [&'static str; 12] = [
        "drive",
        "drive^2",
        "drive T",
        "drive 300 s",
        "drive 1500 s",
        "drive 6000 s",
        "quad",
        "quad^2",
        "quad T",
        "quad 300 s",
        "quad 1500 s",
        "quad 6000 s",
    ];

    const OF_NETWORK: [&'static str; 12] = [
        "drive, neuron 1",
        "drive, neuron 2",
        "drive, neuron 3",
        "drive, neuron 4",
        "drive, neuron 5",
        "drive, neuron 6",
        "quad, neuron 1",
        "quad, neuron 2",
        "quad, neuron 3",
        "quad, neuron 4",
        "quad, neuron 5",
        "quad, neuron 6",
    ];

    pub(super) fn names(self) -> Vec<&'static str> {
        match self {
            Self::Baseline => hrg_identify::fit::NAMES.to_vec(),
            Self::TwoSets | Self::TwoSetsHeld => {
                hrg_identify::fit::NAMES.iter().chain(&hrg_identify::fit::NAMES).copied().collect()
            }
            Self::Polynomial(n) => Self::POLYNOMIAL[..=usize::from(n)].to_vec(),
            Self::Direct(n) => {
                let own = direct_used(n).map(|k| Self::DIRECT[k]);
                own.chain(Self::POLYNOMIAL.into_iter().take(usize::from(n) + 1).skip(4)).collect()
            }
            Self::Table => Self::TABLE.to_vec(),
            Self::Inputs => hrg_identify::fit::NAMES.iter().chain(&Self::OF_INPUTS).copied().collect(),
            Self::Damping => vec!["1", Self::OF_INPUTS[0]],
            Self::InputNetwork(_) => hrg_identify::fit::NAMES.iter().chain(&Self::OF_NETWORK).copied().collect(),
            Self::Four { .. } => Self::FOUR.to_vec(),
        }
    }

    /// Sets the start of a held set to the first stage of the first run.
    pub(super) fn begin(self, c: &mut Calibration, runs: &[Run], scaling: &Scaling, a: usize) {
        let first = runs.first().and_then(|run| *self.stages(run, scaling, a).first()?);
        if let (Self::TwoSetsHeld, Some(stage)) = (self, first) {
            effect(c, EffectId::CoolingHeatingHeld, [0.0; MAX_PARAMETERS]).start = stages::start_of(stage);
        }
    }

    /// The stage of each step of a run, where the form has a set for each.
    fn stages(self, run: &Run, scaling: &Scaling, a: usize) -> Vec<Option<Stage>> {
        match self {
            Self::TwoSetsHeld => stages::of_run(run, scaling, a),
            _ => vec![None; run.steps.len()],
        }
    }

    /// The regressors of one step, by the unit's own code; a set of a stage has none in a step of the other stage.
    pub(super) fn row(self, scaling: &Scaling, s: &State, stage: Option<Stage>, out: &mut [f64]) {
        let (t, r) = (s.temperature_c, s.ramp_c_per_min);
        if self == Self::TwoSetsHeld {
            out.fill(if stage.is_none() { f64::NAN } else { 0.0 });
            let from = if stage == Some(Stage::Heating) { TERMS } else { 0 };
            let own = out.iter_mut().skip(from).zip(regressors(scaling, t, r));
            own.filter(|_| stage.is_some()).for_each(|(o, x)| *o = f64::from(x));
            return;
        }
        let mut fill = |values: &[f32]| out.iter_mut().zip(values).for_each(|(o, v)| *o = f64::from(*v));
        match self {
            // (What inputs add comes from their own states: `beside`.)
            Self::Baseline | Self::TwoSetsHeld | Self::Inputs | Self::InputNetwork(_) => {
                fill(&regressors(scaling, t, r));
            }
            Self::Damping => fill(&[1.0]),
            Self::TwoSets => {
                let (x, w) = (regressors(scaling, t, r), bias::heating_weight(scaling, r));
                let both: [f32; 2 * TERMS] =
                    std::array::from_fn(|j| if j < TERMS { (1.0 - w) * x[j] } else { w * x[j - TERMS] });
                fill(&both);
            }
            // (Beyond a cubic the Chebyshev polynomials of degree 3 and up stand beside it.)
            Self::Polynomial(_) => {
                let x = regressors(scaling, t, r);
                fill(&[x[0], x[1], x[2], scaling.cube(t)]);
            }
            Self::Direct(n) => {
                let all = direct::regressors(s.frequency_u, s.frequency_u_per_min, scaling.w_linear());
                out.iter_mut().zip(direct_used(n)).for_each(|(o, k)| *o = f64::from(all[k]));
            }
            Self::Table => {}
            Self::Four { breakpoint_c, origin_c } => {
                fill(&four_parameter::regressors(breakpoint_c, origin_c, t, s.difference_c_per_min));
            }
        }
    }

    /// The regressors of each step that need more than its state: they stand behind those of [`row`](Self::row).
    fn beside(self, run: &Run, scaling: &Scaling, a: usize) -> Vec<Vec<f64>> {
        let mut rows = vec![Vec::new(); run.steps.len()];
        for term in self.terms(scaling, a) {
            let of = run.effect(term.effect.facts().id, &term.parameters, 0.0, scaling, a);
            for (row, values) in rows.iter_mut().zip(&of) {
                row.extend(values.iter().skip(term.first).take(term.outputs).map(|v| f64::from(*v)));
            }
        }
        rows
    }

    /// Effects on an axis that it has beside the baseline.
    fn terms(self, scaling: &Scaling, a: usize) -> Vec<Term> {
        let first = 0;
        let quantity = |number: u8, outputs| {
            let parameters = Channel { channel: number.into() }.row();
            Term { effect: EffectId::RecordedQuantity, parameters, first, outputs }
        };
        let (low_c, high_c) = (scaling.t_ref_c - scaling.t_scale_c, scaling.t_ref_c + scaling.t_scale_c);
        let curve = |effect, first, outputs| Term {
            effect,
            parameters: TemperatureRange { low_c, high_c }.row(),
            first,
            outputs,
        };
        let layer = |number: u8, seed: u16| {
            let parameters = Hidden { channel: number.into(), seed: seed.into() }.row();
            Term { effect: EffectId::InputNetwork, parameters, first, outputs: EffectId::InputNetwork.facts().outputs }
        };
        let both = [inputs::drive(a), inputs::quad(a)];
        match self {
            Self::Inputs => both.map(|n| quantity(n, EffectId::RecordedQuantity.facts().outputs)).to_vec(),
            Self::Damping => vec![quantity(inputs::drive(a), 1)],
            Self::Polynomial(n @ 4..) => vec![curve(SHAPE, 0, usize::from(n) - 2)],
            // (Degree 3 is that of the frequency itself.)
            Self::Direct(n @ 4..) => vec![curve(SHAPE, 1, usize::from(n) - 3)],
            Self::Table => vec![curve(POINTS, 0, POINTS.facts().outputs)],
            Self::InputNetwork(seeds) => both.into_iter().zip(seeds).map(|(n, seed)| layer(n, seed)).collect(),
            _ => Vec::new(),
        }
    }

    /// Puts the coefficients of its effects, which are the last ones, into a calibration; gives the number of those before.
    fn put_terms(self, c: &mut Calibration, a: usize, k: &[f64], std: &[f64]) -> usize {
        let terms = self.terms(&c.scaling, a);
        let baseline = k.len() - terms.iter().map(|t| t.outputs).sum::<usize>();
        let mut from = baseline;
        for t in terms {
            let term = effect(c, t.effect, t.parameters);
            for (j, at) in (from..from + t.outputs).enumerate() {
                term.gains[a][t.first + j] = k[at] as f32;
                term.gain_std[a][t.first + j] = std.get(at).map_or(0.0, |s| *s as f32);
            }
            from += t.outputs;
        }
        baseline
    }

    /// Puts coefficients into a calibration.
    pub(super) fn store(self, c: &mut Calibration, a: usize, k: &[f64], std: &[f64]) {
        fn take<const N: usize>(k: &[f64], at: usize) -> [f32; N] {
            std::array::from_fn(|j| k.get(at + j).map_or(0.0, |x| *x as f32))
        }
        c.axes[a].bias_std_dph = [take(std, 0), take(std, TERMS)];
        c.axes[a].coefficients = match self {
            Self::Baseline => Coefficients::One(take(k, 0)),
            Self::TwoSets => Coefficients::CoolingHeating(take(k, 0), take(k, TERMS)),
            Self::TwoSetsHeld => {
                // The mean of both sets, and the effect that adds half their difference one way or the other.
                let of = |from: &[f64], j: usize| from.get(j).copied().unwrap_or(0.0);
                for j in 0..TERMS {
                    let std = of(std, j).hypot(of(std, TERMS + j));
                    let term = effect(c, EffectId::CoolingHeatingHeld, [0.0; MAX_PARAMETERS]);
                    term.gains[a][j] = (of(k, TERMS + j) - of(k, j)) as f32;
                    term.gain_std[a][j] = std as f32;
                    c.axes[a].bias_std_dph[0][j] = (0.5 * std) as f32;
                }
                c.axes[a].bias_std_dph[1] = [0.0; TERMS];
                Coefficients::One(std::array::from_fn(|j| (0.5 * (of(k, j) + of(k, TERMS + j))) as f32))
            }
            Self::Polynomial(3) => {
                let std3 = std.get(3).map_or(0.0, |x| *x as f32);
                c.axes[a].bias_std_dph[0][3] = 0.0;
                let term = effect(c, EffectId::Cubic, [0.0; MAX_PARAMETERS]);
                (term.gains[a][0], term.gain_std[a][0]) = (k[3] as f32, std3);
                Coefficients::One([k[0] as f32, k[1] as f32, k[2] as f32, 0.0, 0.0, 0.0])
            }
            Self::Direct(n) => {
                let mut all = [0.0; direct::TERMS];
                direct_used(n).zip(k).for_each(|(to, k)| all[to] = *k as f32);
                self.put_terms(c, a, k, std);
                Coefficients::Direct(all)
            }
            Self::Polynomial(_) | Self::Table | Self::Inputs | Self::Damping | Self::InputNetwork(_) => {
                let baseline = self.put_terms(c, a, k, std);
                let own = |from: &[f64]| take::<TERMS>(&from[..baseline.min(from.len())], 0);
                c.axes[a].bias_std_dph = [own(std), [0.0; TERMS]];
                Coefficients::One(own(k))
            }
            Self::Four { breakpoint_c, origin_c } => Coefficients::FourParameter(FourParameter {
                constant_cooling_heating_low_high: take(k, 0),
                breakpoint_c,
                origin_c,
            }),
        };
    }
}

/// The effect of a method's image with these parameters, which is put in with its first axis.
fn effect(c: &mut Calibration, id: EffectId, parameters: [f32; MAX_PARAMETERS]) -> &mut EffectTerm {
    let there = c.effects.iter().position(|e| e.id == id.facts().id && e.parameters == parameters);
    let at = there.unwrap_or_else(|| {
        let _ = c.effects.push(EffectTerm::new(id.facts().id, parameters));
        c.effects.len() - 1
    });
    &mut c.effects[at]
}

/// Regressors of [`direct`] that a curve of some degree has: powers up to it, and those of the rate.
fn direct_used(degree: u8) -> impl Iterator<Item = usize> {
    (0..=usize::from(degree.min(3))).chain(4..direct::TERMS)
}

/// Columns and rates of one axis over all runs, run after run.
pub(super) struct Data {
    pub(super) columns: Vec<Vec<f64>>,
    pub(super) y: Vec<f64>,
    pub(super) lengths: Vec<usize>,
    pub(super) names: Vec<&'static str>,
}

impl Data {
    pub(super) fn new(runs: &[Run], scaling: &Scaling, a: usize, form: Form) -> Self {
        let names = form.names();
        let total = runs.iter().map(|r| r.steps.len()).sum();
        let mut columns = vec![Vec::new(); names.len()];
        let mut y = Vec::with_capacity(total);
        let mut row = vec![0.0; names.len()];
        for run in runs {
            let beside = form.beside(run, scaling, a);
            for (k, stage) in form.stages(run, scaling, a).into_iter().enumerate() {
                match run.bias_state(k, a) {
                    Some(s) => form.row(scaling, s, stage, &mut row),
                    None => row.fill(f64::NAN),
                }
                put_behind(&mut row, &beside[k]);
                columns.iter_mut().zip(&row).for_each(|(c, v)| c.push(*v));
            }
            y.extend_from_slice(&run.steps.rate_dph[a]);
        }
        Self { columns, y, lengths: runs.iter().map(|r| r.steps.len()).collect(), names }
    }

    /// Means over windows that do not cross from one run into the next; rows with anything missing are left out.
    pub(super) fn means(&self, length: usize) -> Self {
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

    /// The data of one of two sets, whose columns are zero in the rows of the other.
    pub(super) fn of_set(&self, stage: Stage) -> Self {
        let from = if stage == Stage::Heating { TERMS } else { 0 };
        let own = &self.columns[from..from + TERMS];
        // (The first regressor of a set is one in its rows.)
        let rows: Vec<usize> = (0..self.y.len()).filter(|&k| own[0][k] == 1.0).collect();
        let take = |v: &[f64]| rows.iter().map(|&k| v[k]).collect::<Vec<_>>();
        Self {
            columns: own.iter().map(|c| take(c)).collect(),
            y: take(&self.y),
            lengths: vec![rows.len()],
            names: self.names[from..from + TERMS].to_vec(),
        }
    }

    pub(super) fn residuals(&self, k: &[f64]) -> Vec<f64> {
        (0..self.y.len()).map(|i| self.y[i] - self.columns.iter().zip(k).map(|(c, k)| c[i] * k).sum::<f64>()).collect()
    }

    pub(super) fn fit(&self, weights: Option<&[f64]>) -> Result<lsq::Fit, BadInput> {
        lsq::fit(&self.columns, &self.y, weights, &self.names)
    }

    /// Adds the constant that brings the mean of the residuals to zero (the middle of their range would leave the mean of
    /// a run off zero), and gives all coefficients.
    pub(super) fn with_constant(&self, rest: &[f64]) -> Vec<f64> {
        let mut k = vec![0.0];
        k.extend_from_slice(rest);
        k[0] = mean(&self.residuals(&k));
        k
    }
}

/// Least squares of a form over all steps of the runs, without columns of them.
pub(super) fn fit_directly(
    runs: &[Run],
    scaling: &Scaling,
    a: usize,
    form: Form,
    weights: Option<&[f64]>,
) -> Result<lsq::Fit, BadInput> {
    let names = form.names();
    let stages: Vec<_> = runs.iter().map(|run| form.stages(run, scaling, a)).collect();
    let beside: Vec<_> = runs.iter().map(|run| form.beside(run, scaling, a)).collect();
    let mut steps = runs.iter().zip(stages.iter().zip(&beside)).flat_map(|(run, (stages, beside))| {
        stages.iter().zip(beside).enumerate().map(move |(k, (stage, beside))| (run, k, *stage, beside))
    });
    lsq::fit_rows(runs.iter().map(|r| r.steps.len()).sum(), names.len(), &names, |k, row| {
        let weight = weights.map_or(1.0, |w| w[k]);
        let Some((run, step, stage, beside)) = steps.next() else { return false };
        let Some(state) = run.bias_state(step, a) else { return false };
        if form == Form::TwoSetsHeld && stage.is_none() {
            return false;
        }
        form.row(scaling, state, stage, row);
        put_behind(&mut row[..names.len()], beside);
        row[names.len()] = run.steps.rate_dph[a][step];
        row.iter_mut().for_each(|v| *v *= weight.sqrt());
        weight > 0.0
    })
}

/// Puts values at the end of a row.
fn put_behind(row: &mut [f64], values: &[f64]) {
    let from = row.len() - values.len();
    row[from..].copy_from_slice(values);
}

pub(super) fn range(v: &[f64]) -> f64 {
    quantile(v, 1.0) - quantile(v, 0.0)
}

/// Weights that make every two degrees of temperature count alike, whatever time was spent there.
pub(super) fn uniform_weights(runs: &[Run], a: usize) -> Vec<f64> {
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
