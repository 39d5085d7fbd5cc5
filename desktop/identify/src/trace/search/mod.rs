//! The search: which effects, with which parameters, on which axes.
//!
//! Candidates are the groups of the [cards](hrg_data::cards) and what the data propose (jumps and periods). A model has one score: its log
//! evidence under the noise ([`super::evidence`]) and the log prior odds of its effects ([`super::odds`]). The effect that raises it most is
//! added, its parameters refined, as long as it raises it by more than [`THRESHOLD`]; effects that lower it are taken out; another effect
//! takes the place of one where the score is higher.

use super::data::{AxisByAxis, Candidate, Data, Starts};
use super::evidence::{Axis, AxisModel, Part, Share, RAMP};
use super::model::{Specification, Term, TEMPERATURE_TERMS};
use super::odds::{self, THRESHOLD};
use super::proposals::{self, Left};
use crate::trace::user_effects::card_of;
use hrg_core::bias::TERMS;
use hrg_core::calibration::MAX_EFFECTS;
use hrg_core::effects::{EffectId, Reach};
use hrg_core::AXES;
use hrg_data::cards::Class;
use hrg_data::cards::{card, Card, Extent, Kind};

/// Most effects of a model.
pub const MOST: usize = 6;
/// Runs whose starts are searched.
const MOST_STARTS: usize = 6;
/// Candidates that are refined in each step.
const TRIED: usize = 6;

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
    /// Log prior odds beside the other effects, and log evidence that it brings.
    pub score: Score,
}

/// The two parts of the score of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Score {
    /// Log prior odds, the axes that have it included.
    pub log_prior: f64,
    /// Log evidence on the train runs.
    pub log_evidence: f64,
}

impl Score {
    /// Log posterior odds.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.log_prior + self.log_evidence
    }
}

/// A model: the baseline and some effects.
#[derive(Debug, Clone)]
pub struct Model {
    /// The effects.
    pub members: Vec<Member>,
    /// By axis: variance of the baseline's ramp terms about zero, over that of the whitened noise.
    pub ramp_prior: [Option<[f64; TERMS - TEMPERATURE_TERMS]>; AXES],
    state: State,
}

impl Model {
    /// The model, to be fitted.
    pub fn specification(&self) -> Specification {
        let term = |m: &Member| Term { parts: m.parts.clone(), prior: m.prior.clone() };
        Specification { terms: self.members.iter().map(term).collect(), ramp_prior: self.ramp_prior }
    }

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
}

impl State {
    fn evidence(&self) -> f64 {
        self.axes.iter().map(|a| a.evidence).sum()
    }

    /// The group that was added last.
    fn last(&self) -> usize {
        self.groups[self.groups.len() - 1]
    }

    /// Number of axes that have a group.
    fn width(&self, group: usize) -> usize {
        self.axes.iter().filter(|a| a.shares.iter().any(|s| s.group == group)).count()
    }
}

/// A model with some axes of another one.
fn merged(state: &State, other: &State, axes: &[usize]) -> State {
    let mut out = state.clone();
    axes.iter().for_each(|a| out.axes[*a] = other.axes[*a].clone());
    out.groups.extend(other.groups.iter().filter(|g| !state.groups.contains(g)));
    out.groups = out.groups.iter().copied().filter(|g| out.width(*g) > 0).collect();
    out
}

/// The search on one data set.
pub struct Search<'a> {
    data: &'a Data<'a>,
    axes: [Axis<'a>; AXES],
    extent: Extent,
    /// Each: an effect, or some that share one variance, the one that gives the name first.
    candidates: Vec<Vec<Candidate>>,
    /// Values of the parameter that were offered for each.
    tries: Vec<f64>,
    /// `true` for those that are tried as extensions: the library, and what the data propose in this step. What a refinement made is not.
    offered: Vec<bool>,
    /// Those that the data propose in this step.
    proposed: Vec<usize>,
    /// Starts of the plays, as far as the rates tell.
    begin: Starts,
    /// Axes that are searched.
    active: [bool; AXES],
    /// Set to search among effects that a unit can compute, and events.
    unit_only: bool,
    /// Set to search without the groups of one kind that may stand for several effects.
    without_kind: Option<Kind>,
    /// Effects that are not tried.
    barred: Vec<EffectId>,
}

impl<'a> Search<'a> {
    /// Prepares the candidates.
    pub fn new(data: &'a Data<'a>) -> Self {
        let axes = data.axes.each_ref().map(Axis::new);
        // (The first group of each axis is no candidate: the ramp terms of the baseline.)
        let mut s = Self {
            data,
            axes,
            extent: data.extent(),
            candidates: vec![vec![]],
            tries: vec![1.0],
            offered: vec![false],
            proposed: vec![],
            begin: Starts::default(),
            active: [true; AXES],
            unit_only: false,
            without_kind: None,
            barred: vec![],
        };
        let starts = s.starts();
        s.begin = starts;
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

    /// Leaves some effects out of the searches that come.
    pub fn bar(&mut self, effects: &[EffectId]) {
        self.barred.extend(effects);
    }

    /// Start states of the plays, as far as the rates tell beside the baseline: the middle unless a branch has evidence. (Ladders tried
    /// here stay among the candidates.)
    fn starts(&mut self) -> Starts {
        let (runs, alike) = (self.data.runs.len(), self.data.alike);
        let grid = (card(EffectId::PlayLadder).grid)(&self.extent);
        let Some(&parameters) = grid.first() else { return Starts::default() };
        let nothing = self.nothing();
        let mut net_evidence = |starts: Starts| {
            let c = Candidate::new(EffectId::PlayLadder, parameters).starting(starts);
            let group = self.alone(&c).unwrap_or_else(|| self.push(vec![c], Starts::BRANCHES.len() as f64));
            let all = self.extensions(&nothing);
            all.iter().find(|e| e.1 == group).map_or(f64::NEG_INFINITY, |e| e.0)
        };
        let middle = Starts::all(runs, 0);
        let mut best = (net_evidence(middle) - odds::branch(), middle);
        for branch in 1..Starts::BRANCHES.len() {
            let starts = Starts::all(runs, branch);
            let w = net_evidence(starts);
            if w > best.0 {
                best = (w, starts);
            }
        }
        for run in 0..if runs > 1 && !alike { runs.min(MOST_STARTS) } else { 0 } {
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
            let each: Option<Vec<Part>> = alone
                .iter()
                .zip(&mut columns)
                .map(|(alone, columns)| match alone {
                    Some(k) => self.axes[a].columns_of(*k).map(|k| Part::There(k.to_vec())),
                    None => columns.on(self.data, a).map(Part::New),
                })
                .collect();
            self.axes[a].push(each);
        }
        self.candidates.push(c);
        self.tries.push(tries);
        self.offered.push(true);
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

    /// Log prior odds of a group beside others, those of its axes left out.
    fn log_prior(&self, group: usize, others: &[usize]) -> f64 {
        let classes: Vec<Class> = others.iter().map(|g| self.card(*g).class).collect();
        odds::log_prior(&self.card(group), self.tries[group], &classes)
    }

    /// Data of the search.
    pub fn data(&self) -> &'a Data<'a> {
        self.data
    }

    fn nothing(&self) -> State {
        State { groups: vec![], axes: [0, 1, 2].map(|a: usize| self.axes[a].baseline_model()) }
    }

    /// Extensions of a model by each candidate: score, number, and the axes that have it with their variances; best first.
    fn extensions(&mut self, state: &State) -> Vec<(f64, usize, [Option<f64>; AXES])> {
        hrg_data::numeric::progress::step();
        let active = self.active;
        let within = |c: &Candidate| {
            (!self.unit_only || c.on_unit() || c.facts.reach == Reach::Unpredictable)
                && !self.barred.contains(&c.facts.effect)
        };
        let offered: Vec<bool> = (0..self.candidates.len())
            .map(|k| {
                let barred = k > RAMP && self.without_kind.is_some_and(|kind| self.stands_for_several(k) == Some(kind));
                self.offered[k] && !barred && self.candidates[k].iter().all(within)
            })
            .collect();
        let each: Vec<_> = (0..AXES)
            .map(|a| if active[a] { self.axes[a].extensions(&state.axes[a], &offered) } else { vec![] })
            .collect();
        let mut out = Vec::new();
        for k in (RAMP + 1..self.candidates.len()).filter(|k| offered[*k]) {
            let effect = self.lead(k).facts.id;
            let there = |g: &usize| *g == k || (self.lead(*g).facts.id == effect && !self.card(k).repeats);
            if state.groups.iter().any(there) {
                continue;
            }
            let mut on = [None; AXES];
            let mut score = self.log_prior(k, &state.groups);
            for a in (0..AXES).filter(|a| active[*a]) {
                let Some(e) = each[a][k] else { continue };
                let more = e.evidence - state.axes[a].evidence + odds::AXIS;
                if more > 0.0 {
                    score += more;
                    on[a] = Some(e.variance);
                }
            }
            out.push((score, k, on));
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
                if m.evidence + odds::AXIS > state.axes[a].evidence {
                    next.axes[a] = m;
                }
            }
        }
        next.groups.push(group);
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
        for a in 0..AXES {
            if state.axes[a].shares.iter().any(|s| s.group == group) {
                let left = state.axes[a].shares.iter().filter(|s| s.group != group);
                let shares: Vec<Share> = left.map(Share::free).collect();
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
            let shares: Vec<Share> = shares.iter().map(Share::free).collect();
            next.axes[a] = self.axes[a].best(&shares);
        }
        next
    }

    /// The best model: of all axes together, then of each axis alone, whichever has the higher score there.
    pub fn run(&mut self) -> Model {
        let nothing = self.nothing();
        let joint = self.grow(nothing.clone());
        let mut state = joint.clone();
        let there: Vec<usize> = (0..AXES).filter(|a| !self.data.axes[*a].y.is_empty()).collect();
        if !state.groups.is_empty() && there.len() > 1 {
            for a in there {
                self.active = [0, 1, 2].map(|k| k == a);
                let alone = self.grow(nothing.clone());
                let with = merged(&state, &alone, &[a]);
                if self.axis_score(&alone, a, &joint) > self.axis_score(&joint, a, &joint) && self.fits_an_image(&with)
                {
                    state = with;
                }
            }
            self.active = [true; AXES];
        }
        self.model(state)
    }

    /// The best model of what a unit can compute.
    pub fn run_for_unit(&mut self) -> Model {
        self.unit_only = true;
        let model = self.run();
        self.unit_only = false;
        model
    }

    /// The events of a model beside the baseline, their variances found anew.
    pub fn events_of(&mut self, model: &Model) -> Model {
        let mut state = model.state.clone();
        while let Some(k) = state.groups.iter().position(|g| self.lead(*g).facts.reach != Reach::Unpredictable) {
            state = self.without(&state, k);
        }
        self.model(state)
    }

    /// Contribution of an axis to the score of a model: an effect that other axes of `joint` have, with the same parameters, pays no more
    /// than the axis.
    fn axis_score(&self, state: &State, a: usize, joint: &State) -> f64 {
        let has = |s: &State, group: usize| s.axes[a].shares.iter().any(|x| x.group == group);
        let elsewhere = |group: usize| joint.width(group) > usize::from(has(joint, group));
        let of = |k: usize| {
            let group = state.groups[k];
            let prior = if elsewhere(group) { 0.0 } else { self.log_prior(group, &joint.groups) };
            odds::AXIS + prior
        };
        state.axes[a].evidence + (0..state.groups.len()).filter(|k| has(state, state.groups[*k])).map(of).sum::<f64>()
    }

    /// `true` if an image can hold a group beside the effects of a model.
    fn has_room(&self, state: &State, group: usize) -> bool {
        self.parts(state.groups.iter().copied().chain([group])) <= MAX_EFFECTS
    }

    /// Number of effects of some groups that a unit computes.
    fn parts(&self, groups: impl Iterator<Item = usize>) -> usize {
        groups.map(|g| self.candidates[g].iter().filter(|c| c.on_unit()).count()).sum()
    }

    /// `true` if an image can hold the effects of a model.
    fn fits_an_image(&self, state: &State) -> bool {
        self.parts(state.groups.iter().copied()) <= MAX_EFFECTS
    }

    /// Score of a model on the train runs: its log evidence, and the log prior odds of all of its effects.
    pub fn score_of(&self, model: &Model) -> f64 {
        self.score(&model.state)
    }

    /// The same of a state.
    fn score(&self, state: &State) -> f64 {
        let of = |k: usize| {
            let group = state.groups[k];
            self.log_prior(group, &state.groups[..k]) + odds::AXIS * state.width(group) as f64
        };
        state.evidence() + (0..state.groups.len()).map(of).sum::<f64>()
    }

    /// Adds effects until none raises the score by the threshold, and exchanges them until no other one is better in the place of one.
    fn grow(&mut self, mut state: State) -> State {
        for _ in 0..MOST {
            state = self.extended(state);
            let better = self.fewer(&state).or_else(|| self.exchange(&state)).or_else(|| self.named(&state));
            let Some(better) = better else { return state };
            state = self.prune(better);
        }
        state
    }

    /// Adds effects until none raises the score by the threshold.
    fn extended(&mut self, mut state: State) -> State {
        while state.groups.len() < MOST {
            self.propose(&state);
            // (Most models have one effect or two.)
            hrg_data::numeric::progress::reached(0.8 - 0.5 * 0.7f64.powi(1 + state.groups.len() as i32));
            let Some(next) = self.step(&state) else { break };
            state = self.prune(next);
        }
        state
    }

    /// `true` for a family of lags, plays or decays.
    fn is_family_with_state(&self, group: usize) -> bool {
        let card = self.card(group);
        card.kind == Kind::Family && matches!(card.class, Class::Memory | Class::Hysteresis | Class::PowerOn)
    }

    /// Its kind, if a group may stand for several effects at once: a family of lags, plays or decays, and what is searched among many.
    fn stands_for_several(&self, group: usize) -> Option<Kind> {
        let kind = self.card(group).kind;
        (kind == Kind::Searched || self.is_family_with_state(group)).then_some(kind)
    }

    /// A model in which other effects stand in the place of one that may stand for several at once, if its score is higher: no single one of
    /// them is better in its place.
    fn named(&mut self, state: &State) -> Option<State> {
        let now = self.score(state);
        let mut best: Option<(f64, State)> = None;
        for k in 0..state.groups.len() {
            let Some(kind) = self.stands_for_several(state.groups[k]) else { continue };
            self.without_kind = Some(kind);
            let others = self.without(state, k);
            let others = self.refine_all(others);
            let mut next = self.extended(others);
            while let Some(fewer) = self.fewer(&next) {
                next = self.extended(fewer);
            }
            let score = self.score(&next);
            if score > best.as_ref().map_or(now, |b| b.0) {
                best = Some((score, next));
            }
        }
        self.without_kind = None;
        best.map(|b| b.1)
    }

    /// A model without one of its effects, if its score is higher once the others have moved: the first ones were refined beside what
    /// they had to stand for.
    fn fewer(&mut self, state: &State) -> Option<State> {
        let now = self.score(state);
        (0..state.groups.len()).find_map(|k| {
            let fewer = self.without(state, k);
            let near = self.score(&fewer) > now - THRESHOLD * state.groups.len() as f64;
            let fewer = near.then(|| self.refine_all(fewer))?;
            (self.score(&fewer) > now).then_some(fewer)
        })
    }

    /// A model with another effect in the place of one, if its score is higher. (A model that needs as many effects as there may be is
    /// called unexplained; a family in it may stand for what a simple effect and another one are.)
    fn exchange(&mut self, state: &State) -> Option<State> {
        let now = self.score(state);
        let full = state.groups.len() >= MOST;
        let mut best: Option<(f64, State)> = None;
        for k in (0..state.groups.len())
            .filter(|k| !full || self.card(state.groups[*k]).kind == Kind::Family)
            .collect::<Vec<_>>()
        {
            let others = self.without(state, k);
            let own = now - self.score(&others);
            self.propose(&others);
            for next in self.refined_extensions(&others, 0.5 * own) {
                // (As much as that may be gained where the others move, too.)
                let near = self.score(&next) > now - THRESHOLD * state.groups.len() as f64;
                let next = if near { self.refine_all(next) } else { next };
                let score = self.score(&next);
                if score > best.as_ref().map_or(now, |b| b.0) {
                    best = Some((score, next));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Refines each effect of a model, the last one once more: what is new changes what the others stand for.
    fn refine_all(&mut self, mut state: State) -> State {
        for k in (0..state.groups.len()).chain(state.groups.len().checked_sub(1)) {
            state = self.refine(state, k);
        }
        state
    }

    /// Adds what the residual of a model proposes.
    fn propose(&mut self, state: &State) {
        // (What another model's residual proposed is stale.)
        for k in std::mem::take(&mut self.proposed) {
            self.offered[k] = false;
        }
        let mut proposed = Vec::new();
        let mut noise_models: Vec<[usize; AXES]> = vec![[0, 1, 2].map(|a: usize| state.axes[a].noise_model)];
        noise_models.extend([0, 6].map(|s| [s; AXES]));
        for (k, noise_models) in noise_models.iter().enumerate() {
            // (An axis that is not searched proposes nothing.)
            let left = |a: usize| {
                if !self.active[a] {
                    return vec![];
                }
                self.axes[a].left(noise_models[a], &state.axes[a].shares)
            };
            let mut y = [left(0), left(1), left(2)].into_iter();
            let left = [0, 1, 2].map(|a: usize| Left {
                noise_model: noise_models[a],
                steps: self.axes[a].steps(noise_models[a]),
                y: y.next().unwrap_or_default(),
            });
            let jumps = proposals::jumps(self.data, &left);
            proposed.extend(proposals::shocks(&jumps));
            let relays = proposals::relays(self.data, &jumps, &left);
            proposed.extend(relays.into_iter().map(|c| c.starting(self.begin)));
            proposed.extend(jumps);
            if k < 2 {
                proposed.extend(proposals::periods(self.data, &left));
            }
        }
        let rows = self.data.axes.iter().map(|a| a.y.len()).max().unwrap_or(0) as f64;
        let extent = self.extent;
        for c in proposed.into_iter().filter(|c| (card_of(c.facts).possible)(&c.parameters, &extent)) {
            let k = match self.alone(&c) {
                Some(k) if self.offered[k] => continue,
                Some(k) => {
                    self.offered[k] = true;
                    k
                }
                None => {
                    let moment = rows / 3.0;
                    let tries = match c.facts.effect {
                        EffectId::Shock => moment * proposals::RECOVERIES_S.len() as f64,
                        EffectId::Relay => moment * moment,
                        _ => moment,
                    };
                    self.push(vec![c], tries)
                }
            };
            self.proposed.push(k);
        }
    }

    /// The best extension of a model; `None` where none passes the threshold.
    fn step(&mut self, state: &State) -> Option<State> {
        self.best_step(state, 0.0).filter(|(more, _)| *more > THRESHOLD).map(|(_, next)| next)
    }

    /// The extension of a model that raises its score most, among those that raise it by more than `least` before they are refined.
    fn best_step(&mut self, state: &State, least: f64) -> Option<(f64, State)> {
        let now = self.score(state);
        let scored = self.refined_extensions(state, least).into_iter().map(|next| (self.score(&next) - now, next));
        scored.max_by(|x, y| x.0.total_cmp(&y.0))
    }

    /// The score that the first step finds, whatever it is.
    pub fn first_score(&mut self) -> f64 {
        let nothing = self.nothing();
        self.propose(&nothing);
        self.best_step(&nothing, f64::NEG_INFINITY).map_or(f64::NEG_INFINITY, |(more, _)| more)
    }

    /// The most promising extensions of a model whose score is above `least` before they are refined: one of each effect, two of each kind
    /// that the data propose.
    fn refined_extensions(&mut self, state: &State, least: f64) -> Vec<State> {
        let mut of_effect: Vec<(u16, usize)> = Vec::new();
        let mut out = Vec::new();
        for (score, group, on) in self.extensions(state) {
            let own = (self.lead(group).facts.id, self.candidates[group].len());
            let most = if self.card(group).kind == Kind::Proposed { 2 } else { 1 };
            if score <= least || out.len() >= TRIED {
                break;
            }
            // (A model that no image holds would be cut when it is written.)
            if of_effect.iter().filter(|e| **e == own).count() < most && self.has_room(state, group) {
                of_effect.push(own);
                out.push(self.with_refined(state, group, &on));
            }
        }
        out
    }

    /// Takes out effects that lower the score: another one has made them needless.
    fn prune(&mut self, mut state: State) -> State {
        let mut k = 0;
        while state.groups.len() > 1 && k < state.groups.len() {
            let fewer = self.without(&state, k);
            if self.score(&fewer) > self.score(&state) {
                state = fewer;
                k = 0;
            } else {
                k += 1;
            }
        }
        state
    }

    /// Evidence that each of some groups of columns adds to a model on one axis.
    pub fn evidence_of(&mut self, model: &Model, a: usize, groups: Vec<Vec<Vec<f64>>>) -> Vec<f64> {
        self.evidence_beside(&model.state.axes[a], a, groups)
    }

    fn evidence_beside(&mut self, model: &AxisModel, a: usize, groups: Vec<Vec<Vec<f64>>>) -> Vec<f64> {
        let (count, more) = (self.candidates.len(), groups.len());
        for columns in groups {
            self.axes[a].push(Some(vec![Part::New(columns)]));
        }
        let mut offered = vec![false; count];
        offered.resize(count + more, true);
        let gains = self.axes[a].extensions(model, &offered).split_off(count);
        self.axes[a].truncate(count);
        gains.into_iter().map(|e| e.map_or(0.0, |e| e.evidence - model.evidence)).collect()
    }

    /// Evidence that each of some groups of columns adds to a model on one axis in the place of the baseline's ramp terms.
    fn evidence_of_ramps(&mut self, model: &AxisModel, a: usize, groups: Vec<Vec<Vec<f64>>>) -> Vec<f64> {
        let count = self.candidates.len();
        let axis = &mut self.axes[a];
        let mut gain = |columns| {
            axis.push(Some(vec![Part::New(columns)]));
            let shares =
                model.shares.iter().map(|s| Share { group: if s.group == RAMP { count } else { s.group }, ..s.free() });
            let gain = axis.best(&shares.collect::<Vec<_>>()).evidence - model.evidence;
            axis.truncate(count);
            gain
        };
        groups.into_iter().map(&mut gain).collect()
    }

    fn model(&mut self, state: State) -> Model {
        let members = (0..state.groups.len())
            .map(|k| {
                let group = state.groups[k];
                let fewer = self.without(&state, k);
                let log_prior = self.log_prior(group, &fewer.groups) + odds::AXIS * state.width(group) as f64;
                Member {
                    parts: self.candidates[group].clone(),
                    prior: [0, 1, 2].map(|a: usize| self.prior(&state, group, a)),
                    score: Score { log_prior, log_evidence: state.evidence() - fewer.evidence() },
                }
            })
            .collect();
        Model { members, ramp_prior: self.ramp_prior(&state), state }
    }

    fn ramp_prior(&self, state: &State) -> [Option<[f64; TERMS - TEMPERATURE_TERMS]>; AXES] {
        [0, 1, 2].map(|a: usize| self.prior(state, RAMP, a).try_into().ok())
    }

    fn prior(&self, state: &State, group: usize, a: usize) -> Vec<f64> {
        let Some(share) = state.axes[a].shares.iter().find(|s| s.group == group) else { return vec![] };
        let columns = self.axes[a].columns_of(group).unwrap_or_default();
        columns.iter().map(|c| share.variance / self.axes[a].scale[*c].powi(2)).collect()
    }
}
