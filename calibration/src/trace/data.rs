//! What the search works on: block means of rates and regressors, and the library of candidate columns.

use crate::fit::baseline_columns;
use crate::run::Run;
use hrg_core::bias::Scaling;
use hrg_core::effects::{by_name, Facts, Reach, Recorded, Running, MAX_OUTPUTS, MAX_PARAMETERS};
use hrg_core::{AXES, MODEL_STEP_S};

/// A candidate: an effect with its inner parameters, perhaps confined to one of several runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Facts about the effect.
    pub facts: &'static Facts,
    /// Inner parameters.
    pub parameters: [f32; MAX_PARAMETERS],
    /// The run it happens in; `None`: all.
    pub run: Option<usize>,
}

impl Candidate {
    /// A candidate by name, everywhere. `None` if there is no such effect.
    pub fn new(name: &str, parameters: [f32; MAX_PARAMETERS]) -> Option<Self> {
        by_name(name).map(|facts| Self { facts, parameters, run: None })
    }
}

/// Rows of one axis.
#[derive(Debug, Clone)]
pub struct AxisRows {
    /// Numbers of the blocks that have data.
    pub keep: Vec<usize>,
    /// Where a run begins, as an index into `keep`.
    pub starts: Vec<usize>,
    /// Mean rate of each kept block, deg/h.
    pub y: Vec<f64>,
    /// Means of the baseline's regressors.
    pub base: Vec<Vec<f64>>,
}

/// All rows.
#[derive(Debug)]
pub struct Data<'a> {
    /// The runs.
    pub runs: &'a [Run],
    /// Centre and scale.
    pub scaling: Scaling,
    /// Time constant by which the resonators follow their shells, s.
    pub lag_s: f32,
    /// Seconds in a block.
    pub block_s: usize,
    /// Seconds between the rows on which stateful effects are searched.
    pub coarse_s: usize,
    /// Blocks of each run.
    pub blocks: Vec<usize>,
    /// The axes.
    pub axes: [AxisRows; AXES],
}

impl<'a> Data<'a> {
    /// Cuts runs into blocks: about 600 in all, of 20 to 100 s.
    pub fn new(runs: &'a [Run], scaling: Scaling, lag_s: f64) -> Self {
        let total: usize = runs.iter().map(|r| r.steps.len()).sum();
        let coarse_s = (total / 3000).clamp(2, 20);
        let block_s = 5 * coarse_s;
        let blocks: Vec<usize> = runs.iter().map(|r| r.steps.len() / block_s).collect();
        let axes = [0, 1, 2].map(|a| {
            let mut rows =
                AxisRows { keep: vec![], starts: vec![], y: vec![], base: vec![vec![]; hrg_core::bias::TERMS] };
            let mut first = 0;
            for (run, &n) in runs.iter().zip(&blocks) {
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
                    for (to, from) in rows.base.iter_mut().zip(&columns) {
                        to.push(mean(from));
                    }
                }
                first += n;
            }
            rows
        });
        Self { runs, scaling, lag_s: lag_s as f32, block_s, coarse_s, blocks, axes }
    }

    /// Columns of a candidate for one axis, by regressor, on the kept blocks. `None` where it needs what was not
    /// recorded. `exact`: at every model step; else on the coarse rows, which is enough to search with.
    pub fn columns(&self, c: &Candidate, a: usize, exact: bool) -> Option<Vec<Vec<f64>>> {
        let every = if exact { 1 } else { self.coarse_s };
        let outputs = c.facts.outputs;
        // Looking up what nobody asks for would take half the time.
        let recorded = matches!(c.facts.reach, Reach::NeedsInput(_));
        let mut all: Vec<[f64; MAX_OUTPUTS]> = Vec::new();
        for (number, (run, &n)) in self.runs.iter().zip(&self.blocks).enumerate() {
            if c.run.is_some_and(|r| r != number) {
                all.extend(std::iter::repeat_n([0.0; MAX_OUTPUTS], n));
                continue;
            }
            let mut running = Running::new(c.facts.id, &c.parameters, every as f32 * MODEL_STEP_S)?;
            for b in 0..n {
                let (mut sum, mut count) = ([0.0; MAX_OUTPUTS], 0.0);
                for k in (b * self.block_s..(b + 1) * self.block_s).step_by(every) {
                    let at = k + every / 2;
                    let recorded = if recorded { run.steps.recorded(at, a) } else { Recorded::NONE };
                    let Some(inputs) = run.inputs(&self.scaling, at, a, recorded) else {
                        continue;
                    };
                    let x = running.step(&inputs);
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
                if missing == 0 && c.facts.reach != Reach::Unit && c.run.is_none() {
                    column.iter_mut().for_each(|v| *v -= mean);
                }
            }
            out
        })
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

    /// The library: every effect with a grid of inner parameters. `periodic` and `step` are added later, where a
    /// spectrum or a jump points. `frequency-direct` is left out: as an addition to the baseline it spans what `cubic` spans.
    pub fn library(&self) -> Vec<Candidate> {
        let (low, high) = self.temperature_range();
        let span = high - low;
        let longest = self.longest_s();
        let log = |from: f32, to: f32, n: usize| -> Vec<f32> {
            (0..n).map(|k| from * (to / from).powf(k as f32 / (n - 1) as f32)).collect()
        };
        let even = |from: f32, to: f32, n: usize| -> Vec<f32> {
            (0..n).map(|k| from + (to - from) * k as f32 / (n - 1) as f32).collect()
        };
        let mut grid: Vec<(&str, Vec<f32>)> = vec![
            ("cubic", vec![0.0]),
            ("kink", even(low + 0.1 * span, high - 0.1 * span, 20)),
            ("thermal-lag", log(120.0, (longest / 2.5).max(600.0), 18)),
            ("second-derivative", vec![0.0]),
            ("hysteresis", log((0.03 * span).max(0.5), 0.75 * span, 14)),
            ("axis-gradient", vec![0.0]),
            ("cooling-heating", vec![0.0]),
            ("case-gradient", vec![0.0]),
            ("warm-up", log(150.0, longest / 3.0, 12)),
            ("aging", vec![0.0]),
            ("timebase", vec![self.lag_s]),
            ("drive-amplitude", vec![0.0]),
            ("quadrature", vec![0.0]),
            ("board", vec![0.0, 1.0]),
        ];
        let mut out: Vec<Candidate> = grid
            .drain(..)
            .flat_map(|(name, values)| values.into_iter().filter_map(move |v| Candidate::new(name, [v, 0.0])))
            .collect();
        out.extend(Candidate::new("temperature-shape", [low, high]));
        // What an effect needs from another axis must be there.
        out.retain(|c| self.runs.iter().all(|r| r.offers(c.facts.name)));
        out
    }

    /// How many axes have data.
    pub fn axes_there(&self) -> usize {
        self.axes.iter().filter(|a| !a.y.is_empty()).count().max(1)
    }
}
