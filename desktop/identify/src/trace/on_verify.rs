//! The verify run: what it says of each effect, and the image that it bears out.

use super::data::{Candidate, Data, Starts};
use super::events::on_clock_of;
use super::judge::{agreement, Means, Noise};
use super::model::{drop_idle_effects, take_axis, with_axes_of, Fitted, Term};
use super::report::{by_axis, Agreement, AxisModel, ByAxis, Found, Gain, Image, OnVerify, Ranked};
use super::search::{Rival, Search};
use super::stated::Stated;
use super::uncertainty::{self, Weights};
use super::user_effects::card_of;
use super::{Learnt, Options, INDISTINGUISHABLE};
use crate::fit;
use hrg_core::bias::{Coefficients, Scaling, TERMS};
use hrg_core::calibration::{Calibration, Uncertainty};
use hrg_core::effects::{by_id, Reach};
use hrg_core::AXES;
use hrg_data::axes::AXIS_NAMES;
use hrg_data::cards::Kind;
use hrg_data::error::BadInput;
use hrg_data::recording::steps::Run;
use std::collections::{BTreeMap, BTreeSet};

/// An image with what it reaches.
pub(super) struct Written {
    pub image: Calibration,
    pub kind: Image,
    pub burn: bool,
    pub figures: Option<ByAxis<OnVerify>>,
}

/// The model that an image is made of.
pub(super) struct ForUnit {
    pub fitted: Fitted,
    pub stated: [Option<Stated>; AXES],
}

/// The verify run, on which models are judged.
pub(super) struct OnVerifyRun<'v> {
    pub data: &'v Data<'v>,
    pub run: &'v Run,
    pub scaling: Scaling,
    pub noise: &'v [Noise<'v>],
    pub known: &'v dyn Fn(&Candidate) -> bool,
}

impl OnVerifyRun<'_> {
    /// Each effect with its gains, its rivals, and what the verify run says of it.
    pub(super) fn found(
        &self,
        search: &Search<'_>,
        learnt: &Learnt,
        fitted: &Fitted,
        stated: &[Option<Stated>; AXES],
    ) -> Result<Vec<Found>, BadInput> {
        let model = &learnt.model;
        let alike = search.alike(model);
        let all = fitted.residuals(self.run, None, &self.scaling, self.known);
        let mut out = Vec::new();
        for (k, term) in learnt.terms.iter().enumerate() {
            let c = term.lead();
            let mut fewer = learnt.terms.clone();
            fewer.remove(k);
            let on_verify = if (self.known)(c) {
                let without = Fitted::new(self.data, &fewer, model.noise_models)?.residuals(
                    self.run,
                    None,
                    &self.scaling,
                    self.known,
                );
                self.agreements(term, &without, &all)
            } else {
                ByAxis::new()
            };
            let rank = &learnt.ranks[k];
            let own = rank
                .iter()
                .find(|r| r.candidate.facts.id == c.facts.id && r.candidate.parameters == c.parameters)
                .map_or(0.0, |r| r.evidence);
            // A family spans its simple members: they are no rivals.
            let family = |r: &Rival| card_of(r.candidate.facts).kind != Kind::Simple;
            let class = card_of(c.facts).class;
            let equal = rank
                .iter()
                .filter(|r| r.candidate.facts.id != c.facts.id && own - r.evidence < INDISTINGUISHABLE)
                .filter(|r| {
                    card_of(r.candidate.facts).class != class || !(family(r) || card_of(c.facts).kind != Kind::Simple)
                })
                .map(|r| r.candidate.facts.name)
                .chain(alike.iter().filter(|(_, e)| *e == k).map(|(n, _)| *n));
            out.push(Found {
                name: c.facts.name.to_string(),
                class,
                parameters: on_clock_of(self.run_of(c), c.facts, &c.parameters),
                parameter_std: parameter_std(c, k, stated),
                axes: gains_by_axis(fitted, k),
                confirmed: (self.known)(c)
                    .then(|| on_verify.values().any(Agreement::wins) && !on_verify.values().any(Agreement::loses)),
                on_verify,
                indistinguishable_from: equal.collect::<BTreeSet<_>>().into_iter().map(String::from).collect(),
                rank: rank
                    .iter()
                    .map(|r| Ranked {
                        name: r.candidate.facts.name.to_string(),
                        gain_in_cv: r.gain_in_cv,
                        net_evidence: r.net_evidence,
                    })
                    .collect(),
                score: model.members[k].score,
                p_value: None,
                reach: match c.facts.reach {
                    Reach::Unit => "unit".into(),
                    Reach::NeedsInput(what) => format!("needs {what}"),
                    Reach::Unpredictable => "unpredictable".into(),
                },
            });
        }
        Ok(out)
    }

    /// The run on whose clock the times of an effect are: the train run that it belongs to.
    fn run_of(&self, c: &Candidate) -> &Run {
        self.data.runs.get(c.run.unwrap_or(0)).unwrap_or(self.run)
    }

    fn agreements(&self, term: &Term, without: &[Vec<f64>; AXES], with: &[Vec<f64>; AXES]) -> ByAxis<Agreement> {
        (0..AXES)
            .filter(|&a| term.on(a))
            .map(|a| {
                let floor = self.noise[a].floor();
                (AXIS_NAMES[a].to_string(), agreement(&Means::of(&without[a]), &Means::of(&with[a]), floor))
            })
            .collect()
    }

    /// The model that an image is made of, with how uncertain it is (`stated` is that of the fitted model).
    pub(super) fn for_unit(
        &self,
        learnt: &Learnt,
        fitted: &Fitted,
        stated: [Option<Stated>; AXES],
        effects: &[Found],
    ) -> Result<ForUnit, BadInput> {
        // An image holds no effect that needs an input, and none on an axis that the verify run contradicts: the rest is fitted without. An
        // event that happened once stays in the fit, so that it bends no other coefficient.
        let mut kept = Vec::new();
        let mut whole = true;
        for (t, found) in learnt.terms.iter().zip(effects) {
            let mut t = t.clone();
            let input = matches!(t.lead().facts.reach, Reach::NeedsInput(_));
            for (a, n) in AXIS_NAMES.iter().enumerate() {
                if t.on(a) && (input || found.on_verify.get(*n).is_some_and(Agreement::loses)) {
                    t.prior[a].clear();
                    whole = false;
                }
            }
            if (0..AXES).any(|a| t.on(a)) {
                kept.push(t);
            }
        }
        if whole {
            return Ok(ForUnit { fitted: fitted.clone(), stated });
        }
        let fitted = Fitted::new(self.data, &kept, learnt.model.noise_models)?;
        let stated = uncertainty::of(self.data, &fitted, learnt.model.noise_models, Weights::Noise);
        Ok(ForUnit { fitted, stated })
    }

    /// `true` if one image leaves less than another on at least one axis, and on none more.
    fn beats(&self, left: &[Means; AXES], other: &[Means; AXES]) -> bool {
        let each: Vec<Agreement> = (0..AXES).map(|a| agreement(&other[a], &left[a], self.noise[a].floor())).collect();
        each.iter().any(Agreement::wins) && !each.iter().any(Agreement::loses)
    }

    /// A sum of families as a model for an image; `None` where no family brings anything.
    pub(super) fn sum_of_families(
        &self,
        search: &mut Search<'_>,
        learnt: &Learnt,
    ) -> Result<Option<ForUnit>, BadInput> {
        let model = search.sum_of_families(&learnt.model);
        let terms: Vec<Term> =
            model.members.iter().map(|m| Term { parts: m.parts.clone(), prior: m.prior.clone() }).collect();
        if !terms.iter().any(|t| t.lead().on_unit()) {
            return Ok(None);
        }
        let fitted = Fitted::new(self.data, &terms, model.noise_models)?;
        let stated = uncertainty::of(self.data, &fitted, model.noise_models, Weights::Noise);
        Ok(Some(ForUnit { fitted, stated }))
    }

    /// The image of the first model, or with the axes of another where that leaves less on the verify run; and the model of each axis.
    fn beside<'m>(
        &self,
        named: Calibration,
        models: &'m [ForUnit],
        calibration: &Calibration,
        notes: &mut Vec<String>,
    ) -> (Calibration, [&'m ForUnit; AXES]) {
        let corrected = |c: &Calibration| fit::correct(c, &self.run.steps).map(|r| Means::of(&r));
        let (mut image, mut of_axis) = (named, [&models[0]; AXES]);
        for other in &models[1..] {
            let theirs = other.fitted.image(calibration, &other.stated, &mut Vec::new());
            let (ours, left) = (corrected(&image), corrected(&theirs));
            let wins = |a: &usize| agreement(&ours[*a], &left[*a], self.noise[*a].floor()).wins();
            let present: Vec<usize> = self.run.steps.present().collect();
            let better: Vec<usize> = present.iter().copied().filter(wins).collect();
            // All axes where none gets worse, or those that get better: the one that leaves less.
            let all = Some(present).filter(|_| self.beats(&left, &ours));
            let gain =
                |axes: &[usize]| axes.iter().map(|a| (ours[*a].deviation() / left[*a].deviation()).ln()).sum::<f64>();
            let merged = [all, Some(better)].into_iter().flatten().filter(|axes| !axes.is_empty());
            let merged = merged.filter_map(|axes| Some((with_axes_of(&image, &theirs, &axes)?, axes)));
            let Some((merged, axes)) = merged.max_by(|x, y| gain(&x.1).total_cmp(&gain(&y.1))) else { continue };
            notes.push(format!(
                "the named effects leave structure: on axis {} the image holds a sum of families that names nothing, {}, which leaves less on the verify run",
                axes.iter().map(|a| AXIS_NAMES[*a]).collect::<Vec<_>>().join(", "),
                theirs.effects.iter().filter_map(|t| Some(by_id(t.id)?.name)).collect::<Vec<_>>().join(", ")
            ));
            image = merged;
            axes.iter().for_each(|a| of_axis[*a] = other);
        }
        (image, of_axis)
    }

    /// The image: axis by axis the extended model, the baseline or a constant, whichever the verify run bears out.
    pub(super) fn image(
        &self,
        calibration: &Calibration,
        learnt: &Learnt,
        models: &[ForUnit],
        baseline_fit: &Fitted,
        options: &Options,
        notes: &mut Vec<String>,
    ) -> Result<Written, BadInput> {
        let events = self.events(learnt)?;
        let baseline = self.baseline(calibration, learnt, baseline_fit, events.as_ref(), notes);
        let corrected = |c: &Calibration| fit::correct(c, &self.run.steps).map(|r| Means::of(&r));
        let named = models[0].fitted.image(calibration, &models[0].stated, notes);
        let (mut image, of_axis) = self.beside(named, models, calibration, notes);
        image.sequence = 2;
        let raw = self.run.steps.rate_dph.each_ref().map(|r| Means::of(r));
        let (of_base, of_image) = (corrected(&baseline), corrected(&image));
        let mut models = [AxisModel::Constant; AXES];
        for (a, model) in models.iter_mut().enumerate() {
            let floor = self.noise[a].floor();
            let has_effect = image.effects.iter().any(|t| t.gains[a].iter().any(|g| *g != 0.0));
            let wins = has_effect && agreement(&of_base[a], &of_image[a], floor).wins();
            let (chosen, candidate) =
                if wins { (&of_image[a], AxisModel::Extended) } else { (&of_base[a], AxisModel::Baseline) };
            // If neither is better beyond chance, choose the one that left less there.
            let better = agreement(&raw[a], chosen, floor).wins() || chosen.deviation() < raw[a].deviation();
            *model = if better { candidate } else { AxisModel::Constant };
            match *model {
                AxisModel::Extended => {}
                AxisModel::Baseline => take_axis(&mut image, &baseline, a),
                AxisModel::Constant if self.run.steps.absent[a] => {}
                AxisModel::Constant => {
                    take_axis(&mut image, &baseline, a);
                    image.axes[a].coefficients = constant(&self.beside_events(events.as_ref(), a));
                    image.axes[a].bias_std_dph = [[0.0; TERMS]; 2];
                    image.axes[a].uncertainty = Uncertainty::default();
                }
            }
        }
        drop_idle_effects(&mut image);
        let kind = if models.contains(&AxisModel::Extended) {
            Image::Extended
        } else if models.contains(&AxisModel::Baseline) {
            Image::Baseline
        } else {
            Image::None
        };
        if kind == Image::None {
            return Ok(Written { image: baseline, kind, burn: false, figures: None });
        }
        let chosen = corrected(&image);
        let in_use = options.in_use.as_ref().map(corrected);
        let beats_use = in_use.is_none_or(|u| self.beats(&chosen, &u));
        let figures = by_axis(|a| {
            let (_, constant) = of_axis[a].fitted.predicted_variance(self.run, &self.scaling, a, self.known);
            OnVerify {
                verify_rms_dph: chosen[a].deviation(),
                mean_dph: chosen[a].mean(),
                mean_std_dph: (self.noise[a].shift().powi(2) + constant).sqrt(),
                used_means: chosen[a].count(),
                model: models[a],
            }
        });
        // Add the verify run's residual beyond the noise to the image's uncertainty.
        for a in self.run.steps.present() {
            let left_dph2 = chosen[a].deviation().powi(2) - self.noise[a].floor().powi(2);
            if left_dph2 > 0.0 {
                image.axes[a].uncertainty.rest_dph2 += left_dph2 as f32;
            }
        }
        Ok(Written { image, kind, burn: kind == Image::Extended && beats_use, figures: Some(figures) })
    }

    /// The baseline beside the named events alone; `None` where none is named.
    fn events(&self, learnt: &Learnt) -> Result<Option<Fitted>, BadInput> {
        let event = |t: &&Term| t.lead().facts.reach == Reach::Unpredictable;
        let terms: Vec<Term> = learnt.terms.iter().filter(event).cloned().collect();
        (!terms.is_empty()).then(|| Fitted::new(self.data, &terms, learnt.model.noise_models)).transpose()
    }

    /// The baseline as an image. On an axis that has a named event, the event is a column of the fit: on another day it is not there,
    /// and the coefficients must not hold it.
    fn baseline(
        &self,
        calibration: &Calibration,
        learnt: &Learnt,
        plain: &Fitted,
        events: Option<&Fitted>,
        notes: &mut Vec<String>,
    ) -> Calibration {
        let stated = uncertainty::of(self.data, plain, learnt.baseline_noise_models, Weights::Plain);
        let mut image = plain.image(calibration, &stated, notes);
        if let Some(fitted) = events {
            let stated = uncertainty::of(self.data, fitted, learnt.model.noise_models, Weights::Noise);
            let beside = fitted.image(calibration, &stated, &mut Vec::new());
            // (Unless the verify run shows what was taken for an event as well: then the plain fit is right.)
            let corrected = |c: &Calibration| fit::correct(c, &self.run.steps).map(|r| Means::of(&r));
            let (of_plain, of_beside) = (corrected(&image), corrected(&beside));
            let plain = |a: usize| agreement(&of_beside[a], &of_plain[a], self.noise[a].floor()).wins();
            (0..AXES)
                .filter(|a| fitted.terms.iter().any(|t| t.on(*a)) && !plain(*a))
                .for_each(|a| take_axis(&mut image, &beside, a));
        }
        image
    }

    /// The rates of an axis on the train rows, without what its named events did.
    fn beside_events(&self, events: Option<&Fitted>, a: usize) -> Vec<f64> {
        let mut y = self.data.axes[a].y.clone();
        let Some(fitted) = events else { return y };
        for (e, t) in fitted.terms.iter().enumerate() {
            let Some(range) = fitted.gains(e, a) else { continue };
            let columns = t.parts.iter().flat_map(|c| self.data.columns(c, a, true).unwrap_or_default());
            for (column, g) in columns.zip(&fitted.axes[a].coefficients[range]) {
                y.iter_mut().zip(column).for_each(|(y, x)| *y -= g * x);
            }
        }
        y
    }
}

/// A bias that does not depend on temperature: the mean rate.
fn constant(rates_dph: &[f64]) -> Coefficients {
    let mut k = [0.0; TERMS];
    k[0] = hrg_data::numeric::stats::mean(rates_dph) as f32;
    Coefficients::One(k)
}

/// Standard deviations of the refined parameters of effect `k`, by name.
fn parameter_std(c: &Candidate, k: usize, stated: &[Option<Stated>; AXES]) -> BTreeMap<String, f64> {
    let Some(s) = stated.iter().flatten().next() else { return BTreeMap::new() };
    let each = c.facts.parameters.iter().zip(s.parameter_std[k]);
    each.filter(|(_, v)| v.is_finite()).map(|(n, v)| ((*n).to_string(), v)).collect()
}

fn gains_by_axis(fitted: &Fitted, k: usize) -> ByAxis<Gain> {
    (0..AXES)
        .filter_map(|a| {
            let range = fitted.gains(k, a)?;
            let fit = &fitted.axes[a];
            let gains = fit.coefficients[range.clone()].to_vec();
            Some((AXIS_NAMES[a].to_string(), Gain { gain: gains[0], gain_std: fit.std[range.start], gains }))
        })
        .collect()
}

/// Gives what remembers the path of the temperature the start of the verify run, which its own rates tell: it belongs to that run and
/// not to the unit. A unit does not know it: its image has what the train runs have in common. A sentence where the two differ.
pub(super) fn start_verify_run(
    fitted: &mut Fitted,
    run: &Run,
    scaling: &Scaling,
    known: &dyn Fn(&Candidate) -> bool,
) -> Option<String> {
    let first = fitted.terms.iter().map(Term::lead).find(|c| c.facts.remembers_path)?;
    let (name, common) = (first.facts.name, first.starts.common());
    let misfit = |f: &Fitted| -> f64 {
        let left = f.residuals(run, None, scaling, known);
        let each = run.steps.present().map(|a| {
            let m = Means::of(&left[a]);
            0.5 * m.count() as f64 * m.deviation().max(1e-12).powi(2).ln()
        });
        each.sum()
    };
    let mut best = (misfit(fitted), None);
    for branch in 0..Starts::BRANCHES.len() {
        let mut other = fitted.clone();
        for part in other.terms.iter_mut().flat_map(|t| &mut t.parts) {
            *part = part.starting(part.starts.with_unseen(branch));
        }
        let m = misfit(&other);
        if m < best.0 - START {
            best = (m, Some((branch, other)));
        }
    }
    let (branch, other) = best.1?;
    *fitted = other;
    let on = |b: f32| ["the lower branch", "the middle", "the upper branch"][(b + 1.0) as usize];
    Some(format!(
        "{name} begins on {} in the verify run and on {} in the train runs: that belongs to the run, and a unit does not know it until the temperature has swept the width of the loop",
        on(Starts::BRANCHES[branch]),
        on(common)
    ))
}

/// Log-likelihood that another start of the verify run must bring (its noise is not white).
const START: f64 = 20.0;
