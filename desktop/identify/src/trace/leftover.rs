//! Judges the residual after the model: noise or structure, and the variable along which structure is left.
//!
//! Generic curves (of temperature while heating and while cooling, of the rate of change, of both together, of time) are offered to the
//! final model of each axis, shrunk as a family is and with the noise model refitted: if one of them has evidence, structure is left there.
//! (The residual on the verify run is judged by [`super::floor`].)

use super::beyond::{Form, FORMS, OF_A_FORM};
use super::data::{AxisRows, Data};
use super::evidence::{Axis, Extension, Part};
use super::model::Fitted;
use super::noise::NOISE_MODELS;
use super::odds::THRESHOLD;
use super::regression::Under;
use super::report::{Found, Ranked};
use super::search::{Model, Score, Search, MOST};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::{card, class_of, Class};

/// Variables along which structure is left on the train runs, by axis, in words; empty if none is left.
pub fn judge(data: &Data<'_>, search: &mut Search<'_>, model: &Model) -> [Vec<String>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let (names, columns): (Vec<_>, Vec<_>) = generic(data, a).into_iter().unzip();
        let least = least(names.len());
        let mut left: Vec<String> = names
            .iter()
            .zip(search.evidence_of(model, a, columns))
            .filter(|(_, evidence)| *evidence > least)
            .map(|(name, _)| (*name).to_string())
            .collect();
        if model.members.iter().filter(|m| !m.prior[a].is_empty()).count() >= MOST {
            left.push("in nothing simple (as many effects are needed as the search allows)".into());
        }
        left
    })
}

/// The same in what a model leaves of the verify run (`left`, on its blocks).
pub fn on_verify(data: &Data<'_>, left: &[Vec<f64>; AXES]) -> [Vec<String>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let rows = &data.axes[a];
        if rows.y.is_empty() {
            return vec![];
        }
        let (names, columns): (Vec<_>, Vec<_>) = generic(data, a).into_iter().unzip();
        // Beside a constant alone: the baseline's coefficients are those of the train runs.
        let mut base = vec![vec![0.0; rows.y.len()]; rows.base.len()];
        base[0].fill(1.0);
        base.extend(rows.happened.iter().cloned());
        let rows = AxisRows { y: left[a].clone(), base, ..rows.clone() };
        let mut axis = Axis::new(&rows);
        let nothing = axis.baseline_model();
        columns.into_iter().for_each(|c| axis.push(Some(vec![Part::New(c)])));
        let offered = vec![true; names.len() + 1];
        let least = least(names.len());
        let gains = axis.extensions(&nothing, &offered).split_off(1);
        let evidence = |g: &Option<Extension>| g.map_or(0.0, |e| e.evidence - nothing.evidence);
        let found = names.iter().zip(&gains).filter(|(_, g)| evidence(g) > least);
        found.map(|(name, _)| format!("{name} on the verify run")).collect()
    })
}

/// For each effect a form of another class, beyond the library, that is not excluded in its place by the odds at which a claim is made.
pub fn beyond(search: &mut Search<'_>, model: &Model, effects: &[Found]) -> Vec<Option<&'static Form>> {
    let data = search.data();
    let mut out = vec![None; effects.len()];
    for form in &FORMS {
        let tried =
            |(k, e): &(usize, &Found)| out[*k].is_none() && e.class != Class::Event && e.class != card(form.like).class;
        let tried: Vec<usize> = effects.iter().enumerate().filter(tried).map(|(k, _)| k).collect();
        if tried.is_empty() {
            continue;
        }
        let groups = [0, 1, 2].map(|a: usize| (form.groups)(data, a));
        if groups.iter().all(Vec::is_empty) {
            continue;
        }
        for k in tried {
            if search.odds_against(model, k, form, &groups) < THRESHOLD {
                out[k] = Some(form);
            }
        }
    }
    out
}

/// Effects that describe something and do not explain it, by axis: those that the verify run does not confirm, or cannot, those in whose place
/// an effect of another class, or a form `beyond` the library, is not excluded by the odds at which a claim is made, and those that the verify run shows in
/// another size.
pub fn not_explained(effects: &[Found], beyond: &[Option<&Form>]) -> [Vec<String>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let here = effects.iter().zip(beyond).filter(|(e, _)| e.axes.contains_key(AXIS_NAMES[a]));
        let mut left: Vec<String> = here
            .filter_map(|(e, beyond)| {
                let why = match e.confirmed {
                    Some(true) => {
                        let is_not = "is not excluded by odds of 99 to 1";
                        let of_library = || {
                            let other = other_class(e.class, e.score, &e.rank)?;
                            Some(format!("and {other} of another class {is_not}"))
                        };
                        let of_form = || {
                            let Form { about, told_by, .. } = beyond.as_ref()?;
                            Some(format!("and {about}, {OF_A_FORM}, {is_not} ({told_by})"))
                        };
                        let of_another_size = || {
                            let agreement = e.on_verify.get(AXIS_NAMES[a])?;
                            agreement.is_of_another_size().then(|| "which the verify run shows in another size".into())
                        };
                        of_library().or_else(of_form).or_else(of_another_size)?
                    }
                    Some(false) => "which the verify run does not confirm".into(),
                    None if e.class == Class::Event => "and no other run can confirm it".into(),
                    None => "whose input the verify run does not have".into(),
                };
                Some(format!("where {} stands for it, {why}", e.label()))
            })
            .collect();
        left.dedup();
        left
    })
}

/// Of the candidates for the place of an effect, one of another class whose posterior odds are not below the effect's own by more than the threshold.
fn other_class(class: Class, score: Score, rank: &[Ranked]) -> Option<&str> {
    let near = |r: &&Ranked| score.total() - r.score.total() < THRESHOLD;
    rank.iter().filter(near).find(|r| class_of(&r.name).is_some_and(|c| c != class)).map(|r| r.name.as_str())
}

/// Swings within a run that no noise of a gyro has, by the weights of the noise models after a fit.
pub fn swings(data: &Data<'_>, fitted: &Fitted) -> [Option<String>; AXES] {
    [0, 1, 2].map(|a: usize| {
        let each = &fitted.axes[a].posterior.as_ref()?.each;
        let blocks = data.axes[a].y.len() / data.runs.len();
        let is_misfit = |u: &&Under| NOISE_MODELS[u.noise_model].is_misfit(blocks);
        let misfit: f64 = each.iter().filter(is_misfit).map(|u| u.weight).sum();
        let odds = (misfit / (1.0 - misfit).max(1e-12)).ln();
        (odds > THRESHOLD).then(|| "in time (it swings over tens of minutes as no noise of a gyro does)".into())
    })
}

/// Log evidence from which on one of so many generic curves is structure: each is one of them.
fn least(curves: usize) -> f64 {
    THRESHOLD + (curves as f64).ln()
}

/// Generic curves, on the kept blocks of an axis.
fn generic(data: &Data<'_>, a: usize) -> Vec<(&'static str, Vec<Vec<f64>>)> {
    let rows = &data.axes[a];
    let state: Vec<(f64, f64)> = data.states(a).into_iter().map(Option::unwrap_or_default).collect();
    let clock: Vec<f64> =
        data.blocks.iter().flat_map(|&n| (0..n).map(move |b| b as f64 / n as f64 * 2.0 - 1.0)).collect();
    let clock: Vec<f64> = rows.keep.iter().map(|&k| clock[k]).collect();
    let (low, high) = data.temperature_range();
    let (centre, half) = (f64::from(0.5 * (low + high)), f64::from(0.5 * (high - low)).max(1.0));
    let fastest = state.iter().map(|s| s.1.abs()).fold(0.05, f64::max);
    let x: Vec<f64> = state.iter().map(|s| ((s.0 - centre) / half).clamp(-1.0, 1.0)).collect();
    let r: Vec<f64> = state.iter().map(|s| s.1 / fastest).collect();
    let curve = |v: &[f64], degrees: std::ops::RangeInclusive<i32>, weight: &dyn Fn(usize) -> f64| -> Vec<Vec<f64>> {
        degrees
            .map(|d| {
                v.iter()
                    .enumerate()
                    .map(|(k, x)| (f64::from(d) * x.clamp(-1.0, 1.0).acos()).cos() * weight(k))
                    .collect()
            })
            .collect()
    };
    let heating = |k: usize| if r[k] > 0.1 { 1.0 } else { 0.0 };
    let cooling = |k: usize| if r[k] < -0.1 { 1.0 } else { 0.0 };
    let mut directions = curve(&x, 0..=5, &heating);
    directions.extend(curve(&x, 0..=5, &cooling));
    let mut products = curve(&x, 1..=4, &|k| r[k]);
    products.extend(curve(&x, 1..=2, &|k| r[k] * r[k]));
    vec![
        ("in temperature", curve(&x, 3..=12, &|_| 1.0)),
        ("in temperature, heating apart from cooling", directions),
        ("in dT/dt", curve(&r, 3..=7, &|_| 1.0)),
        ("in temperature and dT/dt together", products),
        ("in time", curve(&clock, 1..=14, &|_| 1.0)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_class_is_certain_if_every_other_one_is_beyond_the_threshold() {
        let score = |log_evidence: f64| Score { log_prior: -6.0, log_evidence };
        let ranked =
            |name: &str, log_evidence: f64| Ranked { name: name.into(), gain_in_cv: 0.0, score: score(log_evidence) };
        let other = |rank: &[Ranked]| other_class(Class::Memory, score(30.0), rank).map(String::from);
        let own = [ranked("thermal-lag", 30.0), ranked("lag-ladder", 29.0), ranked("warm-up", 25.0)];
        assert_eq!(other(&own), None);
        assert_eq!(other(&[ranked("lag-ladder", 31.0), ranked("warm-up", 26.0)]), Some("warm-up".into()));
        // An own effect is not in the list and has no class that could be another one.
        assert_eq!(other(&[ranked("my own", 30.0)]), None);
    }
}
