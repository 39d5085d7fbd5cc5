//! The search: which effects, with which parameters.
//!
//! A beam search over models. A model's worth is its log-likelihood with the noise colour refitted, less half a
//! logarithm of the number of rows for every gain and inner parameter (Schwarz 1978). An effect is added only if it
//! raises the worth, and by more than the best of the whole library does on surrogates: the whitened residuals,
//! cut into blocks and shuffled, with the same library searched.

use super::data::{Candidate, Data};
use super::gls::{Basis, View, COLOURS};
use crate::stats::{dot, take_off};
use hrg_core::effects::Reach;
use hrg_core::AXES;
use rand::seq::SliceRandom;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Candidates kept after the first effect, and after later ones.
const BEAM: [usize; 4] = [4, 3, 2, 2];
/// Most effects of a model.
pub const MOST: usize = 4;
/// Surrogates behind a significance.
const SURROGATES: usize = 40;
/// Chance under noise alone above which an effect is not warranted.
const P_VALUE: f64 = 2e-3;
/// Worth below which nothing is added, whatever the surrogates say.
const LEAST_WORTH: f64 = 6.0;
/// Worth above which surrogates need not be asked.
const PLAIN_WORTH: f64 = 80.0;

/// A model: the baseline and some effects.
#[derive(Debug, Clone)]
pub struct Model {
    /// The effects.
    pub effects: Vec<Candidate>,
    /// Its worth: log-likelihood less penalty.
    pub worth: f64,
    /// Chance that noise alone gives as much to the best of the library, of each effect when it was added; `None`: not tested.
    pub p_values: Vec<Option<f64>>,
    /// Best colour of each axis.
    pub colours: [usize; AXES],
}

/// A candidate with its columns in every view.
struct Seen {
    candidate: Candidate,
    /// By axis, then by colour, then by regressor: orthonormal among themselves, free of the baseline.
    columns: Vec<[Vec<Vec<f64>>; AXES]>,
}

/// See [`Search::overlaps`].
#[derive(Debug, Clone)]
pub struct Overlap {
    /// The effect.
    pub name: &'static str,
    /// Share of its size that the baseline leaves.
    pub left: f64,
    /// Shares of what is left that other effects explain.
    pub shares: Vec<(&'static str, f64)>,
}

/// The search on one data set.
pub struct Search<'a> {
    data: &'a Data<'a>,
    views: [Vec<View>; AXES],
    library: Vec<Seen>,
    /// What was looked at last: a search asks for the same effects over and over, with one of them moved.
    recent: RefCell<VecDeque<Rc<Seen>>>,
    seed: u64,
}

/// As many candidates are kept of those looked at last.
const RECENT: usize = 32;

fn cost(c: &Candidate, rows: f64, axes: usize) -> f64 {
    let inner = match c.facts.name {
        // Its range is not searched.
        "temperature-shape" | "timebase" => 0,
        "board" => 1,
        _ => c.facts.parameters.len(),
    };
    // A step may happen anywhere: its time counts as two parameters.
    let inner = inner + usize::from(matches!(c.facts.name, "step" | "periodic"));
    0.5 * rows.ln() * (axes * c.facts.outputs + inner) as f64
}

impl<'a> Search<'a> {
    /// What a candidate must earn before it is worth anything.
    pub fn cost(&self, c: &Candidate) -> f64 {
        cost(c, self.rows(), self.data.axes_there())
    }

    /// Prepares the library.
    pub fn new(data: &'a Data<'a>, seed: u64) -> Self {
        let views = [0, 1, 2].map(|a| COLOURS.iter().map(|c| View::new(&data.axes[a], *c)).collect::<Vec<_>>());
        let mut s = Self { data, views, library: Vec::new(), recent: RefCell::default(), seed };
        let mut candidates = data.library();
        candidates.extend(s.spectral_peaks());
        candidates.extend(s.jumps());
        s.library = candidates.into_iter().filter_map(|c| s.see(c)).collect();
        s
    }

    fn see(&self, candidate: Candidate) -> Option<Seen> {
        let raw = self.raw(&candidate)?;
        let columns = (0..COLOURS.len()).map(|s| [0, 1, 2].map(|a: usize| self.view(&raw[a], a, s))).collect();
        Some(Seen { candidate, columns })
    }

    /// Columns of a candidate, by axis.
    fn raw(&self, candidate: &Candidate) -> Option<[Vec<Vec<f64>>; AXES]> {
        let mut raw: [Vec<Vec<f64>>; AXES] = Default::default();
        for a in 0..AXES {
            // What is the same for the three axes is not computed again, unless other rows of this axis are in use.
            raw[a] = if a > 0 && candidate.facts.common && self.data.axes[a].keep == self.data.axes[a - 1].keep {
                raw[a - 1].clone()
            } else {
                self.data.columns(candidate, a, false)?
            };
        }
        Some(raw)
    }

    /// Columns of one axis in one colour: orthonormal among themselves, free of the baseline.
    fn view(&self, raw: &[Vec<f64>], a: usize, colour: usize) -> Vec<Vec<f64>> {
        let mut basis = Basis::default();
        for c in raw {
            basis.add(self.views[a][colour].column(&self.data.axes[a], c));
        }
        basis.columns
    }

    /// Periods at which the residual's spectrum stands out, taken in the whitest view.
    fn spectral_peaks(&self) -> Vec<Candidate> {
        let block = self.data.block_s as f64;
        let total = f64::from(self.data.longest_s());
        let (f_low, f_high) = (4.0 / total, 1.0 / (2.5 * block));
        let n = ((f_high - f_low) * total * 1.5) as usize;
        if n < 3 {
            return Vec::new();
        }
        let mut power = vec![0.0; n];
        for a in 0..AXES {
            let rows = &self.data.axes[a];
            if rows.y.is_empty() {
                continue;
            }
            // A middle colour: slow structure must not drown a line.
            let view = &self.views[a][4];
            let variance = dot(&view.y, &view.y) / view.y.len() as f64;
            for (k, p) in power.iter_mut().enumerate() {
                let w = std::f64::consts::TAU * (f_low + (f_high - f_low) * k as f64 / n as f64) * block;
                let (step_s, step_c) = w.sin_cos();
                let (mut re, mut im) = (0.0, 0.0);
                let mut at = usize::MAX;
                let (mut s, mut c) = (0.0, 1.0);
                for (y, &b) in view.y.iter().zip(&rows.keep) {
                    if at != usize::MAX && b == at + 1 {
                        (s, c) = (s * step_c + c * step_s, c * step_c - s * step_s);
                    } else {
                        (s, c) = (w * b as f64).sin_cos();
                    }
                    at = b;
                    re += c * y;
                    im += s * y;
                }
                *p += (re * re + im * im) / (view.y.len() as f64 * variance);
            }
        }
        let mut peaks: Vec<usize> =
            (1..n - 1).filter(|&k| power[k] >= power[k - 1] && power[k] >= power[k + 1]).collect();
        peaks.sort_by(|x, y| power[*y].total_cmp(&power[*x]));
        peaks
            .into_iter()
            .take(6)
            .filter_map(|k| {
                let f = f_low + (f_high - f_low) * k as f64 / n as f64;
                Candidate::new("periodic", [(1.0 / f) as f32, 0.0])
            })
            .collect()
    }

    /// Times at which the rates seem to jump: every block boundary is tried as a step, in three colours, and the
    /// best of each colour are kept. (A step that is placed some blocks off explains almost nothing.)
    fn jumps(&self) -> Vec<Candidate> {
        let mut out: Vec<Candidate> = Vec::new();
        let mut first_block = 0;
        for (number, run) in self.data.runs.iter().enumerate() {
            let blocks = self.data.blocks[number];
            let margin = (blocks / 30).max(2);
            for s in [0, 4, 6] {
                let mut score = vec![0.0; blocks];
                for a in 0..AXES {
                    let rows = &self.data.axes[a];
                    let view = &self.views[a][s];
                    let n = view.y.len();
                    let variance = dot(&view.y, &view.y) / n as f64;
                    let to = rows.starts.get(number + 1).copied().unwrap_or(n);
                    let from = rows.starts[number];
                    // A whitened step is the response h from its place on. Its product with the rates, and with
                    // each column of the baseline, for all places at once: the recursion run backwards.
                    let response = |x: &[f64]| -> Vec<f64> {
                        let (mut back, mut sum) = (0.0, 0.0);
                        let mut out = vec![0.0; to - from];
                        for k in (from..to).rev() {
                            // Adjoint of e_t = x_t - phi x_(t-1) + theta e_(t-1), then of the step's running sum.
                            let adjoint = x[k] + view.colour.theta * back;
                            sum += adjoint - view.colour.phi * back;
                            back = adjoint;
                            out[k - from] = sum;
                        }
                        out
                    };
                    let product = response(&view.y);
                    let cuts: Vec<Vec<f64>> = view.base.columns.iter().map(|q| response(q)).collect();
                    // Length of the response from each place to the end.
                    let mut h = vec![1.0; to - from];
                    let mut e = 0.0;
                    for (k, v) in h.iter_mut().enumerate() {
                        e = if k == 0 { 1.0 } else { 1.0 - view.colour.phi + view.colour.theta * e };
                        *v = e;
                    }
                    let mut length = vec![0.0; to - from + 1];
                    for k in 0..to - from {
                        length[k + 1] = length[k] + h[k] * h[k];
                    }
                    for k in 0..to - from {
                        let whole = length[to - from - k];
                        let left = whole - cuts.iter().map(|c| c[k] * c[k]).sum::<f64>();
                        let block = rows.keep[from + k] - first_block;
                        if left > 1e-3 * whole && block < blocks {
                            score[block] += product[k] * product[k] / (left * variance);
                        }
                    }
                }
                let mut best: Vec<usize> = (margin..blocks.saturating_sub(margin))
                    .filter(|&k| score[k] >= score[k - 1] && score[k] >= score[k + 1])
                    .collect();
                best.sort_by(|x, y| score[*y].total_cmp(&score[*x]));
                for k in best.into_iter().take(6) {
                    let t = run.thermal[k * self.data.block_s].time_s;
                    out.extend(Candidate::new("step", [t, 0.0]).map(|c| Candidate { run: Some(number), ..c }));
                }
            }
            first_block += blocks;
        }
        out
    }

    fn rows(&self) -> f64 {
        self.data.axes.iter().map(|r| r.y.len()).sum::<usize>() as f64 / self.data.axes_there() as f64
    }

    /// Bases of a model's effects beyond the baseline, by axis and colour.
    fn bases(&self, effects: &[Rc<Seen>]) -> Vec<[Basis; AXES]> {
        (0..COLOURS.len())
            .map(|s| {
                [0, 1, 2].map(|a: usize| {
                    let mut basis = Basis::default();
                    for e in effects {
                        for c in &e.columns[s][a] {
                            basis.add(c.clone());
                        }
                    }
                    basis
                })
            })
            .collect()
    }

    /// Log-likelihood of each axis with its best colour.
    fn likelihood(&self, bases: &[[Basis; AXES]]) -> [(f64, usize); AXES] {
        [0, 1, 2].map(|a: usize| {
            let mut best = (f64::NEG_INFINITY, 0);
            for (s, b) in bases.iter().enumerate() {
                let view = &self.views[a][s];
                let explained: f64 = b[a].columns.iter().map(|q| dot(q, &view.y).powi(2)).sum();
                let l = view.log_likelihood(dot(&view.y, &view.y) - explained, self.data.runs.len());
                if l > best.0 {
                    best = (l, s);
                }
            }
            best
        })
    }

    fn seen(&self, effects: &[Candidate]) -> Vec<Rc<Seen>> {
        let one = |c: &Candidate| {
            let known = self.recent.borrow().iter().find(|s| s.candidate == *c).cloned();
            known.or_else(|| {
                let seen = Rc::new(self.see(*c)?);
                let mut recent = self.recent.borrow_mut();
                recent.truncate(RECENT - 1);
                recent.push_front(seen.clone());
                Some(seen)
            })
        };
        effects.iter().filter_map(one).collect()
    }

    /// The worth of a set of effects.
    pub fn worth(&self, effects: &[Candidate]) -> (f64, [usize; AXES]) {
        let l = self.likelihood(&self.bases(&self.seen(effects)));
        let penalty: f64 = effects.iter().map(|c| self.cost(c)).sum();
        (l.iter().map(|x| x.0).sum::<f64>() - penalty, l.map(|x| x.1))
    }

    /// Rates with a model taken out, and their sums of squares, by colour and axis.
    fn left(&self, bases: &[[Basis; AXES]]) -> Vec<[(Vec<f64>, f64); AXES]> {
        let one = |s: usize, a: usize| {
            let mut y = self.views[a][s].y.clone();
            bases[s][a].reduce(&mut y);
            let squares = dot(&y, &y);
            (y, squares)
        };
        (0..bases.len()).map(|s| [0, 1, 2].map(|a| one(s, a))).collect()
    }

    /// What each candidate of the library would add to a model: (gain in worth, index), best first.
    fn extensions(&self, effects: &[Candidate]) -> Vec<(f64, usize)> {
        let bases = self.bases(&self.seen(effects));
        let before: f64 = self.likelihood(&bases).iter().map(|x| x.0).sum();
        let y = self.left(&bases);
        let mut out: Vec<(f64, usize)> = Vec::new();
        for (number, seen) in self.library.iter().enumerate() {
            let name = seen.candidate.facts.name;
            if effects.iter().any(|e| e.facts.name == name && !matches!(name, "step" | "periodic")) {
                continue;
            }
            let mut total = 0.0;
            for a in 0..AXES {
                let mut best = f64::NEG_INFINITY;
                for (s, at) in y.iter().enumerate() {
                    let view = &self.views[a][s];
                    let explained = explained(&seen.columns[s][a], &bases[s][a], &at[a].0);
                    best = best.max(view.log_likelihood(at[a].1 - explained, self.data.runs.len()));
                }
                total += best;
            }
            out.push((total - before - self.cost(&seen.candidate), number));
        }
        out.sort_by(|x, y| y.0.total_cmp(&x.0));
        out
    }

    /// How likely the best of the library adds `gain` to a model that lacks nothing; `None` where the gain is so large that it is
    /// not tested.
    fn p_value(&self, effects: &[Candidate], gain: f64) -> Option<f64> {
        if gain > PLAIN_WORTH {
            return None;
        }
        let bases = self.bases(&self.seen(effects));
        let colours = self.likelihood(&bases).map(|x| x.1);
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        // Candidates with the model taken out, once.
        let reduced: Vec<(f64, [Vec<Vec<f64>>; AXES])> = self
            .library
            .iter()
            .map(|seen| {
                let columns = [0, 1, 2].map(|a: usize| {
                    let mut b = bases[colours[a]][a].clone();
                    let own = b.columns.len();
                    for c in &seen.columns[colours[a]][a] {
                        b.add(c.clone());
                    }
                    b.columns.split_off(own)
                });
                (self.cost(&seen.candidate), columns)
            })
            .collect();
        let mut best: Vec<f64> = Vec::with_capacity(SURROGATES);
        for _ in 0..SURROGATES {
            let draws = [0, 1, 2].map(|a: usize| {
                let view = &self.views[a][colours[a]];
                let mut e = view.y.clone();
                bases[colours[a]][a].reduce(&mut e);
                let mut e = shuffled(&e, &mut rng);
                view.base.reduce(&mut e);
                bases[colours[a]][a].reduce(&mut e);
                let rss = dot(&e, &e);
                (e, rss)
            });
            let top = reduced
                .iter()
                .map(|(cost, columns)| {
                    (0..AXES)
                        .map(|a| {
                            let (e, rss) = &draws[a];
                            let explained: f64 = columns[a].iter().map(|q| dot(q, e).powi(2)).sum();
                            -0.5 * e.len() as f64 * (1.0 - explained / rss).max(1e-9).ln()
                        })
                        .sum::<f64>()
                        - cost
                })
                .fold(f64::NEG_INFINITY, f64::max);
            best.push(top);
        }
        // Maxima over many candidates: Gumbel's distribution, by moments.
        let mean = crate::stats::mean(&best);
        let scale = (crate::stats::std_dev(&best) * 6f64.sqrt() / std::f64::consts::PI).max(0.3);
        let z = (gain - (mean - 0.5772 * scale)) / scale;
        Some(-(-(-z).exp()).exp_m1())
    }

    /// Sharpens the inner parameters of one effect of a model.
    pub fn sharpen(&self, effects: &mut [Candidate], which: usize) {
        let name = effects[which].facts.name;
        if effects[which].facts.parameters.is_empty() || matches!(name, "temperature-shape" | "board" | "timebase") {
            return;
        }
        // Everything else stays: its basis once.
        let others: Vec<Candidate> = effects.iter().enumerate().filter(|(k, _)| *k != which).map(|(_, e)| *e).collect();
        let bases = self.bases(&self.seen(&others));
        let left = self.left(&bases);
        // In the colours that the model has as it stands.
        let colours = self.likelihood(&self.bases(&self.seen(effects))).map(|l| l.1);
        let worth = |c: &Candidate| -> f64 {
            let Some(raw) = self.raw(c) else {
                return f64::NEG_INFINITY;
            };
            let one = |a: usize| {
                let s = colours[a];
                let (y, squares) = &left[s][a];
                let rss = squares - explained(&self.view(&raw[a], a, s), &bases[s][a], y);
                self.views[a][s].log_likelihood(rss, self.data.runs.len())
            };
            (0..AXES).map(one).sum()
        };
        let start = effects[which];
        let p = start.parameters[0];
        // Steps that halve, from half a grid cell: additive for places, multiplicative for times and widths.
        let multiply = matches!(name, "thermal-lag" | "hysteresis" | "warm-up");
        let mut step = match name {
            "kink" => {
                let (low, high) = self.data.temperature_range();
                (high - low) * 0.8 / 40.0
            }
            "step" => self.data.block_s as f32,
            "periodic" => 0.3 * p * p / self.data.longest_s(),
            _ => 0.16,
        };
        let mut best = (worth(&start), p);
        for _ in 0..6 {
            for sign in [-1.0, 1.0] {
                let q = if multiply { best.1 * (1.0 + sign * step) } else { best.1 + sign * step };
                let mut c = start;
                c.parameters[0] = q;
                let w = worth(&c);
                if q > -200.0 && w > best.0 {
                    best = (w, q);
                }
            }
            step *= 0.55;
        }
        effects[which].parameters[0] = best.1;
    }

    /// The best model.
    pub fn run(&self) -> Model {
        let (worth, colours) = self.worth(&[]);
        let mut best = Model { effects: vec![], worth, p_values: vec![], colours };
        let mut beam = vec![best.clone()];
        for depth in 0..MOST {
            let mut next: Vec<Model> = Vec::new();
            for model in &beam {
                let extensions = self.extensions(&model.effects);
                // The best of each name.
                let mut names: Vec<&str> = Vec::new();
                for (gain, number) in extensions {
                    let candidate = self.library[number].candidate;
                    let name = candidate.facts.name;
                    if names.contains(&name) || names.len() >= BEAM[depth] || gain < LEAST_WORTH {
                        continue;
                    }
                    names.push(name);
                    let mut effects = model.effects.clone();
                    effects.push(candidate);
                    let last = effects.len() - 1;
                    self.sharpen(&mut effects, last);
                    if last > 0 {
                        for k in 0..last {
                            self.sharpen(&mut effects, k);
                        }
                        self.sharpen(&mut effects, last);
                    }
                    let (worth, colours) = self.worth(&effects);
                    let gain = worth - model.worth;
                    if gain < LEAST_WORTH {
                        continue;
                    }
                    let mut p_values = model.p_values.clone();
                    p_values.push(None);
                    next.push(Model { effects, worth, p_values, colours });
                }
            }
            next.sort_by(|x, y| y.worth.total_cmp(&x.worth));
            next.dedup_by(|x, y| same_names(&x.effects, &y.effects));
            // Only what is warranted goes on: judged on the model that it extends.
            let mut kept: Vec<Model> = Vec::new();
            for mut model in next {
                if kept.len() >= BEAM[depth] {
                    break;
                }
                let parent = &model.effects[..model.effects.len() - 1];
                let gain = model.worth - self.worth(parent).0;
                let p_value = self.p_value(parent, gain);
                if p_value.is_some_and(|p| p > P_VALUE) {
                    continue;
                }
                if let Some(last) = model.p_values.last_mut() {
                    *last = p_value;
                }
                kept.push(model);
            }
            let Some(top) = kept.first() else { break };
            if top.worth > best.worth {
                best = top.clone();
            } else {
                break;
            }
            beam = kept;
        }
        self.prune(best)
    }

    /// Takes out effects that another one has made needless.
    fn prune(&self, mut model: Model) -> Model {
        let mut k = 0;
        while model.effects.len() > 1 && k < model.effects.len() {
            let mut fewer = model.effects.clone();
            fewer.remove(k);
            let (worth, colours) = self.worth(&fewer);
            if worth > model.worth - LEAST_WORTH {
                model.effects = fewer;
                model.p_values.remove(k);
                model.worth = worth;
                model.colours = colours;
                k = 0;
            } else {
                k += 1;
            }
        }
        model
    }

    /// What could stand in the place of one effect: the best of each name with its worth, best first. The effect
    /// itself is among them.
    pub fn instead_of(&self, model: &Model, which: usize) -> Vec<(Candidate, f64)> {
        let others: Vec<Candidate> =
            model.effects.iter().enumerate().filter(|(k, _)| *k != which).map(|(_, e)| *e).collect();
        let base = self.worth(&others).0;
        let mut out = vec![(model.effects[which], model.worth - base)];
        for (gain, number) in self.extensions(&others) {
            let c = self.library[number].candidate;
            if out.len() >= 5 || out.iter().any(|(o, _)| o.facts.name == c.facts.name) {
                continue;
            }
            let mut effects = others.clone();
            effects.push(c);
            let last = effects.len() - 1;
            if gain > -20.0 {
                self.sharpen(&mut effects, last);
            }
            out.push((effects[last], self.worth(&effects).0 - base));
        }
        out.sort_by(|x, y| y.1.total_cmp(&x.1));
        out
    }

    /// Effects that rest on a recorded sensor and whose regressors the found effects (with the baseline) span but
    /// for what a coarse sensor's own error may be: a tenth of their variance. Likelihood cannot be asked here: a
    /// regressor with noise of its own always loses against a clean one. Each with the found effect it is most
    /// alike.
    pub fn alike(&self, effects: &[Candidate]) -> Vec<(&'static str, usize)> {
        let found = self.seen(effects);
        let mut out: Vec<(&'static str, usize)> = Vec::new();
        for seen in self.library.iter().filter(|s| matches!(s.candidate.facts.reach, Reach::NeedsInput(_))) {
            let name = seen.candidate.facts.name;
            if effects.iter().any(|e| e.facts.name == name) {
                continue;
            }
            // In the white view; shares of the candidate's variance.
            let mut together = 0.0;
            let mut alone = vec![0.0; found.len()];
            for a in 0..AXES {
                let Some(c) = seen.columns[0][a].first() else { continue };
                let share = |columns: &mut dyn Iterator<Item = &Vec<f64>>| {
                    let mut basis = Basis::default();
                    for column in columns {
                        basis.add(column.clone());
                    }
                    basis.columns.iter().map(|q| dot(q, c).powi(2)).sum::<f64>() / self.data.axes_there() as f64
                };
                together += share(&mut found.iter().flat_map(|f| &f.columns[0][a]));
                for (sum, f) in alone.iter_mut().zip(&found) {
                    *sum += share(&mut f.columns[0][a].iter());
                }
            }
            let most = (0..found.len()).max_by(|x, y| alone[*x].total_cmp(&alone[*y]));
            if let (true, Some(k)) = (together > 0.85, most) {
                if !out.iter().any(|(n, _)| *n == name) {
                    out.push((name, k));
                }
            }
        }
        out
    }

    /// Which axes have each effect of a model: those on which it earns the price of its gains.
    pub fn axes_of(&self, model: &Model) -> Vec<[bool; AXES]> {
        let with = self.likelihood(&self.bases(&self.seen(&model.effects)));
        (0..model.effects.len())
            .map(|k| {
                let mut others = model.effects.clone();
                let own = others.remove(k);
                let without = self.likelihood(&self.bases(&self.seen(&others)));
                let earned = [0, 1, 2].map(|a: usize| with[a].0 - without[a].0);
                let price = 0.5 * self.rows().ln() * own.facts.outputs as f64;
                let most = (0..AXES).fold(0, |m, a| if earned[a] > earned[m] { a } else { m });
                [0, 1, 2].map(|a: usize| a == most || earned[a] > price)
            })
            .collect()
    }

    /// How much of each wanted effect, at three values of its parameter, the others explain (the worst of the three), under
    /// white and under coloured noise.
    pub fn overlaps(&self, wanted: &[&'static str]) -> Vec<Overlap> {
        let of =
            |name: &str| -> Vec<&Seen> { self.library.iter().filter(|s| s.candidate.facts.name == name).collect() };
        wanted
            .iter()
            .map(|&name| {
                let own = of(name);
                let some = [own.len() / 4, own.len() / 2, 3 * own.len() / 4];
                let mut shares: Vec<(&'static str, f64)> = Vec::new();
                let mut left = 0.0f64;
                for target in some.iter().filter_map(|k| own.get(*k)) {
                    left = left.max(self.left_by_baseline(&target.candidate));
                    for other in wanted.iter().filter(|o| **o != name) {
                        let most = of(other)
                            .iter()
                            .map(|s| {
                                // Under white noise, and under noise with some colour.
                                let share = |view: usize| {
                                    (0..AXES)
                                        .map(|a| {
                                            let Some(c) = target.columns[view][a].first() else { return 0.0 };
                                            s.columns[view][a].iter().map(|q| dot(q, c).powi(2)).sum::<f64>()
                                        })
                                        .sum::<f64>()
                                        / AXES as f64
                                };
                                share(0).max(share(COLOURS.len() / 2))
                            })
                            .fold(0.0, f64::max);
                        match shares.iter_mut().find(|(n, _)| n == other) {
                            Some((_, s)) => *s = s.max(most),
                            None => shares.push((other, most)),
                        }
                    }
                }
                Overlap { name, left, shares }
            })
            .collect()
    }

    /// RMS of a candidate's first regressor after the baseline over that before it (about its mean): mean of the axes.
    fn left_by_baseline(&self, c: &Candidate) -> f64 {
        let mut sum = 0.0;
        for a in 0..AXES {
            let rows = &self.data.axes[a];
            let Some(column) =
                self.data.columns(c, a, false).and_then(|mut v| (!v.is_empty()).then(|| v.swap_remove(0)))
            else {
                return 0.0;
            };
            let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
            let about: Vec<f64> = column.iter().map(|v| v - mean).collect();
            let mut basis = Basis::default();
            for b in &rows.base {
                basis.add(b.clone());
            }
            let inside: f64 = basis.columns.iter().map(|q| dot(q, &column).powi(2)).sum();
            let after = (dot(&column, &column) - inside).max(0.0);
            sum += (after / dot(&about, &about).max(1e-300)).sqrt().min(1.0);
        }
        sum / AXES as f64
    }

    /// Gain in cross-validated error of adding `candidate` to `others`, as a share of the error: five folds of
    /// contiguous blocks, every fifth one, so that an effect that lives in one part of the run is in every
    /// training set.
    pub fn cross_validated_gain(&self, others: &[Candidate], candidate: &Candidate, colours: [usize; AXES]) -> f64 {
        const FOLDS: usize = 5;
        let (mut without, mut with) = (0.0, 0.0);
        for a in 0..AXES {
            let rows = &self.data.axes[a];
            let view = &self.views[a][colours[a]];
            let whitened = |c: &[f64]| {
                let mut c = c.to_vec();
                view.colour.whiten(&mut c, &rows.starts);
                c
            };
            let mut columns: Vec<Vec<f64>> = rows.base.iter().map(|c| whitened(c)).collect();
            for e in others {
                for c in self.data.columns(e, a, false).unwrap_or_default() {
                    columns.push(whitened(&c));
                }
            }
            let small = columns.len();
            for c in self.data.columns(candidate, a, false).unwrap_or_default() {
                columns.push(whitened(&c));
            }
            let y = whitened(&rows.y);
            let variance = dot(&y, &y).max(1e-300);
            let chunk = (y.len() / 40).max(1);
            for fold in 0..FOLDS {
                let held = |k: usize| (k / chunk) % FOLDS == fold;
                for (count, sum) in [(small, &mut without), (columns.len(), &mut with)] {
                    *sum += held_out_error(&columns[..count], &y, held) / variance;
                }
            }
        }
        if without > 0.0 {
            1.0 - with / without
        } else {
            0.0
        }
    }
}

/// Sum of squares that columns explain beyond a basis, of rates that are free of it.
fn explained(columns: &[Vec<f64>], basis: &Basis, y: &[f64]) -> f64 {
    if columns.len() == 1 {
        let c = &columns[0];
        // y is free of the basis, so c.y is that of the reduced column; its length must be.
        let cut: f64 = basis.columns.iter().map(|q| dot(q, c).powi(2)).sum();
        let left = dot(c, c) - cut;
        return if left > 1e-6 { dot(c, y).powi(2) / left } else { 0.0 };
    }
    let mut own = Basis::default();
    let mut sum = 0.0;
    for c in columns {
        let mut x = c.clone();
        for q in &basis.columns {
            let d = dot(q, &x);
            take_off(&mut x, d, q);
        }
        let count = own.columns.len();
        if dot(&x, &x) > 1e-6 && own.add(x) {
            sum += dot(&own.columns[count], y).powi(2);
        }
    }
    sum
}

/// Whitened residuals in another order: blocks of twelve, shuffled, each with a random sign.
fn shuffled(e: &[f64], rng: &mut ChaCha8Rng) -> Vec<f64> {
    use rand::Rng;
    let mut blocks: Vec<&[f64]> = e.chunks(12).collect();
    blocks.shuffle(rng);
    let mut out = Vec::with_capacity(e.len());
    for b in blocks {
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        out.extend(b.iter().map(|v| sign * v));
    }
    out
}

/// Squared error on the rows held out of a least-squares fit to the others.
fn held_out_error(columns: &[Vec<f64>], y: &[f64], held: impl Fn(usize) -> bool) -> f64 {
    use nalgebra::{DMatrix, DVector};
    let p = columns.len();
    let scale: Vec<f64> = columns.iter().map(|c| dot(c, c).sqrt().max(1e-300)).collect();
    let mut normal = DMatrix::<f64>::zeros(p, p);
    let mut right = DVector::<f64>::zeros(p);
    let mut row = vec![0.0; p];
    for k in (0..y.len()).filter(|k| !held(*k)) {
        for j in 0..p {
            row[j] = columns[j][k] / scale[j];
        }
        for i in 0..p {
            right[i] += row[i] * y[k];
            for j in 0..=i {
                normal[(i, j)] += row[i] * row[j];
            }
        }
    }
    for i in 0..p {
        // A whisper of a ridge: a fold may not see what a candidate stands for.
        normal[(i, i)] += 1e-9;
        for j in 0..i {
            normal[(j, i)] = normal[(i, j)];
        }
    }
    let Some(b) = normal.cholesky().map(|c| c.solve(&right)) else {
        return f64::INFINITY;
    };
    (0..y.len())
        .filter(|k| held(*k))
        .map(|k| {
            let fitted: f64 = (0..p).map(|j| columns[j][k] / scale[j] * b[j]).sum();
            (y[k] - fitted).powi(2)
        })
        .sum()
}

fn same_names(a: &[Candidate], b: &[Candidate]) -> bool {
    let names = |e: &[Candidate]| {
        let mut n: Vec<&str> = e.iter().map(|c| c.facts.name).collect();
        n.sort_unstable();
        n
    };
    names(a) == names(b)
}

/// Whether a unit can take an effect into its block.
pub fn on_unit(c: &Candidate) -> bool {
    c.facts.reach == Reach::Unit
}
