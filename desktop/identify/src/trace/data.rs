//! Data of the search: block means of rates and regressors, and the library of candidate columns.

use super::model::TEMPERATURE_TERMS;
use super::noise::{Filters, Growth};
use crate::fit::baseline_columns;
use hrg_core::bias::{Scaling, TERMS};
use hrg_core::effects::parameters::Thresholds;
use hrg_core::effects::{self, EffectId, Facts, Inputs, Running, MAX_OUTPUTS};
use hrg_core::inputs::{Input, Quantities, QuantitySet, QUANTITIES};
use hrg_core::thermal::Thermal;
use hrg_core::{AXES, MODEL_STEP_S};
use hrg_data::cards;
use hrg_data::cards::{Extent, ParameterRow};
use hrg_data::recording::steps::{unit_inputs, Run, BRIDGE_S};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// A candidate: an effect with its inner parameters, perhaps confined to one of several runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Facts about the effect.
    pub facts: &'static Facts,
    /// Inner parameters.
    pub parameters: ParameterRow,
    /// The run it happens in; `None`: all.
    pub run: Option<usize>,
    /// State at the begin of each run, for an effect that remembers the path of the temperature.
    pub starts: Starts,
    /// Quantities that it needs and the unit does not have.
    pub lacks: QuantitySet,
}

/// State of an effect that remembers the path of the temperature at the begin of each run ([`hrg_core::effects::Effect::start_on`]): on
/// either branch, or in the middle. It belongs to the run and not to the unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Starts {
    /// Two bits for each of the first runs: 0 the middle, 1 and 2 the branches.
    codes: u64,
    runs: u8,
    unseen: u8,
}

impl Starts {
    /// The branches there are.
    pub const BRANCHES: [f32; 3] = [0.0, 1.0, -1.0];

    /// The same in so many runs.
    pub fn all(runs: usize, branch: usize) -> Self {
        let runs = runs.min(32);
        let codes = (0..runs).fold(0, |codes, k| codes | (branch as u64) << (2 * k));
        Self { codes, runs: runs as u8, unseen: branch as u8 }
    }

    /// With another branch (its number in [`Self::BRANCHES`]) in one run. A run that is not among the train runs has what they have in
    /// common.
    pub fn with(self, run: usize, branch: usize) -> Self {
        if run >= usize::from(self.runs) {
            return self;
        }
        let codes = self.codes & !(3 << (2 * run)) | (branch as u64) << (2 * run);
        let first = (codes & 3) as usize;
        let common = Self::all(usize::from(self.runs), first).codes == codes;
        Self { codes, unseen: if common { first as u8 } else { 0 }, ..self }
    }

    /// With another branch in one run; what a run begins with that is not among the train runs stays.
    pub fn with_seen(self, run: usize, branch: usize) -> Self {
        Self { unseen: self.unseen, ..self.with(run, branch) }
    }

    /// With another branch in a run that is not among the train runs.
    pub fn with_unseen(self, branch: usize) -> Self {
        Self { unseen: branch as u8, ..self }
    }

    /// State at the begin of a train run; `None`: of any other run.
    pub fn of(self, run: Option<usize>) -> f32 {
        let code = run.map_or(u64::from(self.unseen), |r| if r < 32 { self.codes >> (2 * r) & 3 } else { 0 });
        Self::BRANCHES[code as usize % 3]
    }

    /// State that the train runs have in common; else the middle.
    pub fn common(self) -> f32 {
        self.with(0, (self.codes & 3) as usize).of(None)
    }

    /// Start state of a unit: the one that all runs have in common, the verify run included; else the middle.
    pub fn on_unit(&self) -> f32 {
        if self.of(None) == self.common() {
            self.common()
        } else {
            0.0
        }
    }
}

impl Candidate {
    /// A candidate that is there in every run.
    pub fn new(effect: EffectId, parameters: ParameterRow) -> Self {
        let alone = QuantitySet::empty();
        let c = Self { facts: effect.facts(), parameters, run: None, starts: Starts::default(), lacks: alone };
        c.on_unit_with(alone)
    }

    /// The same, in a unit that has these quantities beside the frequencies.
    pub fn on_unit_with(self, unit: QuantitySet) -> Self {
        Self { lacks: self.reads().difference(unit), ..self }
    }

    /// The quantities that it reads beside the frequencies.
    pub fn reads(&self) -> QuantitySet {
        (0..AXES).map(|a| effects::reads(self.facts.id, &self.parameters, a)).collect()
    }

    /// The same, standing there when the runs begin, if it remembers the path of the temperature.
    pub fn starting(self, starts: Starts) -> Self {
        if self.facts.remembers_path {
            Self { starts, ..self }
        } else {
            self
        }
    }

    /// `true` if an image can hold it: a unit can compute it, and it does not belong to one run.
    pub fn on_unit(&self) -> bool {
        self.facts.reach.on_unit() && self.lacks.is_empty() && self.run.is_none()
    }
}

/// The columns of a candidate, axis after axis: what is common to axes with the same rows is computed once.
pub struct AxisByAxis<'c> {
    candidate: &'c Candidate,
    /// The axis they were made for last, and they.
    last: Option<(usize, Option<Vec<Vec<f64>>>)>,
}

impl<'c> AxisByAxis<'c> {
    /// Nothing computed yet.
    pub fn new(candidate: &'c Candidate) -> Self {
        Self { candidate, last: None }
    }

    /// The columns on an axis; `None` where the axis does not have what they need.
    pub fn on(&mut self, data: &Data<'_>, a: usize) -> Option<Vec<Vec<f64>>> {
        let same = |of: usize| self.candidate.facts.common && data.axes[a].keep == data.axes[of].keep;
        let columns = match self.last.take() {
            Some((of, columns)) if same(of) => columns,
            _ => data.columns(self.candidate, a, false),
        };
        self.last = Some((a, columns.clone()));
        columns
    }
}

/// Rows of one axis.
#[derive(Debug, Clone)]
pub struct AxisRows {
    /// Numbers of the blocks that have data.
    pub keep: Vec<usize>,
    /// First block of each run, as an index into `keep`.
    pub starts: Vec<usize>,
    /// Mean rate of each kept block, deg/h.
    pub y: Vec<f64>,
    /// Means of the baseline's regressors, then a column for each run after the first: see [`day_column`].
    pub base: Vec<Vec<f64>>,
    /// Whitening of the kept blocks.
    pub filters: Filters,
    /// Decays behind gaps in the temperature: the state of the unit is not known there.
    pub forgotten: Vec<Vec<f64>>,
    /// Columns of what happened in a run that judges and that nobody can predict: its size there is unknown, as its constant is.
    pub happened: Vec<Vec<f64>>,
}

impl AxisRows {
    /// Rows of a run.
    pub fn run(&self, number: usize) -> Range<usize> {
        self.starts[number]..self.starts.get(number + 1).copied().unwrap_or(self.y.len())
    }

    /// Decays in a run of so many blocks from a block on, of the time constants from `shortest` blocks to the whole run: whatever the state of the unit was
    /// there, this is left of it.
    fn decays(&self, number: usize, from: f64, blocks: usize, shortest: f64) -> Vec<Vec<f64>> {
        let run = self.run(number);
        let of = |tau: f64| -> Vec<f64> {
            let at = |k: usize| self.keep[k] as f64 + 0.5 - from;
            let decay = |k: usize| if run.contains(&k) && at(k) > 0.0 { (-at(k) / tau).exp() } else { 0.0 };
            (0..self.y.len()).map(decay).collect()
        };
        let slower = |tau: &f64| Some(tau * SLOWER).filter(|t| *t < blocks as f64);
        std::iter::successors(Some(shortest), slower).map(of).filter(|c| c.iter().any(|v| *v > 0.0)).collect()
    }

    /// A column in the rows of a run, and zero in those of the others.
    pub fn in_run(&self, number: usize, column: &[f64]) -> Vec<f64> {
        let (run, mut out) = (self.run(number), vec![0.0; column.len()]);
        out[run.clone()].copy_from_slice(&column[run]);
        out
    }
}

/// Columns at every model step that are kept: a model is fitted, judged and taken apart with the same ones.
const MOST_EXACT: usize = 256;

/// Columns of a candidate at every model step, one axis.
#[derive(Debug)]
struct Computed {
    candidate: Candidate,
    axis: usize,
    columns: Option<Vec<Vec<f64>>>,
}

/// The last columns at every model step. A copy of the data begins without.
#[derive(Debug, Default)]
struct Exact(Mutex<VecDeque<Computed>>);

impl Exact {
    fn lock(&self) -> MutexGuard<'_, VecDeque<Computed>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Clone for Exact {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// All rows.
#[derive(Debug, Clone)]
pub struct Data<'a> {
    /// The runs.
    pub runs: &'a [Run],
    /// Centre and scale.
    pub scaling: Scaling,
    /// Time constant by which the resonators follow their cases, s.
    pub lag_s: f32,
    /// Seconds in a block.
    pub block_s: usize,
    /// Seconds between the rows on which stateful effects are searched.
    pub coarse_s: usize,
    /// Blocks of each run.
    pub blocks: Vec<usize>,
    /// The axes.
    pub axes: [AxisRows; AXES],
    /// The thermal states every [`coarse_s`](Self::coarse_s) seconds, close together: the search goes through them thousands of times.
    coarse: Vec<Vec<Thermal>>,
    exact: Exact,
    /// Growth of the noise with temperature, by axis.
    pub growth: [Growth; AXES],
    /// Set if the judged run continues the only train run: a step in the train run then lasts.
    pub goes_on: bool,
    /// Set if the runs are none of those that a model was learnt from: what belongs to one of those is zero, and paths begin where a run that
    /// nobody has seen begins.
    unseen: bool,
    /// Set if the runs are of different units of one design, which are tested alike: a play begins in all of them at the same place.
    pub alike: bool,
}

/// Factor from a time constant of what a unit may remember to the next.
const SLOWER: f64 = 3.0;

/// Value of the column of day number `day` in a run: the constants of the days, measured from their mean.
pub fn day_column(day: usize, run: usize) -> f64 {
    match run {
        0 => -1.0,
        r if r == day + 1 => 1.0,
        _ => 0.0,
    }
}

impl<'a> Data<'a> {
    /// Cuts runs into blocks: about 600 in all, of 21 to 99 s.
    pub fn new(runs: &'a [Run], scaling: Scaling, lag_s: f64) -> Self {
        let total: usize = runs.iter().map(|r| r.steps.len()).sum();
        Self::cut(runs, scaling, lag_s as f32, Self::coarse_s(total))
    }

    /// Cuts runs into blocks of three times so many seconds.
    pub fn in_blocks(runs: &'a [Run], scaling: Scaling, lag_s: f64, coarse_s: usize) -> Self {
        Self::cut(runs, scaling, lag_s as f32, coarse_s)
    }

    /// Third of a block, s, for runs of so many seconds in all.
    #[must_use]
    pub fn coarse_s(total_s: usize) -> usize {
        (total_s / 1800).clamp(7, 33)
    }

    /// Runs of different units: each has a baseline of its own, of which nothing is known.
    pub fn of_units(runs: &'a [Run], scaling: Scaling, lag_s: f64) -> Self {
        let mut data = Self { alike: true, ..Self::new(runs, scaling, lag_s) };
        for rows in &mut data.axes {
            let whole = rows.base[..TERMS].to_vec();
            let of_run = |run: usize, column: usize| rows.in_run(run, &whole[column]);
            let free = TEMPERATURE_TERMS;
            let mut base: Vec<Vec<f64>> = (0..free).map(|j| of_run(0, j)).collect();
            // (Its place is that of the ramp terms that all runs share; those of each run span them.)
            base.extend(whole[free..].iter().cloned());
            for run in 0..runs.len() {
                base.extend((if run == 0 { free } else { 0 }..TERMS).map(|j| of_run(run, j)));
            }
            rows.base = base;
        }
        data
    }

    /// A run that judges, cut into the same blocks.
    #[must_use]
    pub fn unseen(&self, run: &'a Run) -> Self {
        let runs = std::slice::from_ref(run);
        let mut other = Self { unseen: true, ..Self::cut(runs, self.scaling, self.lag_s, self.coarse_s) };
        // Its day is none of those that a model knows.
        for (rows, known) in other.axes.iter_mut().zip(&self.axes) {
            rows.base.resize(known.base.len(), vec![0.0; rows.y.len()]);
        }
        other.with_growth(self.growth)
    }

    /// The same with noise that grows with temperature.
    #[must_use]
    pub fn with_growth(mut self, growth: [Growth; AXES]) -> Self {
        self.growth = growth;
        for a in (0..AXES).filter(|a| growth[*a].by != 0.0) {
            self.set_filters(a);
        }
        self
    }

    /// The same with a run of which it is not known how the unit came there: as if a gap ended where it begins.
    #[must_use]
    pub fn with_unknown_past(mut self, number: usize) -> Self {
        let (shortest, blocks) = (BRIDGE_S / self.block_s as f64, self.blocks[number]);
        for a in 0..AXES {
            let rows = &self.axes[a];
            let Some(first) = rows.keep[rows.run(number)].first() else { continue };
            let more = rows.decays(number, *first as f64, blocks, shortest);
            self.axes[a].forgotten.extend(more);
            self.set_filters(a);
        }
        self
    }

    fn set_filters(&mut self, a: usize) {
        let relative = self.relative(a);
        let rows = &mut self.axes[a];
        rows.filters = Filters::new(&relative, &rows.starts).beside(&rows.forgotten);
    }

    /// The same with effects whose sizes in that run are unknown.
    #[must_use]
    pub fn with_happened(mut self, happened: &[(Candidate, [bool; AXES])]) -> Self {
        for (c, on) in happened {
            for a in (0..AXES).filter(|a| on[*a]) {
                let columns = self.columns(c, a, true).unwrap_or_default();
                self.axes[a].happened.extend(columns);
            }
        }
        self
    }

    fn cut(runs: &'a [Run], scaling: Scaling, lag_s: f32, coarse_s: usize) -> Self {
        let block_s = 3 * coarse_s;
        let blocks: Vec<usize> = runs.iter().map(|r| r.steps.len() / block_s).collect();
        let axes = [0, 1, 2].map(|a| {
            let mut rows = AxisRows {
                keep: vec![],
                starts: vec![],
                y: vec![],
                base: vec![vec![]; TERMS],
                filters: Filters::default(),
                forgotten: vec![],
                happened: vec![],
            };
            // Each run has its own constant: the first one's is what the others' add up to, taken negative.
            rows.base.extend(vec![vec![]; runs.len().saturating_sub(1)]);
            let mut first = 0;
            for (number, (run, &n)) in runs.iter().zip(&blocks).enumerate() {
                rows.starts.push(rows.keep.len());
                let columns = baseline_columns(run, &scaling, a);
                for b in 0..n {
                    let range = b * block_s..(b + 1) * block_s;
                    let good: Vec<usize> =
                        range.filter(|&k| run.steps.rate_dph[a][k].is_finite() && columns[0][k].is_finite()).collect();
                    if 2 * good.len() < block_s {
                        continue;
                    }
                    let mean = |v: &[f64]| good.iter().map(|&k| v[k]).sum::<f64>() / good.len() as f64;
                    rows.keep.push(first + b);
                    rows.y.push(mean(&run.steps.rate_dph[a]));
                    let (baseline, days) = rows.base.split_at_mut(TERMS);
                    for (to, from) in baseline.iter_mut().zip(&columns) {
                        to.push(mean(from));
                    }
                    for (day, to) in days.iter_mut().enumerate() {
                        to.push(day_column(day, number));
                    }
                }
                first += n;
            }
            let mut first = 0;
            for (number, (run, n)) in runs.iter().zip(&blocks).enumerate() {
                for lost in run.steps.lost(a) {
                    let from = first as f64 + lost.end as f64 / block_s as f64;
                    let more = rows.decays(number, from, *n, BRIDGE_S / block_s as f64);
                    rows.forgotten.extend(more);
                }
                first += n;
            }
            rows.filters = Filters::new(&vec![1.0; rows.y.len()], &rows.starts).beside(&rows.forgotten);
            rows
        });
        let growth = [Growth::default(); AXES];
        let rows = |(run, n): (&Run, &usize)| (0..3 * n).map(|k| run.thermal[k * coarse_s + coarse_s / 2]).collect();
        let coarse = runs.iter().zip(&blocks).map(rows).collect();
        Self {
            runs,
            scaling,
            lag_s,
            block_s,
            coarse_s,
            blocks,
            axes,
            coarse,
            exact: Exact::default(),
            growth,
            goes_on: false,
            unseen: false,
            alike: false,
        }
    }

    /// Columns of a candidate for one axis, by regressor, on the kept blocks. `None` where it needs what was not
    /// recorded. `exact`: at every model step; else on the coarse rows, which is enough to search with.
    pub fn columns(&self, c: &Candidate, a: usize, exact: bool) -> Option<Vec<Vec<f64>>> {
        if !exact {
            return self.computed(c, a, false);
        }
        let same = |of: usize| of == a || (c.facts.common && self.axes[a].keep == self.axes[of].keep);
        if let Some(kept) = self.exact.lock().iter().find(|k| k.candidate == *c && same(k.axis)) {
            return kept.columns.clone();
        }
        let columns = self.computed(c, a, true);
        let mut exact = self.exact.lock();
        if exact.len() >= MOST_EXACT {
            exact.pop_front();
        }
        exact.push_back(Computed { candidate: *c, axis: a, columns: columns.clone() });
        columns
    }

    fn computed(&self, c: &Candidate, a: usize, exact: bool) -> Option<Vec<Vec<f64>>> {
        let every = if exact { 1 } else { self.coarse_s };
        let per_block = self.block_s / every;
        let outputs = c.facts.outputs;
        // Looking up what nobody asks for would take half the time.
        let recorded = c.facts.reach.needs().is_some();
        let mut all: Vec<[f64; MAX_OUTPUTS]> = Vec::new();
        for (number, (run, &n)) in self.runs.iter().zip(&self.blocks).enumerate() {
            let own = run.own_columns(c.facts.id, &c.parameters);
            if c.run.is_some_and(|r| r != number || self.unseen) {
                all.extend(std::iter::repeat_n([0.0; MAX_OUTPUTS], n));
                continue;
            }
            let mut running = match own {
                Some(_) => None,
                None => Some(Running::new(c.facts.id, &c.parameters, every as f32 * MODEL_STEP_S)?),
            };
            if let Some(r) = &mut running {
                r.start_on(c.starts.of((!self.unseen).then_some(number)));
            }
            for b in 0..n {
                let (mut sum, mut count) = ([0.0; MAX_OUTPUTS], 0.0);
                for step in b * per_block..(b + 1) * per_block {
                    let at = step * every + every / 2;
                    let quantities = if recorded { run.quantities(at) } else { Quantities::NONE };
                    let thermal = if exact { &run.thermal[at] } else { &self.coarse[number][step] };
                    if thermal.state(a).is_none() {
                        continue;
                    }
                    let inputs = Inputs { scaling: &self.scaling, thermal, axis: a, quantities: &quantities };
                    let x = match (&mut running, own) {
                        (Some(r), _) => r.step(&inputs),
                        (None, own) => own.map_or([f32::NAN; MAX_OUTPUTS], |own| own.on(a)[at]),
                    };
                    if x[0].is_nan() {
                        continue;
                    }
                    for (s, v) in sum.iter_mut().zip(x).take(outputs) {
                        *s += f64::from(v);
                    }
                    count += 1.0;
                }
                all.push(sum.map(|s| if count > 0.0 { s / count } else { f64::NAN }));
            }
        }
        let rows = &self.axes[a];
        let mut out = vec![Vec::with_capacity(rows.keep.len()); c.facts.outputs];
        let mut missing = 0;
        for &k in &rows.keep {
            let x = all.get(k)?;
            missing += usize::from(x[0].is_nan());
            for (to, v) in out.iter_mut().zip(x) {
                to.push(if v.is_nan() { 0.0 } else { *v });
            }
        }
        // A recorded quantity with a tenth of its rows missing says nothing reliable.
        (missing * 10 <= rows.keep.len()).then(|| {
            for column in &mut out {
                let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
                // Absolute levels (a drive voltage) are no matter: the baseline has a constant.
                if missing == 0 && !c.on_unit() && c.run.is_none() {
                    column.iter_mut().for_each(|v| *v -= mean);
                }
            }
            out
        })
    }

    /// Quantities beside the frequencies that the runs have.
    pub fn table(&self) -> Vec<Input> {
        self.runs.first().map_or_else(Vec::new, |run| run.table.clone())
    }

    /// Lowest and highest temperature over axes and runs.
    pub fn temperature_range(&self) -> (f32, f32) {
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        for run in self.runs {
            for a in 0..AXES {
                let (low, high) = run.temperature_range(a);
                range = (range.0.min(low), range.1.max(high));
            }
        }
        range
    }

    /// Duration of the longest run, s.
    pub fn longest_s(&self) -> f32 {
        self.runs.iter().map(|r| r.steps.len()).max().unwrap_or(0) as f32
    }

    /// `true` if the runs show a relay on an axis switch twice the same way: what switched once each way may be two events.
    pub fn switches_again(&self, relay: Thresholds, a: usize) -> bool {
        let mut switched = [0, 0];
        for run in self.runs {
            let mut is_on = None;
            for (t, _) in (0..run.steps.len()).step_by(self.coarse_s).filter_map(|k| run.state(k, a)) {
                let now = relay.switched(t).or(is_on);
                if let (Some(before), Some(now)) = (is_on, now) {
                    switched[usize::from(now)] += usize::from(before != now);
                }
                is_on = now;
            }
        }
        switched.iter().any(|n| *n > 1)
    }

    /// Span of the runs: temperatures, ramps, duration.
    pub fn extent(&self) -> Extent {
        let (low_c, high_c) = self.temperature_range();
        let twelfth_c = (high_c - low_c) / 12.0;
        // (Within the ends, which no relay switches at.)
        let mut thirds = (1..=7u8).map(|k| {
            let off_c = low_c + f32::from(k) * twelfth_c;
            Thresholds { on_c: off_c + 4.0 * twelfth_c, off_c }
        });
        let ramps = self.runs.iter().flat_map(|r| (0..AXES).map(move |a| r.ramp_range(a)));
        Extent {
            low_c,
            high_c,
            fastest_c_per_min: ramps.fold(0.1, |m, (low, high)| m.max(high).max(-low)),
            longest_s: self.longest_s(),
            lag_s: self.lag_s,
            quantities: self.ranges(),
            runs: self.runs.len(),
            path_repeats: thirds.any(|third| (0..AXES).any(|a| self.switches_again(third, a))),
        }
    }

    /// Least and greatest value of each quantity beside the frequencies, as effects count it.
    fn ranges(&self) -> [Option<[f32; 2]>; QUANTITIES] {
        let counted = |run: &'_ Run, number: u8| {
            let input = run.table.iter().find(|i| i.quantity == number).copied();
            let of = move |v: f32| input.as_ref().map_or(v, |i| i.counted(v));
            run.steps.values(number).map(of).fold(None, |range: Option<[f32; 2]>, v| {
                Some(range.map_or([v, v], |[low, high]| [low.min(v), high.max(v)]))
            })
        };
        std::array::from_fn(|number| {
            let ranges = self.runs.iter().filter_map(|run| counted(run, number as u8));
            ranges.reduce(|[low, high], [l, h]| [low.min(l), high.max(h)])
        })
    }

    /// The library: every effect with the values of its parameters, and how many values each is one of; then those of a user's own.
    pub fn library(&self, starts: Starts) -> Vec<(Candidate, f64)> {
        let extent = self.extent();
        // (A column that no run has, of an axis that does not need it, is not lacking.)
        let recorded: QuantitySet = self.runs.iter().map(|r| r.steps.has()).collect();
        let unit = unit_inputs(self.runs).union(recorded.complement());
        let own = self.runs.first().map_or(&[][..], |r| &r.own);
        let values = |facts: &Facts| own.iter().filter(|o| o.facts == facts).count() as f64;
        let of_user = own.iter().map(|o| {
            let (facts, parameters) = (o.facts, [o.parameter, 0.0]);
            let lacks = QuantitySet::empty();
            let c = Candidate { parameters, facts, run: None, starts: Starts::default(), lacks };
            (c, values(o.facts))
        });
        cards::all()
            .flat_map(|(facts, card)| {
                let grid = (card.grid)(&extent);
                let tries = grid.len() as f64;
                // Offer an effect only if every run has the inputs that it needs.
                let offered = self.runs.iter().all(|r| card.needs.met_by(r));
                grid.into_iter()
                    .filter(move |_| offered)
                    .map(move |parameters| {
                        let c = Candidate::new(facts.effect, parameters).starting(starts);
                        (c.on_unit_with(unit), tries)
                    })
                    // (An input that the unit has on one axis alone is compensated by the quantity of that axis.)
                    .filter(move |(c, _)| c.lacks.is_empty() || c.lacks == c.reads())
            })
            .chain(of_user)
            .collect()
    }

    /// Effects that are offered together, with one variance for all their gains: the first gives the name.
    pub fn bundles(&self, starts: Starts) -> Vec<Vec<Candidate>> {
        let extent = self.extent();
        let parts = |effect: EffectId| -> Vec<Candidate> {
            let of = |parameters| Candidate::new(effect, parameters).starting(starts);
            (cards::card(effect).grid)(&extent).into_iter().map(of).collect()
        };
        let (effect, parameters) = cards::beginning(&extent);
        let beginnings = (0..self.runs.len()).map(|n| Candidate { run: Some(n), ..Candidate::new(effect, parameters) });
        let in_ramp = self.runs.iter().any(|run| begins_in_ramp(run, &self.scaling));
        cards::BUNDLES
            .iter()
            .filter(|b| !b.in_ramp || in_ramp)
            .filter_map(|b| {
                // (A family that these runs cannot show is not offered, nor is what it belongs to.)
                let families: Vec<_> = b.families.iter().map(|e| parts(*e)).collect();
                let all = families.iter().all(|f| !f.is_empty());
                let families = families.into_iter().flatten();
                all.then(|| families.chain(beginnings.clone().filter(|_| b.in_ramp)).collect())
            })
            .collect()
    }

    /// Temperature (C) and its rate of change (C per minute) in the middle of each kept block of an axis.
    pub fn states(&self, a: usize) -> Vec<Option<(f64, f64)>> {
        let middles = |(run, n): (&'a Run, &usize)| {
            let block_s = self.block_s;
            (0..*n).map(move |b| {
                let state = run.thermal[b * block_s + block_s / 2].state(a);
                state.map(|s| (f64::from(s.temperature_c), f64::from(s.ramp_c_per_min)))
            })
        };
        let all: Vec<_> = self.runs.iter().zip(&self.blocks).flat_map(middles).collect();
        self.axes[a].keep.iter().map(|&k| all[k]).collect()
    }

    /// Relative deviation of the white noise in each kept block of an axis.
    pub fn relative(&self, a: usize) -> Vec<f64> {
        let at = |s: Option<(f64, f64)>| s.map_or(1.0, |(temperature_c, _)| self.growth[a].at(temperature_c));
        self.states(a).into_iter().map(at).collect()
    }

    /// Number of axes that have data, at least 1.
    pub fn axes_there(&self) -> usize {
        self.axes.iter().filter(|a| !a.y.is_empty()).count().max(1)
    }
}

/// `true` if a run begins in a ramp, by its mean over the first ten minutes: one beyond the whole band over which the baseline goes from its cooling to
/// its heating set.
fn begins_in_ramp(run: &Run, scaling: &Scaling) -> bool {
    (0..AXES).any(|a| {
        let ramps: Vec<f32> = (0..run.steps.len().min(600)).filter_map(|k| run.state(k, a)).map(|s| s.1).collect();
        ramps.iter().sum::<f32>().abs() > 2.0 * scaling.blend_band_c_per_min * ramps.len() as f32
    })
}

#[cfg(test)]
pub(super) mod tests {
    use crate::fit::independence::Units;
    use crate::fit::{prepare_for, Prepared};
    use crate::trace::growth;
    use hrg_core::effects::parameters::Thresholds;
    use hrg_simulate::{Plan, Profile};

    /// A run of a profile, prepared.
    pub fn prepared(profile: &str) -> Prepared {
        let plan = Plan::of(Profile::parse(profile).expect("a profile"), 1, 1);
        prepare_for(&[plan.simulate().recording], Units::default()).expect("usable")
    }

    #[test]
    fn what_switches_once_each_way_may_be_two_events() {
        let of = |profile: &str| {
            let prepared = prepared(profile);
            let data = growth::data(&prepared).expect("a baseline");
            (data.switches_again(Thresholds { on_c: 30.0, off_c: -10.0 }, 0), data.extent().path_repeats)
        };
        assert_eq!(of("20,-40@1,50@1,20@1"), (false, false));
        assert_eq!(of("20,-40@1,50@1,-40@1,50@1"), (true, true));
    }
}
