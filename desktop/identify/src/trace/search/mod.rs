//! The search: which effects, with which parameters, on which axes.
//!
//! Candidates are the groups of the [cards](hrg_data::cards) and what the data propose (jumps and periods). Each axis takes a
//! candidate only where it raises its log evidence ([`super::evidence`]) by more than one; each candidate has a fixed price, and pays for
//! being of a class that the model does not have, and for the values of its parameter that were tried. The best one is added,
//! its parameter refined, earlier ones that it has made needless are taken out, and so on until nothing pays its price on
//! surrogates as well.

use super::data::{AxisByAxis, Candidate, Data, Starts};
use super::evidence::{Axis, AxisModel, Share};
use super::proposals::{self, Left};
use super::surrogate;
use crate::trace::user_effects::card_of;
use hrg_core::effects::EffectId;
use hrg_core::AXES;
use hrg_data::cards::Class;
use hrg_data::cards::{card, Card, Kind};

/// Most effects of a model.
pub const MOST: usize = 6;
/// Evidence that a candidate must bring on an axis for the axis to have it.
const AXIS_PRICE: f64 = 1.0;
/// Price of a candidate.
const PRICE: f64 = 3.0;
/// Price of a class that the model does not have yet.
const CLASS_PRICE: f64 = 2.0;
/// Further price of what happens once: another run cannot confirm it.
const EVENT_PRICE: f64 = 6.0;
/// Score below which nothing is added.
const LEAST: f64 = 5.0;
/// The same for what happens once.
const LEAST_EVENT: f64 = 12.0;
/// Score below which the surrogates are asked.
const PLAIN: f64 = 40.0;
/// Chance under noise alone above which an effect is not warranted.
const P_VALUE: f64 = 2e-3;
/// Evidence by which a family must beat a simple member of its class, and a simple member another class.
const SIMPLE: f64 = 3.0;
/// An effect that brings less is taken out again.
const KEEP: f64 = 4.0;
/// Evidence that a start on a branch must bring.
const BRANCH: f64 = 2.0;
/// Runs whose starts are searched.
const MOST_STARTS: usize = 6;
/// Further effects that are begun with where several were found.
const BEGUN: usize = 4;
/// Number of the best candidates that are tried in full.
const TRIED: usize = 5;
/// Number of candidates that are considered for them.
const LOOKS: usize = 12;

mod families;
mod refine;
mod rivals;

pub use rivals::{Overlap, Rival};

/// An effect of a model with the axes that have it.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// The effect, or effects that share one variance; the first gives the name.
    pub parts: Vec<Candidate>,
    /// By axis: the variance of each gain about zero before the data are seen, (deg/h per unit)^2, over the variance of the
    /// whitened noise. Empty where the axis does not have the effect.
    pub prior: [Vec<f64>; AXES],
    /// Chance that noise alone gives as much to the best of the library; `None`: not tested.
    pub p_value: Option<f64>,
}

/// A model: the baseline and some effects.
#[derive(Debug, Clone)]
pub struct Model {
    /// The effects.
    pub members: Vec<Member>,
    /// Best noise model of each axis.
    pub noise_models: [usize; AXES],
    state: State,
}

impl Model {
    /// Its effects, each by the one that gives the name.
    pub fn effects(&self) -> impl Iterator<Item = &Candidate> {
        self.members.iter().map(|m| &m.parts[0])
    }
}

/// A model by the numbers of its groups.
#[derive(Debug, Clone)]
struct State {
    groups: Vec<usize>,
    axes: [AxisModel; AXES],
    p_values: Vec<Option<f64>>,
}

impl State {
    fn evidence(&self) -> f64 {
        self.axes.iter().map(|a| a.evidence).sum()
    }

    /// The group that was added last.
    fn last(&self) -> usize {
        self.groups[self.groups.len() - 1]
    }

    /// Evidence less what each axis pays for each group that it has.
    fn net(&self) -> f64 {
        self.evidence() - AXIS_PRICE * self.axes.iter().map(|a| a.shares.len()).sum::<usize>() as f64
    }
}

/// The search on one data set.
pub struct Search<'a> {
    data: &'a Data<'a>,
    axes: [Axis<'a>; AXES],
    /// Each: an effect, or some that share one variance, the one that gives the name first.
    candidates: Vec<Vec<Candidate>>,
    /// Values of the parameter that were offered for each.
    tries: Vec<f64>,
    seed: u64,
}

impl<'a> Search<'a> {
    /// Prepares the candidates.
    pub fn new(data: &'a Data<'a>, seed: u64) -> Self {
        let axes = data.axes.each_ref().map(Axis::new);
        let mut s = Self { data, axes, candidates: vec![], tries: vec![], seed };
        let starts = s.starts();
        for (c, tries) in data.library(starts) {
            if s.alone(&c).is_none() {
                s.push(vec![c], tries);
            }
        }
        for bundle in data.bundles(starts) {
            s.push(bundle, 1.0);
        }
        s
    }

    /// Start states of the plays, as far as the rates tell beside the baseline: the middle unless a branch has evidence. (Ladders tried
    /// here stay among the candidates.)
    fn starts(&mut self) -> Starts {
        let runs = self.data.runs.len();
        let extent = self.data.extent();
        let grid = (card(EffectId::PlayLadder).grid)(&extent);
        let Some(&parameters) = grid.first() else { return Starts::default() };
        let nothing = self.nothing();
        let mut net_evidence = |starts: Starts| {
            let c = Candidate::new(EffectId::PlayLadder, parameters).starting(starts);
            let group = self.alone(&c).unwrap_or_else(|| self.push(vec![c], Starts::BRANCHES.len() as f64));
            let all = self.extensions(&nothing);
            all.iter().find(|e| e.1 == group).map_or(f64::NEG_INFINITY, |e| e.0)
        };
        let middle = Starts::all(runs, 0);
        let mut best = (net_evidence(middle) + BRANCH, middle);
        for branch in 1..Starts::BRANCHES.len() {
            let starts = Starts::all(runs, branch);
            let w = net_evidence(starts);
            if w > best.0 {
                best = (w, starts);
            }
        }
        for run in 0..if runs > 1 { runs.min(MOST_STARTS) } else { 0 } {
            for branch in 0..Starts::BRANCHES.len() {
                let starts = best.1.with(run, branch);
                let w = net_evidence(starts);
                if w > best.0 {
                    best = (w, starts);
                }
            }
        }
        best.1
    }

    /// The number of a candidate that is offered by itself.
    fn alone(&self, c: &Candidate) -> Option<usize> {
        self.candidates.iter().position(|k| k[..] == [*c])
    }

    /// Adds a candidate; gives its number. Parts that are candidates by themselves lend it their columns.
    fn push(&mut self, c: Vec<Candidate>, tries: f64) -> usize {
        hrg_data::numeric::progress::step();
        let alone: Vec<Option<usize>> = c.iter().map(|part| self.alone(part)).collect();
        let mut columns: Vec<AxisByAxis<'_>> = c.iter().map(AxisByAxis::new).collect();
        for a in 0..AXES {
            let each: Option<Vec<Vec<usize>>> = alone
                .iter()
                .zip(&mut columns)
                .map(|(alone, columns)| match alone {
                    Some(k) => self.axes[a].columns_of(*k).map(<[usize]>::to_vec),
                    None => columns.on(self.data, a).map(|columns| self.axes[a].add_columns(columns)),
                })
                .collect();
            self.axes[a].push_group(each.map(|e| e.concat()));
        }
        self.candidates.push(c);
        self.tries.push(tries);
        self.candidates.len() - 1
    }

    /// The effect that gives a candidate its name.
    fn lead(&self, group: usize) -> Candidate {
        self.candidates[group][0]
    }

    fn card(&self, group: usize) -> Card {
        let mut card = card_of(self.lead(group).facts);
        if self.candidates[group].len() > 1 {
            card.kind = Kind::Family;
        }
        card
    }

    fn price(&self, group: usize, model: &[usize]) -> f64 {
        let class = self.card(group).class;
        let new = !model.iter().any(|m| self.card(*m).class == class);
        // Price each further event higher: an event that repeats again and again is rather something that comes back.
        let events = model.iter().filter(|m| self.card(**m).class == Class::Event).count();
        let once = if class == Class::Event { EVENT_PRICE * (1 + events) as f64 } else { 0.0 };
        PRICE + once + if new { CLASS_PRICE } else { 0.0 } + self.tries[group].max(1.0).ln()
    }

    /// Data of the search.
    pub fn data(&self) -> &'a Data<'a> {
        self.data
    }

    /// Best noise model of each axis under the baseline alone.
    pub fn noise_models_of_baseline(&self) -> [usize; AXES] {
        self.nothing().axes.map(|a| a.noise_model)
    }

    fn nothing(&self) -> State {
        let axes = [0, 1, 2].map(|a: usize| self.axes[a].best(&[]));
        State { groups: vec![], axes, p_values: vec![] }
    }

    /// Extensions of a model by each candidate: score, number, and the axes that have it with their variances; best first.
    fn extensions(&mut self, state: &State) -> Vec<(f64, usize, [Option<f64>; AXES])> {
        hrg_data::numeric::progress::step();
        let each: Vec<_> = (0..AXES).map(|a| self.axes[a].extensions(&state.axes[a])).collect();
        let mut out = Vec::new();
        for k in 0..self.candidates.len() {
            let effect = self.lead(k).facts.id;
            let there = |g: &usize| *g == k || (self.lead(*g).facts.id == effect && !self.card(k).repeats);
            if state.groups.iter().any(there) {
                continue;
            }
            let mut on = [None; AXES];
            let mut gain = -self.price(k, &state.groups);
            for a in 0..AXES {
                let Some(e) = each[a][k] else { continue };
                let more = e.evidence - state.axes[a].evidence - AXIS_PRICE;
                if more > 0.0 {
                    gain += more;
                    on[a] = Some(e.variance);
                }
            }
            out.push((gain, k, on));
        }
        out.sort_by(|x, y| y.0.total_cmp(&x.0));
        out
    }

    /// A model with a group added to some axes, all variances found anew.
    fn with(&mut self, state: &State, group: usize, on: &[Option<f64>; AXES]) -> State {
        let mut next = state.clone();
        for a in 0..AXES {
            if let Some(variance) = on[a] {
                let mut shares = state.axes[a].shares.clone();
                shares.push(Share { group, variance });
                let m = self.axes[a].best(&shares);
                // An axis that in the end gets nothing from it goes without.
                if m.evidence > state.axes[a].evidence + AXIS_PRICE {
                    next.axes[a] = m;
                }
            }
        }
        next.groups.push(group);
        next.p_values.push(None);
        next
    }

    /// The same, with the group's inner parameter refined.
    fn with_refined(&mut self, state: &State, group: usize, on: &[Option<f64>; AXES]) -> State {
        let next = self.with(state, group, on);
        self.refine(next, state.groups.len())
    }

    /// A model without its effect number `k`.
    fn without(&mut self, state: &State, k: usize) -> State {
        let mut next = state.clone();
        let group = next.groups.remove(k);
        next.p_values.remove(k);
        for a in 0..AXES {
            if state.axes[a].shares.iter().any(|s| s.group == group) {
                let shares: Vec<Share> = state.axes[a].shares.iter().filter(|s| s.group != group).copied().collect();
                next.axes[a] = self.axes[a].best(&shares);
            }
        }
        next
    }

    /// A model with another group in the place of effect `k`, on the axes that had it.
    fn instead(&mut self, state: &State, k: usize, group: usize) -> State {
        let mut next = state.clone();
        let old = std::mem::replace(&mut next.groups[k], group);
        for a in 0..AXES {
            let mut shares = state.axes[a].shares.clone();
            let Some(s) = shares.iter_mut().find(|s| s.group == old) else { continue };
            s.group = group;
            next.axes[a] = self.axes[a].best(&shares);
        }
        next
    }

    /// The best model.
    pub fn run(&mut self) -> Model {
        let nothing = self.nothing();
        let mut best = self.grow(nothing.clone());
        // A greedy start may need several effects to imitate the true one: restart from each of the best four.
        if best.groups.len() > 1 {
            // By evidence and by held-out error together.
            let mut most = self.total(&best) + self.held_out(&best);
            let mut tried = vec![self.lead(best.groups[0]).facts.id];
            let ranked = self.extensions(&nothing);
            for (gain, group, on) in &ranked {
                let effect = self.lead(*group).facts.id;
                if tried.contains(&effect) || *gain < LEAST.max(0.2 * ranked[0].0) || tried.len() > BEGUN {
                    continue;
                }
                tried.push(effect);
                let begun = self.with_refined(&nothing, *group, on);
                let grown = self.grow(begun);
                let net_evidence = self.total(&grown) + self.held_out(&grown);
                if net_evidence > most {
                    (most, best) = (net_evidence, grown);
                }
            }
        }
        let state = self.simplify(best);
        self.model(state)
    }

    /// Evidence of a model less all that its effects pay.
    fn total(&self, state: &State) -> f64 {
        let price = |k: usize| self.price(state.groups[k], &state.groups[..k]);
        state.net() - (0..state.groups.len()).map(price).sum::<f64>()
    }

    /// Adds effects until none pays.
    fn grow(&mut self, mut state: State) -> State {
        while state.groups.len() < MOST {
            self.propose(&state);
            let Some((score, mut next)) = self.step(&state) else { break };
            if score < PLAIN {
                let p = self.p_value(&state, score);
                if p > P_VALUE {
                    break;
                }
                if let Some(last) = next.p_values.last_mut() {
                    *last = Some(p);
                }
            }
            state = self.prune(next);
        }
        state
    }

    /// Adds what the residual of a model proposes.
    fn propose(&mut self, state: &State) {
        let mut proposed = Vec::new();
        let mut noise_models: Vec<[usize; AXES]> = vec![[0, 1, 2].map(|a: usize| state.axes[a].noise_model)];
        noise_models.extend([0, 4, 6].map(|s| [s; AXES]));
        for (k, noise_models) in noise_models.iter().enumerate() {
            let y = [0, 1, 2].map(|a: usize| self.axes[a].left(noise_models[a], &state.axes[a].shares));
            let mut y = y.into_iter();
            let left = [0, 1, 2].map(|a: usize| Left {
                noise_model: self.axes[a].noise_model(noise_models[a]),
                baseline: self.axes[a].baseline(noise_models[a]),
                y: y.next().unwrap_or_default(),
            });
            let jumps = proposals::jumps(self.data, &left);
            proposed.extend(proposals::shocks(&jumps));
            proposed.extend(jumps);
            if k == 0 || k == 2 {
                proposed.extend(proposals::periods(self.data, &left));
            }
        }
        let rows = self.data.axes.iter().map(|a| a.y.len()).max().unwrap_or(0) as f64;
        for c in proposed {
            if self.alone(&c).is_none() {
                let shapes = if c.facts.effect == EffectId::Shock { proposals::RECOVERIES_S.len() } else { 1 };
                self.push(vec![c], shapes as f64 * rows / 3.0);
            }
        }
    }

    /// The best extension of a model: its score and the model extended.
    fn step(&mut self, state: &State) -> Option<(f64, State)> {
        let ranked = self.extensions(state);
        let mut tried: Vec<(f64, State)> = Vec::new();
        let (mut effects, mut best, mut looks) = (Vec::new(), f64::NEG_INFINITY, 0);
        for (gain, group, on) in ranked.iter().filter(|e| e.0 > LEAST - 3.0) {
            let kind = self.card(*group).kind;
            // The best of all, and the best simple ones, as far as they come close.
            let alike = |t: &(f64, State)| (self.card(t.1.last()).kind == Kind::Simple) == (kind == Kind::Simple);
            if tried.iter().filter(|t| alike(t)).count() >= TRIED.div_ceil(2) || *gain < best - 30.0 || looks >= LOOKS {
                continue;
            }
            let own = (self.lead(*group).facts.id, self.candidates[*group].len());
            if effects.contains(&own) && kind != Kind::Proposed {
                continue;
            }
            effects.push(own);
            looks += 1;
            let next = self.with_refined(state, *group, on);
            let score = next.net() - state.net() - self.price(next.last(), &state.groups);
            // Reject candidates that predict held-out parts worse, except for events, which happen once.
            let event = self.card(next.last()).class == Class::Event;
            let least = if event { LEAST_EVENT } else { LEAST };
            if score > least && (event || self.held_out(&next) > self.held_out_under(state, &next)) {
                best = best.max(score);
                tried.push((score, next));
            }
        }
        tried.sort_by(|x, y| y.0.total_cmp(&x.0));
        let best = tried.first()?.0;
        // A simple member is preferred where it is as good, by evidence and by held-out error.
        let simple = |t: &(f64, State)| t.0 > best - SIMPLE && self.card(t.1.last()).kind == Kind::Simple;
        let as_good: Vec<usize> = (1..tried.len()).filter(|k| simple(&tried[*k])).collect();
        let top = &tried[0].1;
        let k = if as_good.is_empty() || self.card(top.last()).kind == Kind::Simple {
            0
        } else {
            let held_out = self.held_out(top);
            let fits = |k: &usize| self.held_out_under(&tried[*k].1, top) > held_out - SIMPLE;
            as_good.into_iter().find(fits).unwrap_or(0)
        };
        Some(tried.swap_remove(k))
    }

    /// Log likelihood of rows that the model did not see.
    fn held_out(&self, state: &State) -> f64 {
        (0..AXES).map(|a| self.axes[a].cross_validated(&state.axes[a])).sum()
    }

    /// The same of a smaller model, under the noise models of a larger one: so that they can be compared.
    fn held_out_under(&self, state: &State, larger: &State) -> f64 {
        hrg_data::numeric::progress::step();
        (0..AXES)
            .map(|a| {
                let noise_model = larger.axes[a].noise_model;
                self.axes[a].cross_validated(&AxisModel { noise_model, ..state.axes[a].clone() })
            })
            .sum()
    }

    fn p_value(&mut self, state: &State, score: f64) -> f64 {
        let price: Vec<f64> = (0..self.candidates.len()).map(|k| self.price(k, &state.groups)).collect();
        surrogate::p_value(&self.data.axes, &mut self.axes, &state.axes, self.seed, &price, AXIS_PRICE, score)
    }

    /// Takes out effects that another one has made needless.
    fn prune(&mut self, mut state: State) -> State {
        let mut k = 0;
        while state.groups.len() > 1 && k < state.groups.len() {
            let fewer = self.without(&state, k);
            let others: Vec<usize> = fewer.groups.clone();
            if state.net() - fewer.net() - self.price(state.groups[k], &others) < KEEP - PRICE {
                state = fewer;
                k = 0;
            } else {
                k += 1;
            }
        }
        state
    }

    /// Puts a simple member in the place of a family where it is as good.
    fn simplify(&mut self, mut state: State) -> State {
        for k in 0..state.groups.len() {
            let own = self.card(state.groups[k]);
            if !matches!(own.kind, Kind::Family | Kind::Searched) {
                continue;
            }
            let others = self.without(&state, k);
            let mut best: Option<(f64, State)> = None;
            let ranked = self.extensions(&others);
            let mut names = Vec::new();
            for (_, group, on) in ranked {
                let c = self.card(group);
                let effect = self.lead(group).facts.id;
                if c.class != own.class || c.kind != Kind::Simple || names.contains(&effect) || names.len() > 1 {
                    continue;
                }
                names.push(effect);
                let next = self.with_refined(&others, group, &on);
                let net_evidence = next.net() - self.price(next.last(), &others.groups);
                if best.as_ref().is_none_or(|b: &(f64, State)| net_evidence > b.0) {
                    best = Some((net_evidence, next));
                }
            }
            let now = state.net() - self.price(state.groups[k], &others.groups);
            let Some((net_evidence, mut next)) = best else { continue };
            if net_evidence > now - SIMPLE && self.held_out_under(&next, &state) > self.held_out(&state) - SIMPLE {
                // It stands where the family stood.
                let (group, _) = (next.groups.pop(), next.p_values.pop());
                if let Some(group) = group {
                    next.groups.insert(k, group);
                    next.p_values.insert(k, state.p_values[k]);
                }
                state = next;
            }
        }
        for k in 0..state.groups.len() {
            state = self.refine(state, k);
        }
        state
    }

    /// Evidence that each of some groups of columns adds to a model on one axis.
    pub fn evidence_of(&mut self, model: &Model, a: usize, groups: Vec<Vec<Vec<f64>>>) -> Vec<f64> {
        let count = self.candidates.len();
        for columns in groups {
            self.axes[a].push(Some(columns));
        }
        let state = &model.state.axes[a];
        let gains = self.axes[a].extensions(state).split_off(count);
        self.axes[a].truncate(count);
        gains.into_iter().map(|e| e.map_or(0.0, |e| e.evidence - state.evidence)).collect()
    }

    fn model(&self, state: State) -> Model {
        let members = state
            .groups
            .iter()
            .zip(&state.p_values)
            .map(|(&group, p_value)| Member {
                parts: self.candidates[group].clone(),
                prior: [0, 1, 2].map(|a: usize| self.prior(&state, group, a)),
                p_value: *p_value,
            })
            .collect();
        Model { members, noise_models: [0, 1, 2].map(|a: usize| state.axes[a].noise_model), state }
    }

    fn prior(&self, state: &State, group: usize, a: usize) -> Vec<f64> {
        let Some(share) = state.axes[a].shares.iter().find(|s| s.group == group) else { return vec![] };
        let columns = self.axes[a].columns_of(group).unwrap_or_default();
        columns.iter().map(|c| share.variance / self.axes[a].scale[*c].powi(2)).collect()
    }
}
