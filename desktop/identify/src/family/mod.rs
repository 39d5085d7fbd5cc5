//! Common properties of the units of one design, learnt from recordings of some of them, for the next one.
//!
//! A family is a model (centre and scale, effects with their parameters) and, by axis, the distribution of its coefficients over the units and from day
//! to day ([`population`]). Its effects are found on units side by side, each with a baseline of its own, by the search and the score of
//! [`crate::trace`]: what is there in all of them adds its evidence up. A unit is then fitted under that distribution ([`member`]), as far as it belongs
//! to the design, and the next chamber run is chosen by what it is expected to tell ([`design`]).

pub mod design;
mod file;
pub mod member;
pub mod population;

pub use file::{AxisFacts, FamilyTerm, NoiseFacts, Part, Source, SourceRun};

use crate::fit::independence::Units;
use crate::fit::{prepare_for, prepare_of_design, scaling, states_of, Prepared};
use crate::matrices::symmetric;
use crate::thermometer::curve::DesignCurve;
use crate::trace::data::{Candidate, Data, Starts};
use crate::trace::model::{Specification, Term};
use crate::trace::noise::NOISE_MODELS;
use crate::trace::odds;
use crate::trace::regression::{posterior, under_each, Under};
use crate::trace::search::Search;
use hrg_core::bias::{Scaling, TERMS};
use hrg_core::effects::EffectId;
use hrg_core::temperature::TemperatureCurve;
use hrg_core::visited::{Ranges, Visited, LEVELS, TEMPERATURES};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::side_by_side;
use hrg_data::numeric::stats::{dot, log_sum, median};
use hrg_data::recording::names;
use hrg_data::recording::steps::Run;
use hrg_data::recording::Recording;
use member::Evidence;
use nalgebra::DVector;
use population::{OfRun, OfUnit, Population};

/// Units on which the effects are searched together, at most: what a dozen do not show, a hundred do not need, and rows in memory grow with them.
const SEARCHED: usize = 12;

/// Effects that the units may share.
struct Proposal {
    terms: Vec<FamilyTerm>,
    /// By axis, the variance that each gain may have at all, by the evidence of the search.
    variances_dph2: [Vec<f64>; AXES],
}

/// Comparison of models of a family: first the axes of runs that a model is held down by (a short run may hold a small one and not a large one), then
/// the log density of the units that were left out.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
struct Score {
    told: usize,
    log: f64,
}

/// Facts of a run about an axis.
struct Told {
    of_run: OfRun,
    /// Log density of its rates, whitened, where all coefficients are zero: what `of_run` does not hold.
    log_of_nothing: f64,
    noise: NoiseFacts,
    /// Log likelihood of each noise model.
    noise_models: [f64; NOISE_MODELS.len()],
    visited: States,
}

/// An axis of a run under a model of which nothing is known: its columns, and the posterior under each noise model with its log likelihood.
struct UnderModel {
    columns: Vec<Vec<f64>>,
    each: Vec<(f64, Under)>,
}

impl UnderModel {
    fn new(data: &Data<'_>, model: &Specification, a: usize) -> Self {
        let rows = &data.axes[a];
        let columns = if rows.y.is_empty() { Vec::new() } else { model.columns(data, a).values };
        let each = under_each(rows, &columns, &vec![None; columns.len()]);
        Self { columns, each }
    }

    /// Log likelihood, zero for an axis that the unit does not have.
    fn log(&self) -> f64 {
        let each: Vec<f64> = self.each.iter().map(|e| e.0).collect();
        if each.is_empty() {
            0.0
        } else {
            log_sum(&each)
        }
    }
}

/// Runs with the way in which each of them begins.
struct Begun<'r> {
    /// Log prior odds of these beginnings.
    odds: f64,
    /// The model.
    specification: Specification,
    /// The rows.
    data: Data<'r>,
    /// The runs that begin in a state of which nothing is known.
    unknown_past: Vec<usize>,
}

/// A family.
#[derive(Debug, Clone)]
pub struct Family {
    /// Name of the design.
    pub name: String,
    /// The units that it was learnt from.
    pub sources: Vec<Source>,
    /// The earth's rate was taken off the rates that it was learnt from, so it is not in the constants of its units.
    pub without_earth_rate: bool,
    /// Centre and scale of its model.
    pub scaling: Scaling,
    /// Its effects.
    pub terms: Vec<FamilyTerm>,
    /// Temperatures that its units visited, C.
    pub temperatures_c: [f32; 2],
    /// Fastest cooling and heating of the resonators, C per minute.
    pub ramps_c_per_min: [f32; 2],
    /// Time constant by which its resonators follow their cases, s.
    pub lag_s: f64,
    /// Third of the blocks into which its runs were cut, s: the noise models of an axis count blocks.
    pub coarse_s: usize,
    /// The axes; `None`: its units do not have it.
    pub axes: [Option<OfAxis>; AXES],
}

/// One axis of a family.
#[derive(Debug, Clone)]
pub struct OfAxis {
    /// Distribution of the coefficients: the baseline's, then the gains of each effect that the axis has.
    pub population: Population,
    /// Noise of its units: medians.
    pub noise: NoiseFacts,
    /// Share of its runs that each noise model of [`NOISE_MODELS`] stands for.
    pub noise_models: [f64; NOISE_MODELS.len()],
    /// States that its runs visited together.
    pub visited: States,
    /// Temperature by frequency; `None` where its thermometers are sensors.
    pub curve: Option<DesignCurve>,
}

/// Temperatures and ramps that were visited together, on the grid of a map ([`Visited`]).
#[derive(Debug, Clone, PartialEq)]
pub struct States {
    /// Ranges of the grid.
    pub ranges: Ranges,
    /// The map.
    pub map: Visited,
}

impl States {
    fn new(ranges: Ranges, run: &Run, a: usize) -> Self {
        let mut map = Visited::none();
        states_of(run, a).for_each(|(t, r)| map.visit(&ranges, t, r));
        Self { ranges, map }
    }

    /// Adds those of another map on the same grid.
    fn add(&mut self, other: &Self) {
        for (own, more) in self.map.visited_levels.iter_mut().zip(other.map.visited_levels) {
            *own = (*own & 0xF).min(more & 0xF) | (*own >> 4).max(more >> 4) << 4;
        }
    }

    /// The states in the middles of the entries that were visited: temperature, C, and ramp, C per minute.
    pub fn each(&self) -> impl Iterator<Item = (f32, f32)> + '_ {
        let places = (0..TEMPERATURES).flat_map(|entry| (0..LEVELS).map(move |level| (entry, level)));
        let visited = |(entry, level): &(usize, usize)| {
            let levels = usize::from(self.map.visited_levels[*entry]);
            (levels & 0xF..=levels >> 4).contains(level)
        };
        places.filter(visited).map(|(entry, level)| self.ranges.middle(entry, level))
    }
}

/// A unit that is not in the family.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Its name.
    pub unit: String,
    /// The reason.
    pub why: String,
}

/// A unit that a family of the others would not take for its own: a bad recording, or a unit of another design.
#[derive(Debug, Clone, PartialEq)]
pub struct Unlike {
    /// Its name.
    pub unit: String,
    /// The axis on which it differs the most.
    pub axis: usize,
    /// Natural logarithm of the odds there of a family of the other units against what its runs say by themselves.
    pub log_odds: f64,
}

impl Unlike {
    /// A sentence about it.
    #[must_use]
    pub fn sentence(&self) -> String {
        format!(
            "it is not like the others, axis {} above all (natural logarithm of the odds {:+.0}): look at its recordings; it may be of another design",
            AXIS_NAMES[self.axis], self.log_odds
        )
    }
}

/// A family as it comes from its units.
#[derive(Debug, Clone)]
pub struct Learnt {
    /// The family.
    pub family: Family,
    /// Units whose runs could not be used, or that the others do not resemble.
    pub left_out: Vec<LeftOut>,
    /// Units that the others do not resemble and that are in it all the same: without them it would be one of half of the units.
    pub unlike: Vec<Unlike>,
}

/// The recordings of one unit, made ready.
struct Ready {
    unit: String,
    prepared: Prepared,
    runs: Vec<SourceRun>,
}

impl Ready {
    fn shares_data_with(&self, other: &Self) -> bool {
        self.runs.iter().any(|r| other.runs.iter().any(|o| o.crc32 == r.crc32))
    }
}

fn ready(recordings: &[Recording]) -> Result<Ready, LeftOut> {
    let unit = recordings.first().map_or("", Recording::unit).to_string();
    let prepared = prepare_for(recordings, Units::Same).map_err(|e| LeftOut { unit: unit.clone(), why: e.0 })?;
    let runs = recordings
        .iter()
        .zip(&prepared.runs)
        .map(|(r, run)| SourceRun {
            file: r.source.clone(),
            hours: run.steps.len() as f64 / 3600.0,
            crc32: format!("{:08x}", crate::fit::data_crc32(std::slice::from_ref(r))),
        })
        .collect();
    Ok(Ready { unit, prepared, runs })
}

/// Recordings by their units, in the order in which these come first. A recording without a unit's name is a unit of its own.
#[must_use]
pub fn by_unit(recordings: Vec<Recording>) -> Vec<Vec<Recording>> {
    let mut units: Vec<Vec<Recording>> = Vec::new();
    for r in recordings {
        let own = (r.unit() != names::NONE).then(|| units.iter().position(|u| u[0].unit() == r.unit())).flatten();
        match own {
            Some(k) => units[k].push(r),
            None => units.push(vec![r]),
        }
    }
    units
}

impl Family {
    /// Learns a family from the recordings of its units. Units that cannot be used are left out, and named, one after the other so are those that a family of
    /// the others would not take for its own, as long as more than half of the units remain.
    ///
    /// # Errors
    /// One sentence: too few units.
    pub fn learn(name: &str, units: Vec<Vec<Recording>>) -> Result<Learnt, BadInput> {
        let without_earth_rate = alike(units.iter().flatten())?;
        let (mut there, mut left_out): (Vec<Ready>, Vec<LeftOut>) = (Vec::new(), Vec::new());
        for unit in side_by_side::each(units, |u| ready(&u)) {
            match unit {
                Ok(unit) => match there.iter().find(|u| u.shares_data_with(&unit)) {
                    Some(known) => {
                        let why = format!("a recording of it has the same data as one of the unit {}", known.unit);
                        left_out.push(LeftOut { unit: unit.unit, why });
                    }
                    None => there.push(unit),
                },
                Err(why) => left_out.push(why),
            }
        }
        if there.len() < population::FEWEST {
            let why = left_out.first().map_or(String::new(), |l| format!("; {} was left out: {}", l.unit, l.why));
            return Err(BadInput(format!(
                "a family needs {} units at the least, here are {} that can be used{why}",
                population::FEWEST,
                there.len()
            )));
        }
        let fewest = population::FEWEST.max(there.len() / 2 + 1);
        loop {
            let family = Self::of(name, without_earth_rate, &there)?;
            let unlike = family.unlike(&there);
            // (One bad unit has good ones look bad: the worst goes first.)
            let worst = unlike.iter().min_by(|x, y| x.1.log_odds.total_cmp(&y.1.log_odds));
            let Some((place, worst)) = worst.filter(|_| there.len() > fewest) else {
                let unlike = unlike.into_iter().map(|(_, u)| u).collect();
                return Ok(Learnt { family, left_out, unlike });
            };
            left_out.push(LeftOut { unit: worst.unit.clone(), why: worst.sentence() });
            there.remove(*place);
        }
    }

    /// The family of units that are ready.
    fn of(name: &str, without_earth_rate: bool, there: &[Ready]) -> Result<Self, BadInput> {
        let fold = |of: fn(&Prepared, usize) -> [f32; 2]| {
            let all = there.iter().flat_map(|r| present(&r.prepared).map(move |a| of(&r.prepared, a)));
            all.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], [low, high]| [l.min(low), h.max(high)])
        };
        let temperatures_c =
            fold(|p, a| [p.calibration.axes[a].curve.valid_from_c, p.calibration.axes[a].curve.valid_to_c]);
        let ramps_c_per_min =
            fold(|p, a| [p.calibration.axes[a].valid_from_c_per_min, p.calibration.axes[a].valid_to_c_per_min]);
        let fastest = ramps_c_per_min[1].max(-ramps_c_per_min[0]);
        let mut lengths: Vec<f64> =
            there.iter().flat_map(|r| r.prepared.runs.iter().map(|run| run.steps.len() as f64)).collect();
        let mut lags: Vec<f64> = there.iter().map(|r| r.prepared.mean_lag_s()).collect();
        let family = Self {
            name: name.to_string(),
            sources: there.iter().map(|r| Source { unit: r.unit.clone(), runs: r.runs.clone() }).collect(),
            without_earth_rate,
            scaling: scaling((temperatures_c[0], temperatures_c[1]), fastest),
            terms: Vec::new(),
            temperatures_c,
            ramps_c_per_min,
            lag_s: median(&mut lags).unwrap_or(0.0),
            coarse_s: Data::coarse_s(median(&mut lengths).unwrap_or(0.0) as usize),
            axes: [None, None, None],
        };
        let curves: [Option<DesignCurve>; AXES] = std::array::from_fn(|a| {
            let with = there.iter().filter(|r| present(&r.prepared).any(|p| p == a));
            let each: Vec<TemperatureCurve> = with.map(|r| r.prepared.calibration.axes[a].curve).collect();
            let resonators = each.iter().all(|c| !c.is_of_sensor());
            // (A unit of a short run knows too little of its curve.)
            let span = |c: &TemperatureCurve| f64::from(c.valid_to_c - c.valid_from_c);
            let usual = median(&mut each.iter().map(span).collect::<Vec<_>>()).unwrap_or(0.0);
            let each: Vec<TemperatureCurve> = each.into_iter().filter(|c| span(c) > 0.5 * usual).collect();
            // (Where all of them have been.)
            let low_c = each.iter().map(|c| c.valid_from_c).fold(f32::NEG_INFINITY, f32::max);
            let high_c = each.iter().map(|c| c.valid_to_c).fold(f32::INFINITY, f32::min);
            resonators.then(|| DesignCurve::of(&each, [low_c + 0.5, high_c - 0.5].map(f64::from))).flatten()
        });
        // Of the effects that are proposed those that best predict units which were left out.
        let proposals = family.proposals(there);
        let mut best: Option<(Score, Self)> = None;
        let mut why = None;
        for proposal in &proposals {
            match family.with(proposal, there, curves) {
                Ok((score, with)) if best.as_ref().is_none_or(|b| score > b.0) => best = Some((score, with)),
                Ok(_) => {}
                Err(e) => why = why.or(Some(e)),
            }
        }
        match (best, why) {
            (Some((_, family)), _) => Ok(family),
            (None, why) => Err(why.unwrap_or_else(|| BadInput::new("no model holds the units' runs"))),
        }
    }

    /// The units that the others do not resemble, by the odds of [`member::Member::belongs`], each with its place.
    fn unlike(&self, units: &[Ready]) -> Vec<(usize, Unlike)> {
        let of = |(k, unit): (usize, &Ready)| {
            let odds = |a: usize| self.axes[a].as_ref().and_then(|x| x.population.log_odds.get(k).copied());
            let each = (0..AXES).filter_map(|a| Some((a, odds(a)?))).filter(|(_, odds)| odds.is_finite());
            let (axis, log_odds) = each.min_by(|x, y| x.1.total_cmp(&y.1))?;
            let belongs = Evidence { family: log_odds, own: 0.0 }.belongs(present(&unit.prepared).count());
            (!belongs).then(|| (k, Unlike { unit: unit.unit.clone(), axis, log_odds }))
        };
        units.iter().enumerate().filter_map(of).collect()
    }

    /// Effects that units side by side share: one run of each, the longest, and a baseline of each. First what the search finds, then the same with families
    /// in the place of effects of their class.
    fn proposals(&self, units: &[Ready]) -> Vec<Proposal> {
        let every = units.len().div_ceil(SEARCHED);
        let longest = |r: &Ready| r.prepared.runs.iter().max_by_key(|run| run.steps.len()).cloned();
        let runs: Vec<Run> = units.iter().step_by(every).filter_map(longest).collect();
        let data = Data::of_units(&runs, self.scaling, self.lag_s);
        let mut search = Search::new(&data);
        let found = search.run_for_unit();
        let others = search.with_families(&found);
        let mut out: Vec<Proposal> = Vec::new();
        for proposal in std::iter::once(&found).chain(&others).map(|m| Proposal::of(&m.specification(), &data)) {
            if out.iter().all(|p| p.terms != proposal.terms) {
                out.push(proposal);
            }
        }
        out
    }

    /// The family with these effects, and its score.
    fn with(
        &self,
        proposal: &Proposal,
        units: &[Ready],
        curves: [Option<DesignCurve>; AXES],
    ) -> Result<(Score, Self), BadInput> {
        let mut family = Self { terms: proposal.terms.clone(), ..self.clone() };
        let specification = family.specification();
        let told = side_by_side::each(units.iter().collect(), |r: &Ready| {
            let of_run = |run: &Run| family.told(&specification, run);
            r.prepared.runs.iter().map(of_run).collect::<Vec<_>>()
        });
        let learnt =
            side_by_side::each(vec![0, 1, 2], |a| family.axis(&told, a, &proposal.variances_dph2[a], curves[a]));
        for (axis, to) in learnt.into_iter().zip(&mut family.axes) {
            *to = axis?;
        }
        let told: Vec<&Told> = told.iter().flatten().flatten().flatten().collect();
        let of_noise = told.iter().map(|t| t.log_of_nothing).sum::<f64>();
        let of_units = family.axes.iter().flatten().map(|a| a.population.left_out).sum::<f64>();
        Ok((Score { told: told.len(), log: of_noise + of_units }, family))
    }

    /// Makes the recordings of a unit ready for [`Self::member`]: its temperatures are those of the highest probability under the family's curves and
    /// its own sensors.
    ///
    /// # Errors
    /// As [`prepare_for`]; rates with the earth's rate in them where the family's are without, or the other way: constants could not be compared.
    pub fn prepare(&self, recordings: &[Recording], units: Units) -> Result<Prepared, BadInput> {
        let with = |without: bool| if without { "without" } else { "with" };
        if let Some(r) = recordings.iter().find(|r| r.without_earth_rate() != self.without_earth_rate) {
            return Err(BadInput(format!(
                "the rates of the family {} are {} the earth's rate, those of {} {} it: {}",
                self.name,
                with(self.without_earth_rate),
                r.source_or("this unit"),
                with(r.without_earth_rate()),
                if self.without_earth_rate {
                    "give --latitude and --axes"
                } else {
                    "leave --latitude and --axes out, or learn a family from recordings that state theirs"
                }
            )));
        }
        let mut prepared =
            prepare_of_design(recordings, units, &self.axes.each_ref().map(|a| a.as_ref().and_then(|a| a.curve)))?;
        prepared.calibration.scaling = self.scaling;
        prepared.coarse_s = Some(self.coarse_s);
        Ok(prepared)
    }

    /// Its model, to be fitted.
    #[must_use]
    pub fn specification(&self) -> Specification {
        let terms = self.terms.iter().filter_map(FamilyTerm::term).collect();
        Specification { terms, ramp_prior: [None; AXES] }
    }

    /// A run in the family's blocks.
    fn blocks<'r>(&self, run: &'r Run) -> Data<'r> {
        Data::in_blocks(std::slice::from_ref(run), self.scaling, self.lag_s, self.coarse_s)
    }

    /// Other ways for one run to begin, as of a unit that comes from elsewhere: all plays in the middle or on one branch, or in a state of which nothing
    /// is known.
    fn beginnings<'r>(&self, known: &Begun<'r>, run: usize) -> Vec<Begun<'r>> {
        let Begun { odds, specification, data, unknown_past } = known;
        let odds = odds + odds::branch();
        let plays = || specification.terms.iter().flat_map(|t| &t.parts).filter(|c| c.facts.remembers_path);
        let differs = |branch: &usize| plays().any(|c| c.starts.of(Some(run)) != Starts::BRANCHES[*branch]);
        let elsewhere = (0..Starts::BRANCHES.len()).filter(differs).map(|branch| Begun {
            odds,
            specification: specification.beginning(run, branch),
            data: data.clone(),
            unknown_past: unknown_past.clone(),
        });
        let unknown = Begun {
            odds,
            specification: specification.clone(),
            data: data.clone().with_unknown_past(run),
            unknown_past: unknown_past.iter().copied().chain([run]).collect(),
        };
        elsewhere.chain([unknown]).collect()
    }

    /// Facts of a run about each axis, the run begun where it is the most probable.
    fn told(&self, specification: &Specification, run: &Run) -> [Option<Told>; AXES] {
        let as_in_family =
            Begun { odds: 0.0, specification: specification.clone(), data: self.blocks(run), unknown_past: Vec::new() };
        let others = self.beginnings(&as_in_family, 0);
        let begun = std::iter::once(as_in_family).chain(others).map(|b| {
            let axes = [0, 1, 2].map(|a: usize| UnderModel::new(&b.data, &b.specification, a));
            (b.odds + axes.iter().map(UnderModel::log).sum::<f64>(), b.data, axes)
        });
        match begun.max_by(|x, y| x.0.total_cmp(&y.0)) {
            Some((_, data, [x, y, z])) => {
                [self.told_of(&data, 0, x), self.told_of(&data, 1, y), self.told_of(&data, 2, z)]
            }
            None => [None, None, None],
        }
    }

    /// The same of one axis.
    fn told_of(&self, data: &Data<'_>, a: usize, UnderModel { columns, each }: UnderModel) -> Option<Told> {
        let rows = &data.axes[a];
        let mut noise_models = [f64::NEG_INFINITY; NOISE_MODELS.len()];
        for (log, u) in &each {
            noise_models[u.noise_model] = log - NOISE_MODELS[u.noise_model].log_prior();
        }
        let (_, best) = each.into_iter().max_by(|x, y| x.0.total_cmp(&y.0))?;
        let white = |x: &Vec<f64>| rows.filters.whitened(best.noise_model, x);
        let (x, y) = (columns.iter().map(white).collect::<Vec<_>>(), white(&rows.y));
        let p = x.len();
        let information = symmetric(p, |i, j| dot(&x[i], &x[j]) / best.variance_dph2);
        let product = DVector::from_fn(p, |i, _| dot(&x[i], &y) / best.variance_dph2);
        let noise = NOISE_MODELS[best.noise_model];
        let white_dph2 = best.variance_dph2 / noise.innovation();
        let facts = NoiseFacts {
            white_dph2_s: white_dph2 * data.block_s as f64,
            slow_dph2: noise.slow * white_dph2,
            slow_s: data.block_s as f64 / (1.0 - noise.phi).max(1e-6),
        };
        let ranges = Ranges {
            from_c: self.temperatures_c[0],
            to_c: self.temperatures_c[1],
            from_c_per_min: self.ramps_c_per_min[0],
            to_c_per_min: self.ramps_c_per_min[1],
        };
        let visited = States::new(ranges, data.runs.first()?, a);
        let (n, v) = (y.len() as f64, best.variance_dph2);
        let log_of_nothing = rows.filters.log_determinant(best.noise_model)
            - 0.5 * (n * (2.0 * std::f64::consts::PI * v).ln() + dot(&y, &y) / v);
        let of_run = OfRun { information, product, rows: y.len() };
        Some(Told { of_run, log_of_nothing, noise: facts, noise_models, visited })
    }

    /// The distribution of an axis over the units. `None` where no unit has it.
    fn axis(
        &self,
        told: &[Vec<[Option<Told>; AXES]>],
        a: usize,
        variances_dph2: &[f64],
        curve: Option<DesignCurve>,
    ) -> Result<Option<OfAxis>, BadInput> {
        let of_unit = |unit: &Vec<[Option<Told>; AXES]>| OfUnit {
            runs: unit.iter().filter_map(|r| r[a].as_ref().map(|r| r.of_run.clone())).collect(),
        };
        let all: Vec<OfUnit> = told.iter().map(of_unit).collect();
        let units: Vec<OfUnit> = all.iter().filter(|u| !u.runs.is_empty()).cloned().collect();
        let runs: Vec<&Told> = told.iter().flatten().filter_map(|r| r[a].as_ref()).collect();
        let Some(first) = runs.first() else { return Ok(None) };
        let mut population = Population::learn(&units, variances_dph2).ok_or_else(|| {
            BadInput(format!(
                "axis {}: {} units are too few for a family, or their runs do not hold its model down",
                AXIS_NAMES[a],
                units.len()
            ))
        })?;
        // (One number for each unit, whether it has this axis or not.)
        let mut odds = population.log_odds.into_iter();
        let of_one = |u: &OfUnit| if u.runs.is_empty() { None } else { odds.next() }.unwrap_or(f64::NAN);
        population.log_odds = all.iter().map(of_one).collect();
        let of = |f: fn(&NoiseFacts) -> f64| {
            median(&mut runs.iter().map(|r| f(&r.noise)).collect::<Vec<_>>()).unwrap_or(0.0)
        };
        let noise = NoiseFacts {
            white_dph2_s: of(|n| n.white_dph2_s),
            slow_dph2: of(|n| n.slow_dph2),
            slow_s: of(|n| n.slow_s),
        };
        let noise_models = shares(&runs);
        let mut visited = first.visited.clone();
        runs.iter().for_each(|r| visited.add(&r.visited));
        Ok(Some(OfAxis { population, noise, noise_models, visited, curve }))
    }

    /// Names of the coefficients of an axis.
    #[must_use]
    pub fn coefficients(&self, a: usize) -> Vec<String> {
        let gains = self.terms.iter().filter(|t| t.axes[a]).flat_map(|t| {
            t.parts.iter().flat_map(|p| {
                let outputs = EffectId::by_name(&p.effect).map_or(0, |e| e.facts().outputs);
                let several = outputs > 1;
                let of = |j: usize| if several { format!("{} {}", p.effect, j + 1) } else { p.effect.clone() };
                (0..outputs).map(of).collect::<Vec<_>>()
            })
        });
        crate::fit::NAMES.iter().map(|n| (*n).to_string()).chain(gains).collect()
    }

    /// Mean squares of each part of the bias of an axis over a run: of its mean over the units, of the spread between them, of the spread between
    /// days, deg/h as root mean squares about the run's own mean. The parts: the baseline, then each effect.
    #[must_use]
    pub fn parts_on(&self, run: &Run, a: usize) -> Vec<(String, [f64; 3])> {
        let Some(axis) = &self.axes[a] else { return Vec::new() };
        let (specification, over) = (self.specification(), self.over(run));
        let Some(square) = &over.axes[a] else { return Vec::new() };
        let of = |range: std::ops::Range<usize>| {
            let p = &axis.population;
            let sum = |of: &dyn Fn(usize, usize) -> f64| -> f64 {
                range
                    .clone()
                    .flat_map(|i| range.clone().map(move |j| (i, j)))
                    .map(|(i, j)| of(i, j) * square[(i, j)])
                    .sum()
            };
            [sum(&|i, j| p.mean[i] * p.mean[j]), sum(&|i, j| p.between[(i, j)]), sum(&|i, j| p.days[(i, j)])]
                .map(|v| v.max(0.0).sqrt())
        };
        let baseline = ("baseline".to_string(), of(0..TERMS));
        let effects = specification
            .terms
            .iter()
            .enumerate()
            .filter_map(|(e, t)| Some((t.lead().facts.name.to_string(), of(specification.gains(e, a)?))));
        std::iter::once(baseline).chain(effects).collect()
    }
}

/// The share of the runs that each noise model stands for: that of the highest likelihood (expectation and maximisation), what is known of any noise before
/// counting as one run.
fn shares(runs: &[&Told]) -> [f64; NOISE_MODELS.len()] {
    let before: [f64; NOISE_MODELS.len()] = std::array::from_fn(|s| NOISE_MODELS[s].log_prior().exp());
    let mut now = before;
    for _ in 0..200 {
        let mut next = before;
        for r in runs {
            let each: Vec<f64> = r.noise_models.iter().zip(now).map(|(l, w)| l + w.max(1e-300).ln()).collect();
            let all = log_sum(&each);
            next.iter_mut().zip(each).for_each(|(n, e)| *n += (e - all).exp());
        }
        now = next.map(|n| n / (runs.len() as f64 + 1.0));
    }
    now
}

/// `true` if the earth's rate was taken off all recordings, `false` if off none.
///
/// # Errors
/// It was taken off some.
fn alike<'r>(recordings: impl Iterator<Item = &'r Recording>) -> Result<bool, BadInput> {
    let (without, with): (Vec<&Recording>, Vec<&Recording>) = recordings.partition(|r| r.without_earth_rate());
    match (without.first(), with.first()) {
        (Some(a), Some(b)) => Err(BadInput(format!(
            "the earth's rate was taken off {} and not off {}: their constants cannot be compared; state latitude and axes in all of them, or in none",
            a.source, b.source
        ))),
        (without, _) => Ok(without.is_some()),
    }
}

/// Axes that a unit has.
fn present(p: &Prepared) -> impl Iterator<Item = usize> + '_ {
    p.runs.first().into_iter().flat_map(|r| r.steps.present())
}

impl Proposal {
    fn of(model: &Specification, data: &Data<'_>) -> Self {
        // (Variances over the noise's, as absolute ones.)
        let noise_dph2: [f64; AXES] = std::array::from_fn(|a| {
            let columns = model.columns(data, a);
            let found = posterior(&data.axes[a], &columns.values, &columns.prior);
            found.map_or(0.0, |f| f.each.iter().map(|u| u.weight * u.variance_dph2).sum())
        });
        let shared = |t: &&Term| t.parts.iter().all(|c| c.on_unit() && c.reads().is_empty());
        let terms: Vec<&Term> = model.terms.iter().filter(shared).collect();
        let variances_dph2 =
            std::array::from_fn(|a| terms.iter().flat_map(|t| t.prior[a].iter().map(|v| v * noise_dph2[a])).collect());
        Self { terms: terms.into_iter().map(FamilyTerm::of).collect(), variances_dph2 }
    }
}

impl FamilyTerm {
    fn of(t: &Term) -> Self {
        let part = |c: &Candidate| Part {
            effect: c.facts.name.to_string(),
            parameters: c.parameters,
            start: c.starts.common(),
        };
        Self { parts: t.parts.iter().map(part).collect(), axes: [0, 1, 2].map(|a: usize| t.on(a)) }
    }

    /// As a term of a model. `None` for an effect that this program does not know.
    fn term(&self) -> Option<Term> {
        let part = |p: &Part| {
            let branch = Starts::BRANCHES.iter().position(|b| *b == p.start)?;
            Some(Candidate::new(EffectId::by_name(&p.effect)?, p.parameters).starting(Starts::all(32, branch)))
        };
        let parts: Vec<Candidate> = self.parts.iter().map(part).collect::<Option<_>>()?;
        let outputs = parts.iter().map(|c| c.facts.outputs).sum();
        // (The variances are the family's; these say which axes have it.)
        Some(Term { prior: self.axes.map(|on| vec![1.0; if on { outputs } else { 0 }]), parts })
    }
}
