//! A unit under its family: the coefficients by what its own runs say and what the family's units have, and whether it belongs to the family.
//!
//! For one axis, `theta ~ N(mean, between + days)` before its runs are seen. What is seen decides how far it moves, under each noise model of
//! [`crate::trace::noise`]; the variance of the noise is that of the highest likelihood.
//!
//! A unit belongs unless its runs are more probable under what they say by themselves than under the family, at the odds of any claim. By itself a unit has a prior with the weight of
//! one row of its own data about what was found (Kass and Wasserman 1995): it costs each free coefficient half the logarithm of the rows.

use super::{population, Begun, Family, OfAxis};
use crate::fit::{states_of, Prepared};
use crate::matrices::{log_determinant, symmetric};
use crate::trace::data::{AxisRows, Data};
use crate::trace::model::{AxisFit, Fitted, Specification};
use crate::trace::noise::NOISE_MODELS;
use crate::trace::odds::THRESHOLD;
use crate::trace::regression::{posterior, Posterior, Under};
use crate::trace::uncertainty::{self, Known};
use hrg_core::calibration::Calibration;
use hrg_core::effects::EffectId;
use hrg_core::visited::Visited;
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::error::BadInput;
use hrg_data::numeric::stats::{dot, log_sum};
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::fmt::Write as _;

/// Log evidence of the runs of an axis.
///
/// That an axis does not belong is a claim, made at the odds of any other ([`THRESHOLD`]); with several axes there are so many claims, and each needs the
/// logarithm of their number more.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Evidence {
    /// Under the family.
    pub family: f64,
    /// Under what the runs say by themselves: the best of the models that were tried.
    pub own: f64,
}

impl Evidence {
    /// `true` where the axis belongs to the family, as one of so many axes.
    #[must_use]
    pub fn belongs(&self, axes: usize) -> bool {
        self.own - self.family < THRESHOLD + (axes.max(1) as f64).ln()
    }
}

/// A unit under its family.
#[derive(Debug)]
pub struct Member {
    /// The fit.
    pub fitted: Fitted,
    /// Its uncertainty.
    pub known: Known,
    /// By axis, whether it belongs; `None` for an axis that the unit or the family does not have.
    pub evidence: [Option<Evidence>; AXES],
    /// The runs that begin in a state of which nothing is known.
    pub unknown_past: Vec<usize>,
}

impl Member {
    /// `true` if each axis of the unit belongs to the family.
    #[must_use]
    pub fn belongs(&self) -> bool {
        let axes = self.evidence.iter().flatten().count();
        axes > 0 && self.evidence.iter().flatten().all(|e| e.belongs(axes))
    }

    /// `true` where the family says more of the unit than its own runs do, on all axes together.
    #[must_use]
    pub fn is_better(&self) -> bool {
        self.belongs() && self.evidence.iter().flatten().map(|e| e.family - e.own).sum::<f64>() > 0.0
    }

    /// A sentence about it.
    #[must_use]
    pub fn sentence(&self, family: &Family) -> String {
        let each: Vec<String> = AXIS_NAMES
            .iter()
            .zip(&self.evidence)
            .filter_map(|(name, e)| Some(format!("{name} {:+.0}", e.as_ref()?.family - e.as_ref()?.own)))
            .collect();
        let (of, odds) = (family.sources.len(), each.join(", "));
        let name = &family.name;
        if self.belongs() {
            let mut text = format!(
                "the unit is of the family {name} ({of} units): log odds against what its runs say by themselves {odds}"
            );
            for run in &self.unknown_past {
                let _ = write!(
                    text,
                    "; run {} begins in a state that it does not tell, as of a unit that was not soaked",
                    run + 1
                );
            }
            text
        } else {
            format!("the unit is NOT of the family {name} ({of} units), which is not used: log odds against what its runs say by themselves {odds}")
        }
    }
}

impl Family {
    /// Fits a unit under the family, from runs by [`Self::prepare`]. `own`: what its runs are otherwise taken for, beside the family's model and the baseline without the family's
    /// numbers; by axis, with the log prior odds of its effects.
    ///
    /// # Errors
    /// Runs that hold nothing down, or a family without an axis that the unit has.
    pub fn member(&self, prepared: &Prepared, own: [Option<f64>; AXES]) -> Result<Member, BadInput> {
        let data = Data::in_blocks(&prepared.runs, self.scaling, prepared.mean_lag_s(), self.coarse_s);
        let (begun, fitted) = self.begun(data)?;
        let data = &begun.data;
        let evidence = std::array::from_fn(|a| {
            let family = fitted.axes[a].posterior.as_ref()?.evidence + begun.odds / data.axes_there() as f64;
            let alone = |of: &Specification| alone(&data.axes[a], &of.columns(data, a).values);
            let own = [alone(&begun.specification), alone(&Specification::default()), own[a]];
            Some(Evidence { family, own: own.into_iter().flatten().fold(f64::NEG_INFINITY, f64::max) })
        });
        let known = uncertainty::given(data, &fitted);
        Ok(Member { fitted, known, evidence, unknown_past: begun.unknown_past })
    }

    /// Each run begun as it is the most probable under the family, and the fit.
    fn begun<'r>(&self, data: Data<'r>) -> Result<(Begun<'r>, Fitted), BadInput> {
        let log_of = |f: &Fitted| f.axes.iter().filter_map(|x| Some(x.posterior.as_ref()?.evidence)).sum::<f64>();
        let first = Begun { odds: 0.0, specification: self.specification(), data, unknown_past: Vec::new() };
        let fitted = self.fitted(&first.data, &first.specification)?;
        let mut best = (first, fitted);
        for run in 0..best.0.data.runs.len() {
            for other in self.beginnings(&best.0, run) {
                let fitted = self.fitted(&other.data, &other.specification)?;
                if other.odds + log_of(&fitted) > best.0.odds + log_of(&best.1) {
                    best = (other, fitted);
                }
            }
        }
        Ok(best)
    }

    fn fitted(&self, data: &Data<'_>, specification: &Specification) -> Result<Fitted, BadInput> {
        Fitted::by(data, specification, |a, columns, days| {
            let axis = self.axes[a].as_ref().ok_or_else(|| {
                BadInput(format!("the family {} has no such axis; learn it from units that have it", self.name))
            })?;
            let count = columns.values.len() - days;
            let under = |scale: f64| under(&data.axes[a], &columns.values[..count], axis, scale);
            let mut found =
                under(1.0).ok_or_else(|| BadInput::new("the equations are singular; record a longer run"))?;
            // (Membership is a matter of the tails, which are Student's: the fewer units, the longer.)
            let scales = population::scales_of_a_new_unit(self.sources.len());
            let logs: Vec<f64> = scales.into_iter().filter_map(|s| Some(under(s)?.evidence)).collect();
            found.evidence = log_sum(&logs) - (logs.len() as f64).ln();
            let widen = |c: &DMatrix<f64>| c.clone().resize(count + days, count + days, 0.0);
            found.coefficients = found.coefficients.resize_vertically(count + days, 0.0);
            found.covariance = widen(&found.covariance);
            for u in &mut found.each {
                u.coefficients = u.coefficients.clone().resize_vertically(count + days, 0.0);
                u.covariance = widen(&u.covariance);
            }
            let coefficients = found.coefficients.iter().copied().collect();
            Ok(AxisFit::new(coefficients, found.covariance.clone(), days, Some(found)))
        })
    }

    /// The image of a unit under the family.
    #[must_use]
    pub fn image(&self, member: &Member, prepared: &Prepared, notes: &mut Vec<String>) -> Calibration {
        let mut base = Calibration { sequence: 1, ..prepared.calibration.clone() };
        for (a, axis) in base.axes.iter_mut().enumerate() {
            // All that the family's units have shown holds for this one: its ranges are theirs, and the map of its states lies over them.
            let own: Vec<(f32, f32)> = prepared.runs.iter().flat_map(|run| states_of(run, a)).collect();
            let [low, high] = self.temperatures_c;
            axis.curve.valid_from_c = axis.curve.valid_from_c.min(low);
            axis.curve.valid_to_c = axis.curve.valid_to_c.max(high);
            axis.valid_from_c_per_min = axis.valid_from_c_per_min.min(self.ramps_c_per_min[0]);
            axis.valid_to_c_per_min = axis.valid_to_c_per_min.max(self.ramps_c_per_min[1]);
            let ranges = axis.ranges();
            let mut map = Visited::none();
            let family = self.axes[a].iter().flat_map(|f| f.visited.each());
            own.into_iter().chain(family).for_each(|(t, r)| map.visit(&ranges, t, r));
            axis.visited = map;
        }
        let mut image = member.fitted.image(&base, &member.known.stated, notes);
        for term in &mut image.effects {
            // A unit that is switched on begins as the family's units do, wherever it began in these runs.
            let parts = || self.terms.iter().flat_map(|t| &t.parts);
            let part = parts().find(|p| {
                EffectId::by_name(&p.effect).is_some_and(|e| e.facts().id == term.id) && p.parameters == term.parameters
            });
            term.start = part.map_or(term.start, |p| p.start);
        }
        for (a, axis) in image.axes.iter_mut().enumerate() {
            let Some(p) = &member.known.posteriors[a] else { continue };
            axis.visited.unvisited_dph2 = uncertainty::unvisited(axis, &image.scaling, &p.covariance, 0.0) as f32;
        }
        image
    }
}

/// Log evidence, by axis, of rows under a fit of another model with priors of its own for its effects: as [`Family::member`] has it for columns without any.
/// `log_prior`: log prior odds of its effects.
#[must_use]
pub fn of_fit(data: &Data<'_>, fitted: &Fitted, log_prior: f64) -> [Option<f64>; AXES] {
    std::array::from_fn(|a| {
        let rows = &data.axes[a];
        if rows.y.is_empty() {
            return None;
        }
        let columns = fitted.model.columns(data, a);
        // (What has no prior comes first.)
        let mut order: Vec<usize> = (0..columns.values.len()).collect();
        order.sort_by_key(|k| columns.prior[*k].is_some());
        let free = columns.prior.iter().filter(|p| p.is_none()).count();
        let values: Vec<Vec<f64>> = order.iter().map(|k| columns.values[*k].clone()).collect();
        let prior: Vec<Option<f64>> = order.iter().map(|k| columns.prior[*k]).collect();
        let found = posterior(rows, &values, &prior)?;
        let share = data.axes_there() as f64;
        Some(absolute(&found, rows.y.len(), free) + log_prior / share)
    })
}

/// Log evidence of the rows of an axis under columns of which nothing is known but a prior with the weight of one row.
fn alone(rows: &AxisRows, columns: &[Vec<f64>]) -> Option<f64> {
    let found = posterior(rows, columns, &vec![None; columns.len()])?;
    Some(absolute(&found, rows.y.len(), columns.len()))
}

/// The restricted likelihood of a posterior as a log density of the rows: its `count` first coefficients have no prior, and are given one with the weight of one
/// row.
#[must_use]
pub fn absolute(found: &Posterior, rows: usize, count: usize) -> f64 {
    let free = rows as f64 - count as f64;
    let log_turn = (2.0 * std::f64::consts::PI).ln();
    let block = found.covariance.view((0, 0), (count, count)).clone_owned();
    let spread = block.cholesky().map_or(0.0, |f| log_determinant(&f));
    found.evidence - 0.5 * free * (log_turn + 1.0) - 0.5 * (count as f64 * (log_turn + (rows as f64).ln()) + spread)
}

/// The coefficients of an axis for another day under a family, with the log evidence of its rows. `columns`: without those of the days; `scale`: factor of
/// the covariance between units.
fn under(rows: &AxisRows, columns: &[Vec<f64>], axis: &OfAxis, scale: f64) -> Option<Posterior> {
    let (p, runs, population) = (columns.len(), rows.starts.len(), &axis.population);
    if population.mean.len() != p {
        return None;
    }
    // One run: its day is not parted from the unit. Several: the unit's coefficients, then what each day adds.
    let (days, several) = (&population.days, runs > 1);
    let blocks = if several { runs + 1 } else { 1 };
    let (mut mean, mut prior) = (DVector::zeros(p * blocks), DMatrix::zeros(p * blocks, p * blocks));
    mean.rows_mut(0, p).copy_from(&population.mean);
    let between = &population.between * scale;
    let first = if several { between } else { between + days };
    prior.view_mut((0, 0), (p, p)).copy_from(&first);
    let mut all = columns.to_vec();
    if several {
        for run in 0..runs {
            let at = p * (run + 1);
            prior.view_mut((at, at), (p, p)).copy_from(days);
            all.extend(columns.iter().map(|c| rows.in_run(run, c)));
        }
    }
    let root = uncertainty::square_root(&prior);
    let n = rows.y.len() as f64;
    let mut each: Vec<(f64, Under)> = Vec::new();
    for noise_model in 0..NOISE_MODELS.len() {
        let x: Vec<Vec<f64>> = all.iter().map(|c| rows.filters.whitened(noise_model, c)).collect();
        let mut left = rows.filters.whitened(noise_model, &rows.y);
        for (column, m) in x.iter().zip(&mean) {
            hrg_data::numeric::stats::take_off(&mut left, *m, column);
        }
        let gram = symmetric(x.len(), |i, j| dot(&x[i], &x[j]));
        let e = SymmetricEigen::new(root.transpose() * gram * &root);
        let b = e.eigenvectors.transpose() * root.transpose() * DVector::from_fn(x.len(), |i, _| dot(&x[i], &left));
        let values: Vec<f64> = e.eigenvalues.iter().map(|v| v.max(0.0)).collect();
        let squares = dot(&left, &left);
        let likelihood = |log_variance: f64| {
            let v = log_variance.exp();
            let explained: f64 = values.iter().zip(&b).map(|(l, b)| b * b / (v + l)).sum();
            let determinant: f64 = values.iter().map(|l| (l / v).ln_1p()).sum();
            -0.5 * (n * (log_variance + (2.0 * std::f64::consts::PI).ln()) + determinant + (squares - explained) / v)
        };
        let (variance, log) = highest(&likelihood, (squares / n).max(1e-300).ln());
        let v = variance.exp();
        let along = &root * &e.eigenvectors;
        let coefficients = &mean + &along * DVector::from_fn(b.len(), |i, _| b[i] / (v + values[i]));
        let shares = DVector::from_fn(b.len(), |i, _| v / (v + values[i]));
        let covariance = &along * DMatrix::from_diagonal(&shares) * along.transpose();
        // Of another day: the unit's coefficients, with the spread of the days. (With one run the share of that day is what the spread of the days
        // is of the whole.)
        let (coefficients, covariance) = if several {
            let own = covariance.view((0, 0), (p, p)).clone_owned();
            (coefficients.rows(0, p).clone_owned(), own + days)
        } else {
            another_day(&coefficients, &covariance, population)
        };
        let before = axis.noise_models[noise_model].ln();
        let finite = log.is_finite() && coefficients.iter().chain(covariance.iter()).all(|c| c.is_finite());
        if finite {
            let likelihood = before + rows.filters.log_determinant(noise_model) + log;
            let under = Under { noise_model, weight: 0.0, variance_dph2: v, coefficients, covariance, free: n };
            each.push((likelihood, under));
        }
    }
    let evidence = log_sum(&each.iter().map(|e| e.0).collect::<Vec<_>>());
    if !evidence.is_finite() {
        return None;
    }
    let each: Vec<Under> = each.into_iter().map(|(l, u)| Under { weight: (l - evidence).exp(), ..u }).collect();
    Some(Posterior::of(each, evidence))
}

/// Knowledge that a day's coefficients give of the unit's, and so of another day's: theta and its day are drawn from `between` and `days`, and their sum is
/// known with a covariance.
pub(super) fn another_day(
    sum: &DVector<f64>,
    covariance: &DMatrix<f64>,
    population: &super::population::Population,
) -> (DVector<f64>, DMatrix<f64>) {
    let days = &population.days;
    let whole = &population.between + days;
    let Some(f) = whole.cholesky() else { return (sum.clone(), covariance + days) };
    // The share of the sum that is the unit's.
    let share = f.solve(&population.between).transpose();
    let mean = &population.mean + &share * (sum - &population.mean);
    let left = &population.between - &share * &population.between;
    let covariance = &share * covariance * share.transpose() + 0.5 * (&left + left.transpose()) + days;
    (mean, covariance)
}

/// The highest value of a function of one variable with one maximum: where, and how high. From far below `around`, where it is known to lie at most a
/// little above.
fn highest(of: &impl Fn(f64) -> f64, around: f64) -> (f64, f64) {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut low, mut high) = (around - 14.0, around + 2.0);
    let (mut x, mut y) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_x, mut at_y) = (of(x), of(y));
    for _ in 0..48 {
        if at_x > at_y {
            (high, y, at_y) = (y, x, at_x);
            x = high - GOLDEN * (high - low);
            at_x = of(x);
        } else {
            (low, x, at_x) = (x, y, at_y);
            y = low + GOLDEN * (high - low);
            at_y = of(y);
        }
    }
    if at_x > at_y {
        (x, at_x)
    } else {
        (y, at_y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::family::Learnt;
    use crate::fit::independence::Units;
    use crate::fit::{correct, prepare};
    use hrg_data::numeric::stats::std_dev;
    use hrg_data::recording::Recording;
    use hrg_simulate::{Plan, Profile};

    /// A run of a unit whose bias has a slope of its own, deg/h from the middle to an end of the temperatures.
    fn run(profile: &str, design: u64, seed: u64, slope_dph: f64) -> Recording {
        let mut r = Plan::of(Profile::parse(profile).expect("fine"), design, seed).simulate().recording;
        r.set_meta("unit", &format!("HRG-{seed}"));
        for a in 0..AXES {
            let middle = r.frequency_hz[a][0];
            for k in 0..r.rate_dph[a].len() {
                r.rate_dph[a][k] += slope_dph * (r.frequency_hz[a][k] - middle) / 20.0;
            }
        }
        r
    }

    #[test]
    fn a_unit_is_known_from_less_where_it_belongs_and_another_is_named() {
        let slopes = [-0.4, 0.1, 0.3, -0.1, 0.4, -0.3, 0.2];
        let units = (1..).zip(slopes).map(|(seed, slope)| vec![run("cycle", 1, seed, slope)]).collect();
        let Learnt { family, left_out, unlike } = Family::learn("test", units).expect("a family");
        assert!(left_out.is_empty() && unlike.is_empty() && family.sources.len() == 7, "{unlike:?}");
        let again = Family::from_json(&family.to_json().expect("text")).expect("read");
        assert_eq!(again.to_json().expect("text"), family.to_json().expect("text"));
        // An hour of heating alone: no fit by itself knows how it cools.
        let short = [run("20,60@1,20m", 1, 91, 0.25)];
        let whole = run("verify", 1, 92, 0.25);
        let prepared = family.prepare(&short, Units::Same).expect("usable");
        let member = family.member(&prepared, [None; AXES]).expect("fitted");
        assert!(member.belongs(), "{}", member.sentence(&family));
        let image = family.image(&member, &prepared, &mut Vec::new());
        let left = |c: &Calibration| {
            let steps = hrg_data::recording::steps::Steps::new(&whole).expect("usable");
            let seconds = correct(c, &steps);
            seconds.iter().map(|r| std_dev(&hrg_data::numeric::stats::block_means(r, 100)).powi(2)).sum::<f64>().sqrt()
        };
        let alone = prepare(&short).expect("usable");
        let data = Data::new(&alone.runs, alone.calibration.scaling, alone.mean_lag_s());
        let alone =
            Fitted::plain(&data).expect("fitted").image(&alone.calibration, &[None, None, None], &mut Vec::new());
        let (with, without) = (left(&image), left(&alone));
        assert!(with < 0.5 * without && with < 1.0, "{with} {without}");
        // A unit of another design.
        let other = [run("20,60@1,20m", 7, 93, 0.0)];
        let other = family.member(&family.prepare(&other, Units::Same).expect("usable"), [None; AXES]).expect("fitted");
        assert!(!other.belongs(), "{}", other.sentence(&family));
        // Its trace is the one without the family.
        let runs = [("cycle", 93), ("verify", 94)].map(|(profile, seed)| {
            let mut r = run(profile, 7, seed, 0.0);
            r.set_meta("unit", "HRG-93");
            r
        });
        let options = |family| crate::trace::Options { family, ..crate::trace::Options::default() };
        let [with, alone] = [Some(family.clone()), None]
            .map(|family| crate::trace::trace_with(&runs[..1], &runs[1], &options(family)).expect("traced"));
        assert!(with.report.prior.as_ref().is_some_and(|p| !p.belongs && !p.used));
        assert!(with.report.notes.iter().any(|n| n.contains("NOT of the family")), "{:?}", with.report.notes);
        assert_eq!(with.image, alone.image);
        // Rates with the earth's rate in them are not compared with rates without.
        let mut removed = short.clone();
        removed
            .iter_mut()
            .for_each(|r| r.set_meta("earth_rate", if family.without_earth_rate { "included" } else { "removed" }));
        removed.iter_mut().for_each(|r| r.earth_rate_dph = None);
        let e = family.prepare(&removed, Units::Same).expect_err("refused").0;
        assert!(e.contains("the earth's rate") && e.contains("--latitude"), "{e}");
        // A number that was changed by hand is noticed.
        let text = family.to_json().expect("text");
        let changed = text.replacen(&format!("\"coarse_s\": {}", family.coarse_s), "\"coarse_s\": 1000000", 1);
        assert!(text != changed && Family::from_json(&changed).expect_err("changed").0.contains("checksum"));
        assert!(Family::from_json("{}").expect_err("none").0.contains("hrg family"));
        let few = vec![vec![run("cycle", 1, 1, 0.0)]; 1];
        assert!(Family::learn("few", few).expect_err("too few").0.contains("needs 4 units"));
    }

    #[test]
    fn a_unit_that_is_none_of_the_others_or_has_the_data_of_one_is_left_out() {
        let mut units: Vec<Vec<Recording>> = (1..=6).map(|seed| vec![run("cycle", 1, seed, 0.1)]).collect();
        let mut exchanged = run("cycle", 1, 9, 0.1);
        exchanged.rate_dph[0].iter_mut().for_each(|v| *v = -*v);
        let mut copy = units[0][0].clone();
        copy.set_meta("unit", "HRG-8");
        units.insert(2, vec![exchanged]);
        units.push(vec![copy]);
        let Learnt { family, left_out, unlike } = Family::learn("test", units).expect("a family");
        let named: Vec<(&str, &str)> = left_out.iter().map(|l| (l.unit.as_str(), l.why.as_str())).collect();
        assert!(family.sources.len() == 6 && unlike.is_empty(), "{named:?} {unlike:?}");
        assert!(named[0].0 == "HRG-8" && named[0].1.contains("same data as one of the unit HRG-1"), "{named:?}");
        assert!(named[1].0 == "HRG-9" && named[1].1.contains("axis x above all"), "{named:?}");
    }

    /// Adds to the rates of a run what lags behind the temperature with a time constant of two hours.
    fn with_lag(mut r: Recording, gain_dph_per_c: f64) -> Recording {
        let prepared = prepare(std::slice::from_ref(&r)).expect("usable");
        for a in 0..AXES {
            let curve = &prepared.calibration.axes[a].curve;
            let mut state = None;
            for k in 0..r.rate_dph[a].len() {
                let t = f64::from(curve.temperature_c(r.frequency_hz[a][k]));
                let now = state.map_or(t, |s: f64| s + (t - s) / 7200.0);
                state = Some(now);
                r.rate_dph[a][k] += gain_dph_per_c * (now - t);
            }
        }
        r
    }

    /// Without what was recorded in a part of the time.
    fn without(r: &Recording, lost: std::ops::Range<f64>) -> Recording {
        let mut r = r.clone();
        let n = r.time_s.len() as f64;
        for values in r.frequency_hz.iter_mut().chain(&mut r.rate_dph) {
            values[(lost.start * n) as usize..(lost.end * n) as usize].fill(f64::NAN);
        }
        r
    }

    #[test]
    fn behind_a_gap_and_in_a_run_that_begins_anywhere_the_state_of_a_unit_is_unknown() {
        let gains = [0.30, 0.26, 0.33, 0.29, 0.31];
        let units = (1..).zip(gains).map(|(seed, gain)| vec![with_lag(run("cycle", 1, seed, 0.0), gain)]).collect();
        let Learnt { family, .. } = Family::learn("lags", units).expect("a family");
        let (whole, unseen) = (with_lag(run("cycle", 1, 91, 0.0), 0.28), with_lag(run("verify", 1, 91, 0.0), 0.28));
        let steps = hrg_data::recording::steps::Steps::new(&unseen).expect("usable");
        let left = |r: Recording| {
            let prepared = family.prepare(&[r], Units::Same).expect("usable");
            let member = family.member(&prepared, [None; AXES]).expect("fitted");
            assert!(member.belongs(), "{}", member.sentence(&family));
            let image = family.image(&member, &prepared, &mut Vec::new());
            let seconds = correct(&image, &steps);
            seconds.iter().map(|r| std_dev(&hrg_data::numeric::stats::block_means(r, 100)).powi(2)).sum::<f64>().sqrt()
        };
        // (Nothing says that a run which begins with a ramp was soaked before.)
        let parts = [without(&whole, 0.40..0.62), without(&whole, 0.0..0.3)];
        let known = left(whole.clone());
        let each = parts.map(left);
        assert!(each.iter().all(|e| *e < 1.3 * known), "{each:?} {known}");
    }

    /// Adds a play of a width of 12 C to the rates of a run, begun on a branch.
    fn with_play(mut r: Recording, gain_dph_per_c: f64, branch: f64) -> Recording {
        let prepared = prepare(std::slice::from_ref(&r)).expect("usable");
        for a in 0..AXES {
            let curve = &prepared.calibration.axes[a].curve;
            let c = |f: f64| f64::from(curve.temperature_c(f));
            let (half, mut state) = (6.0, None);
            for k in 0..r.rate_dph[a].len() {
                let t = c(r.frequency_hz[a][k]);
                let now = state.map_or(t + branch * half, |s: f64| s.clamp(t - half, t + half));
                state = Some(now);
                r.rate_dph[a][k] += gain_dph_per_c * (now - t);
            }
        }
        r
    }

    #[test]
    fn a_family_knows_where_its_plays_begin_and_a_run_that_begins_elsewhere_is_understood() {
        let one = |seed: u64, gain: f64, branch: f64| with_play(run("cycle", 1, seed, 0.0), gain, branch);
        let gains = [0.30, 0.26, 0.33, 0.29, 0.31];
        let units = (1..).zip(gains).map(|(seed, gain)| vec![one(seed, gain, 1.0)]).collect();
        let Learnt { family, .. } = Family::learn("plays", units).expect("a family");
        let starts: Vec<f32> = family
            .terms
            .iter()
            .flat_map(|t| &t.parts)
            .filter(|p| EffectId::by_name(&p.effect).is_some_and(|e| e.facts().remembers_path))
            .map(|p| p.start)
            .collect();
        assert!(!starts.is_empty() && starts.iter().all(|s| *s == 1.0), "{:?}", family.terms);
        // Half an hour of heating: what the play does there is told by where it begins.
        for branch in [1.0, -1.0] {
            let short = [with_play(run("20,60@1,20m", 1, 91, 0.0), 0.3, branch)];
            let prepared = family.prepare(&short, Units::Same).expect("usable");
            let member = family.member(&prepared, [None; AXES]).expect("fitted");
            assert!(member.belongs(), "{}", member.sentence(&family));
            let begun = member.fitted.terms().iter().flat_map(|t| &t.parts).find(|c| c.facts.remembers_path);
            assert_eq!(begun.map(|c| f64::from(c.starts.of(Some(0)))), Some(branch));
            let image = family.image(&member, &prepared, &mut Vec::new());
            let plays =
                image.effects.iter().filter(|e| hrg_core::effects::by_id(e.id).is_some_and(|f| f.remembers_path));
            assert!(plays.map(|e| e.start).all(|s| s == 1.0), "switched on, it begins as its family");
        }
        let old = family
            .to_json()
            .expect("text")
            .replace("\"hrg-family\": 3", "\"hrg-family\": 2")
            .replace("\"start\"", "\"begin\"");
        assert!(Family::from_json(&old).expect_err("old").0.contains("learn it again"));
    }
}
